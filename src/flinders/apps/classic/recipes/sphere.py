"""Sphere: offset and radius, no soft iron. Four unknowns.

Minimises Σ (|x|² − 2bᵀx − β)², which is linear in b and β = R² − |b|² [1]_.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.estimators.base import Method
from flinders.estimators.covariance import SPHERE_BASIS
from flinders.estimators.quadric_fit import Frame, make_estimate
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class Sphere:
    """Offset and radius by linear least squares.

    Minimises ``Σ (|x|² − 2 b·x − β)²``; then ``R² = β + |b|²``. Moving or scaling the readings moves
    and scales the solution in the same way.

    Use it for a bare sensor with equal gains, for few readings or poor coverage, and as the base
    line for richer models. With soft iron, its noise estimate is mostly misfit.

    References
    ----------
    .. [1] NXP AN4246 rev. 4 (2015), eq. 11–22; I. Kåsa (1976).

    Examples
    --------
    The worked example of AN4246, in µT; the note prints 155.74, −239.12, 45.83:

    >>> from flinders.estimators.data import Readings
    >>> points = [[167.4, -242.4, 91.7], [140.3, -221.9, 86.8], [152.4, -230.4, -0.6],
    ...           [180.3, -270.6, 71.0], [190.9, -212.4, 62.7], [192.9, -242.4, 17.1]]
    >>> ellipsoid = Sphere().estimate(Readings.of(points)).ellipsoid
    >>> ellipsoid.centre.round(2), round(ellipsoid.radius, 3)
    (array([ 155.74, -239.12,   45.83]), 47.236)
    """

    name: ClassVar[str] = "sphere"
    unknowns: ClassVar[int] = 5
    is_biased: ClassVar[bool] = True

    def estimate(self, readings: Readings) -> Estimate:
        """Fit a sphere.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if the
        readings lie in one plane or on one line, which do not determine a sphere.
        """
        readings.require(self.unknowns, self.name)
        frame = Frame.of(readings)
        normal, right = frame.scatter[6:, 6:], frame.scatter[6:, :3].sum(axis=1)
        if np.linalg.cond(normal) > 1e13:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        half_centre, level = np.split(np.linalg.solve(normal, right), [3])
        centre = half_centre / 2.0
        radius = float(np.sqrt(max(level[0] + centre @ centre, 0.0)))
        if not radius > 0.0:
            raise NotAnEllipsoid((-1.0, -1.0, -1.0), self.name)
        ellipsoid = Ellipsoid(centre, radius * np.eye(3)).in_frame(frame.origin, frame.scale)
        return make_estimate(readings, ellipsoid, self.name, SPHERE_BASIS)


METHOD: Final = Method(
    Sphere,
    use="offset and radius only: a bare sensor, few readings, a baseline",
    source="NXP AN4246, eq. 11–22; Kåsa (1976)",
    is_recipe=True,
)
