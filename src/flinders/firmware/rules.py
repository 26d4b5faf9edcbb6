"""Tables of the firmware: rules of the catalogue of findings, and attitudes that advice is given in, as C.

A rule is on the board where all quantities that it compares are in `QUANTITIES`, which `board.c` calculates. Every
other finding of a fit, a recording or a calibration is listed as not checked.

>>> [row.code for row in on_board()][:3]
['one-plane', 'heading-error', 'coverage']
>>> "field-changed" in unchecked()
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.core.units import EARTH_UT
from flinders.findings import CATALOGUE, OF_ONE_MAGNETOMETER
from flinders.fitting.verdict import ENOUGH, ENOUGH_CORRELATED
from flinders.heading.guidance import POSE_WORDS
from flinders.summary.summary import FLAT, FLAT_NOISE, FLATTEST

if TYPE_CHECKING:
    from flinders.findings import CatalogueRow
    from flinders.findings.row import Grade, Needs, Rule

QUANTITIES: Final = (
    "flatness", "flatness_limit", "worst_deg", "target_deg", "hole_deg", "noise_share", "unobserved", "prior_share",
    "independent", "independent_needed", "independent_share", "inflation", "outlier_share", "axis_ratio",
    "times_outside_earth",
)  # fmt: skip
"""What `board.c` calculates of a fit, by the names of `flinders.fitting.verdict`."""

CONSTANTS: Final = {
    "FLAT": FLAT,
    "FLATTEST": FLATTEST,
    "FLAT_NOISE": FLAT_NOISE,
    "ENOUGH": ENOUGH,
    "ENOUGH_CORRELATED": ENOUGH_CORRELATED,
    "EARTH_WEAKEST": EARTH_UT[0],
    "EARTH_STRONGEST": EARTH_UT[1],
}
"""Numbers of quantities, by their names in C without the prefix."""

MADE: Final = "Made by `flinders firmware` from the library's catalogue of findings."


def on_board() -> list[CatalogueRow]:
    """Rows of the catalogue whose rule the board applies."""
    return [row for row in CATALOGUE.values() if row.rule.compared <= set(QUANTITIES)]


def unchecked() -> list[str]:
    """Codes of the findings of one magnetometer that the board does not make."""
    codes = [row.code for row in on_board()]
    return [row.code for row in OF_ONE_MAGNETOMETER if row.code not in codes]


def header() -> str:
    """`flinders_rules.h`: how many rules there are, names of quantities, and numbers of them."""
    quantities = ", ".join(map(_quantity, QUANTITIES))
    rules = ", ".join(f"FLINDERS_RULE_{row.code.upper().replace('-', '_')}" for row in on_board())
    return "\n".join(
        [
            f"/* {MADE} */",
            "#ifndef FLINDERS_RULES_H",
            "#define FLINDERS_RULES_H",
            "",
            f"enum {{ {quantities}, FLINDERS_QUANTITIES }};",
            f"enum {{ {rules}, FLINDERS_RULES }};",
            f"enum {{ FLINDERS_UNCHECKED = {len(unchecked())} }};",
            "",
            *(f"#define FLINDERS_{name} {_number(value)}" for name, value in CONSTANTS.items()),
            "#endif",
            "",
        ]
    )


def source() -> str:
    """`rules.c`: the tables themselves."""
    return "\n".join(
        [
            f"/* {MADE} */",
            '#include "flinders_board.h"',
            "",
            "const flinders_rule flinders_rules[FLINDERS_RULES] = {",
            *(_rule(row) for row in on_board()),
            "};",
            "",
            "const char *const flinders_poses[FLINDERS_SENSOR_POSES] = {",
            *(f"    {_text(words)}," for words in POSE_WORDS["sensor"]),
            "};",
            "",
            "const char *const flinders_unchecked[FLINDERS_UNCHECKED] = {",
            *(f"    {_text(code)}," for code in unchecked()),
            "};",
            "",
        ]
    )


def _rule(row: CatalogueRow) -> str:
    """One rule as an initialiser."""
    rule = row.rule
    words = f"{_text(row.code)}, {_text(row.fleet_action or row.action)}"
    counts = f"{_quantity(rule.quantity)}, {len(rule.grades)}, {len(rule.needs)}, {_comparison(rule.comparison)}"
    grades = ", ".join(f"{{FLINDERS_{grade.severity.upper()}, {_limit(grade)}}}" for grade in rule.grades)
    return f"    {{{words},\n     {counts}, {{{grades}}}, {_needs(rule)}}},"


def _needs(rule: Rule) -> str:
    """What has to hold as well; an empty list has one entry of zeros in C99."""
    entries = ", ".join(
        f"{{{_quantity(need.quantity)}, {_comparison(need.comparison)}, {_limit(need)}}}" for need in rule.needs
    )
    return f"{{{entries or '{0, 0, {0, 0}}'}}}"


def _comparison(comparison: str) -> str:
    """A comparison in one character, `g` for at least."""
    return "'g'" if comparison == ">=" else f"'{comparison}'"


def _limit(limit: Grade | Needs) -> str:
    return f"{{{_number(limit.factor)}, {_quantity(limit.times) if limit.times else 'FLINDERS_QUANTITIES'}}}"


def _quantity(name: str) -> str:
    return f"FLINDERS_Q_{name.upper()}"


def _number(value: float) -> str:
    """A number in the precision that a board has."""
    return f"(flinders_real){value:.9g}"


def _text(words: str) -> str:
    """A string in ASCII, which every serial monitor shows."""
    plain = words.replace("−", "-").replace("°", " degrees").replace("`", "").replace('"', "'")
    return f'"{plain.encode("ascii", "replace").decode()}"'
