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
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import httpx
import numpy as np
import numpy.testing as npt
import pytest
from starlette.websockets import WebSocketDisconnect
from tests.message_types import typescript
from tests.waiting import PATIENCE_S, Heartbeat, wait_until

import flinders
from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.calibration_file import loads
from flinders.core.units import Unit
from flinders.fitting import calibrate
from flinders.fitting.result import Fit
from flinders.live import motioncal, transfers
from flinders.live.access import HEADERS, Gate, Tokens, cookie_name, listening, server_of
from flinders.live.feeds import Replay
from flinders.live.hub import UPLOAD_BYTES, Hub
from flinders.live.messages import MAGIC, SourceState
from flinders.live.page_state import session_state
from flinders.live.recorder import RecordedFeed, ToFile
from flinders.live.server import STATIC, application
from flinders.live.session import LiveSession
from flinders.live.session_file import Edits, Supply, default_path
from flinders.live.transports import Scripted
from flinders.targets import registry

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # that its client may be another one some day
    from starlette.testclient import TestClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from starlette.testclient import WebSocketTestSession

    from flinders.core.samples import Samples
    from flinders.live.transports import ByteSource
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
    ) -> None:
        self.path = folder / "session.csv"
        self.sink = ToFile(self.path)
        feed = RecordedFeed(Replay(samples, speed=None), self.sink)
        supply = Supply(feed, self.sink, self.path, Axes(), board=board)
        source = SourceState("bench", "serial", "waiting", "")
        self.hub = Hub(LiveSession(source=source, has_board=board is not None), supply)
        self.said: list[str] = []
        self.app = application(self.hub, Gate.of(host, 8410, ("bench",)), tokens, self.said.append)
        self.client = TestClient(self.app, base_url=f"http://{HOST}")

    def page(self) -> WebSocketTestSession:
        return self.client.websocket_connect("/socket", headers=OWN)

    def until(self, done: Callable[[LiveSession], bool]) -> None:
        wait_until(lambda: done(self.hub.session), lambda: self.hub.session)


def has_fit(session: LiveSession) -> bool:
    return session.view is not None and session.shown.evaluated.key == session.shown.key


def has_all(session: LiveSession) -> bool:
    """There is a fit of all readings that come."""
    return has_fit(session) and session.source.link == "ended"


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


def first_points(socket: WebSocketTestSession) -> bytes:
    while True:
        content = socket.receive().get("bytes")
        if content is not None:
            return bytes(content)


def test_a_page_is_told_all_there_is_when_it_comes(wall: Bench) -> None:
    with wall.page() as socket:
        hello = json.loads(socket.receive_text())
        content = first_points(socket)
    assert hello["type"] == "hello"
    assert hello["version"] == flinders.__version__
    assert len(hello["tiles"]["centres"]) == 642 * 3
    assert sorted(map(len, hello["tiles"]["corners"])) == [15] * 12 + [18] * 630
    assert [target["name"] for target in hello["targets"]] == list(registry())
    assert hello["state"]["phase"] == "good"
    assert hello["view"]["verdict"] == "good"
    magic, generation, first, count, flags, stride, *_ = struct.unpack("<8I", content[:32])
    assert (magic, generation, first, count, flags, stride) == (MAGIC, 1, 0, 3000, 1, 1)
    numbers = np.frombuffer(content, "<f4", offset=32)
    samples = simulate.tumble(seed=1).samples
    assert len(numbers) == 6 + 3000 * 7
    npt.assert_allclose(numbers[:3], samples.field[-1], rtol=1e-6)
    assert samples.time is not None
    npt.assert_allclose(numbers[6 : 6 + 3000], samples.time, atol=1e-4)
    npt.assert_allclose(numbers[3006 : 3006 + 9000].reshape(-1, 3), samples.field, rtol=1e-6)


def test_what_one_page_does_both_see(bench: Bench) -> None:
    with bench.page() as one, bench.page() as other:
        one.send_json({"type": "exclude", "start_s": 1.0, "end_s": 2.0})
        while not (told := received(other, "state"))["excluded"]:
            pass
        assert told["excluded"] == [[1.0, 2.0]]
        assert told["excluded_readings"] == 51
        other.send_json({"type": "undo"})
        while received(one, "state")["excluded"]:
            pass
        received(one, "fit")


def test_a_page_that_comes_again_sees_the_same(bench: Bench) -> None:
    with bench.page() as socket:
        socket.send_json({"type": "target", "deg": 0.5})
        while received(socket, "state")["target_deg"] != 0.5:
            pass
    bench.until(has_fit)
    hellos = []
    for _ in range(2):
        with bench.page() as socket:
            hellos.append(json.loads(socket.receive_text()))
    for hello in hellos:
        hello["state"].pop("rate_hz")  # over the last two seconds
    assert hellos[0] == hellos[1]
    assert hellos[0]["state"]["target_deg"] == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "", "{}", "null", "[1]", "{", '{"type": "format_disk"}', '{"type": "target"}', '{"type": "target", "deg": "1"}',
        '{"type": "target", "deg": -1}', '{"type": "target", "deg": 1e999}', '{"type": "dip", "deg": 90}',
        '{"type": "goal", "goal": "money"}', '{"type": "exclude", "start_s": 2, "end_s": 1}',
        '{"type": "undo", "and": "more"}', '{"type": "exclude", "start_s": null, "end_s": 1}',
    ],
)  # fmt: skip
def test_what_is_no_message_is_refused_in_words_and_changes_nothing(wall: Bench, text: str) -> None:
    before = wall.hub.session.revision
    with wall.page() as socket:
        socket.send_text(text)
        notice = received(socket, "notice")
    assert notice["severity"] == "error"
    assert wall.hub.session.revision == before


def test_bytes_are_no_message(wall: Bench) -> None:
    with wall.page() as socket:
        socket.send_bytes(b"\x00\xff")
        assert "text" in received(socket, "notice")["words"]


def test_ten_thousand_fuzzed_messages_change_nothing(wall: Bench) -> None:
    rng = np.random.default_rng(1)
    good = [b'{"type":"exclude","start_s":1,"end_s":2}', b'{"type":"target","deg":0.5}', b'{"type":"clear"}']
    before = wall.hub.session
    from flinders.errors import UsageError
    from flinders.live.messages import parse

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
        while "the end" not in received(socket, "notice")["words"] and len(wall.hub.pages) == 0:
            pass
    assert refused > 9_000
    assert wall.hub.session.live.exclusions == before.live.exclusions
    assert wall.hub.session.target_deg == before.target_deg
    assert wall.hub.session.live.buffer.total == 3000


def test_every_answer_has_the_headers(wall: Bench) -> None:
    for path in ("/", "/nothing-there", "/export/json", "/calibration.json", "/session.csv", "/static/messages.d.ts"):
        answer = wall.client.get(path)
        for name in HEADERS:
            assert name in answer.headers, (path, name)
    assert wall.client.get("/").status_code == 200


def test_the_calibration_is_that_of_flinders_calibrate(wall: Bench) -> None:
    answer = wall.client.get("/calibration.json")
    document = loads(answer.content)
    fit = flinders.fit(flinders.open_recording(wall.path))
    assert document.fit is not None
    assert document.fit.samples == fit.samples > 2900
    npt.assert_array_equal(document.calibration.offset, fit.calibration.offset)
    npt.assert_array_equal(document.calibration.matrix, fit.calibration.matrix)
    assert document.provenance is not None
    assert document.provenance.files[0].name == "session.csv"
    assert "attachment" in answer.headers["content-disposition"]


def test_what_is_taken_out_is_not_in_the_calibration_and_is_written_down(bench: Bench) -> None:
    with bench.page() as socket:
        socket.send_json({"type": "exclude", "start_s": 0.0, "end_s": 30.0})
        while not received(socket, "state")["excluded"]:
            pass
    document = loads(bench.client.get("/calibration.json").content)
    assert document.fit is not None
    assert document.fit.samples == 3000 - 1501
    wait_until(lambda: Edits.read(bench.path).excluded == ((0.0, 30.0),))
    assert len(flinders.read(bench.path)) == 3000


@pytest.mark.parametrize("target", ["ardupilot", "c", "motioncal", "json"])
def test_an_export_comes_as_text_with_its_warnings_and_as_a_file(wall: Bench, target: str) -> None:
    told = wall.client.get(f"/export/{target}", headers={"accept": "application/json"}).json()
    plain = wall.client.get(f"/export/{target}")
    assert told["filename"] == f"{target}{registry()[target].suffix}"
    assert isinstance(told["warnings"], list)
    expected = told["text"].encode() if told["binary_base64"] is None else base64.b64decode(told["binary_base64"])
    assert plain.content == expected


def test_a_target_that_is_not_there_is_named_and_no_path_is_opened(wall: Bench) -> None:
    assert wall.client.get("/export/toaster").status_code == 404
    assert "one of ardupilot" in wall.client.get("/export/toaster").json()["words"]
    for path in (
        "/static/../live/server.py",
        "/static/%2e%2e/live/server.py",
        "/static/..%2fserver.py",
        "//etc/passwd",
    ):
        assert wall.client.get(path).status_code in (404, 405), path


def test_a_log_is_opened_and_closed_again(bench: Bench) -> None:
    samples = simulate.tumble(seed=5, n=400).samples
    rows = "\n".join(",".join(f"{value:.3f}" for value in row) for row in samples.field)
    with bench.page() as socket:
        answer = bench.client.post(
            "/open?name=..%2F..%2Fmy%20log.csv", content=f"mx_uT,my_uT,mz_uT\n{rows}\n", headers=OWN
        )
        assert answer.status_code == 200, answer.text
        assert answer.json()["words"].startswith("my log.csv: columns mx_uT, my_uT, mz_uT in uT")
        while received(socket, "state")["opened"] != "my log.csv":
            pass
        bench.until(has_fit)
        document = loads(bench.client.get("/calibration.json").content)
        assert document.fit is not None
        assert document.fit.samples == 400
        assert bench.client.get("/session.csv").status_code == 409
        socket.send_json({"type": "back_to_live"})
        while received(socket, "state")["opened"]:
            pass
    assert bench.hub.session.shown.buffer.total == 3000


@pytest.mark.parametrize("content", [b"", b"\x00" * 5000, b"hello, world\n" * 50, b"1,2\n3,4\n"])
def test_what_is_no_log_is_refused_by_the_name_it_had(wall: Bench, content: bytes) -> None:
    answer = wall.client.post("/open?name=holiday.jpg", content=content, headers=OWN)
    assert answer.status_code == 422
    assert "holiday.jpg" in answer.json()["words"]
    assert "dropped-" not in answer.json()["words"]
    assert wall.hub.session.opened is None


def test_a_log_that_is_too_large_is_refused_before_it_is_read(wall: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.live.server.UPLOAD_BYTES", 1 << 20)
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
    assert answer.json()["words"].startswith(f"{name} unpacks to more than 16 MB, which is the most")


def test_a_packed_upload_within_the_limit_is_read(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """So is one of exactly the limit, and one that was cut."""
    field = simulate.tumble(seed=5, n=400).samples.field
    text = b"mx_uT,my_uT,mz_uT\n" + b"".join(b"%.3f,%.3f,%.3f\n" % tuple(row) for row in field.tolist())
    monkeypatch.setattr(transfers, "UNPACKED_BYTES", len(text))
    packed = {"a.csv.gz": gzip.compress(text), "a.zip": zipped("mag.csv", text), "cut.csv.gz": gzip.compress(text)[:-9]}
    for name, content in packed.items():
        assert bench.client.post(f"/open?name={name}", content=content, headers=OWN).status_code == 200, name
        assert bench.hub.session.opened is not None


def test_an_archive_with_a_packing_of_unbounded_memory_is_refused(wall: Bench) -> None:
    """zipfile unpacks a read of bzip2 or LZMA in one piece: a kilobyte of it fills a gigabyte of memory."""
    for packing in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        plain = zipped("mag.csv", ROW * 100, packing)
        for content in (plain, gzip.compress(plain)):
            answer = wall.client.post("/open?name=a.zip", content=content, headers=OWN)
            assert answer.status_code == 422
            assert answer.json()["words"].startswith("mag.csv is packed in an unusual way")


def test_an_archive_of_a_version_to_come_is_refused(wall: Bench) -> None:
    archive = io.BytesIO()
    np.savez(archive, mag=np.zeros((3, 3)))
    directory = archive.getvalue().rindex(b"PK\x01\x02")
    content = bytearray(archive.getvalue())
    content[directory + 6] = 109  # tenths of the version that it needs
    answer = wall.client.post("/open?name=later.npz", content=bytes(content), headers=OWN)
    assert answer.status_code == 422
    assert answer.json()["words"].startswith("later.npz cannot be read as")


def test_a_calibration_from_before_is_compared(bench: Bench) -> None:
    content = bench.client.get("/calibration.json").content
    answer = bench.client.post("/previous?name=monday.json", content=content, headers=OWN)
    assert answer.status_code == 200
    with bench.page() as socket:
        while (told := received(socket, "state"))["previous"] is None:
            pass
        assert told["previous"]["name"] == "monday.json"
        assert told["previous"]["change_deg"] < 1e-6
        socket.send_json({"type": "previous_clear"})
        while received(socket, "state")["previous"] is not None:
            pass
    for wrong in (b"", b"{}", b"mx,my,mz\n1,2,3\n", b"\xff\xfe"):
        assert bench.client.post("/previous?name=x", content=wrong, headers=OWN).status_code == 422


def test_a_source_that_is_no_board_takes_no_calibration(wall: Bench) -> None:
    answer = wall.client.post("/send", headers=OWN)
    assert answer.status_code == 422
    assert "flinders send" in answer.json()["words"]


def test_a_calibration_of_another_sensor_is_not_sent_to_the_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is shown is a colleague's log: the board gets nothing of it, and gets its own once that is closed."""
    sent: list[MotionCalPacket] = []
    monkeypatch.setattr(motioncal, "send", lambda _, packet, **_more: sent.append(packet))
    bench = Bench(tmp_path, simulate.tumble(seed=9).samples, board=Scripted([]))
    own = simulate.tumble(seed=9).sensor
    other = simulate.Sensor.random(np.random.default_rng(77))
    buffer = "t_s,mx_uT,my_uT,mz_uT\n" + "".join(
        f"{time:.3f},{x:.3f},{y:.3f},{z:.3f}\n"
        for time, (x, y, z) in zip(
            np.arange(3000) / 50.0, simulate.tumble(seed=77, sensor=other).samples.field.tolist(), strict=True
        )
    )
    with bench.client:
        bench.until(has_fit)
        assert session_state(bench.hub.session).can_send
        assert bench.client.post("/open?name=colleague.csv", content=buffer.encode(), headers=OWN).status_code == 200
        bench.until(has_fit)
        assert not session_state(bench.hub.session).can_send
        answer = bench.client.post("/send", headers=OWN)
        assert answer.status_code == 409
        assert "colleague.csv is shown" in answer.json()["words"]
        assert sent == []
        with bench.page() as socket:
            socket.send_json({"type": "back_to_live"})
            bench.until(lambda session: session.opened is None)
        assert bench.client.post("/send", headers=OWN).status_code == 200
    assert len(sent) == 1
    npt.assert_allclose(sent[0].offset, own.offset, atol=1.0)
    assert np.abs(np.subtract(sent[0].offset, other.offset)).max() > 5.0
    bench.sink.close()


def test_a_preview_of_what_a_target_refuses_is_an_answer_and_the_file_is_an_error(tmp_path: Path) -> None:
    samples = simulate.tumble(seed=1).samples
    bench = Bench(tmp_path, replace(samples, field=16.0 * samples.field, unit=Unit.of("counts")))
    with bench.client:
        bench.until(has_fit)
        refused = 0
        for target in registry():
            answer = bench.client.get(f"/export/{target}", headers={"accept": "application/json"})
            assert answer.status_code == 200, (target, answer.text)
            if "refusal" in answer.json():
                refused += 1
                plain = bench.client.get(f"/export/{target}")
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
            assert "not-recorded" in str(json.loads(socket.receive_text())["state"]["reasons"])
        bench.path.write_text("t_s,mx,my,mz\n", encoding="utf-8")
        document = loads(bench.client.get("/calibration.json").content, source="the page")
    found = Fit.from_document(document, name="the page").calibration
    npt.assert_allclose(found.offset, calibrate.fit(samples).calibration.offset, rtol=1e-6)
    bench.sink.close()


@pytest.fixture
def listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A server at a real port, which waits half a second for a head and takes ten connections."""
    monkeypatch.setattr("flinders.live.access.HEAD_S", 0.5)
    monkeypatch.setattr("flinders.live.access.MOST_CONNECTIONS", 10)
    opened = listening("127.0.0.1", 0)
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
    assert answer.headers["content-disposition"] == "attachment; filename*=utf-8''gr%C3%BC%C3%9Fe.csv"


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
    monkeypatch.setattr("flinders.live.server.STALLED_S", 0.3)
    with upload_begun(listener, b"1,2", 1000) as upload:
        answer = b""
        while part := upload.recv(4096):
            answer += part
    assert answer.startswith(b"HTTP/1.1 408")
    assert b"a.csv stopped coming" in answer


def test_files_on_their_way_share_the_limit_of_one(listener: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.live.server.UPLOAD_BYTES", 1 << 20)

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
        bench.until(lambda session: session.live.buffer.total == 5)
        for path in ("/calibration.json", "/export/c"):
            answer = bench.client.get(path)
            assert answer.status_code == 409
            assert "5 usable readings" in answer.json()["words"]
    bench.sink.close()


def test_the_report_comes_as_a_file_also_of_a_refusal(wall: Bench, tmp_path: Path) -> None:
    answer = wall.client.get("/report.html")
    assert answer.status_code == 200
    assert "attachment" in answer.headers["content-disposition"]
    assert answer.text.lstrip().lower().startswith("<!doctype html")
    short = Bench(tmp_path, simulate.tumble(seed=1, n=5).samples)
    with short.client:
        short.until(lambda session: session.live.buffer.total == 5)
        assert "No calibration" in short.client.get("/report.html").text
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
    for path in ("/open?name=x", "/previous?name=x", "/send"):
        assert wall.client.post(path, content=b"1,2,3\n", headers=headers).status_code == 403
    assert wall.hub.pages == set()


def test_a_request_that_names_no_origin_reads_and_changes_nothing(wall: Bench) -> None:
    assert wall.client.get("/").status_code == 200
    assert wall.client.post("/send").status_code == 403
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
        for path in ("/", "/session.csv", "/static/messages.d.ts", "/?token=guess", f"/session.csv?token={first}"):
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


def test_the_types_of_the_page_are_those_of_the_messages() -> None:
    assert (STATIC / "messages.d.ts").read_text(encoding="utf-8") == typescript(), (
        "python -m tests.message_types > src/flinders/static/messages.d.ts"
    )


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
    wrong = done.line().replace('"site":null', '"site":{"inclination_deg":200}')
    assert Edits.within([done.line(), done.line()[:30], "# flinders live: {}x", wrong]) == done


def test_all_is_let_go_of_in_the_end(tmp_path: Path) -> None:
    bench = Bench(tmp_path, simulate.tumble(seed=1, n=100).samples)
    with bench.client, contextlib.suppress(WebSocketDisconnect), bench.page() as socket:
        socket.receive_text()
    assert not bench.hub._feed_thread.is_alive()
    bench.sink.close()
    assert len(flinders.read(bench.path)) == 100
