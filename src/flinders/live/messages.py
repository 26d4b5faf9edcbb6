"""The wire of the live page: every message as a dataclass, binary points, and the page's types made from them.

>>> parse('{"type": "target", "deg": 0.5}')
SetTarget(deg=0.5)
>>> parse('{"type": "exclude", "start_s": 3, "end_s": 2}')
Traceback (most recent call last):
flinders.errors.UsageError: exclude: from 3 to 2 s: need a start before the end
>>> encode(Notice(severity="info", words="the port is back"))
'{"type":"notice","severity":"info","words":"the port is back"}'

What is not known, and what is not finite, is null. ``static/messages.d.ts`` is made from the dataclasses by
``tests/message_types.py``, and a test sees that it stays so.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Final, Literal

import msgspec
import numpy as np
from msgspec import Struct

from flinders.core.calibration_file import in_words
from flinders.errors import UsageError
from flinders.report.view import TilesView, View

if TYPE_CHECKING:
    from flinders.arrays import Floats

Kind = Literal["serial", "udp", "tcp", "mavlink", "replay", "simulated", "phone", "file"]
Link = Literal["connected", "waiting", "gone", "ended"]
Phase = Literal["waiting", "collecting", "good", "limited", "wrong"]
Goal = Literal["heading", "attitude"]
Span = tuple[float, float]

LARGEST_DIP_DEG: Final = 89.0
LONGEST: Final = 65_536  # Bytes of a message from a page
MAGIC: Final = 0x464C4E44
HEADER: Final = struct.Struct("<8I")
HAS_ACCELERATION: Final = 1


class SourceState(Struct, frozen=True):
    """Where readings come from, and whether they do."""

    name: str
    kind: Kind
    link: Link
    words: str


class Reason(Struct, frozen=True):
    """Something that is wrong, or worth knowing, what to do about it, and intervals that a person may leave out."""

    code: str
    advice: str
    severity: Literal["info", "warning"] = "warning"
    spans: tuple[Span, ...] = ()


class PreviousState(Struct, frozen=True):
    """A calibration from before, and how far the present one is off it, at the worst level heading."""

    name: str
    change_deg: float | None
    words: str


class SessionState(Struct, frozen=True, tag_field="type", tag="state"):
    """What a page shows, without the fit and the points.

    Attributes
    ----------
    readings, used, rejected, excluded_readings : int
        Received; of those fitted, used and rejected as outliers; excluded by hand.
    rate_hz : float or None
        Over the last two seconds.
    seconds : float or None
        Time of the newest reading since the session began; None where a log has no times.
    words : str
        The phase in a sentence.
    told : str or None
        Code of the reason that `words` say.
    reasons : list of Reason
        By severity.
    dip_assumed : bool
        Nobody gave the dip or the place.
    excluded : list of (start, end), s
        Ascending, apart from each other.
    stride : int
        Every so many readings one is shown.
    recording : str or None
        File that the server writes to.
    refreshing : bool
        The calibration keeps the soft iron of `previous`.
    opened : str or None
        Name of the log that is shown in place of the sensor.
    can_send : bool
        The calibration that is shown can be sent to the board that the readings come from.
    """

    revision: int
    source: SourceState
    unit: str
    readings: int
    used: int
    rejected: int
    excluded_readings: int
    rate_hz: float | None
    seconds: float | None
    phase: Phase
    words: str
    told: str | None
    reasons: tuple[Reason, ...]
    target_deg: float
    dip_deg: float
    dip_assumed: bool
    goal: Goal
    excluded: tuple[Span, ...]
    can_undo: bool
    can_redo: bool
    stride: int
    paused: bool
    recording: str | None
    previous: PreviousState | None
    refreshing: bool
    opened: str | None
    can_send: bool


class FitMessage(Struct, frozen=True, tag_field="type", tag="fit"):
    """A new fit; null where there is none."""

    revision: int
    view: View | None


class Notice(Struct, frozen=True, tag_field="type", tag="notice"):
    """Something to tell the person at the page, once."""

    severity: Literal["info", "warning", "error"]
    words: str


class TargetInfo(Struct, frozen=True):
    """A target that a calibration can be exported for."""

    name: str
    title: str
    suffix: str


class Limits(Struct, frozen=True):
    """What a page may send."""

    upload_bytes: int


class Hello(Struct, frozen=True, tag_field="type", tag="hello"):
    """The first message on a connection: all there is."""

    version: str
    session: str
    tiles: TilesView
    targets: tuple[TargetInfo, ...]
    limits: Limits
    state: SessionState
    view: View | None


class SetTarget(Struct, frozen=True, tag_field="type", tag="target", forbid_unknown_fields=True):
    """The worst heading error that is good enough."""

    deg: float


class SetDip(Struct, frozen=True, tag_field="type", tag="dip", forbid_unknown_fields=True):
    """The inclination of the field at the site."""

    deg: float


class SetPlace(Struct, frozen=True, tag_field="type", tag="place", forbid_unknown_fields=True):
    """The site in degrees, north and east positive, and the year: its inclination is taken from a model."""

    latitude_deg: float
    longitude_deg: float
    year: float


class SetGoal(Struct, frozen=True, tag_field="type", tag="goal", forbid_unknown_fields=True):
    """What the calibration is for."""

    goal: Goal


class Exclude(Struct, frozen=True, tag_field="type", tag="exclude", forbid_unknown_fields=True):
    """Take a stretch of time out."""

    start_s: float
    end_s: float


class Restore(Struct, frozen=True, tag_field="type", tag="restore", forbid_unknown_fields=True):
    """Put a stretch of time back in."""

    start_s: float
    end_s: float


class Undo(Struct, frozen=True, tag_field="type", tag="undo", forbid_unknown_fields=True):
    """Take the last exclusion or restoration back."""


class Redo(Struct, frozen=True, tag_field="type", tag="redo", forbid_unknown_fields=True):
    """Do again what was taken back."""


class Clear(Struct, frozen=True, tag_field="type", tag="clear", forbid_unknown_fields=True):
    """Begin anew: what was received so far stays on the disk only."""


class Pause(Struct, frozen=True, tag_field="type", tag="pause", forbid_unknown_fields=True):
    """Leave out what arrives until further notice."""

    paused: bool


class PreviousClear(Struct, frozen=True, tag_field="type", tag="previous_clear", forbid_unknown_fields=True):
    """Compare with no calibration from before."""


class SetRefresh(Struct, frozen=True, tag_field="type", tag="refresh", forbid_unknown_fields=True):
    """Keep the soft iron of the calibration from before, and find its hard iron anew; or no longer."""

    refresh: bool


class BackToLive(Struct, frozen=True, tag_field="type", tag="back_to_live", forbid_unknown_fields=True):
    """Close the log that was opened."""


Command = (
    SetTarget
    | SetDip
    | SetPlace
    | SetGoal
    | Exclude
    | Restore
    | Undo
    | Redo
    | Clear
    | Pause
    | PreviousClear
    | SetRefresh
    | BackToLive
)
"""What a page may ask for."""

_DECODER: Final = msgspec.json.Decoder(Command)
_ENCODER: Final = msgspec.json.Encoder()


def encode(message: SessionState | FitMessage | Notice | Hello) -> str:
    """Write a message as a text frame."""
    return _ENCODER.encode(message).decode()


def parse(text: str | bytes) -> Command:
    """Understand what a page sends; `UsageError` for what is too long, no message, or out of range."""
    if len(text) > LONGEST:
        raise UsageError(f"a message of {len(text):,} bytes: need at most {LONGEST:,}")
    try:
        command: Command = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(f"not a message of this page: {in_words(error)}") from None
    _refuse_out_of_range(command)
    return command


def _refuse_out_of_range(command: Command) -> None:
    """Raise `UsageError` for numbers that cannot be meant."""
    match command:
        case SetTarget(deg) if not 0.0 < deg <= 180.0:
            raise UsageError(f"target {deg:g}°: need an angle above 0°, up to 180°")
        case SetDip(deg) if not abs(deg) <= LARGEST_DIP_DEG:
            raise UsageError(f"dip {deg:g}°: need −89° to 89°")
        case Exclude(start, end) | Restore(start, end) if not -math.inf < start < end < math.inf:
            name = type(command).__name__.lower()
            raise UsageError(f"{name}: from {start:g} to {end:g} s: need a start before the end")


def points_frame(
    *,
    generation: int,
    first: int,
    stride: int,
    now: Floats,
    time: Floats,
    field: Floats,
    acceleration: Floats | None,
) -> bytes:
    """Pack shown points into a binary frame, little-endian.

    Eight uint32: magic, generation, first, count, flags, stride, 0, 0; then float32: `now` (6), times (N), readings
    (3 N) and, where flagged, accelerations (3 N).

    Parameters
    ----------
    generation : int
        Changes when all points are to be forgotten.
    first : int
        Number of the first of these among the shown points; point j is reading j · `stride`.
    stride : int
    now : (6,) float
        Newest reading and acceleration, NaN where there is none.
    time : (N,) float, s
    field : (N, 3) float
    acceleration : (N, 3) float, optional

    Examples
    --------
    >>> frame = points_frame(generation=1, first=0, stride=1, now=np.zeros(6), time=np.zeros(2),
    ...                      field=np.zeros((2, 3)), acceleration=None)
    >>> len(frame), frame[:4]
    (88, b'DNLF')
    """
    flags = HAS_ACCELERATION if acceleration is not None else 0
    parts = [now, time, field] if acceleration is None else [now, time, field, acceleration]
    header = HEADER.pack(MAGIC, generation & 0xFFFFFFFF, first, len(time), flags, stride, 0, 0)
    return header + b"".join(np.ascontiguousarray(part, "<f4").tobytes() for part in parts)
