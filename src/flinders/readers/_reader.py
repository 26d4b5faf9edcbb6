r"""Which reader takes a file: one row of the table of formats, and what a file is by its first bytes.

>>> row = Reader("ulog", "PX4 ULog", (".ulg",), "each compass", starts=(b"ULog\x01\x12\x35",))
>>> row.accepts(b"ULog\x01\x12\x35\x01"), row.accepts(b"x,y,z\n")
(True, False)
>>> foreign_kind(b"\x89PNG\r\n\x1a\n....")
FileKind(name='a PNG image', advice='give the recording itself')
>>> foreign_kind(b"mx,my,mz\n1,2,3\n") is None
True
"""

from __future__ import annotations

from codecs import BOM_UTF16_BE, BOM_UTF16_LE, BOM_UTF32_BE, BOM_UTF32_LE
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    import re
    from collections.abc import Callable

GZIP: Final = b"\x1f\x8b"
WIDE_BOMS: Final = (BOM_UTF32_LE, BOM_UTF32_BE, BOM_UTF16_LE, BOM_UTF16_BE)
CONTROLS: Final = bytes(set(range(32)) - {9, 10, 12, 13, 27}) + b"\x7f"
"""Bytes that text does not hold: all but tab, line ends, form feed and escape."""
MOST_CONTROLS: Final = 0.02
"""Share of control bytes up to which a file still counts as text; random bytes have 0.11."""


class FileKind(NamedTuple):
    """A kind of file, and what to do with one."""

    name: str
    advice: str


_ITSELF = "give the recording itself"
_EXPORT = "export it as CSV"
_UNPACK = "unpack it and give the recording inside"

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
}
"""First bytes, and what they are the first bytes of. The order does not matter: none starts another."""

PAGES: Final = {b"<!doctype html": "an HTML page", b"<html": "an HTML page", b"<?xml": "an XML document"}
_WORDS: Final = frozenset(start for start in MAGIC if start.isalpha())
"""Starts that plain text may have too (``BM``, ``MZ``): they count only in a file that is binary."""


@dataclass(frozen=True, slots=True)
class Reader:
    """One row of the table of formats; of `starts`, `pattern` and `sniff`, all that are given have to hold."""

    name: str  #: in one word
    title: str  #: for people; a section of docs/formats.md may have it as its heading
    suffixes: tuple[str, ...]  #: endings that such files usually have; the content decides
    docs: str  #: what is read of such a file, for the table in docs/formats.md
    starts: tuple[bytes, ...] = ()  #: first bytes of such files, unpacked
    pattern: re.Pattern[bytes] | None = None  #: what stands in the first bytes
    sniff: Callable[[bytes], bool] | None = None  #: tells from the first bytes what no pattern can
    #: opens a table, a magnetometer in columns or one of several, with the options of `open_text`
    open: Callable[..., Any] | None = None
    log: Callable[..., Any] | None = None  #: or opens a `Log`: several instruments, which know their units
    extra: str = ""  #: the optional dependency it needs, or nothing
    takes_topic: bool = False  #: of a table: it has several, and takes the name of one
    takes_unit: bool = False  #: of a log: it may hold readings whose unit it does not know, and takes one

    def accepts(self, head: bytes) -> bool:
        """Tell whether this reader should try a file with these first bytes."""
        if self.starts and not head.startswith(self.starts):
            return False
        if self.pattern is not None and self.pattern.search(head) is None:
            return False
        return self.sniff is None or self.sniff(head)


def foreign_kind(head: bytes) -> FileKind | None:
    """Name what starts with these bytes, or None where they may be text."""
    binary = is_binary(head)
    for start, kind in MAGIC.items():
        if head.startswith(start) and (binary or start not in _WORDS):
            return kind
    opening = head.removeprefix(b"\xef\xbb\xbf").lstrip()[:20].lower()
    for start, name in PAGES.items():
        if opening.startswith(start):
            return FileKind(name, "download the raw file it shows")
    return FileKind("a binary file", "give a text recording with three columns of numbers") if binary else None


def is_binary(head: bytes) -> bool:
    """Tell whether these bytes hold what text does not; zeros that fill up the end are let pass."""
    if head.startswith(WIDE_BOMS):
        return False
    filled = head.rstrip(b"\x00")
    if not filled:
        return bool(head)
    return len(filled) - len(filled.translate(None, CONTROLS)) > MOST_CONTROLS * len(filled)
