"""Differences of n pairs of calibrations, by the formulas of `flinders.compare`.

Readings of one sensor are longer in a stronger field, which is no property of the sensor. The two ellipsoids of a pair
are therefore scaled to one size: by their field strengths if known, else to one radius. In the second case their common
scale is removed from both covariances.

>>> spheres = EllipsoidPairs(*(np.stack([one, one]) for one in (np.zeros(3), 50.0 * np.eye(3), 0.01 * np.eye(9))))
>>> moved = replace(spheres, centre=np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
>>> found = differences(spheres, moved, dip_deg=60.0)
>>> found.worst_deg.round(2).tolist(), found.sigma_deg.round(2).tolist(), found.p_value.round(3).tolist()
([0.0, 1.15], [0.46, 0.46], [1.0, 0.13])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import parameter_derivatives, upper_entries
from flinders.heading.error_propagation import level_fields, level_turn
from flinders.summary.pooling import chi_squares

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

CHUNK_PAIRS: Final = 1024
"""Count of pairs that are compared at a time, so that their headings fit into the cache."""

_erfc: Final = np.frompyfunc(math.erfc, 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class EllipsoidPairs:
    """Many ellipsoids in the magnetometer's own axes, and their covariances."""

    centre: Floats  # (n, 3): centres b
    shape: Floats  # (n, 3, 3): symmetric shapes S, which map a unit direction to a reading relative to b
    # (n, 9, 9): covariance of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; 0 for an exact ellipsoid
    covariance: Floats

    @classmethod
    def of_columns(cls, offset: Floats, matrix: Floats, covariance: Floats, radius: Floats) -> Self:
        """Create ellipsoids from columns (n, 3), (n, 9), (n, 45) and (n,) of the table of a fleet."""
        rows, columns = np.triu_indices(9)
        whole = np.empty((len(offset), 9, 9))
        whole[:, rows, columns] = whole[:, columns, rows] = covariance
        turned = radius[:, np.newaxis, np.newaxis] * np.linalg.inv(matrix.reshape(-1, 3, 3))
        squares, axes = np.linalg.eigh(turned @ np.swapaxes(turned, 1, 2))
        return cls(offset, (axes * np.sqrt(squares)[:, np.newaxis]) @ np.swapaxes(axes, 1, 2), whole)

    @property
    def radius(self) -> Floats:
        """(n,) geometric mean of the semi-axes."""
        radius: Floats = np.cbrt(np.linalg.det(self.shape))
        return radius

    def __len__(self) -> int:
        return len(self.centre)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Self:
        return type(self)(self.centre[rows], self.shape[rows], self.covariance[rows])

    def __repr__(self) -> str:
        return f"Ellipsoids({len(self):,})"


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of ellipsoids that are scaled to one size."""

    moved: Floats  # (n, 3): centre of the second ellipsoid minus that of the first
    first: Floats  # (n, 3, 3): shape of the first ellipsoid
    second: Floats  # (n, 3, 3): shape of the second ellipsoid
    covariance: Floats  # (n, 9, 9): sum of both covariances
    scale: Floats  # (n,): size of the second ellipsoid over that of the first before scaling, minus one

    @classmethod
    def of(cls, first: EllipsoidPairs, second: EllipsoidPairs, strengths: tuple[Floats, Floats] | None = None) -> Self:
        """Scale pairs to the geometric mean of their (n,) field strengths if known, else of their radii."""
        sizes = (first.radius, second.radius) if strengths is None else strengths
        common = np.sqrt(sizes[0]) * np.sqrt(sizes[1])
        factors = [common / size for size in sizes]
        shapes = [
            factor[:, np.newaxis, np.newaxis] * one.shape for factor, one in zip(factors, (first, second), strict=True)
        ]
        claimed = [
            rescale_covariance(one.covariance, factor) for one, factor in zip((first, second), factors, strict=True)
        ]
        if strengths is None:
            middle = (shapes[0] + shapes[1]) / 2.0
            claimed = [remove_scale(each, middle, middle) for each in claimed]
        scale = second.radius / first.radius * (1.0 if strengths is None else strengths[0] / strengths[1]) - 1.0
        return cls(second.centre - first.centre, shapes[0], shapes[1], claimed[0] + claimed[1], scale)

    @property
    def middle(self) -> Floats:
        """(n, 3, 3) mean of both shapes."""
        middle: Floats = (self.first + self.second) / 2.0
        return middle

    def chi_square(self, parameters: Sequence[int] = range(9)) -> tuple[Floats, Floats]:
        """(n,) χ² of the differences against their covariances, and ranks of the covariances."""
        chosen = list(parameters)
        difference = np.concatenate([self.moved, upper_entries(self.second - self.first)], axis=1)[:, chosen]
        return chi_squares(difference, self.covariance[:, chosen][:, :, chosen])

    def cross_correct(self, directions: Floats) -> tuple[Floats, Floats]:
        """(n, 3, K) readings of the first sensor for (3, K) directions, corrected by the second calibration.

        The second result is for both exchanged.
        """
        moved = self.moved[:, :, np.newaxis]
        forth = np.linalg.solve(self.second, self.first @ directions - moved)
        return forth, np.linalg.solve(self.first, self.second @ directions + moved)

    def heading_deg(self, dip_deg: float) -> tuple[Floats, Floats, Floats]:
        """(n,) rms and worst heading difference over a level turn, without its mean, and the mean; in degrees."""
        directions = level_turn(dip_deg)[1]
        forth, back = (_turns(seen, directions) for seen in self.cross_correct(directions))
        turns = (forth, np.conj(back))
        means = [np.angle(turn.mean(axis=1)) for turn in turns]
        errors = [np.angle(turn * np.exp(-1j * mean)[:, np.newaxis]) for turn, mean in zip(turns, means, strict=True)]
        both = np.rad2deg(np.concatenate(errors, axis=1))
        return np.sqrt(np.mean(both**2, axis=1)), np.abs(both).max(axis=1), np.rad2deg(np.mean(means, axis=0))

    def direction_deg(self, directions: Floats) -> Floats:
        """(n,) angle between the corrected fields in degrees, rms over (3, K) directions and both orders."""
        angles = [_angles(seen, directions) for seen in self.cross_correct(directions)]
        rms: Floats = np.rad2deg(np.sqrt(np.mean(np.square(np.concatenate(angles, axis=1)), axis=1)))
        return rms

    def sigmas_deg(self, dip_deg: float) -> tuple[Floats, Floats, Floats, Floats]:
        """(n,) 1 σ of the heading in degrees: rms over a turn, the worst, and the worst from offset or matrix alone.

        Gradients are those of `flinders.heading.error_propagation.level_gradients`.
        """
        across, directions = level_fields(dip_deg)
        gradient = parameter_derivatives(np.linalg.solve(self.middle, across), directions)
        gradient -= gradient.mean(axis=1, keepdims=True)

        def variance(part: slice) -> Floats:
            inside = gradient[:, :, part]
            summed: Floats = np.einsum("nki,nki->nk", inside @ self.covariance[:, part, part], inside).clip(min=0.0)
            return summed

        whole = variance(slice(None))
        largest = [variance(part).max(axis=1) for part in (slice(0, 3), slice(3, 9))]
        rms, worst, offset, matrix = (
            np.rad2deg(np.sqrt(each)) for each in (whole.mean(axis=1), whole.max(axis=1), *largest)
        )
        return rms, worst, offset, matrix


@dataclass(frozen=True, slots=True, eq=False)
class Differences:
    """Difference of the second ellipsoid of each pair from the first, with its 1 σ by both covariances.

    Headings are those of a level vehicle over a whole turn, without the mean; all attributes are (n,) float.
    """

    rms_deg: Floats  # difference in heading, rms over the turn
    worst_deg: Floats  # difference at the worst heading
    sigma_rms_deg: Floats  # 1 σ of the difference, rms over the turn
    sigma_deg: Floats  # 1 σ of the difference at the worst heading
    mean_deg: Floats  # removed mean, which has the effect of a rotated mounting
    offset_deg: Floats  # difference from the offset alone, at the worst heading
    offset_sigma_deg: Floats  # 1 σ of `offset_deg`
    matrix_deg: Floats  # difference from the matrix alone, at the worst heading
    matrix_sigma_deg: Floats  # 1 σ of `matrix_deg`
    offset_change: Floats  # distance between the offsets
    scale: Floats  # radius of the second over that of the first, minus one: by the sensor's scale or the place's field
    chi_square: Floats  # χ² of the difference in offset and shape without the scale, against the sum of the covariances
    freedom: Floats  # degrees of freedom of `chi_square`

    @property
    def p_value(self) -> Floats:
        """(n,) probability of a difference as large by chance."""
        return p_values(self.chi_square, self.freedom)

    def inflate(self, factor: float | Floats) -> Self:
        """Differences with the claimed variances multiplied by a factor: one for all, or (n,) factors."""
        root = np.sqrt(factor)
        sigmas = {name: root * getattr(self, name) for name in SIGMA_COLUMNS}
        return replace(self, chi_square=self.chi_square / factor, **sigmas)

    @classmethod
    def concatenate(cls, parts: Iterable[Differences], rows: Sequence[NDArray[np.intp]]) -> Self:
        """Concatenate differences of pairs, and sort them by the indices `rows` of the pairs."""
        order = np.argsort(np.concatenate([*rows, np.empty(0, dtype=np.intp)]))
        every = list(parts)
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([*(getattr(part, name) for part in every), []])[order] for name in names})


SIGMA_COLUMNS: Final = ("sigma_rms_deg", "sigma_deg", "offset_sigma_deg", "matrix_sigma_deg")


def differences(first: EllipsoidPairs, second: EllipsoidPairs, *, dip_deg: float | Floats = 60.0) -> Differences:
    """Compare n pairs of ellipsoids in one unit and axes, as `flinders.compare` does without a field strength.

    `dip_deg` is the inclination of the field with its sign in the sensor's axes: one for all pairs, or (n,).
    Raises `UsageError` for a dip within a degree of the poles.
    """
    chunks = list(_chunks(len(first), dip_deg))
    parts = (_differences(Pairs.of(first[rows], second[rows]), dip) for rows, dip in chunks)
    return Differences.concatenate(parts, [rows for rows, _ in chunks])


def offset_heading_deg(moved: Floats, shape: Floats, *, dip_deg: float | Floats = 60.0) -> Floats:
    """(n,) worst heading difference in degrees from (n, 3) changes of the offset, for (n, 3, 3) shapes."""
    worst = np.empty(len(moved))
    nothing = np.empty(0)
    for rows, dip in _chunks(len(moved), dip_deg):
        worst[rows] = Pairs(moved[rows], shape[rows], shape[rows], nothing, nothing).heading_deg(dip)[1]
    return worst


def p_values(chi_square: Floats, freedom: Floats) -> Floats:
    """(n,) exact probability of a chi-square as large by chance; 1 without degrees of freedom.

    Q(ν + 2, x) = Q(ν, x) + (x/2)^(ν/2) exp(−x/2) / Γ(ν/2 + 1), from Q(1, x) = erfc √(x/2) and Q(2, x) = exp(−x/2).

    >>> p_values(np.array([16.919, 15.507, 60.0, 5.0, np.inf]), np.array([9, 8, 3, 0, 3])).tolist()
    [0.05, 0.05, 5.9e-13, 1.0, 0.0]
    """
    half: Floats = np.asarray(chi_square, float).clip(0.0, 1e300) / 2.0
    chance = np.ones_like(half)
    for degrees in np.unique(freedom).astype(int).tolist():
        if degrees > 0:
            rows = freedom == degrees
            chance[rows] = _tail(half[rows], degrees)
    return chance


def _tail(half: Floats, degrees: int) -> Floats:
    """(n,) probability Q(ν, x) that χ² with ν `degrees` of freedom exceeds x; `half` is (n,) x/2."""
    is_odd = degrees % 2
    tail: Floats = np.asarray(_erfc(np.sqrt(half)), float) if is_odd else np.exp(-half)
    with np.errstate(divide="ignore", over="ignore", under="ignore"):
        logarithm = np.log(half)
        for step in range(1 if is_odd else 2, degrees, 2):
            tail = tail + np.exp(0.5 * step * logarithm - half - math.lgamma(0.5 * step + 1.0))
    capped: Floats = np.minimum(tail, 1.0)
    return capped


def _chunks(count: int, dip_deg: float | Floats) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Yield chunks of row indices, each with the dip that all its rows have in common."""
    dips = np.broadcast_to(dip_deg, count)
    for dip in np.unique(dip_deg).tolist():
        level_turn(dip)
        rows = np.flatnonzero(dips == dip)
        yield from ((rows[at : at + CHUNK_PAIRS], dip) for at in range(0, len(rows), CHUNK_PAIRS))


def _differences(pairs: Pairs, dip_deg: float) -> Differences:
    """Differences of a chunk of pairs."""
    rms, worst, mean = pairs.heading_deg(dip_deg)
    sigmas = pairs.sigmas_deg(dip_deg)
    chi_square, freedom = pairs.chi_square()
    return Differences(
        rms_deg=rms,
        worst_deg=worst,
        sigma_rms_deg=sigmas[0],
        sigma_deg=sigmas[1],
        mean_deg=mean,
        offset_deg=replace(pairs, second=pairs.first).heading_deg(dip_deg)[1],
        offset_sigma_deg=sigmas[2],
        matrix_deg=replace(pairs, moved=np.zeros_like(pairs.moved)).heading_deg(dip_deg)[1],
        matrix_sigma_deg=sigmas[3],
        offset_change=np.linalg.norm(pairs.moved, axis=1),
        scale=pairs.scale,
        chi_square=chi_square,
        freedom=freedom,
    )


def rescale_covariance(covariance: Floats, factor: float | Floats) -> Floats:
    """(..., 9, 9) covariances of (b, S) after multiplication of the shapes S by (...) factors."""
    factors = np.ones((*np.shape(factor), 9))
    factors[..., 3:] = np.asarray(factor)[..., np.newaxis]
    scaled: Floats = covariance * (factors[..., :, np.newaxis] * factors[..., np.newaxis, :])
    return scaled


def remove_scale(covariance: Floats, shape: Floats, reference: Floats) -> Floats:
    """(..., 9, 9) covariances of (b, S) after scaling the (..., 3, 3) shapes S to the size of a reference R.

    The size is tr(R⁻¹S) = 3, which for S near R is the same as an equal determinant. S/s with s = tr(R⁻¹S)/3 changes by
    δS − S tr(R⁻¹δS)/3, where `shape` is S after scaling. The results do not depend on the scale before. All covariances
    are then singular in the same direction, that of R⁻¹.
    """
    jacobian = np.tile(np.eye(9), (*shape.shape[:-2], 1, 1))
    jacobian[..., 3:, 3:] -= upper_entries(shape)[..., :, np.newaxis] * trace_with(reference)[..., np.newaxis, :] / 3.0
    projected: Floats = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    return (projected + np.swapaxes(projected, -1, -2)) / 2.0  # the rank is then 8 except for rounding


def trace_with(reference: Floats) -> Floats:
    """(..., 6) coefficients of tr(R⁻¹S) for the entries of S in the order of `upper_entries`."""
    coefficients: Floats = upper_entries(np.linalg.inv(reference)) * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    return coefficients


def _turns(seen: Floats, directions: Floats) -> NDArray[np.complex128]:
    """(n, K) rotations from the headings of (3, K) directions to those of (n, 3, K) corrected readings."""
    turns = (seen[:, 0] - 1j * seen[:, 1]) * (directions[0] + 1j * directions[1])
    turned: NDArray[np.complex128] = turns / np.maximum(np.abs(turns), np.finfo(float).tiny)
    return turned


def _angles(vectors: Floats, directions: Floats) -> Floats:
    """(n, K) angles between (n, 3, K) vectors of any length and (3, K) unit vectors, in rad."""
    scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True).clip(min=1e-300)
    across = np.linalg.norm(np.cross(scaled, directions[np.newaxis], axis=1), axis=1)
    angles: Floats = np.arctan2(across, np.sum(scaled * directions, axis=1))
    return angles
