"""Several magnetometers on one body: one direction of the field at each moment, seen by all.

Minimises over all sensors i and moments k, each sensor in its own noise σᵢ,

    Σ |xᵢₖ − bᵢ − Sᵢ Rᵢᵀ qₖ|² / σᵢ²   over (bᵢ, Sᵢ, Rᵢ) and qₖ, |qₖ| = 1

with R = 1 for the reference. Each direction qₖ is eliminated (`flinders.likelihood.observations`): of 3m readings 3m −
2 are left, m of them lengths, and 2(m − 1) that hold the directions of the sensors against each other. The σᵢ come from
their residuals by Fisher's scoring, the mean gradient that noise makes on the sphere is taken off, and a reading that
does not belong to the others is left out.

What it gives: how the sensors are turned against each other, and to each what the others know. Readings of two sensors
are an affine map of each other, so that a noisy sensor becomes nearly as good as the best one beside it. What it does
not give: coverage. A body that was not turned over leaves open for all of them what it leaves open for one.

Source: eliminating nuisance parameters as in B. Triggs et al., *Bundle Adjustment*, 2000; the model of a reading is
that of M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016), eq. 1.

>>> rng = np.random.default_rng(1)
>>> q = rng.normal(size=(800, 3))
>>> q /= np.linalg.norm(q, axis=1, keepdims=True)
>>> turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])      # from the second's into the first's
>>> first = 50.0 * q + [10.0, 0.0, -5.0] + rng.normal(scale=0.5, size=q.shape)
>>> second = 40.0 * q @ turned + [0.0, 30.0, 0.0] + rng.normal(scale=0.5, size=q.shape)
>>> joint = solve(np.stack([first, second]))
>>> joint.parameters[1].rotation.round(2) + 0.0
array([[ 0.,  1.,  0.],
       [-1.,  0.,  0.],
       [ 0.,  0.,  1.]])
>>> bool(np.all(np.abs(joint.parameters[1].offset - [0, 30, 0]) < 4 * np.sqrt(np.diag(joint.of(1))[:3])))
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.errors import FitError, NotAnEllipsoid, TooFewSamples
from flinders.estimators.auto import Auto
from flinders.estimators.base import Estimate
from flinders.estimators.covariance import Residuals
from flinders.estimators.data import Readings
from flinders.estimators.solver import solved
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.rotation import across
from flinders.likelihood import prior
from flinders.likelihood.equations import FINEST, NormalEquations
from flinders.likelihood.identifiability import Support
from flinders.likelihood.observations import (
    Linearised,
    ObservationGroup,
    ObservationRows,
    Weights,
    eliminated,
    inverse_of,
    rows_of,
)
from flinders.likelihood.parameters import ParameterLayout, Parameters

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

ROOM: Final = 4096
"""Moments worked on at a time, whatever the length of the recording."""

ENOUGH: Final = 10_000
"""Moments on which the fit is iterated; of a longer recording all are gone through from there."""

TRIED: Final = 1_000
"""Moments on which starts are tried."""

GLANCE: Final = 2_000
"""Moments from which noise-induced information is computed."""

STEPS: Final = 60
"""Of Levenberg and Marquardt; ten are usual."""

SETTLED: Final = 1e-3
"""Standard deviations: a step shorter than this in all parameters is the last."""

CORRECTED: Final = 4
"""Steps with the mean gradient of the noise taken off."""

ROTATION_SIGMA: Final = 0.35
"""rad: how far from where it began a rotation is thought to be, where nothing sees it."""

MIRROR_MARGIN: Final = 2.0
"""Times smaller that the residual of a mirror image has to be."""

LEAST_CHANGE: Final = 0.2
"""Of a variance in one step: what is far off is approached."""

SAME: Final = 1e-2
"""Relative change of a standard deviation that is none."""

MOST_DAMPING: Final = 1e9
LONGEST_STEP: Final = 0.5
"""Of the radius: a longer step is cut."""

STRAY: Final = 6.0
"""Times the median residual of a sensor beyond which its reading does not belong to the others."""

ROUNDS: Final = 6
"""In which readings are left out, of each moment the worst at first."""

FEWEST_LEFT: Final = 0.5
"""Share of a sensor's readings that have to belong: where fewer do, all stay, and its noise is as large as that."""

FEWEST: Final = 24
"""Moments that are needed."""

SPREAD_OUT: Final = 5.0
"""Times the noise that readings have to be thick for an affine map from them to be looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Several:
    """What was found.

    Attributes
    ----------
    parameters : tuple of Parameters
        Of each sensor; `rotation` takes vectors in its axes into those of the reference. It has the determinant −1
        where the axes of the sensor are a mirror image of those.
    reference : int
        Whose rotation is 1.
    columns : tuple of slice
        Of each sensor: offset, shape, and but for the reference the rotation vector, on the left.
    covariance, textbook : (P, P) float
        Of all parameters, and the same if all residuals were independent.
    noise : (m,) float
        Standard deviation of a component of a reading, in the unit of each sensor.
    directions : (N, 3) float
        Of the field at each moment, in the axes of the reference.
    is_inlier : (m, N) bool
        Readings that are there, and agree with the others.
    prior_influence : (m,) float
        Share of the least known parameter of each shape that the prior speaks for.
    unobserved : int
        Directions of parameter space of which the readings say nothing.
    excess_variance : float
        Factor by which stretches of the recording scatter more than their residuals explain, in variance.
    """

    parameters: tuple[Parameters, ...]
    reference: int
    columns: tuple[slice, ...]
    covariance: Floats
    textbook: Floats
    noise: Floats
    directions: Floats
    is_inlier: NDArray[np.bool_]
    prior_influence: Floats
    unobserved: int
    excess_variance: float

    def of(self, sensor: int) -> Floats:
        """(9 or 12, 9 or 12) covariance of the parameters of one sensor."""
        part: Floats = self.covariance[self.columns[sensor], self.columns[sensor]]
        return part

    def rotation(self, sensor: int, into: int | None = None) -> tuple[Floats, Floats]:
        """(3, 3) from the axes of one sensor into those of another, by default the reference, and its covariance.

        Returns
        -------
        rotation : (3, 3) float
        covariance : (3, 3) float, rad²
            Of the rotation vector, in the axes of that other sensor.
        """
        other = self.reference if into is None else into
        back = self.parameters[other].rotation.T
        turn = np.zeros((3, len(self.covariance)))
        for which, sign in ((sensor, 1.0), (other, -1.0)):
            if which != self.reference:
                first = self.columns[which].start + 9
                turn[:, first : first + 3] += sign * np.eye(3)
        # a rotation vector is an axial one: where a mirror image takes it back, its sign changes
        axial = back * float(np.linalg.det(back))
        return back @ self.parameters[sensor].rotation, axial @ turn @ self.covariance @ turn.T @ axial.T

    def corrected(self, sensor: int, field: Floats) -> Floats:
        """(N, 3) unit-length field in the axes of the reference, of (N, 3) readings of a sensor."""
        at = self.parameters[sensor]
        turned: Floats = (field - at.offset) @ np.linalg.inv(at.ellipsoid_like).T
        return turned

    def estimate(self, sensor: int) -> Estimate:
        """The ellipsoid of one sensor with its marginal covariance, as every other method gives it."""
        at, nine = self.parameters[sensor], self.columns[sensor].start + np.arange(9)
        return Estimate(
            Ellipsoid(at.offset, at.shape),
            self.covariance[np.ix_(nine, nine)],
            float(self.noise[sensor]),
            "together",
            prior_influence=float(self.prior_influence[sensor]),
            textbook=self.textbook[np.ix_(nine, nine)],
            used=int(np.count_nonzero(self.is_inlier[sensor])),
            unobserved=self.unobserved,
        )


def solve(
    fields: Floats,
    *,
    reference: int = 0,
    starts: Sequence[Estimate | None] | None = None,
    spread: float = prior.SPREAD,
) -> Several:
    """Fit several magnetometers of one body.

    Parameters
    ----------
    fields : (m, N, 3) float
        Readings of each at the same N moments, each sensor in its own unit and axes; NaN where it has none.
    reference : int
        Into whose axes the others are turned.
    starts : sequence of Estimate or None, optional
        What each finds by itself; by default what `Auto` finds.
    spread : float
        Of the prior on each shape, see `flinders.likelihood.prior`.

    Raises
    ------
    TooFewSamples
        For fewer moments than parameters.
    NotAnEllipsoid
        If no step leads to closed surfaces.
    """
    shared = np.count_nonzero(np.isfinite(fields[:, :, 0]).sum(axis=0) > 1)
    if shared < FEWEST:
        raise TooFewSamples(found=int(shared), needed=FEWEST, method="together")
    alone = [_alone(field) for field in fields] if starts is None else list(starts)
    few = fields[:, :: max(1, fields.shape[1] // TRIED)]
    best: _State | None = None
    for begin in _begins(few, reference, alone):
        state = _settled(_Problem.of(few, reference, begin, spread), begin)
        if state is not None and (best is None or _misfit(state) < _misfit(best)):
            best = state
    if best is None:
        raise NotAnEllipsoid((float("nan"),) * 3, "together")
    thinned = fields[:, :: max(1, fields.shape[1] // ENOUGH)]
    best = _without_outliers(_iterated(best.over(thinned)))
    if thinned.shape[1] < fields.shape[1]:
        best = _without_outliers(best.over(fields))
    return _finished(best, alone)


def mirror_or_rotation(seen: Floats, into: Floats) -> Floats:
    """(3, 3) orthogonal matrix that turns (N, 3) directions into others; a mirror image where that fits far better.

    Minimises Σ |vₖ − R uₖ|² (Kabsch), once among rotations and once among mirror images.

    >>> directions = np.random.default_rng(1).normal(size=(50, 3))
    >>> mirror_or_rotation(directions * [1, 1, -1], directions).round(6).diagonal()
    array([ 1.,  1., -1.])
    """
    left, _, right = np.linalg.svd(into.T @ seen)
    sign = float(np.sign(np.linalg.det(left @ right)))
    proper = (left * [1.0, 1.0, sign]) @ right
    mirrored: Floats = (left * [1.0, 1.0, -sign]) @ right
    off = [float(np.sum((into - seen @ turn.T) ** 2)) for turn in (proper, mirrored)]
    return mirrored if off[1] * MIRROR_MARGIN**2 < off[0] else proper


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Readings, and what is thought of the parameters before."""

    fields: Floats
    there: NDArray[np.bool_]
    reference: int
    layouts: tuple[ParameterLayout, ...]
    columns: tuple[slice, ...]
    rotations: tuple[Floats, ...]
    middles: Floats
    widths: Floats
    spread: float

    @classmethod
    def of(cls, fields: Floats, reference: int, begin: Sequence[Parameters], spread: float) -> Self:
        """Lay out what is to be found."""
        there: NDArray[np.bool_] = np.all(np.isfinite(fields), axis=2)
        clean = np.where(there[..., np.newaxis], fields, 0.0)
        counts = np.maximum(there.sum(axis=1), 1)
        middles = clean.sum(axis=1) / counts[:, np.newaxis]
        off = (clean - middles[:, np.newaxis]) * there[..., np.newaxis]
        widths = np.sqrt(np.sum(off**2, axis=(1, 2)) / counts)
        layouts = tuple(ParameterLayout.of(rotation=sensor != reference) for sensor in range(len(fields)))
        ends = np.cumsum([layout.size for layout in layouts]).tolist()
        columns = tuple(slice(end - layout.size, end) for end, layout in zip(ends, layouts, strict=True))
        turns = tuple(at.rotation for at in begin)
        return cls(clean, there, reference, layouts, columns, turns, middles, widths, spread)

    @property
    def size(self) -> int:
        """Of all parameters."""
        return int(self.columns[-1].stop)

    def believed(self, at: Sequence[Parameters]) -> NormalEquations:
        """What was thought before, in standard deviations."""
        matrix, gradient, cost = np.zeros((self.size, self.size)), np.zeros(self.size), 0.0
        for sensor, (own, columns) in enumerate(zip(at, self.columns, strict=True)):
            ellipsoid = Ellipsoid(own.offset, own.shape)
            middle, width = self.middles[sensor], float(self.widths[sensor])
            shaped = prior.equations(ellipsoid, spread=self.spread) + prior.sense(ellipsoid, middle, width)
            nine = slice(columns.start, columns.start + 9)
            matrix[nine, nine], gradient[nine] = shaped.matrix, shaped.gradient
            cost += shaped.cost
            if sensor != self.reference:
                turn = slice(columns.start + 9, columns.stop)
                turned = own.rotation @ self.rotations[sensor].T
                angle = 0.5 * np.array(
                    [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
                )
                matrix[turn, turn] = np.eye(3) / ROTATION_SIGMA**2
                gradient[turn] = -angle / ROTATION_SIGMA**2
                cost += float(angle @ angle) / ROTATION_SIGMA**2
        return NormalEquations(matrix, gradient, cost, 0)


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Where the iteration stands."""

    problem: _Problem
    at: tuple[Parameters, ...]
    noise: Floats
    weight: Floats
    directions: Floats

    def over(self, fields: Floats) -> Self:
        """The same parameters over other moments of the same sensors."""
        problem = _Problem.of(fields, self.problem.reference, self.at, self.problem.spread)
        weight = problem.there.astype(float)
        return replace(self, problem=problem, weight=weight, directions=_guessed(problem, self.at, self.noise, weight))

    def rows(self, moments: slice, directions: Floats | None = None) -> ObservationRows:
        """Residuals and Jacobians (W, 3, m, P) of some moments, in standard deviations."""
        problem = self.problem
        q = self.directions[moments] if directions is None else directions
        sensors = len(self.at)
        shape = (len(q), 3, sensors)
        residual, model, jacobian = np.empty(shape), np.empty(shape), np.zeros((*shape, problem.size))
        own = np.empty((*shape, 2))
        number = np.arange(len(q))[:, np.newaxis]
        for sensor, at in enumerate(self.at):
            group = ObservationGroup(
                number, problem.fields[sensor, moments, np.newaxis], self.weight[sensor, moments, np.newaxis]
            )
            part = rows_of(group, at, q, problem.layouts[sensor], Weights(float(self.noise[sensor])))
            residual[:, :, sensor], model[:, :, sensor] = part.residual[:, :, 0], part.model[:, :, 0]
            own[:, :, sensor] = part.own[:, :, 0]
            jacobian[:, :, sensor, problem.columns[sensor]] = part.jacobian[:, :, 0]
        counts = 3.0 * float(self.weight[:, moments].sum()), 0.0
        return ObservationRows(residual, jacobian, own, model, np.zeros(shape), np.zeros(problem.size), counts)

    def blocks(self) -> Iterator[slice]:
        """All moments, so many at a time."""
        for begin in range(0, len(self.directions), ROOM):
            yield slice(begin, begin + ROOM)

    def residuals(self) -> Floats:
        """(m, N) length of what each reading is off, in the sensor's standard deviations, whether it counts or not."""
        off = np.empty(self.weight.shape)
        for sensor, at in enumerate(self.at):
            left = self.problem.fields[sensor] - at.offset - self.directions @ at.ellipsoid_like.T
            off[sensor] = np.sqrt(np.einsum("ni,ni->n", left, left)) / self.noise[sensor]
        return off

    @property
    def cost(self) -> float:
        """χ² of everything, and of the variances."""
        squares = np.sum(self.residuals() ** 2 * self.weight)
        return float(squares) + self.problem.believed(self.at).cost


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Normal equations of all moments and of the prior."""

    parts: tuple[Linearised, ...]
    matrix: Floats
    gradient: Floats
    bent: Floats
    prior: NormalEquations
    squares: Floats
    expected: Floats
    curvature: Floats

    @classmethod
    def of(cls, state: _State) -> Self:
        """Linearise everything."""
        size, sensors = state.problem.size, len(state.at)
        parts: list[Linearised] = []
        sums = [np.zeros(sensors), np.zeros(sensors), np.zeros((sensors, sensors))]
        for block in state.blocks():
            rows = state.rows(block)
            part = eliminated(rows)
            terms = _components(rows, part, state.weight[:, block])
            sums = [total + one for total, one in zip(sums, terms, strict=True)]
            parts.append(part)
        matrix, gradient, bent = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for part in parts:
            matrix, gradient, bent = matrix + part.matrix, gradient + part.gradient, bent + part.bent
        return cls(tuple(parts), matrix, gradient, bent, state.problem.believed(state.at), *sums)

    def noise(self, state: _State) -> Floats:
        """(m,) what the residuals say of each sensor's noise: a step of Fisher's scoring."""
        sizes = np.array([layout.size for layout in state.problem.layouts])
        change = np.linalg.lstsq(self.curvature, self.squares - self.expected + sizes, rcond=1e-6)[0]
        factor = np.sqrt(np.clip(1.0 + change, LEAST_CHANGE, 1.0 / LEAST_CHANGE))
        floor = FINEST * np.array([np.cbrt(np.linalg.det(at.shape)) for at in state.at])
        noise: Floats = np.maximum(state.noise * factor, floor)
        return noise

    def moved_directions(self, state: _State, step: Floats) -> Floats:
        """(N, 3) directions that go with a step of the parameters."""
        return np.concatenate([
            part.follow(state.directions[block], step)
            for part, block in zip(self.parts, state.blocks(), strict=True)
        ])  # fmt: skip


def _components(rows: ObservationRows, part: Linearised, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """Squares (m,) once directions have settled, what they would be if the noise were right, and how they follow it.

    The latter two are tr Q over the rows of a sensor and (m, m) tr Q_ij Q_ji, of Q = 1 − V C Vᵀ.
    """
    own, inverse = rows.own, part.inverse
    eased = np.einsum("wab,wb->wa", inverse, part.own)
    left = rows.residual - np.einsum("wksa,wa->wks", own, eased)
    shares = inverse @ np.einsum("wksa,wksb->swab", own, own)
    traces = np.trace(shares, axis1=2, axis2=3).sum(axis=1)
    counts = 3.0 * weight.sum(axis=1)
    products = np.einsum("swab,twba->st", shares, shares)
    return np.sum(left**2, axis=(0, 1)), counts - traces, np.diag(counts - 2.0 * traces) + products


def is_sound(estimate: Estimate) -> bool:
    """Whether a sensor by itself leaves nothing open."""
    return not estimate.plane and not estimate.unobserved


def _alone(field: Floats) -> Estimate | None:
    """What one sensor finds by itself, where that is an ellipsoid."""
    try:
        return Auto().estimate(Readings.of(field[np.isfinite(field).all(axis=1)]))
    except FitError:
        return None


def _begins(fields: Floats, reference: int, alone: Sequence[Estimate | None]) -> Iterator[tuple[Parameters, ...]]:
    """Where to start: with what each finds by itself, the rest from the best of those; else with spheres."""
    sound = [each.ellipsoid if each is not None and is_sound(each) else None for each in alone]
    if all(each is not None for each in sound):
        yield _turned(fields, reference, [each for each in sound if each is not None])
        return
    known = [sensor for sensor, each in enumerate(sound) if each is not None]
    if known:
        noises = [alone[sensor].noise / sound[sensor].radius for sensor in known]  # type: ignore[union-attr]
        best = known[int(np.argmin(noises))]
        mapped = [
            own if own is not None else _mapped(fields[best], sound[best], fields[sensor])  # type: ignore[arg-type]
            for sensor, own in enumerate(sound)
        ]
        yield _turned(fields, reference, mapped)
        return
    for ellipsoid in _spheres(fields[reference]):
        others = [
            ellipsoid if sensor == reference else _mapped(fields[reference], ellipsoid, field)
            for sensor, field in enumerate(fields)
        ]
        yield _turned(fields, reference, others)


def _spheres(field: Floats) -> Iterator[Ellipsoid]:
    """Spheres about readings, and beside the plane that they are nearly in."""
    readings = field[np.isfinite(field).all(axis=1)]
    middle = readings.mean(axis=0)
    width = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
    normal = np.linalg.eigh(np.cov(readings.T))[1][:, 0]
    for lift in (0.0, 1.0, -1.0, 2.0, -2.0):
        yield Ellipsoid(middle + lift * width * normal, max(width * math.hypot(1.0, lift), 1e-300) * np.eye(3))


def _mapped(field: Floats, ellipsoid: Ellipsoid, other: Floats) -> Ellipsoid:
    """The ellipsoid of another sensor, whose readings are an affine map of those of this one; else a sphere."""
    both = np.isfinite(field).all(axis=1) & np.isfinite(other).all(axis=1)
    first, second = field[both], other[both]
    middle, mean = first.mean(axis=0), second.mean(axis=0)
    values = np.linalg.svd(first - middle, compute_uv=False) / math.sqrt(len(first))
    width = float(np.sqrt(np.mean(np.sum((second - mean) ** 2, axis=1))))
    if values[2] < 1e-2 * values[0]:
        return Ellipsoid(mean, max(width, 1e-300) * np.eye(3))
    linear = np.linalg.lstsq(first - middle, second - mean, rcond=None)[0].T
    squares, axes = np.linalg.eigh(linear @ ellipsoid.shape @ ellipsoid.shape @ linear.T)
    radii = np.sqrt(np.maximum(squares, 1e-4 * squares[2]))
    return Ellipsoid(mean + linear @ (ellipsoid.centre - middle), (axes * radii) @ axes.T)


def _turned(fields: Floats, reference: int, ellipsoids: Sequence[Ellipsoid]) -> tuple[Parameters, ...]:
    """Parameters at these ellipsoids, each sensor turned as its directions are against those of the reference."""
    seen = [
        (field - ellipsoid.centre) @ np.linalg.inv(ellipsoid.shape)
        for field, ellipsoid in zip(fields, ellipsoids, strict=True)
    ]
    made = []
    for sensor, ellipsoid in enumerate(ellipsoids):
        at = Parameters.at(ellipsoid.centre, ellipsoid.shape)
        both = np.isfinite(seen[sensor]).all(axis=1) & np.isfinite(seen[reference]).all(axis=1)
        if sensor != reference and both.any():
            at = replace(at, rotation=mirror_or_rotation(_unit(seen[sensor][both]), _unit(seen[reference][both])))
        made.append(at)
    return tuple(made)


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    return unit


def _guessed(problem: _Problem, at: Sequence[Parameters], noise: Floats, weight: Floats) -> Floats:
    """(N, 3) the direction at each moment that the sensors agree on best."""
    total = np.zeros(problem.fields.shape[1:])
    for sensor, own in enumerate(at):
        seen = (problem.fields[sensor] - own.offset) @ np.linalg.inv(own.ellipsoid_like).T
        radius = float(np.cbrt(np.linalg.det(own.shape)))
        total += seen * (weight[sensor] * (radius / noise[sensor]) ** 2)[:, np.newaxis]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit: Floats = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
    return unit


def _misfit(state: _State) -> float:
    """Noise of all sensors, each in its own size."""
    return float(sum(math.log(noise / np.cbrt(np.linalg.det(at.shape)))
                     for noise, at in zip(state.noise, state.at, strict=True)))  # fmt: skip


def _settled(problem: _Problem, begin: tuple[Parameters, ...]) -> _State | None:
    """Levenberg–Marquardt from a start; None where that leads nowhere."""
    noise = 0.1 * np.array([np.cbrt(np.linalg.det(at.shape)) for at in begin])
    weight = problem.there.astype(float)
    state = _State(problem, begin, noise, weight, _guessed(problem, begin, noise, weight))
    try:
        return _iterated(state)
    except np.linalg.LinAlgError:
        return None


def _iterated(state: _State) -> _State:
    """Take steps until they are small beside what is claimed, each sensor weighed as its residuals ask for."""
    damping = 1e-3
    for _ in range(STEPS):
        equations = _Equations.of(state)
        matrix, gradient = equations.matrix + equations.prior.matrix, equations.gradient + equations.prior.gradient
        step: Floats = gradient
        before, moved = state.cost, None
        while moved is None and damping < MOST_DAMPING:
            step = solved(matrix, gradient, damping)
            tried = _stepped(state, equations, _cut(state, step))
            moved = tried if tried is not None and tried.cost <= before * (1.0 + 1e-9) + 1e-6 else None
            damping = damping * 8.0 if moved is None else max(damping / 10.0, 1e-12)
        noise = equations.noise(state)
        is_weighed = bool(np.all(np.abs(np.log(noise / state.noise)) < SAME))
        is_small = moved is None or (float(step @ matrix @ step) < SETTLED**2 * len(step) and damping < 1.0)
        state, damping = replace(state if moved is None else moved, noise=noise), min(damping, 1.0)
        if is_weighed and is_small:
            break
    return state


def _cut(state: _State, step: Floats) -> Floats:
    """A step that moves no surface by more than a part of its size, and turns nothing by more than as much."""
    longest = 0.0
    for at, columns in zip(state.at, state.problem.columns, strict=True):
        own = step[columns]
        longest = max(longest, float(np.abs(own[:9]).max()) / float(np.cbrt(np.linalg.det(at.shape))))
        longest = max(longest, float(np.abs(own[9:]).max(initial=0.0)))
    return step * min(1.0, LONGEST_STEP / max(longest, 1e-300))


def _stepped(state: _State, equations: _Equations, step: Floats) -> _State | None:
    """Where a step leads; None where a surface is not closed."""
    at = []
    for own, columns, layout in zip(state.at, state.problem.columns, state.problem.layouts, strict=True):
        moved = own.moved(step[columns], layout)
        axes = np.linalg.eigvalsh(moved.shape)
        if not axes[0] > 1e-3 * axes[2]:
            return None
        at.append(moved)
    return replace(state, at=tuple(at), directions=equations.moved_directions(state, step))


def _without_outliers(state: _State) -> _State:
    """Leave out readings that do not belong to the others, of each moment the worst at first, and go on without."""
    for _ in range(ROUNDS):
        weight = _inliers(state)
        if np.array_equal(weight, state.weight):
            break
        directions = _guessed(state.problem, state.at, state.noise, weight)
        state = _iterated(replace(state, weight=weight, directions=directions))
    return state


def _inliers(state: _State) -> Floats:
    """(m, N) 1 for readings that belong: what was left out and still does not stays out, and the worst goes, too."""
    off = np.where(state.problem.there, state.residuals(), np.nan)
    usual = np.nanmedian(np.where(state.weight > 0.0, off, np.nan), axis=1, keepdims=True)
    far = np.nan_to_num(off) > STRAY * usual
    counted = np.where((state.weight > 0.0) & far, np.nan_to_num(off / usual), 0.0)
    worst = (counted == counted.max(axis=0)) & (counted > 0.0)
    if len(off) == 2:
        worst |= far & (state.weight > 0.0)  # of two it is not told which
    kept = state.problem.there & ~worst & ~((state.weight == 0.0) & far)
    share = kept.sum(axis=1) / np.maximum(state.problem.there.sum(axis=1), 1)
    for sensor in np.flatnonzero(share < FEWEST_LEFT):
        kept[sensor] = state.problem.there[sensor]
    inlier_share: Floats = kept.astype(float)
    return inlier_share


def _finished(state: _State, alone: Sequence[Estimate | None]) -> Several:
    """Take off what the sphere's curvature adds, and say how far to trust what is left."""
    support = None
    for _ in range(CORRECTED):
        equations = _Equations.of(state)
        support = Support.of(equations.matrix, lambda at=state: _spurious_information(at))  # type: ignore[misc]
        plain = NormalEquations(equations.matrix, equations.gradient - equations.bent, 0.0, 0)
        step = (support.keep(plain) + equations.prior).step()
        moved = _stepped(state, equations, _cut(state, step))
        if moved is None:
            break
        state = replace(moved, noise=equations.noise(state))
        if float(step @ (equations.matrix + equations.prior.matrix) @ step) < SETTLED**2:
            break
    equations = _Equations.of(state)
    support = Support.of(equations.matrix, lambda: _spurious_information(state))
    textbook = replace(equations.prior, matrix=support.information + equations.prior.matrix).inverse()
    scatter, excess_variance = _scatter(state, textbook, alone)
    covariance = textbook @ (equations.prior.matrix + excess_variance * support.projected(scatter)) @ textbook
    covariance = 0.5 * (covariance + covariance.T)
    prior_influence = []
    for at, columns in zip(state.at, state.problem.columns, strict=True):
        nine = slice(columns.start, columns.start + 9)
        believed = prior.equations(Ellipsoid(at.offset, at.shape), spread=state.problem.spread).matrix
        prior_influence.append(
            float(np.clip(np.real(np.linalg.eigvals(textbook[nine, nine] @ believed)).max(), 0.0, 1.0))
        )
    return Several(
        state.at, state.problem.reference, state.problem.columns, covariance, textbook, state.noise, state.directions,
        state.weight > 0.0, np.array(prior_influence), support.unobserved, excess_variance,
    )  # fmt: skip


def _spurious_information(state: _State) -> Floats:
    """(P, P) information that noise in the directions makes on average: Σ C_ab J(t_a)ᵀ Q J(t_b).

    J is linear in the direction; its noise along the tangents t_a has the covariance C.
    """
    stride = max(1, len(state.directions) // GLANCE)
    some = slice(None, None, stride)
    rows = state.rows(some)
    count, size = len(rows.residual), state.problem.size
    own = rows.own.reshape(count, -1, 2)
    inverse = inverse_of(np.swapaxes(own, 1, 2) @ own)
    tangents = across(state.directions[some])
    along = [state.rows(some, tangents[..., axis]).jacobian.reshape(count, -1, size) for axis in range(2)]
    fixed = np.zeros(size)  # the Jacobian of an offset is 1, whatever the direction
    for columns in state.problem.columns:
        fixed[columns.start + 3 : columns.stop] = 1.0
    root = np.linalg.cholesky(inverse + 1e-300 * np.eye(2))
    total = np.zeros((size, size))
    for axis in range(2):
        mixed = fixed * sum(root[:, other, axis, np.newaxis, np.newaxis] * along[other] for other in range(2))
        total += _off_own(mixed, own, inverse)
    return stride * total


def _off_own(jacobian: Floats, own: Floats, inverse: Floats) -> Floats:
    """(P, P) Σ Jᵀ Q J, with Q = 1 − V C Vᵀ."""
    size = jacobian.shape[-1]
    flat = jacobian.reshape(-1, size)
    mixed = np.swapaxes(jacobian, 1, 2) @ own
    taken: Floats = np.einsum("wpa,wab,wqb->pq", mixed, inverse, mixed, optimize=True)
    total: Floats = flat.T @ flat - taken
    return total


def _scatter(state: _State, textbook: Floats, alone: Sequence[Estimate | None]) -> tuple[Floats, float]:
    """(P, P) scatter of the gradient, with correlated residuals, and the creep.

    Each component of each sensor is a series of its own, as in `flinders.estimators.covariance`; a sensor's part
    grows by no less than what it finds by itself, where distortions that belong to the direction are looked for.
    """
    stride = max(1, len(state.directions) // (ROOM * 4))
    some = slice(None, None, stride)
    rows = state.rows(some)
    count, sensors, size = len(rows.residual), len(state.at), state.problem.size
    own = rows.own.reshape(count, -1, 2)
    inverse = inverse_of(np.swapaxes(own, 1, 2) @ own)
    taken = own @ inverse
    residual = rows.residual.reshape(count, -1)
    jacobian = rows.jacobian.reshape(count, -1, size)
    residual = residual - (taken @ (residual[:, np.newaxis] @ own).swapaxes(1, 2))[..., 0]
    jacobian = jacobian - taken @ (np.swapaxes(own, 1, 2) @ jacobian)
    segments = [np.arange(count)]
    total = np.zeros((size, size))
    for sensor in range(sensors):
        white, coloured = np.zeros((size, size)), np.zeros((size, size))
        for axis in range(3):
            kind = axis * sensors + sensor
            series = Residuals(residual[:, kind], jacobian[:, kind], segments)
            autocovariance = series.autocovariance()
            white += jacobian[:, kind].T @ jacobian[:, kind]
            coloured += series.scatter(autocovariance / max(float(autocovariance[0]), 1e-300))
        wide = _wider(alone[sensor]) * white
        total += max(wide, coloured, key=lambda part: float(np.sum(part * textbook)))
    flat = Residuals(residual.ravel(), jacobian.reshape(-1, size), [np.arange(residual.size)])
    return stride * total, flat.excess_variance(total)


def _wider(estimate: Estimate | None) -> float:
    """By how much a sensor by itself claims more than independent residuals would, in variance."""
    if estimate is None or estimate.textbook is None or estimate.plane:
        return 1.0
    plain = np.diag(estimate.textbook)
    observed = plain > 0.0
    return max(1.0, float(np.mean(np.diag(estimate.covariance)[observed] / plain[observed])))
