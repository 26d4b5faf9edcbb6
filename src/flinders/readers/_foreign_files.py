r"""Files that are not recordings or belong to another program, recognised by their first bytes, with advice for each.

>>> foreign_kind(b"\x89PNG\r\n\x1a\n....")
FileKind(name='a PNG image', advice='give the recording itself')
>>> foreign_kind(b"mx,my,mz\n1,2,3\n") is None
True
>>> is_binary(b"t,mx,my,mz\n"), is_binary(bytes(range(32)))
(False, True)
"""

from __future__ import annotations

import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, BOM_UTF32_BE, BOM_UTF32_LE
from typing import Final, NamedTuple

from flinders.errors import UnreadableInput


def refuse_foreign(name: str, head: bytes) -> None:
    """Raise an error for a file that is not text."""
    if kind := foreign_kind(head):
        raise UnreadableInput(f"{name} is {kind.name}: {kind.advice}")


WIDE_BOMS: Final = (BOM_UTF32_LE, BOM_UTF32_BE, BOM_UTF16_LE, BOM_UTF16_BE)
CONTROLS: Final = bytes(set(range(32)) - {9, 10, 12, 13, 27}) + b"\x7f"
"""Control bytes that do not occur in text: all except tab, line ends, form feed and escape."""
MAX_CONTROL_SHARE: Final = 0.02
"""Largest share of control bytes in text; random bytes have 0.11."""


class FileKind(NamedTuple):
    """A kind of file, and advice for it."""

    name: str
    advice: str


_ITSELF = "give the recording itself"
_EXPORT = "export it as CSV"
_UNPACK = "unpack it and give the recording inside"
BLACKBOX: Final = b"H Product:Blackbox"
_FIELDS: Final = re.compile(rb"^H Field I name:(.*)$", re.MULTILINE)
RAW_MAVLINK: Final = FileKind(
    "a raw MAVLink stream, without the times of a .tlog",
    "save the telemetry as .tlog in a ground station, or give the vehicle's own log (.bin, .ulg)",
)
MIN_PACKETS: Final = 3
"""Number of consecutive MAVLink packets that identify a stream."""
MAGIC: Final[dict[bytes, FileKind]] = {
    b"\x89PNG\r\n\x1a\n": FileKind("a PNG image", _ITSELF),
    b"\xff\xd8\xff": FileKind("a JPEG image", _ITSELF),
    b"GIF8": FileKind("a GIF image", _ITSELF),
    b"BM": FileKind("a BMP image", _ITSELF),
    b"II*\x00": FileKind("a TIFF image", _ITSELF),
    b"MM\x00*": FileKind("a TIFF image", _ITSELF),
    b"RIFF": FileKind("a sound, film or image file", _ITSELF),
    b"%PDF": FileKind("a PDF document", _ITSELF),
    b"{\\rtf": FileKind("an RTF document", "save it as plain text"),
    b"\xd0\xcf\x11\xe0": FileKind("an old Office document", _EXPORT),
    b"PK\x05\x06": FileKind("an empty ZIP archive", _ITSELF),
    b"Rar!": FileKind("a RAR archive", _UNPACK),
    b"7z\xbc\xaf\x27\x1c": FileKind("a 7z archive", _UNPACK),
    b"BZh": FileKind("bzip2-compressed", "unpack it with bunzip2"),
    b"\xfd7zXZ\x00": FileKind("xz-compressed", "unpack it with unxz"),
    b"\x28\xb5\x2f\xfd": FileKind("zstd-compressed", "unpack it with unzstd"),
    b"\x1f\x8b": FileKind("gzip-compressed twice", "unpack it with gunzip"),
    b"\x7fELF": FileKind("a program", _ITSELF),
    b"MZ": FileKind("a program", _ITSELF),
    b"FEA1": FileKind("a Feather file of version 1", "save it again with a pandas or pyarrow of this decade"),
    b"SQLite format 3": FileKind("an SQLite database", _EXPORT),
    BLACKBOX: FileKind(
        "a blackbox log of Betaflight, INAV or Cleanflight",
        "decode it with blackbox_decode, or save it as CSV in the Blackbox Explorer, and give the CSV",
    ),
}
"""Kinds of files by first bytes. The order does not matter: no key is the start of another."""
PAGES: Final = {b"<!doctype html": "an HTML page", b"<html": "an HTML page", b"<?xml": "an XML document"}
_WORDS: Final = frozenset(start for start in MAGIC if start.isalpha())
"""Keys of `MAGIC` that plain text may start with too (``BM``, ``MZ``); they count only in a binary file."""


def foreign_kind(head: bytes) -> FileKind | None:
    """Kind of a file with these first bytes; None if it may be text."""
    binary = is_binary(head)
    for start, kind in MAGIC.items():
        if head.startswith(start) and (binary or start not in _WORDS):
            return kind._replace(advice=f"{kind.advice}{_of_fields(head)}") if start == BLACKBOX else kind
    if binary and _is_mavlink(head):
        return RAW_MAVLINK
    opening = head.removeprefix(b"\xef\xbb\xbf").lstrip()[:20].lower()
    for start, name in PAGES.items():
        if opening.startswith(start):
            return FileKind(name, _advice_on_page(opening, head))
    return FileKind("a binary file", "give a text recording with three columns of numbers") if binary else None


def _advice_on_page(opening: bytes, head: bytes) -> str:
    """Advice for an HTML page or XML document; for an MVN recording, it names the element with the readings."""
    if not opening.startswith(b"<?xml"):
        return "download the raw file it shows"
    own = " (of MVN, sensorMagneticField of one sensor)" if b"<mvnx" in head else ""
    return f"export the readings as CSV, x, y and z in columns{own}"


def _of_fields(head: bytes) -> str:
    r"""Advice by the field list of a blackbox, which may contain a magnetometer; empty without a field list.

    >>> _of_fields(b"H Product:Blackbox\nH Field I name:time,gyroADC[0]\n").partition(":")[0]
    '; its field list has no magADC'
    """
    fields = _FIELDS.search(head)
    if fields is None:
        return ""
    if b"magADC" in fields[1]:
        return "; its field list has magADC, the magnetometer"
    return "; its field list has no magADC: have the magnetometer logged (blackbox_disable_mag = OFF), and record again"


def _is_mavlink(head: bytes) -> bool:
    """Whether a file starts with consecutive packets of MAVLink 1 or 2."""
    at = 0
    for _ in range(MIN_PACKETS):
        first, length, flags = (head[at : at + 3] + b"\0\0\0")[:3]
        if first not in (0xFE, 0xFD):
            return False
        at += length + (8 if first == 0xFE else 25 if flags & 1 else 12)
    return at <= len(head)


def is_binary(head: bytes) -> bool:
    """Whether bytes contain more control bytes than text does; zeros at the end are ignored."""
    if head.startswith(WIDE_BOMS):
        return False
    filled = head.rstrip(b"\x00")
    if not filled:
        return bool(head)
    return len(filled) - len(filled.translate(None, CONTROLS)) > MAX_CONTROL_SHARE * len(filled)
