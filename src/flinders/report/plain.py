r"""A fit as a page in plain words for the user of the compass, as text for any e-mail.

The page states how good the calibration is, the heading errors before and after, and the attitudes for which these
hold. It also states what is unknown or faulty and why, the next steps, and the numbers to copy. For a refused fit it
states the reasons and the movement, and no numbers. The words are in ``templates/plain.txt.j2``.

>>> print(_paragraph("It is\n short."), _item("One."), sep="")
It is short.
- One.
<BLANKLINE>
"""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.core.language import in_english
from flinders.core.units import unit_label
from flinders.errors import count_text, figures
from flinders.findings import REFUSALS, limit_of
from flinders.findings.words import UPSIDE_DOWN, as_sentence
from flinders.fitting.advice import unseen_side
from flinders.fitting.claim import TILTS_DEG
from flinders.fitting.result import Fit, fit_of
from flinders.fitting.verdict import is_improvement
from flinders.report.formatting import (
    aging,
    align_columns,
    align_points,
    date_of,
    degrees,
    length,
    matrix_entries,
    mounting,
    offset_entries,
    shown_findings,
    uncorrected_error_words,
)
from flinders.report.html_file import fill_template

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.errors import FitError, FlindersError

WIDTH: Final = 78
"""Line width in characters: two less than the terminal's 80, so that an e-mail can be quoted."""

MAX_RUNS: Final = 8
"""Largest number of outlier runs in the list."""


@in_english()
def page(outcome: Fit | FitError, provenance: ProvenanceRecord) -> str:
    """Write a fit, or the reason why there is none, in plain words, with release, date and recordings."""
    fit = fit_of(outcome)
    why, remedies = _of_no_fit(cast("FitError", outcome)) if fit is None else _of_findings(fit)
    given = {
        "fit": fit,
        "provenance": provenance,
        "is_usable": isinstance(outcome, Fit),
        "why": why,
        "remedies": remedies,
        "read": _read(outcome, fit, provenance),
        **(_of_fit(outcome) if isinstance(outcome, Fit) else {}),
    }
    return fill_template("plain.txt.j2", given, FILTERS)


def _of_fit(fit: Fit) -> dict[str, Any]:
    """Numbers to copy, and values for the words about heading and attitudes."""
    offsets = align_points(offset_entries(fit.calibration, fit.claim.offset_sigma))
    rows = align_columns(*matrix_entries(fit.calibration.matrix))
    is_whole = bool(fit.claim.plane) or fit.evidence.coverage.hole_deg <= limit_of("coverage")
    return {
        "aging": aging(fit),
        "offset": math.hypot(*fit.calibration.offset),
        "offsets": [(axis, value.rstrip()) for axis, value in zip("xyz", offsets, strict=True)],
        "matrix": [(axis, "   ".join(row)) for axis, row in zip("xyz", rows, strict=True)],
        "mounting": mounting(fit).replace(" (1 σ)", ""),
        "improves": is_improvement(fit),
        "uncorrected": uncorrected_error_words(fit),
        "upside_down": UPSIDE_DOWN,
        "tilt": next((tilt for tilt in TILTS_DEG if tilt > fit.claim.attitude_limit_deg), UPSIDE_DOWN),
        "side": "" if is_whole else unseen_side(fit.evidence.coverage),
    }


def _of_findings(fit: Fit) -> tuple[list[str], list[str]]:
    """Limits of a fit, and the remedies, each just once."""
    said = shown_findings(fit)
    remedies = dict.fromkeys(finding.remedy for finding in said)
    return [finding.plain_words for finding in said], [what for what in remedies if what]


def _of_no_fit(error: FitError) -> tuple[list[str], list[str]]:
    """Reasons why there is no fit, and remedies."""
    words, what = error_words(error)
    return [words], [what] if what else []


def error_words(error: FlindersError) -> tuple[str, str]:
    """Reason and remedy of an error in plain words; for an error that has none, its message and no remedy."""
    refusal = REFUSALS.get(error.code)
    if refusal is None or not refusal.plain:
        return error.message, ""
    return refusal.plain.format(**error.evidence), refusal.remedy


def _read(outcome: Fit | FitError, fit: Fit | None, provenance: ProvenanceRecord) -> list[str]:
    """Lines about the recordings, and about the readings that were left out."""
    items = [f"{file.name}: {count_text(file.rows, 'reading')}." for file in provenance.files]
    if fit and fit.evidence.outliers:
        runs = [str(outlier) for outlier in fit.evidence.outliers]
        more = f"; and {count_text(len(runs) - MAX_RUNS, 'more run')}" if len(runs) > MAX_RUNS else ""
        items.append(f"Left out as outliers: {'; '.join(runs[:MAX_RUNS])}{more}.")
    findings = fit.findings if fit else ()
    items += [as_sentence(finding.advice) for finding in findings if finding.code in ("no-answer", "skipped-rows")]
    return [*items, *(f"Left out: {entry}." for entry in getattr(outcome, "skipped", ()))]


def _paragraph(text: str, first: str = "", other: str = "") -> str:
    """Break text into lines, with one indent for the first line and another for the others."""
    wrapper = textwrap.TextWrapper(WIDTH, first, other, break_long_words=False, break_on_hyphens=False)
    return f"{wrapper.fill(' '.join(text.split()))}\n"


def _item(text: str) -> str:
    """Format a sentence as an item of a list, with a dash."""
    return _paragraph(text, "- ", "  ")


FILTERS: Final[Mapping[str, Callable[..., Any]]] = {
    "paragraph": _paragraph, "item": _item, "sentence": as_sentence, "date": date_of, "label": unit_label,
    "strength": length, "figures": figures, "degrees": degrees,
}  # fmt: skip
"""Formats of words and numbers in the page."""
