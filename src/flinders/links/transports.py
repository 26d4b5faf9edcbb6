r"""Where bytes come from: a serial port, UDP, TCP, standard input, or a list of them for tests.

>>> board = Scripted([b"Raw:0,0,8192,0,0,0,217,4,-586\r\n", Gone(), b"Raw:"])
>>> board.read(0.1)
b'Raw:0,0,8192,0,0,0,217,4,-586\r\n'
>>> board.read(0.1)
Traceback (most recent call last):
flinders.errors.LinkError: the script is gone: check the cable
>>> board.reopen()
>>> board.read(0.1)
b'Raw:'

Every source waits in `read` and nowhere else, and an end that goes away is one error, `LinkError`, whatever the
operating system calls it.
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

from flinders.core.files import reason
from flinders.errors import LinkError, UsageError
from flinders.foreign_errors import needs
from flinders.links.serial_ports import ANY_PORT, board_port, ports_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

CHUNK: Final = 1 << 16  # Bytes taken at a time; no datagram is longer
BAUD: Final = 115200  # What MotionCal and most sketches use
WRITE_S: Final = 2.0  # Seconds that the other end has to take what is written
CONNECT_S: Final = 5.0  # Seconds that a host has to answer
WAITING_BYTES: Final = 8 << 20
"""Room that is asked for what arrives while this program is busy; the system may grant less."""
SO_RCVBUFFORCE: Final = 33
SO_RXQ_OVFL: Final = 40
"""Linux: more room, for the administrator; and a count of what found none, with each datagram (socket(7))."""
AT_ONCE: Final = getattr(socket, "MSG_DONTWAIT", 0)
"""Where there is one, a datagram is taken without asking first whether there is one."""
COUNT: Final = struct.Struct("=I")
MOST_PEERS: Final = 16  # Senders that are answered over UDP; further ones are heard and not answered


class ByteSource(Protocol):
    """One end of a wire; each method but `close` raises `LinkError` where the other end is gone."""

    name: str  #: for messages: ``/dev/ttyACM0``, ``UDP port 50100``
    #: what `read` gives begins and ends with a line, as datagrams do; a port may be opened in the middle of one
    is_framed: bool

    def read(self, timeout: float) -> bytes:
        """Return what has come in, waiting at most `timeout` seconds for it; nothing where nothing came."""

    def write(self, content: bytes) -> None:
        """Send bytes, all of them."""

    def reopen(self) -> None:
        """Open again after a loss."""

    def close(self) -> None:
        """Let go of it; closing twice does no harm."""


class Serial:
    """A serial port, 8N1.

    Parameters
    ----------
    port : str
        ``/dev/ttyACM0``, ``COM3``.
    baud : int
        Bits per second; boards with USB of their own ignore it.

    Raises
    ------
    MissingExtra
        Without serialx.
    LinkError
        Where it cannot be opened; names the ports there are.
    UsageError
        For a baud rate that the port does not have.
    """

    is_framed = False

    def __init__(self, port: str, baud: int = BAUD) -> None:
        self._serialx = needs("serialx", "serial", "a serial port")
        self.name, self.baud = port, baud
        self._port: Any = None
        self.reopen()

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`."""
        buffer = bytearray(CHUNK)
        with self._failures("is gone: check the cable"):
            got = self._opened().readinto(buffer, timeout=timeout)
        return bytes(buffer[:got])

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        with self._failures("does not take what is sent: check the cable, and that the board listens"):
            self._opened().write(content, timeout=WRITE_S)

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""
        self.close()
        try:
            port = self._serialx.serial_for_url(self.name, baudrate=self.baud, exclusive=True)
            port.open()
        except self._serialx.UnsupportedSetting:
            raise UsageError(f"{self.name} cannot do {self.baud} baud: give another --baud, such as {BAUD}") from None
        except (OSError, ValueError, self._serialx.SerialException) as error:
            raise LinkError(f"{self.name} cannot be opened: {_opening(error)}") from None
        self._port = port

    def close(self) -> None:
        """As `ByteSource.close`."""
        if self._port is not None:
            with contextlib.suppress(OSError, ValueError, self._serialx.SerialException):
                self._port.close()
        self._port = None

    def _opened(self) -> Any:  # noqa: ANN401 - serialx's, known only once it is imported
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
    """Datagrams: listens on a port and answers whoever sends, or speaks to an address.

    Parameters
    ----------
    port : int
    host : str
        Address to listen on, or to speak to.
    speaks_first : bool
        Speak to that address; otherwise listen.

    Attributes
    ----------
    lost : int
        Datagrams that this machine has thrown away because nobody took them in time, where it counts them (Linux).

    Raises
    ------
    LinkError
        For a port that is taken, or a host that is not known.
    """

    is_framed = True

    def __init__(self, port: int, host: str = "0.0.0.0", *, speaks_first: bool = False) -> None:
        self.name = f"UDP {host} port {port}" if speaks_first else f"UDP port {port}"
        self._address, self._speaks_first = (host, port), speaks_first
        self._peers: list[tuple[str, int]] = []
        self.lost = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._make_room()
        try:
            if speaks_first:
                self._peers = [(socket.gethostbyname(host), port)]
            else:
                self._socket.bind(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{self.name} cannot be opened: {_opening(error)}") from None

    @property
    def port(self) -> int:
        """The port it is on, also where 0 was asked for."""
        return int(self._socket.getsockname()[1])

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`: one datagram. With a timeout of 0 it only looks, which takes no time."""
        try:
            if (timeout > 0 or not AT_ONCE) and not select.select([self._socket], [], [], timeout)[0]:
                return b""
            content, peer = self._received()
        except (BlockingIOError, ConnectionError):  # nothing is there, or what was sent reached nobody, not yet
            return b""
        except (OSError, ValueError):
            raise LinkError(f"{self.name} is gone: check the network") from None
        if peer not in self._peers and not self._speaks_first and len(self._peers) < MOST_PEERS:
            self._peers.append(peer)
        return content

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`: to all who were heard; to nobody where nobody was."""
        for peer in self._peers:
            try:
                self._socket.sendto(content, peer)
            except ConnectionError:
                pass
            except OSError as error:
                raise LinkError(f"{self.name} does not take what is sent: {reason(error)}") from None

    def _make_room(self) -> None:
        """Have the system keep more of what arrives than it usually does, and count what it cannot keep."""
        self._is_counting = sys.platform == "linux"
        wishes = {socket.SO_RCVBUF: WAITING_BYTES}
        if self._is_counting:
            wishes |= {SO_RXQ_OVFL: 1, SO_RCVBUFFORCE: WAITING_BYTES}
        for option, value in wishes.items():
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)

    def _received(self) -> tuple[bytes, tuple[str, int]]:
        """Take one datagram that is there, and what is counted with it."""
        if not self._is_counting:
            content, peer = self._socket.recvfrom(CHUNK, AT_ONCE)
            return content, peer
        content, ancillary, _, peer = self._socket.recvmsg(CHUNK, socket.CMSG_SPACE(COUNT.size), AT_ONCE)
        for level, kind, data in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, SO_RXQ_OVFL) and len(data) >= COUNT.size:
                self.lost = int(COUNT.unpack_from(data)[0])
        return content, peer

    def reopen(self) -> None:
        """Nothing to do: there is no connection to lose."""

    def close(self) -> None:
        """As `ByteSource.close`."""
        self._socket.close()


class Tcp:
    """A connection to a host; `LinkError` where that is not known or does not answer."""

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
            content = self._socket.recv(CHUNK)
        except (OSError, ValueError):
            content = b""
        if not content:
            self.close()
            raise LinkError(f"{self.name} has closed the connection: see that the program there still runs")
        return content

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        try:
            self._socket.sendall(content)
        except (OSError, ValueError) as error:
            self.close()
            raise LinkError(f"{self.name} does not take what is sent: {reason(error)}") from None

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""
        self.close()
        try:
            self._socket = socket.create_connection(self._address, timeout=CONNECT_S)
        except OSError as error:
            raise LinkError(f"{self.name} cannot be reached: {_opening(error)}") from None
        self._socket.settimeout(WRITE_S)

    def close(self) -> None:
        """As `ByteSource.close`."""
        self._socket.close()


class StandardInput:
    """What another program writes into a pipe, or what a file holds.

    Attributes
    ----------
    is_done : bool
        The other program has ended, or the end of the file is reached: nothing more will come.
    """

    name = "standard input"
    is_framed = False

    def __init__(self) -> None:
        if sys.__stdin__ is None:
            raise LinkError(f"{self.name} is closed: pipe readings into it")
        self._file = sys.__stdin__.fileno()
        self.is_done = False

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`; on Windows it waits for as long as it takes."""
        if self.is_done:
            time.sleep(timeout)
            return b""
        try:
            if sys.platform != "win32" and not select.select([self._file], [], [], timeout)[0]:
                return b""
            content = os.read(self._file, CHUNK)
        except OSError as error:
            self.is_done = True
            raise LinkError(f"{self.name} cannot be read: {reason(error)}") from None
        self.is_done = not content
        return content

    def write(self, content: bytes) -> None:
        """Nothing: nobody listens at the other end."""

    def reopen(self) -> None:
        """Nothing to do: what has ended has ended."""

    def close(self) -> None:
        """Nothing to do: it belongs to the program."""


@dataclass(frozen=True, slots=True)
class Gone:
    """A step of `Scripted`: the other end goes away."""


@dataclass(frozen=True, slots=True)
class Quiet:
    """A step of `Scripted`: for so many seconds nothing comes."""

    seconds: float


class Scripted:
    """Bytes from a list, for tests and for playing a recording back; what is written to it is kept.

    Parameters
    ----------
    steps : iterable of bytes, `Gone` or `Quiet`
        One for each `read`.
    is_framed : bool
        As in `ByteSource`.
    """

    name = "the script"

    def __init__(self, steps: Iterable[bytes | Gone | Quiet], *, is_framed: bool = False) -> None:
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
            case Gone():
                raise LinkError(f"{self.name} is gone: check the cable")
            case Quiet(seconds):
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


def opened_lines(
    *, port: str | None = None, baud: int = BAUD, udp: int | None = None, tcp: str | None = None
) -> Serial | Udp | Tcp:
    """Open what sends lines: one of a serial port, a port for datagrams, and ``HOST:PORT``.

    `ANY_PORT` is the port of the one board that is plugged in, as `board_port` finds it.
    """
    if udp is not None:
        return Udp(udp)
    if tcp is not None:
        return Tcp(*host_and_port(tcp, "--tcp"))
    return Serial(board_port() if port == ANY_PORT else str(port), baud)


def opened_link(address: str, baud: int = BAUD, *, what: str) -> Serial | Udp | Tcp:
    """Open a link: ``udp:HOST:PORT``, ``udpout:HOST:PORT``, ``tcp:HOST:PORT`` or a serial port.

    `what` names the option in a refusal.
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
    """Take ``HOST:PORT`` apart; without a host it is this machine. `what` names the option in a refusal.

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
"""What to do where something cannot be opened."""


def _opening(error: Exception) -> str:
    """Say why something cannot be opened, and what to do."""
    if isinstance(error, socket.gaierror):
        return "no such host: check the name, or give its number"
    if isinstance(error, TimeoutError):
        return f"no answer within {CONNECT_S:g} s: check the address and the network"
    advice = ADVICE.get(error.errno or 0) if isinstance(error, OSError) else None
    if advice is None:
        advice = f"{reason(error) if isinstance(error, OSError | ValueError) else error}; {{ports}}"
    return advice.replace("{ports}", ports_in_words()) if "{ports}" in advice else advice
