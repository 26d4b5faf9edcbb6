"""Small matrices and long rows of many units at once, for any array library that keeps the array API standard.

Arrays have the unit first: (U, 3, N) are the x, y and z of N readings of U units. In memory the x of all units lie
together, then the y: so each step is one run through long rows, which takes half the time of many short ones. Readings
have a fourth row of ones, with which a product with a (3, 4) matrix moves them as well. NumPy's arrays cost no import;
for others the package array-api-compat says which functions are theirs.

>>> entries = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
>>> symmetric(entries)[0]
array([[1., 4., 5.],
       [4., 2., 6.],
       [5., 6., 3.]])
>>> upper(symmetric(entries))
array([[1., 2., 3., 4., 5., 6.]])
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.errors import MissingExtra

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

Array: TypeAlias = Any
"""An array of any library that keeps the standard; its shape is in the docstring that uses it."""

READINGS_AT_A_TIME: Final = 16384
"""Of all units together; with half as many calls cost a fifth more (``python -m benchmarks.stacked``)."""

SHORTEST: Final = 1e-300
"""Square of the length of a vector of no length, so that dividing is safe."""

NEXT_TO_NOTHING: Final = 1e-20
"""What an entry of D counts as that is nothing, so that dividing is safe; matrices are in a scale near one."""

_FULL: Final = np.array([0, 3, 4, 3, 1, 5, 4, 5, 2])
_UPPER: Final = np.array([0, 4, 8, 1, 2, 5])


def namespace(array: Array) -> Any:  # noqa: ANN401 - a module of whichever library it is
    """The functions of the library that an array belongs to.

    Raises
    ------
    MissingExtra
        For arrays of another library than NumPy where array-api-compat is not installed.

    Examples
    --------
    >>> namespace(np.zeros(3)) is np
    True
    """
    if isinstance(array, np.ndarray):
        return np
    try:
        import array_api_compat
    except ImportError:
        raise MissingExtra("array-api-compat", "arrays", f"a stack of {type(array).__module__} arrays") from None
    return array_api_compat.array_namespace(array)


def like(constant: NDArray[Any], array: Array) -> Array:
    """A NumPy constant as an array of the library and on the device of another."""
    if isinstance(array, np.ndarray):
        return np.asarray(constant)
    return namespace(array).asarray(constant, device=array.device)


def symmetric(entries: Array) -> Array:
    """(U, 3, 3) symmetric matrices of their entries 11, 22, 33, 12, 13, 23, (U, 6)."""
    xp = namespace(entries)
    return xp.reshape(xp.take(entries, like(_FULL, entries), axis=1), (-1, 3, 3))


def upper(matrices: Array) -> Array:
    """(U, 6) entries 11, 22, 33, 12, 13, 23 of (U, 3, 3) symmetric matrices."""
    xp = namespace(matrices)
    return xp.take(xp.reshape(matrices, (-1, 9)), like(_UPPER, matrices), axis=1)


def diagonals(matrices: Array) -> Array:
    """(U, k) diagonals of (U, k, k) matrices."""
    return namespace(matrices).linalg.diagonal(matrices)


def applied(matrices: Array, vectors: Array) -> Array:
    """(U, k) products of (U, k, m) matrices and (U, m) vectors."""
    return (matrices @ vectors[:, :, None])[:, :, 0]


def rows_like(array: Array, many: int) -> Array:
    """(U, many, N) rows without contents, the first of all units together in memory, beside a (U, ..., N) array."""
    xp = namespace(array)
    empty = xp.empty((many, array.shape[0], array.shape[-1]), dtype=array.dtype, device=array.device)
    return xp.permute_dims(empty, (1, 0, 2))


def with_ones(readings: Array) -> Array:
    """(U, 4, N) readings with a fourth row of ones, from (U, 3, N)."""
    found = rows_like(readings, 4)
    found[:, :3, :] = readings
    found[:, 3, :] = 1.0
    return found


def turned(matrices: Array, vectors: Array) -> Array:
    """(U, k, N) products of (U, k, m) matrices and (U, m, N) vectors, laid out as `rows_like`.

    >>> ones = with_ones(np.array([[[5.0], [6.0], [7.0]]]))
    >>> turned(moving(np.eye(3)[None], np.array([[1.0, 2.0, 3.0]])), ones)[0, :, 0]
    array([4., 4., 4.])
    """
    if isinstance(vectors, np.ndarray):
        return np.matmul(matrices, vectors, out=rows_like(vectors, matrices.shape[1]))
    return matrices @ vectors


def moving(matrices: Array, centres: Array) -> Array:
    """(U, 3, 4) matrices V (x − c) of (U, 3, 3) V and (U, 3) c, for vectors `with_ones`."""
    xp = namespace(matrices)
    return xp.concat([matrices, -(matrices @ centres[:, :, None])], axis=2)


def squares(vectors: Array) -> Array:
    """(U, N) squares of the lengths of (U, 3, N) vectors; see `SHORTEST`."""
    if isinstance(vectors, np.ndarray):
        square = np.einsum("uin,uin->un", vectors, vectors)
    else:
        x, y, z = vectors[:, 0, :], vectors[:, 1, :], vectors[:, 2, :]
        square = x * x + y * y + z * z
    square += SHORTEST
    return square


def lengths(vectors: Array) -> Array:
    """(U, N) lengths of (U, 3, N) vectors; see `SHORTEST`."""
    return namespace(vectors).sqrt(squares(vectors))


def monomials(directions: Array, *, room: int = 0) -> Array:
    """(U, 9 + room, N) z = x, y, z, x², y², z², yz, xz, xy of (U, 3, N) directions, and rows for the caller to fill."""
    rows = rows_like(directions, 9 + room)
    rows[:, :3, :] = directions
    rows[:, 3:6, :] = directions
    rows[:, 3:6, :] *= directions
    rows[:, 6, :] = directions[:, 1, :]
    rows[:, 7, :] = directions[:, 0, :]
    rows[:, 6:8, :] *= directions[:, 2:, :]
    rows[:, 8, :] = directions[:, 0, :]
    rows[:, 8, :] *= directions[:, 1, :]
    return rows


POWERS: Final = np.array(
    [(1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)]
)
"""(9, 3) int: those of x, y and z in each of `monomials`."""

ENOUGH: Final = slice(3, 7)
"""Rows of `monomials` whose products with all rows hold every product there is of degree three and four."""

_ENTRIES: Final = np.zeros((3, 3), int)
_ENTRIES[[0, 1, 2, 0, 1, 0, 2, 1, 2], [0, 1, 2, 1, 0, 2, 0, 2, 1]] = [0, 1, 2, 3, 3, 4, 4, 5, 5]


def _carried() -> NDArray[np.float64]:
    """(6, 36) which entry of V, as `upper`, carries which product of u to which entry of (V u) uᵀ + u (V u)ᵀ."""
    table = np.zeros((6, 6, 6))
    order = {tuple(power): row for row, power in enumerate(POWERS[3:].tolist())}
    for row, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        for one, other in {(i, j), (j, i)}:
            for axis in range(3):
                column = order[tuple(np.eye(3, dtype=int)[[axis, other]].sum(axis=0).tolist())]
                table[_ENTRIES[one, axis], row, column] += 1.0
    return table.reshape(6, 36)


def _spread() -> NDArray[np.float64]:
    """(36, 81) which of the (9, 4) sums of `ENOUGH` are which entry of Σ w zzᵀ; where x² + y² + z² = 1."""
    held: dict[tuple[int, ...], int] = {}
    for row, power in enumerate(POWERS):
        for column, other in enumerate(POWERS[ENOUGH]):
            held.setdefault(tuple((power + other).tolist()), 4 * row + column)
    table = np.zeros((36, 9, 9))
    for row, column in np.ndindex(9, 9):
        power = POWERS[row] + POWERS[column]
        wanted = [power] if power.sum() > 2 else [power + 2 * axis for axis in np.eye(3, dtype=int)]
        table[[held[tuple(each.tolist())] for each in wanted], row, column] = 1.0
    return table.reshape(36, 81)


_CARRIED: Final = _carried()
_SPREAD: Final = _spread()


def carriers(inverses: Array) -> Array:
    """(U, 9, 9) matrices T for (U, 3, 3) symmetric V: T z are the coefficients of v·δb + vᵀ δS u with v = V u.

    Here z are the `monomials` of u. With normals v/|v| these are the rows of a Jacobian, so its products JᵀJ are
    T Σ zzᵀ/|v|² Tᵀ, and the sums of zzᵀ hold each product of directions once.

    >>> v, u = np.array([[[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 1.5]]]), np.array([[[0.6], [0.0], [0.8]]])
    >>> np.allclose(carriers(v) @ monomials(u), gathered(v @ u, u))
    True
    """
    xp = namespace(inverses)
    carried = xp.zeros((inverses.shape[0], 9, 9), dtype=inverses.dtype, device=inverses.device)
    carried[:, :3, :3] = inverses
    carried[:, 3:, 3:] = xp.reshape(upper(inverses) @ like(_CARRIED, inverses), (-1, 6, 6))
    return carried


def weighed(sums: Array) -> Array:
    """(U, 9, 9) Σ w zzᵀ of `monomials` z of unit vectors, from (U, 9, 4) sums Σ w z qᵀ, q being those of `ENOUGH`.

    >>> z = monomials(np.array([[[0.6, 0.0], [0.0, 0.6], [0.8, 0.8]]]))
    >>> np.allclose(weighed(z @ z[:, ENOUGH].swapaxes(1, 2)), z @ z.swapaxes(1, 2))
    True
    """
    xp = namespace(sums)
    return xp.reshape(xp.reshape(sums, (-1, 36)) @ like(_SPREAD, sums), (-1, 9, 9))


def gathered(vectors: Array, directions: Array, *, room: int = 0) -> Array:
    """(U, 9 + room, N) coefficients of v·δb + vᵀ δS u, as `geometry.ellipsoid.gathered`, for (U, 3, N) v and u.

    Parameters
    ----------
    vectors, directions : (U, 3, N)
    room : int
        Rows left for the caller to fill.
    """
    rows = rows_like(vectors, 9 + room)
    rows[:, :3, :] = vectors
    rows[:, 3:6, :] = vectors
    rows[:, 3:6, :] *= directions
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), start=6):
        mixed = vectors[:, i, :] * directions[:, j, :]
        mixed += vectors[:, j, :] * directions[:, i, :]
        rows[:, row, :] = mixed
    return rows


def scaled_solve(matrices: Array, gradients: Array) -> Array:
    """(U, k) solutions of normal equations, in the scale in which their matrices have ones on the diagonal."""
    scale = scale_of(matrices)
    xp = namespace(matrices)
    solution = xp.linalg.solve(matrices / outer(scale), (gradients / scale)[:, :, None])[:, :, 0]
    return solution / scale


def lower_times_diagonal(matrices: Array) -> tuple[list[Array], Array]:
    """Columns of L, ones on its diagonal, and the (k, U) diagonal D of matrices L D Lᵀ; both with the unit last.

    Rows are not exchanged: for symmetric matrices whose leading ones are positive definite. Where that is not so, an
    entry of D is negative or next to nothing, and the signs of D are those of the eigenvalues (Sylvester).

    >>> columns, diagonal = lower_times_diagonal(np.array([[[4.0, 2.0], [2.0, 3.0]]]))
    >>> columns[0][:, 0], diagonal[:, 0]
    (array([0.5]), array([4., 2.]))
    """
    xp = namespace(matrices)
    left = xp.asarray(xp.permute_dims(matrices, (1, 2, 0)), copy=True)
    columns: list[Array] = []
    diagonal: list[Array] = []
    while True:
        pivot = left[0, 0, :]
        pivot = pivot + xp.astype(pivot == 0.0, pivot.dtype) * NEXT_TO_NOTHING
        diagonal.append(pivot)
        if left.shape[0] == 1:
            return columns, xp.stack(diagonal)
        column = left[1:, 0, :] / pivot
        columns.append(column)
        left = left[1:, 1:, :] - column[:, None, :] * left[0, None, 1:, :]


def solved_with(columns: list[Array], diagonal: Array, vectors: Array) -> Array:
    """(U, k) solutions of L D Lᵀ x = v for (U, k) v, see `lower_times_diagonal`.

    >>> solved_with(*lower_times_diagonal(np.array([[[4.0, 2.0], [2.0, 3.0]]])), np.array([[8.0, 8.0]]))
    array([[1., 2.]])
    """
    xp = namespace(vectors)
    x = xp.asarray(xp.permute_dims(vectors, (1, 0)), copy=True)
    for row, column in enumerate(columns):
        x[row + 1 :, :] -= column * x[row, :]
    x /= diagonal
    for row, column in reversed(list(enumerate(columns))):
        x[row, :] -= xp.sum(column * x[row + 1 :, :], axis=0)
    return xp.permute_dims(x, (1, 0))


def scaled_inverse(matrices: Array) -> Array:
    """(U, k, k) inverses in the same scale, exactly symmetric."""
    scale = scale_of(matrices)
    xp = namespace(matrices)
    inverse = xp.linalg.inv(matrices / outer(scale)) / outer(scale)
    return 0.5 * (inverse + xp.matrix_transpose(inverse))


def scale_of(matrices: Array) -> Array:
    """(U, k) roots of the diagonals; those of nothing count as very small."""
    xp = namespace(matrices)
    diagonal = diagonals(matrices)
    least = xp.maximum(1e-15 * xp.max(diagonal, axis=1, keepdims=True), float(np.finfo(float).tiny))
    return xp.sqrt(xp.maximum(diagonal, least))


def outer(vectors: Array) -> Array:
    """(U, k, k) products of the entries of (U, k) vectors with each other."""
    return vectors[:, :, None] * vectors[:, None, :]


def signs(numbers: Array) -> Array:
    """The sign of each number, 1 for zero."""
    xp = namespace(numbers)
    return 1.0 - 2.0 * xp.astype(numbers < 0.0, numbers.dtype)


def picked(values: Array, places: Array) -> Array:
    """(U, ..., K) entries of (U, ..., N) arrays at (U, K) places, the same for all rows of a unit.

    >>> picked(np.array([[5.0, 6.0], [7.0, 8.0]]), np.array([[1], [0]]))
    array([[6.],
           [7.]])
    """
    xp = namespace(values)
    units, many = values.shape[0], values.shape[-1]
    if values.ndim == 2:
        flat = xp.reshape(places + many * xp.arange(units, device=values.device)[:, None], (-1,))
        return xp.reshape(xp.take(xp.reshape(values, (-1,)), flat), places.shape)
    return xp.stack([picked(values[:, row, :], places) for row in range(values.shape[1])], axis=1)


def put(into: Array, at: Array, rows: Array) -> Array:
    """An array with those of its rows replaced that (K,) ascending integers name.

    >>> put(np.zeros((3, 1)), np.array([1]), np.ones((1, 1)))[:, 0]
    array([0., 1., 0.])
    """
    xp = namespace(into)
    every = xp.arange(into.shape[0], device=into.device)
    place = xp.clip(xp.searchsorted(at, every), 0, at.shape[0] - 1)
    named = xp.reshape(xp.take(at, place) == every, (-1, *([1] * (into.ndim - 1))))
    return xp.where(named, xp.take(rows, place, axis=0), into)


def counted_in(places: Array, size: int, weights: Array | None = None) -> Array:
    """(size,) how often each place occurs, or the sum of its weights.

    >>> counted_in(np.array([2, 0, 2]), 4, np.array([1.0, 5.0, 2.0]))
    array([5., 0., 3., 0.])
    """
    xp = namespace(places)
    if xp is np:
        return np.bincount(places, weights=weights, minlength=size).astype(float)
    order = xp.argsort(places)
    ends = xp.searchsorted(xp.take(places, order), xp.arange(size + 1, device=places.device))
    if weights is None:
        return xp.astype(ends[1:] - ends[:-1], xp.float64)
    summed = xp.concat([xp.zeros(1, dtype=weights.dtype), xp.cumulative_sum(xp.take(weights, order))])
    at_ends = xp.take(summed, ends)
    return at_ends[1:] - at_ends[:-1]


def segments(units: int, readings: int) -> Iterator[slice]:
    """Cut units of so many readings each into stretches that fit the cache.

    >>> [stretch.stop for stretch in segments(60, 500)]
    [30, 60]
    """
    count = min(max(1, round(units * readings / READINGS_AT_A_TIME)), units)
    edges = [units * place // count for place in range(count + 1)] if count else []
    yield from (slice(begin, end) for begin, end in pairwise(edges))


def in_segments(kernel: Callable[..., Array], readings: Array, *others: Array | None) -> Array:
    """Run a kernel over stretches of units, and put together what it gives.

    Parameters
    ----------
    kernel : callable
        Of (u, 3, N) readings and what belongs to them; gives an array with the unit first, or a tuple of such.
    readings : (U, 3, N)
    *others : (U, ...) or None
    """
    xp = namespace(readings)
    found = [
        kernel(readings[cut, ...], *(None if other is None else other[cut, ...] for other in others))
        for cut in segments(readings.shape[0], readings.shape[2])
    ]
    if not isinstance(found[0], tuple):
        return found[0] if len(found) == 1 else xp.concat(found)
    return tuple(parts[0] if len(parts) == 1 else xp.concat(list(parts)) for parts in zip(*found, strict=True))
