"""`flinders record`: all that arrives is kept, reads back, and outlives a crash, an unplugged cable and a full disk."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.waiting import PATIENCE_S, Heartbeat, wait_until

from flinders import simulate
from flinders.cli import main
from flinders.errors import LinkError, OutputError, OutputExists, UnreadableInput
from flinders.links.line_form import recognise_form
from flinders.links.recorder import Recorder
from flinders.links.recording_text import escape_bytes
from flinders.links.sinks import FileSink
from flinders.links.transports import Disconnection, ScriptedSource, Serial, Silence, Tcp, Udp
from flinders.readers import read

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.links.recording_statistics import RecordingStatistics

FIELD = np.round(simulate.tumble(seed=3).samples.field[:40], 1)
"""µT to the 0.1 µT of MotionCal's counts."""


def raw(rows: Floats = FIELD, end: str = "\r\n", sign: str = "Raw:") -> bytes:
    return "".join(f"{sign}0,0,8192,0,0,16,{','.join(f'{10 * v:.0f}' for v in row)}{end}" for row in rows).encode()


def table(rows: Floats = FIELD, delimiter: str = ",", end: str = "\n", header: str = "") -> bytes:
    return (header + "".join(delimiter.join(f"{value:.1f}" for value in row) + end for row in rows)).encode()


def recorded(
    steps: Iterable[bytes | Disconnection | Silence], *, is_framed: bool = False, **more: object
) -> tuple[RecordingStatistics, str]:
    """Record a script to its end; what was told, and the file."""
    source, path = ScriptedSource(steps, is_framed=is_framed), Path("out.csv")
    with FileSink(path, force=True) as sink:
        told = Recorder(source, sink, stopped=lambda: source.is_done, **more).run()  # type: ignore[arg-type]
    return told, path.read_text(encoding="utf-8")


def rows_of(text: str) -> list[str]:
    return [line for line in text.splitlines() if line[:1].isdigit() or line[:1] == "-"]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# what lines are understood


@pytest.mark.parametrize("end", ["\r\n", "\n", "\r"])
@pytest.mark.parametrize("sign", ["Raw:", "Raw ", "Raw: "])
def test_lines_of_motioncal_however_they_are_written(end: str, sign: str) -> None:
    told, _ = recorded([b"booting" + end.encode() + raw(end=end, sign=sign)])
    assert (told.readings, told.unknown) == (40, 1)
    samples = read("out.csv")
    np.testing.assert_allclose(samples.field, FIELD)
    assert samples.acceleration is not None
    np.testing.assert_array_equal(samples.acceleration, [[0, 0, 1]] * 40)
    assert samples.rate is not None
    np.testing.assert_allclose(samples.rate[:, 2], np.deg2rad(1))
    assert samples.time is not None
    assert (np.diff(samples.time) > 0).all()


def test_decimals_in_lines_of_motioncal_are_kept() -> None:
    recorded([b"Raw:0,0,8192,0,0,16,217.25,4.5,-586\n" * 3])
    np.testing.assert_allclose(read("out.csv").field[0], [21.725, 0.45, -58.6])


def test_uni_lines_beside_raw_ones_are_kept_as_comments() -> None:
    pair = b"Raw:0,0,8192,0,0,0,217,4,-586\r\nUni:0.01,0.02,9.81,0,0,0,21.72,0.41,-58.63\r\n"
    told, text = recorded([pair * 10])
    assert (told.readings, told.unknown) == (10, 0)
    assert text.count("# Uni:0.01,0.02,9.81,0,0,0,21.72,0.41,-58.63") == 10
    told, _ = recorded([pair[pair.index(b"Uni") :] * 3])
    np.testing.assert_allclose(read("out.csv").field[0], [21.72, 0.41, -58.63])


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  ", ", "])
def test_tables_with_any_delimiter_get_a_time(delimiter: str) -> None:
    told, text = recorded([table(delimiter=delimiter, header="mx_uT,my_uT,mz_uT\n".replace(",", delimiter))])
    assert told.readings == 40, text
    samples = read("out.csv")
    np.testing.assert_allclose(samples.field, FIELD)
    assert samples.time is not None


def test_a_table_without_header_loses_the_line_that_may_be_cut_and_no_other() -> None:
    told, text = recorded([table()])
    assert told.readings == 39
    assert f"# cut off: {','.join(f'{value:.1f}' for value in FIELD[0])}\n" in text
    np.testing.assert_allclose(read("out.csv", unit="uT").field, FIELD[1:])


def test_a_decimal_comma_is_kept() -> None:
    content = table(delimiter=";", header="mx_uT;my_uT;mz_uT\n").replace(b".", b",")
    recorded([content])
    np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_a_time_of_its_own_is_left_alone() -> None:
    lines = b"t_ms,mx_uT,my_uT,mz_uT\n" + b"".join(b"%d,1,2,%d\n" % (20 * n, n) for n in range(30))
    _, text = recorded([lines])
    assert "t_s" not in text
    time = read("out.csv").time
    assert time is not None
    np.testing.assert_allclose(np.diff(time), 0.02)


def test_json_lines_become_a_table_with_the_digits_as_they_came() -> None:
    lines = b"".join(b'{"mag": {"x": 1.50, "y": %d, "z": -3}, "T_C": 21.30}\n' % n for n in range(30))
    told, text = recorded([lines])
    assert told.readings == 30
    assert "t_s,mag.x,mag.y,mag.z,T_C\n" in text
    assert rows_of(text)[0].endswith(",1.50,0,-3,21.30")
    np.testing.assert_array_equal(read("out.csv", unit="uT").field[:, 1], range(30))
    recorded([b"[1, 2, 3.50]\n" * 30])
    np.testing.assert_allclose(read("out.csv").field[0], [1, 2, 3.5])


def test_datagrams_of_magcc_need_no_line_end() -> None:
    datagrams = [f"|{0.1 * n:.2f},0,0,9.8,0,0,0.1,0.21,{n / 100},-0.58,0,0,1.57*".encode() for n in range(30)]
    told, _ = recorded(datagrams, is_framed=True)
    assert (told.readings, str(told.form)) == (30, "magcc datagrams")
    samples = read("out.csv", unit="G")
    np.testing.assert_allclose(samples.field[:, 1], np.arange(30.0))
    assert samples.time is not None
    np.testing.assert_allclose(np.diff(samples.time), 0.1)


def test_columns_that_are_not_clear_are_all_recorded() -> None:
    told, text = recorded([b"x\n" + b"1,2,3,4,5,6,21.7,0.4,-58.6\n" * 30])
    assert told.readings == 30
    assert "t_s,c1,c2,c3,c4,c5,c6,c7,c8,c9\n" in text
    np.testing.assert_allclose(read("out.csv", columns="c7,c8,c9", unit="uT").field[0], [21.7, 0.4, -58.6])


@pytest.mark.parametrize("line", ["", "ready", "1,2", "12:30:05", "Raw:", "{}", '{"a": 1}', "|1,2*", "0x10 0x20"])
def test_what_holds_no_three_numbers_settles_nothing(line: str) -> None:
    assert recognise_form([line] * 5) is None


# nothing is lost


def test_what_is_not_understood_is_kept_byte_for_byte() -> None:
    odd = b"\xff\xfe\x00 garbled \\ \xc2\xb5T"
    told, text = recorded([raw(FIELD[:20]), odd + b"\r\nCal1:1,2,3\r\n", raw(FIELD[20:])])
    assert (told.readings, told.unknown) == (40, 1)  # an echo of a calibration is understood, and no reading
    kept = next(line for line in text.splitlines() if "garbled" in line).removeprefix("# ")
    assert kept.encode().decode("unicode_escape").encode("latin-1") == odd
    assert "# Cal1:1,2,3\n" in text
    np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_any_cuts_give_the_same_rows() -> None:
    content = raw()
    rng = np.random.default_rng(0)
    for _ in range(20):
        cuts = np.sort(rng.integers(0, len(content), 15)).tolist()
        pieces = [content[a:b] for a, b in zip([0, *cuts], [*cuts, len(content)], strict=True)]
        told, _ = recorded([piece for piece in pieces if piece])
        assert told.readings == 40
        np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_a_line_without_end_is_kept_as_cut_off() -> None:
    _, text = recorded([raw() + b"Raw:0,0,81"])
    assert text.endswith("# cut off: Raw:0,0,81\n")


def test_bytes_without_any_line_end_do_not_fill_the_memory() -> None:
    with assert_raises(UnreadableInput):
        recorded([b"\x80" * 5000] * 20)
    text = Path("out.csv").read_text(encoding="utf-8")
    assert text.count("\\x80") == 100_000


def test_a_board_that_starts_anew_repeats_its_header_in_vain() -> None:
    header = "mx_uT,my_uT,mz_uT\n"
    told, _ = recorded([table(FIELD[:20], header=header), table(FIELD[20:], header=header)])
    assert (told.readings, told.unknown) == (40, 0)
    np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_lines_that_change_their_form_are_told() -> None:
    said: list[str] = []
    told, _ = recorded([raw(), b"1;2;3\n" * 60], say=said.append)
    assert told.unknown == 60
    assert_sentences(said)


def test_it_ends_after_so_many_readings_or_seconds() -> None:
    told, text = recorded([raw()], readings=7)
    assert told.readings == len(rows_of(text)) == 7
    told, _ = recorded([raw(), *[Silence(0.05)] * 99], seconds=0.3)
    assert told.readings == 40
    assert 0.3 <= told.seconds < 0.5


def test_silence_and_noise_are_no_recording() -> None:
    with assert_raises(UnreadableInput):
        recorded([])
    Path("out.csv").write_text("1,2,3\n", encoding="utf-8")
    with pytest.raises(UnreadableInput):
        recorded([])  # over a file that is there
    assert Path("out.csv").read_text(encoding="utf-8") == "1,2,3\n"
    with pytest.raises(UnreadableInput, match="'hello'"):
        recorded([b"hello\n"])


def test_a_full_disk_says_what_is_saved() -> None:
    sink = FileSink("full.csv")
    keep, sink._file = sink._file, os.open("/dev/full", os.O_WRONLY)
    os.close(keep)
    with assert_raises(OutputError):
        Recorder(ScriptedSource([raw()]), sink, readings=40).run()
    with pytest.raises(OutputExists):
        FileSink("full.csv")


def test_escaped_bytes_are_printable_ascii() -> None:
    every = bytes(range(256))
    assert escape_bytes(every).isascii()
    assert escape_bytes(every).isprintable()
    assert escape_bytes(every).encode().decode("unicode_escape").encode("latin-1") == every


# ports


class Board:
    """The other end of a pseudo-terminal, under a name that stays when it is plugged in again."""

    def __init__(self, name: str = "board") -> None:
        self.port = Path(name).absolute()
        self.plug()

    def plug(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        self.port.unlink()
        os.close(self._slave)
        os.close(self.master)


def program(*words: str) -> subprocess.Popen[str]:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    return subprocess.Popen(
        [sys.executable, "-c", code, "record", *words], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def wait_for(path: str, rows: int) -> None:
    file = Path(path)
    wait_until(
        lambda: file.exists() and len(rows_of(file.read_text(encoding="utf-8"))) >= rows,
        lambda: f"{rows} rows in {path}",
    )


@pytest.mark.nightly
def test_two_thousand_lines_at_five_hundred_a_second_arrive_complete() -> None:
    board, lines = Board(), [raw(np.array([[n / 10, 20.0, 30.0]])) for n in range(2000)]
    source = Serial(str(board.port))

    def send() -> None:
        start = time.monotonic()
        for n, line in enumerate(lines):
            time.sleep(max(start + n / 500 - time.monotonic(), 0))
            os.write(board.master, line)

    sender = threading.Thread(target=send)
    with FileSink("out.csv") as sink, Heartbeat() as heartbeat:
        sender.start()
        told = Recorder(source, sink, readings=2000, seconds=PATIENCE_S).run()
    sender.join()
    source.close()
    board.unplug()
    assert (told.readings, told.unknown) == (2000, 0)
    assert told.rate_hz == pytest.approx(500, rel=0.02 + heartbeat.worst_s)
    np.testing.assert_allclose(read("out.csv").field[:, 0], np.arange(2000) / 10)


def test_a_killed_program_loses_less_than_a_second() -> None:
    board = Board()
    running = program("--serial", str(board.port), "-o", "out.csv")
    wait_for("out.csv", 0)
    sent = 0
    with Heartbeat() as heartbeat:
        while sent < 300:  # 100 lines/s
            os.write(board.master, raw(np.array([[sent / 10, 20.0, 30.0]])))
            sent += 1
            time.sleep(0.01)
    running.send_signal(signal.SIGKILL)
    running.communicate()
    board.unplug()
    field = read("out.csv").field
    assert field[-1, 0] * 10 >= sent - 100 * (1.0 + 5.0 * heartbeat.worst_s)
    np.testing.assert_allclose(np.diff(field[:, 0]), 0.1)  # and none in between


def test_an_unplugged_board_is_waited_for() -> None:
    board = Board()
    running = program("--serial", str(board.port), "--readings", "80", "-o", "out.csv", "--json")
    wait_for("out.csv", 0)
    os.write(board.master, raw() + b"Raw:0,0,81")
    wait_for("out.csv", 40)
    board.unplug()
    assert running.stderr is not None
    assert any("is gone" in line for line in running.stderr)
    board.plug()
    until = time.monotonic() + PATIENCE_S
    while running.poll() is None and time.monotonic() < until:
        os.write(board.master, raw(FIELD[:10]))
        time.sleep(0.1)
    out, err = running.communicate(timeout=PATIENCE_S)
    board.unplug()
    assert running.returncode == 0, err
    assert "is back" in err
    told = json.loads(out)
    assert (told["readings"], told["disconnections"]) == (80, 1)
    text = Path("out.csv").read_text(encoding="utf-8")
    assert "# cut off: Raw:0,0,81\n" in text
    assert "# lost at " in text
    assert "# back at " in text
    np.testing.assert_allclose(read("out.csv").field[:40], FIELD)


def test_ctrl_c_ends_a_recording_well() -> None:
    board = Board()
    running = program("--serial", str(board.port), "-o", "out.csv")
    wait_for("out.csv", 0)
    os.write(board.master, raw())
    wait_for("out.csv", 40)
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=PATIENCE_S)
    board.unplug()
    assert running.returncode == 0, err
    assert "40 readings (Raw: lines)" in err
    assert_sentences(err, about="next: ")


def test_udp_is_heard() -> None:
    source = Udp(0, "127.0.0.1")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        for row in FIELD:
            sensor.sendto(raw(row[None]).rstrip(), ("127.0.0.1", source.port))
        with FileSink("out.csv") as sink:
            assert Recorder(source, sink, readings=40, seconds=5).run().unknown == 0
    np.testing.assert_allclose(read("out.csv").field, FIELD)
    with assert_raises(LinkError):
        Udp(source.port, "127.0.0.1")
    source.close()


def test_tcp_is_heard_until_the_other_end_closes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = Tcp("127.0.0.1", server.getsockname()[1])
        peer, _ = server.accept()
        peer.sendall(raw())
        peer.close()
        said: list[str] = []
        with FileSink("out.csv") as sink:
            told = Recorder(source, sink, seconds=0.5, say=said.append).run()
    source.close()
    assert told.readings == 40
    assert told.disconnections >= 1
    assert_sentences(said)


def test_the_recording_streams_into_calibrate() -> None:
    content = simulate.tumble(seed=1).samples.field[:400]
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        running = program("--tcp", address, "--readings", "400", "-o", "-")
        peer, _ = server.accept()
        peer.sendall(raw(content))
        out, err = running.communicate(timeout=PATIENCE_S)
        peer.close()
    assert running.returncode == 0, err
    ended = CliRunner().invoke(main, ["calibrate", "-"], input=out)
    assert ended.exit_code == 0, ended.output
    assert "400 readings" in ended.output


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("-o", "a.csv"), 2),
        (("--udp", "5000", "--tcp", "a:1", "-o", "a.csv"), 2),
        (("--serial", "/dev/ttyNONE"), 2),
        (("--serial", "/dev/ttyNONE", "-o", "a.csv"), 5),
        (("--serial", "/dev/ttyNONE", "-o", "old.csv"), 6),
        (("--serial", "/dev/ttyNONE", "-o", "none/a.csv"), 6),
        (("--udp", "70000", "-o", "a.csv"), 2),
        (("--tcp", "nowhere", "-o", "a.csv"), 2),
        (("--tcp", "127.0.0.1:1", "-o", "a.csv"), 5),
        (("--tcp", "nohost.invalid:80", "-o", "a.csv"), 5),
        (("--udp", "5000", "--seconds", "0", "-o", "a.csv"), 2),
        (("--udp", "5000", "--readings", "0", "-o", "a.csv"), 2),
        (("--udp", "5000", "-o", "-", "--json"), 2),
        (("--serial", "old.csv", "-o", "a.csv"), 5),
    ],
)
def test_mistakes_end_in_a_line(words: tuple[str, ...], code: int) -> None:
    Path("old.csv").write_text("a")
    ended = CliRunner().invoke(main, ["record", *words])
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.stderr)
    assert "Traceback" not in ended.output
    assert not Path("a.csv").exists()
