"""Joint fit of several magnetometers on one body, which share the direction of the field at each time.

Minimises over all sensors i and times k, with the noise σᵢ of each sensor,

    Σ |xᵢₖ − bᵢ − Sᵢ Rᵢᵀ qₖ|² / σᵢ²   over (bᵢ, Sᵢ, Rᵢ) and qₖ, |qₖ| = 1

with R = 1 for the reference. Each direction qₖ is eliminated (`flinders.likelihood.sensors`). At each time 3m residuals
of m sensors are then equivalent to 3m − 2: m compare the lengths, and 2(m − 1) compare the directions of the sensors.
The σᵢ are estimated from the residuals by Fisher scoring. The bias by noise on the curved sphere of directions is
corrected (`flinders.likelihood.solver`), and outliers are left out.

The fit gives the rotations between the sensors, and improves each sensor by the information of the others. The readings
of one sensor are an affine map of those of another, so that a noisy sensor becomes nearly as accurate as the best one.
The fit does not improve coverage: if the body was not turned upside down, the same parameters are undetermined for all
sensors.

Source: nuisance parameters are eliminated as in B. Triggs et al., *Bundle Adjustment*, 2000; the model of a reading is
that of M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016), eq. 1.

>>> rng = np.random.default_rng(1)
>>> q = rng.normal(size=(800, 3))
>>> q /= np.linalg.norm(q, axis=1, keepdims=True)
>>> turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])      # from the second sensor to the first
>>> first = 50.0 * q + [10.0, 0.0, -5.0] + rng.normal(scale=0.5, size=q.shape)
>>> second = 40.0 * q @ turned + [0.0, 30.0, 0.0] + rng.normal(scale=0.5, size=q.shape)
>>> joint = fit_sensors(np.stack([first, second]))
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
from flinders.estimators.auto import fit_alone
from flinders.estimators.base import Estimate
from flinders.estimators.covariance import Residuals
from flinders.estimators.joint_covariance import eliminate_directions
from flinders.estimators.likelihood import start_spheres
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.rotation import perpendicular_vectors
from flinders.likelihood import prior
from flinders.likelihood.identifiability import Support
from flinders.likelihood.observations import inverse_matrices
from flinders.likelihood.parameters import Parameters
from flinders.likelihood.sensors import SensorProblem, Sensors
from flinders.likelihood.solver import correct_bias, levenberg_marquardt

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.observations import ObservationRows
    from flinders.likelihood.sensors import SensorIterate

MAX_FIT_TIMES: Final = 10_000
"""Largest number of times in the iteration; for a longer recording a last fit uses all times."""

MAX_START_TIMES: Final = 1_000
"""Largest number of times with which starts are compared."""

MAX_INFORMATION_TIMES: Final = 2_000
"""Largest number of times from which spurious information is computed."""

MIRROR_MARGIN: Final = 2.0
"""Smallest ratio of the residual of a rotation to that of a mirror image at which the mirror image is accepted."""

MAX_CORRELATION_TIMES: Final = 16_384
"""Largest number of times from which the correlation of residuals is estimated."""

START_NOISE: Final = 0.1
"""Noise at the start of the solver, relative to the field."""

OUTLIER_RATIO: Final = 6.0
"""Residual of an outlier, as a multiple of the sensor's median residual."""

MAX_OUTLIER_ROUNDS: Final = 6
"""Largest number of searches for outliers; each search leaves out the worst reading of each time."""

MIN_INLIER_SHARE: Final = 0.5
"""Smallest fraction of inliers of a sensor; with fewer, no reading is rejected, and its noise estimate grows."""

MIN_TIMES: Final = 24
"""Smallest number of times with two readings or more."""


@dataclass(frozen=True, slots=True, eq=False)
class MultiSensorFit:
    """Result of a joint fit of several magnetometers."""

    # parameters of each sensor; `rotation` is from its axes to those of the reference, with determinant −1 for a mirror
    # image
    parameters: tuple[Parameters, ...]
    reference: int  # index of the reference sensor, whose rotation is 1
    # rows of each sensor in the covariance: offset, shape, and except for the reference the rotation vector, which is
    # applied on the left
    columns: tuple[slice, ...]
    covariance: Floats  # (P, P): covariance of all parameters
    textbook: Floats  # (P, P): covariance of all parameters for independent residuals
    noise: Floats  # (m,): standard deviation of a component of a reading, in the unit of each sensor
    directions: Floats  # (N, 3): direction of the field at each time, in the axes of the reference
    is_inlier: NDArray[np.bool_]  # (m, N): whether each reading exists and is an inlier
    prior_influence: Floats  # (m,): fraction of information from the prior, in the least known parameter of each shape
    unobserved: int  # number of directions of parameter space that the readings do not determine
    # ratio of variances: scatter of parts of the recording over the scatter expected from their residuals
    excess_variance: float

    def of(self, sensor: int) -> Floats:
        """(9 or 12, 9 or 12) covariance of the parameters of one sensor."""
        part: Floats = self.covariance[self.columns[sensor], self.columns[sensor]]
        return part

    def rotation(self, sensor: int) -> tuple[Floats, Floats]:
        """(3, 3) rotation from a sensor's axes to those of the reference, and (3, 3) covariance in rad²."""
        of_turn = self.of(sensor)[9:, 9:]
        return self.parameters[sensor].rotation, of_turn if sensor != self.reference else np.zeros((3, 3))

    def correct(self, sensor: int, field: Floats) -> Floats:
        """Correct (N, 3) readings of a sensor to fields of unit length in the axes of the reference."""
        at = self.parameters[sensor]
        turned: Floats = (field - at.offset) @ np.linalg.inv(at.rotated_shape).T
        return turned

    def estimate(self, sensor: int) -> Estimate:
        """The ellipsoid of one sensor and its covariance: an `Estimate`, as a method for one magnetometer gives."""
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


def fit_sensors(
    fields: Floats,
    *,
    reference: int = 0,
    starts: Sequence[Estimate | None] | None = None,
    spread: float = prior.SOFT_IRON_SPREAD,
) -> MultiSensorFit:
    """Fit several magnetometers of one body.

    Raises `TooFewSamples` for too few times; `NotAnEllipsoid` if no step leads to closed surfaces.

    Parameters
    ----------
    fields : (m, N, 3) float
        Readings of each sensor at the same N times, in its own unit and axes; NaN if it has none.
    reference : int
        Index of the sensor to whose axes the others are rotated.
    starts : sequence of Estimate or None, optional
        Estimate of each sensor alone; by default that of `Auto`.
    spread : float
        Spread of the prior of each shape, see `flinders.likelihood.prior`.
    """
    shared = np.count_nonzero(np.isfinite(fields[:, :, 0]).sum(axis=0) > 1)
    if shared < MIN_TIMES:
        raise TooFewSamples(found=int(shared), needed=MIN_TIMES, method="together")
    alone = [fit_alone(field) for field in fields] if starts is None else list(starts)
    few = fields[:, :: max(1, fields.shape[1] // MAX_START_TIMES)]
    iterates = [_solve_from(few, reference, begin, spread) for begin in _start_parameters(few, reference, alone)]
    best = min((iterate for iterate in iterates if iterate is not None), key=_misfit, default=None)
    if best is None:
        raise NotAnEllipsoid((float("nan"),) * 3, "together")
    thinned = fields[:, :: max(1, fields.shape[1] // MAX_FIT_TIMES)]
    problem = SensorProblem.of(thinned, best.at, reference=reference, spread=spread)
    best = levenberg_marquardt(problem, problem.initial(best.at, best.weights))
    best = _without_outliers(problem, best)
    if thinned.shape[1] < fields.shape[1]:
        problem = SensorProblem.of(fields, best.at, reference=reference, spread=spread)
        best = _without_outliers(problem, problem.initial(best.at, best.weights))
    return _compute_claims(problem, best, alone, reference)


def mirror_or_rotation(seen: Floats, into: Floats) -> Floats:
    """(3, 3) orthogonal matrix that maps (N, 3) directions `seen` to `into`: a rotation or a mirror image.

    Minimises Σ |vₖ − R uₖ|² (Kabsch), once among rotations and once among mirror images. The mirror image is returned
    if it fits much better, by `MIRROR_MARGIN`.

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
    """Whether an estimate of one sensor determines all parameters."""
    return not estimate.plane and not estimate.unobserved


def _start_parameters(fields: Floats, reference: int, alone: Sequence[Estimate | None]) -> Iterator[Sensors]:
    """Yield parameters to start from: first by the estimates of each sensor alone, then by spheres.

    A sensor without an estimate gets that of the best sensor, mapped to its readings.
    """
    sound = [each.ellipsoid if each is not None and is_sound(each) else None for each in alone]
    if all(each is not None for each in sound):
        yield _fit_rotations(fields, reference, [each for each in sound if each is not None])
        return
    known = [sensor for sensor, each in enumerate(sound) if each is not None]
    if known:
        noises = [alone[sensor].noise / sound[sensor].radius for sensor in known]  # type: ignore[union-attr]
        best = known[int(np.argmin(noises))]
        mapped = [
            own if own is not None else _map_ellipsoid(fields[best], sound[best], fields[sensor])  # type: ignore[arg-type]
            for sensor, own in enumerate(sound)
        ]
        yield _fit_rotations(fields, reference, mapped)
        return
    for ellipsoid in start_spheres(fields[reference]):
        others = [
            ellipsoid if sensor == reference else _map_ellipsoid(fields[reference], ellipsoid, field)
            for sensor, field in enumerate(fields)
        ]
        yield _fit_rotations(fields, reference, others)


def _map_ellipsoid(field: Floats, ellipsoid: Ellipsoid, other: Floats) -> Ellipsoid:
    """Ellipsoid of another sensor, mapped by the affine map between the readings; a sphere for readings in a plane."""
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


def _fit_rotations(fields: Floats, reference: int, ellipsoids: Sequence[Ellipsoid]) -> Sensors:
    """Parameters with given ellipsoids, and with rotations that fit the directions of each sensor to the reference."""
    seen = [
        (field - ellipsoid.centre) @ np.linalg.inv(ellipsoid.shape)
        for field, ellipsoid in zip(fields, ellipsoids, strict=True)
    ]
    made = []
    for sensor, ellipsoid in enumerate(ellipsoids):
        at = Parameters.at(ellipsoid.centre, ellipsoid.shape)
        both = np.isfinite(seen[sensor]).all(axis=1) & np.isfinite(seen[reference]).all(axis=1)
        if sensor != reference and both.any():
            at = replace(
                at, rotation=mirror_or_rotation(_unit_vectors(seen[sensor][both]), _unit_vectors(seen[reference][both]))
            )
        made.append(at)
    return Sensors(tuple(made))


def _unit_vectors(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    return unit


def _misfit(iterate: SensorIterate) -> float:
    """Sum over all sensors of the logarithm of the noise relative to the radius."""
    return float(np.log(iterate.weights / iterate.at.radii).sum())


def _solve_from(fields: Floats, reference: int, begin: Sensors, spread: float) -> SensorIterate | None:
    """Solution from a start; None if the solver fails."""
    problem = SensorProblem.of(fields, begin, reference=reference, spread=spread)
    try:
        return levenberg_marquardt(problem, problem.initial(begin, START_NOISE * begin.radii))
    except np.linalg.LinAlgError:
        return None


def _without_outliers(problem: SensorProblem, iterate: SensorIterate) -> SensorIterate:
    """Find outliers and fit again without them, until they no longer change."""
    for _ in range(MAX_OUTLIER_ROUNDS):
        inliers = _inliers(problem, iterate)
        if np.array_equal(inliers, iterate.groups[0].inliers):
            break
        iterate = levenberg_marquardt(problem, problem.initial(iterate.at, iterate.weights, inliers))
    return iterate


def _inliers(problem: SensorProblem, iterate: SensorIterate) -> NDArray[np.bool_]:
    """(m, N) inliers: previous outliers that still are outliers stay excluded, and so does the worst of each time."""
    recorded, counted = problem.group.inliers, iterate.groups[0].inliers
    distances = iterate.groups[0].distances(iterate.at, iterate.directions[0], iterate.weights)
    usual = np.nanmedian(np.where(counted, distances, np.nan), axis=1, keepdims=True)
    far = recorded & (distances > OUTLIER_RATIO * usual)
    excess = np.where(counted & far, distances / usual, 0.0)
    worst = (excess == excess.max(axis=0)) & (excess > 0.0)
    if len(distances) == 2:
        worst |= far & counted  # of two sensors it is not known which one is wrong
    inliers: NDArray[np.bool_] = recorded & ~worst & ~(~counted & far)
    share = inliers.sum(axis=1) / np.maximum(recorded.sum(axis=1), 1)
    few = share < MIN_INLIER_SHARE
    inliers[few] = recorded[few]
    return inliers


def _compute_claims(
    problem: SensorProblem, iterate: SensorIterate, alone: Sequence[Estimate | None], reference: int
) -> MultiSensorFit:
    """Subtract the bias by the sphere's curvature, and compute the claims."""
    iterate, equations = correct_bias(
        problem, iterate, observed=lambda now, plain: _support(problem, now, plain.matrix).remove_unobservable(plain)
    )
    support = _support(problem, iterate, equations.matrix)
    textbook = replace(equations.prior, matrix=support.information + equations.prior.matrix).inverse()
    scatter, excess_variance = _scatter(problem, iterate, textbook, alone)
    prior_influence = [
        before.influence(at, textbook[columns, columns][:9, :9])
        for at, before, columns in zip(iterate.at.each, problem.priors, problem.layout.columns, strict=True)
    ]
    covariance = textbook @ (equations.prior.matrix + excess_variance * support.project(scatter)) @ textbook
    return MultiSensorFit(
        iterate.at.each, reference, problem.layout.columns, 0.5 * (covariance + covariance.T), textbook,
        iterate.weights, iterate.directions[0], iterate.groups[0].inliers,
        np.array(prior_influence), support.unobserved, excess_variance,
    )  # fmt: skip


def _support(problem: SensorProblem, iterate: SensorIterate, matrix: Floats) -> Support:
    """Observable directions of parameter space, from the normal matrix."""
    return Support.of(matrix, lambda: _spurious_information(problem, iterate))


def _thin(iterate: SensorIterate, most: int) -> tuple[SensorIterate, int]:
    """The iterate with about `most` times, spread evenly, and the stride between these times."""
    stride = max(1, len(iterate.directions[0]) // most)
    some = replace(
        iterate, groups=(iterate.groups[0].thin_windows(stride),), directions=(iterate.directions[0][::stride],)
    )
    return some, stride


def _rows(problem: SensorProblem, iterate: SensorIterate, directions: Floats) -> ObservationRows:
    """Residuals and Jacobians of an iterate, at other directions of the field than its own."""
    return iterate.groups[0].rows(iterate.at, directions, problem.layout, iterate.weights)


def _spurious_information(problem: SensorProblem, iterate: SensorIterate) -> Floats:
    """(P, P) mean spurious information from noise in the directions: Σ C_ab J(t_a)ᵀ Q J(t_b).

    The Jacobian J is linear in the direction. C is the covariance of a direction's noise along the two tangents t_a,
    and Q removes the part that the fitted direction absorbs.
    """
    some, stride = _thin(iterate, MAX_INFORMATION_TIMES)
    rows = _rows(problem, some, some.directions[0])
    along = np.stack(
        [
            _rows(problem, some, tangent).jacobian
            for tangent in np.moveaxis(perpendicular_vectors(some.directions[0]), -1, 0)
        ]
    )
    inverse = inverse_matrices(np.einsum("wkna,wknb->wab", rows.own, rows.own))
    root = np.linalg.cholesky(inverse + 1e-300 * np.eye(2))
    for columns in problem.layout.columns:  # the Jacobian of an offset is 1 for any direction
        along[..., columns.start : columns.start + 3] = 0.0
    total = np.zeros((problem.layout.size, problem.layout.size))
    for axis in range(2):
        noisy = np.einsum("wa,awknp->wknp", root[:, :, axis], along)
        left = eliminate_directions(replace(rows, jacobian=noisy))[0].reshape(-1, problem.layout.size)
        total += left.T @ left
    return float(stride) * total


def _scatter(
    problem: SensorProblem, iterate: SensorIterate, textbook: Floats, alone: Sequence[Estimate | None]
) -> tuple[Floats, float]:
    """(P, P) scatter of the gradient for correlated residuals, and the factor by which slow drifts increase it.

    Each component of each sensor is a separate series, as in `flinders.estimators.covariance`. The scatter of a sensor
    is increased at least by the factor of the estimate of this sensor alone, which includes direction-dependent
    distortion.
    """
    some, stride = _thin(iterate, MAX_CORRELATION_TIMES)
    jacobian, residual = eliminate_directions(_rows(problem, some, some.directions[0]))
    size = problem.layout.size
    total = np.zeros((size, size))
    for sensor, own in enumerate(alone):
        white, coloured = np.zeros((size, size)), np.zeros((size, size))
        for axis in range(3):
            series = Residuals(residual[:, axis, sensor], jacobian[:, axis, sensor], [np.arange(len(residual))])
            autocovariance = series.autocovariance()
            white += series.jacobian.T @ series.jacobian
            coloured += series.scatter(autocovariance / max(float(autocovariance[0]), 1e-300))
        total += max(_own_inflation(own) * white, coloured, key=lambda part: float(np.sum(part * textbook)))
    flat = Residuals(residual.ravel(), jacobian.reshape(-1, size), [np.arange(residual.size)])
    return stride * total, flat.excess_variance(total)


def _own_inflation(estimate: Estimate | None) -> float:
    """Ratio of the variances of an estimate of one sensor alone to those for independent residuals, at least 1."""
    return 1.0 if estimate is None or estimate.plane else max(1.0, estimate.variance_inflation())
