"""Renewal of a calibration: the soft iron is that of an earlier calibration, the hard iron is from a short recording.

A new battery, load or camera on a vehicle mostly changes the hard iron. Soft iron and gains stay, and are known from
the earlier calibration with their uncertainty. The prior of the shape S of the ellipsoid is therefore

    S ~ N(f S₀, f² C₀ + σ² S₀ S₀ᵀ)

with the claimed covariance C₀ of the earlier calibration, the relative uncertainty σ of the field strength, and the
ratio f of both strengths if a site states it, else 1. The offset is free. The engine finds the maximum of the posterior
(``refresh.c``); with aiding sensors `flinders.estimators.aiding` continues from there. If the readings contradict the
shape, they are fitted again with a prior that allows a change, and the verdict is limited.

A short recording within 30° seldom shows a change of the soft iron by 1 %, which causes a heading error of 1°
(``python -m benchmarks.refresh``). Therefore a good verdict has the condition that the soft iron is the same.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> earlier = calibrate.fit(tumble.samples)
>>> moved = replace(tumble.sensor, offset=tumble.sensor.offset + [8.0, -5.0, 3.0])
>>> wobble = simulate.tumble(seed=2, motion="wobble", sensor=moved)
>>> fresh = refresh(wobble.samples, earlier)
>>> fresh.verdict, bool(np.all(np.abs(fresh.calibration.offset - moved.offset) < 4.0 * fresh.claim.offset_sigma))
('good', True)
>>> fresh.evidence.diagnosis.refreshed.offset_change.round(), fresh.judgement.conditions[0]
(array([ 8., -5.,  3.]), 'same-soft-iron')
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np

from flinders.core.joining import read_into_memory
from flinders.core.keywords import check_keywords
from flinders.core.samples import Samples, frame_of
from flinders.diagnostics.soft_iron import Refreshed
from flinders.errors import AxesError, OutOfScale, TooFewSamples, UnitError, Unmoved, UsageError
from flinders.estimators import Readings, remove_saturated
from flinders.estimators.data import recording_of
from flinders.estimators.likelihood import estimate_from_record
from flinders.findings import limit_of
from flinders.fitting.aid_selection import fit_with_aids
from flinders.fitting.aiding import Instruments
from flinders.fitting.calibrate import PARAMETERS_ELSEWHERE, judge_estimate
from flinders.fitting.request import judged_dip
from flinders.fitting.result import with_calibration
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.heading.error_propagation import raw_error
from flinders.likelihood.prior import KnownShape
from flinders.likelihood.site_field import Site
from flinders.native.engine import engine
from flinders.native.layouts import enum_value
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.estimators import Estimate
    from flinders.fitting.aiding import Aiding, AnyAiding
    from flinders.fitting.calibrate import AnyReadings
    from flinders.fitting.result import Fit
    from flinders.native.layouts import Records

METHOD: Final = "refresh"

TOO_FEW, OUT_OF_SCALE, UNMOVED = (enum_value(name) for name in ("TOO_FEW", "OUT_OF_SCALE", "UNMOVED"))
"""Statuses of the engine."""

MIN_READINGS: Final = 20
"""Smallest count of readings, as in ``refresh.c``."""

MIN_DISTINCT_READINGS: Final = 10
"""Smallest count of distinct readings, as in ``record.h``."""

MOTION_WORDS: Final = "by 30° to all sides"
"""Required motion of the sensor, in words."""

UNFIT_REASONS: Final = {
    "none": "there is no earlier calibration to renew: choose its file first",
    "refused": "{name} was refused when it was made: calibrate again, from a full tumble",
    "level": "{name} comes from a level turn, which does not give the soft iron: repeat the level turn and calibrate",
    "disturbed": "{name} depends on {disturbances}, a refreshed offset does not: calibrate again with {disturbances}",
    "linearized": "{name} linearizes its axes about its own offset: calibrate again, from a full tumble",
}
"""Reasons why an earlier calibration cannot be renewed, in words, also for the live page."""

OTHER_UNIT: Final = "{source} is in {unit}, {name} is for readings in {other}: record in the unit of that calibration"
"""Message if the unit of the readings differs from that of the earlier calibration."""
OTHER_AXES: Final = "{source} has axes {axes}, {name} has {other}: read it with the axes of the calibration"
"""Message if the axes of the readings differ from those of the earlier calibration."""


@check_keywords(PARAMETERS_ELSEWHERE)
def refresh(
    source: AnyReadings,
    previous: Fit,
    *,
    aiding: AnyAiding = (),
    site: Site | None = None,
    soft_iron_sigma: float = 0.0,
    target_deg: float = 1.0,
) -> Fit:
    """Renew the hard iron of a calibration from a short recording, such as 10 s of wobbling by 30°.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Readings in the unit and axes of `previous`, or a source for `flinders.read`.
    previous : Fit
        The earlier calibration of this sensor, fitted or loaded from its file. If it states no covariance, its shape is
        assumed to be known to 2 %, 1 σ (`SHAPE_SIGMA`).
    aiding : str, sequence of str or Instruments
        Names of other recorded sensors to use, as for `flinders.fit`.
    site : Site, optional
        Known field at the place. If it states a strength, corrected readings have that length; if not, the strength of
        the earlier calibration is assumed, to 1 % (`STRENGTH_SIGMA`). Headings are judged at its inclination, else at
        that of `previous`.
    soft_iron_sigma : float
        Possible change of the soft iron since then, 1 σ, as a share of the radius; 0 for none.
    target_deg : float
        Worst heading error that is good enough, in degrees.

    Returns
    -------
    Fit
        The new fit; `Diagnosis.refreshed` states the changes since `previous`.

    Raises
    ------
    FitError
        If the readings give no ellipsoid; `Refused`, which has the fit, if the fit cannot be trusted.
    UsageError
        For an earlier calibration that cannot be renewed, or numbers out of range; its subclasses `UnitError` and
        `AxesError` for a recording with another unit or other axes.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> tumble = simulate.tumble(seed=1)
    >>> wobble = simulate.tumble(seed=2, motion="wobble", sensor=tumble.sensor)
    >>> refresh(wobble.samples, calibrate.fit(tumble.samples)).verdict
    'good'
    """
    if not 0.0 <= soft_iron_sigma <= 0.5:
        raise UsageError(f"soft iron sigma is {soft_iron_sigma:g}: need a share from 0 to 0.5, such as 0.005")
    refuse_unfit(previous)
    samples = samples_of(source, previous)
    dip_deg, is_unknown = judged_dip(site)
    dip_deg = previous.claim.dip_deg if is_unknown else dip_deg
    here = replace(
        Site() if site is None else site.for_judgement,
        strength=strength_of(previous.calibration, site),
        inclination_deg=dip_deg,
    )
    earlier = earlier_record(previous, site, soft_iron_sigma=soft_iron_sigma)
    found = _solve(remove_saturated(Readings.of(samples)), earlier, dip_deg)
    if aiding:
        of_site = None if site is None else replace(site, strength=None).evidence
        found = _solve_aided(samples, found, earlier, Instruments.of(aiding), site=of_site, dip_deg=dip_deg)
    fit = judge_estimate(
        replace(found.estimate, method=METHOD, is_aided=False),
        found.readings,
        aiding_result=found.aiding,
        site=here,
        target_deg=target_deg,
        sensor=previous.calibration.sensor,
        dip_assumed=is_unknown and previous.claim.dip_assumed,
        refreshed=changes_since(previous, found.estimate.ellipsoid, dip_deg, found.soft_iron_p_value),
    )
    if fit.calibration.rotation == "estimated":
        return fit
    return with_calibration(fit, with_rotation_of(fit.calibration, previous))


def earlier_record(previous: Fit, site: Site | None = None, *, soft_iron_sigma: float = 0.0) -> Records:
    """Row of `EARLIER` for the engine: shape and covariance of an earlier calibration, in the field of a site."""
    calibration, claim = previous.calibration, previous.claim
    strength = strength_of(calibration, site)
    return engine().make_earlier(
        calibration.ellipsoid.centre,
        calibration.ellipsoid.shape,
        claim.covariance if claim.states_uncertainty else None,
        distortion=previous.evidence.residuals.distortion,
        strength_ratio=1.0 if strength is None else strength / calibration.field_strength,
        soft_iron_sigma=soft_iron_sigma,
    )


def known_shape(previous: Fit, site: Site | None = None) -> KnownShape:
    """The shape of an earlier calibration in the field of a site, with its uncertainty.

    >>> from flinders.core.calibration import Calibration
    >>> from flinders.fitting.result import bare_fit
    >>> imported = bare_fit(Calibration.identity(field_strength=50.0))                         # states no uncertainty
    >>> shape = known_shape(imported)
    >>> shape.entries, np.sqrt(np.diag(shape.covariance)).round(2)
    (array([50., 50., 50.,  0.,  0.,  0.]), array([1.12, 1.12, 1.12, 1.  , 1.  , 1.  ]))
    """
    return _known_shape(earlier_record(previous, site))


def _known_shape(earlier: Records) -> KnownShape:
    """The shape and its covariance in a row of `EARLIER`."""
    return KnownShape(earlier["parameters"][3:].copy(), earlier["covariance"].reshape(9, 9)[3:, 3:].copy())


def refuse_unfit(previous: Fit) -> None:
    """Raise `UsageError` for an earlier calibration that cannot be renewed."""
    disturbances = " and ".join(disturbance.name for disturbance in previous.calibration.disturbances)
    unfit = {
        "refused": previous.verdict == "refused",
        "level": previous.claim.plane is not None,
        "disturbed": bool(disturbances),
        "linearized": previous.calibration.linearization is not None,
    }
    for why, is_so in unfit.items():
        if is_so:
            raise UsageError(UNFIT_REASONS[why].format(name=previous.provenance.name, disturbances=disturbances))


def samples_of(source: AnyReadings, previous: Fit) -> Samples:
    """Readings in memory, in the unit and axes of the earlier calibration."""
    calibration = previous.calibration
    recording, _ = recording_of(source, calibration.raw, calibration.axes, calibration.sensor)
    if isinstance(recording, Summary):
        raise UsageError("a refresh needs readings, found a summary: give the recording")
    if recording.unit.inside != calibration.unit:
        names = {"source": recording.source, "unit": recording.unit.name, "other": calibration.raw.name}
        raise UnitError(OTHER_UNIT.format(name=previous.provenance.name, **names))
    ours, theirs = (recording.axes, frame_of(recording)), (calibration.axes, calibration.frame)
    if ours != theirs:
        axes, other = (f"{of} of the {frame}" for of, frame in (ours, theirs))
        raise AxesError(
            OTHER_AXES.format(source=recording.source, axes=axes, name=previous.provenance.name, other=other)
        )
    return read_into_memory(recording)


def strength_of(calibration: Calibration, site: Site | None) -> float | None:
    """Length of corrected readings: strength of the site if known, else of the earlier calibration; None if unknown."""
    if not calibration.field_strength_known:
        return None
    there = None if site is None else site.length or site.strength
    return calibration.field_strength if there is None else there


class _RefreshEstimate(NamedTuple):
    """An estimate with the shape of an earlier calibration, and the p-value of a change of the soft iron."""

    estimate: Estimate
    readings: Readings
    soft_iron_p_value: float
    aiding: Aiding | None = None


def _solve(readings: Readings, earlier: Records, dip_deg: float) -> _RefreshEstimate:
    """Estimate by the magnetometer alone.

    Raises
    ------
    TooFewSamples, Unmoved, OutOfScale, NotAnEllipsoid
    """
    samples = read_into_memory(cast("Recording", readings.recording))
    record = engine().refresh(samples.field, earlier, time=samples.time, dip_deg=dip_deg)
    if record["status"] == TOO_FEW and len(samples) < MIN_READINGS:
        raise TooFewSamples(found=len(samples), needed=MIN_READINGS, method=METHOD)
    if record["status"] == TOO_FEW:
        found = int(record["distinct"])
        raise TooFewSamples(found=found, among=len(samples), needed=MIN_DISTINCT_READINGS, method=METHOD)
    if record["status"] == UNMOVED:
        turn_deg = engine().turn_deg(samples.field, symmetric_matrix(earlier["parameters"][3:]))
        raise Unmoved(turn_deg, MOTION_WORDS)
    if record["status"] == OUT_OF_SCALE:
        raise OutOfScale(readings.summary.moments.unit)
    readings = readings.for_fit()
    return _RefreshEstimate(
        estimate_from_record(record, readings, has_statistics=True), readings, float(record["soft_iron_p_value"])
    )


def _solve_aided(
    samples: Samples, alone: _RefreshEstimate, earlier: Records, aiding: Instruments, **options: Any
) -> _RefreshEstimate:
    """Estimate with aiding sensors, from the estimate `alone` as start; `options` are those of `fit_with_aids`."""
    options |= {"start": alone.estimate.ellipsoid, **aiding.sigmas}
    (same, reported), (changed, reported_freer) = (
        fit_with_aids(samples, aiding.request, shape=_known_shape(each), **options)
        for each in (earlier, engine().allow_change(earlier))
    )
    chance = engine().soft_iron_p_value(
        earlier, changed.parameters.shape, changed.textbook[:9, :9], changed.covariance[:9, :9]
    )
    is_changed = chance < limit_of("soft-iron-changed")
    aided, report = (changed, reported_freer) if is_changed else (same, reported)
    return _RefreshEstimate(aided.estimate(), alone.readings.all_readings, chance, report)


def changes_since(previous: Fit, ellipsoid: Ellipsoid, dip_deg: float, soft_iron_p_value: float = 1.0) -> Refreshed:
    """Changes since an earlier calibration, and the heading error that they cause if that calibration is still used."""
    change = ellipsoid.centre - previous.calibration.offset
    off = Ellipsoid(np.linalg.solve(previous.calibration.ellipsoid.shape, change), np.eye(3))
    worst = raw_error(off, dip_deg=dip_deg).worst
    return Refreshed(previous.provenance.name, change, worst, soft_iron_p_value, previous.evidence.residuals.distortion)


def with_rotation_of(calibration: Calibration, previous: Fit) -> Calibration:
    """The calibration with the rotation of the earlier one, so that corrected readings have the same axes."""
    rotation = previous.calibration.rotation
    return (
        replace(calibration, matrix=previous.calibration.rotation_matrix @ calibration.matrix, rotation=rotation)
        if rotation != "symmetric"
        else calibration
    )
