"""The wire: what a page gets, what it may ask for, and what is refused."""

from __future__ import annotations

import base64
import contextlib
import gzip
import io
import json
import re
import socket
import struct
import threading
import time
import warnings
import zipfile
import zlib
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import httpx
import msgspec
import numpy as np
import numpy.testing as npt
import pytest
from starlette.websockets import WebSocketDisconnect
from tests.message_types import station_types, typescript
from tests.sentences import assert_raises, assert_sentences
from tests.waiting import PATIENCE_S, Heartbeat, wait_until

import flinders
from flinders import simulate
from flinders.apps.live import messages, server, transfers
from flinders.apps.live.access import HEADERS, Gate, Tokens, cookie_name, open_listener, server_of
from flinders.apps.live.buffer import ReadingBuffer
from flinders.apps.live.hub import FRAME_ROWS, MAX_FINISHED, MAX_LOGS, UPLOAD_BYTES, Hub, Page
from flinders.apps.live.messages import MAGIC, MAX_MESSAGE_BYTES, MAX_SPANS, Edits, Notice, Previous, encode, parse
from flinders.apps.live.server import STATIC, application
from flinders.apps.live.session_file import Log, Supply, default_path, edits_in, line_of, read_edits
from flinders.apps.live.standalone.package import live_data
from flinders.core.axes import Axes
from flinders.core.calibration_file import loads
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.fitting import calibrate
from flinders.fitting.fit_file import fit_from
from flinders.likelihood.site_field import Site
from flinders.links import motioncal
from flinders.links.feed_recording import RecordedFeed
from flinders.links.feeds import Replay
from flinders.links.sinks import FileSink
from flinders.links.transports import ScriptedSource
from flinders.native import build
from flinders.targets import registry
from flinders.targets._target import MOUNTING_KINDS

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # that its client may be another one some day
    from starlette.testclient import TestClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from starlette.testclient import WebSocketTestSession

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.links.transports import ByteSource
    from flinders.targets.motioncal import MotionCalPacket

HOST = "127.0.0.1:8410"
OWN = {"host": HOST, "origin": f"http://{HOST}"}


class Bench:
    """A server with a page's client."""

    def __init__(
        self,
        folder: Path,
        samples: Samples,
        *,
        host: str = "127.0.0.1",
        tokens: Tokens | None = None,
        board: ByteSource | None = None,
        axes: str = "x,y,z",
        most: int | None = None,
    ) -> None:
        self.path = folder / "session.csv"
        self.sink = FileSink(self.path)
        feed = RecordedFeed(Replay(samples, speed=None), self.sink)
        buffer = ReadingBuffer.empty() if most is None else ReadingBuffer.empty(most)
        of = Axes.of(axes)
        supply = Supply(
            feed, "serial", self.sink, self.path, of, board=board, reading={"axes": axes}, log=Log(buffer, axes=of)
        )
        self.hub = Hub(supply)
        self.said: list[str] = []
        self.app = application(self.hub, Gate.of(host, 8410, ("bench",)), tokens, self.said.append, live_data)
        self.client = TestClient(self.app, base_url=f"http://{HOST}")

    def page(self) -> WebSocketTestSession:
        return self.client.websocket_connect("/socket", headers=OWN)

    def until(self, done: Callable[[Hub], bool]) -> None:
        wait_until(lambda: done(self.hub), lambda: (self.hub.source, self.hub.edits))

    def finish(self, edits: Edits | None = None, log: str = "", previous: str | None = None) -> httpx.Response:
        """Have the calibration of all readings made, renewing the calibration that has the number `previous`."""
        asked = {"previous": self.hub.previous.number if previous is None else previous}
        asked |= {"log": log} if log else {}
        content = encode(edits or self.hub.edits)
        answer: httpx.Response = self.client.post("/finish", params=asked, content=content, headers=OWN)
        return answer

    def of_finished(self, edits: Edits | None = None, log: str = "") -> str:
        """Have it made, and return how its exports are asked for."""
        answer = self.finish(edits, log)
        assert answer.status_code == 200, answer.text
        return f"?of={answer.json()['number']}"


def has_all(hub: Hub) -> bool:
    """All readings have come."""
    return hub.source.link == "ended"


@contextlib.contextmanager
def running(folder: Path) -> Iterator[Bench]:
    found = Bench(folder, simulate.tumble(seed=1).samples)
    with found.client:
        found.until(has_all)
        yield found
    found.sink.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A server for one test, which may change it."""
    with running(tmp_path) as found:
        yield found


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """A server for all tests that change nothing."""
    with running(tmp_path_factory.mktemp("wall")) as found:
        yield found


def received(socket: WebSocketTestSession, kind: str) -> dict[str, Any]:
    """The next text of a kind; whatever else comes is passed over."""
    while True:
        message = socket.receive()
        if message.get("text") is not None:
            found: dict[str, Any] = json.loads(message["text"])
            if found["type"] == kind:
                return found


@dataclass
class Readings:
    """What a frame holds, unpacked as a page does it."""

    generation: int
    first: int
    stride: int
    total: int
    is_last: bool
    is_microtesla: bool
    is_vehicle: bool
    latest: Floats
    time: Floats
    field: Floats
    acceleration: Floats | None

    @classmethod
    def of(cls, content: bytes) -> Readings:
        magic, generation, first, count, flags, stride, total, is_last = struct.unpack("<8I", content[:32])
        numbers = np.frombuffer(content, "<f8", offset=32)
        has_acceleration = bool(flags & 1)
        assert magic == MAGIC
        assert len(numbers) == 7 + count * (7 if has_acceleration else 4)
        latest, time, field, acceleration = np.split(numbers, np.cumsum([7, count, 3 * count]))
        return cls(
            generation, first, stride, total, bool(is_last), bool(flags & 2), bool(flags & 4), latest, time,
            field.reshape(-1, 3), acceleration.reshape(-1, 3) if has_acceleration else None,
        )  # fmt: skip


@dataclass
class Follower:
    """What a page has in memory, by the rule of its buffer."""

    generation: int = -1
    stride: int = 1
    rows: Floats = field(default_factory=lambda: np.empty((0, 4)))
    total: int = 0

    def take(self, got: Readings) -> None:
        if got.generation > self.generation:
            self.rows, self.stride = self.rows[:0], got.stride
        self.rows = self.rows[:: got.stride // self.stride]
        assert got.first == len(self.rows)
        self.rows = np.vstack([self.rows, np.column_stack([got.time, got.field])])
        self.generation, self.stride, self.total = got.generation, got.stride, got.total


def next_readings(socket: WebSocketTestSession) -> Readings:
    """The next frame of readings; whatever else comes is passed over."""
    while True:
        content = socket.receive().get("bytes")
        if content is not None:
            return Readings.of(bytes(content))


def all_readings(socket: WebSocketTestSession, follower: Follower | None = None) -> Follower:
    """All readings that have come, frame by frame."""
    follower = follower or Follower()
    is_last = False
    while not is_last:
        got = next_readings(socket)
        follower.take(got)
        is_last = got.is_last
    return follower


def kept(socket: WebSocketTestSession) -> dict[str, Any]:
    """The next edits that the server keeps."""
    found: dict[str, Any] = received(socket, "kept")["edits"]
    return found


def test_a_page_is_told_all_there_is_when_it_comes(wall: Bench) -> None:
    with wall.page() as socket:
        welcome = json.loads(socket.receive_text())
        got = next_readings(socket)
    assert welcome["type"] == "welcome"
    assert welcome["version"] == flinders.__version__
    assert [target["name"] for target in welcome["targets"]] == [
        "arduino",
        *(name for name, row in registry().items() if name != "arduino" and row.keeps not in MOUNTING_KINDS),
    ]
    assert welcome["source"]["link"] == "ended"
    assert welcome["edits"] == json.loads(encode(Edits()))
    assert (welcome["recording"], welcome["axes"], welcome["has_board"]) == (str(wall.path), "x,y,z", False)
    assert (got.generation, got.first, got.stride, got.total, got.is_last) == (1, 0, 1, 3000, True)
    samples = simulate.tumble(seed=1).samples
    assert samples.time is not None
    npt.assert_array_equal(got.time, samples.time)
    npt.assert_array_equal(got.field, samples.field)
    npt.assert_array_equal(got.latest[1:4], samples.field[-1])
    npt.assert_array_equal(got.acceleration, samples.acceleration)
    assert (got.is_microtesla, got.is_vehicle) == (True, False)


def test_readings_come_with_accelerations_in_counts_and_in_the_axes_of_the_vehicle(tmp_path: Path) -> None:
    samples = simulate.tumble(seed=3, n=1200).samples
    felt = np.random.default_rng(3).normal(size=samples.field.shape)
    felt[100:200] = np.nan
    bench = Bench(tmp_path, replace(samples, unit=Unit.of("counts"), acceleration=felt), axes="-y,x,z")
    with bench.client:
        bench.until(has_all)
        with bench.page() as socket:
            got = next_readings(socket)
    turn = Axes.of("-y,x,z")
    npt.assert_array_equal(got.field, turn.apply(samples.field))
    assert got.acceleration is not None
    npt.assert_array_equal(got.acceleration, turn.apply(felt))
    assert (got.is_microtesla, got.is_vehicle) == (False, True)
    bench.sink.close()


def test_a_clock_that_was_set_back_goes_on_in_what_pages_get(tmp_path: Path) -> None:
    samples = simulate.tumble(seed=1, n=1000).samples
    assert samples.time is not None
    times = np.where(np.arange(1000) < 400, samples.time, samples.time - 5.0)
    bench = Bench(tmp_path, replace(samples, time=times))
    with bench.client:
        bench.until(has_all)
        with bench.page() as socket:
            got = all_readings(socket)
    assert got.rows[399, 0] == got.rows[400, 0]
    npt.assert_allclose(np.diff(got.rows[:, 0])[400:], 0.02, atol=1e-9)
    npt.assert_array_equal(got.rows[:, 1:], samples.field)
    bench.sink.close()


@pytest.mark.parametrize("begins_early", [False, True])
def test_of_more_readings_than_memory_holds_a_page_gets_every_second_or_fourth(
    tmp_path: Path, begins_early: bool
) -> None:
    """However often it was told meanwhile, it has the same as one that comes in the end."""
    samples = simulate.tumble(seed=1).samples
    bench = Bench(tmp_path, samples, most=1000)
    page, follower = Page(), Follower()
    if begins_early:
        take = bench.hub._take

        def taking() -> None:
            take()
            while (content := bench.hub.frame(page)) is not None:
                follower.take(Readings.of(content))

        bench.hub._take = taking  # type: ignore[method-assign]
        bench.hub._feed_thread._feed = RecordedFeed(Replay(samples, speed=300.0), bench.sink)
    with bench.client:
        bench.until(has_all)
        with bench.page() as socket:
            got = all_readings(socket)
        if begins_early:
            assert follower.total == 3000
            npt.assert_array_equal(follower.rows, got.rows)
    assert (got.stride, got.total) == (4, 3000)
    npt.assert_array_equal(got.rows[:, 1:], samples.field[::4])
    bench.sink.close()


def test_many_readings_come_in_frames_of_bounded_size(tmp_path: Path) -> None:
    count = 2 * FRAME_ROWS + 5000
    samples = simulate.tumble(seed=1, n=count).samples
    bench = Bench(tmp_path, samples)
    page, sizes, follower = Page(), [], Follower()
    with bench.client:
        bench.until(has_all)
        while (content := bench.hub.frame(page)) is not None:
            got = Readings.of(content)
            sizes.append(len(got.time))
            follower.take(got)
            assert got.total == follower.rows.shape[0]
            assert got.is_last == (got.total == count)
    assert sizes == [FRAME_ROWS, FRAME_ROWS, 5000]
    npt.assert_array_equal(follower.rows[:, 1:], samples.field)
    bench.sink.close()


def test_begun_anew_pages_get_what_came_later(bench: Bench) -> None:
    with bench.page() as one, bench.page() as other:
        assert [all_readings(socket).generation for socket in (one, other)] == [1, 1]
        one.send_text(encode(Edits(begun_s=29.99)))
        for socket in (one, other):
            got = next_readings(socket)
            assert (got.generation, got.first, got.total) == (2, 0, 1500)
            assert got.time[0] == 30.0
    assert bench.finish().json()["view"]["samples"] == 1500


def test_of_a_session_too_long_for_memory_all_is_left_behind(tmp_path: Path) -> None:
    """The few that are in memory of what came later would count as too few."""
    bench = Bench(tmp_path, simulate.tumble(seed=1).samples, most=1000)
    with bench.client:
        bench.until(has_all)
        bench.hub.edit(Edits(begun_s=50.0))
        assert bench.hub.edits.begun_s == bench.hub.timeline.at
        assert (len(bench.hub.log.buffer), bench.hub.log.buffer.stride) == (0, 1)
    bench.sink.close()


def test_what_was_left_behind_stays_so_and_a_page_that_did_not_know_is_told(bench: Bench) -> None:
    """Its edits cross those of the page that has begun anew: the time stays, and it gets the readings once more."""
    with bench.page() as one, bench.page() as other:
        one.send_text(encode(Edits(begun_s=29.99)))
        while kept(one)["begun_s"] != 29.99:
            pass
        for begun_s in (None, 10.0):
            other.send_text(encode(Edits(begun_s=begun_s, target_deg=0.5)))
            for socket in (one, other):
                while (told := kept(socket))["target_deg"] != 0.5:
                    pass
                assert told["begun_s"] == 29.99
                assert next_readings(socket).total == 1500
            one.send_text(encode(Edits(begun_s=29.99, target_deg=2.0)))
            for socket in (one, other):
                while kept(socket)["target_deg"] != 2.0:
                    pass
    wait_until(lambda: read_edits(bench.path) == Edits(begun_s=29.99, target_deg=2.0))


def test_readings_that_have_not_come_cannot_be_left_behind(wall: Bench) -> None:
    with wall.page() as socket:
        socket.send_text(encode(Edits(begun_s=1e9)))
        assert "restart at 1e+09 s" in received(socket, "notice")["words"]
    assert wall.hub.generation == 1
    assert wall.hub.edits == Edits()


def test_what_one_page_does_both_see(bench: Bench) -> None:
    with bench.page() as one, bench.page() as other:
        rows = [all_readings(socket).rows for socket in (one, other)]
        one.send_text(encode(Edits(excluded=((1.0, 2.0),))))
        assert kept(other)["excluded"] == [[1.0, 2.0]]
        other.send_text(encode(Edits(dip_deg=-20.0)))
        while (told := kept(one))["excluded"]:
            pass
        assert told["dip_deg"] == -20.0
    npt.assert_array_equal(rows[0], rows[1])


def test_a_page_is_told_how_many_of_its_messages_were_heard(bench: Bench) -> None:
    """So it knows which edits are from before its own, which crossed them."""
    with bench.page() as one, bench.page() as other:
        for target_deg in (2.0, 3.0):
            one.send_text(encode(Edits(target_deg=target_deg)))
        one.send_text("nonsense")
        while (told := received(one, "kept"))["heard"] < 3:
            pass
        assert told["edits"]["target_deg"] == 3.0
        while (told := received(other, "kept"))["edits"]["target_deg"] != 3.0:
            pass
        assert told["heard"] == 0


def test_a_page_that_does_not_listen_keeps_the_newest_of_each_message() -> None:
    """Fifty notices, and no more; what is kept of edits is told whatever else has happened since."""
    page = Page()
    for number in range(200):
        page.queue_message(messages.Kept(Edits(target_deg=1.0 + number / 10.0), number))
        page.queue_message(Previous(f"{number}.json", "{}"))
        page.queue_message(Notice("info", f"{number}"))
    told = list(iter(page.next_message, None))
    assert [type(message).__name__ for message in told[:3]] == ["Kept", "Previous", "Notice"]
    assert told[0] == messages.Kept(Edits(target_deg=20.9), 199)
    assert [message.words for message in told[2:] if isinstance(message, Notice)] == [*map(str, range(150, 200))]


def test_a_page_that_comes_again_sees_the_same(bench: Bench) -> None:
    with bench.page() as socket:
        socket.send_text(encode(Edits(target_deg=0.5, excluded=((1.0, 2.0),))))
        assert kept(socket)["target_deg"] == 0.5
    seen = []
    for _ in range(2):
        with bench.page() as socket:
            seen.append((json.loads(socket.receive_text()), all_readings(socket)))
    assert seen[0][0] == seen[1][0]
    assert seen[0][0]["edits"]["target_deg"] == 0.5
    npt.assert_array_equal(seen[0][1].rows, seen[1][1].rows)


@pytest.mark.parametrize(
    "text",
    [
        "", "{}", "null", "[1]", "{", '{"type": "format_disk"}', '{"type": "exclude", "start_s": 1, "end_s": 2}',
        '{"type": "edits", "target_deg": "1"}', '{"type": "edits", "target_deg": true}',
        '{"type": "edits", "target_deg": -1}', '{"type": "edits", "target_deg": 5e-324}',
        '{"type": "edits", "target_deg": 181}', '{"type": "edits", "target_deg": 1e999}',
        '{"type": "edits", "target_deg": NaN}', '{"type": "edits", "begun_s": -1e999}',
        f'{{"type": "edits", "paused_s": 1{"0" * 400}}}', '{"type": "edits", "dip_deg": 90}',
        '{"type": "edits", "dip_deg": null, "dip_deg": -89.5}', '{"type": "edits", "goal": "money"}',
        '{"type": "edits", "excluded": [[2, 1]]}', '{"type": "edits", "excluded": [[1, 2, 3]]}',
        '{"type": "edits", "excluded": [[null, 1]]}', '{"type": "edits", "excluded": [[1, 3], [2, 4]]}',
        '{"type": "edits", "excluded": [[3, 4], [1, 2]]}', '{"type": "edits", "and": "more"}',
        f'{{"type": "edits", "excluded": {"[" * 30_000}',
        f'{{"type": "edits", "excluded": {[[place, place] for place in range(1001)]}}}',
        '{"type": "edits", "site": 5}', '{"type": "edits", "site": {"strength": 1e300}}',
        '{"type": "edits", "site": {"strength": -50}}',
        '{"type": "edits", "site": {"inclination_deg": 200}}', '{"type": "edits", "site": {"gain_sigma": 0}}',
        '{"type": "edits", "site": {"gain_sigma": null}}', '{"type": "edits", "refreshing": 1}',
        '{"type": "previous", "name": "x", "text": "{}"}', '{"type": "previous", "text": "", "and": "more"}',
    ],
    ids=lambda text: text[:60],
)  # fmt: skip
def test_what_is_no_message_is_refused_in_words_and_changes_nothing(wall: Bench, text: str) -> None:
    with wall.page() as socket:
        socket.send_text(text)
        told = received(socket, "kept")
        notice = received(socket, "notice")
    assert notice["severity"] == "error"
    assert "Traceback" not in notice["words"]
    assert told == {"type": "kept", "edits": json.loads(encode(Edits())), "heard": 1}
    assert wall.hub.edits == Edits()
    assert wall.hub.previous == Previous()


def test_there_are_as_many_stretches_as_a_page_may_take_out() -> None:
    spans = tuple((2.0 * number, 2.0 * number + 1.0) for number in range(MAX_SPANS))
    edits = Edits(excluded=spans)
    assert parse(encode(edits)) == edits
    assert len(encode(edits)) < MAX_MESSAGE_BYTES


def test_text_that_is_no_unicode_is_no_message() -> None:
    with assert_raises(UsageError):
        parse("\ud800")


def test_bytes_are_no_message(wall: Bench) -> None:
    with wall.page() as socket:
        socket.send_bytes(b"\x00\xff")
        assert "text" in received(socket, "notice")["words"]


def test_ten_thousand_fuzzed_messages_change_nothing(wall: Bench) -> None:
    """Those that mean something all the same are left out here: a digit of a number became another one."""
    rng = np.random.default_rng(1)
    good = [b'{"type":"edits","excluded":[[1,2]]}', b'{"type":"edits","target_deg":0.5}', b'{"type":"edits"}']
    refused = 0
    with wall.page() as socket:
        for number in range(10_000):
            content = bytearray(good[number % 3])
            for place in rng.integers(0, len(content), rng.integers(1, 8)):
                content[place] = rng.integers(0, 256)
            text = bytes(content).decode("latin-1")
            try:
                parse(text)
            except UsageError:
                refused += 1
                if number % 50 == 0:  # those that go through the socket
                    socket.send_text(text)
        socket.send_text("the end")
        socket.send_text("")
        while "truncated" not in received(socket, "notice")["words"]:
            assert len(wall.hub.pages) == 1
    assert refused > 9_000
    assert wall.hub.edits == Edits()
    assert wall.hub.log.buffer.total == 3000


def test_every_answer_has_the_headers(wall: Bench) -> None:
    for path in ("/", "/nothing-there", "/export/json", "/page.json", "/session.csv", "/static/messages.d.ts"):
        answer = wall.client.get(path)
        for name in HEADERS:
            assert name in answer.headers, (path, name)
    assert wall.client.get("/").status_code == 200


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/page.json", "application/json"), ("/static/page.js", "text/javascript"),
        ("/static/worker.js", "text/javascript"), ("/static/views/scene.js", "text/javascript"), ("/", "text/html"),
    ],
)  # fmt: skip
def test_the_page_and_what_it_is_made_of_come_with_their_types(wall: Bench, path: str, kind: str) -> None:
    answer = wall.client.get(path)
    assert answer.status_code == 200
    assert answer.headers["content-type"].partition(";")[0] == kind


def test_the_tables_of_the_page_are_those_of_the_program(wall: Bench) -> None:
    assert set(wall.client.get("/page.json").json()) >= {"engine", "targets"}


def test_the_engine_of_the_page_comes_as_webassembly(
    wall: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "flinders.wasm"
    module.write_bytes(b"\0asm\1\0\0\0")
    asked: list[build.Platform] = []

    def library(*, target: build.Platform) -> Path:
        asked.append(target)
        return module

    monkeypatch.setattr(build, "library", library)
    answer = wall.client.get("/flinders.wasm")
    assert (answer.status_code, answer.content) == (200, module.read_bytes())
    assert answer.headers["content-type"] == "application/wasm"
    assert asked == [build.WEB_PLATFORM]


def test_where_the_engine_cannot_be_compiled_for_browsers_the_page_is_told_what_to_install(
    wall: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def library(**_: object) -> Path:
        raise build.NoCompiler("ziglang is needed to compile for wasm32-wasi: run 'pip install ziglang'")

    monkeypatch.setattr(build, "library", library)
    answer = wall.client.get("/flinders.wasm")
    assert answer.status_code == 501
    assert "pip install ziglang" in answer.json()["words"]


def test_the_calibration_is_that_of_flinders_calibrate(wall: Bench) -> None:
    told = wall.finish().json()
    answer = wall.client.get(f"/calibration.json?of={told['number']}")
    document = loads(answer.content)
    fit = flinders.fit(flinders.open_recording(wall.path))
    assert document.fit is not None
    assert document.fit.samples == fit.evidence.samples > 2900
    npt.assert_array_equal(document.calibration.offset, fit.calibration.offset)
    npt.assert_array_equal(document.calibration.matrix, fit.calibration.matrix)
    assert document.provenance is not None
    assert document.provenance.files[0].name == "session.csv"
    assert "attachment" in answer.headers["content-disposition"]
    assert (told["name"], told["refusal"]) == ("session.csv", "")
    assert told["view"]["samples"] == fit.evidence.samples
    assert told["view"]["verdict"] == fit.verdict


def test_what_is_taken_out_is_not_in_the_calibration_and_is_written_down(bench: Bench) -> None:
    edits = Edits(excluded=((0.0, 30.0),), paused_s=59.0)
    with bench.page() as socket:
        socket.send_text(encode(edits))
        kept(socket)
    document = loads(bench.client.get(f"/calibration.json{bench.of_finished()}").content)
    assert document.fit is not None
    assert document.fit.samples == 3000 - 1501 - 50
    wait_until(lambda: read_edits(bench.path) == edits)
    assert len(flinders.read(bench.path)) == 3000


def test_a_calibration_is_of_the_edits_that_are_asked_for(bench: Bench) -> None:
    """Those of the page that asks, whatever the session's are by then; they change nothing."""
    for excluded, samples in ((((0.0, 30.0),), 1499), (((0.0, 30.0), (59.0, 60.0)), 1449)):
        answer = bench.finish(Edits(excluded=excluded)).json()
        assert answer["view"]["samples"] == samples
        document = loads(bench.client.get(f"/calibration.json?of={answer['number']}").content)
        assert document.fit is not None
        assert document.fit.samples == samples
    assert bench.hub.edits == Edits()


def test_what_is_finished_is_made_once_of_the_readings_up_to_then(bench: Bench) -> None:
    """Whichever page asks, and in the end for the terminal, too; what is done later makes another."""
    edits = Edits(finished_s=40.0)
    with bench.page() as socket:
        socket.send_text(encode(edits))
        kept(socket)
    answers = [bench.finish(edits).json() for _ in range(2)]
    samples = flinders.fit(simulate.tumble(seed=1).samples[:2001]).evidence.samples
    assert [answer["view"]["samples"] for answer in answers] == [samples, samples]
    assert answers[0]["number"] == answers[1]["number"]
    assert bench.finish(Edits(finished_s=40.0, target_deg=2.0)).json()["number"] != answers[0]["number"]
    assert bench.hub.finish_now().fit.evidence.samples == samples
    wait_until(lambda: read_edits(bench.path) == edits)
    assert len(flinders.read(bench.path)) == 3000


def test_each_log_is_finished_once(bench: Bench) -> None:
    number = opened(bench, text_of(simulate.tumble(seed=5, n=400).samples))[0]["number"]
    first, second, other = (bench.finish(edits, number).json() for edits in (None, None, Edits(target_deg=2.0)))
    assert first["number"] == second["number"] != other["number"]


@pytest.mark.parametrize(
    ("content", "status"),
    [
        (b"", 400), (b"{}", 400), (b"\xff\xfe{}", 400),
        (b'{"type": "edits", "target_deg": 1e999}', 400),
        (b'{"type": "previous", "name": "", "text": ""}', 400),
        (b'{"type": "edits", "excluded": ' + b"[" * 60_000, 400),
        (b'{"type": "edits"}' + b" " * MAX_MESSAGE_BYTES, 413),
        (b'{"type": "edits", "refreshing": true}', 400),
    ],
)  # fmt: skip
def test_what_no_calibration_can_be_made_after_is_refused(wall: Bench, content: bytes, status: int) -> None:
    answer = wall.client.post("/finish", content=content, headers=OWN)
    assert answer.status_code == status
    assert_sentences(answer.json()["words"])


@pytest.mark.parametrize(
    "edits",
    [
        Edits(site=Site(1e9, 60.0, 0.05, 1.0)), Edits(site=Site(1e-3, 60.0, 0.05, 1.0)),
        Edits(site=Site(50.0, 90.0, 1e-300, 1e-300)), Edits(site=Site(length=1e9, gain_sigma=0.1)),
        Edits(site=Site(50.0, 60.0, 0.05, 1.0, z_down=True, alignment_sigma_deg=180.0)),
        Edits(target_deg=1e-3), Edits(target_deg=180.0, dip_deg=89.0, goal="attitude"),
        Edits(excluded=((-1e308, 1e308),)), Edits(paused_s=-1e308), Edits(begun_s=1e308),
        Edits(finished_s=-1e308), Edits(finished_s=1.7976931348623157e308), Edits(finished_s=1.0, begun_s=2.0),
        Edits(excluded=tuple((number / 20.0, number / 20.0 + 0.01) for number in range(1000))),
    ],
)  # fmt: skip
def test_whatever_numbers_a_page_sends_the_answer_is_a_calibration_or_why_there_is_none(
    wall: Bench, edits: Edits
) -> None:
    line = json.dumps(msgspec.to_builtins(edits)).replace("Infinity", "1e300")
    answer = wall.client.post("/finish", content=line, headers=OWN)
    assert answer.status_code == 200, answer.text
    told = answer.json()
    assert told["view"] is not None or told["refusal"]
    for path in ("/calibration.json", "/report.html", "/export/c"):
        assert wall.client.get(f"{path}?of={told['number']}").status_code in (200, 400, 409), path


@pytest.mark.parametrize("path", ["/calibration.json", "/report.html", "/export/c", "/export/json"])
def test_a_calibration_that_was_not_made_is_not_given(wall: Bench, path: str) -> None:
    for query in ("", "?of=", "?of=00000000", "?of=../../session.csv"):
        answer = wall.client.get(f"{path}{query}")
        assert answer.status_code == 409
        assert "press Finish again" in answer.json()["words"]


def test_the_last_calibrations_are_held_and_those_before_are_forgotten(bench: Bench) -> None:
    numbers = [bench.of_finished() for _ in range(MAX_FINISHED + 1)]
    answers = [bench.client.get(f"/calibration.json{number}").status_code for number in numbers]
    assert answers == [409, *[200] * MAX_FINISHED]


@pytest.mark.parametrize("target", ["ardupilot", "c", "motioncal", "json"])
def test_an_export_comes_as_text_with_its_warnings_and_as_a_file(wall: Bench, target: str) -> None:
    address = f"/export/{target}{wall.of_finished()}"
    told = wall.client.get(address, headers={"accept": "application/json"}).json()
    plain = wall.client.get(address)
    assert told["filename"] == f"{target}{registry()[target].suffix}"
    assert isinstance(told["warnings"], list)
    expected = told["text"].encode() if told["binary_base64"] is None else base64.b64decode(told["binary_base64"])
    assert plain.content == expected


@pytest.mark.parametrize(
    ("target", "names"),
    [("arduino", ("strengthIsOff", "magneticHeading")), ("micropython", ("def strength_is_off", "def heading"))],
)
def test_code_from_the_page_has_the_claim_as_numbers(wall: Bench, target: str, names: tuple[str, str]) -> None:
    """As that of `flinders export`: gates, and each heading with its standard deviation."""
    code = wall.client.get(f"/export/{target}{wall.of_finished()}").text
    assert [name for name in names if name not in code] == []
    assert "within 1 deg for" in code


def test_a_target_that_is_not_there_is_named_and_no_path_is_opened(wall: Bench) -> None:
    assert wall.client.get("/export/toaster").status_code == 404
    assert "one of ardupilot" in wall.client.get("/export/toaster").json()["words"]
    for path in (
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "//etc/passwd",
    ):
        assert wall.client.get(path).status_code in (404, 405), path


def text_of(samples: Samples) -> str:
    """A log without times."""
    rows = "\n".join(",".join(f"{value:.3f}" for value in row) for row in samples.field)
    return f"mx_uT,my_uT,mz_uT\n{rows}\n"


def opened(bench: Bench, content: str | bytes, name: str = "my%20log.csv") -> tuple[dict[str, Any], Readings]:
    """Drop a log on a page: what is known of it, and its readings."""
    answer = bench.client.post(f"/open?name={name}", content=content, headers=OWN)
    assert answer.status_code == 200, answer.text
    length = int.from_bytes(answer.content[:8], "little")
    assert length % 8 == 0
    about: dict[str, Any] = json.loads(answer.content[8 : 8 + length])
    return about, Readings.of(answer.content[8 + length :])


def test_a_log_is_opened_and_calibrated_beside_the_session(bench: Bench) -> None:
    samples = simulate.tumble(seed=5, n=400).samples
    about, got = opened(bench, text_of(samples), "..%2F..%2Fmy%20log.csv")
    assert_sentences(about["words"])
    assert (about["name"], about["is_timed"], about["site"]) == ("my log.csv", False, None)
    npt.assert_array_equal(got.time, np.arange(400.0))
    npt.assert_allclose(got.field, samples.field, atol=5e-4)
    npt.assert_array_equal(got.latest[1:4], got.field[-1])
    assert (got.first, got.stride, got.total, got.is_last, got.is_microtesla) == (0, 1, 400, True, True)
    told = bench.finish(Edits(excluded=((0.0, 9.0),)), about["number"]).json()
    assert (told["name"], told["view"]["samples"]) == ("my log.csv", 390)
    document = loads(bench.client.get(f"/calibration.json?of={told['number']}").content)
    assert document.fit is not None
    assert document.fit.samples == 390
    assert bench.client.get("/session.csv").status_code == 200
    assert bench.hub.log.buffer.total == 3000
    assert bench.hub.edits == Edits()


def test_a_log_with_accelerations_in_counts_is_passed_on_whole(bench: Bench) -> None:
    rng = np.random.default_rng(2)
    table = np.column_stack(
        [np.arange(300) / 50.0, simulate.tumble(seed=5, n=300).samples.field, rng.normal(size=(300, 3))]
    )
    text = io.StringIO()
    np.savetxt(
        text, table, fmt="%.6f", delimiter=",", header="t_s,mag_x,mag_y,mag_z,accel_x,accel_y,accel_z", comments=""
    )
    about, got = opened(bench, text.getvalue())
    assert about["is_timed"]
    assert not got.is_microtesla
    assert got.acceleration is not None
    npt.assert_allclose(np.column_stack([got.time, got.field]), table[:, :4], atol=1e-6)
    npt.assert_allclose(
        got.acceleration / np.linalg.norm(got.acceleration), table[:, 4:] / np.linalg.norm(table[:, 4:]), atol=1e-6
    )


def test_logs_that_are_no_longer_in_memory_are_refused_in_words(bench: Bench) -> None:
    text = text_of(simulate.tumble(seed=5, n=400).samples)
    numbers = [opened(bench, text)[0]["number"] for _ in range(MAX_LOGS + 1)]
    assert [bench.finish(log=number).status_code for number in numbers] == [400, *[200] * MAX_LOGS]
    for number in (numbers[0], "0000", "../session.csv"):
        answer = bench.finish(log=number)
        assert answer.status_code == 400
        assert "drop the log" in answer.json()["words"]


@pytest.mark.parametrize("content", [b"", b"\x00" * 5000, b"hello, world\n" * 50, b"1,2\n3,4\n"])
def test_what_is_no_log_is_refused_by_the_name_it_had(wall: Bench, content: bytes) -> None:
    answer = wall.client.post("/open?name=holiday.jpg", content=content, headers=OWN)
    assert answer.status_code == 422
    assert "holiday.jpg" in answer.json()["words"]
    assert "dropped-" not in answer.json()["words"]
    assert wall.hub.logs == {}


def test_a_log_that_is_too_large_is_refused_before_it_is_read(wall: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.apps.live.server.UPLOAD_BYTES", 1 << 20)
    answer = wall.client.post("/open?name=huge.csv", content=b"1,2,3\n" * 200_000, headers=OWN)
    assert answer.status_code == 413
    assert UPLOAD_BYTES == 64 << 20


def arrays(columns: int) -> bytes:
    """A compressed archive of 17 MB of zeros, in one array or in many."""
    archive = io.BytesIO()
    named: dict[str, Any] = {f"mag{column}": np.zeros((756_000 // columns, 3)) for column in range(columns)}
    np.savez_compressed(archive, **named)
    return archive.getvalue()


def zipped(name: str, content: bytes, packing: int = zipfile.ZIP_DEFLATED) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", packing) as members:
        members.writestr(name, content)
    return archive.getvalue()


def matlab(size: int) -> bytes:
    """A packed element of zeros behind the header of a file of MATLAB."""
    packed = zlib.compress(bytes(size))
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HHII", 0x0100, 0x4D49, 15, len(packed)) + packed


ROW = b"1.0,2.0,3.0\n"


def rows() -> bytes:
    """18 MB of text."""
    return ROW * 1_500_000


LARGE: dict[str, Callable[[], bytes]] = {
    "zeros.npz": lambda: arrays(1),
    "many.npz": lambda: arrays(12),
    "rows.csv.gz": lambda: gzip.compress(rows()),
    "walk.zip": lambda: zipped("Magnetometer.csv", rows()),
    "twice.zip": lambda: zipped("Magnetometer.csv", gzip.compress(rows())),
    "walk.zip.gz": lambda: gzip.compress(zipped("Magnetometer.csv", rows())),
    "zeros.mat": lambda: matlab(len(rows())),
}


@pytest.mark.parametrize("name", LARGE)
def test_an_upload_that_unpacks_to_too_much_is_refused_while_it_is_unpacked(
    wall: Bench, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Whatever packs it, and however often; here a sixteenth of the limit."""
    assert transfers.UNPACKED_BYTES == 256 << 20
    monkeypatch.setattr(transfers, "UNPACKED_BYTES", 16 << 20)
    monkeypatch.setattr(transfers, "load", None)  # which would read it
    content = LARGE[name]()
    assert len(content) < 1 << 17
    answer = wall.client.post(f"/open?name={name}", content=content, headers=OWN)
    assert (answer.status_code, answer.json()["code"]) == (422, "unreadable")
    assert_sentences(answer.json()["words"])


def test_a_packed_upload_within_the_limit_is_read(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """So is one of exactly the limit, and one that was cut."""
    field = simulate.tumble(seed=5, n=400).samples.field
    text = b"mx_uT,my_uT,mz_uT\n" + b"".join(b"%.3f,%.3f,%.3f\n" % tuple(row) for row in field.tolist())
    monkeypatch.setattr(transfers, "UNPACKED_BYTES", len(text))
    packed = {"a.csv.gz": gzip.compress(text), "a.zip": zipped("mag.csv", text), "cut.csv.gz": gzip.compress(text)[:-9]}
    for name, content in packed.items():
        assert bench.client.post(f"/open?name={name}", content=content, headers=OWN).status_code == 200, name
    assert len(bench.hub.logs) == len(packed)
    bench.hub.logs.clear()


def test_an_archive_with_a_packing_of_unbounded_memory_is_refused(wall: Bench) -> None:
    """zipfile unpacks a read of bzip2 or LZMA in one piece: a kilobyte of it fills a gigabyte of memory."""
    for packing in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        plain = zipped("mag.csv", ROW * 100, packing)
        for content in (plain, gzip.compress(plain)):
            answer = wall.client.post("/open?name=a.zip", content=content, headers=OWN)
            assert answer.status_code == 422
            assert_sentences(answer.json()["words"])


def test_an_archive_of_a_version_to_come_is_refused(wall: Bench) -> None:
    archive = io.BytesIO()
    np.savez(archive, mag=np.zeros((3, 3)))
    directory = archive.getvalue().rindex(b"PK\x01\x02")
    content = bytearray(archive.getvalue())
    content[directory + 6] = 109  # tenths of the version that it needs
    answer = wall.client.post("/open?name=later.npz", content=bytes(content), headers=OWN)
    assert answer.status_code == 422
    assert_sentences(answer.json()["words"])


def test_a_calibration_from_before_is_kept_and_passed_on(bench: Bench) -> None:
    content = bench.client.get(f"/calibration.json{bench.of_finished()}").content
    assert len(content) < server.CALIBRATION_BYTES / 20
    with bench.page() as one, bench.page() as other:
        answer = bench.client.post("/previous?name=..%2Fmonday.json", content=content, headers=OWN)
        assert answer.status_code == 200
        for socket in (one, other):
            told = received(socket, "previous")
            assert (told["name"], told["text"], len(told["number"])) == ("monday.json", content.decode(), 16)
        with bench.page() as late:
            assert json.loads(late.receive_text())["previous"]["name"] == "monday.json"
        for wrong in (b"", b"{}", b"mx,my,mz\n1,2,3\n", b"\xff\xfe"):
            assert bench.client.post("/previous?name=x", content=wrong, headers=OWN).status_code == 422
        assert bench.hub.previous.name == "monday.json"
        one.send_text(encode(Previous()))
        while received(other, "previous")["name"]:
            pass
    assert (bench.hub.previous, bench.hub.renewed) == (Previous(), None)
    answer = bench.client.post("/previous?name=x", content=b" " * (server.CALIBRATION_BYTES + 1), headers=OWN)
    assert answer.status_code == 413


def test_an_earlier_calibration_is_renewed_where_edits_say_so(bench: Bench) -> None:
    content = bench.client.get(f"/calibration.json{bench.of_finished()}").content
    bench.client.post("/previous?name=monday.json", content=content, headers=OWN)
    answer = bench.client.get(f"/calibration.json{bench.of_finished(Edits(refreshing=True))}")
    document = loads(answer.content)
    assert document.provenance is not None
    assert [file.name for file in document.provenance.files] == ["session.csv", "session.csv"]


def test_only_the_calibration_that_the_page_shows_is_renewed(bench: Bench) -> None:
    content = bench.client.get(f"/calibration.json{bench.of_finished()}").content
    numbers = []
    for name in ("monday.json", "tuesday.json"):
        bench.client.post(f"/previous?name={name}", content=content, headers=OWN)
        numbers.append(bench.hub.previous.number)
    refused = bench.finish(Edits(refreshing=True), previous=numbers[0])
    assert refused.status_code == 400
    assert_sentences(refused.json()["words"])
    assert bench.finish(Edits(refreshing=True), previous=numbers[1]).status_code == 200


def test_another_earlier_calibration_is_not_renewed_until_that_is_asked_for(bench: Bench) -> None:
    content = bench.client.get(f"/calibration.json{bench.of_finished()}").content
    bench.client.post("/previous?name=monday.json", content=content, headers=OWN)
    with bench.page() as page:
        page.send_text(encode(Edits(refreshing=True)))
        bench.until(lambda hub: hub.edits.refreshing)
        bench.client.post("/previous?name=tuesday.json", content=content, headers=OWN)
        assert not bench.hub.edits.refreshing
        assert received(page, "previous")["name"] == "tuesday.json"
        assert not received(page, "kept")["edits"]["refreshing"]


def test_a_session_that_renewed_is_none_without_its_earlier_calibration(bench: Bench) -> None:
    hub = Hub(replace(bench.hub.supply, edits=Edits(refreshing=True, target_deg=0.5)))
    assert hub.edits == Edits(target_deg=0.5)
    hub.edit(Edits(refreshing=True, dip_deg=40.0))  # as of a page that has not heard yet
    assert hub.edits == Edits(dip_deg=40.0)
    content = bench.client.get(f"/calibration.json{bench.of_finished()}").text
    for warned in (True, False):
        page = Page()
        hub.add_page(page)
        told = page.next_message()
        assert isinstance(told, Notice) == warned
        if isinstance(told, Notice):
            assert_sentences(told.words)
        hub.compare_with(Previous("monday.json", content))


def test_a_log_is_judged_at_the_site_that_its_page_says(bench: Bench) -> None:
    """A page has the site that the log states, and a person may have given another."""
    log = text_of(simulate.tumble(seed=9).samples)
    about, _ = opened(bench, log, "log.csv")
    name, held = bench.hub.logs[about["number"]]
    bench.hub.logs[about["number"]] = name, held._replace(site=Site(30.0, 20.0, 0.05, 1.0))
    view = bench.finish(Edits(site=Site(50.0, -65.0, 0.05, 1.0)), about["number"]).json()["view"]
    assert view["heading_error_deg"]["dip_deg"] == -65.0
    assert view["field_strength"] == pytest.approx(50.0, rel=0.1)


def test_a_source_that_is_no_board_takes_no_calibration(wall: Bench) -> None:
    answer = wall.client.post(f"/send{wall.of_finished()}", headers=OWN)
    assert answer.status_code == 422
    assert "flinders send" in answer.json()["words"]


def test_a_calibration_of_another_sensor_is_not_sent_to_the_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A colleague's log was finished: the board gets nothing of it, and gets its own."""
    sent: list[MotionCalPacket] = []
    monkeypatch.setattr(motioncal, "send", lambda _, packet, **_more: sent.append(packet))
    board = ScriptedSource([])
    bench = Bench(tmp_path, simulate.tumble(seed=9).samples, board=board)
    own = simulate.tumble(seed=9).sensor
    other = simulate.Sensor.random(np.random.default_rng(77))
    log = text_of(simulate.tumble(seed=77, sensor=other).samples)
    with bench.client:
        bench.until(has_all)
        for name in ("colleague.csv", "session.csv"):
            about, _ = opened(bench, log, name)
            number = bench.of_finished(log=about["number"])
            bench.hub.logs.clear()  # as other logs would do that were dropped since
            answer = bench.client.post(f"/send{number}", headers=OWN)
            assert answer.status_code == 409
            assert f"belongs to {name}" in answer.json()["words"]
        assert bench.client.post("/send", headers=OWN).status_code == 409
        assert sent == []
        assert bench.client.post(f"/send{bench.of_finished()}", headers=OWN).status_code == 200
    assert len(sent) == 1
    npt.assert_allclose(sent[0].offset, own.offset, atol=1.0)
    assert np.abs(np.subtract(sent[0].offset, other.offset)).max() > 5.0
    bench.sink.close()


def test_a_preview_of_what_a_target_refuses_is_an_answer_and_the_file_is_an_error(tmp_path: Path) -> None:
    samples = simulate.tumble(seed=1).samples
    bench = Bench(tmp_path, replace(samples, field=16.0 * samples.field, unit=Unit.of("counts")))
    with bench.client:
        bench.until(has_all)
        number = bench.of_finished()
        refused = 0
        for target in registry():
            answer = bench.client.get(f"/export/{target}{number}", headers={"accept": "application/json"})
            assert answer.status_code == 200, (target, answer.text)
            if "refusal" in answer.json():
                refused += 1
                plain = bench.client.get(f"/export/{target}{number}")
                assert plain.status_code in (400, 409), target
                assert plain.json()["words"] == answer.json()["refusal"]
        assert refused > 0
    bench.sink.close()


def test_what_cannot_be_recorded_is_in_the_calibration_all_the_same(tmp_path: Path) -> None:
    """The file has a hole: the calibration is made of what is in memory."""
    samples = simulate.tumble(seed=1).samples
    bench = Bench(tmp_path, samples)
    bench.sink.why = "the disk is full"
    with bench.client:
        bench.until(has_all)
        with bench.page() as socket:
            assert json.loads(socket.receive_text())["unrecorded"] == "the disk is full"
            bench.path.write_text("t_s,mx,my,mz\n", encoding="utf-8")
            number = bench.of_finished()
            document = loads(bench.client.get(f"/calibration.json{number}").content, source="the page")
            bench.sink.why = ""
            assert received(socket, "unrecorded")["words"] == ""
    found = fit_from(document, name="the page").calibration
    npt.assert_allclose(found.offset, calibrate.fit(samples).calibration.offset, rtol=1e-6)
    bench.sink.close()


@pytest.fixture
def listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A server at a real port, which waits half a second for a head and takes ten connections."""
    monkeypatch.setattr("flinders.apps.live.access.HEAD_S", 0.5)
    monkeypatch.setattr("flinders.apps.live.access.MAX_CONNECTIONS", 10)
    opened = open_listener("127.0.0.1", 0)
    number = int(opened.getsockname()[1])
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=100).samples)
    app = application(bench.hub, Gate.of("127.0.0.1", number))
    running = server_of(app)
    thread = threading.Thread(target=running.run, args=([opened],))
    thread.start()
    yield number
    running.should_exit = True
    thread.join(10.0)
    opened.close()
    bench.sink.close()


def is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(100) == b""
    except ConnectionError:
        return True


def test_who_never_says_what_he_wants_is_not_waited_for(listener: int) -> None:
    def connected(head: bytes) -> socket.socket:
        found = socket.create_connection(("127.0.0.1", listener), timeout=PATIENCE_S)
        found.sendall(head)
        return found

    slow = [connected(head) for head in (b"", b"GET / HTTP/1.1\r\nHost: 127.0", b"POST /open HTTP/1.1\r\nX: ")]
    assert httpx.get(f"http://127.0.0.1:{listener}/session.csv").status_code in (200, 404)
    begun = time.monotonic()
    with Heartbeat() as heartbeat:
        assert all(is_closed(one) for one in slow)
    assert time.monotonic() - begun < 4.0 + 10.0 * heartbeat.worst_s
    crowd = [connected(b"") for _ in range(30)]
    assert is_closed(crowd[-1])

    def is_answered() -> bool:
        with contextlib.suppress(httpx.TransportError):
            return httpx.get(f"http://127.0.0.1:{listener}/session.csv").status_code in (200, 404)
        return False

    wait_until(is_answered)
    for one in [*slow, *crowd]:
        one.close()


def test_a_recording_that_grows_while_it_is_sent_is_sent_as_it_was(listener: int, tmp_path: Path) -> None:
    """Its length is that of the request, its last line is whole, and the answer is the beginning of the file."""
    path, row, is_over = tmp_path / "session.csv", b"0.020,21.7,-4.1,43.2\n" * 50, threading.Event()

    def write() -> None:
        with path.open("ab", buffering=0) as file:
            file.write(row * 2000)
            while not is_over.wait(2e-4):
                file.write(row[:-7])
                file.write(row[-7:])

    writer = threading.Thread(target=write)
    writer.start()
    try:
        wait_until(lambda: path.exists() and path.stat().st_size > 1 << 20)
        answers = [httpx.get(f"http://127.0.0.1:{listener}/session.csv") for _ in range(20)]
    finally:
        is_over.set()
        writer.join()
    content = path.read_bytes()
    for answer in answers:
        assert len(answer.content) == int(answer.headers["content-length"]) > 1 << 20
        assert answer.content.endswith(b"\n")
        assert content.startswith(answer.content)
    assert answers[0].headers["content-disposition"] == 'attachment; filename="session.csv"'


def test_a_snapshot_is_the_whole_lines_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "grüße.csv"
    for content, size in ((b"", 0), (b"no end", 0), (b"1\n2", 2), (b"1\n" + b"2" * 200_000, 2), (b"1\n2\n", 4)):
        path.write_bytes(content)
        answer = transfers.snapshot(path)
        assert answer.headers["content-length"] == f"{size}"
    assert_sentences(answer.headers["content-disposition"])


def test_a_browser_that_goes_away_in_an_upload_is_no_fault(listener: int, caplog: pytest.LogCaptureFixture) -> None:
    own = f"127.0.0.1:{listener}"
    head = f"POST /open?name=a.csv HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\nContent-Length: 1000\r\n\r\n1,2"
    with socket.create_connection(("127.0.0.1", listener), timeout=PATIENCE_S) as upload:
        upload.sendall(head.encode())
        time.sleep(0.2)
    time.sleep(0.2)
    assert httpx.get(f"http://{own}/session.csv").status_code in (200, 404)
    assert "Traceback" not in caplog.text
    assert "ClientDisconnect" not in caplog.text


def upload_begun(listener: int, sent: bytes, length: int) -> socket.socket:
    """A file of which only the beginning has come."""
    own = f"127.0.0.1:{listener}"
    head = f"POST /open?name=a.csv HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\nContent-Length: {length}\r\n\r\n"
    upload = socket.create_connection(("127.0.0.1", listener), timeout=PATIENCE_S)
    upload.sendall(head.encode() + sent)
    return upload


def test_an_upload_that_stalls_is_dropped(listener: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.apps.live.server.MAX_STALL_S", 0.3)
    with upload_begun(listener, b"1,2", 1000) as upload:
        answer = b""
        while part := upload.recv(4096):
            answer += part
    assert answer.startswith(b"HTTP/1.1 408")
    assert b"no data of a.csv" in answer


def test_files_on_their_way_share_the_limit_of_one(listener: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.apps.live.server.UPLOAD_BYTES", 1 << 20)

    def answered() -> httpx.Response:
        own = f"http://127.0.0.1:{listener}"
        return httpx.post(f"{own}/open?name=b.csv", content=b"1,2,3\n" * 50_000, headers={"Origin": own})

    with upload_begun(listener, b"1,2,3\n" * 140_000, 1 << 20):
        wait_until(lambda: answered().status_code == 503)
        refused = answered()
    assert "drop b.csv again" in refused.json()["words"]
    wait_until(lambda: answered().status_code != 503)


def test_nothing_can_be_made_of_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=5).samples)
    with bench.client:
        bench.until(has_all)
        told = bench.finish().json()
        assert told["view"] is None
        assert "5 usable readings" in told["refusal"]
        for path in ("/calibration.json", "/export/c"):
            answer = bench.client.get(f"{path}?of={told['number']}")
            assert answer.status_code == 409
            assert answer.json()["words"] == told["refusal"]
    bench.sink.close()


def test_before_the_first_reading_there_is_nothing_to_make_a_calibration_of(tmp_path: Path) -> None:
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=5).samples[:0])
    with bench.client:
        bench.until(has_all)
        told = bench.finish().json()
        assert told["view"] is None
        assert_sentences(told["refusal"])
        with bench.page() as socket:
            got = next_readings(socket)
            assert (got.total, len(got.time), got.is_last) == (0, 0, True)
            socket.send_text(encode(Edits(target_deg=0.5)))
            kept(socket)
    bench.sink.close()
    assert "flinders live" not in bench.path.read_text(encoding="utf-8")


def test_the_report_comes_as_a_file_also_of_a_refusal(wall: Bench, tmp_path: Path) -> None:
    answer = wall.client.get(f"/report.html{wall.of_finished()}")
    assert answer.status_code == 200
    assert "attachment" in answer.headers["content-disposition"]
    assert answer.text.lstrip().lower().startswith("<!doctype html")
    short = Bench(tmp_path, simulate.tumble(seed=1, n=5).samples)
    with short.client:
        short.until(has_all)
        assert "No calibration" in short.client.get(f"/report.html{short.of_finished()}").text
    short.sink.close()


STRANGERS: list[dict[str, str]] = [
    {"host": "evil.example", "origin": f"http://{HOST}"},
    {"host": "evil.example:8410", "origin": "http://evil.example:8410"},
    {"host": "127.0.0.1:80", "origin": "http://127.0.0.1:80"},
    {"host": "127.0.0.1:8410.evil.example", "origin": f"http://{HOST}"},
    {"host": "192.0.2.7:8410", "origin": "http://192.0.2.7:8410"},
    {"host": HOST, "origin": "http://evil.example"},
    {"host": HOST, "origin": "https://127.0.0.1:8410"},
    {"host": HOST, "origin": "http://127.0.0.1"},
    {"host": HOST, "origin": "http://127.0.0.1:8411"},
    {"host": HOST, "origin": "null"},
    {"host": HOST, "origin": ""},
    {"host": HOST, "origin": f"http://{HOST}@evil.example"},
]


@pytest.mark.parametrize("headers", STRANGERS, ids=str)
def test_another_site_gets_no_socket_and_posts_nothing(wall: Bench, headers: dict[str, str]) -> None:
    with pytest.raises(WebSocketDisconnect), wall.client.websocket_connect("/socket", headers=headers):
        pass
    for path in ("/open?name=x", "/previous?name=x", "/send", "/finish"):
        assert wall.client.post(path, content=b"1,2,3\n", headers=headers).status_code == 403
    assert wall.hub.pages == set()


def test_a_request_that_names_no_origin_reads_and_changes_nothing(wall: Bench) -> None:
    assert wall.client.get("/").status_code == 200
    for path in ("/send", "/finish", "/open?name=x", "/previous?name=x"):
        assert wall.client.post(path, content=b"{}").status_code == 403
    with pytest.raises(WebSocketDisconnect), wall.client.websocket_connect("/socket"):
        pass


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "localhost:8411", "[::2]:8410", "", "a b:8410"])
def test_a_name_that_leads_here_by_rebinding_gets_nothing(wall: Bench, host: str) -> None:
    answer = wall.client.get("/", headers={"host": host})
    assert answer.status_code == 403
    assert "<" not in answer.text


@pytest.mark.parametrize("host", ["localhost:8410", "[::1]:8410", "LOCALHOST:8410"])
def test_all_names_of_this_machine_lead_here(wall: Bench, host: str) -> None:
    assert wall.client.get("/", headers={"host": host}).status_code == 200


def test_an_open_server_asks_for_its_token_once(tmp_path: Path) -> None:
    tokens = Tokens()
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=50).samples, host="0.0.0.0", tokens=tokens)
    first = tokens.current
    with bench.client:
        phone = httpx.Headers({"host": "192.0.2.7:8410"})
        client = bench.client
        for path in (
            "/", "/session.csv", "/page.json", "/flinders.wasm", "/static/messages.d.ts", "/?token=guess",
            f"/session.csv?token={first}",
        ):  # fmt: skip
            assert client.get(path, headers=phone).status_code == 401, path
        page = client.get("/", headers={**phone, "accept": "text/html"})
        assert (page.status_code, "Open the whole address" in page.text) == (401, True)
        with pytest.raises(WebSocketDisconnect), client.websocket_connect("/socket", headers=OWN):
            pass
        answer = client.get(f"/?token={first}", headers=phone, follow_redirects=False)
        assert answer.status_code == 303
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "samesite=strict" in cookie.casefold()
        client.cookies.clear()
        assert client.get(f"/?token={first}", headers=phone, follow_redirects=False).status_code == 401
        value = cookie.partition("=")[2].partition(";")[0]
        with_cookie = {**phone, "cookie": f"{cookie_name(8410)}={value}"}
        assert client.get("/", headers=with_cookie).status_code == 200
        assert client.get("/", headers={**with_cookie, "host": "evil.example:8410"}).status_code == 403
        assert tokens.current != first
        assert re.search(rf"//[\d.]+:8410/\?token={re.escape(tokens.current)}$", bench.said[0])
    bench.sink.close()


def test_the_types_of_the_pages_are_those_of_the_messages() -> None:
    for path, types in {"wire.d.ts": typescript(), "station/station.d.ts": station_types()}.items():
        assert (STATIC / path).read_text(encoding="utf-8") == types, "python -m tests.message_types"


def test_a_session_is_named_by_its_time_and_never_over_another(tmp_path: Path) -> None:
    now = datetime(2026, 5, 1, 12, 30, tzinfo=UTC)
    first = default_path(now, str(tmp_path / "sessions"))
    first.touch()
    second = default_path(now, str(tmp_path / "sessions"))
    assert first.parent.is_dir()
    assert first != second
    assert second.name.endswith("_2.csv")


def test_edits_that_a_crash_has_cut_are_passed_over() -> None:
    done = Edits(excluded=((1.0, 2.0),), goal="attitude")
    wrong = line_of(done).replace('"site":null', '"site":{"inclination_deg":200}')
    cut_off = [line_of(done)[:30], "# flinders live: {}x", wrong, line_of(done).replace("1.0,2.0", "2.0,1.0")]
    assert edits_in([line_of(done), *cut_off]) == done


def test_edits_of_a_site_are_read_as_they_were_written() -> None:
    done = Edits(site=Site(49.3, 66.1, 0.05, 1.0, z_down=True), dip_deg=-12.5, begun_s=0.1 + 0.2, refreshing=True)
    assert edits_in([line_of(done)]) == done


def test_all_is_let_go_of_in_the_end(tmp_path: Path) -> None:
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=100).samples)
    with bench.client, contextlib.suppress(WebSocketDisconnect), bench.page() as socket:
        socket.receive_text()
    assert not bench.hub._feed_thread.is_alive()
    bench.sink.close()
    assert len(flinders.read(bench.path)) == 100
