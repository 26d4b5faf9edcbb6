"""A fit is the same after its file: what is kept comes back, and what needs the readings says so."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import flinders
from flinders import simulate
from flinders.core.calibration_file import dumps, loads
from flinders.errors import NeedsRecording
from flinders.fitting.result import Fit
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
    "imported": lambda: Fit.of(flinders.Calibration(np.eye(3), np.array([1.0, 2.0, 3.0]), 50.0)),
}


@pytest.mark.parametrize("name", FITS)
def test_a_fit_is_loaded_and_written_again_to_the_byte(name: str, tmp_path: Path) -> None:
    fit = FITS[name]()
    fit.save(tmp_path / "first.json")
    Fit.load(tmp_path / "first.json").save(tmp_path / "second.json")
    assert (tmp_path / "first.json").read_bytes() == (tmp_path / "second.json").read_bytes()


@pytest.mark.parametrize("name", FITS)
def test_a_loaded_fit_says_what_the_fit_did(name: str) -> None:
    fit = FITS[name]()
    loaded = Fit.from_document(loads(dumps(fit.to_document())))
    assert (loaded.verdict, loaded.method, loaded.claim.plane) == (fit.verdict, fit.method, fit.claim.plane)
    assert [finding.code for finding in loaded.findings] == [finding.code for finding in fit.findings]
    assert repr(loaded) == repr(fit)
    if fit.claim.states_uncertainty:
        assert loaded.claim.tilted_error(10.0).worst == pytest.approx(fit.claim.tilted_error(10.0).worst, rel=1e-6)
        assert loaded.claim.attitude_limit_deg == pytest.approx(fit.claim.attitude_limit_deg, rel=1e-6)


def test_what_needs_the_readings_of_a_loaded_fit_names_the_recording() -> None:
    fit = FITS["all attitudes"]()
    loaded = Fit.from_document(fit.to_document())
    assert loaded.coverage.fraction == fit.coverage.fraction
    looks: tuple[Callable[[Fit], Any], ...] = (
        lambda one: one.coverage.counts, lambda one: one.coverage.readings,
        lambda one: one.coverage.raw_strength(one.calibration.ellipsoid),
    )  # fmt: skip
    for look in looks:
        look(fit)
        with pytest.raises(NeedsRecording, match=r"keeps no readings.*give the recording too"):
            look(loaded)


def test_a_pickled_fit_counts_directions_and_takes_no_readings_along() -> None:
    fit = flinders.fit(simulate.tumble(seed=1, n=20_000).samples)
    pickled = pickle.dumps(fit)
    loaded = pickle.loads(pickled)
    assert len(pickled) < 20_000
    assert loaded.coverage.as_dict() == fit.coverage.as_dict()
    np.testing.assert_array_equal(loaded.coverage.counts, fit.coverage.counts)
    np.testing.assert_allclose(
        loaded.coverage.raw_strength(loaded.calibration.ellipsoid),
        fit.coverage.raw_strength(fit.calibration.ellipsoid),
        rtol=1e-12,
    )


def test_a_calibration_that_says_nothing_of_itself_is_limited() -> None:
    imported = FITS["imported"]()
    assert (imported.verdict, imported.claim.states_uncertainty, imported.findings) == ("limited", False, ())
    assert Fit.from_document(imported.to_document()).verdict == "limited"


def test_numbers_that_nobody_stated_are_null_in_json() -> None:
    imported = FITS["imported"]().as_dict()
    assert (imported["noise"], imported["covariance"], imported["heading_error_deg"]) == (None, None, None)
    fit = FITS["all attitudes"]()
    silent = replace(fit, claim=replace(fit.claim, heading_error_deg=HeadingError(np.nan, np.nan, np.nan)))
    assert silent.as_dict()["heading_error_deg"] is None


def test_a_fit_has_five_values_of_at_most_a_dozen_fields() -> None:
    fit = FITS["all attitudes"]()
    values = [getattr(fit, each.name) for each in fields(fit)]
    assert len(values) == 5
    assert max(len(fields(value)) for value in values[1:]) <= 12
