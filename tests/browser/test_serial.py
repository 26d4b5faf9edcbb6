"""A board on a serial port, as a browser sees it: good, noisy, unplugged, garbled, slow and fast."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.stage import Board, Program, motioncal
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, until

import flinders
from flinders import simulate
from flinders.core import calibration_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

pytestmark = [
    pytest.mark.tools,
    pytest.mark.skipif(os.name == "nt", reason="the board is a pseudo-terminal"),
]

TUMBLE = simulate.tumble(seed=3, noise=0.3)
COUNTS_PER_DPS = 16  # of MotionCal


@pytest.fixture(scope="module")
def lines() -> list[bytes]:
    """What a board prints for half an hour: no reading twice, as a board plays them again."""
    others = (simulate.tumble(seed=seed, noise=0.3, sensor=TUMBLE.sensor).samples.field for seed in range(4, 34))
    return motioncal(np.concatenate([TUMBLE.samples.field, *others]))


class Bench:
    """A board, the program that listens to it, and a browser."""

    def __init__(self, browser: Browser, board: Board, program: Program) -> None:
        self.board, self.program = board, program
        self.visitor = Visitor(browser, program)

    def page(self, *, draws: bool = False) -> Page:
        return self.visitor.page(draws=draws)


@pytest.fixture
def bench(browser: Browser, tmp_path: Path) -> Iterator[Bench]:
    with Board(tmp_path / "ttyBoard") as board, Program(tmp_path, "--serial", str(board.port)) as program:
        bench = Bench(browser, board, program)
        yield bench
        bench.visitor.close()
    assert bench.visitor.complaints == []
    assert bench.visitor.strangers == []


def is_near(offset: object, within: float) -> bool:
    return bool(np.abs(np.asarray(offset) - TUMBLE.sensor.offset).max() < within)


def test_a_good_board_becomes_good_and_its_calibration_is_true(
    bench: Bench, tmp_path: Path, lines: list[bytes]
) -> None:
    page = bench.page(draws=True)
    expect(page.locator("#empty-lead")).to_have_text("Waiting for readings")
    until(page, "flinders.store.state.source.link === 'waiting'")  # nothing has come for three seconds
    expect(page.locator(".status")).to_have_attribute("data-phase", "waiting")
    expect(page.locator("#empty-from")).to_have_text(f"from {bench.board.port}")
    expect(page.locator("#empty-example")).to_contain_text("Serial.println")
    expect(page.locator("#advice")).to_be_hidden()
    expect(page.locator("#notices li")).to_have_count(0)
    bench.board.play(lines, 1000)
    until(page, "flinders.store.state.phase === 'good' && flinders.store.state.used > 2000")
    assert page.evaluate("flinders.store.state.unit") == "µT"
    until(page, "Math.abs(flinders.store.state.rate_hz - 1000) < 200")
    page.keyboard.press("f")
    with page.expect_download() as started:
        page.locator("#save-calibration").click()
    started.value.save_as(tmp_path / "cal.json")
    assert is_near(calibration_file.read(tmp_path / "cal.json").calibration.offset, 0.1)


@pytest.mark.nightly
def test_a_board_that_lies_still_is_asked_to_be_turned(bench: Bench, lines: list[bytes]) -> None:
    still = np.array([22.0, -8.0, 41.0]) + 0.5 * np.random.default_rng(1).normal(size=(2000, 3))
    bench.board.play(motioncal(still), 100)
    page = bench.page()
    expect(page.locator("#hand .caption")).to_have_text("Step 1 of 3")
    expect(page.locator("#hand .bodies")).to_be_visible()
    expect(page.locator(".status")).to_have_attribute("data-phase", "collecting")
    bench.board.play(lines, 1000)
    expect(page.locator("#hand .bodies")).to_be_hidden()


@pytest.mark.nightly
def test_a_noisy_board_is_said_to_be_noisy(bench: Bench) -> None:
    noisy = simulate.tumble(seed=3, noise=6.0).samples.field
    bench.board.play(motioncal(noisy), 500)
    page = bench.page()
    until(page, "flinders.store.view?.noise > 5 && flinders.store.view?.noise < 7 && flinders.store.state.used > 300")
    expect(page.locator("#residuals-noise")).to_contain_text("σ")
    assert page.evaluate("flinders.store.view.heading_error_deg.worst") > 0.5


def test_a_board_that_is_unplugged_is_missed_and_comes_back(bench: Bench, lines: list[bytes]) -> None:
    bench.board.play(lines, 200)
    page = bench.page()
    until(page, "flinders.store.state.readings > 300 && flinders.store.view")
    bench.board.unplug()
    expect(page.locator("#source")).to_have_attribute("data-link", "gone")
    expect(page.locator("#phase")).to_contain_text("rong")
    expect(page.locator("#advice-words")).to_contain_text("is gone")
    expect(page.locator("#phase-words")).to_have_text("The sensor is disconnected.")  # and no more of it twice
    before = page.evaluate("flinders.store.state.readings")
    bench.board.plug()
    expect(page.locator("#source")).to_have_attribute("data-link", "connected")
    until(page, f"flinders.store.state.readings > {before + 200}")
    expect(page.locator("#notices")).to_contain_text("is back")
    until(page, "flinders.store.state.phase === 'good'")


@pytest.mark.nightly
def test_garbage_between_lines_is_passed_over(bench: Bench, lines: list[bytes]) -> None:
    rng = np.random.default_rng(1)
    garbled = [
        line if n % 5 else rng.integers(0, 256, 40, np.uint8).tobytes() + b"\r\n" for n, line in enumerate(lines)
    ]
    bench.board.play(garbled, 1000)
    page = bench.page()
    until(page, "flinders.store.state.phase === 'good' && flinders.store.state.used > 1500")
    assert is_near(page.evaluate("flinders.store.view.offset"), 0.2)
    assert page.evaluate("flinders.store.state.rejected") == 0


@pytest.mark.nightly
def test_a_wrong_baud_rate_is_suspected_where_only_garbage_comes(bench: Bench) -> None:
    rng = np.random.default_rng(2)
    bench.board.play([rng.integers(128, 256, 60, np.uint8).tobytes() for _ in range(100)], 50)
    page = bench.page()
    expect(page.locator("#advice-words")).to_contain_text("baud")
    expect(page.locator("#phase")).to_contain_text("rong")
    assert page.evaluate("flinders.store.state.readings") == 0


@pytest.mark.nightly
def test_one_reading_a_second_is_slow_and_no_fault(bench: Bench, lines: list[bytes]) -> None:
    bench.board.play(lines[::50], 1)
    page = bench.page()
    until(page, "flinders.store.state.readings >= 4 && Math.abs(flinders.store.state.rate_hz - 1) < 0.6")
    expect(page.locator(".status")).to_have_attribute("data-phase", "collecting")
    warnings = page.evaluate("flinders.store.state.reasons.filter(reason => reason.severity === 'warning')")
    assert warnings == []


@pytest.mark.nightly
def test_a_thousand_readings_a_second_are_all_recorded_and_shown(bench: Bench, lines: list[bytes]) -> None:
    count = 4000
    numbered = [line.replace(b",0,0,0,", b",0,0,%d," % number) for number, line in enumerate((3 * lines)[:count])]
    bench.board.play(numbered, 1000)
    page = bench.page()
    until(page, f"flinders.store.state.readings >= {count}")
    until(page, "Math.abs(flinders.store.state.rate_hz - 1000) < 200")
    expect(page.locator(".status")).to_have_attribute("data-phase", "good")
    bench.board.stop()
    until(
        page, "flinders.store.points.count === Math.ceil(flinders.store.state.readings / flinders.store.state.stride)"
    )
    rate = flinders.read(bench.program.recording).rate
    assert rate is not None
    numbers = np.rint(np.degrees(rate[:, 2]) * COUNTS_PER_DPS).astype(int)
    np.testing.assert_array_equal(numbers[:count], np.arange(count))
