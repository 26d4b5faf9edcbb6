"""Accuracy of simple recipes in degrees: every method on the data sets and on real recordings, compared with `auto`.

    python -m benchmarks.recipes [--trials 40] [--sigma 0.5] [--methods auto,minmax] [--processes 2]

First table: true heading error of a level turn (rms over trials and headings, its mean removed) on the sets of
`benchmarks.datasets`, with the number of trials without a calibration in brackets; it includes the emulations without a
gyro (`benchmarks.emulations`). Second table: real recordings without a known truth: the cross-validated heading error
(rms, ten blocks of time), and in brackets the difference from the heading of `auto`. Recordings are searched as by
`benchmarks.recordings`. Angles of more than 90° count as undetermined.
"""

from __future__ import annotations

import argparse
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.datasets import dataset, heading_error_deg
from benchmarks.emulations import EMULATIONS
from benchmarks.recordings import FOLDER
from flinders.apps.classic.methods import compare_methods
from flinders.core.samples import Samples
from flinders.errors import FitError
from flinders.estimators import METHODS, Readings

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.apps.classic.methods import Entry
    from flinders.geometry.ellipsoid import Ellipsoid

SETS: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8")

RECORDINGS: Final = {
    "fxos8700": "michaelwro_fxos8700/mag-readings.txt",
    "icm20948": "jremington_icm20948/icm_20948_cal_mag.csv",
    "icm20948 b": "jremington_icm20948/mag3_raw.csv",
    "lis3mdl": "hightower70_magcal/mag.txt",
    "hmc5883l": "sunsided_hmc5883l/full-sphere.csv",
}
"""Five sensors, by name and file."""

EMULATED: Final = ("ladder", "forgetting")
"""Emulations that use the magnetometer alone."""

MAX_ANGLE_DEG: Final = 90.0
MIN_ANGLE_DEG: Final = 1e-3


def error_deg(method: str, name: str, sigma: float, trial: int) -> float:
    """Heading error of one trial; NaN without a result."""
    recording = dataset(name, trial, sigma)
    try:
        found = ellipsoid_by(method, Samples(recording.samples.field))
    except FitError:
        return math.nan
    return heading_error_deg(found.radius * np.linalg.inv(found.shape), found.centre, recording)


def ellipsoid_by(method: str, samples: Samples) -> Ellipsoid:
    """Ellipsoid by a method or an emulation.

    Raises
    ------
    FitError
        Without a result.
    """
    if method in EMULATIONS:
        return EMULATIONS[method](samples)
    return METHODS[method]().estimate(Readings.of(samples)).ellipsoid


def true_rows(methods: Sequence[str], sigma: float, trials: int, processes: int) -> Iterator[str]:
    """Yield the lines of the first table."""
    yield f"| method | {' | '.join(SETS)} |"
    yield "|---|" + "---:|" * len(SETS)
    with ProcessPoolExecutor(processes) as pool:
        for method in methods:
            cells = []
            for name in SETS:
                several = repeat(method), repeat(name), repeat(sigma), range(trials)
                cells.append(_rms(list(pool.map(error_deg, *several, chunksize=max(1, trials // (2 * processes))))))
            yield f"| `{method}` | {' | '.join(cells)} |"


def real_rows(methods: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the second table."""
    yield f"| method | {' | '.join(RECORDINGS)} |"
    yield "|---|" + "---:|" * len(RECORDINGS)
    columns = []
    for path in RECORDINGS.values():
        contest = compare_methods(flinders.read(FOLDER / path), methods=methods)
        columns.append({entry.method: _cell(entry) for entry in contest.entries})
    for method in methods:
        yield f"| `{method}` | {' | '.join(column[method] for column in columns)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser("python -m benchmarks.recipes", description="What simple recipes cost.")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--sigma", type=float, default=0.5)
    parser.add_argument("--methods", type=lambda text: text.split(","), default=[*METHODS, *EMULATED], metavar="NAME,…")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.methods if name not in (*METHODS, *EMULATED)]:
        sys.exit(f"no method {', '.join(unknown)}: there are {', '.join((*METHODS, *EMULATED))}")
    for line in true_rows(options.methods, options.sigma, options.trials, options.processes):
        print(line, flush=True)
    if not FOLDER.is_dir():
        sys.exit(f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them")
    print()
    for line in real_rows([name for name in options.methods if name in METHODS]):
        print(line, flush=True)


def _rms(errors: Sequence[float]) -> str:
    """Write the rms of finite errors, and the number of others."""
    found = [error for error in errors if not math.isnan(error)]
    if not found:
        return "none"
    missing = f" ({len(errors) - len(found)} of {len(errors)} none)" if len(found) < len(errors) else ""
    return f"{_angle(math.sqrt(float(np.mean(np.square(found)))))}{missing}"


def _cell(entry: Entry) -> str:
    """Write a cell of the second table."""
    if entry.fit is None:
        return "none"
    shown = "–" if entry.validation is None else _angle(entry.validation.heading_error_deg.rms)
    apart = "" if entry.difference_deg is None else f" ({_angle(entry.difference_deg.rms)})"
    return f"{shown}{apart}"


def _angle(angle: float) -> str:
    """Write an angle with two significant digits."""
    if angle > MAX_ANGLE_DEG:
        return "> 90°"
    if angle < MIN_ANGLE_DEG:
        return "0°"
    return f"{angle:.0f}°" if angle >= 9.95 else f"{angle:.1f}°" if angle >= 0.995 else f"{angle:.2g}°"


if __name__ == "__main__":
    main()
