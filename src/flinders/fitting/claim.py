"""The claim of a calibration: its covariance, and the errors of heading and direction that follow from it.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> claim = calibrate.fit(simulate.tumble(seed=1).samples).claim
>>> claim.heading_error_deg, round(claim.heading_bound_deg, 2), claim.attitude_limit_deg
(HeadingError(rms=0.06°, worst=0.07°, dip=60°), 0.16, 180.0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.calibration_file import PARAMETERS
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.short_repr import ShortRepr
from flinders.errors import ArrayError
from flinders.findings.headline import Claimed, error_words
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import (
    DirectionError,
    HeadingError,
    attitude_limit_deg,
    direction_error_deg,
    level_bound_deg,
    level_error,
    raw_error,
    tilted_error,
)
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane

TILTS_DEG: Final = (10.0, 30.0, 90.0)
"""Tilts at which reports state the heading error."""

NO_ERROR: Final = HeadingError(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Claim(ShortRepr):
    """Claimed accuracy of a calibration: its covariance, and the errors that follow from it, 1 σ."""

    calibration: Calibration  #: the correction
    #: (9, 9): covariance of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃,
    #: S₂₃, in the square of the calibration's unit. Singular if the method fixes some parameters; zero if no
    #: uncertainty is stated, see `states_uncertainty`.
    covariance: Floats = field(default_factory=lambda: np.zeros((9, 9)))
    textbook_covariance: Floats | None = None  #: (9, 9): as `covariance`, if residuals were independent
    heading_error_deg: HeadingError = NO_ERROR  #: expected of a level vehicle, 1 σ; NaN if not stated
    #: part of the heading error that depends on the direction of the field. It is the larger of two: the error (1 σ) if
    #: the distortion across the field is as large as that along the field, or the error at the worst heading from axes
    #: that are proven nonlinear or late.
    structure_deg: float = 0.0
    #: inclination of the field at the site. `heading_error_deg` has the inclination in the axes of the recording, whose
    #: sign is opposite for a sensor that is mounted upside down.
    dip_deg: float = ASSUMED_DIP_DEG
    dip_assumed: bool = False  #: whether `dip_deg` is a guess because the place is unknown
    target_deg: float = 1.0  #: requested worst heading error
    #: heading error (1 σ) from the stated uncertainty of the mounting, not part of `heading_error_deg`
    alignment_error_deg: float | None = None
    #: heading error (rms) from the bias of the method, as far as the readings show it; the covariance includes it
    bias_deg: float = 0.0
    #: whether the fit is shrunk towards no correction, because the readings were corrected before (``claim.c``)
    is_shrunk: bool = False
    #: ``xy``, ``yz`` or ``zx`` if all readings lie in one plane: headings are then those of a turn about the third axis
    plane: Plane | None = None

    def __post_init__(self) -> None:
        """Refuse a covariance of another shape.

        Raises
        ------
        ArrayError
        """
        if np.shape(self.covariance) != (9, 9):
            raise ArrayError(f"covariance has shape {np.shape(self.covariance)}: need (9, 9), of offset and shape")

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration maps to a sphere, in the magnetometer's own axes."""
        return self.calibration.ellipsoid

    @property
    def states_uncertainty(self) -> bool:
        """Whether a covariance is stated; an imported calibration, or one composed of several turns, has none."""
        return bool(self.covariance.any())

    @property
    def known_dip_deg(self) -> float:
        """Inclination of the field with the sign in the axes of the recording if known, else that of the site."""
        dip_deg = self.heading_error_deg.dip_deg
        return self.dip_deg if math.isnan(dip_deg) else dip_deg

    @property
    def offset_sigma(self) -> Floats:
        """(3,) standard deviation of the offset, in the calibration's unit."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def claimed_covariance(self) -> Floats:
        """(9, 9) covariance from which all stated errors of heading and direction follow, at any dip and attitude.

        It is the covariance of offset and shape, plus that of an uncertain offset, σ² S Sᵀ, for errors that depend on
        the direction. This offset moves the corrected field by σ in any direction, and a level heading by σ / cos I,
        which is `structure_deg`.
        """
        if not self.structure_deg:
            return self.covariance
        return engine().add_structure(
            self.ellipsoid.shape, self.covariance, structure_deg=self.structure_deg, dip_deg=self.known_dip_deg
        )

    @property
    def direction_error_deg(self) -> DirectionError:
        """Expected error of the direction of the corrected field over the whole sphere, 1 σ."""
        return direction_error_deg(self.ellipsoid, self.claimed_covariance)

    @property
    def textbook_heading_error_deg(self) -> HeadingError | None:
        """Heading error, 1 σ, that the covariance for independent residuals would give; None without one."""
        if self.textbook_covariance is None:
            return None
        down = down_direction(self.plane)
        return level_error(self.ellipsoid, self.textbook_covariance, dip_deg=self.known_dip_deg, down=down)

    def level_error(self, dip_deg: float | None = None) -> HeadingError:
        """Expected heading error of a level vehicle, 1 σ; by default at the dip that the fit was judged at."""
        dip = self.known_dip_deg if dip_deg is None else dip_deg
        return level_error(self.ellipsoid, self.claimed_covariance, dip_deg=dip, down=down_direction(self.plane))

    @property
    def heading_bound_deg(self) -> float:
        """95 % bound of the level heading error over all headings, in degrees; NaN if not stated.

        See `flinders.heading.error_propagation.level_bound_deg`.
        """
        if not self.states_uncertainty:
            return math.nan
        dip, down = self.known_dip_deg, down_direction(self.plane)
        bound_deg = level_bound_deg(self.ellipsoid, self.claimed_covariance, dip_deg=dip, down=down)
        return float(f"{bound_deg:.4g}")  # a file that is read and written again has the same digits

    @property
    def headline_numbers(self) -> Claimed:
        """Numbers of the claim that the headline of a verdict states."""
        return Claimed(self.heading_error_deg.worst, self.heading_bound_deg, self.target_deg)

    def tilted_error(self, tilt_deg: float) -> HeadingError:
        """Expected heading error of a vehicle that is rolled or pitched by a known angle, 1 σ."""
        dip, down = self.known_dip_deg, down_direction(self.plane)
        return tilted_error(self.ellipsoid, self.claimed_covariance, dip_deg=dip, tilt_deg=tilt_deg, down=down)

    @property
    def attitude_limit_deg(self) -> float:
        """Largest tilt in degrees at which the worst heading error meets the target; 0 if a level vehicle exceeds it.

        180 if the error meets the target at any tilt.
        """
        dip, down = self.known_dip_deg, down_direction(self.plane)
        claimed, limit = self.claimed_covariance, self.target_deg
        return attitude_limit_deg(self.ellipsoid, claimed, dip_deg=dip, limit_deg=limit, down=down)

    @property
    def per_degree_of_tilt(self) -> float:
        """Heading error per degree of tilt, in degrees, added in quadrature to the worst level heading error."""
        return float(np.sqrt(max(self.tilted_error(1.0).worst ** 2 - self.heading_error_deg.worst**2, 0.0)))

    @property
    def uncorrected_heading_error_deg(self) -> HeadingError:
        """Heading error of the same vehicle without the calibration, if the calibration is right."""
        return raw_error(self.ellipsoid, dip_deg=self.known_dip_deg, down=down_direction(self.plane))


def parameter_names(calibration: Calibration) -> tuple[str, ...]:
    """Names of the parameters in the rows of the covariance, including those of disturbances."""
    disturbances = calibration.disturbances
    named = [f"{disturbance.kind.key}_{axis}" for disturbance in disturbances for axis in "xyz"]
    growth = [f"{disturbance.kind.key}_scale" for disturbance in disturbances if disturbance.name == "temperature"]
    return (*PARAMETERS, *named, *growth)


def heading_words(claim: Claim) -> str:
    """The worst heading error, 1 σ, and its bound in words, as ``0.32° (95 % within 0.71°)``."""
    return error_words(claim.headline_numbers)


def dip_words(claim: Claim) -> str:
    """Dip for headings in words, with the sign that the recording shows, as ``dip 60° (assumed)``."""
    return f"dip {claim.known_dip_deg:.3g}°{' (assumed)' if claim.dip_assumed else ''}"
