"""What a fit with aids finds: offset and shape always, and whatever else a term can see.

A reading, in raw units, is

    x = b + S Rᵀ q + n,   |q| = 1

with the field's direction q in body axes, the symmetric shape S, and the rotation R from the magnetometer's axes to
those of the body. The gyro brings its bias, its scales, its mounting and its delay, the accelerometer its bias, its
gains and the sine of the dip, a logged attitude the direction of the site's field.

>>> layout = ParameterLayout.of(rotation=True, gyro_bias=True)
>>> layout.size, layout.columns["gyro_bias"]
(15, slice(12, 15, None))
>>> there = Parameters.at(np.zeros(3), 50.0 * np.eye(3))
>>> there.moved(np.arange(15.0) * 1e-3, layout).offset
array([0.   , 0.001, 0.002])
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.geometry.rotation import on_the_sphere, rotations
from flinders.likelihood import attitude, dip, gyro
from flinders.likelihood.gyro import grown
from flinders.likelihood.term import Block

if TYPE_CHECKING:
    from flinders.arrays import Floats

ROTATION_SIGMA: Final = 0.35
"""rad: how far the axes of instruments on one body are thought to be apart, beyond what was looked for."""

SHORTEST_AXIS: Final = 1e-3
"""Of the longest: no sensor makes a flatter surface."""

TERMS: Final = {term.name: term for term in (gyro.TERM, dip.TERM, dip.TILT, attitude.TERM)}
"""What may be recorded beside the readings, by name."""

BLOCKS: Final = (
    Block("offset", 3), Block("shape", 6), Block("rotation", 3, ROTATION_SIGMA),
    *(block for term in TERMS.values() for block in term.blocks),
)  # fmt: skip
"""Columns of a Jacobian, in their order."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterLayout:
    """Which column of a Jacobian belongs to what."""

    columns: dict[str, slice]  # of the blocks that are free; offset and shape are always the first nine
    size: int

    @classmethod
    def of(cls, **free: bool) -> Self:
        """Lay out the blocks that are to be found."""
        columns: dict[str, slice] = {}
        begin = 0
        for name, size, _ in BLOCKS:
            if name in ("offset", "shape") or free.get(name, False):
                columns[name] = slice(begin, begin + size)
                begin += size
        return cls(columns, begin)

    def __contains__(self, name: object) -> bool:
        return name in self.columns


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Offset and shape on the way to an ellipsoid."""

    offset: Floats  # (3,), unit of the readings
    shape: Floats  # (3, 3), unit of the readings: symmetric and positive definite

    @property
    def ellipsoid(self) -> Ellipsoid:
        """In the magnetometer's own axes."""
        return Ellipsoid(self.offset, self.shape)

    @property
    def radius(self) -> float:
        """Of a ball as large as the ellipsoid."""
        return float(np.cbrt(np.linalg.det(self.shape)))

    @property
    def is_closed(self) -> bool:
        """Whether the surface is an ellipsoid, and not nearly flat."""
        axes = np.linalg.eigvalsh(self.shape)
        return bool(axes[0] > SHORTEST_AXIS * axes[2])

    def relative(self, step: Floats, _: ParameterLayout) -> float:
        """Largest change of offset and shape in a (P,) step, in radii."""
        return float(np.abs(step[:9]).max()) / self.radius


@dataclass(frozen=True, slots=True, eq=False)
class Parameters(Surface):
    """One set of values."""

    # (3, 3): turns vectors in the magnetometer's axes into the body's, which are those of gyro, accelerometer and
    # attitude
    rotation: Floats
    gyro_bias: Floats  # (3,), rad/s
    delay: float  # s: by how much the magnetometer is behind the gyro
    sine: float  # of the field's dip, positive where it points below the horizon
    direction: Floats  # (3,): unit vector: the site's field in the axes that a logged attitude turns into
    # (6,): upper triangle of Γ, in the order of `flinders.geometry.ellipsoid.symmetric`: the body turns by (1 + Γ)(ω −
    # d)
    gyro_scale: Floats = dataclasses.field(default_factory=lambda: np.zeros(6))
    # (3,), rad: ψ: how the gyro's axes are turned against those of the body: it turns by (1 + Γ + [ψ]×)(ω − d)
    gyro_turn: Floats = dataclasses.field(default_factory=lambda: np.zeros(3))
    # (9,): its bias β, of gravity, and the upper triangle of Γ, see `flinders.likelihood.dip.AccelerometerPrior`
    accelerometer: Floats = dataclasses.field(default_factory=lambda: np.zeros(9))

    @classmethod
    def at(cls, offset: Floats, shape: Floats) -> Self:
        """Begin somewhere, with nothing else known."""
        return cls(offset, shape, np.eye(3), np.zeros(3), 0.0, 0.0, np.array([0.0, 0.0, 1.0]))

    def moved(self, step: Floats, layout: ParameterLayout) -> Self:
        """Take a step; a rotation is turned by its part of it, on the left."""
        parts = {name: step[columns] for name, columns in layout.columns.items()}
        changed: dict[str, Floats | float] = {
            "offset": self.offset + parts["offset"],
            "shape": self.shape + symmetric(parts["shape"]),
        }
        for name in ("delay", "sine"):
            if name in parts:
                changed[name] = getattr(self, name) + float(parts[name][0])
        for name in ("gyro_bias", "gyro_scale", "gyro_turn", "accelerometer"):
            if name in parts:
                changed[name] = getattr(self, name) + parts[name]
        if "rotation" in parts:
            changed["rotation"] = rotations(parts["rotation"][np.newaxis])[0] @ self.rotation
        if "direction" in parts:
            changed["direction"] = on_the_sphere(self.direction, parts["direction"])
        return replace(self, **changed)  # type: ignore[arg-type]

    def turning(self, rate: Floats) -> Floats:
        """(..., 3) rad/s that the body turns by, of (..., 3) that its gyro says."""
        turning: Floats = (rate - self.gyro_bias) @ grown(self.gyro).T
        return turning

    @property
    def gyro(self) -> Floats:
        """(9,) Γ and ψ."""
        return np.concatenate([self.gyro_scale, self.gyro_turn])

    @property
    def ellipsoid_like(self) -> Floats:
        """(3, 3) S Rᵀ: takes the field's direction in body axes to readings about the offset."""
        product: Floats = self.shape @ self.rotation.T
        return product
