"""Is this calibration fit for use? `judge` looks at a fit and says what there is to know. It prints nothing.

>>> CODES["coverage"]
'directions left unseen: the middle of the largest gap is `number` degrees from the nearest reading'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.result import Finding
from flinders.units import MICROTESLA, label

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.health import Health, Lows
    from flinders.moments import Moments
    from flinders.result import Fit, Severity
    from flinders.summary import Summary

CODES: Final = {
    "one-plane": "the readings are as flat as a level turn: thickness over width is `number`",
    "heading-error": "the worst heading error to expect, `number` degrees (1 σ), is above the target",
    "coverage": "directions left unseen: the middle of the largest gap is `number` degrees from the nearest reading",
    "noise": "readings lie `number` of the field (1 σ) off the ellipsoid: not only iron and noise are at work",
    "rings": "the readings say nothing of `number` of nine parameters, as where they lie on one ring or on two",
    "prior": "the prior, not the readings, speaks for `number` of the least known shape parameter",
    "bias": "the method's own bias and misfit, estimated beside the likelihood, is `number` degrees of heading (rms)",
    "few-samples": "only `number` independent readings",
    "correlated": "residuals hang together: `number` is the share of readings that are independent",
    "strays": "`number` of the readings do not belong to the rest and were left out",
    "saturated": "`number` of the readings sit at the very end of an axis: the sensor was at its limit",
    "stale-repeats": "`number` of the readings repeat the one before: the log is faster than its sensor",
    "time-jump": "time goes back or stands still for long: `number` seconds at the longest",
    "skipped-rows": "`number` rows could not be used",
    "axis-ratio": "the longest axis of the ellipsoid is `number` times the shortest",
    "field-strength": "the field found, `number` µT, is not one of the earth's",
    "mirrored-axes": "the axes mapping turns a right-handed frame into a left-handed one",
    "scale-unknown": "no field strength was given, so the scale of corrected readings is by convention",
    "rotation-unknown": "a magnetometer alone cannot see how its axes are turned against the vehicle",
}
"""Every finding there is, and what its number means."""

REFUSED_AT: Final = 5.0
"""A worst heading error beyond so many times the target is refused."""

FLAT, FLAT_NOISE, FLATTEST = 0.01, 3.0, 0.2
HOLE_DEG, SMALL_HOLE_DEG = 60.0, 40.0
NOISE_LIMITS, NOISE_REFUSES = 0.05, 0.2
PRIOR_SHARE: Final = 0.1
BIAS_SHARE: Final = 0.1
FEW: Final = 20
CORRELATED: Final = 0.5
STRAYS: Final = 0.1
RAIL_SHARE, RAIL_COUNT, RAIL_WIDTH = 0.01, 8, 0.25
REPEATS: Final = 0.1
LONG_STEP: Final = 20.0
AXIS_RATIO: Final = 2.0
EARTH_UT: Final = (22.0, 67.0)


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
            *_accuracy(fit),
            *_bias(fit),
            *_evidence(fit),
            *_strays(fit, summary.health),
            *_shape(fit),
            *_unknowable(fit),
        ]
    )
    found = [*flat, *supported, *_recording(summary.health)]
    order = ("refuses", "limits", "note")
    return tuple(sorted(found, key=lambda finding: order.index(finding.severity)))


def _flat(fit: Fit, moments: Moments) -> Iterator[Finding]:
    """Whether the readings lie in one plane: then any number of ellipsoids goes through their ring."""
    thickness, _, width = np.sqrt(moments.principal_variances)
    limit = min(max(FLAT_NOISE * fit.noise / width, FLAT), FLATTEST)
    if thickness / width < limit:
        yield Finding(
            "one-plane", "refuses", thickness / width, limit,
            "all readings lie in one plane, as in a level turn, and tell nothing of the direction across it: "
            "also turn the sensor about its other axes, onto its side and upside down",
        )  # fmt: skip


def _accuracy(fit: Fit) -> Iterator[Finding]:
    """What the covariance says about heading."""
    worst, target = fit.heading_error_deg.worst, fit.target_deg
    if not worst <= target:
        severity: Severity = "limits" if worst <= REFUSED_AT * target else "refuses"
        amount = f"{worst:.2g}°" if worst < 90 else "any angle"
        remedy = "the method's model does not fit this sensor, use 'auto'" if fit.bias_deg > target else movement(fit)
        yield Finding(
            "heading-error", severity, worst, target,
            f"the heading may be off by {amount} (1 σ, worst heading; the target is {target:g}°): {remedy}",
        )  # fmt: skip


def _bias(fit: Fit) -> Iterator[Finding]:
    """What a simpler model or a biased equation costs."""
    if fit.bias_deg > fit.target_deg * BIAS_SHARE:
        severity: Severity = "limits" if fit.bias_deg > fit.target_deg else "note"
        yield Finding(
            "bias", severity, fit.bias_deg, fit.target_deg * BIAS_SHARE,
            f"{fit.method!r} is {fit.bias_deg:.2g}° of heading (rms) off the likelihood, beyond what chance explains: "
            "its model is too simple for this sensor, or its equation is biased by noise; use 'auto'",
        )  # fmt: skip


def _evidence(fit: Fit) -> Iterator[Finding]:
    """How much there was to go by."""
    hole = fit.coverage.hole_deg
    if hole > HOLE_DEG:
        yield Finding(
            "coverage", "limits", hole, HOLE_DEG,
            f"directions up to {hole:.0f}° from any reading are unseen ({fit.coverage.fraction:.0%} of the sphere was "
            f"covered): good for attitudes like those recorded; for all attitudes {movement(fit)}",
        )  # fmt: skip
    share = fit.noise / fit.calibration.field_strength
    if share > NOISE_LIMITS:
        yield Finding(
            "noise", "limits" if share <= NOISE_REFUSES else "refuses", share, NOISE_LIMITS,
            f"the readings lie {share:.0%} of the field off the ellipsoid: record again away from iron and currents, "
            "without moving anything magnetic near the sensor, and check the columns",
        )  # fmt: skip
    if fit.unseen:
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
        alike = "" if independent == fit.samples else f" ({fit.samples:,} whose residuals hang together)"
        yield Finding(
            "few-samples", "limits", independent, FEW,
            f"only {independent:.0f} independent readings{alike}: record for longer, turning all the time",
        )  # fmt: skip
    elif independent < CORRELATED * fit.samples:
        yield Finding(
            "correlated", "note", independent / fit.samples, CORRELATED,
            f"residuals hang together: {fit.samples:,} readings say as much as {independent:,.0f} independent ones, "
            "and the heading error allows for it. Usual for a tumble by hand; less of it away from iron",
        )  # fmt: skip


def _strays(fit: Fit, health: Health) -> Iterator[Finding]:
    """What a robust fit left out: the strays, and the readings around their runs."""
    if not fit.strays:
        return
    rejected = health.rows - fit.samples
    share = rejected / health.rows
    worst = sorted(fit.strays, key=lambda stray: -stray.rows)[:3]
    runs = "; ".join(str(stray) for stray in worst) + ("; …" if len(fit.strays) > len(worst) else "")
    farthest = max(stray.farthest for stray in fit.strays)
    off = f"{farthest:.2g} {label(fit.calibration.unit)}"
    yield Finding(
        "strays", "limits" if share > STRAYS else "note", share, STRAYS,
        f"{rejected:,} readings ({share:.1%}) lie up to {off} off the rest and were "
        f"left out ({runs}): something magnetic passed by, or bits were lost on the way",
    )  # fmt: skip


def _recording(health: Health) -> Iterator[Finding]:
    """What the recording says about itself."""
    for name, end, ends in (("lowest", "low", health.lows), ("highest", "high", health.highs)):
        for axis, letter in enumerate("xyz"):
            share = float(ends.counts[axis]) / max(health.rows, 1)
            if ends.counts[axis] >= RAIL_COUNT and share > RAIL_SHARE and _is_wide(ends, health.extent, axis):
                value = float(ends.values[axis]) * (1 if end == "low" else -1)
                yield Finding(
                    "saturated", "limits", share, RAIL_SHARE,
                    f"{share:.1%} of the readings sit at the {name} value of {letter} ({value:g}): "
                    "choose a larger range, or move the sensor away from magnets",
                )  # fmt: skip
    repeats = health.repeats / max(health.rows, 1)
    if repeats > REPEATS:
        yield Finding(
            "stale-repeats", "note", repeats, REPEATS,
            f"{repeats:.0%} of the readings repeat the one before (the log is faster than its sensor): "
            "the uncertainty counts them once",
        )  # fmt: skip
    yield from _time(health)
    skipped = sum(part.rows for part in health.skipped)
    if skipped:
        yield Finding(
            "skipped-rows", "limits" if skipped > 0.1 * health.rows else "note", skipped, 0.1 * health.rows,
            "left out: " + "; ".join(str(part) for part in health.skipped),
        )  # fmt: skip


def _is_wide(ends: Lows, extent: Floats, axis: int) -> bool:
    """Whether readings at the end of an axis lie far apart along the other two, as at a rail."""
    others = [other for other in range(3) if other != axis]
    return bool(np.all(ends.beside[axis, others] > RAIL_WIDTH * extent[others]))


def _time(health: Health) -> Iterator[Finding]:
    clock = health.clock
    if clock.backward_steps:
        yield Finding(
            "time-jump", "note", clock.backward_steps, 0,
            f"time steps back {clock.backward_steps} times: recordings out of order, or a clock that was set",
        )  # fmt: skip
        return
    usual = clock.seconds / max(health.rows - 1, 1)
    if clock.longest_step > LONG_STEP * usual > 0.0:
        yield Finding(
            "time-jump", "note", clock.longest_step, LONG_STEP * usual,
            f"nothing was recorded for {clock.longest_step:.3g} s in one stretch (usually every {usual:.2g} s)",
        )  # fmt: skip


def _shape(fit: Fit) -> Iterator[Finding]:
    """Whether the ellipsoid is one that a sensor in the earth's field makes."""
    axes = fit.ellipsoid.semi_axes
    ratio = float(axes[2] / axes[0])
    if ratio > AXIS_RATIO:
        yield Finding(
            "axis-ratio", "limits", ratio, AXIS_RATIO,
            f"one axis reads {ratio:.2g} times as much as another: check the axes' gains and the columns",
        )  # fmt: skip
    strength, known = fit.calibration.field_strength, fit.calibration.field_strength_known
    if fit.calibration.unit == MICROTESLA and not known and not EARTH_UT[0] <= strength <= EARTH_UT[1]:
        yield Finding(
            "field-strength", "note", strength, EARTH_UT[0] if strength < EARTH_UT[0] else EARTH_UT[1],
            f"a field of {strength:.3g} µT is outside the earth's {EARTH_UT[0]:g}–{EARTH_UT[1]:g} µT: "
            "check the unit or scale; headings do not depend on it",
        )  # fmt: skip
    if fit.calibration.axes.is_mirror:
        yield Finding(
            "mirrored-axes", "limits", -1, 1,
            f"the axes mapping {fit.calibration.axes} is a mirror image: right only for a left-handed sensor",
        )  # fmt: skip


def _unknowable(fit: Fit) -> Iterator[Finding]:
    """What no recording of a magnetometer alone can tell."""
    calibration = fit.calibration
    if not calibration.field_strength_known:
        yield Finding(
            "scale-unknown", "note", calibration.field_strength, 0,
            f"no field strength was given: corrected readings have length {calibration.field_strength:.4g} "
            f"{label(calibration.unit)} (determinant 1); headings do not depend on it",
        )  # fmt: skip
    if calibration.rotation == "symmetric":
        yield Finding(
            "rotation-unknown", "note", 0, 0,
            "how the sensor's axes are turned against the vehicle, and crooked axes as far as they turn the field, "
            "cannot be known from a magnetometer alone: the heading error is for shape and offset",
        )  # fmt: skip


def movement(fit: Fit) -> str:
    """Say which way to turn the sensor next: towards the middle of the largest gap, if there is one."""
    if fit.coverage.hole_deg < SMALL_HOLE_DEG:
        return "record for longer while turning through all directions, away from iron and currents"
    named = [
        ("+" if part > 0 else "−") + letter
        for letter, part in zip("xyz", fit.coverage.hole, strict=True)
        if abs(part) > 0.4
    ]
    side = named[0] if len(named) == 1 else f"corner between {' and '.join(named)}" if named else "other side"
    kind = f"{side} side" if len(named) == 1 else side
    return (
        f"turn the sensor until its {kind} points along the field (in the north: down, towards north; "
        "in the south: up, towards north), then roll it slowly about that direction"
    )
