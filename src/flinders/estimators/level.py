"""Level: the ellipse of a level turn, for vehicles that cannot be turned upside down."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import UsageError
from flinders.estimators.base import Method, check_prior
from flinders.estimators.likelihood import LEVEL_METHOD, estimate_from_record
from flinders.likelihood import prior
from flinders.native.engine import engine
from flinders.summary.summary import MAX_FLAT_NOISE_RATIO

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

TRIM_COUNT, TRIM_SHARE = 3, 0.03
"""Trimming of readings far from their plane, to measure flatness: number of rounds, and share left out in each."""


@dataclass(frozen=True, slots=True)
class Level:
    """Ellipse through the x and y of a level turn: two offsets, two scales and their skew.

    With the field u = (cos I cos ψ, −cos I sin ψ, sin I) a level vehicle reads in x and y

        c + S₂ (cos ψ, −sin ψ),     c = b + sin I (S₁₃, S₂₃),     S₂ = cos I (S₁₁, S₁₂; S₁₂, S₂₂)

    which is an ellipse for any hard and soft iron. The ellipse is estimated like the ellipsoid of `Likelihood`,
    from the readings projected to the plane. It corrects headings while the vehicle stays level. Parameters along
    z have only priors: no soft iron, within the prior's spread; the offset by the dip, with the field strength as
    1 σ.

    Use it for vehicles that cannot be turned upside down. `auto` uses it if all readings are in one plane
    perpendicular to z.

    Parameters
    ----------
    prior : float
        See `Likelihood`; in the plane the prior matters only for less than a full turn.
    dip_deg : float
        Inclination of the field at the site, in degrees.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> heading = np.arange(200) * (2 * np.pi / 200)
    >>> level = np.stack([25 * np.cos(heading) + 20, -30 * np.sin(heading) + 90, np.full(200, 60.0)], axis=1)
    >>> ellipsoid = Level().estimate(Readings.of(level)).ellipsoid
    >>> ellipsoid.centre[:2].round(3), ellipsoid.shape.diagonal()[:2].round(3)
    (array([20., 90.]), array([50., 60.]))
    """

    prior: float = prior.SOFT_IRON_SPREAD
    dip_deg: float = 60.0

    name: ClassVar[str] = LEVEL_METHOD
    unknowns: ClassVar[int] = 6
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Raise `UsageError` for an invalid prior or none: a level turn does not determine parameters along z."""
        check_prior(self.prior)
        if self.prior is None:
            raise UsageError(
                "the method level needs a prior, as its readings lie in one plane: give a prior",
                hint={"prior": prior.SOFT_IRON_SPREAD},
            )

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipse to x and y.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if half
        of the readings are in one place; `NeedsSamples` if only sums were given.
        """
        readings.require(self.unknowns, self.name, axes="xy")
        readings = readings.for_fit()
        field, ends = readings.as_array(self.name)
        record = engine().fit_level(field, ends=ends, prior=self.prior, dip_deg=self.dip_deg, rests=0)
        return estimate_from_record(record, readings, has_statistics=True)


def is_level(covariance: Floats, noise: float, *, within: float = MAX_FLAT_NOISE_RATIO) -> bool:
    """Whether readings are in one plane perpendicular to z, except for noise; `covariance` is (3, 3)."""
    return engine().is_level(covariance, noise, within)


def is_level_turn(field: Floats) -> bool:
    """Whether (N, 3) readings, in the order of recording, are in a plane perpendicular to z, except for noise.

    The noise is estimated from differences of consecutive readings, so that swaying of the body does not count as
    noise.

    >>> headings, rng = np.arange(0.0, 6.28, 0.01), np.random.default_rng(1)
    >>> level = np.stack([25 * np.cos(headings), 25 * np.sin(headings), 0 * headings], axis=1)
    >>> swayed = level + np.outer(np.sin(5 * headings), [0.0, 0.0, 2.0])
    >>> [is_level_turn(each + 0.5 * rng.standard_normal(each.shape)) for each in (level, swayed)]
    [True, False]
    """
    for _ in range(TRIM_COUNT):
        axis = np.linalg.eigh(np.cov(field.T))[1][:, 0]
        across = np.abs(field @ axis - np.median(field @ axis))
        field = field[across <= np.quantile(across, 1.0 - TRIM_SHARE)]
    if len(field) < Level.unknowns:
        return False
    covariance = np.cov(field.T)
    steps = np.diff(field @ np.linalg.eigh(covariance)[1][:, 0])
    return is_level(covariance, math.sqrt(0.5 * float(np.mean(steps**2))))


METHOD: Final = Method(
    Level,
    use="ellipse of a level turn, x and y only: vehicles that cannot be turned over",
    source="the likelihood in a plane; Rousseeuw (1984) for its start",
)
