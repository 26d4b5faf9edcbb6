"""Whether something that was found earns its place: how well it fits stretches of a recording that it has not seen.

A recording is cut in blocks of time; each is left out in turn, all else is fitted, and what was left out is looked at:
how far its readings lie from the ellipsoid, and how much the field's angle to the vertical varies. What an
additional term makes up from noise, or from an instrument that speaks of something else, shows here.

>>> [left_out.nonzero()[0].tolist() for _, left_out in folds(6)]
[[0, 1], [2, 3], [4, 5]]
>>> [left_out.nonzero()[0].tolist() for _, left_out in folds(6, pieces=2)]
[[0, 3], [1, 4], [2, 5]]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.errors import FitError
from flinders.estimators.aiding import parameters_of
from flinders.likelihood import dip, magnitude
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA
from flinders.likelihood.gyro import SCALE_SIGMA

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.aiding import Aided
    from flinders.likelihood.parameters import Parameters

FOLDS: Final = 3
"""Parts of a recording that are left out in turn."""


class HoldOutMisfit(NamedTuple):
    """What is off in readings that were left out."""

    length: float  # root mean square distance from the ellipsoid, in the unit of the readings
    height: float = np.nan  # scatter of the sine of the dip, by the verticals that were asked for; NaN without any


def folds(count: int, pieces: int = 1) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Which rows are kept, and which are left out: a third, in one piece or in so many spread evenly."""
    block = np.arange(count) * FOLDS * pieces // max(count, 1) % FOLDS
    for index in range(FOLDS):
        yield block != index, block == index


def fitted(samples: Samples, terms: tuple[str, ...], rotation: Floats | None, near: Aided) -> list[Parameters]:
    """What is found without each of the `folds` in turn; nothing where one of them finds none.

    Parameters
    ----------
    terms : tuple of str
        Of `flinders.estimators.aiding.AIDS`.
    rotation : (3, 3) float, optional
        Which way the magnetometer sits on the body, about which it is looked for.
    near : Aided
        What the whole recording says, where each fit begins.
    """
    gyro_scale = SCALE_SIGMA if "gyro_scale" in near.layout else 0.0
    is_free = "accelerometer" in near.layout
    try:
        return [
            parameters_of(
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
    """How far off readings are from what was `fitted` without them.

    `vertical`: ``dip`` or ``tilt``: by which verticals the dip is looked at.

    >>> from flinders import simulate
    >>> from flinders.estimators.aiding import solve
    >>> tumble = simulate.tumble(seed=1, motion="swayed", n=600)
    >>> whole = {terms: solve(tumble.samples, terms) for terms in ((), ("dip",))}
    >>> fits = [fitted(tumble.samples, terms, None, near) for terms, near in whole.items()]
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
    """Variance of the field's height above the horizon, by verticals that are trusted."""
    if vertical == "dip" and samples.acceleration is not None:
        down, trust = dip.verticals(samples.acceleration)
        down, _ = dip.upright(down, parameters.accelerometer)
    elif vertical == "tilt" and samples.attitude is not None:
        down, trust = dip.verticals_of(samples.attitude)
    else:
        return np.nan
    unit = (samples.field - parameters.offset) @ np.linalg.inv(parameters.ellipsoid_like).T
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-300)
    heights = np.einsum("ni,ni->n", down, unit) / np.maximum(np.linalg.norm(down, axis=1), 1e-300)
    middle = np.average(heights, weights=trust)
    off = (heights - middle) ** 2
    return float(np.average(np.minimum(off, 9.0 * max(np.median(off), 1e-12) / 0.455), weights=trust))
