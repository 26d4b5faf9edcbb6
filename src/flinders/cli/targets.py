"""``flinders targets``: list the targets of `flinders export`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_result

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.targets import Target


class NamingTargets(program.Command):
    """A command whose help contains names of targets, in place of ``{saved}`` and ``{compasses}``."""

    def get_help(self, ctx: click.Context) -> str:
        """Fill in the names when help is shown; targets are imported only then."""
        from flinders.targets import registry

        rows = list(registry().values())
        names = {"{saved}": _saved_files(rows), "{compasses}": _compasses(rows)}
        self.help = _fill_names(self.help, names)
        for each in self.params:
            if isinstance(each, click.Option):
                each.help = _fill_names(each.help, names)
        return super().get_help(ctx)


def _fill_names(text: str | None, names: dict[str, str]) -> str | None:
    """Replace the marks in a text by names."""
    for mark, name in names.items():
        text = text and text.replace(mark, name)
    return text


def _saved_files(rows: Iterable[Target]) -> str:
    """Kinds of files that targets read, in words, grouped by kind: a dump of one tool or another."""
    saved = dict.fromkeys(row.reader.saved for row in rows if row.reader and row.reader.saved)
    kinds: dict[str, list[str]] = {}
    for words in saved:
        kind, _, whose = words.partition(" of ")
        kinds.setdefault(kind, []).append(whose)
    *first, last = (" of ".join(filter(None, [kind, " or ".join(whose)])) for kind, whose in kinds.items())
    return f"{', '.join(first)}, or {last}"


def _compasses(rows: Iterable[Target]) -> str:
    """Numbers of a vehicle's compasses in each tool, from first to last, in words."""
    counted = {row.title: row.compasses for row in rows if row.compasses}
    return ", ".join(f"{title}'s {numbers[0]} to {numbers[-1]}" for title, numbers in counted.items())


class Targets(program.Group):
    """Which targets, and the format of the list."""

    word: str | None = program.argument("[WORD]", required=False)
    as_json: bool = option.as_json()


@program.command_of(
    "targets",
    Targets,
    epilog="""\b
Example:
  flinders targets
  flinders targets ros
  flinders export --for arduino calibration.json -o mag.ino
""",
)
def command(options: Targets) -> None:
    """List the targets of `flinders export`: what each one can store, its unit, and whether it can be imported.

    Targets are grouped by what you have. With WORD, only targets that have this word in their name, in the form that
    they write, or in their group.

    A star marks a fact that no source confirms; lines below the table name these facts.

    With --json also the formula, the axes, the number format, and the sources of these facts.
    """
    from flinders.report.comparison_pages import page_of_targets
    from flinders.targets import registry, search

    rows = tuple(registry().values()) if options.word is None else search(options.word)
    print_result(
        lambda: {row.name: row.as_dict() for row in rows}, lambda: page_of_targets(rows), as_json=options.as_json
    )
