"""``flinders plot``: figures of a calibration and a recording, for papers."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json
from flinders.cli._spelling import in_options
from flinders.cli.report import Pair
from flinders.errors import UsageError

KINDS: Final = (".svg", ".png", ".pdf")


class Plot(program.Group):
    """A calibration and recordings, and what is drawn of them."""

    pair: Pair = program.group(Pair)
    output: str = option.output("the figure", "Figure to write: .svg, .png or .pdf.", required=True)
    what: str = program.member(
        "--what", type=click.Choice(("all", "projections", "deviation", "residuals", "coverage")), default="all",
        show_default=True, help="What is drawn.",
    )  # fmt: skip
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "plot",
    Plot,
    common=("output", "what", "columns", "sensor"),
    epilog="""\b
Example:
  flinders plot calibration.json tumble.csv -o figure.svg
  flinders plot calibration.json tumble.csv --what projections -o scatter.png
""",
)
def command(options: Plot) -> None:
    """Draw what CALIBRATION does to RECORDING: scatter plots before and after, deviation, residuals, coverage.

    Needs matplotlib: pip install 'flinders[plot]'. RECORDING is a file, or - for standard input.
    """
    from flinders.fitting.export import refuse_unfit
    from flinders.report.figure_data import FigureData
    from flinders.report.matplotlib import figure_bytes, figure_of, matplotlib_of

    output, pair = options.output, options.pair
    kind = Path(output).suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"-o {output}: need a name that ends in {', '.join(KINDS)}")
    outputs = options.checked_outputs()
    matplotlib_of()
    found = pair.restored("plot")
    refuse_unfit(found.fit)
    figure = figure_of(FigureData.of(found.fit, found.recording), found.fit, options.what)
    outputs.write(figure_bytes(figure, kind[1:]), output)
    outputs.say_written()
    if options.as_json:
        notes = [note.words(in_options) for note in found.notes]
        print_json({"figure": output, "what": options.what, "verdict": found.fit.verdict, "notes": notes})
