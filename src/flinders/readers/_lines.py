r"""Lines of text: bytes become blocks of decoded lines, whatever ends them, and however long one is.

Lines end with LF, CR LF or CR; one longer than `LONGEST` is cut, so that a file without line ends costs no more memory
than any other.

>>> [lines.texts for lines in lines_of([b"1,2\r\n3,", b"4\r"], "utf-8", done=lambda: 0)]
[['1,2', '3,4']]
"""

from __future__ import annotations

import codecs
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import BLOCK
from flinders.errors import UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

LONGEST: Final = 1 << 20  # Characters in the longest line that is kept whole
MOST_IN_BLOCK: Final = 1 << 23  # Characters after which a block of lines ends early
CUT: Final = 60  # Characters shown of a line in a message
CUT_OFF: Final = "…"  # What stands at the end of a line that was longer than `LONGEST`
ENDS_EARLY: Final = "gzip ends early"  # What stands in place of the line in which a file was cut short
LINE_FEED: Final = np.uint8(10)
MARKS: Final = {  # byte order marks
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip


class EndsEarly(Exception):
    """Compressed bytes without their end: what came before is sound. Never leaves the readers."""

    def refusal(self, name: str) -> UnreadableInput:
        """Say so, where nothing came before."""
        return UnreadableInput(f"{name} is cut short: its gzip data have no end; copy it again")


@dataclass(frozen=True, slots=True)
class Lines:
    """Consecutive lines of a text."""

    first: int  # the number of the first
    text: str  # all of them, with LF between them
    count: int
    done: int  # bytes of the file read so far

    @property
    def numbers(self) -> range:
        """That of each."""
        return range(self.first, self.first + self.count)

    def blocks(self) -> Iterator[Lines]:
        """Cut them into blocks of `BLOCK`."""
        if self.count <= BLOCK:
            yield self
            return
        texts = self.texts
        for start in range(0, self.count, BLOCK):
            some = texts[start : start + BLOCK]
            yield Lines(self.first + start, "\n".join(some), len(some), self.done)

    @property
    def texts(self) -> list[str]:
        """Each by itself, cut anew each time."""
        return self.text.split("\n") if self.count else []


def lines_of(
    chunks: Iterable[bytes], encoding: str, done: Callable[[], int], least: int = BLOCK, blocks: int = 1
) -> Iterator[Lines]:
    """Yield all lines, `BLOCK` at a time, after the first `blocks` blocks at a time; wait for `least` lines."""
    first, together = 1, 1
    pending, count = "", 0
    for text in _whole(_decoded(chunks, encoding)):
        pending += text
        count += _ends_in(text)
        while count >= least * together or len(pending) - count > MOST_IN_BLOCK:
            taken = min(count, BLOCK * max(min(count // BLOCK, together), 1))
            end = _end_of(pending, taken, count - taken)
            yield Lines(first, pending[: end - 1], taken, done())
            first, pending, count, together = first + taken, pending[end:], count - taken, blocks
    if pending:
        yield Lines(first, pending[:-1], count, done())


def encoding_of(head: bytes) -> str:
    """Tell how text is encoded: by its byte order mark, else UTF-8 where it decodes, else Latin-1."""
    if mark := next((mark for mark in MARKS if head.startswith(mark)), b""):
        return MARKS[mark]
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character cut off at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _decoded(chunks: Iterable[bytes], encoding: str) -> Iterator[str]:
    """Decode chunk by chunk, with every line end as LF; bytes that mean nothing become U+FFFD."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)("replace"), translate=True)
    for chunk in chunks:
        yield decoder.decode(chunk)
    yield decoder.decode(b"", final=True)


def _whole(texts: Iterator[str]) -> Iterator[str]:
    """Cut text behind line ends; what exceeds `LONGEST` in a line is dropped, with a mark that no number has."""
    rest = ""
    try:
        for text in texts:
            rest += text
            end = rest.rfind("\n") + 1
            whole, rest = rest[:end], rest[end : end + LONGEST + 1]
            if whole:
                end = whole.index("\n")
                yield whole if end <= LONGEST else _shortened(whole[:end]) + whole[end:]
    except EndsEarly:
        rest = ENDS_EARLY  # the line before the cut may have lost digits
    if rest:
        yield _shortened(rest) + "\n"


def _ends_in(text: str) -> int:
    """Count line ends, in a third of the time that ``text.count`` takes."""
    return int(np.count_nonzero(np.frombuffer(text.encode(), np.uint8) == LINE_FEED))


def _end_of(text: str, before: int, after: int) -> int:
    """Find the place behind so many lines, which is before so many, from the nearer end."""
    if before < after:
        return len(text) - len(text.split("\n", before)[-1])
    return len(text.rsplit("\n", after + 1)[0]) + 1


def _shortened(line: str) -> str:
    return line if len(line) <= LONGEST else line[:CUT] + CUT_OFF
