r"""Points of InfluxDB's line protocol: ``mag,host=a x=31.5,y=-32.2,z=46.3 1700000000000000000``.

The name of a field is used alone if it identifies the quantity, otherwise after its measurement. Source: InfluxData,
"Line protocol reference". A time has no unit: it is in ns, or if it has fewer digits in µs, ms or s.

>>> dialect = recognise(["mag,host=a x=1,y=2,z=3 1700000000000000000", "cpu,host=a load=0.5 1700000000000000000"])
>>> dialect.names, dialect.row("mag,host=a x=4i,y=5,z=6 1700000000200000000")
(('time (ns)', 'mag x', 'mag y', 'mag z'), ['1700000000200000000', '4', '5', '6'])
>>> dialect.row("cpu,host=a load=1"), dialect.row("x")
((), None)
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.errors import NoMagnetometer
from flinders.readers._instruments import magnetometers
from flinders.readers._names import meaning
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

POINT: Final = re.compile(
    r"(?P<measurement>[^\s,=]+)(?P<tags>(?:,[^\s,=]+=[^\s,]+)*) (?P<fields>[^\s,=]+=[^\s,]+(?:,[^\s,=]+=[^\s,]+)*)"
    r"(?: (?P<time>\d{10,19}))?"
)
SIGN: Final = re.compile(r"^[^\s,=]+(?:,[^\s,=]+=[^\s,]+)* [^\s,=]+=[^\s,]+(?:,[^\s,=]+=[^\s,]+)*(?: \d{10,19})?\s*$")
MIN_POINT_SHARE: Final = 0.6  # smallest share of points among the lines
UNITS: Final = {19: "ns", 16: "us", 13: "ms", 10: "s"}  # unit of a time, by its number of digits
_NUMBER: Final = re.compile(r"([-+]?\d[\d.]*(?:[eE][-+]?\d+)?)[iu]?")


@dataclass(slots=True)
class Points(Dialect):
    """Points of one series, all with the same fields."""

    series: str  # measurement and tags
    fields: tuple[str, ...]
    is_timed: bool

    def row(self, line: str) -> Sequence[str] | None:
        """Time and fields of a point; empty for another series."""
        point = POINT.fullmatch(line.strip())
        if point is None:
            return None
        fields = _fields(point["fields"])
        if _series(point) != self.series or tuple(fields) != self.fields or (self.is_timed and not point["time"]):
            return ()
        return [point["time"]] * self.is_timed + list(fields.values())


def recognise(lines: list[str]) -> Points | None:
    """Find points, preferably those of the most frequent magnetometer; `NoMagnetometer` if tags distinguish sensors."""
    filled = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    points = [point for line in filled if (point := POINT.fullmatch(line))]
    if not points or len(points) < MIN_POINT_SHARE * len(filled):
        return None
    kinds = Counter((_series(point), tuple(_fields(point["fields"]))) for point in points)
    able = [(series, fields) for series, fields in kinds if magnetometers(_names(series, fields))]
    if not able:
        return None
    series, fields = max(able, key=kinds.__getitem__)
    measurement = series.partition(",")[0]
    alike = sorted({other for other, names in able if names == fields and other.partition(",")[0] == measurement})
    if len(alike) > 1:
        raise NoMagnetometer(
            f"tags distinguish several sensors ({alike[0]}, {alike[1]}): keep only the points of one of them"
        )
    times = [point["time"] for point in points if _series(point) == series]
    is_timed = all(times)
    unit = UNITS.get(len(times[0]), "ns") if is_timed else ""
    names = (*(f"time ({unit})" for _ in range(is_timed)), *_names(series, fields))
    return Points("points of InfluxDB", names, series=series, fields=fields, is_timed=is_timed)


def _series(point: re.Match[str]) -> str:
    return f"{point['measurement']}{point['tags']}"


def _fields(text: str) -> dict[str, str]:
    """Fields of a point; texts and booleans are unchanged."""
    pairs = (field.partition("=") for field in text.split(","))
    return {name: number[1] if (number := _NUMBER.fullmatch(value)) else value for name, _, value in pairs}


def _names(series: str, fields: Sequence[str]) -> tuple[str, ...]:
    """Names of fields, with the measurement in front if they do not identify the quantity."""
    measurement = series.partition(",")[0]
    return tuple(
        name if meaning(name).kind and not meaning(name).is_bare else f"{measurement} {name}" for name in fields
    )
