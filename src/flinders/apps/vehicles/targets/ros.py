"""Parameters of two ROS packages in tesla: ``m − b`` of imu_filter_madgwick, ``S (m − b)`` of magnetometer_pipeline.

>>> from flinders.targets import find
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.003, 1.0, 0.997]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> print(*find("ros-madgwick").render(calibration).text.splitlines()[-5:], sep=chr(10))
  ros__parameters:
    use_mag: true
    mag_bias_x: 1.000000000e-05
    mag_bias_y: -2.000000000e-05
    mag_bias_z: 3.000000000e-05
>>> read(find("ros-pipeline").render(calibration).text.encode(), "params.yaml").isclose(calibration)
True

Numbers are written with a point and a sign of the exponent, or YAML 1.1 would take 1e-05 for text.

Sources: CCNY imu_tools, ``ImuFilterMadgwick.cfg`` (mag_bias, −10 to 10); ctu-vras magnetometer_pipeline,
``bias_remover.cpp``: the code reads initial_mag_scaling_matrix, its README says initial_scaling_matrix, and is wrong.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import DocumentError, NotExportable
from flinders.targets._numbers import Affine, decoded, keyed, numbers
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

LARGEST_T: Final = 10.0
BIAS: Final = ("mag_bias_x", "mag_bias_y", "mag_bias_z")
INITIAL_BIAS: Final = tuple(f"initial_{name}" for name in BIAS)
INITIAL_MATRIX: Final = "initial_mag_scaling_matrix"


def write_madgwick(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write a file of parameters for ROS 2, for a node of any name: it subtracts a bias, and knows no soft iron.

    Raises `UnitError` for a calibration in counts; `NotExportable` for more than 10 T, and where the soft iron left
    out costs more than 0.5° of heading.
    """
    bias = _ten_digits(Affine.of(calibration, "T", who="imu_filter_madgwick").offset)
    if not np.all(np.abs(bias) <= LARGEST_T):
        raise NotExportable("mag_bias would be beyond 10 T: check the unit of the recording", beyond=BIAS)
    values = dict(zip(BIAS, bias, strict=True))
    named = [f"    {name}: {_yaml(value)}" for name, value in values.items()]
    return Written(lambda raw: raw - bias, ["/**:", "  ros__parameters:", "    use_mag: true", *named], values)


def write_pipeline(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the parameters of bias_remover, for rosparam; a calibration in counts raises `UnitError`."""
    exact = Affine.of(calibration, "T", who="magnetometer_pipeline")
    affine = Affine(_ten_digits(exact.matrix), _ten_digits(exact.offset), exact.strength)
    named = [f"{name}: {_yaml(value)}" for name, value in zip(INITIAL_BIAS, affine.offset, strict=True)]
    rows = [f"  {', '.join(map(_yaml, row))}" for row in affine.matrix]
    values = {"initial_mag_bias": affine.offset, INITIAL_MATRIX: affine.matrix}
    notes = ["the name of the matrix is that of the code; the package's README has another"]
    return Written(affine.apply, [*named, f"{INITIAL_MATRIX}: [", ",\n".join(rows), "  ]"], values, notes)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the parameters of magnetometer_pipeline back.

    `strength`, µT: length of corrected readings, which they do not hold; 50 µT where it is not given.

    Raises `DocumentError` where numbers are missing.
    """
    text = decoded(content, source)
    offset = numbers(keyed(text, source, ":"), INITIAL_BIAS, source)
    match = re.search(rf"{INITIAL_MATRIX}\s*:\s*\[([^\]]*)\]", text)
    if match is None:
        raise DocumentError(f"{source}: no {INITIAL_MATRIX}: [...] with nine numbers")
    words = [word.strip() for word in match[1].split(",")]
    if len(words) != 9:
        raise DocumentError(f"{source}: {INITIAL_MATRIX} has {len(words)} numbers: need nine")
    names = [f"{INITIAL_MATRIX}[{place}]" for place in range(9)]
    matrix = numbers(dict(zip(names, words, strict=True)), names, source).reshape(3, 3)
    return Affine(matrix, offset, 50e-6).to_calibration("T", strength=strength)


def _ten_digits(values: Floats) -> Floats:
    """Round to the digits that are written."""
    return np.array([float(f"{value:.9e}") for value in values.ravel()]).reshape(values.shape)


def _yaml(value: float) -> str:
    """A number with a point and a sign of the exponent."""
    return f"{value + 0.0:.9e}"


TARGETS: Final = (
    Target(
        name="ros-madgwick",
        use="ROS 2 imu_filter_madgwick",
        suffix=".yaml",
        title="imu_filter_madgwick",
        formula="m - mag_bias",
        unit="T",
        keeps="offset",
        storage="double; -10 to 10",
        fed=True,
        source="imu_tools, ImuFilterMadgwick.cfg",
        lengths="as long as the sensor makes them",
        write=write_madgwick,
    ),
    Target(
        name="ros-pipeline",
        use="ROS magnetometer_pipeline",
        suffix=".yaml",
        title="magnetometer_pipeline",
        formula="S (m - b)",
        unit="T",
        keeps="all",
        storage="double",
        fed=True,
        source="ctu-vras magnetometer_pipeline, bias_remover.cpp",
        write=write_pipeline,
        reader=TargetReader(INITIAL_BIAS[0].encode(), read, "parameters of magnetometer_pipeline"),
    ),
)
