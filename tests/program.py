"""The program, run inside the process of a test, with its exit code and output."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from click.testing import CliRunner

from flinders.cli import main

if TYPE_CHECKING:
    from flinders.arrays import Floats


@dataclass(frozen=True)
class Ended:
    """Exit code and output of the program."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:  # noqa: ANN401 - whatever was printed
        return json.loads(self.out)

    @property
    def said(self) -> str:
        """Everything on stderr, in one line."""
        return " ".join(self.err.split())

    @property
    def columns(self) -> dict[str, Floats]:
        rows = list(csv.reader(io.StringIO(self.out)))
        return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


def flinders_(*words: str, stdin: str | bytes = b"") -> Ended:
    """Run a command line within this process."""
    result = CliRunner().invoke(main, list(words), input=stdin)
    return Ended(result.exit_code, result.stdout, result.stderr)
