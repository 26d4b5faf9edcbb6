"""No Python loop goes over readings: eight times as many take as many steps of the interpreter, but for blocks."""

from __future__ import annotations

import sys
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

import flinders
from flinders.core.calibration import Calibration
from flinders.simulate import tumble
from flinders.summary.cloud import Cloud
from flinders.summary.moments import Moments
from flinders.summary.quality import DataQuality
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import FrameType

    from _typeshed import TraceFunction

FEW, MANY = 8_192, 65_536
A_READING = 0.5
"""Steps of the interpreter for each more reading: work on a block of 8,192 takes some hundreds. A loop takes five."""


@cache
def recorded(count: int) -> flinders.Samples:
    """So many readings."""
    return tumble(seed=1, motion="uniform", n=count).samples


def steps_of(call: Callable[[], object]) -> int:
    """How many instructions of Python a call makes, those of NumPy's own Python code included."""
    count = 0

    def trace(frame: FrameType, event: str, _: object) -> TraceFunction:
        nonlocal count
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        count += event == "opcode"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


CALLS: dict[str, Callable[[flinders.Samples], object]] = {
    "moments": lambda samples: Moments.of(samples.field),
    "cloud": lambda samples: Cloud.of(samples.field, time=samples.time),
    "health": DataQuality.of,
    "summary": Summary.of,
    "correction": lambda samples: Calibration.from_ellipsoid(np.ones(3), 50.0 * np.eye(3)).apply(samples.field),
    "correction of a fit": lambda samples: flinders.fit(samples, method="consistent"),
    "fit": flinders.fit,
}


@pytest.mark.parametrize("name", CALLS)
def test_steps_do_not_grow_with_the_readings(name: str) -> None:
    """Sums, cells, counts and corrections."""
    few, many = recorded(FEW), recorded(MANY)
    CALLS[name](few)  # what is imported and cached once
    fewer, more = steps_of(partial(CALLS[name], few)), steps_of(partial(CALLS[name], many))
    assert more - fewer < A_READING * (MANY - FEW)


def test_steps_of_a_whole_fit_do_not_grow_with_the_readings() -> None:
    """How often a fit iterates depends on the readings, not on how many they are."""
    few, many = recorded(FEW), recorded(MANY)
    flinders.fit(few)
    assert steps_of(lambda: flinders.fit(many)) - steps_of(lambda: flinders.fit(few)) < A_READING * (MANY - FEW)


def test_steps_of_reading_parquet_do_not_grow_with_the_rows(tmp_path: Path) -> None:
    """A table is read a column and a block at a time."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    counts = []
    for rows in (FEW, MANY):
        path = tmp_path / f"{rows}.parquet"
        columns = zip("xyz", recorded(rows).field.T, strict=True)
        parquet.write_table(arrow.table({f"mag_{axis}_uT": column for axis, column in columns}), path)
        flinders.read(path)
        counts.append(steps_of(partial(flinders.read, path)))
    assert counts[1] - counts[0] < A_READING * (MANY - FEW)


def test_a_loop_would_be_seen() -> None:
    """The count is one of Python's steps: a loop over readings makes far more of them than is allowed."""
    assert steps_of(lambda: sum(row[0] for row in np.zeros((MANY - FEW, 3)))) > A_READING * (MANY - FEW)
