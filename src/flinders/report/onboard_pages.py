"""Heading errors without calibration, with the onboard one and with a new one; and advice on replacing the onboard one.

>>> from dataclasses import replace
>>> from rich.console import Console
>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.workflows.onboard import judge_onboard
>>> tumble = simulate.tumble(seed=1)
>>> fit = calibrate.fit(tumble.samples)
>>> stale = replace(fit.calibration, offset=fit.calibration.offset + [2.0, 0.0, 0.0])
>>> onboard = judge_onboard(replace(tumble.samples, onboard=stale), fit)
>>> Console(width=80).print(errors_table(fit, onboard))
              strength   spread   heading error, rms    worst   95 % within
───────────────────────────────────────────────────────────────────────────
uncorrected   104.3 µT    26.6%                  97°   > 100°        > 100°
on board      49.24 µT     2.5%                 3.0°     4.2°          4.4°
new           49.37 µT     1.0%               0.059°   0.066°         0.16°
>>> Console(width=80).print(page_of_onboard(onboard, is_limited=False))
CHANGE  a change is worthwhile: with the onboard calibration headings are off by ...
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group

from flinders.comparison.comparison import MAX_P_VALUE
from flinders.core.language import numeral, phrase
from flinders.core.units import unit_label
from flinders.errors import figures
from flinders.report.comparison_pages import at_most, chance_words, up_to
from flinders.report.phrases import count, degrees, plain_number, share
from flinders.report.terminal import notes, style_cells, table, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.fitting.result import Fit
    from flinders.heading.error_propagation import HeadingError
    from flinders.native.faults import Answer
    from flinders.workflows.onboard import OnboardCheck

TITLES: Final = {"holds": "KEEP", "fails": "CHANGE", "cannot-tell": "CANNOT TELL"}
COLOURS: Final = {"holds": "good", "fails": "refused", "cannot-tell": "limited"}
"""Titles of the advice on the onboard calibration, and below that their colours."""


def errors_table(fit: Fit, onboard: OnboardCheck | None = None) -> Table:
    """Table of field strength and heading errors: uncorrected, with the onboard calibration if known, and with the fit.

    The fit determines the heading errors of the first two; that of the new calibration is its claim, 1 σ. With an
    onboard calibration the table has a column of 95 % bounds too.
    """
    ellipsoid, claim = fit.calibration.ellipsoid, fit.claim
    strength, spread = fit.evidence.coverage.raw_strength(ellipsoid)
    raw, bound_deg = claim.uncorrected_heading_error_deg, claim.heading_bound_deg
    new = fit.calibration.field_strength, fit.evidence.noise / ellipsoid.radius
    rows = [
        (phrase("errors.uncorrected", "uncorrected"), strength, spread, raw, raw.worst + bound_deg),
        (phrase("errors.new", "new"), *new, fit.heading_error_deg, bound_deg),
    ]
    if onboard is not None:
        known = onboard.comparison
        name = phrase("errors.on-board", "on board")
        rows.insert(1, (name, onboard.strength, onboard.spread, known.heading_difference_deg, known.largest_deg))
    names = (
        "",
        phrase("errors.strength", "strength"),
        phrase("errors.spread", "spread"),
        phrase("errors.rms", "heading error, rms"),
        phrase("errors.worst", "worst"),
        phrase("errors.bound", "95 % within"),
    )
    shown = len(names) if onboard is not None else len(names) - 1
    *others, last = (_cells(*row, unit=unit_label(fit.calibration.unit))[:shown] for row in rows)
    return table(names[:shown], [*others, style_cells("bold", *last)])


def _cells(
    name: str, strength: float, spread: float, error: HeadingError, bound_deg: float, *, unit: str
) -> tuple[str, ...]:
    """A row of the table."""
    bound = "" if math.isnan(bound_deg) else degrees(bound_deg)
    length = f"{numeral(figures(strength, 4))} {unit}"
    return name, length, share(spread, 1), degrees(error.rms), degrees(error.worst), bound


def page_of_onboard(onboard: OnboardCheck, *, is_limited: bool) -> RenderableType:
    """Say whether the onboard calibration should be replaced, and name it.

    `is_limited` says that the fit has limits, which are listed below.
    """
    words = onboard_words(onboard, is_limited=is_limited)
    source = onboard.words or phrase("onboard.recorded", "from the recording")
    basis = phrase("onboard.source", "on board: {source}", source=source)
    said = verdict(onboard_title(onboard.answer), COLOURS[onboard.answer], words, basis)
    return Group(said, notes(("note", each) for each in _remarks(onboard)))


def onboard_title(answer: Answer) -> str:
    """Title of the advice on the onboard calibration."""
    return phrase(f"onboard.title.{answer}", TITLES[answer])


def onboard_words(onboard: OnboardCheck, *, is_limited: bool = True) -> str:
    """Advice on replacing the onboard calibration, in words; `is_limited` is that of `page_of_onboard`."""
    comparison = onboard.comparison
    worst, target = up_to(comparison.worst_deg), f"{plain_number(comparison.target_deg)}°"
    if onboard.answer == "holds":
        is_better = comparison.p_value is not None and comparison.p_value < MAX_P_VALUE
        more = phrase("onboard.better", "; the new calibration is better, if you want more") if is_better else ""
        return phrase(
            "onboard.holds",
            "the onboard calibration is good enough: its headings are off by {worst} (95 % within {bound}; "
            "target {target}){more}",
            worst=worst, bound=degrees(comparison.largest_deg), target=target, more=more,
        )  # fmt: skip
    if onboard.answer == "fails":
        return phrase(
            "onboard.fails",
            "a change is worthwhile: with the onboard calibration headings are off by {worst}, more than the target "
            "of {target} and {chance}",
            worst=worst, target=target, chance=chance_words(comparison.p_value),
        )  # fmt: skip
    return phrase(
        "onboard.cannot-tell",
        "whether a change is worthwhile: with the onboard calibration headings are off by {worst}, give or take "
        "{bound} (95 %), which may be within or beyond the target of {target}: {remedy}",
        worst=worst, bound=at_most(comparison.claimed_bound_deg or 0.0), target=target, remedy=_remedy(is_limited),
    )  # fmt: skip


def _remedy(is_limited: bool) -> str:
    """Remedy if the recording gives no answer."""
    if is_limited:
        return phrase("onboard.resolve", "resolve the first limit of this log, below")
    return phrase("compare.longer", "record for longer")


def _remarks(onboard: OnboardCheck) -> Iterator[str]:
    """Yield further remarks on the onboard calibration."""
    if onboard.changes:
        yield phrase(
            "onboard.changed", "it changed {count} in the log: the last one is judged",
            count=count(onboard.changes, "time"),
        )  # fmt: skip
    if onboard.mounting is not None and any(onboard.mounting) and onboard.calibration.frame == "sensor":
        roll, pitch, yaw = map(plain_number, onboard.mounting)
        yield phrase(
            "onboard.mounting",
            "the compass is mounted at roll {roll}°, pitch {pitch}°, yaw {yaw}°, which no calibration changes",
            roll=roll, pitch=pitch, yaw=yaw,
        )  # fmt: skip
