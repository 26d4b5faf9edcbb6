"""A fit in a notebook: words and numbers, the predicted error over the sphere, and the deviation.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> shown = html_of(calibrate.fit(simulate.tumble(seed=1).samples))
>>> shown.count("<img "), "<script" in shown
(1, False)
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

from flinders.core.notebook import SEVERITY_SIGNS, correction_html, text_html
from flinders.core.units import unit_label
from flinders.errors import count_text
from flinders.findings import advice, first_causes
from flinders.findings.row import verifiable_conditions
from flinders.fitting.claim import dip_words
from flinders.fitting.verdict import headline_of
from flinders.report import figures, maps
from flinders.report.charts import as_file, row_of_charts
from flinders.report.formatting import without_repeated_steps
from flinders.report.view import view_alone

if TYPE_CHECKING:
    from flinders.fitting.result import Fit

TURN_WIDTH, TURN_HEIGHT = 500.0, 292.0
"""Width and height of the figure of the deviation, which is next to the sphere."""


def html_of(fit: Fit) -> str:
    """HTML of a fit for a notebook; that of a refused fit contains no numbers of the calibration."""
    is_described = fit.evidence.is_described
    title = f"{SEVERITY_SIGNS[fit.verdict]} {fit.verdict}: "
    title += (
        f"{fit.evidence.method}, {count_text(fit.evidence.samples, 'reading')}" if is_described else "nothing is stated"
    )
    causes = without_repeated_steps(
        (finding for finding in first_causes(fit.findings) if finding.severity != "note"), fit
    )
    words = [f"{SEVERITY_SIGNS[finding.severity]} {advice(finding)} [{finding.code}]" for finding in causes]
    if fit.verdict == "refused":
        return text_html(title, [headline_of(fit).words, *words])
    calibration, claim = fit.calibration, fit.claim
    level = f"level, {dip_words(claim)}" if claim.states_uncertainty else ""
    return correction_html(
        calibration.matrix.tolist(),
        calibration.offset.tolist(),
        unit_label(calibration.unit),
        title=title,
        words=[headline_of(fit).words, *filter(None, [level, verifiable_conditions(fit.judgement.conditions)]), *words],
        offset_sigma=claim.offset_sigma.tolist() if claim.states_uncertainty else None,
        terms=None if calibration.linearization is None else calibration.linearization.as_dict(),
        pictures=_pictures(fit) if claim.states_uncertainty else "",
    )


def _pictures(fit: Fit) -> str:
    """Sphere and deviation of a fit with a stated uncertainty, as one image with its own styles."""
    view, target = view_alone(fit), fit.claim.target_deg
    sphere, turn = figures.ball(view, target), figures.deviation(view, target, wide=TURN_WIDTH, high=96.0)
    both = ((sphere, figures.SIDE, figures.SIDE), (turn, TURN_WIDTH, TURN_HEIGHT))
    title = "Predicted heading error in each direction, and deviation over the heading"
    content = base64.b64encode(as_file(row_of_charts(title, both), maps.tile_rules()).encode()).decode()
    least, *_, most, _ = (words for _, words in maps.error_legend(target))
    caption = f"Sphere: heading error to expect where the field points, from {least} (green) to {most} (red)"
    unseen = "" if all(view.tiles_seen) else "; hatched where no reading was taken"
    image = f'<img alt="{title}" style="max-width: 100%" src="data:image/svg+xml;base64,{content}">'
    return f"<div>{image}<br><small>{caption}{unseen}.</small></div>"
