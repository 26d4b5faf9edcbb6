"""What generated code needs for the standard deviation of a heading at any attitude.

A reading x of a field m, in corrected axes, has the error W (δb + δS m/F + n) of the corrected field: of the offset b
and the shape S, by their covariance, and of noise n. With h the gradient of the heading by the field, which is the unit
vector across the horizontal field over its length, and v = Wᵀ h, the heading errs by

    v·δb + vᵀ δS m/F + v·n

whose variance is gᵀ C g + σ² |v|², g the nine coefficients of `flinders.geometry.ellipsoid.gathered`. The part of g
that all level headings have in common is a matter of mounting and removed, as in `Claim.level_error`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flinders.core.short_repr import ShortRepr

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.plane import Plane


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class HeadingModel(ShortRepr):
    """Covariance of a calibration as code uses it: all of it in the axes of corrected readings."""

    matrix: Floats  #: (3, 3) dimensionless, symmetric: W, from an error of a raw reading to that of the corrected one
    #: (9, 9) upper triangular U, UᵀU = C: of b in the calibration's unit and of S over the field strength F, so that it
    #: takes m for m/F; single precision has no room for C itself where the readings leave much of it open
    factor: Floats
    mean: Floats  #: (9,) rad per unit of b, and rad of S/F: what headings have in common while level with +z down
    noise: float  #: standard deviation of each axis of a raw reading, in the calibration's unit
    alignment_deg: float  #: of the heading by the rotation of the sensor in its body; zero where none is stated
    #: field that a level vehicle meets, in the calibration's unit: its horizontal part, and that along +z or
    #: the third axis of the plane
    level_field: tuple[float, float]
    plane: Plane | None = None  #: of a calibration of level turns, whose headings need no accelerometer
