"""A swing for the terminal: coefficients with their uncertainty, the card beside its curve, the half-turn test."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import counted
from flinders.geometry.angles import folded, shown_heading
from flinders.heading.deviation import ADVISED, CHANCE, LARGE_DEG, NAMES, WIDEST_GAP_DEG, eight_points_sigma
from flinders.heading.stationary import hard_iron
from flinders.report.curve import dotted, scale
from flinders.report.formatting import with_uncertainty
from flinders.report.text import COLOURS, MARKS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from flinders.core.geomag import SiteField
    from flinders.heading.deviation import Deviation, Expected
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


def page(
    deviation: Deviation | None,
    *,
    site: SiteField | None,
    rests: Sequence[Rest],
    halves: Sequence[HalfTurn],
    target_deg: float,
    step_deg: float,
    expected: Expected | None = None,
) -> RenderableType:
    """Lay out a swing for a rich console."""
    from rich.console import Group

    parts: list[RenderableType] = []
    if rests:
        parts += ["", _rests(rests)]
    if deviation is not None:
        parts += ["", _coefficients(deviation, expected), "", _card(deviation, step_deg), ""]
        parts.append(_verdict(deviation, site, expected, target_deg))
    if halves:
        parts += ["", _half_turns(halves, target_deg)]
    return Group(*parts)


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
    found = []
    if deviation.covariance is None:
        found.append(
            f"five coefficients go through any five headings: nothing tells how good they are. Swing on {ADVISED} "
            "headings, or say with --sigma how well each was read"
        )
    if deviation.widest_gap_deg > WIDEST_GAP_DEG:
        found.append(
            f"no heading in {deviation.widest_gap_deg:.0f}° of the circle: the curve is a guess there; swing all round"
        )
    sigma = _sigma(deviation)
    if sigma is not None and sigma > target_deg:
        found.append(
            f"the curve is known to {sigma:.2f}° (1 σ) at worst, the target is {target_deg:g}°: swing on more "
            "headings, or read them better"
        )
    if not deviation.is_one_to_one:
        found.append(
            "the curve falls faster than the heading grows: one magnetic heading has several by compass, and no card "
            "holds; compensate or calibrate first, then swing again"
        )
    worst = _worst(deviation)
    if worst is not None:
        place, ratio = worst
        heading = shown_heading(float(deviation.compass_deg[place]))
        found.append(f"the heading {heading} is {ratio:.1f} σ off the curve: take it again")
    return tuple(found)


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


def _coefficients(deviation: Deviation, expected: Expected | None) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("coefficient")
    table.add_column("least squares", justify="right")
    eight, sigmas = deviation.eight, deviation.sigmas_deg
    if eight is not None:
        table.add_column("eight points", justify="right")
    if expected is not None:
        table.add_column("claimed", justify="right")
    table.add_column("what makes it", style="dim")
    rough = None if deviation.sigma_deg is None else eight_points_sigma(deviation.sigma_deg)
    for place, (name, meaning) in enumerate(zip(NAMES, MEANINGS, strict=True)):
        cells = [_angle(deviation.coefficients_deg[place], None if sigmas is None else sigmas[place])]
        if eight is not None:
            cells.append(_angle(eight[place], None if rough is None else rough[place]))
        if expected is not None:
            cells.append(f"± {max(expected.sigmas_deg[place - 1], 0.001):.2g}°" if place else "")
        table.add_row(name, *cells, meaning)
    return table


def _angle(value: float, sigma: float | None) -> str:
    """Degrees, with what is known of their uncertainty; a curve through noiseless points has next to none."""
    if sigma is None or sigma < 1e-6:
        return f"{value + 0.0:+.4f}°"
    return f"{with_uncertainty(float(value), float(sigma))}°"


def _card(deviation: Deviation, step_deg: float) -> RenderableType:
    """Headings below each other, as on a card, the curve to the right of its numbers."""
    from rich.text import Text

    headings, values, sigmas = deviation.card(step_deg)
    magnetic = deviation.magnetic(headings)
    end = scale(deviation)
    half = CURVE_WIDTH // 2
    ends = f"{f'{end:g}° W':<{half}}0{f'{end:g}° E':>{half}}"
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"compass   deviation {'± 1 σ' if sigmas is not None else '':7} magnetic   {ends}\n", "dim")
    for place, heading in enumerate(headings):
        seen = _seen(deviation, float(heading), step_deg)
        sigma = f"± {sigmas[place]:<4.2f}°" if sigmas is not None else ""
        text.append(f"{shown_heading(float(heading)):>7}  {_sided(float(values[place])):>10} {sigma:7} ")
        text.append(f"{shown_heading(float(magnetic[place])):>8}   ")
        text.append(dotted(float(values[place]), end, CURVE_WIDTH, seen=seen).rstrip() + "\n")
    text.rstrip()
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


def _verdict(
    deviation: Deviation, site: SiteField | None, expected: Expected | None, target_deg: float
) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    found = limits(deviation, target_deg)
    name = "limited" if found else "good"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    grid.add_row(Text(name.upper(), f"bold {COLOURS[name]}"), _words(deviation))
    if site is not None:
        grid.add_row("", Text(str(site), "dim"))
    mark = " " * (len(name) - 1)
    for limit in found:
        grid.add_row(Text(f"{mark}{MARKS['limits'][0]}", MARKS["limits"][1]), limit)
    for note in (*_notes(deviation), *_claims(deviation, expected)):
        grid.add_row(Text(f"{mark}{MARKS['note'][0]}", "dim"), Text(note, "dim"))
    return grid


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
    if abs(a) > max(LARGE_A_DEG, 0.0 if sigmas is None else 3.0 * float(sigmas[0])):
        yield "A this large is seldom iron: look at how the compass sits, and at the reference of the headings"
    yield "the argument is the heading by compass; B and C change with the latitude"


def _claims(deviation: Deviation, expected: Expected | None) -> Iterator[str]:
    """What the calibration claims of B to E, and whether the swing bears it out."""
    if expected is None:
        return
    held = expected.chance(deviation)
    if held is not None and held[2] < CHANCE:
        yield (
            f"B to E are more than swing and calibration explain (χ² {held[0]:.0f} for {held[1]}): iron has come or "
            "gone since it was made, or the known headings are off"
        )
    yield (
        "claimed: what the calibration's own 1 σ makes of B to E, the same on all headings; it is in the curve, and "
        "not in the 1 σ of that"
    )


def _rests(found: Sequence[Rest]) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("rest")
    for name in ("heading", "1 σ", "scatter", "readings"):
        table.add_column(name, justify="right")
    for place, rest in enumerate(found, 1):
        table.add_row(
            str(place), shown_heading(rest.heading_deg, 2), f"{rest.sigma_deg:.2f}°", f"{rest.spread_deg:.2f}°",
            f"{rest.stop - rest.start:,}",
        )  # fmt: skip
    return table


def _blame(halves: Sequence[HalfTurn]) -> str:
    """Hard iron that half turns show, as far as they tell its direction."""
    found = hard_iron(halves)
    if found is None:
        return f"hard iron is left, {max(abs(half.off_deg) for half in halves) / 2.0:.1f}° of deviation on this heading"
    return f"hard iron is left (B {found[0]:+.1f}°, C {found[1]:+.1f}°)"


def _half_turns(halves: Sequence[HalfTurn], target_deg: float) -> RenderableType:
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    for name in ("turned by 180°, from", "to", "the heading by", "off by"):
        table.add_column(name, justify="right")
    for half in halves:
        table.add_row(
            shown_heading(half.first.heading_deg, 2), shown_heading(half.second.heading_deg, 2),
            f"{180.0 + half.off_deg:.2f}°", f"{half.off_deg:+.2f} ± {half.sigma_deg:.2f}°",
        )  # fmt: skip
    worst = max(abs(half.off_deg) for half in halves)
    passed = worst <= target_deg
    grid = Table.grid(padding=(0, 2))
    words = (
        f"half a turn is measured to {worst:.2f}°, within the target of {target_deg:g}°"
        if passed
        else f"half a turn is off by {worst:.2f}°, more than the target of {target_deg:g}°: {_blame(halves)}, or the "
        "turn was not 180°; calibrate again"
    )
    grid.add_row(Text("PASSES" if passed else "FAILS", f"bold {COLOURS['good' if passed else 'refused']}"), words)
    if len(halves) < 2:
        grid.add_row("", Text("one pair of headings sees one direction of hard iron: add a pair at 90° to it", "dim"))
    return Group(table, "", grid)
