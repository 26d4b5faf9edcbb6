"""What a shell completes: commands, options, files, targets, methods."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from tests.trials import daily


def completed(words: str) -> list[str]:
    """Answers of the program to a shell whose cursor is behind the last of these words."""
    environment = {"_FLINDERS_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    return subprocess.run(
        [sys.executable, "-c", "from flinders.cli import main; main(prog_name='flinders')"],
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        encoding="utf-8",
    ).stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    daily(
        [
            ("flinders eva", ["plain,evaluate"]),
            ("flinders export --los", ["plain,--lossy"]),
            ("flinders export --for c-", ["plain,c-q15", "plain,c-q31"]),
            ("flinders calibrate --method like", ["plain,likelihood"]),
            ("flinders calibrate tum", ["file,tum"]),
            ("flinders calibrate tumble.csv -o cal", ["file,cal"]),
            ("flinders calibrate --method cons", ["plain,consistent"]),
        ],
        3,
    ),
)
def test_a_shell_completes(words: str, expected: list[str]) -> None:
    assert completed(words) == expected
