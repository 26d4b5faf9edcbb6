"""Choice of a text's delimiter and decimal sign: the pair that yields the most numbers from the first lines.

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
    """Whether a line is a comment."""
    return text.lstrip().startswith(COMMENTS)


class Cut(NamedTuple):
    """Lines split at a delimiter, and those of them that are rows of numbers."""

    signs: tuple[str, str]
    rows: dict[int, list[str]]  # cells by line index
    values: dict[int, list[float | None]]  # numbers by line index, None for text
    numbers: int  # count of numbers in all rows

    def score(self) -> tuple[int, int]:
        """Score of this delimiter and decimal sign: number of rows, then number of numbers."""
        return len(self.rows), self.numbers


def signs_of(lines: list[tuple[int, str]]) -> list[tuple[str, str]]:
    """Pairs of delimiter and decimal sign that occur in the lines; a decimal comma is quoted if commas delimit too."""
    whole = "\n".join(text for _, text in lines)
    has_comma, has_quote = "," in whole, '"' in whole
    there = {delimiter for delimiter, _ in SIGNS if delimiter in whole} - {SPACES}
    if any(len(text.split()) > 1 for _, text in lines) or JOINED_DECIMALS.search(whole.replace('"', "")):
        there.add(SPACES)
    decimals = (signs for signs in SIGNS if signs[0] in there)
    return [signs for signs in decimals if signs[1] == "." or (has_quote if signs[0] == "," else has_comma)]


def split_lines(lines: list[tuple[int, str]], signs: tuple[str, str], least: int = 3) -> Cut:
    """Split lines into cells; a row has at least `least` numbers, and no more words than numbers."""
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
    """Place of the first line that looks like a reading with any delimiter, even if it cannot be parsed."""
    between = [(place, text) for place, text in enumerate(texts[after:start], after) if not is_comment(text)]
    return min((place for signs in SIGNS for place in split_lines(between, signs).rows), default=start)
