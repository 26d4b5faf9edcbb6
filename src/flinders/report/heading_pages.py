"""Headings of a recording as a page for the terminal: their accuracy, and the direction of north."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group

from flinders.errors import count_text, python_arguments
from flinders.heading.compass import LEVEL
from flinders.report.formatting import degrees
from flinders.report.terminal import facts, notes
from flinders.workflows.heading_notes import is_tilted

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.core.geomag import SiteField
    from flinders.errors import Spelling
    from flinders.heading.compass import HeadingSums
    from flinders.workflows.heading_notes import HeadingClaim
    from flinders.workflows.heading_stream import HeadingSummary


def page_of_headings(summary: HeadingSummary, spell: Spelling = python_arguments) -> RenderableType:
    """Lay out the headings of a recording, with their limits first."""
    voyage, compass, site = summary.voyage, summary.compass, summary.site
    how = "from x and y alone, level" if compass.formula == LEVEL else f"tilt-compensated ({compass.formula})"
    known = [
        ("heading", f"of the x axis, {how}; {count_text(voyage.readings, 'reading')}"),
        ("good to", _reason_of_no_claim(summary) or _heading_error(summary.claim)),
    ]
    if compass.declination_deg is not None:
        known.append(("north", _north(site, compass.declination_deg)))
    if site is not None and compass.grid_declination_deg is not None:
        known.append(("grid", grid_words(site)))
    if voyage.frames.readings and compass.formula != LEVEL:
        known.append(("dip", _dip(voyage, site)))
    said = [(note.severity, note.words(spell)) for note in summary.notes]
    limits = [note for note in said if note[0] == "limits"]
    return Group(notes(limits), facts(known), notes(note for note in said if note[0] != "limits"))


def _reason_of_no_claim(summary: HeadingSummary) -> str:
    """Reason why headings have no stated accuracy, whatever the calibration claims; empty otherwise."""
    voyage = summary.voyage
    if voyage.has_none:
        return "nothing: no reading has a heading"
    if summary.correction.notes:
        return "an unknown accuracy: the readings do not suit the calibration"
    if summary.compass.formula == LEVEL:
        return "an unknown accuracy: the sensor was tilted" if is_tilted(voyage, summary.claim) else ""
    return "an unknown accuracy: the accelerometer does not suit the magnetometer" if voyage.frames.is_foreign else ""


def _heading_error(claim: HeadingClaim) -> str:
    level, tilted, mounting = claim.level, claim.tilted, claim.mounting_error_deg
    if level is None or claim.bound_95_deg is None:
        return "an unknown accuracy: the calibration states no uncertainty"
    bound = degrees(claim.bound_95_deg)
    words = f"{degrees(level.rms)} rms, {degrees(level.worst)} at worst (95 % within {bound}), while level"
    if tilted is not None:
        words += f"; {degrees(tilted.worst)} at {tilted.tilt_deg:.0f}° of tilt"
    if mounting is not None:
        words += f"; the rotation of the axes in the body adds {degrees(mounting)} (1 σ)"
    if claim.tilt_error_deg is not None:
        whole = math.hypot(level.worst, claim.tilt_error_deg, mounting or 0.0)
        words = f"{degrees(whole)} a reading (1 σ), tilt and noise included; the calibration to {words}"
    return f"{words}; dip {claim.dip_deg:.0f}°, {_FROM[claim.dip_source]}"


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


def grid_words(site: SiteField) -> str:
    """Words for the direction of grid north, and of magnetic north from grid north."""
    side = "E" if site.grid_declination_deg >= 0.0 else "W"
    return f"{site.grid}; magnetic north {abs(site.grid_declination_deg):.2f}° {side} of grid north"


def _dip(voyage: HeadingSums, site: SiteField | None) -> str:
    dip, scatter = voyage.frames.dip_deg
    modelled = "" if site is None else f"; {site.inclination_deg:.1f}° in the model"
    return f"{dip:.1f}° seen, scatter {scatter:.1f}° with the attitude{modelled}"
