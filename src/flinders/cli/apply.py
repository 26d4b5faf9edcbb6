"""``flinders apply``: correct a recording with a calibration file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load_for_recordings, read_and_left_out, say_sensor
from flinders.cli._output import open_output, print_json, progress, say, say_preparation
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._spelling import in_options

if TYPE_CHECKING:
    from flinders.heading.smoothing import Filter
    from flinders.workflows.correction import CorrectionSummary


class Apply(program.Group):
    """A calibration, a recording, and options for reading and writing."""

    calibration: str = program.argument("CALIBRATION")
    recording: str = program.argument("RECORDING")
    output: str = option.output("corrected readings", "Where to write [default: standard output].", default="-")
    add: bool = program.flag("--add", "Add three columns for the corrected field instead of replacing it.")
    reading: option.PartOfColumns = program.group(option.PartOfColumns)
    sensor: str | None = option.sensor_of_calibration()
    fixed: tuple[str, ...] = option.fixed()
    by: Filter | None = option.smoothing()
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "apply",
    Apply,
    common=("output", "add", "columns", "sensor", "as_json"),
    epilog="""\b
Example:
  flinders apply calibration.json raw.csv -o corrected.csv
  tail -f raw.csv | flinders apply calibration.json -
""",
)
def command(options: Apply) -> int:
    """Correct RECORDING with CALIBRATION: same rows, same columns, and the recording's own unit.

    Unit and axes come from the calibration file; a recording that contradicts them is refused. Corrected readings are
    in the calibration's axes. RECORDING is a file, or - for standard input, which may be endless: lines are corrected
    as they arrive, and memory does not grow. A recording that is not text, such as a vehicle's log, is written as
    comma-separated text, in microtesla if its unit is known. A calibration with a disturbance, such as a current, needs
    a column of that disturbance.
    """
    from flinders.fitting.result import tilt_words
    from flinders.workflows.correction import CorrectionStream
    from flinders.workflows.recordings import open_with

    calibration, recording = options.calibration, options.recording
    outputs = options.checked_outputs()
    fit = load_for_recordings("apply", calibration, [recording], options.fixed)
    with progress("correcting") as watch:
        source = open_with(
            fit, recording, sensor=options.sensor, once=True, progress=watch, **options.reading.as_dict()
        )
        if getattr(source, "name", ""):
            say(str(source))
        say_sensor(calibration, fit.calibration, source, options.sensor)
        stream = CorrectionStream.of(source, fit, by=options.by)
        is_live = not Path(recording).is_file()
        with open_output(options.output, encoding=stream.encoding, force=options.force, live=is_live) as file:
            file.writelines(stream.lines(add=options.add))
    summary = stream.summary()
    _say(summary, source.source)
    if level := tilt_words(fit):
        say(f"! {level}")
    say_preparation(summary.preparation)
    for note in summary.notes:
        say(f"! {note.words(in_options)}")
    outputs.say_written()
    if options.as_json:
        print_json(summary.as_dict(in_options))
    return LIMITED if summary.notes else GOOD


def _say(summary: CorrectionSummary, source: str) -> None:
    """Print the number of readings and the strength of the corrected field."""
    strength = summary.strength
    say(
        f"{source}: {read_and_left_out(strength.readings, summary.skipped)}; the strength of the corrected field is "
        f"{strength.mean:.3f} of the calibration's field, with a spread of {strength.spread:.1%}"
    )
