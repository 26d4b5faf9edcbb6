"""Forms in which Fusion, SensorLab, generated code and plain files represent an accelerometer and a gyro.

>>> from flinders.core.inertial import Inertial
>>> from flinders.targets._inertial import write_inertial
>>> sensor = Inertial(Triad(np.diag([0.99, 1.01, 1.0]), [0.2, -0.1, 0.3], "m/s2"))
>>> made = write_inertial(FUSION_C, sensor, who="Fusion")
>>> print(*made.body[-2:], sep=chr(10))
const FusionVector accelerometerSensitivity = {0.100951903f, 0.102991335f, 0.101971619f};
const FusionVector accelerometerOffset = {0.200000003f, -0.100000001f, 0.300000012f};
>>> made.checked
'checked: its own formula at rest in 400 attitudes, less than 0.00010° of tilt and 0.0010 % of length off'
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.inertial import STANDARD_GRAVITY, Triad
from flinders.targets._code_text import add_guard
from flinders.targets._inertial import InertialForm, Numbers
from flinders.targets._numbers import round_to_single, yaml_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from flinders.arrays import Floats
    from flinders.targets._inertial import Asked


# x-io Fusion: misalignment (sensitivity ∘ (u − offset)); accelerations in g, rates in °/s.


def _fusion(
    triad: Triad, _asked: Asked, *, sensor: str, out: float, write: Callable[[str, str, Any], Iterable[str]]
) -> Numbers:
    """Form of x-io Fusion: a misalignment with a unit diagonal, and the sensitivity, which is the diagonal."""
    gains = np.diag(triad.matrix) / out
    misalignment, sensitivity = round_to_single(triad.matrix / out / gains), round_to_single(gains)
    offset = round_to_single(triad.offset)
    values = {f"{sensor}Misalignment": misalignment, f"{sensor}Sensitivity": sensitivity, f"{sensor}Offset": offset}
    body = [line for name, value in values.items() for line in write(sensor, name, value)]
    return Numbers(lambda raw: ((raw - offset) * sensitivity) @ misalignment.T, values, body)


def _c(_sensor: str, name: str, value: Floats) -> Iterator[str]:
    """A constant of Fusion in C."""
    if value.ndim == 1:
        yield f"const FusionVector {name} = {{{_singles(value, 'f')}}};"
        return
    yield f"const FusionMatrix {name} = {{"
    yield from (f"    {_singles(row, 'f')}," for row in value)
    yield "};"


def _python(_sensor: str, name: str, value: Floats) -> Iterator[str]:
    """An array of imufusion."""
    snake = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name)
    rows = f"[{_singles(value)}]" if value.ndim == 1 else f"[{', '.join(f'[{_singles(row)}]' for row in value)}]"
    yield f"{snake} = np.array({rows})"


def _singles(values: Floats, suffix: str = "") -> str:
    """Float32 numbers, each with a decimal point."""
    shown = (f"{value + 0.0:.9g}" for value in values)
    return ", ".join(f"{text if '.' in text or 'e' in text else f'{text}.0'}{suffix}" for text in shown)


RAD_PER_DEG: Final = float(np.deg2rad(1.0))


def _fusion_form(write: Callable[[str, str, Any], Iterable[str]]) -> InertialForm:
    return InertialForm(
        formula="c = misalignment (sensitivity (u - offset)); accelerations in g, rates in degrees/s",
        source="FusionModel.h, FusionModelInertial",
        accelerometer=partial(_fusion, sensor="accelerometer", out=STANDARD_GRAVITY, write=write),
        gyro=partial(_fusion, sensor="gyroscope", out=RAD_PER_DEG, write=write),
        unit=None,
        gives=STANDARD_GRAVITY,
    )


FUSION_C: Final = _fusion_form(_c)
FUSION_PYTHON: Final = _fusion_form(_python)


# Adafruit SensorLab: offsets alone, in m/s² and rad/s


def _zero(triad: Triad, _asked: Asked, *, name: str) -> Numbers:
    """Form with three offsets that are subtracted."""
    offset = round_to_single(triad.offset)
    return Numbers(lambda raw: raw - offset, {name: [float(f"{value:.9g}") for value in offset]})


SENSORLAB: Final = InertialForm(
    formula="c = m - accel_zerog, c = m - gyro_zerorate, in m/s2 and rad/s",
    source="Adafruit_Sensor_Calibration.cpp, calibrate",
    accelerometer=partial(_zero, name="accel_zerog"),
    gyro=partial(_zero, name="gyro_zerorate"),
    holds="offset",
    holds_rates="offset",
    is_json=True,
    is_alone=False,
)


# plain JSON and YAML: all numbers


def _plain(triad: Triad, _asked: Asked, *, name: str, is_yaml: bool = False) -> Numbers:
    """Form with all numbers of the correction and their uncertainty."""
    arrays = {"offset": triad.offset, "matrix": triad.matrix, "offset_sigma": triad.offset_sigma}
    values = {
        "formula": "corrected = matrix (raw - offset)",
        "unit": triad.unit,
        "corrected_unit": "m/s2" if name == "accelerometer" else "rad/s",
        **{key: None if value is None else value.tolist() for key, value in arrays.items()},
        "matrix_sigma": None if triad.matrix_sigma is None else triad.matrix_sigma.tolist(),
    }
    body = [f"{name}: {yaml_text(values)}"] if is_yaml else []
    return Numbers(triad.apply, {name: values}, body)


PLAIN_JSON: Final = InertialForm(
    formula="corrected = matrix (raw - offset)",
    source="this program",
    accelerometer=partial(_plain, name="accelerometer"),
    gyro=partial(_plain, name="gyro"),
    unit=None,
    is_json=True,
)
PLAIN_YAML: Final = InertialForm(
    formula="corrected = matrix (raw - offset)",
    source="this program",
    accelerometer=partial(_plain, name="accelerometer", is_yaml=True),
    gyro=partial(_plain, name="gyro", is_yaml=True),
    unit=None,
)


# generated code: a function next to that of the magnetometer

C_TEXT: Final = """\
/* {title}: {given} as recorded to {result}; both may be the same array. */
static const float {name}_matrix[3][3] = {{
{rows}
}};
static const float {name}_offset[3] = {{{offset}}}; /* {given} */

static inline void {function}(const float raw[3], float corrected[3])
{{
    const float x = raw[0] - {name}_offset[0];
    const float y = raw[1] - {name}_offset[1];
    const float z = raw[2] - {name}_offset[2];
    int row;
    for (row = 0; row < 3; row++) {{
        corrected[row] = {name}_matrix[row][0] * x + {name}_matrix[row][1] * y + {name}_matrix[row][2] * z;
    }}
}}"""
SKETCH_TEXT: Final = """\
const float {constant}_MATRIX[3][3] = {{
{rows}
}};
const float {constant}_OFFSET[3] = {{{offset}}}; // {given}

// Call it with raw readings of the {title} in {given}; they become {result}.
void {function}(float &x, float &y, float &z) {{
  const float u = x - {constant}_OFFSET[0], v = y - {constant}_OFFSET[1], w = z - {constant}_OFFSET[2];
  x = {constant}_MATRIX[0][0] * u + {constant}_MATRIX[0][1] * v + {constant}_MATRIX[0][2] * w;
  y = {constant}_MATRIX[1][0] * u + {constant}_MATRIX[1][1] * v + {constant}_MATRIX[1][2] * w;
  z = {constant}_MATRIX[2][0] * u + {constant}_MATRIX[2][1] * v + {constant}_MATRIX[2][2] * w;
}}"""
MODULE_TEXT: Final = """\
{constant}_MATRIX = (
{rows}
)
{constant}_OFFSET = ({offset})  # {given}


def {function}(raw):
    \"""From {given} as recorded to {result}: three numbers in, three out.\"""
    x, y, z = (read - zero for read, zero in zip(raw, {constant}_OFFSET))
    return tuple(a * x + b * y + c * z for a, b, c in {constant}_MATRIX)"""


def _code(triad: Triad, asked: Asked, *, sensor: str, language: str) -> Numbers:
    """Form of a function with its numbers as float32."""
    matrix, offset = round_to_single(triad.matrix), round_to_single(triad.offset)
    what = {"accelerometer": "acceleration", "gyro": "rate"}[sensor]
    suffix = "" if language == "python" else "f"
    start = asked.name or ("flinders" if language == "c" else "")
    prefix = f"{start}_" if start else ""
    text, row, function = {
        "c": (C_TEXT, "    {{{}}},", f"{prefix}correct_{what}"),
        "sketch": (SKETCH_TEXT, "  {{{}}},", f"{prefix}correct{what.title()}"),
        "python": (MODULE_TEXT, "    ({}),", f"correct_{what}"),
    }[language]
    body = text.format(
        title=sensor,
        name=f"{prefix}{sensor}",
        constant=f"{prefix}{sensor}".upper() if language == "sketch" else sensor.upper(),
        function=function,
        rows="\n".join(row.format(_singles(entries, suffix)) for entries in matrix),
        offset=_singles(offset, suffix),
        given=triad.unit,
        result="m/s2" if sensor == "accelerometer" else "rad/s",
    ).splitlines()
    if language == "c":
        body = add_guard(f"{prefix}{sensor}", body)
    values = {f"{sensor}_matrix": matrix, f"{sensor}_offset": offset, f"{sensor}_unit": triad.unit}
    return Numbers(lambda raw: (raw - offset) @ matrix.T, values, ["", *body])


def code_form(language: str) -> InertialForm:
    """Form for a language: ``c``, ``sketch`` or ``python``."""
    return InertialForm(
        formula="corrected = matrix (raw - offset), accelerations to m/s2 and rates to rad/s",
        source="this program",
        accelerometer=partial(_code, sensor="accelerometer", language=language),
        gyro=partial(_code, sensor="gyro", language=language),
        unit=None,
    )
