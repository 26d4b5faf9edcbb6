"""Alonso and Shuster's TWOSTEP: a centred linear fit of the field's strength, then Gauss–Newton on the whole cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.apps.classic.recipes.attitude_independent import (
    MIN_EXPLAINED,
    MIN_GAIN_RATIO,
    Collapsed,
    ProductSums,
    Reference,
    Weights,
    check_options,
    converged_noise,
    estimate_of,
    gain_ratio,
    jacobian,
    parameters,
    widen_by_consistent,
)
from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.base import Method

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

MAX_STEPS: Final = 2000
"""Largest number of iterations in step 2: some ten with all directions covered, hundreds near a collapse."""

MIN_STEP_SQUARED: Final = 1e-16
"""Square of the step, in standard deviations, that ends step 2."""

MAX_HALVINGS: Final = 30
"""Largest number of halvings of a step."""

ROUNDS: Final = 3
"""Number of fits, each with the noise of the previous one."""


@dataclass(frozen=True, slots=True)
class AlonsoShuster:
    """TWOSTEP: offset and symmetric matrix from the known strength of the field, without attitude.

    With corrected readings m = (I + D) x − b and v = |x|² − H² − Lθ' + |b|², see
    `flinders.apps.classic.recipes.attitude_independent`, it minimises

        Σ (v_k − μ)² / σ_k²,      σ_k² = 4σ²|m|² + 6σ⁴,      μ = −3σ²

    Step 1 removes weighted means and solves the rest, which is linear in θ'; step 2 continues by Gauss–Newton on the
    cost with the mean included. The offset of the readings is (I + D)⁻¹b, not b.

    H is the strength at each reading if the recording has it (a column such as ``reference_strength_uT``,
    ``igrf_total`` or ``wmm_f``; `Samples.strength`), else `field_strength`, else the radius of the consistent
    ellipsoid, with which the scale stays unknown. Step 1 needs a strength that varies: a constant one gives D = −I for
    any readings. If the readings explain less than half of the variance of H², step 2 therefore starts from
    `Consistent`.

    Use it if the strength is known and varies by more than the noise: in an orbit, on a climb, over several places. It
    is the only method here that is unbiased on such a recording. With constant strength it is for parity with MAGYC and
    others: `Auto` is as good with full coverage, and far better with partial coverage, as noise pulls this cost towards
    D = −I. A strength that is 1 % wrong makes the scale 1 % wrong.

    Parameters
    ----------
    weights : str
        Point at which σ_k² is evaluated: ``"estimate"``, where |m| is H, or ``"prior"``, at D = 0 and b = 0, where |m|
        is the length of the raw reading, as in MAGYC.
    noise : float, optional
        σ of each axis of m, in the unit of the readings; estimated from the readings by default.
    field_strength : float, optional
        H, if the recording does not have it.

    Notes
    -----
    Covariance: P = J⁻¹F⁻¹J⁻ᵀ of (b, D) with J = ∂(c, E)/∂(b, D), converted to centre and shape; with ``"prior"``
    weights F⁻¹BF⁻¹ in place of F⁻¹, as these weights are not the inverse variances of v. With constant strength the
    difference from `Consistent` is added, which measures the pull of noise. The correlation of residuals, and the
    difference from the likelihood of readings scaled to one strength, are added too (`flinders.estimators.base`).

    A step is halved if the cost would grow; a sequence of steps towards D = −I ends with `Collapsed`. Whole steps, as
    published, do not converge on half a sphere with 4 % noise (`tests/classic/test_twostep_golden.py`).

    μ = −3σ² is the published mean of v given the reading; given the field it is +3σ². The two differ in scale, by
    3σ²/H².

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
        """Refuse invalid options."""
        check_options(weights=self.weights, noise=self.noise, field_strength=self.field_strength)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NeedsSamples` if only
        sums are given; `WrongStrength` if the strength in the recording cannot be the field's; `Undetermined` if the
        readings do not determine all parameters, such as two rings without noise; `NotAnEllipsoid` if neither step 1
        nor the consistent fit gives an ellipsoid to start from; `Collapsed` if step 2 goes to D = −I.
        """
        readings.require(self.unknowns, self.name)
        reference = Reference.of(readings, self.name, self.field_strength)
        noise = self._given_noise(reference) or reference.noise
        sums = ProductSums.of(reference, noise, self.weights)
        start = self.start(reference, sums)
        if unobserved := sums.unobserved(start):
            raise Undetermined(unobserved)
        theta = start
        for _ in range(ROUNDS if self._given_noise(reference) is None else 1):
            theta = minimise(sums, theta, start, self.name)
            b, d = parameters(theta, self.name)
            noise = self._given_noise(reference) or converged_noise(reference, b, d, self.unknowns - 1)
            sums = ProductSums.of(reference, noise, self.weights)
        inverse = np.linalg.inv(jacobian(b, d))
        covariance = inverse @ sums.covariance(theta) @ inverse.T
        estimate = estimate_of(reference, b, d, covariance, self.name)
        return estimate if reference.varies else widen_by_consistent(estimate, reference)

    def start(self, reference: Reference, sums: ProductSums) -> Floats:
        """(9,) θ' of step 1 if the strength varies enough, else of the consistent ellipsoid.

        Raises `WrongStrength` or `NotAnEllipsoid` as `estimate`.
        """
        if not reference.varies:
            return reference.start()
        explained = sums.explained_share
        reference.refuse_unrelated(explained)
        if explained < MIN_EXPLAINED:
            return reference.start()
        theta = sums.solve()
        parameters(theta, self.name)
        return theta

    def _given_noise(self, reference: Reference) -> float | None:
        """The given noise, in units of the mean strength; None if none was given."""
        return None if self.noise is None else self.noise / reference.mean


def minimise(sums: ProductSums, theta: Floats, start: Floats, method: str) -> Floats:
    """(9,) θ' that minimises the whole cost: step 2.

    Raises `Collapsed` if the gain shrinks to half of that of `start` along any direction, or without convergence.

    Parameters
    ----------
    theta : (9,) float
        Starting point.
    start : (9,) float
        θ' whose gain is the reference for `Collapsed`.
    method : str
        Name of the method in messages.
    """
    cost = sums.cost(theta)
    for _ in range(MAX_STEPS):
        information = sums.information(theta)
        step = -np.linalg.solve(information, sums.gradient(theta))
        if float(step @ information @ step) < MIN_STEP_SQUARED:
            return theta
        moved = _improve(sums, theta, step, cost)
        if moved is None:
            return theta
        theta, cost = moved
        if gain_ratio(theta, start) < MIN_GAIN_RATIO:
            break
    raise Collapsed(method, gain_ratio(theta, start))


def _improve(sums: ProductSums, theta: Floats, step: Floats, cost: float) -> tuple[Floats, float] | None:
    """θ' and its cost after a step that is halved until the result is an ellipsoid with a smaller cost; else None."""
    for _ in range(MAX_HALVINGS):
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
    use="TWOSTEP: the field strength is known at each reading, and varies",
    source="Alonso and Shuster (2002)",
    is_recipe=True,
)
