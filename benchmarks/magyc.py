"""Results of the angular rate's aid on MAGYC's simulation, and of the published package on the same recordings.

    python -m benchmarks.magyc [--seeds 20] [--motions WAM,MAM,LAM,5/5/90] [--data ours,package] [--package uv]

One recording is ten minutes of sines in roll, pitch and heading: 6,000 readings at 10 Hz with 10 mG of noise, and a
gyro with a bias and 10 mrad/s of noise. Of each method, medians over seeds:

offset           error of the hard iron, mG, and the worst seed
soft iron        Frobenius norm of the difference of matrix logarithms, determinants taken out
gyro bias        error in mrad/s; – for methods without
heading          rms error with the true attitude, over the error by noise alone in perfectly corrected readings
CPU s            CPU time of the fit alone

Required (literature, section 8.3): 45 mG with 5° of roll and pitch and full yaw (MAM), 5 mG with wide motion (WAM) and
with little yaw (LAM), and a heading within 1.15 times the error by noise; 5/5/90 is shown in addition.

``--data package`` fits recordings of the package's own simulator. ``--package`` locates the package ``magyc``: ``uv``
creates an environment for it (``uv run --with magyc==1.0.0``), a path names a Python that has it, ``none`` leaves it
out. If it cannot be run, the table has the reason. It receives readings in gauss, and each rate as that of the step
that ends there, as in its own simulator.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.emulations.magyc_ls import gyro_bias, magyc_ls
from benchmarks.emulations.px4_observer import px4_observer
from benchmarks.emulations.sar_kf import sar_kf
from benchmarks.emulations.sar_ls import sar_ls
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import FlindersError
from flinders.estimators.aiding import fit_aided
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid

SEED: Final = 20240915
OFFSET_MG: Final = np.array([20.0, 120.0, 90.0])
IRON: Final = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])
FIELD_MG: Final = np.array([227.207, 51.796, 411.731])
GYRO_BIAS: Final = np.array([0.004, -0.005, 0.002])
MOTIONS: Final = {
    "WAM": (5.0, 45.0, 360.0),
    "MAM": (5.0, 5.0, 360.0),
    "LAM": (5.0, 45.0, 90.0),
    "5/5/90": (5.0, 5.0, 90.0),
}
"""Roll, pitch and heading, in degrees."""

MAX_OFFSET_MG: Final = {"WAM": 5.0, "MAM": 45.0, "LAM": 5.0}
MAX_HEADING_RATIO: Final = 1.15
LEVELS: Final = {"WAM": "high", "MAM": "mid", "LAM": "low", "5/5/90": "tiny"}
"""The package's names of the motions."""

PACKAGE: Final = "magyc==1.0.0"
PROGRAM: Final = Path(__file__).with_name("magyc_package.py")
TIMEOUT_S: Final = 900.0
"""Longest wait for another program, with its download."""


@dataclass(frozen=True, slots=True, eq=False)
class Rocked:
    """A recording in mG and its truth: (N, 3, 3) attitudes, and the (N, 3) field that a perfect sensor reads."""

    samples: Samples
    attitudes: Floats
    true: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Offset (3,) in mG, matrix (3, 3) up to a factor, corrected = matrix @ (raw − offset), and CPU seconds."""

    offset: Floats
    matrix: Floats
    gyro_bias: Floats | None
    seconds: float


@dataclass(frozen=True, slots=True)
class Score:
    """One fit: mG, logarithms, mrad/s, heading rms over that of the noise, and CPU seconds."""

    offset: float = math.nan
    iron: float = math.nan
    bias: float = math.nan
    heading: float = math.nan
    seconds: float = math.nan

    @property
    def row(self) -> tuple[float, ...]:
        """As columns."""
        return self.offset, self.iron, self.bias, self.heading, self.seconds


class NoPackage(Exception):
    """The package cannot be run, with the reason."""


# the simulation


def rocked(motion: str, seed: int) -> Rocked:
    """Recording of 6,000 readings at 10 Hz, with 10 mG and 10 mrad/s of noise and a gyro bias."""
    rng = np.random.default_rng([SEED, seed])
    turning = simulate.rocked(rng, seconds=600.0, rate_hz=10.0, amplitudes_deg=MOTIONS[motion])
    true = simulate.in_body_axes(turning.attitudes, FIELD_MG)
    raw = true @ IRON + OFFSET_MG + rng.normal(0.0, 10.0, true.shape)
    rate = turning.rate + GYRO_BIAS + rng.normal(0.0, 0.01, true.shape)
    return Rocked(Samples(raw, time=turning.time, rate=rate), turning.attitudes, true)


def of_the_package(data: Mapping[str, Floats], motion: str, seed: int) -> Rocked:
    """One recording of the package's own simulator, with rates moved to the beginning of their steps."""
    level = LEVELS[motion]
    field, rate, clock, true, angles = (
        data[f"{level}_{column}"][seed] for column in ("field", "rate", "time", "true", "angles")
    )
    roll, pitch, heading = angles.T
    samples = Samples(1e3 * field, time=clock.ravel(), rate=np.roll(rate, -1, axis=0))
    return Rocked(samples[:-1], simulate.attitudes_of(heading, pitch, roll)[:-1], 1e3 * true[:-1])


# the contestants


def by_rate(samples: Samples, *, window_s: float) -> Answer:
    """Answer of the fit with the angular rate."""
    begun = time.process_time()
    found = fit_aided(samples, ("rate",), window_s=window_s)
    seconds = time.process_time() - begun
    return Answer(found.parameters.offset, found.matrix, found.parameters.gyro_bias, seconds)


def by_ellipsoid(samples: Samples, *, method: Callable[[Samples], Ellipsoid]) -> Answer:
    """Answer of one of `benchmarks.emulations`, or of a method of Flinders."""
    begun = time.process_time()
    ellipsoid = method(samples)
    seconds = time.process_time() - begun
    return Answer(ellipsoid.centre, np.linalg.inv(ellipsoid.shape), None, seconds)


def by_magyc(samples: Samples, *, window: int) -> Answer:
    """Answer of MAGYC's differentiated form, with its gyro bias."""
    answer = by_ellipsoid(samples, method=partial(magyc_ls, window=window))
    return replace(answer, gyro_bias=gyro_bias(samples, window))


def likelihood(samples: Samples) -> Ellipsoid:
    """Ellipsoid of the magnetometer alone."""
    return Likelihood().estimate(Readings.of(samples)).ellipsoid


CONTESTANTS: Final[Mapping[str, Callable[[Samples], Answer]]] = {
    "**`rate`**, windows of 5 s": partial(by_rate, window_s=5.0),
    "`rate`, windows of 10 s": partial(by_rate, window_s=10.0),
    "`likelihood`, magnetometer alone": partial(by_ellipsoid, method=likelihood),
    "`magyc-ls`, medians of 25": partial(by_magyc, window=25),
    "`magyc-ls`, window=1": partial(by_magyc, window=1),
    "`sar-ls`": partial(by_ellipsoid, method=sar_ls),
    "`sar-kf`": partial(by_ellipsoid, method=partial(sar_kf, gyro_noise=0.01)),
    "`px4-observer`": partial(by_ellipsoid, method=px4_observer),
}


# the package


def interpreter(where: str) -> list[str]:
    """Command that starts a Python with the package.

    Raises
    ------
    NoPackage
        If the package is missing.
    """
    if where != "uv":
        return [where]
    found = shutil.which("uv")
    if found is None:
        raise NoPackage("`uv` is not installed: name a Python that has the package with --package PATH")
    return [found, "run", "--quiet", "--no-project", "--python", "3.11", "--with", PACKAGE, "python"]


def run_there(where: str, *words: str) -> None:
    """Run `magyc_package.py` in the package's environment.

    Raises
    ------
    NoPackage
        With the last line of its output.
    """
    try:
        done = subprocess.run(
            [*interpreter(where), "-I", str(PROGRAM), *words],  # isolated: this folder has a magyc.py, too
            capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoPackage(str(error)) from None
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip() or f"exit code {done.returncode}").splitlines()[-1]
        raise NoPackage(last)


def package_answers(where: str, recordings: Sequence[Rocked]) -> dict[str, list[Answer | None]]:
    """Answers of each function of the package for each recording; None if it raises.

    Raises
    ------
    NoPackage
        If it cannot be run.
    """
    with TemporaryDirectory() as folder:
        given, said = Path(folder, "recordings.npz"), Path(folder, "answers.json")
        columns = [(one.samples.field, one.samples.rate, one.samples.time) for one in recordings]
        np.savez(
            given,
            field=np.array([field for field, _, _ in columns]) / 1e3,
            rate=np.array([np.roll(np.asarray(rate), 1, axis=0) for _, rate, _ in columns]),
            time=np.array([clock for _, _, clock in columns]),
        )
        run_there(where, str(given), str(said))
        told = json.loads(said.read_text(encoding="utf-8"))
    return {name: [_answer(one) for one in found] for name, found in told.items()}


def package_recordings(where: str, motions: Sequence[str], seeds: int) -> dict[str, list[Rocked]]:
    """Recordings of the package's own simulator, by motion.

    Raises
    ------
    NoPackage
        If it cannot be run.
    """
    with TemporaryDirectory() as folder:
        made = Path(folder, "simulated.npz")
        run_there(where, "--simulate", str(made), str(seeds))
        with np.load(made) as data:
            columns = {name: data[name] for name in data.files}
    return {motion: [of_the_package(columns, motion, seed) for seed in range(seeds)] for motion in motions}


def _answer(told: Mapping[str, object]) -> Answer | None:
    if "refused" in told:
        return None
    bias = told["gyro_bias"]
    return Answer(
        1e3 * np.array(told["offset"], float),
        np.linalg.inv(np.array(told["soft_iron"], float)),
        None if bias is None else np.array(bias, float),
        float(str(told["seconds"])),
    )


# the scores


def scored(answer: Answer | None, recording: Rocked) -> Score:
    """Errors of an answer; NaN without one, or for NaN in it."""
    if answer is None or not (np.isfinite(answer.offset).all() and np.isfinite(answer.matrix).all()):
        return Score()
    corrected = (recording.samples.field - answer.offset) @ answer.matrix.T
    perfect = (recording.samples.field - OFFSET_MG) @ np.linalg.inv(IRON)
    truth = _headings(recording.true, recording.attitudes)
    noise = wrapped_rms(_headings(perfect, recording.attitudes) - truth)
    found = wrapped_rms(_headings(corrected, recording.attitudes) - truth)
    return Score(
        float(np.linalg.norm(answer.offset - OFFSET_MG)),
        float(np.linalg.norm(_log(_symmetric(np.linalg.inv(answer.matrix))) - _log(IRON))),
        math.nan if answer.gyro_bias is None else 1e3 * float(np.linalg.norm(answer.gyro_bias - GYRO_BIAS)),
        found / noise,
        answer.seconds,
    )


def score(contestant: Callable[[Samples], Answer], recording: Rocked) -> Score:
    """Run one contestant on one recording; NaN if it refuses."""
    try:
        answer = contestant(recording.samples)
    except FlindersError:
        return Score()
    return scored(answer, recording)


# the table


HEAD: Final = (
    "| motion | method | offset, mG | worst | soft iron | gyro bias, mrad/s | heading over noise | CPU s |\n"
    "|---|---|---:|---:|---:|---:|---:|---:|"
)


def line(motion: str, title: str, scores: Sequence[Score]) -> str:
    """One row: medians over the seeds with an answer, and the number without.

    >>> line("WAM", "`rate`", [Score(1.0, 0.01, 0.1, 1.001, 0.2), Score(3.0, 0.03, 0.3, 1.003, 0.4), Score()])
    '| WAM | `rate` (1 of 3 refused) | 2 | 3 | 0.020 | 0.20 | 1.002 | 0.30 |'
    """
    rows = np.array([one.row for one in scores if not math.isnan(one.offset)])
    lost = len(scores) - len(rows)
    title = f"{title} ({lost} of {len(scores)} refused)" if lost else title
    if not len(rows):
        return f"| {motion} | {title} | – | – | – | – | – | – |"
    offset, iron, bias, heading, seconds = np.median(rows, axis=0)
    gyro = "–" if math.isnan(bias) else f"{bias:.2f}"
    worst = rows[:, 0].max()
    return f"| {motion} | {title} | {offset:.3g} | {worst:.3g} | {iron:.3f} | {gyro} | {heading:.3f} | {seconds:.2f} |"


def table(pool: ProcessPoolExecutor, recordings: Mapping[str, Sequence[Rocked]], where: str | None) -> Iterator[str]:
    """Yield the rows of each motion, then whether the requirements are met."""
    yield HEAD
    reached = []
    for motion, some in recordings.items():
        for title, contestant in CONTESTANTS.items():
            scores = list(pool.map(score, repeat(contestant), some))
            yield line(motion, title, scores)
            if title.startswith("**"):
                reached.append(asked_of(motion, scores))
        if where is not None:
            try:
                for name, answers in package_answers(where, some).items():
                    yield line(motion, f"package `{name}`", [scored(*pair) for pair in zip(answers, some, strict=True)])
            except NoPackage as reason:
                yield f"| {motion} | package `magyc` could not be run: {reason} | – | – | – | – | – | – |"
    yield ""
    yield from reached


def asked_of(motion: str, scores: Sequence[Score]) -> str:
    """Line on the requirements and the results with the aid."""
    offset, heading = (float(np.median([getattr(one, name) for one in scores])) for name in ("offset", "heading"))
    limit = MAX_OFFSET_MG.get(motion)
    of_offset = "" if limit is None else f" (asked: {limit:g}, {_met(offset <= limit)})"
    of_heading = f"asked: {MAX_HEADING_RATIO:g}, {_met(heading <= MAX_HEADING_RATIO)}"
    return f"- {motion}: {offset:.2g} mG{of_offset}, heading {heading:.3f} ({of_heading})"


def _met(is_met: bool) -> str:
    return "met" if is_met else "MISSED"


# the command


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    options = _parser().parse_args(arguments)
    unknown = [name for name in options.motions if name not in MOTIONS]
    if unknown:
        sys.exit(f"no motion {', '.join(unknown)}: there are {', '.join(MOTIONS)}")
    where = None if options.package == "none" else options.package
    with ProcessPoolExecutor(options.processes) as pool:
        for data in options.data:
            print(f"\n## Recordings of {'Flinders' if data == 'ours' else 'the package'}, {options.seeds} seeds\n")
            if data == "ours":
                recordings = {name: [rocked(name, seed) for seed in range(options.seeds)] for name in options.motions}
            else:
                try:
                    recordings = package_recordings(where or "uv", options.motions, options.seeds)
                except NoPackage as reason:
                    print(f"The package could not be run: {reason}")
                    continue
            for row in table(pool, recordings, where):
                print(row, flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.magyc", description="MAGYC's simulation, and its package.")

    def names(text: str) -> list[str]:
        return text.split(",")

    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--motions", type=names, default=list(MOTIONS), metavar="NAME,…", help="all by default")
    parser.add_argument("--data", type=names, default=["ours"], metavar="ours,package", help="whose recordings")
    parser.add_argument("--package", default="uv", metavar="uv|PATH|none", help="where the package `magyc` is")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def _headings(field: Floats, attitudes: Floats) -> Floats:
    """(N,) direction of the horizontal field in world axes, rad, with the true attitudes."""
    level = np.einsum("nij,nj->ni", attitudes, field)
    headings: Floats = np.arctan2(level[:, 1], level[:, 0])
    return headings


def wrapped_rms(angles: Floats) -> float:
    """Root mean square of angles about their mean direction, rad."""
    phasors = np.exp(1j * angles)
    return math.sqrt(float(np.mean(np.angle(phasors / np.mean(phasors)) ** 2)))


def _symmetric(iron: Floats) -> Floats:
    """(3, 3) symmetric root of AAᵀ, without the rotation."""
    values, axes = np.linalg.eigh(iron @ iron.T)
    root: Floats = (axes * np.sqrt(values)) @ axes.T
    return root


def _log(matrix: Floats) -> Floats:
    """(3, 3) logarithm of a symmetric positive matrix with its determinant removed."""
    values, axes = np.linalg.eigh(matrix / np.cbrt(np.linalg.det(matrix)))
    log: Floats = (axes * np.log(values)) @ axes.T
    return log


if __name__ == "__main__":
    main()
