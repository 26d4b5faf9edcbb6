"""The use case `fit`: from readings to a judged `Fit`.

>>> from flinders import simulate
>>> result = fit(simulate.tumble(seed=1, n=500, motion="uniform").samples)
>>> result.verdict, result.heading_error_deg.worst < 1.0
('good', True)
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, Self, TypeAlias, cast

from flinders.core.axes import Axes
from flinders.core.calibration import RECORDED_AXES, UNKNOWN_UNIT, Calibration
from flinders.core.disturbance import is_column
from flinders.core.keywords import check_keywords
from flinders.core.samples import Samples, frame_of
from flinders.core.units import Unit
from flinders.diagnostics.systematic import nonlinearity_in
from flinders.errors import FitError, UsageError
from flinders.estimators import Readings, remove_saturated
from flinders.estimators.auto import Auto
from flinders.estimators.data import recording_of
from flinders.fitting.aided_estimate import aided_estimate
from flinders.fitting.aiding import AUTO, MAX_CLAIM_RATIO, Aiding, AidingSensor, Instruments
from flinders.fitting.diagnosis import add_faults, faults_of_axes
from flinders.fitting.estimated import Estimated, require_turned
from flinders.fitting.judgement import judge, require_accepted, with_mounting_error
from flinders.fitting.request import Request, estimator_of, refuse_combinations
from flinders.fitting.result import with_recording
from flinders.fitting.widening import widen_claim
from flinders.likelihood.prior import SOFT_IRON_SPREAD
from flinders.likelihood.site_field import recorded_site
from flinders.native.engine import engine
from flinders.readers._auxiliary import with_auxiliary
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.core.samples import Recording
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.estimators import Estimate, Estimator
    from flinders.estimators.disturbance import DisturbanceFit
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.fitting.aiding import AnyAiding
    from flinders.fitting.result import Fit
    from flinders.fitting.widening import Widened
    from flinders.likelihood.site_field import Site
    from flinders.readers import AnySource
    from flinders.readers._asked_columns import AnyColumns

    AnyReadings: TypeAlias = Recording | Summary | ArrayLike | AnySource

PARAMETERS_ELSEWHERE: Final = {
    **dict.fromkeys(("pattern", "scale", "topic", "as_logged", "start", "end"), "flinders.read"),
    **dict.fromkeys(("strength", "field_strength"), "flinders.Site, as strength"),
    **dict.fromkeys(("dip", "dip_deg", "inclination_deg"), "flinders.Site, as inclination_deg"),
    "prior": "flinders.estimators.Likelihood and its like",
}
"""Parameters of other functions or values, with the name of that function or value, for messages."""

METHODS_MERGING_RESTS: Final = frozenset({"auto", "consistent", "ellipse", "level", "likelihood", "robust"})
"""Methods for which all readings of a rest count as one reading or none; for published recipes each reading counts."""


class _Frame(NamedTuple):
    """Unit, axes and frame of readings."""

    unit: Unit | None
    axes: Axes | None
    name: str = "sensor"

    @classmethod
    def of(cls, source: object, unit: Unit | None = None, axes: Axes | None = None) -> Self:
        """Take unit and axes from a recording, else from the arguments.

        Raises
        ------
        UsageError
            If the unit or axes in the arguments differ from those of a recording, which they cannot convert.
        """
        if not hasattr(source, "blocks"):
            return cls(unit, axes)
        recording = cast("Recording", source)
        if (unit or recording.unit) != recording.unit or (axes or recording.axes) != recording.axes:
            raise UsageError(
                f"{recording.source} is in {recording.unit.name}, axes {recording.axes}: "
                "unit and axes are for arrays and summaries; give them where the recording is read"
            )
        return cls(recording.unit, recording.axes, frame_of(recording))


@check_keywords(PARAMETERS_ELSEWHERE)
def fit(
    source: AnyReadings,
    *,
    method: str | Estimator = "auto",
    target_deg: float = 1.0,
    site: Site | None = None,
    columns: AnyColumns | None = None,
    unit: str | Unit | None = None,
    axes: str | Axes | None = None,
    sensor: str | int | None = None,
    disturbances: Sequence[str] = (),
    aiding: AnyAiding = (),
    linearize: bool = False,
) -> Fit:
    """Calibrate a magnetometer from readings, with the uncertainty and a verdict.

    Parameters
    ----------
    source : Samples, Recording, Summary, (N, 3) array-like, path, open file or data frame
        Readings, or a source for `flinders.read`, with columns chosen by their names. A `Summary` is sufficient for
        methods that need only sums; ``auto`` then uses ``consistent``.
    method : str or Estimator
        A name of `flinders.estimators.METHODS`; or a method with its options, such as
        ``flinders.estimators.Likelihood(prior=None)``. Its parameters of the site come from `site`.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    site : Site, optional
        Known field at the place of the recording, and known mounting. Corrected readings have the strength of the site;
        without a strength the matrix has determinant 1 and the length is the fitted radius. Headings are judged
        at its inclination, else at 60° (`Claim.dip_assumed`). Its values with an uncertainty are priors of the fit. For
        the path of a log with place and date, the default is the field there, as in `flinders.fit_each`; a recording or
        an array has no default.
    columns : str or sequence of str or int, optional
        The magnetometer's columns of a file or data frame, as for `flinders.read`: ``["mx", "my", "mz"]``; by default
        they are recognised by their names.
    unit : str or Unit, optional
        Unit of an array or a file, as in `flinders.read`: ``"uT"``, ``"mG"``; a recording has its own.
    axes : str or Axes, optional
        Recorded axis that becomes x, y and z, such as ``"x,-y,-z"``; a recording has its own. For a `Summary`, `axes`
        and `unit` are those of its readings.
    sensor : str or int, optional
        Name or serial number, stored with the calibration; for a log, number or name of the magnetometer to use.
    disturbances : sequence of str
        Columns that the offset shall follow: ``current``, ``throttle``, ``temperature``; ``currents`` and ``throttles``
        for each motor separately, or single motors, as ``current1``. Any other name is that of a column in the log or
        table, as ``wheel_speed_rpm`` or ``BAT.Curr``, with numbers or with the two words of a state. A column that
        explains nothing is left out, and a finding states that.
    aiding : str, sequence of str or Instruments
        Other recorded sensors to use: ``rate``, ``dip``, ``tilt``, ``attitude``; or ``auto`` for those that improve the
        calibration, disturbances included. `Instruments` also states their errors. A sensor with which the claimed
        error is larger is left out, with an `AidingSensor.reason`. See docs/terms.md.
    linearize : bool
        Correct nonlinear axes if the nonlinearity is significant and the claim becomes smaller
        (`Calibration.linearization`). Only the targets C and Python can hold such a calibration. It is available for
        one recording in memory by ``auto``, without aiding sensors and disturbances.

    Returns
    -------
    Fit
        The calibration, its claimed heading error, its findings and the verdict ``good`` or ``limited``.

    Raises
    ------
    FitError
        If the readings give no ellipsoid; `Refused` carries a fit that cannot be trusted.
    ArrayError
        For readings of the wrong shape.
    UsageError
        For an unknown method or parameter, or a number out of range. `UnitError` and `AxesError`, its subclasses, for
        an unusable unit or unusable axes.
    InputError
        For a file or table that cannot be read, as `flinders.read`.
    Unmoved
        For readings of a sensor that was hardly turned, see `flinders.diagnostics.unmoved`.
    NotTurned, InputError
        For `disturbances` of a sensor that was not turned, or that were not recorded.
    FollowsAttitude
        For a column that is a function of the direction of the field.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.likelihood.site_field import Site
    >>> tumble = simulate.tumble(seed=1)
    >>> fit(tumble.samples, site=Site(strength=50.0, inclination_deg=67.0)).calibration.field_strength
    50.0
    >>> fit(tumble.samples.field, unit="uT", method="li").evidence.method
    'li'
    """
    estimator, request = _request(method, site, target_deg=target_deg, aiding=aiding)
    refuse_combinations(estimator, request, disturbances, linearize=linearize)
    unit = Unit.of(unit) if isinstance(unit, str) else unit
    axes = Axes.of(axes) if isinstance(axes, str) else axes
    recording, name = recording_of(source, unit, axes, sensor, columns)
    if site is None and recording is not source and (stated := recorded_site(recording)):
        estimator, request = _request(method, stated[0], target_deg=target_deg, aiding=aiding)
    source = recording
    given = None if isinstance(source, Summary) else source
    source, disturbed, tried, unused = _compensate(source, disturbances, request)
    frame = _Frame.of(source, unit, axes)
    found = _estimate(Readings.of(source), estimator, request, frame.unit)._replace(unused=unused)
    if disturbed is not None:
        found = found._replace(disturbed=disturbed)
    if linearize:
        found = _linearize(found, estimator, request, frame.unit)
    judged_with = partial(_judge, tried=tried, estimator=estimator, request=request, frame=frame, sensor=name)
    result = judged_with(found)
    if (
        found.is_joint
        and (alone := _estimate_without_aiding(source, found, estimator, request, frame.unit)) is not None
    ):
        left_out = _replaced_aiding(result, judged_with(alone), found.aiding)
        result = result if left_out is None else judged_with(alone._replace(aiding=left_out))
    return require_accepted(with_recording(with_mounting_error(result, request.alignment_sigma_deg), given))


def _request(
    method: str | Estimator, site: Site | None, *, target_deg: float, aiding: AnyAiding
) -> tuple[Estimator, Request]:
    """The method with its options, and the request for a fit, from parameters of `fit`."""
    request = Request.of(site, target_deg=target_deg, instruments=Instruments.of(aiding) if aiding else None)
    estimator = estimator_of(method, request)
    return estimator, replace(request, prior=getattr(estimator, "prior", SOFT_IRON_SPREAD))


def _judge(
    found: Estimated,
    *,
    tried: tuple[AidingSensor, ...],
    estimator: Estimator,
    request: Request,
    frame: _Frame,
    sensor: str | None,
) -> Fit:
    """Widen the covariance of an estimate and judge it; `tried` has reports of disturbances."""
    if found.aiding is not None:
        found = found._replace(aiding=replace(found.aiding, sensors=(*tried, *found.aiding.sensors)))
    widened = _claim(found, estimator, request)
    calibration = _in_body_axes(_calibration(widened.estimate, request, frame, sensor), found.aiding)
    if found.linearized is not None:
        calibration = replace(calibration, linearization=found.linearized.linearization)
    return judge(widened, found, calibration, request)


def _estimate_without_aiding(
    source: Recording | Summary, aided: Estimated, estimator: Estimator, request: Request, unit: Unit | None
) -> Estimated | None:
    """Estimate from the same readings without aiding sensors; None if the readings give none."""
    try:
        alone = _estimate(Readings.of(source), estimator, replace(request, instruments=None), unit)
    except FitError:
        return None
    return alone._replace(disturbed=aided.disturbed, unused=aided.unused)


def _replaced_aiding(aided: Fit, alone: Fit, aiding: Aiding | None) -> Aiding | None:
    """Report of aiding sensors that are left out after comparing both fits; None if the aided fit is kept.

    Aiding sensors are left out if only the aided fit is refused, or if it claims more error. A fit as a level turn
    claims too little if the body leans, so that it replaces only a refused aided fit.
    """
    with_deg, without_deg = aided.heading_error_deg.worst, alone.heading_error_deg.worst
    is_refused = aided.verdict == "refused"
    is_less = not alone.claim.plane and with_deg > MAX_CLAIM_RATIO * without_deg
    if aiding is None or alone.verdict == "refused" or not (is_refused or is_less):
        return None
    return aiding.left_out(min(with_deg, 180.0), without_deg, is_refused=is_refused)


class _Compensated(NamedTuple):
    """Readings with disturbances subtracted, the disturbances, and reports of the columns that were tried."""

    source: Recording | Summary
    disturbed: DisturbanceFit | None = None
    tried: tuple[AidingSensor, ...] = ()
    unused: tuple[DisturbanceEstimate, ...] = ()


def _compensate(source: Recording | Summary, disturbances: Sequence[str], request: Request) -> _Compensated:
    """Compensate readings for the named disturbances; with ``auto`` for those that improve the fit."""
    tried: tuple[AidingSensor, ...] = ()
    if (
        request.instruments
        and request.instruments.request == AUTO
        and not disturbances
        and not isinstance(source, Summary)
    ):
        from flinders.fitting.disturbance_selection import select_disturbances

        disturbances, tried = select_disturbances(source, spread=request.prior, dip_deg=request.dip_deg)
    states: Mapping[str, tuple[str, ...]] = {}
    unused: tuple[DisturbanceEstimate, ...] = ()
    if any(map(is_column, disturbances)) and not isinstance(source, Summary):
        from flinders.fitting.column_selection import select_columns

        source, disturbances, unused, states = select_columns(
            with_auxiliary(source, disturbances), disturbances, spread=request.prior
        )
    if not disturbances:
        return _Compensated(source, None, tried, unused)
    from flinders.estimators.disturbance import fit_and_compensate

    disturbed, recording = fit_and_compensate(source, disturbances, spread=request.prior)
    return _Compensated(recording, disturbed.with_states(states), tried, unused)


def _estimate(readings: Readings, estimator: Estimator, request: Request, unit: Unit | None) -> Estimated:
    """Estimate by the engine if its record is sufficient, else with aiding sensors or the method; apply the site."""
    if not request.instruments and not request.site:
        recorded = Estimated.of_record(estimator, readings, unit)
        if recorded is not None:
            return recorded
    readings = remove_saturated(require_turned(readings, estimator, unit))
    if estimator.name in METHODS_MERGING_RESTS:
        readings = readings.for_fit()
    joint, aiding = aided_estimate(readings.all_readings, request)
    if joint is not None:
        return Estimated.of(joint, readings, aiding)._replace(is_joint=True)
    from flinders.estimators.one_strength import scale_to_one_strength

    estimate = _apply_site(estimator.estimate(readings), readings, request)
    return Estimated.of(estimate, scale_to_one_strength(readings, estimate), aiding)


def _linearize(plain: Estimated, estimator: Estimator, request: Request, unit: Unit | None) -> Estimated:
    """Estimate from linearized readings, if axes are nonlinear and the claim becomes smaller; else `plain`.

    Raises
    ------
    UsageError
        For several recordings, sums alone, or a site.
    """
    if request.site is not None or plain.readings.parts or plain.readings.recording is None:
        raise UsageError(
            "linearized axes need one recording in memory and no known field. Found several recordings, sums of "
            "readings or a site, which a log may state: calibrate the recordings one by one, and leave the site out",
            hint={"linearize": True},
        )
    curved, lag = faults_of_axes(plain.estimate, plain)
    recording = plain.readings.all_readings.recording
    if plain.record is None or not isinstance(recording, Samples) or curved is None or not curved.is_likely:
        return plain
    if lag is not None and lag.is_proven and lag.p_value < curved.p_value:  # a delay resembles a nonlinearity
        return plain
    from flinders.fitting.linearization import MAX_ROUNDS, AxisTerms

    terms, found = AxisTerms.of(curved, plain.estimate.ellipsoid), plain
    for _ in range(MAX_ROUNDS):
        linear = Readings.of(replace(recording, field=terms.linear(recording.field)))
        fitted = Estimated.of_record(estimator, linear, unit, has_sigma=True)
        if fitted is None or fitted.record is None:
            return plain
        left = nonlinearity_in(fitted.record)
        found, before, terms = fitted, terms, terms.refine(left, fitted.estimate.ellipsoid)
        if terms.is_close(before):
            break
    linearized = found._replace(linearized=terms)
    return linearized if _expected_deg(linearized) < _expected_deg(plain) else plain


def _expected_deg(found: Estimated) -> float:
    """Worst level heading error in degrees by the engine's record, including the part that depends on the direction."""
    assert found.record is not None
    record = found.record.copy()
    record["is_claimed"] = True  # compare covariances as estimated: few readings widen both by the same factor
    add_faults(record, found.estimate, found)
    return float(engine().judge(record, engine().request(shrinks=0))["worst_deg"])


def _claim(found: Estimated, estimator: Estimator, request: Request) -> Widened:
    """Widen the covariance of an estimate by errors that its method does not include, and by its disturbances.

    The estimate is shrunk towards no correction if `auto` fitted the magnetometer alone with a prior, and the readings
    were corrected before.
    """
    widened = widen_claim(
        found.estimate,
        found.readings,
        request.likelihood,
        found.statistics,
        coverage=found.coverage,
        record=found.record,
        is_biased=estimator.is_biased,
        is_joint=found.is_joint,
    )
    if found.disturbed is not None:
        widened = widened.with_covariance(found.disturbed.widen(widened.estimate.covariance))
    is_plain = isinstance(estimator, Auto) and not found.is_joint and found.disturbed is None
    engine().claim(widened.record, engine().request(shrinks=is_plain and request.prior is not None))
    return widened.with_shrinkage() if widened.record["is_shrunk"] > 0 else widened


def judge_estimate(
    estimate: Estimate,
    source: Recording | Readings,
    *,
    aiding_result: Aiding | None = None,
    site: Site | None = None,
    target_deg: float = 1.0,
    sensor: str | None = None,
    dip_assumed: bool = False,
    refreshed: Refreshed | None = None,
) -> Fit:
    """Judge the estimate of another method, such as a joint fit of several magnetometers, like a fit of a recording.

    Parameters
    ----------
    estimate : Estimate
        Estimate whose covariance includes the correlation of residuals.
    source : Recording or Readings
        Readings of the estimate, for its coverage and quality; a `Readings` is without saturated readings.
    aiding_result : Aiding, optional
        Result with the rotation from the sensor's axes to those of the body.
    site, target_deg, sensor
        As for `fit`.
    dip_assumed : bool
        Whether the dip of the site is a guess.
    refreshed : Refreshed, optional
        Changes since an earlier calibration, if the shape is that of this calibration.

    Raises
    ------
    Refused
        If the fit cannot be trusted; the error has the fit.
    """
    request = Request.of(site, target_deg=target_deg)
    request = replace(request, dip_assumed=dip_assumed or request.dip_assumed)
    readings = source if isinstance(source, Readings) else remove_saturated(Readings.of(source))
    found = Estimated.of(estimate, readings, aiding_result)._replace(refreshed=refreshed)
    calibration = _in_body_axes(_calibration(estimate, request, _Frame.of(readings.recording), sensor), aiding_result)
    widened = widen_claim(
        estimate,
        found.readings,
        request.likelihood,
        found.statistics,
        coverage=found.coverage,
        is_joint=True,
    )
    fit = with_mounting_error(judge(widened, found, calibration, request), request.alignment_sigma_deg)
    return require_accepted(with_recording(fit, readings.all_readings.recording))


def _in_body_axes(calibration: Calibration, aiding_result: Aiding | None) -> Calibration:
    """Add the rotation into body axes to a calibration, if an aiding sensor observed the mounting."""
    if aiding_result is None or aiding_result.rotation is None:
        return calibration
    return replace(calibration, matrix=aiding_result.rotation @ calibration.matrix, rotation="estimated")


def _apply_site(estimate: Estimate, readings: Readings, request: Request) -> Estimate:
    """Apply the known field of the site to an estimate."""
    if estimate.bias is not None or readings.recording is None:
        return estimate
    from flinders.estimators.known_dip import update_by_site

    mounting = {"alignment_sigma_deg": request.alignment_sigma_deg}
    return update_by_site(estimate, readings, request.site, dip_deg=request.dip_deg, **mounting)


def _calibration(estimate: Estimate, request: Request, frame: _Frame, sensor: str | None) -> Calibration:
    """The correction that maps the ellipsoid to a sphere of the stated or fitted strength."""
    given, site = request.field_strength, request.site
    if given is None and site is not None and estimate.strength == site.strength:
        given = site.strength
    calibration = Calibration.from_ellipsoid(
        estimate.ellipsoid.centre,
        estimate.ellipsoid.shape,
        field_strength=estimate.strength if given is None else given,
        raw=frame.unit or UNKNOWN_UNIT,
        axes=frame.axes or RECORDED_AXES,
        sensor=sensor,
        frame=frame.name,
    )
    is_known = given is not None or bool(estimate.follows)
    if calibration.field_strength_known == is_known:
        return calibration
    return replace(calibration, field_strength_known=is_known)
