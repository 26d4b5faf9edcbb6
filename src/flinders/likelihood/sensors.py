"""Several magnetometers on one body: one direction of the field at each moment, seen by all.

Residuals of all sensors i at all moments k, each sensor in its own noise σᵢ, are

    (xᵢₖ − bᵢ − Sᵢ Rᵢᵀ qₖ) / σᵢ,    |qₖ| = 1

with R = 1 for the reference. Each direction qₖ is eliminated (`flinders.likelihood.observations`): of 3m readings 3m −
2 are left, m of them lengths, and 2(m − 1) that hold the directions of the sensors against each other. The groups of
`SensorGroup` are observations as any other: a term that shares the direction adds rows to those of a moment.

>>> field = np.array([[50.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
>>> group = SensorGroup.of(np.stack([field, 0.8 * field + 1.0]))
>>> both = Sensors((Parameters.at(np.zeros(3), 50.0 * np.eye(3)), Parameters.at(np.ones(3), 40.0 * np.eye(3))))
>>> directions = group.guess(both, np.ones(2))
>>> round(group.cost(both, directions, np.ones(2)), 9), SensorLayout.of(2, reference=0).size
(0.0, 21)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self, TypeAlias

import numpy as np

from flinders.geometry.rotation import lengths
from flinders.likelihood.equations import FINEST, NormalEquations
from flinders.likelihood.observations import (
    ROOM,
    Linearised,
    ObservationGroup,
    ObservationRows,
    Weights,
    eliminated,
    residuals_of,
    rows_of,
)
from flinders.likelihood.parameters import ParameterLayout, Parameters
from flinders.likelihood.prior import SensorPrior
from flinders.likelihood.solver import NO_WORSE, SETTLED, Iterate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.solver import Equations


@dataclass(frozen=True, slots=True, eq=False)
class SensorLayout:
    """Which columns of a Jacobian belong to which sensor."""

    each: tuple[ParameterLayout, ...]
    columns: tuple[slice, ...]

    @classmethod
    def of(cls, sensors: int, *, reference: int) -> Self:
        """Offset and shape of each sensor, and the rotation of all but the reference."""
        each = tuple(ParameterLayout.of(rotation=sensor != reference) for sensor in range(sensors))
        ends = np.cumsum([layout.size for layout in each]).tolist()
        return cls(each, tuple(slice(end - layout.size, end) for end, layout in zip(ends, each, strict=True)))

    @property
    def size(self) -> int:
        """Of all parameters."""
        return int(self.columns[-1].stop)


@dataclass(frozen=True, slots=True, eq=False)
class Sensors:
    """Parameters of all sensors."""

    each: tuple[Parameters, ...]

    @property
    def radii(self) -> Floats:
        """(m,) of balls as large as the ellipsoids."""
        return np.array([at.radius for at in self.each])

    @property
    def is_closed(self) -> bool:
        """Whether all surfaces are ellipsoids."""
        return all(at.is_closed for at in self.each)

    def moved(self, step: Floats, layout: SensorLayout) -> Self:
        """Take a (P,) step."""
        parts = zip(self.each, layout.columns, layout.each, strict=True)
        return type(self)(tuple(at.moved(step[columns], own) for at, columns, own in parts))

    def relative(self, step: Floats, layout: SensorLayout) -> float:
        """Largest change in a step: of offset and shape in radii of their sensor, of a rotation in rad."""
        parts = list(zip(self.each, layout.columns, layout.each, strict=True))
        moved = [at.relative(step[columns], own) for at, columns, own in parts]
        return max(*moved, *(float(np.abs(step[columns][9:]).max(initial=0.0)) for columns in layout.columns))


@dataclass(frozen=True, slots=True, eq=False)
class SensorGroup:
    """Readings of several sensors at the same moments, one direction for each moment."""

    # of each sensor, one reading a moment; of weight 0 where it is missing or does not belong
    each: tuple[ObservationGroup, ...]

    @classmethod
    def of(cls, fields: Floats) -> Self:
        """Take (m, N, 3) readings, NaN where a sensor has none."""
        recorded = np.asarray(np.isfinite(fields).all(axis=2))
        groups = [ObservationGroup.of(field[:, np.newaxis]) for field in np.nan_to_num(fields)]
        return cls(tuple(groups)).weighed(recorded)

    def weighed(self, inliers: NDArray[np.bool_]) -> Self:
        """The same with (m, N) readings that count."""
        weights = inliers.astype(float)[..., np.newaxis]
        return type(self)(tuple(replace(group, weight=own) for group, own in zip(self.each, weights, strict=True)))

    @property
    def inliers(self) -> NDArray[np.bool_]:
        """(m, N) readings that count."""
        return np.stack([group.weight[:, 0] > 0.0 for group in self.each])

    def every(self, step: int) -> Self:
        """One moment of so many."""
        return type(self)(tuple(group.every(step) for group in self.each))

    def at(self, _: Sensors) -> Self:
        """Nothing of it depends on the parameters."""
        return self

    def guess(self, at: Sensors, noise: Floats) -> Floats:
        """(N, 3) the direction at each moment that the sensors agree on best, each weighed by (m,) its noise."""
        total = np.zeros((len(self.each[0].field), 3))
        for group, own, radius, sigma in zip(self.each, at.each, at.radii, noise, strict=True):
            seen = group.centred(own)[:, 0] @ np.linalg.inv(own.ellipsoid_like).T
            total += seen * group.weight * (radius / sigma) ** 2
        length = np.linalg.norm(total, axis=1, keepdims=True)
        unit: Floats = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
        return unit

    def distances(self, at: Sensors, directions: Floats, noise: Floats) -> Floats:
        """(m, N) length of each residual in the sensor's standard deviations, whether the reading counts or not."""
        parts = zip(self.each, at.each, noise.tolist(), strict=True)
        return np.stack([lengths(residuals_of(group, own, directions)[0][:, 0]) / sigma for group, own, sigma in parts])

    def cost(self, at: Sensors, directions: Floats, noise: Floats) -> float:
        """Σ r² in standard deviations."""
        parts = zip(self.each, at.each, noise.tolist(), strict=True)
        return sum(group.cost(own, directions, Weights(sigma)) for group, own, sigma in parts)

    def linearised(self, at: Sensors, directions: Floats, layout: SensorLayout, noise: Floats) -> Linearised:
        """Normal equations at some parameters and directions, the directions eliminated, so many moments at a time."""
        return Linearised.joined([
            eliminated(self._chunk(rows).rows(at, directions[rows], layout, noise))
            for rows in (slice(begin, begin + ROOM) for begin in range(0, len(directions), ROOM))
        ])  # fmt: skip

    def _chunk(self, rows: slice) -> Self:
        """Some of the moments."""
        return type(self)(tuple(group.chunk(rows) for group in self.each))

    def rows(self, at: Sensors, directions: Floats, layout: SensorLayout, noise: Floats) -> ObservationRows:
        """Residuals (N, 3, m) and Jacobians (N, 3, m, P) in standard deviations: a kind of noise for each sensor."""
        parts = [
            rows_of(group, own, directions, columns, Weights(sigma))
            for group, own, columns, sigma in zip(self.each, at.each, layout.each, noise.tolist(), strict=True)
        ]
        jacobian = np.zeros((layout.size, 3, len(directions), len(parts))).transpose(2, 1, 3, 0)
        for sensor, (part, columns) in enumerate(zip(parts, layout.columns, strict=True)):
            jacobian[:, :, sensor, columns] = part.jacobian[:, :, 0]
        residual, own, model, lean = (
            np.concatenate([getattr(part, name) for part in parts], axis=2)
            for name in ("residual", "own", "model", "lean")
        )
        counts = tuple(part.counts[0] for part in parts)
        kinds = tuple(np.s_[:, :, sensor : sensor + 1] for sensor in range(len(parts)))
        return ObservationRows(residual, jacobian, own, model, lean, np.zeros(layout.size), counts, kinds)


SensorIterate: TypeAlias = "Iterate[Sensors, SensorGroup, Floats]"


@dataclass(frozen=True, slots=True, eq=False)
class SensorProblem:
    """Readings of all sensors, and what is thought of the parameters before."""

    group: SensorGroup  # as recorded
    layout: SensorLayout
    priors: tuple[SensorPrior, ...]
    tolerance: ClassVar[float] = NO_WORSE
    settled: ClassVar[float] = SETTLED

    @classmethod
    def of(cls, fields: Floats, at: Sensors, *, reference: int, spread: float) -> Self:
        """Of (m, N, 3) readings, and rotations that are thought to lie about those of some parameters."""
        group = SensorGroup.of(fields)
        before = [
            SensorPrior.of(field[recorded], spread, own.rotation)
            for field, recorded, own in zip(fields, group.inliers, at.each, strict=True)
        ]
        return cls(group, SensorLayout.of(len(fields), reference=reference), tuple(before))

    def initial(self, at: Sensors, noise: Floats, inliers: NDArray[np.bool_] | None = None) -> SensorIterate:
        """Where to begin: with the directions that sensors of (m,) some noise agree on, and (m, N) readings or all."""
        group = self.group if inliers is None else self.group.weighed(inliers)
        return Iterate(at, (group,), (group.guess(at, noise),), noise)

    def prior_equations(self, at: Sensors) -> NormalEquations:
        """What is thought before, in standard deviations, each sensor for itself."""
        size = self.layout.size
        matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for before, own, layout, columns in zip(
            self.priors, at.each, self.layout.each, self.layout.columns, strict=True
        ):
            part = before.equations(own, layout)
            matrix[columns, columns], gradient[columns], cost = part.matrix, part.gradient, cost + part.cost
        return NormalEquations(matrix, gradient, cost, 0)

    def reweighed(self, iterate: SensorIterate, equations: Equations) -> SensorIterate:
        """Each sensor weighed by the noise that its residuals show."""
        factors = equations.noise_factors(np.array([float(layout.size) for layout in self.layout.each]))
        return replace(iterate, weights=np.maximum(iterate.weights * factors, FINEST * iterate.at.radii))
