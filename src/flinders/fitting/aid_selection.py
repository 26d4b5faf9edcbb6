"""Which aids a recording has, whether they can be trusted, and what each of them changes.

`aided_by` tries what was asked for on the recording first: the unit of the gyro, the axes of gyro and accelerometer,
where an attitude's yaw comes from. An aid that does not speak of this sensor is left out and named. With ``auto`` an
aid has to earn its place as well, over blocks of the recording that are left out in turn. The ellipsoid that is found
with it must fit the readings there as well as the one without, and claim less heading error. An accelerometer that does
not may still find how the magnetometer is turned against it: where the field's angle to the vertical spreads less for
that, the rotation is kept, and the ellipsoid stays what the magnetometer says.

An aircraft in coordinated turns feels no sideways pull, and its accelerometer's vertical leans with it: the gyro is
kept, the accelerometer is not.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> aided, aiding = aided_by(drive.samples, "auto")
>>> [(aid.name, aid.kept) for aid in aiding.each], aided.aiding
([('rate', True), ('dip', False)], ('rate',))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np

from flinders.diagnostics.hold_out import HoldOutMisfit, fitted, hold_out_misfit
from flinders.diagnostics.instruments import (
    UPRIGHT,
    Mistake,
    circular,
    dip_of,
    is_at_another_site,
    is_far,
    is_implausible,
    of_aid_and_gyro,
    of_instruments,
    of_scales,
    one_axis,
    without_gaps,
    wrong_dip,
)
from flinders.errors import FitError, figures
from flinders.estimators.aiding import AIDS, Aided, refuse_without, solve
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood, start
from flinders.fitting.aiding import AUTO, Aiding, AidingSensor
from flinders.geometry.quaternions import of_matrix
from flinders.heading.error_propagation import level_error, level_turn
from flinders.likelihood import prior
from flinders.likelihood.dip import ACCELERATION_SIGMA, GRAVITY
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.parameters import TERMS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.parameters import Parameters
    from flinders.likelihood.site_field import Site

NO_WORSE: Final = 1.02
"""Times larger residuals of what was left out that an aid may make."""

WORTH: Final = 0.95
"""Of the heading error claimed without it: an aid that leaves more earns nothing."""

TURNED: Final = 16.3
"""χ² of three degrees of freedom: a rotation that chance makes once in a thousand."""

FAR_TURN_DEG: Final = 20.0
"""From the axes as they were found: instruments on one body sit no farther apart, and what says so is no vertical."""

FAR_CLAIM: Final = 4.0
"""Times more heading error claimed with a vertical than without: it leans, or is none."""


def aided_by(
    samples: Samples,
    aiding: str | Sequence[str],
    *,
    site: Site | None = None,
    dip_deg: float = 60.0,
    spread: float = prior.SPREAD,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
) -> tuple[Aided, Aiding]:
    """Fit with aids, those that can be trusted and, with ``auto``, those that earn their place.

    Parameters
    ----------
    samples : Samples
    aiding : str or sequence of str
        ``auto``, or of `flinders.estimators.aiding.AIDS`.
    site : Site, optional
    dip_deg : float
        Inclination at which headings are compared.
    spread : float
        Of the prior on the shape.
    gyro_scale : float
        What the scales of the gyro may be off by, 1 σ; 0 where it has been calibrated.
    acceleration_bias : float, m/s²
        What the accelerometer may be off by on each axis, 1 σ; 0 where it has been calibrated.

    Raises
    ------
    UsageError
        For an aid that is not known or was not recorded.
    FitError
        If the readings give no ellipsoid.
    """
    is_auto = aiding == AUTO
    wanted = available(samples) if is_auto else ((aiding,) if isinstance(aiding, str) else tuple(aiding))
    refuse_without(samples, wanted)
    wanted = tuple(sorted(wanted, key=lambda name: name != "rate"))  # the others are compared with it
    samples, of_gaps = without_gaps(samples, wanted)
    whole = partial(
        solve, samples, site=site, spread=spread, gyro_scale=gyro_scale, acceleration_bias=acceleration_bias
    )
    axes, mistakes = of_instruments(samples, _alone(samples), wanted)
    mistakes += of_gaps
    untrusted = {mistake.aid: mistake for mistake in mistakes if mistake.drops}
    rotation = None if axes is None else axes.apply(np.eye(3)).T
    best = whole(())
    standing = _Candidate(samples, best, rotation)
    turned, is_strange = cast("Aided | None", None), False
    reports: list[AidingSensor] = []
    kept: tuple[str, ...] = ()
    for name in wanted:
        refused = untrusted.get(name)
        if name == "attitude" and refused is None:
            refused = circular(samples, best, dip_deg)
            mistakes += [] if refused is None else [refused]
        if refused is not None:
            reports.append(AidingSensor(name, kept=False, words=refused.words))
            continue
        replaced = [aid for aid in kept if name in UPRIGHT and aid in UPRIGHT]
        tried = (*(aid for aid in kept if aid not in replaced), name)
        aided = whole(tried, rotation=rotation, near=best)
        is_strange = is_strange or is_at_another_site(aided, site)
        if (contradiction := _contradiction(aided, name)) is not None:
            mistakes += [] if is_auto else [contradiction]
            reports.append(AidingSensor(name, kept=False, words=contradiction.words))
            continue
        said = AidingSensor(
            name, True, change_deg(best, aided, dip_deg), claim_deg(best, dip_deg), claim_deg(aided, dip_deg)
        )  # fmt: skip
        trial = _AidTrial(standing, _Candidate(samples, aided, rotation))
        if is_auto and (against := trial.against(said)):
            if turned is None and (words := trial.turns(said)):
                turned = aided
                changed = turned_deg(aided.parameters.rotation, dip_deg)
                reports.append(replace(said, changed_deg=changed, after_deg=said.before_deg, words=words))
            else:
                reports.append(replace(said, kept=False, words=against))
            continue
        instead = f"{name} tells the vertical as well" + (", and better" if is_auto else ": name one of them")
        reports = [replace(one, kept=False, words=instead) if one.name in replaced else one for one in reports]
        reports.append(said)
        best, standing, kept = aided, trial.candidate, tried
    if "rate" in kept and samples.rate is not None:
        mistakes += one_axis(samples.rate - best.parameters.gyro_bias)
    if site is not None and (is_at_another_site(best, site) or is_strange):  # it would bend the fit: again, without it
        again, told = aided_by(
            samples, aiding, dip_deg=dip_deg, spread=spread, gyro_scale=gyro_scale, acceleration_bias=acceleration_bias
        )
        if (mistake := _of_site(best, told, site)) is not None:
            return again, replace(told, mistakes=(*of_gaps, *told.mistakes, mistake))
    return best, _reported(best, turned, tuple(reports), tuple(mistakes))


def _contradiction(aided: Aided, name: str) -> Mistake | None:
    """Whether an aid goes against the gyro, or against the readings, in a fit that has both."""
    if aided.scales_off:
        return of_scales(aided.scales_off) if name == "rate" else of_aid_and_gyro(name, aided.scales_off)
    return is_implausible(aided, name)


def _of_site(bent: Aided, told: Aiding, site: Site) -> Mistake | None:
    """Whether the dip is not the site's: by the fit with the site, or by what one without it sees."""
    if told.dip_deg is None:
        return wrong_dip(dip_of(bent), site) if is_at_another_site(bent, site) else None
    return wrong_dip(told.dip_deg, site) if is_far(told.dip_deg, site, told.dip_sigma_deg or 0.0) else None


def available(samples: Samples) -> tuple[str, ...]:
    """The aids that a recording has the columns for.

    >>> from flinders.core.samples import Samples
    >>> available(Samples.of([[1.0, 2.0, 3.0]], time=[0.0], acceleration=[[0.0, 0.0, -9.8]]))
    ('dip',)
    """
    return tuple(
        name for name, term in TERMS.items() if all(getattr(samples, column) is not None for column in term.needs)
    )


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


def claim_deg(aided: Aided, dip_deg: float) -> float:
    """Worst level heading error that is claimed, 1 σ, in degrees."""
    return min(level_error(aided.ellipsoid, aided.covariance[:9, :9], dip_deg=dip_deg).worst, 180.0)


def _alone(samples: Samples) -> Ellipsoid:
    """What the magnetometer finds by itself, well or badly."""
    readings = Readings.of(samples.field)
    try:
        return Likelihood().estimate(readings).ellipsoid
    except FitError:
        return start(readings)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A fit, and what is found in parts of its readings, which is looked for once, and only where it is asked for."""

    samples: Samples
    found: Aided
    rotation: Floats | None

    @cached_property
    def in_parts(self) -> list[Parameters]:
        """Without each fold in turn; a fit that sees no rotation takes the axes for those of the body."""
        rotation = self.rotation if self.found.sees_rotation else None
        return fitted(self.samples, self.found.aiding, rotation, self.found)

    def hold_out_misfit(self, vertical: str | None) -> HoldOutMisfit:
        """How far off what was left out is, by verticals of one kind."""
        return hold_out_misfit(self.samples, self.in_parts, vertical)


class _AidTrial(NamedTuple):
    """One more aid on trial: the fit without it, and the one with it."""

    standing: _Candidate
    candidate: _Candidate

    @property
    def without(self) -> Aided:
        """What is found without the aid."""
        return self.standing.found

    @property
    def found(self) -> Aided:
        """What is found with it."""
        return self.candidate.found

    def against(self, said: AidingSensor) -> str:
        """Why the aid does not earn its place; nothing where it does."""
        if said.after_deg > WORTH * said.before_deg:
            return f"claims no less: {figures(said.after_deg)}° with it, {figures(said.before_deg)}° without"
        before, after = self._missed(self.standing).length, self._missed(self.candidate).length
        if not after <= NO_WORSE * before:
            return f"readings that it has not seen are {after / before - 1.0:.0%} farther off with it"
        return ""

    def turns(self, said: AidingSensor) -> str:
        """What its rotation does, in words; nothing where that is not proven, or makes nothing better."""
        covariance = self.found.rotation_covariance
        if covariance is None or self.without.sees_rotation or self.found.aiding[-1] not in UPRIGHT[:2]:
            return ""
        rotation = self.candidate.rotation
        apart = _angle_of(self.found.parameters.rotation @ (np.eye(3) if rotation is None else rotation).T)
        if np.rad2deg(np.linalg.norm(apart)) > FAR_TURN_DEG or said.after_deg > FAR_CLAIM * said.before_deg:
            return ""
        angle = _angle_of(self.found.parameters.rotation)
        if float(angle @ np.linalg.solve(covariance, angle)) < TURNED:
            return ""
        before, after = self._missed(self.standing).height, self._missed(self.candidate).height
        if not after < before:
            return ""
        sigma = figures(float(np.rad2deg(np.sqrt(np.trace(covariance) / 3.0))))
        return (
            f"the magnetometer is turned against it by {figures(float(np.rad2deg(np.linalg.norm(angle))))}° "
            f"(± {sigma}°); sine of the dip spreads by {figures(float(np.rad2deg(after)))}° so, and by "
            f"{figures(float(np.rad2deg(before)))}° without, where it was left out; offset and shape stay"
        )

    def _missed(self, candidate: _Candidate) -> HoldOutMisfit:
        """How far off what was left out is, by the vertical that the aid brings."""
        return candidate.hold_out_misfit(next((aid for aid in self.found.aiding if aid in UPRIGHT[:2]), None))


def turned_deg(rotation: Floats, dip_deg: float) -> float:
    """By how much a rotation of the magnetometer changes the heading of a level vehicle, rms, 180 at most.

    As `flinders.fitting.aiding.Aiding.alignment_error_deg` of a rotation that is not known: z² + ½ tan² I (x² + y²).

    >>> from flinders.likelihood.gyro import rotations
    >>> round(turned_deg(rotations(np.array([[0.0, 0.0, 0.01]]))[0], 60.0), 3)
    0.573
    """
    x, y, z = _angle_of(rotation).tolist()
    return min(float(np.rad2deg(np.sqrt(z**2 + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x**2 + y**2)))), 180.0)


def _angle_of(rotation: Floats) -> Floats:
    """(3,) rotation vector, rad, of a (3, 3) rotation.

    >>> _angle_of(np.diag([1.0, -1.0, -1.0])).round(4)
    array([3.1416, 0.    , 0.    ])
    """
    w, *along = of_matrix(rotation).tolist()
    length = float(np.linalg.norm(along))
    angle: Floats = np.array(along) * (2.0 * np.arctan2(length, w) / length if length > 0.0 else 2.0)
    return angle


def _reported(
    aided: Aided, turned: Aided | None, each: tuple[AidingSensor, ...], mistakes: tuple[Mistake, ...]
) -> Aiding:
    """What is known beside the ellipsoid; of an accelerometer that told the rotation alone, that."""
    if turned is not None and not aided.sees_rotation:
        alone = _reported(turned, None, each, mistakes)
        return replace(alone, excess_variance=aided.excess_variance)
    at = aided.parameters
    rotation = aided.rotation_covariance if aided.sees_rotation else None
    sine, bias, delay, leaning = (aided.of(name) for name in ("sine", "gyro_bias", "delay", "acceleration_bias"))
    height = at.sine if "sine" in aided.layout else float(at.direction[2]) if "direction" in aided.layout else None
    level = np.sqrt(max(1.0 - at.sine**2, 1e-6))
    return Aiding(
        each=each,
        rotation=at.rotation if aided.sees_rotation else None,
        rotation_covariance=rotation,
        gyro_bias=at.gyro_bias if bias is not None else None,
        gyro_bias_sigma=None if bias is None else np.sqrt(np.diag(bias)),
        acceleration_bias=None if leaning is None else GRAVITY * at.acceleration_bias,
        acceleration_bias_sigma=None if leaning is None else GRAVITY * np.sqrt(np.diag(leaning)),
        delay_s=None if delay is None else at.delay,
        delay_sigma_s=None if delay is None else float(np.sqrt(delay[0, 0])),
        dip_deg=None if height is None else float(np.rad2deg(np.arcsin(np.clip(height, -1.0, 1.0)))),
        dip_sigma_deg=None if sine is None else float(np.rad2deg(np.sqrt(sine[0, 0]) / level)),
        excess_variance=aided.excess_variance,
        mistakes=mistakes,
    )


def without_rotation(aided: Aided) -> Aided:
    """The same with the rotation left as it is where nothing saw it: an ellipsoid's symmetric root."""
    if aided.sees_rotation:
        return aided
    return replace(aided, parameters=replace(aided.parameters, rotation=np.eye(3)))


__all__ = ["AIDS", "aided_by", "available", "change_deg", "claim_deg", "without_rotation"]
