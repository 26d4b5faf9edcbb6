"""Figures of the report of a fleet: distributions, shares of verdicts or states, and a map of hardware batches.

Colours are classes of the style sheet, as in `flinders.report.figures`, so that a figure is the same text in light, in
dark and on paper. A batch stands out where its share of rows without a good verdict is more than chance explains.

>>> standing_out({"A": {"good": 950, "refused": 50}, "B": {"good": 60, "refused": 40}})
{'B': True}
>>> figure = distribution(Histogram.over(0.01, 100.0, 40).counted([0.2, 0.3, 5.0]), "degrees", target=1.0)
>>> figure.startswith("<svg"), "style=" in figure
(True, False)
"""

from __future__ import annotations

import itertools
import math
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import figures, percent
from flinders.report.charts import Axis, Plot, chart, segment, text
from flinders.report.fleet_view import Histogram  # noqa: TC001 - examples use it

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

WIDE, HIGH = 400, 190
VERDICTS: Final = ("good", "limited", "refused", "failed")
SHOWN: Final = 240
"""Batches on the map; of more, those with the largest share without a good verdict."""
CHANCE: Final = 0.01
SEEN: Final = 0.004
"""Least share of a bar that is drawn: of a million, one that failed is seen."""


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
    edges, counts = histogram.edges[low : high + 1], histogram.counts[low:high]
    most = max(counts, default=1) or 1
    plot = Plot(16, 22, WIDE - 28, 124, Axis(edges[0], edges[-1], np.log), Axis(0.0, most))
    is_above = [target is not None and first * last > target**2 for first, last in itertools.pairwise(edges)]
    parts = [plot.columns(_numbers(edges[0], edges[-1], factor), gap=27)]
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
    parts.append(text(plot.middle, HIGH - 4, words))
    return chart(WIDE, HIGH, f"Distribution: {words}", *parts)


def bar(counts: Mapping[str, int], kinds: Sequence[str] = VERDICTS) -> str:
    """Shares of some kinds, in their order, as a bar that is as wide as its place; its height is the style sheet's."""
    total = sum(counts.get(kind, 0) for kind in kinds)
    widths = {kind: max(counts[kind] / total, SEEN) for kind in kinds if counts.get(kind)}
    parts, x = [], 0.0
    for kind, share in widths.items():
        width = 1000.0 * share / sum(widths.values())
        parts.append(f'<rect class="v-{kind}" x="{x:.2f}" y="0" width="{width:.2f}" height="10"/>')
        x += width
    words = listed_counts(counts, kinds)
    return (
        f'<svg class="shares" viewBox="0 0 1000 10" preserveAspectRatio="none" role="img" aria-label="{words}">'
        f"{''.join(parts)}</svg>"
    )


def listed_counts(counts: Mapping[str, int], kinds: Sequence[str] = VERDICTS) -> str:
    """How many there are of each kind, in words.

    >>> listed_counts({"refused": 2, "good": 1500})
    '1,500 good, 2 refused'
    """
    return ", ".join(f"{counts[kind]:,} {kind}" for kind in kinds if counts.get(kind))


def batch_map(
    batches: Mapping[str, Mapping[str, int]],
    kinds: Sequence[str] = VERDICTS,
    fine: Container[str] = ("good",),
    odd: Container[str] | None = None,
) -> str:
    """A bar of shares for each batch, in the order of their names, as a list of HTML; those that stand out are marked.

    Parameters
    ----------
    batches : mapping of str to mapping of str to int
        How many there are of each kind in each batch.
    kinds : sequence of str
        In the order of the bar.
    fine : container of str
        Kinds that are as they should be; the number beside a bar is the share of all others.
    odd : container of str, optional
        Batches that stand out, by default those of `standing_out`.
    """
    marked = standing_out(batches) if odd is None else odd
    rows = [_row(name, batches[name], kinds, fine, is_odd=name in marked) for name in shown_batches(batches, fine)]
    return f'<ul class="batches">{"".join(rows)}</ul>'


def _row(name: str, counts: Mapping[str, int], kinds: Sequence[str], fine: Container[str], *, is_odd: bool) -> str:
    about = f"{escape(name or 'no batch')}: {listed_counts(counts, kinds)}"
    share = escape(percent(_bad(counts, fine), sum(counts.values())))
    mark = ' class="odd"' if is_odd else ""
    return (
        f'<li{mark} title="{about}"><span class="batch">{escape(name or "none")}</span>'
        f"{bar(counts, kinds)}<span>{share}</span></li>"
    )


def shown_batches(batches: Mapping[str, Mapping[str, int]], fine: Container[str] = ("good",)) -> list[str]:
    """Names of the batches that the map has room for, sorted."""

    def spoilt(name: str) -> float:
        return _bad(batches[name], fine) / max(sum(batches[name].values()), 1)

    worst = sorted(batches, key=lambda name: (-spoilt(name), name))[:SHOWN]
    return sorted(worst)


def standing_out(batches: Mapping[str, Mapping[str, int]]) -> dict[str, bool]:
    """Batches whose share without a good verdict is larger than that of all others, beyond what chance explains.

    Fisher's exact test of two shares, on the side of more, at `CHANCE` over the number of batches.
    """
    total = sum(sum(counts.values()) for counts in batches.values())
    bad = sum(_bad(counts) for counts in batches.values())
    return {name: True for name, counts in batches.items() if _is_odd(counts, total, bad, len(batches))}


def _is_odd(counts: Mapping[str, int], total: int, bad: int, batches: int) -> bool:
    here, ours = sum(counts.values()), _bad(counts)
    rest = total - here
    if not here or not rest or ours / here <= (bad - ours) / rest:
        return False
    return _as_many(ours, here, bad, total) < CHANCE / batches


def _as_many(ours: int, here: int, bad: int, total: int) -> float:
    """How often chance puts at least `ours` of the `bad` rows among `here` of `total`: the hypergeometric tail."""
    fine = total - bad
    first = math.exp(_choices(bad, ours) + _choices(fine, here - ours) - _choices(total, here))
    term = summed = 1.0
    for more in range(ours, min(here, bad)):
        term *= (bad - more) * (here - more) / ((more + 1.0) * (fine - here + more + 1.0))
        summed += term
        if term < 1e-12 * summed:
            break
    return first * summed


def _choices(many: int, few: int) -> float:
    """Logarithm of the binomial coefficient."""
    return math.lgamma(many + 1.0) - math.lgamma(few + 1.0) - math.lgamma(many - few + 1.0)


def _bad(counts: Mapping[str, int], fine: Container[str] = ("good",)) -> int:
    return sum(count for kind, count in counts.items() if kind not in fine)


def _ends(histogram: Histogram) -> tuple[int, int]:
    """First class that holds something, and the one after the last; a third of a decade wide at the least."""
    filled = [place for place, count in enumerate(histogram.counts) if count]
    low, high = (filled[0], filled[-1] + 1) if filled else (0, len(histogram.counts))
    least = math.ceil(len(histogram.counts) / math.log10(histogram.high / histogram.low) / 3.0)
    while high - low < min(least, len(histogram.counts)):
        low, high = max(low - 1, 0), min(high + 1, len(histogram.counts))
    return max(low - 1, 0), min(high + 1, len(histogram.counts))


def _numbers(low: float, high: float, factor: float) -> list[tuple[float, str]]:
    """Round numbers of each decade from `low` to `high`, and what stands at each: `factor` times that."""
    first, last = low * factor, high * factor
    decades = range(math.floor(math.log10(first)), math.ceil(math.log10(last)) + 1)
    fine = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    steps = fine if high / low < 8.0 else (1.0, 2.0, 5.0) if high / low < 300.0 else (1.0,)
    values = (step * 10.0**decade for decade in decades for step in steps)
    return [(value / factor, f"{value:,.6g}") for value in values if first <= value <= last]


def quantile_words(histogram: Histogram, unit: str) -> str:
    """Median and 95th percentile in words.

    >>> quantile_words(Histogram.over(0.01, 100.0, 400).counted([0.5] * 9 + [2.0] * 91), "°")
    'median 2.0°, 95 % below 2.0°'
    """
    if not histogram.total:
        return "none is known"
    factor, sign = (100.0, " %") if unit == "%" else (1.0, unit)
    middle, most = (figures(factor * histogram.quantile(share)) for share in (0.5, 0.95))
    return f"median {middle}{sign}, 95 % below {most}{sign}"
