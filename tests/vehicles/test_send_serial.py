"""`flinders send --serial`: over a pseudo-terminal, to a board that checks the CRC and echoes, or does neither."""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
import tty
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.waiting import PATIENCE_S, wait_until

from flinders.cli import main
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import LinkError, NotConfirmed
from flinders.links import motioncal
from flinders.links.transports import Serial
from flinders.targets.motioncal import MotionCalPacket

if TYPE_CHECKING:
    from collections.abc import Iterator

    from click.testing import Result

MATRIX = [[1.1034567, 0.0512345, -0.0234567], [0.0512345, 0.9123456, 0.0312345], [-0.0234567, 0.0312345, 1.0234567]]
RAW = b"Raw:12,-3,8190,1,0,-2,217,4,-586\r\n"


def found(**more: object) -> Calibration:
    return Calibration(np.array(MATRIX), np.array([12.3456789, -30.98765, 7.000432]), 49.1, raw=Unit.of("uT"), **more)  # type: ignore[arg-type]


PACKET = MotionCalPacket.of(found())


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found().save("cal.json")


class Board:
    """A sketch: prints readings, takes a packet whose CRC is right, echoes what it holds.

    `digits` of the echo; `drops` bytes of the first packet; `garbles` the echo; `stalls` and prints nothing more;
    `unplugs` on the first byte; `resets` on the first bytes and comes back under the same name after so many seconds;
    `is_mute` prints no echo; `falls_mute` prints none once it was sent something; `wakes` prints none before; `floods`
    prints so many readings with each; `swaps` the first two offsets that it is sent.
    """

    def __init__(
        self,
        *,
        digits: int = 3,
        drops: int = 0,
        garbles: bool = False,
        stalls: bool = False,
        unplugs: bool = False,
        is_mute: bool = False,
        is_deaf: bool = False,
        resets: float | None = None,
        falls_mute: bool = False,
        wakes: bool = False,
        floods: int = 1,
        swaps: bool = False,
    ) -> None:
        self.name = Path("board")
        self._plug()
        self.resets, self.falls_mute, self.wakes = resets, falls_mute, wakes
        self.floods, self.swaps = floods, swaps
        self.digits, self.drops, self.garbles = digits, drops, garbles
        self.stalls, self.unplugs, self.is_mute, self.is_deaf = stalls, unplugs, is_mute, is_deaf
        self.held = MotionCalPacket(np.array([1.0, 2.0, 3.0]), 40.0, np.eye(3))
        self.accepted = self.refused = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def _plug(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(os.ttyname(self._slave))

    def _unplug(self) -> None:
        """Its name goes first: the number of its terminal may be that of another board at once."""
        self.name.unlink()
        os.close(self._slave)
        os.close(self.master)

    def _live(self) -> None:
        buffer = b""
        while not self._ended.is_set():
            if not (self.stalls and self.accepted + self.refused):
                self._print()
            if select.select([self.master], [], [], 0.02)[0]:
                arrived = os.read(self.master, 4096)
                if self.unplugs or self.resets is not None:
                    self._unplug()
                    if self.resets is None:
                        return
                    time.sleep(self.resets)
                    self.resets = None
                    self._plug()
                    continue
                arrived, self.drops = arrived[self.drops :], max(self.drops - len(arrived), 0)
                buffer = self._take(buffer + arrived)

    def _print(self) -> None:
        is_mute = self.is_mute or (self.falls_mute and self.accepted > 0) or (self.wakes and not self.accepted)
        with suppress(BlockingIOError):  # as a sketch does, a full buffer is waited out
            os.write(self.master, RAW * self.floods + (b"" if is_mute else self._echo()))

    def _take(self, buffer: bytes) -> bytes:
        """As the sketches do: shift bytes in until 68 of them begin rightly and have the CRC."""
        while len(buffer) >= 68:
            candidate = buffer[:68]
            if candidate[:2] == b"\x75\x54" and crc(candidate) == 0:
                self.accepted += 1
                if not self.is_deaf:
                    values = struct.unpack("<16f", candidate[2:66])
                    xx, yy, zz, xy, xz, yz = values[10:]
                    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                    first, second = (7, 6) if self.swaps else (6, 7)
                    self.held = MotionCalPacket(np.array([values[first], values[second], values[8]]), values[9], matrix)
                return buffer[68:]
            self.refused += 1
            buffer = buffer[1:]
        return buffer

    def _echo(self) -> bytes:
        offsets = [0.0] * 6 + [*self.held.offset, self.held.strength]
        lines = ""
        for name, values in (("Cal1", offsets), ("Cal2", self.held.matrix.ravel())):
            lines += f"{name}:{','.join(f'{value:.{self.digits}f}' for value in values)}\r\n"
        return lines.replace(".", "?", 3).encode() if self.garbles else lines.encode()

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        if not self.unplugs:
            self._unplug()


def crc(content: bytes) -> int:
    """CRC-16/MODBUS, written down once more from its definition."""
    register = 0xFFFF
    for byte in content:
        register ^= byte
        for _ in range(8):
            register, carry = register >> 1, register & 1
            register ^= 0xA001 * carry
    return register


@contextmanager
def board(**more: object) -> Iterator[Board]:
    one = Board(**more)  # type: ignore[arg-type]
    one.start()
    try:
        yield one
    finally:
        one.stop()


def sent(one: Board, **more: float) -> motioncal.Confirmation:
    source = Serial(str(one.name))
    try:
        return motioncal.send(source, PACKET, answer=more.get("answer", 1.0), boot=1.0, tries=int(more.get("tries", 3)))
    finally:
        source.close()


@pytest.mark.parametrize("digits", [2, 3, 4, 9])
def test_an_echo_of_two_digits_or_more_confirms(digits: int) -> None:
    with board(digits=digits) as one:
        confirmed = sent(one)
        assert (confirmed.places, confirmed.tries) == (digits, 1)
    np.testing.assert_array_equal(one.held.matrix, PACKET.matrix.astype(np.float32))
    np.testing.assert_array_equal(one.held.offset, PACKET.offset.astype(np.float32))
    assert one.held.strength == PACKET.strength


def test_a_packet_that_lost_bytes_is_sent_again() -> None:
    with board(drops=5) as one:
        confirmed = sent(one, answer=0.3)
    assert confirmed.tries == 2
    assert one.refused > 0  # the board saw bytes with a wrong CRC and did not take them
    assert one.accepted == 1


def test_a_board_that_keeps_its_old_values_is_no_success() -> None:
    with board(is_deaf=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.2)
    assert one.accepted == 3


@pytest.mark.parametrize("wakes", [False, True], ids=["echo before", "no echo before"])
def test_a_board_that_took_other_values_is_not_said_to_have_taken_none(*, wakes: bool) -> None:
    with board(swaps=True, wakes=wakes) as one, pytest.raises(NotConfirmed) as refused:
        sent(one, answer=0.2)
    np.testing.assert_allclose(one.held.offset, PACKET.offset[[1, 0, 2]], rtol=1e-6)
    assert_sentences(str(refused.value))
    assert "still" not in str(refused.value)


def test_digits_that_are_too_few_are_other_numbers() -> None:
    with (
        board(digits=1) as one,
        assert_raises(NotConfirmed),
    ):
        sent(one, answer=0.2)
    assert one.accepted == 3


def test_without_an_echo_from_before_nothing_is_said_of_old_values() -> None:
    with board(is_deaf=True, wakes=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.2)


def test_an_echo_that_cannot_be_read_is_no_success() -> None:
    with board(garbles=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.2)


def test_a_board_without_echo_is_told_from_one_that_stalls() -> None:
    with board(is_mute=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.2)
    with board(stalls=True, is_deaf=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.2, tries=2)


def test_a_board_that_is_unplugged_may_hold_either() -> None:
    with board(unplugs=True) as one, assert_raises(NotConfirmed):
        sent(one, answer=0.5)


def test_a_board_that_starts_anew_on_the_way_is_sent_the_packet_again() -> None:
    with board(resets=0.3) as one:
        confirmed = sent(one, answer=1.0)
    assert (confirmed.tries, one.accepted) == (2, 1)
    np.testing.assert_array_equal(one.held.offset, PACKET.offset.astype(np.float32))


def test_a_flood_of_readings_does_not_hide_the_echo() -> None:
    with board(floods=100) as one:  # 3.4 kB between two echoes, as fast as the port takes them
        assert sent(one).tries == 1


def test_the_echo_of_the_values_before_confirms_nothing() -> None:
    """A board that has said what it held, and says no more when it is sent something else."""
    with (
        board(falls_mute=True) as one,
        assert_raises(NotConfirmed),
    ):
        sent(one, answer=0.2)
    one = Board(is_deaf=True)
    one.held = MotionCalPacket(PACKET.offset, PACKET.strength, np.eye(3))  # of the first line all agrees, nothing else
    one.start()
    with assert_raises(NotConfirmed):
        sent(one, answer=0.2)
    one.stop()


def test_a_silent_port_is_no_board() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    source = Serial(os.ttyname(slave))
    with assert_raises(NotConfirmed):
        motioncal.send(source, PACKET, answer=0.1, boot=0.1)
    source.close()
    os.close(master)
    os.close(slave)


def test_motioncals_own_tolerance_would_refuse_three_decimals() -> None:
    """Why there is a wider one: MotionCal's is 0.0001 + 0.00003 |x|, and a sketch prints 0.5004567 as 0.500."""
    held, wrong = motioncal.Echo.of("0.500", 1), motioncal.Echo.of("0.499", 1)
    assert held is not None
    assert wrong is not None
    assert abs(0.500 - 0.5004567) > 0.0001 + 0.00003 * 0.5004567
    assert held.first_difference((0.5004567,)) is None
    assert wrong.first_difference((0.5004567,)) == 0


@pytest.mark.parametrize("text", ["", "1,2", "nan,1,2", "1e3,1,2", "1;2;3", "1,2,3,4", "0x10,1,2"])
def test_what_is_no_echo_is_none(text: str) -> None:
    assert motioncal.Echo.of(text, 3) is None


def test_a_port_that_is_not_there_names_those_that_are() -> None:
    with assert_raises(LinkError):
        Serial("/dev/ttyNONE")


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("a")
    with assert_raises(LinkError):
        Serial(str(tmp_path / "notes.txt"))


# the command


def send(*words: str) -> Result:
    return CliRunner().invoke(main, ["send", *words])


def test_the_command_sends_and_says_that_it_is_confirmed() -> None:
    with board() as one:
        ended = send("--serial", str(one.name), "cal.json", "--json")
    assert ended.exit_code == 0, ended.output
    told = json.loads(ended.stdout)
    assert told["sent"] is True
    assert bytes.fromhex(told["packet"]) == PACKET.encode()
    assert_sentences(ended.stderr)


def test_ctrl_c_says_what_the_board_may_hold() -> None:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    with board(is_deaf=True) as one:
        words = [sys.executable, "-c", code, "send", "--serial", str(one.name), "cal.json"]
        running = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
        wait_until(lambda: one.accepted)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 130, err
    assert_sentences(err)


def test_a_dry_run_opens_no_port() -> None:
    ended = send("--serial", "/dev/ttyNONE", "--dry-run", "cal.json")
    assert ended.exit_code == 0, ended.output
    assert PACKET.encode().hex() in "".join(ended.stdout.split())
    assert motioncal.echo_lines(PACKET)[1] in ended.stdout


def test_what_the_packet_cannot_hold_is_refused() -> None:
    Calibration(np.eye(3), np.zeros(3), 490.0, raw=Unit.of("counts")).save("counts.json")
    ended = send("--serial", "/dev/ttyNONE", "counts.json")
    assert ended.exit_code == 2
    assert "counts" in ended.stderr
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    Calibration(turn, np.zeros(3), 49.0, raw=Unit.of("uT"), rotation="estimated").save("turned.json")
    ended = send("--serial", "/dev/ttyNONE", "turned.json")
    assert ended.exit_code == 4


def test_mapped_axes_are_unmapped_and_told() -> None:
    found(axes=Axes.of("y,x,-z")).save("mapped.json")
    ended = send("--serial", "x", "--dry-run", "--json", "mapped.json")
    assert json.loads(ended.stdout)["offset_uT"] == pytest.approx([-30.98765, 12.3456789, -7.000432])
    assert "y,x,-z" in ended.stderr


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serialx", None)
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.common", None)
    ended = send("--serial", "/dev/ttyACM0", "cal.json")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)
    ended = send("--mavlink", "udp:127.0.0.1:0x", "cal.json")
    assert ended.exit_code == 2
    ended = send("--mavlink", "udpout:127.0.0.1:9", "cal.json")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("cal.json",), 2),
        (("--serial", "a", "--mavlink", "b", "cal.json"), 2),
        (("--serial", "a", "--compass", "2", "cal.json"), 2),
        (("--serial", "/dev/ttyNONE", "cal.json"), 5),
        (("--serial", "/dev/null", "cal.json"), 5),
        (("--serial", "/dev/ttyNONE", "none.json"), 5),
        (("--serial", "/dev/ttyNONE", "-"), 2),
        (("--serial", "/dev/ttyNONE", "--baud", "0", "cal.json"), 2),
    ],
)
def test_mistakes_end_in_a_line(words: tuple[str, ...], code: int) -> None:
    ended = send(*words)
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.stderr)
    assert "Traceback" not in ended.output
