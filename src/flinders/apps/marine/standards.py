"""Rules for compasses of aircraft and ships: procedure, headings, and the largest deviation they allow.

A rule has a limit here only if the limit was taken from the rule's own text, word for word; for the other rules the
user gives the limit. `sources` lists the texts from which a rule was taken. The rule itself may contain more, and is
decisive for a certificate.

>>> rule = STANDARDS["ac43.13-1b"]
>>> rule.limit_deg, rule.step_deg
(10.0, 30.0)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Standard:
    """A rule for compasses, with the checklist of its swing."""

    name: str  # name in the command line
    title: str  # full name of the rule
    limit_deg: float | None  # largest deviation on any heading; None if the text of the rule was not available
    step_deg: float  # step between the headings of a swing, and between the lines of its card
    checklist: tuple[str, ...]  # steps of a swing
    sources: tuple[str, ...]  # texts from which the rule was taken, each with the place in it

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, by the names of the attributes."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


AIRCRAFT: Final = (
    "Stand at least 100 yards from any metal object, and clear of steel structures, buried pipes and cables.",
    "Carry nothing magnetic; use non-magnetic tools.",
    "Put all that affects the compass in its place for flight; engines running, electrical equipment on as in flight.",
    "Set the compensator to zero effect.",
    "Correction swing: write down compass and reference within 5° of N, E, S and W; --compensate gives corrections.",
)
"""Steps of AC 43.13-1B paragraph 12-37 b and of the manual of a sight compass, in our words."""

SHIP: Final = (
    "Put all magnetic gear into its normal seagoing position; secure degaussing coils.",
    "Stay clear of other ships, piers and wrecks, in calm water.",
    "Correction swing: steady for two minutes on each of N, E, S and W; --compensate gives corrections.",
    "Residual swing: steady on eight headings, 45° apart, by bearings, a gyro or satellite compass, or courses.",
    "Keep table or curve of the residual deviations near the compass.",
)
"""Steps of a compass adjuster on a ship, after sections 601 and 613 of the American Practical Navigator (Bowditch)."""

BARFIELD: Final = "Barfield 101-01200 sight compass, manual 56-101-01200 rev. G, pages 11 and 12: procedure, every 30°"

_ROWS: Final = (
    Standard(
        "ac43.13-1b",
        "FAA AC 43.13-1B paragraph 12-37, with 14 CFR 23.1327 (before amendment 64)",
        10.0,
        30.0,
        (*AIRCRAFT, "Check swing: every 30°; card within 10° on every heading."),
        (
            "AC 43.13-1B CHG 1 paragraph 12-37 a and b: landseaskyspace.com/ac4313/12-37.html",
            "14 CFR 23.1327 at amendment 23-20: faa-aircraft-certification.com/compass-swing-requirements.html",
            BARFIELD,
        ),
    ),
    Standard(
        "14cfr25",
        "14 CFR 25.1327 and 25.1547, transport airplanes (29.1327: the same limit for rotorcraft)",
        10.0,
        45.0,
        (*AIRCRAFT, "Check swing: at most 45° apart, in level attitude; state on the card: radios on, or off."),
        (
            "14 CFR 25.1327 and 29.1327: lexbuild.dev/ecfr/title-14/chapter-I",
            "14 CFR 25.1547: faraim.org/faa/far/cfr/title-14/part-25/section-25.1547",
        ),
    ),
    Standard(
        "ac43-215",
        "FAA AC 43-215, Standardized Procedures for Performing Aircraft Magnetic Compass Calibration",
        None,
        30.0,
        (*AIRCRAFT, "Check swing: every 30°."),
        ("its title page and purpose alone: pdf4pro.com; faa.gov document 1031648", BARFIELD),
    ),
    Standard(
        "cap562",
        "UK CAA CAP 562, compass swinging",
        None,
        45.0,
        (*AIRCRAFT, "Check swing: every 45°; A is the mean on N, E, S and W: take it out by turning the compass."),
        ("worked worksheets alone: pdfslide.us/documents/compass-compensation-worksheet-examples.html",),
    ),
    Standard(
        "marshall-islands",
        "Republic of the Marshall Islands Marine Notice 2-011-32 (6/09)",
        5.0,
        45.0,
        SHIP,
        ("paragraph 1.1: scribd.com/document/440978417",),
    ),
    Standard(
        "solas",
        "SOLAS V/19 with Annex 13 of the guidance of the UK MCA",
        None,
        45.0,
        (
            "Adjust when new or unreliable, after structural repairs or new electrical equipment near the compass,",
            "and after two years without a record of deviations, or where the recorded ones are excessive.",
            *SHIP,
        ),
        ("Annex 13, when to adjust, as quoted by compassadjuster.com; no limit in what was seen",),
    ),
    Standard(
        "imo-a382",
        "IMO resolution A.382(X), carriage and performance of magnetic compasses",
        None,
        45.0,
        SHIP,
        ("preamble and the beginning of Annex I: puc.overheid.nl/nsi/doc/PUC_2469_14/1",),
    ),
    Standard(
        "iso25862",
        "ISO 25862, marine magnetic compasses; Annex G, adjustment",
        None,
        45.0,
        SHIP,
        ("title and contents alone: scribd.com/document/599477405",),
    ),
    Standard(
        "33cfr164",
        "33 CFR 164.35, compass of ships in waters of the United States",
        None,
        45.0,
        (*SHIP, "Have a current deviation table or graph, or a compass comparison record, in the wheelhouse."),
        ("paragraph (c) as quoted by annapoliscompass.com/uscg; it asks for a table and names no limit",),
    ),
)

STANDARDS: Final[Mapping[str, Standard]] = {row.name: row for row in _ROWS}
"""Rules for compasses, by name."""
