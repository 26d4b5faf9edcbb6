"""What an estimator is, and what it gives back; a claim widened by what its method leaves out of it.

A closed form claims what independent residuals would allow, and residuals of real recordings are not independent. A
sphere through the readings of an ellipsoid, or plain least squares on half a sphere, is wrong by far more than its
scatter says. The likelihood of the same readings is there to be asked: how residuals are correlated it has found, and
both fits can be compared with each other: what chance explains of the difference is removed, the rest joins the
claim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, Protocol

import numpy as np

from flinders.errors import UsageError
from flinders.likelihood.prior import SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.outliers import Outlier
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane


OF_SITE: Final = ("dip_deg", "field_strength")
"""Options of methods that the site says: `flinders.fit` gives them."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """What residuals say of each other."""

    lag_one: float  # correlation of a residual with the next
    time: float  # readings that say as much as one independent reading
    direction: float  # standard deviation of the distortion that belongs to directions, in the unit of the readings
    excess_variance: float = 1.0  # factor by which blocks of the recording scatter more than that allows, in variance
    lasting: float = 0.0  # probability that slow noise lasts longer than a third of the recording
    steps_kurtosis: float = math.nan  # of steps between means of successive residuals, where they are correlated

    @property
    def is_white(self) -> bool:
        """Nothing but independent noise was found."""
        return self.time == 1.0 and self.direction == 0.0 and self.excess_variance == 1.0

    def effective(self, count: float) -> float:
        """How many independent readings say as much as `count` of these."""
        return count / (self.time * self.excess_variance)


class SiteStrength(NamedTuple):
    """The strength of the field at a site beside that of readings, in their unit."""

    site: float
    found: float  # mean semi-axis of the ellipsoid as the readings alone show it
    sigmas: float  # how far the two are apart, over what is not known of both


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """An ellipsoid with its uncertainty."""

    ellipsoid: Ellipsoid
    # (9, 9): of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; singular where a method holds some of them
    covariance: Floats
    noise: float  # standard deviation of the distance from the ellipsoid, in the unit of the readings
    method: str  # what was run in the end, with its variant
    # (9,): difference from the likelihood (from the consistent fit where there are only sums), as far as chance does
    # not explain it, and None where it does; in the covariance already
    bias: Floats | None = None
    # share of the worst known shape parameter that a prior speaks for: 0 where the readings say it all, 1 where they
    # say nothing
    prior_influence: float = 0.0
    correlation: Correlation | None = None  # how residuals are correlated; the covariance is wider for it
    textbook: Floats | None = None  # (9, 9): covariance that would hold for independent residuals
    used: int = 0  # readings that it rests on
    unobserved: int = 0  # directions of parameter space of which the readings say nothing
    rejected_beyond: float = np.inf  # distance from the surface beyond which readings were left out, in their unit
    outliers: tuple[Outlier, ...] = ()  # all that was left out: `used` and their rows add up to the readings there were
    # length that the method gives to corrected readings where no field strength is known; None for that which makes the
    # determinant of the matrix 1
    strength: float | None = None
    site_strength: SiteStrength | None = None  # where the site's strength was used, or contradicts the readings
    plane: Plane | None = None  # ``xy``, ``yz`` or ``zx`` where the readings of one plane are all that it rests on
    # ``constant`` or ``varying`` where the recording tells the field's strength at each reading and the scale rests on
    # it; `strength` is then its mean, and known
    follows: Literal["", "constant", "varying"] = ""
    may_be_swapped: bool = True  # False where the engine saw no moment at which axes changed sign or place
    # False where an accelerometer shows that z points elsewhere, so that the dip of the site was left out; None where
    # that dip was used and neither an accelerometer nor anybody says which way z points
    z_down: bool | None = True
    is_aided: bool = False  # the surface is that of the magnetometer and of aiding sensors
    estimator: str = ""  # row of the table of methods that made it, where `method` says more than its name

    def variance_inflation(self, parameters: Iterable[int] = range(9)) -> float:
        """Mean ratio of variances to those that would hold for independent residuals; 1 where these are not known."""
        if self.textbook is None:
            return 1.0
        claimed, independent = self.covariance.diagonal().tolist(), self.textbook.diagonal().tolist()
        ratios = [claimed[place] / independent[place] for place in parameters if independent[place] > 0.0]
        return sum(ratios) / len(ratios) if ratios else 1.0


def check_prior(spread: object) -> None:
    """Let the spread of a prior through that means something, or None for no prior; else raise UsageError."""
    if spread is not None and not (isinstance(spread, int | float) and 0.0 < spread < np.inf):
        raise UsageError(f"prior is {spread!r}: need a positive number such as {SPREAD:g}, or None")


class Estimator(Protocol):
    """A way of finding an ellipsoid."""

    name: ClassVar[str]  # what `flinders.fit(method=…)` calls it
    unknowns: ClassVar[int]  # what it finds, the noise among it, and so the least number of readings
    is_biased: ClassVar[bool]  # its model or its equation leaves an error that more readings do not take away

    def estimate(self, readings: Readings) -> Estimate:
        """Fit.

        Raises `FitError` if these readings give no ellipsoid.
        """


@dataclass(frozen=True, slots=True)
class Method:
    """A row of the table of methods, at the end of the file of each."""

    kind: type[Estimator]  # with its name and unknowns
    use: str  # when to use it, in one line
    source: str  # paper or program that it follows
    is_recipe: bool = False  # kept as it was published: its numbers may be asked for where its fit is refused

    @property
    def parameters(self) -> int:
        """Parameters of its ellipsoid, which has no more than nine, without the noise."""
        return min(self.kind.unknowns - 1, 9)
