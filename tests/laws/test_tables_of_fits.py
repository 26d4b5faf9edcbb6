"""Two tables of fits differ where something moved by more than a hundredth of a standard deviation."""

from __future__ import annotations

import copy
import json
from typing import TYPE_CHECKING, Any

import pytest
from benchmarks.fits import compare, differences, numbers_of
from tests.sentences import assert_sentences

import flinders
from flinders import simulate

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def row() -> dict[str, Any]:
    return {"recording": "hand 1", "method": "auto", **numbers_of(flinders.fit(simulate.tumble(seed=1, n=600).samples))}


def test_equal_rows_have_no_differences(row: dict[str, Any]) -> None:
    assert differences(row, copy.deepcopy(row)) == []


@pytest.mark.parametrize("share", [0.5, 2.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_step_of_the_offset_counts_from_a_hundredth_of_sigma_on(row: dict[str, Any], axis: int, share: float) -> None:
    moved = copy.deepcopy(row)
    moved["offset"][axis] += share * 0.01 * row["covariance"][axis][axis] ** 0.5
    assert bool(differences(row, moved)) == (share > 1.0)


@pytest.mark.parametrize("name", ["matrix", "covariance"])
def test_a_step_of_any_entry_is_seen(row: dict[str, Any], name: str) -> None:
    moved = copy.deepcopy(row)
    moved[name][1][1] *= 1.05
    assert [words.partition(" ")[0] for words in differences(row, moved)] == [name]


@pytest.mark.parametrize(
    "name", ["noise", "field_strength", "heading_rms_deg", "heading_worst_deg", "textbook_worst_deg"]
)
def test_two_percent_of_any_other_number_are_seen(row: dict[str, Any], name: str) -> None:
    assert differences(row, {**row, name: 1.02 * row[name]})[0].startswith(name)
    assert not any(words.startswith(name) for words in differences(row, {**row, name: 1.005 * row[name]}))


def test_another_verdict_another_finding_and_an_error_are_seen(row: dict[str, Any]) -> None:
    assert_sentences(differences(row, {**row, "verdict": "limited"}))
    assert len(differences(row, {**row, "findings": [*row["findings"], "noise: limits"]})) == 1
    assert_sentences(differences(row, {"error": "too-few-samples"}))


def test_a_fit_that_is_gone_is_a_difference(
    row: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = tmp_path / "old.jsonl", tmp_path / "new.jsonl"
    old.write_text(json.dumps(row) + "\n" + json.dumps({**row, "method": "likelihood"}) + "\n")
    new.write_text(json.dumps(row) + "\n")
    assert compare(old, old) == 0
    assert compare(old, new) == 1
    assert_sentences(capsys.readouterr().out)
