"""What there is to know about a run of headings, for the terminal: how good they are, where north is, what is odd."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.console import Group

from flinders.core.axes import Axes
from flinders.errors import counted
from flinders.heading.axis_consistency import OPPOSITE, remedy
from flinders.heading.compass import AS_THEY_ARE, LEVEL
from flinders.report.formatting import degrees
from flinders.report.terminal import facts, notes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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
    plausible: bool,
    turned: Axes = AS_THEY_ARE,
) -> RenderableType:
    """Lay out a run for a rich console.

    Parameters
    ----------
    voyage : Voyage
    formula : str
        By which tilt was taken off, or ``level``.
    site : SiteField, optional
    declination_deg : float, optional
        What true headings were made with.
    claims : mapping
        ``level`` and ``tilted``, a `HeadingError` each or None, for ``dip_deg``, which comes from ``dip_from``.
    plausible : bool
        Corrected readings are about as long as they should be.
    turned : Axes
        How the acceleration was turned.
    """
    how = "from x and y alone, level" if formula == LEVEL else f"tilt taken off ({formula})"
    known = [
        ("heading", f"of the x axis, {how}; {counted(voyage.readings, 'reading')}"),
        ("good to", _error(claims)),
    ]
    if declination_deg is not None:
        known.append(("north", _north(site, declination_deg)))
    if voyage.frames.readings and formula != LEVEL:
        known.append(("dip", _dip(voyage, site)))
    said = _notes(voyage, formula, site, claims, plausible=plausible, turned=turned)
    return Group(facts(known), notes(said))


def _error(claims: Mapping[str, Any]) -> str:
    level, tilted = claims["level"], claims["tilted"]
    if level is None:
        return "the calibration states no uncertainty"
    words = f"{degrees(level.rms)} rms, {degrees(level.worst)} at worst (1 σ), held level"
    if tilted is not None:
        words += f"; {degrees(tilted.worst)} at {tilted.tilt_deg:.0f}° of tilt"
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


def _notes(
    voyage: Voyage,
    formula: str,
    site: SiteField | None,
    claims: Mapping[str, Any],
    *,
    plausible: bool,
    turned: Axes,
) -> Iterator[tuple[str, str]]:
    """What limits the headings, and what to do."""
    if not plausible:
        words = (
            "these readings do not suit the calibration: iron or currents have come or gone, or it is for another "
            "sensor, unit or place; see flinders check, or calibrate again"
        )
        yield "limits", words
    if site is not None and site.doubt:
        yield "limits", site.doubt
    if voyage.without:
        yield (
            "note",
            f"{counted(voyage.without, 'reading')} without a heading (nan): a number is missing, or x is vertical",
        )
    if formula == LEVEL:
        cost = float(np.tan(np.deg2rad(abs(claims["dip_deg"]))))
        yield "note", f"each degree of tilt turns a level heading by up to {cost:.1f}°"
        if _is_z_up(voyage, claims):
            words = (
                "the vertical field points along −z: z is up and level headings run backwards, unless the site is in "
                "the other hemisphere (--dip): calibrate with --axes x,-y,-z"
            )
            yield "limits", words
        return
    if formula == "an3192":
        yield "limits", "an3192 is wrong where roll and pitch come together, by 10° at 20° of each: use exact"
    if voyage.frames.readings and voyage.shaken > MANY * voyage.readings:
        share = voyage.shaken / voyage.readings
        yield "note", f"in {share:.0%} of the readings the acceleration was not that of gravity: their tilt is off"
    yield from _dip_notes(voyage, site, turned)
    yield "note", "a constant error of mounting is unseen: compare with a known heading"


def _is_z_up(voyage: Voyage, claims: Mapping[str, Any]) -> bool:
    """A level sensor sees the vertical field on the other side than it should be."""
    seen, scatter = voyage.frames.dip()
    if claims["dip_from"] == "calibration":  # of a level turn: the vertical field was never seen
        return False
    return bool(seen * claims["dip_deg"] < 0.0 and abs(seen) > max(0.2, 2.0 * scatter))


def _dip_notes(voyage: Voyage, site: SiteField | None, turned: Axes) -> Iterator[tuple[str, str]]:
    """What the dip tells about iron, axes and the sign of the acceleration."""
    if not voyage.frames.readings:
        return
    dip, scatter = voyage.frames.dip_deg
    if site is None and dip < 0.0:
        words = (
            f"the field is seen to point up by {-dip:.0f}°: right in the south; north of the magnetic equator the "
            f"acceleration has the opposite sign, and headings run backwards: {remedy(Axes.of(OPPOSITE), turned)}; "
            "--at or --dip tells"
        )
        yield "limits", words
    if site is not None and abs(dip - site.inclination_deg) > max(OFF_DEG, 2.0 * scatter):
        words = (
            f"the dip is {dip - site.inclination_deg:+.1f}° off the model: iron nearby, an accelerometer that is not "
            "calibrated, or sensors that do not sit square to each other"
        )
        yield "limits", words
