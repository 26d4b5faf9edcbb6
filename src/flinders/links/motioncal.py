r"""Sending of a calibration to a board by the protocol of MotionCal; the echo of the board confirms it.

The board answers a packet with two lines. The line of ten numbers has the offsets of accelerometer, gyroscope and
magnetometer, and the field strength; the line of nine numbers has the matrix. The calibration is confirmed if both
lines have the values that were sent.

>>> import numpy as np
>>> from flinders.links.transports import ScriptedSource
>>> packet = MotionCalPacket(np.array([10.0, -20.0, 30.0]), 50.0, np.diag([1.25, 1.0, 0.8]))
>>> board = ScriptedSource([b"Raw:1,2,3,4,5,6,7,8,9\r\n",
...                   b"Cal1:0.000,0.000,0.000,0.000,0.000,0.000,10.000,-20.000,30.000,50.000\r\n",
...                   b"Cal2:1.250,0.000,0.000,0.000,1.000,0.000,0.000,0.000,0.800\r\n"])
>>> print(send(board, packet))
confirmed by the board's echo, to 3 decimals
>>> board.written == packet.encode()
True

The tolerance is that of MotionCal, 0.0001 + 0.00003 \|x\|, plus half a unit of the last printed digit, for which at
least two decimals are assumed. MotionCal itself allows only the first part. PJRC's and Adafruit's sketches print three
decimals, which often differ by more, so that MotionCal shows no confirmation although the board has accepted the
values.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from flinders.errors import LinkError, NotConfirmed
from flinders.targets.motioncal import BEFORE_OFFSET, MotionCalPacket

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.links.transports import ByteSource

TRIES: Final = 3
ANSWER_S: Final = 3.0  # Longest wait for the echo of a packet; sketches print it about once per second
BOOT_S: Final = 4.0  # Longest wait for a board that restarts when its port is opened, as many boards do
PIECE, PAUSE_S = 16, 0.01
"""Size in bytes of pieces of a packet, and pause in s between them, from the second try on: some buffers are short."""
MAX_LINE_BYTES: Final = 4096
MOTIONCAL_SLACK, MOTIONCAL_SHARE = 0.0001, 0.00003
MIN_PLACES: Final = 2
"""Smallest number of decimals by which an echo is compared, even if it prints fewer."""
UNKNOWN_VALUES: Final = "the board may hold the old values or the new ones"
"""What is known of the board if a packet was sent before the failure."""
REOPEN_S: Final = 0.1  # Time between attempts to open a port again
NUMBER: Final = re.compile(r"[-+]?\d+(?:\.(\d*))?")
NUMBER_COUNTS: Final = {"Cal1": 10, "Cal2": 9}


@dataclass(frozen=True, slots=True)
class Echo:
    """One line of a board's echo: the printed values, and the number of decimals of each."""

    values: tuple[float, ...]
    places: tuple[int, ...]

    def first_difference(self, expected: tuple[float, ...]) -> int | None:
        """Index of the first value that differs from the expected one; None if all values agree.

        >>> echoes = Echo.of("12.346,-0.500", 2), Echo.of("12.346,-0.51", 2)
        >>> [echo.first_difference((12.3456, -0.5)) for echo in echoes]
        [None, 1]
        """
        for place, (number, digits, wanted) in enumerate(zip(self.values, self.places, expected, strict=True)):
            half = 0.5 * 10.0 ** -max(digits, MIN_PLACES)
            if not abs(number - wanted) <= MOTIONCAL_SLACK + MOTIONCAL_SHARE * abs(wanted) + half:
                return place
        return None

    @classmethod
    def of(cls, text: str, count: int) -> Echo | None:
        """Parse the text after the colon of a line; None unless it consists of `count` numbers."""
        matches = [NUMBER.fullmatch(cell.strip()) for cell in text.split(",")]
        if len(matches) != count or None in matches:
            return None
        numbers = [match for match in matches if match is not None]
        return cls(tuple(float(match[0]) for match in numbers), tuple(len(match[1] or "") for match in numbers))


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Confirmation by a board, with the number of compared decimals and of tries."""

    places: int
    tries: int

    def __str__(self) -> str:
        again = f", at try {self.tries}" if self.tries > 1 else ""
        return f"confirmed by the board's echo, to {self.places} decimal{'s' * (self.places != 1)}{again}"


def send(
    source: ByteSource, packet: MotionCalPacket, *, tries: int = TRIES, answer: float = ANSWER_S, boot: float = BOOT_S
) -> Confirmation:
    """Send a packet until the board confirms it.

    Parameters
    ----------
    source : ByteSource
    packet : MotionCalPacket
    tries : int
    answer : float, s
        Longest wait for an echo in each try.
    boot : float, s
        Longest wait for any output of the board before the first packet; a silent board gets the packet then.

    Raises
    ------
    LinkError
        If the board is disconnected before a packet is sent.
    NotConfirmed
        If no echo arrives, or if its values differ; the error states the values that the board may hold.
    """
    listener = _EchoListener(source)
    listener.wait_for_output(boot)
    listener.before = dict(listener.known)
    expected = echo_of(packet)
    content = packet.encode()
    lost: LinkError | None = None
    for attempt in range(1, tries + 1):
        try:
            if lost is not None:
                _reopen(source, boot)
                listener.wait_for_restart(boot)
                lost = None
            for piece in [content] if attempt == 1 else _pieces(content):
                source.write(piece)
            if (echoes := listener.echo(expected, answer)) is not None:
                return Confirmation(min(min(echo.places) for echo in echoes), attempt)
        except LinkError as error:  # a board that restarts is disconnected for a moment
            lost = error
    if lost is not None:
        raise NotConfirmed(f"{lost}. The packet was being sent: {UNKNOWN_VALUES}; plug the board in, and send again")
    raise NotConfirmed(f"sent {tries} times and not confirmed: {listener.complaint(expected)}")


def echo_of(packet: MotionCalPacket) -> dict[str, tuple[float, ...]]:
    """Values to expect in the two lines of an echo: offsets and field strength, and the matrix row by row."""
    offsets = [0.0] * BEFORE_OFFSET + [*packet.offset, packet.strength]
    return {"Cal1": tuple(map(float, offsets)), "Cal2": tuple(map(float, packet.matrix.ravel()))}


def echo_lines(packet: MotionCalPacket) -> list[str]:
    """Lines of the echo for a packet, as PJRC's and Adafruit's sketches print them.

    >>> import numpy as np
    >>> echo_lines(MotionCalPacket(np.array([10.0, -20.0, 30.0]), 50.0, np.eye(3)))[1]
    'Cal2:1.000,0.000,0.000,0.000,1.000,0.000,0.000,0.000,1.000'
    """
    return [f"{name}:{','.join(f'{value:.3f}' for value in values)}" for name, values in echo_of(packet).items()]


@dataclass(slots=True)
class _EchoListener:
    """Reader of a board's output that keeps the last echo of each kind.

    `echoes` are those since the packet was sent, `known` those since the start, and `before` those before the packet
    was sent. `rest` is an incomplete line, `received` is the number of bytes since the port was opened, and `garbled`
    is the last line that begins like an echo but is not one.
    """

    source: ByteSource
    rest: bytes = b""
    received: int = 0
    garbled: str = ""
    echoes: dict[str, Echo] = field(default_factory=dict)
    known: dict[str, Echo] = field(default_factory=dict)
    before: dict[str, Echo] = field(default_factory=dict)

    def wait_for_output(self, seconds: float) -> None:
        """Wait until the board prints something."""
        until = time.monotonic() + seconds
        while not self.received and time.monotonic() < until:
            self._take(until)

    def wait_for_restart(self, seconds: float) -> None:
        """Drop an incomplete line, and wait until the board prints something again."""
        self.rest, self.received = b"", 0
        self.wait_for_output(seconds)

    def echo(self, expected: dict[str, tuple[float, ...]], seconds: float) -> list[Echo] | None:
        """Wait for both lines with the expected values; None if they do not arrive in time."""
        self.echoes.clear()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._take(until)
            if all(
                name in self.echoes and self.echoes[name].first_difference(expected[name]) is None for name in expected
            ):
                return list(self.echoes.values())
        return None

    def complaint(self, expected: dict[str, tuple[float, ...]]) -> str:
        """Sentence about what the board printed instead of the echo, with a remedy."""
        for name, echo in self.known.items():
            if (place := echo.first_difference(expected[name])) is not None:
                number = f"{echo.values[place]:g} in place of {expected[name][place]:.6g}"
                return self._values_complaint(name, f"{number} (number {place + 1} of its {name} line)")
        unknown = "it is unknown whether the board has accepted the packet"
        if self.garbled:
            return f"its echo cannot be read ({self.garbled[:60]!r}): check --baud and the cable; {unknown}"
        if not self.received:
            return f"{self.source.name} sent nothing: check the port, --baud and that the sketch runs; {unknown}"
        missing = " and ".join(f"{name}:" for name in expected if name not in self.known)
        if not missing:
            return "the board printed both lines with the new values, but not one directly after the other: send again"
        return (
            f"the board prints no {missing} line to confirm, and {unknown}: look at its output with "
            "flinders record, and check that its sketch reads packets of MotionCal"
        )

    def _values_complaint(self, name: str, wrong: str) -> str:
        """Sentence with a remedy for an echo with other values; an earlier echo shows whether they are outdated."""
        if name not in self.echoes:
            return (
                f"the board printed {wrong} before, and no such line since: {UNKNOWN_VALUES}; look at its output with "
                "flinders record, and send again"
            )
        if name in self.before and self.before[name].values == self.known[name].values:
            return (
                f"the board still prints {wrong}, as before sending: it did not accept the packet, or it stores other "
                "numbers than it receives; check that its sketch stores a calibration like those of PJRC and Adafruit, "
                "and send again"
            )
        return (
            f"the board now prints {wrong}, not the sent numbers: send again, or check how its sketch stores and "
            "prints them"
        )

    def _take(self, until: float) -> None:
        """Read until a time, and store the echoes in what was read."""
        content = self.source.read(max(min(0.1, until - time.monotonic()), 0.0))
        self.received += len(content)
        *lines, self.rest = re.split(rb"[\r\n]+", self.rest + content)
        self.rest = self.rest[-MAX_LINE_BYTES:]
        for line in lines:
            self._note(line.decode("ascii", "replace").strip())

    def _note(self, line: str) -> None:
        """Store an echo; a line that begins like one but cannot be parsed is stored in `garbled`."""
        name, colon, text = line.partition(":")
        if colon and name in NUMBER_COUNTS:
            echo = Echo.of(text, NUMBER_COUNTS[name])
            if echo is None:
                self.garbled = line
            else:
                self.echoes[name] = self.known[name] = echo


def _reopen(source: ByteSource, seconds: float) -> None:
    """Open a port again, with attempts for `seconds` s."""
    until = time.monotonic() + seconds
    while True:
        try:
            source.reopen()
        except LinkError:
            if time.monotonic() >= until:
                raise
            time.sleep(REOPEN_S)
        else:
            return


def _pieces(content: bytes) -> Iterator[bytes]:
    for start in range(0, len(content), PIECE):
        time.sleep(PAUSE_S)
        yield content[start : start + PIECE]
