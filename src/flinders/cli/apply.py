"""``flinders apply``: correct a recording with a calibration file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _disturbances, _options
from flinders.cli._inputs import agree, choice, load, read_and_left_out, say_sensor
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, print_json, progress, say, written
from flinders.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.cli._filters import Smoother
    from flinders.cli._options import PartOfColumns
    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Compensator
    from flinders.core.samples import Recording, Samples
    from flinders.heading.smoothing import Filter
    from flinders.readers import TextRecording

FOREIGN: Final = 3.0
"""Readings that come out so many times too long or too short are of another sensor or unit: refused."""

ODD, UNEVEN = 1.3, 0.1
"""Strength, as a factor, and spread, as a fraction, from which on the calibration is said not to suit."""


@_options.old_command(
    "apply",
    common=("output", "add", "columns", "sensor", "as_json"),
    short_help="Correct a recording with a calibration file.",
    epilog="""\b
Example:
  flinders apply calibration.json raw.csv -o corrected.csv
  tail -f raw.csv | flinders apply calibration.json -
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recording", metavar="RECORDING")
@option("-o", "--output", default="-", metavar="FILE", help="Where to write [default: standard output].")
@option("--add", is_flag=True, help="Add three columns for the corrected field instead of replacing it.")
@_options.old_groups(reading=_options.PartOfColumns)
@_options.old_sensor_of_calibration
@_options.old_fixed
@_options.old_smoothing
@_options.old_force
@_options.old_as_json
def command(
    calibration: str,
    recording: str,
    output: str,
    add: bool,
    by: Filter | None,
    fixed: tuple[str, ...],
    force: bool,
    as_json: bool,
    sensor: str | None,
    reading: PartOfColumns,
) -> None:
    """Correct RECORDING with CALIBRATION: the same rows and columns, in the recording's own unit.

    Unit and axes come from the calibration file; a recording that contradicts it is refused. Corrected
    readings are in the calibration's axes. RECORDING is a file, or - for standard input, which may go on as
    long as it likes: lines are corrected as they come, and memory does not grow. What is no text, such as a
    vehicle's log, is written as a table of comma-separated text, in microtesla where its unit is known. What the
    calibration follows, such as a current, has to be among the columns.
    """
    from flinders.readers import TextRecording, open_recording

    outputs = Outputs.of(("corrected readings", output), force=force, as_json=as_json)
    outputs.check([calibration, recording])
    loaded, settler = _disturbances.settler_of(load("apply", calibration, [recording]), fixed)
    correction = loaded.calibration
    with progress("correcting") as watch:
        wanted = choice(correction, sensor)
        source = open_recording(
            recording, axes=str(correction.axes), sensor=wanted, once=True, progress=watch, **reading.as_dict()
        )
        agree(correction, source)
        if getattr(source, "name", ""):
            say(str(source))
        say_sensor(calibration, correction, source, sensor)
        corrector = Corrector(correction, source.source)
        smoother = None if by is None else _smoother(by, corrector)
        is_text = isinstance(source, TextRecording) and reading.start is None and reading.end is None
        lines = _rewritten if is_text else _tabulated
        encoding = source.layout.encoding if isinstance(source, TextRecording) else "utf-8"
        with written(output, encoding=encoding, force=force, live=not Path(recording).is_file()) as file:
            for line in lines(source, corrector, smoother, settler, add=add):  # type: ignore[arg-type]
                file.write(line)
    left_out = getattr(source, "skipped", ())
    say(f"{source.source}: {read_and_left_out(corrector.strength.readings, left_out)}; {corrector}")
    if loaded.tilt_words:
        say(f"! {loaded.tilt_words}")
    if smoother is not None:
        say(str(smoother))
    extrapolated = _disturbances.say_beyond(settler)
    if not corrector.is_plausible:
        say(f"! {_doubt(calibration, recording)}")
    outputs.say_written()
    if as_json:
        filtered = {} if smoother is None else {"filter": smoother.as_dict()}
        skipped_rows = [str(skipped) for skipped in left_out]
        print_json({**corrector.as_dict(), **filtered, "skipped": skipped_rows, **extrapolated})


def _smoother(by: Filter, corrector: Corrector) -> Smoother:
    """What filters readings before they are corrected."""
    from flinders.cli._filters import Smoother

    return Smoother(by, corrector)


def _rewritten(
    source: TextRecording, corrector: Corrector, smoother: Smoother | None, settler: Compensator, *, add: bool
) -> Iterator[str]:
    """Yield the lines of a text with corrected readings in them."""
    if smoother is None and not settler.calibration.disturbances:
        return source.corrected_lines(corrector, add=add)

    def correct(samples: Samples) -> Floats:
        settled = settler(samples)
        return corrector(settled.field) if smoother is None else smoother(settled.field, settled.time)

    return source.corrected_lines(correct, add=add, with_disturbances=True)


def _tabulated(
    source: Recording, corrector: Corrector, smoother: Smoother | None, settler: Compensator, *, add: bool
) -> Iterator[str]:
    """Yield the lines of a table of corrected readings, with all other columns."""
    from flinders.simulate import table

    for number, block in enumerate(source.blocks()):
        if len(block):
            settled = settler(block)
            corrected = corrector(settled.field) if smoother is None else smoother(settled.field, block.time)
            samples = block if add else replace(block, field=corrected)
            header, *rows = table.lines(samples, corrected=corrected if add else None)
            yield from (f"{line}\n" for line in ([header] if number == 0 else []) + rows)


class Corrector:
    """Applies a calibration block by block, and watches whether the result makes sense.

    Attributes
    ----------
    strength : Strength
        Of the readings corrected so far.
    """

    def __init__(self, correction: Calibration, source: str) -> None:
        from flinders.comparison.comparison import Strength

        self._correction, self._source = correction, source
        self.strength = Strength()

    def __call__(self, readings: Floats) -> Floats:
        """Correct (N, 3) readings.

        Raises
        ------
        InputError
            If the first of them come out with a length that the calibration contradicts.
        """
        import numpy as np

        from flinders.comparison.comparison import Strength

        corrected = self._correction.apply(readings)
        strength = np.linalg.norm(corrected, axis=1) / self._correction.field_strength
        middle = float(np.median(strength))
        if self.strength.readings == 0 and not 1 / FOREIGN < middle < FOREIGN:
            raise InputError(
                f"corrected readings of {self._source} are {middle:.2g} times as long as the calibration's field "
                f"({self._correction.field_strength:.4g} {self._correction.unit}): it is for another sensor, unit or "
                "range; check --columns, or calibrate this sensor"
            )
        self.strength += Strength.of(strength)
        return corrected

    @property
    def is_plausible(self) -> bool:
        """The corrected readings are about as long as the calibration's field, and about equally long."""
        return not self.strength.readings or (1 / ODD < self.strength.mean < ODD and self.strength.spread < UNEVEN)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: rows, mean strength as a fraction of the calibration's field, and its spread."""
        return {"rows": self.strength.readings, **self.strength.as_dict()}

    def __str__(self) -> str:
        return (
            f"corrected, their strength is {self.strength.mean:.3f} of the calibration's field, "
            f"with a spread of {self.strength.spread:.1%}"
        )


def _doubt(calibration: str, recording: str) -> str:
    """Say what an implausible strength may come from, and how to find out."""
    again = f"flinders check {calibration} {recording if recording != '-' else 'RECORDING'}"
    return (
        "these readings do not suit the calibration: iron or currents have come or gone, or it is for another sensor, "
        f"unit or place; see {again}, or calibrate again"
    )
