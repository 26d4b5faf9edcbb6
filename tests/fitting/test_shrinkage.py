"""Readings that were corrected before are not made worse; others are fitted as ever."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks import adversary
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.estimators import METHODS, Readings
from flinders.fitting.batch import fit_batch
from flinders.fitting.record import record_of_ellipsoid
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.native.engine import engine
from flinders.simulate import Sensor

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.native.layouts import Records

CORRECTED = Sensor(noise=0.3)
UNCORRECTED = Sensor(offset=np.array([20.0, -10.0, 15.0]), noise=0.3)


def rocked(seed: int, sensor: Sensor, tilt_deg: float = 8.0) -> Samples:
    """A level turn that is tilted a little: one direction rests on few readings."""
    rng = np.random.default_rng([seed, 5])
    field = 50.0 * simulate.in_body_axes(simulate.tilted(rng, 600, tilt_deg=tilt_deg), simulate.north_and_down(60.0))
    return Samples.of(sensor.read(field, rng), unit="uT")


def judged(samples: Samples, **options: object) -> Fit:
    try:
        return flinders.fit(samples, **options)  # type: ignore[arg-type]
    except Refused as refusal:
        return refusal.fit


def claimed(ellipsoid: Ellipsoid, covariance: Floats) -> Records:
    """The record of an estimate, shrunk where its readings were corrected before."""
    record = record_of_ellipsoid(ellipsoid)
    record["covariance"], record["is_claimed"] = covariance.ravel(), True
    engine().claim(record, engine().request())
    return record


def error_deg(fit: Fit, sensor: Sensor) -> float:
    of = adversary.Sensor(sensor.matrix.T, sensor.offset)
    level = adversary.level(0, of, adversary.Effect())
    return float(np.abs(adversary.headings(fit.calibration.apply(level))).max())


@pytest.mark.nightly
def test_a_compass_that_was_good_stays_good(trials: Choose) -> None:
    """Off by no more than a true claim allows, where a fit of the same readings by themselves is off by far more."""
    chosen = trials(60, 15)
    fits = [judged(rocked(seed, CORRECTED)) for seed in range(chosen.count)]
    alone = [judged(rocked(seed, CORRECTED), method="likelihood") for seed in range(chosen.count)]
    off, off_alone = ([error_deg(fit, CORRECTED) for fit in some] for some in (fits, alone))
    assert sum(fit.claim.is_shrunk for fit in fits) >= 0.9 * chosen.count
    assert np.median(off) < 0.5 * np.median(off_alone)
    ratios = [true / fit.heading_error_deg.worst for true, fit in zip(off, fits, strict=True)]
    assert np.median(ratios) < 1.3
    assert max(ratios) < 3.0


def test_an_uncorrected_sensor_is_fitted_as_ever() -> None:
    samples = rocked(1, UNCORRECTED)
    fit, alone = judged(samples), judged(samples, method="likelihood")
    assert not fit.claim.is_shrunk
    assert np.allclose(fit.calibration.offset, alone.calibration.offset, atol=1e-9)


def test_the_verdict_says_when_to_leave_the_readings_alone() -> None:
    finding = next(one for one in judged(rocked(1, CORRECTED)).findings if one.code == "corrected-before")
    assert finding.number < 2.0 * finding.limit
    assert_sentences(finding.advice)


def test_offset_taken_off_and_iron_left_is_worth_a_calibration() -> None:
    left = Sensor(np.diag([1.06, 1.0, 0.94]), np.array([0.1, -0.2, 0.1]), noise=0.2)
    rng = np.random.default_rng(2)
    fit = judged(Samples.of(left.read(50.0 * simulate.uniform_directions(rng, 500), rng), unit="uT"))
    finding = next(one for one in fit.findings if one.code == "corrected-before")
    assert "worth having" in finding.advice
    assert error_deg(fit, left) < 3.0 * fit.heading_error_deg.worst


@pytest.mark.parametrize("sensor", [CORRECTED, UNCORRECTED])
def test_a_batch_shrinks_the_same_units_by_their_records(sensor: Sensor) -> None:
    samples = rocked(3, sensor, tilt_deg=35.0)
    fit, found = judged(samples), fit_batch([samples, rocked(4, sensor, tilt_deg=35.0)])
    assert fit.claim.is_shrunk == (sensor is CORRECTED)
    assert found.by_record.all()
    assert ("corrected-before" in found.findings[0]) == fit.claim.is_shrunk
    assert np.allclose(found.offset[0], fit.calibration.offset, atol=1e-9)
    assert found.worst_deg[0] == pytest.approx(fit.heading_error_deg.worst, rel=1e-9)


def test_an_estimate_that_is_hardly_known_is_left_alone() -> None:
    """Seconds of a real recording that leave two directions unknown by 10¹² times the field ended in a traceback."""
    fitted = METHODS["auto"]().estimate(Readings.of(50.0 * simulate.uniform_directions(np.random.default_rng(1), 300)))
    unknown = np.zeros((9, 9))
    unknown[[0, 3], [0, 3]] = 1e28
    unknown[0, 3] = unknown[3, 0] = -1e28
    assert claimed(fitted.ellipsoid, fitted.covariance + unknown)["is_shrunk"] < 0


def test_a_direction_of_which_much_is_unknown_leaves_a_negative_variance_to_rounding() -> None:
    """The first minutes of a real recording: the covariance had eigenvalues from -2e-7 of the largest on."""
    fitted = METHODS["likelihood"]().estimate(Readings.of(rocked(1, Sensor(noise=0.3))))
    size = np.trace(fitted.ellipsoid.shape) / 3.0
    along, across = np.eye(9)[0] - np.eye(9)[3], np.eye(9)[1] + np.eye(9)[2]
    covariance = 2000.0 * np.outer(along, along) - 2e-3 * np.outer(across, across) + 2.5e-3 * np.eye(9)
    assert np.linalg.eigvalsh(covariance)[0] < -1e-3
    assert np.isfinite(claimed(fitted.ellipsoid, covariance * size**2)["covariance"]).all()


def test_the_claim_of_a_shrunk_fit_is_nearer_and_narrower() -> None:
    poorly_known = np.diag([4.0, 0.04, 0.04, *[0.25] * 6])
    shrunken = claimed(Ellipsoid(np.array([3.0, 0.1, 0.0]), 50.0 * np.eye(3)), poorly_known)
    assert shrunken["is_shrunk"] > 0
    assert shrunken["centre"].round(2).tolist() == [0.12, 0.07, 0.0]
    assert np.sqrt(shrunken["covariance"][0]) < 0.6
    assert claimed(Ellipsoid(np.array([40.0, 9.0, 0.0]), 50.0 * np.eye(3)), poorly_known)["is_shrunk"] < 0
