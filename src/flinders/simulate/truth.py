"""The truth of a simulated recording, as a file next to it.

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

from flinders.core.calibration_file import Count, NotNegative, Positive, Triple, gaps, understood
from flinders.core.files import read_bytes, write_text
from flinders.core.json_layout import lay_out
from flinders.errors import UnreadableInput, UsageError
from flinders.simulate.attitudes import north_and_down
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from flinders.simulate.recording import Simulated

SUFFIX: Final = ".truth.json"
"""What the name of a recording ends with in place of its own ending."""

LARGEST: Final = 2**20
"""Bytes; a file has two thousand. More is another file, and is not read into memory."""


class SensorRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The sensor: raw = matrix field + offset + noise, then rounded and limited."""

    matrix: tuple[Triple, Triple, Triple]  #: (3, 3): rows; dimensionless, need not be symmetric
    offset: Triple  #: (3,) in the unit of the file
    noise: NotNegative  #: in the unit of the file: 1 σ of each axis
    resolution: Positive | None = None  #: in the unit of the file: step of the converter
    saturation: Positive | None = None  #: in the unit of the file: where each axis saturates

    def __post_init__(self) -> None:
        """Refuse a matrix that is singular or mirrors; called when a file is read."""
        determinant = float(np.linalg.det(np.array(self.matrix)))
        if not determinant > 0.0:
            raise ValueError(f"`matrix` has determinant {determinant:g}, need a positive one")


class FieldRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The field at the site."""

    strength: Positive  #: length of the field in the unit of the file
    dip_deg: Annotated[float, Meta(ge=-90, le=90)]  #: how far it points down from the horizon
    vector: Triple  #: (3,) in the unit of the file: north, east, down

    def __post_init__(self) -> None:
        """Refuse a vector that contradicts strength and dip; called when a file is read."""
        expected = self.strength * north_and_down(self.dip_deg)
        if not np.allclose(self.vector, expected, rtol=0.0, atol=1e-6 * self.strength):
            stated = ", ".join(f"{part:.6g}" for part in expected)
            raise ValueError(f"`vector` is not that of strength and dip, which is {stated}")


class RecordingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the recording was made."""

    motion: str  #: how the sensor was moved
    seed: int | None = None  #: of the random numbers; null where it was not one number
    readings: Count  #: how many
    rate_hz: Positive | None = None  #: null where there are no times
    outliers: Count = 0  #: readings that are of no use
    gyro_bias: Triple | None = None  #: (3,) rad/s or None: where there is a gyro
    disturbances: tuple[str, ...] = ()  #: their kinds


class Truth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="truth"):
    """What is true of a recording."""

    schema: Literal[1] = 1  #: version of this layout
    unit: Literal["uT", "counts"] = "uT"  #: of all that is a field
    sensor: SensorRecord  #: the sensor with the iron around it
    field: FieldRecord  #: the field at the site
    recording: RecordingRecord  #: how the recording was made
    version: str  #: of the Flinders that made it: the same seed gives the same bytes in the same version

    @classmethod
    def of(cls, simulated: Simulated) -> Truth:
        """Take it out of a simulated recording."""
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
        """The sensor, to record with it again."""
        record = self.sensor
        return Sensor(
            np.array(record.matrix), np.array(record.offset), record.noise, record.resolution, record.saturation
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what stands in the file."""
        plain: dict[str, Any] = msgspec.to_builtins(self)
        return plain


def truth_path(recording: str | os.PathLike[str]) -> str:
    """Where the truth of a recording stands unless someone says otherwise.

    >>> truth_path("data/tumble.csv"), truth_path("tumble")
    ('data/tumble.truth.json', 'tumble.truth.json')
    """
    path = Path(recording)
    stem = path.stem if path.suffix else path.name
    return str(path.with_name(stem + SUFFIX))


def read(path: str | os.PathLike[str]) -> Truth:
    """Read the truth of a recording; what cannot be opened or is none raises `UnreadableInput`."""
    text = read_bytes(path, largest=LARGEST, what="truth of a recording", refused=UnreadableInput)
    return loads(text, source=os.fspath(path))


def loads(text: str | bytes, *, source: str = "truth") -> Truth:
    """Understand the text of such a file; `source` names it in the `UnreadableInput` for what is wrong."""
    return understood(
        text, Truth, source, what="the truth of a recording, as `flinders simulate` writes it", refused=UnreadableInput
    )


def dumps(truth: Truth) -> str:
    """Lay it out as text; numbers are read back to the bit, and those that are not finite raise `UsageError`."""
    content = truth.as_dict()
    for place in gaps(content):
        raise UsageError(f"truth: {place} is not finite: only finite numbers are written")
    return lay_out(content) + "\n"


def write(truth: Truth, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write it, whole or not at all; raises as `dumps` and `flinders.core.files.write_text`."""
    write_text(dumps(truth), path, force=force)


def _triple(values: np.ndarray[Any, Any]) -> Triple:
    """Three plain numbers."""
    x, y, z = (float(value) for value in values)
    return x, y, z
