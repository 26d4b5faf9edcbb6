"""Benefit of each aid in addition to the magnitude of the field, as Markdown.

`benchmarks.magyc` has MAGYC's simulation.

    python -m benchmarks.terms [--tables sim,aids,nees,level,magnet,drives,attitudes,real,time] [--trials N] [--seeds N]
    python -m benchmarks.terms --tables nees --motions rocked --cases "rate; attitude"

sim     SIM1 and SIM2 of Troni and Whitcomb, a bare sensor; the motions are ours, see `sim`.
aids    S4t, `simulate.tumble(motion="swayed")`: level heading error of each aid and of all of them.
nees    Squared error over claimed variance for each parameter, mean over trials: 1 is true; and the heading error
                (rms) over the claim. On S4t, on a tumble by hand and on MAGYC's MAM, 1,500 readings each; the gyro's
                scales, the accelerometer's bias, axes and site vary between trials by the priors of the fit.
level   S7, a level turn, with the field of the site known: heading error level and tilted.
magnet  A magnet of up to 100 µT passes: heading error, offset and rotation over the claims of `flinders.fit`.
drives  Drives of half a minute: level heading error over the claim of `flinders.fit`, without and with an aid.
attitudes  Drives and flights with slow errors or a lag of the attitude: verdicts and claims of `flinders.fit`.
real    Real recordings: see `benchmarks.terms_recordings`.
time    CPU seconds, and peak memory of a separate process.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise, product, repeat
from statistics import mode
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from benchmarks import terms_recordings
from benchmarks.datasets import FIELD_STRENGTH, dataset, heading_error_deg
from benchmarks.emulations.magyc_ls import magyc_ls
from benchmarks.emulations.px4_observer import px4_observer
from benchmarks.emulations.sar_kf import sar_kf
from benchmarks.emulations.sar_ls import sar_ls
from benchmarks.magyc import MOTIONS as MOTIONS_DEG
from benchmarks.magyc import OFFSET_MG, SEED, likelihood, wrapped_rms
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import FlindersError
from flinders.estimators.aiding import fit_aided
from flinders.estimators.data import Readings
from flinders.estimators.level import Level
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import symmetric_matrix, upper_entries
from flinders.geometry.quaternions import from_matrix
from flinders.geometry.rotation import perpendicular_vectors, rotation_vectors
from flinders.heading.attitude import magnetic_heading_deg
from flinders.heading.error_propagation import level_error, level_turn
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA, GRAVITY
from flinders.likelihood.gyro import SCALE_SIGMA, scale_matrix
from flinders.likelihood.parameters import Parameters
from flinders.likelihood.site_field import Site
from flinders.simulate.sensor import symmetric_power

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders import Fit
    from flinders.arrays import Floats
    from flinders.estimators.aiding import AidedFit
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.parameters import ParameterLayout
    from flinders.simulate import Simulated, Trajectory

SIGMA: Final = 0.5
"""Noise of the simulated recordings, µT."""

TILTS_DEG: Final = (0.0, 2.0, 5.0, 10.0, 20.0)
ATTITUDE_NOISE_DEG: Final = 0.5
"""Noise of a logged attitude about each axis."""

Answer = tuple["Floats", "Floats"]
"""Offset (3,) and matrix (3, 3) up to a factor: corrected = matrix @ (raw − offset)."""


# (a) SIM1 and SIM2


def sim(name: str, seed: int) -> Samples:
    """Recording of 60 s at 100 Hz, 1 mG and 5 mrad/s; SIM1 tumbles slowly, SIM2 rocks by 5°, 5° and 90°."""
    rng = np.random.default_rng([SEED, seed])
    turning: Trajectory
    if name == "SIM2":
        turning = simulate.rocked(rng, seconds=60.0, rate_hz=100.0, amplitudes_deg=MOTIONS_DEG["5/5/90"])
    else:
        turning = simulate.hand_tumble(rng, seconds=60.0, rate_hz=100.0, speed=0.5, smoothness=1.5)
    raw = simulate.in_body_axes(turning.attitudes, np.array([200.0, -40.0, 480.0])) + OFFSET_MG
    noisy = raw + rng.normal(0.0, 1.0, raw.shape)
    return Samples(noisy, time=turning.time, rate=turning.rate + rng.normal(0.0, 0.005, raw.shape))


def by_ellipsoid(samples: Samples, *, method: Callable[[Samples], Ellipsoid]) -> Answer:
    """Offset and matrix of one of `benchmarks.emulations`, or of a method of Flinders."""
    ellipsoid = method(samples)
    return ellipsoid.centre, np.linalg.inv(ellipsoid.shape)


def level_turn_alone(samples: Samples, *, dip_deg: float) -> Ellipsoid:
    """Ellipsoid of the level turn alone."""
    return Level(dip_deg=dip_deg).estimate(Readings.of(samples)).ellipsoid


def by_aids(samples: Samples, *, terms: Sequence[str], site: Site | None = None, window_s: float = 5.0) -> Answer:
    """Offset and matrix of the joint fit, with its rotation."""
    found = fit_aided(samples, terms, site=site, window_s=window_s)
    return found.parameters.offset, found.matrix


CONTESTANTS: Final[Mapping[str, Callable[[Samples], Answer]]] = {
    "likelihood, magnitude alone": partial(by_ellipsoid, method=likelihood),
    "`sar-ls`": partial(by_ellipsoid, method=sar_ls),
    "`sar-kf`": partial(by_ellipsoid, method=partial(sar_kf, gyro_noise=0.01)),
    "`px4-observer`": partial(by_ellipsoid, method=px4_observer),
    "`magyc-ls`": partial(by_ellipsoid, method=magyc_ls),
    "`magyc-ls`, window=1": partial(by_ellipsoid, method=partial(magyc_ls, window=1)),
    "rate aid, 1 s": partial(by_aids, terms=("rate",), window_s=1.0),
    "rate aid, 5 s": partial(by_aids, terms=("rate",), window_s=5.0),
    "rate aid, 10 s": partial(by_aids, terms=("rate",), window_s=10.0),
}


def sim_score(contestant: Callable[[Samples], Answer], name: str, seed: int) -> float:
    """Error of a method's offset on one recording of SIM1 or SIM2, mG."""
    return float(np.linalg.norm(contestant(sim(name, seed))[0] - OFFSET_MG))


def sim_table(pool: ProcessPoolExecutor, seeds: int) -> Iterator[str]:
    """Yield the table of offset errors on SIM1 and SIM2."""
    yield "| set | method | offset, mG: median | worst |"
    yield "|---|---|---:|---:|"
    for name in ("SIM1", "SIM2"):
        for title, contestant in CONTESTANTS.items():
            errors = list(pool.map(sim_score, repeat(contestant), repeat(name), range(seeds)))
            yield f"| {name} | {title} | {np.median(errors):.3g} | {max(errors):.3g} |"


# (b) S4t, (c) nees


def swayed(trial: int) -> tuple[Simulated, Samples, Site]:
    """S4t: 60 s at 50 Hz in µT, with a logged attitude, and a site whose strength is known to 1 %.

    The mean gain of the sensor is 1, so that the strength of the site is useful.
    """
    rng = np.random.default_rng([SEED, 1, trial])
    imu = simulate.Imu(gyro_bias=rng.normal(0.0, 0.01, 3))
    sensor = simulate.Sensor.random(rng, noise=SIGMA)
    sensor = replace(sensor, matrix=3.0 * sensor.matrix / np.trace(sensor.matrix))
    recording = simulate.tumble(rng, motion="swayed", sensor=sensor, imu=imu)
    assert recording.attitudes is not None
    shaken = simulate.turns(rng.normal(0.0, math.radians(ATTITUDE_NOISE_DEG), (len(recording.attitudes), 3)))
    attitude = from_matrix(recording.attitudes @ shaken)
    logged = replace(recording.samples, attitude=attitude)
    strength, dip = FIELD_STRENGTH * (1.0 + rng.normal(0.0, 0.01)), 60.0 + rng.normal(0.0, 1.0)
    site = Site(strength=strength, inclination_deg=dip, gain_sigma=0.01, inclination_sigma_deg=1.0)
    return recording, logged, site


CALIBRATED_SIGMAS: Final[dict[str, Any]] = {"gyro_scale": 0.0, "acceleration_bias": 0.0}
"""Uncertainties of calibrated instruments as in S4t, which have only noise and a gyro bias."""

AIDED_FITS: Final[Mapping[str, tuple[tuple[str, ...], str, dict[str, Any]]]] = {
    "none: magnitude alone": ((), "", {}),
    "strength of the site ± 1 %": ((), "strength", {}),
    "dip": (("dip",), "", {}),
    "dip, calibrated": (("dip",), "", CALIBRATED_SIGMAS),
    "dip and the site's field, calibrated": (("dip",), "both", CALIBRATED_SIGMAS),
    "rate": (("rate",), "", {}),
    "rate, calibrated": (("rate",), "", CALIBRATED_SIGMAS),
    "rate, dip": (("rate", "dip"), "", {}),
    "rate, dip, calibrated": (("rate", "dip"), "", CALIBRATED_SIGMAS),
    "rate, dip, the site's field, calibrated": (("rate", "dip"), "both", CALIBRATED_SIGMAS),
    "attitude without yaw": (("tilt",), "", {}),
    "attitude": (("attitude",), "", {}),
    "rate, attitude, the site's field": (("rate", "attitude"), "both", {}),
}
"""Terms of each fit, facts on the site that it knows, and uncertainties of its instruments."""


def trial(title: str, number: int) -> tuple[float, float] | None:
    """Level heading errors in degrees of one S4t recording, in axes of the body and in the magnetometer's own.

    None if refused.
    """
    recording, samples, site = swayed(number)
    terms, known, instruments = AIDED_FITS[title]
    if known == "strength":
        site = replace(site, inclination_deg=None)
    try:
        found = fit_aided(samples, terms, site=site if known else None, **instruments)
    except FlindersError:
        return None
    at = found.parameters
    of_body, own = (FIELD_STRENGTH * matrix for matrix in (found.matrix, np.linalg.inv(at.shape)))
    return heading_error_deg(of_body, at.offset, recording), heading_error_deg(own, at.offset, recording)


@cache
def trials_of(pool: ProcessPoolExecutor, title: str, trials: int) -> list[tuple[float, float] | None]:
    """Results of all trials with some aids."""
    return list(pool.map(trial, repeat(title), range(trials), chunksize=4))


def aids_table(pool: ProcessPoolExecutor, trials: int) -> Iterator[str]:
    """Yield the heading error with each aid."""
    yield "| aiding | heading error level, rms ° | of magnitude alone | in own axes ° | of magnitude alone | refused |"
    yield "|---|---:|---:|---:|---:|---:|"
    alone = math.nan
    for title in AIDED_FITS:
        found = trials_of(pool, title, trials)
        told = [one for one in found if one is not None]
        of_body, own = (_rms([one[axes] for one in told]) for axes in (0, 1))
        alone = own if math.isnan(alone) else alone
        ratios = f"{of_body:.3f} | {of_body / alone:.2f} | {own:.3f} | {own / alone:.2f}"
        yield f"| {title} | {ratios} | {found.count(None)} |"


MOTIONS: Final = ("swayed", "hand", "rocked")
"""Motions: S4t, a tumble to all directions in one minute, and MAGYC's MAM in ten minutes."""

CASES: Final[Mapping[str, tuple[tuple[str, ...], bool, float]]] = {
    "site": ((), True, 0.0),
    "dip": (("dip",), False, 0.0),
    "dip, site": (("dip",), True, 0.0),
    "rate": (("rate",), False, 0.0),
    "rate, dip": (("rate", "dip"), False, 0.0),
    "tilt": (("tilt",), False, 0.5),
    "attitude, clean": (("attitude",), False, 0.02),
    "attitude": (("attitude",), False, 0.5),
    "rate, attitude, site": (("rate", "attitude"), True, 0.5),
}
"""Terms, whether the site is known, and the noise of the logged attitude about each axis, degrees."""

MOUNTING_RAD: Final = 0.1
"""Rotation of the magnetometer's axes to the body's, 1 σ about each axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A recording, its site with uncertainties, and the truth."""

    samples: Samples
    site: Site
    true: Parameters


def known(motion: str, attitude_deg: float, number: int) -> Known:
    """Draw sensor, gyro, mounting, site and motion.

    The site's strength is known to 1 %, its dip to 1°, and the mean gain of the sensor is 1.
    """
    rng = np.random.default_rng([SEED, 3, MOTIONS.index(motion), number])
    sensor = simulate.Sensor.random(rng)
    sine, strength = math.sin(math.radians(60.0)), FIELD_STRENGTH * (1.0 + rng.normal(0.0, 0.01))
    true = replace(
        Parameters.at(sensor.offset, 3.0 * FIELD_STRENGTH * sensor.matrix / np.trace(sensor.matrix)),
        rotation=simulate.turns(rng.normal(0.0, MOUNTING_RAD, (1, 3)))[0],
        gyro_bias=rng.normal(0.0, 0.01, 3),
        gyro_scale=rng.normal(0.0, SCALE_SIGMA, 6),
        gyro_turn=rng.normal(0.0, SCALE_SIGMA, 3),
        accelerometer=rng.normal(0.0, np.repeat([ACCELERATION_SIGMA / GRAVITY, GAIN_SIGMA, 0.5 * GAIN_SIGMA], 3)),
        sine=sine,
        direction=simulate.north_and_down(60.0),
    )
    turning, noise, gyro_noise = _motion(motion, rng)
    field = simulate.in_body_axes(turning.attitudes, true.direction) @ true.rotated_shape.T + true.offset
    felt = turning.rate @ np.linalg.inv(scale_matrix(true.gyro)).T + true.gyro_bias
    attitude = None
    if attitude_deg:
        shaken = simulate.turns(rng.normal(0.0, math.radians(attitude_deg), field.shape))
        attitude = from_matrix(turning.attitudes @ shaken)
    acceleration = felt_by(simulate.specific_force(turning.attitudes, rng), true.accelerometer)
    samples = Samples(
        field + noise * rng.standard_normal(field.shape),
        time=turning.time,
        acceleration=acceleration,
        rate=felt + gyro_noise * rng.standard_normal(field.shape),
        attitude=attitude,
    )
    site = Site(strength, 60.0 + rng.normal(0.0, 1.0), gain_sigma=0.01, inclination_sigma_deg=1.0)
    return Known(samples, site, replace(true, accelerometer=in_own_unit(true.accelerometer, acceleration)))


def in_own_unit(errors: Floats, acceleration: Floats) -> Floats:
    """(9,) errors of an accelerometer in the unit of a fit, the median length of its readings."""
    unit = float(np.median(np.linalg.norm(acceleration, axis=1))) / GRAVITY
    return np.concatenate(
        [errors[:3] / unit, upper_entries(unit * (np.eye(3) + symmetric_matrix(errors[3:])) - np.eye(3))]
    )


def felt_by(force: Floats, errors: Floats) -> Floats:
    """(N, 3) readings of an accelerometer with errors for a force."""
    read: Floats = force @ np.linalg.inv(np.eye(3) + symmetric_matrix(errors[3:])) + GRAVITY * errors[:3]
    return read


def _motion(motion: str, rng: np.random.Generator) -> tuple[Trajectory, float, float]:
    """Path of 1,500 readings, noise in µT, and noise of the gyro in rad/s, scaled to the step for MAGYC's."""
    if motion == "rocked":
        turning = simulate.rocked(rng, seconds=600.0, rate_hz=2.5, amplitudes_deg=MOTIONS_DEG["MAM"])
        return turning, 1.0, 0.01 * math.sqrt(2.5 / 10.0)
    draw = simulate.motions.swayed if motion == "swayed" else simulate.hand_tumble
    return draw(rng, seconds=60.0, rate_hz=25.0), SIGMA, simulate.RATE_NOISE


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """(P,) errors and their (P, P) claimed covariance; squared heading error, actual and claimed, degrees²."""

    errors: Floats
    covariance: Floats
    layout: ParameterLayout
    heading: float
    claimed: float


def scored_trial(motion: str, title: str, number: int) -> Scored | None:
    """Result of one trial; None if refused."""
    terms, is_known, attitude_deg = CASES[title]
    drawn = known(motion, attitude_deg, number)
    try:
        found = fit_aided(drawn.samples, terms, site=drawn.site if is_known else None)
    except FlindersError:
        return None
    errors = errors_of(found, drawn.true)
    _, fields = level_turn(60.0)
    seen = np.linalg.solve(
        found.parameters.shape, (drawn.true.offset + fields.T @ drawn.true.shape - found.parameters.offset).T
    )
    apart = wrapped_rms(np.arctan2(-seen[1], seen[0]) - np.arctan2(-fields[1], fields[0]))
    claimed = level_error(found.ellipsoid, found.covariance[:9, :9], dip_deg=60.0).rms
    return Scored(errors, found.covariance, found.layout, math.degrees(apart) ** 2, claimed**2)


def in_axes_of_gyro(true: Parameters) -> Parameters:
    """Truth in the axes of the gyro, if the gyro alone defines the axes of the body."""
    left, scales, right = np.linalg.svd(scale_matrix(true.gyro))
    turn, growth = left @ right, (right.T * scales) @ right
    return replace(
        true, rotation=turn.T @ true.rotation, gyro_scale=upper_entries(growth - np.eye(3)), gyro_turn=np.zeros(3)
    )


def errors_of(found: AidedFit, true: Parameters) -> Floats:
    """(P,) errors of the parameters; a rotation as the remaining turn, a direction along its own steps."""
    if "gyro_bias" in found.layout.columns and "gyro_turn" not in found.layout.columns:
        true = in_axes_of_gyro(true)
    at, errors = found.parameters, np.zeros(found.layout.size)
    for name, columns in found.layout.columns.items():
        if name == "shape":
            errors[columns] = upper_entries(at.shape - true.shape)
        elif name == "rotation":
            errors[columns] = rotation_vectors((at.rotation @ true.rotation.T)[np.newaxis])[0]
        elif name == "direction":
            errors[columns] = perpendicular_vectors(at.direction).T @ (at.direction - true.direction)
        else:
            errors[columns] = getattr(at, name) - getattr(true, name)
    return errors


BLOCKS: Final = {
    "b": ("offset",), "S": ("shape",), "R": ("rotation",), "dip or m": ("sine", "direction"),
    "gyro bias": ("gyro_bias",), "gyro scales": ("gyro_scale",), "gyro mounting": ("gyro_turn",), "delay": ("delay",),
    "accelerometer": ("accelerometer",),
}  # fmt: skip
"""Columns of the table, each with its blocks of parameters."""


def nees_table(
    pool: ProcessPoolExecutor, trials: int, motions: Sequence[str] = MOTIONS, cases: Sequence[str] | None = None
) -> Iterator[str]:
    """Yield the squared errors over claimed variances: smallest and largest of the parameters of each block."""
    yield "| motion | aiding | " + " | ".join(BLOCKS) + " | b and S together | all together | heading over claim |"
    yield "|---|---|" + "---:|" * (len(BLOCKS) + 3)
    for motion, title in product(motions, cases or CASES):
        rows = pool.map(scored_trial, repeat(motion), repeat(title), range(trials), chunksize=4)
        every = [one for one in rows if one is not None]
        usual = mode(len(one.errors) for one in every)
        found = [one for one in every if len(one.errors) == usual]  # fewer where the gyro's scales were held
        refused = "" if len(found) == trials else f" ({trials - len(every)} refused, {len(every) - len(found)} held)"
        means = np.mean([one.errors**2 / np.diag(one.covariance) for one in found], axis=0)
        parts = (_least_and_most(means, found[0].layout, names) for names in BLOCKS.values())
        nine, whole = (np.mean([_together(one, size) for one in found]) for size in (9, len(means)))
        heading = math.sqrt(sum(one.heading for one in found) / sum(one.claimed for one in found))
        yield f"| {motion} | {title}{refused} | {' | '.join(parts)} | {nine:.2f} | {whole:.2f} | {heading:.2f} |"


def _least_and_most(means: Floats, layout: ParameterLayout, names: Sequence[str]) -> str:
    """Smallest and largest mean of the parameters of some blocks."""
    some = [value for name in names if name in layout for value in means[layout.columns[name]].tolist()]
    if not some:
        return "–"
    return f"{some[0]:.2f}" if len(some) == 1 else f"{min(some):.2f} … {max(some):.2f}"


def _together(one: Scored, size: int) -> float:
    """Squared length of the first `size` errors in units of their claimed covariance, per parameter."""
    errors = one.errors[:size]
    return float(errors @ np.linalg.solve(one.covariance[:size, :size], errors)) / size


# (d) S7


def tilted_error_deg(answer: Answer, recording: Simulated, tilt_deg: float) -> float:
    """Heading error (rms, less its mean) over headings and directions of tilt, with the true tilt removed."""
    offset, matrix = answer
    heading, side = (grid.ravel() for grid in np.meshgrid(np.arange(36) * np.pi / 18, np.arange(8) * np.pi / 4))
    leans = math.radians(tilt_deg) * np.stack([np.cos(side), np.sin(side), np.zeros(len(side))], axis=1)
    attitudes = simulate.turns(np.outer(heading, [0.0, 0.0, 1.0])) @ simulate.turns(leans)
    true = FIELD_STRENGTH * simulate.in_body_axes(attitudes, simulate.north_and_down(60.0))
    raw = true @ np.asarray(recording.sensor.matrix).T + recording.sensor.offset
    felt = simulate.in_body_axes(attitudes, np.array([0.0, 0.0, -1.0]))
    apart = np.radians(magnetic_heading_deg((raw - offset) @ matrix.T, felt)) - np.radians(
        magnetic_heading_deg(true, felt)
    )
    return math.degrees(wrapped_rms(apart))


def level_trial(title: str, number: int) -> list[float]:
    """Heading errors on S7 at each tilt."""
    recording = dataset("S7", number, SIGMA)
    rng = np.random.default_rng([SEED, 2, number])
    level = np.broadcast_to(np.eye(3), (len(recording.samples), 3, 3))
    samples = replace(recording.samples, acceleration=simulate.specific_force(level, rng))
    strength, dip = FIELD_STRENGTH * (1.0 + rng.normal(0.0, 0.01)), 60.0 + rng.normal(0.0, 1.0)
    if title == "two-axis ellipse (`level`)":
        answer = by_ellipsoid(samples, method=partial(level_turn_alone, dip_deg=dip))
    else:
        answer = by_aids(samples, terms=("dip",), site=Site(strength, dip, 0.05, 1.0))
    return [tilted_error_deg(answer, recording, tilt) for tilt in TILTS_DEG]


def level_table(pool: ProcessPoolExecutor, trials: int) -> Iterator[str]:
    """Yield the level turn with the field of the site, at several tilts."""
    yield "| method | " + " | ".join(f"{tilt:g}°" for tilt in TILTS_DEG) + " |"
    yield "|---|" + "---:|" * len(TILTS_DEG)
    for title in ("two-axis ellipse (`level`)", "dip and the site's field"):
        errors = np.array(list(pool.map(level_trial, repeat(title), range(trials))))
        yield f"| {title} | " + " | ".join(f"{error:.3f}" for error in np.sqrt(np.mean(errors**2, axis=0))) + " |"


# (e) a magnet passes


def magnet_trial(motion: str, aiding: str, number: int) -> tuple[str, float, float, float]:
    """Verdict, and errors over claims: level heading (rms) in the sensor's own axes, largest of offset and rotation.

    NaN for a refused fit, or one without a rotation.
    """
    recording = simulate.tumble(number, motion=motion, n=10_000, disturbances=(simulate.PassingMagnet(100.0),))
    assert recording.attitudes is not None
    errors = np.radians(np.random.default_rng([SEED, 3, number]).normal(0.0, 1.0, (10_000, 3)))
    samples = replace(recording.samples, attitude=from_matrix(recording.attitudes @ simulate.turns(errors)))
    try:
        fit = flinders.fit(samples, aiding=aiding)
    except FlindersError:
        return "refused", math.nan, math.nan, math.nan
    heading = _heading_ratio(fit, recording)
    off = (fit.calibration.offset - recording.sensor.offset) / np.sqrt(np.diag(fit.claim.covariance)[:3])
    return fit.verdict, heading, float(np.max(np.abs(off))), _rotation_ratio(fit)


def _rotation_ratio(fit: Fit) -> float:
    """Largest component of the rotation, truly 0, over its claim; NaN if undetermined."""
    aiding = fit.evidence.aiding
    if aiding is None or aiding.rotation is None or aiding.rotation_covariance is None:
        return math.nan
    ratios = rotation_vectors(aiding.rotation[np.newaxis])[0] / np.sqrt(np.diag(aiding.rotation_covariance))
    return float(np.max(np.abs(ratios)))


def magnet_table(pool: ProcessPoolExecutor, trials: int) -> Iterator[str]:
    """Yield a row for each motion and aid: verdicts, median and largest of the ratios."""
    yield "| motion | aid | good, limited, refused | heading ÷ claim | offset ÷ claim | rotation ÷ claim |"
    yield "|---|---|---:|---:|---:|---:|"
    for motion, aiding in product(("hand", "rocked", "flight", "drive"), ("dip", "attitude")):
        verdicts, *errors = zip(*pool.map(magnet_trial, repeat(motion), repeat(aiding), range(trials)), strict=True)
        counts = ", ".join(str(verdicts.count(verdict)) for verdict in ("good", "limited", "refused"))
        cells = [_median_and_largest(np.array(each)) for each in errors]
        yield f"| {motion} | `{aiding}` | {counts} | {' | '.join(cells)} |"


def _median_and_largest(ratios: Floats) -> str:
    """Of those that there are."""
    known = ratios[np.isfinite(ratios)]
    return f"{np.median(known):.1f}, {known.max():.1f}" if len(known) else "–"


# (f) drives of half a minute


DRIVES: Final[Mapping[str, tuple[str, str]]] = {
    "attitude off by 1° at each reading": ("attitude", ""),
    "the same, and a magnet": ("attitude", "magnet"),
    "attitude off by 1° for ten seconds": ("attitude", "lasting"),
    "gyro with a constant bias": ("rate", ""),
    "the same, and a bias that walks by 0.5 mrad/s in a second": ("rate", "walk"),
}
"""Aid of each kind of drive, and the disturbance of this aid."""


def short_drive(disturbed: str, number: int) -> tuple[Simulated, Samples]:
    """A drive of 1,500 readings at 50 Hz, with an attitude and a gyro."""
    rng = np.random.default_rng([SEED, 4, number])
    passing = (simulate.PassingMagnet(100.0),) if disturbed == "magnet" else ()
    imu = simulate.Imu(gyro_bias=rng.normal(0.0, 0.01, 3))
    recording = simulate.tumble(rng, motion="drive", n=1500, imu=imu, disturbances=passing)
    assert recording.attitudes is not None
    assert recording.samples.rate is not None
    errors = rng.normal(0.0, math.radians(1.0), (1500, 3))
    if disturbed == "lasting":
        make_lasting(errors, 10.0 * 50.0)
    walk = np.cumsum(rng.normal(0.0, 5e-4 / math.sqrt(50.0), (1500, 3)), axis=0) if disturbed == "walk" else 0.0
    attitude = from_matrix(recording.attitudes @ simulate.turns(errors))
    return recording, replace(recording.samples, attitude=attitude, rate=recording.samples.rate + walk)


def make_lasting(errors: Floats, readings: float) -> None:
    """Convert (N, k) independent errors to slow ones of the same size, with a time constant in readings."""
    stays = math.exp(-1.0 / readings)
    for before, error in pairwise(errors):
        error[:] = stays * before + math.sqrt(1.0 - stays**2) * error


def drive_trial(title: str, number: int) -> tuple[float, float, bool, bool]:
    """Level heading error (rms) over the claim without and with the aid, also for refused fits; NaN without a fit.

    Also whether the aid was used, and whether the drive is a level turn for the magnetometer alone.
    """
    aiding, disturbed = DRIVES[title]
    recording, samples = short_drive(disturbed, number)
    alone, aided = (_judged(samples, each) for each in ((), aiding))
    ratios = [math.nan if fit is None else _heading_ratio(fit, recording) for fit in (alone, aided)]
    is_used = (
        aided is not None
        and aided.evidence.aiding is not None
        and any(aid.is_used for aid in aided.evidence.aiding.sensors)
    )
    return ratios[0], ratios[1], is_used, alone is not None and bool(alone.claim.plane)


def _judged(samples: Samples, aiding: str | tuple[()]) -> Fit | None:
    """Fit of a recording, also a refused one."""
    try:
        return flinders.fit(samples, aiding=aiding)
    except Refused as refused:
        return refused.fit
    except FlindersError:
        return None


def _heading_ratio(fit: Fit, recording: Simulated) -> float:
    """Level heading error in the sensor's own axes over its claim, both rms."""
    matrix, offset = fit.calibration.matrix, fit.calibration.offset
    own = symmetric_power(matrix.T @ matrix, 0.5)
    return heading_error_deg(own, offset, recording) / fit.heading_error_deg.rms


def drives_table(pool: ProcessPoolExecutor, trials: int) -> Iterator[str]:
    """Yield a row for each aid: how often it is used, rms of the ratios, and share of ratios above 2."""
    numbers = " | ".join(f"{which}: rms | beyond 2" for which in ("without", "with", "used on a level turn"))
    yield f"| aid | level turns | used, of these | {numbers} |"
    yield "|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    for title in DRIVES:
        alone, aided, used, level = map(
            np.array, zip(*pool.map(drive_trial, repeat(title), range(trials), chunksize=4), strict=True)
        )
        cells = " | ".join(map(_rms_and_beyond, (alone, aided, aided[level & used])))
        yield f"| {title} | {level.sum()} | {used.sum()}, {(level & used).sum()} | {cells} |"


def _rms_and_beyond(ratios: Floats) -> str:
    """Of those that there are."""
    known = ratios[np.isfinite(ratios)]
    return f"{_rms(known):.2f} | {np.mean(known > 2.0):.0%}" if len(known) else "– | –"


# (g) attitudes that err


@dataclass(frozen=True, slots=True)
class AttitudeErrors:
    """Errors of a logged attitude in addition to 0.5° about each axis at each reading."""

    yaw_deg: float = 0.0  # 1 σ, lasting for half a minute
    mounting_deg: float = 0.0  # 1 σ about each axis
    late_readings: int = 0


ATTITUDES: Final[Mapping[str, AttitudeErrors]] = {
    "off by 0.5° at each reading": AttitudeErrors(),
    "and its yaw by 3° for 30 s": AttitudeErrors(yaw_deg=3.0),
    "and 0.3 s late": AttitudeErrors(late_readings=3),
    "and its yaw by 2° for 30 s, 0.2 s late, mounted 3° off": AttitudeErrors(2.0, 3.0, 2),
}
ATTITUDE_RATE_HZ: Final = 10.0


def erring(motion: str, errors: AttitudeErrors, number: int) -> tuple[Simulated, Samples]:
    """Recording of 150 s at 10 Hz with an erroneous attitude."""
    rng = np.random.default_rng([SEED, 5, number])
    recording = simulate.tumble(rng, motion=motion, n=1500, rate_hz=ATTITUDE_RATE_HZ)
    assert recording.attitudes is not None
    yaw = rng.normal(0.0, math.radians(errors.yaw_deg), (1500, 1))
    make_lasting(yaw, 30.0 * ATTITUDE_RATE_HZ)
    mounting = simulate.turns(rng.normal(0.0, math.radians(errors.mounting_deg), (1, 3)))
    noise = simulate.turns(rng.normal(0.0, math.radians(ATTITUDE_NOISE_DEG), (1500, 3)))
    late = recording.attitudes[np.maximum(np.arange(1500) - errors.late_readings, 0)]
    logged = simulate.turns(yaw * [0.0, 0.0, 1.0]) @ late @ mounting @ noise
    return recording, replace(recording.samples, attitude=from_matrix(logged))


def erring_trial(motion: str, title: str, number: int) -> list[tuple[str, float, float, bool, bool]]:
    """Results without and with the attitude: verdict, claim, error over claim, whether a gap is named, whether used."""
    recording, samples = erring(motion, ATTITUDES[title], number)
    found = []
    for aiding in ((), "attitude"):
        fit = _judged(samples, aiding)
        if fit is None:
            found.append(("refused", math.nan, math.nan, False, False))
            continue
        aids = () if fit.evidence.aiding is None else fit.evidence.aiding.sensors
        is_gap = any(finding.code == "coverage" for finding in fit.findings)
        claim, is_used = fit.heading_error_deg.worst, any(aid.is_used for aid in aids)
        found.append((fit.verdict, claim, _heading_ratio(fit, recording), is_gap, is_used))
    return found


def attitudes_table(pool: ProcessPoolExecutor, trials: int) -> Iterator[str]:
    """Yield a row for each motion and error: verdicts, median claim, rms of the ratios, share of ratios above 2."""
    numbers = "good, limited, refused | gap named | claim | rms | beyond 2"
    yield f"| motion | attitude | without: {numbers} | with: {numbers} | used |"
    yield "|---|---|" + "---:|" * 11
    for motion, title in product(("drive", "flight"), ATTITUDES):
        rows = list(pool.map(erring_trial, repeat(motion), repeat(title), range(trials), chunksize=4))
        cells = []
        for which in (0, 1):
            verdicts, claims, ratios, gaps, used = zip(*(row[which] for row in rows), strict=True)
            counts = ", ".join(str(verdicts.count(verdict)) for verdict in ("good", "limited", "refused"))
            cells += [counts, str(sum(gaps)), f"{np.nanmedian(claims):.2f}°", _rms_and_beyond(np.array(ratios))]
        yield f"| {motion} | {title} | {' | '.join(cells)} | {sum(used)} |"


# (h) time


def timed(seconds: float, rate_hz: float, terms: tuple[str, ...]) -> tuple[int, float, float]:
    """Number of readings, CPU seconds and additional memory in MiB of a fit; run in a separate process."""
    recording = simulate.tumble(1, motion="swayed", n=round(seconds * rate_hz), rate_hz=rate_hz)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.process_time()
    fit_aided(recording.samples, terms)
    took = time.process_time() - begun
    return len(recording.samples), took, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


def time_table() -> Iterator[str]:
    """Yield the table of CPU seconds and memory."""
    yield "| recording | terms | readings | CPU s | MiB more at most |"
    yield "|---|---|---:|---:|---:|"
    cases = (("60 s at 100 Hz", 60.0, 100.0), ("1 h at 50 Hz", 3600.0, 50.0))
    for title, seconds, rate_hz in cases:
        for terms in (("rate",), ("dip",), ("rate", "dip")):
            with ProcessPoolExecutor(1) as alone:
                count, took, memory = alone.submit(timed, seconds, rate_hz, terms).result()
            yield f"| {title} | {', '.join(terms)} | {count:,} | {took:.2f} | {memory:.0f} |"


# the command


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    options = _parser().parse_args(arguments)
    with ProcessPoolExecutor(options.processes) as pool:
        tables: dict[str, Callable[[], Iterator[str]]] = {
            "sim": partial(sim_table, pool, options.seeds),
            "aids": partial(aids_table, pool, options.trials),
            "nees": partial(nees_table, pool, options.trials, options.motions, options.cases),
            "level": partial(level_table, pool, options.trials),
            "magnet": partial(magnet_table, pool, options.trials),
            "drives": partial(drives_table, pool, options.trials),
            "attitudes": partial(attitudes_table, pool, options.trials),
            "real": terms_recordings.tables,
            "time": time_table,
        }
        unknown = [name for name in options.tables or tables if name not in tables]
        if unknown:
            sys.exit(f"no table {', '.join(unknown)}: there are {', '.join(tables)}")
        for name in options.tables or tables:
            print(f"\n## {name}\n")
            for line in tables[name]():
                print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.terms", description="What each aid is worth.")
    parser.add_argument("--tables", type=_listed, metavar="NAME,…", help="all by default")
    parser.add_argument("--trials", type=int, default=200, help="of aids, nees, level, magnet, drives and attitudes")
    parser.add_argument("--seeds", type=int, default=10, help="of sim")
    parser.add_argument("--motions", type=_listed, default=MOTIONS, metavar="NAME,…", help="of nees")
    parser.add_argument("--cases", type=_cased, metavar="NAME;…", help=f"of nees: {'; '.join(CASES)}")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def _listed(text: str) -> list[str]:
    return text.split(",")


def _cased(text: str) -> list[str]:
    return [name.strip() for name in text.split(";")]


def _rms(values: Sequence[float] | Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan


if __name__ == "__main__":
    main()
