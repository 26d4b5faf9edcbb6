"""Several recordings of one sensor: fitted as one, read once, and nothing goes across from one to the next."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import SENSOR

import flinders
from flinders.core.joining import Joined
from flinders.core.samples import RecordingWrapper, Samples
from flinders.estimators import Readings, data
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.robust import Robust
from flinders.simulate import tumble

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.core.samples import Recording


class Streamed(RecordingWrapper):
    """A recording that is gone through block by block, and counts how often."""

    def __init__(self, samples: Samples) -> None:
        self.recording: Recording = samples
        self.passes = 0

    def blocks(self) -> Iterator[Samples]:
        """From the first block again."""
        self.passes += 1
        assert isinstance(self.recording, Samples)
        return self.recording.blocks(777)


def by_hand(seed: int, n: int = 3000) -> Samples:
    """A tumble of one sensor whose clock starts anew."""
    return tumble(seed=seed, sensor=SENSOR, n=n).samples


def test_recordings_are_read_once_and_kept_each_on_its_own() -> None:
    samples = [by_hand(seed, n) for seed, n in ((1, 3000), (2, 1500), (3, 2000))]
    streams = [Streamed(part) for part in samples]
    readings = Readings.of(Joined(tuple(streams)))
    assert [stream.passes for stream in streams] == [1, 1, 1]
    assert isinstance(readings.recording, Samples)
    npt.assert_array_equal(readings.recording.field, np.concatenate([part.field for part in samples]))
    assert [len(part) for part in readings.parts] == [3000, 1500, 2000]
    for part, own in zip(readings.parts, samples, strict=True):
        assert isinstance(part.recording, Samples)
        npt.assert_array_equal(part.recording.field, own.field)
        npt.assert_array_equal(part.recording.time, own.time)
        assert np.shares_memory(part.recording.field, readings.recording.field)
        assert part.parts == ()
    assert flinders.fit(Joined(tuple(streams))).evidence.samples > 6400
    assert [stream.passes for stream in streams] == [2, 2, 2]


def test_the_summary_of_the_whole_is_that_of_its_parts() -> None:
    samples = [by_hand(1), by_hand(2, 1500)]
    readings = Readings.of(Joined(tuple(map(Streamed, samples))))
    health = readings.summary.health
    assert len(readings.summary) == sum(len(part.summary) for part in readings.parts) == 4500
    assert health.clock.backward_steps == 0
    assert health.clock.longest_step == pytest.approx(0.02)
    assert health.clock.mean_step == pytest.approx(0.02)
    assert health.clock.seconds == pytest.approx(0.02 * 4498)


def test_a_seam_is_no_repeat() -> None:
    samples = by_hand(1)
    again = Joined((samples, samples[::-1]))
    assert Readings.of(again).summary.health.repeats == 0


def test_one_recording_that_was_joined_is_a_single_one() -> None:
    readings = Readings.of(Joined((Joined((by_hand(1),)),)))
    assert readings.parts == ()
    assert readings.single_recordings == (readings,)
    nested = Readings.of(Joined((Joined((by_hand(1), by_hand(2))), by_hand(3))))
    assert len(nested.parts) == 3


def test_what_is_kept_in_memory_is_bounded_over_all_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data, "MAX_HELD_READINGS", 5000)
    streams = [Streamed(by_hand(seed, n)) for seed, n in ((1, 3000), (2, 3000), (3, 1500), (4, 1500))]
    readings = Readings.of(Joined(tuple(streams)))
    in_memory = [isinstance(part.recording, Samples) for part in readings.parts]
    assert in_memory == [True, False, True, False]
    assert isinstance(readings.recording, Joined)
    assert [stream.passes for stream in streams] == [1, 1, 1, 1]
    assert sum(len(block) for block in readings.recording.blocks()) == len(readings) == 9000
    assert [stream.passes for stream in streams] == [1, 2, 1, 2]


@pytest.mark.parametrize("method", ["auto", "robust", "consistent"])
def test_of_a_recording_that_is_too_long_for_memory_a_part_is_fitted(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second or fourth reading of 6,000; sums are those of all, so a method that needs only these is the same."""
    joined = Joined(tuple(Streamed(by_hand(seed, 2000)) for seed in (1, 2, 3)))
    whole = flinders.fit(joined, method=method)
    for room, used in ((3000, 3000), (1500, 1500)):
        monkeypatch.setattr(data, "MAX_HELD_READINGS", room)
        part = flinders.fit(joined, method=method)
        off = part.calibration.offset - whole.calibration.offset
        assert np.all(np.abs(off) < 3.0 * np.hypot(part.claim.offset_sigma, whole.claim.offset_sigma))
        assert part.verdict == whole.verdict
        if method != "consistent":
            assert used - 10 <= part.evidence.samples <= used


def test_an_empty_recording_adds_nothing() -> None:
    samples = by_hand(1)
    empty = Streamed(samples[:0])
    alone, joined = Readings.of(samples), Readings.of(Joined((empty, samples)))
    assert [len(part) for part in joined.parts] == [0, 3000]
    assert isinstance(joined.recording, Samples)
    one, other = Likelihood().estimate(alone), Likelihood().estimate(joined)
    npt.assert_allclose(other.covariance, one.covariance, rtol=1e-9)


def test_a_short_recording_does_not_hide_how_residuals_of_a_long_one_hang_together() -> None:
    rng = np.random.default_rng(4)
    field = tumble(seed=4, sensor=SENSOR, n=4000, noise=0.1).samples.field.copy()
    drift = np.zeros(len(field))
    for row in range(1, len(field)):
        drift[row] = 0.9 * drift[row - 1] + 0.2 * rng.standard_normal()
    field += drift[:, np.newaxis] * np.array([0.5, 0.5, 0.7])
    alone = Likelihood().estimate(Readings.of(field))
    joined = Likelihood().estimate(Readings.of(Joined((Samples(field), Samples(field[:10])))))
    assert alone.correlation is not None
    assert joined.correlation is not None
    assert alone.correlation.time > 3.0
    assert joined.correlation.time == pytest.approx(alone.correlation.time, rel=0.1)
    npt.assert_allclose(np.diag(joined.covariance), np.diag(alone.covariance), rtol=0.1)


def test_a_magnet_at_the_end_of_one_recording_leaves_the_next_alone() -> None:
    first, second = by_hand(1), by_hand(2)
    field = first.field.copy()
    field[-60:] += np.array([60.0, 30.0, 0.0])
    struck = Samples(field, unit=first.unit, time=first.time)
    found = Robust().estimate(Readings.of(Joined((struck, second))))
    run = max(found.outliers, key=lambda outlier: outlier.readings)
    assert 2941 - 60 <= run.first <= 2941  # margins of readings, some of which are rests
    assert run.last == 3000
    assert run.end_s == first.time[-1] if first.time is not None else False
    assert all(outlier.readings < 4 for outlier in found.outliers if outlier.first > 3000)
    fitted = Readings.of(Joined((struck, second))).for_fit().statistics.fitted
    assert found.used + sum(outlier.independent for outlier in found.outliers) == fitted


def test_rows_of_strays_are_counted_over_all_recordings() -> None:
    first, second = by_hand(1), by_hand(2)
    field = second.field.copy()
    field[[99, 199]] += 200.0
    found = Robust().estimate(Readings.of(Joined((first, Samples(field, unit=second.unit, time=second.time)))))
    far = [outlier for outlier in found.outliers if outlier.max_distance > 50.0]
    assert [(outlier.first, outlier.readings) for outlier in far] == [(3100, 1), (3200, 1)]
    assert second.time is not None
    assert far[0].start_s == second.time[99]
