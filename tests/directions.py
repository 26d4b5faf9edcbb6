"""How the direction of the corrected field depends on a calibration, written out as the engine does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.geometry.ellipsoid import parameter_derivatives

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid


def direction_gradients(ellipsoid: Ellipsoid, directions: Floats) -> Floats:
    """(K, 3, 9) how the corrected field's direction changes with (b, S) at each of (K, 3) unit directions, rad/unit.

    Three rows a direction, of which two would do: the rows of (1 − uuᵀ) S⁻¹, so that no axis is preferred.
    """
    across = np.eye(3)[:, np.newaxis] - directions.T[:, :, np.newaxis] * directions  # (3, K, 3), the columns of 1 − uuᵀ
    vectors = np.linalg.solve(ellipsoid.shape, across.reshape(3, -1))
    return parameter_derivatives(vectors, np.repeat(directions.T, 3, axis=1)).reshape(-1, 3, 9)
