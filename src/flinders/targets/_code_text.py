"""Names and numbers in generated code, and include guards.

>>> digits(0.1, "f"), name_prefix("flinders", "Mast, top")
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

MAX_NAME_LETTERS: Final = 31
"""Largest length of a name, in letters, that every compiler distinguishes."""


def digits(value: float, suffix: str = "") -> str:
    """Write a number so that it is read back as the same float32, with a point.

    >>> digits(0.1), digits(-3.0, "f"), digits(1e-12)
    ('0.100000001', '-3.0f', '9.99999996e-13')
    """
    text = f"{np.float32(value) + np.float32(0):.9g}"
    return f"{text if any(sign in text for sign in '.en') else f'{text}.0'}{suffix}"


def float32s(values: Iterable[float], suffix: str = "") -> str:
    """Write float32 numbers, separated by commas.

    >>> float32s([0.1, -3.0], "f")
    '0.100000001f, -3.0f'
    """
    return ", ".join(digits(value, suffix) for value in values)


def name_prefix(usual: str, name: str | None) -> str:
    """Prefix of names in generated code: `usual`, or the letters and digits of the requested `name`.

    Other characters become ``_``. `UsageError` is raised if the result is empty or too long.

    >>> name_prefix("flinders", None), name_prefix("flinders", "Mast, top"), name_prefix("flinders", "2nd compass")
    ('flinders', 'Mast_top', 'mag_2nd_compass')
    """
    if name is None:
        return usual
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_")
    word = f"mag_{word}" if word[:1].isdigit() else word
    if not 0 < len(word) <= MAX_NAME_LETTERS:
        raise UsageError(
            f"{name[:MAX_NAME_LETTERS]!r} has {len(word)} ASCII letters and digits as prefix of names in code: "
            f"need 1 to {MAX_NAME_LETTERS}",
            hint={"name": "mast"},
        )
    return word


def add_guard(word: str, body: Sequence[str]) -> list[str]:
    """Put an include guard around a header.

    The guard contains a checksum of the lines. The same header may therefore be included twice, while another header
    with the same names is an error; with a plain guard, the second sensor would silently get the numbers of the first
    one.

    >>> print(*add_guard("mast", ["int x;"]), sep=chr(10))
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
