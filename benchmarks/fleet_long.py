"""Memory and time of `flinders fleet` for one very long unit among units of ten readings, by its length.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.fleet_long [--readings 1000000 10000000 100000000] [--outliers 0.01]

The long unit turns about all axes at incommensurable rates, with white noise and quantisation; a share of its readings
may be outliers, which need a robust fit and are listed. It is written in row groups of a million, in single precision,
between small units in the same file. Each length runs in its own process. Prints peak memory and the true error of the
calibration, as Markdown.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.results import UnitResults

if TYPE_CHECKING:
    from flinders.arrays import Floats

READINGS: Final = (1_000_000, 10_000_000, 100_000_000)
SMALL_UNITS: Final = 100
"""Units of ten readings before and after the long one."""
GROUP_ROWS: Final = 1_000_000
"""Rows of a row group."""
MATRIX: Final = np.array([[46.0, 2.0, 0.0], [2.0, 50.0, -1.0], [0.0, -1.0, 55.0]])
OFFSET: Final = np.array([20.0, -120.0, 90.0])
"""Long sensor, µT: its readings are ``MATRIX @ direction + OFFSET``."""
NOISE_UT, STEP_UT, AWAY_UT = 0.3, 0.1, 30.0
"""Noise (1 σ), quantisation step, and size of an outlier."""
RATES: Final = (1.0, np.sqrt(2.0), np.pi)
"""Turn rates about three axes, rad/s, at 50 readings a second."""


def turned(first: int, count: int, rng: np.random.Generator, outliers: float) -> Floats:
    """(count, 3) readings of the long unit from number `first` on, µT."""
    roll, pitch, yaw = (rate * np.arange(first, first + count) / 50.0 for rate in RATES)
    directions = np.stack(
        [
            np.cos(yaw) * np.cos(pitch),
            np.cos(yaw) * np.sin(pitch) * np.sin(roll) - np.sin(yaw) * np.cos(roll),
            np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
        ],
        axis=1,
    )
    field = directions @ MATRIX + OFFSET + rng.normal(scale=NOISE_UT, size=(count, 3))
    field[rng.random(count) < outliers] += AWAY_UT
    return np.asarray(np.round(field / STEP_UT) * STEP_UT)


def write(path: Path, readings: int, outliers: float) -> int:
    """Write the fleet in pieces, and return its size in bytes."""
    from pyarrow import parquet

    rng = np.random.default_rng(1)
    before, long, after = ([f"{letter}{number:03}" for number in range(SMALL_UNITS)] for letter in "ABC")
    with parquet.ParquetWriter(path, _small(before, rng).schema) as writer:
        writer.write_table(_small(before, rng))
        for first in range(0, readings, GROUP_ROWS):
            field = turned(first, min(GROUP_ROWS, readings - first), rng, outliers)
            writer.write_table(_table(long[:1], np.zeros(len(field), dtype=np.int32), field, first))
        writer.write_table(_small(after, rng))
    return path.stat().st_size


def _small(names: list[str], rng: np.random.Generator) -> Any:  # noqa: ANN401 - pyarrow ships no types
    """Table of units of ten readings each."""
    return _table(
        names, np.repeat(np.arange(SMALL_UNITS, dtype=np.int32), 10), turned(0, 10 * SMALL_UNITS, rng, 0.0), 0
    )


def _table(names: list[str], whose: Any, field: Floats, first: int) -> Any:  # noqa: ANN401
    import pyarrow

    columns = {f"mag_{axis}_uT": field[:, place].astype(np.float32) for place, axis in enumerate("xyz")}
    time = (first + np.arange(len(field))) / 50.0
    return pyarrow.table({"unit": pyarrow.DictionaryArray.from_arrays(whose, names), "t_s": time, **columns})


def job(path: str) -> dict[str, Any]:
    """Calibrate in this process, and return cost and result."""
    begun = perf_counter()
    with tempfile.TemporaryDirectory() as made:
        told = run(path, Path(made) / "out.parquet", Options(), workers=0)
        seconds = perf_counter() - begun
        rows = UnitResults.read(Path(made) / "out.parquet")
    long = rows.row(int(np.argmax(rows.readings)))
    off = float(np.abs(np.asarray(long.offset) - OFFSET).max())
    peak = int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
    own = {"units": told.units, "method": long.method, "verdict": long.verdict, "samples": long.samples, "off": off}
    return {"seconds": seconds, "mb": peak / 1024.0, **own}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="What one very long unit costs.")
    parser.add_argument("--readings", type=int, nargs="*", default=READINGS, help="of the long unit")
    parser.add_argument("--outliers", type=float, nargs="*", default=[0.0, 0.01], help="shares of its readings")
    parser.add_argument("--folder", help="where files are made, which may be large")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.job:
        print(json.dumps(job(given.job)))
        return
    print("| readings | outliers | MB | s | µs a reading | peak memory, MB | method, verdict | used | offset off, µT |")
    print("|---:|---:|---:|---:|---:|---:|---|---:|---:|", flush=True)
    for outliers in given.outliers:
        for readings in given.readings:
            with tempfile.TemporaryDirectory(dir=given.folder) as made:
                size = write(Path(made) / "fleet.parquet", readings, outliers)
                command = [sys.executable, "-m", "benchmarks.fleet_long", "--job", made]
                took = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            print(
                f"| {readings:,} | {outliers:.0%} | {size / 1e6:.0f} | {took['seconds']:.0f} | "
                f"{took['seconds'] / readings * 1e6:.2f} | {took['mb']:.0f} | {took['method']}, {took['verdict']} | "
                f"{took['samples']:,} | {took['off']:.2g} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
