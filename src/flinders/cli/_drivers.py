"""What drives an offset, on the command line: readings are settled before anything else is done with them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from flinders.cli._program import GOOD, LIMITED
from flinders.cli._talk import print_json, say
from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Settler
    from flinders.core.samples import Recording
    from flinders.estimators.static_bench import Still
    from flinders.fitting.judged import Judged

hold = click.option(
    "--hold", "held", multiple=True, metavar="NAME=VALUE",
    help="Take the calibration at a fixed current (A), throttle (0 to 1) or temperature (°C).",
)  # fmt: skip


def values_of(held: Iterable[str]) -> dict[str, float]:
    """Read ``--hold``.

    Raises
    ------
    UsageError
        For what is no driver or no number.

    Examples
    --------
    >>> values_of(["current=12.5", "throttle1=0"])
    {'current': 12.5, 'throttle1': 0.0}
    """
    from flinders.core.disturbance import BY_KEY, KINDS

    names = set(BY_KEY.values())

    values: dict[str, float] = {}
    for text in held:
        name, separator, number = (part.strip() for part in text.partition("="))
        if name not in names or not separator:
            raise UsageError(f"--hold {text!r}: need {', '.join(KINDS)} with a value, such as current=0")
        try:
            values[name] = float(number)
        except ValueError:
            raise UsageError(f"--hold {text!r}: {number!r} is no number") from None
    return values


def settler_of(judged: Judged, held: Iterable[str]) -> tuple[Judged, Settler]:
    """A calibration of settled readings, and what settles them; at fixed values where ``--hold`` says so."""
    from flinders.core.compensation import Settler

    settler = Settler(holding(judged.calibration, held))
    return replace(judged, calibration=settler.calibration.at()), settler


def holding(calibration: Calibration, held: Iterable[str]) -> Calibration:
    """The calibration at the values that ``--hold`` gives, and what that costs at the far end of each range."""
    values = values_of(held)
    for driver in calibration.drivers:
        if driver.name in values:
            value = values[driver.name]
            away = driver.farthest - value
            cost = calibration.driven_deg(driver, driver.reference + away)
            say(
                f"taken at {driver.amount(value)} of {driver.name}: at {driver.amount(driver.farthest)}, which it was "
                f"made for too, headings are off by up to {figures(min(cost, 180.0))}° (dip 60°)"
            )
    return calibration.holding(**values)


def say_beyond(settler: Settler | None) -> dict[str, Any]:
    """Say what lay outside the range that a driver was found in; the same for JSON, where there are drivers."""
    from flinders.fitting.verdict import of_extrapolation

    if settler is None or not settler.calibration.drivers:
        return {}
    findings = list(of_extrapolation(settler.calibration, settler.beyond))
    for finding in findings:
        say(f"! {finding.advice}")
    return {"findings": [finding.as_dict() for finding in findings]}


def say_references(judged: Judged) -> None:
    """Say where a calibration is taken that follows something, for a command that looks at offset and matrix only."""
    for driver in judged.calibration.drivers:
        cost = figures(min(judged.calibration.driven_deg(driver), 180.0))
        say(
            f"{judged.name} follows {driver.name}: it is taken at {driver.amount(driver.reference)}; what it "
            f"follows is up to {cost}° of heading at {driver.amount(driver.farthest)}"
        )


def say_difference(a: Judged, b: Judged) -> None:
    """Say where two calibrations are compared that follow something, and how far apart what they follow is."""
    for judged in (a, b):
        say_references(judged)
    theirs = {driver.name: driver for driver in b.calibration.drivers}
    for driver in a.calibration.drivers:
        other = theirs.get(driver.name)
        if other is not None:
            between = replace(driver, per_unit=other.per_unit - driver.per_unit)
            cost = figures(min(a.calibration.driven_deg(between), 180.0))
            say(
                f"what both follow of {driver.name} differs by up to {cost}° of heading at "
                f"{driver.amount(driver.farthest)}"
            )


def asked_for(words: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split what ``--with`` names into drivers and all else.

    >>> asked_for(["currents,rate", "temperature,throttle2"])
    (('currents', 'temperature', 'throttle2'), ('rate',))
    """
    from flinders.core.disturbance import BY_KEY, MOTORS

    known = {*BY_KEY.values(), *MOTORS.values()}

    names = [name.strip() for text in words for name in text.split(",") if name.strip()]
    drivers = tuple(dict.fromkeys(name for name in names if name in known))
    return drivers, tuple(dict.fromkeys(name for name in names if name not in known))


def add(options: dict[str, Any], words: Iterable[str], previous: str | None) -> None:
    """Put what ``--with`` names among the options of a fit.

    Raises
    ------
    UsageError
        For what nothing is known of, or ``--previous`` with no driver.
    """
    from flinders.core.disturbance import KINDS, MOTORS

    drivers, others = asked_for(words)
    if others:
        from flinders.fitting.aid_selection import AIDS, AUTO

        allowed = ", ".join((AUTO, *AIDS, *KINDS, *MOTORS.values()))
        raise UsageError(
            f"--with {others[0]}: need one of {allowed} (rate is that of a gyro; currents and throttles are those of "
            "each motor, and current2 that of one)"
        )
    if previous is not None and not drivers:
        raise UsageError(
            "--previous goes with --with current, currents, throttle, throttles or temperature: say which to find"
        )
    if drivers:
        options["drivers"] = drivers


def bench(
    recording: Recording, drivers: tuple[str, ...], previous: str, output: str | None, *, force: bool, as_json: bool
) -> int:
    """Find what drives a sensor that was not turned, and put it onto a calibration of that sensor.

    Raises
    ------
    NotTurned
        Where no driver changed, so that there is nothing to find.
    UsageError
        For a calibration of another unit or other axes.
    """
    from flinders.core.samples import singles
    from flinders.core.units import label
    from flinders.errors import NotTurned
    from flinders.estimators.static_bench import described, still
    from flinders.fitting.judged import Judged
    from flinders.fitting.verdict import of_alike, of_column, of_noisy

    parts = list(singles(recording))
    found = still(parts, drivers)
    if found is None or not found.drivers:
        raise NotTurned(0.0 if found is None else found.noise, " and ".join(drivers))
    unit = label(recording.unit.inside)
    say(described(found, unit))
    known = Judged.load(previous)
    refuse_other_axes(known.calibration, parts, previous)
    calibration = found.onto(known.calibration)
    alone = "; it alone running" if len(found.drivers) > 1 else ""
    for driver in found.drivers:
        cost = figures(min(calibration.driven_deg(driver), 180.0))
        left = figures(_left_deg(found, calibration, driver.name))
        far = driver.amount(driver.farthest)
        say(f"{driver} ({unit}): up to {cost}° of heading at {far}, {left}° of it left (1 σ; dip 60°{alone})")
    findings = [
        *found.findings,
        *of_alike(found.driven),
        *of_noisy(found.driven),
        *(finding for driven in found.driven for finding in of_column(driven)),
    ]
    for finding in findings:
        say(f"! {finding.advice}")
    _save(calibration, known, output, force=force)
    if as_json:
        print_json(
            {
                "calibration": calibration.as_dict(),
                "noise": found.noise,
                "turned": False,
                "driven": [driven.as_dict() for driven in found.driven],
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


def _left_deg(found: Still, calibration: Calibration, name: str) -> float:
    """Heading error (1 σ) that the uncertainty of a driver leaves at the far end of its range, at the worst."""
    import numpy as np

    place = [driver.name for driver in found.drivers].index(name)
    driver = found.drivers[place]
    block = found.covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
    sigma = float(np.sqrt(np.linalg.eigvalsh(calibration.matrix @ block @ calibration.matrix.T)[-1]))
    away = abs(driver.farthest - driver.reference) * sigma / calibration.field_strength
    return float(np.rad2deg(away / np.cos(np.deg2rad(60.0))))


def _save(calibration: Calibration, known: Judged, output: str | None, *, force: bool) -> None:
    """Write a calibration with the drivers it follows now, and all else that is known of it."""
    from flinders.core.calibration_file import dumps, write

    if output is None:
        say("nothing was written: name a file with -o calibration.json")
        return
    from flinders.core.calibration_file import read

    before = read(known.name)
    document = calibration.to_document(fit=before.fit, provenance=before.provenance)
    if output == "-":
        click.echo(dumps(document), nl=False)
        return
    write(document, output, force=force)
    say(f"written to {output}: {known.name}, which follows {' and '.join(d.name for d in calibration.drivers)} now")


def seen(recording: Recording, settler: Settler) -> Settler:
    """Go through a recording for what lies outside the range that a driver was found in."""
    if settler.calibration.drivers:
        from flinders.core.compensation import Settler
        from flinders.core.samples import singles

        for part in singles(recording):
            watch = Settler(settler.calibration, settler.beyond)
            for block in part.blocks():
                watch(block)
    return settler
