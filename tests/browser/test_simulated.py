"""From the first reading of a simulated sensor to the file: what somebody sees who has nothing plugged in."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from benchmarks.stage import Program
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, until

from flinders.core import calibration_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser

pytestmark = pytest.mark.tools


@pytest.fixture
def visitor(browser: Browser, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Visitor]:
    """Of a simulation as fast as is asked."""
    with Program(tmp_path, "--simulate", "--speed", str(getattr(request, "param", 1))) as program:
        visitor = Visitor(browser, program)
        yield visitor
        visitor.leave()
        visitor.close()


@pytest.mark.parametrize("visitor", [10], indirect=True)
def test_it_collects_becomes_good_and_is_exported(visitor: Visitor, tmp_path: Path) -> None:
    page = visitor.page(draws=True)
    expect(page.locator(".status")).to_have_attribute("data-phase", "collecting")
    expect(page.locator("#source-name")).to_have_text("simulation")
    until(page, "flinders.store.state.readings > 20 && flinders.store.points.count > 20")
    until(page, "flinders.store.state.phase === 'good'")
    expect(page.locator("#hand")).to_be_hidden()
    expect(page.locator("#phase")).to_have_text("Good")
    expect(page.locator("#advice-words")).to_contain_text("press Finish")
    page.locator("#pause").click()
    expect(page.locator("#pause")).to_have_text("Go on")
    page.get_by_role("button", name="Finish").click()
    expect(page.locator("#verdict")).to_have_attribute("data-verdict", "good")
    page.locator("#export-target").select_option("json")
    expect(page.locator("#preview")).to_contain_text("matrix")
    with page.expect_download() as exported:
        page.locator("#export-file").click()
    assert exported.value.path().read_text(encoding="utf-8") == page.locator("#preview").text_content()
    with page.expect_download() as started:
        page.locator("#save-calibration").click()
    started.value.save_as(tmp_path / "cal.json")
    saved = calibration_file.read(tmp_path / "cal.json")
    number = page.evaluate("flinders.connection.finished")
    served = calibration_file.loads(page.request.get(f"{page.url}calibration.json?of={number}").body())
    assert saved.calibration == served.calibration
    assert saved.fit is not None
    assert saved.fit.verdict == "good"
    with page.expect_download() as drawn:
        page.get_by_role("button", name="Picture").click()
    drawn.value.save_as(tmp_path / "card.png")
    assert (tmp_path / "card.png").read_bytes()[16:24] == struct.pack(">2I", 1200, 630)
    page.get_by_role("button", name="Turn it and look").click()
    expect(page.locator("#finish-panel")).to_be_hidden()
    needles = page.locator(".panel.heading")
    expect(needles).to_contain_class("enlarged")
    page.keyboard.press("Escape")
    expect(needles).not_to_contain_class("enlarged")


SHAPES = """() => [".solid .hull", ".way"].map(part => document.querySelector(`#hand ${part}`).getAttribute("d"))"""


@pytest.mark.nightly
def test_the_thing_in_the_hand_turns_as_the_sensor_is_to_be_turned(visitor: Visitor) -> None:
    context = visitor.context(reduced_motion="no-preference")
    page = visitor.page(context)
    until(page, "flinders.store.state.readings > 20")
    expect(page.locator("#hand")).to_be_visible()
    expect(page.locator("#hand .caption")).to_have_text("Step 1 of 3")
    assert page.locator("#hand > svg").get_attribute("aria-label") == page.locator("#advice-words").text_content()
    hull, way = page.evaluate(SHAPES)
    assert way, "an arrow shows which way"
    until(page, f"document.querySelector('#hand .solid .hull').getAttribute('d') !== '{hull}'")
    expect(page.locator("#notices")).to_contain_text("a common mistake")
    page.locator("#pause").click()
    expect(page.locator("#hand")).to_be_hidden()


def test_it_starts_again_only_when_that_is_confirmed(visitor: Visitor) -> None:
    page = visitor.page()
    until(page, "flinders.store.state.readings > 60")
    page.keyboard.press("n")
    page.locator("#confirm .shut").click()
    expect(page.locator("#confirm")).to_be_hidden()
    assert page.evaluate("flinders.store.state.readings") > 60
    page.keyboard.press("p")
    until(page, "flinders.store.state.paused")
    page.keyboard.press("n")
    page.locator("#confirmed").click()
    until(page, "flinders.store.state.readings < 60")
    expect(page.locator("#notices")).to_contain_text("tarted again")
    until(page, "!flinders.store.state.paused && flinders.store.points.count > 5")
