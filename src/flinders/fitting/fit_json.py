"""JSON of a fit, as ``--json`` prints it.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fields = json_of(calibrate.fit(simulate.tumble(seed=1).samples))
>>> fields["verdict"], fields["samples"], fields["heading_error_deg"]["worst"] < 0.1
('good', 2922, True)
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import msgspec

from flinders.fitting.claim import TILTS_DEG
from flinders.fitting.good_until import good_until, recording_date
from flinders.fitting.result import finite_or_none, heading_record

if TYPE_CHECKING:
    from flinders.fitting.evidence import Disturbances
    from flinders.fitting.result import Fit
    from flinders.heading.error_propagation import DirectionError, HeadingError

_REFUSED: Final = ("calibration", "uncorrected_heading_error_deg")
"""Keys that are None for a refused fit."""

_ON_A_SURFACE: Final = (
    *_REFUSED, "heading_error_deg", "textbook_heading_error_deg", "tilted_heading_error_deg", "attitude_limit_deg",
    "direction_error_deg", "bias_deg", "coverage", "good_until",
)  # fmt: skip
"""Keys that are None for readings in one plane."""

_OF_THE_COVARIANCE: Final = (
    "tilted_heading_error_deg", "attitude_limit_deg", "direction_error_deg", "bias_deg", "covariance",
)  # fmt: skip
"""Keys that are None if no uncertainty is stated."""


def json_of(fit: Fit) -> dict[str, Any]:
    """A fit as numbers, lists and strings.

    Values of a refused fit that must not be used are None: the calibration, and values that follow from it; for
    readings in one plane also all values of the ellipsoid. The evidence is always included.
    """
    error, claim, evidence = heading_record(fit.claim), fit.claim, fit.evidence
    diagnosis, residuals = evidence.diagnosis, evidence.residuals
    fields = {
        "verdict": fit.verdict,
        "method": evidence.method,
        "calibration": fit.calibration.as_dict(),
        "heading_error_deg": None if error is None else msgspec.structs.asdict(error),
        # when `heading_error_deg` reaches the target and has doubled, as in the file; null where nothing is claimed
        "good_until": _good_until(fit),
        "uncorrected_heading_error_deg": _rms_and_worst(claim.uncorrected_heading_error_deg),
        "textbook_heading_error_deg": _rms_and_worst(claim.textbook_heading_error_deg),
        "alignment_error_deg": claim.alignment_error_deg,
        # worst heading error (1 σ) at a tilt of 10°, 30° and 90°
        "tilted_heading_error_deg": {f"{tilt:g}": claim.tilted_error(tilt).worst for tilt in TILTS_DEG},
        "attitude_limit_deg": claim.attitude_limit_deg,
        "direction_error_deg": _rms_and_worst(claim.direction_error_deg),
        "bias_deg": claim.bias_deg,
        "prior_influence": evidence.prior_influence,
        "unobserved": evidence.unobserved,
        "noise": finite_or_none(evidence.noise),
        "samples": evidence.samples,
        "independent_samples": min(residuals.independent_samples, float(evidence.samples)),
        "autocorrelation": residuals.autocorrelation,
        "outliers": [outlier.as_dict() for outlier in evidence.outliers],
        "distortion": residuals.distortion,
        "drift": None if diagnosis.drift is None else asdict(diagnosis.drift),
        "nonlinearity": None if diagnosis.nonlinearity is None else asdict(diagnosis.nonlinearity),
        "axis_lag": None if diagnosis.axis_lag is None else asdict(diagnosis.axis_lag),
        "conditions": list(fit.judgement.conditions),
        "repeats": None if diagnosis.repeats is None else diagnosis.repeats.as_dict(),
        "coverage": evidence.coverage.as_dict(),
        "covariance": claim.covariance.tolist(),
        **_disturbances_as_dict(evidence.disturbances),
        **({} if evidence.aiding is None else {"aiding": evidence.aiding.as_dict()}),
        **({} if diagnosis.refreshed is None else {"refreshed": diagnosis.refreshed.as_dict()}),
        "findings": [finding.as_dict() for finding in fit.findings],
    }
    untrusted = _ON_A_SURFACE if fit.judgement.is_flat else _REFUSED if fit.verdict == "refused" else ()
    unstated = () if claim.states_uncertainty else _OF_THE_COVARIANCE
    return {**fields, **dict.fromkeys((*untrusted, *unstated))}


def _good_until(fit: Fit) -> dict[str, Any] | None:
    """Times until the claim reaches the target and until it has doubled; None if nothing is claimed."""
    until = good_until(fit)
    return None if until is None else msgspec.to_builtins(until.to_record(recording_date(fit.provenance.record)))


def _disturbances_as_dict(disturbances: Disturbances) -> dict[str, Any]:
    """Estimates of the disturbances, JSON-ready; empty if the offset follows none."""
    if not disturbances.estimates:
        return {}
    return {
        "disturbances": [each.as_dict() for each in disturbances.estimates],
        "noise_uncompensated": disturbances.noise_uncompensated,
    }


def _rms_and_worst(error: HeadingError | DirectionError | None) -> dict[str, float] | None:
    """Rms and worst error, JSON-ready; None without an error."""
    return None if error is None else {"rms": error.rms, "worst": error.worst}
