"""A fleet while it is being killed: its workers and the program itself, at random moments.

    python -m benchmarks.fleet_kills [--times 10]

Each line is one run whose table is compared byte for byte with that of a run which nobody disturbed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow
from pyarrow import parquet

from flinders import simulate
from flinders.fleet.run import run
from flinders.fleet.tables import Asked

FILES, UNITS, READINGS = 24, 50, 300


def written(folder: Path) -> str:
    """A fleet of files with units of their own."""
    tumbles = [simulate.tumble(seed=seed, n=READINGS, motion="uniform").samples.field for seed in range(10)]
    rng = np.random.default_rng(0)
    for place in range(FILES):
        names = [f"U{place:03d}-{unit:03d}" for unit in range(UNITS)]
        field = np.concatenate([tumbles[unit % 10] + rng.normal(size=3) for unit in range(UNITS)])
        columns = {f"mag_{axis}_uT": field[:, column] for column, axis in enumerate("xyz")}
        table = pyarrow.table({"unit": np.repeat(names, READINGS), **columns})
        parquet.write_table(table, folder / f"{place:03d}.parquet")
    return str(folder)


def worker_killed(source: str, out: Path, after: int) -> str:
    """Kill a worker by its pid once so many partitions are done."""
    done: list[int] = []
    killed: list[int] = []

    def kill(*_: int) -> None:
        done.append(1)
        children = multiprocessing.active_children()
        if len(done) == after and children[0].pid:
            killed.append(children[0].pid)
            os.kill(children[0].pid, signal.SIGKILL)

    run(source, out, Asked(), workers=2, force=True, watch=kill)
    return f"worker {killed[0]} killed"


def program_killed(source: str, out: Path, after: int) -> str:
    """Kill the program once so many partitions are done, and resume."""
    out.unlink(missing_ok=True)
    command = [sys.executable, "-m", "flinders", "fleet", source, "--out", str(out), "--workers", "2"]
    program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    parts = Path(f"{out}.parts")
    while program.poll() is None and len(list(parts.glob("part-*"))) < after:
        time.sleep(0.001)
    program.kill()
    program.wait()
    told = run(source, out, Asked(), workers=2, resume=True)
    return f"program killed, {told.resumed} of {told.partitions} partitions stayed"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=10)
    times = parser.parse_args().times
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "in").mkdir()
        source, whole, out = written(Path(place) / "in"), Path(place) / "whole.parquet", Path(place) / "out.parquet"
        begun = time.monotonic()
        run(source, whole, Asked(), workers=2)
        seconds = time.monotonic() - begun
        print(f"undisturbed: {FILES * UNITS:,} units in {seconds:.1f} s")
        for kind in (worker_killed, program_killed):
            for _ in range(times):
                after = rng.randrange(1, FILES - 2)
                told = kind(source, out, after)
                same = "same bytes" if out.read_bytes() == whole.read_bytes() else "OTHER BYTES"
                print(f"after {after:2} partitions: {told}: {same}", flush=True)


if __name__ == "__main__":
    main()
