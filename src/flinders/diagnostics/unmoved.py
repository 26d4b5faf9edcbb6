"""Whether a sensor was hardly turned: all readings lie around one point, and none of them shows a surface.

Any fit to such readings follows their noise: it finds an ellipsoid as small as the noise, all of whose sides were
seen. A fully turned sensor beside strong iron also points in one direction, seen from zero, so a small angle alone
proves nothing. What tells the two apart is the middle of the cloud. Readings on a surface, or on a ring or an arc of
it, leave their mean empty: in units of their principal standard deviations none comes close to it. Noise, a slow
drift and a wobble fill it.

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

The angle is that at which the readings are seen from the centre of the sphere that they belong to. That centre lies
the strength of the field away from them, in whatever direction. Where the readings show how far they curve, their
sphere is known. Else the size of their mean stands for the strength, which is right as long as the offset is small; in
microtesla it is taken for 22 to 67, between which the earth's field lies, so that iron of many field strengths does
not make the angle small, nor an offset that cancels the field make it large. Of counts nothing but their mean is
known: beside strong iron, the true angle is as many times larger as the iron is stronger than the field.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import EARTH_UT, MICROTESLA
from flinders.errors import Unmoved
from flinders.native.engine import engine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flinders.native.layouts import Records
    from flinders.summary.summary import Summary

UNKNOWN: Final = (0.0, math.inf)
"""Weakest and strongest field where nothing is known of it."""


def require_moved(summary: Summary, unit: str, how: str = "through all directions") -> None:
    """Refuse readings of a sensor that was hardly turned.

    Raises `Unmoved`, which says within which angle all of them lie, and `how` the sensor has to be turned.
    """
    angle = unmoved_deg(summary, unit)
    if angle is not None:
        raise Unmoved(angle, how)


def was_turned(records: Records, unit: str, *, weakest: float = EARTH_UT[0]) -> NDArray[np.bool_]:
    """Whether a record alone shows a sensor that was turned out of one plane, and was at no rail.

    Parameters
    ----------
    records : (U,) of `flinders.native.layouts.RECORD`, or one
    unit : str
        Of the readings, ``uT`` or ``counts``.
    weakest : float, µT
        Least field that readings are compared with; 0 where noise that looks like a turn is refused later on.

    Returns
    -------
    (U,) bool, or one
        False where the summary has to be asked: `unmoved_deg`, rails, a level turn.
    """
    return engine().turned(records, (weakest, EARTH_UT[1]) if unit == MICROTESLA else UNKNOWN)


def unmoved_deg(summary: Summary, unit: str) -> float | None:
    """Angle within which all readings of a sensor lie that was hardly turned; None of one that was.

    `unit`: of the readings, ``uT`` or ``counts``.
    """
    cloud = summary.cloud  # each place counts once, so that a rest amid a turn weighs no more than its place
    strengths = EARTH_UT if unit == MICROTESLA else UNKNOWN
    angle = engine().unmoved_deg(cloud.means, float(cloud.counts.sum()), strengths)
    return None if math.isnan(angle) else angle
