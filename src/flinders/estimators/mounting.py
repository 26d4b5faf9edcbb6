"""Check of a gyro's and an accelerometer's unit, axes and motion against the magnetometer.

Before a term of an instrument is used, it is tested on intervals of the recording: with each unit in which a rate can
be written, and with each of the 48 signed permutations of axes. If one of them fits much better than the recorded one,
the wiring or the log has an error, which is reported. With y = S⁻¹x for the shape S of the magnetometer alone, and an
unknown offset β,

    D (y₁ − β) = ΔRᵀ D (y₀ − β)        of a gyro, from the beginning of an interval to its end
    dᵀ D (y − β) = sin I               of an accelerometer with the vertical d

are linear in β (and sin I). So each permutation D needs only a small linear fit, and the offset of the magnetometer
need not be known. Intervals are long enough for the field's direction to change by about ten degrees, more than the
noise.

>>> import dataclasses
>>> from flinders import simulate
>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> flight = simulate.tumble(seed=1, motion="flight", n=1500)
>>> swapped = dataclasses.replace(flight.samples, rate=flight.samples.rate[:, [1, 0, 2]] * [1, 1, -1])
>>> sensor = flight.sensor
>>> mounted = fit_gyro_axes(swapped, Ellipsoid(sensor.offset, flight.field_strength * sensor.matrix))
>>> str(mounted.axes), mounted.unit, mounted.is_clear
('y,x,-z', 'rad/s', True)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import AXIS_ROTATIONS, Axes
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import dip, gyro

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples

INTERVALS_S: Final = (0.4, 0.8, 1.6, 3.2, 6.4)
"""Lengths of intervals in s, in the order in which they are tried."""

MIN_MOTION: Final = 0.2
"""Smallest median change of the unit vector of the field in an interval, as its length: eleven degrees."""

MAX_INTERVALS: Final = 2000
"""Largest number of intervals of a gyro, or of verticals of an accelerometer."""

MAX_READINGS: Final = 12_000
"""Largest number of readings in all intervals."""

MIN_INTERVALS: Final = 12
"""Smallest number of intervals of a gyro, or of verticals of an accelerometer."""

MIN_IMPROVEMENT: Final = 2.0
"""Smallest ratio of the recorded residual to that of another unit or permutation that fits much better."""

MAX_EQUAL_RATIO: Final = 1.4
"""Largest ratio of a residual to the smallest residual at which both units or permutations fit equally well."""

RAD_S: Final = "rad/s"
SCALES: Final = {
    RAD_S: 1.0,
    "°/s": np.pi / 180.0,
    "mrad/s (or the times are in ms)": 1e-3,
    "m°/s": np.pi / 180e3,
    "rad/s that was taken for °/s": 180.0 / np.pi,
}
"""Possible units of a column of rates, and their factors to rad/s."""

MAX_RATE_RESIDUAL: Final = 0.5
"""Residual of a gyro, relative to the motion of the field, up to which no other ellipsoid is tried."""

REVERSED_AXES: Final = Axes(signs=(-1, -1, -1))
"""Mapping that reverses all axes."""


@dataclass(frozen=True, slots=True)
class MountingFit:
    """Axes and unit of an instrument that fit the magnetometer best."""

    # mapping from the magnetometer's axes to those of the instrument; a mirror image if one of both is left-handed
    axes: Axes = field(default_factory=Axes)
    unit: str = RAD_S  # name of the unit in `SCALES`
    # ratio of the residual of the recorded axes and unit to the best residual; 1 if the recorded ones are kept
    improvement: float = 1.0
    is_clear: bool = True  # whether no other equally simple mapping fits as well
    rotation_residuals: tuple[float, ...] = ()  # residual of each of `AXIS_ROTATIONS`, in the recorded unit
    # residual of the best mapping of a gyro, relative to the motion of the field; 0 if the mapping was not tested, or
    # the field hardly moved
    residual: float = 0.0

    @property
    def is_as_recorded(self) -> bool:
        """Whether nothing fits much better than the recorded axes and unit."""
        return self.improvement == 1.0

    def is_allowed(self, axes: Axes) -> bool:
        """Whether a mapping fits about as well as the best one; a mirror image counts as its negative, a rotation."""
        turn = axes.opposite if axes.is_mirror else axes
        residuals = self.rotation_residuals
        return not residuals or residuals[AXIS_ROTATIONS.index(turn)] <= MIN_IMPROVEMENT * min(residuals)


def fit_gyro_axes(samples: Samples, ellipsoid: Ellipsoid) -> MountingFit:
    """Unit and axes of a gyro with which it explains the motion of the field.

    The recorded ones are kept unless others fit much better. `samples` have times and rates; `ellipsoid` is that of the
    magnetometer alone, of which only the shape is used.
    """
    if samples.rate is None or samples.time is None:
        return MountingFit()
    free = _best_for_shape(samples, ellipsoid)
    if free.residual <= MAX_RATE_RESIDUAL:
        return free
    return min(free, _best_for_shape(samples, _sphere(samples.field)), key=lambda one: one.residual)


def _best_for_shape(samples: Samples, ellipsoid: Ellipsoid) -> MountingFit:
    """Best unit and axes of a gyro for the shape of one ellipsoid."""
    first, last, rate, interval = _segments(samples, ellipsoid)
    if len(first) < MIN_INTERVALS:
        return MountingFit()
    still = float(np.sqrt(np.mean(np.sum((last - first) ** 2, axis=1))))
    misses = _rate_residuals(first, last, rate, interval, RAD_S)
    if not misses[RAD_S, Axes()] <= min(MAX_RATE_RESIDUAL * still, MIN_IMPROVEMENT * min(misses.values())):
        for unit in SCALES:
            misses |= _rate_residuals(first, last, rate, interval, unit)
    left = min(misses.values()) / max(still, 1e-300)
    return replace(_choose_simplest(misses), residual=left if still > MIN_MOTION else 0.0)


def _sphere(field: Floats) -> Ellipsoid:
    """Sphere about readings whose ellipsoid is not known, such as readings in a plane."""
    middle = field.mean(axis=0)
    return Ellipsoid(middle, float(np.sqrt(np.mean(np.sum((field - middle) ** 2, axis=1)))) * np.eye(3))


def fit_accelerometer_axes(samples: Samples, ellipsoid: Ellipsoid) -> MountingFit:
    """Axes of an accelerometer with which the angle between field and vertical is constant.

    Parameters are as in `fit_gyro_axes`. An accelerometer whose axes are all reversed is not recognised, as the angle
    of the field to an upward vertical is constant, too.
    """
    if samples.acceleration is None:
        return MountingFit()
    down, trust = dip.accelerometer_verticals(samples.acceleration)
    rows = np.flatnonzero(trust > 0.0)
    rows = rows[:: max(1, -(-len(rows) // MAX_INTERVALS))]
    if len(rows) < MIN_INTERVALS:
        return MountingFit()
    weight = np.sqrt(trust[rows] / trust[rows].mean())
    seen = _to_unit_sphere(samples.field[rows], ellipsoid)
    heights = np.stack([np.einsum("ni,ni->n", down[rows], axes.apply(seen)) for axes in AXIS_ROTATIONS], axis=1)
    design = np.concatenate([down[rows], np.ones((len(rows), 1))], axis=1)
    left = _rms_residuals(design * weight[:, np.newaxis], heights * weight[:, np.newaxis])
    return _choose_simplest({(RAD_S, axes): miss for axes, miss in zip(AXIS_ROTATIONS, left.tolist(), strict=True)})


def second_axis_ratio(rate: Floats) -> float:
    """Ratio of a body's rotation about its second principal axis to that about its first; 0 for one axis.

    Products of consecutive rates are used, whose mean does not contain the gyro's white noise. `rate` is (N, 3), in
    rad/s, without the gyro's bias, in the order of time.

    >>> second_axis_ratio(np.outer(np.linspace(-1, 1, 50), [0.0, 0.0, 1.0]))
    0.0
    """
    about = rate[np.isfinite(rate).all(axis=1)]
    if len(about) < 2:
        return 0.0
    values = np.linalg.eigvalsh(about[:-1].T @ about[1:] + about[1:].T @ about[:-1]).clip(min=0.0)
    return float(np.sqrt(values[1] / max(values[2], 1e-300)))


def _rate_residuals(
    first: Floats, last: Floats, rate: Floats, interval: Floats, unit: str
) -> dict[tuple[str, Axes], float]:
    """Rms residual of the field's motion that a gyro does not explain, in one unit, for each of the 48 permutations."""
    misses: dict[tuple[str, Axes], float] = {}
    for sign in (1, -1):
        turned = gyro.integrate_rates(sign * SCALES[unit] * rate, interval, np.zeros(3)).rotations[:, -1]
        back = np.swapaxes(turned, 1, 2)
        targets = [axes.apply(last) - np.einsum("wij,wj->wi", back, axes.apply(first)) for axes in AXIS_ROTATIONS]
        design = (np.eye(3) - back).reshape(-1, 3)
        left = np.sqrt(3.0) * _rms_residuals(design, np.stack(targets, axis=-1).reshape(len(design), -1))
        signed = AXIS_ROTATIONS if sign > 0 else [axes.opposite for axes in AXIS_ROTATIONS]
        misses |= {(unit, axes): miss for axes, miss in zip(signed, left.tolist(), strict=True)}
    return misses


def _choose_simplest(misses: dict[tuple[str, Axes], float]) -> MountingFit:
    """Choose the recorded axes and unit, or, if others fit much better, the simplest of those that fit best."""
    recorded, best = misses[RAD_S, Axes()], min(misses.values())
    turned = tuple(misses[RAD_S, axes] for axes in AXIS_ROTATIONS)
    if recorded <= MIN_IMPROVEMENT * best:
        return MountingFit(rotation_residuals=turned)
    alike = [candidate for candidate, miss in misses.items() if miss <= MAX_EQUAL_RATIO * best]
    least = min(_deviation_rank(*candidate) for candidate in alike)
    plain = [candidate for candidate in alike if _deviation_rank(*candidate) == least]
    unit, axes = min(plain, key=lambda candidate: misses[candidate])
    return MountingFit(axes, unit, recorded / max(misses[unit, axes], 1e-12), len(plain) == 1, turned)


def _deviation_rank(unit: str, axes: Axes) -> int:
    """Rank of a deviation from the recorded unit and axes; a lower rank is simpler.

    1 is another unit or all signs, 2 are other axes, 3 is a mirror image, and 4 are other axes in another unit.
    """
    is_signed = axes.order == (0, 1, 2) and axes.signs in ((1, 1, 1), (-1, -1, -1))
    if unit != RAD_S:
        return 1 if is_signed else 4
    return 1 if is_signed else 3 if axes.is_mirror else 2


def _rms_residuals(design: Floats, targets: Floats) -> Floats:
    """(K,) root mean square residuals of (M, K) targets after a linear fit of a (M, k) design."""
    fitted = design @ np.linalg.lstsq(design, targets, rcond=1e-6)[0]
    left: Floats = np.sqrt(np.mean((targets - fitted) ** 2, axis=0))
    return left


def _to_unit_sphere(field: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 3) readings mapped to about the unit sphere by an ellipsoid."""
    seen: Floats = np.linalg.solve(ellipsoid.shape, (field - ellipsoid.centre).T).T
    return seen


def _segments(samples: Samples, ellipsoid: Ellipsoid) -> tuple[Floats, Floats, Floats, Floats]:
    """Divide a recording into W intervals of n time steps.

    Returns the (W, 3) readings at the beginning and at the end of each interval, the (W, n, 3) rates in it, and its
    (W, n) time steps.
    """
    segments: tuple[Floats, Floats, Floats, Floats] = (
        np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 1, 3)), np.empty((0, 1)),
    )  # fmt: skip
    if samples.time is None or samples.rate is None:
        return segments
    for length in INTERVALS_S:
        rows = gyro.window_rows(samples.time, samples.rate, window_s=length)
        rows = rows[:: max(1, -(-len(rows) // MAX_INTERVALS), -(-rows.size // MAX_READINGS))]
        if len(rows) < MIN_INTERVALS:
            continue
        seen = _to_unit_sphere(samples.field[rows[:, [0, -1]].ravel()], ellipsoid).reshape(-1, 2, 3)
        steps = np.diff(samples.time[rows], axis=1)
        interval = np.concatenate([steps, steps[:, -1:]], axis=1)
        segments = seen[:, 0], seen[:, 1], np.nan_to_num(samples.rate[rows]), interval
        if float(np.median(np.linalg.norm(seen[:, 1] - seen[:, 0], axis=1))) >= MIN_MOTION:
            break
    return segments
