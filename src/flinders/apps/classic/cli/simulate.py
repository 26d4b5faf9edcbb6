"""``flinders simulate two-axis``: a two-axis compass, swung around."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import error_words, print_result, say
from flinders.cli._program import GOOD, REFUSED

if TYPE_CHECKING:
    from flinders.apps.classic.recovery import Recovery

from flinders.cli._simulation import Simulation, numbers_type, size_option


class TwoAxis(Simulation):
    """Options: parameters of a two-axis compass, and outputs."""

    output: str = option.output(
        "the recording",
        "Also write the recording, and its truth.",
        default="",
        heading=program.OUTPUT,
        type=lambda path: "" if path == "-" else path,
    )
    points: int = program.member(
        "--points", type=click.IntRange(min=6), default=36, show_default=True,
        help="Number of headings, equally spaced, the first one north.",
    )  # fmt: skip
    scale: tuple[float, float] = program.member(
        "--scale", type=numbers_type(2, "two numbers, such as 1.1,0.9"), default="1.1,0.9", show_default=True,
        metavar="X,Y", help="Scale of each axis.",
    )  # fmt: skip
    offset: tuple[float, float] = program.member(
        "--offset", type=numbers_type(2, "two numbers, such as 10,-5"), default="10,-5", show_default=True,
        metavar="X,Y", help="Offset of each axis in µT.",
    )  # fmt: skip
    skew_deg: float = program.member(
        "--skew", type=program.number_within(-89, 89, "degrees from -89 to 89"), default=4.0, show_default=True,
        metavar="DEG", help="Deviation of the angle between the axes from 90°.",
    )  # fmt: skip
    noise: float = size_option("--noise", "White noise in µT, 1 σ per axis.", default=0.25, show_default=True)
    polar: str | None = program.member(
        "--polar",
        metavar="FILE",
        help="Also write radius, heading and its error at each point (FILE.csv), or draw the points (FILE.svg).",
    )


@program.command_of(
    "two-axis",
    TwoAxis,
    common=("output", "points", "noise", "seed", "polar"),
    headings={"Sensor": ("scale", "offset", "skew_deg")},
    epilog="""\b
Example:
  flinders simulate two-axis
  flinders simulate two-axis --scale 1.2,0.9 --offset 12,-8 --skew 5
  flinders simulate two-axis -o swing.csv --polar rose.svg
""",
)
def command(options: TwoAxis) -> int:
    """Swing a simulated two-axis compass, calibrate it, and compare the result with the truth.

    Without -o only the table is printed. If noise or too few points allow no usable calibration, the table is still
    printed, and the exit code is 4. The recording has a third column of zeros; calibrate it with flinders two-axis.
    """
    from flinders.apps.classic.pages import of_recovery
    from flinders.apps.classic.recovery import recover
    from flinders.apps.classic.simulate_two_axis import TwoAxis as Compass

    options.check((), options.polar)
    recovery = recover(
        Compass(options.scale, options.offset, options.skew_deg, options.noise),
        seed=options.seed,
        points=options.points,
        field_strength=options.field_strength,
        dip_deg=options.dip_deg,
    )
    if options.output:
        options.write(recovery.swung)
    if options.polar:
        _write_polar(recovery, options.polar, force=options.force)
    print_result(
        recovery.as_dict,
        lambda: of_recovery(recovery.true, recovery.estimate, recovery.polar, recovery.turn),
        as_json=options.as_json,
    )
    if recovery.refusal is not None:
        say(f"refused: this calibration must not be used; {error_words(recovery.refusal)}")
        return REFUSED
    return GOOD


def _write_polar(recovery: Recovery, path: str, *, force: bool) -> None:
    """Draw a swing, or write it in polar coordinates."""
    from flinders.apps.classic.turn_drawing import turn_drawing
    from flinders.core.files import open_atomically, write_text

    if Path(path).suffix.lower() == ".svg":
        write_text(turn_drawing(recovery.turn, recovery.fit), path, force=force)
        say(f"drawn in {path}")
        return
    columns = recovery.polar.as_dict()
    with open_atomically(path, force=force) as file:
        file.write(",".join(columns) + "\n")
        file.writelines(
            ",".join(f"{round(value, 4) + 0.0:.4f}" for value in row) + "\n"
            for row in zip(*columns.values(), strict=True)
        )
    say(f"polar coordinates are in {path}")
