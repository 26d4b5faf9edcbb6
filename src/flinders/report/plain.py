r"""A fit as a page of plain words, for whoever sails, drives or flies with the compass: text that any e-mail carries.

It says how good the calibration is, how far off the compass was and will be, for which attitudes that holds, what is
not known and why, what to do next, and the numbers to copy. Of a refusal it says why and how to move, and shows no
numbers. The words are in ``templates/plain.txt.j2``.

>>> print(_paragraph("It is\n short."), _item("One."), sep="")
It is short.
- One.
<BLANKLINE>
"""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.findings import REFUSALS, limit_of
from flinders.findings.words import UPSIDE_DOWN, as_sentence
from flinders.fitting.advice import unseen_side
from flinders.fitting.claim import TILTS
from flinders.fitting.result import Fit, fit_of
from flinders.fitting.verdict import improves
from flinders.report.formatting import (
    aging,
    aligned,
    date_of,
    degrees,
    length,
    matrix_entries,
    mounting,
    offset_entries,
    on_the_point,
    shown_findings,
    uncorrected,
)
from flinders.report.html_file import filled

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.errors import FitError, FlindersError

WIDTH: Final = 78
"""Columns: two less than the terminal's 80, so that an e-mail can be quoted."""

RUNS: Final = 8
"""Runs of outliers that are listed."""


def page(outcome: Fit | FitError, provenance: ProvenanceRecord) -> str:
    """Write a fit, or why there is none, in plain words, with release, date and recordings."""
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
    return filled("plain.txt.j2", given, FILTERS)


def _of_fit(fit: Fit) -> dict[str, Any]:
    """Numbers to copy, and what the words on heading and attitudes need."""
    offsets = on_the_point(offset_entries(fit.calibration, fit.claim.offset_sigma))
    rows = aligned(*matrix_entries(fit.calibration.matrix))
    is_whole = bool(fit.claim.plane) or fit.evidence.coverage.hole_deg <= limit_of("coverage")
    return {
        "aging": aging(fit),
        "offset": math.hypot(*fit.calibration.offset),
        "offsets": [(axis, value.rstrip()) for axis, value in zip("xyz", offsets, strict=True)],
        "matrix": [(axis, "   ".join(row)) for axis, row in zip("xyz", rows, strict=True)],
        "mounting": mounting(fit).replace(" (1 σ)", ""),
        "improves": improves(fit),
        "uncorrected": uncorrected(fit),
        "upside_down": UPSIDE_DOWN,
        "tilt": next((tilt for tilt in TILTS if tilt > fit.claim.attitude_limit_deg), UPSIDE_DOWN),
        "side": "" if is_whole else unseen_side(fit.evidence.coverage),
    }


def _of_findings(fit: Fit) -> tuple[list[str], list[str]]:
    """What limits a fit, and what to do about each finding, each thing once."""
    said = shown_findings(fit)
    remedies = dict.fromkeys(finding.remedy for finding in said)
    return [finding.plain_words for finding in said], [what for what in remedies if what]


def _of_no_fit(error: FitError) -> tuple[list[str], list[str]]:
    """Why there is no fit, and what to do."""
    words, what = error_words(error)
    return [words], [what] if what else []


def error_words(error: FlindersError) -> tuple[str, str]:
    """Why there is no fit, and what to do, in plain words; its message where there are none, and nothing to do."""
    refusal = REFUSALS.get(error.code)
    if refusal is None or not refusal.plain:
        return error.message, ""
    return refusal.plain.format(**error.evidence), refusal.remedy


def _read(outcome: Fit | FitError, fit: Fit | None, provenance: ProvenanceRecord) -> list[str]:
    """The recordings, and what of them was left out."""
    items = [f"{file.name}: {counted(file.rows, 'reading')}." for file in provenance.files]
    if fit and fit.evidence.outliers:
        runs = [str(outlier) for outlier in fit.evidence.outliers]
        more = f"; and {counted(len(runs) - RUNS, 'more run')}" if len(runs) > RUNS else ""
        items.append(f"Left out, as they do not belong to the rest: {'; '.join(runs[:RUNS])}{more}.")
    findings = fit.findings if fit else ()
    items += [as_sentence(finding.advice) for finding in findings if finding.code in ("no-answer", "skipped-rows")]
    return [*items, *(f"Left out: {entry}." for entry in getattr(outcome, "skipped", ()))]


def _paragraph(text: str, first: str = "", other: str = "") -> str:
    """Write text in lines, the first and the others with an indent."""
    wrapper = textwrap.TextWrapper(WIDTH, first, other, break_long_words=False, break_on_hyphens=False)
    return f"{wrapper.fill(' '.join(text.split()))}\n"


def _item(text: str) -> str:
    """Write a sentence of a list, with a dash."""
    return _paragraph(text, "- ", "  ")


FILTERS: Final[Mapping[str, Callable[..., Any]]] = {
    "paragraph": _paragraph, "item": _item, "sentence": as_sentence, "date": date_of, "label": label,
    "strength": length, "figures": figures, "degrees": degrees,
}  # fmt: skip
"""How the page writes words and numbers."""
