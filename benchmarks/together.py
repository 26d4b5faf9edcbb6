"""Benefit of a joint fit of several magnetometers on one body, as Markdown.

    python -m benchmarks.together [--tables nees,gain,disagreements,real,time] [--trials 200]

nees        Squared error over claimed covariance of offsets, shapes and rotations, mean over trials: 1 is true.
gain        Level heading error (rms over trials, after its mean) of each sensor alone and together.
disagreements  Detection of a disturbance of four seconds and its attribution to the right sensor; and false alarms in
                       an undisturbed minute.
real        `dronekit_log171` and `leiria_robot` in the folder `FLINDERS_DATA`.
time        CPU seconds.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.datasets import heading_error_deg
from flinders import open_log, read, simulate
from flinders.comparison.agreement import disagreements
from flinders.comparison.multi_sensor import fit_multi
from flinders.estimators import Readings
from flinders.estimators.auto import Auto
from flinders.estimators.multi_sensor import MultiSensorFit, fit_sensors
from flinders.fitting.result import Fit, Refused
from flinders.geometry.ellipsoid import upper_entries
from flinders.geometry.rotation import rotations
from flinders.likelihood.site_field import recorded_site

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.comparison.members import MultiFit
    from flinders.estimators import Estimate
    from flinders.simulate import Sensor, Simulated

SEED: Final = 20261121
FIELD: Final = 50.0
"""µT."""

BODIES: Final = {
    "all around, 600": ("uniform", 600),
    "by hand, 30 s": ("hand", 1500),
    "tilt ≤ 35°, 1,000": ("tilted", 1000),
    "flight, 30 s": ("flight", 1500),
}
"""Motion of a body, and number of readings at 50 Hz."""

NOISES: Final = {"0.5, 0.5": (0.5, 0.5), "0.5, 2": (0.5, 2.0), "0.5, 0.5, 0.5": (0.5, 0.5, 0.5)}
"""Noises of a body's sensors, µT."""

DISTURBANCES_UT: Final = (0.0, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Sensors on one body, and the truth."""

    fields: Floats
    sensors: tuple[Sensor, ...]
    rotations: tuple[Floats, ...]
    path: Simulated


def body(motion: str, n: int, noises: tuple[float, ...], seed: int) -> Body:
    """Draw sensors, randomly rotated except the first, and record them on one path."""
    rng = np.random.default_rng([SEED, seed])
    path = simulate.tumble(seed=seed, motion=motion, n=n)
    turns = [np.eye(3), *rotations(rng.normal(size=(len(noises) - 1, 3)))]
    sensors = tuple(replace(simulate.Sensor.random(rng), noise=noise) for noise in noises)
    fields = [
        sensor.read(FIELD * path.directions @ turn, rng) for sensor, turn in zip(sensors, turns, strict=True)
    ]  # fmt: skip
    return Body(np.stack(fields), sensors, tuple(turns), path)


def weighed(error: Floats, covariance: Floats) -> float:
    """Squared error in claimed standard deviations per parameter: 1 on average for a true claim."""
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def scores(found: MultiSensorFit, true: Body) -> Iterator[tuple[str, float]]:
    """Yield the squared errors of all sensors, weighed."""
    for number, (sensor, turn) in enumerate(zip(true.sensors, true.rotations, strict=True)):
        at, claimed = found.parameters[number], found.of(number)
        yield "offset", weighed(at.offset - sensor.offset, claimed[:3, :3])
        yield "shape", weighed(upper_entries(at.shape) - upper_entries(FIELD * sensor.matrix), claimed[3:9, 3:9])
        if number:
            off = at.rotation @ turn.T
            vector = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
            yield "rotation", weighed(vector, claimed[9:12, 9:12])


def nees_table(trials: int) -> Iterator[str]:
    """Yield the table of squared errors over claims."""
    yield "| body | noises, µT | offsets | shapes | rotations | left open |"
    yield "|---|---|---:|---:|---:|---:|"
    for name, (motion, n) in BODIES.items():
        for noise, noises in NOISES.items():
            rows: dict[str, list[float]] = {"offset": [], "shape": [], "rotation": []}
            left_open = 0
            for seed in range(trials):
                true = body(motion, n, noises, seed)
                found = fit_sensors(true.fields)
                left_open += found.unobserved > 0
                if not found.unobserved:
                    for kind, value in scores(found, true):
                        rows[kind].append(value)
            cells = " | ".join(f"{np.mean(values):.2f}" if values else "–" for values in rows.values())
            yield f"| {name} | {noise} | {cells} | {left_open} of {trials} |"


def heading_deg(estimate: Estimate, sensor: Sensor, path: Simulated) -> float:
    """Level heading error of the ellipsoid of one sensor, degrees."""
    matrix = np.linalg.inv(estimate.ellipsoid.shape)
    return heading_error_deg(matrix, estimate.ellipsoid.centre, replace(path, sensor=sensor))


def gain_table(trials: int) -> Iterator[str]:
    """Yield errors of sensors alone and together; median over trials, as a few are undetermined."""
    yield "| body | noises, µT | alone, ° | together, ° |"
    yield "|---|---|---:|---:|"
    for name, (motion, n) in BODIES.items():
        for noise, noises in NOISES.items():
            errors: list[tuple[list[float], list[float]]] = []
            for seed in range(trials):
                true = body(motion, n, noises, seed)
                alone = [Auto().estimate(Readings.of(field)) for field in true.fields]
                found = fit_sensors(true.fields, starts=alone)
                pairs = list(zip(alone, true.sensors, strict=True))
                apart = [heading_deg(one, sensor, true.path) for one, sensor in pairs]
                joint = [heading_deg(found.estimate(i), sensor, true.path) for i, (_, sensor) in enumerate(pairs)]
                errors.append((apart, joint))
            medians = np.median(np.array(errors), axis=0)
            cells = " | ".join(", ".join(f"{value:.3f}" for value in row) for row in medians)
            yield f"| {name} | {noise} | {cells} |"


def disagreements_table(trials: int) -> Iterator[str]:
    """Yield detection rates of a disturbance of four seconds in half a minute."""
    yield "| disturbance, µT | sensors | found | attributed to the right one | runs with a false one |"
    yield "|---:|---:|---:|---:|---:|"
    for strength in DISTURBANCES_UT:
        for sensors in (2, 3):
            seen_runs, right, elsewhere = 0, 0, 0
            for seed in range(trials):
                true = body("hand", 1500, (0.5,) * sensors, seed)
                moments = np.arange(1500) / 50.0
                direction = np.random.default_rng([SEED, seed, 1]).normal(size=3)
                during = (moments > 12.0) & (moments < 16.0)
                fields = true.fields.copy()
                fields[1] += np.outer(during, strength * direction / np.linalg.norm(direction))
                found = fit_sensors(fields)
                seen = np.stack([found.correct(i, field) for i, field in enumerate(fields)])
                runs = disagreements(seen, moments)
                hits = [run for run in runs if run.start_s < 16.0 and run.end_s > 12.0] if strength else []
                seen_runs += bool(hits)
                right += any(run.sensor == 1 for run in hits)
                elsewhere += len(runs) - len(hits)
            told = f"{right / trials:.0%}" if strength else "–"
            shown = f"{seen_runs / trials:.0%}" if strength else "–"
            yield f"| {strength:g} | {sensors} | {shown} | {told} | {elsewhere} in {trials} |"


def real_table() -> Iterator[str]:
    """Yield the three compasses of one flight, and the four of a robot's arm."""
    data = os.environ.get("FLINDERS_DATA")
    if not data:
        yield "Set FLINDERS_DATA to the folder of the recordings."
        return
    log = open_log(Path(data) / "dronekit_log171_3mags" / "log171.bin")
    arm = sorted((Path(data) / "leiria_robot").glob("V_300_path1_*.npz"))
    yield "| sensor | worst heading alone, ° | together, ° | axes | but for, ° | ± | off by, ° | clock, ms |"
    yield "|---|---:|---:|---|---:|---:|---:|---:|"
    stated = recorded_site(log)
    yield from _rows(fit_multi({each.name: each for each in log.instruments}, site=stated and stated[0]))
    yield from _rows(fit_multi({path.stem.rpartition("_")[2]: read(path, unit="uT") for path in arm}))


def _rows(found: MultiFit) -> Iterator[str]:
    """Yield a row for each sensor of a body."""
    for member in found.members:
        worst = []
        for outcome in (member.alone, member.fit):
            fit = outcome.fit if isinstance(outcome, Refused) else outcome
            worst.append(f"{fit.heading_error_deg.worst:.2g}" if isinstance(fit, Fit) else "–")
        sigma = 0.0 if member.rotation_sigma_deg is None else float(member.rotation_sigma_deg.max())
        yield (
            f"| {member.name} | {' | '.join(worst)} | {member.axes} | {member.misalignment_deg:.1f} | {sigma:.1f} | "
            f"{member.scatter_deg:.2f} | {1e3 * member.delay_s:.0f} |"
        )


def time_table() -> Iterator[str]:
    """Yield CPU seconds of the joint fit, without the fits of single sensors."""
    yield "| sensors | moments | CPU s |"
    yield "|---:|---:|---:|"
    for sensors in (2, 3):
        for n in (3000, 6000, 60_000):
            true = body("hand", n, (0.5,) * sensors, 1)
            starts = [Auto().estimate(Readings.of(field)) for field in true.fields]
            begun = time.process_time()
            fit_sensors(true.fields, starts=starts)
            yield f"| {sensors} | {n:,} | {time.process_time() - begun:.2f} |"


def main() -> None:
    """Print the chosen tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", default="nees,gain,disagreements,real,time")
    parser.add_argument("--trials", type=int, default=200)
    asked = parser.parse_args()
    tables = {
        "nees": lambda: nees_table(asked.trials),
        "gain": lambda: gain_table(asked.trials),
        "disagreements": lambda: disagreements_table(asked.trials),
        "real": real_table,
        "time": time_table,
    }
    for name in asked.tables.split(","):
        sys.stdout.write(f"\n## {name}\n\n")
        for line in tables[name]():
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
