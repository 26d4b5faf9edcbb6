"""When a claim has doubled: the law of the walk, agreement with the engine, files, and `flinders check` of a file."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.worlds import write_field

import flinders
from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.offset_walk import PRIOR_WALK, Walk
from flinders.errors import UsageError
from flinders.fitting.good_until import MAX_S, GoodUntil, good_until
from flinders.fitting.result import bare_fit, with_walk
from flinders.workflows.aging import age_of
from flinders.workflows.online import OnlineCalibration

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.fitting.result import Fit

positive = st.floats(0.01, 10.0)


@pytest.fixture(scope="module")
def fit() -> Fit:
    return flinders.fit(simulate.tumble(seed=1).samples)


@given(positive, positive, positive)
def test_the_claim_has_doubled_after_the_time_that_is_stated(claim_deg: float, field: float, rate: float) -> None:
    until = GoodUntil(
        claim_deg, 10.0 * field, Walk.from_rate(rate), "prior", Walk(rate, rate / 3.0, 3.0 * rate), "prior"
    )
    for seconds, each in ((until.seconds, rate), (until.earliest_s, until.walk.high)):
        is_told = seconds < MAX_S
        assert not is_told or until.claim_deg_after(seconds, each) == pytest.approx(2.0 * claim_deg, rel=1e-9)
    assert until.temperature_change_kelvin is not None
    warmed = math.degrees(rate * until.temperature_change_kelvin / (10.0 * field))
    assert math.hypot(claim_deg, warmed) == pytest.approx(2.0 * claim_deg, rel=1e-9)


@given(positive, positive)
def test_a_unit_that_walks_twice_as_fast_is_good_for_a_quarter_of_the_time(claim_deg: float, rate: float) -> None:
    slow, fast = (
        GoodUntil(claim_deg, 25.0, Walk.from_rate(each), "history", None, "prior").seconds
        for each in (rate, 2.0 * rate)
    )
    assert slow == pytest.approx(4.0 * fast, rel=1e-9)


def test_the_target_is_reached_later_than_the_double_of_a_small_claim(fit: Fit) -> None:
    until = good_until(fit)
    assert until is not None
    assert until.target_s is not None
    assert until.target_s > until.seconds
    assert until.claim_deg_after(until.target_s) == pytest.approx(fit.claim.target_deg, rel=1e-9)


def test_the_usual_walk_is_that_of_a_calibration_that_goes_on(fit: Fit) -> None:
    online = OnlineCalibration(fit, at=0.0)
    assert online.state.walk == pytest.approx(PRIOR_WALK.rate * online.state.radius, rel=0.01)


def test_counts_are_judged_as_microtesla_of_a_usual_field_are() -> None:
    field = simulate.tumble(seed=2).samples.field
    microtesla, counts = (flinders.fit(flinders.Samples.of(field * f, unit=u)) for f, u in ((1, "uT"), (20, "counts")))
    first, second = good_until(microtesla), good_until(counts)
    assert first is not None
    assert second is not None
    assert second.seconds == pytest.approx(first.seconds, rel=1e-3)
    scale = microtesla.calibration.ellipsoid.radius / 50.0
    assert first.temperature_change_kelvin is not None
    assert second.temperature_change_kelvin == pytest.approx(first.temperature_change_kelvin / scale, rel=1e-3)


def test_a_fit_that_follows_the_temperature_says_how_far_it_reaches() -> None:
    drift = simulate.ThermalDrift([0.3, -0.2, 0.1], kelvin=15.0)
    samples = simulate.tumble(seed=3, disturbances=[drift]).samples
    followed = good_until(flinders.fit(samples, disturbances=["temperature"]))
    alone = good_until(flinders.fit(simulate.tumble(seed=3).samples))
    assert followed is not None
    assert alone is not None
    assert (followed.temperature_by, alone.temperature_by) == ("followed", "prior")
    assert followed.temperature_change_kelvin is not None
    assert followed.temperature_change_kelvin > 5.0


def test_what_claims_nothing_is_good_for_no_stated_time() -> None:
    assert good_until(bare_fit(Calibration.identity(field_strength=50.0))) is None
    with pytest.raises(UsageError):
        age_of(bare_fit(Calibration.identity(field_strength=50.0)), datetime(2026, 5, 1, tzinfo=UTC))


def test_a_file_keeps_the_walk_of_its_unit(fit: Fit, tmp_path: Path) -> None:
    known = with_walk(fit, Walk(0.01, 0.008, 0.0125))
    known.save(tmp_path / "known.json")
    loaded = flinders.load(tmp_path / "known.json")
    assert loaded.provenance.walk == known.provenance.walk
    record = json.loads((tmp_path / "known.json").read_text())["fit"]["good_until"]
    assert record["by"] == "history"
    until = good_until(loaded)
    assert until is not None
    assert record["doubled_hours"] == pytest.approx(until.seconds / 3600.0, rel=5e-3)
    fit.save(tmp_path / "usual.json")
    assert json.loads((tmp_path / "usual.json").read_text())["fit"]["good_until"]["by"] == "prior"


def test_age_alone_shows_no_fault(fit: Fit) -> None:
    made = datetime(2026, 5, 1, tzinfo=UTC)
    until = good_until(fit)
    assert until is not None
    ages = (made + timedelta(seconds=share * until.good_s) for share in (0.0, 0.99, 1.01, 1e4))
    answers = [age_of(fit, at, since=made).answer for at in ages]
    assert answers == ["holds", "holds", "cannot-tell", "cannot-tell"]


@pytest.fixture
def calibrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_field(tmp_path / "tumble.csv", simulate.tumble(seed=4).samples.field)
    assert flinders_("calibrate", "tumble.csv", "-o", "calibration.json").code == 0
    return tmp_path


def test_check_answers_for_a_calibration_alone(calibrated: Path) -> None:
    today = flinders_("check", "calibration.json", "--json")
    assert (today.code, today.json["answer"]) == (0, "holds")
    later = flinders_("check", "calibration.json", "--date", "2100-01-01", "--json")
    assert (later.code, later.json["answer"]) == (3, "cannot-tell")
    assert later.json["claim_deg"] > 2.0 * later.json["claimed_deg"]
    assert flinders_("check", "calibration.json", "--date", "soon").code == 2
    assert_sentences(flinders_("check", "calibration.json", "--date", "1999-01-01").err)
    assert flinders_("check", "calibration.json", "tumble.csv", "--date", "2100-01-01").code == 2


def test_a_clock_of_the_recording_is_when_the_claim_was_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    field = simulate.tumble(seed=4).samples.field
    time = datetime(2026, 3, 1, 12, tzinfo=UTC).timestamp() + np.arange(len(field)) / 50.0
    rows = np.column_stack([time, field])
    np.savetxt("dated.csv", rows, delimiter=",", header="time_s,mag_x_uT,mag_y_uT,mag_z_uT", comments="", fmt="%.3f")
    assert flinders_("calibrate", "dated.csv", "-o", "dated.json").code == 0
    assert json.loads((tmp_path / "dated.json").read_text())["provenance"]["recorded"] == "2026-03-01T12:00:00Z"
    aged = flinders_("check", "dated.json", "--date", "2026-03-02T12:00", "--json").json
    assert aged["age_s"] == 86400.0


def test_a_history_of_the_unit_tells_its_walk(calibrated: Path) -> None:
    lines = [
        {
            "kind": "state", "event": None, "time_s": 1.7e9 + 14400.0 * k,
            "offset": (20.0 + 0.05 * math.sin(9.0 * k), 1.0 + 0.1 * (k % 3), 0.0), "offset_sigma": (0.05, 0.05, 0.05),
            "radius": 50.0, "unit": "uT", "heading_error_deg": 0.5,
        }
        for k in range(40)
    ]  # fmt: skip
    (calibrated / "unit.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    known = flinders_("check", "calibration.json", "--history", "unit.jsonl", "--json").json
    assert known["good_until"]["by"] == "history"
    again = flinders_("calibrate", "tumble.csv", "--history", "unit.jsonl", "-o", "known.json", "--json")
    assert again.json["good_until"]["by"] == "history"
    assert "walk" in json.loads((calibrated / "known.json").read_text())["fit"]
    (calibrated / "short.jsonl").write_text(json.dumps(lines[0]) + "\n")
    assert flinders_("check", "calibration.json", "--history", "short.jsonl").code == 2
