"""A recording that is longer than memory: what a fit holds of it does not grow with its length."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import daily

import flinders
from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.estimators import Readings, data
from flinders.simulate import tumble

if TYPE_CHECKING:
    from collections.abc import Iterator

TUMBLE = tumble(seed=3, n=8192, motion="uniform").samples


@dataclass(frozen=True)
class Long:
    """So many blocks of a tumble that goes on and on, made as they are asked for; some readings are strays."""

    count: int
    outliers: float = 0.0
    source = "a long recording"
    unit = Unit.of("uT")
    axes = Axes()

    def blocks(self) -> Iterator[Samples]:
        """Make each block anew: who goes through it again sees the same."""
        for block in range(self.count):
            rng = np.random.default_rng(block)
            field = TUMBLE.field + rng.normal(scale=0.3, size=TUMBLE.field.shape)
            field[rng.random(len(field)) < self.outliers] += 40.0
            yield Samples(field, unit=self.unit, time=(block * 8192 + np.arange(8192)) / 50.0)


def peak_of(recording: Long) -> int:
    """Bytes that a fit holds at most."""
    tracemalloc.start()
    try:
        flinders.fit(recording)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("outliers", daily([0.01, 0.0]))
def test_memory_does_not_grow_with_the_recording(outliers: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data, "MAX_HELD_READINGS", 20_000)
    short, long = (peak_of(Long(blocks, outliers)) for blocks in (12, 36))
    assert long - short < 24 * 8192, "not one block more"


def test_a_part_of_a_recording_is_the_same_streamed_or_held() -> None:
    long = Long(9)
    whole = np.concatenate([block.field for block in long.blocks()])
    streamed = Readings(Readings.of(whole).summary, long).thin(20_000)
    np.testing.assert_array_equal(streamed, Readings.of(whole).thin(20_000))
