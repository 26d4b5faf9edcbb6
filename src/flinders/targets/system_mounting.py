"""Mounting of a sensor in the setting of a system: a device tree of Linux or Zephyr, Android, or code.

Each contains the rotation R from the sensor's axes to those of the body. The calibration is applied before it:

    v = M m                         ``mount-matrix`` of Linux IIO: M = R, row by row, as nine strings
    m = R v                         Android's AINFO_SENSOR_PLACEMENT: the transpose of R, with a place in millimetres
    v_i = sign_i m[index_i]         ``axis-align-*`` of Zephyr, and the function in C: right angles alone

>>> from flinders.targets import find
>>> from flinders.core.axes import Axes
>>> from flinders.core.calibration import Calibration
>>> mapped = Calibration([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [10.0, -20.0, 30.0], 50.0, axes=Axes.of("y,-x,z"))
>>> print(*find("iio-mount-matrix").render(mapped).text.splitlines()[-3:], sep=chr(10))
mount-matrix = "0", "1", "0",
               "-1", "0", "0",
               "0", "0", "1";
>>> str(read_matrix(b"0, 1, 0; -1, 0, 0; 0, 0, 1", "in_magn_mount_matrix").axes)
'y,-x,z'

Sources: Linux, ``Documentation/devicetree/bindings/iio/mount-matrix.txt`` (x' = mxx x + myx y + mzx z, of which the
first row is mxx, myx, mzx), ``Documentation/ABI/testing/sysfs-bus-iio``, ``industrialio-core.c``: the kernel passes the
strings on and multiplies nothing. Android, ``AdditionalInfoType`` of sensors HAL 1.0: "the inverse of the matrix
applied to raw samples". Zephyr, ``dts/bindings/sensor/sensor-axis-align.yaml`` and ``icm4268x``: the channel is
``sign * readings[index]``.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import DocumentError
from flinders.targets._code_text import float32s, name_prefix
from flinders.targets._comments import BLOCK
from flinders.targets._mounting import MAX_TURN_DEG, apart_deg
from flinders.targets._numbers import decode_text, numbers, round_to_single
from flinders.targets._placement import Placement, mounting_target, to_calibration
from flinders.targets._target import ExportOptions, TargetReader, Written

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.calibration import Calibration

PLACES: Final = 9
"""Number of decimals of an element of a matrix."""
NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
ROW: Final = rf"{NUMBER}\s*,\s*{NUMBER}\s*,\s*{NUMBER}"
SYSFS: Final = rf"{ROW}\s*;\s*{ROW}\s*;\s*{ROW}"
"""Format of the file in sysfs."""
MARK: Final = rf"mount-matrix\s*=|\A\s*{SYSFS}\s*\Z"
PROPERTY: Final = rf'mount-matrix\s*=\s*((?:"\s*{NUMBER}\s*"\s*,?\s*(?:/\*.*?\*/\s*)?){{9}});'
ANDROID_NOTES: Final = (
    (
        "readings of the HAL must already be in Android's axes: a placement is information only, and rotates nothing; "
        "if the HAL rotates readings itself, R is unity"
    ),
    "the last column is the position of the sensor in mm, from the middle of the screen: fill it in",
)
ZEPHYR_NOTE: Final = (
    "include <zephyr/dt-bindings/sensor/sensor_axis_align.h>; only for a driver whose binding includes "
    "sensor-axis-align.yaml: in Zephyr itself, accelerometers and gyros only (icm4268x, icm20689)"
)
AXIS: Final = "SENSOR_AXIS_ALIGN_DT_"
ALIGN_PATTERN: Final = re.compile(rf"axis-align-([xyz])(-sign)?\s*=\s*<\s*(?:{AXIS})?([XYZ]|POS|NEG|\d)\s*>")
DEFAULTS: Final = {"x": "0", "y": "1", "z": "2", "x-sign": "2", "y-sign": "2", "z-sign": "2"}
"""Values of properties that a device tree leaves out."""
VALUES: Final = {"X": 0, "Y": 1, "Z": 2, "NEG": 0, "POS": 2}


def write_mount_matrix(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the property of a device tree; for a mirrored sensor, a note quotes what the kernel requires."""
    placement = Placement.of(calibration, asked, who="mount-matrix")
    matrix = np.round(placement.rotation, PLACES)
    rows = [", ".join(f'"{plain(value)}"' for value in row) for row in matrix]
    shown = "; ".join(", ".join(map(plain, row)) for row in matrix)
    applied = f"mount_matrix, in_mount_matrix or in_magn_mount_matrix of sysfs then shows {shown}"
    notes = [f"{applied}; the kernel multiplies nothing, programs do", *_of_a_mirror(placement)]
    body = [f"mount-matrix = {rows[0]},", f"               {rows[1]},", f"               {rows[2]};"]
    return placement.write_rotation(matrix, body, {"mount_matrix": matrix}, notes=notes)


def _of_a_mirror(placement: Placement) -> Iterable[str]:
    """Yield notes on a matrix with the determinant −1."""
    if not placement.is_mirror:
        return
    axis = placement.nearest_axes.mirrored_axis
    yield (
        "its determinant is -1: mount-matrix.txt asks for a rotation matrix, sysfs-bus-iio for a unitary one, and the "
        f"kernel checks neither. Better change the sign of {axis} in the driver, and record again"
    )


def read_matrix(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the property of a device tree, or the file of sysfs.

    Raises `DocumentError` for other text, and for a matrix that is not a mounting.
    """
    text = decode_text(content, source)
    found = re.search(PROPERTY, text, re.DOTALL)
    shown = None if found else re.fullmatch(rf"\s*({SYSFS})\s*", text)
    if found is None and shown is None:
        raise DocumentError(f'{source}: need mount-matrix = "…", …; with nine numbers, or "a, b, c; d, e, f; g, h, i"')
    words = re.findall(rf'"\s*({NUMBER})\s*"', found[1]) if found else re.findall(NUMBER, shown[1] if shown else "")
    return _of_words(words, source, strength)


def write_android(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the content of AINFO_SENSOR_PLACEMENT in C++; `NotExportable` for a mirrored sensor."""
    placement = Placement.of(calibration, asked, who="AINFO_SENSOR_PLACEMENT")
    placement.refuse_mirror("AINFO_SENSOR_PLACEMENT")
    back = round_to_single(placement.rotation.T)
    rows = np.column_stack([back, np.zeros(3)])
    name = name_prefix("magnetometer", asked.name)
    body = [f"static const float {name}_placement[12] = {{", *(f"    {float32s(row, 'f')}," for row in rows), "};"]
    return placement.write_rotation(back.T, body, {"placement": rows}, notes=ANDROID_NOTES)


def read_android(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the twelve numbers; `DocumentError` for other text, and for a matrix that is not a mounting."""
    text = decode_text(content, source)
    found = re.search(r"_placement\[12\]\s*=\s*\{([^}]*)\}", text)
    words = re.findall(NUMBER, found[1]) if found else []
    if len(words) != 12:
        raise DocumentError(f"{source}: {len(words)} numbers of a placement: need 12, three rows of R and a position")
    return _of_words([word for place, word in enumerate(words) if place % 4 != 3], source, strength, is_transposed=True)


def write_zephyr(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the properties of Zephyr's sensor-axis-align, which can describe a mirrored sensor too."""
    placement = Placement.of(calibration, asked, who="axis-align")
    axes, is_partial = _by_right_angles(placement)
    body = []
    for name, index, sign in zip("xyz", axes.order, axes.signs, strict=True):
        body.append(f"axis-align-{name} = <{AXIS}{'XYZ'[index]}>;")
        body.append(f"axis-align-{name}-sign = <{AXIS}{'POS' if sign > 0 else 'NEG'}>;")
    return placement.write_rotation(axes.matrix, body, {"axes": str(axes)}, notes=[ZEPHYR_NOTE], is_partial=is_partial)


def read_zephyr(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the properties; a missing property has its default.

    Raises `DocumentError` unless the properties name each axis once.
    """
    text = decode_text(content, source)
    given = {name + sign: value for name, sign, value in ALIGN_PATTERN.findall(text)}
    if not given:
        raise DocumentError(f"{source}: need axis-align-x, -y and -z with their signs")
    whole = {name: VALUES[value] if value in VALUES else int(value) for name, value in (DEFAULTS | given).items()}
    rows = np.zeros((3, 3))
    for place, name in enumerate("xyz"):
        if whole[name] > 2:
            raise DocumentError(f"{source}: axis-align-{name} is {whole[name]}: need 0, 1 or 2")
        rows[place, whole[name]] = whole[f"{name}-sign"] - 1
    return to_calibration(rows, source, strength=strength)


def write_axes_code(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a C function that exchanges axes and signs, which can describe a mirrored sensor too."""
    placement = Placement.of(calibration, asked, who="a mapping of axes in C")
    axes, is_partial = _by_right_angles(placement)
    name = name_prefix("magnetometer", asked.name)
    reads = [f"{'-' if sign < 0 else ''}sensor[{index}]" for index, sign in zip(axes.order, axes.signs, strict=True)]
    body = [
        f"static inline void {name}_to_body(const float sensor[3], float body[3])",
        "{",
        f"    const float x = {reads[0]}, y = {reads[1]}, z = {reads[2]};",
        "    body[0] = x;",
        "    body[1] = y;",
        "    body[2] = z;",
        "}",
    ]
    notes = ["both may be the same array; C99, C++ and Arduino"]
    return placement.write_rotation(axes.matrix, body, {"axes": str(axes)}, notes=notes, is_partial=is_partial)


def _by_right_angles(placement: Placement) -> tuple[Axes, bool]:
    """Right-angled mounting that is written, and whether it is just the nearest one to the actual mounting."""
    if placement.axes is not None:
        return placement.axes, False
    nearest = placement.nearest_axes
    return nearest, apart_deg(placement.found, nearest.matrix) > MAX_TURN_DEG


def _of_words(words: list[str], source: str, strength: float | None, *, is_transposed: bool = False) -> Calibration:
    """Mounting with nine numbers, row by row."""
    names = [f"element {place}" for place in range(1, 10)]
    rows: Floats = numbers(dict(zip(names, words, strict=True)), names, source).reshape(3, 3)
    return to_calibration(rows.T if is_transposed else rows, source, strength=strength)


def plain(value: float) -> str:
    """Write a number with at most `PLACES` decimals, without trailing zeros.

    >>> plain(-1.0), plain(0.5), plain(-1e-12)
    ('-1', '0.5', '0')
    """
    text = f"{value:.{PLACES}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


TARGETS: Final = (
    mounting_target(
        name="iio-mount-matrix",
        use="Linux IIO, device tree",
        suffix=".dtsi",
        title="mount-matrix of Linux IIO",
        formula="v = M m",
        keeps="rotation",
        storage="strings of decimal numbers",
        source="mount-matrix.txt, sysfs-bus-iio, industrialio-core.c",
        comment=BLOCK,
        write=write_mount_matrix,
        reader=TargetReader(MARK.encode(), read_matrix, "a mount-matrix of Linux"),
    ),
    mounting_target(
        name="android-placement",
        use="Android sensor placement",
        suffix=".h",
        title="AINFO_SENSOR_PLACEMENT of Android",
        formula="m = R v, [R; t] row by row",
        keeps="rotation",
        storage="12 float32",
        source="android.hardware.sensors@1.0 types.hal, AdditionalInfoType",
        comment=BLOCK,
        named=True,
        write=write_android,
        reader=TargetReader(rb"_placement\[12\]", read_android, ""),
    ),
    mounting_target(
        name="zephyr-axis-align",
        use="Zephyr device tree",
        suffix=".dtsi",
        title="axis-align of Zephyr",
        formula="v_i = sign_i m[index_i]",
        keeps="axes",
        storage="three axes and three signs",
        source="Zephyr, sensor-axis-align.yaml, icm4268x.c",
        comment=BLOCK,
        write=write_zephyr,
        reader=TargetReader(rb"axis-align-[xyz]", read_zephyr, "axis-align of Zephyr"),
    ),
    mounting_target(
        name="c-axes",
        use="C function, axes swapped",
        suffix=".h",
        title="a mapping of axes in C",
        formula="v_i = sign_i m[index_i]",
        keeps="axes",
        storage="three axes and three signs",
        source="this program",
        comment=BLOCK,
        named=True,
        write=write_axes_code,
    ),
)
