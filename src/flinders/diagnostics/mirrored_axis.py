"""Test whether an axis of the magnetometer has the wrong sign, which makes its axes left-handed.

Neither a gyro nor a constant dip excludes such an axis. Let F reverse the sign of one axis; then −F is a rotation by
180° about this axis. The readings F m are those of a sensor that is rotated by −F in a field −m. A gyro explains the
change of −m as well as that of m, and the angle of −m to the vertical is also constant. Only the sign of the dip, known
from the site, shows the wrong sign.

>>> from flinders.likelihood.site_field import Site
>>> mistake = mirrored_axis(-64.1, Site(inclination_deg=64.0), np.diag([1.0, -1.0, -1.0]))
>>> mistake.code, mistake.finding.values["axis"], mistake.finding.values["axes"]
('mirrored-axis', 'x', '-x,y,z')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import nearest_axes
from flinders.diagnostics.instruments import MIN_SIGNED_DIP_DEG, Mistake
from flinders.findings import certain_finding
from flinders.geometry.rotation import lengths
from flinders.likelihood import dip

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.site_field import Site

MAX_DIP_DIFFERENCE_DEG: Final = 10.0
"""Largest difference in degrees of a mirrored sensor's dip from the negated dip of the site, by iron or rock nearby."""


def mirrored_axis(seen_deg: float, site: Site, rotation: Floats | None) -> Mistake | None:
    """Mistake of an axis with the wrong sign; None without one.

    An axis has the wrong sign if the dip has the sign of the site's dip only after the sign of this axis is reversed.

    Parameters
    ----------
    seen_deg : float
        Dip of the readings rotated by `rotation`.
    rotation : (3, 3) float, optional
        Rotation from the axes of the magnetometer to those of the body. The result is None if the rotation is unknown,
        or nearer to the identity than to a half turn about an axis.
    """
    there = site.inclination_deg or 0.0
    turned = None if rotation is None else nearest_axes(rotation)
    if turned is None or turned.is_identity or turned.is_mirror:
        return None
    if not (seen_deg * there < 0.0 and min(abs(seen_deg), abs(there)) > MIN_SIGNED_DIP_DEG):
        return None
    if abs(seen_deg + there) > MAX_DIP_DIFFERENCE_DEG:
        return None
    mended = turned.opposite
    numbers = {"handedness": -1.0, "dip_deg": seen_deg, "site_dip_deg": there}
    words = {"axis": mended.mirrored_axis, "axes": str(mended), "turned_by": str(turned)}
    return Mistake("site", certain_finding({**numbers, **words, "aid": "site"}, "mirrored-axis"), drops=True)


def median_dip_deg(samples: Samples, ellipsoid: Ellipsoid, axes: Axes) -> float:
    """Median dip in degrees of a magnetometer with the mapping `axes`, by an accelerometer; NaN without one.

    The median is hardly changed by an accelerometer that leans in turns.
    """
    if samples.acceleration is None:
        return math.nan
    down, trust = dip.accelerometer_verticals(samples.acceleration)
    known = trust > 0.0
    field = axes.apply(np.linalg.solve(ellipsoid.shape, (samples.field[known] - ellipsoid.centre).T).T)
    sine = np.einsum("ni,ni->n", down[known], field) / np.maximum(lengths(field), 1e-300)
    return float(np.rad2deg(np.arcsin(np.clip(np.median(sine), -1.0, 1.0)))) if len(sine) else math.nan
