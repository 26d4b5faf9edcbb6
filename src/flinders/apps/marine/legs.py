"""Deviations from a log under way: on straight legs or while turning, relative to a heading or a course over ground.

A course is not a heading. Over ground a boat moves with v = s (sin h, cos h) + u, with speed s and heading h through
the water, and current u. The current follows from the speeds on legs all round, since |v − u| = s on each. The course
through the water, the direction of v − u, still differs from the heading by leeway, for which there is only a prior:
`CRAB_DEG`. Errors of u and of leeway are the same on all legs, so that residuals do not show them. They change B and C,
and are stated as a covariance of B and C.

>>> rng, around = np.random.default_rng(1), np.repeat(np.arange(0.0, 360.0, 45.0), 60)
>>> velocity = 3.0 * np.exp(1j * np.deg2rad(around)) + (0.3 + 0.2j)             # north + i east, m/s
>>> course, speed = np.rad2deg(np.angle(velocity)), np.abs(velocity)
>>> swing = legs(np.arange(480.0), around + rng.normal(0.0, 0.5, 480), course, speed, is_course=True)
>>> abs(swing.current - (0.3 + 0.2j)) < 0.01, len(swing.compass_deg), float(np.abs(swing.deviation_deg).max()) < 0.5
(True, 8, True)

While a vehicle turns, a compass with a lag τ is behind by τ times the rate, with opposite signs for the two directions.
If the vehicle turns in both directions, τ is estimated from the readings. For one direction the effect of a lag is that
of A: with the prior 0 ± `LAG_S`, it is part of the uncertainty of A.

>>> time = np.arange(0.0, 480.0, 0.5)
>>> heading = np.where(time < 240.0, 1.5 * time, 720.0 - 1.5 * time)
>>> lagged = np.interp(time - 0.6, time, heading)
>>> swing = turn_readings(time, lagged % 360.0, (heading + 2.0) % 360.0)
>>> float(np.abs(swing.deviation_deg - 2.0).max()) < 0.1, str(swing.notes[0])[:24]
(True, 'the compass lags by 0.60')
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.apps.marine.deviation import MIN_HEADINGS, NAMES
from flinders.apps.marine.swing_notes import SwingNote
from flinders.errors import FitError, count_text
from flinders.geometry.angles import mean_deg, wrap_180, wrap_360
from flinders.geometry.ellipsoid import sphere_through
from flinders.heading.harmonics import design
from flinders.heading.stationary import rests

if TYPE_CHECKING:
    from typing import TypeAlias

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.workflows.notes import Note

    Complexes: TypeAlias = NDArray[np.complex128]
    from collections.abc import Sequence

MIN_LEG_S: Final = 20.0
"""Shortest leg, in s."""
SMOOTH_S: Final = 10.0
"""Window in s over which a heading is averaged to find legs, so that waves and steering do not count as turns."""
MIN_SPEED_M_S: Final = 2.0
"""Smallest speed over ground at which a course is used, in m/s: four knots."""
CRAB_DEG: Final = 1.0
"""Difference of course and heading by leeway, 1 σ in degrees."""
SPEED_SHARE: Final = 0.02
"""Smallest variation of the speed through the water from leg to leg, 1 σ, as a share of the speed."""
BLOCKS: Final = 8
"""Number of parts into which a leg is divided; their scatter gives the uncertainty of the leg's mean."""


@dataclass(frozen=True, slots=True, eq=False)
class LoggedSwing:
    """Readings of a swing from a log, and the covariance of their common error."""

    compass_deg: Floats  #: (N,) degrees: headings by the compass
    deviation_deg: Floats  #: (N,) degrees: deviations there
    sigma_deg: Floats  #: (N,) degrees: 1 σ of each deviation
    seconds: Floats  #: (N,) s: duration of each reading
    common_covariance: Floats  #: (5, 5) degrees²: covariance of A to E from errors that all readings share
    notes: tuple[Note, ...] = ()  #: corrections that were made, and assumptions
    current: complex | None = None  #: north + i east by magnetic north, m/s, if it was removed
    is_steady: bool = True  #: whether readings are from straight legs, not from turns

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        arrays = ("compass_deg", "deviation_deg", "sigma_deg", "seconds", "common_covariance")
        current = None if self.current is None else [self.current.real, self.current.imag]
        return {
            **{name: getattr(self, name).tolist() for name in arrays},
            "notes": [str(note) for note in self.notes],
            "current_m_s": current,  # north and east by magnetic north, if it was removed
            "is_steady": self.is_steady,
        }


def legs(
    time: Floats,
    compass_deg: Floats,
    reference_deg: Floats,
    speed: Floats,
    *,
    is_course: bool,
    least_s: float = MIN_LEG_S,
    slowest: float = MIN_SPEED_M_S,
    crab_deg: float = CRAB_DEG,
) -> LoggedSwing:
    """Take a reading from each straight leg of a log.

    Raises `FitError` for fewer than five legs.

    Parameters
    ----------
    time, compass_deg, reference_deg, speed : (N,)
        s, degrees, magnetic degrees and m/s; NaN for a missing reference or speed.
    is_course : bool
        Whether the reference is a course over ground.
    least_s : float, s
        Shortest leg.
    slowest : float, m/s
        Smallest speed over ground of a leg, for courses.
    crab_deg : float, degrees
        1 σ of leeway, for courses.
    """
    step = float(np.median(np.diff(time)))
    spans = _spans(compass_deg, step, least_s)
    unit: Complexes = np.exp(1j * np.deg2rad(reference_deg))
    velocity = unit * speed if is_course else unit
    taken = [span for span in spans if _is_sound(velocity[span], slowest if is_course else 0.0)]
    _refuse_few(len(taken), len(spans), is_course=is_course, least_s=least_s, slowest=slowest)
    means = np.array([np.nanmean(velocity[span]) for span in taken])
    current, covariance = _current(means) if is_course else (None, np.zeros((2, 2)))
    through = velocity - (current or 0.0)
    rows = [_reading(compass_deg[span], through[span]) for span in taken]
    common = np.zeros((len(NAMES), len(NAMES)))
    if is_course:
        common[1:3, 1:3] = covariance + crab_deg**2 * np.eye(2)
    seconds = np.array([float(time[span.stop - 1] - time[span.start]) for span in taken])
    compass, deviation, sigma = np.array(rows).T
    return LoggedSwing(compass, deviation, sigma, seconds, common, _course_notes(current, crab_deg), current)


def _spans(compass_deg: Floats, step: float, least_s: float) -> list[slice]:
    """Stretches of constant smoothed heading; their ends, which smoothing mixes with turns, are left out."""
    width = max(round(SMOOTH_S / step), 1)
    smooth = np.convolve(np.exp(1j * np.deg2rad(compass_deg)), np.ones(width) / width, "same")
    least = max(round(least_s / step), 1)
    steady = rests(wrap_360(np.rad2deg(np.angle(smooth))), least_readings=max(least, 8))
    edge = min(width // 2, least // 4)
    return [slice(rest.start + edge, rest.stop - edge) for rest in steady if rest.stop - rest.start > 2 * edge + BLOCKS]


def _is_sound(velocity: Complexes, slowest: float) -> bool:
    """Whether most of a leg has a reference, and its mean speed is sufficient."""
    is_known = np.isfinite(velocity)
    return bool(is_known.mean() > 0.5 and abs(velocity[is_known].mean()) >= slowest)


def _current(means: Complexes) -> tuple[complex, Floats]:
    """Current from the velocities of legs, and (2, 2) covariance of B and C from its uncertainty, degrees².

    |v|² = 2 u·v + (s² − |u|²) is linear in u and in the constant s² − |u|². The uncertainty comes from the scatter of s
    over the legs.
    """
    (up, right), radius = sphere_through(np.column_stack([means.real, means.imag]))
    through = max(radius, 1e-6)
    relative = means - complex(up, right)
    unit = relative / np.abs(relative)
    freedom = max(len(means) - 3, 1)
    scatter = float(np.sqrt(np.sum((np.abs(relative) - through) ** 2) / freedom))
    design = np.column_stack([unit.real, unit.imag, np.ones(len(means))])
    inverse = np.linalg.pinv(design.T @ design)[:2, :2]
    covariance = max(scatter / through, SPEED_SHARE) ** 2 * inverse  # of u/s, north and east
    turn = np.array([[1.0, 0.0], [0.0, -1.0]])  # u north adds −sin h, u east cos h to course less heading
    return complex(up, right), np.rad2deg(1.0) ** 2 * turn @ covariance @ turn


def _reading(compass_deg: Floats, velocity: Complexes) -> tuple[float, float, float]:
    """Mean compass heading, deviation and 1 σ of the deviation of one leg, in degrees."""
    is_known = np.isfinite(velocity)
    compass, course = compass_deg[is_known], velocity[is_known]
    middle = mean_deg(compass)
    off = course * np.exp(-1j * np.deg2rad(compass))
    parts = np.array([np.angle(part.sum()) for part in np.array_split(off, min(BLOCKS, len(off)))])
    sigma = float(np.std(np.rad2deg(parts), ddof=1) / len(parts) ** 0.5)
    return middle, float(np.rad2deg(np.angle(off.sum()))), max(sigma, 0.01)


def _course_notes(current: complex | None, crab_deg: float) -> tuple[SwingNote, ...]:
    """Notes about the current that was removed, and the assumed leeway."""
    if current is None:
        return ()
    towards = float(wrap_360(np.rad2deg(np.angle(current))))
    drift = SwingNote("current", values={"speed": abs(current), "towards_deg": towards})
    return drift, SwingNote("leeway", values={"crab_deg": crab_deg})


def _refuse_few(legs: int, steady: int, *, is_course: bool, least_s: float, slowest: float) -> None:
    """Refuse a log with fewer usable legs than coefficients."""
    if legs >= MIN_HEADINGS:
        return
    speed = f" at {slowest:g} m/s or more" if is_course else ""
    raise FitError(
        f"found {count_text(steady, 'straight leg')} of {least_s:g} s, of which {legs} have a reference{speed}; five "
        f"coefficients need {MIN_HEADINGS}: steer eight headings, each 45° from the last, for half a minute each",
        found=legs,
        needed=MIN_HEADINGS,
    )


SECTOR_DEG: Final = 15.0
"""Width of a sector in degrees; a reading is the mean while the compass passes one sector."""
LAG_S: Final = 1.0
"""Prior of the lag, 1 σ in s."""
MIN_READINGS: Final = 3
"""Smallest number of readings in a sector."""
ITERATIONS: Final = 4
"""Iterations until lag and scatter have converged."""
MIN_SCATTER_DEG: Final = 0.01
"""Smallest scatter of a reading that is assumed, in degrees."""


def turn_readings(time: Floats, compass_deg: Floats, heading_deg: Floats) -> LoggedSwing:
    """Take a reading from each sector that the compass passes while turning, and correct the readings for the lag.

    Raises `FitError` for fewer than five passes.

    Parameters
    ----------
    time, compass_deg, heading_deg : (N,)
        s, degrees by the compass, and magnetic degrees by the other instrument; NaN for a missing heading.
    """
    is_known = np.isfinite(heading_deg)
    time, compass, heading = time[is_known], compass_deg[is_known], heading_deg[is_known]
    passes = _passes(compass)
    if len(passes) < MIN_HEADINGS:
        raise FitError(
            f"the compass passed {len(passes)} sectors of {SECTOR_DEG:g}° with a reference heading, and five "
            "coefficients need a whole circle: turn slowly all round, once each way",
            found=len(passes),
            needed=MIN_HEADINGS,
        )
    around = np.rad2deg(np.unwrap(np.deg2rad(heading)))
    rows = _Rows.of(time, compass, around, passes)
    lag, variance, scatter = 0.0, LAG_S**2, MIN_SCATTER_DEG
    for _ in range(ITERATIONS if rows.is_both_ways else 0):
        step, variance, scatter = rows.lag(lag)
        lag += step
        rows = _Rows.of(time, compass, np.interp(time - lag, time, around), passes)
    along = np.linalg.lstsq(design(rows.compass_deg), rows.rate, rcond=None)[0]
    return LoggedSwing(
        rows.compass_deg,
        rows.deviation_deg,
        np.full(len(passes), scatter),
        np.array([float(time[part.stop - 1] - time[part.start]) for part in passes]),
        variance * np.outer(along, along),
        (SwingNote("lag" if rows.is_both_ways else "one-way", values={"lag_s": lag, "sigma_s": variance**0.5}),),
        is_steady=False,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Readings of N passes: compass headings and deviations in degrees, and mean rates in degrees per second."""

    compass_deg: Floats
    deviation_deg: Floats
    rate: Floats

    @classmethod
    def of(cls, time: Floats, compass_deg: Floats, heading_deg: Floats, passes: Sequence[slice]) -> Self:
        """Mean values of each pass; `heading_deg` is continuous, without jumps at 360°."""
        off = wrap_180(heading_deg - compass_deg)
        ends = [(part.start, part.stop - 1) for part in passes]
        return cls(
            np.array([mean_deg(compass_deg[part]) for part in passes]),
            wrap_180([mean_deg(off[part]) for part in passes]),
            np.array([(heading_deg[last] - heading_deg[first]) / (time[last] - time[first]) for first, last in ends]),
        )

    @property
    def is_both_ways(self) -> bool:
        """Whether there are enough sectors in each direction of turning."""
        return min(int(np.sum(self.rate > 0.0)), int(np.sum(self.rate < 0.0))) >= MIN_HEADINGS

    def lag(self, known: float) -> tuple[float, float, float]:
        """Lag in s that remains after a correction by `known`, its variance, and scatter of a reading in degrees."""
        rows, scatter = np.column_stack([design(self.compass_deg), self.rate]), 1.0
        for _ in range(ITERATIONS):
            prior = scatter / LAG_S
            weighted = np.vstack([rows, [0.0] * MIN_HEADINGS + [prior]])
            solution = np.linalg.lstsq(weighted, np.append(self.deviation_deg, -prior * known), rcond=None)[0]
            residual = self.deviation_deg - rows @ solution
            scatter = max(float(np.sqrt(np.sum(residual**2) / max(len(rows) - MIN_HEADINGS, 1))), MIN_SCATTER_DEG)
        inverse = np.linalg.pinv(weighted.T @ weighted)
        return float(solution[-1]), scatter**2 * float(inverse[-1, -1]), scatter


def _passes(compass_deg: Floats) -> list[slice]:
    """Find the passes of the compass through a sector each, as slices."""
    edges = np.flatnonzero(np.diff(np.floor(compass_deg / SECTOR_DEG), prepend=-1.0, append=-1.0)).tolist()
    return [slice(start, stop) for start, stop in pairwise(edges) if stop - start >= MIN_READINGS]
