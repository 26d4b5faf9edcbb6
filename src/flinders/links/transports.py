r"""Sources of bytes: a serial port, UDP, TCP, standard input, or a list for tests.

>>> board = ScriptedSource([b"Raw:0,0,8192,0,0,0,217,4,-586\r\n", Disconnection(), b"Raw:"])
>>> board.read(0.1)
b'Raw:0,0,8192,0,0,0,217,4,-586\r\n'
>>> board.read(0.1)
Traceback (most recent call last):
flinders.errors.LinkError: the script is gone: check the cable
>>> board.reopen()
>>> board.read(0.1)
b'Raw:'

A source waits only in `read`. A disconnection is always a `LinkError`, whatever the error of the operating system is.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from flinders.core.files import reason_and_remedy
from flinders.errors import LinkError, UsageError
from flinders.foreign_errors import import_optional
from flinders.links.serial_ports import ANY_PORT, board_port, describe_ports

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

CHUNK_BYTES: Final = 1 << 16  # Largest number of bytes that are read together; no datagram is longer
BAUD: Final = 115200  # Default of MotionCal and of most sketches
WRITE_S: Final = 2.0  # Longest wait for a write
CONNECT_S: Final = 5.0  # Longest wait for an answer of a host
RECEIVE_BUFFER_BYTES: Final = 8 << 20
"""Size in bytes of the receive buffer to request, for times when this program is busy; the system may grant less."""
SO_RCVBUFFORCE: Final = 33
SO_RXQ_OVFL: Final = 40
"""Options of Linux: a larger buffer for the administrator; the count of dropped datagrams with each one (socket(7))."""
NO_WAIT_FLAG: Final = getattr(socket, "MSG_DONTWAIT", 0)
"""Flag that receives a datagram without waiting; 0 on systems that do not have it."""
COUNT_FORMAT: Final = struct.Struct("=I")
MAX_PEERS: Final = 16  # Largest number of senders that get answers over UDP; further senders are only read


class ByteSource(Protocol):
    """One end of a wire; each method except `close` raises `LinkError` if the other end is disconnected."""

    name: str  #: name for messages: ``/dev/ttyACM0``, ``UDP port 50100``
    #: whether results of `read` begin and end with a line, as datagrams do; a port may be opened in the middle of one
    is_framed: bool

    def read(self, timeout: float) -> bytes:
        """Return the bytes received; wait no longer than `timeout` s, and return nothing if none arrive."""

    def write(self, content: bytes) -> None:
        """Send all bytes."""

    def reopen(self) -> None:
        """Open the source again after a disconnection."""

    def close(self) -> None:
        """Close the source; a second call does nothing."""


class Serial:
    """A serial port, 8N1.

    Parameters
    ----------
    port : str
        ``/dev/ttyACM0``, ``COM3``.
    baud : int
        Bits per second; a board with native USB ignores it.

    Raises
    ------
    MissingExtra
        If serialx is not installed.
    LinkError
        If the port cannot be opened; the error lists the existing ports.
    UsageError
        For a baud rate that the port does not support.
    """

    is_framed = False

    def __init__(self, port: str, baud: int = BAUD) -> None:
        self._serialx = import_optional("serialx", "serial", "a serial port")
        self.name, self.baud = port, baud
        self._port: Any = None
        self.reopen()

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`."""
        buffer = bytearray(CHUNK_BYTES)
        with self._failures("is gone: check the cable"):
            got = self._open_port().readinto(buffer, timeout=timeout)
        return bytes(buffer[:got])

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        with self._failures("does not accept sent bytes: check the cable, and that the board reads its port"):
            self._open_port().write(content, timeout=WRITE_S)

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""
        self.close()
        try:
            port = self._serialx.serial_for_url(self.name, baudrate=self.baud, exclusive=True)
            port.open()
        except self._serialx.UnsupportedSetting:
            refused = f"{self.name} does not support {self.baud} baud: give another --baud, such as {BAUD}"
            raise UsageError(refused) from None
        except (OSError, ValueError, self._serialx.SerialException) as error:
            raise LinkError(f"{self.name} cannot be opened: {_opening_error(error)}") from None
        self._port = port

    def close(self) -> None:
        """As `ByteSource.close`."""
        if self._port is not None:
            with contextlib.suppress(OSError, ValueError, self._serialx.SerialException):
                self._port.close()
        self._port = None

    def _open_port(self) -> Any:  # noqa: ANN401 - serialx's, known only once it is imported
        if self._port is None:
            raise LinkError(f"{self.name} is closed")
        return self._port

    @contextlib.contextmanager
    def _failures(self, what: str) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError, self._serialx.SerialException):
            self.close()
            raise LinkError(f"{self.name} {what}") from None


class Udp:
    """UDP datagrams: listens on a port and answers all senders, or sends to an address first and then listens.

    Parameters
    ----------
    port : int
    host : str
        Address to listen on, or to send to.
    speaks_first : bool
        Whether to send to the address first, or only to listen.

    Attributes
    ----------
    lost : int
        Number of datagrams that this machine has dropped, since they were not read in time, if it counts them (Linux).

    Raises
    ------
    LinkError
        For a port that is in use, or an unknown host.
    """

    is_framed = True

    def __init__(self, port: int, host: str = "0.0.0.0", *, speaks_first: bool = False) -> None:
        self.name = f"UDP {host} port {port}" if speaks_first else f"UDP port {port}"
        self._address, self._speaks_first = (host, port), speaks_first
        self._peers: list[tuple[str, int]] = []
        self.lost = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._enlarge_buffer()
        try:
            if speaks_first:
                self._peers = [(socket.gethostbyname(host), port)]
            else:
                self._socket.bind(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{self.name} cannot be opened: {_opening_error(error)}") from None

    @property
    def port(self) -> int:
        """Number of the port in use, even if 0 was requested."""
        return int(self._socket.getsockname()[1])

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`, for one datagram; with a timeout of 0 it does not wait."""
        try:
            if (timeout > 0 or not NO_WAIT_FLAG) and not select.select([self._socket], [], [], timeout)[0]:
                return b""
            content, peer = self._receive()
        # nothing has arrived, or a sent datagram has found no listener yet
        except (BlockingIOError, ConnectionError):
            return b""
        except (OSError, ValueError):
            raise LinkError(f"{self.name} is gone: check the network") from None
        if peer not in self._peers and not self._speaks_first and len(self._peers) < MAX_PEERS:
            self._peers.append(peer)
        return content

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`, to all senders so far; there may be none."""
        for peer in self._peers:
            try:
                self._socket.sendto(content, peer)
            except ConnectionError:
                pass
            except OSError as error:
                raise LinkError(f"{self.name}: sending failed: {reason_and_remedy(error)}") from None

    def _enlarge_buffer(self) -> None:
        """Request a larger receive buffer, and a count of dropped datagrams."""
        self._is_counting = sys.platform == "linux"
        wishes = {socket.SO_RCVBUF: RECEIVE_BUFFER_BYTES}
        if self._is_counting:
            wishes |= {SO_RXQ_OVFL: 1, SO_RCVBUFFORCE: RECEIVE_BUFFER_BYTES}
        for option, value in wishes.items():
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)

    def _receive(self) -> tuple[bytes, tuple[str, int]]:
        """Receive one datagram that waits, and update the count of dropped ones."""
        if not self._is_counting:
            content, peer = self._socket.recvfrom(CHUNK_BYTES, NO_WAIT_FLAG)
            return content, peer
        room = socket.CMSG_SPACE(COUNT_FORMAT.size)
        content, ancillary, _, peer = self._socket.recvmsg(CHUNK_BYTES, room, NO_WAIT_FLAG)
        for level, kind, data in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, SO_RXQ_OVFL) and len(data) >= COUNT_FORMAT.size:
                self.lost = int(COUNT_FORMAT.unpack_from(data)[0])
        return content, peer

    def reopen(self) -> None:
        """Do nothing, since UDP has no connection."""

    def close(self) -> None:
        """As `ByteSource.close`."""
        self._socket.close()


class Tcp:
    """A TCP connection to a host; `LinkError` if the host is unknown or does not answer."""

    is_framed = False

    def __init__(self, host: str, port: int) -> None:
        self.name = f"TCP {host}:{port}"
        self._address = (host, port)
        self._socket = socket.socket()
        self.reopen()

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`."""
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return b""
            content = self._socket.recv(CHUNK_BYTES)
        except (OSError, ValueError):
            content = b""
        if not content:
            self.close()
            raise LinkError(f"{self.name} has closed the connection: check that the program there still runs")
        return content

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        try:
            self._socket.sendall(content)
        except (OSError, ValueError) as error:
            self.close()
            raise LinkError(f"{self.name}: sending failed: {reason_and_remedy(error)}") from None

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""
        self.close()
        try:
            self._socket = socket.create_connection(self._address, timeout=CONNECT_S)
        except OSError as error:
            raise LinkError(f"{self.name} cannot be reached: {_opening_error(error)}") from None
        self._socket.settimeout(WRITE_S)

    def close(self) -> None:
        """As `ByteSource.close`."""
        self._socket.close()


class StandardInput:
    """Standard input, from a pipe or a file.

    Attributes
    ----------
    is_done : bool
        Whether the end of the pipe or file is reached.
    """

    name = "standard input"
    is_framed = False

    def __init__(self) -> None:
        if sys.__stdin__ is None:
            raise LinkError(f"{self.name} is closed: pipe readings into it")
        self._file = sys.__stdin__.fileno()
        self.is_done = False

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`; on Windows it waits without a limit."""
        if self.is_done:
            time.sleep(timeout)
            return b""
        try:
            if sys.platform != "win32" and not select.select([self._file], [], [], timeout)[0]:
                return b""
            content = os.read(self._file, CHUNK_BYTES)
        except OSError as error:
            self.is_done = True
            raise LinkError(f"{self.name} cannot be read: {reason_and_remedy(error)}") from None
        self.is_done = not content
        return content

    def write(self, content: bytes) -> None:
        """Do nothing, since nobody reads."""

    def reopen(self) -> None:
        """Do nothing, since a pipe that has ended cannot be opened again."""

    def close(self) -> None:
        """Do nothing, since standard input belongs to the program."""


@dataclass(frozen=True, slots=True)
class Disconnection:
    """A step of `ScriptedSource` in which the other end is disconnected."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A step of `ScriptedSource` in which nothing arrives for a time."""

    seconds: float


class ScriptedSource:
    """Bytes from a list, for tests and for playback. Bytes that are written to it are stored.

    Parameters
    ----------
    steps : iterable of bytes, `Disconnection` or `Silence`
        One step for each call of `read`.
    is_framed : bool
        As in `ByteSource`.
    """

    name = "the script"

    def __init__(self, steps: Iterable[bytes | Disconnection | Silence], *, is_framed: bool = False) -> None:
        self._steps = iter(steps)
        self.is_framed = is_framed
        self.is_done = False
        self.written = b""

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`."""
        step = next(self._steps, None)
        match step:
            case None:
                self.is_done = True
                time.sleep(min(timeout, 0.01))
                return b""
            case Disconnection():
                raise LinkError(f"{self.name} is gone: check the cable")
            case Silence(seconds):
                time.sleep(min(timeout, seconds))
                return b""
        return step

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        self.written += content

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""

    def close(self) -> None:
        """As `ByteSource.close`."""


def open_lines(
    *, port: str | None = None, baud: int = BAUD, udp: int | None = None, tcp: str | None = None
) -> Serial | Udp | Tcp:
    """Open a source of lines: a serial port, a UDP port, or ``HOST:PORT`` of TCP.

    The port `ANY_PORT` is that of the only connected board, by `board_port`.
    """
    if udp is not None:
        return Udp(udp)
    if tcp is not None:
        return Tcp(*host_and_port(tcp, "--tcp"))
    return Serial(board_port() if port == ANY_PORT else str(port), baud)


def open_link(address: str, baud: int = BAUD, *, what: str) -> Serial | Udp | Tcp:
    """Open a link by its address: ``udp:HOST:PORT``, ``udpout:HOST:PORT``, ``tcp:HOST:PORT`` or a serial port.

    `what` is the name of the option, for errors.
    """
    kind, colon, rest = address.partition(":")
    match kind.casefold() if colon else "":
        case "udp" | "udpin":
            host, port = host_and_port(rest if ":" in rest else f"0.0.0.0:{rest}", what)
            return Udp(port, host)
        case "udpout":
            host, port = host_and_port(rest, what)
            return Udp(port, host, speaks_first=True)
        case "tcp":
            return Tcp(*host_and_port(rest, what))
        case "serial":
            return Serial(rest, baud)
    if colon and not address.startswith(("/", ".")):
        raise UsageError(
            f"{what} {address!r}: need udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or a serial port such as "
            "/dev/ttyACM0 or COM3"
        )
    return Serial(address, baud)


def host_and_port(text: str, what: str) -> tuple[str, int]:
    """Split ``HOST:PORT``; without a host it is this machine. `what` is the name of the option, for errors.

    >>> host_and_port("logger.local:5760", "--tcp"), host_and_port(":5760", "--tcp")
    (('logger.local', 5760), ('127.0.0.1', 5760))
    """
    host, colon, number = text.strip().rpartition(":")
    if not colon or not number.isascii() or not number.isdigit() or not 0 < int(number) < 65536:
        raise UsageError(f"{what} {text!r}: need HOST:PORT with a port from 1 to 65535, such as 127.0.0.1:5760")
    return host.strip("[]") or "127.0.0.1", int(number)


ADVICE: Final = {
    **dict.fromkeys((errno.ENOENT, errno.ENODEV, errno.ENXIO), "it is not there; {ports}"),
    **dict.fromkeys((errno.ENOTTY, errno.EINVAL, errno.EISDIR), "it is no serial port; {ports}"),
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM),
        "no permission: on Linux `sudo usermod -aG dialout $USER`, then log in again; a network port below 1024 is for "
        "the administrator",
    ),
    **dict.fromkeys(
        (errno.EBUSY, errno.EAGAIN),
        "another program uses it: close the serial monitor, MotionCal or ground station",
    ),
    errno.EADDRINUSE: "another program listens there: close it, or take another port",
    errno.EADDRNOTAVAIL: "no network card of this machine has that address; 0.0.0.0 listens on all",
    errno.ECONNREFUSED: "nobody listens there: start the program that sends, and check the port",
}
"""Advice for errors when a source is opened."""


def _opening_error(error: Exception) -> str:
    """Why a source cannot be opened, with advice."""
    if isinstance(error, socket.gaierror):
        return "no such host: check the name, or give its number"
    if isinstance(error, TimeoutError):
        return f"no answer within {CONNECT_S:g} s: check the address and the network"
    advice = ADVICE.get(error.errno or 0) if isinstance(error, OSError) else None
    if advice is None:
        advice = f"{reason_and_remedy(error) if isinstance(error, OSError | ValueError) else error}; {{ports}}"
    return advice.replace("{ports}", describe_ports()) if "{ports}" in advice else advice
