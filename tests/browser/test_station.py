"""A shift at a station: an operator with a scanner, a board, a cable that comes loose, and a power failure."""

from __future__ import annotations

import csv
import os
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from benchmarks.stage import Board, Program, motioncal
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, grave, until

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

pytestmark = [
    pytest.mark.tools,
    pytest.mark.skipif(os.name == "nt", reason="the board is a pseudo-terminal"),
]

PLAN = """
[limits]
noise = 1.0
time_s = 60
[serial]
pattern = '[A-Z]\\d+'
"""
STEPS = """
[motion]
steps = [{words = "Start the fixture.", seconds = 2}, {words = "Wait.", seconds = 1}]
"""


class Operator(Visitor):
    """A person at a station, who scans and presses keys."""

    def come(self, **options: Any) -> Page:
        page = self.context(**options).new_page()
        page.goto(self.program.address)
        until(page, "window.flinders?.station() && flinders.store.hello")
        return page


def scan(page: Page, serial: str) -> None:
    """Type a serial number and Enter, as a scanner does."""
    page.keyboard.type(serial)
    page.keyboard.press("Enter")


def phase(page: Page, wanted: str) -> None:
    expect(page.locator("body")).to_have_attribute("data-phase", wanted)


def rows(folder: Path) -> list[tuple[str, str, str]]:
    with (folder / "flinders-station" / "table.csv").open(encoding="utf-8", newline="") as file:
        return [(row["unit"], row["result"], row["code"]) for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def lines() -> list[bytes]:
    """What a board prints while it is turned, for some minutes."""
    tumble = simulate.tumble(seed=3, noise=0.3)
    others = (simulate.tumble(seed=seed, noise=0.3, sensor=tumble.sensor).samples.field for seed in range(4, 14))
    return motioncal(np.concatenate([tumble.samples.field, *others]))


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    with Board(tmp_path / "ttyBoard") as board:
        yield board


def test_a_shift_from_the_first_scan_to_a_power_failure(
    browser: Browser, board: Board, lines: list[bytes], tmp_path: Path, axe: str
) -> None:
    (tmp_path / "line.toml").write_text(PLAN, encoding="utf-8")
    asked = ("line.toml", "--serial", str(board.port), "--operator", "Ada")
    with Program(tmp_path, *asked, command="station") as program:
        operator = Operator(browser, program)
        page = operator.come()
        expect(page.locator("#serial")).to_be_focused()
        assert grave(page, axe) == []
        scan(page, "no label")
        expect(page.locator("#refusal")).not_to_be_empty()
        operator.forgive(400)
        board.play(lines, 1000)
        scan(page, "A17")
        phase(page, "testing")
        scan(page, "A17")  # scanned twice
        phase(page, "result")
        expect(page.locator("#outcome")).to_have_attribute("data-result", "pass")
        expect(page.locator("#verdict-word")).to_have_text("PASS")
        assert grave(page, axe) == []
        scan(page, "A17")
        phase(page, "confirm")
        page.keyboard.press("Escape")
        phase(page, "ready")
        board.stop()
        scan(page, "B2")
        phase(page, "testing")
        board.unplug()
        expect(page.locator("#advice-words")).to_contain_text("gone")
        board.plug()
        board.play(lines, 1000)
        phase(page, "result")
        page.keyboard.press("Space")
        phase(page, "ready")
        page.keyboard.press("F2")
        page.keyboard.type("Bo")
        page.keyboard.press("Enter")
        expect(page.locator("#serial")).to_be_focused()
        board.stop()
        scan(page, "C3")
        phase(page, "testing")
        board.send(b"".join(lines[:300]))
        until(page, "flinders.store.state.readings > 200")
        program.kill()
        operator.complaints.clear()  # the browser notes each request that nobody answers
        operator.close()
    with Program(tmp_path, *asked, command="station") as program:
        assert "C3" in program.said
        operator = Operator(browser, program)
        page = operator.come(color_scheme="light", viewport={"width": 390, "height": 844})
        expect(page.locator("#serial")).to_be_focused()
        assert grave(page, axe) == []
        operator.close()
    assert rows(tmp_path) == [("A17", "pass", ""), ("B2", "pass", ""), ("C3", "aborted", "interrupted")]
    recorded = next((tmp_path / "flinders-station" / "recordings" / "C3").glob("*.csv"))
    assert recorded.read_text(encoding="utf-8").count("\n") > 200


def test_a_simulated_unit_is_judged_after_the_fixed_steps_of_a_fixture(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "line.toml").write_text(STEPS, encoding="utf-8")
    with Program(tmp_path, "line.toml", "--simulate", "--speed", "30", command="station") as program:
        operator = Operator(browser, program)
        page = operator.come()
        scan(page, "A17")
        expect(page.locator("#advice-words")).to_have_text("Start the fixture.")
        expect(page.locator("#then")).to_have_text("Then: Wait.")
        phase(page, "result")
        expect(page.locator("#verdict-word")).not_to_be_empty()
        operator.leave()
        operator.close()
    assert len(rows(tmp_path)) == 1
