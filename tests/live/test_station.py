"""A station over a board: what ends in its table, whatever operator, board, disk and power do."""

from __future__ import annotations

import csv
import json
import queue
import threading
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.waiting import wait_until

from flinders import simulate
from flinders.apps.live.access import Gate
from flinders.apps.live.hub import Hub
from flinders.apps.live.messages import Edits
from flinders.apps.live.server import application
from flinders.apps.live.session_file import Supply
from flinders.apps.live.standalone.package import live_data
from flinders.apps.live.station.bench import Station
from flinders.apps.live.station.folder import StationFolder
from flinders.apps.live.station.plan import plan_of, read_plan
from flinders.apps.live.station.recordings import SerialNumberSource, UnitSink
from flinders.apps.live.station.routes import routes_of
from flinders.apps.live.station.table import COLUMNS, StationTable
from flinders.core import calibration_file
from flinders.core.axes import Axes
from flinders.errors import LinkError, OutputError, UsageError
from flinders.links.recorder import Recorder

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # that its client may be another one some day
    from starlette.testclient import TestClient

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HOST = "127.0.0.1:8410"
OWN = {"host": HOST, "origin": f"http://{HOST}"}
TUMBLE = simulate.tumble(seed=3, noise=0.3)


class WiredBoard:
    """The other end of a wire: what a test sends, and whether it is plugged in."""

    name, is_framed = "the board", True

    def __init__(self) -> None:
        self._sent: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self.is_plugged = threading.Event()
        self.is_plugged.set()

    def send(self, *lines: str) -> None:
        self._sent.put("".join(f"{line}\n" for line in lines).encode())

    def read(self, timeout: float) -> bytes:
        if not self.is_plugged.is_set():
            raise LinkError("the board is gone: check the cable")
        try:
            return self._sent.get(timeout=min(timeout, 0.01))
        except queue.Empty:
            return b""

    def write(self, content: bytes) -> None:
        pass

    def reopen(self) -> None:
        if not self.is_plugged.is_set():
            raise LinkError("the board is gone: check the cable")

    def close(self) -> None:
        pass


def lines_of(samples: Any = TUMBLE.samples, count: int = 2500) -> list[str]:  # noqa: ANN401 - samples
    """Rows of a board in µT, fifty a second."""
    field = samples.field[:count]
    return [f"{0.02 * place:.2f},{x:.3f},{y:.3f},{z:.3f}" for place, (x, y, z) in enumerate(field.tolist())]


def full(*_: object) -> None:
    """Write into a table on a full disk."""
    raise OutputError("table.csv: cannot be written: no space left on the disk")


class Line:
    """A station whose board and clock are the test's."""

    def __init__(self, folder: Path, plan: str = "", unit: str = "uT") -> None:
        self.path = folder
        self.plan = plan_of(plan)
        self.board, self.now = WiredBoard(), 0.0
        self.said: list[str] = []
        self.folder = StationFolder(folder)
        sink = UnitSink(self.said.append)
        wire = SerialNumberSource(self.board, self.plan.serial.board_line) if self.plan.serial.board_line else None
        reading: dict[str, Any] = {"unit": unit, "columns": "2,3,4"}
        edits = Edits(paused_s=0.0, target_deg=self.plan.limits.heading_error_deg)
        feed = Recorder(wire or self.board, sink, **reading)
        supply = Supply(feed, "serial", sink, folder, Axes(), None, reading, edits)
        self.station = Station(Hub(supply), sink, self.folder, self.plan, board=wire, clock=lambda: self.now)
        self.station.recover()
        gate = Gate.of("127.0.0.1", 8410, ("bench",))
        app = application(self.station.hub, gate, None, print, live_data, routes_of(self.station))
        self.client = TestClient(app, base_url=f"http://{HOST}", raise_server_exceptions=False)

    def __enter__(self) -> Line:
        self.client.__enter__()
        self.send("starting")  # so that it is there before a unit is
        return self

    def __exit__(self, *_: object) -> None:
        self.client.__exit__(None, None, None)
        self.folder.close()

    def send(self, *lines: str) -> None:
        self.board.send(*lines)

    def do(self, what: str, status: int = 200, **more: object) -> dict[str, Any]:
        answer = self.client.post("/station", content=json.dumps({"do": what, **more}), headers=OWN)
        assert answer.status_code == status, answer.text
        said: dict[str, Any] = answer.json()
        return said

    @property
    def state(self) -> dict[str, Any]:
        said: dict[str, Any] = self.client.get("/station.json", headers=OWN).json()
        return said

    def test(self, serial: str, lines: list[str], *, again: bool = False) -> dict[str, Any]:
        """Test a unit that sends these lines."""
        assert self.do("start", serial=serial, again=again)["phase"] == "testing"
        if lines:
            before = self.station.hub.log.buffer.total
            self.send(*lines)
            wait_until(lambda: self.station.hub.log.buffer.total >= before + len(lines), lambda: self.state)
        ended: dict[str, Any] = self.do("finish")["result"]
        return ended

    @property
    def rows(self) -> list[dict[str, str]]:
        with (self.path / "table.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    with Line(tmp_path / "line") as line:
        yield line


def test_a_good_unit_passes_with_its_files_and_a_row(line: Line) -> None:
    assert line.test("A17", lines_of())["result"] == "pass"
    (row,) = line.rows
    assert (row["unit"], row["result"], row["verdict"], row["code"]) == ("A17", "pass", "good", "")
    assert (int(row["readings"]), row["unit_of_field"]) == (2500, "uT")
    offset = [float(row[f"offset_{axis}"]) for axis in "xyz"]
    npt.assert_allclose(offset, TUMBLE.sensor.offset, atol=0.3)
    kept = line.path / "calibrations" / row["recording"].replace(".csv", ".json")
    npt.assert_allclose(calibration_file.read(kept).calibration.offset, offset, rtol=1e-9)
    recorded = (line.path / "recordings" / row["recording"]).read_text(encoding="utf-8")
    assert recorded.count("\n") > 2500


def test_each_unit_has_its_own_readings_alone(line: Line) -> None:
    line.test("A17", lines_of())
    line.send(*lines_of(count=40))  # on the way to the next unit
    other = simulate.tumble(seed=8, noise=0.3)
    wait_until(lambda: line.station.hub.log.buffer.total >= 2540)
    line.do("next")
    line.test("B02", lines_of(other.samples))
    first, second = line.rows
    assert (first["readings"], second["readings"]) == ("2500", "2500")
    npt.assert_allclose([float(second[f"offset_{axis}"]) for axis in "xyz"], other.sensor.offset, atol=0.3)


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        ("noise = 0.1", "noise"),
        ("strength = [10, 20]", "strength"),
        ("offset = [-1, 1]", "offset-x"),
        ("coverage = 1.0", "coverage-share"),
        ('unit = "counts"\nnoise = 5', "other-unit"),
        ("heading_error_deg = 0.001", "heading-error"),
    ],
)
def test_a_unit_outside_a_limit_fails_with_its_reason(tmp_path: Path, limits: str, code: str) -> None:
    with Line(tmp_path, f"[limits]\n{limits}") as line:
        ended = line.test("A17", lines_of())
        assert ended["result"] == "fail"
        assert ended["reasons"][0]["code"] == code
        assert ended["reasons"][0]["remedy"]
        (row,) = line.rows
        assert (row["result"], row["code"]) == ("fail", code)


def test_a_unit_that_was_hardly_turned_fails_by_the_verdict_of_the_engine(line: Line) -> None:
    still = np.array([22.0, -8.0, 41.0]) + 0.3 * np.random.default_rng(1).normal(size=(300, 3))
    rows = [f"{0.02 * place:.2f},{x:.3f},{y:.3f},{z:.3f}" for place, (x, y, z) in enumerate(still.tolist())]
    assert line.test("A17", rows)["result"] == "fail"
    assert line.rows[0]["verdict"] == "refused"
    assert line.rows[0]["code"]
    assert not (line.path / "calibrations").exists()


def test_a_serial_number_that_was_scanned_twice_is_one_test(line: Line) -> None:
    line.do("start", serial="A17")
    assert line.do("start", serial="A17")["phase"] == "testing"
    line.send(*lines_of())
    line.do("finish")
    assert len(line.rows) == 1


def test_a_unit_that_was_tested_before_is_asked_about_and_gets_a_row_of_its_own(line: Line) -> None:
    line.test("A17", lines_of())
    asked = line.do("start", serial="A17")
    assert (asked["phase"], asked["serial"]) == ("confirm", "A17")
    assert line.do("abort")["phase"] == "ready"
    line.do("start", serial="A17")
    assert line.test("", lines_of(), again=True)["result"] == "pass"
    assert [row["unit"] for row in line.rows] == ["A17", "A17"]
    assert len({row["recording"] for row in line.rows}) == 2


def test_units_of_a_study_are_tested_again_without_a_question(tmp_path: Path) -> None:
    with Line(tmp_path, "[serial]\nrepeats = true") as line:
        line.test("A17", lines_of())
        assert line.test("A17", lines_of())["result"] == "pass"


def test_a_test_that_is_stopped_keeps_its_recording_and_a_row(line: Line) -> None:
    line.do("start", serial="A17")
    line.send(*lines_of(count=100))
    wait_until(lambda: line.station.hub.log.buffer.total >= 100)
    assert line.do("abort")["result"]["result"] == "aborted"
    (row,) = line.rows
    assert (row["result"], row["code"], row["verdict"]) == ("aborted", "aborted", "")
    assert "1.98," in (line.path / "recordings" / row["recording"]).read_text(encoding="utf-8")


def test_a_cable_that_comes_loose_fails_the_unit_where_it_stays_so(line: Line) -> None:
    line.do("start", serial="A17")
    line.send(*lines_of(count=200))
    wait_until(lambda: line.station.hub.log.buffer.total >= 200)
    line.board.is_plugged.clear()
    wait_until(lambda: line.station.hub.source.link == "gone")
    assert line.do("finish")["result"]["reasons"][0]["code"] == "sensor-gone"


def test_a_cable_that_comes_back_costs_nothing(line: Line) -> None:
    line.do("start", serial="A17")
    lines = lines_of()
    line.send(*lines[:1200])
    wait_until(lambda: line.station.hub.log.buffer.total >= 1200)
    line.board.is_plugged.clear()
    wait_until(lambda: line.station.hub.source.link == "gone")
    line.board.is_plugged.set()
    line.send(*lines[1200:])
    wait_until(lambda: line.station.hub.log.buffer.total >= 2500)
    assert line.do("finish")["result"]["result"] == "pass"


def test_a_unit_that_sends_nothing_fails(line: Line) -> None:
    assert line.test("A17", [])["reasons"][0]["code"] == "no-readings"


def test_a_unit_is_judged_when_its_time_is_over_though_nobody_looks(tmp_path: Path) -> None:
    with Line(tmp_path, "[limits]\ntime_s = 30") as line:
        line.do("start", serial="A17")
        line.send(*lines_of())
        wait_until(lambda: line.station.hub.log.buffer.total >= 2500)
        line.now = 31.0
        wait_until(lambda: line.station.phase == "result")
        assert line.rows[0]["result"] == "pass"


def test_a_power_failure_in_the_middle_of_a_unit_leaves_its_recording_and_a_row(tmp_path: Path) -> None:
    with Line(tmp_path) as line:
        line.test("A17", lines_of())
        line.do("start", serial="B02")
        line.send(*lines_of(count=500))
        wait_until(lambda: line.station.hub.log.buffer.total >= 500)
    with (tmp_path / "table.csv").open("a", encoding="utf-8") as file:
        file.write("B02,half a ro")  # what a disk may keep of the last write
    with Line(tmp_path) as again:
        assert [(row["unit"], row["result"], row["code"]) for row in again.rows] == [
            ("A17", "pass", ""),
            ("B02", "aborted", "interrupted"),
        ]
        assert (tmp_path / "recordings" / again.rows[1]["recording"]).read_text(encoding="utf-8").count("\n") > 500
        again.do("start", serial="B02")
        assert again.test("", lines_of(), again=True)["result"] == "pass"
        assert len(again.rows) == 3


def test_a_table_that_cannot_be_written_holds_the_next_unit_back(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    line.do("start", serial="A17")
    line.send(*lines_of())
    wait_until(lambda: line.station.hub.log.buffer.total >= 2500)
    with monkeypatch.context() as patch:
        patch.setattr(StationTable, "append", full)
        ended = line.do("finish")
        assert ended["result"]["result"] == "pass"
        assert ended["trouble"]
        line.do("start", status=409, serial="B02")
    assert line.do("start", serial="B02")["phase"] == "testing"
    assert [row["unit"] for row in line.rows] == ["A17"]


def test_a_result_that_waited_for_room_is_the_only_row_of_its_test(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(StationTable, "append", full)
        assert line.test("A17", lines_of())["result"] == "pass"
        assert line.station.state.trouble
    assert line.station.recover() is None
    assert [row["result"] for row in line.rows] == ["pass"]
    assert not (line.path / "unfinished.json").exists()


def test_a_table_that_a_spreadsheet_has_changed_still_asks_about_its_units(line: Line) -> None:
    line.test("A17", lines_of())
    line.folder.table.rows[-1] |= {"result": "PASS", "began": "29.11.2026 10:32"}
    assert line.do("start", serial="A17")["asked"] == "A17 was tested before."


def test_a_fault_of_the_program_costs_no_row(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("broken")

    line.do("start", serial="A17")
    with monkeypatch.context() as patch:
        patch.setattr("flinders.apps.live.station.bench.judge_test", broken)
        line.client.post("/station", content='{"do": "finish"}', headers=OWN)
    assert (line.rows[0]["result"], line.rows[0]["code"]) == ("aborted", "fault")
    assert line.state["phase"] == "result"


def test_the_board_says_its_serial_number(tmp_path: Path) -> None:
    with Line(tmp_path, r"[serial]" + "\n" + r"board_line = 'serial: (\w+)'") as line:
        line.send("serial: C33")
        wait_until(lambda: line.state["board_serial"] == "C33")
        assert line.test("", lines_of())["serial"] == "C33"
        line.board.is_plugged.clear()
        wait_until(lambda: line.state["board_serial"] == "")


@pytest.mark.parametrize("serial", ["", "A 17", "../A17", "x" * 80])
def test_what_is_no_serial_number_is_refused(line: Line, serial: str) -> None:
    assert line.do("start", status=400, serial=serial)["code"] == "usage"
    assert line.state["phase"] == "ready"


def test_an_export_and_a_certificate_are_written_of_units_that_pass(tmp_path: Path) -> None:
    facts = 'laboratory = "Lab"\ncountry = "AU"\ncity = "Hobart"\nperson = "Ada"\ncustomer = "Line"'
    with Line(tmp_path, f'[export]\ntargets = ["arduino"]\n[certificate]\n{facts}') as line:
        assert line.test("A17", lines_of())["result"] == "pass"
        name = line.rows[0]["recording"].removesuffix(".csv")
        assert "A17" in next((tmp_path / "exports").glob(f"{name}.arduino.*")).read_text(encoding="utf-8")
        assert (tmp_path / "certificates" / f"{name}.xml").is_file()


def test_a_target_that_cannot_hold_the_calibration_fails_the_unit(tmp_path: Path) -> None:
    with Line(tmp_path, '[export]\ntargets = ["ardupilot"]', unit="counts") as line:
        ended = line.test("A17", lines_of())
        assert (ended["result"], ended["reasons"][0]["code"]) == ("fail", "not-exported")


def test_an_operator_is_in_the_rows_that_follow(line: Line) -> None:
    assert line.do("operator", name="  Ada  L. ")["operator"] == "Ada L."
    line.test("A17", lines_of())
    assert line.rows[0]["operator"] == "Ada L."


def test_two_stations_do_not_write_one_table(line: Line) -> None:
    with pytest.raises(OutputError):
        StationFolder(line.path)


def test_a_table_with_other_columns_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("unit,weight\nA17,3\n", encoding="utf-8")
    with pytest.raises(OutputError):
        StationFolder(tmp_path)
    assert (tmp_path / "table.csv").read_text(encoding="utf-8") == "unit,weight\nA17,3\n"
    assert COLUMNS[0] == "unit"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[limts]\n", "limits"),
        ("[limits]\nnois = 1\n", "noise"),
        ("[limits]\nnoise = 'low'\n", "limits.noise"),
        ("[limits]\nnoise = -1\n", "limits.noise"),
        ("[limits]\nstrength = [60, 20]\n", "limits.strength"),
        ("[limits]\nverdict = 'refused'\n", "limits.verdict"),
        ("[limits]\ntime_s = 0\n", "limits.time_s"),
        ("limits = 3\n", "limits"),
        ("[serial]\npattern = '('\n", "serial.pattern"),
        ("[serial]\nboard_line = 'serial'\n", "serial.board_line"),
        ("[motion]\nsteps = [{words = 'Turn it.', second = 3}]\n", "seconds"),
        ("[motion]\nbody = 'cat'\n", "motion.body"),
        ("[site]\ndip_deg = 95\n", "site.dip_deg"),
        ("[certificate]\nlaboratory = 'Lab'\n", "certificate"),
        ("[limits\n", "TOML"),
    ],
)
def test_a_mistake_in_the_file_of_a_station_is_named(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "line.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError) as caught:
        read_plan(path)
    assert word in str(caught.value)
    assert str(path) in str(caught.value)
