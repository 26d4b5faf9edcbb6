"""All methods side by side: what each is worth, and who may not be believed on this recording."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences

from flinders import simulate
from flinders.apps.classic.methods import Contest, compare_methods
from flinders.cli import main
from flinders.comparison.cross_validation import Validation
from flinders.errors import FitError, NeedsSamples, TooFewSamples, UsageError
from flinders.estimators import METHODS
from flinders.heading.error_propagation import HeadingError
from flinders.summary.summary import Summary

TUMBLE = simulate.tumble(seed=5, n=1000, motion="uniform")


@pytest.fixture(scope="module")
def everything() -> Contest:
    return compare_methods(TUMBLE.samples)


def run(*words: str, stdin: str = "") -> tuple[int, str, str]:
    found = CliRunner().invoke(main, ["compare-methods", *words], input=stdin)
    return found.exit_code, found.stdout, found.stderr


@pytest.fixture
def tumble(tmp_path: Path) -> str:
    path = tmp_path / "tumble.csv"
    rows = (",".join(f"{value:.4f}" for value in row) for row in TUMBLE.samples.field)
    path.write_text("\n".join(["mx_uT,my_uT,mz_uT", *rows]) + "\n", encoding="utf-8")
    return str(path)


def test_every_method_takes_part(everything: Contest) -> None:
    assert [entry.method for entry in everything.entries] == list(METHODS)
    assert everything.verdict == "good"
    for entry in everything.entries:
        assert entry.fit is not None or entry.refusal is not None
        assert entry.verdict == "good" or entry.reasons
        assert len(entry.reasons) == len(entry.codes)


def test_whoever_is_said_to_be_good_is_right(everything: Contest) -> None:
    from benchmarks.datasets import heading_error_deg

    for entry in everything.entries:
        if entry.fit is not None and entry.verdict == "good":
            found = entry.fit.calibration
            assert heading_error_deg(found.matrix, found.offset, TUMBLE) < 3 * entry.fit.heading_error_deg.worst < 1.5


def test_the_simple_recipes_are_told_what_they_cost(everything: Contest) -> None:
    cost = {entry.method: entry.difference_deg.rms for entry in everything.entries if entry.difference_deg is not None}
    assert "auto" not in cost
    assert cost["likelihood"] < 1e-6
    assert min(cost["sphere"], cost["minmax"], cost["axes"]) > 2.0


def test_a_claim_that_readings_held_back_deny_is_no_good_verdict(everything: Contest) -> None:
    entry = everything.entries[0]
    assert entry.fit is not None
    shown = HeadingError(rms=3.0, worst=4.0, dip_deg=60.0)
    denied = replace(entry, validation=Validation(shown, bias_deg=3.0, scatter_deg=0.1, misfit=1.0, blocks=10))
    assert (entry.verdict, denied.verdict) == ("good", "limited")
    assert denied.codes == ("overclaims",)
    assert_sentences(denied.reasons[-1])


def test_closed_forms_allow_for_residuals_that_hang_together(everything: Contest) -> None:
    """Each claims what the likelihood claims, on a tumble whose offset wanders."""
    tumble = simulate.tumble(seed=4, n=3000)
    drifting = np.cumsum(np.random.default_rng(1).normal(size=(3000, 3)), axis=0) * 0.02
    contest = compare_methods(tumble.samples.field + drifting, methods=["auto", "consistent", "algebraic"])
    claimed = [entry.fit.heading_error_deg.rms for entry in contest.entries if entry.fit is not None]
    assert min(claimed) / max(claimed) > 0.8
    assert not any(entry.overclaims for entry in contest.entries)


def test_too_few_readings_for_blocks_are_compared_without() -> None:
    contest = compare_methods(TUMBLE.samples.field[:7], methods=["sphere", "minmax"])
    assert contest.blocks == 0
    assert all(entry.validation is None for entry in contest.entries)


def test_a_data_frame_is_compared_as_its_readings() -> None:
    methods = ["auto", "sphere"]
    of_frame, of_samples = (
        compare_methods(each, methods=methods) for each in (TUMBLE.samples.as_columns(), TUMBLE.samples)
    )
    assert [each.difference_deg for each in of_frame] == [each.difference_deg for each in of_samples]
    assert [each.validation for each in of_frame] == [each.validation for each in of_samples]


def test_where_no_method_gives_anything_the_first_says_why() -> None:
    with pytest.raises(TooFewSamples):
        compare_methods(TUMBLE.samples.field[:3])


def test_sums_are_not_enough() -> None:
    with pytest.raises(NeedsSamples):
        compare_methods(Summary.of(TUMBLE.samples))


@pytest.mark.parametrize("methods", [["foo"], ["auto", "auto"], []])
def test_methods_that_cannot_be_compared_are_refused(methods: list[str]) -> None:
    with pytest.raises(UsageError):
        compare_methods(TUMBLE.samples, methods=methods)


def test_the_program_prints_each_method_and_ends_as_the_best_of_them(tumble: str) -> None:
    code, out, _ = run(tumble, "--methods", "auto, sphere")
    assert code == 0
    assert out.count("auto") >= 2
    assert "✗ sphere" in out
    assert run(tumble, "--methods", "sphere")[0] == 4


def test_json_has_what_the_page_has(tumble: str) -> None:
    code, out, _ = run(tumble, "--methods", "auto,minmax", "--json")
    told: dict[str, Any] = json.loads(out)
    assert code == 0
    first, second = told["methods"]
    assert first["difference_deg"] is None
    assert second["difference_deg"]["rms"] > 1.0
    assert set(first) == set(second)
    np.testing.assert_allclose(first["offset"], TUMBLE.sensor.offset, atol=0.3)


def test_a_recording_may_be_piped_in(tumble: str) -> None:
    text = Path(tumble).read_text(encoding="utf-8")
    assert run("-", "--methods", "auto", stdin=text)[0] == 0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["nowhere.csv"], 5),
        (["{}", "{}"], 2),
        (["{}", "--methods", "best"], 2),
        (["{}", "--methods", ","], 2),
        (["{}", "--blocks", "1"], 2),
        ([], 2),
    ],
)
def test_what_cannot_work_is_said_in_a_line(tumble: str, words: list[str], code: int) -> None:
    found, out, err = run(*(word.format(tumble) for word in words))
    assert (found, out) == (code, "")
    assert "Traceback" not in err


def test_more_blocks_than_readings_are_as_many_as_there_are() -> None:
    contest = compare_methods(TUMBLE.samples.field[:44], methods=["sphere"], blocks=1000)
    assert contest.blocks == 11


def test_errors_are_of_one_tree() -> None:
    from flinders.comparison.cross_validation import NotValidated

    assert issubclass(NotValidated, FitError)
