"""``flinders simulate two-axis`` as a user meets it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences


def names() -> list[str]:
    return sorted(path.name for path in Path().iterdir())


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_help_has_an_example() -> None:
    assert re.search(r"Example:\n  +flinders simulate", flinders_("simulate", "two-axis", "--help").out)


@pytest.mark.parametrize("there", ["a.csv", "a.truth.json"])
def test_nothing_is_overwritten_without_force_and_nothing_is_left_half_done(there: str) -> None:
    Path(there).write_text("mine", encoding="utf-8")
    refused = flinders_("simulate", "two-axis", "-o", "a.csv")
    assert refused.code == 6
    assert f"{there} exists" in refused.err
    assert names() == [there]
    assert Path(there).read_text(encoding="utf-8") == "mine"
    assert flinders_("simulate", "two-axis", "-o", "a.csv", "--force").code == 0
    assert names() == ["a.csv", "a.truth.json"]


@pytest.mark.parametrize(
    "words",
    [
        "--truth t.json",
        "--scale 1,0",
        "--scale 1,nan",
        "--points 5",
        "--polar -",
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(words: str) -> None:
    ended = flinders_("simulate", "two-axis", *words.split())
    assert ended.code == 2
    assert_sentences(ended.err)
    assert ended.err.count("\n") == 1
    assert names() == []


def test_a_compass_is_recovered_within_its_noise() -> None:
    found = flinders_("simulate", "two-axis", "--seed", "4", "--json").json
    recovery = found["recovery"]
    assert [recovery[name]["true"] for name in ("scale_x", "offset_y", "skew_deg")] == [1.1, -5.0, 4.0]
    for name, tolerance in {
        "scale_x": 0.01,
        "scale_y": 0.01,
        "offset_x": 0.3,
        "offset_y": 0.3,
        "skew_deg": 1.0,
    }.items():
        assert recovery[name]["estimate"] == pytest.approx(recovery[name]["true"], abs=tolerance)
    assert found["polar"]["heading_deg"] == [10.0 * step for step in range(36)]
    assert max(map(abs, found["polar"]["corrected_error_deg"])) < max(map(abs, found["polar"]["raw_error_deg"])) / 8


def test_without_noise_the_recovery_is_exact() -> None:
    words = "simulate two-axis --noise 0 --scale 1.3,0.7 --offset=-20,40 --skew -9 --dip 30 --json"
    for name, pair in flinders_(*words.split()).json["recovery"].items():
        if not name.startswith("scale"):
            assert pair["estimate"] == pytest.approx(pair["true"], abs=1e-6), name
    recovery = flinders_(*words.split()).json["recovery"]
    assert recovery["scale_x"]["estimate"] / recovery["scale_y"]["estimate"] == pytest.approx(1.3 / 0.7)


def test_a_hopeless_swing_is_shown_written_and_refused() -> None:
    ended = flinders_("simulate", "two-axis", "-o", "swing.csv", "--noise", "8")
    assert (ended.code, names()) == (4, ["swing.csv", "swing.truth.json"])
    assert "skew" in ended.out
    assert_sentences(ended.err)
    assert flinders_("simulate", "two-axis", "--noise", "8", "--json").json["verdict"] == "refused"


def test_a_swing_is_calibrated_and_evaluated_like_any_other() -> None:
    assert flinders_("simulate", "two-axis", "-o", "swing.csv", "--polar", "rose.csv").code == 0
    rose = np.loadtxt("rose.csv", delimiter=",", skiprows=1)
    assert rose.shape == (36, 7)
    assert flinders_("calibrate", "swing.csv", "--method", "level", "-o", "c.json").code == 3
    told = flinders_("evaluate", "c.json", "swing.truth.json", "--json", "--target", "3")
    assert told.code == 0
    assert told.json["heading_error_deg"]["worst"] < 3
