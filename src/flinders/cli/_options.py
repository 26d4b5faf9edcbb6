"""Options that several commands share: fields for the dataclass of a command, and groups of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flinders.cli._program import (
    AIDING,
    METHOD,
    OUTPUT,
    RECORDING,
    SITE,
    Field,
    Group,
    angle,
    flag,
    inclination,
    member,
    only_one,
    positive,
)
from flinders.errors import UsageError
from flinders.links.serial_ports import ANY_PORT

if TYPE_CHECKING:
    from collections.abc import Collection

    from flinders.core.geomag import FieldModel
    from flinders.heading.smoothing import Filter


def target(words: str = "Worst heading error that is good enough.", default: float | None = 1.0) -> Field:
    """``--target``, with what it means and its default for a command."""
    return member(
        "--target", heading=METHOD, type=angle, default=default, show_default=default is not None, metavar="DEG",
        help=words,
    )  # fmt: skip


def dip(words: str = "Inclination of the field at the site.", default: float | None = None, **more: Any) -> Field:
    """``--dip``, with what it means and its default for a command."""
    return member(
        "--dip", heading=SITE, type=inclination, default=default, show_default=default is not None, metavar="DEG",
        help=words, **more,
    )  # fmt: skip


def field_strength(
    words: str = "Strength of the field at the site, in µT (in counts for a recording in counts).", **more: Any
) -> Field:
    """``--field-strength``, with what it means for a command."""
    usual = {"heading": SITE, "type": positive, "metavar": "F", "keywords": ("site",)}
    return member("--field-strength", help=words, **{**usual, **more})


def as_json(heading: str = OUTPUT) -> Field:
    """``--json``."""
    return flag("--json", "Print the result as JSON on standard output.", heading=heading)


def lossy() -> Field:
    """``--lossy``."""
    return flag("--lossy", "Do it also where what is left out costs more than 0.5° of heading.")


def field_model() -> Field:
    """``--field-model``."""
    return member(
        "--field-model", heading=SITE, type=click.Choice(["wmm", "wmmhr", "igrf"]), keywords=("model",),
        help="Model of the earth's field at --at: World Magnetic Model, its high resolution (2025 to 2030), IGRF-14 "
        "(1900 to 2030) [default: wmm, before 2010 igrf].",
    )  # fmt: skip


def history(words: str) -> Field:
    """``--history``, with what it is for."""
    return member("--history", metavar="PATH", help=words)


def grid(words: str) -> Field:
    """``--grid``, with what it adds to a command."""
    return flag("--grid", words, heading=SITE, keywords=("grid",))


def mounting() -> Field:
    """``--mounting``."""
    return member(
        "--mounting", metavar="MOUNTING",
        help="How the compass was mounted when it was recorded, as the autopilot has it: a number or name, or "
        "ROLL,PITCH,YAW in degrees; none where it sits as the vehicle does [default: as its log says].",
    )  # fmt: skip


def force(words: str = "Overwrite the output file if it exists.") -> Field:
    """``--force``."""
    return flag("--force", words, heading=OUTPUT)


def output(what: str, words: str, **more: Any) -> Field:
    """``-o``, with what is written."""
    return member("-o", "--output", what=what, metavar="FILE", help=words, **more)


def sensor(
    words: str = "Which magnetometer of several, by number or name [default: the first].", metavar: str = "N|NAME"
) -> Field:
    """``--sensor``, with what it means for a command."""
    return member("--sensor", heading=RECORDING, metavar=metavar, help=words)


def sensor_of_calibration() -> Field:
    """``--sensor`` where a calibration says which one it is for."""
    return sensor(
        "Which of several magnetometers, by number from 1 or by name [default: the calibration's, else the first]."
    )


def serial() -> Field:
    """``--serial``; without a port it is `ANY_PORT`."""
    return member(
        "--serial", is_flag=False, flag_value=ANY_PORT, metavar="[PORT]",
        help="A serial port: /dev/ttyACM0, COM3; without a name that of the board which is plugged in.",
    )  # fmt: skip


def baud() -> Field:
    """``--baud``."""
    return member(
        "--baud", type=click.IntRange(50, 20_000_000), default=115200, show_default=True, metavar="N",
        help="Bits per second of a serial port.",
    )  # fmt: skip


def udp() -> Field:
    """``--udp``."""
    return member("--udp", type=click.IntRange(1, 65535), metavar="PORT", help="Listen for datagrams on this port.")


def tcp() -> Field:
    """``--tcp``."""
    return member("--tcp", metavar="HOST:PORT", help="Connect to a program that sends lines.")


def ros2() -> Field:
    """``--ros2``."""
    return member("--ros2", metavar="TOPIC", help="A topic of ROS 2 with sensor_msgs/MagneticField: /imu/mag.")


def imu_topic() -> Field:
    """``--imu-topic``."""
    return member("--imu-topic", metavar="TOPIC", help="With --ros2: the sensor_msgs/Imu beside it.")


def fixed() -> Field:
    """``--fix``."""
    return member(
        "--fix", heading=AIDING, multiple=True, metavar="NAME=VALUE", keywords=("at",),
        help="Take the calibration at a fixed current (A), throttle (0 to 1) or temperature (°C).",
    )  # fmt: skip


def smoothing() -> Field:
    """``--filter``."""
    return member(
        "--filter", heading=METHOD, type=_filter, multiple=True, callback=only_one, metavar="NAME[:WIDTH]",
        help="Filter the readings: moving-average, median or kalman, over WIDTH readings [default: 5].",
    )  # fmt: skip


def _filter(value: str) -> Filter:
    """Read the value of ``--filter``."""
    from flinders.heading.smoothing import Filter

    try:
        return Filter.of(value)
    except UsageError as error:
        raise click.BadParameter(error.message) from None


class Judgement(Group):
    """What the result is compared with."""

    target_deg: float = target()
    dip_deg: float = dip(default=60.0)


class ColumnsOptions(Group, heading=RECORDING):
    """Which numbers of a line are the magnetometer's."""

    columns: str | None = member(
        "--columns", metavar="X,Y,Z", help="The magnetometer's columns: three names, or numbers counted from 1."
    )
    pattern: str | None = member(
        "--pattern", metavar="LINE", help="How a line is printed, where it is not recognised: 'N {x} / {y} / {z}'."
    )


class LinesOptions(ColumnsOptions):
    """How lines are read, of commands that read other sources too."""

    def refuse_with(self, sources: Collection[str]) -> None:
        """Raise `UsageError` where it is said of `sources`, by their options, that send no lines.

        The unit of a topic may be another than that of its type.
        """
        source = next((name for name in sources if name in ("--mavlink", "--ros2", "--simulate")), None)
        wrong = [name for name in self.typed() if (source, name) != ("--ros2", "--unit")]
        if source is not None and wrong:
            raise UsageError(f"{', '.join(wrong)} goes with lines and recordings: {source} knows its unit")


class UnitsOptions(Group, heading=RECORDING):
    """In which unit the readings are."""

    unit: str | None = member("--unit", metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts.")
    scale: float | None = member("--scale", type=positive, metavar="UT", help="Microtesla in one count.")


class AxesOptions(Group, heading=RECORDING):
    """In which axes the readings are used."""

    axes: str = member(
        "--axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis used comes from: x,-y,-z turns the sensor over.",
    )  # fmt: skip


class PartOptions(Group, heading=RECORDING):
    """Which part of a recording is read, and of a log with several instruments."""

    topic: str | None = member("--topic", metavar="NAME", help="Topic of a bag, or member of a ZIP archive.")
    start: float | None = member("--from", type=float, metavar="S", help="Leave out what comes before, in seconds.")
    end: float | None = member(
        "--to", type=float, metavar="S", help="Leave out what comes later, in seconds from the beginning."
    )
    as_logged: bool = flag(
        "--as-logged", "Take the readings of a log as they are: leave on what the vehicle had corrected."
    )


class PartOfColumns(PartOptions, ColumnsOptions):
    """How a recording is read whose unit and axes a calibration knows."""


class ReadingOptions(PartOptions, AxesOptions, UnitsOptions, ColumnsOptions):
    """How a recording is read: the arguments of `flinders.open_recording`."""


class Place(Group, heading=SITE):
    """Where and when, for the declination."""

    place: str | None = member(
        "--at", metavar="LAT,LON[,ALT]", keywords=("site",),
        help="Site: degrees, north and east positive, and metres; gives true headings by a model of the field.",
    )  # fmt: skip
    date: str | None = member(
        "--date", metavar="DAY",
        help="Day of the recording, such as 2026-11-21, or today [default: by its clock, if from 1970].",
    )  # fmt: skip
    model: FieldModel | None = field_model()

    def check(self) -> None:
        """Refuse a day or a model without a place."""
        if self.date is not None and self.place is None:
            raise UsageError("--date is for the field at a place: give --at LAT,LON too")
        if self.model is not None and self.place is None:
            raise UsageError("--field-model is for the field at a place: give --at LAT,LON too")


class Accelerometer(Group, heading=AIDING):
    """Whether tilt is removed, and by which columns."""

    is_level: bool = flag("--level", "Use x and y alone: the sensor is never tilted.", keywords=("level",))
    acceleration: str | None = member(
        "--acceleration", metavar="X,Y,Z",
        help="The accelerometer's columns: three names, or numbers counted from 1.",
    )  # fmt: skip
    acceleration_axes: str = member(
        "--acceleration-axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis of the acceleration comes from.",
    )  # fmt: skip
