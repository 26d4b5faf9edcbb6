"""A fleet as one HTML file: what to do first, then how good its compasses are, and what was refused and why.

The file needs nothing else: no server, no network, and no script but that of the button for light and dark. Tables are
sorted by choosing one of several orders, which a browser does without a script. What comes from files is escaped, and a
Content-Security-Policy lets nothing run but the page's own script. Its size does not grow with the fleet.

>>> when(1.7e9), when(float("nan"))
('2023-11-14', '–')
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

from flinders.core.units import label
from flinders.errors import counted, figures, percent
from flinders.findings import CATALOGUE, action
from flinders.report import fleet_figures as drawing
from flinders.report.fleet_view import STATES, SUMS_ALONE
from flinders.report.formatting import as_sentence, date_of, degrees
from flinders.report.html_file import html_file, style_of
from flinders.report.script import joined

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.report.fleet_view import BatchDrift, FleetDrift, Histogram, Overview, UnitDrift

START: Final = "m0.theming(() => {});"
VERDICTS: Final = {
    "good": "good",
    "limited": "good with limits",
    "refused": "refused: no calibration",
    "failed": "failed: could not be read",
}
SHOWN: Final = 4
"""Findings of a unit that are named; the others are counted."""
FAIR: Final = 0.02
"""Share of recordings without a calibration up to which a fleet is called good."""


def page(overview: Overview, drift: FleetDrift | None = None, *, notes: Sequence[str] = ()) -> str:
    """Write a fleet as one HTML file.

    Parameters
    ----------
    overview : Overview
        Of the table.
    drift : FleetDrift, optional
        How its units changed.
    notes : sequence of str
        What else to know, in sentences.
    """
    given = {
        "overview": overview,
        "drift": drift,
        "notes": [*notes, *_notes(overview), *([] if drift is None else map(as_sentence, about_order(drift)))],
        "outcome": _outcome(overview, drift),
        "numbers": _numbers(overview, drift),
        "units": None if drift is None else _orders(drift),
        "steps": () if drift is None else drift.steps,
        "states": [] if drift is None else [(name, drift.states[name], words) for name, words in STATES.items()],
        "figures": _figures(overview, drift),
        "verdicts": [(name, overview.verdicts.get(name, 0), words) for name, words in VERDICTS.items()],
        "most_findings": SHOWN,
        "worst": [(rank, units) for rank, units in overview.worst.items() if units],
        "findings": [(code, count, _meaning(code), action(code)) for code, count in overview.findings.items()],
        "codes": [(code, *example, action(code)) for code, example in overview.codes.items()],
        "held_against": "" if drift is None else drift.against,
        "odd_states": [] if drift is None else _odd(drift)[:10],
        "shown_batches": len(drawing.shown_batches(overview.batches)),
        "odd_batches": sorted(drawing.standing_out(overview.batches)),
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    script = f"\n{joined('plain.js')}\n{START}\n"
    return html_file("fleet.html.j2", given, style=style_of("fleet.css"), script=script, filters=FILTERS)


def when(seconds: float) -> str:
    """Write the day of a time since 1970; a dash where none is known."""
    if not math.isfinite(seconds):
        return "–"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d}"


def chance(p_value: float) -> str:
    """How often chance makes as much.

    >>> chance(3e-20), chance(0.0312), chance(2.5e-6)
    ('< 1e-12', '0.031', '2.5e-06')
    """
    return "< 1e-12" if p_value < 1e-12 else f"{p_value:.2g}"


# ------------------------------------------------------------------------------------------------------------- words


def _outcome(overview: Overview, drift: FleetDrift | None) -> dict[str, str]:
    """What matters most, in a title and a sentence."""
    if drift is None:
        return _calibrated(overview)
    urgent = drift.states["recalibrate"]
    moved = f" {counted(drift.step_units, 'unit')} had something moved near the sensor." if drift.step_units else ""
    title = f"{counted(urgent, 'unit')} to recalibrate" if urgent else "None to recalibrate"
    return {
        "verdict": "limited" if urgent or drift.states["unordered"] else "good",
        "what": f"Compass drift of {counted(drift.units, 'unit')}",
        "title": title,
        "sentence": f"Of these the heading changed by more than {drift.target_deg:g}°, which chance does not explain."
        f"{moved}"
        if urgent
        else f"No heading is known to have changed by more than {drift.target_deg:g}°.{moved}",
    }


def _calibrated(overview: Overview) -> dict[str, str]:
    """How many gave a calibration, why the others did not, and how good these are."""
    refused, failed = (overview.verdicts.get(name, 0) for name in ("refused", "failed"))
    given = overview.rows - refused - failed
    lost = [f"{refused:,} {'was' if refused == 1 else 'were'} refused"] if refused else []
    lost += [f"{failed:,} could not be read"] if failed else []
    said = (
        f"{given:,} of {counted(overview.rows, 'recording')} gave a calibration{'; ' * bool(lost)}{' and '.join(lost)}"
    )
    median = overview.heading_deg.quantile(0.5)
    typical = f" Half of the calibrations are good to {degrees(median)} of heading or better."
    return {
        "verdict": "good" if given >= (1.0 - FAIR) * overview.rows > 0 else "limited" if given else "refused",
        "what": "Compasses of a fleet",
        "title": f"{percent(given, overview.rows)} calibrated",
        "sentence": f"{said}.{typical * math.isfinite(median)}",
    }


def _notes(overview: Overview) -> list[str]:
    """What lies over the whole fleet."""
    summed = overview.methods.get("consistent", 0)
    return [f"{counted(summed, 'recording')} fitted from sums alone: {SUMS_ALONE}."] if summed else []


def about_order(drift: FleetDrift) -> list[str]:
    """Say of which units no dates or no order are known, and what was counted once; a sentence each."""
    remarks = []
    if drift.undated.units:
        remarks.append(
            f"no dates are known of {counted(drift.undated.units, 'unit')}: recordings are taken in the order of their "
            "names, nothing is told by the day, and a step may be drift over a long time"
        )
    if count := drift.states["unordered"]:
        some = ", ".join(drift.unordered[:5]) + (" and others" if count > 5 else "")
        remarks.append(
            f"the order of recordings is not known of {counted(count, 'unit')} ({some}): nothing is told of them; put "
            "dates into the names of recordings"
        )
    if drift.passed_over:
        remarks.append(
            f"{counted(drift.passed_over, 'row')} passed over: the same recordings stand in a table named later, or "
            "further down, and count once"
        )
    return remarks


def _numbers(overview: Overview, drift: FleetDrift | None) -> list[tuple[str, str, str]]:
    """What stands in large figures: name, number, what it is."""
    good, refused, failed = (overview.verdicts.get(name, 0) for name in ("good", "refused", "failed"))
    rows = [
        ("Units", f"{overview.units:,}", counted(overview.rows, "recording")),
        ("Good", percent(good, overview.rows), counted(good, "recording")),
    ]
    above = overview.heading_deg.share_above(overview.target_deg)
    beyond = percent(above, 1.0) if above else "none"
    better = f"half of the calibrations are better; {beyond} above {overview.target_deg:g}°"
    errors = _median("Worst heading off by", overview.heading_deg, better)
    if drift is None:
        why = f"{refused:,} refused, {failed:,} could not be read" if refused or failed else "all gave one"
        return [*rows, ("No calibration", f"{refused + failed:,}", why), *errors]
    return [
        *rows,
        *errors,
        ("To recalibrate", f"{drift.states['recalibrate']:,}", f"changed by more than {drift.target_deg:g}°"),
        ("Moved in a step", f"{drift.step_units:,}", f"{counted(drift.step_count, 'step')} in {drift.gaps:,} gaps"),
        *_median(
            "Heading changed by",
            drift.change_deg,
            "median, at the worst heading; the uncertainty of both recordings is in it",
        ),
    ]


def _median(name: str, counts: Histogram, words: str) -> list[tuple[str, str, str]]:
    """A large figure of what was counted; none of nothing."""
    return [(name, degrees(counts.quantile(0.5)), words)] if counts.total else []


def _orders(drift: FleetDrift) -> list[tuple[str, list[UnitDrift]]]:
    """The listed units in each order that they can be seen in."""
    listed = list(drift.listed)
    return [
        ("urgency", listed),
        ("change", sorted(listed, key=lambda one: -one.worst_deg)),
        ("sureness", sorted(listed, key=lambda one: -one.worst_deg / max(one.sigma_deg, 1e-12))),
        ("name", sorted(listed, key=lambda one: one.unit)),
    ]


def _odd(drift: FleetDrift) -> list[BatchDrift]:
    """Batches that stand out by how their units changed."""
    return [one for one in drift.batches if {"changes", "steps"} & set(one.stands_out)]


def _meaning(code: str) -> str:
    """What a finding says, without its number."""
    return CATALOGUE[code].number if code in CATALOGUE else ""


def _figures(overview: Overview, drift: FleetDrift | None) -> dict[str, Any]:
    """Figures by name: numbers and words of our own, and names escaped."""
    shown: dict[str, Any] = {
        "verdicts": drawing.bar(overview.verdicts),
        "batches": drawing.batch_map(overview.batches) if overview.batches else None,
        "change": None,
        "batch_states": None,
        "distributions": _distributions(overview),
    }
    if drift is not None and drift.batches:
        states = {one.batch: one.states for one in drift.batches}
        odd = {one.batch for one in _odd(drift)}
        kinds = ("steady", "single", "none", "unordered", "unsure", "changed", "recalibrate")
        shown["batch_states"] = drawing.batch_map(states, kinds, kinds[:-2], odd)
    if drift is not None and drift.change_deg.total:
        shown["change"] = drawing.distribution(drift.change_deg, "degrees", target=drift.target_deg)
    return shown


def _distributions(overview: Overview) -> list[tuple[str, str, str]]:
    """Title, words and figure of each number that a fleet has a distribution of."""
    fields = [(f"Field strength, {label(unit)}", counts, label(unit), "") for unit, counts in overview.field.items()]
    listed = [
        ("Offset", overview.offset, "length, in field strengths", ""),
        ("Noise", overview.noise, "% of the field", "%"),
        *fields,
    ]
    worst, target = overview.heading_deg, overview.target_deg
    heading = (
        "Worst heading error",
        drawing.quantile_words(worst, "°"),
        drawing.distribution(worst, "degrees, 1 σ", target=target),
    )
    return [heading] * bool(worst.total) + [
        (
            title,
            drawing.quantile_words(counts, unit),
            drawing.distribution(counts, words, factor=100.0 if unit else 1.0),
        )
        for title, counts, words, unit in listed
        if counts.total
    ]


def _share(value: float) -> str:
    """Write a share as a percentage; a dash where none is known."""
    return "–" if not math.isfinite(value) else f"{value:.1%}" if value < 1.0 else f"{value:.1f} ×"


FILTERS: Final = {
    "counted": counted, "figures": figures, "degrees": degrees, "day": when, "share": _share, "label": label,
    "chance": chance, "percent": percent,
}  # fmt: skip
"""How the page writes numbers."""
