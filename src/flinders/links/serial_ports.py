"""The serial ports of this machine, and which of them a board is plugged into.

>>> nano = SerialPort("/dev/ttyACM0", product="Arduino Nano 33 BLE", vendor=0x2341)
>>> mainboard, modem = SerialPort("/dev/ttyS0"), SerialPort("/dev/ttyUSB2", product="LTE Modem", vendor=0x1234)
>>> [port.is_board for port in (nano, mainboard, modem)]
[True, False, False]
>>> in_words([mainboard, nano])
'there are /dev/ttyACM0 (Arduino Nano 33 BLE), /dev/ttyS0'

Only what is on USB, and no modem, is taken without being named. A port of the mainboard, of Bluetooth or of a debug
console opens as well, and nothing ever comes from it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.errors import LinkError, MissingExtra, UsageError
from flinders.foreign_errors import needs

if TYPE_CHECKING:
    from collections.abc import Sequence

ANY_PORT: Final = "?"
"""Stands for the port of the one board that is plugged in."""
SERIAL_PORT: Final = re.compile(r"/dev/|COM\d", re.IGNORECASE)
"""How the name of a serial port begins."""
MODEM: Final = re.compile(r"\b(?:modem|lte|gsm|wwan|umts|hspa|mobile broadband)\b", re.IGNORECASE)
"""What modems call themselves."""
MODEM_VENDORS: Final = frozenset(
    {0x05C6, 0x0AF0, 0x0BDB, 0x1199, 0x12D1, 0x19D2, 0x1BC7, 0x1E0E, 0x1E2D, 0x2C7C, 0x2CB7}
)
"""USB vendors of cellular modems, as Linux' drivers of them list (drivers/usb/serial, option.c and sierra.c): Qualcomm,
Option, Ericsson, Sierra, Huawei, ZTE, Telit, SIMCom, Thales, Quectel, Fibocom."""


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial port."""

    name: str  # as people know it: /dev/ttyACM0, COM3
    path: str = ""  # that stays the same when the board is plugged in again, where the system has one
    product: str = ""  # what a device on USB says of itself
    vendor: int | None = None  # number of the maker of a device on USB; None elsewhere

    @property
    def is_board(self) -> bool:
        """Whether a board may be at its end: it is on USB, and no modem."""
        is_modem = self.vendor in MODEM_VENDORS or MODEM.search(self.product) is not None
        return self.vendor is not None and not is_modem

    def __str__(self) -> str:
        return f"{self.name} ({self.product})" if self.product else self.name


def ports() -> list[SerialPort]:
    """The serial ports of this machine; none where they cannot be listed.

    Raises `MissingExtra` without serialx.
    """
    serialx = needs("serialx", "serial", "a serial port")
    try:
        listed = serialx.list_serial_ports()
    except (OSError, ValueError, serialx.SerialException):
        return []
    return [SerialPort(str(port.resolved_device), str(port.device), port.product or "", port.vid) for port in listed]


def in_words(found: Sequence[SerialPort]) -> str:
    """Say which ports there are, those of boards first, or what to check where there are none."""
    if not found:
        return "this machine has no serial port now: plug the board in, with a cable that carries data"
    names = [str(port) for port in sorted(found, key=lambda port: (not port.is_board, port.name))]
    return f"there {'are' if len(names) > 1 else 'is'} {', '.join(names)}"


def ports_in_words() -> str:
    """Say which serial ports this machine has, or what to install to see them."""
    try:
        return in_words(ports())
    except MissingExtra as missing:
        return str(missing)


def plugged_in() -> str | None:
    """The port of the one board that is plugged in; None where there is none, or serialx is missing.

    Raises `UsageError` where there are several.
    """
    try:
        return _only([port for port in ports() if port.is_board])
    except MissingExtra:
        return None


def board_port() -> str:
    """The port of the one board that is plugged in.

    Raises
    ------
    LinkError
        Where no board is: says which ports there are, and what to check.
    UsageError
        Where there are several.
    MissingExtra
        Without serialx.
    """
    found = ports()
    if port := _only([port for port in found if port.is_board]):
        return port
    check = (
        "plug one in with a cable that carries data, not only power, install the driver of its USB chip (such as CH340 "
        "or CP2102), close the serial monitor, and on Linux join the group dialout (sudo usermod -aG dialout $USER, "
        "then log in again)"
    )
    if not found:
        raise LinkError(f"no board was found, and this machine has no serial port now: {check}")
    raise LinkError(
        f"no board was found on USB: {check}. Other ports are used where they are named: {_listed(found)}",
        hint={"port": found[0].name},
    )


def _only(boards: Sequence[SerialPort]) -> str | None:
    """The one board of a list; None of an empty one."""
    if len(boards) > 1:
        listed = _listed(boards)
        raise UsageError(f"several boards are plugged in, {listed}: name one", hint={"port": boards[0].name})
    return boards[0].path or boards[0].name if boards else None


def _listed(found: Sequence[SerialPort]) -> str:
    return ", ".join(map(str, found))
