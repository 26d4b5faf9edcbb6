"""Strays are found, left out and listed; where there are none, nothing is looked for."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import adversary
from scipy.spatial.transform import Rotation
from tests.trials import daily
from tests.worlds import SENSOR, Streamed, moved_alike, passed_by_a_magnet

import flinders
from flinders import Samples, simulate
from flinders.errors import NotAnEllipsoid
from flinders.estimators import Readings, data
from flinders.estimators.auto import Auto
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.outliers import MARGIN_READINGS
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import upper_entries
from flinders.heading.error_propagation import level_error
from flinders.native.engine import engine
from flinders.simulate import Simulated, angle_error_deg, tumble
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.estimators import Estimate

OFFSET: Final = np.array([5.0, -3.0, 8.0])

PASSED: Final = slice(1200, 1320)
"""Rows, from 0, that a magnet spoils: 24.0 to 26.4 s."""


def weighed(found: Estimate, truth: Simulated) -> float:
    """Square of the error in units of what is claimed, over nine."""
    wanted = np.concatenate([truth.sensor.offset, upper_entries(50.0 * truth.sensor.matrix)])
    off = np.concatenate([found.ellipsoid.centre, upper_entries(found.ellipsoid.shape)]) - wanted
    return float(off @ np.linalg.solve(found.covariance, off)) / 9.0


@pytest.mark.parametrize("noise", daily([0.1, 0.5, 2.0]))
def test_gross_outliers_cost_no_more_than_the_readings_they_are(noise: float, trials: Choose) -> None:
    """3 % at up to three field strengths: as good as the likelihood of the other 97 %, and as good as it claims."""
    claim = trials(25, 8)
    robust, clean, claims = [], [], []
    for seed in claim.seeds:
        truth = tumble(seed=seed, motion="uniform", n=500, noise=noise, outliers=0.03)
        fit = flinders.fit(truth.samples)
        assert fit.evidence.method == "robust"
        kept = flinders.fit(truth.samples.field[~truth.outliers], method="likelihood")
        robust.append(angle_error_deg(fit.calibration.matrix, fit.calibration.offset, truth))
        clean.append(angle_error_deg(kept.calibration.matrix, kept.calibration.offset, truth))
        claims.append(weighed(Auto().estimate(Readings.of(truth.samples)), truth))
    assert np.sqrt(np.mean(np.square(robust))) < 1.06**claim.widening * np.sqrt(np.mean(np.square(clean)))
    low, high = claim.ratios(0.7, 1.4)
    assert low < np.mean(claims) < high


@pytest.mark.parametrize("share", [0.1, 0.2])
@pytest.mark.parametrize("size", [30.0, 70.0])
def test_a_minority_that_is_moved_alike_cannot_win(share: float, size: float, trials: Choose) -> None:
    claim = trials(12, 4)
    spoiled, clean = [], []
    for seed in claim.seeds:
        moved = size * simulate.uniform_directions(np.random.default_rng(seed), 1)[0]
        found = flinders.fit(moved_alike(seed, share, moved))
        assert found.evidence.method == "robust"
        spoiled.append(found.calibration.offset - SENSOR.offset)
        clean.append(flinders.fit(moved_alike(seed, 0.0, moved)).calibration.offset - SENSOR.offset)
    assert np.sqrt(np.mean(np.square(spoiled))) < 1.4**claim.widening * np.sqrt(np.mean(np.square(clean)))


@pytest.mark.parametrize("place", [0.2, 0.6, 1.5, 3.0], ids=lambda place: f"{place:g} radii from the centre")
def test_a_fifth_in_one_tight_cluster_cannot_win(place: float) -> None:
    rng = np.random.default_rng(7)
    field = tumble(seed=7, motion="uniform", n=500, sensor=SENSOR).samples.field.copy()
    field[:100] = SENSOR.offset + place * 50.0 * SENSOR.matrix @ [0.6, 0.0, 0.8] + 0.3 * rng.standard_normal((100, 3))
    fit = flinders.fit(field)
    assert np.linalg.norm(fit.calibration.offset - SENSOR.offset) < 0.35
    assert fit.evidence.samples <= 400  # they are a rest


def test_a_magnet_that_passes_is_told_with_its_rows_its_time_and_how_far_it_pulled() -> None:
    truth, samples = passed_by_a_magnet(PASSED)
    fit = flinders.fit(samples, site=flinders.Site(strength=50.0))
    assert fit.evidence.method == "robust"
    assert np.linalg.norm(fit.calibration.offset - truth.sensor.offset) < 0.2
    largest = max(fit.evidence.outliers, key=lambda outlier: outlier.readings)
    assert largest.readings > 60
    assert PASSED.start - 25 < largest.first <= largest.last <= PASSED.stop + 25
    assert samples.time is not None
    assert largest.start_s == samples.time[largest.first - 1]
    assert largest.end_s == samples.time[largest.last - 1]
    assert 10.0 < largest.max_distance < 60.0
    finding = next(finding for finding in fit.findings if finding.code == "outliers")
    assert finding.severity == "note"
    assert finding.number < 0.08
    assert f"{largest.start_s:.1f}–{largest.end_s:.1f} s" in finding.advice


@pytest.mark.parametrize("rows", [None, 97, 1000])
def test_what_is_listed_is_what_was_left_out(rows: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The readings around the magnet too, whether the recording is held or goes by in blocks of any size."""
    _, samples = passed_by_a_magnet(PASSED)
    if rows is not None:
        monkeypatch.setattr(data, "MAX_HELD_READINGS", 2500)
    found = Robust().estimate(Readings.of(samples if rows is None else Streamed(samples, rows)))
    rejected = sum(outlier.readings for outlier in found.outliers)
    left_out = len(samples) - rejected - found.used * (1 if rows is None else 2)
    assert left_out == 0 if rows is None else 0 <= left_out <= 4 * MARGIN_READINGS, (
        "around a run of every second reading"
    )
    run = max(found.outliers, key=lambda outlier: outlier.readings)
    assert run.readings == run.last - run.first + 1 > 120


def test_the_rows_of_a_stray_are_those_of_the_recording() -> None:
    field = tumble(seed=5, motion="uniform", n=600, sensor=SENSOR).samples.field.copy()
    for row in (0, 99, 599):
        field[row] = SENSOR.offset + np.array([200.0, 0.0, 0.0])
    fit = flinders.fit(field)
    assert [(outlier.first, outlier.last, outlier.readings) for outlier in fit.evidence.outliers] == [
        (1, 1, 1),
        (100, 100, 1),
        (600, 600, 1),
    ]
    assert [str(outlier) for outlier in fit.evidence.outliers][1] == "reading 100"
    assert all(np.isnan(outlier.start_s) for outlier in fit.evidence.outliers)
    assert fit.evidence.samples == 597


def test_a_stream_too_long_to_hold_lists_the_same_strays(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the readings is fitted; what is left out is looked for in all of them, block by block."""
    _, samples = passed_by_a_magnet(PASSED)
    whole = flinders.fit(samples)
    monkeypatch.setattr(data, "MAX_HELD_READINGS", 1000)
    streamed = flinders.fit(Streamed(samples))
    apart = np.abs(streamed.calibration.offset - whole.calibration.offset)
    assert (apart < 3.0 * streamed.claim.offset_sigma).all()
    for one, other in zip(whole.evidence.outliers, streamed.evidence.outliers, strict=True):
        assert (one.first, one.last, one.start_s, one.end_s) == (other.first, other.last, other.start_s, other.end_s)


@pytest.mark.parametrize("motion", ["uniform", "hand", "tilted", "hemisphere", "clumped"])
@pytest.mark.parametrize("noise", [0.1, 2.0])
def test_clean_readings_do_not_ask_for_it(motion: str, noise: float, trials: Choose) -> None:
    for seed in trials(15, 4).seeds:
        readings = Readings.of(tumble(seed=seed, motion=motion, noise=noise).samples)
        assert not engine().fit(readings.thin(len(readings)), statistics=0)["is_robust"]


def test_asked_for_it_costs_clean_readings_next_to_nothing() -> None:
    for seed in range(5):
        truth = tumble(seed=seed, motion="uniform", n=2000, sensor=SENSOR)
        plain, robust = (
            flinders.fit(truth.samples),
            flinders.fit(truth.samples, method=flinders.estimators.Auto(robust=True)),
        )
        assert (plain.evidence.method, robust.evidence.method) == ("likelihood", "robust")
        assert robust.evidence.samples >= 1996
        npt.assert_allclose(
            robust.calibration.offset, plain.calibration.offset, rtol=0, atol=0.4 * plain.claim.offset_sigma.max()
        )
        npt.assert_allclose(np.diag(robust.claim.covariance), np.diag(plain.claim.covariance), rtol=0.05)


def test_the_method_and_the_option_are_the_same() -> None:
    field = moved_alike(1, 0.1, np.array([0.0, 80.0, 0.0]))
    fits = (
        flinders.fit(field),
        flinders.fit(field, method="robust"),
        flinders.fit(field, method=flinders.estimators.Auto(robust=True)),
    )
    assert {fit.evidence.method for fit in fits} == {"robust"}
    for fit in fits:
        npt.assert_array_equal(fit.calibration.offset, fits[0].calibration.offset)
        assert fit.evidence.outliers == fits[0].evidence.outliers
    assert Robust().estimate(Readings.of(field)).rejected_beyond < 3.0


@pytest.mark.parametrize("method", ["auto", "robust"])
def test_a_sensor_that_lies_still_most_of_the_time_is_not_rejected(method: str) -> None:
    """60 % of the readings in one place, first or last, are as good as the rest."""
    for seed in range(4):
        truth = tumble(seed=seed, motion="clumped", n=1250, sensor=SENSOR)
        for field in (truth.samples.field, truth.samples.field[::-1]):
            fit = flinders.fit(field, method=method)
            assert sum(outlier.readings for outlier in fit.evidence.outliers) <= 2
            assert np.linalg.norm(fit.calibration.offset - SENSOR.offset) < 0.3


def test_a_rest_that_is_disturbed_does_not_count_though_it_is_the_majority() -> None:
    """A place counts once, however long the sensor lay there: beside iron, say, 20 % off the field."""
    truth = tumble(seed=2, motion="clumped", n=1250, sensor=SENSOR)
    field = truth.samples.field.copy()
    field[500:] += 0.2 * 50.0 * truth.directions[500:] @ SENSOR.matrix.T
    fit = flinders.fit(field)
    assert np.linalg.norm(fit.calibration.offset - SENSOR.offset) < 0.4
    assert fit.evidence.samples <= 500


def test_coverage_does_not_count_directions_of_strays() -> None:
    """Half of the sphere is seen; what lies on the other side is off the surface."""
    field = tumble(seed=4, motion="hemisphere", n=2000, sensor=SENSOR).samples.field
    below = SENSOR.offset + 1.8 * 50.0 * simulate.uniform_directions(np.random.default_rng(1), 150) @ SENSOR.matrix.T
    fit = flinders.fit(np.concatenate([field, below]))
    assert fit.evidence.method == "robust"
    assert fit.evidence.coverage.fraction < 0.6
    assert fit.evidence.coverage.hole_deg > 60.0
    summary = Readings.of(np.concatenate([field, below])).summary
    assert Coverage.of_cloud(summary.cloud, fit.calibration.ellipsoid).fraction > 0.75


def test_nonsense_is_no_minority() -> None:
    """Readings without any surface: refused, one way or another, and never by another error."""
    field = 50.0 * np.random.default_rng(3).standard_normal((400, 3))
    try:
        fit = flinders.fit(field, method=flinders.estimators.Auto(robust=True))
    except (flinders.FitError, NotAnEllipsoid):
        return
    assert fit.verdict != "good"


@pytest.mark.nightly
def test_rejected_runs_that_may_be_noise_do_not_sharpen_the_claim() -> None:
    """Near steel noise comes and goes: a claim from the quiet part alone would be too small."""
    near_steel = adversary.Effect(place=partial(adversary.desk, rms=1.0))
    wider = 0
    for seed in range(12):
        sensor, path = (adversary.stream(seed, what) for what in ("sensor", "path 0"))
        samples = adversary.recorded(seed, adversary.sensor(sensor), near_steel, adversary.tumble(path))
        estimate, plain = (method.estimate(Readings.of(samples)) for method in (Auto(), Likelihood()))
        reach = max((run.max_distance for run in estimate.outliers), default=np.inf)
        if reach < 2.5 * estimate.rejected_beyond:
            wider += 1
            claim, of_all = (level_error(one.ellipsoid, one.covariance).worst for one in (estimate, plain))
            assert claim > 0.9 * of_all
    assert wider >= 2


def leaned_in_a_field_that_changes(seed: int, shifts: tuple[float, ...]) -> Floats:
    """Readings of a body that lies nearly flat and leans in between, each time with another vertical offset."""
    rng = np.random.default_rng(seed)

    def held(n: int, tilt_deg: float) -> Floats:
        heading, direction = rng.uniform(0.0, 2.0 * np.pi, (2, n))
        tilt = np.radians(tilt_deg) * rng.uniform(0.3, 1.0, n)
        axis = np.stack([np.cos(direction), np.sin(direction), np.zeros(n)], axis=1)
        field = np.stack([20.0 * np.cos(heading), 20.0 * np.sin(heading), np.full(n, 45.0)], axis=1)
        leaned: Floats = Rotation.from_rotvec(tilt[:, np.newaxis] * axis).apply(field)
        return leaned

    parts = [part for shift in shifts for part in (held(500, 2.0), held(40, 30.0) + np.array([0.0, 0.0, shift]))]
    field = np.concatenate(parts)
    noisy: Floats = field + rng.normal(0.0, 0.1, field.shape) + OFFSET
    return noisy


def test_a_majority_found_by_chance_claims_what_others_differ_by() -> None:
    """The few readings that tell the vertical offset disagree; where all are rejected, it is off by 20 µT and more."""
    far, ratios = 0, []
    for seed in range(20):
        for shifts in ((0.0, 3.0), (-2.0, 0.0, 2.0)):
            estimate = Robust().estimate(Readings.of(Samples.of(leaned_in_a_field_that_changes(seed, shifts))))
            off = np.abs(estimate.ellipsoid.centre - OFFSET)
            far += off[2] > 20.0
            ratios.append(np.max(off / np.sqrt(np.diag(estimate.covariance)[:3])))
    assert far >= 5
    assert max(ratios) < 3.0
