"""``flinders report``: a calibration and a recording as one HTML file, or as PDF; and the report of a new fit."""

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

from flinders.cli import _options
from flinders.cli._inputs import load, made_from, opened_with
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, drawn, print_json, progress, refuse_report, say
from flinders.errors import OutputError, UsageError

if TYPE_CHECKING:
    from flinders.core.calibration_file import Provenance
    from flinders.core.samples import Joined, Recording
    from flinders.errors import FitError
    from flinders.fitting.result import Fit
    from flinders.report.html import Listing

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

OTHER = (
    "The recording shown is not one that the calibration was made from: what is claimed is that of its file, what is "
    "drawn is this recording."
)


def of_a_pair(function: _options.Function) -> _options.Function:
    """Add the options of a command that draws a calibration and a recording."""
    for each in (
        _options.old_as_json,
        _options.old_force,
        _options.old_target("Worst heading error that is good enough [default: the calibration's].", None),
        _options.old_dip("Inclination of the field at the site [default: the calibration's]."),
        _options.old_some(_options.PartOptions, "topic", "start", "end", "as_logged"),
        _options.old_sensor_of_calibration,
        _options.old_some(_options.ColumnsOptions, "columns"),
    ):
        function = each(function)
    return function


@_options.old_command(
    "report",
    common=("output", "pdf", "columns", "sensor"),
    short_help="Write a report of a calibration and a recording.",
    epilog="""\b
Example:
  flinders report calibration.json tumble.csv
  flinders report calibration.json tumble.csv -o monday.html --pdf monday.pdf
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@option("-o", "--output", metavar="FILE", help="HTML file to write, - for standard output [default: report.html].")
@option("--pdf", metavar="FILE", help="Also print it to PDF, by a browser that is installed.")
@of_a_pair
def command(
    calibration: str,
    recordings: tuple[str, ...],
    output: str | None,
    pdf: str | None,
    target_deg: float | None,
    dip_deg: float | None,
    force: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Write what CALIBRATION does to RECORDING as one HTML file that needs nothing else: words, numbers and figures.

    What is claimed is what the calibration file says; nothing is fitted anew. RECORDING is the one that it was made
    from, or another of the same sensor: a file, or - for standard input. With --pdf alone no HTML is written.
    """
    from flinders.core.calibration_file import read
    from flinders.core.files import write_bytes
    from flinders.report.html import listings_of, page

    path = output or (None if pdf else "report.html")
    outputs = Outputs.of(("the report", path), ("its PDF", pdf, "--pdf"), force=force, as_json=as_json)
    program = _check(outputs, path, pdf, (calibration, *recordings))
    loaded, recording, fit, notes = pictured("report", calibration, recordings, target_deg, dip_deg, reading)
    provenance: Provenance | None = read(calibration).provenance
    asked = {"target_deg": target_deg, "dip_deg": dip_deg, **reading}
    text = page(
        fit,
        recording,
        provenance=provenance,
        asked={"Calibration file": calibration, **as_typed(asked)},
        listings=listings_of(loaded),
        notes=notes,
    )
    outputs.write(text, path)
    if path and path != "-":
        say(f"report written to {path}")
    if pdf and program:
        write_bytes(printed(text, program), pdf, force=force)
        say(f"report printed to {pdf}")
    if as_json:
        print_json({"report": path, "pdf": pdf, "verdict": fit.verdict, "notes": notes})


def pictured(
    name: str,
    calibration: str,
    recordings: tuple[str, ...],
    target_deg: float | None,
    dip_deg: float | None,
    reading: dict[str, Any],
) -> tuple[Fit, Joined, Fit, list[str]]:
    """Open a calibration and recordings, and put them together; and what is odd about the pair.

    Raises
    ------
    UsageError
        For files given the other way round, or twice.
    DocumentError, InputError, UnitError
        For what cannot be read, or does not belong together.
    """
    from flinders.core.compensation import compensated
    from flinders.report.figure_data import doubts, restored

    loaded = load(name, calibration, recordings)
    with progress("reading") as watch:
        as_recorded = opened_with(calibration, loaded.calibration, recordings, progress=watch, **reading)
        recording = compensated(as_recorded, loaded.calibration)
        fit = restored(loaded, recording, target_deg=target_deg, dip_deg=dip_deg)
        own = made_from(calibration, as_recorded.recordings)
        notes = [] if len(own) == len(as_recorded.recordings) else doubts(loaded.calibration.at(), recording)
    if loaded.files and len(own) < len(as_recorded.recordings):
        notes.append(OTHER)
    for note in notes:
        say(f"! {note}")
    return loaded, as_recorded, fit, notes


def _check(outputs: Outputs, path: str | None, pdf: str | None, inputs: tuple[str, ...]) -> str | None:
    """Find what could not be written before anything is read; and the browser, where one is needed.

    Raises
    ------
    UsageError, OutputError
    """
    if pdf == "-":
        raise UsageError("--pdf goes into a file: name one, such as report.pdf")
    if path == "-" and sys.stdout.isatty():
        raise UsageError("a report is a megabyte of HTML, and not for a terminal: name a file with -o")
    if path != "-":
        refuse_report(path, "-o")
    outputs.check(inputs)
    return browser() if pdf else None


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
    from flinders.fitting.result import Fit
    from flinders.report.html import listings_of, page

    listed: list[Listing] = []
    if isinstance(outcome, Fit):
        name = ", ".join(file.name for file in provenance.files)
        listed = listings_of(replace(outcome, name=name, provenance=provenance))
    text = page(outcome, recording, provenance=provenance, asked=as_typed(asked), listings=listed)
    write_text(text, path, force=force)


def as_typed(asked: dict[str, Any]) -> dict[str, str]:
    """Options as they would be typed, those at their defaults left out.

    >>> as_typed({"target_deg": 0.5, "dip_deg": 60.0, "unit": "mG", "columns": None, "robust": True})
    {'--target': '0.5', '--unit': 'mG', '--robust': 'yes'}
    """
    given = {name: value for name, value in asked.items() if value not in (None, False, (), AT_ITS_DEFAULT.get(name))}
    return {
        OPTIONS.get(name, f"--{name.removesuffix('_deg').replace('_', '-')}"): "yes" if value is True else f"{value}"
        for name, value in given.items()
    }


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


def browser() -> str:
    """Find a browser that prints without a window.

    Raises
    ------
    OutputError
        Where there is none.
    """
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise OutputError(
            f"a PDF is printed by a browser, and none of {', '.join(BROWSERS[:3])}, chrome, microsoft-edge is on the "
            "PATH: install one, or open the HTML report in any browser and print it"
        )
    return program


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
