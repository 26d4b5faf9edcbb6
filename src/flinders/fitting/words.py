"""What is claimed of a calibration, in words that every page and message shares."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flinders.errors import figures
from flinders.findings.words import ANY_ANGLE_DEG

if TYPE_CHECKING:
    from flinders.fitting.claim import Claim
    from flinders.fitting.result import Fit


def heading_words(claim: Claim) -> str:
    """The worst heading error, 1 σ, and its bound, as ``0.32° (95 % within 0.71°)``."""
    bound_deg = claim.heading_bound_deg
    bound = f"95 % within {figures(bound_deg)}°" if bound_deg < ANY_ANGLE_DEG else "1 σ"
    return f"{figures(claim.heading_error_deg.worst)}° ({bound})"


def dip_words(claim: Claim) -> str:
    """Dip that headings are judged at, with the sign that the recording shows, as ``dip 60° (assumed)``."""
    return f"dip {claim.known_dip_deg:.3g}°{' (assumed)' if claim.dip_assumed else ''}"


def tilt_words(fit: Fit) -> str:
    """Up to which tilt a fit that rests on a level turn is within its target; nothing for any other."""
    limit = next((finding.number for finding in fit.findings if finding.code == "level-plane"), None)
    if limit is None:
        return ""
    if not limit >= 1.0:
        return "it rests on a level turn: for a level vehicle only"
    within = "its target" if math.isnan(fit.heading_error_deg.worst) else f"{fit.claim.target_deg:g}°"
    return f"it rests on a level turn: within {within} up to {limit:.0f}° of tilt"
