"""Targets and calibration files, written by the page's JavaScript and by the library: the same, byte for byte."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.javascript import run
from tests.program import flinders_

from flinders import Calibration, Fit, simulate
from flinders.apps.live.standalone import targets
from flinders.core.calibration_file import dumps
from flinders.core.disturbance import Disturbance
from flinders.core.units import Unit
from flinders.errors import FlindersError
from flinders.fitting import calibrate
from flinders.fitting.fit_file import load
from flinders.targets import find

if TYPE_CHECKING:
    from pathlib import Path

ABOUT: Final = (
    "from board.csv — “µ”  24 °C */ ?? -- /* x",
    "the calibration is good: headings good to 0.21° (1 σ, worst), also where a sentence is too long",
)
EXPORT: Final = """
const { exported, NotExportable } = await load("targets.js");
return given.calibrations.map((calibration) => Object.fromEntries(given.names.map((name) => {
    try {
        return [name, exported(given, name, calibration)];
    } catch (error) {
        if (!(error instanceof NotExportable)) throw error;
        return [name, { refusal: error.message }];
    }
})));
"""


def calibrations() -> dict[str, Calibration]:
    """Calibrations in each unit, and of numbers that are easily written differently."""
    rng = np.random.default_rng(1)
    eye = np.eye(3)
    made = {
        "the identity": Calibration(eye, np.zeros(3), 50.0, field_strength_known=True, raw=Unit.of("uT")),
        "whole numbers": Calibration(eye, np.array([100.0, -200, 300]), 480.0, raw=Unit.of("counts")),
        "ties and small numbers": Calibration(1.001953125 * eye, np.array([1.001953125, 1e-5, -1e-7]), 50.0),
        "long numbers": Calibration(eye, np.array([31072.3, -20.5, 1.25]), 12345.678, raw=Unit.of("counts")),
        "beyond autopilots": Calibration(9.0 * eye, np.array([1.0, 2, 3]), 50.0, raw=Unit.of("uT")),
        "a small field": Calibration(eye, np.array([0.001, 2e-5, 0]), 0.05, raw=Unit.of("T")),
        "counts of a known scale": symmetric(rng, Unit.of("counts", 0.15), known=False),
    }
    for unit in ("uT", "mG", "G", "nT", "mT", "T", "counts"):
        for known in (False, True):
            made[f"{unit} {known}"] = symmetric(rng, Unit.of(unit), known=known)
    return made


def symmetric(rng: np.random.Generator, raw: Unit, *, known: bool) -> Calibration:
    """A calibration as a fit has it."""
    half = 0.05 * rng.normal(size=(3, 3))
    return Calibration(np.eye(3) + half + half.T, 40 * rng.normal(size=3), 45.0, field_strength_known=known, raw=raw)


CASES: Final = calibrations()


def in_page(calibration: Calibration) -> dict[str, Any]:
    """A calibration as the page has it."""
    return {
        "matrix": calibration.matrix.tolist(),
        "offset": calibration.offset.tolist(),
        "fieldStrength": calibration.field_strength,
        "fieldStrengthKnown": calibration.field_strength_known,
        "unit": calibration.unit,
        "raw": {"unit": calibration.raw.name, "scale": calibration.raw.scale},
        "about": ABOUT,
    }


@pytest.fixture(scope="module")
def by_page() -> dict[str, dict[str, Any]]:
    """What the page writes of each calibration, for each target."""
    given = {"targets": targets.data(), "names": targets.NAMES, "calibrations": list(map(in_page, CASES.values()))}
    return dict(zip(CASES, run(EXPORT, given), strict=True))


@pytest.mark.parametrize("target", targets.NAMES)
@pytest.mark.parametrize("name", CASES)
def test_a_target_is_the_same_to_the_byte(name: str, target: str, by_page: dict[str, Any]) -> None:
    """Or both refuse it."""
    found = by_page[name][target]
    try:
        export = find(target).render(CASES[name], about=ABOUT)
    except FlindersError:
        assert found.get("refusal"), found
        return
    assert found.get("text") == export.text, found.get("refusal")
    assert (found["checked"], found["warnings"]) == (export.checked, list(export.warnings))
    assert found["filename"] == f"{target}{find(target).suffix}"
    assert base64.b64decode(found["binary_base64"] or "") == (export.data or b"")


def test_a_file_of_the_page_is_read_by_the_library_and_the_command_line(tmp_path: Path) -> None:
    fit = calibrate.fit(simulate.tumble(seed=1).samples)
    document = json.loads(_saved(fit, tmp_path / "own.json"))
    saved = run(
        'return (await load("targets.js")).calibrationFile(given, given.calibration, given);',
        {
            "targets": targets.data(),
            "calibration": in_page(fit.calibration),
            "fit": document["fit"],
            "provenance": document["provenance"],
        },
    )
    path = tmp_path / "page.json"
    path.write_text(saved, encoding="utf-8")
    loaded = load(path)
    assert loaded.calibration.isclose(fit.calibration, tolerance=0.0)
    assert (loaded.verdict, loaded.evidence.method) == (fit.verdict, fit.evidence.method)
    assert loaded.heading_error_deg.worst == fit.heading_error_deg.worst
    assert "good" in flinders_("show", str(path)).out


def test_a_file_of_the_library_is_read_by_the_page(tmp_path: Path) -> None:
    fit = calibrate.fit(simulate.tumble(seed=2).samples)
    text = _saved(fit, tmp_path / "own.json")
    found = run(
        'return (await load("targets.js")).readCalibration(given.text, given);',
        {"targets": targets.data(), "text": text},
    )
    own = in_page(fit.calibration)
    del own["about"]
    assert {name: found[name] for name in own} == own
    assert found["fit"]["heading_error_deg"]["worst"] == fit.heading_error_deg.worst


def test_a_calibration_that_follows_columns_is_named_by_them_on_the_page() -> None:
    """As one that follows a current, it is not gone on from there (`unfit` of session.js)."""
    wheel, current = (Disturbance(name, np.array([0.1, 0.0, 0.0]), highest=9.0) for name in ("/joint.wheel", "current"))
    calibration = replace(Calibration.identity(field_strength=50.0), disturbances=(wheel, current))
    found = run(
        'return (await load("targets.js")).readCalibration(given.text, given);',
        {"targets": targets.data(), "text": dumps(calibration.to_document())},
    )
    assert found["disturbances"] == ["current", "/joint.wheel"]


UNIT: Final = {"matrix": np.eye(3).tolist(), "offset": [0, 0, 0], "field_strength": 50, "unit": "uT"}
DAMAGED: Final = {
    "hello": "it is no JSON",
    "null": "it is no JSON",
    '{"a": 1}': "no calibration file of Flinders",
    '{"flinders": "calibration", "schema": 9, "provenance": {"flinders": "9.1"}}': "Flinders 9.1 or newer",
    '{"flinders": "calibration", "schema": 1}': "its calibration is damaged",
    json.dumps(
        {"flinders": "calibration", "schema": 1, "calibration": {**UNIT, "matrix": 3 * [[1, 0, 0]]}}
    ): "be inverted",
}
"""Texts that are no calibration file for the page, and what is said of them."""


def test_other_files_are_refused_with_advice() -> None:
    words = run(
        """
const { readCalibration } = await load("targets.js");
return given.texts.map((text) => {
    try {
        return readCalibration(text, given);
    } catch (error) {
        return error.message;
    }
});
""",
        {"targets": targets.data(), "texts": list(DAMAGED)},
    )
    for (text, expected), found in zip(DAMAGED.items(), words, strict=True):
        assert expected in found, (text, found)


def _saved(fit: Fit, path: Path) -> str:
    fit.save(path)
    return path.read_text(encoding="utf-8")
