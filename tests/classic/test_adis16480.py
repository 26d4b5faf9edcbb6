"""Registers of the ADIS16480 and ADIS16488: the data sheets' examples to their digits, and the way there and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences

from flinders import simulate
from flinders.apps.classic.adis16480 import HARD_IRON_STEP_MG, NAMES, SOFT_IRON_STEP, Register, Registers
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import ArrayError, NotExportable, UnitError, UsageError
from flinders.targets import find, registry

if TYPE_CHECKING:
    from flinders.arrays import Floats

MICROTESLA = Unit.of("uT")


def calibration(matrix: object, offset: object = (0, 0, 0), strength: float = 50.0, **more: object) -> Calibration:
    return Calibration(np.array(matrix, float), np.array(offset, float), strength, raw=MICROTESLA, **more)  # type: ignore[arg-type]


def code(registers: Registers, name: str) -> Register:
    return registers.rows[NAMES.index(name)]


# the data sheets (literature §10)

HARD_IRON_EXAMPLES = [
    (3276.7, 32767, 0x7FFF), (0.2, 2, 0x0002), (0.1, 1, 0x0001), (0.0, 0, 0x0000), (-0.1, -1, 0xFFFF),
    (-0.2, -2, 0xFFFE), (-3276.8, -32768, 0x8000),
]  # fmt: skip
"""ADIS16480 Rev. H Table 120: field in mG, decimal, hexadecimal."""


@pytest.mark.parametrize(("field", "decimal", "word"), HARD_IRON_EXAMPLES)
def test_the_hard_iron_examples_of_the_data_sheet(field: float, decimal: int, word: int) -> None:
    registers = Registers.of(calibration(np.eye(3), [-field / 10, 0, 0]))  # H = −b, in µT
    register = code(registers, "HARD_IRON_X")
    assert (register.code, register.word) == (decimal, word)
    assert register.value == pytest.approx(field)
    assert Registers.from_words([word] + [0] * 11) == registers


def test_names_page_and_addresses_are_those_of_the_data_sheet() -> None:
    addresses = {register.name: register.address for register in Registers((0,) * 12).rows}
    assert addresses == {
        "HARD_IRON_X": 0x28, "HARD_IRON_Y": 0x2A, "HARD_IRON_Z": 0x2C,
        "SOFT_IRON_S11": 0x2E, "SOFT_IRON_S12": 0x30, "SOFT_IRON_S13": 0x32,
        "SOFT_IRON_S21": 0x34, "SOFT_IRON_S22": 0x36, "SOFT_IRON_S23": 0x38,
        "SOFT_IRON_S31": 0x3A, "SOFT_IRON_S32": 0x3C, "SOFT_IRON_S33": 0x3E,
    }  # fmt: skip
    assert {register.page for register in Registers((0,) * 12).rows} == {2}


def test_the_defaults_of_the_device_change_nothing() -> None:
    assert Registers.of(Calibration.identity(raw=MICROTESLA)).codes == (0,) * 12
    npt.assert_array_equal(Registers((0,) * 12).apply([1.0, -2.0, 3.0]), [1.0, -2.0, 3.0])


def test_soft_iron_is_in_steps_of_a_hundred_percent_over_32768() -> None:
    registers = Registers.of(calibration([[1.5, 0.25, 0], [0.25, 0.5, 0], [0, 0, 1 + 1.4 / 32768]]))
    found = {register.name: register.code for register in registers.rows if register.code}
    assert found == {
        "SOFT_IRON_S11": 16384, "SOFT_IRON_S12": 8192, "SOFT_IRON_S21": 8192, "SOFT_IRON_S22": -16384,
        "SOFT_IRON_S33": 1,
    }  # fmt: skip
    assert code(registers, "SOFT_IRON_S22").word == 0xC000
    assert code(registers, "SOFT_IRON_S11").value == 50.0


def test_halves_round_to_even() -> None:
    registers = Registers.of(calibration(np.diag([1 + 0.5 / 32768, 1 + 1.5 / 32768, 1 - 2.5 / 32768])))
    assert [code(registers, f"SOFT_IRON_S{i}{i}").code for i in (1, 2, 3)] == [0, 2, -2]


def test_the_formula_is_that_of_the_device_worked_by_hand() -> None:
    """1.5 · 100 + 0.25 · (−40) + 12.5 = 152.5 mG."""
    words = [125, 0, 0, 16384, 8192, 0, 0, 0, 0, 0, 0, 0]
    npt.assert_allclose(Registers.from_words(words).apply([100.0, -40.0, 7.0]), [152.5, -40.0, 7.0])


# there and back


def device(registers: Registers, readings: Floats) -> Floats:
    """M_C = (I + S) M + H from the bare words, in the integers of the data sheet, one register after the other."""
    words = {register.name: register.word for register in registers.rows}

    def signed(name: str) -> int:
        return words[name] - 65536 if words[name] >= 32768 else words[name]

    corrected = np.empty_like(readings)
    for row, axis in enumerate("XYZ"):
        soft = [signed(f"SOFT_IRON_S{row + 1}{column + 1}") / 32768 + (row == column) for column in range(3)]
        corrected[:, row] = sum(soft[column] * readings[:, column] for column in range(3))
        corrected[:, row] += 0.1 * signed(f"HARD_IRON_{axis}")
    return corrected


@pytest.mark.parametrize("seed", range(20))
def test_what_the_device_puts_out_is_the_calibration_to_the_quantisation_limit(seed: int) -> None:
    sensor = simulate.Sensor.random(np.random.default_rng(seed))
    given = Calibration.from_ellipsoid(sensor.offset, sensor.matrix @ sensor.matrix.T * 45, raw=MICROTESLA)
    registers = Registers.of(given)
    raw = given.unapply(given.field_strength * simulate.uniform_directions(np.random.default_rng(seed), 500))
    limit = 0.5 * HARD_IRON_STEP_MG + 0.5 * SOFT_IRON_STEP * np.abs(10 * raw).sum(axis=1, keepdims=True)
    out = device(registers, 10 * raw)
    assert np.all(np.abs(out - 10 * given.apply(raw)) <= limit + 1e-9)
    npt.assert_allclose(registers.apply(10 * raw), out, atol=1e-9)
    decoded = registers.to_calibration(given.field_strength)
    npt.assert_allclose(10 * decoded.apply(raw), out, atol=1e-9)
    assert Registers.of(decoded) == registers


def test_codes_read_from_a_device_come_back_as_the_calibration_they_stand_for() -> None:
    given = calibration([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]], [12, -30, 7])
    decoded = Registers.from_words(register.word for register in Registers.of(given).rows).to_calibration(
        50.0, known=True
    )
    assert (decoded.rotation, decoded.field_strength_known) == ("symmetric", True)
    npt.assert_allclose(decoded.matrix, given.matrix, atol=SOFT_IRON_STEP / 2)
    npt.assert_allclose(decoded.offset, given.offset, atol=0.01)


def test_a_matrix_with_a_rotation_in_it_keeps_it() -> None:
    turn = np.deg2rad(5)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    given = calibration(rotation @ np.diag([1.1, 0.9, 1.0]), [5, 5, 5], rotation="estimated")
    decoded = Registers.of(given).to_calibration(50.0)
    assert decoded.rotation == "composed"
    npt.assert_allclose(decoded.matrix, given.matrix, atol=SOFT_IRON_STEP / 2)


@pytest.mark.parametrize("axes", ["x,y,z", "x,-y,-z", "y,x,-z", "-z,x,-y", "y,x,z"])
def test_registers_act_in_the_axes_of_the_device_whatever_the_mapping(axes: str) -> None:
    """Corrected by the device and then mapped is mapped and then corrected by the calibration."""
    mapping = Axes.of(axes)
    given = calibration([[1.1, 0.05, 0.02], [0.05, 0.9, 0], [0.02, 0, 1.02]], [12, -30, 7], axes=mapping)
    recorded = 40 * simulate.uniform_directions(np.random.default_rng(1), 100)
    found = mapping.apply(Registers.of(given).apply(10 * recorded) / 10)
    npt.assert_allclose(found, given.apply(mapping.apply(recorded)), atol=0.02)
    assert find("adis16480").render(given).fields["checked"]["worst"] < 0.2


# what does not fit


def test_saturation_names_each_register_and_what_is_lost() -> None:
    with pytest.raises(NotExportable) as caught:
        Registers.of(calibration(np.diag([2.5, 1.0, 0.4]), [400, 0, 0]))
    error = caught.value
    assert error.beyond == ("HARD_IRON_X", "SOFT_IRON_S11")
    assert error.exit_code == 4
    assert_sentences(str(error))
    assert error.evidence["lost"] == pytest.approx({"HARD_IRON_X": -6723.2, "SOFT_IRON_S11": 0.5 + 1 / 32768})


def test_the_last_value_that_fits_and_the_first_that_does_not() -> None:
    assert code(Registers.of(calibration(np.diag([2 - 1 / 32768, 1, 1]))), "SOFT_IRON_S11").code == 32767
    assert code(Registers.of(calibration(np.eye(3), [-327.674, 0, 0])), "HARD_IRON_X").code == 32767
    assert code(Registers.of(calibration(np.eye(3), [327.684, 0, 0])), "HARD_IRON_X").code == -32768
    for matrix, offset in ((np.diag([2, 1, 1]), 0), (np.eye(3), -327.676), (np.eye(3), 327.686)):
        with pytest.raises(NotExportable):
            Registers.of(calibration(matrix, [offset, 0, 0]))


def test_a_scale_that_is_all_that_saturates_is_advised_to_be_left_open() -> None:
    large = calibration(np.diag([2.6, 2.5, 2.4]), field_strength_known=True)
    with assert_raises(NotExportable, beyond=("SOFT_IRON_S11", "SOFT_IRON_S22", "SOFT_IRON_S33")):
        Registers.of(large)
    with assert_raises(NotExportable):
        Registers.of(calibration(np.diag([2.6, 2.5, 0.1]), field_strength_known=True))


def test_counts_are_told_to_be_given_a_unit() -> None:
    with pytest.raises(UnitError, match="unit='mG'"):
        Registers.of(Calibration(np.eye(3), np.zeros(3), 500.0))


def test_a_scale_of_counts_is_enough() -> None:
    given = Calibration(np.eye(3), np.array([10.0, 0, 0]), 50.0, raw=Unit.of("counts", 0.01))
    assert code(Registers.of(given), "HARD_IRON_X").code == -1000


@pytest.mark.parametrize("huge", [1e30, 1e160, 1e300])
def test_numbers_beyond_all_bounds_are_refused_as_well(huge: float) -> None:
    with pytest.raises(NotExportable):
        Registers.of(calibration(huge * np.eye(3), [huge, 0, 0]))


def test_rounding_that_costs_more_than_a_degree_is_refused() -> None:
    weak = calibration(np.eye(3), [3.333, 1.111, 2.222], strength=0.1)
    with assert_raises(NotExportable):
        find("adis16480").render(weak)
    with pytest.raises(NotExportable, match="rounded"):
        find("adis16480").render(calibration(1e-9 * np.eye(3)))


def test_codes_that_flatten_cannot_be_undone() -> None:
    with pytest.raises(ArrayError, match="singular"):
        Registers((0, 0, 0, -32768, 0, 0, 0, 0, 0, 0, 0, 0)).to_calibration(50.0)


@pytest.mark.parametrize("words", [[0] * 11, [0] * 13, [65536] + [0] * 11, [-32769] + [0] * 11])
def test_words_that_are_none(words: list[int]) -> None:
    with assert_raises(UsageError):
        Registers.from_words(words)


# the table of targets


def test_both_devices_are_in_the_table_and_say_how_far_off_they_are() -> None:
    given = calibration([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]], [12, -30, 7])
    for name in ("adis16480", "adis16488"):
        row = registry()[name]
        export = row.render(given, about=["from somewhere"])
        assert export.target == row.name == name
        assert {"from somewhere"} <= set(export.fields["notes"])
        assert export.fields["checked"]["worst_deg"] < 0.05
        assert "off the calibration" in export.checked
        assert all(len(line) <= 80 for line in export.text.splitlines())
        assert export.text.endswith("\n")


def test_an_unknown_target_names_those_there_are() -> None:
    with assert_raises(UsageError):
        find("adis99")


def test_what_saturation_would_cost_is_an_upper_bound_of_what_it_costs() -> None:
    given = calibration(np.diag([2.02, 1.0, 0.495]), [20, 0, 0])
    with pytest.raises(NotExportable) as caught:
        Registers.of(given)
    clipped = Registers((-4040, 0, 0, 32767, 0, 0, 0, 0, 0, 0, 0, -16548))
    raw = given.unapply(50 * simulate.uniform_directions(np.random.default_rng(0), 5000))
    cost = np.linalg.norm(clipped.apply(10 * raw) - 10 * given.apply(raw), axis=1).max()
    stated = caught.value.evidence["error_mG"]
    assert isinstance(stated, float)
    assert cost <= stated <= 1.3 * cost
