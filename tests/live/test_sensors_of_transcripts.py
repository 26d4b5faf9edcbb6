"""Which lines of a wire are readings of one sensor, and which accompany them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.readers.test_lines_between import BESIDE, FIELD, VALUES, printed, read
from tests.readers.test_sensor_words import FIELD as OTHER_FIELD
from tests.readers.test_sensor_words import TEXTS
from tests.sentences import assert_raises

from flinders.errors import NoMagnetometer
from flinders.links.transcript import Transcript

if TYPE_CHECKING:
    from pathlib import Path


FORMS: dict[str, str] = {
    "labels": "X: {:.2f} Y: {:.2f} Z: {:.2f}",
    "a table": "{:.2f},{:.2f},{:.2f}",
    "tuples": "({:.2f}, {:.2f}, {:.2f})",
    "a line for each axis": "X: {:.2f}\nY: {:.2f}\nZ: {:.2f}",
    "a unit for each axis": "Mag X: {:.2f} uT Y: {:.2f} uT Z: {:.2f} uT",
    "time stamps": "14:03:00.250 -> {:.2f},{:.2f},{:.2f}",
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "print.txt"


def test_a_recorder_counts_accompanying_lines_apart() -> None:
    transcript = Transcript("the board", is_framed=True)
    transcript.take("\n".join([*printed("labels", BESIDE["a heading"]), "low battery"]).encode(), at=1.0)
    transcript.end(2.0)
    known = transcript.statistics.as_dict()
    assert (known["readings"], known["accompanying"], known["not_understood"]) == (150, 150, 1)
    assert known["first_not_understood"] == "low battery"


@pytest.mark.parametrize(
    "labels",
    [("Foo:", "Bar:"), ("left:", "right:"), ("IMU[0]:", "IMU[1]:"), ("Mag (u):", "Mag (v):"), ("Unit 1:", "Unit 2:")],
)
def test_equal_axes_under_different_labels_are_no_one_sensor(labels: tuple[str, str], path: Path) -> None:
    lines = [f"{label} {VALUES[0].format(*row)}" for row in FIELD.tolist() for label in labels]
    with assert_raises(NoMagnetometer):
        read(path, lines)
    assert Transcript("the board").take("\n".join([*lines, ""]).encode(), at=1.0).readings is None


@pytest.mark.parametrize("lines", TEXTS.values(), ids=TEXTS)
def test_rows_of_other_sensors_do_not_reach_the_live_page(lines: list[str]) -> None:
    taken = Transcript("the phone").take("\n".join(["", *lines, ""]).encode(), at=1.0)
    assert taken.readings is not None
    np.testing.assert_allclose(taken.readings.field, OTHER_FIELD)
