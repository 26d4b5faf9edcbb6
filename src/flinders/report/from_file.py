"""A calibration from a file, and a recording, as the fit that they would be: what a report of both is made from.

Nothing is fitted: the numbers, what is claimed of them and the findings are those of the file; what is seen of
directions is that of the recording.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.fitting.judged import Judged
>>> samples = simulate.tumble(seed=1).samples
>>> fit = calibrate.fit(samples)
>>> again = restored(Judged.from_fit(fit), samples)
>>> again.verdict, abs(again.heading_error_deg.worst - fit.heading_error_deg.worst) < 1e-9
('good', True)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.comparison.comparison import Strength
from flinders.findings import Finding, by_severity
from flinders.fitting.result import Fit
from flinders.fitting.verdict import Z_ELSEWHERE, Z_OPEN
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import level_error
from flinders.summary.cloud import Cloud
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.calibration_file import FindingRecord
    from flinders.core.samples import Recording
    from flinders.findings import Severity
    from flinders.fitting.judged import Judged
    from flinders.heading.error_propagation import HeadingError

DIP_DEG: Final = 60.0
TARGET_DEG: Final = 1.0
"""Where the file does not say."""

UNEVEN: Final = (0.97, 1.03, 0.05)
"""Least and most of a mean strength, and a spread, beyond which a recording and a calibration are said not to match."""

ODD_STRENGTH: Final = (
    "Under this calibration the readings are {mean:.3f} times as long as its field, with a spread of {spread:.1%}: it "
    "may be that of another sensor, or something has changed since. flinders check tells more."
)

STATES_NOTHING: Final = (
    "the calibration file states no uncertainty, as one does that was imported: how good headings are is not known. "
    "Calibrate from a recording to know it"
)


def restored(
    judged: Judged, recording: Recording, *, target_deg: float | None = None, dip_deg: float | None = None
) -> Fit:
    """Put a calibration and a recording together.

    Parameters
    ----------
    judged : Judged
        Without a covariance the fit has one of zeros, which claims nothing, and a finding that says so.
    recording : Recording
        In the unit and axes of the calibration.
    target_deg, dip_deg : float, optional
        As asked for; by default those of the file, else 1° and 60°. Where the dip is another one, the heading error is
        computed anew from the covariance.
    """
    ellipsoid, record = judged.ellipsoid, judged.record
    seen = _seen(judged, recording)
    error = record.heading_error_deg if record is not None else None
    stated_dip = error.dip_deg if error is not None and error.dip_deg is not None else DIP_DEG
    dip = stated_dip if dip_deg is None else math.copysign(dip_deg, dip_deg * _sign(stated_dip))
    target = target_deg or (error.target_deg if error is not None and error.target_deg else TARGET_DEG)
    covariance = np.zeros((9, 9)) if judged.covariance is None else judged.covariance
    plane = None if record is None else record.plane
    down = down_of(plane)
    expected = level_error(ellipsoid, covariance, dip_deg=dip, down=down)
    distortion = 0.0
    if error is not None and judged.covariance is not None:
        at_stated = level_error(ellipsoid, covariance, dip_deg=stated_dip, down=down)
        distortion = _distortion(error.worst, at_stated, ellipsoid.radius)
        expected = expected.beside(math.degrees(distortion / (ellipsoid.radius * math.cos(math.radians(dip)))))
    findings = [_finding(finding) for finding in (() if record is None else record.findings)]
    if judged.covariance is None:
        findings.append(Finding("no-uncertainty", "limits", math.nan, math.nan, STATES_NOTHING))
    noise = record.noise if record is not None and record.noise is not None else _noise(judged, recording)
    return Fit(
        calibration=judged.calibration,
        method="not stated" if record is None else record.method,
        covariance=covariance,
        noise=noise,
        samples=int(seen.readings) if record is None else record.samples,
        coverage=seen,
        heading_error_deg=expected,
        target_deg=target,
        dip_deg=abs(dip) if dip_deg is None else dip_deg,
        distortion=distortion,
        plane=plane,
        z_down=_z_down(findings),
        findings=by_severity(findings),
    )


def doubts(judged: Judged, recording: Recording) -> list[str]:
    """What is odd about the pair, in sentences."""
    found = sum((Strength.under(judged.calibration, block.field) for block in recording.blocks()), Strength())
    least, most, spread = UNEVEN
    if least <= found.mean <= most and found.spread <= spread:
        return []
    return [ODD_STRENGTH.format(mean=found.mean, spread=found.spread)]


def _seen(judged: Judged, recording: Recording) -> Coverage:
    """Directions of the recording under the calibration, counted as those of a fit are."""
    cloud = sum((Cloud.of(block.field) for block in recording.blocks()), Cloud.empty())
    if not len(cloud.counts):
        return Coverage.of(np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
    return Coverage.through(cloud, judged.ellipsoid)


def _noise(judged: Judged, recording: Recording) -> float:
    """Root of the mean square distance from the sphere."""
    calibration = judged.calibration
    off: list[Floats] = [
        np.linalg.norm(calibration.at().apply(block.field), axis=1) - calibration.field_strength
        for block in recording.blocks()
    ]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2))) if off else 0.0


def _distortion(worst_deg: float, expected: HeadingError, radius: float) -> float:
    """What belongs to the direction, which a file does not state: what its heading error has beside the covariance."""
    left = worst_deg**2 - expected.worst**2
    if left <= (1e-6 * worst_deg) ** 2:
        return 0.0
    return math.radians(math.sqrt(left)) * radius * math.cos(math.radians(expected.dip_deg))


def _z_down(findings: Iterable[Finding]) -> bool | None:
    """What was known of z at a level turn, which stands in the file in words."""
    words = " ".join(finding.advice for finding in findings)
    return None if Z_OPEN in words else Z_ELSEWHERE not in words


def _sign(angle: float) -> float:
    return -1.0 if angle < 0.0 else 1.0


def _finding(record: FindingRecord) -> Finding:
    number, limit = (math.nan if value is None else value for value in (record.number, record.limit))
    severity = record.severity if record.severity in ("note", "limits", "refuses") else "note"
    return Finding(record.code, cast("Severity", severity), number, limit, record.advice)
