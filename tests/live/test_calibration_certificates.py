"""Digital Calibration Certificates: what the schema 3.3.0 of PTB asks of each element, and the numbers of the fit.

`CONTENT` and `VALUES` are our own transcript of the content models and value patterns of dcc.xsd 3.3.0 and of D-SI, of
the elements that a certificate here has. They are no schema: where FLINDERS_DCC_SCHEMA names a folder with ``dcc.xsd``
and what it imports, certificates are validated against that as well.
"""

from __future__ import annotations

import os
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from lxml import etree
from tests.program import flinders_

from flinders import simulate
from flinders.apps.live.station.certificate import CertifiedTest, certificate
from flinders.apps.live.station.limits import misses
from flinders.apps.live.station.plan import CertificateFacts, PassLimits
from flinders.core.calibration import Calibration
from flinders.fitting import calibrate
from flinders.fitting.result import Fit, bare_fit

if TYPE_CHECKING:
    from lxml.etree import _Element

SPACES: Final = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
CONTENT: Final = {
    "digitalCalibrationCertificate": "administrativeData measurementResults comment? document?",
    # xs:all, in any order; here in that of the schema
    "administrativeData": "dccSoftware refTypeDefinitions? coreData items calibrationLaboratory respPersons customer "
    "statements?",
    "dccSoftware": "software+",
    "usedSoftware": "software+",
    "software": "name release type? description?",
    "coreData": "countryCodeISO3166_1 usedLangCodeISO639_1+ mandatoryLangCodeISO639_1+ uniqueIdentifier "
    "identifications? receiptDate? beginPerformanceDate endPerformanceDate performanceLocation issueDate? "
    "reportAmendedSubstituted? previousReport?",
    "items": "name? equipmentClass* description? owner? manufacturer? identifications? item+",
    "item": "name equipmentClass* description? owner? installedSoftwares? manufacturer? model? identifications "
    "itemQuantities? subItems?",
    "identifications": "identification+",
    "identification": "issuer value name?",
    "calibrationLaboratory": "calibrationLaboratoryCode? contact cryptElectronicSeal? cryptElectronicSignature? "
    "cryptElectronicTimeStamp?",
    "contact": "name eMail? phone? fax? link? location descriptionData?",
    "customer": "name eMail? phone? fax? link? location descriptionData?",
    "manufacturer": "name eMail? phone? fax? link? location? descriptionData?",
    "person": "name eMail? phone? fax? link? location? descriptionData?",
    "location": "city countryCode",
    "respPersons": "respPerson+",
    "respPerson": "person description? role? mainSigner? cryptElectronicSeal? cryptElectronicSignature? "
    "cryptElectronicTimeStamp?",
    "measurementResults": "usedMethods? usedSoftware? measuringEquipments? influenceConditions? measurementMetaData? "
    "measurementResult+",
    "measurementResult": "name description? usedMethods? usedSoftware? measuringEquipments? influenceConditions? "
    "results measurementMetaData?",
    "usedMethods": "usedMethod+",
    "usedMethod": "name description? norm* reference* link* usedMethodQuantities?",
    "influenceConditions": "influenceCondition+",
    "influenceCondition": "name description? status? certificate? data",
    "results": "result+",
    "result": "name description? data",
    "data": "quantity+",
    "quantity": "name? description? (real|realListXMLList) relativeUncertainty? usedMethods? usedSoftware? "
    "measuringEquipments? influenceConditions? measurementMetaData?",
    "measurementMetaData": "metaData+",
    "metaData": "name? description? countryCodeISO3166_1* convention? traceable? norm* reference* link* declaration? "
    "valid? date? period? respAuthority? conformity? data? nonSIDefinition? nonSIUnit? location?",
    "name": "content+",
    "description": "name? content+",
    "declaration": "name? content+",
    "real": "label? quantityType? value unit significantDigit? dateTime? measurementUncertaintyUnivariate?",
    "realListXMLList": "labelXMLList? quantityTypeXMLList? valueXMLList unitXMLList significantDigitXMLList? "
    "dateTimeXMLList? measurementUncertaintyUnivariateXMLList?",
    "measurementUncertaintyUnivariateXMLList": "expandedMUXMLList",
    "expandedMUXMLList": "valueExpandedMUXMLList coverageFactorXMLList coverageProbabilityXMLList distributionXMLList?",
}
"""Children of each element, in order."""
DECIMAL: Final = r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?"
NOT_EMPTY: Final = r"\S+(\s+\S+)*"
VALUES: Final = {
    "countryCodeISO3166_1": "[A-Z]{2}",
    "countryCode": "[A-Z]{2}",
    "usedLangCodeISO639_1": "[a-z]{2}",
    "mandatoryLangCodeISO639_1": "[a-z]{2}",
    "beginPerformanceDate": r"\d{4}-\d\d-\d\d",
    "endPerformanceDate": r"\d{4}-\d\d-\d\d",
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    "conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
    "mainSigner": "true|false|0|1",
    **dict.fromkeys(("release", "uniqueIdentifier", "model", "city", "role", "content"), NOT_EMPTY),
    "unit": r"(\\[a-z]+)+",
    "unitXMLList": r"(\\[a-z]+)+( (\\[a-z]+)+)*",
    "distributionXMLList": "normal",
    **dict.fromkeys(("valueXMLList", "valueExpandedMUXMLList"), f"{DECIMAL}( {DECIMAL})*"),
    **dict.fromkeys(("coverageFactorXMLList", "coverageProbabilityXMLList"), DECIMAL),
}
"""Text of each element without children; ``value`` is a number in D-SI, and a name in an identification."""

FACTS: Final = CertificateFacts(
    laboratory="Compass works", country="AU", city="Hobart", person="Ada L.", customer="Line <3> & co",
    manufacturer="Maker", model="M-1",
)  # fmt: skip
PLAIN: Final = CertificateFacts(laboratory="Labor", country="DE", city="Ulm", person="Bo", customer="Me", language="de")
ABOUT: Final = CertifiedTest(
    "A17", "A17/2026-05-01", datetime(2026, 5, 1, 8, tzinfo=UTC), datetime(2026, 5, 1, 9, tzinfo=UTC), "Bo"
)


@pytest.fixture(scope="module")
def fit() -> Fit:
    return calibrate.fit(simulate.tumble(seed=1).samples)


def rooted(text: str) -> _Element:
    return etree.fromstring(text.encode())


def name_of(element: _Element) -> str:
    return str(etree.QName(element).localname)


def faults(root: _Element) -> list[str]:
    """What the transcript of the schema asks and a certificate does not have."""
    found = []
    for element in root.iter():
        name, children = name_of(element), "".join(f"{name_of(child)};" for child in element)
        lineage = {name, *map(name_of, element.iterancestors())}
        if etree.QName(element).namespace != SPACES["si" if lineage & {"real", "realListXMLList"} else "dcc"]:
            found.append(f"{name} is in another namespace")
        if name in CONTENT:
            model = re.sub(r"\w+", r"(?:\g<0>;)", CONTENT[name]).replace(" ", "")
            if not re.fullmatch(model, children):
                found.append(f"{name} has {children}")
        elif not re.fullmatch(VALUES.get(name, NOT_EMPTY), element.text or ""):
            found.append(f"{name} is {element.text!r}")
    return found


@pytest.mark.parametrize("limits", [None, PassLimits()])
@pytest.mark.parametrize("facts", [FACTS, PLAIN])
def test_a_certificate_has_what_the_schema_asks_for(
    fit: Fit, facts: CertificateFacts, limits: PassLimits | None
) -> None:
    root = rooted(certificate(fit, facts, ABOUT, limits))
    assert root.get("schemaVersion") == "3.3.0"
    assert faults(root) == []


def test_what_the_schema_forbids_is_found(fit: Fit) -> None:
    """The transcript tells a certificate from one whose parts are missing, exchanged or out of range."""
    root = rooted(certificate(fit, FACTS, ABOUT, PassLimits()))
    core = root.find(".//dcc:coreData", SPACES)
    assert core is not None
    core.insert(0, core[-1])
    items = root.find(".//dcc:identifications", SPACES)
    assert items is not None
    items.clear()
    assert [fault.split()[0] for fault in faults(root)] == ["coreData", "identifications"]


def test_a_certificate_is_valid_by_the_schema_where_that_is_at_hand(fit: Fit) -> None:
    folder = os.environ.get("FLINDERS_DCC_SCHEMA")
    if folder is None:
        pytest.skip("FLINDERS_DCC_SCHEMA names no folder with dcc.xsd 3.3.0")
    schema = etree.XMLSchema(etree.parse(str(Path(folder) / "dcc.xsd")))
    schema.assertValid(rooted(certificate(fit, FACTS, ABOUT, PassLimits())))


def test_its_numbers_are_those_of_the_fit_with_twice_the_standard_deviation(fit: Fit) -> None:
    root = rooted(certificate(fit, FACTS, ABOUT))
    offset, matrix = (
        [np.array(element.text.split(), float) for element in root.iterfind(f".//si:{name}", SPACES)]
        for name in ("valueXMLList", "valueExpandedMUXMLList")
    )
    npt.assert_allclose(offset[0], fit.calibration.offset, rtol=1e-8)
    npt.assert_allclose(offset[1], fit.calibration.matrix.ravel(), rtol=1e-8)
    npt.assert_allclose(matrix[0], 2.0 * fit.claim.offset_sigma, rtol=1e-8)
    assert root.findtext(".//si:unitXMLList", namespaces=SPACES) == r"\micro\tesla"
    assert root.findtext(".//dcc:identification/dcc:value", namespaces=SPACES) == "A17"
    customer = root.findtext(".//dcc:customer/dcc:name/dcc:content", namespaces=SPACES)
    assert customer == "Line <3> & co"


def test_the_command_writes_one_of_a_calibration_file(fit: Fit, tmp_path: Path) -> None:
    fit.save(tmp_path / "a.json")
    facts = 'laboratory = "Lab"\ncountry = "AU"\ncity = "Hobart"\nperson = "Ada"\ncustomer = "Me"\n'
    (tmp_path / "line.toml").write_text(f"[certificate]\n{facts}[limits]\nnoise = 0.001\n", encoding="utf-8")
    plan, written = str(tmp_path / "line.toml"), str(tmp_path / "a.xml")
    ended = flinders_("certificate", str(tmp_path / "a.json"), "--plan", plan, "--serial-number", "A17", "-o", written)
    assert ended.code == 0, ended.err
    root = rooted(Path(written).read_text(encoding="utf-8"))
    assert faults(root) == []
    assert root.findtext(".//dcc:conformity", namespaces=SPACES) == "fail"


def test_it_states_every_limit_that_the_unit_was_held_against(fit: Fit) -> None:
    limits = PassLimits(heading_error_deg=0.7, strength=(41.0, 61.0), offset=(-52.0, 53.0), noise=0.83, coverage=0.6)
    root = rooted(certificate(fit, FACTS, ABOUT, limits))
    stated = root.findtext(".//dcc:declaration/dcc:content", namespaces=SPACES) or ""
    assert re.findall(r"-?\d+(?:\.\d+)?", stated) == ["0.7", "1", "41", "61", "-52", "53", "0.83", "1", "60"]


def test_a_calibration_of_which_nothing_is_stated_does_not_conform() -> None:
    assert [miss.code for miss in misses(bare_fit(Calibration.identity()), PassLimits())] == ["unstated"]
