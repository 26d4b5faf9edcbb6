"""Least median of squares over many small subsets: a start that outliers cannot bend."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood.equations import ROUNDING

if TYPE_CHECKING:
    from numpy.random import Generator

    from flinders.arrays import Floats

POINTS: Final = 12
"""In a draw: three more than there are parameters, so that noise does not decide the shape."""

DRAWS: Final = 256
"""Of which eight are free of outliers, on average, where a quarter of the readings are strays."""

SCORED: Final = 600
"""Readings that a draw is scored on: their median distance is known to a twentieth."""

RIDGE: Final = np.diag([1e-3] * 5 + [1e-9] * 4)
"""Pull towards the sphere, in units of the squared radius; nothing beside what twelve scattered points say."""

LONGEST_AXIS: Final = 5.0
"""Of the shortest: a draw that is longer or flatter is not scored."""


def subset_start(readings: Floats, rng: Generator, *, draws: int = DRAWS, scored: int = SCORED) -> Ellipsoid:
    """Least median of squares: the best of many ellipsoids through a few readings each.

    All draws are fitted at once: twelve readings each, tr Q = 3, a slight pull towards the sphere that keeps few
    points from bending the surface. The winner has the smallest median distance; as long as one
    draw in all is free of outliers and outliers are a minority, they have no say.

    Parameters
    ----------
    readings : (N, 3) float
    rng : Generator
    draws, scored : int
        Subsets tried, and readings they are scored on.

    Raises
    ------
    NotAnEllipsoid
        If no draw gives one.

    References
    ----------
    P. J. Rousseeuw, "Least median of squares regression", J. Am. Stat. Assoc. 79 (1984).
    """
    some = readings if len(readings) <= scored else readings[rng.choice(len(readings), scored, replace=False)]
    origin = np.median(some, axis=0)
    scale = float(np.median(np.linalg.norm(some - origin, axis=1)))
    if scale == 0.0:
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    local = (some - origin) / scale
    chosen = local[np.argsort(rng.random((draws, len(local))), axis=1)[:, :POINTS]]
    centres, inverses = _closed(_quadrics(chosen))
    best = int(np.argmin(_scores(local, centres, inverses)))
    return Ellipsoid(centres[best], np.linalg.inv(inverses[best])).in_frame(origin, scale)


def _quadrics(points: Floats) -> Floats:
    """(H, 10) coefficients of H quadrics through (H, K, 3) points, in the least-squares sense with tr Q = 3.

    With Q = 1 + diag(a, b, −a − b) + … the sum of squares x² + y² + z² is the right-hand side.
    """
    x, y, z = np.moveaxis(points, 2, 0)
    rows = np.stack([x * x - z * z, y * y - z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z, np.ones_like(x)], axis=2)
    squares = x * x + y * y + z * z
    transposed = rows.transpose(0, 2, 1)
    normal = transposed @ rows + RIDGE
    normal += ROUNDING * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(9)
    solution = np.linalg.solve(normal, -(transposed @ squares[..., np.newaxis]))[..., 0]
    a, b = solution[:, 0], solution[:, 1]
    return np.column_stack([1.0 + a, 1.0 + b, 1.0 - a - b, solution[:, 2:]])


def _closed(quadrics: Floats) -> tuple[Floats, Floats]:
    """Centres (H, 3) and inverse shapes (H, 3, 3) of those quadrics that are ellipsoids of a sensible shape."""
    forms = quadrics[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
    eigenvalues, vectors = np.linalg.eigh(forms)
    flat = LONGEST_AXIS**-2 * eigenvalues[:, 2]
    sound = eigenvalues[:, 0] > np.maximum(flat, 1e-9)
    eigenvalues, vectors, quadrics = eigenvalues[sound], vectors[sound], quadrics[sound]
    linear = np.einsum("hji,hj->hi", vectors, quadrics[:, 6:9])
    centres = np.einsum("hij,hj->hi", vectors, -0.5 * linear / eigenvalues)
    levels = 0.25 * np.sum(linear**2 / eigenvalues, axis=1) - quadrics[:, 9]
    real = levels > 0.0
    if not real.any():
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    vectors, eigenvalues, levels = vectors[real], eigenvalues[real], levels[real]
    roots = np.sqrt(eigenvalues / levels[:, np.newaxis])
    return centres[real], np.einsum("hij,hj,hkj->hik", vectors, roots, vectors)


def _scores(readings: Floats, centres: Floats, inverses: Floats) -> Floats:
    """(H,) median Sampson distances of (N, 3) readings from H ellipsoids."""
    y = np.matmul(inverses, (readings - centres[:, np.newaxis]).transpose(0, 2, 1))
    lengths = np.maximum(np.sqrt(np.einsum("hin,hin->hn", y, y)), 1e-12)
    normals = np.matmul(inverses, y)
    steepness = np.maximum(np.sqrt(np.einsum("hin,hin->hn", normals, normals)), 1e-12)
    distances = np.abs(lengths - 1.0) * lengths / steepness
    middle = distances.shape[1] // 2
    scores: Floats = np.partition(distances, middle, axis=1)[:, middle]
    return scores
