"""How a magnetometer sits on its body: found whichever way that is, and said where it is not known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.estimators.aiding import fit_aided
from flinders.fitting.aid_selection import claim_deg, fit_with_aids
from flinders.fitting.result import Refused
from flinders.geometry.quaternions import from_angles, inverse, rotate_vectors
from flinders.geometry.rotation import rotation_vectors, rotations
from flinders.likelihood.attitude import body_to_world
from flinders.likelihood.joint import find_mounting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.estimators.aiding import AidedFit
    from flinders.fitting.result import Fit

NORTH = np.array([25.0, 0.0, 43.3])


def attitudes(lean: float, n: int = 600) -> Floats:
    """A body that turns all round and leans by so much, rad, over 24 s."""
    time = np.arange(n) / 25.0
    return from_angles(np.stack([lean * np.sin(0.61 * time), lean * np.sin(0.93 * time + 1.0), 0.7 * time], axis=1))


def recorded(
    attitude: Floats, turn: Floats, logged: Floats | None = None, *, seed: int = 1, bias: Floats | None = None
) -> Samples:
    """Readings of a magnetometer that is turned by (3, 3), and what an accelerometer with a bias, m/s², feels."""
    rng = np.random.default_rng(seed)
    n = len(attitude)
    back = inverse(attitude)
    field = rotate_vectors(back, np.tile(NORTH, (n, 1))) @ turn + [10.0, -20.0, 5.0] + rng.normal(0.0, 0.4, (n, 3))
    felt = None
    if bias is not None:
        felt = rotate_vectors(back, np.tile([0.0, 0.0, -9.81], (n, 1))) + bias + rng.normal(0.0, 0.05, (n, 3))
    return Samples.of(field, unit="uT", time=np.arange(n) / 25.0, attitude=logged, acceleration=felt)


@pytest.mark.parametrize("signs", [(1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0)])
def test_an_attitude_finds_a_magnetometer_that_is_turned_by_half_a_turn(signs: tuple[float, ...]) -> None:
    attitude, turn = attitudes(1.2), np.diag(signs)
    found = fit_aided(recorded(attitude, turn, attitude), ("attitude",))
    assert np.rad2deg(np.abs(found.parameters.rotation - turn).max()) < 0.5


def test_of_any_turn_the_start_is_the_truth_without_noise() -> None:
    attitude = body_to_world(attitudes(0.6))
    seen = np.swapaxes(attitude, 1, 2) @ (NORTH / np.linalg.norm(NORTH))
    for vector in np.random.default_rng(3).normal(0.0, 1.5, (20, 3)):
        turn = rotations(vector[np.newaxis])[0]
        found = find_mounting(attitude, seen @ turn, np.eye(3))
        assert np.rad2deg(np.arccos(np.clip((np.trace(found @ turn.T) - 1.0) / 2.0, -1.0, 1.0))) < 20.0


@pytest.mark.parametrize("aid", daily(["tilt", "attitude"]))
def test_an_attitude_from_world_to_body_is_named_and_turns_nothing(aid: str) -> None:
    attitude = attitudes(1.2)
    samples = recorded(attitude, np.eye(3), inverse(attitude))
    fit = flinders.fit(samples, aiding=aid)
    assert fit.verdict == "limited"
    assert "aid-astray" in [finding.code for finding in fit.findings]
    assert fit.calibration.rotation == "symmetric"


def test_a_rotation_that_is_hardly_known_is_said() -> None:
    """An accelerometer of unknown bias that always points the same way, and the same one in a tumble."""
    said = {}
    for lean in (0.2, 6.0):
        fit = flinders.fit(recorded(attitudes(lean), np.eye(3), bias=np.zeros(3)), aiding="dip")
        said[lean] = [finding.code == "rotation-uncertain" for finding in fit.findings].count(True)
    assert said == {0.2: 1, 6.0: 0}


@pytest.mark.parametrize("seed", daily(range(3)))
def test_the_bias_of_an_accelerometer_is_no_rotation(seed: int) -> None:
    """0.3 to 0.5 m/s² lean the vertical by 3°; seeds as stated."""
    bias = np.array([0.5, 0.3, -0.3])
    samples = recorded(attitudes(0.5), np.eye(3), seed=seed, bias=bias)
    _, asked = fit_with_aids(samples, "dip")
    assert asked.acceleration_bias is not None
    assert asked.acceleration_bias_sigma is not None
    assert np.all(np.abs(asked.acceleration_bias - bias) < 3.0 * asked.acceleration_bias_sigma)
    _, told = fit_with_aids(samples, "auto")
    if told.rotation is not None and told.rotation_covariance is not None:
        x, y, z = told.rotation[2, 1], told.rotation[0, 2], told.rotation[1, 0]
        assert np.array([x, y, z]) @ np.linalg.solve(told.rotation_covariance, [x, y, z]) < 16.3


def heading_off_deg(found: AidedFit) -> float:
    """How far off headings of a level body are, rms, of a magnetometer that sits straight on it."""
    headings = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    fields = rotate_vectors(inverse(from_angles(np.outer(headings, [0.0, 0.0, 1.0]))), np.tile(NORTH, (72, 1)))
    seen = (fields + np.array([10.0, -20.0, 5.0]) - found.parameters.offset) @ np.linalg.inv(found.parameters.shape).T
    error = np.exp(1j * (np.arctan2(-seen[:, 1], seen[:, 0]) - headings))
    return float(np.rad2deg(np.sqrt(np.mean(np.angle(error / error.mean()) ** 2))))


@pytest.mark.nightly
def test_the_bias_of_an_accelerometer_bends_no_offset() -> None:
    """The same bias, believed to be 0, leads farther astray than found with the rest, which keeps its claim."""
    off: dict[float, list[tuple[float, float]]] = {0.3: [], 0.0: []}
    for seed in range(6):
        samples = recorded(attitudes(0.5, 1500), np.eye(3), seed=seed, bias=np.array([0.5, 0.3, -0.3]))
        for sigma, errors in off.items():
            found = fit_aided(samples, ("dip",), acceleration_bias=sigma)
            errors.append((heading_off_deg(found), claim_deg(found, 60.0)))
    free, held = (np.array(errors) for errors in off.values())
    assert np.mean(free[:, 0]) < 0.8 * np.mean(held[:, 0])
    assert np.sqrt(np.mean((free[:, 0] / free[:, 1]) ** 2)) < 1.2


def test_a_rotation_is_known_better_where_the_accelerometer_is_calibrated() -> None:
    samples = recorded(attitudes(0.5), np.eye(3), bias=np.zeros(3))
    errors = []
    for sigma in (0.3, 0.0):
        aiding = flinders.fit(
            samples, aiding=flinders.Instruments("dip", acceleration_bias_sigma=sigma)
        ).evidence.aiding
        assert aiding is not None
        errors.append(aiding.alignment_error_deg(60.0) or np.nan)
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("wrong", [-0.1, 3.0, float("nan")])
def test_a_bias_that_no_accelerometer_has_is_refused(wrong: float) -> None:
    with assert_raises(UsageError):
        flinders.fit(
            recorded(attitudes(0.5), np.eye(3), bias=np.zeros(3)),
            aiding=flinders.Instruments("dip", acceleration_bias_sigma=wrong),
        )


@pytest.mark.parametrize("missing", [np.nan, 0.0])
def test_a_vertical_that_is_missing_now_and_then_counts_where_it_is_there(missing: float) -> None:
    samples = recorded(attitudes(0.5), np.eye(3), bias=np.zeros(3))
    assert samples.acceleration is not None
    felt = samples.acceleration.copy()
    felt[::5] = missing
    found, whole = (fit_aided(replace(samples, acceleration=one), ("dip",)) for one in (felt, samples.acceleration))
    sigma = np.sqrt(np.diag(whole.covariance)[:3])
    assert np.all(np.abs(found.parameters.offset - whole.parameters.offset) < 2.0 * sigma)
    assert np.all(np.sqrt(np.diag(found.covariance)[:3]) < 1.5 * sigma)


def survey(gain: float, bias: Sequence[float], seed: int = 1) -> Samples:
    """Thirty poses of twenty readings at rest, by an accelerometer whose x reads too much and whose y too little."""
    rng = np.random.default_rng(seed)
    poses = np.repeat(from_angles(rng.uniform(-np.pi, np.pi, (30, 3))), 20, axis=0)
    samples = recorded(poses, np.eye(3), seed=seed, bias=np.array(bias))
    assert samples.acceleration is not None
    return replace(samples, acceleration=samples.acceleration * [1.0 + gain, 1.0 - gain, 1.0])


def test_gains_of_an_accelerometer_bend_no_rotation() -> None:
    """Two per cent of gains: found, and the rotation within its claim, which is half of what it is without them."""
    samples = survey(0.02, [0.2, 0.0, 0.1])
    found, believed = (fit_aided(samples, ("dip",), acceleration_gain=sigma) for sigma in (0.02, 0.0))
    turned, covariance = rotation_vectors(found.parameters.rotation[np.newaxis])[0], found.rotation_covariance
    assert covariance is not None
    assert believed.rotation_covariance is not None
    assert float(turned @ np.linalg.solve(covariance, turned)) < 3.5**2
    assert np.trace(covariance) < 0.25 * np.trace(believed.rotation_covariance)
    gains = found.parameters.accelerometer[3:6]
    npt.assert_allclose(gains - gains[2], [-0.02, 0.02, 0.0], atol=2e-3)


def test_a_tilt_that_spoils_headings_limits_a_good_compass() -> None:
    """A bias of 0.4 m/s² is 2.3° of tilt, and 4° of heading where the field dips by 60°; ``dip`` takes it off."""
    aiding: dict[str, tuple[float, str]] = {"exact": (0.0, ""), "off": (0.4, ""), "corrected": (0.4, "dip")}
    codes = {}
    for name, (bias, aid) in aiding.items():
        fit = flinders.fit(survey(0.0, [bias, 0.0, 0.0]), aiding=aid)
        codes[name] = [finding.code for finding in fit.findings if finding.code == "tilt-error"]
    assert codes == {"exact": [], "off": ["tilt-error"], "corrected": []}


@pytest.mark.parametrize(("motion", "seed"), [("sweep-xy", 1), ("rocked", 1), ("rocked", 17), ("swayed", 5)])
def test_a_poorly_known_calibration_is_not_blamed_on_the_accelerometer(motion: str, seed: int) -> None:
    """What a level turn leaves out, and what few attitudes leave unknown, bends the dip of a perfect accelerometer."""
    samples = simulate.tumble(seed=seed, motion=motion, n=1500).samples
    assert samples.acceleration is not None
    assert "tilt-error" not in [finding.code for finding in flinders.fit(samples).findings]


def test_a_vertical_that_leans_in_turns_is_left_out() -> None:
    """An aircraft in coordinated turns feels no sideways pull."""
    fit = fitted_anyway(simulate.tumble(seed=1, motion="flight", n=1500).samples)
    assert "leans-in-turns" in [finding.code for finding in fit.findings]
    assert fit.evidence.aiding is not None
    assert not any(sensor.is_used for sensor in fit.evidence.aiding.sensors)


def fitted_anyway(samples: Samples) -> Fit:
    """The fit with ``dip``, refused or not."""
    try:
        return flinders.fit(samples, aiding="dip")
    except Refused as refusal:
        return refusal.fit


@pytest.mark.parametrize("seed", daily(range(3)))
def test_accelerations_that_last_outvote_no_prior(seed: int) -> None:
    """A boat that is pushed to and fro, 0.3 m/s² for seconds: nobody learns the bias of its accelerometer to 0.02."""
    samples = recorded(attitudes(0.15, 1500), np.eye(3), seed=seed, bias=np.zeros(3))
    assert samples.acceleration is not None
    rng = np.random.default_rng(seed)
    pushed = np.apply_along_axis(np.convolve, 0, rng.normal(size=(1500, 3)), np.ones(50) / 50.0, "same")
    found = fit_aided(replace(samples, acceleration=samples.acceleration + 0.3 * pushed / pushed.std()), ("dip",))
    covariance = found.of("accelerometer")
    assert covariance is not None
    sigma = 9.80665 * np.sqrt(np.diag(covariance))[:3]
    assert np.all(sigma < 0.35)
    assert np.all(np.abs(9.80665 * found.parameters.accelerometer[:3]) < 3.0 * sigma)


@pytest.mark.parametrize("seed", daily(range(3)))
def test_a_gyro_that_sits_askew_beside_its_accelerometer_leads_no_rotation_astray(seed: int) -> None:
    """One degree about each axis: axes of the body are those of the accelerometer."""
    true = simulate.tumble(seed=seed, motion="hand", n=1500)
    assert true.samples.rate is not None
    askew = rotations(np.deg2rad([[1.0, -1.0, 1.0]]))[0]
    samples = replace(true.samples, rate=true.samples.rate @ askew)
    found = fit_aided(samples, ("rate", "dip"))
    covariance = found.rotation_covariance
    assert covariance is not None
    turned = found.parameters.rotation
    left = np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
    assert left @ np.linalg.solve(covariance, left) < 16.3
    npt.assert_allclose(np.rad2deg(found.parameters.gyro_turn), [1.0, -1.0, 1.0], atol=0.2)
