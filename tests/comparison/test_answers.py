"""Answers of `flinders.check` are true: calibrations that are off by a known angle, on recordings of all kinds."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import pytest
from benchmarks import answers

from flinders.native.engine import engine

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.native.faults import Answer


is_off = cache(answers.is_off)


def test_no_calibration_holds_beyond_the_target_and_few_fail_within(trials: Choose) -> None:
    claim = trials(200, 16)
    off, held = ([case(seed) for seed in claim.seeds] for case in (is_off, answers.holds))
    assert not [trial for trial in off + held if trial.answer == "holds" and trial.is_wrong]
    assert sum(trial.is_wrong for trial in held) <= 0.05 * claim.widening * claim.count
    assert {trial.answer for trial in off + held} == {"holds", "fails", "cannot-tell"}


def test_it_cannot_tell_only_where_the_claim_is_wider_than_what_would_tell() -> None:
    vague = [trial for trial in map(is_off, range(16)) if trial.telling_deg > 0.0]
    assert vague
    assert all(trial.bound_deg > trial.telling_deg for trial in vague)


@pytest.mark.parametrize(
    ("worst_deg", "sigma_deg", "bound_deg", "p_value", "answer"),
    [
        (0.5, 0.2, 0.5, 0.3, "holds"),
        (0.5, 0.2, 0.5, 1e-9, "holds"),  # it has changed, by less than the target
        (0.51, 0.2, 0.5, 0.3, "cannot-tell"),
        (1.4, 0.2, 0.5, 1e-9, "fails"),
        (1.3, 0.2, 0.5, 1e-9, "cannot-tell"),
        (1.4, 0.2, 0.5, 0.02, "cannot-tell"),
        (8.5, 9.0, 20.0, 0.5, "cannot-tell"),
        (1.0, 0.0, 0.0, float("nan"), "holds"),  # exact
        (1.1, 0.0, 0.0, float("nan"), "fails"),
        (0.5, float("nan"), float("nan"), float("nan"), "cannot-tell"),
    ],
)
def test_the_rule(worst_deg: float, sigma_deg: float, bound_deg: float, p_value: float, answer: Answer) -> None:
    found = engine().answer(worst_deg, sigma_deg=sigma_deg, bound_deg=bound_deg, p_value=p_value, target_deg=1.0)
    assert found == answer
