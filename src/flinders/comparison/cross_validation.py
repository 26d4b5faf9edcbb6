"""Cross-validation by blocks of time: what readings that a method has not seen say of it, in degrees of heading.

A residual of readings that were fitted says little, and one of readings held back says how far they are from the
surface, noise included. Neither is a heading error. Here each block of time is held back in turn, and two things are
asked. *Bias*: which change of offset and shape would the readings held back have asked for, all blocks together? A
sphere through an ellipsoid is told what it cannot model, and what extremes overshoot is told to them. *Scatter*: how
much do the answers differ when another block is missing? Both are carried over to a level heading.

Blocks are stretches of time and not rows drawn at random: neighbouring readings share the errors of their
place and their moment, and would vouch for each other.

>>> from flinders import simulate
>>> from flinders.estimators.auto import Auto
>>> from flinders.estimators.minmax import MinMax
>>> swept = simulate.tumble(seed=1, n=800, motion="uniform").samples
>>> good, simple = (cross_validated(method, swept) for method in (Auto(), MinMax()))
>>> good.heading_error_deg, simple.bias_deg > 20 * good.heading_error_deg.rms
(HeadingError(rms=0.11°, worst=0.14°, dip=60°), True)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.core.joining import joined
from flinders.core.short_repr import ShortRepr
from flinders.errors import FitError, UsageError
from flinders.estimators import Readings
from flinders.estimators.one_strength import at_one_strength
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import equator, order_of
from flinders.heading.error_propagation import level_error
from flinders.likelihood import magnitude
from flinders.likelihood.equations import NormalEquations
from flinders.likelihood.prior import SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators import Estimate, Estimator
    from flinders.geometry.plane import Plane
    from flinders.heading.error_propagation import HeadingError

BLOCKS: Final = 10
"""Of ten a training set misses a tenth, and a minute of tumbling gives blocks that are longer than its memory."""

LEAST: Final = 4
"""Readings of a block."""


@dataclass(frozen=True, slots=True, repr=False)
class Validation(ShortRepr):
    """What cross-validation found."""

    heading_error_deg: HeadingError  #: of a level vehicle, 1 σ: bias and scatter together
    bias_deg: float  #: bias alone, rms over all headings
    scatter_deg: float  #: scatter alone
    #: rms distance of the readings held back from the surface that the others gave, in their unit; noise included
    misfit: float
    blocks: int


class NotValidated(FitError):
    """A method cannot be asked about readings that it has not seen."""

    code = "not-validated"

    @classmethod
    def without(cls, block: int, blocks: int, reason: str) -> NotValidated:
        """It gives nothing comparable when one block of time is missing."""
        return cls(
            f"not cross-validated, as it fails without block {block} of {blocks}: {reason}", block=block, blocks=blocks
        )


def cross_validated(
    estimator: Estimator,
    samples: Samples,
    *,
    blocks: int = BLOCKS,
    dip_deg: float = 60.0,
    counted: NDArray[np.bool_] | None = None,
) -> Validation:
    """Fit all blocks of time but one, in turn, and ask the one that was held back.

    With N = Σ JJᵀ and g = Σ J (s − σ²½∇²s) over all readings, s the distance of each from the surface of the fit
    that has not seen it and J its Jacobian (`flinders.likelihood.magnitude`), the bias is δ = (N/σ² + Λ)⁻¹ g/σ²: what
    least squares would change. The precision Λ of a change by three tenths of the radius keeps δ at zero where nothing
    was seen. The scatter is that of the jackknife over K blocks, (K − 1)/K Σ (θₖ − θ̄)(θₖ − θ̄)ᵀ, all θₖ of one radius.

    Raises `NotValidated` if a fit fails where one block is missing, or the method is for readings of which none may be
    missing; `UsageError` for fewer than two blocks, or fewer than four readings in each.

    Parameters
    ----------
    samples : Samples
        In the order of time.
    blocks : int
        Stretches of equally many readings.
    dip_deg : float
        Inclination of the field at the site, positive where it points along +z.
    counted : (N,) bool, optional
        Readings that are asked when their block is held back: not outliers, which a method may fit or not.

    References
    ----------
    J. Shao and D. Tu, "The Jackknife and Bootstrap", Springer (1995), ch. 9: leaving out blocks where readings depend
    on each other.
    """
    _require_blocks(estimator, len(samples), blocks)
    inliers = np.ones(len(samples), dtype=bool) if counted is None else counted
    folds = list(_fitted_folds(estimator, samples, inliers, blocks, dip_deg))
    equations, curvature = NormalEquations.empty(), np.zeros(9)
    for fold in folds:
        equations += magnitude.equations([fold.unused], fold.ellipsoid)
        curvature += magnitude.curvature(fold.unused, fold.ellipsoid)
    middle, scatter = _jackknife([fold.ellipsoid for fold in folds])
    bias = _required_change(equations, curvature, middle)
    both = np.outer(bias, bias)
    turn = _turn(folds[0].plane, dip_deg)
    return Validation(
        heading_error_deg=replace(level_error(middle, both + scatter, **turn), dip_deg=dip_deg),
        bias_deg=level_error(middle, both, **turn).rms,
        scatter_deg=level_error(middle, scatter, **turn).rms,
        misfit=float(np.sqrt(equations.cost / max(equations.count, 1))),
        blocks=blocks,
    )


class _Fold(NamedTuple):
    """A fit to all blocks but one, and the (m, 3) readings of that one, laid flat where the fit is of a plane."""

    ellipsoid: Ellipsoid
    plane: Plane | None
    unused: Floats


def _require_blocks(estimator: Estimator, count: int, blocks: int) -> None:
    """Refuse readings that do not make so many blocks, and a method of which no block may be missing."""
    if blocks < 2 or count < LEAST * blocks:
        raise UsageError(f"{blocks} blocks of {count:,} readings: need 2 or more, of {LEAST} readings or more each")
    if getattr(estimator, "needs_even_turn", False):
        raise NotValidated("not cross-validated: it takes points equally spaced around, and a block less is not")


def _fitted_folds(
    estimator: Estimator, samples: Samples, inliers: NDArray[np.bool_], blocks: int, dip_deg: float
) -> Iterator[_Fold]:
    """Fit without each block in turn; all have to be ellipsoids, or all ellipses of one plane."""
    planes: set[Plane | None] = set()
    for number, (rest, rows) in enumerate(_blocks(samples, blocks), 1):
        try:
            estimate = estimator.estimate(Readings.of(rest))
        except FitError as error:
            raise NotValidated.without(number, blocks, error.message) from error
        planes.add(estimate.plane)
        if len(planes) > 1:
            raise NotValidated.without(number, blocks, "it takes an ellipse for an ellipsoid, or the other way round")
        unused = _of_one_strength(samples[rows][inliers[rows]], estimate)
        if estimate.plane is None:
            yield _Fold(estimate.ellipsoid, None, unused)
        else:
            section = equator(estimate.ellipsoid, estimate.plane, dip_deg=getattr(estimator, "dip_deg", dip_deg))
            yield _Fold(section, estimate.plane, _laid_flat(unused, estimate.plane))


def _of_one_strength(samples: Samples, estimate: Estimate) -> Floats:
    """(m, 3) unused readings, brought to one field strength where the method knows that of each."""
    alike = at_one_strength(Readings.of(samples), estimate)
    return np.concatenate([np.empty((0, 3)), *alike.blocks(estimate.method)])


def _laid_flat(field: Floats, plane: Plane) -> Floats:
    """(N, 3) readings without what they read along the axis that is turned about."""
    flat = field.copy()
    flat[:, order_of(plane)[2]] = 0.0
    return flat


def _turn(plane: Plane | None, dip_deg: float) -> dict[str, Any]:
    """How the vehicle turns whose heading is judged: level, or about the axis across a plane that was laid flat."""
    return {"dip_deg": dip_deg} if plane is None else {"dip_deg": 0.0, "down": np.eye(3)[order_of(plane)[2]]}


def _blocks(samples: Samples, blocks: int) -> Iterator[tuple[Recording, slice]]:
    """Yield all other readings and the rows of each block."""
    cuts = np.linspace(0, len(samples), blocks + 1).astype(int)
    for begin, end in pairwise(cuts):
        before, after = samples[:begin], samples[end:]
        yield joined([part for part in (before, after) if len(part)]), slice(begin, end)


def _required_change(equations: NormalEquations, curvature: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(9,) change of offset and shape that the unused readings require."""
    variance = max(equations.cost / max(equations.count, 1), np.finfo(float).tiny)
    ridge = np.eye(9) * (variance / (SPREAD * ellipsoid.radius) ** 2)
    first = replace(equations, matrix=equations.matrix + ridge).step()
    # what no change of offset and shape explains
    left = equations.cost - 2.0 * float(first @ equations.gradient) + float(first @ equations.matrix @ first)
    noise = max(left, 0.0) / max(equations.count - 9, 1)
    corrected = replace(equations, matrix=equations.matrix + ridge, gradient=equations.gradient - noise * curvature)
    return corrected.step()


def _jackknife(ellipsoids: list[Ellipsoid]) -> tuple[Ellipsoid, Floats]:
    """Their mean, and the (9, 9) variance of the jackknife; all brought to one radius, as scale turns no heading."""
    radius = float(np.exp(np.mean([np.log(one.radius) for one in ellipsoids])))
    each = np.array([Ellipsoid(one.centre, one.shape * (radius / one.radius)).parameters for one in ellipsoids])
    middle = each.mean(axis=0)
    apart = each - middle
    scatter = (len(each) - 1) / len(each) * apart.T @ apart
    return Ellipsoid.of_parameters(middle), scatter
