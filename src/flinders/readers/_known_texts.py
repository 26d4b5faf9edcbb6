r"""Text formats that are known to contain no magnetometer readings, with advice for each.

>>> str(refusal("bus.log", ["(1600000000.123456) can0 123#DEADBEEF"]))[:59]
'bus.log is a candump of a CAN bus, whose bytes need the des'
>>> refusal("tumble.csv", ["mx,my,mz", "1,2,3"]) is None
True
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.plugins import app_modules
from flinders.errors import NoMagnetometer

if TYPE_CHECKING:
    from collections.abc import Sequence

EXAMINED_LINES: Final = 400  # number of first lines that are examined


class KnownText(NamedTuple):
    """A kind of text without magnetometer readings."""

    sign: re.Pattern[str]  # pattern in one of its lines
    share: float  # smallest share of lines with the pattern; 0 if one line is enough
    words: str  # name of the kind, and advice to the user
    may_be_read: bool = False  # whether readings may occur in the same text; it is then refused only if none was found


TEXTS: Final = (
    KnownText(
        re.compile(r"^ ?Format\s+IAGA-2002"),
        0.0,
        "is an observatory file (IAGA-2002): the earth's field at one place, with D as an angle in minutes of arc. A "
        "calibration needs readings of a sensor that was turned",
    ),
    KnownText(
        re.compile(
            r"^\s*(?:\(\d[\d.]*\)\s+)?[a-z]+\d+\s+(?:[RT]X\s+\S+\s+\S+\s+)?[0-9A-Fa-f]{3,8}"
            r"(?:##?[0-9A-Fa-f.R]*|\s+\[\d\d?\](?:\s+[0-9A-Fa-f]{2})*)(?:\s+\S*)?\s*$"
        ),
        0.6,
        "is a candump of a CAN bus, whose bytes need the description of the bus; decode it, for example with "
        "cantools decode FILE.dbc, and give the magnetometer's x, y and z as columns",
    ),
    KnownText(
        re.compile(r"^\s*(?:INSERT INTO|CREATE TABLE|COPY\s[^;]*\sFROM\s+stdin)\b", re.IGNORECASE),
        0.0,
        "is a dump of a database: export the table as CSV with a header, such as with sqlite3 -header -csv FILE "
        "'SELECT * FROM mag', psql --csv or mysql --batch",
    ),
)


@cache
def _texts() -> tuple[KnownText, ...]:
    """All known kinds. Those of packages in `flinders.apps` come first, as they are more specific."""
    added = map(import_module, app_modules("KNOWN_TEXTS").values())
    return (*chain.from_iterable(module.TEXTS for module in added), *TEXTS)


def refusal(name: str, lines: Sequence[str], *, is_unread: bool = False) -> NoMagnetometer | None:
    """Error that names the kind of a text without readings; None for an unknown kind.

    With `is_unread`, kinds that may contain readings are refused too.
    """
    some = [line for line in lines[:EXAMINED_LINES] if line.strip()]
    for text in _texts():
        count = sum(text.sign.search(line) is not None for line in some)
        if count and count >= text.share * len(some) and (is_unread or not text.may_be_read):
            return NoMagnetometer(f"{name} {text.words}")
    return None
