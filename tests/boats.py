"""A boat that sails in a current, with the readings of its compass and its log: NMEA 0183, NMEA 2000, Signal K."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.core.geomag import site_field
from flinders.geometry.angles import wrap_360
from flinders.heading.harmonics import design

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats

START = 1_780_308_000.0
"""2026-06-01, 10:00 UTC."""
LATITUDE, LONGITUDE = 47.5, 9.3
DECLINATION = site_field(LATITUDE, LONGITUDE, year=2026.41).declination_deg
TRUTH = np.array([0.8, 3.0, -2.0, 1.5, 0.5])


@dataclass(frozen=True)
class Boat:
    """Magnetic headings of a boat over time, the readings of its compass, and its motion over ground."""

    time: Floats
    heading: Floats
    compass: Floats
    course: Floats
    speed: Floats

    @classmethod
    def sail(
        cls,
        heading: Floats,
        rng: np.random.Generator,
        *,
        step: float = 1.0,
        truth: Floats = TRUTH,
        current: complex = 0j,
        leeway: complex = 0j,
        noise: float = 0.5,
        lag: float = 0.0,
    ) -> Boat:
        """Move along headings at 3 m/s; `current` is north + i east, `leeway` is an amplitude over the heading in °."""
        time = step * np.arange(len(heading))
        yaw = heading + 2.0 * np.sin(2.0 * np.pi * time / 6.0 + rng.uniform(0.0, 6.0))
        late = np.interp(time - lag, time, yaw)
        compass = late.copy()
        for _ in range(20):
            compass = late - design(compass) @ truth
        through = 3.0 * (1.0 + 0.02 * np.repeat(rng.standard_normal(len(time) // 60 + 1), 60)[: len(time)])
        turned = yaw + (np.exp(1j * np.deg2rad(heading)) * leeway).real
        velocity = through * np.exp(1j * np.deg2rad(turned)) + current
        velocity = velocity + 0.05 * (rng.standard_normal(len(time)) + 1j * rng.standard_normal(len(time)))
        return cls(
            time,
            wrap_360(yaw),
            wrap_360(compass + noise * rng.standard_normal(len(time))),
            wrap_360(np.rad2deg(np.angle(velocity))),
            np.abs(velocity),
        )


def octagon(leg_s: int = 60) -> Floats:
    """Headings of eight legs, 45° apart, with turns of 15 s between them."""
    parts = [np.append(np.full(leg_s, 45.0 * side), 45.0 * side + 3.0 * np.arange(15.0)) for side in range(8)]
    return np.concatenate(parts)


def circles(rate: float = 1.5, *, is_both: bool = True) -> Floats:
    """Headings of a clockwise circle, and of one back, at two readings per second."""
    there = np.arange(0.0, 370.0, rate / 2.0)
    return np.append(there, there[::-1]) if is_both else there


def nmea_line(body: str) -> str:
    return f"${body}*{reduce(xor, body.encode(), 0):02X}"


def angle(degrees: float, width: int) -> str:
    """Degrees and minutes in the form of a position in NMEA 0183."""
    return f"{int(degrees):0{width}d}{60.0 * (degrees % 1.0):07.4f}"


def nmea0183_of(boat: Boat, *, is_stamped: bool = False) -> Iterator[str]:
    for row in zip(boat.time + START, boat.heading, boat.compass, boat.course, boat.speed, strict=True):
        time, heading, compass, course, speed = row
        clock = datetime.fromtimestamp(time, UTC)
        place = f"{angle(LATITUDE, 2)},N,{angle(LONGITUDE, 3)},E"
        before = f"{int(1000 * time)};N;" if is_stamped else ""
        true = (course + DECLINATION) % 360.0
        yield before + nmea_line(
            f"GPRMC,{clock:%H%M%S}.{clock.microsecond // 10000:02d},A,{place},{speed / 0.514444:.3f},{true:.3f},"
            f"{clock:%d%m%y},,,A"
        )
        yield before + nmea_line(f"HCHDG,{compass:.2f},,,,")
        yield before + nmea_line(f"HEHDT,{(heading + DECLINATION) % 360.0:.2f},T")


def nmea2000_of(boat: Boat, *, is_log: bool = True) -> Iterator[str]:
    def frame(time: float, identifier: int, payload: bytes) -> str:
        data = payload.hex().upper() if is_log else f"  [8]  {payload.hex(' ').upper()}"
        return f"({time:.6f}) can0 {identifier:08X}{'#' if is_log else ''}{data}"

    def units(value: float, size: float, width: int = 2) -> bytes:
        return round(value / size).to_bytes(width, "little", signed=width == 4)

    for row in zip(boat.time + START, boat.heading, boat.compass, boat.course, boat.speed, strict=True):
        time, heading, compass, course, speed = row
        true = np.deg2rad((np.array([heading, course]) + DECLINATION) % 360.0)
        none = b"\xff\x7f\xff\x7f"
        yield frame(time, 0x09F80123, units(LATITUDE, 1e-7, 4) + units(LONGITUDE, 1e-7, 4))
        yield frame(time, 0x09F11224, b"\x01" + units(float(np.deg2rad(compass)), 1e-4) + none + b"\xfd")
        yield frame(time, 0x09F11225, b"\x01" + units(float(true[0]), 1e-4) + none + b"\xfc")
        yield frame(time, 0x09F80223, b"\x01\xfc" + units(float(true[1]), 1e-4) + units(speed, 0.01) + b"\xff\xff")


def signalk_of(boat: Boat) -> Iterator[str]:
    def value(name: str, number: Any) -> dict[str, Any]:  # noqa: ANN401 - of JSON
        return {"path": f"navigation.{name}", "value": number}

    yield '{"name":"server","self":"vessels.urn:mrn:imo:mmsi:211000001","version":"1.0.0"}'
    for row in zip(boat.time + START, boat.heading, boat.compass, boat.course, boat.speed, strict=True):
        time, heading, compass, course, speed = row
        true = np.deg2rad((np.array([heading, course]) + DECLINATION) % 360.0)
        values = [
            value("headingMagnetic", float(np.deg2rad(compass))),
            value("headingTrue", float(true[0])),
            value("courseOverGroundTrue", float(true[1])),
            value("speedOverGround", speed),
            value("position", {"latitude": LATITUDE, "longitude": LONGITUDE}),
        ]
        update = {"$source": "can0.36", "timestamp": f"{datetime.fromtimestamp(time, UTC):%Y-%m-%dT%H:%M:%S.%fZ}"}
        own = {"context": "vessels.urn:mrn:imo:mmsi:211000001", "updates": [{**update, "values": values}]}
        yield json.dumps(own)
        other = {**update, "values": [value("courseOverGroundTrue", 1.0), value("headingTrue", 1.0)]}
        yield json.dumps({"context": "vessels.urn:mrn:imo:mmsi:244000002", "updates": [other, other]})
