"""How the program ends: one table of exit codes, and no traceback for bad input."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import threading
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _aids
from flinders.cli._talk import print_fit, print_json, say
from flinders.core.files import reason
from flinders.errors import FitError, FlindersError, OutputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

GOOD, USAGE, LIMITED, REFUSED, UNREADABLE, UNWRITABLE, INTERNAL, INTERRUPTED = 0, 2, 3, 4, 5, 6, 70, 130

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

FIT_KEYS: Final = ("verdict", "method", "calibration", "heading_error_deg", "noise", "coverage", "findings")
"""What every result of ``calibrate --json`` has."""


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
        _make_streams_forgiving()
        try:
            with _stopped_cleanly():
                code = super().main(words, prog_name, complete_var, standalone_mode=False, **extra)
        except click.ClickException as error:
            code = _misused(error, as_json=as_json)
        except (click.Abort, KeyboardInterrupt):
            say("interrupted")
            code = INTERRUPTED
        except FlindersError as error:
            code = told(error, as_json=as_json)
        except SystemExit as end:  # 1 is how click ends when whoever read our output has gone
            code = UNWRITABLE if end.code == 1 else end.code
        except OSError as error:
            code = told(OutputError(f"output cannot be written: {reason(error)}"), as_json=False)
            _silence_stdout()
        except Exception as error:  # noqa: BLE001 - the one place that turns a fault of ours into a report
            code = _confessed(error)
        code = code if isinstance(code, int) else GOOD
        return sys.exit(code) if standalone_mode else code


def told(error: FlindersError, *, as_json: bool, beside: Mapping[str, Any] | None = None) -> int:
    """Print an error in a line, a refused fit as a page, and either in full as JSON where that was asked for.

    `beside`: what else the JSON is to hold.
    """
    fit = getattr(error, "fit", None)
    if fit is not None and not as_json:
        print_fit(fit, err=True)
        for line in _aids.told(fit).splitlines():
            say(line)
    else:
        message = " ".join(str(error).splitlines())
        say(f"{'refused' if error.exit_code == REFUSED else 'error'}: {message}")
    if as_json:
        with contextlib.suppress(OSError):
            print_json({**_as_dict(error), **(beside or {})})
    return error.exit_code


def _as_dict(error: FlindersError) -> dict[str, Any]:
    """The error as a result: a refusal has the keys of a fit, with null where there is none."""
    about: dict[str, Any] = {"code": error.code, "message": str(error), "exit_code": error.exit_code}
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
    found = " ".join(message.split()).rstrip(".")
    return told(UsageError(f"{found}; see {context.command_path if context else 'flinders'} --help"), as_json=as_json)


def _confessed(error: Exception) -> int:
    """Say that the fault is ours, keep the details in a file, and ask for a report."""
    import platform
    import tempfile
    import traceback
    from importlib.metadata import version

    about = f"flinders {version('flinders')}, Python {platform.python_version()}, {platform.platform()}\n\n"
    details = about + "".join(traceback.format_exception(error))
    say(f"internal error: {type(error).__name__}: {error}")
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="flinders-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(details)
        what = file.name
    except OSError:
        say(details)
        what = "the lines above"
    say(f"This is a fault in Flinders, not in your recording. Please report it with {what}")
    return INTERNAL


@contextlib.contextmanager
def _stopped_cleanly() -> Iterator[None]:
    """Let those who end a program from outside (kill, timeout, a closed terminal) leave as little behind as Ctrl-C."""
    names = [name for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        names = []
    before = {name: signal.signal(getattr(signal, name), signal.default_int_handler) for name in names}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)


def _make_streams_forgiving() -> None:
    """Print "?" for a letter that a terminal does not have, such as σ, and nothing where a stream is closed."""
    sys.stdout = sys.stdout or io.TextIOWrapper(io.BytesIO())
    sys.stderr = sys.stderr or io.TextIOWrapper(io.BytesIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _silence_stdout() -> None:
    """What could not be written will not be tried again at exit: let the interpreter flush into nothing."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
