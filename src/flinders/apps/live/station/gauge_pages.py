"""Output of a gauge study to the terminal and as one HTML file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.live.station.gauge import grade_of
from flinders.core.units import unit_label
from flinders.errors import figures
from flinders.report.charts import Axis, Plot, chart, round_ticks
from flinders.report.formatting import date_of, minus
from flinders.report.html_file import html_file, script_of, style_of
from flinders.report.terminal import page, table, verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Group

    from flinders.apps.live.station.gauge import Component, GaugeStudy, Grade
    from flinders.apps.live.station.gauge_table import MeasuredTable

GRADES: Final = {"acceptable": "good", "marginal": "limited", "unacceptable": "refused"}
WORDS: Final = {
    "acceptable": "The gauge is acceptable",
    "marginal": "The gauge may be acceptable",
    "unacceptable": "The gauge is not acceptable",
}
COMPONENTS: Final[tuple[tuple[Component, str], ...]] = (
    ("repeatability", "repeatability (EV)"),
    ("reproducibility", "reproducibility (AV)"),
    ("gauge", "gauge (GRR)"),
    ("part", "parts (PV)"),
    ("total", "total (TV)"),
)
NAMES: Final = {
    **{f"offset_{axis}": f"offset of {axis}" for axis in "xyz"},
    "worst_deg": "heading error",
    "field_strength": "strength",
}
"""Columns of a station's table, in words."""
SOURCES: Final = {
    "part": "parts", "operator": "operators", "interaction": "parts × operators", "repeatability": "repeatability",
}  # fmt: skip
WIDTH, HEIGHT, LEFT, TOP = 640.0, 220.0, 58.0, 12.0  # of a drawing
MAX_NAMES: Final = 12  # Largest number of parts named below a drawing
COLOURS: Final = 4  # Number of colours for operators


@dataclass(frozen=True, slots=True)
class QuantityStudy:
    """A measured quantity, and its gauge study."""

    measured: MeasuredTable
    study: GaugeStudy
    tolerance: float = math.nan  #: width of its pass range; NaN without one

    @property
    def name(self) -> str:
        """Name of the quantity with its unit."""
        unit = unit_label(self.measured.unit) if self.measured.unit not in {"", "°"} else self.measured.unit
        return f"{self.words}{f', {unit}' if unit else ''}"

    @property
    def words(self) -> str:
        """Name of the quantity in words."""
        return NAMES.get(self.measured.quantity, self.measured.quantity)

    @property
    def grade(self) -> Grade:
        """Grade by the share of the pass range if there is one, else the grade of `study`."""
        share = self.percent_of_tolerance
        return self.study.grade if share is None else grade_of(share)

    @property
    def percent_of_tolerance(self) -> float | None:
        """Six standard deviations of the gauge in per cent of the pass range; None without one."""
        return self.study.percent_of_tolerance(self.tolerance) if math.isfinite(self.tolerance) else None

    @property
    def sentence(self) -> str:
        """Summary of the study."""
        study = self.study
        if not study.sigma("total"):
            return "all values are equal, so the gauge cannot be studied"
        count = study.distinct_categories
        categories = f"{count} distinct categor{'y' if count == 1 else 'ies'}"
        words = f"{figures(study.percent('gauge'))} % of the total variation, {categories}"
        share = self.percent_of_tolerance
        return words if share is None else f"{words}, {figures(share)} % of the tolerance"


def terminal(studied: Sequence[QuantityStudy]) -> Group:
    """The studies as a page of the terminal."""
    rows = [
        (each.name, *(_number(each.study.sigma(name)) for name, _ in COMPONENTS), _number(each.study.percent("gauge")),
         str(each.study.distinct_categories), each.grade)
        for each in studied
    ]  # fmt: skip
    worst = _worst(studied)
    parts, operators, repeats = worst.study.values.shape
    size = f"{parts} parts × {operators} operator{'s' * (operators != 1)} × {repeats} repeats"
    more = [size, *_notes(studied)]
    headings = ("", "EV", "AV", "GRR", "PV", "TV", "% GRR", "ndc", "")
    title = worst.grade.upper()
    words = f"{worst.words}: {worst.sentence}"
    return page(table(headings, rows, is_dense=True), verdict(title, GRADES[worst.grade], words, *more))


def html(studied: Sequence[QuantityStudy], source: str) -> str:
    """The studies as one HTML file; `source` is the name of the table."""
    worst = _worst(studied)
    given = {
        "what": "Gauge R&R study",
        "outcome": {
            "verdict": GRADES[worst.grade],
            "title": WORDS[worst.grade],
            "sentence": f"{worst.words.capitalize()}: {worst.sentence}.",
        },
        "numbers": [
            ("Parts", str(worst.study.values.shape[0]), ""),
            ("Operators", str(worst.study.values.shape[1]), ""),
            ("Repeats", str(worst.study.values.shape[2]), "of each part by each operator"),
        ],
        "studied": [_section(each) for each in studied],
        "notes": _notes(studied),
        "source": source,
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    style = style_of("apps/live/station/gauge.css")
    template = "apps/live/station/gauge.html.j2"
    return html_file(template, given, style=style, script=script_of(), filters={"minus": minus})


def _section(each: QuantityStudy) -> dict[str, object]:
    """Content of the page for one quantity."""
    study = each.study
    return {
        "id": each.measured.quantity.replace("_", "-"),
        "name": each.name,
        "sentence": each.sentence,
        "verdict": GRADES[each.grade],
        "figure": drawing(each),
        "operators": list(enumerate(each.measured.operators)),
        "components": [
            (words, _number(study.sigma(name)), _number(study.percent(name)), _number(100.0 * _share(study, name)))
            for name, words in COMPONENTS
        ],
        "anova": [
            (
                SOURCES[row.source],
                row.freedom,
                _number(row.squares),
                _number(row.mean_square),
                _number(row.f),
                _p(row.p),
            )
            for row in study.rows
        ],
        "is_pooled": study.is_pooled,
    }


def _share(study: GaugeStudy, name: Component) -> float:
    total = study.variances["total"]
    return study.variances[name] / total if total else math.nan


def drawing(each: QuantityStudy) -> str:
    """Draw every measurement by part, in the colour of its operator, with the mean of each part."""
    values = each.study.values
    parts, operators, repeats = values.shape
    low, high = float(values.min()), float(values.max())
    room = 0.08 * (high - low) or 1.0
    plot = Plot(LEFT, TOP, WIDTH - LEFT - 8, HEIGHT - TOP - 28, Axis(-0.6, parts - 0.4), Axis(low - room, high + room))
    shown = range(0, parts, -(-parts // MAX_NAMES))
    marks = [
        plot.rows(round_ticks(plot.up, 5)),
        plot.columns([(place, each.measured.parts[place]) for place in shown], gap=18.0),
        plot.line("line", np.arange(parts), values.mean(axis=(1, 2))),
    ]
    for who in range(operators):
        x = np.repeat(np.arange(parts) + 0.5 * (who + 0.5) / operators - 0.25, repeats)
        marks.append(plot.dots(f"o{who % COLOURS}", x, values[:, who].ravel()))
    return chart(WIDTH, HEIGHT, f"{each.words} of each part, by operator", *marks)


def _worst(studied: Sequence[QuantityStudy]) -> QuantityStudy:
    """The study with the worst grade, and the largest share of the gauge."""
    order = list(GRADES)
    return max(studied, key=lambda each: (order.index(each.grade), np.nan_to_num(each.study.percent("gauge"))))


def _notes(studied: Sequence[QuantityStudy]) -> list[str]:
    """Notes on pooling, omitted rows and unknown components of a gauge study."""
    notes = ["repeats by one operator: reproducibility is not known"] * (studied[0].study.values.shape[1] == 1)
    pooled = [each.words for each in studied if each.study.is_pooled]
    notes += [f"parts × operators is pooled with the repeatability (p > 0.25): {', '.join(pooled)}"] * bool(pooled)
    left = max(each.measured.left_out for each in studied)
    return [*notes, *[f"{left} further repeats are left out, which not every part has"] * bool(left)]


def _number(value: float) -> str:
    return "–" if not math.isfinite(value) else minus(figures(value, 3)) if value else "0"


def _p(value: float) -> str:
    return "–" if math.isnan(value) else "< 0.001" if value < 0.001 else f"{value:.3f}"
