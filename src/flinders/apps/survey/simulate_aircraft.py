"""Simulated calibration flights of an aircraft with a scalar and a vector magnetometer, with known interference.

On each of four headings the aircraft rolls by ±10°, pitches by ±5° and yaws by ±5°, as for a figure of merit. Its field
is that of Tolles and Lawson, with a permanent, an induced and an eddy-current part,

    B_a = p + Λ B_e + E dB_e/dt

and both magnetometers measure B_e + B_a, without linearisation.

>>> flight = calibration_flight(seed=1)
>>> len(flight.manoeuvres), flight.manoeuvres[0].name, flight.manoeuvres[0].heading_deg
(12, 'roll', 0.0)
>>> bool(10.0 < flight.interference.std() < 500.0)
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.arrays import Floats, check_matrix, check_triple, read_only_copy
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down
from flinders.simulate.motions import GRAVITY, smooth_noise
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.random import Generator

HEADINGS_DEG: Final = (0.0, 90.0, 180.0, 270.0)

AMPLITUDES_DEG: Final = {"roll": 10.0, "pitch": 5.0, "yaw": 5.0}
"""Amplitudes of the manoeuvres of a figure of merit, in their order."""

PERIOD_S: Final = (4.0, 5.0)
"""Shortest and longest period of a manoeuvre, in s."""

CYCLES: Final = 3
"""Number of cycles of a manoeuvre."""

LEVEL_S: Final = 6.0
"""Duration of level flight before each manoeuvre and at the end of a line, in s."""

TURN_DEG_S: Final = 3.0
"""Rate of turns in °/s: the standard rate."""

SMOOTHING_S: Final = 1.0
"""Length in s of the window that smooths attitudes."""

SPEED_M_S: Final = 60.0
"""Speed in m/s, which determines the bank in a turn."""

ATTITUDE_NOISE_DEG: Final = 0.5
"""Root mean square of unintended roll, pitch and change of heading, in degrees."""

PERMANENT_NT: Final = 100.0
INDUCED_NT: Final = 100.0
"""Root mean square of a permanent and of an induced coefficient, the latter in a field of 50 µT.

A fit to line 1007.06 of the survey aircraft of the DAF-MIT flight data has 52, 176 and 59 nT of permanent field, and
200 nT for the induced term xy, at a magnetometer in the cabin.
"""

EDDY_S: Final = 1e-3
"""Root mean square of an eddy-current coefficient in s. It is assumed, without a source: 10 nT in a roll of ±10°."""


@dataclass(frozen=True, slots=True, eq=False)
class Aircraft:
    """The magnetic field of an aircraft at its magnetometers."""

    permanent: Floats = field(default_factory=lambda: np.zeros(3))  #: (3,) µT in body axes
    induced: Floats = field(default_factory=lambda: np.zeros((3, 3)))  #: (3, 3), symmetric, times the earth's field
    eddy: Floats = field(default_factory=lambda: np.zeros((3, 3)))  #: (3, 3), s, times the change of the earth's field

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "permanent", read_only_copy(check_triple(self.permanent, "permanent")))
        for name in ("induced", "eddy"):
            object.__setattr__(self, name, read_only_copy(check_matrix(getattr(self, name), name)))

    @classmethod
    def random(cls, rng: Generator) -> Self:
        """Draw an aircraft as magnetic as published ones, see `PERMANENT_NT`."""
        drawn = rng.standard_normal((3, 3)) * INDUCED_NT / 50_000.0
        permanent = PERMANENT_NT / 1000.0 * rng.standard_normal(3)
        return cls(permanent, (drawn + drawn.T) / math.sqrt(2.0), EDDY_S * rng.standard_normal((3, 3)))

    def field(self, earth: Floats, rate_hz: float) -> Floats:
        """(N, 3) field of the aircraft in µT, from the (N, 3) earth's field in body axes at a rate in Hz."""
        change = np.gradient(earth, 1.0 / rate_hz, axis=0)
        added: Floats = self.permanent + earth @ self.induced.T + change @ self.eddy.T
        return added


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Rolls, pitches or yaws on one heading."""

    name: str  #: ``roll``, ``pitch`` or ``yaw``
    heading_deg: float
    rows: slice  #: rows of the recording


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A simulated calibration flight."""

    samples: Samples  #: readings, with the scalar magnetometer as `Samples.strength`
    interference: Floats  #: (N,) nT: field of the aircraft in the scalar magnetometer
    manoeuvres: tuple[Manoeuvre, ...]
    aircraft: Aircraft

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready truth: the field of the aircraft, and the rows of each manoeuvre in the recording."""
        return {
            "permanent_nT": (1000.0 * self.aircraft.permanent).tolist(),  # (3,): permanent field in body axes
            "induced": self.aircraft.induced.tolist(),  # (3, 3): field over that of the earth
            "eddy_s": self.aircraft.eddy.tolist(),  # (3, 3): field over the change of that of the earth
            # for each manoeuvre its `name`, heading, and first row and end in the recording
            "manoeuvres": [
                {"name": each.name, "heading_deg": each.heading_deg, "rows": [each.rows.start, each.rows.stop]}
                for each in self.manoeuvres
            ],
        }


def calibration_flight(
    seed: int | Generator = 0,
    *,
    aircraft: Aircraft | None = None,
    headings_deg: Sequence[float] = HEADINGS_DEG,
    manoeuvres: Sequence[str] = tuple(AMPLITUDES_DEG),
    rate_hz: float = 10.0,
    field_strength: float = 50.0,
    dip_deg: float = 65.0,
    scalar_noise: float = 5e-5,
    geology: float = 0.02,
    vector: Sensor | None = None,
) -> Flight:
    """Simulate rolls, pitches and yaws on several headings, with turns at standard rate between them.

    Raises `UsageError` for an unknown manoeuvre.

    Parameters
    ----------
    aircraft : Aircraft, optional
        By default one of `Aircraft.random`.
    headings_deg : sequence of float
        Headings, flown one after the other with the manoeuvres on each.
    manoeuvres : sequence of str
        Any of ``roll``, ``pitch`` and ``yaw``.
    scalar_noise, geology : float, µT
        White noise of the scalar magnetometer, 1 σ; and root mean square of the field of the ground along the flight
        path, which changes slowly, with a correlation time of 20 s.
    vector : Sensor, optional
        The vector magnetometer, by default one of `fluxgate`.
    """
    rng = np.random.default_rng(seed)
    aircraft = Aircraft.random(rng) if aircraft is None else aircraft
    vector = fluxgate(rng) if vector is None else vector
    angles, flown = _flight_path(rng, headings_deg, manoeuvres, rate_hz)
    angles = angles + np.radians(ATTITUDE_NOISE_DEG) * _smooth_noise(rng, len(angles), rate_hz, seconds=1.0)
    slow = geology * _smooth_noise(rng, len(angles), rate_hz, seconds=20.0)[:, :1]
    attitudes = attitudes_of(angles[:, 2], angles[:, 1], angles[:, 0])
    earth = (field_strength + slow) * in_body_axes(attitudes, north_and_down(dip_deg))
    total = earth + aircraft.field(earth, rate_hz)
    scalar = np.linalg.norm(total, axis=1)
    samples = Samples.of(
        vector.read(total, rng),
        unit="uT",
        time=np.arange(len(angles)) / rate_hz,
        strength=scalar + scalar_noise * rng.standard_normal(len(scalar)),
        source="simulated calibration flight",
    )
    return Flight(samples, 1000.0 * (scalar - np.linalg.norm(earth, axis=1)), flown, aircraft)


def fluxgate(rng: Generator) -> Sensor:
    """A usual fluxgate magnetometer: alignment and gains within 0.2 %, offset 50 nT, noise 2 nT (all 1 σ)."""
    return Sensor(np.eye(3) + 0.002 * rng.standard_normal((3, 3)), 0.05 * rng.standard_normal(3), noise=0.002)


def _flight_path(
    rng: Generator, headings_deg: Sequence[float], manoeuvres: Sequence[str], rate_hz: float
) -> tuple[Floats, tuple[Manoeuvre, ...]]:
    """(N, 3) roll, pitch and heading in rad, and the rows of each manoeuvre."""
    parts: list[Floats] = []
    flown: list[Manoeuvre] = []
    before = headings_deg[0]
    for heading in headings_deg:
        parts.append(_turn(before, heading, rate_hz))
        for name in manoeuvres:
            parts.append(_level_flight(heading, rate_hz))
            start = sum(map(len, parts))
            parts.append(_level_flight(heading, rate_hz, _manoeuvre(rng, name, rate_hz)))
            flown.append(Manoeuvre(name, heading, slice(start, start + len(parts[-1]))))
        parts.append(_level_flight(heading, rate_hz))
        before = heading
    return _smooth_corners(np.unwrap(np.concatenate(parts), axis=0), rate_hz), tuple(flown)


def _smooth_corners(angles: Floats, rate_hz: float) -> Floats:
    """(N, 3) angles smoothed over a second, since an aircraft cannot change its rates at once."""
    half = max(round(SMOOTHING_S * rate_hz / 2.0), 1)
    weights = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(angles, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(weights), axis=0)
    smooth: Floats = windows @ (weights / np.sum(weights))
    return smooth


def _manoeuvre(rng: Generator, name: str, rate_hz: float) -> Floats:
    """(N, 3) roll, pitch and heading in rad of `CYCLES` cycles, with an amplitude within 10 % of the intended one."""
    if name not in AMPLITUDES_DEG:
        raise UsageError(f"there is no manoeuvre {name!r}: need some of {', '.join(AMPLITUDES_DEG)}")
    period = rng.uniform(*PERIOD_S)
    phase = 2.0 * np.pi * np.arange(round(CYCLES * period * rate_hz)) / (period * rate_hz)
    amplitude = math.radians(AMPLITUDES_DEG[name] * rng.uniform(0.9, 1.1))
    return np.outer(amplitude * np.sin(phase), [name == axis for axis in AMPLITUDES_DEG])


def _level_flight(heading_deg: float, rate_hz: float, angles: Floats | None = None) -> Floats:
    """(N, 3) angles in rad on a heading: straight and level, or with the given manoeuvre."""
    flown = np.zeros((round(LEVEL_S * rate_hz), 3)) if angles is None else angles
    turned: Floats = flown + np.array([0.0, 0.0, math.radians(heading_deg)])
    return turned


def _turn(first_deg: float, last_deg: float, rate_hz: float) -> Floats:
    """(N, 3) angles in rad of a coordinated turn in the shorter direction; empty for an unchanged heading."""
    by = (last_deg - first_deg + 180.0) % 360.0 - 180.0
    n = round(abs(by) / TURN_DEG_S * rate_hz)
    share = np.arange(n) / max(n, 1)
    bank = math.copysign(math.atan(SPEED_M_S * math.radians(TURN_DEG_S) / GRAVITY), by)
    roll = bank * np.clip(5.0 * np.minimum(share, 1.0 - share), 0.0, 1.0)
    return np.column_stack([roll, np.zeros(n), np.radians(first_deg + by * share)])


def _smooth_noise(rng: Generator, n: int, rate_hz: float, *, seconds: float) -> Floats:
    """(n, 3) smooth random values with root mean square 1."""
    smooth = smooth_noise(rng, n, math.exp(-1.0 / (rate_hz * seconds)))
    scaled: Floats = smooth / np.sqrt(np.mean(smooth**2, axis=0))
    return scaled
