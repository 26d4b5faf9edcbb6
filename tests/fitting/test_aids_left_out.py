"""An aiding sensor with which a fit claims more is left out; beside an attitude a gap in directions limits nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.errors import FitError
from flinders.estimators.aiding import fit_aided
from flinders.fitting import aid_selection
from flinders.fitting.aiding import ROTATION_ALONE, Aiding, AidingSensor
from flinders.geometry.quaternions import from_matrix

if TYPE_CHECKING:
    from flinders import Fit
    from flinders.core.samples import Samples
    from flinders.estimators.aiding import AidedFit


def with_attitude(motion: str, *, yaw_deg: float = 0.0, seed: int = 1) -> Samples:
    """100 s at 6 Hz; the attitude is off by half a degree at each reading, and its yaw swings within 40 s."""
    recording = simulate.tumble(seed, motion=motion, n=600, rate_hz=6.0)
    assert recording.attitudes is not None
    yaw = math.radians(yaw_deg) * math.sqrt(2.0) * np.sin(np.arange(600) * (2.0 * math.pi / 240.0))
    noise = simulate.turns(np.random.default_rng(seed).normal(0.0, math.radians(0.5), (600, 3)))
    logged = simulate.turns(np.outer(yaw, [0.0, 0.0, 1.0])) @ recording.attitudes @ noise
    return replace(recording.samples, attitude=from_matrix(logged))


def sensors_of(fit: Fit) -> tuple[AidingSensor, ...]:
    assert fit.evidence.aiding is not None
    return fit.evidence.aiding.sensors


@pytest.mark.parametrize(("motion", "yaw_deg"), [("flight", 4.0), ("drive", 4.0)])
def test_an_attitude_that_says_less_than_none_is_left_out_and_both_claims_are_said(motion: str, yaw_deg: float) -> None:
    """Of the drive the fit with it would be refused."""
    samples = with_attitude(motion, yaw_deg=yaw_deg)
    alone, aided = flinders.fit(samples), flinders.fit(samples, aiding="attitude")
    npt.assert_array_equal(aided.calibration.offset, alone.calibration.offset)
    npt.assert_array_equal(aided.calibration.matrix, alone.calibration.matrix)
    assert aided.heading_error_deg == alone.heading_error_deg
    assert aided.verdict == alone.verdict == "limited"
    (attitude,) = sensors_of(aided)
    assert not attitude.is_used
    assert_sentences(attitude.reason)
    assert attitude.before_deg == alone.heading_error_deg.worst < attitude.after_deg


@pytest.mark.parametrize("motion", ["flight", "drive"])
def test_beside_an_attitude_a_gap_in_the_directions_limits_nothing(motion: str) -> None:
    fit = flinders.fit(with_attitude(motion), aiding="attitude", target_deg=2.0)
    assert sensors_of(fit)[0].is_used
    assert fit.evidence.coverage.hole_deg > 90.0
    assert fit.verdict == "good"


def test_beside_a_vertical_a_gap_in_the_directions_limits() -> None:
    fit = flinders.fit(with_attitude("swayed"), aiding="tilt")
    assert sensors_of(fit)[0].is_used
    assert [finding.code for finding in fit.findings if finding.severity == "limits"] == ["coverage"]


def test_a_vertical_that_says_less_than_the_gyro_alone_keeps_its_rotation() -> None:
    samples = simulate.tumble(seed=1, motion="swayed", n=1000).samples
    rate, both = flinders.fit(samples, aiding="rate"), flinders.fit(samples, aiding=("rate", "dip"))
    npt.assert_array_equal(both.calibration.offset, rate.calibration.offset)
    assert both.heading_error_deg == rate.heading_error_deg
    assert both.calibration.rotation == "estimated"
    assert sensors_of(both)[1].is_used
    assert sensors_of(both)[1].reason.endswith(ROTATION_ALONE)
    assert both.evidence.aiding is not None
    assert both.evidence.aiding.acceleration_bias is not None


def test_sensors_that_are_left_out_together_are_named_together() -> None:
    whole = Aiding((AidingSensor("rate", True), AidingSensor("dip", True)), rotation=np.eye(3))
    doubtful, refused = (whole.left_out(7.21, 2.2, is_refused=each) for each in (False, True))
    assert [sensor.is_used for sensor in doubtful.sensors] == [False, True]
    assert doubtful.rotation is not None
    assert [sensor.is_used for sensor in refused.sensors] == [False, False]
    assert refused.rotation is None
    assert_sentences(refused.sensors[0].reason)


def test_an_aid_that_leads_to_no_ellipsoid_refuses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_ellipsoid(samples: Samples, terms: tuple[str, ...], **options: Any) -> AidedFit:
        if terms:
            raise FitError("no step leads to a closed surface")
        return fit_aided(samples, terms, **options)

    monkeypatch.setattr(aid_selection, "fit_aided", without_ellipsoid)
    samples = with_attitude("flight")
    fit = flinders.fit(samples, aiding="attitude")
    npt.assert_array_equal(fit.calibration.offset, flinders.fit(samples).calibration.offset)
    assert_sentences(sensors_of(fit)[0].reason)
