"""The truth of a simulated recording, in a file next to it.

>>> from flinders.simulate.recording import tumble
>>> truth = Truth.of(tumble(seed=1, n=100))
>>> truth.recording.motion, truth.recording.seed, truth.field.strength
('hand', 1, 50.0)
>>> loads(dumps(truth)) == truth
True
>>> loads('{"flinders": "truth", "schema": 1, "unit": "mT"}')
Traceback (most recent call last):
flinders.errors.UnreadableInput: truth: unit: invalid enum value 'mT'
"""

from __future__ import annotations

import os
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct

from flinders.core.calibration_file import Count, NotNegative, Positive, Triple, nonfinite_places, parse_document
from flinders.core.files import read_bytes, write_text
from flinders.core.json_layout import lay_out
from flinders.errors import UnreadableInput, UsageError
from flinders.simulate.attitudes import north_and_down
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from flinders.simulate.recording import Simulated

SUFFIX: Final = ".truth.json"
"""Suffix of the file, in place of that of the recording."""

MAX_BYTES: Final = 2**20
"""Largest size of a file, which has about 2,000 bytes; larger files are not read into memory."""


class SensorRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The sensor: raw = matrix field + offset + noise, then rounded and limited."""

    matrix: tuple[Triple, Triple, Triple]  #: (3, 3): rows; dimensionless, need not be symmetric
    offset: Triple  #: (3,) in the unit of the file
    noise: NotNegative  #: in the unit of the file: 1 σ of each axis
    resolution: Positive | None = None  #: in the unit of the file: step of the converter
    saturation: Positive | None = None  #: in the unit of the file: largest size of a reading of an axis

    def __post_init__(self) -> None:
        """Refuse a matrix that is singular or a reflection; called when a file is read."""
        determinant = float(np.linalg.det(np.array(self.matrix)))
        if not determinant > 0.0:
            raise ValueError(f"`matrix` has determinant {determinant:g}, need a positive one")


class FieldRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The field at the site."""

    strength: Positive  #: length of the field in the unit of the file
    dip_deg: Annotated[float, Meta(ge=-90, le=90)]  #: inclination of the field
    vector: Triple  #: (3,) in the unit of the file: field to north, east and down

    def __post_init__(self) -> None:
        """Refuse a vector that contradicts strength and dip; called when a file is read."""
        expected = self.strength * north_and_down(self.dip_deg)
        if not np.allclose(self.vector, expected, rtol=0.0, atol=1e-6 * self.strength):
            stated = ", ".join(f"{part:.6g}" for part in expected)
            raise ValueError(f"`vector` contradicts strength and dip, which give {stated}")


class RecordingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of the simulated recording."""

    motion: str  #: name of the motion
    seed: int | None = None  #: seed of the random numbers; null if it was not a number
    readings: Count  #: count of readings
    rate_hz: Positive | None = None  #: readings per second; null without times
    outliers: Count = 0  #: count of outliers
    gyro_bias: Triple | None = None  #: (3,) rad/s: reading of the gyro at rest; null without a gyro
    disturbances: tuple[str, ...] = ()  #: kinds of the disturbances


class Truth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="truth"):
    """The truth of a recording."""

    schema: Literal[1] = 1  #: version of this layout
    unit: Literal["uT", "counts"] = "uT"  #: unit of all fields
    sensor: SensorRecord  #: the sensor with the iron around it
    field: FieldRecord  #: the field at the site
    recording: RecordingRecord  #: parameters of the recording
    version: str  #: release of Flinders; in one release a seed always gives the same bytes

    @classmethod
    def of(cls, simulated: Simulated) -> Truth:
        """The truth of a simulated recording."""
        sensor, field_strength = simulated.sensor, float(simulated.field_strength)
        matrix = tuple(tuple(row) for row in sensor.matrix.tolist())
        biased = simulated.imu is not None and simulated.samples.rate is not None
        return cls(
            unit="uT" if simulated.samples.unit.inside == "uT" else "counts",
            sensor=SensorRecord(
                matrix=matrix,  # type: ignore[arg-type]  # three rows of three
                offset=_triple(sensor.offset),
                noise=float(sensor.noise),
                resolution=None if sensor.resolution is None else float(sensor.resolution),
                saturation=None if sensor.saturation is None else float(sensor.saturation),
            ),
            field=FieldRecord(
                strength=field_strength,
                dip_deg=simulated.dip_deg,
                vector=_triple(field_strength * north_and_down(simulated.dip_deg)),
            ),
            recording=RecordingRecord(
                motion=simulated.motion,
                seed=simulated.seed,
                readings=len(simulated.samples),
                rate_hz=simulated.rate_hz,
                outliers=int(simulated.outliers.sum()),
                gyro_bias=_triple(simulated.imu.gyro_bias) if biased and simulated.imu else None,
                disturbances=simulated.disturbances,
            ),
            version=version("flinders"),
        )

    def as_sensor(self) -> Sensor:
        """The sensor, for further simulated recordings."""
        record = self.sensor
        return Sensor(
            np.array(record.matrix), np.array(record.offset), record.noise, record.resolution, record.saturation
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready content of the file."""
        plain: dict[str, Any] = msgspec.to_builtins(self)
        return plain


def truth_path(recording: str | os.PathLike[str]) -> str:
    """Default path of the truth of a recording.

    >>> truth_path("data/tumble.csv"), truth_path("tumble")
    ('data/tumble.truth.json', 'tumble.truth.json')
    """
    path = Path(recording)
    stem = path.stem if path.suffix else path.name
    return str(path.with_name(stem + SUFFIX))


def read(path: str | os.PathLike[str]) -> Truth:
    """Read the truth of a recording; `UnreadableInput` for a file that cannot be opened or is another one."""
    text = read_bytes(path, largest=MAX_BYTES, what="truth of a recording", refused=UnreadableInput)
    return loads(text, source=os.fspath(path))


def loads(text: str | bytes, *, source: str = "truth") -> Truth:
    """Parse the text of such a file; `source` is its name in the `UnreadableInput` for errors."""
    return parse_document(
        text, Truth, source, what="the truth of a recording, as `flinders simulate` writes it", refused=UnreadableInput
    )


def dumps(truth: Truth) -> str:
    """Text of the file, from which numbers are read exactly; raises `UsageError` for numbers that are not finite."""
    content = truth.as_dict()
    for place in nonfinite_places(content):
        raise UsageError(f"truth: {place} is not finite: only finite numbers are written")
    return lay_out(content) + "\n"


def write(truth: Truth, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write the truth atomically; raises as `dumps` and `flinders.core.files.write_text`."""
    write_text(dumps(truth), path, force=force)


def _triple(values: np.ndarray[Any, Any]) -> Triple:
    """Three numbers as Python floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z
