"""An estimate with its readings, their statistics and coverage, and the engine's record.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.estimators.auto import Auto
>>> samples = simulate.tumble(seed=1, n=500, motion="uniform").samples
>>> found = Estimated.of_record(Auto(), Readings.of(samples), samples.unit)
>>> found.estimate.method, int(found.record["used"])
('likelihood', 500)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

from flinders.core.calibration import UNKNOWN_UNIT
from flinders.core.samples import Samples
from flinders.diagnostics.unmoved import require_moved, was_turned
from flinders.estimators.auto import Auto
from flinders.estimators.level import Level
from flinders.estimators.likelihood import estimate_from_record
from flinders.summary.coverage import Coverage, RecordCoverage
from flinders.summary.summary import Statistics

if TYPE_CHECKING:
    from flinders.core.units import Unit
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.estimators import Estimate, Estimator, Readings
    from flinders.estimators.disturbance import DisturbanceFit
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.linearization import AxisTerms
    from flinders.native.layouts import Records


class Estimated(NamedTuple):
    """An estimate with its readings and the properties of these.

    Attributes
    ----------
    estimate : Estimate
    readings : Readings
    statistics : Statistics
    coverage : Coverage
    record : Records, optional
        Record of the engine, if the other attributes come from this record.
    disturbed : DisturbanceFit, optional
        Fit of the disturbances that were subtracted from the readings.
    aiding : Aiding, optional
    is_joint : bool
        Whether aiding sensors were used in the estimate.
    refreshed : Refreshed, optional
        Changes since an earlier calibration, if the shape is that of this calibration.
    linearized : AxisTerms, optional
        Terms of nonlinear axes that were subtracted from the readings.
    unused : tuple of DisturbanceEstimate
        Columns that were tried and left out, because they explain nothing.
    """

    estimate: Estimate
    readings: Readings
    statistics: Statistics
    coverage: Coverage
    record: Records | None = None
    disturbed: DisturbanceFit | None = None
    aiding: Aiding | None = None
    is_joint: bool = False
    refreshed: Refreshed | None = None
    linearized: AxisTerms | None = None
    unused: tuple[DisturbanceEstimate, ...] = ()

    @classmethod
    def of(cls, estimate: Estimate, readings: Readings, aiding: Aiding | None = None) -> Self:
        """Take statistics and coverage from the summary of the readings."""
        summary = readings.summary
        coverage = Coverage.of_cloud(summary.cloud, estimate.ellipsoid, within=estimate.rejected_beyond)
        statistics = replace(readings.statistics, doubt=_doubt(readings))
        return cls(estimate, readings, statistics, coverage, aiding=aiding)

    @classmethod
    def of_record(
        cls, estimator: Estimator, readings: Readings, unit: Unit | None, *, has_sigma: bool = False
    ) -> Self | None:
        """Take the estimate from the engine's record of one recording in memory; None if the record is not sufficient.

        With `has_sigma` the record includes standard deviations of the nonlinear terms.
        """
        samples = readings.recording
        if not isinstance(estimator, Auto) or not isinstance(samples, Samples) or readings.parts:
            return None
        record = estimator.fit_record(readings, statistics=2 if has_sigma else 1)
        if record["status"] or record["hides_plane"]:
            return None
        if record["plane"] and samples.acceleration is not None:  # the accelerometer may show that the turn was not
            # level, which widens the claim
            return None
        if record["plane"] and not record["rails"]:
            require_turned(readings, estimator, unit)
        elif not was_turned(record, (unit or UNKNOWN_UNIT).inside):
            return None
        if record["rests"]:
            readings = readings.for_fit()
        estimate = estimate_from_record(record, readings, has_statistics=True)
        statistics = Statistics.of_record(record, samples.time, readings.summary.skipped)
        if (rests := readings.rests) is not None:
            statistics = replace(statistics, rest_spans=rests.spans, are_rests_left_out=rests.are_left_out)
        statistics = replace(statistics, doubt=_doubt(readings))
        coverage = RecordCoverage(record, readings.summary, estimate.ellipsoid, estimate.rejected_beyond)
        return cls(estimate, readings, statistics, coverage, record)


def _doubt(readings: Readings) -> str:
    """Doubt whether readings are those of a magnetometer, in words; a long recording is judged by its first block."""
    recording = readings.recording
    first = recording if recording is None or isinstance(recording, Samples) else next(iter(recording.blocks()), None)
    if first is None or not first.nameless:
        return ""
    from flinders.readers._likeness import describe_doubt

    return describe_doubt(first)


def require_turned(readings: Readings, estimator: Estimator, unit: Unit | None) -> Readings:
    """Return the readings if the sensor was turned.

    Raises
    ------
    Unmoved
        If the sensor was hardly turned.
    """
    plane = getattr(estimator, "plane", "xy" if isinstance(estimator, Level) else None)
    how = "through all directions" if plane is None else f"all the way round in the plane {plane}"
    require_moved(readings.summary, (unit or UNKNOWN_UNIT).inside, how)
    return readings
