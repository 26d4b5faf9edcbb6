"""The planner of the live page, which asks the program, and of the page without a program, which has a table."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from benchmarks.stage import Program, Site
from playwright.sync_api import expect
from tests.browser.visitor import Visitor
from tests.feeding import free_port

from flinders.apps.live.planned import planned_table
from flinders.apps.live.standalone import package

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page


@pytest.fixture(scope="module", params=["served", "alone"])
def visitor(
    request: pytest.FixtureRequest, browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Visitor]:
    folder = tmp_path_factory.mktemp("plan")
    if request.param == "alone":
        pytest.importorskip("ziglang", reason="no compiler for browsers")
        package.write(folder)
    with Program(folder, "--udp", str(free_port())) if request.param == "served" else Site(folder) as program:
        visitor = Visitor(browser, program)
        yield visitor
        visitor.leave()
        visitor.close()


def planner(page: Page, body: str, noise: str) -> None:
    """Ask for a plan, and wait for the answer."""
    if page.locator("#plan").get_attribute("open") is None:
        page.locator("#plan summary").click()
    page.locator("#plan-body").select_option(body)
    page.locator("#plan-noise").fill(noise)
    page.locator("#plan-ask").click()
    expect(page.locator("#plan")).not_to_have_attribute("aria-busy", "true")


@pytest.mark.tools
def test_a_body_and_its_noise_give_words_a_time_and_the_error_to_expect(visitor: Visitor) -> None:
    page = visitor.page()
    planner(page, "drone", "0.5")
    expect(page.locator("#plan")).to_have_attribute("data-verdict", "limited")
    expect(page.locator("#plan-steps li")).to_have_count(5)
    expect(page.locator("#plan-steps li").nth(1)).to_contain_text("lower its nose by 45°")
    row = next(row for row in planned_table() if (row.body, row.noise) == ("drone", 0.5))
    expect(page.locator("#plan-result")).to_have_text(re.compile(re.escape(row.sentence).replace(r"\ ", r"\s")))
    planner(page, "boat", "0.4")
    expect(page.locator("#plan-steps li")).to_have_text(["steer once around, level"])


@pytest.mark.tools
def test_a_noise_that_cannot_be_is_answered_in_words(visitor: Visitor) -> None:
    page = visitor.page()
    planner(page, "hand", "-1")
    expect(page.locator("#plan-result")).to_contain_text("above 0")
    expect(page.locator("#plan-steps li")).to_have_count(0)
    visitor.forgive(400)
