"""What `record` and `send` share: options of a wire, and what Ctrl-C means while something is under way."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

baud = click.option(
    "--baud",
    type=click.IntRange(50, 20_000_000),
    default=115200,
    show_default=True,
    metavar="N",
    help="Bits per second of a serial port.",
)


@contextlib.contextmanager
def stopping(*, patient: bool) -> Iterator[Callable[[], bool]]:
    """Take Ctrl-C, and what ends a program from outside, as a wish.

    Parameters
    ----------
    patient : bool
        However often it is pressed; otherwise the second time ends the program at once.

    Yields
    ------
    callable
        Tells whether it was asked for.
    """
    asked = False

    def ask(number: int, _: object) -> None:
        nonlocal asked
        if asked and not patient:
            signal.default_int_handler(number, None)
        asked = True

    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        names = []
    before = {name: signal.signal(getattr(signal, name), ask) for name in names}
    try:
        yield lambda: asked
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
