"""Whether readings follow a column that was recorded and not asked for: a motor's current makes a good ellipsoid a lie.

With a disturbance c that moves the offset by p for each unit of it, residuals of a fit without it are n·p (c − c̄) for
surface normals n, but for what the nine parameters of the ellipsoid take up. They are regressed on both, and p
counts where it explains far more than correlated residuals could by chance.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> motors = simulate.MotorCurrent(per_ampere=[0.3, 0.0, 0.0], amperes=20.0)
>>> flight = simulate.tumble(seed=3, disturbances=[motors]).samples
>>> unmodelled = unmodelled_of(flight, calibrate.fit(flight).ellipsoid, dip_deg=60.0)
>>> unmodelled.name, round(unmodelled.heading_deg)
('current', 6)
>>> unmodelled_of(simulate.tumble(seed=3).samples, calibrate.fit(flight).ellipsoid, dip_deg=60.0) is None
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import known
from flinders.likelihood import magnitude
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

MOST: Final = 5_000
"""Readings that are looked at, spread evenly over the recording."""

FEWEST: Final = 100
"""Fewer say too little."""

PROVEN: Final = 40.0
"""χ² of three, for independent readings, from which a disturbance explains residuals: by chance once in 10⁸."""


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """Something that was recorded beside the readings and moves them, and that the calibration does not follow.

    Attributes
    ----------
    name : str
        ``current``, ``throttle`` or ``temperature``.
    per_unit : tuple of float
        By how much it moves the offset for each unit of it, roughly, in the unit of the readings.
    heading_deg : float
        What that makes of a level heading at the far end of its recorded range, at most.
    chi_square : float
        How much better residuals are explained with it, for independent readings.
    """

    name: str
    per_unit: tuple[float, ...]
    heading_deg: float
    chi_square: float


def unmodelled_of(samples: Samples, ellipsoid: Ellipsoid, *, dip_deg: float, time: float = 1.0) -> Unmodelled | None:
    """Look at each disturbance that was recorded; of several the one that explains most.

    Parameters
    ----------
    samples : Samples
    ellipsoid : Ellipsoid
        A fit that follows none of them.
    dip_deg : float
    time : float
        Readings that say as much as one independent reading.
    """
    stride = max(1, -(-len(samples) // MOST))
    some, time = samples[::stride], max(time / stride, min(time, 1.0))
    tests = [one for name in samples.disturbances if (one := _by(some, name, ellipsoid, dip_deg, time)) is not None]
    return max(tests, key=lambda one: one.chi_square, default=None)


def _by(samples: Samples, name: str, ellipsoid: Ellipsoid, dip_deg: float, time: float) -> Unmodelled | None:
    """What one disturbance explains; None where it was not recorded, hardly changed, or explains nothing."""
    values = samples.driving(name)
    if values is None:
        return None
    finite = np.isfinite(values)
    values, field = values[finite], samples.field[finite]
    if len(values) < FEWEST or np.ptp(values) < known(name).least:
        return None
    about = values - values.mean()
    jacobian = magnitude.information(directions_of(field, ellipsoid), ellipsoid)
    residuals = magnitude.distances(field, ellipsoid)
    design = np.hstack([jacobian, jacobian[:, :3] * about[:, np.newaxis]])
    explained, left = _explained(design, residuals)
    variance = left / max(len(values) - 12, 1)
    chi_square = explained / max(variance * time, np.finfo(float).tiny)
    if chi_square < PROVEN:
        return None
    step = _factors(design, residuals)
    level = ellipsoid.radius * math.cos(math.radians(dip_deg))
    off = float(np.linalg.norm(step[9:])) * float(np.abs(about).max())
    return Unmodelled(name, tuple(step[9:].tolist()), math.degrees(math.atan2(off, level)), chi_square)


def _explained(design: Floats, values: Floats) -> tuple[float, float]:
    """Sum of squares of (N,) values that the last three of (N, 12) columns explain beyond the others, and what is left.

    Both stand in the last column of one triangular factor, as the values' parts along each further direction.
    """
    triangle = np.asarray(np.linalg.qr(np.column_stack([design / _lengths(design), values]), mode="r"))
    squares = triangle[:, -1] ** 2
    return float(squares[9:12].sum()), float(squares[12:].sum())


def _factors(design: Floats, values: Floats) -> Floats:
    """(K,) by which columns (N, K) make most of (N,) values."""
    scale = _lengths(design)
    factors: Floats = np.linalg.lstsq(design / scale, values, rcond=1e-9)[0] / scale
    return factors


def _lengths(design: Floats) -> Floats:
    """(K,) lengths of columns; 1 for those of zeros."""
    lengths: Floats = np.sqrt(np.einsum("ij,ij->j", design, design))
    return np.where(lengths == 0.0, 1.0, lengths)
