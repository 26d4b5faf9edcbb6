"""Test whether an accelerometer and a magnetometer have the same axes, by the dip of the field.

The angle between field and vertical is the same at every attitude: ``m · down = sin I``. If axes of one sensor are
swapped, or an axis has the wrong sign, this angle changes with the attitude. One of the 48 ways to swap axes and signs
then makes it constant. All 48 are tested with the same sums: of the nine products m_i f_j and of their squares.

If all three axes have the opposite sign, the angle stays constant and the dip is negated. This shows only if the sign
of the site's dip is known. If both sensors are left-handed in the same way, neither angle nor dip shows it.

>>> rng = np.random.default_rng(1)
>>> turns = np.linalg.qr(rng.standard_normal((500, 3, 3)))[0]
>>> turns *= np.linalg.det(turns)[:, np.newaxis, np.newaxis]                          # 500 attitudes, at a dip of 60°
>>> field, force = turns @ [0.5, 0.0, 0.75**0.5], turns @ [0.0, 0.0, -9.81]
>>> sound, mistaken = Frames.of(field, force), Frames.of(field, force[:, [1, 0, 2]] * [1, 1, -1])
>>> [round(angle, 1) for angle in sound.dip_deg], str(mistaken.fitting()[0])
([60.0, 0.0], 'y,x,-z')
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import check_table
from flinders.core.axes import SIGNED_PERMUTATIONS, Axes
from flinders.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.errors import Hint

MIN_READINGS: Final = 100
"""Smallest count of readings at rest for which axes are judged."""

MAX_GRAVITY_DEVIATION: Final = 0.1
"""Largest difference of an acceleration's length from gravity, as a share, for a sensor at rest."""

MIN_DOUBTED_SCATTER: Final = 0.15
"""Smallest scatter of sin I at which other axes are tried: a full tumble with wrong axes gives about 0.4 to 0.6."""

MIN_FOREIGN_SCATTER: Final = 0.3
"""Smallest scatter of sin I with the best axes that shows an accelerometer that is constant or on another body.

Turns of an aircraft cause 0.14.
"""

MIN_SCATTER_RATIO: Final = 3.0
"""Smallest factor by which the right axes must reduce the scatter."""

MAX_TIED_RATIO: Final = 1.5
"""Largest scatter with axes that cannot be distinguished from the best axes, relative to the scatter with the best."""

MIN_SIGNED_SINE: Final = 0.2
"""Smallest |sin I| at which its sign is used."""


def _change_count(axes: Axes) -> int:
    """Count of exchanged axes plus count of changed signs."""
    return 2 * sum(index != place for place, index in enumerate(axes.order)) + sum(sign < 0 for sign in axes.signs)


ALL_NEGATED: Final = "-x,-y,-z"
"""Axes that convert gravity to specific force."""

ALL_AXES: Final = tuple(
    sorted(SIGNED_PERMUTATIONS, key=lambda axes: (axes.is_mirror and str(axes) != ALL_NEGATED, _change_count(axes)))
)
"""All 48 ways to exchange axes and signs, in the order of increasing change; a rotation before its mirror image."""


class ForeignAxes(InputError):
    """Accelerometer and magnetometer have different axes.

    The attribute `axes` has the axes that match. `scatter_deg` is the scatter of the dip with the given axes,
    `fitting_deg` that with the matching axes.
    """

    code = "foreign-axes"

    def __init__(self, message: str, *, axes: Axes, scatter_deg: float, fitting_deg: float, hint: Hint) -> None:
        self.axes, self.scatter_deg, self.fitting_deg = axes, scatter_deg, fitting_deg
        super().__init__(message, hint=hint, axes=str(axes), scatter_deg=scatter_deg, fitting_deg=fitting_deg)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Sums of products of field and specific force, by which all 48 ways to swap axes and signs are tested."""

    readings: int = 0  # count of readings at rest
    total: Floats | None = None  # (9,) sum of u = m fᵀ, row by row, both of length one
    squares: Floats | None = None  # (9, 9) sum of u uᵀ

    @classmethod
    def of(cls, field: ArrayLike, specific_force: ArrayLike, *, gravity: float | None = None) -> Self:
        """Sum up the products of readings.

        Parameters
        ----------
        field : (N, 3)
            Corrected readings.
        specific_force : (N, 3)
            Readings of the accelerometer; the test is whether their axes are those of the field.
        gravity : float, optional
            Length of the specific force at rest, in its own unit; by default its median. Readings that differ from it
            by more than a tenth are left out, as the sensor was shaken.
        """
        m, f = check_table(field, finite=False), check_table(specific_force, "specific_force", finite=False)
        with np.errstate(over="ignore", invalid="ignore"):
            length, strength = np.linalg.norm(f, axis=1), np.linalg.norm(m, axis=1)
            usual = (median_length(f) if gravity is None else gravity) or 0.0
            still = (np.abs(length - usual) <= MAX_GRAVITY_DEVIATION * usual) & (length > 0.0) & (strength > 0.0)
        m, f = m[still] / strength[still, np.newaxis], f[still] / length[still, np.newaxis]
        products = (m[:, :, np.newaxis] * f[:, np.newaxis, :]).reshape(-1, 9)
        return cls(len(products), products.sum(axis=0), products.T @ products)

    def __add__(self, other: Frames) -> Frames:
        if self.total is None or self.squares is None:
            return other
        if other.total is None or other.squares is None:
            return self
        return Frames(self.readings + other.readings, self.total + other.total, self.squares + other.squares)

    def dip(self, axes: Axes = ALL_AXES[0]) -> tuple[float, float]:
        """Mean and scatter of sin I for given axes of the acceleration; NaN without readings.

        sin I = −m · P f is linear in the products m_i f_j.
        """
        if self.total is None or self.squares is None or self.readings == 0:
            return float("nan"), float("nan")
        row = -axes.apply(np.eye(3)).T.reshape(9)
        mean = float(row @ self.total) / self.readings
        variance = float(row @ self.squares @ row) / self.readings - mean**2
        return mean, max(variance, 0.0) ** 0.5

    @property
    def dip_deg(self) -> tuple[float, float]:
        """Mean dip and its scatter with the recorded axes, in degrees."""
        mean, scatter = self.dip()
        return float(np.rad2deg(np.arcsin(np.clip(mean, -1.0, 1.0)))), self._in_degrees(mean, scatter)

    def _in_degrees(self, mean: float, scatter: float) -> float:
        return float(np.rad2deg(scatter / max((1.0 - mean**2) ** 0.5, scatter, 1e-9)))

    def fitting(self, sign: float = 0.0, *, applied: Axes = ALL_AXES[0]) -> tuple[Axes, ...]:
        """Axes of the acceleration that match the field, the smallest change first; more than one if ambiguous.

        `sign` is the sign of the site's dip; 0 if it is unknown, and right-handed axes are then assumed. `applied` is
        the mapping by which the acceleration was mapped before. If undoing it matches, that result comes first.
        """
        seen = [(axes, *self.dip(axes)) for axes in ALL_AXES]
        back = next(axes for axes in ALL_AXES if composed_axes(axes, applied) == ALL_AXES[0])
        allowed = [one for one in seen if (one[1] * sign > 0.0 if sign else not one[0].is_mirror or one[0] == back)]
        if not allowed:
            return ()
        limit = max(
            MAX_TIED_RATIO * min(scatter for _, _, scatter in allowed),
            MIN_DOUBTED_SCATTER / MIN_SCATTER_RATIO / MAX_TIED_RATIO,
        )
        fits = [axes for axes, _, scatter in allowed if scatter <= limit]
        if back not in fits:
            return tuple(fits)
        turned_over = composed_axes(Axes.of(ALL_NEGATED), back)  # matches as well, and is the same attitude
        return (back, *(axes for axes in fits if axes not in (back, turned_over)))

    @property
    def is_foreign(self) -> bool:
        """Whether the dip scatters as with an accelerometer that is constant or of another body."""
        return self.readings >= MIN_READINGS and self.dip()[1] > MIN_FOREIGN_SCATTER

    def refuse_foreign(self, *, site_dip_deg: float | None = None, applied: Axes = ALL_AXES[0]) -> None:
        """Raise `ForeignAxes`, with the axes that match, if the axes of both sensors clearly differ.

        The sign of `site_dip_deg`, the inclination at the site, distinguishes specific force from gravity. `applied` is
        the mapping by which the acceleration was mapped before; the axes in the error replace it.
        """
        if self.readings < MIN_READINGS:
            return
        mean, scatter = self.dip()
        site = 0.0 if site_dip_deg is None else float(np.sin(np.deg2rad(site_dip_deg)))
        sign = float(np.sign(site)) if abs(site) > MIN_SIGNED_SINE else 0.0
        upended = mean * sign < 0.0 and abs(mean) > max(MIN_SIGNED_SINE, scatter)
        fitting = self.fitting(sign, applied=applied)
        best = self.dip(fitting[0])[1] if fitting else scatter
        wanders = scatter > MIN_DOUBTED_SCATTER and best < scatter / MIN_SCATTER_RATIO
        if not (fitting and fitting[0] != ALL_AXES[0] and (upended or wanders)):
            return
        scatter_deg = self._in_degrees(mean, scatter)
        evidence = (
            f"the dip of the field varies by {scatter_deg:.0f}° (rms) with the attitude"
            if wanders
            else f"the measured dip is {self.dip_deg[0]:.0f}°, that of the site is {site_dip_deg:.0f}°"
        )
        advice, hint = _advice([composed_axes(axes, applied) for axes in fitting])
        raise ForeignAxes(
            f"accelerometer and magnetometer have different axes: {evidence}; {advice}",
            axes=composed_axes(fitting[0], applied),
            hint=hint,
            scatter_deg=scatter_deg,
            fitting_deg=self._in_degrees(self.dip(fitting[0])[0], best),
        )


def median_length(force: Floats) -> float | None:
    """Median length of the finite ones of (N, 3) vectors; None if none is finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(force, axis=1)
    finite = length[np.isfinite(length)]
    return float(np.median(finite)) if len(finite) else None


def _advice(fitting: Sequence[Axes]) -> tuple[str, Hint]:
    """Sentence on the error of the axes and its remedy, and the hint with the mapping of the acceleration.

    `fitting` has the matching mappings of the acceleration, the best first.

    >>> _advice([Axes.of("y,x,-z")])
    ('its x and y are swapped, and its z has the wrong sign: map its axes', {'acceleration_axes': 'y,x,-z'})
    """
    mistake, *others = fitting
    hint: dict[str, object] = {"acceleration_axes": None if mistake == ALL_AXES[0] else str(mistake)}
    advice = "the axes as recorded match: leave their mapping out"
    if mistake != ALL_AXES[0]:
        advice = f"{_difference_words(mistake)}: map its axes"
    if mistake.is_mirror and str(mistake) != ALL_NEGATED:
        advice += "; one of the two is left-handed: if it is the magnetometer, map its axes and calibrate again"
        hint["axes"] = None
    if others:
        names = " or ".join(map(str, others[:2]))
        advice += (
            f"; or {names}{' and others' if len(others) > 2 else ''}, "
            "which cannot be distinguished at these attitudes: turn the sensor about more axes"
        )
    return advice, hint


def _difference_words(axes: Axes) -> str:
    """Words for the difference between the axes of the acceleration and the right ones.

    >>> _difference_words(Axes.of("-x,-y,-z")), _difference_words(Axes.of("y,x,-z"))
    ('the acceleration has the opposite sign (gravity, not specific force)', \
'its x and y are swapped, and its z has the wrong sign')
    """
    names = "xyz"
    moved = [names[place] for place, index in enumerate(axes.order) if index != place]
    wrong = sorted(names[index] for index, sign in zip(axes.order, axes.signs, strict=True) if sign < 0)
    parts = []
    if moved:
        parts.append(
            f"its {' and '.join(moved)} are swapped" if len(moved) == 2 else "its x, y and z are rotated cyclically"
        )
    if len(wrong) == 3:
        parts.insert(0, "the acceleration has the opposite sign (gravity, not specific force)")
    elif wrong:
        parts.append(f"its {' and '.join(wrong)} {'have' if len(wrong) > 1 else 'has'} the wrong sign")
    return ", and ".join(parts)


def composed_axes(axes: Axes, applied: Axes) -> Axes:
    """The mapping that equals `applied` followed by `axes`."""
    order = tuple(applied.order[index] for index in axes.order)
    signs = tuple(sign * applied.signs[index] for index, sign in zip(axes.order, axes.signs, strict=True))
    return Axes(order, signs)  # type: ignore[arg-type]
