"""Directions: 642 near-hexagonal tiles of the sphere, evenly spread points, and random directions.

The centres of the tiles are the vertices of an icosahedron whose edges are divided into 8, moved until
each is the centroid of its own tile (Lloyd 1982). The tiles are 630 hexagons and 12 pentagons, about 8°
wide. Tile `i` contains the directions that are nearer to centre `i` than to any other centre, so each
direction is in exactly one tile.

>>> tiles().centres.shape, [len(corners) for corners in tiles().polygons()].count(5)
((642, 3), 12)
>>> tile_indices(tiles().centres[[7, 400]])
array([  7, 400])
>>> tile_indices([[0.0, 0.0, 1.0]]) == tile_indices([[0.0, 0.0, 50.0]])             # lengths do not matter
array([ True])

Hexagons are within 8 % of the mean area, pentagons 18 % smaller (`tests/laws/test_tile_laws.py`).

Source: S. P. Lloyd, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 28 (1982) 129–137, §IV, on the sphere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import check_table

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats

TILE_COUNT: Final = 642
"""Number of tiles."""
BISECTIONS: Final = 3
"""Bisections of the icosahedron's edges."""
CENTROID_MOVES: Final = 20
"""Count of moves of all centres to their centroids; further moves change the areas by less than 1 %."""
BLOCK_DIRECTIONS: Final = 4096
"""Count of directions that are assigned to tiles at a time; their distances to all centres fit into the cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """Centres and corners of the tiles."""

    centres: Floats  #: (642, 3): unit vectors
    #: (642, 6, 3): unit vectors, anticlockwise seen from outside; the last corner of a pentagon is repeated
    corners: Floats

    def polygons(self) -> list[Floats]:
        """Corners of each tile, (5, 3) or (6, 3)."""
        return [ring[:5] if np.array_equal(ring[4], ring[5]) else ring for ring in self.corners]

    @property
    def areas(self) -> Floats:
        """(642,) solid angles, which sum to 4π."""
        areas: Floats = _triangle_angles(self.centres, self.corners)[0].sum(axis=1)
        return areas


@lru_cache(maxsize=1)
def tiles() -> Tiles:
    """The tiles, read-only and with a cache."""
    centres, triangles = icosahedron()
    for _ in range(BISECTIONS):
        centres, triangles = bisect_edges(centres, triangles)
    rings = _vertex_triangles(centres, triangles)
    for _ in range(CENTROID_MOVES):
        centres = _tile_centroids(centres, _corners(centres, triangles)[rings])
    corners = _corners(centres, triangles)[rings]
    centres.flags.writeable = corners.flags.writeable = False
    return Tiles(centres, corners)


def tile_indices(directions: ArrayLike) -> NDArray[np.intp]:
    """(N,) index of the tile of each of (N, 3) directions of any length.

    Raises `ArrayError` for another shape, or values that are not finite.
    """
    vectors = check_table(directions)
    centres = tiles().centres.T.astype(np.float32)
    tile = np.empty(len(vectors), np.intp)
    for start in range(0, len(vectors), BLOCK_DIRECTIONS):
        block = vectors[start : start + BLOCK_DIRECTIONS]
        lengths = np.linalg.norm(block, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
        tile[start : start + BLOCK_DIRECTIONS] = np.argmax((block / lengths).astype(np.float32) @ centres, axis=1)
    return tile


def from_longitudes(z: Floats, longitude: Floats) -> Floats:
    """(N, 3) unit vectors with (N,) z components and (N,) longitudes in rad."""
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)


def fibonacci(n: int) -> Floats:
    """(n, 3) unit vectors on an even spiral from the north pole to the south pole.

    >>> fibonacci(4).round(3)
    array([[ 0.24 , -0.616,  0.75 ],
           [-0.868,  0.428,  0.25 ],
           [ 0.93 ,  0.271, -0.25 ],
           [-0.343, -0.565, -0.75 ]])
    """
    steps: Floats = np.arange(n, dtype=np.float64) + 0.5
    z = 1 - 2 * steps / n
    longitude: Floats = np.pi * (1 + 5**0.5) * steps  # the golden angle, but for full turns
    return from_longitudes(z, longitude)


def uniform_directions(rng: Generator, n: int) -> Floats:
    """(n, 3) random directions, uniform over the sphere.

    >>> bool(np.abs(uniform_directions(np.random.default_rng(0), 10_000).mean(axis=0)).max() < 0.02)
    True
    """
    vector = rng.standard_normal((n, 3))
    unit: Floats = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


def hemisphere(rng: Generator, n: int) -> Floats:
    """(n, 3) random directions with z ≥ 0, as of a sensor that is never turned upside down.

    >>> bool(hemisphere(np.random.default_rng(0), 1000)[:, 2].min() >= 0)
    True
    """
    directions = uniform_directions(rng, n)
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def clump(rng: Generator, n: int, *, half_angle_deg: float = 3.0) -> Floats:
    """(n, 3) random directions within `half_angle_deg` of one random direction.

    >>> close = clump(np.random.default_rng(0), 100)
    >>> bool(np.degrees(np.arccos((close @ close.T).min())) < 6)
    True
    """
    pole = uniform_directions(rng, 1)[0]
    cap = from_longitudes(rng.uniform(math.cos(math.radians(half_angle_deg)), 1, n), rng.uniform(0, 2 * np.pi, n))
    aside = np.array([1.0, 0.0, 0.0]) if abs(pole[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    east = np.cross(pole, aside)
    east /= np.linalg.norm(east)
    turned: Floats = cap @ np.stack([east, np.cross(pole, east), pole])
    return turned


def clumped_directions(rng: Generator, n: int, *, share: float = 0.6) -> Floats:
    """(n, 3) random directions: first uniform ones, then a `share` of all within one `clump`.

    >>> bool(clumped_directions(np.random.default_rng(0), 10)[-6:].std(axis=0).max() < 0.05)
    True
    """
    together = round(n * share)
    return np.concatenate([uniform_directions(rng, n - together), clump(rng, together)])


def icosahedron() -> tuple[Floats, NDArray[np.intp]]:
    """(12, 3) vertices and (20, 3) vertex indices of the triangles, anticlockwise seen from outside."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    rectangle = np.array([[0.0, a, b * golden] for a in (1.0, -1.0) for b in (1.0, -1.0)])
    vertices = np.concatenate([np.roll(rectangle, turn, axis=1) for turn in range(3)])
    vertices /= np.linalg.norm(vertices[0])
    adjacent = vertices @ vertices.T > 0.4
    triangles = np.array(
        [three for three in combinations(range(12), 3) if all(adjacent[pair] for pair in combinations(three, 2))]
    )
    inward = np.linalg.det(vertices[triangles]) < 0.0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return vertices, triangles


def bisect_edges(vertices: Floats, triangles: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Bisect all edges, which divides each triangle into four."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    unique, where = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    p, q, r = (len(vertices) + where.reshape(-1, 3)).T
    a, b, c = triangles.T
    smaller = np.stack([[a, p, r], [p, b, q], [r, q, c], [p, q, r]])  # (4, 3, T)
    return np.concatenate([vertices, middles]), np.moveaxis(smaller, 1, 2).reshape(-1, 3)


def _vertex_triangles(vertices: Floats, triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    """(642, 6) indices of the triangles around each vertex, anticlockwise; the last of five is repeated."""
    order = np.argsort(triangles.ravel(), kind="stable")
    around = np.split(order // 3, np.cumsum(np.bincount(triangles.ravel()))[:-1])
    middles = vertices[triangles].sum(axis=1)
    rings = np.empty((len(vertices), 6), np.intp)
    for vertex, ring in enumerate(around):
        x, y = _perpendicular(vertices[vertex])
        turned = ring[np.argsort(np.arctan2(middles[ring] @ y, middles[ring] @ x))]
        rings[vertex] = turned if len(turned) == 6 else [*turned, turned[-1]]
    return rings


def _perpendicular(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors perpendicular to a direction, the second 90° anticlockwise of the first seen from its tip."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    x /= np.linalg.norm(x)
    return x, np.cross(direction, x)


def _corners(vertices: Floats, triangles: NDArray[np.intp]) -> Floats:
    """(T, 3) circumcentres of the triangles on the sphere, which are the corners of the tiles."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    corners: Floats = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return corners


def _triangle_angles(centres: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """(642, 6) solid angles of the triangles of a centre and two corners, and (642, 6, 3) sums of their vertices."""
    # Solid angle by van Oosterom and Strackee: tan(Ω/2) = a·(b × c) / (1 + a·b + b·c + c·a).
    following = np.roll(corners, -1, axis=1)
    spanned = np.einsum("ij,ikj->ik", centres, np.cross(corners, following))
    around = 1.0 + np.einsum("ij,ikj->ik", centres, corners + following) + np.einsum("ikj,ikj->ik", corners, following)
    return 2.0 * np.arctan2(spanned, around), corners + following + centres[:, np.newaxis]


def _tile_centroids(centres: Floats, corners: Floats) -> Floats:
    """(642, 3) unit vectors to the centroids of the tiles."""
    angles, sums = _triangle_angles(centres, corners)
    middles = sums / np.linalg.norm(sums, axis=2, keepdims=True)
    sums = np.einsum("ik,ikj->ij", angles, middles)
    centroids: Floats = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return centroids
