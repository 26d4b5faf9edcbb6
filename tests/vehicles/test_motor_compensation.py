"""Motor compensation of autopilots corrects as the disturbances of a calibration do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.estimators.test_disturbances import given

from flinders import simulate
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as ArduPilot
from flinders.apps.vehicles.targets.px4 import Px4Parameters as Px4
from flinders.cli import main
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats


def run(*words: str, code: int = 0) -> str:
    ended = CliRunner().invoke(main, list(words), prog_name="flinders")
    assert ended.exit_code == code, ended.output
    return ended.stdout


def test_an_imported_file_of_an_autopilot_follows_its_motors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CompassMot's numbers, in mG for each A, come back as an offset per A with the sign turned round."""
    monkeypatch.chdir(tmp_path)
    lines = ["COMPASS_OFS_X,-100", "COMPASS_OFS_Y,0", "COMPASS_OFS_Z,50", "COMPASS_MOTCT,2"]
    (tmp_path / "on.param").write_text("\n".join([*lines, "COMPASS_MOT_X,-5", "COMPASS_MOT_Y,0", "COMPASS_MOT_Z,3"]))
    (tmp_path / "off.param").write_text("\n".join(lines))
    run("import", "on.param", "-o", "on.json")
    run("import", "off.param", "-o", "off.json")
    [disturbance] = Calibration.load("on.json").disturbances
    assert (disturbance.name, disturbance.has_range) == ("current", False)
    assert disturbance.per_unit == pytest.approx([0.5, 0.0, -0.3])
    assert Calibration.load("off.json").disturbances == ()
    raw = np.array([[30.0, -20.0, 10.0]])
    board = ArduPilot.read({"COMPASS_OFS_X": -100, "COMPASS_OFS_Z": 50, "COMPASS_MOTCT": 2, "COMPASS_MOT_X": -5,
                            "COMPASS_MOT_Z": 3})  # fmt: skip
    for amperes in (0.0, 12.0):
        ours = Calibration.load("on.json").apply(raw, current=amperes)
        assert ours == pytest.approx(board.apply(10.0 * raw, amperes) / 10.0)


def away(calibration: Calibration, motor: str, value: float) -> tuple[Floats, Floats]:
    """(N, 3) readings at a value of the motors in µT and mapped axes, and what they should become."""
    field = calibration.field_strength * simulate.uniform_directions(np.random.default_rng(1), 50)
    return calibration.at(**{motor: value}).unapply(field), field


@pytest.mark.parametrize("motor", ["current", "throttle"])
def test_autopilots_correct_as_the_calibration_does(motor: str) -> None:
    value = 12.0 if motor == "current" else 0.6
    disturbances = (Disturbance(motor, np.array([0.5, -0.1, 0.3]), reference=0.2, lowest=0.0, highest=20.0),)
    found = replace(given(), disturbances=disturbances, axes=Axes())
    raw, field = away(found, motor, value)
    ardupilot = ArduPilot.of(found)
    assert ardupilot.motor_by == (2 if motor == "current" else 1)
    npt.assert_allclose(ardupilot.apply(10.0 * raw, value) / 10.0, field, atol=1e-6)
    px4 = Px4.of(found)
    npt.assert_allclose(
        100.0 * px4.apply(raw / 100.0, value / 1000.0 if motor == "current" else value), field, atol=1e-6
    )
