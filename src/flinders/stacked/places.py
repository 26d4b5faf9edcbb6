"""Which places the readings of many units take, in raw space and on the sphere.

Cells of raw space tell which readings count where a clump of them shall not (`flinders.estimators.data`), and their
means tell which directions were seen (`flinders.summary.coverage`). Both come from one sort of whole numbers: a
reading's cell, then its rank in the order in which `Readings.spread_out` draws, then its place.

>>> from flinders.stacked.algebra import with_ones
>>> rng = np.random.default_rng(1)
>>> readings = with_ones(rng.normal(size=(2, 3, 300)))
>>> count = np.full(2, 300)
>>> side = natural_sides(readings, count)
>>> from flinders.summary.cloud import natural_side
>>> [float(side[0]), natural_side(readings[0, :3].T)]
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

from flinders.estimators.data import PER_CELL
from flinders.estimators.robust import SEED
from flinders.findings import limit_of
from flinders.geometry.sphere import fibonacci
from flinders.stacked import hung
from flinders.stacked.algebra import (
    SHORTEST,
    Array,
    counted_in,
    like,
    moving,
    namespace,
    picked,
    squares,
    turned,
)
from flinders.summary.cloud import LOOKED_AT, SMALLEST_SIDE
from flinders.summary.coverage import CELLS, cells_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats

HOLE_DEG: Final = limit_of("coverage")
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
    """(u,) edges of the cells of (u, 4, N) readings, as `summary.cloud.natural_side`; NaN where there is none."""
    xp = namespace(readings)
    if int(xp.min(count)) == readings.shape[2] < 2 * LOOKED_AT:
        looked_at, many = None, count
        mean = xp.mean(readings[:, :3, :], axis=2)
        largest = xp.max(xp.abs(mean), axis=1)  # within a radius or two of the largest reading
    else:
        readings = readings[:, :3, :]
        place = xp.arange(readings.shape[2])[None, :]
        looked_at = (place % xp.maximum(count // LOOKED_AT, 1)[:, None] == 0) & (place < count[:, None])
        some = xp.astype(looked_at, readings.dtype)
        many = xp.count_nonzero(looked_at, axis=1)
        mean = xp.sum(readings * some[:, None, :], axis=2) / xp.sum(some, axis=1, keepdims=True)
        largest = xp.max(xp.abs(readings) * some[:, None, :], axis=(1, 2))
    square = squares(readings[:, :3, :] - mean[:, :, None] if looked_at is not None else _about(readings, mean))
    square = square if looked_at is None else xp.where(looked_at, square, xp.inf)
    radius = xp.sqrt(medians(square, many, roots=True))
    power = xp.log2(xp.maximum(radius, SMALLEST_SIDE * largest) / 12.0)
    is_clear = xp.abs(power - xp.floor(power) - 0.5) > 1e-6
    return xp.where(is_clear, 2.0 ** xp.round(power), xp.nan)


def _about(readings: Array, mean: Array) -> Array:
    """(u, 3, N) what (u, 4, N) readings are off (u, 3) means."""
    return turned(moving(namespace(mean).zeros((mean.shape[0], 1, 1)) + like(np.eye(3), mean), mean), readings)


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
    def of(cls, readings: Array, count: Array, side: Array, *, ranked: bool = True) -> Self:
        """Sort (U, 4, N) readings into cells with (U,) edges, and within them, if `ranked`, in the order of draws."""
        xp = namespace(readings)
        cells, plain = _flat_cells(readings, side)
        units, many = cells.shape
        bits = max(many - 1, 1).bit_length()
        place = xp.arange(many)[None, :]
        full = bool(xp.all(count == many))
        if not full:
            cells = xp.where(place < count[:, None], cells, LARGEST_KEY)
        within = place | (like(_ranks_of(np.asarray(count), many), readings) << bits) if ranked else place
        shift = 2 * bits if ranked else bits
        keys = xp.sort((cells << shift) | within, axis=1)
        cell = keys >> shift
        there = xp.ones((units, many), dtype=xp.bool) if full else cell < LARGEST_KEY
        first = xp.ones((units, 1), dtype=xp.bool)
        begins = xp.concat([first, cell[:, 1:] != cell[:, :-1]], axis=1)
        early = xp.ones((units, min(PER_CELL, many)), dtype=xp.bool)
        kept = xp.concat([early, cell[:, PER_CELL:] != cell[:, :-PER_CELL]], axis=1)
        return cls(keys & ((1 << bits) - 1), begins, kept if full else kept & there, there, plain)


def _ranks_of(counts: NDArray[np.int64], many: int) -> NDArray[np.int64]:
    """(1, N) ranks of the readings of units that have as many, else (U, N)."""
    rank = np.zeros((1 if (counts == counts[0]).all() else len(counts), many), np.int64)
    for row, own in zip(rank, counts.tolist(), strict=False):
        row[:own] = ranks(own)
    return rank


def _flat_cells(readings: Array, side: Array) -> tuple[Array, Array]:
    """(U, N) int cells within each unit's extent, and (U,) whether they can be told apart."""
    xp = namespace(readings)
    plain = xp.isfinite(side)
    scale = xp.where(plain, 1.0 / side, 0.0)[:, None, None] * like(np.eye(3, 4), readings)
    cells = xp.floor(turned(scale, readings))  # exact: edges are powers of two
    low, high = xp.min(cells, axis=2), xp.max(cells, axis=2)
    extent = high - low + 1.0
    plain = plain & (xp.max(xp.maximum(-low, high), axis=1) < 2.0**20) & (xp.prod(extent, axis=1) < LARGEST_KEY)
    weights = xp.stack([extent[:, 1] * extent[:, 2], extent[:, 2], xp.ones_like(extent[:, 0])], axis=1)
    weights = xp.where(plain[:, None], weights, 0.0)
    flat = turned(weights[:, None, :], cells)[:, 0, :]
    flat -= xp.sum(weights * low, axis=1)[:, None]
    return xp.astype(flat, xp.int64), plain


def _by_row(values: Array, order: Array) -> Iterator[Array]:
    """The x, y and z of (U, 3, N) values, (U N,) each, in an order of their readings."""
    xp = namespace(values)
    units, axes, many = values.shape
    at = xp.reshape(order + many * xp.arange(units, device=order.device)[:, None], (-1,))
    for axis in range(axes):
        yield xp.take(xp.reshape(values[:, axis, :], (-1,)), at)


@dataclass(frozen=True, eq=False)
class Means:
    """The mean corrected readings of the cells of U units, all in one row.

    Attributes
    ----------
    directions : (3, K)
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
        x, y, z = (counted_in(cell, size, part) for part in _by_row(corrected, places.order))
        shrink = 1.0 / xp.sqrt(x * x + y * y + z * z + SHORTEST)
        units = xp.arange(begins.shape[0] // many, device=first.device)
        end = xp.concat([first[1:], xp.asarray([begins.shape[0]], dtype=first.dtype, device=first.device)])
        counts = (end - first) * xp.astype(xp.take(xp.reshape(places.there, (-1,)), first), first.dtype)
        return cls(
            xp.stack([x * shrink, y * shrink, z * shrink]),
            xp.astype(counts, corrected.dtype),
            xp.repeat(units, xp.count_nonzero(places.begins, axis=1)),
        )

    def table(self, which: Array, units: int) -> tuple[Array, Array]:
        """Directions (K, 3, W) and counts (K, W) of those of U units that (K,) integers name, filled up with 0."""
        xp = namespace(self.directions)
        first = xp.searchsorted(self.units, xp.arange(units + 1))
        begin = xp.take(first, which)
        many = xp.take(first, which + 1) - begin
        place = xp.arange(int(xp.max(many)))[None, :]
        there = place < many[:, None]
        at = xp.reshape(begin[:, None] + place * xp.astype(there, place.dtype), (-1,))
        directions = xp.reshape(xp.take(self.directions, at, axis=1), (3, *there.shape))
        counts = xp.reshape(xp.take(self.counts, at), there.shape) * xp.astype(there, self.counts.dtype)
        return xp.permute_dims(directions, (1, 0, 2)), counts


def covered(means: Means, units: int) -> tuple[Array, Array]:
    """(U, 100) readings by direction, and (U,) whether the largest hole is as large as to be told of."""
    xp = namespace(means.directions)
    cell = hung.cells_of(means.directions[None, :, :])[0, :]
    at = cell + _CELLS * means.units
    counts = xp.reshape(counted_in(at, units * _CELLS, means.counts), (units, _CELLS))
    taken = xp.astype(counts > 0.0, counts.dtype)
    surely, perhaps = (taken @ like(reach, counts) > 0.0 for reach in _within_reach())
    hole = ~xp.all(perhaps, axis=1)
    unit, empty = xp.nonzero(~surely & ~hole[:, None])
    return counts, hole | _has_hole(means, unit, empty, units) if unit.shape[0] else hole


@lru_cache(maxsize=1)
def _within_reach() -> tuple[Floats, Floats]:
    """(100, 100) each: 1 where all directions in a cell, or any, are so near the middle of another that no hole is."""
    everywhere = fibonacci(20_000)
    at = cells_of(everywhere)
    off = np.rad2deg(np.arccos(np.clip(everywhere @ CELLS.T, -1.0, 1.0)))
    farthest, nearest = (np.stack([end(off[at == cell], axis=0) for cell in range(_CELLS)]) for end in (np.max, np.min))
    return (farthest < HOLE_DEG - 3.0).astype(float), (nearest < HOLE_DEG + 3.0).astype(float)


def _has_hole(means: Means, unit: Array, cell: Array, units: int) -> Array:
    """(U,) whether the largest hole is too large: whether it is about the middle of any (K,) `cell` of (K,) `unit`.

    Of others it is known that a direction lies nearer.
    """
    xp = namespace(means.directions)
    first = xp.searchsorted(unit, xp.arange(units + 1, device=unit.device))
    (some,) = xp.nonzero(first[1:] > first[:-1])
    begin, many = xp.take(first, some), xp.take(first[1:] - first[:-1], some)
    place = xp.arange(int(xp.max(many)), device=unit.device)[None, :]
    at = begin[:, None] + xp.minimum(place, many[:, None] - 1)  # the last again and again fills rows up
    directions, counts = means.table(some, units)
    middles = xp.take(like(CELLS, directions), xp.take(cell, xp.reshape(at, (-1,))), axis=0)
    across = xp.reshape(middles, (*at.shape, 3)) @ directions
    across -= 3.0 * xp.astype(counts == 0.0, directions.dtype)[:, None, :]
    nearest = xp.clip(xp.min(xp.max(across, axis=2), axis=1), -1.0, 1.0)
    hole = xp.astype(xp.acos(nearest) * (180.0 / np.pi) > HOLE_DEG, directions.dtype)
    return counted_in(some, units, hole) > 0.0
