"""``flinders check``: whether a calibration holds on another recording."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING, Any, cast

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import in_use, made_from, open_all_with, say_exact, saying_what_was_read, stated_site
from flinders.cli._output import can_show, print_json, progress, say_beyond, show
from flinders.cli._program import GOOD, LIMITED, REFUSED, print_error
from flinders.cli._spelling import in_options
from flinders.errors import NeedsSamples, TooFewSamples

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.comparison.comparison import Comparison, Strength
    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Compensator
    from flinders.core.samples import Joined, Recording
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit, Refused


class Check(program.Group):
    """A calibration, recordings to hold it against, and how they are read and judged."""

    calibration: str = program.argument("CALIBRATION")
    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1)
    is_followed: bool = program.flag("--drift", "Also follow the offset through the recording.")
    reading: option.PartOfColumns = program.group(option.PartOfColumns)
    sensor: str | None = option.sensor_of_calibration()
    fixed: tuple[str, ...] = option.fixed()
    target_deg: float = option.target()
    dip_deg: float | None = option.dip("Inclination of the field [default: what CALIBRATION was judged at].")
    as_json: bool = option.as_json()


@program.command_of(
    "check",
    Check,
    common=("target_deg", "is_followed", "columns", "sensor", "as_json"),
    epilog="""\b
Example:
  flinders check calibration.json today.csv
  flinders check calibration.json monday.csv tuesday.csv --target 2

\b
Exit codes:
  0  it holds
  3  it is off by less than the target, or the recording tells too little:
     it is too poor, or one that the calibration was made from
  4  it does not hold, or the recording cannot be fitted
""",
)
def command(options: Check) -> int:
    """Fit RECORDING afresh and say how far CALIBRATION is from that, and whether it is more than chance.

    Record as for a calibration: turn the sensor through all directions. Unit and axes come from the
    calibration file; a recording that contradicts it is refused. RECORDING is a file, or - for standard
    input; several recordings are fitted together.
    """
    from flinders.comparison.comparison import judged_at
    from flinders.core.compensation import compensated
    from flinders.core.samples import Joined
    from flinders.fitting.calibrate import fit
    from flinders.fitting.result import Refused
    from flinders.likelihood.site_field import Site

    known, compensator = in_use("check", options.calibration, options.recordings, options.fixed)
    with progress("reading") as watch:
        parts = open_all_with(
            options.calibration,
            known,
            options.recordings,
            sensor=options.sensor,
            progress=watch,
            **options.reading.as_dict(),
        )
        recording = cast("Joined", compensated(Joined(tuple(parts)), compensator.calibration))
        extrapolated = say_beyond(_gone_through(parts, compensator))
        strength = _strength(known.calibration, recording)
        say_exact(known)
        dip_deg = abs(judged_at(known)) if options.dip_deg is None else options.dip_deg
        (first, *others) = parts
        site = None if others or options.dip_deg is not None else stated_site(first, "--dip")
        try:
            with saying_what_was_read(parts):
                fresh = fit(recording, target_deg=options.target_deg, site=site or Site(inclination_deg=dip_deg))
        except Refused as refused:
            return _refused(refused, known, recording, strength, options, dip_deg)
        judged_deg = judged_at(known, fresh) if options.dip_deg is None else judged_at(fresh)
        comparison = _compared(known, fresh, recording, dip_deg=judged_deg, target_deg=options.target_deg)
        strengths = strength, _strength(fresh.calibration, recording)
    own = made_from(options.calibration, parts)
    walk = _random_walk(recording, fresh) if options.is_followed else None
    _print(comparison, fresh, strengths, own, walk, extrapolated, options)
    if comparison.verdict == "contradict":
        return REFUSED
    holds = comparison.verdict == "agree" and comparison.is_conclusive and fresh.verdict == "good" and not own
    return GOOD if holds else LIMITED


def _gone_through(parts: Iterable[Recording], compensator: Compensator) -> Compensator:
    """Go through recordings for what lies outside the range that a disturbance was found in."""
    from flinders.core.compensation import Compensator

    if compensator.calibration.disturbances:
        for part in parts:
            watch = Compensator(compensator.calibration, compensator.beyond)
            for block in part.blocks():
                watch(block)
    return compensator


def _compared(known: Fit, fresh: Fit, recording: Joined, *, dip_deg: float, target_deg: float) -> Comparison:
    """Hold them against each other; where the recording is a level turn, in the plane that was turned."""
    from flinders.comparison.comparison import compare
    from flinders.comparison.level_plane import compare_turned

    fresh = fresh.with_name("fresh fit")
    if fresh.claim.plane == "xy" and known.claim.plane is None:
        return compare_turned(known, fresh, recording, target_deg=target_deg)
    return compare(known, fresh, dip_deg=dip_deg, target_deg=target_deg)


def _random_walk(recording: Joined, fresh: Fit) -> RandomWalk:
    """How the offset moved through a recording, by the fit to it."""
    from flinders.diagnostics.random_walk import walk_through

    claim = fresh.claim
    return walk_through(recording, claim.ellipsoid, plane=claim.plane, dip_deg=claim.heading_error_deg.dip_deg)


def _print(
    comparison: Comparison,
    fresh: Fit,
    strengths: tuple[Strength, Strength],
    own: list[str],
    walk: RandomWalk | None,
    extrapolated: dict[str, Any],
    options: Check,
) -> None:
    """Print the page, or all of it as JSON."""
    from flinders.report.comparison_pages import of_comparison

    target_deg = options.target_deg
    if not options.as_json:
        show(of_comparison(comparison, in_options, fresh=fresh, strengths=strengths, own=own))
        if walk is not None:
            click.echo(_drift_words(walk, fresh, target_deg=target_deg, dip_deg=fresh.heading_error_deg.dip_deg))
        return
    dip_deg = abs(comparison.heading_difference_deg.dip_deg)
    print_json(
        {
            **comparison.as_dict(),
            "residual": {"calibration": strengths[0].as_dict(), "fresh": strengths[1].as_dict()},
            "own_recordings": own,
            "fresh": fresh.as_dict(),
            **({} if walk is None else {"drift": walk.as_dict(level_deg=target_deg, dip_deg=dip_deg)}),
            **extrapolated,
        }
    )


def _refused(
    refused: Refused, known: Fit, recording: Joined, strength: Strength, options: Check, dip_deg: float
) -> int:
    """Say why the recording cannot be fitted; and, where that was asked for, how the offset moved all the same."""
    from flinders.diagnostics.random_walk import walk_through
    from flinders.report.comparison_pages import of_untold

    target_deg, walk = options.target_deg, None
    if options.is_followed:
        with contextlib.suppress(NeedsSamples, TooFewSamples):
            walk = walk_through(recording, known.calibration.ellipsoid, dip_deg=dip_deg, is_own=False)
    if options.as_json:
        fields: dict[str, Any] = {"residual": {"calibration": strength.as_dict()}, "fresh": refused.fit.as_dict()}
        drift = {} if walk is None else {"drift": walk.as_dict(level_deg=target_deg, dip_deg=abs(dip_deg))}
        return print_error(refused, as_json=True, more=fields | drift)
    show(of_untold(known, refused.fit, strength, in_options), err=True)
    if walk is not None:
        words = _drift_words(walk, refused.fit, target_deg=target_deg, dip_deg=dip_deg, under=" under the calibration")
        click.echo(words)
    return refused.exit_code


def _drift_words(walk: RandomWalk, fit: Fit, *, target_deg: float, dip_deg: float, under: str = "") -> str:
    """How far the offset moved, in words and, on a terminal or in a file that can, in a line of bars."""
    from flinders.core.units import label
    from flinders.diagnostics.random_walk import BARS

    words = walk.words(label(fit.calibration.unit), level_deg=target_deg, dip_deg=abs(dip_deg))
    bars = (
        f"\n{walk.drawn()}  0 to {walk.offset_change:.2g}"
        if walk.is_proven and can_show(sys.stdout.encoding, BARS)
        else ""
    )
    return f"drift{under}: {words}{bars}"


def _strength(calibration: Calibration, recording: Joined) -> Strength:
    """How evenly long the readings come out."""
    from flinders.comparison.comparison import Strength

    return sum((Strength.under(calibration, block.field) for block in recording.blocks()), Strength())
