"""What an estimator looks at and what it gives back.

>>> readings = Readings.of(np.random.default_rng(1).normal(size=(50, 3)))
>>> len(readings.summary), readings.thinned(20).shape
(50, (17, 3))
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Protocol, Self, TypeGuard, cast

import numpy as np

from flinders.cloud import cells_of
from flinders.coverage import directions_of
from flinders.errors import NeedsSamples, NotAnEllipsoid, OutOfScale, StuckAxis, TooFewSamples, Unmoved
from flinders.quadric import Ellipsoid
from flinders.samples import Recording, Samples
from flinders.summary import Summary
from flinders.terms import magnitude
from flinders.terms.support import Support, pretended

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.axes import Axes
    from flinders.estimators.correlation import Correlation
    from flinders.units import Unit

SMALLEST, LARGEST = 1e-12, 1e15
"""Between these sizes, in any unit, fourth powers and their inverses are numbers."""

FARTHEST: Final = 1000.0
"""Offset in spreads of the readings; a magnet that strong leaves no range to any sensor."""

STRETCHES, STRETCH = 20, 1024
"""Stretches of consecutive readings, and readings in each, that tell how residuals hang together."""

PER_CELL: Final = 4
"""Readings of one place that count, where what counts is how many places agree."""

FINEST: Final = 1e-6
"""Of the field: no sensor resolves less, and no fit claims to."""

WINDOW, MARGIN = 11, 25

HELD: Final = 500_000
"""Readings of a recording that are kept in memory; a longer one is gone through again."""


class Kept:
    """A recording that remembers its readings on the first pass, unless there are too many.

    Attributes
    ----------
    recording : Recording
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._blocks: list[Samples] | None = None

    @property
    def source(self) -> str:
        """That of the recording."""
        return self.recording.source

    @property
    def unit(self) -> Unit:
        """That of the recording."""
        return self.recording.unit

    @property
    def axes(self) -> Axes:
        """Those of the recording."""
        return self.recording.axes

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording and keep the readings of up to `HELD` rows."""
        self._blocks, rows = [], 0
        for block in self.recording.blocks():
            rows += len(block)
            if rows > HELD:
                self._blocks = None
            if self._blocks is not None:
                self._blocks.append(block)
            yield block

    def samples(self) -> Recording:
        """The readings in memory, or the recording itself where they were too many."""
        if not self._blocks:
            return self.recording
        times = [block.time for block in self._blocks if block.time is not None]
        return Samples(
            np.concatenate([block.field for block in self._blocks]),
            unit=self.unit,
            axes=self.axes,
            time=np.concatenate(times) if len(times) == len(self._blocks) else None,
            source=self.source,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Near:
    """The readings of a recording that are close to a surface.

    Attributes
    ----------
    recording : Recording
    ellipsoid : Ellipsoid
    limit : float
        Farthest Sampson distance, in the unit of the readings.
    """

    recording: Recording
    ellipsoid: Ellipsoid
    limit: float

    @property
    def source(self) -> str:
        """That of the recording."""
        return self.recording.source

    @property
    def unit(self) -> Unit:
        """That of the recording."""
        return self.recording.unit

    @property
    def axes(self) -> Axes:
        """Those of the recording."""
        return self.recording.axes

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording and leave out what is farther away, and what lies around a run of it."""
        for block in self.recording.blocks():
            far = np.abs(magnitude.distances(block.field, self.ellipsoid)) > self.limit
            yield block[~(far | around_runs(far))]


def around_runs(strays: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) readings beside a run of strays, from (N,) which readings in a row are strays.

    What passes by fades in and out, and its field crosses zero along the surface's normal: readings
    between strays and shortly before and after them are no better. A run is where more of eleven
    readings are strays than chance would put there; the margin is half a second at 50 Hz.
    """
    around = np.zeros(len(strays), dtype=bool)
    if len(strays) < WINDOW or not strays.any():
        return around
    share = float(strays.mean())
    expected = WINDOW * share
    dense = max(3.0, expected + 4.5 * np.sqrt(expected * (1.0 - share)) + 1.0)
    runs = np.convolve(strays, np.ones(WINDOW), mode="same") >= dense
    if not runs.any():
        return around
    reach = np.convolve(runs & strays, np.ones(2 * MARGIN + 1))[MARGIN : MARGIN + len(strays)]
    return np.asarray(reach > 0.5, dtype=bool)


def is_recording(source: Recording | ArrayLike) -> TypeGuard[Recording]:
    """Anything with blocks is a recording; all else has to be an array."""
    return hasattr(source, "blocks")


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The sums of a recording, and the recording itself where it can be gone through again.

    Attributes
    ----------
    summary : Summary
    recording : Recording, optional
        None where only the sums came: methods that need each reading then refuse.
    """

    summary: Summary
    recording: Recording | None = None

    @classmethod
    def of(cls, source: Summary | Recording | ArrayLike) -> Self:
        """Summarise whatever is given, in one pass; a recording that is not too long is kept in memory."""
        if isinstance(source, Summary):
            return cls(source)
        if isinstance(source, Samples):
            return cls(Summary.of(source), source)
        if is_recording(source):
            kept = Kept(source)
            return cls(Summary.through(kept), kept.samples())
        samples = Samples.of(cast("ArrayLike", source))
        return cls(Summary.of(samples), samples)

    def __len__(self) -> int:
        return len(self.recording) if isinstance(self.recording, Samples) else len(self.summary)

    def blocks(self, method: str) -> Iterator[Floats]:
        """Go through all readings.

        Raises
        ------
        NeedsSamples
            Where there are only sums.
        """
        if self.recording is None:
            raise NeedsSamples(method)
        if isinstance(self.recording, Samples):
            yield self.recording.field
            return
        for block in self.recording.blocks():
            yield block.field

    def thinned(self, limit: int, method: str = "") -> Floats:
        """Take at most about `limit` readings, spread evenly over the recording."""
        stride = max(1, -(-len(self) // limit))
        seen, kept = 0, []
        for block in self.blocks(method):
            kept.append(block[-seen % stride :: stride])
            seen += len(block)
        return kept[0] if len(kept) == 1 else np.concatenate(kept)

    def stretches(self, method: str) -> list[Floats]:
        """Some consecutive readings, spread over the recording; all of them where they are not too many."""
        if len(self) <= STRETCHES * STRETCH:
            return (
                list(self.blocks(method)) if isinstance(self.recording, Samples) else [self.thinned(len(self), method)]
            )
        every = len(self) // STRETCHES
        found: list[Floats] = []
        seen = 0
        for block in self.blocks(method):
            begin = -seen % every
            while begin < len(block):
                found.append(block[begin : begin + STRETCH])
                begin += every
            seen += len(block)
        return [stretch for stretch in found if len(stretch) >= STRETCH // 2]

    def only(self, field: Floats) -> Self:
        """Some of the readings, in memory, with the sums of all."""
        return dataclasses.replace(self, recording=Samples(field))

    def near(self, ellipsoid: Ellipsoid, limit: float) -> Self:
        """Those readings that are no farther than `limit` from a surface, with the sums of all."""
        if self.recording is None:
            return self
        near = Near(self.recording, ellipsoid, limit)
        if isinstance(self.recording, Samples) and len(self) <= HELD:
            return self.only(np.concatenate([block.field for block in near.blocks()]))
        return dataclasses.replace(self, recording=near)

    def spread_out(self, field: Floats, rng: Generator) -> Floats:
        """Take a few readings from each cell of the cloud: a rest or a clump then counts for no more than its place."""
        cells = cells_of(field, self.summary.cloud.side)
        order = rng.permutation(len(field))
        order = order[np.argsort(cells[order], kind="stable")]
        sorted_cells = cells[order]
        first = np.flatnonzero(np.concatenate([[True], sorted_cells[1:] != sorted_cells[:-1]]))
        rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
        return field[np.sort(order[rank < PER_CELL])]

    def require(self, unknowns: int, method: str) -> None:
        """Refuse what no method can work with.

        Raises
        ------
        TooFewSamples
            Unless there are as many readings as unknowns.
        OutOfScale
            For numbers that no magnetometer reads.
        StuckAxis
            If an axis never changes.
        Unmoved
            If the readings vary by less than a thousandth of their mean: sums about zero tell too little of them.
        """
        if len(self) < unknowns:
            raise TooFewSamples(found=len(self), needed=unknowns, method=method)
        largest = self.summary.moments.unit
        if not SMALLEST < largest < LARGEST:
            raise OutOfScale(largest)
        stuck = [axis for axis in range(3) if self.summary.health.extent[axis] == 0.0]
        if stuck:
            values = self.summary.health.lows.values
            raise StuckAxis(tuple("xyz"[axis] for axis in stuck), tuple(float(values[axis]) for axis in stuck))
        spread, size = self.summary.moments.spread, float(np.linalg.norm(self.summary.moments.mean))
        if size > FARTHEST * spread:
            raise Unmoved(spread=spread, size=size)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """An ellipsoid with its uncertainty.

    Attributes
    ----------
    ellipsoid : Ellipsoid
    covariance : (9, 9) float
        Of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; singular where a method holds some of them.
    noise : float
        Standard deviation of the distance from the ellipsoid, in the unit of the readings.
    method : str
        What was run in the end.
    bias : (9,) float
        Difference from the likelihood (from the consistent fit where there are only sums), as far as chance does
        not explain it; in the covariance already.
    held : float
        Share of the worst known shape parameter that a prior speaks for: 0 where the readings say
        it all, 1 where they say nothing.
    correlation : Correlation, optional
        How residuals hang together; the covariance is wider for it.
    textbook : (9, 9) float, optional
        Covariance that would hold for independent residuals.
    used : int
        Readings that it rests on.
    unseen : int
        Directions of parameter space of which the readings say nothing.
    rejected_beyond : float
        Distance from the surface beyond which readings were left out, in their unit.
    """

    ellipsoid: Ellipsoid
    covariance: Floats
    noise: float
    method: str
    bias: Floats = dataclasses.field(default_factory=lambda: np.zeros(9))
    held: float = 0.0
    correlation: Correlation | None = None
    textbook: Floats | None = None
    used: int = 0
    unseen: int = 0
    rejected_beyond: float = np.inf


class Estimator(Protocol):
    """A way of finding an ellipsoid.

    Attributes
    ----------
    name : str
        What `flinders.fit(method=…)` calls it.
    unknowns : int
        What it finds, the noise among it, and so the least number of readings.
    use : str
        When to use it, in one line.
    is_biased : bool
        Its model or its equation leaves an error that more readings do not take away.
    """

    name: ClassVar[str]
    unknowns: ClassVar[int]
    use: ClassVar[str]
    is_biased: ClassVar[bool]

    def estimate(self, readings: Readings) -> Estimate:
        """Fit.

        Raises
        ------
        FitError
            If these readings give no ellipsoid.
        """


EVERYTHING: Final = np.eye(9)
"""Basis of the parameters of a fit without constraints."""

AXES_ALIGNED: Final = np.eye(9)[:, :6]
"""Basis of the parameters where the shape is diagonal."""

SPHERICAL: Final = np.concatenate([np.eye(9)[:, :3], np.eye(9)[:, 3:6].sum(axis=1, keepdims=True)], axis=1)
"""Basis of the parameters where the shape is a multiple of the identity."""


def algebraic_noise(readings: Readings, ellipsoid: Ellipsoid, unknowns: int) -> float:
    """Standard deviation of the distance from an ellipsoid, from the sums alone.

    With q(x) = |S⁻¹(x − b)|² − 1 and s ≈ q/|∇q| it is √(Σq² / Σ|∇q|²), corrected for the unknowns.

    Raises
    ------
    NotAnEllipsoid
        For a surface so far from its readings that their sums do not tell.
    """
    moments = readings.summary.moments
    scale = ellipsoid.radius
    scatter = moments.about(ellipsoid.centre, scale)
    local = Ellipsoid(np.zeros(3), ellipsoid.shape / scale).as_quadric()
    form = np.linalg.matrix_power(np.linalg.inv(ellipsoid.shape / scale), 4)
    steepness = 4.0 * float(np.sum(form * scatter[6:9, 6:9]))
    freedom = max(moments.count - unknowns, 1.0) / moments.count
    if not steepness > 0.0:  # nothing but rounding is left of a surface far away from its readings
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    square = max(float(local @ scatter @ local), 0.0) / steepness / freedom
    return scale * float(np.sqrt(square))


def algebraic_covariance(readings: Readings, ellipsoid: Ellipsoid, noise: float, basis: Floats = EVERYTHING) -> Floats:
    """(9, 9) covariance of a fit that minimises Σ q(x)², whatever its normalisation.

    q = |∇q| s, so to first order such a fit is a least-squares fit of the distances s with weights
    w = |∇q|², and its covariance is σ² N⁻¹ (Σ w² JJᵀ) N⁻¹ with N = Σ w JJᵀ: larger than that of the
    likelihood, which weighs all distances alike. The sums run over the cells of the cloud. A direction that the
    readings do not see gets the radius for its standard deviation.

    Parameters
    ----------
    readings : Readings
    ellipsoid : Ellipsoid
    noise : float
        In the unit of the readings.
    basis : (9, k) float
        The parameters that the method adjusts.
    """
    cloud = readings.summary.cloud
    directions = directions_of(cloud.means, ellipsoid)
    jacobian = magnitude.information(directions, ellipsoid) @ basis
    variance = max(noise, FINEST * ellipsoid.radius) ** 2
    counted = jacobian.T * cloud.counts
    support = Support.of(
        counted @ jacobian / variance, lambda: basis.T @ pretended(directions, ellipsoid, cloud.counts) @ basis
    )
    seen, unseen = support.directions
    gradients = np.linalg.solve(ellipsoid.shape, directions.T) * ellipsoid.radius
    weights = np.einsum("ij,ij->j", gradients, gradients)
    rows = jacobian @ seen
    weighted = rows.T * (weights * cloud.counts)
    inverse = basis @ seen @ np.linalg.inv(weighted @ rows)
    open_ended = ellipsoid.radius * basis @ unseen
    covariance: Floats = variance * inverse @ ((weighted * weights) @ rows) @ inverse.T + open_ended @ open_ended.T
    return covariance
