"""Findings about a calibration, regardless of its origin."""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Rule

ROWS: Final = (
    CatalogueRow(
        code="axis-ratio",
        affects="use",
        number="longest axis of the ellipsoid over the shortest",
        action="check the gains of the axes, and the columns",
        rule=Rule("axis_ratio", (Grade("limits", 2.0),)),
        said="one axis reads {axis_ratio} times as much as another: check the axes' gains and the columns",
        plain="One axis of the sensor reads {number:.1f} times as much as another, which is unusual.",
        remedy="Check the gains of the axes, and that the right columns are read.",
        alarm=True,
    ),
    CatalogueRow(
        code="field-strength",
        affects="use",
        grades="note; limits where it is one and a half times outside",
        number="field that was found, µT",
        limit="22 or 67, the earth's weakest and strongest",
        action="check unit and scale; headings do not depend on the strength, an export to an autopilot does",
        rule=Rule(
            "times_outside_earth",
            (Grade("note", 1.0), Grade("limits", 1.5)),
            number="radius",
            limit=Limit(1.0, "nearest_earth"),
        ),
        said=(
            "a field of {radius} µT is outside the earth's {weakest:g}–{strongest:g} µT: check the unit or scale;"
            " headings do not depend on it"
        ),
        plain="The field that was found, {length}, is not one of the earth's. Headings do not depend on that.",
        remedy="Check the unit of the recording.",
    ),
    CatalogueRow(
        code="strength-differs",
        number="difference of the readings' field strength from that of the site, in standard deviations of both",
        action=(
            "check unit and scale; or the gain of the sensor is another than was stated (`--gain-sigma`): the strength "
            "of the site was left out"
        ),
        fleet_action="check unit, scale and gain",
        rule=Rule("strength_sigmas", (Grade("note", 4.0),)),
        said=(
            "the readings show a field of {strength_found:.3g} {unit}, and the site's is {site_strength:.3g} {unit}, "
            "{strength_sigmas} standard deviations away: the strength of the site was left out. Check unit and scale; "
            "else the gain of the sensor is off by more than was stated"
        ),
        hint={"unit": None, "scale": None},
        plain=(
            "The strength of the field that was found is not that of the place, which was therefore left out. "
            "Headings do not depend on it."
        ),
        remedy="Check the unit of the recording, and the gain of the sensor.",
    ),
    CatalogueRow(
        code="mirrored-axes",
        affects="use",
        number="−1",
        action="check the axes mapping: right only for a left-handed sensor",
        rule=Rule("handedness", (Grade("limits", 1.0),), comparison="<"),
        said=(
            "the axes mapping {axes} is a mirror image, right only for a left-handed sensor: else change the sign"
            " of one axis"
        ),
        hint={"axes": None},
        plain="The axes were mapped to a mirror image, which is right only for a left-handed sensor.",
        remedy="Check the axes mapping.",
    ),
    CatalogueRow(
        code="unit-unknown",
        number="field that was found, counts",
        limit="",
        action=(
            "name the unit (`--unit`) or what one count is in µT (`--scale`) where lengths matter; headings do "
            "not depend on the unit"
        ),
        rule=Rule("is_in_counts", (Grade("note", 0.0),), number="field_strength", limit=Limit(0.0)),
        said="the unit is not known, so all is in counts: name the unit, or the size of a count in µT",
        hint={"unit": None, "scale": None},
        plain="The unit of the readings is not known: they are in counts. Headings do not depend on the unit.",
    ),
    CatalogueRow(
        code="scale-unknown",
        number="field strength by convention (determinant 1)",
        limit="",
        action=(
            "give the field strength at the site (`--field-strength`) where lengths matter; headings do not "
            "depend on the strength"
        ),
        rule=Rule("is_relative", (Grade("note", 0.0),), number="field_strength", limit=Limit(0.0)),
        said="field strength unknown: lengths ({length}) are relative, headings unaffected",
        plain=(
            "The strength of the field at the place of recording was not given. The length of corrected readings,"
            " {length}, is therefore a convention. Headings do not depend on it."
        ),
    ),
    CatalogueRow(
        code="rotation-unknown",
        number="",
        limit="",
        action="measure the mounting by other means: a magnetometer alone cannot see it",
        rule=Rule("is_unaligned", (Grade("note", 0.0),), number="nothing", limit=Limit(0.0)),
        said="the mounting angle cannot be seen by a magnetometer and is not included",
        plain=(
            "How the sensor is turned against the vehicle cannot be seen by a magnetometer. A sensor that is "
            "mounted askew adds to the errors given here."
        ),
        remedy="Check by other means, such as a known bearing, how the sensor is mounted.",
    ),
    CatalogueRow(
        code="typed-extremes",
        number=(
            "error of a level heading, degrees, if the half-ranges differ only because the turn did not reach the"
            " shorter ends; 0 if they are equal, which proves nothing"
        ),
        action=(
            "check the compass on known bearings; if possible, record the readings, since six typed numbers "
            "contain neither noise nor directions"
        ),
        rule=Rule("is_typed", (Grade("limits", 0.0),), number="unturned_deg", limit=Limit(1.0, "target_deg")),
        said=(
            "six typed numbers: they do not show the number of readings, their noise or the extent of the turn, so no "
            "heading error can be claimed{turned_short}. Check the calibration on known bearings, and record the "
            "readings if possible"
        ),
        plain=(
            "There was no recording, only the smallest and the largest reading of each axis, which do not show how "
            "good the correction is; if the sensor was not turned all the way, the compass may be off by {angle} "
            "or more."
        ),
        remedy="Check the compass on known bearings, and record the readings where that can be done.",
    ),
    CatalogueRow(
        code="composed",
        number=(
            "heading error, degrees, at the worst level heading, due to the rotation that [three "
            "planes](classic/two-axis.md#three-axes-from-three-planes) do not determine; 180 if no turn was in xy"
        ),
        action="turn in the plane xy last; or fit the same turns, unloaded, together with `flinders calibrate`",
        rule=Rule("is_composed", (Grade("limits", 0.0),), number="rotation_left_deg", limit=Limit(1.0, "target_deg")),
        said="composed of turns ({turns}){composition}",
        plain=(
            "The correction was put together from turns in one plane after the other. The part that they do not "
            "determine costs a level heading {angle}; the accuracy at other attitudes is not known."
        ),
        remedy="Record the same turns without a correction, and calibrate from all of them together.",
    ),
    CatalogueRow(
        code="filtered",
        grades="note; limits above the limit",
        number=(
            "change of the heading by `--filter`, degrees at the worst level heading; 180 if there is no calibration "
            "without the filter to compare with"
        ),
        limit="worst heading error claimed",
        action=(
            "turn more slowly, or leave the filter out: it pulls readings of a turning sensor inside the "
            "ellipsoid; `auto` leaves spikes out by itself ([filters](filters.md))"
        ),
        rule=Rule(
            "moved_deg", (Grade("note", -1.0), Grade("limits", 1.0, "allowed_deg")), limit=Limit(1.0, "claimed_deg")
        ),
        said="filtered ({filter}{dropped_words}){filter_effect}",
        plain="The readings went through a filter, which moved the heading by {angle} at the worst.",
        remedy=(
            "If the filter moved the heading by more than the error given here, calibrate again without it, or "
            "turn the sensor more slowly."
        ),
    ),
    CatalogueRow(
        code="no-uncertainty",
        number="",
        limit="",
        action="calibrate from a recording to know how good headings are",
        rule=Rule("is_unstated", (Grade("limits", 0.0),), number="unstated_deg", limit=Limit(1.0, "unstated_deg")),
        said=(
            "the calibration file states no uncertainty, like every imported one: the heading error is unknown. "
            "Calibrate from a recording to know it"
        ),
        plain="The calibration file does not state its accuracy, like every imported one.",
        remedy="Calibrate from a recording.",
    ),
)
