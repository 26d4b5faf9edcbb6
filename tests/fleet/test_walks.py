"""Histories of many units: which walks faster, which moved, and nothing of those that did neither."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

from flinders.apps.fleet.walks import UnitWalk, walks_of
from flinders.errors import DocumentError, UsageError

BEGUN_S = 1.79e9
WALK = 0.1


def write_history(
    name: str, seed: int, *, n: int = 60, walk: float = WALK, moved: int | None = None, unit: str = "uT"
) -> None:
    """Lines of ``flinders watch --json`` of a unit that is estimated each four hours by a filter."""
    rng = np.random.default_rng(seed)
    truth, at, variance, lines = np.array([12.0, -30.0, 8.0]), np.array([12.0, -30.0, 8.0]), 0.01, []
    for number in range(n):
        truth = truth + rng.normal(0.0, 2.0 * walk, 3) + (np.array([4.0, 3.0, -2.0]) if number == moved else 0.0)
        variance += 4.0 * walk**2 + (100.0 if number == moved else 0.0)
        gain = variance / (variance + 0.01)
        at, variance = at + gain * (truth + rng.normal(0.0, 0.1, 3) - at), variance * (1.0 - gain)
        known = {"offset": at.tolist(), "offset_sigma": [math.sqrt(variance)] * 3, "radius": 50.0, "unit": unit}
        event = {"kind": "event", "event": "moved"} if number == moved else {"kind": "state", "event": None}
        lines.append({**event, "time_s": BEGUN_S + 14400.0 * number, **known, "heading_error_deg": 0.4})
    Path(name).write_text("".join(json.dumps(line) + "\n" for line in lines))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten units: the third walks five times as fast, the fifth moved, the last has hardly begun."""
    folder = tmp_path_factory.mktemp("fleet")
    for place in range(10):
        write_history(
            str(folder / f"U{place}.jsonl"), place, walk=5.0 * WALK if place == 3 else WALK,
            moved=30 if place == 5 else None, n=6 if place == 9 else 60,
        )  # fmt: skip
    return folder


def test_the_unit_that_walks_faster_and_the_one_that_moved_are_told(fleet: Path) -> None:
    rows: list[UnitWalk] = []
    found = walks_of([fleet], each=rows.extend)
    assert found.states == {"moved": 1, "faster": 1, "steady": 7, "short": 1}
    assert [one.unit for one in found.listed][:2] == ["U5", "U3"]
    assert [one.unit for one in rows] == [f"U{place}" for place in range(10)]
    known = [one for one in rows if one.state in ("steady", "moved")]
    assert sum(one.walk_low < WALK < one.walk_high for one in known) >= len(known) - 1
    assert found.typical_walk_deg == pytest.approx(math.degrees(WALK * math.sqrt(24.0) / 25.0), rel=0.15)
    assert 1.0 <= found.walk_spread < 1.3
    (step,) = found.steps
    assert step.unit == "U5"
    np.testing.assert_allclose(step.offset_change, [4.0, 3.0, -2.0], atol=1.0)
    assert step.before_s < BEGUN_S + 14400.0 * 30 <= step.after_s
    assert step.worst_deg == pytest.approx(math.degrees(5.0 / 25.0), rel=0.25)
    assert rows[5].moved == 1
    assert math.isnan(rows[9].walk)


def test_units_that_walk_alike_are_steady(tmp_path: Path) -> None:
    for place in range(12):
        write_history(str(tmp_path / f"U{place}"), 50 + place)
    found = walks_of([tmp_path])
    assert found.states == {"moved": 0, "faster": 0, "steady": 12, "short": 0}
    assert found.step_count == 0


def test_one_unit_has_its_offset_over_time(fleet: Path) -> None:
    ended = flinders_("drift", str(fleet / "U0.jsonl"))
    assert ended.code == 0
    assert "2026-09-2" in ended.out
    assert " ± " in ended.out
    told = flinders_("drift", str(fleet / "U0.jsonl"), "--json").json
    assert len(told["history"]["time_s"]) == told["listed"][0]["estimates"] == 60
    assert np.shape(told["history"]["offset"]) == np.shape(told["history"]["sigma"]) == (60, 3)


def test_the_command_writes_table_and_report(fleet: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    paths = list(map(str, sorted(fleet.iterdir())))
    out, report = tmp_path / "walks.parquet", tmp_path / "walks.html"
    ended = flinders_("drift", *paths, "--output", str(out), "--report", str(report))
    assert ended.code == 3
    assert "U3    faster" in ended.out
    table = parquet.read_table(out).to_pylist()
    assert [row["state"] for row in table].count("steady") == 7
    assert table[9]["walk"] is None
    assert len(table[0]["offset"]) == 3
    text = report.read_text(encoding="utf-8")
    assert "2 units to look at" in text
    assert text.count('<svg class="figure"') == 10
    assert "://" not in text


@pytest.mark.parametrize(
    "words",
    [
        ("U0.jsonl", "table.parquet"),
        ("U0.jsonl", "--against", "previous"),
        ("U0.jsonl", "--batch", "^U"),
    ],
)
def test_what_is_no_history_is_refused(words: tuple[str, ...], fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(fleet)
    ended = flinders_("drift", *words)
    assert ended.code == 2, ended.err
    assert_sentences(ended.said)


def test_a_target_that_is_none_and_a_folder_without_histories(tmp_path: Path) -> None:
    with assert_raises(UsageError):
        walks_of([tmp_path], target_deg=0.0)
    with assert_raises(DocumentError):
        walks_of([tmp_path])
