"""A calibration as a Digital Calibration Certificate (DCC), the XML format of PTB, version 3.3.0, with D-SI units.

It states the offset and the matrix of the calibration with their expanded uncertainties (k = 2), the expected heading
error, the noise and the strength of the field, laboratory, unit and date, and conformity with the limits.

Source: PTB, *Digital Calibration Certificate*, schema version 3.3.0, https://ptb.de/dcc, and *D-SI*, https://ptb.de/si.

The certificate does not claim traceability to the SI: a calibration in the earth's field determines directions, but the
strength of the field only as well as the sensor's scale or the stated site.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final, cast
from xml.etree import ElementTree

import numpy as np

from flinders.report.view import matrix_sigma

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from numpy.typing import ArrayLike

    from flinders.apps.live.station.plan import CertificateFacts, PassLimits
    from flinders.fitting.result import Fit

SCHEMA: Final = "3.3.0"
DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
XSI: Final = "http://www.w3.org/2001/XMLSchema-instance"
COVERAGE_FACTOR, COVERAGE_PROBABILITY = 2, 0.95
UNITS: Final = {"uT": r"\micro\tesla", "counts": r"\one"}
"""Units of the field in D-SI."""
METHOD: Final = (
    "Readings of the magnetometer in many attitudes in the earth's field; an ellipsoid is fitted to them by maximum "
    "likelihood. Corrected field = matrix (reading - offset)."
)
REMARK: Final = (
    "The calibration makes the magnitude of the corrected field the same in all attitudes. It is not traceable to the "
    "SI: the strength of the field is known as well as the scale of the sensor."
)


@dataclass(frozen=True, slots=True)
class CertifiedTest:
    """The unit that a certificate is for, and its test."""

    serial: str
    identifier: str  # of the certificate, unique in the laboratory
    began: datetime
    ended: datetime
    operator: str = ""
    is_passed: bool = True


def certificate(fit: Fit, facts: CertificateFacts, about: CertifiedTest, limits: PassLimits | None = None) -> str:
    """Write a certificate as XML.

    Parameters
    ----------
    fit : Fit
        A good or limited fit.
    facts : CertificateFacts
        Laboratory, person and customer.
    about : CertifiedTest
    limits : PassLimits, optional
        Pass limits of the unit; with them the certificate states conformity.
    """
    return _Writer(facts.language).written(fit, facts, about, limits)


class _Writer:
    """Writer of the elements of a certificate, with texts in one language."""

    def __init__(self, language: str) -> None:
        self.language = language
        ElementTree.register_namespace("dcc", DCC)
        ElementTree.register_namespace("si", SI)
        ElementTree.register_namespace("xsi", XSI)

    def written(self, fit: Fit, facts: CertificateFacts, about: CertifiedTest, limits: PassLimits | None) -> str:
        root = ElementTree.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA})
        root.set(f"{{{XSI}}}schemaLocation", f"{DCC} https://ptb.de/dcc/v{SCHEMA}/dcc.xsd")
        self._administrative(root, facts, about)
        self._results(root, fit, about, limits)
        ElementTree.indent(root)
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'

    def _administrative(self, root: ElementTree.Element, facts: CertificateFacts, about: CertifiedTest) -> None:
        data = _dcc(root, "administrativeData")
        self._software(_dcc(data, "dccSoftware"))
        core = _dcc(data, "coreData")
        _dcc(core, "countryCodeISO3166_1", facts.country)
        _dcc(core, "usedLangCodeISO639_1", facts.language)
        _dcc(core, "mandatoryLangCodeISO639_1", facts.language)
        _dcc(core, "uniqueIdentifier", about.identifier)
        _dcc(core, "beginPerformanceDate", f"{about.began:%Y-%m-%d}")
        _dcc(core, "endPerformanceDate", f"{about.ended:%Y-%m-%d}")
        _dcc(core, "performanceLocation", "laboratory")
        self._item(_dcc(_dcc(data, "items"), "item"), facts, about)
        self._contact(_dcc(_dcc(data, "calibrationLaboratory"), "contact"), facts.laboratory, facts.country, facts.city)
        self._persons(_dcc(data, "respPersons"), facts, about)
        country, city = facts.customer_country or facts.country, facts.customer_city or facts.city
        self._contact(_dcc(data, "customer"), facts.customer, country, city)

    def _item(self, item: ElementTree.Element, facts: CertificateFacts, about: CertifiedTest) -> None:
        self._text(item, "name", "Three-axis magnetometer")
        if facts.manufacturer:
            self._text(_dcc(item, "manufacturer"), "name", facts.manufacturer)
        if facts.model:
            _dcc(item, "model", facts.model)
        identification = _dcc(_dcc(item, "identifications"), "identification")
        _dcc(identification, "issuer", "manufacturer")
        _dcc(identification, "value", about.serial)
        self._text(identification, "name", "Serial number")

    def _persons(self, persons: ElementTree.Element, facts: CertificateFacts, about: CertifiedTest) -> None:
        responsible = _dcc(persons, "respPerson")
        self._text(_dcc(responsible, "person"), "name", facts.person)
        _dcc(responsible, "role", "responsible")
        _dcc(responsible, "mainSigner", "true")
        if about.operator:
            operator = _dcc(persons, "respPerson")
            self._text(_dcc(operator, "person"), "name", about.operator)
            _dcc(operator, "role", "operator")

    def _results(self, root: ElementTree.Element, fit: Fit, about: CertifiedTest, limits: PassLimits | None) -> None:
        result = _dcc(_dcc(root, "measurementResults"), "measurementResult")
        self._text(result, "name", "Calibration of the magnetometer")
        self._text(result, "description", REMARK)
        method = _dcc(_dcc(result, "usedMethods"), "usedMethod")
        self._text(method, "name", "Calibration in the earth's field")
        self._text(method, "description", METHOD)
        self._software(_dcc(result, "usedSoftware"))
        conditions = _dcc(result, "influenceConditions")
        self._condition(conditions, "Dip of the field", fit.claim.known_dip_deg, r"\degree")
        results = _dcc(result, "results")
        unit = UNITS[fit.calibration.unit]
        is_stated = fit.claim.states_uncertainty
        offset = self._result(results, "Offset of the axes x, y and z")
        _list(offset, fit.calibration.offset, unit, fit.claim.offset_sigma if is_stated else None)
        matrix = self._result(results, "Matrix, row by row")
        _list(matrix, fit.calibration.matrix.ravel(), r"\one", matrix_sigma(fit).ravel() if is_stated else None)
        for name, value, symbol in (
            ("Largest heading error of a level vehicle, standard deviation", fit.heading_error_deg.worst, r"\degree"),
            ("Standard deviation of the readings about the ellipsoid", fit.evidence.noise, unit),
            ("Strength of the corrected field", fit.calibration.field_strength, unit),
        ):
            if np.isfinite(value):
                _real(self._result(results, name), value, symbol)
        if limits is not None:
            self._conformity(result, about, limits)

    def _conformity(self, result: ElementTree.Element, about: CertifiedTest, limits: PassLimits) -> None:
        stated = _dcc(_dcc(result, "measurementMetaData"), "metaData")
        self._text(stated, "name", "Conformity with the pass limits of the station")
        self._text(stated, "declaration", f"Pass limits: {', '.join(_limits(limits))}.")
        _dcc(stated, "conformity", "pass" if about.is_passed else "fail")

    def _condition(self, conditions: ElementTree.Element, name: str, value: float, unit: str) -> None:
        condition = _dcc(conditions, "influenceCondition")
        self._text(condition, "name", name)
        _real(_dcc(_dcc(condition, "data"), "quantity"), value, unit)

    def _result(self, results: ElementTree.Element, name: str) -> ElementTree.Element:
        """Add a result with a name, and return its quantity."""
        result = _dcc(results, "result")
        self._text(result, "name", name)
        return _dcc(_dcc(result, "data"), "quantity")

    def _software(self, listed: ElementTree.Element) -> None:
        software = _dcc(listed, "software")
        self._text(software, "name", "Flinders")
        _dcc(software, "release", version("flinders"))

    def _contact(self, contact: ElementTree.Element, name: str, country: str, city: str) -> None:
        self._text(contact, "name", name)
        location = _dcc(contact, "location")
        _dcc(location, "city", city)
        _dcc(location, "countryCode", country)

    def _text(self, parent: ElementTree.Element, name: str, words: str) -> None:
        content = _dcc(_dcc(parent, name), "content", words)
        content.set("lang", self.language)


def _limits(limits: PassLimits) -> Iterator[str]:
    """Yield each pass limit in words."""
    unit = "microtesla" if limits.unit == "uT" else limits.unit
    yield f"largest heading error of a level vehicle at most {limits.heading_error_deg:g} degrees (1 sigma)"
    if limits.strength is not None:
        yield f"field strength {limits.strength[0]:g} to {limits.strength[1]:g} {unit}"
    if limits.offset is not None:
        yield f"offset of each axis {limits.offset[0]:g} to {limits.offset[1]:g} {unit}"
    if limits.noise is not None:
        yield f"noise at most {limits.noise:g} {unit} (1 sigma)"
    if limits.coverage is not None:
        yield f"at least {limits.coverage:.0%} of all directions recorded"
    yield f"verdict {limits.verdict}"


def _dcc(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    return _element(parent, DCC, name, text)


def _si(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    return _element(parent, SI, name, text)


def _element(parent: ElementTree.Element, space: str, name: str, text: str | None) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f"{{{space}}}{name}")
    element.text = text
    return element


def _real(quantity: ElementTree.Element, value: float, unit: str) -> None:
    real = _si(quantity, "real")
    _si(real, "value", _decimal(value))
    _si(real, "unit", unit)


def _list(quantity: ElementTree.Element, values: ArrayLike, unit: str, sigma: ArrayLike | None) -> None:
    """Add a list of numbers with their expanded uncertainties to a quantity."""
    numbers = _si(quantity, "realListXMLList")
    _si(numbers, "valueXMLList", _decimals(values))
    _si(numbers, "unitXMLList", unit)
    if sigma is None or not np.isfinite(np.asarray(sigma, float)).all():
        return
    expanded = _si(_si(numbers, "measurementUncertaintyUnivariateXMLList"), "expandedMUXMLList")
    _si(expanded, "valueExpandedMUXMLList", _decimals(COVERAGE_FACTOR * np.asarray(sigma, float)))
    _si(expanded, "coverageFactorXMLList", str(COVERAGE_FACTOR))
    _si(expanded, "coverageProbabilityXMLList", str(COVERAGE_PROBABILITY))
    _si(expanded, "distributionXMLList", "normal")


def _decimals(values: ArrayLike) -> str:
    return " ".join(map(_decimal, cast("Sequence[Any]", np.asarray(values, float).tolist())))


def _decimal(value: float) -> str:
    return f"{value:.9g}"
