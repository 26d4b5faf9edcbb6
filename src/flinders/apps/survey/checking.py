"""Check of shots with an earlier calibration of their instrument, in any of its formats.

>>> from flinders.apps.survey.calibration import fit_survey
>>> from flinders.apps.survey.simulate_shots import survey_shots
>>> shots = survey_shots(seed=3, shots=24).shots
>>> known = fit_survey(shots).calibration
>>> another = survey_shots(seed=4, shots=24).shots
>>> check_survey(shots, known).rms_deg < 0.5, check_survey(another, known).rms_deg > 5.0
(True, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from flinders.apps.survey.calibration import check_shots
from flinders.apps.survey.instrument import Shots, SurveyCalibration
from flinders.apps.survey.shots import read_shots
from flinders.apps.survey.targets import of_distox, of_mag_cal
from flinders.core.calibration_file import MAX_BYTES
from flinders.core.files import read_bytes
from flinders.errors import DocumentError

if TYPE_CHECKING:
    import os

    from flinders.apps.survey.calibration import ShotErrors

    AnyPath: TypeAlias = str | os.PathLike[str]


def check_survey(source: Shots | AnyPath, calibration: SurveyCalibration | AnyPath) -> ShotErrors:
    """Correct shots with an earlier calibration, and find the angles between shots in the same direction.

    Parameters
    ----------
    source : Shots or path
        As for `flinders.read_shots`; a file is read in the axes of the calibration.
    calibration : SurveyCalibration or path
        As for `load_survey`.

    Raises
    ------
    InputError
        For a file that cannot be read.
    """
    known = calibration if isinstance(calibration, SurveyCalibration) else load_survey(calibration)
    if isinstance(source, Shots):
        return check_shots(source, known)
    axes = {"axes": str(known.magnetometer.axes), "acceleration_axes": str(known.accelerometer.axes)}
    return check_shots(read_shots(source, pointing=known.pointing, **axes), known)


def load_survey(path: AnyPath) -> SurveyCalibration:
    """Load a calibration of a survey instrument: a calibration file, coefficients of a DistoX, or JSON of mag-cal.

    Raises `DocumentError` for another file.
    """
    content = read_bytes(path, largest=MAX_BYTES, what="calibration", refused=DocumentError)
    if b'"flinders"' in content:
        return SurveyCalibration.load(path)
    try:
        return of_mag_cal(content) if content.lstrip().startswith(b"{") else of_distox(content)
    except DocumentError as error:
        raise DocumentError(f"{path}: {error.message}", hint=error.hint, **error.evidence) from None
