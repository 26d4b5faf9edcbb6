"""``flinders compare``: the heading difference between two calibrations of one sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import is_calibration, is_recording, refuse_recording, say_exact
from flinders.cli._output import print_result, say, say_difference
from flinders.cli._program import ANSWER_EXITS
from flinders.cli._spelling import in_options
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit


class Compare(program.Group):
    """Two calibrations, and the target for their difference."""

    first: str = program.argument("A")
    second: str = program.argument("B")
    target_deg: float = option.target()
    dip_deg: float | None = option.dip("Inclination of the field [default: that of A].")
    as_json: bool = option.as_json()


@program.command_of(
    "compare",
    Compare,
    common=("target_deg", "dip_deg", "as_json"),
    epilog="""\b
Example:
  flinders compare monday.json tuesday.json

\b
Exit codes:
  0  they agree: the heading difference is within the target, with a
     confidence of 95 %
  3  cannot tell: their uncertainty is too large
  4  they contradict each other: the difference, or that of their rotations
     into the body, is beyond the target, with that confidence
""",
)
def command(options: Compare) -> int:
    """Compare calibrations A and B of one sensor, and tell whether their heading difference is significant.

    A and B are calibration files. The heading difference is compared with the uncertainty of both; two calibrations
    from one recording differ by less. A file without a covariance is taken as exact.
    """
    from flinders.comparison.comparison import compare
    from flinders.report.comparison_pages import page_of_comparison

    first, second = options.first, options.second
    a, b = _load(first, second), _load(second, first)
    comparison = compare(a, b, dip_deg=options.dip_deg, target_deg=options.target_deg)
    say_exact(a, b)
    say_difference(a, b)
    if None not in (names := {a.calibration.sensor, b.calibration.sensor}) and len(names) > 1:
        say(f"{first} is for sensor {a.calibration.sensor!r}, {second} for {b.calibration.sensor!r}")
    print_result(comparison.as_dict, lambda: page_of_comparison(comparison, in_options), as_json=options.as_json)
    return ANSWER_EXITS[comparison.answer]


def _load(path: str, other: str) -> Fit:
    """Load a calibration; for a recording, the error names the command that compares a calibration with a recording."""
    from flinders.fitting.fit_file import load

    try:
        return load(path)
    except DocumentError:
        if is_calibration(other) and is_recording(path):
            raise UsageError(f"{path} is a recording: flinders check {other} {path}") from None
        refuse_recording(path)
        raise
