"""The calibration file: JSON that a person can read, with a schema version, written whole or not at all.

A file holds the correction, how the raw readings were recorded, and, where a fit made it, how far to
trust it and which recordings it came from. Files of every release stay readable; a file from a newer
schema is refused with the version it needs.

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
"""The newest schema that this release reads, and the one it writes."""

PARAMETERS: Final = (
    "offset_x", "offset_y", "offset_z", "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz",
)  # fmt: skip
"""What the nine rows of an ellipsoid's covariance stand for."""

LARGEST: Final = 16 * 2**20
"""Bytes; a calibration file has some thousand. More is another file, and is not read into memory."""

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
    """What an offset follows: ``offset + offset_per_unit (value - reference)``."""

    offset_per_unit: Triple  #: (3,) in the calibration's unit: for each A, at full throttle, or for each °C
    reference: float = 0.0  #: where the calibration's offset holds
    recorded_range: tuple[float, float]  #: (2,): lowest and highest value that it was found at
    lag_s: float = 0.0  #: s: readings follow so much later
    scale_per_unit: float = 0.0  #: by which share the earth's part of a reading grows with each °C


class ColumnRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A column of the log that an offset follows: ``offset + offset_per_unit (value - reference)``."""

    offset_per_unit: Triple  #: (3,) in the calibration's unit: for each unit of the column, or in the second state
    reference: float = 0.0  #: where the calibration's offset holds
    recorded_range: tuple[float, float]  #: (2,): lowest and highest value that it was found at
    lag_s: float = 0.0  #: s: readings follow so much later
    #: words in the column that stand for 0 and 1; a column of numbers has none
    states: tuple[str, str] | UnsetType = UNSET


class LinearizationRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Terms of axes that are not linear: d - (quadratic + cubic d) d², d = raw - offset, goes into the matrix."""

    quadratic: Triple  #: (3,), one over the calibration's unit
    cubic: Triple  #: (3,), one over the square of it
    #: (3,) in the calibration's unit: d beyond it is corrected by as much as at it
    limit: tuple[Positive, Positive, Positive]


class Correction(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """corrected = matrix (raw - offset), of length field_strength."""

    matrix: tuple[Triple, Triple, Triple]  #: (3, 3): rows; dimensionless
    offset: Triple  #: (3,) in `unit`: what the sensor reads in zero field
    field_strength: Positive  #: in `unit`
    #: it was given; otherwise the matrix has determinant 1 and this is the radius that results
    field_strength_known: bool = False
    unit: Literal["uT", "counts"]  #: ``uT``, or ``counts`` where the recording had no known unit
    #: ``symmetric``: not seen, set by convention; ``estimated`` by a fit that sees it; ``composed`` of others
    rotation: Rotation = "symmetric"
    #: name to DisturbanceRecord: what the offset follows: ``current_A``, ``throttle`` (0 to 1), ``temperature_C``; of
    #: motor 1 by itself ``current1_A``, ``throttle1``
    disturbances: dict[DisturbanceKey, DisturbanceRecord] | UnsetType = UNSET
    #: name to ColumnRecord: columns that the offset follows, by their names in the log, such as ``wheel_speed_rpm``
    columns: dict[ColumnName, ColumnRecord] | UnsetType = UNSET
    linearization: LinearizationRecord | UnsetType = UNSET  #: where axes are linearized before the matrix


class Recorded(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the raw readings were recorded."""

    unit: Literal["uT", "mG", "G", "nT", "mT", "T", "counts"]  #: the recording's own unit
    scale: Positive = 1.0  #: what one of it is in the calibration's unit
    #: where each axis used comes from, such as ``x,-y,-z``
    axes: Annotated[str, Meta(pattern="^-?[xyz],-?[xyz],-?[xyz]$")] = "x,y,z"
    sensor: str | None = None  #: its name or serial number
    frame: str = "sensor"  #: what the recorded axes are: ``sensor``, its own, or ``vehicle``, after the mounting


class HeadingErrorRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The heading error to expect, in degrees."""

    rms: NotNegative  #: degrees: 1 σ over all headings
    worst: NotNegative  #: degrees: 1 σ at the worst one
    bound_95: NotNegative | None = None  #: degrees: that all stay within with a probability of 95 %
    dip_deg: Annotated[float, Meta(ge=-90, le=90)] | None = None  #: dip of the field it holds for
    dip_assumed: bool = False  #: nobody said where the readings were taken, and the dip is a guess
    target_deg: Positive | None = None  #: what was asked for
    structure_deg: NotNegative = 0.0  #: part of `rms` and `worst` that belongs to the direction of the field


class FindingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something to know about a fit: its number, the limit it is compared with, and what its sentence is made from."""

    code: str  #: stable name, see the table of findings
    severity: str  #: ``note``, ``limits`` or ``refuses``
    number: float | None = None  #: what was found; its meaning and unit belong to the code
    limit: float | None = None  #: what it was compared with
    #: numbers and short names, by the names that the sentence of the code has for them; lists where several are listed
    values: dict[str, float | str | tuple[Any, ...] | None] = {}
    follows_from: str | None = None  #: code of the finding that it follows from


class AidingRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What the fit found of the instruments beside the magnetometer."""

    #: (3, 3), rad²: of the rotation from the magnetometer's axes to those of the body, about the axes of the body
    rotation_covariance: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    acceleration_bias: Triple | UnsetType = UNSET  #: (3,), m/s²: what the accelerometer reads too much
    acceleration_bias_sigma: Triple | UnsetType = UNSET  #: (3,), m/s²: 1 σ of that
    #: (3, 3): the specific force is this times what the accelerometer reads, less its bias
    acceleration_matrix: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    acceleration_matrix_sigma: tuple[Triple, Triple, Triple] | UnsetType = UNSET  #: (3, 3): 1 σ of each entry
    gravity_reading: float | UnsetType = UNSET  #: what the accelerometer's numbers are long at rest, in their own unit
    #: (3,), degrees: of the vertical that the corrected accelerometer shows at rest: 1 σ over all attitudes, 1 σ at the
    #: worst, and what all stay within with a probability of 95 %
    tilt_error_deg: Triple | UnsetType = UNSET
    gyro_bias: Triple | UnsetType = UNSET  #: (3,), rad/s: what the gyro reads at rest
    gyro_bias_sigma: Triple | UnsetType = UNSET  #: (3,), rad/s: 1 σ of that
    #: (3, 3): the rate is this times what the gyro reads, less its bias
    gyro_matrix: tuple[Triple, Triple, Triple] | UnsetType = UNSET
    gyro_matrix_sigma: tuple[Triple, Triple, Triple] | UnsetType = UNSET  #: (3, 3): 1 σ of each entry
    dip_deg: float | UnsetType = UNSET  #: dip of the field against the vertical that was recorded
    dip_sigma_deg: NotNegative | UnsetType = UNSET  #: 1 σ of the dip


def aiding_record(**columns: Floats | float | None) -> AidingRecord | UnsetType:
    """Keep what was found, by the names of `AidingRecord`; nothing where nothing was, or no number came out."""
    given = {name: value for name, value in columns.items() if value is not None}
    known = {name: value if isinstance(value, float) else value.tolist() for name, value in given.items()}
    finite = {name: value for name, value in known.items() if not any(gaps(value))}
    return msgspec.convert(finite, AidingRecord) if finite else UNSET


class WalkRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How fast the offset of this unit walks, by its history."""

    rate: Positive  #: in the calibration's unit: by which it moves in an hour along each axis, 1 σ; it grows with √t
    low: Positive  #: of the 95 % interval
    high: Positive  #: of that


class GoodUntilRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How long the claim of the worst heading is good; made anew of claim and walk when a file is read."""

    #: until the offset has walked so far that the claim reaches its target, by the middle of the rate; null of a claim
    #: that is beyond it
    target_hours: Positive | None = None
    doubled_hours: Positive  #: until the claim has doubled, by the middle of the rate
    doubled_hours_low: Positive  #: the same by the fast end of what the rate may be, 95 %
    doubled_hours_high: Positive  #: by the slow end
    #: when the claim has doubled, from when the recording was made; null where the file says no time
    doubled_date: datetime | None = None
    by: Literal["history", "prior"]  #: walk of this unit, or what is usual of any
    temperature_change_kelvin: Positive | None = None  #: K: change of temperature that doubles the claim, by the middle
    temperature_change_low_kelvin: Positive | None = None  #: K: by the largest coefficient of data sheets
    temperature_change_high_kelvin: Positive | None = None  #: K: by the smallest
    #: ``followed``: from the reference of a fit that follows the temperature; ``prior``: by data sheets
    temperature_by: Literal["followed", "prior"]


class Fitted(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the calibration was found, and how far to trust it."""

    method: str  #: what was run in the end, as `likelihood`
    samples: Count  #: readings used
    noise: NotNegative | None = None  #: in the calibration's unit: standard deviation of one axis of one reading
    #: (K,): what the rows of `covariance` stand for, as ``offset_x``, ``shape_xy``
    covariance_of: tuple[str, ...] = PARAMETERS
    #: (K, K) or None: symmetric, in squares and products of the calibration's unit
    covariance: tuple[tuple[float, ...], ...] | None = None
    #: ``good``, ``limited`` or ``refused``; None where it was not judged
    verdict: Literal["good", "limited", "refused"] | None = None
    heading_error_deg: HeadingErrorRecord | None = None  #: to expect of a level vehicle
    good_until: GoodUntilRecord | UnsetType = UNSET  #: when that reaches the target, and when it has doubled
    walk: WalkRecord | UnsetType = UNSET  #: of the offset, where a history of this unit was given
    coverage: dict[str, float] = {}  #: directions recorded: the keys of `coverage` of a fit
    findings: tuple[FindingRecord, ...] = ()  #: what to know about it, the most severe first
    #: what a verdict rests on: ``same-soft-iron``, ``unchanged-body``, ``uniform-field``, ``constant-iron``
    conditions: (
        tuple[Literal["same-soft-iron", "unchanged-body", "uniform-field", "constant-iron"], ...] | UnsetType
    ) = UNSET
    #: ``xy``, ``yz`` or ``zx``: plane of the one turn that the fit rests on
    plane: Literal["xy", "yz", "zx"] | UnsetType = UNSET
    #: at such a turn, whether z points down; None where nothing shows it
    z_down: bool | UnsetType | None = UNSET
    aiding: AidingRecord | UnsetType = UNSET  #: what gyro, accelerometer or attitude told

    def __post_init__(self) -> None:
        """Refuse a covariance that does not belong to its names; called when a file is read."""
        size = len(self.covariance_of)
        rows = self.covariance
        if rows is None:
            return
        if len(rows) != size or any(len(row) != size for row in rows):
            raise ValueError(f"`covariance` needs {size} rows of {size}, as `covariance_of` has {size} names")
        if any(rows[i][i] < 0 for i in range(size)):
            raise ValueError("`covariance` has a negative variance on its diagonal")


class ColumnsRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Which columns of a table were named to be the magnetometer's, and which tables have them in the same place."""

    field: tuple[str, ...]  #: x, y and z as they were asked for: names, or numbers from 1
    width: Annotated[int, Meta(ge=1)]  #: columns of a line; a table of another number has another form
    names: tuple[str, ...] = ()  #: its header, which one of the same form has too; none where it has no header
    increasing: tuple[int, ...] = ()  #: without a header: numbers of the columns that only rise, as a clock does


class SourceFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """One recording that a calibration came from."""

    name: str  #: of the file
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]  #: digest of its bytes
    bytes: Count  #: its size
    rows: Count  #: its readings
    #: the calibration that was in force on board was left on its readings: this one comes on top of that
    as_logged: bool = False
    autopilot: Literal["ardupilot", "px4"] | None = None  #: whose compass it was
    compass: Annotated[int, Meta(ge=0, le=3)] | None = None  #: its number there: ArduPilot's 1 to 3, PX4's 0 to 3
    device_id: Count | None = None  #: its device id there
    #: roll, pitch and yaw in degrees: how it was mounted then, vehicle = R_z(yaw) R_y(pitch) R_x(roll) sensor
    mounting: Triple | None = None
    columns: ColumnsRecord | None = None  #: which of a table were asked for; others of its form are read so too


class ProvenanceRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which release made a calibration, when, and from which recordings."""

    flinders: str  #: version of the release
    date: Annotated[datetime, Meta(tz=True)]  #: date and time, with a time zone
    files: tuple[SourceFile, ...] = ()  #: the recordings
    #: when the newest recording was made, by its own clock; left out where that does not count from 1970
    recorded: Annotated[datetime, Meta(tz=True)] | UnsetType = UNSET


class SurveyRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a survey instrument has beside its magnetometer: both sensors correct into axes of the instrument."""

    accelerometer: Correction  #: of readings that point down, in their own unit, called counts
    #: where each of its axes comes from, such as ``x,-y,-z``
    acceleration_axes: Annotated[str, Meta(pattern="^-?[xyz],-?[xyz],-?[xyz]$")] = "x,y,z"
    pointing: Literal["x", "y", "z"] = "x"  #: axis of the laser
    #: q, one over the unit of the accelerometer, which corrects g + q g² of a reading g
    quadratic: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Document(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="calibration"):
    """A calibration file of Flinders."""

    schema: Literal[1] = 1  #: version of this layout
    calibration: Correction  #: the correction
    raw: Recorded  #: how the readings that it corrects are recorded
    fit: Fitted | None = None  #: how it was found, and how far to trust it; null where nothing is known
    provenance: ProvenanceRecord | None = None  #: which release made it, when, and from what
    survey: SurveyRecord | UnsetType = UNSET  #: what a survey instrument has besides


def read(path: str | os.PathLike[str]) -> Document:
    """Read a calibration file; one that cannot be opened or understood raises `DocumentError`."""
    text = read_bytes(path, largest=LARGEST, what="calibration file", refused=DocumentError)
    return loads(text, source=os.fspath(path))


def loads(text: str | bytes, *, source: str = "calibration") -> Document:
    """Understand the text of a calibration file; `source` names it in the `DocumentError` for what is wrong."""
    return understood(text, Document, source, what="a calibration file", refused=DocumentError)


def write(document: Document, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a calibration file, whole or not at all; raises as `dumps` and `flinders.core.files.write_text`."""
    write_text(dumps(document), path, force=force)


def dumps(document: Document) -> str:
    """Lay a document out as text: a matrix has a line for each row; numbers are read back to the bit.

    Values that the schema does not allow, NaN and infinity among them, raise `DocumentError`.
    """
    try:
        content = msgspec.to_builtins(document, enc_hook=_plain)
    except TypeError as error:
        raise DocumentError(f"calibration: {error}") from None
    for place in gaps(content):
        raise DocumentError(f"calibration: {place} is not finite: a calibration file holds finite numbers only")
    return lay_out(msgspec.to_builtins(_checked(content, Document, "calibration", DocumentError))) + "\n"


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


OTHERS: Final = {
    "calibration": "the calibration of a magnetometer",
    "inertial": "the calibration of an accelerometer, not of a magnetometer",
    "tolles-lawson": "the coefficients of an aircraft",
    "truth": "the truth of a simulated recording",
}
"""What files of Flinders are, by their tag, for people."""


def understood(
    text: str | bytes, kind: type[AnyStruct], source: str, *, what: str, refused: type[FlindersError]
) -> AnyStruct:
    """Read a tagged struct of a schema that this release knows, else raise `refused`; `what` has an article."""
    content = _parse(text.encode() if isinstance(text, str) else text, source, what, refused)
    tag = kind.__struct_config__.tag
    found = content.get("flinders") if isinstance(content, dict) else None
    if found != tag and isinstance(found, str) and found in OTHERS:
        raise refused(f"{source}: is {OTHERS[found]}: need {what}")
    if found != tag or not isinstance(content, dict):
        raise refused(f'{source}: is JSON, but not {what}: lacks "flinders": "{tag}"')
    _refuse_other_schemas(content, source, refused)
    return _checked(content, kind, source, refused)


def _parse(text: bytes, source: str, what: str, refused: type[FlindersError]) -> object:
    """Read any JSON; a byte order mark, which some editors add, is left out."""
    text = text.removeprefix(b"\xef\xbb\xbf")
    if not text.strip():
        raise refused(f"{source}: is empty: need {what}")
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = in_words(error)
        hint = "the file was cut short" if "truncated" in reason else f"need {what}"
        raise refused(f"{source}: cannot be read as JSON ({reason}): {hint}") from None


def _refuse_other_schemas(content: dict[str, Any], source: str, refused: type[FlindersError]) -> None:
    """Refuse a schema that this release does not read."""
    version = content.get("schema")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise refused(f"{source}: schema is {json.dumps(version)}, need a version from 1 to {VERSION}")
    if version > VERSION:
        provenance = content.get("provenance")
        writer = provenance.get("flinders") if isinstance(provenance, dict) else None
        needed = f"Flinders {writer} or newer" if isinstance(writer, str) else f"a Flinders that knows schema {version}"
        raise refused(f"{source}: written in schema {version}, this Flinders reads up to {VERSION}: install {needed}")


def _checked(content: object, kind: type[AnyStruct], source: str, refused: type[FlindersError]) -> AnyStruct:
    """Turn plain values into a struct, or say what the schema does not allow."""
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise refused(f"{source}: {in_words(error)}") from None


def in_words(error: Exception) -> str:
    """Put msgspec's message the other way round: the place first, then what is wrong there.

    >>> in_words(ValueError("Expected `array` of length 3, got 2 - at `$.calibration.offset`"))
    'calibration.offset: expected array of length 3, got 2'
    """
    message, _, place = str(error).replace("JSON is malformed: ", "").partition(" - at `$")
    message = (message[:1].lower() + message[1:]).replace("`", "")
    place = place.rstrip("`").removeprefix(".")
    return f"{place}: {message}" if place else message


def _plain(value: object) -> object:
    """Turn other libraries' numbers, such as NumPy's, into Python's."""
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value)
    raise TypeError(f"{type(value).__name__} cannot be written to a file")


def gaps(value: object, place: str = "") -> Iterator[str]:
    """Yield the places of numbers that are not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        yield place
    elif isinstance(value, dict):
        for key, member in value.items():
            yield from gaps(member, f"{place}.{key}".removeprefix("."))
    elif isinstance(value, list | tuple):
        for index, member in enumerate(value):
            yield from gaps(member, f"{place}[{index}]")
