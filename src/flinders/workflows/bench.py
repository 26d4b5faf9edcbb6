"""Disturbances that were measured at rest, such as on a motor that is run up on a bench, added to a calibration.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.samples import Samples
>>> from flinders.core.units import Unit
>>> rng = np.random.default_rng(1)
>>> current = 10.0 - 10.0 * np.cos(np.linspace(0.0, 20.0, 400))
>>> field = [20.0, -5.0, 43.0] + np.outer(current, [0.5, 0.0, -0.3]) + rng.normal(scale=0.2, size=(400, 3))
>>> earlier = Calibration.identity(field_strength=50.0, raw=Unit.of("uT"))
>>> found = fit_bench(Samples.of(field, unit="uT", current=current), earlier, ["current"])
>>> found.calibration.disturbances[0].per_unit.round(2) + 0.0, round(found.residual_deg["current"], 2)
(array([ 0.5,  0. , -0.3]), 0.06)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.joining import single_recordings
from flinders.errors import NotTurned
from flinders.estimators.columns import NumericStates, column_states
from flinders.estimators.static_bench import fit_still
from flinders.fitting.fit_file import fit_for
from flinders.fitting.verdict import collinearity_findings, column_findings, noise_findings
from flinders.readers._auxiliary import with_auxiliary
from flinders.workflows.recordings import recording_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration import Calibration
    from flinders.estimators.static_bench import StillSensor
    from flinders.findings import Finding
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.workflows.recordings import AnyReadings


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A calibration with disturbances that were measured on a bench."""

    calibration: Calibration  #: the earlier calibration, with the disturbances
    still: StillSensor  #: the disturbances with their covariance, and the noise
    #: heading error, 1 σ in degrees, by the uncertainty of each disturbance, at a dip of 60°
    residual_deg: dict[str, float]
    findings: tuple[Finding, ...]  #: limits of the disturbances

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "calibration": self.calibration.as_dict(),  # the earlier calibration, with the disturbances
            "noise": self.still.noise,  # standard deviation of an axis, in the unit of the readings
            "turned": False,  # whether the sensor was turned
            "disturbances": [estimate.as_dict() for estimate in self.still.estimates],  # as in a fit
            "findings": [finding.as_dict() for finding in self.findings],  # limits of the disturbances
        }


def fit_bench(source: AnyReadings, calibration: AnyCalibration, disturbances: Sequence[str]) -> Bench:
    """Measure the effect of disturbances on the offset of a sensor at rest, and add it to its calibration.

    Run the disturbance up and down several times, since a single step could also be a motion of the sensor.

    Parameters
    ----------
    source : Samples, Recording, path, open file, data frame, or list of these
        Readings of the sensor at rest with the columns of the disturbances, in the unit and axes of the calibration.
    calibration : Fit, Calibration or path
        Calibration of this sensor without these disturbances. Other disturbances in it are kept.
    disturbances : sequence of str
        ``current``, ``throttle`` or ``temperature``; ``current1`` and so on for single motors; or the name of a column.

    Returns
    -------
    Bench
        With `findings` on limits of the disturbances.

    Raises
    ------
    NotTurned
        If no disturbance explains the readings, or if the sensor was turned; use `flinders.fit` for a turned sensor.
    InputError
        For a recording without these columns.
    UnitError, AxesError
        For a recording in another unit or other axes than the calibration.
    """
    known = fit_for(calibration)
    parts = tuple(single_recordings(with_auxiliary(recording_for(source, known), disturbances)))
    states = column_states(parts, disturbances)
    result = fit_still(tuple(NumericStates(part, states) for part in parts) if states else parts, disturbances)
    if result is None or not result.disturbances:
        raise NotTurned(0.0 if result is None else result.noise, " and ".join(disturbances))
    result = result.with_states(states)
    made = result.add_to(known.calibration)
    residual_deg = {each.name: _residual_deg(result, made, each.name) for each in result.disturbances}
    return Bench(made, result, residual_deg, _findings(result))


def _findings(result: StillSensor) -> tuple[Finding, ...]:
    """Findings on the limits of disturbances that were measured on a bench."""
    of_columns = [finding for estimate in result.estimates for finding in column_findings(estimate)]
    return (*result.findings, *collinearity_findings(result.estimates), *noise_findings(result.estimates), *of_columns)


def _residual_deg(result: StillSensor, calibration: Calibration, name: str) -> float:
    """Worst heading error, 1 σ in degrees, by the uncertainty of a disturbance, at the far end of its range."""
    place = [disturbance.name for disturbance in result.disturbances].index(name)
    disturbance = result.disturbances[place]
    block = result.covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
    sigma = float(np.sqrt(np.linalg.eigvalsh(calibration.matrix @ block @ calibration.matrix.T)[-1]))
    away = abs(disturbance.extreme_value - disturbance.reference) * sigma / calibration.field_strength
    return float(np.rad2deg(away / np.cos(np.deg2rad(ASSUMED_DIP_DEG))))
