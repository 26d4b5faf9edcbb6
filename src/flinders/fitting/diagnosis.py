"""Diagnosis of a fit by the tests of `flinders.diagnostics`, which need the recording.

The tests find drift, nonlinear axes, axes that are read late, a disturbance that is not modelled, dependence on the
attitude, and swapped axes.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1, n=500, motion="uniform").samples)
>>> fit.evidence.diagnosis.drift is None, fit.evidence.diagnosis.axis_swap
(True, None)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from flinders.core.samples import Samples
from flinders.diagnostics.systematic import drift_in, drift_of, lag_in, nonlinearity_in
from flinders.fitting.evidence import Diagnosis
from flinders.fitting.record import ASKS_HALVES, ASKS_SWAP
from flinders.fitting.widening import compare_halves

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.diagnostics.attitude_dependence import AttitudeDependence
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.systematic import AxisLag, Drift, Nonlinearity
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.estimators import Estimate, Readings
    from flinders.fitting.estimated import Estimated
    from flinders.fitting.request import Request
    from flinders.fitting.widening import Widened
    from flinders.native.layouts import Records

MAX_DRIFT_READINGS: Final = 5_000
"""Largest count of readings in the test for drift; a longer recording is thinned to this count."""


def _drift(estimate: Estimate, found: Estimated, dip_deg: float) -> Drift | None:
    """Drift within one recording; None if its residuals are white or the test does not apply.

    An estimate of a method with a bias is not tested, because the bias looks like drift.
    """
    readings = found.readings
    if found.record is not None and not estimate.outliers:
        return drift_in(found.record)
    if readings.recording is None or readings.parts or estimate.unobserved or estimate.bias is not None:
        return None
    if found.refreshed is not None:  # in a few seconds drift cannot be distinguished from correlated noise
        return None
    if estimate.correlation is None or estimate.correlation.is_white:
        return None
    near = readings.inliers(estimate.ellipsoid, estimate.rejected_beyond)
    return drift_of(near.thin(MAX_DRIFT_READINGS), estimate.ellipsoid, dip_deg=dip_deg)


def _with_halves(drift: Drift, estimate: Estimate, readings: Readings, request: Request) -> Drift:
    """Add the comparison of both halves of a recording in memory to a drift."""
    samples = readings.all_readings.recording
    if not isinstance(samples, Samples):
        return drift
    return replace(drift, halves_ratio=compare_halves(samples, request.likelihood, estimate))


def faults_of_axes(estimate: Estimate, found: Estimated) -> tuple[Nonlinearity | None, AxisLag | None]:
    """Nonlinearity and lag of the axes, from a fit without disturbances and without a bias of its method."""
    if found.record is None or found.disturbed or estimate.plane or estimate.unobserved:
        return None, None
    if estimate.bias is not None:
        return None, None
    terms, lag = found.linearized, lag_in(found.record)
    return nonlinearity_in(found.record) if terms is None else terms.corrected_nonlinearity(found.record), lag


def add_faults(record: Records, estimate: Estimate, found: Estimated) -> tuple[Nonlinearity | None, AxisLag | None]:
    """Write nonlinearity and lag of the axes into a record; for a corrected nonlinearity, the remaining error."""
    nonlinearity, lag = faults = faults_of_axes(estimate, found)
    record["nonlinear_deg"] = record["lag_deg"] = math.nan
    if lag is not None:
        record["lag_deg"], record["lag_by_chance"] = lag.heading_deg, lag.p_value
    if nonlinearity is not None and nonlinearity.is_corrected:
        record["linearized_deg"], record["linearized_share"] = nonlinearity.heading_deg, nonlinearity.share
    elif nonlinearity is not None:
        record["nonlinear_deg"], record["nonlinear_by_chance"] = nonlinearity.heading_deg, nonlinearity.p_value
        record["nonlinearity"] = [*nonlinearity.quadratic, *nonlinearity.cubic]
    return faults


def _axis_swap(estimate: Estimate, readings: Readings) -> AxisSwap | None:
    """Swap of axes within one recording in memory; None if there is none."""
    samples = readings.all_readings.recording
    if readings.parts or not isinstance(samples, Samples):
        return None
    from flinders.diagnostics.axis_swap import axis_swap_of

    return axis_swap_of(samples.field, estimate.noise)


def _unmodelled_disturbance(estimate: Estimate, found: Estimated, dip_deg: float) -> Unmodelled | None:
    """Test of one recording in memory for a recorded disturbance that changes readings, if the fit follows none."""
    samples = found.readings.recording
    if estimate.unobserved or found.disturbed or not isinstance(samples, Samples) or not samples.disturbances:
        return None
    from flinders.diagnostics.unmodelled import unmodelled_of

    time = 1.0 if estimate.correlation is None else estimate.correlation.time
    return unmodelled_of(samples, estimate.ellipsoid, dip_deg=dip_deg, time=time, limit=estimate.rejected_beyond)


def _attitude_dependence(estimate: Estimate, found: Estimated, dip_deg: float) -> AttitudeDependence | None:
    """Test of one recording in memory for an error that depends on the attitude; None for white residuals."""
    samples, correlation = found.readings.recording, estimate.correlation
    if estimate.plane or estimate.unobserved or (correlation is not None and correlation.is_white):
        return None
    if not isinstance(samples, Samples) or samples.acceleration is None:
        return None
    from flinders.diagnostics.attitude_dependence import attitude_dependence_of

    return attitude_dependence_of(samples, estimate.ellipsoid, dip_deg=dip_deg, limit=estimate.rejected_beyond)


def _tilt_error_deg(estimate: Estimate, calibration: Calibration, found: Estimated) -> float:
    """Heading error in degrees from errors of the accelerometer's vertical.

    NaN for a fit in one plane, and for a fit that corrects the accelerometer.
    """
    samples, aiding = found.readings.all_readings.recording, found.aiding
    if estimate.plane or not isinstance(samples, Samples) or samples.acceleration is None:
        return math.nan
    from flinders.diagnostics.instruments import VERTICAL_SENSORS, vertical_error_deg

    if aiding is not None and any(sensor.is_used and sensor.name in VERTICAL_SENSORS for sensor in aiding.sensors):
        return math.nan
    return vertical_error_deg(samples.field, samples.acceleration, calibration, estimate)


def diagnose(widened: Widened, estimate: Estimate, found: Estimated, calibration: Calibration) -> Diagnosis:
    """Run all tests on a fit, and write nonlinearity and lag of the axes into its record."""
    dip_deg = float(widened.record["dip_deg"])
    nonlinearity, axis_lag = add_faults(widened.record, estimate, found)
    return Diagnosis(
        drift=_drift(estimate, found, dip_deg),
        nonlinearity=nonlinearity,
        axis_lag=axis_lag,
        unmodelled=_unmodelled_disturbance(estimate, found, dip_deg),
        attitude_dependence=_attitude_dependence(estimate, found, dip_deg),
        repeats=widened.repeats,
        refreshed=found.refreshed,
        tilt_error_deg=_tilt_error_deg(widened.estimate, calibration, found),
    )


def run_requested_tests(
    asks: int, diagnosis: Diagnosis, estimate: Estimate, found: Estimated, request: Request
) -> Diagnosis:
    """Diagnosis with the further tests that a judgement requests, as bits of `asks`."""
    if asks & ASKS_HALVES and diagnosis.drift is not None:
        drift = _with_halves(diagnosis.drift, estimate, found.readings, request)
        diagnosis = replace(diagnosis, drift=drift)
    if asks & ASKS_SWAP:
        diagnosis = replace(diagnosis, axis_swap=_axis_swap(estimate, found.readings))
    return diagnosis
