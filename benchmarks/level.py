"""Level turns of a vehicle at a known site: true errors compared with claims.

    python -m benchmarks.level [--tables turn,aids,strength] [--trials 200]

turn      S7 and turns like it: 1,000 readings at 50 Hz, σ = 0.5 µT, dip 60°, sensors with soft iron whose mean gain is
                    1 ± 5 %. Heading error (rms over headings, directions of tilt and trials; less its mean while level)
                    at some tilts, the claim, their ratio by trial (rms), and the largest tilt within 1°.
aids      The same with an accelerometer and a gyro, by name and by ``auto``: the aids used, and the truth of claims.
strength  S4t with the site's strength and the gain known to 1 %: heading error as a share of that without.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.datasets import FIELD_STRENGTH, dataset, heading_error_deg
from benchmarks.terms import swayed, tilted_error_deg
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import FlindersError
from flinders.fitting.result import Refused
from flinders.likelihood.site_field import Site
from flinders.simulate.attitudes import rates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated

SEED: Final = 20240916
TILTS_DEG: Final = (0.0, 2.0, 5.0, 10.0)
RATE_HZ: Final = 50.0
GAIN_SIGMA: Final = 0.05


@dataclass(frozen=True, slots=True)
class Turned:
    """Turn of a vehicle.

    Attributes
    ----------
    arc_deg : float
    wobble_deg : float
        Roll and pitch during the turn, rms each.
    slope_deg : float
        Slope of the floor, in a random direction.
    mounted_deg : float
        Mounting errors about the sensor's x and y, 1 σ each.
    """

    arc_deg: float = 360.0
    wobble_deg: float = 0.0
    slope_deg: float = 0.0
    mounted_deg: float = 0.0

    def record(self, seed: int, n: int = 1000) -> tuple[Simulated, Site]:
        """Recording of the turn with accelerometer and gyro, and the site with the model's uncertainty.

        The true sensor's matrix includes the mounting, so it converts the field in the vehicle's axes.
        """
        rng = np.random.default_rng([SEED, seed])
        sensor = simulate.Sensor.random(rng, noise=0.5)
        matrix = 3.0 * sensor.matrix / np.trace(sensor.matrix) * (1.0 + GAIN_SIGMA * rng.normal())
        askew = simulate.turns(math.radians(self.mounted_deg) * rng.normal(size=(1, 3)) * [1.0, 1.0, 0.0])[0]
        sensor = replace(sensor, matrix=matrix @ askew)
        time = np.arange(n) / RATE_HZ
        attitudes = self._attitudes(rng, time)
        directions = simulate.in_body_axes(attitudes, simulate.north_and_down(60.0))
        rate = rates(attitudes, RATE_HZ) + rng.normal(0.0, 0.005, (n, 3)) + rng.normal(0.0, 0.01, 3)
        felt = simulate.specific_force(attitudes, rng)
        samples = Samples.of(
            sensor.read(FIELD_STRENGTH * directions, rng), unit="uT", time=time, acceleration=felt, rate=rate
        )
        strength, dip = FIELD_STRENGTH * (1.0 + rng.normal(0.0, 0.01)), 60.0 + rng.normal(0.0, 1.0)
        truth = simulate.Simulated(samples, sensor, directions, FIELD_STRENGTH, np.zeros(n, dtype=np.bool_))
        return truth, Site(strength, dip, GAIN_SIGMA, inclination_sigma_deg=1.0)

    def _attitudes(self, rng: np.random.Generator, time: Floats) -> Floats:
        """(N, 3, 3) attitudes: a turn, three sines of each of roll and pitch, and the slope."""
        turn = np.linspace(20.0, 20.0 + self.arc_deg, len(time), endpoint=False)
        pace, phase = rng.uniform(0.3, 1.2, (2, 3, 1)), rng.uniform(0.0, 2.0 * np.pi, (2, 3, 1))
        share = rng.normal(size=(2, 3, 1))
        share *= math.radians(self.wobble_deg) * math.sqrt(2.0) / np.linalg.norm(share, axis=1, keepdims=True)
        leans = np.sum(share * np.sin(2.0 * np.pi * pace * time + phase), axis=1).T
        level = simulate.turns(np.outer(np.radians(turn), [0.0, 0.0, 1.0]))
        side = rng.uniform(0.0, 2.0 * np.pi)
        slope = simulate.turns([np.radians(self.slope_deg) * np.array([np.cos(side), np.sin(side), 0.0])])
        attitudes: Floats = slope @ level @ simulate.turns(np.column_stack([leans, np.zeros(len(time))]))
        return attitudes


TURNS: Final = {
    "level, mounted to 2°": Turned(mounted_deg=2.0),
    "half a turn": Turned(arc_deg=180.0, mounted_deg=2.0),
    "three quarters": Turned(arc_deg=270.0, mounted_deg=2.0),
    "wobble 0.5°": Turned(wobble_deg=0.5, mounted_deg=2.0),
    "wobble 1°": Turned(wobble_deg=1.0, mounted_deg=2.0),
    "wobble 3°": Turned(wobble_deg=3.0, mounted_deg=2.0),
    "slope 2°": Turned(slope_deg=2.0, mounted_deg=2.0),
    "slope 5°": Turned(slope_deg=5.0, mounted_deg=2.0),
    "slope 10°": Turned(slope_deg=10.0, mounted_deg=2.0),
}

KNOWN_FACTS: Final = {"nothing": (False, None), "site": (True, None), "site, mounting to 2°": (True, 2.0)}
"""Known facts: whether the site, and the uncertainty of the mounting in degrees."""


def recorded(title: str, number: int) -> tuple[Simulated, Site]:
    """One recording; S7 has its own sensors, with an error of the mean gain of 8 % (rms)."""
    if title != "S7":
        return TURNS[title].record(number)
    rng = np.random.default_rng([SEED, 1, number])
    strength, dip = FIELD_STRENGTH * (1.0 + rng.normal(0.0, 0.01)), 60.0 + rng.normal(0.0, 1.0)
    return dataset("S7", number, 0.5), Site(strength, dip, gain_sigma=0.1, inclination_sigma_deg=1.0, z_down=True)


def tried(samples: Samples, **options: object) -> Fit | str:
    """Fit, or the code of the refusal."""
    try:
        return flinders.fit(samples, **options)  # type: ignore[arg-type]
    except Refused as refused:
        return refused.fit.findings[0].code
    except FlindersError as error:
        return error.code


def scored(found: Fit, truth: Simulated) -> tuple[list[float], list[float]]:
    """True and claimed heading errors at each tilt."""
    answer = found.calibration.offset, found.calibration.matrix
    claimed = [found.claim.tilted_error(tilt).rms for tilt in TILTS_DEG]
    return [tilted_error_deg(answer, truth, tilt) for tilt in TILTS_DEG], claimed


def row(scores: Sequence[tuple[list[float], list[float]]]) -> str:
    """Cells: true and claimed error, and their ratio, over all trials."""
    true, claimed = np.array([one for one, _ in scores]), np.array([one for _, one in scores])
    parts = _rms(true), _rms(claimed), _rms(true / claimed)
    return " | ".join(" / ".join(f"{value:.2g}" for value in part) for part in parts)


def turn_table(trials: int) -> Iterator[str]:
    """Yield the table of `level`, with known facts."""
    tilts = " / ".join(f"{tilt:g}" for tilt in TILTS_DEG)
    yield f"| turn | known | true at {tilts}° | claimed | ratio | usable to 1° | refused |"
    yield "|---|---|---|---|---|---:|---:|"
    for title in ("S7", *TURNS):
        for known, (at_site, mounting) in KNOWN_FACTS.items():
            scores, limits, refused = [], [], 0
            for number in range(trials):
                truth, site = recorded(title, number)
                known_site = replace(site if at_site else Site(), alignment_sigma_deg=mounting)
                found = tried(truth.samples, method="level", site=known_site)
                if isinstance(found, str):
                    refused += 1
                    continue
                scores.append(scored(found, truth))
                limits.append(found.claim.attitude_limit_deg)
            told = f"{row(scores)} | {np.median(limits):.1f}°" if scores else "| | |"
            yield f"| {title} | {known} | {told} | {refused} |"


def aids_table(trials: int) -> Iterator[str]:
    """Yield the table of `fit` on the same turns with accelerometer and gyro."""
    tilts = " / ".join(f"{tilt:g}" for tilt in TILTS_DEG)
    yield f"| turn | asked for | run | true at {tilts}° | claimed | ratio | largest ratio |"
    yield "|---|---|---|---|---|---|---:|"
    for title in TURNS:
        for aiding in (("dip",), "auto"):
            scores, run = [], Counter[str]()
            for number in range(trials):
                truth, site = TURNS[title].record(number)
                found = tried(truth.samples, aiding=aiding, site=site)
                run[found if isinstance(found, str) else found.evidence.method] += 1
                if not isinstance(found, str):
                    scores.append(scored(found, truth))
            told = ", ".join(f"{count} {name}" for name, count in run.most_common())
            largest = max((max(np.divide(true, claimed)) for true, claimed in scores), default=math.nan)
            asked = aiding if isinstance(aiding, str) else ", ".join(aiding)
            yield f"| {title} | {asked} | {told} | {row(scores) if scores else '| |'} | {largest:.1f} |"


def strength_table(trials: int) -> Iterator[str]:
    """Yield the table of the strength's effect on S4t."""
    yield "| known | level heading error, rms ° | of magnitude alone | true over claimed |"
    yield "|---|---:|---:|---:|"
    alone = math.nan
    for known, gain in {"nothing": 0.0, "strength ± 1 %, gain ± 1 %": 0.01, "strength ± 1 %, gain ± 5 %": 0.05}.items():
        true, claimed = [], []
        for number in range(trials):
            truth, samples, site = swayed(number)
            at = Site(site.strength, gain_sigma=gain) if gain else None
            found = tried(samples, site=at)
            if not isinstance(found, str):
                true.append(heading_error_deg(found.calibration.matrix, found.calibration.offset, truth))
                claimed.append(found.heading_error_deg.rms)
        error = float(_rms(np.array(true)))
        alone = error if math.isnan(alone) else alone
        ratio = float(_rms(np.divide(true, claimed)))
        yield f"| {known} | {error:.3f} | {error / alone:.2f} | {ratio:.2f} |"


def _rms(values: Floats) -> Floats:
    """Root mean square over the first axis."""
    root: Floats = np.sqrt(np.mean(values**2, axis=0))
    return root


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser("python -m benchmarks.level", description="Level turns at a known site.")
    parser.add_argument("--tables", type=lambda text: text.split(","), metavar="NAME,…", help="all by default")
    parser.add_argument("--trials", type=int, default=200)
    options = parser.parse_args(arguments)
    tables: dict[str, Callable[[], Iterator[str]]] = {
        "turn": partial(turn_table, options.trials),
        "aids": partial(aids_table, options.trials),
        "strength": partial(strength_table, options.trials),
    }
    unknown = [name for name in options.tables or tables if name not in tables]
    if unknown:
        sys.exit(f"no table {', '.join(unknown)}: there are {', '.join(tables)}")
    for name in options.tables or tables:
        print(f"\n## {name}\n")
        for line in tables[name]():
            print(line, flush=True)


if __name__ == "__main__":
    main()
