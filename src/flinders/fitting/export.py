"""Export of a fit to a target, for a compass of a vehicle, with the claim and limits of the fit as comments.

A target (`flinders.targets`) writes the numbers of a calibration. This module adds the origin, claim and limits of the
fit, and the compass of its readings.
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
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import HeadingError, level_turn, upright
from flinders.targets import ExportOptions, mounting_table
from flinders.targets._mounting import euler
from flinders.targets._numbers import VEHICLE, unmapping_matrix
from flinders.targets._target import MOUNTING_KINDS

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.targets import Export, Target
    from flinders.targets._mounting import Angles
    from flinders.targets._target import Trial

METHODS_BY_TARGET_KIND: Final = {"offset": "sphere", "diagonal": "axes"}
"""Method that estimates exactly the parameters that a target holds, by the kind of the target."""
NO_ROTATION: Final = "none"
"""Word for a mounting without rotation."""


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
    """Export a fit to a target; returns the export, and sentences on the compass that it is meant for.

    Raises `NotExportable` or `UnitError` if the target cannot hold the fit; `UsageError` if the fit has readings of
    several compasses and `compass` is not given.

    Parameters
    ----------
    compass : int, optional
        Number of the compass of the vehicle; by default that of the compass that was recorded.
    mounting : str, optional
        Mounting of the compass during the recording, in the target's words; by default that in the logs.
    noise : bool
        Also write the noise of the compass, as parameters of the vehicle's estimator.
    lossy, name
        As for `flinders.targets.ExportOptions`.

    Returns
    -------
    Export
    list of str
        Sentences on the compass; empty if the compass is unknown, or if it was requested.
    """
    if target.compasses:
        refuse_on_top(fit, target.name)
    if target.keeps in ("rotation", "axes"):
        _refuse_left_handed(fit, target)
    number, notes = _compass_of(fit, target, compass)
    turn = mounting_of(fit, target, mounting)
    asked = replace(
        options_of_claim(fit),
        compass=number,
        lossy=lossy,
        name=name,
        mounting=turn,
        rotation_covariance=_mounting_covariance(fit, turn),
        estimator=noise,
        fitting=fitting_command(fit, target),
    )
    trial = target.try_formula(fit.calibration, asked=asked)
    if trial.loses and asked.noise is not None:  # parameters that the target does not hold are an error of its headings
        asked = replace(asked, noise=asked.noise.with_error(level_turn_error(fit, trial).rms))
        trial = target.try_formula(fit.calibration, asked=asked)
    export = trial.export([*origin_lines(fit, _accuracy_words(fit, trial) if trial.loses else ""), *notes])
    if asked.noise is not None:
        export.fields["noise"] = asked.noise.as_dict(fit.calibration.unit)
    return export, notes


def options_of_claim(fit: Fit) -> ExportOptions:
    """Options by which generated code states the claim of a fit: gates, noise and the error of each heading."""
    return ExportOptions(gates=gates_of(fit), noise=noise_of(fit), heading=heading_model_of(fit))


def _refuse_left_handed(fit: Fit, target: Target) -> None:
    """Raise `NotExportable` for a target that needs the mounting, if the axes of the sensor are left-handed."""
    for finding in fit.findings:
        if finding.code == "mirrored-axis":
            raise NotExportable(
                f"{target.title} needs the mounting of the sensor, and the fit found a wrong mounting: "
                f"{finding.advice}",
                hint={"axes": None},
                beyond=("rotation",),
            )


def fitting_command(fit: Fit, target: Target) -> str:
    """Command line that fits exactly the parameters of a target; empty if no method does."""
    method = METHODS_BY_TARGET_KIND.get(target.keeps, "")
    if method not in METHODS:
        return ""
    files = shlex.join(file.name for file in fit.provenance.files if file.rows) or "RECORDING"
    return f"flinders calibrate {files} --method {method} -o {method}.json"


def _accuracy_words(fit: Fit, trial: Trial) -> str:
    """Heading error in words if only the parameters that a target holds are corrected."""
    error, claim = level_turn_error(fit, trial), fit.claim
    worst, bound = math.hypot(error.worst, claim.heading_error_deg.worst), error.worst + claim.heading_bound_deg
    within = f"95 % within {figures(bound)}°" if bound < ANY_ANGLE_DEG else "1 σ"
    return f"with the parameters that {trial.target.title} holds, headings are good to {figures(worst)}° ({within})"


def level_turn_error(fit: Fit, trial: Trial) -> HeadingError:
    """Level heading error from the parameters that a target does not hold, without the mean over one turn."""
    claim, down = fit.claim, down_direction(fit.claim.plane)
    heading, fields = level_turn(claim.known_dip_deg, down)
    corrected = trial.corrected(fields.T) @ (np.eye(3) if down is None else upright(down))
    off = np.angle(np.exp(1j * (np.arctan2(-corrected[:, 1], corrected[:, 0]) - heading)))
    off = np.rad2deg(np.angle(np.exp(1j * (off - np.angle(np.exp(1j * off).mean())))))
    return HeadingError(float(np.sqrt(np.mean(off**2))), float(np.abs(off).max()), claim.known_dip_deg)


def _compass_of(fit: Fit, target: Target, asked: int | None) -> tuple[int | None, list[str]]:
    """Number of the compass that a fit is for, and sentences on it."""
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
    return asked, [f"for compass {asked}, as requested; the readings are of compass {numbers} of the vehicle{device}"]


def known_numbers(fit: Fit, autopilot: str, attribute: str) -> set[int]:
    """Known values of ``compass`` or ``device_id`` in those logs of a fit that come from an autopilot."""
    values = (getattr(file, attribute) for file in fit.provenance.files if file.autopilot == autopilot)
    return {value for value in values if value is not None}


def mounting_of(fit: Fit, target: Target, words: str | None) -> Floats | None:
    """(3, 3) rotation by the mounting of the compass during the recording, from `words` or else from the logs.

    None if neither states it. The word for a mounting without rotation is ``none``. Raises `UsageError` for unknown
    words, or a target without mountings.
    """
    if words is not None and words.strip().casefold() == NO_ROTATION and target.refuses_mounted:
        return np.eye(3)
    if words is not None:
        return mounting_table(target).read(words)
    known = known_mountings(fit, "" if target.keeps in MOUNTING_KINDS else target.family)
    return euler(*known.pop()) if len(known) == 1 else None


def known_mountings(fit: Fit, autopilot: str = "") -> set[Angles]:
    """Known mountings in the logs of a fit, as roll, pitch and yaw in degrees.

    `autopilot` selects logs of this autopilot; by default all logs are used.
    """
    known = {file.mounting for file in fit.provenance.files if autopilot in ("", file.autopilot)}
    return {mounting for mounting in known if mounting is not None}


def only_number(fit: Fit, known: set[int], what: str, keyword: str) -> int | None:
    """The number or device id in `known`; None if it is empty.

    Raises `UsageError` for several numbers; the hint of the error is the keyword that selects one.
    """
    if len(known) > 1:
        raise UsageError(
            f"{fit.provenance.name} was made from {what} {' and '.join(map(str, sorted(known)))}: choose one of them, "
            "or calibrate each separately",
            hint={keyword: None},
        )
    return min(known, default=None)


def refuse_unfit(fit: Fit) -> None:
    """Raise `NotExportable` for a fit with the verdict ``refused``."""
    if fit.verdict == "refused":
        raise NotExportable(
            f"{fit.provenance.name} was refused as not fit for use: record anew and calibrate again",
            beyond=(),
            verdict="refused",
        )


def refuse_on_top(fit: Fit, autopilot: str) -> None:
    """Raise `NotExportable` for an autopilot if the fit is of readings that the autopilot had already corrected.

    The autopilot would replace its own calibration by one that must be applied in addition to it.
    """
    logged = [file.name for file in fit.provenance.files if file.as_logged]
    if logged:
        raise NotExportable(
            f"{fit.provenance.name} was made from {logged[0]} with the readings as logged, which the calibration on "
            f"board had already corrected. Its numbers add to that calibration, but {autopilot} would replace that "
            "calibration by them. Calibrate again without the option for readings as logged",
            hint={"as_logged": None},
            beyond=(),
            as_logged=logged,
        )


def origin_lines(fit: Fit, held: str = "") -> list[str]:
    """Lines on the origin of a fit, its claim and its limits.

    `held` is the claim in words for the parameters that a target holds; empty if the target holds all.
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
    """Lines on the verdict: its first sentence, then each further limit."""
    words, code = headline_of(fit)
    return [f"the calibration is {fit.verdict}. {words}", *limit_lines(fit, but=code)]


def limit_lines(fit: Fit, but: str = "") -> list[str]:
    """Lines on the limits of a calibration, as in its file, except for the finding with the code `but`."""
    limits = (finding for finding in fit.findings if finding.severity == "limits" and finding.code != but)
    return [f"limited: {finding.advice}" for finding in limits]


def _mounting_covariance(fit: Fit, mounting: Floats | None) -> Floats | None:
    """(3, 3) covariance of the sensor's mounting in rad², in body axes; None if unknown.

    `mounting` is the (3, 3) rotation by the mounting, for readings that were recorded in the sensor's axes. It is None
    for readings in the axes of the vehicle; the calibration's own mapping of axes is then undone.
    """
    aiding, calibration = fit.evidence.aiding, fit.calibration
    covariance = None if aiding is None else aiding.rotation_covariance
    if covariance is None or not np.isfinite(covariance).all():
        return None
    after = np.eye(3) if mounting is None else mounting
    turn = unmapping_matrix(calibration) if calibration.frame == VEHICLE else after
    turned: Floats = turn @ covariance @ turn.T
    return turned
