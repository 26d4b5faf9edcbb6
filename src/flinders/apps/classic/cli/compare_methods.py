"""``flinders compare-methods``: every method on one recording."""

from __future__ import annotations

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import report_readings, stated_site
from flinders.cli._output import print_result, progress, refuse_twice, working
from flinders.cli._program import EXITS


def _names(value: str) -> list[str]:
    return [name for name in (word.strip() for word in value.split(",")) if name]


class CompareMethods(program.Group):
    """Options: recordings, and the methods to run on them."""

    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1)
    methods: list[str] | None = program.member(
        "--methods", type=_names, metavar="NAME,NAME...",
        help="Methods of `flinders methods` to run; the others are compared with the first [default: all].",
    )  # fmt: skip
    blocks: int = program.member(
        "--blocks", type=click.IntRange(2, 1000), default=10, show_default=True, metavar="N",
        help="Blocks of time for cross-validation.",
    )  # fmt: skip
    reading: option.ReadingByChip = program.group(option.ReadingByChip)
    sensor: str | None = option.sensor()
    field_strength: float | None = option.field_strength()
    judgement: option.Judgement = program.group(option.Judgement)
    as_json: bool = option.as_json()


@program.command_of(
    "compare-methods",
    CompareMethods,
    common=("methods", "blocks", "columns", "unit", "as_json"),
    epilog="""\b
Example:
  flinders compare-methods tumble.csv
  flinders compare-methods tumble.csv --methods auto,minmax,sphere --blocks 5

\b
Exit codes:
  0  at least one method is good
  3  the best method is limited
  4  no method can be trusted on this recording
""",
)
def command(options: CompareMethods) -> int:
    """Fit RECORDING by every method and print result, claimed error and cross-validated error of each.

    The cross-validated error comes from readings that were kept out of the fit: each block of time is left out once,
    and its residuals are converted to a heading error. The table gives reasons for methods that cannot be trusted on
    this recording. Nothing is written; several recordings of one sensor are joined in their order.
    """
    from flinders.apps.classic.methods import check_methods, compare_methods
    from flinders.apps.classic.methods_page import of_contest
    from flinders.core.joining import Joined, single_recordings
    from flinders.estimators.data import CountedRecording
    from flinders.likelihood.site_field import Site
    from flinders.readers import open_recording

    check_methods(options.methods)
    refuse_twice(options.recordings)
    with progress("reading") as watch:
        opened = open_recording(options.recordings, sensor=options.sensor, progress=watch, **options.reading.as_dict())
        is_dip_typed = program.is_typed("dip_deg")
        site = Site.merge_stated(
            None if is_dip_typed else stated_site(opened, "--dip"),
            strength=options.field_strength,
            inclination_deg=options.judgement.dip_deg if is_dip_typed else None,
        )
        parts = tuple(CountedRecording(part) for part in single_recordings(opened))
        with report_readings(parts), working() as tell:
            contest = compare_methods(
                Joined(parts),
                methods=options.methods,
                blocks=options.blocks,
                target_deg=options.judgement.target_deg,
                site=site,
                tell=tell,
            )
    print_result(contest.as_dict, lambda: of_contest(contest), as_json=options.as_json)
    return EXITS[contest.verdict]
