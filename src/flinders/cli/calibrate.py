"""``flinders calibrate``: recordings in, a calibration out."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._talk import print_fit, print_json, progress, say

if TYPE_CHECKING:
    from flinders.document import Provenance, SourceFile
    from flinders.result import Fit
    from flinders.samples import Recording


@click.command(
    "calibrate",
    epilog="""\b
Example:
  flinders calibrate tumble.csv -o calibration.json
  flinders calibrate --columns mx,my,mz --unit mG --field-strength 49.8 monday.csv tuesday.csv -o calibration.json
""",
)
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@click.option("-o", "--output", metavar="FILE", help="Calibration file to write; without it nothing is written.")
@click.option("--method", default="auto", show_default=True, metavar="NAME", help="One of `flinders methods`.")
@click.option(
    "--field-strength", type=float, metavar="F",
    help="Strength of the field at the site, in µT (in counts for a recording in counts).",
)  # fmt: skip
@click.option("--prior", metavar="SPREAD|none", help="Soft iron thought likely where nothing was seen [default: 0.3].")
@click.option("--sensor", metavar="NAME", help="Name or serial number to keep with the calibration.")
@_options.judgement
@_options.recording
@_options.force
@_options.as_json
def command(
    recordings: tuple[str, ...], output: str | None, force: bool, as_json: bool, prior: str | None, **options: Any
) -> int:
    """Fit recordings of one sensor and write its calibration.

    Turn the sensor slowly through all directions, away from iron, while recording. RECORDING is text with
    three columns of field (comma, semicolon, tab or spaces; with or without a header), the output of a
    phone logger or MotionCal, or - for standard input. Several recordings of one sensor are fitted together.
    """
    from flinders.files import refuse_existing
    from flinders.fitting import fit as fit_recording
    from flinders.readers import open_recording
    from flinders.samples import Joined

    if output:
        refuse_existing(output, force=force)
    reading = {name: options.pop(name) for name in ("columns", "unit", "scale", "axes")}
    if prior is not None:
        options["prior"] = _spread(prior)
    with progress("reading") as watch:
        opened = open_recording(recordings, progress=watch, **reading)
        parts = [_Counted(part) for part in (opened.recordings if isinstance(opened, Joined) else (opened,))]
        for part in parts:
            say(str(part.recording))
        fit = fit_recording(Joined(tuple(parts)) if len(parts) > 1 else parts[0], **options)
    if output:
        fit.save(output, force=force, provenance=_provenance(parts))
    _report(fit, output, as_json=as_json)
    return GOOD if fit.verdict == "good" else LIMITED


def _report(fit: Fit, output: str | None, *, as_json: bool) -> None:
    """Print what was found and say where it went."""
    if as_json:
        print_json(fit.as_dict())
    else:
        print_fit(fit)
    say(f"written to {output}" if output else "nothing was written: name a file with -o calibration.json")


def _spread(text: str) -> float | None:
    """Read the value of ``--prior``."""
    if text.strip().casefold() == "none":
        return None
    try:
        spread = float(text)
    except ValueError:
        spread = -1.0
    if not 0.0 < spread < 100.0:
        raise click.BadParameter(f"{text!r}: need a positive number such as 0.3, or none", param_hint="--prior")
    return spread


class _Counted:
    """A recording that knows how many rows its last pass gave."""

    def __init__(self, recording: Recording) -> None:
        self.recording, self.source = recording, recording.source
        self.unit, self.axes = recording.unit, recording.axes
        self.rows = 0

    def blocks(self) -> Any:
        """Go through the recording."""
        self.rows = 0
        for block in self.recording.blocks():
            self.rows += len(block)
            yield block


def _provenance(parts: list[_Counted]) -> Provenance:
    """Which release made it, when, from which files."""
    from datetime import UTC, datetime

    from flinders import __version__
    from flinders.document import Provenance

    return Provenance(
        flinders=__version__,
        date=datetime.now(UTC).replace(microsecond=0),
        files=tuple(_source_file(part) for part in parts),
    )


def _source_file(part: _Counted) -> SourceFile:
    """Name, hash and size of a file as it lies on the disk; of what was spooled, for standard input."""
    from flinders.document import SourceFile

    file = part.recording.file  # type: ignore[attr-defined]
    digest = hashlib.sha256()
    with file.opened() as (raw, _):
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    return SourceFile(name=part.source, sha256=digest.hexdigest(), bytes=file.size, rows=part.rows)
