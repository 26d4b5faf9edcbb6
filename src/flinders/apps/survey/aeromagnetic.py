"""Aeromagnetic compensation: coefficients of Tolles and Lawson from a calibration flight, and their file.

>>> from flinders.apps.survey.simulate_aircraft import calibration_flight
>>> flight = calibration_flight(seed=1)
>>> fit = tolles_lawson(flight.samples)
>>> fit.verdict, loads(dumps(fit)) == fit
('good', True)
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Struct

from flinders.apps.survey.tolles_lawson_fit import TollesLawson, fit_coefficients
from flinders.apps.survey.tolles_lawson_terms import NAMES, scalar_of
from flinders.core.calibration_file import Count, NotNegative, nonfinite_places, parse_document
from flinders.core.files import read_bytes
from flinders.core.joining import read_into_memory
from flinders.core.json_layout import lay_out
from flinders.errors import DocumentError, UsageError
from flinders.estimators.data import recording_of
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.apps.survey.tolles_lawson_fit import CompensationResidual
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.calibrate import AnyReadings

MAX_BYTES: Final = 2**20
"""Largest size of a file of coefficients in bytes; usual files have 6000."""


class Coefficient(Struct, frozen=True, forbid_unknown_fields=True):
    """One coefficient and its 1 σ."""

    value: float  #: the coefficient
    sigma: NotNegative  #: its 1 σ


class CoefficientFile(
    Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="tolles-lawson"
):
    """Contents of a file of coefficients."""

    schema: Literal[1] = 1  #: version of this layout
    unit: Literal["nT"] = "nT"  #: unit; eddy coefficients are in nT s; induced and eddy ones are for a field of 50 µT
    coefficients: dict[str, Coefficient]
    covariance: tuple[tuple[float, ...], ...]  #: (16, 16), in the order of the coefficients
    ridge: NotNegative
    before: NotNegative  #: nT: standard deviation of the strength without compensation, 0.1 to 0.9 Hz
    after: NotNegative
    cross_validated: NotNegative
    as_flown: NotNegative
    on_any_heading: NotNegative
    improvement: NotNegative
    verdict: Literal["good", "limited", "refused"]
    unobserved: tuple[str, ...] = ()
    readings: Count
    seconds: NotNegative
    version: str  #: version of Flinders that wrote the file

    def __post_init__(self) -> None:
        """Refuse other terms, or a covariance of another size, when a file is read."""
        if set(self.coefficients) != set(NAMES):
            raise ValueError(f"`coefficients` are not the {len(NAMES)} of Tolles and Lawson, from {NAMES[0]} on")
        if [len(row) for row in self.covariance] != [len(NAMES)] * len(NAMES):
            raise ValueError(f"`covariance` is not {len(NAMES)} by {len(NAMES)}")


def tolles_lawson(source: AnyReadings) -> TollesLawson:
    """Fit the magnetic field of an aircraft to the scalar magnetometer of a calibration flight.

    Parameters
    ----------
    source : Samples, Recording, path, open file or data frame
        Vector magnetometer in the axes of the aircraft with times, and the scalar magnetometer as `Samples.strength`;
        without the latter, the length of the vector is compensated. Files are read by `flinders.read`.

    Returns
    -------
    TollesLawson
        The coefficients, also refused ones, see its `verdict`.

    Raises
    ------
    InputError, FitError
        As for `flinders.apps.survey.tolles_lawson_fit.fit_coefficients`; `UsageError` for a summary.

    Examples
    --------
    >>> from flinders.apps.survey.simulate_aircraft import calibration_flight
    >>> one_heading = calibration_flight(seed=1, headings_deg=[0.0] * 4)
    >>> tolles_lawson(one_heading.samples).unobserved[0]
    'permanent x'
    """
    return fit_coefficients(_flight(source))


@dataclass(frozen=True, slots=True, eq=False)
class CompensatedFlight:
    """Readings of a scalar magnetometer without the field of the aircraft."""

    time_s: Floats  #: (N,)
    scalar: Floats  #: (N,) nT: reading of the scalar magnetometer; NaN if it is missing
    compensated: Floats  #: (N,) nT: compensated reading, correct up to a constant
    summary: CompensationResidual  #: residual of the compensation


def compensate_flight(source: AnyReadings, coefficients: TollesLawson | str | os.PathLike[str]) -> CompensatedFlight:
    """Remove the field of an aircraft from its scalar magnetometer, with the coefficients of another flight.

    Parameters
    ----------
    source : Samples, Recording, path, open file or data frame
        As for `tolles_lawson`.
    coefficients : TollesLawson or path

    Raises
    ------
    DocumentError
        For a file without coefficients.
    InputError, FitError
        As for `tolles_lawson`.

    Examples
    --------
    >>> from flinders.apps.survey.simulate_aircraft import calibration_flight
    >>> flight = calibration_flight(seed=1)
    >>> later = calibration_flight(seed=2, aircraft=flight.aircraft)
    >>> summary = compensate_flight(later.samples, tolles_lawson(flight.samples)).summary
    >>> summary.before > 5.0 * summary.after
    True
    """
    fit = coefficients if isinstance(coefficients, TollesLawson) else load(coefficients)
    samples = _flight(source)
    summary, scalar = fit.compensate(samples), 1000.0 * scalar_of(samples)
    return CompensatedFlight(samples.as_columns()["time_s"], scalar, scalar - fit.interference(samples), summary)


def _flight(source: AnyReadings) -> Samples:
    """Readings of both magnetometers, in memory."""
    recording, _ = recording_of(source)
    if isinstance(recording, Summary):
        raise UsageError("a compensation needs readings: give the recording, not its summary")
    return read_into_memory(recording)


def as_dict(fit: TollesLawson) -> dict[str, Any]:
    """JSON-ready contents of the file of coefficients."""
    each = zip(NAMES, fit.coefficients.tolist(), fit.sigma.tolist(), strict=True)
    document = CoefficientFile(
        coefficients={name: Coefficient(value, sigma) for name, value, sigma in each},
        covariance=tuple(map(tuple, fit.covariance.tolist())),
        **{name: getattr(fit, name) for name in FILE_FIELDS},
        improvement=fit.improvement,
        verdict=fit.verdict,
        version=version("flinders"),
    )
    plain: dict[str, Any] = msgspec.to_builtins(document)
    return plain


FILE_FIELDS: Final = (
    "ridge",
    "before",
    "after",
    "cross_validated",
    "as_flown",
    "on_any_heading",
    "unobserved",
    "readings",
    "seconds",
)
"""Fields that the file and `TollesLawson` have in common."""


def dumps(fit: TollesLawson) -> str:
    """Write coefficients as the text of a file, which is read back exactly; `UsageError` for NaN or infinity."""
    content = as_dict(fit)
    for place in nonfinite_places(content):
        raise UsageError(f"coefficients: {place} is not finite: only finite numbers are written")
    return lay_out(content) + "\n"


def loads(text: str | bytes, *, source: str = "coefficients") -> TollesLawson:
    """Coefficients from the text of a file; raises `DocumentError` for a faulty one."""
    what = "a file of coefficients of `flinders tolles-lawson`"
    document = parse_document(text, CoefficientFile, source, what=what, refused=DocumentError)
    return TollesLawson(
        np.array([document.coefficients[name].value for name in NAMES]),
        np.array(document.covariance),
        **{name: getattr(document, name) for name in FILE_FIELDS},
    )


def load(path: str | os.PathLike[str]) -> TollesLawson:
    """Read a file of coefficients; raises `DocumentError` if it cannot be opened, or is another file."""
    text = read_bytes(path, largest=MAX_BYTES, what="file of coefficients", refused=DocumentError)
    return loads(text, source=os.fspath(path))
