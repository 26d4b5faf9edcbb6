"""The text of a calibration file, its JSON Schema, and the ellipsoid of MATLAB's example."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders.core import calibration_file
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import (
    Document,
    FindingRecord,
    Fitted,
    HeadingErrorRecord,
    ProvenanceRecord,
    SourceFile,
)
from flinders.core.json_layout import lay_out
from flinders.core.units import Unit

if TYPE_CHECKING:
    from collections.abc import Callable

SHIPPED = Path(flinders.__file__).with_name("calibration.schema.json")


def full_document() -> Document:
    """A document with every part filled in; all numbers are short in decimal."""
    calibration = Calibration(
        [[1.02, 0.015, -0.03125], [0.015, 0.97, 0.0], [-0.03125, 0.0, 1.0125]],  # type: ignore[arg-type]
        [-12.5, 103.25, 7.0],  # type: ignore[arg-type]
        49.8,
        raw=Unit.of("mG"),
        axes=Axes.of("x,-y,-z"),
        sensor="hull 7",
    )
    root = np.tril(np.arange(1.0, 82.0).reshape(9, 9)) / 512
    covariance = root @ root.T
    fit = Fitted(
        method="auto",
        samples=3000,
        noise=0.5,
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        verdict="limited",
        heading_error_deg=HeadingErrorRecord(rms=0.31, worst=1.25, dip_deg=60.0, target_deg=1.0),
        coverage={"directions": 0.82, "widest_gap_deg": 41.0},
        findings=(
            FindingRecord(
                code="coverage",
                severity="limits",
                number=71.0,
                limit=60.0,
                values={"hole_deg": 71.0, "covered": 0.5, "tilted": ([90.0, 2.5], [180.0, None]), "plane": ""},
                follows_from="noise",
            ),
            FindingRecord(code="scale-unknown", severity="note"),
        ),
    )
    files = (SourceFile(name="tumble µ.csv", sha256="0f" * 32, bytes=123456, rows=3004),)
    provenance = ProvenanceRecord(flinders="0.1.0", date=datetime(2026, 11, 21, 10, tzinfo=UTC), files=files)
    return calibration.to_document(fit=fit, provenance=provenance)


def test_the_text_of_a_full_file_is_as_reviewed(golden: Callable[[str, str], None]) -> None:
    golden("calibration.json", calibration_file.dumps(full_document()))


def test_the_reviewed_file_reads_back_to_the_document_it_was_written_from() -> None:
    assert calibration_file.loads(calibration_file.dumps(full_document())) == full_document()


def test_the_shipped_json_schema_has_not_drifted() -> None:
    """If it has, write `lay_out(calibration_file.schema())` of `flinders.core.json_layout` into the file."""
    assert SHIPPED.read_text("utf-8") == lay_out(calibration_file.schema()) + "\n"


def test_written_documents_satisfy_the_shipped_schema() -> None:
    schema = json.loads(SHIPPED.read_text("utf-8"))
    for written in (full_document(), Calibration.identity().to_document()):
        assert violations(json.loads(calibration_file.dumps(written)), schema, schema) == []


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("calibration", "offset", [1.0, 2.0]),
        ("calibration", "offset", [1.0, 2.0, "3"]),
        ("calibration", "field_strength", -1.0),
        ("calibration", "unit", "gauss"),
        ("calibration", "comment", "mine"),
        ("raw", "axes", "x;y;z"),
        ("fit", "samples", 1.5),
        ("fit", "verdict", "fine"),
        ("fit", "coverage", {"directions": "most"}),
        ("provenance", "files", [{"name": "a.csv"}]),
    ],
)
def test_the_schema_and_the_reader_refuse_the_same(part: str, key: str, value: object) -> None:
    schema = json.loads(SHIPPED.read_text("utf-8"))
    content = json.loads(calibration_file.dumps(full_document()))
    content[part][key] = value
    assert violations(content, schema, schema)
    with pytest.raises(flinders.errors.DocumentError, match=part):
        calibration_file.loads(json.dumps(content))


def test_the_ellipsoid_of_matlab_s_magcal_example_gives_matlab_s_numbers() -> None:
    """Centre (−50, 20, 100) and radii (30, 20, 50): expmfs 31.0723, A = diag(1.03574, 1.55362, 0.62145)."""
    found = Calibration.from_ellipsoid([-50, 20, 100], np.diag([30.0, 20.0, 50.0]), raw=Unit.of("uT"))
    assert found.field_strength == pytest.approx(31.0723, abs=5e-5)
    npt.assert_allclose(found.matrix, np.diag([1.03574, 1.55362, 0.62145]), rtol=0, atol=5e-6)
    assert np.array_equal(found.offset, [-50, 20, 100])


def test_it_prints_on_one_line_with_unit_and_what_is_not_known() -> None:
    known = Calibration.from_ellipsoid([0, 0, -1e-17], 50 * np.eye(3), field_strength=50, raw=Unit.of("uT"))
    assert_sentences(str(known))
    assert "scale unknown" in repr(Calibration.identity())


def violations(value: Any, schema: dict[str, Any], root: dict[str, Any], place: str = "$") -> list[str]:  # noqa: ANN401
    """Check a value against JSON Schema: the keywords that ours uses, and no others."""
    if "$ref" in schema:
        return violations(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root, place)
    if "anyOf" in schema:
        tried = [violations(value, option, root, place) for option in schema["anyOf"]]
        return min(tried, key=len)
    unknown = set(schema) - KEYWORDS
    assert not unknown, f"teach this check about {unknown}"
    if not isinstance(value, KINDS[schema.get("type", "any")]):
        return [place]
    found = [place for keyword, holds in CHECKS.items() if keyword in schema and not holds(value, schema[keyword])]
    return found or members(value, schema, root, place)


def members(value: Any, schema: dict[str, Any], root: dict[str, Any], place: str) -> list[str]:  # noqa: ANN401
    """Check what is inside a list or an object."""
    found: list[str] = []
    if isinstance(value, list):
        first = schema.get("prefixItems", [])
        kinds = [*first, *[schema.get("items", {})] * (len(value) - len(first))]
        for index, member in enumerate(value):
            found += violations(member, kinds[index], root, f"{place}[{index}]")
    if isinstance(value, dict):
        for key, member in value.items():
            kind = schema.get("properties", {}).get(key, schema.get("additionalProperties", True))
            found += [f"{place}.{key}"] if kind is False else violations(member, kind, root, f"{place}.{key}")
    return found


KINDS: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
    "any": (object,),
}
CHECKS: dict[str, Callable[[Any, Any], bool]] = {
    "enum": lambda value, allowed: value in allowed,
    "required": lambda value, keys: all(key in value for key in keys),
    "minimum": lambda value, limit: value >= limit,
    "maximum": lambda value, limit: value <= limit,
    "exclusiveMinimum": lambda value, limit: value > limit,
    "minItems": lambda value, limit: len(value) >= limit,
    "maxItems": lambda value, limit: len(value) <= limit,
    "pattern": lambda value, pattern: re.search(pattern, value) is not None,
    "format": lambda value, name: name == "date-time" and datetime.fromisoformat(value).tzinfo is not None,
}
KEYWORDS = {
    *CHECKS, "type", "$schema", "$defs", "title", "description", "default", "properties", "additionalProperties",
    "items", "prefixItems",
}  # fmt: skip
