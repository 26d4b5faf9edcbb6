"""A report in a real browser, opened from the disk: nothing is fetched, nothing complains, and it prints round."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import pytest
from tests.marine.test_swing_standard import account
from tests.report.test_report import fitted, flat
from tests.trials import nightly

from flinders.apps.marine.certificate import certificate
from flinders.report.formatting import degrees
from flinders.report.html import page as report
from flinders.report.pdf import BROWSERS, print_pdf

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.tools

A4 = {"width": 794, "height": 1123}


@dataclass
class Watched:
    """A page, and what went wrong on it."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("reports")
    for name, motion in (("good", "hand"), ("limited", "tilted")):
        (made / f"{name}.html").write_text(report(*fitted(motion)), encoding="utf-8")
    (made / "refused.html").write_text(report(*flat()), encoding="utf-8")
    return made


def opened(browser: Browser, folder: Path, name: str, **options: object) -> Watched:
    page = browser.new_page(**options)  # type: ignore[arg-type]
    watched = Watched(page)
    page.on("console", lambda message: watched.complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: watched.complaints.append(str(error)))
    page.on("request", lambda request: watched.requests.append(request.url))
    page.goto((folder / f"{name}.html").as_uri())
    return watched


@pytest.mark.parametrize(
    ("name", "scheme"), [("good", "light"), nightly("good", "dark"), nightly("limited", "light"), ("refused", "dark")]
)
def test_it_opens_from_the_disk_without_an_error_or_a_request(
    browser: Browser, folder: Path, name: str, scheme: str
) -> None:
    found = opened(browser, folder, name, color_scheme=scheme)
    found.page.wait_for_selector("#scene canvas")
    assert found.complaints == []
    assert [url for url in found.requests if not url.startswith("data:")] == [(folder / f"{name}.html").as_uri()]
    ground = found.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", ground)[:3])) < 200) == (scheme == "dark")
    found.page.close()


def test_its_verdict_is_what_the_fit_says(browser: Browser, folder: Path) -> None:
    found = opened(browser, folder, "good")
    assert found.page.inner_text("h1") == "Good"
    assert degrees(fitted()[0].heading_error_deg.worst) in found.page.inner_text(".sentence")
    found.page.close()


def test_the_view_is_drawn_and_turns_to_each_of_its_pictures(browser: Browser, folder: Path) -> None:
    found = opened(browser, folder, "limited", color_scheme="light", viewport={"width": 900, "height": 800})
    scene = found.page.locator("#scene")
    scene.locator("canvas").wait_for()
    pictures = set()
    for mode in ("sphere", "clouds", "raw", "corrected"):
        found.page.locator(f"input[value={mode}]").check()
        found.page.wait_for_timeout(700)
        pictures.add(scene.screenshot())
    assert len(pictures) == 4
    assert not found.page.locator(".still").is_visible()
    assert found.complaints == []
    found.page.close()


def test_the_theme_can_be_changed_by_hand(browser: Browser, folder: Path) -> None:
    found = opened(browser, folder, "good", color_scheme="light")
    found.page.click("#theme")
    assert found.page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert found.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(11, 15, 20)"
    found.page.close()


def test_without_scripts_the_figures_are_there(browser: Browser, folder: Path) -> None:
    found = opened(browser, folder, "good", java_script_enabled=False)
    assert found.page.locator(".still").is_visible()
    assert not found.page.locator(".stage").is_visible()
    assert not found.page.locator("#theme").is_visible()
    assert found.page.locator("svg.figure").count() == 16
    found.page.close()


@pytest.mark.parametrize("scheme", [nightly("light"), "dark"])
def test_paper_is_light_has_the_still_picture_and_a_round_sphere(browser: Browser, folder: Path, scheme: str) -> None:
    found = opened(browser, folder, "limited", color_scheme=scheme, viewport=A4)
    found.page.wait_for_selector("#scene canvas")
    found.page.emulate_media(media="print")
    assert not found.page.locator(".stage").is_visible()
    assert found.page.locator(".still").is_visible()
    assert found.page.evaluate("getComputedStyle(document.body).color") == "rgb(18, 24, 31)"
    shapes = "svg.figure circle.rim, .still circle.outline, .trio path.outline.after"
    boxes = found.page.eval_on_selector_all(
        shapes, "all => all.map(one => { const box = one.getBoundingClientRect(); return [box.width, box.height] })"
    )
    round_ones = [(width, height) for width, height in boxes if width > 20]
    assert len(round_ones) >= 7
    assert all(abs(width / height - 1.0) < 0.02 for width, height in round_ones)
    wide = found.page.evaluate("document.documentElement.scrollWidth")
    assert wide <= A4["width"], "something sticks out of the paper"
    found.page.close()


@pytest.mark.parametrize("name", [nightly("good"), "limited", nightly("refused")])
def test_on_a_telephone_nothing_sticks_out(browser: Browser, folder: Path, name: str) -> None:
    found = opened(browser, folder, name, viewport={"width": 360, "height": 740})
    assert found.page.evaluate("document.documentElement.scrollWidth") <= 360
    found.page.close()


def test_a_script_in_a_name_does_not_run(browser: Browser, tmp_path: Path) -> None:
    from dataclasses import replace

    fit, samples = fitted()
    evil = "</title></style><script>window.ran = true</script><img src=x onerror='window.ran = true'>"
    named = replace(fit, calibration=replace(fit.calibration, sensor=evil))
    (tmp_path / "evil.html").write_text(report(named, replace(samples, source=evil)), encoding="utf-8")
    found = opened(browser, tmp_path, "evil")
    found.page.wait_for_selector("#scene canvas")
    assert found.page.evaluate("window.ran") is None
    assert found.page.locator("img").count() == 0
    assert evil in found.page.title()
    assert found.complaints == []
    found.page.close()


def test_a_script_that_got_in_would_not_run(browser: Browser, folder: Path, tmp_path: Path) -> None:
    """The policy of the page stands behind the escaping."""
    text = (folder / "good.html").read_text(encoding="utf-8")
    spoiled = text.replace("<main>", "<main><script>window.ran = true</script><img src='https://localhost/x'>", 1)
    (tmp_path / "spoiled.html").write_text(spoiled, encoding="utf-8")
    found = opened(browser, tmp_path, "spoiled")
    found.page.wait_for_selector("#scene canvas")
    assert found.page.evaluate("window.ran") is None
    assert len(found.complaints) == 2
    found.page.close()


def test_a_browser_prints_it_to_a4(folder: Path) -> None:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip("no browser to print with")
    made = print_pdf((folder / "limited.html").read_text(encoding="utf-8"), program)
    assert made.startswith(b"%PDF")
    boxes = re.findall(rb"/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)\s*\]", made)
    assert boxes
    assert all(abs(float(w) - 595) < 2 and abs(float(h) - 842) < 2 for w, h in boxes)
    assert len(boxes) == 4


def test_a_certificate_is_one_sheet() -> None:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip("no browser to print with")
    for name, step_deg in (("within", 30.0), ("open", 15.0), ("beyond", 15.0)):
        made = print_pdf(certificate(replace(account(name), step_deg=step_deg)), program)
        assert len(re.findall(rb"/MediaBox", made)) == 1, name
