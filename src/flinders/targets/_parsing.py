r"""Numbers out of what other tools write: all of them finite, or an error that names the one that is not.

>>> keyed("a = 1.5\n# b = 2\nb=x", "settings.ini")
{'a': '1.5', 'b': 'x'}
>>> numbers({"a": "1.5", "b": "x"}, ["a", "b"], "settings.ini")
Traceback (most recent call last):
flinders.errors.DocumentError: settings.ini: b is 'x': need a finite number
"""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import DocumentError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats

SETTING: Final = re.compile(r"\s*set\s+(\w+)\s*=(.*)", re.IGNORECASE)
"""A line of what Betaflight's and INAV's command lines print."""


def decoded(content: bytes, source: str) -> str:
    """Read text.

    Raises
    ------
    DocumentError
        Where it is none.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"{source}: byte {error.start + 1} is not text in UTF-8: check the name") from None


def keyed(text: str, source: str, separator: str = "=") -> dict[str, str]:
    """Read lines of key and value; those that begin with ``#`` or ``;`` and those without a separator say nothing.

    Raises
    ------
    DocumentError
        Where a key stands twice with two values.
    """
    pairs: dict[str, str] = {}
    for line in text.splitlines():
        key, between, value = line.partition(separator)
        key, value = key.strip(), value.split("#")[0].strip()
        if not between or key.startswith(("#", ";")):
            continue
        if pairs.setdefault(key, value) != value:
            raise DocumentError(f"{source}: {key} is {pairs[key]} and again {value}: keep one of them")
    return pairs


def loaded(content: bytes, source: str) -> dict[str, object]:
    """Read a JSON object.

    Raises
    ------
    DocumentError
        Where it is none.
    """
    try:
        fields = json.loads(decoded(content, source))
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{source}: is no JSON: {error}") from None
    if not isinstance(fields, dict):
        raise DocumentError(f"{source}: is no JSON object: check the name")
    return fields


def numbers(values: Mapping[str, object], names: Sequence[str], source: str) -> Floats:
    """(N,) the numbers of these names.

    Raises
    ------
    DocumentError
        For names that are missing, and for what is no finite number.
    """
    missing = [name for name in names if name not in values]
    if missing:
        raise DocumentError(f"{source}: no {', '.join(missing)}: need {names[0]} to {names[-1]}, all {len(names)}")
    return np.array([_number(values[name], name, source) for name in names])


def listed(values: Mapping[str, object], name: str, length: int, source: str) -> Floats:
    """(length,) a list of numbers.

    Raises
    ------
    DocumentError
        For one that is missing, or has another length, or holds what is no finite number.
    """
    entries = values.get(name)
    if not isinstance(entries, list) or len(entries) != length:
        raise DocumentError(f"{source}: {name} is {_short(entries)}: need a list of {length} numbers")
    return np.array([_number(value, f"{name}[{place}]", source) for place, value in enumerate(entries)])


def settings(content: bytes, source: str, names: Sequence[str]) -> dict[str, str]:
    r"""Read ``set NAME = VALUE`` out of what a command line printed: of these names, those that are there.

    Raises
    ------
    DocumentError
        For what is no text, or a name with two values.

    Examples
    --------
    >>> settings(b"# dump\nset magzero_x = -7\nset p_roll = 45\n", "dump.txt", ["magzero_x", "magzero_y"])
    {'magzero_x': '-7'}
    """
    matches = map(SETTING.fullmatch, decoded(content, source).splitlines())
    lines = [f"{line[1].lower()}={line[2]}" for line in matches if line and line[1].lower() in names]
    return keyed("\n".join(lines), source)


def counts(
    words: Mapping[str, object], names: Sequence[str], source: str, *, lowest: int = -(2**15), highest: int = 2**15 - 1
) -> tuple[int, ...]:
    """Read whole counts.

    Raises
    ------
    DocumentError
        For names that are missing, fractions, and numbers beyond what the target takes.

    Examples
    --------
    >>> counts({"magzero_x": "-7"}, ["magzero_x"], "dump.txt")
    (-7,)
    """
    values = numbers(words, names, source)
    for name, value in zip(names, values, strict=True):
        if not (value.is_integer() and lowest <= value <= highest):
            raise DocumentError(f"{source}: {name} is {words[name]}: need a whole number, {lowest} to {highest}")
    return tuple(int(value) for value in values)


def _number(value: object, name: str, source: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise DocumentError(f"{source}: {name} is {_short(value)}: need a finite number")
    return number


def _short(value: object) -> str:
    text = repr(value)
    return "missing" if value is None else text if len(text) <= 40 else f"{text[:37]}..."
