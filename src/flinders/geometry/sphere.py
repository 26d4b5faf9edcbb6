"""The sphere in 642 near-hexagonal tiles, on which a predicted error is drawn.

The vertices of an icosahedron whose edges are cut in 8, moved until each is the centroid of its own
tile (Lloyd 1982), and the tiles around them: 630 hexagons and 12 pentagons, about 8° wide. Tile `i`
holds the directions that are nearer to centre `i` than to any other, so that no direction is in two
tiles or in none.

>>> tiles().centres.shape, [len(corners) for corners in tiles().polygons()].count(5)
((642, 3), 12)
>>> tile_of(tiles().centres[[7, 400]])
array([  7, 400])
>>> tile_of([[0.0, 0.0, 1.0]]) == tile_of([[0.0, 0.0, 50.0]])             # lengths do not matter
array([ True])

How even they are: hexagons are within 8 % of the mean area, pentagons 18 % smaller
(`tests/laws/test_tile_laws.py`).

Source: S. P. Lloyd, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 28 (1982) 129–137, §IV, on the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import table

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats

COUNT: Final = 642
BISECTIONS: Final = 3
"""Edges of the icosahedron are halved so often."""
ROUNDS: Final = 20
"""Moves of all centres onto their centroids; the areas change by less than a hundredth after that."""
BLOCK: Final = 4096
"""Directions looked up at a time: the table of their distances to all centres stays in the cache's reach."""


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """Centres and corners.

    Attributes
    ----------
    centres : (642, 3) float
        Unit vectors.
    corners : (642, 6, 3) float
        Unit vectors, anticlockwise seen from outside; of a pentagon the last is there twice.
    """

    centres: Floats
    corners: Floats

    def polygons(self) -> list[Floats]:
        """The corners of each tile, (5, 3) or (6, 3)."""
        return [ring[:5] if np.array_equal(ring[4], ring[5]) else ring for ring in self.corners]

    @property
    def areas(self) -> Floats:
        """(642,) solid angles, which sum to 4π."""
        areas: Floats = _fans(self.centres, self.corners)[0].sum(axis=1)
        return areas


@lru_cache(maxsize=1)
def tiles() -> Tiles:
    """The tiles, always the same; read-only."""
    centres, triangles = _icosahedron()
    for _ in range(BISECTIONS):
        centres, triangles = _bisected(centres, triangles)
    rings = _rings(centres, triangles)
    for _ in range(ROUNDS):
        centres = _centroids(centres, _corners(centres, triangles)[rings])
    corners = _corners(centres, triangles)[rings]
    centres.flags.writeable = corners.flags.writeable = False
    return Tiles(centres, corners)


def tile_of(directions: ArrayLike) -> NDArray[np.intp]:
    """(N,) which tile each of (N, 3) directions of any length falls in.

    Raises
    ------
    ArrayError
        For another shape, or what is not finite.
    """
    vectors = table(directions)
    centres = tiles().centres.T.astype(np.float32)
    tile = np.empty(len(vectors), np.intp)
    for start in range(0, len(vectors), BLOCK):
        block = vectors[start : start + BLOCK]
        lengths = np.linalg.norm(block, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
        tile[start : start + BLOCK] = np.argmax((block / lengths).astype(np.float32) @ centres, axis=1)
    return tile


def _icosahedron() -> tuple[Floats, NDArray[np.intp]]:
    """(12, 3) vertices and (20, 3) triangles, anticlockwise seen from outside."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    rectangle = np.array([[0.0, a, b * golden] for a in (1.0, -1.0) for b in (1.0, -1.0)])
    vertices = np.concatenate([np.roll(rectangle, turn, axis=1) for turn in range(3)])
    vertices /= np.linalg.norm(vertices[0])
    near = vertices @ vertices.T > 0.4
    triangles = np.array(
        [three for three in combinations(range(12), 3) if all(near[pair] for pair in combinations(three, 2))]
    )
    inward = np.linalg.det(vertices[triangles]) < 0.0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return vertices, triangles


def _bisected(vertices: Floats, triangles: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Halve all edges: four triangles for each."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    unique, where = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    p, q, r = (len(vertices) + where.reshape(-1, 3)).T
    a, b, c = triangles.T
    smaller = np.stack([[a, p, r], [p, b, q], [r, q, c], [p, q, r]])  # (4, 3, T)
    return np.concatenate([vertices, middles]), np.moveaxis(smaller, 1, 2).reshape(-1, 3)


def _rings(vertices: Floats, triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    """(642, 6) the triangles around each vertex, anticlockwise; where there are five, the last is there twice."""
    order = np.argsort(triangles.ravel(), kind="stable")
    around = np.split(order // 3, np.cumsum(np.bincount(triangles.ravel()))[:-1])
    middles = vertices[triangles].sum(axis=1)
    rings = np.empty((len(vertices), 6), np.intp)
    for vertex, ring in enumerate(around):
        x, y = _across(vertices[vertex])
        turned = ring[np.argsort(np.arctan2(middles[ring] @ y, middles[ring] @ x))]
        rings[vertex] = turned if len(turned) == 6 else [*turned, turned[-1]]
    return rings


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Two directions across one, which turn anticlockwise seen from its tip."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    x /= np.linalg.norm(x)
    return x, np.cross(direction, x)


def _corners(vertices: Floats, triangles: NDArray[np.intp]) -> Floats:
    """(T, 3) the points as far from each of a triangle's vertices, which are the corners of tiles."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    corners: Floats = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return corners


def _fans(centres: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """(642, 6) solid angles of the triangles from a centre to two corners, and (642, 6, 3) sums of their vertices.

    The angle is van Oosterom's and Strackee's: tan(Ω/2) = a·(b × c) / (1 + a·b + b·c + c·a).
    """
    following = np.roll(corners, -1, axis=1)
    spanned = np.einsum("ij,ikj->ik", centres, np.cross(corners, following))
    around = 1.0 + np.einsum("ij,ikj->ik", centres, corners + following) + np.einsum("ikj,ikj->ik", corners, following)
    return 2.0 * np.arctan2(spanned, around), corners + following + centres[:, np.newaxis]


def _centroids(centres: Floats, corners: Floats) -> Floats:
    """(642, 3) unit vectors to the centroids of the tiles."""
    angles, sums = _fans(centres, corners)
    middles = sums / np.linalg.norm(sums, axis=2, keepdims=True)
    sums = np.einsum("ik,ikj->ij", angles, middles)
    centroids: Floats = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return centroids
