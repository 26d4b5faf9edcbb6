"""The wire of the live page: every message as a dataclass, binary readings, and the page's types made from them.

The session is the page's. The server tells it where readings come from and what was done to them so far, passes each
reading on, and keeps and passes on what a person does (`Edits`, `Kept`).

>>> parse('{"type": "edits", "target_deg": 0.5}').target_deg
0.5
>>> parse('{"type": "edits", "excluded": [[3, 2]]}')
Traceback (most recent call last):
flinders.errors.UsageError: excluded from 3 to 2 s: need a start before the end
>>> encode(Notice(severity="info", words="the port is back"))
'{"type":"notice","severity":"info","words":"the port is back"}'

Unknown and non-finite numbers are sent as null. ``static/wire.d.ts`` is made from the dataclasses by
``tests/message_types.py``, and a test sees that it stays so.
"""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal

import msgspec
import numpy as np
from msgspec import Struct

from flinders.core.calibration_file import in_words
from flinders.errors import UsageError
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from flinders.arrays import Floats

Kind = Literal["serial", "udp", "tcp", "mavlink", "ros2", "replay", "simulated", "phone", "file"]
Link = Literal["connected", "waiting", "gone", "ended"]
Goal = Literal["heading", "attitude"]
Span = tuple[float, float]

MIN_TARGET_DEG: Final = 1e-3
LARGEST_DIP_DEG: Final = 89.0
MIN_STRENGTH: Final = 1e-3  # Of the field at a site, in the unit of the readings
MAX_STRENGTH: Final = 1e9
LONGEST: Final = 65_536  # Bytes of a message from a page
MAX_SPANS: Final = 1000  # Nobody takes out more by hand
MAGIC: Final = 0x464C4E44
HEADER: Final = struct.Struct("<8I")
HAS_ACCELERATION: Final = 1
IS_MICROTESLA: Final = 2
IS_VEHICLE: Final = 4


class SourceState(Struct, frozen=True):
    """Where readings come from, and whether they do."""

    name: str
    kind: Kind
    link: Link
    words: str


class Edits(Struct, frozen=True, kw_only=True, tag_field="type", tag="edits", forbid_unknown_fields=True):
    """What a person did in a session, and the site of its log; readings up to `begun_s` were left behind.

    A calibration that is finished is of those up to `finished_s`; later ones are recorded, and wait.
    """

    excluded: tuple[Span, ...] = ()  # s; apart from each other, ascending
    paused_s: float | None = None  # since when what arrives is left out
    finished_s: float | None = None
    begun_s: float | None = None
    target_deg: float = 1.0
    dip_deg: float | None = None
    goal: Goal = "heading"
    site: Site | None = None
    refreshing: bool = False  # the calibration keeps the soft iron of the one from before


class Kept(Struct, frozen=True, tag_field="type", tag="kept"):
    """The edits that the server holds, after `heard` messages from the page that this is sent to.

    A page that has sent more messages than that ignores them: newer edits will follow.
    """

    edits: Edits
    heard: int


class Previous(Struct, frozen=True, tag_field="type", tag="previous", forbid_unknown_fields=True):
    """A calibration from before: name and text of its file, and its number in this session; all empty for none."""

    name: str = ""
    text: str = ""
    number: str = ""


class Linked(Struct, frozen=True, tag_field="type", tag="source"):
    """The link to the source has changed."""

    source: SourceState


class Unrecorded(Struct, frozen=True, tag_field="type", tag="unrecorded"):
    """Why what arrives cannot be written down at present; nothing where it can."""

    words: str


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


class Welcome(Struct, frozen=True, tag_field="type", tag="welcome"):
    """The first message on a connection: all but the readings, which follow."""

    version: str
    session: str
    targets: tuple[TargetInfo, ...]
    limits: Limits
    source: SourceState
    axes: str  # that readings are mapped to, as `--axes` takes them
    recording: str  # file that the server writes to
    unrecorded: str
    has_board: bool  # the source is a board that takes a calibration
    edits: Edits
    previous: Previous


FromServer = Welcome | Kept | Previous | Linked | Unrecorded | Notice

_DECODER: Final = msgspec.json.Decoder(Edits | Previous)
_ENCODER: Final = msgspec.json.Encoder()


def encode(message: FromServer | Edits) -> str:
    """Write a message as a text frame."""
    return _ENCODER.encode(message).decode()


def parse(text: str | bytes) -> Edits | Previous:
    """Understand what a page sends; `UsageError` for what is too long, no message, or out of range."""
    if len(text) > LONGEST:
        raise UsageError(f"a message of {len(text):,} bytes: need at most {LONGEST:,}")
    try:
        message: Edits | Previous = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise UsageError(f"not a message of this page: {in_words(error)}") from None
    if isinstance(message, Edits):
        refuse_out_of_range(message)
    elif message != Previous():
        raise UsageError("a calibration to compare with comes as a file: drop that on the page")
    return message


def refuse_out_of_range(edits: Edits) -> None:
    """Raise `UsageError` for numbers that cannot be meant."""
    if not MIN_TARGET_DEG <= edits.target_deg <= 180.0:
        raise UsageError(f"target {edits.target_deg:g}°: need an angle from {MIN_TARGET_DEG:g}° to 180°")
    if edits.dip_deg is not None and not abs(edits.dip_deg) <= LARGEST_DIP_DEG:
        raise UsageError(f"dip {edits.dip_deg:g}°: need −89° to 89°")
    for strength in () if edits.site is None else (edits.site.strength, edits.site.length):
        if strength is not None and not MIN_STRENGTH <= strength <= MAX_STRENGTH:
            raise UsageError(f"field of {strength:g}: need {MIN_STRENGTH:g} to {MAX_STRENGTH:g}")
    if len(edits.excluded) > MAX_SPANS:
        count = f"{len(edits.excluded):,} stretches are left out: need at most {MAX_SPANS:,}"
        raise UsageError(f"{count}; leave out one longer stretch over several")
    for start, end in edits.excluded:
        if not -math.inf < start <= end < math.inf:
            raise UsageError(f"excluded from {start:g} to {end:g} s: need a start before the end")
    for (_, end), (start, _) in pairwise(edits.excluded):
        if not end < start:
            raise UsageError(f"what is excluded up to {end:g} s and from {start:g} s on: need ascending stretches")


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

    Eight uint32: magic, generation, first, count, flags, stride, total, and 1 where no more have come; then float64:
    the newest reading (7), times (N), field (3 N) and, where flagged, accelerations (3 N).

    Parameters
    ----------
    generation : int
        Changes when all readings are to be forgotten.
    first : int
        Number of the first row among those in memory; row j of these is reading j · `stride`.
    stride, total : int
        `total` readings have come up to the last row.
    is_last : bool
        No more have come.
    rows : (N, 7) float
        Time in s, field, acceleration: NaN where there is none.
    latest : (7,) float
    is_microtesla : bool
        The unit of the field; else counts.
    is_vehicle : bool
        The axes of the field are those of a vehicle; else of the sensor.

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
