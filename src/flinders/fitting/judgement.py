"""Judgement of an estimate: the engine judges its record, and the result is a `Fit`.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1, n=500, motion="uniform").samples)
>>> fit.claim.alignment_error_deg is None, round(with_mounting_error(fit, 0.5).claim.alignment_error_deg, 2)
(True, 1.0)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.fitting.claim import Claim
from flinders.fitting.diagnosis import diagnose, run_requested_tests
from flinders.fitting.evidence import Diagnosis, Disturbances, Evidence, Residuals
from flinders.fitting.record import add_diagnosis, add_reading, judgement_request, largest_outlier_distance, sources_of
from flinders.fitting.result import Fit, Judgement, Refused
from flinders.fitting.verdict import judged_quantities, with_findings
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import HeadingError, alignment_error_deg, level_error
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.estimators import Estimate
    from flinders.estimators.disturbance import DisturbanceFit
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.fitting.estimated import Estimated
    from flinders.fitting.request import Request
    from flinders.fitting.widening import Widened
    from flinders.native.layouts import Records


def require_accepted(result: Fit) -> Fit:
    """Return the fit unless its verdict is ``refused``.

    Raises
    ------
    Refused
        With the fit, if a finding refuses it.
    """
    if any(finding.severity == "refuses" for finding in result.findings):
        raise Refused(result)
    return result


def with_mounting_error(result: Fit, sigma_deg: float | None) -> Fit:
    """Add the heading error of the mounting, if its uncertainty is stated, in degrees."""
    if sigma_deg is None:
        return result
    error = alignment_error_deg(sigma_deg, dip_deg=result.heading_error_deg.dip_deg)
    return replace(result, claim=replace(result.claim, alignment_error_deg=error))


def _bias_deg(estimate: Estimate, dip_deg: float) -> float:
    """Heading error (rms, in degrees) from the bias of a method."""
    if estimate.bias is None:
        return 0.0
    bias, down = np.outer(estimate.bias, estimate.bias), down_direction(estimate.plane)
    return level_error(estimate.ellipsoid, bias, dip_deg=dip_deg, down=down).rms


def judge(widened: Widened, found: Estimated, calibration: Calibration, request: Request) -> Fit:
    """Judge an estimate; returns the fit with claim, evidence and findings."""
    record = widened.record
    estimate = found.estimate if record["is_shrunk"] > 0 else widened.estimate
    diagnosis = diagnose(widened, estimate, found, calibration)
    diagnosis, judgement = _judgement(diagnosis, record, estimate, found, calibration, request)
    if found.disturbed is not None:
        calibration = replace(calibration, disturbances=found.disturbed.disturbances)
    claim = _claim(widened, judgement, calibration, request)
    evidence = Evidence(
        method=estimate.method,
        samples=int(record["used"]),
        noise=estimate.noise,
        coverage=found.coverage,
        outliers=estimate.outliers,
        residuals=_residuals(record, estimate, judgement),
        prior_influence=estimate.prior_influence,
        unobserved=estimate.unobserved,
        z_down=estimate.z_down,
        diagnosis=diagnosis,
        disturbances=_disturbances(claim, found.disturbed, found.unused),
        aiding=found.aiding,
    )
    return with_findings(Fit(calibration, evidence, claim, Judgement()), judgement, found.statistics)


def _claim(widened: Widened, judgement: Records, calibration: Calibration, request: Request) -> Claim:
    """Claim of a calibration, from the engine's record and judgement."""
    record, estimate = widened.record, widened.estimate
    alignment_deg = float(record["alignment_deg"])
    return Claim(
        calibration,
        estimate.covariance,
        estimate.textbook,
        HeadingError(float(judgement["rms_deg"]), float(judgement["worst_deg"]), float(record["dip_deg"])),
        structure_deg=float(judgement["structure_deg"]),
        dip_deg=request.dip_deg,
        dip_assumed=request.dip_assumed,
        target_deg=request.target_deg,
        alignment_error_deg=None if math.isnan(alignment_deg) else alignment_deg,
        bias_deg=float(record["bias_deg"]),
        is_shrunk=bool(record["is_shrunk"] > 0),
        plane=estimate.plane,
    )


def _residuals(record: Records, estimate: Estimate, judgement: Records) -> Residuals:
    """Statistics of the residuals of an estimate."""
    distortion = 0.0 if estimate.plane or math.isnan(record["distortion"]) else float(record["distortion"])
    if estimate.correlation is None:
        return Residuals(distortion=distortion)
    return Residuals(judged_quantities(judgement)["independent"], estimate.correlation.lag_one, distortion)


def _judgement(
    diagnosis: Diagnosis,
    record: Records,
    estimate: Estimate,
    found: Estimated,
    calibration: Calibration,
    request: Request,
) -> tuple[Diagnosis, Records]:
    """Judge a record with its diagnosis; if the judgement requests further tests, run them and judge again."""
    asked = judgement_request(calibration, target_deg=request.target_deg)
    aiding, dip_deg = found.aiding, float(record["dip_deg"])
    alignment_deg = None if aiding is None else aiding.alignment_error_deg(dip_deg)
    record["alignment_deg"] = math.nan if alignment_deg is None else alignment_deg
    record["bias_deg"] = _bias_deg(estimate, dip_deg)
    record["sources"] = sources_of(
        aiding,
        is_aided=estimate.is_aided,
        is_compensated=found.disturbed is not None,
        is_refreshed=found.refreshed is not None,
    )
    if found.record is not None:
        add_reading(record, found.statistics)
        record["farthest"] = largest_outlier_distance(estimate.outliers)
    add_diagnosis(record, diagnosis)
    judgement = engine().judge(record, asked)
    closer = run_requested_tests(int(judgement["asks"]), diagnosis, estimate, found, request)
    if closer is diagnosis:
        return diagnosis, judgement
    add_diagnosis(record, closer)
    return closer, engine().judge(record, asked)


def _disturbances(
    claim: Claim, disturbed: DisturbanceFit | None, unused: tuple[DisturbanceEstimate, ...]
) -> Disturbances:
    """Disturbances of a calibration, with their heading errors before and after compensation."""
    if disturbed is None:
        return Disturbances(unused)
    from flinders.estimators.regressors import DisturbanceEstimate

    dip, down, ellipsoid = claim.heading_error_deg.dip_deg, down_direction(claim.plane), claim.ellipsoid
    estimates = [
        replace(
            estimate,
            removed_deg=claim.calibration.disturbance_deg(disturbance, dip_deg=dip),
            remaining_deg=disturbed.remaining_error(ellipsoid, place, dip_deg=dip, down=down).worst,
        )
        for place, (disturbance, estimate) in enumerate(zip(disturbed.disturbances, disturbed.estimates, strict=True))
    ]
    constant = [DisturbanceEstimate(name) for name in disturbed.constant]
    return Disturbances(
        (*estimates, *constant, *unused), disturbed.joint_covariance(claim.covariance), disturbed.noise_without
    )
