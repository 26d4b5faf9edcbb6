"""What drives an offset, on the command line: readings are settled before anything else is done with them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from flinders.cli._output import Outputs, print_json, say
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Compensator
    from flinders.core.disturbance import Disturbance
    from flinders.core.samples import Recording
    from flinders.estimators.static_bench import Still
    from flinders.fitting.result import Fit


def values_of(fixed: Iterable[str]) -> dict[str, float]:
    """Read ``--fix``.

    Raises
    ------
    UsageError
        For what is no disturbance or no number.

    Examples
    --------
    >>> values_of(["current=12.5", "throttle1=0"])
    {'current': 12.5, 'throttle1': 0.0}
    """
    from flinders.core.disturbance import BY_KEY, KINDS

    names = set(BY_KEY.values())

    values: dict[str, float] = {}
    for text in fixed:
        name, separator, number = (part.strip() for part in text.partition("="))
        if name not in names or not separator:
            raise UsageError(f"--fix {text!r}: need {', '.join(KINDS)} with a value, such as current=0")
        try:
            values[name] = float(number)
        except ValueError:
            raise UsageError(f"--fix {text!r}: {number!r} is no number") from None
    return values


def settler_of(fit: Fit, fixed: Iterable[str]) -> tuple[Fit, Compensator]:
    """A calibration of settled readings, and what settles them; at fixed values where ``--fix`` says so."""
    from flinders.core.compensation import Compensator

    settler = Compensator(holding(fit.calibration, fixed))
    return replace(fit, calibration=settler.calibration.at()), settler


def holding(calibration: Calibration, fixed: Iterable[str]) -> Calibration:
    """The calibration at the values that ``--fix`` gives, and what that costs at the far end of each range."""
    values = values_of(fixed)
    for disturbance in calibration.disturbances:
        if disturbance.name in values:
            value = values[disturbance.name]
            away = disturbance.farthest - value
            cost = calibration.disturbance_deg(disturbance, disturbance.reference + away)
            say(
                f"taken at {disturbance.amount(value)} of {disturbance.name}: at "
                f"{disturbance.amount(disturbance.farthest)}, which it was made for too, "
                f"headings are off by up to {figures(min(cost, 180.0))}° (dip 60°)"
            )
    return calibration.holding(**values)


def say_beyond(settler: Compensator | None) -> dict[str, Any]:
    """Say what lay outside the range that a disturbance was found in; the same for JSON, where there are any."""
    from flinders.fitting.verdict import of_extrapolation

    if settler is None or not settler.calibration.disturbances:
        return {}
    findings = list(of_extrapolation(settler.calibration, settler.beyond))
    for finding in findings:
        say(f"! {finding.advice}")
    return {"findings": [finding.as_dict() for finding in findings]}


def cost_words(calibration: Calibration, disturbance: Disturbance) -> str:
    """Heading error that a disturbance makes at the far end of its range, at a dip of 60°."""
    cost = figures(min(calibration.disturbance_deg(disturbance), 180.0))
    return f"up to {cost}° of heading at {disturbance.amount(disturbance.farthest)}"


def say_references(fit: Fit) -> None:
    """Say where a calibration is taken that follows something, for a command that looks at offset and matrix only."""
    for disturbance in fit.calibration.disturbances:
        say(
            f"{fit.name} follows {disturbance.name}: it is taken at {disturbance.amount(disturbance.reference)}; "
            f"what it follows is {cost_words(fit.calibration, disturbance)}"
        )


def say_difference(a: Fit, b: Fit) -> None:
    """Say where two calibrations are compared that follow something, and how far apart what they follow is."""
    for fit in (a, b):
        say_references(fit)
    theirs = {disturbance.name: disturbance for disturbance in b.calibration.disturbances}
    for disturbance in a.calibration.disturbances:
        other = theirs.get(disturbance.name)
        if other is not None:
            between = replace(disturbance, per_unit=other.per_unit - disturbance.per_unit)
            say(f"what both follow of {disturbance.name} differs by {cost_words(a.calibration, between)}")


def bench(recording: Recording, disturbances: tuple[str, ...], previous: str, outputs: Outputs) -> int:
    """Find what drives a sensor that was not turned, and put it onto a calibration of that sensor.

    Raises
    ------
    NotTurned
        Where no disturbance changed, so that there is nothing to find.
    UsageError
        For a calibration of another unit or other axes.
    """
    from flinders.core.samples import singles
    from flinders.core.units import label
    from flinders.errors import NotTurned
    from flinders.estimators.static_bench import described, still
    from flinders.fitting.result import Fit
    from flinders.fitting.verdict import of_alike, of_column, of_noisy

    parts = list(singles(recording))
    result = still(parts, disturbances)
    if result is None or not result.disturbances:
        raise NotTurned(0.0 if result is None else result.noise, " and ".join(disturbances))
    unit = label(recording.unit.inside)
    say(described(result, unit))
    known = Fit.load(previous)
    refuse_other_axes(known.calibration, parts, previous)
    calibration = result.onto(known.calibration)
    alone = "; it alone running" if len(result.disturbances) > 1 else ""
    for disturbance in result.disturbances:
        left = figures(_left_deg(result, calibration, disturbance.name))
        say(f"{disturbance} ({unit}): {cost_words(calibration, disturbance)}, {left}° of it left (1 σ; dip 60°{alone})")
    findings = [
        *result.findings,
        *of_alike(result.estimates),
        *of_noisy(result.estimates),
        *(finding for estimate in result.estimates for finding in of_column(estimate)),
    ]
    for finding in findings:
        say(f"! {finding.advice}")
    _save(calibration, known, outputs)
    if outputs.as_json:
        print_json(
            {
                "calibration": calibration.as_dict(),
                "noise": result.noise,
                "turned": False,
                "driven": [estimate.as_dict() for estimate in result.estimates],
                "findings": [finding.as_dict() for finding in findings],
            }
        )
    return LIMITED if findings else GOOD


def refuse_other_axes(calibration: Calibration, parts: Sequence[Recording], path: str) -> None:
    """Refuse a calibration whose unit or axes are not those of the recording.

    Raises
    ------
    UsageError
    """
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


def seen(recording: Recording, settler: Compensator) -> Compensator:
    """Go through a recording for what lies outside the range that a disturbance was found in."""
    if settler.calibration.disturbances:
        from flinders.core.compensation import Compensator
        from flinders.core.samples import singles

        for part in singles(recording):
            watch = Compensator(settler.calibration, settler.beyond)
            for block in part.blocks():
                watch(block)
    return settler
