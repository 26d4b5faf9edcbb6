"""Claims in a spatially varying field: turns of a hand or an arm about nearly one axis, and drives on level roads.

    python -m benchmarks.varying_field [--trials 100] [--paths "arc of 20°" …] [--felt] [--processes 2]

A sensor on an arm is turned about nearly one axis, swung or waved for a minute. Four dipoles at one to three metres
make the field vary by 0.5 to 2 % (rms) within half a metre of the middle of its path. Half of the sensors were
corrected before. A car drives straight, changes lanes, turns and stops for five minutes on slopes of 1 to 3° (rms), and
the field varies by 0.5 to 2 % along the road. ``--felt`` records an accelerometer, too. The physics are those of
`benchmarks.adversary`, which shares no code with `flinders.simulate`.

*Ratio* is the true over the claimed worst level heading error of good and limited fits, and *within two* their share
with an error of at most twice the claim. *Worse* counts errors above that of the raw readings by more than the claim.
Refusals are counted separately, with the same share for the fits that they carry.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.adversary import (
    RATE_HZ,
    STEPS_PER_READING,
    STRENGTH_UT,
    Effect,
    Path,
    Sensor,
    about,
    anywhere,
    chained,
    felt,
    fitted,
    headings,
    level,
    recorded,
    sensor,
    smooth,
    stream,
    tumble,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

VERDICTS: Final = ("good", "limited", "refused")
REACH_M: Final = 0.5
"""Radius of the region with the stated variation of the field."""
VARIATION: Final = (0.005, 0.02)
"""Range of the variation as a share of the strength, rms."""
STEP_S: Final = 1.0 / (STEPS_PER_READING * RATE_HZ)
SECONDS: Final = 60.0


@dataclass(frozen=True, slots=True)
class Thin:
    """Claimed, true and raw heading error of one fit, degrees."""

    verdict: str
    claimed: float
    true: float
    raw: float

    @property
    def is_worse(self) -> bool:
        """Whether the error exceeds that of raw readings by more than the claim."""
        return self.true > self.raw + self.claimed


def swinging(rng: Generator, attitudes: Floats, arm_m: tuple[float, float]) -> Path:
    """Path of a sensor at the end of an arm about a hand that drifts by 3 cm."""
    arm = rng.standard_normal(3)
    arm *= rng.uniform(*arm_m) / np.linalg.norm(arm)
    hand = 0.03 * smooth(rng, len(attitudes), STEP_S, 1.5)
    return Path(STEP_S * np.arange(len(attitudes)), attitudes, hand + attitudes @ arm)


def time_of(seconds: float = SECONDS) -> Floats:
    """(M,) times in fine steps, s."""
    times: Floats = STEP_S * np.arange(round(seconds / STEP_S))
    return times


def wobbled(rng: Generator, angles: Floats, wobble_deg: float) -> Floats:
    """(M, 3, 3) attitudes for angles (M,) rad about one axis, with wobble about all axes."""
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    shaken = np.radians(wobble_deg) * smooth(rng, len(angles), STEP_S, 1.0)
    turned: Floats = anywhere(rng) @ about(angles[:, None] * axis) @ about(shaken)
    return turned


def arc(rng: Generator, *, half_deg: float) -> Path:
    """Path to and fro about one axis."""
    turn = 2 * np.pi * time_of() / rng.uniform(2.0, 6.0) + rng.uniform(0.0, 2 * np.pi)
    return swinging(rng, wobbled(rng, np.radians(half_deg) * np.sin(turn), 1.5), (0.1, 0.6))


def one_axis(rng: Generator) -> Path:
    """Path of full turns about nearly one axis."""
    return swinging(rng, wobbled(rng, 2 * np.pi * time_of() / rng.uniform(4.0, 10.0), 4.0), (0.1, 0.6))


def wand(rng: Generator) -> Path:
    """Path waved by the wrist: two axes by about 25°, the third by 10°."""
    rates = np.radians([25.0, 25.0, 10.0]) * smooth(rng, len(time_of()), STEP_S, 0.4)
    return swinging(rng, anywhere(rng) @ about(rates), (0.2, 0.6))


def pendulum(rng: Generator) -> Path:
    """Path of a pendulum with swings of 30 to 70° in nearly one vertical plane."""
    length = rng.uniform(0.4, 1.0)
    swing = np.radians(rng.uniform(30.0, 70.0)) * np.cos(2 * np.pi * time_of() / (2.0 * np.sqrt(length)))
    axis = np.array([np.cos(turn := rng.uniform(0.0, 2 * np.pi)), np.sin(turn), 0.0])
    shaken = np.radians(2.0) * smooth(rng, len(swing), STEP_S, 1.0)
    mounted = anywhere(rng)
    attitudes = about(swing[:, None] * axis) @ about(shaken)
    return Path(time_of(), attitudes @ mounted, attitudes @ np.array([0.0, 0.0, length]))


def tumbled(rng: Generator) -> Path:
    """Path with turns about all axes at the end of an arm."""
    rates = 1.8 * smooth(rng, len(time_of()), STEP_S, 0.6)
    return swinging(rng, chained(about(rates * STEP_S), anywhere(rng)), (0.1, 0.3))


def drive(rng: Generator) -> Path:
    """Path of a car for five minutes: straight, lane changes, turns into other streets, and stops before some."""
    rates, speeds = np.zeros(round(300.0 / STEP_S)), np.zeros(round(300.0 / STEP_S))
    at = 0
    while at < len(rates):
        for seconds, speed, turn_deg, to_and_fro in (
            (rng.uniform(4.0, 15.0), 12.0, 0.0, False),
            (3.0, 12.0, 8.0 * rng.choice([-1.0, 1.0]), True),
            (rng.uniform(3.0, 10.0), 12.0, 0.0, False),
            (rng.uniform(5.0, 40.0) if rng.random() < 0.4 else 0.0, 0.0, 0.0, False),
            (rng.uniform(4.0, 6.0), 5.0, rng.choice([-90.0, 90.0]) + rng.uniform(-20.0, 20.0), False),
        ):
            steps = np.linspace(0.0, 1.0, round(seconds / STEP_S), endpoint=False)
            shape = 2 * np.pi * np.sin(2 * np.pi * steps) if to_and_fro else 1.0 - np.cos(2 * np.pi * steps)
            part = slice(at, at + len(steps))
            room = max(min(len(steps), len(rates) - at), 0)
            rates[part] = (np.radians(turn_deg) * shape / max(seconds, STEP_S))[:room]
            speeds[part] = speed
            at += len(steps)
    heading = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rates) * STEP_S
    step = speeds[:, None] * STEP_S * np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=1)
    places = np.cumsum(step, axis=0)
    slope = np.radians(rng.uniform(1.0, 3.0)) * road(rng, places, 60.0)[:, :2]
    zero = np.zeros_like(heading)
    return Path(
        STEP_S * np.arange(len(heading)),
        about(np.stack([slope[:, 0], slope[:, 1], zero], axis=1)) @ about(np.stack([zero, zero, heading], axis=1)),
        places,
    )


def road(rng: Generator, places: Floats, length_m: float) -> Floats:
    """(M, 3) smooth series of unit variance along a road."""
    waves = rng.standard_normal((40, 2)) / length_m
    phases, sizes = rng.uniform(0.0, 2 * np.pi, 40), rng.standard_normal((40, 3)) / np.sqrt(20.0)
    varying: Floats = np.cos(places[:, :2] @ waves.T + phases) @ sizes
    return varying


def along(rng: Generator, path: Path, *, share: float) -> Floats:
    """(M, 3) variation of the field along a road, µT; `share` is its rms as a share of the field strength."""
    field: Floats = share * STRENGTH_UT / np.sqrt(3.0) * road(rng, path.places, 20.0)
    return field


PATHS: Final[dict[str, Callable[[Generator], Path]]] = {
    **{f"arc of {half}°": partial(arc, half_deg=half) for half in (10, 20, 30, 40)},
    "one axis": one_axis,
    "wand": wand,
    "pendulum": pendulum,
    "tumble on an arm": tumbled,
    "tumble": tumble,
    "drive": drive,
}


def dipoles(places: Floats, at: Floats, moments: Floats) -> Floats:
    """(M, 3) field of dipoles (D, 3), up to a factor."""
    total = np.zeros_like(places)
    for where, moment in zip(at, moments, strict=True):
        away = places - where
        distance = np.linalg.norm(away, axis=1)[:, None]
        total += (3.0 * (away @ moment)[:, None] * away / distance**2 - moment) / distance**3
    return total


def varied(rng: Generator, path: Path, *, share: float) -> Floats:
    """(M, 3) variation of the field along a path, µT; `share` is its rms around the middle over the strength."""
    directions = rng.standard_normal((4, 3))
    at = rng.uniform(1.0, 3.0, 4)[:, None] * directions / np.linalg.norm(directions, axis=1)[:, None]
    moments = rng.standard_normal((4, 3)) * np.linalg.norm(at, axis=1)[:, None] ** 3
    ball = rng.standard_normal((500, 3))
    ball *= REACH_M * rng.uniform(0.0, 1.0, 500)[:, None] ** (1 / 3) / np.linalg.norm(ball, axis=1)[:, None]
    around = dipoles(ball, at, moments)
    size = share * STRENGTH_UT / np.sqrt(np.mean(np.sum((around - around.mean(axis=0)) ** 2, axis=1)))
    middle = path.places.mean(axis=0)
    field: Floats = size * (dipoles(path.places - middle, at, moments) - around.mean(axis=0))
    return field


def corrected_before(rng: Generator) -> Sensor:
    """Sensor with readings already corrected, with remaining errors of 0.5 % of offset and soft iron."""
    mixed = 0.005 * rng.standard_normal((3, 3))
    return Sensor(np.eye(3) + (mixed + mixed.T) / 2, 0.005 * STRENGTH_UT * rng.standard_normal(3))


def met(seed: int, of: Sensor, effect: Effect, fit: Fit) -> Floats:
    """(72, 3) readings of a level turn; with the field inverted if the fit found an upside-down sensor."""
    if fit.heading_error_deg.dip_deg > 0.0:
        return level(seed, of, effect)
    return level(seed, Sensor(np.diag([1.0, 1.0, -1.0]) @ of.iron, of.offset), effect)


def tried(case: tuple[str, int], *, is_felt: bool) -> Thin:
    """One fit of a path with a seed."""
    name, seed = case
    rng = stream(seed, "share")
    share = float(np.exp(rng.uniform(*np.log(VARIATION))))
    effect = Effect(place=partial(along if name == "drive" else varied, share=share))
    of = (corrected_before if seed % 2 else sensor)(stream(seed, "sensor"))
    path = PATHS[name](stream(seed, f"path {name}"))
    samples = recorded(seed, of, effect, path)
    fit = fitted(felt(samples, seed, path) if is_felt else samples)
    raw = float(np.abs(headings(level(seed, of, effect))).max())
    if fit is None:
        return Thin("refused", np.nan, np.nan, raw)
    true = float(np.abs(headings(fit.calibration.apply(met(seed, of, effect, fit)))).max())
    return Thin(fit.verdict, fit.heading_error_deg.worst, true, raw)


HEAD: Final = (
    "| path | good, limited, refused | claimed, true (median) | ratio 50 / 90 % | within two | worse |"
    " refused within two |\n"
    "|---|---|---|---|---:|---:|---:|"
)


def within_two(trials: Sequence[Thin]) -> str:
    """Share of fits with an error of at most twice the claim."""
    return f"{np.mean([trial.true <= 2.0 * trial.claimed for trial in trials]):.0%}" if trials else "–"


def row(name: str, trials: Sequence[Thin]) -> str:
    """A row of the table."""
    verdicts = ", ".join(str(sum(trial.verdict == verdict for trial in trials)) for verdict in VERDICTS)
    known = [trial for trial in trials if np.isfinite(trial.true)]
    stated = [trial for trial in known if trial.verdict != "refused"]
    refused = [trial for trial in known if trial.verdict == "refused"]
    middle = ratios = "–"
    if stated:
        claimed, true = (np.median([getattr(trial, name) for trial in stated]) for name in ("claimed", "true"))
        middle = f"{claimed:.2f}°, {true:.2f}°"
        ratios = " / ".join(f"{q:.1f}" for q in np.quantile([t.true / t.claimed for t in stated], [0.5, 0.9]))
    worse = sum(trial.is_worse for trial in stated)
    return f"| {name} | {verdicts} | {middle} | {ratios} | {within_two(stated)} | {worse} | {within_two(refused)} |"


def table(paths: Sequence[str], trials: int, processes: int, *, is_felt: bool) -> Iterator[str]:
    """A row for each path."""
    yield HEAD
    with ProcessPoolExecutor(processes) as pool:
        for name in paths:
            yield row(
                name,
                list(pool.map(partial(tried, is_felt=is_felt), [(name, seed) for seed in range(trials)], chunksize=2)),
            )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=100, help="fits of each path")
    parser.add_argument("--paths", nargs="+", default=list(PATHS), choices=PATHS, metavar="PATH")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--felt", action="store_true", help="with an accelerometer")
    chosen = parser.parse_args(arguments)
    for line in table(chosen.paths, chosen.trials, chosen.processes, is_felt=chosen.felt):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
