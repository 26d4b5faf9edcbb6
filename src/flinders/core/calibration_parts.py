"""Conversion of a calibration's parts to and from its file: disturbances, linearization, the recorded unit.

>>> from flinders.core.calibration_file import Correction
>>> correction = Correction(offset=(0, 0, 0), matrix=((1, 0, 0), (0, 1, 0), (0, 0, 1)), field_strength=50.0, unit="uT")
>>> read_disturbances(correction), read_linearization(correction)
((), None)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import UNSET

from flinders.core.axes import Axes
from flinders.core.calibration_file import ColumnRecord, Correction, DisturbanceRecord, Recorded
from flinders.core.disturbance import NAMES_BY_KEY, Disturbance, is_column, reference_hint
from flinders.core.linearization import Linearization
from flinders.core.units import COUNTS, MICROTESLA, Unit
from flinders.errors import UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable


def disturbance_records(disturbances: Iterable[Disturbance]) -> dict[str, dict[str, DisturbanceRecord | ColumnRecord]]:
    """Make the records of disturbances: ``disturbances`` by their keys, ``columns`` by their names in the log.

    >>> records = disturbance_records([Disturbance("current", [1, 0, 0]), Disturbance("current_A", [0, 1, 0])])
    >>> {kind: list(group) for kind, group in records.items()}
    {'disturbances': ['current_A'], 'columns': ['current_A']}
    """
    records: dict[str, dict[str, DisturbanceRecord | ColumnRecord]] = {"disturbances": {}, "columns": {}}
    for one in disturbances:
        if is_column(one.name):
            records["columns"][one.name] = _column_record(one)
        else:
            records["disturbances"][one.kind.key] = _disturbance_record(one)
    return records


def _column_record(disturbance: Disturbance) -> ColumnRecord:
    """Make the record of a disturbance that is a column of the log."""
    x, y, z = disturbance.per_unit.tolist()
    return ColumnRecord(
        offset_per_unit=(x, y, z),
        reference=disturbance.reference,
        recorded_range=(disturbance.lowest, disturbance.highest),
        lag_s=disturbance.lag_s,
        states=(disturbance.states[0], disturbance.states[1]) if disturbance.states else UNSET,
    )


def _disturbance_record(disturbance: Disturbance) -> DisturbanceRecord:
    """Make the record of a current, a throttle or a temperature."""
    x, y, z = disturbance.per_unit.tolist()
    return DisturbanceRecord(
        offset_per_unit=(x, y, z),
        reference=disturbance.reference,
        recorded_range=(disturbance.lowest, disturbance.highest),
        lag_s=disturbance.lag_s,
        scale_per_unit=disturbance.gain_per_unit,
    )


def read_disturbances(correction: Correction) -> tuple[Disturbance, ...]:
    """Disturbances of a file.

    Raises `UsageError` for a column of the log that is called like a kind of disturbance, such as ``current``.
    """
    of_kinds = (
        Disturbance(
            NAMES_BY_KEY[key],
            np.array(one.offset_per_unit),
            one.reference,
            *one.recorded_range,
            one.lag_s,
            one.scale_per_unit,
        )
        for key, one in (correction.disturbances or {}).items()
    )
    columns = (correction.columns or {}).items()
    for name, _ in columns:
        if not is_column(name):
            raise UsageError(f"columns has {name!r}, which is a kind of disturbance, not a column: rename the column")
    of_columns = (
        Disturbance(
            name, np.array(one.offset_per_unit), one.reference, *one.recorded_range, one.lag_s, states=one.states or ()
        )
        for name, one in columns
    )
    return (*of_kinds, *of_columns)


def read_linearization(correction: Correction) -> Linearization | None:
    """Linearization of a file, or None."""
    terms = correction.linearization
    return Linearization(*map(np.array, (terms.quadratic, terms.cubic, terms.limit))) if terms else None


def calibration_arguments(correction: Correction, raw: Recorded) -> dict[str, Any]:
    """Arguments of `Calibration` from the records of a file.

    Raises `UnitError`, `AxesError` or `UsageError` for parts that contradict each other.
    """
    return {
        "matrix": np.array(correction.matrix),
        "offset": np.array(correction.offset),
        "field_strength": correction.field_strength,
        "field_strength_known": correction.field_strength_known,
        "rotation": correction.rotation,
        "raw": recorded_unit(raw, correction.unit),
        "axes": Axes.of(raw.axes),
        "sensor": raw.sensor,
        "frame": raw.frame,
        "disturbances": read_disturbances(correction),
        "linearization": read_linearization(correction),
    }


def refuse_disturbances(disturbances: tuple[Disturbance, ...], what: str) -> None:
    """Raise `UsageError` if there are any disturbances; `what` is the operation that needs a fixed offset."""
    if disturbances:
        names = " and ".join(disturbance.name for disturbance in disturbances)
        raise UsageError(
            f"a calibration that depends on {names} cannot {what}: take the calibration at fixed values first",
            hint=reference_hint(disturbances),
        )


def refuse_linearization(linearization: Linearization | None, what: str) -> None:
    """Raise `UsageError` if axes are linearized; `what` is the operation that needs linear axes."""
    if linearization is not None:
        raise UsageError(
            f"a calibration that linearizes its axes cannot {what}: calibrate without linearization",
            hint={"linearize": False},
        )


def recorded_unit(raw: Recorded, inside: str) -> Unit:
    """Unit of the recording; raises `UnitError` if it contradicts `inside`, the unit of the calibration."""
    unit = Unit.of(raw.unit, raw.scale if (raw.unit, inside) == (COUNTS, MICROTESLA) else None)
    if unit != Unit(raw.unit, raw.scale, inside):
        raise UnitError(
            f"raw.unit {raw.unit!r} with scale {raw.scale:g} and calibration.unit {inside!r} contradict each other: "
            f"one {raw.unit} is {unit.scale:g} {unit.inside}"
        )
    return unit
