"""Simulated swing of a two-axis compass: readings at equally spaced headings while it stays level.

The compass has two scales, two offsets and the deviation of its axes from a right angle. Steps of 10° give the 36
points of the spreadsheets for two-axis compasses.

>>> compass = TwoAxis(scale=(1.1, 0.9), offset=(10.0, -5.0), skew_deg=4.0)
>>> swung = swing(compass)
>>> swung.samples.field[[0, 9, 18, 27], :2].round(2).tolist()      # north, east, south, west
[[37.5, -6.57], [10.0, -27.44], [-17.5, -3.43], [10.0, 17.44]]
>>> horizontal = swung.field_strength * np.cos(np.radians(swung.dip_deg))
>>> TwoAxis.from_ellipse(compass.offset, horizontal * compass.matrix, horizontal)
TwoAxis(scale=(1.1, 0.9), offset=(10, -5), skew_deg=4, noise=0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, to_floats
from flinders.arrays import check_matrix as square
from flinders.core.samples import Samples
from flinders.errors import ArrayError, UsageError
from flinders.geometry.plane import heading_errors
from flinders.simulate._checks import count, not_negative, positive
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down
from flinders.simulate.recording import Simulated
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike

POINTS: Final = 36


@dataclass(frozen=True, slots=True, repr=False)
class TwoAxis:
    """A compass with two level axes, x ahead and y to the right.

    At the heading ψ, in a horizontal field H, it reads

        x = offset₁ + scale₁ H cos ψ
        y = offset₂ − scale₂ H sin(ψ + skew)

    Raises
    ------
    ArrayError, UsageError
        For scales that are not positive, a skew that makes the axes parallel, or negative noise.
    """

    scale: tuple[float, float] = (1.0, 1.0)  #: pair of float: scale of each axis
    offset: tuple[float, float] = (0.0, 0.0)  #: pair of float, µT: reading of each axis in zero field
    skew_deg: float = 0.0  #: degrees: deviation of the y axis from a right angle, clockwise seen from above
    noise: float = 0.0  #: µT: white noise of each axis, 1 σ

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "scale", _pair(self.scale, "scale"))
        object.__setattr__(self, "offset", _pair(self.offset, "offset"))
        if not min(self.scale) > 0.0:
            raise UsageError(f"scale is {self.scale[0]:g}, {self.scale[1]:g}: need two positive numbers")
        if not abs(self.skew_deg) < 90.0:
            raise UsageError(f"skew is {self.skew_deg:g}°: need less than 90° either way")
        not_negative(self.noise, "noise", "µT")

    @classmethod
    def from_ellipse(cls, centre: ArrayLike, shape: ArrayLike, horizontal: float, *, noise: float = 0.0) -> Self:
        """Compass whose readings lie on an ellipse.

        Parameters
        ----------
        centre : (2,) array-like, µT
        shape : (2, 2) array-like, µT
            Maps unit vectors to readings relative to the centre. A rotation of the unit vectors does not matter.
        horizontal : float, µT
            Horizontal field strength; raises `UsageError` if it is not positive.
        noise : float, µT
        """
        first, second = square(shape, "shape", 2)
        x, y = math.hypot(*first), math.hypot(*second)
        skew = -math.asin(np.clip(first @ second / (x * y), -1.0, 1.0))
        horizontal = positive(horizontal, "horizontal")
        return cls((x / horizontal, y / horizontal), _pair(centre, "centre"), math.degrees(skew), noise)

    @property
    def matrix(self) -> Floats:
        """(2, 2) matrix from the field, ahead and to the right, to the readings less their offset."""
        skew = math.radians(self.skew_deg)
        return np.array([[self.scale[0], 0.0], [-self.scale[1] * math.sin(skew), self.scale[1] * math.cos(skew)]])

    def sensor(self, vertical: float) -> Sensor:
        """Equivalent sensor with three axes, whose third axis reads zero in the vertical field (µT) of the site."""
        matrix = np.eye(3)
        matrix[:2, :2] = self.matrix
        return Sensor(matrix, np.array([*self.offset, -vertical]), self.noise)

    def __repr__(self) -> str:
        scale, offset = (", ".join(f"{part:.6g}" for part in pair) for pair in (self.scale, self.offset))
        return f"TwoAxis(scale=({scale}), offset=({offset}), skew_deg={self.skew_deg:.6g}, noise={self.noise:.6g})"


@dataclass(frozen=True, slots=True, eq=False)
class Polar:
    """A swing in polar coordinates, before and after correction, for a drawing around a compass rose."""

    heading_deg: Floats  #: (N,): true headings
    raw_radius: Floats  #: (N,), µT: length of the horizontal readings
    raw_heading_deg: Floats  #: (N,): heading that the compass shows, 0 to 360
    #: (N,): error of that heading, −180 to 180, without its mean, as a swing cannot observe the mounting
    raw_error_deg: Floats
    corrected_radius: Floats  #: (N,), µT: length of the corrected horizontal readings
    corrected_heading_deg: Floats  #: (N,): heading after correction, 0 to 360
    corrected_error_deg: Floats  #: (N,): error of the heading after correction, −180 to 180, without its mean

    @classmethod
    def of(cls, swung: Simulated, matrix: ArrayLike, offset: ArrayLike) -> Self:
        """Compare a swing with its true headings, before and after the correction ``matrix @ (raw - offset)``."""
        headings = headings_deg(len(swung.samples))
        raw = swung.samples.field
        corrected = (raw - to_floats(offset, "offset")) @ square(matrix).T
        return cls(headings, *_polar(raw, headings), *_polar(corrected, headings))

    def as_dict(self) -> dict[str, Floats]:
        """Columns by name."""
        return {name: getattr(self, name) for name in self.__slots__}


def headings_deg(points: int = POINTS) -> Floats:
    """(points,) equally spaced headings in degrees, the first north.

    >>> headings_deg(4).tolist()
    [0.0, 90.0, 180.0, 270.0]
    """
    headings: Floats = np.arange(count(points, 3)) * (360.0 / points)
    return headings


def swing(
    compass: TwoAxis | None = None,
    *,
    seed: int | Generator = 0,
    points: int = POINTS,
    field_strength: float = 50.0,
    dip_deg: float = 60.0,
) -> Simulated:
    """Simulate a swing: one reading of a level compass at each of `headings_deg`; by default of a perfect compass.

    The horizontal field is `field_strength`, in µT, times the cosine of `dip_deg`. Raises `UsageError` for a number out
    of its range; at least three `points` are needed.
    """
    compass = TwoAxis() if compass is None else compass
    if not abs(dip_deg) <= 89.0:
        raise UsageError(f"dip is {dip_deg:g}°: need −89° to 89°, as a vertical field gives no heading")
    rng = np.random.default_rng(seed)
    attitudes = attitudes_of(np.radians(headings_deg(points)), 0.0, 0.0)
    world = north_and_down(dip_deg)
    directions = in_body_axes(attitudes, world)
    sensor = compass.sensor(positive(field_strength, "field_strength") * world[2])
    raw = sensor.read(field_strength * directions, rng)
    raw[:, 2] = 0.0
    samples = Samples.of(raw, unit="uT", source="simulated swing of a two-axis compass")
    return Simulated(
        samples,
        sensor,
        directions,
        field_strength,
        np.zeros(points, dtype=np.bool_),
        attitudes,
        dip_deg=float(dip_deg),
        motion="two-axis",
        seed=seed if isinstance(seed, int) else None,
    )


def _polar(readings: Floats, headings: Floats) -> tuple[Floats, Floats, Floats]:
    """(N,) radius in the unit of the readings, heading and heading error in degrees, of (N, 3) readings."""
    errors, _ = heading_errors(readings.T, np.radians(headings))
    shown = np.degrees(np.arctan2(-readings[:, 1], readings[:, 0])) % 360.0
    return np.hypot(readings[:, 0], readings[:, 1]), shown, np.degrees(errors)


def _pair(values: ArrayLike, name: str) -> tuple[float, float]:
    """Two finite numbers; raises `ArrayError` for other values."""
    array = to_floats(values, name)
    if array.shape != (2,) or not np.all(np.isfinite(array)):
        raise ArrayError(f"{name} is {np.array2string(array)}: need two finite numbers, for x and y")
    return float(array[0]), float(array[1])
