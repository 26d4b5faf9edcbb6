"""Mutated files of all formats, lines and packets: read or refused, by the library, by logs and on the page."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks import fuzz
from tests.sentences import assert_sentences
from tests.trials import nightly

if TYPE_CHECKING:
    from collections.abc import Callable


ROOT = Path(__file__).parents[1]


def fuzzed(*words: object) -> str:
    """Run the fuzzer as a program of its own, and return its last line."""
    command = [sys.executable, "-m", "benchmarks.fuzz", *map(str, words)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout.splitlines()[-1]


@pytest.mark.parametrize("inputs", [300, nightly(20_000)])
def test_mutated_samples_are_read_or_refused(inputs: int) -> None:
    """Of all formats, lines and packets: no other exception, no warning, no crash, 10 s of CPU and 300 MB at most."""
    assert f"{inputs:,} inputs, 0 findings" in fuzzed("--inputs", inputs, "--seed", 7)


@pytest.mark.parametrize("inputs", [100, nightly(2_000)])
def test_mutated_logs_of_vehicles_are_read_or_refused(inputs: int, recordings: Callable[[str], Path]) -> None:
    logs = ("dronekit_log171_3mags/log171.bin", "px4_pyulog_cubeorange/sample_log_small.ulg")
    assert f"{inputs:,} inputs, 0 findings" in fuzzed("--inputs", inputs, "--seed", 8, "--of", *map(recordings, logs))


@pytest.mark.parametrize("inputs", [50, nightly(2_000)])
def test_the_page_answers_whatever_is_dropped_on_it(inputs: int) -> None:
    assert f"{inputs:,} inputs, 0 findings" in fuzzed("--inputs", inputs, "--seed", 9, "--target", "page")


def test_the_fuzzer_sees_what_goes_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception, a warning, an end of the child, too much memory; and it cuts an input to what it needs."""

    def read(content: bytes, *_: object) -> None:
        match content[:1]:
            case b"e":
                raise KeyError("mag")
            case b"w":
                np.float64(np.inf) - np.float64(np.inf)
            case b"s":
                os.kill(os.getpid(), signal.SIGKILL)
            case b"m":
                bytearray(400 << 20)[::4096] = b"x" * (400 << 8)

    monkeypatch.setattr(fuzz, "read_file", read)
    inputs = [fuzz.Input("text", content) for content in (b"fine", b"e" + bytes(64), b"m", b"s", b"fine")]
    words = list(fuzz.in_child(inputs, "readers"))
    assert_sentences([each.partition(":")[0] for each in words])
    assert words[-1].endswith("SIGKILL")
    finding = fuzz.Finding(1, inputs[1], words[1])
    assert fuzz.minimised(finding, "readers").input.content == b"e"
