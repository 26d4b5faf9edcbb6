"""Evaluation of a calibration against a known truth: true errors in degrees, and claimed errors.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> recording = simulate.tumble(seed=1)
>>> evaluation = evaluate(calibrate.fit(recording.samples), simulate.truth.Truth.of(recording))
>>> evaluation.verdict, evaluation.heading_error_deg.worst < 0.2
('as claimed', True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.comparison.comparison import DIRECTIONS, MAX_P_VALUE
from flinders.comparison.results import json_attributes, with_bound
from flinders.comparison.rotation_difference import RotationDifference, rotation_covariance
from flinders.core.calibration import Calibration
from flinders.core.units import unit_label
from flinders.errors import UnitError, UsageError
from flinders.geometry.plane import down_direction, heading_errors
from flinders.heading.error_propagation import (
    DirectionError,
    HeadingError,
    body_error,
    level_bound_deg,
    level_gradients,
    level_turn,
    upright,
)
from flinders.summary.pooling import chi_square_of, p_value_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.simulate.truth import Truth

Claim = Literal["as claimed", "worse than claimed", "unclaimed"]

TARGET_DEG: Final = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """True errors of a calibration, and its claimed errors.

    Claims of an ellipsoid are in the magnetometer's own axes, and so are the errors that are compared with them. If an
    aiding sensor gave the rotation into the body, the error of the rotation is compared with the claim of the rotation,
    and the heading error of the body with both claims.
    """

    #: heading error of a level vehicle without its mean, in the magnetometer's own axes: rms over 72 headings, and the
    #: worst
    heading_error_deg: HeadingError
    heading_mean_deg: float  #: the mean heading error that was removed
    #: (rms, worst): angle between the corrected and the true field over 400 directions, rotation included
    direction_error_deg: DirectionError
    #: (rms, worst): angle between these fields in the magnetometer's own axes
    unrotated_direction_error_deg: DirectionError
    #: difference of the calibration's rotation into the body from the true one; with a covariance if one is claimed
    rotation: RotationDifference
    offset_error: Floats  #: (3,), in `unit`: offset minus the true one
    #: remaining soft iron after the correction, without rotation and scale: Frobenius norm of P − 1, where R P is
    #: the polar decomposition of matrix × true matrix and P is scaled to determinant 1
    matrix_error: float
    #: corrected length over the true length, minus one; None if no field strength was given, as no scale is claimed
    scale_error: float | None
    field_strength: float  #: in `unit`: true field strength
    target_deg: float
    unit: str  #: unit of offsets: ``uT`` or ``counts``
    #: claimed 1 σ of the heading error at the same dip; None if no covariance is stated
    claimed_heading_deg: HeadingError | None = None
    claimed_bound_deg: float | None = None  #: claimed 95 % bound of the heading error over all headings
    claimed_direction_deg: DirectionError | None = None  #: (rms, worst): claimed 1 σ of the direction error
    offset_sigma: Floats | None = None  #: (3,), in `unit`: claimed 1 σ of the offset
    chi_square: float | None = None  #: χ² of the level heading errors and of the rotation against their covariances
    #: degrees of freedom of `chi_square`: two for each of two harmonics of the heading error, three for a rotation
    freedom: int = 0
    #: true heading error of the level body, including the rotation and the mean error; None if no rotation is claimed
    body_heading_error_deg: HeadingError | None = None
    claimed_body_heading_deg: HeadingError | None = None  #: claimed 1 σ of `body_heading_error_deg`

    @property
    def p_value(self) -> float | None:
        """Probability of errors as large by chance; None if nothing is claimed."""
        return None if self.chi_square is None else p_value_of(self.chi_square, self.freedom)

    @property
    def heading_ratio(self) -> float | None:
        """Ratio of the true heading error to the claimed one, rms; about 1 on average if claims are right."""
        claimed = self.claimed_heading_deg
        return None if claimed is None else _ratio(self.heading_error_deg.rms, claimed.rms)

    @property
    def body_heading_ratio(self) -> float | None:
        """Ratio of the body's true heading error to the claimed one, rms; None if no rotation is claimed."""
        true, claimed = self.body_heading_error_deg, self.claimed_body_heading_deg
        return None if true is None or claimed is None else _ratio(true.rms, claimed.rms)

    @property
    def direction_ratio(self) -> float | None:
        """Ratio of the true direction error, in the magnetometer's own axes, to the claimed one, rms."""
        claimed = self.claimed_direction_deg
        return None if claimed is None else _ratio(self.unrotated_direction_error_deg.rms, claimed.rms)

    @property
    def offset_ratio(self) -> float | None:
        """Ratio of the length of the offset error to that of its claimed 1 σ."""
        sigma = self.offset_sigma
        return None if sigma is None else _ratio(math.hypot(*self.offset_error), math.hypot(*sigma))

    @property
    def offset_share(self) -> float:
        """Length of the offset error, as a fraction of the field."""
        return math.hypot(*self.offset_error) / self.field_strength

    @property
    def verdict(self) -> Claim:
        """``worse than claimed`` if errors as large have a probability below 1 %, else ``as claimed``.

        ``unclaimed`` if the calibration states no uncertainty.
        """
        if self.p_value is None:
            return "unclaimed"
        return "as claimed" if self.p_value >= MAX_P_VALUE else "worse than claimed"

    @property
    def is_on_target(self) -> bool:
        """Whether no heading error exceeds the target; if a rotation is claimed, the heading is that of the body."""
        return (self.body_heading_error_deg or self.heading_error_deg).worst <= self.target_deg

    @property
    def rotation_deg(self) -> float:
        """Angle of the rotation error."""
        return self.rotation.angle_deg

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, as printed by ``--json``."""
        heading = self.heading_error_deg
        return {
            "verdict": self.verdict,
            "is_on_target": self.is_on_target,
            "heading_error_deg": heading.as_dict(
                mean=self.heading_mean_deg, dip_deg=heading.dip_deg, target_deg=self.target_deg
            ),
            "claimed_heading_deg": with_bound(self.claimed_heading_deg, self.claimed_bound_deg),
            **json_attributes(self, "heading_ratio", "direction_error_deg", "unrotated_direction_error_deg"),
            **json_attributes(
                self, "claimed_direction_deg", "direction_ratio", "rotation_deg", "offset_error", "offset_sigma"
            ),
            **json_attributes(self, "offset_ratio", "offset_share", "matrix_error", "scale_error"),
            **self._body_as_dict(),
            **json_attributes(self, "chi_square", "freedom", "p_value", "unit"),
        }

    def _body_as_dict(self) -> dict[str, Any]:
        """Rotation and heading of the body, JSON-ready; empty if no rotation is claimed."""
        if self.body_heading_error_deg is None:
            return {}
        names = ("body_heading_error_deg", "claimed_body_heading_deg", "body_heading_ratio", "rotation")
        return json_attributes(self, *names)

    def __repr__(self) -> str:
        heading = self.heading_error_deg
        return (
            f"Evaluation({self.verdict}, heading {heading.rms:.2g}° rms, {heading.worst:.2g}° worst, "
            f"offset {math.hypot(*self.offset_error):.3g} {unit_label(self.unit)})"
        )


def evaluate(fit: Fit, truth: Truth, *, dip_deg: float | None = None, target_deg: float = TARGET_DEG) -> Evaluation:
    """Compute the true errors of a calibration from the truth of its sensor.

    Raises `UnitError` if one is in µT and the other in counts; `UsageError` for a target that is not positive, or a dip
    within a degree of the poles.

    Parameters
    ----------
    fit : Fit
        Fitted or loaded from its file, in the unit of the truth. If its axes are mapped, the truth is mapped likewise.
    dip_deg : float, optional
        Inclination of the field for headings; by default that of the truth.
    target_deg : float
        Worst heading error that is good enough.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if fit.calibration.unit != truth.unit:
        raise UnitError(
            f"{fit.provenance.name} is for readings in {unit_label(fit.calibration.unit)}, the truth is in "
            f"{unit_label(truth.unit)}: calibrate with the unit of the recording, or counts with a scale",
            hint={"unit": None, "scale": None},
        )
    if fit.calibration.linearization is not None:
        raise UsageError(
            f"{fit.provenance.name} linearizes its axes, and those of the truth are linear: fit without linearize"
        )
    dip_deg = truth.field.dip_deg if dip_deg is None else dip_deg
    true = _true_calibration(truth, fit.calibration.axes)
    left = np.linalg.solve(fit.calibration.ellipsoid.shape, true.ellipsoid.shape)
    values = np.linalg.svd(left, compute_uv=False)
    scale = float(np.cbrt(np.prod(values)))
    heading, directions = level_turn(dip_deg, down_direction(fit.claim.plane))
    errors, mean = heading_errors(_in_level_axes(_correct_simulated(fit, true, directions), fit.claim.plane), heading)
    seen = fit.calibration.rotation_matrix @ _correct_simulated(fit, true, true.rotation_matrix.T @ DIRECTIONS)
    rotation = RotationDifference.between(true, fit.calibration, rotation_covariance(fit))
    return Evaluation(
        heading_error_deg=HeadingError(*DirectionError.of(np.rad2deg(errors)), float(dip_deg)),
        heading_mean_deg=math.degrees(mean),
        direction_error_deg=_angles_deg(seen),
        unrotated_direction_error_deg=_angles_deg(_correct_simulated(fit, true, DIRECTIONS)),
        rotation=rotation,
        offset_error=np.asarray(fit.calibration.offset - true.offset),
        matrix_error=float(np.linalg.norm(values / scale - 1.0)),
        scale_error=scale - 1.0 if fit.calibration.field_strength_known else None,
        field_strength=truth.field.strength,
        target_deg=float(target_deg),
        unit=truth.unit,
        **(_claims(fit, dip_deg, errors, rotation) if fit.claim.states_uncertainty else {}),
        **_body_errors(fit, true, dip_deg),
    )


def map_truth(truth: Truth, axes: Axes) -> tuple[Floats, Floats]:
    """(3, 3) matrix and (3,) offset of the true sensor in mapped axes: P A Pᵀ and P b.

    >>> from flinders.core.axes import Axes
    >>> from flinders.simulate import Sensor, truth, tumble
    >>> plain = truth.Truth.of(tumble(n=10, sensor=Sensor(matrix=np.diag([1.0, 2.0, 3.0]), offset=[4, 5, 6])))
    >>> matrix, offset = map_truth(plain, Axes.of("-y,x,z"))
    >>> np.diag(matrix).tolist(), offset.tolist()
    ([2.0, 1.0, 3.0], [-5.0, 4.0, 6.0])
    """
    turn = axes.apply(np.eye(3)).T
    sensor = truth.as_sensor()
    return turn @ sensor.matrix @ turn.T, turn @ sensor.offset


def _true_calibration(truth: Truth, axes: Axes) -> Calibration:
    """The exact calibration, for readings in mapped axes."""
    matrix, offset = map_truth(truth, axes)
    return Calibration(np.linalg.inv(matrix), offset, truth.field.strength, rotation="composed")


def _correct_simulated(fit: Fit, true: Calibration, directions: Floats) -> Floats:
    """(3, K) corrected fields for (3, K) true unit directions, both in the magnetometer's own axes."""
    moved = (true.offset - fit.calibration.offset)[:, np.newaxis]
    corrected: Floats = np.linalg.solve(fit.calibration.ellipsoid.shape, moved + true.ellipsoid.shape @ directions)
    return corrected


def _in_level_axes(field: Floats, plane: Plane | None) -> Floats:
    """(3, K) fields in axes with z down, for a sensor that turns in a plane."""
    down = down_direction(plane)
    return field if down is None else upright(down).T @ field


def _claims(fit: Fit, dip_deg: float, errors: Floats, rotation: RotationDifference) -> dict[str, Any]:
    """Claims of a fit, and the test of its true errors against them.

    `errors` are the (72,) level heading errors in rad, `rotation` is the error of the rotation into the body.
    """
    # to first order an error of the offset causes the first harmonic of the heading error, an error of the shape the
    # second
    heading, down = level_turn(dip_deg)[0], down_direction(fit.claim.plane)
    waves = np.array([wave(order * heading) for order in (1, 2) for wave in (np.cos, np.sin)]) * (2 / len(heading))
    ellipsoid, covariance = fit.calibration.ellipsoid, fit.claim.claimed_covariance
    gradient = waves @ level_gradients(ellipsoid, dip_deg=dip_deg, down=down)
    chi_square, freedom = chi_square_of(waves @ errors, gradient @ covariance @ gradient.T)
    turned, about = rotation.chi_square
    return {
        "claimed_heading_deg": fit.claim.level_error(dip_deg),
        "claimed_bound_deg": level_bound_deg(ellipsoid, covariance, dip_deg=dip_deg, down=down),
        "claimed_direction_deg": fit.claim.direction_error_deg,
        "offset_sigma": fit.claim.offset_sigma,
        "chi_square": chi_square + turned,
        "freedom": freedom + about,
    }


def _body_errors(fit: Fit, true: Calibration, dip_deg: float) -> dict[str, Any]:
    """Heading error of the level body and its claim; empty if no rotation is claimed."""
    covariance, turn = rotation_covariance(fit), fit.calibration.rotation_matrix
    if covariance is None or not fit.claim.states_uncertainty:
        return {}
    heading, directions = level_turn(dip_deg)
    errors, mean = heading_errors(turn @ _correct_simulated(fit, true, true.rotation_matrix.T @ directions), heading)
    return {
        "body_heading_error_deg": HeadingError(*DirectionError.of(np.rad2deg(errors + mean)), float(dip_deg)),
        "claimed_body_heading_deg": body_error(
            fit.calibration.ellipsoid, fit.claim.claimed_covariance, turn, covariance, dip_deg=dip_deg
        ),
    }


def _angles_deg(seen: Floats) -> DirectionError:
    """Angles between (3, 400) vectors and `DIRECTIONS` in degrees: rms and largest."""
    across = np.linalg.norm(np.cross(seen, DIRECTIONS, axis=0), axis=0)
    return DirectionError.of(np.rad2deg(np.arctan2(across, np.sum(seen * DIRECTIONS, axis=0))))


def _ratio(error: float, claimed: float) -> float | None:
    """Ratio of an error to the claimed one; None if nothing is claimed."""
    return error / claimed if claimed > 0.0 else None
