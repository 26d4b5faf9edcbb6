"""Consistency of filters whose noise parameters come from an export of a calibration. Prints Markdown.

    python -m benchmarks.delivered [--vehicles 200] [--hold 600]

Vehicles are calibrated from recordings of each kind, the calibrations are exported, and the noise is read from the
export. Each vehicle then holds a heading, its compass and its gyro are as noisy as the filter assumes, and the filter
of the target runs. The squared ratio of the yaw error to the error that the filter states is averaged over the vehicles
(NEES). For a consistent filter it is 1, within a 95 % band; a larger value means that the filter understates its error,
a smaller one that it overstates it. The table also has the same filter with the target's default noise.

``heading``  a heading as an angle, with a gyro and its bias: EKF2 up to 1.14, EKF3, FusionCore, robot_localization
``field``    the horizontal field, with states for the body's field: EKF2 and EKF3 in three axes
``turning``  the first filter after a further minute of turning at 6°/s, since errors depend on the heading

The mean error over a level turn depends on the mounting, and is subtracted. Process noises are the defaults.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

import flinders
from flinders import simulate
from flinders.apps.vehicles.targets.estimators import EKF2, EKF3, GAUSS
from flinders.apps.vehicles.targets.ros import FUSIONCORE, ROBOT_LOCALIZATION
from flinders.errors import FlindersError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated
    from flinders.targets._measurement_noise import YawFilter

RECORDINGS: Final[dict[str, dict[str, Any]]] = {
    "a minute by hand (good)": {"motion": "hand"},
    "a minute by hand, three readings a second, noisy": {"motion": "hand", "rate_hz": 3.0, "noise": 2.0},
    "a boat that rocks, 300 readings (limited)": {"motion": "tilted", "tilt_deg": 8.0, "n": 300, "noise": 1.0},
    "one level turn, 60 readings (level only)": {"motion": "level", "n": 60, "noise": 2.0},
    "one level turn, 40 readings of a poor sensor (level only)": {"motion": "level", "n": 40, "noise": 4.0},
}
"""Arguments of `simulate.tumble` for each kind of recording."""
TURN_S, TURN_RATE = 60.0, math.radians(6.0)
BODY_DRIFT: Final = 1e-10
"""G²/s: noise of the body field, from 1e-4 of EKF2_MAG_B_NOISE and EK3_MAGB_P_NSE, squared, with the step of 10 ms."""


MIN_ORIENTATION_STDDEV: Final = math.sqrt(1e-9)
"""rad: noise that robot_localization uses in place of orientation_stddev 0, the default of imu_filter_madgwick."""


class Delivered(NamedTuple):
    """A target with its filter and the name of the noise parameter."""

    target: str
    yaw: YawFilter
    name: str  # name of the noise among the written values
    default: float
    field: bool = False  # whether the noise is that of one axis of the field, in G
    before: str = ""  # orientation filter ahead of the filter, which uses offsets only; empty without one


TARGETS: Final = (
    Delivered("px4", EKF2.yaw, "EKF2_HEAD_NOISE", 0.3),
    Delivered("ardupilot", EKF3.yaw, "EK3_YAW_M_NSE", 0.5),
    Delivered("fusioncore", FUSIONCORE, "noise_rad", 0.05),
    Delivered("ros-madgwick", ROBOT_LOCALIZATION, "orientation_stddev", MIN_ORIENTATION_STDDEV, before="madgwick"),
    Delivered("px4", EKF2.yaw, "EKF2_MAG_NOISE", 0.05, field=True),
    Delivered("ardupilot", EKF3.yaw, "EK3_MAG_M_NSE", 0.05, field=True),
)


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A vehicle with its calibration."""

    recording: Simulated
    fit: Fit


@dataclass(frozen=True, slots=True, eq=False)
class Compasses:
    """Corrected compasses of V level vehicles that share a field."""

    matrix: Floats  # (V, 3, 3): maps the true field to the corrected one
    offset: Floats  # (V, 3)
    noise: Floats  # (V, 3, 3): maps unit white noise to the noise of the corrected field
    mounting: Floats  # (V,) rad: mean heading error over a level turn
    field: float  # µT
    dip: float  # rad

    @classmethod
    def of(cls, vehicles: Sequence[Vehicle], *, before: str = "") -> Compasses:
        """Compasses of calibrated vehicles; with an orientation filter `before`, without soft iron and noise."""
        matrix, offset, noise = [], [], []
        for vehicle in vehicles:
            sensor, calibration = vehicle.recording.sensor, vehicle.fit.calibration
            held = np.eye(3) if before else calibration.matrix
            matrix.append(held @ sensor.matrix)
            offset.append(held @ (sensor.offset - calibration.offset))
            noise.append(np.zeros((3, 3)) if before else held * sensor.noise)
        first = vehicles[0].recording
        arrays = (np.array(matrix), np.array(offset), np.array(noise))
        bare = cls(*arrays, np.zeros(len(vehicles)), first.field_strength, math.radians(first.dip_deg))
        turn = np.arange(72) * (2.0 * math.pi / 72)
        errors = np.array([bare.heading_error(np.full(len(vehicles), heading)) for heading in turn])
        mean = np.angle(np.exp(1j * errors).mean(axis=0))
        return cls(*arrays, mean, bare.field, bare.dip)

    def corrected(self, heading: Floats, rng: np.random.Generator | None = None) -> Floats:
        """(V, 3) corrected fields at (V,) headings in rad."""
        level = math.cos(self.dip)
        true = [level * np.cos(heading), -level * np.sin(heading), np.full(len(heading), math.sin(self.dip))]
        read: Floats = np.einsum("vij,jv->vi", self.matrix, self.field * np.array(true)) + self.offset
        if rng is not None:
            read += np.einsum("vij,vj->vi", self.noise, rng.standard_normal(read.shape))
        return read

    def heading_error(self, heading: Floats, rng: np.random.Generator | None = None) -> Floats:
        """(V,) heading errors in rad, minus those by the mounting."""
        field = self.corrected(heading, rng)
        return _wrapped(np.arctan2(-field[:, 1], field[:, 0]) - heading - self.mounting)

    def field_error(self, heading: Floats, rng: np.random.Generator) -> Floats:
        """(V, 2) errors of the horizontal field in axes of the body, in G, minus those by the mounting."""
        field = self.corrected(heading, rng)
        cosine, sine = np.cos(self.mounting), np.sin(self.mounting)
        across = np.stack([cosine * field[:, 0] - sine * field[:, 1], sine * field[:, 0] + cosine * field[:, 1]], 1)
        level = self.field * math.cos(self.dip)
        error: Floats = (across - level * np.stack([np.cos(heading), -np.sin(heading)], 1)) / GAUSS
        return error


def calibrated(asked: dict[str, Any], count: int) -> list[Vehicle]:
    """Vehicles that are calibrated each from its own recording; refused calibrations are left out."""
    vehicles = []
    for seed in range(count):
        recording = simulate.tumble(seed=seed, **asked)
        try:
            fit = flinders.fit(recording.samples, site=flinders.Site(strength=recording.field_strength))
        except FlindersError:
            continue
        vehicles.append(Vehicle(recording, fit))
    return vehicles


def written(vehicles: Sequence[Vehicle], target: str) -> dict[str, Floats]:
    """(V,) exported numbers of the vehicles, by name of the number."""
    asked = target in {"px4", "ardupilot"}
    exports = [flinders.export(vehicle.fit, target, lossy=True, noise=asked).export for vehicle in vehicles]
    names = {delivered.name for delivered in TARGETS if delivered.target == target}
    return {name: np.array([export.fields["values"][name] for export in exports]) for name in names}


def run_heading(
    yaw: YawFilter, sigma: Floats, first: Floats, compasses: Compasses, rng: np.random.Generator, *, hold_s: float
) -> tuple[float, float]:
    """NEES of the heading filter at a constant heading, and after a further minute of turning.

    `first` is the noise of the first yaw, (V,) rad.
    """
    transition, process = yaw._model()
    size, count, step = len(transition), len(sigma), 1.0 / yaw.rate_hz
    heading = rng.uniform(-math.pi, math.pi, count)
    error = np.zeros((count, size))
    error[:, 0] = compasses.heading_error(heading, rng)
    variance = np.zeros((count, size, size))
    variance[:, 0, 0] = first**2
    drawn = np.linalg.cholesky(process) if yaw.is_of_gyro else np.zeros_like(process)
    held = math.nan
    for index in range(round((hold_s + TURN_S) / step)):
        if index == round(hold_s / step):
            held = _nees(error[:, 0], variance[:, 0, 0])
        heading = heading + (TURN_RATE * step if index >= round(hold_s / step) else 0.0)
        error = error @ transition.T + rng.standard_normal(error.shape) @ drawn.T
        variance = transition @ variance @ transition.T + process
        gain = variance[:, :, 0] / (variance[:, 0, 0] + sigma**2)[:, np.newaxis]
        error += gain * _wrapped(compasses.heading_error(heading, rng) - error[:, 0])[:, np.newaxis]
        variance = variance - gain[:, :, np.newaxis] * variance[:, np.newaxis, 0, :]
    return held, _nees(error[:, 0], variance[:, 0, 0])


def run_field(
    yaw: YawFilter, sigma: Floats, first: Floats, compasses: Compasses, rng: np.random.Generator, *, hold_s: float
) -> tuple[float, float]:
    """NEES of the field filter, with states yaw, gyro bias and body field; `first` is the noise of the first yaw."""
    transition, process = np.eye(4), np.zeros((4, 4))
    transition[:2, :2], process[:2, :2] = yaw._model()
    step, count = 1.0 / yaw.rate_hz, len(sigma)
    drawn = np.zeros((4, 4))
    drawn[:2, :2] = np.linalg.cholesky(process[:2, :2])
    process[2:, 2:] = BODY_DRIFT * step * np.eye(2)
    heading = rng.uniform(-math.pi, math.pi, count)
    error = np.zeros((count, 4))
    error[:, 0] = compasses.heading_error(heading, rng)
    variance = np.zeros((count, 4, 4))
    variance[:, 0, 0], variance[:, 2, 2], variance[:, 3, 3] = first**2, sigma**2, sigma**2
    level, held = compasses.field * math.cos(compasses.dip) / GAUSS, math.nan
    for index in range(round((hold_s + TURN_S) / step)):
        if index == round(hold_s / step):
            held = _nees(error[:, 0], variance[:, 0, 0])
        heading = heading + (TURN_RATE * step if index >= round(hold_s / step) else 0.0)
        error = error @ transition.T + rng.standard_normal(error.shape) @ drawn.T
        variance = transition @ variance @ transition.T + process
        slopes = np.zeros((count, 2, 4))
        slopes[:, 0, 0], slopes[:, 1, 0] = -level * np.sin(heading), -level * np.cos(heading)
        slopes[:, 0, 2], slopes[:, 1, 3] = 1.0, 1.0
        crossed = variance @ slopes.mT
        innovation = slopes @ crossed + sigma[:, np.newaxis, np.newaxis] ** 2 * np.eye(2)
        gain = np.linalg.solve(innovation, crossed.mT).mT
        seen = compasses.field_error(heading, rng) - np.einsum("vij,vj->vi", slopes, error)
        error += np.einsum("vij,vj->vi", gain, seen)
        variance = variance - gain @ crossed.mT
    return held, _nees(error[:, 0], variance[:, 0, 0])


def _wrapped(angles: Floats) -> Floats:
    """Angles wrapped to the range −π to π."""
    wrapped: Floats = np.angle(np.exp(1j * angles))
    return wrapped


def _nees(error: Floats, variance: Floats) -> float:
    """Mean of squared errors, divided by the variance that the filter states."""
    return float(np.mean(error**2 / variance))


def band(count: int) -> tuple[float, float]:
    """95 % interval of the mean of `count` squared standard normal numbers (Wilson and Hilferty)."""
    spread = 2.0 / (9.0 * count)
    low, high = ((1.0 - spread + sign * 1.959964 * math.sqrt(spread)) ** 3 for sign in (-1.0, 1.0))
    return low, high


class Row(NamedTuple):
    """Results for one target."""

    sigma: float  # median of the exported noise
    nees: tuple[float, float]  # NEES at a constant heading, and while turning
    default: tuple[float, float]  # the same two with the default noise


def rows(vehicles: Sequence[Vehicle], *, hold_s: float) -> list[Row]:
    """The row of each target."""
    found, all_written = [], {name: written(vehicles, name) for name in {one.target for one in TARGETS}}
    for delivered in TARGETS:
        compasses, values = Compasses.of(vehicles, before=delivered.before), all_written[delivered.target]
        sigma, usual = values[delivered.name], np.full(len(vehicles), delivered.default)
        first, first_usual = sigma, usual
        if delivered.field:
            angle = next(one for one in TARGETS if one.target == delivered.target)
            first, first_usual = values[angle.name], np.full(len(vehicles), angle.default)
        run = partial(run_field if delivered.field else run_heading, compasses=compasses, hold_s=hold_s)
        numbers = [
            run(delivered.yaw, noise, beginning, rng=np.random.default_rng(1))
            for noise, beginning in ((sigma, first), (usual, first_usual))
        ]
        found.append(Row(float(np.median(sigma)), *numbers))
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--hold", type=float, default=600.0, help="duration of the constant heading, s")
    asked = parser.parse_args()
    for name, recorded in RECORDINGS.items():
        vehicles = calibrated(recorded, asked.vehicles)
        claims = [vehicle.fit.heading_error_deg.rms for vehicle in vehicles]
        verdicts = [vehicle.fit.verdict for vehicle in vehicles]
        low, high = band(len(vehicles))
        print(f"\n### {name}\n")
        print(
            f"{len(vehicles)} vehicles of {asked.vehicles}, {verdicts.count('good')} good; claimed "
            f"{np.median(claims):.2g}° (median rms); a consistent filter has {low:.2f} to {high:.2f}\n"
        )
        print("| noise | median | NEES, held | turning | default | default, held | turning |")
        print("|---|---|---|---|---|---|---|")
        for target, row in zip(TARGETS, rows(vehicles, hold_s=asked.hold), strict=True):
            cells = [target.name, row.sigma, *row.nees, target.default, *row.default]
            print("|", " | ".join(cell if isinstance(cell, str) else f"{cell:.3g}" for cell in cells), "|", flush=True)


if __name__ == "__main__":
    main()
