"""``flinders evaluate``: the true error of a calibration of a simulated recording."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import click

from flinders.cli import _disturbances, _options
from flinders.cli._inputs import is_calibration, load
from flinders.cli._output import print_json, say, show
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.simulate.truth import Truth


@_options.command(
    "evaluate",
    common=("target_deg", "dip_deg", "as_json"),
    short_help="Hold a calibration against the truth of a simulation.",
    epilog="""\b
Example:
  flinders evaluate calibration.json tumble.truth.json

\b
Exit codes:
  0  within the target, and no worse than claimed
  3  beyond the target, or worse than claimed
  4  both
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@click.argument("truth", metavar="TRUTH")
@_options.dip("Inclination of the field for headings [default: that of the truth].")
@_options.target()
@_options.as_json
def command(calibration: str, truth: str, dip_deg: float | None, target_deg: float, as_json: bool) -> int:
    """Say how far CALIBRATION is from TRUTH, which `flinders simulate` wrote, and whether it knows.

    True errors of heading, direction, offset and matrix stand beside those that the calibration claims, with their
    ratio: about 1 where the claims are true. A rotation that no magnetometer can see is given on its own.
    """
    from flinders.comparison.evaluation import evaluate
    from flinders.report.comparison_pages import of_evaluation

    fit, known = _load(calibration, truth)
    _disturbances.say_references(fit)
    evaluation = evaluate(fit, known, dip_deg=dip_deg, target_deg=target_deg)
    if not fit.states_uncertainty:
        say(f"{calibration} states no uncertainty: there is no claim to hold against the truth")
    if as_json:
        print_json(evaluation.as_dict())
    else:
        show(of_evaluation(evaluation))
    faults = (not evaluation.is_on_target) + (evaluation.verdict == "worse than claimed")
    return (GOOD, LIMITED, REFUSED)[faults]


def _load(calibration: str, truth: str) -> tuple[Fit, Truth]:
    """Read both, and see whether they were given the other way round.

    Raises
    ------
    UsageError
        Where they were, or one would come from standard input.
    DocumentError, UnreadableInput
        For a file that is none of its kind.
    """
    from flinders.simulate.truth import read

    if truth == "-":
        raise UsageError("the truth must be a file: flinders evaluate calibration.json tumble.truth.json")
    if is_calibration(truth):
        with contextlib.suppress(UnreadableInput):
            read(calibration)
            raise UsageError(f"the calibration comes first: flinders evaluate {truth} {calibration}")
    fit = load("evaluate", calibration, [])
    return fit, read(truth)
