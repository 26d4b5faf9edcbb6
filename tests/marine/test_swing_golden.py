"""What `flinders swing` prints, to the letter; docs/cli/ shows these files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from tests.boats import Boat, nmea0183_of, octagon
from tests.golden.sessions import session
from tests.sentences import assert_sentences

from flinders.apps.marine.deviation import fit
from flinders.apps.marine.swing_pages import card
from flinders.geometry.angles import wrap_180

if TYPE_CHECKING:
    from pathlib import Path

    from tests.golden.sessions import Golden


HO226 = "compass,deviation\n0,10.5\n45,20\n90,11.5\n135,-1.2\n180,-5.5\n225,-8\n270,-12.5\n315,-6.8\n"
"""Figure 501 of the Handbook of Magnetic Compass Adjustment."""


def test_the_swing_of_ho226(tmp_path: Path, golden: Golden) -> None:
    (tmp_path / "swing.csv").write_text(HO226, encoding="utf-8")
    golden("cli/swing.txt", session("flinders swing swing.csv --svg curve.svg"))
    golden("cli/swing.svg", (tmp_path / "curve.svg").read_text(encoding="utf-8"))


def test_a_swing_of_five_headings_says_that_nothing_tells_how_good_it_is(tmp_path: Path) -> None:
    (tmp_path / "swing.csv").write_text("compass magnetic\n0 1\n70 74\n140 141\n220 217\n290 287\n", encoding="utf-8")
    shown = session("flinders swing swing.csv --step 45", code=3)
    assert "A                  -0.0430°   compass turned" in shown
    assert " 225.0°      3.1° W           221.9° " in shown
    assert_sentences(" ".join(shown.split()), about="five coefficients")


CORRECTION = "compass,magnetic\n3,359\n85,91\n170,178\n265,267\n"
CHECK = "compass,magnetic\n316,317\n358,0\n42,47\n89,93\n134,135\n177,179\n220,225\n269,273\n"
"""Worksheet 1 of UK CAA CAP 562."""


def test_a_swing_by_a_rule(tmp_path: Path, golden: Golden) -> None:
    (tmp_path / "correction.csv").write_text(CORRECTION, encoding="utf-8")
    (tmp_path / "check.csv").write_text(CHECK, encoding="utf-8")
    golden("cli/swing-checklist.txt", session("flinders swing --standard ac43.13-1b"))
    golden("cli/swing-compensate.txt", session("flinders swing correction.csv --compensate"))
    line = "flinders swing check.csv --standard ac43.13-1b --before correction.csv --certificate card.html"
    golden("cli/swing-standard.txt", session(line))


def test_a_swing_of_a_boat(tmp_path: Path, golden: Golden) -> None:
    boat = Boat.sail(octagon(), np.random.default_rng(11), current=0.4 - 0.2j)
    (tmp_path / "boat.nmea").write_text("\n".join(nmea0183_of(boat)), encoding="utf-8")
    golden("cli/swing-boat.txt", session("flinders swing boat.nmea --reference course --step 45 --target 3"))


def test_the_card_as_a_table(golden: Golden) -> None:
    around = np.arange(0.0, 360.0, 30.0)
    found = fit(around, wrap_180(2.0 * np.sin(np.deg2rad(around)) - 1.0), sigma_deg=0.5)
    golden("cli/swing-card.csv", card(found, 45.0))
