"""Figures of the report of a fleet as SVG: distributions, shares of verdicts, and a map of hardware batches.

Colours are classes of the style sheet, as in `flinders.report.figures`, so that a figure is the same text in light, in
dark and on paper. A batch stands out where its share of rows without a good verdict is more than chance explains.

>>> standing_out({"A": {"good": 950, "refused": 50}, "B": {"good": 60, "refused": 40}})
{'B': True}
>>> figure = distribution(Histogram.over(0.01, 100.0, 40).counted([0.2, 0.3, 5.0]), "degrees", target=1.0)
>>> figure.startswith('<svg class="figure"'), "style=" in figure
(True, False)
"""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Final

from flinders.errors import figures
from flinders.pooling import chance_of
from flinders.report.fleet_view import Histogram  # noqa: TC001 - examples use it

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

WIDE, HIGH = 400, 190
LEFT, RIGHT, TOP, BOTTOM = 16.0, 388.0, 22.0, 146.0
VERDICTS: Final = ("good", "limited", "refused", "failed")
SHOWN: Final = 240
"""Batches on the map; of more, those with the largest share without a good verdict."""
COLUMNS, ROW, CELL = 3, 24, 266
CHANCE: Final = 0.01


def distribution(histogram: Histogram, words: str, *, target: float | None = None, factor: float = 1.0) -> str:
    """Numbers counted on a logarithmic axis, with their median, and what is above the target in another colour.

    Parameters
    ----------
    histogram : Histogram
    words : str
        What stands below the axis.
    target : float, optional
        The largest number that is good enough.
    factor : float
        By which numbers on the axis are larger than those counted.
    """
    low, high = _ends(histogram)
    edges = histogram.edges[low : high + 1]
    counts = histogram.counts[low:high]
    most = max(counts, default=1) or 1

    def x(value: float) -> float:
        return LEFT + (RIGHT - LEFT) * math.log(value / edges[0]) / math.log(edges[-1] / edges[0])

    parts = list(_scale(edges[0] * factor, edges[-1] * factor, lambda value: x(value / factor)))
    bars = {"bar": "", "bar above": ""}
    for first, last, count in zip(edges[:-1], edges[1:], counts, strict=True):
        if count:
            kind = "bar above" if target is not None and first * last > target**2 else "bar"
            top = BOTTOM - max((BOTTOM - TOP) * count / most, 0.8)
            bars[kind] += f"M{x(first):.1f} {BOTTOM}V{top:.1f}H{x(last) - 0.7:.1f}V{BOTTOM}Z"
    parts += [f'<path class="{kind}" d="{path}"/>' for kind, path in bars.items() if path]
    parts.append(f'<path class="zero" d="M{LEFT} {BOTTOM}H{RIGHT}"/>')
    if target is not None and edges[0] < target < edges[-1]:
        parts.append(f'<path class="aim" d="M{x(target):.1f} {TOP - 6}V{BOTTOM}"/>')
        parts.append(_text(x(target), TOP - 10, "target", "middle", "name"))
    middle = histogram.quantile(0.5)
    if math.isfinite(middle):
        parts.append(_text(x(min(max(middle, edges[0]), edges[-1])), BOTTOM + 14, "▲", "middle", "name"))
    parts.append(_text((LEFT + RIGHT) / 2.0, HIGH - 4, words, "middle"))
    return _svg(WIDE, HIGH, f"Distribution: {words}", parts)


def verdict_bar(verdicts: Mapping[str, int]) -> str:
    """Shares of the verdicts as one bar."""
    return _svg(820, 26, "Shares of the verdicts", _shares(verdicts, 0.0, 0.0, 820.0, 26.0))


def batch_map(batches: Mapping[str, Mapping[str, int]]) -> str:
    """A bar of shares for each batch, in the order of their names; those that stand out are marked."""
    shown = shown_batches(batches)
    odd = standing_out(batches)
    start = 26.0 + 7.2 * max((min(len(name), 15) for name in shown), default=0)  # where the bars begin
    rows = -(-len(shown) // COLUMNS)
    parts = []
    for place, name in enumerate(shown):
        x, y = (place // rows) * (CELL + 11.0), (place % rows) * float(ROW)
        told = ", ".join(f"{count:,} {verdict}" for verdict, count in batches[name].items() if count)
        label = name if len(name) <= 15 else f"{name[:14]}…"
        parts.append(f"<g><title>{escape(name or 'no batch')}: {told}</title>")
        parts.append(_text(x + 8, y + 16, "●" if odd.get(name) else "", "middle", "odd"))
        parts.append(_text(x + 17, y + 16, label or "none", "start", "name" if odd.get(name) else ""))
        parts += _shares(batches[name], x + start, y + 5.0, CELL - start - 54.0, 14.0)
        parts.append(_text(x + CELL, y + 16, f"{_spoilt(batches[name]):.1%}", "end", "name" if odd.get(name) else ""))
        parts.append("</g>")
    return _svg(820, max(rows, 1) * ROW + 2, "Shares of the verdicts in each batch", parts)


def shown_batches(batches: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Names of the batches that the map has room for, sorted."""
    worst = sorted(batches, key=lambda name: (-_spoilt(batches[name]), name))[:SHOWN]
    return sorted(worst)


def standing_out(batches: Mapping[str, Mapping[str, int]]) -> dict[str, bool]:
    """Batches whose share without a good verdict is larger than that of all others, beyond what chance explains.

    Chi-square of two shares, with one degree of freedom and Yates's correction, at `CHANCE` over the number of batches.
    """
    total = sum(sum(counts.values()) for counts in batches.values())
    bad = sum(_bad(counts) for counts in batches.values())
    return {name: True for name, counts in batches.items() if _is_odd(counts, total, bad, len(batches))}


def _is_odd(counts: Mapping[str, int], total: int, bad: int, batches: int) -> bool:
    here, ours = sum(counts.values()), _bad(counts)
    share, rest = bad / total if total else 0.0, total - here
    if not here or not rest or not 0.0 < share < 1.0 or ours / here <= (bad - ours) / rest:
        return False
    off = max(abs(ours - here * share) - 0.5, 0.0)
    chi_square = off**2 / (here * share * (1.0 - share) * rest / total)
    return chance_of(chi_square, 1) < CHANCE / batches


def _bad(counts: Mapping[str, int]) -> int:
    return sum(count for verdict, count in counts.items() if verdict != "good")


def _spoilt(counts: Mapping[str, int]) -> float:
    """Share without a good verdict."""
    return _bad(counts) / max(sum(counts.values()), 1)


def _ends(histogram: Histogram) -> tuple[int, int]:
    """First class that holds something, and the one after the last; a third of a decade wide at the least."""
    held = [place for place, count in enumerate(histogram.counts) if count]
    low, high = (held[0], held[-1] + 1) if held else (0, len(histogram.counts))
    least = math.ceil(len(histogram.counts) / math.log10(histogram.high / histogram.low) / 3.0)
    while high - low < min(least, len(histogram.counts)):
        low, high = max(low - 1, 0), min(high + 1, len(histogram.counts))
    return max(low - 1, 0), min(high + 1, len(histogram.counts))


def _scale(low: float, high: float, x: Callable[[float], float]) -> Iterator[str]:
    """Lines at 1, 2 and 5 of each decade, with numbers."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    fine = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    steps = fine if high / low < 8.0 else (1.0, 2.0, 5.0) if high / low < 300.0 else (1.0,)
    for value in (step * 10.0**decade for decade in decades for step in steps):
        if low <= value <= high:
            yield f'<path class="grid" d="M{x(value):.1f} {TOP}V{BOTTOM}"/>'
            yield _text(x(value), BOTTOM + 27, f"{value:,.6g}", "middle")


def _shares(verdicts: Mapping[str, int], x: float, y: float, width: float, height: float) -> list[str]:
    total = sum(verdicts.values()) or 1
    parts = []
    for verdict in VERDICTS:
        share = width * verdicts.get(verdict, 0) / total
        if share > 0.0:
            box = f'x="{x:.1f}" y="{y:.1f}" width="{max(share, 0.6):.1f}" height="{height:.1f}"'
            parts.append(f'<rect class="v-{verdict}" {box}/>')
            x += share
    return parts


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    if not text:
        return ""
    classes = f' class="{kind}"' if kind else ""
    return f'<text{classes} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _svg(width: float, height: float, title: str, parts: list[str]) -> str:
    return (
        f'<svg class="figure" viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" '
        f'aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )


def told(histogram: Histogram, unit: str) -> str:
    """Median and 95th percentile in words.

    >>> told(Histogram.over(0.01, 100.0, 400).counted([0.5] * 9 + [2.0] * 91), "°")
    'median 2.0°, 95 % below 2.0°'
    """
    if not histogram.total:
        return "none is known"
    factor, sign = (100.0, " %") if unit == "%" else (1.0, unit)
    middle, most = (figures(factor * histogram.quantile(share)) for share in (0.5, 0.95))
    return f"median {middle}{sign}, 95 % below {most}{sign}"
