"""Small matrices and long rows of many units at once, for any array library that keeps the array API standard.

Arrays have the unit first: (U, 3, N) are the x, y and z of N readings of U units. NumPy's arrays cost no import; for
others the package array-api-compat says which functions are theirs.

>>> entries = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
>>> symmetric(entries)[0]
array([[1., 4., 5.],
       [4., 2., 6.],
       [5., 6., 3.]])
>>> upper(symmetric(entries))
array([[1., 2., 3., 4., 5., 6.]])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.errors import MissingExtra

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

Array: TypeAlias = Any
"""An array of any library that keeps the standard; its shape is in the docstring that uses it."""

READINGS_AT_A_TIME: Final = 16384
"""Of all units together; measured with ``python -m benchmarks.stacked``: half or twice as many cost as much."""

SHORTEST: Final = 1e-300
"""Square of the length of a vector of no length, so that dividing is safe."""

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


def lengths(vectors: Array) -> Array:
    """(U, N) lengths of (U, 3, N) vectors; see `SHORTEST`."""
    xp = namespace(vectors)
    x, y, z = vectors[:, 0, :], vectors[:, 1, :], vectors[:, 2, :]
    square = x * x
    square += y * y
    square += z * z
    return xp.sqrt(xp.maximum(square, SHORTEST))


def gathered(vectors: Array, directions: Array, *, room: int = 0) -> Array:
    """(U, 9 + room, N) coefficients of v·δb + vᵀ δS u, as `flinders.quadric.gathered`, for (U, 3, N) v and u.

    Parameters
    ----------
    vectors, directions : (U, 3, N)
    room : int
        Rows left for the caller to fill.
    """
    xp = namespace(vectors)
    rows = xp.empty((vectors.shape[0], 9 + room, vectors.shape[2]), dtype=vectors.dtype, device=vectors.device)
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


def stretches(units: int, readings: int) -> Iterator[slice]:
    """Cut units of so many readings each into stretches that fit the cache.

    >>> [stretch.stop for stretch in stretches(40, 500)]
    [32, 40]
    """
    many = max(1, READINGS_AT_A_TIME // max(readings, 1))
    for begin in range(0, units, many):
        yield slice(begin, min(begin + many, units))


def in_stretches(kernel: Callable[..., Array], readings: Array, *others: Array | None) -> Array:
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
        for cut in stretches(readings.shape[0], readings.shape[2])
    ]
    if not isinstance(found[0], tuple):
        return found[0] if len(found) == 1 else xp.concat(found)
    return tuple(parts[0] if len(parts) == 1 else xp.concat(list(parts)) for parts in zip(*found, strict=True))
