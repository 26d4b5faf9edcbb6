"""Findings about effects outside the model: changes during the recording, disturbances, nonlinear axes, structure.

>>> [row.code for row in ROWS][:3]
['recordings-differ', 'field-changed', 'axis-swap']
"""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Needs, Rule

ROWS: Final = (
    CatalogueRow(
        code="recordings-differ",
        affects="error",
        grades="note; limits above the target; refuses above twice the target",
        number=(
            "difference of one recording from the others at the worst heading, degrees; reported if chance causes "
            "it less often than once in a hundred"
        ),
        action="find out what changed between the recordings, and use those made in the vehicle's state of use",
        rule=Rule(
            "apart_beyond_claim_deg",
            (Grade("note", -1.0), Grade("limits", 1.0, "target_deg"), Grade("refuses", 2.0, "target_deg")),
            needs=(Needs("apart_by_chance", "<", 0.01),),
            number="apart_deg",
            limit=Limit(1.0, "target_deg"),
        ),
        fault="{contradiction}",
        said="{after_contradiction}",
        plain="One recording differs from the others by {angle} of heading.",
        remedy=(
            "Find out what changed from one recording to the next, and use those made in the state in which the "
            "compass will be used."
        ),
        alarm=True,
    ),
    CatalogueRow(
        code="field-changed",
        grades=(
            "note from a quarter of the target on; limits above the target, and above half of it where halves of the "
            "recording differ by three times what they claim; refuses above five times"
        ),
        number=(
            "change of the offset from the beginning of a recording to its end, degrees at the worst heading; "
            "reported if chance causes it less often than once in ten thousand"
        ),
        action="record again while temperature, currents and everything magnetic stay as they are in use",
        rule=Rule(
            "drift_deg",
            (
                Grade("note", 0.25, "target_deg"),
                Grade("limits", 1.0, "drift_allowed_deg"),
                Grade("refuses", 5.0, "target_deg"),
            ),
            needs=(Needs("drift_by_chance", "<", 1e-4),),
            limit=Limit(1.0, "target_deg"),
        ),
        fault=(
            "the offset changed by {drift} {unit} from the beginning of the recording to its end, {drift_deg}° of "
            "heading{halves}"
        ),
        said="record again while temperature, currents and everything magnetic stay as they are in use",
        plain="From the beginning of the recording to its end the offset changed by {angle} of heading.",
        remedy="Record again while temperature, currents and everything magnetic stay as they are in use.",
        alarm=True,
    ),
    CatalogueRow(
        code="axis-swap",
        number=(
            "ratio by which the readings lie closer to an ellipsoid if the sign of an axis, or two axes, are corrected "
            "from some reading on; reported if they then fit like a usable recording"
        ),
        action=(
            "check the driver for a change at the reading that the advice names; record again. A swap throughout the "
            "recording [cannot be detected](fleet/faults.md)"
        ),
        rule=Rule("swap_gain", (Grade("limits", 1.1),)),
        fault="from reading {swap}",
        said=(
            "with this corrected, the readings lie {swap_gain} times closer to an ellipsoid; find out what the driver "
            "did at that reading, and record again"
        ),
        plain="While this was recorded, an axis changed its sign, or two axes changed places.",
        remedy="Find out what the driver of the sensor did at that reading, and record again.",
        alarm=True,
    ),
    CatalogueRow(
        code="disturbance-unmodelled",
        number=(
            "error of a level heading, degrees, at the far end of the range of a [disturbance](disturbances.md) that "
            "was recorded but is not modelled"
        ),
        action="calibrate `--with` that disturbance, or record without it",
        rule=Rule("unmodelled_deg", (Grade("limits", 0.5, "target_deg"),)),
        fault=(
            "readings follow the {unmodelled} that was recorded with them, by up to {unmodelled_deg}° of heading, "
            "which is not in the heading error"
        ),
        said="record without the {unmodelled}, or let the calibration correct for the {unmodelled}",
        hint={"disturbances": None},
        plain=(
            "A recorded disturbance, such as the current of a motor, moves the compass by up to {angle} of heading. "
            "The calibration does not correct for it."
        ),
        remedy="Let the calibration correct for the disturbance, or record without it.",
    ),
    CatalogueRow(
        code="attitude-dependent",
        number=(
            "largest error of a level heading, degrees, due to a disturbance that depends on the attitude, by a "
            "recorded accelerometer; without the part that offset and soft iron absorb"
        ),
        action=(
            "record the current and calibrate `--with` it; fasten what is loose; or record far from iron and compare"
        ),
        rule=Rule("attitude_dependent_deg", (Grade("limits", 0.5, "target_deg"),)),
        fault=(
            "a disturbance depends on the attitude: it changes headings by {attitude_dependent_deg}°, and has a "
            "further part that offset and soft iron absorb"
        ),
        said=(
            "a current follows the attitude, a magnetic part is loose, or iron is close; fasten the part, record "
            "elsewhere, or record the current and calibrate with it"
        ),
        hint={"disturbances": None},
        plain=(
            "A disturbance of the compass depends on its tilt, and changes headings by {angle} or more: a current, a "
            "magnetic part that moves, or iron close by."
        ),
        remedy="Switch the load off or record its current, fasten what is loose, and record again away from iron.",
        alarm=True,
    ),
    CatalogueRow(
        code="tilt-error",
        affects="use",
        number=(
            "heading error due to the accelerometer's tilt, degrees: scatter of the dip without noise and without "
            "the error of the calibration, times the tangent of the dip; for a sensor that was hardly accelerated "
            "(scatter of |g| below 2%)"
        ),
        action="calibrate `--with dip`, which finds bias and gains of the accelerometer, or calibrate that one",
        rule=Rule("tilt_error_deg", (Grade("limits", 1.0, "target_deg"),)),
        said=(
            "the error of the accelerometer's vertical changes with the attitude, and adds {tilt_error_deg:.1f}° to a "
            "heading. Calibrate with the dip that the accelerometer shows: that finds its bias, its gains and its "
            "orientation relative to the magnetometer"
        ),
        hint={"aiding": "dip"},
        plain=(
            "The vertical of the accelerometer is wrong. That adds {angle} to the error of a heading, even if the "
            "compass is perfect."
        ),
        remedy="Calibrate with the accelerometer as well, so that its errors are found.",
    ),
    CatalogueRow(
        code="nonlinear-axis",
        affects="error",
        grades="note; limits above the target; refuses above five times",
        number=(
            "heading error, at the worst heading, of the quadratic and cubic terms of the axes; reported if chance "
            "causes it less often than once in ten thousand, and both halves of the recording show it"
        ),
        action=(
            "nothing within the target, as the heading error includes this fault; beyond the target, correct it "
            "(`linearize=True`, `--linearize`) where the correction goes into C or Python code, or move the sensor "
            "away from magnets, so that it works in the middle of its range"
        ),
        rule=Rule(
            "nonlinear_deg",
            (Grade("note", -1.0), Grade("limits", 1.0, "target_deg"), Grade("refuses", 5.0, "target_deg")),
            limit=Limit(1.0, "target_deg"),
        ),
        fault="axis {nonlinear_axis} is not linear",
        said=(
            "it deviates from a straight line by {nonlinear_share:.1%} of the field, {nonlinear_deg}° of heading, "
            "which the heading error allows for; check whether the sensor is near the end of its range, or near a "
            "magnet"
        ),
        offer="for C or Python code the axes can be linearized",
        hint={"linearize": True},
        plain=(
            "An axis of the sensor is not linear: this changes headings by {angle}, which an offset and a matrix "
            "cannot correct. The errors given here allow for it."
        ),
        remedy=(
            "Move the sensor away from magnets, so that it works in the middle of its range, or linearize its axes "
            "where the correction goes into code of your own."
        ),
        alarm=True,
    ),
    CatalogueRow(
        code="linearized",
        affects="error",
        number="heading error, 1 σ at the worst attitude, due to the uncertainty of the axes' linearization, degrees",
        limit="none",
        action="write the calibration for a target that holds it: `c`, `arduino`, `micropython`; or apply it here",
        rule=Rule("linearized_deg", (Grade("note", -1.0),), limit=Limit(1.0, "target_deg")),
        said=(
            "axis {nonlinear_axis} is not linear, by {linearized_share:.1%} of the field, and the calibration "
            "linearizes it; the uncertainty of its curve is up to {linearized_deg}° of heading, which the heading "
            "error includes"
        ),
        plain="An axis of the sensor is not linear, and the calibration corrects that.",
    ),
    CatalogueRow(
        code="axis-lag",
        affects="error",
        grades="note from a tenth of the target on; limits above the target; refuses above five times",
        number=(
            "heading error, at the worst heading, of axes that are read at different moments; reported if chance "
            "causes it less often than once in ten thousand, and both halves of the recording show it"
        ),
        action=(
            "nothing within the target, as the heading error includes this fault; beyond the target, read all axes at "
            "once (one burst, block data update), or turn the sensor more slowly"
        ),
        rule=Rule(
            "lag_deg",
            (Grade("note", 0.1, "target_deg"), Grade("limits", 1.0, "target_deg"), Grade("refuses", 5.0, "target_deg")),
            limit=Limit(1.0, "target_deg"),
        ),
        fault="{axis_lag}",
        said=(
            "{lag_deg}° of heading, which the heading error allows for; read all axes at once (in one burst, with "
            "block data update), or turn the sensor more slowly"
        ),
        plain=(
            "The axes of the sensor are not read at the same moment. Quick turns in the recording therefore distort "
            "the correction, which changes headings by {angle}. The errors given here allow for it."
        ),
        remedy="Read all axes at once, or turn the sensor more slowly.",
        alarm=True,
    ),
    CatalogueRow(
        code="structure",
        affects="error",
        grades="note; limits above the target",
        number=("standard deviation of residuals that depend on the direction, as a fraction of the field"),
        action=(
            "nothing: the heading error allows for it; a sensor that is not linear, or a field that is not the "
            "same everywhere"
        ),
        rule=Rule(
            "structure_deg",
            (Grade("note", -1.0), Grade("limits", 1.0, "target_deg")),
            needs=(Needs("structure_share", ">", 0.005),),
            number="structure_share",
            limit=Limit(0.005),
        ),
        said=(
            "{structure_share:.1%} of the field depends on the direction in a way that no ellipsoid fits "
            "({structure_deg}° of heading, which the heading error allows for): the sensor is not linear or near the "
            "end of its range, or the field is not the same everywhere; record away from iron, check the range"
        ),
        plain=(
            "A part of the field, {number:.1%}, depends on the direction in a way that no correction of this kind"
            " removes. The errors given here allow for it."
        ),
        remedy="Record away from iron, and check that the field is well within the range of the sensor.",
        alarm=True,
    ),
)
