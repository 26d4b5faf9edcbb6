"""The live page and a session have the verdict, conditions and refusals of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.diagnostics.test_unmoved import handled
from tests.fitting.test_one_verdict import CASES
from tests.page_session import PageSession

import flinders
from flinders import simulate
from flinders.apps.live.buffer import rows_of
from flinders.apps.live.guided import Session
from flinders.core.samples import Samples
from flinders.report.formatting import condition
from flinders.report.modules import asset
from flinders.report.notebook import html_of
from flinders.report.view import view
from flinders.verdicts import MEANINGS

if TYPE_CHECKING:
    from tests.trials import Choose


def test_the_live_page_says_one_thing(trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        field, _ = handled(seed, n=3000)
        samples = Samples(field, time=np.arange(3000) / 50.0)
        session = PageSession()
        session.arrived(60.0, rows_of(samples), samples.unit)
        found = session.evaluated()
        assert [(reason.code, reason.severity) for reason in found.reasons] == [("no-rotation", "info")]
        assert found.refusal.startswith("all readings lie within ")
        assert found.view is None


def test_a_notebook_and_the_live_page_state_it() -> None:
    samples = simulate.tumble(seed=1).samples
    fit = flinders.fit(samples)
    assert condition(fit) in html_of(fit)
    session = PageSession()
    session.arrived(60.0, rows_of(samples))
    assert session.evaluated().view.condition == view(fit, samples).condition
    assert view(fit, samples).condition in condition(fit)


@pytest.mark.parametrize("verdict", CASES)
def test_a_session_has_the_verdict_of_all_readings(verdict: str) -> None:
    samples = CASES[verdict].samples
    assert Session(unit="uT").add(samples.field, time=samples.time).verdict == verdict
    page = PageSession()
    page.arrived(60.0, rows_of(samples))
    assert page.evaluated().view.verdict == verdict


def test_the_page_calls_verdicts_as_the_report_does() -> None:
    listed = asset("apps/live/static/views/words.js").split("export const VERDICTS = Object.freeze({")[1].split("}")[0]
    assert listed.split() == [
        part for verdict, known in MEANINGS.items() for part in (f"{verdict}:", f'"{known.title}",')
    ]
