"""Texts of boats that are no readings of a magnetometer, recognised so that a reader can give advice on their use."""

from __future__ import annotations

from typing import Final

from flinders.apps.marine import nmea0183, nmea2000
from flinders.readers._known_texts import KnownText

TEXTS: Final = (
    KnownText(
        nmea2000.SIGN,
        0.6,
        "is a candump of NMEA 2000 without readings x, y, z of a magnetometer: flinders swing uses its headings in "
        "degrees",
        may_be_read=True,
    ),
    KnownText(
        nmea0183.SIGN,
        0.0,
        "is a log of a boat, with headings in degrees: flinders swing finds the deviation from it; a calibration needs "
        "readings x, y, z of the magnetometer",
        may_be_read=True,
    ),
)
