"""Sections of a report on aiding sensors, and on disturbances that the offset depends on, in words.

>>> import flinders
>>> from flinders import simulate
>>> boat = simulate.tumble(seed=1, motion="swayed", n=1500).samples
>>> fit = flinders.fit(boat, aids=("rate", "dip"))
>>> mounting(fit)
'how the axes sit in the body, as the gyro and accelerometer tell it, adds 0.75° (1 σ)'
>>> [row.name for row in aiding_rows(fit)]
['Gyro', 'Accelerometer']
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import motor
from flinders.core.units import label
from flinders.errors import figures
from flinders.report.formatting import degrees, minus, with_uncertainty

if TYPE_CHECKING:
    from flinders.core.disturbance import Driver
    from flinders.estimators.regressors import Driven
    from flinders.fitting.result import Fit

SOURCES: Final = {"rate": "gyro", "dip": "accelerometer", "tilt": "logged tilt", "attitude": "logged attitude"}
"""What each aiding sensor is called."""

LOST_DEG: Final = 90.0
"""An error from which on a heading says nothing."""


@dataclass(frozen=True, slots=True)
class AidingRow:
    """What one aiding sensor changed, in words."""

    name: str
    changed: str
    claimed: str
    why: str


@dataclass(frozen=True, slots=True)
class DisturbanceRow:
    """One disturbance in words: the offset in x, y and z for one of its unit, as value and uncertainty."""

    name: str
    per: str
    offsets: tuple[tuple[str, str], ...]
    words: str


def mounting(fit: Fit) -> str:
    """What the mounting of the sensor adds to the heading error; empty where that is not known.

    A rotation that an aiding sensor has found is observed by it; one that was stated is observed by nothing.
    """
    error = fit.alignment_error_deg
    if error is None:
        return ""
    if fit.calibration.rotation != "estimated":
        return f"the mounting adds {degrees(error)} (1 σ), which no magnetometer can see"
    who = sources(fit)
    if not error < LOST_DEG:
        return f"how the axes sit in the body is not told by {who}: no heading of the body is known"
    return f"how the axes sit in the body, as {who} tell{'' if ' and ' in who else 's'} it, adds {degrees(error)} (1 σ)"


def sources(fit: Fit) -> str:
    """The aiding sensors that are in the fit."""
    kept = [] if fit.aids is None else [SOURCES[aid.name] for aid in fit.aids.each if aid.kept and aid.name in SOURCES]
    return f"the {' and '.join(kept)}" if kept else "what was recorded beside"


def aiding_rows(fit: Fit) -> list[AidingRow]:
    """Each aiding sensor that was asked for or tried, in the order in which they were taken."""
    return [
        AidingRow(
            SOURCES.get(aid.name, aid.name).capitalize(),
            degrees(aid.changed_deg) if aid.kept else "–",
            f"{degrees(aid.before_deg)} → {degrees(aid.after_deg)}" if aid.kept else "left out",
            aid.words,
        )
        for aid in (() if fit.aids is None else fit.aids.each)
    ]


def instrument_rows(fit: Fit) -> list[tuple[str, str]]:
    """Biases and delays of the aiding sensors: name, and number with its uncertainty."""
    aiding = fit.aids
    if aiding is None:
        return []
    rows = []
    if aiding.dip_deg is not None:
        rows.append(("Dip of the field", f"{with_uncertainty(aiding.dip_deg, aiding.dip_sigma_deg or 0.0)}°"))
    if aiding.gyro_bias is not None and aiding.gyro_bias_sigma is not None:
        pairs = zip(np.rad2deg(aiding.gyro_bias), np.rad2deg(aiding.gyro_bias_sigma), strict=True)
        rows.append(("Bias of the gyro, °/s", ", ".join(with_uncertainty(float(b), float(s)) for b, s in pairs)))
    if aiding.acceleration_bias is not None and aiding.acceleration_bias_sigma is not None:
        pairs = zip(aiding.acceleration_bias, aiding.acceleration_bias_sigma, strict=True)
        biases = ", ".join(with_uncertainty(float(b), float(s)) for b, s in pairs)
        rows.append(("Bias of the accelerometer, m/s²", biases))
    if aiding.delay_s is not None:
        delay = with_uncertainty(1e3 * aiding.delay_s, 1e3 * (aiding.delay_sigma_s or 0.0))
        rows.append(("Magnetometer behind the gyro", f"{delay} ms"))
    return [(name, minus(number)) for name, number in rows]


def with_unit(driver: Driver) -> str:
    """A disturbance with its unit, as an axis says it.

    >>> from flinders.core.disturbance import Driver
    >>> with_unit(Driver("current", [0, 0, 0])), with_unit(Driver("throttle", [0, 0, 0]))
    ('current, A', 'throttle')
    """
    return f"{driver.name},{driver.kind.unit}" if driver.kind.unit else driver.name


def disturbance_rows(fit: Fit) -> list[DisturbanceRow]:
    """Each disturbance that the offset depends on."""
    dip = fit.heading_error_deg.dip_deg
    known = {driven.name: driven for driven in fit.driven if driven.driver is not None}
    rows = []
    for place, driver in enumerate(fit.calibration.drivers):
        rows.append(
            DisturbanceRow(
                driver.name.capitalize(),
                f"{label(fit.calibration.unit)} per {driver.kind.per}",
                _offsets(fit, driver, place),
                _words(
                    driver,
                    fit.calibration.driven_deg(driver, dip_deg=dip),
                    known.get(driver.name),
                    _other_motors(fit, driver),
                ),
            )
        )
    return rows


def _offsets(fit: Fit, driver: Driver, place: int) -> tuple[tuple[str, str], ...]:
    """Value and uncertainty of each axis; no uncertainty where none is known."""
    values = driver.per_unit.tolist()
    if fit.drivers_covariance is None:
        return tuple((minus(f"{value:.4g}"), "") for value in values)
    first = 9 + 3 * place
    sigma = np.sqrt(np.diag(fit.drivers_covariance)[first : first + 3]).tolist()
    pairs = [minus(with_uncertainty(*pair)).partition(" ± ") for pair in zip(values, sigma, strict=True)]
    return tuple((value, uncertainty) for value, _, uncertainty in pairs)


def _other_motors(fit: Fit, driver: Driver) -> str:
    """Of one of several motors: how the others run where so much is left."""
    beside = [motor(other.name)[1] for other in fit.calibration.drivers if other is not driver]
    return " and the other motors run along as they did then" if motor(driver.name)[1] and any(beside) else ""


def _words(driver: Driver, taken_deg: float, driven: Driven | None, running: str) -> str:
    """In which range it was recorded, what it does to a heading, and what is left of that."""
    parts = [f"recorded from {driver.lowest:.3g} to {driver.amount(driver.highest)}"]
    left = "" if driven is None else f", of which {degrees(driven.left_deg)} (1 σ) is left when it is followed{running}"
    parts.append(f"at {driver.amount(driver.farthest)} it moves headings by up to {degrees(taken_deg)}{left}")
    return minus(f"{'; '.join([*parts, *_more(driver)])}.")


def _more(driver: Driver) -> list[str]:
    """Where the offset holds, where that is not at zero, and lag and growth of the scale, where there are any."""
    parts = [f"the offset of the table below is that at {driver.amount(driver.reference)}"] if driver.reference else []
    if driver.lag_s:
        parts.append(f"readings follow {abs(driver.lag_s):.2g} s {'later' if driver.lag_s > 0 else 'earlier'}")
    if driver.gain_per_unit:
        parts.append(f"the scale grows by {figures(100.0 * driver.gain_per_unit)} % per °C")
    return parts
