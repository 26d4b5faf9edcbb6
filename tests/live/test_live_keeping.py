"""What arrives is kept, or that it is not is said: datagrams that come too fast, and a disk that is full."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from typing import TYPE_CHECKING

import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.waiting import wait_until

from flinders.errors import OutputError
from flinders.links.feeds import FeedEvent, FeedThread
from flinders.links.recorder import Recorder
from flinders.links.sinks import RETRY_S, FileSink, RetryingSink
from flinders.links.transports import Udp

if TYPE_CHECKING:
    from pathlib import Path

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts what it throws away")


def rows(path: Path) -> list[str]:
    return [line for line in path.read_text(encoding="utf-8").splitlines() if line[:1] not in "#t"]


def send(port: int, numbers: range) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in numbers:
            sender.sendto(b"%d,%d,%d\n" % (number, number % 7, -number), ("127.0.0.1", port))


def test_datagrams_that_waited_are_taken_together(tmp_path: Path) -> None:
    path, source = tmp_path / "burst.csv", Udp(0, "127.0.0.1")
    send(source.port, range(200))
    with FileSink(path) as sink:
        recorder = Recorder(source, sink, unit="uT")
        asked = 0
        while recorder.statistics.readings < 200 and asked < 20:
            recorder.next(0.05)
            asked += 1
        recorder.close()
    assert [int(row.split(",")[1]) for row in rows(path)] == list(range(200))
    assert asked < 20


def lost(path: Path) -> int:
    """Datagrams that the recording says were lost."""
    return sum(int(line.split()[1]) for line in path.read_text(encoding="utf-8").splitlines() if "lost by" in line)


@LINUX
def test_at_1_khz_nothing_is_lost_while_a_thread_computes(tmp_path: Path) -> None:
    """0.8 s beside a thread that never waits."""
    path, source, is_over = tmp_path / "fast.csv", Udp(0, "127.0.0.1"), threading.Event()

    def compute() -> None:
        while not is_over.is_set():
            sum(range(1000))

    busy = threading.Thread(target=compute)
    with FileSink(path) as sink:
        pump = FeedThread(Recorder(source, sink, unit="uT"))
        busy.start()
        pump.start()
        begun = time.monotonic()
        for number in range(0, 800, 10):
            send(source.port, range(number, number + 10))
            time.sleep(max(begun + number / 1000 - time.monotonic(), 0.0))
        wait_until(lambda: len(rows(path)) + lost(path) >= 800)
        is_over.set()
        busy.join()
        pump.stop()
    assert len(rows(path)) + lost(path) == 800
    assert lost(path) == 0


@LINUX
def test_what_this_machine_throws_away_is_counted_told_and_noted(tmp_path: Path) -> None:
    path, source = tmp_path / "flood.csv", Udp(0, "127.0.0.1")
    source._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 20_000)
    clock = iter(range(10_000))
    with FileSink(path) as sink:
        recorder = Recorder(source, sink, unit="uT", clock=lambda: float(next(clock)))
        send(source.port, range(1000))
        events: list[FeedEvent] = []
        for more in (range(0), range(1000, 1003), range(0), range(0)):
            send(source.port, more)
            for _ in range(5):
                found = recorder.next(0.01)
                events += [found] if isinstance(found, FeedEvent) else []
        recorder.close()
    kept = len(rows(path))
    lost = 1003 - kept
    assert 0 < kept < 1000
    assert [event.words.split(" were lost")[0] for event in events if event.kind == "lost"] == [f"{lost} datagrams"]
    assert f"# {lost} datagrams were" in path.read_text(encoding="utf-8")
    assert recorder.statistics.datagrams_lost == lost
    assert f"{lost} datagrams lost" in str(recorder.statistics)


def test_a_full_disk_is_said_once_and_nothing_is_missing_when_there_is_room_again(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    said: list[str] = []
    path, now = tmp_path / "full.csv", [0.0]
    sink = RetryingSink(FileSink(path), said.append, lambda: now[0])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    sink.write("1,2,3\n")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8, before[1]))
        for second in range(5):
            now[0] = float(second)
            sink.write(f"{second},5,6\n")
            sink.sync()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(said) == 1
    assert sink.why.startswith(f"{path}: cannot be written")
    sink.write("7,8,9\n")
    assert path.read_text(encoding="utf-8") == "1,2,3\n"
    now[0] += RETRY_S
    sink.write("8,8,9\n")
    assert sink.why == ""
    assert_sentences(said[1:])
    sink.close()
    assert rows(path) == ["1,2,3", *(f"{second},5,6" for second in range(5)), "7,8,9", "8,8,9"]


def test_a_disk_that_stays_full_is_an_error_in_the_end(tmp_path: Path) -> None:
    path = tmp_path / "full.csv"
    file = FileSink(path)
    sink = RetryingSink(file, lambda _: None)
    os.close(file._file)
    file._file = os.open(path, os.O_RDONLY)  # nothing can be written any more
    sink.write("1,2,3\n")
    with assert_raises(OutputError) as found:
        sink.close()
    assert found.value.exit_code == 6
