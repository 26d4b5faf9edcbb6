"""Include guards of headers that are written."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


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
