"""Waiting in tests: for a state and not for a time, so that tests pass on a busy machine.

>>> moments = iter([False, False, True])
>>> wait_until(lambda: next(moments))
"""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S: Final = 60.0
"""Time in s after which a state that was not reached counts as a fault, however busy the machine is."""
LOOK_S: Final = 0.005


def wait_until(is_so: Callable[[], object], why: Callable[[], object] = lambda: "") -> None:
    """Wait until a condition is true; after a minute the test fails, with the reason `why`."""
    end = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > end:
            pytest.fail(f"still not so after {PATIENCE_S:.0f} s: {why()}")
        time.sleep(LOOK_S)


def running_in(session: int) -> list[str]:
    """Processes of a session that have not ended, as lines from ``/proc``: number, name, state, parent …"""
    lines = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended since
            lines.append(path.read_text(encoding="utf-8"))
    cells = {line: line.rpartition(")")[2].split() for line in lines}
    return [line for line, (state, _, _, own, *_) in cells.items() if int(own) == session and state not in "ZX"]


class Heartbeat(threading.Thread):
    """Measures for how long this machine delays a thread that is to run every few milliseconds.

    Limits of wall-clock time are widened by `worst_s`; on a quiet machine that is a few milliseconds.

    >>> with Heartbeat() as heartbeat:
    ...     time.sleep(0.05)
    >>> 0.0 < heartbeat.worst_s < PATIENCE_S
    True
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.worst_s = 0.0
        self._is_over = threading.Event()

    def run(self) -> None:
        before = time.monotonic()
        while not self._is_over.wait(LOOK_S):
            now = time.monotonic()
            self.worst_s, before = max(self.worst_s, now - before), now

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self.join()
