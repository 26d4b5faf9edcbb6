"""Parameters of a fit with aiding sensors: offset and shape, and the parameters of the terms.

A reading, in raw units, is

    x = b + S Rᵀ q + n,   |q| = 1

with the field's direction q in body axes, the symmetric shape S, and the rotation R from the magnetometer's axes to
those of the body. A gyro adds its bias, scales, mounting and delay; an accelerometer its bias, its gains and the sine
of the dip; a logged attitude the direction of the site's field.

>>> layout = ParameterLayout.of(rotation=True, gyro_bias=True)
>>> layout.size, layout.columns["gyro_bias"]
(15, slice(12, 15, None))
>>> there = Parameters.at(np.zeros(3), 50.0 * np.eye(3))
>>> there.take_step(np.arange(15.0) * 1e-3, layout).offset
array([0.   , 0.001, 0.002])
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.geometry.rotation import rotations, step_on_sphere
from flinders.likelihood import attitude, dip, gyro
from flinders.likelihood.gyro import scale_matrix
from flinders.likelihood.term import Block

if TYPE_CHECKING:
    from flinders.arrays import Floats

ROTATION_SIGMA: Final = 0.35
"""Prior standard deviation in rad of the rotation between sensors on one body, about the rotation at the start."""

MIN_AXIS_RATIO: Final = 1e-3
"""Smallest ratio of the shortest to the longest semi-axis; no sensor has a flatter ellipsoid."""

TERMS: Final = {term.name: term for term in (gyro.TERM, dip.TERM, dip.TILT, attitude.TERM)}
"""Terms of aiding sensors, by name."""

BLOCKS: Final = (
    Block("offset", 3), Block("shape", 6), Block("rotation", 3, ROTATION_SIGMA),
    *(block for term in TERMS.values() for block in term.blocks),
)  # fmt: skip
"""Blocks of parameters, in the order of the Jacobian's columns."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterLayout:
    """Columns of the Jacobian for the free parameters."""

    columns: dict[str, slice]  # columns of the free blocks by name; offset and shape are always the first nine
    size: int  # number of free parameters

    @classmethod
    def of(cls, **free: bool) -> Self:
        """Assign columns to offset, shape and all other blocks that are free."""
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
    """Offset and shape during a fit."""

    offset: Floats  # (3,), in the unit of the readings
    shape: Floats  # (3, 3), in the unit of the readings: symmetric and positive definite

    @property
    def ellipsoid(self) -> Ellipsoid:
        """Ellipsoid in the magnetometer's own axes."""
        return Ellipsoid(self.offset, self.shape)

    @property
    def radius(self) -> float:
        """Radius of a sphere of the same volume."""
        return float(np.cbrt(np.linalg.det(self.shape)))

    @property
    def is_closed(self) -> bool:
        """Whether the surface is an ellipsoid that is not nearly flat."""
        axes = np.linalg.eigvalsh(self.shape)
        return bool(axes[0] > MIN_AXIS_RATIO * axes[2])

    def relative_step(self, step: Floats, _: ParameterLayout) -> float:
        """Largest change of offset and shape by a (P,) step, relative to the radius."""
        return float(np.abs(step[:9]).max()) / self.radius


@dataclass(frozen=True, slots=True, eq=False)
class Parameters(Surface):
    """Values of all parameters, free or fixed."""

    # (3, 3): from the magnetometer's axes to the body's, which are those of gyro, accelerometer and attitude
    rotation: Floats
    gyro_bias: Floats  # (3,), rad/s: bias d of the gyro
    delay: float  # s: delay of the magnetometer behind the gyro
    sine: float  # sine of the dip, positive if the field points below the horizon
    direction: Floats  # (3,): unit vector of the site's field, in the world axes of a logged attitude
    # (6,): upper triangle of Γ, in the order of `flinders.geometry.ellipsoid.symmetric_matrix`: the rate of the body is
    # (1 + Γ)(ω − d)
    gyro_scale: Floats = dataclasses.field(default_factory=lambda: np.zeros(6))
    # (3,), rad: ψ, rotation of the gyro's axes relative to the body: the rate of the body is (1 + Γ + [ψ]×)(ω − d)
    gyro_turn: Floats = dataclasses.field(default_factory=lambda: np.zeros(3))
    # (9,): the accelerometer's bias β relative to gravity, and the upper triangle of its Γ, see
    # `flinders.likelihood.dip.AccelerometerPrior`
    accelerometer: Floats = dataclasses.field(default_factory=lambda: np.zeros(9))

    @classmethod
    def at(cls, offset: Floats, shape: Floats) -> Self:
        """Parameters with a given offset and shape, and defaults for all others."""
        return cls(offset, shape, np.eye(3), np.zeros(3), 0.0, 0.0, np.array([0.0, 0.0, 1.0]))

    def take_step(self, step: Floats, layout: ParameterLayout) -> Self:
        """Parameters after a (P,) step; the step of a rotation is applied on the left."""
        parts = {name: step[columns] for name, columns in layout.columns.items()}
        changed: dict[str, Floats | float] = {
            "offset": self.offset + parts["offset"],
            "shape": self.shape + symmetric_matrix(parts["shape"]),
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
            changed["direction"] = step_on_sphere(self.direction, parts["direction"])
        return replace(self, **changed)  # type: ignore[arg-type]

    def body_rate(self, rate: Floats) -> Floats:
        """(..., 3) angular rate of the body from (..., 3) readings of its gyro, in rad/s."""
        turning: Floats = (rate - self.gyro_bias) @ scale_matrix(self.gyro).T
        return turning

    @property
    def gyro(self) -> Floats:
        """(9,) parameters of the gyro's matrix: Γ, then ψ."""
        return np.concatenate([self.gyro_scale, self.gyro_turn])

    @property
    def rotated_shape(self) -> Floats:
        """(3, 3) product S Rᵀ, from the field's direction in body axes to readings minus the offset."""
        product: Floats = self.shape @ self.rotation.T
        return product
