"""Times of the engine and of a prototype without covariance, outliers and statistics, measured in one run.

    python -m benchmarks.engine [path of core_prototype.c]

Each time is the median processor time of several calls in µs. The prototype is compiled with and without -ffast-math,
and is called through ctypes too.
"""

from __future__ import annotations

import ctypes
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flinders.native import build
from flinders.native.engine import Engine

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

PROTOTYPE = Path("../shared/bench/core_prototype.c")

RUNS = {500: 400, 50_000: 20, 1_000_000: 5}
"""Number of calls that are timed, by the number of readings."""


def cloud(rows: int) -> Floats:
    """(rows, 3) readings in all directions, 50 µT with 0.5 µT of noise."""
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(rows, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)


def median_us(call: Callable[[], object], runs: int) -> float:
    """Median processor time of a call in µs."""
    times = []
    for _ in range(runs):
        begun = time.thread_time()
        call()
        times.append(time.thread_time() - begun)
    return 1e6 * statistics.median(times)


def prototype(source: Path, folder: Path, *options: str) -> Callable[[Floats], Callable[[], object]]:
    """Function that prepares the prototype's fit of one recording; the prototype is compiled with some options."""
    target = folder / f"prototype{len(options)}.so"
    command = [
        *build.compiler(),
        "-O3",
        "-std=gnu99",
        *options,
        "-shared",
        "-fPIC",
        str(source),
        "-lm",
        "-o",
        str(target),
    ]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(target))

    def timed(field: Floats) -> Callable[[], object]:
        out = np.zeros(9)
        return lambda: library.fit_many(
            ctypes.c_void_p(field.ctypes.data), 1, len(field), ctypes.c_void_p(out.ctypes.data)
        )

    return timed


def main() -> None:
    """Print the table."""
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else PROTOTYPE
    engine = Engine()
    calls: dict[str, Callable[[Floats], Callable[[], object]]] = {
        "engine, whole record": lambda field: lambda: engine.fit(field),
        "engine, whole record, baseline": lambda field: lambda: engine.fit(field, kernels=1),
        "engine, fit and covariance": lambda field: lambda: engine.fit(field, robust=0, statistics=0),
    }
    with tempfile.TemporaryDirectory() as folder:
        if source.exists():
            calls["prototype -ffast-math"] = prototype(source, Path(folder), "-ffast-math")
            calls["prototype"] = prototype(source, Path(folder))
        print(f"{'µs':34}" + "".join(f"{rows:>14,}" for rows in RUNS))
        for name, of in calls.items():
            print(f"{name:34}" + "".join(f"{median_us(of(cloud(rows)), runs):14,.0f}" for rows, runs in RUNS.items()))
        many, offsets = np.tile(cloud(500), (200, 1)), np.arange(201) * 500
        each = median_us(lambda: engine.fit_many(many, offsets), 5) / 200
        print(f"{'engine, one of 200 at once':34}{each:14,.0f}")


if __name__ == "__main__":
    main()
