"""How the residuals of many units hang together: `flinders.estimators.covariance`, unit by unit.

Correlation in time and what creeps widen a covariance here as there. A unit in which a distortion belongs to
directions, or whose offset changed while it was recorded, leaves the stack.

>>> rng = np.random.default_rng(1)
>>> residuals = rng.normal(size=(2, 400))
>>> residuals[1, 1:] += residuals[1, :-1]
>>> found = Autocovariances.of(residuals, np.full(2, 400.0))
>>> found.length.tolist(), found.time.round(1).tolist()
([1, 2], [1.0, 2.1])
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.diagnostics.axis_swap import BROKEN
from flinders.diagnostics.drift import FEWEST, FEWEST_INDEPENDENT
from flinders.estimators import covariance as residual_covariance
from flinders.findings import limit_of
from flinders.likelihood.identifiability import WELL_CONDITIONED
from flinders.stacked.algebra import (
    Array,
    applied,
    carriers,
    counted_in,
    gathered,
    in_segments,
    lengths,
    like,
    monomials,
    moving,
    namespace,
    outer,
    picked,
    put,
    scale_of,
    scaled_inverse,
    squares,
    turned,
    upper,
    weighed,
)
from flinders.stacked.surfaces import DOUBTFUL, EllipsoidBatch, of_units, surface, weighing
from flinders.summary.coverage import BANDS, CELLS, EDGES, STARTS

if TYPE_CHECKING:
    from flinders.stacked.likelihood import BatchFit

CREEPS: Final = NormalDist().inv_cdf(1.0 - residual_covariance.BY_CHANCE)
CHANGES: Final = NormalDist().inv_cdf(1.0 - limit_of("field-changed", "drift_by_chance"))
"""Standard deviations that chance exceeds as often as it may make what creeps, and what looks like a change."""
HINTS: Final = NormalDist().inv_cdf(0.95)

_CELLS: Final = len(CELLS)


@dataclass(frozen=True, eq=False)
class BatchResiduals:
    """Distances of the readings of U units from their surfaces, and sums over blocks of them.

    Attributes
    ----------
    distances : (U, N)
        Zero where there is no reading.
    cells : (U, N) int
        Of `flinders.summary.coverage.CELLS`, into which their directions fall.
    gradients : (U, 8, 9)
        Σ z s/l over each of eight blocks, where T z/l are the rows of the Jacobian, see `carriers`.
    squares : (U, 8, 9, 9)
        Σ zzᵀ/l² over each.
    """

    distances: Array
    cells: Array
    gradients: Array
    squares: Array

    @classmethod
    def of(cls, readings: Array, inside: Array | None, count: Array, ellipsoids: EllipsoidBatch) -> Self:
        """Go through the readings once."""
        return cls(*in_segments(_residuals, readings, inside, count, ellipsoids.centre, ellipsoids.inverse))

    def only(self, which: Array) -> Self:
        """Those that (K,) integers name."""
        xp = namespace(which)
        return type(self)(
            *(xp.take(part, which, axis=0) for part in (self.distances, self.cells, self.gradients, self.squares))
        )


def _residuals(
    readings: Array, inside: Array | None, count: Array, centre: Array, inverse: Array
) -> tuple[Array, Array, Array, Array]:
    """Distances, cells, gradients and squares of one stretch of units."""
    xp = namespace(readings)
    unit = turned(moving(inverse, centre), readings)
    length = lengths(unit)
    unit *= (1.0 / length)[:, None, :]
    square = squares(turned(inverse, unit))
    distances = length
    distances -= 1.0
    distances /= xp.sqrt(square)
    if inside is not None:
        distances *= inside
    rows = monomials(unit, room=1)
    products = _of_blocks(rows, weighing(rows, distances, square, inside), count)
    units = products.shape[0]
    blocks = weighed(xp.reshape(products[:, :, :9, :4], (units * residual_covariance.BLOCKS, 9, 4)))
    return (
        distances,
        cells_of(unit),
        products[:, :, :9, 4],
        xp.reshape(blocks, (units, residual_covariance.BLOCKS, 9, 9)),
    )


def _of_blocks(rows: Array, others: Array, count: Array) -> Array:
    """(u, 8, k, m) products of (u, k, N) and (u, m, N) rows over eight blocks, cut as `numpy.array_split` cuts."""
    xp = namespace(rows)
    counts = np.unique(np.asarray(count))
    block = np.arange(residual_covariance.BLOCKS + 1)
    edges = block * (counts[:, None] // residual_covariance.BLOCKS) + np.minimum(
        counts[:, None] % residual_covariance.BLOCKS, block
    )
    first, last = edges.min(axis=0).tolist(), edges.max(axis=0).tolist()
    products = []
    for begin, end in pairwise(range(residual_covariance.BLOCKS + 1)):
        cut = slice(first[begin], last[end])
        part = rows[:, :, cut]
        if len(counts) > 1:
            own = like(edges[np.searchsorted(counts, np.asarray(count))], rows)
            place = xp.arange(first[begin], last[end], device=rows.device)[None, :]
            part = (
                part * xp.astype((place >= own[:, begin, None]) & (place < own[:, end, None]), rows.dtype)[:, None, :]
            )
        products.append(part @ xp.matrix_transpose(others[:, :, cut]))
    return xp.stack(products, axis=1)


def cells_of(directions: Array) -> Array:
    """(u, N) int cells of (u, 3, N) directions, as `flinders.summary.coverage.cells_of`."""
    xp = namespace(directions)
    x, y, z = directions[:, 0, :], directions[:, 1, :], directions[:, 2, :]
    band = xp.zeros(z.shape, dtype=xp.int8, device=z.device)
    for edge in EDGES.tolist():
        band += xp.astype(z < edge, xp.int8)
    turn = xp.atan2(y, x)
    turn *= 0.5 / np.pi
    turn += xp.astype(turn < 0.0, turn.dtype)
    flat = xp.astype(xp.reshape(band, (-1,)), xp.int64)
    wide = xp.reshape(xp.take(like(BANDS.astype(float), z), flat), z.shape)
    first = xp.reshape(xp.take(like(STARTS, z), flat), z.shape)
    turn *= wide
    return first + xp.astype(xp.minimum(xp.floor(turn), wide - 1.0), xp.int64)


@dataclass(frozen=True, eq=False)
class Autocovariances:
    """Of the residuals of U units, up to where they sink into their noise.

    Attributes
    ----------
    values : (U, K)
        C(0), C(1) …; zero from where they are cut off.
    length : (U,) int
        Of each; 1 where residuals are white.
    lag_one : (U,)
        Correlation of a residual with the next.
    """

    values: Array
    length: Array
    lag_one: Array

    @property
    def time(self) -> Array:
        """(U,) readings that say as much as one independent reading."""
        xp = namespace(self.values)
        return 1.0 + 2.0 * xp.sum(self.values[:, 1:], axis=1) / xp.maximum(self.values[:, 0], 1e-300)

    @classmethod
    def of(cls, distances: Array, count: Array) -> Self:
        """Of (U, N) residuals, zero beyond (U,) readings, as `BatchResiduals.autocovariance` of one."""
        xp = namespace(distances)
        count = xp.astype(count, distances.dtype)
        square = xp.sum(distances * distances, axis=1)
        lag_one = xp.sum(distances[:, 1:] * distances[:, :-1], axis=1) / xp.maximum(square, 1e-300)
        most = xp.minimum(
            xp.floor(count - residual_covariance.PARTNERS * count), float(residual_covariance.LONGEST_LAG)
        )
        (hangs,) = xp.nonzero((xp.abs(lag_one) >= residual_covariance.SIGNIFICANT / xp.sqrt(count)) & (most >= 2.0))
        length = xp.ones(count.shape, dtype=xp.int64)
        values = (square / count)[:, None]
        if not hangs.shape[0]:
            return cls(values, length, lag_one)
        sums, sunk = _correlated(*(xp.take(part, hangs, axis=0) for part in (distances, count, most)))
        table = xp.concat([values, xp.zeros((count.shape[0], sums.shape[1] - 1))], axis=1)
        return cls(put(table, hangs, sums), put(length, hangs, sunk), lag_one)

    def only(self, which: Array) -> Self:
        """Those that (K,) integers name."""
        xp = namespace(which)
        return type(self)(
            xp.take(self.values, which, axis=0), xp.take(self.length, which), xp.take(self.lag_one, which)
        )


def _correlated(distances: Array, count: Array, most: Array) -> tuple[Array, Array]:
    """(U, K) autocovariances cut off where they sink into their noise, and (U,) their lengths."""
    xp = namespace(distances)
    spectrum = xp.fft.rfft(distances, n=2 * distances.shape[1])
    power = xp.real(spectrum) ** 2 + xp.imag(spectrum) ** 2
    sums = xp.fft.irfft(xp.astype(power, spectrum.dtype), n=2 * distances.shape[1])[:, : int(xp.max(most))]
    lag = xp.arange(sums.shape[1], dtype=sums.dtype, device=sums.device)[None, :]
    sunk = (sums < (residual_covariance.SIGNIFICANT / xp.sqrt(count) * sums[:, 0])[:, None]) | (lag >= most[:, None])
    sunk = xp.concat([sunk, xp.ones((sunk.shape[0], 1), dtype=xp.bool)], axis=1)
    length = xp.argmax(xp.astype(sunk, xp.int64), axis=1)
    longest = int(xp.max(length))
    kept = xp.where(lag < xp.astype(length, sums.dtype)[:, None], sums / count[:, None], xp.zeros_like(sums))
    return kept[:, :longest], length


def scatters(rows: Array, white: Array, found: Autocovariances) -> Array:
    """(U, k, k) Σᵢⱼ JᵢJⱼᵀ C(i − j) of (U, k, N) Jacobian rows whose squares add up to `white`, see `BatchResiduals`.

    Units whose autocovariances are alike in length have the same lags, and are gone through together.
    """
    xp = namespace(rows)
    squares = found.values[:, :1, None] * white
    at: list[Array] = []
    parts: list[Array] = []
    for length in np.unique(np.asarray(found.length)).tolist():
        (those,) = xp.nonzero(found.length == length)
        total = xp.take(squares, those, axis=0)
        lags, _ = residual_covariance.quadrature(np.ones(length))
        if lags:
            hats = np.stack([np.interp(np.arange(1, length), lags, unit) for unit in np.eye(len(lags))])
            weights = xp.take(found.values, those, axis=0)[:, 1:length] @ like(hats.T, rows)
            chosen = xp.take(rows, those, axis=0)
            plain = total
            for place, lag in enumerate(lags):
                product = chosen[:, :, :-lag] @ xp.matrix_transpose(chosen[:, :, lag:])
                total = total + weights[:, place, None, None] * (product + xp.matrix_transpose(product))
            total = _not_below(total, plain)
        at.append(those)
        parts.append(total)
    return xp.take(xp.concat(parts), xp.argsort(xp.concat(at)), axis=0)


def _not_below(scatter: Array, white: Array) -> Array:
    """Keep (U, k, k) scatters within what `flinders.estimators.covariance` lets them claim."""
    xp = namespace(scatter)
    scale = scale_of(white)
    root = xp.linalg.cholesky(white / outer(scale))
    inverse = xp.linalg.inv(root)
    local = inverse @ (scatter / outer(scale)) @ xp.matrix_transpose(inverse)
    inflation, turned = xp.linalg.eigh(0.5 * (local + xp.matrix_transpose(local)))
    least = xp.maximum(xp.mean(inflation, axis=1) / 4.0, 1.0)
    inflation = xp.maximum(inflation, least[:, None])
    spread = scale[:, :, None] * (root @ turned)
    return (spread * inflation[:, None, :]) @ xp.matrix_transpose(spread)


@dataclass(frozen=True, eq=False)
class Hung:
    """What the residuals of U units say of each other, see `flinders.estimators.covariance.Correlation`.

    Attributes
    ----------
    scatter : (U, 9, 9)
    lag_one, time, creep : (U,)
    are_plain : (U,) bool
        No distortion belongs to directions.
    """

    scatter: Array
    lag_one: Array
    time: Array
    excess_variance: Array
    are_plain: Array

    @cached_property
    def are_white(self) -> Array:
        """(U,) bool."""
        return (self.time == 1.0) & (self.excess_variance == 1.0)

    def widened(self, found: BatchFit) -> Array:
        """(U, 9, 9) covariances with the scatter that residuals which hang together give the gradient."""
        xp = namespace(self.scatter)
        scatter = found.prior + self.scatter / (found.variance**2)[:, None, None]
        return xp.where(self.are_white[:, None, None], found.covariance, found.covariance @ scatter @ found.covariance)

    def effective(self, count: Array) -> Array:
        """(U,) how many independent readings say as much as so many of these."""
        return count / (self.time * self.excess_variance)


def autocorrelated(
    readings: Array, inside: Array | None, count: Array, ellipsoids: EllipsoidBatch, left: BatchResiduals
) -> Hung:
    """Look at the residuals of (U, 3, N) readings."""
    xp = namespace(readings)
    found = Autocovariances.of(left.distances, count)
    time, readings_of = found.time, xp.astype(count, readings.dtype)
    white = xp.sum(left.squares, axis=1)
    scatter = found.values[:, :1, None] * white
    (hangs,) = xp.nonzero(found.length > 1)
    if hangs.shape[0]:
        rows = _monomials(*of_units(readings, inside, hangs), ellipsoids.only(hangs))
        part = scatters(rows, xp.take(white, hangs, axis=0), found.only(hangs))
        scatter = put(scatter, hangs, part)
    independent = readings_of / time
    freedom = xp.minimum(independent / xp.maximum(independent - 9.0, 1.0), residual_covariance.MOST_FREEDOM)
    in_time = freedom[:, None, None] * scatter
    inverse = scaled_inverse(white)
    in_time_inverse = inverse / (freedom * found.values[:, 0])[:, None, None]
    if hangs.shape[0]:
        in_time_inverse = put(in_time_inverse, hangs, scaled_inverse(xp.take(in_time, hangs, axis=0)))
    excess_variance = _excess_variance(in_time_inverse, inverse, left)
    direction = _belongs(left, count, found.length, time)
    carrier = carriers(ellipsoids.inverse)
    scatter = carrier @ (excess_variance[:, None, None] * in_time) @ xp.matrix_transpose(carrier)
    return Hung(scatter, found.lag_one, time, excess_variance, ~direction)


def _monomials(readings: Array, inside: Array | None, ellipsoids: EllipsoidBatch) -> Array:
    """(U, 9, N) z/l at readings, of which `carriers` make the rows of the Jacobian."""
    _, unit, _, steepness, _ = surface(readings, ellipsoids.centre, ellipsoids.inverse)
    rows = monomials(unit)
    rows *= (1.0 / steepness if inside is None else inside / steepness)[:, None, :]
    return rows


def _rows(readings: Array, inside: Array | None, ellipsoids: EllipsoidBatch) -> Array:
    """(U, 9, N) Jacobian rows at readings."""
    _, unit, normal, _, _ = surface(readings, ellipsoids.centre, ellipsoids.inverse)
    rows = gathered(normal, unit)
    return rows if inside is None else rows * inside[:, None, :]


def _excess_variance(inverse: Array, whole: Array, left: BatchResiduals) -> Array:
    """(U,) factor by which blocks scatter more than scatters of the whole allow, as `BatchResiduals.excess_variance`.

    Parameters
    ----------
    inverse : (U, 9, 9)
        Of those scatters.
    whole : (U, 9, 9)
        Inverse of the squares of the whole.
    left : BatchResiduals
    """
    xp = namespace(inverse)
    gradients, blocks = left.gradients, left.squares
    beside = xp.reshape(xp.permute_dims(blocks, (0, 2, 1, 3)), (blocks.shape[0], 9, -1))
    shares = xp.reshape(whole @ beside, (blocks.shape[0], 9, -1, 9))
    largest = xp.ones_like(inverse[:, 0, 0])
    while gradients.shape[1] >= 4:
        taken = xp.sum(shares * xp.permute_dims(shares, (0, 3, 2, 1)), axis=(1, 2, 3))
        found = xp.sum(gradients * (gradients @ inverse), axis=(1, 2))
        expected = 9.0 - taken
        is_sure = expected > 0.0
        freedom = xp.round(xp.where(is_sure, expected, 1.0) ** 2 / taken)
        unlikely = standard_deviations(found * expected / taken, freedom) > CREEPS
        largest = xp.where(is_sure & unlikely & (found > largest * expected), found / expected, largest)
        gradients = gradients[:, ::2, :] + gradients[:, 1::2, :]
        shares = shares[:, :, ::2, :] + shares[:, :, 1::2, :]
    return largest


def standard_deviations(chi_square: Array, freedom: Array, others: Array | float = np.inf) -> Array:
    """(U,) of a normal distribution that chance exceeds as often as it makes chi-square as large.

    As `flinders.summary.pooling.chance_of`, whose parameters these are; minus infinity where there is no freedom.

    >>> from flinders.summary.pooling import chance_of
    >>> deviation = standard_deviations(np.array([16.919]), np.array([9.0]))[0]
    >>> bool(np.isclose(NormalDist().cdf(-deviation), chance_of(16.919, 9)))
    True
    """
    xp = namespace(chi_square)
    free = (freedom > 0.0) & (chi_square > 0.0)
    freedom = xp.where(free, freedom, 1.0)
    ours, theirs = 2.0 / (9.0 * freedom), 2.0 / (9.0 * others)
    root = (xp.where(free, chi_square, 1.0) / freedom) ** (1.0 / 3.0)
    normal = ((1.0 - theirs) * root - (1.0 - ours)) / xp.sqrt(theirs * root * root + ours)
    return xp.where(free, normal, -xp.inf)


def _belongs(left: BatchResiduals, count: Array, length: Array, time: Array) -> Array:
    """(U,) whether a distortion belongs to directions, as `_Sphere.distortion` proves it."""
    return in_segments(_proven, left.distances[:, None, :], left.cells, count, length, time)


def _proven(distances: Array, cells: Array, count: Array, length: Array, time: Array) -> Array:
    """(u,) bool for one stretch of units."""
    xp = namespace(distances)
    units, _, readings = distances.shape
    distances = distances[:, 0, :]
    bits = max(readings - 1, 1).bit_length()
    place = xp.arange(readings, device=cells.device)[None, :]
    if not bool(xp.all(count == readings)):
        cells = xp.where(place < count[:, None], cells, _CELLS)
    keys = xp.sort((xp.astype(cells, xp.int32) << bits) | xp.astype(place, xp.int32), axis=1)
    cell, order = keys >> bits, keys & ((1 << bits) - 1)
    apart = xp.astype(3 * length, xp.int32)[:, None]
    changed = (cell[:, 1:] != cell[:, :-1]) | (order[:, 1:] - order[:, :-1] > apart)
    begins = xp.reshape(xp.concat([xp.ones((units, 1), dtype=xp.bool), changed], axis=1), (-1,))
    (first,) = xp.nonzero(begins)
    visit = xp.cumulative_sum(xp.astype(begins, xp.int64)) - 1
    end = xp.asarray([units * readings], dtype=first.dtype, device=first.device)
    sums = counted_in(visit, first.shape[0], xp.reshape(picked(distances, order), (-1,)))
    sizes = xp.astype(xp.concat([first[1:], end]) - first, distances.dtype)
    own = xp.take(xp.reshape(cell + xp.arange(units)[:, None] * (_CELLS + 1), (-1,)), first)

    def between_visits(part: Array) -> tuple[Array, Array]:
        whole, several = (
            xp.reshape(counted_in(own, units * (_CELLS + 1), each), (units, -1))[:, :_CELLS] for each in (part, part**2)
        )
        return whole, whole**2 - several

    counts, pairs = between_visits(sizes)
    counts = xp.maximum(counts, 1.0)
    found = xp.sum(between_visits(sums)[1] / counts, axis=1)
    square = xp.sum(distances**2, axis=1) / xp.astype(count, distances.dtype)
    noise = square * time * xp.sqrt(2.0 * xp.sum(pairs / counts**2, axis=1))
    return found > residual_covariance.PROVEN * noise


def may_have_changed(
    readings: Array, inside: Array | None, count: Array, ellipsoids: EllipsoidBatch, left: BatchResiduals
) -> Array:
    """(U,) whether a steady change shows over a recording, as `drift_of` finds it; whatever its size.

    Where readings hardly tell some change from directions, a hint is enough: `drift_of` leaves out what noise pretends.
    """
    xp = namespace(readings)
    if not readings.shape[0]:
        return xp.zeros((0,), dtype=xp.bool)
    counts = xp.astype(count, readings.dtype)
    rows = _rows(readings, inside, ellipsoids)
    place = xp.arange(readings.shape[2], dtype=readings.dtype, device=readings.device)[None, :]
    time = place / (counts[:, None] - 1.0) - 0.5
    growth = xp.sum(rows[:, 3:, :] * upper(ellipsoids.shape)[:, :, None], axis=1)
    rows = xp.concat([rows, time[:, None, :] * rows[:, :3, :], (time * growth)[:, None, :]], axis=1)
    rows = rows / xp.sqrt(xp.sum(rows**2, axis=2, keepdims=True) / counts[:, None, None])
    products = rows @ xp.matrix_transpose(rows)
    inverse = xp.linalg.inv(products)
    found = applied(inverse, applied(rows, left.distances))
    rest = left.distances - applied(xp.matrix_transpose(rows), found)
    if inside is not None:
        rest = rest * inside
    hangs = Autocovariances.of(rest, count)
    covariance = inverse @ scatters(rows, products, hangs) @ inverse
    moved, spread = found[:, 9:], covariance[:, 9:, 9:]
    sigma = xp.sqrt(xp.linalg.diagonal(spread))
    chi = xp.sum((moved / sigma) * xp.linalg.solve(spread / outer(sigma), (moved / sigma)[:, :, None])[:, :, 0], axis=1)
    independent = counts / hangs.time - rows.shape[1]
    observed = (counts >= FEWEST) & (independent >= FEWEST_INDEPENDENT)
    independent = xp.where(observed, independent, 1.0)
    found_by = standard_deviations(chi, xp.full(chi.shape, 4.0), independent)
    flat = xp.linalg.eigvalsh(products / counts[:, None, None])[:, 0] < (1.0 + DOUBTFUL) * WELL_CONDITIONED
    return observed & (xp.isnan(found_by) | (found_by > CHANGES) | (flat & (found_by > HINTS)))


def may_have_slipped(readings: Array, count: Array) -> Array:
    """(U,) whether (U, 3, N) readings have a break that `flinders.diagnostics.axis_swap` would look at."""
    xp = namespace(readings)
    if readings.shape[2] < 3 + 9:
        return xp.zeros(count.shape, dtype=xp.bool)
    before = 1.5 * readings[:, :, 1:-2] - 0.5 * readings[:, :, :-3]
    after = 1.5 * readings[:, :, 2:-1] - 0.5 * readings[:, :, 3:]
    breaks = xp.max(xp.abs(after - before), axis=1)
    three = xp.maximum(xp.maximum(breaks[:, :-2], breaks[:, 1:-1]), breaks[:, 2:])
    beside = xp.maximum(three[:, :-6], three[:, 6:])
    there = xp.arange(beside.shape[1])[None, :] < count[:, None] - 11
    return xp.any(there & (breaks[:, 4:-4] > BROKEN * beside), axis=1)
