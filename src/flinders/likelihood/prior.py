"""Prior of the soft iron: it is small unless the readings contradict.

If a recording lacks directions, only experience tells the shape of the ellipsoid there. The prior is that S/R,
with R the mean semi-axis, differs from the identity by about `spread`, equally in all directions:

    cost = |dev(S)/R|² / (2 spread²)

with dev(S) = S − R·1 and the Frobenius norm, so that each off-diagonal entry has the standard
deviation `spread`. This prior is independent of centre and size; `plausibility_equations` limits these two if nothing
else does. With readings in all directions the prior has a negligible effect. Where readings are missing,
the fit returns no soft iron, with an uncertainty of `spread`.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> round(equations(sphere, spread=0.3).cost, 12)
0.0
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, upper_entries
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.likelihood.parameters import ParameterLayout, Parameters

SOFT_IRON_SPREAD: Final = 0.3
"""Default of `spread`; the soft iron of usual mountings is smaller."""

PLAUSIBLE_SPREADS: Final = 10.0
"""1 σ of centre and size in `plausibility_equations`, as a multiple of the spread of the readings."""

# Deviator of the entries 11, 22, 33, 12, 13, 23; an off-diagonal entry occurs twice in the matrix.
DEVIATOR_MATRIX: Final = np.zeros((6, 6))
DEVIATOR_MATRIX[:3, :3] = np.eye(3) - 1.0 / 3.0
DEVIATOR_MATRIX[3:, 3:] = np.sqrt(2.0) * np.eye(3)


def equations(ellipsoid: Ellipsoid, *, spread: float = SOFT_IRON_SPREAD) -> NormalEquations:
    """Normal equations of the prior of the shape, at an ellipsoid."""
    entries = upper_entries(ellipsoid.shape)
    scale = np.sqrt(2.0) * spread * float(entries[:3].mean())
    residual: Floats = DEVIATOR_MATRIX @ entries / scale
    jacobian = np.zeros((6, 9))
    jacobian[:, 3:] = -DEVIATOR_MATRIX / scale
    jacobian[:, 3:6] += residual[:, np.newaxis] / entries[:3].sum()
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)


def plausibility_equations(ellipsoid: Ellipsoid, middle: Floats, spread: float) -> NormalEquations:
    """Normal equations that keep centre and size in a plausible range if the readings do not determine them.

    1 σ of the centre, and of the size, is ten times the spread of the readings about their mean. A level turn does not
    determine centre and size perpendicular to its plane. On observable parameters the effect is negligible.

    `middle` is the (3,) mean reading; `spread` is the rms distance of the readings from `middle`.
    """
    width = PLAUSIBLE_SPREADS * spread
    residual = np.append(ellipsoid.centre - middle, np.trace(ellipsoid.shape) / 3.0 - spread) / width
    jacobian = np.zeros((4, 9))
    jacobian[:3, :3] = -np.eye(3) / width
    jacobian[3, 3:6] = -1.0 / (3.0 * width)
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)


@dataclass(frozen=True, slots=True, eq=False)
class KnownShape:
    """Prior of the shape from an earlier calibration."""

    entries: Floats  # (6,): in the order of `flinders.geometry.ellipsoid.upper_entries`
    covariance: Floats  # (6, 6): positive definite

    def equations(self, ellipsoid: Ellipsoid) -> NormalEquations:
        """Normal equations of this prior, at an ellipsoid."""
        left = self.entries - upper_entries(ellipsoid.shape)
        precision = np.linalg.inv(self.covariance)
        return NormalEquations(precision, precision @ left, float(left @ precision @ left), 0).place_block(
            slice(3, 9), 9
        )


@dataclass(frozen=True, slots=True, eq=False)
class SensorPrior:
    """Prior of all parameters of one magnetometer."""

    spread: float  # 1 σ of the deviation of the shape from a sphere, see `equations`
    middle: Floats  # (3,): mean reading
    width: float  # root mean square distance of the readings from `middle`, see `plausibility_equations`
    rotation: Floats  # (3, 3): mean of the prior of the rotation
    # standard deviations of blocks of parameters by name, in place of those of `flinders.likelihood.parameters.BLOCKS`
    sigmas: dict[str, float] = field(default_factory=dict)
    known: KnownShape | None = None  # shape of an earlier calibration, in place of the prior with `spread`

    @classmethod
    def of(
        cls, readings: Floats, spread: float, rotation: Floats, known: KnownShape | None = None, **sigmas: float
    ) -> Self:
        """Make the prior for (N, 3) readings."""
        middle = readings.mean(axis=0)
        width = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
        return cls(spread, middle, width, rotation, sigmas, known)

    def equations(self, at: Parameters, layout: ParameterLayout) -> NormalEquations:
        """Normal equations of all free parameters, in standard deviations."""
        from flinders.likelihood.parameters import BLOCKS

        matrix, gradient = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        shape = self._shape_equations(at.ellipsoid) + plausibility_equations(at.ellipsoid, self.middle, self.width)
        matrix[:9, :9], gradient[:9], cost = shape.matrix, shape.gradient, shape.cost
        for name, _, usual in BLOCKS:
            if usual is not None and name in layout:
                value, sigma = self._departure(at, name), self.sigmas.get(name, usual)
                columns = layout.columns[name]
                matrix[columns, columns] += np.eye(columns.stop - columns.start) / sigma**2
                gradient[columns] -= value / sigma**2
                cost += float(np.sum(np.square(value))) / sigma**2
        return NormalEquations(matrix, gradient, cost, 0)

    def influence(self, at: Parameters, covariance: Floats) -> float:
        """Share of the prior in the information on the least known parameter of the shape, 0 to 1.

        `covariance` is the (9, 9) one of the fit. The result is 0 for the shape of an earlier calibration.
        """
        if self.known is not None:
            return 0.0
        of_shape = equations(at.ellipsoid, spread=self.spread).matrix
        return float(np.clip(np.real(np.linalg.eigvals(covariance @ of_shape)).max(), 0.0, 1.0))

    def _shape_equations(self, ellipsoid: Ellipsoid) -> NormalEquations:
        """Normal equations of the prior of the shape."""
        return equations(ellipsoid, spread=self.spread) if self.known is None else self.known.equations(ellipsoid)

    def _departure(self, at: Parameters, name: str) -> Floats:
        """Difference of a block of parameters from the mean of its prior; for a rotation to first order, in rad."""
        if name != "rotation":
            return np.asarray(getattr(at, name))
        turned = at.rotation @ self.rotation.T
        return 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
