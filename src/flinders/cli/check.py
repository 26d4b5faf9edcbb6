"""``flinders check``: whether a calibration holds on another recording."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import click

from flinders.cli import _disturbances, _options
from flinders.cli._inputs import load, made_from, opened_with, saying_what_was_skipped
from flinders.cli._options import old_option as option
from flinders.cli._output import print_json, progress, say, show
from flinders.cli._program import GOOD, LIMITED, REFUSED, print_error
from flinders.errors import NeedsSamples, TooFewSamples

if TYPE_CHECKING:
    from flinders.cli._options import PartOfColumns
    from flinders.comparison.comparison import Comparison, Strength
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Joined
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit, Refused


@_options.old_command(
    "check",
    common=("target_deg", "is_followed", "columns", "sensor", "as_json"),
    short_help="Say whether a calibration holds on another recording.",
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
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@option("--drift", "is_followed", is_flag=True, help="Also follow the offset through the recording.")
@_options.old_groups(reading=_options.PartOfColumns)
@_options.old_sensor_of_calibration
@_options.old_fixed
@_options.old_judgement
@_options.old_as_json
def command(
    calibration: str,
    recordings: tuple[str, ...],
    target_deg: float,
    dip_deg: float,
    fixed: tuple[str, ...],
    is_followed: bool,
    as_json: bool,
    sensor: str | None,
    reading: PartOfColumns,
) -> int:
    """Fit RECORDING afresh and say how far CALIBRATION is from that, and whether it is more than chance.

    Record as for a calibration: turn the sensor through all directions. Unit and axes come from the
    calibration file; a recording that contradicts it is refused. RECORDING is a file, or - for standard
    input; several recordings are fitted together.
    """
    from flinders.core.compensation import compensated
    from flinders.fitting.calibrate import fit
    from flinders.fitting.result import Refused
    from flinders.report.comparison_pages import of_comparison

    known, settler = _disturbances.settler_of(load("check", calibration, recordings), fixed)
    with progress("reading") as watch:
        as_recorded = opened_with(
            calibration, known.calibration, recordings, sensor=sensor, progress=watch, **reading.as_dict()
        )
        recording = cast("Joined", compensated(as_recorded, settler.calibration))
        extrapolated = _disturbances.say_beyond(_disturbances.seen(as_recorded, settler))
        strength = _strength(known.calibration, recording)
        if not known.states_uncertainty:
            say(f"{calibration} states no uncertainty: it is taken as exact")
        try:
            with saying_what_was_skipped(as_recorded.recordings):
                fresh = fit(recording, target_deg=target_deg, dip_deg=dip_deg)
        except Refused as refused:
            say(
                f"under {calibration} the strength is {strength.mean:.3f} of its field, with a spread of "
                f"{strength.spread:.1%}; the recording does not tell more:"
            )
            walk = _walked_anyhow(recording, known, dip_deg) if is_followed else None
            if walk is None:
                raise
            return _refused(refused, walk, target_deg=target_deg, dip_deg=dip_deg, as_json=as_json)
        renewed = _strength(fresh.calibration, recording)
    comparison = _compared(known, fresh, recording, target_deg=target_deg)
    dip = comparison.heading_difference_deg.dip_deg
    own = made_from(calibration, as_recorded.recordings)
    walk = _walked(recording, fresh) if is_followed else None
    if as_json:
        residual = {"calibration": strength.as_dict(), "fresh": renewed.as_dict()}
        walked = {} if walk is None else {"drift": walk.as_dict(level_deg=target_deg, dip_deg=abs(dip))}
        print_json(
            {
                **comparison.as_dict(),
                "residual": residual,
                "own_recordings": own,
                "fresh": fresh.as_dict(),
                **walked,
                **extrapolated,
            }
        )
    else:
        show(of_comparison(comparison, fresh=fresh, strengths=(strength, renewed), own=own))
        if walk is not None:
            unit, dip = fresh.calibration.unit, fresh.heading_error_deg.dip_deg
            click.echo(_told(walk, unit, target_deg=target_deg, dip_deg=dip))
    if comparison.verdict == "contradict":
        return REFUSED
    holds = comparison.verdict == "agree" and comparison.is_telling and fresh.verdict == "good" and not own
    return GOOD if holds else LIMITED


def _compared(known: Fit, fresh: Fit, recording: Joined, *, target_deg: float) -> Comparison:
    """Hold them against each other; where the recording is a level turn, in the plane that was turned."""
    from flinders.comparison.comparison import compare
    from flinders.comparison.level_plane import compare_turned

    fresh = replace(fresh, name="fresh fit")
    if fresh.plane == "xy" and known.plane is None:
        return compare_turned(known, fresh, recording, target_deg=target_deg)
    dip = _dip(known.calibration, recording, fresh)
    return compare(known, fresh, dip_deg=dip, target_deg=target_deg)


def _dip(calibration: Calibration, recording: Joined, fresh: Fit) -> float:
    """The dip with the sign that the recording shows: a level turn alone does not tell which side is up."""
    dip = fresh.heading_error_deg.dip_deg
    if fresh.plane is None:
        return dip
    down = sum(float(calibration.apply(block.field)[:, 2].sum()) for block in recording.blocks())
    return -dip if down * dip < 0.0 else dip


def _walked(recording: Joined, fresh: Fit) -> RandomWalk:
    """How the offset moved through a recording, by the fit to it."""
    from flinders.diagnostics.random_walk import walk_through

    return walk_through(recording, fresh.ellipsoid, plane=fresh.plane, dip_deg=fresh.heading_error_deg.dip_deg)


def _walked_anyhow(recording: Joined, known: Fit, dip_deg: float) -> RandomWalk | None:
    """How it moved where no fit is fit for use: by the calibration itself; None where nothing can be followed."""
    from flinders.diagnostics.random_walk import walk_through

    with contextlib.suppress(NeedsSamples, TooFewSamples):
        return walk_through(recording, known.ellipsoid, dip_deg=dip_deg, is_own=False)
    return None


def _refused(refused: Refused, walk: RandomWalk, *, target_deg: float, dip_deg: float, as_json: bool) -> int:
    """Say why the recording cannot be fitted, and how far the offset moved under the calibration; `drift` is that."""
    fields = {"fresh": refused.fit.as_dict(), "drift": walk.as_dict(level_deg=target_deg, dip_deg=abs(dip_deg))}
    code = print_error(refused, as_json=as_json, more=fields)
    if not as_json:
        unit = refused.fit.calibration.unit
        click.echo(_told(walk, unit, target_deg=target_deg, dip_deg=dip_deg, under=" under the calibration"))
    return code


def _told(walk: RandomWalk, unit: str, *, target_deg: float, dip_deg: float, under: str = "") -> str:
    """How far the offset moved, in words and, on a terminal or in a file that can, in a line of bars."""
    from flinders.cli.report import can_show
    from flinders.core.units import label
    from flinders.diagnostics.random_walk import BARS

    words = walk.words(label(unit), level_deg=target_deg, dip_deg=abs(dip_deg))
    bars = f"\n{walk.drawn()}  0 to {walk.moved:.2g}" if walk.is_proven and can_show(sys.stdout.encoding, BARS) else ""
    return f"drift{under}: {words}{bars}"


def _strength(calibration: Calibration, recording: Joined) -> Strength:
    """How evenly long the readings come out."""
    from flinders.comparison.comparison import Strength

    return sum((Strength.under(calibration, block.field) for block in recording.blocks()), Strength())
