"""Whether gyro and accelerometer speak of the body that the magnetometer is on: their unit, their axes, their motion.

Before a term is used it is tried on short stretches, with whatever ellipsoid the magnetometer gives by itself: turned
by each of the 24 ways in which axes can be exchanged, and by each unit in which a rate can be written. What fits
many times better than what was recorded is a mistake in the wiring or the log, and is told.

>>> import dataclasses
>>> from flinders import simulate
>>> from flinders.quadric import Ellipsoid
>>> flight = simulate.tumble(seed=1, motion="flight", n=1500)
>>> swapped = dataclasses.replace(flight.samples, rate=flight.samples.rate[:, [1, 0, 2]] * [1, 1, -1])
>>> sensor = flight.sensor
>>> ellipsoid = Ellipsoid(sensor.offset, flight.field_strength * sensor.matrix)
>>> str(axes_of(swapped, ellipsoid, "rate").axes)
'y,x,-z'
"""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.axes import Axes
from flinders.terms import inclination, turning

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.quadric import Ellipsoid
    from flinders.samples import Samples

STRETCH_S: Final = 0.4
"""Seconds over which a body is followed: the gyro's noise is nothing yet, and the field has moved."""

MANY: Final = 2000
"""Stretches that are looked at."""

MARGIN: Final = 2.0
"""Times better than what was recorded, and than the next best, that another reading of it has to be."""

SCALES: Final = {"rad/s": 1.0, "°/s": np.pi / 180.0, "rad/s with the other sign": -1.0, "mrad/s": 1e-3}
"""What a column of rates may be in, and what it is multiplied by to be in rad/s."""

ONE_AXIS: Final = 0.05
"""Turning about the second axis, of that about the first, below which all of it is about one."""

TURNS: Final = tuple(
    Axes((order[0], order[1], order[2]), (signs[0], signs[1], signs[2]))
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if not Axes((order[0], order[1], order[2]), (signs[0], signs[1], signs[2])).is_mirror
)
"""The 24 ways to exchange axes and stay right-handed, the one that changes nothing first."""


class Mounted(NamedTuple):
    """Which of the 24 ways fits best.

    Attributes
    ----------
    axes : Axes
        Take the magnetometer's readings into the axes of the other instrument.
    better : float
        How many times smaller the residual is than with the axes as recorded; 1 where they stay.
    """

    axes: Axes
    better: float


def rate_unit(samples: Samples, ellipsoid: Ellipsoid) -> tuple[str, float]:
    """In which unit the rate seems to be, and how many times better it fits than rad/s.

    Parameters
    ----------
    samples : Samples
        With time and rate.
    ellipsoid : Ellipsoid
        What the magnetometer finds by itself.
    """
    first, last, rate, interval = _stretches(samples, ellipsoid)
    if not len(first):
        return "rad/s", 1.0
    misses = {name: _missed(first, last, rate * scale, interval, np.eye(3)) for name, scale in SCALES.items()}
    best = min(misses, key=lambda name: misses[name])
    better = misses["rad/s"] / max(misses[best], 1e-12)
    return (best, better) if better > MARGIN else ("rad/s", 1.0)


def axes_of(samples: Samples, ellipsoid: Ellipsoid, aid: str) -> Mounted:
    """Look through the 24 ways in which the magnetometer may sit; as recorded unless another is better by a margin."""
    misses = _by_rate(samples, ellipsoid) if aid == "rate" else _by_vertical(samples, ellipsoid)
    if misses is None:
        return Mounted(Axes(), 1.0)
    order = np.argsort(misses, kind="stable")
    best, next_best = misses[order[0]], misses[order[1]]
    clear = misses[0] > MARGIN * best and next_best > np.sqrt(MARGIN) * best
    return Mounted(TURNS[order[0]], float(misses[0] / max(best, 1e-12))) if clear else Mounted(Axes(), 1.0)


def second_axis(rate: Floats) -> float:
    """How much a body turns about its second axis, of how much about its first: 0 where all is about one.

    Parameters
    ----------
    rate : (N, 3) float, rad/s
        Without the gyro's bias.

    Examples
    --------
    >>> second_axis(np.outer(np.linspace(-1, 1, 50), [0.0, 0.0, 1.0]))
    0.0
    """
    about = rate[np.isfinite(rate).all(axis=1)]
    if len(about) < 2:
        return 0.0
    values = np.linalg.eigvalsh(about.T @ about).clip(min=0.0)
    return float(np.sqrt(values[1] / max(values[2], 1e-300)))


def _by_rate(samples: Samples, ellipsoid: Ellipsoid) -> Floats | None:
    """(24,) how far the field is from where the gyro says, for each way."""
    if samples.rate is None or samples.time is None:
        return None
    first, last, rate, interval = _stretches(samples, ellipsoid)
    if not len(first):
        return None
    return np.array([_missed(first, last, rate, interval, axes.apply(np.eye(3)).T) for axes in TURNS])


def _by_vertical(samples: Samples, ellipsoid: Ellipsoid) -> Floats | None:
    """(24,) by how much the sine of the dip varies, for each way."""
    if samples.acceleration is None:
        return None
    down, trust = inclination.verticals(samples.acceleration)
    unit = _directions(samples.field, ellipsoid)
    found = []
    for axes in TURNS:
        heights = np.einsum("ni,ni->n", down, axes.apply(unit))
        middle = float(np.average(heights, weights=trust))
        found.append(float(np.sqrt(np.average((heights - middle) ** 2, weights=trust))))
    return np.array(found)


def _directions(field: Floats, ellipsoid: Ellipsoid) -> Floats:
    seen = np.linalg.solve(ellipsoid.shape, (field - ellipsoid.centre).T).T
    unit: Floats = seen / np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-300)
    return unit


def _stretches(samples: Samples, ellipsoid: Ellipsoid) -> tuple[Floats, Floats, Floats, Floats]:
    """Directions (W, 3) at the beginning and the end of short stretches, and what the gyro says in between."""
    if samples.time is None or samples.rate is None:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 1, 3)), np.empty((0, 1))
    rows = turning.windows(samples.time, samples.rate, window_s=STRETCH_S)
    rows = rows[:: max(1, -(-len(rows) // MANY))]
    steps = np.diff(samples.time[rows], axis=1) if len(rows) else np.empty((0, rows.shape[1] - 1))
    interval = np.concatenate([steps, steps[:, -1:]], axis=1)
    unit = _directions(samples.field[rows.ravel()], ellipsoid).reshape(*rows.shape, 3)
    return unit[:, 0], unit[:, -1], np.nan_to_num(samples.rate[rows]), interval


def _missed(first: Floats, last: Floats, rate: Floats, interval: Floats, turn: Floats) -> float:
    """Root mean square distance of the field from where a gyro says, the magnetometer turned by a (3, 3) rotation."""
    turned = turning.integrated(rate, interval, np.zeros(3)).rotations[:, -1]
    expected = np.einsum("wji,wj->wi", turned, first @ turn)
    return float(np.sqrt(np.mean(np.sum((last @ turn - expected) ** 2, axis=1))))
