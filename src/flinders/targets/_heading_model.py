"""Numbers for generated code that computes the standard deviation of a heading at any attitude.

Let x be a reading of the field m in corrected axes. The corrected field then has the error W (δb + δS m/F + n), in
which δb and δS are errors of the offset b and the shape S, with their covariance, and n is noise. Let h be the gradient
of the heading with respect to the field, which is the unit vector across the horizontal field divided by the length of
that field, and v = Wᵀ h. The error of the heading is

    v·δb + vᵀ δS m/F + v·n

Its variance is gᵀ C g + σ² |v|², with the nine coefficients g of `flinders.geometry.ellipsoid.parameter_derivatives`.
The part of g that all level headings share is an error of the mounting, and is subtracted as in `Claim.level_error`.
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
    """Covariance of a calibration for generated code, in the axes of corrected readings."""

    #: (3, 3) dimensionless, symmetric: W, which maps an error of a raw reading to one of the corrected reading
    matrix: Floats
    #: (9, 9) upper triangular U with UᵀU = C. C is the covariance of b in the calibration's unit and of S divided by
    #: the field strength F, to be multiplied by m instead of m/F. C itself can exceed the range of float32, if the
    #: readings leave much of it undetermined.
    factor: Floats
    mean: Floats  #: (9,) rad per unit of b, and rad per S/F: part of g that level headings share, for +z down
    noise: float  #: standard deviation of each axis of a raw reading, in the calibration's unit
    alignment_deg: float  #: standard deviation of the heading by the sensor's rotation in its body; 0 if none is stated
    #: field of a level vehicle, in the calibration's unit: its horizontal part, and the part along +z or along the
    #: third axis of the plane
    level_field: tuple[float, float]
    #: plane of a calibration by level turns, whose headings need no accelerometer; else None
    plane: Plane | None = None
