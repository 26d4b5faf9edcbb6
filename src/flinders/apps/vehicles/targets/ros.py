"""Parameters of ROS packages in tesla: ``m − b`` of imu_filter_madgwick, ``S (m − b)`` of others, and their noise.

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

Noise parameters are written if the noise is known.

- ``orientation_stddev`` of imu_filter_madgwick: the filter squares it into the covariance of the orientation that it
  publishes. robot_localization treats this covariance as white noise of a yaw, with a default process noise of
  0.06 rad²/s and 30 updates a second. The value written makes robot_localization state the true error of its yaw
  (`ROBOT_LOCALIZATION`).
- ``magnetometer.noise_rad`` of FusionCore: noise of a heading in a filter with a gyro and its bias (`FUSIONCORE`).
- ``magnetic_field_stddev`` of the driver (REP 145), which becomes the covariance of the field in T². It is written as a
  comment, since it is a parameter of the driver.

Sources: CCNY imu_tools, ``ImuFilterMadgwick.cfg`` (mag_bias, −10 to 10); ctu-vras magnetometer_pipeline,
``bias_remover.cpp`` (the code reads initial_mag_scaling_matrix; the README's initial_scaling_matrix is wrong);
cra-ros-pkg robot_localization, ``filter_base.cpp`` (process noise of the yaw); manankharwar/fusioncore,
``sensors/magnetometer.hpp`` (``soft_iron (m − hard_iron)``, ENU, field_tolerance a share of field_strength) and
``fusioncore.yaml`` (ukf.q_gyro_bias 1e-5 at each of 100 steps a second, imu.gyro_noise 0.005 rad/s); ROS REP 145.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import DocumentError, NotExportable
from flinders.targets._measurement_noise import YawFilter
from flinders.targets._numbers import Affine, axes_of_action, decode_text, numbers, parse_pairs, yaml_text
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.targets._measurement_noise import MeasurementNoise

ROBOT_LOCALIZATION: Final = YawFilter(rate_hz=30.0, drift=0.06, is_of_gyro=False)
"""robot_localization's filter of the yaw, with its default process noise."""
FUSIONCORE: Final = YawFilter(rate_hz=50.0, drift=0.005**2 * 0.01, bias_drift=1e-5 * 100.0)
"""FusionCore's filter of the yaw and the gyro bias, with a magnetometer at 50 Hz."""
BODY_AXES: Final = (
    "the readings must be in the axes of the body, x forward, y left and z up, and magnetometer.declination_rad that "
    "of the place"
)
MAX_BIAS_T: Final = 10.0
BIAS: Final = ("mag_bias_x", "mag_bias_y", "mag_bias_z")
INITIAL_BIAS: Final = tuple(f"initial_{name}" for name in BIAS)
INITIAL_MATRIX: Final = "initial_mag_scaling_matrix"


def write_madgwick(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a file of parameters for ROS 2, for a node of any name: a bias, and no soft iron.

    Raises `UnitError` for a calibration in counts; `NotExportable` for more than 10 T, or if the omitted soft iron
    loses more than 0.5° of heading.
    """
    bias = _round_to_ten_digits(Affine.of(calibration, "T", who="imu_filter_madgwick").offset)
    if not np.all(np.abs(bias) <= MAX_BIAS_T):
        raise NotExportable("mag_bias would be beyond 10 T: check the unit of the recording", beyond=BIAS)
    values: dict[str, float] = dict(zip(BIAS, bias.tolist(), strict=True))
    notes: list[str] = []
    if (noise := asked.noise) is not None:
        sigma = ROBOT_LOCALIZATION.measurement_sigma(noise.heading_calibration_deg, 0.0)
        values["orientation_stddev"] = float(f"{sigma:.3e}")
        who = "robot_localization (as delivered; it has only this number for roll and pitch, too)"
        notes = [ROBOT_LOCALIZATION.words("orientation_stddev", sigma, noise, who=who), field_words(noise)]
    else:
        notes = [unknown_noise("orientation_stddev")]
    named = [f"    {name}: {_yaml(value)}" for name, value in values.items()]
    body = ["/**:", "  ros__parameters:", "    use_mag: true", *named]
    return Written(lambda raw: raw - bias, body, values, notes)


def write_fusioncore(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the parameters of FusionCore's magnetometer; a calibration in counts raises `UnitError`.

    Axes must be those of the body: x forward, y left, z up.
    """
    exact = Affine.of(calibration, "T", who="FusionCore", acts=axes_of_action("mapped", calibration))
    affine = Affine(_round_to_ten_digits(exact.matrix), _round_to_ten_digits(exact.offset), exact.strength)
    values: dict[str, Any] = {"hard_iron": affine.offset, "soft_iron": affine.matrix.ravel()}
    notes = [BODY_AXES]
    if (noise := asked.noise) is not None:
        sigma = FUSIONCORE.measurement_sigma(noise.heading_calibration_deg, noise.heading_reading_deg)
        values["noise_rad"] = float(f"{sigma:.3e}")
        who = f"FusionCore (as delivered, {FUSIONCORE.rate_hz:.0f} readings a second)"
        notes += [FUSIONCORE.words("noise_rad", sigma, noise, who=who), field_words(noise)]
    else:
        notes.append(unknown_noise("magnetometer.noise_rad"))
    if (gates := asked.gates) is not None:
        values |= {
            "field_strength": affine.strength,
            "field_tolerance": gates.strength_limit / calibration.field_strength,
        }
    named = [f"    magnetometer.{name}: {_yaml(value)}" for name, value in values.items()]
    body = ["/**:", "  ros__parameters:", "    magnetometer.enabled: true", *named]
    return Written(affine.apply, body, values, notes)


def unknown_noise(name: str) -> str:
    """Note on a parameter that is not written, since the calibration states no heading error."""
    return f"{name} is not written, and stays as it is: the calibration states no heading error"


def field_words(noise: MeasurementNoise) -> str:
    """Sentence on the noise of a corrected reading, for a driver after REP 145; the fit is in µT."""
    return (
        f"magnetic_field_stddev (REP 145) of corrected readings is {noise.axis * 1e-6:.3g} T, its square the "
        f"covariance of an axis in T²: {noise.reading * 1e-6:.3g} T of white noise, and {noise.calibration * 1e-6:.3g} "
        "T of calibration error, the same in every reading at one attitude"
    )


def write_pipeline(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the parameters of bias_remover, for rosparam; a calibration in counts raises `UnitError`."""
    exact = Affine.of(calibration, "T", who="magnetometer_pipeline")
    affine = Affine(_round_to_ten_digits(exact.matrix), _round_to_ten_digits(exact.offset), exact.strength)
    named = [f"{name}: {_yaml(value)}" for name, value in zip(INITIAL_BIAS, affine.offset, strict=True)]
    rows = [f"  {', '.join(map(_yaml, row))}" for row in affine.matrix]
    values = {"initial_mag_bias": affine.offset, INITIAL_MATRIX: affine.matrix}
    notes = ["the name of the matrix is that of the code; the package's README has another"]
    notes += [] if asked.noise is None else [field_words(asked.noise)]
    return Written(affine.apply, [*named, f"{INITIAL_MATRIX}: [", ",\n".join(rows), "  ]"], values, notes)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the parameters of magnetometer_pipeline back.

    `strength` is the length of corrected readings in µT, by default 50 µT; the parameters do not hold it.

    Raises `DocumentError` if numbers are missing.
    """
    text = decode_text(content, source)
    offset = numbers(parse_pairs(text, source, ":"), INITIAL_BIAS, source)
    match = re.search(rf"{INITIAL_MATRIX}\s*:\s*\[([^\]]*)\]", text)
    if match is None:
        raise DocumentError(f"{source}: no {INITIAL_MATRIX}: [...] with nine numbers")
    words = [word.strip() for word in match[1].split(",")]
    if len(words) != 9:
        raise DocumentError(f"{source}: {INITIAL_MATRIX} has {len(words)} numbers: need nine")
    names = [f"{INITIAL_MATRIX}[{place}]" for place in range(9)]
    matrix = numbers(dict(zip(names, words, strict=True)), names, source).reshape(3, 3)
    return Affine(matrix, offset, 50e-6).to_calibration("T", strength=strength)


def _round_to_ten_digits(values: Floats) -> Floats:
    """Round numbers to the ten digits that are written."""
    return np.array([float(f"{value:.9e}") for value in values.ravel()]).reshape(values.shape)


def _yaml(value: float | Floats) -> str:
    """Text of a number or a list of numbers in YAML, to ten digits."""
    return yaml_text((np.asarray(value) + 0.0).tolist(), 9)


TARGETS: Final = (
    Target(
        name="ros-madgwick",
        use="ROS 2 imu_filter_madgwick",
        group="ROS",
        suffix=".yaml",
        title="imu_filter_madgwick",
        formula="m - mag_bias",
        unit="T",
        keeps="offset",
        storage="double; -10 to 10",
        fed=True,
        source="imu_tools, ImuFilterMadgwick.cfg",
        lengths="as long as the sensor makes them",
        programs=("robot_localization",),
        writes_noise=True,
        write=write_madgwick,
    ),
    Target(
        name="ros-pipeline",
        use="ROS magnetometer_pipeline",
        group="ROS",
        suffix=".yaml",
        title="magnetometer_pipeline",
        formula="S (m - b)",
        unit="T",
        keeps="all",
        storage="double",
        fed=True,
        source="ctu-vras magnetometer_pipeline, bias_remover.cpp",
        writes_noise=True,
        write=write_pipeline,
        reader=TargetReader(INITIAL_BIAS[0].encode(), read, "parameters of magnetometer_pipeline"),
    ),
    Target(
        name="fusioncore",
        use="ROS 2 FusionCore",
        group="ROS",
        suffix=".yaml",
        title="FusionCore",
        formula="soft_iron (m - hard_iron)",
        unit="T",
        keeps="all",
        storage="double",
        acts="mapped",
        source="fusioncore, sensors/magnetometer.hpp",
        writes_noise=True,
        write=write_fusioncore,
    ),
)
