"""Code to compile in: a C99 header in single precision or fixed point, an Arduino sketch, a MicroPython module.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.exporters import Asked
>>> found = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> module: dict[str, object] = {}
>>> exec(chr(10).join(write_micropython(found, Asked()).body), module)
>>> module["correct"]((10, -20, 130))
(0.0, 0.0, 50.0)

All take readings as they were recorded, in that unit and those axes, and give them in the calibration's axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import OWN, RECORDED, single
from flinders.conventions._driven import in_recorded_axes
from flinders.conventions.code import Q15, Q31, FixedPoint, Format, single_precision, unit_in, unit_out
from flinders.exporters._export import Written
from flinders.exporters._names import begun, guarded
from flinders.exporters._sheet import BLOCK, HASH, Sheet, digits

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.conventions._affine import Affine
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

HEADER: Final = Sheet(
    title="C99 header",
    formula="corrected = A (raw - b)",
    unit=RECORDED,
    keeps="all",
    storage="float32",
    source="this program",
    acts="across",
    gives=OWN,
    follows="all",
    comment=BLOCK,
)
SKETCH: Final = replace(HEADER, title="Arduino sketch", follows="")
MODULE: Final = replace(
    HEADER, title="MicroPython module", follows="", storage="the float of the board, 30 bits or more", comment=HASH
)
SHORT: Final = replace(
    HEADER,
    title="C99 header, Q15",
    follows="",
    storage="int16 readings, int16 matrix, offset in 2^-8 of a unit, 64-bit sums",
    gives=RECORDED,
)
LONG: Final = replace(
    HEADER,
    title="C99 header, Q31",
    follows="",
    storage="int32 readings to +/-2^23, int32 matrix, offset in 2^-4 of a unit, 64-bit sums",
    gives=RECORDED,
)

FLOAT: Final = """\
{{
    const float x = raw[0] - {name}_offset[0];
    const float y = raw[1] - {name}_offset[1];
    const float z = raw[2] - {name}_offset[2];
    int row;
    for (row = 0; row < 3; row++) {{
        corrected[row] = {name}_matrix[row][0] * x + {name}_matrix[row][1] * y + {name}_matrix[row][2] * z;
    }}
}}"""

FIXED: Final = """\
static inline int64_t {name}_held(int64_t value)
{{
    return value > {largest} ? {largest} : value < -{largest} - 1 ? -{largest} - 1 : value;
}}

/* The largest whole number that is not above value / 2^places. */
static inline int64_t {name}_shifted(int64_t value, int places)
{{
    return value >= 0 ? value >> places : -((-value + ((int64_t)1 << places) - 1) >> places);
}}

/* From {unit} as recorded to {unit}; both may be the same array. */
static inline void {name}_correct(const {whole} raw[3], {whole} corrected[3])
{{
    int64_t moved[3];
    int row, column;
    for (column = 0; column < 3; column++) {{
        moved[column] = {name}_held(raw[column]) * {step} - {name}_offset[column];
    }}
    for (row = 0; row < 3; row++) {{
        int64_t sum = (int64_t)1 << {half};
        for (column = 0; column < 3; column++) {{
            sum += (int64_t){name}_matrix[row][column] * moved[column];
        }}
        corrected[row] = ({whole}){name}_held({name}_shifted(sum, {places}));
    }}
}}"""

USUAL: Final = "flinders"
"""What names in C begin with, unless another name is asked for."""


def write_header(calibration: Calibration, asked: Asked) -> Written:
    """Write a header in single precision, which includes nothing: ``flinders_correct(raw, corrected)``.

    Raises
    ------
    UsageError
        For a name that cannot begin one in C.
    """
    numbers, name = single_precision(calibration), begun(USUAL, asked.name)
    body = [
        *_array(f"static const float {name}_matrix[3][3]", numbers.matrix),
        f"static const float {name}_offset[3] = {{{_listed(numbers.offset)}}}; /* {unit_in(calibration)} */",
        f"#define {name.upper()}_FIELD_STRENGTH {digits(numbers.strength, 'f')} /* {unit_out(calibration)} */",
        "",
        f"/* From {unit_in(calibration)} as recorded to {unit_out(calibration)}; both may be the same array. */",
        f"static inline void {name}_correct(const float raw[3], float corrected[3])",
        *FLOAT.format(name=name).splitlines(),
        *_driven(calibration, name),
    ]
    return _written(calibration, numbers, guarded(name, body))


def write_sketch(calibration: Calibration, asked: Asked) -> Written:
    """Write what is pasted into a sketch: ``correctMagnetometer(x, y, z)`` changes three readings in place.

    Raises
    ------
    UsageError
        For a name that cannot begin one in C++.
    """
    numbers, name = single_precision(calibration), begun("", asked.name)
    constant, function = (f"{name.upper()}_MAG", f"{name}_correct") if name else ("MAG", "correct")
    sums = [
        " + ".join(f"{constant}_MATRIX[{row}][{place}] * {one}" for place, one in enumerate("uvw")) for row in range(3)
    ]
    body = [
        *_array(f"const float {constant}_MATRIX[3][3]", numbers.matrix),
        f"const float {constant}_OFFSET[3] = {{{_listed(numbers.offset)}}}; // {unit_in(calibration)}",
        "",
        f"// Call it with raw readings in {unit_in(calibration)}; they become {unit_out(calibration)}.",
        f"void {function}Magnetometer(float &x, float &y, float &z) {{",
        f"  const float u = x - {constant}_OFFSET[0], v = y - {constant}_OFFSET[1], w = z - {constant}_OFFSET[2];",
        *(f"  {axis} = {total};" for axis, total in zip("xyz", sums, strict=True)),
        "}",
    ]
    return _written(calibration, numbers, body)


def write_micropython(calibration: Calibration, _asked: Asked) -> Written:
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
    return _written(calibration, numbers, body)


def write_q15(calibration: Calibration, asked: Asked) -> Written:
    """Write a header for whole readings of 16 bits.

    Raises
    ------
    NotExportable
        Where 16 bits cannot hold the numbers.
    UsageError
        For a name that cannot begin one in C.
    """
    return _fixed(calibration, Q15, "int16_t", asked)


def write_q31(calibration: Calibration, asked: Asked) -> Written:
    """Write a header for whole readings of 24 bits in 32; raises as `write_q15`."""
    return _fixed(calibration, Q31, "int32_t", asked)


def _written(calibration: Calibration, numbers: Affine, body: Sequence[str]) -> Written:
    """Code in single precision."""
    values = {
        "matrix": numbers.matrix,
        "offset": numbers.offset,
        "unit_in": unit_in(calibration),
        "unit_out": unit_out(calibration),
    }
    return Written(numbers.apply, body, values)


def _driven(calibration: Calibration, name: str) -> Iterator[str]:
    """A second function, for a calibration that follows something: the first holds at the references."""
    if not calibration.drivers:
        return
    keys = [driver.kind.key for driver in calibration.drivers]
    for driver, key in zip(calibration.drivers, keys, strict=True):
        per_unit = single(in_recorded_axes(calibration, driver) / calibration.raw.scale)
        yield ""
        yield f"/* {driver} */".replace("°", "deg ").replace("−", "-")
        yield (
            f"static const float {name}_{key.lower()}[3] = {{{_listed(per_unit)}}}; "
            f"/* {unit_in(calibration)} per unit of {key} */"
        )
    yield ""
    yield f"/* The same where {' and '.join(keys)} are known; {name}_correct() takes them at their references. */"
    arguments = ", ".join(f"float {key}" for key in keys)
    yield f"static inline void {name}_correct_at(const float raw[3], {arguments}, float corrected[3])"
    yield "{"
    yield "    float settled[3];"
    yield "    int axis;"
    yield "    for (axis = 0; axis < 3; axis++) {"
    terms = "".join(
        f" - {name}_{key.lower()}[axis] * ({key} - {digits(driver.reference, 'f')})"
        for driver, key in zip(calibration.drivers, keys, strict=True)
    )
    yield f"        settled[axis] = raw[axis]{terms};"
    yield "    }"
    yield f"    {name}_correct(settled, corrected);"
    for driver, key in zip(calibration.drivers, keys, strict=True):
        if driver.gain_per_unit:
            yield "    for (axis = 0; axis < 3; axis++) {"
            growth = f"1.0f + {digits(driver.gain_per_unit, 'f')} * ({key} - {digits(driver.reference, 'f')})"
            yield f"        corrected[axis] /= {growth};".replace("/= ", "/= (").replace(";", ");")
            yield "    }"
    yield "}"


def _fixed(calibration: Calibration, form: Format, whole: str, asked: Asked) -> Written:
    """Code in whole numbers; `whole` is the type of a reading."""
    code, name = FixedPoint.of(calibration, form), begun(USUAL, asked.name)
    unit, entry, places = unit_in(calibration), f"int{form.bits}_t", code.shift + form.fraction
    text = FIXED.format(
        name=name, largest=form.largest, unit=unit, whole=whole, step=1 << form.fraction, half=places - 1, places=places
    )
    body = [
        "#include <stdint.h>",
        "",
        f"/* In units of 2^-{code.shift}. */",
        f"static const {entry} {name}_matrix[3][3] = {{",
        *(f"    {{{', '.join(map(str, row))}}}," for row in code.entries),
        "};",
        f"/* In units of 2^-{form.fraction} {unit}. */",
        f"static const int32_t {name}_offset[3] = {{{', '.join(map(str, code.offset))}}};",
        "",
        *text.splitlines(),
    ]
    values = {"entries": code.entries, "shift": code.shift, "offset": code.offset, "fraction": form.fraction}
    notes = [f"readings and results are whole numbers of {unit}"]
    return Written(code.apply, guarded(name, body), values, notes)


def _array(declared: str, matrix: Floats) -> list[str]:
    return [f"{declared} = {{", *(f"    {{{_listed(row)}}}," for row in matrix), "};"]


def _listed(values: Iterable[float]) -> str:
    return ", ".join(digits(value, "f") for value in values)
