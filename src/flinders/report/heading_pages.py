"""Headings and a swing as pages for the terminal: how good they are, where north is, coefficients, card and curve."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.core.axes import Axes
from flinders.errors import counted
from flinders.geometry.angles import folded, shown_heading
from flinders.heading.axis_consistency import EVERY, OPPOSITE, after
from flinders.heading.compass import AS_THEY_ARE, LEVEL
from flinders.heading.deviation import ADVISED, CHANCE, LARGE_DEG, NAMES, WIDEST_GAP_DEG, eight_points_sigma
from flinders.heading.stationary import hard_iron
from flinders.report.formatting import degrees, with_uncertainty
from flinders.report.terminal import axis_end, dotted, facts, notes, page, table, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.compass import Voyage
    from flinders.heading.deviation import Deviation, Expected
    from flinders.heading.stationary import HalfTurn, Rest


OFF_DEG: Final = 3.0
"""Degrees by which the dip may differ from the model's before it is worth a line."""
MANY: Final = 0.05
"""Share of shaken readings from which on they are mentioned."""


def of_headings(
    voyage: Voyage,
    *,
    formula: str,
    site: SiteField | None,
    declination_deg: float | None,
    claims: Mapping[str, Any],
    said: Sequence[tuple[str, str]],
) -> RenderableType:
    """Lay out a run of headings, what limits them first.

    `formula` is by which tilt was removed, or ``level``; `declination_deg` is what true headings were made with;
    `claims` has ``level`` and ``tilted``, a `HeadingError` each or None, for ``dip_deg``, which is from ``dip_from``;
    `said` is from `heading_notes`.
    """
    how = "from x and y alone, level" if formula == LEVEL else f"tilt-compensated ({formula})"
    known = [
        ("heading", f"of the x axis, {how}; {counted(voyage.readings, 'reading')}"),
        ("good to", _heading_error(claims)),
    ]
    if declination_deg is not None:
        known.append(("north", _north(site, declination_deg)))
    if voyage.frames.readings and formula != LEVEL:
        known.append(("dip", _dip(voyage, site)))
    limits = [note for note in said if note[0] == "limits"]
    return Group(notes(limits), facts(known), notes(note for note in said if note[0] != "limits"))


def _heading_error(claims: Mapping[str, Any]) -> str:
    level, tilted = claims["level"], claims["tilted"]
    if level is None:
        return "an unknown accuracy: the calibration states no uncertainty"
    bound = degrees(claims["bound"])
    words = f"{degrees(level.rms)} rms, {degrees(level.worst)} at worst (95 % within {bound}), while level"
    if tilted is not None:
        words += f"; {degrees(tilted.worst)} at {tilted.tilt_deg:.0f}° of tilt"
    if claims["tilt_error_deg"] is not None:
        whole = math.hypot(level.worst, claims["tilt_error_deg"])
        words = f"{degrees(whole)} a reading (1 σ), tilt and noise included; the calibration to {words}"
    return f"{words}; dip {claims['dip_deg']:.0f}°, {_FROM[claims['dip_from']]}"


_FROM: Final = {
    "given": "as given",
    "model": "of the model",
    "seen": "as seen",
    "assumed": "assumed",
    "calibration": "of the calibration",
}


def _north(site: SiteField | None, declination_deg: float) -> str:
    if site is None:
        side = "E" if declination_deg >= 0.0 else "W"
        return f"declination {abs(declination_deg):.2f}° {side}, as given"
    return str(site)


def _dip(voyage: Voyage, site: SiteField | None) -> str:
    dip, scatter = voyage.frames.dip_deg
    modelled = "" if site is None else f"; {site.inclination_deg:.1f}° in the model"
    return f"{dip:.1f}° seen, scatter {scatter:.1f}° with the attitude{modelled}"


def heading_notes(
    voyage: Voyage,
    formula: str,
    site: SiteField | None,
    claims: Mapping[str, Any],
    *,
    doubt: str = "",
    turned: Axes = AS_THEY_ARE,
) -> list[tuple[str, str]]:
    """What limits headings, and what to know about them, each with its kind, ``limits`` or ``note``.

    `doubt` says why readings do not suit their calibration, and `turned` is how the acceleration was.
    """
    return list(_notes_of_headings(voyage, formula, site, claims, doubt=doubt, turned=turned))


def _notes_of_headings(
    voyage: Voyage, formula: str, site: SiteField | None, claims: Mapping[str, Any], *, doubt: str, turned: Axes
) -> Iterator[tuple[str, str]]:
    if doubt:
        yield "limits", doubt
    if site is not None and site.doubt:
        yield "limits", site.doubt
    if voyage.without:
        missing = counted(voyage.without, "reading")
        yield "note", f"{missing} without a heading (nan): a number is missing, or x is vertical"
    yield from (
        _level_notes(voyage, claims) if formula == LEVEL else _tilted_notes(voyage, formula, site, claims, turned)
    )


def _level_notes(voyage: Voyage, claims: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    cost = float(np.tan(np.deg2rad(abs(claims["dip_deg"]))))
    yield "note", f"each degree of tilt turns a level heading by up to {cost:.1f}°"
    if _is_z_up(voyage, claims):
        words = (
            "the vertical field points along −z: z is up and level headings run backwards, unless the site is in "
            "the other hemisphere (--dip): calibrate with --axes x,-y,-z"
        )
        yield "limits", words


def _tilted_notes(
    voyage: Voyage, formula: str, site: SiteField | None, claims: Mapping[str, Any], turned: Axes
) -> Iterator[tuple[str, str]]:
    if formula == "an3192":
        yield "limits", "an3192 is wrong where roll and pitch come together, by 10° at 20° of each: use exact"
    if voyage.frames.readings and voyage.shaken > MANY * voyage.readings:
        share = voyage.shaken / voyage.readings
        yield "note", f"in {share:.0%} of the readings the acceleration was not that of gravity: their tilt is off"
    if voyage.frames.readings:
        yield from _dip_notes(voyage, site, claims, turned)
    yield "note", "a constant mounting error does not show: compare with a known heading"


def _is_z_up(voyage: Voyage, claims: Mapping[str, Any]) -> bool:
    """A level sensor sees the vertical field on the other side than it should be."""
    seen, scatter = voyage.frames.dip()
    if claims["dip_from"] == "calibration":  # of a level turn: the vertical field was never seen
        return False
    return bool(seen * claims["dip_deg"] < 0.0 and abs(seen) > max(0.2, 2.0 * scatter))


def _dip_notes(
    voyage: Voyage, site: SiteField | None, claims: Mapping[str, Any], turned: Axes
) -> Iterator[tuple[str, str]]:
    """What the dip shows of iron, axes and the sign of the acceleration."""
    dip, scatter = voyage.frames.dip_deg
    if claims["dip_from"] == "seen" and dip < 0.0:
        words = (
            f"the field is seen to point up by {-dip:.0f}°. South of the magnetic equator that is right: say so with "
            f"--at LATITUDE,LONGITUDE or --dip {dip:.0f}. North of it the acceleration has the opposite sign, and "
            f"headings run backwards: {_opposite(turned)}"
        )
        yield "limits", words
    if site is not None and abs(dip - site.inclination_deg) > max(OFF_DEG, 2.0 * scatter):
        words = (
            f"the dip is {dip - site.inclination_deg:+.1f}° off the model: iron nearby, an accelerometer that is not "
            "calibrated, or sensors that do not sit square to each other"
        )
        yield "limits", words


def _opposite(turned: Axes) -> str:
    """The option that turns the acceleration round, on top of how it is turned already."""
    whole = after(Axes.of(OPPOSITE), turned)
    return "leave --acceleration-axes out" if whole == EVERY[0] else f"give --acceleration-axes={whole}"


# -------------------------------------------------------------------------------------------------------------- a swing

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
) -> RenderableType:
    """Lay out a swing, and the turns by 180° that were made."""
    blocks: list[RenderableType | None] = [_rests_table(rests) if rests else None]
    if deviation is not None:
        blocks += [_coefficients(deviation, expected), _card(deviation, step_deg)]
        blocks.append(_swing_verdict(deviation, site, expected, target_deg))
    if halves:
        blocks += [_half_turns_table(halves), _half_turns_verdict(halves, target_deg)]
    return page(*blocks)


def card(deviation: Deviation, step_deg: float) -> str:
    """The card as comma-separated text: heading by compass, deviation, its 1 σ, magnetic heading."""
    headings, values, sigmas = deviation.card(step_deg)
    magnetic = deviation.magnetic(headings)
    rows = ["compass_deg,deviation_deg,sigma_deg,magnetic_deg"]
    for place, heading in enumerate(headings):
        sigma = "" if sigmas is None else f"{sigmas[place]:.3f}"
        rows.append(f"{heading:g},{values[place] + 0.0:.3f},{sigma},{np.mod(round(magnetic[place], 3), 360.0):.3f}")
    return "\n".join([*rows, ""])


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
        return f"{value + 0.0:+.4f}°"
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
        numbers = f"{shown_heading(heading):>7}  {_sided(value):>10} {sigma:7} {shown_heading(magnetic):>8}"
        text.append(f"\n{numbers}   {curve}")
    return text


def _seen(deviation: Deviation, heading: float, step_deg: float) -> float | None:
    """What was observed next to a line of the card, if anything was: as far from the curve as it was there."""
    apart = np.abs(folded(deviation.compass_deg - heading))
    place = int(apart.argmin())
    return float(deviation.at(heading) + deviation.residual_deg[place]) if apart[place] <= step_deg / 2.0 else None


def _sided(angle: float) -> str:
    """A deviation, east or west.

    >>> _sided(10.54), _sided(-0.04), _sided(-8.2)
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
    return Group(verdict(name.upper(), name, _words(deviation), *([] if site is None else [str(site)])), notes(said))


def _words(deviation: Deviation) -> str:
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


def _blame(halves: Sequence[HalfTurn]) -> str:
    """Hard iron that half turns show, as far as its direction is known."""
    iron = hard_iron(halves)
    if iron is None:
        return f"hard iron is left, {max(abs(half.off_deg) for half in halves) / 2.0:.1f}° of deviation on this heading"
    return f"hard iron is left (B {iron[0]:+.1f}°, C {iron[1]:+.1f}°)"


def _half_turns_table(halves: Sequence[HalfTurn]) -> Table:
    rows = [
        (shown_heading(half.first.heading_deg, 2), shown_heading(half.second.heading_deg, 2),
         f"{180.0 + half.off_deg:.2f}°", f"{half.off_deg:+.2f}{_give_or_take(half.sigma_deg)}°")
        for half in halves
    ]  # fmt: skip
    return table((Column("turned by 180°, from", justify="right"), "to", "the heading by", "off by"), rows)


def _give_or_take(sigma_deg: float) -> str:
    """Write an uncertainty; nothing where it is not known."""
    return f" ± {sigma_deg:.2f}" if math.isfinite(sigma_deg) else ""


def _half_turns_verdict(halves: Sequence[HalfTurn], target_deg: float) -> Table:
    worst = max(abs(half.off_deg) for half in halves)
    passed = worst <= target_deg
    words = (
        f"half a turn is measured to {worst:.2f}°, within the target of {target_deg:g}°"
        if passed
        else f"half a turn is off by {worst:.2f}°, more than the target of {target_deg:g}°: {_blame(halves)}, or the "
        "turn was not 180°; calibrate again"
    )
    advice = ["one pair of headings sees one direction of hard iron: add a pair at 90° to it"] * (len(halves) < 2)
    return verdict("PASSES" if passed else "FAILS", "good" if passed else "refused", words, *advice)
