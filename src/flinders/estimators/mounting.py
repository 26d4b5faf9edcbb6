"""Whether gyro and accelerometer speak of the body that the magnetometer is on: their unit, their axes, their motion.

Before a term is used it is tried on stretches of the recording: read in each unit in which a rate can be written, and
along each of the 48 ways in which axes can be exchanged or point the other way. What fits many times better than what
was recorded is a mistake in the wiring or the log, and is told. With y = S⁻¹x, of the shape S that the magnetometer
finds by itself, and an unknown offset β,

    D (y₁ − β) = ΔRᵀ D (y₀ − β)        of a gyro, from the beginning of a stretch to its end
    dᵀ D (y − β) = sin I               of an accelerometer, whose vertical is d

are linear in β (and sin I), so that each way D is a small linear fit, and a magnetometer that says nothing of its own
offset does no harm. Stretches are as long as the field takes to move by ten degrees or so: the noise of readings is
less than that.

>>> import dataclasses
>>> from flinders import simulate
>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> flight = simulate.tumble(seed=1, motion="flight", n=1500)
>>> swapped = dataclasses.replace(flight.samples, rate=flight.samples.rate[:, [1, 0, 2]] * [1, 1, -1])
>>> sensor = flight.sensor
>>> mounted = by_rate(swapped, Ellipsoid(sensor.offset, flight.field_strength * sensor.matrix))
>>> str(mounted.axes), mounted.unit, mounted.is_clear
('y,x,-z', 'rad/s', True)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import TURNS, Axes
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import dip, gyro

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples

STRETCHES_S: Final = (0.4, 0.8, 1.6, 3.2, 6.4)
"""How long a body may be followed."""

MOVED: Final = 0.2
"""Chord, of a field of one, by which it should have moved in the middle stretch: eleven degrees."""

MANY: Final = 2000
"""Stretches, or verticals, that are looked at."""

MOST: Final = 12_000
"""Readings in those stretches."""

FEW: Final = 12
"""Fewer of them tell nothing."""

MARGIN: Final = 2.0
"""Times better than what was recorded that another reading of it has to be."""

ALIKE: Final = 1.4
"""Times the smallest residual up to which another way fits as well."""

RAD_S: Final = "rad/s"
SCALES: Final = {
    RAD_S: 1.0,
    "°/s": np.pi / 180.0,
    "mrad/s (or its times are in ms)": 1e-3,
    "m°/s": np.pi / 180e3,
    "rad/s that was taken for °/s": 180.0 / np.pi,
}
"""What a column of rates may be in, and what it is multiplied by to be in rad/s."""

EXPLAINED: Final = 0.5
"""Of how far the field moves: a gyro that is read aright leaves less, and then no other unit is tried."""

REVERSED: Final = Axes(signs=(-1, -1, -1))
"""All signs the other way round."""


@dataclass(frozen=True, slots=True)
class Mounted:
    """What fits best."""

    # take the magnetometer's readings into the axes of the other instrument; a mirror image where one is left-handed
    axes: Axes = field(default_factory=Axes)
    unit: str = RAD_S  # of `SCALES`
    better: float = 1.0  # how many times smaller the residual is than with what was recorded; 1 where that stays
    is_clear: bool = True  # nothing else as simple fits as well
    misses: tuple[float, ...] = ()  # residual of each of `TURNS`, in the recorded unit
    # of how far the field moves, what the best of a gyro leaves; 0 of one that was not looked at, or hardly moved
    left: float = 0.0

    @property
    def is_as_recorded(self) -> bool:
        """Nothing fits much better."""
        return self.better == 1.0

    def allows(self, axes: Axes) -> bool:
        """Whether a way to sit fits about as well as the best; a mirror image as the same with all signs reversed."""
        turn = axes.opposite if axes.is_mirror else axes
        return not self.misses or self.misses[TURNS.index(turn)] <= MARGIN * min(self.misses)


def by_rate(samples: Samples, ellipsoid: Ellipsoid) -> Mounted:
    """In which unit and along which axes a gyro turns the field as it moves; as recorded unless another is far better.

    `samples`: with time and rate; `ellipsoid`: what the magnetometer finds by itself; only its shape is used.
    """
    if samples.rate is None or samples.time is None:
        return Mounted()
    free = _read(samples, ellipsoid)
    if free.left <= EXPLAINED:
        return free
    return min(free, _read(samples, _sphere(samples.field)), key=lambda one: one.left)


def _read(samples: Samples, ellipsoid: Ellipsoid) -> Mounted:
    """What fits best with the shape of one ellipsoid."""
    first, last, rate, interval = _segments(samples, ellipsoid)
    if len(first) < FEW:
        return Mounted()
    still = float(np.sqrt(np.mean(np.sum((last - first) ** 2, axis=1))))
    misses = _missed(first, last, rate, interval, RAD_S)
    if not misses[RAD_S, Axes()] <= min(EXPLAINED * still, MARGIN * min(misses.values())):
        for unit in SCALES:
            misses |= _missed(first, last, rate, interval, unit)
    left = min(misses.values()) / max(still, 1e-300)
    return replace(_simplest(misses), left=left if still > MOVED else 0.0)


def _sphere(field: Floats) -> Ellipsoid:
    """One about readings of which nothing better is known, as where they lie in a plane."""
    middle = field.mean(axis=0)
    return Ellipsoid(middle, float(np.sqrt(np.mean(np.sum((field - middle) ** 2, axis=1)))) * np.eye(3))


def by_vertical(samples: Samples, ellipsoid: Ellipsoid) -> Mounted:
    """Along which axes the field keeps its angle to an accelerometer's vertical; parameters as those of `by_rate`.

    A vertical that points up keeps an angle as well: an accelerometer with all signs reversed is not distinguished.
    """
    if samples.acceleration is None:
        return Mounted()
    down, trust = dip.verticals(samples.acceleration)
    rows = np.flatnonzero(trust > 0.0)
    rows = rows[:: max(1, -(-len(rows) // MANY))]
    if len(rows) < FEW:
        return Mounted()
    weight = np.sqrt(trust[rows] / trust[rows].mean())
    seen = _rounded(samples.field[rows], ellipsoid)
    heights = np.stack([np.einsum("ni,ni->n", down[rows], axes.apply(seen)) for axes in TURNS], axis=1)
    design = np.concatenate([down[rows], np.ones((len(rows), 1))], axis=1)
    left = _left(design * weight[:, np.newaxis], heights * weight[:, np.newaxis])
    return _simplest({(RAD_S, axes): miss for axes, miss in zip(TURNS, left.tolist(), strict=True)})


def second_axis(rate: Floats) -> float:
    """How much a body turns about its second axis, of how much about its first: 0 where all is about one.

    Each rate is compared with the next, so that the gyro's noise counts for nothing.

    `rate`: (N, 3), rad/s, without the gyro's bias, in order.

    >>> second_axis(np.outer(np.linspace(-1, 1, 50), [0.0, 0.0, 1.0]))
    0.0
    """
    about = rate[np.isfinite(rate).all(axis=1)]
    if len(about) < 2:
        return 0.0
    values = np.linalg.eigvalsh(about[:-1].T @ about[1:] + about[1:].T @ about[:-1]).clip(min=0.0)
    return float(np.sqrt(values[1] / max(values[2], 1e-300)))


def _missed(first: Floats, last: Floats, rate: Floats, interval: Floats, unit: str) -> dict[tuple[str, Axes], float]:
    """Root mean square distance of the field from where a gyro says, in one unit and each of the 48 ways."""
    misses: dict[tuple[str, Axes], float] = {}
    for sign in (1, -1):
        turned = gyro.integrated(sign * SCALES[unit] * rate, interval, np.zeros(3)).rotations[:, -1]
        back = np.swapaxes(turned, 1, 2)
        targets = [axes.apply(last) - np.einsum("wij,wj->wi", back, axes.apply(first)) for axes in TURNS]
        design = (np.eye(3) - back).reshape(-1, 3)
        left = np.sqrt(3.0) * _left(design, np.stack(targets, axis=-1).reshape(len(design), -1))
        signed = TURNS if sign > 0 else [axes.opposite for axes in TURNS]
        misses |= {(unit, axes): miss for axes, miss in zip(signed, left.tolist(), strict=True)}
    return misses


def _simplest(misses: dict[tuple[str, Axes], float]) -> Mounted:
    """What was recorded unless something fits far better; then the simplest of what fits as well as the best."""
    recorded, best = misses[RAD_S, Axes()], min(misses.values())
    turned = tuple(misses[RAD_S, axes] for axes in TURNS)
    if recorded <= MARGIN * best:
        return Mounted(misses=turned)
    alike = [candidate for candidate, miss in misses.items() if miss <= ALIKE * best]
    least = min(_steps(*candidate) for candidate in alike)
    plain = [candidate for candidate in alike if _steps(*candidate) == least]
    unit, axes = min(plain, key=lambda candidate: misses[candidate])
    return Mounted(axes, unit, recorded / max(misses[unit, axes], 1e-12), len(plain) == 1, turned)


def _steps(unit: str, axes: Axes) -> int:
    """How far from what was recorded: 1 for a unit or all signs, 2 for other axes, 3 for a mirror, 4 for both."""
    is_signed = axes.order == (0, 1, 2) and axes.signs in ((1, 1, 1), (-1, -1, -1))
    if unit != RAD_S:
        return 1 if is_signed else 4
    return 1 if is_signed else 3 if axes.is_mirror else 2


def _left(design: Floats, targets: Floats) -> Floats:
    """(K,) root mean square of what a linear fit to (M, k) leaves of each of (M, K) columns."""
    fitted = design @ np.linalg.lstsq(design, targets, rcond=1e-6)[0]
    left: Floats = np.sqrt(np.mean((targets - fitted) ** 2, axis=0))
    return left


def _rounded(field: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 3) readings about the ellipsoid's centre, its shape removed."""
    seen: Floats = np.linalg.solve(ellipsoid.shape, (field - ellipsoid.centre).T).T
    return seen


def _segments(samples: Samples, ellipsoid: Ellipsoid) -> tuple[Floats, Floats, Floats, Floats]:
    """Readings (W, 3) at the beginning and the end of stretches, and what the gyro says in between."""
    segments: tuple[Floats, Floats, Floats, Floats] = (
        np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 1, 3)), np.empty((0, 1)),
    )  # fmt: skip
    if samples.time is None or samples.rate is None:
        return segments
    for length in STRETCHES_S:
        rows = gyro.windows(samples.time, samples.rate, window_s=length)
        rows = rows[:: max(1, -(-len(rows) // MANY), -(-rows.size // MOST))]
        if len(rows) < FEW:
            continue
        seen = _rounded(samples.field[rows[:, [0, -1]].ravel()], ellipsoid).reshape(-1, 2, 3)
        steps = np.diff(samples.time[rows], axis=1)
        interval = np.concatenate([steps, steps[:, -1:]], axis=1)
        segments = seen[:, 0], seen[:, 1], np.nan_to_num(samples.rate[rows]), interval
        if float(np.median(np.linalg.norm(seen[:, 1] - seen[:, 0], axis=1))) >= MOVED:
            break
    return segments
