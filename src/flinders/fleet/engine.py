"""Run a function over units of work: in this process, in processes of this machine, or on a Dask cluster.

`map_units` yields results as they come, each with the place of its unit, so that whoever commits them decides about
order. A worker that is killed (by a person, or by the system for want of memory) is replaced, and its unit is tried
again; a unit that takes its worker with it `ATTEMPTS` times comes back as `Lost`, and the others go on.

>>> dict(map_units(abs, [-1, 2, -3], workers=0))
{0: 1, 1: 2, 2: 3}

Plain futures are used, nothing of Dask's collections: a file or a range of its row groups is the unit of work, and a
result is small.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
from collections import deque
from dataclasses import dataclass
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, TypeVar

from flinders.errors import LinkError, MissingExtra, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

Unit = TypeVar("Unit")
Result = TypeVar("Result")

ATTEMPTS: Final = 3
"""Workers that a unit of work may cost; as many as Dask allows."""
AHEAD: Final = 4
"""Units that a cluster is given for each of its threads before the first of them is done."""
PATIENCE_S: Final = 10.0
"""Seconds within which a scheduler has to answer."""
RECOUNT_S: Final = 5.0
"""Seconds after which the threads of a cluster are counted again: workers come and go."""
LOGGERS: Final = ("distributed", "distributed.client", "tornado", "tornado.application")
"""Of Dask, with handlers of their own."""
ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment of a worker: its matrices are small, and the other cores have workers of their own."""


@dataclass(frozen=True, slots=True)
class Lost:
    """A unit of work whose worker died each time it was tried.

    Attributes
    ----------
    attempts : int
    """

    attempts: int


@dataclass(frozen=True, slots=True)
class Death:
    """A worker that died, or left a cluster.

    Attributes
    ----------
    worker : str
        The number of its process, or its address.
    place : int, optional
        Of the unit that it worked on, which is done again; a cluster does not say.
    attempts : int
        Workers that this unit has cost so far.
    """

    worker: str
    place: int | None = None
    attempts: int = 0


@dataclass(frozen=True, slots=True)
class _Raised:
    """What a worker could not do, in words: exceptions do not all survive the way between processes."""

    words: str
    is_output: bool = False


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def map_units(
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    notice: Callable[[str], None] = lambda _: None,
    died: Callable[[Death], None] = lambda _: None,
) -> Iterator[tuple[int, Result | Lost]]:
    """Run a function over units, and yield the place of each and its result, as they are done.

    Parameters
    ----------
    work : callable
        That can be pickled; so can units and results.
    units : sequence
    workers : int, optional
        Processes of this machine, by default one for each core; 0 for none but this one.
    scheduler : str, optional
        Address of a Dask scheduler, such as ``tcp://10.0.0.1:8786``, in place of processes.
    notice : callable, optional
        Is told what keeps the work from going on: a scheduler without workers.
    died : callable, optional
        Is told of each worker that died; of those of a cluster with a delay of up to `RECOUNT_S`.

    Raises
    ------
    LinkError
        Where there is no scheduler, or it goes away.
    MissingExtra
        Where Dask is not installed.
    RuntimeError
        Where `work` raises, which it should not.
    """
    if scheduler is not None:
        yield from _on_cluster(work, units, scheduler, notice, died)
    elif workers == 0:
        yield from ((place, work(unit)) for place, unit in enumerate(units))
    else:
        yield from _in_processes(work, units, min(workers or cores(), max(len(units), 1)), died)


def reach(scheduler: str) -> None:
    """See that a scheduler answers, before anything is done for it.

    Raises
    ------
    LinkError
        Where it does not.
    MissingExtra
        Where Dask is not installed.
    """
    with _quiet(), _client(scheduler):
        pass


class _Worker:
    """A process and the pipe to it; `place` is that of the unit it works on."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        context = _context()
        self.connection, other = context.Pipe()
        self.process: BaseProcess = context.Process(target=_serve, args=(other, work), daemon=True)
        with _environment(dict.fromkeys(ONE_THREAD, "1")), _deaf():
            self.process.start()
        other.close()
        self.place: int | None = None

    def give(self, place: int, unit: object) -> None:
        """Hand over a unit; where the process is gone, that shows when it is waited for."""
        self.place = place
        with contextlib.suppress(OSError):
            self.connection.send(unit)

    def taken(self) -> Any:  # noqa: ANN401 - what the function returned
        """The result.

        Raises
        ------
        EOFError
            Where the process is gone.
        """
        try:
            return self.connection.recv()
        except OSError:
            raise EOFError from None

    def end(self) -> None:
        """Let it go; one that does not within a second is killed."""
        self.connection.close()
        self.process.join(0.0 if self.place is not None else 1.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def _context() -> Any:  # noqa: ANN401 - one of several classes
    """How processes are started: by a server that has imported what they need, where the system has one.

    It is started with the environment of workers and before anything else runs in it, so that forking it is safe, and
    a worker that takes the place of a dead one is there at once.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["flinders.fleet.work"])
    return context


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Variables that a process which is started here finds, where nobody has set them."""
    added = {name: value for name, value in values.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach from their first moment on; here it is heard when the block ends."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it unblocks what is blocked when it starts, so that it has to run by then
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """What a worker does until the pipe closes, also because the driver is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver, also where it cannot be blocked
    while True:
        try:
            unit = connection.recv()
        except (EOFError, OSError):
            return
        try:
            result = work(unit)
        except OutputError as error:  # a full disk is told as it is
            result = _Raised(str(error), is_output=True)
        except Exception as error:  # noqa: BLE001 - told to the driver, which raises it
            import traceback

            result = _Raised("".join(traceback.format_exception(error)))
        try:
            connection.send(result)
        except OSError:
            return


def _in_processes(
    work: Callable[[Unit], Result], units: Sequence[Unit], count: int, died: Callable[[Death], None]
) -> Iterator[tuple[int, Result | Lost]]:
    """Keep so many processes busy, and replace those that die."""
    waiting = deque(range(len(units)))
    attempts = dict.fromkeys(waiting, 0)
    workers = [_Worker(work) for _ in range(count)] if units else []
    try:
        for worker in workers:
            worker.give(waiting[0], units[waiting.popleft()])
        while any(worker.place is not None for worker in workers):
            busy = {worker.connection: worker for worker in workers if worker.place is not None}
            for ready in wait(list(busy)):
                worker = busy[ready]
                place = worker.place
                assert place is not None
                try:
                    yield place, _checked(worker.taken())
                    worker.place = None
                except EOFError:
                    attempts[place] += 1
                    died(Death(str(worker.process.pid), place, attempts[place]))
                    worker.end()
                    if attempts[place] < ATTEMPTS:
                        waiting.appendleft(place)
                    else:
                        yield place, Lost(attempts[place])
                    workers[workers.index(worker)] = worker = _Worker(work)
                if waiting:
                    worker.give(waiting[0], units[waiting.popleft()])
    finally:
        for worker in workers:
            worker.end()


def _checked(result: Any) -> Any:  # noqa: ANN401
    """What a worker returned; what it could not do is raised here."""
    if isinstance(result, _Raised):
        if result.is_output:
            raise OutputError(result.words)
        raise RuntimeError(f"a worker could not do its work:\n{result.words}")  # noqa: TRY004
    return result


def _on_cluster(
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    scheduler: str,
    notice: Callable[[str], None],
    died: Callable[[Death], None],
) -> Iterator[tuple[int, Result | Lost]]:
    """Run units on a cluster; what goes wrong with its scheduler is said in a line."""
    distributed = _distributed()
    with _quiet():
        client = _client(scheduler)
        gone = (OSError, distributed.CancelledError, distributed.client.ClosedClientError)
        try:
            with client:
                yield from _given(client, work, units, scheduler, notice, died)
        except gone:
            raise _is_gone(scheduler) from None


def _client(scheduler: str) -> Any:  # noqa: ANN401 - Dask ships no types
    """Join a cluster.

    Raises
    ------
    LinkError
        Where nobody answers.
    """
    try:
        return _distributed().Client(scheduler, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise LinkError(
            f"no Dask scheduler answers at {scheduler} ({error}): start one with `dask scheduler`"
        ) from None


def _given(
    client: Any,  # noqa: ANN401 - Dask ships no types
    work: Callable[[Unit], Result],
    units: Sequence[Unit],
    scheduler: str,
    notice: Callable[[str], None],
    died: Callable[[Death], None],
) -> Iterator[tuple[int, Result | Lost]]:
    """Give a cluster as much as it has threads for, and more as results come; a future is released once it is read."""
    waiting = iter(range(len(units)))
    places: dict[Any, int] = {}
    done = _distributed().as_completed(loop=client.loop, raise_errors=False)
    known: set[str] = set()

    def ahead() -> int:
        nonlocal known
        threads: dict[str, int] = client.nthreads()
        for worker in sorted(known - set(threads)):
            died(Death(worker))
        known = set(threads)
        return AHEAD * max(sum(threads.values()), 1)

    def fill(room: int) -> None:
        for place in islice(waiting, max(room - len(places), 0)):
            future = client.submit(work, units[place], pure=False)
            places[future] = place
            done.add(future)

    room, counted = ahead(), monotonic()
    fill(room)  # before workers are asked after: there are clusters that start some when there is work
    if not client.nthreads():
        notice(f"{scheduler} has no workers: waiting for one (`dask worker {scheduler}` starts one)")
    for future in done:
        place = places.pop(future)
        yield place, _of_future(future, scheduler)
        future.release()
        if monotonic() - counted > RECOUNT_S:
            room, counted = ahead(), monotonic()
        fill(room)
    with contextlib.suppress(OSError):  # all is done: a scheduler that has gone by now is missed by nobody
        ahead()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep what Dask logs off the terminal: of a scheduler that is gone it writes pages, where a line tells it."""
    handlers = [handler for name in LOGGERS for handler in logging.getLogger(name).handlers]
    levels = [handler.level for handler in handlers]
    for handler in handlers:
        handler.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for handler, level in zip(handlers, levels, strict=True):
            handler.setLevel(level)


def _is_gone(scheduler: str) -> LinkError:
    """What is said of a scheduler that was there."""
    return LinkError(f"the Dask scheduler at {scheduler} is gone: start it again, and go on with --resume")


def _of_future(future: Any, scheduler: str) -> Any:  # noqa: ANN401
    """The result of a future.

    Raises
    ------
    LinkError
        Where the scheduler lost it.
    OutputError
        Where the disk of a worker is full.
    RuntimeError
        Where the work raised.
    """
    while future.status == "lost":  # its worker died with the result before it was read
        future.exception()  # waits until another one has done the work anew
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        if isinstance(error, _distributed().scheduler.KilledWorker):
            return Lost(ATTEMPTS)
        if isinstance(error, OutputError):
            raise OutputError(str(error))
        raise RuntimeError(f"a worker of {scheduler} could not do its work: {type(error).__name__}: {error}")
    raise _is_gone(scheduler)


def _distributed() -> Any:  # noqa: ANN401
    """Import Dask's distributed.

    Raises
    ------
    MissingExtra
        Where it is not installed.
    """
    try:
        import distributed
        import distributed.client
        import distributed.scheduler
    except ImportError:
        raise MissingExtra("distributed", "fleet", "--scheduler") from None
    return distributed
