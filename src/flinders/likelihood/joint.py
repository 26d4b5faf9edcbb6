"""One magnetometer and the sensors on its body: readings in groups, their prior and their noise, for the solver.

Each reading, or each window of a gyro, has a direction of the field of its own (`flinders.likelihood.observations`);
`JointProblem` puts the readings in such groups, lays out the parameters, and says how residuals are weighed.
`flinders.likelihood.solver` takes the steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Self, TypeAlias

import numpy as np

from flinders.core.axes import TURNS
from flinders.geometry.rotation import across, in_pieces, lengths
from flinders.likelihood import attitude, dip, gyro
from flinders.likelihood.equations import FINEST, NormalEquations
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.observations import ObservationGroup, Weights, residuals_of
from flinders.likelihood.parameters import ParameterLayout, Parameters
from flinders.likelihood.prior import SensorPrior
from flinders.likelihood.robust import HUBER, huber
from flinders.likelihood.solver import EASED, NO_WORSE, SETTLED, Iterate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.dip import AccelerometerPrior
    from flinders.likelihood.prior import KnownShape
    from flinders.likelihood.site_field import Site
    from flinders.likelihood.solver import Equations

FINEST_VERTICAL: Final = 1e-4
"""rad: no vertical is known better."""

LOUDEST: Final = 0.1
"""Of the field, and rad: what noises begin with at most."""

STILLER: Final = 2.0
"""Times less that the field outliers in the world: so much makes another way to sit than was thought a start."""

SEATED: Final = 10
"""Rounds of finding where the field points, and how the magnetometer is mounted for it."""

MANY_ATTITUDES: Final = 1000
"""Attitudes that a start is found from."""

MANY: Final = 20_000
"""Readings of which the standard deviations are so small that a hundredth of one is nothing."""

MISFIT: Final = 1.5
"""Times larger than the noise from one reading to the next: residuals that another start may do away with."""


@dataclass(frozen=True, slots=True, eq=False)
class JointProblem:
    """Groups of readings, and what is thought of the parameters before."""

    groups: tuple[ObservationGroup, ...]
    layout: ParameterLayout
    aiding: tuple[str, ...]
    site: Site | None
    prior: SensorPrior
    interval: float  # s: between two readings of a window
    accelerometer: AccelerometerPrior | None = None  # where it brings verticals
    is_rough: bool = False  # a check asks for no more steps than a long recording takes
    is_robust: bool = False  # readings with a large residual count less: to start from, not to claim from
    tolerance: ClassVar[float] = NO_WORSE

    @classmethod
    def of(
        cls,
        samples: Samples,
        terms: tuple[str, ...],
        site: Site | None,
        rotation: Floats | None,
        spread: float,
        window_s: float,
        *,
        gyro_scale: float = SCALE_SIGMA,
        accelerometer: AccelerometerPrior | None = None,
        shape: KnownShape | None = None,
        is_rough: bool = False,
    ) -> Self:
        """Put the readings in groups, and lay out what is to be found."""
        groups, interval = grouped(samples, terms, window_s)
        in_windows = any(group.turned is not None for group in groups)
        upright = any(group.down is not None for group in groups)
        pointed = any(group.attitudes is not None for group in groups)
        layout = ParameterLayout.of(
            rotation=in_windows or upright or pointed,
            gyro_bias=in_windows,
            gyro_scale=in_windows and gyro_scale > 0.0,
            gyro_turn=in_windows and gyro_scale > 0.0 and (upright or pointed),
            delay=in_windows,
            sine=upright,
            direction=pointed,
        )
        before = SensorPrior.of(
            samples.field, spread, np.eye(3) if rotation is None else rotation, shape,
            gyro_scale=gyro_scale, gyro_turn=gyro_scale,
        )  # fmt: skip
        chunks = tuple(chunk for group in groups for chunk in group.chunks())
        return cls(chunks, layout, terms, site, before, interval, accelerometer, is_rough)

    @property
    def readings(self) -> int:
        """How many there are."""
        return sum(group.rows.size for group in self.groups)

    @property
    def settled(self) -> float:
        """Standard deviations: such a step is the last. Of many readings, as long a one as of their correction."""
        return EASED if self.is_long else SETTLED

    @property
    def is_long(self) -> bool:
        """There are so many readings that a step costs more than what is left to gain by it, or little is asked for."""
        return self.is_rough or self.readings >= MANY

    def thinned(self, readings: int) -> Self:
        """The same with about so many readings, spread over the recording."""
        step = self.readings // readings
        return self if step < 2 else replace(self, groups=tuple(group.runs(step) for group in self.groups))

    def robust(self) -> Self:
        """The same with less weight for readings that have a large residual, so that a few cannot pull it far."""
        return replace(self, is_robust=True)

    def freed(self) -> Self:
        """The same with the errors of an accelerometer among what is found, where there is one.

        On the way there it is held: noise pretends so much of it that the way down could lead anywhere.
        """
        if self.accelerometer is None or "sine" not in self.layout:
            return self
        free = dict.fromkeys(self.layout.columns, True)
        return replace(self, layout=ParameterLayout.of(**free, accelerometer=True))

    def begin(self, ellipsoid: Ellipsoid) -> Parameters:
        """Where to start, with directions and dip that follow from an ellipsoid."""
        at = replace(Parameters.at(ellipsoid.centre, ellipsoid.shape), rotation=self.prior.rotation)
        if self.accelerometer is not None:
            at = replace(at, accelerometer=self.accelerometer.mean)
        return self.facing(replace(at, rotation=self._aligned(at)))

    def begin_near(self, near: Parameters, layout: ParameterLayout) -> Parameters:
        """Where to start with what a fit of another `ParameterLayout` has found."""
        free = ("rotation", "gyro_bias", "gyro_scale", "gyro_turn", "delay")
        values = {name: getattr(near, name) for name in free if name in layout and name in self.layout}
        at = replace(self.begin(near.ellipsoid), **values)
        return self.facing(replace(at, rotation=self._aligned(at)))

    def _aligned(self, at: Parameters) -> Floats:
        """(3, 3) mounting of the magnetometer that makes the field stand still in attitudes: as it is, or far better.

        From an attitude turned far the way down leads elsewhere, so that each of 24 ways to sit is tried.
        """
        attitudes, seen = [], []
        for group in self.groups:
            if group.attitudes is not None and group.trust is not None:
                known = group.trust > 0.0
                attitudes.append(group.attitudes[known])
                seen.append(np.linalg.solve(at.shape, group.centred(at)[known].T).T)
        if not attitudes:
            return at.rotation
        rows = slice(None, None, max(1, sum(map(len, seen)) // MANY_ATTITUDES))
        return aligned(np.concatenate(attitudes)[rows], np.concatenate(seen)[rows], at.rotation)

    def facing(self, at: Parameters) -> Parameters:
        """The same with the dip, or the direction of the site's field, that readings show."""
        inverse = np.linalg.inv(at.ellipsoid_like)
        heights, weights, world = 0.0, 0.0, np.zeros(3)
        for group in self.groups:
            seen = group.centred(at) @ inverse.T
            if (down := group.upright(at)) is not None and group.trust is not None:
                heights += float(np.einsum("wni,wni,wn->", down, seen, group.trust))
                weights += float(group.trust.sum())
            if group.attitudes is not None:
                known = seen if group.trust is None else seen * group.trust[..., np.newaxis]
                world += np.einsum("wnij,wnj->i", group.attitudes, known)
        sine = float(np.clip(heights / weights, -0.999, 0.999)) if weights > 0.0 else 0.0
        of_site = None if self.site is None else self.site.sine
        length = float(np.linalg.norm(world))
        return replace(
            at,
            sine=sine if of_site is None else of_site,
            direction=world / length if length > 0.0 else at.direction,
        )

    def prior_equations(self, at: Parameters) -> NormalEquations:
        """What is thought before, of the sensors and of the field of the site, in standard deviations."""
        equations = self.prior.equations(at, self.layout)
        for name, row, left in () if self.site is None else self._site_rows(at, self.site):
            if name in self.layout:
                whole = np.zeros(self.layout.size)
                whole[self.layout.columns[name]] = row
                equations += NormalEquations(np.outer(whole, whole), whole * left, left**2, 0)
        if self.accelerometer is not None and "accelerometer" in self.layout:
            own = self.accelerometer.equations(at.accelerometer)
            equations += own.placed(self.layout.columns["accelerometer"], self.layout.size)
        return equations

    def _site_rows(self, at: Parameters, site: Site) -> Iterator[tuple[str, Floats, float]]:
        """Jacobian and residual of what is known of the site, in standard deviations, for a block of parameters."""
        if site.strength is not None:
            width = site.gain_sigma * site.strength
            mean = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0
            yield "shape", mean / width, (site.strength - float(np.trace(at.shape)) / 3.0) / width
        if site.sine is not None:
            yield (
                "direction",
                across(at.direction)[2] / site.sine_sigma,
                (site.sine - at.direction[2]) / site.sine_sigma,
            )
            yield "sine", np.ones(1) / site.sine_sigma, (site.sine - at.sine) / site.sine_sigma

    def reweighed(self, iterate: JointIterate, equations: Equations) -> JointIterate:
        """Weigh each kind of residual by its noise, and large ones less: of verticals, and of readings if robust."""
        weights = self._weights(iterate, equations)
        groups = tuple(
            _reweighed(group, original, iterate.at, directions, weights, is_robust=self.is_robust)
            for group, original, directions in zip(iterate.groups, self.groups, iterate.directions, strict=True)
        )
        return replace(iterate, weights=weights, groups=groups)

    def _weights(self, iterate: JointIterate, equations: Equations) -> Weights:
        """Noise of readings, and of verticals unless they are correlated: those are weighed as a whole."""
        weights, size = iterate.weights, float(self.layout.size)
        finest = FINEST * iterate.at.radius
        if weights.span > 1.0 or all(group.trust is None for group in iterate.groups):
            return weights._replace(noise=max(weights.noise * equations.noise_factor(size), finest))
        noise, vertical = equations.noise_factors(np.array([size, 0.0])).tolist()
        return weights._replace(
            noise=max(weights.noise * noise, finest), vertical=max(weights.vertical * vertical, FINEST_VERTICAL)
        )


JointIterate: TypeAlias = Iterate[Parameters, ObservationGroup, Weights]


def aligned(attitudes: Floats, seen: Floats, rotation: Floats) -> Floats:
    """How a magnetometer sits on a body of known attitude: as was thought, unless another way is far better.

    From each of the 24 ways in which axes can be exchanged, the field's mean direction m = Σ C R q and the rotation
    that takes all q the nearest to Cᵀ m (Wahba's problem, by singular values) are found in turns.

    Parameters
    ----------
    attitudes : (N, 3, 3) float
        C, from body to world.
    seen : (N, 3) float
        q, in the magnetometer's own axes, of about unit length.
    rotation : (3, 3) float
        As was thought.

    Returns
    -------
    (3, 3) float

    >>> from flinders.geometry.quaternions import of_angles
    >>> angles = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    >>> attitudes = attitude.body_to_world(of_angles(angles))
    >>> upturned = np.swapaxes(attitudes, 1, 2) @ [0.6, 0.0, 0.8] * [1.0, -1.0, -1.0]
    >>> aligned(attitudes, upturned, np.eye(3)).round(6) + 0.0
    array([[ 1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0., -1.]])
    """
    if not len(seen):
        return rotation
    ways = np.stack([rotation, *(axes.apply(np.eye(3)).T for axes in TURNS)])
    pairs = np.einsum("nij,nk->nijk", attitudes, seen).mean(axis=0)  # Σ C_ij q_k: all that is needed of the readings
    for _ in range(SEATED):
        north = np.einsum("ijk,wjk->wi", pairs, ways)
        left, _, right = np.linalg.svd(np.einsum("wi,ijk->wjk", north, pairs))
        left[:, :, 2] *= np.linalg.det(left @ right)[:, np.newaxis]
        ways[1:] = (left @ right)[1:]
    lengths = np.linalg.norm(np.einsum("ijk,wjk->wi", pairs, ways), axis=1)
    scattered = np.maximum(np.mean(np.sum(seen**2, axis=1)) - lengths**2, 0.0)  # variance about the mean
    best = int(np.argmin(scattered))
    best_rotation: Floats = ways[best] if STILLER**2 * scattered[best] < scattered[0] else rotation
    return best_rotation


def grouped(samples: Samples, terms: Sequence[str], window_s: float) -> tuple[list[ObservationGroup], float]:
    """Put readings that share a direction together, and say how far apart those of a window are, in s."""
    auxiliary = _Attitudes.of(samples, terms)
    every = np.arange(len(samples), dtype=np.intp)
    if "rate" not in terms or samples.rate is None or samples.time is None:
        return [_group(samples, every[:, np.newaxis], auxiliary)], 0.0
    inside = gyro.windows(samples.time, samples.rate, window_s=window_s)
    groups = []
    interval = 0.0
    if len(inside):
        steps = np.diff(samples.time[inside], axis=1)
        interval = float(np.median(steps))
        intervals = np.concatenate([steps, steps[:, -1:]], axis=1)
        turned = gyro.integrated(np.nan_to_num(samples.rate[inside]), intervals, np.zeros(3))
        groups.append(replace(_group(samples, inside, auxiliary), turned=turned))
    rest = np.setdiff1d(every, inside.ravel())[:, np.newaxis]
    if len(rest):
        groups.append(_group(samples, rest, auxiliary))
    return groups, interval


class _Attitudes(NamedTuple):
    """What stands beside each reading: an attitude (N, 3, 3), or a vertical (N, 3), and how far it is trusted (N,)."""

    attitudes: Floats | None = None
    down: Floats | None = None
    trust: Floats | None = None

    @classmethod
    def of(cls, samples: Samples, terms: Sequence[str]) -> Self:
        """Take the attitude, which holds a vertical, too; else the accelerometer's, else that of the attitude."""
        if "attitude" in terms and samples.attitude is not None:
            matrices = attitude.body_to_world(samples.attitude)
            known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
            matrices[~known] = np.eye(3)
            return cls(attitudes=matrices, trust=known.astype(float))
        if "dip" in terms and samples.acceleration is not None:
            return cls(None, *dip.verticals(samples.acceleration))
        if "tilt" in terms and samples.attitude is not None:
            return cls(None, *dip.verticals_of(samples.attitude))
        return cls()


def _group(samples: Samples, rows: NDArray[np.intp], auxiliary: _Attitudes) -> ObservationGroup:
    """Take what belongs to (W, n) readings."""
    return ObservationGroup(
        rows,
        in_pieces(samples.field[rows]),
        np.ones(rows.shape),
        attitudes=None if auxiliary.attitudes is None else in_pieces(auxiliary.attitudes[rows], 2),
        down=None if auxiliary.down is None else in_pieces(auxiliary.down[rows]),
        trust=None if auxiliary.trust is None else auxiliary.trust[rows],
    )


def initial(problem: JointProblem, at: Parameters) -> JointIterate:
    """Where to begin with some parameters: directions that readings agree on, and noises that residuals show."""
    groups = tuple(group.at(at) for group in problem.groups)
    directions = tuple(group.guess(at) for group in groups)
    squares, counts = np.zeros(2), np.zeros(2)
    for group, known in zip(groups, directions, strict=True):
        residual, auxiliary = residuals_of(group, at, known)
        squares[0] += float(np.sum(residual**2))
        counts[0] += 3.0 * residual.shape[0] * residual.shape[1] - 2.0 * len(known)
        if auxiliary is not None and group.trust is not None:
            squares[1] += float(np.sum(np.sum(auxiliary**2, axis=2) * group.trust))
            counts[1] += float(np.count_nonzero(group.trust)) * auxiliary.shape[2]
    noise, vertical = np.sqrt(squares / np.maximum(counts, 1.0)).tolist()
    weights = Weights(
        float(np.clip(noise, FINEST * at.radius, LOUDEST * at.radius)),
        float(np.clip(vertical, FINEST_VERTICAL, LOUDEST)),
    )
    return Iterate(at, groups, directions, weights)


def misfits(iterate: JointIterate) -> bool:
    """Whether weighted residuals are larger than what they change by from one reading to the next."""
    total, steps, count, pairs = 0.0, 0.0, 0, 0
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        residual, auxiliary = residuals_of(group, iterate.at, directions)
        weight = group.weight
        if group.turned is None:
            if group.attitudes is None or auxiliary is None or group.trust is None:
                continue
            residual, weight = np.swapaxes(auxiliary, 0, 1), group.trust.T  # a direction each: one after the other
        residual = residual * np.sqrt(weight)[..., np.newaxis]
        total += float(np.sum(residual**2))
        steps += 0.5 * float(np.sum(np.diff(residual, axis=1) ** 2))
        count, pairs = count + residual.size, pairs + residual[:, 1:].size
    return count > 0 and total / count > MISFIT**2 * steps / max(pairs, 1)


def _reweighed(
    group: ObservationGroup,
    original: ObservationGroup,
    at: Parameters,
    directions: Floats,
    weights: Weights,
    *,
    is_robust: bool,
) -> ObservationGroup:
    """Trust verticals and attitudes with a large residual less than what was recorded with them asks for.

    Readings with a large residual count less where the fit is to be robust.
    """
    residual, auxiliary = residuals_of(group, at, directions)
    if is_robust:
        redescending = huber(lengths(residual) / weights.noise) ** 2
        group = replace(group, weight=original.weight * redescending)
    if auxiliary is None or original.trust is None:
        return group
    length = np.sqrt(np.einsum("wni,wni->wn", auxiliary, auxiliary)) / weights.vertical
    beyond = HUBER if group.attitudes is None else attitude.HUBER
    return replace(group, trust=original.trust * group.weight * huber(length, beyond=beyond))


def deviance(problem: JointProblem, iterate: JointIterate) -> float:
    """−2 log of how probable a fit is, but for what all fits to these readings share."""
    counts = np.zeros(2)
    for group in iterate.groups:
        observed = 0 if group.trust is None else int(np.count_nonzero(group.trust))
        counts += [3.0 * group.count, observed * (1.0 / iterate.weights.span if group.attitudes is None else 2.0)]
    return float(2.0 * counts @ np.log(iterate.weights[:2])) + problem.prior_equations(iterate.at).cost
