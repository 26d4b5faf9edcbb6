"""Selection of aiding sensors: their units and axes must be right, and they must improve the calibration.

`fit_with_aids` checks the recording first: the unit of the gyro, the axes of gyro and accelerometer, the source of an
attitude's yaw. A sensor that contradicts the magnetometer is left out, and a finding names it. A sensor with which the
fit claims more heading error than without it is left out, too. `flinders.fit` compares the result with the unaided fit.

With ``auto`` each sensor is also cross-validated over blocks of the recording that are left out in turn. The ellipsoid
with the sensor must fit the left-out readings as well as the ellipsoid without it, and claim less heading error. A
sensor that shows the vertical may fail this test and still determine the rotation of the magnetometer against the body.
The fit then uses this rotation alone, if the sensor was requested by name, or if the rotation reduces the scatter of
the angle between field and vertical. The ellipsoid stays that of the magnetometer alone.

In coordinated turns the specific force of an aircraft stays along its z axis, so that the accelerometer's vertical
leans with the aircraft: the gyro is used, the accelerometer is not.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> aided, aiding = fit_with_aids(drive.samples, "auto")
>>> [(sensor.name, sensor.is_used) for sensor in aiding.sensors], aided.aiding
([('rate', True), ('dip', False)], ('rate',))
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.diagnostics.hold_out import HoldOutMisfit, fit_folds, hold_out_misfit
from flinders.diagnostics.instruments import (
    VERTICAL_SENSORS,
    Mistake,
    compass_yaw_mistake,
    dip_of,
    divergence,
    fill_gyro_gaps,
    gyro_contradiction,
    gyro_scale_mistake,
    implausible_vertical,
    instrument_mistakes,
    is_at_another_site,
    is_other_dip,
    lean_mistake,
    one_axis_mistakes,
    wrong_dip_mistake,
)
from flinders.diagnostics.mirrored_axis import median_dip_deg, mirrored_axis
from flinders.errors import FitError, figures
from flinders.estimators.aiding import AidedFit, fit_aided, refuse_missing_columns
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood, start_ellipsoid
from flinders.fitting.aiding import (
    AUTO,
    MAX_CLAIM_RATIO,
    MAX_VERTICAL_CLAIM_RATIO,
    ROTATION_ALONE,
    VERTICALS,
    Aiding,
    AidingSensor,
    claims_more,
)
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

MAX_MISFIT_RATIO: Final = 1.02
"""Largest ratio of the residuals of left-out readings with a sensor to those without it."""

MAX_AUTO_CLAIM_RATIO: Final = 0.95
"""Largest claimed heading error at which a sensor is used, relative to the error claimed without the sensor."""

MIN_ROTATION_CHI2: Final = 16.3
"""Smallest χ² of a significant rotation, with three degrees of freedom: chance exceeds it in 0.1 % of cases."""

MIRRORED_AXIS: Final = "mirrored-axis"
"""Code of the finding on a mirrored axis, which replaces "swapped-axes", because such an axis looks like a swap."""

MAX_MOUNTING_DEG: Final = 20.0
"""Largest plausible rotation between instruments on one body; a sensor with a larger one shows no vertical."""


def fit_with_aids(
    samples: Samples,
    aiding: str | Sequence[str],
    *,
    site: Site | None = None,
    dip_deg: float = 60.0,
    spread: float = prior.SOFT_IRON_SPREAD,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
    start: Ellipsoid | None = None,
    shape: KnownShape | None = None,
) -> tuple[AidedFit, Aiding]:
    """Fit with the aiding sensors that contradict nothing and, for ``auto``, improve the calibration.

    Raises `UsageError` for a sensor that is unknown or was not recorded; `FitError` if the readings give no ellipsoid.

    Parameters
    ----------
    aiding : str or sequence of str
        ``auto``, or names of `flinders.estimators.aiding.AIDING_TERMS`.
    dip_deg : float
        Inclination at which headings are compared.
    spread : float
        Standard deviation of the prior on the shape.
    gyro_scale : float
        Error of the gyro's scales, as a share, 1 σ; 0 for a calibrated gyro.
    acceleration_bias : float, m/s²
        Bias of the accelerometer on each axis, 1 σ; 0 for a calibrated accelerometer.
    acceleration_gain : float
        Error of the accelerometer's gains, as a share, and of its orthogonality, in rad, 1 σ.
    start : Ellipsoid, optional
        Initial value of the solver; by default the ellipsoid of the magnetometer alone.
    shape : KnownShape, optional
        Shape of an earlier calibration with its uncertainty, as the prior in place of `spread`.
    """
    is_auto = aiding == AUTO
    wanted = available(samples) if is_auto else ((aiding,) if isinstance(aiding, str) else tuple(aiding))
    refuse_missing_columns(samples, wanted)
    wanted = tuple(sorted(wanted, key=lambda name: name != "rate"))  # the other sensors are compared with the gyro
    samples, of_gaps = fill_gyro_gaps(samples, wanted)
    is_signed = site is not None and site.inclination_deg is not None
    about = start or _plain_ellipsoid(samples)
    axes, mistakes = instrument_mistakes(samples, about, wanted, is_signed=is_signed)
    rotation = None if axes is None else axes.apply(np.eye(3)).T
    options: dict[str, Any] = {"spread": spread, "gyro_scale": gyro_scale, "acceleration_bias": acceleration_bias}
    options |= {"acceleration_gain": acceleration_gain, "start": start, "shape": shape}
    solver: Callable[..., AidedFit] = partial(fit_aided, samples, site=site, **options)
    alone = _Candidate(samples, solver(()), rotation)
    if site is not None and axes is not None:
        mirror = mirrored_axis(median_dip_deg(samples, about, axes), site, rotation)
        if mirror is not None:
            again, reported = fit_with_aids(samples, aiding, dip_deg=dip_deg, **options)
            return again, _with_mistake(reported, mirror, of_gaps)
    selection = _Selection(samples, solver, rotation, site, dip_deg, is_auto, alone, [*mistakes, *of_gaps])
    for name in wanted:
        selection.try_sensor(name)
    if site is not None and selection.is_elsewhere:  # a wrong site would distort the fit: repeat without it
        again, reported = fit_with_aids(samples, aiding, dip_deg=dip_deg, **options)
        if (mistake := _site_mistake(selection.best, reported, site)) is not None:
            return again, _with_mistake(reported, mistake, of_gaps)
    return selection.best, selection.aiding()


def _with_mistake(reported: Aiding, mistake: Mistake, of_gaps: Sequence[Mistake]) -> Aiding:
    """Aiding of a fit without the site, with the mistake for which the site was left out.

    A finding on a mirrored axis replaces that on swapped axes.
    """
    others = [one for one in reported.mistakes if mistake.code != MIRRORED_AXIS or one.code != "swapped-axes"]
    return replace(reported, mistakes=(*of_gaps, *others, mistake))


@dataclass(eq=False)
class _Selection:
    """Trial of sensors one after the other, each together with the sensors accepted before it."""

    samples: Samples
    solver: Callable[..., AidedFit]
    rotation: Floats | None  # mounting of the magnetometer on the body, if it differs from the recorded axes
    site: Site | None
    dip_deg: float
    is_auto: bool
    standing: _Candidate  # fit with the sensors accepted so far
    mistakes: list[Mistake]
    used: tuple[str, ...] = ()
    turned: AidedFit | None = None  # fit of which only the rotation is used
    reports: list[AidingSensor] = field(default_factory=list)
    was_elsewhere: bool = False

    @property
    def best(self) -> AidedFit:
        """The fit with the sensors accepted so far."""
        return self.standing.aided

    @property
    def is_elsewhere(self) -> bool:
        """Whether a fit shows that the recording was not made at the site."""
        return self.was_elsewhere or is_at_another_site(self.best, self.site)

    def try_sensor(self, name: str) -> None:
        """Accept a sensor if it contradicts nothing and, for ``auto``, improves the fit; else report the reason."""
        if (mistake := self._mistake_of(name)) is not None:
            self.reports.append(AidingSensor(name, is_used=False, reason=mistake.words, code=mistake.code))
            return
        replaced = [used for used in self.used if name in VERTICAL_SENSORS and used in VERTICAL_SENSORS]
        tried = (*(used for used in self.used if used not in replaced), name)
        try:
            aided = self.solver(tried, rotation=self.rotation, near=self.best)
        except FitError as error:
            self.reports.append(AidingSensor(name, is_used=False, reason=error.message))
            return
        self.was_elsewhere = self.was_elsewhere or is_at_another_site(aided, self.site)
        claims = claim_deg(self.best, self.dip_deg), claim_deg(aided, self.dip_deg)
        if (contradiction := _contradiction(self.samples, aided, name) or divergence(name, *claims)) is not None:
            self.mistakes += [] if self.is_auto else [contradiction]
            report = AidingSensor(name, is_used=False, reason=contradiction.words, code=contradiction.code)
            self.reports.append(report)
            return
        report = AidingSensor(name, True, change_deg(self.best, aided, self.dip_deg), *claims)
        trial = _AidTrial(self.standing, _Candidate(self.samples, aided, self.rotation))
        if against := trial.objection(report) if self.is_auto else trial.claims_more(report):
            turned = self._take_rotation(trial, report, against)
            self.reports.append(turned or replace(report, is_used=False, reason=against))
            return
        if name in VERTICAL_SENSORS and not self.is_auto and self.turned is not None:
            replaced, self.turned = [*replaced, self.turned.aiding[-1]], None
        self._report_replaced(replaced, name)
        self.reports.append(report)
        self.standing, self.used = trial.candidate, tried

    def _mistake_of(self, name: str) -> Mistake | None:
        """Mistake of a sensor that the recording shows without a fit; None if there is none."""
        drops = next((mistake for mistake in reversed(self.mistakes) if mistake.aid == name and mistake.drops), None)
        if drops is None and name == "attitude":
            drops = compass_yaw_mistake(self.samples, self.best, self.dip_deg)
            self.mistakes += [] if drops is None else [drops]
        if drops is None and name == "dip":
            drops = lean_mistake(self.samples, self._body_fit(), claim_deg(self.best, self.dip_deg))
            self.mistakes += [] if drops is None or self.is_auto else [drops]
        return drops

    def _body_fit(self) -> AidedFit:
        """The fit with the accepted sensors, rotated into body axes if the rotation is known."""
        if self.rotation is None or self.best.has_rotation:
            return self.best
        return replace(self.best, parameters=replace(self.best.parameters, rotation=self.rotation))

    def _take_rotation(self, trial: _AidTrial, report: AidingSensor, against: str) -> AidingSensor | None:
        """Use the rotation alone of a sensor that shows the vertical; None if its rotation is not used.

        The rotation is that of the first such sensor that was requested, or whose rotation is significant.
        """
        is_asked = not self.is_auto and trial.sees_mounting
        words = f"{against}; {ROTATION_ALONE}" if is_asked else trial.rotation_words(report)
        if self.turned is not None or not words:
            return None
        self.turned = trial.aided
        changed = turned_deg(trial.aided.parameters.rotation, self.dip_deg)
        return replace(report, heading_change_deg=changed, after_deg=report.before_deg, reason=words)

    def _report_replaced(self, replaced: Sequence[str], name: str) -> None:
        """Report for vertical sensors that were accepted before that the sensor `name` replaces them."""
        instead = f"{name} shows the vertical as well" + (", and better" if self.is_auto else ": name one of them")
        self.reports = [
            replace(each, is_used=False, reason=instead) if each.name in replaced else each for each in self.reports
        ]

    def aiding(self) -> Aiding:
        """Results of the aiding sensors; a sensor of which only the rotation is used contributes only that."""
        best, mistakes = self.best, self.mistakes
        if "rate" in self.used and self.samples.rate is not None:
            mistakes = [*mistakes, *one_axis_mistakes(self.samples.rate - best.parameters.gyro_bias)]
        is_seen = best.has_rotation and self.is_auto
        source = best if self.turned is None or is_seen else self.turned
        aiding = Aiding.of(source, each=tuple(self.reports), mistakes=tuple(mistakes))
        return replace(aiding, excess_variance=best.excess_variance)


def _contradiction(samples: Samples, aided: AidedFit, name: str) -> Mistake | None:
    """Mistake of a sensor that contradicts the gyro or the magnetometer in a fit with it; None if they agree."""
    if error := aided.gyro_scale_error:
        return gyro_scale_mistake(error) if name == "rate" else gyro_contradiction(name, error)
    return implausible_vertical(aided, name) or (lean_mistake(samples, aided) if name == "dip" else None)


def _site_mistake(bent: AidedFit, without: Aiding, site: Site) -> Mistake | None:
    """Mistake if the fitted dip contradicts the site's, from fits with and without the site; None if both agree."""
    if without.dip_deg is None:
        return wrong_dip_mistake(dip_of(bent), site) if is_at_another_site(bent, site) else None
    if not is_other_dip(without.dip_deg, site, without.dip_sigma_deg or 0.0):
        return None
    return mirrored_axis(without.dip_deg, site, without.rotation) or wrong_dip_mistake(without.dip_deg, site)


def available(samples: Samples) -> tuple[str, ...]:
    """Names of the aiding sensors for which a recording has columns.

    >>> from flinders.core.samples import Samples
    >>> available(Samples.of([[1.0, 2.0, 3.0]], time=[0.0], acceleration=[[0.0, 0.0, -9.8]]))
    ('dip',)
    """
    return tuple(
        name for name, term in TERMS.items() if all(getattr(samples, column) is not None for column in term.needs)
    )


def change_deg(first: AidedFit, second: AidedFit, dip_deg: float) -> float:
    """Difference in heading of a level vehicle between two corrections, rms in degrees, without the mean difference.

    Both corrections are in the magnetometer's own axes; the rotation against the body does not matter.
    """
    heading, fields = level_turn(dip_deg)
    readings = first.parameters.offset + fields.T @ first.parameters.shape
    corrected = np.linalg.solve(second.parameters.shape, (readings - second.parameters.offset).T)
    errors, _ = heading_errors(corrected, heading)
    return float(np.rad2deg(np.sqrt(np.mean(errors**2))))


def claim_deg(aided: AidedFit, dip_deg: float) -> float:
    """Claimed worst level heading error, 1 σ, in degrees."""
    return min(level_error(aided.ellipsoid, aided.covariance[:9, :9], dip_deg=dip_deg).worst, 180.0)


def _plain_ellipsoid(samples: Samples) -> Ellipsoid:
    """Ellipsoid of the magnetometer alone by the likelihood, else by the robust start."""
    readings = Readings.of(samples.field)
    try:
        return Likelihood().estimate(readings).ellipsoid
    except FitError:
        return start_ellipsoid(readings)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A fit, and the fits of parts of its readings for cross-validation, which are computed at first use."""

    samples: Samples
    aided: AidedFit
    rotation: Floats | None

    @cached_property
    def fold_parameters(self) -> list[Parameters]:
        """Parameters of the fits without each fold in turn; body axes of unknown rotation are those of the sensor."""
        rotation = self.rotation if self.aided.has_rotation else None
        return fit_folds(self.samples, self.aided.aiding, rotation, self.aided)

    def hold_out_misfit(self, vertical: str | None) -> HoldOutMisfit:
        """Misfit of the left-out readings; `vertical` is the kind of sensor whose vertical is used."""
        return hold_out_misfit(self.samples, self.fold_parameters, vertical)


class _AidTrial(NamedTuple):
    """Trial of one more sensor: the fits without and with it."""

    standing: _Candidate
    candidate: _Candidate

    @property
    def aided(self) -> AidedFit:
        """The fit with the sensor."""
        return self.candidate.aided

    def objection(self, report: AidingSensor) -> str:
        """Reason why the sensor does not improve the fit, in words; empty if it does."""
        if report.after_deg > MAX_AUTO_CLAIM_RATIO * report.before_deg:
            return f"claims no less: {figures(report.after_deg)}° with it, {figures(report.before_deg)}° without"
        before, after = self._misfit(self.standing).length, self._misfit(self.candidate).length
        if not after <= MAX_MISFIT_RATIO * before:
            return f"readings that were left out are {after / before - 1.0:.0%} farther off with it"
        return ""

    def claims_more(self, report: AidingSensor) -> str:
        """Reason to leave out a requested sensor, that the fit with it claims more heading error; else empty.

        The first sensor is never left out for this reason, because a fit of the magnetometer alone claims too little if
        residuals are correlated.
        """
        if not self.standing.aided.aiding or report.after_deg <= MAX_CLAIM_RATIO * report.before_deg:
            return ""
        return claims_more(report.after_deg, report.before_deg)

    @property
    def sees_mounting(self) -> bool:
        """Whether the sensor shows the vertical and observes a plausible mounting."""
        return self.aided.has_rotation and self.aided.aiding[-1] in VERTICALS and not self._is_far()

    def rotation_words(self, report: AidingSensor) -> str:
        """Effect of the rotation that the sensor gives, in words; empty if it is not significant or does not help."""
        covariance = self.aided.rotation_covariance
        if covariance is None or self.standing.aided.has_rotation or self.aided.aiding[-1] not in VERTICALS:
            return ""
        angle = rotation_vectors(self.aided.parameters.rotation)
        is_proven = float(angle @ np.linalg.solve(covariance, angle)) >= MIN_ROTATION_CHI2
        if not is_proven or self._is_far() or report.after_deg > MAX_VERTICAL_CLAIM_RATIO * report.before_deg:
            return ""
        before, after = self._misfit(self.standing).height, self._misfit(self.candidate).height
        if not after < before:
            return ""
        turned, sigma = float(np.linalg.norm(angle)), float(np.sqrt(np.trace(covariance) / 3.0))
        return (
            f"the magnetometer is turned against it by {_degrees(turned)}° (± {_degrees(sigma)}°); sine of the dip "
            f"scatters by {_degrees(after)}° with that and by {_degrees(before)}° without, in left-out readings; "
            "offset and shape stay"
        )

    def _is_far(self) -> bool:
        """Whether the rotation is implausibly large for instruments on one body."""
        mounted = np.eye(3) if self.candidate.rotation is None else self.candidate.rotation
        apart = rotation_vectors(self.aided.parameters.rotation @ mounted.T)
        return bool(np.rad2deg(np.linalg.norm(apart)) > MAX_MOUNTING_DEG)

    def _misfit(self, candidate: _Candidate) -> HoldOutMisfit:
        """Misfit of the left-out readings of a candidate, with the vertical of this sensor."""
        return candidate.hold_out_misfit(next((name for name in self.aided.aiding if name in VERTICALS), None))


def _degrees(radians: float) -> str:
    """An angle in degrees as text, to its significant digits."""
    return figures(float(np.rad2deg(radians)))


def turned_deg(rotation: Floats, dip_deg: float) -> float:
    """Heading change of a level vehicle by a rotation of the magnetometer, rms in degrees, at most 180.

    The square of the change is z² + ½ tan² I (x² + y²), as in `flinders.fitting.aiding.Aiding.alignment_error_deg`.

    >>> from flinders.likelihood.gyro import rotations
    >>> round(turned_deg(rotations(np.array([[0.0, 0.0, 0.01]]))[0], 60.0), 3)
    0.573
    """
    x, y, z = rotation_vectors(rotation).tolist()
    return min(float(np.rad2deg(np.sqrt(z**2 + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x**2 + y**2)))), 180.0)
