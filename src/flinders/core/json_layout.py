"""JSON laid out for people: a matrix has a line for each row, a group of plain values one line where it fits."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final, TypeGuard

if TYPE_CHECKING:
    from collections.abc import Sequence

WIDTH: Final = 110
"""Characters of text on a line, up to which a group of plain values stays on one line."""


def lay_out(value: object, indent: str = "") -> str:
    """Write JSON for people: short groups on one line, a matrix one row a line, the rest indented.

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
    """Whether a value has members."""
    return isinstance(value, dict | list | tuple)


def _is_short(value: object) -> bool:
    """A list of plain values, or a mapping of some that fits on a line."""
    if isinstance(value, dict):
        return not any(map(_is_group, value.values())) and len(_text(value)) <= WIDTH
    return isinstance(value, list | tuple) and not any(map(_is_group, value))


def _is_matrix(value: object) -> TypeGuard[Sequence[Sequence[float]]]:
    """Rows of numbers, all of one length."""
    if not (isinstance(value, list | tuple) and value and all(isinstance(row, list | tuple) and row for row in value)):
        return False
    same = len({len(row) for row in value}) == 1
    return same and all(isinstance(entry, float | int) for row in value for entry in row)


def _rows(matrix: Sequence[Sequence[float]]) -> list[str]:
    """Write each row of a matrix, with decimal points one under the other."""
    columns = [_aligned([_text(entry) for entry in column]) for column in zip(*matrix, strict=True)]
    return [f"[{' '.join(row).rstrip(', ')}]" for row in zip(*columns, strict=True)]


def _aligned(numbers: list[str]) -> list[str]:
    """Put a comma behind each number and spaces around it, so that decimal points and next columns line up."""
    ahead = [len(re.split(r"[.e]", number)[0]) for number in numbers]
    indented = [f"{' ' * (max(ahead) - width)}{number}," for number, width in zip(numbers, ahead, strict=True)]
    return [number.ljust(max(map(len, indented))) for number in indented]


def _bracket(brackets: str, members: list[str], indent: str) -> str:
    """Put members one a line between brackets; `indent` is that of the members."""
    separator = f",\n{indent}"
    return f"{brackets[0]}\n{indent}{separator.join(members)}\n{indent[:-2]}{brackets[1]}"


def _text(value: object) -> str:
    """Write a value as JSON on one line."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
