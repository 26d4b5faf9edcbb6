"""JSON in other arrangements than a record each: lists by key, names beside rows, several readings to a record."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

ROWS: Final = 120
STEP_S: Final = 0.2
TIMES: Final = (STEP_S * np.arange(ROWS)).round(3).tolist()


def turned(offset: tuple[float, float, float] = (12.0, -30.0, 5.0)) -> Floats:
    """Readings of 45 µT while a sensor is turned smoothly."""
    angle = 0.35 * np.arange(ROWS)
    height = np.sin(0.11 * angle + 1.2)
    level = np.sqrt(1 - height**2)
    found: Floats = (45.0 * np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=1) + offset).round(3)
    return found


FIELD: Final = turned()
OTHER: Final = turned((-20.0, 14.0, -31.0))
COLUMNS: Final = dict(zip(("t", "mx", "my", "mz"), [TIMES, *FIELD.T.tolist()], strict=True))
TABLE: Final = [[time, *row] for time, row in zip(TIMES, FIELD.tolist(), strict=True)]
PARTS: Final = [dict(zip("xyz", row, strict=True)) for row in FIELD.tolist()]


def batches(size: int, record: Callable[[float, slice], Any]) -> str:
    """JSON lines of so many readings each."""
    return "".join(f"{json.dumps(record(TIMES[at], slice(at, at + size)))}\n" for at in range(0, ROWS, size))


def by_row(columns: dict[str, list[float]], keys: list[str]) -> str:
    return json.dumps({name: dict(zip(keys, each, strict=True)) for name, each in columns.items()})


ARRANGED: Final = {
    "lists by key": json.dumps(COLUMNS),
    "lists by key, in lines of their own": json.dumps(COLUMNS, indent=1),
    "lists in an object, beside notes": json.dumps(
        {"device": "a", "axes": ["x", "y", "z"], "time": TIMES, "mag": dict(zip("xyz", FIELD.T.tolist(), strict=True))}
    ),
    "a list of times and one of vectors": json.dumps({"time": TIMES, "magnetometer": FIELD.tolist()}),
    "pandas by column": by_row(COLUMNS, list(map(str, range(ROWS)))),
    "pandas by column, at times": by_row(
        {name: COLUMNS[name] for name in ("mx", "my", "mz")}, [str(1795322527813 + 200 * n) for n in range(ROWS)]
    ),
    "pandas by row": json.dumps({str(n): dict(zip(COLUMNS, row, strict=True)) for n, row in enumerate(TABLE)}),
    "pandas split": json.dumps({"columns": list(COLUMNS), "index": list(range(ROWS)), "data": TABLE}),
    "names and rows of an answer": json.dumps({"results": [{"series": [{"columns": list(COLUMNS), "values": TABLE}]}]}),
    "names with units": json.dumps(
        {
            "payload": {
                "interval_ms": 200,
                "sensors": [{"name": f"mag{axis}", "units": "uT"} for axis in "XYZ"],
                "values": FIELD.tolist(),
            }
        }
    ),
    "a list in an object": json.dumps({"device": "a", "readings": [{"t": t, "mag": row} for t, *row in TABLE]}),
    "objects one after another": "".join(
        json.dumps({"t": time, "mag": part}, indent=2) + "\n" for time, part in zip(TIMES, PARTS, strict=True)
    ),
    "objects one after another, the last cut short": "".join(
        json.dumps({"t": time, "QMC5883L Magnetometer": {"values": row}}, indent="\t") + "\r\n" for time, *row in TABLE
    )
    + '{\r\n\t"t": 24.0,\r\n',
    "objects in a record": batches(4, lambda time, some: {"Magn": {"Timestamp": time, "ArrayMagn": PARTS[some]}}),
    "vectors in a record": batches(3, lambda time, some: {"mag": FIELD[some].tolist(), "time": time}),
    "lists by key in a record": batches(
        6, lambda time, some: {"t": time, **{name: COLUMNS[name][some] for name in ("mx", "my", "mz")}}
    ),
    "records of several in a list": json.dumps(
        [{"t": TIMES[at], "mag": FIELD[at : at + 5].tolist()} for at in range(0, ROWS, 5)]
    ),
}

SENSORS: Final[dict[str, Callable[[list[float], list[float]], dict[str, Any]]]] = {
    "objects": lambda one, other: {"mag": [dict(zip("xyz", each, strict=True)) for each in (one, other)]},
    "vectors": lambda one, other: {"mag": [one, other]},
    "by key": lambda one, other: {f"mag_{axis}": [one[at], other[at]] for at, axis in enumerate("xyz")},
}  # fmt: skip


def of_sensors(form: str) -> str:
    """JSON lines of two sensors in each record."""
    rows = zip(TIMES, FIELD.tolist(), OTHER.tolist(), strict=True)
    return "".join(json.dumps({"t": time, **SENSORS[form](one, other)}) + "\n" for time, one, other in rows)


@pytest.mark.parametrize("name", ARRANGED)
def test_every_reading_of_an_arrangement_is_read_in_order(name: str, tmp_path: Path) -> None:
    path = tmp_path / "tumble.json"
    path.write_text(ARRANGED[name], newline="")
    samples = flinders.read(path)
    np.testing.assert_allclose(samples.field, FIELD, rtol=1e-12)
    assert samples.time is not None
    np.testing.assert_allclose(samples.time - samples.time[0], TIMES, atol=1e-6)


def test_an_object_that_is_cut_short_is_told(tmp_path: Path) -> None:
    path = tmp_path / "tumble.json"
    path.write_text(ARRANGED["objects one after another, the last cut short"], newline="")
    assert [entry.rows for entry in flinders.read(path).skipped] == [1]


@pytest.mark.parametrize("form", SENSORS)
def test_two_sensors_in_a_record_stay_two(form: str, tmp_path: Path) -> None:
    path = tmp_path / "two.json"
    path.write_text(of_sensors(form))
    for number, field in (("1", FIELD), ("2", OTHER)):
        np.testing.assert_allclose(flinders.read(path, sensor=number).field, field, rtol=1e-12)
    with assert_raises(UsageError):
        flinders.read(path, sensor="3")


@pytest.mark.parametrize("text", ['{"a": [1, 2], "note": "b"}', '{"mag": [[1, 2, 3]], "id": 7}', '{\n"mag": "none"\n}'])
def test_an_object_without_readings_is_refused_with_its_keys(text: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(text)
    with assert_raises(UnreadableInput):
        flinders.read(path)
