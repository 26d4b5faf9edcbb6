"""Whether the field, or the iron, changed while the recording was made.

An offset that creeps and a field that grows leave residuals that depend on time and direction together, as

    s = J δθ + t (n · ḃ + n · S u ġ),      −½ ≤ t ≤ ½ over the recording

beside what noise leaves. ḃ and ġ are found by least squares along with the nine parameters, and held against the
scatter that the remaining residuals, as they hang together, would give them by chance.

>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(1000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> field = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> field[:, 0] += np.linspace(-2.0, 2.0, 1000)
>>> found = drift_of(field, Ellipsoid(np.zeros(3), 50.0 * np.eye(3)))
>>> round(found.offset[0], 1), round(found.heading_deg, -1), found.p_value < 0.001
(4.0, 10.0, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.coverage import directions_of
from flinders.estimators.correlation import Residuals, time_of
from flinders.heading import level_error
from flinders.pooling import chance_of, chi_square_of
from flinders.quadric import Ellipsoid, upper
from flinders.result import Drift
from flinders.terms import magnitude

if TYPE_CHECKING:
    from flinders.arrays import Floats

FEWEST, FEWEST_INDEPENDENT = 100, 20
"""Readings, and independent ones beyond those that the parameters take, below which a drift is not told from chance."""


def drift_of(readings: Floats, ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> Drift | None:
    """Look for a steady change in (N, 3) readings, in the order of recording; None where they are too few."""
    if len(readings) < FEWEST:
        return None
    jacobian = magnitude.information(directions_of(readings, ellipsoid), ellipsoid)
    time = np.linspace(-0.5, 0.5, len(readings))[:, np.newaxis]
    growth = jacobian[:, 3:] @ upper(ellipsoid.shape)
    rows = np.column_stack([jacobian, time * jacobian[:, :3], time[:, 0] * growth])
    scale = np.sqrt(np.mean(rows**2, axis=0))
    scale[scale == 0.0] = 1.0
    rows /= scale
    distances = magnitude.distances(readings, ellipsoid)
    try:
        inverse = np.linalg.inv(rows.T @ rows)
    except np.linalg.LinAlgError:  # time and direction are one and the same
        return None
    found = inverse @ (rows.T @ distances)
    left = Residuals(distances - rows @ found, rows, [np.arange(len(readings))])
    autocovariance = left.autocovariance()
    independent = len(readings) / time_of(autocovariance) - rows.shape[1]
    if independent < FEWEST_INDEPENDENT:
        return None
    covariance = inverse @ left.scatter(autocovariance) @ inverse
    change = found[9:] / scale[9:]
    spread = covariance[9:, 9:] / np.outer(scale[9:], scale[9:])
    moved = np.concatenate([change[:3], np.zeros(6)])
    return Drift(
        offset=(float(change[0]), float(change[1]), float(change[2])),
        strength=float(change[3]),
        heading_deg=level_error(ellipsoid, np.outer(moved, moved), dip_deg=dip_deg).worst,
        p_value=chance_of(*chi_square_of(change, spread), independent),
    )
