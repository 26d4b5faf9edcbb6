"""``flinders merge``: several calibrations of one sensor put together into one."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from flinders.cli import _options
from flinders.cli._calibration import is_recording
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.cli._talk import drawn, print_json, say
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    from flinders.comparison.merging import Merged, NotMerged
    from flinders.core.calibration_file import Provenance
    from flinders.fitting.judged import Judged


@click.command(
    "merge",
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
@click.option(
    "-o", "--output", metavar="FILE",
    help="Calibration file to write, or - for standard output; without it nothing is written.",
)  # fmt: skip
@click.option(
    "--target", "target_deg", type=_options.within(0, 180, "degrees above 0, up to 180"), default=1.0,
    show_default=True, metavar="DEG", help="Worst heading error that is good enough.",
)  # fmt: skip
@click.option(
    "--dip", "dip_deg", type=_options.within(-89, 89, "degrees from -89 to 89"), metavar="DEG",
    help="Inclination of the field at the site [default: the steepest of the files].",
)  # fmt: skip
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

    _check_outputs(calibrations, output, force=force, as_json=as_json)
    try:
        merged = merge([_load(path) for path in calibrations], target_deg=target_deg, dip_deg=dip_deg)
    except NotMerged as refusal:
        _tell(refusal, as_json=as_json)
        return REFUSED
    _write(merged, output, force=force)
    if as_json:
        print_json(merged.as_dict())
    else:
        _show(merged, err=output == "-")
    if output != "-":
        say(f"written to {output}" if output else "nothing was written: name a file with -o merged.json")
    return GOOD if merged.verdict == "good" else LIMITED


def _check_outputs(calibrations: tuple[str, ...], output: str | None, *, force: bool, as_json: bool) -> None:
    """Find what could not be written before anything is read.

    Raises
    ------
    UsageError
        Where two results would go to standard output, or over a calibration that is read.
    OutputError
        Where a file is in the way, or could not be written.
    """
    from flinders.core.files import refuse_existing

    if output == "-" and as_json:
        raise UsageError("--json and the calibration would both go to standard output: name a file with -o")
    if output and output != "-":
        _options.refuse_to_overwrite(output, calibrations)
        refuse_existing(output, force=force)


def _load(path: str) -> Judged:
    """Load a calibration, and see whether a recording was given in its place.

    Raises
    ------
    UsageError
        For a recording, or standard input.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.judged import Judged

    if path == "-":
        raise UsageError("calibrations are told from each other by their names: give files, not -")
    try:
        return Judged.load(path)
    except DocumentError:
        if is_recording(path):
            raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None
        raise


def _tell(refusal: NotMerged, *, as_json: bool) -> None:
    """Show why they were not merged."""
    if not as_json:
        _show(refusal.merged, err=True)
    else:
        say(f"refused: {refusal}")
        told = {"code": refusal.code, "message": str(refusal), "exit_code": refusal.exit_code}
        print_json({**refusal.merged.as_dict(), "error": {**told, "evidence": dict(refusal.evidence)}})


def _show(merged: Merged, *, err: bool) -> None:
    """Print the page; on stderr where it is no result."""
    from flinders.report.fit_pages import of_merged

    text = drawn(of_merged(merged), sys.stderr if err else sys.stdout)
    if err:
        say(text)
    else:
        click.echo(text)


def _write(merged: Merged, output: str | None, *, force: bool) -> None:
    """Write the calibration where it was asked for."""
    from flinders.core.calibration_file import dumps

    if output == "-":
        click.echo(dumps(merged.to_document(_provenance(merged))), nl=False)
    elif output:
        merged.save(output, force=force, provenance=_provenance(merged))


def _provenance(merged: Merged) -> Provenance:
    """Which release merged them, when, and the recordings of all."""
    from datetime import UTC, datetime
    from importlib.metadata import version

    from flinders.core.calibration_file import Provenance

    return Provenance(flinders=version("flinders"), date=datetime.now(UTC).replace(microsecond=0), files=merged.files)
