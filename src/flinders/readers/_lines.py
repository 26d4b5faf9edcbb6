r"""Decoding of bytes into blocks of text lines, with any line end and any line length.

Lines end with LF, CR LF or CR. A line longer than `MAX_LINE_LETTERS` is cut, so that a file without line ends needs no more
memory than another.

>>> [lines.texts for lines in lines_of([b"1,2\r\n3,", b"4\r"], "utf-8", done=lambda: 0)]
[['1,2', '3,4']]
"""

from __future__ import annotations

import codecs
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import BLOCK_ROWS
from flinders.errors import UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

MAX_LINE_LETTERS: Final = 1 << 20  # longest line in characters that is kept whole
MAX_BLOCK_LETTERS: Final = 1 << 23  # characters after which a block of lines ends early
SHOWN_LETTERS: Final = 60  # characters of a line that a message shows
CUT_MARK: Final = "…"  # mark at the end of a line that was longer than `MAX_LINE_LETTERS`
GZIP_CUT_MARK: Final = "gzip ends early"  # text in place of the line in which a gzip file was cut short
LINE_FEED: Final = np.uint8(10)
BYTE_ORDER_MARKS: Final = {  # byte order marks
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip


class EndsEarly(Exception):
    """The end of compressed data is missing; bytes before it are valid. Never leaves the readers."""

    def refusal(self, name: str) -> UnreadableInput:
        """The error for a user, if no bytes came before."""
        return UnreadableInput(f"{name} is cut short: its gzip data have no end; copy it again")


@dataclass(frozen=True, slots=True)
class Lines:
    """Consecutive lines of a text."""

    first: int  # number of the first line
    text: str  # all lines, joined by LF
    count: int
    done: int  # bytes of the file read so far

    @property
    def numbers(self) -> range:
        """Number of each line."""
        return range(self.first, self.first + self.count)

    def blocks(self) -> Iterator[Lines]:
        """Yield these lines in blocks of `BLOCK_ROWS` lines."""
        if self.count <= BLOCK_ROWS:
            yield self
            return
        texts = self.texts
        for start in range(0, self.count, BLOCK_ROWS):
            some = texts[start : start + BLOCK_ROWS]
            yield Lines(self.first + start, "\n".join(some), len(some), self.done)

    @property
    def texts(self) -> list[str]:
        """List of the lines; split again at each access."""
        return self.text.split("\n") if self.count else []


def lines_of(
    chunks: Iterable[bytes], encoding: str, done: Callable[[], int], least: int = BLOCK_ROWS, blocks: int = 1
) -> Iterator[Lines]:
    """Yield all lines: first one block of `BLOCK_ROWS` lines, then `blocks` at a time; wait for at least `least` lines."""
    first, together = 1, 1
    pending, count = "", 0
    for text in _whole_lines(_decode(chunks, encoding)):
        pending += text
        count += _count_line_ends(text)
        while count >= least * together or len(pending) - count > MAX_BLOCK_LETTERS:
            taken = min(count, BLOCK_ROWS * max(min(count // BLOCK_ROWS, together), 1))
            end = _end_position(pending, taken, count - taken)
            yield Lines(first, pending[: end - 1], taken, done())
            first, pending, count, together = first + taken, pending[end:], count - taken, blocks
    if pending:
        yield Lines(first, pending[:-1], count, done())


def encoding_of(head: bytes) -> str:
    """Encoding of a text: by its byte order mark, else UTF-8 if it decodes, else Latin-1."""
    if mark := next((mark for mark in BYTE_ORDER_MARKS if head.startswith(mark)), b""):
        return BYTE_ORDER_MARKS[mark]
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character that is cut off at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _decode(chunks: Iterable[bytes], encoding: str) -> Iterator[str]:
    """Decode chunk by chunk, with LF for every line end and U+FFFD for invalid bytes."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)("replace"), translate=True)
    for chunk in chunks:
        yield decoder.decode(chunk)
    yield decoder.decode(b"", final=True)


def _whole_lines(texts: Iterator[str]) -> Iterator[str]:
    """Split text after line ends; a line beyond `MAX_LINE_LETTERS` is cut and gets a mark that no number contains."""
    rest = ""
    try:
        for text in texts:
            rest += text
            end = rest.rfind("\n") + 1
            whole, rest = rest[:end], rest[end : end + MAX_LINE_LETTERS + 1]
            if whole:
                end = whole.index("\n")
                yield whole if end <= MAX_LINE_LETTERS else _shorten(whole[:end]) + whole[end:]
    except EndsEarly:
        rest = GZIP_CUT_MARK  # the line before the cut may lack digits
    if rest:
        yield _shorten(rest) + "\n"


def _count_line_ends(text: str) -> int:
    """Count line ends; takes a third of the time of ``text.count``."""
    return int(np.count_nonzero(np.frombuffer(text.encode(), np.uint8) == LINE_FEED))


def _end_position(text: str, before: int, after: int) -> int:
    """Position after `before` lines, which is before `after` more, searched from the nearer end."""
    if before < after:
        return len(text) - len(text.split("\n", before)[-1])
    return len(text.rsplit("\n", after + 1)[0]) + 1


def _shorten(line: str) -> str:
    return line if len(line) <= MAX_LINE_LETTERS else line[:SHOWN_LETTERS] + CUT_MARK
