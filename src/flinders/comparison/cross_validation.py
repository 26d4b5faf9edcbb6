"""Cross-validation of a method by blocks of time, in degrees of heading.

Residuals of fitted readings hardly show errors of a method, and residuals of left-out readings include noise. Here each
block of time is left out in turn, and two errors are computed. *Bias* is the change of offset and shape that fits the
left-out readings of all blocks best. It shows errors of the model, such as of a sphere through an ellipsoid, and errors
of the method, such as of extremes that include noise. *Scatter* is the difference between the fits without different
blocks. Both are propagated to a level heading.

Blocks are stretches of time and not random rows: neighbouring readings share errors of their place and time, so that
they are not independent.

>>> from flinders import simulate
>>> from flinders.estimators.auto import Auto
>>> from flinders.estimators.minmax import MinMax
>>> swept = simulate.tumble(seed=1, n=800, motion="uniform").samples
>>> good, simple = (cross_validate(method, swept) for method in (Auto(), MinMax()))
>>> good.heading_error_deg, simple.bias_deg > 20 * good.heading_error_deg.rms
(HeadingError(rms=0.11°, worst=0.14°, dip=60°), True)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.core.joining import join_recordings
from flinders.core.short_repr import ShortRepr
from flinders.errors import FitError, UsageError
from flinders.estimators import Readings
from flinders.estimators.one_strength import scale_to_one_strength
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import axis_order, equator
from flinders.heading.error_propagation import level_error
from flinders.likelihood import magnitude
from flinders.likelihood.equations import NormalEquations
from flinders.likelihood.prior import SOFT_IRON_SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators import Estimate, Estimator
    from flinders.geometry.plane import Plane
    from flinders.heading.error_propagation import HeadingError

DEFAULT_BLOCKS: Final = 10
"""Count of blocks: each fit lacks a tenth of the readings, and blocks are longer than the correlation time."""

MIN_BLOCK_READINGS: Final = 4
"""Smallest count of readings of a block."""


@dataclass(frozen=True, slots=True, repr=False)
class Validation(ShortRepr):
    """Result of a cross-validation."""

    heading_error_deg: HeadingError  #: heading error of a level vehicle, 1 σ: bias and scatter combined
    bias_deg: float  #: heading error from the bias alone, rms over all headings
    scatter_deg: float  #: heading error from the scatter alone, rms over all headings
    #: rms distance of left-out readings from the surface fitted to the others, in their unit; noise included
    misfit: float
    blocks: int


class NotValidated(FitError):
    """A method cannot be cross-validated."""

    code = "not-validated"

    @classmethod
    def without(cls, block: int, blocks: int, reason: str) -> NotValidated:
        """Create the error for a method that gives no comparable fit without one block."""
        return cls(
            f"not cross-validated, as it fails without block {block} of {blocks}: {reason}", block=block, blocks=blocks
        )


def cross_validate(
    estimator: Estimator,
    samples: Samples,
    *,
    blocks: int = DEFAULT_BLOCKS,
    dip_deg: float = 60.0,
    counted: NDArray[np.bool_] | None = None,
) -> Validation:
    """Cross-validate a method: leave out each block of time in turn, fit the others, and test the left-out block.

    Let N = Σ JJᵀ and g = Σ J (s − σ²½∇²s) over all readings, where s is the distance of a reading from the surface
    fitted without it and J its Jacobian (`flinders.likelihood.magnitude`). The bias is δ = (N/σ² + Λ)⁻¹ g/σ², the
    change by least squares. Λ is the precision of a prior change of 0.3 radii, which keeps δ at zero in undetermined
    directions. The scatter is that of the jackknife over K blocks, (K − 1)/K Σ (θₖ − θ̄)(θₖ − θ̄)ᵀ, with all θₖ scaled
    to one radius.

    Raises `NotValidated` if a fit fails without one block, or if the method needs all readings; `UsageError` for fewer
    than two blocks, or fewer than four readings in each.

    Parameters
    ----------
    samples : Samples
        Readings in the order of time.
    blocks : int
        Count of blocks, each with the same count of readings.
    dip_deg : float
        Inclination of the field at the site, positive if it points along +z.
    counted : (N,) bool, optional
        Readings of left-out blocks that are tested: all but outliers, which the fits may still contain.

    References
    ----------
    J. Shao and D. Tu, "The Jackknife and Bootstrap", Springer (1995), ch. 9: leaving out blocks where readings depend
    on each other.
    """
    _require_blocks(estimator, len(samples), blocks)
    inliers = np.ones(len(samples), dtype=bool) if counted is None else counted
    folds = list(_fit_folds(estimator, samples, inliers, blocks, dip_deg))
    equations, curvature = NormalEquations.empty(), np.zeros(9)
    for fold in folds:
        equations += magnitude.equations([fold.unused], fold.ellipsoid)
        curvature += magnitude.curvature(fold.unused, fold.ellipsoid)
    middle, scatter = _jackknife([fold.ellipsoid for fold in folds])
    bias = _required_change(equations, curvature, middle)
    both = np.outer(bias, bias)
    turn = _turn_options(folds[0].plane, dip_deg)
    return Validation(
        heading_error_deg=replace(level_error(middle, both + scatter, **turn), dip_deg=dip_deg),
        bias_deg=level_error(middle, both, **turn).rms,
        scatter_deg=level_error(middle, scatter, **turn).rms,
        misfit=float(np.sqrt(equations.cost / max(equations.count, 1))),
        blocks=blocks,
    )


class _Fold(NamedTuple):
    """A fit of all blocks but one, and the (m, 3) readings of this one, projected if the fit is in a plane."""

    ellipsoid: Ellipsoid
    plane: Plane | None
    unused: Floats


def _require_blocks(estimator: Estimator, count: int, blocks: int) -> None:
    """Refuse too few readings for the blocks, and a method that needs all readings."""
    if blocks < 2 or count < MIN_BLOCK_READINGS * blocks:
        raise UsageError(
            f"{blocks} blocks from {count:,} readings: need 2 blocks or more, each of at least {MIN_BLOCK_READINGS} "
            "readings"
        )
    if getattr(estimator, "needs_even_turn", False):
        raise NotValidated(
            "not cross-validated: the method needs equally spaced points, which a missing block prevents"
        )


def _fit_folds(
    estimator: Estimator, samples: Samples, inliers: NDArray[np.bool_], blocks: int, dip_deg: float
) -> Iterator[_Fold]:
    """Yield the fits without each block in turn; all must be ellipsoids, or all ellipses of one plane."""
    planes: set[Plane | None] = set()
    for number, (rest, rows) in enumerate(_blocks(samples, blocks), 1):
        try:
            estimate = estimator.estimate(Readings.of(rest))
        except FitError as error:
            raise NotValidated.without(number, blocks, error.message) from error
        planes.add(estimate.plane)
        if len(planes) > 1:
            raise NotValidated.without(number, blocks, "the fit is an ellipse in place of an ellipsoid, or the reverse")
        unused = _scale_to_one_strength(samples[rows][inliers[rows]], estimate)
        if estimate.plane is None:
            yield _Fold(estimate.ellipsoid, None, unused)
        else:
            section = equator(estimate.ellipsoid, estimate.plane, dip_deg=getattr(estimator, "dip_deg", dip_deg))
            yield _Fold(section, estimate.plane, _project(unused, estimate.plane))


def _scale_to_one_strength(samples: Samples, estimate: Estimate) -> Floats:
    """(m, 3) left-out readings, scaled to one field strength if the method uses the strength of each."""
    alike = scale_to_one_strength(Readings.of(samples), estimate)
    return np.concatenate([np.empty((0, 3)), *alike.blocks(estimate.method)])


def _project(field: Floats, plane: Plane) -> Floats:
    """(N, 3) readings without their component along the axis of rotation."""
    flat = field.copy()
    flat[:, axis_order(plane)[2]] = 0.0
    return flat


def _turn_options(plane: Plane | None, dip_deg: float) -> dict[str, Any]:
    """Options for the heading error of a turn about z, or about the axis perpendicular to `plane`."""
    return {"dip_deg": dip_deg} if plane is None else {"dip_deg": 0.0, "down": np.eye(3)[axis_order(plane)[2]]}


def _blocks(samples: Samples, blocks: int) -> Iterator[tuple[Recording, slice]]:
    """Yield for each block the other readings, and its rows."""
    cuts = np.linspace(0, len(samples), blocks + 1).astype(int)
    for begin, end in pairwise(cuts):
        before, after = samples[:begin], samples[end:]
        yield join_recordings([part for part in (before, after) if len(part)]), slice(begin, end)


def _required_change(equations: NormalEquations, curvature: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(9,) change of offset and shape that fits the left-out readings best."""
    variance = max(equations.cost / max(equations.count, 1), np.finfo(float).tiny)
    ridge = np.eye(9) * (variance / (SOFT_IRON_SPREAD * ellipsoid.radius) ** 2)
    first = replace(equations, matrix=equations.matrix + ridge).step()
    # residuals that no change of offset and shape explains
    left = equations.cost - 2.0 * float(first @ equations.gradient) + float(first @ equations.matrix @ first)
    noise = max(left, 0.0) / max(equations.count - 9, 1)
    corrected = replace(equations, matrix=equations.matrix + ridge, gradient=equations.gradient - noise * curvature)
    return corrected.step()


def _jackknife(ellipsoids: list[Ellipsoid]) -> tuple[Ellipsoid, Floats]:
    """Mean and (9, 9) jackknife covariance of ellipsoids, all scaled to one radius, as scale changes no heading."""
    radius = float(np.exp(np.mean([np.log(one.radius) for one in ellipsoids])))
    each = np.array([Ellipsoid(one.centre, one.shape * (radius / one.radius)).parameters for one in ellipsoids])
    middle = each.mean(axis=0)
    apart = each - middle
    scatter = (len(each) - 1) / len(each) * apart.T @ apart
    return Ellipsoid.of_parameters(middle), scatter
