"""Alonso and Shuster's TWOSTEP: a centred linear fit of the field's strength, then Gauss–Newton on the whole of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.apps.classic.recipes.attitude_independent import (
    COLLAPSED,
    ENOUGH_EXPLAINED,
    Collapsed,
    ProductSums,
    Reference,
    Weights,
    check_options,
    converged_noise,
    estimate_of,
    jacobian,
    parameters,
    shrunk,
    widened_by_consistent,
)
from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.base import Method

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

STEPS: Final = 2000
"""Of step 2: some ten where all directions were seen, hundreds near where it has no solution any more."""

SMALL: Final = 1e-16
"""Square of the step, in standard deviations, that ends step 2."""

HALVINGS: Final = 30

ROUNDS: Final = 3
"""Fits after which the noise found is the noise used."""


@dataclass(frozen=True, slots=True)
class AlonsoShuster:
    """TWOSTEP: offset and symmetric matrix from the known strength of the field, without attitude.

    With corrected readings m = (I + D) x − b and v = |x|² − H² − Lθ' + |b|², see
    `flinders.apps.classic.recipes.attitude_independent`, it minimises

        Σ (v_k − μ)² / σ_k²,      σ_k² = 4σ²|m|² + 6σ⁴,      μ = −3σ²

    Step 1 takes weighted means off and solves what is left, which is linear in θ'; step 2 goes on from there by
    Gauss–Newton with the mean taken in again. The offset of the readings is (I + D)⁻¹b, not b.

    H is the strength at each reading where the recording tells it (a column such as ``reference_strength_uT``,
    ``igrf_total`` or ``wmm_f``; `Samples.strength`), else `field_strength`, else the radius of the consistent
    ellipsoid, with which the scale stays unknown. Step 1 needs a strength that varies: with one and the same it gives
    D = −I for any readings. Where the readings explain less than half of the variance of H², step 2 therefore starts
    from `Consistent`.

    Use it where the strength varies by more than the noise and is known: in an orbit, on a climb, over several places.
    It is the only method here that such a recording does not mislead. With one strength it is for parity with
    MAGYC and others: `Auto` is as good all round, and where coverage is partial far better, as noise pulls this
    cost towards D = −I. A strength that is 1 % wrong makes the scale 1 % wrong.

    Parameters
    ----------
    weights : str
        Where σ_k² is evaluated: ``"estimate"``, where |m| is H, or ``"prior"``, at D = 0 and b = 0, where it is the
        length of the raw reading, as MAGYC has it.
    noise : float, optional
        σ of each axis of m, in the unit of the readings; found from the readings where it is not given.
    field_strength : float, optional
        H, where the recording does not tell it.

    Notes
    -----
    Covariance: P = J⁻¹F⁻¹J⁻ᵀ of (b, D) with J = ∂(c, E)/∂(b, D), carried over to centre and shape;
    with ``"prior"`` weights F⁻¹BF⁻¹ in place of F⁻¹, as they are not what v varies. With one strength the difference
    from `Consistent` joins it: that is how far noise has pulled. How residuals are correlated, and
    what separates it from the likelihood, of readings brought to one strength, joins it
    (`flinders.estimators.base`).

    Steps are halved where the cost would grow; where their way leads to D = −I it ends with `Collapsed`. Whole steps,
    as published, go round in a circle on half a sphere with 4 % noise (`tests/classic/test_twostep_golden.py`).

    μ = −3σ² is the published mean of v given the reading; given the field it is +3σ². The difference is one
    of scale, 3σ²/H².

    References
    ----------
    .. [1] R. Alonso, M. D. Shuster, "TWOSTEP: A Fast Robust Algorithm for Attitude-Independent Magnetometer-Bias
       Determination", J. Astronaut. Sci. 50 (2002) 433–451; "Complete Linear Attitude-Independent Magnetometer
       Calibration", ibid. 477–490. Equations as in the implementation of MAGYC; the papers' own tables were not read.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> from flinders.core.samples import Samples
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> strength = 35.0 + 10.0 * np.sin(np.arange(2000) / 86)
    >>> field = (strength[:, None] * directions) @ np.diag([0.9, 1.0, 1.2]) + [20, 120, 90]
    >>> field += rng.normal(scale=0.2, size=field.shape)
    >>> fit = AlonsoShuster().estimate(Readings.of(Samples.of(field, strength=strength)))
    >>> fit.ellipsoid.centre.round(1), (fit.strength * np.linalg.inv(fit.ellipsoid.shape)).diagonal().round(2)
    (array([ 20., 120.,  90.]), array([1.11, 1.  , 0.83]))
    """

    weights: Weights = "estimate"
    noise: float | None = None
    field_strength: float | None = None

    name: ClassVar[str] = "alonso-shuster"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse options that mean nothing."""
        check_options(weights=self.weights, noise=self.noise, field_strength=self.field_strength)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NeedsSamples` where
        there are only sums; `WrongStrength` if the strength told at each reading cannot be the field's; `Undetermined`
        if the readings leave parameters open, as two rings without noise do; `NotAnEllipsoid` if neither step 1 nor the
        consistent fit gives an ellipsoid to begin with; `Collapsed` if step 2 goes to D = −I.
        """
        readings.require(self.unknowns, self.name)
        reference = Reference.of(readings, self.name, self.field_strength)
        noise = self._given(reference) or reference.noise
        sums = ProductSums.of(reference, noise, self.weights)
        start = self.start(reference, sums)
        if unobserved := sums.unobserved(start):
            raise Undetermined(unobserved)
        theta = start
        for _ in range(ROUNDS if self._given(reference) is None else 1):
            theta = converged(sums, theta, start, self.name)
            b, d = parameters(theta, self.name)
            noise = self._given(reference) or converged_noise(reference, b, d, self.unknowns - 1)
            sums = ProductSums.of(reference, noise, self.weights)
        inverse = np.linalg.inv(jacobian(b, d))
        covariance = inverse @ sums.covariance(theta) @ inverse.T
        estimate = estimate_of(reference, b, d, covariance, self.name)
        return estimate if reference.varies else widened_by_consistent(estimate, reference)

    def start(self, reference: Reference, sums: ProductSums) -> Floats:
        """(9,) θ' of step 1 where the strength varies enough, else of the consistent ellipsoid.

        Raises `WrongStrength` or `NotAnEllipsoid` as `estimate`.
        """
        if not reference.varies:
            return reference.start()
        explained = sums.explained
        reference.refuse_unrelated(explained)
        if explained < ENOUGH_EXPLAINED:
            return reference.start()
        theta = sums.solved()
        parameters(theta, self.name)
        return theta

    def _given(self, reference: Reference) -> float | None:
        """The noise that was given, in units of the mean strength."""
        return None if self.noise is None else self.noise / reference.mean


def converged(sums: ProductSums, theta: Floats, start: Floats, method: str) -> Floats:
    """(9,) θ' that minimises the whole cost: step 2.

    Raises `Collapsed` if the gain shrinks to half of that of `start` along any direction, or the steps do not settle.

    Parameters
    ----------
    theta : (9,) float
        Where to begin.
    start : (9,) float
        What the gain is compared with.
    method : str
        For messages.
    """
    cost = sums.cost(theta)
    for _ in range(STEPS):
        information = sums.information(theta)
        step = -np.linalg.solve(information, sums.gradient(theta))
        if float(step @ information @ step) < SMALL:
            return theta
        moved = _improved(sums, theta, step, cost)
        if moved is None:
            return theta
        theta, cost = moved
        if shrunk(theta, start) < COLLAPSED:
            break
    raise Collapsed(method, shrunk(theta, start))


def _improved(sums: ProductSums, theta: Floats, step: Floats, cost: float) -> tuple[Floats, float] | None:
    """Take a step, its half, its quarter …: the first that leaves an ellipsoid and costs less; with what it costs."""
    for _ in range(HALVINGS):
        moved = theta + step
        try:
            parameters(moved)
            less = sums.cost(moved)
        except (NotAnEllipsoid, np.linalg.LinAlgError):
            less = np.inf
        if less < cost:
            return moved, less
        step = step / 2.0
    return None


METHOD: Final = Method(
    AlonsoShuster,
    use="TWOSTEP, from a strength of the field that is known at each reading and varies",
    source="Alonso and Shuster (2002)",
    is_recipe=True,
)
