"""Cost of a fleet with a file for each unit: inspecting the files, and calibrating a unit.

    python -m benchmarks.fleet_files [--files 2000] [--latency 0.03] [--units 600]

The store is `benchmarks.bucket` on this machine, which delays each answer. Each file has one unit, so that only its
footer is read. "One at a time" is the reference for threads. A second table has the processor time of one core for a
unit of 500 readings in its own file, the least of five runs. Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from benchmarks.bucket import Bucket
from flinders.apps.fleet import plan
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.simulate import fleet

REPEATS = 5
"""Number of runs; the shortest counts."""


def write(folder: Path, files: int) -> None:
    """Write files with one unit of a hundred readings each."""
    import pyarrow
    from pyarrow import parquet

    axes = {f"mag_{axis}_uT": np.arange(100.0) for axis in "xyz"}
    for place in range(files):
        table = pyarrow.table({"unit": [f"U{place:06}"] * 100, **axes})
        parquet.write_table(table, folder / f"{place:06}.parquet")


def looked(where: str, at_once: int) -> tuple[float, str]:
    """Seconds for the plan, and the plan's fingerprint, which must not depend on the method."""
    plan.MAX_OPEN_FILES, usual = at_once, plan.MAX_OPEN_FILES  # type: ignore[misc]
    begun = perf_counter()
    try:
        found = plan.plan_of(where, Options())
    finally:
        plan.MAX_OPEN_FILES = usual  # type: ignore[misc]
    return perf_counter() - begun, f"{found.fingerprint[:8]}, {len(found.partitions)} partitions"


def write_units(folder: Path, kind: str, units: int) -> None:
    """Write files with one unit of 500 readings each, as Parquet or as text."""
    import pyarrow
    from pyarrow import csv, parquet

    writers = {"parquet": parquet.write_table, "csv": csv.write_csv}
    for unit in fleet(units, seed=1, bad=0.0, readings=500):
        axes = {f"mag_{axis}_uT": unit.samples.field[:, place] for place, axis in enumerate("xyz")}
        writers[kind](pyarrow.table({"time_s": unit.samples.time, **axes}), folder / f"{unit.name}.{kind}")


def unit_ms(kind: str, units: int) -> float:
    """Processor time on one core, ms a unit."""
    with tempfile.TemporaryDirectory() as made, tempfile.TemporaryDirectory() as out:
        write_units(Path(made), kind, units)
        times = []
        for number in range(REPEATS + 1):  # the first run imports modules
            begun = process_time()
            run(made, Path(out) / f"{number}.parquet", Options(), workers=0)
            times.append(process_time() - begun)
    return 1e3 * min(times[1:]) / units


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="What a fleet with a file for each unit takes.")
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--latency", type=float, default=0.03, help="of the store, in seconds")
    parser.add_argument("--units", type=int, default=600, help="that are calibrated")
    given = parser.parse_args()
    print("| files | where | at a time | s | ms a file | requests | plan |\n|---:|---|---:|---:|---:|---:|---|")
    with tempfile.TemporaryDirectory() as made:
        write(Path(made), given.files)
        held = {path.name: path.read_bytes() for path in Path(made).iterdir()}
        with Bucket(held, latency_s=given.latency) as bucket:
            os.environ.update(bucket.environment)
            for name, where in (("disk", made), (f"store, {given.latency:g} s away", "s3://fleet/")):
                for at_once in (1, plan.MAX_OPEN_FILES):
                    before = bucket.asked
                    seconds, told = looked(where, at_once)
                    each = 1e3 * seconds / given.files
                    asked = bucket.asked - before
                    print(
                        f"| {given.files:,} | {name} | {at_once} | {seconds:.2f} | {each:.2f} | {asked} | {told} |",
                        flush=True,
                    )
    print("\n| a unit in a file of its own | ms of CPU |\n|---|---:|")
    for kind in ("parquet", "csv"):
        print(f"| {kind} | {unit_ms(kind, given.units):.1f} |", flush=True)


if __name__ == "__main__":
    main()
