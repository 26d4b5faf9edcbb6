"""Run a function over units of work: in this process, in processes of this machine, or on a Dask cluster.

`map_units` yields the index and the result of each unit when it is done, in any order. A worker that dies (killed by a
person, or by the system for lack of memory) is replaced and its unit is run again; a unit whose worker dies
`MAX_ATTEMPTS` times is yielded as `Abandoned`, and the others continue.

>>> dict(map_units(abs, [-1, 2, -3], workers=0))
{0: 1, 1: 2, 2: 3}
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, TypeVar

from flinders.errors import LinkError, OutputError
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Unit = TypeVar("Unit")
Result = TypeVar("Result")

MAX_ATTEMPTS: Final = 3
"""Largest number of workers that may die of one task, as in Dask."""
NO_WORKER_STARTED: Final = (
    f"{MAX_ATTEMPTS} worker processes ended before they began: put the calls of a script below "
    '`if __name__ == "__main__":`, free memory for workers, or use 0 workers to do all work in this process'
)
"""Message if no worker can be started."""
TIMEOUT_S: Final = 10.0
"""Seconds within which a scheduler has to answer."""
RECOUNT_INTERVAL_S: Final = 5.0
"""Seconds after which the workers of a cluster are counted again."""
LOGGERS: Final = ("distributed", "distributed.client", "tornado", "tornado.application")
"""Loggers of Dask, with handlers of their own."""
ONE_THREAD: Final = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment variables for one thread in each worker, as the other cores have workers of their own."""
KEPT_MEMORY: Final = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 26)}
"""Bytes of freed memory that glibc keeps for the next partition, which saves a tenth of the time."""
WORKER_VARIABLES: Final = ONE_THREAD | KEPT_MEMORY
"""Environment variables of a worker."""


@dataclass(frozen=True, slots=True)
class Abandoned:
    """A unit of work whose worker died in each of `attempts` attempts."""

    attempts: int


@dataclass(frozen=True, slots=True)
class WorkerDeath:
    """A worker that died, or left a cluster."""

    worker: str  # number of its process, or its address
    place: int | None = None  # index of its unit, which is run again; None on a cluster
    attempts: int = 0  # workers that have died of this unit so far


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def map_units(
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    notice: Callable[[str], None] = lambda _: None,
    died: Callable[[WorkerDeath], None] = lambda _: None,
) -> Iterator[tuple[int, Result | Abandoned]]:
    """Run a function over units; yield the index and the result of each, in the order of completion.

    The function runs in `workers` processes (by default one for each core), in this process for 0 workers, or on the
    Dask cluster of a `scheduler`; function, units and results have to be picklable. `notice` is called with the reason
    if the run waits, `died` with each worker that died. Raises LinkError if there is no scheduler, or it goes away, and
    all errors of `work`.
    """
    if scheduler is not None:
        yield from _run_on_cluster(work, units, scheduler, notice, died)
    elif workers == 0:
        yield from ((place, work(unit)) for place, unit in enumerate(units))
    else:
        yield from _run_in_processes(work, units, workers or cores(), died)


def reach(scheduler: str) -> None:
    """Check that a scheduler answers: raises LinkError, or MissingExtra without Dask."""
    with _silence_loggers(), _client(scheduler):
        pass


# --------------------------------------------------------------------------------------------------------- processes


class _Worker:
    """Executor of one process: a pool of several processes would not report the task of a process that died."""

    def __init__(self) -> None:
        """Start the process."""
        with _environment(WORKER_VARIABLES), _block_interrupts():
            self.executor = ProcessPoolExecutor(1, _context(), _prepare)
            self._pid = self.executor.submit(os.getpid)

    def submit(self, work: Callable[[Unit], Result], unit: Unit) -> Future[Result]:
        """Run a unit; if the process has already died, the future has its error."""
        try:
            return self.executor.submit(work, unit)
        except BrokenProcessPool as error:
            future: Future[Result] = Future()
            future.set_exception(error)
            return future

    @property
    def pid(self) -> str:
        """Number of the process; empty if the process died before its number was known."""
        return "" if self._pid.exception() else str(self._pid.result())

    def stop(self) -> None:
        """Kill the process; no result is lost."""
        for process in multiprocessing.active_children():
            if str(process.pid) == self.pid:
                process.kill()
        self.executor.shutdown(cancel_futures=True)


def _run_in_processes(
    work: Callable[[Unit], Result], units: Sequence[Unit], count: int, died: Callable[[WorkerDeath], None]
) -> Iterator[tuple[int, Result | Abandoned]]:
    """Keep `count` processes busy, and replace those that die."""
    waiting = deque(range(len(units)))
    attempts: Counter[int] = Counter()
    unstarted = 0
    workers = {_Worker() for _ in range(min(count, len(units)))}
    busy: dict[Future[Result], tuple[_Worker, int]] = {}

    def give(worker: _Worker) -> None:
        if waiting:
            place = waiting.popleft()
            busy[worker.submit(work, units[place])] = worker, place

    try:
        for worker in workers:
            give(worker)
        while busy:
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                worker, place = busy.pop(future)
                if not isinstance(future.exception(), BrokenProcessPool):
                    yield place, future.result()
                    give(worker)
                    continue
                attempts[place] += 1
                unstarted = 0 if worker.pid else unstarted + 1
                if unstarted == MAX_ATTEMPTS:
                    raise LinkError(NO_WORKER_STARTED)
                died(WorkerDeath(worker.pid, place, attempts[place]))
                workers.remove(worker)
                worker.stop()
                if attempts[place] < MAX_ATTEMPTS:
                    waiting.appendleft(place)
                else:
                    yield place, Abandoned(attempts[place])
                workers.add(worker := _Worker())
                give(worker)
    finally:
        for worker in workers:
            worker.stop()


def _context() -> Any:  # noqa: ANN401 - one of several classes
    """Context that starts processes from a server with their imports done: safe with threads, fast to replace."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["flinders.apps.fleet.worker"])
    return context


def begin_processes() -> None:
    """Start the server of processes, which does their imports while this process continues."""
    if "forkserver" in multiprocessing.get_all_start_methods():
        _context()
        with _environment(WORKER_VARIABLES), _block_interrupts():
            forkserver.ensure_running()


def _prepare() -> None:
    """Ignore Ctrl-C, which the parent process handles, and end when the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait for the end of the parent process, then end this one."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set unset environment variables for processes that are started within the block."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextlib.contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes that are started within the block; in this process it is delivered at the end."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start unblocks signals, so it has to run before they are blocked
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ----------------------------------------------------------------------------------------------------------- cluster


def _run_on_cluster(
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    scheduler: str,
    notice: Callable[[str], None],
    died: Callable[[WorkerDeath], None],
) -> Iterator[tuple[int, Result | Abandoned]]:
    """Run units on a cluster; raises LinkError if the scheduler disappears."""
    distributed = _distributed()
    with _silence_loggers():
        client = _client(scheduler)
        gone = (OSError, distributed.CancelledError, distributed.client.ClosedClientError)
        try:
            with client:
                yield from _submit(client, work, units, scheduler, notice, died)
        except gone:
            raise _gone_error(scheduler) from None


def _client(scheduler: str) -> Any:  # noqa: ANN401 - Dask ships no types
    """Connect to a cluster; raises LinkError if it does not answer."""
    try:
        return _distributed().Client(scheduler, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise LinkError(
            f"no Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`"
        ) from None


def _submit(
    client: Any,  # noqa: ANN401 - Dask ships no types
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    scheduler: str,
    notice: Callable[[str], None],
    died: Callable[[WorkerDeath], None],
) -> Iterator[tuple[int, Result | Abandoned]]:
    """Submit all units, and yield results as they are done; each is released once it is read."""
    places = {future: place for place, future in enumerate(client.map(work, units, pure=False))}
    done = _distributed().as_completed(list(places), loop=client.loop, raise_errors=False)
    present, looked = _current_workers(client, set(), died), monotonic()
    if not present:
        notice(f"{scheduler} has no workers: waiting for one (`dask worker {scheduler}` starts one)")
    for future in done:
        yield places.pop(future), _future_result(future, scheduler)
        future.release()
        if monotonic() - looked > RECOUNT_INTERVAL_S:
            present, looked = _current_workers(client, present, died), monotonic()
    with contextlib.suppress(OSError):  # all units are done, so the scheduler may have gone
        _current_workers(client, present, died)


def _current_workers(client: Any, before: set[str], died: Callable[[WorkerDeath], None]) -> set[str]:  # noqa: ANN401
    """Names of the present workers of a cluster; calls `died` for each worker in `before` that is gone."""
    now = set(client.nthreads())
    for worker in sorted(before - now):
        died(WorkerDeath(worker))
    return now


def _future_result(future: Any, scheduler: str) -> Any:  # noqa: ANN401
    """Result of a Dask future; raises the error of its worker."""
    while future.status == "lost":  # its worker died with the result before it was read
        future.exception()  # waits until another worker has run it again
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if isinstance(error, _distributed().scheduler.KilledWorker):
            return Abandoned(MAX_ATTEMPTS)
        if isinstance(error, OutputError):
            raise OutputError(str(error))
        raise RuntimeError(f"a worker of {scheduler} could not do its work: {type(error).__name__}: {error}")
    raise _gone_error(scheduler)


@contextlib.contextmanager
def _silence_loggers() -> Iterator[None]:
    """Silence the loggers of Dask, which write pages about a scheduler that is gone."""
    handlers = [handler for name in LOGGERS for handler in logging.getLogger(name).handlers]
    levels = [handler.level for handler in handlers]
    for handler in handlers:
        handler.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for handler, level in zip(handlers, levels, strict=True):
            handler.setLevel(level)


def _gone_error(scheduler: str) -> LinkError:
    """Error about a scheduler that went away during the run."""
    return LinkError(
        f"the Dask scheduler at {scheduler} is gone: start it, and continue the run", hint={"append": True}
    )


def _distributed() -> Any:  # noqa: ANN401
    """Import Dask's distributed; raises MissingExtra if it is not installed."""
    for module in ("client", "scheduler"):
        import_optional(f"distributed.{module}", "fleet", "a run on a Dask scheduler")
    return import_optional("distributed", "fleet", "a run on a Dask scheduler")
