"""``flinders live`` as a program: started, stopped, killed, resumed, and looked at by a page that stalls."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import resource
import secrets
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.feeding import UdpBoard, free_port, recorded
from tests.flight_log import dataflash
from tests.program import flinders_
from tests.waiting import PATIENCE_S, Heartbeat, wait_until

import flinders
from flinders.core.calibration_file import loads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Start = Callable[..., "Program"]

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="programs are forked, which starts them at once")

NURSERY = """
import os, sys
sys.dont_write_bytecode = True  # a module that is imported while the disk is full would be cut short for all who follow
import flinders.live.server, flinders.live.recorder, flinders.live.simulated, flinders.live.evaluation
from flinders.cli import main
for line in sys.stdin:
    out, err, *words = line.rstrip("\\n").split("\\x1f")
    child = os.fork()
    if not child:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(os.open(out, os.O_WRONLY | os.O_CREAT), 1)
        os.dup2(os.open(err, os.O_WRONLY | os.O_CREAT), 2)
        try:
            main(words)
        except SystemExit as end:
            sys.stdout.flush(); sys.stderr.flush()
            os._exit(end.code or 0)
    print(child, flush=True)
"""


class Program:
    """A running ``flinders live``."""

    def __init__(self, nursery: subprocess.Popen[str], folder: Path, *words: str) -> None:
        name = secrets.token_hex(4)
        self.out, self.err = folder / f"{name}.out", folder / f"{name}.err"
        assert nursery.stdin is not None
        assert nursery.stdout is not None
        line = "\x1f".join([str(self.out), str(self.err), "live", "--port", "0", "--no-open", *words])
        nursery.stdin.write(f"{line}\n")
        nursery.stdin.flush()
        self.pid = int(nursery.stdout.readline())
        wait_until(lambda: self.out.exists() and self.out.read_text(encoding="utf-8").endswith("\n"), lambda: self.said)
        self.address = self.out.read_text(encoding="utf-8").strip()

    @property
    def said(self) -> str:
        return self.err.read_text(encoding="utf-8") if self.err.exists() else ""

    def get(self, path: str) -> bytes:
        with urllib.request.urlopen(f"{self.address}{path}", timeout=PATIENCE_S) as answer:
            return bytes(answer.read())

    def signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def ended(self) -> bool:
        """All its threads have ended, which is when its ports are free: the first may end before the others."""
        process = Path(f"/proc/{self.pid}")
        try:
            state = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
            return state == "Z" and len(list((process / "task").iterdir())) == 1
        except FileNotFoundError:
            return True

    def wait(self) -> None:
        wait_until(self.ended, lambda: self.said)


@pytest.fixture(scope="module")
def nursery() -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", NURSERY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as made:
        yield made
        assert made.stdin is not None
        made.stdin.close()


@pytest.fixture
def start(nursery: subprocess.Popen[str], tmp_path: Path) -> Iterator[Start]:
    programs: list[Program] = []

    def begin(*words: str) -> Program:
        programs.append(Program(nursery, tmp_path, *words))
        return programs[-1]

    yield begin
    for page in OPEN:
        page.close()
    OPEN.clear()
    for program in programs:
        program.signal(signal.SIGKILL)


def wait_for_more(program: Program, session: Path) -> None:
    """Wait until a program that runs has recorded something."""
    before = len(recorded(session))
    wait_until(lambda: len(recorded(session)) > before, lambda: program.said)


def test_killed_ten_times_at_random_moments_it_loses_at_most_a_second_and_goes_on(start: Start, tmp_path: Path) -> None:
    """What the page has shown is never lost; every other time it is killed while it starts."""
    rng = np.random.default_rng(7)
    session, port = tmp_path / "session.csv", free_port()
    words = ["--udp", str(port), "--unit", "uT"]
    board = UdpBoard(port, 60_000)
    board.start()
    lost = []
    with Heartbeat() as heartbeat:
        for number in range(10):
            is_there = session.exists()
            program = start(*words, *(["--resume", str(session)] if is_there else ["-o", str(session)]))
            if is_running := number % 2 == 0:
                wait_for_more(program, session)
            time.sleep(rng.uniform(0.05, 0.45))
            shown = Page(program.address).hello["state"]["readings"] if is_running else 0
            program.signal(signal.SIGKILL)
            killed = time.monotonic()
            program.wait()
            rows = recorded(session)
            assert len(rows) >= shown
            if is_running:
                held = set(rows)
                lost.append(killed - max(at for at, line in board.sent if line in held))
            if not rows:  # before the layout of the first lines was settled: nothing to go on with
                session.unlink(missing_ok=True)
        board.stop()
    assert max(lost) < 1.0 + 5.0 * heartbeat.worst_s
    program = start(*words, "--resume", str(session))
    found = loads(program.get("calibration.json"))
    program.signal(signal.SIGTERM)
    program.wait()
    rows = recorded(session)
    order = {line: number for number, line in enumerate(board.lines)}
    assert [order[row] for row in rows] == sorted(order[row] for row in rows)
    field = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    uninterrupted = flinders.fit(flinders.Samples.of(field, unit="uT"))
    assert found.fit is not None
    assert found.provenance is not None
    assert sum(file.rows for file in found.provenance.files) == len(rows)
    assert found.fit.samples == uninterrupted.samples  # of the rows, where it turned slowly: those are a rest
    npt.assert_allclose(found.calibration.offset, uninterrupted.calibration.offset, rtol=1e-12)
    npt.assert_allclose(found.calibration.matrix, uninterrupted.calibration.matrix, rtol=1e-12, atol=1e-15)


def test_a_full_disk_is_said_and_what_came_meanwhile_is_there_when_there_is_room(start: Start, tmp_path: Path) -> None:
    path = tmp_path / "full.csv"
    program = start("--simulate", "-o", str(path))

    def until(is_so: Callable[[], bool]) -> None:
        wait_until(is_so, lambda: program.said)

    until(lambda: len(recorded(path)) > 20)
    resource.prlimit(program.pid, resource.RLIMIT_FSIZE, (path.stat().st_size, resource.RLIM_INFINITY))
    until(lambda: "cannot be written" in program.said)
    assert program.get("static/live.js")
    resource.prlimit(program.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    until(lambda: "is written again, and nothing is missing" in program.said)
    program.signal(signal.SIGINT)
    program.wait()
    times = flinders.read(path).time
    assert times is not None
    assert np.diff(times).max() < 0.1
    assert "not whole" not in program.said


def test_what_was_done_by_hand_outlives_a_crash(start: Start, tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 30)
    page = Page(program.address)
    page.send({"type": "target", "deg": 2.0})
    page.send({"type": "exclude", "start_s": 0.0, "end_s": 0.25})
    wait_until(lambda: "[0.0,0.25]" in session.read_text(encoding="utf-8"))
    program.signal(signal.SIGKILL)
    program.wait()
    state = Page(start("--simulate", "--resume", str(session)).address).hello["state"]
    assert state["excluded"] == [[0.0, 0.25]]
    assert state["target_deg"] == 2.0
    assert state["readings"] > 0


def test_a_session_that_is_resumed_without_a_source_is_shown_and_never_simulated(start: Start, tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 30)
    program.signal(signal.SIGINT)
    program.wait()
    before = session.read_bytes()
    program = start("--resume", str(session))
    page = Page(program.address)
    assert page.hello["state"]["source"]["kind"] == "file"
    assert page.hello["state"]["readings"] == len(recorded(session))
    program.signal(signal.SIGINT)
    program.wait()
    assert session.read_bytes() == before


def test_a_session_of_a_log_that_is_resumed_without_it_is_judged_at_its_place(start: Start, tmp_path: Path) -> None:
    session, log = tmp_path / "session.csv", tmp_path / "flight.bin"
    log.write_bytes(b"".join(dataflash()))
    program = start("--replay", str(log), "--speed", "500", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 30)
    expected = Page(program.address).hello["state"]
    program.signal(signal.SIGINT)
    program.wait()
    state = Page(start("--resume", str(session)).address).hello["state"]
    assert not expected["dip_assumed"]
    assert (state["dip_deg"], state["dip_assumed"]) == (expected["dip_deg"], False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_cleanly_and_says_where_the_recording_is(start: Start, tmp_path: Path, number: int) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    Page(program.address)
    wait_until(lambda: len(recorded(session)) > 5)
    program.signal(number)
    program.wait()
    assert f"flinders calibrate {session}" in program.said
    assert "Traceback" not in program.said
    assert len(flinders.read(session)) > 5


OPEN: list[Page] = []


class Page:
    """A page of its own making: the handshake and frames of RFC 6455, so that it can stall as no library does."""

    def __init__(self, address: str, *, origin: str | None = None, stalls: bool = False) -> None:
        host = address.partition("//")[2].strip("/")
        name, _, port = host.partition(":")
        self._wire = socket.create_connection((name, int(port)), timeout=PATIENCE_S)
        OPEN.append(self)
        if stalls:
            self._wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        key = base64.b64encode(secrets.token_bytes(16)).decode()
        self._wire.sendall(
            f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin or f'http://{host}'}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        self._rest = b""
        while b"\r\n\r\n" not in self._rest:
            self._rest += self._wire.recv(4096)
        head, _, self._rest = self._rest.partition(b"\r\n\r\n")
        self.status = int(head.split()[1])
        self.hello: dict[str, Any] = json.loads(self.frame()[1]) if self.status == 101 else {}

    def _take(self, count: int) -> bytes:
        while len(self._rest) < count:
            got = self._wire.recv(65536)
            if not got:
                raise EOFError
            self._rest += got
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken

    def frame(self) -> tuple[int, bytes]:
        kind, size = self._take(2)
        if size == 126:
            (size,) = struct.unpack("!H", self._take(2))
        elif size == 127:
            (size,) = struct.unpack("!Q", self._take(8))
        return kind & 15, self._take(size)

    def send(self, message: object) -> None:
        self.send_text(json.dumps(message))

    def send_text(self, text: str) -> None:
        content, mask = text.encode(), secrets.token_bytes(4)
        masked = bytes(byte ^ mask[place % 4] for place, byte in enumerate(content))
        size = len(content)
        head = struct.pack("!BB", 0x81, 0x80 | size) if size < 126 else struct.pack("!BBQ", 0x81, 0xFF, size)
        self._wire.sendall(head + mask + masked)

    def until(self, kind: str) -> dict[str, Any]:
        while True:
            opcode, content = self.frame()
            if opcode == 1 and (found := json.loads(content))["type"] == kind:
                return dict(found)

    def is_closed(self) -> bool:
        """Whether the other end closes, after what it had to say."""
        try:
            while self.frame()[0] != 8:
                pass
        except (EOFError, ConnectionError):
            return True
        return True

    def close(self) -> None:
        self._wire.close()


def test_a_page_that_stalls_delays_nobody_and_gets_all_points_when_it_wakes(start: Start, tmp_path: Path) -> None:
    session, port = tmp_path / "session.csv", free_port()
    program = start("--udp", str(port), "--unit", "uT", "-o", str(session))
    stalled, awake = Page(program.address, stalls=True), Page(program.address)
    board = UdpBoard(port, 1000)
    with Heartbeat() as heartbeat:
        board.start()
        while awake.until("state")["readings"] < 1000:
            pass
        board.join()
    behind = time.monotonic() - board.sent[-1][0]
    assert behind < 1.0 + 5.0 * heartbeat.worst_s
    assert recorded(session) == board.lines
    seen = 0
    while seen < 1000:
        opcode, content = stalled.frame()
        if opcode == 2:
            _, _, first, count, *_ = struct.unpack("<8I", content[:32])
            assert first == seen  # none left out
            seen += count


def test_an_oversized_message_ends_that_page_and_no_other(start: Start, tmp_path: Path) -> None:
    program = start("--simulate", "-o", str(tmp_path / "session.csv"))
    loud, quiet = Page(program.address), Page(program.address)
    loud.send_text(" " * 70_000 + "{}")
    assert loud.is_closed()
    assert quiet.until("state")["readings"] > 0


def test_another_site_gets_no_socket(start: Start, tmp_path: Path) -> None:
    program = start("--simulate", "-o", str(tmp_path / "session.csv"))
    assert Page(program.address, origin="http://evil.example").status == 403
    request = urllib.request.Request(program.address, headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError, match="403") as refused:
        urllib.request.urlopen(request, timeout=PATIENCE_S)
    refused.value.close()


def test_a_refresh_needs_a_calibration_to_renew() -> None:
    ended = flinders_("live", "--simulate", "--refresh")
    assert (ended.code, "name its file with --previous" in ended.said) == (2, True)
