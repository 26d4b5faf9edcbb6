"""``flinders merge``: several calibrations of one sensor put together into one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from flinders.cli import _options
from flinders.cli._inputs import is_recording, provenance
from flinders.cli._options import option
from flinders.cli._output import Outputs, print_json, say, show
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    from flinders.comparison.merging import NotMerged
    from flinders.fitting.result import Fit


@_options.command(
    "merge",
    common=("output", "target_deg", "dip_deg", "force", "as_json"),
    short_help="Put several calibrations of a sensor together.",
    epilog="""\b
Example:
  flinders merge monday.json tuesday.json -o merged.json

\b
Exit codes:
  0  good
  3  limited: written, with what limits it
  4  refused: they contradict each other, nothing written
""",
)
@click.argument("calibrations", nargs=-1, required=True, metavar="CALIBRATION...")
@option(
    "-o", "--output", metavar="FILE",
    help="Calibration file to write, or - for standard output; without it nothing is written.",
)  # fmt: skip
@_options.target()
@_options.dip("Inclination of the field at the site [default: the steepest of the files].")
@_options.force
@_options.as_json
def command(
    calibrations: tuple[str, ...],
    output: str | None,
    target_deg: float,
    dip_deg: float | None,
    force: bool,
    as_json: bool,
) -> int:
    """Put several calibrations of one sensor together into one, where the recordings are gone.

    Each counts as much as the covariance that it claims says. What they differ by beyond that goes into the
    uncertainty of the result; calibrations that contradict each other are refused, not averaged. They must
    come from recordings of their own: from recordings that are still there, flinders calibrate makes a better one.
    """
    from flinders.comparison.merging import NotMerged, merge
    from flinders.core.calibration_file import dumps
    from flinders.report.fit_pages import of_merged

    outputs = Outputs.of(("the calibration", output), force=force, as_json=as_json)
    outputs.check(calibrations)
    try:
        merged = merge([_load(path) for path in calibrations], target_deg=target_deg, dip_deg=dip_deg)
    except NotMerged as refusal:
        _show_refusal(refusal, as_json=as_json)
        return REFUSED
    outputs.write(dumps(merged.to_document(provenance(files=merged.files))), output)
    if as_json:
        print_json(merged.as_dict())
    else:
        outputs.show(of_merged(merged))
    outputs.say_written("nothing was written: name a file with -o merged.json")
    return GOOD if merged.verdict == "good" else LIMITED


def _load(path: str) -> Fit:
    """Load a calibration, and see whether a recording was given in its place.

    Raises
    ------
    UsageError
        For a recording, or standard input.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.result import Fit

    if path == "-":
        raise UsageError("calibrations are told from each other by their names: give files, not -")
    try:
        return Fit.load(path)
    except DocumentError:
        if is_recording(path):
            raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None
        raise


def _show_refusal(refusal: NotMerged, *, as_json: bool) -> None:
    """Show why they were not merged."""
    from flinders.report.fit_pages import of_merged

    if not as_json:
        show(of_merged(refusal.merged), err=True)
        return
    say(f"refused: {refusal}")
    error = {"code": refusal.code, "message": str(refusal), "exit_code": refusal.exit_code}
    print_json({**refusal.merged.as_dict(), "error": {**error, "evidence": dict(refusal.evidence)}})
