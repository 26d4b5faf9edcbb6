"""``flinders two-axis``: the recipe for two axes, from a turn in any plane; plane after plane gives three axes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, provenance, refuse_calibration, report_readings
from flinders.cli._output import progress, say
from flinders.cli._program import LIMITED
from flinders.cli._spelling import in_options, taken_options
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.apps.classic.two_axis_turn import TurnReadings, TwoAxisFit
    from flinders.core.samples import Recording
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Turn

PLANES: Final = ("xy", "yz", "zx")
"""Names as in `flinders.geometry.plane`, repeated here so that help needs no NumPy; a test compares both."""

DRAWING: Final = ".svg"


class TwoAxis(program.Group):
    """Options: the recording of a turn, its fit, outputs."""

    recording: str = program.argument("RECORDING")
    plane: Any = program.member(
        "--plane", type=click.Choice(PLANES), default="xy", show_default=True,
        help="The two axes in the plane of the turn: xy for a turn about z.",
    )  # fmt: skip
    method: str = program.member(
        "--method", type=click.Choice(("two-axis", "ellipse")), default="two-axis", show_default=True,
        help="two-axis: mean and scatter, for equally spaced points; ellipse: least squares, for any spacing.",
    )  # fmt: skip
    after: str | None = program.member(
        "--after", metavar="CALIBRATION",
        help="Calibration that was loaded while RECORDING was made; the result is composed with that calibration.",
    )  # fmt: skip
    reading: option.ReadingByChip = program.group(option.ReadingByChip)
    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output.", heading=program.OUTPUT
    )
    polar: str | None = program.member(
        "--polar",
        what="the drawing",
        heading=program.OUTPUT,
        metavar="FILE",
        help="Also draw the points before and after, as SVG.",
    )
    force: bool = option.force()
    as_json: bool = option.as_json()
    sensor: str | None = option.sensor(
        "Name or serial number to store; for a log, the magnetometer to use, by number or name.", "NAME"
    )
    field_strength: float | None = option.field_strength()
    judgement: option.Judgement = program.group(option.Judgement)

    def check(self) -> None:
        """Refuse inputs and outputs that cannot be used before anything is read."""
        if self.polar and self.polar != "-" and Path(self.polar).suffix.lower() != DRAWING:
            raise UsageError(
                f"--polar {self.polar}: need a name that ends in {DRAWING} (a drawing), or - for standard output"
            )
        self.checked_outputs(self.after)
        refuse_calibration(self.recording, "give the recording of a turn, and the calibration to --after")
        if self.after == "-":
            raise UsageError("--after needs a file, as standard input is for the recording")

    def refuse_after(self) -> None:
        """Refuse options that the loaded calibration has already determined."""
        if self.after is None:
            return
        if self.reading.axes != "x,y,z":
            what_to_do = "give --axes x,y,z with --chip" if "axes" in taken_options() else "leave --axes out"
            raise UsageError(
                f"readings with {self.after} loaded are already in the axes of that calibration: {what_to_do}"
            )
        if self.field_strength is not None:
            raise UsageError(f"{self.after} already sets the length of corrected readings: leave --field-strength out")


@program.command_of(
    "two-axis",
    TwoAxis,
    common=("output", "plane", "method", "after", "polar"),
    epilog="""\b
Example:
  flinders two-axis turn.csv -o calibration.json --polar rose.svg
  flinders two-axis arc.csv --method ellipse

\b
Three axes, one plane at a time, each loaded before the next is recorded:
  flinders two-axis yz.csv --plane yz -o first.json
  flinders two-axis zx.csv --plane zx --after first.json -o second.json
  flinders two-axis xy.csv --after second.json -o third.json
""",
)
def command(options: TwoAxis) -> int:
    """Find hard and soft iron of two axes from a turn about the third one, which points up or down.

    The mean of points equally spaced in heading is the offset; the eigenvalues and eigenvectors of their scatter are
    the soft iron. If the points are not equally spaced, a notice gives the heading error of the mean in degrees, and
    the ellipse of least squares is fitted instead (--method ellipse), unless --method two-axis is typed. The result
    holds for this plane alone: exit code 3, as for all limited results.
    """
    from flinders.core.calibration_file import dumps
    from flinders.errors import FitError
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Refused, document_of

    options.check()
    first = None if options.after is None else load("two-axis --after", options.after)
    options.refuse_after()
    with progress("reading") as watch:
        source = CountedRecording(_open(options, first, watch))
        readings = _read(source, first, options)
        try:
            found = readings.fit(
                target_deg=options.judgement.target_deg,
                dip_deg=options.judgement.dip_deg if program.is_typed("dip_deg") else None,
                field_strength=options.field_strength,
                sensor=options.sensor,
            )
        except FitError as error:
            _say_spacing(readings.turn, options)
            if isinstance(error, Refused):
                _draw(readings.turn, error.fit, options)
            raise
    for note in found.notes:
        say(note.words(in_options))
    if options.output:
        made_from = provenance([source], first.provenance.files if first else ())
        options.outputs.write(dumps(document_of(found.composed or found.fit, made_from)), options.output)
    _draw(found.turn, found.fit, options)
    _show(found, options)
    return LIMITED


def _open(options: TwoAxis, first: Fit | None, watch: Any) -> Recording:  # noqa: ANN401 - progress
    """Open the recording, in the unit of the loaded calibration unless a unit was typed."""
    from flinders.readers import holds_log, open_recording
    from flinders.workflows.recordings import require_same_frame

    reading = options.reading
    chosen = options.sensor if holds_log(options.recording) else None
    source = open_recording(options.recording, flat=options.plane, sensor=chosen, progress=watch, **reading.as_dict())
    if first is not None and reading.unit is None and reading.scale is None:
        require_same_frame(first.calibration, source)
    return source


def _read(source: CountedRecording, first: Fit | None, options: TwoAxis) -> TurnReadings:
    """Read the turn, with notices about its contents and about a turn in another plane."""
    from flinders.apps.classic.two_axis_turn import read_turn

    method: Any = options.method if program.is_typed("method") else None
    with report_readings([source]):
        readings = read_turn(source, first, plane=options.plane, method=method)
        for note in readings.notes:
            say(f"! {note.words(in_options)}")
        _ = readings.turn  # refuses readings that are no turn
    return readings


def _say_spacing(turn: Turn, options: TwoAxis) -> None:
    """Print the spacing of the points, which may be the reason why there is no fit."""
    from flinders.apps.classic.pages import spacing_words

    if not options.as_json:
        say(spacing_words(turn, options.judgement.target_deg, is_mean=options.method == "two-axis"))


def _draw(turn: Turn, fit: Fit, options: TwoAxis) -> None:
    """Draw the turn if --polar was typed; also for a refused fit, to show an uneven turn."""
    from flinders.apps.classic.turn_drawing import turn_drawing

    if options.polar:
        options.outputs.write(turn_drawing(turn, fit), options.polar)
        if options.polar != "-" and fit.verdict == "refused":
            say(f"written to {options.polar}")


def _show(found: TwoAxisFit, options: TwoAxis) -> None:
    """Print the page, on standard error if a result goes to standard output."""
    from flinders.apps.classic.pages import of_turn

    outputs = options.outputs
    outputs.print(
        found.as_dict,
        lambda: of_turn(found.fit, found.turn, in_options, composed=found.composed, after=options.after),
    )
    outputs.say_written()
    if options.output is None:
        say("no calibration was written: name a file with -o calibration.json")
