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
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.likelihood import magnitude

if TYPE_CHECKING:
    from flinders.arrays import Floats


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
