"""The calibration file: readable JSON with a schema version, written atomically.

A file holds the correction, the unit and axes of the raw readings, and, if a fit made it, its uncertainty
and the recordings that it came from. Later releases read the files of all earlier ones; a file of a newer
schema is refused, with the version that reads it.

>>> correction = Correction(matrix=((1.0, 0.0, 0.0), (0.0, 1.25, 0.0), (0.0, 0.0, 0.8)), offset=(12.5, -3.0, 40.0),
...                         field_strength=49.8, unit="uT")
>>> print(dumps(Document(calibration=correction, raw=Recorded(unit="mG", scale=0.1))), end="")
{
  "flinders": "calibration",
  "schema": 1,
  "calibration": {
    "matrix": [
      [1.0, 0.0,  0.0],
      [0.0, 1.25, 0.0],
      [0.0, 0.0,  0.8]
    ],
    "offset": [12.5, -3.0, 40.0],
    "field_strength": 49.8,
    "field_strength_known": false,
    "unit": "uT",
    "rotation": "symmetric"
  },
  "raw": {"unit": "mG", "scale": 0.1, "axes": "x,y,z", "sensor": null, "frame": "sensor"},
  "fit": null,
  "provenance": null
}
>>> loads('{"flinders": "calibration", "schema": 2, "provenance": {"flinders": "3.1.0"}}')
Traceback (most recent call last):
flinders.errors.DocumentError: calibration: written in schema 2, this Flinders reads up to 1: install Flinders 3.1.0 \
or newer
"""

from __future__ import annotations

import json
import math
import numbers
import os
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeAlias, TypeVar

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from flinders.core.files import read_bytes, write_text
from flinders.core.json_layout import lay_out
from flinders.errors import DocumentError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.errors import FlindersError

AnyStruct = TypeVar("AnyStruct", bound=Struct)

VERSION: Final = 1
"""Number of the schema that this release writes; it reads this one and all earlier ones."""

PARAMETERS: Final = (
    "offset_x", "offset_y", "offset_z", "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz",
)  # fmt: skip
"""Names of the nine parameters of an ellipsoid, in the order of the rows of its covariance."""

MAX_BYTES: Final = 16 * 2**20
"""Largest calibration file in bytes; a usual one has some thousand. A larger file is refused without reading it."""

Triple: TypeAlias = tuple[float, float, float]
DisturbanceKey: TypeAlias = Annotated[
    str, Meta(pattern="^(current([1-9][0-9]?)?_A|throttle([1-9][0-9]?)?|temperature_C)$")
]
ColumnName: TypeAlias = Annotated[str, Meta(min_length=1)]
Rotation: TypeAlias = Literal["symmetric", "estimated", "composed"]
Positive: TypeAlias = Annotated[float, Meta(gt=0)]
NotNegative: TypeAlias = Annotated[float, Meta(ge=0)]
Count: TypeAlias = Annotated[int, Meta(ge=0)]


class DisturbanceRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A disturbance that the offset follows: ``offset + offset_per_unit (value - reference)``."""

    offset_per_unit: Triple  #: (3,) in the calibration's unit: for each A, at full throttle, or for each °C
    reference: float = 0.0  #: value at which the calibration's offset holds
    recorded_range: tuple[float, float]  #: (2,): lowest and highest value in the recordings of the fit
    lag_s: float = 0.0  #: s: delay of the readings behind the value
    scale_per_unit: float = 0.0  #: relative growth of the earth's part of a reading for each °C


class ColumnRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A column of the log that an offset follows: ``offset + offset_per_unit (value - reference)``."""

    offset_per_unit: Triple  #: (3,) in the calibration's unit: for each unit of the column, or in the second state
    reference: float = 0.0  #: value at which the calibration's offset holds
    recorded_range: tuple[float, float]  #: (2,): lowest and highest value in the recordings of the fit
    lag_s: float = 0.0  #: s: delay of the readings behind the value
    #: words in the column that stand for 0 and 1; left out for a column of numbers
    states: tuple[str, str] | UnsetType = UNSET


class LinearizationRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Terms of nonlinear axes: the matrix is applied to d - (quadratic + cubic d) d², d = raw - offset."""

    quadratic: Triple  #: (3,), one over the calibration's unit
    cubic: Triple  #: (3,), one over the square of the calibration's unit
    #: (3,) in the calibration's unit: a larger d is corrected by the same amount as d at the limit
    limit: tuple[Positive, Positive, Positive]


class Correction(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """corrected = matrix (raw - offset), of length field_strength."""

    matrix: tuple[Triple, Triple, Triple]  #: (3, 3): rows; dimensionless
    offset: Triple  #: (3,) in `unit`: reading of the sensor in zero field
    field_strength: Positive  #: in `unit`: length of corrected readings
    #: whether the field strength was given; otherwise it follows from a matrix of determinant 1
    field_strength_known: bool = False
    unit: Literal["uT", "counts"]  #: ``uT``, or ``counts`` if the unit of the recording is not known
    #: ``symmetric``: not observable, set by convention; ``estimated``: determined by the fit; ``composed``: a product
    #: of calibrations
    rotation: Rotation = "symmetric"
    #: name to DisturbanceRecord: currents, throttles and temperature that the offset follows: ``current_A``,
    #: ``throttle`` (0 to 1), ``temperature_C``; ``current1_A`` and ``throttle1`` are those of motor 1 alone
    disturbances: dict[DisturbanceKey, DisturbanceRecord] | UnsetType = UNSET
    #: name to ColumnRecord: columns that the offset follows, by their names in the log, such as ``wheel_speed_rpm``
    columns: dict[ColumnName, ColumnRecord] | UnsetType = UNSET
    linearization: LinearizationRecord | UnsetType = UNSET  #: of nonlinear axes, applied before the matrix


class Recorded(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Unit, axes and sensor of the raw readings."""

    unit: Literal["uT", "mG", "G", "nT", "mT", "T", "counts"]  #: the recording's own unit
    scale: Positive = 1.0  #: size of the recording's unit in the calibration's unit
    #: the recorded axis for each axis used, such as ``x,-y,-z``
    axes: Annotated[str, Meta(pattern="^-?[xyz],-?[xyz],-?[xyz]$")] = "x,y,z"
    sensor: str | None = None  #: its name or serial number
    frame: str = "sensor"  #: frame of the recorded axes: ``sensor``, or ``vehicle`` if rotated by the mounting


class HeadingErrorRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The heading error to expect, in degrees."""

    rms: NotNegative  #: degrees: 1 σ, root mean square over all headings
    worst: NotNegative  #: degrees: 1 σ at the worst heading
    bound_95: NotNegative | None = None  #: degrees: with a probability of 95 % the errors at all headings are smaller
    dip_deg: Annotated[float, Meta(ge=-90, le=90)] | None = None  #: dip of the field for which the errors hold
    dip_assumed: bool = False  #: whether the dip is assumed, as the place of the recording is not known
    target_deg: Positive | None = None  #: largest heading error that was asked for
    structure_deg: NotNegative = 0.0  #: part of `rms` and `worst` by residuals that depend on the field's direction


class FindingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A finding about a fit: a code, a measured number with its limit, and the values in the finding's sentence."""

    code: str  #: stable name, see the table of findings
    severity: str  #: ``note``, ``limits`` or ``refuses``
    number: float | None = None  #: measured value; the code determines its meaning and unit
    limit: float | None = None  #: limit that `number` is compared with
    #: values in the finding's sentence, by their placeholders: a number, a short name, or a list of these
    values: dict[str, float | str | tuple[Any, ...] | None] = {}
    follows_from: str | None = None  #: code of the finding that is the cause of this one


class AidingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Estimated parameters of the aiding sensors."""

    #: (3, 3), rad²: covariance of the rotation from the magnetometer's axes to those of the body, about body axes
    rotation_covariance: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    acceleration_bias: Triple | UnsetType = UNSET  #: (3,), m/s²: bias of the accelerometer
    acceleration_bias_sigma: Triple | UnsetType = UNSET  #: (3,), m/s²: 1 σ of `acceleration_bias`
    #: (3, 3): specific force = acceleration_matrix (reading − acceleration_bias)
    acceleration_matrix: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    acceleration_matrix_sigma: tuple[Triple, Triple, Triple] | UnsetType = UNSET  #: (3, 3): 1 σ of each entry
    gravity_reading: float | UnsetType = UNSET  #: length of the accelerometer's readings at rest, in their own unit
    #: (3,), degrees: error of the vertical that the corrected accelerometer shows at rest: 1 σ as rms over all
    #: attitudes, 1 σ at the worst attitude, and 95 % bound over all attitudes
    tilt_error_deg: Triple | UnsetType = UNSET
    gyro_bias: Triple | UnsetType = UNSET  #: (3,), rad/s: reading of the gyro at rest
    gyro_bias_sigma: Triple | UnsetType = UNSET  #: (3,), rad/s: 1 σ of `gyro_bias`
    #: (3, 3): rate = gyro_matrix (reading − gyro_bias)
    gyro_matrix: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    gyro_matrix_sigma: tuple[Triple, Triple, Triple] | UnsetType = UNSET  #: (3, 3): 1 σ of each entry
    dip_deg: float | UnsetType = UNSET  #: dip of the field relative to the recorded vertical
    dip_sigma_deg: NotNegative | UnsetType = UNSET  #: 1 σ of the dip


def aiding_record(**columns: Floats | float | None) -> AidingRecord | UnsetType:
    """Make an `AidingRecord` of the values that are given and finite; UNSET if there are none."""
    given = {name: value for name, value in columns.items() if value is not None}
    known = {name: value if isinstance(value, float) else value.tolist() for name, value in given.items()}
    finite = {name: value for name, value in known.items() if not any(nonfinite_places(value))}
    return msgspec.convert(finite, AidingRecord) if finite else UNSET


class WalkRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rate of the random walk of the offset, from the history of this unit."""

    rate: Positive  #: in the calibration's unit: 1 σ of the change of each axis in one hour; it grows with √t
    low: Positive  #: lower end of the rate's 95 % interval
    high: Positive  #: upper end of the rate's 95 % interval


class GoodUntilRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Time for which the claimed worst heading error holds, computed from the claim and the offset's random walk."""

    #: h: time until the claim reaches its target, at the median rate of the walk; null if the claim exceeds its target
    #: already
    target_hours: Positive | None = None
    doubled_hours: Positive  #: h: time until the claim has doubled, at the median rate
    doubled_hours_low: Positive  #: h: time until the claim has doubled, at the upper end of the rate's 95 % interval
    doubled_hours_high: Positive  #: h: time until the claim has doubled, at the lower end of the rate's 95 % interval
    #: date at which the claim has doubled, from the date of the recording; null if the file states no date
    doubled_date: datetime | None = None
    by: Literal["history", "prior"]  #: source of the rate: history of this unit, or prior for any unit
    #: K: change of temperature that doubles the claim, by the median coefficient
    temperature_change_kelvin: Positive | None = None
    #: K: change of temperature that doubles the claim, by the largest coefficient of data sheets
    temperature_change_low_kelvin: Positive | None = None
    #: K: change of temperature that doubles the claim, by the smallest coefficient of data sheets
    temperature_change_high_kelvin: Positive | None = None
    #: source of the coefficient: ``followed`` for a fit that follows the temperature, and the change is then from the
    #: fit's reference; ``prior`` for data sheets
    temperature_by: Literal["followed", "prior"]


class Fitted(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The fit that gave the calibration, and its uncertainty."""

    method: str  #: method that gave the calibration, such as ``likelihood``
    samples: Count  #: readings used
    noise: NotNegative | None = None  #: in the calibration's unit: standard deviation of one axis of one reading
    #: (K,): parameters of the rows of `covariance`, such as ``offset_x``, ``shape_xy``
    covariance_of: tuple[str, ...] = PARAMETERS
    #: (K, K) or None: symmetric, in squares and products of the calibration's unit
    covariance: tuple[tuple[float, ...], ...] | None = None
    #: ``good``, ``limited`` or ``refused``; None if the fit was not judged
    verdict: Literal["good", "limited", "refused"] | None = None
    heading_error_deg: HeadingErrorRecord | None = None  #: expected heading error of a level vehicle
    #: times until the worst heading error reaches its target, and until it has doubled
    good_until: GoodUntilRecord | UnsetType = UNSET
    walk: WalkRecord | UnsetType = UNSET  #: random walk of the offset, if a history of this unit was given
    coverage: dict[str, float] = {}  #: measures of the recorded directions, with the keys of `Coverage.as_dict`
    findings: tuple[FindingRecord, ...] = ()  #: findings about the fit, the most severe first
    #: assumptions of the verdict: ``same-soft-iron``, ``unchanged-body``, ``uniform-field``, ``constant-iron``
    conditions: (
        tuple[Literal["same-soft-iron", "unchanged-body", "uniform-field", "constant-iron"], ...] | UnsetType
    ) = UNSET
    #: ``xy``, ``yz`` or ``zx``: plane of the turn, for a fit of one flat turn
    plane: Literal["xy", "yz", "zx"] | UnsetType = UNSET
    #: for a fit of one flat turn, whether z points down; None if not known
    z_down: bool | UnsetType | None = UNSET
    aiding: AidingRecord | UnsetType = UNSET  #: estimated parameters of gyro, accelerometer or attitude

    def __post_init__(self) -> None:
        """Refuse a covariance whose size differs from the count of parameter names; called when a file is read."""
        size = len(self.covariance_of)
        rows = self.covariance
        if rows is None:
            return
        if len(rows) != size or any(len(row) != size for row in rows):
            raise ValueError(f"`covariance` needs {size} rows of {size}, as `covariance_of` has {size} names")
        if any(rows[i][i] < 0 for i in range(size)):
            raise ValueError("`covariance` has a negative variance on its diagonal")


class ColumnsRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Columns of a table that the user chose for the magnetometer, and the layout that identifies such tables."""

    field: tuple[str, ...]  #: columns of x, y and z as the user gave them: names, or numbers counted from 1
    width: Annotated[int, Meta(ge=1)]  #: count of columns of a line
    names: tuple[str, ...] = ()  #: names in the header; empty without a header
    increasing: tuple[int, ...] = ()  #: without a header: numbers of the columns that only increase, such as a clock


class SourceFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """One recording that a calibration came from."""

    name: str  #: name of the file
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]  #: digest of the file's bytes
    bytes: Count  #: size of the file in bytes
    rows: Count  #: count of readings in the file
    #: whether the readings were corrected by the onboard calibration, so that this calibration is applied after it
    as_logged: bool = False
    autopilot: Literal["ardupilot", "px4"] | None = None  #: autopilot of the compass
    compass: Annotated[int, Meta(ge=0, le=3)] | None = None  #: number of the compass: ArduPilot's 1 to 3, PX4's 0 to 3
    device_id: Count | None = None  #: device id of the compass
    #: roll, pitch and yaw in degrees: mounting in the log, vehicle = R_z(yaw) R_y(pitch) R_x(roll) sensor
    mounting: Triple | None = None
    columns: ColumnsRecord | None = None  #: columns that the user chose; also used for other tables of this layout


class ProvenanceRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Release that made a calibration, date, and recordings."""

    flinders: str  #: version of the release
    date: Annotated[datetime, Meta(tz=True)]  #: date and time, with a time zone
    files: tuple[SourceFile, ...] = ()  #: the recordings
    #: date of the newest recording by its own clock; left out if the clock does not count from 1970
    recorded: Annotated[datetime, Meta(tz=True)] | UnsetType = UNSET


class SurveyRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Accelerometer and laser of a survey instrument; both sensors are corrected into the axes of the instrument."""

    accelerometer: Correction  #: for readings that point down at rest; their unit is called counts
    #: the recorded axis for each axis of the accelerometer, such as ``x,-y,-z``
    acceleration_axes: Annotated[str, Meta(pattern="^-?[xyz],-?[xyz],-?[xyz]$")] = "x,y,z"
    pointing: Literal["x", "y", "z"] = "x"  #: axis of the laser
    #: (3,): q, one over the unit of the accelerometer: a reading g of an axis is corrected to g + q g²
    quadratic: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Document(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="calibration"):
    """A calibration file of Flinders."""

    schema: Literal[1] = 1  #: version of this layout
    calibration: Correction  #: the correction
    raw: Recorded  #: unit, axes and sensor of the raw readings
    fit: Fitted | None = None  #: the fit and its uncertainty; null if not known
    provenance: ProvenanceRecord | None = None  #: release, date and recordings
    survey: SurveyRecord | UnsetType = UNSET  #: other sensors of a survey instrument


def read(path: str | os.PathLike[str]) -> Document:
    """Read a calibration file; raises `DocumentError` if it cannot be opened or parsed."""
    text = read_bytes(path, largest=MAX_BYTES, what="calibration file", refused=DocumentError)
    return loads(text, source=os.fspath(path))


def loads(text: str | bytes, *, source: str = "calibration") -> Document:
    """Parse the text of a calibration file; `source` names the file in a `DocumentError`."""
    return parse_document(text, Document, source, what="a calibration file", refused=DocumentError)


def write(document: Document, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a calibration file atomically; raises as `dumps` and `flinders.core.files.write_text`."""
    write_text(dumps(document), path, force=force)


def dumps(document: Document) -> str:
    """Write a document as text, with a line for each row of a matrix; `loads` gives exactly the same numbers.

    Raises `DocumentError` for values that the schema does not allow, such as NaN and infinity.
    """
    try:
        content = msgspec.to_builtins(document, enc_hook=_plain)
    except TypeError as error:
        raise DocumentError(f"calibration: {error}") from None
    for place in nonfinite_places(content):
        raise DocumentError(f"calibration: {place} is not finite: a calibration file holds finite numbers only")
    return lay_out(msgspec.to_builtins(_convert(content, Document, "calibration", DocumentError))) + "\n"


def schema() -> dict[str, Any]:
    """Describe the file as JSON Schema (2020-12); shipped as ``calibration.schema.json``.

    >>> schema()["$defs"]["Document"]["required"]
    ['flinders', 'schema', 'calibration', 'raw']
    """
    generated = msgspec.json.schema(Document)
    for definition in generated["$defs"].values():
        definition["description"] = definition["description"].partition("\n")[0]
    required = generated["$defs"]["Document"]["required"]
    required.insert(1, "schema")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **generated}


KIND_WORDS: Final = {
    "calibration": "the calibration of a magnetometer",
    "inertial": "the calibration of an accelerometer, not of a magnetometer",
    "tolles-lawson": "the coefficients of an aircraft",
    "truth": "the truth of a simulated recording",
}
"""Kinds of Flinders files by their tag, in words for messages."""


def parse_document(
    text: str | bytes, kind: type[AnyStruct], source: str, *, what: str, refused: type[FlindersError]
) -> AnyStruct:
    """Parse the JSON of a file of one kind; raises `refused` for other content.

    `what` is the kind of file in words, with an article.
    """
    content = _parse(text.encode() if isinstance(text, str) else text, source, what, refused)
    tag = kind.__struct_config__.tag
    found = content.get("flinders") if isinstance(content, dict) else None
    if found != tag and isinstance(found, str) and found in KIND_WORDS:
        raise refused(f"{source} is {KIND_WORDS[found]}: give {what}")
    if found != tag or not isinstance(content, dict):
        raise refused(f'{source} is JSON, but not {what}: it lacks "flinders": "{tag}"')
    _refuse_other_schemas(content, source, refused)
    return _convert(content, kind, source, refused)


def _parse(text: bytes, source: str, what: str, refused: type[FlindersError]) -> object:
    """Parse any JSON; a byte order mark, which some editors add, is removed."""
    text = text.removeprefix(b"\xef\xbb\xbf")
    if not text.strip():
        raise refused(f"{source} is empty: give {what}")
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = readable_message(error)
        hint = "the file was cut short" if "truncated" in reason else f"give {what}"
        raise refused(f"{source} cannot be read as JSON ({reason}): {hint}") from None


def _refuse_other_schemas(content: dict[str, Any], source: str, refused: type[FlindersError]) -> None:
    """Refuse a schema that this release does not read."""
    version = content.get("schema")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise refused(f"{source}: schema is {json.dumps(version)}, need a version from 1 to {VERSION}")
    if version > VERSION:
        provenance = content.get("provenance")
        writer = provenance.get("flinders") if isinstance(provenance, dict) else None
        needed = f"Flinders {writer} or newer" if isinstance(writer, str) else f"a Flinders that reads schema {version}"
        raise refused(f"{source}: written in schema {version}, this Flinders reads up to {VERSION}: install {needed}")


def _convert(content: object, kind: type[AnyStruct], source: str, refused: type[FlindersError]) -> AnyStruct:
    """Convert plain values to a struct; raises `refused` with the reason if the schema does not allow them."""
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise refused(f"{source}: {readable_message(error)}") from None


def readable_message(error: Exception) -> str:
    """Rewrite a message of msgspec: the place of the error first, then the error.

    >>> readable_message(ValueError("Expected `array` of length 3, got 2 - at `$.calibration.offset`"))
    'calibration.offset: expected array of length 3, got 2'
    """
    message, _, place = str(error).replace("JSON is malformed: ", "").partition(" - at `$")
    message = (message[:1].lower() + message[1:]).replace("`", "")
    place = place.rstrip("`").removeprefix(".")
    return f"{place}: {message}" if place else message


def _plain(value: object) -> object:
    """Convert numbers of other libraries, such as NumPy's, to Python's."""
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value)
    raise TypeError(f"{type(value).__name__} cannot be written to a file")


def nonfinite_places(value: object, place: str = "") -> Iterator[str]:
    """Yield the places of numbers that are not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        yield place
    elif isinstance(value, dict):
        for key, member in value.items():
            yield from nonfinite_places(member, f"{place}.{key}".removeprefix("."))
    elif isinstance(value, list | tuple):
        for index, member in enumerate(value):
            yield from nonfinite_places(member, f"{place}[{index}]")
