"""``flinders calibrate --sensor all``: each magnetometer of a log or table, on its own or in one joint fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

from flinders.cli._inputs import Counted, provenance, saying_what_was_skipped
from flinders.cli._output import Outputs, print_json, progress, say, show
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import FitError, FlindersError, InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from flinders.cli._fit_options import OutputOptions, Sensors
    from flinders.comparison.multi_sensor import Together
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter
    from flinders.readers import Log

Fitting: TypeAlias = "Callable[[Sequence[Recording], Filter | None, dict[str, Any]], Fit]"
Outcome: TypeAlias = "Fit | FlindersError"

PLACE: Final = "{sensor}"
"""What stands for the number of the magnetometer in the name of a file."""

OF_JOINT_FITS: Final = ("target_deg", "dip_deg", "field_strength", "prior", "aiding", "site")
"""Options of `flinders.fit_multi`."""


def calibrate(
    path: str,
    sensors: Sensors,
    by: Filter | None,
    files: OutputOptions,
    reading: dict[str, Any],
    options: dict[str, Any],
    fit: Fitting,
) -> int:
    """Calibrate each magnetometer of a log or table, or all of them jointly, and print a table of the results.

    Returns
    -------
    int
        The exit code: that of the worst.
    """
    from flinders.readers import open_log

    _refuse(files, by, options, is_joint=sensors.joint)
    multi: Together | None = None
    with progress("reading") as watch:
        log = _several(open_log(path, progress=watch, **reading), reading)
        parts = {instrument.name: Counted(instrument) for instrument in log.instruments}
        paths = [_named(files.output, number) for number in range(1, len(parts) + 1)]
        Outputs.of(*(("the calibration", each) for each in paths), force=files.force).check([path])
        if sensors.joint:
            multi = _fitted_jointly(log, parts, sensors.reference, options)
        made = _each_alone(parts, by, options, fit) if multi is None else ((one.name, one.fit) for one in multi.members)
        outcomes: list[tuple[str, Outcome]] = []
        written = []
        for target, part, outcome in zip(paths, parts.values(), made, strict=True):
            outcomes.append(outcome)
            if target and _saved(outcome[1], part, target, force=files.force):  # at once: the next may be interrupted
                written.append(target)
    unread = [outcome for _, outcome in outcomes if isinstance(outcome, InputError)]
    if len(unread) == len(outcomes):
        raise unread[0]
    if files.as_json:
        print_json(_as_dict(outcomes, paths, multi))
    else:
        show(_page(outcomes, multi, options["target_deg"]))
    names = ", ".join(written)
    say(f"written to {names}" if names else "nothing was written: name files with -o compass-{sensor}.json")
    return max(_exit_code(outcome) for _, outcome in outcomes)


def _refuse(files: OutputOptions, by: Filter | None, options: Mapping[str, Any], *, is_joint: bool) -> None:
    """Refuse options that go with one magnetometer.

    Raises
    ------
    UsageError
        Naming the first of them.
    """
    for option, value in files.of_one_sensor.items():
        if value is not None:
            raise UsageError(f"{option} is for one magnetometer: leave it out with --sensor all, or choose one")
    if files.output == "-":
        raise UsageError(
            "several calibrations do not go to standard output: name files, such as -o compass-{sensor}.json"
        )
    of_one_fit = {
        "--method": options["method"] != "auto",
        "--robust": bool(options.get("robust")),
        "--with current, throttle or temperature": bool(options.get("disturbances")),
        "--alignment-sigma": options.get("alignment_sigma_deg") is not None,
        "--at without --with": options.get("site") is not None and not options.get("aiding"),
        "--filter": by is not None,
        "--prior none": options.get("prior", 1.0) is None,
    }
    for option, is_given in of_one_fit.items():
        if is_joint and is_given:
            raise UsageError(f"{option} is for one magnetometer by itself: leave it out with --joint")


def _several(log: Log, reading: dict[str, Any]) -> Log:
    """Refuse what says already which magnetometer it is.

    Raises
    ------
    UsageError
        Naming that.
    """
    if reading["columns"] is not None:
        raise UsageError("--sensor all takes each magnetometer, --columns says which one it is: leave one of them out")
    if reading["topic"] is not None and not log.is_table:
        raise UsageError("--sensor all takes each magnetometer, --topic says which one it is: leave one of them out")
    if log.is_table and len(log.instruments) == 1:
        raise UsageError(f"{log.source} has one magnetometer: leave --sensor all out")
    return log


def _fitted_jointly(log: Log, parts: dict[str, Counted], reference: str | None, options: dict[str, Any]) -> Together:
    """Fit all magnetometers of a log jointly.

    Raises
    ------
    UsageError
        For a reference that there is not, or a log with just one.
    """
    from flinders.comparison.multi_sensor import fit_multi

    chosen = None if reference is None else log.sensor(reference).name
    if len(parts) < 2:
        raise UsageError(f"{log.source} has one magnetometer: leave --joint out")
    asked = {name: options[name] for name in OF_JOINT_FITS if options.get(name) is not None}
    return fit_multi(parts, reference=chosen, **asked)


def _each_alone(
    parts: Mapping[str, Counted], by: Filter | None, options: dict[str, Any], fit: Fitting
) -> Iterator[tuple[str, Outcome]]:
    """Fit one magnetometer after the other; a refusal is a result like any other, and so is a dead one."""
    for name, part in parts.items():
        try:
            with saying_what_was_skipped([part]):
                outcome: Outcome = fit([part], by, {**options, "sensor": name})
        except (FitError, InputError) as refusal:
            outcome = refusal
        yield name, outcome


def _saved(outcome: Outcome, part: Counted, path: str, *, force: bool) -> bool:
    """Write the calibration of one magnetometer, unless it was refused."""
    if isinstance(outcome, FlindersError):
        return False
    outcome.save(path, force=force, provenance=provenance([part]))
    return True


def _page(outcomes: Sequence[tuple[str, Outcome]], multi: Together | None, target_deg: float) -> RenderableType:
    """What a terminal shows."""
    from flinders.report.fit_pages import of_sensors, of_several

    if multi is not None:
        return of_several(multi, target_deg)
    rows = [
        (name, FitError(str(outcome)) if isinstance(outcome, InputError) else outcome) for name, outcome in outcomes
    ]
    return of_sensors(cast("list[tuple[str, Fit | FitError]]", rows), target_deg)


def _as_dict(
    outcomes: Sequence[tuple[str, Outcome]], paths: Sequence[str | None], multi: Together | None
) -> dict[str, Any]:
    """JSON-ready: a list of fits, each with what a joint fit says of it."""
    rows = [_row(*outcome, path) for outcome, path in zip(outcomes, paths, strict=True)]
    if multi is None:
        return {"sensors": rows}
    joint = [{**row, "together": member.as_dict()} for row, member in zip(rows, multi.members, strict=True)]
    return {**multi.as_dict(), "sensors": joint}


def _row(name: str, outcome: Outcome, path: str | None) -> dict[str, Any]:
    """JSON-ready: the fit as ``calibrate --json`` has it, and of which magnetometer it is."""
    if not isinstance(outcome, FlindersError):
        return {"sensor": name, "written": path, **outcome.as_dict()}
    fit = getattr(outcome, "fit", None)
    error = {"code": outcome.code, "message": str(outcome), "evidence": dict(getattr(outcome, "evidence", {}))}
    return {"sensor": name, "written": None, "verdict": "refused", **(fit.as_dict() if fit else {}), "error": error}


def _named(output: str | None, number: int) -> str | None:
    """The file of one magnetometer: its number in place of ``{sensor}``, or before the ending.

    >>> _named("compass-{sensor}.json", 2), _named("out/calibration.json", 2)
    ('compass-2.json', 'out/calibration-2.json')
    """
    if output is None:
        return None
    if PLACE in output:
        return output.replace(PLACE, str(number))
    path = Path(output)
    return str(path.with_name(f"{path.stem}-{number}{path.suffix}"))


def _exit_code(outcome: Outcome) -> int:
    """How it ends for one magnetometer."""
    if isinstance(outcome, FlindersError):
        return outcome.exit_code
    return GOOD if outcome.verdict == "good" else LIMITED
