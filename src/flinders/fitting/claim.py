"""What a fit may claim: a method's covariance, widened by all that the method does not know of.

The residuals of real recordings are correlated, readings are repeated, methods have a bias, few readings leave the
noise itself uncertain, and several recordings of one sensor differ by more than each of them claims.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.estimators.auto import Auto
>>> readings = Readings.of(simulate.tumble(seed=1, n=300).samples)
>>> claim = claimed(Auto().estimate(readings), readings, Auto(), readings.summary.statistics)
>>> claim.repetition, claim.repeats is None
(1.0, True)
>>> round(widening_by_few(12), 3), round(widening_by_few(3000), 3)
(1.2, 1.001)
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flinders.core.samples import Joined
from flinders.errors import FitError
from flinders.estimators import ROWS, Readings
from flinders.estimators.covariance import beyond_chance

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators import Estimate
    from flinders.estimators.auto import Auto
    from flinders.summary.summary import Statistics


class Claim(NamedTuple):
    """An estimate with the covariance that it may claim.

    Attributes
    ----------
    estimate : Estimate
    repetition : float
        Factor by which repeated readings, no new evidence, have widened it.
    repeats : Repeats, optional
        Recordings of one sensor, compared with each other.
    """

    estimate: Estimate
    repetition: float
    repeats: Repeats | None = None


def claimed(
    estimate: Estimate,
    readings: Readings,
    likelihood: Auto,
    statistics: Statistics,
    *,
    is_biased: bool = False,
    is_joint: bool = False,
) -> Claim:
    """Widen the covariance of an estimate.

    Parameters
    ----------
    estimate : Estimate
    readings : Readings
        That it was made of.
    likelihood : Auto
        What a method that does not look at residuals is compared with.
    statistics : Statistics
        Of the readings.
    is_biased : bool
        The method has a bias of its own.
    is_joint : bool
        The estimate is of several instruments, and knows how its residuals are correlated.
    """
    if is_joint:
        claim = repeated(estimate, statistics)
    else:
        claim = _widened(estimate, readings, likelihood, statistics, is_biased=is_biased)
    repeats = _compared(readings, likelihood, claim.estimate)
    if repeats is None:
        return claim
    whole = replace(claim.estimate, covariance=claim.estimate.covariance + repeats.scatter)
    return claim._replace(estimate=whole, repeats=repeats)


def repeated(estimate: Estimate, statistics: Statistics) -> Claim:
    """Widen the covariance of an estimate by repeated readings alone."""
    repetition = _repetition(estimate, statistics)
    return Claim(_scaled(estimate, repetition), repetition)


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    """The estimate with a covariance so many times as large."""
    return replace(estimate, covariance=estimate.covariance * factor)


def _widened(
    estimate: Estimate, readings: Readings, likelihood: Auto, statistics: Statistics, *, is_biased: bool
) -> Claim:
    """Add correlation, repeated readings, few readings and bias."""
    reference = None
    has_residuals = estimate.correlation is not None or estimate.plane or readings.recording is None
    if is_biased or not has_residuals:
        try:
            reference = likelihood.estimate(readings)
        except FitError:  # too few readings to see beyond the simpler model
            reference = None
    if reference is not None and not has_residuals and not reference.plane and not reference.unobserved:
        estimate = as_correlated(estimate, reference)
    repetition = _repetition(estimate, statistics)
    estimate = _scaled(estimate, widening(statistics.fitted, repetition, _parameters(estimate)))
    if reference is not None and is_biased:
        estimate = with_bias(estimate, reference)
    return Claim(estimate, repetition)


def _repetition(estimate: Estimate, statistics: Statistics) -> float:
    """Factor by which repeated readings widen a covariance that does not know of them yet."""
    share = statistics.fitted / max(statistics.fitted_distinct, 1)
    return max(1.0, share / max(estimate.variance_inflation(), sys.float_info.min))


def _parameters(estimate: Estimate) -> int:
    """How many parameters its method finds."""
    name = estimate.method.partition(" ")[0]  # without its variant
    return ROWS[name].parameters if name in ROWS else 5 if estimate.plane else 9


def as_correlated(estimate: Estimate, likelihood: Estimate) -> Estimate:
    """Widen a claim that takes residuals for independent as much as that of the likelihood is widened.

    The factor is the mean over the variances of all nine parameters.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Of the same readings.
    """
    if estimate.correlation is not None or likelihood.textbook is None:
        return estimate
    factor = max(1.0, likelihood.variance_inflation())
    return replace(
        estimate,
        covariance=estimate.covariance * factor,
        textbook=estimate.covariance,
        correlation=likelihood.correlation,
    )


def with_bias(estimate: Estimate, likelihood: Estimate) -> Estimate:
    """Add ddᵀ to the covariance, where d separates an estimate from the likelihood's `beyond_chance`.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Of the same readings.
    """
    difference = estimate.ellipsoid.parameters - likelihood.ellipsoid.parameters
    bias = beyond_chance(difference, estimate.covariance + likelihood.covariance)
    covariance = estimate.covariance + np.outer(bias, bias)
    if likelihood.unobserved:  # where the readings leave it open, nobody knows how far off a method is
        covariance = covariance + likelihood.covariance
    return replace(estimate, covariance=covariance, bias=bias if bias.any() else None)


def widening(rows: float, repetition: float, parameters: int) -> float:
    """Factor by which repeated and few readings widen a covariance.

    The noise was taken over the residuals of all rows less the parameters; only the different ones are independent.

    >>> round(widening(1000, 1.0, 9), 3), round(widening(1000, 40.0, 9), 1)
    (1.002, 70.8)
    """
    freedom = rows / repetition - parameters
    return ((rows - parameters) / freedom if freedom >= 1.0 else repetition) * widening_by_few(freedom)


def widening_by_few(freedom: float) -> float:
    """Factor by which few readings widen a covariance, as their noise is known from few residuals.

    The variance of Student's t, ν/(ν − 2), for the ν readings beyond those that the parameters take up. Below three
    there is no such variance, and the factor grows by four for each reading that is missing.
    """
    return freedom / (freedom - 2.0) if freedom >= 3.0 else 3.0 * 4.0 ** (3.0 - max(freedom, 0.0))


def halves_apart(samples: Samples, likelihood: Auto, estimate: Estimate) -> float | None:
    """How far the halves of a recording are apart at the worst heading, over what both claim of it."""
    middle = len(samples) // 2
    repeats = _compared(Readings.of(Joined((samples[:middle], samples[middle:]))), likelihood, estimate)
    return (
        None
        if repeats is None
        else float(max(part.difference_deg / part.difference_sigma_deg for part in repeats.parts))
    )


def _compared(readings: Readings, likelihood: Auto, estimate: Estimate) -> Repeats | None:
    """Compare the recordings of a sensor, those that determine a calibration by themselves.

    Level turns are only compared with each other: each rests on the dip, and elsewhere that is estimated.
    """
    if not readings.parts:
        return None
    from flinders.diagnostics.repeatability import RecordingFit, compared

    turns: list[RecordingFit] = []
    others: list[RecordingFit] = []
    for part in readings.parts:
        try:
            alone = likelihood.estimate(part)
        except FitError:
            continue
        if alone.plane or not alone.unobserved:
            source = "" if part.recording is None else part.recording.source
            widening = widening_by_few(len(part.summary) - _parameters(alone))
            fits = turns if alone.plane else others
            fits.append(RecordingFit(source, alone.used, alone.ellipsoid, alone.covariance * widening))
    fits = turns if estimate.plane or len(others) < 2 else others
    return compared(fits, dip_deg=likelihood.dip_deg) if len(fits) > 1 else None
