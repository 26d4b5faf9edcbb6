"""``flinders heading``: a recording as magnetic and true headings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _compass, _disturbances, _options
from flinders.cli._inputs import choice, clock_start, load, read_and_left_out, say_sensor
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, drawn, print_json, progress, say, written

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.cli._options import PartOfColumns
    from flinders.core.samples import Samples
    from flinders.heading.compass import Voyage
    from flinders.heading.smoothing import Filter


@_options.old_command(
    "heading",
    common=("output", "place", "date", "is_level", "as_json"),
    short_help="Turn a recording into magnetic and true headings.",
    epilog="""\b
Example:
  flinders heading calibration.json log.csv -o headings.csv
  flinders heading calibration.json log.csv --at 47.62,-122.35 --date 2026-11-21
  tail -f log.csv | flinders heading calibration.json - --level
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("log", metavar="LOG")
@option("-o", "--output", default="-", metavar="FILE", help="Where to write [default: standard output].")
@_options.old_groups(reading=_options.PartOfColumns, place=_options.Place, accelerometer=_options.Accelerometer)
@_options.old_sensor_of_calibration
@option(
    "--declination", "declination_deg", heading=_options.SITE,
    type=_options.within(-180, 180, "degrees from -180 to 180"), metavar="DEG",
    help="Declination, east positive, where it is known otherwise.",
)  # fmt: skip
@_options.old_dip("Inclination of the field [default: that of --at, else as it is seen, else 60].")
@_options.old_fixed
@option(
    "--formula", heading=_options.METHOD, type=click.Choice(["exact", "an4248", "an3192"]), default="exact",
    show_default=True, help="How tilt is taken off; all but exact are for comparison.",
)  # fmt: skip
@_options.old_smoothing
@_options.old_force
@_options.old_as_json
def command(
    calibration: str,
    log: str,
    output: str,
    dip_deg: float | None,
    by: Filter | None,
    force: bool,
    as_json: bool,
    sensor: str | None,
    reading: PartOfColumns,
    **options: Any,
) -> None:
    """Write the heading of each reading of LOG, corrected with CALIBRATION, as comma-separated text.

    It is the heading of the sensor's x axis, clockwise from magnetic north, with the tilt taken off by the
    accelerometer in LOG at any attitude. With --at it is also counted from true north. LOG is a file, or - for
    standard input, which may go on as long as it likes: lines are written as they come.
    """
    outputs = Outputs.of(("headings", output), force=force, as_json=as_json)
    outputs.check([calibration, log])
    with progress("heading") as bar:
        known = load("heading", calibration, [log]).calibration
        wanted = choice(known, sensor)
        opened = _compass.open_log(
            "heading", calibration, log, sensor=wanted, progress=bar, **options, **reading.as_dict()
        )
        say(str(opened))
        say_sensor(calibration, known, opened.recording, sensor)
        if by is not None:
            from flinders.cli._filters import Smoother

            opened.smoother = Smoother(by)
        watched = _compass.Watch(opened, dip_deg)
        lines = _lines(watched)
        first = next(lines, "")  # what is wrong is found before the output is opened
        with written(output, force=force, live=not Path(log).is_file()) as file:
            file.write(first)
            for block in lines:
                file.write(block)
    rows, left_out = watched.corrector.strength.readings, getattr(opened.recording, "skipped", ())
    say(f"{opened.recording.source}: {read_and_left_out(rows, left_out)}")
    if opened.smoother is not None:
        say(str(opened.smoother))
    extrapolated = _disturbances.say_beyond(opened.settler)
    claimed = claims(opened, watched.voyage, dip_deg=dip_deg)
    _tell(opened, watched.voyage, claimed, plausible=watched.corrector.is_plausible)
    if opened.fit.tilt_words:
        say(f"! {opened.fit.tilt_words}")
    outputs.say_written()
    if as_json:
        skipped = [str(entry) for entry in left_out]
        filtered = {} if opened.smoother is None else {"filter": opened.smoother.as_dict()}
        seen = summary(opened, watched.voyage, claimed, watched.corrector.strength.as_dict(), skipped)
        print_json({**seen, **filtered, **extrapolated})


def _lines(watch: _compass.Watch) -> Iterator[str]:
    """Yield a header with the lines of the first block, then the lines of each block."""
    header = ""
    for numbers, samples, headings in watch.headings():
        columns = {**_numbered(watch.log, numbers, samples), **headings.columns()}
        yield ("" if header else ",".join(columns) + "\n") + _rows(columns)
        header = "written"


def _numbered(log: _compass.HeadingLog, numbers: Floats, samples: Samples) -> dict[str, Floats]:
    """The columns that say which reading it is."""
    named = {"line" if hasattr(log.recording, "numbered_blocks") else "reading": numbers}
    if samples.time is not None:
        named["time_s"] = samples.time + clock_start(log.recording)
    return named


FORMATS: Final = {
    "line": "%.0f", "reading": "%.0f", "time_s": "%.6f", "heading_deg": "%.3f", "true_heading_deg": "%.3f",
    "roll_deg": "%.3f", "pitch_deg": "%.3f", "dip_deg": "%.3f", "strength": "%.5f",
}  # fmt: skip
"""How each column is written."""


def _rows(columns: dict[str, Floats]) -> str:
    """Lines of a block; a heading is rounded before it goes round, so that 360.000 is never written."""
    import numpy as np

    from flinders.geometry.angles import wrapped

    rounded = [wrapped(np.round(values, 3)) if "heading" in name else values for name, values in columns.items()]
    form = ",".join(FORMATS[name] for name in columns)
    return "".join(form % tuple(row) + "\n" for row in np.column_stack(rounded).tolist())


def claims(log: _compass.HeadingLog, voyage: Voyage, *, dip_deg: float | None) -> dict[str, Any]:
    """What heading error to expect, 1 σ, at the dip of the site, of a level vehicle and as far as it was tilted."""
    from flinders.heading.error_propagation import level_error, tilted_error

    dip, source = _compass.site_dip(log, voyage, dip_deg)
    told: dict[str, Any] = {"dip_deg": dip, "dip_from": source, "level": None, "tilted": None}
    if not log.fit.states_uncertainty:
        return told
    ellipsoid, covariance, down = log.fit.ellipsoid, log.fit.covariance, _compass.down(log, voyage)
    told["level"] = level_error(ellipsoid, covariance, dip_deg=dip, down=down)
    if voyage.tilt_deg >= 1.0:
        told["tilted"] = tilted_error(ellipsoid, covariance, dip_deg=dip, tilt_deg=voyage.tilt_deg, down=down)
    return told


def summary(
    log: _compass.HeadingLog, voyage: Voyage, told: dict[str, Any], strength: dict[str, Any], skipped: list[str]
) -> dict[str, Any]:
    """JSON-ready."""

    def error(heading_error: Any) -> dict[str, float] | None:  # noqa: ANN401 - a HeadingError or nothing
        if heading_error is None:
            return None
        return {
            "rms": heading_error.rms,
            "worst": heading_error.worst,
            "dip_deg": heading_error.dip_deg,
            "tilt_deg": heading_error.tilt_deg,
        }

    return {
        **voyage.as_dict(),
        "formula": log.compass.formula,
        "heading_error_deg": error(told["level"]),
        "tilted_heading_error_deg": error(told["tilted"]),
        "dip_from": told["dip_from"],
        "declination_deg": log.compass.declination_deg,
        "site": None if log.site is None else log.site.as_dict(),
        **strength,
        "skipped": skipped,
    }


def _tell(log: _compass.HeadingLog, voyage: Voyage, told: dict[str, Any], *, plausible: bool) -> None:
    """Say on standard error how good the headings are, and what to know about them."""
    from flinders.report.heading_pages import of_headings

    say(
        drawn(
            of_headings(
                voyage,
                formula=log.compass.formula,
                site=log.site,
                declination_deg=log.compass.declination_deg,
                claims=told,
                plausible=plausible,
                turned=log.compass.acceleration_axes,
            ),
            sys.stderr,
        )
    )
