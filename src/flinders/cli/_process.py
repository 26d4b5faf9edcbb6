"""Settings of the program's process: garbage collection, and standard streams that may be closed."""

from __future__ import annotations

import atexit
import contextlib
import gc
import io
import os
import sys


def spare_imports_from_gc() -> None:
    """Keep the garbage collector from scanning imported modules, which took a sixth of a short command's time."""
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)


def prepare_streams() -> None:
    """Print "?" for characters that cannot be encoded, such as σ, and ignore a closed stderr.

    A closed stdout is replaced by a read-only descriptor, so that writing a result fails.
    """
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_RDONLY), "w")
    sys.stderr = sys.stderr or io.TextIOWrapper(io.BytesIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def silence_stdout() -> None:
    """Replace stdout by the null device, so that the interpreter's flush at exit does not fail."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
