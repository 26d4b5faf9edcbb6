"""Report of a fleet as one HTML file: actions first, then the quality of the compasses, and refusals with reasons.

The file is complete: it needs no server and no network, and its only script is that of the button for light and dark.
The user sorts tables by choosing one of several prepared orders, without a script. Texts from files are escaped, and a
Content-Security-Policy allows only the page's own script. The size of the file does not grow with the fleet.

>>> from flinders.apps.fleet.overview import Histogram
>>> whole = Histogram.over(0.01, 100.0, 40).with_numbers([0.2, 0.3, 5.0])
>>> figure = distribution(whole, "degrees", target=1.0)
>>> figure.startswith("<svg"), "style=" in figure
(True, False)
"""

from __future__ import annotations

import itertools
import math
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.overview import STATES, count_bad, outlying_batches
from flinders.core.units import unit_label
from flinders.errors import count_text, figures, percent
from flinders.findings import CATALOGUE, action
from flinders.findings.row import TUMBLE_CONDITIONS
from flinders.findings.words import as_sentence
from flinders.report.charts import Axis, Plot, chart, segment, text
from flinders.report.formatting import date_of, degrees
from flinders.report.html_file import html_file, script_of, style_of

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from flinders.apps.fleet.overview import BatchDrift, FleetDrift, Histogram, Overview, UnitDrift, UnitStep
    from flinders.apps.fleet.walks import UnitWalk

# ----------------------------------------------------------------------------------------------------------- the page

VERDICTS: Final = {
    "good": "good",
    "limited": "good with limits",
    "refused": "refused: no calibration",
    "failed": "failed: could not be read",
}
CHANGES: Final = ("steady", "single", "none", "unordered", "unsure", "changed", "recalibrate")
"""States of units in the order in which a bar shows them; the last two are changes."""
MAX_FINDINGS: Final = 4
"""Largest number of findings that are named for a unit; further ones are counted."""
FAIR_SHARE: Final = 0.02
"""Largest share of recordings that are not good in a fleet that is called good."""


def page(overview: Overview, drift: FleetDrift | None = None) -> str:
    """The report as one HTML file, with the drift of units if it is known."""
    given = {
        "overview": overview,
        "drift": drift,
        "notes": [] if drift is None else [as_sentence(words) for words in order_notes(drift)],
        "fair": FAIR_SHARE,
        "units": None if drift is None else _orders(drift),
        "unit_of_units": "" if drift is None else common_unit(drift.listed),
        "unit_of_steps": "" if drift is None else common_unit(drift.steps),
        "states": STATES,
        "figures": _figures(overview, drift),
        "verdicts": VERDICTS,
        "condition": TUMBLE_CONDITIONS,
        "changes": CHANGES,
        "most_findings": MAX_FINDINGS,
        "catalogue": CATALOGUE,
        "odd_states": [] if drift is None else _odd_batches(drift)[:10],
        "odd_batches": sorted(outlying_batches(overview.batches)),
        "groups": [
            (name, batch_rows(counts, ("good",), odd := outlying_batches(counts)), sorted(odd))
            for name, counts in overview.groups.items()
        ],
        "bad": count_bad(overview.verdicts),
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    style = style_of("apps/fleet/fleet.css")
    return html_file("apps/fleet/fleet.html.j2", given, style=style, script=script_of(), filters=FILTERS)


def format_day(seconds: float) -> str:
    """Day of a time since 1970; a dash for NaN."""
    if not math.isfinite(seconds):
        return "–"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d}"


def chance(p_value: float) -> str:
    """Format a p value.

    >>> chance(3e-20), chance(0.0312), chance(2.5e-6)
    ('< 1e-12', '0.031', '2.5e-06')
    """
    return "< 1e-12" if p_value < 1e-12 else f"{p_value:.2g}"


# ------------------------------------------------------------------------------------------------------------- words


def common_unit(rows: Sequence[UnitDrift | UnitStep | UnitWalk]) -> str:
    """The common unit of field of all rows, for the heading of a table; empty if units differ."""
    units = {unit_label(row.unit_of_field) for row in rows}
    return units.pop() if len(units) == 1 else ""


def order_notes(drift: FleetDrift) -> list[str]:
    """Sentences about units without dates or without an order, and about duplicate rows."""
    remarks = []
    if drift.undated.units:
        remarks.append(
            f"no dates are known of {count_text(drift.undated.units, 'unit')}: recordings are ordered by name, drift "
            "is given per recording, and a step may be drift over a long time"
        )
    if count := drift.states["unordered"]:
        some = ", ".join(drift.unordered[:5]) + (" and others" if count > 5 else "")
        remarks.append(
            f"the order of recordings is not known of {count_text(count, 'unit')} ({some}), which are not compared: "
            "put dates into the names of recordings"
        )
    if drift.duplicates:
        remarks.append(
            f"{count_text(drift.duplicates, 'row')} skipped: their recordings also stand in a later table, or further "
            "down, and count once"
        )
    return remarks


def _orders(drift: FleetDrift) -> list[tuple[str, list[UnitDrift]]]:
    """Orders in which the page offers the listed units: the name of each order, and the units."""
    listed = list(drift.listed)
    return [
        ("urgency", listed),
        ("change", sorted(listed, key=lambda one: -one.worst_deg)),
        ("sureness", sorted(listed, key=lambda one: -one.worst_deg / max(one.sigma_deg, 1e-12))),
        ("name", sorted(listed, key=lambda one: one.unit)),
    ]


def _odd_batches(drift: FleetDrift) -> list[BatchDrift]:
    """Batches that stand out by changes or steps of their units."""
    return [one for one in drift.batches if {"changes", "steps"} & set(one.stands_out)]


def _figures(overview: Overview, drift: FleetDrift | None) -> dict[str, Any]:
    """Figures, and rows of the maps of batches, by name; None for a figure without data."""
    shown: dict[str, Any] = {
        "batches": batch_rows(overview.batches, ("good",), outlying_batches(overview.batches)),
        "change": None,
        "batch_states": None,
        "distributions": _distributions(overview),
    }
    if drift is not None and drift.batches:
        states = {one.batch: one.states for one in drift.batches}
        shown["batch_states"] = batch_rows(states, CHANGES[:-2], {one.batch for one in _odd_batches(drift)})
    if drift is not None and drift.change_deg.total:
        shown["change"] = distribution(drift.change_deg, "degrees", target=drift.target_deg)
    return shown


def _distributions(overview: Overview) -> list[tuple[str, str, str]]:
    """Title, summary and figure of each histogram of an overview."""
    fields = [
        (f"Field strength, {unit_label(unit)}", counts, unit_label(unit), "", None)
        for unit, counts in overview.field.items()
    ]
    listed = [
        ("Worst heading error", overview.heading_deg, "degrees, 1 σ", "°", overview.target_deg),
        ("Offset", overview.offset, "length, in field strengths", "", None),
        ("Noise", overview.noise, "% of the field", " %", None),
        *fields,
    ]
    return [
        (title, quantile_words(counts, unit), distribution(counts, words, target=target, factor=_factor(unit)))
        for title, counts, words, unit, target in listed
        if counts.total
    ]


def _factor(unit: str) -> float:
    """Factor from a value of a histogram to the shown number: 100 for per cent."""
    return 100.0 if unit == " %" else 1.0


def _share(value: float) -> str:
    """Format a share as a percentage; a dash for NaN."""
    return "–" if not math.isfinite(value) else f"{value:.1%}" if value < 1.0 else f"{value:.1f} ×"


# -------------------------------------------------------------------------------------------------------------- figures

WIDTH, HEIGHT = 400, 190
MAX_BATCHES: Final = 240
"""Largest number of batches on the map; those with the largest share without a good verdict are shown."""
MIN_SHARE: Final = 0.004
"""Smallest share of a bar that is drawn, so that a single failure of a million is visible."""


def distribution(histogram: Histogram, words: str, *, target: float | None = None, factor: float = 1.0) -> str:
    """Drawing of a histogram on a logarithmic axis, with its median, and bars above the target in another colour.

    `words` stand below the axis; its numbers are the counted ones times `factor`.
    """
    low, high = _ends(histogram)
    edges, counts = histogram.edges[low : high + 1], histogram.counts[low:high]
    plot = Plot(16, 22, WIDTH - 28, 124, Axis(edges[0], edges[-1], np.log), Axis(0.0, max(counts, default=1) or 1))
    is_above = [target is not None and first * last > target**2 for first, last in itertools.pairwise(edges)]
    parts = [plot.columns(_decades(edges[0], edges[-1], factor), gap=27)]
    for kind, is_kind in (("bar", False), ("bar above", True)):
        here = [count if above == is_kind else 0 for count, above in zip(counts, is_above, strict=True)]
        parts.append(plot.bars(kind, edges, here, least=0.8))
    parts.append(plot.level(0.0, "zero"))
    if target is not None and edges[0] < target < edges[-1]:
        x = plot.x(target)
        parts += [segment("aim", x, plot.top - 6, x, plot.bottom), text(x, plot.top - 10, "target", kind="name")]
    middle = histogram.quantile(0.5)
    if math.isfinite(middle):
        parts.append(text(plot.x(min(max(middle, edges[0]), edges[-1])), plot.bottom + 14, "▲", kind="name"))
    return chart(WIDTH, HEIGHT, f"Distribution: {words}", *parts, text(plot.middle, HEIGHT - 4, words))


def shares(counts: Mapping[str, int], kinds: Sequence[str] = tuple(VERDICTS)) -> list[tuple[str, float, float]]:
    """Divide a bar of width 1000 by counts: kind, place and width of each part, in the order of `kinds`.

    >>> shares({"refused": 1, "good": 3})
    [('good', 0.0, 750.0), ('refused', 750.0, 250.0)]
    """
    known = [kind for kind in kinds if counts.get(kind)]
    total = sum(counts[kind] for kind in known)
    widths = [max(counts[kind] / total, MIN_SHARE) for kind in known]
    whole = sum(widths) or 1.0
    ends = [1000.0 * end / whole for end in itertools.accumulate(widths, initial=0.0)]
    return [(kind, x, end - x) for kind, (x, end) in zip(known, itertools.pairwise(ends), strict=True)]


def listed_counts(counts: Mapping[str, int], kinds: Sequence[str] = tuple(VERDICTS)) -> str:
    """Counts of each kind, in words.

    >>> listed_counts({"refused": 2, "good": 1500})
    '1,500 good, 2 refused'
    """
    return ", ".join(f"{counts[kind]:,} {kind}" for kind in kinds if counts.get(kind))


def batch_rows(
    batches: Mapping[str, Mapping[str, int]], fine: Container[str], odd: Container[str]
) -> list[tuple[str, Mapping[str, int], str, bool]]:
    """Name, counts, share of rows that are not `fine`, and whether it stands out, for each batch on the map."""
    return [
        (name, batches[name], percent(count_bad(batches[name], fine), sum(batches[name].values())), name in odd)
        for name in shown_batches(batches, fine)
    ]


def shown_batches(batches: Mapping[str, Mapping[str, int]], fine: Container[str] = ("good",)) -> list[str]:
    """Sorted names of the batches on the map, at most `MAX_BATCHES`."""

    def bad_share(name: str) -> float:
        return count_bad(batches[name], fine) / max(sum(batches[name].values()), 1)

    worst = sorted(batches, key=lambda name: (-bad_share(name), name))[:MAX_BATCHES]
    return sorted(worst)


def _ends(histogram: Histogram) -> tuple[int, int]:
    """Range of classes to draw: those with counts and one on either side, at least a third of a decade wide."""
    filled = [place for place, count in enumerate(histogram.counts) if count]
    low, high = (filled[0], filled[-1] + 1) if filled else (0, len(histogram.counts))
    least = math.ceil(len(histogram.counts) / math.log10(histogram.high / histogram.low) / 3.0)
    while high - low < min(least, len(histogram.counts)):
        low, high = max(low - 1, 0), min(high + 1, len(histogram.counts))
    return max(low - 1, 0), min(high + 1, len(histogram.counts))


def _decades(low: float, high: float, factor: float) -> list[tuple[float, str]]:
    """Ticks from `low` to `high`: places, and labels with round numbers, which are `factor` times the places."""
    first, last = low * factor, high * factor
    decades = range(math.floor(math.log10(first)), math.ceil(math.log10(last)) + 1)
    fine = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    steps = fine if high / low < 8.0 else (1.0, 2.0, 5.0) if high / low < 300.0 else (1.0,)
    values = (step * 10.0**decade for decade in decades for step in steps)
    return [(value / factor, f"{value:,.6g}") for value in values if first <= value <= last]


def quantile_words(histogram: Histogram, unit: str) -> str:
    """Median and 95th percentile in words.

    >>> from flinders.apps.fleet.overview import Histogram
    >>> quantile_words(Histogram.over(0.01, 100.0, 400).with_numbers([0.5] * 9 + [2.0] * 91), "°")
    'median 2.0°, 95 % below 2.0°'
    """
    if not histogram.total:
        return "none is known"
    middle, most = (figures(_factor(unit) * histogram.quantile(share)) for share in (0.5, 0.95))
    return f"median {middle}{unit}, 95 % below {most}{unit}"


FILTERS: Final = {
    "counted": count_text, "figures": figures, "degrees": degrees, "day": format_day, "share": _share,
    "label": unit_label, "chance": chance, "percent": percent, "shares": shares, "listed": listed_counts,
    "action": action,
}  # fmt: skip
"""Filters of the page's template."""
