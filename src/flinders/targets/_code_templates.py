"""Templates of generated code in C, for a sketch and for MicroPython, with placeholders for the numbers.

>>> print(C_GAIN.format(gain="0.01f", key="current", reference="5.0f"))
    for (axis = 0; axis < 3; axis++) {
        corrected[axis] /= (1.0f + 0.01f * (current - 5.0f));
    }
"""

from __future__ import annotations

from typing import Final

C_FLOAT: Final = """\
static const float {name}_matrix[3][3] = {{
{rows}
}};
static const float {name}_offset[3] = {{{offset}}}; /* {given} */{curve}
#define {constant}_FIELD_STRENGTH {strength} /* {result} */

/* From {given} as recorded to {result}; both may be the same array. */
static inline void {name}_correct(const float raw[3], float corrected[3])
{{
    const float x = {u};
    const float y = {v};
    const float z = {w};
    int row;
    for (row = 0; row < 3; row++) {{
        corrected[row] = {name}_matrix[row][0] * x + {name}_matrix[row][1] * y + {name}_matrix[row][2] * z;
    }}
}}"""
C_DISTURBED: Final = """
/* {name}_correct() for other values of {known} than their references. */
static inline void {name}_correct_at(const float raw[3], {arguments}, float corrected[3])
{{
    float settled[3];
    int axis;
    for (axis = 0; axis < 3; axis++) {{
        settled[axis] = raw[axis]{terms};
    }}
    {name}_correct(settled, corrected);"""
C_GAIN: Final = """\
    for (axis = 0; axis < 3; axis++) {{
        corrected[axis] /= (1.0f + {gain} * ({key} - {reference}));
    }}"""
SKETCH_DISTURBED: Final = """
// {function}Magnetometer() for other values of {known} than their references.
void {function}MagnetometerAt(float &x, float &y, float &z, {arguments}) {{
{terms}
  {function}Magnetometer(x, y, z);{grown}
}}"""
SKETCH_GAIN: Final = """
  const float grown = {factors};
  x /= grown;
  y /= grown;
  z /= grown;"""
MODULE_DISTURBED: Final = """

def correct_at(raw, {arguments}):
    \"""correct() for other values of {known} than their references.\"""
    x, y, z = (raw[axis]{terms} for axis in range(3))
    return {result}"""
SKETCH: Final = """\
const float {constant}_MATRIX[3][3] = {{
{rows}
}};
const float {constant}_OFFSET[3] = {{{offset}}}; // {given}
{curve}
// Call it with raw readings in {given}; they become {result}.
void {function}Magnetometer(float &x, float &y, float &z) {{
  const float u = {u}, v = {v}, w = {w};
  x = {constant}_MATRIX[0][0] * u + {constant}_MATRIX[0][1] * v + {constant}_MATRIX[0][2] * w;
  y = {constant}_MATRIX[1][0] * u + {constant}_MATRIX[1][1] * v + {constant}_MATRIX[1][2] * w;
  z = {constant}_MATRIX[2][0] * u + {constant}_MATRIX[2][1] * v + {constant}_MATRIX[2][2] * w;
}}"""
MODULE: Final = """\
MATRIX = (
{rows}
)
OFFSET = ({offset})  # {given}
FIELD_STRENGTH = {strength}  # {result}
{curve}

def correct(raw):
    \"""From {given} as recorded to {result}: three numbers in, three out.\"""
    x, y, z = {u}, {v}, {w}
    return tuple(a * x + b * y + c * z for a, b, c in MATRIX)"""
C_CURVE: Final = """
static const float {name}_quadratic[3] = {{{quadratic}}}; /* one over {given} */
static const float {name}_cubic[3] = {{{cubic}}}; /* one over the square of it */
static const float {name}_limit[3] = {{{limit}}}; /* {given}: beyond it the correction is constant */

/* Reading of a linear axis, from this axis's reading; both relative to the offset. */
static inline float {name}_linear(int axis, float read)
{{
    const float limit = {name}_limit[axis];
    const float held = read > limit ? limit : read < -limit ? -limit : read;
    return read - ({name}_quadratic[axis] + {name}_cubic[axis] * held) * held * held;
}}
"""
SKETCH_CURVE: Final = """\
const float {constant}_QUADRATIC[3] = {{{quadratic}}}; // one over {given}
const float {constant}_CUBIC[3] = {{{cubic}}}; // one over the square of it
const float {constant}_LIMIT[3] = {{{limit}}}; // {given}: beyond it the correction is constant

// Reading of a linear axis, from this axis's reading; both relative to the offset.
float {prefix}linearField(int axis, float read) {{
  const float limit = {constant}_LIMIT[axis], held = read > limit ? limit : read < -limit ? -limit : read;
  return read - ({constant}_QUADRATIC[axis] + {constant}_CUBIC[axis] * held) * held * held;
}}
"""
MODULE_CURVE: Final = """\
QUADRATIC = ({quadratic})  # one over {given}
CUBIC = ({cubic})  # one over the square of it
LIMIT = ({limit})  # {given}: beyond it the correction is constant


def linear(axis, read):
    \"""Reading of a linear axis, from this axis's reading; both relative to the offset.\"""
    held = max(-LIMIT[axis], min(LIMIT[axis], read))
    return read - (QUADRATIC[axis] + CUBIC[axis] * held) * held * held
"""
C_STRENGTH: Final = """
#define {constant}_STRENGTH_LIMIT {limit} /* {result} */

/* Whether the strength of a corrected reading indicates a disturbance. */
static inline int {name}_strength_is_off(const float corrected[3])
{{
    const float lowest = {constant}_FIELD_STRENGTH - {constant}_STRENGTH_LIMIT;
    const float highest = {constant}_FIELD_STRENGTH + {constant}_STRENGTH_LIMIT;
    const float square = corrected[0] * corrected[0] + corrected[1] * corrected[1] + corrected[2] * corrected[2];
    return !(square >= lowest * lowest && square <= highest * highest);
}}"""
C_DIP: Final = """
/* sin |sin| of the smallest and the largest dip. */
static const float {name}_dip_limits[2] = {{{low}, {high}}};

/* Whether the dip of a corrected reading indicates a disturbance. `acceleration` is the reading of an accelerometer in
 * the same axes at rest, in any unit (with z down, its z is negative when level). */
static inline int {name}_dip_is_off(const float corrected[3], const float acceleration[3])
{{
    float down = 0.0f, reading = 0.0f, weight = 0.0f, square;
    int axis;
    for (axis = 0; axis < 3; axis++) {{
        down -= corrected[axis] * acceleration[axis];
        reading += corrected[axis] * corrected[axis];
        weight += acceleration[axis] * acceleration[axis];
    }}
    square = down < 0.0f ? -down * down : down * down;
    return !(square >= {name}_dip_limits[0] * reading * weight && square <= {name}_dip_limits[1] * reading * weight);
}}"""
SKETCH_STRENGTH: Final = """
const float {constant}_STRENGTH = {strength}, {constant}_STRENGTH_LIMIT = {limit}; // {result}

// Whether the strength of a corrected reading indicates a disturbance.
bool {prefix}strengthIsOff(float x, float y, float z) {{
  const float lowest = {constant}_STRENGTH - {constant}_STRENGTH_LIMIT;
  const float highest = {constant}_STRENGTH + {constant}_STRENGTH_LIMIT;
  const float square = x * x + y * y + z * z;
  return !(square >= lowest * lowest && square <= highest * highest);
}}"""
SKETCH_DIP: Final = """
// Whether the dip of a corrected reading indicates a disturbance. ax, ay, az is the reading of an accelerometer in the
// same axes at rest, in any unit (with z down, az is negative when level).
bool {prefix}dipIsOff(float x, float y, float z, float ax, float ay, float az) {{
  const float down = -(x * ax + y * ay + z * az);
  const float both = (x * x + y * y + z * z) * (ax * ax + ay * ay + az * az);
  const float square = down < 0.0f ? -down * down : down * down;
  return !(square >= {low} * both && square <= {high} * both);
}}"""
MODULE_STRENGTH: Final = """
STRENGTH_LIMIT = {limit}  # {result}


def strength_is_off(corrected):
    \"""Whether the strength of a corrected reading indicates a disturbance.\"""
    x, y, z = corrected
    square = x * x + y * y + z * z
    return not (FIELD_STRENGTH - STRENGTH_LIMIT) ** 2 <= square <= (FIELD_STRENGTH + STRENGTH_LIMIT) ** 2"""
MODULE_DIP: Final = """

def dip_is_off(corrected, acceleration):
    \"""Whether its dip does; acceleration at rest, in the same axes and any unit (with z down, negative when
    level).\"""
    x, y, z = corrected
    ax, ay, az = acceleration
    down = -(x * ax + y * ay + z * az)
    both = (x * x + y * y + z * z) * (ax * ax + ay * ay + az * az)
    return not {low} * both <= down * abs(down) <= {high} * both"""
C_FIXED_POINT: Final = """\
#include <stdint.h>

/* In units of 2^-{shift}. */
static const int{bits}_t {name}_matrix[3][3] = {{
{rows}
}};
/* In units of 2^-{fraction} {unit}. */
static const int32_t {name}_offset[3] = {{{offset}}};

static inline int64_t {name}_held(int64_t value)
{{
    return value > {largest} ? {largest} : value < -{largest} - 1 ? -{largest} - 1 : value;
}}

/* The largest integer not above value / 2^places. */
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
