"""Serial ports of this machine, and recognition of the port of a board.

>>> nano = SerialPort("/dev/ttyACM0", product="Arduino Nano 33 BLE", vendor=0x2341)
>>> mainboard, modem = SerialPort("/dev/ttyS0"), SerialPort("/dev/ttyUSB2", product="LTE Modem", vendor=0x1234)
>>> [port.is_board for port in (nano, mainboard, modem)]
[True, False, False]
>>> port_words([mainboard, nano])
'there are /dev/ttyACM0 (Arduino Nano 33 BLE), /dev/ttyS0'

Without a name, only a device on USB is used, and not a modem. Ports of the mainboard, of Bluetooth or of a debug
console could be opened as well, but never send anything.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.errors import LinkError, MissingExtra, UsageError
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from collections.abc import Sequence

ANY_PORT: Final = "?"
"""Name that stands for the port of the only connected board."""
SERIAL_PORT: Final = re.compile(r"/dev/|COM\d", re.IGNORECASE)
"""Start of the name of a serial port."""
MODEM_WORDS: Final = re.compile(r"\b(?:modem|lte|gsm|wwan|umts|hspa|mobile broadband)\b", re.IGNORECASE)
"""Words in the product names of modems."""
MODEM_VENDORS: Final = frozenset(
    {0x05C6, 0x0AF0, 0x0BDB, 0x1199, 0x12D1, 0x19D2, 0x1BC7, 0x1E0E, 0x1E2D, 0x2C7C, 0x2CB7}
)
"""USB vendor numbers of cellular modems, from the Linux drivers drivers/usb/serial/option.c and sierra.c.

They are Qualcomm, Option, Ericsson, Sierra, Huawei, ZTE, Telit, SIMCom, Thales, Quectel and Fibocom.
"""


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial port."""

    name: str  # usual name: /dev/ttyACM0, COM3
    path: str = ""  # path that stays the same when the board is plugged in again; empty if the system has none
    product: str = ""  # product name of a device on USB
    vendor: int | None = None  # vendor number of a device on USB; None for others

    @property
    def is_board(self) -> bool:
        """Whether it may be the port of a board: a device on USB that is not a modem."""
        is_modem = self.vendor in MODEM_VENDORS or MODEM_WORDS.search(self.product) is not None
        return self.vendor is not None and not is_modem

    def __str__(self) -> str:
        return f"{self.name} ({self.product})" if self.product else self.name


def ports() -> list[SerialPort]:
    """Serial ports of this machine; empty if the system cannot list them.

    Raises `MissingExtra` if serialx is not installed.
    """
    serialx = import_optional("serialx", "serial", "a serial port")
    try:
        listed = serialx.list_serial_ports()
    except (OSError, ValueError, serialx.SerialException):
        return []
    return [SerialPort(str(port.resolved_device), str(port.device), port.product or "", port.vid) for port in listed]


def port_words(found: Sequence[SerialPort]) -> str:
    """Sentence about ports, with those of boards first; without ports, about what to check."""
    if not found:
        return "this machine has no serial port now: plug the board in, with a cable that carries data"
    names = [str(port) for port in sorted(found, key=lambda port: (not port.is_board, port.name))]
    return f"there {'are' if len(names) > 1 else 'is'} {', '.join(names)}"


def describe_ports() -> str:
    """Sentence about the serial ports of this machine, or about what to install to list them."""
    try:
        return port_words(ports())
    except MissingExtra as missing:
        return str(missing)


def find_board_port() -> str | None:
    """Port of the only connected board; None if there is no board, or if serialx is not installed.

    Raises `UsageError` if there are several boards.
    """
    try:
        return _only_board([port for port in ports() if port.is_board])
    except MissingExtra:
        return None


def board_port() -> str:
    """Port of the only connected board.

    Raises
    ------
    LinkError
        If there is no board; the error lists the ports, and what to check.
    UsageError
        If there are several boards.
    MissingExtra
        If serialx is not installed.
    """
    found = ports()
    if port := _only_board([port for port in found if port.is_board]):
        return port
    check = (
        "plug one in with a cable that carries data, not only power, install the driver of its USB chip (such as CH340 "
        "or CP2102), close the serial monitor, and on Linux join the group dialout (sudo usermod -aG dialout $USER, "
        "then log in again)"
    )
    if not found:
        raise LinkError(f"no board was found, and this machine has no serial port now: {check}")
    raise LinkError(
        f"no board was found on USB: {check}. To use another port, name it: {_port_list(found)}",
        hint={"port": found[0].name},
    )


def _only_board(boards: Sequence[SerialPort]) -> str | None:
    """The only board of a list; None for an empty list, `UsageError` for several."""
    if len(boards) > 1:
        listed = _port_list(boards)
        raise UsageError(f"several boards are plugged in, {listed}: name one", hint={"port": boards[0].name})
    return boards[0].path or boards[0].name if boards else None


def _port_list(found: Sequence[SerialPort]) -> str:
    return ", ".join(map(str, found))
