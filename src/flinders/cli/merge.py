"""``flinders merge``: merge several calibrations of one sensor into one."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, provenance
from flinders.cli._program import EXITS
from flinders.cli._spelling import in_options
from flinders.errors import UsageError


class Merge(program.Group):
    """The calibrations to merge, and the file of the result."""

    calibrations: tuple[str, ...] = program.argument("CALIBRATION...", nargs=-1)
    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output; without it nothing is written."
    )
    target_deg: float = option.target()
    dip_deg: float | None = option.dip("Inclination of the field at the site [default: the steepest of the files].")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "merge",
    Merge,
    common=("output", "target_deg", "dip_deg", "force", "as_json"),
    epilog="""\b
Example:
  flinders merge monday.json tuesday.json -o merged.json

\b
Exit codes:
  0  good
  3  limited: written, with its limits
  4  refused: they contradict each other, nothing written
""",
)
def command(options: Merge) -> int:
    """Merge several calibrations of one sensor into one, for recordings that no longer exist.

    Each is weighted by its covariance. Differences beyond the covariances increase the uncertainty of
    the result; calibrations that contradict each other are refused, not averaged. Each must come
    from its own recording; if the recordings still exist, flinders calibrate makes a better calibration from them.
    """
    from flinders.comparison.merging import merge, source_files
    from flinders.core.calibration_file import dumps
    from flinders.fitting.fit_json import json_of
    from flinders.fitting.result import document_of
    from flinders.report.fit_pages import page_of_fit

    outputs = options.checked_outputs()
    if "-" in options.calibrations:
        raise UsageError("calibrations are identified by file name: give files, not -")
    parts = [load("merge", path) for path in options.calibrations]
    merged = merge(parts, target_deg=options.target_deg, dip_deg=options.dip_deg)
    outputs.write(dumps(document_of(merged, provenance(files=source_files(parts)))), options.output)
    outputs.print(lambda: json_of(merged), lambda: page_of_fit(merged, in_options))
    outputs.say_written("nothing was written: name a file with -o merged.json")
    return EXITS[merged.verdict]
