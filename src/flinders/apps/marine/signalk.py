"""Deltas of Signal K, one in each line: headings, course, speed and position of one vessel.

Text before the first brace of a line, as in logs of the server, is ignored. Angles are in rad.

Sources: SignalK/specification ``schemas/groups/navigation.json`` and issue 242; a delta by tkurki (gist 73ebbfae).

>>> value = '{"path":"navigation.headingMagnetic","value":1}'
>>> [message] = messages(['{"updates":[{"timestamp":"2026-06-01T10:00:00Z","values":[%s]}]}' % value])
>>> message.kind, round(message.value, 2), message.time
('compass', 57.3, 1780308000.0)
"""

from __future__ import annotations

import json
import math
import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, TypeGuard

from flinders.apps.marine.nmea0183 import Message

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from flinders.apps.marine.nmea0183 import Kind

SIGN: Final = re.compile(r'"updates"\s*:\s*\[')
"""Pattern in the first lines of a file of Signal K."""
KINDS: Final[dict[str, Kind]] = {
    "navigation.headingCompass": "compass",
    "navigation.headingMagnetic": "compass",
    "navigation.headingTrue": "heading",
    "navigation.courseOverGroundTrue": "course",
    "navigation.speedOverGround": "speed",
}
POSITION: Final = "navigation.position"
MAX_NUMBER: Final = 1e6
"""Largest absolute value of a valid number."""


def messages(lines: Iterable[str]) -> Iterator[Message]:
    """Yield the messages of the vessel with most compass headings; messages of other vessels come from AIS."""
    by_vessel: dict[str, list[Message]] = {}
    for delta in map(_object, lines):
        said = by_vessel.setdefault(str(delta.get("context")), [])
        said += [message for update in _objects(delta.get("updates")) for message in _update_messages(update)]
    yield from max(by_vessel.values(), key=_compass_count, default=[])


def _compass_count(said: Iterable[Message]) -> int:
    """Number of messages with a compass heading."""
    return sum(message.kind == "compass" for message in said)


def _update_messages(update: dict[str, Any]) -> Iterator[Message]:
    """Yield the messages of an update: one source at one time."""
    time = _time(update.get("timestamp"))
    if time is None:
        return
    label = update.get("$source")
    for member in _objects(update.get("values")):
        path = str(member.get("path"))
        source = path if label is None else f"{path}, {label}"
        for kind, value in _numbers_in(path, member.get("value")):
            yield Message(time, kind, value, source)


def _numbers_in(path: str, value: object) -> Iterator[tuple[Kind, float]]:
    """Yield the kind and value of each number at a path of Signal K."""
    if path in KINDS and _is_number(value, MAX_NUMBER):
        yield KINDS[path], float(value) if KINDS[path] == "speed" else math.degrees(value)
    elif path == POSITION and isinstance(value, dict):
        latitude, longitude = value.get("latitude"), value.get("longitude")
        if _is_number(latitude, 90.0) and _is_number(longitude, 180.0):
            yield "latitude", float(latitude)
            yield "longitude", float(longitude)


def _is_number(value: object, most: float) -> TypeGuard[float]:
    """Whether a value is a number of at most `most`, ignoring its sign."""
    return isinstance(value, int | float) and abs(value) <= most


def _object(line: str) -> dict[str, Any]:
    """JSON object of a line; empty if there is none."""
    start = line.find("{")
    try:
        value = json.loads(line[start:]) if start >= 0 else {}
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


def _objects(value: object) -> list[dict[str, Any]]:
    """JSON objects of a list; empty for other values."""
    return [member for member in value if isinstance(member, dict)] if isinstance(value, list) else []


def _time(text: object) -> float | None:
    """Seconds since 1970 of a time in ISO 8601, in UTC unless it names a zone; None for another text."""
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
