"""Results of `flinders drift` on histories of `flinders watch`: rates of random walks, and steps. Prints Markdown.

    python -m benchmarks.walks [--units 12] [--days 2 10] [--processes 2]

Each unit is tumbled for half a minute every 30 to 60 min, and its offset has a random walk; one in twelve has four
times the rate, and one in six a step of 3 µT. Calibrations are `flinders.OnlineCalibration`, in a field of 50 µT with a
noise of 0.3 µT. *Found* is the median rate over the true one, *within* the share of units with the rate in its 95 %
interval, *interval* the median ratio of the interval's ends.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tests.worlds import walked_days

from flinders import OnlineCalibration
from flinders.apps.fleet.walks import walks_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.fleet.walks import UnitWalk

WALKS = (0.02, 0.1, 0.4)  # µT in an hour, of 50 µT
STEP = np.array([2.0, -2.0, 1.0])


@dataclass(frozen=True)
class Unit:
    """A unit with its truth."""

    number: int
    days: float
    walk: float

    @property
    def is_faster(self) -> bool:
        """Whether its rate is four times the usual."""
        return self.number % 12 == 5

    @property
    def has_step(self) -> bool:
        """Whether its offset has a step after half of the time."""
        return self.number % 6 == 2

    @property
    def true_walk(self) -> float:
        """True walk in one hour, µT."""
        return 4.0 * self.walk if self.is_faster else self.walk


def write(unit: Unit, folder: str) -> None:
    """Simulate the unit, and save the state of its online calibration in the folder."""
    time, field, *_ = walked_days(1000 + unit.number, days=unit.days, walk=unit.true_walk)
    if unit.has_step:
        field[time > unit.days * 43200.0] += STEP
    online = OnlineCalibration()
    online.add(field, time=time)
    online.save(Path(folder) / f"U{unit.number:03d}.state")


def row(units: Sequence[Unit], pool: ProcessPoolExecutor) -> str:
    """Row of the table: one fleet of units with the same walk and duration."""
    found: list[UnitWalk] = []
    with tempfile.TemporaryDirectory() as folder:
        list(pool.map(write, units, [folder] * len(units)))
        fleet = walks_of([folder], each=found.extend)
    known = [(unit, one) for unit, one in zip(units, found, strict=True) if one.state != "short"]
    ratios = [one.walk / unit.true_walk for unit, one in known]
    within = np.mean([one.walk_low < unit.true_walk < one.walk_high for unit, one in known])
    width = np.median([one.walk_high / one.walk_low for _, one in known])
    stepped = {step.unit for step in fleet.steps}
    steps = [unit for unit in units if unit.has_step]
    fast = [one.unit for unit, one in known if unit.is_faster and one.state == "faster"]
    wrong = sum(one.state == "faster" and not unit.is_faster for unit, one in known)
    seen = sum(f"U{unit.number:03d}" in stepped for unit in steps)
    faster = sum(unit.is_faster for unit in units)
    return (
        f"| {units[0].walk:g} | {units[0].days:g} | {len(known)} of {len(units)} | {np.median(ratios):.2f} | "
        f"{within:.0%} | {width:.2f} | {seen} of {len(steps)} | {len(stepped) - seen} | "
        f"{len(fast)} of {faster} | {wrong} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=12)
    parser.add_argument("--days", type=float, nargs="+", default=[2.0, 10.0])
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    print("| walk, µT | days | told | found | within | interval | steps found | false | faster found | false |")
    print("|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    with ProcessPoolExecutor(options.processes) as pool:
        for walk, days in product(WALKS, options.days):
            print(row([Unit(number, days, walk) for number in range(options.units)], pool), flush=True)


if __name__ == "__main__":
    main()
