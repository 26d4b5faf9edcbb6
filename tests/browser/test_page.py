"""The page of a finished session: everything that a person does with it, by mouse, by finger and by keyboard."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from itertools import cycle, islice, product
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.stage import Program
from click.testing import CliRunner
from playwright.sync_api import Error, Locator, expect
from tests.browser.visitor import Visitor, grave, until
from tests.trials import daily

import flinders
from flinders.cli import main
from flinders.core import calibration_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, Page

    from flinders.core.calibration_file import Document

SETTLED = "flinders.store.state.used + flinders.store.state.rejected + flinders.store.state.excluded_readings === 3000"


@pytest.fixture(scope="module")
def program(tumble: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    """One whose sensor has been turned all round."""
    with Program(tmp_path_factory.mktemp("session"), "--replay", str(tumble), "--speed", "500") as running:
        yield running


@pytest.fixture(scope="module")
def person(browser: Browser, program: Program) -> Iterator[Visitor]:
    person = Visitor(browser, program)
    yield person
    person.close()


@pytest.fixture
def visitor(person: Visitor) -> Iterator[Visitor]:
    yield person
    person.leave()


AS_AT_FIRST = [
    {"type": "back_to_live"},
    {"type": "collect"},
    {"type": "target", "deg": 1.0},
    {"type": "dip", "deg": 60.0},
    {"type": "goal", "goal": "heading"},
    {"type": "restore", "start_s": -1.0, "end_s": 1e9},
    {"type": "previous_clear"},
]


KEEP = """() => {
    const { live } = flinders.connection.session;
    live.kept = { evaluated: live.evaluated, view: live.evaluated.view, seconds: 60 };
}"""
"""Keep the newest fit, as several that confirm it would."""


def done(page: Page) -> Page:
    """Have everything as at first, whatever the last test did, and wait until the fit of all readings is shown."""
    page.evaluate("commands => commands.forEach(command => flinders.connection.send(command))", AS_AT_FIRST)
    until(page, SETTLED)
    expect(page.locator("#scene canvas, #without:not([hidden])")).to_be_attached()
    expect(page.locator(".status")).to_have_attribute("data-phase", "good")
    return page


def state(page: Page, name: str) -> Any:  # noqa: ANN401 - a number, a text, a list
    return page.evaluate(f"flinders.store.state.{name}")


def of_finished(page: Page, path: str) -> str:
    """The address of something of the calibration that Finish has made."""
    return f"{page.url}{path}?of={page.evaluate('flinders.connection.finished')}"


def calibrated(path: Path, out: Path) -> Document:
    """What the command line makes of a file."""
    done = CliRunner().invoke(main, ["calibrate", str(path), "-o", str(out)])
    assert done.exit_code == 0, done.output
    return calibration_file.read(out)


def same(one: Document, other: Document, tolerance: float = 1e-9) -> bool:
    pairs = [(found.calibration.offset, found.calibration.matrix) for found in (one, other)]
    return all(np.allclose(a, b, rtol=tolerance, atol=tolerance) for a, b in zip(*pairs, strict=True))


# what it says


def test_the_verdict_and_the_numbers_are_those_of_the_command_line(
    visitor: Visitor, program: Program, tmp_path: Path
) -> None:
    page = done(visitor.page())
    expected = calibrated(program.recording, tmp_path / "cal.json")
    assert expected.fit is not None
    assert expected.fit.heading_error_deg is not None
    view = page.evaluate("flinders.store.view")
    np.testing.assert_allclose(view["offset"], expected.calibration.offset, atol=1e-3)  # of readings in float32
    np.testing.assert_allclose(view["matrix"], expected.calibration.matrix, atol=1e-5)
    expect(page.locator("#phase")).to_have_text("Good")
    worst = float(page.locator("#worst").inner_text())
    assert worst == pytest.approx(expected.fit.heading_error_deg.worst, rel=0.06)  # two digits are shown
    page.keyboard.press("f")
    expect(page.locator("#verdict")).to_have_attribute("data-verdict", "good")
    shown = f"{expected.calibration.offset[0]:.3f}".replace("-", "−")
    expect(page.locator("#parameters tbody tr").first).to_contain_text(shown)
    assert page.locator("#export-target").input_value() == "arduino"
    expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
    text = page.locator("#preview").text_content()
    page.keyboard.press("Escape")
    expect(page.locator("#advice-words")).to_have_text("Finished: this calibration stays as it is.")
    page.keyboard.press("f")
    assert page.locator("#preview").text_content() == text
    page.keyboard.press("Escape")
    page.keyboard.press("m")
    expect(page.locator("#finish")).to_have_text("Finish")


@pytest.mark.tools
def test_every_export_shows_what_the_server_gives(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.keyboard.press("f")
    expect(page.locator("#verdict")).to_have_attribute("data-verdict", "good")
    targets = page.locator("#export-target option").evaluate_all("options => options.map(option => option.value)")
    assert len(targets) > 20
    for target in targets[::5]:
        page.locator("#export-target").select_option(target)
        answer = page.request.get(of_finished(page, f"export/{target}"), headers={"Accept": "application/json"})
        found = answer.json()
        text = found.get("text") or found.get("refusal") or "bytes, to be downloaded"
        expect(page.locator("#preview")).to_contain_text(text.splitlines()[-1].strip()[1:])


def test_what_is_downloaded_is_what_the_server_has_and_flinders_reads_it(
    visitor: Visitor, program: Program, tmp_path: Path
) -> None:
    page = done(visitor.page())
    page.get_by_role("button", name="Finish").click()
    files = {}
    for button in ("Calibration", "Readings", "Report"):
        with page.expect_download() as started:
            page.locator("#finish-panel").get_by_role("button", name=button, exact=True).click()
        files[button] = tmp_path / started.value.suggested_filename
        started.value.save_as(files[button])
    downloaded = calibration_file.read(files["Calibration"])
    assert same(downloaded, calibration_file.loads(page.request.get(of_finished(page, "calibration.json")).body()))
    assert same(downloaded, calibrated(program.recording, tmp_path / "by-command.json"))
    assert files["Readings"].read_bytes() == program.recording.read_bytes()
    assert same(downloaded, calibrated(files["Readings"], tmp_path / "again.json"))
    assert "<title>" in files["Report"].read_text(encoding="utf-8")


@pytest.mark.nightly
def test_an_export_is_copied_as_it_is_shown(visitor: Visitor) -> None:
    context = visitor.context(permissions=["clipboard-read", "clipboard-write"])
    page = done(visitor.page(context))
    page.keyboard.press("f")
    page.locator("#export-target").select_option("micropython")
    expect(page.locator("#preview")).to_contain_text("def ")
    page.keyboard.press("c")
    expect(page.locator("#copy")).to_have_text("Copied")
    assert page.evaluate("navigator.clipboard.readText()") == page.locator("#preview").text_content()


# leaving out


def brush(page: Page, first: float, last: float) -> None:
    """Drag over a part of the field strength."""
    chart = page.locator("#strength [role=application]")
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + first * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + last * box["width"], y, steps=4)
    page.mouse.up()


@pytest.mark.tools
def test_a_stretch_is_left_out_by_dragging_and_comes_back_by_undo(visitor: Visitor) -> None:
    page = done(visitor.page())
    brush(page, 0.4, 0.6)
    start, end = (float(page.locator(f"#{name}").input_value()) for name in ("from", "to"))
    assert 18 < start < 27
    assert 32 < end < 40
    page.get_by_role("button", name="Leave out").click()
    until(page, f"flinders.store.state.excluded_readings > 0 && {SETTLED}")
    assert state(page, "excluded_readings") == pytest.approx(50 * (end - start), abs=3)
    assert np.ravel(state(page, "excluded")) == pytest.approx([start, end], abs=0.01)
    expect(page.locator("#source-words")).to_contain_text("left out")
    expect(page.locator("#span")).to_be_hidden()
    page.get_by_role("button", name="Undo").click()
    until(page, f"flinders.store.state.excluded.length === 0 && {SETTLED}")
    page.get_by_role("button", name="Redo").click()
    until(page, "flinders.store.state.excluded.length === 1")
    page.get_by_role("button", name="Undo").click()
    until(page, "flinders.store.state.excluded.length === 0")


def test_a_stretch_is_left_out_and_put_back_by_keys_alone(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.keyboard.press("x")
    expect(page.locator("#from")).to_be_focused()
    page.keyboard.type("10")
    page.keyboard.press("Tab")
    page.keyboard.type("20.5")
    page.keyboard.press("Enter")
    until(page, "flinders.store.state.excluded.length === 1")
    assert np.ravel(state(page, "excluded")) == pytest.approx([10, 20.5])
    chart = page.locator("#strength [role=application]")
    chart.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#span")).to_be_visible()
    page.keyboard.press("x")
    until(page, "flinders.store.state.excluded.length === 2")
    page.keyboard.press("z")
    page.keyboard.press("Control+z")
    until(page, f"flinders.store.state.excluded.length === 0 && {SETTLED}")


@pytest.mark.nightly
def test_x_marks_a_stretch_and_leaves_it_out_as_the_list_of_keys_says(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.keyboard.press("x")
    marked = [float(page.locator(f"#{name}").input_value()) for name in ("from", "to")]
    page.keyboard.press("x")
    until(page, "flinders.store.state.excluded.length === 1")
    assert np.ravel(state(page, "excluded")) == pytest.approx(marked)
    page.keyboard.press("z")
    until(page, f"flinders.store.state.excluded.length === 0 && {SETTLED}")


@pytest.mark.nightly
def test_a_stretch_that_is_none_is_refused_with_words(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.keyboard.press("x")
    page.keyboard.press("Control+a")
    page.keyboard.type("30")
    page.keyboard.press("Tab")
    page.keyboard.type("20")
    page.keyboard.press("Enter")
    expect(page.locator("#notices")).to_contain_text("a beginning and a later end")
    page.keyboard.press("Escape")
    expect(page.locator("#span")).to_be_hidden()
    assert state(page, "excluded") == []


@pytest.mark.tools
def test_what_stood_beside_the_sensor_is_left_out_by_a_button(visitor: Visitor, tumble: Path) -> None:
    page = done(visitor.page())
    head, *rows = tumble.read_text(encoding="utf-8").splitlines()
    readings = np.array([[float(cell) for cell in row.split(",")] for row in rows[:2200]])
    readings[1400:, 1:] += (14.0, -9.0, 6.0)
    table = "\n".join([head, *(",".join(f"{number:.4f}" for number in reading) for reading in readings)])
    dropped(page, "disturbed.csv", table.encode())
    button = page.get_by_role("button", name=re.compile(r"Leave out 2[78]\.\d–4[34]\.\d s"))
    button.click()
    expect(page.locator(".status")).to_have_attribute("data-phase", "good")
    expect(button).to_be_hidden()
    page.get_by_role("button", name="Undo").click()
    expect(button).to_be_visible()


@pytest.mark.tools
def test_the_dip_is_set_from_a_place(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.get_by_role("button", name="Set dip from place").click()
    page.locator("#latitude").fill("-33.9")
    page.locator("#longitude").fill("151.2")
    page.keyboard.press("Enter")
    expect(page.locator("#place-panel")).to_be_hidden()
    until(page, "flinders.store.state.dip_deg < -63 && flinders.store.state.dip_deg > -66")
    expect(page.locator("#notices")).to_contain_text("The dip at")


# one state


@pytest.mark.tools
def test_a_reload_keeps_everything(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.locator("#target").fill("2.5")
    page.keyboard.press("Enter")
    page.locator("#goal").select_option("attitude")
    page.locator("#dip").fill("-33")
    page.keyboard.press("Enter")
    page.evaluate("flinders.connection.send({type: 'exclude', start_s: 5, end_s: 6})")
    page.get_by_role("button", name="Light or dark").click()
    until(page, "flinders.store.state.excluded.length === 1 && flinders.store.state.dip_deg === -33")
    before = page.evaluate("({...flinders.store.state, rate_hz: 0})")
    page.reload()
    until(page, "window.flinders?.store.state && flinders.store.points.count === 3000")
    after = page.evaluate("({...flinders.store.state, rate_hz: 0})")
    for name in ("target_deg", "goal", "dip_deg", "excluded", "excluded_readings", "readings", "can_undo"):
        assert after[name] == before[name], name
    expect(page.locator("#target")).to_have_value("2.5")
    expect(page.locator("#goal")).to_have_value("attitude")
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    for command in ({"type": "target", "deg": 1}, {"type": "dip", "deg": 60}, {"type": "goal", "goal": "heading"}):
        page.evaluate("command => flinders.connection.send(command)", command)
    page.evaluate("flinders.connection.send({type: 'undo'})")
    until(page, "flinders.store.state.goal === 'heading' && !flinders.store.state.excluded.length")


@pytest.mark.tools
def test_two_tabs_see_the_same(visitor: Visitor) -> None:
    """With all that moves."""
    context = visitor.context(reduced_motion="no-preference", draws=True)
    one, other = done(visitor.page(context)), done(visitor.page(context))
    one.locator("#target").fill("0.7")
    one.keyboard.press("Enter")
    expect(other.locator("#target")).to_have_value("0.7")
    other.evaluate("flinders.connection.send({type: 'exclude', start_s: 30, end_s: 40})")
    until(one, "flinders.store.state.excluded.length === 1")
    one.keyboard.press("z")
    until(other, "flinders.store.state.excluded.length === 0")
    other.evaluate("flinders.connection.send({type: 'target', deg: 1})")
    for page in (one, other):
        until(page, f"flinders.store.view.heading_error_deg.target_deg === 1 && {SETTLED}")
    views = [page.evaluate("JSON.stringify(flinders.store.view)") for page in (one, other)]
    assert views[0] == views[1]


@pytest.mark.tools
def test_a_target_that_cannot_be_meant_goes_back_to_what_holds(visitor: Visitor) -> None:
    page = done(visitor.page())
    field, notices = page.locator("#target"), page.locator("#notices li")
    for typed in ("0", "-1", "400", "", "abc"):
        field.click()
        page.keyboard.press("Control+a")
        page.keyboard.press("Delete")
        page.keyboard.type(typed)
        page.keyboard.press("Enter")
        expect(notices.last).to_contain_text("need a number from 0.05 to 180")
        expect(field).to_have_value("1")
        notices.last.get_by_role("button").click()
        expect(notices).to_have_count(0)
    assert state(page, "target_deg") == 1


LAID = """async ([counts, view]) => {
    const {Scene} = await import("/static/views/scene.js");
    const {points, hello} = flinders.store;
    const host = document.createElement("div");
    Object.assign(host.style, {position: "fixed", inset: "0 auto auto 0", width: "300px", height: "200px"});
    document.body.append(host);
    const scene = new Scene(host, {tiles: hello.tiles, theme: "dark"});
    const frame = () => new Promise(resolve => requestAnimationFrame(resolve));
    scene.setMode("clouds");
    scene.setView(view);
    let from = 0;
    for (const count of counts) {
        const known = {...points, count};
        if (from === 0) scene.setPoints(known);
        else scene.appendPoints(known, from);
        from = count;
        for (let k = 0; k < 3; k += 1) await frame();
    }
    for (let k = 0; k < 60; k += 1) { scene.redraw(); await frame(); }
    scene.redraw();
    const copy = new OffscreenCanvas(300, 200).getContext("2d");
    const canvas = host.querySelector("canvas");
    await frame();
    copy.drawImage(canvas, 0, 0, 300, 200);
    scene.dispose();
    host.remove();
    const pixels = Array.from(copy.getImageData(0, 0, 300, 200).data, byte => String.fromCharCode(byte));
    return btoa(pixels.join(""));
}"""
"""Draws the readings in so many steps, and returns the pixels."""


@pytest.mark.nightly
def test_readings_drawn_onto_a_picture_that_was_kept_look_as_when_all_are_drawn(visitor: Visitor) -> None:
    page = done(visitor.page(draws=True))
    view = page.evaluate("flinders.store.view")
    kept, whole, fewer = (
        np.frombuffer(b64decode(page.evaluate(LAID, [counts, view])), np.uint8).reshape(200, 300, 4).astype(int)
        for counts in ([2000, 2400, 2700, 3000], [3000], [2000])
    )
    assert np.ptp(whole[..., 3]) == 255, "something is drawn"
    assert np.abs(kept - whole).mean() < 0.25 * np.abs(fewer - whole).mean()


INK = """text => {
    const [figure, worst] = ["#figure", "#worst"].map(one => document.querySelector(one));
    worst.textContent = text;
    figure.style.setProperty("--ems", EMS(text));
    const number = figure.getBoundingClientRect(), arc = document.querySelector("#gauge svg").getBoundingClientRect();
    const [right, middle, foot] = [number.right, arc.left + arc.width / 2, number.y + 0.2 * number.height];
    const up = (arc.y + 144 / 202 * arc.height - foot) / (arc.width / 320);
    return [(right - middle) / (arc.width / 320), Math.sqrt(107 ** 2 - up ** 2)];
}"""
"""How far a number reaches to the right of the middle, and how far the arc is there, in units of the gauge."""


@pytest.mark.nightly
def test_no_number_covers_the_arc(visitor: Visitor) -> None:
    page = done(visitor.page())
    for width, text in product((1280, 900), ("12.3", "0.043", "0.0043", "> 90", "–")):
        page.set_viewport_size({"width": width, "height": 800})
        room = page.evaluate("async text => String((await import('/static/views/gauge.js')).ems(text))", text)
        reach, arc = page.evaluate(INK.replace("EMS(text)", f"'{room}'"), text)
        assert 8.0 < reach < arc - 2.0, (width, text)


# files


def dropped(page: Page, name: str, content: bytes) -> None:
    """Let a file fall on the page."""
    page.evaluate(
        """([name, content]) => {
            const transfer = new DataTransfer();
            transfer.items.add(new File([new Uint8Array(content)], name));
            const how = {bubbles: true, cancelable: true, dataTransfer: transfer};
            for (const type of ["dragenter", "dragover", "drop"]) {
                document.body.dispatchEvent(new DragEvent(type, how));
            }
        }""",
        [name, list(content)],
    )


def test_a_log_that_is_dropped_gets_the_same_views_and_leaves_again(visitor: Visitor, tumble: Path) -> None:
    page = done(visitor.page())
    rows = tumble.read_bytes().splitlines(keepends=True)
    dropped(page, "half.csv", b"".join(rows[:1501]))
    expect(page.locator("#source-name")).to_have_text("half.csv")
    until(page, "flinders.store.state.opened === 'half.csv' && flinders.store.points.count === 1500")
    expect(page.locator(".status")).to_have_attribute("data-phase", "good")
    expect(page.locator("#clear")).to_be_hidden()
    page.get_by_role("button", name="Back to the sensor").click()
    until(page, "flinders.store.state.opened === null && flinders.store.points.count === 3000")
    expect(page.locator("#source-name")).to_have_text("tumble.csv")


@pytest.mark.nightly
def test_a_log_without_times_has_no_duration(visitor: Visitor, tumble: Path) -> None:
    page = done(visitor.page())
    rows = [row.partition(",")[2] for row in tumble.read_text(encoding="utf-8").splitlines()[:325]]
    dropped(page, "untimed.csv", "\n".join(rows).encode())
    expect(page.locator("#source-words")).to_have_text("a log · 324 readings")
    expect(page.locator("#strength text").filter(has_text=re.compile(r" s$"))).to_have_count(0)


HOSTILE = "<img src=x onerror=alert(1)>.csv"


def test_a_hostile_name_is_text(visitor: Visitor, tumble: Path) -> None:
    page = done(visitor.page())
    page.on("dialog", lambda dialog: pytest.fail(f"the page was made to say {dialog.message}"))
    dropped(page, HOSTILE, tumble.read_bytes())
    expect(page.locator("#source-name")).to_have_text(HOSTILE)
    assert page.locator("img[src=x]").count() == 0
    page.get_by_role("button", name="Back to the sensor").click()
    dropped(page, HOSTILE, b"\x89PNG nothing of the kind")
    expect(page.locator("#notices [data-severity=error]")).to_contain_text(HOSTILE)
    assert page.locator("img[src=x]").count() == 0
    visitor.forgive(422)


@pytest.mark.tools
def test_what_is_no_log_is_refused_with_words_and_changes_nothing(visitor: Visitor) -> None:
    page = done(visitor.page())
    notice = page.locator("#notices [data-severity=error]")
    for content in (b"", b"\x89PNG\r\n\x1a\n" + bytes(200), b"name,colour\nx,red\n", b"1,2\n3,4\n"):
        dropped(page, "holiday.png", content)
        expect(notice).to_contain_text("holiday.png")
        assert "Traceback" not in notice.inner_text()
        notice.get_by_role("button").click()
        expect(notice).to_have_count(0)
    assert state(page, "opened") is None
    visitor.forgive(422)


@pytest.mark.tools
def test_the_readings_of_a_dropped_log_are_saved_and_not_those_of_the_sensor(
    visitor: Visitor, tumble: Path, tmp_path: Path
) -> None:
    page = done(visitor.page())
    part = tumble.read_text(encoding="utf-8").splitlines(keepends=True)[:1001]
    dropped(page, "part.csv", "".join(part).encode())
    until(page, "flinders.store.state.opened === 'part.csv' && flinders.store.view")
    page.keyboard.press("f")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Readings").click()
    assert saved.value.suggested_filename == "part-readings.csv"
    saved.value.save_as(tmp_path / "part.csv")
    npt.assert_allclose(flinders.read(tmp_path / "part.csv").field, flinders.read(tumble).field[:1000], atol=1e-9)


@pytest.mark.tools
def test_no_line_breaks_between_a_number_and_its_unit(visitor: Visitor) -> None:
    page = done(visitor.page())
    assert "95\u00a0% within" in (page.locator("#phase-words").text_content() or "")


@pytest.mark.tools
def test_an_earlier_calibration_dropped_on_the_finish_panel_is_compared_and_renewed(
    visitor: Visitor, program: Program, tmp_path: Path
) -> None:
    page = done(visitor.page())
    calibrated(program.recording, tmp_path / "before.json")
    page.keyboard.press("f")
    dropped(page, "before.json", (tmp_path / "before.json").read_bytes())
    expect(page.locator("#previous-words")).to_contain_text(re.compile("before.json: it still holds", re.IGNORECASE))
    page.get_by_label("Renew it").check()
    expect(page.locator("#previous-words")).to_contain_text("before.json: Its soft iron is kept")
    expect(page.locator("#numbers")).to_contain_text("refresh")
    page.get_by_role("button", name="Compare with none").click()
    expect(page.locator("#previous-words")).not_to_contain_text("before.json")
    expect(page.get_by_label("Renew it")).to_be_hidden()
    dropped(page, "before.json", b"{}")
    expect(page.locator("#notices [data-severity=error]")).to_contain_text("before.json")
    visitor.forgive(422)


@pytest.mark.tools
def test_what_the_command_line_renews_the_page_renews(
    browser: Browser, program: Program, tumble: Path, tmp_path: Path
) -> None:
    """Also once its connection was lost."""
    calibrated(program.recording, tmp_path / "before.json")
    played = ("--replay", str(tumble), "--speed", "500")
    with Program(tmp_path, *played, "--previous", "before.json", "--refresh") as renewing:
        visitor = Visitor(browser, renewing)
        page = visitor.page()
        until(page, f"flinders.store.state?.refreshing && {SETTLED}")
        page.evaluate("flinders.connection.connection.socket.close()")
        until(page, "document.documentElement.dataset.line === 'lost'")
        until(page, "document.documentElement.dataset.line === 'open' && flinders.store.state.refreshing")
        page.keyboard.press("f")
        expect(page.locator("#numbers")).to_contain_text("refresh")
        visitor.leave()
        visitor.close()


@pytest.mark.tools
def test_a_page_that_hears_of_its_own_edits_keeps_its_result(browser: Browser, tumble: Path, tmp_path: Path) -> None:
    """Also at a site, of which not all numbers are known."""
    with Program(tmp_path, "--replay", str(tumble), "--speed", "500") as program:
        visitor = Visitor(browser, program)
        page, other = done(visitor.page()), visitor.page(visitor.context())
        place = {"type": "place", "latitude_deg": 47.0, "longitude_deg": 8.0, "year": 2026.0}
        page.evaluate("place => flinders.connection.send(place)", place)
        until(page, "flinders.connection.session.live.site?.z_down === false")  # as the server has it
        page.evaluate(KEEP)
        page.evaluate("flinders.connection.send({type: 'pause', paused: true})")
        until(other, "flinders.store.state.paused")
        page.evaluate("() => new Promise((resolve) => setTimeout(resolve, 300))")
        assert state(page, "kept") is not None
        visitor.leave()
        visitor.close()


# everybody


def sizes(targets: Locator) -> list[tuple[str, float, float]]:
    """Name, width and height of all that can be touched here."""
    found: list[list[Any]] = targets.evaluate_all(
        """elements => elements.filter(element => element.checkVisibility()).map(element => {
            const label = element.closest("label");
            const boxes = [element, label].filter(Boolean).map(one => one.getBoundingClientRect());
            return [element.id || element.name || element.getAttribute("aria-label") || element.textContent,
                    Math.max(...boxes.map(box => box.width)), Math.max(...boxes.map(box => box.height))];
        })"""
    )
    return [(str(name), float(width), float(height)) for name, width, height in found]


TOUCH_PX = 40
TARGETS = "button, select, input:not([type=file]), a:not(.skip)"


def test_a_phone_shows_everything_without_scrolling_sideways(visitor: Visitor) -> None:
    page = done(visitor.page(viewport={"width": 360, "height": 740}, has_touch=True, is_mobile=True))
    small = []
    for opener, within in ((None, "body"), ("#finish", "#finish-panel"), ("#help", "#help-panel")):
        if opener:
            page.locator(opener).tap()
        shown = page.locator(within)
        expect(shown).to_be_visible()
        wide = shown.evaluate("element => Math.max(element.scrollWidth, document.documentElement.scrollWidth)")
        assert wide <= 360, within
        small += [size for size in sizes(shown.locator(TARGETS)) if min(size[1:]) < TOUCH_PX]
        if opener:
            shown.locator(".shut").tap()
    assert small == [], f"targets of less than {TOUCH_PX} pixels"


@pytest.mark.nightly
def test_a_phone_gives_each_view_its_room_and_keeps_advice_and_finish_in_sight(visitor: Visitor) -> None:
    page = done(visitor.page(viewport={"width": 360, "height": 740}, has_touch=True, is_mobile=True))
    assert page.evaluate("document.querySelector('#page').scrollHeight") > 740
    for panel in ("stage", "strength", "projections", "deviation", "residuals", "heading"):
        box = page.locator(f"#{panel}").bounding_box()
        assert box is not None
        assert box["width"] > 250, panel
        assert box["height"] > 80, panel
    for scrolled in (0, 700, 100_000):
        page.evaluate("y => document.querySelector('#page').scrollTo(0, y)", scrolled)
        words, button = (page.locator(f"#{name}").bounding_box() for name in ("advice-words", "finish"))
        assert words is not None
        assert button is not None
        assert words["x"] + words["width"] <= button["x"]
        assert max(words["y"] + words["height"], button["y"] + button["height"]) <= 740
    foot = page.locator("#projections").bounding_box()
    bar = page.locator("#advice").bounding_box()
    assert foot is not None
    assert bar is not None
    assert foot["y"] + foot["height"] <= bar["y"], "the end of the page can be scrolled out of the bar"


ON_PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.mark.nightly
def test_a_phone_shows_number_phase_sphere_and_advice_on_one_screen(visitor: Visitor) -> None:
    page = done(visitor.page(draws=True, **ON_PHONE))
    places = [
        page.locator(f"#{name}").bounding_box() for name in ("worst", "phase", "target", "scene", "advice", "finish")
    ]
    assert all(place and place["y"] >= 0 and place["y"] + place["height"] <= 844 for place in places)
    sphere, advice = places[3], places[4]
    assert sphere is not None
    assert advice is not None
    assert sphere["height"] > 400
    assert sphere["y"] + sphere["height"] <= advice["y"]


LONG = "w" * 200
SAY_LONG = """words => {
    for (const id of ["advice-words", "phase-words", "source-name", "source-words", "empty-from"]) {
        document.getElementById(id).textContent = words;
    }
    const row = document.createElement("li");
    row.textContent = words;
    document.getElementById("reasons").append(row);
    const wide = one => [one.className || one.tagName, one.scrollWidth - one.clientWidth];
    return [...document.querySelectorAll("html, .advice, .why, .empty")].map(wide).filter(([, more]) => more > 1);
}"""


@pytest.mark.tools
@pytest.mark.parametrize("width", daily([360, 1280]))
def test_a_word_of_two_hundred_letters_breaks_no_layout(visitor: Visitor, width: int) -> None:
    page = done(visitor.page(viewport={"width": width, "height": 740}))
    assert page.evaluate(SAY_LONG, LONG) == []
    finish, advice = (page.locator(f"#{name}").bounding_box() for name in ("finish", "advice"))
    assert finish is not None
    assert advice is not None
    assert finish["x"] + finish["width"] <= width
    if width < 700:
        lines = page.locator("#advice-words").evaluate(
            "one => one.clientHeight / parseFloat(getComputedStyle(one).lineHeight)"
        )
        assert lines <= 3.1
        page.locator("#advice-words").click()
        hidden_px = page.locator("#advice-words").evaluate("one => one.scrollHeight - one.clientHeight")
        assert hidden_px <= 1


@pytest.mark.tools
def test_a_desk_shows_the_board_without_scrolling(visitor: Visitor) -> None:
    page = done(visitor.page())
    for width, height in ((1280, 800), (1920, 1080), (3840, 2160)):
        page.set_viewport_size({"width": width, "height": height})
        sizes = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
        assert sizes == [width, height]


COVERED = """() => {
    const { left, top, width, height } = document.querySelector("#notices").getBoundingClientRect();
    const points = [0.02, 0.5, 0.98].flatMap(x => [0.1, 0.9].map(y => [left + x * width, top + y * height]));
    const under = points.flatMap(([x, y]) => document.elementsFromPoint(x, y)).filter(one => one.closest("#page"));
    return [...new Set(under)].map(one => one.id || one.className || one.tagName);
}"""
"""What of the page lies under the notices."""


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080), (900, 900), (390, 844), (844, 390)])
def test_notices_cover_nothing_of_the_page(visitor: Visitor, width: int, height: int) -> None:
    page = done(visitor.page())
    page.set_viewport_size({"width": width, "height": height})
    page.locator("#target").fill("999")
    page.locator("#target").dispatch_event("change")
    expect(page.locator("#notices li")).to_have_count(1)
    for scrolled in (0, 300, 100_000):
        page.evaluate("y => document.querySelector('#page').scrollTo(0, y)", scrolled)
        assert page.evaluate(COVERED) == [], scrolled
    page.locator(".strength .enlarge").click()
    assert page.evaluate(COVERED) == []
    enlarged, notices = (page.locator(name).bounding_box() for name in (".enlarged", "#notices"))
    assert enlarged is not None
    assert notices is not None
    assert enlarged["height"] > 0.6 * height
    assert enlarged["y"] + enlarged["height"] <= notices["y"] or enlarged["y"] >= notices["y"] + notices["height"]


@pytest.mark.tools
def test_the_keyboard_scrolls_a_page_that_nobody_has_clicked_on(visitor: Visitor) -> None:
    page = done(visitor.page(viewport={"width": 900, "height": 900}))
    page.keyboard.press("PageDown")
    until(page, "document.querySelector('#page').scrollTop > 200")


SMALL = """() => [...document.querySelectorAll("body *")].filter(one => one.checkVisibility() &&
    [...one.childNodes].some(({nodeType, data}) => nodeType === Node.TEXT_NODE && data.trim())
).map(one => {
    const scale = one.ownerSVGElement ? one.getScreenCTM().a : 1;
    return [one.textContent.trim().slice(0, 20), scale * parseFloat(getComputedStyle(one).fontSize)];
}).filter(([, size]) => size < 11.9)"""
"""Texts of less than 12 pixels, and their sizes."""


@pytest.mark.nightly
def test_no_text_of_a_small_screen_is_smaller_than_twelve_pixels(visitor: Visitor) -> None:
    page = done(visitor.page(viewport={"width": 1280, "height": 720}))
    assert page.evaluate(SMALL) == []


@pytest.mark.nightly
def test_the_legend_names_the_colours_that_are_drawn(visitor: Visitor) -> None:
    page = done(visitor.page())
    rows = page.locator("#legend p")
    scale = ["0.5° or less", "1°", "2°", "5°", "12° or more", "not visited"]
    assert rows.all_text_contents() == scale
    page.evaluate("flinders.connection.send({type: 'exclude', start_s: 5, end_s: 6})")
    expect(rows).to_have_text([*scale, "left out"])
    for key, clouds in (("2", ["raw", "corrected"]), ("3", ["raw"]), ("4", ["corrected"])):
        page.keyboard.press(key)
        expect(rows).to_have_text([*clouds, "left out"])


@pytest.mark.nightly
def test_the_deviation_is_drawn_on_one_scale_at_a_time(visitor: Visitor) -> None:
    page = done(visitor.page())
    raw, corrected = page.locator("#deviation path.raw"), page.locator("#deviation path.corrected")
    expect(corrected).to_have_count(1)
    expect(raw).to_have_count(0)
    page.locator(".deviation").get_by_role("button", name="Raw").click()
    expect(raw).to_have_count(1)
    expect(corrected).to_have_count(0)


MARKS = """() => Object.fromEntries(["strength", "projections", "residuals"].map(
    name => [name, document.querySelectorAll(`#${name} .hovered`).length]
))"""
RING = "[...document.querySelectorAll('.scene-label')].find(one => one.textContent === '◯')?.style.display === 'block'"
BOTH = {"strength": 2, "projections": 6, "residuals": 1}
"""Marks of a reading: raw and corrected over time and in three squares, and its residual."""


@pytest.mark.tools
@pytest.mark.parametrize("chart", daily(["strength", "projections", "residuals", "scene"], 3))
def test_a_reading_under_the_pointer_is_marked_in_every_view(visitor: Visitor, chart: str) -> None:
    page = done(visitor.page(draws=chart == "scene"))
    box = page.locator(f"#{chart}").bounding_box()
    assert box is not None
    square = page.locator(f"#{chart} rect.frame").first.bounding_box() if chart == "projections" else box
    assert square is not None
    for share in islice(cycle((0.3, 0.35, 0.4, 0.45, 0.5)), 500):  # a chart is there when it has been drawn
        page.mouse.move(square["x"] + share * square["width"], square["y"] + 0.5 * square["height"])
        if page.evaluate("flinders.store.hovered") is not None:
            break
    until(page, f"JSON.stringify(({MARKS})()) === JSON.stringify({json.dumps(BOTH)})")
    if chart == "strength":
        assert page.evaluate("flinders.store.hovered") == pytest.approx(3000 * share, abs=200)
    if chart == "scene":
        until(page, RING)
    page.mouse.move(5, 5)
    until(page, f"flinders.store.hovered === null && Object.values(({MARKS})()).every(count => count === 0)")


FOCUS = """() => {
    const element = document.activeElement;
    const label = element.closest("label");
    const shown = [element, label, label?.querySelector("span")]
        .filter(Boolean)
        .map(one => getComputedStyle(one))
        .some(one => (one.outlineStyle !== "none" && parseFloat(one.outlineWidth) >= 1) || one.boxShadow !== "none");
    return {id: element.id || element.getAttribute("aria-label") || element.textContent.trim() || element.tagName,
            tag: element.tagName, role: element.getAttribute("role"), shown};
}"""


def tabbed(page: Page, most: int = 80) -> list[dict[str, Any]]:
    """All that Tab comes to, in order, until it leaves the page or comes around."""
    found: list[dict[str, Any]] = []
    for _ in range(most):
        page.keyboard.press("Tab")
        place = page.evaluate(FOCUS)
        if place["tag"] == "BODY" or (found and place["id"] == found[0]["id"]):
            break
        found.append(place)
    return found


@pytest.mark.tools
def test_the_keyboard_reaches_everything_in_order_and_shows_where_it_is(visitor: Visitor) -> None:
    page = done(visitor.page(draws=True))
    places = tabbed(page)
    names = [place["id"] for place in places]
    assert names[0] == "Skip to the sphere"
    order = [
        "open",
        "pause",
        "clear",
        "theme",
        "help",
        "finish",
        "target",
        "why",
        "goal",
        "dip",
        "place",
        "reset",
        "exclude",
    ]
    assert [name for name in names if name in order] == order
    assert [place["id"] for place in places if not place["shown"]] == [], "no focus is visible"
    assert [place["role"] for place in places].count("application") == 2, " | ".join(names)


@pytest.mark.tools
def test_help_opens_by_its_key_tells_all_keys_and_gives_the_focus_back(visitor: Visitor) -> None:
    page = done(visitor.page())
    page.locator("#theme").focus()
    page.keyboard.press("?")
    expect(page.locator("#help-panel")).to_be_visible()
    assert page.locator("#keys dt").count() >= 15
    inside = tabbed(page, most=12)
    assert all(place["id"] != "finish" for place in inside), "Tab leaves an open dialog"
    page.keyboard.press("Escape")
    expect(page.locator("#help-panel")).to_be_hidden()
    expect(page.locator("#theme")).to_be_focused()


@pytest.mark.nightly
def test_shortcuts_act_and_can_be_switched_off(visitor: Visitor) -> None:
    page = done(visitor.page())
    for key, mode in (("2", "clouds"), ("3", "raw"), ("4", "corrected"), ("1", "sphere")):
        page.keyboard.press(key)
        expect(page.locator(f"input[value={mode}]")).to_be_checked()
    page.keyboard.press("l")
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    page.keyboard.press("t")
    expect(page.locator("#target")).to_be_focused()
    page.keyboard.press("2")  # now a digit
    expect(page.locator("input[value=sphere]")).to_be_checked()
    page.keyboard.press("Escape")
    page.locator("#target").fill("1")
    page.keyboard.press("Enter")
    page.keyboard.press("?")
    page.locator("#single-keys").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("4")
    expect(page.locator("input[value=sphere]")).to_be_checked()
    assert state(page, "target_deg") == 1


@pytest.mark.tools
def test_axe_finds_nothing_serious(visitor: Visitor, axe: str) -> None:
    page = done(visitor.page(draws=True))
    for theme in ("dark", "light"):
        expect(page.locator("html")).to_have_attribute("data-theme", theme)
        assert grave(page, axe) == [], theme
        for key, panel in (("f", "finish"), ("?", "help")):
            page.keyboard.press(key)
            expect(page.locator(f"#{panel}-panel")).to_be_visible()
            assert grave(page, axe) == [], (theme, panel)
            page.keyboard.press("Escape")
        page.keyboard.press("l")


def test_the_page_cannot_ask_another_host(browser: Browser, program: Program) -> None:
    context = browser.new_context()
    page = context.new_page()
    page.goto(program.address)
    with pytest.raises(Error, match=r"Failed to fetch|Policy"):
        page.evaluate("fetch('http://192.0.2.1/')")
    refused = page.evaluate(
        """() => new Promise(resolve => {
            document.addEventListener("securitypolicyviolation", event => resolve(event.violatedDirective));
            document.body.append(Object.assign(new Image(), {src: "http://192.0.2.1/x.png"}));
        })"""
    )
    assert refused == "img-src"
    context.close()


def test_what_watches_over_these_tests_notices_strangers_and_complaints(browser: Browser, program: Program) -> None:
    visitor = Visitor(browser, program)
    page = visitor.context().new_page()
    with page.expect_event("pageerror"):
        page.evaluate("console.error('a complaint'); setTimeout(() => { throw new Error('another') })")
    with pytest.raises(Error):
        page.goto("http://192.0.2.1/")
    visitor.close()
    assert visitor.strangers == ["http://192.0.2.1/"]
    assert any("a complaint" in words for words in visitor.complaints)
    assert any("another" in words for words in visitor.complaints)


# the line


@pytest.mark.tools
def test_a_program_that_ends_is_noticed_and_comes_back_with_everything(
    browser: Browser, tumble: Path, tmp_path: Path
) -> None:
    with Program(tmp_path, "--replay", str(tumble), "--speed", "500") as first:
        visitor = Visitor(browser, first)
        page = done(visitor.page())
        page.evaluate("flinders.connection.send({type: 'exclude', start_s: 5, end_s: 6})")
        until(page, "flinders.store.state.excluded.length === 1")
        port = re.findall(r":(\d+)/", first.address)[0]
    expect(page.locator("#lost")).to_contain_text("Flinders does not answer")
    page.locator("#theme").click()
    page.locator("#undo").click()
    expect(page.locator("#notices")).to_contain_text("no connection")
    with Program(tmp_path, "--resume", str(tmp_path / "session.csv"), "--simulate", "--port", port):
        page.locator("#retry").click()
        expect(page.locator("#lost")).to_be_hidden()
        until(page, "flinders.store.state.excluded.length === 1 && flinders.store.state.readings >= 3000")
        page.evaluate(KEEP)
    with Program(tmp_path, "--simulate", "--output", "other.csv", "--port", port):
        until(page, "flinders.store.state.excluded.length === 0 && flinders.store.state.readings > 0")
        assert state(page, "kept") is None
        assert state(page, "readings") < 3000
    visitor.complaints.clear()  # the browser notes each connection that was refused
    visitor.close()
