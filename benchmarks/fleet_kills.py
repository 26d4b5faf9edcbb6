"""Runs of a fleet whose workers, or the program itself, are killed at random moments.

    python -m benchmarks.fleet_kills [--times 10]
    python -m benchmarks.fleet_kills --scheduler [--times 5]     # workers and the scheduler of a Dask cluster instead

Each line is one run whose table is compared byte for byte with that of an undisturbed run. The cluster is a scheduler
and two workers, processes that are not restarted.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow
from distributed import Client
from pyarrow import parquet
from tests.waiting import running_in, wait_until

from flinders import simulate
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import plan_of

if TYPE_CHECKING:
    from collections.abc import Iterator

FILES, UNITS, READINGS = 48, 50, 300


def written(folder: Path) -> str:
    """Write a fleet of files, each with its own units."""
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
    """Kill a worker by its pid after some partitions."""
    done: list[int] = []
    killed: list[int] = []

    def kill(*_: int) -> None:
        done.append(1)
        children = multiprocessing.active_children()
        if len(done) == after and children[0].pid:
            killed.append(children[0].pid)
            os.kill(children[0].pid, signal.SIGKILL)

    run(source, out, Options(), workers=2, force=True, watch=kill)
    return f"worker {killed[0]} killed"


def started(source: str, out: Path, after: int, *words: str) -> subprocess.Popen[str]:
    """Start the program, and return it after some partitions."""
    out.unlink(missing_ok=True)
    command = [sys.executable, "-m", "flinders", "fleet", source, "--output", str(out), *words]
    program = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    parts = Path(f"{out}.parts")
    while program.poll() is None and len(list(parts.glob("part-*"))) < after:
        time.sleep(0.001)
    return program


def program_killed(source: str, out: Path, after: int) -> str:
    """Kill the program after some partitions, and continue."""
    return ended_by(signal.SIGKILL, source, out, after)


def program_interrupted(source: str, out: Path, after: int) -> str:
    """Interrupt the program like Ctrl-C after some partitions, and continue."""
    return ended_by(signal.SIGINT, source, out, after)


def ended_by(number: signal.Signals, source: str, out: Path, after: int) -> str:
    """End the program by a signal, wait for the end of its workers, and continue."""
    program = started(source, out, after, "--workers", "2")
    program.send_signal(number)
    begun = time.monotonic()
    program.wait()
    wait_until(lambda: not running_in(program.pid))
    seconds = time.monotonic() - begun
    told = run(source, out, Options(), workers=2, append=True)
    return (
        f"{number.name}: program and workers ended in {seconds:.1f} s, "
        f"{told.resumed} of {told.partitions} partitions stayed"
    )


class Cluster:
    """A Dask scheduler and its workers, each a process of its own.

    Attributes
    ----------
    address : str
    scheduler : Popen
    workers : list of Popen
    """

    def __init__(self, workers: int = 2) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        port = self.address.rpartition(":")[2]
        self.scheduler = self._begun("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.workers: list[subprocess.Popen[bytes]] = []
        for _ in range(workers):
            self.add()

    def _begun(self, program: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *words]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def add(self) -> None:
        """Start another worker."""
        words = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--death-timeout", "60"]
        self.workers.append(self._begun("dask_worker", self.address, *words))

    def wait(self) -> None:
        """Wait until all workers are connected."""
        with Client(self.address, timeout=60, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(len(self.workers), timeout=60)

    def end(self) -> None:
        """Kill the remaining processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextlib.contextmanager
def cluster() -> Iterator[Cluster]:
    """Yield a ready cluster."""
    made = Cluster()
    try:
        made.wait()
        yield made
    finally:
        made.end()


def cluster_worker_killed(source: str, out: Path, after: int) -> str:
    """Kill a worker of a cluster by its pid after some partitions, without a replacement."""
    done: list[int] = []
    with cluster() as made:

        def kill(*_: int) -> None:
            done.append(1)
            if len(done) == after:
                made.workers[0].kill()

        told = run(source, out, Options(), scheduler=made.address, force=True, watch=kill)
    return f"worker {made.workers[0].pid} of the cluster killed, {told.workers_lost} seen to leave"


def scheduler_killed(source: str, out: Path, after: int) -> str:
    """Kill the scheduler after some partitions, start another cluster, and continue."""
    with cluster() as made:
        program = started(source, out, after, "--scheduler", made.address)
        made.scheduler.kill()
        begun = time.monotonic()
        _, said = program.communicate()
        seconds = time.monotonic() - begun
    print(f"    exit code {program.returncode} after {seconds:.1f} s: {' '.join(said.split())}")
    with cluster() as made:
        told = run(source, out, Options(), scheduler=made.address, append=True)
    return f"scheduler killed, {told.resumed} of {told.partitions} partitions stayed"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--scheduler", action="store_true", help="kill workers and scheduler of a Dask cluster")
    given = parser.parse_args()
    times = given.times
    of_cluster = (cluster_worker_killed, scheduler_killed)
    kinds = of_cluster if given.scheduler else (worker_killed, program_killed, program_interrupted)
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "in").mkdir()
        source, whole, out = written(Path(place) / "in"), Path(place) / "whole.parquet", Path(place) / "out.parquet"
        begun = time.monotonic()
        run(source, whole, Options(), workers=2)
        seconds = time.monotonic() - begun
        partitions = len(plan_of(source, Options()).partitions)
        print(f"undisturbed: {FILES * UNITS:,} units in {partitions} partitions in {seconds:.1f} s")
        for kind in kinds:
            for _ in range(times):
                after = rng.randrange(1, partitions - 2)
                told = kind(source, out, after)
                same = "same bytes" if out.read_bytes() == whole.read_bytes() else "OTHER BYTES"
                print(f"after {after:2} partitions: {told}: {same}", flush=True)


if __name__ == "__main__":
    main()
