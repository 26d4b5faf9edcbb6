"""``flinders check``: test a calibration file, or the onboard calibration of a log, on a recording."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import (
    is_calibration,
    load,
    load_for_recordings,
    open_all_with,
    open_recordings,
    refuse_calibration,
    report_readings,
    say_exact,
    stated_site,
    take_at_fixed,
    walk_in,
)
from flinders.cli._output import can_show, print_json, print_result, progress, say, show
from flinders.cli._program import ANSWER_EXITS, LIMITED, print_error
from flinders.cli._spelling import in_options
from flinders.core.files import free_path
from flinders.core.language import phrase
from flinders.errors import FitError, NeedsSamples, UsageError

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.readers._source import Progress
    from flinders.workflows.checking import Check as Checked


class Check(program.Group):
    """A calibration, the recordings that it is compared with, and options for reading and judging."""

    calibration: str | None = program.argument("[CALIBRATION]", required=False)
    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1, required=False)
    is_followed: bool = program.flag("--drift", "Also estimate the drift of the offset within the recording.")
    date: str | None = program.member(
        "--date", metavar="DAY", help="Without a RECORDING: the day for which the age is judged [default: today]."
    )
    history: str | None = option.history("Without a RECORDING: history of this unit kept by flinders watch.")
    reading: option.PartOfColumns = program.group(option.PartOfColumns)
    sensor: str | None = option.sensor_of_calibration()
    fixed: tuple[str, ...] = option.fixed()
    target_deg: float = option.target()
    dip_deg: float | None = option.dip("Inclination of the field [default: that of CALIBRATION].")
    as_json: bool = option.as_json()

    @property
    def is_aged(self) -> bool:
        """Whether only a calibration was given, which is then judged by its age."""
        return not self.recordings and self.calibration is not None and is_calibration(self.calibration)

    @property
    def is_onboard(self) -> bool:
        """Whether only a log was given, whose onboard calibration is then judged."""
        return not self.recordings


@program.command_of(
    "check",
    Check,
    common=("target_deg", "is_followed", "columns", "sensor", "as_json"),
    epilog="""\b
Example:
  flinders check calibration.json today.csv
  flinders check calibration.json monday.csv tuesday.csv --target 2
  flinders check calibration.json --date 2027-05-01
  flinders check flight.bin

\b
Exit codes:
  0  it holds: the heading difference is within the target, with a
       confidence of 95 %
    3  cannot tell: the uncertainty of the recording or the calibration is
       too large, the recording cannot be fitted, or the calibration was made
       from it; without a recording, the stated error has reached the target,
       or doubled
    4  it fails: the difference is beyond the target, with that confidence
""",
)
def command(options: Check) -> int:
    """Fit RECORDING anew, compare CALIBRATION with the result, and tell whether the difference is significant.

    With a log only, its onboard calibration is judged. With a CALIBRATION only, its present heading error is computed
    from the drift of its offset, with the day until which the calibration is good.

    Record as for a calibration: turn the sensor through all directions. Unit and axes come from the calibration file; a
    recording that contradicts them is refused. RECORDING is a file, or - for standard input; several recordings are
    fitted together.
    """
    if options.is_aged:
        return _age(options)
    if options.date is not None or options.history is not None:
        raise UsageError(
            "--date and --history need a calibration without a recording: leave out the options or the recording"
        )
    from flinders.report.phrases import advice_of

    try:
        checked = _run_check(options)
    except NeedsSamples:  # no times for --drift
        raise
    except FitError as error:
        return print_error(error, as_json=options.as_json, more={"answer": "cannot-tell"}, exit_code=LIMITED)
    for finding in checked.extrapolated or ():
        say(f"! {advice_of(finding, in_options)}")
    _print(checked, as_json=options.as_json)
    if options.is_onboard and checked.answer == "fails":
        say(phrase("next.command", "next: {command}", command=_calibrate_command(options)))
    return ANSWER_EXITS[checked.answer]


def _age(options: Check) -> int:
    """Print the present heading error of a calibration, by its age."""
    from datetime import UTC, datetime

    from flinders.report.check_page import page_of_aged
    from flinders.workflows.aging import age_of

    fit = load("check", str(options.calibration))
    at = datetime.now(UTC) if options.date in (None, "today") else _day(str(options.date))
    aged = age_of(fit, at, walk=walk_in(options.history, fit))
    if options.date not in (None, "today") and at.date() < aged.since.astimezone(at.tzinfo).date():
        raise UsageError(
            f"{options.calibration} was made on {aged.since:%Y-%m-%d}, after {at:%Y-%m-%d}: give a later day",
            hint={"date": None},
        )
    print_result(aged.as_dict, lambda: page_of_aged(aged), as_json=options.as_json)
    return ANSWER_EXITS[aged.answer]


def _day(text: str) -> datetime:
    """Read a day or time; it is in UTC unless it has a time zone."""
    from datetime import UTC, datetime

    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise UsageError(f"{text!r} is not a date: need a day such as 2027-05-01, or today") from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _calibrate_command(options: Check) -> str:
    """Command that calibrates from the same log, into a file that does not exist."""
    sensor = [] if options.sensor is None else ["--sensor", options.sensor]
    output = str(free_path(Path("calibration.json")))
    return shlex.join(["flinders", "calibrate", str(options.calibration), *sensor, "-o", output])


def _run_check(options: Check) -> Checked:
    """Read the recordings in unit and axes of the calibration, and check the calibration."""
    from flinders.core.joining import Joined
    from flinders.likelihood.site_field import Site
    from flinders.workflows.checking import check

    dip_deg = options.dip_deg
    with progress("reading") as watch:
        known, parts = (_load_onboard if options.is_onboard else _load_inputs)(options, watch)
        if len(parts) == 1 and dip_deg is None:
            stated_site(parts[0], "--dip")
        with report_readings(parts):
            return check(
                Joined(tuple(parts)),
                known,
                target_deg=options.target_deg,
                site=None if dip_deg is None else Site(inclination_deg=dip_deg),
                follow=options.is_followed,
            )


def _load_inputs(options: Check, watch: Progress | None) -> tuple[Fit, list[CountedRecording]]:
    """The calibration, and the recordings in its unit and axes."""
    path = str(options.calibration)
    known = load_for_recordings("check", path, options.recordings, options.fixed)
    reading = {"progress": watch, **options.reading.as_dict()}
    parts = open_all_with(path, known, options.recordings, sensor=options.sensor, **reading)
    say_exact(known)
    return known, parts


def _load_onboard(options: Check, watch: Progress | None) -> tuple[Fit, list[CountedRecording]]:
    """The onboard calibration of a log, and the log."""
    from flinders.estimators.data import CountedRecording
    from flinders.workflows.onboard import onboard_fit

    if (log := options.calibration) is None:
        raise UsageError(
            "need a log, or a calibration and a recording: flinders check flight.bin, or flinders check "
            "calibration.json today.csv"
        )
    refuse_calibration(log, f"give a recording to check it on: flinders check {log} RECORDING")
    recording, _ = open_recordings([log], options.sensor, progress=watch, **options.reading.as_dict())
    return take_at_fixed(onboard_fit(recording), options.fixed), [CountedRecording(recording)]


def _print(checked: Checked, *, as_json: bool) -> None:
    """Print the page of the check, or all its results as JSON."""
    from flinders.report.check_page import page_of_check

    if checked.refusal is not None and as_json:
        print_error(checked.refusal, as_json=True, more=checked.as_dict(), exit_code=LIMITED)
        return
    if as_json:
        print_json(checked.as_dict())
        return
    show(page_of_check(checked, in_options), err=checked.refusal is not None)
    if checked.random_walk is not None:
        click.echo(_drift_words(checked, checked.random_walk))


def _drift_words(checked: Checked, walk: RandomWalk) -> str:
    """Words for the drift of the offset, with a line of bars if the output can show them."""
    from flinders.core.units import unit_label
    from flinders.diagnostics.random_walk import BARS

    is_refused = checked.refusal is not None
    dip_deg = checked.dip_deg if is_refused else checked.fresh.heading_error_deg.dip_deg
    unit = unit_label(checked.fresh.calibration.unit)
    words = walk.words(unit, level_deg=checked.target_deg, dip_deg=abs(dip_deg))
    has_bars = walk.is_proven and can_show(sys.stdout.encoding, BARS)
    bars = f"\n{walk.to_bars()}  0 to {walk.offset_change:.2g}" if has_bars else ""
    return f"drift{' under the calibration' if is_refused else ''}: {words}{bars}"
