"""Turning saved by advice: three users turn a sensor at 90° a second until the worst direction is within 1°.

    python -m benchmarks.guidance [--seeds 50] [--noise 0.25,0.5,1] [--stray 0] [--processes 2]

One tumbles it at random (`flinders.simulate.hand_tumble`, its mean rate 90° a second), one moves the field's direction
straight to the best single direction (`flinders.heading.guidance.guide`), one follows a planned path
(`flinders.heading.path_planning`). Four times a second all readings so far (50 a second) are fitted and the advice is
updated. A run ends when the fit is not refused and claims a direction error (1 σ) of at most 1° in the worst of 100
directions. With `--stray DEG` the hand deviates from the path by a slowly changing angle of that standard deviation.

Columns: medians over the seeds of the seconds and of the turning, with their ratios to random tumbling; the largest
true direction error at the end, rms over the seeds.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Final, Literal, Protocol

import numpy as np

import flinders
from flinders import simulate
from flinders.apps.live.guided import believe
from flinders.errors import FitError
from flinders.fitting.result import Refused
from flinders.geometry.rotation import best_rotation
from flinders.geometry.rotation import rotations as turns
from flinders.heading import path_planning
from flinders.heading.error_propagation import direction_errors_deg
from flinders.heading.guidance import guide
from flinders.simulate import Sensor
from flinders.simulate.attitudes import in_body_axes, north_and_down

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

RATE_HZ: Final = 50.0
TICK_S: Final = 0.24
TURN_RATE_DEGPS: Final = 90.0
TARGET_DEG: Final = 1.0
FIELD: Final = 50.0
MAX_DURATION_S: Final = 60.0
CHECKED_DIRECTIONS: Final = simulate.fibonacci(100)

Who = Literal["chance", "advice", "route"]
USERS: Final[tuple[Who, ...]] = ("chance", "advice", "route")


@dataclass(frozen=True, slots=True)
class Done:
    """Result of a run: seconds, degrees of turning, and the true worst error at the end."""

    seconds: float
    turned_deg: float
    true_worst_deg: float


class User(Protocol):
    """User who turns the sensor."""

    def turn(self, field: Floats, fit: Fit | None, /) -> tuple[Floats, float]:
        """Turn for one tick: (n, 3) directions of the field in body axes, and the degrees turned."""


class Chance:
    """User who tumbles the sensor at random."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 5])
        speed = math.radians(TURN_RATE_DEGPS)
        turning = simulate.hand_tumble(rng, seconds=MAX_DURATION_S + 1.0, rate_hz=RATE_HZ, speed=speed)
        rates = np.linalg.norm(turning.rate, axis=1)
        steps = turns(turning.rate * (speed / rates.mean() / RATE_HZ))  # the same path, but for its mean rate
        attitudes = np.empty_like(steps)
        attitude = turning.attitudes[0]
        for index, step in enumerate(steps):
            attitudes[index] = attitude
            attitude = attitude @ step
        self._directions = in_body_axes(attitudes, north_and_down(60.0))
        self._angles_deg = np.degrees(rates * (speed / rates.mean() / RATE_HZ))

    def turn(self, field: Floats, _fit: Fit | None, /) -> tuple[Floats, float]:
        """Continue the tumble."""
        now = slice(len(field), len(field) + round(TICK_S * RATE_HZ))
        return self._directions[now], float(self._angles_deg[now].sum())


class Follower:
    """User who follows the advice, or keeps the direction without advice."""

    def __init__(self, seed: int, rng: Generator, *, ahead: bool, stray_deg: float) -> None:
        start = np.random.default_rng([seed, 6])
        self._at, aside = simulate.uniform_directions(start, 2)
        self._axis = np.cross(self._at, aside)
        self._ahead, self._stray_deg, self._stray, self._rng = ahead, stray_deg, 0.0, rng

    def turn(self, field: Floats, fit: Fit | None, /) -> tuple[Floats, float]:
        """Move along a great circle to the advised direction, as accurately as the fit determines it."""
        if len(field):
            self._axis = self._advised(field, fit)
        self._stray += 0.5 * (self._rng.standard_normal() * self._stray_deg * math.sqrt(0.75) * 2.0 - self._stray)
        axis = self._axis - (self._axis @ self._at) * self._at
        axis /= np.linalg.norm(axis)
        across = np.cross(axis, self._at)
        aside = math.radians(self._stray)
        across = math.cos(aside) * across + math.sin(aside) * axis
        angles = np.radians(TURN_RATE_DEGPS) * np.arange(1, round(TICK_S * RATE_HZ) + 1)[:, np.newaxis] / RATE_HZ
        walked: Floats = np.cos(angles) * self._at + np.sin(angles) * across
        self._at, self._axis = walked[-1], np.cross(walked[-2], walked[-1])
        return walked, TURN_RATE_DEGPS * TICK_S

    def _advised(self, field: Floats, fit: Fit | None) -> Floats:
        if self._ahead:
            belief = believe(fit, field)
            if belief is None:
                return self._axis
            here = belief.direction(field[-1])
            there = path_planning.plan(belief, here, target_deg=TARGET_DEG, goal="attitude").waypoints[0]
        else:
            if fit is None:
                return self._axis
            here = path_planning.Belief.of(fit.claim, fit.evidence.noise, fit.evidence.coverage).direction(field[-1])
            there = guide(
                fit.calibration.ellipsoid,
                fit.claim.covariance,
                noise=fit.evidence.noise,
                coverage=fit.evidence.coverage,
                goal="attitude",
            ).direction
        axis: Floats = np.cross(here, there)
        return axis if np.linalg.norm(axis) > 1e-3 else self._axis


def until_done(who: Who, noise: float, seed: int, stray_deg: float = 0.0) -> Done:
    """Turn a sensor of random iron until it is calibrated.

    Parameters
    ----------
    who : str
        ``chance``, ``advice`` or ``route``.
    noise : float, µT
        Of a field of 50 µT.
    seed : int
    stray_deg : float
        Deviation of the hand from the path, 1 σ.
    """
    rng = np.random.default_rng([seed, round(1000 * noise)])
    sensor = Sensor.random(np.random.default_rng(seed), noise=noise)
    user: User = Chance(seed) if who == "chance" else Follower(seed, rng, ahead=who == "route", stray_deg=stray_deg)
    field, fit = np.empty((0, 3)), None
    turned = 0.0
    while len(field) < MAX_DURATION_S * RATE_HZ:
        directions, angle = user.turn(field, fit)
        turned += angle
        field = np.concatenate([field, sensor.read(FIELD * directions, rng)])
        fit = fitted(field)
        if fit is not None and fit.verdict != "refused" and worst_deg(fit) <= TARGET_DEG:
            break
    return Done(len(field) / RATE_HZ, turned, math.nan if fit is None else true_worst_deg(fit, sensor))


def fitted(field: Floats) -> Fit | None:
    """Fit of readings, also a refused one."""
    try:
        return flinders.fit(field)
    except Refused as refusal:
        return refusal.fit
    except FitError:
        return None


def worst_deg(fit: Fit) -> float:
    """Claimed direction error, degrees."""
    return float(direction_errors_deg(fit.calibration.ellipsoid, fit.claim.covariance, CHECKED_DIRECTIONS).max())


def true_worst_deg(fit: Fit, sensor: Sensor) -> float:
    """True direction error, degrees, without the rotation that a magnetometer cannot determine."""
    readings = FIELD * CHECKED_DIRECTIONS @ sensor.matrix.T + sensor.offset
    corrected = fit.calibration.apply(readings)
    corrected /= np.linalg.norm(corrected, axis=1, keepdims=True)
    turned = corrected @ best_rotation(corrected, CHECKED_DIRECTIONS).T
    across = np.linalg.norm(np.cross(turned, CHECKED_DIRECTIONS), axis=1)
    return float(np.degrees(np.arcsin(across.clip(max=1.0))).max())


def rows(noises: Sequence[float], seeds: int, stray_deg: float, processes: int) -> list[str]:
    """Lines of the table."""
    asked = list(product(noises, USERS, range(seeds)))
    with ProcessPoolExecutor(processes) as pool:
        done = list(pool.map(_job, asked, [stray_deg] * len(asked), chunksize=10))
    lines = [
        "| noise | user | time | turning | of chance's time | of its turning | true worst |",
        "|---|---|---|---|---|---|---|",
    ]
    for noise in noises:
        chance: tuple[float, float] | None = None
        for who in USERS:
            these = [one for one, (level, user, _) in zip(done, asked, strict=True) if (level, user) == (noise, who)]
            seconds = float(np.median([one.seconds for one in these]))
            turned = float(np.median([one.turned_deg for one in these]))
            true = math.sqrt(float(np.mean([one.true_worst_deg**2 for one in these])))
            chance = chance or (seconds, turned)
            lines.append(
                f"| {noise:g} µT | {who} | {seconds:.1f} s | {turned:.0f}° | {seconds / chance[0]:.2f} "
                f"| {turned / chance[1]:.2f} | {true:.2f}° |"
            )
    return lines


def _job(asked: tuple[float, Who, int], stray_deg: float) -> Done:
    noise, who, seed = asked
    return until_done(who, noise, seed, stray_deg)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--noise", default="0.25,0.5,1")
    parser.add_argument("--stray", type=float, default=0.0)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    noises = [float(part) for part in given.noise.split(",")]
    print("\n".join(rows(noises, given.seeds, given.stray, given.processes)))


if __name__ == "__main__":
    main()
