"""How the program ends: one table of exit codes, and no traceback for bad input."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import sys
import tempfile
import traceback
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.errors import FitError, FlindersError, OutputError

if TYPE_CHECKING:
    from collections.abc import Sequence

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


class Program(click.Group):
    """A group of commands that ends with a code of the table, whatever happens."""

    def main(self, args: Sequence[str] | None = None, prog_name: str | None = None, **extra: Any) -> Any:
        """Run a command line and exit."""
        words = list(sys.argv[1:] if args is None else args)
        extra["standalone_mode"] = False
        try:
            code = super().main(words, prog_name, **extra)
        except click.ClickException as error:
            error.show()
            code = USAGE
        except (click.Abort, KeyboardInterrupt):
            click.echo("interrupted", err=True)
            code = INTERRUPTED
        except FlindersError as error:
            code = _told(error, as_json="--json" in words)
        except BrokenPipeError:
            _silence_stdout()
            code = UNWRITABLE
        except OSError as error:
            code = _told(OutputError(f"output cannot be written: {error.strerror or error}"), as_json=False)
        except Exception as error:  # noqa: BLE001 - the one place that turns a fault of ours into a report
            code = _confessed(error)
        sys.exit(code if isinstance(code, int) else GOOD)


def _told(error: FlindersError, *, as_json: bool) -> int:
    """Print an error in a line, and in full as JSON where that was asked for."""
    message = str(error).replace("\n", " ")
    click.echo(f"{'refused' if isinstance(error, FitError) else 'error'}: {message}", err=True)
    if as_json:
        click.echo(json.dumps(_as_dict(error), default=str))
    return error.exit_code


def _as_dict(error: FlindersError) -> dict[str, Any]:
    """The error as a result: a refusal has the keys of a fit as far as there is one."""
    fields: dict[str, Any] = {"error": {"code": error.code, "message": str(error), "exit_code": error.exit_code}}
    if isinstance(error, FitError):
        fit = getattr(error, "fit", None)
        fields = {"verdict": "refused", "findings": [], **(fit.as_dict() if fit else {}), **fields}
        fields["error"]["evidence"] = dict(error.evidence)
    return fields


def _confessed(error: Exception) -> int:
    """Say that the fault is ours, keep the details in a file, and ask for a report."""
    details = "".join(traceback.format_exception(error))
    about = f"flinders {version('flinders')}, Python {platform.python_version()}, {platform.platform()}\n\n"
    with tempfile.NamedTemporaryFile("w", prefix="flinders-", suffix=".txt", delete=False, encoding="utf-8") as file:
        file.write(about + details)
    click.echo(
        f"internal error: {type(error).__name__}: {error}\n"
        f"This is a fault in Flinders, not in your recording. Please report it with {file.name}",
        err=True,
    )
    return INTERNAL


def _silence_stdout() -> None:
    """Whoever read our output has gone: let the interpreter flush into nothing."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
