"""Layout of JSON for readers: a line for each row of a matrix, and a short group of plain values on one line."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final, TypeGuard

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_GROUP_LENGTH: Final = 110
"""Longest group of plain values, in characters, that is written on one line."""


def lay_out(value: object, indent: str = "") -> str:
    """Write JSON with short groups on one line, one line for each row of a matrix, and the rest indented.

    >>> print(lay_out({"rows": [[1.5, 0.0], [-0.25, 1.0]], "names": ["a", "b"]}))
    {
      "rows": [
        [ 1.5,  0.0],
        [-0.25, 1.0]
      ],
      "names": ["a", "b"]
    }
    """
    deeper = indent + "  "
    if _is_matrix(value):
        return _bracket("[]", _rows(value), deeper)
    if _is_short(value):
        return _text(value)
    if isinstance(value, dict):
        members = [f"{_text(key)}: {lay_out(member, deeper)}" for key, member in value.items()]
        return _bracket("{}", members, deeper)
    if isinstance(value, list | tuple):
        return _bracket("[]", [lay_out(member, deeper) for member in value], deeper)
    return _text(value)


def _is_group(value: object) -> bool:
    """Whether a value is a mapping or a list."""
    return isinstance(value, dict | list | tuple)


def _is_short(value: object) -> bool:
    """Whether a value is a list of plain values, or a mapping of plain values that fits on a line."""
    if isinstance(value, dict):
        return not any(map(_is_group, value.values())) and len(_text(value)) <= MAX_GROUP_LENGTH
    return isinstance(value, list | tuple) and not any(map(_is_group, value))


def _is_matrix(value: object) -> TypeGuard[Sequence[Sequence[float]]]:
    """Whether a value is a list of rows of numbers, all of one length."""
    if not (isinstance(value, list | tuple) and value and all(isinstance(row, list | tuple) and row for row in value)):
        return False
    same = len({len(row) for row in value}) == 1
    return same and all(isinstance(entry, float | int) for row in value for entry in row)


def _rows(matrix: Sequence[Sequence[float]]) -> list[str]:
    """Write each row of a matrix, with the decimal points aligned."""
    columns = [_align([_text(entry) for entry in column]) for column in zip(*matrix, strict=True)]
    return [f"[{' '.join(row).rstrip(', ')}]" for row in zip(*columns, strict=True)]


def _align(numbers: list[str]) -> list[str]:
    """Pad numbers and add commas, so that their decimal points and the next column are aligned."""
    ahead = [len(re.split(r"[.e]", number)[0]) for number in numbers]
    indented = [f"{' ' * (max(ahead) - width)}{number}," for number, width in zip(numbers, ahead, strict=True)]
    return [number.ljust(max(map(len, indented))) for number in indented]


def _bracket(brackets: str, members: list[str], indent: str) -> str:
    """Write members between brackets, one on each line; `indent` is the indent of the members."""
    separator = f",\n{indent}"
    return f"{brackets[0]}\n{indent}{separator.join(members)}\n{indent[:-2]}{brackets[1]}"


def _text(value: object) -> str:
    """Write a value as JSON on one line."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
