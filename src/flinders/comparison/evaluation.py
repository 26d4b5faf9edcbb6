"""A calibration against the truth: what it really costs in degrees, beside what it claims.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> recording = simulate.tumble(seed=1)
>>> evaluation = evaluate(calibrate.fit(recording.samples), simulate.truth.Truth.of(recording))
>>> evaluation.verdict, evaluation.heading_error_deg.worst < 0.2
('as claimed', True)

The recipe for two axes on a simulated swing, what it finds and what is true:

>>> recovery = recover(simulate.TwoAxis((1.2, 0.9), (12.0, -8.0), skew_deg=5.0, noise=0.25), seed=1)
>>> recovery.verdict, round(recovery.estimate.skew_deg, 1)
('limited', 4.8)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.comparison.comparison import CHANCE, DIRECTIONS, printed
from flinders.core.units import label
from flinders.errors import UnitError, UsageError
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.geometry.plane import PlaneEllipse, Turn, heading_errors
from flinders.geometry.rotation import best_rotation, rotation_vectors
from flinders.heading.error_propagation import (
    DirectionError,
    HeadingError,
    level_error,
    level_gradients,
    level_turn,
)
from flinders.simulate import TwoAxis, swing
from flinders.simulate.two_axis import Polar
from flinders.summary.pooling import chance_of, chi_square_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated
    from flinders.simulate.truth import Truth

Claim = Literal["as claimed", "worse than claimed", "unclaimed"]

TARGET_DEG: Final = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """True errors of a calibration, and those that it claims."""

    heading_error_deg: HeadingError  #: of a level vehicle: rms over 72 headings and the worst, the mean removed
    heading_mean_deg: float  #: that mean: it looks like a mounting that has turned
    #: (rms, worst): angle between the corrected and the true field over 400 directions, with any rotation left in
    direction_error_deg: DirectionError
    #: (rms, worst): the same once the best common rotation is taken away: all that a magnetometer alone can answer for
    freed_direction_error_deg: DirectionError
    rotation_deg: float  #: angle of that rotation
    offset_error: Floats  #: (3,), in `unit`: offset less the true one
    #: what the correction leaves of the soft iron, rotation and scale taken away: Frobenius norm of P − 1, where R P is
    #: the polar decomposition of matrix × true matrix and P is scaled to determinant 1
    matrix_error: float
    #: corrected length over the true one, less one; None where no field strength was given, and nothing is claimed
    scale_error: float | None
    field_strength: float  #: in `unit`: the true one
    target_deg: float
    unit: str
    #: 1 σ that the calibration's covariance gives at the same dip; None where it states none
    claimed_heading_deg: HeadingError | None = None
    claimed_direction_deg: DirectionError | None = None  #: (rms, worst): 1 σ, which is one of the rotation-free error
    offset_sigma: Floats | None = None  #: (3,), in `unit`: 1 σ, as claimed
    chi_square: float | None = None  #: of the level heading errors against the covariance
    freedom: int = 0  # two for a circle, two for a figure of eight around the compass

    @property
    def p_value(self) -> float | None:
        """How often chance alone makes the errors as large; None where nothing is claimed."""
        return None if self.chi_square is None else chance_of(self.chi_square, self.freedom)

    @property
    def heading_ratio(self) -> float | None:
        """True heading error over the claimed one, rms: about 1 on average where the claims are true."""
        claimed = self.claimed_heading_deg
        return None if claimed is None else _ratio(self.heading_error_deg.rms, claimed.rms)

    @property
    def direction_ratio(self) -> float | None:
        """True direction error without the rotation over the claimed one, rms."""
        claimed = self.claimed_direction_deg
        return None if claimed is None else _ratio(self.freed_direction_error_deg.rms, claimed.rms)

    @property
    def offset_ratio(self) -> float | None:
        """Length of the offset error over that of its claimed 1 σ."""
        sigma = self.offset_sigma
        return None if sigma is None else _ratio(math.hypot(*self.offset_error), math.hypot(*sigma))

    @property
    def offset_share(self) -> float:
        """Length of the offset error, as a fraction of the field."""
        return math.hypot(*self.offset_error) / self.field_strength

    @property
    def verdict(self) -> Claim:
        """``worse than claimed`` where chance makes such errors less than once in a hundred times."""
        if self.p_value is None:
            return "unclaimed"
        return "as claimed" if self.p_value >= CHANCE else "worse than claimed"

    @property
    def is_on_target(self) -> bool:
        """No heading is off by more than the target."""
        return self.heading_error_deg.worst <= self.target_deg

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        heading = self.heading_error_deg
        return {
            "verdict": self.verdict,
            "on_target": self.is_on_target,
            "heading_error_deg": heading.as_dict(
                mean=self.heading_mean_deg, dip_deg=heading.dip_deg, target_deg=self.target_deg
            ),
            **printed(self, "claimed_heading_deg", "heading_ratio", "direction_error_deg", "freed_direction_error_deg"),
            **printed(self, "claimed_direction_deg", "direction_ratio", "rotation_deg", "offset_error", "offset_sigma"),
            **printed(self, "offset_ratio", "offset_share", "matrix_error", "scale_error"),
            **printed(self, "chi_square", "freedom", "p_value", "unit"),
        }

    def __repr__(self) -> str:
        heading = self.heading_error_deg
        return (
            f"Evaluation({self.verdict}, heading {heading.rms:.2g}° rms, {heading.worst:.2g}° worst, "
            f"offset {math.hypot(*self.offset_error):.3g} {label(self.unit)})"
        )


def evaluate(fit: Fit, truth: Truth, *, dip_deg: float | None = None, target_deg: float = TARGET_DEG) -> Evaluation:
    """Hold a calibration against what is true of its sensor.

    Raises `UnitError` where one is in µT and the other in counts; `UsageError` for a target that is not positive, or a
    dip within a degree of the poles.

    Parameters
    ----------
    fit : Fit
        Fitted or loaded from its file, in the unit of the truth. Where its axes are mapped, the truth is mapped alike.
    dip_deg : float, optional
        Inclination of the field for headings; that of the truth unless another is given.
    target_deg : float
        Worst heading error that is good enough.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if fit.calibration.unit != truth.unit:
        raise UnitError(
            f"{fit.name} is for readings in {label(fit.calibration.unit)}, the truth is in {label(truth.unit)}: "
            "calibrate with the unit of the recording (counts need scale=)"
        )
    if fit.calibration.linearization is not None:
        raise UsageError(f"{fit.name} linearizes its axes, and those of the truth are linear: fit without linearize")
    dip_deg = truth.field.dip_deg if dip_deg is None else dip_deg
    met = _Met(fit.calibration, *mapped(truth, fit.calibration.axes), truth.field.strength)
    errors, mean = met.heading_errors(dip_deg)
    seen = met.corrected(DIRECTIONS)
    rotation = best_rotation(seen.T, DIRECTIONS.T)
    return Evaluation(
        heading_error_deg=HeadingError(*_rms_and_worst(np.rad2deg(errors)), float(dip_deg)),
        heading_mean_deg=math.degrees(mean),
        direction_error_deg=_angles_deg(seen),
        freed_direction_error_deg=_angles_deg(rotation @ seen),
        rotation_deg=math.degrees(math.hypot(*rotation_vectors(rotation))),
        offset_error=np.asarray(fit.calibration.offset - met.offset),
        matrix_error=met.matrix_error,
        scale_error=met.scale_error if fit.calibration.field_strength_known else None,
        field_strength=truth.field.strength,
        target_deg=float(target_deg),
        unit=truth.unit,
        **(_claims(fit, dip_deg, errors) if fit.states_uncertainty else {}),
    )


def mapped(truth: Truth, axes: Axes) -> tuple[Floats, Floats]:
    """(3, 3) matrix and (3,) offset of the true sensor once its axes are turned: P A Pᵀ and P b.

    >>> from flinders.core.axes import Axes
    >>> from flinders.simulate import Sensor, truth, tumble
    >>> plain = truth.Truth.of(tumble(n=10, sensor=Sensor(matrix=np.diag([1.0, 2.0, 3.0]), offset=[4, 5, 6])))
    >>> matrix, offset = mapped(plain, Axes.of("-y,x,z"))
    >>> np.diag(matrix).tolist(), offset.tolist()
    ([2.0, 1.0, 3.0], [-5.0, 4.0, 6.0])
    """
    turn = axes.apply(np.eye(3)).T
    sensor = truth.as_sensor()
    return turn @ sensor.matrix @ turn.T, turn @ sensor.offset


@dataclass(frozen=True, slots=True, eq=False)
class _Met:
    """A calibration that meets a sensor with the given matrix (3, 3) and offset (3,) in a field of some strength."""

    calibration: Calibration
    matrix: Floats
    offset: Floats
    field_strength: float

    def corrected(self, directions: Floats) -> Floats:
        """(3, K) what comes out for true unit directions (3, K)."""
        raw = self.offset[:, np.newaxis] + self.field_strength * self.matrix @ directions
        corrected: Floats = self.calibration.matrix @ (raw - self.calibration.offset[:, np.newaxis])
        return corrected

    def heading_errors(self, dip_deg: float) -> tuple[Floats, float]:
        """(72,) errors over a level turn with their mean removed, and the mean, in rad."""
        heading, directions = level_turn(dip_deg)
        return heading_errors(self.corrected(directions), heading)

    @property
    def matrix_error(self) -> float:
        """Frobenius norm of P − 1, with P of determinant 1."""
        left = self.calibration.matrix @ self.matrix
        values = np.linalg.svd(left, compute_uv=False)
        return float(np.linalg.norm(values / np.cbrt(np.prod(values)) - 1.0))

    @property
    def scale_error(self) -> float:
        """Corrected length over the calibration's field strength, by volume, less one."""
        length = np.cbrt(abs(np.linalg.det(self.calibration.matrix @ self.matrix))) * self.field_strength
        return float(length / self.calibration.field_strength - 1.0)


def _claims(fit: Fit, dip_deg: float, errors: Floats) -> dict[str, Any]:
    """What the covariance of a fit says, and how the level heading errors (72,) in rad bear it out."""
    # A small error of the offset moves headings by a circle around the compass, one of the shape by a figure of eight:
    # the first two harmonics are all there is to first order.
    heading, _ = level_turn(dip_deg)
    waves = np.array([wave(order * heading) for order in (1, 2) for wave in (np.cos, np.sin)]) * (2 / len(heading))
    gradient = waves @ level_gradients(fit.ellipsoid, dip_deg=dip_deg)
    chi_square, freedom = chi_square_of(waves @ errors, gradient @ fit.claimed_covariance @ gradient.T)
    return {
        "claimed_heading_deg": level_error(fit.ellipsoid, fit.claimed_covariance, dip_deg=dip_deg),
        "claimed_direction_deg": fit.direction_error_deg,
        "offset_sigma": fit.offset_sigma,
        "chi_square": chi_square,
        "freedom": freedom,
    }


def _angles_deg(seen: Floats) -> DirectionError:
    """Angles between (3, 400) vectors and `DIRECTIONS` in degrees: rms and largest."""
    across = np.linalg.norm(np.cross(seen, DIRECTIONS, axis=0), axis=0)
    return _rms_and_worst(np.rad2deg(np.arctan2(across, np.sum(seen * DIRECTIONS, axis=0))))


def _rms_and_worst(angles: Floats) -> DirectionError:
    """Of (K,) angles."""
    return DirectionError(float(np.sqrt(np.mean(angles**2))), float(np.abs(angles).max()))


def _ratio(error: float, claimed: float) -> float | None:
    """An error over the claimed one; None where nothing is claimed."""
    return error / claimed if claimed > 0.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """A swing of a simulated compass, and what a calibration makes of it."""

    true: TwoAxis
    estimate: TwoAxis
    swung: Simulated  #: the recording
    polar: Polar  #: the recording around the compass rose, before and after correction
    fit: Fit  #: of the method ``level``, also one that is refused
    turn: Turn  #: the points of the recording, and the ellipses through them: of mean and scatter, and of the fit
    refusal: Refused | None = None  #: why it would be no calibration to use

    @property
    def verdict(self) -> str:
        """A swing of two axes is never better than limited."""
        return "limited" if self.refusal is None else "refused"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        numbers = {
            "scale_x": (self.true.scale[0], self.estimate.scale[0]),
            "scale_y": (self.true.scale[1], self.estimate.scale[1]),
            "offset_x": (self.true.offset[0], self.estimate.offset[0]),
            "offset_y": (self.true.offset[1], self.estimate.offset[1]),
            "skew_deg": (self.true.skew_deg, self.estimate.skew_deg),
            "noise": (self.true.noise, self.estimate.noise),
        }
        pairs = {name: {"true": true, "found": estimate} for name, (true, estimate) in numbers.items()}
        return {
            "verdict": self.verdict,
            "recovery": pairs,
            "turn": self.turn.as_dict(),
            "polar": self.polar.as_dict(),
            "unit": "uT",
        }


def recover(
    compass: TwoAxis, *, seed: int = 0, points: int = 36, field_strength: float = 50.0, dip_deg: float = 60.0
) -> Recovery:
    """Swing a compass around, calibrate it by the method ``level``, and state what was found in its own terms.

    Raises `FitError` where there is no calibration at all.
    """
    swung = swing(compass, seed=seed, points=points, field_strength=field_strength, dip_deg=dip_deg)
    refusal = None
    try:
        result = fit(swung.samples, method="level", field_strength=field_strength, dip_deg=dip_deg)
    except Refused as refused:
        result, refusal = refused.fit, refused
    calibration, dip = result.calibration, math.radians(dip_deg)
    shape = field_strength * np.linalg.inv(calibration.matrix)
    centre = calibration.offset[:2] + math.sin(dip) * shape[:2, 2]
    horizontal = field_strength * math.cos(dip)
    ellipse = PlaneEllipse(centre, math.cos(dip) * shape[:2, :2])
    estimate = TwoAxis.from_ellipse(centre, ellipse.shape, horizontal, noise=result.noise or 0.0)
    polar = Polar.of(swung, calibration.matrix, calibration.offset)
    turn = Turn.of("xy", swung.samples.field[:, :2], ellipse)
    return Recovery(compass, estimate, swung, polar, result, turn, refusal)
