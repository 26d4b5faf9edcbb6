"""``flinders targets``: what a calibration can be written for."""

from __future__ import annotations

import textwrap
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options
from flinders.cli._output import print_json
from flinders.cli._output import show as show_page

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.targets import Target

WIDTH: Final = 78


class NamingTargets(_options.Command):
    """A command whose help names what targets have: ``{saved}`` files and ``{compasses}``."""

    def get_help(self, ctx: click.Context) -> str:
        """Fill in the names when help is shown, so that nothing else waits for the targets."""
        from flinders.targets import registry

        rows = list(registry().values())
        names = {"{saved}": _saved(rows), "{compasses}": _compasses(rows)}
        self.help = _filled(self.help, names)
        for option in self.params:
            if isinstance(option, click.Option):
                option.help = _filled(option.help, names)
        return super().get_help(ctx)


def _filled(text: str | None, names: dict[str, str]) -> str | None:
    """Put names in the place of their marks."""
    for mark, name in names.items():
        text = text and text.replace(mark, name)
    return text


def _saved(rows: Iterable[Target]) -> str:
    """What tools save that can be read, those of one kind together: a dump of Betaflight or INAV."""
    saved = dict.fromkeys(row.reader.saved for row in rows if row.reader and row.reader.saved)
    kinds = []
    for _, same in groupby(saved, key=lambda words: words.partition(" of ")[0]):
        first, *others = same
        kinds.append(" or ".join([first, *(words.partition(" of ")[2] for words in others)]))
    return f"{', '.join(kinds[:-1])}, or {kinds[-1]}"


def _compasses(rows: Iterable[Target]) -> str:
    """How tools count the compasses of a vehicle: ArduPilot's 1 to 3."""
    counted = {row.title: row.compasses for row in rows if row.compasses}
    return ", ".join(f"{title}'s {numbers[0]} to {numbers[-1]}" for title, numbers in counted.items())


@_options.command(
    "targets",
    short_help="List what a calibration can be written for.",
    epilog="""\b
Example:
  flinders targets
  flinders export --to ardupilot calibration.json -o compass.param
""",
)
@_options.as_json
def command(as_json: bool) -> None:
    """List the targets of `flinders export`: what each one holds, in which unit, and whether it is read back.

    A star marks what could not be verified in any source, and the lines below the table say what that is.

    With --json also the formula, the axes, how numbers are stored, and the source of all that.
    """
    show(as_json=as_json)


def show(*, as_json: bool) -> None:
    """Print the table of targets, and below it what nobody could verify of those with a star."""
    from flinders.targets import registry

    if as_json:
        print_json({row.name: _as_dict(row) for row in registry().values()})
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("target", style="bold")
    for heading in ("what is written", "holds", "unit", "import"):
        table.add_column(heading)
    for row in registry().values():
        unit = {"own": "any", "recorded": "any"}.get(row.unit, row.unit)
        star = " *" if row.unverified else ""
        table.add_row(f"{row.name}{star}", row.use, row.keeps, unit, "yes" if row.reader else "")
    show_page(table)
    for clause, names in _unverified(registry().values()).items():
        click.echo(textwrap.fill(f"* not verified of {', '.join(names)}: {clause}", WIDTH, subsequent_indent="  "))


def _unverified(rows: Iterable[Target]) -> dict[str, list[str]]:
    """What nobody could verify, and of which targets."""
    by_clause: dict[str, list[str]] = {}
    for row in rows:
        for clause in row.unverified:
            by_clause.setdefault(clause, []).append(row.name)
    return by_clause


def _as_dict(row: Target) -> dict[str, Any]:
    """A row of the table in full, for programs."""
    return {
        "use": row.use,
        "suffix": row.suffix,
        "formula": row.formula,
        "unit": row.unit,
        "holds": row.holds,
        "axes": row.where,
        "storage": row.storage,
        "source": row.source,
        "unverified": row.unverified,
        "import": row.reader is not None,
        "docs": row.docs,
    }
