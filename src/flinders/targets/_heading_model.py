"""Quantities in generated code for the standard deviation of a heading at any attitude.

With a reading x of a field m in corrected axes, the corrected field has the error W (δb + δS m/F + n): errors of the
offset b and the shape S, with their covariance, and noise n. Let h be the gradient of the heading by the field, which
is the unit vector across the horizontal field divided by its length, and v = Wᵀ h. The error of the heading is

    v·δb + vᵀ δS m/F + v·n

Its variance is gᵀ C g + σ² |v|², with the nine coefficients g of `flinders.geometry.ellipsoid.parameter_derivatives`. The part of g
that is common to all level headings is a matter of mounting and removed, as in `Claim.level_error`.
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
    """Covariance of a calibration in the form used by code, in the axes of corrected readings."""

    matrix: Floats  #: (3, 3) dimensionless, symmetric: W, from an error of a raw reading to that of the corrected one
    #: (9, 9) upper triangular U with UᵀU = C: of b in the calibration's unit and of S over the field strength F, so
    #: that it takes m for m/F; C itself exceeds the range of float32 if the readings leave much of it undetermined
    factor: Floats
    mean: Floats  #: (9,) rad per unit of b, and rad of S/F: common part of level headings with +z down
    noise: float  #: standard deviation of each axis of a raw reading, in the calibration's unit
    alignment_deg: float  #: of the heading due to the sensor's rotation in its body; zero if none is stated
    #: field at a level vehicle, in the calibration's unit: its horizontal part, and the part along +z or the third axis
    #: of the plane
    level_field: tuple[float, float]
    plane: Plane | None = None  #: plane of a calibration from level turns, whose headings need no accelerometer
