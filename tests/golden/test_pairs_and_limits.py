"""What `flinders` prints of pairs of set and reset, and of the limits of a disturbed reading, to the letter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tests.golden.sessions import assert_sessions_are_real, session
from tests.worlds import TUMBLED_SENSOR

from flinders import simulate

if TYPE_CHECKING:
    import pytest
    from tests.golden.sessions import Golden

OWN_OFFSET = np.array([150.0, -80.0, 150.0])
HEADER = "t_s," + ",".join(f"mag_{axis}_{polarity}_uT" for polarity in ("set", "reset") for axis in "xyz")


def test_pairs_of_set_and_reset(golden: Golden) -> None:
    field = simulate.tumble(seed=3, n=600, motion="uniform", sensor=TUMBLED_SENSOR).samples.field
    pairs = np.column_stack([0.1 * np.arange(len(field)), OWN_OFFSET + field, OWN_OFFSET - field])
    np.savetxt("pairs.csv", pairs, fmt="%.2f", delimiter=",", header=HEADER, comments="")
    golden("cli/set-reset.txt", session("flinders calibrate pairs.csv -o calibration.json"))


def test_limits_of_a_disturbed_reading(golden: Golden) -> None:
    shown = session(
        "flinders simulate three-axis -o tumble.csv",
        "flinders calibrate tumble.csv --with dip -o calibration.json",
        "flinders export --for c calibration.json -o compass.h",
    )
    golden("cli/disturbed-readings.txt", shown)
    header = Path("compass.h").read_text("utf-8")
    assert "flinders_strength_is_off" in header
    assert "flinders_dip_is_off" in header


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("set-reset.md", request)
    assert_sessions_are_real("disturbed-readings.md", request)
