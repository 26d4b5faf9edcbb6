"""Each state of the page: axe finds nothing serious, and nothing is too wide."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import pytest
from benchmarks.stage import Program
from docs.screenshots import SIZES, STATES, log
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, grave, until
from tests.trials import nightly

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

pytestmark = pytest.mark.tools

EVERY_RUN: Final = ("wrong",)


@pytest.mark.parametrize("name", [name if name in EVERY_RUN else nightly(name) for name in STATES])
def test_a_state_of_the_page_is_for_everybody(browser: Browser, axe: str, tmp_path: Path, name: str) -> None:
    state = STATES[name]
    played = ("--replay", str(log(state.readings, tmp_path)), "--speed", "50") if state.readings else state.source
    with Program(tmp_path, *played) as program:
        visitor = Visitor(browser, program)
        for size, scheme in (("1280", "light"), ("phone", "dark")):
            options: dict[str, Any] = {"color_scheme": scheme, **SIZES[size]}
            page = visitor.page(draws=True, **options)
            until(page, state.ready)
            for key in state.keys:
                page.keyboard.press(key)
            assert grave(page, axe) == [], size
            assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, size
        visitor.leave()
        visitor.close()


@pytest.mark.nightly
def test_a_sensor_that_lies_still_is_not_a_broken_one(browser: Browser, tmp_path: Path) -> None:
    played = ("--replay", str(log("still", tmp_path)), "--speed", "1")
    with Program(tmp_path, *played) as program:
        visitor = Visitor(browser, program)
        page = visitor.page()
        expect(page.locator("#hand > svg")).to_be_visible()
        expect(page.locator(".status")).to_have_attribute("data-phase", "collecting")
        expect(page.locator("#worst")).to_have_text("–")
        visitor.leave()
        visitor.close()
