"""The use case: from readings to a judged `Fit`.

>>> from flinders import simulate
>>> result = fit(simulate.tumble(seed=1, n=500, motion="uniform").samples)
>>> result.verdict, result.heading_error_deg.worst < 1.0
('good', True)
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.samples import Samples, frame_of
from flinders.core.units import Unit
from flinders.deprecation import renamed_keywords
from flinders.diagnostics.axis_swap import axis_swap_of
from flinders.diagnostics.drift import drift_of
from flinders.diagnostics.repeatability import RecordingFit, compared
from flinders.diagnostics.unmodelled import unmodelled_of
from flinders.diagnostics.unmoved import require_moved
from flinders.errors import FitError, UsageError
from flinders.estimators import Readings, as_correlated, at_one_strength, method_of, with_bias, within_range
from flinders.estimators.aiding import refuse_without
from flinders.estimators.auto import Auto
from flinders.estimators.data import concatenated
from flinders.estimators.disturbance import following
from flinders.estimators.known_dip import sited
from flinders.estimators.level import Level, turned_level
from flinders.estimators.regressors import DisturbanceEstimate
from flinders.fitting.aid_selection import AUTO, aided_by, available
from flinders.fitting.aiding import Aiding, AidingSensor
from flinders.fitting.disturbance_selection import earned
from flinders.fitting.result import Fit, Refused
from flinders.fitting.verdict import judge
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import alignment_error_deg, level_error
from flinders.likelihood.dip import ACCELERATION_SIGMA
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.identifiability import is_flat
from flinders.likelihood.prior import SPREAD
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.core.samples import Recording
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.drift import Drift
    from flinders.diagnostics.repeatability import Repeats
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.estimators import Estimate, Estimator
    from flinders.estimators.disturbance import Driving
    from flinders.heading.error_propagation import HeadingError
    from flinders.likelihood.site_field import Site
    from flinders.summary.summary import Summary

LOOKED_AT: Final = 5_000
"""Readings of a longer recording that are looked at for a change in time."""


@renamed_keywords(drivers="disturbances", aids="aiding")
def fit(
    source: Recording | Summary | ArrayLike,
    *,
    method: str = "auto",
    field_strength: float | None = None,
    target_deg: float = 1.0,
    dip_deg: float | None = None,
    alignment_sigma_deg: float | None = None,
    unit: Unit | None = None,
    axes: Axes | None = None,
    sensor: str | None = None,
    disturbances: Sequence[str] = (),
    aiding: str | Sequence[str] = (),
    site: Site | None = None,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    **options: Any,
) -> Fit:
    """Find the calibration, and say how far to trust it.

    Parameters
    ----------
    source : Samples, Recording, Summary or (N, 3) array-like
        Readings. A `Summary` is enough for the methods that need only sums; ``auto`` then is ``consistent``.
    method : str
        One of `flinders.estimators.METHODS`.
    field_strength : float, optional
        Length that corrected readings shall have: the strength of the field at the site, in the
        unit of the readings. Without it the matrix has determinant 1 and the strength is the radius that results.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float, optional
        Inclination of the field at the site: by default that of `site`, else 60°.
    alignment_sigma_deg : float, optional
        How well the mounting is known, 1 σ about each axis; its heading error is told on its own, since no
        magnetometer sees it. Of a level turn at a known site it also says how steep a tilt can be, see docs/level.md.
    unit, axes : Unit, Axes, optional
        Of an array or a Summary; a recording brings its own.
    sensor : str, optional
        Name or serial number, kept with the calibration.
    disturbances : sequence of str
        What the offset shall follow: ``current``, ``throttle``, ``temperature``, of columns that the recording has;
        ``currents`` and ``throttles`` of each motor by itself, or one by one, as ``current1``.
    aiding : str or sequence of str
        What else was recorded and shall count: ``rate``, ``dip``, ``tilt``, ``attitude``; or ``auto`` for what earns
        its place, disturbances included. See docs/terms.md.
    site : Site, optional
        What is known of the field at the place. With its strength, corrected readings have that length.
    gyro_scale : float
        With the aid ``rate``: what the scales of the gyro may be off by, 1 σ; 0 where it has been calibrated.
    acceleration_bias : float, m/s²
        With the aid ``dip``: what the accelerometer may be off by on each axis, 1 σ; 0 where it has been calibrated.
    **options
        Those of the method, such as ``prior=None`` or ``bias_correction=False`` for ``likelihood``.

    Raises
    ------
    FitError
        If the readings give no ellipsoid; `Refused` carries the fit where there is one that cannot be trusted.
    ArrayError
        For readings of the wrong shape.
    UsageError
        For a method or option that does not exist, or numbers out of range.
    Unmoved
        For readings of a sensor that was hardly turned, see `flinders.diagnostics.unmoved`.
    NotTurned, InputError
        For `disturbances` of a sensor that was not turned, or that were not recorded.
    """
    if alignment_sigma_deg is not None and not 0.0 <= alignment_sigma_deg <= 180.0:
        raise UsageError(f"alignment sigma is {alignment_sigma_deg:g}°: need an angle from 0° to 180°")
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if dip_deg is None:
        dip_deg = 60.0 if site is None or site.inclination_deg is None else site.inclination_deg
    estimator = estimator_of(method, options, {"dip_deg": dip_deg, "field_strength": field_strength})
    driving, tried = None, cast("tuple[AidingSensor, ...]", ())
    if aiding == AUTO and not disturbances and hasattr(source, "blocks"):
        disturbances, tried = earned(cast("Recording", source), spread=options.get("prior", SPREAD), dip_deg=dip_deg)
    if disturbances:
        driving, source = following(source, disturbances, spread=options.get("prior", SPREAD))
    readings = Readings.of(source)
    frame = "sensor"
    if hasattr(source, "blocks"):
        recording = cast("Recording", source)
        _refuse_to_relabel(recording, unit, axes)
        unit, axes, frame = recording.unit, recording.axes, frame_of(recording)
    plane = getattr(estimator, "plane", "xy" if method == Level.name else None)
    how = "through all directions" if plane is None else f"all the way round in the plane {plane}"
    require_moved(readings.summary, (unit or Unit.of()).inside, how)
    readings = within_range(readings)
    instruments = {"gyro_scale": gyro_scale, "acceleration_bias": acceleration_bias}
    aided, aiding_result = _aided(
        readings, aiding, site, method=method, dip_deg=dip_deg, options=options, instruments=instruments
    )
    aiding_result = (
        aiding_result if aiding_result is None else replace(aiding_result, each=(*tried, *aiding_result.each))
    )
    estimate = aided or _sited(estimator.estimate(readings), readings, site, alignment_sigma_deg, dip_deg)
    readings = readings if aided else at_one_strength(readings, estimate)
    if site is not None and field_strength is None and estimate.strength == site.strength:
        field_strength = site.strength
    calibration = _calibration(estimate, field_strength, unit=unit, axes=axes, sensor=sensor, frame=frame)
    calibration = _turned(calibration, aiding_result)
    likelihood = Auto(options.get("prior", SPREAD), dip_deg=dip_deg)
    if aided is None:
        estimate, repeated = _widened(estimate, likelihood, readings, is_biased=estimator.is_biased)
    else:  # knows how its residuals hang together
        repeated = _repeated(estimate, readings.summary)
        estimate = replace(estimate, covariance=estimate.covariance * repeated)
    repeats = _repeats(readings, likelihood, estimate)
    if repeats is not None:
        estimate = replace(estimate, covariance=estimate.covariance + repeats.scatter)
    if driving is not None:
        estimate = replace(estimate, covariance=driving.widened(estimate.covariance))
    fitted = _judged(estimate, readings, calibration, target_deg, dip_deg, repeats, repeated, driving, aiding_result)
    fitted = _mounted(fitted, alignment_sigma_deg)
    if fitted.verdict == "refused":
        raise Refused(fitted)
    return fitted


def judged_as(
    estimate: Estimate,
    source: Recording,
    *,
    aiding_result: Aiding | None = None,
    field_strength: float | None = None,
    target_deg: float = 1.0,
    dip_deg: float = 60.0,
    sensor: str | None = None,
) -> Fit:
    """Judge an estimate that was made elsewhere, such as by several magnetometers together, as that of a recording.

    Parameters
    ----------
    estimate : Estimate
        Its covariance knows how residuals hang together.
    source : Recording
        The readings that it belongs to, for coverage and health.
    aiding_result : Aiding, optional
        With the rotation that corrected readings are turned by.
    field_strength, target_deg, dip_deg, sensor
        As for `fit`.

    Raises
    ------
    Refused
        Where it cannot be trusted; it carries the fit.
    """
    readings = within_range(Readings.of(source))
    frame = frame_of(source)
    calibration = _calibration(
        estimate, field_strength, unit=source.unit, axes=source.axes, sensor=sensor, frame=frame
    )  # fmt: skip
    repeated = _repeated(estimate, readings.summary)
    estimate = replace(estimate, covariance=estimate.covariance * repeated)
    calibration = _turned(calibration, aiding_result)
    fitted = _judged(estimate, readings, calibration, target_deg, dip_deg, None, repeated, None, aiding_result)
    if fitted.verdict == "refused":
        raise Refused(fitted)
    return fitted


def _turned(calibration: Calibration, aiding_result: Aiding | None) -> Calibration:
    """Turn corrected readings into the axes of the body, where an aid saw how the sensor sits in them."""
    if aiding_result is None or aiding_result.rotation is None:
        return calibration
    return replace(calibration, matrix=aiding_result.rotation @ calibration.matrix, rotation="estimated")


def _mounted(fitted: Fit, sigma_deg: float | None) -> Fit:
    """Add the heading error of a mounting of stated uncertainty, where it is stated."""
    if sigma_deg is None:
        return fitted
    error = alignment_error_deg(sigma_deg, dip_deg=fitted.heading_error_deg.dip_deg)
    return replace(fitted, alignment_error_deg=error)


def estimator_of(method: str, options: dict[str, Any], site: dict[str, Any]) -> Estimator:
    """Look a method up and give it its options, and of what is known of the site that which it asks for.

    Raises
    ------
    UsageError
        For a name or an option that does not exist.
    """
    kind = cast("Any", method_of(method))
    known = [option.name for option in dataclasses.fields(kind)]
    try:
        return cast("Estimator", kind(**{name: value for name, value in site.items() if name in known}, **options))
    except TypeError:
        own = [name for name in known if name not in site]
        unknown = [name for name in options if name not in own]
        raise UsageError(f"{method} takes {', '.join(own) or 'no options'}; got {', '.join(unknown)}") from None


def _refuse_to_relabel(source: Recording, unit: Unit | None, axes: Axes | None) -> None:
    """A recording knows its unit and axes: naming others does not convert it.

    Raises
    ------
    UsageError
        Where they differ.
    """
    if (unit or source.unit) != source.unit or (axes or source.axes) != source.axes:
        raise UsageError(
            f"{source.source} is in {source.unit.name}, axes {source.axes}: "
            "unit and axes are for arrays and summaries; give them where the recording is read"
        )


def _aided(
    readings: Readings,
    aiding: str | Sequence[str],
    site: Site | None,
    *,
    method: str,
    dip_deg: float,
    options: dict[str, Any],
    instruments: dict[str, float],
) -> tuple[Estimate | None, Aiding | None]:
    """Fit with what was recorded beside the magnetometer; no estimate where no aid was asked for, or none was kept.

    Raises
    ------
    UsageError
        For another method than the default one, where only sums are left, or for instruments out of range.
    """
    _refuse_instruments(**instruments)
    if not aiding:
        return None, None
    if method != "auto" or set(options) - {"prior"}:
        raise UsageError("aids go with method='auto' and its prior alone: leave other methods and options out")
    if readings.recording is None:
        raise UsageError("aids need what was recorded beside the readings: give the recording, not its summary")
    recording = readings.recording
    samples = recording if isinstance(recording, Samples) else concatenated(list(recording.blocks()), recording)
    if len(samples) >= Level.unknowns and turned_level(samples.field):
        return None, _of_no_use(samples, aiding)
    spread = options.get("prior", SPREAD) or SPREAD
    aided, aiding_result = aided_by(samples, aiding, site=site, dip_deg=dip_deg, spread=spread, **instruments)
    if is_flat(readings.summary.moments.principal_variances, aided.noise):
        return None, _of_no_use(samples, aiding)
    return aided.estimate() if aided.aiding else None, aiding_result


def _refuse_instruments(gyro_scale: float, acceleration_bias: float) -> None:
    """Refuse what no gyro or accelerometer is off by.

    Raises
    ------
    UsageError
        Saying what is possible.
    """
    if not 0.0 <= gyro_scale <= 0.5:
        raise UsageError(f"gyro scale is {gyro_scale:g}: need a share from 0 to 0.5, such as {SCALE_SIGMA:g}")
    if not 0.0 <= acceleration_bias <= 2.0:
        raise UsageError(
            f"acceleration bias is {acceleration_bias:g} m/s²: need 0 to 2, such as {ACCELERATION_SIGMA:g}"
        )


def _of_no_use(samples: Samples, aiding: str | Sequence[str]) -> Aiding:
    """Say of each aid that a level turn leaves it nothing to tell.

    Raises
    ------
    UsageError
        For an aid that is not known or was not recorded.
    """
    names = available(samples) if aiding == AUTO else (aiding,) if isinstance(aiding, str) else tuple(aiding)
    refuse_without(samples, names)
    words = "the readings lie in one plane, as in a level turn, across which it tells nothing"
    return Aiding(tuple(AidingSensor(name, kept=False, words=words) for name in names))


def _sited(
    estimate: Estimate, readings: Readings, site: Site | None, alignment_sigma_deg: float | None, dip_deg: float
) -> Estimate:
    """Hold an estimate by the field of the site; of a dip that someone knows better, by its strength alone."""
    if estimate.bias.any() or readings.recording is None:
        return estimate
    if site is not None and site.inclination_deg is not None and site.inclination_deg != dip_deg:
        site = replace(site, inclination_deg=None)
    return sited(estimate, readings, site, dip_deg=dip_deg, alignment_sigma_deg=alignment_sigma_deg)


def _calibration(
    estimate: Estimate,
    field_strength: float | None,
    *,
    unit: Unit | None,
    axes: Axes | None,
    sensor: str | None,
    frame: str,
) -> Calibration:
    """The correction that makes a sphere of the ellipsoid; a strength that follows the readings is as good as given."""
    calibration = Calibration.from_ellipsoid(
        estimate.ellipsoid.centre,
        estimate.ellipsoid.shape,
        field_strength=estimate.strength if field_strength is None else field_strength,
        raw=unit or Unit.of(),
        axes=axes or Axes(),
        sensor=sensor,
        frame=frame,
    )
    known = field_strength is not None or bool(estimate.follows)
    return (
        calibration if calibration.field_strength_known == known else replace(calibration, field_strength_known=known)
    )


def _widened(estimate: Estimate, likelihood: Auto, readings: Readings, *, is_biased: bool) -> tuple[Estimate, float]:
    """Add to a claim what the method leaves out of it: correlation, repeated readings (by which factor), bias."""
    beside = None
    looked_at = estimate.correlation is not None or estimate.plane or readings.recording is None
    if is_biased or not looked_at:
        try:
            beside = likelihood.estimate(readings)
        except FitError:  # too few readings to see beyond the simpler model
            beside = None
    if beside is not None and not looked_at and not beside.plane and not beside.unobserved:
        estimate = as_correlated(estimate, beside)
    repeated = _repeated(estimate, readings.summary)
    few = _few(estimate, len(readings.summary) / repeated)
    estimate = replace(estimate, covariance=estimate.covariance * (repeated * few))
    return (with_bias(estimate, beside) if beside is not None and is_biased else estimate), repeated


def _repeated(estimate: Estimate, summary: Summary) -> float:
    """Factor by which repeated readings, no new evidence, widen a covariance that does not know of them yet."""
    share = len(summary) / max(len(summary) - summary.health.repeats, 1)
    if estimate.textbook is None:
        return share
    known = float(np.mean(np.diag(estimate.covariance) / np.maximum(np.diag(estimate.textbook), np.finfo(float).tiny)))
    return max(1.0, share / known)


def _few(estimate: Estimate, count: float) -> float:
    """Factor by which few readings widen a covariance, as their noise is known from few residuals.

    The variance of Student's t, ν/(ν − 2), for the ν readings beyond those that the parameters take up. Below three
    there is no such variance, and the factor grows by four for each reading that is missing.
    """
    freedom = count - (5 if estimate.plane else 9)
    return freedom / (freedom - 2.0) if freedom >= 3.0 else 3.0 * 4.0 ** (3.0 - max(freedom, 0.0))


def _drift(estimate: Estimate, readings: Readings, dip_deg: float) -> Drift | None:
    """Whether something changed while one recording was made: if so, its residuals are not white.

    What a model is too simple for looks like a change, too, and is told as a bias.
    """
    if readings.recording is None or readings.parts or estimate.unobserved or estimate.bias.any():
        return None
    if estimate.correlation is None or estimate.correlation.is_white:
        return None
    near = readings.near(estimate.ellipsoid, estimate.rejected_beyond)
    return drift_of(near.thinned(LOOKED_AT), estimate.ellipsoid, dip_deg=dip_deg)


def _slip(estimate: Estimate, readings: Readings) -> AxisSwap | None:
    """Whether axes slipped while one recording was made, of those held in memory; if so, residuals are not white."""
    if readings.parts or not isinstance(readings.recording, Samples):
        return None
    if not estimate.outliers and (estimate.correlation is None or estimate.correlation.is_white):
        return None
    return axis_swap_of(readings.recording.field, estimate.noise)


def _unfollowed(estimate: Estimate, readings: Readings, dip_deg: float, driving: Driving | None) -> Unmodelled | None:
    """Test whether a recorded disturbance moves the readings of one recording in memory while none is modelled."""
    if driving is not None or estimate.unobserved or not isinstance(readings.recording, Samples):
        return None
    near = readings.near(estimate.ellipsoid, estimate.rejected_beyond).recording
    time = 1.0 if estimate.correlation is None else estimate.correlation.time
    return unmodelled_of(near, estimate.ellipsoid, dip_deg=dip_deg, time=time) if isinstance(near, Samples) else None


def _textbook(estimate: Estimate, dip_deg: float) -> HeadingError | None:
    """What independent residuals would allow to claim."""
    if estimate.textbook is None:
        return None
    return level_error(estimate.ellipsoid, estimate.textbook, dip_deg=dip_deg, down=down_of(estimate.plane))


def _independent(estimate: Estimate, count: float) -> float:
    """How many independent readings say as much."""
    return np.inf if estimate.correlation is None else estimate.correlation.effective(count)


def _distortion(estimate: Estimate) -> float:
    """What belongs to the direction; a ring of them takes nearly all of it off, and the rest tells little."""
    if estimate.correlation is None or estimate.plane:
        return 0.0
    return estimate.correlation.direction


def _bias_deg(estimate: Estimate, dip_deg: float) -> float:
    """Heading error (rms) that the bias of a method makes."""
    if not estimate.bias.any():
        return 0.0
    bias, down = np.outer(estimate.bias, estimate.bias), down_of(estimate.plane)
    return level_error(estimate.ellipsoid, bias, dip_deg=dip_deg, down=down).rms


def _repeats(readings: Readings, likelihood: Auto, estimate: Estimate) -> Repeats | None:
    """Hold the recordings of a sensor against each other, those that say all by themselves.

    Level turns are only held against each other: each rests on the dip, and elsewhere that is found.
    """
    turns: list[RecordingFit] = []
    others: list[RecordingFit] = []
    for part in readings.parts:
        try:
            alone = likelihood.estimate(part)
        except FitError:
            continue
        source = "" if part.recording is None else part.recording.source
        if alone.plane or not alone.unobserved:
            alike = turns if alone.plane else others
            covariance = alone.covariance * _few(alone, len(part.summary))
            alike.append(RecordingFit(source, alone.used, alone.ellipsoid, covariance))
    parts = turns if estimate.plane or len(others) < 2 else others
    return compared(parts, dip_deg=likelihood.dip_deg) if len(parts) > 1 else None


def _judged(
    estimate: Estimate,
    readings: Readings,
    calibration: Calibration,
    target_deg: float,
    dip_deg: float,
    repeats: Repeats | None,
    repeated: float,
    driving: Driving | None = None,
    aiding_result: Aiding | None = None,
) -> Fit:
    """Put together what is known and judge it."""
    summary, covariance = readings.summary, estimate.covariance
    coverage = Coverage.through(summary.cloud, estimate.ellipsoid, within=estimate.rejected_beyond)
    down = down_of(estimate.plane)
    error = max(
        (
            level_error(estimate.ellipsoid, covariance, dip_deg=dip, down=down)
            for dip in ((dip_deg,) if estimate.plane else coverage.facings(dip_deg))
        ),
        key=lambda error: error.worst,
    )
    dip = error.dip_deg
    fitted = Fit(
        calibration=calibration,
        method=estimate.method,
        covariance=covariance,
        noise=estimate.noise,
        samples=estimate.used or len(summary),
        coverage=coverage,
        heading_error_deg=error,
        distortion=_distortion(estimate),
        target_deg=target_deg,
        dip_deg=dip_deg,
        prior_influence=estimate.prior_influence,
        unobserved=estimate.unobserved,
        textbook_heading_error_deg=_textbook(estimate, dip),
        independent_samples=_independent(estimate, len(summary) / repeated),
        autocorrelation=None if estimate.correlation is None else estimate.correlation.lag_one,
        outliers=estimate.outliers,
        bias_deg=_bias_deg(estimate, dip),
        drift=_drift(estimate, readings, dip),
        axis_swap=_slip(estimate, readings),
        unmodelled=_unfollowed(estimate, readings, dip, driving),
        repeats=repeats,
        plane=estimate.plane,
        z_down=estimate.z_down,
        aiding=aiding_result,
        alignment_error_deg=None if aiding_result is None else aiding_result.alignment_error_deg(dip),
    )
    fitted = replace(fitted, heading_error_deg=fitted.heading_error_deg.beside(fitted.structure_deg))
    if driving is not None:
        fitted = _with_disturbances(fitted, driving)
    return replace(fitted, findings=judge(fitted, summary))


def _with_disturbances(fitted: Fit, driving: Driving) -> Fit:
    """A fit to settled readings, with what is known of its drivers."""
    calibration = replace(fitted.calibration, disturbances=driving.disturbances)
    dip, down = fitted.heading_error_deg.dip_deg, down_of(fitted.plane)
    estimates = [
        DisturbanceEstimate(
            disturbance.name,
            disturbance,
            taken_deg=calibration.disturbance_deg(disturbance, dip_deg=dip),
            left_deg=driving.left(fitted.ellipsoid, place, dip_deg=dip, down=down).worst,
            shared=quality.shared,
            monotonicity=quality.monotonicity,
            attenuation=quality.attenuation,
            lag_is_beyond=quality.is_beyond,
            curvature=quality.curvature,
            collinearity=quality.collinearity,
            chi_square=quality.chi_square,
            lag_sigma_s=quality.lag_sigma_s,
        )
        for place, (disturbance, quality) in enumerate(zip(driving.disturbances, driving.found, strict=True))
    ]
    constant = [DisturbanceEstimate(name) for name in driving.constant]
    return replace(
        fitted,
        calibration=calibration,
        disturbances=(*estimates, *constant),
        disturbances_covariance=driving.joint(fitted.covariance),
        noise_uncompensated=driving.noise_without,
    )
