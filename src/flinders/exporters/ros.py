"""Parameters of two ROS packages, in tesla: imu_filter_madgwick (ROS 2) and magnetometer_pipeline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.ros import BIAS, Bias, madgwick_lines, pipeline, pipeline_lines
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

MADGWICK: Final = Sheet(
    title="imu_filter_madgwick",
    formula="m - mag_bias",
    unit="T",
    keeps="offset",
    storage="double; -10 to 10",
    fed=True,
    source="imu_tools, ImuFilterMadgwick.cfg",
    lengths="as long as the sensor makes them",
)
PIPELINE: Final = Sheet(
    title="magnetometer_pipeline",
    formula="S (m - b)",
    unit="T",
    keeps="all",
    storage="double",
    fed=True,
    source="ctu-vras magnetometer_pipeline, bias_remover.cpp",
)


def write_madgwick(calibration: Calibration, _asked: Asked) -> Written:
    """Write a file of parameters for ROS 2.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        Where the soft iron left out costs more than a degree of heading.
    """
    bias = Bias.of(calibration)
    return Written(bias.apply, madgwick_lines(bias), dict(zip(BIAS, bias.offset, strict=True)))


def write_pipeline(calibration: Calibration, _asked: Asked) -> Written:
    """Write the parameters of bias_remover, for rosparam; a calibration in counts raises `UnitError`."""
    found = pipeline(calibration)
    values = {"initial_mag_bias": found.offset, "initial_mag_scaling_matrix": found.matrix}
    notes = ["the name of the matrix is that of the code; the package's README has another"]
    return Written(found.apply, pipeline_lines(found), values, notes)
