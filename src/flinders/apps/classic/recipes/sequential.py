"""Sequential: the centred fit of the field's strength, one reading after the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from flinders.apps.classic.recipes.attitude_independent import (
    ENOUGH_EXPLAINED,
    MOST,
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

FIRST: Final = 20
"""Readings of the batch that the recursion starts from, at the least: doubled until they determine its unknowns."""

WELL_CONDITIONED: Final = 1e8
"""Of the information of that batch, its diagonal scaled to one."""

_IDENTITY: Final = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Sequential:
    """Centred recursion: θ' and its covariance from each reading in turn, without keeping any.

    With z, L, μ and σ_k² as in `flinders.apps.classic.recipes.attitude_independent`, and their weighted means so far
    z̄, L̄ and s̄² = 1/Σσ_k⁻², a reading brings the innovation and its variance

        y = (z_k − μ − z̄) − (L_k − L̄) θ',      R = σ_k² + s̄²

    after which P and θ' are those of a Kalman filter and the means take the reading in. That is exactly the batch
    solution of all readings so far. ``form="published"`` takes the means first and R = σ_k², as
    implementations of the paper do [1]_: it ends within a hundredth of its claim. Noise makes (c, I + E) too small
    by the share of the variance of H² that is not explained; the means, which are kept anyway, say by how much, and
    that is put right when the state is read out, not in the recursion.

    ``find="offset"`` holds D = 0: three unknowns, and well posed whatever the strength does. ``find="all"``
    finds offset and matrix, and is refused where the field's strength does not vary enough, as
    any readings then give D = −I. ``"auto"`` takes all where the readings explain at least half of the variance of
    H², and the offset elsewhere. H is found as for `AlonsoShuster`.

    Use it to watch a sensor on a small processor: a few hundred multiplications a reading. Where the readings can be
    kept `AlonsoShuster` is better: it uses what the means say of all parameters. `converge` shows how it settles.

    Parameters
    ----------
    find : str
    form : str
    weights : str
        As for `AlonsoShuster`.
    noise : float, optional
        σ of each axis, in the unit of the readings; found from the readings where it is not given.
    field_strength : float, optional
        H, where the recording does not tell it.

    Notes
    -----
    It starts from a batch of the first 20 readings, doubled until they determine the unknowns. Covariance:
    P, carried over to centre and shape; what separates it from the likelihood joins it
    (`flinders.estimators.base`).

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
        """Refuse options that mean nothing."""
        for name, value, choices in (("find", self.find, get_args(Find)), ("form", self.form, get_args(Form))):
            if value not in choices:
                raise UsageError(f"{name} is {value!r}: need {', '.join(choices)}")
        check_options(weights=self.weights, noise=self.noise, field_strength=self.field_strength)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; ten readings for all
        parameters; `NeedsSamples` where there are only sums; `ConstantStrength` for all parameters, where the field's
        strength varies too little; `WrongStrength` if the strength told at each reading cannot be the field's;
        `NotAnEllipsoid` if the readings do not determine the unknowns, or what they give is open.
        """
        reference, noise, find = self._prepared(readings)
        state, *_ = self._states(reference, noise, find, [])[-1:]
        if state is None:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        return self._estimate(state, reference, find)

    def converge(self, readings: Readings, steps: int = 100) -> Convergence:
        """Follow the estimate at about so many steps; nothing is known before the batch that it starts from.

        Raises `FitError` as `estimate`.
        """
        reference, noise, find = self._prepared(readings)
        counts = reference.counts(steps)
        states = self._states(reference, noise, find, counts)
        if states[-1] is None:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), self.name)
        return reference.convergence(counts, [self._followed(state, reference, find) for state in states])

    def _prepared(self, readings: Readings) -> tuple[Reference, float, Find]:
        """The strength, the noise in units of its mean, and what is to be found."""
        readings.require(10 if self.find == "all" else self.unknowns, self.name)
        reference = Reference.of(readings, self.name, self.field_strength)
        noise = reference.noise if self.noise is None else self.noise / reference.mean
        explained = 0.0
        if reference.varies and self.find != "offset":
            sums = ProductSums.of(reference, noise, self.weights)
            explained = sums.explained
            reference.refuse_unrelated(explained)
            if self.noise is None and explained >= ENOUGH_EXPLAINED:
                noise = converged_noise(reference, *parameters(sums.solved(), self.name), 9)
        enough = explained >= ENOUGH_EXPLAINED
        if self.find == "all" and not enough:
            raise ConstantStrength(self.name, explained)
        return reference, noise, "all" if enough else "offset"

    def _states(
        self, reference: Reference, noise: float, find: Find, counts: Sequence[int]
    ) -> list[SequentialState | None]:
        """What is known after so many readings each; after all where no counts are given; None before the start."""
        field, strength = reference.thinned(MOST)
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
                state = state.after(regressors[taken], z[taken], variance[taken], exact=self.form == "exact")
                at = count
            states.append(state)
        return states

    def _followed(self, state: SequentialState | None, reference: Reference, find: Find) -> Estimate | None:
        """What the state says on the way; None while it is no ellipsoid."""
        try:
            return None if state is None else self._estimate(state, reference, find, on_the_way=True)
        except NotAnEllipsoid:
            return None

    def _estimate(
        self, state: SequentialState, reference: Reference, find: Find, *, on_the_way: bool = False
    ) -> Estimate:
        """What the state says."""
        theta, covariance = rescaled(state)
        b, d = parameters(theta, self.name)
        inverse = np.linalg.inv(jacobian(b, d))
        covariance = inverse @ covariance @ inverse.T
        named = self.name if find == "all" else f"{self.name} offset"
        made = estimate_of(reference, b, d, covariance, named, on_the_way=on_the_way)
        return replace(made, estimator=self.name)


class SequentialState(NamedTuple):
    """What the recursion keeps: θ', its covariance, and the means.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> rows, z, variance = rng.normal(size=(50, 9)), rng.normal(size=50), np.ones(50)
    >>> begun, whole = SequentialState.of(rows[:20], z[:20], variance[:20]), SequentialState.of(rows, z, variance)
    >>> np.allclose(begun.after(rows[20:], z[20:], variance[20:]).theta, whole.theta, atol=1e-13)
    True
    """

    theta: Floats  # (k,): the first k of θ': three, or nine
    covariance: Floats  # (k, k)
    row: Floats  # (9,): L̄
    value: float  # z̄ − μ̄
    variance: float  # s̄²

    @classmethod
    def of(cls, rows: Floats, z: Floats, variances: Floats, unknowns: int = 9) -> SequentialState:
        """The batch solution for (m, 9) rows L, (m,) z − μ and (m,) σ_k², of the first three or all nine of θ'."""
        weights = 1.0 / variances
        variance = float(1.0 / weights.sum())
        row, value = variance * (weights @ rows), float(variance * (weights @ z))
        local = (rows - row)[:, :unknowns]
        covariance = np.linalg.inv((local.T * weights) @ local)
        return cls(covariance @ ((local.T * weights) @ (z - value)), covariance, row, value, variance)

    def after(self, rows: Floats, z: Floats, variances: Floats, *, exact: bool = True) -> SequentialState:
        """Take more readings in, one by one."""
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
    """How many of (N, k) rows determine k unknowns; 0 where not even all of them do."""
    count = FIRST
    while count < 2 * len(rows):
        taken = min(count, len(rows))
        local = (rows[:taken] - rows[:taken].mean(axis=0)) / np.sqrt(variances[:taken, np.newaxis])
        lengths = np.sqrt(np.einsum("ij,ij->j", local, local))
        if lengths.min() > 0.0 and np.linalg.cond(local / lengths) ** 2 < WELL_CONDITIONED:
            return taken
        count *= 2
    return 0


def rescaled(state: SequentialState) -> tuple[Floats, Floats]:
    """(9,) θ' and its (9, 9) covariance, with the scale that the means say: κc and κ(I + E), where z̄ − L̄θ' + β = μ̄.

    Centring leaves the means out, and noise makes c and I + E too small alike; where only the offset was looked for
    E is 0, and the scale is that of a sphere.
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
    use="centred, reading by reading: the offset; all where the field's strength is known and varies",
    source="Crassidis, Lai and Harman (2005)",
    is_recipe=True,
)
