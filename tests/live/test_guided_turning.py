"""Who follows the planned path is done with much less turning (`benchmarks.guidance`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.guidance import TARGET_DEG, until_done

if TYPE_CHECKING:
    from tests.trials import Choose


@pytest.mark.nightly
def test_following_the_way_takes_less_than_seven_tenths_of_the_turning(trials: Choose) -> None:
    claim = trials(8, 2)
    followed = [until_done("route", 0.5, seed) for seed in claim.seeds]
    tumbled = [until_done("chance", 0.5, seed) for seed in claim.seeds]
    assert np.median([one.turned_deg for one in followed]) < 0.7 ** (1.0 / claim.widening) * np.median(
        [one.turned_deg for one in tumbled]
    )
    assert np.median([one.seconds for one in followed]) < 0.75 ** (1.0 / claim.widening) * np.median(
        [one.seconds for one in tumbled]
    )
    assert np.median([one.true_worst_deg for one in followed]) < 1.5**claim.widening * TARGET_DEG


@pytest.mark.nightly
def test_a_hand_that_strays_still_gets_there_sooner_than_chance(trials: Choose) -> None:
    claim = trials(8, 2)
    followed = [until_done("route", 0.5, seed, stray_deg=20.0).turned_deg for seed in claim.seeds]
    tumbled = [until_done("chance", 0.5, seed).turned_deg for seed in claim.seeds]
    assert np.median(followed) < 0.85 ** (1.0 / claim.widening) * np.median(tumbled)
