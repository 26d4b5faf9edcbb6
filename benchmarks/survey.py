"""Accuracy of calibrations of survey instruments: errors compared with the bound and with claims.

    python -m benchmarks.survey [--trials 200] [--shots 24] [--aim 0.1] [--curve 0.03 [--linear]] [--recordings FOLDER]

Instruments have gain errors of up to 2 %, axis errors of up to 1°, offsets of up to a tenth, and noise of
0.2 % of the field and of gravity; shots are aimed to 0.1° (1 σ about each axis). Errors are those of shots
within 30° of level at all azimuths and rolls, root mean square. The bound is the Cramér-Rao bound at the true
parameters and noises, with the prior of the fit, at least 10 % and 20°. Ratios are root mean squares over the trials: 1
for an efficient estimate, and for true claims.

`--curve` gives each axis of accelerometers a nonlinearity of up to this share of gravity at 1 g, and fits quadratic
terms; `--linear` fits none.

`--recordings` fits real shots too: a folder of JSON files of mag-cal, such as tests/fixtures/SAP6 of
https://github.com/furbrain/CircuitPython_mag_cal (four instruments aimed at the same two targets).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.apps.survey.calibration import fit_survey
from flinders.apps.survey.instrument import ROLLS_DEG
from flinders.apps.survey.pointing_error import (
    AZIMUTHS_DEG,
    INCLINATIONS_DEG,
    angle_gradients,
    attitudes_of,
    invert_quadratic,
    pointing_errors,
)
from flinders.apps.survey.shots import read_shots
from flinders.apps.survey.simulate_shots import survey_shots, true_angles
from flinders.geometry.angles import wrap_180
from flinders.likelihood.parameters import Parameters
from flinders.likelihood.pointing import MIN_AIM_SIGMA_RAD, SurveyParameters, SurveyProblem
from flinders.likelihood.solver import Equations, Iterate

if TYPE_CHECKING:
    from flinders.apps.survey.calibration import SurveyFit
    from flinders.apps.survey.simulate_shots import SimulatedSurvey
    from flinders.arrays import Floats
    from flinders.simulate import Sensor

SHOTS: Final = (12, 24, 56)
NOISE: Final = 0.002
POSES: Final = tuple(axis.ravel() for axis in np.meshgrid(AZIMUTHS_DEG, INCLINATIONS_DEG, ROLLS_DEG, indexing="ij"))
SAP6_AXES: Final = ("x,y,-z", "-y,-x,z")
"""Axes of the magnetometer and of the accelerometer of a SAP6."""


class Trial(NamedTuple):
    """Errors of one fit in degrees, rms: (2,) for azimuth and inclination, with their claim and bound."""

    error: Floats
    claim: Floats
    bound: Floats
    is_good: bool


def main() -> None:
    """Print the table, and a line for each real recording."""
    parser = argparse.ArgumentParser(description="How good a calibration of a survey instrument is.")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--aim", type=float, default=0.1, metavar="DEG")
    parser.add_argument("--shots", type=int, nargs="*", default=SHOTS)
    parser.add_argument("--curve", type=float, default=0.0, metavar="SHARE")
    parser.add_argument("--linear", action="store_true")
    parser.add_argument("--recordings", type=Path)
    options = parser.parse_args()
    if options.recordings is not None:
        for path in sorted(options.recordings.glob("*.json")):
            fit = fit_survey(read_shots(path, axes=SAP6_AXES[0], acceleration_axes=SAP6_AXES[1]))
            print(path.stem, fit, _means(fit))
        return
    non_linear = options.curve > 0.0 and not options.linear
    print("| shots | angle | error ÷ bound | error ÷ claim | error, ° | claim, ° | good |")
    print("|---:|---|---:|---:|---:|---:|---:|")
    for shots in options.shots:
        trials = [tried(seed, shots, options.aim, options.curve, non_linear) for seed in range(options.trials)]
        for angle, name in enumerate(("azimuth", "inclination")):
            print(f"| {shots} | {name} | {_row(trials, angle)} |", flush=True)


def tried(seed: int, shots: int, aim_deg: float, curve: float, non_linear: bool) -> Trial:
    """Simulate an instrument, fit it, and compare with the truth."""
    simulated = survey_shots(seed, shots=shots, noise=NOISE, aim_deg=aim_deg)
    quadratic = np.random.default_rng([seed, 9]).uniform(-curve, curve, 3)
    bent = replace(simulated.shots, gravity=invert_quadratic(simulated.shots.gravity, quadratic))
    fit = fit_survey(bent, non_linear=non_linear)
    claim = np.array([fit.azimuth_error_deg.rms, fit.inclination_error_deg.rms])
    bound = bound_deg(simulated, aim_deg, quadratic)
    return Trial(errors_deg(fit, simulated, quadratic), claim, bound, fit.verdict == "good")


def errors_deg(fit: SurveyFit, simulated: SimulatedSurvey, quadratic: Floats) -> Floats:
    """(2,) errors of azimuth and inclination, rms over poses."""
    attitudes = attitudes_of(*POSES)
    magnetic, gravity = simulated.read(attitudes)
    truth, seen = true_angles(attitudes), fit.calibration.angles(magnetic, invert_quadratic(gravity, quadratic))
    off = wrap_180(np.stack([seen.azimuth_deg - truth.azimuth_deg, seen.inclination_deg - truth.inclination_deg]))
    rms: Floats = np.sqrt(np.mean(off**2, axis=1))
    return rms


def bound_deg(simulated: SimulatedSurvey, aim_deg: float, quadratic: Floats) -> Floats:
    """(2,) bounds of the errors of azimuth and inclination, with quadratic terms if these are fitted."""
    shots = simulated.shots
    assert shots.groups is not None
    gravity = invert_quadratic(shots.gravity, quadratic)
    problem = SurveyProblem.of(shots.magnetic, gravity, shots.groups, is_quadratic=bool(quadratic.any()))
    at = replace(true_parameters(simulated), quadratic=quadratic)
    weights = np.array([NOISE, NOISE, max(np.radians(aim_deg), MIN_AIM_SIGMA_RAD)])
    iterate = Iterate(at, (problem.group,), (problem.group.guess(at),), weights)
    covariance = np.linalg.inv(Equations.of(problem, iterate).with_prior.matrix)
    own = problem.layout.instrument
    gradients = angle_gradients(at, problem.layout.gravity)
    return np.array([error.rms for error in pointing_errors(gradients, covariance[own, own])])


def true_parameters(simulated: SimulatedSurvey) -> SurveyParameters:
    """The truth as parameters of the fit."""
    (gravity, turned), (field, own) = _polar(simulated.accelerometer), _polar(simulated.magnetometer)
    magnetometer = replace(Parameters.at(simulated.magnetometer.offset, field), rotation=turned @ own.T)
    angles = simulated.angles
    attitudes = attitudes_of(angles.azimuth_deg, angles.inclination_deg, angles.roll_deg) @ turned.T
    return SurveyParameters(
        magnetometer,
        Parameters.at(simulated.accelerometer.offset, gravity),
        float(np.radians(simulated.dip_deg)),
        turned[:, 0],
        attitudes,
    )


def _polar(sensor: Sensor) -> tuple[Floats, Floats]:
    """Symmetric shape and rotation of a matrix, their product (polar decomposition)."""
    left, sizes, right = np.linalg.svd(sensor.matrix)
    return left @ np.diag(sizes) @ left.T, left @ right


def _row(trials: list[Trial], angle: int) -> str:
    """Cells of a row."""
    error, claim, bound = (np.array([getattr(trial, name)[angle] for trial in trials]) for name in Trial._fields[:3])
    ratios = [float(np.sqrt(np.mean((error / other) ** 2))) for other in (bound, claim)]
    numbers = [*ratios, float(np.median(error)), float(np.median(claim))]
    return " | ".join([*(f"{number:.3g}" for number in numbers), str(sum(trial.is_good for trial in trials))])


def _means(fit: SurveyFit) -> str:
    """Words on the mean azimuth of each direction with several shots, and on the spread of these shots."""
    shots = fit.shots
    groups = [group for group in np.unique(shots.groups) if np.count_nonzero(shots.groups == group) > 1]
    azimuths = [float(np.mean(shots.angles.azimuth_deg[shots.groups == group])) for group in groups]
    said = ", ".join(f"{azimuth:.1f}°" for azimuth in azimuths)
    return f"azimuths {said}; shots of a direction within {shots.rms_deg:.2f}° (rms)"


if __name__ == "__main__":
    main()
