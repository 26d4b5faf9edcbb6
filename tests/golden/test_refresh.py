"""What `flinders refresh` prints, to the letter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session
from tests.worlds import TUMBLED_SENSOR, write_field

import flinders
from flinders import simulate
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down

if TYPE_CHECKING:
    from tests.golden.sessions import Golden

    from flinders.simulate import Sensor


@pytest.fixture(autouse=True)
def vehicle() -> None:
    """A calibration of a vehicle, and wobbles of it after a battery was moved, and after steel was built in."""
    flinders.fit(simulate.tumble(seed=3, sensor=TUMBLED_SENSOR).samples).save("calibration.json")
    moved = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + np.array([8.0, -5.0, 3.0]))
    steel = np.eye(3) + 0.05 * np.array([[0.5, 1.0, 0.0], [1.0, -0.5, 0.4], [0.0, 0.4, 0.0]])
    bent = replace(moved, matrix=steel @ moved.matrix @ steel)
    _wobble("wobble.csv", moved)
    _wobble("steel.csv", bent)
    rng = np.random.default_rng(6)
    for name, heading in {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}.items():
        field = 50.0 * in_body_axes(attitudes_of(math.radians(heading), 0.0, 0.0), north_and_down(60.0))
        write_field(f"{name}.csv", moved.read(np.tile(field, (100, 1)), rng))


def _wobble(name: str, sensor: Sensor) -> None:
    write_field(name, simulate.tumble(seed=4, motion="wobble", sensor=sensor).samples.field)


def test_a_moved_battery(golden: Golden) -> None:
    golden("cli/refresh.txt", session("flinders refresh --previous calibration.json wobble.csv -o refreshed.json"))


def test_steel_that_was_built_in(golden: Golden) -> None:
    golden("cli/refresh-steel.txt", session("flinders refresh --previous calibration.json steel.csv", code=3))


def test_known_headings(golden: Golden) -> None:
    words = "north.csv east.csv south.csv west.csv --magnetic-heading 0,90,180,270 --dip 60 -o parked.json"
    golden("cli/refresh-headings.txt", session(f"flinders refresh --previous calibration.json {words}"))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("refresh.md", request, least=3)
