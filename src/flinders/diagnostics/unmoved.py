"""Test whether a sensor was hardly turned: all readings lie around one point and show no surface.

Any fit to such readings follows their noise: it finds a well-covered ellipsoid as small as the noise. A small angle
between the readings, as seen from zero, does not prove that the sensor was hardly turned, because with strong iron
nearby readings of a fully turned sensor also lie in one direction. The middle of the cloud distinguishes the two cases.
Readings on a surface, or on a ring or an arc of it, are all far from their mean, in units of their principal standard
deviations. Noise, a slow drift and a wobble give readings near the mean.

>>> import numpy as np
>>> from flinders.summary.summary import Summary
>>> rng = np.random.default_rng(1)
>>> still = [30.0, -20.0, 30.0] + 0.3 * rng.standard_normal((500, 3))
>>> round(unmoved_deg(Summary.of(still), MICROTESLA), 1)
1.5
>>> directions = rng.standard_normal((500, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> unmoved_deg(Summary.of([300.0, 400.0, 0.0] + 50.0 * directions), MICROTESLA) is None      # ten fields of iron
True

The result is the angle that the readings span, as seen from the centre of their sphere. The centre is one field
strength away from the readings, in an unknown direction. If the readings are curved, they determine the sphere. Else
the length of their mean is used as the strength, which is right if the offset is small. In µT this strength is limited
to 22 to 67 µT, the range of the earth's field. Otherwise iron many times stronger than the field would make the angle
too small, and an offset that cancels the field would make it too large. In counts no such limit is known: near iron n
times stronger than the field, the true angle is about n times larger.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import EARTH_FIELD_RANGE_UT, MICROTESLA
from flinders.errors import Unmoved
from flinders.native.engine import engine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flinders.native.layouts import Records
    from flinders.summary.summary import Summary

ANY_FIELD: Final = (0.0, math.inf)
"""Weakest and strongest field if the strength is unknown."""


def require_moved(summary: Summary, unit: str, how: str = "through all directions") -> None:
    """Raise `Unmoved` for readings of a sensor that was hardly turned.

    The error states the angle within which all readings lie, and `how` to turn the sensor.
    """
    angle = unmoved_deg(summary, unit)
    if angle is not None:
        raise Unmoved(angle, how)


def was_turned(records: Records, unit: str, *, weakest: float = EARTH_FIELD_RANGE_UT[0]) -> NDArray[np.bool_]:
    """Whether a record alone proves that a sensor was turned out of one plane and was never at a rail.

    Parameters
    ----------
    records : (U,) of `flinders.native.layouts.RECORD`, or one
    unit : str
        Unit of the readings, ``uT`` or ``counts``.
    weakest : float, µT
        Smallest field that readings are compared with; 0 if a later step refuses noise that resembles a turn.

    Returns
    -------
    (U,) bool, or one
        False if the summary is needed to decide: `unmoved_deg`, rails, a level turn.
    """
    return engine().are_turned(records, (weakest, EARTH_FIELD_RANGE_UT[1]) if unit == MICROTESLA else ANY_FIELD)


def unmoved_deg(summary: Summary, unit: str) -> float | None:
    """Angle in degrees within which all readings lie, if the sensor was hardly turned; None if it was turned.

    `unit` is the unit of the readings, ``uT`` or ``counts``.
    """
    cloud = summary.cloud  # each place counts once, so that a rest within a turn has no more weight than any other
    # place
    strengths = EARTH_FIELD_RANGE_UT if unit == MICROTESLA else ANY_FIELD
    angle = engine().unmoved_deg(cloud.means, float(cloud.counts.sum()), strengths)
    return None if math.isnan(angle) else angle
