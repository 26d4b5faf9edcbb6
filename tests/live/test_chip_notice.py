"""The notice of the live page on the chips whose counts a sensor sends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
from tests.sentences import assert_sentences

from flinders.apps.live.chip_notice import ChipNotice
from flinders.core.units import Unit

if TYPE_CHECKING:
    from flinders.apps.live.session_file import Log


def log_of(readings: int, unit: str = "counts", *, is_turned: bool = True) -> Log:
    """The memory of a session with an HMC5883L, of which only what a notice looks at."""
    directions = np.random.default_rng(5).normal(size=(readings, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    field = np.round(512.0 * (directions if is_turned else directions[:1]) + [90.0, -40.0, 10.0])
    buffer = SimpleNamespace(field=np.broadcast_to(field, (readings, 3)), total=readings)
    return cast("Log", SimpleNamespace(buffer=buffer, unit=Unit.of(unit)))


def test_the_proposal_is_told_once() -> None:
    notice = ChipNotice()
    assert notice.words(log_of(100)) == ""
    words = notice.words(log_of(400))
    assert "HMC5883L" in words
    assert_sentences(words)
    assert notice.words(log_of(2000)) == ""


def test_a_sensor_that_lies_still_is_looked_at_again_later() -> None:
    notice = ChipNotice()
    assert notice.words(log_of(400, is_turned=False)) == ""
    assert notice.words(log_of(700)) == ""
    assert "HMC5883L" in notice.words(log_of(900))


def test_readings_in_a_known_unit_have_no_notice() -> None:
    assert ChipNotice().words(log_of(400, "mG")) == ""
