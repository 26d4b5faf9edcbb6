"""A swing as pages for the terminal: coefficients, card, curve, verdict; turns by 180°; what to turn on N, E, S, W."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.errors import counted
from flinders.geometry.angles import folded, shown_heading
from flinders.heading.deviation import ADVISED, CHANCE, LARGE_DEG, NAMES, WIDEST_GAP_DEG, eight_points_sigma
from flinders.heading.stationary import hard_iron
from flinders.readers.nmea0183 import check_sum
from flinders.report.formatting import with_uncertainty
from flinders.report.terminal import axis_end, dotted, facts, notes, page, table, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.compensation import Compensation
    from flinders.heading.deviation import Conformity, Deviation, Expected
    from flinders.heading.legs import LoggedSwing
    from flinders.heading.standards import Standard
    from flinders.heading.stationary import HalfTurn, Rest

MEANINGS: Final = (
    "compass turned, or a wrong reference",
    "hard iron, fore and aft",
    "hard iron, athwartships",
    "soft iron, along the axes",
    "soft iron, between the axes",
)
"""What makes each coefficient."""

CURVE_WIDTH: Final = 41
LARGE_A_DEG: Final = 1.0
"""A beyond this, and three times its 1 σ, asks for another look at how the compass sits."""


def of_swing(
    deviation: Deviation | None,
    *,
    site: SiteField | None,
    rests: Sequence[Rest],
    halves: Sequence[HalfTurn],
    target_deg: float,
    step_deg: float,
    expected: Expected | None = None,
    logged: LoggedSwing | None = None,
    rule: Standard | None = None,
    conformity: Conformity | None = None,
    before: Compensation | None = None,
) -> RenderableType:
    """Lay out a swing, how it keeps a rule, and the turns by 180° that were made."""
    blocks: list[RenderableType | None] = [_rests_table(rests) if rests else None]
    if logged is not None:
        blocks += [_legs_table(logged) if logged.is_steady else None, notes(("note", words) for words in logged.notes)]
    if deviation is not None:
        blocks += [_coefficients(deviation, expected), None if before is None else _before(deviation, before)]
        blocks += [_card(deviation, step_deg), _swing_verdict(deviation, site, expected, target_deg)]
    if rule is not None or conformity is not None:
        blocks.append(_rule_verdict(rule, conformity))
    if halves:
        blocks += [_half_turns_table(halves), _half_turns_verdict(halves, target_deg)]
    return page(*blocks)


def of_checklist(rule: Standard) -> RenderableType:
    """Lay out how a swing by a rule is made, what the rule allows, and what was seen of it."""
    steps = facts((f"{place}.", step) for place, step in enumerate(rule.checklist, 1))
    known = [("limit", limit_words(rule)), ("headings", f"every {rule.step_deg:g}°")]
    known += [("seen" if place == 0 else "", source) for place, source in enumerate(rule.sources)]
    return page(Text(rule.title, "bold"), steps, facts(known))


def limit_words(rule: Standard) -> str:
    """The limit of a rule in words."""
    if rule.limit_deg is None:
        return "not in what was seen of the rule: read it there, and give it with --limit DEG"
    return f"{rule.limit_deg:g}° on any heading"


def of_compensation(compensation: Compensation) -> RenderableType:
    """Lay out what to turn on N, E, S and W."""
    rows = [
        (row.name, shown_heading(row.compass_deg), shown_heading(row.make_deg), f"{row.change_deg:+.1f}°",
         sided(row.left_deg))
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


def _before(deviation: Deviation, before: Compensation) -> Table:
    """Coefficients before the compass was compensated, and now."""
    earlier = (before.a_deg, before.b_deg, before.c_deg)
    rows = [
        (name, f"{old:+.1f}°", f"{new:+.1f}°")
        for name, old, new in zip(NAMES, earlier, deviation.coefficients_deg.tolist(), strict=False)
    ]
    return table(("compensated", "before", "now"), rows)


def _rule_verdict(rule: Standard | None, conformity: Conformity | None) -> RenderableType:
    """Whether the curve keeps the limit."""
    title = [] if rule is None else [rule.title]
    if conformity is None:
        return notes([("note", f"{title[0]}: no limit was checked; {limit_words(rule)}")] if rule is not None else [])
    colour = {"within": "good", "open": "limited", "beyond": "refused"}[conformity.verdict]
    return verdict(conformity.verdict.upper(), colour, conformity_words(conformity), *title)


def conformity_words(conformity: Conformity) -> str:
    """How a curve keeps a limit, in a sentence."""
    sigma = "" if conformity.sigma_deg is None else f" ± {max(conformity.sigma_deg, 0.01):.2f}°"
    what = "a reading" if conformity.is_reading else "the curve"
    seen = f"{what} deviates by {conformity.largest_deg:.1f}°{sigma} on {shown_heading(conformity.compass_deg, 0)}"
    limit = f"the limit of {conformity.limit_deg:g}°"
    return {
        "within": f"{seen}: within {limit}, with two standard deviations to spare",
        "open": f"{seen}: within {limit}, but not by two standard deviations; swing on more headings, or read them "
        "better",
        "beyond": f"{seen}: beyond {limit}; compensate, then swing again",
    }[conformity.verdict]


def card(deviation: Deviation, step_deg: float) -> str:
    """The card as comma-separated text: heading by compass, deviation, its 1 σ, magnetic heading."""
    headings, values, sigmas = deviation.card(step_deg)
    magnetic = deviation.magnetic(headings)
    rows = ["compass_deg,deviation_deg,sigma_deg,magnetic_deg"]
    for place, heading in enumerate(headings):
        sigma = "" if sigmas is None else f"{sigmas[place]:.3f}"
        rows.append(f"{heading:g},{values[place] + 0.0:.3f},{sigma},{np.mod(round(magnetic[place], 3), 360.0):.3f}")
    return "\n".join([*rows, ""])


def sentences(deviation: Deviation, step_deg: float, declination_deg: float | None) -> str:
    """The card as sentences HDG of NMEA 0183: heading by the sensor, its deviation and, where known, the declination.

    >>> from flinders.heading.deviation import fit
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
    """Degrees and side as two fields."""
    return f"{abs(angle_deg):.1f},{'W' if angle_deg < 0.0 else 'E'}"


def limits(deviation: Deviation, target_deg: float) -> tuple[str, ...]:
    """What a curve falls short of, each with what to do; nothing of a good one that is known to `target_deg`."""
    reasons = []
    if deviation.covariance is None:
        reasons.append(
            f"five coefficients go through any five headings: nothing tells how good they are. Swing on {ADVISED} "
            "headings, or say with --sigma how well each was read"
        )
    if deviation.widest_gap_deg > WIDEST_GAP_DEG:
        reasons.append(
            f"no heading in {deviation.widest_gap_deg:.0f}° of the circle: the curve is a guess there; swing all round"
        )
    sigma = _sigma(deviation)
    if sigma is not None and sigma > target_deg:
        reasons.append(
            f"the curve is known to {sigma:.2f}° (1 σ) at worst, the target is {target_deg:g}°: swing on more "
            "headings, or read them better"
        )
    if not deviation.is_one_to_one:
        reasons.append(
            "the curve falls faster than the heading grows: one magnetic heading has several by compass, and no card "
            "holds; compensate or calibrate first, then swing again"
        )
    worst = _worst(deviation)
    if worst is not None:
        place, ratio = worst
        heading = shown_heading(float(deviation.compass_deg[place]))
        reasons.append(f"the heading {heading} is {ratio:.1f} σ off the curve: take it again")
    return tuple(reasons)


def _worst(deviation: Deviation) -> tuple[int, float] | None:
    """The observation that is farthest off, where that is too far: three times the 1 σ that was given."""
    if deviation.chi_square is None or deviation.freedom < 1 or not deviation.sigma_deg:
        return None
    given = deviation.sigma_deg / max(1.0, (deviation.chi_square / deviation.freedom) ** 0.5)
    ratios = np.abs(deviation.residual_deg) / given
    place = int(ratios.argmax())
    return (place, float(ratios[place])) if ratios[place] > 3.0 else None


def _sigma(deviation: Deviation) -> float | None:
    """1 σ of the curve where it is known worst."""
    sigma = deviation.sigma_at(np.arange(360.0))
    return None if sigma is None else float(sigma.max())


def _coefficients(deviation: Deviation, expected: Expected | None) -> Table:
    """Each coefficient by least squares, from eight points and as claimed, as far as there is each; what makes it."""
    rough = None if deviation.sigma_deg is None else eight_points_sigma(deviation.sigma_deg)
    columns = {"coefficient": list(NAMES), "least squares": _angles(deviation.coefficients_deg, deviation.sigmas_deg)}
    if deviation.eight is not None:
        columns["eight points"] = _angles(deviation.eight, rough)
    if expected is not None:
        columns["claimed"] = ["", *(f"± {max(sigma, 0.001):.2g}°" for sigma in expected.sigmas_deg)]
    rows = zip(*columns.values(), MEANINGS, strict=True)
    return table((*columns, Column("what makes it", style="dim")), rows)


def _angles(values: Floats, sigmas: Floats | None) -> list[str]:
    known = [None] * len(values) if sigmas is None else sigmas.tolist()
    return [_angle(*pair) for pair in zip(values.tolist(), known, strict=True)]


def _angle(value: float, sigma: float | None) -> str:
    """Degrees, with what is known of their uncertainty; a curve through noiseless points has next to none."""
    if sigma is None or sigma < 1e-6:
        return f"{round(value, 4) + 0.0:+.4f}°"
    return f"{with_uncertainty(float(value), float(sigma))}°"


def _card(deviation: Deviation, step_deg: float) -> Text:
    """Headings below each other, as on a card, the curve to the right of its numbers."""
    headings, values, sigmas = deviation.card(step_deg)
    end, half = axis_end(deviation), CURVE_WIDTH // 2
    ends = f"{f'{end:g}° W':<{half}}0{f'{end:g}° E':>{half}}"
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"compass   deviation {'± 1 σ' if sigmas is not None else '':7} magnetic   {ends}", "dim")
    known = [""] * len(headings) if sigmas is None else [f"± {sigma:<4.2f}°" for sigma in sigmas]
    rows = zip(headings.tolist(), values.tolist(), known, deviation.magnetic(headings).tolist(), strict=True)
    for heading, value, sigma, magnetic in rows:
        curve = dotted(value, end, CURVE_WIDTH, seen=_seen(deviation, heading, step_deg)).rstrip()
        numbers = f"{shown_heading(heading):>7}  {sided(value):>10} {sigma:7} {shown_heading(magnetic):>8}"
        text.append(f"\n{numbers}   {curve}")
    return text


def _seen(deviation: Deviation, heading: float, step_deg: float) -> float | None:
    """What was observed next to a line of the card, if anything was: as far from the curve as it was there."""
    apart = np.abs(folded(deviation.compass_deg - heading))
    place = int(apart.argmin())
    return float(deviation.at(heading) + deviation.residual_deg[place]) if apart[place] <= step_deg / 2.0 else None


def sided(angle: float) -> str:
    """A deviation, east or west.

    >>> sided(10.54), sided(-0.04), sided(-8.2)
    ('10.5° E', '0.0°  ', '8.2° W')
    """
    rounded = round(angle, 1)
    side = "E" if rounded > 0.0 else "W" if rounded < 0.0 else " "
    return f"{abs(rounded):.1f}° {side}"


def _swing_verdict(
    deviation: Deviation, site: SiteField | None, expected: Expected | None, target_deg: float
) -> RenderableType:
    reasons = limits(deviation, target_deg)
    name = "limited" if reasons else "good"
    said = [("limits", limit) for limit in reasons]
    said += [("note", note) for note in (*_notes(deviation), *_claims(deviation, expected))]
    return Group(
        verdict(name.upper(), name, swing_words(deviation), *([] if site is None else [str(site)])), notes(said)
    )


def swing_words(deviation: Deviation) -> str:
    """The curve in a sentence."""
    sigma = _sigma(deviation)
    good = "" if sigma is None else f", known to {max(sigma, 0.005):.2f}° (1 σ) at worst"
    spread = deviation.sigma_deg
    scatter = "" if spread is None else f"; a heading scatters by {spread:.2f}°"
    count = counted(len(deviation.compass_deg), "heading")
    return f"deviation up to {deviation.largest_deg:.1f}°{good}; {count}{scatter}"


def _notes(deviation: Deviation) -> Iterator[str]:
    if deviation.largest_deg > LARGE_DEG:
        yield (
            f"beyond {LARGE_DEG:.0f}° the formula of five coefficients is rough: compensate or calibrate first, then "
            "swing again for what is left"
        )
    if len(deviation.compass_deg) < ADVISED:
        yield f"{ADVISED} headings, each 45° from the last, make a better swing"
    a, sigmas = float(deviation.coefficients_deg[0]), deviation.sigmas_deg
    if round(abs(a), 6) > max(LARGE_A_DEG, 0.0 if sigmas is None else 3.0 * float(sigmas[0])):
        yield "A this large is seldom iron: look at how the compass sits, and at the reference of the headings"
    yield "the argument is the heading by compass; B and C change with the latitude"


def _claims(deviation: Deviation, expected: Expected | None) -> Iterator[str]:
    """What the calibration claims of B to E, and whether the swing bears it out."""
    if expected is None:
        return
    test = expected.chance(deviation)
    if test is not None and test[2] < CHANCE:
        yield (
            f"B to E are more than swing and calibration explain (χ² {test[0]:.0f} for {test[1]}): iron has come or "
            "gone since it was made, or the known headings are off"
        )
    yield (
        "claimed: what the calibration's own 1 σ makes of B to E, the same on all headings; it is in the curve, and "
        "not in the 1 σ of that"
    )


def _rests_table(rests: Sequence[Rest]) -> Table:
    rows = [
        (str(place), shown_heading(rest.heading_deg, 2), f"{rest.sigma_deg:.2f}°", f"{rest.spread_deg:.2f}°",
         f"{rest.stop - rest.start:,}")
        for place, rest in enumerate(rests, 1)
    ]  # fmt: skip
    return table(("rest", "heading", "1 σ", "scatter", "readings"), rows)


def _legs_table(logged: LoggedSwing) -> Table:
    columns = (logged.compass_deg, logged.deviation_deg, logged.sigma_deg, logged.seconds)
    rows = [
        (str(place), shown_heading(heading), sided(deviation), f"{sigma:.1f}°", f"{seconds:.0f} s")
        for place, (heading, deviation, sigma, seconds) in enumerate(zip(*columns, strict=True), 1)
    ]
    return table(("leg", "compass", "deviation", "1 σ", "length"), rows)


def _blame(halves: Sequence[HalfTurn]) -> str:
    """Hard iron that half turns show, as far as its direction is known."""
    iron = hard_iron(halves)
    if iron is None:
        return (
            f"hard iron is left, {max(abs(half.error_deg) for half in halves) / 2.0:.1f}° of deviation on this heading"
        )
    return f"hard iron is left (B {iron[0]:+.1f}°, C {iron[1]:+.1f}°)"


def _half_turns_table(halves: Sequence[HalfTurn]) -> Table:
    rows = [
        (shown_heading(half.first.heading_deg, 2), shown_heading(half.second.heading_deg, 2),
         f"{180.0 + half.error_deg:.2f}°", f"{half.error_deg:+.2f}{_give_or_take(half.sigma_deg)}°")
        for half in halves
    ]  # fmt: skip
    return table((Column("turned by 180°, from", justify="right"), "to", "the heading by", "off by"), rows)


def _give_or_take(sigma_deg: float) -> str:
    """Write an uncertainty; nothing where it is not known."""
    return f" ± {sigma_deg:.2f}" if math.isfinite(sigma_deg) else ""


def _half_turns_verdict(halves: Sequence[HalfTurn], target_deg: float) -> Table:
    worst = max(abs(half.error_deg) for half in halves)
    passed = worst <= target_deg
    words = (
        f"half a turn is measured to {worst:.2f}°, within the target of {target_deg:g}°"
        if passed
        else f"half a turn is off by {worst:.2f}°, more than the target of {target_deg:g}°: {_blame(halves)}, or the "
        "turn was not 180°; calibrate again"
    )
    advice = ["one pair of headings sees one direction of hard iron: add a pair at 90° to it"] * (len(halves) < 2)
    return verdict("PASSES" if passed else "FAILS", "good" if passed else "refused", words, *advice)
