"""A calibration from a file, and a recording, as the fit that they would be: what a report of both is made from.

Nothing is fitted: the numbers, what is claimed of them and the findings are those of the file; what is seen of
directions is that of the recording.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.fitting.result import Fit
>>> samples = simulate.tumble(seed=1).samples
>>> fit = calibrate.fit(samples)
>>> again = restored(Fit.from_document(fit.to_document()), samples)
>>> again.verdict, abs(again.heading_error_deg.worst - fit.heading_error_deg.worst) < 1e-9
('good', True)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.comparison import Strength
from flinders.findings import Finding, by_severity
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import level_error
from flinders.summary.cloud import Cloud
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit

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


def restored(fit: Fit, recording: Recording, *, target_deg: float | None = None, dip_deg: float | None = None) -> Fit:
    """Put a calibration and a recording together.

    Parameters
    ----------
    fit : Fit
        Loaded from its file. Where it states no uncertainty, so does the result, with a finding that says so.
    recording : Recording
        In the unit and axes of the calibration.
    target_deg, dip_deg : float, optional
        As asked for; by default those of the file, else 1° and 60°. Where the dip is another one, the heading error is
        computed anew from the covariance.
    """
    seen = _seen(fit, recording)
    stated_dip = fit.heading_error_deg.dip_deg if math.isfinite(fit.heading_error_deg.dip_deg) else fit.dip_deg
    dip = stated_dip if dip_deg is None else math.copysign(dip_deg, dip_deg * _sign(stated_dip))
    expected = level_error(fit.ellipsoid, fit.covariance, dip_deg=dip, down=down_of(fit.plane))
    findings = list(fit.findings)
    if not fit.states_uncertainty:
        findings.append(Finding("no-uncertainty", "limits", math.nan, math.nan, STATES_NOTHING))
    together = replace(
        fit,
        noise=_noise(fit.calibration, recording) if math.isnan(fit.noise) else fit.noise,
        samples=fit.samples if fit.is_described else int(seen.readings),
        coverage=seen,
        heading_error_deg=expected,
        target_deg=target_deg or fit.target_deg,
        dip_deg=abs(dip) if dip_deg is None else dip_deg,
        disturbances_covariance=None,
        aiding=None,
        findings=by_severity(findings),
    )
    return replace(together, heading_error_deg=expected.beside(together.structure_deg))


def doubts(calibration: Calibration, recording: Recording) -> list[str]:
    """What is odd about the pair, in sentences."""
    lengths = sum((Strength.under(calibration, block.field) for block in recording.blocks()), Strength())
    least, most, spread = UNEVEN
    if least <= lengths.mean <= most and lengths.spread <= spread:
        return []
    return [ODD_STRENGTH.format(mean=lengths.mean, spread=lengths.spread)]


def _seen(fit: Fit, recording: Recording) -> Coverage:
    """Directions of the recording under the calibration, counted as those of a fit are."""
    cloud = sum((Cloud.of(block.field) for block in recording.blocks()), Cloud.empty())
    if not len(cloud.counts):
        return Coverage.of(np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
    return Coverage.through(cloud, fit.ellipsoid)


def _noise(calibration: Calibration, recording: Recording) -> float:
    """Root of the mean square distance from the sphere."""
    off: list[Floats] = [
        np.linalg.norm(calibration.at().apply(block.field), axis=1) - calibration.field_strength
        for block in recording.blocks()
    ]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2))) if off else 0.0


def _sign(angle: float) -> float:
    return -1.0 if angle < 0.0 else 1.0
