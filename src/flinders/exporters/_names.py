"""Names in generated code: those of two sensors must differ, so that both go into one program.

>>> begun("flinders", None), begun("flinders", "Mast, top"), begun("flinders", "2nd compass")
('flinders', 'Mast_top', 'mag_2nd_compass')
"""

from __future__ import annotations

import re
import unicodedata
import zlib
from typing import TYPE_CHECKING, Final

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

LONGEST: Final = 31
"""Letters of a name that all compilers tell apart."""


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
