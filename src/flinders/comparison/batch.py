"""Pairs of calibrations held against each other, thousands at once, as `flinders.compare` does it.

Readings of one sensor are longer in a stronger field, which says nothing of the sensor. Both ellipsoids of a pair are
therefore brought to one radius, and their common scale is taken out of what they claim.

>>> sphere = Calibrations(np.zeros((2, 3)), np.tile(50.0 * np.eye(3), (2, 1, 1)), np.tile(0.01 * np.eye(9), (2, 1, 1)))
>>> moved = replace(sphere, offset=np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))
>>> found = between(sphere, moved, dip_deg=60.0)
>>> found.worst_deg.round(2).tolist(), found.sigma_deg.round(2).tolist(), found.p_value.round(3).tolist()
([0.0, 1.15], [0.46, 0.46], [1.0, 0.13])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import GATHER
from flinders.heading.error_propagation import level_turn
from flinders.summary.pooling import DEPENDENT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats

CHUNK: Final = 1024
"""Pairs that are worked on at once, so that their turns fit into the cache."""
ENTRIES: Final = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
"""Rows and columns of the entries 11, 22, 33, 12, 13, 23."""
TRACE: Final = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])

_erfc: Final = np.frompyfunc(math.erfc, 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Calibrations:
    """Many calibrations and what they claim.

    Attributes
    ----------
    offset : (n, 3) float
    shape : (n, 3, 3) float
        S = F W⁻¹, by which a unit direction becomes a reading.
    covariance : (n, 9, 9) float
        Of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in the square of the unit of the offset.
    """

    offset: Floats
    shape: Floats
    covariance: Floats

    @classmethod
    def of_columns(cls, offset: Floats, matrix: Floats, covariance: Floats, radius: Floats) -> Self:
        """Take them out of columns (n, 3), (n, 9), (n, 45) and (n,) of the table of a fleet."""
        rows, columns = np.triu_indices(9)
        whole = np.empty((len(offset), 9, 9))
        whole[:, rows, columns] = whole[:, columns, rows] = covariance
        return cls(offset, radius[:, np.newaxis, np.newaxis] * np.linalg.inv(matrix.reshape(-1, 3, 3)), whole)

    @property
    def radius(self) -> Floats:
        """(n,) geometric mean of the semi-axes."""
        radius: Floats = np.cbrt(np.abs(np.linalg.det(self.shape)))
        return radius

    @property
    def root(self) -> Floats:
        """(n, 3, 3) symmetric shape of the same ellipsoid, which is what the covariance is of."""
        squares, axes = np.linalg.eigh(self.shape @ np.swapaxes(self.shape, 1, 2))
        root: Floats = (axes * np.sqrt(squares)[:, np.newaxis]) @ np.swapaxes(axes, 1, 2)
        return root

    def __len__(self) -> int:
        return len(self.offset)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Self:
        return type(self)(self.offset[rows], self.shape[rows], self.covariance[rows])

    def __repr__(self) -> str:
        return f"Calibrations({len(self):,})"


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """What changed from the first to the second of each pair, and 1 σ of that if both claims are true.

    Headings are those of a level vehicle over a whole turn, the mean taken off; all attributes are (n,) float.

    Attributes
    ----------
    rms_deg, worst_deg : degrees
        Difference in heading, over the turn and at the worst.
    sigma_rms_deg, sigma_deg : degrees
        1 σ of the difference: over the turn, and at the worst heading.
    mean_deg : degrees
        The mean that was taken off: it looks like a mounting that has turned.
    offset_deg, offset_sigma_deg : degrees
        At the worst heading, of the change of the offset alone.
    matrix_deg, matrix_sigma_deg : degrees
        At the worst heading, of the change of the matrix alone.
    moved : in the unit of the offset
        How far the offset went.
    scale : float
        Radius of the second over that of the first, less one: the sensor's scale or the place's field.
    chi_square, freedom : float
        Of the difference in offset and shape, the scale left out, against the sum of the covariances.
    """

    rms_deg: Floats
    worst_deg: Floats
    sigma_rms_deg: Floats
    sigma_deg: Floats
    mean_deg: Floats
    offset_deg: Floats
    offset_sigma_deg: Floats
    matrix_deg: Floats
    matrix_sigma_deg: Floats
    moved: Floats
    scale: Floats
    chi_square: Floats
    freedom: Floats

    @property
    def p_value(self) -> Floats:
        """(n,) how often chance alone makes a difference as large."""
        return chances(self.chi_square, self.freedom)

    def widened(self, session: float | Floats) -> Self:
        """The same where the claimed variances are `session` times too small, all or (n,) each."""
        root = np.sqrt(session)
        return replace(
            self,
            chi_square=self.chi_square / session,
            **{name: root * getattr(self, name) for name in SIGMAS},
        )

    def only(self, rows: NDArray[np.intp]) -> Self:
        """Those that integers name, in their order."""
        return type(self)(**{each.name: getattr(self, each.name)[rows] for each in fields(self)})

    @classmethod
    def joined(cls, parts: Iterable[Changes]) -> Self:
        """Put pairs behind each other."""
        found = list(parts)
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in found] or [[]]) for name in names})


SIGMAS: Final = ("sigma_rms_deg", "sigma_deg", "offset_sigma_deg", "matrix_sigma_deg")


def between(first: Calibrations, second: Calibrations, *, dip_deg: float | Floats = 60.0) -> Changes:
    """Say how far the second calibration of each pair is from the first, as `flinders.compare` does.

    Parameters
    ----------
    first, second : Calibrations
        n of each, in the same unit and axes.
    dip_deg : float or (n,) float
        Inclination of the field at the site, of all or of each; its sign says which way up the sensor sits.

    Raises
    ------
    UsageError
        For a dip within a degree of the poles.
    """
    chunks = list(_chunks(len(first), dip_deg))
    found = Changes.joined(_chunk(first[rows], second[rows], dip) for rows, dip in chunks)
    order = np.argsort(np.concatenate([rows for rows, _ in chunks] or [np.empty(0, dtype=np.intp)]))
    return found if (np.diff(order) == 1).all() else found.only(order)


def offset_heading_deg(moved: Floats, shape: Floats, *, dip_deg: float | Floats = 60.0) -> Floats:
    """(n,) worst heading difference in degrees that (n, 3) steps of the offset make, for (n, 3, 3) shapes."""
    worst = np.empty(len(moved))
    for rows, dip in _chunks(len(moved), dip_deg):
        worst[rows] = _turned(moved[rows], shape[rows], shape[rows], level_turn(dip)[1])[1]
    return worst


def _chunks(count: int, dip_deg: float | Floats) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Cut so many rows into chunks of one dip each."""
    dips = np.broadcast_to(dip_deg, count)
    for dip in np.unique(dip_deg).tolist():
        level_turn(dip)
        rows = np.flatnonzero(dips == dip)
        yield from ((rows[at : at + CHUNK], dip) for at in range(0, len(rows), CHUNK))


def chances(chi_square: Floats, freedom: Floats) -> Floats:
    """How often chance makes each of (n,) chi-squares as large, exactly; 1 where nothing is free.

    Q(ν + 2, x) = Q(ν, x) + (x/2)^(ν/2) exp(−x/2) / Γ(ν/2 + 1), from Q(1, x) = erfc √(x/2) and Q(2, x) = exp(−x/2).

    >>> chances(np.array([16.919, 15.507, 60.0, 5.0, np.inf]), np.array([9, 8, 3, 0, 3])).tolist()
    [0.05, 0.05, 5.9e-13, 1.0, 0.0]
    """
    half: Floats = np.asarray(chi_square, float).clip(0.0, 1e300) / 2.0
    found = np.ones_like(half)
    for degrees in np.unique(freedom).astype(int).tolist():
        if degrees > 0:
            rows = freedom == degrees
            found[rows] = _tail(half[rows], degrees)
    return found


def _tail(half: Floats, degrees: int) -> Floats:
    """Q(ν, x) of (n,) x/2."""
    is_odd = degrees % 2
    tail: Floats = np.asarray(_erfc(np.sqrt(half)), float) if is_odd else np.exp(-half)
    with np.errstate(divide="ignore", over="ignore", under="ignore"):
        logarithm = np.log(half)
        for step in range(1 if is_odd else 2, degrees, 2):
            tail = tail + np.exp(0.5 * step * logarithm - half - math.lgamma(0.5 * step + 1.0))
    capped: Floats = np.minimum(tail, 1.0)
    return capped


def _chunk(first: Calibrations, second: Calibrations, dip_deg: float) -> Changes:
    """As `between`, of a few."""
    sizes = first.radius, second.radius
    common = np.sqrt(sizes[0]) * np.sqrt(sizes[1])
    factors = [common / size for size in sizes]
    roots = [_times(factor, one.root) for factor, one in zip(factors, (first, second), strict=True)]
    before, after = (_times(factor, one.shape) for factor, one in zip(factors, (first, second), strict=True))
    middle = (roots[0] + roots[1]) / 2.0
    claimed = sum(
        _without_scale(one.covariance, factor, middle) for one, factor in zip((first, second), factors, strict=True)
    )
    moved = second.offset - first.offset
    across = roots[1] - roots[0]
    chi_square, freedom = _chi_square(np.concatenate([moved, across[:, *ENTRIES]], axis=1), np.asarray(claimed))
    directions = level_turn(dip_deg)[1]
    rms, worst, mean = _turned(moved, before, after, directions)
    sigmas = _sigmas(middle, np.asarray(claimed), dip_deg)
    return Changes(
        rms_deg=rms,
        worst_deg=worst,
        sigma_rms_deg=sigmas[0],
        sigma_deg=sigmas[1],
        mean_deg=mean,
        offset_deg=_turned(moved, before, before, directions)[1],
        offset_sigma_deg=sigmas[2],
        matrix_deg=_turned(np.zeros_like(moved), before, after, directions)[1],
        matrix_sigma_deg=sigmas[3],
        moved=np.linalg.norm(moved, axis=1),
        scale=sizes[1] / sizes[0] - 1.0,
        chi_square=chi_square,
        freedom=freedom,
    )


def _times(factor: Floats, matrices: Floats) -> Floats:
    scaled: Floats = factor[:, np.newaxis, np.newaxis] * matrices
    return scaled


def _without_scale(covariance: Floats, factor: Floats, shape: Floats) -> Floats:
    """(n, 9, 9) what is claimed once shapes were multiplied by (n,) factors, as `without_scale` of `judged`."""
    jacobian = np.tile(np.eye(9), (len(factor), 1, 1))
    entries, inverse = shape[:, *ENTRIES], np.linalg.inv(shape)[:, *ENTRIES] * TRACE
    jacobian[:, 3:, 3:] -= entries[:, :, np.newaxis] * inverse[:, np.newaxis] / 3.0
    jacobian[:, :, 3:] *= factor[:, np.newaxis, np.newaxis]
    projected: Floats = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    return projected


def _chi_square(difference: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """(n,) squares of (n, 9) differences in units of their covariances, and the ranks of those."""
    sigma = np.sqrt(np.einsum("nii->ni", covariance).clip(min=0.0))
    is_free = sigma > 0.0
    scale = np.where(is_free, sigma, 1.0)
    values, axes = np.linalg.eigh(covariance / (scale[:, :, np.newaxis] * scale[:, np.newaxis]))
    kept = values > DEPENDENT * values[:, -1:]
    along = np.einsum("nji,nj->ni", axes, np.where(is_free, difference / scale, 0.0))
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        chi_square = np.where(kept, along**2 / values, 0.0).sum(axis=1)
    return chi_square, kept.sum(axis=1).astype(float)


def _turned(moved: Floats, first: Floats, second: Floats, directions: Floats) -> tuple[Floats, Floats, Floats]:
    """(n,) rms and worst difference in heading over a level turn, its mean taken off, and that mean; in degrees."""
    offset = moved[:, :, np.newaxis]
    forth = _off(np.linalg.solve(second, first @ directions - offset), directions)
    back = np.conj(_off(np.linalg.solve(first, second @ directions + offset), directions))
    means = [np.angle(turns.mean(axis=1)) for turns in (forth, back)]
    errors = [
        np.angle(turns * np.exp(-1j * mean)[:, np.newaxis]) for turns, mean in zip((forth, back), means, strict=True)
    ]
    both = np.rad2deg(np.concatenate(errors, axis=1))
    return np.sqrt(np.mean(both**2, axis=1)), np.abs(both).max(axis=1), np.rad2deg(np.mean(means, axis=0))


def _off(seen: Floats, directions: Floats) -> NDArray[np.complex128]:
    """(n, K) turns from the headings of (3, K) directions to those of (n, 3, K) corrected readings."""
    turns = (seen[:, 0] - 1j * seen[:, 1]) * (directions[0] + 1j * directions[1])
    turned: NDArray[np.complex128] = turns / np.maximum(np.abs(turns), np.finfo(float).tiny)
    return turned


def _sigmas(shape: Floats, covariance: Floats, dip_deg: float) -> tuple[Floats, Floats, Floats, Floats]:
    """(n,) 1 σ of the heading in degrees: over the turn, at the worst, and at the worst of offset and of matrix alone.

    Gradients are those of `flinders.heading.error_propagation.level_gradients`.
    """
    heading, directions = level_turn(dip_deg)
    level = math.cos(math.radians(dip_deg))
    across = np.stack([np.sin(heading), np.cos(heading), np.zeros_like(heading)]) / level
    vectors = np.linalg.solve(shape, np.broadcast_to(across, (len(shape), *across.shape)))
    rows = np.concatenate([vectors, (vectors[:, :, np.newaxis] * directions).reshape(len(shape), 9, -1)], axis=1)
    gradient = np.swapaxes(rows, 1, 2) @ GATHER
    gradient -= gradient.mean(axis=1, keepdims=True)

    def variance(part: slice) -> Floats:
        inside = gradient[:, :, part]
        summed: Floats = np.einsum("nki,nki->nk", inside @ covariance[:, part, part], inside).clip(min=0.0)
        return summed

    whole = variance(slice(None))
    found = [np.sqrt(whole.mean(axis=1)), np.sqrt(whole.max(axis=1))]
    found += [np.sqrt(variance(part).max(axis=1)) for part in (slice(0, 3), slice(3, 9))]
    rms, worst, offset, matrix = map(np.rad2deg, found)
    return rms, worst, offset, matrix
