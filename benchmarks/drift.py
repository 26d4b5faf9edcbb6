"""Detection rates and false alarms of `flinders drift` for fleets with drifts and steps of offsets.

Fleets are simulated as tables of `flinders fleet`: true offsets and shapes of each unit over two years, and estimates
whose errors are as large as stated, or twice as large. The row of a fleet has the share of units with a step that were
found, and the number of units without a step that were reported. Then it has the share found of the units whose true
heading changes by more than 1.5° from the first recording to the last, and the number of reported units, at a target of
1°, whose true change is smaller.

    python -m benchmarks.drift                 # the table of docs/fleet/drift.md, a few minutes
    python -m benchmarks.drift --quick         # small fleets
    python -m benchmarks.drift --alarms        # of 200 small fleets in which nothing changed
    python -m benchmarks.drift --recordings    # readings simulated and fitted, 300 units of 4 recordings
    python -m benchmarks.drift --size          # a million rows in five tables: seconds, memory and size of the report
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders import simulate
from flinders.apps.fleet.change_points import YEAR_S
from flinders.apps.fleet.drift import drift_of
from flinders.apps.fleet.results import UnitResult, UnitResults, objects

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.apps.fleet.overview import FleetDrift, UnitDrift
    from flinders.arrays import Floats

FIELD: Final = 48.0
ENTRIES: Final = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))


@dataclass(frozen=True, slots=True)
class Fleet:
    """Parameters of a simulated fleet.

    Attributes
    ----------
    units, recordings : int
        Number of units, and number of recordings of each unit, at random times of two years.
    sigma : float, µT
        Standard deviation of each of the nine parameters of a recording; its logarithm varies by 0.3 (1 σ) between
        recordings.
    claimed : float
        Ratio of the claimed to the true standard deviation.
    walk : float
        Random walk of the offset, as a fraction of the field per root second.
    trend_deg : float
        Heading change in two years by the steady drift that one unit in ten has.
    step_deg : float
        Heading change by the step that one unit in thirty-three has.
    is_dated : bool
        Whether clocks show the date. Otherwise times count from power-on, and recordings are named ``run 0``, ``run 1``
        …
    """

    units: int = 5_000
    recordings: int = 5
    sigma: float = 0.05
    claimed: float = 1.0
    walk: float = 2e-7
    trend_deg: float = 0.0
    step_deg: float = 0.0
    is_dated: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Truth about (U,) units: whether there is a step, and the true change of the heading in degrees."""

    has_step: NDArray[np.bool_]
    change_deg: Floats


def simulated(fleet: Fleet, rng: np.random.Generator) -> tuple[UnitResults, Truth]:
    """Simulate the table of a fleet; returned with the truth."""
    U, n = fleet.units, fleet.recordings
    seconds = np.sort(rng.uniform(0.0, 2.0 * YEAR_S, (U, n)), axis=1)
    gaps = np.diff(seconds, axis=1, prepend=seconds[:, :1])
    offset = rng.normal(size=(U, 1, 3)) * 20.0
    walk = np.cumsum(rng.normal(size=(U, n, 3)) * fleet.walk * np.sqrt(gaps)[:, :, np.newaxis], axis=1)
    has_step, after = rng.random(U) < 0.03, rng.integers(0, max(n - 1, 1), U)
    has_trend = (rng.random(U) < 0.1) & ~has_step
    behind = (np.arange(n) > after[:, np.newaxis]) & has_step[:, np.newaxis]
    horizontal = FIELD * np.cos(np.deg2rad(60.0)) * np.pi / 180.0  # µT across the field in a degree of heading
    offset = offset + FIELD * walk
    offset = offset + fleet.step_deg * horizontal * behind[:, :, np.newaxis] * _level(U, rng)
    slope = fleet.trend_deg * horizontal * has_trend[:, np.newaxis] * seconds / (2.0 * YEAR_S)
    offset = offset + slope[:, :, np.newaxis] * _level(U, rng)
    soft = rng.normal(size=(U, 3, 3)) * 0.03
    shape = FIELD * (np.eye(3) + (soft + np.swapaxes(soft, 1, 2)) / 2.0)
    rows = _table(fleet, rng, offset.reshape(-1, 3), np.repeat(shape, n, axis=0), seconds.ravel())
    across = np.linalg.norm((offset[:, -1] - offset[:, 0])[:, :2], axis=1) / horizontal
    return rows, Truth(has_step & (fleet.step_deg > 0.0), across)


def _level(units: int, rng: np.random.Generator) -> Floats:
    """(U, 1, 3) random horizontal unit vectors; a vertical step would not change level headings."""
    angle = rng.uniform(0.0, 2.0 * np.pi, units)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(units)], axis=1)[:, np.newaxis]


def _table(fleet: Fleet, rng: np.random.Generator, offset: Floats, shape: Floats, seconds: Floats) -> UnitResults:
    """Table of estimates with errors, and with the uncertainties that are stated."""
    rows = len(offset)
    sigma = fleet.sigma * np.exp(0.3 * rng.normal(size=rows))
    errors = rng.normal(size=(rows, 9)) * sigma[:, np.newaxis]
    shape = shape.copy()
    shape[:, *ENTRIES] += errors[:, 3:]
    shape[:, ENTRIES[1], ENTRIES[0]] = shape[:, *ENTRIES]
    radius = np.cbrt(np.linalg.det(shape))
    covariance = np.zeros((rows, 45))
    covariance[:, np.equal(*np.triu_indices(9))] = ((fleet.claimed * sigma) ** 2)[:, np.newaxis]
    unit = np.repeat([f"U{place:07d}" for place in range(fleet.units)], fleet.recordings)

    def texts(word: str) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
        return objects([word] * rows)

    none = np.full(rows, np.nan)
    start, names = 1.7e9 + seconds, [""] * rows
    if not fleet.is_dated:
        start = rng.uniform(0.0, 3600.0, rows)
        names = [f"run {number}" for number in range(fleet.recordings)] * fleet.units
    return UnitResults(
        unit=objects(unit.tolist()), recording=objects(names), start_s=start, end_s=none,
        readings=np.full(rows, 500), samples=np.full(rows, 500), verdict=texts("good"), code=texts(""),
        cause=texts(""), message=texts(""), number=none, limit=none, method=texts("likelihood"),
        worst_deg=none, rms_deg=none, bound_95_deg=none,
        dip_deg=np.full(rows, 60.0),
        offset=offset + errors[:, :3], matrix=(radius[:, None, None] * np.linalg.inv(shape)).reshape(-1, 9),
        covariance=covariance, noise=none, field_strength=radius, coverage=none, findings=objects([()] * rows),
        unit_of_field=texts("uT"), batch=texts(""),
    )  # fmt: skip


def found_in(rows: UnitResults, *, most: int = 1000) -> tuple[FleetDrift, list[UnitDrift]]:
    """Write a table, and return the changes that are found in it."""
    from pyarrow import parquet

    units: list[UnitDrift] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "fleet.parquet")
        parquet.write_table(rows.to_arrow(), path)
        return drift_of([path], most=most, each=units.extend), units


def line(name: str, fleet: Fleet, seed: int = 1) -> str:
    """One row of the table: detected changes, and false alarms."""
    rows, truth = simulated(fleet, np.random.default_rng(seed))
    drift, units = found_in(rows, most=fleet.units)

    def named(places: NDArray[np.bool_]) -> set[str]:
        return {f"U{place:07d}" for place in np.flatnonzero(places).tolist()}

    stepped, far, near = named(truth.has_step), named(truth.change_deg > 1.5), named(truth.change_deg < 1.0)
    reported = {step.unit for step in drift.steps}
    urgent = {unit.unit for unit in units if unit.state == "recalibrate"}
    steps = f"{len(reported & stepped) / len(stepped):.3f}" if stepped else "–"
    recall = f"{len(urgent & far) / len(far):.3f}" if far else "–"
    return (
        f"| {name} | {fleet.recordings} | {steps} | {len(reported - stepped)} | {recall} | {len(urgent & near)} | "
        f"{(drift.variance_factor if fleet.is_dated else drift.undated.variance_factor) ** 0.5:.2f} | "
        f"{f'{drift.random_walk_deg_per_root_year:.2f}°' if fleet.is_dated else '–'} |"
    )


def fleets(units: int) -> dict[str, Fleet]:
    """The fleets of docs/fleet/drift.md."""
    plain = Fleet(units=units)
    return {
        "nothing moved": plain,
        "nothing moved, two recordings": replace(plain, recordings=2),
        "nothing moved, twenty recordings": replace(plain, recordings=20, units=units // 4),
        "nothing moved, claims half of what is true": replace(plain, claimed=0.5),
        "all walk by 1° a year": replace(plain, walk=1.55e-6),
        "a tenth drifts steadily by 3°": replace(plain, trend_deg=3.0),
        "steps of 1°": replace(plain, step_deg=1.0),
        "steps of 2°": replace(plain, step_deg=2.0),
        "steps of 5°": replace(plain, step_deg=5.0),
        "steps of 2°, two recordings": replace(plain, step_deg=2.0, recordings=2),
        "steps of 2°, three recordings": replace(plain, step_deg=2.0, recordings=3),
        "steps of 2°, twenty recordings": replace(plain, step_deg=2.0, recordings=20, units=units // 4),
        "steps of 2°, claims half of what is true": replace(plain, step_deg=2.0, claimed=0.5),
        "steps of 5°, all walk by 1° a year": replace(plain, step_deg=5.0, walk=1.55e-6),
        "steps of 2°, a tenth drifts by 3°": replace(plain, step_deg=2.0, trend_deg=3.0),
        "no dates, nothing moved": replace(plain, is_dated=False),
        "no dates, nothing moved, claims half of what is true": replace(plain, is_dated=False, claimed=0.5),
        "no dates, all walk by 1° a year": replace(plain, is_dated=False, walk=1.55e-6),
        "no dates, a tenth drifts steadily by 3°": replace(plain, is_dated=False, trend_deg=3.0),
        "no dates, steps of 2°": replace(plain, is_dated=False, step_deg=2.0),
    }


def of_recordings(units: int = 300, count: int = 4, seed: int = 1) -> str:
    """Result for simulated readings that `flinders.fit` fits; the offset of one sensor in ten steps by 2 µT."""
    rng = np.random.default_rng(seed)
    rows, stepped = [], set()
    for place in range(units):
        sensor = simulate.Sensor.random(rng)
        if has_step := place % 10 == 0:
            stepped.add(f"U{place:05d}")
        for number in range(count):
            moved = np.array([2.0, 0.0, 0.0]) * (has_step and number >= 2)
            read = simulate.tumble(
                seed=count * place + number, n=500, sensor=replace(sensor, offset=sensor.offset + moved)
            )
            start = 1.7e9 + 30.0 * 86400.0 * number
            rows.append(
                UnitResult(unit=f"U{place:05d}", start_s=start, readings=500).with_fit(flinders.fit(read.samples))
            )
    drift, found = found_in(UnitResults.of(rows))
    reported, urgent = {step.unit for step in drift.steps}, {one.unit for one in found if one.state == "recalibrate"}
    return (
        f"{units} units of {count} recordings, {len(stepped)} with a step of 2 µT: found {len(reported & stepped)}, "
        f"beside them {len(reported - stepped)}; to recalibrate {len(urgent & stepped)}, beside them "
        f"{len(urgent - stepped)}; claims are to be widened {drift.variance_factor**0.5:.2f} times"
    )


def of_nothing(fleets: int = 200, units: int = 200, *, is_dated: bool = True) -> str:
    """Number of fleets for which changes are reported, among fleets in which nothing changes."""
    stepped = changed = 0
    for seed in range(fleets):
        rows, _ = simulated(Fleet(units=units, walk=0.0, is_dated=is_dated), np.random.default_rng(1000 + seed))
        drift, _ = found_in(rows)
        stepped += drift.step_count > 0
        changed += drift.states["recalibrate"] + drift.states["changed"] > 0
    told = "" if is_dated else " and no dates are known"
    return (
        f"of {fleets} fleets of {units} units in which nothing changed{told}, {stepped} have a step and {changed} a "
        "change"
    )


def of_size(units: int = 200_000, tables: int = 5) -> str:
    """Time, memory and size of the report for a large fleet, with one table for each recording."""
    with tempfile.TemporaryDirectory() as folder:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:  # so that this process stays small
            paths = pool.submit(written, Fleet(units, tables, step_deg=2.0), folder).result()
        report = Path(folder, "drift.html")
        command = [sys.executable, "-m", "flinders", "drift", *paths, "--report", str(report), "--json"]
        run = subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
        _, run.returncode, used = os.wait4(run.pid, 0)
        return (
            f"{units * tables:,} rows of {units:,} units in {tables} tables: {used.ru_utime + used.ru_stime:.0f} s of "
            f"one core, {used.ru_maxrss / 1e6:.2f} GB, a report of {report.stat().st_size / 1e6:.2f} MB"
        )


def written(fleet: Fleet, folder: str) -> list[str]:
    """Write a fleet as one table for each recording."""
    from pyarrow import parquet

    rows, _ = simulated(fleet, np.random.default_rng(1))
    paths = [f"{folder}/{number}.parquet" for number in range(fleet.recordings)]
    for number, path in enumerate(paths):
        parquet.write_table(rows[np.arange(number, len(rows), fleet.recordings)].to_arrow(), path)
    return paths


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--recordings", action="store_true")
    parser.add_argument("--alarms", action="store_true")
    parser.add_argument("--size", action="store_true")
    asked = parser.parse_args()
    began = time.perf_counter()
    if asked.recordings:
        print(of_recordings())
    elif asked.size:
        print(of_size())
    elif asked.alarms:
        print(of_nothing())
        print(of_nothing(is_dated=False))
    else:
        print("| fleet | recordings | steps found | false steps | changes found | false changes | widened | a year |")
        print("|---|---:|---:|---:|---:|---:|---:|---:|")
        for name, fleet in fleets(500 if asked.quick else 5_000).items():
            print(line(name, fleet), flush=True)
    print(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
