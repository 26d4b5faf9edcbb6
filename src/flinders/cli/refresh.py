"""``flinders refresh``: the hard iron of a calibration renewed from a short recording."""

from __future__ import annotations

from typing import Any

from flinders.cli import _options as option
from flinders.cli._inputs import Counted, load, open_with, provenance, refuse_calibrations, say_sensor
from flinders.cli._program import EXITS
from flinders.cli.calibrate import SiteOptions, recorded
from flinders.errors import UsageError


class Refresh(option.Group):
    """A short recording, the earlier calibration, what counts beside it, and where the new one goes."""

    recording: str = option.argument("RECORDING")
    previous: str = option.member(
        "--previous", metavar="CALIBRATION", required=True, help="The earlier calibration of this sensor."
    )
    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output; without it nothing is written."
    )
    reading: option.PartOfColumns = option.group(option.PartOfColumns)
    sensor: str | None = option.sensor_of_calibration()
    names: tuple[str, ...] = option.member(
        "--with", heading=option.AIDING, multiple=True, metavar="NAME,…",
        help="What else was recorded and shall count: rate, dip, tilt, attitude.",
    )  # fmt: skip
    soft_iron_sigma: float = option.member(
        "--soft-iron-sigma", heading=option.METHOD, metavar="SHARE", default=0.0, show_default=True,
        type=option.within(0, 0.5, "a share from 0 to 0.5, such as 0.005", zero=True),
        help="What the soft iron may have changed by, 1 σ.",
    )  # fmt: skip
    place: str | None = option.same_as(SiteOptions, "place")
    date: str | None = option.same_as(SiteOptions, "date")
    target_deg: float = option.target()
    dip_deg: float | None = option.dip(
        "Inclination of the field [default: that of the site, else as CALIBRATION says]."
    )
    force: bool = option.force()
    as_json: bool = option.as_json()


@option.command_of(
    "refresh",
    Refresh,
    common=("previous", "output", "names", "target_deg", "as_json"),
    short_help="Renew the hard iron of a calibration in ten seconds.",
    epilog="""\b
Example:
  flinders refresh --previous calibration.json wobble.csv -o refreshed.json
  flinders refresh --previous calibration.json wobble.csv --with rate -o refreshed.json

\b
Exit codes:
  0  good
  3  limited: written, with what limits it; also where the soft iron no longer fits
  4  refused: nothing written
""",
)
def command(options: Refresh) -> int:
    """Find the offset again after something magnetic was moved on a vehicle, and keep the soft iron.

    Wobble the vehicle by 30° to all sides for ten seconds, or turn it on level ground, while recording. The soft iron
    of CALIBRATION counts with its uncertainty; where the readings contradict it the verdict says so. Unit and axes
    are those of the calibration file.
    """
    from flinders.core.calibration_file import dumps
    from flinders.fitting.refreshing import refresh
    from flinders.report.fit_pages import of_fit

    outputs = options.checked_outputs(options.recording)
    refuse_calibrations([options.recording])
    previous = load("refresh --previous", options.previous)
    recording = open_with(previous.calibration, options.recording, sensor=options.sensor, **options.reading.as_dict())
    say_sensor(options.previous, previous.calibration, recording, options.sensor)
    counted = Counted(recording)
    fit = refresh(
        counted,
        previous,
        aiding=_aiding(options.names),
        soft_iron_sigma=options.soft_iron_sigma,
        target_deg=options.target_deg,
        **_site(options, recording),
    )
    outputs.write(dumps(fit.to_document(provenance([counted], files=previous.files))), options.output)
    outputs.print(fit.as_dict, lambda: of_fit(fit))
    outputs.say_written("nothing was written: name a file with -o refreshed.json")
    return EXITS[fit.verdict]


def _aiding(names: tuple[str, ...]) -> tuple[str, ...]:
    """The aiding sensors that are named."""
    aiding, disturbances = recorded(names)
    if disturbances or "auto" in aiding:
        raise UsageError(
            f"--with {','.join(names)}: a refresh takes rate, dip, tilt and attitude, each by its name; disturbances "
            "need a new calibration: flinders calibrate --with"
        )
    return aiding


def _site(options: Refresh, recording: object) -> dict[str, Any]:
    """Site and dip, as they were typed or as the log says."""
    site = SiteOptions(place=options.place, date=options.date, gain_sigma=None)
    known = {**site.as_options(), **site.told_by(recording)}
    return known if options.dip_deg is None else {**known, "dip_deg": options.dip_deg}
