"""One-line repr of dataclasses with many fields: arrays by shape, numbers to four digits, without defaults.

>>> from dataclasses import dataclass
>>> @dataclass(repr=False)
... class Track(ShortRepr):
...     field: np.ndarray
...     offset: np.ndarray
...     noise: float = 0.0
...     outliers: tuple[int, ...] = ()
>>> Track(np.zeros((3000, 3)), np.array([1.0, 2.0, 3.0]), noise=0.123456)
Track(field=array of 3,000 × 3, offset=[1, 2, 3], noise=0.1235)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, Final, cast

import numpy as np

from flinders.arrays import four_digits

MAX_ENTRIES: Final = 9
"""Largest array, in entries, whose entries are written."""
MAX_LETTERS: Final = 80
"""Longest text of a field in characters; a longer value is written as its type or length."""


class ShortRepr:
    """Base of dataclasses with ``repr=False`` whose repr is one line."""

    __slots__ = ()

    def __repr__(self) -> str:
        known = ((field, getattr(self, field.name)) for field in fields(cast("Any", self)))
        shown = (f"{field.name}={short_text(value)}" for field, value in known if not _is_default(field, value))
        return f"{type(self).__name__}({', '.join(shown)})"


def short_text(value: object) -> str:
    """Short text of a value.

    >>> short_text(np.zeros((2, 3))), short_text({"step": 0.15200001}), short_text([4] * 99)
    ('[[0, 0, 0], [0, 0, 0]]', "{'step': 0.152}", '99 entries')
    """
    if isinstance(value, np.ndarray):
        return _array_text(value)
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return _shorten("{" + ", ".join(f"{name!r}: {short_text(each)}" for name, each in value.items()) + "}", value)
    if type(value) in {list, tuple}:
        parts = [short_text(each) for each in cast("list[object]", value)]
        return _shorten(f"({', '.join(parts)}{',' * (len(parts) == 1)})", value)
    return _shorten(repr(value), value)


def _shorten(text: str, value: object) -> str:
    """Return `text` if it is short enough, else the length or the type of the value."""
    if len(text) <= MAX_LETTERS and "\n" not in text:
        return text
    return (
        f"{len(cast('Any', value)):,} entries"
        if isinstance(value, Mapping | list | tuple)
        else f"{_type_name(value)}(…)"
    )


def _type_name(value: object) -> str:
    return type(value).__name__


def _array_text(array: np.ndarray[Any, Any]) -> str:
    """Entries of a small array of numbers, or the shape of a larger one."""
    if array.size > MAX_ENTRIES or array.dtype.kind not in "iufb" or array.ndim > 2:
        return f"array of {' × '.join(f'{length:,}' for length in array.shape)}"
    return f"[{', '.join(map(four_digits, array))}]" if array.ndim == 2 else four_digits(np.atleast_1d(array))


def _is_default(field: Field[Any], value: object) -> bool:
    """Whether the value of a field is its default."""
    if field.default_factory is not MISSING:
        return repr(value) == repr(field.default_factory())
    return field.default is not MISSING and (value is field.default or repr(value) == repr(field.default))
