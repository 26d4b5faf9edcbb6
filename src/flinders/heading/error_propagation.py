"""Propagation of the covariance of a calibration to heading errors in degrees.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> offset_only = np.diag([0.25, 0.25, 0.25, 0, 0, 0, 0, 0, 0])
>>> level_error(sphere, offset_only, dip_deg=60.0)     # 0.5 µT on a horizontal field of 25 µT
HeadingError(rms=1.15°, worst=1.15°, dip=60°)

A vertical offset does not change a level heading; its effect grows with the sine of the tilt:

>>> vertical = np.diag([0, 0, 0.25, 0, 0, 0, 0, 0, 0])
>>> level_error(sphere, vertical), tilted_error(sphere, vertical, tilt_deg=30.0)
(HeadingError(rms=0.00°, worst=0.00°, dip=60°), HeadingError(rms=0.41°, worst=0.57°, dip=60°, tilt=30°))
>>> round(attitude_limit_deg(sphere, vertical, limit_deg=0.573), 1)
30.0

The worst 1 σ is that of one heading. The largest error within a whole turn is usually larger, so that a bound for all
headings is computed. To first order the heading error at the heading ζ is B sin ζ + C cos ζ + D sin 2ζ + E cos 2ζ, with
(B, C, D, E) = L z and four independent standard normal numbers z. Let r be the length and θ the direction of z. The
largest error is then r m(θ), with m the largest over ζ of the error for r = 1, and

    P(largest ≤ u) = mean over θ of F(u / m(θ)),      F(x) = 1 − (1 + x²/2) exp(−x²/2)

where F is the distribution of r. The engine (`native/heading.c`) takes the mean over 128 even directions (I. Deák,
Numer. Math. 35 (1980) 369; A. Genz and F. Bretz, "Computation of Multivariate Normal and t Probabilities", Springer
(2009), sect. 4.1), and solves for 95 %. `tests/heading/test_confidence.py` compares it with simulated errors.

>>> sphere, hard_iron = Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), np.diag([0.19, 0.19, *[0.0] * 7])
>>> worst_deg = level_error(sphere, hard_iron).worst      # one circle, whose amplitude Rayleigh's law gives: √(2 ln 20)
>>> round(level_bound_deg(sphere, hard_iron) / worst_deg, 2)
2.44
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.errors import UsageError
from flinders.geometry.ellipsoid import Ellipsoid, parameter_derivatives
from flinders.geometry.sphere import fibonacci
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats

HEADINGS: Final = 72
MAX_DIP_DEG: Final = 89.0

_SPHERE_DIRECTIONS: Final = fibonacci(400)


class DirectionError(NamedTuple):
    """Expected error of the direction of the corrected field, 1 σ, in degrees: rms over the sphere, and the worst.

    >>> DirectionError(rms=0.1, worst=0.2)._asdict()
    {'rms': 0.1, 'worst': 0.2}
    """

    rms: float
    worst: float

    def __repr__(self) -> str:
        return f"DirectionError(rms={self.rms:.2f}°, worst={self.worst:.2f}°)"

    @classmethod
    def of(cls, errors: Floats) -> Self:
        """Summarise (K,) errors, in degrees."""
        return cls(float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max()))


@dataclass(frozen=True, slots=True)
class HeadingError:
    """Expected heading error of a vehicle, 1 σ, without its mean over a level turn."""

    rms: float  #: degrees: rms over all headings
    worst: float  #: degrees: error at the worst heading
    dip_deg: float  #: dip of the field at which these errors hold, positive if the field points along +z
    tilt_deg: float = 0.0  #: angle by which the vehicle is rolled or pitched, in any direction; 0 if level

    def add_independent(self, angle_deg: float) -> HeadingError:
        """Add an independent error of `angle_deg` at each heading."""
        rms, worst = math.hypot(self.rms, angle_deg), math.hypot(self.worst, angle_deg)
        return HeadingError(rms, worst, self.dip_deg, self.tilt_deg)

    def as_dict(self, **more: float) -> dict[str, float]:
        """JSON of rms and worst, with further keys and values in `more`."""
        return {"rms": self.rms, "worst": self.worst, **more}

    def __repr__(self) -> str:
        tilt = f", tilt={self.tilt_deg:g}°" if self.tilt_deg else ""
        return f"HeadingError(rms={self.rms:.2f}°, worst={self.worst:.2f}°, dip={self.dip_deg:g}°{tilt})"


def level_error(
    ellipsoid: Ellipsoid, covariance: Floats, *, dip_deg: float = 60.0, down: Floats | None = None
) -> HeadingError:
    """Propagate the covariance of (b, S) to the heading of a level vehicle.

    The field is u(ψ) = (cos I cos ψ, −cos I sin ψ, sin I) in body axes (z down), and the error of the corrected reading
    is δu = −S⁻¹(δb + δS u). The heading error is then δψ = −(sin ψ δu₁ + cos ψ δu₂)/cos I. The mean over all headings
    is removed, because a magnetometer cannot distinguish it from an error of the mounting.

    Raises `UsageError` within a degree of the magnetic poles, where there is no heading.

    Parameters
    ----------
    covariance : (9, 9) float
        Covariance of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit².
    dip_deg : float
        Inclination of the field at the site; negative in the south.
    down : (3,) float, optional
        Down direction of the level vehicle in corrected sensor axes; by default +z. For a sensor that is mounted with a
        small tilt it is the vehicle's vertical.
    """
    return tilted_error(ellipsoid, covariance, dip_deg=dip_deg, down=down)


def level_gradients(ellipsoid: Ellipsoid, *, dip_deg: float = 60.0, down: Floats | None = None) -> Floats:
    """(72, 9) derivatives of the heading of a level vehicle by (b, S), in rad/unit, at 72 headings, without their mean.

    The sign of all derivatives is arbitrary, as it does not affect variances. Parameters are those of `level_error`.

    Raises `UsageError` within a degree of the magnetic poles.
    """
    across, directions = level_fields(dip_deg, down)
    gradient = parameter_derivatives(np.linalg.solve(ellipsoid.shape, across), directions)
    gradient -= gradient.mean(axis=0)
    return gradient


def deviation_covariance(
    ellipsoid: Ellipsoid,
    covariance: Floats,
    *,
    dip_deg: float = 60.0,
    down: Floats | None = None,
    rotation: Floats | None = None,
    rotation_covariance: Floats | None = None,
) -> Floats:
    """Propagate the covariance of (b, S) to the deviation coefficients B, C, D, E that remain for a level vehicle.

    The heading error over a level turn is A + B sin ζ + C cos ζ + D sin 2ζ + E cos 2ζ to first order. Each of the four
    coefficients is twice the mean of the error times its harmonic. A is an error of the mounting.

    Raises `UsageError` within a degree of the magnetic poles.

    Parameters
    ----------
    covariance : (9, 9) float
        As for `level_error`, like `dip_deg` and `down`; `down` is in axes of the body if a rotation is given.
    rotation, rotation_covariance : (3, 3) float, optional
        As for `body_error`; by default no rotation, known exactly.

    Returns
    -------
    (4, 4) degrees²
        Covariance of B, C, D and E.

    Examples
    --------
    An offset of 0.5 µT fore and aft, in a horizontal field of 25 µT, causes a deviation of 1.15°:

    >>> sphere, fore_and_aft = Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), np.diag([0.25, 0, 0, 0, 0, 0, 0, 0, 0])
    >>> np.sqrt(np.diagonal(deviation_covariance(sphere, fore_and_aft)).clip(0)).round(2)
    array([1.15, 0.  , 0.  , 0.  ])

    A tilt of the axes by 1° causes a deviation by the vertical field:

    >>> tilt = np.diag([np.radians(1.0) ** 2, 0.0, 0.0])
    >>> tilted = deviation_covariance(sphere, np.zeros((9, 9)), rotation=np.eye(3), rotation_covariance=tilt)
    >>> np.sqrt(np.diagonal(tilted).clip(0)).round(2)
    array([0.  , 1.73, 0.  , 0.  ])
    """
    turn = np.eye(3) if rotation is None else rotation
    gradient = np.rad2deg(2.0 / HEADINGS * _harmonics(HEADINGS).T @ _body_gradients(ellipsoid, turn, dip_deg, down))
    carried: Floats = gradient @ _with_rotation(covariance, rotation_covariance) @ gradient.T
    return carried


def tilted_error(
    ellipsoid: Ellipsoid,
    covariance: Floats,
    *,
    dip_deg: float = 60.0,
    tilt_deg: float = 0.0,
    down: Floats | None = None,
) -> HeadingError:
    """Propagate the covariance of (b, S) to the heading of a vehicle that is rolled or pitched.

    The tilt of the vehicle is a rotation T by `tilt_deg` about a horizontal axis. It is known, and readings are rotated
    back by it. The field in axes of the vehicle is v = Tᵀu(ψ), which is read with the error δv = −S⁻¹(δb + δS v). The
    heading error is that of a level vehicle for the error T δv. The mean of the *level* error is removed, as it is an
    error of the mounting. Errors that the tilt adds are included, for 24 directions of the tilt.

    Raises `UsageError` within a degree of the magnetic poles.

    Parameters
    ----------
    covariance : (9, 9) float
        As for `level_error`, like `dip_deg` and `down`.
    tilt_deg : float
        Tilt: 0 is level, 180 is upside down.
    """
    require_headings(dip_deg)
    rms, worst = engine().tilted_error(ellipsoid.shape, covariance, dip_deg=dip_deg, tilt_deg=tilt_deg, down=down)
    return HeadingError(rms, worst, float(dip_deg), float(tilt_deg))


def attitude_limit_deg(
    ellipsoid: Ellipsoid,
    covariance: Floats,
    *,
    dip_deg: float = 60.0,
    limit_deg: float = 1.0,
    down: Floats | None = None,
) -> float:
    """Largest roll or pitch, in any direction, at which the worst heading error is within a limit, in degrees.

    It is the largest tilt up to which `tilted_error` stays within `limit_deg`, searched in steps of 5° and then refined
    to 0.01°. The result is 0 if a level vehicle exceeds the limit, and 180 if no attitude does.

    Raises `UsageError` within a degree of the magnetic poles.
    """
    require_headings(dip_deg)
    return engine().attitude_limit(ellipsoid.shape, covariance, dip_deg=dip_deg, limit_deg=limit_deg, down=down)


def direction_error_deg(ellipsoid: Ellipsoid, covariance: Floats) -> DirectionError:
    """Expected error of the direction of the corrected field over the whole sphere: rms and worst, degrees, 1 σ.

    It is computed by `direction_errors_deg` in 400 directions.
    """
    return DirectionError.of(direction_errors_deg(ellipsoid, covariance, _SPHERE_DIRECTIONS))


def direction_errors_deg(ellipsoid: Ellipsoid, covariance: Floats, directions: Floats) -> Floats:
    """(K,) expected error of the corrected field's direction, for a field along each of K directions, degrees, 1 σ.

    It is the length of the part of δu = −S⁻¹(δb + δS u) perpendicular to the direction u.

    Parameters
    ----------
    covariance : (9, 9) float
        Covariance of (b, S), in unit².
    directions : (K, 3) float
        Unit vectors, in corrected sensor axes.

    Examples
    --------
    >>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    >>> along_x = np.diag([1.0, 0, 0, 0, 0, 0, 0, 0, 0])         # 1 µT of 50: nothing along x, 1.15° across
    >>> direction_errors_deg(sphere, along_x, np.eye(3)).round(2)
    array([0.  , 1.15, 1.15])
    """
    return engine().direction_errors(ellipsoid.shape, covariance, directions)


def alignment_error_deg(sigma_deg: float, *, dip_deg: float = 60.0) -> float:
    """Heading error (1 σ, degrees) of a level vehicle from a mounting with the uncertainty `sigma_deg` about each axis.

    A rotation about z adds to the heading directly; a tilt changes the heading by up to tan I times the tilt.

    >>> round(alignment_error_deg(1.0, dip_deg=60.0), 2)
    2.0
    """
    return float(sigma_deg * np.hypot(1.0, np.tan(np.deg2rad(dip_deg))))


def body_error(
    ellipsoid: Ellipsoid, covariance: Floats, rotation: Floats, rotation_covariance: Floats, *, dip_deg: float = 60.0
) -> HeadingError:
    """Propagate the covariances of (b, S) and of the rotation R into body axes to the heading of the level body.

    The field is u(ψ) in body axes and Rᵀu in the magnetometer's axes. The calibration has the error δu, and the
    rotation has the error δθ. The heading error is then that of the field error R δu + δθ × u. Both errors are taken as
    independent. The mean error is not removed, because the mounting is known here.

    Raises `UsageError` within a degree of the magnetic poles.

    Parameters
    ----------
    covariance : (9, 9) float
        As for `level_error`.
    rotation : (3, 3) float
        Rotation from the magnetometer's own axes to those of the body.
    rotation_covariance : (3, 3) rad²
        Covariance of the rotation vector of the error δθ, in axes of the body.

    Examples
    --------
    A rotation about z changes the heading directly, a tilt by way of the vertical field:

    >>> sphere, exact = Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), np.zeros((9, 9))
    >>> body_error(sphere, exact, np.eye(3), np.diag([0.0, 0.0, np.radians(1.0) ** 2]))
    HeadingError(rms=1.00°, worst=1.00°, dip=60°)
    >>> body_error(sphere, exact, np.eye(3), np.diag([np.radians(1.0) ** 2, 0.0, 0.0]))
    HeadingError(rms=1.22°, worst=1.73°, dip=60°)
    """
    gradient = _body_gradients(ellipsoid, rotation, dip_deg, None)
    rms, worst = _in_degrees(gradient, _with_rotation(covariance, rotation_covariance))
    return HeadingError(rms, worst, float(dip_deg))


def _body_gradients(ellipsoid: Ellipsoid, rotation: Floats, dip_deg: float, down: Floats | None) -> Floats:
    """(72, 12) derivatives of the heading of a level body by (b, S) and by the rotation; their sign is arbitrary."""
    across, directions = level_fields(dip_deg, down)
    vectors = np.linalg.solve(ellipsoid.shape, rotation.T @ across)
    own = parameter_derivatives(vectors, rotation.T @ directions)
    return np.concatenate([own, np.cross(directions, across, axis=0).T], axis=1)


def _with_rotation(covariance: Floats, rotation_covariance: Floats | None) -> Floats:
    """(12, 12) joint covariance of (b, S) and an independent rotation."""
    both = np.zeros((12, 12))
    both[:9, :9] = covariance
    if rotation_covariance is not None:
        both[9:, 9:] = rotation_covariance
    return both


def raw_error(ellipsoid: Ellipsoid, *, dip_deg: float = 60.0, down: Floats | None = None) -> HeadingError:
    """Heading error of a level vehicle with uncorrected readings.

    It is the heading of the raw reading b + S u(ψ) minus the true heading ψ, without the mean over ψ. If the offset is
    larger than the horizontal field, the raw heading does not cover the full circle, and the error reaches 180°.

    Raises `UsageError` within a degree of the magnetic poles.
    """
    require_headings(dip_deg)
    rms, worst = engine().uncorrected_error(ellipsoid.centre, ellipsoid.shape, dip_deg=dip_deg, down=down)
    return HeadingError(rms, worst, float(dip_deg))


def level_turn(dip_deg: float, down: Floats | None = None) -> tuple[Floats, Floats]:
    """(72,) headings ψ and (3, 72) unit fields u(ψ) of a level vehicle in a full turn.

    Raises `UsageError` within a degree of the magnetic poles.

    Parameters
    ----------
    down : (3,) float, optional
        Down direction of the level vehicle in corrected sensor axes; by default +z.

    Examples
    --------
    >>> on_its_side = np.array([0.0, 1.0, 0.0])
    >>> bool(np.allclose(on_its_side @ level_turn(30.0, on_its_side)[1], 0.5))
    True
    """
    heading, fields, _ = _turn_at(float(dip_deg))
    return heading, fields if down is None else upright(down) @ fields


@lru_cache(maxsize=16)
def _turn_at(dip_deg: float) -> tuple[Floats, Floats, Floats]:
    """(72,) headings, (3, 72) fields, and (3, 72) derivatives of the heading by the field, all read-only."""
    require_headings(dip_deg)
    dip = np.deg2rad(dip_deg)
    heading = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    level, zeros = np.cos(dip), np.zeros(HEADINGS)
    fields = np.stack([level * np.cos(heading), -level * np.sin(heading), np.full(HEADINGS, np.sin(dip))])
    across = np.stack([np.sin(heading), np.cos(heading), zeros]) / level
    for array in (heading, fields, across):
        array.flags.writeable = False
    return heading, fields, across


def require_headings(dip_deg: float) -> None:
    """Raise `UsageError` within a degree of the magnetic poles, where there is no heading."""
    if not abs(dip_deg) <= MAX_DIP_DEG:
        raise UsageError(f"dip is {dip_deg:g}°: need −{MAX_DIP_DEG:g}° to {MAX_DIP_DEG:g}°")


def upright(down: Floats) -> Floats:
    """(3, 3) rotation by the smallest angle from +z to the (3,) direction `down`; about the x axis if that is −z.

    >>> upright(np.array([0.0, 0.0, -1.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    over = np.diag([1.0, -1.0, -1.0]) if down[2] < 0.0 else np.eye(3)
    x, y, z = over @ (down / np.linalg.norm(down))
    bend = 1.0 / (1.0 + z)
    turn = [[1.0 - bend * x * x, -bend * x * y, x], [-bend * x * y, 1.0 - bend * y * y, y], [-x, -y, z]]
    rotation: Floats = over @ np.array(turn)
    return rotation


def level_fields(dip_deg: float, down: Floats | None = None) -> tuple[Floats, Floats]:
    """(3, 72) derivatives of the heading by the field, and (3, 72) fields, in a level turn about `down`."""
    _, directions, across = _turn_at(float(dip_deg))
    if down is None:
        return across, directions
    turn = upright(down)
    return turn @ across, turn @ directions


def _in_degrees(gradient: Floats, covariance: Floats) -> tuple[float, float]:
    """Rms and largest standard deviation along (K, 9) gradients in rad, in degrees."""
    variance = (gradient @ covariance * gradient).sum(axis=1).clip(min=0.0)
    return math.degrees(math.sqrt(variance.mean())), math.degrees(math.sqrt(variance.max()))


def level_bound_deg(
    ellipsoid: Ellipsoid, covariance: Floats, *, dip_deg: float = 60.0, down: Floats | None = None
) -> float:
    """95 % bound in degrees of the heading error of a level vehicle over a whole turn.

    Parameters are those of `level_error`.
    """
    require_headings(dip_deg)
    return engine().heading_bound(ellipsoid.shape, covariance, dip_deg=dip_deg, down=down)


@lru_cache(maxsize=2)
def _harmonics(count: int) -> Floats:
    """(count, 4) sine and cosine of evenly spaced headings and of their doubles."""
    heading = np.arange(count) * (2.0 * np.pi / count)
    return np.stack([np.sin(heading), np.cos(heading), np.sin(2.0 * heading), np.cos(2.0 * heading)], axis=1)
