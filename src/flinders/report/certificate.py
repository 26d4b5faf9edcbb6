"""The certificate of a swing as one HTML file: how the compass keeps its limit, its card, and fields to sign.

>>> from flinders.heading.deviation import fit
>>> swing = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> text = certificate(swing, step_deg=45.0)
>>> text.startswith("<!doctype html>"), text.count("<tr>"), "Signature" in text
(True, 15, True)
"""

from __future__ import annotations

import base64
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.geometry.angles import shown_heading
from flinders.heading.deviation import NAMES
from flinders.report.drawings import swing_drawing
from flinders.report.formatting import as_sentence, minus, with_uncertainty
from flinders.report.html_file import html_file, script_of, style_of
from flinders.report.swing_pages import MEANINGS, conformity_words, limit_words, sided, swing_words

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flinders.core.geomag import SiteField
    from flinders.heading.compensation import Compensation
    from flinders.heading.deviation import Conformity, Deviation
    from flinders.heading.standards import Standard

FIELDS: Final = ("Place and date", "Swung by, licence", "Reference of headings", "Next swing due", "Signature")
"""What is filled in by hand."""

TITLES: Final = {"within": "Within the limit", "open": "Not shown to be within the limit", "beyond": "Beyond the limit"}
COLOURS: Final = {"within": "good", "open": "limited", "beyond": "refused"}


def certificate(
    deviation: Deviation,
    *,
    step_deg: float,
    rule: Standard | None = None,
    conformity: Conformity | None = None,
    before: Compensation | None = None,
    site: SiteField | None = None,
    reasons: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
) -> str:
    """Write a swing as a certificate.

    Parameters
    ----------
    deviation : Deviation
        The curve, the error of the base in its uncertainty.
    step_deg : float
        Between the lines of the card.
    rule : Standard, optional
        By which the compass was swung.
    conformity : Conformity, optional
        How the curve keeps the limit.
    before : Compensation, optional
        Coefficients before the compass was compensated.
    site : SiteField, optional
        Where the declination comes from.
    reasons : sequence of str
        What limits the curve.
    facts : mapping of str to str, optional
        What else to tell, such as vehicle and compass.
    """
    drawing = base64.b64encode(swing_drawing(deviation).encode()).decode()
    given = {
        "outcome": _outcome(deviation, conformity, reasons),
        "what": "Compass swing",
        "numbers": (),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "release": version("flinders"),
        "facts": {**(facts or {}), **_rule_facts(rule, conformity), **({"Declination": str(site)} if site else {})},
        "reasons": [as_sentence(reason) for reason in reasons],
        "coefficients": list(_coefficients(deviation, before)),
        "has_before": before is not None,
        "card": list(_card(deviation, step_deg)),
        "drawing": f"data:image/svg+xml;base64,{drawing}",
        "fields": FIELDS,
    }
    return html_file("certificate.html.j2", given, style=style_of("certificate.css"), script=script_of(), filters={})


def _outcome(deviation: Deviation, conformity: Conformity | None, reasons: Sequence[str]) -> dict[str, str]:
    """The verdict: that of the limit, and of the curve where that is limited."""
    words = as_sentence(swing_words(deviation) if conformity is None else conformity_words(conformity))
    if conformity is not None and (conformity.verdict != "within" or not reasons):
        return {"verdict": COLOURS[conformity.verdict], "title": TITLES[conformity.verdict], "sentence": words}
    title = "Deviation of a compass" if conformity is None else TITLES["within"]
    return {"verdict": "limited" if reasons else "good", "title": title, "sentence": words}


def _rule_facts(rule: Standard | None, conformity: Conformity | None) -> dict[str, str]:
    """Rule, limit, and what was seen of the rule."""
    limit = {} if conformity is None else {"Limit": f"{conformity.limit_deg:g}° on any heading"}
    if rule is None:
        return limit
    return {"Rule": rule.title, **(limit or {"Limit": limit_words(rule)}), "Seen of the rule": "; ".join(rule.sources)}


def _coefficients(deviation: Deviation, before: Compensation | None) -> Iterator[tuple[str, ...]]:
    """Name, value before, value now and meaning of each coefficient."""
    earlier = [] if before is None else [before.a_deg, before.b_deg, before.c_deg]
    sigmas = deviation.sigmas_deg
    for place, (name, value) in enumerate(zip(NAMES, deviation.coefficients_deg.tolist(), strict=True)):
        old = minus(f"{earlier[place]:+.1f}°") if place < len(earlier) else ""
        now = f"{value:+.2f}" if sigmas is None else with_uncertainty(value, max(float(sigmas[place]), 0.005))
        yield name, old, f"{minus(now)}°", MEANINGS[place]


def _card(deviation: Deviation, step_deg: float) -> Iterator[dict[str, Any]]:
    """Lines of the card: for a magnetic heading the one to steer; by compass the deviation with its 1 σ."""
    headings, values, sigmas = deviation.card(step_deg)
    steer = deviation.compass(headings) if deviation.is_one_to_one else np.full(len(headings), np.nan)
    for place, heading in enumerate(headings.tolist()):
        yield {
            "heading": shown_heading(heading),
            "steer": shown_heading(float(steer[place])),
            "deviation": sided(float(values[place])),
            "sigma": "" if sigmas is None else f"± {max(float(sigmas[place]), 0.01):.2f}°",
        }
