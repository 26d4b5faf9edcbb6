"""Findings about a recording, regardless of the quality of its fit."""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Needs, Rule
from flinders.findings.words import MAX_OUTLIER_SHARE, MAX_SKIPPED_SHARE

ROWS: Final = (
    CatalogueRow(
        code="alternating",
        grades="limits; refuses where it makes more than twice the target",
        number="correlation of a residual with the next",
        limit="−0.25, and four standard errors",
        action=(
            "the readings of two sensors are mixed, or something switches at the reading rate: record one sensor alone"
        ),
        rule=Rule(
            "alternating_deg",
            (Grade("limits", -1.0), Grade("refuses", 2.0, "target_deg")),
            needs=(Needs("next_correlation", "<", 1.0, "alternating_limit"),),
            number="next_correlation",
            limit=Limit(1.0, "alternating_limit"),
        ),
        fault=(
            "successive readings deviate alternately to either side (correlation {next_correlation:.2f}), by about "
            "{alternating_deg}° of heading"
        ),
        said="readings of two sensors are mixed, or something switches at the reading rate; record one sensor alone",
        plain="Successive readings deviate alternately to either side, as when the readings of two sensors are mixed.",
        remedy="Record one sensor alone.",
        alarm=True,
    ),
    CatalogueRow(
        code="outliers",
        grades="note; limits above the limit",
        number="share of the readings that do not belong to the rest and were left out",
        action=(
            "look at the rows or times that the advice names: something magnetic passed by, a cable moved, or "
            "bits were lost on the way"
        ),
        fleet_action="look for what passed by, a cable that moved, or bits lost on the way",
        rule=Rule(
            "outlier_share", (Grade("note", 0.0), Grade("limits", MAX_OUTLIER_SHARE)), limit=Limit(MAX_OUTLIER_SHARE)
        ),
        said=(
            "{outliers} ({outlier_share:.1%}), up to {farthest} {unit} off the rest, left out ({runs}): something"
            " magnetic passed by, or bits were lost on the way{again}"
        ),
        plain=(
            "Some readings do not belong to the rest ({number:.1%}) and were left out; they are listed below. "
            "Something magnetic passed by, a cable moved, or bits were lost on the way."
        ),
        remedy="Find out what happened at the times or rows listed below.",
        alarm=True,
    ),
    CatalogueRow(
        code="saturated",
        number="largest share of readings at the end of an axis' range; they are left out",
        action="choose a larger range of the sensor, or move it away from magnets",
        rule=Rule("rail_share", (Grade("limits", 0.0),), limit=Limit(0.01)),
        fault="of the readings {rails}, and are left out",
        said="choose a larger range, or move the sensor away from magnets",
        plain="The sensor was at the end of its range in {number:.1%} of the readings.",
        remedy="Choose a larger range of the sensor, or move it away from magnets, and record again.",
        alarm=True,
    ),
    CatalogueRow(
        code="quantised",
        number="coarsest step of an axis, tested if many readings share its end value and its next value",
        action="nothing: the heading error allows for it; a smaller range of the sensor has finer steps",
        rule=Rule("step", (Grade("note", 0.0),)),
        said=(
            "readings go in coarse steps of {step}, which the heading error allows for; a smaller range of the "
            "sensor, or a file with more digits, gives finer steps"
        ),
        plain="The sensor is read in coarse steps. The errors given here allow for it.",
    ),
    CatalogueRow(
        code="stale-repeats",
        number="share of the readings that equal another reading",
        action="nothing: the uncertainty counts them once; log no faster than the sensor measures",
        rule=Rule("repeated_share", (Grade("note", 0.1),)),
        said=(
            "{repeated_share:.0%} of the readings repeat another one exactly (a log faster than its sensor, coarse "
            "steps, or copied rows): the uncertainty counts them once"
        ),
        plain=(
            "{number:.0%} of the readings repeat another reading exactly: the log is faster than the sensor, the "
            "steps of the sensor are coarse, or rows were copied. Such readings count once."
        ),
    ),
    CatalogueRow(
        code="at-rest",
        number="share of readings that were made while the direction did not change",
        action="nothing: a rest counts as one reading, or as none beside a long turn",
        rule=Rule("at_rest_share", (Grade("note", 0.1),), needs=(Needs("repeated_share", "<", 0.1),)),
        said=(
            "{at_rest_share:.0%} of the readings were made at rest ({rests}): rests {rests_treated}, since the "
            "field at rest may differ from the field of the turn"
        ),
        plain=(
            "The sensor lay still during {number:.0%} of the readings. A rest counts as one reading at most, however "
            "long it lasts."
        ),
    ),
    CatalogueRow(
        code="unordered",
        number="correlation of one reading with the next, of a hundred different readings or more without times",
        action="keep the rows in the order of recording, with their times, or record again",
        rule=Rule("path_correlation", (Grade("note", 0.3),), comparison="<", needs=(Needs("distinct", ">=", 100.0),)),
        said=(
            "the readings follow no path, as if rows were sorted or shuffled: slow noise cannot be seen, and is not "
            "in the heading error; keep the order of recording"
        ),
        plain=(
            "The readings are not in the order of time, so that slow changes of their error cannot be seen. The errors "
            "given here do not allow for slow changes."
        ),
        remedy="Keep the readings in the order in which they were recorded.",
    ),
    CatalogueRow(
        code="time-back",
        number="how often the clock steps back",
        action="check the order of the recordings, and the clock",
        rule=Rule("backward_steps", (Grade("note", 0.0),)),
        said="time steps back {often}: recordings out of order, or a clock that was set",
        plain="The clock of the recording goes back (number of steps: {number:.0f}).",
        remedy="Check the order of the recordings, and the clock.",
    ),
    CatalogueRow(
        code="time-gap",
        number="longest time without a reading, seconds, tested if the clock never steps back",
        limit="twenty times the usual",
        action="nothing, unless you turned the sensor meanwhile",
        rule=Rule(
            "longest_step_s",
            (Grade("note", 20.0, "usual_step_s"),),
            needs=(Needs("backward_steps", "<", 1.0), Needs("usual_step_s", ">", 0.0)),
        ),
        said=(
            "nothing was recorded for {longest_step_s} s in one stretch (there is a reading every {usual_step_s} "
            "s on average)"
        ),
        plain="Nothing was recorded for {seconds} s in one stretch.",
    ),
    CatalogueRow(
        code="no-answer",
        affects="use",
        grades="note; limits above a tenth of the rows",
        number="readings of 0, 0, 0, of −1, or of another word that a bus returns if its sensor does not answer",
        limit="a tenth of the rows",
        action="check supply and bus, and read the sensor only when it has a new reading; such readings are left out",
        fleet_action="check the sensor's supply and bus",
        rule=Rule(
            "silent",
            (Grade("note", 0.0), Grade("limits", MAX_SKIPPED_SHARE, "rows")),
            limit=Limit(MAX_SKIPPED_SHARE, "rows"),
        ),
        said="{silent_rows}; left out{supply}",
        plain="At some readings the sensor did not answer (number of readings: {number:,.0f}). They were left out.",
        remedy="Check the sensor's wires, its supply, and how it is read.",
    ),
    CatalogueRow(
        code="like-gravity",
        number="1: columns without identifying names have gravity's length, in g, m/s² or counts of an accelerometer",
        action="give the recording of the magnetometer; if these columns are a magnetometer, name them",
        fleet_action="give recordings of the magnetometer",
        rule=Rule("is_doubtful", (Grade("limits", 0.0),)),
        said="these look like {doubt}: if a magnetometer recorded them after all, name its columns",
        hint={"columns": None},
        plain="These readings look like gravity, as an accelerometer reads it, and not like a magnetic field.",
        remedy="Use the readings of the magnetometer. If these are its readings, name their columns.",
        alarm=True,
    ),
    CatalogueRow(
        code="skipped-rows",
        affects="use",
        grades="note; limits above a tenth of the rows",
        number="rows that could not be used",
        limit="a tenth of the rows",
        action="look at the lines that the advice names; check the sensor, its cable and what was saved",
        fleet_action="check the sensor, its cable and what was saved",
        rule=Rule(
            "skipped",
            (Grade("note", 0.0), Grade("limits", MAX_SKIPPED_SHARE, "rows")),
            limit=Limit(MAX_SKIPPED_SHARE, "rows"),
        ),
        said="left out: {skipped_rows}{check}",
        plain="Some lines could not be used (number of lines: {number:,.0f}); they are named below.",
        remedy="Look at the lines that could not be used.",
    ),
)
