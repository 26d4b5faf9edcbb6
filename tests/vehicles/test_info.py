"""``flinders info`` of real logs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences

from flinders.cli import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def info(*words: str) -> dict[str, Any]:
    ended = CliRunner().invoke(main, ["info", *words, "--json"])
    assert ended.exit_code == 0, ended.output
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


def test_of_a_log_a_topic_shows_one_magnetometer(recordings: Callable[[str], Path]) -> None:
    path = str(recordings("dronekit_log171_3mags/log171.bin"))
    found = info(path, "--topic", "mag2", "--as-logged")
    assert [(sensor["number"], sensor["name"], sensor["is_as_logged"]) for sensor in found["sensors"]] == [
        (2, "MAG2", True)
    ]
    assert_sentences(found["commands"])
    ended = CliRunner().invoke(main, ["info", path, "--topic", "nonsense"])
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


def test_a_log_of_three_compasses(recordings: Callable[[str], Path]) -> None:
    """Counts, place and stored offsets as the description of the data set has them."""
    found = info(str(recordings("dronekit_log171_3mags/log171.bin")))
    assert [sensor["readings"] for sensor in found["sensors"]] == [2384, 2384, 2383]
    assert found["sensors"][0]["onboard_calibration"].startswith("COMPASS_OFS -97.7916, 118.11, 213.18 mG")
    assert found["position"][:2] == pytest.approx([-35.362, 149.165], abs=1e-3)
    assert found["site"]["model"].startswith("WMM-2015")
