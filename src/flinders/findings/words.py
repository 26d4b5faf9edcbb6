"""Words in sentences about findings, each made from values of the finding only.

A sentence of the catalogue names values and words. A word is a function here or in `flinders.findings.sensor_words`;
its parameters are names of the finding's values. A finding that was read from a file therefore has the same sentence as
on the day of the fit.

>>> attitudes(attitude_limit_deg=34.6, target_deg=1.0, worst_deg=0.4, tilted=((90.0, 2.04), (180.0, 120.0)))
'within 1° up to 35° of tilt; 2.0° at 90°, any angle upside down'
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from flinders.core.samples import Skipped
from flinders.errors import count_text, figures
from flinders.findings.poses import POSE_WORDS
from flinders.geometry.plane import turn_axis
from flinders.summary.summary import RestSpan

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.geometry.plane import Plane

    Row = Sequence[Any]

ANY_ANGLE_DEG: Final = 90.0
"""Smallest error of a direction, in degrees, that is called any angle."""

UPSIDE_DOWN: Final = 180.0

MAX_OUTLIER_SHARE: Final = 0.1
"""Largest share of outliers that does not limit a fit."""

MAX_SKIPPED_SHARE: Final = 0.1
"""Largest share of rows without a reading that does not limit a fit."""

Z_NOT_DOWN: Final = (
    "; an accelerometer shows that z does not point down, so that the dip of the site was not used: map the axes so "
    "that z points down"
)
Z_UNKNOWN: Final = (
    "; nothing shows whether z points down or up, so that the offset of z is uncertain by twice the field along z: "
    "record an accelerometer as well, or state axes with z down"
)

SHOT_ADVICE: Final = (
    "take each shot at rest, four to a direction with a quarter turn about the laser between them, in directions all "
    "around, up and down"
)
"""Instructions for the shots of a survey instrument."""

STEPS: Final = {
    "turn-level": "turn the sensor all the way round, more than once, keeping it level",
    "record-longer": "record for longer while turning through all directions, away from iron and currents",
    "hold": "hold the sensor {} and turn it slowly once around, keeping it so",
    "as-above": "do as above",
    "use-ellipse": "the points are not equally spaced in heading; use the method 'ellipse'",
    "use-auto": "the method's model does not fit this sensor; use 'auto'",
    "use-own-state": "the recordings contradict each other; use those made in the state of use",
    "merge-others": "merge calibrations that were made in the state of use, of sensors turned through all directions",
    "add-poses": "add poses at other headings, or turn the vehicle",
}
"""Words for next steps, by name; ``hold`` takes the words of a pose."""


def angle(degrees: float) -> str:
    """Write an error in degrees; more than `ANY_ANGLE_DEG` is written as any angle.

    >>> angle(2.04), angle(120.0)
    ('2.0°', 'any angle')
    """
    return f"{figures(degrees)}°" if degrees < ANY_ANGLE_DEG else "any angle"


def capitalise(words: str) -> str:
    """Capitalise words for the start of a sentence."""
    return f"{words[:1].upper()}{words[1:]}"


def as_sentence(words: str) -> str:
    """Format words as a sentence.

    >>> as_sentence("nothing moved"), as_sentence("it moved.")
    ('Nothing moved.', 'It moved.')
    """
    return f"{capitalise(words).rstrip('.')}."


def attitudes(attitude_limit_deg: float, target_deg: float, worst_deg: float, tilted: Sequence[Row]) -> str:
    """State the tilt up to which the heading is within the target, and the errors beyond.

    `tilted`: pairs of a tilt and its worst heading error, in degrees.
    """
    if attitude_limit_deg >= UPSIDE_DOWN:
        return f"within {target_deg:g}° at any attitude"
    worse = ", ".join(f"{angle(error)} {_at(tilt)}" for tilt, error in tilted)
    if attitude_limit_deg < 1.0:
        return f"good to {angle(worst_deg)} while level; tilted, {worse}"
    return f"within {target_deg:g}° up to {attitude_limit_deg:.0f}° of tilt; {worse}"


def _at(tilt_deg: float) -> str:
    return "upside down" if tilt_deg == UPSIDE_DOWN else f"at {tilt_deg:g}°"


WHY_LARGE: Final = {
    "turn-level": "there are too few independent readings for their noise",
    "record-longer": "there are too few independent readings for their noise",
    "hold": "too few directions were recorded",
    "use-ellipse": "the method does not suit these readings",
    "use-auto": "the method does not suit these readings",
    "use-own-state": "the recordings contradict each other",
    "merge-others": "the calibrations contradict each other",
    "add-poses": "too few poses were recorded",
}
"""Reason for a large heading error, by the step that reduces it."""


def why_large(next_step: Row) -> str:
    """Reason for a large heading error. `next_step` starts with a key of `WHY_LARGE`."""
    return WHY_LARGE[next_step[0]]


def movement(next_movement: Row) -> str:
    """Next movement of the sensor.

    `next_movement` is a key of `STEPS`, followed by the number of a pose for ``hold``.
    """
    name, *poses = next_movement
    return STEPS[name].format(*(POSE_WORDS["sensor"][round(pose)] for pose in poses))


def remedy(next_step: Row) -> str:
    """Step that reduces the heading error; `next_step` has the form of `next_movement` in `movement`."""
    return movement(next_step)


def because(worst_deg: float, differ_deg: float, structure_deg: float, textbook_deg: float, is_covered: float) -> str:
    """Main part of a heading error in words; empty if it is not known.

    >>> because(1.5, math.nan, 1.4, 0.04, is_covered=True), because(1.5, math.nan, 0.0, 0.04, is_covered=True)
    (', 1.4° of it because residuals depend on the direction', ', 0.040° if residuals were independent')
    """
    if not math.isnan(differ_deg):
        return f", {figures(differ_deg)}° of it because they differ"
    if 2.0 * structure_deg**2 > worst_deg**2:
        return f", {figures(structure_deg)}° of it because residuals depend on the direction"
    is_correlated = is_of_correlation(worst_deg, textbook_deg, is_covered)
    return f", {figures(textbook_deg)}° if residuals were independent" if is_correlated else ""


def is_of_correlation(worst_deg: float, textbook_deg: float, is_covered: float) -> bool:
    """Whether a heading error is large because residuals are correlated, with all directions covered."""
    return bool(is_covered) and 2.0 * textbook_deg < worst_deg


def where_flat(breadth: float, flatness_limit: float) -> str:
    """Words for the direction that readings in one plane, or on one line, leave undetermined."""
    if breadth > flatness_limit:
        return "in one plane, as in a level turn, and tell nothing of the direction across it"
    return "on one line, as of two attitudes, and tell nothing of the directions across it"


def plane_axes(plane: str) -> str:
    """Words for the two axes of a plane."""
    return " and ".join(plane)


def where_placed(plane: Plane, is_placed: float) -> str:
    """Words for whether the offset across the plane of a turn is known."""
    return f"and, with the field of the site, {turn_axis(plane)}" if is_placed else "only"


def assumed(plane: Plane, is_placed: float, z_down: float) -> str:
    """Words for the assumed offset across the plane of a turn."""
    side = "" if z_down == 0.0 or math.isnan(z_down) else f"{turn_axis(plane)} down, and "
    return f" (with {side}the floor level unless an accelerometer was recorded)" if is_placed else ""


def where_z_points(z_down: float) -> str:
    """Words for the direction of the z axis; empty if z points down."""
    return Z_UNKNOWN if math.isnan(z_down) else "" if z_down else Z_NOT_DOWN


def mounting(is_skewed: float, is_placed: float) -> str:
    """Advice on the mounting, for a calibration whose shape across the plane is unknown."""
    return "say how well the mounting is known, or " if is_skewed and is_placed else ""


def leave(is_better: float, is_covered: float) -> str:
    """Advice on readings that were calibrated before: whether a new calibration improves them."""
    if is_better:
        return "the calibration is worth having"
    return "leave them as they are" if is_covered else "leave them as they are, or turn the sensor further"


def why_biased(plane: str) -> str:
    """Reason why the result of a method deviates from the maximum likelihood."""
    if plane:
        return "the points are not equally spaced in heading, or some are outliers; use 'ellipse'"
    return "its model is too simple for this sensor, or its equation is biased by noise; use 'auto'"


def rings(unobserved: float) -> str:
    """Words for the pattern of readings that leaves one parameter undetermined."""
    return ", as for two rings of readings" if unobserved == 1.0 else ""


def independent_readings(independent: float, samples: float) -> str:
    """Number of independent readings."""
    alike = "the others repeat them or share their errors"
    others = "" if independent == samples else f" (of {samples:,.0f}; {alike})"
    return f"{count_text(independent, 'independent reading')}{others}"


def correlation(autocorrelation: float, textbook_deg: float) -> str:
    """Words for the correlation of residuals, and for the claim that ignores it."""
    next_one = f"each with the next by {autocorrelation:.2f}" if abs(autocorrelation) >= 0.005 else ""
    claim = "" if math.isnan(textbook_deg) else f"the claim would be {figures(textbook_deg)}° if they were not"
    words = "; ".join(part for part in (next_one, claim) if part)
    return f" ({words})" if words else ""


def contradiction(
    sources: Sequence[str], apart_deg: float, offset_apart: float, unit: str, apart_beyond_claim_deg: float
) -> str:
    """Words for the deviating recording and its deviation; of two recordings both are named."""
    pair = len(sources) == 2
    who = f"{sources[0]} and {sources[1]} are" if pair else f"{sources[0]} is"
    others = "apart" if pair else "off the other recordings"
    if apart_beyond_claim_deg:
        amount = f"{figures(offset_apart)} {unit} in the offset"
        return f"{who} {figures(apart_deg)}° of heading {others} ({amount}), which is not chance"
    return f"{who} {others} by more than both claim, though hardly in heading ({figures(apart_deg)}°)"


def after_contradiction(apart_beyond_claim_deg: float) -> str:
    """Words for the consequence of a deviating recording."""
    if apart_beyond_claim_deg:
        return "something magnetic changed in between; use recordings made in the state of use"
    return "the heading error allows for it"


def halves(halves_ratio: float, drift_deg: float, drift_allowed_deg: float, target_deg: float) -> str:
    """Difference between the halves of a recording; empty if it does not limit the fit."""
    if math.isnan(halves_ratio) or not drift_allowed_deg < min(drift_deg, target_deg):
        return ""
    return f" (its halves differ by {halves_ratio:.1f} times what they claim)"


def swap(swapped_axes: str, swap_row: float, swap_count: float) -> str:
    """Words for axes that changed sign or place, with the number of the reading and the count of changes."""
    first, second = swapped_axes[0], swapped_axes[-1]
    what = f"the sign of {first} changed" if len(swapped_axes) == 1 else f"{first} and {second} changed places"
    again = f", and again {count_text(swap_count - 1.0, 'time')}" if swap_count > 1.0 else ""
    return f"{swap_row:,.0f} on, {what}{again}"


def axis_lag(late_axis: str, late_by: float, is_timed: float) -> str:
    """Words for an axis that is read later or earlier than the others.

    `late_by` is in seconds, or in readings if the recording has no times; negative for an axis that is read earlier.
    """
    amount = f"{abs(late_by) * 1000.0:.0f} ms" if is_timed else f"{abs(late_by):.2f} readings"
    return f"axis {late_axis} is read {amount} {'later' if late_by > 0.0 else 'earlier'} than the others"


def outlier_run(first: float, last: float, readings: float, start_s: float, end_s: float, independent: float) -> str:
    """A run of rejected readings: its times (without times, its rows) and its size."""
    rows = f"{readings:,.0f} readings" if readings > 1 else "a reading"
    rows += " at rest" if readings > 1 == independent else ""
    if not start_s <= end_s:  # no time, or a clock that stepped back
        return f"reading {first:.0f}" if first == last else f"readings {first:.0f}–{last:.0f}: {rows}"
    return f"{start_s:.1f} s: {rows}" if readings == 1 else f"{start_s:.1f}–{end_s:.1f} s: {rows}"


def outliers(outlier_count: float) -> str:
    """Number of readings that were left out."""
    return count_text(outlier_count, "reading")


def runs(outlier_runs: Sequence[Row], outlier_run_count: float) -> str:
    """Words for the longest runs of outliers."""
    return "; ".join(outlier_run(*run) for run in outlier_runs) + _more(outlier_runs, outlier_run_count)


def again(outlier_share: float) -> str:
    """Advice for a fit that outliers limit."""
    return "; find out what it was, and record again without it" if outlier_share > MAX_OUTLIER_SHARE else ""


def rails(rail_ends: Sequence[Row]) -> str:
    """Words for the saturated ends of axes, with their shares of the readings."""
    return ", ".join(
        f"{share:.1%} sit at the {end} value of {axis} ({value:g})" for axis, end, value, share in rail_ends
    )


def spans(rows: Sequence[Row], count: float) -> str:
    """Words for stretches of a recording, with an ellipsis if `count` is larger.

    Each row has the first and last reading, and the first and last time.
    """
    return "; ".join(span(*row) for row in rows) + _more(rows, count)


def span(first: float, last: float, start_s: float, end_s: float) -> str:
    """Words for a stretch: its times, or its readings if the recording has no times."""
    return str(RestSpan(round(first), round(last), start_s, end_s))


def _more(some: Sequence[Row], count: float) -> str:
    """An ellipsis if the list is incomplete."""
    return "; …" if count > len(some) else ""


def rests(rest_spans: Sequence[Row], rest_count: float) -> str:
    """Words for the longest rests of the sensor: their times, or their rows."""
    return spans(rest_spans, rest_count)


def rests_treated(are_rests_left_out: float) -> str:
    """Words for the treatment of rests in the fit."""
    return "are left out" if are_rests_left_out else "count as one reading each"


def often(backward_steps: float) -> str:
    """Words for the number of times that the clock stepped back."""
    return "once" if backward_steps == 1.0 else f"{backward_steps:,.0f} times"


def skipped_rows(skipped_kinds: Sequence[Row]) -> str:
    """Words for rejected rows by kind: reason, count, first line numbers, and text of the first line."""
    return "; ".join(
        str(Skipped(reason, round(rows), tuple(map(round, lines)), example))
        for reason, rows, lines, example in skipped_kinds
    )


def silent_rows(silent_kinds: Sequence[Row]) -> str:
    """Words for rows in which the sensor gave no reading, in the form of `skipped_rows`."""
    return skipped_rows(silent_kinds)


def check(skipped: float, rows: float) -> str:
    """Advice on what to check; empty if few rows were unreadable."""
    return ". Check the sensor, its cable, and what was saved" if skipped > MAX_SKIPPED_SHARE * rows else ""


def supply(silent: float, rows: float) -> str:
    """Advice on what to check; empty if the sensor seldom gave no reading."""
    return ". Check its supply and its bus, and how it is read" if silent > MAX_SKIPPED_SHARE * rows else ""


def length(corrected_length: float, unit: str) -> str:
    """Field strength of corrected readings, in words."""
    return f"{figures(corrected_length, 4)} {unit}"


def turned_short(shortfall: float, unturned_deg: float, unit: str) -> str:
    """Error if the turn had not reached the ends of the shorter axes, in words; empty if the axes are equal."""
    if not shortfall:
        return ""
    return (
        f". If the half-ranges differ only because the turn was incomplete, the offset is off by up to "
        f"{figures(shortfall)} {unit} and a level heading by up to {figures(unturned_deg)}°"
    )


def turns(planes: Sequence[str]) -> str:
    """Words for the planes of turns; an empty plane stands for no turn."""
    return ", then ".join(plane or "all attitudes" for plane in planes)


def composition(planes: Sequence[str], rotation_left_deg: float) -> str:
    """Words for the rotation that turns in one plane after another leave undetermined."""
    missing = [] if "" in planes else [plane for plane in ("xy", "yz", "zx") if plane not in planes]
    open_still = f"; not turned yet in {' and '.join(missing)}" if missing else ""
    if not {"xy", ""} & set(planes):
        return f", none of them in xy: no error is claimed for a level heading{open_still}"
    level = (
        "it does not affect a level heading, which the last turn determines"
        if planes[-1] == "xy"
        else f"it changes a level heading by up to {figures(rotation_left_deg)}°, which the heading error "
        "includes; a last turn in xy removes it"
    )
    return (
        f"{open_still}. The turns leave one rotation undetermined, of second order in the soft iron: {level}. No error "
        "is claimed for other attitudes. Turns that were recorded without a calibration can be fitted together with "
        "flinders calibrate"
    )


def dropped_words(dropped: float) -> str:
    """Words for the number of readings that a filter dropped."""
    return f", {count_text(dropped, 'reading')} dropped" if dropped else ""


def filter_effect(
    moved_deg: float, claimed_deg: float, smaller_share: float, unfiltered: str, is_to_blame: float
) -> str:
    """Effect of a filter on a calibration, in words.

    `unfiltered` is the verdict without the filter; it is empty if the unfiltered fit gave no calibration.
    """
    if not unfiltered:
        return (
            "; without the filter there is no calibration to compare with, so the effect of the filter is not known: "
            "record again, turning slowly"
        )
    size = f"{figures(abs(100 * smaller_share))}% {'smaller' if smaller_share > 0 else 'larger'}"
    moved = f": that moves the heading by {figures(moved_deg)}° at the worst and makes the field {size}"
    if is_to_blame:
        return f"{moved}; without the filter the verdict is {unfiltered}: leave --filter out, or turn more slowly"
    if moved_deg <= claimed_deg:
        return f"{moved}, less than the heading error that is claimed"
    return (
        f"{moved}, more than the claimed error of {figures(claimed_deg)}°. A filter removes spikes, but pulls the "
        "readings of a turning sensor inside the ellipsoid: turn more slowly, or leave --filter out and use 'auto', "
        "which rejects spikes"
    )


def _by_name(*functions: Callable[..., str]) -> dict[str, Callable[..., str]]:
    """Functions by their names."""
    return {function.__name__: function for function in functions}


WORDS: Final = _by_name(
    *(
        attitudes,
        movement,
        remedy,
        why_large,
        because,
        where_flat,
        plane_axes,
        where_placed,
        assumed,
        where_z_points,
        mounting,
    ),
    *(
        leave,
        why_biased,
        rings,
        independent_readings,
        correlation,
        contradiction,
        after_contradiction,
        halves,
        swap,
        axis_lag,
        outliers,
    ),
    *(runs, again, rails, rests, rests_treated, often, skipped_rows, silent_rows, check, supply, length, turned_short),
    *(turns, composition, dropped_words, filter_effect),
)
"""Words about a fit of one magnetometer, by their names in sentences."""


def value_names(word: Callable[..., str]) -> tuple[str, ...]:
    """Names of the values that a word takes.

    >>> value_names(rings)
    ('unobserved',)
    """
    code = word.__code__
    return code.co_varnames[: code.co_argcount]
