"""The calibration of an accelerometer, as a page for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.errors import count_text, figures
from flinders.report.terminal import lines, notes, page, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.core.inertial import Triad
    from flinders.workflows.accelerometer import AccelerometerFit

DIP_DEG = 60.0
"""Dip of the field in degrees for which the heading error is stated."""
UNITS = {"m/s2": "m/s²"}
"""Spelling of units for users, by their spelling in a file."""


def of_accelerometer(fit: AccelerometerFit) -> RenderableType:
    """Lay out the numbers of an accelerometer's calibration, the claim, and the limits of the claim."""
    error, triad = fit.tilt_error, fit.inertial.accelerometer
    what = count_text(fit.poses, "still pose" if fit.is_still else "reading")
    claim = (
        f"vertical accurate to {figures(error.rms)}° (1 σ, all attitudes; 95 % within {figures(error.bound_95)}°)",
        (
            f"headings with it to {figures(error.heading_error_deg(DIP_DEG))}° (1 σ, dip {DIP_DEG:.0f}°), "
            f"in addition to the error of the compass; {what}"
        ),
    )
    rows = [] if triad is None else list(_rows("offset", triad, fit.inertial.gravity))
    gyro = fit.inertial.gyro
    if gyro is not None and gyro.offset_sigma is not None:
        rows.append(("gyro offset", _pairs(gyro.offset, gyro.offset_sigma), "rad/s"))
    return page(verdict("CALIBRATED", "good", *claim), lines(rows), notes(list(_limit_notes(fit))))


def _rows(name: str, triad: Triad, gravity: float) -> Iterator[tuple[str, str, str]]:
    """Yield rows for offsets, gains and misalignment, each with its standard deviation."""
    unit = UNITS.get(triad.unit, triad.unit)
    size = float(np.trace(triad.matrix)) / 3.0
    matrix, sigma, offset_sigma = triad.matrix / size, triad.matrix_sigma, triad.offset_sigma
    if sigma is None or offset_sigma is None:
        return
    yield name, _pairs(triad.offset, offset_sigma), unit
    yield "gravity", figures(gravity / size, 5), f"{unit} long"
    yield "gains", _pairs(np.diag(matrix), np.diag(sigma) / size), ""
    beside = np.triu_indices(3, 1)
    yield "misalignment", _pairs(np.rad2deg(matrix[beside]), np.rad2deg(sigma[beside] / size)), "° (xy, xz, yz)"


def _pairs(values: np.ndarray, sigmas: np.ndarray) -> str:
    """Numbers with their standard deviations, written to the second digit of the latter."""
    places = [max(1 - int(np.floor(np.log10(sigma))), 0) if sigma > 0 else 6 for sigma in sigmas]
    return "   ".join(
        f"{value + 0.0:.{place}f} ± {sigma:.{place}f}"
        for value, sigma, place in zip(values, sigmas, places, strict=True)
    )


def _limit_notes(fit: AccelerometerFit) -> Iterator[tuple[str, ...]]:
    """Yield notes on the limits of the claim."""
    if not fit.sees_misalignment:
        yield (
            "limits",
            (
                "the poses do not determine how square the axes are: the claim assumes 1.1° (1 σ) of deviation from "
                "90° for each pair; six more poses, each on another edge, determine it"
            ),
        )
    if fit.excess > 1.0:
        yield (
            "limits",
            (
                f"lengths of the poses differ {figures(fit.excess)} times as much as their noise explains: "
                "uncertainties are widened by that factor"
            ),
        )
    if not fit.is_still:
        yield "note", "no still pose: each reading counts as one, and motion counts as noise"
    yield "note", "not included: the accelerometer's mounting in the device, which adds a tilt of its own"
