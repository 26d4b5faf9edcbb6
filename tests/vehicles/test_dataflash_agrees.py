"""DataFlash logs: all messages and fields as pymavlink's own reader, which is used here only to compare with."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest

from flinders.apps.vehicles.readers.dataflash_format import read_packed
from flinders.apps.vehicles.targets import ardupilot

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

DFReader = pytest.importorskip("pymavlink.DFReader")
dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")


@pytest.mark.nightly
def test_every_message_and_field_of_a_flight_as_pymavlink_reads_it(recordings: Callable[[str], Path]) -> None:
    path = recordings("dronekit_log171_3mags/log171.bin")
    theirs: dict[str, list[dict[str, Any]]] = defaultdict(list)
    with DFReader.DFReader_binary(str(path)) as log:
        while (message := log.recv_msg()) is not None:
            fields = message.to_dict()
            theirs[fields.pop("mavpackettype")].append(fields)
    ours = read_packed(np.fromfile(path, np.uint8), theirs)
    assert (ours.skipped, ours.gaps) == (0, 0)
    assert {name: len(table) for name, table in ours.tables.items()} == {
        name: len(rows) for name, rows in theirs.items()
    }
    for name, table in ours.tables.items():
        for label, (letter, *_) in table.fields.items():
            told = [row[label] for row in theirs[name]]
            if letter in "nNZ":
                assert table.texts(label) == told
            elif letter != "M":  # which pymavlink gives by name
                npt.assert_allclose(table.column(label), np.array(told, float), rtol=1e-12, err_msg=f"{name}.{label}")


def test_mountings_have_the_numbers_and_angles_of_mavlink() -> None:
    """0 to 40; of 38 MAVLink rounds the angles, and from 41 on it has none."""
    told = dialect.enums["MAV_SENSOR_ORIENTATION"]
    for number in range(41):
        name, *angles = ardupilot.ORIENTATIONS[number]
        assert told[number].name == f"MAV_SENSOR_ROTATION_{name}"
        said = dict(re.findall(r"(Roll|Pitch|Yaw): (\d+)", told[number].description))
        rounded = [int(said.get(axis, 0)) for axis in ("Roll", "Pitch", "Yaw")]
        npt.assert_allclose(angles, rounded, atol=0.81 if number == 38 else 0)
    assert 41 not in told
