"""Is this calibration fit for use? `judge` looks at a fit and says what there is to know. It prints nothing.

>>> CODES["coverage"]
'directions left unseen: the middle of the largest gap is `number` degrees from the nearest reading'
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from flinders.core.compensation import beyond_words
from flinders.core.disturbance import known, motor
from flinders.core.finding import ONE_PLANE, Finding, gravest_first
from flinders.core.units import COUNTS, EARTH_UT, MICROTESLA, label
from flinders.errors import counted, figures
from flinders.fitting.result import TILTS
from flinders.geometry.plane import order_of
from flinders.heading.guidance import guide
from flinders.likelihood.identifiability import flatness_limit, is_flat
from flinders.summary.quality import RAIL_SHARE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Driver
    from flinders.core.finding import Severity
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators.regressors import Driven
    from flinders.fitting.result import Fit
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.heading.guidance import Guidance
    from flinders.summary.coverage import Coverage
    from flinders.summary.moments import Moments
    from flinders.summary.quality import Health
    from flinders.summary.summary import Summary

CODES: Final = {
    ONE_PLANE: "the readings are as flat as a level turn: thickness over width is `number`",
    "level-plane": "a level turn: the heading is within the target up to a tilt of `number` degrees",
    "heading-error": "the worst heading error to expect, `number` degrees (1 σ), is above the target",
    "coverage": "directions left unseen: the middle of the largest gap is `number` degrees from the nearest reading",
    "noise": "readings lie `number` of the field (1 σ) off the ellipsoid: not only iron and noise are at work",
    "rings": "the readings say nothing of `number` of nine parameters, as where they lie on one ring or on two",
    "prior": "the prior, not the readings, speaks for `number` of the least known shape parameter",
    "bias": "the method's own bias and misfit, estimated beside the likelihood, is `number` degrees of heading (rms)",
    "inflation": "the ellipsoid found is `number` times as wide as the readings that it goes through",
    "recordings-differ": "recordings of one sensor contradict each other: one is `number` degrees off the others",
    "field-changed": "the offset changed during the recording: `number` degrees of heading from beginning to end",
    "slipped-axes": "with axes put right from some moment on, readings lie `number` times closer to an ellipsoid",
    "structure": "residuals belong to the direction: `number` of the field that no ellipsoid takes off",
    "few-samples": "only `number` independent readings",
    "correlated": "residuals hang together: `number` is the share of readings that are independent",
    "alternating": "a residual correlates with the next by `number`, as where readings of two sensors take turns",
    "strays": "`number` of the readings do not belong to the rest and were left out",
    "saturated": "`number` of the readings sit at the very end of an axis: the sensor was at its limit",
    "stale-repeats": "`number` of the readings repeat the one before: the log is faster than its sensor",
    "time-back": "time goes back `number` times",
    "time-gap": "nothing was recorded for `number` seconds in one stretch",
    "skipped-rows": "`number` rows could not be used",
    "typed-extremes": "no readings, only typed extremes: a turn that missed ends costs `number` degrees of heading",
    "driver": "following a driver takes away `number` degrees of heading at the far end of its recorded range",
    "driver-unfollowed": "a driver was recorded and not asked for, and moves the heading by `number` degrees",
    "driver-constant": "a driver that was asked for hardly changed: its range is `number`",
    "driver-entangled": "`number` of what tells about a driver could be the attitude as well",
    "driver-alike": "drivers rise and fall together: `number` of the course of one follows from the others",
    "driver-one-way": "`number` of a driver's course goes one way: an offset that drifts would look the same",
    "driver-noisy": "meters of drivers are noisy: the offset per unit of one is `number` too small",
    "driver-lag": "the end of the search for a lag, `number` seconds, is best",
    "driver-range": "a driver was recorded at `number`, which its unit or its sign hardly allows",
    "driver-reference": "the offset is told for a reference `number` of a driver's range outside of that range",
    "driver-curved": "what a driver makes is off a straight line by `number` of itself",
    "driver-beyond": "a driver goes `number` of its range beyond what the calibration was made at",
    "bench-moved": "the sensor on the bench moved: what drivers leave makes a step of `number`",
    "bench-tilted": "the vertical turned by `number` degrees with what drives the sensor on the bench",
    "driver-uncertain": "a driver leaves `number` degrees of heading (1 σ) at the far end of its recorded range",
    "composed": "turns in one plane after the other leave a rotation, which costs a level heading `number` degrees",
    "filtered": "the filter that readings went through moved the heading by `number` degrees at the worst",
    "axis-ratio": "the longest axis of the ellipsoid is `number` times the shortest",
    "field-strength": "the field found, `number` µT, is not one of the earth's",
    "circular-attitude": "the yaw of the attitude has the `number` degrees of deviation of an uncorrected compass",
    "gyro-unit": "the rate fits `number` times better in another unit than rad/s",
    "gyro-differs": "the gyro leaves `number` of how far the field moves, in whatever unit and axes",
    "gyro-clipped": "`number` of the readings have a gyro at its limit",
    "gyro-scales": "the scales of the gyro would be off by `number`, more than those of gyros are",
    "gyro-gaps": "`number` of the readings have no rate, and were given that of their neighbours",
    "aids-disagree": "beside an aid the scales of the gyro would be off by `number`, and without it they are not",
    "aid-astray": "a vertical or an attitude is `number` degrees (1 σ) off what the field says",
    "aid-empty": "only `number` readings have what an aid goes by",
    "swapped-axes": "an instrument fits `number` times better with its axes exchanged",
    "one-axis": "the body turned about one axis: about the second `number` as much",
    "site-differs": "the field dips by `number` degrees more or less than the site's",
    "departs": "the sensor departs from the others of its body for a while: by `number` degrees of heading",
    "departs-throughout": "the sensor is `number` degrees of heading off the others of its body all the time",
    "disagree": "sensors of one body are `number` degrees of heading apart; which is off is not told",
    "copied-sensor": "the readings are those of another sensor, turned and scaled, to `limit` of their noise",
    "mirrored-sensor": "the axes are a mirror image of those of another sensor of the body",
    "turned-to": "corrected readings are in the axes of another sensor, known to `number` degrees",
    "unlike-units": "the readings are `number` times as long as those of another sensor of the body",
    "clock-differs": "the clock is `number` seconds behind that of another sensor of the body",
    "not-together": "the sensor has what it finds by itself: with the others of its body it is open, or known worse",
    "mirrored-axes": "the axes mapping turns a right-handed frame into a left-handed one",
    "unit-unknown": "the readings are in counts of which nobody said what they are in µT",
    "scale-unknown": "no field strength was given, so the scale of corrected readings is by convention",
    "rotation-uncertain": "what is not known of how the sensor sits adds `number` degrees (1 σ) to a level heading",
    "rotation-unknown": "a magnetometer alone cannot see how its axes are turned against the vehicle",
}
"""Every finding there is, and what its number means."""

OF_THE_RECORDING: Final = frozenset({"saturated", "stale-repeats", "time-back", "time-gap", "skipped-rows"})
"""Findings that hold whatever the fit is worth, and may be the reason why it is worth nothing."""

REFUSED_AT: Final = 5.0
"""A worst heading error beyond so many times the target is refused."""

HOLE_DEG: Final = 60.0
WORTH_IT: Final = 0.05
"""Share of the error that a hundredth of the readings must save where they are advised for one attitude to be named."""

NOISE_LIMITS, NOISE_REFUSES = 0.05, 0.2
PRIOR_SHARE: Final = 0.1
BIAS_SHARE: Final = 0.1
INFLATED: Final = 2.0
PLACED, SKEWED = 0.5, 0.15
"""Of the field: an offset across a level turn is known, a shape across it is not."""
FAR_APART: Final = 2.0
"""Recordings that are so many targets apart are refused: their mean is off by more than the target from either."""

BEYOND_CHANCE: Final = 0.01
BEYOND_CLAIM: Final = 3.0
CHANGED: Final = 1e-4
CHANGED_SHARE: Final = 0.25
SLIPPED: Final = 1.1
"""Times closer to an ellipsoid: `flinders.diagnostics.axis_swap` tells nothing below it."""
STRUCTURE: Final = 0.005
FEW: Final = 20
CORRELATED: Final = 0.5
ALTERNATING: Final = -0.25
"""Correlation of a residual with the next that neither noise has nor what changes slowly."""
STRAYS: Final = 0.1
ENTANGLED: Final = 0.95
ONE_WAY: Final = 0.95
"""Share of the course of a driver that a monotone function of time explains, beyond which a drift would look alike."""
UNFOLLOWED: Final = 0.5
"""Of the target: a driver that moves the heading by less is left unsaid."""
NOISY: Final = 0.02
"""Share by which an offset per unit may be too small."""
OUTSIDE: Final = 0.25
"""Of the range of a driver: its reference may lie so far outside of that."""
CURVED: Final = 0.03
"""Share by which what a driver makes may be off a straight line."""
REPEATS: Final = 0.1
SKIPPED: Final = 0.1
LONG_STEP: Final = 20.0
AXIS_RATIO: Final = 2.0
NOTED: Final = frozenset({"one-axis", "gyro-gaps"})
"""Mistakes that are limits of a recording and cost what the heading error says."""

OTHER_UNIT: Final = 1.5
"""Times outside of that which neither soft iron nor the gain of a sound sensor makes: the unit is another."""

UPSIDE_DOWN: Final = 180.0


def of_drivers(fit: Fit) -> Iterator[Finding]:
    """What there is to know of each thing that the offset follows."""
    yield from of_alike(fit.driven)
    yield from of_noisy(fit.driven)
    family = [driven.name for driven in fit.driven if driven.driver is not None and motor(driven.name)[1]]
    for driven in fit.driven:
        driver = driven.driver
        if driver is None:
            least = known(driven.name)
            yield Finding(
                "driver-constant", "limits", 0.0, least.least,
                f"{driven.name} hardly changed (by less than {least.least:g}{least.unit}), so that nothing can be told "
                "of what it does: vary it over its whole range while turning the sensor",
            )  # fmt: skip
            continue
        at = f"at {driver.amount(driver.farthest)}"
        running = ", the other motors running along as they did then" if family[1:] and driver.name in family else ""
        noise = "" if fit.noise_undriven is None else (
            f"; without, readings lie {figures(fit.noise_undriven)} off instead of {figures(fit.noise)}"
        )  # fmt: skip
        yield Finding(
            "driver", "note", driven.taken_deg, 0.0,
            f"the offset follows {driver} ({label(fit.calibration.unit)}): that takes away up to "
            f"{figures(driven.taken_deg)}° of heading {at}, {figures(driven.left_deg)}° of it left "
            f"(1 σ{running}){noise}",
        )  # fmt: skip
        if driven.left_deg > fit.target_deg:
            yield Finding(
                "driver-uncertain", "limits", driven.left_deg, fit.target_deg,
                f"{at} the heading may be off by {figures(min(driven.left_deg, 180.0))}° (1 σ; the target is "
                f"{fit.target_deg:g}°) from what is not known of {driver.name}: vary it while turning the sensor "
                "through all directions",
            )  # fmt: skip
        if driven.shared > ENTANGLED:
            yield Finding(
                "driver-entangled", "limits", driven.shared, ENTANGLED,
                f"{driven.shared:.1%} of what tells about {driver.name} could be the attitude as well: vary it in each "
                "attitude, not in step with the turning",
            )  # fmt: skip
        yield from of_column(driven, unsaid_deg=UNFOLLOWED * fit.target_deg)


def of_alike(driven: Sequence[Driven]) -> Iterator[Finding]:
    """Whether drivers went along with each other, so that what one does cannot be told from what another does."""
    together = [one for one in driven if one.alike > ENTANGLED]
    if together:
        names, most = ", ".join(one.name for one in together), max(one.alike for one in together)
        yield Finding(
            "driver-alike", "limits", most, ENTANGLED,
            f"{names} rose and fell together ({most:.1%} of the course of one follows from the others): what they do "
            "together is known, and what each does hardly, beyond what was thought likely before; use the calibration "
            "where they go along as in the recording, follow one of them alone, or vary each by itself",
        )  # fmt: skip


def of_noisy(driven: Sequence[Driven]) -> Iterator[Finding]:
    """Whether meters of drivers are noisy: one finding for all of them."""
    noisy = [one for one in driven if one.driver is not None and one.attenuation > NOISY]
    if noisy:
        names, most = ", ".join(one.name for one in noisy), max(one.attenuation for one in noisy)
        what = "its meter is noisy, and what was found of it is" if len(noisy) == 1 else (
            "their meters are noisy, and what was found of each is, by its own course,"
        )  # fmt: skip
        least = min(one.attenuation for one in noisy)
        share = f"{most:.0%}" if f"{least:.0%}" == f"{most:.0%}" else f"{100.0 * least:.0f} to {most:.0%}"
        yield Finding(
            "driver-noisy", "limits", most, NOISY,
            f"readings do not follow fast changes of {names}: {what} about {share} too small; log "
            f"{'a smoother ' + names if len(noisy) == 1 else 'them smoother'}, or hold each setting for longer",
        )  # fmt: skip


def of_column(driven: Driven, *, unsaid_deg: float = 0.0) -> Iterator[Finding]:
    """Whether what was logged of a driver is fit to be followed; of a turned sensor or of one on a bench.

    A curve that costs less heading than `unsaid_deg` is left unsaid.
    """
    driver, name = driven.driver, driven.name
    if driver is None:
        return
    if driven.one_way > ONE_WAY:
        yield Finding(
            "driver-one-way", "limits", driven.one_way, ONE_WAY,
            f"{name} only went one way while this was recorded: an offset that drifts, or a sensor that moved, would "
            f"look the same; let {name} go up and down again while recording",
        )  # fmt: skip
    if driven.lag_is_beyond:
        yield Finding(
            "driver-lag", "limits", driver.lag_s, 1.0,
            f"readings follow {name} best at the end of the search for a lag ({driver.lag_s:+.2g} s): its clock is off "
            f"by more than a second, or it is not what moves the readings; check the times of the column {name}",
        )  # fmt: skip
    other = "record the current instead, which the field follows, or " if motor(name)[0] == "throttle" else ""
    if driven.curvature > CURVED and driven.curvature * driven.taken_deg >= unsaid_deg:
        yield Finding(
            "driver-curved", "limits", driven.curvature, CURVED,
            f"what {name} makes is off a straight line by {driven.curvature:.0%} of itself: the sensor follows its "
            f"square, or something that goes along with {name}; {other}use the calibration near the {name} at "
            "which most was recorded",
        )  # fmt: skip
    yield from _of_range(driver)
    yield from _of_reference(driver)


def _of_reference(driver: Driver) -> Iterator[Finding]:
    """Whether the offset is told for where the driver never was."""
    if not driver.has_range:
        return
    outside = max(driver.lowest - driver.reference, driver.reference - driver.highest)
    share = outside / (driver.highest - driver.lowest)
    if share > OUTSIDE:
        straight = motor(driver.name)[0] == "current"  # a field goes in proportion to the current that makes it
        yield Finding(
            "driver-reference", "note" if straight else "limits", share, OUTSIDE,
            f"the offset is told for {driver.amount(driver.reference)} of {driver.name}, and it was recorded from "
            f"{driver.lowest:.3g} to {driver.amount(driver.highest)}: there it is extrapolated along a straight line, "
            f"by {share:.0%} of that range; record with {driver.amount(driver.reference)} as well, or use the "
            "calibration in that range alone",
        )  # fmt: skip


def _of_range(driver: Driver) -> Iterator[Finding]:
    """Whether values of a driver can be in its unit, and count in its direction."""
    low, high = driver.kind.plausible
    far = max(driver.lowest, driver.highest, key=abs)
    if not low <= far <= high:
        yield Finding(
            "driver-range", "limits", far, high if far > high else low,
            f"{driver.name} was recorded at up to {driver.amount(far)}: it is in another unit than {driver.kind.per}; "
            f"convert the column, or what is exported is off by as much",
        )  # fmt: skip
    elif motor(driver.name)[0] == "current" and -driver.lowest > max(driver.highest, driver.kind.least):
        yield Finding(
            "driver-range", "limits", driver.lowest, 0.0,
            f"{driver.name} was recorded from {driver.lowest:.3g} to {driver.amount(driver.highest)}: what is drawn "
            "counts negative there, and positive for autopilots; turn the sign of the column round",
        )  # fmt: skip


def of_extrapolation(calibration: Calibration, beyond: Mapping[str, float]) -> Iterator[Finding]:
    """What lies beyond the range that a driver was found in, by `beyond` of `flinders.core.compensation.Settler`.

    Examples
    --------
    >>> from flinders.core.calibration import Calibration
    >>> from flinders.core.disturbance import Driver
    >>> motors = Driver("current", [0.5, 0.0, 0.0], highest=20.0)
    >>> followed = Calibration(np.eye(3), [0.0, 0.0, 0.0], 50.0, drivers=(motors,))
    >>> [(finding.code, finding.number) for finding in of_extrapolation(followed, {"current": 0.25})]
    [('driver-beyond', 0.25)]
    """
    for driver in calibration.drivers:
        share = beyond.get(driver.name, 0.0)
        if share > 0.0:
            yield Finding("driver-beyond", "limits", share, 0.0, beyond_words(driver, share))


def judge(fit: Fit, summary: Summary) -> tuple[Finding, ...]:
    """Say what there is to know about a fit, gravest first.

    Parameters
    ----------
    fit : Fit
        Without findings yet.
    summary : Summary
        Of the recording it came from.
    """
    flat = list(_flat(fit, summary.moments))  # what follows from a surface that nothing supports is no finding
    supported = (
        []
        if flat
        else [
            *_level(fit),
            *_accuracy(fit),
            *_seated(fit),
            *_bias(fit),
            *_evidence(fit),
            *_inflation(fit, summary.health),
            *_change(fit),
            *_aids(fit),
            *_mixed(fit),
            *_strays(fit, summary.health),
            *of_drivers(fit),
            *of_calibration(fit),
        ]
    )
    found = [*flat, *supported, *_recording(summary.health)]
    return gravest_first(found)


def _flat(fit: Fit, moments: Moments) -> Iterator[Finding]:
    """Whether the readings lie in one plane: then any number of ellipsoids goes through their ring."""
    thickness, _, width = np.sqrt(moments.principal_variances).tolist()
    if not fit.plane and is_flat(moments.principal_variances, fit.noise):
        yield Finding(
            ONE_PLANE, "refuses", thickness / width, flatness_limit(width, fit.noise),
            "all readings lie in one plane, as in a level turn, and tell nothing of the direction across it: "
            "also turn the sensor about its other axes, onto its side and upside down. Of a turn about the vertical "
            "axis of a vehicle that cannot be turned over, map that axis to z with --axes",
        )  # fmt: skip


Z_ELSEWHERE: Final = (
    "; an accelerometer shows that z does not point down, so that the dip of the site was left out: map the axes so "
    "that it does (--axes)"
)
Z_OPEN: Final = (
    "; nothing shows whether z points down or up, so that its offset is open by twice the field along it: record an "
    "accelerometer as well, or map the axes so that z points down (--axes, x,y,z where it does already)"
)


def _level(fit: Fit) -> Iterator[Finding]:
    """What a turn in one plane is good for."""
    if fit.plane:
        first, second = fit.plane
        across = order_of(fit.plane)[2]
        placed, radius = fit.offset_sigma[across] < PLACED * fit.ellipsoid.radius, fit.ellipsoid.radius
        how = f"and in {'xyz'[across]} by the site's field" if placed else "only"
        side = f"{'xyz'[across]} down, and " if fit.z_down else ""
        taken = f" (with {side}the floor level unless an accelerometer was recorded)" if placed else ""
        up = "" if fit.z_down else Z_OPEN if fit.z_down is None else Z_ELSEWHERE
        skewed = float(np.sqrt(np.diag(fit.covariance)[[6, 7, 8]].max())) > SKEWED * radius
        mounting = "say how well the mounting is known (--alignment-sigma), or " if placed and skewed else ""
        yield Finding(
            "level-plane", "limits", fit.attitude_limit_deg, UPSIDE_DOWN,
            f"a level turn, corrected in {first} and {second} {how}{taken}, for places where the field dips as here: "
            f"{attitudes(fit)}; {figures(fit.per_degree_of_tilt)}° for each degree from the plane that it was turned "
            f"in{up}. For all attitudes {mounting}also turn the sensor onto its sides and upside down",
        )  # fmt: skip


def _accuracy(fit: Fit) -> Iterator[Finding]:
    """What the covariance says about heading."""
    worst, target = fit.heading_error_deg.worst, fit.target_deg
    if not worst <= target:
        severity: Severity = "limits" if worst <= REFUSED_AT * target else "refuses"
        amount = _angle(worst)
        yield Finding(
            "heading-error", severity, worst, target,
            f"the heading may be off by {amount} (1 σ, worst heading; the target is {target:g}°): {remedy(fit)}",
        )  # fmt: skip


def _seated(fit: Fit) -> Iterator[Finding]:
    """Whether how the sensor sits on the body, which an aid has found, is known well enough.

    It never refuses: without that aid the rotation is not known at all, which is a note.
    """
    error, target = fit.alignment_error_deg, fit.target_deg
    if fit.calibration.rotation == "estimated" and error is not None and error > target:
        yield Finding(
            "rotation-uncertain", "limits", error, target,
            f"how the sensor sits on the body was found, and what is not known of it adds {_angle(error)} to a level "
            f"heading (1 σ; the target is {target:g}°), which the heading error does not know of: tilt the body far "
            "about two axes while recording, say how well the accelerometer is calibrated (--accelerometer-bias), or "
            "calibrate without aids and measure the mounting",
        )  # fmt: skip


def _bias(fit: Fit) -> Iterator[Finding]:
    """What a simpler model or a biased equation costs."""
    if fit.bias_deg > fit.target_deg * BIAS_SHARE:
        severity: Severity = "limits" if fit.bias_deg > fit.target_deg else "note"
        why = (
            "the points are not equally spaced in heading, or some do not belong; use 'ellipse'"
            if fit.plane
            else "its model is too simple for this sensor, or its equation is biased by noise; use 'auto'"
        )
        yield Finding(
            "bias", severity, fit.bias_deg, fit.target_deg * BIAS_SHARE,
            f"{fit.method!r} is {figures(fit.bias_deg)}° of heading (rms) off the likelihood, beyond what chance "
            f"explains: {why}",
        )  # fmt: skip


def _evidence(fit: Fit) -> Iterator[Finding]:
    """How much there was to go by."""
    hole = fit.coverage.hole_deg
    if hole > HOLE_DEG and not fit.plane:
        yield Finding(
            "coverage", "limits", hole, HOLE_DEG,
            f"directions up to {hole:.0f}° from any reading are unseen ({fit.coverage.fraction:.0%} of the sphere was "
            f"covered): {attitudes(fit)}; to be sure of all attitudes, {movement(fit)}",
        )  # fmt: skip
    share = fit.noise / fit.ellipsoid.radius
    if share > NOISE_LIMITS:
        yield Finding(
            "noise", "limits" if share <= NOISE_REFUSES else "refuses", share, NOISE_LIMITS,
            f"the readings lie {share:.0%} of the field off the ellipsoid: record again away from iron and currents, "
            "without moving anything magnetic near the sensor, and check the columns",
        )  # fmt: skip
    if fit.plane:
        pass  # what a level turn leaves open is said once
    elif fit.unseen:
        rings = ", as two rings of readings would" if fit.unseen == 1 else ""
        yield Finding(
            "rings", "limits", fit.unseen, 0,
            f"the readings leave {fit.unseen} of nine parameters open{rings}, and the prior holds them: "
            "turn the sensor about all three of its axes",
        )  # fmt: skip
    elif fit.held > PRIOR_SHARE:
        yield Finding(
            "prior", "limits", fit.held, PRIOR_SHARE,
            f"part of the shape rests to {fit.held:.0%} on the prior that soft iron is mild: {movement(fit)}",
        )  # fmt: skip
    independent = min(fit.independent_samples, float(fit.samples))
    if independent < FEW:
        alike = "" if independent == fit.samples else f" (of {fit.samples:,} whose residuals hang together)"
        yield Finding(
            "few-samples", "limits", independent, FEW,
            f"only {counted(independent, 'independent reading')}{alike}: record for longer, turning all the time",
        )  # fmt: skip
    elif independent < CORRELATED * fit.samples:
        yield Finding(
            "correlated", "note", independent / fit.samples, CORRELATED,
            f"residuals hang together{_told(fit)}: {fit.samples:,} readings say as much as {independent:,.0f} "
            "independent ones would, and the heading error allows for it. Usual for a tumble by hand; less of it away "
            "from iron",
        )  # fmt: skip


def _told(fit: Fit) -> str:
    """How much residuals have in common, and what it would be to take no notice of it."""
    next_one = "" if fit.autocorrelation is None else f"each with the next by {fit.autocorrelation:.2f}"
    textbook = fit.textbook_heading_error_deg
    claim = "" if textbook is None else f"without regard to it {figures(textbook.worst)}° would be claimed"
    told = "; ".join(part for part in (next_one, claim) if part)
    return f" ({told})" if told else ""


def _inflation(fit: Fit, health: Health) -> Iterator[Finding]:
    """Whether the surface goes far beyond its readings, as one does that a small patch of them leaves open."""
    if fit.plane:
        return
    ratio = 2.0 * float(fit.ellipsoid.semi_axes[2]) / max(float(health.extent.max()), np.finfo(float).tiny)
    if ratio > INFLATED:
        yield Finding(
            "inflation", "limits", ratio, INFLATED,
            f"the ellipsoid is {figures(ratio)} times as wide as its readings, which lie on a small patch of it: "
            f"{movement(fit)}",
        )  # fmt: skip


def _change(fit: Fit) -> Iterator[Finding]:
    """Whether something changed, from one recording to the next, within one, or with the direction."""
    if fit.repeats is not None:
        yield from contradiction(fit.repeats, fit.target_deg, label(fit.calibration.unit))
    drift, target = fit.drift, fit.target_deg
    if drift is not None and drift.p_value < CHANGED and drift.heading_deg > CHANGED_SHARE * target:
        moved = float(np.linalg.norm(drift.offset))
        yield Finding(
            "field-changed", _graded(drift.heading_deg, target, REFUSED_AT * target), drift.heading_deg, target,
            f"the offset changed by {figures(moved)} {label(fit.calibration.unit)} from the beginning of the recording "
            f"to its end, {figures(drift.heading_deg)}° of heading: keep currents and everything magnetic as they "
            "will be, let the sensor warm up, and record again",
        )  # fmt: skip
    yield from _slipped(fit)
    yield from _left_alone(fit)
    share = fit.distortion / fit.ellipsoid.radius
    if share > STRUCTURE:
        yield Finding(
            "structure", "limits" if fit.structure_deg > target else "note", share, STRUCTURE,
            f"{share:.1%} of the field belongs to the direction and no ellipsoid takes it off, "
            f"{figures(fit.structure_deg)}° of heading, which the heading error allows for: the sensor is not linear, "
            "near the end of its range, or the field not the same everywhere; record away from iron, check the range",
        )  # fmt: skip


def _slipped(fit: Fit) -> Iterator[Finding]:
    """Whether axes changed their sign or their place while this was recorded."""
    slip = fit.slip
    if slip is None:
        return
    letters = slip.axes
    what = f"the sign of {letters} turned" if len(letters) == 1 else f"{letters[0]} and {letters[1]} changed places"
    others = len(slip.rows) - 1
    again = f" and back and forth, {counted(others, 'time')} more" if others else ""
    yield Finding(
        "slipped-axes", "limits", slip.gain, SLIPPED,
        f"from reading {slip.rows[0] + 1:,} on {what}{again}: put right, the readings lie {figures(slip.gain)} times "
        "closer to an ellipsoid; find out what the driver did then, and record again",
    )  # fmt: skip


def _left_alone(fit: Fit) -> Iterator[Finding]:
    """Whether readings follow something that was recorded beside them, and the calibration does not."""
    found = fit.unfollowed
    if found is None or found.heading_deg <= UNFOLLOWED * fit.target_deg:
        return
    yield Finding(
        "driver-unfollowed", "limits", found.heading_deg, UNFOLLOWED * fit.target_deg,
        f"readings follow the {found.name} that was recorded with them, by up to {figures(found.heading_deg)}° of "
        f"heading, which the heading error does not know of: calibrate with drivers {found.name} "
        f"(--with {found.name}), or record without",
    )  # fmt: skip


def _mixed(fit: Fit) -> Iterator[Finding]:
    """Whether readings of two sensors take turns, whose mean is neither's calibration."""
    found = 0.0 if fit.autocorrelation is None else fit.autocorrelation
    limit = min(ALTERNATING, -4.0 / math.sqrt(max(fit.samples, 1)))
    if found >= limit:
        return
    off = math.sqrt(-3.0 * found) * fit.noise  # of which a residual shows the part along the surface's normal
    level = fit.ellipsoid.radius * math.cos(math.radians(fit.heading_error_deg.dip_deg))
    off_deg = math.degrees(math.atan2(off, level))
    yield Finding(
        "alternating", "refuses" if off_deg > FAR_APART * fit.target_deg else "limits", found, limit,
        f"what one reading is off, the next is off the other way (correlation {found:.2f}), by about "
        f"{figures(off_deg)}° of heading: readings of two sensors are mixed, or something switches as fast as is read; "
        "record one sensor alone",
    )  # fmt: skip


def contradiction(repeats: Repeats, target_deg: float, unit: str) -> Iterator[Finding]:
    """Whether recordings of one sensor contradict each other, told by the one that chance explains least."""
    part = repeats.farthest
    if part.p_value >= BEYOND_CHANCE:
        return
    pair = len(repeats.parts) == 2
    who = f"{repeats.parts[0].source} and {repeats.parts[1].source} are" if pair else f"{part.source} is"
    others = "apart" if pair else "off the other recordings"
    if part.off_deg > max(CHANGED_SHARE * target_deg, BEYOND_CLAIM * part.off_sigma_deg):
        yield Finding(
            "recordings-differ", _graded(part.off_deg, target_deg, FAR_APART * target_deg), part.off_deg, target_deg,
            f"{who} {figures(part.off_deg)}° of heading {others} ({figures(part.offset)} {unit} in the offset), which "
            "is not chance: something magnetic changed in between; use recordings made in the state of use",
        )  # fmt: skip
    else:
        yield Finding(
            "recordings-differ", "note", part.off_deg, target_deg,
            f"{who} {others} by more than both claim, though hardly in heading ({figures(part.off_deg)}°): the heading "
            "error allows for it",
        )  # fmt: skip


def _graded(number: float, limits: float, refuses: float) -> Severity:
    """How grave a number is."""
    return "refuses" if number > refuses else "limits" if number > limits else "note"


def attitudes(fit: Fit) -> str:
    """Say up to which tilt the heading is within the target, and how fast it degrades beyond."""
    limit, target = fit.attitude_limit_deg, fit.target_deg
    if limit >= UPSIDE_DOWN:
        return f"within {target:g}° at any attitude"
    beyond = [tilt for tilt in (*TILTS, UPSIDE_DOWN) if tilt > limit]
    worse = [f"{_angle(fit.tilted_error(tilt).worst)} {_at(tilt)}" for tilt in dict.fromkeys((beyond[0], beyond[-1]))]
    if limit < 1.0:
        return f"good to {_angle(fit.heading_error_deg.worst)} held level; tilted, {', '.join(worse)}"
    return f"within {target:g}° up to {limit:.0f}° of tilt; {', '.join(worse)}"


def _at(tilt: float) -> str:
    return "upside down" if tilt == UPSIDE_DOWN else f"at {tilt:g}°"


def _angle(angle: float) -> str:
    return f"{figures(angle)}°" if angle < 90.0 else "any angle"


def _aids(fit: Fit) -> Iterator[Finding]:
    """What does not fit together among the instruments."""
    for mistake in () if fit.aids is None else fit.aids.mistakes:
        severity: Severity = "note" if mistake.code in NOTED else "limits"
        yield Finding(mistake.code, severity, mistake.number, mistake.limit, mistake.words)


def _strays(fit: Fit, health: Health) -> Iterator[Finding]:
    """What a robust fit left out: the strays, and the readings around their runs."""
    if not fit.strays:
        return
    rejected = sum(stray.rows for stray in fit.strays)
    share = rejected / health.rows
    worst = sorted(fit.strays, key=lambda stray: -stray.rows)[:3]
    runs = "; ".join(str(stray) for stray in worst) + ("; …" if len(fit.strays) > len(worst) else "")
    farthest = max(stray.farthest for stray in fit.strays)
    off = f"{figures(farthest)} {label(fit.calibration.unit)}"
    again = "; see what it was, and record again without" if share > STRAYS else ""
    yield Finding(
        "strays", "limits" if share > STRAYS else "note", share, STRAYS,
        f"{counted(rejected, 'reading')} ({share:.1%}), up to {off} off the rest, left out ({runs}): "
        f"something magnetic passed by, or bits were lost on the way{again}",
    )  # fmt: skip


def _recording(health: Health) -> Iterator[Finding]:
    """What the recording says about itself."""
    for rail in health.rails:
        yield Finding(
            "saturated", "limits", rail.share, RAIL_SHARE,
            f"{rail.share:.1%} of the readings sit at the {rail.end} value of {'xyz'[rail.axis]} ({rail.value:g}) and "
            "are left out: choose a larger range, or move the sensor away from magnets",
        )  # fmt: skip
    repeats = health.repeats / max(health.rows, 1)
    if repeats > REPEATS:
        yield Finding(
            "stale-repeats", "note", repeats, REPEATS,
            f"{repeats:.0%} of the readings repeat the one before (the log is faster than its sensor): "
            "the uncertainty counts them once",
        )  # fmt: skip
    yield from _time(health)
    skipped, few = sum(part.rows for part in health.skipped), SKIPPED * health.rows
    if skipped:
        check = ". Check the sensor, its cable, and what was saved" if skipped > few else ""
        yield Finding(
            "skipped-rows", "limits" if skipped > few else "note", skipped, few,
            f"left out: {'; '.join(map(str, health.skipped))}{check}",
        )  # fmt: skip


def _time(health: Health) -> Iterator[Finding]:
    """Steps back; or, where there are none, the longest time without a reading."""
    clock = health.clock
    if clock.backward_steps:
        often = "once" if clock.backward_steps == 1 else f"{clock.backward_steps:,} times"
        yield Finding(
            "time-back", "note", clock.backward_steps, 0,
            f"time steps back {often}: recordings out of order, or a clock that was set",
        )  # fmt: skip
        return
    usual = clock.usual_step
    if clock.longest_step > LONG_STEP * usual > 0.0:
        yield Finding(
            "time-gap", "note", clock.longest_step, LONG_STEP * usual,
            f"nothing was recorded for {figures(clock.longest_step)} s in one stretch "
            f"(there is a reading every {figures(usual)} s on average)",
        )  # fmt: skip


class Corrected(Protocol):
    """What has a calibration in it: a fit, or calibrations put together."""

    @property
    def calibration(self) -> Calibration:
        """The correction."""

    @property
    def ellipsoid(self) -> Ellipsoid:
        """What it makes a sphere."""


def of_calibration(found: Corrected) -> Iterator[Finding]:
    """Say what the calibration alone tells, whatever it was made from."""
    yield from _shape(found)
    yield from _unknowable(found)


def _shape(fit: Corrected) -> Iterator[Finding]:
    """Whether the ellipsoid is one that a sensor in the earth's field makes."""
    axes = fit.ellipsoid.semi_axes
    ratio = float(axes[2] / axes[0])
    if ratio > AXIS_RATIO:
        yield Finding(
            "axis-ratio", "limits", ratio, AXIS_RATIO,
            f"one axis reads {figures(ratio)} times as much as another: check the axes' gains and the columns",
        )  # fmt: skip
    strength, known = fit.ellipsoid.radius, fit.calibration.field_strength_known
    if fit.calibration.unit == MICROTESLA and not known and not EARTH_UT[0] <= strength <= EARTH_UT[1]:
        nearest = min(max(strength, EARTH_UT[0]), EARTH_UT[1])
        other = max(strength / nearest, nearest / strength) > OTHER_UNIT
        yield Finding(
            "field-strength", "limits" if other else "note", strength, nearest,
            f"a field of {figures(strength, 3)} µT is outside the earth's {EARTH_UT[0]:g}–{EARTH_UT[1]:g} µT: "
            "check the unit or scale; headings do not depend on it",
        )  # fmt: skip
    if fit.calibration.axes.is_mirror:
        yield Finding(
            "mirrored-axes", "limits", -1, 1,
            f"the axes mapping {fit.calibration.axes} is a mirror image, right only for a left-handed sensor: "
            "else change the sign of one axis in --axes",
        )  # fmt: skip


def _unknowable(fit: Corrected) -> Iterator[Finding]:
    """What no recording of a magnetometer alone can tell."""
    calibration = fit.calibration
    length = f"{figures(calibration.field_strength, 4)} {label(calibration.unit)}"
    if calibration.unit == COUNTS:
        yield Finding(
            "unit-unknown", "note", calibration.field_strength, 0,
            "no unit known, so all is in counts: give --unit, or --scale (µT in a count)",
        )  # fmt: skip
    if not calibration.field_strength_known:
        yield Finding(
            "scale-unknown", "note", calibration.field_strength, 0,
            f"no field strength given: lengths ({length}) are relative, headings are not",
        )  # fmt: skip
    if calibration.rotation == "symmetric":
        yield Finding(
            "rotation-unknown", "note", 0, 0,
            "how the axes sit in the vehicle is unseen, and not in the heading error",
        )  # fmt: skip


def remedy(fit: Fit) -> str:
    """Say what would make the heading error smaller."""
    if fit.bias_deg > fit.target_deg:
        if fit.plane:
            return "the points are not equally spaced in heading, use the method 'ellipse'"
        return "the method's model does not fit this sensor, use 'auto'"
    if fit.repeats is not None and fit.repeats.scatter_deg > fit.target_deg:
        return "the recordings contradict each other, use those made in the state of use"
    return movement(fit)


def movement(fit: Fit) -> str:
    """Say which way to turn the sensor next: where readings would tell most, or all round where none tells more."""
    if fit.plane:
        return "turn it all the way round, more than once, keeping it level"
    advice = advised(fit)
    if advice.after_deg > (1.0 - WORTH_IT) * advice.worst_deg:
        return "record for longer while turning through all directions, away from iron and currents"
    return advice.words("sensor").replace("hold it", "hold the sensor", 1)


def advised(fit: Fit) -> Guidance:
    """Where the next readings would help most: a level heading while that is not good enough, then all attitudes."""
    seen_from_below = fit.heading_error_deg.dip_deg * fit.dip_deg < 0.0
    return guide(
        fit.ellipsoid,
        fit.covariance,
        noise=fit.noise,
        coverage=fit.coverage,
        dip_deg=fit.dip_deg,
        down=np.array([0.0, 0.0, -1.0]) if seen_from_below else None,
        goal="heading" if fit.heading_error_deg.worst > fit.target_deg else "attitude",
    )


def unseen_side(coverage: Coverage) -> str:
    """Name the side or corner of the sensor that lies in the middle of the largest gap.

    >>> from flinders.summary.coverage import Coverage
    >>> unseen_side(Coverage.of(np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 0.99]])))
    '−z side'
    """
    named = [
        ("+" if part > 0 else "−") + letter
        for letter, part in zip("xyz", coverage.hole, strict=True)
        if abs(part) > 0.4
    ]
    return f"{named[0]} side" if len(named) == 1 else f"corner between {' and '.join(named)}"
