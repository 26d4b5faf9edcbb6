"""Headings as a page for the terminal: how good they are, and where north is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.console import Group

from flinders.core.axes import Axes
from flinders.errors import counted
from flinders.heading.axis_consistency import EVERY, OPPOSITE, after
from flinders.heading.compass import AS_THEY_ARE, LEVEL
from flinders.report.formatting import degrees
from flinders.report.terminal import facts, notes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from flinders.core.geomag import SiteField
    from flinders.heading.compass import Voyage


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
    doubt: str = "",
) -> RenderableType:
    """Lay out a run of headings, what limits them first.

    `formula` is by which tilt was removed, or ``level``; `declination_deg` is what true headings were made with;
    `claims` has ``level`` and ``tilted``, a `HeadingError` each or None, for ``dip_deg``, which is from ``dip_from``;
    `said` is from `heading_notes`, and `doubt` says why readings do not suit their calibration.
    """
    how = "from x and y alone, level" if formula == LEVEL else f"tilt-compensated ({formula})"
    known = [
        ("heading", f"of the x axis, {how}; {counted(voyage.readings, 'reading')}"),
        ("good to", _unclaimed(voyage, formula, claims, doubt) or _heading_error(claims)),
    ]
    if declination_deg is not None:
        known.append(("north", _north(site, declination_deg)))
    if voyage.frames.readings and formula != LEVEL:
        known.append(("dip", _dip(voyage, site)))
    limits = [note for note in said if note[0] == "limits"]
    return Group(notes(limits), facts(known), notes(note for note in said if note[0] != "limits"))


def _unclaimed(voyage: Voyage, formula: str, claims: Mapping[str, Any], doubt: str) -> str:
    """Why nothing is claimed of headings, whatever their calibration claims; empty where something is."""
    if voyage.has_none:
        return "nothing: no reading has a heading"
    if doubt:
        return "an unknown accuracy: the readings do not suit the calibration"
    if formula == LEVEL:
        return "an unknown accuracy: the sensor was tilted" if _is_tilted(voyage, claims) else ""
    return "an unknown accuracy: the accelerometer does not suit the magnetometer" if voyage.frames.is_foreign else ""


def _is_tilted(voyage: Voyage, claims: Mapping[str, Any]) -> bool:
    """The vertical field varies of a sensor that is said to be level; a level turn's calibration does not know it."""
    return voyage.frames.is_foreign and claims["dip_from"] != "calibration"


def _heading_error(claims: Mapping[str, Any]) -> str:
    level, tilted = claims["level"], claims["tilted"]
    if level is None:
        return "an unknown accuracy: the calibration states no uncertainty"
    bound = degrees(claims["bound"])
    words = f"{degrees(level.rms)} rms, {degrees(level.worst)} at worst (95 % within {bound}), while level"
    if tilted is not None:
        words += f"; {degrees(tilted.worst)} at {tilted.tilt_deg:.0f}° of tilt"
    mounting = claims["mounting_error_deg"]
    if mounting is not None:
        words += f"; how the axes sit in the body adds {degrees(mounting)} (1 σ)"
    if claims["tilt_error_deg"] is not None:
        whole = math.hypot(level.worst, claims["tilt_error_deg"], mounting or 0.0)
        words = f"{degrees(whole)} a reading (1 σ), tilt and noise included; the calibration to {words}"
    return f"{words}; dip {claims['dip_deg']:.0f}°, {_FROM[claims['dip_from']]}"


_FROM: Final = {
    "given": "as given",
    "model": "of the model",
    "measured": "as seen",
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
    if voyage.has_none:
        yield "limits", "no reading has a heading: the acceleration is zero or missing, or x is vertical"
    elif voyage.without_heading:
        missing = counted(voyage.without_heading, "reading")
        yield "note", f"{missing} without a heading (nan): a number is missing, or x is vertical"
    yield from (
        _level_notes(voyage, claims, doubt)
        if formula == LEVEL
        else _tilted_notes(voyage, formula, site, claims, turned)
    )


def _level_notes(voyage: Voyage, claims: Mapping[str, Any], doubt: str) -> Iterator[tuple[str, str]]:
    cost = float(np.tan(np.deg2rad(abs(claims["dip_deg"]))))
    yield "note", f"each degree of tilt turns a level heading by up to {cost:.1f}°"
    if doubt:
        return
    if _is_tilted(voyage, claims):
        yield (
            "limits",
            "the sensor was tilted, as the vertical field shows: record an accelerometer, and leave --level out",
        )
    elif _is_z_up(voyage, claims):
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
    if voyage.frames.readings and voyage.accelerated > MANY * voyage.readings:
        share = voyage.accelerated / voyage.readings
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
    if voyage.frames.is_foreign:
        words = (
            f"the dip of the field wanders by {scatter:.0f}° with the attitude: the accelerometer never "
            "changes, or is that of another body"
        )
        yield "limits", words
        return
    if claims["dip_from"] == "measured" and dip < 0.0:
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
