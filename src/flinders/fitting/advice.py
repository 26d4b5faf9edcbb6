"""How to go on: which way to turn the sensor next, what would make the heading error smaller, which attitudes are good.

>>> from flinders import simulate
>>> from flinders.fitting.calibrate import fit
>>> attitudes(fit(simulate.tumble(seed=1).samples))
'within 1° at any attitude'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import figures
from flinders.findings.row import ANY_ANGLE_DEG
from flinders.fitting.result import TILTS
from flinders.heading.guidance import guide

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal, Guidance
    from flinders.summary.coverage import Coverage

WORTH_IT: Final = 0.05
"""Share of the error that a hundredth of the readings must save where they are advised for one attitude to be named."""

UPSIDE_DOWN: Final = 180.0


def attitudes(fit: Fit) -> str:
    """Say up to which tilt the heading is within the target, and how fast it degrades beyond."""
    limit, target = fit.claim.attitude_limit_deg, fit.claim.target_deg
    if limit >= UPSIDE_DOWN:
        return f"within {target:g}° at any attitude"
    beyond = [tilt for tilt in (*TILTS, UPSIDE_DOWN) if tilt > limit]
    tilted = fit.claim.tilted_error
    worse = [f"{angle(tilted(tilt).worst)} {_at(tilt)}" for tilt in dict.fromkeys((beyond[0], beyond[-1]))]
    if limit < 1.0:
        return f"good to {angle(fit.heading_error_deg.worst)} while level; tilted, {', '.join(worse)}"
    return f"within {target:g}° up to {limit:.0f}° of tilt; {', '.join(worse)}"


def _at(tilt: float) -> str:
    return "upside down" if tilt == UPSIDE_DOWN else f"at {tilt:g}°"


def remedy(fit: Fit) -> str:
    """Say what would make the heading error smaller."""
    if fit.claim.bias_deg > fit.claim.target_deg:
        if fit.claim.plane:
            return "the points are not equally spaced in heading, use the method 'ellipse'"
        return "the method's model does not fit this sensor, use 'auto'"
    repeats = fit.evidence.diagnosis.repeats
    if repeats is not None and repeats.scatter_deg > fit.claim.target_deg:
        return "the recordings contradict each other, use those made in the state of use"
    return movement(fit)


def movement(fit: Fit) -> str:
    """Say which way to turn the sensor next: where readings would tell most, or all round where none tells more."""
    if fit.claim.plane:
        return "turn it all the way round, more than once, keeping it level"
    advice = advised(fit)
    if advice.after_deg > (1.0 - WORTH_IT) * advice.worst_deg:
        return "record for longer while turning through all directions, away from iron and currents"
    return advice.words("sensor").replace("hold it", "hold the sensor", 1)


def advised(fit: Fit) -> Guidance:
    """Where the next readings would help most: a level heading while that is not good enough, then all attitudes."""
    return guided(fit, "heading" if fit.heading_error_deg.worst > fit.claim.target_deg else "attitude")


def guided(fit: Fit, goal: Goal) -> Guidance:
    """Where the next readings would help most, for one of the goals."""
    seen_from_below = fit.heading_error_deg.dip_deg * fit.claim.dip_deg < 0.0
    return guide(
        fit.calibration.ellipsoid,
        fit.claim.covariance,
        noise=fit.noise,
        coverage=fit.coverage,
        dip_deg=fit.claim.dip_deg,
        down=np.array([0.0, 0.0, -1.0]) if seen_from_below else None,
        goal=goal,
    )


def unseen_side(coverage: Coverage) -> str:
    """Name the side or corner of the sensor that lies in the middle of the largest gap.

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


def angle(degrees: float) -> str:
    """Write an error in degrees; beyond a right angle it says nothing.

    >>> angle(2.04), angle(120.0)
    ('2.0°', 'any angle')
    """
    return f"{figures(degrees)}°" if degrees < ANY_ANGLE_DEG else "any angle"
