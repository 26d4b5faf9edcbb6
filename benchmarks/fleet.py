"""Cost of calibrating a fleet in Parquet, compared with reading it, and with other fits unit by unit.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.fleet [--units 20000] [--curve 1000 5000 20000] [--faulty | --field]

Units are those of `flinders.apps.fleet.simulate`, all good unless ``--faulty`` makes three per cent faulty. A thousand
are simulated, and the others are copies with another offset, to save time. Each file has a column ``unit``, a time and
three axes in single precision, in one row group. *read* loads all of that into NumPy, in double precision, on one core;
*engine* also computes a record of each unit. Each job has its own process. Ratios to reading are those of CPU seconds
on one core, and of time on all cores less the start of the workers. Further tables have other fits unit by unit, the
cost of a partition in the process that started the run, and the cost of a whole run by the number of units. Prints
Markdown.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

import flinders
from flinders.apps.fleet.checkpoint import Checkpoint
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.results import UnitResults
from flinders.apps.fleet.scheduler import cores
from flinders.apps.fleet.simulate import BAD_SHARE, FIELD_UT, Specimen, fleet
from flinders.errors import FlindersError
from flinders.estimators import METHODS, Readings
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.native.engine import engine
from flinders.simulate import GaussMarkov, ThermalDrift, angle_error_deg, tumble

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.simulate import Simulated

UNITS, READINGS_PER_UNIT, FILES = 20_000, 500, 100
"""Units, readings per unit and files of the fleet for ratios, ten million readings in all."""
UNITS_PER_FILE: Final = 200
"""Units per file for other numbers of units."""
FIELD_READINGS: Final = (1_000, 20_000)
"""Range of the number of readings of a unit in the field."""
POOL, FIELD_POOL = 1_000, 200
"""Number of simulated units."""
APART_UT: Final = 0.5
"""Difference of the offsets of copies of a unit along x, in whole steps of the sensor."""
CURVE: Final = (1_000, 5_000, 20_000)
PEER_UNITS: Final = 100
"""Units to fit by other methods."""
LIMIT, FIELD_LIMIT = 6.0, 10.0
"""Limits of the ratio of times to reading, for simulated units, and for units with realistic noise."""
PEER_LIMIT: Final = 30.0
MEMORY_LIMIT_MB: Final = 1_000.0
JOBS: Final = ("read", "engine", "fit")
PART_ROWS, PARTS = 100, 1_000
"""Rows of a part, as for units of ten thousand readings, and number of parts to write."""


def field_unit(number: int, *, seed: int = 0) -> Specimen:
    """Unit as recorded in the field by hand, with realistic noise.

    20 s to 7 min of turning at 50 Hz, 0.5 µT of noise, partly with a time constant of one second, one reading in a
    hundred near something magnetic, and a sensor with a thermometer that warms up by 15 K with a small effect.
    """
    rng = np.random.default_rng([seed, number, 1])
    least, most = np.log(FIELD_READINGS)
    made = tumble(
        rng,
        motion="hand",
        n=int(np.exp(rng.uniform(least, most))),
        field_strength=rng.uniform(*FIELD_UT),
        noise=0.4,
        outliers=0.01,
        disturbances=[GaussMarkov(0.3, seconds=1.0), ThermalDrift(0.002)],
    )
    samples = replace(made.samples, source=f"unit {number:07d}")
    return Specimen(number, samples, made.sensor, made.field_strength)


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a job.

    Attributes
    ----------
    cpu_s : float, s
        CPU time of the process and its workers.
    wall_s : float, s
    rss_mb : float
        Peak memory of the process, plus that of the largest worker times the number of workers.
    """

    cpu_s: float
    wall_s: float
    rss_mb: float


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description="What calibrating a fleet costs.")
    parser.add_argument("--units", type=int, default=UNITS)
    parser.add_argument("--each", type=int, default=READINGS_PER_UNIT, help="readings of a unit")
    parser.add_argument("--curve", type=int, nargs="*", default=CURVE, help="numbers of units")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--faulty", action="store_true", help="three per cent of the units are faulty")
    parser.add_argument("--field", action="store_true", help="units as people record them: see `field_unit`")
    parser.add_argument("--job", choices=JOBS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    parser.add_argument("--workers", type=int, default=0, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.job:
        print(json.dumps(_job(given.job, given.folder, given.workers)))
        return
    share = BAD_SHARE if given.faulty else 0.0
    pool = list(fleet(min(POOL, given.units), seed=1, bad=share, readings=given.each))
    if given.field:
        pool = [field_unit(number, seed=1) for number in range(min(FIELD_POOL, given.units))]
    with tempfile.TemporaryDirectory() as made:
        whole = Path(made) / "whole"
        size = write(whole, pool, given.units, files=max(1, given.units * FILES // UNITS))
        readings = sum(len(numbered(pool, number).samples) for number in range(given.units))
        print(f"{given.units:,} units, {readings:,} readings, {size / 1e6:.1f} MB in Parquet\n")
        costs = {job: _median([measured(job, whole, workers=0) for _ in range(given.repeats)]) for job in JOBS}
        spread = _median([measured("fit", whole) for _ in range(given.repeats)])
        write(Path(made) / "one", pool, 1, files=1)
        start_s = _median([measured("fit", Path(made) / "one") for _ in range(given.repeats)]).wall_s
        beside_reading(costs, spread, start_s, given.units, FIELD_LIMIT if given.field else LIMIT)
        beside_peers(pool, whole, costs, given.units)
        of_parts(Path(made) / "parts", whole)
        print("\n| units | MB | reading, s | fits, s | µs a unit | peak memory, MB |")
        print("|---:|---:|---:|---:|---:|---:|", flush=True)
        for units in given.curve:
            curve(Path(made) / f"fleet{units}", pool, units)


def write(folder: Path, pool: Sequence[Specimen], units: int, *, files: int) -> int:
    """Write a fleet into Parquet files, and return how many bytes they have."""
    import pyarrow as arrow
    from pyarrow import parquet

    folder.mkdir()
    for place, numbers in enumerate(np.array_split(np.arange(units), files)):
        some = [numbered(pool, int(number)) for number in numbers]
        counts = [len(unit.samples) for unit in some]
        rows = np.repeat(np.arange(len(some), dtype=np.int32), counts)
        field = np.concatenate([unit.samples.field for unit in some]).astype(np.float32)
        names = arrow.DictionaryArray.from_arrays(rows, [unit.name for unit in some])
        time = np.concatenate([cast("Floats", unit.samples.time) for unit in some])
        columns = {"unit": names, "t_s": time, **{f"mag_{axis}_uT": field[:, i] for i, axis in enumerate("xyz")}}
        if all(unit.samples.temperature is not None for unit in some):
            columns["temperature_C"] = np.concatenate([cast("Floats", unit.samples.temperature) for unit in some])
        parquet.write_table(arrow.table(columns), folder / f"part-{place:05}.parquet")
    return sum(path.stat().st_size for path in folder.iterdir())


def numbered(pool: Sequence[Specimen], number: int) -> Specimen:
    """Unit of a fleet of any size: one of the pool, with its offset moved along x at each repetition."""
    unit = pool[number % len(pool)]
    shift = np.array([APART_UT * (number // len(pool) % 64), 0.0, 0.0])
    samples = replace(unit.samples, field=unit.samples.field + shift)
    sensor = replace(unit.sensor, offset=unit.sensor.offset + shift)
    return replace(unit, number=number, samples=samples, sensor=sensor)


def into_numpy(path: Path) -> tuple[Floats, ...]:
    """Unit numbers, times and (N, 3) readings of one file."""
    from pyarrow import parquet

    table = parquet.read_table(path, use_threads=False, read_dictionary=["unit"])
    whose = table.column("unit").combine_chunks().indices.to_numpy()
    time, *axes = (table.column(name).to_numpy() for name in ("t_s", "mag_x_uT", "mag_y_uT", "mag_z_uT"))
    return whose, time, np.stack(axes, axis=1, dtype=np.float64)


def measured(job: str, folder: Path, *, workers: int | None = None) -> Cost:
    """Run a job in its own process; on all cores, or with some `workers`, 0 for that process alone."""
    count = cores() if workers is None else workers
    command = [sys.executable, "-m", "benchmarks.fleet", "--job", job, "--folder", str(folder), "--workers", str(count)]
    return Cost(**json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))


def beside_reading(costs: dict[str, Cost], spread: Cost, start_s: float, units: int, limit: float) -> None:
    """Print ratios to reading on one core: CPU time on one core, and time on all cores less their start."""
    print(f"Starting the workers, with a table of one unit, took {start_s:.2f} s.\n")
    print("| job | CPU, s | µs a unit | ÷ reading | all cores, s | less start ÷ reading | limit | peak memory, MB |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for job, cost in costs.items():
        alone = f"{job} | {cost.cpu_s:.3g} | {cost.cpu_s / units * 1e6:.3g} | {cost.cpu_s / costs['read'].cpu_s:.3g}"
        if job != "fit":
            print(f"| {alone} | – | – | – | {cost.rss_mb:.0f} |", flush=True)
            continue
        ratio = (spread.wall_s - start_s) / costs["read"].wall_s
        together = f"{spread.wall_s:.3g} | {_judged(ratio, limit)} | {spread.rss_mb:.0f}"
        print(f"| {alone} | {together} |", flush=True)


def beside_peers(pool: Sequence[Specimen], folder: Path, costs: dict[str, Cost], units: int) -> None:
    """Print cost and accuracy of other fits, unit by unit, and of the fleet per unit."""
    some = [numbered(pool, number) for number in range(min(PEER_UNITS, len(pool)))]
    ours = costs["fit"].cpu_s / units
    print("\n| unit by unit | ms a unit | ÷ the fleet | error, ° rms | failed |\n|---|---:|---:|---:|---:|")
    for label, peer in PEERS.items():
        begin = process_time()
        found = [_tried(peer, unit.samples.field) for unit in some]
        each = (process_time() - begin) / len(some)
        print(f"| {label} | {each * 1e3:.3g} | {each / ours:.3g} | {_accuracy(found, some)} |", flush=True)
    print(f"| the fleet | {ours * 1e3:.3g} | 1 | {_accuracy(_calibrated(folder, some), some)} |", flush=True)


def of_parts(folder: Path, whole: Path) -> None:
    """Print the cost of writing and removing a part."""
    out = folder.with_suffix(".parquet")
    run(str(whole / "part-00000.parquet"), out, Options(), workers=0)
    content = UnitResults.read(out)[:PART_ROWS].to_bytes()
    folder.mkdir()
    parts = Checkpoint(folder)
    begin = perf_counter()
    for place in range(PARTS):
        parts.commit(place, content)
    written = perf_counter()
    parts.remove()
    each, away = ((end - start) / PARTS * 1e3 for start, end in ((begin, written), (written, perf_counter())))
    print(
        f"\nA part of {PART_ROWS} rows, {len(content) / 1e3:.0f} kB: {each:.2g} ms to write, {away:.2g} ms to remove."
    )


def curve(folder: Path, pool: Sequence[Specimen], units: int) -> None:
    """Print a row of the cost of a whole run on all cores, for a number of units."""
    size = write(folder, pool, units, files=max(1, units // UNITS_PER_FILE))
    read, fits = measured("read", folder, workers=0), measured("fit", folder)
    for path in folder.iterdir():
        path.unlink()
    memory = _judged(fits.rss_mb, MEMORY_LIMIT_MB).split(" |")[0]
    each = fits.wall_s / units * 1e6
    print(
        f"| {units:,} | {size / 1e6:.1f} | {read.wall_s:.3g} | {fits.wall_s:.3g} | {each:.3g} | {memory} |", flush=True
    )


def plain_ellipsoid(field: Floats) -> Ellipsoid:
    """Ellipsoid of the most copied script: nine coefficients by least squares, those of x², y², z² with sum three."""
    origin, scale = field.mean(axis=0), float(field.std())
    x, y, z = ((field - origin) / scale).T
    columns = [x * x + y * y - 2 * z * z, x * x + z * z - 2 * y * y, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z, x**0]
    u = np.linalg.lstsq(np.stack(columns, axis=1), x * x + y * y + z * z, rcond=None)[0]
    form = [u[0] + u[1] - 1.0, u[0] - 2.0 * u[1] - 1.0, u[1] - 2.0 * u[0] - 1.0]
    return Ellipsoid.from_quadric(np.array([*form, *u[2:]]), method="plain").in_frame(origin, scale)


def by_magnitude(field: Floats) -> Ellipsoid:
    """``|W(x − b)| = 1`` by SciPy's Levenberg–Marquardt, as in magcc, ArduPilot and MicroStrain."""
    from scipy.optimize import least_squares

    origin, scale = field.mean(axis=0), float(field.std()) * 3.0**0.5

    def residuals(unknown: Floats) -> Floats:
        local = (field - origin) / scale - unknown[:3]
        lengths: Floats = np.linalg.norm(local @ symmetric_matrix(unknown[3:]), axis=1) - 1.0
        return lengths

    unknown = least_squares(residuals, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], method="lm").x
    return Ellipsoid(origin + scale * unknown[:3], scale * np.linalg.inv(symmetric_matrix(unknown[3:])))


def by_distance(field: Floats) -> Ellipsoid:
    """Sampson distances by SciPy, from the plain ellipsoid: maximum likelihood, to first order."""
    from scipy.optimize import least_squares

    start = plain_ellipsoid(field)
    entries = start.shape.ravel()[[0, 4, 8, 1, 2, 5]]

    def residuals(unknown: Floats) -> Floats:
        inverse = np.linalg.inv(symmetric_matrix(unknown[3:]))
        y = (field - unknown[:3]) @ inverse
        lengths = np.linalg.norm(y, axis=1)
        distances: Floats = (lengths - 1.0) * lengths / np.linalg.norm(y @ inverse, axis=1)
        return distances

    unknown = least_squares(residuals, np.concatenate([start.centre, entries]), method="lm").x
    return Ellipsoid(unknown[:3], symmetric_matrix(unknown[3:]))


def li(field: Floats) -> Ellipsoid:
    """Li and Griffiths' fit, of Magneto and many scripts, in the implementation of `flinders`."""
    return METHODS["li"]().estimate(Readings.of(field)).ellipsoid


def by_flinders(field: Floats) -> Ellipsoid:
    """`flinders.fit`, one unit after the other."""
    return flinders.fit(field).calibration.ellipsoid


PEERS: Final[dict[str, Callable[[Floats], Ellipsoid]]] = {
    "plain least squares, NumPy": plain_ellipsoid,
    "Li and Griffiths, as in Magneto": li,
    "field strength, SciPy, as in magcc": by_magnitude,
    "distances, SciPy: maximum likelihood": by_distance,
    "`flinders.fit`, with uncertainty and verdict": by_flinders,
}


def _job(job: str, folder: str, workers: int) -> dict[str, float]:
    """Run a job in this process and return its cost, without imports but with the start of workers."""
    paths = sorted(Path(folder).iterdir())
    _do(job, str(paths[0]), paths[:1], 0)
    begin, cpu = perf_counter(), _cpu_s()
    _do(job, folder, paths, workers)
    others = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    memory = (_peak_kb() + workers * others) / 1024.0
    return {"cpu_s": _cpu_s() - cpu, "wall_s": perf_counter() - begin, "rss_mb": memory}


def _peak_kb() -> int:
    """Peak memory of this process, kB; ``ru_maxrss`` may be that of its parent."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0])


def _do(job: str, where: str, paths: Sequence[Path], workers: int) -> None:
    """Run a job: read files, run the engine alone, or calibrate all units."""
    if job == "read":
        for path in paths:
            into_numpy(path)
        return
    if job == "engine":
        for path in paths:
            whose, time, field = into_numpy(path)
            begins = np.flatnonzero(np.diff(whose, prepend=-1, append=-1))
            engine().fit_many(field, begins, time=time)
        return
    with tempfile.TemporaryDirectory() as made:
        run(where, Path(made) / "out.parquet", Options(), workers=workers)


def _cpu_s() -> float:
    """CPU seconds of this process and of its ended workers."""
    some = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in some)


def _calibrated(folder: Path, some: Sequence[Specimen]) -> list[Ellipsoid | None]:
    """Ellipsoids of some units from the fleet's table."""
    with tempfile.TemporaryDirectory() as made:
        out = Path(made) / "out.parquet"
        run(str(folder / "part-00000.parquet"), out, Options(), workers=0)
        rows = UnitResults.read(out)
    known = dict(zip(rows.unit.tolist(), zip(rows.offset, rows.matrix, strict=True), strict=True))
    return [_ellipsoid(*known[unit.name]) if unit.name in known else None for unit in some]


def _ellipsoid(offset: Floats, matrix: Floats) -> Ellipsoid | None:
    return None if np.isnan(offset).any() else Ellipsoid(offset, np.linalg.inv(matrix.reshape(3, 3)))


def _tried(peer: Callable[[Floats], Ellipsoid], field: Floats) -> Ellipsoid | None:
    try:
        return peer(field)
    except (FlindersError, np.linalg.LinAlgError):
        return None


def _accuracy(found: Sequence[Ellipsoid | None], some: Sequence[Specimen]) -> str:
    """Cells: root mean square angle error over units, and number of units without a result."""
    errors = [
        angle_error_deg(np.linalg.inv(ellipsoid.shape), ellipsoid.centre, cast("Simulated", unit))
        for ellipsoid, unit in zip(found, some, strict=False)
        if ellipsoid is not None
    ]
    missing = sum(ellipsoid is None for ellipsoid in found)
    return f"{np.sqrt(np.mean(np.square(errors))):.3g} | {missing}"


def _median(costs: Sequence[Cost]) -> Cost:
    """Median of each number."""
    values = np.median([(cost.cpu_s, cost.wall_s, cost.rss_mb) for cost in costs], axis=0).tolist()
    return Cost(*cast("tuple[Any, Any, Any]", tuple(values)))


def _judged(value: float, limit: float | None) -> str:
    """Write a number with its limit, in bold if beyond."""
    if limit is None:
        return f"{value:.3g} | –"
    return f"{value:.3g} | {limit:g}" if value <= limit else f"**{value:.3g}** | {limit:g}"


if __name__ == "__main__":
    main()
