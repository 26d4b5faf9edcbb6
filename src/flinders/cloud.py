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

_BITS: Final = 21
_REACH: Final = 1 << (_BITS - 1)
_DENSE: Final = 1 << 17


_Columns: TypeAlias = tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Counts, sums and time extent of the readings in each occupied cell.

    Attributes
    ----------
    side : float
        Length of a cell's edges: a power of two in the unit of the readings, so that cells nest.
    keys : (K,) int
        The cells, ascending: three 21-bit indices packed into one number.
    counts : (K,) float
        Readings in each.
    sums : (K, 3) float
        Their sum.
    first, last : (K,) float, s
        Time of the first and the last reading in each; NaN where no time was given.
    """

    side: float
    keys: NDArray[np.int64]
    counts: Floats
    sums: Floats
    first: Floats
    last: Floats

    @classmethod
    def empty(cls) -> Self:
        """No readings: the identity of ``+``."""
        none = np.empty(0)
        return cls(0.0, np.empty(0, np.int64), none, np.empty((0, 3)), none, none)

    @classmethod
    def of(cls, field: ArrayLike, *, time: ArrayLike | None = None, side: float | None = None) -> Self:
        """Sort readings into cells.

        Parameters
        ----------
        field : (N, 3) array-like
            Raw readings.
        time : (N,) array-like, s, optional
            When each was taken, ascending.
        side : float, optional
            Edge of a cell; by default `natural_side` of these readings.

        Raises
        ------
        ArrayError
            For a wrong shape or values that are not finite.
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
        return self.keys, self.counts, self.sums, self.first, self.last

    def _bounded(self) -> Self:
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

    Looks at 512 readings spread over the recording; a few stray ones do not move it.
    """
    some = field[:: max(1, len(field) // 512)]
    largest = float(np.abs(some).max())
    # No magnetometer reads what squares badly: any side will do.
    if not SMALLEST_SIDE < largest < 1.0 / SMALLEST_SIDE:
        return 1.0
    centre = some.mean(axis=0)
    offsets = some - centre
    radius = float(np.median(np.sqrt(np.einsum("ij,ij->i", offsets, offsets))))
    return float(2.0 ** np.round(np.log2(max(radius, SMALLEST_SIDE * largest) / 12.0)))


def keys_of(readings: Floats, side: float) -> NDArray[np.int64]:
    """(N,) keys of the cells that (N, 3) readings fall into."""
    return _pack(_indices(readings.T, side))


def _indices(axes: Floats, side: float) -> NDArray[np.int64]:
    """(3, m) cell indices of (3, m) readings, counted from −`_REACH`."""
    places = axes * (1.0 / side) + _REACH
    if places.min() < 0.0 or places.max() >= 2 * _REACH:
        np.clip(places, 0, 2 * _REACH - 1, out=places)
    indices: NDArray[np.int64] = places.astype(np.int64)  # cutting the fraction off is the floor of what is positive
    return indices


def _sort_in(readings: Floats, time: Floats | None, side: float) -> _Columns:
    """Columns of one block: keys, counts, sums, first, last."""
    axes = np.ascontiguousarray(readings.T)
    indices = _indices(axes, side)
    low = indices.min(axis=1)
    extent = indices.max(axis=1) - low + 1
    if int(extent[0]) * int(extent[1]) * int(extent[2]) <= _DENSE:
        size, high, middle = int(extent.prod()), int(extent[1] * extent[2]), int(extent[2])
        flat = indices[0] * high
        flat += indices[1] * middle
        flat += indices[2]
        flat -= int(low @ (high, middle, 1))
        found = np.bincount(flat, minlength=size)
        cells = np.flatnonzero(found)
        keys = _pack(np.stack([cells // high, cells // middle % extent[1], cells % middle]) + low[:, np.newaxis])
    else:
        keys, flat, found = np.unique(_pack(indices), return_inverse=True, return_counts=True)
        size, cells = len(keys), np.arange(len(keys))
    counts: Floats = found[cells].astype(float)
    sums: Floats = np.stack([np.bincount(flat, weights=axis, minlength=size)[cells] for axis in axes], axis=1)
    if time is None:
        unknown: Floats = np.full(len(cells), np.nan)
        return keys, counts, sums, unknown, unknown
    first: Floats = np.empty(size)
    last: Floats = np.empty(size)
    first[flat[::-1]] = time[::-1]
    last[flat] = time
    return keys, counts, sums, first[cells], last[cells]


def _gathered(keys: NDArray[np.int64], counts: Floats, sums: Floats, first: Floats, last: Floats) -> _Columns:
    """Add up rows that have the same key."""
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    with np.errstate(over="ignore"):  # numbers that large are refused, but not here
        added = np.add.reduceat(sums[order], starts, axis=0)
    return (
        keys[starts],
        np.add.reduceat(counts[order], starts),
        added,
        np.fmin.reduceat(first[order], starts),
        np.fmax.reduceat(last[order], starts),
    )


def _pack(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m,) keys of (3, m) cell indices, which count from −`_REACH`."""
    packed: NDArray[np.int64] = (indices[0] << 2 * _BITS) | (indices[1] << _BITS) | indices[2]
    return packed


def _unpack(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3, m) cell indices of (m,) keys."""
    mask = (1 << _BITS) - 1
    return np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask])
