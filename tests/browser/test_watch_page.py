"""The page of a watch in a real browser: nothing is fetched, nothing complains, and a choice outlasts loading again."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.service.test_watch import BEGUN_S, DRIVE

from flinders import Samples
from flinders.apps.service.sources import of_recordings
from flinders.apps.service.watch_page import page as written_page
from flinders.apps.service.watching import Watch

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

pytestmark = pytest.mark.tools

DAYS_S: Final = 3 * 86400.0


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of two drives, with three days between them."""
    times = np.concatenate([DRIVE[0], DRIVE[0] + DAYS_S])
    drives = Samples.of(np.concatenate([DRIVE[1], DRIVE[1]]), unit="uT", time=BEGUN_S + times, source="drive.csv")
    watch = Watch(of_recordings([drives]))
    path = tmp_path_factory.mktemp("watch") / "boat.html"
    path.write_text(written_page(watch.run(), watch._online, every=600.0), encoding="utf-8")
    return path


def test_it_opens_from_the_disk_without_an_error_or_a_request(browser: Browser, written: Path) -> None:
    page = browser.new_page()
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(written.as_uri())
    expect(page.locator("#age")).to_contain_text("written")
    assert complaints == []
    assert [url for url in requests if not url.startswith("data:")] == [written.as_uri()]
    page.close()


def test_span_and_theme_outlast_loading_again(browser: Browser, written: Path) -> None:
    page = browser.new_page(color_scheme="light")
    page.goto(written.as_uri())
    expect(page.locator(".span.all")).to_be_visible()
    page.locator("input[name=span][value=day]").check()
    page.locator("#theme").click()
    page.reload()
    expect(page.locator(".span.day")).to_be_visible()
    expect(page.locator(".span.all")).to_be_hidden()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.close()


def test_a_page_that_is_no_longer_written_says_so(browser: Browser, written: Path, tmp_path: Path) -> None:
    old = tmp_path / "old.html"
    text = written.read_text(encoding="utf-8")
    old.write_text(re.sub(r'data-written="[\d.]+"', f'data-written="{time.time() - 7200.0}"', text), encoding="utf-8")
    page = browser.new_page()
    page.goto(old.as_uri())
    expect(page.locator("#old")).to_be_visible()
    page.goto(written.as_uri())
    expect(page.locator("#old")).to_be_hidden()
    page.close()


def test_a_telephone_shows_it_without_scrolling_sideways(browser: Browser, written: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.goto(written.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    expect(page.locator(".span.all .on-narrow")).to_be_visible()
    page.close()
