"""A second function in generated code, for a calibration with disturbances.

The first function holds at the reference values of the disturbances. Names of columns become identifiers; a state is 0
or 1; both functions use the same matrix.

>>> from flinders.core.calibration import Calibration
>>> charger = Disturbance("/charger.state", [4.0, 0.0, -1.5], highest=1.0, states=("idle", "charging"))
>>> calibration = replace(Calibration.identity(field_strength=50.0), disturbances=(charger,))
>>> print(*in_module(calibration), sep=chr(10))
<BLANKLINE>
# charger_state: 0 is idle, 1 is charging
# /charger.state: 4, 0, -1.5 while charging, none while idle
CHARGER_STATE = (4.0, 0.0, -1.5)  # counts per unit of charger_state
<BLANKLINE>
<BLANKLINE>
def correct_at(raw, charger_state):
    \"\"\"correct() for other values of charger_state than their references.\"\"\"
    x, y, z = (raw[axis] - CHARGER_STATE[axis] * (charger_state - 0.0) for axis in range(3))
    return correct((x, y, z))
"""

from __future__ import annotations

import keyword
import re
import unicodedata
from dataclasses import dataclass, replace  # noqa: F401  the second for the example above
from typing import TYPE_CHECKING, Final, Self

from flinders.core.disturbance import Disturbance, is_column
from flinders.targets._code_templates import C_DISTURBED, C_GAIN, MODULE_DISTURBED, SKETCH_DISTURBED, SKETCH_GAIN
from flinders.targets._code_text import digits, float32s
from flinders.targets._comments import BLOCK
from flinders.targets._numbers import round_to_single, shift_in_recorded_axes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

MAX_LETTERS: Final = 24
"""Largest length, in letters, of an identifier made from the name of a column."""

RESERVED_WORDS: Final = frozenset(
    [
        "auto",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
        "bool",
        "class",
        "delete",
        "new",
        "private",
        "public",
        "this",
        "true",
        "false",
        "axis",
        "settled",
        "corrected",
        "raw",
        "grown",
        "matrix",
        "offset",
        "x",
        "y",
        "z",
        "u",
        "v",
        "w",
        "field_strength",
        "correct",
        "correct_at",
        "quadratic",
        "cubic",
        "limit",
        "linear",
        "strength_limit",
        "dip_limits",
    ]
)
"""Keywords of the languages, and names that generated code contains."""


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One disturbance in generated code."""

    key: str  # identifier of the disturbance's value
    disturbance: Disturbance
    per_unit: Floats  # (3,) change of the offset per unit, in the recorded unit and axes, as float32
    unit: str  # unit of the recorded readings
    zero: float  # reference value of the disturbance

    @classmethod
    def each(cls, calibration: Calibration) -> list[Self]:
        """Terms for all disturbances of a calibration."""
        keys: list[str] = []
        for one in calibration.disturbances:
            keys.append(identifier(one.name, keys) if is_column(one.name) else one.kind.key)
        return [
            cls(
                key,
                one,
                round_to_single(shift_in_recorded_axes(calibration, one) / calibration.raw.scale),
                calibration.raw.name,
                one.reference,
            )
            for key, one in zip(keys, calibration.disturbances, strict=True)
        ]

    def remarks(self) -> list[str]:
        """Remarks that describe the disturbance and its states."""
        states = self.disturbance.states
        meant = [f"{self.key}: 0 is {states[0]}, 1 is {states[1]}"] if states else []
        return [*meant, str(self.disturbance)]


def identifier(name: str, taken: list[str]) -> str:
    """Identifier from the letters and digits of a column's name, other than those in `taken`.

    >>> identifier("BAT[1].Curr", []), identifier("for", []), identifier("2nd servo", []), identifier("a.b", ["a_b"])
    ('BAT_1_Curr', 'for_value', 'column_2nd_servo', 'a_b_2')
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^0-9A-Za-z]+", "_", plain).strip("_")[:MAX_LETTERS].rstrip("_") or "column"
    word = f"column_{word}" if word[0].isdigit() else word
    word = f"{word}_value" if word.casefold() in RESERVED_WORDS or keyword.iskeyword(word) else word
    folded = {each.casefold() for each in taken}
    numbered = (word if count == 1 else f"{word}_{count}" for count in range(1, len(taken) + 2))
    return next(each for each in numbered if each.casefold() not in folded)


def in_c(calibration: Calibration, name: str) -> Iterator[str]:
    """Yield lines for a C header; none without disturbances."""
    terms = Term.each(calibration)
    if not terms:
        return
    for one in terms:
        yield ""
        yield from (f"/* {BLOCK.plain(remark)} */" for remark in one.remarks())
        declared = f"static const float {name}_{one.key.lower()}[3]"
        yield f"{declared} = {{{float32s(one.per_unit, 'f')}}}; /* {one.unit} per unit of {one.key} */"
    yield from C_DISTURBED.format(
        name=name,
        known=" and ".join(one.key for one in terms),
        arguments=", ".join(f"float {one.key}" for one in terms),
        terms="".join(f" - {name}_{one.key.lower()}[axis] * ({one.key} - {digits(one.zero, 'f')})" for one in terms),
    ).splitlines()
    for one in terms:
        if gain := one.disturbance.gain_per_unit:
            reference = digits(one.zero, "f")
            yield from C_GAIN.format(gain=digits(gain, "f"), key=one.key, reference=reference).splitlines()
    yield "}"


def in_sketch(calibration: Calibration, constant: str, function: str) -> Iterator[str]:
    """Yield lines for a sketch; none without disturbances."""
    terms = Term.each(calibration)
    if not terms:
        return
    for one in terms:
        yield ""
        yield from (f"// {BLOCK.plain(remark)}" for remark in one.remarks())
        declared = f"const float {constant}_{one.key.upper()}[3]"
        yield f"{declared} = {{{float32s(one.per_unit, 'f')}}}; // {one.unit} per unit of {one.key}"
    away = {one.key: f"({one.key} - {digits(one.zero, 'f')})" for one in terms}
    shifts = (
        f"  {axis} -= {' + '.join(f'{constant}_{one.key.upper()}[{place}] * {away[one.key]}' for one in terms)};"
        for place, axis in enumerate("xyz")
    )
    gains = {one.key: one.disturbance.gain_per_unit for one in terms if one.disturbance.gain_per_unit}
    factors = " * ".join(f"(1.0f + {digits(gain, 'f')} * {away[key]})" for key, gain in gains.items())
    yield from SKETCH_DISTURBED.format(
        known=" and ".join(away),
        function=function,
        arguments=", ".join(f"float {key}" for key in away),
        terms="\n".join(shifts),
        grown=SKETCH_GAIN.format(factors=factors) if gains else "",
    ).splitlines()


def in_module(calibration: Calibration) -> Iterator[str]:
    """Yield lines for a Python module; none without disturbances."""
    terms = Term.each(calibration)
    if not terms:
        return
    for one in terms:
        yield ""
        yield from (f"# {BLOCK.plain(remark)}" for remark in one.remarks())
        yield f"{one.key.upper()} = ({float32s(one.per_unit)})  # {one.unit} per unit of {one.key}"
    away = {one.key: f"({one.key} - {digits(one.zero)})" for one in terms}
    gains = {one.key: one.disturbance.gain_per_unit for one in terms if one.disturbance.gain_per_unit}
    factors = " * ".join(f"(1.0 + {digits(gain)} * {away[key]})" for key, gain in gains.items())
    corrected = "correct((x, y, z))"
    yield from MODULE_DISTURBED.format(
        known=" and ".join(away),
        arguments=", ".join(away),
        terms="".join(f" - {key.upper()}[axis] * {from_zero}" for key, from_zero in away.items()),
        result=f"tuple(each / ({factors}) for each in {corrected})" if gains else corrected,
    ).splitlines()
