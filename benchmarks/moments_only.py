"""What `flinders fleet --moments-only` costs: heading errors, true and claimed, beside those of the same readings.

    python -m benchmarks.moments_only [--units 300]

Each row is so many simulated units with another sensor, motion and noise of 0.5 µT each, fitted twice by what
`flinders fleet` calls: with its second pass over the readings, and from sums alone. Errors are those of a level vehicle
where the field dips as `benchmarks.datasets.FIELD` does, root mean square over all headings, their mean removed: the
median over the units of what it is, and of what was claimed. "÷" is the root mean square over the units of true ÷
claimed: 1 where claims are true. Units that are refused give no calibration, and are left out of both where either
refuses them. Prints Markdown.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.claims import by_hand
from benchmarks.datasets import heading_error_deg
from flinders import simulate
from flinders.fleet.dataset import Options
from flinders.fleet.recordings import Job
from flinders.fleet.worker import fit_jobs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.fleet.results import UnitResults
    from flinders.simulate import Simulated

UNITS: Final = 300

KINDS: Final[Mapping[str, Callable[[int], Simulated]]] = {
    "500 random directions": partial(simulate.tumble, motion="uniform", n=500),
    "a minute by hand": by_hand,
    "tilted by 35° at the most": partial(simulate.tumble, motion="tilted", n=500, tilt_deg=35.0),
    "by hand, correlated noise (ρ = 0.8)": partial(by_hand, memory=0.8),
    "by hand, 1 % of the field belongs to the direction": partial(by_hand, distorted=0.01),
    "by hand, 1 % outliers": partial(simulate.tumble, outliers=0.01),
    "by hand, a magnet passes": partial(by_hand, magnet="cut"),
}
"""Recordings by their seed."""


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Heading errors of some units, in degrees; NaN for those that are refused.

    Attributes
    ----------
    true, claimed : (U,) float
    """

    true: Floats
    claimed: Floats

    @classmethod
    def of(cls, rows: UnitResults, recordings: list[Simulated]) -> Errors:
        """Hold rows, in the order of the recordings, against the truth."""
        true = np.full(len(recordings), np.nan)
        for place in np.flatnonzero(np.isfinite(rows.offset[:, 0])).tolist():
            true[place] = heading_error_deg(rows.matrix[place].reshape(3, 3), rows.offset[place], recordings[place])
        return cls(true, rows.rms_deg)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(U,) whether there is a calibration."""
        return np.isfinite(self.true)

    def cells(self, both: NDArray[np.bool_]) -> str:
        """True and claimed error, and their ratio, over some units; and how many of all are refused."""
        true, claimed = self.true[both], self.claimed[both]
        ratio = np.sqrt(np.mean((true / claimed) ** 2))
        return f"{np.median(true):.2f} | {np.median(claimed):.2f} | {ratio:.1f} | {np.mean(~self.known):.0%}"


def errors_of(recordings: list[Simulated], *, polish: bool) -> Errors:
    """Fit all of them."""
    jobs = [Job(f"{place:06d}", "", recording.samples, 0) for place, recording in enumerate(recordings)]
    return Errors.of(fit_jobs(jobs, Options(polish=polish)).sorted(), recordings)


def table(units: int) -> Iterator[str]:
    """Yield the lines of the table, each as soon as it is measured."""
    yield "| recordings | true ° | claimed | ÷ | refused | sums alone: true ° | claimed | ÷ | refused |"
    yield "|---|" + "---:|" * 8
    for name, made in KINDS.items():
        recordings = [made(seed) for seed in range(units)]
        polished, summed = (errors_of(recordings, polish=polish) for polish in (True, False))
        both = polished.known & summed.known
        yield f"| {name} | {polished.cells(both)} | {summed.cells(both)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=UNITS)
    for line in table(parser.parse_args().units):
        print(line, flush=True)


if __name__ == "__main__":
    main()
