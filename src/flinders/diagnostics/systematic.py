"""What residuals have in common beside noise: a field or iron that changed, axes that are not linear, or late.

Drift. An offset that creeps and a field that grows leave residuals that depend on time and direction together, as

    s = J δθ + t (n · ḃ + n · S u ġ),      −½ ≤ t ≤ ½ over the recording

beside what noise leaves. ḃ and ġ are found by least squares along with the nine parameters, and compared with the
scatter that the remaining residuals, as they are correlated, would give them by chance. A sensor that is turned from
pole to pole along a spiral has time and direction in one: what only noise tells apart there is left out
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

Axes. An axis that reads r q (t/r)² + r c (t/r)³ too much at t, its linear reading from the centre, r the radius of the
ellipsoid, leaves residuals that no ellipsoid takes off, and moves offset and matrix as well. Near the end of its range,
or in a strong field of the vehicle, a sensor does so. q and c of the three axes are found by least squares along with
the nine parameters, weighted by the noise that the fit has found, slow noise included (`nonlinearity.c`).

>>> field = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> field[:, 0] += 0.03 * 50.0 * directions[:, 0] ** 2
>>> nonlinearity = nonlinearity_in(engine().fit(field))
>>> round(nonlinearity.quadratic[0], 2), round(nonlinearity.heading_deg), nonlinearity.is_proven
(0.03, 2, True)
>>> nonlinearity.axis, f"{nonlinearity.share:.0%}"
('x', '3%')

A fit that was asked to linearizes such axes: `flinders.fitting.linearization`.

Lags. An axis that is read later than the others reads less by its rate of change times that lag while the sensor turns,
which moves offset and matrix. The lags about their mean are found along with the nine parameters in the same way
(`lag.c`); one that all axes have in common leaves no residual, and does no harm.
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

BY_CHANCE: Final = 1e-4
"""Chance below which axes count as not linear, or late: it makes as much in less than one of a thousand recordings."""

HARDLY_BY_CHANCE: Final = 0.01


@dataclass(frozen=True, slots=True)
class Drift:
    """A steady change over a recording, from its beginning to its end."""

    offset: tuple[float, float, float]  # (3,): in the unit of the readings
    strength: float  # of the field, as a fraction of it
    heading_deg: float  # what the change of the offset does to a level heading, at the worst heading
    p_value: float  # how often chance alone makes as much
    # how far the halves of the recording are apart at the worst heading, over what both claim; looked for where the
    # change is proven and below the target
    halves_ratio: float | None = None


def drift_of(readings: Floats, ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> Drift | None:
    """Look for a steady change in (N, 3) readings, in the order of recording; None where nothing can be told of it."""
    return drift_in(engine().drift(readings, ellipsoid.centre, ellipsoid.shape, dip_deg=dip_deg))


def drift_in(record: Records) -> Drift | None:
    """The steady change that a record tells of; None where it tells nothing."""
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

    # (3,): what an axis reads too much where the field lies along it, as a fraction of the field
    quadratic: tuple[float, float, float]
    cubic: tuple[float, float, float]  # (3,): the same of the third power
    heading_deg: float  # what they do to a level heading, at the worst heading; of corrected ones what is left, 1 σ
    p_value: float  # how often chance alone makes as much
    is_corrected: bool = False  # the calibration linearizes the axes

    @property
    def is_proven(self) -> bool:
        """Whether chance does not explain them."""
        return self.p_value < BY_CHANCE

    @property
    def is_likely(self) -> bool:
        """Whether chance hardly explains them, which is enough where somebody asks for their correction."""
        return self.p_value < HARDLY_BY_CHANCE

    @property
    def axis(self) -> str:
        """The axis with the largest terms."""
        return "xyz"[int(np.argmax(self._sizes))]

    @property
    def share(self) -> float:
        """What that axis reads too much at most, over the range from -1 to 1 of the field, a fraction of the field."""
        return max(self._sizes)

    @property
    def _sizes(self) -> tuple[float, ...]:
        return tuple(abs(q) + abs(c) for q, c in zip(self.quadratic, self.cubic, strict=True))


def nonlinearity_in(record: Records) -> Nonlinearity | None:
    """The terms that a record tells of; None where it tells nothing."""
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
    """How late each axis is read."""

    # (3,): of x, y and z about their mean: s, or readings where the recording has no times
    lags: tuple[float, float, float]
    is_timed: bool  # whether they are in s
    heading_deg: float  # what they do to a level heading of a vehicle at rest, at the worst heading
    p_value: float  # how often chance alone makes as much
    is_corrected: ClassVar[bool] = False  # by no calibration: it would have to know how fast the sensor turns

    @property
    def is_proven(self) -> bool:
        """Whether chance does not explain them."""
        return self.p_value < BY_CHANCE

    @property
    def axis(self) -> str:
        """The axis that differs most from the other two."""
        return "xyz"[self._place]

    @property
    def apart(self) -> float:
        """How much later that axis is read than the mean of the other two."""
        return 1.5 * self.lags[self._place]

    @property
    def _place(self) -> int:
        return int(np.argmax(np.abs(self.lags)))

    def __str__(self) -> str:
        """The axis that differs most from the other two, and by how much.

        >>> str(AxisLag((0.02, -0.01, -0.01), True, 0.8, 0.0)), str(AxisLag((0.4, 0.3, -0.7), False, 0.8, 0.0))
        ('axis x is read 30 ms later than the others', 'axis z is read 1.05 readings earlier than the others')
        """
        return axis_lag(self.axis, self.apart, self.is_timed)


def lag_in(record: Records) -> AxisLag | None:
    """The lags of axes that a record tells of; None where it tells nothing."""
    if math.isnan(record["lag_deg"]):
        return None
    return AxisLag(
        lags=tuple(record["axis_lag"].tolist()),
        is_timed=not math.isnan(record["start"]),
        heading_deg=float(record["lag_deg"]),
        p_value=float(record["lag_by_chance"]),
    )
