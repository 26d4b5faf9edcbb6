"""Record of a fit for the engine's judgement, filled from an estimate.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.estimators.auto import Auto
>>> readings = Readings.of(simulate.tumble(seed=1, n=300).samples)
>>> record = record_of(Auto().estimate(readings), readings.summary.statistics)
>>> int(record["used"]), math.isnan(record["swap_gain"])
(300, True)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import MICROTESLA
from flinders.geometry.ellipsoid import upper_entries
from flinders.geometry.plane import PLANES
from flinders.heading.error_propagation import HeadingError
from flinders.native.engine import engine
from flinders.native.layouts import enum_value
from flinders.summary.coverage import CELL_CENTRES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.estimators import Estimate
    from flinders.estimators.base import Correlation
    from flinders.estimators.outliers import Outlier
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.evidence import Diagnosis
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane
    from flinders.native.layouts import Records
    from flinders.summary.coverage import Coverage
    from flinders.summary.quality import Rail
    from flinders.summary.summary import Statistics

AIDED, AIDED_BY_FIELD, AIDED_BY_ATTITUDE = (
    enum_value("AIDED"),
    enum_value("AIDED_BY_FIELD"),
    enum_value("AIDED_BY_ATTITUDE"),
)
COMPENSATED, REFRESHED = enum_value("COMPENSATED"), enum_value("REFRESHED")
"""Bits for sources of a fit other than the readings of one magnetometer."""

STATISTICS_FIELDS: Final = (
    "rows", "repeats", "distinct", "rests", "at_rest", "fitted", "fitted_repeats", "fitted_distinct", "step",
)  # fmt: skip
"""Fields of a record with the same names in `Statistics`."""

ASKS_HALVES, ASKS_SWAP = enum_value("ASKS_HALVES"), enum_value("ASKS_SWAP")
"""Bits of the further tests that a judgement requests."""

ROTATIONS: Final = {"symmetric": 0, "estimated": 2}
"""Numbers of the source of a calibration's rotation in ``flinders.h``; any other source is 1, measured."""

FIELD_SENSORS: Final = frozenset({"dip", "tilt", "attitude"})
"""Aiding sensors whose terms use the direction of the field, which iron nearby distorts."""

NUMBER_OF_PLANE: Final[dict[Plane | None, int]] = {None: 0} | {plane: place + 1 for place, plane in enumerate(PLANES)}


def record_of(
    estimate: Estimate, statistics: Statistics, coverage: Coverage | None = None, *, dip_deg: float = 60.0
) -> Records:
    """Record of an estimate, without level heading errors.

    Parameters
    ----------
    estimate : Estimate
        Estimate, with its covariance before widening.
    statistics : Statistics
        Statistics of the readings.
    coverage : Coverage, optional
        Coverage of the readings.
    dip_deg : float
        Inclination of the field at the site.
    """
    record = record_of_ellipsoid(estimate.ellipsoid, dip_deg=dip_deg)
    record["covariance"] = estimate.covariance.ravel()
    if estimate.textbook is not None:
        record["textbook"] = estimate.textbook.ravel()
    record["noise"] = estimate.noise
    record["prior_influence"], record["unobserved"] = estimate.prior_influence, estimate.unobserved
    record["used"] = estimate.used or statistics.fitted
    record["rejected"] = sum(run.independent for run in estimate.outliers)
    record["is_robust"] = bool(estimate.outliers)
    record["farthest"] = largest_outlier_distance(estimate.outliers)
    record["plane"] = NUMBER_OF_PLANE[estimate.plane]
    record["swaps"][0] = estimate.may_be_swapped
    if (strength := estimate.site_strength) is not None:
        record["site_strength"], record["strength_found"], record["strength_sigmas"] = strength
    _add_correlation(record, estimate.correlation)
    _add_statistics(record, statistics)
    if coverage is not None:
        record["coverage"], record["hole_deg"] = coverage.fraction, coverage.hole_deg
        record["upright"] = float(coverage.counts @ CELL_CENTRES[:, 2]) / max(coverage.readings, 1.0)
    return record


def largest_outlier_distance(outliers: Iterable[Outlier]) -> float:
    """Largest distance of an outlier from the ellipsoid, in the unit of the readings; NaN without outliers."""
    return max((run.max_distance for run in outliers), default=math.nan)


def record_of_ellipsoid(ellipsoid: Ellipsoid, *, dip_deg: float = 60.0) -> Records:
    """Record of an ellipsoid alone; all other fields are unknown."""
    record = engine().record()
    record["centre"], record["shape"], record["radius"] = (
        ellipsoid.centre,
        upper_entries(ellipsoid.shape),
        ellipsoid.radius,
    )
    record["dip_deg"] = dip_deg
    return record


def _add_correlation(record: Records, correlation: Correlation | None) -> None:
    """Add the correlation of residuals to a record."""
    record["is_white"] = correlation is None or correlation.is_white
    if correlation is None:
        return
    record["lag_one"], record["correlation_time"] = correlation.lag_one, correlation.time
    record["distortion"], record["excess_variance"] = correlation.direction, correlation.excess_variance
    record["noise_lasts"], record["steps_kurtosis"] = correlation.lasting, correlation.steps_kurtosis


def _add_statistics(record: Records, statistics: Statistics) -> None:
    """Add the statistics of the recording to a record."""
    for name in STATISTICS_FIELDS:
        record[name] = getattr(statistics, name)
    record["principal_variances"] = statistics.principal_variances
    record["lowest"], record["highest"] = 0.0, statistics.extent
    record["path_correlation"] = statistics.path_correlation
    for rail in statistics.rails:
        _add_rail(record, rail)
    clock = statistics.clock
    if clock.steps:
        record["start"], record["end"] = 0.0, clock.mean_step * max(statistics.rows - 1, 1)
        record["longest_step"], record["backward_steps"] = clock.longest_step, clock.backward_steps
    add_reading(record, statistics)


def add_reading(record: Records, statistics: Statistics) -> None:
    """Add to a record what the reader of the file reports: unusable rows, and doubts about the readings."""
    silent = sum(part.rows for part in statistics.skipped if part.is_silent)
    record["silent"] = silent
    record["skipped"] = sum(part.rows for part in statistics.skipped if part.is_loss and not part.is_silent)
    record["is_doubtful"] = bool(statistics.doubt)


def _add_rail(record: Records, rail: Rail) -> None:
    """Add to a record the end of an axis at which the sensor was saturated."""
    end = rail.axis + (3 if rail.end == "highest" else 0)
    record["rails"] |= 1 << end
    record["end_counts"][end] = round(rail.share * float(record["rows"]))


def add_diagnosis(record: Records, diagnosis: Diagnosis) -> None:
    """Add the results of diagnostics to a record."""
    drift, repeats, refreshed = diagnosis.drift, diagnosis.repeats, diagnosis.refreshed
    record["drift_deg"] = math.nan if drift is None else drift.heading_deg
    if drift is not None:
        record["drift_offset"], record["drift_by_chance"] = drift.offset, drift.p_value
        record["halves_apart"] = math.nan if drift.halves_ratio is None else drift.halves_ratio
    if repeats is not None:
        part = repeats.most_deviating
        record["apart_deg"], record["apart_sigma_deg"] = part.difference_deg, part.difference_sigma_deg
        record["apart_by_chance"] = part.p_value
    record["swap_gain"] = math.nan if diagnosis.axis_swap is None else diagnosis.axis_swap.gain
    record["unmodelled_deg"] = math.nan if diagnosis.unmodelled is None else diagnosis.unmodelled.heading_deg
    dependence = diagnosis.attitude_dependence
    record["attitude_dependent_deg"] = math.nan if dependence is None else dependence.heading_deg
    record["tilt_error_deg"] = diagnosis.tilt_error_deg
    if refreshed is not None:
        record["soft_iron_p_value"], record["distortion"] = refreshed.soft_iron_p_value, refreshed.distortion


def sources_of(aiding: Aiding | None, *, is_aided: bool, is_compensated: bool, is_refreshed: bool) -> int:
    """Bits for sources of a fit other than the readings of one magnetometer.

    `is_aided` states that other sensors contributed to the ellipsoid, `is_compensated` that disturbances were
    subtracted, `is_refreshed` that the shape is that of an earlier calibration.
    """
    kept = set() if aiding is None else {sensor.name for sensor in aiding.sensors if sensor.is_used}
    return (
        AIDED * is_aided
        | AIDED_BY_FIELD * bool(FIELD_SENSORS & kept)
        | AIDED_BY_ATTITUDE * (is_aided and "attitude" in kept)
        | COMPENSATED * is_compensated
        | REFRESHED * is_refreshed
    )


def judgement_request(calibration: Calibration, *, target_deg: float) -> Records:
    """Request for the judgement of a calibration whose estimate is not shrunk further."""
    return engine().request(
        target_deg=target_deg,
        field_strength=calibration.field_strength,
        is_strength_known=calibration.field_strength_known,
        is_microtesla=calibration.unit == MICROTESLA,
        is_mirrored=calibration.axes.is_mirror,
        rotation=ROTATIONS.get(calibration.rotation, 1),
        shrinks=0,
    )


def expected_error(
    ellipsoid: Ellipsoid, covariance: Floats, *, dip_deg: float, distortion: float = 0.0
) -> tuple[HeadingError, float]:
    """Heading error of a level vehicle, and the part of it that depends on the field's direction, in degrees.

    Parameters
    ----------
    ellipsoid : Ellipsoid
        Ellipsoid of the readings.
    covariance : (9, 9) float
        Claimed covariance of offset and shape, in the square of the unit.
    dip_deg : float
        Inclination of the field, with its sign in the sensor's axes.
    distortion : float
        Standard deviation of errors that depend on the direction, in the unit.
    """
    record = record_of_ellipsoid(ellipsoid, dip_deg=dip_deg)
    record["covariance"], record["distortion"], record["is_claimed"] = covariance.ravel(), distortion, True
    judgement = engine().judge(record, engine().request(shrinks=0))
    error = HeadingError(float(judgement["rms_deg"]), float(judgement["worst_deg"]), float(dip_deg))
    return error, float(judgement["structure_deg"])
