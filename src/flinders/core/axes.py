"""Which way the sensor sits: a signed permutation from the axes as recorded to the axes used.

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

from flinders.arrays import Floats, vectors
from flinders.errors import AxesError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

NAMES: Final = "xyz"


@dataclass(frozen=True, slots=True)
class Axes:
    """Where each new axis comes from."""

    order: tuple[int, int, int] = (0, 1, 2)  #: (3,): index of the recorded axis that becomes x, y and z
    signs: tuple[int, int, int] = (1, 1, 1)  #: (3,): +1, or −1 where it points the other way

    @classmethod
    def of(cls, text: str) -> Axes:
        """Read ``"x,-y,z"``: for each new axis, the recorded one it is taken from.

        Raises `AxesError` unless each of x, y and z is named once.
        """
        if not isinstance(text, str):
            raise AxesError(
                f"axes are {text!r}, which is no text: name where each new axis comes from", hint={"axes": "x,-y,z"}
            )
        return _parsed(text)

    @property
    def is_identity(self) -> bool:
        """Nothing is moved and nothing changes sign."""
        return self == Axes()

    @property
    def is_mirror(self) -> bool:
        """A right-handed frame becomes left-handed: usually a mistake in the mapping, or a left-handed sensor."""
        first, second, third = self.order
        parity = (second - first) * (third - first) * (third - second)  # 2 or −2
        return parity * math.prod(self.signs) < 0

    @property
    def mirrored_axis(self) -> str:
        """The recorded axis whose sign makes it a mirror image, by its name; empty where it is none.

        Any of the three would do: it is the one that, turned over, leaves the smallest rotation.

        >>> Axes.of("x,-y,z").mirrored_axis, Axes.of("-y,-x,z").mirrored_axis, Axes.of("y,-x,z").mirrored_axis
        ('y', 'x', '')
        """
        return max(NAMES, key=lambda axis: self.turned_over(axis).trace) if self.is_mirror else ""

    @property
    def matrix(self) -> Floats:
        """(3, 3) from the recorded axes to the new ones: in each row and column one 1 or −1, else 0."""
        return self.apply(np.eye(3)).T + 0.0

    @property
    def opposite(self) -> Axes:
        """The mapping with all its signs changed: a mirror image of a rotation, and the reverse."""
        x, y, z = (-sign for sign in self.signs)
        return Axes(self.order, (x, y, z))

    @property
    def trace(self) -> int:
        """Of the mapping as a matrix: 1 + 2 cos of its angle where it is a rotation."""
        return sum(self.signs[place] for place, index in enumerate(self.order) if index == place)

    def turned_over(self, axis: str) -> Axes:
        """The same mapping of readings of which one axis had its sign changed before.

        >>> str(Axes.of("y,x,-z").turned_over("x"))
        'y,-x,-z'
        """
        over = NAMES.index(axis)
        x, y, z = (-sign if index == over else sign for index, sign in zip(self.order, self.signs, strict=True))
        return Axes(self.order, (x, y, z))

    def apply(self, vector: ArrayLike) -> Floats:
        """Map (..., 3) vectors from the recorded axes; values that are not finite pass through."""
        recorded = vectors(vector, finite=False)
        return recorded if self.is_identity else recorded[..., list(self.order)] * np.array(self.signs, float)

    def __str__(self) -> str:
        return ",".join(
            ("-" if sign < 0 else "") + NAMES[index] for index, sign in zip(self.order, self.signs, strict=True)
        )


@lru_cache
def _parsed(text: str) -> Axes:
    """Axes of a text, see `Axes.of`."""
    parts = [part.strip().casefold() for part in text.split(",")]
    matches = [re.fullmatch(r"([+-]?)([xyz])", part) for part in parts]
    letters = [match[2] for match in matches if match]
    if len(parts) != 3 or sorted(letters) != list(NAMES):
        raise AxesError(f"axes {text!r}: need x, y and z once each with signs, such as 'x,-y,-z' or '-y,x,z'")
    x, y, z = (NAMES.index(letter) for letter in letters)
    a, b, c = (-1 if match and match[1] == "-" else 1 for match in matches)
    return Axes((x, y, z), (a, b, c))


EXCHANGES: Final = tuple(
    Axes(order, signs)  # type: ignore[arg-type]  # three of each
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
)
"""The 48 ways to exchange axes and their signs, mirror images among them; the identity first."""

TURNS: Final = tuple(axes for axes in EXCHANGES if not axes.is_mirror)
"""The 24 ways to exchange axes and stay right-handed, the one that changes nothing first."""


def of_the_hand_of(rotation: Floats) -> tuple[Axes, ...]:
    """The 24 ways of the hand of (3, 3) `rotation`: those that stay right-handed, or the mirror images."""
    is_mirror = float(np.linalg.det(rotation)) < 0.0
    return tuple(axes for axes in EXCHANGES if axes.is_mirror == is_mirror)


def nearest_to(rotation: Floats) -> Axes:
    """The way to exchange axes, of the same hand, that is nearest to (3, 3) `rotation`.

    >>> str(nearest_to(np.array([[0.1, -0.995, 0.0], [0.995, 0.1, 0.0], [0.0, 0.0, 1.0]])))
    '-y,x,z'
    """
    return max(of_the_hand_of(rotation), key=lambda axes: float(np.sum(axes.matrix * rotation)))
