"""Whether the field, or the iron, changed while the recording was made.

An offset that creeps and a field that grows leave residuals that depend on time and direction together, as

    s = J δθ + t (n · ḃ + n · S u ġ),      −½ ≤ t ≤ ½ over the recording

beside what noise leaves. ḃ and ġ are found by least squares along with the nine parameters, and compared with the
scatter that the remaining residuals, as they are correlated, would give them by chance. A sensor that is turned from
pole to pole along a spiral has time and direction in one: what only noise tells apart there is left out
(`flinders.likelihood.identifiability`).

>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(1000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> field = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> field[:, 0] += np.linspace(-2.0, 2.0, 1000)
>>> drift = drift_of(field, Ellipsoid(np.zeros(3), 50.0 * np.eye(3)))
>>> round(drift.offset[0], 1), round(drift.heading_deg, -1), drift.p_value < 0.001
(4.0, 10.0, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.covariance import Residuals, time_of
from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.heading.error_propagation import level_error
from flinders.likelihood import magnitude
from flinders.likelihood.equations import FINEST
from flinders.likelihood.identifiability import Support, turning
from flinders.summary.coverage import directions_of
from flinders.summary.pooling import chance_of, chi_square_of

if TYPE_CHECKING:
    from flinders.arrays import Floats

FEWEST, FEWEST_INDEPENDENT = 100, 20
"""Readings, and independent ones beyond those that the parameters take, below which a drift is not told from chance."""

LEAST_SHARE: Final = 0.1
"""Part that a change has in a direction of which readings say nothing, from which on it is not told."""


@dataclass(frozen=True, slots=True)
class Drift:
    """A steady change over a recording, from its beginning to its end.

    Attributes
    ----------
    offset : (3,) float
        In the unit of the readings.
    strength : float
        Of the field, as a fraction of it.
    heading_deg : float
        What the change of the offset does to a level heading, at the worst heading.
    p_value : float
        How often chance alone makes as much.
    """

    offset: tuple[float, float, float]
    strength: float
    heading_deg: float
    p_value: float


def drift_of(readings: Floats, ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> Drift | None:
    """Look for a steady change in (N, 3) readings, in the order of recording; None where nothing can be told of it."""
    if len(readings) < FEWEST:
        return None
    directions = directions_of(readings, ellipsoid)
    pointing = directions.any(axis=1)  # a reading right in the centre has no direction
    time = np.linspace(-0.5, 0.5, len(readings))[pointing]
    readings, directions = readings[pointing], directions[pointing]
    distances = magnitude.distances(readings, ellipsoid)
    rows = _with_change(magnitude.information(directions, ellipsoid), time, ellipsoid)
    variance = max(float(np.mean(distances**2)), (FINEST * ellipsoid.radius) ** 2)

    def spurious() -> Floats:
        each = (_with_change(turned, time, ellipsoid) for turned in turning(directions, ellipsoid))
        total: Floats = np.sum([noise.T @ noise for noise in each], axis=0)
        return total

    support = Support.of(rows.T @ rows / variance, spurious)
    observed = _observed(support.vectors[9:, ~support.seen])
    if not observed.any():
        return None
    axes = support.vectors[:, support.seen]
    inverse = axes / (variance * support.values[support.seen]) @ axes.T
    rows /= support.scale
    solution = inverse @ (rows.T @ distances)
    left = Residuals(distances - rows @ solution, rows, [np.arange(len(readings))])
    autocovariance = left.autocovariance()
    independent = len(readings) / time_of(autocovariance) - rows.shape[1]
    if independent < FEWEST_INDEPENDENT:
        return None
    observed /= support.scale[9:, np.newaxis]
    covariance = inverse @ left.scatter(autocovariance) @ inverse
    change, spread = observed @ solution[9:], observed @ covariance[9:, 9:] @ observed.T
    moved = np.concatenate([change[:3], np.zeros(6)])
    return Drift(
        offset=(float(change[0]), float(change[1]), float(change[2])),
        strength=float(change[3]),
        heading_deg=level_error(ellipsoid, np.outer(moved, moved), dip_deg=dip_deg).worst,
        p_value=chance_of(*chi_square_of(change, spread), independent),
    )


def _with_change(jacobian: Floats, time: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 13) rows of the nine parameters (N, 9), and of what changes with (N,) time."""
    growth = jacobian[:, 3:] @ upper(ellipsoid.shape)
    return np.column_stack([jacobian, time[:, np.newaxis] * jacobian[:, :3], time * growth])


def _observed(unobserved: Floats) -> Floats:
    """(4, 4) projection of changes on those that no direction (4, K) takes part in of which readings say nothing."""
    axes, shares, _ = np.linalg.svd(unobserved)
    taken = axes[:, : len(shares)][:, shares > LEAST_SHARE]
    observed: Floats = np.eye(4) - taken @ taken.T
    return observed if taken.shape[1] < 4 else np.zeros((4, 4))
