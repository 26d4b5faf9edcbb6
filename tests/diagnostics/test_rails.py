"""The end of a sensor's range is told from coarse steps by how many readings its next value has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.worlds import judged

from flinders.core.samples import Samples
from flinders.native.engine import engine
from flinders.simulate import tumble
from flinders.summary.quality import DataQuality

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

STEPS = (0.15, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0)


def stepped(seed: int, step: float) -> Floats:
    """A tumble by hand in steps, µT."""
    field: Floats = step * np.round(np.asarray(tumble(seed=seed, n=1500).samples.field) / step)
    return field


def cut_off(field: Floats, share: float) -> Floats:
    """The same with so large a share of x at its upper limit."""
    limited = field.copy()
    limited[:, 0] = np.minimum(field[:, 0], np.quantile(field[:, 0], 1.0 - share, method="nearest"))
    return limited


@pytest.mark.nightly
def test_coarse_steps_are_not_saturated(trials: Choose) -> None:
    """Of 1,000 turns in every step."""
    chosen = trials(1000, 20)
    called = [bool(engine().fit(stepped(seed, step))["rails"]) for seed in chosen.seeds for step in STEPS]
    assert np.mean(called) < 0.01 * chosen.widening


@pytest.mark.nightly
@pytest.mark.parametrize(("share", "power"), [(0.03, 0.5), (0.1, 0.95)])
def test_a_range_that_is_too_small_is_saturated(share: float, power: float, trials: Choose) -> None:
    """In steps as real sensors have them."""
    chosen = trials(1000, 20)
    called = [
        bool(engine().fit(cut_off(stepped(seed, step), share))["rails"])
        for seed in chosen.seeds
        for step in (0.15, 0.5)
    ]
    assert np.mean(called) > power - 0.05 * chosen.widening


def test_coarse_steps_are_noted_and_the_fit_is_good() -> None:
    fit = judged(Samples.of(stepped(1, 3.0), unit="uT"))
    found = next(finding for finding in fit.findings if finding.code == "quantised")
    assert (fit.verdict, found.severity, found.number) == ("good", "note", 3.0)


def test_an_overflow_far_off_is_saturated() -> None:
    """A driver writes a value that no reading has where its axis is beyond the range."""
    field = stepped(3, 0.15)
    overflows = field[:, 0] > np.quantile(field[:, 0], 0.9)
    field[overflows, 0] = -4096.0
    assert [rail.value for rail in DataQuality.of(Samples.of(field)).rails] == [-4096.0]
