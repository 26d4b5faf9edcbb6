"""``flinders compare``: two calibrations of one sensor, held against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from flinders.cli import _disturbances, _options
from flinders.cli._inputs import is_calibration, is_recording
from flinders.cli._output import print_json, say, show
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit


@_options.command(
    "compare",
    common=("target_deg", "dip_deg", "as_json"),
    short_help="Say how far two calibrations are apart, in degrees.",
    epilog="""\b
Example:
  flinders compare monday.json tuesday.json

\b
Exit codes:
  0  they agree
  3  they differ by less than the target, or claim too little to tell,
     or agree and sit otherwise in the body
  4  they contradict each other
""",
)
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@_options.judgement
@_options.as_json
def command(first: str, second: str, target_deg: float, dip_deg: float, as_json: bool) -> int:
    """Say how far calibration B is from calibration A, and whether that is more than chance.

    Both are calibration files of one sensor. The difference in heading is held against what both claim of
    themselves; two calibrations from one recording agree better than that. A file without a covariance is
    taken as exact.
    """
    from flinders.comparison.comparison import compare
    from flinders.report.comparison_pages import of_comparison

    a, b = _load(first, second), _load(second, first)
    comparison = compare(a, b, dip_deg=dip_deg, target_deg=target_deg)
    for one in (a, b):
        if not one.states_uncertainty:
            say(f"{one.name} states no uncertainty: it is taken as exact")
    _disturbances.say_difference(a, b)
    if None not in (names := {a.calibration.sensor, b.calibration.sensor}) and len(names) > 1:
        say(f"{first} is for sensor {a.calibration.sensor!r}, {second} for {b.calibration.sensor!r}")
    if as_json:
        print_json(comparison.as_dict())
    else:
        show(of_comparison(comparison))
    if comparison.verdict == "contradict":
        return REFUSED
    firm = comparison.is_telling and not comparison.is_turned
    return GOOD if comparison.verdict == "agree" and firm else LIMITED


def _load(path: str, other: str) -> Fit:
    """Load a calibration, and see whether a recording was given in its place.

    Raises
    ------
    UsageError
        For a recording beside a calibration.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.result import Fit

    try:
        return Fit.load(path)
    except DocumentError:
        if is_calibration(other) and is_recording(path):
            raise UsageError(f"{path} is a recording: flinders check {other} {path}") from None
        raise
