"""Which places the readings of many units take, in raw space and on the sphere.

Cells of raw space tell which readings count where a clump of them shall not (`flinders.estimators.readings`), and their
means tell which directions were seen (`flinders.coverage`). Both come from one sort of whole numbers: a reading's cell,
then its rank in the order in which `Readings.spread_out` draws, then its place.

>>> rng = np.random.default_rng(1)
>>> readings = rng.normal(size=(2, 3, 300))
>>> count = np.full(2, 300)
>>> side = natural_sides(readings, count)
>>> from flinders.cloud import natural_side
>>> [float(side[0]), natural_side(readings[0].T)]
[0.125, 0.125]
>>> sorted_in = Sorted.of(readings, count, side)
>>> int(sorted_in.kept[0].sum()) <= 300, sorted_in.order.shape
(True, (2, 300))
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.cloud import LOOKED_AT, SMALLEST_SIDE
from flinders.coverage import CELLS, cells_of, fibonacci
from flinders.estimators.readings import PER_CELL
from flinders.estimators.robust import SEED
from flinders.stacked import hung
from flinders.stacked.algebra import Array, counted_in, like, namespace, picked, put
from flinders.verdict import HOLE_DEG

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats

LARGEST_KEY: Final = 2**38
"""Cells of raw space within a unit's extent, with which a key and two places fit 63 bits."""

_CELLS: Final = len(CELLS)


@lru_cache(maxsize=256)
def ranks(count: int) -> NDArray[np.int64]:
    """(count,) int: the rank of each reading in the order in which `Readings.spread_out` draws so many."""
    order = np.random.default_rng(SEED).permutation(count)
    found = np.empty(count, np.int64)
    found[order] = np.arange(count)
    found.flags.writeable = False
    return found


def natural_sides(readings: Array, count: Array) -> Array:
    """(u,) edges of the cells of (u, 3, N) readings, as `flinders.cloud.natural_side`; NaN where there is none."""
    xp = namespace(readings)
    if int(xp.min(count)) == readings.shape[2] < 2 * LOOKED_AT:
        looked_at, many = None, count
        local = readings - xp.mean(readings, axis=2, keepdims=True)
        largest = xp.max(xp.abs(readings), axis=(1, 2))
    else:
        place = xp.arange(readings.shape[2])[None, :]
        looked_at = (place % xp.maximum(count // LOOKED_AT, 1)[:, None] == 0) & (place < count[:, None])
        some = xp.astype(looked_at, readings.dtype)
        many = xp.count_nonzero(looked_at, axis=1)
        mean = xp.sum(readings * some[:, None, :], axis=2) / xp.sum(some, axis=1, keepdims=True)
        local = readings - mean[:, :, None]
        largest = xp.max(xp.abs(readings) * some[:, None, :], axis=(1, 2))
    square = local[:, 0, :] ** 2 + local[:, 1, :] ** 2 + local[:, 2, :] ** 2
    square = square if looked_at is None else xp.where(looked_at, square, xp.inf)
    radius = xp.sqrt(medians(square, many, roots=True))
    power = xp.log2(xp.maximum(radius, SMALLEST_SIDE * largest) / 12.0)
    is_clear = xp.abs(power - xp.floor(power) - 0.5) > 1e-6
    return xp.where(is_clear, 2.0 ** xp.round(power), xp.nan)


def medians(values: Array, many: Array, *, roots: bool = False) -> Array:
    """(u,) medians of the smallest `many` of (u, N) values; with `roots` the squares of the medians of their roots."""
    xp = namespace(values)
    ascending = xp.sort(values, axis=1)
    pair = xp.stack([(many - 1) // 2, many // 2], axis=1)
    middle = picked(ascending, pair)
    return xp.mean(xp.sqrt(middle), axis=1) ** 2 if roots else xp.mean(middle, axis=1)


@dataclass(frozen=True, eq=False)
class Sorted:
    """Readings of U units sorted by their cells in raw space.

    Attributes
    ----------
    order : (U, N) int
        Which reading it is.
    begins : (U, N) bool
        It is the first of its cell.
    kept : (U, N) bool
        It is one of the few of its cell that count.
    there : (U, N) bool
        It is a reading, and not what fills the rows up.
    are_plain : (U,) bool
        The cells of the unit can be told apart.
    """

    order: Array
    begins: Array
    kept: Array
    there: Array
    are_plain: Array

    @classmethod
    def of(cls, readings: Array, count: Array, side: Array) -> Self:
        """Sort (U, 3, N) readings into cells with (U,) edges."""
        xp = namespace(readings)
        cells, plain = _flat_cells(readings, side)
        units, many = cells.shape
        bits = max(many - 1, 1).bit_length()
        place = xp.arange(many)[None, :]
        counts = np.asarray(count).tolist()
        rank = np.zeros((1 if len(set(counts)) == 1 else units, many), np.int64)
        for row, own in enumerate(counts[: len(rank)]):
            rank[row, :own] = ranks(own)
        cells = xp.where(place < count[:, None], cells, LARGEST_KEY)
        keys = xp.sort((cells << (2 * bits)) | (like(rank, readings) << bits) | place, axis=1)
        cell = keys >> (2 * bits)
        there = cell < LARGEST_KEY
        first = xp.ones((units, 1), dtype=xp.bool)
        begins = xp.concat([first, cell[:, 1:] != cell[:, :-1]], axis=1)
        early = xp.ones((units, min(PER_CELL, many)), dtype=xp.bool)
        kept = xp.concat([early, cell[:, PER_CELL:] != cell[:, :-PER_CELL]], axis=1) & there
        return cls(keys & ((1 << bits) - 1), begins, kept, there, plain)


def _flat_cells(readings: Array, side: Array) -> tuple[Array, Array]:
    """(U, N) int cells within each unit's extent, and (U,) whether they can be told apart."""
    xp = namespace(readings)
    plain = xp.isfinite(side)
    places = readings / xp.where(plain, side, 1.0)[:, None, None]
    plain = plain & (xp.max(xp.abs(places), axis=(1, 2)) < 2.0**20)
    index = xp.astype(xp.floor(xp.where(plain[:, None, None], places, 0.0)), xp.int64)
    index = index - xp.min(index, axis=2, keepdims=True)
    extent = xp.max(index, axis=2) + 1
    plain = plain & (xp.prod(xp.astype(extent, readings.dtype), axis=1) < LARGEST_KEY)
    flat = (index[:, 0, :] * extent[:, 1, None] + index[:, 1, :]) * extent[:, 2, None] + index[:, 2, :]
    return xp.where(plain[:, None], flat, 0), plain


def _by_row(values: Array, order: Array) -> Iterator[Array]:
    """The x, y and z of (U, 3, N) values, (U, N) each, in an order of their readings."""
    xp = namespace(values)
    units, axes, many = values.shape
    flat = xp.reshape(values, (-1,))
    at = order + axes * many * xp.arange(units, device=order.device)[:, None]
    for axis in range(axes):
        yield xp.reshape(xp.take(flat, xp.reshape(at + many * axis, (-1,))), (units, many))


@dataclass(frozen=True, eq=False)
class Means:
    """The mean corrected readings of the cells of U units, all in one row.

    Attributes
    ----------
    directions : (K, 3)
        Of length one.
    counts : (K,)
        Readings in each cell; 0 for what fills rows up.
    units : (K,) int
        Which unit each belongs to, ascending.
    """

    directions: Array
    counts: Array
    units: Array

    @classmethod
    def of(cls, corrected: Array, places: Sorted) -> Self:
        """Add up (U, 3, N) corrected readings by cell."""
        xp = namespace(corrected)
        many = places.order.shape[1]
        begins = xp.reshape(places.begins, (-1,))
        (first,) = xp.nonzero(begins)
        cell = xp.cumulative_sum(xp.astype(begins, xp.int64)) - 1
        size = first.shape[0]
        x, y, z = (counted_in(cell, size, xp.reshape(part, (-1,))) for part in _by_row(corrected, places.order))
        length = xp.sqrt(x * x + y * y + z * z)  # rows of three, added up as such, would take as long as all the rest
        length = xp.where(length > 0.0, length, 1.0)
        end = xp.concat([first[1:], xp.asarray([begins.shape[0]], dtype=first.dtype, device=first.device)])
        counts = xp.where(xp.take(xp.reshape(places.there, (-1,)), first), end - first, 0)
        return cls(
            xp.stack([x / length, y / length, z / length], axis=1),
            xp.astype(counts, corrected.dtype),
            first // many,
        )

    def table(self, which: Array, units: int) -> tuple[Array, Array]:
        """Directions (K, 3, W) and counts (K, W) of those of U units that (K,) integers name, filled up with 0."""
        xp = namespace(self.directions)
        first = xp.searchsorted(self.units, xp.arange(units + 1))
        begin = xp.take(first, which)
        many = xp.take(first, which + 1) - begin
        place = xp.arange(int(xp.max(many)))[None, :]
        there = place < many[:, None]
        at = xp.reshape(begin[:, None] + xp.where(there, place, 0), (-1,))
        directions = xp.reshape(xp.take(self.directions, at, axis=0), (*there.shape, 3))
        counts = xp.where(there, xp.reshape(xp.take(self.counts, at), there.shape), 0.0)
        return xp.matrix_transpose(directions), counts


def covered(means: Means, units: int) -> tuple[Array, Array]:
    """(U, 100) readings by direction, and (U,) whether the largest hole is as large as to be told of."""
    xp = namespace(means.directions)
    cell = hung.cells_of(xp.matrix_transpose(means.directions)[None, :, :])[0, :]
    at = cell + _CELLS * means.units
    counts = xp.reshape(counted_in(at, units * _CELLS, means.counts), (units, _CELLS))
    reached = xp.astype(counts > 0.0, counts.dtype) @ like(_within_reach(), counts)
    (doubtful,) = xp.nonzero(~xp.all(reached > 0.0, axis=1))
    if not doubtful.shape[0]:
        return counts, xp.zeros((units,), dtype=xp.bool)
    return counts, _has_hole(means, doubtful, units)


@lru_cache(maxsize=1)
def _within_reach() -> Floats:
    """(100, 100) 1 where no direction in the first cell is so far from the middle of the second as to leave a hole."""
    everywhere = fibonacci(20_000)
    at = cells_of(everywhere)
    off = np.arccos(np.clip(everywhere @ CELLS.T, -1.0, 1.0))
    farthest = np.stack([off[at == cell].max(axis=0) for cell in range(_CELLS)])
    reach: Floats = (np.rad2deg(farthest) < HOLE_DEG - 3.0).astype(float)
    return reach


def _has_hole(means: Means, doubtful: Array, units: int) -> Array:
    """(U,) whether the largest hole is too large, looked at for those units where it may be."""
    xp = namespace(means.directions)
    directions, counts = means.table(doubtful, units)
    directions = xp.where(counts[:, None, :] > 0.0, directions, directions[:, :, :1])  # what fills rows up comes last
    nearest = xp.min(xp.max(like(CELLS, directions) @ directions, axis=2), axis=1)
    hole = xp.acos(xp.clip(nearest, -1.0, 1.0)) * (180.0 / np.pi) > HOLE_DEG
    return put(xp.zeros((units,), dtype=xp.bool), doubtful, hole)
