"""``flinders heading``: convert a recording to magnetic and true headings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import clock_start, read_and_left_out, say_sensor
from flinders.cli._output import draw_page, open_output, print_json, progress, say, say_preparation
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._spelling import in_options
from flinders.cli._stream import open_log

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.heading.smoothing import Filter
    from flinders.workflows.heading_stream import HeadingStream


class Heading(program.Group):
    """A calibration and a log, its site, and the tilt compensation."""

    calibration: str = program.argument("CALIBRATION")
    log: str = program.argument("LOG")
    output: str = option.output("headings", "Where to write [default: standard output].", default="-")
    reading: option.PartOfColumns = program.group(option.PartOfColumns)
    place: option.Place = program.group(option.Place)
    accelerometer: option.Accelerometer = program.group(option.Accelerometer)
    sensor: str | None = option.sensor_of_calibration()
    declination_deg: float | None = program.member(
        "--declination", heading=program.SITE, type=program.number_within(-180, 180, "degrees from -180 to 180"),
        metavar="DEG", help="Declination, east positive, if it is known from elsewhere.",
    )  # fmt: skip
    grid: bool = option.grid("Also give headings from grid north of the map: UTM, or UPS around the poles.")
    dip_deg: float | None = option.dip(
        "Inclination of the field [default: that of --at or of the log, else as measured, else 60]."
    )
    fixed: tuple[str, ...] = option.fixed()
    formula: str = program.member(
        "--formula", heading=program.METHOD, type=click.Choice(["exact", "an4248", "an3192"]), default="exact",
        show_default=True, help="Formula of the tilt compensation; all but exact are for comparison.",
    )  # fmt: skip
    by: Filter | None = option.smoothing()
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "heading",
    Heading,
    common=("output", "place", "date", "is_level", "as_json"),
    epilog="""\b
Example:
  flinders heading calibration.json log.csv -o headings.csv
  flinders heading calibration.json log.csv --at 47.62,-122.35 --date 2026-11-21 --grid
  tail -f log.csv | flinders heading calibration.json - --level
""",
)
def command(options: Heading) -> int:
    """Write the heading of each reading of LOG, corrected with CALIBRATION, as comma-separated text.

    The heading is that of the sensor's x axis, clockwise from magnetic north. The accelerometer in LOG compensates the
    tilt, in any attitude. With --at, or a LOG that states its place, the heading from true north is added, and with
    --grid that from grid north of the map. LOG is a file, or - for standard input, which may be endless: lines are
    written as they arrive.
    """
    from flinders.fitting.result import tilt_words
    from flinders.report.heading_pages import page_of_headings

    outputs = options.checked_outputs()
    with progress("heading") as bar:
        log = _open(options, bar)
        say(str(log))
        say_sensor(options.calibration, log.fit.calibration, log.recording, options.sensor)
        lines = _lines(log)
        first = next(lines, "")  # errors of the input appear before the output is opened
        with open_output(options.output, force=options.force, live=not Path(options.log).is_file()) as file:
            file.write(first)
            file.writelines(lines)
    summary = log.summary()
    correction = summary.correction
    say(f"{log.recording.source}: {read_and_left_out(correction.strength.readings, correction.skipped)}")
    say_preparation(correction.preparation)
    say(draw_page(page_of_headings(summary, in_options), sys.stderr))
    if level := tilt_words(log.fit):
        say(f"! {level}")
    outputs.say_written()
    if options.as_json:
        print_json(summary.as_dict(in_options))
    return LIMITED if any(note.severity == "limits" for note in summary.notes) else GOOD


def _open(options: Heading, bar: Any) -> HeadingStream:  # noqa: ANN401 - progress
    """Open the log for conversion, as the options say."""
    return open_log(
        "heading",
        options.calibration,
        options.log,
        place=options.place,
        accelerometer=options.accelerometer,
        formula=options.formula,
        declination_deg=options.declination_deg,
        dip_deg=options.dip_deg,
        fixed=options.fixed,
        by=options.by,
        grid=options.grid,
        has_stated_place=True,
        sensor=options.sensor,
        progress=bar,
        **options.reading.as_dict(),
    )


def _lines(log: HeadingStream) -> Iterator[str]:
    """Yield a header with the lines of the first block, then the lines of each block."""
    header = ""
    for numbers, samples, headings in log.headings():
        columns = {**_reading_columns(log, numbers, samples), **headings.columns()}
        yield ("" if header else ",".join(columns) + "\n") + _rows(columns)
        header = "written"


def _reading_columns(log: HeadingStream, numbers: Floats, samples: Samples) -> dict[str, Floats]:
    """Columns that identify a reading: its number, and its time in s."""
    named = {"line" if hasattr(log.recording, "numbered_blocks") else "reading": numbers}
    if samples.time is not None:
        named["time_s"] = samples.time + clock_start(log.recording)
    return named


FORMATS: Final = {"line": "%.0f", "reading": "%.0f", "time_s": "%.6f", "strength": "%.5f"}
"""Number formats of the columns that are not angles."""


def _rows(columns: dict[str, Floats]) -> str:
    """Lines of a block. Headings are wrapped after rounding, so that 360.000 is never written."""
    import numpy as np

    from flinders.geometry.angles import wrap_360

    rounded = [wrap_360(np.round(values, 3)) if "heading" in name else values for name, values in columns.items()]
    form = ",".join(FORMATS.get(name, "%.3f") for name in columns) + "\n"
    return "".join(form % tuple(row) for row in np.column_stack(rounded).tolist())
