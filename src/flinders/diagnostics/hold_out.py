"""Cross-validation of a term of a fit: its misfit in stretches of a recording that were left out.

A recording is cut into blocks of time. Each is left out in turn, the rest is fitted, and two errors of the left-out
readings are computed: their distance from the ellipsoid, and the scatter of the field's angle to the vertical. An
additional term that only fits noise, or an instrument that does not belong to the magnetometer, increases these errors.

>>> [left_out.nonzero()[0].tolist() for _, left_out in folds(6)]
[[0, 1], [2, 3], [4, 5]]
>>> [left_out.nonzero()[0].tolist() for _, left_out in folds(6, pieces=2)]
[[0, 3], [1, 4], [2, 5]]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.errors import FitError
from flinders.estimators.aiding import fit_parameters
from flinders.likelihood import dip, magnitude
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA
from flinders.likelihood.gyro import SCALE_SIGMA

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.aiding import AidedFit
    from flinders.likelihood.parameters import Parameters

FOLDS: Final = 3
"""Count of parts of a recording that are left out in turn."""


class HoldOutMisfit(NamedTuple):
    """Errors of left-out readings."""

    length: float  # rms distance from the ellipsoid, in the unit of the readings
    height: float = np.nan  # scatter of the sine of the dip, by the requested verticals; NaN without verticals


def folds(count: int, pieces: int = 1) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield the masks of fitted and of left-out rows for each fold.

    Each fold leaves out a third of the rows, in `pieces` intervals that are spread evenly.
    """
    block = np.arange(count) * FOLDS * pieces // max(count, 1) % FOLDS
    for index in range(FOLDS):
        yield block != index, block == index


def fit_folds(samples: Samples, terms: tuple[str, ...], rotation: Floats | None, near: AidedFit) -> list[Parameters]:
    """Parameters of the fits without each of the `folds` in turn; empty if one of the fits fails.

    Parameters
    ----------
    terms : tuple of str
        Names of `flinders.estimators.aiding.AIDING_TERMS`.
    rotation : (3, 3) float, optional
        Approximate rotation of the magnetometer on the body, which is the mean of the prior.
    near : AidedFit
        Fit of the whole recording, whose parameters are the start of each fit.
    """
    gyro_scale = SCALE_SIGMA if "gyro_scale" in near.layout else 0.0
    is_free = "accelerometer" in near.layout
    try:
        return [
            fit_parameters(
                samples[training],
                terms,
                rotation=rotation,
                near=near,
                gyro_scale=gyro_scale,
                acceleration_bias=ACCELERATION_SIGMA * is_free,
                acceleration_gain=GAIN_SIGMA * is_free,
            )
            for training, _ in folds(len(samples))
        ]
    except FitError:
        return []


def hold_out_misfit(samples: Samples, fits: list[Parameters], vertical: str | None) -> HoldOutMisfit:
    """Errors of readings against the parameters that `fit_folds` found without them.

    `vertical` is ``dip`` or ``tilt``, the source of the verticals for the dip; None for no dip.

    >>> from flinders import simulate
    >>> from flinders.estimators.aiding import fit_aided
    >>> tumble = simulate.tumble(seed=1, motion="swayed", n=600)
    >>> whole = {terms: fit_aided(tumble.samples, terms) for terms in ((), ("dip",))}
    >>> fits = [fit_folds(tumble.samples, terms, None, near) for terms, near in whole.items()]
    >>> alone, aided = (hold_out_misfit(tumble.samples, parameters, "dip") for parameters in fits)
    >>> aided.length < 1.1 * tumble.sensor.noise and aided.height < alone.height
    True
    """
    if not fits:
        return HoldOutMisfit(np.inf, np.inf)
    lengths, heights = [], []
    for parameters, (_, left_out) in zip(fits, folds(len(samples)), strict=True):
        lengths.append(np.mean(magnitude.distances(samples.field[left_out], parameters.ellipsoid) ** 2))
        heights.append(_heights(samples[left_out], parameters, vertical))
    return HoldOutMisfit(float(np.sqrt(np.mean(lengths))), float(np.sqrt(np.mean(heights))))


def _heights(samples: Samples, parameters: Parameters, vertical: str | None) -> float:
    """Variance of the sine of the field's inclination, by trusted verticals."""
    if vertical == "dip" and samples.acceleration is not None:
        down, trust = dip.accelerometer_verticals(samples.acceleration)
        down, _ = dip.correct_verticals(down, parameters.accelerometer)
    elif vertical == "tilt" and samples.attitude is not None:
        down, trust = dip.attitude_verticals(samples.attitude)
    else:
        return np.nan
    unit = (samples.field - parameters.offset) @ np.linalg.inv(parameters.rotated_shape).T
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-300)
    heights = np.einsum("ni,ni->n", down, unit) / np.maximum(np.linalg.norm(down, axis=1), 1e-300)
    middle = np.average(heights, weights=trust)
    off = (heights - middle) ** 2
    return float(np.average(np.minimum(off, 9.0 * max(np.median(off), 1e-12) / 0.455), weights=trust))
