"""Cost of the core per reading, compared with a lower bound. Prints Markdown.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.kernel

The lower bound is ``D @ D.T`` of ten rows, built and multiplied in blocks of 8,192 over the same readings, as any
quadric fit needs it. It is compared with the sums of one long recording, of many short ones, and with whole summaries.
Further tables have the stages of a fit and the readers, in microseconds a reading.

Times are medians of interleaved repeats, in CPU seconds of this process.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.readers import write_csv
from benchmarks.speed import MILLION, blocked_products, readings
from flinders.estimators import Readings
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.heading.error_propagation import level_error
from flinders.simulate import tumble
from flinders.summary.cloud import Cloud
from flinders.summary.coverage import Coverage
from flinders.summary.moments import Moments
from flinders.summary.quality import DataQuality
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

LIMIT: Final = 1.5
"""Limit of the ratio of the sums to ``D @ D.T``."""
UNITS, READINGS_PER_UNIT = 2_000, 500
"""Number and length of the short recordings, a million readings in all."""
STAGE_READINGS: Final = (500, 3_000, 30_000, 300_000)
"""Readings of the fits whose stages are timed."""
MIN_REPEATS: Final = 9
"""Least repeats of each call."""
SECONDS: Final = 3.0
"""Duration of all repeats of a row, s, unless these would be too few."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One row of the first table.

    Attributes
    ----------
    label : str
    ours, least : callable
    readings : int
        Number of readings that both process.
    limit : float or None
        Limit of their ratio.
    """

    label: str
    ours: Callable[[], object]
    least: Callable[[], object]
    readings: int
    limit: float | None = None

    def row(self) -> str:
        """Measure, and write the row."""
        ours, least = medians([self.ours, self.least])
        ratio = f"{ours / least:.2f}"
        judged = ratio if self.limit is None or ours <= self.limit * least else f"**{ratio}**"
        allowed = "–" if self.limit is None else f"{self.limit:g}"
        each = [f"{seconds / self.readings * 1e9:.1f}" for seconds in (ours, least)]
        return f"| {self.label} | {self.readings:,} | {each[0]} | {each[1]} | {judged} | {allowed} |"


def medians(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Median CPU seconds of each of some calls, made in turn."""
    for call in calls:
        call()
    rounds: list[list[float]] = []
    end = process_time() + SECONDS
    while len(rounds) < MIN_REPEATS or (process_time() < end and len(rounds) < 1000):
        rounds.append([_timed(call) for call in calls])
    found: list[float] = np.median(rounds, axis=0).tolist()
    return found


def kernels() -> None:
    """Print sums and summaries compared with ``D @ D.T``."""
    print("| what ÷ `D @ D.T` | readings | ns a reading | `D @ D.T` | ratio | limit |\n|---|---:|---:|---:|---:|---:|")
    for count in (50_000, MILLION):
        field = readings(count)
        least = partial(blocked_products, field)
        print(Compared("`Moments.of`", partial(Moments.of, field), least, count, LIMIT).row(), flush=True)
        print(Compared("`Summary.of`", partial(Summary.of, field), least, count).row(), flush=True)
    short = readings(UNITS * READINGS_PER_UNIT).reshape(UNITS, READINGS_PER_UNIT, 3)
    least = partial(blocked_products, short.reshape(-1, 3))
    rows: list[tuple[str, Callable[[], object], float | None]] = [
        ("`Moments.of` one by one", partial(_one_by_one, Moments.of, short), None),
        ("`Summary.of` one by one", partial(_one_by_one, Summary.of, short), None),
    ]
    for label, ours, limit in rows:
        print(
            Compared(f"{UNITS:,} × {READINGS_PER_UNIT}, {label}", ours, least, UNITS * READINGS_PER_UNIT, limit).row(),
            flush=True,
        )


def stages() -> None:
    """Print the cost of each stage of a fit, in microseconds a reading."""
    tables = [_stages_of(count) for count in STAGE_READINGS]
    print("\n| stage, µs a reading | " + " | ".join(f"{count:,}" for count in STAGE_READINGS) + " |")
    print("|---|" + "---:|" * len(STAGE_READINGS))
    for name in tables[0]:
        cells = (f"{table[name] / count * 1e6:.3g}" for table, count in zip(tables, STAGE_READINGS, strict=True))
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def readers() -> None:
    """Print the cost of readers, in microseconds a reading, compared with pyarrow's reader into NumPy."""
    from pyarrow import csv, parquet

    print("\n| reading, µs a reading | Flinders | pyarrow into NumPy | ratio |\n|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as made:
        text, table = Path(made) / "million.csv", Path(made) / "million.parquet"
        write_csv(text)
        parquet.write_table(csv.read_csv(text), table)
        for label, path, plain in (("CSV", text, csv.read_csv), ("Parquet", table, parquet.read_table)):
            ours, theirs = medians([partial(flinders.read, path), partial(_columns, plain, path)])
            cells = " | ".join(f"{seconds / MILLION * 1e6:.3g}" for seconds in (ours, theirs))
            print(f"| {label}, {path.stat().st_size / 1e6:.1f} MB | {cells} | {ours / theirs:.2f} |", flush=True)


def main() -> None:
    """Print all tables."""
    kernels()
    stages()
    readers()


def _stages_of(count: int) -> Mapping[str, float]:
    """CPU seconds of the stages of a fit of some readings of a tumble by hand."""
    samples: Samples = tumble(seed=count, n=count).samples
    held = Readings.of(samples)
    found = Likelihood().estimate(held)
    ellipsoid = found.ellipsoid
    calls: dict[str, Callable[[], object]] = {
        "`fit`, all of it": partial(flinders.fit, samples),
        "moments": partial(Moments.of, samples.field),
        "cloud": partial(Cloud.of, samples.field, time=samples.time),
        "health": partial(DataQuality.of, samples),
        "summary, the three together": partial(Summary.of, samples),
        "consistent start": partial(Consistent().estimate, held),
        "likelihood with its start and correlation": partial(Likelihood().estimate, held),
        "coverage": partial(Coverage.of_cloud, held.summary.cloud, ellipsoid),
        "heading error": partial(level_error, ellipsoid, found.covariance),
    }
    return dict(zip(calls, medians(list(calls.values())), strict=True))


def _one_by_one(call: Callable[[Floats], object], clouds: Floats) -> None:
    for cloud in clouds:
        call(cloud)


def _columns(plain: Callable[[Path], object], path: Path) -> list[Floats]:
    """Columns of an Arrow table as NumPy arrays."""
    return [column.to_numpy() for column in plain(path).columns]  # type: ignore[attr-defined]


def _timed(call: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    begin = process_time()
    call()
    return process_time() - begin


if __name__ == "__main__":
    main()
