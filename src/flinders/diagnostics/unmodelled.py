"""Test whether readings follow a recorded column that the fit does not use, such as a motor's current.

If a disturbance c moves the offset by p per unit, residuals of a fit without it are n·p (c − c̄) for surface normals n,
except for the part that the nine parameters of the ellipsoid absorb. Residuals are regressed on p and these parameters.
p is significant if it explains far more of the residuals than chance does for correlated residuals (`disturbance.c`).

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

from flinders.core.disturbance import is_column, kind_of
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

MIN_READINGS: Final = 100
"""Smallest count of readings for the test."""

MIN_CHI2: Final = 40.0
"""Smallest significant χ² with three degrees of freedom, for independent readings: exceeded by chance once in 10⁸."""


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """A recorded disturbance that changes the readings and that the calibration does not follow."""

    name: str  # ``current``, ``throttle`` or ``temperature``
    # approximate change of the offset per unit of the disturbance, in the unit of the readings
    per_unit: tuple[float, ...]
    heading_deg: float  # largest level heading error at the far end of the disturbance's recorded range
    chi_square: float  # χ² of the residuals that the disturbance explains, for independent readings


def unmodelled_of(
    samples: Samples, ellipsoid: Ellipsoid, *, dip_deg: float, time: float = 1.0, limit: float = math.inf
) -> Unmodelled | None:
    """The recorded disturbance that explains most of the residuals; None if none is significant.

    Parameters
    ----------
    ellipsoid : Ellipsoid
        A fit without disturbances.
    time : float
        Count of readings equivalent to one independent reading.
    limit : float
        Largest distance of an inlier from the ellipsoid.
    """
    kinds = (name for name in samples.disturbances if not is_column(name))
    tests = (_test_disturbance(samples, name, ellipsoid, dip_deg, time, limit) for name in kinds)
    return max((one for one in tests if one is not None), key=lambda one: one.chi_square, default=None)


def _test_disturbance(
    samples: Samples, name: str, ellipsoid: Ellipsoid, dip_deg: float, time: float, limit: float
) -> Unmodelled | None:
    """Test of one disturbance; None if it was not recorded, hardly changed, or explains nothing."""
    values = samples.disturbance_values(name)
    if values is None:
        return None
    regression = engine().regress(samples.field, values, ellipsoid.centre, ellipsoid.shape, limit=limit)
    used, stride = int(regression["used"]), int(regression["stride"])
    if used < MIN_READINGS or regression["range"] < kind_of(name).least:
        return None
    variance = float(regression["left"]) / max(used - 12, 1)
    time = max(time / stride, min(time, 1.0))
    chi_square = float(regression["explained"]) / max(variance * time, np.finfo(float).tiny)
    if chi_square < MIN_CHI2:
        return None
    per_unit = regression["per_unit"].tolist()
    level = ellipsoid.radius * math.cos(math.radians(dip_deg))
    off = math.hypot(*per_unit) * float(regression["farthest"])
    return Unmodelled(name, tuple(per_unit), math.degrees(math.atan2(off, level)), chi_square)
