"""Calibration files that each release wrote are read by all later ones, with the same numbers.

A release adds its file here, with a row in `WANTED`; neither is changed afterwards.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest

from flinders.core import calibration_file
from flinders.core.calibration import Calibration

FILES = Path(__file__).with_name("files")

WANTED = {
    "calibration-0.1.0.json": {
        "offset": [-12.5, 103.25, 7.0],
        "matrix": [[1.02, 0.015, -0.03125], [0.015, 0.97, 0.0], [-0.03125, 0.0, 1.0125]],
        "field_strength": 49.8,
        "field_strength_known": False,
        "unit": "uT",
        "rotation": "symmetric",
    },
}


def test_every_file_of_the_archive_has_its_numbers_in_the_table() -> None:
    assert sorted(path.name for path in FILES.glob("calibration-*.json")) == sorted(WANTED)


@pytest.mark.parametrize("name", WANTED)
def test_a_file_of_an_earlier_release_gives_the_same_correction(name: str) -> None:
    calibration = Calibration.load(FILES / name)
    assert calibration.as_dict() == WANTED[name]
    raw = np.array([10.0, -20.0, 30.0])
    npt.assert_allclose(calibration.apply(raw), np.array(WANTED[name]["matrix"]) @ (raw - WANTED[name]["offset"]))


@pytest.mark.parametrize("name", WANTED)
def test_a_file_of_an_earlier_release_can_be_written_again_without_loss(name: str) -> None:
    kept = calibration_file.read(FILES / name)
    assert calibration_file.loads(calibration_file.dumps(kept)) == kept


def test_the_first_release_kept_its_fit_and_provenance() -> None:
    kept = calibration_file.read(FILES / "calibration-0.1.0.json")
    assert kept.fit is not None
    assert kept.provenance is not None
    assert (kept.fit.method, kept.fit.samples, kept.fit.verdict) == ("auto", 3000, "limited")
    assert kept.provenance.files[0].rows == 3004
    assert (kept.raw.unit, kept.raw.scale, kept.raw.axes, kept.raw.sensor) == ("mG", 0.1, "x,-y,-z", "hull 7")
