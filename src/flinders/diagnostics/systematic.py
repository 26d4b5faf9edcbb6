"""Systematic errors in residuals: a field or iron that changed, and axes that are nonlinear or late.

Drift. An offset that changes steadily, and a field that grows, cause residuals that depend on time and direction,

    s = J δθ + t (n · ḃ + n · S u ġ),      −½ ≤ t ≤ ½ over the recording

plus noise. J δθ is the effect of the nine parameters, ḃ the change of the offset and ġ the relative growth of the field
over the recording. ḃ and ġ are found by least squares together with the nine parameters, and compared with their
scatter by chance, by the correlated residuals that remain. If a sensor is turned from pole to pole along a spiral, time
and direction are not independent. Combinations that only noise could distinguish are then left out
(`flinders.likelihood.identifiability`).

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(1000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> field = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> field[:, 0] += np.linspace(-2.0, 2.0, 1000)
>>> drift = drift_of(field, Ellipsoid(np.zeros(3), 50.0 * np.eye(3)))
>>> round(drift.offset[0], 1), round(drift.heading_deg, -1), drift.p_value < 0.001
(4.0, 10.0, True)

Nonlinear axes. Let t be the linear reading of an axis from the centre, and r the radius of the ellipsoid. A nonlinear
axis adds r q (t/r)² + r c (t/r)³ to the reading. This causes residuals that fit no ellipsoid, and moves offset and
matrix. Axes are nonlinear near the end of a sensor's range, or in a strong field of the vehicle. q and c of the three
axes are found by least squares together with the nine parameters, weighted by the noise of the fit, including slow
noise (`nonlinearity.c`).

>>> field = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> field[:, 0] += 0.03 * 50.0 * directions[:, 0] ** 2
>>> nonlinearity = nonlinearity_in(engine().fit(field))
>>> round(nonlinearity.quadratic[0], 2), round(nonlinearity.heading_deg), nonlinearity.is_proven
(0.03, 2, True)
>>> nonlinearity.axis, f"{nonlinearity.share:.0%}"
('x', '3%')

A fit with `linearize` corrects such axes: `flinders.fitting.linearization`.

Lags. An axis that is read later than the others has, while the sensor turns, an error of its rate of change times the
lag, which moves offset and matrix. The lags minus their mean are found in the same way, together with the nine
parameters (`lag.c`). A lag common to all axes causes no residual and no error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.findings.words import axis_lag
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records

MAX_P_VALUE: Final = 1e-4
"""Largest p-value of proven nonlinear or late axes; fewer than one of a thousand recordings have it by chance."""

MAX_LIKELY_P_VALUE: Final = 0.01
"""Largest p-value of nonlinear axes that are corrected on request."""


@dataclass(frozen=True, slots=True)
class Drift:
    """A steady change over a recording, from its beginning to its end."""

    offset: tuple[float, float, float]  # (3,): change of the offset, in the unit of the readings
    strength: float  # change of the field strength, as a fraction of it
    heading_deg: float  # worst level heading error from the change of the offset
    p_value: float  # probability of a change as large by chance
    # ratio of the heading difference between the halves of the recording, at the worst heading, to its claimed 1 σ;
    # None unless the change is proven and below the target
    halves_ratio: float | None = None


def drift_of(readings: Floats, ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> Drift | None:
    """Steady change in (N, 3) readings, in the order of recording; None if it cannot be determined."""
    return drift_in(engine().drift(readings, ellipsoid.centre, ellipsoid.shape, dip_deg=dip_deg))


def drift_in(record: Records) -> Drift | None:
    """Steady change in a record of the engine; None if it has none."""
    if math.isnan(record["drift_deg"]):
        return None
    return Drift(
        offset=tuple(record["drift_offset"].tolist()),
        strength=float(record["drift_strength"]),
        heading_deg=float(record["drift_deg"]),
        p_value=float(record["drift_by_chance"]),
    )


@dataclass(frozen=True, slots=True)
class Nonlinearity:
    """Quadratic and cubic terms of the axes."""

    # (3,): error of each axis from the quadratic term with the field along the axis, as a fraction of the field
    quadratic: tuple[float, float, float]
    cubic: tuple[float, float, float]  # (3,): error of each axis from the cubic term, as a fraction of the field
    heading_deg: float  # worst level heading error from the terms; if they are corrected, the remaining error, 1 σ
    p_value: float  # probability of terms as large by chance
    is_corrected: bool = False  # whether the calibration linearizes the axes

    @property
    def is_proven(self) -> bool:
        """Whether the terms are significant."""
        return self.p_value < MAX_P_VALUE

    @property
    def is_likely(self) -> bool:
        """Whether the terms are unlikely by chance, which is sufficient for a requested correction."""
        return self.p_value < MAX_LIKELY_P_VALUE

    @property
    def axis(self) -> str:
        """The axis with the largest terms."""
        return "xyz"[int(np.argmax(self._sizes))]

    @property
    def share(self) -> float:
        """Largest error of a reading of `axis` between ± the field strength, as a fraction of the field."""
        return max(self._sizes)

    @property
    def _sizes(self) -> tuple[float, ...]:
        return tuple(abs(q) + abs(c) for q, c in zip(self.quadratic, self.cubic, strict=True))


def nonlinearity_in(record: Records) -> Nonlinearity | None:
    """Nonlinear terms in a record of the engine; None if it has none."""
    if math.isnan(record["nonlinear_deg"]):
        return None
    terms = record["nonlinearity"].tolist()
    return Nonlinearity(
        quadratic=tuple(terms[:3]),
        cubic=tuple(terms[3:]),
        heading_deg=float(record["nonlinear_deg"]),
        p_value=float(record["nonlinear_by_chance"]),
    )


@dataclass(frozen=True, slots=True)
class AxisLag:
    """Delay of each axis."""

    # (3,): lags of x, y and z minus their mean, in s, or in readings if the recording has no times
    lags: tuple[float, float, float]
    is_timed: bool  # whether `lags` are in s
    heading_deg: float  # worst level heading error from the lags, of a vehicle at rest
    p_value: float  # probability of lags as large by chance
    is_corrected: ClassVar[bool] = False  # a calibration cannot correct lags, as it does not get the rate of rotation

    @property
    def is_proven(self) -> bool:
        """Whether the lags are significant."""
        return self.p_value < MAX_P_VALUE

    @property
    def axis(self) -> str:
        """The axis that differs most from the other two."""
        return "xyz"[self._place]

    @property
    def lag(self) -> float:
        """Delay of `axis` behind the mean of the other two, in s or in readings."""
        return 1.5 * self.lags[self._place]

    @property
    def _place(self) -> int:
        return int(np.argmax(np.abs(self.lags)))

    def __str__(self) -> str:
        """Sentence on the axis that differs most from the other two, with its lag.

        >>> str(AxisLag((0.02, -0.01, -0.01), True, 0.8, 0.0)), str(AxisLag((0.4, 0.3, -0.7), False, 0.8, 0.0))
        ('axis x is read 30 ms later than the others', 'axis z is read 1.05 readings earlier than the others')
        """
        return axis_lag(self.axis, self.lag, self.is_timed)


def lag_in(record: Records) -> AxisLag | None:
    """Lags of axes in a record of the engine; None if it has none."""
    if math.isnan(record["lag_deg"]):
        return None
    return AxisLag(
        lags=tuple(record["axis_lag"].tolist()),
        is_timed=not math.isnan(record["start"]),
        heading_deg=float(record["lag_deg"]),
        p_value=float(record["lag_by_chance"]),
    )
