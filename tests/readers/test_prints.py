"""What tools and sketches print beside the shapes of docs/line-shapes.toml: read rightly, or refused with help."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.sketches import printed

import flinders
from flinders import simulate
from flinders.errors import FlindersError

if TYPE_CHECKING:
    from pathlib import Path

TUMBLE: Final = simulate.tumble(seed=5).samples[:600:4]
READ: Final = {
    "a reading before words on calibration": (["X: {mx:.2f} Y: {my:.2f} Z: {mz:.2f}\t\tCALIBRATION: Sys=3 Mag=3"], ""),
    "a unit behind three numbers": (["{mx:6.2f}  {my:6.2f}  {mz:6.2f}      mT"], "mT"),
    "a named tuple": (["Magnetic(x={mx:.3f}, y={my:.3f}, z={mz:.3f})"], ""),
    "sensor and unit in one bracket": (
        ["LSM303AGR [mag/mgauss]:  {mx:6d}, {my:6d}, {mz:6d}", "LSM6DSL [acc/mg]:  {ax:6d}, {ay:6d}, {az:6d}"], "mG"
    ),
    "Teleplot with times": ([f">mag{axis}:{{t:d}}:{{m{axis}:.2f}}|g" for axis in "xyz"], ""),
    "Teleplot with units": ([f">mag_{axis}:{{m{axis}:.2f}}§uT|g" for axis in "xyz"], "uT"),
    "a heading over lines of an axis each": (
        ["Gyro:", "x: {gx:.2f}", "y: {gy:.2f}", "z: {gz:.2f}", "Mag:", "x: {mx:.2f}", "y: {my:.2f}", "z: {mz:.2f}"], ""
    ),
}  # fmt: skip
"""The lines of a reading, and their unit."""
REFUSED: Final = {
    "Euler angles": ("Yaw: {heading:.2f} Pitch: {pitch:.2f} Roll: {roll:.2f}", "Yaw, Pitch, Roll and no"),
    "acceleration": ("aX: {ax:.2f} aY: {ay:.2f} aZ: {az:.2f}", "acceleration and no magnetometer"),
    "many numbers without labels": (
        "{ax:.2f},{ay:.2f},{az:.2f},{gx:.2f},{gy:.2f},{gz:.2f},{mx:.2f},{my:.2f},{mz:.2f}",
        "others: 1, 2, 3 (gravity in m/s²)",
    ),
    "an index between name and value": (
        "channel type=8(magn_x) index=0 shift=1 num_samples=1 value={t}ns ({mx:.6f})", "or how a line is printed"
    ),
}  # fmt: skip
"""The line of a reading, and what the message says of it."""


@pytest.mark.parametrize("name", READ)
def test_a_usual_print_is_read_as_it_stands(name: str, tmp_path: Path) -> None:
    lines, unit = READ[name]
    readings, numbers = printed({"lines": lines, "unit": unit}, TUMBLE)
    path = tmp_path / "print.txt"
    path.write_text("\n".join(["starting", *chain.from_iterable(readings), ""]), "utf-8")
    samples = flinders.read(path)
    assert samples.unit.name == (unit or "counts")
    np.testing.assert_allclose(samples.field / samples.unit.scale, numbers)


def test_a_minus_that_stands_apart_from_its_number_is_its_sign(tmp_path: Path) -> None:
    readings, numbers = printed({"lines": ["X: {mx:.2f} Y: {my:.2f} Z: {mz:.2f} uT"], "unit": "uT"}, TUMBLE)
    path = tmp_path / "print.txt"
    path.write_text("\n".join(chain.from_iterable(readings)).replace("-", "- "), "utf-8")
    np.testing.assert_allclose(flinders.read(path).field, numbers)


@pytest.mark.parametrize("name", REFUSED)
def test_a_print_that_cannot_be_read_is_quoted_with_what_helps(name: str, tmp_path: Path) -> None:
    line, help_ = REFUSED[name]
    readings, _ = printed({"lines": [line, "{mx}{my}{mz}"], "unit": "uT"}, TUMBLE)
    path = tmp_path / "print.txt"
    path.write_text("\n".join(reading[0] for reading in readings), "utf-8")
    with pytest.raises(FlindersError) as refusal:
        flinders.open_recording(path)
    assert readings[0][0][:30] in str(refusal.value)
    assert help_ in str(refusal.value)
