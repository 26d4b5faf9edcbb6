"""A calibration renewed: the soft iron of an earlier one, the hard iron of some seconds of recording.

What changes on a vehicle is mostly hard iron: a battery, a load, a camera. Soft iron and gains stay, and the earlier
calibration knows them, with their uncertainty. So the shape S of the ellipsoid is expected as it was,

    S ~ N(f S₀, f² C₀ + σ² S₀ S₀ᵀ)

C₀ the covariance that the earlier calibration claims, σ how well the strength of the field is known to be as it was, f
the ratio of both strengths where a site tells that. The offset is free. `flinders.estimators.aiding` finds the maximum
of the posterior over all readings, with what an aiding sensor adds. Where the readings contradict the shape
(`flinders.diagnostics.soft_iron`), it is fitted again with a prior that allows a change, and the verdict is limited.

A few readings within 30° see a change of a hundredth of the soft iron seldom, and it costs a degree of heading
(``python -m benchmarks.refresh``): a good verdict rests on the soft iron being the same, and says so.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> earlier = calibrate.fit(tumble.samples)
>>> moved = replace(tumble.sensor, offset=tumble.sensor.offset + [8.0, -5.0, 3.0])
>>> wobble = simulate.tumble(seed=2, motion="wobble", sensor=moved)
>>> fresh = refresh(wobble.samples, earlier)
>>> fresh.verdict, bool(np.all(np.abs(fresh.calibration.offset - moved.offset) < 4.0 * fresh.claim.offset_sigma))
('good', True)
>>> fresh.evidence.diagnosis.refreshed.offset_change.round(), fresh.conditions[0]
(array([ 8., -5.,  3.]), 'same-soft-iron')
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import Samples, frame_of, in_memory
from flinders.diagnostics.soft_iron import Posterior, Refreshed, by_chance, changeable
from flinders.errors import AxesError, TooFewSamples, UnitError, Unmoved, UsageError, spell_checked
from flinders.estimators.data import recording_of
from flinders.findings import limit_of
from flinders.fitting.aid_selection import aided_by
from flinders.fitting.aiding import Instruments
from flinders.fitting.calibrate import ELSEWHERE, judged_as, judged_dip
from flinders.geometry.ellipsoid import Ellipsoid, symmetric, upper
from flinders.heading.error_propagation import raw_error
from flinders.likelihood.prior import KnownShape
from flinders.likelihood.site_field import Site
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.estimators.aiding import Aided
    from flinders.fitting.aiding import Aiding, AnyAiding
    from flinders.fitting.calibrate import AnyReadings
    from flinders.fitting.result import Fit

METHOD: Final = "refresh"

STRENGTH_SIGMA: Final = 0.01
"""Of the strength of the field: places a hundred kilometres apart, and the ground and buildings at each."""

SHAPE_SIGMA: Final = 0.02
"""Of the radius, each entry of the shape: of a calibration that states no uncertainty."""

FINEST_SHAPE: Final = 1e-4
"""Of the radius: no earlier calibration knows a shape better, not even one whose method holds it."""

ALLOWED_CHANGE: Final = 0.05
"""Of the soft iron, where the readings show that it has changed."""

FEWEST: Final = 20
"""Readings."""

LEAST_TURN_DEG: Final = 5.0
"""From the mean reading: noise of a hundredth of the field reaches 2.3° in a thousand readings."""

RIDGE: Final = 1e-4
"""Of a reading, in square radii: the offset stays where no reading tells of it, as across a level turn."""


@spell_checked(ELSEWHERE)
def refresh(
    source: AnyReadings,
    previous: Fit,
    *,
    aiding: AnyAiding = (),
    site: Site | None = None,
    soft_iron_sigma: float = 0.0,
    target_deg: float = 1.0,
) -> Fit:
    """Renew the hard iron of a calibration from a short recording, such as ten seconds of wobbling by 30°.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Readings in the unit and axes of `previous`; what `flinders.read` reads is read so.
    previous : Fit
        The earlier calibration of this sensor, fitted or loaded from its file. Without a covariance its shape counts
        as known to 2 % (`SHAPE_SIGMA`).
    aiding : str, sequence of str or Instruments
        What else was recorded and shall count, as for `flinders.fit`, each by its name.
    site : Site, optional
        What is known of the field at the place. With its strength, corrected readings have that length; without it,
        the field is as strong as at the earlier calibration to 1 % (`STRENGTH_SIGMA`). Headings are judged at its
        inclination, else at that of `previous`.
    soft_iron_sigma : float
        What the soft iron may have changed by, 1 σ, as a share: 0 for none.
    target_deg : float
        Worst heading error that is good enough, in degrees.

    Returns
    -------
    Fit
        With `Diagnosis.refreshed`.

    Raises
    ------
    FitError
        `Refused` with the fit where it cannot be trusted.
    UsageError
        For an earlier calibration that cannot be renewed, or numbers out of range; its `UnitError` and `AxesError`
        where the recording is not as the calibration is.

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
    _refuse_still(samples.field, previous.calibration.ellipsoid.shape)
    dip_deg, is_unknown = judged_dip(site)
    dip_deg = previous.claim.dip_deg if is_unknown else dip_deg
    here = replace(
        Site() if site is None else site.judged,
        strength=strength_of(previous.calibration, site),
        inclination_deg=dip_deg,
    )
    known = changeable(known_shape(previous, site), soft_iron_sigma)
    aided, reported, chance = _solved(samples, previous, known, Instruments.of(aiding), site, dip_deg)
    fit = judged_as(
        replace(aided.estimate(), method=METHOD, is_aided=False),
        samples,
        aiding_result=reported if aiding else None,
        site=here,
        target_deg=target_deg,
        sensor=previous.calibration.sensor,
        refreshed=refreshed_from(previous, aided.ellipsoid, dip_deg, chance),
    )
    fit = replace(fit, claim=replace(fit.claim, dip_assumed=is_unknown and previous.claim.dip_assumed))
    if fit.calibration.rotation == "estimated":
        return fit
    return fit.with_calibration(turned(fit.calibration, previous))


def known_shape(previous: Fit, site: Site | None = None) -> KnownShape:
    """The shape of an earlier calibration, in the field of a site, and how well it is known.

    >>> from flinders.core.calibration import Calibration
    >>> from flinders.fitting.result import Fit
    >>> imported = Fit.of(Calibration.identity(field_strength=50.0))                           # states no uncertainty
    >>> shape = known_shape(imported)
    >>> shape.entries, np.sqrt(np.diag(shape.covariance)).round(2)
    (array([50., 50., 50.,  0.,  0.,  0.]), array([1.12, 1.12, 1.12, 1.  , 1.  , 1.  ]))
    """
    strength = strength_of(previous.calibration, site)
    factor = 1.0 if strength is None else strength / previous.calibration.field_strength
    entries = factor * upper(previous.calibration.ellipsoid.shape)
    radius = previous.calibration.ellipsoid.radius
    covariance = (
        previous.claim.covariance[3:, 3:]
        if previous.claim.states_uncertainty
        else np.square(SHAPE_SIGMA * radius) * np.eye(6)
    )
    rounding = np.square(FINEST_SHAPE * radius) * np.eye(6)
    size = np.square(STRENGTH_SIGMA) * np.outer(entries, entries)
    return KnownShape(entries, factor**2 * (covariance + rounding) + size)


def started(field: Floats, offset: Floats, shape: Floats) -> Ellipsoid:
    """The ellipsoid of a (3, 3) shape that (N, 3) readings lie on by linear least squares; near an earlier offset.

    With u = S⁻¹(x − b) the centre d and a constant k solve |u|² = 2 uᵀd + k. Across a level turn d stays zero.
    """
    u = np.linalg.solve(shape, (field - offset).T).T
    columns = np.column_stack([2.0 * u, np.ones(len(u))])
    normal = columns.T @ columns + RIDGE * len(u) * np.diag([1.0, 1.0, 1.0, 0.0])
    centre = np.linalg.solve(normal, columns.T @ np.sum(u * u, axis=1))[:3]
    return Ellipsoid(offset + shape @ centre, shape)


def refuse_unfit(previous: Fit) -> None:
    """Refuse an earlier calibration that cannot be renewed."""
    if previous.verdict == "refused":
        raise UsageError(f"{previous.name} was refused when it was made: calibrate again, from a full tumble")
    if previous.claim.plane:
        raise UsageError(f"{previous.name} comes from a level turn, which tells no soft iron: calibrate again as then")
    if previous.calibration.disturbances:
        names = " and ".join(disturbance.name for disturbance in previous.calibration.disturbances)
        raise UsageError(
            f"{previous.name} follows {names}, and a refreshed offset would not: calibrate again with {names}"
        )
    if previous.calibration.linearization is not None:
        raise UsageError(f"{previous.name} linearizes its axes about its offset: calibrate again, from a full tumble")


def _refuse_still(field: Floats, shape: Floats) -> None:
    """Refuse (N, 3) readings of a sensor that was hardly turned."""
    if len(field) < FEWEST:
        raise TooFewSamples(found=len(field), needed=FEWEST, method=METHOD)
    off = np.linalg.solve(shape, (field - field.mean(axis=0)).T)
    turned_deg = math.degrees(float(np.linalg.norm(off, axis=0).max()))
    if not turned_deg > LEAST_TURN_DEG:
        raise Unmoved(turned_deg, "by 30° to all sides")


def samples_of(source: AnyReadings, previous: Fit) -> Samples:
    """The readings, all in memory, in the unit and axes of the earlier calibration."""
    calibration = previous.calibration
    recording, _ = recording_of(source, calibration.raw, calibration.axes, calibration.sensor)
    if isinstance(recording, Summary):
        raise UsageError("a refresh needs readings: give the recording, not its summary")
    if recording.unit.inside != calibration.unit:
        raise UnitError(
            f"{recording.source} is in {recording.unit.name}, {previous.name} is for readings in "
            f"{calibration.raw.name}: record as for that calibration"
        )
    ours, theirs = (recording.axes, frame_of(recording)), (calibration.axes, calibration.frame)
    if ours != theirs:
        raise AxesError(
            f"{recording.source} has axes {ours[0]} of the {ours[1]}, {previous.name} has {theirs[0]} of the "
            f"{theirs[1]}: read it as the recording of the calibration"
        )
    return in_memory(recording)


def strength_of(calibration: Calibration, site: Site | None) -> float | None:
    """Length of corrected readings: that of the site, else as it was; None where it was not known."""
    if not calibration.field_strength_known:
        return None
    there = None if site is None else site.length or site.strength
    return calibration.field_strength if there is None else there


def _solved(
    samples: Samples, previous: Fit, known: KnownShape, aiding: Instruments, site: Site | None, dip_deg: float
) -> tuple[Aided, Aiding, float]:
    """Fit with the shape as it was, or with one that may have changed where the readings contradict the former."""
    of_site = None if site is None else replace(site, strength=None).evidence
    options: dict[str, Any] = {"site": of_site, "dip_deg": dip_deg, **aiding.sigmas}
    begin = started(samples.field, previous.calibration.offset, symmetric(known.entries))
    freer = changeable(known, ALLOWED_CHANGE)
    (same, reported), (changed, reported_freer) = (
        aided_by(samples, aiding.asked, start=begin, shape=shape, **options) for shape in (known, freer)
    )
    posterior = Posterior(upper(changed.parameters.shape), changed.textbook[3:9, 3:9], changed.covariance[3:9, 3:9])
    chance = by_chance(posterior, known, freer)
    is_changed = chance < limit_of("soft-iron-changed")
    return (changed, reported_freer, chance) if is_changed else (same, reported, chance)


def refreshed_from(previous: Fit, ellipsoid: Ellipsoid, dip_deg: float, soft_iron_p_value: float = 1.0) -> Refreshed:
    """What has changed since an earlier calibration, and what it would do to the headings of a level vehicle now."""
    change = ellipsoid.centre - previous.calibration.offset
    off = Ellipsoid(np.linalg.solve(previous.calibration.ellipsoid.shape, change), np.eye(3))
    worst = raw_error(off, dip_deg=dip_deg).worst
    return Refreshed(previous.name, change, worst, soft_iron_p_value, previous.evidence.residuals.distortion)


def turned(calibration: Calibration, previous: Fit) -> Calibration:
    """The correction in the axes that the earlier calibration corrects to."""
    rotation = previous.calibration.rotation
    return (
        replace(calibration, matrix=previous.calibration.rotation_matrix @ calibration.matrix, rotation=rotation)
        if rotation != "symmetric"
        else calibration
    )
