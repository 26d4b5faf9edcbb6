"""A fit is the same after its file: what is kept comes back, and what needs the readings says so."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders import simulate
from flinders.core.calibration_file import dumps, loads
from flinders.errors import NeedsRecording
from flinders.fitting.fit_file import fit_from, load
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Fit, bare_fit, document_of
from flinders.heading.error_propagation import HeadingError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MOTORS = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3], amperes=20.0)
FITS: dict[str, Callable[[], Fit]] = {
    "all attitudes": lambda: flinders.fit(simulate.tumble(seed=1).samples),
    "level turn": lambda: flinders.fit(simulate.tumble(seed=1, motion="level").samples),
    "one plane": lambda: flinders.fit(
        simulate.tumble(seed=1, motion="sweep-yz").samples, method=flinders.estimators.Ellipse(plane="yz")
    ),
    "motors": lambda: flinders.fit(
        simulate.tumble(seed=3, n=1500, disturbances=[MOTORS]).samples, disturbances=("current",)
    ),
    "imported": lambda: bare_fit(flinders.Calibration(np.eye(3), np.array([1.0, 2.0, 3.0]), 50.0)),
}


@pytest.mark.parametrize("name", FITS)
def test_a_fit_is_loaded_and_written_again_to_the_byte(name: str, tmp_path: Path) -> None:
    fit = FITS[name]()
    fit.save(tmp_path / "first.json")
    load(tmp_path / "first.json").save(tmp_path / "second.json")
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "second.json").read_bytes()


@pytest.mark.parametrize("name", FITS)
def test_a_loaded_fit_says_what_the_fit_did(name: str) -> None:
    fit = FITS[name]()
    loaded = fit_from(loads(dumps(document_of(fit))))
    assert (loaded.verdict, loaded.evidence.method, loaded.claim.plane) == (
        fit.verdict,
        fit.evidence.method,
        fit.claim.plane,
    )
    assert [finding.code for finding in loaded.findings] == [finding.code for finding in fit.findings]
    assert repr(loaded) == repr(fit)
    if fit.claim.states_uncertainty:
        assert loaded.claim.tilted_error(10.0).worst == pytest.approx(fit.claim.tilted_error(10.0).worst, rel=1e-6)
        assert loaded.claim.attitude_limit_deg == pytest.approx(fit.claim.attitude_limit_deg, rel=1e-6)


def test_what_needs_the_readings_of_a_loaded_fit_names_the_recording() -> None:
    fit = FITS["all attitudes"]()
    loaded = fit_from(document_of(fit))
    assert loaded.evidence.coverage.fraction == fit.evidence.coverage.fraction
    looks: tuple[Callable[[Fit], Any], ...] = (
        lambda one: one.evidence.coverage.counts, lambda one: one.evidence.coverage.readings,
        lambda one: one.evidence.coverage.raw_strength(one.calibration.ellipsoid),
    )  # fmt: skip
    for look in looks:
        look(fit)
        with assert_raises(NeedsRecording):
            look(loaded)


def test_a_pickled_fit_counts_directions_and_takes_no_readings_along() -> None:
    fit = flinders.fit(simulate.tumble(seed=1, n=20_000).samples)
    pickled = pickle.dumps(fit)
    loaded = pickle.loads(pickled)
    assert len(pickled) < 20_000
    assert loaded.evidence.coverage.as_dict() == fit.evidence.coverage.as_dict()
    np.testing.assert_array_equal(loaded.evidence.coverage.counts, fit.evidence.coverage.counts)
    np.testing.assert_allclose(
        loaded.evidence.coverage.raw_strength(loaded.calibration.ellipsoid),
        fit.evidence.coverage.raw_strength(fit.calibration.ellipsoid),
        rtol=1e-12,
    )


def test_a_calibration_that_says_nothing_of_itself_is_limited() -> None:
    imported = FITS["imported"]()
    assert (imported.verdict, imported.claim.states_uncertainty, imported.findings) == ("limited", False, ())
    assert fit_from(document_of(imported)).verdict == "limited"


def test_numbers_that_nobody_stated_are_null_in_json() -> None:
    imported = json_of(FITS["imported"]())
    assert (imported["noise"], imported["covariance"], imported["heading_error_deg"]) == (None, None, None)
    fit = FITS["all attitudes"]()
    silent = replace(fit, claim=replace(fit.claim, heading_error_deg=HeadingError(np.nan, np.nan, np.nan)))
    assert json_of(silent)["heading_error_deg"] is None


def test_a_fit_has_five_values_of_at_most_a_dozen_fields() -> None:
    fit = FITS["all attitudes"]()
    values = [getattr(fit, each.name) for each in fields(fit)]
    assert len(values) == 5
    assert max(len(fields(value)) for value in values[1:]) <= 12


def test_ten_names_of_a_fit_are_offered_by_the_tab_key() -> None:
    assert len([name for name in dir(FITS["all attitudes"]()) if not name.startswith("_")]) == 10
