"""Widening of the covariance of a fit by errors that its method does not include.

In real recordings residuals are correlated and readings are repeated. Methods may have a bias. The noise itself is
uncertain if there are few readings. Several recordings of one sensor differ by more than each of them claims. The
engine widens for repeated and for few readings (``claim.c``); this module adds the widening that needs further fits.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.estimators.auto import Auto
>>> readings = Readings.of(simulate.tumble(seed=1, n=300).samples)
>>> widened = widen_claim(Auto().estimate(readings), readings, Auto(), readings.summary.statistics)
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
from flinders.estimators.covariance import unexplained_part
from flinders.fitting.record import record_of
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
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
    """An estimate with its widened covariance.

    Attributes
    ----------
    estimate : Estimate
        Estimate with the widened covariance.
    record : Records
        Record of the engine, with the claim.
    repeats : Repeats, optional
        Comparison of several recordings of one sensor.
    """

    estimate: Estimate
    record: Records
    repeats: Repeats | None = None

    def with_covariance(self, covariance: Floats) -> Widened:
        """A copy with another (9, 9) covariance; level heading errors are then unknown."""
        self.record["covariance"] = covariance.ravel()
        self.record["level_worst_deg"] = self.record["level_rms_deg"] = np.nan
        return self._replace(estimate=replace(self.estimate, covariance=covariance))

    def with_shrinkage(self) -> Widened:
        """A copy with the estimate that the engine has shrunk towards no correction."""
        ellipsoid = Ellipsoid(self.record["centre"].copy(), symmetric_matrix(self.record["shape"]))
        covariance = self.record["covariance"].reshape(9, 9).copy()
        return self._replace(estimate=replace(self.estimate, ellipsoid=ellipsoid, covariance=covariance, textbook=None))


def widen_claim(
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
        Estimate of any method.
    readings : Readings
        Readings of the estimate.
    likelihood : Auto
        Estimator for the comparison with methods that do not evaluate residuals.
    statistics : Statistics
        Statistics of the readings.
    coverage : Coverage, optional
        Coverage of the readings.
    record : Records, optional
        Record of the engine, if the engine made the estimate.
    is_biased : bool
        Whether the method has a bias.
    is_joint : bool
        Whether the estimate is from several instruments, and its covariance already includes correlated residuals and
        few readings.
    """
    is_wide = record is not None or estimate.correlation is not None or estimate.plane or readings.recording is None
    reference = None if is_joint or (is_wide and not is_biased) else _reference(readings, likelihood)
    if reference is not None and not is_wide and not reference.plane and not reference.unobserved:
        estimate = widen_by_correlation(estimate, reference)
    filled = record_of(estimate, statistics, coverage, dip_deg=likelihood.dip_deg) if record is None else record.copy()
    engine().claim(filled, engine().request(parameters=0 if is_joint else _parameter_count(estimate), shrinks=0))
    widened = Widened(replace(estimate, covariance=filled["covariance"].reshape(9, 9).copy()), filled)
    if reference is not None and is_biased:
        biased = with_bias(widened.estimate, reference)
        widened = widened.with_covariance(biased.covariance)._replace(estimate=biased)
    repeats = _compare(readings, likelihood, widened.estimate)
    return (
        widened
        if repeats is None
        else widened.with_covariance(widened.estimate.covariance + repeats.scatter)._replace(repeats=repeats)
    )


def _reference(readings: Readings, likelihood: Auto) -> Estimate | None:
    """The maximum likelihood estimate; None if there are too few readings for its model."""
    try:
        return likelihood.estimate(readings)
    except FitError:
        return None


def _parameter_count(estimate: Estimate) -> int:
    """Count of parameters of the method of an estimate."""
    name = estimate.estimator or estimate.method
    return ROWS[name].parameters if name in ROWS else 5 if estimate.plane else 9


def widen_by_correlation(estimate: Estimate, likelihood: Estimate) -> Estimate:
    """Widen a claim for independent residuals by the factor that the likelihood fit claims for correlated ones.

    The factor is the mean over the variances of all nine parameters.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Estimates of the same readings.
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
    """Add the bias of a method to the covariance: d dᵀ with the difference d from the likelihood estimate.

    d is without the part that chance explains, see `unexplained_part`.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Estimates of the same readings.
    """
    difference = estimate.ellipsoid.parameters - likelihood.ellipsoid.parameters
    bias = unexplained_part(difference, estimate.covariance + likelihood.covariance)
    covariance = estimate.covariance + np.outer(bias, bias)
    if likelihood.unobserved:  # the bias of a method is unknown in directions that the readings do not determine
        covariance = covariance + likelihood.covariance
    return replace(estimate, covariance=covariance, bias=bias if bias.any() else None)


def compare_halves(samples: Samples, likelihood: Auto, estimate: Estimate) -> float | None:
    """Ratio of the heading difference between the halves of a recording, at the worst heading, to its claimed 1 σ.

    None if one of the halves gives no fit.
    """
    middle = len(samples) // 2
    repeats = _compare(Readings.of(Joined((samples[:middle], samples[middle:]))), likelihood, estimate)
    return (
        None
        if repeats is None
        else float(max(part.difference_deg / part.difference_sigma_deg for part in repeats.parts))
    )


def _compare(readings: Readings, likelihood: Auto, estimate: Estimate) -> Repeats | None:
    """Compare those recordings of a sensor that each determine a calibration; None for fewer than two.

    Level turns are compared only with each other, because they assume the dip, while other recordings estimate it.
    """
    if not readings.parts:
        return None
    from flinders.diagnostics.repeatability import RecordingFit, compare_recordings

    turns: list[RecordingFit] = []
    others: list[RecordingFit] = []
    for part in readings.parts:
        try:
            alone = likelihood.estimate(part)
        except FitError:
            continue
        if alone.plane or not alone.unobserved:
            source = "" if part.recording is None else part.recording.source
            widening = engine().widening_by_few(len(part.summary) - _parameter_count(alone))
            fits = turns if alone.plane else others
            fits.append(RecordingFit(source, alone.used, alone.ellipsoid, alone.covariance * widening))
    fits = turns if estimate.plane or len(others) < 2 else others
    return compare_recordings(fits, dip_deg=likelihood.dip_deg) if len(fits) > 1 else None
