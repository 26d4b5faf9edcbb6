"""The engine renews a calibration as its formulas say, and compares two as `flinders.compare`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import TUMBLED_SENSOR

import flinders
from flinders import simulate
from flinders.comparison.comparison import compare
from flinders.fitting.refreshing import earlier_record
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.likelihood import magnitude
from flinders.native.engine import engine
from flinders.native.layouts import enum_value
from flinders.summary.pooling import p_value_of

MOVED = np.array([8.0, -5.0, 3.0])
TUMBLE = simulate.tumble(seed=3, sensor=TUMBLED_SENSOR)
EARLIER = flinders.fit(TUMBLE.samples)


def wobble(seed: int = 4, motion: str = "wobble", n: int = 500, moved: float = 1.0) -> simulate.Simulated:
    """Seconds after a battery was moved."""
    sensor = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + moved * MOVED)
    return simulate.tumble(seed=seed, motion=motion, n=n, sensor=sensor)


def test_a_shape_is_known_as_well_as_it_is_claimed() -> None:
    ellipsoid, covariance = EARLIER.calibration.ellipsoid, EARLIER.claim.covariance
    earlier = engine().make_earlier(
        ellipsoid.centre, ellipsoid.shape, covariance, strength_ratio=0.8, soft_iron_sigma=0.005
    )
    entries, radius = 0.8 * upper_entries(ellipsoid.shape), ellipsoid.radius
    expected = 0.64 * (EARLIER.claim.covariance[3:, 3:] + np.square(1e-4 * radius) * np.eye(6))
    expected += np.square(0.01) * np.outer(entries, entries)
    expected += np.square(0.005 * 0.8 * radius) * np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    npt.assert_allclose(earlier["parameters"], [*ellipsoid.centre, *entries], rtol=1e-12)
    npt.assert_allclose(earlier["covariance"].reshape(9, 9)[3:, 3:], expected, rtol=1e-9, atol=1e-12)
    assert np.isinf(earlier["covariance"].reshape(9, 9)[:3, :3].diagonal()).all()


@pytest.mark.parametrize("motion", ["wobble", "level"])
def test_a_fit_with_a_known_shape_is_at_the_maximum_of_the_posterior(motion: str) -> None:
    samples, earlier = wobble(motion=motion).samples, earlier_record(EARLIER)
    record = engine().refresh(samples.field, earlier, robust=0, bias_correction=0)
    information = np.linalg.inv(earlier["covariance"].reshape(9, 9)[3:, 3:])

    def cost(parameters: np.ndarray) -> float:
        distances = magnitude.distances(samples.field, Ellipsoid.of_parameters(parameters))
        left = parameters[3:] - earlier["parameters"][3:]
        return float(distances @ distances / record["noise"] ** 2 + left @ information @ left)

    at = np.concatenate([record["centre"], record["shape"]])
    values, axes = np.linalg.eigh(record["textbook"].reshape(9, 9))
    steps = 0.3 * (axes * np.sqrt(values.clip(min=0.0))).T
    assert all(cost(at + sign * step) > cost(at) - 0.01 for step in steps for sign in (1.0, -1.0))


def test_what_is_known_of_all_nine_parameters_counts() -> None:
    samples, whole = wobble().samples, flinders.fit(wobble(seed=5, motion="hand", n=3000).samples).claim
    expected = np.concatenate([whole.ellipsoid.centre, upper_entries(whole.ellipsoid.shape)])
    known: dict[str, Any] = {
        "is_informed": 1,
        "expected": expected,
        "information": np.linalg.inv(whole.covariance).ravel(),
    }
    both, alone = engine().fit(samples.field, **known), engine().refresh(samples.field, earlier_record(EARLIER))
    sigma = np.sqrt(np.diag(whole.covariance))
    assert np.all(np.abs(both["centre"] - expected[:3]) < 3.0 * sigma[:3])
    assert np.all(np.sqrt(both["covariance"][::10]) < 1.2 * sigma)
    assert both["level_worst_deg"] < alone["level_worst_deg"]


def test_the_chance_of_a_contradiction_is_that_of_the_formula() -> None:
    earlier = earlier_record(EARLIER)
    freer = engine().allow_change(earlier)
    known, prior = (each["covariance"].reshape(9, 9)[3:, 3:] for each in (earlier, freer))
    rng = np.random.default_rng(1)
    for scale in (0.2, 1.0):
        root = rng.normal(size=(9, 9))
        textbook = np.linalg.inv(scale * root @ root.T + np.pad(np.linalg.inv(prior), (3, 0)))
        covariance = 1.3 * textbook
        shape = earlier["parameters"][3:] + rng.multivariate_normal(np.zeros(6), known)
        finer = np.linalg.inv(np.linalg.cholesky(prior))
        a, precision = textbook[3:, 3:], finer.T @ finer
        left = np.eye(6) - a @ precision
        spread = left @ known @ left.T + covariance[3:, 3:] - a @ precision @ a
        shares, directions = np.linalg.eigh(np.eye(6) - finer @ a @ finer.T)
        onto = directions[:, shares > 0.1].T @ finer
        moved = onto @ (shape - earlier["parameters"][3:])
        square = float(moved @ np.linalg.solve(onto @ spread @ onto.T, moved))
        chance = engine().soft_iron_p_value(earlier, symmetric_matrix(shape), textbook, covariance)
        assert chance == pytest.approx(p_value_of(square, len(onto)), rel=1e-6)
    assert (
        engine().soft_iron_p_value(earlier, symmetric_matrix(shape), np.pad(prior, (3, 0)), np.pad(prior, (3, 0)))
        == 1.0
    )


@pytest.mark.parametrize("moved", [0.0, 1.0, 10.0, -25.0])
def test_a_refresh_finds_the_offset_however_far_it_was_moved(moved: float) -> None:
    made = wobble(moved=moved)
    record = engine().refresh(made.samples.field, earlier_record(EARLIER))
    sigma = np.sqrt(record["covariance"].reshape(9, 9).diagonal()[:3])
    assert np.all(np.abs(record["centre"] - made.sensor.offset) < 4.0 * sigma)
    assert record["soft_iron_p_value"] > 0.001
    assert record["sources"] == enum_value("REFRESHED")


def test_outliers_do_not_bend_a_refresh() -> None:
    made = simulate.tumble(seed=4, motion="wobble", n=500, sensor=TUMBLED_SENSOR, outliers=0.04)
    record = engine().refresh(made.samples.field, earlier_record(EARLIER))
    sigma = np.sqrt(record["covariance"].reshape(9, 9).diagonal()[:3])
    assert record["rejected"] > 10
    assert np.all(np.abs(record["centre"] - made.sensor.offset) < 4.0 * sigma)


def test_too_few_readings_and_readings_at_rest_are_refused() -> None:
    earlier, samples = earlier_record(EARLIER), wobble().samples
    assert engine().refresh(samples.field[:19], earlier)["status"] == enum_value("TOO_FEW")
    still = samples.field[0] + 0.1 * np.random.default_rng(1).normal(size=(100, 3))
    assert engine().refresh(still, earlier)["status"] == enum_value("UNMOVED")
    assert 0.1 < engine().turn_deg(still, EARLIER.calibration.ellipsoid.shape) < 1.0


@pytest.mark.parametrize("strengths", [(None, None), (50.0, 48.0)])
def test_two_calibrations_are_as_far_apart_as_flinders_compare_says(strengths: tuple[float | None, ...]) -> None:
    first, second = (
        flinders.fit(
            simulate.tumble(seed=seed, sensor=TUMBLED_SENSOR, n=400, field_strength=strength or 50.0).samples,
            site=None if strength is None else flinders.Site(strength=strength),
        )
        for seed, strength in zip((1, 2), strengths, strict=True)
    )
    expected = compare(first, second, dip_deg=-35.0)
    calibrated = [
        (fit.claim.ellipsoid.centre, fit.claim.ellipsoid.shape, fit.claim.claimed_covariance, strength or 0.0)
        for fit, strength in zip((first, second), strengths, strict=True)
    ]
    found = engine().compare(calibrated[0], calibrated[1], dip_deg=-35.0)
    heading = expected.heading_difference_deg
    assert expected.chi_square is not None
    assert expected.p_value is not None
    npt.assert_allclose(
        [found[name] for name in ("rms_deg", "worst_deg", "chi_square", "freedom", "p_value")],
        [heading.rms, heading.worst, expected.chi_square, expected.freedom, expected.p_value],
        rtol=1e-8,
    )
    assert expected.claimed_deg is not None
    assert found["sigma_deg"] == pytest.approx(expected.claimed_deg.worst, rel=1e-8)
    assert found["bound_deg"] == pytest.approx(expected.claimed_bound_deg, rel=1e-8)
