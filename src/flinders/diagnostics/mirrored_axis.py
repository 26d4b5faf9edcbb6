"""Whether an axis of the magnetometer has the wrong sign, which makes it left-handed.

Neither a gyro nor the dip shows that by itself. With F the change of sign of one axis, −F turns by 180° about it, and
readings F m are those of a sensor turned by −F in a field −m; that is turned as m is by a gyro, and keeps its angle to
the vertical. What tells the two is the sign of the dip, of which the site knows.

>>> from flinders.likelihood.site_field import Site
>>> mistake = mirrored_axis(-64.1, Site(inclination_deg=64.0), np.diag([1.0, -1.0, -1.0]))
>>> mistake.code, mistake.finding.values["axis"], mistake.finding.values["axes"]
('mirrored-axis', 'x', '-x,y,z')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import nearest_to
from flinders.diagnostics.instruments import STEEP_DEG, Mistake
from flinders.findings import certain
from flinders.geometry.rotation import lengths
from flinders.likelihood import dip

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.site_field import Site

MIRROR_DEG: Final = 10.0
"""How far the dip that a mirrored sensor shows may be off the site's with the other sign: iron and rock are near."""


def mirrored_axis(seen_deg: float, site: Site, rotation: Floats | None) -> Mistake | None:
    """The mistake of an axis with the wrong sign; None where the dip does not show one.

    It does where the dip has the sign of the site's only with that axis turned over.

    Parameters
    ----------
    seen_deg : float
        Dip that the readings show when they are turned by `rotation`.
    rotation : (3, 3) float, optional
        From the axes of the magnetometer to those of the body. Of one nearest to unity, or unknown, nothing is said.
    """
    there = site.inclination_deg or 0.0
    turned = None if rotation is None else nearest_to(rotation)
    if turned is None or turned.is_identity or turned.is_mirror:
        return None
    if not (seen_deg * there < 0.0 and min(abs(seen_deg), abs(there)) > STEEP_DEG):
        return None
    if abs(seen_deg + there) > MIRROR_DEG:
        return None
    mended = turned.opposite
    numbers = {"handedness": -1.0, "dip_deg": seen_deg, "site_dip_deg": there}
    words = {"axis": mended.mirrored_axis, "axes": str(mended), "turned_by": str(turned)}
    return Mistake("site", certain({**numbers, **words, "aid": "site"}, "mirrored-axis"), drops=True)


def middle_dip_deg(samples: Samples, ellipsoid: Ellipsoid, axes: Axes) -> float:
    """Median dip by an accelerometer, which may lean in turns, of a magnetometer whose axes are turned; NaN without."""
    if samples.acceleration is None:
        return math.nan
    down, trust = dip.verticals(samples.acceleration)
    known = trust > 0.0
    field = axes.apply(np.linalg.solve(ellipsoid.shape, (samples.field[known] - ellipsoid.centre).T).T)
    sine = np.einsum("ni,ni->n", down[known], field) / np.maximum(lengths(field), 1e-300)
    return float(np.rad2deg(np.arcsin(np.clip(np.median(sine), -1.0, 1.0)))) if len(sine) else math.nan
