"""``flinders report``: a calibration and a recording as one HTML file, or as PDF."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options, _reports
from flinders.cli._calibration import load, made_from, sensor_option
from flinders.cli._talk import print_json, progress, say
from flinders.cli.check import opened
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.samples import Joined
    from flinders.fitting.judged import Judged
    from flinders.fitting.result import Fit

OTHER = (
    "The recording shown is not one that the calibration was made from: what is claimed is that of its file, what is "
    "drawn is this recording."
)


def of_a_pair(function: _options.Function) -> _options.Function:
    """The options of a command that draws a calibration and a recording."""
    options = (_options.shown, _options.columns, sensor_option, _options.log, _options.force, _options.as_json)
    for option in reversed(options):
        function = option(function)
    return function


@click.command(
    "report",
    short_help="Write a report of a calibration and a recording.",
    epilog="""\b
Example:
  flinders report calibration.json tumble.csv
  flinders report calibration.json tumble.csv -o monday.html --pdf monday.pdf
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@click.option(
    "-o", "--output", metavar="FILE", help="HTML file to write, - for standard output [default: report.html]."
)
@click.option("--pdf", metavar="FILE", help="Also print it to PDF, by a browser that is installed.")
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
    from flinders.core.calibration_file import Provenance, read
    from flinders.core.files import write_bytes, write_text
    from flinders.report.html import page

    path = output or (None if pdf else "report.html")
    if path == "-" and as_json:
        raise UsageError("--json and the report would both go to standard output: name a file with -o")
    program = _check_outputs(path, pdf, (calibration, *recordings), force=force)
    judged, recording, fit, notes = pictured("report", calibration, recordings, target_deg, dip_deg, reading)
    provenance: Provenance | None = read(calibration).provenance
    asked = {"target_deg": target_deg, "dip_deg": dip_deg, **reading}
    text = page(
        fit,
        recording,
        provenance=provenance,
        asked={"Calibration file": calibration, **_reports.told(asked)},
        listings=_reports.listings(judged),
        notes=notes,
    )
    if path == "-":
        click.echo(text, nl=False)
    elif path:
        write_text(text, path, force=force)
        say(f"report written to {path}")
    if pdf and program:
        write_bytes(_reports.printed(text, program), pdf, force=force)
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
) -> tuple[Judged, Joined, Fit, list[str]]:
    """Open a calibration and recordings, and put them together; and what is odd about the pair.

    Raises
    ------
    UsageError
        For files given the other way round, or twice.
    DocumentError, InputError, UnitError
        For what cannot be read, or does not belong together.
    """
    from flinders.core.compensation import settled
    from flinders.report.from_file import doubts, restored

    judged = load(name, calibration, recordings)
    with progress("reading") as watch:
        as_recorded = opened(calibration, judged.calibration, recordings, progress=watch, **reading)
        recording = settled(as_recorded, judged.calibration)
        fit = restored(judged, recording, target_deg=target_deg, dip_deg=dip_deg)
        own = made_from(calibration, as_recorded.recordings)
        plain = replace(judged, calibration=judged.calibration.at())
        notes = [] if len(own) == len(as_recorded.recordings) else doubts(plain, recording)
    if judged.files and len(own) < len(as_recorded.recordings):
        notes.append(OTHER)
    for note in notes:
        say(f"! {note}")
    return judged, as_recorded, fit, notes


def _check_outputs(path: str | None, pdf: str | None, inputs: tuple[str, ...], *, force: bool) -> str | None:
    """Find what could not be written before anything is read; and the browser, where one is needed.

    Raises
    ------
    UsageError, OutputError
    """
    from pathlib import Path

    from flinders.core.files import refuse_existing

    if pdf == "-":
        raise UsageError("--pdf goes into a file: name one, such as report.pdf")
    if path == "-" and sys.stdout.isatty():
        raise UsageError("a report is a megabyte of HTML, and not for a terminal: name a file with -o")
    _reports.refuse_pdf(path, "-o")
    if path and pdf and path != "-" and Path(path).resolve() == Path(pdf).resolve():
        raise UsageError(f"{path} is named for the report and for its PDF: give them two names")
    for each in (path, pdf):
        if each and each != "-":
            _options.refuse_to_overwrite(each, inputs)
            refuse_existing(each, force=force)
    return _reports.browser() if pdf else None
