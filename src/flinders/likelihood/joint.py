"""Problem of the solver for one magnetometer and aiding sensors: groups of readings, their prior and their noise.

Each reading, or each window of a gyro, has its own direction of the field (`flinders.likelihood.observations`).
`JointProblem` makes groups of the readings, defines the parameters, and weights the residuals;
`flinders.likelihood.solver` iterates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Self, TypeAlias

import numpy as np

from flinders.core.axes import AXIS_ROTATIONS
from flinders.geometry.rotation import lengths, make_contiguous, perpendicular_vectors
from flinders.likelihood import attitude, dip, gyro
from flinders.likelihood.equations import MIN_NOISE, NormalEquations
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.observations import ObservationGroup, Weights, unweighted_residuals
from flinders.likelihood.parameters import ParameterLayout, Parameters
from flinders.likelihood.prior import SensorPrior
from flinders.likelihood.robust import HUBER_SIGMAS, huber_weights
from flinders.likelihood.solver import LAST_CORRECTION_SIGMAS, LAST_STEP_SIGMAS, MAX_COST_INCREASE, Iterate

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

MIN_VERTICAL_SIGMA: Final = 1e-4
"""Smallest standard deviation of a vertical in rad."""

MAX_START_NOISE: Final = 0.1
"""Largest standard deviation at the start: of readings relative to the field, of verticals in rad."""

MIN_SCATTER_DROP: Final = 2.0
"""Smallest factor by which another mounting reduces the scatter of the field in the world to be the start."""

MOUNTING_ITERATIONS: Final = 10
"""Count of iterations that estimate, in turn, the direction of the field and the mounting of the magnetometer."""

MAX_START_ATTITUDES: Final = 1000
"""Largest number of attitudes from which a start is estimated."""

MIN_LONG_READINGS: Final = 20_000
"""Number of readings from which the iteration stops at a step of a few hundredths of a standard deviation."""

MIN_MISFIT_RATIO: Final = 1.5
"""Smallest ratio of residuals to the noise of consecutive readings at which another start is tried."""


@dataclass(frozen=True, slots=True, eq=False)
class JointProblem:
    """Problem of a magnetometer with aiding sensors: groups of readings, and the prior of the parameters."""

    groups: tuple[ObservationGroup, ...]
    layout: ParameterLayout  # free parameters
    aiding: tuple[str, ...]  # names of the terms
    site: Site | None  # known field of the site
    prior: SensorPrior
    interval: float  # s: time between two readings of a window
    accelerometer: AccelerometerPrior | None = None  # prior of an accelerometer; None if verticals come from elsewhere
    is_rough: bool = False  # whether to stop as early as for a long recording
    is_robust: bool = False  # whether large residuals reduce the weight of readings; for a start, not for a claim
    tolerance: ClassVar[float] = MAX_COST_INCREASE

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
        """Make groups of the readings, and define the free parameters."""
        groups, interval = group_readings(samples, terms, window_s)
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
        """Number of readings."""
        return sum(group.rows.size for group in self.groups)

    @property
    def last_step(self) -> float:
        """Length of the last step, in standard deviations; longer for a long recording."""
        return LAST_CORRECTION_SIGMAS if self.is_long else LAST_STEP_SIGMAS

    @property
    def is_long(self) -> bool:
        """Whether to stop early: if there are many readings, so that further steps take long, or if `is_rough`."""
        return self.is_rough or self.readings >= MIN_LONG_READINGS

    def thin(self, readings: int) -> Self:
        """The problem with about `readings` readings, spread over the recording."""
        step = self.readings // readings
        return self if step < 2 else replace(self, groups=tuple(group.thin_runs(step) for group in self.groups))

    def make_robust(self) -> Self:
        """The problem in which readings with large residuals have reduced weights, so that outliers matter less."""
        return replace(self, is_robust=True)

    def free_accelerometer(self) -> Self:
        """The problem with the errors of an accelerometer as free parameters, if there is one.

        These errors are fixed during the first iterations, because noise could lead the solver to implausible values.
        """
        if self.accelerometer is None or "sine" not in self.layout:
            return self
        free = dict.fromkeys(self.layout.columns, True)
        return replace(self, layout=ParameterLayout.of(**free, accelerometer=True))

    def begin(self, ellipsoid: Ellipsoid) -> Parameters:
        """Parameters to start from, with the mounting, dip and direction of the field that follow from an ellipsoid."""
        at = replace(Parameters.at(ellipsoid.centre, ellipsoid.shape), rotation=self.prior.rotation)
        if self.accelerometer is not None:
            at = replace(at, accelerometer=self.accelerometer.mean)
        return self.estimate_direction(replace(at, rotation=self._start_rotation(at)))

    def begin_from(self, near: Parameters, layout: ParameterLayout) -> Parameters:
        """Parameters to start from, by the result `near` of a fit with another `ParameterLayout`."""
        free = ("rotation", "gyro_bias", "gyro_scale", "gyro_turn", "delay")
        values = {name: getattr(near, name) for name in free if name in layout and name in self.layout}
        at = replace(self.begin(near.ellipsoid), **values)
        return self.estimate_direction(replace(at, rotation=self._start_rotation(at)))

    def _start_rotation(self, at: Parameters) -> Floats:
        """(3, 3) mounting to start from: that of `at`, unless another one makes the field much more constant.

        The field is rotated into the world by the attitudes. The solver does not converge from a mounting with a large
        error, so all 24 axis rotations are tried.
        """
        attitudes, seen = [], []
        for group in self.groups:
            if group.attitudes is not None and group.trust is not None:
                known = group.trust > 0.0
                attitudes.append(group.attitudes[known])
                seen.append(np.linalg.solve(at.shape, group.subtract_offset(at)[known].T).T)
        if not attitudes:
            return at.rotation
        rows = slice(None, None, max(1, sum(map(len, seen)) // MAX_START_ATTITUDES))
        return find_mounting(np.concatenate(attitudes)[rows], np.concatenate(seen)[rows], at.rotation)

    def estimate_direction(self, at: Parameters) -> Parameters:
        """The parameters with the dip, and the direction of the field in the world, that fit the readings."""
        inverse = np.linalg.inv(at.rotated_shape)
        heights, weights, world = 0.0, 0.0, np.zeros(3)
        for group in self.groups:
            seen = group.subtract_offset(at) @ inverse.T
            if (down := group.corrected_verticals(at)) is not None and group.trust is not None:
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
        """Normal equations of the priors of the sensors and of the field of the site."""
        equations = self.prior.equations(at, self.layout)
        for name, row, left in () if self.site is None else self._site_rows(at, self.site):
            if name in self.layout:
                whole = np.zeros(self.layout.size)
                whole[self.layout.columns[name]] = row
                equations += NormalEquations(np.outer(whole, whole), whole * left, left**2, 0)
        if self.accelerometer is not None and "accelerometer" in self.layout:
            own = self.accelerometer.equations(at.accelerometer)
            equations += own.place_block(self.layout.columns["accelerometer"], self.layout.size)
        return equations

    def _site_rows(self, at: Parameters, site: Site) -> Iterator[tuple[str, Floats, float]]:
        """Yield an observation for each known value of the site: block of parameters, Jacobian and residual.

        Jacobian and residual are in standard deviations.
        """
        if site.strength is not None:
            width = site.gain_sigma * site.strength
            mean = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0
            yield "shape", mean / width, (site.strength - float(np.trace(at.shape)) / 3.0) / width
        if site.sine is not None:
            yield (
                "direction",
                perpendicular_vectors(at.direction)[2] / site.sine_sigma,
                (site.sine - at.direction[2]) / site.sine_sigma,
            )
            yield "sine", np.ones(1) / site.sine_sigma, (site.sine - at.sine) / site.sine_sigma

    def reweigh(self, iterate: JointIterate, equations: Equations) -> JointIterate:
        """Weight each kind of residual by its noise, and reduce the weight of large residuals of verticals.

        If the problem is robust, the weight of readings with large residuals is reduced as well.
        """
        weights = self._weights(iterate, equations)
        groups = tuple(
            _reweigh_group(group, original, iterate.at, directions, weights, is_robust=self.is_robust)
            for group, original, directions in zip(iterate.groups, self.groups, iterate.directions, strict=True)
        )
        return replace(iterate, weights=weights, groups=groups)

    def _weights(self, iterate: JointIterate, equations: Equations) -> Weights:
        """Standard deviations of readings, and of verticals unless they are correlated."""
        weights, size = iterate.weights, float(self.layout.size)
        finest = MIN_NOISE * iterate.at.radius
        if weights.span > 1.0 or all(group.trust is None for group in iterate.groups):
            return weights._replace(noise=max(weights.noise * equations.noise_factor(size), finest))
        noise, vertical = equations.noise_factors(np.array([size, 0.0])).tolist()
        return weights._replace(
            noise=max(weights.noise * noise, finest), vertical=max(weights.vertical * vertical, MIN_VERTICAL_SIGMA)
        )


JointIterate: TypeAlias = Iterate[Parameters, ObservationGroup, Weights]


def find_mounting(attitudes: Floats, seen: Floats, rotation: Floats) -> Floats:
    """Mounting of a magnetometer on a body of known attitude: the assumed one, unless another is much better.

    The search starts at each of the 24 axis rotations R. Two steps are repeated: the mean direction m = Σ C R q of the
    field is computed, then the rotation that maps all q closest to Cᵀ m (Wahba's problem, by singular values).

    Parameters
    ----------
    attitudes : (N, 3, 3) float
        C, rotations from body axes to world axes.
    seen : (N, 3) float
        q, field directions in the magnetometer's own axes, of about unit length.
    rotation : (3, 3) float
        The assumed mounting, from the magnetometer's axes to the body's.

    Returns
    -------
    (3, 3) float
        The mounting.

    >>> from flinders.geometry.quaternions import from_angles
    >>> angles = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    >>> attitudes = attitude.body_to_world(from_angles(angles))
    >>> upturned = np.swapaxes(attitudes, 1, 2) @ [0.6, 0.0, 0.8] * [1.0, -1.0, -1.0]
    >>> find_mounting(attitudes, upturned, np.eye(3)).round(6) + 0.0
    array([[ 1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0., -1.]])
    """
    if not len(seen):
        return rotation
    ways = np.stack([rotation, *(axes.apply(np.eye(3)).T for axes in AXIS_ROTATIONS)])
    pairs = np.einsum("nij,nk->nijk", attitudes, seen).mean(axis=0)  # mean of C_ij q_k, sufficient for all mountings
    for _ in range(MOUNTING_ITERATIONS):
        north = np.einsum("ijk,wjk->wi", pairs, ways)
        left, _, right = np.linalg.svd(np.einsum("wi,ijk->wjk", north, pairs))
        left[:, :, 2] *= np.linalg.det(left @ right)[:, np.newaxis]
        ways[1:] = (left @ right)[1:]
    lengths = np.linalg.norm(np.einsum("ijk,wjk->wi", pairs, ways), axis=1)
    scattered = np.maximum(np.mean(np.sum(seen**2, axis=1)) - lengths**2, 0.0)  # variance about the mean
    best = int(np.argmin(scattered))
    best_rotation: Floats = ways[best] if MIN_SCATTER_DROP**2 * scattered[best] < scattered[0] else rotation
    return best_rotation


def group_readings(samples: Samples, terms: Sequence[str], window_s: float) -> tuple[list[ObservationGroup], float]:
    """Groups of readings with a common direction, and the time in s between the readings of a window."""
    auxiliary = _Attitudes.of(samples, terms)
    every = np.arange(len(samples), dtype=np.intp)
    if "rate" not in terms or samples.rate is None or samples.time is None:
        return [_make_group(samples, every[:, np.newaxis], auxiliary)], 0.0
    inside = gyro.window_rows(samples.time, samples.rate, window_s=window_s)
    groups = []
    interval = 0.0
    if len(inside):
        steps = np.diff(samples.time[inside], axis=1)
        interval = float(np.median(steps))
        intervals = np.concatenate([steps, steps[:, -1:]], axis=1)
        turned = gyro.integrate_rates(np.nan_to_num(samples.rate[inside]), intervals, np.zeros(3))
        groups.append(replace(_make_group(samples, inside, auxiliary), turned=turned))
    rest = np.setdiff1d(every, inside.ravel())[:, np.newaxis]
    if len(rest):
        groups.append(_make_group(samples, rest, auxiliary))
    return groups, interval


class _Attitudes(NamedTuple):
    """(N, 3, 3) attitudes or (N, 3) verticals of N readings, and their (N,) weights, 0 to 1."""

    attitudes: Floats | None = None
    down: Floats | None = None
    trust: Floats | None = None

    @classmethod
    def of(cls, samples: Samples, terms: Sequence[str]) -> Self:
        """Attitudes if the terms contain ``attitude``; else verticals of the accelerometer, or of logged attitudes."""
        if "attitude" in terms and samples.attitude is not None:
            matrices = attitude.body_to_world(samples.attitude)
            known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
            matrices[~known] = np.eye(3)
            return cls(attitudes=matrices, trust=known.astype(float))
        if "dip" in terms and samples.acceleration is not None:
            return cls(None, *dip.accelerometer_verticals(samples.acceleration))
        if "tilt" in terms and samples.attitude is not None:
            return cls(None, *dip.attitude_verticals(samples.attitude))
        return cls()


def _make_group(samples: Samples, rows: NDArray[np.intp], auxiliary: _Attitudes) -> ObservationGroup:
    """Make the group of (W, n) readings."""
    return ObservationGroup(
        rows,
        make_contiguous(samples.field[rows]),
        np.ones(rows.shape),
        attitudes=None if auxiliary.attitudes is None else make_contiguous(auxiliary.attitudes[rows], 2),
        down=None if auxiliary.down is None else make_contiguous(auxiliary.down[rows]),
        trust=None if auxiliary.trust is None else auxiliary.trust[rows],
    )


def start_iterate(problem: JointProblem, at: Parameters) -> JointIterate:
    """Start of the iteration at given parameters, with directions from the readings and noises from the residuals."""
    groups = tuple(group.at(at) for group in problem.groups)
    directions = tuple(group.guess(at) for group in groups)
    squares, counts = np.zeros(2), np.zeros(2)
    for group, known in zip(groups, directions, strict=True):
        residual, auxiliary = unweighted_residuals(group, at, known)
        squares[0] += float(np.sum(residual**2))
        counts[0] += 3.0 * residual.shape[0] * residual.shape[1] - 2.0 * len(known)
        if auxiliary is not None and group.trust is not None:
            squares[1] += float(np.sum(np.sum(auxiliary**2, axis=2) * group.trust))
            counts[1] += float(np.count_nonzero(group.trust)) * auxiliary.shape[2]
    noise, vertical = np.sqrt(squares / np.maximum(counts, 1.0)).tolist()
    weights = Weights(
        float(np.clip(noise, MIN_NOISE * at.radius, MAX_START_NOISE * at.radius)),
        float(np.clip(vertical, MIN_VERTICAL_SIGMA, MAX_START_NOISE)),
    )
    return Iterate(at, groups, directions, weights)


def has_misfit(iterate: JointIterate) -> bool:
    """Whether the model does not fit: residuals are much larger than their changes between consecutive readings."""
    total, steps, count, pairs = 0.0, 0.0, 0, 0
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        residual, auxiliary = unweighted_residuals(group, iterate.at, directions)
        weight = group.weight
        if group.turned is None:
            if group.attitudes is None or auxiliary is None or group.trust is None:
                continue
            residual, weight = np.swapaxes(auxiliary, 0, 1), group.trust.T  # single readings in time order
        residual = residual * np.sqrt(weight)[..., np.newaxis]
        total += float(np.sum(residual**2))
        steps += 0.5 * float(np.sum(np.diff(residual, axis=1) ** 2))
        count, pairs = count + residual.size, pairs + residual[:, 1:].size
    return count > 0 and total / count > MIN_MISFIT_RATIO**2 * steps / max(pairs, 1)


def _reweigh_group(
    group: ObservationGroup,
    original: ObservationGroup,
    at: Parameters,
    directions: Floats,
    weights: Weights,
    *,
    is_robust: bool,
) -> ObservationGroup:
    """Reduce the weight of verticals and attitudes with large residuals, and of readings if `is_robust`."""
    residual, auxiliary = unweighted_residuals(group, at, directions)
    if is_robust:
        redescending = huber_weights(lengths(residual) / weights.noise) ** 2
        group = replace(group, weight=original.weight * redescending)
    if auxiliary is None or original.trust is None:
        return group
    length = np.sqrt(np.einsum("wni,wni->wn", auxiliary, auxiliary)) / weights.vertical
    beyond = HUBER_SIGMAS if group.attitudes is None else attitude.ATTITUDE_HUBER
    return replace(group, trust=original.trust * group.weight * huber_weights(length, beyond=beyond))


def deviance(problem: JointProblem, iterate: JointIterate) -> float:
    """Deviance of a fit, −2 log of its probability up to a constant."""
    counts = np.zeros(2)
    for group in iterate.groups:
        observed = 0 if group.trust is None else int(np.count_nonzero(group.trust))
        counts += [3.0 * group.count, observed * (1.0 / iterate.weights.span if group.attitudes is None else 2.0)]
    return float(2.0 * counts @ np.log(iterate.weights[:2])) + problem.prior_equations(iterate.at).cost
