"""Readings of a turn in one plane: their ellipse, and the evenness of their angles.

If a sensor is turned about one axis, the readings of the other two lie on an ellipse. If the points are equally spaced
in heading, their mean is the centre of the ellipse, and twice their centred scatter is the square of its shape:

>>> heading = np.radians(np.arange(0, 360, 10))
>>> points = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5], axis=1)
>>> found = PlaneEllipse.of_points(points)
>>> found.centre.round(9), found.semi_axes.round(9), round(found.direction_deg, 9)
(array([10., -5.]), array([30., 20.]), 0.0)

If the points are not equally spaced, the ellipse is wrong by the harmonics of their angles:

>>> Spacing.of(found.angles(points)).is_even(within_deg=1.0)
True
>>> print(Spacing.of(found.angles(points[:27])))
27 points around 360°, widest gap 100°; first harmonic 0.300, second 0.213: the mean costs up to 23° of heading

The ellipse of a turn follows from the sensor's ellipsoid. With the field u = (cos I cos ψ, −cos I sin ψ, sin I), in the
axis order of the plane, the ellipse is

    (b + sin I S₃) + cos I S₂ (cos ψ, −sin ψ)

where S₃ is the column of the shape for the axis of the turn, and S₂ the part of the shape in the plane. The ellipse is
linear in offset and shape, so that covariances can be propagated. By its ellipse a fit in one plane is compared with
other calibrations.

>>> turned = Ellipsoid(np.array([10.0, 20.0, 30.0]), np.diag([50.0, 40.0, 60.0]))
>>> flat = equator(turned, "xy", dip_deg=60.0)
>>> flat.centre.round(9), np.diag(flat.shape).round(9)
(array([10., 20.,  0.]), array([25. , 20. , 22.5]))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self, TypeAlias, get_args

import numpy as np

from flinders.errors import UsageError, count_text, figures
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats

Plane: TypeAlias = Literal["xy", "yz", "zx"]
"""The two axes in the plane of a turn; the third axis, by the right-hand rule, is the axis of the turn."""

PLANES: Final[tuple[Plane, ...]] = get_args(Plane)

PLANE_PARAMETERS: Final = [0, 1, 3, 4, 6]
"""Indices of b₁, b₂, S₁₁, S₂₂, S₁₂ among the nine parameters, which readings in the plane ``xy`` determine."""


def axis_order(plane: Plane) -> tuple[int, int, int]:
    """Indices of the first and second axis of a plane, and of the axis of the turn.

    Raises `UsageError` for an unknown plane.

    Examples
    --------
    >>> axis_order("xy"), axis_order("zx")
    ((0, 1, 2), (2, 0, 1))
    """
    if plane not in PLANES:
        raise UsageError(f"plane is {plane!r}: need one of {', '.join(PLANES)}")
    first = "xyz".index(plane[0])
    return first, (first + 1) % 3, (first + 2) % 3


def turn_axis(plane: Plane) -> str:
    """Name of the axis of a turn in a plane.

    >>> turn_axis("zx")
    'y'
    """
    return "xyz"[axis_order(plane)[2]]


def down_direction(plane: Plane | None) -> Floats | None:
    """(3,) down direction of a sensor that turns in a horizontal `plane`; None if that is +z.

    >>> down_direction("yz"), down_direction("xy")
    (array([1., 0., 0.]), None)
    """
    return None if plane in (None, "xy") else np.eye(3)[axis_order(plane)[2]]


def heading_errors(readings: Floats, heading: Floats) -> tuple[Floats, float]:
    """(N,) heading errors without their mean, and the mean, of (3, N) readings of a level vehicle at (N,) headings.

    All angles are in rad. An offset of 0.1 of the horizontal field gives 0.1 rad where the field is across the offset:

    >>> turn = np.radians(np.arange(0.0, 360.0, 90.0))
    >>> readings = np.stack([np.cos(turn) + 0.1, -np.sin(turn), 0.0 * turn])
    >>> [np.rad2deg(each).round(1).tolist() for each in heading_errors(readings, turn)]
    [[0.0, -5.7, 0.0, 5.7], 0.0]
    """
    off = np.exp(1j * (np.arctan2(-readings[1], readings[0]) - heading))
    mean = float(np.angle(off.mean()))
    return np.angle(off * np.exp(-1j * mean)), mean


@dataclass(frozen=True, slots=True, eq=False)
class PlaneEllipse:
    """The ellipse of points centre + shape · u for all unit vectors u of a plane."""

    centre: Floats  #: (2,): in the unit of the readings, along the first and the second axis of the plane
    shape: Floats  #: (2, 2): symmetric and positive definite, in the unit of the readings

    @classmethod
    def of_points(cls, points: Floats) -> Self:
        """Ellipse of (N, 2) equally spaced points, from their mean and scatter."""
        return cls.of_blocks([points])

    @classmethod
    def of_blocks(cls, blocks: Iterable[Floats]) -> Self:
        """As `of_points`, of blocks of (N, 2) points."""
        count, mean, scatter = 0, np.zeros(2), np.zeros((2, 2))
        for block in blocks:
            if not len(block):
                continue
            own = block.mean(axis=0)
            centred = block - own
            apart, total = own - mean, count + len(block)
            scatter += centred.T @ centred + np.outer(apart, apart) * (count * len(block) / total)
            mean = mean + apart * (len(block) / total)
            count = total
        return cls(mean, symmetric_root(2.0 * scatter / max(count, 1)))

    @property
    def radius(self) -> float:
        """Geometric mean of the semi-axes: radius of the circle of the same area."""
        return float(np.sqrt(np.prod(self.semi_axes)))

    @property
    def semi_axes(self) -> Floats:
        """(2,) semi-axes, the long one first."""
        return np.linalg.eigvalsh(self.shape)[::-1].clip(min=0.0)

    @property
    def eigenvalues(self) -> Floats:
        """(2,) eigenvalues of the scatter of equally spaced points on the ellipse: half the squared semi-axes."""
        return self.semi_axes**2 / 2.0

    @property
    def ratio(self) -> float:
        """Long semi-axis divided by the short one."""
        long, short = self.semi_axes.tolist()
        return float(long / short)

    @property
    def direction_deg(self) -> float:
        """Skew angle: direction of the long axis, from the first axis towards the second, −90° to 90°.

        Undefined for a circle.
        """
        x, y = np.linalg.eigh(self.shape)[1][:, 1]
        angle = float(np.degrees(np.arctan2(y, x)))
        folded = (angle + 90.0) % 180.0 - 90.0
        return 90.0 if folded < -90.0 + 1e-9 else folded

    @property
    def matrix(self) -> Floats:
        """(2, 2) correction that maps the ellipse to a circle of the same area; symmetric, determinant 1."""
        return self.radius * np.linalg.inv(self.shape)

    def correct(self, points: Floats) -> Floats:
        """Correct (N, 2) points: ``matrix @ (point - centre)``."""
        corrected: Floats = (points - self.centre) @ self.matrix
        return corrected

    def angles(self, points: Floats) -> Floats:
        """(N,) angles in rad of corrected points, from the first axis towards the second."""
        x, y = self.correct(points).T
        angles: Floats = np.arctan2(y, x)
        return angles

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            "centre": self.centre.tolist(),
            "eigenvalues": self.eigenvalues.tolist(),
            "semi_axes": self.semi_axes.tolist(),
            "axis_ratio": self.ratio,  # long over short semi-axis
            "skew_angle_deg": self.direction_deg,  # direction of the long axis, from the first axis towards the second
            "matrix": self.matrix.tolist(),
        }


@dataclass(frozen=True, slots=True)
class Spacing:
    """Evenness of points around a circle.

    For angles φ the harmonics are r₁ = |mean exp(iφ)| and r₂ = |mean exp(2iφ)|, which are 0 for equally spaced points.
    If the points are not equally spaced, their mean is r₁ radii from the centre, and their scatter is that of an
    ellipse with the axis ratio 1 + r₂. Mean and scatter then give heading errors of up to r₁ + r₂/2 rad, to first
    order.
    """

    points: int  #: number of points
    first_harmonic: float  #: r₁, 0 to 1
    second_harmonic: float  #: r₂, 0 to 1
    widest_gap_deg: float  #: largest angle between neighbours

    @classmethod
    def of(cls, angles: Floats) -> Self:
        """Evenness of (N,) angles in rad, which may be those of several turns.

        >>> Spacing.of(np.radians([0.0, 90.0, 180.0, 270.0])).widest_gap_deg
        90.0
        """
        sorted_angles = np.sort(np.mod(angles, 2.0 * np.pi))
        gaps = np.diff(sorted_angles, append=sorted_angles[:1] + 2.0 * np.pi)
        phasor = np.exp(1j * np.asarray(angles))
        first, second = float(abs(phasor.mean())), float(abs((phasor * phasor).mean()))
        return cls(len(angles), first, second, float(np.degrees(gaps.max())))

    @property
    def cost_deg(self) -> float:
        """Heading error in degrees, at the worst heading, if mean and scatter of these points are used."""
        return float(np.degrees(self.first_harmonic + self.second_harmonic / 2.0))

    def is_even(self, *, within_deg: float) -> bool:
        """Whether the heading error from mean and scatter, `cost_deg`, is at most `within_deg`."""
        return self.cost_deg <= within_deg

    def as_dict(self) -> dict[str, float]:
        """Values for JSON, by name."""
        return {
            "first_harmonic": self.first_harmonic,
            "second_harmonic": self.second_harmonic,
            "widest_gap_deg": self.widest_gap_deg,
            "cost_deg": self.cost_deg,
        }

    def __str__(self) -> str:
        cost = f"{figures(self.cost_deg)}°" if self.cost_deg >= 0.005 else "0.00°"
        return (
            f"{count_text(self.points, 'point')} around 360°, widest gap {self.widest_gap_deg:.0f}°; "
            f"first harmonic {self.first_harmonic:.3f}, second {self.second_harmonic:.3f}: "
            f"the mean costs up to {cost} of heading"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A turn in one plane, with two ellipses of its points: from mean and scatter, and by least squares."""

    plane: Plane  #: plane of the turn: ``xy``, ``yz`` or ``zx``
    points: Floats  #: (N, 2): readings along the first and the second axis of the plane
    recipe: PlaneEllipse  #: ellipse from mean and scatter
    ellipse: PlaneEllipse  #: ellipse by least squares, which does not depend on the spacing of the points
    spacing: Spacing  #: evenness of the points after correction by `ellipse`

    @classmethod
    def of(cls, plane: Plane, points: Floats, ellipse: PlaneEllipse) -> Self:
        """Compare (N, 2) points with the least-squares ellipse through them."""
        recipe = PlaneEllipse.of_points(points)
        return cls(plane, points, recipe, ellipse, Spacing.of(ellipse.angles(points)))

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            "plane": self.plane,
            "points": self.spacing.points,
            "mean_and_scatter": self.recipe.as_dict(),  # ellipse from mean and scatter
            # ellipse by least squares, which is independent of the spacing
            "least_squares": self.ellipse.as_dict(),
            "spacing": self.spacing.as_dict(),
        }


def equator(ellipsoid: Ellipsoid, plane: Plane, *, dip_deg: float) -> Ellipsoid:
    """Ellipsoid whose equator is the ellipse of a turn; the third semi-axis is the mean of the other two.

    Parameters
    ----------
    ellipsoid : Ellipsoid
        Ellipsoid of raw readings in all directions.
    plane : str
        ``xy``, ``yz`` or ``zx``; the third axis is the axis of the turn.
    dip_deg : float, degrees
        Inclination of the field towards the axis of the turn.
    """
    parameters = equator_matrix(plane, dip_deg=dip_deg) @ ellipsoid.parameters
    return Ellipsoid.of_parameters(parameters)


def equator_matrix(plane: Plane, *, dip_deg: float) -> Floats:
    """(9, 9) matrix from the parameters of an ellipsoid to those of the result of `equator`; the rank is five."""
    first, second, third = axis_order(plane)
    dip = np.deg2rad(dip_deg)
    rows = np.zeros((9, 9))
    for place in (first, second):
        rows[place, place] = 1.0
        rows[place, _ENTRY_INDEX[place, third]] = np.sin(dip)
        rows[_ENTRY_INDEX[place, place], _ENTRY_INDEX[place, place]] = np.cos(dip)
        rows[_ENTRY_INDEX[third, third], _ENTRY_INDEX[place, place]] = np.cos(dip) / 2.0
    rows[_ENTRY_INDEX[first, second], _ENTRY_INDEX[first, second]] = np.cos(dip)
    return rows


_ENTRY_INDEX = np.array([[3, 6, 7], [6, 4, 8], [7, 8, 5]])
"""Index of each entry of the shape among the nine parameters."""


def symmetric_root(square: Floats) -> Floats:
    """(2, 2) symmetric root of a symmetric matrix M in closed form, (M + √det M) / √(tr M + 2 √det M).

    >>> symmetric_root(np.array([[5.0, 4.0], [4.0, 5.0]])).round(9).tolist()
    [[2.0, 1.0], [1.0, 2.0]]
    """
    half = np.sqrt(max(float(np.linalg.det(square)), 0.0))
    trace = float(np.trace(square)) + 2.0 * half
    square_root: Floats = (square + half * np.eye(2)) / np.sqrt(trace) if trace > 0.0 else np.zeros((2, 2))
    return square_root
