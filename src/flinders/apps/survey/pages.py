"""Pages of surveys for the terminal: shots of an instrument and next directions; compensation of an aircraft."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.apps.survey.tolles_lawson_terms import BAND_HZ, NAMES
from flinders.errors import count_text, figures
from flinders.report.formatting import degrees, duration_words, with_uncertainty
from flinders.report.terminal import facts, notes, page, style_cells, table, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.apps.survey.calibration import ShotErrors, SurveyFit
    from flinders.apps.survey.tolles_lawson_fit import CompensationResidual, TollesLawson

MAX_USEFUL_SHARE: Final = 0.9
"""Largest ratio of the azimuth error after more shots to the error before, for which the shots are proposed."""


def of_survey(fit: SurveyFit) -> RenderableType:
    """Lay out a fit: shots, noises, verdict, findings and the next directions."""
    return Group(
        page(of_shots(fit.shots), facts(_facts(fit)), _verdict(fit)),
        notes((finding.severity, finding.advice) for finding in fit.findings),
        page(_next(fit)),
    )


def of_shots(shots: ShotErrors) -> RenderableType:
    """Lay out angles of shots, and the error of each from the mean of its direction."""
    return table(("shot", "direction", "azimuth", "inclination", "roll", "error"), _rows(shots))


def of_check(shots: ShotErrors, name: str) -> RenderableType:
    """Lay out shots that were checked with an earlier calibration."""
    count = len(set(shots.groups.tolist()))
    words = (
        "no two shots are in the same direction: the calibration cannot be checked"
        if math.isnan(shots.rms_deg)
        else f"with {name}, shots in the same direction point {degrees(shots.rms_deg)} (rms) from their mean"
    )
    return page(of_shots(shots), Text(f"{words}; {count_text(count, 'direction')}"))


def _rows(shots: ShotErrors) -> Iterator[list[Text]]:
    """Yield a row for each shot; shots to repeat are marked."""
    for row in shots.as_dict():
        error = "" if math.isnan(row["error_deg"]) else f"{row['error_deg']:.2f}°"
        angles = (f"{row[name]:.1f}°" for name in ("azimuth_deg", "inclination_deg", "roll_deg"))
        style, mark = ("yellow", " repeat") if row["excluded"] else ("", "")
        yield style_cells(style, str(row["shot"]), str(row["direction"]), *angles, error + mark)


def _facts(fit: SurveyFit) -> list[tuple[str, str]]:
    """Noise of each sensor, error of aim, dip, and quadratic terms if there are any."""
    magnetometer, accelerometer = fit.calibration.magnetometer, fit.calibration.accelerometer
    of_field = fit.noise / magnetometer.field_strength
    of_gravity = fit.gravity_noise / accelerometer.field_strength
    curve = ", ".join(f"{accelerometer.field_strength * term:+.2%}" for term in fit.calibration.quadratic)
    return [
        ("noise", f"{of_field:.2%} of the field, {of_gravity:.2%} of gravity (one axis of a reading)"),
        ("aim", f"to {degrees(fit.aim_deg)} (1 σ about each axis, beyond that noise)"),
        ("dip", f"{fit.dip_deg:.1f}°"),
        *[("curve", f"x, y, z {curve} of gravity, at 1 g")] * any(fit.calibration.quadratic),
    ]


def _verdict(fit: SurveyFit) -> RenderableType:
    """Verdict with the accuracy of angles."""
    azimuth, inclination = fit.azimuth_error_deg, fit.inclination_error_deg
    words = f"azimuth to {degrees(azimuth.rms)}, inclination to {degrees(inclination.rms)} (1 σ, within 30° of level)"
    count = int((~fit.shots.excluded).sum())
    more = f"worst {degrees(azimuth.worst)} and {degrees(inclination.worst)}; {count_text(count, 'shot')}"
    return verdict(fit.verdict.upper(), fit.verdict, words, more)


def _next(fit: SurveyFit) -> RenderableType | None:
    """Table of directions in which more shots would help; None if there is no such direction."""
    useful = [
        (f"azimuth {each.azimuth_deg:.0f}°, inclination {each.inclination_deg:+.0f}°", degrees(each.azimuth_error_deg))
        for each in fit.next_directions
        if fit.verdict != "good" or each.azimuth_error_deg < MAX_USEFUL_SHARE * fit.azimuth_error_deg.rms
    ]
    return table(("shoot next, with four rolls", "azimuth then to"), useful) if useful else None


TERM_UNITS: Final = {"permanent": "nT", "induced": "nT at 50 µT", "eddy": "nT s at 50 µT"}


def of_tolles_lawson(fit: TollesLawson) -> RenderableType:
    """Lay out a fit: its verdict, its limits, the coefficients and their evidence."""
    words = f"the compensation makes readings {fit.improvement:.1f} times as quiet (improvement ratio, held out)"
    known = [
        ("flight", f"{count_text(fit.readings, 'reading')} in {duration_words(fit.seconds)} without gaps"),
        ("before", f"{_nanotesla(fit.before)}, standard deviation from {BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz"),
        (
            "held out",
            f"{_nanotesla(fit.cross_validated)}, each fifth of the half minutes with the others' coefficients",
        ),
        ("claim", f"{_nanotesla(fit.as_flown)} (1 σ) as flown, {_nanotesla(fit.on_any_heading)} on any heading"),
        ("ridge", f"{fit.ridge:.1g} of the sum of squares of each term, by cross-validation"),
    ]
    limits = notes(("limits", limit) for limit in fit.limits) if fit.limits else None
    coefficients = table(("coefficient", "", Column("")), _coefficients(fit))
    return page(verdict(fit.verdict.upper(), fit.verdict, words), limits, coefficients, facts(known))


def of_compensated(compensated: CompensationResidual) -> RenderableType:
    """Lay out the residual of a compensated recording."""
    ratio = compensated.before / compensated.after
    return facts(
        [
            (
                "before",
                f"{_nanotesla(compensated.before)}, standard deviation from {BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz",
            ),
            ("after", f"{_nanotesla(compensated.after)}: improvement ratio {ratio:.1f}"),
            ("claim", f"{_nanotesla(compensated.claimed)} (1 σ) by the coefficients, of these readings"),
            ("expected", f"{_nanotesla(compensated.expected)}, with noise and ground as on the calibration flight"),
        ]
    )


def _coefficients(fit: TollesLawson) -> Iterator[tuple[str, str, str]]:
    """Yield each coefficient with its uncertainty and unit."""
    for name, value, sigma in zip(NAMES, fit.coefficients.tolist(), fit.sigma.tolist(), strict=True):
        yield name, with_uncertainty(value, sigma), TERM_UNITS[name.split()[0]]


def _nanotesla(value: float) -> str:
    """Format a field in nT with two digits."""
    return f"{figures(value)} nT"
