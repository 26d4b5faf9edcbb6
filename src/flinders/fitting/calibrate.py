"""The use case: from readings to a judged `Fit`.

>>> from flinders import simulate
>>> result = fit(simulate.tumble(seed=1, n=500, motion="uniform").samples)
>>> result.verdict, result.heading_error_deg.worst < 1.0
('good', True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self, TypeAlias, cast

import numpy as np

from flinders.core.axes import Axes
from flinders.core.calibration import AS_RECORDED, UNSTATED, Calibration
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.samples import Samples, frame_of, in_memory
from flinders.core.units import Unit
from flinders.diagnostics.systematic import drift_in, drift_of, lag_in, nonlinearity_in
from flinders.diagnostics.unmoved import require_moved, was_turned
from flinders.errors import FitError, UsageError, spell_checked
from flinders.estimators import Readings, method_of, within_range
from flinders.estimators.auto import Auto
from flinders.estimators.base import OF_SITE
from flinders.estimators.data import recording_of
from flinders.estimators.level import Level, turned_level
from flinders.estimators.likelihood import estimated
from flinders.fitting.aiding import AUTO, Aiding, AidingSensor, Instruments
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Diagnosis, Disturbances, Evidence, Residuals
from flinders.fitting.record import (
    ASKS_HALVES,
    ASKS_SWAP,
    add_diagnosis,
    add_reading,
    farthest,
    request_of,
    sources_of,
)
from flinders.fitting.result import Fit, Judgement, Refused
from flinders.fitting.verdict import judged_quantities, with_findings
from flinders.fitting.widening import claimed, halves_apart
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import HeadingError, alignment_error_deg, level_error, require_headings
from flinders.likelihood.prior import SPREAD
from flinders.native.engine import engine
from flinders.summary.coverage import Coverage, RecordCoverage
from flinders.summary.summary import Statistics, Summary, is_flat

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.core.samples import Recording
    from flinders.diagnostics.attitude_dependence import AttitudeDependence
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.diagnostics.systematic import AxisLag, Drift, Nonlinearity
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.estimators import Estimate, Estimator
    from flinders.estimators.disturbance import DisturbanceFit
    from flinders.fitting.aiding import AnyAiding
    from flinders.fitting.linearization import AxisTerms
    from flinders.fitting.widening import Widened
    from flinders.likelihood.site_field import Site
    from flinders.native.layouts import Records
    from flinders.readers import AnySource

    AnyReadings: TypeAlias = Recording | Summary | ArrayLike | AnySource

ELSEWHERE: Final = {
    **dict.fromkeys(("columns", "pattern", "scale", "topic", "as_logged", "start", "end"), "flinders.read"),
    **dict.fromkeys(("strength", "field_strength"), "flinders.Site, as strength"),
    **dict.fromkeys(("dip", "dip_deg", "inclination_deg"), "flinders.Site, as inclination_deg"),
    "prior": "flinders.estimators.Likelihood and its like",
}
"""Parameters of other functions and values, and of which."""

LOOKED_AT: Final = 5_000
"""Readings of a longer recording that are looked at for a change in time."""

ONE_A_REST: Final = frozenset({"auto", "consistent", "ellipse", "level", "likelihood", "robust"})
"""Methods that count a rest as one reading or none; published recipes count each."""

LEANING: Final = 10.0
"""Times the heading error claimed of a level turn: a fit with aiding sensors that claims more saw no lean. Of drives of
half a minute it claims up to 8 times as much, of level turns more than 100 times; the turn errs by up to 5 times its
claim where the body leans."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a fit is asked for, whatever the method; as the parameters of `fit`."""

    target_deg: float = 1.0
    dip_deg: float = ASSUMED_DIP_DEG
    dip_assumed: bool = False
    field_strength: float | None = None  # length of corrected readings, whatever the readings say
    alignment_sigma_deg: float | None = None
    site: Site | None = None  # what counts in the fit, of the site
    prior: float | None = SPREAD
    instruments: Instruments | None = None

    @classmethod
    def of(cls, site: Site | None = None, **others: Any) -> Self:
        """Ask by the site: with its dip, else an assumed one, its strength and its mounting."""
        judged_deg, is_assumed = judged_dip(site)
        of_site: dict[str, Any] = {"dip_deg": judged_deg, "dip_assumed": is_assumed}
        if site is not None:
            of_site |= {"field_strength": site.fixed_length, "alignment_sigma_deg": site.alignment_sigma_deg}
            of_site["site"] = site.evidence
        return cls(**of_site, **others)

    def __post_init__(self) -> None:
        """Check the target."""
        if not self.target_deg > 0.0:
            raise UsageError(f"target is {self.target_deg:g}°: need a positive angle")

    @property
    def likelihood(self) -> Auto:
        """The estimator that claims of others are compared with."""
        return Auto(self.prior, dip_deg=self.dip_deg)


def judged_dip(site: Site | None) -> tuple[float, bool]:
    """Dip that headings are judged at, and whether it is assumed: that of the site, else 60°.

    >>> from flinders.likelihood.site_field import Site
    >>> judged_dip(Site(inclination_deg=-66.0)), judged_dip(None)
    ((-66.0, False), (60.0, True))
    """
    known = None if site is None else site.inclination_deg
    if known is not None:
        require_headings(known)
    return (ASSUMED_DIP_DEG, True) if known is None else (known, False)


class _Frame(NamedTuple):
    """Unit, axes and frame that readings are in."""

    unit: Unit | None
    axes: Axes | None
    name: str = "sensor"

    @classmethod
    def of(cls, source: object, unit: Unit | None = None, axes: Axes | None = None) -> Self:
        """Those of a recording, which knows them; else those that are given.

        Raises
        ------
        UsageError
            Where others are given for a recording: that would not convert it.
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


class _Estimated(NamedTuple):
    """An estimate with what is known of the readings that it was made of.

    Attributes
    ----------
    estimate : Estimate
    readings : Readings
    statistics : Statistics
    coverage : Coverage
    record : Records, optional
        Of the engine, where the other attributes were taken from it.
    disturbed : DisturbanceFit, optional
        The disturbances that the readings were compensated for.
    aiding : Aiding, optional
    is_joint : bool
        The estimate is of the magnetometer and its aiding sensors.
    refreshed : Refreshed, optional
        The shape is that of an earlier calibration.
    linearized : AxisTerms, optional
        What was taken off the readings, of axes that are not linear.
    """

    estimate: Estimate
    readings: Readings
    statistics: Statistics
    coverage: Coverage
    record: Records | None = None
    disturbed: DisturbanceFit | None = None
    aiding: Aiding | None = None
    is_joint: bool = False
    refreshed: Refreshed | None = None
    linearized: AxisTerms | None = None

    @classmethod
    def of(cls, estimate: Estimate, readings: Readings, aiding: Aiding | None = None) -> Self:
        """Take it from the summary of the readings."""
        summary = readings.summary
        coverage = Coverage.through(summary.cloud, estimate.ellipsoid, within=estimate.rejected_beyond)
        statistics = replace(readings.statistics, doubt=_doubt(readings))
        return cls(estimate, readings, statistics, coverage, aiding=aiding)

    @classmethod
    def of_record(
        cls, estimator: Estimator, readings: Readings, unit: Unit | None, *, has_sigma: bool = False
    ) -> Self | None:
        """Take it from the engine's record of one recording in memory; None where a record does not tell enough.

        It says how well terms of the axes are known if `has_sigma`.
        """
        samples = readings.recording
        if not isinstance(estimator, Auto) or not isinstance(samples, Samples) or readings.parts:
            return None
        record = estimator.recorded(readings, statistics=2 if has_sigma else 1)
        if record["status"] or record["hides_plane"]:
            return None
        if record["plane"] and samples.acceleration is not None:  # it may show a slope, and the claim widens
            return None
        if record["plane"] and not record["rails"]:
            _moved(readings, estimator, unit)
        elif not was_turned(record, (unit or UNSTATED).inside):
            return None
        if record["rests"]:
            readings = readings.fitted()
        estimate = estimated(record, readings, has_statistics=True)
        statistics = Statistics.of_record(record, samples.time, readings.summary.skipped)
        if (rests := readings.rests) is not None:
            statistics = replace(statistics, rest_spans=rests.spans, are_rests_left_out=rests.are_left_out)
        statistics = replace(statistics, doubt=_doubt(readings))
        coverage = RecordCoverage(record, readings.summary, estimate.ellipsoid, estimate.rejected_beyond)
        return cls(estimate, readings, statistics, coverage, record)


def _doubt(readings: Readings) -> str:
    """What readings look like, if not like a magnetometer's; of a long recording by its first block."""
    recording = readings.recording
    first = recording if recording is None or isinstance(recording, Samples) else next(iter(recording.blocks()), None)
    if first is None or not first.nameless:
        return ""
    from flinders.readers._likeness import doubt

    return doubt(first)


@spell_checked(ELSEWHERE)
def fit(
    source: AnyReadings,
    *,
    method: str | Estimator = "auto",
    target_deg: float = 1.0,
    site: Site | None = None,
    unit: str | Unit | None = None,
    axes: str | Axes | None = None,
    sensor: str | None = None,
    disturbances: Sequence[str] = (),
    aiding: AnyAiding = (),
    linearize: bool = False,
) -> Fit:
    """Find the calibration, and say how far to trust it.

    Parameters
    ----------
    source : Samples, Recording, Summary, (N, 3) array-like, path, open file or data frame
        Readings; what `flinders.read` reads is read, with columns chosen by their names. A `Summary` is enough for the
        methods that need only sums; ``auto`` then is ``consistent``.
    method : str or Estimator
        A name of `flinders.estimators.METHODS`; or a method with its options, such as
        ``flinders.estimators.Likelihood(prior=None)``. What it takes of the site comes from `site`.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    site : Site, optional
        What is known of the field at the place, and of the mounting. Corrected readings have its strength as their
        length: without it the matrix has determinant 1 and the length is the radius that results. Headings are judged
        at its inclination, else at 60° (`Claim.dip_assumed`). What it states with an uncertainty counts in the fit.
    unit : str or Unit, optional
        What an array or a file is in, as `flinders.read` takes it: ``"uT"``, ``"mG"``; a recording brings its own.
    axes : str or Axes, optional
        Where each axis comes from, such as ``"x,-y,-z"``; a recording brings its own. A Summary was made in its axes
        and in the unit that `unit` is inside.
    sensor : str, optional
        Name or serial number, kept with the calibration; of a log, which magnetometer, by number or name.
    disturbances : sequence of str
        What the offset shall follow: ``current``, ``throttle``, ``temperature``, of columns that the recording has;
        ``currents`` and ``throttles`` of each motor by itself, or one by one, as ``current1``.
    aiding : str, sequence of str or Instruments
        What else was recorded and shall count: ``rate``, ``dip``, ``tilt``, ``attitude``; or ``auto`` for what earns
        its place, disturbances included. `Instruments` says what their errors may be. See docs/terms.md.
    linearize : bool
        Correct axes that are not linear, where chance hardly explains them and the claim becomes smaller
        (`Calibration.linearization`): C and Python hold such a calibration, other targets do not. For one recording in
        memory by ``auto``, without aids and disturbances.

    Raises
    ------
    FitError
        If the readings give no ellipsoid; `Refused` carries the fit where there is one that cannot be trusted.
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
    """
    request = Request.of(site, target_deg=target_deg, instruments=Instruments.of(aiding) if aiding else None)
    estimator = estimator_of(method, request)
    request = replace(request, prior=getattr(estimator, "prior", SPREAD))
    _refuse_combinations(estimator, request, disturbances, linearize=linearize)
    unit = Unit.of(unit) if isinstance(unit, str) else unit
    axes = Axes.of(axes) if isinstance(axes, str) else axes
    source, sensor = recording_of(source, unit, axes, sensor)
    source, disturbed, tried = _compensated(source, disturbances, request)
    frame = _Frame.of(source, unit, axes)
    found = _estimated(Readings.of(source), estimator, request, frame.unit)
    if disturbed is not None:
        found = found._replace(disturbed=disturbed)
    if linearize:
        found = _linearized(found, estimator, request, frame.unit)
    if found.aiding is not None:
        found = found._replace(aiding=replace(found.aiding, sensors=(*tried, *found.aiding.sensors)))
    widened = _claimed(found, estimator, request)
    calibration = _turned(_calibration(widened.estimate, request, frame, sensor), found.aiding)
    if found.linearized is not None:
        calibration = replace(calibration, linearization=found.linearized.linearization)
    return _accepted(mounted(_judged(widened, found, calibration, request), request.alignment_sigma_deg))


def _refuse_combinations(
    estimator: Estimator, request: Request, disturbances: Sequence[str], *, linearize: bool
) -> None:
    """Refuse aids and linearized axes with a method that has no place for them."""
    if request.instruments and not (isinstance(estimator, Auto) and not estimator.robust):
        raise UsageError("aids go with the method auto and its prior alone: leave other methods and options out")
    if linearize and (request.instruments or disturbances or not isinstance(estimator, Auto)):
        raise UsageError(
            "linearized axes go with the method auto alone: leave aids, disturbances and other methods out",
            hint={"linearize": True},
        )


class _Compensated(NamedTuple):
    """Readings less their disturbances, those disturbances, and what there is to say of each column."""

    source: Recording | Summary
    disturbed: DisturbanceFit | None = None
    tried: tuple[AidingSensor, ...] = ()


def _compensated(source: Recording | Summary, disturbances: Sequence[str], request: Request) -> _Compensated:
    """Compensate readings for disturbances: those that are named, else with all aiding sensors those that help."""
    tried: tuple[AidingSensor, ...] = ()
    if (
        request.instruments
        and request.instruments.asked == AUTO
        and not disturbances
        and not isinstance(source, Summary)
    ):
        from flinders.fitting.disturbance_selection import earned

        disturbances, tried = earned(source, spread=request.prior, dip_deg=request.dip_deg)
    if not disturbances:
        return _Compensated(source, tried=tried)
    from flinders.estimators.disturbance import with_disturbances

    disturbed, recording = with_disturbances(source, disturbances, spread=request.prior)
    return _Compensated(recording, disturbed, tried)


def _estimated(readings: Readings, estimator: Estimator, request: Request, unit: Unit | None) -> _Estimated:
    """Estimate by the engine's record where it is enough, else by aiding sensors or the method, and the site."""
    if not request.instruments and not request.site:
        recorded = _Estimated.of_record(estimator, readings, unit)
        if recorded is not None:
            return recorded
    readings = within_range(_moved(readings, estimator, unit))
    if estimator.name in ONE_A_REST:
        readings = readings.fitted()
    joint, aiding = _aided(readings.as_read, request)
    if joint is not None:
        return _Estimated.of(joint, readings, aiding)._replace(is_joint=True)
    from flinders.estimators.one_strength import at_one_strength

    estimate = _at_site(estimator.estimate(readings), readings, request)
    return _Estimated.of(estimate, at_one_strength(readings, estimate), aiding)


def _linearized(plain: _Estimated, estimator: Estimator, request: Request, unit: Unit | None) -> _Estimated:
    """Evidence of linear readings, where axes are hardly linear and a smaller claim is left; else as it was.

    Raises
    ------
    UsageError
        For several recordings, sums alone, or a site.
    """
    if request.site is not None or plain.readings.parts or plain.readings.recording is None:
        raise UsageError(
            "axes are linearized by one recording, and by no field of a site, as a log may state one: calibrate "
            "recordings one by one, and leave the site out",
            hint={"linearize": True},
        )
    curved, lag = _faults_of_axes(plain.estimate, plain)
    recording = plain.readings.as_read.recording
    if plain.record is None or not isinstance(recording, Samples) or curved is None or not curved.is_likely:
        return plain
    if lag is not None and lag.is_proven and lag.p_value < curved.p_value:  # looks a little like curves
        return plain
    from flinders.fitting.linearization import ROUNDS, AxisTerms

    terms, found = AxisTerms.of(curved, plain.estimate.ellipsoid), plain
    for _ in range(ROUNDS):
        linear = Readings.of(replace(recording, field=terms.linear(recording.field)))
        fitted = _Estimated.of_record(estimator, linear, unit, has_sigma=True)
        if fitted is None or fitted.record is None:
            return plain
        left = nonlinearity_in(fitted.record)
        found, before, terms = fitted, terms, terms.refined(left, fitted.estimate.ellipsoid)
        if terms.is_close(before):
            break
    linearized = found._replace(linearized=terms)
    return linearized if _expected_deg(linearized) < _expected_deg(plain) else plain


def _expected_deg(found: _Estimated) -> float:
    """Worst level heading error by the engine's record, with what belongs to the direction."""
    assert found.record is not None
    record = found.record.copy()
    record["is_claimed"] = True  # each by its own covariance: few readings widen both alike
    _add_faults(record, found.estimate, found)
    return float(engine().judge(record, engine().request(shrinks=0))["worst_deg"])


def _claimed(found: _Estimated, estimator: Estimator, request: Request) -> Widened:
    """Widen the covariance of an estimate by what its method does not know of, and by its disturbances.

    An estimate of `auto` by the magnitude alone, with a prior, is shrunk where its readings were corrected before.
    """
    widened = claimed(
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
        widened = widened.widened(found.disturbed.widened(widened.estimate.covariance))
    is_plain = isinstance(estimator, Auto) and not found.is_joint and found.disturbed is None
    engine().claim(widened.record, engine().request(shrinks=is_plain and request.prior is not None))
    return widened.shrunk() if widened.record["is_shrunk"] > 0 else widened


def judged_as(
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
    """Judge an estimate that was made elsewhere, such as by several magnetometers together, as that of a recording.

    Parameters
    ----------
    estimate : Estimate
        Its covariance knows how residuals are correlated.
    source : Recording or Readings
        The readings that it belongs to, for coverage and health; as readings those at no rail.
    aiding_result : Aiding, optional
        With the rotation that corrected readings are turned by.
    site, target_deg, sensor
        As for `fit`.
    dip_assumed : bool
        The dip of the site is a guess.
    refreshed : Refreshed, optional
        Where the shape is that of an earlier calibration.

    Raises
    ------
    Refused
        Where it cannot be trusted; it carries the fit.
    """
    request = Request.of(site, target_deg=target_deg)
    request = replace(request, dip_assumed=dip_assumed or request.dip_assumed)
    readings = source if isinstance(source, Readings) else within_range(Readings.of(source))
    found = _Estimated.of(estimate, readings, aiding_result)._replace(refreshed=refreshed)
    calibration = _turned(_calibration(estimate, request, _Frame.of(readings.recording), sensor), aiding_result)
    widened = claimed(
        estimate,
        found.readings,
        request.likelihood,
        found.statistics,
        coverage=found.coverage,
        is_joint=True,
    )
    return _accepted(mounted(_judged(widened, found, calibration, request), request.alignment_sigma_deg))


def _accepted(result: Fit) -> Fit:
    """The fit, unless its verdict refuses it.

    Raises
    ------
    Refused
        With the fit.
    """
    if any(finding.severity == "refuses" for finding in result.findings):
        raise Refused(result)
    return result


def _moved(readings: Readings, estimator: Estimator, unit: Unit | None) -> Readings:
    """The readings of a sensor that was turned.

    Raises
    ------
    Unmoved
        For any other.
    """
    plane = getattr(estimator, "plane", "xy" if isinstance(estimator, Level) else None)
    how = "through all directions" if plane is None else f"all the way round in the plane {plane}"
    require_moved(readings.summary, (unit or UNSTATED).inside, how)
    return readings


def _turned(calibration: Calibration, aiding_result: Aiding | None) -> Calibration:
    """Turn corrected readings into the axes of the body, where an aiding sensor saw how the sensor sits in them."""
    if aiding_result is None or aiding_result.rotation is None:
        return calibration
    return replace(calibration, matrix=aiding_result.rotation @ calibration.matrix, rotation="estimated")


def mounted(result: Fit, sigma_deg: float | None) -> Fit:
    """Add the heading error of a mounting of stated uncertainty, where it is stated."""
    if sigma_deg is None:
        return result
    error = alignment_error_deg(sigma_deg, dip_deg=result.heading_error_deg.dip_deg)
    return replace(result, claim=replace(result.claim, alignment_error_deg=error))


def estimator_of(method: str | Estimator, request: Request) -> Estimator:
    """Look a method up, if it is a name, and give it what it asks for of the site.

    Raises
    ------
    UsageError
        For a name that does not exist, what is no method, and a dip or strength other than that of the site.
    """
    given: Any = method_of(method)() if isinstance(method, str) else method
    if not hasattr(given, "estimate") or isinstance(given, type):
        raise UsageError(f"method is {method!r}: need a name, or a method of flinders.estimators with its options")
    options = getattr(given, "__dataclass_fields__", {})
    of_site = {name: getattr(request, name) for name in OF_SITE if name in options}
    for name, known in of_site.items():
        if (own := getattr(given, name)) not in (known, options[name].default):
            raise UsageError(f"{given.name} is given {own:g} by itself: state it by the site", hint={"site": None})
    return cast("Estimator", replace(given, **of_site) if of_site else given)


def _aided(readings: Readings, request: Request) -> tuple[Estimate | None, Aiding | None]:
    """Fit with aiding sensors; no estimate where none was asked for, or none was used.

    Raises
    ------
    UsageError
        Where only sums are left.
    """
    if not request.instruments:
        return None, None
    asked = request.instruments.asked
    if readings.recording is None:
        raise UsageError("aids need what was recorded beside the readings: give the recording, not its summary")
    samples = in_memory(readings.recording)
    is_thin = len(samples) >= Level.unknowns and turned_level(samples.field)
    turn = _level_turn(readings, request) if is_thin else None
    if turn is not None and _is_white(turn):
        return None, _of_no_use(samples, asked)
    from flinders.fitting.aid_selection import aided_by

    aided, result = aided_by(
        samples,
        asked,
        site=request.site,
        dip_deg=request.dip_deg,
        spread=request.prior or SPREAD,
        **cast("dict[str, Any]", request.instruments.sigmas),
    )
    estimate = aided.estimate() if aided.aiding else None
    if is_thin or is_flat(readings.summary.moments.principal_variances, aided.noise):
        turn = turn or _level_turn(readings, request)
        if turn is None or estimate is None or _is_level(turn, estimate, request.dip_deg):
            return None, _of_no_use(samples, asked)
    return estimate, result


def _level_turn(readings: Readings, request: Request) -> Estimate | None:
    """What readings in one plane are as a level turn; None where they are none."""
    try:
        estimate = request.likelihood.estimate(readings)
    except FitError:
        return None
    return estimate if estimate.plane else None


def _is_white(estimate: Estimate) -> bool:
    """Residuals are not correlated."""
    return estimate.correlation is None or estimate.correlation.is_white


def _is_level(turn: Estimate, aided: Estimate, dip_deg: float) -> bool:
    """Whether the body stayed level: residuals of the turn are white, or a fit with aiding sensors knows far less.

    A body that leans moves the readings within the plane as well: they leave the ellipse, for as long as it leans.
    """
    worst = level_error(turn.ellipsoid, turn.covariance, dip_deg=dip_deg, down=down_of(turn.plane)).worst
    return _is_white(turn) or level_error(aided.ellipsoid, aided.covariance, dip_deg=dip_deg).worst > LEANING * worst


def _of_no_use(samples: Samples, aiding: str | Sequence[str]) -> Aiding:
    """Say of each aiding sensor that a level turn leaves it nothing to tell.

    Raises
    ------
    UsageError
        For one that is not known or was not recorded.
    """
    from flinders.estimators.aiding import refuse_without
    from flinders.fitting.aid_selection import available

    names = available(samples) if aiding == AUTO else (aiding,) if isinstance(aiding, str) else tuple(aiding)
    refuse_without(samples, names)
    words = "the readings lie in one plane, as in a level turn, across which it tells nothing"
    return Aiding(tuple(AidingSensor(name, is_used=False, reason=words) for name in names))


def _at_site(estimate: Estimate, readings: Readings, request: Request) -> Estimate:
    """Use the field of the site."""
    if estimate.bias is not None or readings.recording is None:
        return estimate
    from flinders.estimators.known_dip import sited

    mounting = {"alignment_sigma_deg": request.alignment_sigma_deg}
    return sited(estimate, readings, request.site, dip_deg=request.dip_deg, **mounting)


def _calibration(estimate: Estimate, request: Request, frame: _Frame, sensor: str | None) -> Calibration:
    """The correction that makes a sphere of the ellipsoid; a strength that follows the readings is as good as given."""
    given, site = request.field_strength, request.site
    if given is None and site is not None and estimate.strength == site.strength:
        given = site.strength
    calibration = Calibration.from_ellipsoid(
        estimate.ellipsoid.centre,
        estimate.ellipsoid.shape,
        field_strength=estimate.strength if given is None else given,
        raw=frame.unit or UNSTATED,
        axes=frame.axes or AS_RECORDED,
        sensor=sensor,
        frame=frame.name,
    )
    is_known = given is not None or bool(estimate.follows)
    if calibration.field_strength_known == is_known:
        return calibration
    return replace(calibration, field_strength_known=is_known)


def _drift(estimate: Estimate, found: _Estimated, dip_deg: float) -> Drift | None:
    """Whether something changed while one recording was made: if so, its residuals are not white.

    What a model is too simple for looks like a change, too, and is stated as a bias.
    """
    readings = found.readings
    if found.record is not None and not estimate.outliers:
        return drift_in(found.record)
    if readings.recording is None or readings.parts or estimate.unobserved or estimate.bias is not None:
        return None
    if found.refreshed is not None:  # a wobble of seconds tells no change from noise that lasts
        return None
    if estimate.correlation is None or estimate.correlation.is_white:
        return None
    near = readings.near(estimate.ellipsoid, estimate.rejected_beyond)
    return drift_of(near.thinned(LOOKED_AT), estimate.ellipsoid, dip_deg=dip_deg)


def _with_halves(drift: Drift, estimate: Estimate, readings: Readings, request: Request) -> Drift:
    """Compare the halves of a recording in memory."""
    samples = readings.as_read.recording
    if not isinstance(samples, Samples):
        return drift
    return replace(drift, halves_ratio=halves_apart(samples, request.likelihood, estimate))


def _faults_of_axes(estimate: Estimate, found: _Estimated) -> tuple[Nonlinearity | None, AxisLag | None]:
    """Whether axes answer along a curve, or late, by an ellipsoid that was fitted to readings that nothing drives."""
    if found.record is None or found.disturbed or estimate.plane or estimate.unobserved:
        return None, None
    if estimate.bias is not None:
        return None, None
    terms, lag = found.linearized, lag_in(found.record)
    return nonlinearity_in(found.record) if terms is None else terms.corrected(found.record), lag


def _add_faults(record: Records, estimate: Estimate, found: _Estimated) -> tuple[Nonlinearity | None, AxisLag | None]:
    """Put faults of axes into a record, and what is left of those that are corrected."""
    nonlinearity, lag = faults = _faults_of_axes(estimate, found)
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
    """Whether axes were swapped while one recording in memory was made."""
    samples = readings.as_read.recording
    if readings.parts or not isinstance(samples, Samples):
        return None
    from flinders.diagnostics.axis_swap import axis_swap_of

    return axis_swap_of(samples.field, estimate.noise)


def _unmodelled(estimate: Estimate, found: _Estimated, dip_deg: float) -> Unmodelled | None:
    """Test whether a recorded disturbance moves the readings of one recording in memory while none is modelled."""
    samples = found.readings.recording
    if estimate.unobserved or found.disturbed or not isinstance(samples, Samples) or not samples.disturbances:
        return None
    from flinders.diagnostics.unmodelled import unmodelled_of

    time = 1.0 if estimate.correlation is None else estimate.correlation.time
    return unmodelled_of(samples, estimate.ellipsoid, dip_deg=dip_deg, time=time, limit=estimate.rejected_beyond)


def _attitude_dependence(estimate: Estimate, found: _Estimated, dip_deg: float) -> AttitudeDependence | None:
    """Test whether something moves the readings of one recording in memory with the attitude: no white residuals."""
    samples, correlation = found.readings.recording, estimate.correlation
    if estimate.plane or estimate.unobserved or (correlation is not None and correlation.is_white):
        return None
    if not isinstance(samples, Samples) or samples.acceleration is None:
        return None
    from flinders.diagnostics.attitude_dependence import attitude_dependence_of

    return attitude_dependence_of(samples, estimate.ellipsoid, dip_deg=dip_deg, limit=estimate.rejected_beyond)


def _tilt_error_deg(estimate: Estimate, calibration: Calibration, found: _Estimated) -> float:
    """What the vertical of the accelerometer adds to a heading; NaN in a plane, and where a fit corrects it."""
    samples, aiding = found.readings.as_read.recording, found.aiding
    if estimate.plane or not isinstance(samples, Samples) or samples.acceleration is None:
        return math.nan
    from flinders.diagnostics.instruments import UPRIGHT, vertical_error_deg

    if aiding is not None and any(sensor.is_used and sensor.name in UPRIGHT for sensor in aiding.sensors):
        return math.nan
    return vertical_error_deg(samples.field, samples.acceleration, calibration, estimate)


def _bias_deg(estimate: Estimate, dip_deg: float) -> float:
    """Heading error (rms) that the bias of a method makes."""
    if estimate.bias is None:
        return 0.0
    bias, down = np.outer(estimate.bias, estimate.bias), down_of(estimate.plane)
    return level_error(estimate.ellipsoid, bias, dip_deg=dip_deg, down=down).rms


def _judged(widened: Widened, found: _Estimated, calibration: Calibration, request: Request) -> Fit:
    """Put together what is known and judge it."""
    record = widened.record
    estimate = found.estimate if record["is_shrunk"] > 0 else widened.estimate
    diagnosis = _diagnosis(widened, estimate, found, calibration)
    diagnosis, judgement = _judgement(diagnosis, record, estimate, found, calibration, request)
    if found.disturbed is not None:
        calibration = replace(calibration, disturbances=found.disturbed.disturbances)
    claim = _claim(widened, judgement, calibration, request)
    evidence = Evidence(
        method=estimate.method,
        samples=int(record["used"]),
        noise=estimate.noise,
        coverage=found.coverage,
        outliers=estimate.outliers,
        residuals=_residuals(record, estimate, judgement),
        prior_influence=estimate.prior_influence,
        unobserved=estimate.unobserved,
        z_down=estimate.z_down,
        diagnosis=diagnosis,
        disturbances=_disturbances(claim, found.disturbed),
        aiding=found.aiding,
    )
    return with_findings(Fit(calibration, evidence, claim, Judgement()), judgement, found.statistics)


def _claim(widened: Widened, judgement: Records, calibration: Calibration, request: Request) -> Claim:
    """What is claimed of a calibration by a record and its judgement."""
    record, estimate = widened.record, widened.estimate
    alignment_deg = float(record["alignment_deg"])
    return Claim(
        calibration,
        estimate.covariance,
        estimate.textbook,
        HeadingError(float(judgement["rms_deg"]), float(judgement["worst_deg"]), float(record["dip_deg"])),
        structure_deg=float(judgement["structure_deg"]),
        dip_deg=request.dip_deg,
        dip_assumed=request.dip_assumed,
        target_deg=request.target_deg,
        alignment_error_deg=None if math.isnan(alignment_deg) else alignment_deg,
        bias_deg=float(record["bias_deg"]),
        is_shrunk=bool(record["is_shrunk"] > 0),
        plane=estimate.plane,
    )


def _residuals(record: Records, estimate: Estimate, judgement: Records) -> Residuals:
    """What the residuals of an estimate tell."""
    distortion = 0.0 if estimate.plane or math.isnan(record["distortion"]) else float(record["distortion"])
    if estimate.correlation is None:
        return Residuals(distortion=distortion)
    return Residuals(judged_quantities(judgement)["independent"], estimate.correlation.lag_one, distortion)


def _diagnosis(widened: Widened, estimate: Estimate, found: _Estimated, calibration: Calibration) -> Diagnosis:
    """Find out what follows from more than the surface and its residuals, and put it into the record."""
    dip_deg = float(widened.record["dip_deg"])
    nonlinearity, axis_lag = _add_faults(widened.record, estimate, found)
    return Diagnosis(
        drift=_drift(estimate, found, dip_deg),
        nonlinearity=nonlinearity,
        axis_lag=axis_lag,
        unmodelled=_unmodelled(estimate, found, dip_deg),
        attitude_dependence=_attitude_dependence(estimate, found, dip_deg),
        repeats=widened.repeats,
        refreshed=found.refreshed,
        tilt_error_deg=_tilt_error_deg(widened.estimate, calibration, found),
    )


def _judgement(
    diagnosis: Diagnosis,
    record: Records,
    estimate: Estimate,
    found: _Estimated,
    calibration: Calibration,
    request: Request,
) -> tuple[Diagnosis, Records]:
    """Judge a record with what diagnostics found, and once more where that asks for a closer look."""
    asked = request_of(calibration, target_deg=request.target_deg)
    aiding, dip_deg = found.aiding, float(record["dip_deg"])
    alignment_deg = None if aiding is None else aiding.alignment_error_deg(dip_deg)
    record["alignment_deg"] = math.nan if alignment_deg is None else alignment_deg
    record["bias_deg"] = _bias_deg(estimate, dip_deg)
    record["sources"] = sources_of(
        aiding,
        is_aided=estimate.is_aided,
        is_compensated=found.disturbed is not None,
        is_refreshed=found.refreshed is not None,
    )
    if found.record is not None:
        add_reading(record, found.statistics)
        record["farthest"] = farthest(estimate.outliers)
    add_diagnosis(record, diagnosis)
    judgement = engine().judge(record, asked)
    closer = _looked_closer(int(judgement["asks"]), diagnosis, estimate, found, request)
    if closer is diagnosis:
        return diagnosis, judgement
    add_diagnosis(record, closer)
    return closer, engine().judge(record, asked)


def _looked_closer(
    asks: int, diagnosis: Diagnosis, estimate: Estimate, found: _Estimated, request: Request
) -> Diagnosis:
    """Find out what a judgement asks for."""
    if asks & ASKS_HALVES and diagnosis.drift is not None:
        drift = _with_halves(diagnosis.drift, estimate, found.readings, request)
        diagnosis = replace(diagnosis, drift=drift)
    if asks & ASKS_SWAP:
        diagnosis = replace(diagnosis, axis_swap=_axis_swap(estimate, found.readings))
    return diagnosis


def _disturbances(claim: Claim, disturbed: DisturbanceFit | None) -> Disturbances:
    """What is known of the disturbances of a calibration, by readings that were compensated for them."""
    if disturbed is None:
        return Disturbances()
    from flinders.estimators.regressors import DisturbanceEstimate

    dip, down, ellipsoid = claim.heading_error_deg.dip_deg, down_of(claim.plane), claim.ellipsoid
    estimates = [
        replace(
            estimate,
            removed_deg=claim.calibration.disturbance_deg(disturbance, dip_deg=dip),
            remaining_deg=disturbed.remaining_error(ellipsoid, place, dip_deg=dip, down=down).worst,
        )
        for place, (disturbance, estimate) in enumerate(zip(disturbed.disturbances, disturbed.estimates, strict=True))
    ]
    constant = [DisturbanceEstimate(name) for name in disturbed.constant]
    return Disturbances((*estimates, *constant), disturbed.joint(claim.covariance), disturbed.noise_without)
