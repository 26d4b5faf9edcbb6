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
from tests.sentences import assert_sentences
from tests.waiting import PATIENCE_S, Heartbeat, wait_until

import flinders
from flinders.apps.live.messages import IS_VEHICLE, Edits, encode, parse
from flinders.apps.live.session_file import read_edits
from flinders.core.calibration_file import loads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.core.calibration_file import Document

    Start = Callable[..., "Program"]

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="programs are forked, which starts them at once")

NURSERY = """
import os, sys
sys.dont_write_bytecode = True  # a module that is imported while the disk is full would be cut short for all who follow
import flinders.apps.live.server, flinders.links.recorder, flinders.apps.live.simulated, flinders.apps.live.finished
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

    def calibration(self, edits: Edits) -> Document:
        """Have the calibration of all readings made, as a page does, and get its file."""
        origin = {"Origin": self.address.rstrip("/")}
        request = urllib.request.Request(f"{self.address}finish", encode(edits).encode(), origin)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            number = json.loads(answer.read())["number"]
        return loads(self.get(f"calibration.json?of={number}"))

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


def resident_mb(pid: int) -> float:
    """Memory that a process holds, in MB."""
    return int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize() / 1e6


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
            shown = Page(program.address).readings() if is_running else 0
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
    found = program.calibration(Edits())
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
    assert found.fit.samples == uninterrupted.evidence.samples  # of the rows, where it turned slowly: those are a rest
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
    assert program.get("static/page.js")
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
    done = Edits(excluded=((0.0, 0.25),), target_deg=2.0, dip_deg=-30.0, goal="attitude")
    page.send(encode(done))
    wait_until(lambda: "[0.0,0.25]" in session.read_text(encoding="utf-8"))
    program.signal(signal.SIGKILL)
    program.wait()
    page = Page(start("--simulate", "--resume", str(session)).address)
    assert page.edits == done
    assert page.readings() > 0


def test_a_pause_that_lasted_until_the_end_is_left_out_and_what_comes_after_it_is_not(
    start: Start, tmp_path: Path
) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 10)
    Page(program.address).send(encode(Edits(paused_s=0.1)))
    wait_for_more(program, session)
    wait_until(lambda: read_edits(session).paused_s == 0.1)
    program.signal(signal.SIGKILL)
    program.wait()
    times = flinders.read(session).time
    assert times is not None
    program = start("--simulate", "--resume", str(session))
    page = Page(program.address)
    assert page.edits == Edits(excluded=((0.1, float(times[-1])),))
    wait_for_more(program, session)
    wait_until(lambda: read_edits(session) == page.edits)  # so that another crash changes nothing


def test_what_was_left_behind_stays_behind_when_a_session_is_resumed(start: Start, tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 40)
    Page(program.address).send(encode(Edits(begun_s=0.5)))
    wait_until(lambda: read_edits(session).begun_s == 0.5)
    program.signal(signal.SIGTERM)
    program.wait()
    times = flinders.read(session).time
    assert times is not None
    program = start("--resume", str(session))
    page = Page(program.address)
    assert page.edits.begun_s == 0.5
    assert page.readings() == int((times > 0.5).sum()) > 0


def test_options_go_before_what_a_resumed_session_says_and_are_written_down(start: Start, tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "--target", "2", "--dip", "-30", "-o", str(session))
    wait_until(lambda: read_edits(session) == Edits(target_deg=2.0, dip_deg=-30.0))
    program.signal(signal.SIGKILL)
    program.wait()
    program = start("--simulate", "--target", "1", "--resume", str(session))
    assert Page(program.address).edits == Edits(dip_deg=-30.0)
    wait_until(lambda: read_edits(session) == Edits(dip_deg=-30.0))


def test_a_session_that_is_resumed_without_a_source_is_shown_and_never_simulated(start: Start, tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    program = start("--simulate", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 30)
    program.signal(signal.SIGINT)
    program.wait()
    before = session.read_bytes()
    program = start("--resume", str(session))
    page = Page(program.address)
    assert page.welcome["source"]["kind"] == "file"
    assert page.readings() == len(recorded(session))
    program.signal(signal.SIGINT)
    program.wait()
    assert session.read_bytes() == before


def test_a_session_of_a_log_that_is_resumed_without_it_is_judged_at_its_place(start: Start, tmp_path: Path) -> None:
    session, log = tmp_path / "session.csv", tmp_path / "flight.bin"
    log.write_bytes(b"".join(dataflash()))
    program = start("--replay", str(log), "--speed", "500", "-o", str(session))
    wait_until(lambda: len(recorded(session)) >= 30)
    page = Page(program.address)
    assert page.welcome["targets"][0]["name"] == "ardupilot"
    assert page.next_frame()[4] & IS_VEHICLE
    expected = page.edits.site
    assert expected is not None
    wait_until(lambda: read_edits(session).site == expected)
    program.signal(signal.SIGINT)
    program.wait()
    program = start("--resume", str(session))
    page = Page(program.address)
    assert page.edits.site == expected
    assert expected.strength is not None
    assert 20.0 < expected.strength < 70.0


def test_readings_turned_by_axes_are_those_of_the_file_when_it_is_resumed(start: Start, tmp_path: Path) -> None:
    session, port = tmp_path / "session.csv", free_port()
    words = ["--udp", str(port), "--unit", "uT", "--axes=-y,x,z"]
    program = start(*words, "-o", str(session))
    board = UdpBoard(port, 200)
    board.start()
    board.join()
    wait_until(lambda: len(recorded(session)) == 200, lambda: program.said)
    page = Page(program.address)
    page.wait_for(200)
    program.signal(signal.SIGTERM)
    program.wait()
    later = Page(start(*words, "--resume", str(session)).address)
    later.wait_for(200)
    expected = np.array([[float(cell) for cell in line.split(",")] for line in board.lines]) @ [
        [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0],
    ]  # fmt: skip
    for seen in (page, later):
        npt.assert_allclose(seen.field, expected, atol=1e-9)
        assert seen.flags & IS_VEHICLE


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
        kind, content = self.frame() if self.status == 101 else (8, b"")
        self.welcome: dict[str, Any] = json.loads(content) if kind == 1 else {}
        self.field, self.flags = np.empty((0, 3)), 0

    @property
    def edits(self) -> Edits:
        """Those that it was welcomed with."""
        edits = parse(json.dumps(self.welcome["edits"]))
        assert isinstance(edits, Edits)
        return edits

    def next_frame(self) -> tuple[int, ...]:
        """The head of the next frame of readings, which it takes; none may be left out."""
        opcode, content = self.frame()
        while opcode != 2:
            opcode, content = self.frame()
        head = struct.unpack("<8I", content[:32])
        _, _, first, count, self.flags, *_ = head
        assert first == len(self.field)
        start = 32 + 8 * (7 + count)
        field = np.frombuffer(content[start : start + 24 * count], "<f8").reshape(-1, 3)
        self.field = np.vstack([self.field, field])
        return head

    def readings(self) -> int:
        """How many had come when it was told all."""
        while True:
            *_, total, is_last = self.next_frame()
            if is_last:
                return total

    def wait_for(self, count: int) -> None:
        """Wait until it has so many readings."""
        while len(self.field) < count:
            self.next_frame()

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

    def send(self, text: str) -> None:
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

    def is_open(self) -> bool:
        """Whether the other end has more to say."""
        return bool(self._wire.recv(1, socket.MSG_PEEK))

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
        awake.wait_for(1000)
        board.join()
    behind = time.monotonic() - board.sent[-1][0]
    assert behind < 1.0 + 5.0 * heartbeat.worst_s
    assert recorded(session) == board.lines
    stalled.wait_for(1000)
    for page in (awake, stalled):
        sent = [",".join(f"{value:.3f}" for value in row) for row in page.field.tolist()]
        assert sent == board.lines  # all of them, in order


def test_an_oversized_message_ends_that_page_and_no_other(start: Start, tmp_path: Path) -> None:
    program = start("--simulate", "-o", str(tmp_path / "session.csv"))
    loud, quiet = Page(program.address), Page(program.address)
    loud.send(" " * 70_000 + "{}")
    assert loud.is_closed()
    quiet.wait_for(5)


def test_twenty_pages_that_never_read_cost_the_program_little_and_a_further_one_is_refused(
    start: Start, tmp_path: Path
) -> None:
    """A minute at 1 kHz comes at once: what waits for them is one frame each, of 20,000 readings."""
    log, session = tmp_path / "long.csv", tmp_path / "session.csv"
    field = np.tile(flinders.simulate.tumble(seed=1).samples.field, (20, 1))
    table = np.column_stack([np.arange(len(field)) / 1000.0, field])
    np.savetxt(log, table, fmt="%.3f", delimiter=",", header="t_s,mx_uT,my_uT,mz_uT", comments="")
    program = start("--replay", str(log), "--speed", "100", "-o", str(session))
    before = resident_mb(program.pid)
    deaf = [Page(program.address, stalls=True) for _ in range(19)]
    awake = Page(program.address)
    awake.wait_for(60_000)
    assert Page(program.address).is_closed()
    assert resident_mb(program.pid) - before < 100.0
    assert all(page.is_open() for page in deaf)


def test_another_site_gets_no_socket(start: Start, tmp_path: Path) -> None:
    program = start("--simulate", "-o", str(tmp_path / "session.csv"))
    assert Page(program.address, origin="http://evil.example").status == 403
    request = urllib.request.Request(program.address, headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError, match="403") as refused:
        urllib.request.urlopen(request, timeout=PATIENCE_S)
    refused.value.close()


def test_a_refresh_needs_a_calibration_to_renew() -> None:
    ended = flinders_("live", "--simulate", "--refresh")
    assert ended.code == 2
    assert_sentences(ended.said)


@pytest.mark.parametrize(("word", "option"), [("tumble.csv", "--replay"), ("/dev/ttyUSB7", "--serial")])
def test_a_source_without_its_option_is_told_which(word: str, option: str) -> None:
    ended = flinders_("live", word, "--speed", "5")
    assert ended.code == 2
    assert_sentences(ended.said)


def ended_with_json(is_enough: Callable[[], object], *words: str) -> dict[str, Any]:
    """Run ``flinders live --json`` until there is enough, and read what it prints in the end."""
    command = [sys.executable, "-m", "flinders", "live", "--json", "--no-open", "--port", "0", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stderr is not None
        while "http:" not in (line := program.stderr.readline()):
            assert line
        Page(line[line.index("http:") :].strip())  # it serves, and Ctrl-C ends it
        wait_until(is_enough)
        program.send_signal(signal.SIGINT)
        out, _ = program.communicate(timeout=PATIENCE_S)
    assert program.returncode == 0
    found: dict[str, Any] = json.loads(out)
    assert list(found) == ["recording", "readings", "fit", "refusal"]
    return found


def test_in_the_end_it_prints_the_fit_of_all_readings_that_came(tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    found = ended_with_json(
        lambda: len(recorded(session)) > 1500, "--simulate", "--speed", "100", "--target", "2", "-o", str(session)
    )
    fit = flinders.fit(flinders.open_recording(session), target_deg=2.0)
    assert (found["recording"], found["readings"]) == (str(session), len(recorded(session)))
    assert (found["refusal"], found["fit"]["verdict"]) == ("", fit.verdict)
    assert found["fit"]["samples"] == fit.evidence.samples
    assert found["fit"]["heading_error_deg"]["worst"] == fit.heading_error_deg.worst


def test_where_nothing_came_it_says_in_the_end_why_there_is_no_fit(tmp_path: Path) -> None:
    session = tmp_path / "session.csv"
    found = ended_with_json(lambda: True, "--udp", str(free_port()), "-o", str(session))
    assert (found["recording"], found["readings"], found["fit"]) == (None, 0, None)
    assert found["refusal"]
    assert not session.exists()
