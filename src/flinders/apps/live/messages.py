"""Messages of the live page as dataclasses, and the binary frame of readings.

The page runs the session. The server sends the page the source of the readings and the user's edits so far, then each
reading. The server stores the user's edits, and passes them on to other pages (`Edits`, `Kept`).

>>> parse('{"type": "edits", "target_deg": 0.5}').target_deg
0.5
>>> parse('{"type": "edits", "excluded": [[3, 2]]}')
Traceback (most recent call last):
flinders.errors.UsageError: excluded from 3 to 2 s: need a start before the end
>>> encode(Notice(severity="info", words="the port is back"))
'{"type":"notice","severity":"info","words":"the port is back"}'

Unknown and non-finite numbers are sent as null. ``tests/message_types.py`` generates ``static/wire.d.ts`` from the
dataclasses, and a test compares both.
"""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal

import msgspec
import numpy as np
from msgspec import Struct

from flinders.core.calibration_file import readable_message
from flinders.errors import UsageError
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from flinders.arrays import Floats

Kind = Literal["serial", "udp", "tcp", "mavlink", "ros2", "replay", "simulated", "phone", "file"]
Link = Literal["connected", "waiting", "gone", "ended"]
Goal = Literal["heading", "attitude"]
Span = tuple[float, float]

MIN_TARGET_DEG: Final = 1e-3
MAX_DIP_DEG: Final = 89.0
MIN_STRENGTH: Final = 1e-3  # Range of the field strength at a site, in the unit of the readings
MAX_STRENGTH: Final = 1e9
MAX_MESSAGE_BYTES: Final = 65_536  # Largest message from a page
MAX_SPANS: Final = 1000  # Largest number of excluded spans
MAGIC: Final = 0x464C4E44
HEADER: Final = struct.Struct("<8I")
HAS_ACCELERATION: Final = 1
IS_MICROTESLA: Final = 2
IS_VEHICLE: Final = 4


class SourceState(Struct, frozen=True):
    """Source of the readings, and the state of its link."""

    name: str
    kind: Kind
    link: Link
    words: str


class Edits(Struct, frozen=True, kw_only=True, tag_field="type", tag="edits", forbid_unknown_fields=True):
    """The user's edits of a session, and the site of its log."""

    excluded: tuple[Span, ...] = ()  # excluded spans of time in s, ascending, without overlap
    paused_s: float | None = None  # start of a pause, during which readings are left out
    finished_s: float | None = None  # later readings are recorded, but not used by the finished calibration
    begun_s: float | None = None  # readings up to this time are discarded
    target_deg: float = 1.0
    dip_deg: float | None = None
    goal: Goal = "heading"
    site: Site | None = None
    refreshing: bool = False  # the calibration keeps the soft iron of the earlier one


class Kept(Struct, frozen=True, tag_field="type", tag="kept"):
    """Edits that the server has stored, after it received `heard` messages from the page that gets this message.

    A page that has sent more than `heard` messages ignores these edits, since newer ones will follow.
    """

    edits: Edits
    heard: int


class Previous(Struct, frozen=True, tag_field="type", tag="previous", forbid_unknown_fields=True):
    """Earlier calibration: name and text of its file, and its number in this session; all empty for none."""

    name: str = ""
    text: str = ""
    number: str = ""


class Linked(Struct, frozen=True, tag_field="type", tag="source"):
    """Message that the state of the link to the source has changed."""

    source: SourceState


class Unrecorded(Struct, frozen=True, tag_field="type", tag="unrecorded"):
    """Reason why readings are not recorded at present; empty if they are recorded."""

    words: str


class Notice(Struct, frozen=True, tag_field="type", tag="notice"):
    """Message to show once to the user of the page."""

    severity: Literal["info", "warning", "error"]
    words: str


class TargetInfo(Struct, frozen=True):
    """Name and description of an export target."""

    name: str
    title: str
    suffix: str
    group: str  # heading of the target in the list


class Limits(Struct, frozen=True):
    """Limits on messages from a page."""

    upload_bytes: int


class Welcome(Struct, frozen=True, tag_field="type", tag="welcome"):
    """First message on a connection: the state except the readings, which follow."""

    version: str
    session: str
    targets: tuple[TargetInfo, ...]
    limits: Limits
    source: SourceState
    axes: str  # mapping of the readings, as for `--axes`
    recording: str  # file of the recording
    unrecorded: str
    has_board: bool  # the source is a board that can receive a calibration
    edits: Edits
    previous: Previous


FromServer = Welcome | Kept | Previous | Linked | Unrecorded | Notice

_DECODER: Final = msgspec.json.Decoder(Edits | Previous)
_ENCODER: Final = msgspec.json.Encoder()


def encode(message: FromServer | Edits) -> str:
    """Write a message as a text frame."""
    return _ENCODER.encode(message).decode()


def parse(text: str | bytes) -> Edits | Previous:
    """Parse a message of a page; `UsageError` if it is too long, invalid, or out of range."""
    if len(text) > MAX_MESSAGE_BYTES:
        raise UsageError(f"a message of {len(text):,} bytes: need at most {MAX_MESSAGE_BYTES:,}")
    try:
        message: Edits | Previous = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise UsageError(f"not a message of this page: {readable_message(error)}") from None
    if isinstance(message, Edits):
        refuse_out_of_range(message)
    elif message != Previous():
        raise UsageError("a calibration to compare with is sent as a file: drop the file on the page")
    return message


def refuse_out_of_range(edits: Edits) -> None:
    """Raise `UsageError` for numbers out of range."""
    if not MIN_TARGET_DEG <= edits.target_deg <= 180.0:
        raise UsageError(f"target {edits.target_deg:g}°: need an angle from {MIN_TARGET_DEG:g}° to 180°")
    if edits.dip_deg is not None and not abs(edits.dip_deg) <= MAX_DIP_DEG:
        raise UsageError(f"dip {edits.dip_deg:g}°: need −89° to 89°")
    for strength in () if edits.site is None else (edits.site.strength, edits.site.length):
        if strength is not None and not MIN_STRENGTH <= strength <= MAX_STRENGTH:
            raise UsageError(f"field of {strength:g}: need {MIN_STRENGTH:g} to {MAX_STRENGTH:g}")
    if len(edits.excluded) > MAX_SPANS:
        count = f"{len(edits.excluded):,} stretches are left out: need at most {MAX_SPANS:,}"
        raise UsageError(f"{count}; leave out one longer stretch instead of several")
    for start, end in edits.excluded:
        if not -math.inf < start <= end < math.inf:
            raise UsageError(f"excluded from {start:g} to {end:g} s: need a start before the end")
    for (_, end), (start, _) in pairwise(edits.excluded):
        if not end < start:
            raise UsageError(f"excluded up to {end:g} s, then from {start:g} s on: need ascending stretches")


def readings_frame(
    *,
    generation: int,
    first: int,
    stride: int,
    total: int,
    is_last: bool,
    rows: Floats,
    latest: Floats,
    is_microtesla: bool,
    is_vehicle: bool,
) -> bytes:
    """Pack readings into a binary frame, little-endian.

    Eight uint32: magic, generation, first, count, flags, stride, total, and 1 for the last frame so far; then float64:
    the newest reading (7), times (N), field (3 N) and, if flagged, accelerations (3 N).

    Parameters
    ----------
    generation : int
        A new number means that the page drops all earlier readings.
    first : int
        Number of the first row in memory; row j in memory is reading j · `stride`.
    stride, total : int
        `total` readings were received up to the last row.
    is_last : bool
        No further readings were received.
    rows : (N, 7) float
        Time in s, field, acceleration; NaN if missing.
    latest : (7,) float
        The newest reading, with the columns of `rows`; it may be missing in `rows`.
    is_microtesla : bool
        The unit of the field is µT, else counts.
    is_vehicle : bool
        The axes of the field are those of a vehicle, else of the sensor.

    Examples
    --------
    >>> rows = np.zeros((2, 7))
    >>> frame = readings_frame(
    ...     generation=1, first=0, stride=1, total=2, is_last=True, rows=rows, latest=rows[1], is_microtesla=True,
    ...     is_vehicle=False,
    ... )
    >>> len(frame), frame[:4]
    (200, b'DNLF')
    """
    has_acceleration = bool(np.isfinite(rows[:, 4]).any())
    flags = HAS_ACCELERATION * has_acceleration | IS_MICROTESLA * is_microtesla | IS_VEHICLE * is_vehicle
    parts = [latest, rows[:, 0], rows[:, 1:4], *([rows[:, 4:]] if has_acceleration else [])]
    header = HEADER.pack(MAGIC, generation & 0xFFFFFFFF, first, len(rows), flags, stride, total, is_last)
    return header + b"".join(np.ascontiguousarray(part, "<f8").tobytes() for part in parts)
