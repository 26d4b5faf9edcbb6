"""Cells of a line, and their numbers.

>>> split("1;2,5;nan", ";"), number("2,5", ","), number("two", ".")
(['1', '2,5', 'nan'], 2.5, None)
"""

from __future__ import annotations

import csv
import math
import re
from typing import Final

from flinders.readers._lines import CUT_OFF

COMMENTS: Final = ("#", "%", "//")  # What a line that is none of a recording begins with
SPACES: Final = " "  # The delimiter that stands for any run of spaces and tabs
MISSING: Final = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none"})  # What loggers write for no value
MINUS: Final = "\N{MINUS SIGN}"  # What text processors make of a hyphen before a number
ATTACHED: Final = r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|(?:nan|NaN|NAN|inf|ovf)(?!\w))"
"""A number, whatever stands before it."""
GLUED: Final = re.compile(r"(?<!\S)[-+]?\d*[.,]\d+(?:-\d*[.,]\d+)+(?!\S)")  # ``2995.10-5044.85``
_BITS: Final = {2: 8, 4: 16, 6: 24, 8: 32}  # of a signed hexadecimal number with so many digits


def split(text: str, delimiter: str) -> list[str]:
    """Cut a line into cells, quotes removed and spaces around them left on."""
    if text.endswith(CUT_OFF):
        return [text]
    if delimiter == SPACES:
        return unglued(text.replace('"', "")).split()
    if '"' not in text:
        return text.split(delimiter)
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return [text]


def quoted(cell: str) -> str:
    """Write a cell of a table that is separated by commas."""
    return '"' + cell.replace('"', '""') + '"' if any(sign in cell for sign in ',"\r\n') else cell


def number(cell: str, decimal: str) -> float | None:
    """Read a cell: NaN where it is empty or says so, None where it is text."""
    text = cell.strip()
    if decimal == ",":
        if text.endswith(","):
            return None
        text = text.replace(",", ".")
    try:
        return None if "_" in text else float(text.replace(MINUS, "-"))
    except ValueError:
        return math.nan if text.casefold() in MISSING else None


def fits(cells: list[str], width: int) -> bool:
    """Tell whether a line has as many cells as the others; a delimiter at its end does no harm."""
    return len(cells) == width or (len(cells) > width and not any(cell.strip() for cell in cells[width:]))


def decimal(number: str) -> str:
    """Write a number in decimal: a hexadecimal one with all of its digits is signed, an overflow is ``nan``."""
    if number[-1:] in "fF" and number.lstrip("-+").casefold() in ("inf", "ovf"):
        return "nan"
    if "x" not in number and "X" not in number:
        return number.replace(MINUS, "-")
    sign, digits = ("-", number[3:]) if number.startswith("-") else ("", number.lstrip("+")[2:])
    value, bits = int(digits, 16), _BITS.get(len(digits), 0)
    return f"{sign}{value - (1 << bits) if bits and value >> (bits - 1) else value}"


def unglued(text: str) -> str:
    """Part decimals in columns of a fixed width that a minus has filled up."""
    return GLUED.sub(lambda match: match[0][0] + match[0][1:].replace("-", " -"), text) if "-" in text else text
