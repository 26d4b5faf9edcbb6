"""What the program prints: results on stdout, messages on stderr, files where `Outputs` says.

Colours and bars are for terminals only, and there for those who have not set NO_COLOR.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import stat
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import click

from flinders.cli._spelling import in_options
from flinders.core.units import label
from flinders.errors import NotExportable, UsageError, figures, with_hint

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from rich.console import Console, RenderableType

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.core.samples import Recording
    from flinders.errors import FlindersError, Spelling
    from flinders.findings import Finding
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.result import Fit
    from flinders.workflows.correction import Preparation
    from flinders.workflows.onboard import OnboardCheck

T = TypeVar("T")
WORTH_A_BAR: Final = 4_000_000
"""Bytes from which on a progress bar is shown."""
WIDTH, NARROWEST, WIDEST = 80, 60, 100
"""Columns of what goes into a file, and the least and most that are used of a terminal: numbers stay whole, and long
lines are hard to read."""


def say(message: str) -> None:
    """Say something in passing; whoever closed stderr does not want to hear it."""
    with contextlib.suppress(OSError, ValueError):
        click.echo(message, err=True)


def error_words(error: FlindersError, commands: Sequence[click.Command] | None = None) -> str:
    """An error in a line, with the options that mend it; `commands` as `in_options` takes them."""
    return " ".join(with_hint(error.message, in_options(error.hint, commands)).splitlines())


def print_json(fields: dict[str, Any]) -> None:
    """Print a result for programs."""
    from flinders.core.json_layout import lay_out

    click.echo(lay_out(plain(fields)))


def print_result(
    fields: Callable[[], dict[str, Any]], page: Callable[[], RenderableType], *, as_json: bool, err: bool = False
) -> None:
    """Print a result for programs where that was asked for, and else its page, on stderr where stdout is taken."""
    if as_json:
        print_json(fields())
    else:
        show(page(), err=err)


def print_fit(
    fit: Fit,
    spell: Spelling = in_options,
    *,
    err: bool = False,
    is_verbose: bool = False,
    onboard: OnboardCheck | None = None,
) -> None:
    """Print a fit for people, and what each aiding sensor changed; on stderr where stdout is not for it.

    What was `onboard` is judged beside it.
    """
    from flinders.report.fit_pages import of_fit

    show(of_fit(fit, spell, is_verbose=is_verbose, onboard=onboard), err=err)
    for line in aiding_lines(fit.evidence.aiding, fit.findings):
        say(line)


def show(content: RenderableType, *, err: bool = False) -> None:
    """Print a page; on stderr where it is no result, or stdout is taken."""
    text = drawn(content, sys.stderr if err else sys.stdout)
    if err:
        say(text)
    else:
        click.echo(text)


def drawn(content: RenderableType, stream: IO[str]) -> str:
    """Draw for a stream: as wide as its terminal and in colour, or plain for a file."""
    from rich.console import Console

    terminal = stream.isatty()
    page = io.StringIO()
    width = min(max(_columns(), NARROWEST), WIDEST) if terminal else WIDTH
    console = Console(file=page, width=width, force_terminal=terminal and _coloured(), highlight=False, emoji=False)
    console.print(content, markup=False, crop=False)
    return "\n".join(line.rstrip() for line in page.getvalue().splitlines())


def _columns() -> int:
    """Width of the terminal."""
    import shutil

    return shutil.get_terminal_size((WIDTH, 24)).columns


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
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(), transient=True) as shown:
        task = shown.add_task(title, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)


@contextlib.contextmanager
def working() -> Iterator[Callable[[str], None] | None]:
    """Show what is being done, only on a terminal; what it yields is called with a word for it, or None."""
    if not sys.stderr.isatty():
        yield None
        return
    with console().status("") as status:
        yield status.update


def console() -> Console:
    """The terminal of the person who watches."""
    from rich.console import Console

    return Console(stderr=True, color_system="auto" if _coloured() else None)


def _coloured() -> bool:
    """Whether the person at the terminal wants colours, and it has any."""
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


class Output(NamedTuple):
    """A file that a command writes: what it is, its path (``-``: standard output), and the option that names it."""

    what: str
    path: str | None
    option: str = "-o"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where each result of a command goes."""

    files: tuple[Output, ...]  # those without a path are not written
    force: bool = False  # write over what is there
    as_json: bool = False  # the result goes to standard output as JSON

    @classmethod
    def of(cls, *files: tuple[str, str | None], force: bool = False, as_json: bool = False) -> Outputs:
        """Make it of what it is and its path."""
        return cls(tuple(Output(*each) for each in files), force, as_json)

    @property
    def is_printed(self) -> bool:
        """Whether standard output belongs to one of the files."""
        return any(file.path == "-" for file in self.files)

    def check(self, inputs: Iterable[str] = ()) -> None:
        """Find what could not be written before any work is done."""
        from flinders.core.files import refuse_existing

        printed = [file for file in self.files if file.path == "-"]
        if len(printed) + self.as_json > 1:
            names = ["--json"] * self.as_json + [file.what for file in printed]
            option = printed[not self.as_json].option
            raise UsageError(f"{' and '.join(names)} would both go to standard output: name a file with {option}")
        inputs, named = list(inputs), dict[Path, str]()
        for what, path, _ in self.files:
            if not path:
                continue
            refuse_to_overwrite(path, inputs)
            if path == "-":
                continue
            refuse_existing(path, force=self.force)
            if other := named.get(Path(path).resolve()):
                raise UsageError(f"{path} is named for {other} and for {what}: give them two names")
            named[Path(path).resolve()] = what

    def write(self, content: str | bytes, path: str | None) -> None:
        """Write text or bytes to one of the files, whole or not at all; no bytes to a terminal."""
        from flinders.core.files import write_bytes, write_text

        if path == "-" and isinstance(content, bytes) and sys.stdout.isatty():
            raise UsageError(f"this is {len(content)} bytes, and no text: name a file with -o")
        if path == "-":
            click.echo(content, nl=False)
        elif path and isinstance(content, bytes):
            write_bytes(content, path, force=self.force)
        elif path:
            write_text(str(content), path, force=self.force)

    def print(self, fields: Callable[[], dict[str, Any]], page: Callable[[], RenderableType]) -> None:
        """Print a result as `print_result`; the page on stderr where a file has standard output."""
        print_result(fields, page, as_json=self.as_json, err=self.is_printed)

    def show(self, content: RenderableType) -> None:
        """Print a page; on stderr where a file has standard output."""
        show(content, err=self.is_printed)

    def say_written(self, nothing: str = "") -> None:
        """Say which files were written; `nothing` is what to say where the first of them was not asked for."""
        for place, file in enumerate(self.files):
            if file.path and file.path != "-":
                say(f"written to {file.path}")
            elif not file.path and place == 0 and nothing:
                say(nothing)


def refuse_to_overwrite(output: str, inputs: Iterable[str]) -> None:
    """Keep what is read from being written over, also with ``--force`` and through ``>``."""
    target = _identity(sys.stdout if output == "-" else output)
    for path in inputs:
        if path != "-" and target is not None and target == _identity(path):
            raise UsageError(f"{path} is read, and would be written over: name another file for the output")


def refuse_twice(paths: Iterable[str]) -> None:
    """Take a recording once: counted twice it would seem better than it is."""
    seen = set()
    for path in paths:
        file = path if path == "-" else _identity(path)
        if file is not None and file in seen:
            raise UsageError(f"{'standard input' if path == '-' else path} is given twice: name each recording once")
        seen.add(file)


def _identity(file: str | IO[str]) -> tuple[int, int] | None:
    """Which regular file a path or stream leads to, by whatever name; None where it leads to none."""
    try:
        status = Path(file).stat() if isinstance(file, str) else os.fstat(file.fileno())
    except (OSError, ValueError):
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISREG(status.st_mode) else None


@contextlib.contextmanager
def written(path: str, *, force: bool, live: bool, encoding: str = "utf-8") -> Iterator[IO[str]]:
    """Open an output: a file that appears when it is complete, or standard output; if live, line by line."""
    from flinders.core.files import replacing

    if path != "-":
        with replacing(path, force=force, encoding=encoding, newline="") as file:
            yield file
        return
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding=encoding, newline="", line_buffering=live)
    yield sys.stdout
    sys.stdout.flush()


def refuse_report(path: str | None, option: str) -> None:
    """Refuse a name that is not one of an HTML file."""
    if path == "-":
        raise UsageError(f"{option} -: a report is a megabyte of HTML, name a file such as report.html")
    if path is not None and Path(path).suffix.lower() == ".pdf":
        raise UsageError(
            f"{option} {path}: a report is HTML; for PDF use flinders report CALIBRATION RECORDING --pdf {path}"
        )


def aiding_lines(aiding: Aiding | None, findings: Iterable[Finding]) -> list[str]:
    r"""What each aiding sensor changed; nothing where there were none.

    >>> from flinders.fitting.aiding import Aiding, AidingSensor
    >>> rate = AidingSensor("rate", True, 0.4, 2.0, 0.5)
    >>> dip = AidingSensor("dip", False, reason="claims no less: 0.60° with it, 0.50° without")
    >>> print(*aiding_lines(Aiding((rate, dip)), ()), sep="\n")
    rate changed the heading by 0.40°: worst error 2.00° without it, 0.50° with it
    dip was left out: claims no less: 0.60° with it, 0.50° without
    """
    if aiding is None:
        return []
    lines = []
    said = {(mistake.aid, mistake.code) for mistake in aiding.mistakes if mistake.finding in findings}
    for aid in aiding.sensors:
        claims = aid.reason or f"worst error {aid.before_deg:.2f}° without it, {aid.after_deg:.2f}° with it"
        lines.append(
            f"{aid.name} changed the heading by {aid.heading_change_deg:.2f}°: {claims}"
            if aid.is_used
            else f"{aid.name} was left out{', as said above' if (aid.name, aid.code) in said else f': {aid.reason}'}"
        )
    if aiding.acceleration_bias is not None and aiding.acceleration_bias_sigma is not None:
        x, y, z = (f"{value:.3f}" for value in aiding.acceleration_bias_sigma)
        lines.append(
            f"{bias_words(aiding.acceleration_bias)} (1 σ: {x}, {y}, {z}); the calibration file keeps it, and "
            "flinders heading uses it"
        )
    return lines


def bias_words(bias: Iterable[float]) -> str:
    """What an accelerometer reads too much, in words.

    >>> bias_words([0.1784, -0.3, 0.0])
    'the accelerometer reads 0.178, −0.300 and 0.000 m/s² too much along x, y and z'
    """
    x, y, z = (f"{round(value, 3) + 0.0:.3f}".replace("-", "−") for value in bias)
    return f"the accelerometer reads {x}, {y} and {z} m/s² too much along x, y and z"


def plot_fit(fit: Fit, recording: Recording, *, err: bool = False) -> None:
    """Draw a fit in a few lines, where it is printed on a terminal that can."""
    stream = sys.stderr if err else sys.stdout
    if not stream.isatty() or os.environ.get("TERM") == "dumb":
        return
    from flinders.report.figure_data import FigureData
    from flinders.report.terminal import DRAWN, plot

    is_plain = not can_show(stream.encoding or "ascii", DRAWN)
    click.echo("", err=err)
    click.echo(drawn(plot(FigureData.of(fit, recording), fit, is_plain=is_plain, width=_columns()), stream), err=err)


def can_show(encoding: str, text: str) -> bool:
    """Whether a stream of this encoding has these letters.

    >>> can_show("utf-8", "⣿█"), can_show("latin-1", "⣿█"), can_show("no such", "a")
    (True, False, False)
    """
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def strength_words(calibration: Calibration, what: str = "a convention") -> str:
    """That the field strength of an imported calibration is not known, and what to do."""
    strength = f"{figures(calibration.field_strength, 4)} {label(calibration.unit)}"
    return f"! field strength {strength} is {what}: give --field-strength where lengths matter"


def cost_words(calibration: Calibration, disturbance: Disturbance) -> str:
    """Heading error that a disturbance makes at the far end of its range, at a dip of 60°."""
    cost = figures(min(calibration.disturbance_deg(disturbance), 180.0))
    return f"up to {cost}° of heading at {disturbance.amount(disturbance.farthest)}"


def say_references(fit: Fit) -> None:
    """Say where a calibration is taken that follows something, for a command that looks at offset and matrix only."""
    for disturbance in fit.calibration.disturbances:
        say(
            f"{fit.provenance.name} follows {disturbance.name}: it is taken at "
            f"{disturbance.amount(disturbance.reference)}; what it follows is "
            f"{cost_words(fit.calibration, disturbance)}"
        )


def say_difference(a: Fit, b: Fit) -> None:
    """Say where two calibrations are compared that follow something, and how far apart what they follow is."""
    for fit in (a, b):
        say_references(fit)
    theirs = {disturbance.name: disturbance for disturbance in b.calibration.disturbances}
    for disturbance in a.calibration.disturbances:
        if other := theirs.get(disturbance.name):
            between = replace(disturbance, per_unit=other.per_unit - disturbance.per_unit)
            say(f"what both follow of {disturbance.name} differs by {cost_words(a.calibration, between)}")


def say_preparation(preparation: Preparation) -> None:
    """Say what a filter did, and what lay outside the range that a disturbance was found in."""
    if preparation.smoother is not None:
        say(str(preparation.smoother))
    for finding in preparation.findings():
        say(f"! {finding.advice}")


def is_asked() -> bool:
    """Whether there is a person who can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def lossy_if_agreed(attempt: Callable[[bool], T], *, lossy: bool) -> T:
    """Do something without a loss; on a terminal, ask whether to do it with the loss that it is refused for."""
    try:
        return attempt(lossy)
    except NotExportable as refused:
        if lossy or "heading_deg" not in refused.evidence or not is_asked():
            raise
        say(f"! {error_words(refused)}")
        if not click.confirm("Do it all the same?", err=True):
            raise
    return attempt(True)
