"""Budgets and exports of any numbers: every unknown comes back, and a device does what the calibration says."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from flinders.apps.classic.adis16480 import HARD_IRON_STEP_MG, HIGHEST, LOWEST, MG, SOFT_IRON_STEP, Registers
from flinders.apps.classic.budget import Heading, Magnet, Pair, Wire
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import FlindersError, NotExportable, UsageError
from flinders.targets import registry

REGISTERS = ("adis16480", "adis16488")
sizes = st.floats(1e-6, 1e6)
everything = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Any that the registers hold, with any mapping of axes."""
    entry = st.floats(-0.25, 0.25)
    lower = np.array(draw(st.lists(entry, min_size=9, max_size=9))).reshape(3, 3)
    matrix = np.diag(draw(st.lists(st.floats(0.85, 1.5), min_size=3, max_size=3))) + (lower + lower.T) / 2
    offset = draw(st.lists(st.floats(-80, 80), min_size=3, max_size=3))
    order, signs = draw(st.permutations("xyz")), draw(st.lists(st.sampled_from(["", "-"]), min_size=3, max_size=3))
    axes = Axes.of(",".join(sign + name for sign, name in zip(signs, order, strict=True)))
    assume(np.linalg.eigvalsh(matrix).min() > 0.1)
    return Calibration(matrix, np.array(offset), draw(st.floats(20, 70)), raw=Unit.of("mG"), axes=axes)


@pytest.mark.parametrize(
    ("kind", "names"),
    [(Wire, "current distance"), (Pair, "current separation distance"), (Magnet, "moment distance")],
)
@given(numbers=st.lists(sizes, min_size=3, max_size=3))
def test_whatever_is_left_out_of_a_source_comes_back(kind: Any, names: str, numbers: list[float]) -> None:  # noqa: ANN401
    known = dict(zip(names.split(), numbers, strict=False))
    if kind is Pair:
        assume(known["distance"] > 0.51 * known["separation"])
    whole = asdict(kind.solve(**known))
    whole.pop("position", None)
    for left_out in whole:
        found = kind.solve(**{name: value for name, value in whole.items() if name != left_out})
        assert getattr(found, left_out) == pytest.approx(whole[left_out], rel=1e-6)


@given(field=sizes, error=st.floats(1e-6, 89.0))
def test_whatever_is_left_out_of_a_heading_comes_back(field: float, error: float) -> None:
    stray = Heading.solve(field=field, error_deg=error).stray
    assert Heading.solve(field=field, stray=stray).error_deg == pytest.approx(error, rel=1e-9)
    assert Heading.solve(stray=stray, error_deg=error).field == pytest.approx(field, rel=1e-9)
    assert math.degrees(stray / field) <= error * (1 + 1e-9)


@pytest.mark.parametrize("kind", [Heading, Wire, Pair, Magnet])
@given(numbers=st.lists(st.none() | everything, min_size=4, max_size=4))
def test_any_numbers_are_solved_or_refused_with_a_message(kind: Any, numbers: list[float | None]) -> None:  # noqa: ANN401
    names = [field.name for field in dataclasses.fields(kind) if field.name != "position"]
    try:
        solved = kind.solve(**dict(zip(names, numbers, strict=False)))
    except UsageError:
        return
    assert all(0 < getattr(solved, name) < np.inf for name in names)


@given(calibrations())
def test_a_device_does_what_the_calibration_says_to_the_quantisation_limit(found: Calibration) -> None:
    registers = Registers.of(found)
    raw = found.unapply(found.field_strength * np.concatenate([np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)]))
    recorded = raw @ found.axes.apply(np.eye(3)).T
    limit = 0.5 * HARD_IRON_STEP_MG + 0.5 * SOFT_IRON_STEP * np.abs(recorded / MG).sum(axis=1, keepdims=True)
    off = np.abs(found.axes.apply(registers.apply(recorded / MG)) - found.apply(raw) / MG)
    assert np.all(off <= limit + 1e-6)


@given(calibrations())
def test_codes_are_those_of_the_calibration_they_stand_for(found: Calibration) -> None:
    registers = Registers.of(found)
    assert Registers.of(registers.to_calibration(found.field_strength)) == registers
    assert Registers.from_words(register.word for register in registers.rows) == registers


@given(st.lists(st.integers(LOWEST, HIGHEST), min_size=12, max_size=12))
def test_any_codes_survive_being_written_as_words(codes: list[int]) -> None:
    registers = Registers(tuple(codes))
    assert Registers.from_words(register.word for register in registers.rows) == registers


@given(calibrations())
def test_every_export_stays_within_what_it_says(found: Calibration) -> None:
    for name in REGISTERS:
        checked = registry()[name].render(found).fields["checked"]
        assert checked["worst"] < 0.25
        assert checked["worst_deg"] < 0.1


@given(
    diagonal=st.lists(st.integers(-300, 300), min_size=3, max_size=3),
    beside=st.lists(st.floats(-0.3, 0.3), min_size=9, max_size=9),
    offset=st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3),
    strength=st.integers(-300, 300),
)
def test_any_calibration_is_exported_or_refused_with_a_message(
    diagonal: list[int], beside: list[float], offset: list[float], strength: int
) -> None:
    with np.errstate(all="ignore"):
        scale = np.diag([10.0**exponent for exponent in diagonal])
        try:
            matrix = scale @ (np.eye(3) + np.reshape(beside, (3, 3)))
            found = Calibration(matrix, np.array(offset), 10.0**strength, rotation="composed", raw=Unit.of("uT"))
        except FlindersError:
            return
    for name in REGISTERS:
        try:
            export = registry()[name].render(found)
        except NotExportable:
            continue
        assert export.fields["checked"]["worst"] <= 0.02 * 10.0**strength / MG
