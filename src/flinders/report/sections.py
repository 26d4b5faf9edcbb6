"""Sections of a report on aiding sensors, and on disturbances that the offset depends on, in words.

>>> import flinders
>>> from flinders import simulate
>>> boat = simulate.tumble(seed=1, motion="swayed", n=1500).samples
>>> fit = flinders.fit(boat, aiding=("rate", "dip"))
>>> mounting(fit)
'how the axes sit in the body, as the gyro and accelerometer tell it, adds 0.75° (1 σ)'
>>> [name for name, _ in instrument_rows(fit.aiding)][:2]
['Dip of the field', 'Bias of the gyro, °/s']
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import motor
from flinders.core.units import label
from flinders.errors import figures
from flinders.findings.row import ANY_ANGLE_DEG
from flinders.fitting.verdict import OF_THE_RECORDING
from flinders.likelihood.parameters import TERMS
from flinders.report.formatting import degrees, minus, with_uncertainty

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.disturbance import Disturbance
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Finding
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.result import Fit

SOURCES: Final = {name: term.instrument for name, term in TERMS.items()}
"""What each aiding sensor is called."""


@dataclass(frozen=True, slots=True)
class DisturbanceRow:
    """One disturbance in words: the offset in x, y and z for one of its unit, as value and uncertainty."""

    name: str
    per: str
    offsets: tuple[tuple[str, str], ...]
    words: str


def said_of(fit: Fit) -> list[Finding]:
    """Findings that a page shows: of a refused fit those that limit it or refuse it, and notes on the recording."""
    if fit.verdict != "refused":
        return list(fit.findings)
    return [finding for finding in fit.findings if finding.severity != "note" or finding.code in OF_THE_RECORDING]


def mounting(fit: Fit) -> str:
    """What the mounting of the sensor adds to the heading error; empty where that is not known.

    An estimated rotation is observed by an aiding sensor; one that was stated is observed by nothing.
    """
    error = fit.alignment_error_deg
    if error is None:
        return ""
    if fit.calibration.rotation != "estimated":
        return f"the mounting adds {degrees(error)} (1 σ), which no magnetometer can see"
    who = sources(fit)
    if not error < ANY_ANGLE_DEG:
        return f"how the axes sit in the body is not told by {who}: no heading of the body is known"
    return f"how the axes sit in the body, as {who} tell{'' if ' and ' in who else 's'} it, adds {degrees(error)} (1 σ)"


def sources(fit: Fit) -> str:
    """The aiding sensors that are in the fit."""
    names = (
        [] if fit.aiding is None else [SOURCES[aid.name] for aid in fit.aiding.each if aid.kept and aid.name in SOURCES]
    )
    return f"the {' and '.join(names)}" if names else "what was recorded beside"


def instrument_rows(aiding: Aiding) -> list[tuple[str, str]]:
    """Biases and delays of the aiding sensors: name, and number with its uncertainty."""
    known = (
        ("Dip of the field", aiding.dip_deg, aiding.dip_sigma_deg, 1.0, "°"),
        ("Bias of the gyro, °/s", aiding.gyro_bias, aiding.gyro_bias_sigma, math.degrees(1.0), ""),
        ("Bias of the accelerometer, m/s²", aiding.acceleration_bias, aiding.acceleration_bias_sigma, 1.0, ""),
        ("Magnetometer behind the gyro", aiding.delay_s, aiding.delay_sigma_s, 1e3, " ms"),
    )
    return [
        (name, minus(f"{', '.join(with_uncertainty(*pair) for pair in _pairs(value, sigma, factor))}{unit}"))
        for name, value, sigma, factor, unit in known
        if value is not None
    ]


def _pairs(value: ArrayLike, sigma: ArrayLike | None, factor: float) -> list[tuple[float, float]]:
    """One number or several in another unit, each with its uncertainty."""
    pairs = np.broadcast_arrays(np.ravel(value), 0.0 if sigma is None else sigma)
    return [(float(number), float(its)) for number, its in factor * np.transpose(pairs)]


def with_unit(disturbance: Disturbance) -> str:
    """A disturbance with its unit, as an axis says it.

    >>> from flinders.core.disturbance import Disturbance
    >>> with_unit(Disturbance("current", [0, 0, 0])), with_unit(Disturbance("throttle", [0, 0, 0]))
    ('current, A', 'throttle')
    """
    return f"{disturbance.name},{disturbance.kind.unit}" if disturbance.kind.unit else disturbance.name


def disturbance_rows(fit: Fit) -> list[DisturbanceRow]:
    """Each disturbance that the offset depends on."""
    dip = fit.heading_error_deg.dip_deg
    known = {estimate.name: estimate for estimate in fit.disturbances if estimate.disturbance is not None}
    rows = []
    for place, disturbance in enumerate(fit.calibration.disturbances):
        rows.append(
            DisturbanceRow(
                disturbance.name.capitalize(),
                f"{label(fit.calibration.unit)} per {disturbance.kind.per}",
                _offsets(fit, disturbance, place),
                _words(
                    disturbance,
                    fit.calibration.disturbance_deg(disturbance, dip_deg=dip),
                    known.get(disturbance.name),
                    _other_motors(fit, disturbance),
                ),
            )
        )
    return rows


def _offsets(fit: Fit, disturbance: Disturbance, place: int) -> tuple[tuple[str, str], ...]:
    """Value and uncertainty of each axis; no uncertainty where none is known."""
    values = disturbance.per_unit.tolist()
    if fit.disturbances_covariance is None:
        return tuple((minus(f"{value:.4g}"), "") for value in values)
    first = 9 + 3 * place
    sigma = np.sqrt(np.diag(fit.disturbances_covariance)[first : first + 3]).tolist()
    pairs = [minus(with_uncertainty(*pair)).partition(" ± ") for pair in zip(values, sigma, strict=True)]
    return tuple((value, uncertainty) for value, _, uncertainty in pairs)


def _other_motors(fit: Fit, disturbance: Disturbance) -> str:
    """Of one of several motors: how the others run where so much is left."""
    others = [motor(other.name)[1] for other in fit.calibration.disturbances if other is not disturbance]
    return " and the other motors run along as they did then" if motor(disturbance.name)[1] and any(others) else ""


def _words(disturbance: Disturbance, taken_deg: float, estimate: DisturbanceEstimate | None, running: str) -> str:
    """In which range it was recorded, what it does to a heading, and what is left of that."""
    parts = [f"recorded from {disturbance.lowest:.3g} to {disturbance.amount(disturbance.highest)}"]
    left = (
        ""
        if estimate is None
        else f", of which {degrees(estimate.left_deg)} (1 σ) is left when it is followed{running}"
    )
    parts.append(f"at {disturbance.amount(disturbance.farthest)} it moves headings by up to {degrees(taken_deg)}{left}")
    return minus(f"{'; '.join([*parts, *_more(disturbance)])}.")


def _more(disturbance: Disturbance) -> list[str]:
    """Where the offset holds, where that is not at zero, and lag and growth of the scale, where there are any."""
    parts = (
        [f"the offset of the table below is that at {disturbance.amount(disturbance.reference)}"]
        if disturbance.reference
        else []
    )
    if disturbance.lag_s:
        parts.append(
            f"readings follow {abs(disturbance.lag_s):.2g} s {'later' if disturbance.lag_s > 0 else 'earlier'}"
        )
    if disturbance.gain_per_unit:
        parts.append(f"the scale grows by {figures(100.0 * disturbance.gain_per_unit)} % per °C")
    return parts
