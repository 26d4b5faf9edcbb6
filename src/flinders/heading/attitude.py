"""Compass headings from a corrected field and the specific force of an accelerometer.

With the field m and the specific force f, ``down = −f``, ``E = down × m`` points east and ``N = E × down`` north. The
heading of the sensor's x axis is ψ = atan2(E_x/|E|, N_x/|N|). The formula needs no roll and pitch, nor any convention
for them. It holds at every attitude, for z up or down, if both sensors have the same right-handed axes.

>>> level, north_east = [0.0, 0.0, -9.81], [15.0, -15.0, 45.0]     # forward, right, down; specific force is −g on z
>>> float(magnetic_heading_deg(north_east, level))
45.0
>>> rolled = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]])            # by 53°
>>> round(float(magnetic_heading_deg(rolled @ north_east, rolled @ level)), 9)
45.0
>>> round(float(level_heading_deg(rolled @ north_east)), 1)            # without the tilt: two axes are not enough
299.1
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import check_vectors
from flinders.geometry.angles import wrap_360

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

MIN_SINE: Final = 1e-6
"""Smallest sine of the angle of the field, and of the x axis, to the vertical at which there is a heading."""


def magnetic_heading_deg(field: ArrayLike, specific_force: ArrayLike) -> Floats:
    """Tilt-compensated magnetic heading of the x axis: exact at every attitude.

    Raises `ArrayError` for a wrong shape, or values that are not numbers.

    Parameters
    ----------
    field : (..., 3)
        Corrected readings in any unit.
    specific_force : (..., 3)
        Readings of an accelerometer, in the same axes and any unit: −g on z at rest, level, with z down.

    Returns
    -------
    (...,) degrees in [0, 360)
        Clockwise from magnetic north; NaN if the field or the x axis is vertical, or a number is missing.

    Notes
    -----
    NXP's AN4248 gives the same to 1e-12° with x forward, y right, z down; see `an4248`.
    """
    m, down = _unit(field, "field"), -_unit(specific_force, "specific_force")
    east = np.cross(down, m)
    north = np.cross(east, down)
    horizontal = np.linalg.norm(east, axis=-1)
    return _heading(east[..., 0], north[..., 0], horizontal)


def level_heading_deg(field: ArrayLike) -> Floats:
    """Heading of a level sensor with x forward, y right, from two axes: ψ = atan2(−m_y, m_x).

    `field` has (..., 3) or (..., 2) corrected readings; the result is (...,) degrees in [0, 360). Raises as
    `magnetic_heading_deg`. A tilt by τ degrees causes a heading error of up to τ tan I: 1.7° per degree at a dip of
    60°.

    >>> level_heading_deg([[20.0, 0.0, 45.0], [0.0, -20.0, 45.0], [-20.0, 0.0, 45.0], [0.0, 20.0, 45.0]])
    array([  0.,  90., 180., 270.])
    """
    flat = np.asarray(field)
    if flat.ndim and flat.shape[-1] == 2:
        field = np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1)
    m = _unit(field, "field")
    return _heading(-m[..., 1], m[..., 0], np.hypot(m[..., 0], m[..., 1]))


def an4248(field: ArrayLike, specific_force: ArrayLike) -> Floats:
    """Heading by NXP's AN4248, from roll and pitch, for x forward, y right, z down; equal to `magnetic_heading_deg`.

    φ = atan2(G_y, G_z); θ = atan2(−G_x, G_y sin φ + G_z cos φ);
    ψ = atan2(m_z sin φ − m_y cos φ, m_x cos θ + (m_y sin φ + m_z cos φ) sin θ), with G pointing down.

    Parameters, result and errors as `magnetic_heading_deg`.
    """
    m, down = _unit(field, "field"), -_unit(specific_force, "specific_force")
    roll, pitch = _roll(down), _pitch(down)
    along = m[..., 1] * np.sin(roll) + m[..., 2] * np.cos(roll)
    east = m[..., 2] * np.sin(roll) - m[..., 1] * np.cos(roll)
    return _heading(east, m[..., 0] * np.cos(pitch) + along * np.sin(pitch), np.linalg.norm(m, axis=-1))


def an3192(field: ArrayLike, specific_force: ArrayLike) -> Floats:
    """Heading by the formula commonly cited as ST's AN3192, for comparison only: wrong if rolled *and* pitched.

    θ = asin(−G_x), φ = asin(G_y/cos θ); X = m_x cos θ + m_z sin θ; Y = m_x sin φ sin θ + m_y cos φ − m_z sin φ cos θ;
    ψ = atan2(−Y, X), with G pointing down. The formula is exact with roll or pitch alone. With equal roll and pitch its
    error at a dip of 60° is up to 2.1° at 10°, 9.6° at 20° and 24° at 30°. It is wrong for a sensor upside down.

    Parameters, result and errors as `magnetic_heading_deg`.

    >>> def turned(roll, pitch):  # what sensors read that head north, dip 60°, ψ → θ → φ
    ...     (cr, cp), (sr, sp) = np.cos([roll, pitch]), np.sin([roll, pitch])
    ...     rows = [[cp, 0, -sp], [sr * sp, cr, sr * cp], [cr * sp, -sr, cr * cp]]
    ...     return np.array(rows) @ [0.5, 0.0, 0.75**0.5], -np.array(rows) @ [0.0, 0.0, 1.0]
    >>> field, force = turned(0.3, 0.3)
    >>> round(float(magnetic_heading_deg(field, force)), 6), round(float(an3192(field, force)), 1)
    (0.0, 356.3)
    """
    m, down = _unit(field, "field"), -_unit(specific_force, "specific_force")
    with np.errstate(invalid="ignore", divide="ignore"):
        pitch = np.arcsin((-down[..., 0]).clip(-1.0, 1.0))
        roll = np.arcsin((down[..., 1] / np.cos(pitch)).clip(-1.0, 1.0))
    x, y, z = np.moveaxis(m, -1, 0)
    ahead = x * np.cos(pitch) + z * np.sin(pitch)
    right = x * np.sin(roll) * np.sin(pitch) + y * np.cos(roll) - z * np.sin(roll) * np.cos(pitch)
    return _heading(-right, ahead, np.linalg.norm(m, axis=-1))


FORMULAS: Final[Mapping[str, Callable[[ArrayLike, ArrayLike], Floats]]] = MappingProxyType(
    {"exact": magnetic_heading_deg, "an4248": an4248, "an3192": an3192}
)
"""Formulas of a tilt-compensated heading by name; all but the first are for comparison."""


def roll_pitch_deg(specific_force: ArrayLike) -> tuple[Floats, Floats]:
    """Roll in (−180, 180] and pitch in [−90, 90], (...,) degrees each, from a (..., 3) specific force.

    Axes are x forward, y right, z down. Right side down and nose up are positive.

    >>> roll, pitch = roll_pitch_deg([[0.0, 0.0, -1.0], [0.0, -0.5, -(0.75**0.5)], [0.5, 0.0, -(0.75**0.5)]])
    >>> roll.round(6), pitch.round(6)
    (array([ 0., 30.,  0.]), array([ 0.,  0., 30.]))
    """
    down = -_unit(specific_force, "specific_force")
    return np.rad2deg(_roll(down)) + 0.0, np.rad2deg(_pitch(down)) + 0.0


def dip_deg(field: ArrayLike, specific_force: ArrayLike) -> Floats:
    """Inclination of the field below the horizon: (...,) degrees in [−90, 90], the same at every attitude.

    >>> round(float(dip_deg([25.0, 0.0, 43.3], [0.0, 0.0, -1.0])), 2)
    60.0
    """
    m, down = _unit(field, "field"), -_unit(specific_force, "specific_force")
    dip: Floats = np.rad2deg(np.arcsin(np.sum(m * down, axis=-1).clip(-1.0, 1.0)))
    return dip


MAX_SCATTER_DEG: Final = 6.0
"""Largest scatter of the dip in degrees if accelerometer and magnetometer are on one body with the same axes.

A bias of 0.6 m/s² causes a scatter of 3.5°.
"""


def tilt_error_deg(field: ArrayLike, specific_force: ArrayLike, *, own_deg: float = 0.0) -> float:
    """Heading error (1 σ) from errors of the vertical: tan I times the scatter of the dip, without noise.

    A bias of the accelerometer, or misaligned axes, change the dip with the attitude, while noise is independent
    between readings. The covariance of the dip of consecutive readings therefore contains the errors of the vertical
    and of the calibration, but no noise.

    Parameters
    ----------
    field, specific_force : (N, 3)
        Corrected field and specific force, in the order of recording, of a body that is hardly accelerated.
    own_deg : float
        Scatter of the dip (1 σ) that comes from the magnetometer: errors of its calibration, correlated residuals.

    Returns
    -------
    float, degrees
        NaN without two consecutive readings, or if the accelerometer is not of this body.

    Examples
    --------
    >>> turn = np.radians(np.arange(0.0, 720.0, 4.0))
    >>> field = np.stack([0.5 * np.cos(turn), -0.5 * np.sin(turn), np.full(180, 0.75**0.5)], axis=1)
    >>> round(tilt_error_deg(field, np.broadcast_to([0.3, 0.0, -9.81], (180, 3))), 1)             # tan 60° · 1.75° / √2
    2.1
    """
    dips = dip_deg(field, specific_force)
    dips = dips[np.isfinite(dips)]
    if len(dips) < 2:
        return float("nan")
    middle = float(np.median(dips))
    common = float(np.mean((dips[1:] - middle) * (dips[:-1] - middle))) - own_deg**2
    if common > MAX_SCATTER_DEG**2:
        return float("nan")
    return math.sqrt(max(common, 0.0)) * abs(math.tan(math.radians(middle)))


def _unit(values: ArrayLike, name: str) -> Floats:
    """Vectors divided by their length; NaN for zero vectors."""
    array = check_vectors(values, name, finite=False)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scaled = array / np.abs(array).max(axis=-1, keepdims=True, initial=0.0)
        unit: Floats = scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)
    return unit


def _roll(down: Floats) -> Floats:
    """Roll (...) in rad, right side down is positive."""
    roll: Floats = np.arctan2(down[..., 1], down[..., 2])
    return roll


def _pitch(down: Floats) -> Floats:
    """Pitch (...) in rad, nose up is positive."""
    pitch: Floats = np.arctan2(-down[..., 0], np.hypot(down[..., 1], down[..., 2]))
    return pitch


def _heading(east: Floats, north: Floats, horizontal: Floats) -> Floats:
    """Angle of a horizontal vector in degrees; NaN if the vector or the horizontal field is too short."""
    heading = np.rad2deg(np.arctan2(east, north))
    is_known = (horizontal > MIN_SINE) & (np.hypot(east, north) > MIN_SINE * horizontal)
    return wrap_360(np.where(is_known, heading, np.nan))
