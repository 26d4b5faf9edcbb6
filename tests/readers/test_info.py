"""`flinders info` says what is in a recording: numbers are those that were put in."""

from __future__ import annotations

import json
import shlex
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats


def info(*words: str) -> dict[str, Any]:
    ended = CliRunner().invoke(main, ["info", *words, "--json"])
    assert ended.exit_code == 0, ended.output
    found: dict[str, Any] = json.loads(ended.stdout)
    return found


@pytest.fixture
def field() -> Floats:
    return simulate.tumble(seed=6).samples.field.round(3)


@pytest.fixture
def bench(tmp_path: Path, field: Floats) -> Path:
    """At 50 Hz, with a gap of 3 s, ten repeats, and a clock that goes back once."""
    time = np.arange(len(field)) / 50.0
    time[1000:] += 3.0
    time[2000] -= 0.5
    readings = field.copy()
    readings[500:510] = readings[499]
    path = tmp_path / "bench.npz"
    np.savez(path, t=time, mag_uT=readings, acc=np.ones_like(field))
    return path


def test_the_numbers_are_those_of_the_recording(bench: Path, field: Floats) -> None:
    found = info(str(bench))
    (sensor,) = found["sensors"]
    assert sensor["readings"] == len(field)
    assert sensor["repeats"] == 10
    assert sensor["backward_steps"] == 1
    assert sensor["longest_gap_s"] == pytest.approx(3.02)
    assert sensor["rate_hz"] == pytest.approx(50.0, rel=1e-3)
    assert sensor["seconds"] == pytest.approx(len(field) / 50 + 2.98)
    np.testing.assert_allclose(sensor["lowest"], field.min(axis=0))
    np.testing.assert_allclose(sensor["highest"], field.max(axis=0))
    assert sensor["auxiliary"] == ["time", "acceleration"]
    assert sensor["coverage"] > 0.95
    assert found["bytes"] == bench.stat().st_size


def test_the_strength_is_that_of_the_truth_and_stands_beside_the_model(bench: Path) -> None:
    """It is the size of the ellipsoid, by whatever method: soft iron makes it another one than the field's."""
    found = info(str(bench), "--at", "43.77,11.26", "--date", "2026-06-01")
    (sensor,) = found["sensors"]
    assert sensor["strength"] == pytest.approx(
        flinders.fit(flinders.open_recording(bench)).calibration.ellipsoid.radius, rel=1e-3
    )
    assert found["site"]["strength"] == pytest.approx(47.46, abs=0.01)
    shown = CliRunner().invoke(main, ["info", str(bench), "--at", "43.77,11.26", "--date", "2026-06-01", "--grid"])
    assert_sentences(shown.stdout)
    assert f"{sensor['strength'] / 47.46:.2f} of the field there" in shown.stdout
    assert max(map(len, shown.stdout.partition("next")[0].splitlines())) <= 80


def test_the_day_may_come_from_the_clock_of_a_table(field: Floats, tmp_path: Path) -> None:
    path = tmp_path / "phone.csv"
    rows = ("".join(f",{axis}" for axis in row) for row in field.tolist())
    body = "".join(f"{1_780_000_000_000 + 20 * n}{row}\n" for n, row in enumerate(rows))
    path.write_text(f"timestamp,mag_x_uT,mag_y_uT,mag_z_uT\n{body}")
    found = info(str(path), "--at", "43.77,11.26")
    assert found["start"] == "2026-05-28 20:26:40"
    assert found["site"]["year"] == pytest.approx(2026 + 147 / 365)


def test_the_proposed_command_works(bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (command,) = info(str(bench))["commands"]
    ended = CliRunner().invoke(main, shlex.split(command)[1:])
    assert ended.exit_code in {0, 3}, ended.output
    assert (tmp_path / "calibration.json").exists()


@pytest.mark.parametrize(("unit", "factor"), [("uT", 1.0), ("mG", 10.0), ("G", 0.01), ("nT", 1000.0)])
def test_the_unit_is_a_remark_where_the_strength_tells(unit: str, factor: float, field: Floats, tmp_path: Path) -> None:
    """A strength is no proof: counts of 0.15 µT have that of milligauss."""
    path = tmp_path / "bare.npy"
    np.save(path, field * factor)
    found = info(str(path))
    assert found["commands"] == [f"flinders calibrate {path} -o calibration.json"]
    assert found["sensors"][0]["notes"][0].startswith(f"as {unit} ")
    assert_sentences(found["sensors"][0]["notes"][0])
    for said in (unit, "counts"):
        known = info(str(path), "--unit", said)
        assert known["commands"] == [f"flinders calibrate {path} --unit {said} -o calibration.json"]
        assert known["sensors"][0]["notes"] == []


def test_the_proposed_command_has_the_options_that_were_given(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(bench.parent)
    bench.rename("-bench.npz")
    given = "--columns mag_uT.x,mag_uT.y,mag_uT.z --unit uT --axes x,-y,-z --from 5 --to 40.25"
    ended = CliRunner().invoke(main, ["info", "--json", *given.split(), "--", "-bench.npz"])
    (command,) = json.loads(ended.stdout)["commands"]
    assert command == f"flinders calibrate ./-bench.npz {given} -o calibration.json"
    ended = CliRunner().invoke(main, shlex.split(command)[1:])
    assert ended.exit_code in {0, 3}, ended.output


def test_what_is_odd_is_said(field: Floats, tmp_path: Path) -> None:
    stale = np.repeat(field[:1000], 3, axis=0)
    stuck = stale.copy()
    stuck[:, 2] = 7.0
    clipped = np.clip(stale, -1e9, np.sort(stale[:, 0])[-400])
    for name, readings, says in (
        ("stale", stale, "67% of the readings repeat the one before"),
        ("stuck", stuck, "z never changes"),
        ("clipped", clipped, "the sensor was at its limit"),
        ("strong", 9 * stale, "has another strength"),
    ):
        np.save(tmp_path / f"{name}.npy", readings)
        ended = CliRunner().invoke(main, ["info", str(tmp_path / f"{name}.npy"), "--unit", "uT"])
        assert ended.exit_code == 0, ended.output
        assert says in " ".join(ended.stdout.split()), ended.stdout


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("nix.csv", 5),
        ("bench.npz --date 2026-01-01", 2),
        ("bench.npz --grid", 2),
        ("bench.npz --at 91,0 --date 2026-01-01", 2),
        ("bench.npz --at 43,11", 2),
        ("bench.npz --columns a,b,c", 2),
        ("bench.npz --from 900", 2),
        ("bench.npz --unit mG", 2),
        ("bench.npz --topic x", 2),
        ("bench.npz --as-logged", 2),
        ("", 2),
    ],
)
def test_what_cannot_be_told_is_said(words: str, code: int, bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(bench.parent)
    ended = CliRunner().invoke(main, ["info", *words.split()])
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.stderr)
    assert ended.stdout == ""
