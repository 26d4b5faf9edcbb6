"""Output of the program: results on stdout, messages on stderr, and output files.

Colours and progress bars are used on terminals only; NO_COLOR turns colours off.
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

from flinders.cli._spelling import in_options, in_unused_options
from flinders.core.language import phrase
from flinders.core.units import unit_label
from flinders.errors import NotExportable, UsageError, append_hint, figures

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
MIN_BYTES_FOR_BAR: Final = 4_000_000
"""Size of an input, in bytes, from which a progress bar is shown."""
WIDTH, MIN_WIDTH, MAX_WIDTH = 80, 60, 100
"""Line width in characters: of a file, and the limits for a terminal.

Narrower lines would break numbers, and wider ones are hard to read.
"""


def say(message: str) -> None:
    """Print a message on stderr; ignored if stderr is closed."""
    with contextlib.suppress(OSError, ValueError):
        click.echo(message, err=True)


def error_words(error: FlindersError, commands: Sequence[click.Command] | None = None) -> str:
    """Write an error in one line, with the options that avoid it; `commands` are those of `in_options`."""
    return " ".join(append_hint(error.message, in_options(error.hint, commands)).splitlines())


def print_json(fields: dict[str, Any]) -> None:
    """Print a result as JSON."""
    from flinders.core.json_layout import lay_out

    click.echo(lay_out(json_value(fields)))


def print_result(
    fields: Callable[[], dict[str, Any]], page: Callable[[], RenderableType], *, as_json: bool, err: bool = False
) -> None:
    """Print a result as JSON or as a page; with `err` the page goes to stderr."""
    if as_json:
        print_json(fields())
    else:
        show(page(), err=err)


def print_fit(
    fit: Fit,
    spell: Spelling = in_unused_options,
    *,
    err: bool = False,
    is_verbose: bool = False,
    onboard: OnboardCheck | None = None,
) -> None:
    """Print the page of a fit and the effect of each aiding sensor; with `err` on stderr.

    `onboard` is the check of the onboard calibration, which is printed below the page.
    """
    from flinders.report.fit_pages import page_of_fit

    show(page_of_fit(fit, spell, is_verbose=is_verbose, onboard=onboard), err=err)
    for line in aiding_lines(fit.evidence.aiding, fit.findings):
        say(line)


def show(content: RenderableType, *, err: bool = False) -> None:
    """Print a page; with `err` on stderr."""
    text = draw_page(content, sys.stderr if err else sys.stdout)
    if err:
        say(text)
    else:
        click.echo(text)


def draw_page(content: RenderableType, stream: IO[str]) -> str:
    """Render a page for a stream: for a terminal in its width and colours, for a file as plain text."""
    from rich.console import Console

    terminal = stream.isatty()
    page = io.StringIO()
    width = min(max(_columns(), MIN_WIDTH), MAX_WIDTH) if terminal else WIDTH
    console = Console(file=page, width=width, force_terminal=terminal and _has_colours(), highlight=False, emoji=False)
    console.print(content, markup=False, crop=False)
    return "\n".join(line.rstrip() for line in page.getvalue().splitlines())


def _columns() -> int:
    """Width of the terminal, in characters."""
    import shutil

    return shutil.get_terminal_size((WIDTH, 24)).columns


def json_value(value: object) -> object:
    """Convert a result to JSON values: tuples and arrays to lists, numbers that are not finite to null.

    >>> json_value({"axes": ("x",), "worst": float("inf")})
    {'axes': ['x'], 'worst': None}
    """
    if isinstance(value, dict):
        return {str(key): json_value(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(member) for member in value]
    if hasattr(value, "tolist"):
        return json_value(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[int, int | None], None] | None]:
    """Show a progress bar on a terminal while a long file is read.

    Yields a function that takes the bytes read and the total bytes; None if stderr is not a terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    with contextlib.ExitStack() as stack:
        bar: Callable[[int, int], None] | None = None

        def update(done: int, total: int | None) -> None:
            nonlocal bar
            if bar is None and (total or done) >= MIN_BYTES_FOR_BAR:
                bar = stack.enter_context(_bar(title))
            if bar is not None:
                bar(done, total or done)

        yield update


@contextlib.contextmanager
def _bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on stderr, which disappears at the end."""
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(), transient=True) as shown:
        task = shown.add_task(title, total=None)
        yield lambda done, total: shown.update(task, completed=done, total=total)


@contextlib.contextmanager
def working() -> Iterator[Callable[[str], None] | None]:
    """Show the current step on a terminal. Yields a function that takes the step's name; None without a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with console().status("") as status:
        yield status.update


def console() -> Console:
    """The terminal of stderr, for progress displays."""
    from rich.console import Console

    return Console(stderr=True, color_system="auto" if _has_colours() else None)


def _has_colours() -> bool:
    """Whether the terminal has colours and NO_COLOR is not set."""
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


class Output(NamedTuple):
    """An output file: its content in words, its path (``-`` is standard output), and the option that names it."""

    what: str
    path: str | None
    option: str = "-o"


@dataclass(frozen=True, slots=True)
class Outputs:
    """The output files of a command."""

    files: tuple[Output, ...]  # a file without a path is not written
    force: bool = False  # overwrite existing files
    as_json: bool = False  # print the result as JSON on standard output

    @classmethod
    def of(cls, *files: tuple[str, str | None], force: bool = False, as_json: bool = False) -> Outputs:
        """Make the outputs from pairs of content in words and path."""
        return cls(tuple(Output(*each) for each in files), force, as_json)

    @property
    def is_printed(self) -> bool:
        """Whether one of the files goes to standard output."""
        return any(file.path == "-" for file in self.files)

    def check(self, inputs: Iterable[str] = ()) -> None:
        """Refuse outputs that cannot be written, before any work is done."""
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
                raise UsageError(f"{path} is named for {other} and for {what}: give two different names")
            named[Path(path).resolve()] = what

    def write(self, content: str | bytes, path: str | None) -> None:
        """Write text or bytes to one of the files, completely or not at all. Bytes are never written to a terminal."""
        from flinders.core.files import write_bytes, write_text

        if path == "-" and isinstance(content, bytes) and sys.stdout.isatty():
            raise UsageError(f"the output is {len(content)} bytes of binary data: name a file with -o")
        if path == "-":
            click.echo(content, nl=False)
        elif path and isinstance(content, bytes):
            write_bytes(content, path, force=self.force)
        elif path:
            write_text(str(content), path, force=self.force)

    def print(self, fields: Callable[[], dict[str, Any]], page: Callable[[], RenderableType]) -> None:
        """Print a result by `print_result`; its page goes to stderr if a file goes to standard output."""
        print_result(fields, page, as_json=self.as_json, err=self.is_printed)

    def show(self, content: RenderableType) -> None:
        """Print a page; it goes to stderr if a file goes to standard output."""
        show(content, err=self.is_printed)

    def say_written(self, nothing: str = "") -> None:
        """Print the names of the written files; print `nothing` instead if the first file has no path."""
        for place, file in enumerate(self.files):
            if file.path and file.path != "-":
                say(phrase("next.written", "written to {file}", file=file.path))
            elif not file.path and place == 0 and nothing:
                say(nothing)


def refuse_to_overwrite(output: str, inputs: Iterable[str]) -> None:
    """Refuse an output file that is also an input, even with ``--force`` or by redirection with ``>``."""
    target = _identity(sys.stdout if output == "-" else output)
    for path in inputs:
        if path != "-" and target is not None and target == _identity(path):
            raise UsageError(f"{path} is an input and would be overwritten: name another file for the output")


def refuse_twice(paths: Iterable[str]) -> None:
    """Refuse a recording that is given twice: readings counted twice would understate the error."""
    seen = set()
    for path in paths:
        file = path if path == "-" else _identity(path)
        if file is not None and file in seen:
            raise UsageError(f"{'standard input' if path == '-' else path} is given twice: name each recording once")
        seen.add(file)


def _identity(file: str | IO[str]) -> tuple[int, int] | None:
    """Device and inode of the regular file at a path or behind a stream; None for anything else."""
    try:
        status = Path(file).stat() if isinstance(file, str) else os.fstat(file.fileno())
    except (OSError, ValueError):
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISREG(status.st_mode) else None


@contextlib.contextmanager
def open_output(path: str, *, force: bool, live: bool, encoding: str = "utf-8") -> Iterator[IO[str]]:
    """Open an output: a file that appears when it is complete, or standard output.

    Standard output is flushed after each line if `live`.

    """
    from flinders.core.files import open_atomically

    if path != "-":
        with open_atomically(path, force=force, encoding=encoding, newline="") as file:
            yield file
        return
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(encoding=encoding, newline="", line_buffering=live)
    yield sys.stdout
    sys.stdout.flush()


def refuse_report(path: str | None, option: str) -> None:
    """Refuse a report file whose suffix is not that of HTML."""
    if path == "-":
        raise UsageError(f"{option} -: a report is a megabyte of HTML, name a file such as report.html")
    if path is not None and Path(path).suffix.lower() == ".pdf":
        raise UsageError(
            f"{option} {path}: a report is HTML; for PDF use flinders report CALIBRATION RECORDING --pdf {path}"
        )


def aiding_lines(aiding: Aiding | None, findings: Iterable[Finding]) -> list[str]:
    r"""Lines about the effects of the aiding sensors, one for each; empty without aiding sensors.

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
            else f"{aid.name} was left out{', as stated above' if (aid.name, aid.code) in said else f': {aid.reason}'}"
        )
    if aiding.acceleration_bias is not None and aiding.acceleration_bias_sigma is not None:
        x, y, z = (f"{value:.3f}" for value in aiding.acceleration_bias_sigma)
        lines.append(
            f"{bias_words(aiding.acceleration_bias)} (1 σ: {x}, {y}, {z}); it is stored in the calibration file, and "
            "flinders heading uses it"
        )
    return lines


def bias_words(bias: Iterable[float]) -> str:
    """Words for the bias of an accelerometer.

    >>> bias_words([0.1784, -0.3, 0.0])
    'the accelerometer reads 0.178, −0.300 and 0.000 m/s² too much along x, y and z'
    """
    x, y, z = (f"{round(value, 3) + 0.0:.3f}".replace("-", "−") for value in bias)
    return f"the accelerometer reads {x}, {y} and {z} m/s² too much along x, y and z"


def plot_fit(fit: Fit, recording: Recording, *, err: bool = False) -> None:
    """Draw a fit with characters in a few lines, if the output is a terminal that can show them."""
    stream = sys.stderr if err else sys.stdout
    if not stream.isatty() or os.environ.get("TERM") == "dumb":
        return
    from flinders.report.figure_data import FigureData
    from flinders.report.terminal import REQUIRED_LETTERS, plot

    is_plain = not can_show(stream.encoding or "ascii", REQUIRED_LETTERS)
    click.echo("", err=err)
    click.echo(
        draw_page(plot(FigureData.of(fit, recording), fit, is_plain=is_plain, width=_columns()), stream), err=err
    )


def can_show(encoding: str, text: str) -> bool:
    """Whether an encoding contains all characters of a text.

    >>> can_show("utf-8", "⣿█"), can_show("latin-1", "⣿█"), can_show("no such", "a")
    (True, False, False)
    """
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def strength_words(calibration: Calibration, what: str = "a nominal value") -> str:
    """Notice that an imported calibration states no field strength, with the option to set it."""
    strength = f"{figures(calibration.field_strength, 4)} {unit_label(calibration.unit)}"
    return f"! field strength {strength} is {what}: give --field-strength if vector lengths matter"


def cost_words(calibration: Calibration, disturbance: Disturbance) -> str:
    """Words for the heading error, at a dip of 60°, if a disturbance at the far end of its range is ignored."""
    cost = figures(min(calibration.disturbance_deg(disturbance), 180.0))
    return f"up to {cost}° of heading at {disturbance.text_of(disturbance.extreme_value)}"


def say_references(fit: Fit) -> None:
    """Print the fixed values of a calibration's disturbances, for a command that ignores disturbances."""
    for disturbance in fit.calibration.disturbances:
        say(
            f"{fit.provenance.name} corrects for {disturbance.name}: it is used at "
            f"{disturbance.text_of(disturbance.reference)}; the effect of {disturbance.name} is "
            f"{cost_words(fit.calibration, disturbance)}"
        )


def say_difference(a: Fit, b: Fit) -> None:
    """Print the disturbances of two compared calibrations, and the difference of their effects."""
    for fit in (a, b):
        say_references(fit)
    theirs = {disturbance.name: disturbance for disturbance in b.calibration.disturbances}
    for disturbance in a.calibration.disturbances:
        if other := theirs.get(disturbance.name):
            between = replace(disturbance, per_unit=other.per_unit - disturbance.per_unit)
            say(f"the effects of {disturbance.name} differ by {cost_words(a.calibration, between)}")


def say_preparation(preparation: Preparation) -> None:
    """Print the effect of a filter, and warn of disturbances outside their calibrated range."""
    if preparation.smoother is not None:
        say(str(preparation.smoother))
    for finding in preparation.findings():
        say(f"! {finding.advice}")


def is_asked() -> bool:
    """Whether stdin and stderr are a terminal, on which the user can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def lossy_if_agreed(attempt: Callable[[bool], T], *, lossy: bool) -> T:
    """Run an export without loss; if it is refused because of a loss, ask on a terminal whether to accept the loss."""
    try:
        return attempt(lossy)
    except NotExportable as refused:
        if lossy or "heading_deg" not in refused.evidence or not is_asked():
            raise
        say(f"! {error_words(refused)}")
        if not click.confirm("Do it anyway?", err=True):
            raise
    return attempt(True)
