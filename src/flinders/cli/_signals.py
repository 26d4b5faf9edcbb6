"""Signals that end a program from outside: Ctrl-C, kill, timeout, a closed terminal.

>>> with stopping(patient=True) as is_asked:
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

ENDING: Final = ("SIGINT", "SIGTERM", "SIGHUP")
"""Ctrl-C, and what else ends a program from outside: kill, timeout, a closed terminal."""


@contextlib.contextmanager
def handled(handler: Callable[[int, FrameType | None], object], *names: str) -> Iterator[None]:
    """Have signals handled by a function, those that this system has and does not ignore; only in the main thread."""
    here = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in names if here and hasattr(signal, name)]
    awaited = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]  # nohup ignores one
    before = {number: signal.signal(number, handler) for number in awaited}
    try:
        yield
    finally:
        for number, handler_before in before.items():
            signal.signal(number, handler_before)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, as soon as no module is imported, which would make another fault of it.

    Python before 3.12 raises a `RuntimeError` while a class is made, NumPy an `ImportError` while it is loaded.
    """
    _handled.set()
    if not _is_importing(frame):
        signal.default_int_handler(number, None)
    threading.Thread(target=_send_again, args=[number], daemon=True).start()


_handled: Final = threading.Event()
"""Set once a signal has reached `interrupt`."""


def _send_again(number: int) -> None:
    """Send a signal to the main thread until it is handled: one just before that thread waits for input is not seen."""
    time.sleep(0.01)
    _handled.clear()
    while not _handled.is_set():
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:
            _thread.interrupt_main(signal.Signals(number))
        _handled.wait(0.01)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a call is one of those that import a module."""
    while frame is not None and frame.f_globals.get("__name__") != "importlib._bootstrap":
        frame = frame.f_back
    return frame is not None


@contextlib.contextmanager
def stopping(*, patient: bool) -> Iterator[Callable[[], bool]]:
    """Take Ctrl-C, and what ends a program from outside, as a wish."""
    asked = False

    def ask(number: int, _: object) -> None:
        nonlocal asked
        if asked and not patient:
            signal.default_int_handler(number, None)
        asked = True

    with handled(ask, *ENDING):
        yield lambda: asked
