"""Which serial port is taken where none is named: that of a board, and of nothing else, however ports are listed."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any, Final

import pytest
import serialx
from tests.program import Ended, flinders_
from tests.sentences import assert_sentences
from tests.waiting import Heartbeat

from flinders.errors import LinkError, UsageError
from flinders.links import serial_ports
from flinders.links.serial_ports import ANY_PORT, board_port, describe_ports, find_board_port, ports
from flinders.links.transports import open_lines

if TYPE_CHECKING:
    from pathlib import Path

SAID_S: Final = 2.0  # in which the terminal says that no board is there


def listed(device: str, product: str | None = None, vid: int | None = None, path: str | None = None) -> Any:  # noqa: ANN401
    """A port as serialx lists it."""
    found: dict[str, Any] = dict.fromkeys(each.name for each in dataclasses.fields(serialx.SerialPortInfo))
    found |= {"device": path or device, "resolved_device": device, "vid": vid, "product": product}
    return serialx.SerialPortInfo(**found)


NANO: Final = listed("/dev/ttyACM0", "Arduino Nano 33 BLE", 0x2341, "/dev/serial/by-id/usb-Arduino_Nano-if00")
ESP32: Final = listed("/dev/ttyACM1", "USB JTAG/serial debug unit", 0x303A)
CHEAP: Final = listed("COM7", None, 0x1A86)
MAINBOARD: Final = (listed("/dev/ttyS0"), listed("/dev/ttyAMA0"), listed("COM1", "Communications Port (COM1)"))
BLUETOOTH: Final = (
    listed("/dev/cu.Bluetooth-Incoming-Port"), listed("/dev/rfcomm0"),
    listed("COM4", "Standard Serial over Bluetooth link (COM4)"),
)  # fmt: skip
MODEMS: Final = (
    listed("/dev/ttyUSB2", "EG25-G", 0x2C7C), listed("/dev/ttyACM3", "F5521gw Mobile Broadband Modem", 0x1234),
    listed("COM9", "LTE modem", 0x1234),
)  # fmt: skip
CONSOLES: Final = (listed("/dev/cu.debug-console"), listed("/dev/cu.wlan-debug"), listed("/dev/ttyGS0"))
NO_BOARDS: Final = (*MAINBOARD, *BLUETOOTH, *MODEMS, *CONSOLES)


def plug(monkeypatch: pytest.MonkeyPatch, *found: Any) -> None:
    monkeypatch.setattr(serialx, "list_serial_ports", lambda: list(found))


@pytest.mark.parametrize("found", NO_BOARDS, ids=lambda port: port.resolved_device)
def test_a_port_that_is_no_board_s_is_not_taken_by_itself(found: Any, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ANN401
    plug(monkeypatch, found)
    assert find_board_port() is None
    with pytest.raises(LinkError) as refused:
        board_port()
    assert refused.value.hint == {"port": found.resolved_device}


@pytest.mark.parametrize("board", [NANO, ESP32, CHEAP], ids=lambda port: port.resolved_device)
def test_the_one_board_is_found_among_all_other_ports(board: Any, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ANN401
    plug(monkeypatch, *MAINBOARD, board, *MODEMS)
    assert board_port() == find_board_port() == board.device
    assert describe_ports().startswith(f"there are {board.resolved_device}")


def test_of_two_boards_one_has_to_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch, NANO, ESP32)
    for find in (board_port, find_board_port):
        with pytest.raises(UsageError) as refused:
            find()
        assert refused.value.hint == {"port": "/dev/ttyACM0"}


def test_a_machine_without_ports_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch)
    assert (ports(), find_board_port()) == ([], None)
    with pytest.raises(LinkError) as refused:
        board_port()
    assert refused.value.hint == {}


def test_ports_that_cannot_be_listed_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def denied() -> list[Any]:
        raise OSError

    monkeypatch.setattr(serialx, "list_serial_ports", denied)
    assert ports() == []


def test_a_named_port_is_taken_whatever_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch, *NO_BOARDS)
    master, slave = os.openpty()
    source = open_lines(port=os.ttyname(slave))
    assert source.name == os.ttyname(slave)
    source.close()
    os.close(master)
    os.close(slave)


def test_the_port_that_stays_the_same_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board that is plugged in again may be ttyACM1 then."""
    master, slave = os.openpty()
    plug(monkeypatch, *MAINBOARD, listed("/dev/ttyACM0", "Nano", 0x2341, os.ttyname(slave)))
    source = open_lines(port=ANY_PORT)
    assert source.name == os.ttyname(slave)
    source.close()
    os.close(master)
    os.close(slave)


COMMANDS: Final = (("live", "--serial", "--no-open"), ("record", "--serial", "-o", "x.csv"), ("watch", "--serial"))


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
def test_a_command_without_a_board_ends_with_the_ports_there_are(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plug(monkeypatch, *MAINBOARD)
    ended = flinders_(*words)
    assert ended.code == LinkError.exit_code
    assert_sentences(ended.said)
    assert all(port.resolved_device in ended.said for port in MAINBOARD)
    assert list(tmp_path.iterdir()) == []


def test_the_terminal_says_within_two_seconds_that_no_board_is_there(tmp_path: Path) -> None:
    """As a program of its own, on this machine with what ports it has; a board on it is one of several."""
    code = (
        "import sys, serialx; serialx.list_serial_ports = lambda: []\n"
        "from flinders.cli import main; main(['live', '--serial', '--no-open'])"
    )
    with Heartbeat() as heartbeat:
        begun = time.monotonic()
        ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
        took = time.monotonic() - begun
    assert (ended.returncode, ended.stdout) == (LinkError.exit_code, "")
    assert_sentences(ended.stderr)
    assert took < SAID_S + 20.0 * heartbeat.worst_s


def live(*words: str) -> Ended:
    return flinders_("live", "--no-open", "--output", "there/none.csv", *words)


@pytest.mark.parametrize("port", ["/dev/ttyNONE", "COM99", "com99"])
def test_a_serial_port_in_the_place_of_the_page_s_is_the_source(port: str) -> None:
    ended = live("--port", port)
    assert ended.code == LinkError.exit_code
    assert_sentences(ended.said)
    assert f"--serial {port}" in ended.said


@pytest.mark.parametrize(
    "words",
    [
        ("--port", "/dev/ttyNONE", "--serial", "/dev/ttyACM0"),
        ("--port", "/dev/ttyNONE", "--udp", "5000"),
        ("--port", "web"),
        ("--port", "65536"),
        ("--port", "-1"),
    ],
)
def test_what_is_neither_port_is_refused(words: tuple[str, ...]) -> None:
    ended = live(*words)
    assert ended.code == UsageError.exit_code
    assert_sentences(ended.said)


def test_a_port_of_the_page_is_still_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch)
    assert live("--port", "0", "--serial").code == LinkError.exit_code


def test_a_port_knows_what_it_is() -> None:
    port = serial_ports.SerialPort("COM7", product="Nano", vendor=1)
    assert (str(port), port.is_board) == ("COM7 (Nano)", True)
