"""Findings about several magnetometers of one body, and about survey instruments."""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Needs, Rule
from flinders.findings.words import SHOT_ADVICE

ROWS: Final = (
    CatalogueRow(
        code="sensor-deviates",
        grades="note; limits for more than a tenth of the time",
        number=(
            "heading error that a sensor shows against the [others of its body](sensors.md) for a while, degrees,"
            " at the worst attitude"
        ),
        action=(
            "something magnetic was near the sensor at the times that the advice names, or a current flowed; record "
            "again without it, or use another sensor"
        ),
        rule=Rule(
            "departs_share",
            (Grade("note", 0.0), Grade("limits", 0.1)),
            number="departs_deg",
            limit=Limit(1.0, "target_deg"),
        ),
        said=(
            "it deviates from the other magnetometers by up to {departs_deg}° of heading, for {departs_share:.0%} of "
            "the time ({when}). At these times {why_deviates}: something magnetic was near this sensor, or a current "
            "flowed{does_not_rest}"
        ),
        plain=(
            "For a while this compass deviated from the others of the vehicle by up to {angle} of heading: something "
            "magnetic was near it, or a current flowed. The correction does not use the readings of that time."
        ),
        remedy="Find out what happened then, or steer by another compass.",
    ),
    CatalogueRow(
        code="sensor-deviates-throughout",
        number="deviation of one-second averages from the others throughout the recording, degrees of heading, 1 σ",
        limit="the target, or three times the best of the others where that is more",
        action="steer by another; see whether [a disturbance](disturbances.md) explains it",
        rule=Rule(
            "scatter_deg",
            (Grade("limits", 1.0, "target_deg"),),
            needs=(Needs("scatter_deg", ">", 3.0, "best_other_deg"),),
        ),
        said=(
            "averaged over a second, its readings still deviate by {scatter_deg}° of heading all the time (1 σ), and "
            "those of the best other sensor by {best_other_deg}°. Something near this sensor keeps changing, such as "
            "a current. Steer by the other sensor, or calibrate this one with a current that was recorded"
        ),
        hint={"disturbances": ["current"]},
        plain=(
            "This compass deviates from the others of the vehicle by {angle} of heading all the time: something near "
            "it keeps changing, such as a current."
        ),
        remedy="Steer by another compass, or see whether a calibration with the recorded current helps.",
    ),
    CatalogueRow(
        code="disagree",
        number="heading difference between sensors of one body for a while, or between two all the time (1 σ), degrees",
        action="neither a majority nor a length tells which is off: compare with a known bearing, or fit a third",
        rule=Rule("apart_deg", (Grade("limits", 0.0),), limit=Limit(1.0, "target_deg")),
        said=(
            "{disagreement}. It is unclear which of them is off: neither the lengths of readings nor a majority of "
            "sensors decides{each_alone}"
        ),
        plain="Compasses of the vehicle differed by {angle} of heading, and it is unclear which of them was off.",
        remedy="Compare them with a known bearing, or fit a third.",
    ),
    CatalogueRow(
        code="copied-sensor",
        affects="use",
        number="1",
        limit="0.1 of the noise, which an affine map of another sensor's readings leaves",
        action="look at how the columns were written: it is no second sensor",
        rule=Rule("is_copy", (Grade("limits", 0.0),), limit=Limit(0.1)),
        said=(
            "its readings are those of {other}, rotated and scaled: it is no independent sensor, and was fitted by "
            "itself. Check how the columns were written"
        ),
        plain="The readings are those of another sensor, rotated and scaled. This is no second compass.",
        remedy="Check how the columns of the recording were written.",
    ),
    CatalogueRow(
        code="mirrored-sensor",
        affects="use",
        number="−1",
        action=(
            "one of two sensors is not right-handed, or one of its axes is turned over: find out which, and map "
            "its axes (`--axes`)"
        ),
        rule=Rule("handedness", (Grade("limits", 1.0),), comparison="<"),
        said="its axes are a mirror image of those of {reference}: mapped by {axes} they agree. {who_is_mirrored}",
        hint={"axes": None},
        plain=(
            "The axes of this sensor and those of another are mirror images of each other: one of the two has an "
            "axis turned over."
        ),
        remedy="Find out which of the two it is, and check its axes mapping.",
    ),
    CatalogueRow(
        code="turned-to",
        number="uncertainty of the rotation into the axes of the reference, degrees, 1 σ",
        limit="",
        action="nothing; corrected readings of all sensors are in the axes of the reference",
        rule=Rule("is_turned", (Grade("note", 0.0),), number="rotation_sigma_deg", limit=Limit(0.0)),
        said=(
            "corrected readings are rotated into the axes of {reference}: mapped by {axes}, with a misalignment of "
            "{misalignment_deg}° ± {rotation_sigma_deg}° (1 σ){in_the_vehicle}"
        ),
        plain="Corrected readings are in the axes of another sensor of the vehicle, with an uncertainty of {angle}.",
    ),
    CatalogueRow(
        code="unlike-units",
        number="length of the sensor's readings, divided by that of the reference's readings",
        limit="the nearest power of ten",
        action="name the unit of each",
        rule=Rule("is_decades_off", (Grade("note", 0.0),), number="times_as_long", limit=Limit(1.0, "decade")),
        said="it reads {times_as_long} times as much as {reference}: most likely in another unit",
        plain=(
            "The readings are {number:.3g} times as long as those of another sensor of the vehicle: most likely "
            "they are in another unit."
        ),
        remedy="Name the unit of each sensor.",
    ),
    CatalogueRow(
        code="clock-differs",
        number="delay of the sensor's clock behind that of the reference, seconds",
        action="nothing; the delay was removed to compare them",
        rule=Rule("is_delayed", (Grade("note", 0.0),), number="delay_s", limit=Limit(0.0)),
        said=(
            "its clock is {delay_ms:.0f} ms {behind} that of {reference} (± {delay_sigma_ms:.0f} ms); the difference "
            "was removed for the comparison"
        ),
        plain="The clocks of this sensor and of another one differ by {seconds} s. The difference was removed.",
    ),
    CatalogueRow(
        code="not-together",
        number="worst heading error of a fit together with the others, degrees; 0 if there is no such fit",
        limit="1.5 times that of the sensor by itself; 0 if there is no such fit",
        action=(
            "turn the body about all its axes with all sensors running; or check the others, and their clocks: this "
            "sensor keeps its own result"
        ),
        rule=Rule("is_alone", (Grade("note", 0.0),), number="together_deg", limit=Limit(1.5, "alone_deg")),
        said="{why_alone}",
        plain=(
            "The sensor was calibrated by itself. A calibration together with the others of the vehicle would not be "
            "more accurate."
        ),
        remedy="Turn the vehicle about all of its axes, with all sensors running, and see whether their clocks agree.",
    ),
    CatalogueRow(
        code="pointing-error",
        affects="error",
        grades="limits; refuses above five times the target",
        number="error to expect of [azimuth or inclination](survey/survey.md) in the worst pose, degrees, 1 σ",
        limit="the target (`target_deg`, `--target`)",
        action="shoot the directions that the page names, with four rolls each",
        rule=Rule("pointing_deg", (Grade("limits", 1.0, "target_deg"), Grade("refuses", 5.0, "target_deg"))),
        fault=(
            "azimuth may be off by {azimuth_deg:angle} and inclination by {inclination_deg:angle} (1 σ, worst pose; "
            "the target is {target_deg:g}°)"
        ),
        said=SHOT_ADVICE,
        plain="At worst the instrument may be off by {angle}, and {limit:g}° is the target.",
        remedy="Take more shots, in other directions, with four rolls each.",
    ),
    CatalogueRow(
        code="shots-contradict",
        grades="note; limits for more than a tenth of the shots",
        number="share of [shots](survey/survey.md) that contradict the others and were left out",
        action="repeat those shots",
        rule=Rule("contradicting", (Grade("note", 0.0), Grade("limits", 0.1)), limit=Limit(0.0)),
        said=(
            "left out, as they contradict the others: {shots}. The instrument was moved or aimed elsewhere, or iron "
            "was near: repeat them"
        ),
        plain="Some shots contradict the others and were left out.",
        remedy="Repeat those shots, away from iron.",
    ),
)
