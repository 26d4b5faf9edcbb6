"""The 68 bytes that MotionCal sends, and PJRC's and Adafruit's sketches store in EEPROM: ``c = W (0.1 counts − V)``.

V is the offset in µT. W is symmetric and has the determinant 1. B is the radius in µT. All numbers are float32, little
endian; those of accelerometer and gyroscope are 0, and a CRC is at the end.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> packet = MotionCalPacket.of(calibration).encode()
>>> packet[:2].hex(), len(packet), crc16(packet)                   # over all of it the CRC is 0
('7554', 68, 0)
>>> MotionCalPacket.decode(packet).affine.apply([10.0, -20.0, 80.0]).round(3)
array([ 0.,  0., 40.])

Source: PaulStoffregen/MotionCal, ``rawdata.c`` (send_calibration) and ``visualize.c``. The sketches of NXPMotionSense
and Adafruit_Sensor_Calibration store the same bytes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.errors import DocumentError
from flinders.targets._mounting import split_rotation
from flinders.targets._numbers import Affine, round_to_single
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

SIGNATURE: Final = bytes((117, 84))
LAYOUT: Final = struct.Struct("<2s16fH")
POLYNOMIAL: Final = 0xA001
BEFORE_OFFSET: Final = 6
"""Number of floats for accelerometer and gyroscope, which MotionCal leaves at 0."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionCalPacket:
    """Content of the packet that concerns the magnetometer."""

    offset: Floats  #: (3,), µT: V, subtracted
    strength: float  #: µT: B, the length of corrected readings
    matrix: Floats  #: (3, 3): W, symmetric

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Convert a calibration: the matrix is scaled to determinant 1, as MotionCal does; axes are those recorded.

        Raises
        ------
        UnitError
            For a calibration in counts.
        """
        affine = Affine.of(calibration, "uT", who="MotionCal")
        with np.errstate(all="ignore"):
            size = float(np.exp(np.linalg.slogdet(affine.matrix)[1] / 3))
            strength = float(round_to_single(affine.strength / size))
            return cls(round_to_single(affine.offset), strength, round_to_single(symmetric_root(affine.matrix) / size))

    @classmethod
    def decode(cls, content: bytes, source: str = "packet") -> Self:
        """Read the packet from its bytes.

        Raises
        ------
        DocumentError
            For a wrong length, signature or CRC, and for numbers that are not finite.
        """
        if len(content) != LAYOUT.size:
            raise DocumentError(f"{source}: {len(content)} bytes: a MotionCal packet has {LAYOUT.size}")
        signature, *values, sent = LAYOUT.unpack(content)
        if signature != SIGNATURE:
            raise DocumentError(f"{source}: starts with {content[:2].hex()}: a MotionCal packet starts with 7554")
        if crc16(content[:-2]) != sent:
            raise DocumentError(
                f"{source}: its CRC is {sent:04X} instead of {crc16(content[:-2]):04X}: it is damaged; copy it again"
            )
        if not np.isfinite(values).all():
            raise DocumentError(f"{source}: holds numbers that are not finite: calibrate again")
        own = np.array(values[BEFORE_OFFSET:])
        xx, yy, zz, xy, xz, yz = own[4:]
        return cls(own[:3], float(own[3]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields: the packet as sent, and its values."""
        sent = self.encode().hex()
        return {
            "packet": sent,  # the 68 bytes, hexadecimal
            "offset_uT": self.offset,  # (3,): subtracted from readings
            "field_uT": self.strength,  # length of corrected readings
            "matrix": self.matrix,
        }

    def encode(self) -> bytes:
        """The 68 bytes: signature, nine offsets, B, W₀₀ W₁₁ W₂₂ W₀₁ W₀₂ W₁₂, CRC."""
        entries = self.matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        values = [0.0] * BEFORE_OFFSET + [*self.offset, self.strength, *entries]
        body = LAYOUT.pack(SIGNATURE, *values, 0)[:-2]
        return body + crc16(body).to_bytes(2, "little")

    @property
    def affine(self) -> Affine:
        """``c = matrix (m − offset)``, in µT."""
        return Affine(self.matrix, self.offset, self.strength)


def symmetric_root(matrix: Floats) -> Floats:
    """(3, 3) symmetric S = (WᵀW)^½ of W = R S with a rotation R, for targets with six numbers.

    >>> turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    >>> symmetric_root(turn @ np.diag([2.0, 1.0, 0.5])).round(9)
    array([[2. , 0. , 0. ],
           [0. , 1. , 0. ],
           [0. , 0. , 0.5]])
    """
    return matrix if np.array_equal(matrix, matrix.T) else split_rotation(matrix)[0]


def crc16(content: bytes) -> int:
    """CRC-16/MODBUS: polynomial 0xA001 reflected, from 0xFFFF.

    >>> hex(crc16(b"123456789"))                                   # the check value of its catalogue entry
    '0x4b37'
    """
    crc = 0xFFFF
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (POLYNOMIAL if crc & 1 else 0)
    return crc


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the bytes, shown as hexadecimal text. A calibration in counts raises `UnitError`."""
    packet = MotionCalPacket.of(calibration)
    data = packet.encode()
    values = {"offset": packet.offset, "field": packet.strength, "matrix": packet.matrix, "hex": data.hex()}
    body = [data[start : start + 16].hex(" ") for start in range(0, len(data), 16)]
    return Written(packet.affine.apply, body, values, data=data)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read a packet; a `strength` in µT takes precedence over its B. Raises the errors of `MotionCalPacket.decode`."""
    return MotionCalPacket.decode(content, source).affine.to_calibration("uT", strength=strength)


MOTIONCAL: Final = Target(
    name="motioncal",
    use="MotionCal packet, PJRC EEPROM",
    group="libraries, tools",
    suffix=".bin",
    title="MotionCal packet",
    formula="c = W (m - V), det W = 1",
    unit="uT",
    keeps="symmetric",
    storage="68 bytes: 117 84, 16 float32 little endian, CRC-16/MODBUS",
    source="MotionCal rawdata.c and visualize.c, NXPMotionSense.h, Adafruit_Sensor_Calibration_EEPROM.cpp",
    lengths="B long, the mean radius of the ellipsoid: the matrix has determinant 1",
    comment=None,
    write=write,
    reader=TargetReader(rb"\A" + SIGNATURE, read, "a MotionCal packet"),
)
TARGETS: Final = (MOTIONCAL, replace(MOTIONCAL, name="adafruit-eeprom", use="Adafruit EEPROM image"))
