"""Options shared by the commands of ``flinders simulate``: field, seed, and output files."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import Outputs, say
from flinders.errors import UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from flinders.simulate import Simulated


def numbers_type(count: int, what: str) -> Callable[[object], tuple[float, ...]]:
    """Make the type of an option that takes `count` finite numbers separated by commas."""

    def numbers(value: object) -> tuple[float, ...]:
        parts = value if isinstance(value, tuple) else tuple(program.numbers_of(str(value)))
        if len(parts) != count:
            raise click.BadParameter(f"{str(value)!r}: need {what}")
        return parts

    return numbers


def size_option(name: str, words: str, **more: Any) -> program.Field:
    """An option with a value in µT, at least 0."""
    size = program.number_within(0, sys.float_info.max, "0 or a number above it", zero=True)
    return program.member(name, type=size, metavar="UT", help=words, **more)


class Simulation(program.Group):
    """Field, seed, and output files of a simulation."""

    field_strength: float = option.field_strength(
        "Strength of the field in µT.", default=50.0, show_default=True, metavar="UT"
    )
    dip_deg: float = option.dip("Inclination of the field.", 60.0)
    seed: int = program.member(
        "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the random numbers."
    )
    output: str = option.output(
        "the recording", "Where to write the recording [default: standard output].", default="-", heading=program.OUTPUT
    )
    truth: str | None = program.member(
        "--truth", heading=program.OUTPUT, metavar="FILE",
        help="Where to write the truth [default: the recording's name, .truth.json].",
    )  # fmt: skip
    force: bool = option.force("Overwrite the files if they exist.")
    as_json: bool = option.as_json()

    @property
    def truth_path(self) -> str | None:
        """File of the truth; None if it is not written."""
        from flinders.simulate.truth import truth_path

        return self.truth or (truth_path(self.output) if self.output not in ("", "-") else None)

    def check(self, inputs: Iterable[str] = (), *others: str | None, as_json: bool = False) -> None:
        """Refuse outputs that cannot be written, before anything is simulated."""
        if "-" in (self.truth, *others):
            raise UsageError("standard output is for the recording: name a file for --truth and --polar")
        if self.truth and not self.output:
            raise UsageError("--truth needs a file for the recording: name it with -o")
        files = (
            ("the recording", self.output),
            ("the truth", self.truth_path),
            *(("the table", path) for path in others),
        )
        Outputs.of(*files, force=self.force, as_json=as_json).check(inputs)

    def write(self, simulated: Simulated, *, bare: bool = False) -> None:
        """Write the recording and its truth, and print a summary; `bare` keeps only the magnetic field."""
        from dataclasses import replace

        from flinders.simulate.recording import lines, write_csv
        from flinders.simulate.truth import Truth, write

        samples = replace(simulated.samples, acceleration=None, rate=None) if bare else simulated.samples
        if self.output == "-":
            sys.stdout.writelines(f"{line}\n" for line in lines(samples))
        else:
            write_csv(samples, self.output, force=self.force)
        where = self.truth_path
        if where:
            write(Truth.of(simulated), where, force=self.force)
        say(_summary(simulated))
        if self.output != "-":
            say(f"the recording is in {self.output}")
        say(f"the truth is in {where}" if where else "the truth was not written: name a file with -o or --truth")


def _summary(simulated: Simulated) -> str:
    """Describe the simulation in one line."""
    samples, sensor = simulated.samples, simulated.sensor
    parts = [f"simulated: {count_text(len(samples), 'reading')}, {simulated.motion}"]
    if samples.time is not None and simulated.rate_hz:
        parts[0] += f", {len(samples) / simulated.rate_hz:g} s"
    offset = sensor.offset if samples.time is not None else sensor.offset[:2]  # a swing has two axes and no times
    parts.append(f"offset {math.hypot(*offset):.3g} µT, {sensor.noise:g} µT of noise")
    if outliers := int(simulated.outliers.sum()):
        parts.append(count_text(outliers, "outlier"))
    return "; ".join([*parts, *simulated.disturbances])
