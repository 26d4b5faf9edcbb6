r"""Sends a calibration to a board as MotionCal does, and reads its echo.

The board answers a packet with two lines, ten numbers and nine: offsets of accelerometer, gyroscope and magnetometer
with the field, and the matrix. Only when both hold what was sent is it confirmed.

>>> import numpy as np
>>> from flinders.links.transports import Scripted
>>> packet = MotionCalPacket(np.array([10.0, -20.0, 30.0]), 50.0, np.diag([1.25, 1.0, 0.8]))
>>> board = Scripted([b"Raw:1,2,3,4,5,6,7,8,9\r\n",
...                   b"Cal1:0.000,0.000,0.000,0.000,0.000,0.000,10.000,-20.000,30.000,50.000\r\n",
...                   b"Cal2:1.250,0.000,0.000,0.000,1.000,0.000,0.000,0.000,0.800\r\n"])
>>> print(send(board, packet))
confirmed by the board's echo, to 3 decimals
>>> board.written == packet.encode()
True

Tolerance: MotionCal's own, 0.0001 + 0.00003 \|x\|, and half a unit of the last digit that the board prints, of at least
two. MotionCal itself allows the first alone: PJRC's and Adafruit's sketches echo three decimals, which is often off by
more, so that its tick does not appear although the board has taken the values.
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
ANSWER_S: Final = 3.0  # Seconds that the echo of a packet is waited for; sketches print it once in a second or so
BOOT_S: Final = 4.0  # Seconds that a board is waited for that starts anew when its port is opened, as many do
PIECE, PAUSE_S = 16, 0.01
"""From the second time on bytes are sent in pieces, for boards whose buffer is shorter than a packet."""
LONGEST: Final = 4096
MOTIONCAL_SLACK, MOTIONCAL_SHARE = 0.0001, 0.00003
FEWEST_PLACES: Final = 2
"""Decimals that an echo is taken to have: what it prints with fewer has to agree with that many."""
EITHER: Final = "the board may hold the old values or the new ones"  # What is known where the packet was on its way
REOPEN_S: Final = 0.1  # Seconds between tries to open a port again
NUMBER: Final = re.compile(r"[-+]?\d+(?:\.(\d*))?")
NUMBERS: Final = {"Cal1": 10, "Cal2": 9}


@dataclass(frozen=True, slots=True)
class Echo:
    """One line in which a board says what it holds: values as printed, and the decimals of each."""

    values: tuple[float, ...]
    places: tuple[int, ...]

    def differs(self, expected: tuple[float, ...]) -> int | None:
        """The place of the first number that is not the expected one; None where all agree.

        >>> Echo.of("12.346,-0.500", 2).differs((12.3456, -0.5)), Echo.of("12.346,-0.51", 2).differs((12.3456, -0.5))
        (None, 1)
        """
        for place, (number, digits, wanted) in enumerate(zip(self.values, self.places, expected, strict=True)):
            half = 0.5 * 10.0 ** -max(digits, FEWEST_PLACES)
            if not abs(number - wanted) <= MOTIONCAL_SLACK + MOTIONCAL_SHARE * abs(wanted) + half:
                return place
        return None

    @classmethod
    def of(cls, text: str, count: int) -> Echo | None:
        """Read what stands behind the colon; None where that is not so many numbers."""
        matches = [NUMBER.fullmatch(cell.strip()) for cell in text.split(",")]
        if len(matches) != count or None in matches:
            return None
        numbers = [match for match in matches if match is not None]
        return cls(tuple(float(match[0]) for match in numbers), tuple(len(match[1] or "") for match in numbers))


@dataclass(frozen=True, slots=True)
class Confirmed:
    """A board has said that it holds what was sent, to so many decimals, after so many tries."""

    places: int
    tries: int

    def __str__(self) -> str:
        again = f", at try {self.tries}" if self.tries > 1 else ""
        return f"confirmed by the board's echo, to {self.places} decimal{'s' * (self.places != 1)}{again}"


def send(
    source: ByteSource, packet: MotionCalPacket, *, tries: int = TRIES, answer: float = ANSWER_S, boot: float = BOOT_S
) -> Confirmed:
    """Send a packet until the board confirms it.

    Parameters
    ----------
    source : ByteSource
    packet : MotionCalPacket
    tries : int
    answer : float, s
        How long an echo is waited for, each time.
    boot : float, s
        How long the board has to say something before the first packet; it is sent to a silent one too.

    Raises
    ------
    LinkError
        Where the board goes away before anything was sent.
    NotConfirmed
        Where no echo comes, or one of other values; says what the board may hold.
    """
    listener = _EchoListener(source)
    listener.anything(boot)
    listener.before = dict(listener.known)
    expected = echo_of(packet)
    content = packet.encode()
    lost: LinkError | None = None
    for attempt in range(1, tries + 1):
        try:
            if lost is not None:
                _reopen(source, boot)
                listener.anew(boot)
                lost = None
            for piece in [content] if attempt == 1 else _pieces(content):
                source.write(piece)
            if (echoes := listener.echo(expected, answer)) is not None:
                return Confirmed(min(min(echo.places) for echo in echoes), attempt)
        except LinkError as error:  # a board that starts anew goes away for a moment
            lost = error
    if lost is not None:
        raise NotConfirmed(f"{lost}; the packet was on its way, so that {EITHER}: plug it in and send again")
    raise NotConfirmed(f"sent {tries} times and not confirmed: {listener.complaint(expected)}")


def echo_of(packet: MotionCalPacket) -> dict[str, tuple[float, ...]]:
    """What the two lines of an echo have to hold: offsets and field, and the matrix row by row."""
    offsets = [0.0] * BEFORE_OFFSET + [*packet.offset, packet.strength]
    return {"Cal1": tuple(map(float, offsets)), "Cal2": tuple(map(float, packet.matrix.ravel()))}


def echo_lines(packet: MotionCalPacket) -> list[str]:
    """Write the echo of a packet as PJRC's and Adafruit's sketches do.

    >>> import numpy as np
    >>> echo_lines(MotionCalPacket(np.array([10.0, -20.0, 30.0]), 50.0, np.eye(3)))[1]
    'Cal2:1.000,0.000,0.000,0.000,1.000,0.000,0.000,0.000,1.000'
    """
    return [f"{name}:{','.join(f'{value:.3f}' for value in values)}" for name, values in echo_of(packet).items()]


@dataclass(slots=True)
class _EchoListener:
    """What the board has said: the last echo of each kind since the packet was sent, at all, and from before that.

    `rest` is a line without its end, `received` counts bytes since the port was opened, and `garbled` is the last line
    that begins as an echo does and is none.
    """

    source: ByteSource
    rest: bytes = b""
    received: int = 0
    garbled: str = ""
    echoes: dict[str, Echo] = field(default_factory=dict)
    known: dict[str, Echo] = field(default_factory=dict)
    before: dict[str, Echo] = field(default_factory=dict)

    def anything(self, seconds: float) -> None:
        """Wait until the board says anything."""
        until = time.monotonic() + seconds
        while not self.received and time.monotonic() < until:
            self._take(until)

    def anew(self, seconds: float) -> None:
        """Forget a line that was cut off, and wait until the board says anything again."""
        self.rest, self.received = b"", 0
        self.anything(seconds)

    def echo(self, expected: dict[str, tuple[float, ...]], seconds: float) -> list[Echo] | None:
        """Wait for both lines with the expected values; None where they do not come in time."""
        self.echoes.clear()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._take(until)
            if all(name in self.echoes and self.echoes[name].differs(expected[name]) is None for name in expected):
                return list(self.echoes.values())
        return None

    def complaint(self, expected: dict[str, tuple[float, ...]]) -> str:
        """Say what came in place of the echo, and what to do."""
        for name, echo in self.known.items():
            if (place := echo.differs(expected[name])) is not None:
                number = f"{echo.values[place]:g} in place of {expected[name][place]:.6g}"
                return self._of_values(name, f"{number} (number {place + 1} of its {name} line)")
        unknown = "whether the board has taken the packet is not known"
        if self.garbled:
            return f"its echo cannot be read ({self.garbled[:60]!r}): check --baud and the cable; {unknown}"
        if not self.received:
            return f"nothing came from {self.source.name}: check the port, --baud and that the sketch runs; {unknown}"
        missing = " and ".join(f"{name}:" for name in expected if name not in self.known)
        if not missing:
            return "the board printed both lines with the new values, but never one soon after the other: send again"
        return (
            f"the board prints no {missing} line, by which a sketch confirms, and {unknown}: see what it prints with "
            "flinders record, and whether its sketch reads what MotionCal sends"
        )

    def _of_values(self, name: str, wrong: str) -> str:
        """Say what an echo of other values means, and what to do: one from before tells old values from new ones."""
        if name not in self.echoes:
            return (
                f"the board said {wrong} before, and nothing of it since: {EITHER}; see what it prints with flinders "
                "record, and send again"
            )
        if name in self.before and self.before[name].values == self.known[name].values:
            return (
                f"the board still says {wrong}, as before it was sent anything: it has not taken the packet, or did so "
                "before and keeps other numbers than it is sent; see that its sketch keeps a calibration as those of "
                "PJRC and Adafruit do, and send again"
            )
        return (
            f"the board now says {wrong}: other numbers than were sent; send again, or look at how its sketch keeps "
            "and prints them"
        )

    def _take(self, until: float) -> None:
        """Take what has arrived, and note the echoes in it."""
        content = self.source.read(max(min(0.1, until - time.monotonic()), 0.0))
        self.received += len(content)
        *lines, self.rest = re.split(rb"[\r\n]+", self.rest + content)
        self.rest = self.rest[-LONGEST:]
        for line in lines:
            self._note(line.decode("ascii", "replace").strip())

    def _note(self, line: str) -> None:
        """Keep an echo; one that is not understood is no answer, but worth telling."""
        name, colon, text = line.partition(":")
        if colon and name in NUMBERS:
            echo = Echo.of(text, NUMBERS[name])
            if echo is None:
                self.garbled = line
            else:
                self.echoes[name] = self.known[name] = echo


def _reopen(source: ByteSource, seconds: float) -> None:
    """Open a port again that may be back in so many seconds."""
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
