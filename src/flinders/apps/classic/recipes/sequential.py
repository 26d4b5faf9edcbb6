"""Sequential: the centred fit of the field's strength as a recursion over readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flinders.apps.classic.recipes.attitude_independent import (
    MAX_READINGS,
    MIN_EXPLAINED,
    ConstantStrength,
    ProductSums,
    Reference,
    Weights,
    beta,
    check_options,
    converged_noise,
    estimate_of,
    jacobian,
    parameters,
    rows_of,
)
from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators.base import Method

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.estimators.trace import Convergence

Find: TypeAlias = Literal["auto", "all", "offset"]
Form: TypeAlias = Literal["exact", "published"]

MIN_BATCH: Final = 20
"""Smallest number of readings in the first batch; it is doubled until the batch determines the unknowns."""

MAX_CONDITION: Final = 1e8
"""Largest condition number of the information of the first batch, with its diagonal scaled to 1."""

_IDENTITY: Final = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Sequential:
    """Centred recursion: θ' and its covariance from one reading after the other, without storing readings.

    With z, L, μ and σ_k² as in `flinders.apps.classic.recipes.attitude_independent`, and their weighted means so far
    z̄, L̄ and s̄² = 1/Σσ_k⁻², a reading has the innovation and its variance

        y = (z_k − μ − z̄) − (L_k − L̄) θ',      R = σ_k² + s̄²

    after which P and θ' are updated as in a Kalman filter, and then the means. The result is exactly the batch solution
    of all readings so far. ``form="published"`` updates the means first and uses R = σ_k², as implementations of the
    paper do [1]_; the final difference is within a hundredth of the claim. Noise makes (c, I + E) too small by the
    unexplained share of the variance of H²; `rescale` corrects this from the means when the state is read, not in the
    recursion.

    ``find="offset"`` keeps D = 0: three unknowns, well posed for any strength. ``find="all"`` finds offset and matrix,
    and is refused if the field's strength does not vary enough, as any readings then give D = −I. ``"auto"`` finds all
    if the readings explain at least half of the variance of H², else the offset. H is found as for `AlonsoShuster`.

    Use it to monitor a sensor on a small processor, with a few hundred multiplications for each reading. If the
    readings can be stored, `AlonsoShuster` is better, as it uses the information of the means on all parameters.
    `converge` shows the convergence.

    Parameters
    ----------
    find : str
        Parameters to find: ``"offset"``, ``"all"`` or ``"auto"``.
    form : str
        Order of the updates: ``"exact"``, or ``"published"``.
    weights : str
        As for `AlonsoShuster`.
    noise : float, optional
        σ of each axis, in the unit of the readings; estimated from the readings by default.
    field_strength : float, optional
        H, if the recording does not have it.

    Notes
    -----
    It starts from a batch of the first 20 readings, doubled until they determine the unknowns. Covariance: P, converted
    to centre and shape, plus the difference from the likelihood (`flinders.estimators.base`).

    References
    ----------
    .. [1] J. L. Crassidis, K.-L. Lai, R. R. Harman, "Real-Time Attitude-Independent Three-Axis Magnetometer
       Calibration", J. Guid. Control Dyn. 28 (2005) 115–120. Equations as in its implementations, with their order
       corrected; the paper's own tables were not read.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = 50.0 * directions + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> settling = Sequential(find="offset").converge(Readings.of(field), steps=4)
    >>> settling.counts, settling.parameters[-1, :3].round(1)
    (array([ 125,  500, 1125, 2000]), array([ 20., 120.,  90.]))
    """

    find: Find = "auto"
    form: Form = "exact"
    weights: Weights = "estimate"
    noise: float | None = None
    field_strength: float | None = None

    name: ClassVar[str] = "sequential"
    unknowns: ClassVar[int] = 5
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse invalid options."""
        for name, value, choices in (("find", self.find, get_args(Find)), ("form", self.form, get_args(Form))):
            if value not in choices:
                raise UsageError(f"{name} is {value!r}: need one of {', '.join(choices)}")
        check_options(weights=self.weights, noise=self.noise, field_strength=self.field_strength)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; all parameters need ten
        readings; `NeedsSamples` if only sums are given; `ConstantStrength` for all parameters, if the field's strength
        varies too little; `WrongStrength` if the strength in the recording cannot be the field's; `NotAnEllipsoid` if
        the readings do not determine the unknowns, or give no ellipsoid.
        """
        reference, noise, find = self._prepare(readings)
        state, *_ = self._states(reference, noise, find, [])[-1:]
        if state is None:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        return self._estimate(state, reference, find)

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Estimates after about `steps` numbers of readings; None before the first batch is complete.

        Raises the errors of `estimate`.
        """
        reference, noise, find = self._prepare(readings)
        counts = reference.counts(steps)
        states = self._states(reference, noise, find, counts)
        if states[-1] is None:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        return reference.convergence(counts, [self._followed_estimate(state, reference, find) for state in states])

    def _prepare(self, readings: Readings) -> tuple[Reference, float, Find]:
        """Reference with the strength, noise in units of the mean strength, and the parameters to find."""
        readings.require(10 if self.find == "all" else self.unknowns, self.name)
        reference = Reference.of(readings, self.name, self.field_strength)
        noise = reference.noise if self.noise is None else self.noise / reference.mean
        explained = 0.0
        if reference.varies and self.find != "offset":
            sums = ProductSums.of(reference, noise, self.weights)
            explained = sums.explained_share
            reference.refuse_unrelated(explained)
            if self.noise is None and explained >= MIN_EXPLAINED:
                noise = converged_noise(reference, *parameters(sums.solve(), self.name), 9)
        enough = explained >= MIN_EXPLAINED
        if self.find == "all" and not enough:
            raise ConstantStrength(self.name, explained)
        return reference, noise, "all" if enough else "offset"

    def _states(
        self, reference: Reference, noise: float, find: Find, counts: Sequence[int]
    ) -> list[SequentialState | None]:
        """State after each of `counts` readings, or after all without counts; None before the first batch."""
        field, strength = reference.thin(MAX_READINGS)
        rows, variance = rows_of(field, strength, noise), reference.variances(field, strength, noise, self.weights)
        unknowns = 9 if find == "all" else 3
        regressors, z = rows[:, :9], rows[:, 9]
        state: SequentialState | None = None
        at, states = 0, []
        begin = first_batch(regressors[:, :unknowns], variance)
        for count in counts or [len(z)]:
            if state is None and count >= begin > 0:
                state, at = SequentialState.of(regressors[:begin], z[:begin], variance[:begin], unknowns), begin
            if state is not None:
                taken = slice(at, count)
                state = state.update(regressors[taken], z[taken], variance[taken], exact=self.form == "exact")
                at = count
            states.append(state)
        return states

    def _followed_estimate(self, state: SequentialState | None, reference: Reference, find: Find) -> Estimate | None:
        """Estimate from a state during the recursion; None while it is no ellipsoid."""
        try:
            return None if state is None else self._estimate(state, reference, find, is_partial=True)
        except NotAnEllipsoid:
            return None

    def _estimate(
        self, state: SequentialState, reference: Reference, find: Find, *, is_partial: bool = False
    ) -> Estimate:
        """Make an `Estimate` from a state of the recursion."""
        theta, covariance = rescale(state)
        b, d = parameters(theta, self.name)
        inverse = np.linalg.inv(jacobian(b, d))
        covariance = inverse @ covariance @ inverse.T
        named = self.name if find == "all" else f"{self.name} offset"
        made = estimate_of(reference, b, d, covariance, named, is_partial=is_partial)
        return replace(made, estimator=self.name)


class SequentialState(NamedTuple):
    """State of the recursion: θ', its covariance, and the means.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> rows, z, variance = rng.normal(size=(50, 9)), rng.normal(size=50), np.ones(50)
    >>> begun, whole = SequentialState.of(rows[:20], z[:20], variance[:20]), SequentialState.of(rows, z, variance)
    >>> np.allclose(begun.update(rows[20:], z[20:], variance[20:]).theta, whole.theta, atol=1e-13)
    True
    """

    theta: Floats  # (k,): the first k of θ': three, or nine
    covariance: Floats  # (k, k)
    row: Floats  # (9,): L̄
    value: float  # z̄ − μ̄
    variance: float  # s̄²

    @classmethod
    def of(cls, rows: Floats, z: Floats, variances: Floats, unknowns: int = 9) -> SequentialState:
        """Batch solution for (m, 9) rows L, (m,) z − μ and (m,) σ_k², of the first three or all nine of θ'."""
        weights = 1.0 / variances
        variance = float(1.0 / weights.sum())
        row, value = variance * (weights @ rows), float(variance * (weights @ z))
        local = (rows - row)[:, :unknowns]
        covariance = np.linalg.inv((local.T * weights) @ local)
        return cls(covariance @ ((local.T * weights) @ (z - value)), covariance, row, value, variance)

    def update(self, rows: Floats, z: Floats, variances: Floats, *, exact: bool = True) -> SequentialState:
        """State after more readings, one by one."""
        theta, covariance, row, value, variance = self
        known = len(theta)
        for one, measured, own in zip(rows, z.tolist(), variances.tolist(), strict=True):
            share = variance / (own + variance)
            if exact:
                across, innovation, noise = (one - row)[:known], measured - value, own + variance
            row = row + share * (one - row)
            value = value + share * (measured - value)
            variance = own * share
            if not exact:
                across, innovation, noise = (one - row)[:known], measured - value, own
            moved = covariance @ across
            gain = moved / (float(across @ moved) + noise)
            theta = theta + gain * (innovation - float(across @ theta))
            covariance = covariance - np.multiply.outer(gain, moved)
        return SequentialState(theta, (covariance + covariance.T) / 2.0, row, value, variance)


def first_batch(rows: Floats, variances: Floats) -> int:
    """Smallest number of first rows of an (N, k) matrix that determine k unknowns; 0 if even all rows do not."""
    count = MIN_BATCH
    while count < 2 * len(rows):
        taken = min(count, len(rows))
        local = (rows[:taken] - rows[:taken].mean(axis=0)) / np.sqrt(variances[:taken, np.newaxis])
        lengths = np.sqrt(np.einsum("ij,ij->j", local, local))
        if lengths.min() > 0.0 and np.linalg.cond(local / lengths) ** 2 < MAX_CONDITION:
            return taken
        count *= 2
    return 0


def rescale(state: SequentialState) -> tuple[Floats, Floats]:
    """(9,) θ' and its (9, 9) covariance, scaled to κc and κ(I + E) so that the means fit: z̄ − L̄θ' + β = μ̄.

    Centring ignores the means, and noise makes c and I + E too small by one factor. If only the offset was found, E is
    0, and the scale is that of a sphere.
    """
    known = len(state.theta)
    theta, covariance = np.zeros(9), np.zeros((9, 9))
    theta[:known], covariance[:known, :known] = state.theta, state.covariance
    grown = theta + _IDENTITY  # (c, I + E)
    level, slope = beta(theta)
    factor = (state.value + float(state.row @ _IDENTITY)) / (float(state.row @ grown) - level)
    steep = (state.row - slope) / float((state.row - slope) @ grown)
    jacobian = factor * (np.eye(9) - np.outer(grown, steep))
    own = state.variance * np.outer(grown, grown) / float((state.row - slope) @ grown) ** 2
    return factor * grown - _IDENTITY, jacobian @ covariance @ jacobian.T + own


METHOD: Final = Method(
    Sequential,
    use="centred, reading by reading: the offset, or all parameters if a varying field strength is known",
    source="Crassidis, Lai and Harman (2005)",
    is_recipe=True,
)
