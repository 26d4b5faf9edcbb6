"""What ``flinders report``, ``flinders plot`` and ``flinders calibrate`` share: reports, their listings, and PDF."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli._talk import drawn
from flinders.errors import FlindersError, OutputError, UsageError

if TYPE_CHECKING:
    from flinders.core.calibration_file import Provenance
    from flinders.core.samples import Recording
    from flinders.errors import FitError
    from flinders.fitting.judged import Judged
    from flinders.fitting.result import Fit
    from flinders.report.html import Listing

FIRST: Final = ("c",)
"""Targets that stand first among the listings of a report, open."""

BROWSERS: Final = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge",
    "microsoft-edge-stable", "msedge", "brave-browser",
)  # fmt: skip
"""Programs that print a page without a window."""

PATIENCE_S: Final = 120.0
BY_HAND: Final = "Open the HTML report in a browser and print it"

AT_ITS_DEFAULT: Final[dict[str, object]] = {
    "method": "auto",
    "target_deg": 1.0,
    "dip_deg": 60.0,
    "axes": "x,y,z",
    "as_logged": False,
}
"""Options that a report does not tell of where they are so."""

OPTIONS: Final = {"target_deg": "--target", "dip_deg": "--dip", "start": "--from", "end": "--to"}
"""What options are called, where it is not their name."""


def write(
    outcome: Fit | FitError,
    recording: Recording,
    provenance: Provenance,
    path: str,
    *,
    asked: dict[str, Any],
    force: bool,
) -> None:
    """Write the report of a fit, or of a refusal.

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    from flinders.core.files import write_text
    from flinders.fitting.judged import Judged
    from flinders.fitting.result import Fit
    from flinders.report.html import page

    listed: list[Listing] = []
    if isinstance(outcome, Fit):
        name = ", ".join(file.name for file in provenance.files)
        judged = replace(Judged.from_fit(outcome, name=name), files=tuple(provenance.files))
        listed = listings(judged)
    text = page(outcome, recording, provenance=provenance, asked=told(asked), listings=listed)
    write_text(text, path, force=force)


def told(asked: dict[str, Any]) -> dict[str, str]:
    """Options as they would be typed, those at their defaults left out.

    >>> told({"target_deg": 0.5, "dip_deg": 60.0, "unit": "mG", "columns": None, "robust": True})
    {'--target': '0.5', '--unit': 'mG', '--robust': 'yes'}
    """
    given = {name: value for name, value in asked.items() if value not in (None, False, (), AT_ITS_DEFAULT.get(name))}
    return {
        OPTIONS.get(name, f"--{name.removesuffix('_deg').replace('_', '-')}"): "yes" if value is True else f"{value}"
        for name, value in given.items()
    }


def listings(judged: Judged) -> list[Listing]:
    """The calibration for each target that can hold it and whose file is text, code first."""
    from flinders.cli.export import about, rendered
    from flinders.report.html import Listing
    from flinders.targets import registry

    if judged.record is not None and judged.record.verdict == "refused":
        return []
    found = []
    for name in sorted(registry(), key=lambda name: name not in FIRST):
        row = registry()[name]
        try:
            export, _ = rendered(judged, row)
        except FlindersError:
            continue
        if export.data is None:
            notes = () if export.has_comments else tuple(about(judged))
            found.append(Listing(row.use, f"{name}{row.suffix}", export.text, (*notes, *export.warnings)))
    return found


def plot(fit: Fit, recording: Recording, *, err: bool = False) -> None:
    """Draw a fit in a few lines, where it is printed on a terminal that can."""
    stream = sys.stderr if err else sys.stdout
    if not stream.isatty() or os.environ.get("TERM") == "dumb":
        return
    from flinders.report.figure_data import FigureData
    from flinders.report.terminal import DRAWN, plot

    is_plain = not can_show(stream.encoding or "ascii", DRAWN)
    width = shutil.get_terminal_size().columns
    click.echo("", err=err)
    click.echo(drawn(plot(FigureData.of(fit, recording), fit, is_plain=is_plain, width=width), stream), err=err)


def can_show(encoding: str, text: str) -> bool:
    """Whether a stream of this encoding has these letters.

    >>> can_show("utf-8", "⣿█"), can_show("latin-1", "⣿█"), can_show("no such", "a")
    (True, False, False)
    """
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def refuse(path: str | None, option: str) -> None:
    """Refuse a name that is not one of an HTML file.

    Raises
    ------
    UsageError
        For PDF, and for standard output where that belongs to other results.
    """
    if path == "-":
        raise UsageError(f"{option} -: a report is a megabyte of HTML, name a file such as report.html")
    refuse_pdf(path, option)


def refuse_pdf(path: str | None, option: str) -> None:
    """Refuse what is asked to be a PDF where a page is written.

    Raises
    ------
    UsageError
    """
    if path is not None and Path(path).suffix.lower() == ".pdf":
        raise UsageError(
            f"{option} {path}: a report is HTML; for PDF use flinders report CALIBRATION RECORDING --pdf {path}"
        )


def browser() -> str:
    """Find a browser that prints without a window.

    Raises
    ------
    OutputError
        Where there is none.
    """
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise OutputError(
            f"a PDF is printed by a browser, and none of {', '.join(BROWSERS[:3])}, chrome, microsoft-edge is on the "
            "PATH: install one, or open the HTML report in any browser and print it"
        )
    return found


def printed(page: str, program: str) -> bytes:
    """The pages that a browser prints of a report, as PDF.

    Raises
    ------
    OutputError
        Where the browser does not get it done.
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
                command, check=False, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE_S
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{program} did not print the report: {error}. {BY_HAND}") from None
        if not target.is_file():
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise OutputError(f"{program} did not print the report: {''.join(last) or 'it said nothing'}. {BY_HAND}")
        return target.read_bytes()


def _without_sandbox() -> list[str]:
    """Root has no sandbox in these browsers, and they refuse to start with one; the page is ours, and runs nothing."""
    is_root = sys.platform != "win32" and os.geteuid() == 0
    return ["--no-sandbox"] if is_root else []
