"""Contents of a recording or log as a page for the terminal, with the next commands to type."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.padding import Padding
from rich.text import Text

from flinders.core.files import free_path
from flinders.core.units import COUNTS, WIDE_EARTH_FIELD_RANGE_UT, unit_label
from flinders.errors import count_text, figures
from flinders.readers._likeness import looks_like
from flinders.report.formatting import duration_words
from flinders.report.heading_pages import grid_words
from flinders.report.terminal import facts, next_commands, page
from flinders.report.terminal import notes as marked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from flinders.core.geomag import SiteField
    from flinders.workflows.chip_proposal import ChipProposal
    from flinders.workflows.recording_contents import Contents, RecordedSensor

MAX_REPEATED_SHARE: Final = 0.02
"""Share of repeated readings above which a remark is made."""
MAX_STRENGTH_DEVIATION: Final = 0.25
"""Largest relative deviation of the measured field strength from the site's without a remark on iron."""
TITLE_WIDTH: Final = 11
MAX_CHIPS: Final = 6
"""Largest number of chip names in a line; ``--json`` has all."""
NONE_USABLE_WORDS: Final = (
    "No magnetometer of it can be calibrated from this recording, for the reasons marked ! above."
)
CALIBRATION: Final = Path("calibration.json")


def page_of_contents(contents: Contents, *, grid: bool = False) -> RenderableType:
    """Lay out the contents of a file, and the next commands; with `grid` also grid north at the recorded place."""
    sensors = [_sensor_block(sensor, contents.site) for sensor in contents.sensors]
    said = next_commands(contents.commands) if contents.commands else Text(NONE_USABLE_WORDS)
    return Group(_file_block(contents, grid=grid), page(*sensors, said))


def commands_for(path: str, sensors: Sequence[RecordedSensor], options: Sequence[str]) -> tuple[str, ...]:
    """The next commands: for the magnetometer with the best coverage and, if several are usable, for all.

    `options` are the options with which the recording was read. There are no commands for a sensor that is probably not
    a magnetometer, or that `flinders calibrate` refuses because of few readings or little motion.
    """
    usable = [sensor for sensor in sensors if sensor.is_fit_for_use]
    if not usable:
        return ()
    if len(sensors) == 1:
        return (calibrate_command(path, *options),)
    best = max(usable, key=lambda sensor: sensor.coverage or 0.0)
    one = calibrate_command(path, *options, "--sensor", str(best.number))
    if len(usable) == 1:
        return (one,)
    return one, f"{shlex.join([*_calibrate(path), *options, '--sensor', 'all'])} -o calibration-{{sensor}}.json"


def calibrate_command(path: str, *options: str) -> str:
    """The command that calibrates a recording into a file with an unused name.

    >>> calibrate_command("-odd name.csv", "--unit", "mG")
    "flinders calibrate './-odd name.csv' --unit mG -o calibration.json"
    """
    return shlex.join([*_calibrate(path), *options, "-o", str(free_path(CALIBRATION))])


def _calibrate(path: str) -> list[str]:
    """The first words of the command, which also work for a path that looks like an option."""
    is_like_an_option = path.startswith("-") and path != "-"
    return ["flinders", "calibrate", f"./{path}" if is_like_an_option else path]


def _file_block(contents: Contents, *, grid: bool) -> RenderableType:
    size = "" if contents.bytes is None else f", {_size_words(contents.bytes)}"
    rows = []
    if contents.start:
        rows.append(("start", f"{contents.start} UTC"))
    if contents.position:
        latitude, longitude, altitude = contents.position
        rows.append(("place", f"{latitude:.5f}, {longitude:.5f}, {altitude:.0f} m"))
    if contents.site:
        site = contents.site
        side = "E" if site.declination_deg >= 0 else "W"
        declination = f"declination {abs(site.declination_deg):.1f}° {side}"
        words = f"{site.strength:.2f} µT, dip {site.inclination_deg:.1f}°, {declination} ({site.model})"
        rows.append(("field there", words))
        rows += [("grid there", grid_words(site))] * grid
    return _block(contents.source, f"{contents.format}{size}", rows, notes=contents.notes)


def _sensor_block(sensor: RecordedSensor, site: SiteField | None) -> RenderableType:
    unit = unit_label(sensor.unit_of_field)
    known = f"in {sensor.unit}" + (f", shown in {unit}" if sensor.unit not in {sensor.unit_of_field, COUNTS} else "")
    title = f"{sensor.number}  {sensor.name}"
    if not sensor.readings:
        return _block(title, known, [], doubts=sensor.notes)
    rows = [("readings", _readings(sensor))]
    if sensor.onboard_calibration:
        became = "logged raw, before it" if sensor.is_raw else "left on" if sensor.is_as_logged else "removed here"
        rows.append(("on board", f"{sensor.onboard_calibration}; {became}"))
    ends = zip("xyz", sensor.lowest, sensor.highest, strict=True)
    rows.append(("range", "   ".join(f"{axis} {figures(low, 3)} to {figures(high, 3)}" for axis, low, high in ends)))
    if sensor.coverage is not None:
        rows.append(("seen", f"roughly {sensor.coverage:.0%} of all directions"))
    if sensor.strength is not None:
        share = ""
        if site is not None and sensor.unit_of_field != COUNTS:
            share = f", {sensor.strength / site.strength:.2f} of the field there"
        rows.append(("strength", f"{figures(sensor.strength, 4)} {unit} by the ellipsoid through them{share}"))
    rows.append(("auxiliary", ", ".join(sensor.auxiliary) or "none"))
    if sensor.chip is not None:
        rows += _chip_rows(sensor.chip)
    return _block(title, known, rows, doubts=_doubts(sensor, site), notes=sensor.notes)


def _chip_rows(proposal: ChipProposal) -> list[tuple[str, str]]:
    """Rows that say which chip the sensor may be, why, and which options that gives."""
    names, more = proposal.chips[:MAX_CHIPS], len(proposal.chips) - MAX_CHIPS
    written = f"{'' if len(names) == 1 else 'one of '}{', '.join(names)}{f' and {more} more' if more > 0 else ''}"
    rows = [("chip", written), ("because", proposal.reason)]
    return [*rows, ("to give", proposal.advice)] if proposal.advice else rows


def _block(
    title: str, words: str, rows: Sequence[tuple[str, str]], *, doubts: Sequence[str] = (), notes: Sequence[str] = ()
) -> RenderableType:
    """A title in bold, facts in two columns, and remarks with their marks."""
    shown = [Padding(facts(rows, TITLE_WIDTH), (0, 0, 0, 3))] if rows else []
    said = marked([*(("limits", doubt) for doubt in doubts), *(("note", note) for note in notes)])
    return Group(Text.assemble((title, "bold"), f"  {words}"), *shown, Padding(said, (0, 0, 0, 1)))


def _readings(sensor: RecordedSensor) -> str:
    words = f"{sensor.readings:,}"
    if sensor.rate_hz is not None and sensor.seconds is not None:
        words += f" at {figures(sensor.rate_hz, 3)} Hz over {duration_words(sensor.seconds)}"
    return words if sensor.longest_gap_s is None else f"{words}; longest gap {duration_words(sensor.longest_gap_s)}"


def _doubts(sensor: RecordedSensor, site: SiteField | None) -> list[str]:
    """Remarks on the readings of a sensor; for one that was hardly turned, only those that need no turn."""
    doubts = list(filter(None, (sensor.too_few, sensor.unmoved))) or _of_values(sensor)
    if sensor.ignored_time:
        doubts.append(
            f"no time is read, {sensor.ignored_time} is left out: write it as numbers that rise, or as "
            "2026-11-22 14:03:07.25"
        )
    if sensor.backward_steps:
        doubts.append(f"the clock goes back {count_text(sensor.backward_steps, 'time')}")
    if sensor.strength is not None and sensor.unit_of_field != COUNTS:
        low, high = (
            WIDE_EARTH_FIELD_RANGE_UT
            if site is None
            else ((1 - MAX_STRENGTH_DEVIATION) * site.strength, (1 + MAX_STRENGTH_DEVIATION) * site.strength)
        )
        if not low <= sensor.strength <= high:
            doubts.append("the earth's field here has another strength: check unit, scale and iron nearby")
    return doubts


def _of_values(sensor: RecordedSensor) -> list[str]:
    """Remarks on the values of a sensor that was turned."""
    doubts = []
    if sensor.resembles:
        columns = shlex.quote(",".join(sensor.columns))
        doubts.append(looks_like(sensor.resembles, f"--columns {columns}"))
    if sensor.repeats > MAX_REPEATED_SHARE * sensor.readings:
        doubts.append(f"{sensor.repeats / sensor.readings:.0%} of the readings repeat the one before: logged too often")
    if sensor.rails:
        doubts.append(f"the sensor was at its limit: {', '.join(sensor.rails)}")
    stuck = [a for a, low, high in zip("xyz", sensor.lowest, sensor.highest, strict=True) if low == high]
    if stuck:
        doubts.append(f"{' and '.join(stuck)} never {'changes' if len(stuck) == 1 else 'change'}: check the wiring")
    return doubts


def _size_words(size: int) -> str:
    for unit, least in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= least:
            return f"{figures(size / least)} {unit}"
    return f"{size} bytes"
