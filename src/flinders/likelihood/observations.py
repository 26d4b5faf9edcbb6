"""Groups of readings with a common direction of the field: a single reading, or the readings of a gyro window.

The direction of the field is a nuisance parameter of each group. The terms of aiding sensors differ in their groups,
and in what they observe about the direction q_k at reading k:

    magnitude      one reading        q = v                 only the length is observed
    dip            one reading        q = v, dᵀq = sin I    and the height above the horizon
    rate           a window           q_k = ΔR_kᵀ v         three residuals for each reading
    attitude       one reading, or    C_k q_k = m           and the full rotation is observable
                   a window

Residuals are r = x − b − S Rᵀ q in the unit of the readings, sin I − dᵀq for a vertical d, and m − C q for an attitude
C. All are linear in the noise. The direction of each group is eliminated by a Schur complement: with the Jacobians J of
the parameters and V of the direction, JᵀV (VᵀV)⁻¹ VᵀJ is subtracted from the normal equations.

The direction v lies on a sphere, which is curved. A covariance C of v gives residuals of mean ½ tr(C) f(v), with f the
part of the model that is linear in v. `bias_gradient` is the resulting mean gradient, which the solver subtracts. For a
single reading it is the curvature of `flinders.likelihood.magnitude`; in a window it decreases with the number of
readings.

With an accelerometer's errors the vertical is v = (1 + Γ)(d + β/ρ), see `flinders.likelihood.dip`. While the body is
level the errors have the same effect as a rotation of the magnetometer; when the body tilts, their effect differs. The
residual is |v| sin I − vᵀq, whose noise is that of d regardless of β. If it were divided by |v|, a β that makes v
longer would reduce it.

The noise of the vertical occurs in the residual sin I − dᵀq and in its Jacobian dᵀ∂q. Their product has the mean σ² sin
I dᵀ∂q for a noise σ in each direction across d. Also, the mean of a noisy unit vector is shorter, by σ².
`bias_gradient` contains both effects. The noise of attitudes has no such effect, see `flinders.likelihood.attitude`.

Source: eliminating nuisance parameters as in B. Triggs et al., *Bundle Adjustment*, 2000; the bias of a
curved surface as in `flinders.likelihood.magnitude`.

>>> from flinders.likelihood.parameters import ParameterLayout, Parameters
>>> field = np.array([[[50.5, 0.0, 0.0]], [[0.0, 49.0, 0.0]]])               # on a sphere of radius 50, with noise
>>> group = ObservationGroup.of(field)
>>> here = Parameters.at(np.zeros(3), 50.0 * np.eye(3))
>>> equations = group.linearize(here, group.guess(here), ParameterLayout.of(), Weights(1.0))
>>> round(equations.cost, 6), round(float(equations.matrix[3, 3]), 6)         # 0.5² + 1²; one reading observes S₁₁
(1.25, 1.0)
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.geometry.rotation import (
    apply_matrices,
    cross_matrices,
    make_contiguous,
    perpendicular_vectors,
    product,
    rotations,
    step_on_sphere,
    transform_vectors,
    vectors_of,
)
from flinders.likelihood import attitude, dip, gyro

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.gyro import WindowRotation
    from flinders.likelihood.parameters import ParameterLayout, Parameters

CHUNK_READINGS: Final = 8192
"""Readings in a chunk, regardless of the length of the recording."""

MIN_DETERMINANT_RATIO: Final = 1e-12
"""Smallest determinant of the information on a window's direction, relative to its squared trace."""

RUN_READINGS: Final = 32
"""Consecutive readings that are kept together when a recording is thinned."""


class Weights(NamedTuple):
    """Standard deviations of residuals."""

    noise: float  # standard deviation of a component of a reading, in its unit
    vertical: float = 1.0  # standard deviation of dᵀq, or of an attitude about each axis, in rad
    own: float = 1.0  # fraction of the variance of dᵀq from the noise of d; the rest is the random walk of a gyro
    span: float = 1.0  # correlation length of verticals in readings, because accelerations last

    @property
    def steepness(self) -> float:
        """Root of the weight of a residual of a vertical or attitude, in 1/rad."""
        return 1.0 / (self.vertical * math.sqrt(self.span))


@dataclass(frozen=True, slots=True, eq=False)
class ObservationGroup:
    """W windows of n readings, each with one direction of the field."""

    rows: NDArray[np.intp]  # (W, n): index of each reading in the recording
    field: Floats  # (W, n, 3): readings
    weight: Floats  # (W, n): 1, or 0 for an outlier or missing reading
    turned: WindowRotation | None = None  # rotation of the body within each window
    # (W, n, 3, 3): from body axes to the world, in which the field has one direction
    attitudes: Floats | None = None
    down: Floats | None = None  # (W, n, 3): verticals d in body axes
    trust: Floats | None = None  # (W, n): weight of the vertical or of the attitude; a group has at most one of them

    @classmethod
    def of(cls, field: Floats) -> Self:
        """Make a group of (W, n, 3) readings of a magnetometer alone."""
        shape = field.shape[:2]
        return cls(np.arange(shape[0] * shape[1]).reshape(shape), field, np.ones(shape))

    @property
    def residuals_per_reading(self) -> int:
        """Number of residuals of a reading: 3, 4 with a vertical, or 6 with an attitude."""
        return 6 if self.attitudes is not None else 3 if self.down is None else 4

    @property
    def count(self) -> int:
        """Number of readings with a weight."""
        return int(np.count_nonzero(self.weight))

    def chunks(self) -> list[Self]:
        """The group in parts of about `CHUNK_READINGS` readings, in whole windows."""
        each = max(1, CHUNK_READINGS // self.rows.shape[1])
        return [self.chunk(slice(begin, begin + each)) for begin in range(0, len(self.rows), each)]

    def thin_windows(self, step: int) -> Self:
        """The group with every `step`-th window."""
        return self.chunk(slice(None, None, step))

    def thin_runs(self, step: int) -> Self:
        """The group with every `step`-th window; of single readings, whole runs of `RUN_READINGS` are selected.

        Runs are needed for estimates of noise and correlation.
        """
        if self.turned is not None:
            return self.thin_windows(step)
        return self.chunk(np.flatnonzero(np.arange(len(self.rows)) // RUN_READINGS % step == 0))

    def chunk(self, rows: slice | NDArray[np.intp]) -> Self:
        """The group with some of its windows."""
        parts = {
            name: None if getattr(self, name) is None else getattr(self, name)[rows]
            for name in ("rows", "field", "weight", "attitudes", "down", "trust")
        }
        return replace(self, **parts, turned=None if self.turned is None else self.turned.chunk(rows))  # type: ignore[arg-type]

    def at(self, at: Parameters) -> Self:
        """The group with the rotations of the gyro for given parameters."""
        if self.turned is None:
            return self
        return replace(self, turned=self.turned.with_gyro(at.gyro_bias, at.gyro))

    @property
    def rotations(self) -> Floats:
        """(W, n, 3, 3) rotations from body axes at each reading to those at the first reading, without the delay."""
        if self.turned is not None:
            return self.turned.rotations
        return np.broadcast_to(np.eye(3), (*self.weight.shape, 3, 3))

    def subtract_offset(self, at: Parameters) -> Floats:
        """(W, n, 3) readings minus the offset."""
        return self.field - at.offset

    def corrected_verticals(self, at: Parameters) -> Floats | None:
        """(W, n, 3) corrected verticals v, of about unit length; None without verticals."""
        return None if self.down is None else dip.correct_verticals(self.down, at.accelerometer)[0]

    def guess(self, at: Parameters) -> Floats:
        """(W, 3) direction of each window, estimated by the mean of its readings."""
        seen = self.subtract_offset(at) @ np.linalg.inv(at.rotated_shape).T * self.weight[..., np.newaxis]
        if self.turned is not None:
            seen = apply_matrices(self.turned.rotations, make_contiguous(seen))
        total = seen.sum(axis=1)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        unit: Floats = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), [1.0, 0.0, 0.0])
        return unit

    def rotated_directions(self, at: Parameters, directions: Floats) -> tuple[Floats, Floats | None]:
        """(W, n, 3) direction q at each reading, and (W, n, 3, 3) rotations to q from the window's direction.

        `directions` are the (W, 3) directions at the first reading of each window. The rotations are None without a
        gyro.
        """
        if self.turned is None:
            return np.broadcast_to(directions[:, np.newaxis], self.field.shape), None
        back = np.swapaxes(self.turned.rotations, 2, 3)
        if at.delay:
            back = product(rotations(make_contiguous(at.delay * at.body_rate(self.turned.rate))), back)
        return apply_matrices(back, directions[:, np.newaxis]), back

    def cost(self, at: Parameters, directions: Floats, weights: Weights) -> float:
        """Σ r², with each residual r in units of its standard deviation."""
        residual, vertical = unweighted_residuals(self, at, directions)
        cost = float(np.sum(np.einsum("wni,wni->wn", residual, residual) * self.weight)) / weights.noise**2
        if vertical is not None and self.trust is not None:
            cost += float(np.sum(np.einsum("wni,wni->wn", vertical, vertical) * self.trust)) * weights.steepness**2
        return cost

    def linearize(
        self, at: Parameters, directions: Floats, layout: ParameterLayout, weights: Weights
    ) -> EliminatedEquations:
        """Normal equations at given parameters and (W, 3) directions, with the directions eliminated."""
        return eliminate_directions(residual_rows(self, at, directions, layout, weights))


@dataclass(frozen=True, slots=True, eq=False)
class ObservationRows:
    """Residuals of a group, in standard deviations, and their Jacobians J = −∂r/∂θ."""

    residual: Floats  # (W, k, n): k residuals of each reading: 3, 4 with a vertical, or 6 with an attitude
    jacobian: Floats  # (W, k, n, P)
    own: Floats  # (W, k, n, 2): Jacobian of the window's own direction
    model: Floats  # (W, k, n): part of the model that is linear in that direction
    # (W, k, n): mean residual that is equivalent to the noise of verticals, which is in the residual and its Jacobian
    mean_residual: Floats
    noise_free: Floats  # (P,): 1 for a parameter whose Jacobian is free of that noise
    # number of residuals of each kind, regardless of their weights; an attitude counts as 2, because its residual along
    # the field is of second order
    counts: tuple[float, ...]
    # slices of the (W, k, n) residuals of each kind, with its own standard deviation: readings; verticals or attitudes
    kinds: tuple[tuple[slice, ...], ...] = (np.s_[:, :3], np.s_[:, 3:])


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedEquations:
    """Normal equations of a group, with its own directions eliminated."""

    matrix: Floats  # (P, P)
    gradient: Floats  # (P,)
    cost: float  # Σ r²
    bias_gradient: Floats  # (P,): mean gradient from noise, because the sphere of directions is curved
    root: Floats  # (W, 2, 2): T, with T Tᵀ the covariance of each direction if the parameters are known
    mixed: Floats  # (W, P, 2): JᵀV, see `orthonormalise`
    own: Floats  # (W, 2): Vᵀr
    squares: Floats  # (K,): Σ r² of each kind of residual, with fitted directions
    expected: Floats  # (K,): expectation of `squares` for correct weights, before the fit of the parameters
    # (K, K): derivative of `squares` by relative changes of the variances, which is twice Fisher's information
    curvature: Floats

    @classmethod
    def without_directions(cls, matrix: Floats, gradient: Floats, cost: float) -> Self:
        """Normal equations of observations without own directions and without estimated noise."""
        size, nothing = len(gradient), np.zeros(0)
        none = np.zeros((0, 2, 2)), np.zeros((0, size, 2)), np.zeros((0, 2))
        return cls(matrix, gradient, cost, np.zeros(size), *none, nothing, nothing, np.zeros((0, 0)))

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Join the normal equations of several groups."""
        if len(parts) == 1:
            return parts[0]
        by_window = ("root", "mixed", "own")
        values = {
            field.name: np.concatenate(each) if field.name in by_window else sum(each)
            for field in dataclasses.fields(cls)
            for each in [[getattr(part, field.name) for part in parts]]
        }
        return cls(**values)  # type: ignore[arg-type]

    def follow(self, directions: Floats, step: Floats) -> Floats:
        """(W, 3) best directions after a (P,) step of the parameters."""
        left = self.own - np.einsum("p,wpa->wa", step, self.mixed)
        return step_on_sphere(directions, np.einsum("wab,wb->wa", self.root, left))


def unweighted_residuals(group: ObservationGroup, at: Parameters, directions: Floats) -> tuple[Floats, Floats | None]:
    """Unweighted residuals of the readings, (W, n, 3) in their unit, and of verticals or attitudes, in rad.

    The latter are (W, n, 1) sin I − dᵀq or (W, n, 3) m − C q; None without these sensors.
    """
    q, _ = group.rotated_directions(at, directions)
    residual = group.subtract_offset(at) - transform_vectors(at.rotated_shape, q)
    if group.attitudes is not None:
        return residual, at.direction - apply_matrices(group.attitudes, q)
    down = group.corrected_verticals(at)
    if down is None:
        return residual, None
    return residual, dip.dip_residuals(down, q, at.sine)[..., np.newaxis]


def eliminate_directions(rows: ObservationRows) -> EliminatedEquations:
    """Normal equations of rows, with their own directions eliminated."""
    width, lean = rows.jacobian.shape[-1], rows.mean_residual
    flat = rows.jacobian.transpose(3, 1, 0, 2).reshape(width, -1)  # (P, k W n)
    own, root = orthonormalise(rows.own)
    mixed = mixed_products(rows.jacobian, own)
    projected = mixed.transpose(1, 2, 0).reshape(width, -1)  # (P, 2 W)
    pull = np.einsum("wkna,wkn->wa", own, rows.residual)
    share = 0.5 * np.einsum("wab,wab->w", root, root)
    left = 1.0 - np.einsum("wkna,wkna->wkn", own, own)  # variance left by the fitted directions
    off = rows.model * share[:, np.newaxis, np.newaxis] + lean * (1.0 + left)
    weighing = np.stack([np.swapaxes(one, 0, 1).ravel() for one in (rows.residual, off, lean * left)])
    gradient, bias_gradient, residual_gradient = weighing @ flat.T
    matrix = flat @ flat.T - projected @ projected.T
    gradient = gradient - projected @ pull.T.ravel()
    bias_gradient = bias_gradient - projected @ np.einsum("wkna,wkn->aw", own, off).ravel()
    bias_gradient = bias_gradient - residual_gradient * rows.noise_free
    settled = rows.residual - np.einsum("wkna,wa->wkn", own, pull)
    remaining = np.array([np.sum(settled[kind] ** 2) for kind in rows.kinds])
    expected, curvature = _components([own[kind] for kind in rows.kinds], np.asarray(rows.counts))
    cost = float(np.sum(rows.residual**2))
    return EliminatedEquations(matrix, gradient, cost, bias_gradient, root, mixed, pull, remaining, expected, curvature)


def orthonormalise(own: Floats) -> tuple[Floats, Floats]:
    """Orthonormal columns V = own T of each window, (W, k, n, 2), and the (W, 2, 2) matrix T, by Gram–Schmidt.

    T Tᵀ is the covariance of the window's direction. V and T are zero for a window without information on its
    direction.
    """
    first, second = own[..., 0], own[..., 1]
    a, b, d = (
        np.einsum("wkn,wkn->w", one, other) for one, other in ((first, first), (first, second), (second, second))
    )
    determinant = a * d - b * b
    is_sound = determinant > MIN_DETERMINANT_RATIO * (a + d) ** 2
    length, rest = np.sqrt(np.where(is_sound, a, 1.0)), np.sqrt(np.where(is_sound, determinant, 1.0))
    zero = np.zeros_like(a)
    root = vectors_of(vectors_of(np.array([[1.0 / length, -b / (length * rest)], [zero, length / rest]]) * is_sound))
    made = np.empty_like(own)
    made[..., 0] = first * root[:, 0, 0, np.newaxis, np.newaxis]
    made[..., 1] = first * root[:, 0, 1, np.newaxis, np.newaxis] + second * root[:, 1, 1, np.newaxis, np.newaxis]
    return made, root


def mixed_products(jacobian: Floats, own: Floats) -> Floats:
    """(W, P, 2) products JᵀV of (W, k, n, P) Jacobians and (W, k, n, 2) columns."""
    count, width = len(jacobian), jacobian.shape[-1]
    mixed = np.moveaxis(np.empty((width, 2, count)), 2, 0)
    return np.einsum("wknp,wkna->wpa", jacobian, own, out=mixed)


def _components(own: Sequence[Floats], counts: Floats) -> tuple[Floats, Floats]:
    """(K,) expected squares of each kind of residual, and their (K, K) derivative by relative changes of variances.

    With Q = 1 − V Vᵀ of a window these are tr Q over the rows of a kind, and tr Q_ab Q_ba of two kinds a and b. `own`
    has the rows of V of each kind.
    """
    shares = [np.einsum("wkna,wknb->wab", of_kind, of_kind) for of_kind in own]
    traces = np.array([float(np.einsum("waa->", share)) for share in shares])
    products = np.array([[float(np.einsum("wab,wab->", a, b)) for a in shares] for b in shares])
    return counts - traces, np.diag(counts - 2.0 * traces) + products


def residual_rows(
    group: ObservationGroup, at: Parameters, directions: Floats, layout: ParameterLayout, weights: Weights
) -> ObservationRows:
    """Residuals and Jacobians of a group in standard deviations, at (W, 3) directions."""
    q, back = group.rotated_directions(at, directions)
    windows, n = group.weight.shape
    residual, model, lean = np.swapaxes(np.zeros((3, group.residuals_per_reading, windows, n)), 1, 2)
    linear = transform_vectors(at.rotated_shape, q)
    scale = _reading_steepness(group, weights)
    model[:, :3] = np.swapaxes(linear, 1, 2) * scale
    residual[:, :3] = np.swapaxes(group.subtract_offset(at) - linear, 1, 2) * scale
    rows = ObservationRows(
        residual,
        weighted_jacobian(group, at, q, layout, weights),
        _own_jacobian(group, at, directions, back, weights),
        model,
        lean,
        *_noise_free_and_counts(group, layout, weights),
    )
    if group.trust is not None:
        _fill_auxiliary(rows, group, at, q, weights)
    return rows


def own_jacobian(group: ObservationGroup, at: Parameters, directions: Floats, weights: Weights) -> Floats:
    """(W, k, n, 2) Jacobian of a group by its own (W, 3) directions, in standard deviations."""
    return _own_jacobian(group, at, directions, group.rotated_directions(at, directions)[1], weights)


def _own_jacobian(
    group: ObservationGroup, at: Parameters, directions: Floats, back: Floats | None, weights: Weights
) -> Floats:
    """`own_jacobian` with `back`, the rotations that `ObservationGroup.rotated_directions` returns."""
    windows, n = group.weight.shape
    own = np.empty((2, group.residuals_per_reading, windows, n)).transpose(2, 1, 3, 0)
    tangent = perpendicular_vectors(directions)[:, np.newaxis]
    turned = np.broadcast_to(tangent, (windows, n, 3, 2)) if back is None else product(back, tangent)
    scale = _reading_steepness(group, weights)
    for axis in range(2):
        own[:, :3, :, axis] = np.swapaxes(transform_vectors(at.rotated_shape, turned[..., axis]), 1, 2) * scale
    steep = _auxiliary_steepness(group, weights)[..., np.newaxis]
    if group.attitudes is not None:
        own[:, 3:] = np.swapaxes(product(group.attitudes, turned) * steep[..., np.newaxis], 1, 2)
    elif (down := group.corrected_verticals(at)) is not None:
        own[:, 3] = np.einsum("wni,wnij->wnj", down, turned) * steep
    return own


def _reading_steepness(group: ObservationGroup, weights: Weights) -> Floats:
    """(W, 1, n) root of the weight of residuals of readings, in 1/unit."""
    steep: Floats = (np.sqrt(group.weight) / weights.noise)[:, np.newaxis]
    return steep


def _auxiliary_steepness(group: ObservationGroup, weights: Weights) -> Floats:
    """(W, n) root of the weight of residuals of verticals or attitudes, in 1/rad."""
    if group.trust is None:
        return np.zeros(group.weight.shape)
    steep: Floats = np.sqrt(group.trust) * weights.steepness
    return steep


def _noise_free_and_counts(
    group: ObservationGroup, layout: ParameterLayout, weights: Weights
) -> tuple[Floats, tuple[float, float]]:
    """Values of `ObservationRows.noise_free` and `ObservationRows.counts`."""
    trusted = 0.0 if group.trust is None else float(np.count_nonzero(group.trust))
    trusted *= 1.0 / weights.span if group.attitudes is None else 2.0
    still = np.zeros(layout.size)
    if "sine" in layout:
        still[layout.columns["sine"]] = 1.0
    counts = (3.0 * float(group.weight.sum()), trusted)
    return still, counts


def _fill_auxiliary(
    rows: ObservationRows, group: ObservationGroup, at: Parameters, q: Floats, weights: Weights
) -> None:
    """Write the residuals of verticals or attitudes, with their `model` and `mean_residual`.

    Parameters
    ----------
    rows : ObservationRows
        Written in place, except its Jacobians.
    group : ObservationGroup
        Group with verticals or attitudes.
    at : Parameters
        Values of the parameters.
    q : (W, n, 3) float
        Direction of the field at each reading.
    weights : Weights
        Standard deviations of the residuals.
    """
    trust = np.zeros(group.weight.shape) if group.trust is None else group.trust
    steep = _auxiliary_steepness(group, weights)
    if group.attitudes is not None:
        stands = apply_matrices(group.attitudes, q) * steep[..., np.newaxis]
        rows.model[:, 3:] = np.swapaxes(stands, 1, 2)
        rows.residual[:, 3:] = np.swapaxes(at.direction * steep[..., np.newaxis] - stands, 1, 2)
    elif (down := group.corrected_verticals(at)) is not None:
        usual = np.count_nonzero(trust) / max(float(trust.sum()), 1e-300)  # the variance is that of a trust of 1
        across_it = usual * weights.own * weights.vertical**2 / max(1.0 - at.sine**2, 1e-3)
        rows.mean_residual[:, 3] = at.sine * across_it * steep
        rows.model[:, 3] = dip.heights(down, q) * steep
        rows.residual[:, 3] = dip.dip_residuals(down, q, at.sine) * steep


def weighted_jacobian(
    group: ObservationGroup, at: Parameters, q: Floats, layout: ParameterLayout, weights: Weights
) -> Floats:
    """(W, k, n, P) Jacobian of a group in standard deviations, with the (W, n, 3) direction q at each reading."""
    jacobian = np.zeros((layout.size, group.residuals_per_reading, *q.shape[:2])).transpose(
        2, 1, 3, 0
    )  # columns are contiguous
    turned = group.turned
    moved = None if turned is None else gyro.direction_derivatives(turned, q, at.body_rate(turned.rate), layout.columns)
    _fill_readings(jacobian, at, q, layout, moved)
    jacobian[:, :3] *= _reading_steepness(group, weights)[..., np.newaxis]
    if group.trust is None:
        return jacobian
    of_gyro = gyro.gyro_columns(layout.columns)
    if group.attitudes is not None:
        attitude.fill_attitude(
            jacobian[:, 3:], layout.columns, group.attitudes, direction=at.direction, of_gyro=of_gyro, moved=moved
        )
    elif group.down is not None:
        dip.fill_dip(
            jacobian[:, 3], layout.columns, group.down, q,
            sine=at.sine, errors=at.accelerometer, of_gyro=of_gyro, moved=moved,
        )  # fmt: skip
    jacobian[:, 3:] *= _auxiliary_steepness(group, weights)[:, np.newaxis, :, np.newaxis]
    return jacobian


def _fill_readings(jacobian: Floats, at: Parameters, q: Floats, layout: ParameterLayout, moved: Floats | None) -> None:
    """Write the rows of the readings into a (W, k, n, P) Jacobian, in their unit."""
    shape, u = at.rotated_shape, transform_vectors(at.rotation.T, q)
    for axis in range(3):
        jacobian[:, axis, :, axis] = 1.0
    for column, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), start=3):
        jacobian[:, i, :, column] = u[..., j]
        jacobian[:, j, :, column] = u[..., i]
    if "rotation" in layout:
        turned = np.tensordot(shape, np.moveaxis(cross_matrices(q), (2, 3), (0, 1)), 1)  # S Rᵀ [q]×
        jacobian[:, :3, :, layout.columns["rotation"]] = turned.transpose(2, 0, 3, 1)
    if moved is not None:
        moving = np.tensordot(shape, np.moveaxis(moved, (2, 3), (0, 1)), 1)
        jacobian[:, :3, :, gyro.gyro_columns(layout.columns)] = moving.transpose(2, 0, 3, 1)


def inverse_matrices(matrices: Floats) -> Floats:
    """(W, 2, 2) inverses of symmetric matrices; zero for a singular matrix."""
    a, b, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    determinant = a * d - b * b
    sound = determinant > MIN_DETERMINANT_RATIO * (a + d) ** 2
    inverse = np.array([[d, -b], [-b, a]]) * (sound / np.where(sound, determinant, 1.0))
    return np.moveaxis(inverse, 2, 0)
