"""Which magnetometer of a log, and all of them in one run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _filters, _options
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.cli._sources import Counted, provenance, saying_what_was_skipped
from flinders.cli._talk import drawn, print_json, progress, say
from flinders.errors import FitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.filters import Filter
    from flinders.readers import Instrument
    from flinders.result import Fit
    from flinders.samples import Recording

ALL: Final = "all"
PLACE: Final = "{sensor}"
"""What stands for the number of the magnetometer in the name of a file."""


def opened(recordings: Sequence[str], options: dict[str, Any], **reading: Any) -> Recording:
    """Open recordings of one sensor; of a log the one that ``--sensor`` says, whose name is kept with the calibration.

    Raises
    ------
    UsageError
        For a magnetometer that there is not.
    """
    from flinders.readers import Instrument, holds_log, open_recording
    from flinders.samples import Joined

    is_log = [holds_log(path) for path in recordings]
    if not any(is_log):
        return open_recording(recordings, **reading)
    if not all(is_log) and options["sensor"] is not None:
        table = next(path for path, log in zip(recordings, is_log, strict=True) if not log)
        raise UsageError(f"--sensor chooses a magnetometer of a log, and {table} is none: calibrate them one by one")
    found = open_recording(recordings, sensor=options["sensor"], **reading)
    first = found.recordings[0] if isinstance(found, Joined) else found
    if isinstance(first, Instrument):
        options["sensor"] = first.name
    return found


def is_all(recordings: Sequence[str], sensor: str | None) -> bool:
    """Whether each magnetometer of a log is to be calibrated on its own.

    Raises
    ------
    UsageError
        Where several files, or something else than a log, are to be.
    """
    from flinders.readers import holds_log

    if sensor is None or sensor.strip().casefold() != ALL:
        return False
    if len(recordings) > 1 or not holds_log(recordings[0]):
        raise UsageError("--sensor all goes with one log of several magnetometers: give one, or leave it out")
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
) -> int:
    """Calibrate each magnetometer of a log, and print a table of what was found.

    Returns
    -------
    int
        The exit code: that of the worst.
    """
    from flinders.files import refuse_existing
    from flinders.readers import open_log
    from flinders.report.info import fits

    for option, value in beside.items():
        if value is not None:
            raise UsageError(f"{option} is for one magnetometer: leave it out with --sensor all, or choose one")
    if output == "-":
        raise UsageError(
            "several calibrations do not go to standard output: name files, such as -o compass-{sensor}.json"
        )
    with progress("reading") as watch:
        asked = {name: value for name, value in reading.items() if name not in {"as_logged", "topic"}}
        log = open_log(recordings[0], progress=watch, **asked)
        paths = [_named(output, number) for number in range(1, len(log.instruments) + 1)]
        for each in filter(None, paths):
            _options.refuse_to_overwrite(each, recordings)
            refuse_existing(each, force=force)
        outcomes = []
        for instrument, path in zip(log.instruments, paths, strict=True):
            outcome = _fitted(instrument, by, options, as_logged=reading["as_logged"], path=path, force=force)
            outcomes.append((instrument.name, outcome))
    if as_json:
        print_json({"sensors": [_row(*found, path) for found, path in zip(outcomes, paths, strict=True)]})
    else:
        click.echo(drawn(fits(outcomes, options["target_deg"]), sys.stdout))
    written = [
        path for path, (_, outcome) in zip(paths, outcomes, strict=True) if path and not isinstance(outcome, FitError)
    ]
    say(
        f"written to {', '.join(written)}"
        if written
        else "nothing was written: name files with -o compass-{sensor}.json"
    )
    return max(_exit_code(outcome) for _, outcome in outcomes)


def _fitted(
    instrument: Instrument,
    by: Filter | None,
    options: dict[str, Any],
    *,
    as_logged: bool,
    path: str | None,
    force: bool,
) -> Fit | FitError:
    """Fit one magnetometer and write its calibration; a refusal is a result like any other."""
    from dataclasses import replace

    from flinders.fitting import fit

    part = Counted(replace(instrument, as_logged=as_logged))
    say(str(part.recording))
    asked = {**options, "sensor": instrument.name}
    try:
        with saying_what_was_skipped([part.recording]):
            if by is None:
                found = fit(_filters.through([part], None), **asked)
            else:
                found = _filters.fit_filtered([part], by, asked)
    except FitError as refusal:
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


def _row(name: str, outcome: Fit | FitError, path: str | None) -> dict[str, Any]:
    """JSON-ready: the fit as ``calibrate --json`` has it, and of which magnetometer it is."""
    if not isinstance(outcome, FitError):
        return {"sensor": name, "written": path, **outcome.as_dict()}
    fit = getattr(outcome, "fit", None)
    told = {"code": outcome.code, "message": str(outcome), "evidence": dict(outcome.evidence)}
    return {"sensor": name, "written": None, "verdict": "refused", **(fit.as_dict() if fit else {}), "error": told}


def _exit_code(outcome: Fit | FitError) -> int:
    if isinstance(outcome, FitError):
        return REFUSED
    return GOOD if outcome.verdict == "good" else LIMITED
