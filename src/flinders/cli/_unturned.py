"""Calibrations without a recording of a turn: from six typed extremes, or of disturbances on a bench."""

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
    from flinders.estimators.static_bench import Still
    from flinders.findings import Finding
    from flinders.fitting.result import Fit


def typed(
    numbers: str, method_options: Iterable[str], reading: option.ReadingOptions, outputs: Outputs, asked: dict[str, Any]
) -> int:
    """``--minmax``: calibrate from six typed numbers, write it and say what is known of it."""
    from flinders.cli.methods import parsed
    from flinders.core.axes import Axes
    from flinders.core.calibration_file import dumps
    from flinders.core.units import Unit
    from flinders.estimators.minmax import MinMax
    from flinders.fitting.axis_extremes import from_extremes
    from flinders.report.fit_pages import of_extremes

    own = parsed(method_options, MinMax)
    if own.pop("trim", False):
        raise UsageError("--option trim=yes needs readings, and --minmax has none: leave it out")
    outputs.check()
    values = numbers_of(numbers)
    if not values:
        raise UsageError(f"--minmax {numbers!r}: need six numbers, such as -157,98,-123,124,-109,101")
    unit = Unit.of(reading.unit or "counts", reading.scale)
    extremes = from_extremes(values, unit=unit, axes=Axes.of(reading.axes), **asked, **own)
    outputs.write(dumps(extremes.to_document(provenance())), outputs.files[0].path)
    outputs.print(extremes.as_dict, lambda: of_extremes(extremes, in_options))
    outputs.say_written("nothing was written: name a file with -o calibration.json")
    return LIMITED


def bench(parts: Sequence[Recording], disturbances: tuple[str, ...], previous: str, outputs: Outputs) -> int:
    """Find the disturbances of a sensor that was not turned, and put them onto a calibration of that sensor."""
    from flinders.core.units import label
    from flinders.errors import NotTurned
    from flinders.estimators.static_bench import described, still

    result = still(parts, disturbances)
    if result is None or not result.disturbances:
        raise NotTurned(0.0 if result is None else result.noise, " and ".join(disturbances))
    unit = label(parts[0].unit.inside)
    say(described(result, unit))
    known = load("calibrate --previous", previous)
    _refuse_other_axes(known.calibration, parts, previous)
    calibration = result.onto(known.calibration)
    alone = "; it alone running" if len(result.disturbances) > 1 else ""
    for disturbance in result.disturbances:
        left = figures(_left_deg(result, calibration, disturbance.name))
        say(f"{disturbance} ({unit}): {cost_words(calibration, disturbance)}, {left}° of it left (1 σ; dip 60°{alone})")
    findings = _findings(result)
    for finding in findings:
        say(f"! {finding.advice}")
    _save(calibration, known, outputs)
    if outputs.as_json:
        print_json(
            {
                "calibration": calibration.as_dict(),
                "noise": result.noise,
                "turned": False,
                "disturbances": [estimate.as_dict() for estimate in result.estimates],
                "findings": [finding.as_dict() for finding in findings],
            }
        )
    return LIMITED if findings else GOOD


def _findings(result: Still) -> list[Finding]:
    """What limits disturbances that were found on a bench."""
    from flinders.fitting.verdict import of_alike, of_column, of_noisy

    of_columns = [finding for estimate in result.estimates for finding in of_column(estimate)]
    return [*result.findings, *of_alike(result.estimates), *of_noisy(result.estimates), *of_columns]


def _refuse_other_axes(calibration: Calibration, parts: Sequence[Recording], path: str) -> None:
    """Refuse a calibration whose unit or axes are not those of the recording."""
    for part in parts:
        if (part.unit.inside, part.axes) != (calibration.unit, calibration.axes):
            raise UsageError(
                f"{path} is for readings in {calibration.unit}, axes {calibration.axes}; {part.source} is in "
                f"{part.unit.inside}, axes {part.axes}: read it with the same --unit, --scale and --axes"
            )


def _left_deg(still: Still, calibration: Calibration, name: str) -> float:
    """Heading error (1 σ) that the uncertainty of a disturbance leaves at the far end of its range, at the worst."""
    import numpy as np

    place = [disturbance.name for disturbance in still.disturbances].index(name)
    disturbance = still.disturbances[place]
    block = still.covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
    sigma = float(np.sqrt(np.linalg.eigvalsh(calibration.matrix @ block @ calibration.matrix.T)[-1]))
    away = abs(disturbance.farthest - disturbance.reference) * sigma / calibration.field_strength
    return float(np.rad2deg(away / np.cos(np.deg2rad(60.0))))


def _save(calibration: Calibration, known: Fit, outputs: Outputs) -> None:
    """Write a calibration with the disturbances it follows now, and all else that is known of it."""
    from flinders.core.calibration_file import dumps, read

    output = outputs.files[0].path
    before = read(known.name)
    outputs.write(dumps(calibration.to_document(fit=before.fit, provenance=before.provenance)), output)
    if output is None:
        say("nothing was written: name a file with -o calibration.json")
    elif output != "-":
        names = " and ".join(each.name for each in calibration.disturbances)
        say(f"written to {output}: {known.name}, which follows {names} now")
