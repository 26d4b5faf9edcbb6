r"""Row of the table of formats: the first bytes of a format's files, and the functions that open them.

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
    """One row of the table of formats. Files of the format match `starts`, `pattern` and `sniff`, as far as given."""

    name: str  #: in one word
    title: str  #: title for users, which may be the heading of a section in docs/formats.md
    suffixes: tuple[str, ...]  #: usual endings of such files; the content decides, not the ending
    docs: str  #: contents that are read, for the table in docs/formats.md
    starts: tuple[bytes, ...] = ()  #: first bytes of such files, unpacked
    pattern: re.Pattern[bytes] | None = None  #: pattern in the first bytes
    sniff: Callable[[bytes], bool] | None = None  #: function that recognises the first bytes, if no pattern can
    #: opens a table with the options of `open_text`: one magnetometer in columns, or one of several
    open: Callable[..., Any] | None = None
    #: opens a `Log` instead: several instruments, whose units are stated in the file
    log: Callable[..., Any] | None = None
    folder_file: str = ""  #: name of the file that describes a folder, if a folder is one recording; else empty
    extra: str = ""  #: optional dependency of Flinders that the format needs; else empty
    takes_topic: bool = False  #: for a table: whether it has several topics, of which one can be named
    takes_unit: bool = False  #: for a log: whether its readings may have no known unit, so that the user can give one

    def accepts(self, head: bytes) -> bool:
        """Whether this reader should try a file with these first bytes."""
        if self.starts and not head.startswith(self.starts):
            return False
        if self.pattern is not None and self.pattern.search(head) is None:
            return False
        return self.sniff is None or self.sniff(head)
