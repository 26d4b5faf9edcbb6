"""A gyro, or what stands beside it, that is not as the fit believes: it is named, and not followed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly

import flinders
from flinders import simulate
from flinders.diagnostics.instruments import gyro_contradiction, gyro_scale_mistake, wrong_dip_mistake
from flinders.errors import FitError, UsageError
from flinders.estimators.aiding import MAX_SCALE_SIGMAS, fit_aided, fit_parameters
from flinders.fitting.aid_selection import fit_with_aids
from flinders.geometry.rotation import rotations
from flinders.likelihood.gyro import SCALE_SIGMA, bridge_gaps
from flinders.likelihood.site_field import Site
from flinders.readers._resample import TimeSeries

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.simulate import Simulated


def swayed(seed: int = 1, n: int = 1000) -> Simulated:
    return simulate.tumble(seed=seed, motion="swayed", n=n)


def with_rate(samples: Samples, rate: Floats) -> Samples:
    return replace(samples, rate=rate)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [1, nightly(4)])
def test_scales_that_run_away_are_held(seed: int) -> None:
    """In coordinated turns a vertical that leans makes a gyro that hardly turns likely: 1,000 µT of offset error."""
    flight = simulate.tumble(seed=seed, motion="flight", n=1500)
    found = fit_aided(flight.samples, ("rate", "dip"))
    assert found.gyro_scale_error > MAX_SCALE_SIGMAS * SCALE_SIGMA
    assert "gyro_scale" not in found.layout
    error = np.abs(found.parameters.offset - flight.sensor.offset)
    assert float(error.max()) < 2.0
    assert np.all(error < 4.0 * np.sqrt(np.diag(found.covariance)[:3]))


def test_a_vertical_that_leans_is_named_beside_a_sound_gyro_whatever_their_order() -> None:
    flight = simulate.tumble(seed=1, motion="flight", n=1500).samples
    for aiding in (("rate", "dip"), ("dip", "rate")):
        found, told = fit_with_aids(flight, aiding)
        assert found.aiding == ("rate",)
        assert [(one.code, one.aid, one.drops) for one in told.mistakes] == [("leans-in-turns", "dip", True)]


def test_a_gyro_a_fifth_too_strong_is_named_and_the_fit_made_without_it() -> None:
    true = swayed()
    strong = with_rate(true.samples, 1.25 * np.asarray(true.samples.rate))
    found, told = fit_with_aids(strong, ("rate", "dip"))
    assert found.aiding == ("dip",)
    [mistake] = told.mistakes
    assert (mistake.code, mistake.aid, mistake.drops) == ("gyro-scales", "rate", True)
    assert mistake.number == pytest.approx(0.2, abs=0.03)
    by_itself, _ = fit_with_aids(true.samples, "dip")
    npt.assert_allclose(found.parameters.offset, by_itself.parameters.offset, atol=0.02)


@pytest.mark.parametrize("aid", ["dip", "tilt", "attitude"])
def test_a_column_of_nothing_is_no_fault_of_the_program(aid: str) -> None:
    true = swayed(n=200)
    nothing = np.zeros((200, 3)) if aid == "dip" else np.full((200, 4), np.nan)
    empty = replace(true.samples, **{"acceleration" if aid == "dip" else "attitude": nothing})  # type: ignore[arg-type]
    with assert_raises(FitError):
        fit_aided(empty, (aid,))


def test_short_gaps_of_the_gyro_are_bridged_and_counted() -> None:
    true = swayed()
    rate = np.asarray(true.samples.rate).copy()
    rate[::5] = np.nan
    found, told = fit_with_aids(with_rate(true.samples, rate), "rate")
    assert [(one.code, one.drops) for one in told.mistakes] == [("gyro-gaps", False)]
    assert_sentences(told.mistakes[0].words)  # the first has nothing before it
    whole, _ = fit_with_aids(true.samples, "rate")
    sigma = np.sqrt(np.diag(whole.covariance)[:3])
    assert np.all(np.abs(found.parameters.offset - whole.parameters.offset) < sigma)
    codes = {
        finding.code: finding.severity
        for finding in flinders.fit(with_rate(true.samples, rate), aiding="rate").findings
    }
    assert codes["gyro-gaps"] == "note"


def test_long_gaps_stay() -> None:
    time, rate = np.arange(20.0), np.ones((20, 3))
    rate[4:8] = np.nan
    filled, count = bridge_gaps(time, rate)
    assert count == 0
    npt.assert_array_equal(filled, rate)
    rate[4] = 1.0
    assert bridge_gaps(time, rate)[1] == 3


@pytest.mark.parametrize("limit", [0.3, 0.6])
def test_a_gyro_at_its_limit_is_named_and_not_used(limit: float) -> None:
    true = swayed()
    clipped = with_rate(true.samples, np.clip(np.asarray(true.samples.rate), -limit, limit))
    found, told = fit_with_aids(clipped, ("rate", "dip"))
    assert found.aiding == ("dip",)
    assert [(one.code, one.drops) for one in told.mistakes] == [("gyro-clipped", True)]


@pytest.mark.nightly
@pytest.mark.parametrize("step", [1e-3, 0.02])
def test_a_coarse_gyro_is_not_at_its_limit(step: float) -> None:
    """In steps of a thousandth, or of a fiftieth of a rad/s, as small ones have them on a wide range."""
    for seed in range(4):
        true = swayed(seed, 600)
        coarse = with_rate(true.samples, np.round(np.asarray(true.samples.rate) / step) * step)
        assert fit_with_aids(coarse, "rate")[1].mistakes == ()


def test_where_another_fit_stood_is_as_good_a_start_as_any() -> None:
    true = swayed()
    cold, near = fit_aided(true.samples, ("rate", "dip")), fit_aided(true.samples, ())
    warm = fit_aided(true.samples, ("rate", "dip"), near=near)
    sigma = np.sqrt(np.diag(cold.covariance))
    npt.assert_allclose(warm.parameters.offset, cold.parameters.offset, atol=float(0.02 * sigma[:3].min()))
    quick = fit_parameters(true.samples, ("rate", "dip"), rotation=None, near=cold)
    assert np.all(np.abs(quick.offset - cold.parameters.offset) < sigma[:3])


def test_a_known_gyro_has_its_scales_held() -> None:
    true = swayed()
    free, held = (
        flinders.fit(true.samples, aiding=flinders.Instruments("rate", gyro_scale_sigma=scale)) for scale in (0.02, 0.0)
    )
    assert held.heading_error_deg.worst < 0.9 * free.heading_error_deg.worst
    for wrong in (-0.1, 0.6, np.nan):
        with assert_raises(UsageError):
            flinders.fit(true.samples, aiding=flinders.Instruments("rate", gyro_scale_sigma=wrong))


@pytest.mark.parametrize(("seen", "words"), [(-47.0, "wrong sign"), (-66.0, "upside down"), (50.0, "check place")])
def test_a_dip_of_the_other_sign_is_no_other_place(seen: float, words: str) -> None:
    assert words in wrong_dip_mistake(seen, Site(None, 66.0)).words


@pytest.mark.nightly
def test_a_reversed_accelerometer_is_named_where_only_its_rotation_is_kept() -> None:
    true = simulate.tumble(seed=3, n=800, dip_deg=60.0, imu=simulate.Imu(acceleration_noise=0.5))
    turned = -np.asarray(true.samples.acceleration) @ rotations(np.array([[0.06, -0.05, 0.08]]))[0].T
    reversed_ = replace(true.samples, rate=None, acceleration=turned)
    for aiding in ("auto", "dip"):
        fit = flinders.fit(reversed_, aiding=aiding, site=Site(None, 60.0, inclination_sigma_deg=1.0))
        assert fit.evidence.aiding is not None
        assert [one.code for one in fit.evidence.aiding.mistakes] == ["site-differs"]
        assert "upside down" in fit.evidence.aiding.mistakes[0].words


def test_a_rate_is_the_mean_to_the_next_reading() -> None:
    """A gyro at 200 Hz beside a compass at 10 Hz, of a body that shakes ten times a second: its angle is kept."""
    gyro, times = np.arange(0.0, 10.001, 0.005), np.arange(0.0, 9.95, 0.1)
    angle = 0.3 * gyro + 0.05 * np.sin(2.0 * np.pi * 10.0 * gyro)
    rate = 0.3 + 0.05 * 2.0 * np.pi * 10.0 * np.cos(2.0 * np.pi * 10.0 * gyro)
    beside = TimeSeries.of(gyro, rate[:, np.newaxis])
    assert beside is not None
    turned = np.cumsum(beside.mean_until_next(times)[:-1, 0] * np.diff(times))
    true = np.interp(times[1:], gyro, angle) - angle[0]
    npt.assert_allclose(turned, true, atol=2e-3)
    single = np.cumsum(beside.at(times)[:-1, 0] * np.diff(times))
    assert float(np.abs(single - true).max()) > 1.0


def test_a_gyro_as_seldom_as_the_compass_is_left_as_it_is() -> None:
    times = np.arange(0.0, 5.0, 0.1)
    beside = TimeSeries.of(times, np.sin(times)[:, np.newaxis])
    assert beside is not None
    npt.assert_array_equal(beside.mean_until_next(times), beside.at(times))


@pytest.mark.parametrize(("off", "words"), [(0.23, "23%"), (43.2, "more than 100%")])
def test_scales_of_a_fit_that_went_astray_are_no_absurd_number(off: float, words: str) -> None:
    for code, mistake in (("gyro-scales", gyro_scale_mistake(off)), ("aids-disagree", gyro_contradiction("dip", off))):
        assert mistake.code == code
        assert f"off by {words}" in mistake.words
        assert_sentences(mistake.words)
