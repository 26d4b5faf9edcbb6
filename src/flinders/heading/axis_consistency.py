"""Whether an accelerometer and a magnetometer have the same axes, seen in the dip of the field.

However a sensor is turned, field and vertical keep their angle: ``m · down = sin I``. If an axis of one of them is
swapped or has the wrong sign, the angle wanders with the attitude, and of the 48 ways to swap axes and signs one brings
it to rest. All of them are judged by the sums of the nine products m_i f_j and of their squares, which add.

The opposite sign of all three axes leaves the angle at rest and turns the dip over: it is seen where the sign of the
site's dip is known. Where both sensors are left-handed in the same way, neither angle nor dip shows it.

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

from flinders.arrays import table
from flinders.core.axes import EXCHANGES, Axes
from flinders.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.errors import Hint

ENOUGH: Final = 100
"""Readings at rest from which on axes are judged."""

STILL: Final = 0.1
"""An acceleration whose length differs from gravity's by no more than this share is taken to be gravity alone."""

WANDERS: Final = 0.15
"""Scatter of sin I from which on the axes are doubted: a full tumble with mistaken axes gives about 0.4 to 0.6."""

FOREIGN: Final = 0.3
"""Scatter of sin I from which on an accelerometer never changes, or is that of another body, whatever its axes; turns
of an aircraft make 0.14."""

CLEARER: Final = 3.0
"""So many times less must it scatter with the axes that are right."""

TIED: Final = 1.5
"""Axes whose scatter is within this factor of the least cannot be told apart."""

TELLING: Final = 0.2
"""sin I beyond which its sign counts."""


def _moved(axes: Axes) -> int:
    """How many axes come from elsewhere, and how many signs change."""
    return 2 * sum(index != place for place, index in enumerate(axes.order)) + sum(sign < 0 for sign in axes.signs)


OPPOSITE: Final = "-x,-y,-z"
"""What turns gravity into specific force."""

EVERY: Final = tuple(sorted(EXCHANGES, key=lambda axes: (axes.is_mirror and str(axes) != OPPOSITE, _moved(axes))))
"""All 48 ways to exchange axes and signs, those that change least first; a rotation before its mirror image."""


class ForeignAxes(InputError):
    """Accelerometer and magnetometer do not share their axes (`axes`: those that fit; `scatter_deg`, `fitting_deg`)."""

    code = "foreign-axes"

    def __init__(self, message: str, *, axes: Axes, scatter_deg: float, fitting_deg: float, hint: Hint) -> None:
        self.axes, self.scatter_deg, self.fitting_deg = axes, scatter_deg, fitting_deg
        super().__init__(message, hint=hint, axes=str(axes), scatter_deg=scatter_deg, fitting_deg=fitting_deg)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Sums of products of field and specific force, from which each way to swap axes is judged."""

    readings: int = 0  # in which the acceleration was that of gravity
    total: Floats | None = None  # (9,) of u = m f, row by row, both of length one
    squares: Floats | None = None  # (9, 9) of u uᵀ

    @classmethod
    def of(cls, field: ArrayLike, specific_force: ArrayLike, *, gravity: float | None = None) -> Self:
        """Add up readings.

        Parameters
        ----------
        field : (N, 3)
            Corrected.
        specific_force : (N, 3)
            In what are taken to be the same axes.
        gravity : float, optional
            Length of the specific force at rest, in its own unit; by default its median. Readings that are off by more
            than a tenth are left out: the sensor was shaken.
        """
        m, f = table(field, finite=False), table(specific_force, "specific_force", finite=False)
        with np.errstate(over="ignore", invalid="ignore"):
            length, strength = np.linalg.norm(f, axis=1), np.linalg.norm(m, axis=1)
            usual = (usual_length(f) if gravity is None else gravity) or 0.0
            still = (np.abs(length - usual) <= STILL * usual) & (length > 0.0) & (strength > 0.0)
        m, f = m[still] / strength[still, np.newaxis], f[still] / length[still, np.newaxis]
        products = (m[:, :, np.newaxis] * f[:, np.newaxis, :]).reshape(-1, 9)
        return cls(len(products), products.sum(axis=0), products.T @ products)

    def __add__(self, other: Frames) -> Frames:
        if self.total is None or self.squares is None:
            return other
        if other.total is None or other.squares is None:
            return self
        return Frames(self.readings + other.readings, self.total + other.total, self.squares + other.squares)

    def dip(self, axes: Axes = EVERY[0]) -> tuple[float, float]:
        """Mean of sin I and its scatter, had the acceleration these axes; NaN without readings.

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
        """Mean dip and its scatter as the axes are, in degrees."""
        mean, scatter = self.dip()
        return float(np.rad2deg(np.arcsin(np.clip(mean, -1.0, 1.0)))), self._in_degrees(mean, scatter)

    def _in_degrees(self, mean: float, scatter: float) -> float:
        return float(np.rad2deg(scatter / max((1.0 - mean**2) ** 0.5, scatter, 1e-9)))

    def fitting(self, sign: float = 0.0, *, applied: Axes = EVERY[0]) -> tuple[Axes, ...]:
        """The axes of the acceleration that fit the readings, those that change least first; alone where it is clear.

        `sign` is that of the site's dip; where it is not known, 0, the axes are taken to be right-handed. Where taking
        back how the acceleration was turned before, `applied`, fits, whatever its hand, that comes first.
        """
        seen = [(axes, *self.dip(axes)) for axes in EVERY]
        back = next(axes for axes in EVERY if after(axes, applied) == EVERY[0])
        allowed = [one for one in seen if (one[1] * sign > 0.0 if sign else not one[0].is_mirror or one[0] == back)]
        if not allowed:
            return ()
        limit = max(TIED * min(scatter for _, _, scatter in allowed), WANDERS / CLEARER / TIED)
        fits = [axes for axes, _, scatter in allowed if scatter <= limit]
        if back not in fits:
            return tuple(fits)
        turned_over = after(Axes.of(OPPOSITE), back)  # fits as well, and is no other attitude
        return (back, *(axes for axes in fits if axes not in (back, turned_over)))

    @property
    def is_foreign(self) -> bool:
        """The dip follows the attitude as far as with an accelerometer of another body, or one that never changes."""
        return self.readings >= ENOUGH and self.dip()[1] > FOREIGN

    def refuse_foreign(self, *, site_dip_deg: float | None = None, applied: Axes = EVERY[0]) -> None:
        """Refuse axes that do not fit each other, and name those that do; `ForeignAxes` where the mistake is plain.

        The sign of `site_dip_deg`, the inclination at the site, tells specific force from gravity. The acceleration was
        turned by `applied` before, and what is named is to take its place.
        """
        if self.readings < ENOUGH:
            return
        mean, scatter = self.dip()
        site = 0.0 if site_dip_deg is None else float(np.sin(np.deg2rad(site_dip_deg)))
        sign = float(np.sign(site)) if abs(site) > TELLING else 0.0
        upended = mean * sign < 0.0 and abs(mean) > max(TELLING, scatter)
        fitting = self.fitting(sign, applied=applied)
        best = self.dip(fitting[0])[1] if fitting else scatter
        wanders = scatter > WANDERS and best < scatter / CLEARER
        if not (fitting and fitting[0] != EVERY[0] and (upended or wanders)):
            return
        scatter_deg = self._in_degrees(mean, scatter)
        evidence = (
            f"the dip of the field wanders by {scatter_deg:.0f}° (rms) with the attitude"
            if wanders
            else f"the field is seen to dip by {self.dip_deg[0]:.0f}°, where the site has {site_dip_deg:.0f}°"
        )
        advice, hint = _advice([after(axes, applied) for axes in fitting])
        raise ForeignAxes(
            f"accelerometer and magnetometer do not share their axes: {evidence}; {advice}",
            axes=after(fitting[0], applied),
            hint=hint,
            scatter_deg=scatter_deg,
            fitting_deg=self._in_degrees(self.dip(fitting[0])[0], best),
        )


def usual_length(force: Floats) -> float | None:
    """Median length of (N, 3) vectors, of those that are finite; None where none is."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(force, axis=1)
    finite = length[np.isfinite(length)]
    return float(np.median(finite)) if len(finite) else None


def _advice(fitting: Sequence[Axes]) -> tuple[str, Hint]:
    """Say what is wrong with the axes and what to do, with the hint that maps those of the acceleration.

    `fitting`: mappings of the acceleration with which it fits, the best first.

    >>> _advice([Axes.of("y,x,-z")])
    ('its x and y are swapped, and its z has the wrong sign: map its axes', {'acceleration_axes': 'y,x,-z'})
    """
    mistake, *others = fitting
    hint: dict[str, object] = {"acceleration_axes": None if mistake == EVERY[0] else str(mistake)}
    advice = "as they were recorded they do: leave their mapping out"
    if mistake != EVERY[0]:
        advice = f"{_named(mistake)}: map its axes"
    if mistake.is_mirror and str(mistake) != OPPOSITE:
        advice += (
            "; one of the two is left-handed, and if that is the magnetometer, map that one's axes and calibrate again"
        )
        hint["axes"] = None
    if others:
        names = " or ".join(map(str, others[:2]))
        advice += (
            f"; or {names}{' and others' if len(others) > 2 else ''}, "
            "which these attitudes do not tell apart: turn the sensor about more axes"
        )
    return advice, hint


def _named(axes: Axes) -> str:
    """Say how the acceleration differs from the axes that it should have.

    >>> _named(Axes.of("-x,-y,-z")), _named(Axes.of("y,x,-z"))
    ('the acceleration has the opposite sign (gravity, not specific force)', \
'its x and y are swapped, and its z has the wrong sign')
    """
    names = "xyz"
    moved = [names[place] for place, index in enumerate(axes.order) if index != place]
    wrong = sorted(names[index] for index, sign in zip(axes.order, axes.signs, strict=True) if sign < 0)
    parts = []
    if moved:
        parts.append(f"its {' and '.join(moved)} are swapped" if len(moved) == 2 else "its x, y and z go round")
    if len(wrong) == 3:
        parts.insert(0, "the acceleration has the opposite sign (gravity, not specific force)")
    elif wrong:
        parts.append(f"its {' and '.join(wrong)} {'have' if len(wrong) > 1 else 'has'} the wrong sign")
    return ", and ".join(parts)


def after(axes: Axes, applied: Axes) -> Axes:
    """One mapping in place of two, of which `applied` was the first."""
    order = tuple(applied.order[index] for index in axes.order)
    signs = tuple(sign * applied.signs[index] for index, sign in zip(axes.order, axes.signs, strict=True))
    return Axes(order, signs)  # type: ignore[arg-type]
