"""Checks of arrays from outside: float64 of a known shape, or an error that names the shape or the row.

>>> check_vectors([[1, 2, 3], [4, 5, 6]]).shape
(2, 3)
>>> check_vectors([[1, 2], [3, 4]])
Traceback (most recent call last):
flinders.errors.ArrayError: field has shape (2, 2): need (..., 3), one x, y, z triple a reading
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flinders.errors import ArrayError, UsageError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Floats: TypeAlias = NDArray[np.floating[Any]]
"""An array of float64 (NumPy's types of linear algebra say only "floating").

Docstrings state shape and unit of each array."""

ENTRY_MESSAGES: Final = (
    (str | bytes, "text ('{first}'): need real numbers; convert it to float"),
    (type(None), "None for missing values: need real numbers; write NaN instead"),
    (int, "a number of more than 64 bits ({first}), which no sensor reads: check the column"),
    (dict, "records: need columns of numbers; make a data frame of them"),
    (list | tuple | np.ndarray, "{count:,} arrays: need one of numbers; stack them, as numpy.stack({name}) does"),
)
"""Types of array entries that are not real numbers, and the message for each."""

MAX_PYTHON_ENTRIES: Final = 9
"""Largest array, in entries, for which Python is faster than NumPy."""


def to_floats(values: ArrayLike, name: str = "values") -> Floats:
    """Convert anything array-like to float64, without a copy if it is float64 already; masked values become NaN.

    Raises `ArrayError` for text, ragged lists, complex numbers, dates and objects.

    >>> to_floats(["1.5", "2.5"], "field")
    Traceback (most recent call last):
    flinders.errors.ArrayError: field holds text ('1.5'): need real numbers; convert it to float
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        array = np.asarray(values)
    except ValueError as error:
        what = "has rows of different lengths" if "inhomogeneous" in str(error) else f"is not an array: {error}"
        raise ArrayError(f"{name} {what}: need three numbers in each row") from None
    if array.dtype.kind not in "fiub":
        raise ArrayError(f"{name} holds {_entry_message(array, name)}")
    return array.astype(np.float64, copy=False)


def _entry_message(array: NDArray[Any], name: str) -> str:
    """Message about entries that are not real numbers: their kind, and the remedy."""
    if array.dtype.kind not in "OUS":
        return f"{array.dtype.name}: need real numbers"
    first = next((entry for entry in array.flat if not _is_number(entry)), None)
    known = (words for kinds, words in ENTRY_MESSAGES if isinstance(first, kinds))
    words = next(known, f"{type(first).__name__} objects: need real numbers; convert them to float")
    return words.format(first=first, count=len(array) if array.ndim else 1, name=name)


def _is_number(entry: object) -> bool:
    """Whether an entry of an array of objects is a number that fits into 64 bits."""
    return isinstance(entry, float) or (isinstance(entry, int) and abs(entry) < 2**63)


def check_vectors(values: ArrayLike, name: str = "field", *, finite: bool = True) -> Floats:
    """Check an array of (..., 3) numbers, which must be finite unless `finite` is False.

    Raises `ArrayError` with the shape of the array, or the first row that is not finite.
    """
    array = to_floats(values, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        suggestion = _shape_suggestion(array, name)
        raise ArrayError(f"{name} has shape {array.shape}: need (..., 3), one x, y, z triple a reading{suggestion}")
    if finite:
        refuse_nonfinite(array, name)
    return array


def _shape_suggestion(array: Floats, name: str) -> str:
    """Suggestion for an array of another shape; empty if there is none."""
    if array.ndim == 2 and array.shape[0] == 3:
        return f"; transposed? give {name}.T"
    if array.ndim == 1 and array.size % 3 == 0 and array.size:
        return f"; one triple after the other? give {name}.reshape(-1, 3)"
    return ""


def check_table(values: ArrayLike, name: str = "field", *, finite: bool = True) -> Floats:
    """Check an (N, 3) array; a single triple becomes one row.

    Raises `ArrayError` as `check_vectors`, and for arrays of more than two dimensions.
    """
    array = check_vectors(values, name, finite=finite)
    if array.ndim == 1:
        return array[np.newaxis]
    if array.ndim != 2:
        raise ArrayError(f"{name} has shape {array.shape}: need (N, 3), one row a reading")
    return array


def check_triple(values: ArrayLike, name: str = "offset") -> Floats:
    """Check three finite numbers.

    Raises `ArrayError` for another shape, or values that are not finite.
    """
    array = to_floats(values, name)
    if array.shape != (3,):
        raise ArrayError(f"{name} has shape {array.shape}: need (3,)")
    refuse_nonfinite(array, name)
    return array


def read_only_copy(array: Floats) -> Floats:
    """Read-only float64 copy of an array."""
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy


class Value:
    """Base of frozen dataclasses with arrays: compared and hashed by value, and copied with read-only arrays.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False)
    ... class Offset(Value):
    ...     field: Floats
    >>> Offset(np.zeros(3)) == Offset(np.zeros(3)), len({Offset(np.zeros(3)), Offset(np.zeros(3)), Offset(np.ones(3))})
    (True, 2)
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return self._numbers() == other._numbers() if isinstance(other, type(self)) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._numbers())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the constructor, which makes arrays read-only."""
        return type(self), tuple(getattr(self, field.name) for field in fields(cast("Any", self)))

    def _numbers(self) -> tuple[object, ...]:
        """Values of all fields, with arrays as tuples."""
        return tuple(tuple(each.flat) if isinstance(each, np.ndarray) else each for each in self.__reduce__()[1])


def check_column(values: ArrayLike, rows: int, name: str) -> Floats:
    """Check an array of `rows` values.

    Raises `ArrayError` with the shape of the array.
    """
    array = to_floats(values, name)
    if array.shape != (rows,):
        raise ArrayError(f"{name} has shape {array.shape}: need ({rows},), one value a reading")
    return array


def check_matrix(values: ArrayLike, name: str = "matrix", size: int = 3) -> Floats:
    """Check a finite (size, size) array.

    Raises `ArrayError` with the shape, or the first row that is not finite.
    """
    array = to_floats(values, name)
    if array.shape != (size, size):
        raise ArrayError(f"{name} has shape {array.shape}: need ({size}, {size})")
    refuse_nonfinite(array, name)
    return array


def check_positive(value: ArrayLike | float | None, name: str) -> float:
    """Check one positive finite number."""
    if isinstance(value, float) and 0.0 < value < math.inf:
        return float(value)
    number = to_floats(0.0 if value is None else value, name)
    if number.shape != () or not (np.isfinite(number) and number > 0):
        raise UsageError(f"{name} is {number}: need one positive number")
    return float(number)


def refuse_nonfinite(array: Floats, name: str) -> None:
    """Raise `ArrayError` naming the first row that is not finite."""
    if array.size <= MAX_PYTHON_ENTRIES and all(map(math.isfinite, array.ravel().tolist())):
        return
    is_finite = np.isfinite(array)
    if is_finite.all():
        return
    gaps = np.argwhere(~is_finite)
    row = tuple(int(index) for index in gaps[0])
    raise ArrayError(
        f"{name} is {array[row]} at index {row} ({len(gaps):,} such values): need finite numbers; leave those rows out"
    )


def four_digits(row: Floats) -> str:
    """Write a row of numbers with four digits each.

    >>> four_digits(np.array([-0.0, 31.0723]))
    '[0, 31.07]'
    """
    return "[" + ", ".join(f"{entry + 0.0:.4g}" for entry in row) + "]"


def true_runs(is_in: ArrayLike) -> list[slice]:
    """Slices of consecutive true values in (N,) booleans.

    >>> true_runs([False, True, True, False, True])
    [slice(1, 3, None), slice(4, 5, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(is_in, dtype=int), [0]])))
    return [slice(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]
