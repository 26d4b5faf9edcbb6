"""Every method moves, scales and turns with its readings, or docs/methods.md says that it does not, and why.

The table of that page is read here, and each of its cells is put to the test both ways: a yes holds for any move, unit
or rotation, and a no is shown to be one. A method without a row fails.
"""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import daily, examples

from flinders import simulate
from flinders.core.samples import Samples
from flinders.estimators import METHODS, Estimator, Readings

if TYPE_CHECKING:
    from flinders.arrays import Floats

PAGE: Final = Path(__file__).resolve().parent.parent.parent / "docs" / "methods.md"
SAME: Final = 2e-6
"""Share of the radius to which an answer has to follow; iterations end below it."""
OTHER: Final = 3e-5
"""Share of the radius from which on it does not."""


class Row(NamedTuple):
    """A row of the table."""

    moves: str
    scales: str
    turns: str
    why: str


def rows() -> dict[str, Row]:
    text = PAGE.read_text(encoding="utf-8")
    table = text[text.index("| method | moves |") :].split("\n\n")[0]
    found = re.findall(r"^\| `([\w-]+)` \| ([\w ]+) \| ([\w ]+) \| ([\w ]+) \| (.*?) ?\|$", table, re.MULTILINE)
    return {name: Row(*cells) for name, *cells in found}


ROWS: Final = rows()
NAMES: Final = sorted(METHODS.keys() & ROWS.keys())
PLANES: Final = {"level", "ellipse", "two-axis"}
"""Methods of one plane, which want a level turn."""

TUMBLES: Final = [
    simulate.tumble(seed=11, motion="uniform", n=200, noise=1.0).samples.field,
    simulate.tumble(seed=12, motion="hemisphere", n=300, noise=0.3).samples.field,
]
LEVEL_TURNS: Final = [
    simulate.tumble(seed=11, motion="level", n=200, noise=1.0).samples.field,
    simulate.tumble(seed=12, motion="level", n=300, noise=0.3).samples.field,
]
QUARTERS: Final = [np.eye(3)[[1, 2, 0]], np.eye(3)[[1, 0, 2]] * [1.0, 1.0, -1.0], np.diag([1.0, -1.0, -1.0])]
"""Axes that are swapped and change sign."""

shifts = st.tuples(*[st.floats(-400, 400)] * 3).map(np.array)
angles = st.floats(-np.pi, np.pi)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(part * part for part in q) > 0.1)
few = examples(8)


def recordings(name: str) -> list[Samples]:
    return [Samples.of(field) for field in (LEVEL_TURNS if name in PLANES else TUMBLES)]


def changed(recording: Samples, matrix: Floats, shift: Floats) -> Samples:
    """x → M x + t, M a rotation times a size."""
    return dataclasses.replace(recording, field=recording.field @ matrix.T + shift)


def made(name: str, strength: float) -> Estimator:
    """The method with its defaults; it is told the field strength if it asks for one."""
    asks = {option.name for option in dataclasses.fields(METHODS[name])}  # type: ignore[arg-type]
    known = {"field_strength": strength} if "field_strength" in asks else {}
    return METHODS[name](**known)


def apart(name: str, recording: Samples, matrix: Floats, shift: Floats) -> float:
    """How far the fit of what was changed is from the changed fit, as a share of the radius: x → M x + t."""
    size = float(np.cbrt(abs(np.linalg.det(matrix))))
    one = made(name, 50.0).estimate(Readings.of(recording)).ellipsoid
    other = made(name, 50.0 * size).estimate(Readings.of(changed(recording, matrix, shift))).ellipsoid
    centre = np.abs(other.centre - matrix @ one.centre - shift).max()
    shape = np.abs(other.shape - matrix @ one.shape @ matrix.T / size).max()
    return float(max(centre, shape)) / (size * one.radius)


def farthest(name: str, *changes: tuple[Floats, Floats]) -> float:
    return max(apart(name, recording, *change) for recording in recordings(name) for change in changes)


def turn(quaternion: tuple[float, float, float, float]) -> Floats:
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Floats = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    return rotation


def about_z(angle: float) -> Floats:
    return turn((np.cos(angle / 2.0), 0.0, 0.0, np.sin(angle / 2.0)))


def still(matrix: Floats) -> tuple[Floats, Floats]:
    return matrix, np.zeros(3)


def test_every_method_has_a_row() -> None:
    there = [name for name in ROWS if name in METHODS]
    assert there == list(METHODS), "say in the table of docs/methods.md what moves, scales and turns with readings"
    assert {row.moves for row in ROWS.values()} <= {"yes", "in its plane", "no"}
    assert {row.scales for row in ROWS.values()} <= {"yes", "no"}
    assert {row.turns for row in ROWS.values()} <= {"yes", "in its plane", "swaps", "no"}
    for name, row in ROWS.items():
        assert row.why or row[:3] == ("yes", "yes", "yes"), f"say why {name} does not"


@pytest.mark.parametrize("name", daily(NAMES, 2))
@given(shift=shifts)
@few
def test_moving_the_readings_moves_the_centre(name: str, shift: Floats) -> None:
    if ROWS[name].moves == "in its plane":
        shift = shift * [1.0, 1.0, 0.0]
    if ROWS[name].moves != "no":
        assert farthest(name, (np.eye(3), shift)) < SAME


@pytest.mark.parametrize("name", daily(NAMES, 2))
@given(power=st.floats(-3, 3))
@few
def test_another_unit_gives_the_same_ellipsoid_in_that_unit(name: str, power: float) -> None:
    if ROWS[name].scales == "yes":
        assert farthest(name, still(10.0**power * np.eye(3))) < SAME


@pytest.mark.parametrize("name", daily(NAMES, 2))
@given(quaternion=quaternions, angle=angles)
@few
def test_turning_the_readings_turns_the_ellipsoid(
    name: str, quaternion: tuple[float, float, float, float], angle: float
) -> None:
    turns = {"yes": [turn(quaternion)], "in its plane": [about_z(angle)], "swaps": QUARTERS, "no": []}
    for rotation in turns[ROWS[name].turns]:
        assert farthest(name, still(rotation)) < SAME


@pytest.mark.parametrize("name", NAMES)
def test_what_is_said_not_to_follow_does_not(name: str) -> None:
    row, tilted = ROWS[name], turn((0.9, 0.1, -0.3, 0.2))
    if row.moves != "yes":
        assert farthest(name, (np.eye(3), np.array([0.0, 0.0, 70.0]))) > OTHER
    if row.moves == "no":
        assert farthest(name, (np.eye(3), np.array([-100.0, 30.0, 0.0]))) > OTHER
    if row.scales == "no":
        assert farthest(name, *(still(factor * np.eye(3)) for factor in (0.01, 10.0))) > OTHER
    if row.turns != "yes":
        assert farthest(name, still(tilted)) > OTHER
    if row.turns == "no":
        assert farthest(name, *map(still, QUARTERS)) > OTHER
