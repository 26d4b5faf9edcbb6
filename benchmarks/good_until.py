"""Share of calibrations within twice their claim at the stated time of validity.

    python -m benchmarks.good_until [--units 300]

Simulated units have an offset with a random walk, its rate drawn from the usual distribution, and a claim of 0.05° to
1°. *By what is usual* is the time for the median of the usual rates, *its early end* that for their fast end; *by its
history* is that for the walk estimated from 40 offsets of the unit, four hours apart. Units count if their heading
error is within the bound of 95 % of twice the claim at that time: expected are 95 of 100.

Real pairs are recordings of one board, with calibrations made within a day, and six days apart. *Within* states whether
the largest difference of their headings is within the bound of 95 % of twice the first claim and the second.
"""

from __future__ import annotations

import argparse
import math
from itertools import permutations
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.recordings import FOLDER
from flinders.comparison.comparison import compare
from flinders.core.offset_walk import HOUR_S, PRIOR_WALK, Walk
from flinders.core.samples import Samples
from flinders.errors import FitError
from flinders.fitting.good_until import GoodUntil, good_until
from flinders.fitting.result import Refused
from flinders.workflows.walk import walk_of

if TYPE_CHECKING:
    from flinders.fitting.result import Fit

FIELD_UT, LEVEL_UT = 50.0, 25.0
BOUND: Final = 1.96
RATES: Final = ((0.0003, 0.0006, 0.0012, 0.0025, 0.005, 0.01, 0.02), (0.05, 0.1, 0.2, 0.25, 0.2, 0.15, 0.05))
"""Usual rates as a share of the field in an hour, and their probabilities, as in ``knowledge.c``."""
ESTIMATES, EVERY_H = 40, 4.0
BOARDS: Final = {
    "JHEF411, one session": ("CalCareful_2282320", "calTest1_198_253_-9", "calTest1_208_249_-2",
                             "calTest1_215_253_0", "calTest1_222_240_-8"),
    "apex5, one day": ("20231014_apex5_mag_on_tpu_02", "20231014_apex5_mag_gyro"),
}  # fmt: skip
LATER_PAIR: Final = ("20231008_apex5_mag_gyro_dedup", "20231014_apex5_mag_on_tpu_02", 6.0)
"""Two recordings of one board, and the days between them."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=300)
    print("| time stated | units | within twice the claim |\n|---|---:|---:|")
    for (stated_by, units), share in simulated(parser.parse_args().units).items():
        print(f"| {stated_by} | {units} | {share:.0%} |")
    print("\n| pairs | number | hours stated, median | within twice the claim |\n|---|---:|---:|---:|")
    for name, recordings in BOARDS.items():
        pairs = list(permutations([fit for each in recordings if (fit := fitted(each)) is not None], 2))
        hours = np.median([stated(first).seconds / HOUR_S for first, _ in pairs])
        print(f"| {name} | {len(pairs)} | {hours:.2g} | {np.mean([is_within(*pair) for pair in pairs]):.0%} |")
    print(six_days())


def simulated(units: int) -> dict[tuple[str, int], float]:
    """Share of units within twice their claim at the stated time."""
    rng = np.random.default_rng(1)
    hits: dict[str, list[bool]] = {"by what is usual": [], "its early end": [], "by its history": []}
    for _ in range(units):
        rate = FIELD_UT * float(rng.choice(RATES[0], p=RATES[1]))
        claim_deg = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
        usual = until_of(claim_deg, PRIOR_WALK.scale_rate(FIELD_UT))
        times = {"by what is usual": usual.seconds, "its early end": usual.earliest_s}
        if (known := history(rng, rate)) is not None:
            times["by its history"] = until_of(claim_deg, known).seconds
        for name, seconds in times.items():
            moved = math.degrees(rate * math.sqrt(seconds / HOUR_S) / LEVEL_UT)
            off = rng.normal(0.0, math.hypot(claim_deg, moved))
            hits[name].append(abs(off) < BOUND * 2.0 * claim_deg)
    return {(name, len(each)): float(np.mean(each)) for name, each in hits.items()}


def until_of(claim_deg: float, walk: Walk) -> GoodUntil:
    """Time at which a claim doubles by a walk."""
    return GoodUntil(claim_deg, LEVEL_UT, walk, "prior", None, "prior")


def history(rng: np.random.Generator, rate: float) -> Walk | None:
    """Walk from estimates of an offset over a week, each with 1 σ of 0.1 µT."""
    hours = EVERY_H * np.arange(ESTIMATES)
    truth = np.cumsum(rng.normal(0.0, rate * math.sqrt(EVERY_H), (ESTIMATES, 3)), axis=0)
    return walk_of(HOUR_S * hours, truth + rng.normal(0.0, 0.1, truth.shape), np.full(truth.shape, 0.1))


def fitted(name: str) -> Fit | None:
    """Fit of a recording; None without one."""
    (path,) = (FOLDER / "pichim_betaflight").glob(f"{name}.*")
    try:
        samples = flinders.read(path, columns=None if path.suffix == ".csv" else "1,2,3")
        return flinders.fit(Samples.of(samples.field, time=samples.time))
    except Refused as refused:
        return refused.fit
    except FitError:
        return None


def stated(fit: Fit) -> GoodUntil:
    """Time at which the claim of a fit doubles."""
    until = good_until(fit)
    assert until is not None
    return until


def is_within(first: Fit, second: Fit) -> bool:
    """Whether the headings of two calibrations agree within the bound of twice the first claim and the second."""
    apart = compare(first, second).heading_difference_deg.worst
    claims = (2.0 * first.heading_error_deg.worst, second.heading_error_deg.worst)
    return bool(apart < BOUND * math.hypot(*claims))


def six_days() -> str:
    """Sentence on the difference of two calibrations of one board, and the older one's claim by then."""
    earlier, later, days = LATER_PAIR
    first, second = fitted(earlier), fitted(later)
    if first is None or second is None:
        return f"\n{earlier}: no calibration"
    apart, until = compare(first, second).heading_difference_deg.worst, good_until(first)
    if until is None:
        return f"\n{earlier}, {days:g} days before {later}: refused; {apart:.2g}° apart"
    ends = (until.claim_deg_after(days * 86400.0, rate) for rate in (until.walk.low, until.walk.rate, until.walk.high))
    grown = " / ".join(f"{each:.2g}°" for each in ends)
    return f"\n{earlier}, {days:g} days before {later}: {apart:.2g}° apart; claim {until.claim_deg:.2g}°, then {grown}"


if __name__ == "__main__":
    main()
