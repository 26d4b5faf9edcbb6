"""Finish: the page, other screens, the files that are saved and the terminal hold one calibration, which stays."""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from benchmarks.stage import Board, Program, motioncal
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, until

from flinders import simulate
from flinders.apps.live.session_file import read_edits
from flinders.core import calibration_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

pytestmark = [
    pytest.mark.tools,
    pytest.mark.skipif(os.name == "nt", reason="the board is a pseudo-terminal"),
]

TUMBLE: Final = simulate.tumble(seed=3, noise=0.3)
LINES: Final = motioncal(TUMBLE.samples.field)
OTHERS: Final = motioncal(simulate.tumble(seed=4, noise=0.3, sensor=TUMBLE.sensor).samples.field)
BESIDE_A_LAPTOP: Final = motioncal(TUMBLE.samples.field + np.array([40.0, -20.0, 30.0]))
"""What the board prints once it was put down: readings that would spoil the calibration."""
PHONE: Final[dict[str, Any]] = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}


class Bench:
    """A board that was turned, the program that listens to it, and browsers."""

    def __init__(self, browser: Browser, board: Board, program: Program) -> None:
        self.board, self.program = board, program
        self.visitor = Visitor(browser, program)

    def finished(self, then: list[bytes] = BESIDE_A_LAPTOP) -> Page:
        """A page with a good calibration that was finished, and what the board prints then."""
        self.board.play(LINES, 1000)
        page = self.visitor.page(permissions=["clipboard-read", "clipboard-write"])
        until(page, "flinders.store.state.phase === 'good' && flinders.store.state.used > 1500")
        page.get_by_role("button", name="Finish").click()
        expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
        self.board.play(then, 1000)
        return page


@pytest.fixture
def bench(browser: Browser, tmp_path: Path) -> Iterator[Bench]:
    with Board(tmp_path / "ttyBoard") as board, Program(tmp_path, "--serial", str(board.port)) as program:
        bench = Bench(browser, board, program)
        yield bench
        bench.visitor.close()
    assert bench.visitor.complaints == []


def since(page: Page, count: int) -> None:
    """Wait until so many readings came after Finish."""
    until(page, f"flinders.store.state.finished?.since >= {count}")


def text_of(page: Page) -> str:
    return str(page.locator("#preview").text_content())


def numbers_of(page: Page) -> Any:  # noqa: ANN401 - JSON
    """What the page shows of the calibration."""
    shown = "[flinders.store.view, flinders.store.points.count, flinders.store.state.phase, flinders.store.state.words]"
    return page.evaluate(shown)


def test_the_text_under_the_copy_button_is_that_of_the_calibration_that_was_finished(bench: Bench) -> None:
    page = bench.finished()
    expect(page.locator("#export-target option").first).to_have_attribute("value", "arduino")
    assert page.locator("#export-target").input_value() == "arduino"
    text = text_of(page)
    since(page, 100)
    numbers = numbers_of(page)
    since(page, 1500)
    assert (text_of(page), numbers_of(page)) == (text, numbers)
    expect(page.locator("#finish-more-words")).to_contain_text("Recording goes on")
    page.locator("#copy").click()
    expect(page.locator("#copy")).to_have_text("Copied")
    assert page.evaluate("navigator.clipboard.readText()") == text
    page.locator("#finish-panel .shut").click()
    expect(page.locator("#advice-words")).to_have_text("Finished: this calibration stays as it is.")
    expect(page.locator("#since")).to_contain_text("readings since")
    expect(page.locator("#pause")).to_be_hidden()
    assert numbers_of(page) == numbers
    page.get_by_role("button", name="Export").click()
    expect(page.locator("#finish-title")).to_contain_text("Finished at")
    assert text_of(page) == text


def test_collect_more_takes_the_new_readings_in_and_goes_on(bench: Bench) -> None:
    page = bench.finished(OTHERS)
    since(page, 300)
    used = page.evaluate("flinders.store.state.used")
    page.locator("#collect").click()
    expect(page.locator("#finish-panel")).to_be_hidden()
    until(page, f"flinders.store.state.finished === null && flinders.store.state.used > {used + 500}")
    expect(page.get_by_role("button", name="Finish")).to_be_visible()
    expect(page.locator("#remedies")).not_to_contain_text("Collect more")
    expect(page.locator("#pause")).to_be_visible()
    page.keyboard.press("f")
    expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
    page.keyboard.press("Escape")
    page.keyboard.press("m")
    until(page, "flinders.store.state.finished === null")


def test_a_phone_and_a_page_that_is_loaded_again_show_the_same_calibration(bench: Bench) -> None:
    page = bench.finished(OTHERS)
    text, number = text_of(page), page.evaluate("flinders.connection.finished")
    phone = bench.visitor.page(**PHONE)
    for other in (phone, page):
        if other is page:
            page.reload()
            until(page, "window.flinders?.store.hello")
        until(other, "flinders.store.state.phase === 'good' && flinders.store.state.finished")
        other.get_by_role("button", name="Export").click()
        expect(other.locator("#preview")).to_have_text(text, use_inner_text=True)
        assert (text_of(other), other.evaluate("flinders.connection.finished")) == (text, number)
    phone.locator("#finish-panel .shut").click()
    phone.locator("#remedies").get_by_role("button", name="Collect more").tap()
    expect(page.locator("#finish-more-words")).to_have_text("Readings are being collected again.")
    until(page, "flinders.store.state.phase === 'good'")
    assert text_of(page) == text
    page.get_by_role("button", name="Finish again").click()
    expect(page.locator("#finish-more-words")).to_contain_text("Recording goes on")
    assert text_of(page) != text


def test_a_board_that_is_unplugged_after_finish_takes_nothing_away(bench: Bench, tmp_path: Path) -> None:
    page = bench.finished()
    since(page, 10)
    text, numbers = text_of(page), numbers_of(page)
    bench.board.unplug()
    expect(page.locator("#finish-more-words")).to_contain_text("waits for")
    assert (text_of(page), numbers_of(page)) == (text, numbers)
    with page.expect_download() as started:
        page.locator("#save-calibration").click()
    started.value.save_as(tmp_path / "cal.json")
    assert np.abs(calibration_file.read(tmp_path / "cal.json").calibration.offset - TUMBLE.sensor.offset).max() < 0.1
    page.locator("#finish-panel .shut").click()
    expect(page.locator("#phase")).to_have_text("Good")


def test_finish_before_there_is_a_calibration_finishes_nothing(bench: Bench) -> None:
    bench.board.play(LINES[:5] * 100, 200)
    page = bench.visitor.page()
    until(page, "flinders.store.state.readings > 50")
    page.get_by_role("button", name="Finish").click()
    expect(page.locator("#finish-more-words")).to_contain_text("Nothing is finished")
    expect(page.locator("#collect")).to_be_hidden()
    until(page, "flinders.store.state.finished === null")
    page.locator("#finish-panel .shut").click()
    bench.board.play(LINES, 1000)
    until(page, "flinders.store.state.phase === 'good'")


def test_ctrl_c_after_finish_leaves_the_calibration_in_the_recording(
    bench: Bench, browser: Browser, tmp_path: Path
) -> None:
    page = bench.finished()
    text = text_of(page)
    since(page, 500)
    assert bench.program.stop() == 0
    (command,) = [line for line in bench.program.said.splitlines() if line.startswith("next: ")]
    words = shlex.split(command.removeprefix("next: flinders live "))
    assert words == ["--resume", "session.csv"]
    assert read_edits(bench.program.recording).finished_s is not None
    bench.visitor.close()
    bench.visitor.complaints.clear()  # of a page whose program has ended
    with Program(tmp_path, *words) as again:
        visitor = Visitor(browser, again)
        page = visitor.page()
        until(page, "flinders.store.state.phase === 'good' && flinders.store.state.finished?.since >= 500")
        page.get_by_role("button", name="Export").click()
        expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
        assert text_of(page).splitlines()[3:] == text.splitlines()[3:]
        visitor.close()
