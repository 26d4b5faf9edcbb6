r"""Row of the table of formats: what files of a format begin with, and what opens them.

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
    folder_file: str = ""  #: a folder that has a file of this name is one recording, which that file describes
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
