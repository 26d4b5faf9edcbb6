"""Calibration of a sensor that is not turned: from six typed extremes, or of its disturbances on a bench."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flinders.cli._inputs import load, provenance
from flinders.cli._output import Outputs, cost_words, print_json, say
from flinders.cli._program import GOOD, LIMITED, numbers_of
from flinders.cli._spelling import in_options
from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.cli import _options as option
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit


def calibrate_typed(
    numbers: str, method_options: Iterable[str], reading: option.ReadingOptions, outputs: Outputs, asked: dict[str, Any]
) -> int:
    """``--minmax``: calibrate from six typed numbers, write the calibration and print its page."""
    from flinders.cli.methods import parse_options
    from flinders.core.axes import Axes
    from flinders.core.calibration_file import dumps
    from flinders.core.units import Unit
    from flinders.estimators.minmax import MinMax
    from flinders.fitting.axis_extremes import from_extremes
    from flinders.report.fit_pages import page_of_extremes

    own = parse_options(method_options, MinMax)
    if own.pop("trim", False):
        raise UsageError("--option trim=yes needs readings, and --minmax gives none: leave that option out")
    outputs.check()
    values = numbers_of(numbers)
    if not values:
        raise UsageError(f"--minmax {numbers!r}: need six numbers, such as -157,98,-123,124,-109,101")
    unit = Unit.of(reading.unit or "counts", reading.scale)
    extremes = from_extremes(values, unit=unit, axes=Axes.of(reading.axes), **asked, **own)
    outputs.write(dumps(extremes.to_document(provenance())), outputs.files[0].path)
    outputs.print(extremes.as_dict, lambda: page_of_extremes(extremes, in_options))
    outputs.say_written("nothing was written: name a file with -o calibration.json")
    return LIMITED


def calibrate_on_bench(
    parts: Sequence[Recording], disturbances: tuple[str, ...], previous: str, outputs: Outputs
) -> int:
    """Fit the disturbances of a sensor that was held still, and add them to a calibration of that sensor."""
    from flinders.core.units import unit_label
    from flinders.estimators.static_bench import still_message
    from flinders.workflows.bench import fit_bench

    known = load("calibrate --previous", previous)
    _refuse_other_axes(known.calibration, parts, previous)
    found = fit_bench(list(parts), known, disturbances)
    unit = unit_label(parts[0].unit.inside)
    say(still_message(found.still, unit))
    alone = "; with only that load" if len(found.residual_deg) > 1 else ""
    for disturbance in found.still.disturbances:
        left = figures(found.residual_deg[disturbance.name])
        cost = cost_words(found.calibration, disturbance)
        say(f"{disturbance} ({unit}): {cost}, {left}° of it left (1 σ; dip 60°{alone})")
    for finding in found.findings:
        say(f"! {finding.advice}")
    _save(found.calibration, known, outputs)
    if outputs.as_json:
        print_json(found.as_dict())
    return LIMITED if found.findings else GOOD


def _refuse_other_axes(calibration: Calibration, parts: Sequence[Recording], path: str) -> None:
    """Refuse a calibration in another unit or other axes than the recording."""
    for part in parts:
        if (part.unit.inside, part.axes) != (calibration.unit, calibration.axes):
            raise UsageError(
                f"{path} is for readings in {calibration.unit}, axes {calibration.axes}; {part.source} is in "
                f"{part.unit.inside}, axes {part.axes}: read the recording with the same --unit, --scale and --axes"
            )


def _save(calibration: Calibration, known: Fit, outputs: Outputs) -> None:
    """Write a calibration with its new disturbances, and with the fit and provenance of the previous file."""
    from flinders.core.calibration_file import dumps, read

    output = outputs.files[0].path
    before = read(known.provenance.name)
    outputs.write(dumps(calibration.to_document(fit=before.fit, provenance=before.provenance)), output)
    if output is None:
        say("nothing was written: name a file with -o calibration.json")
    elif output != "-":
        names = " and ".join(each.name for each in calibration.disturbances)
        say(f"written to {output}: {known.provenance.name}, now with {names}")
