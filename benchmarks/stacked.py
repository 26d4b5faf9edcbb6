"""What the fast lane of `flinders.stacked` costs a unit, stage by stage, and how well it agrees with `flinders.fit`.

    python -m benchmarks.stacked                         # the cost, for two kinds of motion
    python -m benchmarks.stacked --agreement 2000        # and each of so many units fitted alone beside it
    python -m benchmarks.stacked --leaving 100           # what units take that leave the lane, so many of each fault

Times are of one core; set OPENBLAS_NUM_THREADS=1. The last lines give them in units of reading the same readings from a
Parquet file into NumPy in the same run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.core.units import Unit
from flinders.fitting import calibrate
from flinders.fitting.result import Refused
from flinders.simulate.fleet import unit as specimen
from flinders.stacked import Stack, fit_stack, lane
from flinders.stacked.algebra import in_segments, symmetric, with_ones
from flinders.stacked.consistent import consistent
from flinders.stacked.hung import BatchResiduals, autocorrelated
from flinders.stacked.judge import BatchQuality, errors_facing
from flinders.stacked.lane import UPPER
from flinders.stacked.likelihood import likelihood
from flinders.stacked.sums import BatchMoments
from flinders.stacked.surfaces import EllipsoidBatch, of_units, products_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.stacked.algebra import Array

READINGS = 500
TRIES = 5


def readings_of(units: int, *, by_hand: bool) -> Floats:
    """(U, N, 3) readings of units that were turned through random directions, or along a path."""
    rng = np.random.default_rng(1)
    turned = rng.normal(size=(units, READINGS, 4))
    if by_hand:
        turned = np.cumsum(0.1 * turned, axis=1) + rng.normal(size=(units, 1, 4))
    w, x, y, z = np.moveaxis(turned / np.linalg.norm(turned, axis=2, keepdims=True), 2, 0)
    directions = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=2)
    shapes: Floats = 50.0 * symmetric(np.array([1.0, 1, 1, 0, 0, 0]) + rng.normal(scale=0.05, size=(units, 6)))
    return directions @ shapes + rng.uniform(-40, 40, (units, 1, 3)) + rng.normal(scale=0.4, size=directions.shape)


def least(function: Callable[[], object]) -> float:
    """Shortest processor time of a few tries, in s: another process on the same core only adds to it."""
    found = []
    for _ in range(TRIES):
        begin = time.process_time()
        function()
        found.append(time.process_time() - begin)
    return min(found)


def stages(stack: Stack) -> dict[str, float]:
    """Seconds of each stage, over all units."""
    x, counts = with_ones(stack.readings), stack.counts
    sums = BatchMoments.of(x)
    start = consistent(sums)
    found = likelihood(x, None, sums, start)
    surfaces, some = found.ellipsoids, of_units(x, None, found.at)[0]
    left = BatchResiduals.of(some, None, counts[found.at], surfaces)
    counted = _placed(some, counts[found.at], surfaces, left)[0]
    return {
        "sums": least(lambda: BatchMoments.of(x)),
        "health": least(lambda: BatchQuality.of(x, None, counts)),
        "consistent": least(lambda: consistent(BatchMoments(sums.values, sums.unit))),
        "likelihood": least(lambda: likelihood(x, None, sums, start)),
        "one pass of it": least(
            lambda: in_segments(products_at, x, None, start.ellipsoids.centre, start.ellipsoids.inverse)
        ),
        "residuals": least(lambda: BatchResiduals.of(some, None, counts[found.at], surfaces)),
        "correlation": least(lambda: autocorrelated(some, None, counts[found.at], surfaces, left)),
        "coverage, strays": least(lambda: _placed(some, counts[found.at], surfaces, left)),
        "heading error": least(lambda: errors_facing(surfaces, found.covariance, counted, 60.0)),
        "all of the lane": least(lambda: lane.through(stack, target_deg=1.0, dip_deg=60.0)),
        "all, without polish": least(lambda: lane.through(stack, target_deg=1.0, dip_deg=60.0, polish=False)),
    }


def _placed(readings: Floats, counts: Array, surfaces: EllipsoidBatch, left: BatchResiduals) -> tuple[Floats, ...]:
    """Coverage and strays."""
    found: tuple[Floats, ...] = in_segments(
        lane.placed, readings, counts, surfaces.centre, surfaces.inverse, surfaces.radius, left.distances
    )
    return found


def from_parquet(field: Floats) -> float:
    """Seconds that reading the same from a Parquet file into NumPy takes."""
    import pyarrow
    from pyarrow import parquet

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "units.parquet"
        flat = field.reshape(-1, 3)
        unit = np.repeat(np.arange(len(field)), READINGS)
        columns = {"unit": unit, **{name: flat[:, axis] for axis, name in enumerate("xyz")}}
        parquet.write_table(pyarrow.table(columns), path)
        return least(lambda: [column.to_numpy() for column in parquet.read_table(path, use_threads=False).columns])


def agreement(stack: Stack, units: int) -> str:
    """Largest departure from `flinders.fit` over so many units."""
    found = fit_stack(stack)
    worst = {"offset": 0.0, "matrix": 0.0, "covariance": 0.0, "worst_deg": 0.0}
    unlike = 0
    for place in np.flatnonzero(found.through)[:units].tolist():
        try:
            fit = calibrate.fit(stack[place])
        except Refused as error:
            fit = error.fit
        unlike += found.findings[place] != tuple(finding.code for finding in fit.findings)
        expected: dict[str, Any] = {
            "offset": fit.calibration.offset, "matrix": fit.calibration.matrix.ravel(),
            "covariance": fit.covariance.ravel()[UPPER], "worst_deg": fit.heading_error_deg.worst,
        }  # fmt: skip
        for name, numbers in expected.items():
            scale = fit.calibration.field_strength if name == "offset" else np.abs(numbers).max()
            worst[name] = max(worst[name], float(np.abs(getattr(found, name)[place] - numbers).max() / scale))
    told = ", ".join(f"{name} {number:.0e}" for name, number in worst.items())
    return f"{int(found.through.sum())} of {len(stack)} through; {told}; {unlike} with unlike findings"


def leaving(units: int) -> None:
    """Print what units with a fault take, most of which are fitted by themselves."""
    print("| 500 readings, and | through the lane | median ms a unit | largest |")
    print("|---|---:|---:|---:|")
    for fault in ("", "spikes", "thermal-drift", "level-turn", "no-rotation"):
        made = [specimen(place, fault=fault).samples for place in range(units)]
        whole = fit_stack(made)
        took = []
        for one in made:
            begin = time.process_time()
            fit_stack([one])
            took.append(1e3 * (time.process_time() - begin))
        print(f"| {fault or 'no fault'} | {whole.through.mean():.0%} | {np.median(took):.2g} | {max(took):.2g} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=512)
    parser.add_argument("--agreement", type=int, default=0, metavar="UNITS")
    parser.add_argument("--leaving", type=int, default=0, metavar="UNITS")
    asked = parser.parse_args()
    if asked.leaving:
        leaving(asked.leaving)
        return
    for name, by_hand in (("random directions", False), ("along a path", True)):
        field = readings_of(asked.units, by_hand=by_hand)
        stack = Stack.cut(field.reshape(-1, 3), np.full(asked.units, READINGS), unit=Unit.of("uT"))
        found = stages(stack)
        print(f"\n{name}: {asked.units} units of {READINGS} readings, µs a unit")
        for stage, seconds in found.items():
            print(f"  {stage:20s} {1e6 * seconds / asked.units:7.1f}")
        read = from_parquet(field)
        print(f"  {'reading Parquet':20s} {1e6 * read / asked.units:7.1f}")
        for stage in ("all of the lane", "all, without polish"):
            print(f"  {stage}: {found[stage] / read:.1f} × reading, one core")
        if asked.agreement:
            print(f"  {agreement(stack, asked.agreement)}")


if __name__ == "__main__":
    main()
