"""Readings of an accelerometer in columns without telling names: every command says so, and none calls them good."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences

import flinders

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

UNITS: Final = {
    "g": (1.0, 4), "m/s²": (9.80665, 3), "counts of 1/16384 g": (16384.0, 0), "counts of 1/4096 g": (4096.0, 0),
}  # fmt: skip
"""Length of gravity, and digits."""
FORMS: Final = {
    "tabs": ("", "{}\t{}\t{}"),
    "bare axes": ("x,y,z", "{},{},{}"),
    "time first": ("", "{n} {} {} {}"),
    "labels": ("", "X: {} Y: {} Z: {}"),
    "lists": ("", "[{}, {}, {}]"),
}
NAMED: Final = {"mx": "mx,my,mz", "mag": "mag_x,mag_y,mag_z", "a unit": "x (mG),y (mG),z (mG)"}


def gravity(unit: str) -> Floats:
    """Of an accelerometer that is turned through all directions, with a small bias and noise."""
    noise = np.random.default_rng(4)
    directions = noise.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    length, digits = UNITS[unit]
    found: Floats = (length * (directions + [0.02, -0.03, 0.04] + 0.004 * noise.normal(size=(300, 3)))).round(digits)
    return found


def written(path: Path, unit: str, header: str, form: str) -> Path:
    rows = [form.format(*(f"{value:g}" for value in row), n=n / 50) for n, row in enumerate(gravity(unit))]
    path.write_text("\n".join([*filter(None, [header]), *rows, ""]))
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("unit", UNITS)
def test_it_is_never_good(unit: str, form: str, tmp_path: Path) -> None:
    fit = flinders.fit(written(tmp_path / "log.txt", unit, *FORMS[form]))
    (found,) = (finding for finding in fit.findings if finding.code == "like-gravity")
    assert fit.verdict == "limited"
    assert f"gravity in {unit}" in found.advice
    assert_sentences(found.advice)


@pytest.mark.parametrize("unit", UNITS)
def test_every_command_says_so(unit: str, tmp_path: Path) -> None:
    log, calibration = str(written(tmp_path / "log.txt", unit, *FORMS["tabs"])), str(tmp_path / "calibration.json")
    said = f"gravity in {unit}"
    commands = (
        ("calibrate", log, "-o", calibration, "--report-text", str(tmp_path / "words.txt")),
        ("check", calibration, log),
        ("heading", calibration, log, "--level", "-o", str(tmp_path / "headings.csv")),
        ("apply", calibration, log, "-o", str(tmp_path / "corrected.csv")),
    )
    for words in commands:
        ended = flinders_(*words)
        assert ended.code == 3, words
        assert said in " ".join(f"{ended.out} {ended.err}".split()), words
    assert said in " ".join(flinders_("info", log).out.split())
    page = " ".join((tmp_path / "words.txt").read_text().split())
    assert_sentences(page, about="gravity")


@pytest.mark.parametrize("header", NAMED)
@pytest.mark.parametrize("unit", UNITS)
def test_names_and_units_are_believed(unit: str, header: str, tmp_path: Path) -> None:
    fit = flinders.fit(written(tmp_path / "log.csv", unit, NAMED[header], "{},{},{}"))
    assert "like-gravity" not in {finding.code for finding in fit.findings}


@pytest.mark.parametrize("options", [{"columns": "1,2,3"}, {"unit": "mG"}, {"scale": 0.1}])
@pytest.mark.parametrize("unit", UNITS)
def test_what_is_given_is_believed(unit: str, options: dict[str, Any], tmp_path: Path) -> None:
    samples = flinders.read(written(tmp_path / "log.txt", unit, *FORMS["tabs"]), **options)
    assert "like-gravity" not in {finding.code for finding in flinders.fit(samples).findings}


def test_a_magnetometer_in_columns_without_names_is_taken_for_one(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    np.savetxt(path, 48.0 * gravity("g") + [20.0, -5.0, 3.0], fmt="%.2f")
    assert flinders.fit(path).verdict == "good"
