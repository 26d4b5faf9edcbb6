"""The rules of the catalogue as C tables for the engine, made from the rows.

``python -m flinders.findings.c_tables`` writes ``flinders_rules.h`` and ``rules.c`` of `flinders.native`; a test
compares them with the rows.

>>> header().splitlines()[1]
'#ifndef FLINDERS_RULES_H'
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from flinders.findings.catalogue import (
    CATALOGUE,
    ENGINE_FINDINGS,
    OTHER_FINDINGS,
    QUANTITIES,
    QUANTITIES_OF_A_FIT,
    RECORDING_FINDINGS,
    RULES,
)
from flinders.findings.row import CAUSES, CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.findings.row import Cause, Grade, Limit, Needs

FOLDER: Final = Path(__file__).parents[1] / "native"
"""Folder of the engine's sources."""

NOTICE: Final = "Made by `python -m flinders.findings.c_tables` from the catalogue of findings. */"


def header() -> str:
    """`flinders_rules.h`: names and numbers of quantities, rules and conditions."""
    return "\n".join(
        [
            f"/* {NOTICE}",
            "#ifndef FLINDERS_RULES_H",
            "#define FLINDERS_RULES_H",
            "",
            "/* Quantities that rules compare; the first of them are those of a fit. */",
            "enum {",
            *(f"    {_quantity(name)}," for name in QUANTITIES),
            "};",
            "",
            "/* Rules, a finding each; the first of them are those of a fit. */",
            "enum {",
            *(f"    {_rule_name(code)}," for code in RULES),
            "};",
            "",
            "/* What a verdict rests on where no finding speaks against it: bits of `conditions`. */",
            f"enum {{ {', '.join(f'{_condition(code)} = {1 << bit}' for bit, code in enumerate(CONDITIONS))} }};",
            "",
            f"#define FLINDERS_QUANTITIES {len(QUANTITIES)}",
            f"#define FLINDERS_QUANTITIES_OF_A_FIT {len(QUANTITIES_OF_A_FIT)}",
            f"#define FLINDERS_RULES {len(RULES)}",
            f"#define FLINDERS_RULES_OF_A_FIT {len(ENGINE_FINDINGS)}",
            f"#define FLINDERS_RULES_OF_A_RECORDING {len(RECORDING_FINDINGS)} /* the last of those of a fit */",
            f"#define FLINDERS_CAUSES {len(CAUSES)}",
            "#endif",
            "",
        ]
    )


def source() -> str:
    """`rules.c`: the tables of the rules. A board has only the rules about a fit."""
    own, others = _Tables(), _Tables()
    own.add(ENGINE_FINDINGS)
    others.comparisons = [*own.comparisons]
    others.add(OTHER_FINDINGS)
    return "\n".join(
        [
            f"/* {NOTICE}",
            '#include "judge.h"',
            "",
            "const flinders_comparison fl_comparisons[] = {",
            *own.comparisons,
            "#ifndef FLINDERS_SMALL",
            *others.comparisons[len(own.comparisons) :],
            "#endif",
            "};",
            "",
            "const flinders_rule fl_rules[FL_RULES] = {",
            *own.rules,
            "#ifndef FLINDERS_SMALL",
            *others.rules,
            "#endif",
            "};",
            "",
            "const fl_cause fl_causes[FLINDERS_CAUSES] = {",
            *map(_cause, CAUSES),
            "};",
            "",
        ]
    )


class _Tables:
    """C initialisers of rules and of their comparisons: grades, needs and the stated limit."""

    def __init__(self) -> None:
        self.comparisons: list[str] = []
        self.rules: list[str] = []

    def add(self, codes: Iterable[str]) -> None:
        """Add rules of the catalogue."""
        for code in codes:
            row = CATALOGUE[code]
            rule, first = row.rule, len(self.comparisons)
            self.comparisons += [
                _comparison(rule.quantity, rule.comparison, each, each.severity) for each in rule.grades
            ]
            self.comparisons += [_comparison(need.quantity, need.comparison, need) for need in rule.needs]
            self.comparisons.append(_comparison(rule.number or rule.quantity, ">", rule.stated_limit))
            words = f"{c_string(row.code)}, {c_string(row.fleet_action or row.action)}"
            self.rules.append(f"    {{{words}, {first}, {len(rule.grades)}, {len(rule.needs)}}},")


def _comparison(quantity: str, comparison: str, limit: Grade | Needs | Limit, severity: str = "nothing") -> str:
    """C initialiser of a comparison; the character `g` stands for ``>=``."""
    factor, times = (
        f"(flinders_real){limit.factor:.17g}",
        _quantity(limit.times) if limit.times else "FLINDERS_QUANTITIES",
    )
    sign = "'g'" if comparison == ">=" else f"'{comparison}'"
    return f"    {{{factor}, {times}, {_quantity(quantity)}, FLINDERS_{severity.upper()}, {sign}}},"


def _cause(cause: Cause) -> str:
    """C initialiser of a cause, with those of its consequences that the engine finds."""
    followed = ", ".join(_rule_name(code) for code in cause.consequences) or "0"
    unless = _rule_name(cause.unless) if cause.unless else "FLINDERS_RULES"
    counts = f"FLINDERS_{cause.severity.upper()}, {unless}, {len(cause.consequences)}"
    return f"    {{{_rule_name(cause.code)}, {counts}, {{{followed}}}}},"


def _quantity(name: str) -> str:
    return f"FLINDERS_Q_{name.upper()}"


def _rule_name(code: str) -> str:
    return f"FLINDERS_RULE_{code.upper().replace('-', '_')}"


def _condition(code: str) -> str:
    return f"FLINDERS_IF_{code.upper().replace('-', '_')}"


def c_string(words: str) -> str:
    """A C string in ASCII, which every serial monitor can show."""
    plain = words.replace("−", "-").replace("°", " degrees").replace("`", "").replace('"', "'")
    return f'"{plain.encode("ascii", "replace").decode()}"'


if __name__ == "__main__":
    (FOLDER / "flinders_rules.h").write_text(header(), encoding="utf-8")
    (FOLDER / "rules.c").write_text(source(), encoding="utf-8")
