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
from typing import TYPE_CHECKING

import numpy as np

from flinders.errors import DocumentError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats


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
    found: dict[str, str] = {}
    for line in text.splitlines():
        key, between, value = line.partition(separator)
        key, value = key.strip(), value.split("#")[0].strip()
        if not between or key.startswith(("#", ";")):
            continue
        if found.setdefault(key, value) != value:
            raise DocumentError(f"{source}: {key} is {found[key]} and again {value}: keep one of them")
    return found


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
    found = values.get(name)
    if not isinstance(found, list) or len(found) != length:
        raise DocumentError(f"{source}: {name} is {_short(found)}: need a list of {length} numbers")
    return np.array([_number(value, f"{name}[{place}]", source) for place, value in enumerate(found)])


def chosen(there: Sequence[int], wanted: int | None, source: str, need: str) -> int:
    """Which of several compasses: the one that is wanted, or the only one.

    Raises
    ------
    DocumentError
        Where it is not there, or there are several; `need` names the parameters of one.

    Examples
    --------
    >>> chosen([1, 2], None, "vehicle.param", "COMPASS_OFS_X")
    Traceback (most recent call last):
    flinders.errors.DocumentError: vehicle.param: holds compass 1 and 2: say which one with --compass
    """
    if not there:
        raise DocumentError(f"{source}: holds no offsets of a compass: need {need}")
    held = " and ".join(map(str, there))
    if wanted is None and len(there) > 1:
        raise DocumentError(f"{source}: holds compass {held}: say which one with --compass")
    if wanted is not None and wanted not in there:
        raise DocumentError(f"{source}: holds compass {held} and not {wanted}: check --compass")
    return there[0] if wanted is None else wanted


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
