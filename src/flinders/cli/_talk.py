"""What the program says beside its results, on stderr; and how results look on stdout."""

from __future__ import annotations

import contextlib
import json
import sys
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console

    from flinders.result import Fit

WORTH_A_BAR: Final = 4_000_000
"""Bytes from which on a progress bar is shown."""


def say(message: str) -> None:
    """Say something in passing."""
    click.echo(message, err=True)


def print_json(fields: dict[str, Any]) -> None:
    """Print a result for programs."""
    click.echo(json.dumps(fields, indent=2, default=str))


def print_fit(fit: Fit) -> None:
    """Print a fit for people."""
    from flinders.report.text import page

    console().print(page(fit))


def console() -> Console:
    """A console on stdout; as wide as the terminal, or a hundred columns into a file."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 100, highlight=False, soft_wrap=False)


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[int, int | None], None] | None]:
    """Show a bar while a long file is read, only on a terminal.

    What it yields is called with the bytes read so far and those there are; None where nobody is watching.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None, visible=False)

        def update(done: int, total: int | None) -> None:
            bar.update(task, completed=done, total=total, visible=(total or done) >= WORTH_A_BAR)

        yield update
