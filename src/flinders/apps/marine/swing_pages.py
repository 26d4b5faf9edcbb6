"""Pages of a swing for the terminal: coefficients, card, curve, verdict; turns by 180°; corrections on N, E, S, W."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from flinders.apps.marine.nmea0183 import check_sum
from flinders.apps.marine.swing_words import east_or_west, limit_words
from flinders.geometry.angles import heading_text, wrap_180
from flinders.report.terminal import curve_line, facts, notes, page, table, verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.apps.marine.compensation import Compensation
    from flinders.apps.marine.deviation import Deviation
    from flinders.apps.marine.legs import LoggedSwing
    from flinders.apps.marine.standards import Standard
    from flinders.apps.marine.swing_words import SwingAccount
    from flinders.heading.stationary import HalfTurn, Rest

CURVE_WIDTH: Final = 41
"""Width of the curve in characters."""


def of_swing(account: SwingAccount) -> RenderableType:
    """Lay out a swing, its conformity with a rule, and its turns by 180°."""
    swing = account.swing
    deviation, logged = swing.deviation, swing.logged
    blocks: list[RenderableType | None] = [_rests_table(swing.rests) if swing.rests else None]
    if logged is not None:
        blocks += [
            _legs_table(logged) if logged.is_steady else None,
            notes((note.severity, str(note)) for note in logged.notes),
        ]
    if deviation is not None:
        blocks += [_coefficients(account, deviation), _card(account, deviation)]
    said = [Group(verdict(one.title.upper(), one.verdict, one.words, *one.more), notes(one.notes))
            for one in account.statements]  # fmt: skip
    rule = [notes(("note", words) for words in account.rule_notes)] if account.rule_notes else []
    if swing.halves:
        return page(*blocks, *said[:-1], *rule, _half_turns_table(swing.halves), said[-1])
    return page(*blocks, *said, *rule)


def of_checklist(rule: Standard) -> RenderableType:
    """Lay out the checklist of a rule, its limit, and its sources."""
    steps = facts((f"{place}.", step) for place, step in enumerate(rule.checklist, 1))
    known = [("limit", limit_words(rule)), ("headings", f"every {rule.step_deg:g}°")]
    known += [("seen" if place == 0 else "", source) for place, source in enumerate(rule.sources)]
    return page(Text(rule.title, "bold"), steps, facts(known))


def of_compensation(compensation: Compensation) -> RenderableType:
    """Lay out the corrections on N, E, S and W."""
    rows = [
        (row.name, heading_text(row.compass_deg), heading_text(row.make_deg), f"{row.change_deg:+.1f}°",
         east_or_west(row.left_deg))
        for row in compensation.rows
    ]  # fmt: skip
    laid = table((Column("on"), "compass reads", "make it read", "turn it by", "deviation left"), rows)
    a, b, c = compensation.a_deg, compensation.b_deg, compensation.c_deg
    words = (
        f"C {c:+.1f}°: on one of N and S turn the north–south corrector; B {b:+.1f}°: on one of E and W turn the "
        "east–west corrector; then swing again"
    )
    turned = (
        f"A {a:+.1f}° stays: turn the compass in its mount, so that it reads {abs(a):.1f}° "
        f"{'more' if a > 0.0 else 'less'}, if the reference is right"
    )
    return page(laid, Text(words), notes([("note", turned)]))


def card(deviation: Deviation, step_deg: float) -> str:
    """Deviation card as comma-separated text: compass heading, deviation, its 1 σ, magnetic heading."""
    headings, values, sigmas = deviation.card(step_deg)
    magnetic = deviation.magnetic(headings)
    rows = ["compass_deg,deviation_deg,sigma_deg,magnetic_deg"]
    for place, heading in enumerate(headings):
        sigma = "" if sigmas is None else f"{sigmas[place]:.3f}"
        rows.append(f"{heading:g},{values[place] + 0.0:.3f},{sigma},{np.mod(round(magnetic[place], 3), 360.0):.3f}")
    return "\n".join([*rows, ""])


def sentences(deviation: Deviation, step_deg: float, declination_deg: float | None) -> str:
    """Deviation card as HDG sentences of NMEA 0183: sensor heading, deviation and, if known, declination.

    >>> from flinders.apps.marine.deviation import fit
    >>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
    >>> print(sentences(swing, 90.0, 3.5), end="")
    $HCHDG,0.0,10.5,E,3.5,E*70
    $HCHDG,90.0,11.4,E,3.5,E*49
    $HCHDG,180.0,5.5,W,3.5,E*5F
    $HCHDG,270.0,12.4,W,3.5,E*64
    """
    headings, values, _ = deviation.card(step_deg)
    declination = "," if declination_deg is None else _east_or_west(declination_deg)
    pairs = zip(headings.tolist(), values.tolist(), strict=True)
    bodies = [f"HCHDG,{heading:.1f},{_east_or_west(value)},{declination}" for heading, value in pairs]
    return "".join(f"${body}*{check_sum(body):02X}\n" for body in bodies)


def _east_or_west(angle_deg: float) -> str:
    """Two fields of an NMEA sentence for an angle: degrees, and E or W."""
    return f"{abs(angle_deg):.1f},{'W' if angle_deg < 0.0 else 'E'}"


def _coefficients(account: SwingAccount, deviation: Deviation) -> Table:
    """Table of coefficients: by least squares, by other methods if available, and the cause of each."""
    *names, last = (columns := account.coefficients(deviation))
    return table((*names, Column(last, style="dim")), zip(*columns.values(), strict=True))


def _card(account: SwingAccount, deviation: Deviation) -> Text:
    """Lines of the deviation card, with the curve drawn to the right of the numbers."""
    headings, values, _ = deviation.card(account.step_deg)
    end, half = axis_end(deviation), CURVE_WIDTH // 2
    ends = f"{f'{end:g}° W':<{half}}0{f'{end:g}° E':>{half}}"
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"compass   deviation {'± 1 σ' if deviation.covariance is not None else '':7} magnetic   {ends}", "dim")
    for row, heading, value in zip(account.card(deviation), headings.tolist(), values.tolist(), strict=True):
        curve = curve_line(value, end, CURVE_WIDTH, seen=_observation(deviation, heading, account.step_deg)).rstrip()
        numbers = f"{row.heading:>7}  {row.deviation:>10} {row.sigma:7} {row.magnetic:>8}"
        text.append(f"\n{numbers}   {curve}")
    return text


def _observation(deviation: Deviation, heading: float, step_deg: float) -> float | None:
    """Observed deviation to show at a heading: curve plus residual of the nearest observation; None if none is near."""
    apart = np.abs(wrap_180(deviation.compass_deg - heading))
    place = int(apart.argmin())
    return float(deviation.at(heading) + deviation.residual_deg[place]) if apart[place] <= step_deg / 2.0 else None


def _rests_table(rests: Sequence[Rest]) -> Table:
    rows = [
        (str(place), heading_text(rest.heading_deg, 2), f"{rest.sigma_deg:.2f}°", f"{rest.spread_deg:.2f}°",
         f"{rest.stop - rest.start:,}")
        for place, rest in enumerate(rests, 1)
    ]  # fmt: skip
    return table(("rest", "heading", "1 σ", "scatter", "readings"), rows)


def _legs_table(logged: LoggedSwing) -> Table:
    columns = (logged.compass_deg, logged.deviation_deg, logged.sigma_deg, logged.seconds)
    rows = [
        (str(place), heading_text(heading), east_or_west(deviation), f"{sigma:.1f}°", f"{seconds:.0f} s")
        for place, (heading, deviation, sigma, seconds) in enumerate(zip(*columns, strict=True), 1)
    ]
    return table(("leg", "compass", "deviation", "1 σ", "length"), rows)


def _half_turns_table(halves: Sequence[HalfTurn]) -> Table:
    rows = [
        (heading_text(half.first.heading_deg, 2), heading_text(half.second.heading_deg, 2),
         f"{180.0 + half.error_deg:.2f}°", f"{half.error_deg:+.2f}{_uncertainty(half.sigma_deg)}°")
        for half in halves
    ]  # fmt: skip
    return table((Column("turned by 180°, from", justify="right"), "to", "the heading by", "off by"), rows)


def _uncertainty(sigma_deg: float) -> str:
    """Format an uncertainty; empty if it is not known."""
    return f" ± {sigma_deg:.2f}" if math.isfinite(sigma_deg) else ""


AXIS_ENDS_DEG: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 60.0, 90.0, 180.0)
"""Possible ends of the axis of deviation, in degrees."""


def axis_end(deviation: Deviation) -> float:
    """End of the axis of deviation in degrees: the smallest of `AXIS_ENDS_DEG` beyond curve and observations."""
    largest = max(deviation.largest_deg, float(np.abs(deviation.observed_deg).max()))
    return next((step for step in AXIS_ENDS_DEG if step >= largest), AXIS_ENDS_DEG[-1])
