"""Speed as ratios measured in one run, independent of the machine, and memory. Prints Markdown.

    python -m benchmarks.speed

A fit is compared with a minimal fit, which builds the N × 9 design in NumPy and solves the normal equations; and with
itself without its covariance for correlated residuals, its search for outliers and its verdict. Sums and summaries are
compared with ``D @ D.T`` of ten rows, built and multiplied in blocks of 8,192.
Times are medians of interleaved repeats, in processor time of one thread. Several short recordings are fitted in turn,
since the residuals of one in seven look correlated by chance, and the check of that takes 4 ms.
"""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from functools import partial
from itertools import cycle
from time import perf_counter, thread_time
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders.estimators import Readings
from flinders.estimators.likelihood import Likelihood
from flinders.simulate import tumble
from flinders.summary.moments import Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

BLOCK: Final = 8192
MILLION: Final = 1_000_000
RECORDINGS: Final = 9
FIT_LIMITS: Final[dict[int, float | None]] = {500: 8.0, 5_000: None, 50_000: 1.5, MILLION: 1.0}
JUDGED_LIMIT: Final = 1.5
MOMENTS_LIMIT: Final = 2.0
SUMMARY_LIMIT: Final = 5.0
MEMORY_LIMIT_MB: Final = 32.0
SIZES: Final = (100_000, MILLION, 4_000_000)
MEMORY_OPTION: Final = "--memory"


def normal_equations(field: Floats) -> Floats:
    """(9,) coefficients of the quadric of (N, 3) readings with constant −1, by normal equations."""
    x, y, z = field.T
    design = np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z])
    return np.linalg.solve(design.T @ design, design.sum(axis=0))


def ellipsoid_alone(field: Floats) -> object:
    """Ellipsoid of (N, 3) readings with its textbook covariance, without verdict."""
    return Likelihood(bias_correction=False).estimate(Readings.of(field))


def blocked_products(field: Floats) -> Floats:
    """(10, 10) products of ten monomials of (N, 3) readings, rows built and multiplied block by block."""
    products = np.zeros((10, 10))
    rows = np.empty((10, BLOCK))
    rows[0] = 1.0
    for start in range(0, len(field), BLOCK):
        block = field[start : start + BLOCK].T
        part = rows[:, : block.shape[1]]
        part[1:4] = block
        np.multiply(block, block, out=part[4:7])
        np.multiply(block[0], block[1:], out=part[7:9])
        np.multiply(block[1], block[2], out=part[9])
        products += part @ part.T
    return products


def interleaved(
    first: Callable[[], object],
    second: Callable[[], object],
    *,
    seconds: float = 3.0,
    clock: Callable[[], float] = perf_counter,
) -> tuple[float, float]:
    """Median durations in seconds of two alternating calls, each repeated at least seven times and for `seconds`."""
    first(), second()
    times: list[tuple[float, float]] = []
    end = perf_counter() + seconds
    while len(times) < 7 or (perf_counter() < end and len(times) < 1000):
        times.append((_timed(first, clock), _timed(second, clock)))
    one, other = np.median(times, axis=0).tolist()
    return one, other


def compared(
    label: str, ours: Callable[[Floats], object], plain: Callable[[Floats], object], n: int, limit: float | None
) -> str:
    """Row of the table: time of `ours` over that of `plain`, for recordings of n readings, with its limit."""
    fields = [readings(n, seed) for seed in range(RECORDINGS if n < MILLION else 1)]
    first, second = cycle(fields), cycle(fields)
    mine, other = interleaved(lambda: ours(next(first)), lambda: plain(next(second)), clock=thread_time)
    return f"| {label}, {n:,} readings | {mine * 1e3:.3g} ms | {other * 1e3:.3g} ms | {_judged(mine / other, limit)} |"


def readings(n: int, seed: int = 0) -> Floats:
    """(n, 3) readings in µT of a random sensor, in uniform directions."""
    return tumble(seed=seed, motion="uniform", n=n).samples.field


def ratios() -> None:
    """Print the table of ratios."""
    print("| what | Flinders | plain | ratio | limit |\n|---|---:|---:|---:|---:|")
    for n, limit in FIT_LIMITS.items():
        print(compared("`fit` ÷ normal equations", flinders.fit, normal_equations, n, limit), flush=True)
    for n, limit in ((500, None), (50_000, None), (MILLION, JUDGED_LIMIT)):
        print(compared("`fit` ÷ the ellipsoid alone", flinders.fit, ellipsoid_alone, n, limit), flush=True)
    for n in (50_000, MILLION):
        print(compared("`Moments.of` ÷ `D @ D.T`", Moments.of, blocked_products, n, MOMENTS_LIMIT), flush=True)
        print(compared("`Summary.of` ÷ `D @ D.T`", Summary.of, blocked_products, n, SUMMARY_LIMIT), flush=True)


def linearity() -> None:
    """Print the time per reading of long recordings."""
    print("\n| readings | `fit` | ns a reading |\n|---:|---:|---:|")
    for n in SIZES:
        field = readings(n)
        flinders.fit(field)
        seconds = float(np.median([_timed(partial(flinders.fit, field)) for _ in range(7)]))
        print(f"| {n:,} | {seconds * 1e3:.3g} ms | {seconds / n * 1e9:.3g} |", flush=True)


def memory() -> None:
    """Print the memory that a fit of a million readings needs in addition to the readings, from its own process."""
    command = [sys.executable, "-m", "benchmarks.speed", MEMORY_OPTION]
    extra = float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print("\n| extra memory at the peak | MB | limit |\n|---|---:|---:|")
    print(f"| `fit`, {MILLION:,} readings | {_judged(extra, MEMORY_LIMIT_MB)} |")


def extra_megabytes() -> float:
    """Peak memory in MB that NumPy and Python allocate during a fit of a million readings (by tracemalloc)."""
    field = readings(MILLION)
    flinders.fit(field[:1000])  # exclude one-time imports and caches
    tracemalloc.start()
    flinders.fit(field)
    return tracemalloc.get_traced_memory()[1] / 1e6


def main() -> None:
    """Print all tables."""
    if MEMORY_OPTION in sys.argv[1:]:
        print(extra_megabytes())
        return
    ratios()
    linearity()
    memory()


def _timed(call: Callable[[], object], clock: Callable[[], float] = thread_time) -> float:
    """Seconds of one call, by a clock."""
    begin = clock()
    call()
    return clock() - begin


def _judged(value: float, limit: float | None) -> str:
    """A number with its limit, in bold if it is beyond the limit."""
    if limit is None:
        return f"{value:.2f} | –"
    return f"{value:.2f} | {limit:g}" if value <= limit else f"**{value:.2f}** | {limit:g}"


if __name__ == "__main__":
    main()
