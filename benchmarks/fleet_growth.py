"""Cost of extending the table of a growing fleet, and its survival of kills.

    python -m benchmarks.fleet_growth                                   # 2,000 units, extended by 200: half a minute
    python -m benchmarks.fleet_growth --units 50000 --added 500 --kills 10      # the claim: some minutes

A production line writes a log for each unit. Extending the table of all units by new ones is timed against calibrating
the new ones alone, in turn, several times. Then the program is killed at random moments and started again until it
ends; its table is compared byte for byte with that of an undisturbed run.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tests.waiting import running_in, wait_until

from flinders import simulate

READINGS, BEFORE = 500, 100
"""Readings of a new log, and of an older one, which is not opened again."""
SENSORS = 500
"""Number of different recordings; logs of other units are links to these."""


def write_logs(folder: Path, first: int, count: int, readings: int = READINGS) -> list[Path]:
    """Write a log for each of some units, named by serial number."""
    folder.mkdir(exist_ok=True)
    tumbles = [simulate.tumble(seed=seed, n=readings, motion="uniform").samples.field for seed in range(10)]
    paths: list[Path] = []
    for number in range(first, first + count):
        path = folder / f"S{number:07d}.csv"
        if len(paths) < SENSORS:
            field = tumbles[number % 10] + np.random.default_rng(number).normal(size=3)
            rows = (f"{0.02 * row:.2f},{x:.2f},{y:.2f},{z:.2f}" for row, (x, y, z) in enumerate(field.tolist()))
            path.write_text("\n".join(["t_s,mag_x_uT,mag_y_uT,mag_z_uT", *rows, ""]), encoding="utf-8")
        else:
            os.link(paths[len(paths) % SENSORS], path)
        paths.append(path)
    return paths


def started(source: Path, out: Path, *words: str) -> subprocess.Popen[bytes]:
    """Start the program."""
    command = [sys.executable, "-m", "flinders", "fleet", str(source), "--output", str(out), *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def seconds_of(source: Path, out: Path, *words: str) -> float:
    """Duration of the program, s."""
    begun = time.monotonic()
    program = started(source, out, *words)
    if program.wait() not in {0, 3}:
        raise SystemExit(f"flinders fleet {source} ended with exit code {program.returncode}")
    return time.monotonic() - begun


def killed(source: Path, out: Path, usual_s: float, rng: random.Random) -> int:
    """Kill the program at random moments, with half the probability each time, until it ends."""
    kills = 0
    while True:
        program = started(source, out, "--append")
        if rng.random() < 0.5**kills:
            time.sleep(rng.uniform(0.0, usual_s))
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGKILL)
                program.wait()
                wait_until(lambda pid=program.pid: not running_in(pid))  # type: ignore[misc]
                kills += 1
                continue
        program.wait()
        return kills


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=2_000, help="in the table")
    parser.add_argument("--added", type=int, default=200, help="that it is extended by")
    parser.add_argument("--times", type=int, default=5, help="that both are timed")
    parser.add_argument("--kills", type=int, default=3, help="runs that are killed")
    given = parser.parse_args()
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as place:
        line, alone, base, out = (Path(place) / name for name in ("line", "alone", "base.parquet", "out.parquet"))
        write_logs(line, 0, given.units, BEFORE)
        print(f"{given.units:,} units: {seconds_of(line, base, '--append'):.1f} s", flush=True)
        alone.mkdir()
        for path in write_logs(line, given.units, given.added):
            os.link(path, alone / path.name)
        appended, by_itself = [], []
        for _ in range(given.times):
            shutil.copyfile(base, out)
            appended.append(seconds_of(line, out, "--append"))
            by_itself.append(seconds_of(alone, Path(place) / "alone.parquet", "--force"))
        for name, value in (("median", statistics.median), ("fastest", min)):
            extended, only = value(appended), value(by_itself)
            times = f"in {extended:.2f} s, these alone in {only:.2f} s, ratio {extended / only:.2f}"
            print(f"{name} of {given.times}: extended by {given.added:,} {times}", flush=True)
        whole = out.read_bytes()
        for _ in range(given.kills):
            shutil.copyfile(base, out)
            kills = killed(line, out, statistics.median(appended), rng)
            same = "same bytes" if out.read_bytes() == whole else "OTHER BYTES"
            print(f"killed {kills} times: {same}", flush=True)


if __name__ == "__main__":
    main()
