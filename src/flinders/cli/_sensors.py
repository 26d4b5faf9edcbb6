"""Which of several magnetometers, and all of them in one run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import click

from flinders.cli import _filters, _options, _together
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._sources import Counted, provenance, saying_what_was_skipped
from flinders.cli._talk import drawn, print_json, progress, say
from flinders.errors import FitError, FlindersError, InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from flinders.comparison.multi_sensor import Together
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter
    from flinders.readers import Instrument, Log

Outcome: TypeAlias = "Fit | FlindersError"

ALL: Final = "all"
PLACE: Final = "{sensor}"
"""What stands for the number of the magnetometer in the name of a file."""


def opened(recordings: Sequence[str], options: dict[str, Any], **reading: Any) -> Recording:
    """Open recordings of one sensor: of several the one that ``--sensor`` says, whose name goes with the calibration.

    Raises
    ------
    UsageError
        For a magnetometer that there is not, and for columns that are one in one file and another in the next.
    """
    from flinders.core.samples import Joined
    from flinders.readers import Choice, open_recording

    found = open_recording(recordings, sensor=Choice(options["sensor"], is_name=True), **reading)
    parts = found.recordings if isinstance(found, Joined) else (found,)
    names = [getattr(part, "name", "") for part in parts]
    if reading.get("columns") is not None and len(set(filter(None, names))) > 1:
        told = ", ".join(f"{name or 'the only one'} in {part.source}" for name, part in zip(names, parts, strict=True))
        raise UsageError(f"--columns {reading['columns']} is not one magnetometer: {told}; calibrate them one by one")
    if options["sensor"] is not None and reading.get("columns") is None and any(names) and not all(names):
        alone = next(part.source for part, name in zip(parts, names, strict=True) if not name)
        raise UsageError(
            f"--sensor chooses one of several magnetometers, and {alone} has just one: calibrate them one by one"
        )
    options["sensor"] = next(filter(None, names), options["sensor"])
    return found


def is_all(recordings: Sequence[str], sensor: str | None) -> bool:
    """Whether each of several magnetometers is to be calibrated on its own.

    Raises
    ------
    UsageError
        Where several files are to be, or standard input.
    """
    if sensor is None or sensor.strip().casefold() != ALL:
        return False
    if len(recordings) > 1:
        raise UsageError("--sensor all goes with one file of several magnetometers: give one, or leave it out")
    return True


def calibrate(
    recordings: Sequence[str],
    output: str | None,
    beside: dict[str, str | None],
    *,
    by: Filter | None,
    reading: dict[str, Any],
    options: dict[str, Any],
    force: bool,
    as_json: bool,
    together: bool = False,
    reference: str | None = None,
) -> int:
    """Calibrate each magnetometer of a log or table, or all of them together, and print a table of what was found.

    Returns
    -------
    int
        The exit code: that of the worst.
    """
    from flinders.core.files import refuse_existing
    from flinders.readers import open_log

    for option, value in beside.items():
        if value is not None:
            raise UsageError(f"{option} is for one magnetometer: leave it out with --sensor all, or choose one")
    if output == "-":
        raise UsageError(
            "several calibrations do not go to standard output: name files, such as -o compass-{sensor}.json"
        )
    if together:
        _together.refuse(options, by)
    found = None
    with progress("reading") as watch:
        log = _several(open_log(recordings[0], progress=watch, **reading), reading)
        paths = [_named(output, number) for number in range(1, len(log.instruments) + 1)]
        for each in filter(None, paths):
            _options.refuse_to_overwrite(each, recordings)
            refuse_existing(each, force=force)
        if together:
            found = _together.fitted(log, paths, reference, options, force=force)
            outcomes = [(member.name, member.fit) for member in found.members]
        else:
            outcomes = [
                (instrument.name, _fitted(instrument, by, options, path=path, force=force))
                for instrument, path in zip(log.instruments, paths, strict=True)
            ]
    if all(isinstance(outcome, InputError) for _, outcome in outcomes):
        raise next(outcome for _, outcome in outcomes if isinstance(outcome, InputError))
    if as_json:
        print_json(_as_dict(outcomes, paths, found))
    else:
        click.echo(drawn(_page(outcomes, found, options["target_deg"]), sys.stdout))
    written = [
        path for path, (_, outcome) in zip(paths, outcomes, strict=True)
        if path and not isinstance(outcome, FlindersError)
    ]  # fmt: skip
    say(
        f"written to {', '.join(written)}"
        if written
        else "nothing was written: name files with -o compass-{sensor}.json"
    )
    return max(_exit_code(outcome) for _, outcome in outcomes)


def _page(outcomes: Sequence[tuple[str, Outcome]], found: Together | None, target_deg: float) -> RenderableType:
    """What a terminal shows."""
    from flinders.report.fit_pages import of_sensors, of_several

    if found is not None:
        return of_several(found, target_deg)
    rows = [(name, outcome if _is_known(outcome) else FitError(str(outcome))) for name, outcome in outcomes]
    return of_sensors(cast("list[tuple[str, Fit | FitError]]", rows), target_deg)


def _is_known(outcome: Outcome) -> bool:
    return isinstance(outcome, FitError) or not isinstance(outcome, FlindersError)


def _as_dict(
    outcomes: Sequence[tuple[str, Outcome]], paths: Sequence[str | None], found: Together | None
) -> dict[str, Any]:
    """JSON-ready: a list of fits, each with what the others tell of it where they were fitted together."""
    rows = [_row(*outcome, path) for outcome, path in zip(outcomes, paths, strict=True)]
    if found is None:
        return {"sensors": rows}
    told = [{**row, "together": member.as_dict()} for row, member in zip(rows, found.members, strict=True)]
    return {**found.as_dict(), "sensors": told}


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


def _fitted(
    instrument: Instrument,
    by: Filter | None,
    options: dict[str, Any],
    *,
    path: str | None,
    force: bool,
) -> Fit | FitError | InputError:
    """Fit one magnetometer and write its calibration; a refusal is a result like any other, and so is a dead one."""
    from flinders.fitting.calibrate import fit

    part = Counted(instrument)
    asked = {**options, "sensor": instrument.name}
    try:
        with saying_what_was_skipped([part]):
            if by is None:
                found = fit(_filters.through([part], None), **asked)
            else:
                found = _filters.fit_filtered([part], by, asked)
    except (FitError, InputError) as refusal:
        return refusal
    if path:
        found.save(path, force=force, provenance=provenance([part]))
    return found


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


def _row(name: str, outcome: Outcome, path: str | None) -> dict[str, Any]:
    """JSON-ready: the fit as ``calibrate --json`` has it, and of which magnetometer it is."""
    if not isinstance(outcome, FlindersError):
        return {"sensor": name, "written": path, **outcome.as_dict()}
    fit = getattr(outcome, "fit", None)
    told = {"code": outcome.code, "message": str(outcome), "evidence": dict(getattr(outcome, "evidence", {}))}
    return {"sensor": name, "written": None, "verdict": "refused", **(fit.as_dict() if fit else {}), "error": told}


def _exit_code(outcome: Outcome) -> int:
    if isinstance(outcome, FlindersError):
        return outcome.exit_code
    return GOOD if outcome.verdict == "good" else LIMITED
