"""Soft iron is mild unless the readings say otherwise.

Where a recording leaves a direction unseen, nothing but experience speaks for the shape there.
The prior says that the departure of S/R from the identity (R the mean semi-axis) is about
`spread`, alike in all directions:

    cost = |dev(S)/R|² / (2 spread²)

with dev(S) = S − R·1 and the Frobenius norm, so that each off-diagonal entry has the standard
deviation `spread`. It says nothing of the centre and nothing of the size; `sense` keeps those from running
away where nothing else holds them. With readings all around
it has no effect worth a digit; where they are missing it lets the fit fall back to "no soft iron
there" with an uncertainty of that size.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> round(equations(sphere, spread=0.3).cost, 12)
0.0
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.likelihood.parameters import ParameterLayout, Parameters

SPREAD: Final = 0.3
"""Default departure of the scaled matrix from the identity: the soft iron of ordinary mountings, and more."""

SENSE: Final = 10.0

# Deviator of the entries 11, 22, 33, 12, 13, 23; an off-diagonal entry stands twice in the matrix.
DEVIATOR: Final = np.zeros((6, 6))
DEVIATOR[:3, :3] = np.eye(3) - 1.0 / 3.0
DEVIATOR[3:, 3:] = np.sqrt(2.0) * np.eye(3)


def equations(ellipsoid: Ellipsoid, *, spread: float = SPREAD) -> NormalEquations:
    """Give the prior's normal equations, its residuals in standard deviations."""
    entries = upper(ellipsoid.shape)
    scale = np.sqrt(2.0) * spread * float(entries[:3].mean())
    residual: Floats = DEVIATOR @ entries / scale
    jacobian = np.zeros((6, 9))
    jacobian[:, 3:] = -DEVIATOR / scale
    jacobian[:, 3:6] += residual[:, np.newaxis] / entries[:3].sum()
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)


def sense(ellipsoid: Ellipsoid, middle: Floats, spread: float) -> NormalEquations:
    """Give normal equations that keep what no reading speaks for within sense.

    The centre lies within ten spreads of the readings from their middle, and the size is theirs to a factor of about
    ten. A level turn leaves both open across its plane; anything that was seen does not feel it.

    `middle`: (3,), mean reading; `spread`: root mean square distance of the readings from it.
    """
    width = SENSE * spread
    residual = np.append(ellipsoid.centre - middle, np.trace(ellipsoid.shape) / 3.0 - spread) / width
    jacobian = np.zeros((4, 9))
    jacobian[:3, :3] = -np.eye(3) / width
    jacobian[3, 3:6] = -1.0 / (3.0 * width)
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)


@dataclass(frozen=True, slots=True, eq=False)
class KnownShape:
    """The shape of an earlier calibration, instead of what is usual."""

    entries: Floats  # (6,): in the order of `flinders.geometry.ellipsoid.upper`
    covariance: Floats  # (6, 6): positive definite

    def equations(self, ellipsoid: Ellipsoid) -> NormalEquations:
        """Give its normal equations at an ellipsoid, its residuals in standard deviations."""
        left = self.entries - upper(ellipsoid.shape)
        precision = np.linalg.inv(self.covariance)
        return NormalEquations(precision, precision @ left, float(left @ precision @ left), 0).placed(slice(3, 9), 9)


@dataclass(frozen=True, slots=True, eq=False)
class SensorPrior:
    """What is thought of the parameters of one magnetometer before anything is read."""

    spread: float  # departure of the shape from a sphere, see `equations`
    middle: Floats  # (3,): mean reading
    width: float  # root mean square distance of the readings from it, see `sense`
    rotation: Floats  # (3, 3): about which the rotation is thought to lie
    # standard deviations of blocks of `flinders.likelihood.parameters.BLOCKS` where they are not the usual ones
    sigmas: dict[str, float] = field(default_factory=dict)
    known: KnownShape | None = None  # of an earlier calibration: it takes the place of `spread`

    @classmethod
    def of(
        cls, readings: Floats, spread: float, rotation: Floats, known: KnownShape | None = None, **sigmas: float
    ) -> Self:
        """About (N, 3) readings."""
        middle = readings.mean(axis=0)
        width = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
        return cls(spread, middle, width, rotation, sigmas, known)

    def equations(self, at: Parameters, layout: ParameterLayout) -> NormalEquations:
        """Normal equations of all free parameters, in standard deviations."""
        from flinders.likelihood.parameters import BLOCKS

        matrix, gradient = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        shape = self._of_shape(at.ellipsoid) + sense(at.ellipsoid, self.middle, self.width)
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
        """Share of the least known parameter of the shape that the prior speaks for, of (9, 9) the covariance.

        An earlier calibration is no prior in this sense.
        """
        if self.known is not None:
            return 0.0
        of_shape = equations(at.ellipsoid, spread=self.spread).matrix
        return float(np.clip(np.real(np.linalg.eigvals(covariance @ of_shape)).max(), 0.0, 1.0))

    def _of_shape(self, ellipsoid: Ellipsoid) -> NormalEquations:
        """What is thought of the shape."""
        return equations(ellipsoid, spread=self.spread) if self.known is None else self.known.equations(ellipsoid)

    def _departure(self, at: Parameters, name: str) -> Floats:
        """How far a block of parameters is from where it is thought to be; a rotation to first order, in rad."""
        if name != "rotation":
            return np.asarray(getattr(at, name))
        turned = at.rotation @ self.rotation.T
        return 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
