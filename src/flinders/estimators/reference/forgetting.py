"""Forgetting: the consistent ellipsoid of sums in which old readings fade. For a stream whose offset may wander."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, Final, Self

import numpy as np

from flinders.core.samples import BLOCK
from flinders.errors import FitError, TooFewSamples, UsageError
from flinders.estimators.base import Estimate
from flinders.estimators.consistent import adjusted
from flinders.estimators.data import Readings
from flinders.estimators.reference.trace import Convergence, spread_counts
from flinders.estimators.uncertainty import algebraic_covariance
from flinders.summary.cloud import Cloud, keys_of
from flinders.summary.moments import Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.arrays import Floats

SHORTEST: Final = 10.0
"""Readings of memory: with less, fewer readings count than there are unknowns."""

FADED: Final = 1e-9
"""Share of all weight below which a cell of the cloud is let go."""


@dataclass(frozen=True, slots=True)
class Forgetting:
    """General ellipsoid from sums corrected for noise, with weights that fade with age.

    Finds what `Consistent` finds, of the sums ``Σ wᵢ xᵢʲyᵢᵏzᵢˡ`` with wᵢ = exp(−aᵢ/m), where aᵢ is the age of a
    reading, counted in readings after it, and m the memory. The sums are kept recursively: before a reading is added,
    all that is there is multiplied by exp(−1/m). No reading is needed again, and 35 numbers are the whole state.

    Use it where the sensor is turned all the time and its offset may change: a stream, a vehicle under way. The memory
    has to hold a turn through all directions, or what it holds no longer tells all nine parameters, and the claim
    says so. Without forgetting it is `Consistent`, to the last digits.

    Parameters
    ----------
    memory : float, optional
        Readings after which a weight has fallen to 1/e; None remembers all.

    Notes
    -----
    Covariance: that of a fit that weighs readings by w, with (Σw)²/Σw² readings that count (2 m in the long run), for
    noise that is independent from reading to reading. It says how well the sums tell what they tell, and nothing of
    how far the offset has moved within the memory. A change spread over it shows at half of what it is.

    References
    ----------
    .. [1] A. Kukush, I. Markovsky, S. Van Huffel (2004), see `Consistent`; exponential forgetting as in L. Ljung,
       "System Identification" (2nd ed. 1999), 11.2.

    Examples
    --------
    The offset moves by 30 in the middle of a recording:

    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(6000, 3))
    >>> field = 50.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + rng.normal(size=(6000, 3))
    >>> field[3000:, 0] += 30.0
    >>> readings = Readings.of(field)
    >>> for memory in (None, 300.0):
    ...     print(Forgetting(memory).estimate(readings).ellipsoid.centre.round(0) + 0.0)
    [15.  0.  0.]
    [30.  0.  0.]
    """

    memory: float | None = None

    name: ClassVar[str] = "forgetting"
    unknowns: ClassVar[int] = 10
    use: ClassVar[str] = "consistent with fading memory: a stream whose offset wanders; can be watched"
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a memory that holds nothing.

        Raises
        ------
        UsageError
            For a memory of fewer readings than there are unknowns.
        """
        if self.memory is None:
            return
        if isinstance(self.memory, bool) or not isinstance(self.memory, int | float):
            raise UsageError(f"memory is {self.memory!r}: need a number of readings, or none")
        if not (self.memory >= SHORTEST and math.isfinite(self.memory)):
            raise UsageError(f"memory is {self.memory:g} readings: need {SHORTEST:g} or more; none remembers all")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid to what is remembered in the end.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NotAnEllipsoid
            If the quadric is open.
        NeedsSamples
            If only sums were given, and there is a memory: sums do not tell how old a reading is.
        """
        readings.require(self.unknowns, self.name)
        if self.memory is None:
            return self._of(_Remembered.all_of(readings.summary))
        remembered = _Remembered.none(readings.summary.cloud.side)
        for block in readings.blocks(f"{self.name} with memory={self.memory:g}"):
            for begin in range(0, len(block), BLOCK):
                remembered = remembered.then(block[begin : begin + BLOCK], self.memory)
        return self._of(remembered)

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Follow the estimate at about so many steps, closer together at the beginning.

        Raises
        ------
        FitError
            As `estimate`.
        NeedsSamples
            If only sums were given.
        """
        self.estimate(readings)
        wanted = spread_counts(len(readings), steps)
        found: list[Estimate | None] = []
        remembered, seen = _Remembered.none(readings.summary.cloud.side), 0
        for block in readings.blocks(f"{self.name} step by step"):
            ends = [count - seen for count in wanted if seen < count <= seen + len(block)]
            for begin, end in pairwise([0, *ends]):
                remembered = remembered.then(block[begin:end], self.memory)
                found.append(self._if_any(remembered))
            remembered = remembered.then(block[ends[-1] if ends else 0 :], self.memory)
            seen += len(block)
        return Convergence.of(wanted, found)

    def _if_any(self, remembered: _Remembered) -> Estimate | None:
        try:
            return self._of(remembered)
        except FitError:
            return None

    def _of(self, remembered: _Remembered) -> Estimate:
        """Fit an ellipsoid to sums whose total weight is the number of readings that count.

        Raises
        ------
        TooFewSamples
            If those are fewer than the unknowns.
        NotAnEllipsoid
            If the quadric is open.
        """
        readings = Readings(remembered.summary)
        counting = readings.summary.moments.count
        if counting < self.unknowns:
            raise TooFewSamples(found=int(counting), needed=self.unknowns, method=self.name)
        ellipsoid, noise = adjusted(readings)
        covariance = algebraic_covariance(readings, ellipsoid, noise)
        return Estimate(ellipsoid, covariance, noise, self.name, used=0 if self.memory is None else round(counting))


@dataclass(frozen=True, slots=True, eq=False)
class _Remembered:
    """Weighted sums and cells of the readings so far, and the sum of the squares of their weights."""

    moments: Moments
    cloud: Cloud
    squares: float
    side: float = 0.0

    @classmethod
    def none(cls, side: float) -> Self:
        """No readings yet, and the edge of the cells that they will be sorted into."""
        return cls(Moments.empty(), Cloud.empty(), 0.0, side)

    @classmethod
    def all_of(cls, summary: Summary) -> Self:
        """Every reading with the weight that it has."""
        return cls(summary.moments, summary.cloud, summary.moments.count)

    @property
    def summary(self) -> Summary:
        """The sums with all weights scaled so that their total is (Σw)²/Σw²."""
        scale = self.moments.count / self.squares if self.squares else 1.0
        return replace(Summary.empty(), moments=self.moments * scale, cloud=self.cloud * scale)

    def then(self, field: Floats, memory: float | None) -> Self:
        """Forget a little for each of (N, 3) further readings, and add it."""
        if not len(field):
            return self
        weights = np.ones(len(field)) if memory is None else np.exp(np.arange(1 - len(field), 1) / memory)
        fading = 1.0 if memory is None else math.exp(-len(field) / memory)
        return type(self)(
            self.moments * fading + Moments.of(field, weight=weights),
            _without_faded(self.cloud * fading + _weighted_cells(field, weights, self.side)),
            self.squares * fading**2 + float(weights @ weights),
            self.side,
        )


def _weighted_cells(field: Floats, weights: Floats, side: float) -> Cloud:
    """(N, 3) readings sorted into cells, with (N,) weights; times are nobody's business here."""
    keys, places = np.unique(keys_of(field, side), return_inverse=True)
    columns = (weights, *(weights * field.T))
    added: Floats = np.array([np.bincount(places, column, len(keys)) for column in columns], dtype=float).T
    never: Floats = np.full(len(keys), np.nan)
    return Cloud(side, keys, added[:, 0], added[:, 1:], never, never)


def _without_faded(cloud: Cloud) -> Cloud:
    """Let go of cells that hold next to nothing, before what they hold is too small to be divided by."""
    told = cloud.counts > FADED * cloud.counts.sum()
    if told.all():
        return cloud
    return replace(
        cloud,
        keys=cloud.keys[told],
        counts=cloud.counts[told],
        sums=cloud.sums[told],
        first=cloud.first[told],
        last=cloud.last[told],
    )
