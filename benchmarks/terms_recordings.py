"""Aiding on real recordings: the accelerometer's, the gyro's, and scripted turns.

``python -m benchmarks.terms --tables real`` prints the tables.

The recordings are not part of the project; `benchmarks.recordings` states their folder.

dip        Spread of the angle between the field and the accelerometer's vertical, with the magnetometer alone, and with
                      the dip aid, which also estimates the rotation between both sensors.
third      Each third of a recording, with and without the gyro, compared with the whole by its magnitude alone: offset
                      in combined standard deviations, level heading, and errors of the gyro's scales.
scripted   Headings of a sensor that was rolled and tilted at 0°, 45° and 90°.
auto       Aids that ``--with auto`` keeps for each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.recordings import FOLDER
from flinders.estimators import Readings
from flinders.estimators.aiding import fit_aided
from flinders.estimators.auto import Auto
from flinders.fitting.result import Refused
from flinders.heading.attitude import magnetic_heading_deg
from flinders.heading.error_propagation import level_error, level_turn
from flinders.likelihood.dip import correct_verticals
from flinders.simulate import rotation_vectors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.aiding import AidedFit

WITH_ACCELEROMETER: Final = ("ckexplorer_acc_mag/acc_mag_log.csv", "timspi_imu_gnss/imu_gnss_data.csv")
WITH_GYRO: Final = (
    "pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv",
    "pichim_betaflight/20231015_ctzsnooze_PR_Cal_3.csv",
    "pichim_betaflight/CalCareful_2282320.csv",
    "pichim_betaflight/calTest1_198_253_-9.csv",
    "pichim_betaflight/calTest1_208_249_-2.csv",
    "pichim_betaflight/calTest1_215_253_0.csv",
    "pichim_betaflight/calTest1_222_240_-8.csv",
)
SPHERE: Final = "sunsided_hmc5883l/full-sphere.csv"
AUTOMATIC: Final = (
    *WITH_ACCELEROMETER,
    "sunsided_hmc5883l/full-sphere.csv",
    "pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv",
    "pichim_betaflight/calTest1_222_240_-8.csv",
    "dronekit_log171_3mags/log171.bin",
)
SCRIPTED: Final = "sunsided_hmc5883l/roll-and-tilt-at-45-90.csv"

MIRRORED: Final = {"timspi_imu_gnss/imu_gnss_data.csv": np.array([-1.0, 1.0, 1.0])}
"""Signs of magnetometer axes relative to the accelerometer's; this recording has an inverted x."""

NO_ERRORS: Final = np.zeros(9)
MAX_ACCELERATION_SHARE: Final = 0.05
"""Largest distance of an acceleration that shows the vertical from the median acceleration, share of gravity."""


@dataclass(frozen=True, slots=True, eq=False)
class Dip:
    """Results of the dip aid.

    Attributes
    ----------
    before_deg, after_deg : float
        Spread of the angle between field and vertical, as 1.4826 times the median distance from the median.
    rotation_deg, sigma_deg : (3,) float
        Rotation from magnetometer to accelerometer as a rotation vector, and its standard deviations.
    """

    before_deg: float
    after_deg: float
    rotation_deg: Floats
    sigma_deg: Floats


def read(name: str) -> Samples:
    """Read a recording from the folder; axes mirrored relative to the accelerometer are mirrored back."""
    samples = flinders.read(FOLDER / name)
    return replace(samples, field=samples.field * MIRRORED[name]) if name in MIRRORED else samples


def dip_of(samples: Samples) -> Dip:
    """Fit with the magnitude alone, and with the dip."""
    alone, aided = fit_aided(samples, ()), fit_aided(samples, ("dip",))
    covariance = aided.rotation_covariance
    sigma = np.full(3, np.nan) if covariance is None else np.degrees(np.sqrt(np.diag(covariance)))
    return Dip(
        dip_spread_deg(samples, alone.parameters.offset, np.linalg.inv(alone.parameters.shape)),
        dip_spread_deg(samples, aided.parameters.offset, aided.matrix, aided.parameters.accelerometer),
        np.degrees(rotation_vectors(aided.parameters.rotation[np.newaxis])[0]),
        sigma,
    )


def dip_spread_deg(samples: Samples, offset: Floats, matrix: Floats, errors: Floats = NO_ERRORS) -> float:
    """Spread of the angle between the corrected field and the vertical, at readings with little acceleration.

    `errors`: (9,) errors of the accelerometer.
    """
    assert samples.acceleration is not None
    size = np.linalg.norm(samples.acceleration, axis=1)
    still = np.abs(size / np.median(size) - 1.0) < MAX_ACCELERATION_SHARE
    down, _ = correct_verticals(-samples.acceleration[still] / size[still, np.newaxis], errors)
    field = (samples.field[still] - offset) @ matrix.T
    cosine = np.einsum("ni,ni->n", field, down) / np.linalg.norm(field, axis=1) / np.linalg.norm(down, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return 1.4826 * float(np.median(np.abs(angle - np.median(angle))))


@dataclass(frozen=True, slots=True, eq=False)
class Third:
    """A third of a tumble with the gyro, compared with the whole by its magnitude alone.

    Attributes
    ----------
    surprise : float
        √(eᵀC⁻¹e / 3) for the difference e of the offsets and the sum C of both covariances.
    without_deg, with_deg : float
        Level heading difference of the third and the whole, rms, without and with the gyro.
    claimed_deg : float
        Claim of that difference with the gyro, from both covariances.
    scale : (6,) float
        Errors of the gyro's scales, x, y and z first.
    """

    surprise: float
    without_deg: float
    with_deg: float
    claimed_deg: float
    scale: Floats


def thirds_of(samples: Samples) -> list[Third]:
    """Fit the whole by its magnitude, and each third with the gyro and without."""
    whole = fit_aided(samples, ())
    return [third_of(whole, samples[part * len(samples) // 3 : (part + 1) * len(samples) // 3]) for part in range(3)]


def third_of(whole: AidedFit, third: Samples) -> Third:
    """Compare one third with the whole."""
    aided = fit_aided(third, ("rate",))
    alone = Auto().estimate(Readings.of(third)).ellipsoid
    covariance = whole.covariance[:9, :9] + aided.covariance[:9, :9]
    apart, truth = aided.parameters.offset - whole.parameters.offset, whole.ellipsoid
    return Third(
        math.sqrt(float(apart @ np.linalg.solve(covariance[:3, :3], apart)) / 3.0),
        between_deg(truth.centre, truth.shape, alone.centre, alone.shape),
        between_deg(truth.centre, truth.shape, aided.parameters.offset, aided.parameters.shape),
        level_error(truth, covariance).rms,
        aided.parameters.gyro_scale,
    )


def between_deg(offset: Floats, shape: Floats, other_offset: Floats, other_shape: Floats) -> float:
    """Root mean square difference of the level headings of two ellipsoids, less its mean, degrees."""
    _, field = level_turn(60.0)
    moved = np.linalg.solve(other_shape, shape @ field + (offset - other_offset)[:, np.newaxis])
    phasors = (moved[0] - 1j * moved[1]) * (field[0] + 1j * field[1])
    angles = np.angle(phasors / np.mean(phasors / np.abs(phasors)))
    return math.degrees(math.sqrt(float(np.mean(angles**2))))


def scripted_deg(offset: Floats, matrix: Floats) -> list[tuple[float, float]]:
    """Median and spread, in degrees, of the headings of the scripted turns, at each of the three headings."""
    samples = read(SCRIPTED)
    assert samples.acceleration is not None
    size = np.linalg.norm(samples.acceleration, axis=1)
    still = np.abs(size / np.median(size) - 1.0) < MAX_ACCELERATION_SHARE
    headings = magnetic_heading_deg((samples.field[still] - offset) @ matrix.T, samples.acceleration[still])
    return clusters(headings[np.isfinite(headings)])


def clusters(headings: Floats, spacing: float = 45.0) -> list[tuple[float, float]]:
    """Middle and spread (from median distances) of three groups of headings, initially `spacing` degrees apart."""
    fits = [
        np.sum(np.min(_off(headings, start + spacing * np.arange(3)) ** 2, axis=1).clip(max=400.0))
        for start in range(360)
    ]
    middles = float(np.argmin(fits)) + spacing * np.arange(3)
    spreads = np.zeros(3)
    for _ in range(10):
        off = _off(headings, middles)
        nearest = np.argmin(np.abs(off), axis=1)
        moves = np.array([np.median(off[nearest == group, group]) for group in range(3)])
        spreads = np.array(
            [1.4826 * np.median(np.abs(off[nearest == group, group] - moves[group])) for group in range(3)]
        )
        middles = middles + moves
    return list(zip(middles.tolist(), spreads.tolist(), strict=True))


def _off(headings: Floats, middles: Floats) -> Floats:
    """(N, K) degrees from each middle, −180 … 180."""
    off: Floats = (headings[:, np.newaxis] - middles + 180.0) % 360.0 - 180.0
    return off


def tables() -> Iterator[str]:
    """Yield all tables of this module."""
    if not FOLDER.is_dir():
        yield f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them"
        return
    yield "| recording | dip spread before → after | rotation, ° (x, y, z) | 1 σ, ° |"
    yield "|---|---:|---|---|"
    for name in (*WITH_ACCELEROMETER, SPHERE):
        found = dip_of(read(name))
        turned, sigma = (", ".join(f"{angle:.2f}" for angle in part) for part in (found.rotation_deg, found.sigma_deg))
        yield f"| {name} | {found.before_deg:.2f}° → {found.after_deg:.2f}° | {turned} | {sigma} |"
    yield "\n| recording | thirds against the whole: offset, σ | heading without gyro | with | claimed | scales, % |"
    yield "|---|---|---:|---:|---:|---|"
    for name in WITH_GYRO:
        thirds = thirds_of(read(name))
        off = ", ".join(f"{third.surprise:.1f}" for third in thirds)
        apart = np.array([[third.without_deg, third.with_deg, third.claimed_deg] for third in thirds])
        without, with_it, claimed = np.sqrt(np.mean(apart**2, axis=0))
        scales = ", ".join(f"{scale:+.1f}" for scale in 100.0 * np.mean([third.scale[:3] for third in thirds], axis=0))
        yield f"| {name} | {off} | {without:.2f}° | {with_it:.2f}° | {claimed:.2f}° | {scales} |"
    yield "\n| calibration of the scripted turns | at 0° | at 45° | at 90° |"
    yield "|---|---:|---:|---:|"
    sphere = read(SPHERE)
    for title, terms in (("magnitude alone", ()), ("dip", ("dip",))):
        fitted = fit_aided(sphere, terms)
        found_at = scripted_deg(fitted.parameters.offset, fitted.matrix)
        cells = (f"{middle - found_at[0][0]:.1f} ± {spread:.1f}" for middle, spread in found_at)
        yield f"| {title} | {' | '.join(cells)} |"
    yield "\n| recording | `auto` keeps | and leaves out |"
    yield "|---|---|---|"
    for name in AUTOMATIC:
        yield f"| {name} | {' | '.join(automatic(name))} |"


def automatic(name: str) -> tuple[str, str]:
    """Aids that `auto` keeps for a recording, with their benefit in degrees, and aids left out."""
    try:
        fit = flinders.fit(flinders.read(FOLDER / name), aiding="auto")
    except Refused as refusal:
        fit = refusal.fit
    each = () if fit.evidence.aiding is None else fit.evidence.aiding.sensors
    kept = ", ".join(f"{aid.name} ({aid.heading_change_deg:.2g}°)" for aid in each if aid.is_used)
    return kept or "–", ", ".join(aid.name for aid in each if not aid.is_used) or "–"
