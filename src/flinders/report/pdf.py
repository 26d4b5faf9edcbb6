"""A page of HTML as PDF, printed by a browser that is installed on this computer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from flinders.errors import OutputError

BROWSERS: Final = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge",
    "microsoft-edge-stable", "msedge", "brave-browser",
)  # fmt: skip
"""Programs that can print a page without a window."""

TIMEOUT_S: Final = 120.0
MANUAL_ADVICE: Final = "Open the HTML report in a browser and print it"


def browser() -> str:
    """Find a browser that can print without a window.

    Raises `OutputError` if there is none.
    """
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise OutputError(
            f"a PDF is printed by a browser, and none of {', '.join(BROWSERS[:3])}, chrome, microsoft-edge is on the "
            "PATH: install one, or open the HTML report in any browser and print it"
        )
    return program


def print_pdf(page: str, program: str) -> bytes:
    """A report as PDF, printed by a browser.

    Raises `OutputError` if the browser fails.
    """
    with tempfile.TemporaryDirectory(prefix="flinders-report-") as folder:
        source, target = Path(folder, "report.html"), Path(folder, "report.pdf")
        source.write_text(page, encoding="utf-8")
        command = [
            program, "--headless", "--disable-gpu", "--disable-extensions", "--no-first-run",
            "--no-default-browser-check", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", f"--user-data-dir={Path(folder, 'profile')}", "--no-pdf-header-footer",
            f"--print-to-pdf={target}", *_without_sandbox(), source.as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, check=False, stdin=subprocess.DEVNULL, capture_output=True, timeout=TIMEOUT_S
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{program} did not print the report: {error}. {MANUAL_ADVICE}") from None
        if not target.is_file():
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise OutputError(f"{program} did not print the report: {''.join(last) or 'no message'}. {MANUAL_ADVICE}")
        return target.read_bytes()


def _without_sandbox() -> list[str]:
    """Options for root, since these browsers start no sandbox for root; the page contains only our own code."""
    is_root = sys.platform != "win32" and os.geteuid() == 0
    return ["--no-sandbox"] if is_root else []
