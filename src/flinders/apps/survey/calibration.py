"""Calibration of a survey instrument: magnetometer, accelerometer and pointing axis at once, from shots.

Shots in the same direction, rolled about the laser, determine the pointing axis. All attitudes together determine
gains, axes and offsets of both sensors and the rotation between them (`flinders.likelihood.pointing`, solved by
`flinders.likelihood.solver`). A shot that contradicts the others is left out, and marked to be repeated.

Use it for an instrument with both sensors and a laser, away from iron, with 24 shots or more, four in each direction.
The fit cannot detect a jig that rolls about another axis than the laser's (M. Perne, Acta Carsologica). Nor can it
detect that both sensors are left-handed in the same way; then the azimuth runs backwards.

Source: B. Heeb, *A General Calibration Algorithm for 3-Axis Compass/Clinometer Devices*, CREG Journal 73 (2009).

>>> from flinders.apps.survey.simulate_shots import survey_shots
>>> simulated = survey_shots(seed=1)
>>> fit = fit_survey(simulated.shots)
>>> fit
SurveyFit(good, azimuth 0.100° rms, inclination 0.040° rms, 56 shots)
>>> angles = fit.calibration.angles(simulated.shots.magnetic, simulated.shots.gravity)
>>> bool(np.all(np.abs(angles.inclination_deg - simulated.angles.inclination_deg) < 0.6))
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.survey.instrument import FORWARD_RIGHT_DOWN, Angles, SurveyCalibration
from flinders.apps.survey.pointing_error import angle_gradients, next_directions, pointing_errors
from flinders.core.calibration import UNKNOWN_UNIT, Calibration
from flinders.core.calibration_file import Fitted, HeadingErrorRecord
from flinders.core.keywords import check_keywords
from flinders.errors import FitError, count_text, figures
from flinders.findings import by_severity, findings_in
from flinders.findings.words import SHOT_ADVICE
from flinders.fitting.result import Judged, Outcome
from flinders.geometry.rotation import lengths
from flinders.heading.axis_consistency import MIN_DOUBTED_SCATTER
from flinders.likelihood.pointing import Influence, SurveyProblem, min_sigmas, start_parameters
from flinders.likelihood.solver import levenberg_marquardt
from flinders.native.engine import engine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.apps.survey.instrument import Shots
    from flinders.apps.survey.pointing_error import NextDirection, PointingError
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.calibration_file import Document, ProvenanceRecord
    from flinders.core.units import Unit
    from flinders.findings import Finding
    from flinders.likelihood.parameters import Parameters
    from flinders.likelihood.pointing import SurveyIterate, SurveyParameters

TARGET_DEG: Final = 0.5
"""Usual accuracy that cave surveyors need from an instrument."""

MIN_SHOTS, MAX_SHOTS = 12, 500
"""Smallest and largest number of shots."""

MAX_SAME_DIRECTION_DEG: Final = 20.0
"""Largest angle between successive shots in the same direction; those of the procedure are 55° apart."""

MAX_CONTRADICTION: Final = 3.0
"""Largest `flinders.likelihood.pointing.Influence.contradiction` of a shot that is kept, in units of the median."""

MAX_EXCLUDED_SHARE: Final = 0.2
"""Largest share of shots that are left out; if more contradict each other, the model is wrong and not the shots."""


@dataclass(frozen=True, slots=True, eq=False)
class ShotErrors:
    """Angles of shots, and the error of each: its angle from the mean of the shots in the same direction."""

    numbers: tuple[int, ...]  #: numbers of the shots in their file
    groups: NDArray[np.intp]  #: (N,) group of each shot: one for each direction
    angles: Angles
    error_deg: Floats  #: (N,): angle from the mean of the direction; NaN for a direction with one shot
    excluded: NDArray[np.bool_]  #: (N,) whether a shot was left out of the fit

    @classmethod
    def of(
        cls, calibration: SurveyCalibration, shots: Shots, groups: NDArray[np.intp], excluded: NDArray[np.bool_]
    ) -> ShotErrors:
        """Errors of corrected shots; excluded ones do not count in the mean."""
        angles = calibration.angles(shots.magnetic, shots.gravity)
        pointing = _directions(angles)
        alike = (groups[:, np.newaxis] == groups) & ~excluded
        mean = alike.astype(float) @ pointing
        off = np.degrees(2.0 * np.arcsin(0.5 * lengths(pointing - mean / lengths(mean)[:, np.newaxis]).clip(max=2.0)))
        others = alike.sum(axis=1) - ~excluded
        return cls(shots.numbers, groups, angles, np.where(others > 0, off, np.nan), excluded)

    @property
    def rms_deg(self) -> float:
        """Rms error of the shots that are not excluded; NaN if no two have the same direction."""
        known = self.error_deg[~self.excluded & np.isfinite(self.error_deg)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")

    def as_dict(self) -> list[dict[str, Any]]:
        """JSON-ready list with a row for each shot."""
        columns = (self.numbers, self.groups.tolist(), *self.angles, self.error_deg, self.excluded)
        names = ("shot", "direction", "azimuth_deg", "inclination_deg", "roll_deg", "error_deg", "excluded")
        plain = [column if isinstance(column, tuple | list) else column.tolist() for column in columns]
        return [dict(zip(names, row, strict=True)) for row in zip(*plain, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class SurveyFit(Judged, Outcome):
    """A calibration of a survey instrument, with its evidence and its uncertainty."""

    calibration: SurveyCalibration
    shots: ShotErrors
    azimuth_error_deg: PointingError  #: expected error of shots within 30° of level, 1 σ
    inclination_error_deg: PointingError  #: expected error of shots within 30° of level, 1 σ
    noise: float  #: standard deviation of one axis of a reading, in the unit of its sensor
    gravity_noise: float  #: standard deviation of one axis of a reading, in the unit of its sensor
    aim_deg: float  #: standard deviation of shots that were aimed in the same direction, about each axis
    dip_deg: float  #: dip of the field
    target_deg: float  #: largest error of azimuth and inclination that is good enough
    next_directions: tuple[NextDirection, ...]  #: directions in which more shots would help most
    findings: tuple[Finding, ...]  #: most severe first

    def to_document(self, provenance: ProvenanceRecord | None = None) -> Document:
        """Calibration file of this fit."""
        error = self.azimuth_error_deg
        heading = HeadingErrorRecord(rms=error.rms, worst=error.worst, dip_deg=self.dip_deg, target_deg=self.target_deg)
        fit = Fitted(
            method="survey",
            samples=int(np.count_nonzero(~self.shots.excluded)),
            noise=self.noise,
            verdict=self.verdict,
            heading_error_deg=heading,
            findings=self.finding_records,
        )
        return self.calibration.to_document(fit=fit, provenance=provenance)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "verdict": self.verdict,
            "azimuth_error_deg": self.azimuth_error_deg._asdict(),
            "inclination_error_deg": self.inclination_error_deg._asdict(),
            "target_deg": self.target_deg,
            "dip_deg": self.dip_deg,
            "noise": self.noise,
            "gravity_noise": self.gravity_noise,
            "aim_deg": self.aim_deg,
            # correction of the magnetometer, into axes of the instrument
            "magnetometer": self.calibration.magnetometer.as_dict(),
            # correction of the accelerometer, into axes of the instrument
            "accelerometer": self.calibration.accelerometer.as_dict(),
            "pointing": self.calibration.pointing,  # axis of the laser
            # (3,): q, one over the unit of the accelerometer, which corrects g + q g² of a reading g
            "quadratic": list(self.calibration.quadratic),
            "shots": self.shots.as_dict(),  # a row for each shot
            "next_directions": [direction._asdict() for direction in self.next_directions],
            "findings": [finding.as_dict() for finding in self.findings],
        }

    def __repr__(self) -> str:
        azimuth, inclination = figures(self.azimuth_error_deg.rms), figures(self.inclination_error_deg.rms)
        return (
            f"SurveyFit({self.verdict}, azimuth {azimuth}° rms, inclination {inclination}° rms, "
            f"{count_text(len(self.shots.numbers), 'shot')})"
        )


@check_keywords()
def fit_survey(shots: Shots, *, target_deg: float = TARGET_DEG, non_linear: bool = False) -> SurveyFit:
    """Calibrate a survey instrument.

    Minimises Σ |m − b − S Rᵀ Cᵀ f|²/σ_m² + |g − b' − S' Cᵀ e|²/σ_g² + |t − C p|²/σ_a² over both sensors, dip, pointing
    axis p, attitude C of each shot and direction t of each group, with σ from the residuals.

    Parameters
    ----------
    shots : Shots
        Without groups, a shot within 20° of the previous one is assumed to be in the same direction.
    target_deg : float, optional
        Worst error of azimuth and inclination that is good enough.
    non_linear : bool
        Also fit a quadratic term of each axis of the accelerometer: g + q g² replaces g.

    Raises
    ------
    FitError
        For fewer than 12 shots or more than 500, inconsistent axes of the sensors, shots of which no two are in the
        same direction, and shots that were rolled about another axis than the laser's.

    Source: B. Heeb, CREG Journal 73 (2009), for the model; CalibAlgoBH.java of TopoDroid for the quadratic terms.
    """
    _refuse_count(len(shots))
    forward = FORWARD_RIGHT_DOWN[shots.pointing]
    magnetic, gravity = forward.apply(shots.magnetic), forward.apply(shots.gravity)
    start = _start(magnetic, gravity)
    groups = _group_directions(start.attitudes @ start.pointing) if shots.groups is None else shots.groups
    _refuse_unrolled(groups)
    problem, iterate, excluded = _fit_without_contradicting(magnetic, gravity, groups, is_quadratic=non_linear)
    _refuse_other_axis(iterate.at, shots.pointing)
    calibration = _calibration(iterate.at, shots)
    covariance = _covariance(problem, iterate)
    curve = problem.layout.gravity
    azimuth, inclination = pointing_errors(angle_gradients(iterate.at, curve), covariance)
    errors = ShotErrors.of(calibration, shots, groups, excluded)
    noise, gravity_noise, aim = iterate.weights.tolist()
    return SurveyFit(
        calibration,
        errors,
        azimuth,
        inclination,
        noise,
        gravity_noise,
        float(np.degrees(aim)),
        float(np.degrees(iterate.at.dip)),
        target_deg,
        next_directions(iterate.at, covariance, iterate.weights, gravity=curve),
        _findings(errors, azimuth, inclination, target_deg),
    )


def check_shots(shots: Shots, calibration: SurveyCalibration) -> ShotErrors:
    """Check shots with a calibration: compute the angle of each from the mean of the shots in the same direction."""
    angles = calibration.angles(shots.magnetic, shots.gravity)
    groups = _group_directions(_directions(angles)) if shots.groups is None else shots.groups
    return ShotErrors.of(calibration, shots, groups, np.zeros(len(shots), bool))


def _directions(angles: Angles) -> Floats:
    """(N, 3) unit vectors of the shots: north, east, down."""
    azimuth, inclination = np.radians(angles.azimuth_deg), np.radians(angles.inclination_deg)
    level = np.cos(inclination)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(inclination)], axis=-1)


def _group_directions(directions: Floats) -> NDArray[np.intp]:
    """(N,) groups of (N, 3) directions; a new group begins if a shot has another direction than the previous one."""
    cosines = np.einsum("ni,ni->n", directions[1:], directions[:-1])
    return np.concatenate([[0], np.cumsum(cosines < np.cos(np.radians(MAX_SAME_DIRECTION_DEG)))])


def _refuse_count(count: int) -> None:
    """Refuse too few shots, and a recording that does not consist of shots."""
    if count < MIN_SHOTS:
        raise FitError(
            f"{count_text(count, 'shot')}: need at least {MIN_SHOTS}, better 24 or 56; {SHOT_ADVICE}", found=count
        )
    if count > MAX_SHOTS:
        raise FitError(
            f"{count:,} readings: need one for each shot, {MAX_SHOTS} at most: take the mean of the readings of each "
            "shot at rest; a recording in motion cannot be used",
            found=count,
        )


def _start(magnetic: Floats, gravity: Floats) -> SurveyParameters:
    """Parameters at which the iteration starts; raises FitError if the readings do not fit the model at all."""
    try:
        start = start_parameters(magnetic, gravity)
    except np.linalg.LinAlgError:
        raise FitError(
            f"readings of a sensor are constant, or do not lie on a sphere: {SHOT_ADVICE}, and check the columns"
        ) from None
    field, down = (
        vectors / lengths(vectors)[:, np.newaxis] for vectors in start.corrected_directions(magnetic, gravity)
    )
    scatter = float(np.std(np.einsum("ni,ni->n", field, down)))
    if scatter > MIN_DOUBTED_SCATTER:
        raise FitError(
            f"the angle between gravity and field is not the same in all shots (sin I scatters by {scatter:.2f}): the "
            "axes of accelerometer and magnetometer are inconsistent, or iron was near. State the axes of each sensor "
            "in the instrument",
            hint={"axes": None, "acceleration_axes": None},
            scatter=scatter,
        )
    return start


def _refuse_unrolled(groups: NDArray[np.intp]) -> None:
    """Refuse shots of which no two are in the same direction."""
    if len(np.unique(groups)) == len(groups):
        raise FitError(
            f"no two successive shots are within {MAX_SAME_DIRECTION_DEG:.0f}° of the same direction: the axis of the "
            f"laser cannot be determined; {SHOT_ADVICE}, and check which axis is the laser's",
            hint={"pointing": None},
            same_deg=MAX_SAME_DIRECTION_DEG,
        )


def _refuse_other_axis(at: SurveyParameters, pointing: str) -> None:
    """Refuse shots that were rolled about another axis than the one that was stated."""
    off = math.degrees(math.acos(float(np.clip(at.pointing[0], -1.0, 1.0))))
    if off > MAX_SAME_DIRECTION_DEG:
        raise FitError(
            f"the instrument was rolled about an axis {off:.0f}° from its {pointing} axis: state the axis of the "
            "laser, and the axes of the sensors",
            hint={"pointing": None, "axes": None, "acceleration_axes": None},
            off_deg=off,
        )


def _fit_without_contradicting(
    magnetic: Floats, gravity: Floats, groups: NDArray[np.intp], *, is_quadratic: bool
) -> tuple[SurveyProblem, SurveyIterate, NDArray[np.bool_]]:
    """Fit; leave out the shot that contradicts the others most, and repeat, until no shot contradicts them."""
    excluded = np.zeros(len(groups), bool)
    while True:
        counts = np.flatnonzero(~excluded)
        problem = SurveyProblem.of(magnetic[counts], gravity[counts], groups[counts], is_quadratic=is_quadratic)
        iterate = levenberg_marquardt(problem, problem.initial(start_parameters(magnetic[counts], gravity[counts])))
        contradiction = Influence.of(problem, iterate).contradiction
        worst = int(np.argmax(contradiction))
        is_one = contradiction[worst] > MAX_CONTRADICTION * float(np.median(contradiction))
        if not is_one or excluded.sum() >= MAX_EXCLUDED_SHARE * len(groups):
            return problem, iterate, excluded
        excluded[counts[worst]] = True


def _covariance(problem: SurveyProblem, iterate: SurveyIterate) -> Floats:
    """(24, 24) covariance of the instrument's parameters, or (27, 27) with quadratic terms.

    The variance of each kind of residual is widened for its number of readings, unless it is at its lower bound.
    """
    influence, own = Influence.of(problem, iterate), problem.layout.instrument
    is_least = iterate.weights <= min_sigmas(iterate.at)
    factors = np.where(is_least, 1.0, [engine().widening_by_few(freedom) for freedom in influence.freedom.tolist()])
    return influence.covariance(factors)[own, own]


def _calibration(at: SurveyParameters, shots: Shots) -> SurveyCalibration:
    """Corrections into axes of the instrument, from parameters in axes forward, right and down."""
    forward = FORWARD_RIGHT_DOWN[shots.pointing].apply(np.eye(3)).T

    def of(own: Parameters, unit: Unit, axes: Axes) -> Calibration:
        matrix = own.radius * forward.T @ at.to_instrument @ np.linalg.inv(own.rotated_shape) @ forward
        return Calibration(matrix, forward.T @ own.offset, own.radius, rotation="estimated", raw=unit, axes=axes)

    return SurveyCalibration(
        of(at.magnetometer, shots.unit, shots.axes),
        of(at.accelerometer, UNKNOWN_UNIT, shots.acceleration_axes),
        shots.pointing,
        (*(forward.T @ at.quadratic).tolist(),),
    )


def _findings(
    errors: ShotErrors, azimuth: PointingError, inclination: PointingError, target_deg: float
) -> tuple[Finding, ...]:
    """Findings that limit the use of the calibration: contradicting shots, and errors beyond the target."""
    worst = max(azimuth.worst, inclination.worst)
    numbers = {
        "pointing_deg": worst,
        "azimuth_deg": azimuth.worst,
        "inclination_deg": inclination.worst,
        "target_deg": target_deg,
        "contradicting": float(errors.excluded.mean()),
    }
    left_out = [number for number, out in zip(errors.numbers, errors.excluded, strict=True) if out]
    return by_severity(findings_in({**numbers, "shot_numbers": left_out}, "pointing-error", "shots-contradict"))
