"""Which aiding sensors a fit can use: those whose units and axes are right, and that make the calibration better.

`aided_by` looks at the recording first: the unit of the gyro, the axes of gyro and accelerometer, where an attitude's
yaw comes from. A sensor that does not speak of this magnetometer is left out and named, and so is one with which a fit
claims more heading error than with those before it; `flinders.fit` compares the whole with the fit without any.

With ``auto`` a sensor has to earn its place as well, over blocks of the recording that are left out in turn: the
ellipsoid with it must fit the readings there as well as the one without, and claim less heading error. A vertical that
does not may still find how the magnetometer is turned against it: where it was asked for, or where the field's angle to
the vertical spreads less for that, the rotation is taken over, and the ellipsoid stays what the magnetometer says.

An aircraft in coordinated turns feels no sideways pull, and its accelerometer's vertical leans with it: the gyro is
used, the accelerometer is not.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> aided, aiding = aided_by(drive.samples, "auto")
>>> [(sensor.name, sensor.is_used) for sensor in aiding.sensors], aided.aiding
([('rate', True), ('dip', False)], ('rate',))
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.diagnostics.hold_out import HoldOutMisfit, fitted, hold_out_misfit
from flinders.diagnostics.instruments import (
    UPRIGHT,
    Mistake,
    circular,
    dip_of,
    is_at_another_site,
    is_diverged,
    is_far,
    is_implausible,
    of_aid_and_gyro,
    of_instruments,
    of_scales,
    of_turns,
    one_axis,
    without_gaps,
    wrong_dip,
)
from flinders.diagnostics.mirrored_axis import middle_dip_deg, mirrored_axis
from flinders.errors import FitError, figures
from flinders.estimators.aiding import Aided, refuse_without, solve
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood, start
from flinders.fitting.aiding import AUTO, FAR_CLAIM, MORE, ROTATION_ALONE, VERTICALS, Aiding, AidingSensor, claims_more
from flinders.geometry.plane import heading_errors
from flinders.geometry.rotation import rotation_vectors
from flinders.heading.error_propagation import level_error, level_turn
from flinders.likelihood import prior
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.parameters import TERMS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.parameters import Parameters
    from flinders.likelihood.prior import KnownShape
    from flinders.likelihood.site_field import Site

NO_WORSE: Final = 1.02
"""Times larger residuals of what was left out that a sensor may make."""

WORTH: Final = 0.95
"""Of the heading error claimed without it: a sensor that leaves more earns nothing."""

TURNED: Final = 16.3
"""χ² of three degrees of freedom: a rotation that chance makes once in a thousand."""

MIRRORED: Final = "mirrored-axis"
"""A finding that tells why axes seem exchanged, in place of the finding that they are."""

FAR_TURN_DEG: Final = 20.0
"""From the axes as they were found: instruments on one body sit no farther apart, and what says so is no vertical."""


def aided_by(
    samples: Samples,
    aiding: str | Sequence[str],
    *,
    site: Site | None = None,
    dip_deg: float = 60.0,
    spread: float = prior.SPREAD,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
    start: Ellipsoid | None = None,
    shape: KnownShape | None = None,
) -> tuple[Aided, Aiding]:
    """Fit with aiding sensors, those that can be trusted and, with ``auto``, those that earn their place.

    Raises `UsageError` for a sensor that is not known or was not recorded; `FitError` if the readings give no
    ellipsoid.

    Parameters
    ----------
    aiding : str or sequence of str
        ``auto``, or of `flinders.estimators.aiding.AIDS`.
    dip_deg : float
        Inclination at which headings are compared.
    spread : float
        Of the prior on the shape.
    gyro_scale : float
        What the scales of the gyro may be off by, 1 σ; 0 where it has been calibrated.
    acceleration_bias : float, m/s²
        What the accelerometer may be off by on each axis, 1 σ; 0 where it has been calibrated.
    acceleration_gain : float
        What its gains may be off by, and its axes from square in rad, 1 σ.
    start : Ellipsoid, optional
        Where to begin; by default what the magnetometer finds by itself.
    shape : KnownShape, optional
        Of an earlier calibration, instead of `spread`.
    """
    is_auto = aiding == AUTO
    wanted = available(samples) if is_auto else ((aiding,) if isinstance(aiding, str) else tuple(aiding))
    refuse_without(samples, wanted)
    wanted = tuple(sorted(wanted, key=lambda name: name != "rate"))  # the others are compared with it
    samples, of_gaps = without_gaps(samples, wanted)
    is_signed = site is not None and site.inclination_deg is not None
    about = start or _alone(samples)
    axes, mistakes = of_instruments(samples, about, wanted, is_signed=is_signed)
    rotation = None if axes is None else axes.apply(np.eye(3)).T
    options: dict[str, Any] = {"spread": spread, "gyro_scale": gyro_scale, "acceleration_bias": acceleration_bias}
    options |= {"acceleration_gain": acceleration_gain, "start": start, "shape": shape}
    solver: Callable[..., Aided] = partial(solve, samples, site=site, **options)
    alone = _Candidate(samples, solver(()), rotation)
    if site is not None and axes is not None:
        mirror = mirrored_axis(middle_dip_deg(samples, about, axes), site, rotation)
        if mirror is not None:
            again, reported = aided_by(samples, aiding, dip_deg=dip_deg, **options)
            return again, _in_place(reported, mirror, of_gaps)
    selection = _Selection(samples, solver, rotation, site, dip_deg, is_auto, alone, [*mistakes, *of_gaps])
    for name in wanted:
        selection.try_sensor(name)
    if site is not None and selection.is_elsewhere:  # the site would bend the fit: again, without it
        again, reported = aided_by(samples, aiding, dip_deg=dip_deg, **options)
        if (mistake := _of_site(selection.best, reported, site)) is not None:
            return again, _in_place(reported, mistake, of_gaps)
    return selection.best, selection.reported()


def _in_place(reported: Aiding, mistake: Mistake, of_gaps: Sequence[Mistake]) -> Aiding:
    """What a fit without the site reports, with why it has none; a mirrored axis is why axes seem exchanged."""
    others = [one for one in reported.mistakes if mistake.code != MIRRORED or one.code != "swapped-axes"]
    return replace(reported, mistakes=(*of_gaps, *others, mistake))


@dataclass(eq=False)
class _Selection:
    """Sensors that are tried one after the other, each with those that are used before it."""

    samples: Samples
    solver: Callable[..., Aided]
    rotation: Floats | None  # how the magnetometer sits on the body, where that is not as recorded
    site: Site | None
    dip_deg: float
    is_auto: bool
    standing: _Candidate  # the fit with the sensors that are used
    mistakes: list[Mistake]
    used: tuple[str, ...] = ()
    turned: Aided | None = None  # the fit whose rotation is taken over, but not its ellipsoid
    reports: list[AidingSensor] = field(default_factory=list)
    was_elsewhere: bool = False

    @property
    def best(self) -> Aided:
        """The fit with the sensors that are used."""
        return self.standing.aided

    @property
    def is_elsewhere(self) -> bool:
        """A fit says that the recording was not made at the site."""
        return self.was_elsewhere or is_at_another_site(self.best, self.site)

    def try_sensor(self, name: str) -> None:
        """Use a sensor that can be trusted and, with ``auto``, earns its place; say why another is left out."""
        if (mistake := self._mistake_of(name)) is not None:
            self.reports.append(AidingSensor(name, is_used=False, reason=mistake.words, code=mistake.code))
            return
        replaced = [used for used in self.used if name in UPRIGHT and used in UPRIGHT]
        tried = (*(used for used in self.used if used not in replaced), name)
        try:
            aided = self.solver(tried, rotation=self.rotation, near=self.best)
        except FitError as error:
            self.reports.append(AidingSensor(name, is_used=False, reason=error.message))
            return
        self.was_elsewhere = self.was_elsewhere or is_at_another_site(aided, self.site)
        claims = claim_deg(self.best, self.dip_deg), claim_deg(aided, self.dip_deg)
        if (contradiction := _contradiction(self.samples, aided, name) or is_diverged(name, *claims)) is not None:
            self.mistakes += [] if self.is_auto else [contradiction]
            report = AidingSensor(name, is_used=False, reason=contradiction.words, code=contradiction.code)
            self.reports.append(report)
            return
        report = AidingSensor(name, True, change_deg(self.best, aided, self.dip_deg), *claims)
        trial = _AidTrial(self.standing, _Candidate(self.samples, aided, self.rotation))
        if against := trial.against(report) if self.is_auto else trial.claims_more(report):
            turned = self._turned_by(trial, report, against)
            self.reports.append(turned or replace(report, is_used=False, reason=against))
            return
        if name in UPRIGHT and not self.is_auto and self.turned is not None:
            replaced, self.turned = [*replaced, self.turned.aiding[-1]], None
        self._report_replaced(replaced, name)
        self.reports.append(report)
        self.standing, self.used = trial.candidate, tried

    def _mistake_of(self, name: str) -> Mistake | None:
        """Why a sensor cannot be used, so that no fit with it is needed."""
        drops = next((mistake for mistake in reversed(self.mistakes) if mistake.aid == name and mistake.drops), None)
        if drops is None and name == "attitude":
            drops = circular(self.samples, self.best, self.dip_deg)
            self.mistakes += [] if drops is None else [drops]
        if drops is None and name == "dip":
            drops = of_turns(self.samples, self._mounted(), claim_deg(self.best, self.dip_deg))
            self.mistakes += [] if drops is None or self.is_auto else [drops]
        return drops

    def _mounted(self) -> Aided:
        """The fit with the sensors that are used, in body axes as well as they are known."""
        if self.rotation is None or self.best.sees_rotation:
            return self.best
        return replace(self.best, parameters=replace(self.best.parameters, rotation=self.rotation))

    def _turned_by(self, trial: _AidTrial, report: AidingSensor, against: str) -> AidingSensor | None:
        """Take over the rotation alone: of the first vertical that proves one, or that was asked for and sees one."""
        is_asked = not self.is_auto and trial.sees_mounting
        words = f"{against}; {ROTATION_ALONE}" if is_asked else trial.rotation_words(report)
        if self.turned is not None or not words:
            return None
        self.turned = trial.aided
        changed = turned_deg(trial.aided.parameters.rotation, self.dip_deg)
        return replace(report, heading_change_deg=changed, after_deg=report.before_deg, reason=words)

    def _report_replaced(self, replaced: Sequence[str], name: str) -> None:
        """Say of verticals that were used that another one is used instead."""
        instead = f"{name} tells the vertical as well" + (", and better" if self.is_auto else ": name one of them")
        self.reports = [
            replace(each, is_used=False, reason=instead) if each.name in replaced else each for each in self.reports
        ]

    def reported(self) -> Aiding:
        """What is known beside the ellipsoid; of an accelerometer that told the rotation alone, that."""
        best, mistakes = self.best, self.mistakes
        if "rate" in self.used and self.samples.rate is not None:
            mistakes = [*mistakes, *one_axis(self.samples.rate - best.parameters.gyro_bias)]
        is_seen = best.sees_rotation and self.is_auto
        source = best if self.turned is None or is_seen else self.turned
        aiding = Aiding.of(source, each=tuple(self.reports), mistakes=tuple(mistakes))
        return replace(aiding, excess_variance=best.excess_variance)


def _contradiction(samples: Samples, aided: Aided, name: str) -> Mistake | None:
    """Whether a sensor goes against the gyro, or against the readings, in a fit that has both."""
    if aided.scales_off:
        return of_scales(aided.scales_off) if name == "rate" else of_aid_and_gyro(name, aided.scales_off)
    return is_implausible(aided, name) or (of_turns(samples, aided) if name == "dip" else None)


def _of_site(bent: Aided, without: Aiding, site: Site) -> Mistake | None:
    """Whether the dip is not the site's: by the fit with the site, or by what one without it sees."""
    if without.dip_deg is None:
        return wrong_dip(dip_of(bent), site) if is_at_another_site(bent, site) else None
    if not is_far(without.dip_deg, site, without.dip_sigma_deg or 0.0):
        return None
    return mirrored_axis(without.dip_deg, site, without.rotation) or wrong_dip(without.dip_deg, site)


def available(samples: Samples) -> tuple[str, ...]:
    """The aiding sensors that a recording has the columns for.

    >>> from flinders.core.samples import Samples
    >>> available(Samples.of([[1.0, 2.0, 3.0]], time=[0.0], acceleration=[[0.0, 0.0, -9.8]]))
    ('dip',)
    """
    return tuple(
        name for name, term in TERMS.items() if all(getattr(samples, column) is not None for column in term.needs)
    )


def change_deg(first: Aided, second: Aided, dip_deg: float) -> float:
    """By how much two corrections differ in the heading of a level vehicle, rms, their mean difference removed.

    Each in the magnetometer's own axes, whatever the rotation against the body.
    """
    heading, fields = level_turn(dip_deg)
    readings = first.parameters.offset + fields.T @ first.parameters.shape
    corrected = np.linalg.solve(second.parameters.shape, (readings - second.parameters.offset).T)
    errors, _ = heading_errors(corrected, heading)
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
    """A fit, and the fits of parts of its readings, which are made once, and only where they are asked for."""

    samples: Samples
    aided: Aided
    rotation: Floats | None

    @cached_property
    def in_parts(self) -> list[Parameters]:
        """Without each fold in turn; a fit that sees no rotation takes the axes for those of the body."""
        rotation = self.rotation if self.aided.sees_rotation else None
        return fitted(self.samples, self.aided.aiding, rotation, self.aided)

    def hold_out_misfit(self, vertical: str | None) -> HoldOutMisfit:
        """How far off what was left out is, by verticals of one kind."""
        return hold_out_misfit(self.samples, self.in_parts, vertical)


class _AidTrial(NamedTuple):
    """One more sensor on trial: the fit without it, and the one with it."""

    standing: _Candidate
    candidate: _Candidate

    @property
    def aided(self) -> Aided:
        """The fit with it."""
        return self.candidate.aided

    def against(self, report: AidingSensor) -> str:
        """Why the sensor does not earn its place; nothing where it does."""
        if report.after_deg > WORTH * report.before_deg:
            return f"claims no less: {figures(report.after_deg)}° with it, {figures(report.before_deg)}° without"
        before, after = self._missed(self.standing).length, self._missed(self.candidate).length
        if not after <= NO_WORSE * before:
            return f"readings that it has not seen are {after / before - 1.0:.0%} farther off with it"
        return ""

    def claims_more(self, report: AidingSensor) -> str:
        """Why a sensor that was asked for is left out beside others: more is left open with it; nothing else.

        A first sensor stays: a fit to the magnitude alone claims too little where residuals are correlated.
        """
        if not self.standing.aided.aiding or report.after_deg <= MORE * report.before_deg:
            return ""
        return claims_more(report.after_deg, report.before_deg)

    @property
    def sees_mounting(self) -> bool:
        """The sensor is a vertical that sees how the magnetometer sits, no farther turned than instruments are."""
        return self.aided.sees_rotation and self.aided.aiding[-1] in VERTICALS and not self._is_far()

    def rotation_words(self, report: AidingSensor) -> str:
        """What its rotation does; nothing where that is not proven, or makes nothing better."""
        covariance = self.aided.rotation_covariance
        if covariance is None or self.standing.aided.sees_rotation or self.aided.aiding[-1] not in VERTICALS:
            return ""
        angle = rotation_vectors(self.aided.parameters.rotation)
        is_proven = float(angle @ np.linalg.solve(covariance, angle)) >= TURNED
        if not is_proven or self._is_far() or report.after_deg > FAR_CLAIM * report.before_deg:
            return ""
        before, after = self._missed(self.standing).height, self._missed(self.candidate).height
        if not after < before:
            return ""
        turned, sigma = float(np.linalg.norm(angle)), float(np.sqrt(np.trace(covariance) / 3.0))
        return (
            f"the magnetometer is turned against it by {_degrees(turned)}° (± {_degrees(sigma)}°); sine of the dip "
            f"spreads by {_degrees(after)}° so, and by {_degrees(before)}° without, where it was left out; offset and "
            "shape stay"
        )

    def _is_far(self) -> bool:
        """The rotation is farther from the axes as they are mounted than instruments on one body sit apart."""
        mounted = np.eye(3) if self.candidate.rotation is None else self.candidate.rotation
        apart = rotation_vectors(self.aided.parameters.rotation @ mounted.T)
        return bool(np.rad2deg(np.linalg.norm(apart)) > FAR_TURN_DEG)

    def _missed(self, candidate: _Candidate) -> HoldOutMisfit:
        """How far off what was left out is, by the vertical that the sensor brings."""
        return candidate.hold_out_misfit(next((name for name in self.aided.aiding if name in VERTICALS), None))


def _degrees(radians: float) -> str:
    """Write an angle in degrees, to the digits that count."""
    return figures(float(np.rad2deg(radians)))


def turned_deg(rotation: Floats, dip_deg: float) -> float:
    """By how much a rotation of the magnetometer changes the heading of a level vehicle, rms, 180 at most.

    As `flinders.fitting.aiding.Aiding.alignment_error_deg` of a rotation that is not known: z² + ½ tan² I (x² + y²).

    >>> from flinders.likelihood.gyro import rotations
    >>> round(turned_deg(rotations(np.array([[0.0, 0.0, 0.01]]))[0], 60.0), 3)
    0.573
    """
    x, y, z = rotation_vectors(rotation).tolist()
    return min(float(np.rad2deg(np.sqrt(z**2 + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x**2 + y**2)))), 180.0)
