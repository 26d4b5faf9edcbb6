"""Attitudes that advice is given in, as a table of C.

>>> [line for line in header().splitlines() if "POSES =" in line]
['enum { FLINDERS_POSES = 26 };']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.heading.guidance import POSES

if TYPE_CHECKING:
    from flinders.heading.guidance import Pose

MADE: Final = "Made by `flinders firmware` from the library's attitudes."


def header() -> str:
    """`flinders_poses.h`: how many attitudes there are."""
    return "\n".join(
        [
            f"/* {MADE} */",
            "#ifndef FLINDERS_POSES_H",
            "#define FLINDERS_POSES_H",
            "",
            f"enum {{ FLINDERS_POSES = {len(POSES['sensor'])} }};",
            "#endif",
            "",
        ]
    )


def source() -> str:
    """`poses.c`: the table itself."""
    return "\n".join(
        [
            f"/* {MADE} */",
            '#include "flinders_board.h"',
            "",
            "const flinders_pose flinders_poses[FLINDERS_POSES] = {",
            *map(_pose, POSES["sensor"]),
            "};",
            "",
        ]
    )


def _pose(pose: Pose) -> str:
    down = ", ".join(f"(flinders_real){value:.9g}" for value in pose.down.tolist())
    return f"    {{{{{down}}}, {_text(pose.words)}, {pose.effort}}},"


def _text(words: str) -> str:
    """A string in ASCII, which every serial monitor shows."""
    plain = words.replace("−", "-").replace("°", " degrees").replace("`", "").replace('"', "'")
    return f'"{plain.encode("ascii", "replace").decode()}"'
