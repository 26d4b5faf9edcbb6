"""Comments in the languages of targets, in ASCII and without text that would end the comment.

>>> print(*HASH.lines(["48 µT"]))
# 48 uT
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True)
class Comment:
    """Syntax of comments in a language: start of each line, lines around them, and texts that must not occur.

    Names from recordings and users are written in comments only, in ASCII and without text that would end the comment.

    >>> print(*BLOCK.lines(["from */ system(1); /* x.json", "2 µT"]), sep=chr(10))
    /*
     * from * / system(1); / * x.json
     * 2 uT
     */
    """

    each: str
    opening: str = ""
    closing: str = ""
    ends: tuple[tuple[str, str], ...] = ()

    def lines(self, remarks: Iterable[str]) -> list[str]:
        """Break remarks into comment lines."""
        wrapped: list[str] = []
        for remark in remarks:
            wrapped += textwrap.wrap(
                self.plain(remark),
                width=78,
                initial_indent=self.each,
                subsequent_indent=f"{self.each}  ",
                break_on_hyphens=False,
            )
        return [*filter(None, [self.opening]), *wrapped, *filter(None, [self.closing])]

    def plain(self, remark: str) -> str:
        """A remark in ASCII, without text that would end the comment."""
        text = plain_ascii(remark)
        for unsafe, written in self.ends:
            while unsafe in text:
                text = text.replace(unsafe, written)
        return text


HASH: Final = Comment("# ")
PERCENT: Final = Comment("% ")
BLOCK: Final = Comment(" * ", "/*", " */", (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")))
MARKUP: Final = Comment("  ", "<!--", "-->", (("--", "- -"),))
ASCII: Final = str.maketrans({
    "µ": "u", "°": " deg", "−": "-", "·": "*", "×": "x", "σ": "sigma", "±": "+/-", "…": "...", "–": "-", "’": "'",
    "²": "^2", "ᵀ": "'", "½": "1/2", "∕": "/",
})  # fmt: skip


def plain_ascii(text: str) -> str:
    r"""Write text in printable ASCII, with escape codes for other characters.

    >>> plain_ascii("48 µT, café\x07\u2028"), plain_ascii("0.2° at 20 °C")
    ('48 uT, caf\\xe9\\x07\\u2028', '0.2 deg at 20 degC')
    """
    return "".join(
        sign if sign.isascii() and sign.isprintable() else sign.encode("unicode_escape").decode()
        for sign in text.replace(" °", "°").translate(ASCII)
    )
