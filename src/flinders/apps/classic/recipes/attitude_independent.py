"""The attitude-independent measurement: the length of a reading, which does not depend on the sensor's attitude.

Readings x of a field of known strength H are corrected as m = (I + D) x − b, with D symmetric and a noise of σ on each
axis of m. Then |m|² = H² except for noise, which is

    z = |x|² − H² = L θ' − |b|² + v,      L = (2x₁, 2x₂, 2x₃, −x₁², −x₂², −x₃², −2x₁x₂, −2x₁x₃, −2x₂x₃)

linear in θ' = (c, E) with c = (I + D) b and E = 2D + D², except for β(θ') = |b|² = cᵀ(I + E)⁻¹c. The noise v has the
mean μ = −3σ² and the variance σ_k² = 4σ²|m|² + 6σ⁴. Subtracting weighted means from z, L and μ also removes β: this is
centring, and leaves a linear problem [1]_.

**Centring needs a strength that varies.** H² = xᵀ(I + E)x − 2c·x + β, so the centred problem regresses H² on the
monomials of x. A constant H² does not depend on them: the solution is I + E = 0 and c = 0, D = −I, for any readings. If
H² varies by less than the noise, I + E and c are too small by the share of its variance that the readings explain,
`ProductSums.explained`. The whole problem, with the mean included, has the same root at D = −I, |b| = H, next to the
right one.

All is calculated relative to the mean reading x₀, with strengths in units of their mean H and readings in units of
their size R: (I + D) x − b = H [(I + D') x' − b'] with x' = (x − x₀)/R, I + D' = (I + D) R/H and Hb' = b − (I + D) x₀
is the same problem with smaller rounding errors. In the code, b and D are b' and D'.

.. [1] R. Alonso, M. D. Shuster, "TWOSTEP: A Fast Robust Algorithm for Attitude-Independent Magnetometer-Bias
   Determination" and "Complete Linear Attitude-Independent Magnetometer Calibration", J. Astronaut. Sci. 50 (2002).
   The equations are those of its implementations; the papers were not read.

>>> offset, distortion = np.array([0.5, 0.3, 0.6]), symmetric_matrix(np.array([0.05, 0.1, 0.05, 0.05, 0.05, 0.05]))
>>> solution = parameters(theta_of(offset, distortion))
>>> np.allclose(solution[0], offset), np.allclose(solution[1], distortion)
(True, True)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, Self, TypeAlias

import numpy as np

from flinders.apps.classic.recipes.sphere import Sphere
from flinders.errors import FitError, NeedsSamples, NotAnEllipsoid, UsageError, figures
from flinders.estimators.base import Estimate
from flinders.estimators.consistent import fit_adjusted
from flinders.estimators.one_strength import scale_to_one_strength
from flinders.estimators.trace import Convergence, spread_counts
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.likelihood import magnitude
from flinders.likelihood.equations import MIN_NOISE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.data import Readings

Weights: TypeAlias = Literal["estimate", "prior"]

MIN_EXPLAINED: Final = 0.5
"""Smallest explained share of the variance of H² for a centred fit; with less, noise dominates its scale."""

MAX_SPREAD_RATIO: Final = 0.8
"""Largest σ of an unexplained field strength, relative to the scatter of the readings about one ellipsoid."""

MAX_CONSTANT_SPREAD: Final = 1e-9
"""Largest relative spread of a constant strength, from rounding."""

MIN_LENGTH_DIFFERENCE: Final = 1e-4
"""Smallest rms difference of a measured field strength from the length of the readings, as a share of it."""

MIN_GAIN_RATIO: Final = 0.5
"""Smallest ratio of the gain to that of the start; noise does not halve the gain, convergence to D = −I does."""

MAX_READINGS: Final = 50_000
"""Largest number of readings that are processed one by one, evenly spread over a longer recording."""

MIN_INFORMATION: Final = 1e-12
"""Smallest eigenvalue of an observed parameter, in an information matrix whose diagonal is scaled to 1."""

_EYE: Final = np.eye(3)
BASIS: Final = np.array([symmetric_matrix(unit) for unit in np.eye(6)])
"""(6, 3, 3) basis of symmetric matrices, in the order 11, 22, 33, 12, 13, 23."""


class ConstantStrength(FitError):
    """The strength of the field varies too little (`explained` of its variance) for a centred fit of all parameters."""

    code: ClassVar[str] = "constant-strength"

    def __init__(self, method: str, explained: float) -> None:
        self.explained = explained
        evidence = (
            f"the readings explain {explained:.0%} of the variance of the field's strength"
            if explained > 0.0
            else "the field has the same strength at all readings"
        )
        super().__init__(
            f"{evidence}: for all parameters {method!r} would give D = −I for any readings. Use method 'auto' or "
            "'alonso-shuster', or find the offset alone; or, if the strength varies, give it at each reading in a "
            "column such as reference_strength_uT",
            hint={"find": "offset"},
            method=method,
            explained=explained,
        )


class WrongStrength(FitError):
    """The strength given at each reading cannot be that of the field there."""

    code: ClassVar[str] = "wrong-strength"


class Collapsed(NotAnEllipsoid):
    """The fit went to D = −I, a root for any readings: its gain shrank to the share `gain_ratio` of the start's."""

    code: ClassVar[str] = "collapsed"

    def __init__(self, method: str, shrunk: float, why: str = "they cover too few directions for their noise") -> None:
        self.gain_ratio, self.eigenvalues = shrunk, (0.0, 0.0, 0.0)
        FitError.__init__(
            self,
            f"{method!r} has no solution for these readings: its gain shrank to {shrunk:.0%} of the start, towards "
            f"D = −I, which fits any readings: {why}. Use method 'auto', or turn the sensor onto all of its sides",
            method=method,
            shrunk=shrunk,
        )


def check_options(*, weights: str, noise: float | None, field_strength: float | None) -> None:
    """Refuse invalid options.

    Raises `UsageError`.
    """
    if weights not in ("estimate", "prior"):
        raise UsageError(f"weights is {weights!r}: need 'estimate' or 'prior'")
    for name, value in (("noise", noise), ("field_strength", field_strength)):
        if value is not None and not 0.0 < value < np.inf:
            raise UsageError(f"{name} is {value!r}: need a positive number in the unit of the readings")


# The equations.


def regressors(field: Floats) -> Floats:
    """(N, 9) regressors L of (N, 3) readings."""
    x, y, z = field.T
    rows: Floats = np.stack([2 * x, 2 * y, 2 * z, -x * x, -y * y, -z * z, -2 * x * y, -2 * x * z, -2 * y * z], axis=1)
    return rows


def beta(theta: Floats) -> tuple[float, Floats]:
    """β = |b|² of (9,) parameters θ', and the (9,) gradient of β: 2q and −qqᵀ with q = (I + E)⁻¹c."""
    q = np.linalg.solve(_EYE + symmetric_matrix(theta[3:]), theta[:3])
    x, y, z = q
    gradient = np.array([2 * x, 2 * y, 2 * z, -x * x, -y * y, -z * z, -2 * x * y, -2 * x * z, -2 * y * z])
    return float(theta[:3] @ q), gradient


def theta_of(b: Floats, d: Floats) -> Floats:
    """(9,) parameters θ' = (c, E) of an offset b (3,) and a distortion D (3, 3)."""
    return np.concatenate([b + d @ b, upper_entries(2.0 * d + d @ d)])


def parameters(theta: Floats, method: str = "") -> tuple[Floats, Floats]:
    """(3,) offset b and (3, 3) distortion D from the (9,) parameters θ' = (c, E).

    With E = U diag(s) Uᵀ, D = U diag(√(1 + s) − 1) Uᵀ.
    Raises `NotAnEllipsoid` unless I + E is positive definite.
    """
    values, vectors = np.linalg.eigh(_EYE + symmetric_matrix(theta[3:]))
    if not values[0] > 0.0:
        raise NotAnEllipsoid(tuple(float(value / np.abs(values).max()) for value in values), method)
    gain = (vectors * np.sqrt(values)) @ vectors.T
    return np.linalg.solve(gain, theta[:3]), gain - _EYE


def jacobian(b: Floats, d: Floats) -> Floats:
    """(9, 9) Jacobian J = ∂(c, E)/∂(b, D); D and E are in the order 11, 22, 33, 12, 13, 23."""
    gain = _EYE + d
    whole = np.zeros((9, 9))
    whole[:3, :3] = gain
    whole[:3, 3:] = (BASIS @ b).T
    whole[3:, 3:] = np.stack([upper_entries(gain @ basis + basis @ gain) for basis in BASIS], axis=1)
    return whole


def ellipsoid_of(b: Floats, d: Floats, reference: Reference) -> Ellipsoid:
    """Ellipsoid of b' and D': centre x₀ + R (I + D')⁻¹b', shape R (I + D')⁻¹, in the unit of the readings."""
    inverse = np.linalg.inv(_EYE + d)
    inverse = (inverse + inverse.T) / 2.0
    return Ellipsoid(reference.origin + reference.size * inverse @ b, reference.size * inverse)


def ellipsoid_covariance(covariance: Floats, b: Floats, d: Floats, reference: Reference) -> Floats:
    """(9, 9) covariance of centre and shape, in unit², from that of (b', D')."""
    inverse = np.linalg.inv(_EYE + d)
    moves = np.zeros((9, 9))
    moves[:3, :3] = inverse
    moves[:3, 3:] = -(inverse @ BASIS @ (inverse @ b)).T
    moves[3:, 3:] = -np.stack([upper_entries(inverse @ basis @ inverse) for basis in BASIS], axis=1)
    moves *= reference.size
    whole: Floats = moves @ covariance @ moves.T
    return (whole + whole.T) / 2.0


# Strength of the field.


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Readings with the strength of the field, and the scales by which both are divided."""

    readings: Readings
    method: str  # name of the method in messages
    mean: float  # mean strength, in the unit of the readings; strengths are divided by it
    size: float  # size R of the readings, in their unit; readings are divided by it
    spread: float  # standard deviation of the strength, as a share of its mean
    is_reported: bool  # whether a column of the recording has the strength; else one strength was given, or none
    consistent: Ellipsoid | None  # ellipsoid of the consistent fit, from which methods start; None if that fit failed
    noise: float  # distance of the readings from that ellipsoid or from a sphere, 1 σ, in units of the mean strength

    @classmethod
    def of(cls, readings: Readings, method: str, field_strength: float | None) -> Self:
        """Take the strength from the recording's column, else the given strength, else the radius of a fit.

        Raises `NeedsSamples` if only sums are given; `WrongStrength` for a column that is not positive, is the length
        of the readings themselves, is missing in one of several recordings, or comes with a given strength;
        `NotAnEllipsoid` if not even a sphere fits the readings.
        """
        if readings.recording is None:
            raise NeedsSamples(method)
        reported = _ReportedStrength.of(readings)
        if reported.count and field_strength is not None:
            raise WrongStrength(
                "the recording has the field's strength at each reading, and another strength was given: leave out "
                "one of the two",
                hint={"site": None},
                mean=reported.mean,
                field_strength=field_strength,
            )
        spread = reported.spread if reported.count else 0.0
        try:
            ellipsoid, noise = fit_adjusted(readings)
            size, alike = ellipsoid.radius, ellipsoid
        except NotAnEllipsoid:
            sphere = Sphere().estimate(readings)
            size, noise, alike = sphere.ellipsoid.radius, sphere.noise, None
        mean = reported.mean if reported.count else field_strength or size
        return cls(readings, method, mean, size, spread, bool(reported.count), alike, max(noise / size, MIN_NOISE))

    @property
    def origin(self) -> Floats:
        """(3,) mean reading x₀, in the unit of the readings."""
        return self.readings.summary.moments.mean

    @property
    def varies(self) -> bool:
        """Whether the strength is not constant."""
        return self.spread > MAX_CONSTANT_SPREAD

    def blocks(self) -> Iterator[tuple[Floats, Floats]]:
        """Yield blocks of (m, 3) x' and (m,) strengths in units of their mean."""
        for samples in _blocks(self.readings):
            strength = samples.strength
            if strength is None or not self.is_reported:
                yield (samples.field - self.origin) / self.size, np.ones(len(samples))
            else:
                known = np.isfinite(strength)
                yield (samples.field[known] - self.origin) / self.size, strength[known] / self.mean

    @property
    def stride(self) -> int:
        """Stride of the readings that are processed one by one, at most `MAX_READINGS` of them."""
        return max(1, -(-len(self.readings) // MAX_READINGS))

    def counts(self, steps: int) -> list[int]:
        """Numbers of processed readings at which estimates are made, about `steps` of them."""
        return spread_counts(-(-len(self.readings) // self.stride), steps)

    def convergence(self, counts: Sequence[int], estimates: Sequence[Estimate | None]) -> Convergence:
        """Convergence of `estimates`, made after `counts` processed readings."""
        return Convergence.of([min(count * self.stride, len(self.readings)) for count in counts], estimates)

    def thin(self, limit: int) -> tuple[Floats, Floats]:
        """Readings x' and strengths, at most about `limit` of each, evenly spread over the recording."""
        stride = max(1, -(-len(self.readings) // limit))
        pairs = [(field[::stride], strength[::stride]) for field, strength in self.blocks()]
        field, strength = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        return field, strength

    def start(self) -> Floats:
        """(9,) θ' of the consistent ellipsoid.

        Raises `NotAnEllipsoid` if there is none.
        """
        ellipsoid = self.consistent or fit_adjusted(self.readings)[0]
        gain = self.size * np.linalg.inv(ellipsoid.shape)
        return theta_of(gain @ (ellipsoid.centre - self.origin) / self.size, gain - _EYE)

    def variances(self, field: Floats, strength: Floats, noise: float, weights: Weights) -> Floats:
        """(N,) σ_k², for (N, 3) x' and (N,) strengths.

        ``weights`` is the point of evaluation: the ``"estimate"``, where |m| is the strength, or the ``"prior"`` D = 0
        and b = 0, where |m| is the length of the raw reading.
        """
        raw = (field * self.size + self.origin) / self.mean
        square = np.einsum("ij,ij->i", raw, raw) if weights == "prior" else strength**2
        variances: Floats = 4.0 * noise**2 * square + 6.0 * noise**4
        return variances

    def refuse_unrelated(self, explained: float) -> None:
        """Refuse a strength that varies by as much as the readings do, but is not correlated with them.

        Raises `WrongStrength`.
        """
        if self.varies and explained < MIN_EXPLAINED and self.spread > MAX_SPREAD_RATIO * self.noise:
            raise WrongStrength(
                f"the field strength in the recording varies by {self.spread:.1%} (1 σ), and the readings explain "
                f"only {max(explained, 0.0):.0%} of this variation: check the column of the strength, its unit and "
                "its time, or remove the column",
                spread=self.spread,
                explained=explained,
            )


@dataclass(frozen=True, slots=True)
class _ReportedStrength:
    """Statistics of the recording's column of field strengths."""

    count: int = 0
    mean: float = 0.0
    spread: float = 0.0

    @classmethod
    def of(cls, readings: Readings) -> Self:
        """Statistics over the recording; `count` is 0 if no reading has a strength."""
        have = [any(block.strength is not None for block in _blocks(part)) for part in readings.single_recordings]
        if not any(have):
            return cls()
        if not all(have):
            raise WrongStrength(
                "some recordings have the field's strength at each reading and some do not: add or remove the column"
            )
        count, total, square, apart = 0, 0.0, 0.0, 0.0
        first = np.nan
        for block in _blocks(readings):
            if block.strength is None:
                continue
            known = np.isfinite(block.strength)
            strength = block.strength[known]
            if not np.all(strength > 0.0):
                wrong = float(strength[~(strength > 0.0)][0])
                raise WrongStrength(
                    f"the recording has a strength of {figures(wrong)}: need positive numbers; check the column",
                    strength=wrong,
                )
            if not len(strength):
                continue
            first = strength[0] if np.isnan(first) else first
            count += len(strength)
            total += float(np.sum(strength - first))
            square += float(np.sum((strength - first) ** 2))
            apart += float(np.sum((np.linalg.norm(block.field[known], axis=1) - strength) ** 2))
        if not count:
            return cls()
        mean = float(first) + total / count
        if np.sqrt(apart / count) < MIN_LENGTH_DIFFERENCE * mean:
            raise WrongStrength(
                "the strength in the recording is the length of the reading itself: need a strength from a model of "
                "the field or from another magnetometer; or remove the column"
            )
        return cls(count, mean, float(np.sqrt(max(square / count - (total / count) ** 2, 0.0))) / mean)


def _blocks(readings: Readings) -> Iterator[Samples]:
    if readings.recording is not None:
        yield from readings.recording.blocks()


# Sums.


@dataclass(frozen=True, slots=True, eq=False)
class ProductSums:
    """Weighted sums of products of L, z − μ and 1, which are sufficient for both steps."""

    gram: Floats  # (11, 11): Σ rrᵀ/σ_k² with r = (L, z − μ, 1)
    scatter: Floats  # (11, 11): the same sum, each term multiplied by (variance of v)/σ_k²
    count: int  # number of readings

    @classmethod
    def of(cls, reference: Reference, noise: float, weights: Weights = "estimate") -> Self:
        """Sum over all readings, for a noise in units of the mean strength; weights as of `Reference.variances`."""
        gram, scatter, count = np.zeros((11, 11)), np.zeros((11, 11)), 0
        for field, strength in reference.blocks():
            rows = rows_of(field, strength, noise)
            weight = 1.0 / reference.variances(field, strength, noise, weights)
            variance = reference.variances(field, strength, noise, "estimate")
            gram += (rows.T * weight) @ rows
            scatter += (rows.T * (weight**2 * variance)) @ rows
            count += len(rows)
        return cls(gram, scatter, count)

    @property
    def variance(self) -> float:
        """Variance s̄² of the weighted means: 1/s̄² = Σ 1/σ_k²."""
        return float(1.0 / self.gram[10, 10])

    @property
    def means(self) -> Floats:
        """(10,) weighted means of L and z − μ."""
        return self.gram[:10, 10] * self.variance

    @property
    def centred_products(self) -> Floats:
        """(10, 10) sums of products of L and z − μ with their means removed."""
        centred: Floats = self.gram[:10, :10] - np.outer(self.gram[:10, 10], self.means)
        return centred

    @property
    def explained_share(self) -> float:
        """Share of the variance of H² that the readings explain, adjusted for nine parameters.

        About 1 if the strength varies by far more than the noise, 0 and below if it is constant.
        """
        centred = self.centred_products
        squared = np.zeros(10)
        squared[[3, 4, 5, 9]] = -1.0  # H² = |x|² − z, up to a constant
        whole = float(squared @ centred @ squared)
        theta = self.solve()
        left = float(centred[9, 9] - 2.0 * centred[9, :9] @ theta + theta @ centred[:9, :9] @ theta)
        return 1.0 - max(left, 0.0) / max(whole, 1e-300) * (self.count - 1) / max(self.count - 10, 1)

    def solve(self) -> Floats:
        """(9,) θ' that solves the centred problem."""
        centred = self.centred_products
        scale = np.sqrt(np.maximum(np.diag(centred)[:9], 1e-300))
        theta: Floats = np.linalg.lstsq(centred[:9, :9] / np.outer(scale, scale), centred[:9, 9] / scale, rcond=1e-14)[
            0
        ]
        return theta / scale

    def mean_residual(self, theta: Floats) -> float:
        """Residual of the weighted means: z̄ − L̄θ' + β − μ̄."""
        means = self.means
        return float(means[9] - means[:9] @ theta + beta(theta)[0])

    def cost(self, theta: Floats) -> float:
        """Cost Σ v²/σ_k², with the weighted mean of v included."""
        row = np.concatenate([-theta, [1.0]])
        return float(row @ self.centred_products @ row) + self.mean_residual(theta) ** 2 / self.variance

    def information(self, theta: Floats) -> Floats:
        """(9, 9) information F = F̃ + (L̄ − ∂β)(L̄ − ∂β)ᵀ/s̄² of θ'."""
        across = self.means[:9] - beta(theta)[1]
        return self.centred_products[:9, :9] + np.outer(across, across) / self.variance

    def unobserved(self, theta: Floats) -> int:
        """Number of combinations of parameters without information, as for readings on two rings."""
        information = self.information(theta)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        values = np.linalg.eigvalsh(information / np.outer(scale, scale))
        return int(np.count_nonzero(values < MIN_INFORMATION))

    def gradient(self, theta: Floats) -> Floats:
        """(9,) half the gradient of the cost."""
        centred = self.centred_products
        across = self.means[:9] - beta(theta)[1]
        gradient: Floats = centred[:9, :9] @ theta - centred[:9, 9] - self.mean_residual(theta) * across / self.variance
        return gradient

    def covariance(self, theta: Floats) -> Floats:
        """(9, 9) covariance of θ': F⁻¹ for weights that are inverse variances of v, else the sandwich F⁻¹BF⁻¹."""
        slope = np.zeros((11, 9))
        slope[:9], slope[10] = np.eye(9), -beta(theta)[1]
        inverse = np.linalg.inv(self.information(theta))
        covariance: Floats = inverse @ (slope.T @ self.scatter @ slope) @ inverse
        return covariance


def rows_of(field: Floats, strength: Floats, noise: float) -> Floats:
    """(N, 11) rows L, z − μ and 1 of (N, 3) x' and (N,) strengths in units of their mean."""
    z = np.einsum("ij,ij->i", field, field) - strength**2 + 3.0 * noise**2
    return np.column_stack([regressors(field), z, np.ones(len(z))])


def converged_noise(reference: Reference, b: Floats, d: Floats, taken: int) -> float:
    """Standard deviation of |m| about the strength, in units of the mean strength, at least `MIN_NOISE`."""
    count, total, square = 0, 0.0, 0.0
    for field, strength in reference.blocks():
        off = np.linalg.norm(field @ (_EYE + d) - b, axis=1) - strength
        count, total, square = count + len(off), total + float(off.sum()), square + float(off @ off)
    return max(float(np.sqrt(max(square - total**2 / count, 0.0) / max(count - taken, 1))), MIN_NOISE)


def gain_ratio(theta: Floats, start: Floats) -> float:
    """Smallest ratio, over all directions, of the gain of `theta` to that of `start`; 0 if `start` is no ellipsoid."""
    values, vectors = np.linalg.eigh(_EYE + symmetric_matrix(start[3:]))
    if not values[0] > 0.0:
        return 0.0
    root = vectors / np.sqrt(values)
    least = float(np.linalg.eigvalsh(root.T @ (_EYE + symmetric_matrix(theta[3:])) @ root)[0])
    return float(np.sqrt(max(least, 0.0)))


# Results.


def estimate_of(
    reference: Reference, b: Floats, d: Floats, covariance: Floats, method: str, *, is_partial: bool = False
) -> Estimate:
    """Make an `Estimate` from b', D' and their covariance.

    Parameters
    ----------
    b : (3,) float
        Offset b', relative to the mean reading.
    d : (3, 3) float
        Distortion D'.
    covariance : (9, 9) float
        Covariance of b' and D'.
    method : str
        Name of the method.
    is_partial : bool
        Whether only part of the readings was used; then residuals are not calculated.
    """
    ellipsoid = ellipsoid_of(b, d, reference)
    reported: Literal["", "constant", "varying"] = ""
    if reference.is_reported:
        reported = "varying" if reference.varies else "constant"
    known = reference.mean if reference.is_reported else None
    estimate = Estimate(
        ellipsoid, ellipsoid_covariance(covariance, b, d, reference), 0.0, method, strength=known, follows=reported
    )
    if is_partial:
        return estimate
    alike = scale_to_one_strength(reference.readings, estimate)
    square = sum(float(np.sum(magnitude.distances(block, ellipsoid) ** 2)) for block in alike.blocks(method))
    noise = float(np.sqrt(square / max(len(alike) - 9, 1)))
    return replace(estimate, noise=noise, used=len(alike))


def widen_by_consistent(estimate: Estimate, reference: Reference) -> Estimate:
    """Add the whole difference from the consistent fit of the same readings to the covariance of an estimate.

    The consistent fit uses all readings at once, and is not biased by noise. The part of the difference that chance may
    explain is not removed, since that would depend on the covariance in doubt.
    """
    if reference.consistent is None:
        return estimate
    apart = estimate.ellipsoid.parameters - reference.consistent.parameters
    return replace(estimate, covariance=estimate.covariance + np.outer(apart, apart))
