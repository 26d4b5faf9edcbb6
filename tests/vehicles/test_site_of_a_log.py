"""The place and time in a log tell dip and field strength."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.findings.test_what_is_known import calibration, run
from tests.flight_log import dataflash
from tests.sentences import assert_sentences


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def flight() -> str:
    Path("flight.bin").write_bytes(b"".join(dataflash()))
    return "flight.bin"


def test_a_log_tells_its_site_which_counts_as_if_it_were_typed(flight: str) -> None:
    told, typed = calibration(flight), calibration(f"{flight} --at 43.77,11.26,50 --date 2026-01-08")
    assert told["calibration"]["field_strength_known"] is True
    for name in ("offset", "matrix", "field_strength"):  # to the hours between midnight and the beginning
        np.testing.assert_allclose(told["calibration"][name], typed["calibration"][name], rtol=1e-5)
    assert told["heading_error_deg"]["dip_deg"] == pytest.approx(60.2, abs=0.05)
    said = run(f"calibrate {flight}").stderr
    assert_sentences(said)


def test_the_site_in_a_log_can_be_left_out_and_its_dip_be_replaced(flight: str) -> None:
    out = calibration(f"{flight} --at none")
    assert out["calibration"]["field_strength_known"] is False
    assert abs(out["heading_error_deg"]["dip_deg"]) == 60.0
    steeper = calibration(f"{flight} --dip 70")
    assert abs(steeper["heading_error_deg"]["dip_deg"]) == 70.0
    assert steeper["calibration"]["field_strength_known"] is True


def test_the_dip_of_a_log_is_not_assumed(flight: str) -> None:
    assert "(assumed)" not in run(f"calibrate {flight}").stdout
