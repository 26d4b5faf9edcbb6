"""Exporters: a calibration in, a file for another tool out, and back where that can be. The caller writes the file.

>>> from flinders.calibration import Calibration
>>> from flinders.units import Unit
>>> export = find("adis16480").render(Calibration.identity(field_strength=50.0, raw=Unit.of("uT")), target="adis16480")
>>> [register["code"] for register in export.fields["registers"]]
[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]

An exporter is a row of `EXPORTERS`: a new target adds a file here, one with its formulas to `conventions`, and a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.conventions import adafruit as sensorlab
from flinders.conventions import motioncal as packet
from flinders.conventions import ros as ros_parameters
from flinders.conventions import rtimulib as settings
from flinders.conventions import vectornav as register
from flinders.errors import DocumentError, UsageError
from flinders.exporters import (
    adafruit,
    adis16480,
    ardupilot,
    betaflight,
    code,
    esphome,
    fusion,
    inav,
    matlab,
    motioncal,
    paparazzi,
    plain,
    px4,
    ros,
    rtimulib,
    vectornav,
    zscilib,
)
from flinders.exporters._export import Asked, Deviation, Export, Render
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.calibration import Calibration

__all__ = ["EXPORTERS", "Asked", "Deviation", "Export", "Exporter", "Reader", "Render", "Sheet", "find", "read_back"]

HEAD: Final = 65536
"""Bytes of a file that are looked at to tell what it is."""


@dataclass(frozen=True, slots=True)
class Reader:
    """How a target's file is read back.

    Attributes
    ----------
    sniff : callable
        Whether the first bytes may be those of such a file.
    read : callable
        ``read(content, source, strength=…)`` gives the calibration; it takes ``compass`` where there is `which`.
    which : callable, optional
        ``which(content, source, compass)`` gives number and device id of the compass that is read, of several.
    """

    sniff: Callable[[bytes], bool]
    read: Callable[..., Calibration]
    which: Callable[[bytes, str, int | None], tuple[int, int | None]] | None = None


@dataclass(frozen=True, slots=True)
class Exporter:
    """One row of the table of targets.

    Attributes
    ----------
    name : str
        What `find` and ``--to`` look for.
    use : str
        What it writes, for people.
    suffix : str
        Ending of such a file.
    render : callable
        Writes it.
    sheet : Sheet
        Its formula, unit, axes, storage and source.
    reader : Reader, optional
        Where such a file can be read back.
    docs : str
        The page that tells about it.
    compasses : bool
        It keeps several compasses, and takes ``--compass``.
    """

    name: str
    use: str
    suffix: str
    render: Render
    sheet: Sheet
    reader: Reader | None = None
    docs: str = "targets.md"
    compasses: bool = False


ARDUPILOT: Final = Reader(ardupilot.sniff, ardupilot.read, ardupilot.which)
PX4: Final = Reader(px4.sniff, px4.read, px4.which)
PACKET: Final = Reader(packet.sniff, packet.read)

EXPORTERS: Final[Mapping[str, Exporter]] = {
    row.name: row
    for row in (
        Exporter(
            "ardupilot", "ArduPilot parameters", ".param", ardupilot.render, ardupilot.SHEET, ARDUPILOT, compasses=True
        ),
        Exporter("px4", "PX4, file of QGroundControl", ".params", px4.render, px4.SHEET, PX4, compasses=True),
        Exporter("px4-shell", "PX4, lines for its shell", ".txt", px4.render_shell, px4.SHEET, PX4, compasses=True),
        Exporter("motioncal", "MotionCal packet, PJRC EEPROM", ".bin", motioncal.render, motioncal.SHEET, PACKET),
        Exporter("adafruit-eeprom", "Adafruit EEPROM image", ".bin", motioncal.render, motioncal.SHEET, PACKET),
        Exporter(
            "sensorlab", "Adafruit SensorLab JSON", ".json", adafruit.render, adafruit.SHEET,
            Reader(sensorlab.sniff, sensorlab.read),
        ),
        Exporter("fusion", "x-io Fusion from 1.2.0, C", ".h", fusion.render, fusion.SHEET),
        Exporter("fusion-python", "x-io Fusion from 1.3.0, Python", ".py", fusion.render_python, fusion.PYTHON),
        Exporter("fusion-1.1", "x-io Fusion up to 1.1, C", ".h", fusion.render_old, fusion.OLD),
        Exporter(
            "rtimulib", "lines of RTIMULib.ini", ".ini", rtimulib.render, rtimulib.SHEET,
            Reader(settings.sniff, settings.read),
        ),
        Exporter("betaflight", "Betaflight CLI", ".txt", betaflight.render, betaflight.SHEET),
        Exporter("inav", "INAV CLI", ".txt", inav.render, inav.SHEET),
        Exporter("paparazzi", "Paparazzi airframe XML", ".xml", paparazzi.render, paparazzi.SHEET),
        Exporter(
            "vectornav", "VectorNav register 23", ".txt", vectornav.render, vectornav.SHEET,
            Reader(register.sniff, register.read),
        ),
        Exporter("adis16480", "ADIS16480 registers", ".txt", adis16480.render, adis16480.SHEET, docs="registers.md"),
        Exporter("adis16488", "ADIS16488 registers", ".txt", adis16480.render, adis16480.SHEET, docs="registers.md"),
        Exporter("ros-madgwick", "ROS 2 imu_filter_madgwick", ".yaml", ros.render_madgwick, ros.MADGWICK),
        Exporter(
            "ros-pipeline", "ROS magnetometer_pipeline", ".yaml", ros.render_pipeline, ros.PIPELINE,
            Reader(ros_parameters.sniff, ros_parameters.read),
        ),
        Exporter("esphome", "ESPHome template sensors", ".yaml", esphome.render, esphome.SHEET),
        Exporter("zscilib", "Zephyr zscilib constants", ".h", zscilib.render, zscilib.SHEET),
        Exporter("matlab", "MATLAB and Octave function", ".m", matlab.render, matlab.SHEET),
        Exporter("c", "C99 header, single precision", ".h", code.render_header, code.HEADER),
        Exporter("c-q15", "C99 header, 16-bit fixed point", ".h", code.render_q15, code.SHORT),
        Exporter("c-q31", "C99 header, 32-bit fixed point", ".h", code.render_q31, code.LONG),
        Exporter("arduino", "Arduino sketch", ".ino", code.render_sketch, code.SKETCH),
        Exporter("micropython", "MicroPython, CircuitPython", ".py", code.render_micropython, code.MODULE),
        Exporter(
            "json", "plain JSON", ".json", plain.render_json, plain.JSON, Reader(plain.sniff, plain.read)
        ),
        Exporter("yaml", "plain YAML", ".yaml", plain.render_yaml, plain.YAML),
    )
}  # fmt: skip
"""By name, in the order they are listed."""


def find(name: str) -> Exporter:
    """Look up a target.

    Raises
    ------
    UsageError
        For one that there is not; names those there are.
    """
    known = EXPORTERS.get(name.strip().casefold())
    if known is None:
        raise UsageError(f"target {name!r} is not known: use one of {', '.join(EXPORTERS)}")
    return known


def read_back(
    content: bytes, source: str, *, target: str | None = None, strength: float | None = None, compass: int | None = None
) -> tuple[str, Calibration]:
    """Read the calibration that a target's file stands for, in the unit and axes of the target.

    Parameters
    ----------
    content : bytes
    source : str
        For messages.
    target : str, optional
        Whose file it is; found by its content where it is not given.
    strength : float, optional, µT
        Length of corrected readings, where the target does not hold it.
    compass : int, optional
        Which of several.

    Returns
    -------
    name : str
        Of the target.
    calibration : Calibration

    Raises
    ------
    UsageError
        For a target whose files cannot be read back, or a compass where there is one only.
    DocumentError
        For a file that is none of theirs, or damaged.

    Examples
    --------
    >>> sentence = b"$VNWRG,23,1,0,0,0,1,0,0,0,1,0.1,-0.2,0.3*XX"
    >>> name, found = read_back(sentence, "line.txt", strength=48.0)
    >>> name, found.offset
    ('vectornav', array([ 10., -20.,  30.]))
    """
    readable = {name: row.reader for name, row in EXPORTERS.items() if row.reader is not None}
    if target is None:
        name = next((name for name, reader in readable.items() if reader.sniff(content[:HEAD])), None)
        if name is None:
            raise DocumentError(f"{source}: is no file of {', '.join(readable)}: name the target with --from, if it is")
    else:
        name = find(target).name
        if name not in readable:
            raise UsageError(f"files of {name} cannot be read back: those of {', '.join(readable)} can")
    reader = readable[name]
    if compass is not None and reader.which is None:
        raise UsageError(f"--compass goes with ardupilot and px4: {name} holds one compass only")
    more = {"compass": compass} if reader.which is not None else {}
    return name, reader.read(content, source, strength=strength, **more)
