"""Where the readings lie, cell by cell: a picture of the recording that stays small and adds up.

Raw space is cut into cubes. For each cube that holds readings, `Cloud` keeps how many, their sum
and the first and last time one fell into it: enough to draw the recording, to see which
directions it covered and to weigh a fit, however long it was.

>>> a = Cloud.of([[1.0, 2.0, 3.0], [1.2, 2.1, 3.3], [40.0, 2.0, 3.0]], side=4.0)
>>> len(a), a.counts, a.means[0]
(2, array([2., 1.]), array([1.1 , 2.05, 3.15]))
>>> b = Cloud.of([[1.0, 2.0, 3.0]], side=8.0)
>>> (a + b).side, (a + b).counts
(8.0, array([3., 1.]))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flinders.arrays import Floats, column, table

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

MAX_CELLS: Final = 4096
"""More occupied cells than this, and cells double in size; a sphere of radius R in cells of R/12 has about 2,700."""

SMALLEST_SIDE: Final = 2.0**-40
"""Of the largest reading: finer cells hold nothing but rounding."""

LARGEST: Final = 1e15
"""As `FL_LARGEST` of the engine, which refuses larger readings."""

LOOKED_AT: Final = 512
"""Readings that tell how large cells shall be."""

_BITS: Final = 21
_REACH: Final = 1 << (_BITS - 1)
_DENSE: Final = 1 << 17


_Columns: TypeAlias = tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Counts, sums and time extent of the readings in each occupied cell."""

    side: float  #: length of a cell's edges: a power of two in the unit of the readings, so that cells nest
    keys: NDArray[np.int64]  #: (K,): the cells, ascending: three 21-bit indices packed into one number
    counts: Floats  #: (K,): readings in each
    sums: Floats  #: (K, 3): their sum
    first: Floats  #: (K,), s: time of the first reading in each; NaN without time
    last: Floats  #: (K,), s: time of the last one

    @classmethod
    def empty(cls) -> Self:
        """No readings: the identity of ``+``."""
        none = np.empty(0)
        return cls(0.0, np.empty(0, np.int64), none, np.empty((0, 3)), none, none)

    @classmethod
    def of(cls, field: ArrayLike, *, time: ArrayLike | None = None, side: float | None = None) -> Self:
        """Sort readings into cells.

        Raises `ArrayError` for a wrong shape or values that are not finite.

        Parameters
        ----------
        field : (N, 3) array-like
            Raw readings.
        time : (N,) array-like, s, optional
            When each was taken, ascending.
        side : float, optional
            Edge of a cell; by default `natural_side` of these readings.
        """
        readings = table(field)
        times = None if time is None else column(time, len(readings), "time")
        if not len(readings):
            return cls.empty()
        side = natural_side(readings) if side is None else side
        return cls(side, *_sort_in(readings, times, side))._bounded()

    def __len__(self) -> int:
        return len(self.keys)

    def __add__(self, other: Cloud) -> Self:
        if not len(other):
            return self
        if not len(self):
            return type(self)(other.side, *other._columns)
        side = max(self.side, other.side)
        a, b = self._coarsened(side), other._coarsened(side)
        keys, counts, sums, first, last = (np.concatenate(pair) for pair in zip(a._columns, b._columns, strict=True))
        return type(self)(side, *_gathered(keys, counts, sums, first, last))._bounded()

    def __mul__(self, factor: float) -> Self:
        """Weigh all readings alike."""
        return replace(self, counts=self.counts * factor, sums=self.sums * factor)

    @property
    def means(self) -> Floats:
        """(K, 3) mean reading of each cell."""
        return self.sums / self.counts[:, np.newaxis]

    @property
    def _columns(self) -> _Columns:
        """All but the side, in the order of `_Columns`."""
        return self.keys, self.counts, self.sums, self.first, self.last

    def _bounded(self) -> Self:
        """The same in as few cells as are allowed."""
        cloud = self
        while len(cloud) > MAX_CELLS:
            cloud = cloud._coarsened(2.0 * cloud.side)
        return cloud

    def _coarsened(self, side: float) -> Self:
        """The same readings in larger cells; `side` is a power of two times the present one."""
        if side == self.side:
            return self
        halvings = int(np.round(np.log2(side / self.side)))
        keys = _pack((_unpack(self.keys) - _REACH >> min(halvings, _BITS)) + _REACH)
        return type(self)(side, *_gathered(keys, *self._columns[1:]))

    def __repr__(self) -> str:
        return f"Cloud({self.counts.sum():g} readings in {len(self)} cells of {self.side:g})"


def natural_side(field: Floats) -> float:
    """The power of two nearest to a twelfth of the median distance from the middle of a cloud.

    Looks at `LOOKED_AT` readings spread over the recording; a few stray ones do not move it.
    """
    some = field[:: max(1, len(field) // LOOKED_AT)]
    largest = float(np.abs(some).max())
    # No magnetometer reads what squares badly: any side will do.
    if not SMALLEST_SIDE < largest < LARGEST:
        return 1.0
    centre = some.mean(axis=0)
    offsets = some - centre
    apart = np.sort(np.sqrt(np.einsum("ij,ij->i", offsets, offsets)))
    radius = float(apart[(len(apart) - 1) // 2] + apart[len(apart) // 2]) / 2.0  # np.median loads numpy.ma
    return float(2.0 ** np.round(np.log2(max(radius, SMALLEST_SIDE * largest) / 12.0)))


def _indices(axes: Floats, side: float) -> Floats:
    """(3, m) cell indices of (3, m) readings, whole numbers counted from −`_REACH`; what lies beyond, at the edge."""
    indices: Floats = np.multiply(axes, 1.0 / side, order="C")
    indices += _REACH
    np.floor(indices, out=indices)
    return np.clip(indices, 0.0, 2.0 * _REACH - 1.0, out=indices)


def _sort_in(readings: Floats, time: Floats | None, side: float) -> _Columns:
    """Columns of one block: keys, counts, sums, first, last."""
    keys, place, bins = _occupied(_indices(readings.T, side))
    size = int(bins[-1]) + 1
    counts: Floats = np.bincount(place, minlength=size)[bins].astype(float)
    sums: Floats = np.stack([np.bincount(place, weights=axis, minlength=size)[bins] for axis in readings.T], axis=1)
    if time is None:
        unknown: Floats = np.full(len(keys), np.nan)
        return keys, counts, sums, unknown, unknown
    first: Floats = np.empty(size)
    last: Floats = np.empty(size)
    first[place[::-1]] = time[::-1]
    last[place] = time
    return keys, counts, sums, first[bins], last[bins]


def _occupied(indices: Floats) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]]:
    """(K,) keys of the cells that (3, m) indices name, ascending; (m,) a bin for each; (K,) which bin a cell has."""
    # Cells of a box around them all are marked one by one where the box is small: no sorting. Where it is larger than
    # the readings are many, the bins are those in use, numbered anew.
    low = indices.min(axis=1).astype(np.int64)
    deep, wide, high = (indices.max(axis=1).astype(np.int64) - low + 1).tolist()
    if deep * wide * high > _DENSE:
        keys, inverse = np.unique(_pack(indices.astype(np.int64)), return_inverse=True)
        return keys, inverse, np.arange(len(keys))
    strides = np.array([wide * high, high, 1.0])
    flat = (strides @ indices - strides @ low).astype(np.intp)  # whole numbers below 2⁵³: exact
    marked = np.zeros(deep * wide * high, dtype=bool)
    marked[flat] = True
    cells = np.flatnonzero(marked)
    keys = _pack(np.stack([cells // (wide * high), cells // high % wide, cells % high]) + low[:, np.newaxis])
    if len(marked) <= len(flat):
        return keys, flat, cells
    rank = np.empty(len(marked), dtype=np.intp)
    rank[cells] = np.arange(len(cells))
    return keys, rank[flat], rank[cells]


def _gathered(keys: NDArray[np.int64], counts: Floats, sums: Floats, first: Floats, last: Floats) -> _Columns:
    """Add up rows that have the same key."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    is_new = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    place = np.empty(len(keys), dtype=np.intp)
    place[order] = np.cumsum(is_new) - 1
    keys = ordered[is_new]
    size = len(keys)
    added: Floats = np.stack([np.bincount(place, weights=axis, minlength=size) for axis in sums.T], axis=1)
    earliest, latest = np.full((2, size), np.nan)
    np.fmin.at(earliest, place, first)
    np.fmax.at(latest, place, last)
    weights = np.asarray(np.bincount(place, weights=counts, minlength=size), float)
    return keys, weights, added, earliest, latest


def _pack(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m,) keys of (3, m) cell indices, which count from −`_REACH`."""
    packed: NDArray[np.int64] = (indices[0] << 2 * _BITS) | (indices[1] << _BITS) | indices[2]
    return packed


def _unpack(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3, m) cell indices of (m,) keys."""
    mask = (1 << _BITS) - 1
    return np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask])
