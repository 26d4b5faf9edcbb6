"""Whether readings follow a column that was recorded and not asked for: a motor's current makes a good ellipsoid a lie.

With a disturbance c that moves the offset by p for each unit of it, residuals of a fit without it are n·p (c − c̄) for
surface normals n, but for what the nine parameters of the ellipsoid take up. They are regressed on both, and p
counts where it explains far more than correlated residuals could by chance (`disturbance.c`).

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> motors = simulate.MotorCurrent(per_ampere=[0.3, 0.0, 0.0], amperes=20.0)
>>> flight = simulate.tumble(seed=3, disturbances=[motors]).samples
>>> unmodelled = unmodelled_of(flight, calibrate.fit(flight).calibration.ellipsoid, dip_deg=60.0)
>>> unmodelled.name, round(unmodelled.heading_deg)
('current', 6)
>>> unmodelled_of(simulate.tumble(seed=3).samples, calibrate.fit(flight).calibration.ellipsoid, dip_deg=60.0) is None
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import is_column, known
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

FEWEST: Final = 100
"""Fewer say too little."""

PROVEN: Final = 40.0
"""χ² of three, for independent readings, from which a disturbance explains residuals: by chance once in 10⁸."""


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """Something that was recorded beside the readings and moves them, and that the calibration does not follow."""

    name: str  # ``current``, ``throttle`` or ``temperature``
    # by how much it moves the offset for each unit of it, roughly, in the unit of the readings
    per_unit: tuple[float, ...]
    heading_deg: float  # what that makes of a level heading at the far end of its recorded range, at most
    chi_square: float  # how much better residuals are explained with it, for independent readings


def unmodelled_of(
    samples: Samples, ellipsoid: Ellipsoid, *, dip_deg: float, time: float = 1.0, limit: float = math.inf
) -> Unmodelled | None:
    """Look at each disturbance that was recorded; of several the one that explains most.

    Parameters
    ----------
    ellipsoid : Ellipsoid
        A fit that follows none of them.
    time : float
        Readings that say as much as one independent reading.
    limit : float
        Distance from the ellipsoid beyond which readings are outliers.
    """
    kinds = (name for name in samples.disturbances if not is_column(name))
    tests = (_by(samples, name, ellipsoid, dip_deg, time, limit) for name in kinds)
    return max((one for one in tests if one is not None), key=lambda one: one.chi_square, default=None)


def _by(
    samples: Samples, name: str, ellipsoid: Ellipsoid, dip_deg: float, time: float, limit: float
) -> Unmodelled | None:
    """What one disturbance explains; None where it was not recorded, hardly changed, or explains nothing."""
    values = samples.driving(name)
    if values is None:
        return None
    regression = engine().regress(samples.field, values, ellipsoid.centre, ellipsoid.shape, limit=limit)
    used, stride = int(regression["used"]), int(regression["stride"])
    if used < FEWEST or regression["range"] < known(name).least:
        return None
    variance = float(regression["left"]) / max(used - 12, 1)
    time = max(time / stride, min(time, 1.0))
    chi_square = float(regression["explained"]) / max(variance * time, np.finfo(float).tiny)
    if chi_square < PROVEN:
        return None
    per_unit = regression["per_unit"].tolist()
    level = ellipsoid.radius * math.cos(math.radians(dip_deg))
    off = math.hypot(*per_unit) * float(regression["farthest"])
    return Unmodelled(name, tuple(per_unit), math.degrees(math.atan2(off, level)), chi_square)
