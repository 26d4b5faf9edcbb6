"""The program: commands that are imported when they are called, exit codes, no traceback for bad input."""

from __future__ import annotations

import atexit
import contextlib
import gc
import io
import os
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli._output import in_options, print_fit, print_json, say
from flinders.cli._signals import ENDING, INTERRUPTED, handled, interrupt
from flinders.core.files import reason
from flinders.errors import FitError, FlindersError, OutputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.findings import Verdict

GOOD, USAGE, LIMITED, REFUSED, UNREADABLE, UNWRITABLE, INTERNAL = 0, 2, 3, 4, 5, 6, 70

EXIT_CODES: Final = {
    GOOD: "good",
    USAGE: "usage: an option or argument cannot be used",
    LIMITED: "limited: written, with what it is good for and what not",
    REFUSED: "refused: nothing written, says why and how to move the sensor",
    UNREADABLE: "unreadable input",
    UNWRITABLE: "output cannot be written",
    INTERNAL: "internal error: please report it",
    INTERRUPTED: "interrupted",
}

EXITS: Final[dict[Verdict, int]] = {"good": GOOD, "limited": LIMITED, "refused": REFUSED}
"""How a command ends by its verdict."""

FIT_KEYS: Final = ("verdict", "method", "calibration", "heading_error_deg", "noise", "coverage", "findings")
"""What every result of ``calibrate --json`` has."""


def show_versions(context: click.Context, _option: click.Parameter, is_asked: bool) -> None:
    """Print the versions and end the program."""
    if is_asked and not context.resilient_parsing:
        from flinders.cli._version import versions

        click.echo(versions())
        context.exit()


class Commands(Mapping[str, "click.Command"]):
    """Commands by name, each the ``command`` of a module of its own beside this one, imported when it is asked for.

    `modules`: ``two_axis`` holds ``two-axis``; a name that Python keeps for itself ends with an underscore.

    >>> commands = Commands("info", "import_", "two_axis")
    >>> list(commands), commands["two-axis"].name
    (['info', 'import', 'two-axis'], 'two-axis')
    """

    def __init__(self, *modules: str) -> None:
        self._modules = {module.rstrip("_").replace("_", "-"): module for module in modules}

    def __getitem__(self, name: str) -> click.Command:
        command: click.Command = import_module(f"flinders.cli.{self._modules[name]}").command
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)


class Program(click.Group):
    """A group of commands that ends with a code of the table, whatever happens."""

    def main(  # type: ignore[override]  # click's overloads only tell what `standalone_mode` does
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: object,
    ) -> int:
        """Run a command line and exit; without `standalone_mode`, return the code."""
        words = list(sys.argv[1:] if args is None else args)
        as_json = "--json" in words[: words.index("--") if "--" in words else None]
        try:
            if args is None:
                _let_imports_be()
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of such small matrices, threads would wait
            _prepare_streams()
            with handled(interrupt, *ENDING):
                code = super().main(words, prog_name, complete_var, standalone_mode=False, **extra)
        except click.ClickException as error:
            code = _misused(error, as_json=as_json)
        except (click.Abort, KeyboardInterrupt):
            say("interrupted")
            code = INTERRUPTED
        except FlindersError as error:
            code = print_error(error, as_json=as_json)
        except SystemExit as end:  # 1 is how click ends when whoever read our output has gone
            code = UNWRITABLE if end.code == 1 else end.code
        except OSError as error:
            code = print_error(OutputError(f"output cannot be written: {reason(error)}"), as_json=False)
            _silence_stdout()
        except Exception as error:  # noqa: BLE001 - the one place that turns a fault of ours into a report
            code = _report_fault(error)
        code = code if isinstance(code, int) else GOOD
        return sys.exit(code) if standalone_mode else code


def print_error(error: FlindersError, *, as_json: bool, more: Mapping[str, Any] | None = None) -> int:
    """Print an error in a line, a refused fit as a page, and either in full as JSON where that was asked for.

    `more`: what else the JSON is to hold.
    """
    fit = getattr(error, "fit", None)
    if fit is not None and not as_json:
        print_fit(fit, err=True)
    else:
        message = " ".join(str(error).splitlines())
        say(f"{'refused' if error.exit_code == REFUSED else 'error'}: {message}")
    if as_json:
        with contextlib.suppress(OSError):
            print_json({**_as_dict(error), **(more or {})})
    return error.exit_code


def _as_dict(error: FlindersError) -> dict[str, Any]:
    """The error as a result: a refusal has the keys of a fit, with null where there is none."""
    about: dict[str, Any] = {"code": error.code, "message": in_options(str(error)), "exit_code": error.exit_code}
    if not isinstance(error, FitError):
        evidence = getattr(error, "evidence", None)
        return {"error": about if evidence is None else {**about, "evidence": dict(evidence)}}
    fit = getattr(error, "fit", None)
    fields = fit.as_dict() if fit else {**dict.fromkeys(FIT_KEYS), "verdict": "refused", "findings": []}
    return {**fields, "error": {**about, "evidence": dict(error.evidence)}}


def _misused(error: click.ClickException, *, as_json: bool) -> int:
    """Say what click found, and where help is; or give help, where only the name of the program was typed."""
    message = error.format_message()
    if message.startswith("Usage:"):
        say(message)
        return USAGE
    context = getattr(error, "ctx", None)
    problem = " ".join(message.split()).rstrip(".")
    return print_error(
        UsageError(f"{problem}; see {context.command_path if context else 'flinders'} --help"), as_json=as_json
    )


def _report_fault(error: Exception) -> int:
    """Say that the fault is ours, keep the details in a file, and ask for a report."""
    import platform
    import tempfile
    import traceback
    from importlib.metadata import version

    about = f"flinders {version('flinders')}, Python {platform.python_version()}, {platform.platform()}\n\n"
    details = about + "".join(traceback.format_exception(error))
    say(f"internal error: {type(error).__name__}: {error}")
    where = "the lines above"
    try:
        with tempfile.NamedTemporaryFile(prefix="flinders-", suffix=".txt", delete=False) as file:
            file.write(details.encode())
            where = file.name
    except (OSError, ValueError):
        say(details)
    say(f"This is a fault in Flinders, not in your recording. Please report it with {where}")
    return INTERNAL


def _let_imports_be() -> None:
    """Keep the garbage collector from what imports made: looking through it was a sixth of a short command."""
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)


def _prepare_streams() -> None:
    """Print "?" for a letter that a terminal does not have, such as σ, and no talk where stderr is closed.

    Results that go to a closed stdout are lost, and writing them fails: at a descriptor that is open for reading alone.
    """
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_RDONLY), "w")
    sys.stderr = sys.stderr or io.TextIOWrapper(io.BytesIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _silence_stdout() -> None:
    """What could not be written will not be tried again at exit: let the interpreter flush into nothing."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
