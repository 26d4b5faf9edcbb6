"""Laws of motor compensation in parameters of autopilots, for any calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st
from tests.laws.test_disturbance_laws import driven

from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as ArduPilot
from flinders.apps.vehicles.targets.px4 import Px4Parameters as Px4
from flinders.core.axes import Axes
from flinders.core.units import Unit
from flinders.targets import ExportOptions, find, read_back

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration


@given(driven(), st.sampled_from(["ardupilot", "px4", "px4-shell"]))
def test_what_an_autopilot_follows_comes_back_out_of_its_file(calibration: Calibration, target: str) -> None:
    """Read back, it corrects as the target's own formula does, at any current or throttle."""
    named = {disturbance.name: disturbance for disturbance in calibration.disturbances}
    motor = next((named[name] for name in ("current", "throttle") if name in named), None)
    unit, frame = ("mG", "vehicle") if target == "ardupilot" else ("G", "sensor")
    placed = replace(calibration, axes=Axes(), raw=Unit.of(unit), frame=frame)
    text = find(target).render(placed, asked=ExportOptions(lossy=True)).text
    name, back = read_back(text.encode(), "file", strength=50.0)
    assert name == target.removesuffix("-shell")
    if motor is None or not np.any(np.abs(motor.per_unit) > 1e-12):
        assert back.disturbances == ()
        return
    [found] = back.disturbances
    assert found.name == motor.name
    raw = np.random.default_rng(1).normal(scale=50.0, size=(20, 3))
    for value in (0.0, 0.3, 4.0):
        plain = placed.at(**{**dict.fromkeys(named, 0.0), **_references(placed), motor.name: value})
        npt.assert_allclose(back.apply(raw, **{motor.name: value}), plain.apply(raw), atol=1e-3)
    board = ArduPilot if target == "ardupilot" else Px4
    values = {line.split("\t")[2]: float(line.split("\t")[3]) for line in text.splitlines() if "\tCAL_MAG" in line}
    values |= {line.split(",")[0]: float(line.split(",")[1]) for line in text.splitlines() if line[:8] == "COMPASS_"}
    if values:
        size = 10.0 if target == "ardupilot" else 0.01
        drive = 4.0 if target == "ardupilot" or motor.name == "throttle" else 4.0 / 1000.0
        own = board.read(values, 1 if target == "ardupilot" else 0).apply(size * raw, drive) / size
        npt.assert_allclose(back.apply(raw, **{motor.name: 4.0}), own, atol=1e-6)


def _references(calibration: Calibration) -> dict[str, float]:
    return {disturbance.name: disturbance.reference for disturbance in calibration.disturbances}
