"""What `flinders calibrate --sensor all --joint` prints, to the letter."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.golden.sessions import assert_sessions_are_real, session
from tests.sentences import assert_sentences

from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from tests.golden.sessions import Golden

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From the axes of the inner sensors into those of the mast's."""


@pytest.fixture(autouse=True)
def boat() -> None:
    """A compass on the mast and two inside, one of which has a telephone beside it from 20 to 28 s."""
    rng = np.random.default_rng(4)
    path = simulate.tumble(seed=4, motion="hand", n=1200, rate_hz=20.0)
    time = np.arange(1200) / 20.0
    columns = [time]
    for turn, noise in ((np.eye(3), 0.3), (TURNED, 1.5), (TURNED, 0.8)):
        sensor = simulate.Sensor.random(rng, noise=noise)
        columns += list(sensor.read(50.0 * path.directions @ turn, rng).T)
    columns[7] = columns[7] + 4.0 * ((time > 20.0) & (time < 28.0))
    header = ",".join(["t_s", *(f"mag_{place}_{axis}_uT" for place in ("top", "left", "right") for axis in "xyz")])
    np.savetxt("boat.csv", np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.3f")


def test_three_together(golden: Golden) -> None:
    line = "flinders calibrate boat.csv --sensor all --joint -o compass-{sensor}.json"
    golden("cli/together.txt", session(line, code=3))
    for number in (1, 2, 3):
        assert Path(f"compass-{number}.json").exists()


def test_as_json(golden: Golden) -> None:
    line = "calibrate boat.csv --sensor all --joint --reference 2 --json"
    ended = CliRunner().invoke(main, line.split())
    found = json.loads(ended.stdout)
    kept = ("sensor", "verdict", "joint")
    told = {**found, "sensors": [{key: row[key] for key in kept} for row in found["sensors"]]}
    golden("cli/together.json", json.dumps(coarse(told), indent=1, ensure_ascii=False) + "\n")


def coarse(value: object) -> object:
    """Round to two digits and a hundredth, within which an iteration ends on any machine."""
    if isinstance(value, dict):
        return {key: coarse(member) for key, member in value.items()}
    if isinstance(value, list):
        return [coarse(member) for member in value]
    return round(float(f"{value:.2g}"), 2) + 0.0 if isinstance(value, float) else value


@pytest.mark.parametrize(
    "line",
    [
        "--joint",
        "--sensor all --reference 2",
        "--sensor all --joint --method minmax",
        "--sensor all --joint --reference 9",
    ],
)
def test_what_does_not_go_with_it(line: str) -> None:
    ended = CliRunner().invoke(main, ["calibrate", "boat.csv", *line.split()])
    assert ended.exit_code == 2
    assert_sentences(ended.output)


def test_the_sessions_in_the_docs_are_these(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("sensors.md", request)
