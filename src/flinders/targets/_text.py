"""Text of generated files: comments that nothing can end, numbers that are read back the same, names in code.

What a recording or a person named goes into comments only, in ASCII and without what would end the comment. Names of
two sensors must differ, so that code for both goes into one program.

>>> print(*BLOCK.lines(["from */ system(1); /* x.json", "2 µT"]), sep=chr(10))
/*
 * from * / system(1); / * x.json
 * 2 uT
 */
>>> begun("flinders", None), begun("flinders", "Mast, top"), begun("flinders", "2nd compass")
('flinders', 'Mast_top', 'mag_2nd_compass')
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

WIDTH: Final = 78
ASCII: Final = str.maketrans({
    "µ": "u", "°": " deg", "−": "-", "·": "*", "×": "x", "σ": "sigma", "±": "+/-", "…": "...", "–": "-", "’": "'",
    "²": "^2", "ᵀ": "'", "½": "1/2", "∕": "/",
})  # fmt: skip
LONGEST: Final = 31
"""Letters of a name that all compilers tell apart."""


@dataclass(frozen=True, slots=True)
class Comment:
    """How a language marks comments.

    Attributes
    ----------
    each : str
        What a line begins with.
    opening, closing : str
        Lines around them all; empty where there are none.
    ends : tuple of pairs of str
        What must not stand in a comment, and what is written in its place.
    """

    each: str
    opening: str = ""
    closing: str = ""
    ends: tuple[tuple[str, str], ...] = ()

    def lines(self, remarks: Iterable[str]) -> list[str]:
        """Break remarks into lines of comment."""
        wrapped = [
            line
            for remark in remarks
            for line in textwrap.wrap(
                self._harmless(remark),
                WIDTH,
                initial_indent=self.each,
                subsequent_indent=f"{self.each}  ",
                break_on_hyphens=False,
            )
        ]
        return [*([self.opening] if self.opening else []), *wrapped, *([self.closing] if self.closing else [])]

    def _harmless(self, remark: str) -> str:
        """ASCII that can be printed, and ends no comment."""
        text = plain_ascii(remark)
        for unsafe, written in self.ends:
            while unsafe in text:
                text = text.replace(unsafe, written)
        return text


HASH: Final = Comment("# ")
PERCENT: Final = Comment("% ")
BLOCK: Final = Comment(" * ", "/*", " */", (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")))
MARKUP: Final = Comment("  ", "<!--", "-->", (("--", "- -"),))


def plain_ascii(text: str) -> str:
    r"""Write text in printable ASCII, other characters by their code.

    >>> plain_ascii("48 µT, café\x07\u2028")
    '48 uT, caf\\xe9\\x07\\u2028'
    """
    return "".join(
        sign if sign.isascii() and sign.isprintable() else sign.encode("unicode_escape").decode()
        for sign in text.translate(ASCII)
    )


def digits(value: float, suffix: str = "") -> str:
    """Write a number of single precision so that it is read back the same, with a point.

    >>> digits(0.1), digits(-3.0, "f"), digits(1e-12)
    ('0.100000001', '-3.0f', '9.99999996e-13')
    """
    text = f"{np.float32(value) + np.float32(0):.9g}"
    return f"{text if any(sign in text for sign in '.en') else f'{text}.0'}{suffix}"


def float32s(values: Iterable[float], suffix: str = "") -> str:
    """Write numbers of single precision, with commas between them.

    >>> float32s([0.1, -3.0], "f")
    '0.100000001f, -3.0f'
    """
    return ", ".join(digits(value, suffix) for value in values)


def begun(usual: str, name: str | None) -> str:
    """What names in generated code begin with.

    Parameters
    ----------
    usual : str
        Where no name was asked for.
    name : str, optional
        What a person calls the sensor: letters and digits of ASCII are kept, what is between them becomes ``_``.

    Raises
    ------
    UsageError
        For a name of which nothing is left, or too much.
    """
    if name is None:
        return usual
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_")
    word = f"mag_{word}" if word[:1].isdigit() else word
    if not 0 < len(word) <= LONGEST:
        raise UsageError(
            f"--name {name[:LONGEST]!r} leaves {len(word)} letters and digits of ASCII to begin names in code with: "
            f"need 1 to {LONGEST}, such as --name mast"
        )
    return word


def guarded(word: str, body: Sequence[str]) -> list[str]:
    """Put an include guard around a header.

    The guard holds a checksum of the lines: the same header may be included again, and another one of the same names
    is an error, where an empty guard would give the second sensor the numbers of the first without a word.

    >>> print(*guarded("mast", ["int x;"]), sep=chr(10))
    #ifndef MAST_CALIBRATION_H
    #define MAST_CALIBRATION_H 0x32c65decu
    <BLANKLINE>
    int x;
    <BLANKLINE>
    #elif MAST_CALIBRATION_H != 0x32c65decu
    #error "two calibrations have the names of mast: write one of them with flinders export --name"
    #endif
    """
    guard, checksum = f"{word.upper()}_CALIBRATION_H", zlib.crc32("\n".join(body).encode())
    return [
        f"#ifndef {guard}",
        f"#define {guard} 0x{checksum:08x}u",
        "",
        *body,
        "",
        f"#elif {guard} != 0x{checksum:08x}u",
        f'#error "two calibrations have the names of {word}: write one of them with flinders export --name"',
        "#endif",
    ]
