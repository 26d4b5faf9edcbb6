"""Renewal of a calibration without turning the vehicle: from one or a few poses at known headings.

At a pose the field of the site has a known direction q in the vehicle's axes, and the mean reading is

    x̄ = b + S q + S δq + n

with the shape S of the earlier calibration and its uncertainty, the error δq from heading, tilt and dip, and the noise
n. Generalised least squares with the earlier shape as prior gives the offset b. The covariance includes the errors of
the poses: an error of the known heading by 1° moves the offset by 1/57 of the field, which causes errors at other
headings.

ArduPilot's large vehicle calibration uses the same method, but states no uncertainty.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> earlier = calibrate.fit(tumble.samples)
>>> reading = tumble.sensor.matrix @ [25.0, 0.0, 43.3] + tumble.sensor.offset
>>> from flinders.likelihood.site_field import Site
>>> site = Site(inclination_deg=60.0)
>>> fit = refresh_at_headings([np.tile(reading, (20, 1))], earlier, [0.0], site=site)
>>> fit.verdict, fit.evidence.diagnosis.refreshed.offset_change.round(1) + 0.0
('limited', array([0., 0., 0.]))

In a drive the known headings are the courses over ground on straight stretches, of a vehicle that points in its
direction of motion. Its course then differs from its heading only by the crab angle, from wind, current or a slope. In
steady wind the crab angle is e(h) = a sin h + b cos h over the heading h, with the same a and b on all stretches. It
has the same effect as hard iron, and its prior is common to all stretches (`PoseSigmas.crab_deg`).

>>> from types import SimpleNamespace
>>> from flinders.core.samples import Samples
>>> time = np.arange(0.0, 60.0, 0.1)
>>> along = np.where(time < 30.0, 0.0, np.pi / 2.0)
>>> velocity = SimpleNamespace(time=time, values=10.0 * np.column_stack([np.cos(along), np.sin(along)]))
>>> samples = Samples.of(np.ones((600, 3)), unit="uT", time=time)
>>> [(round(stretch.course_deg) % 360, len(stretch.samples)) for stretch in stretches(samples, velocity)]
[(0, 288), (90, 288)]
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.calibration import Calibration
from flinders.core.keywords import check_keywords
from flinders.errors import FitError, UsageError
from flinders.findings import link_causes
from flinders.findings.catalogue import CALIBRATION_FINDINGS
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Diagnosis, Evidence, Residuals
from flinders.fitting.judgement import with_mounting_error
from flinders.fitting.record import expected_error
from flinders.fitting.refreshing import (
    changes_since,
    known_shape,
    refuse_unfit,
    samples_of,
    strength_of,
    with_rotation_of,
)
from flinders.fitting.result import Fit, Judgement, Refused
from flinders.fitting.verdict import judge_calibration
from flinders.geometry.angles import wrap_360
from flinders.geometry.ellipsoid import Ellipsoid, parameter_derivatives, symmetric_matrix
from flinders.heading.stationary import rests
from flinders.likelihood import dip
from flinders.summary.coverage import Coverage
from flinders.summary.pooling import p_value_of
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.findings import Condition, Finding
    from flinders.fitting.calibrate import AnyReadings
    from flinders.likelihood.site_field import Site
    from flinders.readers._resample import TimeSeries

METHOD: Final = "known-heading"

CONDITIONS_OF_POSES: Final[tuple[Condition, ...]] = ("same-soft-iron", "uniform-field", "constant-iron")
"""Conditions of the verdict on a calibration from poses."""

MIN_SHAPE_SIGMA: Final = 1e-4
"""Smallest standard deviation of the shape, as a share of the radius, as in ``refresh.c``."""

BLOCKS_PER_POSE: Final = 10
"""Count of blocks of a pose; the scatter of their means gives the error of the mean, also for correlated noise."""

MAX_MOTION_DEG: Final = 5.0
"""Largest angle of a reading from the mean reading of a vehicle at rest."""


@dataclass(frozen=True, slots=True)
class PoseSigmas:
    """Errors of poses, 1 σ, in degrees: of the heading, of the tilt about each level axis, of the dip of the site.

    `crab_deg` is 1 σ of a and b in an error a sin h + b cos h of a heading h, common to all poses, such as the crab
    angle in steady wind.
    """

    heading_deg: float = 1.0
    tilt_deg: float = 1.0
    dip_deg: float = 1.0
    crab_deg: float = 0.0

    def __post_init__(self) -> None:
        """Refuse values that cannot be standard deviations of an angle."""
        for name in ("heading_deg", "tilt_deg", "dip_deg"):
            if not 0.0 < getattr(self, name) <= 45.0:
                raise UsageError(
                    f"sigma of {name.removesuffix('_deg')} is {getattr(self, name):g}°: need more than 0°, up to 45°"
                )
        if not 0.0 <= self.crab_deg <= 45.0:
            raise UsageError(f"sigma of crab is {self.crab_deg:g}°: need 0° to 45°")


DEFAULT_SIGMAS: Final = PoseSigmas()


@check_keywords()
def refresh_at_headings(
    poses: Sequence[AnyReadings],
    previous: Fit,
    headings_deg: Sequence[float],
    *,
    site: Site | None = None,
    sigmas: PoseSigmas = DEFAULT_SIGMAS,
    target_deg: float = 1.0,
) -> Fit:
    """Renew the hard iron of a calibration from poses at known headings.

    Parameters
    ----------
    poses : sequence of Samples, Recording, (N, 3) array-like, path, open file or data frame
        A recording of each pose, at rest. The tilt is measured if there is an accelerometer; else the vehicle must be
        level.
    previous : Fit
        As for `flinders.refresh`.
    headings_deg : sequence of float
        Magnetic heading of the vehicle at each pose: the true one less the declination.
    site : Site
        As for `flinders.refresh`, with its inclination.
    sigmas : PoseSigmas, optional
        Errors of headings, tilts and the dip.
    target_deg : float
        Worst heading error that is good enough, in degrees.

    Raises
    ------
    Refused
        If the fit cannot be trusted; the error has the fit.
    UsageError
        Without a dip, without a heading for each pose, for a vehicle that was moved, and as for `flinders.refresh`.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> from flinders.likelihood.site_field import Site
    >>> tumble = simulate.tumble(seed=1)
    >>> moved = replace(tumble.sensor, offset=tumble.sensor.offset + [8.0, -5.0, 3.0])
    >>> rng, headings_deg = np.random.default_rng(1), [0.0, 90.0, 180.0, 270.0]
    >>> fields = [[25.0 * np.cos(h), -25.0 * np.sin(h), 43.3] for h in np.radians(headings_deg)]
    >>> poses = [moved.read(np.tile(field, (50, 1)), rng) for field in fields]
    >>> site = Site(inclination_deg=60.0)
    >>> fresh = refresh_at_headings(poses, calibrate.fit(tumble.samples), headings_deg, site=site)
    >>> fresh.verdict, bool(np.all(np.abs(fresh.calibration.offset - moved.offset) < 4.0 * fresh.claim.offset_sigma))
    ('good', True)
    """
    refuse_unfit(previous)
    dip_deg = None if site is None else site.inclination_deg
    if site is None or dip_deg is None:
        raise UsageError(
            "a pose needs the dip of the field, found none: give the site with its dip", hint={"site": None}
        )
    if not poses or len(poses) != len(headings_deg):
        raise UsageError(f"{len(poses)} poses and {len(headings_deg)} headings: need a heading for each pose")
    known = known_shape(previous, site)
    shape = symmetric_matrix(known.entries)
    rotation = previous.calibration.rotation_matrix
    recordings = [samples_of(pose, previous) for pose in poses]
    readings = np.concatenate([recording.field for recording in recordings])
    seen = [Pose.of(recording, shape) for recording in recordings]
    equations = _Equations.of(seen, np.radians(headings_deg), math.radians(dip_deg), sigmas, shape, rotation)
    parameters, covariance, chance = equations.solve(known.entries, known.covariance)
    ellipsoid = Ellipsoid.of_parameters(parameters)
    distortion = previous.evidence.residuals.distortion
    error, structure_deg = expected_error(ellipsoid, covariance, dip_deg=dip_deg, distortion=distortion)
    evidence = Evidence(
        method=METHOD,
        samples=len(readings),
        noise=math.sqrt(sum(pose.noise**2 for pose in seen) / len(seen)),
        coverage=Coverage.of_cloud(Summary.of(readings).cloud, ellipsoid),
        residuals=Residuals(distortion=distortion),
        diagnosis=Diagnosis(refreshed=changes_since(previous, ellipsoid, dip_deg)),
    )
    calibration = _calibration(ellipsoid, previous, site)
    claim = Claim(
        calibration,
        covariance,
        heading_error_deg=error,
        structure_deg=structure_deg,
        dip_deg=dip_deg,
        target_deg=target_deg,
    )
    fit = Fit(calibration, evidence, claim, Judgement())
    return _with_findings(with_mounting_error(fit, site.alignment_sigma_deg), chance)


def _with_findings(fit: Fit, chance: float) -> Fit:
    """Add findings and conditions to a fit; raises `Refused` if a finding refuses it."""
    judgement = Judgement(link_causes(_judge(fit, chance)))
    if judgement.verdict == "refused":
        raise Refused(replace(fit, judgement=judgement))
    return replace(fit, judgement=replace(judgement, conditions=CONDITIONS_OF_POSES))


def is_still(field: Floats, shape: Floats) -> bool:
    """Whether (N, 3) readings are those of a vehicle at rest: their median angle from the mean reading is small."""
    off = np.linalg.norm(np.linalg.solve(shape, (field - field.mean(axis=0)).T), axis=0)
    return math.degrees(float(np.median(off))) <= MAX_MOTION_DEG


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Mean reading of a vehicle at rest, with its noise and the vertical."""

    mean: Floats  #: (3,): mean reading
    noise: float  #: standard deviation of one component of a reading
    noise_of_mean: float  #: standard deviation of one component of the mean
    down: Floats  #: (3,): unit vector down in the vehicle's axes, by its accelerometer, else z

    @classmethod
    def of(cls, samples: Samples, shape: Floats) -> Self:
        """Create the pose of a recording at rest.

        Raises `UsageError` if the vehicle was moved.
        """
        if len(samples) == 0:
            raise UsageError(f"{samples.source} has no readings: record the pose for some seconds")
        mean = samples.field.mean(axis=0)
        if not is_still(samples.field, shape):
            raise UsageError(
                f"{samples.source}: readings vary as if the vehicle was moved or the field was not steady: "
                "record each pose at rest"
            )
        noise = float(np.sqrt(np.mean(np.square(samples.field - mean))))
        blocks = [block.mean(axis=0) for block in np.array_split(samples.field, min(BLOCKS_PER_POSE, len(samples)))]
        of_mean = math.sqrt(float(np.var(blocks, axis=0, ddof=1).mean()) / len(blocks)) if len(blocks) > 1 else noise
        down = (
            np.zeros(3)
            if samples.acceleration is None
            else dip.accelerometer_verticals(samples.acceleration)[0].mean(axis=0)
        )
        length = float(np.linalg.norm(down))
        return cls(mean, noise, of_mean, down / length if length > 0.0 else np.array([0.0, 0.0, 1.0]))

    @property
    def level(self) -> tuple[Floats, Floats]:
        """(3,) unit vectors forward and right in the vehicle's axes, perpendicular to `down`."""
        forward = np.array([1.0, 0.0, 0.0]) - self.down[0] * self.down
        forward /= np.linalg.norm(forward)
        return forward, np.cross(self.down, forward)

    def field(self, heading: float, inclination: float) -> tuple[Floats, Floats]:
        """Direction of the field (3,) in the vehicle's axes, and its derivatives (3, 4); angles in rad.

        The derivatives are by the dip, the heading, and the tilt about forward and right.
        """
        forward, right = self.level
        north = math.cos(heading) * forward - math.sin(heading) * right
        west = -math.sin(heading) * forward - math.cos(heading) * right
        flat, height = math.cos(inclination), math.sin(inclination)
        seen = flat * north + height * self.down
        moved = (flat * self.down - height * north, flat * west, np.cross(forward, seen), np.cross(right, seen))
        return seen, np.column_stack(moved)


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Linear equations x̄ = b + J s + noise of K poses, with the offset b and the six entries s of the shape."""

    design: Floats  # (3K, 9): derivatives of the mean readings by b and s
    readings: Floats  # (3K,): mean readings x̄
    covariance: Floats  # (3K, 3K): covariance of the noise

    @classmethod
    def of(
        cls,
        poses: Sequence[Pose],
        headings: Floats,
        inclination: float,
        sigmas: PoseSigmas,
        shape: Floats,
        rotation: Floats,
    ) -> Self:
        """Linearize about the known shape; errors of dip and crab angle are common to all poses."""
        size = 3 * len(poses)
        design, dips, turns, covariance = np.empty((size, 9)), np.empty(size), np.empty(size), np.zeros((size, size))
        own = np.square(np.radians([sigmas.heading_deg, sigmas.tilt_deg, sigmas.tilt_deg]))
        for place, (pose, heading) in enumerate(zip(poses, headings, strict=True)):
            rows = slice(3 * place, 3 * place + 3)
            seen, moved = pose.field(float(heading), inclination)
            design[rows] = parameter_derivatives(np.eye(3), np.tile((rotation.T @ seen)[:, np.newaxis], 3))
            dips[rows], *others = (shape @ rotation.T @ moved).T
            errors = np.column_stack(others)
            turns[rows] = errors[:, 0]
            noise = pose.noise_of_mean**2 + np.square(MIN_SHAPE_SIGMA) * np.trace(shape) ** 2
            covariance[rows, rows] = errors * own @ errors.T + noise * np.eye(3)
        covariance += np.radians(sigmas.dip_deg) ** 2 * np.outer(dips, dips)
        around = np.repeat(headings, 3)
        covariance += np.radians(sigmas.crab_deg) ** 2 * np.cos(around[:, np.newaxis] - around) * np.outer(turns, turns)
        return cls(design, np.concatenate([pose.mean for pose in poses]), covariance)

    def solve(self, entries: Floats, prior: Floats) -> tuple[Floats, Floats, float]:
        """Offset and shape (9,), their covariance (9, 9), and the p-value of the residuals.

        `entries` (6,) and `prior` (6, 6) are the earlier shape and its covariance.
        """
        precision, known = np.linalg.inv(self.covariance), np.linalg.inv(prior)
        matrix, right = self.design.T @ precision @ self.design, self.design.T @ precision @ self.readings
        matrix[3:, 3:] += known
        right[3:] += known @ entries
        covariance: Floats = np.linalg.inv(matrix)
        solution = covariance @ right
        left, moved = self.readings - self.design @ solution, solution[3:] - entries
        freedom = len(left) - 3
        chance = p_value_of(float(left @ precision @ left + moved @ known @ moved), freedom) if freedom else 1.0
        return solution, covariance, chance


def _calibration(ellipsoid: Ellipsoid, previous: Fit, site: Site | None) -> Calibration:
    """The calibration of an ellipsoid, with the axes and the rotation of the earlier calibration."""
    known = previous.calibration
    made = Calibration.from_ellipsoid(
        ellipsoid.centre,
        ellipsoid.shape,
        field_strength=strength_of(known, site),
        raw=known.raw,
        axes=known.axes,
        sensor=known.sensor,
        frame=known.frame,
    )
    return with_rotation_of(made, previous)


def _judge(fit: Fit, chance: float) -> Iterator[Finding]:
    """Findings of a fit to poses, from the p-value `chance` of its residuals."""
    yield from judge_calibration(
        fit.calibration,
        ("poses-contradict", "heading-error", *CALIBRATION_FINDINGS),
        target_deg=fit.claim.target_deg,
        values={"next_step": ("add-poses",)},
        level_worst_deg=fit.heading_error_deg.worst,
        poses_by_chance=chance,
    )


MIN_SPEED: Final = 3.0
"""Smallest speed over ground in m/s at which a course is used as a heading."""
MIN_STRAIGHT_S: Final = 5.0
"""Duration in s of the shortest straight stretch."""
CRAB_SIGMA_DEG: Final = 2.0
"""Standard deviation in degrees of the crab angle, from wind, current or a slope."""
MIN_READINGS: Final = 20
"""Smallest count of readings in a stretch."""
MAX_STRETCHES: Final = 100
"""Largest count of stretches; the longest ones are used."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A straight stretch of a drive: its readings, its true course, and the 1 σ scatter of the course, in degrees."""

    samples: Samples
    course_deg: float
    scatter_deg: float


def stretches(samples: Samples, velocity: TimeSeries, *, slowest: float = MIN_SPEED) -> list[Stretch]:
    """Find the stretches of a drive that are straight and fast enough.

    Raises `UsageError` for readings without times, or if readings and velocity do not overlap in time.

    Parameters
    ----------
    samples : Samples
        Readings with times.
    velocity : TimeSeries
        (M,) times on the clock of the readings, and (M, 2) velocity over ground in m/s, north and east.
    slowest : float, m/s
        Smallest speed at which a course is used.
    """
    if samples.time is None:
        raise UsageError(f"{samples.source} has no times: need a log with times to use courses")
    (first, last), (begin, end) = samples.time[[0, -1]], velocity.time[[0, -1]]
    if first > end or begin > last:
        raise UsageError(
            f"{samples.source} was recorded from {first:.0f} to {last:.0f} s on its clock, and courses from "
            f"{begin:.0f} to {end:.0f} s: record both at the same time, with synchronised clocks"
        )
    north, east = velocity.values.T
    course = np.where(np.hypot(north, east) >= slowest, wrap_360(np.rad2deg(np.arctan2(east, north))), np.nan)
    step = float(np.median(np.diff(velocity.time))) if len(velocity.time) > 1 else np.inf
    least = max(round(MIN_STRAIGHT_S / step), 8) if step > 0.0 else 8
    straight = []
    for rest in rests(course, least_readings=least):
        begin, end = velocity.time[rest.start], velocity.time[rest.stop - 1]
        part = samples[(samples.time >= begin) & (samples.time <= end)]
        if len(part) >= MIN_READINGS:
            straight.append(Stretch(part, rest.heading_deg, max(rest.spread_deg, rest.sigma_deg)))
    return sorted(straight, key=lambda stretch: -len(stretch.samples))[:MAX_STRETCHES]


@check_keywords()
def refresh_on_courses(
    recording: AnyReadings,
    previous: Fit,
    velocity: TimeSeries,
    *,
    declination_deg: float,
    slowest: float = MIN_SPEED,
    crab_deg: float = CRAB_SIGMA_DEG,
    site: Site | None = None,
    target_deg: float = 1.0,
) -> Fit:
    """Renew the hard iron of a calibration from the straight stretches of a drive.

    The vehicle must point in its direction of motion; a multirotor does not.

    Parameters
    ----------
    recording, previous, site, target_deg
        As for `refresh_at_headings`.
    velocity : TimeSeries
        As for `stretches`, such as `Instrument.velocity`.
    declination_deg : float
        Declination at the place, east positive.
    slowest : float, m/s
        Smallest speed at which a course is used.
    crab_deg : float, degrees
        Difference between course and heading, 1 σ.

    Raises
    ------
    FitError
        If no stretch is straight, fast enough and in a steady field; `Refused` as `refresh_at_headings`.
    UsageError
        For readings without times, or that do not overlap with the velocity, and as `refresh_at_headings`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from flinders import simulate
    >>> from flinders.core.samples import Samples
    >>> from flinders.fitting import calibrate
    >>> from flinders.likelihood.site_field import Site
    >>> tumble = simulate.tumble(seed=1)
    >>> time = np.arange(0.0, 80.0, 0.1)
    >>> along = np.radians(90.0 * (time // 20.0))                             # 20 s each to north, east, south and west
    >>> way = np.column_stack([np.cos(along), np.sin(along)])
    >>> field = np.column_stack([25.0 * way * [1.0, -1.0], np.full(800, 43.3)])
    >>> drive = Samples.of(tumble.sensor.read(field, np.random.default_rng(1)), unit="uT", time=time)
    >>> velocity = SimpleNamespace(time=time, values=10.0 * way)                                  # (M, 2) m/s
    >>> asked = {"declination_deg": 0.0, "site": Site(inclination_deg=60.0)}
    >>> refresh_on_courses(drive, calibrate.fit(tumble.samples), velocity, **asked).verdict
    'good'
    """
    samples = replace(samples_of(recording, previous), frame=previous.calibration.frame)
    straight = stretches(samples, velocity, slowest=slowest)
    steady = _steady_stretches(straight, previous)
    if not steady:
        raise FitError(
            f"no stretch of {MIN_STRAIGHT_S:g} s at {slowest:g} m/s or more with a steady field (of {len(straight)} "
            "straight stretches): drive straight on several headings, on level ground and away from iron",
            found=len(straight),
            slowest=slowest,
        )
    headings = [stretch.course_deg - declination_deg for stretch in steady]
    scatter = float(np.median([stretch.scatter_deg for stretch in steady]))
    sigmas = replace(DEFAULT_SIGMAS, heading_deg=min(max(scatter, DEFAULT_SIGMAS.heading_deg), 45.0), crab_deg=crab_deg)
    poses = [stretch.samples for stretch in steady]
    return refresh_at_headings(poses, previous, headings, site=site, sigmas=sigmas, target_deg=target_deg)


def _steady_stretches(straight: Sequence[Stretch], previous: Fit) -> list[Stretch]:
    """Stretches on which the field is steady, because the vehicle neither rolls nor passes iron."""
    shape = symmetric_matrix(known_shape(previous, None).entries)
    return [stretch for stretch in straight if is_still(stretch.samples.field, shape)]
