"""Text out of bytes, line by line, in bounded memory.

Lines end with LF, CR LF or CR; one longer than `LONGEST` is cut, so a file without line ends costs no
more memory than any other.
"""

from __future__ import annotations

import codecs
import io
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.errors import UnreadableInput
from flinders.samples import BLOCK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

LONGEST: Final = 1 << 20
"""Characters in the longest line that is kept whole."""
MOST_IN_BLOCK: Final = 1 << 23
"""Characters after which a block of lines ends early."""
CUT: Final = 60
"""Characters shown of a line in a message."""
CUT_OFF: Final = "…"
"""What stands at the end of a line that was longer than `LONGEST`."""
ENDS_EARLY: Final = "gzip ends early"
"""What stands in place of the line in which a file was cut short."""


class EndsEarly(Exception):
    """Compressed bytes without their end: what came before is sound. Never leaves the readers."""

    def refusal(self, name: str) -> UnreadableInput:
        """Say so, where nothing came before."""
        return UnreadableInput(f"{name} is cut short: its gzip data have no end; copy it again")


class Lines(NamedTuple):
    """A stretch of lines: the number of the first, their texts without line ends, bytes of the file read so far."""

    first: int
    texts: list[str]
    done: int


def lines_of(chunks: Iterable[bytes], encoding: str, done: Callable[[], int], least: int = BLOCK) -> Iterator[Lines]:
    """Yield all lines, `BLOCK` at a time.

    Parameters
    ----------
    chunks : iterable of bytes
        Any cuts will do. Where it raises `EndsEarly`, `ENDS_EARLY` takes the place of the last line.
    encoding : str
        As `encoding_of` tells it.
    done : callable
        Tells how many bytes were read so far.
    least : int
        Lines to wait for; with 1, what a chunk holds is yielded before the next is asked for.
    """
    first = 1
    pending: list[str] = []
    characters = 0
    for texts in _split(_decoded(chunks, encoding)):
        pending += texts
        characters += sum(map(len, texts))
        while len(pending) >= least or characters > MOST_IN_BLOCK:
            yield Lines(first, pending[:BLOCK], done())
            first += len(pending[:BLOCK])
            del pending[:BLOCK]
            characters = sum(map(len, pending))
    if pending:
        yield Lines(first, pending, done())


def encoding_of(head: bytes) -> str:
    """Tell how text is encoded: by its byte order mark, else UTF-8 where it decodes, else Latin-1."""
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if head.startswith(mark):
            return encoding
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character cut off at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def newline_of(head: bytes) -> str:
    """Tell how the first line ends; LF where none does."""
    text = head.decode(encoding_of(head), "replace")
    ends = [(place, end) for end in ("\r\n", "\n", "\r") if (place := text.find(end)) >= 0]
    return min(ends, key=lambda found: found[0])[1] if ends else "\n"


def shown(text: str) -> str:
    """Cut a line to what fits in a message, without characters that a terminal would act on."""
    cut = text.strip()[: CUT + 1]
    clean = "".join(letter if letter.isprintable() else " " if letter == "\t" else "\ufffd" for letter in cut)
    return clean if len(clean) <= CUT else clean[: CUT - 1] + "…"


def _decoded(chunks: Iterable[bytes], encoding: str) -> Iterator[str]:
    """Decode chunk by chunk, with every line end as LF; bytes that mean nothing become U+FFFD."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)("replace"), translate=True)
    for chunk in chunks:
        yield decoder.decode(chunk)
    yield decoder.decode(b"", final=True)


def _split(texts: Iterator[str]) -> Iterator[list[str]]:
    """Cut text into lines; what exceeds `LONGEST` in a line is dropped, with a mark that no number has."""
    rest = ""
    try:
        for text in texts:
            lines = (rest + text).split("\n")
            rest = lines.pop()
            if lines:
                lines[0] = _shortened(lines[0])
            if len(rest) > LONGEST:
                rest = rest[: LONGEST + 1]
            yield lines
    except EndsEarly:
        rest = ENDS_EARLY  # the line before the cut may have lost digits
    if rest:
        yield [_shortened(rest)]


def _shortened(line: str) -> str:
    return line if len(line) <= LONGEST else line[:CUT] + CUT_OFF
