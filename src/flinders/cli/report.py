"""``flinders report``: write a calibration and a recording as one HTML or PDF file; also reports of new fits."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, open_all_with, report_readings
from flinders.cli._output import print_json, progress, refuse_report, say
from flinders.cli._spelling import in_options
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.core.samples import Recording
    from flinders.errors import FitError
    from flinders.fitting.result import Fit
    from flinders.report.html import Listing
    from flinders.workflows.onboard import OnboardCheck
    from flinders.workflows.restoring import RestoredFit


class Report(program.Group):
    """A calibration, the recordings for its figures, and the output files."""

    calibration: str = program.argument("CALIBRATION")
    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1)
    columns: str | None = program.same_as(option.ColumnsOptions, "columns")
    sensor: str | None = option.sensor_of_calibration()
    part: option.PartOptions = program.group(option.PartOptions)
    dip_deg: float | None = option.dip("Inclination of the field at the site [default: the calibration's].")
    target_deg: float | None = option.target("Acceptable worst heading error [default: the calibration's].", None)
    output: str | None = option.output(
        "the report", "HTML file to write, - for standard output [default: report.html]."
    )
    pdf: str | None = program.member(
        "--pdf",
        what="its PDF",
        metavar="[FILE]",
        is_flag=False,
        flag_value="report.pdf",
        help="Also print the report to PDF, with an installed browser [FILE: report.pdf].",
    )
    force: bool = option.force()
    as_json: bool = option.as_json()

    @property
    def path(self) -> str | None:
        """File of the HTML; None if only a PDF is written."""
        return self.output or (None if self.pdf else "report.html")

    def check(self) -> None:
        """Refuse outputs that cannot be written, before anything is read."""
        if self.pdf == "-":
            raise UsageError("--pdf needs a file: name it, such as report.pdf")
        if self.path == "-" and sys.stdout.isatty():
            raise UsageError("a report is a megabyte of HTML, too long for a terminal: name a file with -o")
        if self.path != "-":
            refuse_report(self.path, "-o")
        self.checked_outputs()

    def restore_fit(self) -> RestoredFit:
        """Load the calibration with its recordings, and print notes on both."""
        from flinders.core.joining import Joined
        from flinders.workflows.restoring import restore

        path = self.calibration
        loaded = load("report", path, self.recordings)
        reading = {"columns": self.columns, **self.part.as_dict()}
        with progress("reading") as watch:
            parts = open_all_with(path, loaded, self.recordings, sensor=self.sensor, progress=watch, **reading)
            with report_readings(parts):
                found = restore(Joined(tuple(parts)), loaded, target_deg=self.target_deg, dip_deg=self.dip_deg)
        for note in found.notes:
            say(f"! {note.words(in_options)}")
        return found


@program.command_of(
    "report",
    Report,
    common=("output", "pdf", "columns", "sensor"),
    epilog="""\b
Example:
  flinders report calibration.json tumble.csv
  flinders report calibration.json tumble.csv -o monday.html --pdf monday.pdf
""",
)
def command(options: Report) -> None:
    """Write a report on CALIBRATION and RECORDING as one self-contained HTML file: words, numbers and figures.

    Stated errors are those of the calibration file; nothing is fitted anew. RECORDING is the recording of the
    calibration or another one of the same sensor: a file, or - for standard input. With --pdf only, no HTML is written.
    """
    from flinders.core.calibration_file import read
    from flinders.report.html import listings_of, page
    from flinders.report.pdf import browser, print_pdf
    from flinders.workflows.onboard import judge_onboard

    options.check()
    path, pdf, outputs = options.path, options.pdf, options.outputs
    program = browser() if pdf else ""
    found = options.restore_fit()
    notes = [note.words(in_options) for note in found.notes]
    text = page(
        found.fit,
        found.recording,
        provenance=read(options.calibration).provenance,
        asked={"Calibration file": options.calibration, **options.typed_words()},
        listings=listings_of(found.known),
        notes=notes,
        onboard=judge_onboard(found.recording, found.fit),
    )
    outputs.write(text, path)
    if path and path != "-":
        say(f"report written to {path}")
    if pdf:
        outputs.write(print_pdf(text, program), pdf)
        say(f"report printed to {pdf}")
    if options.as_json:
        print_json({"report": path, "pdf": pdf, "verdict": found.fit.verdict, "notes": notes})


def report_of(
    outcome: Fit | FitError,
    recording: Recording,
    provenance: ProvenanceRecord,
    asked: dict[str, str],
    onboard: OnboardCheck | None = None,
) -> str:
    """The report of a fit or of a refusal, with its provenance and the typed options."""
    from flinders.fitting.result import Fit
    from flinders.report.html import listings_of, page

    listed: list[Listing] = []
    if isinstance(outcome, Fit):
        name = ", ".join(file.name for file in provenance.files)
        listed = listings_of(replace(outcome, provenance=replace(outcome.provenance, name=name, record=provenance)))
    return page(outcome, recording, provenance=provenance, asked=asked, listings=listed, onboard=onboard)
