"""What the program says beside its results, on stderr; and how results look on stdout.

Colours and bars are for terminals only, and there for those who have not set NO_COLOR.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import shutil
import sys
from typing import IO, TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import RenderableType

    from flinders.fitting.result import Fit

WORTH_A_BAR: Final = 4_000_000
"""Bytes from which on a progress bar is shown."""
WIDTH, NARROWEST, WIDEST = 80, 60, 100
"""Columns of what goes into a file, and the least and most that are used of a terminal: numbers stay whole, and long
lines are hard to read."""


def say(message: str) -> None:
    """Say something in passing; whoever closed stderr does not want to hear it."""
    with contextlib.suppress(OSError, ValueError):
        click.echo(message, err=True)


def print_json(fields: dict[str, Any]) -> None:
    """Print a result for programs."""
    from flinders.core.calibration_file import lay_out

    click.echo(lay_out(plain(fields)))


def print_fit(fit: Fit, *, err: bool = False) -> None:
    """Print a fit for people; on stderr where it is no result, because it was refused."""
    from flinders.report.fit_pages import of_fit

    text = drawn(of_fit(fit), sys.stderr if err else sys.stdout)
    if err:
        say(text)
    else:
        click.echo(text)


def drawn(content: RenderableType, stream: IO[str]) -> str:
    """Draw for a stream: as wide as its terminal and in colour, or plain for a file."""
    from rich.console import Console

    terminal = stream.isatty()
    page = io.StringIO()
    width = min(max(shutil.get_terminal_size((WIDTH, 24)).columns, NARROWEST), WIDEST) if terminal else WIDTH
    console = Console(file=page, width=width, force_terminal=terminal and _coloured(), highlight=False, emoji=False)
    console.print(content, markup=False, crop=False)
    return "\n".join(line.rstrip() for line in page.getvalue().splitlines())


def plain(value: object) -> object:
    """Turn a result into what JSON has: no tuples, no numbers of NumPy, null for what is not finite.

    >>> plain({"axes": ("x",), "worst": float("inf")})
    {'axes': ['x'], 'worst': None}
    """
    if isinstance(value, dict):
        return {str(key): plain(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[int, int | None], None] | None]:
    """Show a bar while a long file is read, only on a terminal.

    What it yields is called with the bytes read so far and those there are; None where nobody is watching.
    """
    if not sys.stderr.isatty():
        yield None
        return
    with contextlib.ExitStack() as stack:
        bar: Callable[[int, int], None] | None = None

        def update(done: int, total: int | None) -> None:
            nonlocal bar
            if bar is None and (total or done) >= WORTH_A_BAR:
                bar = stack.enter_context(_bar(title))
            if bar is not None:
                bar(done, total or done)

        yield update


@contextlib.contextmanager
def _bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr that goes when it is done."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    console = Console(stderr=True, color_system="auto" if _coloured() else None)
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task(title, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)


@contextlib.contextmanager
def working() -> Iterator[Callable[[str], None] | None]:
    """Show what is being done, only on a terminal; what it yields is called with a word for it, or None."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True, color_system="auto" if _coloured() else None).status("") as status:
        yield status.update


def _coloured() -> bool:
    """Whether the person at the terminal wants colours, and it has any."""
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
