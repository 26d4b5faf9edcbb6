"""Paparazzi's ``MAG_X_NEUTRAL`` and ``MAG_X_SENS``: ``m = (raw − neutral) sens``, in the axes of the sensor.

Corrected readings have length 2048, 1 in fixed point with eleven bits. With D the diagonal nearest to the matrix and F
the length of corrected readings in counts, sens = 2048 D / F.

>>> from flinders.core.calibration import Calibration
>>> written = write(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0), ExportOptions())
>>> written.values["MAG_Y_NEUTRAL"], written.values["MAG_Y_SENS"]
(-32, 5.12)
>>> written.apply([440.0, -32.0, 7.0])
array([2048.,    0.,    0.])
>>> read(chr(10).join(written.body).encode(), "airframe.xml").matrix.diagonal()
array([1.25, 1.  , 0.8 ])

Source: Paparazzi, ``sw/tools/calibration/calibration_utils.py`` (print_xml) and ``calibrate.py`` (the eleven bits). Its
build turns each sens into a fraction of 16-bit numbers, which is not imitated here.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.vehicles.targets import inertial
from flinders.arrays import to_floats
from flinders.core.units import COUNTS
from flinders.errors import DocumentError, NotExportable
from flinders.targets._comments import MARKUP
from flinders.targets._numbers import (
    decode_text,
    numbers,
    of_radii,
    offset_and_radii,
    parse_counts,
    parse_pairs,
    round_to_integers,
)
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

UNIT_LENGTH: Final = 2**11
NEUTRALS: Final = ("MAG_X_NEUTRAL", "MAG_Y_NEUTRAL", "MAG_Z_NEUTRAL")
SENSITIVITIES: Final = ("MAG_X_SENS", "MAG_Y_SENS", "MAG_Z_SENS")
NAMES: Final = (*NEUTRALS, *SENSITIVITIES)
SIGNS: Final = ("MAG_X_SIGN", "MAG_Y_SIGN", "MAG_Z_SIGN")
LOWEST, HIGHEST = -(2**31), 2**31 - 1
DEFINE: Final = re.compile(r"<define\b([^<>]*)>")
ATTRIBUTE: Final = re.compile(r"""\b(name|value)\s*=\s*("[^"]*"|'[^']*')""")


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the defines for the section IMU; a recording that was not in raw counts raises `UnitError`.

    Raises `NotExportable` if the settings lose more than 0.5° of heading, the offset exceeds 32 bits, or an axis would
    change its sign.
    """
    offset, radii = offset_and_radii(calibration, who="Paparazzi")
    if not np.all(radii > 0):
        raise NotExportable(
            "a sensitivity would be 0 or less, which changes the sign of its axis: map the axes when you calibrate",
            hint={"axes": None},
            beyond=SENSITIVITIES,
        )
    rounded = round_to_integers(
        offset, NEUTRALS, lowest=LOWEST, highest=HIGHEST, advice="check the unit of the recording"
    )
    neutral = dict(zip(NEUTRALS, rounded, strict=True))
    sensitivity = {
        name: float(f"{UNIT_LENGTH / radius:.9g}") for name, radius in zip(SENSITIVITIES, radii, strict=True)
    }
    gains = to_floats(list(sensitivity.values()))
    body = [
        *(f'<define name="{name}" value="{value}"/>' for name, value in neutral.items()),
        *(f'<define name="{name}" value="{value:.9g}" integer="16"/>' for name, value in sensitivity.items()),
    ]
    return Written(lambda raw: (raw - to_floats(rounded)) * gains, body, {**neutral, **sensitivity})


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the defines back, with or without the prefix ``IMU_``; those in comments are ignored.

    `strength` is the length of corrected readings in counts, by default the geometric mean of the radii, 2048 / sens.

    Raises `DocumentError` if a define is missing, has two values or is not a number of its kind, and if an axis is
    inverted.
    """
    defines = _defines(decode_text(content, source), source)
    turned = [name for name in SIGNS if defines.get(name, "1").strip() not in {"1", "+1"}]
    if turned:
        raise DocumentError(
            f"{source}: {turned[0]} is {defines[turned[0]]}: the order of the sign and the numbers is "
            "unknown; use the axes of IMU_MAG_RAW, and define no sign but 1"
        )
    neutral = parse_counts(defines, NEUTRALS, source, between=(LOWEST, HIGHEST))
    sensitivity = numbers(defines, SENSITIVITIES, source)
    if not np.all(sensitivity > 0):
        raise DocumentError(f"{source}: {', '.join(SENSITIVITIES)} must be above 0: an axis is lost or inverted")
    return of_radii(neutral, UNIT_LENGTH / sensitivity, strength)


def _defines(text: str, source: str) -> dict[str, str]:
    """The defines of the magnetometer, by name without prefix."""
    first, *rest = text.split("<!--")
    bare = "".join([first, *(part.partition("-->")[2] for part in rest)])
    lines = []
    for define in DEFINE.finditer(bare):
        fields = {name: value[1:-1] for name, value in ATTRIBUTE.findall(define[1])}
        name = fields.get("name", "").removeprefix("IMU_")
        if name in {*NAMES, *SIGNS}:
            lines.append(f"{name}={' '.join(fields.get('value', '').split())}")
    return parse_pairs("\n".join(lines), source)


TARGETS: Final = (
    Target(
        name="paparazzi",
        use="Paparazzi airframe XML",
        group="autopilots",
        suffix=".xml",
        title="Paparazzi",
        formula="m = (raw - NEUTRAL) SENS",
        unit=COUNTS,
        keeps="diagonal",
        storage="NEUTRAL in whole counts; SENS becomes a fraction of 16-bit numbers",
        source="sw/tools/calibration/calibration_utils.py and calibrate.py",
        lengths="2048 long",
        unverified=("that it acts in the axes of the IMU_MAG_RAW messages, before the mounting",),
        comment=MARKUP,
        inertial=inertial.PAPARAZZI,
        write=write,
        reader=TargetReader(rb"(?s)\A(?=.*<define).*MAG_[XYZ]_(?:NEUTRAL|SENS)", read, "an airframe of Paparazzi"),
    ),
)
