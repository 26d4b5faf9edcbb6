"""Results of `flinders.fit` as a table of numbers, and a comparison of two tables, to check a refactoring.

    python -m benchmarks.fits OLD.jsonl                   # with the code as it was: about two minutes of two cores
    python -m benchmarks.fits NEW.jsonl                   # with the code as it is
    python -m benchmarks.fits --compare OLD.jsonl NEW.jsonl

The table has a line for each fit: every recording of `benchmarks.recordings.FOLDER` by `auto` and `likelihood`, those
of up to 5,000 readings and 200 simulated ones by all methods. With ``--aiding`` it has the fits with gyro,
accelerometer, currents and temperatures, and those of several magnetometers, instead.

Two tables agree if offset, matrix and covariance are equal within 1 % of a standard deviation, heading errors and noise
within 1 %, and verdict and findings exactly. ``benchmarks/fits.toml`` lists expected differences with reasons: a method
that moved, a finding that was renamed. To see the effect of a change, write the first table in a checkout of the commit
before it (``git worktree add``).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from benchmarks.datasets import SETS, dataset
from benchmarks.recordings import FOLDER
from flinders import simulate
from flinders.errors import FitError, FlindersError
from flinders.estimators import METHODS
from flinders.simulate import Perturbation, Sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike

    from flinders import Fit, Samples
    from flinders.arrays import Floats

Row = dict[str, Any]
"""Result of one fit: numbers, lists of numbers, and words."""

DIFFERENCES: Final = Path(__file__).with_suffix(".toml")
MAX_SHORT_READINGS: Final = 5_000
"""Most readings of a real recording to fit by all methods."""
TOLERANCE: Final = 0.01
"""Share of a standard deviation, or of the number."""
ROUNDING: Final = 1e-9
"""Share of the field strength, for parameters that a method fixes, with a standard deviation of 0."""

TRIALS: Final = 10
SIGMA: Final = 0.5
WORLDS: Final[dict[str, Callable[[int], simulate.Simulated]]] = {
    "hand": lambda seed: simulate.tumble(seed=seed, n=1500),
    "figures of eight": lambda seed: simulate.tumble(seed=seed, motion="eight", n=1000),
    "level turn": lambda seed: simulate.tumble(seed=seed, motion="level", n=800),
    "banked turns": lambda seed: simulate.tumble(seed=seed, motion="flight", n=1500),
    "drive": lambda seed: simulate.tumble(seed=seed, motion="drive", n=1500),
    "outliers": lambda seed: simulate.tumble(seed=seed, n=1000, outliers=0.02),
    "step": lambda seed: simulate.tumble(seed=seed, n=1000, disturbances=[simulate.Step(4.0, at=0.7)]),
    "passing magnet": lambda seed: simulate.tumble(seed=seed, n=1000, disturbances=[simulate.PassingMagnet(100.0)]),
    "motor": lambda seed: simulate.tumble(seed=seed, n=1500, disturbances=[simulate.MotorCurrent(0.2)]),
}
"""Simulations in addition to the data sets S1 … S8."""
AIDED_WORLDS: Final = ("hand", "swayed", "flight", "drive", "rocked")
AIDING: Final[tuple[tuple[str, ...], ...]] = (("auto",), ("dip",), ("rate",), ("rate", "dip"))


def simulated() -> Iterator[tuple[str, int]]:
    """Names and seeds of the simulated recordings."""
    yield from ((name, seed) for name in (*SETS, *WORLDS) for seed in range(TRIALS))


def simulation(name: str, seed: int) -> Samples:
    """Return one of these recordings."""
    if name in SETS:
        return dataset(name, trial=seed, sigma=SIGMA).samples
    return WORLDS[name](seed).samples


def recordings() -> list[str]:
    """Names below the folder of files that can be read without further options."""
    names = []
    for path in sorted(path for path in FOLDER.rglob("*") if path.is_file() and path.suffix != ".md"):
        try:
            flinders.read(path)
        except FlindersError:
            continue
        names.append(str(path.relative_to(FOLDER)))
    return names


def numbers_of(fit: Fit) -> Row:
    """Result of a fit without its sentences."""
    error, textbook = fit.heading_error_deg, fit.claim.textbook_heading_error_deg
    return {
        "verdict": fit.verdict,
        "used": fit.evidence.method,
        "samples": fit.evidence.samples,
        "offset": fit.calibration.offset.tolist(),
        "matrix": fit.calibration.matrix.tolist(),
        "covariance": fit.claim.covariance.tolist(),
        "field_strength": fit.calibration.field_strength,
        "noise": fit.evidence.noise,
        "heading_rms_deg": error.rms,
        "heading_worst_deg": error.worst,
        "textbook_worst_deg": None if textbook is None else textbook.worst,
        "findings": [f"{finding.code}: {finding.severity}" for finding in fit.findings],
    }


def attempt(make: Callable[[], Fit]) -> Row:
    """Row of a fit: its numbers, also for a refused fit, or the code of an error."""
    try:
        return numbers_of(make())
    except FitError as error:
        fit = getattr(error, "fit", None)
        return {"error": error.code} if fit is None else numbers_of(fit)
    except FlindersError as error:
        return {"error": error.code}


def fits_of_recording(name: str) -> list[Row]:
    """Fit a real recording: a short one by all methods."""
    samples = flinders.read(FOLDER / name)
    methods = METHODS if len(samples) <= MAX_SHORT_READINGS else ("auto", "likelihood")
    return [fitted(f"{name}", samples, method) for method in methods]


def fits_of_simulation(world: tuple[str, int]) -> list[Row]:
    """Fit a simulated recording by all methods."""
    samples = simulation(*world)
    return [fitted(f"{world[0]} {world[1]}", samples, method) for method in METHODS]


def fitted(name: str, samples: Samples, method: str) -> Row:
    """Fit by one method."""
    return {"recording": name, "method": method, **attempt(partial(flinders.fit, samples, method=method))}


def aided_fits_of_recording(name: str) -> list[Row]:
    """Fit a real recording with all its further sensors."""
    samples = flinders.read(FOLDER / name)
    if len(samples) > MAX_SHORT_READINGS or (samples.acceleration is None and samples.rate is None):
        return []
    return [_aided(name, samples, aiding) for aiding in AIDING]


def aided_fits_of_simulation(world: tuple[str, int]) -> list[Row]:
    """Fit a simulated recording with aiding sensors, and with disturbances."""
    motion, seed = world
    bare = simulate.tumble(seed=seed, motion=motion, n=1000).samples
    disturbances: list[Perturbation] = [simulate.MotorCurrent(0.3), simulate.ThermalDrift(0.2)]
    disturbed = simulate.tumble(seed=seed, motion=motion, n=1000, disturbances=disturbances).samples
    rows = [_aided(f"{motion} {seed}", bare, aiding) for aiding in AIDING]
    for names in (("current",), ("temperature",), ("current", "temperature")):
        make = partial(flinders.fit, disturbed, disturbances=names)
        rows.append({"recording": f"{motion} {seed} disturbed", "method": " ".join(names), **attempt(make)})
    return [*rows, *_together(f"{motion} {seed}", seed, motion)]


def _aided(name: str, samples: Samples, aiding: tuple[str, ...]) -> Row:
    make = partial(flinders.fit, samples, aiding=aiding[0] if len(aiding) == 1 else aiding)
    return {"recording": name, "method": f"with {' '.join(aiding)}", **attempt(make)}


def _together(name: str, seed: int, motion: str) -> list[Row]:
    """Fit two sensors of one body together."""
    second = Sensor(offset=np.array([15.0, -7.0, 4.0]), noise=1.0)
    sensors = {
        "first": simulate.tumble(seed=seed, motion=motion, n=800).samples,
        "second": simulate.tumble(seed=seed, motion=motion, n=800, sensor=second).samples,
    }
    try:
        both = flinders.fit_multi(sensors)
    except FlindersError as error:
        return [{"recording": name, "method": "together", "error": error.code}]
    members = [(one.name, one.fit) for one in both.members]
    return [
        {"recording": name, "method": f"together {sensor}", **attempt(partial(_given, fit))} for sensor, fit in members
    ]


def _given(fit: Fit | FlindersError) -> Fit:
    """Return the fit, or raise the error, like `flinders.fit`."""
    if isinstance(fit, FlindersError):
        raise fit
    return fit


def write(path: Path, *, aiding: bool) -> None:
    """Write the table of all fits."""
    if not FOLDER.is_dir():
        sys.exit(f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them")
    names = recordings()
    with ProcessPoolExecutor() as pool:
        if aiding:
            worlds = [(motion, seed) for motion in AIDED_WORLDS for seed in range(4)]
            tables = [pool.map(aided_fits_of_recording, names), pool.map(aided_fits_of_simulation, worlds)]
        else:
            tables = [pool.map(fits_of_recording, names), pool.map(fits_of_simulation, simulated())]
        rows = [row for table in tables for rows in table for row in rows]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    print(f"{len(rows):,} fits written to {path}")


def compare(old: Path, new: Path) -> int:
    """Print unexpected differences of two tables; returns the number of such fits."""
    expected = tomllib.loads(DIFFERENCES.read_text())
    before, after = _table(old), _table(new)
    renamed, moved, added = expected["renamed"], set(expected["moved"]), set(expected["added"])
    allowed = {
        (recording, method)
        for one in expected["difference"]
        if one["reason"]
        for recording in one.get("recordings") or [one["recording"]]
        for method in one["methods"]
    }
    of_methods = {method: tuple(one["numbers"]) for one in expected.get("method", []) for method in one["methods"]}
    count = 0
    for key, row in before.items():
        if key[1] in moved:
            continue
        words = differences(_known(row, renamed, added), _known(after[key], {}, added)) if key in after else ["is gone"]
        words = [word for word in words if key not in allowed and not word.startswith(of_methods.get(key[1], "is new"))]
        count += bool(words)
        for word in words:
            print(f"{key[0]} by {key[1]}: {word}")
    new_ones = len(after.keys() - before.keys())
    print(f"{len(before):,} fits compared, {count:,} differ" + (f"; {new_ones:,} are new" if new_ones else ""))
    return count


def differences(old: Row, new: Row) -> list[str]:
    """Lines on the differences of two fits of one recording; empty if they agree.

    >>> row = {"verdict": "good", "offset": [1.0, 2.0, 3.0], "matrix": np.eye(3).tolist(), "noise": 0.5,
    ...        "covariance": (0.01 * np.eye(9)).tolist(), "field_strength": 50.0, "findings": []}
    >>> differences(row, {**row, "offset": [1.0009, 2.0, 3.0]})
    []
    >>> differences(row, {**row, "offset": [1.0011, 2.0, 3.0], "verdict": "limited"})
    ['verdict was good, is limited', 'offset moved by 1.1 % of σ']
    """
    if "error" in old or "error" in new:
        was, now = old.get("error", "a fit"), new.get("error", "a fit")
        return [] if was == now else [f"was {was}, is {now}"]
    exact = ("verdict", "used", "samples", "findings")
    words = [f"{name} was {old.get(name)}, is {new.get(name)}" for name in exact if old.get(name) != new.get(name)]
    for name in ("noise", "field_strength", "heading_rms_deg", "heading_worst_deg", "textbook_worst_deg"):
        was, now = old.get(name), new.get(name)
        if was != now and (was is None or now is None or not _is_close(was, now)):
            words.append(f"{name} was {was}, is {now}")
    return words + _moved(old, new)


def _is_close(was: float, now: float) -> bool:
    return math.isclose(was, now, rel_tol=TOLERANCE, abs_tol=ROUNDING) or (math.isnan(was) and math.isnan(now))


def _moved(old: Row, new: Row) -> list[str]:
    """Lines on changes of offset, matrix and covariance, in old standard deviations."""
    sigma = np.sqrt(np.maximum(np.diag(old["covariance"]), 0.0))
    size = old["field_strength"]
    steps = {
        "offset": _step(old["offset"], new["offset"], sigma[:3] + 1e2 * ROUNDING * size),
        "matrix": _step(old["matrix"], new["matrix"], _matrix_sigma(np.asarray(old["matrix"]), sigma, size)),
        "covariance": _step(
            old["covariance"], new["covariance"], 2.0 * np.outer(sigma, sigma) + 1e2 * ROUNDING**2 * size**2
        ),
    }
    return [f"{name} moved by {100.0 * step:.2g} % of σ" for name, step in steps.items() if not step <= TOLERANCE]


def _step(old: ArrayLike, new: ArrayLike, sigma: Floats) -> float:
    """Largest of the changes, each in its own standard deviation."""
    was, now = np.asarray(old), np.asarray(new)
    if was.shape != now.shape:
        return math.inf
    return float(np.max(np.abs(now - was) / sigma))


def _matrix_sigma(matrix: Floats, sigma: Floats, size: float) -> Floats:
    """(3, 3) standard deviation of W = F S⁻¹, roughly from the least known entry of S, in the units of each row."""
    rows: Floats = np.linalg.norm(matrix, axis=1)
    return rows[:, np.newaxis] * rows * (float(sigma[3:].max()) / size + 1e2 * ROUNDING)


def _table(path: Path) -> dict[tuple[str, str], Row]:
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return {(row["recording"], row["method"]): row for row in rows}


def _known(row: Row, names: dict[str, str], added: set[str]) -> Row:
    """Row with the present names of findings, without findings added since the old table."""
    if "findings" not in row:
        return row
    split = [words.partition(": ") for words in row["findings"]]
    known = [f"{names.get(code, code)}: {severity}" for code, _, severity in split if code not in added]
    return {**row, "findings": known}


def main() -> None:
    """Write a table, or compare two."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("tables", nargs="+", type=Path, metavar="TABLE.jsonl")
    parser.add_argument("--compare", action="store_true", help="compare two tables")
    parser.add_argument("--aiding", action="store_true", help="the fits with aiding sensors instead")
    asked = parser.parse_args()
    if len(asked.tables) != (2 if asked.compare else 1):
        parser.error("one table is written, two are compared")
    if asked.compare:
        sys.exit(bool(compare(*asked.tables)))
    write(asked.tables[0], aiding=asked.aiding)


if __name__ == "__main__":
    main()
