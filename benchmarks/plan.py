"""Are plans true? The heading error that `flinders.plan` predicts, against recordings that follow the plan.

    python -m benchmarks.plan [--bodies hand,drone,boat,robot,wrist] [--noises 0.1,0.5,2] [--trials 40]

Each plan is followed by simulated recordings of other sensors, with other noise and sway than those of the plan, and
`flinders.fit` calibrates each. Errors are those of a level heading, rms over headings and degrees, at a dip of 60°:

predicted    claim of the fit to expect
information  information bound of noise and prior of the same readings
achieved     true error, rms over the recordings
claimed      claim of the fits, their median

A fit that is refused counts with the fit that the refusal carries.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.datasets import heading_error_deg
from flinders.simulate.bodies import BODIES
from flinders.workflows.planned_fit import fit_planned, simulate_plan

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.workflows.planning import Plan

NOISES_UT: Final = (0.1, 0.5, 2.0)
TRIALS: Final = 40
FIRST_SEED: Final = 1000
"""Seed of the first recording; those of plans are smaller."""

EXTRA: Final = (("drone", 20.0), ("boat", 20.0))
"""Bodies that are also planned with another tilt, degrees."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Recordings that follow a plan."""

    plan: Plan
    achieved_deg: float  # true heading error, rms over headings and recordings
    claimed_deg: float  # median of the claims, rms over headings
    verdicts: Counter[str]

    @classmethod
    def of(cls, plan: Plan, trials: int) -> Followed:
        """Record and fit a plan `trials` times."""
        errors, claims, verdicts = [], [], Counter[str]()
        for seed in range(FIRST_SEED, FIRST_SEED + trials):
            simulated = simulate_plan(plan.sequence, plan.recording, seed)
            fit = fit_planned(simulated, plan.recording)
            verdicts["error" if fit is None else fit.verdict] += 1
            if fit is not None:
                errors.append(heading_error_deg(fit.calibration.matrix, fit.calibration.offset, simulated))
                claims.append(fit.claim.heading_error_deg.rms)
        return cls(plan, math.sqrt(float(np.mean(np.square(errors)))), float(np.median(claims)), verdicts)

    @property
    def predicted_deg(self) -> float:
        """Heading error that the plan predicts, rms over headings."""
        return self.plan.expected.fit.claim.heading_error_deg.rms

    def row(self) -> str:
        """The row of the table."""
        plan, predicted, achieved = self.plan, self.predicted_deg, self.achieved_deg
        information = plan.expected.information_error_deg
        verdicts = ", ".join(f"{count} {verdict}" for verdict, count in self.verdicts.most_common())
        tilt = "any" if plan.tilt_deg > 90.0 else f"{plan.tilt_deg:g}°"
        numbers = " | ".join(f"{value:.2g}°" for value in (predicted, information, achieved, self.claimed_deg))
        ratios = f"{predicted / achieved:.2f} | {information / achieved:.2f} | {predicted / self.claimed_deg:.2f}"
        made = f"{plan.body.name} | {tilt} | {plan.recording.noise:g} | {plan.seconds:.0f} s"
        return f"| {made} | {numbers} | {ratios} | {verdicts} |"


def plan_table(bodies: list[str], noises: list[float], trials: int) -> Iterator[str]:
    """Yield a row for each body, tilt and noise."""
    yield (
        "| body | tilt | noise µT | time | predicted | information | achieved | claimed "
        "| predicted ÷ achieved | information ÷ achieved | predicted ÷ claimed | verdicts |"
    )
    yield "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|"
    tilts = [(body, None) for body in bodies] + [(body, tilt) for body, tilt in EXTRA if body in bodies]
    for body, tilt in tilts:
        for noise in noises:
            planned = flinders.plan(body, noise=noise, tilt_deg=tilt, alternatives=False)
            yield Followed.of(planned, trials).row()


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", default=",".join(BODIES))
    parser.add_argument("--noises", default=",".join(f"{noise:g}" for noise in NOISES_UT))
    parser.add_argument("--trials", type=int, default=TRIALS)
    options = parser.parse_args()
    for line in plan_table(
        options.bodies.split(","), [float(part) for part in options.noises.split(",")], options.trials
    ):
        print(line, flush=True)


if __name__ == "__main__":
    main()
