"""``flinders calibrate --minmax``: six typed numbers in place of a recording."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli._method_options import parsed
from flinders.cli._program import LIMITED
from flinders.cli._talk import drawn, print_json, say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration_file import Provenance
    from flinders.fitting.axis_extremes import Extremes

OF_READINGS: Final = {
    "report_html": "--report",
    "report": "--report-text",
    "prior": "--prior",
    "robust": "--robust",
    "alignment_sigma_deg": "--alignment-sigma",
    "columns": "--columns",
    "filter": "--filter",
    "convergence": "--convergence",
}
"""Options that mean nothing without readings."""


def calibrate(
    text: str,
    *,
    recordings: tuple[str, ...],
    method_options: Sequence[str],
    output: str | None,
    force: bool,
    as_json: bool,
    options: dict[str, Any],
) -> int:
    """Calibrate from six numbers, write it and say what is known of it.

    Raises
    ------
    UsageError
        For anything but six numbers, a recording beside them, or options that need readings.
    OutputError
        Where the file is in the way, or cannot be written.
    """
    from flinders.core.axes import Axes
    from flinders.core.units import Unit
    from flinders.estimators import METHODS
    from flinders.estimators.reference.minmax import MinMax
    from flinders.fitting.axis_extremes import from_extremes

    method = options.pop("method")
    if recordings:
        raise UsageError(f"--minmax takes the place of a recording: leave {recordings[0]} out, or --minmax")
    if method not in ("auto", MinMax.name):
        raise UsageError(f"--minmax goes with --method {MinMax.name}: leave {method} out")
    useless = [option for name, option in OF_READINGS.items() if options.get(name) not in (None, False)]
    if useless:
        raise UsageError(f"{', '.join(useless)} needs readings, and --minmax has none: leave it out")
    own = parsed(method_options, METHODS[MinMax.name])
    if own.pop("trim", False):
        raise UsageError("--option trim=yes needs readings, and --minmax has none: leave it out")
    _check_output(output, force=force, as_json=as_json)
    site = {name: options[name] for name in ("field_strength", "target_deg", "dip_deg", "sensor")}
    unit = Unit.of(options["unit"] or "counts", options["scale"])
    found = from_extremes(_numbers(text), unit=unit, axes=Axes.of(options["axes"]), **site, **own)
    _write(found, output, force=force)
    if as_json:
        print_json(found.as_dict())
    else:
        _show(found, err=output == "-")
    if output != "-":
        say(f"written to {output}" if output else "nothing was written: name a file with -o calibration.json")
    return LIMITED


def _numbers(text: str) -> list[float]:
    """Read numbers between commas.

    Raises
    ------
    UsageError
        For what is no number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--minmax {text!r}: need six numbers, such as -157,98,-123,124,-109,101") from None


def _check_output(output: str | None, *, force: bool, as_json: bool) -> None:
    """Find what could not be written before anything is calculated.

    Raises
    ------
    UsageError
        Where two results would go to standard output.
    OutputError
        Where a file is in the way.
    """
    from flinders.core.files import refuse_existing

    if output == "-" and as_json:
        raise UsageError("--json and the calibration would both go to standard output: name a file with -o")
    if output and output != "-":
        refuse_existing(output, force=force)


def _show(found: Extremes, *, err: bool) -> None:
    """Print the page; on stderr where the calibration goes to standard output."""
    from flinders.report.fit_pages import of_extremes

    text = drawn(of_extremes(found), sys.stderr if err else sys.stdout)
    if err:
        say(text)
    else:
        click.echo(text)


def _write(found: Extremes, output: str | None, *, force: bool) -> None:
    """Write the calibration where it was asked for."""
    from flinders.core.calibration_file import dumps

    if output == "-":
        click.echo(dumps(found.to_document(_provenance())), nl=False)
    elif output:
        found.save(output, force=force, provenance=_provenance())


def _provenance() -> Provenance:
    """Which release made it, when."""
    from datetime import UTC, datetime
    from importlib.metadata import version

    from flinders.core.calibration_file import Provenance

    return Provenance(flinders=version("flinders"), date=datetime.now(UTC).replace(microsecond=0), files=())
