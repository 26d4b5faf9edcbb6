"""``flinders apply``: correct a recording with a calibration file."""

from __future__ import annotations

import contextlib
import io
import sys
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

import click

from flinders.cli import _drivers, _filters, _options
from flinders.cli._calibration import agree, choice, load, say_sensor, sensor_option
from flinders.cli._sources import read_and_left_out
from flinders.cli._talk import print_json, progress, say
from flinders.errors import InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Compensator
    from flinders.core.samples import Recording, Samples
    from flinders.heading.smoothing import Filter
    from flinders.readers import TextRecording

FOREIGN: Final = 3.0
"""Readings that come out so many times too long or too short are of another sensor or unit: refused."""

ODD, UNEVEN = 1.3, 0.1
"""Strength, as a factor, and spread, as a fraction, from which on the calibration is said not to suit."""


@click.command(
    "apply",
    short_help="Correct a recording with a calibration file.",
    epilog="""\b
Example:
  flinders apply calibration.json raw.csv -o corrected.csv
  tail -f raw.csv | flinders apply calibration.json -
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recording", metavar="RECORDING")
@click.option("-o", "--output", default="-", metavar="FILE", help="Where to write [default: standard output].")
@click.option("--add", is_flag=True, help="Add three columns for the corrected field instead of replacing it.")
@_filters.option
@_drivers.hold
@_options.numbers
@sensor_option
@_options.log
@_options.force
@_options.as_json
def command(
    calibration: str,
    recording: str,
    output: str,
    add: bool,
    by: Filter | None,
    held: tuple[str, ...],
    force: bool,
    as_json: bool,
    sensor: str | None,
    **reading: Any,
) -> None:
    """Correct RECORDING with CALIBRATION: the same rows and columns, in the recording's own unit.

    Unit and axes come from the calibration file; a recording that contradicts it is refused. Corrected
    readings are in the calibration's axes. RECORDING is a file, or - for standard input, which may go on as
    long as it likes: lines are corrected as they come, and memory does not grow. What is no text, such as a
    vehicle's log, is written as a table of comma-separated text, in microtesla where its unit is known. What the
    calibration follows, such as a current, has to be among the columns.
    """
    from flinders.core.files import refuse_existing
    from flinders.readers import TextRecording, open_recording

    if output == "-" and as_json:
        raise UsageError("--json and corrected readings would both go to standard output: name a file with -o")
    _options.refuse_to_overwrite(output, [calibration, recording])
    if output != "-":
        refuse_existing(output, force=force)
    judged, settler = _drivers.settler_of(load("apply", calibration, [recording]), held)
    correction = judged.calibration
    with progress("correcting") as watch:
        wanted = choice(correction, sensor)
        source = open_recording(
            recording, axes=str(correction.axes), sensor=wanted, once=True, progress=watch, **reading
        )
        agree(correction, source)
        if getattr(source, "name", ""):
            say(str(source))
        say_sensor(calibration, correction, source, sensor)
        corrector = Corrector(correction, source.source)
        smoother = None if by is None else _filters.Smoother(by, corrector)
        is_text = isinstance(source, TextRecording) and not _is_part(reading)
        lines = _rewritten if is_text else _tabulated
        encoding = source.layout.encoding if isinstance(source, TextRecording) else "utf-8"
        with _output(output, encoding, force=force, live=not Path(recording).is_file()) as file:
            for line in lines(source, corrector, smoother, settler, add=add):  # type: ignore[arg-type]
                file.write(line)
    left_out = getattr(source, "skipped", ())
    say(f"{source.source}: {read_and_left_out(corrector.strength.readings, left_out)}; {corrector}")
    if judged.record is not None and judged.record.tilt_words:
        say(f"! {judged.record.tilt_words}")
    if smoother is not None:
        say(str(smoother))
    extrapolated = _drivers.say_beyond(settler)
    if not corrector.is_plausible:
        say(f"! {_doubt(calibration, recording)}")
    if output != "-":
        say(f"written to {output}")
    if as_json:
        filtered = {} if smoother is None else {"filter": smoother.as_dict()}
        skipped_rows = [str(skipped) for skipped in left_out]
        print_json({**corrector.as_dict(), **filtered, "skipped": skipped_rows, **extrapolated})


def _is_part(reading: dict[str, Any]) -> bool:
    """Whether a part of the recording was asked for."""
    return any(reading.get(name) is not None for name in ("start", "end"))


def _rewritten(
    source: TextRecording, corrector: Corrector, smoother: _filters.Smoother | None, settler: Compensator, *, add: bool
) -> Iterator[str]:
    """Yield the lines of a text with corrected readings in them."""
    if smoother is None and not settler.calibration.disturbances:
        return source.corrected_lines(corrector, add=add)

    def correct(samples: Samples) -> Floats:
        settled = settler(samples)
        return corrector(settled.field) if smoother is None else smoother(settled.field, settled.time)

    return source.corrected_lines(correct, add=add, with_disturbances=True)


def _tabulated(
    source: Recording, corrector: Corrector, smoother: _filters.Smoother | None, settler: Compensator, *, add: bool
) -> Iterator[str]:
    """Yield the lines of a table of corrected readings, with what stands beside them."""
    from flinders.simulate import table

    for number, block in enumerate(source.blocks()):
        if len(block):
            settled = settler(block)
            corrected = corrector(settled.field) if smoother is None else smoother(settled.field, block.time)
            written = block if add else replace(block, field=corrected)
            header, *rows = table.lines(written, corrected=corrected if add else None)
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


@contextlib.contextmanager
def _output(path: str, encoding: str, *, force: bool, live: bool) -> Iterator[IO[str]]:
    """Open the output: a file that appears when it is complete, or standard output; if live, line by line."""
    from flinders.core.files import replacing

    if path != "-":
        with replacing(path, force=force, encoding=encoding, newline="") as file:
            yield file
        return
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding=encoding, newline="", line_buffering=live)
    yield sys.stdout
    sys.stdout.flush()
