"""Handling of the signals that end a program: Ctrl-C, kill, timeout, a closed terminal.

>>> with catch_stop_signals(patient=True) as is_asked:
...     is_asked()
False
"""

from __future__ import annotations

import _thread
import contextlib
import signal
import threading
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

STOP_SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals sent by Ctrl-C, by kill and timeout, and by a closed terminal."""


@contextlib.contextmanager
def handle_signals(handler: Callable[[int, FrameType | None], object], *names: str) -> Iterator[None]:
    """Handle signals by a function, in the main thread only; ignored or missing signals are left alone."""
    here = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in names if here and hasattr(signal, name)]
    awaited = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]  # nohup ignores SIGHUP
    before = {number: signal.signal(number, handler) for number in awaited}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, but not during an import, which would turn it into another error.

    An interrupt would become a `RuntimeError` in a class body before Python 3.12, and an `ImportError` while NumPy is
    loaded.
    """
    _handled.set()
    if not _is_importing(frame):
        signal.default_int_handler(number, None)
    threading.Thread(target=_send_again, args=[number], daemon=True).start()


_handled: Final = threading.Event()
"""Set when a signal has reached `interrupt`."""


def _send_again(number: int) -> None:
    """Repeat a signal until the main thread has handled it; one sent just before a wait for input can be lost."""
    time.sleep(0.01)
    _handled.clear()
    while not _handled.is_set():
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:
            _thread.interrupt_main(signal.Signals(number))
        _handled.wait(0.01)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a call was made during the import of a module."""
    while frame is not None and frame.f_globals.get("__name__") != "importlib._bootstrap":
        frame = frame.f_back
    return frame is not None


@contextlib.contextmanager
def catch_stop_signals(*, patient: bool) -> Iterator[Callable[[], bool]]:
    """Take a signal of `STOP_SIGNALS` as a request to stop; yields a function that returns whether one came."""
    asked = False

    def ask(number: int, _: object) -> None:
        nonlocal asked
        if asked and not patient:
            signal.default_int_handler(number, None)
        asked = True

    with handle_signals(ask, *STOP_SIGNALS):
        yield lambda: asked
