"""Several magnetometers on one body: one direction of the field at each moment, seen by all.

Minimises over all sensors i and moments k, each sensor in its own noise σᵢ,

    Σ |xᵢₖ − bᵢ − Sᵢ Rᵢᵀ qₖ|² / σᵢ²   over (bᵢ, Sᵢ, Rᵢ) and qₖ, |qₖ| = 1

with R = 1 for the reference. Each direction qₖ is eliminated (`flinders.likelihood.sensors`): of 3m readings 3m −
2 are left, m of them lengths, and 2(m − 1) that hold the directions of the sensors against each other. The σᵢ come from
their residuals by Fisher's scoring, the mean gradient that noise makes on the sphere is removed
(`flinders.likelihood.solver`), and a reading that does not belong to the others is left out.

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
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotAnEllipsoid, TooFewSamples
from flinders.estimators.auto import found_alone
from flinders.estimators.base import Estimate
from flinders.estimators.covariance import Residuals
from flinders.estimators.joint_covariance import projected
from flinders.estimators.likelihood import spheres_about
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.rotation import across
from flinders.likelihood import prior
from flinders.likelihood.identifiability import Support
from flinders.likelihood.observations import inverse_of
from flinders.likelihood.parameters import Parameters
from flinders.likelihood.sensors import SensorProblem, Sensors
from flinders.likelihood.solver import bias_corrected, levenberg_marquardt

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.observations import ObservationRows
    from flinders.likelihood.sensors import SensorIterate

ENOUGH: Final = 10_000
"""Moments on which the fit is iterated; of a longer recording all are gone through from there."""

TRIED: Final = 1_000
"""Moments on which starts are tried."""

GLANCE: Final = 2_000
"""Moments from which noise-induced information is computed."""

MIRROR_MARGIN: Final = 2.0
"""Times smaller that the residual of a mirror image has to be."""

LOOKED_AT: Final = 16_384
"""Moments that tell how residuals are correlated."""

LOUDEST: Final = 0.1
"""Of the field: noise that the solver begins with."""

STRAY: Final = 6.0
"""Times the median residual of a sensor beyond which its reading does not belong to the others."""

ROUNDS: Final = 6
"""In which readings are left out, of each moment the worst at first."""

FEWEST_LEFT: Final = 0.5
"""Share of a sensor's readings that have to belong: where fewer do, all stay, and its noise is as large as that."""

FEWEST: Final = 24
"""Moments that are needed."""


@dataclass(frozen=True, slots=True, eq=False)
class Several:
    """What was found."""

    # of each sensor; `rotation` takes vectors in its axes into those of the reference. It has the determinant −1 where
    # the axes of the sensor are a mirror image of those.
    parameters: tuple[Parameters, ...]
    reference: int  # whose rotation is 1
    # of each sensor: offset, shape, and but for the reference the rotation vector, on the left
    columns: tuple[slice, ...]
    covariance: Floats  # (P, P): of all parameters
    textbook: Floats  # (P, P): the same if all residuals were independent
    noise: Floats  # (m,): standard deviation of a component of a reading, in the unit of each sensor
    directions: Floats  # (N, 3): of the field at each moment, in the axes of the reference
    is_inlier: NDArray[np.bool_]  # (m, N): readings that are there, and agree with the others
    prior_influence: Floats  # (m,): share of the least known parameter of each shape that the prior speaks for
    unobserved: int  # directions of parameter space of which the readings say nothing
    # factor by which stretches of the recording scatter more than their residuals explain, in variance
    excess_variance: float

    def of(self, sensor: int) -> Floats:
        """(9 or 12, 9 or 12) covariance of the parameters of one sensor."""
        part: Floats = self.covariance[self.columns[sensor], self.columns[sensor]]
        return part

    def rotation(self, sensor: int) -> tuple[Floats, Floats]:
        """(3, 3) from the axes of a sensor into those of the reference, and (3, 3) rad² of its rotation vector."""
        of_turn = self.of(sensor)[9:, 9:]
        return self.parameters[sensor].rotation, of_turn if sensor != self.reference else np.zeros((3, 3))

    def corrected(self, sensor: int, field: Floats) -> Floats:
        """(N, 3) unit-length field in the axes of the reference, of (N, 3) readings of a sensor."""
        at = self.parameters[sensor]
        turned: Floats = (field - at.offset) @ np.linalg.inv(at.ellipsoid_like).T
        return turned

    def estimate(self, sensor: int) -> Estimate:
        """The ellipsoid of one sensor with its marginal covariance, as every other method gives it."""
        at, nine = self.parameters[sensor], self.columns[sensor].start + np.arange(9)
        return Estimate(
            at.ellipsoid,
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

    Raises `TooFewSamples` for fewer moments than parameters; `NotAnEllipsoid` if no step leads to closed surfaces.

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
    """
    shared = np.count_nonzero(np.isfinite(fields[:, :, 0]).sum(axis=0) > 1)
    if shared < FEWEST:
        raise TooFewSamples(found=int(shared), needed=FEWEST, method="together")
    alone = [found_alone(field) for field in fields] if starts is None else list(starts)
    few = fields[:, :: max(1, fields.shape[1] // TRIED)]
    iterates = [_from_start(few, reference, begin, spread) for begin in _begins(few, reference, alone)]
    best = min((iterate for iterate in iterates if iterate is not None), key=_misfit, default=None)
    if best is None:
        raise NotAnEllipsoid((float("nan"),) * 3, "together")
    thinned = fields[:, :: max(1, fields.shape[1] // ENOUGH)]
    problem = SensorProblem.of(thinned, best.at, reference=reference, spread=spread)
    best = levenberg_marquardt(problem, problem.initial(best.at, best.weights))
    best = _without_outliers(problem, best)
    if thinned.shape[1] < fields.shape[1]:
        problem = SensorProblem.of(fields, best.at, reference=reference, spread=spread)
        best = _without_outliers(problem, problem.initial(best.at, best.weights))
    return _finished(problem, best, alone, reference)


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


def is_sound(estimate: Estimate) -> bool:
    """Whether a sensor by itself leaves nothing open."""
    return not estimate.plane and not estimate.unobserved


def _begins(fields: Floats, reference: int, alone: Sequence[Estimate | None]) -> Iterator[Sensors]:
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
    for ellipsoid in spheres_about(fields[reference]):
        others = [
            ellipsoid if sensor == reference else _mapped(fields[reference], ellipsoid, field)
            for sensor, field in enumerate(fields)
        ]
        yield _turned(fields, reference, others)


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


def _turned(fields: Floats, reference: int, ellipsoids: Sequence[Ellipsoid]) -> Sensors:
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
    return Sensors(tuple(made))


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    return unit


def _misfit(iterate: SensorIterate) -> float:
    """Noise of all sensors, each in its own size."""
    return float(np.log(iterate.weights / iterate.at.radii).sum())


def _from_start(fields: Floats, reference: int, begin: Sensors, spread: float) -> SensorIterate | None:
    """Where the solver leads from a start; None where that is nowhere."""
    problem = SensorProblem.of(fields, begin, reference=reference, spread=spread)
    try:
        return levenberg_marquardt(problem, problem.initial(begin, LOUDEST * begin.radii))
    except np.linalg.LinAlgError:
        return None


def _without_outliers(problem: SensorProblem, iterate: SensorIterate) -> SensorIterate:
    """Leave out readings that do not belong to the others, of each moment the worst at first, and go on without."""
    for _ in range(ROUNDS):
        inliers = _inliers(problem, iterate)
        if np.array_equal(inliers, iterate.groups[0].inliers):
            break
        iterate = levenberg_marquardt(problem, problem.initial(iterate.at, iterate.weights, inliers))
    return iterate


def _inliers(problem: SensorProblem, iterate: SensorIterate) -> NDArray[np.bool_]:
    """(m, N) readings that belong: what was left out and still does not stays out, and the worst goes, too."""
    recorded, counted = problem.group.inliers, iterate.groups[0].inliers
    distances = iterate.groups[0].distances(iterate.at, iterate.directions[0], iterate.weights)
    usual = np.nanmedian(np.where(counted, distances, np.nan), axis=1, keepdims=True)
    far = recorded & (distances > STRAY * usual)
    excess = np.where(counted & far, distances / usual, 0.0)
    worst = (excess == excess.max(axis=0)) & (excess > 0.0)
    if len(distances) == 2:
        worst |= far & counted  # of two it is not told which
    inliers: NDArray[np.bool_] = recorded & ~worst & ~(~counted & far)
    share = inliers.sum(axis=1) / np.maximum(recorded.sum(axis=1), 1)
    few = share < FEWEST_LEFT
    inliers[few] = recorded[few]
    return inliers


def _finished(
    problem: SensorProblem, iterate: SensorIterate, alone: Sequence[Estimate | None], reference: int
) -> Several:
    """Take off what the sphere's curvature adds, and say how far to trust what is left."""
    iterate, equations = bias_corrected(
        problem, iterate, observed=lambda now, plain: _support(problem, now, plain.matrix).keep(plain)
    )
    support = _support(problem, iterate, equations.matrix)
    textbook = replace(equations.prior, matrix=support.information + equations.prior.matrix).inverse()
    scatter, excess_variance = _scatter(problem, iterate, textbook, alone)
    prior_influence = [
        before.influence(at, textbook[columns, columns][:9, :9])
        for at, before, columns in zip(iterate.at.each, problem.priors, problem.layout.columns, strict=True)
    ]
    covariance = textbook @ (equations.prior.matrix + excess_variance * support.projected(scatter)) @ textbook
    return Several(
        iterate.at.each, reference, problem.layout.columns, 0.5 * (covariance + covariance.T), textbook,
        iterate.weights, iterate.directions[0], iterate.groups[0].inliers,
        np.array(prior_influence), support.unobserved, excess_variance,
    )  # fmt: skip


def _support(problem: SensorProblem, iterate: SensorIterate, matrix: Floats) -> Support:
    """What the readings see, of their normal matrix."""
    return Support.of(matrix, lambda: _spurious_information(problem, iterate))


def _thinned(iterate: SensorIterate, most: int) -> tuple[SensorIterate, int]:
    """About so many moments, spread evenly, and one of how many they are."""
    stride = max(1, len(iterate.directions[0]) // most)
    some = replace(iterate, groups=(iterate.groups[0].every(stride),), directions=(iterate.directions[0][::stride],))
    return some, stride


def _rows(problem: SensorProblem, iterate: SensorIterate, directions: Floats) -> ObservationRows:
    """Residuals and Jacobians with other directions."""
    return iterate.groups[0].rows(iterate.at, directions, problem.layout, iterate.weights)


def _spurious_information(problem: SensorProblem, iterate: SensorIterate) -> Floats:
    """(P, P) information that noise in the directions makes on average: Σ C_ab J(t_a)ᵀ Q J(t_b).

    J is linear in the direction; its noise along the tangents t_a has the covariance C.
    """
    some, stride = _thinned(iterate, GLANCE)
    rows = _rows(problem, some, some.directions[0])
    along = np.stack(
        [_rows(problem, some, tangent).jacobian for tangent in np.moveaxis(across(some.directions[0]), -1, 0)]
    )
    inverse = inverse_of(np.einsum("wkna,wknb->wab", rows.own, rows.own))
    root = np.linalg.cholesky(inverse + 1e-300 * np.eye(2))
    for columns in problem.layout.columns:  # the Jacobian of an offset is 1, whatever the direction
        along[..., columns.start : columns.start + 3] = 0.0
    total = np.zeros((problem.layout.size, problem.layout.size))
    for axis in range(2):
        noisy = np.einsum("wa,awknp->wknp", root[:, :, axis], along)
        left = projected(replace(rows, jacobian=noisy))[0].reshape(-1, problem.layout.size)
        total += left.T @ left
    return float(stride) * total


def _scatter(
    problem: SensorProblem, iterate: SensorIterate, textbook: Floats, alone: Sequence[Estimate | None]
) -> tuple[Floats, float]:
    """(P, P) scatter of the gradient, with correlated residuals, and the creep.

    Each component of each sensor is a series of its own, as in `flinders.estimators.covariance`; a sensor's part
    grows by no less than what it finds by itself, where distortions that belong to the direction are looked for.
    """
    some, stride = _thinned(iterate, LOOKED_AT)
    jacobian, residual = projected(_rows(problem, some, some.directions[0]))
    size = problem.layout.size
    total = np.zeros((size, size))
    for sensor, own in enumerate(alone):
        white, coloured = np.zeros((size, size)), np.zeros((size, size))
        for axis in range(3):
            series = Residuals(residual[:, axis, sensor], jacobian[:, axis, sensor], [np.arange(len(residual))])
            autocovariance = series.autocovariance()
            white += series.jacobian.T @ series.jacobian
            coloured += series.scatter(autocovariance / max(float(autocovariance[0]), 1e-300))
        total += max(_wider(own) * white, coloured, key=lambda part: float(np.sum(part * textbook)))
    flat = Residuals(residual.ravel(), jacobian.reshape(-1, size), [np.arange(residual.size)])
    return stride * total, flat.excess_variance(total)


def _wider(estimate: Estimate | None) -> float:
    """By how much a sensor by itself claims more than independent residuals would, in variance."""
    return 1.0 if estimate is None or estimate.plane else max(1.0, estimate.variance_inflation())
