"""Names and numbers in generated code.

>>> digits(0.1, "f"), begun("flinders", "Mast, top")
('0.100000001f', 'Mast_top')
"""

from __future__ import annotations

import re
import unicodedata
import zlib
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

LONGEST: Final = 31
"""Letters of a name that all compilers tell apart."""


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
    """What names in generated code begin with: `usual`, or letters and digits of the `name` that was asked for.

    What is between them becomes ``_``. A name of which nothing is left, or too much, raises `UsageError`.

    >>> begun("flinders", None), begun("flinders", "Mast, top"), begun("flinders", "2nd compass")
    ('flinders', 'Mast_top', 'mag_2nd_compass')
    """
    if name is None:
        return usual
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_")
    word = f"mag_{word}" if word[:1].isdigit() else word
    if not 0 < len(word) <= LONGEST:
        raise UsageError(
            f"{name[:LONGEST]!r} leaves {len(word)} letters and digits of ASCII to begin names in code with: "
            f"need 1 to {LONGEST}",
            hint={"name": "mast"},
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
