"""A page prints the first cause; the verdict is that of all findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rich.console import Console
from tests.worlds import judged

from flinders import simulate
from flinders.core.samples import Samples
from flinders.findings import CATALOGUE, CAUSES, Finding, first_causes, link_causes
from flinders.findings.catalogue import ENGINE_FINDINGS
from flinders.findings.rules import SEVERITIES
from flinders.native.engine import engine
from flinders.report.fit_pages import page_of_fit

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.findings import Severity


def tumble(seed: int = 3, n: int = 1500) -> Floats:
    return np.array(simulate.tumble(seed=seed, n=n).samples.field)


def swapped() -> Floats:
    """Two axes change places halfway."""
    field = tumble()
    field[700:] = field[700:, [1, 0, 2]]
    return field


def of_two_sensors() -> Floats:
    """The readings of two sensors take turns."""
    field = tumble()
    field[::2] += [0.0, 12.0, 0.0]
    return field


def noise_alone() -> Floats:
    return 30.0 * np.random.default_rng(3).standard_normal((500, 3))


def arc() -> Floats:
    """A sixth of a level turn."""
    around = np.linspace(0.0, np.pi / 3.0, 300)
    level = 24.0 * np.stack([np.cos(around), np.sin(around), np.full(300, 1.7)], axis=1)
    return level + 0.2 * np.random.default_rng(3).standard_normal((300, 3))


@pytest.mark.parametrize(
    ("recorded", "cause"),
    [(swapped, "axis-swap"), (of_two_sensors, "alternating"), (noise_alone, "noise"), (arc, "heading-error")],
)
def test_one_line_says_why_it_is_refused(recorded: Callable[[], Floats], cause: str) -> None:
    fit = judged(Samples.of(recorded(), unit="uT", time=0.02 * np.arange(len(recorded()))))
    shown = [finding for finding in first_causes(fit.findings) if finding.severity != "note"]
    assert fit.verdict == "refused"
    assert [(finding.code, finding.severity) for finding in shown] == [(cause, "refuses")]
    assert len([finding for finding in fit.findings if finding.severity != "note"]) > 1


def test_nothing_is_seen_of_a_sphere_that_is_noise() -> None:
    console = Console(width=100, record=True, quiet=True)
    console.print(page_of_fit(judged(noise_alone())))
    assert "of the sphere" not in console.export_text()


def found(code: str, severity: Severity) -> Finding:
    return Finding(code, severity, {})


def test_what_follows_from_nothing_stays_in_its_place() -> None:
    findings = [found("coverage", "limits"), found("axis-ratio", "limits"), found("scale-unknown", "note")]
    assert first_causes(link_causes(findings)) == tuple(findings)
    twice = [found("disturbance", "note"), found("disturbance", "note")]
    assert first_causes(link_causes(twice)) == tuple(twice)


def test_a_note_explains_nothing_that_limits() -> None:
    codes = {
        finding.code
        for finding in first_causes(link_causes([found("field-changed", "note"), found("noise", "limits")]))
    }
    assert codes == {"field-changed", "noise"}


def test_the_table_speaks_of_findings() -> None:
    for cause in CAUSES:
        assert {cause.code, *cause.consequences} <= set(CATALOGUE)
        assert cause.code not in cause.consequences


def test_findings_are_shown_in_the_order_of_the_engine() -> None:
    rng = np.random.default_rng(1)
    causes = sorted({cause.code for cause in CAUSES} | {code for cause in CAUSES for code in cause.consequences})
    for _ in range(200):
        present = {code: int(rng.integers(1, 4)) for code in causes if rng.random() < 0.3}
        severities = np.array([present.get(code, 0) for code in ENGINE_FINDINGS], dtype=np.uint8)
        judgement = engine().causes(severities)
        order = [rule for rule in judgement["order"].tolist() if rule < len(ENGINE_FINDINGS)]
        findings = link_causes(
            found(code, SEVERITIES[present[code]] or "note") for code in ENGINE_FINDINGS if code in present
        )
        shown = [(finding.code, finding.severity) for finding in first_causes(findings)]
        assert shown == [(ENGINE_FINDINGS[rule], SEVERITIES[judgement["shown"][rule]]) for rule in order]
