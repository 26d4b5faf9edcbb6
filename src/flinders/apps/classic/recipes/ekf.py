"""EKF: an extended Kalman filter for offset and matrix, from the strength of the field alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flinders.apps.classic.recipes.attitude_independent import (
    BASIS,
    MAX_READINGS,
    MIN_EXPLAINED,
    Collapsed,
    ProductSums,
    Reference,
    check_options,
    converged_noise,
    estimate_of,
    parameters,
    widen_by_consistent,
)
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.errors import UsageError
from flinders.estimators.base import Method
from flinders.geometry.ellipsoid import symmetric_matrix, upper_entries

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.estimators.trace import Convergence

Start: TypeAlias = Literal["sphere", "zero"]

MAX_DISTORTION_SPREAD: Final = 0.1
"""Largest standard deviation of D at the start; with a value of 1, D = −I would be likely."""

MIN_FILTER_GAIN: Final = 0.25
"""Smallest gain of a filter that has not collapsed, as a share of the smallest gain at the start."""

_EYE: Final = np.eye(9)


@dataclass(frozen=True, slots=True)
class Ekf:
    """Extended Kalman filter whose state is (b, D), measured by z = |x|² − H² at each reading.

        h(b, D) = −xᵀ(2D + D²)x + 2xᵀ(I + D)b − |b|²,      R = 4σ²|m|² + 6σ⁴,      mean of the noise −3σ²

    linearised at the current state, with the covariance in Joseph's form [1]_. b and D are those of
    `flinders.apps.classic.recipes.attitude_independent`; H is found as for `AlonsoShuster`. A constant strength works
    too: if directions come at random, the prior keeps the filter away from D = −I.

    The default `spread` is about that of the replications. With 0.3 many tumbles by hand lead the filter to D = −I:
    while the sensor stays near one direction, the filter fits noise along the unobserved directions.

    Use it to see how a filter on board converges, with `converge`, and for parity with one. Do not use it for accuracy:
    each reading is linearised at the state of its time, so that the result depends on the order and on the start, which
    the filter's covariance ignores. The difference from fits of all readings at once is added to the covariance here,
    which is not possible on board.

    Parameters
    ----------
    start : str
        ``"sphere"``: from the sphere through all readings. ``"zero"``: from b = 0 and D = 0, as published.
    spread : float
        Standard deviation of the start: that of b as a share of the strength, and that of D, which is at most 0.1. A
        start at zero needs a spread as large as the hard iron.
    walk : float
        Random walk of the state from one reading to the next, as a share of the strength; 0 for a constant sensor.
    noise : float, optional
        σ of each axis, in the unit of the readings; estimated from the readings by default.
    field_strength : float, optional
        H, if the recording does not have it.

    Notes
    -----
    Covariance: that of the filter, converted to centre and shape. With constant strength the whole difference from
    `Consistent` is added, as an estimate of the influence of order and start. True heading errors are then 1.0 to 1.1
    times those claimed (rms, `tests/classic/test_attitude_independent.py`).

    References
    ----------
    .. [1] J. L. Crassidis, K.-L. Lai, R. R. Harman, "Real-Time Attitude-Independent Three-Axis Magnetometer
       Calibration", J. Guid. Control Dyn. 28 (2005) 115–120. Equations as in replications of it, with
       z − h(x) for the innovation and σ_k² for its variance; the paper's own tables were not read.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions @ np.diag([45, 50, 55]) + [20, 120, 90] + rng.normal(scale=0.2, size=directions.shape)
    >>> ellipsoid = Ekf().estimate(Readings.of(field)).ellipsoid
    >>> ellipsoid.centre.round(), ellipsoid.shape.diagonal().round()
    (array([ 20., 120.,  90.]), array([45., 50., 55.]))
    """

    start: Start = "sphere"
    spread: float = 0.05
    walk: float = 0.0
    noise: float | None = None
    field_strength: float | None = None

    name: ClassVar[str] = "ekf"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse invalid options."""
        if self.start not in get_args(Start):
            raise UsageError(f"start is {self.start!r}: need {', '.join(get_args(Start))}")
        limits: list[tuple[str, float | None, float]] = [("spread", self.spread, 1e-9), ("walk", self.walk, 0.0)]
        for name, value, least in limits:
            if value is None or not least <= value <= 100.0:
                raise UsageError(f"{name} is {value!r}: need a number from {least:g} to 100")
        check_options(weights="estimate", noise=self.noise, field_strength=self.field_strength)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NeedsSamples` if only
        sums are given; `WrongStrength` if the strength in the recording cannot be the field's; `NotAnEllipsoid` if not
        even a sphere fits the readings; `Collapsed` if the filter goes to D = −I.
        """
        reference, _, (begun, ended) = self._states(readings)
        gained = ended.gain / begun.gain
        if not gained > MIN_FILTER_GAIN:
            raise Collapsed(
                self.name,
                gained,
                "the order of the readings makes the filter diverge, which a smaller spread may prevent",
            )
        estimate = self._estimate(ended, reference)
        return estimate if reference.varies else widen_by_consistent(estimate, reference)

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Estimates after about `steps` numbers of readings, up to the one at which the filter goes to D = −I.

        Raises the errors of `estimate`, except `Collapsed`.
        """
        reference, counts, (begun, *states) = self._states(readings, steps)
        followed = [
            self._estimate(state, reference, is_partial=True) if state.gain > MIN_FILTER_GAIN * begun.gain else None
            for state in states
        ]
        return reference.convergence(counts, followed)

    def _states(self, readings: Readings, steps: int = 0) -> tuple[Reference, list[int], list[FilterState]]:
        """Reference, number of readings at each step, and states: the start and one for each step.

        For 0 steps there is one step, after all readings.
        """
        readings.require(self.unknowns, self.name)
        reference = Reference.of(readings, self.name, self.field_strength)
        noise = self._noise(reference)
        field, strength = reference.thin(MAX_READINGS)
        state = self._start_state(reference)
        counts = reference.counts(steps) if steps else [len(field)]
        at, states = 0, [state]
        for count in counts:
            taken = slice(at, count)
            state = state.update(field[taken], strength[taken], noise, walk=self.walk)
            states.append(state)
            at = count
        return reference, counts, states

    def _noise(self, reference: Reference) -> float:
        """Noise that was given, else that of the centred fit if the strength varies, else that of the ellipsoid."""
        if self.noise is not None:
            return self.noise / reference.mean
        count = len(reference.readings)
        noise = reference.noise * float(np.sqrt(count / (count - 9)))
        if reference.varies:
            sums = ProductSums.of(reference, noise)
            reference.refuse_unrelated(sums.explained_share)
            if sums.explained_share >= MIN_EXPLAINED:
                return converged_noise(reference, *parameters(sums.solve(), self.name), 9)
        return noise

    def _start_state(self, reference: Reference) -> FilterState:
        """Start of the filter: (b', D') and its covariance."""
        distortion = min(self.spread, MAX_DISTORTION_SPREAD)
        if self.start == "sphere":
            sphere = Sphere().estimate(reference.readings).ellipsoid
            gain = reference.size / sphere.radius
            b = (sphere.centre - reference.origin) / sphere.radius
            spreads = np.concatenate([np.full(3, self.spread), np.full(6, distortion * gain)])
            return FilterState(np.concatenate([b, upper_entries((gain - 1.0) * np.eye(3))]), np.diag(spreads**2))
        gain, origin = reference.size / reference.mean, reference.origin / reference.mean
        moved = self.spread * np.eye(9)  # root of the covariance of independent b and D
        moved[:3, 3:] = -distortion * (BASIS @ origin).T
        moved[3:, 3:] = distortion * gain * np.eye(6)
        return FilterState(np.concatenate([-origin, upper_entries((gain - 1.0) * np.eye(3))]), moved @ moved.T)

    def _estimate(self, state: FilterState, reference: Reference, *, is_partial: bool = False) -> Estimate:
        b, d = state.values[:3], symmetric_matrix(state.values[3:])
        return estimate_of(reference, b, d, state.covariance, self.name, is_partial=is_partial)


class FilterState(NamedTuple):
    """State of the filter, with its covariance.

    Examples
    --------
    >>> start = FilterState(np.zeros(9), 0.01 * np.eye(9))
    >>> state = start.update(np.array([[1.1, 0.0, 0.0], [-0.9, 0.0, 0.0]]), np.ones(2), noise=1e-3)
    >>> state.values[:3].round(2)
    array([0.1, 0. , 0. ])
    """

    values: Floats  # (9,): b, D₁₁, D₂₂, D₃₃, D₁₂, D₁₃, D₂₃
    covariance: Floats  # (9, 9)

    @property
    def gain(self) -> float:
        """Smallest gain of I + D along any direction; 0 if I + D is not positive."""
        return max(float(np.linalg.eigvalsh(np.eye(3) + symmetric_matrix(self.values[3:]))[0]), 0.0)

    def update(self, field: Floats, strength: Floats, noise: float, *, walk: float = 0.0) -> FilterState:
        """State after (m, 3) readings x' and (m,) strengths, one by one."""
        values, covariance = self
        moves = np.concatenate([np.broadcast_to(-np.eye(3), (len(field), 3, 3)), _distortion_jacobian(field)], axis=2)
        for reading, move, squared in zip(field, moves, (strength**2).tolist(), strict=True):
            corrected = reading + move @ values
            square = float(corrected @ corrected)
            slope = -2.0 * corrected @ move
            innovation = square - squared + 3.0 * noise**2
            variance = 4.0 * noise**2 * square + 6.0 * noise**4
            if walk:
                covariance = covariance + walk**2 * _EYE
            moved = covariance @ slope
            gain = moved / (float(slope @ moved) + variance)
            values = values + gain * innovation
            reduced = _EYE - np.outer(gain, slope)
            covariance = reduced @ covariance @ reduced.T + variance * np.outer(gain, gain)
        return FilterState(values, (covariance + covariance.T) / 2.0)


def _distortion_jacobian(field: Floats) -> Floats:
    """(m, 3, 6) Jacobian ∂(Dx)/∂(D₁₁, D₂₂, D₃₃, D₁₂, D₁₃, D₂₃) at m vectors x (m, 3)."""
    moves: Floats = np.einsum("kij,mj->mik", BASIS, field)
    return moves


METHOD: Final = Method(
    Ekf,
    use="an extended Kalman filter, as it would converge on board; depends on order and start",
    source="Crassidis, Lai and Harman (2005)",
    is_recipe=True,
)
