"""Disturbances of the offset: the columns of the Jacobian that a current, a throttle or a temperature adds.

A reading x has y = S⁻¹(b' − …) with an offset that follows disturbances, and its Sampson distance is that of the
settled reading x − Σ P c, c counted from the reference. With J = [n, n_i u_j] of `flinders.likelihood.magnitude`,

    ∂s/∂P = −n c,        ∂s/∂a = −τ n·S u

for each disturbance's c, and a the growth of the earth's part with a departure τ of the temperature. They are linear in
P, so that from a fair start a few Gauss–Newton steps are enough.

Use it where a disturbance was recorded beside the readings and changed while the sensor was turned; where it changed in
step with the attitude, no reading can tell both apart, and `shared` says how much so.

Source: the model is that of ArduPilot's CompassMot, estimated in flight with the magnitude as the only witness.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> columns(np.array([[0.0, 0.0, 1.0]]), sphere, np.array([[2.0]]))
array([[0., 0., 2.]])

`Disturbances` are the columns themselves, taken about their mean, so that the offset of a fit is that at the
disturbances' mean, which stands in `reference`. One that stays the same cannot be distinguished from the offset, see
`constant`.

Source: linear compensation by current or throttle as in ArduPilot's compassmot and PX4's CAL_MAG_COMP_TYP.

>>> motors = Disturbances.of({"current": np.array([0.0, 10.0, 20.0]), "other": np.array([3.0, 3.0, 3.0])})
>>> motors.names, motors.columns[:, 0], motors.constant
(('current', 'other'), array([-10.,   0.,  10.]), ('other',))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.likelihood import magnitude
from flinders.likelihood.term import Block

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats

SLOPE_SIGMA: Final = 0.01
"""1/°C: no scale changes by more than a hundredth a degree."""


@dataclass(frozen=True, slots=True, eq=False)
class Disturbances:
    """Columns beside the readings."""

    names: tuple[str, ...]  # one for each column
    columns: Floats  # (N, m): about their mean
    reference: Floats  # (m,): that mean
    warmth: Floats | None = None  # (N,), °C: departure of the temperature from its mean where the scale may follow it

    @classmethod
    def of(cls, columns: Mapping[str, Floats], *, warmth: Floats | None = None) -> Self:
        """Take columns by name; a value that is not known counts as the mean."""
        table = np.stack([np.asarray(column, float) for column in columns.values()], axis=1)
        reference = np.nanmean(table, axis=0)
        about = None if warmth is None else np.nan_to_num(warmth - np.nanmean(warmth))
        return cls(tuple(columns), np.nan_to_num(table - reference), reference, about)

    @property
    def constant(self) -> tuple[str, ...]:
        """Those that never change, and so say nothing."""
        still = np.ptp(self.columns, axis=0) <= 1e-9 * np.maximum(np.abs(self.reference), 1e-300)
        return tuple(name for name, stays in zip(self.names, still, strict=True) if stays)

    def without(self, names: tuple[str, ...]) -> Self | None:
        """Leave some out; None if nothing is left."""
        left = [index for index, name in enumerate(self.names) if name not in names]
        if not left and self.warmth is None:
            return None
        chosen = tuple(self.names[index] for index in left)
        return type(self)(chosen, self.columns[:, left], self.reference[left], self.warmth)


def columns(directions: Floats, ellipsoid: Ellipsoid, departures: Floats, warmth: Floats | None = None) -> Floats:
    """(N, 3 K + 1 or + 0) by how much each disturbance's offset, and the growth with warmth, moves the surface.

    Parameters
    ----------
    directions : (N, 3) float
        Unit directions u of the settled readings.
    departures : (N, K) float
        Each disturbance's value less its reference.
    warmth : (N,) float, optional
        Departure of the temperature, where the scale follows it.
    """
    jacobian = magnitude.information(directions, ellipsoid)
    moved = (departures[:, :, np.newaxis] * jacobian[:, np.newaxis, :3]).reshape(len(directions), -1)
    if warmth is None:
        return moved
    growth = warmth * (jacobian[:, 3:] @ upper(ellipsoid.shape))
    return np.column_stack([moved, growth])


def shared(jacobian: Floats, regressors: Floats) -> float:
    """Share of the information about a disturbance that offset and shape could explain, 0 to 1, at worst.

    The largest squared canonical correlation of the disturbance's columns, made about their means, with those of the
    ellipsoid: with 1 both cannot be distinguished.

    `jacobian`: (N, 9); `regressors`: (N, 3), `columns` of a disturbance counted from its mean.

    A current that follows the attitude, and one that does not:

    >>> rng = np.random.default_rng(1)
    >>> sphere, directions = Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), rng.normal(size=(500, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> jacobian = magnitude.information(directions, sphere)
    >>> for current in (directions[:, 2], rng.uniform(-1.0, 1.0, 500)):
    ...     print(round(shared(jacobian, columns(directions, sphere, current[:, np.newaxis])), 1))
    1.0
    0.0
    """
    ours, _ = np.linalg.qr(jacobian / _sizes(jacobian))
    theirs, _ = np.linalg.qr(regressors / _sizes(regressors))
    return float(np.clip(np.linalg.norm(ours.T @ theirs, ord=2) ** 2, 0.0, 1.0))


def _sizes(columns: Floats) -> Floats:
    """(K,) lengths of columns; 1 for one of nothing."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes > 0.0, sizes, 1.0)


def fill(
    jacobian: Floats, blocks: Mapping[str, slice], disturbances: Floats | None, warmth: Floats | None, model: Floats
) -> None:
    """Write what disturbances add to the Jacobian of readings, in their unit.

    Parameters
    ----------
    jacobian : (W, 3 or more, n, P) float
    blocks : mapping of str to slice
        Columns of all blocks that are free.
    disturbances : (W, n, m) float, optional
    warmth : (W, n) float, optional
    model : (W, n, 3) float
        Readings about their offset, without what the temperature makes of their scale.
    """
    if disturbances is not None and "disturbances" in blocks:
        begin = blocks["disturbances"].start
        for place in range(disturbances.shape[-1]):
            for axis in range(3):
                jacobian[:, axis, :, begin + 3 * place + axis] = disturbances[..., place]
    if warmth is not None and "slope" in blocks:
        jacobian[:, :3, :, blocks["slope"].start] = np.swapaxes(model * warmth[..., np.newaxis], 1, 2)


BLOCKS: Final = (Block("disturbances", 3), Block("slope", 1, SLOPE_SIGMA))
"""Parameters that disturbances bring: an offset for each unit of each, and a slope of the scale."""
