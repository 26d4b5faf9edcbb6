"""From an uncertain calibration to degrees of heading.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> offset_only = np.diag([0.25, 0.25, 0.25, 0, 0, 0, 0, 0, 0])
>>> level_error(sphere, offset_only, dip_deg=60.0)     # 0.5 µT on a horizontal field of 25 µT
HeadingError(rms=1.15°, worst=1.15°, dip=60°)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UsageError
from flinders.quadric import Ellipsoid, gathered

if TYPE_CHECKING:
    from flinders.arrays import Floats

HEADINGS: Final = 72
STEEPEST_DIP_DEG: Final = 89.0


@dataclass(frozen=True, slots=True)
class HeadingError:
    """What to expect of the heading of a level vehicle, 1 σ, its mean over all headings taken off.

    Attributes
    ----------
    rms : float, degrees
        Over all headings.
    worst : float, degrees
        At the worst heading.
    dip_deg : float
        Dip of the field for which it holds, positive where the field points along +z.
    """

    rms: float
    worst: float
    dip_deg: float

    def __repr__(self) -> str:
        return f"HeadingError(rms={self.rms:.2f}°, worst={self.worst:.2f}°, dip={self.dip_deg:g}°)"


def level_error(ellipsoid: Ellipsoid, covariance: Floats, *, dip_deg: float = 60.0) -> HeadingError:
    """Carry the covariance of (b, S) over to the heading of a level vehicle.

    With the field u(ψ) = (cos I cos ψ, −cos I sin ψ, sin I) in body axes (z down) and the corrected
    reading's error δu = −S⁻¹(δb + δS u), the heading errs by δψ = −(sin ψ δu₁ + cos ψ δu₂)/cos I. A
    constant part is a matter of mounting, which a magnetometer cannot see, and is taken off.

    Parameters
    ----------
    ellipsoid : Ellipsoid
    covariance : (9, 9) float
        Of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit².
    dip_deg : float
        Inclination of the field at the site; negative in the south.

    Raises
    ------
    UsageError
        Within a degree of the magnetic poles, where there is no heading.
    """
    heading, directions = level_turn(dip_deg)
    across = np.stack([np.sin(heading), np.cos(heading), np.zeros(HEADINGS)]) / np.cos(np.deg2rad(dip_deg))
    gradient = gathered(np.linalg.solve(ellipsoid.shape, across), directions)
    gradient -= gradient.mean(axis=0)
    variance = np.sum(gradient @ covariance * gradient, axis=1).clip(min=0.0)
    rms, worst = np.sqrt(variance.mean()), np.sqrt(variance.max())
    return HeadingError(float(np.rad2deg(rms)), float(np.rad2deg(worst)), float(dip_deg))


def direction_error_deg(ellipsoid: Ellipsoid, covariance: Floats) -> tuple[float, float]:
    """What to expect of the direction of the corrected field over the whole sphere: rms and worst, degrees, 1 σ.

    The error δu = −S⁻¹(δb + δS u) across u, in 400 directions.
    """
    height = 1.0 - (2.0 * np.arange(400) + 1.0) / 400
    turn = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(400) + 0.5)
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), height])
    east = np.stack([-np.sin(turn), np.cos(turn), np.zeros(400)])
    variance = np.zeros(400)
    for tangent in (east, np.cross(directions, east, axis=0)):
        gradient = gathered(np.linalg.solve(ellipsoid.shape, tangent), directions)
        variance += np.sum(gradient @ covariance * gradient, axis=1).clip(min=0.0)
    return float(np.rad2deg(np.sqrt(variance.mean()))), float(np.rad2deg(np.sqrt(variance.max())))


def alignment_error_deg(sigma_deg: float, *, dip_deg: float = 60.0) -> float:
    """Heading error (1 σ) of a level vehicle from a mounting that is known to `sigma_deg` about each axis.

    A turn about z goes straight into the heading; a tilt mixes the vertical field in, by tan I of it.

    >>> round(alignment_error_deg(1.0, dip_deg=60.0), 2)
    2.0
    """
    return float(sigma_deg * np.hypot(1.0, np.tan(np.deg2rad(dip_deg))))


def raw_error(ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> HeadingError:
    """What the heading of a level vehicle errs by if its readings are used as they come.

    The heading of b + S u(ψ) less ψ, its mean taken off. Where the offset is larger than the
    horizontal field the raw heading does not even go round, and the error reaches 180°.

    Raises
    ------
    UsageError
        Within a degree of the magnetic poles.
    """
    heading, directions = level_turn(dip_deg)
    readings = ellipsoid.centre[:, np.newaxis] + ellipsoid.shape @ directions
    errors = np.exp(1j * (np.arctan2(-readings[1], readings[0]) - heading))
    mean = errors.mean()
    errors = np.angle(errors / (mean / abs(mean) if abs(mean) > 0.0 else 1.0))
    rms, worst = np.sqrt(np.mean(errors**2)), np.abs(errors).max()
    return HeadingError(float(np.rad2deg(rms)), float(np.rad2deg(worst)), float(dip_deg))


def level_turn(dip_deg: float) -> tuple[Floats, Floats]:
    """(72,) headings ψ and (3, 72) unit fields u(ψ) that a level vehicle meets in a full turn.

    Raises
    ------
    UsageError
        Within a degree of the magnetic poles.
    """
    if not abs(dip_deg) <= STEEPEST_DIP_DEG:
        raise UsageError(f"dip is {dip_deg:g}°: need −{STEEPEST_DIP_DEG:g}° to {STEEPEST_DIP_DEG:g}°")
    dip = np.deg2rad(dip_deg)
    heading = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    level = np.cos(dip)
    return heading, np.stack([level * np.cos(heading), -level * np.sin(heading), np.full(HEADINGS, np.sin(dip))])
