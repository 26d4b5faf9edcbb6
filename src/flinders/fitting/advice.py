"""Advice after a fit: where to turn the sensor next, how to reduce the heading error, which attitudes are good.

>>> from flinders import simulate
>>> from flinders.fitting.calibrate import fit
>>> movement(fit(simulate.tumble(seed=1).samples))
'record for longer while turning through all directions, away from iron and currents'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.findings import limit_of, words
from flinders.findings.words import UPSIDE_DOWN
from flinders.fitting.claim import TILTS_DEG
from flinders.heading.guidance import guide

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal, Guidance
    from flinders.summary.coverage import Coverage

MIN_SAVED_SHARE: Final = 0.05
"""Smallest share of the error that 1 % more readings at an attitude must remove for advice to name this attitude."""

Step = tuple[str] | tuple[str, float]
"""Advised step: a name of `flinders.findings.words.STEPS`, and for some steps the number of a pose."""


def tilted_errors(fit: Fit, limit_deg: float) -> list[tuple[float, float]]:
    """Smallest and largest listed tilt above `limit_deg`, each with the worst heading error there, in degrees.

    Listed tilts are `TILTS_DEG` and upside down.
    """
    beyond = [tilt for tilt in (*TILTS_DEG, UPSIDE_DOWN) if tilt > limit_deg]
    return [(tilt, fit.claim.tilted_error(tilt).worst) for tilt in dict.fromkeys((*beyond[:1], *beyond[-1:]))]


def next_step(fit: Fit) -> Step:
    """Step that reduces the heading error most, by its name in `flinders.findings.words.STEPS`."""
    if fit.claim.bias_deg > fit.claim.target_deg:
        return ("use-ellipse",) if fit.claim.plane else ("use-auto",)
    if fit.evidence.diagnosis.repeats is not None and fit.evidence.diagnosis.repeats.scatter_deg > fit.claim.target_deg:
        return ("use-own-state",)
    textbook = fit.claim.textbook_heading_error_deg
    if fit.claim.plane or textbook is None:
        return next_movement(fit)
    is_correlated = words.is_of_correlation(fit.heading_error_deg.worst, textbook.worst, is_covered(fit))
    return ("record-longer",) if is_correlated else next_movement(fit)


def is_covered(fit: Fit) -> bool:
    """Whether readings cover the sphere: each direction is near a reading."""
    return fit.evidence.coverage.hole_deg <= limit_of("coverage")


def next_movement(fit: Fit) -> Step:
    """Next turn: to the attitude of the most informative readings, or through all directions if several are similar."""
    if fit.claim.plane:
        return ("turn-level",)
    advice = next_guidance(fit)
    if advice.after_deg > (1.0 - MIN_SAVED_SHARE) * advice.worst_deg:
        return ("record-longer",)
    return "hold", float(advice.pose_number("sensor"))


def remedy(fit: Fit) -> str:
    """Sentence on how to reduce the heading error."""
    return words.remedy(next_step(fit))


def movement(fit: Fit) -> str:
    """Sentence on which way to turn the sensor next."""
    return words.movement(next_movement(fit))


def next_guidance(fit: Fit) -> Guidance:
    """Guidance for level headings, or for all attitudes once the level heading error meets the target."""
    return guidance_for(fit, "heading" if fit.heading_error_deg.worst > fit.claim.target_deg else "attitude")


def guidance_for(fit: Fit, goal: Goal) -> Guidance:
    """Guidance to the attitude whose readings help most towards a goal."""
    seen_from_below = fit.heading_error_deg.dip_deg * fit.claim.dip_deg < 0.0
    return guide(
        fit.calibration.ellipsoid,
        fit.claim.covariance,
        noise=fit.evidence.noise,
        coverage=fit.evidence.coverage,
        dip_deg=fit.claim.dip_deg,
        down=np.array([0.0, 0.0, -1.0]) if seen_from_below else None,
        goal=goal,
    )


def unseen_side(coverage: Coverage) -> str:
    """Name the side or corner of the sensor in the middle of the largest gap between recorded directions.

    >>> from flinders.summary.coverage import Coverage
    >>> unseen_side(Coverage.of(np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 0.99]])))
    '−z side'
    """
    named = [
        ("+" if part > 0 else "−") + letter
        for letter, part in zip("xyz", coverage.hole, strict=True)
        if abs(part) > 0.4
    ]
    return f"{named[0]} side" if len(named) == 1 else f"corner between {' and '.join(named)}"
