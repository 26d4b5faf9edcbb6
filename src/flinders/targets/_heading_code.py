"""Generated code for a heading with its standard deviation: constants and functions, in C, for a sketch, in Python.

The texts have placeholders for the numbers of a `HeadingModel` and of a `MeasurementNoise`. The functions compute the
square root of gᵀ C g + σ² |v|² (`flinders.targets._heading_model`), in degrees.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.geometry.plane import axis_order
from flinders.targets._code_text import digits, float32s

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.targets._heading_model import HeadingModel
    from flinders.targets._measurement_noise import MeasurementNoise
    from flinders.targets._target import ExportOptions, Written

MAX_DIP_DEG: Final = 89.0
"""Largest dip in degrees for which headings are computed."""


@dataclass(frozen=True, slots=True)
class HeadingCode:
    """Texts of generated code for headings in one language."""

    imports: str  #: imports, ahead of all code
    constants: str  #: standard deviations of field and heading, and numbers for the functions
    function: str  #: function of a heading at any attitude
    level: str  #: function of a level heading, from the field alone
    row: str  #: format of a row of numbers
    suffix: str  #: suffix of a float32 number

    def add_to(self, code: Written, unit: str, asked: ExportOptions, **names: str) -> Written:
        """Append constants and functions if the noise of the fit is known; `unit` is the unit of corrected readings."""
        noise, model = asked.noise, asked.heading
        if noise is None or model is None:
            return code
        texts = [self.constants, self.function, *([] if model.plane is None else [self.level])]
        places = {**self._sigmas(noise), **self._numbers(model), **_axes(model), **names}
        body = "\n".join(texts).format(result=unit, **places).splitlines()
        return replace(
            code, body=[*self.imports.splitlines(), *code.body, *body], values={**code.values, **sigmas_of(noise)}
        )

    def _sigmas(self, noise: MeasurementNoise) -> dict[str, str]:
        return {name: digits(value, self.suffix) for name, value in sigmas_of(noise).items()}

    def _numbers(self, model: HeadingModel) -> dict[str, str]:
        level, down = model.level_field
        return {
            "shape": "\n".join(self.row.format(float32s(row, self.suffix)) for row in model.matrix),
            "mean": self._wrap_lines(np.rad2deg(model.mean)),
            "factor": self._wrap_lines(model.factor[np.triu_indices(9)]),
            "variance": digits(model.noise**2, self.suffix),
            "alignment": digits(model.alignment_deg**2, self.suffix),
            "steepest": digits(math.cos(math.radians(MAX_DIP_DEG)) ** 2, self.suffix),
            "per_level": digits(math.degrees(1.0 / level), self.suffix),
            "opposite": "<" if down < 0.0 else ">",
            "level_field": digits(level, self.suffix),
            "down_field": digits(down, self.suffix),
        }

    def _wrap_lines(self, numbers: Iterable[float]) -> str:
        """Numbers separated by commas, broken into lines."""
        return textwrap.fill(float32s(numbers, self.suffix), 110, initial_indent="    ", subsequent_indent="    ")


def sigmas_of(noise: MeasurementNoise) -> dict[str, float]:
    """Standard deviations by which a filter weights readings, by the names of placeholders."""
    return {
        "field_sigma_reading": noise.reading,
        "field_sigma_calibration": noise.calibration,
        "heading_sigma_reading_deg": noise.heading_reading_deg,
        "heading_sigma_calibration_deg": noise.heading_calibration_deg,
    }


def _axes(model: HeadingModel) -> dict[str, Any]:
    """Places and names of the axes of a level vehicle: forward, right and down, for the placeholders."""
    places = axis_order(model.plane or "xy")
    names = dict(zip(("first", "second", "third"), ("xyz"[place] for place in places), strict=True))
    return {**dict(zip(("forward", "right", "down"), places, strict=True)), **names}


C_HEADING: Final = HeadingCode(
    imports="#include <math.h>\n\n",
    constants="""
/* 1 sigma of corrected readings and of level headings, in two parts. The READING part is white noise, independent in
 * each reading: averaging reduces it. The CALIBRATION part is the same in all readings of an attitude: averaging does
 * not reduce it, and no filter's heading is better than it. */
#define {constant}_FIELD_SIGMA_READING {field_sigma_reading} /* {result}, of a horizontal axis: white */
#define {constant}_FIELD_SIGMA_CALIBRATION {field_sigma_calibration} /* {result}, of a horizontal axis: not white */
#define {constant}_HEADING_SIGMA_READING {heading_sigma_reading_deg} /* degrees: white */
#define {constant}_HEADING_SIGMA_CALIBRATION {heading_sigma_calibration_deg} /* degrees: not white */

/* For sigma: triangular factor of the calibration's covariance, row by row; mean gradient of level headings by the
 * calibration, an error common to all headings that is removed; and the matrix in its symmetric form. */
static const float {name}_heading_factor[45] = {{
{factor}
}};
static const float {name}_heading_mean[9] = {{
{mean}
}};
static const float {name}_heading_matrix[3][3] = {{
{shape}
}};

/* 1 sigma of a heading, in degrees, from a corrected field and the gradient of the heading by it: the horizontal unit
 * vector across the field, in degrees, divided by the length of the horizontal field. */
static inline float {name}_heading_sigma(const float field[3], const float across[3])
{{
    const float *entry = {name}_heading_factor;
    float v[3], gradient[9], variance = {alignment}, sum;
    int row, column;
    for (row = 0; row < 3; row++) {{
        const float *w = {name}_heading_matrix[row];
        v[row] = w[0] * across[0] + w[1] * across[1] + w[2] * across[2];
        variance += {variance} * v[row] * v[row];
        gradient[row] = v[row];
        gradient[row + 3] = v[row] * field[row];
    }}
    gradient[6] = v[0] * field[1] + v[1] * field[0];
    gradient[7] = v[0] * field[2] + v[2] * field[0];
    gradient[8] = v[1] * field[2] + v[2] * field[1];
    for (row = 0; row < 9; row++) {{
        sum = 0.0f;
        for (column = row; column < 9; column++) {{
            sum += *entry++ * (gradient[column] - {name}_heading_mean[column]);
        }}
        variance += sum * sum;
    }}
    return sqrtf(variance);
}}""",
    function="""
/* Heading of the x axis in degrees clockwise from magnetic north, with 1 sigma of both parts at this attitude.
 * `acceleration` is the reading of an accelerometer in the same axes at rest, in any unit (with z down, its z is
 * negative when level); its own error is not in sigma. Both are NaN if the field is within a degree of the vertical. */
static inline float {name}_heading(const float corrected[3], const float acceleration[3], float *sigma)
{{
    const float *m = corrected, *a = acceleration;
    const float east[3] = {{m[1] * a[2] - m[2] * a[1], m[2] * a[0] - m[0] * a[2], m[0] * a[1] - m[1] * a[0]}};
    const float level = east[0] * east[0] + east[1] * east[1] + east[2] * east[2];
    const float field = m[0] * m[0] + m[1] * m[1] + m[2] * m[2], weight = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    const float north = a[1] * east[2] - a[2] * east[1], length = sqrtf(weight);
    const float upwards = m[0] * a[0] + m[1] * a[1] + m[2] * a[2]; /* negative where the field points down */
    const float scale = (upwards {opposite} 0.0f ? -57.2957795f : 57.2957795f) * length / level;
    const float across[3] = {{scale * east[0], scale * east[1], scale * east[2]}};
    float heading;
    if (!(level > {steepest} * field * weight)) {{
        *sigma = NAN;
        return NAN;
    }}
    *sigma = {name}_heading_sigma(m, across);
    heading = 57.2957795f * atan2f(east[0] * length, north);
    return heading < 0.0f ? heading + 360.0f : heading;
}}""",
    level="""
/* Heading of the {first} axis of a level vehicle, with {third} down: from {first} and {second} alone. */
static inline float {name}_level_heading(const float corrected[3], float *sigma)
{{
    const float x = corrected[{forward}], y = corrected[{right}], level = sqrtf(x * x + y * y);
    float field[3], across[3], heading;
    field[{forward}] = {level_field} * x / level;
    field[{right}] = {level_field} * y / level;
    field[{down}] = {down_field};
    across[{forward}] = -{per_level} * y / level;
    across[{right}] = {per_level} * x / level;
    across[{down}] = 0.0f;
    *sigma = {name}_heading_sigma(field, across);
    heading = 57.2957795f * atan2f(-y, x);
    return heading < 0.0f ? heading + 360.0f : heading;
}}""",
    row="    {{{}}},",
    suffix="f",
)

SKETCH_HEADING: Final = HeadingCode(
    imports="",
    constants="""
// 1 sigma of corrected readings and of level headings, in two parts. The READING part is white noise, independent in
// each reading: averaging reduces it. The CALIBRATION part is the same in all readings of an attitude: averaging does
// not reduce it, and no filter's heading is better than it.
const float {constant}_FIELD_SIGMA_READING = {field_sigma_reading}; // {result}, of a horizontal axis: white
const float {constant}_FIELD_SIGMA_CALIBRATION = {field_sigma_calibration}; // {result}, of a horizontal axis: not white
const float {constant}_HEADING_SIGMA_READING = {heading_sigma_reading_deg}; // degrees: white
const float {constant}_HEADING_SIGMA_CALIBRATION = {heading_sigma_calibration_deg}; // degrees: not white

// For sigma: triangular factor of the calibration's covariance, row by row; mean gradient of level headings by the
// calibration, an error common to all headings that is removed; and the matrix in its symmetric form.
const float {constant}_HEADING_FACTOR[45] = {{
{factor}
}};
const float {constant}_HEADING_MEAN[9] = {{
{mean}
}};
const float {constant}_HEADING_MATRIX[3][3] = {{
{shape}
}};

// 1 sigma of a heading, in degrees, from a corrected field and the gradient of the heading by it: the horizontal unit
// vector across the field, in degrees, divided by the length of the horizontal field.
float {prefix}headingSigma(const float m[3], const float across[3]) {{
  const float *entry = {constant}_HEADING_FACTOR;
  float v[3], variance = {alignment};
  for (int row = 0; row < 3; row++) {{
    const float *w = {constant}_HEADING_MATRIX[row];
    v[row] = w[0] * across[0] + w[1] * across[1] + w[2] * across[2];
    variance += {variance} * v[row] * v[row];
  }}
  const float gradient[9] = {{
    v[0], v[1], v[2], v[0] * m[0], v[1] * m[1], v[2] * m[2],
    v[0] * m[1] + v[1] * m[0], v[0] * m[2] + v[2] * m[0], v[1] * m[2] + v[2] * m[1]
  }};
  for (int row = 0; row < 9; row++) {{
    float sum = 0.0f;
    for (int column = row; column < 9; column++) {{
      sum += *entry++ * (gradient[column] - {constant}_HEADING_MEAN[column]);
    }}
    variance += sum * sum;
  }}
  return sqrtf(variance);
}}""",
    function="""
// Heading of the x axis in degrees clockwise from magnetic north, with 1 sigma of both parts at this attitude. ax, ay,
// az is the reading of an accelerometer in the same axes at rest, in any unit (with z down, az is negative when
// level); its own error is not in sigma. Both are NaN if the field is within a degree of the vertical.
float {prefix}magneticHeading(float x, float y, float z, float ax, float ay, float az, float &sigma) {{
  const float east[3] = {{y * az - z * ay, z * ax - x * az, x * ay - y * ax}}, m[3] = {{x, y, z}};
  const float level = east[0] * east[0] + east[1] * east[1] + east[2] * east[2];
  const float field = x * x + y * y + z * z, weight = ax * ax + ay * ay + az * az;
  const float north = ay * east[2] - az * east[1], length = sqrtf(weight);
  const float upwards = x * ax + y * ay + z * az; // negative where the field points down
  const float scale = (upwards {opposite} 0.0f ? -57.2957795f : 57.2957795f) * length / level;
  const float across[3] = {{scale * east[0], scale * east[1], scale * east[2]}};
  if (!(level > {steepest} * field * weight)) {{
    sigma = NAN;
    return NAN;
  }}
  sigma = {prefix}headingSigma(m, across);
  const float angle = 57.2957795f * atan2f(east[0] * length, north);
  return angle < 0.0f ? angle + 360.0f : angle;
}}""",
    level="""
// Heading of the {first} axis of a level vehicle, with {third} down: from {first} and {second}; {third} is not used.
float {prefix}levelHeading(float x, float y, float z, float &sigma) {{
  const float read[3] = {{x, y, z}}, ahead = read[{forward}], right = read[{right}];
  const float level = sqrtf(ahead * ahead + right * right);
  float m[3], across[3];
  m[{forward}] = {level_field} * ahead / level;
  m[{right}] = {level_field} * right / level;
  m[{down}] = {down_field};
  across[{forward}] = -{per_level} * right / level;
  across[{right}] = {per_level} * ahead / level;
  across[{down}] = 0.0f;
  sigma = {prefix}headingSigma(m, across);
  const float angle = 57.2957795f * atan2f(-right, ahead);
  return angle < 0.0f ? angle + 360.0f : angle;
}}""",
    row="  {{{}}},",
    suffix="f",
)
PYTHON_HEADING: Final = HeadingCode(
    imports="from math import atan2, degrees, sqrt\n\n",
    constants="""

# 1 sigma of corrected readings and of level headings, in two parts. The READING part is white noise, independent in
# each reading: averaging reduces it. The CALIBRATION part is the same in all readings of an attitude: averaging does
# not reduce it, and no filter's heading is better than it.
FIELD_SIGMA_READING = {field_sigma_reading}  # {result}, of a horizontal axis: white
FIELD_SIGMA_CALIBRATION = {field_sigma_calibration}  # {result}, of a horizontal axis: not white
HEADING_SIGMA_READING = {heading_sigma_reading_deg}  # degrees: white
HEADING_SIGMA_CALIBRATION = {heading_sigma_calibration_deg}  # degrees: not white

# For sigma: triangular factor of the calibration's covariance, row by row; mean gradient of level headings by the
# calibration, an error common to all headings that is removed; and the matrix in its symmetric form.
HEADING_FACTOR = (
{factor},
)
HEADING_MEAN = (
{mean},
)
HEADING_MATRIX = (
{shape}
)


def heading_sigma(field, across):
    \"""1 sigma of a heading, in degrees, from a corrected field and the gradient of the heading by it, in degrees.\"""
    x, y, z = field
    u, v, w = (a * across[0] + b * across[1] + c * across[2] for a, b, c in HEADING_MATRIX)
    gradient = (u, v, w, u * x, v * y, w * z, u * y + v * x, u * z + w * x, v * z + w * y)
    part = [g - mean for g, mean in zip(gradient, HEADING_MEAN)]
    variance, entry = {alignment} + {variance} * (u * u + v * v + w * w), 0
    for row in range(9):
        total = 0.0
        for column in range(row, 9):
            total += HEADING_FACTOR[entry] * part[column]
            entry += 1
        variance += total * total
    return sqrt(variance)""",
    function="""

def heading(corrected, acceleration):
    \"""Heading of the x axis in degrees clockwise from magnetic north, and 1 sigma of both parts at this attitude.

    Acceleration is the reading of an accelerometer in the same axes at rest, in any unit (with z down, its z is
    negative when level); its own error is not in sigma. Both are NaN if the field is within a degree of the vertical.
    \"""
    x, y, z = corrected
    ax, ay, az = acceleration
    east = (y * az - z * ay, z * ax - x * az, x * ay - y * ax)
    level, weight = sum(e * e for e in east), ax * ax + ay * ay + az * az
    if not level > {steepest} * (x * x + y * y + z * z) * weight:
        return float("nan"), float("nan")
    length = sqrt(weight)
    scale = degrees(length / level)
    if x * ax + y * ay + z * az {opposite} 0.0:  # the vertical part of the field is opposite to that of the claim
        scale = -scale
    sigma = heading_sigma(corrected, [scale * e for e in east])
    return degrees(atan2(east[0] * length, ay * east[2] - az * east[1])) % 360.0, sigma""",
    level="""

def level_heading(corrected):
    \"""Heading of the {first} axis of a level vehicle, with {third} down: from {first} and {second} alone.\"""
    x, y = corrected[{forward}], corrected[{right}]
    level = sqrt(x * x + y * y)
    field, across = [{down_field}] * 3, [0.0] * 3
    field[{forward}], field[{right}] = {level_field} * x / level, {level_field} * y / level
    across[{forward}], across[{right}] = -{per_level} * y / level, {per_level} * x / level
    return degrees(atan2(-y, x)) % 360.0, heading_sigma(field, across)""",
    row="    ({}),",
    suffix="",
)
