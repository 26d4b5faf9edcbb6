"""The report of a fleet in a real browser: nothing is fetched, nothing complains, and tables are sorted by a click."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from benchmarks.drift import Fleet, simulated
from tests.trials import daily

from flinders.apps.fleet.aggregate import overview_of
from flinders.apps.fleet.drift import drift_of
from flinders.apps.fleet.report import page as report
from flinders.apps.fleet.results import UnitResult, UnitResults
from flinders.report.html_file import style_of

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

parquet = pytest.importorskip("pyarrow.parquet")
pytestmark = pytest.mark.tools


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    rows, _ = simulated(Fleet(units=200, step_deg=3.0), np.random.default_rng(3))
    parquet.write_table(rows.to_arrow(), folder / "fleet.parquet")
    tables = [folder / "fleet.parquet"]
    (folder / "fleet.html").write_text(report(overview_of(tables), drift_of(tables)), encoding="utf-8")
    return folder / "fleet.html"


@pytest.mark.parametrize("scheme", daily(["light", "dark"]))
def test_it_opens_from_the_disk_without_an_error_or_a_request(browser: Browser, written: Path, scheme: str) -> None:
    page = browser.new_page(color_scheme=scheme)  # type: ignore[arg-type]
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(written.as_uri())
    assert complaints == []
    assert [url for url in requests if not url.startswith("data:")] == [written.as_uri()]
    assert "to recalibrate" in page.inner_text("h1")
    page.close()


def test_another_order_is_seen_without_a_script(browser: Browser, written: Path) -> None:
    page = browser.new_page(java_script_enabled=False)
    page.goto(written.as_uri())
    shown = "#units ~ .sorted .order:visible tbody th"
    by_urgency = page.locator(shown).all_inner_texts()
    page.locator("input[name=units][value='4']").check()
    by_name = page.locator(shown).all_inner_texts()
    assert by_name == sorted(by_urgency) != by_urgency
    page.close()


def test_a_list_ends_with_a_whole_row_and_shows_all_on_request(browser: Browser) -> None:
    rows = "".join(f"<tr><th>U{number}</th></tr>" for number in range(40))
    box = "<label class='all'><input type='checkbox'></label>"
    page = browser.new_page()
    page.set_content(
        f"<style>{style_of('apps/fleet/fleet.css')}</style><div class='tall'><table>{rows}</table>{box}</div>"
    )
    assert page.locator("tr:visible").count() == 15
    page.locator(".all input").check()
    assert page.locator("tr:visible").count() == 40
    page.close()


def test_a_telephone_shows_it_without_scrolling_sideways(browser: Browser, written: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.goto(written.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fleet with a long name, many findings, batches and what could not be read."""
    findings = (
        "heading-error", "coverage", "correlated", "outliers", "few-samples", "scale-unknown", "rotation-unknown",
    )  # fmt: skip
    known: dict[str, Any] = {
        "method": "robust",
        "offset": (1.0, 2.0, 3.0),
        "field_strength": 50.0,
        "noise": 0.4,
        "unit_of_field": "uT",
    }
    rows = [
        UnitResult(unit=f"unit {place}", recording="2026/spring.csv", verdict=verdict, worst_deg=1.0 + place,
            findings=findings, batch=f"lot {place % 7}", **known)
        for place, verdict in enumerate(["good", "limited"] * 20)
    ]  # fmt: skip
    rows += [UnitResult(unit="x" * 200, verdict="limited", worst_deg=99.0, findings=findings, batch="l" * 60, **known)]
    rows += [
        UnitResult(unit="A", code="unreadable", message="y" * 300),
        UnitResult(unit="B", verdict="refused", code="coverage"),
    ]
    folder = tmp_path_factory.mktemp("crowded")
    parquet.write_table(UnitResults.of(rows).sorted().to_arrow(), folder / "fleet.parquet")
    (folder / "fleet.html").write_text(report(overview_of([folder / "fleet.parquet"])), encoding="utf-8")
    return folder / "fleet.html"


@pytest.mark.parametrize(("width", "highest"), daily([(390, 260), (1200, 120)]))
def test_all_that_a_row_says_is_in_sight(browser: Browser, crowded: Path, width: int, highest: int) -> None:
    """A long name pushes nothing out, findings are not one word a line, and all verdicts are in the bar."""
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(crowded.as_uri())
    inner = "[document.documentElement, ...document.querySelectorAll('.scrolls, .batches')].filter(shown)"
    shown = "const shown = box => box.clientWidth > 0 && box.scrollWidth > box.clientWidth + 1"
    assert page.evaluate(f"(() => {{ {shown}; return {inner}.map(box => box.className) }})()") == []
    heights = page.locator(".order:visible tbody tr").evaluate_all("rows => rows.map(row => row.offsetHeight)")
    assert sorted(heights)[-2] <= highest, "but for the one with the long name"
    shares = page.locator("#verdicts ~ figure .shares rect")
    bars = shares.evaluate_all("all => all.map(one => one.getBoundingClientRect())")
    assert len(bars) == 4
    assert all(bar["width"] > 0.5 and bar["right"] <= width for bar in bars)
    page.close()
