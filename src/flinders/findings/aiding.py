"""Findings about aiding sensors next to the magnetometer, and about their agreement with it."""

from __future__ import annotations

import math
from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Rule

ROWS: Final = (
    CatalogueRow(
        code="circular-attitude",
        affects="use",
        number="deviation in the yaw of the attitude that depends on the heading, degrees",
        limit="half a degree, or three times the heading error claimed without it",
        action=(
            "the yaw came from this compass before it was calibrated: use `--with tilt`, or an attitude without a"
            " compass in it"
        ),
        rule=Rule("deviation_deg", (Grade("limits", 1.0, "deviation_limit_deg"),)),
        said=(
            "the yaw of the recorded attitude comes from a compass with a deviation of {deviation_deg:.1f}°, most "
            "likely from this compass before its calibration; the attitude was not used. Use the attitude without its "
            "yaw ('tilt'), or an attitude that was estimated without a compass"
        ),
        plain=(
            "The heading in the recorded attitude has an error of {angle} that depends on the heading. It most likely "
            "came from this compass before the correction, and was not used."
        ),
        remedy="Use the attitude without its heading, or an attitude that was estimated without a compass.",
    ),
    CatalogueRow(
        code="gyro-unit",
        affects="use",
        number="how many times better the rate fits in another unit",
        action="record the rate in rad/s; the gyro was not used",
        rule=Rule("times_better", (Grade("limits", 0.0),), limit=Limit(2.0)),
        said=(
            "the gyro's rate fits {times_better:.0f} times better {as_what}; the gyro was not used. Record the rate in "
            "rad/s, with the signs of the right-hand rule"
        ),
        plain=(
            "The recorded turning rate agrees with the compass only if its unit or its sign is changed. The rate was "
            "not used."
        ),
        remedy="Record the turning rate in radians a second.",
    ),
    CatalogueRow(
        code="gyro-differs",
        affects="use",
        number="share of the field's motion that the gyro does not explain",
        action="the gyro is stuck, at its limit, too slow, or another body's; its rate was not used",
        rule=Rule("gyro_leaves", (Grade("limits", 0.5),)),
        said=(
            "the gyro does not explain {gyro_leaves:.0%} of the field's motion, whatever its unit and axes: the gyro "
            "is stuck, is at its limit, is slower than the readings, or was recorded on another body or at another "
            "time; its rate was not used"
        ),
        plain="The recorded turning rate contradicts the compass. It was not used.",
        remedy=(
            "Check that the instrument is on the same body, is not at its limit, and is recorded as often as the "
            "compass."
        ),
    ),
    CatalogueRow(
        code="gyro-clipped",
        affects="use",
        number="share of the readings in which an axis of the gyro is at its limit",
        action="set a wider range of the gyro, or turn more slowly; the gyro was not used",
        rule=Rule("clipped_share", (Grade("limits", 0.0),), limit=Limit(0.01)),
        said=(
            "the gyro's {axis} axis is at its limit of {gyro_range} rad/s in {clipped_share:.0%} of the readings:"
            " set a wider range, or turn more slowly; the gyro was not used"
        ),
        plain=(
            "The gyro was at its limit in {number:.0%} of the recording, so it does not tell how the compass was "
            "turned. The gyro was not used."
        ),
        remedy="Set the gyro to a wider range, or turn more slowly.",
    ),
    CatalogueRow(
        code="gyro-scales",
        affects="use",
        number="error that the gyro's scales would have",
        limit="0.1, five times the usual error of a gyro's scales",
        action="check the gyro's range and how often it is logged; the gyro was not used",
        rule=Rule("scales_off", (Grade("limits", 0.0),), limit=Limit(0.1)),
        said=(
            "for this recording the scales of the gyro would have to be off by {amount}; those of a usual gyro are off "
            "by about {usual:.0%}. Check its range and how often it is logged; the gyro was not used"
        ),
        plain=(
            "The turns that the gyro reads are {number:.0%} too large or too small. No intact gyro errs by that much. "
            "The gyro was not used."
        ),
        remedy="Check the range that the gyro is set to, and that it is recorded often enough.",
    ),
    CatalogueRow(
        code="gyro-gaps",
        affects="use",
        number="share of the readings that have no rate, in gaps of three at most",
        action="the rates of their neighbours were used; log the gyro as often as the magnetometer",
        rule=Rule("gap_share", (Grade("note", 0.0),)),
        said=(
            "{gaps:,.0f} of {samples:,.0f} readings have no rate, in gaps of at most {longest_gap:.0f}: the "
            "rates of their neighbours were used; log the gyro as often as the magnetometer"
        ),
        plain=(
            "In {number:.0%} of the recording the turning rate is missing, for a moment at a time. The gaps were "
            "filled in."
        ),
        remedy="Record the turning rate as often as the compass.",
    ),
    CatalogueRow(
        code="aids-disagree",
        affects="use",
        number="error of the gyro's scales in a fit with an aiding sensor; a fit without that sensor has none",
        action="leave that aiding sensor out: an accelerometer leans in steady turns; it was not used",
        rule=Rule("scales_off", (Grade("limits", 0.0),), limit=Limit(0.1)),
        said=(
            "with {aid!r} the fit finds the gyro's scales off by {amount}, without {aid!r} it finds the scales "
            "correct: {why_disagree}. {aid!r} was not used; leave {aid!r} out"
        ),
        plain="The gyro and the recorded vertical contradict each other. The vertical was not used.",
        remedy="Leave the vertical out, as it leans in turns; or record while turning on the spot.",
    ),
    CatalogueRow(
        code="leans-in-turns",
        affects="use",
        number="angle (rms) by which the accelerometer's vertical leans with the rate of turning, degrees",
        limit="1.5, or three times the heading error claimed without the vertical",
        action="leave the vertical out, or record while turning on the spot; the vertical was not used",
        rule=Rule("lean_deg", (Grade("limits", 1.0, "lean_limit_deg"),)),
        said=(
            "the accelerometer's vertical leans by {lean_deg:.1f}° (rms) in turns, due to the acceleration of the "
            "motion, and was not used; leave 'dip' out, or record while turning on the spot"
        ),
        plain=(
            "The vehicle was moving in turns, so that the vertical of its accelerometer leans by {number:.0f}°. The "
            "accelerometer was not used."
        ),
        remedy="Record while turning on the spot, or slowly.",
    ),
    CatalogueRow(
        code="aid-astray",
        affects="use",
        number=(
            "deviation of a vertical or an attitude from the field, for the best mounting of the magnetometer, "
            "degrees (1 σ)"
        ),
        limit="11.5 (0.2 rad)",
        action=("check in which direction the quaternions turn, whether w comes first, and the times; it was not used"),
        rule=Rule("astray_rad", (Grade("limits", 0.2),), number="astray_deg", limit=Limit(math.degrees(0.2))),
        said=(
            "{aid!r} deviates by {astray_deg:.0f}° (1 σ) from the field, for any mounting of the magnetometer: "
            "{why_astray}; {aid!r} was not used"
        ),
        plain="The recorded attitude of the body contradicts the compass. It was not used.",
        remedy=(
            "Check the direction of rotation and the times of the recorded attitude, and that the attitude is that of "
            "the same body."
        ),
    ),
    CatalogueRow(
        code="aid-diverged",
        affects="use",
        number="claimed heading error with an aiding sensor, divided by that without it",
        action="leave the aiding sensor out, or turn the sensor through more directions; it was not used",
        rule=Rule("times_claim", (Grade("limits", 4.0),)),
        said=(
            "the fit claims a heading error of {with_deg:.0f}° with {aid!r} and {without_deg:.2g}° without {aid!r}: "
            "the measurements of {aid!r} contradict the field, or the motion leaves too much undetermined. {aid!r} "
            "was not used; leave it out, or turn the sensor through more directions"
        ),
        plain="The recorded attitude of the body makes the calibration worse. It was not used.",
        remedy="Turn the vehicle through more directions, or calibrate without that instrument.",
    ),
    CatalogueRow(
        code="aid-empty",
        affects="use",
        number="number of readings with the quantity that an aiding sensor needs",
        action="record that quantity, or leave the aiding sensor out; it was not used",
        rule=Rule("usable", (Grade("limits", 12.0),), comparison="<"),
        said=(
            "only {usable:.0f} of {samples:,.0f} readings have {what_is_empty}, which {aid!r} needs; {aid!r} was not "
            "used. Record more of these values, or leave {aid!r} out"
        ),
        plain=(
            "An additional quantity for the calibration, such as the turning rate, is missing in nearly all readings. "
            "It was not used."
        ),
        remedy="Check that this quantity is logged.",
    ),
    CatalogueRow(
        code="swapped-axes",
        affects="use",
        number="how many times better an instrument fits with its axes exchanged",
        action=(
            "exchange the columns of one of the two instruments in the driver (`--axes` turns both); otherwise "
            "corrected readings are in the axes of the other instrument"
        ),
        rule=Rule("times_better", (Grade("limits", 0.0),), limit=Limit(2.0)),
        said="the {instrument} fits {times_better:.0f} times better {how_it_sits}",
        plain="The compass and the instrument beside it do not agree on which way is forward, right and down.",
        remedy="Check how both are mounted, and the axes mapping.",
    ),
    CatalogueRow(
        code="one-axis",
        affects="use",
        number="amount of turning about the second axis, relative to the first",
        action="the gyro does not determine the offset along that axis: turn about another axis as well",
        rule=Rule("second_axis", (Grade("note", 0.05),), comparison="<"),
        said=(
            "the body turned mainly about one axis (about the second axis {second_axis:.0%} as much): the gyro does "
            "not determine the offset along the first axis; turn the body about another axis as well"
        ),
        plain=(
            "Nearly all turning was about one axis. The turning rate does not determine the offset of the compass "
            "along that axis."
        ),
        remedy="Also turn the vehicle about another axis, a little to either side.",
    ),
    CatalogueRow(
        code="mirrored-axis",
        affects="claim",
        number="−1",
        action=(
            "change the sign of the axis that is named, in the driver or by `--axes`, and calibrate again; the site "
            "was not used"
        ),
        rule=Rule("handedness", (Grade("limits", 1.0),), comparison="<"),
        said=(
            "the magnetometer is left-handed: {axis} has the wrong sign. With the axes mapped by {axes} the readings "
            "fit, and the field dips by {site_dip_deg:.1f}° as at the site. Rotated by {turned_by} the readings fit "
            "equally well, but the field would dip by {dip_deg:.1f}°. Correct the sign in the driver, or map the axes "
            "by {axes}, and calibrate again. Until then headings are wrong by 180°"
        ),
        hint={"axes": None},
        plain="An axis of the compass has the wrong sign. Headings are wrong by 180° until it is corrected.",
        remedy="Correct the sign of the axis that is named, and calibrate again.",
    ),
    CatalogueRow(
        code="site-differs",
        affects="use",
        number="degrees between the dip found and that of the site",
        action="check place and date, whether iron was near, and the accelerometer's sign; the site was not used",
        rule=Rule("dip_off_deg", (Grade("limits", 0.0),), limit=Limit(2.0)),
        said=(
            "the field dips by {dip_deg:.1f}° in the readings and by {site_dip_deg:.1f}° at the site: {site_check}; "
            "the site was not used"
        ),
        plain="The dip of the field differs by {number:.0f}° from the dip at the place that was given.",
        remedy="Check the place and the day, and whether there was iron near.",
    ),
)
