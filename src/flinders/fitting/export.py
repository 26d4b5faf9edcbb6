"""A fit written for a target: which compass of a vehicle it goes to, and what is known of it, as comments.

A target (`flinders.targets`) writes the numbers of a calibration; here they get the origin, the claim and the limits
of their fit, and the compass that their readings came from.
"""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotExportable, UsageError, figures
from flinders.estimators import METHODS
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.fitting.good_until import good_until
from flinders.fitting.heading_model import heading_model_of
from flinders.fitting.measurement_noise import gates_of, noise_of
from flinders.fitting.verdict import headline_of
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import HeadingError, level_turn, upright
from flinders.targets import ExportOptions, mounting_table
from flinders.targets._mounting import euler
from flinders.targets._numbers import VEHICLE, unmapped
from flinders.targets._target import MOUNTINGS

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.targets import Export, Target
    from flinders.targets._mounting import Angles
    from flinders.targets._target import Trial

FITTED: Final = {"offset": "sphere", "diagonal": "axes"}
"""Method that finds no more than what a target of a kind holds."""
UPRIGHT: Final = "none"
"""What a mounting is called that turns nothing."""


def export_fit(
    fit: Fit,
    target: Target,
    *,
    compass: int | None = None,
    lossy: bool = False,
    mounting: str | None = None,
    name: str | None = None,
    noise: bool = False,
) -> tuple[Export, list[str]]:
    """Write a fit for a target.

    Raises `NotExportable` or `UnitError` if the target cannot hold it; `UsageError` if it was made from several
    compasses, and none was asked for.

    Parameters
    ----------
    compass : int, optional
        Which one of the vehicle; by default the one that its readings came from.
    mounting : str, optional
        How the compass was mounted when it was recorded, as the target has it; by default as its logs say.
    noise : bool
        Write also the noise of the compass, as parameters of the vehicle's estimator.
    lossy, name
        As for `flinders.targets.ExportOptions`.

    Returns
    -------
    Export
    list of str
        What to say of the compass that it is for; nothing where it is not known, or is the one that was asked for.
    """
    if target.compasses:
        refuse_on_top(fit, target.name)
    if target.keeps in ("rotation", "axes"):
        _refuse_left_handed(fit, target)
    number, notes = _compass_of(fit, target, compass)
    turn = mounting_of(fit, target, mounting)
    asked = ExportOptions(
        compass=number,
        lossy=lossy,
        name=name,
        mounting=turn,
        rotation_covariance=_in_the_body(fit, turn),
        gates=gates_of(fit),
        noise=noise_of(fit),
        heading=heading_model_of(fit),
        estimator=noise,
        fitting=fitting_command(fit, target),
    )
    trial = target.tried(fit.calibration, asked=asked)
    if trial.loses and asked.noise is not None:  # what the target leaves out is an error of its headings
        asked = replace(asked, noise=asked.noise.with_error(level_turn_error(fit, trial).rms))
        trial = target.tried(fit.calibration, asked=asked)
    export = trial.export([*origin_lines(fit, _held_words(fit, trial) if trial.loses else ""), *notes])
    if asked.noise is not None:
        export.fields["noise"] = asked.noise.as_dict(fit.calibration.unit)
    return export, notes


def _refuse_left_handed(fit: Fit, target: Target) -> None:
    """Raise `NotExportable` for the mounting of a sensor that was found to be left-handed."""
    for finding in fit.findings:
        if finding.code == "mirrored-axis":
            raise NotExportable(
                f"{target.title} holds how the sensor sits, and what was found is wrong: {finding.advice}",
                hint={"axes": None},
                beyond=("rotation",),
            )


def fitting_command(fit: Fit, target: Target) -> str:
    """The command that makes a fit of just what a target holds; empty where no method here makes one."""
    method = FITTED.get(target.keeps, "")
    if method not in METHODS:
        return ""
    files = shlex.join(file.name for file in fit.provenance.files if file.rows) or "RECORDING"
    return f"flinders calibrate {files} --method {method} -o {method}.json"


def _held_words(fit: Fit, trial: Trial) -> str:
    """How good headings are with what a target holds of a fit: what it leaves out is added to the claim."""
    error, claim = level_turn_error(fit, trial), fit.claim
    worst, bound = math.hypot(error.worst, claim.heading_error_deg.worst), error.worst + claim.heading_bound_deg
    within = f"95 % within {figures(bound)}°" if bound < ANY_ANGLE_DEG else "1 σ"
    return f"with what {trial.target.title} holds of it headings are good to {figures(worst)}° ({within})"


def level_turn_error(fit: Fit, trial: Trial) -> HeadingError:
    """What a level heading errs by for what a target leaves out, its mean removed, as of a vehicle that turns once."""
    claim, down = fit.claim, down_of(fit.claim.plane)
    heading, fields = level_turn(claim.known_dip_deg, down)
    corrected = trial.corrected(fields.T) @ (np.eye(3) if down is None else upright(down))
    off = np.angle(np.exp(1j * (np.arctan2(-corrected[:, 1], corrected[:, 0]) - heading)))
    off = np.rad2deg(np.angle(np.exp(1j * (off - np.angle(np.exp(1j * off).mean())))))
    return HeadingError(float(np.sqrt(np.mean(off**2))), float(np.abs(off).max()), claim.known_dip_deg)


def _compass_of(fit: Fit, target: Target, asked: int | None) -> tuple[int | None, list[str]]:
    """The compass of a vehicle that a fit goes to, and what to say of it."""
    if not target.compasses:
        return None, []
    known, devices = (known_numbers(fit, target.family, attribute) for attribute in ("compass", "device_id"))
    if not known - {asked}:
        return asked, []
    device = f" (device id {min(devices)})" if len(devices) == 1 else ""
    if asked is None:
        number = only_number(fit, known, "compass", "compass")
        return number, [f"for compass {number} of the vehicle{device}"]
    numbers = " and ".join(map(str, sorted(known)))
    return asked, [f"for compass {asked}, as asked; it was made from compass {numbers} of the vehicle{device}"]


def known_numbers(fit: Fit, autopilot: str, attribute: str) -> set[int]:
    """The ``compass`` or ``device_id`` of each file of an autopilot that a fit was made from, where it is known."""
    values = (getattr(file, attribute) for file in fit.provenance.files if file.autopilot == autopilot)
    return {value for value in values if value is not None}


def mounting_of(fit: Fit, target: Target, words: str | None) -> Floats | None:
    """(3, 3) how the compass was mounted when it was recorded; None where neither the words nor the logs say.

    Of one that sits exactly as the vehicle does the words are ``none``.
    Raises `UsageError` for words that the target does not know, or a target without mountings.
    """
    if words is not None and words.strip().casefold() == UPRIGHT and target.refuses_mounted:
        return np.eye(3)
    if words is not None:
        return mounting_table(target).read(words)
    known = known_mountings(fit, "" if target.keeps in MOUNTINGS else target.family)
    return euler(*known.pop()) if len(known) == 1 else None


def known_mountings(fit: Fit, autopilot: str = "") -> set[Angles]:
    """Roll, pitch and yaw of the compass in each log that a fit was made from, where it is known.

    `autopilot`: whose logs; any by default.
    """
    known = {file.mounting for file in fit.provenance.files if autopilot in ("", file.autopilot)}
    return {mounting for mounting in known if mounting is not None}


def only_number(fit: Fit, known: set[int], what: str, keyword: str) -> int | None:
    """The one number or device id that is known, or None where none is.

    Raises `UsageError` if there are several; its hint is the keyword that chooses one.
    """
    if len(known) > 1:
        raise UsageError(
            f"{fit.provenance.name} was made from {what} {' and '.join(map(str, sorted(known)))}: say which one it is "
            "for, or calibrate each by itself",
            hint={keyword: None},
        )
    return min(known, default=None)


def refuse_unfit(fit: Fit) -> None:
    """Refuse a fit that was refused; raises NotExportable."""
    if fit.verdict == "refused":
        raise NotExportable(
            f"{fit.provenance.name} was refused as not fit for use: record anew and calibrate again",
            beyond=(),
            verdict="refused",
        )


def refuse_on_top(fit: Fit, autopilot: str) -> None:
    """Refuse a calibration of corrected readings for an autopilot, whose own it would replace and not complete.

    Raises `NotExportable`.
    """
    logged = [file.name for file in fit.provenance.files if file.as_logged]
    if logged:
        raise NotExportable(
            f"{fit.provenance.name} was made from {logged[0]} as logged, after the calibration that was in force on "
            f"board: its numbers come on top of that one, and {autopilot} would put them in its place. Calibrate "
            "again, and not as logged",
            hint={"as_logged": None},
            beyond=(),
            as_logged=logged,
        )


def origin_lines(fit: Fit, held: str = "") -> list[str]:
    """Where the numbers come from, what is claimed of them, and what limits them.

    `held`: what is claimed of that part of them which a target holds, in words; empty where it is all.
    """
    sensor = f", sensor {fit.calibration.sensor}" if fit.calibration.sensor else ""
    until = good_until(fit)
    aged = [] if until is None else [until.brief]
    if held and not math.isnan(fit.heading_error_deg.worst):
        return [f"from {fit.provenance.name}{sensor}", held, *aged, *limit_lines(fit)]
    return [
        f"from {fit.provenance.name}{sensor}",
        *(verdict_lines(fit) if fit.evidence.is_described else limit_lines(fit)),
        *aged,
    ]


def verdict_lines(fit: Fit) -> list[str]:
    """Lines of a comment: the first sentence of the verdict, then each further limit."""
    words, code = headline_of(fit)
    return [f"the calibration is {fit.verdict}. {words}", *limit_lines(fit, but=code)]


def limit_lines(fit: Fit, but: str = "") -> list[str]:
    """What the calibration is not good for, as its file says, except for the finding of one code."""
    limits = (finding for finding in fit.findings if finding.severity == "limits" and finding.code != but)
    return [f"limited: {finding.advice}" for finding in limits]


def _in_the_body(fit: Fit, mounting: Floats | None) -> Floats | None:
    """(3, 3) rad²: covariance of how the sensor sits, in the axes of the body; None where it is not known.

    `mounting`, (3, 3): of readings in the sensor's axes, into which those of the calibration are turned afterwards; of
    readings in the axes of the vehicle, the calibration's own mapping is undone.
    """
    aiding, calibration = fit.evidence.aiding, fit.calibration
    covariance = None if aiding is None else aiding.rotation_covariance
    if covariance is None or not np.isfinite(covariance).all():
        return None
    after = np.eye(3) if mounting is None else mounting
    turn = unmapped(calibration) if calibration.frame == VEHICLE else after
    turned: Floats = turn @ covariance @ turn.T
    return turned
