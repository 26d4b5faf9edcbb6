"""``flinders swing``: tables of headings, and a recording corrected by its calibration."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.heading_logs import (
    MATRIX,
    OFFSET,
    ZURICH,
    calibrated,
    log_of,
    swinging,
    tumbling,
    with_rotation_error,
    write,
)
from tests.program import Ended, flinders_
from tests.sentences import assert_sentences

from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.fitting.fit_file import load
from flinders.geometry.angles import wrap_180
from flinders.heading.error_propagation import deviation_covariance

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats


def with_iron(log: Floats) -> Floats:
    """The same log with 1 µT of hard iron ahead and 0.5 to port, which is B = 2.29° and C = −1.15°."""
    bent = log.copy()
    bent[:, 1:4] += np.linalg.solve(MATRIX, [1.0, -0.5, 0.0])
    return bent


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with calibration.json, exact and without a covariance, and log.csv of all attitudes."""
    monkeypatch.chdir(tmp_path)
    Calibration(MATRIX, OFFSET, 50.0, True, raw=Unit.of("uT")).save("calibration.json")
    write("log.csv", log_of(tumbling()[1]))
    return tmp_path


STOPS = np.arange(0.0, 360.0, 45.0)
KNOWN = ("--headings", ",".join(f"{stop:g}" for stop in STOPS))


HO226 = "compass,deviation\n0,10.5\n45,20\n90,11.5\n135,1.2W\n180,5.5 W\n225,-8\n270,-12.5\n315,-6.8\n"


def test_the_example_of_ho226_from_a_table(home: Path) -> None:
    told = flinders_("swing", "-", "--json", stdin=HO226).json["deviation"]
    assert [f"{told['coefficients_deg'][name]:.4f}" for name in "ABCDE"] == [
        "1.0000", "11.9397", "7.9598", "5.0000", "1.5000",
    ]  # fmt: skip
    assert told["eight_points_deg"] == {"A": 1.0, "B": 12.0, "C": 8.0, "D": 5.0, "E": 1.5}


@pytest.mark.parametrize(
    "table",
    [
        "compass;magnetic\n0;1\n90;93\n180;182\n270;268\n45;47\n",
        "0 1\n90 93\n180 182\n270 268\n45 47\n",
        "known heading,compass reading\n1,0\n93,90\n182,180\n268,270\n47,45\n",
        "magnetic\tdeviation\n1\t1\n93\t3\n182\t2\n268\t-2\n47\t2\n",
        "Kompass;Compass reading;magnetic °\n0;0;1,0\n90;90;93,0\n180;180;182\n270;270;268\n45;45;47\n",
        "# a swing\ncompass,dev (deg),sigma\n0,1,0.5\n90,3,0.5\n180,2,0.5\n270,-2,0.5\n45,2,0.5\n",
    ],
)
def test_tables_are_read_as_they_are_written(home: Path, table: str) -> None:
    ended = flinders_("swing", "-", "--json", stdin=table)
    found = ended.json["deviation"]["swing"]
    npt.assert_allclose(found["compass_deg"], [0.0, 90.0, 180.0, 270.0, 45.0], atol=1e-9)
    npt.assert_allclose(found["deviation_deg"], [1.0, 3.0, 2.0, -2.0, 2.0], atol=1e-9)
    assert ended.code == (0 if "sigma" in table else 3)


def test_true_headings_become_magnetic_ones(home: Path) -> None:
    table = "compass,true\n" + "".join(f"{angle},{angle + 3.5}\n" for angle in range(0, 360, 45))
    ended = flinders_("swing", "-", "--json", *ZURICH, stdin=table)
    declination = ended.json["site"]["declination_deg"]
    assert ended.json["deviation"]["coefficients_deg"]["A"] == pytest.approx(3.5 - declination)
    assert_sentences(flinders_("swing", "-", stdin=table).err)
    assert_sentences(flinders_("swing", "-", *ZURICH, stdin=HO226).said)


def test_card_and_curve_are_written(home: Path) -> None:
    (home / "swing.csv").write_text(HO226, encoding="utf-8")
    ended = flinders_("swing", "swing.csv", "-o", "card.csv", "--svg", "curve.svg", "--step", "10")
    assert ended.code == 0
    card = Ended(0, (home / "card.csv").read_text(encoding="utf-8"), "").columns
    assert list(card) == ["compass_deg", "deviation_deg", "sigma_deg", "magnetic_deg"]
    assert len(card["compass_deg"]) == 36
    npt.assert_allclose(wrap_180(card["compass_deg"] + card["deviation_deg"] - card["magnetic_deg"]), 0.0, atol=2e-3)
    assert (home / "curve.svg").read_text(encoding="utf-8").count("<circle") == 8
    again = flinders_("swing", "swing.csv", "-o", "card.csv")
    assert again.code == 6
    printed = flinders_("swing", "swing.csv", "-o", "-")
    assert printed.out.startswith("compass_deg,")
    assert "least squares" in printed.err


def test_a_swing_from_a_recording_finds_the_iron_that_is_left(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    clean = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json")
    assert clean.code == 0, clean.err
    assert max(map(abs, clean.json["deviation"]["coefficients_deg"].values())) < 0.2
    assert clean.json["half_turns_pass"] is True
    assert len(clean.json["half_turns"]) == 4

    write("iron.csv", with_iron(swinging(STOPS)))
    iron = flinders_("swing", "calibration.json", "iron.csv", *KNOWN, "--json")
    assert iron.code == 3
    found = iron.json["deviation"]["coefficients_deg"]
    assert (found["B"], found["C"]) == (pytest.approx(2.29, abs=0.2), pytest.approx(-1.15, abs=0.2))
    alone = flinders_("swing", "calibration.json", "iron.csv")
    assert alone.code == 4
    assert "FAILS" in alone.out
    assert "hard iron remains (B +2." in " ".join(alone.out.split())
    assert flinders_("swing", "calibration.json", "iron.csv", "--target", "6").code == 0
    json_told = flinders_("swing", "calibration.json", "iron.csv", "--json").json
    assert json_told["hard_iron_deg"]["B"] == pytest.approx(2.29, abs=0.2)


def test_a_swing_says_what_its_calibration_claims_and_whether_that_holds(home: Path) -> None:
    calibrated(400)
    judged = load("calibration.json")
    assert judged.claim.states_uncertainty
    write("log.csv", swinging(STOPS))
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json["calibration"]
    claimed = deviation_covariance(judged.calibration.ellipsoid, judged.claim.covariance, dip_deg=told["dip_deg"])
    npt.assert_allclose(list(told["sigma_deg"].values()), np.sqrt(np.diag(claimed)), rtol=1e-3)
    assert told["dip_from"] == "measured"
    assert told["p_value"] > 0.01
    page = flinders_("swing", "calibration.json", "log.csv", *KNOWN).out
    assert "claimed" in page
    assert "come or gone" not in page

    write("iron.csv", with_iron(swinging(STOPS)))
    bent = flinders_("swing", "calibration.json", "iron.csv", *KNOWN)
    assert_sentences(" ".join(bent.out.split()), about="B to E")
    assert flinders_("swing", "calibration.json", "iron.csv", *KNOWN, "--json").json["calibration"]["p_value"] < 1e-6


def test_a_rotation_that_is_off_as_it_claims_explains_a_swing(home: Path) -> None:
    """2° about x turn a level compass by up to 3.5°."""
    calibrated(2000)
    write("log.csv", swinging(STOPS))
    with_rotation_error(2.0, 2.0)
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json
    assert abs(told["deviation"]["coefficients_deg"]["C"]) == pytest.approx(3.5, abs=0.2)
    assert told["calibration"]["sigma_deg"]["C"] == pytest.approx(2.0 * math.tan(math.radians(60.0)), rel=0.05)
    assert told["calibration"]["p_value"] > 0.05
    with_rotation_error(0.0, 0.1)
    narrow = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json
    assert narrow["calibration"]["p_value"] < 1e-6


def test_a_calibration_without_uncertainty_claims_nothing_of_a_swing(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    assert flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json["calibration"] is None
    assert "claimed" not in flinders_("swing", "calibration.json", "log.csv", *KNOWN).out


def test_a_curve_that_is_not_known_to_the_target_or_runs_backwards_is_limited(home: Path) -> None:
    wild = "compass,deviation\n0,2\n45,48\n90,71\n135,52\n180,-3\n225,-50\n270,-68\n315,-51\n"
    ended = flinders_("swing", "-", stdin=wild)
    assert ended.code == 3
    page = " ".join(ended.out.split())
    assert "2.13° (1 σ)" in page
    assert_sentences(page.partition("LIMITED")[2])
    assert flinders_("swing", "-", "--sigma", "2", stdin=HO226).code == 3
    assert flinders_("swing", "-", "--sigma", "2", "--target", "2", stdin=HO226).code == 0


def test_a_compass_that_turns_the_other_way_makes_no_curve(home: Path) -> None:
    turned = "".join(f"{-heading % 360},{heading}\n" for heading in range(0, 360, 45))
    ended = flinders_("swing", "-", stdin="compass,magnetic\n" + turned)
    assert (ended.code, ended.out) == (4, "")
    assert_sentences(ended.err)


def test_known_headings_may_be_true_ones(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json", *ZURICH).json
    assert told["deviation"]["coefficients_deg"]["A"] == pytest.approx(-told["site"]["declination_deg"], abs=0.2)


SWINGS: dict[str, tuple[str, str, int]] = {
    "an empty table": ("-", "", 5),
    "a header alone": ("-", "compass,magnetic\n", 5),
    "other columns": ("-", "speed,depth\n1,2\n", 5),
    "no text": ("noise.bin", "", 5),
    "words": ("-", "compass,magnetic\n0,north\n", 5),
    "three columns": ("-", "1 2 3\n", 5),
    "four headings": ("-", "0 1\n90 92\n180 180\n270 268\n", 4),
    "a step that does not go round": ("- --step 7", HO226, 2),
    "headings for a table": ("- --headings 0,90", HO226, 2),
    "three files": ("a b c", "", 2),
    "no file": ("", "", 2),
    "a calibration alone": ("calibration.json", "", 2),
    "headings that are none": ("calibration.json log.csv --headings N,E", "", 2),
    "a heading that goes round twice": ("calibration.json log.csv --headings 0,45,900", "", 2),
    "a digit too many": ("-", HO226.replace("90,", "900,"), 2),
    "too many headings": ("calibration.json log.csv --headings 1,2,3,4,5,6", "", 4),
    "no half turn": ("calibration.json log.csv", "", 4),
    "a place without headings": ("calibration.json log.csv --at 47,8 --date 2026", "", 2),
    "a card without headings": ("calibration.json turn.csv -o card.csv", "", 2),
    "two results to one place": ("- --json -o -", HO226, 2),
    "card and curve in one": ("- --svg x -o x", HO226, 2),
    "over the table": ("swing.csv -o swing.csv --force", "", 2),
    "sigma of nothing": ("- --sigma 0", HO226, 2),
}


@pytest.mark.parametrize("name", SWINGS)
def test_what_is_no_swing_is_said(home: Path, name: str) -> None:
    words, table, code = SWINGS[name]
    (home / "swing.csv").write_text(HO226, encoding="utf-8")
    write("turn.csv", swinging(np.array([0.0, 180.0])))
    (home / "noise.bin").write_bytes(bytes(range(256)) * 4)
    ended = flinders_("swing", *words.split(), stdin=table)
    assert ended.code == code
    assert not ended.out or "--json" in words
    assert_sentences(ended.said)
    assert not (home / "card.csv").exists()
