"""The page that needs no program, in a browser: a folder on a web server, sources, exports, reloads, and no network."""

from __future__ import annotations

import json
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from benchmarks.stage import Site
from playwright.sync_api import expect
from tests.browser.visitor import Visitor, grave, until
from tests.live.test_page_engine import felt, level
from tests.live.test_page_lines import UNREAD
from tests.sketches import SHAPES, printed

import flinders
from flinders import simulate
from flinders.apps.live.standalone import package
from flinders.report.view import view

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Browser, BrowserContext, Dialog, Page

PHONE: Final[dict[str, Any]] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
FAKE: Final = """
(() => {
    const ports = new EventTarget();
    let controller = null;
    const port = () => {
        const made = { readable: null, close: async () => { made.readable = null; } };
        made.open = async ({ baudRate }) => {
            window.board.baud = baudRate;
            made.readable = new ReadableStream({ start: (begun) => { controller = begun; } });
            made.writable = new WritableStream({ write: (bytes) => window.board.take?.(bytes) });
        };
        return made;
    };
    window.board = {
        port: port(),
        print: (text) => controller.enqueue(new TextEncoder().encode(text)),
        unplug: () => {
            window.board.port.readable = window.board.port.writable = null;
            controller.error(new Error("lost"));
        },
        plug: () => {
            window.board.port = port();
            const event = new Event("connect");
            Object.defineProperty(event, "target", { value: window.board.port });
            ports.dispatchEvent(event);
        },
    };
    ports.requestPort = async () => window.board.port ?? Promise.reject(new Error("none"));
    Object.defineProperty(navigator, "serial", { value: ports });
})();
"""
"""Ports of a browser with one board, which prints what a test says."""
TUMBLE: Final = simulate.tumble(seed=5, noise=0.3).samples


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("ziglang", reason="no compiler for browsers")
    folder = tmp_path_factory.mktemp("site")
    package.write(folder)
    return folder


@pytest.fixture(scope="module")
def site(folder: Path) -> Iterator[Site]:
    with Site(folder) as site:
        yield site


@pytest.fixture
def visitor(browser: Browser, site: Site) -> Iterator[Visitor]:
    visitor = Visitor(browser, site)
    yield visitor
    visitor.leave()
    visitor.close()


@pytest.fixture
def context(visitor: Visitor) -> BrowserContext:
    """A browser with a board."""
    context = visitor.context(permissions=["clipboard-read", "clipboard-write"])
    context.add_init_script(FAKE)
    return context


def connected(page: Page) -> None:
    """Connect the board."""
    if page.locator("#start").is_hidden():
        page.locator("#connect").click()
    page.locator("#use-board").click()
    expect(page.locator("#start")).to_be_hidden()


def pasted(page: Page, text: str) -> None:
    """Paste a text onto the page."""
    page.evaluate(
        """text => {
            const clipboardData = new DataTransfer();
            clipboardData.setData("text", text);
            const event = new ClipboardEvent("paste", { clipboardData, bubbles: true, cancelable: true });
            document.body.dispatchEvent(event);
        }""",
        text,
    )


def log_of(field: Any) -> str:  # noqa: ANN401 - an array
    """A table of 50 readings a second."""
    rows = "\n".join(f"{0.02 * row:.2f},{x:.3f},{y:.3f},{z:.3f}" for row, (x, y, z) in enumerate(field))
    return f"t_s,mx_uT,my_uT,mz_uT\n{rows}\n"


def test_a_log_that_is_dropped_gets_a_verdict_and_a_file_that_flinders_reads(visitor: Visitor, tmp_path: Path) -> None:
    page = visitor.page(visitor.context(permissions=["clipboard-read", "clipboard-write"]))
    expect(page.locator("#start")).to_be_visible()
    transfer = page.evaluate_handle(
        "text => { const all = new DataTransfer(); all.items.add(new File([text], 'tumble.csv')); return all; }",
        log_of(TUMBLE.field),
    )
    page.dispatch_event("body", "drop", {"dataTransfer": transfer})
    until(page, "flinders.store.state.phase === 'good'")
    expect(page.locator("#source-name")).to_have_text("tumble.csv")
    page.keyboard.press("f")
    expect(page.locator("#verdict")).to_have_attribute("data-verdict", "good")
    for name in ("send", "refresh"):
        expect(page.locator(f"#{name}")).to_be_hidden()
    page.locator("#export-target").select_option("arduino")
    expect(page.locator("#preview")).to_contain_text("float")
    page.keyboard.press("c")
    expect(page.locator("#copy")).to_have_text("Copied")
    assert page.evaluate("navigator.clipboard.readText()") == page.locator("#preview").text_content()
    with page.expect_download() as started:
        page.locator("#save-calibration").click()
    started.value.save_as(tmp_path / "cal.json")
    saved = flinders.load(tmp_path / "cal.json")
    fit = flinders.fit(TUMBLE)
    np.testing.assert_allclose(saved.calibration.offset, fit.calibration.offset, atol=0.02)
    np.testing.assert_allclose(saved.calibration.matrix, fit.calibration.matrix, atol=5e-4)
    assert saved.verdict == fit.verdict
    page.locator("#previous-file").set_input_files(tmp_path / "cal.json")
    expect(page.locator("#previous-words")).to_contain_text("cal.json: It still holds")
    page.locator("#refresh").check()
    expect(page.locator("#previous-words")).to_contain_text("cal.json: Its soft iron is kept")
    until(page, "flinders.store.state.refreshing && flinders.store.state.phase === 'good'")
    page.locator("#previous-clear").click()
    expect(page.locator("#previous-words")).not_to_contain_text("cal.json")
    page.locator("#previous-file").set_input_files({"name": "x.json", "mimeType": "", "buffer": b"{}"})
    expect(page.locator("#notices")).to_contain_text("x.json: it is no calibration file")


def test_a_report_is_one_file_with_verdict_figures_and_numbers(visitor: Visitor, tmp_path: Path) -> None:
    page = visitor.page()
    pasted(page, log_of(TUMBLE.field))
    until(page, "flinders.store.state.phase === 'good'")
    page.keyboard.press("f")
    expect(page.locator("#verdict")).to_have_attribute("data-verdict", "good")
    with page.expect_download() as started:
        page.locator("#save-report").click()
    started.value.save_as(tmp_path / "report.html")
    said = page.locator("#verdict-words").text_content() or ""
    report = visitor.context(offline=True).new_page()
    report.set_content((tmp_path / "report.html").read_text(encoding="utf-8"))
    expect(report.locator("h1")).to_have_text("Good")
    expect(report.locator(".sentence")).to_have_text(said)
    expect(report.locator("svg.figure")).to_have_count(7)
    expect(report.locator("table tbody tr")).to_have_count(3)
    expect(report.locator("main")).to_contain_text("pasted text")
    expect(report.locator(".findings")).to_contain_text("mounting angle")
    assert report.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


SIX: Final = "\n".join(
    f"{row % 7},{row % 5},{row % 3},{x:.3f},{y:.3f},{z:.3f}" for row, (x, y, z) in enumerate(TUMBLE.field)
)
"""Six columns without names, of which the last three are the magnetometer."""


def chosen_by_keyboard(page: Page) -> None:
    """Choose the fourth column as x, which makes the next ones y and z, and µT."""
    expect(page.locator("#columns-x")).to_be_focused()
    page.keyboard.type("column 4")
    expect(page.locator("#columns-z")).to_have_value("5")
    expect(page.locator("#columns-rows tr").first).to_have_text("123456")
    expect(page.locator("#columns-rows [data-axis=y]")).to_have_count(6)
    page.locator("#columns-unit").select_option("uT")
    page.locator("#columns-form .primary").press("Enter")
    expect(page.locator("#columns-panel")).to_be_hidden()


def test_somebody_says_which_columns_of_a_log_are_the_magnetometer(visitor: Visitor, axe: str, tmp_path: Path) -> None:
    page = visitor.page()
    pasted(page, SIX)
    expect(page.locator("#columns-words")).to_contain_text("6 columns and no header")
    assert not grave(page, axe)
    page.keyboard.press("Escape")
    expect(page.locator("#start-answer")).to_contain_text("6 columns and no header")
    pasted(page, SIX)
    chosen_by_keyboard(page)
    until(page, "flinders.store.state.phase === 'good'")
    (tmp_path / "six.csv").write_text(SIX)
    fit = flinders.fit(flinders.read(tmp_path / "six.csv", columns="4,5,6", unit="uT"))
    np.testing.assert_allclose(page.evaluate("flinders.store.view.offset"), fit.calibration.offset, atol=0.02)
    assert page.evaluate("flinders.store.view.unit") == "µT"


def test_somebody_says_which_columns_of_a_port_are_the_magnetometer(visitor: Visitor, context: BrowserContext) -> None:
    page = visitor.page(context)
    connected(page)
    lines = SIX.splitlines(keepends=True)
    page.evaluate("text => board.print(text)", "".join(lines[:100]))
    chosen_by_keyboard(page)
    until(page, "flinders.connection.source.lines.choice")
    page.evaluate("text => board.print(text)", "".join(lines[100:]))
    until(page, f"flinders.store.state.readings > {len(lines) - 110}")
    latest = page.evaluate("flinders.connection.session.live.buffer.latest[0]")
    assert latest == pytest.approx(TUMBLE.field[-2, 0], abs=1e-3), "the last line has no end"


def test_what_an_accelerometer_felt_in_a_log_counts_as_in_the_program(visitor: Visitor, tmp_path: Path) -> None:
    turn = felt(level(), 5.0)
    columns = np.column_stack([0.02 * np.arange(len(turn)), turn.field, np.asarray(turn.acceleration)])
    path = tmp_path / "turn.csv"
    header = "t_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x,acc_y,acc_z"
    np.savetxt(path, columns, fmt="%.4f", delimiter=",", header=header, comments="")
    samples = flinders.read(path)
    fit = flinders.fit(samples)
    assert fit.evidence.z_down is True
    page = visitor.page()
    page.locator("#log-file").set_input_files(path)
    until(page, "flinders.store.view?.samples > 0")
    assert page.evaluate("flinders.store.view.sentence") == view(fit, samples).sentence
    page.keyboard.press("f")
    with page.expect_download() as started:
        page.locator("#save-calibration").click()
    started.value.save_as(tmp_path / "cal.json")
    saved = flinders.load(tmp_path / "cal.json")
    assert saved.evidence.z_down is True
    assert [each.code for each in saved.findings] == [each.code for each in fit.findings]


SIZES_OF: Final = """() => ["#hand > svg", "#scene"].map(part => {
    const { width, height } = document.querySelector(part).getBoundingClientRect();
    return width * height;
})"""


def test_the_thing_in_the_hand_is_chosen_once_and_is_the_largest_object(visitor: Visitor) -> None:
    page = visitor.page(visitor.context(viewport={"width": 1280, "height": 720}))
    page.locator("#use-simulation").click()
    expect(page.locator("#advice-words")).to_have_text("Turn it half around, like a wheel.")
    assert page.locator("#hand .bodies button").count() == 6
    page.locator('#hand .bodies button[data-body="boat"]').click()
    expect(page.locator("#advice-words")).to_contain_text("Steer one slow circle")
    expect(page.locator("#hand .bodies")).to_be_hidden()
    hand, sphere = page.evaluate(SIZES_OF)
    assert hand > sphere
    page.locator("#hand .in-hand").click()
    page.locator('#hand .bodies button[data-body="phone"]').click()
    page.reload()
    page.locator("#use-simulation").click()
    expect(page.locator("#hand .in-hand")).to_have_text("Phone")
    for width, height in ((844, 390), (640, 360)):
        page.set_viewport_size({"width": width, "height": height})
        expect(page.locator("#advice-words")).to_be_in_viewport(ratio=1)
        expect(page.locator("#hand > svg")).to_be_in_viewport(ratio=0.95)
        expect(page.locator(".status")).to_be_hidden()
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


@pytest.mark.tools
def test_what_the_page_cannot_read_is_refused_with_advice(visitor: Visitor) -> None:
    page = visitor.page()
    page.locator("#log-file").set_input_files(
        {"name": "flight.ulg", "mimeType": "", "buffer": b"ULog\x01\x12\x35\x01" * 9}
    )
    expect(page.locator("#notices")).to_contain_text("flinders calibrate")
    pasted(page, "these are\nno readings\n")
    expect(page.locator("#start-answer")).not_to_be_empty()
    page.locator("#use-phone").click()
    expect(page.locator("#start-answer")).to_contain_text("magnetometer")
    page.evaluate("flinders.connection.send({type: 'place', latitude_deg: 1, longitude_deg: 1, year: 2019})")
    expect(page.locator("#notices")).to_contain_text("type it as dip")
    pasted(page, log_of(TUMBLE.field))
    until(page, "flinders.store.state.phase === 'good'")
    expect(page.locator("#source-name")).to_have_text("pasted text")


@pytest.mark.tools
def test_the_place_sets_dip_and_strength(visitor: Visitor) -> None:
    page = visitor.page()
    pasted(page, log_of(TUMBLE.field))
    until(page, "flinders.store.state.phase === 'good'")
    page.get_by_role("button", name="Set dip from place").click()
    page.locator("#latitude").fill("48.2")
    page.locator("#longitude").fill("16.4")
    page.keyboard.press("Enter")
    expect(page.locator("#notices")).to_contain_text("the strength of the field")
    until(page, "flinders.store.state.dip_deg > 64 && flinders.store.state.dip_deg < 66")
    until(page, "flinders.store.view.field_strength_known && Math.abs(flinders.store.view.field_strength - 49) < 1")


@pytest.mark.tools
def test_an_engine_that_does_not_come_is_said(visitor: Visitor) -> None:
    context = visitor.context()
    context.route("**/flinders.wasm", lambda route: route.fulfill(status=404))
    page = visitor.page(context)
    pasted(page, log_of(TUMBLE.field[:200]))
    expect(page.locator("#phase-words")).to_contain_text("could not be fitted in this browser")
    visitor.forgive(404)


READ_EACH: Final = """async (shapes) => {
    const { connection } = flinders;
    const until = async (isSo) => { while (!isSo()) await new Promise((done) => setTimeout(done, 5)); };
    const counts = [];
    for (const lines of shapes) {
        const before = connection.source;
        document.getElementById("use-board").click();
        await until(() => connection.source !== before);
        board.print(lines);
        await until(() => connection.session.live.buffer.total > 50);
        counts.push(connection.session.live.buffer.total);
        connection.send({ type: "clear" });
    }
    return counts;
}"""


@pytest.mark.tools
def test_every_shape_of_lines_is_read_from_a_port(visitor: Visitor, context: BrowserContext) -> None:
    page = visitor.page(context)
    page.locator("#baud").select_option("9600")
    unasked = [shape for shape in SHAPES if not {"pattern", "columns"} & set(shape) and shape["name"] not in UNREAD]
    texts = ["\n".join([*chain.from_iterable(printed(shape, TUMBLE[:600:10])[0]), ""]) for shape in unasked]
    counts = page.evaluate(READ_EACH, texts)
    assert len(counts) >= 48
    assert set(counts) <= {59, 60}, "of some shapes the first line may be cut, or the last reading has no end"
    assert page.evaluate("board.baud") == 9600


ECHOES: Final = """
void (board.take = (bytes) => {
    const view = new DataView(bytes.buffer, bytes.byteOffset);
    const line = (name, places) => `${name}:${places.map((at) => view.getFloat32(2 + 4 * at, true).toFixed(3))}\\r\\n`;
    board.print(line("Cal1", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]) + line("Cal2", [10, 13, 14, 13, 11, 15, 14, 15, 12]));
})
"""
"""A board that says what it was sent, as sketches for MotionCal do."""


def test_a_calibration_is_sent_to_the_board_and_its_echo_confirms_it(visitor: Visitor, context: BrowserContext) -> None:
    page = visitor.page(context)
    connected(page)
    page.evaluate(ECHOES)
    lines = "".join(f"Raw:0,0,0,0,0,0,{x:.0f},{y:.0f},{z:.0f}\r\n" for x, y, z in 10 * TUMBLE.field)
    page.evaluate("lines => board.print(lines)", lines)
    until(page, "flinders.store.state.phase === 'good'")
    page.keyboard.press("f")
    page.locator("#send").click()
    expect(page.locator("#answer")).to_contain_text("The board: confirmed by the board's echo, to 3 decimals")
    page.locator("dialog[open] .shut").click()
    page.evaluate("board.take = null")
    page.evaluate("board.unplug()")
    page.keyboard.press("f")
    page.locator("#send").click()
    expect(page.locator("#answer")).to_contain_text("plug it in")


@pytest.mark.tools
def test_a_board_is_lost_comes_back_and_outlives_a_reload(visitor: Visitor, context: BrowserContext) -> None:
    page = visitor.page(context)
    lines = [f"Raw:0,0,0,0,0,0,{x:.0f},{y:.0f},{z:.0f}\r\n" for x, y, z in 10 * TUMBLE.field]
    connected(page)
    page.evaluate("lines => board.print(lines)", "".join(lines[:1500]))
    until(page, "flinders.store.state.readings === 1500")
    page.evaluate("board.unplug()")
    expect(page.locator("#phase")).to_contain_text("wrong", ignore_case=True)
    expect(page.locator("#advice-words")).to_contain_text("plug it in again")
    page.evaluate("board.plug()")
    until(page, "flinders.store.state.source.link === 'connected'")
    page.evaluate("lines => board.print(lines)", "".join(lines[1500:]))
    until(page, "flinders.store.state.readings === 3000")
    asked: list[str] = []

    def accept(dialog: Dialog) -> None:
        asked.append(dialog.type)
        dialog.accept()

    page.on("dialog", accept)
    page.reload()
    until(page, "window.flinders?.store.state?.readings === 3000")
    assert asked == ["beforeunload"]
    expect(page.locator("#source-name")).to_have_text("the board")
    expect(page.locator("#start")).to_be_hidden()
    with page.expect_download() as started:
        page.keyboard.press("f")
        page.locator("#save-session").click()
    assert started.value.path().read_text(encoding="utf-8").count("\n") == 3001
    page.keyboard.press("Escape")
    page.locator("#use-simulation").evaluate("button => button.click()")  # saved, so that another source may follow
    until(page, "flinders.store.state.source.kind === 'simulated' && flinders.store.state.readings > 20")
    page.reload()
    expect(page.locator("#start")).to_be_visible()


@pytest.mark.tools
def test_a_phone_that_asks_its_own_sensor(visitor: Visitor, axe: str) -> None:
    context = visitor.context(**PHONE)
    context.add_init_script("""
        window.Magnetometer = class extends EventTarget {
            start() { window.sensor = this; }
            stop() {}
            measure(x, y, z) {
                Object.assign(this, { x, y, z, timestamp: performance.now() });
                this.dispatchEvent(new Event("reading"));
            }
        };
    """)
    page = visitor.page(context)
    assert grave(page, axe) == []
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    page.locator("#use-phone").tap()
    page.evaluate("rows => rows.forEach(row => sensor.measure(...row))", TUMBLE.field.tolist())
    until(page, "flinders.store.state.phase === 'good'")
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    page.evaluate("""() => {
        const refused = new Event("error");
        refused.error = new DOMException("no", "NotAllowedError");
        sensor.dispatchEvent(refused);
    }""")
    expect(page.locator("#advice-words")).to_contain_text("allow")


@pytest.mark.tools
def test_the_simulation_by_keyboard_and_without_a_network(browser: Browser, folder: Path) -> None:
    with Site(folder, "/") as site:
        visitor = Visitor(browser, site)
        context = visitor.context()
        page = visitor.page(context)
        page.evaluate("navigator.serviceWorker.ready.then(() => {})")
        page.reload()
        until(page, "window.flinders?.store.hello && navigator.serviceWorker.controller")
    page.goto(f"{site.address}index.html?speed=30")  # nobody answers any more
    until(page, "window.flinders?.store.hello")
    page.locator("#use-simulation").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#notices")).to_contain_text("turns the sensor over")
    until(page, "flinders.store.state.phase === 'good'")
    page.keyboard.press("p")
    until(page, "flinders.store.state.paused")
    page.keyboard.press("n")
    page.locator("#confirmed").click()
    until(page, "!flinders.store.state.paused && flinders.store.points.count > 5")
    visitor.leave()
    visitor.close()


def test_the_folder_says_what_it_is(folder: Path) -> None:
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "unsafe-inline" not in page
    assert "'unsafe-eval'" not in page
    worker = (folder / "sw.js").read_text(encoding="utf-8")
    listed = json.loads(worker.partition("const PAGE = ")[2].partition(";\n")[0])
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*") if path.is_file()}
    loaded_on_demand = {name for name in present if name.startswith(listed["kept"])}
    assert loaded_on_demand == {f"languages/{code}.json" for code in ("de", "el")}
    assert {*listed["files"], listed["scene"]} - {"./"} == present - {"index.html", "sw.js"} - loaded_on_demand


@pytest.mark.tools
def test_what_was_finished_outlives_a_reload(visitor: Visitor, context: BrowserContext) -> None:
    page = visitor.page(context)
    lines = [f"Raw:0,0,0,0,0,0,{x:.0f},{y:.0f},{z:.0f}\r\n" for x, y, z in 10 * TUMBLE.field]
    connected(page)
    page.evaluate("lines => board.print(lines)", "".join(lines[:2000]))
    until(page, "flinders.store.state.readings === 2000 && flinders.store.state.phase === 'good'")
    page.keyboard.press("f")
    expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
    text = page.locator("#preview").text_content()
    page.evaluate("lines => board.print(lines)", "".join(lines[2000:]))
    until(page, "flinders.store.state.finished?.since === 1000")
    assert page.locator("#preview").text_content() == text
    page.on("dialog", lambda dialog: dialog.accept())
    page.reload()
    until(page, "window.flinders?.store.state?.finished?.since === 1000 && flinders.store.state.phase === 'good'")
    page.keyboard.press("f")
    expect(page.locator("#preview")).to_contain_text("correctMagnetometer")
    assert page.locator("#preview").text_content() == text
    page.locator("#collect").click()
    until(page, "flinders.store.state.finished === null && flinders.store.state.used > 2500")
