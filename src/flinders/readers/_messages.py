"""One number of a boat's instruments: what the readers of NMEA 0183, NMEA 2000 and Signal K yield."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

Kind: TypeAlias = Literal["compass", "heading", "course", "speed", "latitude", "longitude"]
"""Heading by the compass, true heading, true course over ground, speed over ground, position."""


class Message(NamedTuple):
    """A number, when it was said and by whom."""

    time: float  # s since 1970, or since the beginning of the first day
    kind: Kind
    value: float  # degrees, m/s
    source: str  # talker and sentence, PGN and address, or path and source
