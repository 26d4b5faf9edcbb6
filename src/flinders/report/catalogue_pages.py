"""Tables of what there is to choose from, as pages for the terminal: methods of estimation, and targets."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.report.terminal import table

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from rich.console import RenderableType

    from flinders.estimators import Method
    from flinders.targets import Target

WIDTH: Final = 78


def of_methods(methods: Mapping[str, Method], options: Mapping[str, Mapping[str, tuple[str, ...]]]) -> RenderableType:
    """Lay out the methods: how many parameters each finds, how many readings it needs, and its options with values."""
    headings = (
        Column("method", style="bold"),
        Column("parameters\nfound", justify="right"),
        Column("readings,\nat least", justify="right"),
        Column("when to use it"),
    )
    rows = []
    for name, row in methods.items():
        lines = [row.use, *(f"option {option}: {', '.join(values)}" for option, values in options[name].items())]
        rows.append((name, str(row.parameters), str(row.kind.unknowns), "\n".join(lines)))
    return table(headings, rows)


def of_targets(targets: Collection[Target]) -> RenderableType:
    """Lay out the targets, and below them what nobody could verify of those with a star."""
    headings = [Column("target", style="bold"), *map(Column, ("what is written", "holds", "unit", "import"))]
    rows = [
        (
            f"{row.name}{' *' if row.unverified else ''}",
            row.use,
            row.keeps,
            "any" if row.unit in ("own", "recorded") else row.unit,
            "yes" if row.reader else "",
        )
        for row in targets
    ]
    names: dict[str, list[str]] = {}
    for row in targets:
        for clause in row.unverified:
            names.setdefault(clause, []).append(row.name)
    unverified = [f"* not verified of {', '.join(named)}: {clause}" for clause, named in names.items()]
    filled = [Text(textwrap.fill(line, WIDTH, subsequent_indent="  "), no_wrap=True) for line in unverified]
    return Group(table(headings, rows), *filled)
