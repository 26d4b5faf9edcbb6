"""ArduPilot's parameters of any values: un-applying undoes, and no log or file of any bytes ends in a traceback."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st

from flinders.apps.vehicles.readers.dataflash import WANTED
from flinders.apps.vehicles.readers.dataflash_format import read_packed
from flinders.apps.vehicles.targets.ardupilot import ORIENTATIONS, spellings
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as Parameters
from flinders.apps.vehicles.targets.autopilot import parse
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import InputError, NotExportable
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from flinders.arrays import Floats


def triples(low: float, high: float) -> st.SearchStrategy[Floats]:
    return st.lists(st.floats(low, high), min_size=3, max_size=3).map(np.array)


parameters = st.builds(
    Parameters,
    offset=triples(-1000, 1000),
    diagonal=triples(0.5, 2),
    off_diagonal=triples(-0.2, 0.2),
    scale=st.floats(-1, 3),
    motor=triples(-50, 50),
    motor_by=st.sampled_from([0, 1, 2]),
    compass=st.sampled_from([1, 2, 3]),
)


@given(parameters, triples(-1000, 1000), st.floats(0, 50))
def test_what_is_un_applied_was_read(found: Parameters, reading: Floats, drive: float) -> None:
    npt.assert_allclose(found.unapply(found.apply(reading, drive), drive), reading, atol=1e-6)


@given(parameters, st.sampled_from([0, 1]))
def test_what_is_written_is_what_is_read_back(found: Parameters, scheme: int) -> None:
    text = "".join(f"{spellings(name)[scheme]},{value!r}\n" for name, value in found.rows())
    again = Parameters.read(parse(text), found.compass)
    assert again.rows() == found.as_float32().rows()


@given(triples(-100, 100), triples(0.8, 1.2), triples(-0.1, 0.1), st.integers(0, len(ORIENTATIONS) - 1))
def test_parameters_stand_for_the_calibration_they_were_made_of(
    offset: Floats, diagonal: Floats, beside: Floats, orientation: int
) -> None:
    xy, xz, yz = beside
    matrix = np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    given_one = Calibration(matrix, offset, 50.0, raw=Unit.of("uT"))
    turn = euler(*ORIENTATIONS[orientation][1:])
    try:
        found = Parameters.of(given_one, mounting=turn)
    except NotExportable:
        return
    back = found.to_calibration(50.0)
    npt.assert_allclose(back.matrix, turn @ matrix @ turn.T, atol=1e-9)
    npt.assert_allclose(back.offset, turn @ offset, atol=1e-9)


@given(st.integers(0, len(ORIENTATIONS) - 1))
def test_every_mounting_is_a_rotation(orientation: int) -> None:
    turn = euler(*ORIENTATIONS[orientation][1:])
    npt.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) > 0


@given(st.text(max_size=200))
def test_any_text_is_parameters_or_refused(text: str) -> None:
    try:
        values = parse(text)
    except InputError:
        return
    assert all(np.isfinite(value) for value in values.values())


@given(st.lists(st.sampled_from([0xA3, 0x95, 128, 7, 9, 89, 0, 65, 104, 44]), max_size=400), st.integers(0, 300))
def test_any_bytes_behind_a_log_leave_what_was_before(junk: list[int], cut: int) -> None:
    described = struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, 130, 9, b"MAG", b"hhh", b"MagX,MagY,MagZ")
    rows = b"".join(struct.pack("<BBBhhh", 0xA3, 0x95, 130, n, 2 * n, 3 * n) for n in range(20))
    log = described + rows[: len(rows) - cut % 9] + bytes(junk)
    found = read_packed(np.frombuffer(log, np.uint8), WANTED)
    values = found["MAG"].column("MagX")
    assert values[:18].tolist() == list(range(18))
    assert 0 <= found.skipped <= len(junk) + 18
