"""Headers of a blackbox log of Betaflight or INAV: the calibration of the board that its readings are after.

Sources: ``compassUpdate`` in ``sensors/compass.c`` and ``blackbox.c`` of both.

>>> calibration_in_force(['"Firmware revision","INAV 7.0.0"', '"magzero","12,13,14"', '"maggain","1024,1024,1024"'])
'magzero 12,13,14'
>>> calibration_in_force(["mag_calibration,0,0,0", "magHardware,1"])
''
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

_CALIBRATION: Final = re.compile(
    r'^\W*(mag_?(?:calibration|zero|gain)(?:_[xyz]|\[[012]\])?)"?\s*[,;:=\t]\s*"?'
    r'([-+\d]+(?:[,;\s]+[-+\d]+)*)"?\s*$',
    re.IGNORECASE,
)
"""A line of the headers with a calibration; no known firmware writes one, tools may."""
_NO_GAIN: Final = 1024  # INAV's ``maggain`` that changes nothing


def calibration_in_force(above: Sequence[str]) -> str:
    """Find the calibration of the board in the lines above the readings; nothing where it changes nothing."""
    for text in above:
        found = _CALIBRATION.match(text)
        numbers = re.findall(r"[-+]?\d+", found[2]) if found else []
        neutral = _NO_GAIN if found and "gain" in found[1].casefold() else 0
        if found and any(int(each) != neutral for each in numbers):
            return f"{found[1]} {','.join(numbers)}"
    return ""
