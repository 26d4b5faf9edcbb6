"""Whether the answers of ``flinders check`` are true: holds, fails or cannot tell. Prints Markdown.

    python -m benchmarks.answers [--trials 200] [--processes 2]

A sensor is calibrated from a tumble of a minute. Offset and soft iron of the calibration are then changed until the
worst level heading error has a known size, and the calibration is checked on a recording of the row. The recordings
have 0.5 µT of white noise, and every second one as much noise with a memory of one to four seconds. Every second
calibration states no uncertainty, like an imported one. The target is 1°.

Changed calibrations have errors of 0.5° to 2°; valid ones have errors of 0° to 0.9°, half of them 0°. An answer is
wrong if it is *holds* beyond the target, or *fails* within it. The last column has the median 95 % bound of the
difference for the answer *cannot tell*, and the bound that would have been small enough for a decision.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders import simulate
from flinders.comparison.comparison import compare
from flinders.errors import FlindersError
from flinders.fitting.result import Fit, bare_fit, with_calibration
from flinders.geometry.ellipsoid import symmetric_matrix

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flinders.core.calibration import Calibration
    from flinders.native.faults import Answer
    from flinders.simulate import GaussMarkov, Sensor, Simulated

TARGET_DEG: Final = 1.0
DIP_DEG: Final = 60.0

Recipe = dict[str, "str | int | float"]

RECORDINGS: Final[dict[str, Recipe]] = {
    "full tumble, 1 min": {"motion": "hand"},
    "figures of eight, 1 min": {"motion": "eight"},
    "thin turns, 10 s": {"motion": "hand", "n": 500},
    "leaning by 35°, 1 min": {"motion": "swayed"},
    "flight, 5 min": {"motion": "flight", "rate_hz": 10.0},
    "flight, 1 min": {"motion": "flight", "n": 600, "rate_hz": 10.0},
    "drive, 5 min": {"motion": "drive", "rate_hz": 10.0},
    "level turn": {"motion": "level"},
}
"""Arguments of `flinders.simulate.tumble` for each row."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A check, with the true error of the calibration and the answer."""

    row: str
    off_deg: float
    answer: Answer
    bound_deg: float = math.nan  #: 95 % bound of the difference
    telling_deg: float = math.nan  #: bound with which the answer would have been a decision

    @property
    def is_wrong(self) -> bool:
        """Whether the answer is *holds* beyond the target, or *fails* within it."""
        return self.answer == ("holds" if self.off_deg > TARGET_DEG else "fails")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="Whether checks answer truly.")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    for title, off_deg in CASES.items():
        with ProcessPoolExecutor(options.processes) as pool:
            trials = list(pool.map(off_deg, range(options.trials), chunksize=4))
        print("\n".join([f"\n{title}\n", *table(trials)]))


def is_off(seed: int) -> Trial:
    """Check a calibration with an error of half the target to twice the target."""
    return checked(seed, np.random.default_rng([1, seed]).uniform(0.5, 2.0) * TARGET_DEG)


def holds(seed: int) -> Trial:
    """Check an unchanged calibration, or one with an error below nine tenths of the target."""
    return checked(10_000 + seed, seed % 4 // 2 * np.random.default_rng([2, seed]).uniform(0.0, 0.9) * TARGET_DEG)


CASES: Final[dict[str, Callable[[int], Trial]]] = {"Off by 0.5° to 2°": is_off, "Off by 0° to 0.9°": holds}


def checked(seed: int, off_deg: float) -> Trial:
    """Calibrate a sensor, change the calibration, and check it on another recording."""
    rng = np.random.default_rng([3, seed])
    row = list(RECORDINGS)[seed % len(RECORDINGS)]
    sensor = simulate.Sensor.random(rng)
    known = moved(flinders.fit(simulate.tumble(rng, sensor=sensor).samples), sensor, off_deg, rng)
    if rng.random() < 0.5:
        known = bare_fit(known.calibration)
    recorded = recording(row, sensor, rng)
    try:
        found = flinders.check(recorded.samples, known, target_deg=TARGET_DEG)
    except FlindersError:
        return Trial(row, off_deg, "cannot-tell")
    if found.comparison is None:
        return Trial(row, off_deg, found.answer)
    bound, telling = found.comparison.claimed_bound_deg, found.comparison.telling_bound_deg
    return Trial(row, off_deg, found.answer, bound or 0.0, math.nan if telling is None else telling)


def recording(row: str, sensor: Sensor, rng: np.random.Generator) -> Simulated:
    """Recording for a row; every second one has slow noise."""
    lasting: list[GaussMarkov] = []
    if rng.random() < 0.5:
        lasting.append(simulate.GaussMarkov(sigma=0.5, seconds=rng.uniform(1.0, 4.0)))
    return simulate.tumble(rng, sensor=sensor, dip_deg=DIP_DEG, disturbances=lasting, **RECORDINGS[row])  # type: ignore[arg-type]


def moved(fit: Fit, sensor: Sensor, off_deg: float, rng: np.random.Generator) -> Fit:
    """Calibration that is changed at random until it has a given error; for 0, the true calibration."""
    matrix, offset = sensor.correction
    true = fit.calibration
    truth = replace(true, matrix=matrix * (true.field_strength / 50.0), offset=offset)
    way = rng.normal(size=9) * [1.0, 1.0, 1.0, *rng.uniform(0.0, 1.0) * np.ones(6)]

    def by(size: float) -> Calibration:
        ellipsoid = truth.ellipsoid
        return truth.from_ellipsoid(
            ellipsoid.centre + size * way[:3], ellipsoid.shape + size * symmetric_matrix(way[3:]), raw=true.raw
        )

    low, high = 0.0, 0.05
    while apart_deg(by(high), truth) < off_deg:
        high *= 2.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if apart_deg(by(middle), truth) < off_deg else (low, middle)
    return with_calibration(fit, by(low))


def apart_deg(one: Calibration, other: Calibration) -> float:
    """Largest difference of level headings in degrees."""
    return compare(bare_fit(one), bare_fit(other), dip_deg=DIP_DEG).heading_difference_deg.worst


def table(trials: Sequence[Trial]) -> Iterator[str]:
    """Yield the answers for each kind of recording, and for all."""
    yield "| recording | holds | wrongly | fails | wrongly | cannot tell | its claim / that would tell |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    for row in RECORDINGS:
        yield line(row, [trial for trial in trials if trial.row == row])
    yield line("**all**", trials)


def line(title: str, trials: Sequence[Trial]) -> str:
    """Row of the answers of some trials."""
    count = Counter(trial.answer for trial in trials)
    wrong = Counter(trial.answer for trial in trials if trial.is_wrong)
    vague = [one for one in trials if one.answer == "cannot-tell" and math.isfinite(one.telling_deg)]
    claims = "–"
    if vague:
        medians = (np.median([getattr(one, of) for one in vague]) for of in ("bound_deg", "telling_deg"))
        claims = " / ".join(f"{median:.2f}°" for median in medians)
    cells = count["holds"], wrong["holds"], count["fails"], wrong["fails"], count["cannot-tell"], claims
    return f"| {title} | {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
