"""Detection of readings that do not suit a calibration by ``apply`` and ``heading``, and false alarms. Prints Markdown.

    python -m benchmarks.suitability [--trials 1000]

A sensor is calibrated from 1,000 readings by hand with 0.1 to 2 µT of noise; one recording in ten has slow noise, too.
After the change in the row, it is recorded again by hand, level, or tilted by 35°.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders import simulate
from flinders.errors import FitError, InputError
from flinders.fitting.result import Refused
from flinders.workflows.suitability import CorrectionMonitor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.simulate import Sensor

COUNT: Final = 1000
MOTIONS: Final = ("hand", "level", "tilted")
FIELD: Final = 50.0
"""µT."""


def moved(sensor: Sensor, rng: np.random.Generator, share: float) -> Sensor:
    """The sensor with its offset moved by a share of the field in a random direction."""
    way = rng.normal(size=3)
    return replace(sensor, offset=np.asarray(sensor.offset) + share * FIELD * way / np.linalg.norm(way))


ROWS: Final[dict[str, Callable[[Sensor, np.random.Generator], Sensor]]] = {
    "nothing": lambda sensor, _: sensor,
    "offset moved by 5 % of the field": lambda sensor, rng: moved(sensor, rng, 0.05),
    "offset moved by 20 % of the field": lambda sensor, rng: moved(sensor, rng, 0.2),
    "another sensor": lambda sensor, rng: simulate.Sensor.random(rng, noise=sensor.noise),
}


def slow(rng: np.random.Generator, readings: Floats) -> Floats:
    """Readings with 0.5 µT of slow noise in one recording of ten."""
    if rng.random() > 0.1:
        return readings
    wandering = np.cumsum(rng.normal(size=readings.shape), axis=0)
    slowed: Floats = readings + 0.5 * (wandering - wandering.mean(axis=0)) / wandering.std()
    return slowed


def calibrated(rng: np.random.Generator, sensor: Sensor) -> Fit | None:
    """Fit of a sensor from a tumble by hand; None if refused."""
    readings = slow(rng, simulate.tumble(rng, motion="hand", n=COUNT, sensor=sensor).samples.field)
    try:
        return flinders.fit(readings)
    except (Refused, FitError):
        return None


def is_doubted(fit: Fit, readings: Floats) -> bool:
    """Whether readings are reported as unsuitable, or refused."""
    corrector = CorrectionMonitor(fit, "readings")
    try:
        corrector(readings)
    except InputError:
        return True
    return bool(corrector.notes())


def row(name: str, trials: int) -> str:
    """Row of the table: number of fits, and number of recordings after the change that are doubted."""
    doubted = fits = 0
    for seed in range(trials):
        rng = np.random.default_rng([seed, 20])
        sensor = simulate.Sensor.random(rng, noise=float(rng.uniform(0.1, 2.0)))
        if (fit := calibrated(rng, sensor)) is None:
            continue
        again = simulate.tumble(rng, motion=MOTIONS[seed % 3], n=COUNT, sensor=ROWS[name](sensor, rng)).samples.field
        doubted, fits = doubted + is_doubted(fit, slow(rng, again)), fits + 1
    return f"| {name} | {fits} | {doubted} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.suitability", description="Which readings are doubted.")
    parser.add_argument("--trials", type=int, default=1000)
    trials = parser.parse_args(arguments).trials
    print("| what changed | recordings | doubted |\n|---|---:|---:|")
    for name in ROWS:
        print(row(name, trials), flush=True)


if __name__ == "__main__":
    main()
