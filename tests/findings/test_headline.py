"""The first sentence of a verdict: it never contradicts it, whatever the numbers."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.trials import examples

import flinders
from flinders import errors, simulate
from flinders.cli._program import EXIT_CODES
from flinders.errors import FlindersError, UsageError
from flinders.findings import CATALOGUE, REFUSALS
from flinders.findings.finding import Finding
from flinders.findings.headline import LEADS, UNSTATED_REASON, Claimed, headline, reach_words
from flinders.findings.row import VERDICTS
from flinders.fitting.result import Refused, bare_fit
from flinders.fitting.verdict import headline_of
from flinders.verdicts import MEANINGS, Verdict

if TYPE_CHECKING:
    from flinders.fitting.result import Fit

LIMITING = sorted(
    code for code, row in CATALOGUE.items() if any(grade.severity == "limits" for grade in row.rule.grades)
)


@given(
    code=st.sampled_from(LIMITING),
    worst=st.floats(0.01, 40.0),
    target=st.floats(0.1, 10.0),
    limit=st.sampled_from([0.0, 17.0, 180.0]),
)
@examples(300)
def test_a_limited_verdict_does_not_call_a_heading_good_that_is_above_the_target(
    code: str, worst: float, target: float, limit: float
) -> None:
    assume(worst != target)
    claimed = Claimed(worst, 2.5 * worst, target)
    said = headline("limited", Finding(code, "limits", {}), claimed, limit)
    assert said.code == code
    assert not (worst > target and re.match("Good|Headings are good", said.words))
    assert not (worst < target and "above the target" in said.words)


@given(worst=st.floats(0.5, 5.0), target=st.sampled_from([0.5, 1.0, 2.0]))
@examples(300)
def test_a_number_above_the_target_is_not_written_like_the_target(worst: float, target: float) -> None:
    assume(worst > target * 1.002)
    said = headline("limited", Finding("heading-error", "limits", {}), Claimed(worst, 3.0 * worst, target), 0.0)
    shown, bar = re.search(r"off by ([\d.]+)°.*above the target of ([\d.]+)°", said.words).groups()  # type: ignore[union-attr]
    assert float(shown) > float(bar)


def test_where_no_tilt_is_known_level_headings_alone_are_claimed() -> None:
    assert reach_words(math.nan) == reach_words(0.0)


def test_an_imported_calibration_is_not_called_good() -> None:
    said = headline_of(bare_fit(flinders.Calibration.identity(field_strength=50.0)))
    assert (said.code, UNSTATED_REASON in said.words, "good to" in said.words) == ("", True, False)


def of(motion: str, **options: object) -> Fit:
    """A simulated fit, good, limited or refused."""
    try:
        return flinders.fit(simulate.tumble(seed=1, motion=motion, n=600).samples, **options)  # type: ignore[arg-type]
    except Refused as refusal:
        return refusal.fit


@pytest.mark.parametrize(
    ("fit", "verdict", "code"),
    [
        (lambda: of("uniform"), "good", ""),
        (
            lambda: of("level", axes="x,y,z", site=flinders.Site(inclination_deg=60.0, z_down=True)),
            "limited",
            "level-plane",
        ),
        (lambda: of("tilted"), "limited", "coverage"),
        (lambda: of("uniform", target_deg=0.01), "refused", "heading-error"),
    ],
    ids=["good", "level", "tilted", "refused"],
)
def test_a_headline_is_about_the_first_cause(fit: object, verdict: Verdict, code: str) -> None:
    made: Fit = fit()  # type: ignore[operator]
    assert (made.verdict, headline_of(made).code) == (verdict, code)


@pytest.mark.parametrize("code", CATALOGUE)
def test_each_finding_affects_something_that_a_headline_can_begin_with(code: str) -> None:
    assert CATALOGUE[code].affects in LEADS
    assert flinders.explain(code).meaning


def test_each_code_is_explained_and_another_one_is_guessed() -> None:
    for code in (*CATALOGUE, *REFUSALS):
        told = flinders.explain(code)
        assert told.action
        assert told.meaning
        assert told.code == code
    with pytest.raises(UsageError) as unknown:
        flinders.explain("covrage")
    assert "coverage" in unknown.value.message


def test_each_error_is_explained() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, FlindersError)]
    assert {kind.code for kind in kinds} - {FlindersError.code} <= REFUSALS.keys()


def test_verdicts_have_one_table_of_exit_codes() -> None:
    assert list(VERDICTS.values()) == ["refused", "limited", "good"]
    for verdict, meaning in MEANINGS.items():
        assert EXIT_CODES[meaning.exit_code].startswith(f"{verdict}: ")
