"""Code to compile in: a C99 header in single precision or fixed point, an Arduino sketch, a MicroPython module.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> found = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> module: dict[str, object] = {}
>>> exec(render_micropython(found, target="micropython").text, module)
>>> module["correct"]((10, -20, 130))
(0.0, 0.0, 50.0)

All take readings as they were recorded, in that unit and those axes, and give them in the calibration's axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import OWN, RECORDED, Affine
from flinders.conventions.code import Q15, Q31, FixedPoint, Format, single_precision, unit_in, unit_out
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import BLOCK, HASH, Sheet, digits

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.arrays import Floats
    from flinders.calibration import Calibration

HEADER: Final = Sheet(
    title="C99 header",
    formula="corrected = A (raw - b)",
    unit=RECORDED,
    keeps="all",
    storage="float32",
    source="this program",
    acts="across",
    gives=OWN,
    comment=BLOCK,
)
SKETCH: Final = replace(HEADER, title="Arduino sketch")
MODULE: Final = replace(
    HEADER, title="MicroPython module", storage="the float of the board, 30 bits or more", comment=HASH
)
SHORT: Final = replace(
    HEADER,
    title="C99 header, Q15",
    storage="int16 readings, int16 matrix, offset in 2^-8 of a unit, 64-bit sums",
    gives=RECORDED,
)
LONG: Final = replace(
    HEADER,
    title="C99 header, Q31",
    storage="int32 readings to +/-2^23, int32 matrix, offset in 2^-4 of a unit, 64-bit sums",
    gives=RECORDED,
)

FLOAT_BODY: Final = """\
{{
    const float x = raw[0] - flinders_offset[0];
    const float y = raw[1] - flinders_offset[1];
    const float z = raw[2] - flinders_offset[2];
    int row;
    for (row = 0; row < 3; row++) {{
        corrected[row] = flinders_matrix[row][0] * x + flinders_matrix[row][1] * y + flinders_matrix[row][2] * z;
    }}
}}"""

FIXED_BODY: Final = """\
static inline int64_t flinders_held(int64_t value)
{{
    return value > {largest} ? {largest} : value < -{largest} - 1 ? -{largest} - 1 : value;
}}

/* The largest whole number that is not above value / 2^places. */
static inline int64_t flinders_shifted(int64_t value, int places)
{{
    return value >= 0 ? value >> places : -((-value + ((int64_t)1 << places) - 1) >> places);
}}

/* From {unit} as recorded to {unit}; both may be the same array. */
static inline void flinders_correct(const {whole} raw[3], {whole} corrected[3])
{{
    int64_t moved[3];
    int row, column;
    for (column = 0; column < 3; column++) {{
        moved[column] = flinders_held(raw[column]) * {step} - flinders_offset[column];
    }}
    for (row = 0; row < 3; row++) {{
        int64_t sum = (int64_t)1 << {half};
        for (column = 0; column < 3; column++) {{
            sum += (int64_t)flinders_matrix[row][column] * moved[column];
        }}
        corrected[row] = ({whole})flinders_held(flinders_shifted(sum, {places}));
    }}
}}"""


def render_header(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write a header in single precision, which includes nothing: ``flinders_correct(raw, corrected)``."""
    numbers = single_precision(calibration)
    body = [
        *_opened(),
        *_array("static const float flinders_matrix[3][3]", numbers.matrix),
        f"static const float flinders_offset[3] = {{{_listed(numbers.offset)}}}; /* {unit_in(calibration)} */",
        f"#define FLINDERS_FIELD_STRENGTH {digits(numbers.strength, 'f')} /* {unit_out(calibration)} */",
        "",
        f"/* From {unit_in(calibration)} as recorded to {unit_out(calibration)}; both may be the same array. */",
        "static inline void flinders_correct(const float raw[3], float corrected[3])",
        *FLOAT_BODY.format().splitlines(),
        *CLOSED,
    ]
    return _exported(HEADER, calibration, numbers, body, target=target, about=about, asked=asked)


def render_sketch(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write what is pasted into a sketch: ``correctMagnetometer(x, y, z)`` changes three readings in place."""
    numbers = single_precision(calibration)
    body = [
        *_array("const float MAG_MATRIX[3][3]", numbers.matrix),
        f"const float MAG_OFFSET[3] = {{{_listed(numbers.offset)}}}; // {unit_in(calibration)}",
        "",
        f"// Call it with raw readings in {unit_in(calibration)}; they become {unit_out(calibration)}.",
        "void correctMagnetometer(float &x, float &y, float &z) {",
        "  const float u = x - MAG_OFFSET[0], v = y - MAG_OFFSET[1], w = z - MAG_OFFSET[2];",
        *(
            f"  {axis} = MAG_MATRIX[{row}][0] * u + MAG_MATRIX[{row}][1] * v + MAG_MATRIX[{row}][2] * w;"
            for row, axis in enumerate("xyz")
        ),
        "}",
    ]
    return _exported(SKETCH, calibration, numbers, body, target=target, about=about, asked=asked)


def render_micropython(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write a module that imports nothing, for MicroPython and CircuitPython: ``correct((x, y, z))``."""
    numbers = single_precision(calibration)
    body = [
        "MATRIX = (",
        *(f"    ({', '.join(map(digits, row))})," for row in numbers.matrix),
        ")",
        f"OFFSET = ({', '.join(map(digits, numbers.offset))})  # {unit_in(calibration)}",
        f"FIELD_STRENGTH = {digits(numbers.strength)}  # {unit_out(calibration)}",
        "",
        "",
        "def correct(raw):",
        f'    """From {unit_in(calibration)} as recorded to {unit_out(calibration)}: three numbers in, three out."""',
        "    x, y, z = raw[0] - OFFSET[0], raw[1] - OFFSET[1], raw[2] - OFFSET[2]",
        "    return tuple(a * x + b * y + c * z for a, b, c in MATRIX)",
    ]
    return _exported(MODULE, calibration, numbers, body, target=target, about=about, asked=asked)


def render_q15(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write a header for whole readings of 16 bits.

    Raises
    ------
    NotExportable
        Where 16 bits cannot hold the numbers, or whole numbers of the recorded unit cost a degree.
    """
    return _fixed(calibration, Q15, "int16_t", target=target, about=about, asked=asked)


def render_q31(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write a header for whole readings of 24 bits in 32.

    Raises
    ------
    NotExportable
        Where they cannot hold the numbers, or whole numbers of the recorded unit cost a degree.
    """
    return _fixed(calibration, Q31, "int32_t", target=target, about=about, asked=asked)


def _exported(
    sheet: Sheet,
    calibration: Calibration,
    numbers: Affine,
    body: Sequence[str],
    *,
    target: str,
    about: Sequence[str],
    asked: Asked,
) -> Export:
    values = {
        "matrix": numbers.matrix,
        "offset": numbers.offset,
        "unit_in": unit_in(calibration),
        "unit_out": unit_out(calibration),
    }
    return sheet.export(calibration, numbers.apply, body, target=target, about=about, asked=asked, values=values)


def _fixed(
    calibration: Calibration, form: Format, whole: str, *, target: str, about: Sequence[str], asked: Asked
) -> Export:
    code = FixedPoint.of(calibration, form)
    unit, entry = unit_in(calibration), f"int{form.bits}_t"
    rows = [f"    {{{', '.join(map(str, row))}}}," for row in code.entries]
    places = code.shift + form.fraction
    text = FIXED_BODY.format(
        largest=form.largest, unit=unit, whole=whole, step=1 << form.fraction, half=places - 1, places=places
    )
    body = [
        *_opened(),
        "#include <stdint.h>",
        "",
        f"/* In units of 2^-{code.shift}. */",
        f"static const {entry} flinders_matrix[3][3] = {{",
        *rows,
        "};",
        f"/* In units of 2^-{form.fraction} {unit}. */",
        f"static const int32_t flinders_offset[3] = {{{', '.join(map(str, code.offset))}}};",
        "",
        *text.splitlines(),
        *CLOSED,
    ]
    values = {"entries": code.entries, "shift": code.shift, "offset": code.offset, "fraction": form.fraction}
    notes = [f"readings and results are whole numbers of {unit}"]
    return (SHORT if form is Q15 else LONG).export(
        calibration, code.apply, body, target=target, about=about, asked=asked, values=values, notes=notes
    )


def _opened() -> list[str]:
    return ["#ifndef FLINDERS_CALIBRATION_H", "#define FLINDERS_CALIBRATION_H", ""]


CLOSED: Final = ("", "#endif")


def _array(declared: str, matrix: Floats) -> list[str]:
    return [f"{declared} = {{", *(f"    {{{_listed(row)}}}," for row in matrix), "};"]


def _listed(values: Iterable[float]) -> str:
    return ", ".join(digits(value, "f") for value in values)
