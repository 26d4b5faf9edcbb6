"""Messages of the library in words of the command line: its keywords become options.

>>> in_options("give unit='mG', or scale= for counts; or write it with force=True")
'give --unit mG, or --scale for counts; or write it with --force'
>>> in_options("map them with axes='-x,y,z'"), in_options("give --acceleration-axes=-x,y,z")
('map them with --axes=-x,y,z', 'give --acceleration-axes=-x,y,z')
>>> in_options("no reading in fleet/unit=A17/log.parquet")                            # a name of a folder
'no reading in fleet/unit=A17/log.parquet'
>>> in_options("take it at one value with calibration.at(current=0, temperature=20)")
'take it at one value with --fix current=0 --fix temperature=20'
"""

from __future__ import annotations

import ast
import re
import shlex
from typing import Final

SAME: Final = (
    "acceleration", "acceleration_axes", "add", "as_logged", "axes", "batch_column", "columns", "compass",
    "field_strength", "force", "level", "lossy", "mounting", "name", "pattern", "pointing", "previous", "resume",
    "scale", "scheduler", "sensor", "topic", "unit", "unit_column",
)  # fmt: skip
"""Keywords of Python that are options with the same name."""

OPTIONS: Final = {
    **{name: f"--{name.replace('_', '-')}" for name in SAME},
    "end": "--to",
    "start": "--from",
    "strength": "--field-strength",
    "target": "--from",
}
"""Options by the keywords of Python that the library's messages name."""

QUOTED: Final = r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*\""""
KEYWORD: Final = re.compile(rf"(?<![-\w])({'|'.join(OPTIONS)})=({QUOTED}|True|(?<=scale=)[\d.]*\d)?(?=[\s,;:.)]|$)")
"""A keyword with a value behind it, or none."""

FIXED: Final = re.compile(r"calibration\.at\((.*?)\)")
"""Values of disturbances."""


def in_options(message: str) -> str:
    """Write the keywords of a message as options."""
    message = FIXED.sub(lambda match: " ".join(f"--fix {value}" for value in match[1].split(", ")), message)
    return KEYWORD.sub(_option, message)


def _option(match: re.Match[str]) -> str:
    """Write one keyword as an option, with its value where it takes one."""
    option, value = OPTIONS[match[1]], match[2]
    if value in (None, "True"):
        return option
    written = shlex.quote(str(ast.literal_eval(value)))
    return f"{option}{'=' if option.endswith('axes') else ' '}{written}"  # which may begin with a minus
