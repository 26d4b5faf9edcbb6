"""Problem of the solver for several magnetometers on one body, which share the direction of the field at each time.

Residuals of sensors i at times k, with the noise σᵢ of each sensor, are

    (xᵢₖ − bᵢ − Sᵢ Rᵢᵀ qₖ) / σᵢ,    |qₖ| = 1

with R = 1 for the reference. Each direction qₖ is eliminated (`flinders.likelihood.observations`). At each time 3m
residuals of m sensors are then equivalent to 3m − 2: m compare the lengths, and 2(m − 1) compare the directions of the
sensors.

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
from flinders.likelihood.equations import MIN_NOISE, NormalEquations
from flinders.likelihood.observations import (
    CHUNK_READINGS,
    EliminatedEquations,
    ObservationGroup,
    ObservationRows,
    Weights,
    eliminate_directions,
    residual_rows,
    unweighted_residuals,
)
from flinders.likelihood.parameters import ParameterLayout, Parameters
from flinders.likelihood.prior import SensorPrior
from flinders.likelihood.solver import LAST_STEP_SIGMAS, MAX_COST_INCREASE, Iterate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.solver import Equations


@dataclass(frozen=True, slots=True, eq=False)
class SensorLayout:
    """Columns of the Jacobian for each sensor."""

    each: tuple[ParameterLayout, ...]  # free parameters of each sensor
    columns: tuple[slice, ...]  # columns of each sensor

    @classmethod
    def of(cls, sensors: int, *, reference: int) -> Self:
        """Assign columns to offset and shape of each sensor, and to the rotation of all but the reference."""
        each = tuple(ParameterLayout.of(rotation=sensor != reference) for sensor in range(sensors))
        ends = np.cumsum([layout.size for layout in each]).tolist()
        return cls(each, tuple(slice(end - layout.size, end) for end, layout in zip(ends, each, strict=True)))

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return int(self.columns[-1].stop)


@dataclass(frozen=True, slots=True, eq=False)
class Sensors:
    """Parameters of all sensors."""

    each: tuple[Parameters, ...]  # parameters of each sensor

    @property
    def radii(self) -> Floats:
        """(m,) radii of spheres of the same volumes."""
        return np.array([at.radius for at in self.each])

    @property
    def is_closed(self) -> bool:
        """Whether all surfaces are ellipsoids."""
        return all(at.is_closed for at in self.each)

    def take_step(self, step: Floats, layout: SensorLayout) -> Self:
        """Parameters after a (P,) step."""
        parts = zip(self.each, layout.columns, layout.each, strict=True)
        return type(self)(tuple(at.take_step(step[columns], own) for at, columns, own in parts))

    def relative_step(self, step: Floats, layout: SensorLayout) -> float:
        """Largest change by a (P,) step: of offset and shape relative to their sensor's radius, of rotations in rad."""
        parts = list(zip(self.each, layout.columns, layout.each, strict=True))
        moved = [at.relative_step(step[columns], own) for at, columns, own in parts]
        return max(*moved, *(float(np.abs(step[columns][9:]).max(initial=0.0)) for columns in layout.columns))


@dataclass(frozen=True, slots=True, eq=False)
class SensorGroup:
    """Readings of several sensors at the same times, with one direction of the field for each time."""

    # group of each sensor, with one reading for each time; a missing reading or an outlier has weight 0
    each: tuple[ObservationGroup, ...]

    @classmethod
    def of(cls, fields: Floats) -> Self:
        """Make the group of (m, N, 3) readings, NaN if a sensor has none."""
        recorded = np.asarray(np.isfinite(fields).all(axis=2))
        groups = [ObservationGroup.of(field[:, np.newaxis]) for field in np.nan_to_num(fields)]
        return cls(tuple(groups)).weight_inliers(recorded)

    def weight_inliers(self, inliers: NDArray[np.bool_]) -> Self:
        """The group with weights 1 for (m, N) inliers and 0 for others."""
        weights = inliers.astype(float)[..., np.newaxis]
        return type(self)(tuple(replace(group, weight=own) for group, own in zip(self.each, weights, strict=True)))

    @property
    def inliers(self) -> NDArray[np.bool_]:
        """(m, N) whether each reading has a weight."""
        return np.stack([group.weight[:, 0] > 0.0 for group in self.each])

    def thin_windows(self, step: int) -> Self:
        """The group with one of `step` times."""
        return type(self)(tuple(group.thin_windows(step) for group in self.each))

    def at(self, _: Sensors) -> Self:
        """The same group, which does not depend on the parameters."""
        return self

    def guess(self, at: Sensors, noise: Floats) -> Floats:
        """(N, 3) mean direction of the sensors at each time, weighted by their (m,) noise."""
        total = np.zeros((len(self.each[0].field), 3))
        for group, own, radius, sigma in zip(self.each, at.each, at.radii, noise, strict=True):
            seen = group.subtract_offset(own)[:, 0] @ np.linalg.inv(own.rotated_shape).T
            total += seen * group.weight * (radius / sigma) ** 2
        length = np.linalg.norm(total, axis=1, keepdims=True)
        unit: Floats = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
        return unit

    def distances(self, at: Sensors, directions: Floats, noise: Floats) -> Floats:
        """(m, N) length of the residual of each reading in standard deviations of the sensor, without weights."""
        parts = zip(self.each, at.each, noise.tolist(), strict=True)
        return np.stack(
            [lengths(unweighted_residuals(group, own, directions)[0][:, 0]) / sigma for group, own, sigma in parts]
        )

    def cost(self, at: Sensors, directions: Floats, noise: Floats) -> float:
        """Σ r², with each residual r in units of its standard deviation."""
        parts = zip(self.each, at.each, noise.tolist(), strict=True)
        return sum(group.cost(own, directions, Weights(sigma)) for group, own, sigma in parts)

    def linearize(self, at: Sensors, directions: Floats, layout: SensorLayout, noise: Floats) -> EliminatedEquations:
        """Normal equations at given parameters and directions, with the directions eliminated; computed in chunks."""
        return EliminatedEquations.join([
            eliminate_directions(self._chunk(rows).rows(at, directions[rows], layout, noise))
            for rows in (slice(begin, begin + CHUNK_READINGS) for begin in range(0, len(directions), CHUNK_READINGS))
        ])  # fmt: skip

    def _chunk(self, rows: slice) -> Self:
        """The group with some of its times."""
        return type(self)(tuple(group.chunk(rows) for group in self.each))

    def rows(self, at: Sensors, directions: Floats, layout: SensorLayout, noise: Floats) -> ObservationRows:
        """(N, 3, m) residuals and (N, 3, m, P) Jacobians in standard deviations; each sensor is a kind of residual."""
        parts = [
            residual_rows(group, own, directions, columns, Weights(sigma))
            for group, own, columns, sigma in zip(self.each, at.each, layout.each, noise.tolist(), strict=True)
        ]
        jacobian = np.zeros((layout.size, 3, len(directions), len(parts))).transpose(2, 1, 3, 0)
        for sensor, (part, columns) in enumerate(zip(parts, layout.columns, strict=True)):
            jacobian[:, :, sensor, columns] = part.jacobian[:, :, 0]
        residual, own, model, mean_residual = (
            np.concatenate([getattr(part, name) for part in parts], axis=2)
            for name in ("residual", "own", "model", "mean_residual")
        )
        counts = tuple(part.counts[0] for part in parts)
        kinds = tuple(np.s_[:, :, sensor : sensor + 1] for sensor in range(len(parts)))
        return ObservationRows(residual, jacobian, own, model, mean_residual, np.zeros(layout.size), counts, kinds)


SensorIterate: TypeAlias = "Iterate[Sensors, SensorGroup, Floats]"


@dataclass(frozen=True, slots=True, eq=False)
class SensorProblem:
    """Readings of all sensors, and the prior of their parameters."""

    group: SensorGroup  # with all recorded readings
    layout: SensorLayout
    priors: tuple[SensorPrior, ...]
    tolerance: ClassVar[float] = MAX_COST_INCREASE
    last_step: ClassVar[float] = LAST_STEP_SIGMAS

    @classmethod
    def of(cls, fields: Floats, at: Sensors, *, reference: int, spread: float) -> Self:
        """Make the problem of (m, N, 3) readings; the prior of the rotations is about those of `at`."""
        group = SensorGroup.of(fields)
        before = [
            SensorPrior.of(field[recorded], spread, own.rotation)
            for field, recorded, own in zip(fields, group.inliers, at.each, strict=True)
        ]
        return cls(group, SensorLayout.of(len(fields), reference=reference), tuple(before))

    def initial(self, at: Sensors, noise: Floats, inliers: NDArray[np.bool_] | None = None) -> SensorIterate:
        """Start of the iteration at given parameters and (m,) noises, with all readings or (m, N) inliers."""
        group = self.group if inliers is None else self.group.weight_inliers(inliers)
        return Iterate(at, (group,), (group.guess(at, noise),), noise)

    def prior_equations(self, at: Sensors) -> NormalEquations:
        """Normal equations of the priors of all sensors."""
        size = self.layout.size
        matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for before, own, layout, columns in zip(
            self.priors, at.each, self.layout.each, self.layout.columns, strict=True
        ):
            part = before.equations(own, layout)
            matrix[columns, columns], gradient[columns], cost = part.matrix, part.gradient, cost + part.cost
        return NormalEquations(matrix, gradient, cost, 0)

    def reweigh(self, iterate: SensorIterate, equations: Equations) -> SensorIterate:
        """Weight each sensor by its estimated noise."""
        factors = equations.noise_factors(np.array([float(layout.size) for layout in self.layout.each]))
        return replace(iterate, weights=np.maximum(iterate.weights * factors, MIN_NOISE * iterate.at.radii))
