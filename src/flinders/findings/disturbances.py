"""Findings about modelled disturbances of a sensor: currents, throttles, temperatures."""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Needs, Rule

ROWS: Final = (
    CatalogueRow(
        code="disturbances-collinear",
        affects="use",
        number=(
            "largest share of one disturbance's variation that the others explain, such as of motors that are modelled"
            " one by one"
        ),
        action=(
            "use the calibration where the disturbances rise and fall as in the recording, follow one of them alone, "
            "or vary each by itself"
        ),
        rule=Rule("most_alike", (Grade("limits", 0.95),)),
        said=(
            "{alike} rose and fell together ({most_alike:.1%} of one's variation is explained by the others): their "
            "joint effect is known, but hardly the effect of each; use the calibration where they rise and fall as in "
            "the recording, follow one of them alone, or vary each by itself"
        ),
        plain="Several recorded disturbances rose and fell together, so that their effects cannot be separated.",
        remedy="Use the correction where they rise and fall as recorded, or record again and vary each by itself.",
    ),
    CatalogueRow(
        code="disturbance-noisy",
        number=(
            "largest relative error by which an offset per unit is too small, due to noise in the disturbance's "
            "column; one finding for all disturbances"
        ),
        action="log it smoother, or hold each setting for longer",
        rule=Rule("most_attenuation", (Grade("limits", 0.02),)),
        said=(
            "readings do not follow fast changes of {noisy}: {noisy_what} about {noisy_share} too small; log "
            "{noisy_remedy}, or hold each setting for longer"
        ),
        plain=(
            "A recorded disturbance, such as a current, has so much noise that its effect was found up to {number:.0%}"
            " too small."
        ),
        remedy="Record it with less noise, or hold each setting for longer.",
    ),
    CatalogueRow(
        code="disturbance-constant",
        number="0: the disturbance hardly changed",
        limit="smallest useful range: 0.1 A, 2 % of the throttle, 0.3 °C",
        action="vary it over its whole range while turning the sensor; or leave it out",
        rule=Rule("is_constant", (Grade("limits", 0.0),), number="nothing", limit=Limit(1.0, "least_range")),
        said=(
            "{name} hardly changed (by less than {least_range:g}{range_unit}), so that its effect cannot be "
            "determined: vary it over its whole range while turning the sensor"
        ),
        plain=(
            "A recorded disturbance, such as a current, hardly changed during the recording, so that its effect is not "
            "known."
        ),
        remedy="Record again, and change that quantity over its whole range while turning.",
    ),
    CatalogueRow(
        code="column-unused",
        number=(
            "scatter of the field strength with a [named column](disturbances.md#any-column), divided by that "
            "without; in the parts of the recording that were left out of the fit"
        ),
        action="nothing; name a column that moves the readings, or leave this one out",
        rule=Rule("is_unused", (Grade("note", 0.0),), number="scatter_ratio", limit=Limit(0.98)),
        said=(
            "{name} explains nothing: where readings were left out of the fit, their strength scatters "
            "{scatter_ratio:.3f} times as much with it as without; the calibration does not follow it"
        ),
        plain="One of the columns that were named does not affect the compass, and was left out.",
        remedy="Leave that column out.",
    ),
    CatalogueRow(
        code="disturbance",
        number=(
            "heading error that [following](disturbances.md) a current, a throttle, a temperature or a column removes "
            "at the far end of its recorded range, degrees, at the worst attitude"
        ),
        action="nothing; log that column wherever the calibration is used",
        rule=Rule("removed_deg", (Grade("note", -1.0),), limit=Limit(0.0)),
        said=(
            "the offset follows {disturbance} ({unit}): that removes up to {removed_deg}° of heading error {at_end}, "
            "and leaves {remaining_deg}° (1 σ{running}){explains}{without}"
        ),
        plain="A recorded disturbance is corrected. Without that, headings would be off by up to {angle}.",
        remedy="Use the calibration only where the disturbance is measured as in the recording.",
    ),
    CatalogueRow(
        code="disturbance-uncertain",
        number=(
            "heading error (1 σ) due to the uncertainty of the disturbance at the far end of its recorded range, "
            "degrees, at the worst heading"
        ),
        action="vary it while turning the sensor through all directions",
        rule=Rule("remaining_deg", (Grade("limits", 1.0, "target_deg"),)),
        said=(
            "{at_end} the heading may be off by {left_at_most_deg}° (1 σ; the target is {target_deg:g}°) due to the "
            "uncertainty of {name}'s effect: vary it while turning the sensor through all directions"
        ),
        plain="At the far end of the range of a recorded disturbance, headings may be off by {angle}.",
        remedy="Record again, longer at that end of its range, while turning through all directions.",
    ),
    CatalogueRow(
        code="disturbance-collinear-attitude",
        number="share of the disturbance's effect that the attitude could explain as well",
        action="vary it in each attitude, not in step with the turning",
        rule=Rule("attitude_collinearity", (Grade("limits", 0.95),)),
        said=(
            "{attitude_collinearity:.1%} of the effect of {name} could also be due to the attitude: vary it in each "
            "attitude, not in step with the turning"
        ),
        plain=(
            "A recorded disturbance changed in step with the attitude of the sensor ({number:.0%} of it), so that "
            "the effect of one cannot be distinguished from that of the other."
        ),
        remedy="Record again, and change the disturbance in each attitude, not in step with the turning.",
    ),
    CatalogueRow(
        code="disturbance-monotone",
        number="share of the disturbance's variation that a monotonic function of time explains",
        action=(
            "let it go up and down again while recording: a drift of the offset, or a sensor that moved, would "
            "look the same"
        ),
        rule=Rule("monotonicity", (Grade("limits", 0.95),)),
        said=(
            "{name} only rose, or only fell, while this was recorded: an offset that drifts, or a sensor that moved, "
            "would look the same; let {name} go up and down again while recording"
        ),
        plain=(
            "A recorded disturbance only rose, or only fell, during the recording. An offset that drifts, or a compass "
            "that was moved, would look the same."
        ),
        remedy="Record again, and let the disturbance rise and fall several times.",
    ),
    CatalogueRow(
        code="disturbance-lag",
        number="lag at which the residuals are smallest, seconds: the end of the search",
        action="check the times of its column: it has another clock, or does not move the readings",
        rule=Rule("is_lag_at_limit", (Grade("limits", 0.0),), number="lag_s", limit=Limit(1.0)),
        said=(
            "readings follow {name} best at the end of the search for a lag ({lag_s:+.2g} s): its clock is off by"
            " more than a second, or it does not move the readings; check the times of the column {name}"
        ),
        plain=(
            "The compass seems to follow a recorded disturbance with a delay of more than {limit:g} s. The clocks of "
            "the two differ, or something else disturbs the compass."
        ),
        remedy="Check the times of that column.",
    ),
    CatalogueRow(
        code="disturbance-nonlinear",
        grades="limits; for a turned sensor only above half the target",
        number=(
            "deviation of a disturbance's effect from a straight line, over its range and at its reference, relative "
            "to the effect; reported if chance causes it less than once in a million"
        ),
        action="record the current instead of the throttle, or use the calibration near the most frequent values",
        rule=Rule("curvature", (Grade("limits", 0.03),), needs=(Needs("curvature_deg", ">=", 1.0, "unsaid_deg"),)),
        said=(
            "the effect of {name} deviates from a straight line by {curvature:.0%}: the sensor follows its "
            "square, or another quantity that varies with {name}; {other_column}use the calibration near the {name} "
            "that occurs most in the recording"
        ),
        plain=(
            "The effect of a recorded disturbance is not proportional to it: {number:.0%} of the effect is off"
            " a straight line."
        ),
        remedy=(
            "Record the current of the motors rather than their throttle, or use the calibration near the values "
            "that were recorded most."
        ),
    ),
    CatalogueRow(
        code="disturbance-range",
        affects="use",
        number=(
            "value that was recorded farthest from 0: beyond what the unit allows (1,000 A, −80 to 150 °C), or a "
            "current that counts negative"
        ),
        limit="the end of that range, or 0",
        action="convert the column, or change its sign, before anything is exported",
        rule=Rule("is_out_of_range", (Grade("limits", 0.0),), number="range_number", limit=Limit(1.0, "range_end")),
        said="{out_of_range}",
        plain=(
            "A recorded disturbance has impossible values, as far as {number:g}: it is in another unit, or has the "
            "wrong sign."
        ),
        remedy="Convert that column, or change its sign, before anything is exported.",
    ),
    CatalogueRow(
        code="disturbance-reference",
        grades="limits; note for a current, as its field is proportional to it",
        number=(
            "how far the reference, no throttle or no current, lies outside the range that was recorded, as a "
            "share of that range"
        ),
        action=(
            "record with the motors off as well, or use the calibration in the recorded range alone: at the "
            "reference the offset is extrapolated"
        ),
        rule=Rule(
            "reference_outside",
            (Grade("note", 0.25), Grade("limits", 1.0, "reference_limit")),
        ),
        said=(
            "the offset is stated for {reference_amount} of {name}, but {name} was recorded from {lowest:.3g} to "
            "{highest_amount} only: the offset is extrapolated along a straight line, by {reference_outside:.0%} of "
            "that range; record with {reference_amount} as well, or use the calibration in that range alone"
        ),
        plain=(
            "A recorded disturbance was never as low as the value at which the offset is stated. There the offset "
            "is extrapolated along a straight line."
        ),
        remedy="Record with the disturbance switched off as well, or use the calibration only in its recorded range.",
    ),
    CatalogueRow(
        code="disturbance-beyond",
        number=(
            "how far the disturbance goes beyond the range of the calibration's recording, as a share of that "
            "range; in `--json` of `apply`, `heading` and `check`"
        ),
        action="calibrate over the whole range: the offset is extrapolated there",
        rule=Rule("beyond", (Grade("limits", 0.0),)),
        said="{beyond_words}",
        plain="A recorded disturbance went beyond the range of the calibration, by {number:.0%} of that range.",
        remedy="Calibrate again over the whole range.",
    ),
    CatalogueRow(
        code="bench-moved",
        number="step in the residuals [on the bench](disturbances.md#on-the-bench), in the unit of the readings",
        limit="four times the noise",
        action="fix sensor and surroundings, and record again",
        rule=Rule("step", (Grade("limits", 0.0),), limit=Limit(4.0, "noise")),
        said=(
            "the residuals have a step of {step} (noise {noise}): the sensor moved, or something magnetic came near; "
            "fix both, and record again"
        ),
        plain="The sensor should stay at rest, but was moved.",
        remedy="Fix the sensor, keep everything magnetic away, and record again.",
    ),
    CatalogueRow(
        code="bench-tilted",
        number=(
            "by how much the vertical turns over the range of a disturbance "
            "[on the bench](disturbances.md#on-the-bench), as an accelerometer shows, degrees"
        ),
        action=(
            "fix the sensor, and record again: it moved with the disturbance, so that part of the earth's field "
            "was taken for the disturbance's"
        ),
        rule=Rule("tilted_deg", (Grade("limits", 0.5),)),
        said=(
            "the vertical tilts by {tilted_deg}° in step with the disturbance, as the accelerometer shows: the sensor "
            "moved with it, and part of the earth's field was taken for the disturbance's; fix the sensor, "
            "and record again"
        ),
        plain="The sensor that should be held still tilted by {angle} in step with the disturbance.",
        remedy="Fix the sensor, and record again.",
    ),
)
