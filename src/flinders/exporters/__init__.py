"""Exporters: a calibration in, a file for another tool out, and back where that can be. The caller writes the file.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> export = find("adis16480").render(Calibration.identity(field_strength=50.0, raw=Unit.of("uT")))
>>> [register["code"] for register in export.fields["values"]["registers"]]
[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]

An exporter is a row of `EXPORTERS`: a new target adds a file here, one with its formulas to `conventions`, and a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.conventions import adafruit as sensorlab
from flinders.conventions import betaflight as mag_zero
from flinders.conventions import inav as radii
from flinders.conventions import motioncal as packet
from flinders.conventions import paparazzi as defines
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
from flinders.exporters._export import NOTHING_MORE, Asked, Deviation, Export, Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flinders.core.calibration import Calibration

__all__ = ["EXPORTERS", "Asked", "Deviation", "Export", "Exporter", "Reader", "Sheet", "Written", "find", "read_back"]

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
        ``read(content, source, strength=…)`` gives the calibration: of the bytes of a file, with its name for messages
        and the length of corrected readings, which goes before what the file says of it; in µT, in counts for files in
        counts. It takes ``compass`` where there is `which`.
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
    sheet : Sheet
        Its formula, unit, axes, storage and source.
    write : callable
        ``write(calibration, asked)`` gives the calibration in the numbers of the target.
    reader : Reader, optional
        Where such a file can be read back.
    docs : str
        The page that tells about it.
    compasses : bool
        It keeps several compasses, and takes ``--compass``.
    named : bool
        Names in it stand in a program beside those of others, and it takes ``--name``.
    """

    name: str
    use: str
    suffix: str
    sheet: Sheet
    write: Callable[[Calibration, Asked], Written]
    reader: Reader | None = None
    docs: str = "targets.md"
    compasses: bool = False
    named: bool = False

    def render(self, calibration: Calibration, *, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
        """Write a calibration for the target, and try the target's own formula on what is written.

        Parameters
        ----------
        calibration : Calibration
        about : sequence of str
            Lines that tell where it comes from.
        asked : Asked
            Which compass, and what else there is to choose.

        Raises
        ------
        UnitError
            Where counts would have to become a unit, or the other way round.
        NotExportable
            For what the target cannot hold, and for readings in other axes than those in which it acts.
        UsageError
            For a compass that there is not, or a name that cannot be written.
        """
        self.sheet.refuse_foreign(calibration)
        written = self.write(calibration, asked)
        return self.sheet.export(calibration, written, target=self.name, about=about, asked=asked)


ARDUPILOT: Final = Reader(ardupilot.sniff, ardupilot.read, ardupilot.which)
PX4: Final = Reader(px4.sniff, px4.read, px4.which)
PACKET: Final = Reader(packet.sniff, packet.read)

EXPORTERS: Final[Mapping[str, Exporter]] = {
    row.name: row
    for row in (
        Exporter(
            "ardupilot", "ArduPilot parameters", ".param", ardupilot.SHEET, ardupilot.write, ARDUPILOT, compasses=True
        ),
        Exporter("px4", "PX4, file of QGroundControl", ".params", px4.SHEET, px4.write, PX4, compasses=True),
        Exporter("px4-shell", "PX4, lines for its shell", ".txt", px4.SHEET, px4.write_shell, PX4, compasses=True),
        Exporter("motioncal", "MotionCal packet, PJRC EEPROM", ".bin", motioncal.SHEET, motioncal.write, PACKET),
        Exporter("adafruit-eeprom", "Adafruit EEPROM image", ".bin", motioncal.SHEET, motioncal.write, PACKET),
        Exporter(
            "sensorlab", "Adafruit SensorLab JSON", ".json", adafruit.SHEET, adafruit.write,
            Reader(sensorlab.sniff, sensorlab.read),
        ),
        Exporter("fusion", "x-io Fusion from 1.2.0, C", ".h", fusion.SHEET, fusion.write),
        Exporter("fusion-python", "x-io Fusion from 1.3.0, Python", ".py", fusion.PYTHON, fusion.write_python),
        Exporter("fusion-1.1", "x-io Fusion up to 1.1, C", ".h", fusion.OLD, fusion.write_old),
        Exporter(
            "rtimulib", "lines of RTIMULib.ini", ".ini", rtimulib.SHEET, rtimulib.write,
            Reader(settings.sniff, settings.read),
        ),
        Exporter(
            "betaflight", "Betaflight CLI", ".txt", betaflight.SHEET, betaflight.write,
            Reader(mag_zero.sniff, mag_zero.read),
        ),
        Exporter(
            "inav", "INAV CLI", ".txt", inav.SHEET, inav.write,
            Reader(radii.sniff, radii.read),
        ),
        Exporter(
            "paparazzi", "Paparazzi airframe XML", ".xml", paparazzi.SHEET, paparazzi.write,
            Reader(defines.sniff, defines.read),
        ),
        Exporter(
            "vectornav", "VectorNav register 23", ".txt", vectornav.SHEET, vectornav.write,
            Reader(register.sniff, register.read),
        ),
        Exporter("adis16480", "ADIS16480 registers", ".txt", adis16480.SHEET, adis16480.write, docs="registers.md"),
        Exporter("adis16488", "ADIS16488 registers", ".txt", adis16480.LATER, adis16480.write, docs="registers.md"),
        Exporter("ros-madgwick", "ROS 2 imu_filter_madgwick", ".yaml", ros.MADGWICK, ros.write_madgwick),
        Exporter(
            "ros-pipeline", "ROS magnetometer_pipeline", ".yaml", ros.PIPELINE, ros.write_pipeline,
            Reader(ros_parameters.sniff, ros_parameters.read),
        ),
        Exporter("esphome", "ESPHome template sensors", ".yaml", esphome.SHEET, esphome.write),
        Exporter("zscilib", "Zephyr zscilib constants", ".h", zscilib.SHEET, zscilib.write),
        Exporter("matlab", "MATLAB and Octave function", ".m", matlab.SHEET, matlab.write, named=True),
        Exporter("c", "C99 header, single precision", ".h", code.HEADER, code.write_header, named=True),
        Exporter("c-q15", "C99 header, 16-bit fixed point", ".h", code.SHORT, code.write_q15, named=True),
        Exporter("c-q31", "C99 header, 32-bit fixed point", ".h", code.LONG, code.write_q31, named=True),
        Exporter("arduino", "Arduino sketch", ".ino", code.SKETCH, code.write_sketch, named=True),
        Exporter("micropython", "MicroPython, CircuitPython", ".py", code.MODULE, code.write_micropython),
        Exporter(
            "json", "plain JSON", ".json", plain.JSON, plain.write_json, Reader(plain.sniff, plain.read)
        ),
        Exporter("yaml", "plain YAML", ".yaml", plain.YAML, plain.write_yaml),
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
        Length of corrected readings, where the target does not hold it; in counts for files in counts.
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
