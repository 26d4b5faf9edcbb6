"""Which aids a recording has, whether they can be trusted, and what each of them changes.

`aided_by` tries what was asked for on the recording first: the unit of the gyro, the axes of gyro and accelerometer,
where an attitude's yaw comes from. An aid that does not speak of this sensor is left out and named. With ``auto`` an
aid has to earn its place as well: over blocks of the recording, each left out in turn, the ellipsoid that is found
with it must fit the readings left out as well as the one without, and claim less heading error.

An aircraft in coordinated turns feels no sideways pull, and its accelerometer's vertical leans with it: the gyro is
kept, the accelerometer is not.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> found, aids = aided_by(drive.samples, "auto")
>>> [(aid.name, aid.kept) for aid in aids.each], found.aids
([('rate', True), ('dip', False)], ('rate',))
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import FitError
from flinders.estimators.aided import AIDS, Aided, refuse_without, solve
from flinders.estimators.likelihood import Likelihood, start
from flinders.estimators.mounting import ONE_AXIS, axes_of, rate_unit, second_axis
from flinders.estimators.readings import Readings
from flinders.heading import level_error, level_turn
from flinders.result import Aid, Aids, Mistake
from flinders.terms import magnitude, pointing, prior

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.axes import Axes
    from flinders.quadric import Ellipsoid
    from flinders.samples import Samples
    from flinders.terms.site import Site

AUTO: Final = "auto"

FOLDS: Final = 3
"""Blocks of a recording that are left out in turn."""

NO_WORSE: Final = 1.02
"""Times larger residuals of what was left out that an aid may make."""

CIRCULAR_DEG, CIRCULAR_SIGMAS, CIRCULAR_SHARE = 0.5, 3.0, 0.5
"""A yaw that goes with the heading by so much, so far beyond what is claimed without it, and mostly, is a compass's."""

FAR_SITE_DEG, FAR_SITE_SIGMAS = 2.0, 3.0
"""A dip that is off by more, and by more of what the site is known to, is another place's."""


def aided_by(
    samples: Samples,
    aids: str | Sequence[str],
    *,
    site: Site | None = None,
    dip_deg: float = 60.0,
    spread: float = prior.SPREAD,
) -> tuple[Aided, Aids]:
    """Fit with aids, those that can be trusted and, with ``auto``, those that earn their place.

    Parameters
    ----------
    samples : Samples
    aids : str or sequence of str
        ``auto``, or of `flinders.estimators.aided.AIDS`.
    site : Site, optional
    dip_deg : float
        Inclination at which headings are compared.
    spread : float
        Of the prior on the shape.

    Raises
    ------
    UsageError
        For an aid that is not known or was not recorded.
    FitError
        If the readings give no ellipsoid.
    """
    is_auto = aids == AUTO
    wanted = available(samples) if is_auto else ((aids,) if isinstance(aids, str) else tuple(aids))
    refuse_without(samples, wanted)
    alone = _alone(samples)
    axes, mistakes = _mounted(samples, alone, wanted)
    untrusted = {mistake.aid: mistake for mistake in mistakes if mistake.drops}
    rotation = None if axes is None else axes.apply(np.eye(3)).T
    best = solve(samples, (), site=site, spread=spread)
    reports: list[Aid] = []
    kept: tuple[str, ...] = ()
    for name in wanted:
        if name in untrusted:
            reports.append(Aid(name, kept=False, words=untrusted[name].words))
            continue
        tried = (*kept, name)
        if name == "attitude":
            tried = ("attitude",)
            circular = _circular(samples, best, dip_deg)
            if circular is not None:
                mistakes.append(circular)
                reports.append(Aid(name, kept=False, words=circular.words))
                continue
        found = solve(samples, tried, site=site, rotation=rotation, spread=spread)
        changed = change_deg(best, found, dip_deg)
        before, after = claim_deg(best, dip_deg), claim_deg(found, dip_deg)
        if is_auto and not _earns(samples, kept, tried, before, after, rotation):
            reports.append(Aid(name, kept=False, changed_deg=changed, words="fits what was left out no better"))
            continue
        reports.append(Aid(name, kept=True, changed_deg=changed, before_deg=before, after_deg=after))
        best, kept = found, tried
    if "rate" in kept and samples.rate is not None:
        mistakes += _one_axis(samples.rate - best.parameters.gyro_bias)
    mistakes += _elsewhere(best, site)
    return best, _told(best, tuple(reports), tuple(mistakes))


def available(samples: Samples) -> tuple[str, ...]:
    """The aids that a recording has the columns for.

    >>> from flinders.samples import Samples
    >>> available(Samples.of([[1.0, 2.0, 3.0]], time=[0.0], acceleration=[[0.0, 0.0, -9.8]]))
    ('dip',)
    """

    def has(*columns: str) -> bool:
        return all(getattr(samples, column) is not None for column in columns)

    found = [("rate", has("rate", "time")), ("dip", has("acceleration")), ("attitude", has("attitude"))]
    return tuple(name for name, is_there in found if is_there)


def change_deg(first: Aided, second: Aided, dip_deg: float) -> float:
    """By how much two corrections differ in the heading of a level vehicle, rms, their mean difference taken off.

    Each in the magnetometer's own axes, whatever the rotation against the body.
    """
    _, fields = level_turn(dip_deg)
    readings = first.parameters.offset + fields.T @ first.parameters.shape
    other = np.linalg.solve(second.parameters.shape, (readings - second.parameters.offset).T)
    error = np.exp(1j * (np.arctan2(-other[1], other[0]) - np.arctan2(-fields[1], fields[0])))
    middle = error.mean()
    errors = np.angle(error / (middle / abs(middle) if abs(middle) > 0.0 else 1.0))
    return float(np.rad2deg(np.sqrt(np.mean(errors**2))))


def claim_deg(found: Aided, dip_deg: float) -> float:
    """Worst level heading error that is claimed, 1 σ, in degrees."""
    return min(level_error(found.ellipsoid, found.covariance[:9, :9], dip_deg=dip_deg).worst, 180.0)


def _alone(samples: Samples) -> Ellipsoid:
    """What the magnetometer finds by itself, well or badly."""
    readings = Readings.of(samples.field)
    try:
        return Likelihood().estimate(readings).ellipsoid
    except FitError:
        return start(readings)


def _mounted(samples: Samples, alone: Ellipsoid, wanted: Sequence[str]) -> tuple[Axes | None, list[Mistake]]:
    """Look for mistakes in the unit and the axes of the instruments."""
    mistakes = []
    axes = None
    if "rate" in wanted:
        unit, better = rate_unit(samples, alone)
        if unit != "rad/s":
            words = f"the rate fits {better:.0f} times better as {unit}: record it in rad/s; it was not used"
            return None, [Mistake("gyro-unit", "rate", better, 1.0, words, drops=True)]
    for aid in ("rate", "dip"):
        if aid in wanted:
            mounted = axes_of(samples, alone, aid)
            if mounted.better > 1.0:
                what = "gyro" if aid == "rate" else "accelerometer"
                words = (
                    f"the {what} fits {mounted.better:.0f} times better with the magnetometer's axes turned by "
                    f"{mounted.axes}: they do not sit alike, and the correction turns readings into the {what}'s axes"
                )
                mistakes.append(Mistake("swapped-axes", aid, mounted.better, 2.0, words))
                axes = axes or mounted.axes
    return axes, mistakes


def _one_axis(rate: Floats) -> list[Mistake]:
    """Say where all turning is about one axis."""
    share = second_axis(rate)
    if share >= ONE_AXIS:
        return []
    words = (
        f"the body turned about one axis (about the second {share:.0%} as much): "
        "the gyro says nothing of the offset along it; turn it about another axis as well"
    )
    return [Mistake("one-axis", "rate", share, ONE_AXIS, words)]


def _elsewhere(found: Aided, site: Site | None) -> list[Mistake]:
    """Say where the dip is not the site's."""
    if site is None or site.inclination_deg is None or found.site_off is None:
        return []
    sine = found.parameters.sine if "sine" in found.layout else float(found.parameters.direction[2])
    seen = float(np.rad2deg(np.arcsin(np.clip(sine, -1.0, 1.0))))
    off = abs(seen - site.inclination_deg)
    if off <= FAR_SITE_DEG or abs(found.site_off) <= FAR_SITE_SIGMAS:
        return []
    words = (
        f"the field dips by {seen:.1f}°, at the site it should by {site.inclination_deg:.1f}°: "
        "check place and date, and whether iron was near"
    )
    return [Mistake("site-differs", "site", off, FAR_SITE_DEG, words)]


def _circular(samples: Samples, reference: Aided, dip_deg: float) -> Mistake | None:
    """Whether a logged yaw goes with the heading as an uncorrected compass would.

    The field, corrected without that yaw and turned into the world by the logged attitude, points the same way at all
    times if the attitude is right. An error that is a function of the heading, A + B sin ψ + C cos ψ + D sin 2ψ + E
    cos 2ψ, is the deviation of the compass that the yaw was taken from.
    """
    if samples.attitude is None:
        return None
    matrices = pointing.body_to_world(samples.attitude)
    known = np.isfinite(matrices[:, 0, 0])
    world = np.einsum("nij,nj->ni", matrices[known], reference.corrected(samples.field[known]))
    level = np.hypot(world[:, 0], world[:, 1])
    turned = np.arctan2(world[:, 1], world[:, 0])
    turned = np.angle(np.exp(1j * (turned - np.angle(np.sum(level * np.exp(1j * turned))))))
    heading = np.arctan2(matrices[known][:, 1, 0], matrices[known][:, 0, 0])
    columns = [np.ones_like(heading), np.sin(heading), np.cos(heading), np.sin(2 * heading), np.cos(2 * heading)]
    design = np.stack(columns, axis=1)
    weights = np.linalg.lstsq(design, turned, rcond=None)[0]
    follows = design[:, 1:] @ weights[1:]
    amount = float(np.rad2deg(np.std(follows)))
    share = float(np.var(follows) / max(np.var(turned), 1e-300))
    claimed = level_error(reference.ellipsoid, reference.covariance[:9, :9], dip_deg=dip_deg).rms
    limit = max(CIRCULAR_DEG, CIRCULAR_SIGMAS * claimed)
    if amount <= limit or share <= CIRCULAR_SHARE:
        return None
    words = (
        f"the yaw of the attitude follows a compass with a deviation of {amount:.1f}°, most likely this one before it "
        "was calibrated: it was not used; take the attitude without its yaw ('tilt'), or one without a compass in it"
    )
    return Mistake("circular-attitude", "attitude", amount, limit, words, drops=True)


def _earns(
    samples: Samples,
    without: tuple[str, ...],
    tried: tuple[str, ...],
    before: float,
    after: float,
    rotation: Floats | None,
) -> bool:
    """Whether an aid claims less heading error, and fits readings that it has not seen as well as without it."""
    if after >= before:
        return False
    misses = np.zeros(2)
    for kept, left_out in _folds(len(samples)):
        for index, terms in enumerate((without, tried)):
            try:
                found = solve(samples[kept], terms, rotation=rotation)
            except FitError:
                continue
            misses[index] += float(np.sum(magnitude.distances(samples.field[left_out], found.ellipsoid) ** 2))
    return bool(np.sqrt(misses[1]) <= NO_WORSE * np.sqrt(misses[0]))


def _folds(count: int) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Which rows are kept, and which are the block that is left out."""
    block = np.arange(count) * FOLDS // count
    for index in range(FOLDS):
        yield block != index, block == index


def _told(found: Aided, each: tuple[Aid, ...], mistakes: tuple[Mistake, ...]) -> Aids:
    """What is known beside the ellipsoid."""
    at = found.parameters
    rotation = found.rotation_covariance if found.sees_rotation else None
    sine, bias, delay = found.of("sine"), found.of("gyro_bias"), found.of("delay")
    height = at.sine if "sine" in found.layout else float(at.direction[2]) if "direction" in found.layout else None
    level = np.sqrt(max(1.0 - at.sine**2, 1e-6))
    return Aids(
        each=each,
        rotation=at.rotation if found.sees_rotation else None,
        rotation_covariance=rotation,
        gyro_bias=at.gyro_bias if bias is not None else None,
        gyro_bias_sigma=None if bias is None else np.sqrt(np.diag(bias)),
        delay_s=None if delay is None else at.delay,
        delay_sigma_s=None if delay is None else float(np.sqrt(delay[0, 0])),
        dip_deg=None if height is None else float(np.rad2deg(np.arcsin(np.clip(height, -1.0, 1.0)))),
        dip_sigma_deg=None if sine is None else float(np.rad2deg(np.sqrt(sine[0, 0]) / level)),
        creep=found.creep,
        mistakes=mistakes,
    )


def settled(found: Aided) -> Aided:
    """The same with the rotation left as it is where nothing saw it: an ellipsoid's symmetric root."""
    if found.sees_rotation:
        return found
    return replace(found, parameters=replace(found.parameters, rotation=np.eye(3)))


__all__ = ["AIDS", "AUTO", "aided_by", "available", "change_deg", "claim_deg", "settled"]
