r"""Row of the table of formats: how files of a format start, and how they are opened.

>>> row = Reader("parquet", "Parquet table", (".parquet",), "columns", starts=(b"PAR1",))
>>> row.accepts(b"PAR1\x15"), row.accepts(b"x,y,z\n")
(True, False)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import re
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Reader:
    """One row of the table of formats; a file has to match all of `starts`, `pattern` and `sniff` that are given."""

    name: str  #: in one word
    title: str  #: title for users; a section of docs/formats.md may have it as its heading
    suffixes: tuple[str, ...]  #: usual endings of such files; the content decides
    docs: str  #: contents that are read, for the table in docs/formats.md
    starts: tuple[bytes, ...] = ()  #: first bytes of such files, unpacked
    pattern: re.Pattern[bytes] | None = None  #: pattern in the first bytes
    sniff: Callable[[bytes], bool] | None = None  #: recognises the first bytes if no pattern can
    #: opens a table, a magnetometer in columns or one of several, with the options of `open_text`
    open: Callable[..., Any] | None = None
    log: Callable[..., Any] | None = None  #: or opens a `Log`: several instruments, which know their units
    folder_file: str = ""  #: name of the file that makes a folder one recording, and describes it
    extra: str = ""  #: optional dependency that it needs, or empty
    takes_topic: bool = False  #: for a table: it has several topics, and takes the name of one
    takes_unit: bool = False  #: for a log: its readings may have no known unit, and it takes one

    def accepts(self, head: bytes) -> bool:
        """Tell whether this reader should try a file with these first bytes."""
        if self.starts and not head.startswith(self.starts):
            return False
        if self.pattern is not None and self.pattern.search(head) is None:
            return False
        return self.sniff is None or self.sniff(head)
