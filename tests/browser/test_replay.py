"""Recordings of real sensors played back on the page: the calibration is that of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.stage import Program
from click.testing import CliRunner
from tests.browser.visitor import Visitor, until

from flinders.cli import main
from flinders.core import calibration_file
from flinders.readers import open_log

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from playwright.sync_api import Browser

    from flinders.core.calibration_file import Fitted

pytestmark = pytest.mark.tools

LIMITED = 3
LOGS = [
    pytest.param(
        "michaelwro_fxos8700/mag-readings.txt", id="a table without header or times", marks=pytest.mark.nightly
    ),
    pytest.param("sunsided_hmc5883l/full-sphere.csv", id="a table with times, acceleration and rate"),
    pytest.param("dronekit_log171_3mags/log171.bin", id="a log of ArduPilot", marks=pytest.mark.nightly),
]


@pytest.mark.parametrize("name", LOGS)
def test_a_log_played_back_gives_the_calibration_of_the_command_line(
    browser: Browser, recordings: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    log, plain = recordings(name), tmp_path / "plain.json"
    done = CliRunner().invoke(main, ["calibrate", str(log), "-o", str(plain)])
    assert done.exit_code in (0, LIMITED), done.output
    expected = calibration_file.read(plain)
    assert expected.fit is not None
    with Program(tmp_path, "--replay", str(log), "--speed", "2000") as program:
        visitor = Visitor(browser, program)
        page = visitor.page()
        until(page, "flinders.store.state.source.link === 'ended' && flinders.store.view?.offset")
        page.keyboard.press("f")
        with page.expect_download() as started:
            page.locator("#save-calibration").click()
        started.value.save_as(tmp_path / "from-page.json")
        visitor.close()
    found = calibration_file.read(tmp_path / "from-page.json")
    assert found.fit is not None
    assert found.fit.samples == expected.fit.samples
    assert found.fit.verdict == expected.fit.verdict
    assert _judged_at(found.fit) == _judged_at(expected.fit)
    stated = place_and_day(log)  # which the recording of a log does not say
    done = CliRunner().invoke(main, ["calibrate", str(program.recording), *stated, "-o", str(plain), "--force"])
    assert done.exit_code in (0, LIMITED), done.output
    expected = calibration_file.read(plain)  # also of a log without times, which gets them as it is played
    size = expected.calibration.field_strength
    np.testing.assert_allclose(found.calibration.offset, expected.calibration.offset, atol=1e-6 * size)
    np.testing.assert_allclose(found.calibration.matrix, expected.calibration.matrix, atol=1e-6)
    assert visitor.complaints == []
    assert visitor.strangers == []


def place_and_day(log: Path) -> list[str]:
    """Options that state what a log says of where and when it was made."""
    made = open_log(log)
    if made.position is None or made.start_time is None:
        return []
    place = (made.position.latitude_deg, made.position.longitude_deg, made.position.altitude_m)
    return ["--at", ",".join(map(str, place)), "--date", made.start_time.date().isoformat()]


def _judged_at(fit: Fitted) -> tuple[float | None, bool]:
    """Dip that a calibration file was judged at, and whether it is assumed."""
    assert fit.heading_error_deg is not None
    return fit.heading_error_deg.dip_deg, fit.heading_error_deg.dip_assumed
