"""Options that several commands share, as fields of a command's options and as groups of fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import click

from flinders.cli._output import say
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
    is_typed,
    member,
    positive,
    single_value,
)
from flinders.cli._spelling import take_from
from flinders.errors import UsageError
from flinders.links.serial_ports import ANY_PORT

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from flinders.core.geomag import FieldModel
    from flinders.heading.smoothing import Filter


def target(words: str = "Acceptable worst heading error.", default: float | None = 1.0) -> Field:
    """``--target``, with its help and default for a command."""
    return member(
        "--target", heading=METHOD, type=angle, default=default, show_default=default is not None, metavar="DEG",
        help=words,
    )  # fmt: skip


def dip(words: str = "Inclination of the field at the site.", default: float | None = None, **more: Any) -> Field:
    """``--dip``, with its help and default for a command."""
    return member(
        "--dip", heading=SITE, type=inclination, default=default, show_default=default is not None, metavar="DEG",
        help=words, **more,
    )  # fmt: skip


def field_strength(
    words: str = "Field strength at the site, in µT (in counts for a recording in counts).", **more: Any
) -> Field:
    """``--field-strength``, with its help for a command."""
    usual = {"heading": SITE, "type": positive, "metavar": "F", "keywords": ("site",)}
    return member("--field-strength", help=words, **{**usual, **more})


def as_json(heading: str = OUTPUT) -> Field:
    """``--json``."""
    return flag("--json", "Print the result as JSON on standard output.", heading=heading)


def lossy() -> Field:
    """``--lossy``."""
    return flag("--lossy", "Do it even if omitted parts cost more than 0.5° of heading.")


def field_model() -> Field:
    """``--field-model``."""
    return member(
        "--field-model", heading=SITE, type=click.Choice(["wmm", "wmmhr", "igrf"]), keywords=("model",),
        help="Model of the earth's field for --at: World Magnetic Model, its high-resolution form (2025 to 2030), or "
        "IGRF-14 (1900 to 2030) [default: wmm, before 2010 igrf].",
    )  # fmt: skip


def history(words: str) -> Field:
    """``--history``, with its help for a command."""
    return member("--history", metavar="PATH", help=words)


def grid(words: str) -> Field:
    """``--grid``, with its help for a command."""
    return flag("--grid", words, heading=SITE, keywords=("grid",))


def mounting() -> Field:
    """``--mounting``."""
    return member(
        "--mounting", metavar="MOUNTING",
        help="Mounting of the compass during the recording, as set in the autopilot: a number or name, or "
        "ROLL,PITCH,YAW in degrees; none if the axes of the compass are those of the vehicle [default: as in the log].",
    )  # fmt: skip


def force(words: str = "Overwrite the output file if it exists.") -> Field:
    """``--force``."""
    return flag("--force", words, heading=OUTPUT)


def output(what: str, words: str, **more: Any) -> Field:
    """``-o``, with its help; `what` names the content of the file in messages."""
    return member("-o", "--output", what=what, metavar="FILE", help=words, **more)


def sensor(
    words: str = "Which magnetometer of several, by number or name [default: the first].", metavar: str = "N|NAME"
) -> Field:
    """``--sensor``, with its help for a command."""
    return member("--sensor", heading=RECORDING, metavar=metavar, help=words)


def sensor_of_calibration() -> Field:
    """``--sensor`` for a command whose calibration names its sensor."""
    return sensor(
        "Which of several magnetometers, by number from 1 or by name [default: the calibration's, else the first]."
    )


def serial() -> Field:
    """``--serial``; its value without a port is `ANY_PORT`."""
    return member(
        "--serial", is_flag=False, flag_value=ANY_PORT, metavar="[PORT]",
        help="A serial port: /dev/ttyACM0, COM3; without a name, the port of the only board.",
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
    return member("--imu-topic", metavar="TOPIC", help="With --ros2: the topic with sensor_msgs/Imu of the same body.")


def fixed() -> Field:
    """``--fix``."""
    return member(
        "--fix", heading=AIDING, multiple=True, metavar="NAME=VALUE", keywords=("at",),
        help="Use the calibration at a fixed current (A), throttle (0 to 1) or temperature (°C).",
    )  # fmt: skip


def smoothing() -> Field:
    """``--filter``."""
    return member(
        "--filter", heading=METHOD, type=_filter, multiple=True, callback=single_value, metavar="NAME[:WIDTH]",
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
    """Heading error and dip by which the result is judged."""

    target_deg: float = target()
    dip_deg: float = dip(default=60.0)


class ColumnsOptions(Group, heading=RECORDING):
    """The magnetometer's columns in a line."""

    columns: str | None = member(
        "--columns", metavar="X,Y,Z", help="The magnetometer's columns: three names, or numbers counted from 1."
    )
    pattern: str | None = member(
        "--pattern", metavar="LINE", help="Format of a line that is not recognised: 'N {x} / {y} / {z}'."
    )


class LinesOptions(ColumnsOptions):
    """Options for reading lines, in commands that also read other sources."""

    def refuse_with(self, sources: Collection[str]) -> None:
        """Raise `UsageError` if these options are given with one of `sources` that sends no lines.

        ``--unit`` is allowed for a ROS 2 topic: its values may be in another unit than its message type states.
        """
        source = next((name for name in sources if name in ("--mavlink", "--ros2", "--simulate")), None)
        wrong = [name for name in self.typed_options() if (source, name) != ("--ros2", "--unit")]
        if source is not None and wrong:
            raise UsageError(f"{', '.join(wrong)} applies only to lines and recordings: the unit of {source} is known")


class UnitsOptions(Group, heading=RECORDING):
    """Unit of the readings."""

    unit: str | None = member("--unit", metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts.")
    scale: float | None = member("--scale", type=positive, metavar="UT", help="Microtesla in one count.")


class AxesOptions(Group, heading=RECORDING):
    """Axes in which the readings are used."""

    axes: str = member(
        "--axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Source of each output axis: x,-y,-z for a sensor that is upside down.",
    )  # fmt: skip


class PartOptions(Group, heading=RECORDING):
    """Part of a recording to read: topic, time span, and raw or corrected values."""

    topic: str | None = member("--topic", metavar="NAME", help="Topic of a bag, or member of a ZIP archive.")
    start: float | None = member("--from", type=float, metavar="S", help="Leave out readings before this time, in s.")
    end: float | None = member(
        "--to", type=float, metavar="S", help="Leave out readings after this time, in s from the beginning."
    )
    as_logged: bool = flag(
        "--as-logged", "Use the readings of a log as logged, including the vehicle's own correction."
    )


class PartOfColumns(PartOptions, ColumnsOptions):
    """Options for reading a recording in the unit and axes of a calibration."""


class ReadingOptions(PartOptions, AxesOptions, UnitsOptions, ColumnsOptions):
    """Options for reading a recording: the arguments of `flinders.open_recording`."""


def chip() -> Field:
    """``--chip``."""
    return member(
        "--chip", metavar="NAME", heading=RECORDING,
        help="Chip, or chip:setting, as flinders chips lists them: sets --scale, and --axes if known.",
    )  # fmt: skip


class ReadingByChip(ReadingOptions):
    """Options for reading a recording, whose count and axes may be those of a chip."""

    chip: str | None = chip()

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> Self:
        """Take the values of this group, with those of the chip."""
        return super().from_values(with_chip(values))

    def as_dict(self, *, if_typed: Sequence[str] = ()) -> dict[str, Any]:
        """The arguments of `flinders.open_recording`."""
        return {name: value for name, value in super().as_dict(if_typed=if_typed).items() if name != "chip"}


def with_chip(values: dict[str, Any]) -> dict[str, Any]:
    """Values of a command with the scale and axes of ``--chip``, and a notice of what was taken.

    Raises `UsageError` for a chip or setting that is not known, with ``--scale``, and if the chip sets nothing.
    """
    if values["chip"] is None:
        return values
    from flinders.core.chips import SAME_AXES, ChipReading
    from flinders.core.units import COUNTS, Unit

    is_in_counts = values["unit"] is None or Unit.of(values["unit"]).name == COUNTS
    reading = ChipReading.of(values["chip"], is_in_counts=is_in_counts)
    if values["scale"] is not None:
        raise UsageError("--chip and --scale both say how much a count is: give one of them")
    are_axes_typed = is_typed("axes")
    taken: dict[str, Any] = {"scale": reading.setting.lsb_ut} if is_in_counts else {}
    taken |= {} if are_axes_typed or reading.axes in ("", SAME_AXES) else {"axes": reading.axes}
    words = [reading.count_words] * is_in_counts + [reading.axes_words] * (not are_axes_typed)
    if not taken:
        raise UsageError("; ".join([f"--chip sets nothing: --unit is {values['unit']}", *words, "leave --chip out"]))
    named = reading.chip.name if reading.name == reading.chip.name else f"{reading.name}, {reading.chip}"
    say(f"chip {named}: {'; '.join(words)}")
    take_from("chip", taken)
    return {**values, **taken}


class Place(Group, heading=SITE):
    """Place and day, for the declination."""

    place: str | None = member(
        "--at", metavar="LAT,LON[,ALT]", keywords=("site",),
        help="Site: degrees, north and east positive, and metres; gives true headings by a field model.",
    )  # fmt: skip
    date: str | None = member(
        "--date", metavar="DAY",
        help=(
            "Day of the recording, such as 2026-11-21, or today [default: from the clock of the recording, if that "
            "counts from 1970]."
        ),
    )  # fmt: skip
    model: FieldModel | None = field_model()

    def check(self) -> None:
        """Refuse a day or a field model without a place."""
        if self.date is not None and self.place is None:
            raise UsageError("--date is for the field at a place: give --at LAT,LON too")
        if self.model is not None and self.place is None:
            raise UsageError("--field-model is for the field at a place: give --at LAT,LON too")


class Accelerometer(Group, heading=AIDING):
    """Columns of the accelerometer, for tilt compensation."""

    is_level: bool = flag("--level", "Use x and y only: the sensor is never tilted.", keywords=("level",))
    acceleration: str | None = member(
        "--acceleration", metavar="X,Y,Z",
        help="The accelerometer's columns: three names, or numbers counted from 1.",
    )  # fmt: skip
    acceleration_axes: str = member(
        "--acceleration-axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Source of each axis of the acceleration.",
    )  # fmt: skip
