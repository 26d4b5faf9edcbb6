"""What looking at the files of a fleet takes, before any work begins: on a disk, and in a store that is far away.

    python -m benchmarks.fleet_files [--files 2000] [--latency 0.03]

The store is `benchmarks.bucket` on this machine, which waits so long before each answer. Files have a unit each, so
that each has a footer to be read and nothing else. "One at a time" is what threads are held against. Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.bucket import Bucket
from flinders.fleet import plan
from flinders.fleet.dataset import Options


def write(folder: Path, files: int) -> None:
    """Write files of a hundred readings of a unit each."""
    import pyarrow
    from pyarrow import parquet

    axes = {f"mag_{axis}_uT": np.arange(100.0) for axis in "xyz"}
    for place in range(files):
        table = pyarrow.table({"unit": [f"U{place:06}"] * 100, **axes})
        parquet.write_table(table, folder / f"{place:06}.parquet")


def looked(where: str, at_once: int) -> tuple[float, str]:
    """Seconds that it took to plan, and the plan's fingerprint, which must not depend on how it was done."""
    plan.LOOKS, usual = at_once, plan.LOOKS  # type: ignore[misc]
    begun = perf_counter()
    try:
        found = plan.plan_of(where, Options())
    finally:
        plan.LOOKS = usual  # type: ignore[misc]
    return perf_counter() - begun, f"{found.fingerprint[:8]}, {len(found.partitions)} partitions"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="What looking at files takes.")
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--latency", type=float, default=0.03, help="of the store, in seconds")
    given = parser.parse_args()
    print("| files | where | at a time | s | ms a file | requests | plan |\n|---:|---|---:|---:|---:|---:|---|")
    with tempfile.TemporaryDirectory() as made:
        write(Path(made), given.files)
        held = {path.name: path.read_bytes() for path in Path(made).iterdir()}
        with Bucket(held, latency_s=given.latency) as bucket:
            os.environ.update(bucket.environment)
            for name, where in (("disk", made), (f"store, {given.latency:g} s away", "s3://fleet/")):
                for at_once in (1, plan.LOOKS):
                    before = bucket.asked
                    seconds, told = looked(where, at_once)
                    each = 1e3 * seconds / given.files
                    asked = bucket.asked - before
                    print(
                        f"| {given.files:,} | {name} | {at_once} | {seconds:.2f} | {each:.2f} | {asked} | {told} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
