r"""Known formats without readings of a magnetometer, and what to do with each.

>>> str(refusal("bus.log", ["(1600000000.123456) can0 123#DEADBEEF"]))[:71]
'bus.log is a candump of a CAN bus: what its bytes mean only a descripti'
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

LOOKED_AT: Final = 400  # Lines that are looked at


class KnownText(NamedTuple):
    """A kind of text."""

    sign: re.Pattern[str]  # what a line of it holds
    share: float  # of the lines that have to hold it; 0 where one is enough
    words: str  # what it is, and what to do
    may_be_read: bool = False  # readings may stand beside it: it is refused where none was found


TEXTS: Final = (
    KnownText(
        re.compile(r"^ ?Format\s+IAGA-2002"),
        0.0,
        "is a file of an observatory (IAGA-2002), the earth's field at a place, of which D is an angle in minutes of "
        "arc: a sensor is calibrated from readings while it was turned",
    ),
    KnownText(
        re.compile(
            r"^\s*(?:\(\d[\d.]*\)\s+)?[a-z]+\d+\s+(?:[RT]X\s+\S+\s+\S+\s+)?[0-9A-Fa-f]{3,8}"
            r"(?:##?[0-9A-Fa-f.R]*|\s+\[\d\d?\](?:\s+[0-9A-Fa-f]{2})*)(?:\s+\S*)?\s*$"
        ),
        0.6,
        "is a candump of a CAN bus: what its bytes mean only a description of the bus tells; decode it, such as with "
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
    """Kinds that are known, those first that packages of `flinders.apps` add: they are more special."""
    added = map(import_module, app_modules("KNOWN_TEXTS").values())
    return (*chain.from_iterable(module.TEXTS for module in added), *TEXTS)


def refusal(name: str, lines: Sequence[str], *, is_unread: bool = False) -> NoMagnetometer | None:
    """Say what a text is that holds no readings; if `is_unread`, also where readings might have stood beside it."""
    some = [line for line in lines[:LOOKED_AT] if line.strip()]
    for text in _texts():
        count = sum(text.sign.search(line) is not None for line in some)
        if count and count >= text.share * len(some) and (is_unread or not text.may_be_read):
            return NoMagnetometer(f"{name} {text.words}")
    return None
