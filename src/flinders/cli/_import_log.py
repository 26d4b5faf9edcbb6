"""``flinders import`` of a log: one file for each magnetometer, with the calibration that the vehicle used."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from flinders.cli._inputs import provenance, source_file
from flinders.cli._multi_sensor import path_for_sensor
from flinders.cli._output import Outputs, print_json, progress, say, strength_words
from flinders.core.geomag import recorded_field
from flinders.errors import FlindersError, NoOnboardCalibration, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.readers import Instrument, Log


def is_log(path: str) -> bool:
    """Whether a file is a log with magnetometers, and not a calibration file of another tool."""
    from flinders.readers import holds_log

    with suppress(FlindersError):
        return holds_log(path)
    return False


def import_log(
    path: str, *, sensor: str | None, field_strength: float | None, output: str, force: bool, as_json: bool
) -> None:
    """Write the onboard calibration of one magnetometer of a log, or of each magnetometer that has one.

    Raises `NoOnboardCalibration` if no magnetometer has an onboard calibration.
    """
    from flinders.core.calibration_file import dumps
    from flinders.readers import open_log

    with progress("reading") as watch:
        log = open_log(path, progress=watch)
    chosen = _choose_magnetometers(log, sensor)
    is_all = len(chosen) != 1 or (sensor or "").strip().casefold() == "all"
    if is_all and output == "-":
        raise UsageError(
            "several calibrations do not go to standard output: name files, such as -o board-{sensor}.json"
        )
    paths = [path_for_sensor(output, log.instruments.index(each) + 1) if is_all else output for each in chosen]
    outputs = Outputs.of(*(("the calibration", each) for each in paths), force=force, as_json=as_json)
    outputs.check([path])
    found = [onboard_calibration(each, field_strength) for each in chosen]
    for instrument, calibration, written in zip(chosen, found, paths, strict=True):
        outputs.write(dumps(calibration.to_document(provenance=_provenance(instrument))), written)
    if as_json:
        rows = zip(chosen, found, paths, strict=True)
        print_json({"log": log.format, "sensors": [_row(*row) for row in rows]})
    for instrument, calibration in zip(chosen, found, strict=True):
        _say(instrument, calibration)
    outputs.say_written()


def _choose_magnetometers(log: Log, sensor: str | None) -> Sequence[Instrument]:
    """Magnetometers to import: the named one, or else the only calibrated one; all calibrated ones for ``all``."""
    if sensor is not None and sensor.strip().casefold() != "all":
        return [log.sensor(sensor)]
    known = [each for each in log.instruments if each.onboard is not None]
    if not known:
        raise NoOnboardCalibration(f"{log.source}: the log contains no calibration of a magnetometer")
    if sensor is None and len(known) > 1:
        names = ", ".join(f"{log.instruments.index(each) + 1} {each.name}" for each in known)
        raise UsageError(f"{log.source} has calibrations of {names}: choose one, or all", hint={"sensor": None})
    return known


def onboard_calibration(instrument: Instrument, field_strength: float | None) -> Calibration:
    """The onboard calibration; `field_strength`, unless it is None, becomes its known field strength."""
    from flinders.workflows.onboard import onboard_fit

    calibration = onboard_fit(instrument).calibration
    if field_strength is None:
        return calibration
    return replace(calibration, field_strength=field_strength, field_strength_known=True)


def _provenance(instrument: Instrument) -> ProvenanceRecord:
    """Provenance that names the vehicle's compass. It lists no readings, as no readings of the log were used."""
    from flinders.estimators.data import CountedRecording

    return provenance(files=[source_file(CountedRecording(instrument))])


def _row(instrument: Instrument, calibration: Calibration, path: str | None) -> dict[str, Any]:
    """JSON-ready row of one magnetometer and its onboard calibration."""
    words = "" if instrument.stored is None else instrument.stored.words
    return {"sensor": instrument.name, "written": path, "words": words, "calibration": calibration.as_dict()}


def _say(instrument: Instrument, calibration: Calibration) -> None:
    """Print the onboard calibration that was found, and its caveats."""
    stored = instrument.stored
    assert stored is not None
    say(f"{instrument.source}: {instrument.name} had {stored.words} in force")
    if stored.changes:
        say(f"! it changed {stored.changes} times in the log: this is the last one")
    if not calibration.field_strength_known:
        is_placed = recorded_field(instrument) is not None
        what = "that of the place, since the vehicle stores none" if is_placed else "a nominal value"
        say(strength_words(calibration, what))
