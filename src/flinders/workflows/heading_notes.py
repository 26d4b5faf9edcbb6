"""Notes on headings: the site, the tilt of a sensor that should be level, an accelerometer that does not fit.

>>> from flinders.heading.compass import Compass, HeadingSums
>>> from flinders.core.calibration import Calibration
>>> compass = Compass(Calibration.identity(field_strength=50.0), "level")
>>> claim = HeadingClaim(dip_deg=60.0, dip_source="assumed")
>>> [note.code for note in heading_notes(HeadingSums(readings=3, without_heading=1), compass, None, claim)]
['without-heading', 'tilt-cost']
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from flinders.core.axes import Axes
from flinders.errors import count_text
from flinders.heading.axis_consistency import ALL_AXES, ALL_NEGATED, composed_axes
from flinders.heading.compass import LEVEL
from flinders.workflows.notes import Note

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.core.geomag import SiteField
    from flinders.heading.compass import Compass, HeadingSums
    from flinders.heading.error_propagation import HeadingError

MAX_DIP_DIFFERENCE_DEG: Final = 3.0
"""Largest difference of the measured dip from the model's without a note, in degrees."""

MAX_ACCELERATED_SHARE: Final = 0.05
"""Largest share of readings during acceleration without a note."""

MIN_VERTICAL_SHARE: Final = 0.2
"""Smallest vertical share of the field for which the sign of z shows whether z points up."""

DipSource = Literal["given", "calibration", "model", "measured", "assumed"]


@dataclass(frozen=True, slots=True)
class HeadingClaim:
    """Expected heading errors, 1 σ in degrees, at the dip of the site."""

    dip_deg: float  #: dip of the field for which these errors hold, positive downwards
    dip_source: DipSource  #: source of the dip
    #: heading error of a level vehicle; None if the calibration states no uncertainty
    level: HeadingError | None = None
    bound_95_deg: float | None = None  #: 95 % bound for all headings of a level vehicle
    #: heading error at the tilt that 95 % of the readings do not exceed; None for a tilt below 1°
    tilted: HeadingError | None = None
    tilt_error_deg: float | None = None  #: heading error by the accelerometer; None if none was used
    #: heading error by the rotation into the body; None if the rotation is not stated
    mounting_error_deg: float | None = None


def heading_notes(
    voyage: HeadingSums, compass: Compass, site: SiteField | None, claim: HeadingClaim, doubts: Sequence[Note] = ()
) -> tuple[Note, ...]:
    """Notes on the limits of headings, and other notes on headings.

    Parameters
    ----------
    doubts : sequence of Note
        Reasons why the readings do not suit the calibration; with any, the field of a level sensor is not tested.
    """
    return tuple(_notes(voyage, compass, site, claim, doubts))


def is_tilted(voyage: HeadingSums, claim: HeadingClaim) -> bool:
    """Whether the vertical field of a level sensor varies, as in a tilt; False if calibrated by a level turn."""
    return voyage.frames.is_foreign and claim.dip_source != "calibration"


def _notes(
    voyage: HeadingSums, compass: Compass, site: SiteField | None, claim: HeadingClaim, doubts: Sequence[Note]
) -> Iterator[Note]:
    yield from doubts
    if site is not None and site.warning:
        yield Note("weak-field", "limits", {"words": site.warning})
    if voyage.has_none:
        yield Note("no-heading", "limits")
    elif voyage.without_heading:
        yield Note("without-heading", values={"readings": count_text(voyage.without_heading, "reading")})
    if compass.formula == LEVEL:
        yield Note("tilt-cost", values={"cost": math.tan(math.radians(abs(claim.dip_deg)))})
        if not doubts:
            yield from _level_notes(voyage, claim)
    else:
        yield from _tilted_notes(voyage, compass, site, claim)


def _level_notes(voyage: HeadingSums, claim: HeadingClaim) -> Iterator[Note]:
    if is_tilted(voyage, claim):
        yield Note("tilted", "limits")
    elif _is_z_up(voyage, claim):
        yield Note("z-up", "limits")


def _is_z_up(voyage: HeadingSums, claim: HeadingClaim) -> bool:
    """Whether the vertical field of a level sensor has the wrong sign, as it does if z points up."""
    seen, scatter = voyage.frames.dip()
    if claim.dip_source == "calibration":  # a level turn, in which the vertical field is not observed
        return False
    return bool(seen * claim.dip_deg < 0.0 and abs(seen) > max(MIN_VERTICAL_SHARE, 2.0 * scatter))


def _tilted_notes(voyage: HeadingSums, compass: Compass, site: SiteField | None, claim: HeadingClaim) -> Iterator[Note]:
    if compass.formula == "an3192":
        yield Note("an3192", "limits")
    frames = voyage.frames
    if frames.readings and voyage.accelerated > MAX_ACCELERATED_SHARE * voyage.readings:
        yield Note("accelerated", values={"share": voyage.accelerated / voyage.readings})
    if frames.readings:
        yield from _dip_notes(voyage, compass.acceleration_axes, site, claim)
    yield Note("mounting-unobserved")


def _dip_notes(voyage: HeadingSums, turned: Axes, site: SiteField | None, claim: HeadingClaim) -> Iterator[Note]:
    """Notes about iron, axes and the sign of the acceleration, by the dip; `turned` are the acceleration's axes."""
    dip, scatter = voyage.frames.dip_deg
    if voyage.frames.is_foreign:
        yield Note("foreign-accelerometer", "limits", {"scatter_deg": scatter})
        return
    if claim.dip_source == "measured" and dip < 0.0:
        needed = composed_axes(Axes.of(ALL_NEGATED), turned)
        axes_needed = "" if needed == ALL_AXES[0] else str(needed)
        yield Note("dip-upward", "limits", {"up_deg": -dip, "axes_needed": axes_needed})
    if site is not None and abs(dip - site.inclination_deg) > max(MAX_DIP_DIFFERENCE_DEG, 2.0 * scatter):
        yield Note("dip-off-model", "limits", {"difference_deg": dip - site.inclination_deg})
