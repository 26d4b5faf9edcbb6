"""Names of attitudes for advice, as a table in C.

>>> source().splitlines()[4]
'    "with its +x side down",'
"""

from __future__ import annotations

from typing import Final

from flinders.findings.c_tables import c_string
from flinders.findings.poses import POSE_WORDS

REMARK: Final = "Made by `flinders firmware` from the library's attitudes."


def source() -> str:
    """Return `poses.c`, the table."""
    return "\n".join(
        [
            f"/* {REMARK} */",
            '#include "flinders_board.h"',
            "",
            "const char *const flinders_poses[FLINDERS_SENSOR_POSES] = {",
            *(f"    {c_string(words)}," for words in POSE_WORDS["sensor"]),
            "};",
            "",
        ]
    )
