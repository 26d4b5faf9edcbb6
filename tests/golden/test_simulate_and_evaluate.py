"""What `flinders simulate` writes and `flinders evaluate` prints, to the letter."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tests.golden.sessions import session
from tests.sentences import assert_sentences

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


def test_a_calibration_that_knows_its_errors(golden: Golden) -> None:
    lines = (
        "flinders simulate three-axis -o tumble.csv --seed 7",
        "flinders calibrate tumble.csv -o calibration.json --json",
        "flinders evaluate calibration.json tumble.truth.json",
    )
    shown = session(*lines)
    shown = re.sub(
        r"(?ms)^\$ flinders calibrate.*?(?=^\$)", "$ flinders calibrate tumble.csv -o calibration.json\n…\n", shown
    )
    golden("cli/evaluate.txt", shown)


def test_one_that_does_not() -> None:
    """The field of the motors passes for iron, and no method knows of it."""
    session("flinders simulate three-axis -o flight.csv --motion flight --motor 0.3 --seed 7")
    session("flinders calibrate flight.csv -o calibration.json", code=3)
    shown = session("flinders evaluate calibration.json flight.truth.json", code=4)
    assert re.search(r"^level heading  +6\.2°  +8\.9°  +1\.5°  +1\.7°  +4\.2$", shown, re.MULTILINE)
    assert_sentences(shown)
