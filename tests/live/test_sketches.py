"""Five usual sketches, from what the board prints to the header that it compiles, with no option but file names."""

from __future__ import annotations

import contextlib
import os
import tty
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.program import Ended, flinders_
from tests.sketches import SHAPES, printed
from tests.trials import daily

import flinders
from flinders import simulate

if TYPE_CHECKING:
    from pathlib import Path

READINGS: Final = 400
TUMBLE: Final = simulate.tumble(seed=8, n=4 * READINGS)
FIVE: Final = (
    "adafruit-lis3mdl-demo", "qmc5883lcompass-xyz", "circuitpython-lis3mdl-simpletest",
    "sparkfun-icm20948-scaled-brackets",
    "zephyr-lis3mdl-mx-equals",
)  # fmt: skip


def print_to(master: int, shape: dict[str, Any], is_over: Event) -> None:
    """Print boot messages, and the readings again and again, as boards do, until it is over."""
    readings, _ = printed(shape, TUMBLE.samples[::4])
    again = "".join(f"{line}\r\n" for reading in readings for line in reading).encode()
    content = "".join(f"{line}\r\n" for line in shape["boot"]).encode() + again
    os.set_blocking(master, False)
    while not is_over.wait(0.001):
        with contextlib.suppress(BlockingIOError):
            content = content[os.write(master, content[:256]) :] or again


def record(shape: dict[str, Any]) -> Ended:
    """Record what a board prints."""
    master, slave = os.openpty()
    tty.setraw(slave)
    is_over = Event()
    sender = Thread(target=print_to, args=(master, shape, is_over))
    sender.start()
    try:
        return flinders_("record", "--serial", os.ttyname(slave), "--readings", str(READINGS), "-o", "tumble.csv")
    finally:
        is_over.set()
        sender.join()
        os.close(slave)
        os.close(master)


@pytest.mark.parametrize("name", daily(FIVE, 4))
def test_a_sketch_is_recorded_calibrated_and_exported_without_an_option(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shape = next(shape for shape in SHAPES if shape["name"] == name)
    monkeypatch.chdir(tmp_path)
    recorded = record(shape)
    assert recorded.code == 0, recorded.err
    calibrated = flinders_("calibrate", "tumble.csv", "-o", "calibration.json")
    assert calibrated.code == 0, calibrated.err
    exported = flinders_("export", "--for", "arduino", "calibration.json", "-o", "calibration.h")
    assert exported.code == 0, exported.err
    assert "MAG_MATRIX" in (tmp_path / "calibration.h").read_text(encoding="utf-8")
    calibration = flinders.Calibration.load(tmp_path / "calibration.json")
    _, numbers = printed(shape, TUMBLE.samples)
    scale = flinders.read(tmp_path / "tumble.csv").unit.scale
    strengths = np.linalg.norm(calibration.apply(numbers * scale), axis=1)
    assert np.std(strengths) < 0.05 * np.mean(strengths)
