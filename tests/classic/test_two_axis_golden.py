"""What `flinders two-axis` prints and draws, to the letter; docs/classic/two-axis.md shows these files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from click.testing import CliRunner
from tests.golden.sessions import Golden, assert_sessions_are_real, session

from flinders import simulate
from flinders.cli import main
from flinders.core.calibration import Calibration

if TYPE_CHECKING:
    import pytest
    from tests.golden.sessions import Golden


def swing() -> None:
    CliRunner().invoke(main, ["simulate", "two-axis", "-o", "swing.csv"])


def test_a_swing_of_36_points(golden: Golden) -> None:
    swing()
    golden("cli/two-axis-turn.txt", session("flinders two-axis swing.csv -o calibration.json --polar rose.svg", code=3))
    golden("cli/two-axis-rose.svg", Path("rose.svg").read_text(encoding="utf-8"))


def test_three_quarters_of_a_turn(golden: Golden) -> None:
    swing()
    lines = Path("swing.csv").read_text(encoding="utf-8").splitlines()
    Path("arc.csv").write_text("\n".join([*lines[:28], ""]), encoding="utf-8")
    refused = session("flinders two-axis arc.csv --method two-axis", code=4)
    fitted = session("flinders two-axis arc.csv --polar arc.svg", code=3)
    golden("cli/two-axis-arc.txt", refused + fitted)
    assert Path("arc.svg").read_text(encoding="utf-8").endswith("</svg>\n")


def test_three_planes(golden: Golden) -> None:
    sensor = simulate.Sensor(
        np.array([[1.1, 0.04, 0.02], [0.04, 0.9, -0.03], [0.02, -0.03, 1.05]]), np.array([30.0, -40.0, 60.0]), 0.1
    )
    heading, level, down = np.radians(np.arange(0.0, 360.0, 10.0)), 25.0, 50.0 * np.sqrt(0.75)
    for place, plane in enumerate(("yz", "zx", "xy")):
        around = np.stack([level * np.cos(heading), -level * np.sin(heading), np.full(36, down)], axis=1)
        raw = sensor.read(np.roll(around, place + 1, axis=1), np.random.default_rng(place))
        loaded = Calibration.load(f"{place}.json").apply(raw) if place else raw
        np.savetxt(f"{plane}.csv", loaded, delimiter=",", header="mx_uT,my_uT,mz_uT", comments="", fmt="%.3f")
        after = f" --plane {plane}" * (plane != "xy") + f" --after {place}.json" * bool(place)
        shown = session(f"flinders two-axis {plane}.csv{after} -o {place + 1}.json", code=3)
    golden("cli/two-axis-planes.txt", shown)


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("classic/two-axis.md", request, least=3)


def test_a_recovery_of_a_two_axis_compass(golden: Golden) -> None:
    golden("cli/two-axis.txt", session("flinders simulate two-axis -o swing.csv --polar rose.csv"))
