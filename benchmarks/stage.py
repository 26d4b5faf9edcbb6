"""A real program, a real browser and a simulated board, for browser tests, benchmarks and screenshots.

`Program` is ``flinders live`` in its own process, `Site` a folder on a web server, `chromium` a headless browser
without network access, and `Board` the other end of a pseudo-terminal that prints lines like MotionCal's sketches.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any, Final, Self

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from playwright.sync_api import Browser

    from flinders.arrays import Floats

NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS: Final = (
    "--no-sandbox",  # which needs rights that a container does not give
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-compositing",  # by the processor too: through the emulated GPU it takes twice as long
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
"""Options for WebGL in software and no requests of the browser's own."""
STARTING_S: Final = 60.0
STOPPING_S: Final = 60.0
RETRY_S: Final = 0.002
"""Seconds until writing to a full port is tried again."""
COUNTS_PER_UT: Final = 10
"""Counts per µT in a ``Raw:`` line."""


def chromium_path() -> str | None:
    """Path of Chromium or Chrome; None without either."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """Run a headless browser.

    Raises
    ------
    FileNotFoundError
        If no browser is installed.
    """
    from playwright.sync_api import sync_playwright

    path = chromium_path()
    if path is None:
        raise FileNotFoundError(f"there is no browser: install one of {', '.join(NAMES)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


class Program:
    """``flinders live`` with a page at `address`, which records into `recording`; or another command with a page.

    Parameters
    ----------
    folder : Path
        Working directory.
    options : str
        Options of the command line.
    command : str
        Command in place of ``live``.

    Attributes
    ----------
    address : str
    recording : Path
    pid : int

    Raises
    ------
    RuntimeError
        If it ends before it has a page; with its output.
    """

    def __init__(self, folder: Path, *options: str, command: str = "live") -> None:
        self.recording = folder / "session.csv"
        chosen = ["--output", self.recording.name] if command == "live" and "--resume" not in options else []
        words = [sys.executable, "-m", "flinders", command, "--no-open", "--port", "0", *chosen, *options]
        self._process = subprocess.Popen(
            words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, encoding="utf-8"
        )
        self.pid = self._process.pid
        self._said: list[str] = []
        self._has_address = threading.Event()
        self.address = ""
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()
        if not self._has_address.wait(STARTING_S) or not self.address:
            self.stop()
            raise RuntimeError(f"flinders {command} gave no address:\n{self.said}")

    @property
    def said(self) -> str:
        """Output of the program so far."""
        return "".join(self._said)

    def kill(self) -> None:
        """Kill the program, like a power failure."""
        self._process.kill()
        self.stop()

    def stop(self) -> int:
        """Interrupt the program like Ctrl-C, and return its exit status."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        status = self._process.wait(STOPPING_S)
        self._reader.join(STOPPING_S)
        if self._process.stdout is not None:
            self._process.stdout.close()
        return status

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._said.append(line)
            found = re.search(r"http:/{2}\S+", line)
            if found and not self.address:
                self.address = found[0]
                self._has_address.set()
        self._has_address.set()


class Site:
    """A folder on a web server, under a path at `address`.

    Parameters
    ----------
    folder : Path
    path : str
        Path of the site; begins and ends with a slash.
    """

    def __init__(self, folder: Path, path: str = "/tools/compass/") -> None:
        handler = functools.partial(_Files, path, directory=str(folder))
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        self.address = f"http:{'/' * 2}127.0.0.1:{self._server.server_port}{path}"

    def stop(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class _Files(SimpleHTTPRequestHandler):
    """Request handler for files under a path, without a log."""

    def __init__(self, path: str, *given: Any, **options: Any) -> None:
        self._path = path
        super().__init__(*given, **options)

    def translate_path(self, path: str) -> str:
        inside = path.removeprefix(self._path)
        return super().translate_path(f"/{inside}" if inside != path else "/elsewhere")

    def log_message(self, *_: object) -> None:
        """Log nothing."""


class Board:
    """A simulated board on a pseudo-terminal, under a name that stays the same after plugging in again.

    Parameters
    ----------
    port : Path
        Name of the port.

    Attributes
    ----------
    heard : bytes
        Bytes sent to it.
    """

    def __init__(self, port: Path) -> None:
        self.port = port
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._sender: threading.Thread | None = None
        self._ends: tuple[int, int] | None = None
        self.plug()

    def plug(self) -> None:
        """Connect the board."""
        import tty

        with self._lock:
            self._ends = os.openpty()
            tty.setraw(self._ends[1])
            os.set_blocking(self._ends[0], False)
            self.port.symlink_to(os.ttyname(self._ends[1]))

    def unplug(self) -> None:
        """Disconnect the board, which continues to measure."""
        with self._lock:
            self.port.unlink(missing_ok=True)
            for end in self._ends or ():
                os.close(end)
            self._ends = None

    def send(self, content: bytes) -> None:
        """Print bytes, waiting for buffer space; bytes printed while unplugged are lost."""
        while content:
            with self._lock, contextlib.suppress(BlockingIOError):
                if self._ends is None:
                    return
                content = content[os.write(self._ends[0], content) :]
            if content and self._stopped.wait(RETRY_S):
                return

    def play(self, lines: Sequence[bytes], rate_hz: float) -> None:
        """Print lines at a rate repeatedly, until the next call or `stop`."""
        self.stop()
        self._stopped.clear()
        self._sender = threading.Thread(target=self._play, args=(list(lines), rate_hz), daemon=True)
        self._sender.start()

    def stop(self) -> None:
        """Stop printing."""
        self._stopped.set()
        if self._sender is not None:
            self._sender.join()
        self._sender = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.unplug()

    def _play(self, lines: list[bytes], rate_hz: float) -> None:
        begun, count = time.monotonic(), 0
        while not self._stopped.wait(max(begun + count / rate_hz - time.monotonic(), 0.0)):
            due = max(int((time.monotonic() - begun) * rate_hz) - count, 1)
            self.send(b"".join(lines[number % len(lines)] for number in range(count, count + due)))
            count += due


def motioncal(field: Floats) -> list[bytes]:
    r"""Write (N, 3) µT as lines of MotionCal's sketches, to the 0.1 µT of their counts.

    >>> import numpy as np
    >>> motioncal(np.array([[21.7, 0.4, -58.6]]))
    [b'Raw:0,0,8192,0,0,0,217,4,-586\r\n']
    """
    counts = (COUNTS_PER_UT * field).round().astype(int)
    return [b"Raw:0,0,8192,0,0,0,%d,%d,%d\r\n" % tuple(row) for row in counts.tolist()]
