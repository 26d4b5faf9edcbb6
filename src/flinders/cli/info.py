"""``flinders info``: the contents of a recording, and the command to type next."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import refuse_calibration, site_of
from flinders.cli._output import print_result, progress, say
from flinders.cli._spelling import in_options
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField
    from flinders.readers import Log


class Info(program.Group):
    """A recording, options for reading it, and its place."""

    log: str = program.argument("LOG")
    reading: option.ReadingOptions = program.group(option.ReadingOptions)
    place: option.Place = program.group(option.Place)
    chip: str | None = program.member(
        "--chip", metavar="NAME",
        help="Magnetometer chip, or package that holds it, as flinders chips lists them [default: by names in LOG].",
    )  # fmt: skip
    grid: bool = option.grid("Also give grid north of the map: UTM, or UPS around the poles.")
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
    """Show the contents of LOG: its magnetometers with rate, range and gaps, and its other columns.

    Also shown are the onboard calibration, place and time, the expected field, the share of directions covered, and the
    command to type next. LOG is any recording that `flinders calibrate` takes, or a set of recordings: a folder, a
    table of many units, or a result of `flinders fleet`.
    """
    from flinders.core.plugins import other_contents
    from flinders.readers import open_log
    from flinders.report.recording import commands_for, page_of_contents
    from flinders.workflows.recording_contents import contents

    other = other_contents(options.log)
    if other is not None and not other.is_one_recording:
        print_result(other.as_dict, other.page, as_json=options.as_json)
        return
    refuse_calibration(options.log, "give a recording; flinders show shows the contents of a calibration")
    options.place.check()
    reading = options.reading
    with progress("reading") as watch:
        log = open_log(options.log, progress=watch, **reading.as_dict())
        columns, unit, site = reading.columns, reading.unit, _site(log, options.place)
        held = contents(
            log, topic=reading.topic, columns=columns, unit=unit, chip=options.chip, site=site, spell=in_options
        )
    typed = [word for each in reading.typed_options().items() for word in _words(*each)]
    held = replace(held, commands=commands_for(options.log, held.sensors, typed))
    if options.grid and held.site is None:
        raise UsageError(f"grid north needs a place, and {options.log} states none: give --at LAT,LON")
    print_result(held.as_dict, lambda: page_of_contents(held, grid=options.grid), as_json=options.as_json)
    if other is not None:
        say(other.advice)


def _words(name: str, value: object) -> list[str]:
    """An option as it is typed.

    >>> _words("--from", 5.0), _words("--as-logged", True)
    (['--from', '5'], ['--as-logged'])
    """
    if value is True:
        return [name]
    return [name, f"{value:.12g}" if isinstance(value, float) else str(value)]


def _site(log: Log, place: option.Place) -> SiteField | None:
    """The field at the given place, on the day of the log; None without a place."""
    if place.place is None:
        return None
    day = place.date or (log.start_time.date().isoformat() if log.start_time else None)
    return site_of(place.place, day, model=place.model)
