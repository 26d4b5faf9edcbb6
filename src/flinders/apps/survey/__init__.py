"""Surveys: instruments of cave and geological surveyors, and aircraft with a scalar magnetometer.

- `instrument`, `shots`: a survey instrument and its shots; `calibration`: two sensors and a laser calibrated from them
- `checking`: shots checked with an earlier calibration
- `pointing_error`: errors of azimuth and inclination, and the directions to shoot next
- `aeromagnetic`, `tolles_lawson_fit`, `tolles_lawson_terms`: compensation of an aircraft by Tolles and Lawson
- `simulate_shots`, `simulate_aircraft`: both with known truth
- `targets`: coefficients for the DistoX and for mag-cal; `pages`: pages of the terminal; ``cli``: commands
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.survey.aeromagnetic import compensate_flight as compensate_flight
    from flinders.apps.survey.aeromagnetic import tolles_lawson as tolles_lawson
    from flinders.apps.survey.calibration import fit_survey as fit_survey
    from flinders.apps.survey.checking import check_survey as check_survey
    from flinders.apps.survey.checking import load_survey as load_survey
    from flinders.apps.survey.instrument import Shots as Shots
    from flinders.apps.survey.instrument import SurveyCalibration as SurveyCalibration
    from flinders.apps.survey.shots import read_shots as read_shots
    from flinders.apps.survey.simulate_aircraft import Aircraft as Aircraft
    from flinders.apps.survey.simulate_aircraft import calibration_flight as calibration_flight
    from flinders.apps.survey.simulate_shots import survey_shots as survey_shots

PUBLIC = {
    "Aircraft": "simulate_aircraft",
    "Shots": "instrument",
    "SurveyCalibration": "instrument",
    "calibration_flight": "simulate_aircraft",
    "check_survey": "checking",
    "compensate_flight": "aeromagnetic",
    "fit_survey": "calibration",
    "load_survey": "checking",
    "read_shots": "shots",
    "survey_shots": "simulate_shots",
    "tolles_lawson": "aeromagnetic",
}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
