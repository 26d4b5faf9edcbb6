"""Mapping of the recorded axes to the axes used: a signed permutation.

>>> turned = Axes.of("x,-y,-z")
>>> turned.apply([[1.0, 2.0, 3.0]])
array([[ 1., -2., -3.]])
>>> str(Axes.of("-y, X, +z"))
'-y,x,z'
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import Floats, check_vectors
from flinders.errors import AxesError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

AXIS_NAMES: Final = "xyz"


@dataclass(frozen=True, slots=True)
class Axes:
    """A signed permutation of axes: for each new axis, the recorded axis and its sign."""

    order: tuple[int, int, int] = (0, 1, 2)  #: (3,): index of the recorded axis that becomes x, y and z
    signs: tuple[int, int, int] = (1, 1, 1)  #: (3,): +1, or −1 if the new axis points the other way

    @classmethod
    def of(cls, text: str) -> Axes:
        """Parse ``"x,-y,z"``: for each new axis, the recorded axis and its sign.

        Raises `AxesError` unless each of x, y and z is named once.
        """
        if not isinstance(text, str):
            raise AxesError(
                f"axes are {text!r}, which is not text: give a text such as 'x,-y,-z'",
                hint={"axes": "x,-y,z"},
            )
        return _parse_axes(text)

    @property
    def is_identity(self) -> bool:
        """Whether each axis stays as it was recorded."""
        return self == Axes()

    @property
    def is_mirror(self) -> bool:
        """Whether a right-handed frame becomes left-handed: a mistake in the mapping, or a left-handed sensor."""
        first, second, third = self.order
        parity = (second - first) * (third - first) * (third - second)  # 2 or −2
        return parity * math.prod(self.signs) < 0

    @property
    def mirrored_axis(self) -> str:
        """Name of the recorded axis to reverse so that a mirror image becomes a rotation; empty for a rotation.

        Reversing any of the three axes gives a rotation; reversing this axis gives the rotation by the smallest angle.

        >>> Axes.of("x,-y,z").mirrored_axis, Axes.of("-y,-x,z").mirrored_axis, Axes.of("y,-x,z").mirrored_axis
        ('y', 'x', '')
        """
        return max(AXIS_NAMES, key=lambda axis: self.reverse_axis(axis).trace) if self.is_mirror else ""

    @property
    def matrix(self) -> Floats:
        """(3, 3) from the recorded axes to the new axes: one 1 or −1 in each row and column, else 0."""
        return self.apply(np.eye(3)).T + 0.0

    @property
    def opposite(self) -> Axes:
        """The mapping with all three signs changed, so that a rotation becomes a mirror image, and vice versa."""
        x, y, z = (-sign for sign in self.signs)
        return Axes(self.order, (x, y, z))

    @property
    def trace(self) -> int:
        """Trace of `matrix`; of a rotation by an angle α it is 1 + 2 cos α."""
        return sum(self.signs[place] for place, index in enumerate(self.order) if index == place)

    def reverse_axis(self, axis: str) -> Axes:
        """The mapping that first changes the sign of the recorded `axis` and then maps as this one.

        >>> str(Axes.of("y,x,-z").reverse_axis("x"))
        'y,-x,-z'
        """
        over = AXIS_NAMES.index(axis)
        x, y, z = (-sign if index == over else sign for index, sign in zip(self.order, self.signs, strict=True))
        return Axes(self.order, (x, y, z))

    def apply(self, vector: ArrayLike) -> Floats:
        """Map (..., 3) vectors from the recorded axes to the new axes; NaN and infinity pass through."""
        recorded = check_vectors(vector, finite=False)
        return recorded if self.is_identity else recorded[..., list(self.order)] * np.array(self.signs, float)

    def __str__(self) -> str:
        return ",".join(
            ("-" if sign < 0 else "") + AXIS_NAMES[index] for index, sign in zip(self.order, self.signs, strict=True)
        )


@lru_cache
def _parse_axes(text: str) -> Axes:
    """Parse the text of `Axes.of`, with a cache."""
    parts = [part.strip().casefold() for part in text.split(",")]
    matches = [re.fullmatch(r"([+-]?)([xyz])", part) for part in parts]
    letters = [match[2] for match in matches if match]
    if len(parts) != 3 or sorted(letters) != list(AXIS_NAMES):
        raise AxesError(f"axes {text!r}: need x, y and z once each with signs, such as 'x,-y,-z' or '-y,x,z'")
    x, y, z = (AXIS_NAMES.index(letter) for letter in letters)
    a, b, c = (-1 if match and match[1] == "-" else 1 for match in matches)
    return Axes((x, y, z), (a, b, c))


SIGNED_PERMUTATIONS: Final = tuple(
    Axes(order, signs)  # type: ignore[arg-type]  # three of each
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
)
"""The 48 signed permutations of axes, including mirror images; the identity first."""

AXIS_ROTATIONS: Final = tuple(axes for axes in SIGNED_PERMUTATIONS if not axes.is_mirror)
"""The 24 signed permutations that are rotations; the identity first."""


def same_handed_axes(rotation: Floats) -> tuple[Axes, ...]:
    """The 24 signed permutations whose determinant has the sign of that of (3, 3) `rotation`."""
    is_mirror = float(np.linalg.det(rotation)) < 0.0
    return tuple(axes for axes in SIGNED_PERMUTATIONS if axes.is_mirror == is_mirror)


def nearest_axes(rotation: Floats) -> Axes:
    """The signed permutation of the same handedness that is nearest to (3, 3) `rotation`.

    >>> str(nearest_axes(np.array([[0.1, -0.995, 0.0], [0.995, 0.1, 0.0], [0.0, 0.0, 1.0]])))
    '-y,x,z'
    """
    return max(same_handed_axes(rotation), key=lambda axes: float(np.sum(axes.matrix * rotation)))
