"""``flinders evaluate``: the true error of a calibration of a simulated recording."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import is_calibration, load
from flinders.cli._output import print_result, say, say_references
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.simulate.truth import Truth


class Evaluate(program.Group):
    """A calibration, and the truth with which it is compared."""

    calibration: str = program.argument("CALIBRATION")
    truth: str = program.argument("TRUTH")
    dip_deg: float | None = option.dip("Inclination of the field for headings [default: that of the truth].")
    target_deg: float = option.target()
    as_json: bool = option.as_json()


@program.command_of(
    "evaluate",
    Evaluate,
    common=("target_deg", "dip_deg", "as_json"),
    epilog="""\b
Example:
  flinders evaluate calibration.json tumble.truth.json

\b
Exit codes:
  0  within the target, and no worse than stated
    3  beyond the target, or worse than stated
    4  both
""",
)
def command(options: Evaluate) -> int:
    """Compare CALIBRATION with TRUTH, a file written by `flinders simulate`: true errors next to stated ones.

    True errors of heading, direction, offset and matrix are listed next to the stated ones, with their ratio; a ratio
    of about 1 means that the stated uncertainty is right. Both files are in the magnetometer's own axes; a rotation
    into the body is listed separately, and judged only if the calibration states it.
    """
    from flinders.comparison.evaluation import evaluate
    from flinders.report.comparison_pages import page_of_evaluation

    fit, truth = _load(options.calibration, options.truth)
    say_references(fit)
    evaluation = evaluate(fit, truth, dip_deg=options.dip_deg, target_deg=options.target_deg)
    if not fit.claim.states_uncertainty:
        say(f"{options.calibration} states no uncertainty to compare with the true error")
    print_result(evaluation.as_dict, lambda: page_of_evaluation(evaluation), as_json=options.as_json)
    faults = (not evaluation.is_on_target) + (evaluation.verdict == "worse than claimed")
    return (GOOD, LIMITED, REFUSED)[faults]


def _load(calibration: str, truth: str) -> tuple[Fit, Truth]:
    """Load the calibration and the truth; a message says so if the two files were swapped."""
    from flinders.simulate.truth import read

    if truth == "-":
        raise UsageError("the truth must be a file: flinders evaluate calibration.json tumble.truth.json")
    if is_calibration(truth):
        with contextlib.suppress(UnreadableInput):
            read(calibration)
            raise UsageError(f"the calibration comes first: flinders evaluate {truth} {calibration}")
    return load("evaluate", calibration, [truth]), read(truth)
