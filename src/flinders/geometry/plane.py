"""Readings of one plane: the ellipse that they lie on, and how evenly they are spread around it.

A sensor that is turned about one of its axes reads an ellipse with the other two. Of points equally spaced in heading
the mean is the centre of that ellipse, and twice their centred scatter is the square of its shape:

>>> heading = np.radians(np.arange(0, 360, 10))
>>> points = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5], axis=1)
>>> found = PlaneEllipse.of_points(points)
>>> found.centre.round(9), found.semi_axes.round(9), round(found.direction_deg, 9)
(array([10., -5.]), array([30., 20.]), 0.0)

Of points that are not, it is another: as far off as the harmonics of their angles say.

>>> Spacing.of(found.angles(points)).is_even(within_deg=1.0)
True
>>> print(Spacing.of(found.angles(points[:27])))
27 points around 360°, widest gap 100°; first harmonic 0.300, second 0.213: the mean costs up to 23° of heading

A turn reads an ellipse, whatever else is known of the sensor's ellipsoid. With the field
u = (cos I cos ψ, −cos I sin ψ, sin I), in the order of the plane, it is

    (b + sin I S₃) + cos I S₂ (cos ψ, −sin ψ)

for S₃ the column of the shape that belongs to the axis turned about and S₂ the part of it in the plane. It is linear in
offset and shape, so a covariance comes along. Two calibrations of which one knows a plane alone are held against each
other there, and a method that fits a plane is asked about it.

>>> turned = Ellipsoid(np.array([10.0, 20.0, 30.0]), np.diag([50.0, 40.0, 60.0]))
>>> flat = equator(turned, "xy", dip_deg=60.0)
>>> flat.centre.round(9), np.diag(flat.shape).round(9)
(array([10., 20.,  0.]), array([25. , 20. , 22.5]))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self, TypeAlias, get_args

import numpy as np

from flinders.errors import UsageError, counted, figures
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats

Plane: TypeAlias = Literal["xy", "yz", "zx"]
"""The two axes that see the field go round; the third one, which completes a right-handed frame, is turned about."""

PLANES: Final[tuple[Plane, ...]] = get_args(Plane)

IN_PLANE: Final = [0, 1, 3, 4, 6]
"""Places of b₁, b₂, S₁₁, S₂₂, S₁₂ among the nine parameters: all that the readings of the plane ``xy`` tell."""


def order_of(plane: Plane) -> tuple[int, int, int]:
    """Places of the first, the second and the third axis of a plane.

    Raises `UsageError` for what is no plane.

    Examples
    --------
    >>> order_of("xy"), order_of("zx")
    ((0, 1, 2), (2, 0, 1))
    """
    if plane not in PLANES:
        raise UsageError(f"plane is {plane!r}: need one of {', '.join(PLANES)}")
    first = "xyz".index(plane[0])
    return first, (first + 1) % 3, (first + 2) % 3


def across(plane: Plane) -> str:
    """Name the axis that is turned about.

    >>> across("zx")
    'y'
    """
    return "xyz"[order_of(plane)[2]]


def down_of(plane: Plane | None) -> Floats | None:
    """(3,) which way is down when a sensor turns in a plane; None for +z.

    >>> down_of("yz"), down_of("xy")
    (array([1., 0., 0.]), None)
    """
    return None if plane in (None, "xy") else np.eye(3)[order_of(plane)[2]]


def heading_errors(readings: Floats, heading: Floats) -> tuple[Floats, float]:
    """(N,) errors of what (3, N) readings of a level vehicle show at (N,) headings, the mean removed; and that mean.

    All in rad. An offset of a tenth of the level field is off by its share where the field lies across it:

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
    """The points centre + shape · u for all unit vectors u of a plane."""

    centre: Floats  #: (2,): in the unit of the readings, along the first and the second axis of the plane
    shape: Floats  #: (2, 2): symmetric and positive definite, in the unit of the readings

    @classmethod
    def of_points(cls, points: Floats) -> Self:
        """The recipe: the mean, and the root of twice the centred scatter, of (N, 2) points."""
        return cls.of_blocks([points])

    @classmethod
    def of_blocks(cls, blocks: Iterable[Floats]) -> Self:
        """The recipe, of points that come in blocks."""
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
        return cls(mean, root(2.0 * scatter / max(count, 1)))

    @property
    def radius(self) -> float:
        """Geometric mean of the semi-axes: a circle of this radius has the same area."""
        return float(np.sqrt(np.prod(self.semi_axes)))

    @property
    def semi_axes(self) -> Floats:
        """(2,) semi-axes, the long one first."""
        return np.linalg.eigvalsh(self.shape)[::-1].clip(min=0.0)

    @property
    def eigenvalues(self) -> Floats:
        """(2,) of the centred scatter that equally spaced points on it have: half the squares of the semi-axes."""
        return self.semi_axes**2 / 2.0

    @property
    def ratio(self) -> float:
        """The long semi-axis over the short one."""
        long, short = self.semi_axes.tolist()
        return float(long / short)

    @property
    def direction_deg(self) -> float:
        """Skew angle: where the long axis points, from the first axis towards the second, −90° to 90°.

        Of a circle it means nothing.
        """
        x, y = np.linalg.eigh(self.shape)[1][:, 1]
        angle = float(np.degrees(np.arctan2(y, x)))
        folded = (angle + 90.0) % 180.0 - 90.0
        return 90.0 if folded < -90.0 + 1e-9 else folded

    @property
    def matrix(self) -> Floats:
        """(2, 2) S₁₁, S₁₂; S₂₁, S₂₂: what makes it a circle of the same area; symmetric, determinant 1."""
        return self.radius * np.linalg.inv(self.shape)

    def correct(self, points: Floats) -> Floats:
        """(N, 2) points after ``matrix @ (point - centre)``."""
        corrected: Floats = (points - self.centre) @ self.matrix
        return corrected

    def angles(self, points: Floats) -> Floats:
        """(N,) rad, of corrected points from the first axis towards the second."""
        x, y = self.correct(points).T
        angles: Floats = np.arctan2(y, x)
        return angles

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "centre": self.centre.tolist(),
            "eigenvalues": self.eigenvalues.tolist(),
            "semi_axes": self.semi_axes.tolist(),
            "axis_ratio": self.ratio,  # long over short semi-axis
            "skew_angle_deg": self.direction_deg,  # where the long axis points, from the first axis towards the second
            "matrix": self.matrix.tolist(),
        }


@dataclass(frozen=True, slots=True)
class Spacing:
    """How evenly points are spread around a circle.

    With angles φ the harmonics are r₁ = |mean exp(iφ)| and r₂ = |mean exp(2iφ)|. Equally spaced points have none. The
    mean of the points is r₁ radii off the centre, and their scatter makes the circle an ellipse of ratio 1 + r₂; of
    the heading that takes up to r₁ + r₂/2 radians, to first order.
    """

    points: int
    first_harmonic: float  #: r₁, 0 to 1
    second_harmonic: float  #: r₂, 0 to 1
    widest_gap_deg: float  #: between neighbours

    @classmethod
    def of(cls, angles: Floats) -> Self:
        """Look at (N,) angles in rad, of one turn or of several.

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
        """Heading error that the mean and the scatter of such points make at the worst heading, to first order."""
        return float(np.degrees(self.first_harmonic + self.second_harmonic / 2.0))

    def is_even(self, *, within_deg: float) -> bool:
        """The mean can be trusted: it costs no more than this."""
        return self.cost_deg <= within_deg

    def as_dict(self) -> dict[str, float]:
        """JSON-ready."""
        return {
            "first_harmonic": self.first_harmonic,
            "second_harmonic": self.second_harmonic,
            "widest_gap_deg": self.widest_gap_deg,
            "cost_deg": self.cost_deg,
        }

    def __str__(self) -> str:
        cost = f"{figures(self.cost_deg)}°" if self.cost_deg >= 0.005 else "0.00°"
        return (
            f"{counted(self.points, 'point')} around 360°, widest gap {self.widest_gap_deg:.0f}°; "
            f"first harmonic {self.first_harmonic:.3f}, second {self.second_harmonic:.3f}: "
            f"the mean costs up to {cost} of heading"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A turn in one plane: its points, what the recipe makes of them, and the ellipse of least squares."""

    plane: Plane  #: the plane that was turned: ``xy``, ``yz`` or ``zx``
    points: Floats  #: (N, 2): readings along the first and the second axis of the plane
    recipe: PlaneEllipse  #: from mean and scatter
    ellipse: PlaneEllipse  #: by least squares; it does not care how the points are spaced
    #: of the points once `ellipse` has corrected them: after the recipe itself no harmonics are left to see
    spacing: Spacing

    @classmethod
    def of(cls, plane: Plane, points: Floats, ellipse: PlaneEllipse) -> Self:
        """Compare (N, 2) points with the least-squares ellipse through them."""
        recipe = PlaneEllipse.of_points(points)
        return cls(plane, points, recipe, ellipse, Spacing.of(ellipse.angles(points)))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "plane": self.plane,
            "points": self.spacing.points,
            "mean_and_scatter": self.recipe.as_dict(),  # the ellipse of the recipe
            # the ellipse by least squares, which does not depend on the spacing
            "least_squares": self.ellipse.as_dict(),
            "spacing": self.spacing.as_dict(),
        }


def equator(ellipsoid: Ellipsoid, plane: Plane, *, dip_deg: float) -> Ellipsoid:
    """Take the ellipse of a turn as the equator of an ellipsoid, whose third semi-axis is the mean of the two.

    Parameters
    ----------
    plane : str
        ``xy``, ``yz`` or ``zx``; the third axis is the one that is turned about.
    dip_deg : float
        Inclination of the field towards that axis.
    """
    parameters = to_equator(plane, dip_deg=dip_deg) @ ellipsoid.parameters
    return Ellipsoid.of_parameters(parameters)


def to_equator(plane: Plane, *, dip_deg: float) -> Floats:
    """(9, 9) matrix from (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃) to those of the equator; its rank is five."""
    first, second, third = order_of(plane)
    dip = np.deg2rad(dip_deg)
    rows = np.zeros((9, 9))
    for place in (first, second):
        rows[place, place] = 1.0
        rows[place, _ENTRY[place, third]] = np.sin(dip)
        rows[_ENTRY[place, place], _ENTRY[place, place]] = np.cos(dip)
        rows[_ENTRY[third, third], _ENTRY[place, place]] = np.cos(dip) / 2.0
    rows[_ENTRY[first, second], _ENTRY[first, second]] = np.cos(dip)
    return rows


_ENTRY = np.array([[3, 6, 7], [6, 4, 8], [7, 8, 5]])
"""Where each entry of the shape stands among the nine."""


def root(square: Floats) -> Floats:
    """(2, 2) symmetric root of a symmetric matrix, in closed form: (M + √det M) / √(tr M + 2 √det M).

    >>> root(np.array([[5.0, 4.0], [4.0, 5.0]])).round(9).tolist()
    [[2.0, 1.0], [1.0, 2.0]]
    """
    half = np.sqrt(max(float(np.linalg.det(square)), 0.0))
    trace = float(np.trace(square)) + 2.0 * half
    square_root: Floats = (square + half * np.eye(2)) / np.sqrt(trace) if trace > 0.0 else np.zeros((2, 2))
    return square_root
