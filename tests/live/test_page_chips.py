"""A chip that somebody chooses on the page without a program: its count makes microtesla of the columns."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Final

import numpy as np
from tests.javascript import run
from tests.worlds import table_text

import flinders
from flinders.apps.live.standalone import lines
from flinders.apps.live.standalone.package import chip_settings
from flinders.core.chips import find_chip

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM: Final = """
const { readLog } = await load("lines.js");
const content = Uint8Array.from(atob(given.content), (letter) => letter.charCodeAt(0));
const { field, unit, raw } = readLog(given, "log.csv", content, given.choice);
return { field: [...field], unit, raw };
"""


def test_the_count_of_a_chosen_chip_is_the_scale(tmp_path: Path) -> None:
    counts = np.random.default_rng(2).integers(-500, 500, (60, 6)).astype(float)
    path = tmp_path / "six.csv"
    path.write_text(table_text("a,b,c,d,e,f", counts), encoding="utf-8")
    scale = dict(chip_settings())["HMC5883L ±1.3 G"]
    choice = {"field": [3, 4, 5], "unit": "counts", "scale": scale}
    content = base64.b64encode(path.read_bytes()).decode()
    page = run(PROGRAM, {"lines": lines.data(), "content": content, "choice": choice})
    expected = flinders.read(path, columns="d,e,f", unit="counts", scale=scale)
    np.testing.assert_allclose(page["field"], expected.field.ravel(), rtol=1e-12)
    assert page["unit"] == "uT"
    assert page["raw"] == {"unit": "counts", "scale": scale}


def test_the_page_lists_usual_settings_of_chips_that_read_around_zero() -> None:
    listed = dict(chip_settings())
    assert listed["QMC5883L ±8 G"] == find_chip("QMC5883L").settings[1].lsb_ut
    assert "MMC5983MA 18 bits" not in listed
    assert any("MMC5983MA 18 bits" in name for name in listed)
    assert "HMC5883L ±8.1 G" not in listed
