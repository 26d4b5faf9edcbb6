"""``flinders apply``: correct a recording with a calibration file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import in_use, open_with, say_sensor
from flinders.cli._output import print_json, progress, say, written
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._stream import Corrector, Preparation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.heading.smoothing import Filter


class Apply(program.Group):
    """A calibration, a recording, and how it is corrected and written."""

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
    """Correct RECORDING with CALIBRATION: the same rows and columns, in the recording's own unit.

    Unit and axes come from the calibration file; a recording that contradicts it is refused. Corrected
    readings are in the calibration's axes. RECORDING is a file, or - for standard input, which may go on as
    long as it likes: lines are corrected as they come, and memory does not grow. What is no text, such as a
    vehicle's log, is written as a table of comma-separated text, in microtesla where its unit is known. What the
    calibration follows, such as a current, has to be among the columns.
    """
    from flinders.fitting.result import tilt_words

    calibration, recording = options.calibration, options.recording
    outputs = options.checked_outputs()
    fit, compensator = in_use("apply", calibration, [recording], options.fixed)
    with progress("correcting") as watch:
        source = open_with(
            fit, recording, sensor=options.sensor, once=True, progress=watch, **options.reading.as_dict()
        )
        if getattr(source, "name", ""):
            say(str(source))
        say_sensor(calibration, fit.calibration, source, options.sensor)
        corrector, preparation = Corrector(fit, source.source), Preparation.of(compensator, options.by)
        encoding, lines = _lines(source, corrector, preparation, options)
        with written(
            options.output, encoding=encoding, force=options.force, live=not Path(recording).is_file()
        ) as file:
            file.writelines(lines)
    _say_strength(source, corrector)
    if level := tilt_words(fit):
        say(f"! {level}")
    prepared = preparation.say()
    if corrector.doubt:
        say(f"! {corrector.doubt}")
    outputs.say_written()
    if options.as_json:
        strength = corrector.strength
        skipped = [str(skipped) for skipped in getattr(source, "skipped", ())]
        limits = [corrector.doubt] if corrector.doubt else []
        print_json(
            {"readings": strength.readings, **strength.as_dict(), "skipped": skipped, "limits": limits, **prepared}
        )
    return LIMITED if corrector.doubt else GOOD


def _lines(
    source: Recording, corrector: Corrector, preparation: Preparation, options: Apply
) -> tuple[str, Iterator[str]]:
    """The encoding and the corrected lines: of a text those that were read, of anything else those of a table."""
    from flinders.readers import TextRecording

    is_cut = options.reading.start is not None or options.reading.end is not None
    encoding = source.layout.encoding if isinstance(source, TextRecording) else "utf-8"
    if is_cut or not isinstance(source, TextRecording):
        return encoding, _tabulated(source, corrector, preparation, add=options.add)
    if preparation.is_nothing and not source.columns.is_assumed:
        return encoding, source.corrected_lines(corrector, add=options.add)

    def correct(samples: Samples) -> Floats:
        corrector.look_at(samples)
        return corrector(preparation(samples).field)

    return encoding, source.corrected_lines(correct, add=options.add, with_disturbances=True)


def _tabulated(source: Recording, corrector: Corrector, preparation: Preparation, *, add: bool) -> Iterator[str]:
    """Yield the lines of a table of corrected readings, with all other columns."""
    from flinders.simulate.recording import lines

    for number, block in enumerate(source.blocks()):
        if len(block):
            corrector.look_at(block)
            corrected = corrector(preparation(block).field)
            samples = block if add else replace(block, field=corrected)
            header, *rows = lines(samples, corrected=corrected if add else None)
            yield from (f"{line}\n" for line in ([header] if number == 0 else []) + rows)


def _say_strength(source: Recording, corrector: Corrector) -> None:
    """Say what was read, and how strong the corrected field is."""
    strength = corrector.strength
    say(
        f"{source.source}: {corrector.read_words(source)}; corrected, their strength is {strength.mean:.3f} of the "
        f"calibration's field, with a spread of {strength.spread:.1%}"
    )
