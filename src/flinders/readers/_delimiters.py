"""Delimiter and decimal sign of a text: the pair that yields the most numbers from the first lines.

>>> lines = list(enumerate(["x;y;z", "20,1;-3,0;41,2", "20,2;-3,1;41,3"]))
>>> best = max((split_lines(lines, signs) for signs in signs_of(lines)), key=Cut.score)
>>> best.signs, list(best.rows)
((';', ','), [1, 2])
"""

from __future__ import annotations

from typing import Final, NamedTuple

from flinders.readers._cells import COMMENTS, JOINED_DECIMALS, SPACES, parse_number, split

SIGNS: Final = (
    (",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (SPACES, "."), (SPACES, ","), (",", ","),
)  # fmt: skip
"""Pairs of delimiter and decimal sign, in order of preference."""


def is_comment(text: str) -> bool:
    """Tell whether a line is a comment."""
    return text.lstrip().startswith(COMMENTS)


class Cut(NamedTuple):
    """Lines split at a delimiter; those that are rows of numbers, by line index."""

    signs: tuple[str, str]
    rows: dict[int, list[str]]  # cells by line index
    values: dict[int, list[float | None]]  # numbers by line index, None for text
    numbers: int  # count of numbers in all rows

    def score(self) -> tuple[int, int]:
        """Score of a delimiter and decimal sign: counts of rows and of numbers."""
        return len(self.rows), self.numbers


def signs_of(lines: list[tuple[int, str]]) -> list[tuple[str, str]]:
    """Pairs that occur in the lines: the delimiter, and a decimal comma (in quotes if commas also delimit)."""
    whole = "\n".join(text for _, text in lines)
    has_comma, has_quote = "," in whole, '"' in whole
    there = {delimiter for delimiter, _ in SIGNS if delimiter in whole} - {SPACES}
    if any(len(text.split()) > 1 for _, text in lines) or JOINED_DECIMALS.search(whole.replace('"', "")):
        there.add(SPACES)
    decimals = (signs for signs in SIGNS if signs[0] in there)
    return [signs for signs in decimals if signs[1] == "." or (has_quote if signs[0] == "," else has_comma)]


def split_lines(lines: list[tuple[int, str]], signs: tuple[str, str], least: int = 3) -> Cut:
    """Split lines; rows have at least `least` numbers, and at least as many numbers as words."""
    delimiter, decimal = signs
    rows, values, total = {}, {}, 0
    for place, text in lines:
        cells = split(text, delimiter)
        if len(cells) < least:
            continue
        known = [parse_number(cell, decimal) for cell in cells]
        blank, words = len(cells) - len(list(filter(str.strip, cells))), known.count(None)
        numbers = len(cells) - blank - words
        if numbers >= least and numbers >= words:
            rows[place], values[place] = cells, known
            total += numbers
    return Cut(signs, rows, values, total)


def first_row(texts: list[str], after: int, start: int) -> int:
    """Place of the first line that looks like a reading with any delimiter, also if it cannot be read."""
    between = [(place, text) for place, text in enumerate(texts[after:start], after) if not is_comment(text)]
    return min((place for signs in SIGNS for place in split_lines(between, signs).rows), default=start)
