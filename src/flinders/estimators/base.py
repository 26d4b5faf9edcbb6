"""Interface of estimators, and their estimates; the claim of an estimate includes the bias of the method.

A closed-form method claims the uncertainty for independent residuals, but residuals of real recordings are correlated.
A method may also have a bias that is much larger than its scatter, such as a sphere fitted to an ellipsoid, or plain
least squares on half a sphere. Therefore a closed-form estimate is compared with the likelihood fit of the same
readings. The correlation of residuals is taken from the likelihood fit. The difference of both fits, without the part
that chance explains, is added to the claim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, Protocol

import numpy as np

from flinders.errors import UsageError
from flinders.likelihood.prior import SOFT_IRON_SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.outliers import Outlier
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane


SITE_OPTIONS: Final = ("dip_deg", "field_strength")
"""Options of methods that `flinders.fit` sets from the site."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of residuals in time and direction."""

    lag_one: float  # correlation of consecutive residuals
    time: float  # correlation length: number of readings per independent reading
    direction: float  # standard deviation of the distortion by direction, in the unit of the readings
    excess_variance: float = 1.0  # ratio of variances: scatter of blocks of the recording over that of this model
    lasting: float = 0.0  # probability that slow noise lasts longer than a third of the recording
    # kurtosis of the steps between means of successive residuals; NaN if residuals are not correlated
    steps_kurtosis: float = math.nan

    @property
    def is_white(self) -> bool:
        """Whether the residuals are independent."""
        return self.time == 1.0 and self.direction == 0.0 and self.excess_variance == 1.0

    def independent_count(self, count: float) -> float:
        """Number of independent readings that are equivalent to `count` readings."""
        return count / (self.time * self.excess_variance)


class SiteStrength(NamedTuple):
    """Comparison of the known field strength of a site with the strength that the readings show, in their unit."""

    site: float  # strength of the site
    found: float  # strength by the readings alone: mean semi-axis of their ellipsoid
    sigmas: float  # difference of both strengths in standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """An ellipsoid with its uncertainty."""

    ellipsoid: Ellipsoid
    # (9, 9): covariance of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; singular if a method fixes parameters
    covariance: Floats
    noise: float  # standard deviation of the distance from the ellipsoid, in the unit of the readings
    method: str  # method that gave the estimate, with its variant
    # (9,): bias of the method: difference from the likelihood fit, or from the consistent fit for sums alone, without
    # the part that chance explains; None if chance explains the difference. The covariance includes the bias.
    bias: Floats | None = None
    # fraction of information from the prior in the least known shape parameter: 0 to 1
    prior_influence: float = 0.0
    correlation: Correlation | None = None  # correlation of the residuals, which is included in the covariance
    textbook: Floats | None = None  # (9, 9): covariance for independent residuals
    used: int = 0  # number of readings in the fit
    unobserved: int = 0  # number of directions of parameter space that the readings do not determine
    rejected_beyond: float = np.inf  # distance from the surface beyond which readings were left out, in their unit
    outliers: tuple[Outlier, ...] = ()  # runs of outliers; `used` and their rows add up to the number of readings
    # length of corrected readings, if the method or the site determines it; None if it follows from a matrix of
    # determinant 1
    strength: float | None = None
    # comparison with the strength of the site, if that was used or contradicts the readings; else None
    site_strength: SiteStrength | None = None
    plane: Plane | None = None  # ``xy``, ``yz`` or ``zx`` for a fit of readings in one plane
    # ``constant`` or ``varying`` strength of the field, if the recording has the strength at each reading, which
    # determines the scale; `strength` is then the mean of these values. Empty without them.
    follows: Literal["", "constant", "varying"] = ""
    may_be_swapped: bool = True  # False if the engine found no exchange of axes during the recording
    # False if an accelerometer shows that z does not point down, so that the dip of the site was not used. None if the
    # dip of the site was used although the direction of z is not known. Else True.
    z_down: bool | None = True
    is_aided: bool = False  # whether aiding sensors contributed to the ellipsoid
    estimator: str = ""  # name of the method in the table of methods, if `method` has a variant; else empty

    def variance_inflation(self, parameters: Iterable[int] = range(9)) -> float:
        """Mean ratio of the claimed variances to those for independent residuals; 1 if the latter are not known."""
        if self.textbook is None:
            return 1.0
        claimed, independent = self.covariance.diagonal().tolist(), self.textbook.diagonal().tolist()
        ratios = [claimed[place] / independent[place] for place in parameters if independent[place] > 0.0]
        return sum(ratios) / len(ratios) if ratios else 1.0


def check_prior(spread: object) -> None:
    """Raise `UsageError` unless the spread of a prior is a positive number, or None for no prior."""
    if spread is not None and not (isinstance(spread, int | float) and 0.0 < spread < np.inf):
        raise UsageError(f"prior is {spread!r}: need a positive number such as {SOFT_IRON_SPREAD:g}, or None")


class Estimator(Protocol):
    """Interface of a method that estimates an ellipsoid."""

    name: ClassVar[str]  # name in `flinders.fit(method=…)`
    unknowns: ClassVar[int]  # number of unknowns including the noise, and smallest number of readings
    is_biased: ClassVar[bool]  # whether its model or equation leaves an error that more readings do not reduce

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `FitError` if these readings give no ellipsoid.
        """


@dataclass(frozen=True, slots=True)
class Method:
    """Row of the table of methods, at the end of the file of each method."""

    kind: type[Estimator]  # class of the method, with its name and unknowns
    use: str  # when to use it, in one line
    source: str  # paper or program that it follows
    is_recipe: bool = False  # whether it is a published recipe, whose numbers are available even if its fit is refused
    programs: tuple[str, ...] = ()  # programs whose numbers it gives; the error for such a name names the method

    @property
    def parameters(self) -> int:
        """Number of parameters of its ellipsoid, at most nine, without the noise."""
        return min(self.kind.unknowns - 1, 9)
