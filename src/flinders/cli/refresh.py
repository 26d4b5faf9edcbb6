"""``flinders refresh``: renew the hard iron of a calibration from a short recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._calibrate_options import SiteOptions, split_recorded_names
from flinders.cli._inputs import (
    clock_start,
    load,
    provenance,
    refuse_calibrations,
    report_readings,
    say_sensor,
    site_of,
)
from flinders.cli._output import refuse_twice, say
from flinders.cli._program import EXITS
from flinders.cli._spelling import in_options
from flinders.core.plugins import app_modules, remark
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import FieldModel, SiteField
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.likelihood.site_field import Site
    from flinders.readers._resample import TimeSeries


READS_COURSES: Final = bool(app_modules("COURSES"))
"""Whether an installed app reads logs of courses."""


class Refresh(program.Group):
    """A short recording, the earlier calibration, aiding data, and the output file."""

    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1)
    previous: str = program.member(
        "--previous", metavar="CALIBRATION", required=True, help="The earlier calibration of this sensor."
    )
    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output; without it nothing is written."
    )
    reading: option.PartOfColumns = program.group(option.PartOfColumns)
    sensor: str | None = option.sensor_of_calibration()
    names: tuple[str, ...] = program.member(
        "--with", heading=program.AIDING, multiple=True, metavar="NAME,…", keywords=("aiding", "disturbances"),
        help="Other recorded quantities to use: rate, dip, tilt, attitude.",
    )  # fmt: skip
    soft_iron_sigma: float = program.member(
        "--soft-iron-sigma", heading=program.METHOD, metavar="SHARE", default=0.0, show_default=True,
        type=program.number_within(0, 0.5, "a share from 0 to 0.5, such as 0.005", zero=True),
        help="Possible change of the soft iron, 1 σ.",
    )  # fmt: skip
    headings: str | None = program.member(
        "--heading", heading=program.SITE, metavar="DEG,…",
        help="True heading of the vehicle, at rest, in each RECORDING; needs --at and --date, or a log with both.",
    )  # fmt: skip
    magnetic_headings: str | None = program.member(
        "--magnetic-heading", heading=program.SITE, metavar="DEG,…",
        help="Magnetic heading instead of --heading; with --dip or --at.",
    )  # fmt: skip
    is_course: bool = program.flag(
        "--course", "Use the courses over ground in RECORDING, a log with satellite fixes, as headings.",
        heading=program.SITE,
    )  # fmt: skip
    course_log: str | None = program.member(
        "--course-log", heading=program.SITE, metavar="FILE", hidden=not READS_COURSES,
        help=f"As --course, from a separate log{remark('course log', before=', ')}.",
    )  # fmt: skip
    slowest: float = program.member(
        "--min-speed", heading=program.SITE, type=program.positive, default=3.0, show_default=True, metavar="M/S",
        help="Speed over ground below which a course is not used.",
    )  # fmt: skip
    crab_deg: float = program.member(
        "--crab", heading=program.SITE, type=program.number_within(0, 45, "degrees from 0 to 45", zero=True),
        default=2.0, show_default=True, metavar="DEG",
        help="Angle between course and heading due to wind or current, 1 σ.",
    )  # fmt: skip
    place: str | None = program.same_as(SiteOptions, "place")
    date: str | None = program.same_as(SiteOptions, "date")
    model: FieldModel | None = option.field_model()
    target_deg: float = option.target()
    dip_deg: float | None = option.dip(
        "Inclination of the field [default: that of the site, else of CALIBRATION].", keywords=("site",)
    )
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "refresh",
    Refresh,
    common=("previous", "output", "names", "headings", "target_deg", "as_json"),
    epilog="""\b
Example:
  flinders refresh --previous calibration.json wobble.csv -o refreshed.json
  flinders refresh --previous calibration.json wobble.csv --with rate -o refreshed.json
  flinders refresh --previous calibration.json north.csv south.csv --magnetic-heading 0,180 --dip 66
  flinders refresh --previous calibration.json drive.bin --course -o refreshed.json

\b
Exit codes:
  0  good
  3  limited: written, with its limits; also if the soft iron no longer fits
  4  refused: nothing written
""",
)
def command(options: Refresh) -> int:
    """Estimate the offset again after magnetic parts of a vehicle were changed, and keep the soft iron.

    Wobble the vehicle by 30° to all sides for ten seconds, or turn it on level ground, while recording. The soft iron
    of CALIBRATION is used with its uncertainty; readings that contradict it are reported. Unit and axes are those of
    the calibration file. A vehicle that cannot be turned is recorded at rest at one or more known headings, in one
    RECORDING for each heading (--heading). A vehicle whose heading is its course is driven straight on several
    headings; the courses in its log then serve as headings (--course).
    """
    from flinders.core.calibration_file import dumps
    from flinders.fitting.fit_json import json_of
    from flinders.fitting.result import document_of, with_walk
    from flinders.report.fit_pages import page_of_fit

    outputs = options.checked_outputs(*options.recordings)
    refuse_twice(options.recordings)
    previous = load("refresh --previous", options.previous, options.recordings)
    refuse_calibrations(options.recordings)
    opened = [_open(path, previous, options) for path in options.recordings]
    _refuse_known(options.previous, previous, opened)
    with report_readings(opened):
        fit = with_walk(_run_refresh(opened, previous, options), previous.provenance.walk)
    outputs.write(dumps(document_of(fit, provenance(opened, files=previous.provenance.files))), options.output)
    outputs.print(lambda: json_of(fit), lambda: page_of_fit(fit, in_options))
    outputs.say_written("nothing was written: name a file with -o refreshed.json")
    return EXITS[fit.verdict]


def _open(path: str, previous: Fit, options: Refresh) -> CountedRecording:
    """Open a recording in the unit and axes of the earlier calibration, and print its magnetometer."""
    from flinders.estimators.data import CountedRecording
    from flinders.workflows.recordings import open_with

    recording = open_with(previous, path, sensor=options.sensor, **options.reading.as_dict())
    say_sensor(options.previous, previous.calibration, recording, options.sensor)
    return CountedRecording(recording)


def _refuse_known(path: str, previous: Fit, opened: list[CountedRecording]) -> None:
    """Refuse a recording of the earlier calibration: readings counted twice would understate the error."""
    from flinders.workflows.recordings import own_recordings

    if names := own_recordings(previous, opened):
        raise UsageError(
            f"{path} was made from {' and '.join(names)}: readings counted twice would understate the error; "
            "record again after the change"
        )


def _run_refresh(opened: list[CountedRecording], previous: Fit, options: Refresh) -> Fit:
    """Refresh from a recording in motion, or from poses at known headings."""
    from flinders.fitting.known_heading import refresh_at_headings
    from flinders.fitting.refreshing import refresh

    if options.is_course or options.course_log is not None:
        return _refresh_on_courses(opened, previous, options)
    site, target_deg = _site(options, opened[0].recording), options.target_deg
    if program.is_typed("slowest") or program.is_typed("crab_deg"):
        raise UsageError("--min-speed and --crab need --course or --course-log: leave them out")
    if options.headings is None and options.magnetic_headings is None:
        if len(opened) > 1:
            raise UsageError(
                "several recordings need --heading with one heading for each: give one recording, or the headings"
            )
        aiding = _aiding(options.names)
        softness = options.soft_iron_sigma
        return refresh(opened[0], previous, aiding=aiding, site=site, soft_iron_sigma=softness, target_deg=target_deg)
    if options.names or options.soft_iron_sigma:
        raise UsageError("--with and --soft-iron-sigma need a recording in motion: leave them out with --heading")
    headings = _magnetic_headings(options, opened[0].recording)
    return refresh_at_headings(opened, previous, headings, site=site, target_deg=target_deg)


def _refresh_on_courses(opened: list[CountedRecording], previous: Fit, options: Refresh) -> Fit:
    """Refresh from the courses of one log, which are in the recording or in a separate log."""
    from flinders.core.geomag import recorded_field
    from flinders.fitting.known_heading import refresh_on_courses

    if len(opened) > 1 or options.headings or options.magnetic_headings or options.names or options.soft_iron_sigma:
        raise UsageError("--course takes one log, without --heading, --magnetic-heading, --with and --soft-iron-sigma")
    recording = opened[0].recording
    velocity, log = _courses(recording, options.course_log)
    place = recorded_field(log) if options.place is None else _field(options, options.place)
    if place is None:
        raise UsageError("courses are true: they need the declination of the place, give --at and --date")
    return refresh_on_courses(
        opened[0],
        previous,
        velocity,
        declination_deg=place.declination_deg,
        slowest=options.slowest,
        crab_deg=options.crab_deg,
        target_deg=options.target_deg,
        site=_site(options, log),
    )


def _courses(recording: Any, path: str | None) -> tuple[TimeSeries, object]:  # noqa: ANN401 - a recording of any reader
    """Velocity over ground by the clock of a recording, and the log that contains it, which may be a separate one."""
    from flinders.readers._courses import read_courses

    if path is not None:
        log, start = read_courses(path), clock_start(recording)
        say(f"{log.source}: {log.words}")
        if not start:
            raise UsageError(
                f"the times of {recording.source} do not count from 1970, unlike those of {log.source}: record both "
                "with the clock of one computer"
            )
        return log.velocity_on_clock(start), log
    if (velocity := getattr(recording, "velocity", None)) is None:
        raise UsageError(
            f"{recording.source} has no speed and course from satellites: give a log with them, "
            f"{'a separate log with them (--course-log), ' * READS_COURSES}or record at known headings (--heading)"
        )
    return velocity, recording


def _magnetic_headings(options: Refresh, recording: object) -> list[float]:
    """Magnetic headings, as typed or from typed true headings and the declination."""
    from flinders.core.geomag import recorded_field

    typed = options.headings if options.magnetic_headings is None else options.magnetic_headings
    if options.headings is not None and options.magnetic_headings is not None:
        raise UsageError("give --heading or --magnetic-heading, not both")
    numbers = program.numbers_of(typed or "")
    if not numbers:
        raise UsageError(f"headings are {typed!r}: need degrees separated by commas, such as 0,90,180,270")
    if options.headings is None:
        return numbers
    place = recorded_field(recording) if options.place is None else _field(options, options.place)
    if place is None:
        raise UsageError(
            "a true heading needs the declination of the place: give --at and --date, or --magnetic-heading"
        )
    return [number - place.declination_deg for number in numbers]


def _aiding(names: tuple[str, ...]) -> tuple[str, ...]:
    """The aiding sensors named by ``--with``."""
    aiding, disturbances = split_recorded_names(names)
    if disturbances or "auto" in aiding:
        raise UsageError(
            f"--with {','.join(names)}: a refresh takes rate, dip, tilt and attitude, each by its name; disturbances "
            "need a new calibration: flinders calibrate --with"
        )
    return aiding


def _field(options: Refresh, place: str) -> SiteField:
    """The field at the typed place."""
    return site_of(place, options.date, model=options.model)


def _site(options: Refresh, recording: object) -> Site | None:
    """Site and dip, as typed or as the log states them."""
    from flinders.likelihood.site_field import Site

    site = SiteOptions(place=options.place, date=options.date, model=options.model, gain_sigma=None)
    return Site.merge_stated(site.typed_site() or site.told_by(recording), inclination_deg=options.dip_deg)
