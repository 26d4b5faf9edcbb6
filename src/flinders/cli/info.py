"""``flinders info``: what a recording holds, and what to type next."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import refuse_calibration, site_of
from flinders.cli._output import print_result, progress

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField
    from flinders.readers import Log
    from flinders.report.recording import Contents


class Info(program.Group):
    """A recording, how it is read, and where it was made."""

    log: str = program.argument("LOG")
    reading: option.ReadingOptions = program.group(option.ReadingOptions)
    place: option.Place = program.group(option.Place)
    as_json: bool = option.as_json()


@program.command_of(
    "info",
    Info,
    common=("columns", "unit", "place", "date", "as_json"),
    epilog="""\b
Example:
  flinders info flight.bin
  flinders info walk.zip --at 47.62,-122.35 --date 2026-11-21
  flinders info table.parquet --columns bx,by,bz --unit nT --json
""",
)
def command(options: Info) -> None:
    """Say what LOG holds: its magnetometers, their rate, range and gaps, and what stands beside them.

    Also the calibration that was in force on board, place and time, and the field that is expected there; how many
    directions were seen, and the command to type next. LOG is any recording that `flinders calibrate` takes.
    """
    from flinders.readers import open_log
    from flinders.report.recording import of_contents

    refuse_calibration(options.log, "give a recording; flinders show says what a calibration holds")
    options.place.check()
    with progress("reading") as watch:
        contents = _contents(open_log(options.log, progress=watch, **options.reading.as_dict()), options)
    print_result(contents.as_dict, lambda: of_contents(contents), as_json=options.as_json)


def _contents(log: Log, options: Info) -> Contents:
    """Go through each magnetometer once, and put together what was found."""
    from flinders.report.recording import Contents, commands_for, sensors_of

    reading, file, position = options.reading, log.instruments[0].file, log.position
    site = _site(log, options.place)
    sensors = sensors_of(log, reading.topic, columns=reading.columns, unit=reading.unit)
    return Contents(
        source=log.source,
        format=log.format,
        bytes=None if file is None else file.size,
        start=None if log.begun is None else log.begun.strftime("%Y-%m-%d %H:%M:%S"),
        position=None if position is None else (position.latitude_deg, position.longitude_deg, position.altitude_m),
        site=site,
        sensors=sensors,
        commands=commands_for(
            options.log, sensors, [word for each in reading.typed().items() for word in _words(*each)]
        ),
        notes=log.notes,
    )


def _words(name: str, value: object) -> list[str]:
    """An option as it is typed.

    >>> _words("--from", 5.0), _words("--as-logged", True)
    (['--from', '5'], ['--as-logged'])
    """
    if value is True:
        return [name]
    return [name, f"{value:.12g}" if isinstance(value, float) else str(value)]


def _site(log: Log, place: option.Place) -> SiteField | None:
    """The field at the place that is given, or that the log knows, on its day."""
    from flinders.core.geomag import recorded_field

    if place.place is not None:
        return site_of(place.place, place.date or (log.begun.date().isoformat() if log.begun else None))
    return recorded_field(log)
