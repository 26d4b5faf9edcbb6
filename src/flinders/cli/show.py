"""``flinders show``: show the contents of a calibration file."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import likely_target, load
from flinders.cli._output import print_result, say, show
from flinders.cli._spelling import in_options
from flinders.core.language import phrase


class Show(program.Group):
    """A calibration file."""

    calibration: str = program.argument("CALIBRATION")
    verbose: bool = program.flag("--verbose", "Also print notes that apply to nearly every calibration.")
    as_json: bool = option.as_json()


@program.command_of(
    "show",
    Show,
    common=("verbose", "as_json"),
    epilog="""\b
Example:
  flinders show calibration.json
  flinders show calibrations.parquet
""",
)
def command(options: Show) -> None:
    """Show the contents of CALIBRATION: offset and matrix with their uncertainty, heading error, limits and origin.

    Nothing is fitted. With --json the file is printed in the format of this release. For a table written by `flinders
    fleet`, show how many units are good, and why the others are not.
    """
    import click

    from flinders.core.calibration_file import dumps
    from flinders.core.plugins import other_contents
    from flinders.fitting.result import document_of
    from flinders.report.fit_pages import page_of_file

    other = other_contents(options.calibration)
    if other is not None and not other.is_one_recording:
        print_result(other.as_dict, other.page, as_json=options.as_json)
        return
    fit = load("show", options.calibration)
    if options.as_json:
        click.echo(dumps(document_of(fit)), nl=False)
        return
    show(page_of_file(fit, in_options, is_verbose=options.verbose))
    path, target = options.calibration, likely_target(fit.provenance.files)
    commands = f"flinders apply {path} raw.csv; flinders export --for {target} {path}"
    say(phrase("next.use", "use it: {commands}", commands=commands))
