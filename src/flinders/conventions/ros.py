"""Parameters of two ROS packages in tesla: ``m − b`` of imu_filter_madgwick, ``S (m − b)`` of magnetometer_pipeline.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> print(*madgwick_lines(Bias.of(found)), sep=chr(10))
/**:
  ros__parameters:
    use_mag: true
    mag_bias_x: 1.000000000e-05
    mag_bias_y: -2.000000000e-05
    mag_bias_z: 3.000000000e-05
>>> read(chr(10).join(pipeline_lines(pipeline(found))).encode(), "params.yaml").isclose(found)
True

Numbers are written with a point and a sign of the exponent, or YAML 1.1 would take 1e-05 for text.

Sources: CCNY imu_tools, ``ImuFilterMadgwick.cfg`` (mag_bias, −10 to 10); ctu-vras magnetometer_pipeline,
``bias_remover.cpp``: the code reads initial_mag_scaling_matrix, its README says initial_scaling_matrix, and is wrong.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, vectors
from flinders.conventions._affine import Affine
from flinders.conventions._parsing import decoded, keyed, numbers
from flinders.errors import DocumentError, NotExportable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

MADGWICK: Final = "imu_filter_madgwick"
PIPELINE: Final = "magnetometer_pipeline"
LARGEST_T: Final = 10.0
BIAS: Final = ("mag_bias_x", "mag_bias_y", "mag_bias_z")
INITIAL_BIAS: Final = tuple(f"initial_{name}" for name in BIAS)
INITIAL_MATRIX: Final = "initial_mag_scaling_matrix"


@dataclass(frozen=True, slots=True, eq=False)
class Bias:
    """What imu_filter_madgwick subtracts: it knows no soft iron.

    Attributes
    ----------
    offset : (3,) float, T
    """

    offset: Floats

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round to ten digits; in the axes as recorded, without the matrix.

        Raises
        ------
        UnitError
            For a calibration in counts.
        NotExportable
            For more than 10 T.
        """
        offset = _digits(Affine.of(calibration, "T", who=MADGWICK).offset)
        if not np.all(np.abs(offset) <= LARGEST_T):
            raise NotExportable("mag_bias would be beyond 10 T: check the unit of the recording", beyond=BIAS)
        return cls(offset)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in T to (..., 3) in T."""
        corrected: Floats = vectors(field, finite=False) - self.offset
        return corrected


def pipeline(calibration: Calibration) -> Affine:
    """Offset in tesla and matrix, rounded to ten digits; a calibration in counts raises `UnitError`."""
    found = Affine.of(calibration, "T", who=PIPELINE)
    return Affine(_digits(found.matrix), _digits(found.offset), found.strength)


def madgwick_lines(bias: Bias) -> list[str]:
    """The parameters for ROS 2, for a node of any name."""
    named = [f"    {name}: {_yaml(value)}" for name, value in zip(BIAS, bias.offset, strict=True)]
    return ["/**:", "  ros__parameters:", "    use_mag: true", *named]


def pipeline_lines(parameters: Affine) -> list[str]:
    """The parameters of bias_remover, row by row."""
    named = [f"{name}: {_yaml(value)}" for name, value in zip(INITIAL_BIAS, parameters.offset, strict=True)]
    rows = [f"  {', '.join(map(_yaml, row))}" for row in parameters.matrix]
    return [*named, f"{INITIAL_MATRIX}: [", ",\n".join(rows), "  ]"]


def sniff(head: bytes) -> bool:
    """Whether a file may hold parameters of magnetometer_pipeline."""
    return INITIAL_BIAS[0].encode() in head


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the parameters of magnetometer_pipeline back.

    `strength`, µT: length of corrected readings, which they do not hold; 50 µT where it is not given.

    Raises
    ------
    DocumentError
        Where numbers are missing.
    """
    text = decoded(content, source)
    offset = numbers(keyed(text, source, ":"), INITIAL_BIAS, source)
    found = re.search(rf"{INITIAL_MATRIX}\s*:\s*\[([^\]]*)\]", text)
    if found is None:
        raise DocumentError(f"{source}: no {INITIAL_MATRIX}: [...] with nine numbers")
    words = [word.strip() for word in found[1].split(",")]
    if len(words) != 9:
        raise DocumentError(f"{source}: {INITIAL_MATRIX} has {len(words)} numbers: need nine")
    names = [f"{INITIAL_MATRIX}[{place}]" for place in range(9)]
    matrix = numbers(dict(zip(names, words, strict=True)), names, source).reshape(3, 3)
    return Affine(matrix, offset, 50e-6).to_calibration("T", strength=strength)


def _digits(values: Floats) -> Floats:
    return np.array([float(f"{value:.9e}") for value in values.ravel()]).reshape(values.shape)


def _yaml(value: float) -> str:
    return f"{value + 0.0:.9e}"
