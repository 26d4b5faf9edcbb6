"""Several devices in one table, told apart by a column: one magnetometer for each."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._devices import names_device

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from flinders.arrays import Floats

OFFSETS: Final = np.array([[12.0, -30.0, 5.0], [12.8, -31.0, 4.2], [11.2, -29.4, 6.1]])
"""µT, of the devices; those of another one are 2° to 3° off."""
ROWS: Final = 300

WORDS: Final[dict[str, Sequence[str]]] = {
    "numbers": ["0", "1", "2"],
    "far numbers": ["1007", "1012", "40213"],
    "whole numbers with decimals": ["1.0", "2.0", "3.0"],
    "words": ["bow", "mast", "stern"],
    "MAC addresses": ["b4:e6:2d:00:11:01", "b4:e6:2d:00:11:02", "b4:e6:2d:00:11:a3"],
    "IP addresses": ["192.168.4.2", "192.168.4.3", "192.168.4.17"],
    "words of a bus": ["0x0C", "0x0D", "0x1E"],
    "names with numbers": ["node-1", "node-2", "node-10"],
}
ORDERS: Final[dict[str, Callable[[int], int]]] = {
    "in turn": lambda row: row % 3,
    "in any order": lambda row: (7 * row + row // 3) % 3,
    "one after the other": lambda row: row // ROWS,
    "the last first": lambda row: 2 - row // ROWS,
}


def field_of(devices: Floats) -> Floats:
    """Readings of 45 µT, and 0.1 µT of noise, each by its device."""
    noise = np.random.default_rng(5)
    directions = noise.normal(size=(len(devices), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found: Floats = (45.0 * directions + OFFSETS[devices] + 0.1 * noise.normal(size=directions.shape)).round(3)
    return found


def devices(order: str = "in turn") -> Floats:
    return np.array(list(map(ORDERS[order], range(3 * ROWS))))


def csv(path: Path, name: str, words: Sequence[str], *, order: str = "in turn", is_last: bool = False) -> Path:
    """A table of readings with the device of each."""
    chosen = devices(order)
    readings = [",".join(map(str, row)) for row in field_of(chosen).tolist()]
    own = [words[device] for device in chosen]
    pairs = zip(readings, own, strict=True) if is_last else zip(own, readings, strict=True)
    header = ("mag_x_uT,mag_y_uT,mag_z_uT", name) if is_last else (name, "mag_x_uT,mag_y_uT,mag_z_uT")
    path.write_text("\n".join([",".join(header), *map(",".join, pairs), ""]))
    return path


def offsets(source: Any) -> Floats:  # noqa: ANN401 - whatever is read
    return np.array([flinders.fit(source, sensor=str(number)).calibration.offset for number in (1, 2, 3)])


@pytest.mark.parametrize(("kind", "place", "order"), daily(list(product(WORDS, ["first", "last"], ORDERS)), 3))
def test_each_device_is_a_magnetometer(kind: str, place: str, order: str, tmp_path: Path) -> None:
    """Each kind of words, and each order in each place, in every run: three and eight do not divide one another."""
    words = WORDS[kind]
    path = csv(tmp_path / "devices.csv", "node", words, order=order, is_last=place == "last")
    np.testing.assert_allclose(offsets(path), OFFSETS, atol=0.05)
    log = flinders.open_log(path)
    assert [instrument.name for instrument in log.instruments] == [f"node={word.removesuffix('.0')}" for word in words]
    assert [sum(map(len, instrument.blocks())) for instrument in log.instruments] == [ROWS] * 3


NAMES: Final = (
    "id", "ID", "node", "NodeID", "node_id", "address", "addr", "i2c_addr", "device", "dev", "deviceId", "Device Name",
    "mac", "MAC address", "serial", "serial_no", "SN", "sensor", "sensor_id", "sensorid", "board", "module", "imei",
    "dev_eui", "unit", "uuid", "host", "ip", "robot", "imu", "instance", "port", "chip id", "magnetometer",
)  # fmt: skip
OTHERS: Final = (
    "accuracy", "quality", "trial", "trial_id", "session", "session id", "run", "label", "label_id", "class", "state",
    "device_status", "mode", "seq", "sequence_id", "packet id", "sample", "count", "frame_id", "step", "lap", "event",
    "subject_id", "activity", "position", "type", "mag_x", "gyro_z", "time", "temperature", "sensor_temp", "current_A",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_name_tells_of_devices(name: str) -> None:
    assert names_device(name)


@pytest.mark.parametrize("name", OTHERS)
def test_a_name_of_a_label_or_a_quality_does_not(name: str) -> None:
    assert not names_device(name)


@pytest.mark.parametrize("name", OTHERS[:20])
def test_accuracy_quality_and_trial_of_one_device_are_no_devices(name: str, tmp_path: Path) -> None:
    path = csv(tmp_path / "one.csv", name, ["1", "2", "3"], order="one after the other")
    assert len(flinders.read(path)) == 3 * ROWS
    assert not flinders.open_recording(path).columns.magnetometers  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "ids",
    [
        ["7"] * 900,
        [str(row) for row in range(900)],
        [str(row // 5) for row in range(900)],
        [f"{row % 3}.5" for row in range(900)],
        ["7"] * 898 + ["0", "7"],
        [""] * 900,
    ],
    ids=["one", "a counter", "a slow counter", "measured values", "a slip", "blank"],
)
def test_an_id_that_tells_nothing_apart_is_left_alone(ids: list[str], tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    rows = [f"{own},{x},{y},{z}" for own, (x, y, z) in zip(ids, field_of(devices()).tolist(), strict=True)]
    path.write_text("\n".join(["id,mx,my,mz", *rows]))
    assert len(flinders.read(path)) == 900


@pytest.mark.parametrize("form", ["lines", "document", "nested"])
def test_records_of_json_say_their_device(form: str, tmp_path: Path) -> None:
    records = [
        {"device": {"mac": WORDS["MAC addresses"][device]}, "mag": dict(zip("xyz", row, strict=True))}
        if form == "nested"
        else {"mag_x": row[0], "mag_y": row[1], "mag_z": row[2], "node": int(device)}
        for device, row in zip(devices("in any order"), field_of(devices("in any order")).tolist(), strict=True)
    ]
    path = tmp_path / "devices.json"
    path.write_text(json.dumps(records) if form == "document" else "\n".join(map(json.dumps, records)))
    np.testing.assert_allclose(offsets(path), OFFSETS, atol=0.05)


@pytest.mark.parametrize("words", [WORDS["numbers"], WORDS["words"]], ids=["numbers", "words"])
@pytest.mark.parametrize("kind", ["frame", "parquet", "feather", "category"])
def test_other_tables_say_their_device(kind: str, words: Sequence[str], tmp_path: Path) -> None:
    pandas, pytest_parquet = pytest.importorskip("pandas"), pytest.importorskip("pyarrow.parquet")
    own = [int(words[device]) if words[0].isdecimal() else words[device] for device in devices()]
    frame = pandas.DataFrame(field_of(devices()), columns=["mag_x_uT", "mag_y_uT", "mag_z_uT"]).assign(device=own)
    source: Any = tmp_path / f"devices.{kind}"
    if kind == "parquet":
        pytest_parquet.write_table(pytest.importorskip("pyarrow").Table.from_pandas(frame), source)
    elif kind == "feather":
        frame.to_feather(source)
    else:
        source = frame.astype({"device": "category"}) if kind == "category" else frame
    np.testing.assert_allclose(offsets(source), OFFSETS, atol=0.05)


def test_columns_that_tell_the_same_apart_count_once_and_others_together(tmp_path: Path) -> None:
    path = csv(tmp_path / "same.csv", "id,mac", ["0,b4:01", "1,b4:02", "2,b4:03"])
    assert [each.name for each in flinders.open_log(path).instruments] == ["id=0", "id=1", "id=2"]
    path = csv(tmp_path / "both.csv", "board,sensor", ["1,1", "1,2", "2,1"])
    names = ["board=1 sensor=1", "board=1 sensor=2", "board=2 sensor=1"]
    assert [each.name for each in flinders.open_log(path).instruments] == names


def test_each_of_two_magnetometers_of_each_device_is_one(tmp_path: Path) -> None:
    path = tmp_path / "two.csv"
    rows = [f"{row % 2},{row},2,3,{row},5,6" for row in range(200)]
    path.write_text("\n".join(["id,mag1_x,mag1_y,mag1_z,mag2_x,mag2_y,mag2_z", *rows]))
    names = ["id=0, mag1", "id=0, mag2", "id=1, mag1", "id=1, mag2"]
    assert [each.name for each in flinders.open_log(path).instruments] == names


def test_devices_that_share_a_time_keep_it(tmp_path: Path) -> None:
    """Thirty readings to each time are no time whose digits were cut."""
    path = tmp_path / "many.csv"
    rows = [f"{row // 30},{row % 30},{row},2,3" for row in range(1200)]
    path.write_text("\n".join(["time_s,node,mx,my,mz", *rows]))
    samples = flinders.read(path, sensor="node=4")
    assert samples.time is not None
    np.testing.assert_array_equal(samples.time, np.arange(40))


def test_without_a_header_the_column_is_named_and_then_chosen_by(tmp_path: Path) -> None:
    for words in ("numbers", "MAC addresses", "names with numbers"):
        path = csv(tmp_path / f"{words}.csv", "id", WORDS[words])
        path.write_text(path.read_text().partition("\n")[2])
        with assert_raises(NoMagnetometer):
            flinders.read(path)
        fit = flinders.fit(flinders.read(path, columns="2,3,4", sensor="3"))
        np.testing.assert_allclose(fit.calibration.offset, OFFSETS[2], atol=0.05)


def test_columns_that_are_asked_for_are_those_of_one_device(tmp_path: Path) -> None:
    path = csv(tmp_path / "devices.csv", "id", WORDS["numbers"])
    assert len(flinders.read(path, columns="mag_x_uT,mag_y_uT,mag_z_uT")) == ROWS
    with assert_raises(UsageError):
        flinders.read(path, sensor="id=7")


def test_commands_name_all_and_take_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    csv(tmp_path / "devices.csv", "id", WORDS["numbers"], order="in any order")
    first = flinders_("calibrate", "devices.csv")
    assert "id=0, columns" in first.err
    assert_sentences(first.err)
    every = flinders_("calibrate", "devices.csv", "--sensor", "all", "-o", "device-{sensor}.json")
    assert every.code == 0
    assert_sentences(flinders_("check", "device-2.json", "devices.csv").err)
    applied = flinders_("apply", "device-2.json", "devices.csv").out.splitlines()
    assert len(applied) == 1 + ROWS
    assert {line.partition(",")[0] for line in applied[1:]} == {"1"}


TIMED: Final = {
    "a date behind the id": ("id,timestamp,mx,my,mz", "{device},{when:%Y-%m-%d %H:%M:%S.%f},{body}"),
    "a date and a clock": ("date,time,mx,my,mz,node", "{when:%d.%m.%Y},{when:%H:%M:%S.%f},{body},{device}"),
    "a header with a name too few": ("t,id,mx,my,mz", "{t},{device},{body},{t}"),
}
"""Header and line of each."""


@pytest.mark.parametrize("name", TIMED)
def test_devices_of_a_table_with_dates_or_another_header_are_told_apart(name: str, tmp_path: Path) -> None:
    header, form = TIMED[name]
    times = [datetime(2026, 3, 4, 23, 59, 0, 250000) + timedelta(seconds=row / 8) for row in range(3 * ROWS)]
    pairs = zip(times, devices(), field_of(devices()).tolist(), strict=True)
    rows = [
        form.format(when=when, t=row / 8, device=device, body=",".join(map(str, field)))
        for row, (when, device, field) in enumerate(pairs)
    ]
    path = tmp_path / "devices.csv"
    path.write_text("\n".join([header, *rows]))
    np.testing.assert_allclose(offsets(path), OFFSETS, atol=0.05)
    time = flinders.read(path, sensor="2").time
    assert time is not None
    np.testing.assert_allclose(np.ptp(time), np.ptp(np.flatnonzero(devices() == 1)) / 8, atol=1e-3)


def test_a_time_is_none_of_the_axes_that_are_offered_beside_a_column_of_devices(tmp_path: Path) -> None:
    rows = zip(devices("in turn"), field_of(devices("in turn")).tolist(), strict=True)
    lines = [
        f"b4:0{device},{x},{y},{z},2026-03-04 00:{row // 60:02d}:{row % 60:02d}"
        for row, (device, (x, y, z)) in enumerate(rows)
    ]
    path = tmp_path / "devices.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(NoMagnetometer, match="columns='2,3,4'"):
        flinders.read(path)


def test_seconds_of_a_clock_are_no_addresses(tmp_path: Path) -> None:
    """Twenty lines with ``04:42:07``, and then as many with the next."""
    fields = field_of(devices()).tolist()
    path = tmp_path / "one.csv"
    path.write_text("\n".join(f"{x},{y},{z},04:42:{row // 20:02d}" for row, (x, y, z) in enumerate(fields)))
    assert len(flinders.read(path)) == 3 * ROWS
