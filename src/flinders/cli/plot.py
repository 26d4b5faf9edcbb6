"""``flinders plot``: figures of a calibration and a recording, for papers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from flinders.cli import _options
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, print_json, say
from flinders.cli.report import of_a_pair, pictured
from flinders.errors import NotExportable, UsageError

WHAT: Final = ("all", "projections", "deviation", "residuals", "coverage")
KINDS: Final = (".svg", ".png", ".pdf")


@_options.old_command(
    "plot",
    common=("output", "what", "columns", "sensor"),
    short_help="Draw a calibration and a recording.",
    epilog="""\b
Example:
  flinders plot calibration.json tumble.csv -o figure.svg
  flinders plot calibration.json tumble.csv --what projections -o scatter.png
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@option("-o", "--output", required=True, metavar="FILE", help="Figure to write: .svg, .png or .pdf.")
@option("--what", type=click.Choice(WHAT), default="all", show_default=True, help="What is drawn.")
@of_a_pair
def command(
    calibration: str,
    recordings: tuple[str, ...],
    output: str,
    what: str,
    target_deg: float | None,
    dip_deg: float | None,
    force: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Draw what CALIBRATION does to RECORDING: scatter plots before and after, deviation, residuals, coverage.

    Needs matplotlib: pip install 'flinders[plot]'. RECORDING is a file, or - for standard input.
    """
    from flinders.core.files import write_bytes
    from flinders.report.figure_data import FigureData
    from flinders.report.matplotlib import figure_bytes, figure_of, matplotlib_of

    kind = Path(output).suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"-o {output}: need a name that ends in {', '.join(KINDS)}")
    Outputs.of(("the figure", output), force=force).check((calibration, *recordings))
    matplotlib_of()
    _, recording, fit, notes = pictured("plot", calibration, recordings, target_deg, dip_deg, reading)
    if fit.verdict == "refused":
        raise NotExportable(
            f"{calibration} was refused as not fit for use: record anew and calibrate again",
            beyond=(),
            verdict="refused",
        )
    write_bytes(figure_bytes(figure_of(FigureData.of(fit, recording), fit, what), kind[1:]), output, force=force)
    say(f"written to {output}")
    if as_json:
        print_json({"figure": output, "what": what, "verdict": fit.verdict, "notes": notes})
