"""Counts of readings in cells of raw space: a compact picture of a recording that can be added to another one.

Raw space is divided into cubes. For each cube with readings, `Cloud` stores their number, their sum
and the times of the first and the last. This is enough to draw the recording, to compute the covered
directions and to weight a fit, regardless of the length of the recording.

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

from flinders.arrays import Floats, check_column, check_table

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

MAX_CELLS: Final = 4096
"""Largest number of occupied cells; with more, cells double in size. A sphere in cells of R/12 has about 2,700."""

MIN_SIDE_RATIO: Final = 2.0**-40
"""Smallest side of a cell, as a fraction of the largest reading. Smaller cells would separate only rounding errors."""

MAX_READING: Final = 1e15
"""Largest absolute reading that is accepted. The engine has the same limit (`FL_LARGEST`)."""

SIDE_SAMPLE: Final = 512
"""Number of readings from which the size of the cells is computed."""

_INDEX_BITS: Final = 21
_MAX_INDEX: Final = 1 << (_INDEX_BITS - 1)
_MAX_BOX_CELLS: Final = 1 << 17


_Columns: TypeAlias = tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Counts, sums and time extent of the readings in each occupied cell."""

    side: float  #: side of a cell: a power of two in the unit of the readings, so that cells nest
    keys: NDArray[np.int64]  #: (K,): keys of the cells, ascending; a key packs three indices of 21 bits
    counts: Floats  #: (K,): number of readings in each cell
    sums: Floats  #: (K, 3): sum of the readings in each cell
    first: Floats  #: (K,), s: time of the first reading in each cell; NaN without times
    last: Floats  #: (K,), s: time of the last reading in each cell

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
            Time of each reading, ascending.
        side : float, optional
            Side of a cell; by default `natural_side` of these readings.
        """
        readings = check_table(field)
        times = None if time is None else check_column(time, len(readings), "time")
        if not len(readings):
            return cls.empty()
        side = natural_side(readings) if side is None else side
        return cls(side, *_cell_columns(readings, times, side))._limit_cells()

    def __len__(self) -> int:
        return len(self.keys)

    def __add__(self, other: Cloud) -> Self:
        if not len(other):
            return self
        if not len(self):
            return type(self)(other.side, *other._columns)
        side = max(self.side, other.side)
        a, b = self._coarsen(side), other._coarsen(side)
        keys, counts, sums, first, last = (np.concatenate(pair) for pair in zip(a._columns, b._columns, strict=True))
        return type(self)(side, *_merge_rows(keys, counts, sums, first, last))._limit_cells()

    def __mul__(self, factor: float) -> Self:
        """Multiply the weight of all readings by `factor`."""
        return replace(self, counts=self.counts * factor, sums=self.sums * factor)

    @property
    def means(self) -> Floats:
        """(K, 3) mean reading of each cell."""
        return self.sums / self.counts[:, np.newaxis]

    @property
    def _columns(self) -> _Columns:
        """Columns of the cells, in the order of `_Columns`."""
        return self.keys, self.counts, self.sums, self.first, self.last

    def _limit_cells(self) -> Self:
        """Merge cells until at most `MAX_CELLS` remain."""
        cloud = self
        while len(cloud) > MAX_CELLS:
            cloud = cloud._coarsen(2.0 * cloud.side)
        return cloud

    def _coarsen(self, side: float) -> Self:
        """Merge cells into larger ones; `side` is a power of two times the present side."""
        if side == self.side:
            return self
        halvings = int(np.round(np.log2(side / self.side)))
        keys = _pack_indices((_unpack_keys(self.keys) - _MAX_INDEX >> min(halvings, _INDEX_BITS)) + _MAX_INDEX)
        return type(self)(side, *_merge_rows(keys, *self._columns[1:]))

    def __repr__(self) -> str:
        return f"Cloud({self.counts.sum():g} readings in {len(self)} cells of {self.side:g})"


def natural_side(field: Floats) -> float:
    """Side of cells: the power of two nearest to a twelfth of the median distance of the readings from their mean.

    Uses `SIDE_SAMPLE` readings spread over the recording; a few outliers do not change the result.
    """
    some = field[:: max(1, len(field) // SIDE_SAMPLE)]
    largest = float(np.abs(some).max())
    # Beyond these limits, where squares overflow or vanish, any side will do: no magnetometer gives such readings.
    if not MIN_SIDE_RATIO < largest < MAX_READING:
        return 1.0
    centre = some.mean(axis=0)
    offsets = some - centre
    apart = np.sort(np.sqrt(np.einsum("ij,ij->i", offsets, offsets)))
    radius = float(apart[(len(apart) - 1) // 2] + apart[len(apart) // 2]) / 2.0  # np.median loads numpy.ma
    return float(2.0 ** np.round(np.log2(max(radius, MIN_SIDE_RATIO * largest) / 12.0)))


def _cell_indices(axes: Floats, side: float) -> Floats:
    """(3, m) cell indices of (3, m) readings: integers from 0, which stands for −`_MAX_INDEX`.

    Readings outside the range of the indices are counted in the outermost cells.
    """
    indices: Floats = np.multiply(axes, 1.0 / side, order="C")
    indices += _MAX_INDEX
    np.floor(indices, out=indices)
    return np.clip(indices, 0.0, 2.0 * _MAX_INDEX - 1.0, out=indices)


def _cell_columns(readings: Floats, time: Floats | None, side: float) -> _Columns:
    """Columns of the cells of one block of readings."""
    keys, place, bins = _occupied_cells(_cell_indices(readings.T, side))
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


def _occupied_cells(indices: Floats) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]]:
    """(K,) keys of the occupied cells, ascending; (m,) bin of each reading; (K,) bin of each cell."""
    # Bins number the cells of the readings' bounding box if the box is small, since this needs no sorting. If the box
    # has more cells than there are readings, bins are the ranks of the occupied cells.
    low = indices.min(axis=1).astype(np.int64)
    deep, wide, high = (indices.max(axis=1).astype(np.int64) - low + 1).tolist()
    if deep * wide * high > _MAX_BOX_CELLS:
        keys, inverse = np.unique(_pack_indices(indices.astype(np.int64)), return_inverse=True)
        return keys, inverse, np.arange(len(keys))
    strides = np.array([wide * high, high, 1.0])
    flat = (strides @ indices - strides @ low).astype(np.intp)  # whole numbers below 2⁵³: exact
    marked = np.zeros(deep * wide * high, dtype=bool)
    marked[flat] = True
    cells = np.flatnonzero(marked)
    keys = _pack_indices(np.stack([cells // (wide * high), cells // high % wide, cells % high]) + low[:, np.newaxis])
    if len(marked) <= len(flat):
        return keys, flat, cells
    rank = np.empty(len(marked), dtype=np.intp)
    rank[cells] = np.arange(len(cells))
    return keys, rank[flat], rank[cells]


def _merge_rows(keys: NDArray[np.int64], counts: Floats, sums: Floats, first: Floats, last: Floats) -> _Columns:
    """Merge rows with the same key."""
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


def _pack_indices(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m,) keys of (3, m) cell indices; index 0 stands for −`_MAX_INDEX`."""
    packed: NDArray[np.int64] = (indices[0] << 2 * _INDEX_BITS) | (indices[1] << _INDEX_BITS) | indices[2]
    return packed


def _unpack_keys(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3, m) cell indices of (m,) keys."""
    mask = (1 << _INDEX_BITS) - 1
    return np.stack([keys >> 2 * _INDEX_BITS, keys >> _INDEX_BITS & mask, keys & mask])
