"""Code to compile: a C99 header in single precision or fixed point, an Arduino sketch, a MicroPython module.

``corrected = A (raw − b)``: raw readings are in the recorded axes and corrected ones in the axes of the calibration, so
A includes the mapping of axes. In single precision the recorded unit is converted to µT if it is known. In fixed point,
input and output are integers in the recorded unit: entries of A have 15 or 31 bits, and b is in units of 2⁻⁸ or 2⁻⁴.

>>> from flinders.core.calibration import Calibration
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0)
>>> code = FixedPoint.of(calibration, Q15)
>>> code.entries[0], code.shift, code.offset
((20480, 0, 0), 14, (30822, -8090, 1792))
>>> code.apply([440, -32, 7])                                           # 1.25 · 319.6 = 399.5, −0.4, 0
array([400.,   0.,   0.])
>>> module: dict[str, object] = {}
>>> exec(chr(10).join(write_micropython(calibration, ExportOptions()).body), module)
>>> module["correct"]((520.4, -31.6, 7))
(500.0, 0.0, 0.0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, check_vectors, to_floats
from flinders.core.linearization import Linearization
from flinders.core.units import unit_label
from flinders.errors import NotExportable, figures
from flinders.targets._code_templates import (
    C_CURVE,
    C_DIP,
    C_FIXED_POINT,
    C_FLOAT,
    C_STRENGTH,
    MODULE,
    MODULE_CURVE,
    MODULE_DIP,
    MODULE_STRENGTH,
    SKETCH,
    SKETCH_CURVE,
    SKETCH_DIP,
    SKETCH_STRENGTH,
)
from flinders.targets._code_text import add_guard, digits, float32s, name_prefix
from flinders.targets._comments import BLOCK, HASH
from flinders.targets._following import in_c, in_module, in_sketch
from flinders.targets._heading_code import C_HEADING, PYTHON_HEADING, SKETCH_HEADING
from flinders.targets._inertial_forms import code_form
from flinders.targets._numbers import OWN, RECORDED, Affine, round_to_integers, round_to_single, unmapping_matrix
from flinders.targets._target import FALSE_ALARM_PROBABILITY, TILT_DEG, ExportOptions, Gates, Target, Written

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "generated code"
ADVICE: Final = "readings are too large for this format: use the one in single precision"


@dataclass(frozen=True, slots=True)
class FixedPointFormat:
    """A fixed-point format."""

    name: str  #: ``Q15`` or ``Q31``
    bits: int  #: number of bits of an entry of the matrix, including the sign
    fraction: int  #: number of bits of the offset after the point
    largest: int  #: readings are limited to the range from −largest − 1 to this


Q15: Final = FixedPointFormat("Q15", 16, 8, 2**15 - 1)
Q31: Final = FixedPointFormat("Q31", 32, 4, 2**23 - 1)

DEFAULT_NAME: Final = "flinders"
"""Default prefix of names in C code."""


@dataclass(frozen=True, slots=True)
class FixedPoint:
    """A correction in integers: ``(Σ entries (raw 2^f − offset) + half) >> (shift + f)``, f being `fraction`."""

    format: FixedPointFormat
    entries: tuple[tuple[int, int, int], ...]  #: (3, 3): entries of the matrix, in units of 2^-shift
    offset: tuple[int, ...]  #: (3,): offset, in units of 2^-f
    shift: int  #: number of bits of an entry after the point: as many as the largest entry permits

    @classmethod
    def of(cls, calibration: Calibration, form: FixedPointFormat) -> Self:
        """Round a calibration; `NotExportable` if a matrix or an offset is beyond the range of the format."""
        affine = Affine.of(calibration, RECORDED, who=WHO, acts="across")
        largest = float(np.abs(affine.matrix).max())
        shift = form.bits - 1 - max(math.floor(math.log2(largest)) + 1, 0) if largest > 0 else form.bits - 1
        if np.rint(largest * 2.0**shift) >= 2 ** (form.bits - 1):
            shift -= 1
        if shift < 1:
            raise NotExportable(
                f"the matrix has an entry of {largest:.3g}, {form.name} holds up to {2 ** (form.bits - 2)}: {ADVICE}",
                beyond=("matrix",),
            )
        entries = np.rint(affine.matrix * 2.0**shift).astype(np.int64)
        edge = (form.largest + 1) << form.fraction
        names = ("offset x", "offset y", "offset z")
        with np.errstate(over="ignore"):
            scaled = affine.offset * 2.0**form.fraction
        offset = round_to_integers(scaled, names, lowest=-edge, highest=edge, advice=ADVICE)
        return cls(form, tuple(tuple(row) for row in entries.tolist()), offset, shift)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct (..., 3) readings in the recorded unit as the code does, which rounds them first."""
        form, edge = self.format, self.format.largest
        read = np.clip(np.nan_to_num(np.rint(check_vectors(field, finite=False))), -edge - 1, edge).astype(np.int64)
        moved = (read << form.fraction) - np.array(self.offset, np.int64)
        places = self.shift + form.fraction
        sums = (moved @ np.array(self.entries, np.int64).T + (1 << (places - 1))) >> places
        return to_floats(np.clip(sums, -edge - 1, edge))


def single_precision(calibration: Calibration) -> Affine:
    """A and b as float32 for readings in the recorded unit; corrected readings are in µT, or in counts."""
    affine = Affine.of(calibration, RECORDED, who=WHO, acts="across")
    return Affine(affine.matrix * calibration.raw.scale, affine.offset, calibration.field_strength).single


def write_header(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a header in single precision: ``flinders_correct(raw, corrected)``. Headings need ``math.h``."""
    name = name_prefix(DEFAULT_NAME, asked.name)
    reading = Reading("raw[{0}] - " + name + "_offset[{0}]", name + "_linear", C_CURVE)
    code = _fill_template(C_FLOAT, calibration, reading, name=name, constant=name.upper())
    code = _add_gates(code, calibration, asked, (C_STRENGTH, C_DIP), name=name, constant=name.upper())
    code = C_HEADING.add_to(code, calibration.unit, asked, name=name, constant=name.upper())
    return replace(code, body=add_guard(name, [*code.body, *in_c(calibration, name)]))


def write_sketch(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a part of a sketch: ``correctMagnetometer(x, y, z)`` changes three readings in place."""
    name = name_prefix("", asked.name)
    constant, function = (f"{name.upper()}_MAG", f"{name}_correct") if name else ("MAG", "correct")
    prefix = f"{name}_" if name else ""
    reading = Reading("{1} - " + constant + "_OFFSET[{0}]", prefix + "linearField", SKETCH_CURVE)
    code = _fill_template(SKETCH, calibration, reading, constant=constant, function=function, prefix=prefix)
    code = replace(code, body=[*code.body, *in_sketch(calibration, constant, function)])
    code = _add_gates(code, calibration, asked, (SKETCH_STRENGTH, SKETCH_DIP), constant=constant, prefix=prefix)
    return SKETCH_HEADING.add_to(code, calibration.unit, asked, constant=constant, prefix=prefix)


def write_micropython(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a module for MicroPython and CircuitPython: ``correct((x, y, z))``. Headings need `math`."""
    reading = Reading("raw[{0}] - OFFSET[{0}]", "linear", MODULE_CURVE)
    code = _fill_template(MODULE, calibration, reading, suffix="", row="    ({}),")
    code = replace(code, body=[*code.body, *in_module(calibration)])
    code = _add_gates(code, calibration, asked, (MODULE_STRENGTH, MODULE_DIP), suffix="")
    return PYTHON_HEADING.add_to(code, calibration.unit, asked)


@dataclass(frozen=True, slots=True)
class Reading:
    """Expressions of a language for a reading minus its offset, and for the linearization of a reading."""

    departure: str  # expression for the axis with the number {0} and the name {1}
    function: str
    curve: str  # text of that function, and its numbers

    def expressions(self, *, is_curved: bool) -> dict[str, str]:
        """Expressions by which the matrix is multiplied."""
        departures = [self.departure.format(axis, name) for axis, name in enumerate("xyz")]
        linear = [f"{self.function}({axis}, {each})" for axis, each in enumerate(departures)]
        return dict(zip("uvw", linear if is_curved else departures, strict=True))


def _fill_template(
    text: str, calibration: Calibration, reading: Reading, *, suffix: str = "f", row: str = "    {{{}}},", **names: str
) -> Written:
    """Code in single precision: a template that is filled with names and numbers."""
    numbers, curve = single_precision(calibration), recorded_curve(calibration)
    given, result = calibration.raw.name, calibration.unit
    values = {"matrix": numbers.matrix, "offset": numbers.offset, "unit_in": given, "unit_out": result}
    formula, curved = "", ""
    if curve is not None:
        terms = curve.as_dict()
        written = {name: float32s(term, suffix) for name, term in terms.items()}
        curved = reading.curve.format(given=given, **written, **names)
        values, formula = values | terms, "corrected = A (u - (quadratic + cubic u) u^2), u = raw - b"
    body = text.format(
        rows="\n".join(row.format(float32s(entries, suffix)) for entries in numbers.matrix),
        offset=float32s(numbers.offset, suffix),
        strength=digits(numbers.strength, suffix),
        given=given,
        result=result,
        curve=curved,
        **reading.expressions(is_curved=curve is not None),
        **names,
    )
    apply = partial(_apply, numbers=numbers, curve=curve)
    return Written(apply, body.splitlines(), values, formula=formula)


def _apply(raw: Floats, *, numbers: Affine, curve: Linearization | None) -> Floats:
    """Correct (..., 3) readings, as the generated code does."""
    return numbers.apply(raw if curve is None else numbers.offset + curve.apply(raw - numbers.offset))


def recorded_curve(calibration: Calibration) -> Linearization | None:
    """Linearization of the recorded axes in the recorded unit, as float32; None without one.

    >>> from flinders.core.axes import Axes
    >>> from flinders.core.calibration import Calibration
    >>> curve = Linearization([0.001, 0.002, 0.0], [1e-5, 0.0, 0.0], [60, 50, 40])
    >>> mapped = Calibration(np.eye(3), [1, 2, 3], 50.0, axes=Axes.of("y,-x,z"), linearization=curve)
    >>> turned = recorded_curve(mapped)
    >>> turned.quadratic.round(4).tolist(), turned.cubic.round(6).tolist(), turned.limit
    ([-0.002, 0.001, 0.0], [0.0, 1e-05, 0.0], array([50., 60., 40.]))
    """
    curve, scale, back = calibration.linearization, calibration.raw.scale, unmapping_matrix(calibration)
    if curve is None:
        return None
    cubic, limit = np.abs(back) @ curve.cubic, np.abs(back) @ curve.limit
    return Linearization(
        round_to_single(scale * back @ curve.quadratic),
        round_to_single(scale**2 * cubic),
        round_to_single(limit / scale),
    )


def _add_gates(
    code: Written,
    calibration: Calibration,
    asked: ExportOptions,
    texts: tuple[str, str],
    suffix: str = "f",
    **names: str,
) -> Written:
    """Append functions that recognise a disturbed reading by its strength and dip, if limits are known."""
    gates = asked.gates
    if gates is None:
        return code
    strength, dip = texts
    unit, (low, high) = calibration.unit, signed_squares(gates)
    numbers = {
        "strength": digits(calibration.field_strength, suffix),
        "limit": digits(gates.strength_limit, suffix),
        "low": digits(low, suffix),
        "high": digits(high, suffix),
    }
    text = strength + (dip if gates.has_dip else "")
    body = [*code.body, *text.format(result=unit, **numbers, **names).splitlines()]
    values = {**code.values, "strength_limit": gates.strength_limit}
    if gates.has_dip:
        values |= {"dip_deg": gates.dip_deg, "dip_limit_deg": gates.dip_limit_deg}
    return replace(code, body=body, values=values, notes=[*code.notes, *gate_words(gates, unit)])


def signed_squares(gates: Gates) -> tuple[float, float]:
    """Values sin x |sin x| at both limits of the dip, compared without a square root; beyond ±1 without a limit.

    >>> signed_squares(Gates(strength_limit=2.5, dip_deg=60.0, dip_limit_deg=4.0))
    (0.687..., 0.808...)
    """
    low, high = gates.dip_deg - gates.dip_limit_deg, gates.dip_deg + gates.dip_limit_deg
    below = -2.0 if low <= -90.0 else math.sin(math.radians(low))
    above = 2.0 if high >= 90.0 else math.sin(math.radians(high))
    return below * abs(below), above * abs(above)


def gate_words(gates: Gates, unit: str) -> list[str]:
    """Words for the limits of an undisturbed reading.

    >>> print(*gate_words(Gates(strength_limit=2.5, dip_deg=60.0, dip_limit_deg=4.0), "uT"), sep=chr(10))
    a clean reading is off by more than 2.5 µT of strength at most once in 10,000 times where the field is that of the \
recording
    and by more than 4.0° of dip as seldom, with a vertical that is good to 1° (1 σ)
    """
    often = f"at most once in {round(1 / FALSE_ALARM_PROBABILITY):,} times where the field is that of the recording"
    words = [
        f"a clean reading is off by more than {figures(gates.strength_limit)} {unit_label(unit)} of strength {often}"
    ]
    if gates.has_dip:
        words.append(
            f"and by more than {figures(gates.dip_limit_deg)}° of dip as seldom, with a vertical that is good to "
            f"{TILT_DEG:.0f}° (1 σ)"
        )
    return words


def write_q15(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a header for 16-bit integer readings; `NotExportable` for numbers out of range."""
    return _write_fixed_point(calibration, Q15, "int16_t", asked)


def write_q31(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a header for 24-bit integer readings in 32 bits; `NotExportable` for numbers out of range."""
    return _write_fixed_point(calibration, Q31, "int32_t", asked)


def _write_fixed_point(calibration: Calibration, form: FixedPointFormat, whole: str, asked: ExportOptions) -> Written:
    """Code in integers; `whole` is the C type of a reading."""
    code, name = FixedPoint.of(calibration, form), name_prefix(DEFAULT_NAME, asked.name)
    unit, places = calibration.raw.name, code.shift + form.fraction
    text = C_FIXED_POINT.format(
        name=name,
        unit=unit,
        bits=form.bits,
        shift=code.shift,
        fraction=form.fraction,
        rows="\n".join(f"    {{{', '.join(map(str, row))}}}," for row in code.entries),
        offset=", ".join(map(str, code.offset)),
        whole=whole,
        largest=form.largest,
        step=1 << form.fraction,
        half=places - 1,
        places=places,
    )
    values = {"entries": code.entries, "shift": code.shift, "offset": code.offset, "fraction": form.fraction}
    notes = [f"readings and results are whole numbers of {unit}"]
    return Written(code.apply, add_guard(name, text.splitlines()), values, notes)


HEADER: Final = Target(
    name="c",
    use="C99 header, single precision",
    group="microcontrollers",
    suffix=".h",
    title="C99 header",
    formula="corrected = A (raw - b)",
    unit=RECORDED,
    keeps="all",
    storage="float32",
    source="this program",
    acts="across",
    gives=OWN,
    follows="all",
    linearizes=True,
    comment=BLOCK,
    named=True,
    writes_noise=True,
    inertial=code_form("c"),
    write=write_header,
)
HEADER_Q15: Final = replace(
    HEADER,
    name="c-q15",
    use="C99 header, 16-bit fixed point",
    title="C99 header, Q15",
    follows="",
    linearizes=False,
    storage="int16 readings, int16 matrix, offset in 2^-8 of a unit, 64-bit sums",
    gives=RECORDED,
    writes_noise=False,
    inertial=None,
    write=write_q15,
)
HEADER_Q31: Final = replace(
    HEADER_Q15,
    name="c-q31",
    use="C99 header, 32-bit fixed point",
    title="C99 header, Q31",
    storage="int32 readings to +/-2^23, int32 matrix, offset in 2^-4 of a unit, 64-bit sums",
    write=write_q31,
)
ARDUINO: Final = replace(
    HEADER,
    name="arduino",
    use="Arduino sketch",
    suffix=".ino",
    title="Arduino sketch",
    inertial=code_form("sketch"),
    write=write_sketch,
)
MICROPYTHON: Final = replace(
    ARDUINO,
    name="micropython",
    use="MicroPython, CircuitPython",
    suffix=".py",
    title="MicroPython module",
    storage="the float of the board, 30 bits or more",
    comment=HASH,
    named=False,
    inertial=code_form("python"),
    write=write_micropython,
)
TARGETS: Final = (HEADER, HEADER_Q15, HEADER_Q31, ARDUINO, MICROPYTHON)
