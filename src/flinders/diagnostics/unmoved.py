"""Whether a sensor was hardly turned: all readings lie around one point, and none of them shows a surface.

Any fit to such readings follows their noise: it finds an ellipsoid as small as the noise, all of whose sides were
seen. A fully turned sensor beside strong iron also points in one direction, seen from zero, so a small angle alone
proves nothing. What tells the two apart is the middle of the cloud. Readings on a surface, or on a ring or an arc of
it, leave their mean empty: in units of their principal standard deviations none comes close to it. Noise, a slow
drift and a wobble fill it.

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

import numpy as np

from flinders.core.units import EARTH_UT, MICROTESLA
from flinders.errors import Unmoved
from flinders.geometry.ellipsoid import sphere_through
from flinders.summary.summary import FLATTEST, Summary

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.native.engine import Records
    from flinders.summary.cloud import Cloud

FEWEST: Final = 20
"""Fewer readings than this are too few for a fit to be asked for, and to tell a cloud from a surface."""

NARROW, TAILS = 0.06, 4.0
"""Standard deviation along the longest axis over the level: uniform over a cap, 7° on either side. And how many of
those the farthest reading may be off the mean, or else `NEAR` of the level: beyond both it is an outlier, or a turn."""

NARROW_BALL, TAILS_BALL = 0.2, 6.0
"""The same of a cloud about as thick as it is wide: noise of a fifth of the field is refused anyway, and has tails."""

BALL: Final = 0.5
"""Thickness over width of such a cloud."""

NEAR: Final = 0.15
"""Of the level, 9°."""

CLOSE, FILLED = 0.25, 0.03
"""A reading is in the middle whose squared distance from the mean, in principal standard deviations, is below `CLOSE`
for each axis; the cloud is filled with such a share of them. Of a Gaussian cloud 14 % are, of a flat one 6 % or more,
of a surface, a ring or an arc none."""

POINT: Final = 0.06
"""Farthest reading over the level: below it no turn in the earth's field fits, whatever its shape."""

COARSE, OFTEN = 8, 4.0
"""Values of an axis, and readings in each place: a cloud of so few and so many is a reading that flickers by counts."""

THIN: Final = 0.05
"""Thickness over width of an axis that is left out: a filled cap as flat as that is at most 10° on either side,
wherever its centre lies."""

SPHERICAL, CURVED = 0.2, 0.85
"""A cloud shows that it curves where the places lie so much closer to a sphere than the radius of that is long, and
than they lie to a plane; or, in their main plane, to a circle than to a line."""

MOST_IRON: Final = 0.04
"""Radius of such a curve over the mean reading: below it no offset is that large, and it is that of a drift."""

ROUNDING: Final = 1e-9
"""Of the largest reading: what varies by less does not vary."""

SMALLEST, LARGEST = 1e-12, 1e15
"""Between these sizes squares are numbers."""


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
    records : (U,) of `flinders.native.engine.RECORD`, or one
    unit : str
        Of the readings, ``uT`` or ``counts``.
    weakest : float, µT
        Least field that readings are compared with; 0 where noise that looks like a turn is refused later on.

    Returns
    -------
    (U,) bool, or one
        False where the summary has to be asked: `unmoved_deg`, rails, a level turn.
    """
    (thinnest, _, widest), (x, y, z) = records["principal_variances"].T, records["mean"].T
    size = np.sqrt(x * x + y * y + z * z)
    level = np.minimum(np.maximum(size, weakest), EARTH_UT[1]) if unit == MICROTESLA else size
    is_wide = widest > (NARROW_BALL * level) ** 2
    is_thick = thinnest > FLATTEST**2 * widest
    turned: NDArray[np.bool_] = is_wide & is_thick & (records["rails"] == 0)
    return turned


def unmoved_deg(summary: Summary, unit: str) -> float | None:
    """Angle within which all readings of a sensor lie that was hardly turned; None of one that was.

    `unit`: of the readings, ``uT`` or ``counts``.
    """
    means = summary.cloud.means  # each place counts once, so that a rest amid a turn weighs no more than its place
    if len(summary) < FEWEST or not SMALLEST < float(np.abs(means).max()) < LARGEST:
        return None
    mean = means.mean(axis=0)
    size, apart = float(np.linalg.norm(mean)), means - mean
    reach = float(np.linalg.norm(apart, axis=1).max())
    if not reach > ROUNDING * size > 0.0:
        return None
    level = min(max(size, EARTH_UT[0]), EARTH_UT[1]) if unit == MICROTESLA else size
    is_point = unit == MICROTESLA and size >= EARTH_UT[0] and reach < POINT * level
    if not is_point and not _is_narrow(apart, level):  # and to a lower level it is wider still
        return None
    radius = _radius_seen(apart)
    if not is_point and not _is_coarse(summary.cloud) and radius > MOST_IRON * size:
        level = min(level, radius)
    if is_point or (_is_narrow(apart, level) and (_is_filled(apart) or _is_coarse(summary.cloud))):
        return math.degrees(math.atan2(reach, level))
    return None


def _deviations(apart: Floats) -> tuple[Floats, Floats]:
    """(3,) ascending standard deviations of (K, 3) places about their mean along principal axes; (3, 3) these."""
    variances, axes = np.linalg.eigh(apart.T @ apart / len(apart))
    return np.sqrt(variances.clip(min=0.0)), axes


def _is_narrow(apart: Floats, level: float) -> bool:
    """Whether a cloud is small beside the distance of its centre, and none of its places far off the others."""
    thickness, _, width = _deviations(apart)[0].tolist()
    reach = float(np.linalg.norm(apart, axis=1).max())
    limit, tails = (NARROW_BALL, TAILS_BALL) if thickness > BALL * width else (NARROW, TAILS)
    return bool(width < limit * level and reach < max(tails * width, NEAR * level))


def _is_filled(apart: Floats) -> bool:
    """Whether some places of a cloud are near their mean, along the axes in which it is not thin."""
    deviations, axes = _deviations(apart)
    thick = deviations > THIN * deviations[2]
    in_units = (apart @ axes[:, thick]) / deviations[thick]
    close = np.einsum("ij,ij->i", in_units, in_units) < CLOSE * in_units.shape[1]
    return float(np.mean(close)) > FILLED


def _radius_seen(apart: Floats) -> float:
    """Radius of the sphere or, of an arc, of the circle through places; infinite where they do not show a curve."""
    deviations, axes = _deviations(apart)
    sphere = _radius(apart, float(deviations[0]))
    return min(sphere, _radius(apart @ axes[:, 1:], float(deviations[1])))


def _radius(apart: Floats, thickness: float) -> float:
    """Radius of the sphere through (K, k) places, unless they lie as close to a plane, but for their thickness."""
    centre, radius = sphere_through(apart)
    noise = float(np.std(np.linalg.norm(apart - centre, axis=1)))
    return radius if noise < min(SPHERICAL * radius, CURVED * thickness) else np.inf


def _is_coarse(cloud: Cloud) -> bool:
    """Whether readings take a few values only on each axis, and each place many times."""
    if len(cloud) > COARSE**3 or cloud.counts.sum() < OFTEN * len(cloud):
        return False
    return all(_values(axis) <= COARSE for axis in cloud.means.T)


def _values(column: Floats) -> int:
    """How many different values there are, but for rounding."""
    ordered = np.sort(column)
    return 1 + int(np.count_nonzero(np.diff(ordered) > ROUNDING * float(np.abs(ordered).max())))
