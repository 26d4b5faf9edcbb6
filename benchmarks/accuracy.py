"""Accuracy compared with the Cramér–Rao bound: a table of data sets and noises, as Markdown.

    python -m benchmarks.accuracy [--trials 400] [--sets S1,S2] [--sigma 0.1,0.5,2] [--method auto]
        [--option NAME=VALUE] [--processes 2]

For each row, over the trials that did not fail:

bound, rms    root mean square angle error in degrees: the smallest possible one, and the measured one (for S7 the
              heading error of a level turn, which has no bound here)
efficiency    bound ÷ rms; 1 is perfect. Over 400 trials it scatters by 1.4 %, for S4 and one hemisphere by 3 %
weighted      squared error of all nine parameters, weighted by the information of the bound, over 9; 1 is perfect
failed        no calibration, or one with an error of more than 20°, or of more than a field strength in the offset
refused       a `FitError` was raised, with or without a fit
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.datasets import FIELD_STRENGTH, SETS, bound, dataset, heading_error_deg, parameter_error
from flinders.errors import FitError, FlindersError
from flinders.estimators import METHODS
from flinders.fitting.result import Refused
from flinders.simulate import angle_error_deg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.estimators import Estimator as Method
    from flinders.simulate import Simulated

MAX_ERROR_DEG: Final = 20.0
LEVEL: Final = "S7"
COLUMNS: Final = ("σ µT", "bound °", "rms °", "efficiency", "weighted", "failed", "refused")


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Result of an estimator: (3, 3) matrix and (3,) offset in µT, or None for both; and whether it was refused."""

    matrix: Floats | None
    offset: Floats | None
    refused: bool = False


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of one trial: angles in degrees, and the weighted squared error over 9; NaN for a failed trial."""

    bound_deg: float
    error_deg: float
    weighted: float
    refused: bool

    @property
    def failed(self) -> bool:
        """Whether there is no calibration, or one with an error beyond the limits."""
        return math.isnan(self.error_deg)


Estimator = Callable[["Simulated"], Answer]


def fitted(recording: Simulated, *, method: str | Method) -> Answer:
    """Result of `flinders.fit` with a known field strength."""
    try:
        fit = flinders.fit(recording.samples.field, method=method, site=flinders.Site(strength=FIELD_STRENGTH))
    except Refused as refusal:
        return Answer(refusal.fit.calibration.matrix, refusal.fit.calibration.offset, refused=True)
    except FlindersError as error:
        return Answer(None, None, refused=isinstance(error, FitError))
    return Answer(fit.calibration.matrix, fit.calibration.offset)


def score(estimator: Estimator, name: str, sigma: float, trial: int) -> Score:
    """Simulate a recording, calibrate it, and compare with the truth."""
    recording = dataset(name, trial, sigma)
    answer, best = estimator(recording), bound(recording)
    failure = Score(best.angle_deg, math.nan, math.nan, answer.refused)
    if answer.matrix is None or answer.offset is None:
        return failure
    if name == LEVEL:
        error, weighted, astray = heading_error_deg(answer.matrix, answer.offset, recording), math.nan, 0.0
    else:
        error = angle_error_deg(answer.matrix, answer.offset, recording)
        off = parameter_error(answer.matrix, answer.offset, recording)
        weighted, astray = float(off @ best.information @ off) / 9, float(np.linalg.norm(off[:3]))
    if not (error <= MAX_ERROR_DEG and astray <= FIELD_STRENGTH):
        return failure
    return Score(best.angle_deg, error, weighted, answer.refused)


def row(name: str, sigma: float, scores: Sequence[Score]) -> str:
    """One row of the table."""
    good = [one for one in scores if not one.failed]
    least = _root_mean_square([one.bound_deg for one in good])
    found = _root_mean_square([one.error_deg for one in good])
    weighted = float(np.mean([one.weighted for one in good])) if good else math.nan
    cells = (
        _digits(least, "#.3g"),
        _digits(found, "#.3g"),
        _digits(least / found, ".2f"),
        _digits(weighted, ".2f"),
        _share(sum(one.failed for one in scores), len(scores)),
        _share(sum(one.refused for one in scores), len(scores)),
    )
    return f"| {name} | {sigma:g} | {' | '.join(cells)} |"


def table(
    estimator: Estimator, names: Sequence[str], sigmas: Sequence[float], trials: int, processes: int
) -> Iterator[str]:
    """Yield the lines of the table, each as soon as it is measured; `estimator` must be picklable."""
    yield f"| set | {' | '.join(COLUMNS)} |"
    yield "|---|" + "---:|" * len(COLUMNS)
    with ProcessPoolExecutor(processes) as pool:
        for name in names:
            for sigma in SETS[name].sigmas or sigmas:
                several = repeat(estimator), repeat(name), repeat(sigma), range(trials)
                yield row(name, sigma, list(pool.map(score, *several, chunksize=max(1, trials // (4 * processes)))))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    options = _parser().parse_args(arguments)
    unknown = [name for name in options.sets if name not in SETS]
    if unknown:
        sys.exit(f"no data set {', '.join(unknown)}: there are {', '.join(SETS)}")
    method = METHODS[options.method](**dict(options.option)) if options.option else options.method
    estimator = partial(fitted, method=method)
    for line in table(estimator, options.sets, options.sigma, options.trials, options.processes):
        print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.accuracy", description="Accuracy against the bound.")
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--sets", type=lambda text: text.split(","), default=list(SETS), metavar="S1,S2,…")
    parser.add_argument("--sigma", type=_numbers, default=[0.1, 0.5, 2.0], metavar="µT,µT,…")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--option", type=_option, action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def _numbers(text: str) -> list[float]:
    """Read numbers with commas between them."""
    return [float(word) for word in text.split(",")]


def _option(text: str) -> tuple[str, str | float]:
    """Read an option of a method, whose value is a number or a word."""
    name, _, value = text.partition("=")
    return name, float(value) if value.replace(".", "", 1).isdigit() else value


def _root_mean_square(values: Sequence[float]) -> float:
    """Root mean square; NaN without values."""
    return math.sqrt(float(np.mean(np.square(values)))) if values else math.nan


def _digits(value: float, form: str) -> str:
    """Write a number, or a dash for NaN."""
    return "–" if math.isnan(value) else format(value, form)


def _share(count: int, of: int) -> str:
    """Write a count with its share."""
    return f"{count} ({count / of:.1%})" if count else "0"


if __name__ == "__main__":
    main()
