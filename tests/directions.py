"""Derivatives of the corrected field's direction with respect to a calibration, independent of the engine's code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.geometry.ellipsoid import parameter_derivatives

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid


def direction_gradients(ellipsoid: Ellipsoid, directions: Floats) -> Floats:
    """(K, 3, 9) derivatives of the corrected field's direction with respect to (b, S), at (K, 3) directions, rad/unit.

    Each direction has three rows, of which two would be enough: those of (1 − uuᵀ) S⁻¹, so that no axis is preferred.
    """
    across = np.eye(3)[:, np.newaxis] - directions.T[:, :, np.newaxis] * directions  # (3, K, 3), the columns of 1 − uuᵀ
    vectors = np.linalg.solve(ellipsoid.shape, across.reshape(3, -1))
    return parameter_derivatives(vectors, np.repeat(directions.T, 3, axis=1)).reshape(-1, 3, 9)
