"""Sums that fade: the consistent fit where nothing fades, and an offset that moves is followed."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Joined, Samples
from flinders.errors import FitError, NeedsSamples, TooFewSamples, UsageError
from flinders.estimators import Consistent, Forgetting, Readings
from flinders.estimators.reference.trace import spread_counts
from flinders.geometry.ellipsoid import upper
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flinders.arrays import Floats

IRON: Final = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])
OFFSET: Final = np.array([20.0, 120.0, 90.0])


def turned(n: int, seed: int, *, noise: float = 0.5) -> Floats:
    rng = np.random.default_rng(seed)
    field: Floats = OFFSET + 50.0 * simulate.uniform(rng, n) @ IRON + noise * rng.standard_normal((n, 3))
    return field


@pytest.mark.parametrize("motion", ["uniform", "hand", "hemisphere"])
def test_without_forgetting_it_is_consistent(motion: str) -> None:
    """Also where the memory is so long that nothing fades, but for rounding."""
    readings = Readings.of(simulate.tumble(seed=1, motion=motion, n=2000).samples)
    wanted = Consistent().estimate(readings)
    for memory, rtol in ((None, 0.0), (1e12, 1e-8)):
        found = Forgetting(memory).estimate(readings)
        assert found.ellipsoid.isclose(wanted.ellipsoid, rtol=max(rtol, 1e-15))
        assert found.noise == pytest.approx(wanted.noise, rel=1e-7)
        npt.assert_allclose(found.covariance, wanted.covariance, rtol=1e-5, atol=1e-9)


def test_sums_are_enough_where_nothing_fades_and_only_there() -> None:
    readings = Readings.of(turned(500, 1))
    sums = Readings(readings.summary)
    assert Forgetting().estimate(sums).ellipsoid.isclose(Forgetting().estimate(readings).ellipsoid)
    with pytest.raises(NeedsSamples, match="forgetting with memory=100"):
        Forgetting(100.0).estimate(sums)
    with pytest.raises(NeedsSamples):
        Forgetting().converge(sums)


def test_it_is_the_fit_of_readings_that_are_weighed_by_their_age() -> None:
    """Written out: whole readings, whole weights, and the recursion forgets nothing else."""
    from flinders.estimators.consistent import adjusted
    from flinders.summary.moments import Moments

    field, memory = turned(3000, 2), 400.0
    weights = np.exp(-np.arange(3000)[::-1] / memory)
    moments = Moments.of(field, weight=weights) * (weights.sum() / (weights @ weights))
    written_out = Readings(Summary(moments, Readings.of(field).summary.cloud, Readings.of(field).summary.health))
    wanted, _ = adjusted(written_out)
    assert Forgetting(memory).estimate(Readings.of(field)).ellipsoid.isclose(wanted, rtol=1e-9)


class InBlocks:
    """The same readings, some at a time."""

    source = "in blocks"

    def __init__(self, field: Floats, rows: int) -> None:
        self.samples, self.rows = Samples(field), rows
        self.unit, self.axes = self.samples.unit, self.samples.axes

    def blocks(self) -> Iterator[Samples]:
        return self.samples.blocks(self.rows)


@pytest.mark.parametrize("memory", [None, 50.0, 700.0])
def test_blocks_files_and_steps_change_nothing(memory: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.estimators.cache.HELD", 100)  # what is longer is read block by block
    field = turned(1500, 3)
    method = Forgetting(memory)
    wanted = method.estimate(Readings.of(field))
    for source in (InBlocks(field, 7), InBlocks(field, 1000), Joined((Samples(field[:333]), Samples(field[333:])))):
        assert method.estimate(Readings.of(source)).ellipsoid.isclose(wanted.ellipsoid, rtol=1e-9)
    last = method.converge(Readings.of(InBlocks(field, 101)), steps=17)
    npt.assert_allclose(last.parameters[-1, :3], wanted.ellipsoid.centre, atol=1e-7)
    npt.assert_allclose(last.sigmas[-1], np.sqrt(np.diag(wanted.covariance)), rtol=1e-3)


@pytest.mark.parametrize("memory", [None, 100.0, 300.0, 1000.0])
def test_the_claim_is_as_large_as_the_error(memory: float | None) -> None:
    """Normalised error squared of all nine parameters, over 60 recordings: one on average."""
    squares = []
    for seed in range(60):
        found = Forgetting(memory).estimate(Readings.of(turned(2000, seed)))
        apart = np.concatenate([found.ellipsoid.centre - OFFSET, upper(found.ellipsoid.shape - 50.0 * IRON)])
        squares.append(float(apart @ np.linalg.solve(found.covariance, apart)) / 9)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_readings_that_count_are_twice_the_memory() -> None:
    for memory in (50.0, 200.0):
        assert Forgetting(memory).estimate(Readings.of(turned(4000, 1))).used == pytest.approx(2 * memory, rel=0.01)


def test_an_offset_that_moves_is_followed_within_a_few_memories() -> None:
    field = turned(6000, 4)
    field[3000:] += [30.0, 0.0, 0.0]
    readings = Readings.of(field)
    all_of_it, fading = (Forgetting(memory).estimate(readings) for memory in (None, 300.0))
    moved = OFFSET + np.array([30.0, 0.0, 0.0])
    assert np.linalg.norm(all_of_it.ellipsoid.centre - moved) > 10.0
    assert np.linalg.norm(fading.ellipsoid.centre - moved) < 4.0 * np.sqrt(np.trace(fading.covariance[:3, :3]))
    steps = Forgetting(300.0).converge(readings)
    after = steps.parameters[steps.counts > 4500]
    npt.assert_allclose(after[:, 0], moved[0], atol=1.0)
    before = steps.parameters[(steps.counts > 500) & (steps.counts <= 3000)]
    npt.assert_allclose(before[:, 0], OFFSET[0], atol=1.0)


def test_convergence_begins_with_nothing_and_ends_with_the_estimate() -> None:
    readings = Readings.of(turned(800, 5))
    steps = Forgetting().converge(readings, steps=20)
    assert steps.counts.tolist() == spread_counts(800, 20)
    assert len(steps) == 20
    assert not steps.is_known[0]
    assert steps.is_known[5:].all()
    npt.assert_allclose(steps.parameters[-1, :3], Forgetting().estimate(readings).ellipsoid.centre, atol=1e-9)
    halfway = np.searchsorted(steps.counts, 200)
    npt.assert_allclose(
        steps.sigmas[halfway, :3] / steps.sigmas[-1, :3], np.sqrt(800 / steps.counts[halfway]), rtol=0.2
    )


@pytest.mark.parametrize("memory", [0.0, -5.0, 9.99, float("nan"), float("inf"), True, "300"])
def test_a_memory_that_holds_nothing_is_refused(memory: float) -> None:
    with pytest.raises(UsageError, match="memory is"):
        Forgetting(memory)


def test_a_handful_of_readings_is_too_few_whatever_the_memory() -> None:
    for memory in (None, 10.0):
        with pytest.raises(TooFewSamples):
            Forgetting(memory).estimate(Readings.of(turned(9, 1)))
    with pytest.raises(FitError):
        Forgetting(10.0).converge(Readings.of(turned(9, 1)))


def test_the_program_takes_a_memory_and_watches(tmp_path: Path) -> None:
    path = tmp_path / "raw.csv"
    np.savetxt(path, turned(3000, 6), delimiter=",", fmt="%.4f", header="mx_uT,my_uT,mz_uT", comments="")
    words = ["calibrate", str(path), "--method", "forgetting", "--option", "memory=500", "--json"]
    ended = CliRunner().invoke(main, [*words, "--convergence", str(tmp_path / "settling.csv")])
    assert ended.exit_code == 0, ended.output
    found = json.loads(ended.stdout)
    npt.assert_allclose(found["calibration"]["offset"], OFFSET, atol=0.3)
    table = np.genfromtxt(tmp_path / "settling.csv", delimiter=",", names=True)
    npt.assert_allclose([table[f"offset_{axis}_uT"][-1] for axis in "xyz"], found["calibration"]["offset"], atol=1e-6)
    assert table["heading_off_deg"][-1] == 0.0


def test_a_real_recording_gives_what_consistent_gives(recordings: Callable[[str], Path]) -> None:
    source = flinders.read(recordings("michaelwro_fxos8700/mag-readings.txt"))
    wanted, found = (flinders.fit(source, method=method, target_deg=10.0) for method in ("consistent", "forgetting"))
    npt.assert_allclose(found.calibration.offset, wanted.calibration.offset, rtol=1e-12)
    npt.assert_allclose(found.covariance, wanted.covariance, rtol=1e-9)
