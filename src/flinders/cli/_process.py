"""The process of the program: its garbage collector, and standard output and error that may be closed."""

from __future__ import annotations

import atexit
import contextlib
import gc
import io
import os
import sys


def let_imports_be() -> None:
    """Keep the garbage collector from what imports made: looking through it was a sixth of a short command."""
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)


def prepare_streams() -> None:
    """Print "?" for a letter that a terminal does not have, such as σ, and no talk where stderr is closed.

    Results that go to a closed stdout are lost, and writing them fails: at a descriptor that is open for reading alone.
    """
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_RDONLY), "w")
    sys.stderr = sys.stderr or io.TextIOWrapper(io.BytesIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def silence_stdout() -> None:
    """What could not be written will not be tried again at exit: let the interpreter flush into nothing."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
