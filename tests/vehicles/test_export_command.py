"""``flinders export`` to autopilots."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from tests.sentences import assert_sentences
from tests.targets.test_export_command import export, made

from flinders.core import calibration_file


@pytest.mark.parametrize("target", ["ardupilot", "px4", "px4-shell"])
def test_what_comes_on_top_of_the_onboard_calibration_does_not_replace_it(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a log taken as logged: the autopilot would put these numbers in the place of those that were in force."""
    monkeypatch.chdir(tmp_path)
    raw = calibration_file.SourceFile(name="flight.bin", sha256="0" * 64, bytes=1, rows=1)
    for as_logged, code in ((False, 0), (True, 4)):
        file = calibration_file.SourceFile(name=raw.name, sha256=raw.sha256, bytes=1, rows=1, as_logged=as_logged)
        made_from = calibration_file.ProvenanceRecord(
            flinders="0.1.0", date=datetime(2026, 1, 1, tzinfo=UTC), files=(file,)
        )
        found = made(np.eye(3), [1, 2, 3]).to_document(provenance=made_from)
        Path("logged.json").write_text(calibration_file.dumps(found), encoding="utf-8")
        ended = export("--for", target, "logged.json")
        assert ended.exit_code == code, ended.output
    assert_sentences(ended.stderr)
    assert export("--for", "c", "logged.json").exit_code == 0


def test_a_target_that_is_nearly_named_is_meant(tmp_path: Path) -> None:
    made(np.eye(3), [1, 2, 3]).save(tmp_path / "calibration.json")
    ended = export("--for", "px5", str(tmp_path / "calibration.json"))
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)
