"""Add disturbances that were measured at rest, such as of a motor that is run up on a bench, to a calibration.

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
from flinders.core.joining import singles
from flinders.errors import NotTurned
from flinders.estimators.columns import Coded, states_in
from flinders.estimators.static_bench import still
from flinders.fitting.verdict import of_alike, of_column, of_noisy
from flinders.readers._auxiliary import with_auxiliary
from flinders.workflows.recordings import fit_for, recording_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration import Calibration
    from flinders.estimators.static_bench import Still
    from flinders.findings import Finding
    from flinders.workflows.recordings import AnyCalibration, AnyReadings


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A calibration that follows disturbances found on a bench."""

    calibration: Calibration  #: the earlier one, following them
    still: Still  #: the disturbances with their covariance, and the noise
    residual_deg: dict[str, float]  #: of each: heading error, 1 σ, that its uncertainty leaves, at a dip of 60°
    findings: tuple[Finding, ...]  #: what limits them

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "calibration": self.calibration.as_dict(),  # the earlier one, which follows the disturbances
            "noise": self.still.noise,  # standard deviation of an axis, in the unit of the readings
            "turned": False,  # whether the sensor was
            "disturbances": [estimate.as_dict() for estimate in self.still.estimates],  # as in a fit
            "findings": [finding.as_dict() for finding in self.findings],  # what limits them
        }


def fit_bench(source: AnyReadings, calibration: AnyCalibration, disturbances: Sequence[str]) -> Bench:
    """Find the offset that disturbances make in a sensor that is not turned, and put it onto its calibration.

    Run the disturbance up and down again, several times: a sensor that moves once looks the same as one switched on.

    Parameters
    ----------
    source : Samples, Recording, path, open file, data frame, or list of these
        Readings of the sensor at rest with the columns of the disturbances, in the unit and axes of the calibration.
    calibration : Fit, Calibration or path
        Made of this sensor without these disturbances; others that it follows are kept.
    disturbances : sequence of str
        ``current``, ``throttle`` or ``temperature``; ``current1`` and so on of each motor; or a column's name.

    Returns
    -------
    Bench
        With `findings` where the disturbances hold with limits.

    Raises
    ------
    NotTurned
        Where no disturbance explains the readings, or the sensor was turned: then `flinders.fit` finds all of it.
    InputError
        For a recording without these columns.
    UnitError, AxesError
        For a recording in another unit or other axes than the calibration.
    """
    known = fit_for(calibration)
    parts = tuple(singles(with_auxiliary(recording_for(source, known), disturbances)))
    states = states_in(parts, disturbances)
    result = still(tuple(Coded(part, states) for part in parts) if states else parts, disturbances)
    if result is None or not result.disturbances:
        raise NotTurned(0.0 if result is None else result.noise, " and ".join(disturbances))
    result = result.with_states(states)
    made = result.onto(known.calibration)
    residual_deg = {each.name: _residual_deg(result, made, each.name) for each in result.disturbances}
    return Bench(made, result, residual_deg, _findings(result))


def _findings(result: Still) -> tuple[Finding, ...]:
    """What limits disturbances that were found on a bench."""
    of_columns = [finding for estimate in result.estimates for finding in of_column(estimate)]
    return (*result.findings, *of_alike(result.estimates), *of_noisy(result.estimates), *of_columns)


def _residual_deg(result: Still, calibration: Calibration, name: str) -> float:
    """Heading error (1 σ) that the uncertainty of a disturbance leaves at the far end of its range, at the worst."""
    place = [disturbance.name for disturbance in result.disturbances].index(name)
    disturbance = result.disturbances[place]
    block = result.covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
    sigma = float(np.sqrt(np.linalg.eigvalsh(calibration.matrix @ block @ calibration.matrix.T)[-1]))
    away = abs(disturbance.farthest - disturbance.reference) * sigma / calibration.field_strength
    return float(np.rad2deg(away / np.cos(np.deg2rad(ASSUMED_DIP_DEG))))
