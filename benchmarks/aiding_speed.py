"""Processor time of `flinders.fit` with an aiding sensor, on simulated recordings. Prints Markdown.

    python -m benchmarks.aiding_speed [--readings 50000] [--motions drive …] [--repeats 1]

Attitudes are the true ones with independent errors of 1° about each axis. "A magnet passes" is a field of up to 100 µT
during a part of the recording. The time is the processor time with one thread of BLAS, the shortest of the repeats.
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from dataclasses import replace
from itertools import product
from time import process_time
from typing import TYPE_CHECKING, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported

import numpy as np

import flinders
from flinders import simulate
from flinders.errors import FitError
from flinders.geometry.quaternions import from_matrix
from flinders.simulate import turns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Samples
    from flinders.simulate import Perturbation

MOTIONS: Final = ("hand", "rocked", "flight", "drive")
AIDING: Final = ("dip", "attitude")
FIELDS: Final[dict[str, Sequence[Perturbation]]] = {"clean": (), "a magnet passes": (simulate.PassingMagnet(100.0),)}
ATTITUDE_DEG: Final = 1.0


def recording(motion: str, disturbances: Sequence[Perturbation], readings: int) -> Samples:
    """A simulated recording with an accelerometer and attitudes."""
    true = simulate.tumble(1, motion=motion, n=readings, disturbances=disturbances)
    if true.attitudes is None:
        raise ValueError(f"motion {motion!r} has no attitudes")
    errors = np.random.default_rng(1).normal(0.0, np.radians(ATTITUDE_DEG), (readings, 3))
    return replace(true.samples, attitude=from_matrix(true.attitudes @ turns(errors)))


def fit_seconds(samples: Samples, aiding: str, repeats: int) -> float:
    """Shortest processor time in s of several fits."""
    times = []
    for _ in range(repeats):
        begun = process_time()
        with suppress(FitError):  # a refused fit takes as long
            flinders.fit(samples, aiding=aiding)
        times.append(process_time() - begun)
    return min(times)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each motion and field."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--readings", type=int, default=50_000)
    parser.add_argument("--motions", nargs="+", default=MOTIONS, choices=MOTIONS, metavar="MOTION")
    parser.add_argument("--repeats", type=int, default=1)
    chosen = parser.parse_args(arguments)
    print(f"| {chosen.readings:,} readings | field | " + " | ".join(f"{name}, CPU s" for name in AIDING) + " |")
    print("|---|---|" + "---:|" * len(AIDING))
    for motion, (field, disturbances) in product(chosen.motions, FIELDS.items()):
        samples = recording(motion, disturbances, chosen.readings)
        times = [f"{fit_seconds(samples, name, chosen.repeats):.1f}" for name in AIDING]
        print(f"| {motion} | {field} | {' | '.join(times)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
