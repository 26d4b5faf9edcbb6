"""Cells of a line, and the numbers in them.

>>> split("1;2,5;nan", ";"), parse_number("2,5", ","), parse_number("two", ".")
(['1', '2,5', 'nan'], 2.5, None)
"""

from __future__ import annotations

import csv
import math
import re
from typing import Final

from flinders.readers._lines import CUT_MARK

COMMENTS: Final = ("#", "%", "//")  # Beginnings of comment lines
SPACES: Final = " "  # Delimiter that stands for any run of spaces and tabs
MISSING: Final = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none"})  # Spellings of a missing value
MINUS: Final = "\N{MINUS SIGN}"  # Minus sign that text processors put in place of a hyphen
ATTACHED_NUMBER: Final = (
    r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|(?:nan|NaN|NAN|inf|ovf)(?!\w))"
)
"""A number, regardless of the text before it."""
JOINED_DECIMALS: Final = re.compile(r"(?<!\S)[-+]?\d*[.,]\d+(?:-\d*[.,]\d+)+(?!\S)")  # ``2995.10-5044.85``
_BITS: Final = {2: 8, 4: 16, 6: 24, 8: 32}  # bits of a signed hexadecimal number, by its number of digits


def split(text: str, delimiter: str) -> list[str]:
    """Split a line into cells; quotes are removed, spaces around cells are kept."""
    if text.endswith(CUT_MARK):
        return [text]
    if delimiter == SPACES:
        return separate_numbers(text.replace('"', "")).split()
    if '"' not in text:
        return text.split(delimiter)
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return [text]


def quote_cell(cell: str) -> str:
    """Quote a cell for a comma-separated table if it needs quotes."""
    return '"' + cell.replace('"', '""') + '"' if any(sign in cell for sign in ',"\r\n') else cell


def parse_number(cell: str, decimal: str) -> float | None:
    """Parse a cell as a number: NaN for a missing value, None for text."""
    text = cell.strip()
    if decimal == ",":
        if text.endswith(","):
            return None
        text = text.replace(",", ".")
    try:
        return None if "_" in text else float(text.replace(MINUS, "-"))
    except ValueError:
        return math.nan if text.casefold() in MISSING else None


def has_width(cells: list[str], width: int) -> bool:
    """Whether a line has `width` cells; empty cells at its end are ignored."""
    return len(cells) == width or (len(cells) > width and not any(cell.strip() for cell in cells[width:]))


def decimal(number: str) -> str:
    """Write a number in decimal digits: a hexadecimal one of full width as signed, an overflow as ``nan``."""
    if number[-1:] in "fF" and number.lstrip("-+").casefold() in ("inf", "ovf"):
        return "nan"
    if "x" not in number and "X" not in number:
        return number.replace(MINUS, "-")
    sign, digits = ("-", number[3:]) if number.startswith("-") else ("", number.lstrip("+")[2:])
    value, bits = int(digits, 16), _BITS.get(len(digits), 0)
    return f"{sign}{value - (1 << bits) if bits and value >> (bits - 1) else value}"


def separate_numbers(text: str) -> str:
    """Insert spaces between decimals of fixed width whose minus signs have joined them."""
    return (
        JOINED_DECIMALS.sub(lambda match: match[0][0] + match[0][1:].replace("-", " -"), text) if "-" in text else text
    )
