"""What a fit may claim: a method's covariance, widened by all that the method does not know of.

The residuals of real recordings are correlated, readings are repeated, methods have a bias, few readings leave the
noise itself uncertain, and several recordings of one sensor differ by more than each of them claims. The engine widens
by repeated and by few readings (``claim.c``); what needs other fits is added here.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.estimators.auto import Auto
>>> readings = Readings.of(simulate.tumble(seed=1, n=300).samples)
>>> widened = claimed(Auto().estimate(readings), readings, Auto(), readings.summary.statistics)
>>> float(widened.record["repetition"]), widened.repeats is None
(1.0, True)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flinders.core.joining import Joined
from flinders.errors import FitError
from flinders.estimators import ROWS, Readings
from flinders.estimators.covariance import beyond_chance
from flinders.fitting.record import record_of
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators import Estimate
    from flinders.estimators.auto import Auto
    from flinders.native.layouts import Records
    from flinders.summary.coverage import Coverage
    from flinders.summary.summary import Statistics


class Widened(NamedTuple):
    """An estimate with the covariance that it may claim.

    Attributes
    ----------
    estimate : Estimate
    record : Records
        Of the engine, claimed.
    repeats : Repeats, optional
        Recordings of one sensor, compared with each other.
    """

    estimate: Estimate
    record: Records
    repeats: Repeats | None = None

    def widened(self, covariance: Floats) -> Widened:
        """The same with another covariance (9, 9); level errors are not known then."""
        self.record["covariance"] = covariance.ravel()
        self.record["level_worst_deg"] = self.record["level_rms_deg"] = np.nan
        return self._replace(estimate=replace(self.estimate, covariance=covariance))

    def shrunk(self) -> Widened:
        """The same with the estimate of the record, which was shrunk."""
        ellipsoid = Ellipsoid(self.record["centre"].copy(), symmetric(self.record["shape"]))
        covariance = self.record["covariance"].reshape(9, 9).copy()
        return self._replace(estimate=replace(self.estimate, ellipsoid=ellipsoid, covariance=covariance, textbook=None))


def claimed(
    estimate: Estimate,
    readings: Readings,
    likelihood: Auto,
    statistics: Statistics,
    *,
    coverage: Coverage | None = None,
    record: Records | None = None,
    is_biased: bool = False,
    is_joint: bool = False,
) -> Widened:
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
    coverage : Coverage, optional
        Of the readings.
    record : Records, optional
        Of the engine, which made the estimate.
    is_biased : bool
        The method has a bias of its own.
    is_joint : bool
        The estimate is of several instruments, and knows how its residuals are correlated and that readings are few.
    """
    is_wide = record is not None or estimate.correlation is not None or estimate.plane or readings.recording is None
    reference = None if is_joint or (is_wide and not is_biased) else _reference(readings, likelihood)
    if reference is not None and not is_wide and not reference.plane and not reference.unobserved:
        estimate = as_correlated(estimate, reference)
    filled = record_of(estimate, statistics, coverage, dip_deg=likelihood.dip_deg) if record is None else record.copy()
    engine().claim(filled, engine().request(parameters=0 if is_joint else _parameters(estimate), shrinks=0))
    widened = Widened(replace(estimate, covariance=filled["covariance"].reshape(9, 9).copy()), filled)
    if reference is not None and is_biased:
        biased = with_bias(widened.estimate, reference)
        widened = widened.widened(biased.covariance)._replace(estimate=biased)
    repeats = _compared(readings, likelihood, widened.estimate)
    return (
        widened
        if repeats is None
        else widened.widened(widened.estimate.covariance + repeats.scatter)._replace(repeats=repeats)
    )


def _reference(readings: Readings, likelihood: Auto) -> Estimate | None:
    """The estimate of the maximum likelihood; None where the readings are too few for its model."""
    try:
        return likelihood.estimate(readings)
    except FitError:
        return None


def _parameters(estimate: Estimate) -> int:
    """How many parameters its method finds."""
    name = estimate.estimator or estimate.method
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
            widening = engine().widening_by_few(len(part.summary) - _parameters(alone))
            fits = turns if alone.plane else others
            fits.append(RecordingFit(source, alone.used, alone.ellipsoid, alone.covariance * widening))
    fits = turns if estimate.plane or len(others) < 2 else others
    return compared(fits, dip_deg=likelihood.dip_deg) if len(fits) > 1 else None
