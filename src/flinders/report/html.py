"""A fit as one HTML file: the result first, in words and degrees, then the evidence.

The file is self-contained: no server, no network, and no script except that of the 3-D view, which is replaced by still
images on paper. Text from files, such as names and comments, is escaped. A Content-Security-Policy in the file permits
this script only, and no requests. A report of a refused fit contains no number that could be copied into firmware.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> samples = simulate.tumble(seed=1, n=400).samples
>>> text = page(calibrate.fit(samples), samples)
>>> text.startswith("<!doctype html>"), "://" in text.split("<script")[0]
(True, False)
>>> fit = calibrate.fit(samples)
>>> names = {"raw": samples.field}
>>> exec(python_of(fit.calibration), names)
>>> bool(np.allclose(names["corrected"], fit.calibration.apply(samples.field)))
True
"""

from __future__ import annotations

import base64
import math
from collections import defaultdict
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final, cast

import msgspec
import numpy as np

from flinders.core.calibration_file import ProvenanceRecord
from flinders.core.disturbance import is_column, kind_and_motor
from flinders.core.durations import duration_text
from flinders.core.language import in_english
from flinders.core.units import unit_label
from flinders.errors import FlindersError, count_text, figures
from flinders.findings.sensor_words import uncertain
from flinders.findings.words import UPSIDE_DOWN, as_sentence
from flinders.fitting.claim import dip_words
from flinders.fitting.export import export_fit
from flinders.fitting.good_until import good_until
from flinders.fitting.result import Fit, fit_of
from flinders.fitting.verdict import headline_of
from flinders.report import figures as drawing
from flinders.report import maps
from flinders.report.figure_data import FigureData
from flinders.report.formatting import (
    SOURCES,
    condition,
    curve_entries,
    date_of,
    degrees,
    length,
    matrix_entries,
    minus,
    offset_entries,
    sources,
    with_uncertainty,
    with_unit,
    without_repeated_steps,
)
from flinders.report.heading_figures import headings_over_time, history_words
from flinders.report.html_file import fill_template, html_file, script_of, style_of
from flinders.report.modules import join_modules
from flinders.report.onboard_pages import onboard_words
from flinders.report.view import matrix_sigma, tiles_view
from flinders.targets import registry
from flinders.targets._target import MOUNTING_KINDS
from flinders.verdicts import MEANINGS
from flinders.workflows.log_headings import heading_history

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.core.samples import Recording
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.errors import FitError
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Finding
    from flinders.fitting.aiding import Aiding
    from flinders.report.view import View
    from flinders.workflows.log_headings import HeadingHistory
    from flinders.workflows.onboard import OnboardCheck

MAX_RESIDUAL_SHARE, MAX_RESIDUAL_NOISES = 0.05, 3.0
"""Largest rms residuals with which readings still belong to a calibration: relative to the field, and to the noise."""

OPEN_TARGET: Final = "c"
"""Target whose listing comes first and is open."""


@dataclass(frozen=True, slots=True)
class Listing:
    """Text of a report that can be copied: a calibration for a program or a board."""

    title: str
    filename: str
    text: str
    notes: tuple[str, ...] = ()  # warnings to read before it is used


@in_english()
def page(
    outcome: Fit | FitError,
    recording: Recording | None = None,
    *,
    provenance: ProvenanceRecord | None = None,
    asked: Mapping[str, str] | None = None,
    listings: Sequence[Listing] = (),
    notes: Sequence[str] = (),
    onboard: OnboardCheck | None = None,
) -> str:
    """Write a fit, or the reason why there is none, as one HTML file.

    `InputError` is raised for a recording that cannot be read.

    Parameters
    ----------
    outcome : Fit or FitError
        The result, or the refusal.
    recording : Recording, optional
        The fitted readings, as recorded; all of them are read into memory. Without them there are no figures.
    provenance : ProvenanceRecord, optional
        Release, date and files; by default the current release, the current time, and no files.
    asked : mapping of str to str, optional
        Options of the fit, by name.
    listings : sequence of Listing
        The calibration for programs and boards, in the form of targets; omitted for a refused fit.
    notes : sequence of str
        Further remarks, in sentences.
    onboard : OnboardCheck, optional
        Onboard calibration of the log. Headings with it and with the fit are then drawn over the log.
    """
    fit = fit_of(outcome)
    usable = None if fit is None or fit.verdict == "refused" else fit
    drawn = None if recording is None else FigureData.of(fit, recording)
    walk = None if drawn is None or fit is None or not belongs_to(fit, drawn) else drawn.random_walk(fit)
    view = None if drawn is None else drawn.view
    script, has_scene = _script(has_view=view is not None)
    history = _history(recording, fit, onboard)
    given = {
        "outcome": _outcome(outcome, fit),
        "fit": fit,
        "findings": [] if fit is None else _findings(fit),
        "usable": usable,
        "upside_down": UPSIDE_DOWN,
        "until": None if usable is None else good_until(usable),
        "parameters": [] if usable is None else _parameters(usable),
        "terms": {} if usable is None else curve_entries(usable.calibration),
        "disturbances": [] if usable is None else disturbance_rows(usable),
        "listings": [] if usable is None else [_as_python(usable.calibration), *listings],
        "walk": walk,
        "walk_words": "" if walk is None or fit is None else _walk_words(walk, fit),
        "names": SOURCES,
        "notes": notes if onboard is None else [as_sentence(onboard_words(onboard)), *notes],
        "onboard": onboard,
        "history": history,
        "history_words": "" if history is None else history_words(history),
        "asked": asked or {},
        "provenance": provenance or ProvenanceRecord(flinders=version("flinders"), date=datetime.now(UTC), files=()),
        "source": "" if recording is None else recording.source,
        "drawn": drawn,
        "view": view,
        "figures": _figures(drawn, fit, walk) | _over_time(history, fit),
        "data": _data(drawn, view, fit) if drawn is not None and view is not None and has_scene else "",
        "has_scene": has_scene,
    }
    return html_file("report.html.j2", given, style=_style(), script=script, filters=FILTERS)


def _history(recording: Recording | None, fit: Fit | None, onboard: OnboardCheck | None) -> HeadingHistory | None:
    """Headings over the log with the onboard calibration and with the fit; None unless both exist."""
    if recording is None or fit is None or onboard is None:
        return None
    return heading_history(recording, onboard.calibration, fit.calibration)


def _over_time(history: HeadingHistory | None, fit: Fit | None) -> dict[str, str]:
    """The figure of headings over the log, by name; empty without headings."""
    if history is None or fit is None:
        return {}
    return {"headings": headings_over_time(history, fit.claim.target_deg)}


def listings_of(fit: Fit) -> list[Listing]:
    """The calibration for each target with a text file that can represent it; code first, mountings left out."""
    if fit.verdict == "refused":
        return []
    listings = []
    for name, target in sorted(registry().items(), key=lambda row: row[0] != OPEN_TARGET):
        if target.keeps in MOUNTING_KINDS:
            continue
        try:
            export, _ = export_fit(fit, target)
        except FlindersError:
            continue
        if export.data is None:
            listings.append(Listing(target.use, f"{name}{target.suffix}", export.text, tuple(export.warnings)))
    return listings


def belongs_to(fit: Fit, drawn: FigureData) -> bool:
    """Whether the lengths of the readings fit the calibration. If not, they may be those of another sensor."""
    if not len(drawn.residuals) or not drawn.is_used.any():
        return False
    off = drawn.residuals[drawn.is_used]
    noise = fit.evidence.noise if fit.claim.states_uncertainty else 0.0
    return math.sqrt(float(np.mean(off**2))) <= max(
        MAX_RESIDUAL_SHARE * fit.calibration.field_strength, MAX_RESIDUAL_NOISES * noise
    )


def _as_python(calibration: Calibration) -> Listing:
    return Listing("Python with NumPy", "correction.py", python_of(calibration))


def python_of(calibration: Calibration) -> str:
    """The correction as Python code with NumPy only: `raw`, as recorded, becomes `corrected`."""
    axes = calibration.axes.apply(np.eye(3)).T.astype(int).tolist()
    given = {"calibration": calibration, "axes": axes, "unit": unit_label(calibration.unit)}
    return fill_template("correction.py.j2", given, {"with_unit": with_unit}) + "\n"


# ------------------------------------------------------------------------------------------------------------- words


def _outcome(outcome: Fit | FitError, fit: Fit | None) -> dict[str, str]:
    """Verdict, title, and first sentence, for the template."""
    if fit is None:
        why = as_sentence(cast("FitError", outcome).message)
        return {"verdict": "refused", "title": "No calibration", "sentence": why}
    title = MEANINGS[fit.verdict].title if fit.claim.states_uncertainty else "Of unknown quality"
    said = " ".join(map(as_sentence, filter(None, (headline_of(fit).words, condition(fit)))))
    return {"verdict": fit.verdict, "title": title, "sentence": said}


def _findings(fit: Fit) -> list[tuple[Finding, str]]:
    """Findings with their sentences, the most severe first; advice that several share is given once, with the cause."""
    said = [
        (finding, finding.fault if finding.follows_from else finding.advice)
        for finding in without_repeated_steps(fit.findings, fit)
    ]
    return [(finding, as_sentence(words)) for finding, words in said]


def _walk_words(walk: RandomWalk, fit: Fit) -> str:
    """Words for the stability of the offset; with a claim, also for how long the stability is good enough."""
    is_claimed = fit.verdict != "refused" and fit.claim.states_uncertainty
    say, dip = walk.words if is_claimed else walk.story, abs(fit.heading_error_deg.dip_deg)
    return as_sentence(say(unit_label(fit.calibration.unit), level_deg=fit.claim.target_deg, dip_deg=dip))


def _parameters(fit: Fit) -> list[tuple[str, list[tuple[str, str]]]]:
    """Rows x, y and z with offset and matrix; each number is a value and an uncertainty."""
    sigma = matrix_sigma(fit) if fit.claim.states_uncertainty else None
    matrix = matrix_entries(fit.calibration.matrix, sigma)
    rows = zip("xyz", offset_entries(fit.calibration, fit.claim.offset_sigma), matrix, strict=True)
    return [(axis, [_split(number) for number in (offset, *row)]) for axis, offset, row in rows]


def _split(number: str) -> tuple[str, str]:
    """Value and uncertainty of a written number."""
    value, _, sigma = minus(number).partition(" ± ")
    return value, sigma


def disturbance_rows(fit: Fit) -> list[tuple[str, str, list[tuple[str, str]], str]]:
    """Rows for the disturbances of the offset: name, unit, change in x, y and z per unit, and words."""
    dip = fit.heading_error_deg.dip_deg
    estimates = fit.evidence.disturbances.estimates
    known = {estimate.name: estimate for estimate in estimates if estimate.disturbance is not None}
    motors = {one.name for one in fit.calibration.disturbances if kind_and_motor(one.name)[1]}
    rows = []
    for place, one in enumerate(fit.calibration.disturbances):
        removed_deg = fit.calibration.disturbance_deg(one, dip_deg=dip)
        has_others = one.name in motors and len(motors) > 1
        words = _disturbance_words(one, removed_deg, known.get(one.name), has_others=has_others)
        per = f"while {one.states[1]}" if one.states else f"per {one.kind.per}"
        unit = f"{unit_label(fit.calibration.unit)} {per}"
        title = one.name if is_column(one.name) else one.name.capitalize()
        rows.append((title, unit, _disturbance_offsets(fit, one, place), words))
    return rows


def _disturbance_offsets(fit: Fit, disturbance: Disturbance, place: int) -> list[tuple[str, str]]:
    """Value and uncertainty along each axis; an unknown uncertainty is empty."""
    values = disturbance.per_unit.tolist()
    covariance = fit.evidence.disturbances.covariance
    if covariance is None:
        return [_split(f"{value:.4g}") for value in values]
    first = 9 + 3 * place
    sigma = np.sqrt(np.diag(covariance)[first : first + 3]).tolist()
    return [_split(with_uncertainty(*pair)) for pair in zip(values, sigma, strict=True)]


def _disturbance_words(
    disturbance: Disturbance, removed_deg: float, estimate: DisturbanceEstimate | None, *, has_others: bool
) -> str:
    """Words for a disturbance: range, effect on headings with and without correction, reference, lag and gain."""
    amount, left = disturbance.text_of, ""
    if estimate is not None:
        running = " and the other motors run along as they did then" if has_others else ""
        left = f", of which {degrees(estimate.remaining_deg)} (1 σ) is left after correction{running}"
    states, low, end = disturbance.states, disturbance.lowest, disturbance.extreme_value
    recorded = " and ".join(states) if states else f"from {low:.3g} to {amount(disturbance.highest)}"
    where = f"{'while' if states else 'at'} {amount(end)}"
    parts = [f"recorded {recorded}", f"{where} it moves headings by up to {degrees(removed_deg)}{left}"]
    if estimate is not None and is_column(disturbance.name):
        share = uncertain(100.0 * estimate.explained_share, 100.0 * estimate.explained_share_sigma)
        parts.append(f"it explains {share} % of the scatter that readings have without it")
    if disturbance.reference:
        parts.append(f"the offset in the table below holds at {amount(disturbance.reference)}")
    if disturbance.lag_s:
        side = "later" if disturbance.lag_s > 0 else "earlier"
        parts.append(f"readings follow {abs(disturbance.lag_s):.2g} s {side}")
    if disturbance.gain_per_unit:
        parts.append(f"the scale grows by {figures(100.0 * disturbance.gain_per_unit)} % per °C")
    return minus(f"{'; '.join(parts)}.")


def instrument_rows(aiding: Aiding) -> list[tuple[str, str]]:
    """Rows for biases and delays of the aiding sensors: name, and number with uncertainty."""
    known = (
        ("Dip of the field", aiding.dip_deg, aiding.dip_sigma_deg, 1.0, "°"),
        ("Bias of the gyro, °/s", aiding.gyro_bias, aiding.gyro_bias_sigma, math.degrees(1.0), ""),
        ("Bias of the accelerometer, m/s²", aiding.acceleration_bias, aiding.acceleration_bias_sigma, 1.0, ""),
        ("Magnetometer behind the gyro", aiding.delay_s, aiding.delay_sigma_s, 1e3, " ms"),
    )
    return [
        (name, minus(f"{', '.join(with_uncertainty(*pair) for pair in _pairs(value, sigma, factor))}{unit}"))
        for name, value, sigma, factor, unit in known
        if value is not None
    ]


def _pairs(value: ArrayLike, sigma: ArrayLike | None, factor: float) -> list[tuple[float, float]]:
    """One or several numbers in another unit, each with its uncertainty."""
    pairs = np.broadcast_arrays(np.ravel(value), 0.0 if sigma is None else sigma)
    return [(float(number), float(its)) for number, its in factor * np.transpose(pairs)]


# -------------------------------------------------------------------------------------------------------- figures


def _figures(drawn: FigureData | None, fit: Fit | None, walk: RandomWalk | None) -> defaultdict[str, Any]:
    """Figures by name, with numbers and fixed words only; a figure without data is None."""
    drawings: defaultdict[str, Any] = defaultdict(lambda: None)
    if drawn is None or not len(drawn.raw):
        return drawings
    view, target = drawn.view, 1.0 if fit is None else fit.claim.target_deg
    drawings["before"] = drawing.projections(drawn, is_corrected=False)
    drawings["pictures"] = drawing.pictures(drawn, target)
    if view is None or view.shown is None:
        return drawings
    drawings |= {
        "after": drawing.projections(drawn, is_corrected=True),
        "error_map": maps.error_map(view, target),
        "error_legend": maps.error_legend(target),
        "coverage_map": maps.coverage_map(view),
        "seen_legend": maps.seen_legend(view),
        "residuals": drawing.residuals(drawn),
        "histogram": view.residuals and drawing.histogram(view, drawn.unit),
        "deviation": view.turn and drawing.deviation(view, target),
        "offset_over_time": walk and drawing.offset_over_time(walk, drawn.unit, drawn.plane),
    }
    if fit is not None and fit.verdict != "refused":
        drawings["correlation"] = drawing.correlation(fit) if fit.claim.states_uncertainty else None
        drawings["compensated"] = [drawing.compensation_chart(drawn, one) for one in fit.calibration.disturbances]
    return drawings


def _data(drawn: FigureData, view: View, fit: Fit | None) -> str:
    """Data of the 3-D view as JSON for a page, without the character ``<``."""
    content = msgspec.structs.asdict(view) | {
        "tiles": tiles_view(),
        "field": base64.b64encode(drawn.raw.astype("<f4").tobytes()).decode(),
        "stride": drawn.stride,
        "target_deg": 1.0 if fit is None else fit.claim.target_deg,
    }
    return msgspec.json.encode(content).decode().replace("<", "\\u003c")


def _script(*, has_view: bool) -> tuple[str, bool]:
    """The script of the page, and whether it includes the 3-D view."""
    if has_view:
        try:
            return f"\n{join_modules()}\n", True
        except FileNotFoundError:  # installed without the bundle
            pass
    return f"{script_of()}m0.copying();\n", False


def _style() -> str:
    """The style sheet, with the colours of the maps."""
    return style_of() + maps.page_tile_rules()


FILTERS: Final = {
    "counted": count_text, "figures": figures, "degrees": degrees, "sentence": as_sentence,
    "instruments": instrument_rows, "label": unit_label, "strength": length, "date": date_of, "minus": minus,
    "sources": sources, "dip_words": dip_words, "duration": duration_text,
}  # fmt: skip
"""Formats of numbers in the template."""
