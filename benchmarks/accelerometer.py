"""Truth of the claims of fits with an accelerometer, for several accelerometers and motions. Prints Markdown.

    python -m benchmarks.accelerometer [--trials 100] [--paths "20 poses" …] [--processes 2]

Sensors, paths and readings are those of `benchmarks.adversary`; the accelerometer measures the motion of the hand too.
The first columns have the ratio of the true to the claimed worst level heading error, as median and 90 % value, which
are 1.2 and 2.1 for true claims. One ratio is for the magnetometer's own axes. The other is for axes of the body, where
the claim includes the rotation of the magnetometer against the accelerometer. The last columns have the claims, and the
number of fits that used the accelerometer and were good.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.adversary import (
    PATHS,
    RATE_HZ,
    STEPS_PER_READING,
    Effect,
    Path,
    about,
    anywhere,
    headings,
    level,
    recorded,
    sensor,
    smooth,
    stream,
)
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

GRAVITY, NOISE, STEP_S = 9.81, 0.05, 1.0 / (STEPS_PER_READING * RATE_HZ)
"""Gravity and noise of the accelerometer in m/s², and the step of the simulated motion in s."""


@dataclass(frozen=True, slots=True)
class Accelerometer:
    """Errors of gain (fraction of 1), axes (rad) and bias (m/s²), each with a random sign or direction."""

    gain: float = 0.0
    skew: float = 0.0
    bias: float = 0.0

    def read(self, rng: Generator, force: Floats) -> Floats:
        """(N, 3) noisy readings of a specific force, m/s²."""
        mixed = rng.normal(0.0, 0.5 * self.skew, (3, 3))
        gains = np.eye(3) + np.diag(rng.choice([-self.gain, self.gain], 3)) + np.triu(mixed, 1) + np.triu(mixed, 1).T
        aside = rng.standard_normal(3)
        return force @ gains + self.bias * aside / np.linalg.norm(aside) + NOISE * rng.standard_normal(force.shape)


ACCELEROMETERS: Final = {
    "exact": Accelerometer(),
    "off by 2 %, 0.2 m/s²": Accelerometer(0.02, 0.0, 0.2),
    "off by 2 %, 1°, 0.3 m/s²": Accelerometer(0.02, np.radians(1.0), 0.3),
}


def poses(rng: Generator, count: int) -> Path:
    """Path of a sensor that is held still in a number of poses for half a second each, as in a survey."""
    attitudes = np.repeat(np.stack([anywhere(rng) for _ in range(count)]), 25 * STEPS_PER_READING, axis=0)
    return _path(attitudes, np.zeros((len(attitudes), 3)))


def still(rng: Generator, of: Callable[[Generator], Path]) -> Path:
    """Path with the rotations of another one, but without translation."""
    path = of(rng)
    return replace(path, places=np.zeros_like(path.places))


def driven(rng: Generator, speed: float) -> Path:
    """Path of a vehicle that turns to and fro on rough ground for two minutes, with a tilt of 12° rms."""
    steps = round(120.0 / STEP_S)
    yaw = np.cumsum(0.5 * smooth(rng, steps, STEP_S, 2.0, 1)[:, 0]) * STEP_S
    leaning = about(np.column_stack([0.2 * smooth(rng, steps, STEP_S, 1.0, 2), np.zeros(steps)]))
    attitudes = about(yaw[:, np.newaxis] * [0.0, 0.0, 1.0]) @ leaning
    velocity = speed * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(steps)])
    return _path(attitudes, np.cumsum(velocity, axis=0) * STEP_S)


def _path(attitudes: Floats, places: Floats) -> Path:
    return Path(STEP_S * np.arange(len(attitudes)), attitudes, places)


MOVED: Final[dict[str, Callable[[Generator], Path]]] = {
    "12 poses": partial(poses, count=12),
    "20 poses": partial(poses, count=20),
    "40 poses": partial(poses, count=40),
    "tumble, on the spot": partial(still, of=PATHS["tumble"]),
    "tumble": PATHS["tumble"],
    "figure eight, on the spot": partial(still, of=PATHS["figure eight"]),
    "figure eight": PATHS["figure eight"],
    "vehicle, 1 m/s": partial(driven, speed=1.0),
    "vehicle, 8 m/s": partial(driven, speed=8.0),
}


def readings(seed: int, path: Path, accelerometer: Accelerometer) -> Samples:
    """Recording of the magnetometer and the accelerometer on a path."""
    moved = np.gradient(np.gradient(path.places, STEP_S, axis=0), STEP_S, axis=0)
    force = np.einsum("mji,mj->mi", path.attitudes, moved - [0.0, 0.0, GRAVITY])[::STEPS_PER_READING]
    felt = accelerometer.read(stream(seed, "accelerometer"), force)
    return replace(recorded(seed, sensor(stream(seed, "sensor")), Effect(), path), acceleration=felt)


@dataclass(frozen=True, slots=True)
class Trial:
    """Claimed and true worst level heading error in degrees, in the sensor's own axes and in those of the body."""

    own: tuple[float, float]
    body: tuple[float, float]
    is_used: bool
    is_good: bool


def tried(case: tuple[str, str, int]) -> Trial | None:
    """Result of one fit with the accelerometer; None without a fit."""
    name, kind, seed = case
    samples = readings(seed, MOVED[name](stream(seed, "path 0")), ACCELEROMETERS[kind])
    try:
        fit = flinders.fit(samples, aiding="dip")
    except Refused as refusal:
        fit = refusal.fit
    except flinders.FlindersError:
        return None
    raw = level(seed, sensor(stream(seed, "sensor")), Effect())
    own = np.linalg.solve(fit.calibration.ellipsoid.shape, (raw - fit.calibration.ellipsoid.centre).T).T
    claimed, aiding = fit.heading_error_deg.worst, fit.evidence.aiding
    return Trial(
        (claimed, float(np.abs(headings(own)).max())),
        (
            np.hypot(claimed, fit.claim.alignment_error_deg or 0.0),
            float(np.abs(headings(fit.calibration.apply(raw))).max()),
        ),
        is_used=aiding is not None and any(sensor.is_used for sensor in aiding.sensors),
        is_good=fit.verdict == "good",
    )


def row(name: str, kind: str, trials: Sequence[Trial | None]) -> str:
    """Row of the table."""
    fitted = [trial for trial in trials if trial is not None]
    own, body = (np.array([getattr(trial, axes) for trial in fitted]).T for axes in ("own", "body"))
    ratios = [
        f"{median:.1f} / {most:.1f}" for median, most in (np.quantile(c[1] / c[0], [0.5, 0.9]) for c in (own, body))
    ]
    claims = [f"{np.median(c[0]):.2f}°" for c in (own, body)]
    counts = [f"{sum(trial.is_used for trial in fitted)}", f"{sum(trial.is_good for trial in fitted)}"]
    return f"| {' | '.join([name, kind, *ratios, *claims, *counts])} |"


def table(paths: Sequence[str], trials: int, processes: int) -> Iterator[str]:
    """Yield a row for each motion and accelerometer."""
    yield "| motion | accelerometer | own axes | body | claim, own axes | claim, body | used | good |"
    yield "|---|---|---|---|---:|---:|---:|---:|"
    with ProcessPoolExecutor(processes) as pool:
        for name, kind in product(paths, ACCELEROMETERS):
            yield row(name, kind, list(pool.map(tried, [(name, kind, seed) for seed in range(trials)], chunksize=4)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--paths", nargs="+", default=list(MOVED), choices=MOVED, metavar="PATH")
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args(arguments)
    for line in table(chosen.paths, chosen.trials, chosen.processes):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
