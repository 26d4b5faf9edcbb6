"""Conversions between a fit and an online calibration: a fit as its start, and its calibration in force as a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UsageError
from flinders.findings.catalogue import CALIBRATION_FINDINGS
from flinders.findings.rules import link_causes
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Evidence
from flinders.fitting.result import Fit, Judgement, Provenance
from flinders.fitting.verdict import judge_calibration
from flinders.heading.error_propagation import HeadingError

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.native.layouts import Records

METHOD: Final = "online"


def fit_of(
    calibration: Calibration,
    claimed: Records,
    *,
    noise: float,
    dip_deg: float,
    is_dip_assumed: bool,
    target_deg: float,
) -> Fit:
    """Fit that consists of the calibration in force and of the claim by the engine."""
    error = HeadingError(float(claimed["rms_deg"]), float(claimed["worst_deg"]), dip_deg)
    claim = Claim(
        calibration,
        np.array(claimed["covariance"]).reshape(9, 9),
        heading_error_deg=error,
        dip_deg=dip_deg,
        dip_assumed=is_dip_assumed,
        target_deg=target_deg,
    )
    findings = link_causes(
        judge_calibration(
            calibration,
            ("heading-error", *CALIBRATION_FINDINGS),
            target_deg=target_deg,
            values={"next_step": ("record-longer",)},
            level_worst_deg=error.worst,
        )
    )
    return Fit(calibration, Evidence(method=METHOD, noise=noise), claim, Judgement(findings), Provenance(METHOD))


def require_usable_start(start: Fit) -> None:
    """Raise `UsageError` for a fit with which an online calibration cannot start."""
    calibration = start.calibration
    why = (
        "is refused" if start.verdict == "refused"
        else "states no uncertainty" if not start.claim.states_uncertainty
        else "is of a level turn only" if start.claim.plane is not None
        else "follows a disturbance with a lag" if any(one.lag_s for one in calibration.disturbances)
        else "is linearized" if calibration.linearization is not None
        else "has a rotation from an aiding sensor" if calibration.rotation != "symmetric"
        else ""
    )  # fmt: skip
    if why:
        raise UsageError(
            f"{start.provenance.name} {why}: start with a calibration of the magnetometer alone, or without a "
            "calibration"
        )
