"""The numbers as plain JSON or YAML: ``corrected = matrix (raw − offset)``, in the calibration's unit.

Raw readings have the recorded axes, corrected ones those of the calibration. ``noise`` is the noise of corrected
readings for a filter, if a fit states it (`flinders.targets._measurement_noise`). The format is for programs that need
nothing else; `flinders` reads its own calibration files, which contain more.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from flinders.core.disturbance import NAMES_BY_KEY, Disturbance, is_column
from flinders.core.units import COUNTS, MICROTESLA
from flinders.errors import DocumentError
from flinders.targets._comments import HASH
from flinders.targets._inertial_forms import PLAIN_JSON, PLAIN_YAML
from flinders.targets._numbers import OWN, Affine, load_object, numbers, parse_list, shift_in_recorded_axes, yaml_text
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

FORMULA: Final = "corrected = matrix (raw - offset)"


def write_json(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write one JSON object."""
    correction, values = _values(calibration, asked)
    return Written(correction.apply, json.dumps(values, indent=1).splitlines(), values)


def write_yaml(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write YAML whose values have the syntax of JSON, which is valid YAML."""
    correction, values = _values(calibration, asked)
    return Written(correction.apply, [f"{name}: {yaml_text(value)}" for name, value in values.items()], values)


def _values(calibration: Calibration, asked: ExportOptions) -> tuple[Affine, dict[str, Any]]:
    """The correction, and all values to write by name."""
    correction = Affine.of(calibration, OWN, who="plain JSON", acts="across")
    return correction, {
        "formula": FORMULA,
        "unit": calibration.unit,
        "field_strength": calibration.field_strength,
        "field_strength_known": calibration.field_strength_known,
        "offset": correction.offset.tolist(),
        "matrix": correction.matrix.tolist(),
        **_disturbances(calibration),
        **({} if asked.noise is None else {"noise": asked.noise.as_dict(calibration.unit)}),
    }


def _disturbances(calibration: Calibration) -> dict[str, Any]:
    """Disturbances of the offset in the recorded axes: ``offset + offset_per_unit (value - reference)``."""
    kinds = [one for one in calibration.disturbances if not is_column(one.name)]
    columns = {one.name: _disturbance(calibration, one) for one in calibration.disturbances if is_column(one.name)}
    drivers = {one.kind.key: _disturbance(calibration, one) for one in kinds}
    return {**drivers, **({"columns": columns} if columns else {})}


def _disturbance(calibration: Calibration, disturbance: Disturbance) -> dict[str, Any]:
    """One disturbance; a column of states has its words too."""
    return {
        "offset_per_unit": shift_in_recorded_axes(calibration, disturbance).tolist(),
        "reference": disturbance.reference,
        "recorded": [disturbance.lowest, disturbance.highest],
        "lag_s": disturbance.lag_s,
        "scale_per_unit": disturbance.gain_per_unit,
        **({"states": list(disturbance.states)} if disturbance.states else {}),
    }


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the plain JSON.

    `strength`, in the unit of the file, takes precedence over the field strength in the file.

    Raises `DocumentError` for any other file, and for missing numbers.
    """
    fields = load_object(content, source)
    unit, rows = fields.get("unit"), fields.get("matrix")
    if unit not in {MICROTESLA, COUNTS}:
        raise DocumentError(f"{source}: unit is {unit!r}: need {MICROTESLA} or {COUNTS}")
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise DocumentError(f"{source}: matrix is not three lists: need three lists of three numbers")
    entries = parse_list({"matrix": [entry for row in rows for entry in row]}, "matrix", 9, source)
    (length,) = numbers(fields, ["field_strength"], source)
    affine = Affine(entries.reshape(3, 3), parse_list(fields, "offset", 3, source), float(length))
    known = fields.get("field_strength_known") is True
    return replace(
        affine.to_calibration(str(unit), known=known, strength=strength),
        disturbances=_read_disturbances(fields, source),
    )


def _read_disturbances(fields: dict[str, Any], source: str) -> tuple[Disturbance, ...]:
    """Disturbances of the offset in a file."""
    columns = fields.get("columns", {})
    if not isinstance(columns, dict):
        raise DocumentError(f"{source}: columns is no object: need one entry for each column, by its name")
    kinds = {name: fields[key] for key, name in NAMES_BY_KEY.items() if key in fields}
    return tuple(_read_disturbance(name, record, source) for name, record in {**kinds, **columns}.items())


def _read_disturbance(name: str, record: object, source: str) -> Disturbance:
    """One disturbance of a file."""
    if not isinstance(record, dict):
        raise DocumentError(f"{source}: {name} is no object: need offset_per_unit, reference, recorded and lag_s")
    reference, lag, gain = numbers(record, ["reference", "lag_s", "scale_per_unit"], source)
    low, high = parse_list(record, "recorded", 2, source)
    per_unit = parse_list(record, "offset_per_unit", 3, source)
    states = tuple(map(str, record.get("states", ())))
    return Disturbance(name, per_unit, float(reference), float(low), float(high), float(lag), float(gain), states)


JSON: Final = Target(
    name="json",
    use="plain JSON",
    group="any program",
    suffix=".json",
    title="plain JSON",
    formula=FORMULA,
    unit=OWN,
    keeps="all",
    storage="decimal, all digits",
    source="this program",
    acts="across",
    follows="all",
    comment=None,
    writes_noise=True,
    inertial=PLAIN_JSON,
    write=write_json,
    reader=TargetReader(rb'(?s)\A\s*\{.*"corrected = matrix \(raw - offset\)"', read, ""),
)
TARGETS: Final = (
    JSON,
    replace(
        JSON,
        name="yaml",
        use="plain YAML",
        suffix=".yaml",
        title="plain YAML",
        comment=HASH,
        inertial=PLAIN_YAML,
        write=write_yaml,
        reader=None,
    ),
)
