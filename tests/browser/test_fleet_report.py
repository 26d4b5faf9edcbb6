"""The report of a fleet in a real browser: nothing is fetched, nothing complains, and tables are sorted by a click."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.drift import Fleet, simulated

from flinders.fleet.drift import drift_of
from flinders.fleet.overview import overview_of
from flinders.report.fleet import page as report

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    rows, _ = simulated(Fleet(units=200, step_deg=3.0), np.random.default_rng(3))
    parquet.write_table(rows.to_arrow(), folder / "fleet.parquet")
    tables = [folder / "fleet.parquet"]
    (folder / "fleet.html").write_text(report(overview_of(tables), drift_of(tables)), encoding="utf-8")
    return folder / "fleet.html"


@pytest.mark.parametrize("scheme", ["light", "dark"])
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


def test_a_telephone_shows_it_without_scrolling_sideways(browser: Browser, written: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.goto(written.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()
