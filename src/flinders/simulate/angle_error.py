"""How far a correction is from the truth, in degrees over all directions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from flinders.arrays import matrix as square
from flinders.simulate._checks import triple
from flinders.simulate.sensor import symmetric_power
from flinders.summary.coverage import fibonacci

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.simulate.recording import Simulated


def angle_error_deg(
    matrix: ArrayLike,
    offset: ArrayLike,
    truth: Simulated,
    *,
    rotation: Literal["symmetric", "best"] = "symmetric",
) -> float:
    """Root mean square angle between true and corrected field, over 400 directions spread evenly, in degrees.

    The matrix is judged by its symmetric root (MᵀM)^½, which is all that an ellipsoid fixes of it; its scale
    does not count.

    Parameters
    ----------
    matrix : (3, 3) array-like
        Of the calibration that is judged.
    offset : (3,) array-like, µT
    truth : Simulated
        Its sensor and field strength.
    rotation : str
        ``symmetric`` counts the sensor's own `Sensor.rotation` as error, as a heading would; ``best`` takes the
        best rotation away first, for sensors whose matrix is not symmetric.

    Raises
    ------
    ArrayError
        For a wrong shape or values that are not finite.

    Examples
    --------
    >>> from flinders.simulate import Sensor, tumble
    >>> recording = tumble(sensor=Sensor(matrix=[[1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    >>> angle_error_deg(*recording.sensor.correction, recording)
    2.3
    >>> angle_error_deg(*recording.sensor.correction, recording, rotation="best")
    0.0
    """
    root = symmetric_power(square(matrix).T @ square(matrix), 0.5)
    true = fibonacci(400)
    raw = truth.field_strength * true @ truth.sensor.matrix.T + truth.sensor.offset
    corrected = (raw - triple(offset)) @ root
    if rotation == "best":
        corrected = corrected @ best_rotation(corrected, true).T
    across = np.linalg.norm(np.cross(corrected, true), axis=1)
    angles = np.arctan2(across, np.sum(corrected * true, axis=1))
    return math.degrees(math.sqrt(np.mean(angles**2)))


def best_rotation(turned: Floats, true: Floats) -> Floats:
    """(3, 3) the rotation that brings (N, 3) vectors closest to the true ones (Kabsch 1976)."""
    left, _, right = np.linalg.svd(true.T @ turned)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    rotation: Floats = left @ right
    return rotation
