"""``flinders compare-methods``: every method on one recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from flinders.cli import _options
from flinders.cli._inputs import Counted, saying_what_was_skipped
from flinders.cli._options import option
from flinders.cli._output import print_json, progress, refuse_twice, show, working
from flinders.cli._program import GOOD, LIMITED, REFUSED

if TYPE_CHECKING:
    from flinders.cli._options import ReadingOptions
    from flinders.findings import Verdict

EXITS: Final[dict[Verdict, int]] = {"good": GOOD, "limited": LIMITED, "refused": REFUSED}


def _names(value: str) -> list[str]:
    return [name for name in (word.strip() for word in value.split(",")) if name]


@_options.command(
    "compare-methods",
    common=("methods", "blocks", "columns", "unit", "as_json"),
    short_help="Run all methods on a recording, side by side.",
    epilog="""\b
Example:
  flinders compare-methods tumble.csv
  flinders compare-methods tumble.csv --methods auto,minmax,sphere --blocks 5

\b
Exit codes:
  0  one of them is good
  3  the best of them is limited
  4  none can be trusted on this recording
""",
)
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@option(
    "--methods", type=_names, metavar="NAME,NAME...",
    help="Those of `flinders methods` to run, the first to hold the others against [default: all].",
)  # fmt: skip
@option(
    "--blocks", type=click.IntRange(2, 1000), default=10, show_default=True, metavar="N",
    help="Blocks of time for cross-validation.",
)  # fmt: skip
@_options.groups(reading=_options.ReadingOptions)
@_options.sensor
@_options.field_strength()
@_options.judgement
@_options.as_json
def command(
    recordings: tuple[str, ...],
    methods: list[str] | None,
    blocks: int,
    field_strength: float | None,
    target_deg: float,
    dip_deg: float,
    as_json: bool,
    sensor: str | None,
    reading: ReadingOptions,
) -> int:
    """Fit RECORDING by every method and print what each finds, claims and is worth.

    The cross-validated error comes from readings that a method has not seen: each block of time is held back
    once, and what it asks for is carried over to the heading. Methods that cannot be trusted on this recording say
    why. Nothing is written; of several recordings of one sensor the blocks follow each other.
    """
    from flinders.comparison.methods import compare_methods, known
    from flinders.core.samples import Joined, singles
    from flinders.readers import open_recording
    from flinders.report.comparison_pages import of_methods

    known(methods)
    refuse_twice(recordings)
    with progress("reading") as watch:
        opened = open_recording(recordings, sensor=sensor, progress=watch, **reading.as_dict())
        parts = tuple(Counted(part) for part in singles(opened))
        with saying_what_was_skipped(parts), working() as tell:
            contest = compare_methods(
                Joined(parts),
                methods=methods,
                blocks=blocks,
                field_strength=field_strength,
                target_deg=target_deg,
                dip_deg=dip_deg,
                tell=tell,
            )
    if as_json:
        print_json(contest.as_dict())
    else:
        show(of_methods(contest))
    return EXITS[contest.verdict]
