"""The solver of `flinders.estimators.aiding`: what is to be found, and the way down to it.

Levenberg–Marquardt on the normal equations of all groups of readings, each with its own directions of the field
eliminated. Both variances, of readings and of verticals, come from the residuals by Fisher's scoring (components of
variance), once a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.errors import FitError
from flinders.estimators.auto import Auto
from flinders.estimators.data import Readings
from flinders.estimators.mounting import TURNS
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.rotation import across, in_pieces
from flinders.likelihood import attitude, dip, gyro, prior
from flinders.likelihood.dip import ACCELERATION_SIGMA
from flinders.likelihood.equations import FINEST, NormalEquations
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.observations import Linearised, ObservationGroup, Weights, cost_of, linearised, residuals_of
from flinders.likelihood.parameters import BLOCKS, ParameterLayout, Parameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.likelihood.disturbance import Disturbances
    from flinders.likelihood.site_field import Site

STEPS: Final = 60
"""Of Levenberg and Marquardt; ten are usual."""

SETTLED: Final = 1e-3
"""Standard deviations: a step shorter than this in all parameters is the last."""

LONGEST_STEP: Final = 0.5
"""Of the radius: a longer step is cut."""

FEWEST_LEFT: Final = 0.8
"""Share of the readings that have to belong: where fewer do, the model is wrong and not the readings."""

STRAY: Final = 6.0
"""Times the median residual beyond which a reading does not belong to the rest."""

LEAST_CHANGE: Final = 0.2
"""Of a variance in one step: what is far off is approached."""

FINEST_VERTICAL: Final = 1e-4
"""rad: no vertical is known better."""

LOUDEST: Final = 0.1
"""Of the field, and rad: what noises begin with at most."""

SAME: Final = 1e-2
"""Relative change of a standard deviation that is none."""

MOST_DAMPING: Final = 1e9
"""Beyond which no step makes the fit better."""

STILLER: Final = 2.0
"""Times less that the field outliers in the world: so much makes another way to sit than was thought a start."""

SEATED: Final = 10
"""Rounds of finding where the field points, and how the magnetometer is mounted for it."""

MANY_ATTITUDES: Final = 1000
"""Attitudes that a start is found from."""

MISFIT: Final = 1.5
"""Times larger than the noise from one reading to the next: residuals that another start may do away with."""


@dataclass(frozen=True, slots=True, eq=False)
class JointProblem:
    """Groups of readings, and what is thought of the parameters before.

    Attributes
    ----------
    groups : tuple of ObservationGroup
    layout : ParameterLayout
    aiding : tuple of str
    site : Site, optional
    spread : float
    middle : (3,) float
    width : float
        Mean reading, and spread of the readings about it.
    rotation : (3, 3) float
        About which the prior of the rotation lies.
    disturbances : Disturbances, optional
    interval : float, s
        Between two readings of a window.
    gyro_scale : float
        What the scales of the gyro may be off by, 1 σ; 0 holds them.
    acceleration_bias : float, m/s²
        What the accelerometer may be off by on each axis, 1 σ; 0 holds it.
    """

    groups: tuple[ObservationGroup, ...]
    layout: ParameterLayout
    aiding: tuple[str, ...]
    site: Site | None
    spread: float
    middle: Floats
    width: float
    rotation: Floats
    disturbances: Disturbances | None
    interval: float
    gyro_scale: float = SCALE_SIGMA
    acceleration_bias: float = ACCELERATION_SIGMA

    @classmethod
    def of(
        cls,
        samples: Samples,
        terms: tuple[str, ...],
        site: Site | None,
        disturbances: Disturbances | None,
        rotation: Floats | None,
        spread: float,
        window_s: float,
        *,
        delay: bool,
        gyro_scale: float = SCALE_SIGMA,
        acceleration_bias: float = ACCELERATION_SIGMA,
    ) -> Self:
        """Put the readings in groups, and lay out what is to be found."""
        if disturbances is not None and disturbances.constant:
            disturbances = disturbances.without(disturbances.constant)
        groups, interval = grouped(samples, terms, disturbances, window_s)
        in_windows = any(group.turned is not None for group in groups)
        upright = any(group.down is not None for group in groups)
        pointed = any(group.attitudes is not None for group in groups)
        layout = ParameterLayout.of(
            disturbances=0 if disturbances is None else len(disturbances.names),
            rotation=in_windows or upright or pointed,
            slope=disturbances is not None and disturbances.warmth is not None,
            gyro_bias=in_windows,
            gyro_scale=in_windows and gyro_scale > 0.0,
            gyro_turn=in_windows and gyro_scale > 0.0 and (upright or pointed),
            delay=in_windows and delay,
            sine=upright,
            direction=pointed,
        )
        middle = samples.field.mean(axis=0)
        width = float(np.sqrt(np.mean(np.sum((samples.field - middle) ** 2, axis=1))))
        turned = np.eye(3) if rotation is None else rotation
        chunks = tuple(chunk for group in groups for chunk in group.chunks())
        return cls(
            chunks,
            layout,
            terms,
            site,
            spread,
            middle,
            width,
            turned,
            disturbances,
            interval,
            gyro_scale,
            acceleration_bias,
        )

    def freed(self) -> Self:
        """The same with the bias of an accelerometer among what is found, where there is one.

        On the way there it is held: noise pretends so much of it that the way down could lead anywhere.
        """
        if self.acceleration_bias <= 0.0 or "dip" not in self.aiding or "sine" not in self.layout:
            return self
        count = 0 if self.disturbances is None else len(self.disturbances.names)
        free = dict.fromkeys(self.layout.columns.keys() - {"disturbances"}, True)
        return replace(self, layout=ParameterLayout.of(disturbances=count, **free, acceleration_bias=True))

    def begin(self, ellipsoid: Ellipsoid) -> Parameters:
        """Where to start, with directions and dip that follow from an ellipsoid."""
        count = 0 if self.disturbances is None else len(self.disturbances.names)
        at = replace(Parameters.at(ellipsoid.centre, ellipsoid.shape, disturbances=count), rotation=self.rotation)
        return self.facing(replace(at, rotation=self._aligned(at)))

    def begin_near(self, near: Parameters, layout: ParameterLayout) -> Parameters:
        """Where to start with what a fit of another `ParameterLayout` has found, of as many drivers."""
        free = ("rotation", "disturbances", "slope", "gyro_bias", "gyro_scale", "gyro_turn", "delay")
        values = {name: getattr(near, name) for name in free if name in layout and name in self.layout}
        at = replace(self.begin(Ellipsoid(near.offset, near.shape)), **values)
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

    def believed(self, at: Parameters) -> NormalEquations:
        """What was thought before, in standard deviations."""
        size = self.layout.size
        matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        ellipsoid = Ellipsoid(at.offset, at.shape)
        of_shape = prior.equations(ellipsoid, spread=self.spread) + prior.sense(ellipsoid, self.middle, self.width)
        matrix[:9, :9], gradient[:9], cost = of_shape.matrix, of_shape.gradient, of_shape.cost
        for name, value, sigma in self._priors(at):
            columns = self.layout.columns[name]
            matrix[columns, columns] += np.eye(columns.stop - columns.start) / sigma**2
            gradient[columns] -= value / sigma**2
            cost += float(np.sum(np.square(value))) / sigma**2
        if self.site is not None and self.site.strength is not None:
            row = np.zeros(size)
            width = self.site.gain_sigma * self.site.strength
            row[3:6] = 1.0 / (3.0 * width)
            left = (self.site.strength - float(np.trace(at.shape)) / 3.0) / width
            matrix, gradient, cost = matrix + np.outer(row, row), gradient + row * left, cost + left**2
        if self.site is not None and self.site.sine is not None and "direction" in self.layout:
            row = np.zeros(size)
            row[self.layout.columns["direction"]] = across(at.direction)[2] / self.site.sine_sigma
            left = (self.site.sine - float(at.direction[2])) / self.site.sine_sigma
            matrix, gradient, cost = matrix + np.outer(row, row), gradient + row * left, cost + left**2
        return NormalEquations(matrix, gradient, cost, 0)

    def _priors(self, at: Parameters) -> Iterator[tuple[str, Floats | float, float]]:
        """Blocks that are thought to be near zero, or near what is known, with their standard deviations."""
        turned = at.rotation @ self.rotation.T
        angle = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
        asked = {
            "gyro_scale": self.gyro_scale, "gyro_turn": self.gyro_scale,
            "acceleration_bias": self.acceleration_bias / dip.GRAVITY,
        }  # fmt: skip
        for name, _, sigma in BLOCKS:
            if sigma is not None and name in self.layout:
                yield name, angle if name == "rotation" else getattr(at, name), asked.get(name, sigma)
        if self.site is not None and self.site.sine is not None and "sine" in self.layout:
            yield "sine", at.sine - self.site.sine, self.site.sine_sigma


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

    Examples
    --------
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


def grouped(
    samples: Samples, terms: Sequence[str], disturbances: Disturbances | None, window_s: float
) -> tuple[list[ObservationGroup], float]:
    """Put readings that share a direction together, and say how far apart those of a window are, in s."""
    auxiliary = _Attitudes.of(samples, terms)
    every = np.arange(len(samples), dtype=np.intp)
    if "rate" not in terms or samples.rate is None or samples.time is None:
        return [_group(samples, every[:, np.newaxis], auxiliary, disturbances)], 0.0
    inside = gyro.windows(samples.time, samples.rate, window_s=window_s)
    groups = []
    interval = 0.0
    if len(inside):
        steps = np.diff(samples.time[inside], axis=1)
        interval = float(np.median(steps))
        intervals = np.concatenate([steps, steps[:, -1:]], axis=1)
        turned = gyro.integrated(np.nan_to_num(samples.rate[inside]), intervals, np.zeros(3))
        groups.append(replace(_group(samples, inside, auxiliary, disturbances), turned=turned))
    rest = np.setdiff1d(every, inside.ravel())[:, np.newaxis]
    if len(rest):
        groups.append(_group(samples, rest, auxiliary, disturbances))
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


def _group(
    samples: Samples, rows: NDArray[np.intp], auxiliary: _Attitudes, disturbances: Disturbances | None
) -> ObservationGroup:
    """Take what belongs to (W, n) readings."""
    return ObservationGroup(
        rows,
        in_pieces(samples.field[rows]),
        np.ones(rows.shape),
        attitudes=None if auxiliary.attitudes is None else in_pieces(auxiliary.attitudes[rows], 2),
        down=None if auxiliary.down is None else in_pieces(auxiliary.down[rows]),
        trust=None if auxiliary.trust is None else auxiliary.trust[rows],
        disturbances=None if disturbances is None or not disturbances.names else disturbances.columns[rows],
        warmth=None if disturbances is None or disturbances.warmth is None else disturbances.warmth[rows],
    )


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """Where the iteration stands.

    Attributes
    ----------
    at : Parameters
    groups : tuple of ObservationGroup
        With weights, trust and integrated rates as they are now.
    directions : tuple of (W, 3) float
    weights : Weights
    """

    at: Parameters
    groups: tuple[ObservationGroup, ...]
    directions: tuple[Floats, ...]
    weights: Weights

    @property
    def misfits(self) -> bool:
        """Residuals are larger than what they change by from one reading to the next."""
        total, steps, count, pairs = 0.0, 0.0, 0, 0
        for group, directions in zip(self.groups, self.directions, strict=True):
            residual, auxiliary = residuals_of(group, self.at, directions)
            if group.turned is None:
                if group.attitudes is None or auxiliary is None:
                    continue
                residual = np.swapaxes(auxiliary, 0, 1)  # readings have a direction each: one after the other
            total += float(np.sum(residual**2))
            steps += 0.5 * float(np.sum(np.diff(residual, axis=1) ** 2))
            count, pairs = count + residual.size, pairs + residual[:, 1:].size
        return count > 0 and total / count > MISFIT**2 * steps / max(pairs, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Of all groups and the prior, in standard deviations."""

    parts: tuple[Linearised, ...]
    matrix: Floats
    gradient: Floats
    bent: Floats
    prior: NormalEquations

    @property
    def cost(self) -> float:
        """χ² of everything."""
        return self.prior.cost + sum(part.cost for part in self.parts)

    @classmethod
    def of(cls, problem: JointProblem, iterate: Iterate) -> Self:
        """Linearise everything."""
        parts = tuple(
            linearised(group, iterate.at, directions, problem.layout, iterate.weights)
            for group, directions in zip(iterate.groups, iterate.directions, strict=True)
        )
        size = problem.layout.size
        matrix, gradient, bent = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for part in parts:
            matrix, gradient, bent = matrix + part.matrix, gradient + part.gradient, bent + part.bent
        return cls(parts, matrix, gradient, bent, problem.believed(iterate.at))

    def weights(self, problem: JointProblem, iterate: Iterate) -> Weights:
        """What the residuals say of each kind of noise: a step of Fisher's scoring for both variances."""
        squares = sum((part.squares for part in self.parts), np.zeros(2))
        expected = sum((part.expected for part in self.parts), np.zeros(2)) - [problem.layout.size, 0.0]
        curvature = sum((part.curvature for part in self.parts), np.zeros((2, 2)))
        floor = FINEST * float(np.cbrt(np.linalg.det(iterate.at.shape)))
        if curvature[1, 1] <= 0.0 or iterate.weights.span > 1.0:  # verticals that are correlated are weighed as a whole
            factor = float(squares[0]) / max(float(expected[0]), 1.0)
            return iterate.weights._replace(noise=max(iterate.weights.noise * math.sqrt(factor), floor))
        change = np.linalg.lstsq(curvature, squares - expected, rcond=1e-6)[0]
        noise, vertical = np.sqrt(np.clip(1.0 + change, LEAST_CHANGE, 1.0 / LEAST_CHANGE)).tolist()
        return iterate.weights._replace(
            noise=max(iterate.weights.noise * noise, floor),
            vertical=max(iterate.weights.vertical * vertical, FINEST_VERTICAL),
        )


def starts(samples: Samples, site: Site | None) -> Iterable[Ellipsoid]:
    """Ellipsoids to begin with: that of all readings, and spheres about them."""
    known = site.strength if site is not None else None
    try:
        estimate = Auto().estimate(Readings.of(samples.field))
        if not estimate.plane and not estimate.unobserved:
            yield estimate.ellipsoid
    except FitError:
        pass
    middle = samples.field.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((samples.field - middle) ** 2, axis=1))))
    if spread > 0.0:
        yield Ellipsoid(middle, (known or spread) * np.eye(3))
        for lift in (1.0, -1.0, 2.0, -2.0):
            normal = np.linalg.eigh(np.cov(samples.field.T))[1][:, 0]
            radius = spread * math.hypot(1.0, lift)
            yield Ellipsoid(middle + lift * spread * normal, (known or radius) * np.eye(3))


def initial(problem: JointProblem, at: Parameters) -> Iterate:
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
    radius = float(np.cbrt(np.linalg.det(at.shape)))
    widest = Weights(LOUDEST * radius, LOUDEST)
    return Iterate(
        at,
        groups,
        directions,
        Weights(
            float(np.clip(noise, FINEST * radius, widest.noise)),
            float(np.clip(vertical, FINEST_VERTICAL, widest.vertical)),
        ),
    )


def iterated(problem: JointProblem, iterate: Iterate) -> Iterate:
    """Take steps until they are small beside what is claimed, with the weights that residuals ask for."""
    damping = 1e-3
    for _ in range(STEPS):
        equations = Equations.of(problem, iterate)
        matrix, gradient = equations.matrix + equations.prior.matrix, equations.gradient + equations.prior.gradient
        step: Floats = gradient
        before, moved = equations.cost, None
        while moved is None and damping < MOST_DAMPING:
            step = solved(matrix, gradient, damping)
            moved = _stepped(problem, iterate, equations, step, before)
            damping = damping * 8.0 if moved is None else max(damping / 10.0, 1e-12)
        weighed = reweighed(problem, iterate if moved is None else moved, equations)
        is_weighed = bool(np.all(np.abs(np.log(np.divide(weighed.weights, iterate.weights))) < SAME))
        is_small = moved is None or (float(step @ matrix @ step) < SETTLED**2 * len(step) and damping < 1.0)
        iterate, damping = weighed, min(damping, 1.0)
        if is_weighed and is_small:
            break
    return iterate


def reweighed(problem: JointProblem, iterate: Iterate, equations: Equations) -> Iterate:
    """Weigh each kind of residual by its noise, and trust verticals with a large residual less."""
    weights = equations.weights(problem, iterate)
    groups = tuple(
        _retrusted(group, original, iterate.at, directions, weights)
        for group, original, directions in zip(iterate.groups, problem.groups, iterate.directions, strict=True)
    )
    return replace(iterate, weights=weights, groups=groups)


def _retrusted(
    group: ObservationGroup, original: ObservationGroup, at: Parameters, directions: Floats, weights: Weights
) -> ObservationGroup:
    """Trust verticals and attitudes with a large residual less than what was recorded with them asks for."""
    _, auxiliary = residuals_of(group, at, directions)
    if auxiliary is None or original.trust is None:
        return group
    length = np.sqrt(np.einsum("wni,wni->wn", auxiliary, auxiliary)) / weights.vertical
    beyond = dip.HUBER if group.attitudes is None else attitude.HUBER
    return replace(group, trust=original.trust * group.weight * dip.huber(length, beyond=beyond))


def solved(matrix: Floats, gradient: Floats, damping: float) -> Floats:
    """The damped step, in a scale in which the matrix has ones on its diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    damped = scaled + damping * np.eye(len(scale))
    try:
        step: Floats = np.linalg.solve(damped, gradient / scale) / scale
    except np.linalg.LinAlgError:  # nothing speaks for one of them, and it stays
        step = np.linalg.lstsq(damped, gradient / scale, rcond=None)[0] / scale
    return step


def _stepped(
    problem: JointProblem, iterate: Iterate, equations: Equations, step: Floats, before: float
) -> Iterate | None:
    """Take a step if it leads to a closed surface and costs no more."""
    largest = float(np.abs(step[:9]).max()) / float(np.cbrt(np.linalg.det(iterate.at.shape)))
    tried = stepped(problem, iterate, equations, step * min(1.0, LONGEST_STEP / max(largest, 1e-300)))
    if tried is None or not _cost(problem, tried) <= before * (1.0 + 1e-9) + 1e-6:
        return None
    return tried


def stepped(problem: JointProblem, iterate: Iterate, equations: Equations, step: Floats) -> Iterate | None:
    """Where a step leads; None where the surface is not closed."""
    at = iterate.at.moved(step, problem.layout)
    axes = np.linalg.eigvalsh(at.shape)
    if not axes[0] > 1e-3 * axes[2]:
        return None
    groups = tuple(group.at(at) for group in iterate.groups)
    directions = tuple(
        part.follow(known, step) for part, known in zip(equations.parts, iterate.directions, strict=True)
    )
    return replace(iterate, at=at, groups=groups, directions=directions)


def _cost(problem: JointProblem, iterate: Iterate) -> float:
    """χ² of everything."""
    return problem.believed(iterate.at).cost + sum(
        cost_of(group, iterate.at, directions, iterate.weights)
        for group, directions in zip(iterate.groups, iterate.directions, strict=True)
    )


def deviance(problem: JointProblem, iterate: Iterate) -> float:
    """−2 log of how probable a fit is, but for what all fits to these readings share."""
    counts = np.zeros(2)
    for group in iterate.groups:
        observed = 0 if group.trust is None else int(np.count_nonzero(group.trust))
        counts += [3.0 * group.count, observed * (1.0 / iterate.weights.span if group.attitudes is None else 2.0)]
    return float(2.0 * counts @ np.log(iterate.weights[:2])) + problem.believed(iterate.at).cost


def without_outliers(problem: JointProblem, iterate: Iterate) -> Iterate:
    """Leave out readings that do not belong to the rest, and go on without them."""
    for _ in range(3):
        groups = tuple(
            replace(group, weight=_inlier_weights(group, iterate, directions))
            for group, directions in zip(iterate.groups, iterate.directions, strict=True)
        )
        if all(np.array_equal(new.weight, old.weight) for new, old in zip(groups, iterate.groups, strict=True)):
            break
        iterate = iterated(problem, replace(iterate, groups=groups))
    return iterate


def _inlier_weights(group: ObservationGroup, iterate: Iterate, directions: Floats) -> Floats:
    """(W, n) 1 for a reading that belongs, 0 for one whose residual is far beyond the usual; all where many are."""
    residual, _ = residuals_of(group, iterate.at, directions)
    length = np.sqrt(np.einsum("wni,wni->wn", residual, residual))
    usual = max(float(np.median(length)), iterate.weights.noise * 1e-3)
    belongs = (length <= STRAY * usual).astype(float)
    return belongs if belongs.mean() > FEWEST_LEFT else np.ones_like(belongs)
