"""Directions of the field, for recordings in which no one asks how the body came to see them.

>>> uniform(np.random.default_rng(0), 3).shape
(3, 3)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.summary.coverage import around_z

if TYPE_CHECKING:
    from numpy.random import Generator

    from flinders.arrays import Floats


def uniform(rng: Generator, n: int) -> Floats:
    """(n, 3) directions, all alike.

    >>> bool(np.abs(uniform(np.random.default_rng(0), 10_000).mean(axis=0)).max() < 0.02)
    True
    """
    vector = rng.standard_normal((n, 3))
    unit: Floats = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


def hemisphere(rng: Generator, n: int) -> Floats:
    """(n, 3) directions with z ≥ 0: of a sensor that is never turned over, where the field points down.

    >>> bool(hemisphere(np.random.default_rng(0), 1000)[:, 2].min() >= 0)
    True
    """
    directions = uniform(rng, n)
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def clump(rng: Generator, n: int, *, half_angle_deg: float = 3.0) -> Floats:
    """(n, 3) directions within a small angle of one that is drawn first.

    >>> close = clump(np.random.default_rng(0), 100)
    >>> bool(np.degrees(np.arccos((close @ close.T).min())) < 6)
    True
    """
    pole = uniform(rng, 1)[0]
    near = around_z(rng.uniform(math.cos(math.radians(half_angle_deg)), 1, n), rng.uniform(0, 2 * np.pi, n))
    aside = np.array([1.0, 0.0, 0.0]) if abs(pole[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    east = np.cross(pole, aside)
    east /= np.linalg.norm(east)
    turned: Floats = near @ np.stack([east, np.cross(pole, east), pole])
    return turned


def clumped(rng: Generator, n: int, *, share: float = 0.6) -> Floats:
    """(n, 3) directions: all alike first, then a `share` of them in one `clump`.

    >>> bool(clumped(np.random.default_rng(0), 10)[-6:].std(axis=0).max() < 0.05)
    True
    """
    together = round(n * share)
    return np.concatenate([uniform(rng, n - together), clump(rng, together)])
