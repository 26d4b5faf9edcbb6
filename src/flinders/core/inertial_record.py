"""The calibration file of an accelerometer and a gyro: JSON like that of a magnetometer.

>>> raw = TriadRecord(matrix=((9.8, 0.0, 0.0), (0.0, 9.7, 0.0), (0.0, 0.0, 9.9)), offset=(0.02, 0.0, -0.01), unit="g")
>>> document = InertialDocument(accelerometer=raw)
>>> loads(dumps(document)) == document
True
>>> loads('{"flinders": "calibration", "schema": 1}')
Traceback (most recent call last):
flinders.errors.DocumentError: inertial is the calibration of a magnetometer: give a file of an accelerometer
"""

from __future__ import annotations

import os
from typing import Annotated, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from flinders.core.calibration_file import (
    NotNegative,
    Positive,
    ProvenanceRecord,
    Triple,
    nonfinite_places,
    parse_document,
)
from flinders.core.files import read_bytes
from flinders.core.json_layout import lay_out
from flinders.errors import DocumentError

MAX_BYTES: Final = 2**20
"""Largest file in bytes; a usual one has some hundred."""
FILE_KIND: Final = "a file of an accelerometer"

Rows: TypeAlias = tuple[Triple, Triple, Triple]
InertialUnit: TypeAlias = Literal["m/s2", "g", "mg", "rad/s", "counts"]


class TriadRecord(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """corrected = matrix (raw - offset) of an accelerometer, in m/s², or a gyro, in rad/s."""

    matrix: Rows  #: (3, 3): rows; m/s² or rad/s per `unit`
    matrix_sigma: Rows | None = None  #: (3, 3): 1 σ of each entry
    offset: Triple  #: (3,), in `unit`
    offset_sigma: Triple | None = None  #: (3,), in `unit`: 1 σ
    unit: InertialUnit  #: of raw readings


class TiltErrorRecord(Struct, frozen=True, forbid_unknown_fields=True):
    """Error of the vertical that the accelerometer shows at rest, in degrees."""

    rms: NotNegative  #: degrees: 1 σ, root mean square over all attitudes
    worst: NotNegative  #: degrees: 1 σ at the worst attitude
    bound_95: NotNegative  #: degrees: with a probability of 95 % the errors at all attitudes are smaller


class InertialDocument(
    Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="flinders", tag="inertial"
):
    """A calibration of an accelerometer, a gyro, or both."""

    schema: Literal[1] = 1  #: version of this layout
    accelerometer: TriadRecord | None = None  #: null if it is not calibrated
    gyro: TriadRecord | None = None  #: null if it is not calibrated
    tilt_error_deg: TiltErrorRecord | None = None  #: of the accelerometer, within its own axes
    gravity: Annotated[Positive, Meta(le=10)] = 9.80665  #: m/s²: length of corrected accelerations at rest
    provenance: ProvenanceRecord | None = None  #: release, date and recordings


def read(path: str | os.PathLike[str]) -> InertialDocument:
    """Read a file; raises `DocumentError` if it cannot be opened or parsed."""
    return loads(read_bytes(path, largest=MAX_BYTES, what=FILE_KIND, refused=DocumentError), source=os.fspath(path))


def loads(text: str | bytes, *, source: str = "inertial") -> InertialDocument:
    """Parse the text of a file; `source` names the file in a `DocumentError`."""
    return parse_document(text, InertialDocument, source, what=FILE_KIND, refused=DocumentError)


def dumps(document: InertialDocument) -> str:
    """Write a document as text; raises `DocumentError` for numbers that are not finite."""
    content = msgspec.to_builtins(document)
    for place in nonfinite_places(content):
        raise DocumentError(f"inertial: {place} is not finite: the file of an accelerometer holds finite numbers only")
    return lay_out(content) + "\n"
