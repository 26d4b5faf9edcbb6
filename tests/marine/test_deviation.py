"""Deviation: the worked example of H.O. 226, a compass with known iron, uncertainties that hold, what is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

from flinders.apps.marine.deviation import Expected, eight_points, eight_points_sigma, fit
from flinders.errors import ArrayError, FitError, UsageError
from flinders.geometry.angles import heading_text, mean_deg, wrap_180, wrap_360
from flinders.heading.attitude import level_heading_deg
from flinders.heading.harmonics import design
from flinders.heading.stationary import half_turns, hard_iron, rests

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

POINTS = np.arange(8) * 45.0
HO226 = [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8]
"""Deviations of figure 501 on N, NE, E, SE, S, SW, W, NW by compass."""

HARD = np.array([1.0, -0.6, 0.8])
SOFT = np.array([[0.02, 0.005, 0.01], [-0.004, -0.01, -0.008], [0.003, 0.006, 0.015]])


def with_iron(headings: Floats) -> Floats:
    """What a compass shows on magnetic headings, at 50 µT and a dip of 60°, with the iron above."""
    angle = np.deg2rad(headings)
    field = 50.0 * np.stack([0.5 * np.cos(angle), -0.5 * np.sin(angle), np.full_like(angle, 0.75**0.5)], axis=-1)
    return level_heading_deg(field @ (np.eye(3) + SOFT).T + HARD)


def shown(values: Floats, digits: int) -> list[str]:
    return [f"{value + 0.0:.{digits}f}" for value in values]


def test_the_example_of_ho226_by_eight_points() -> None:
    assert eight_points(HO226).tolist() == [1.0, 12.0, 8.0, 5.0, 1.5]


def test_the_example_of_ho226_by_least_squares() -> None:
    found = fit(POINTS, HO226)
    assert shown(found.coefficients_deg, 4) == ["1.0000", "11.9397", "7.9598", "5.0000", "1.5000"]
    assert found.eight_point_coefficients is not None
    npt.assert_allclose(found.eight_point_coefficients, [1.0, 12.0, 8.0, 5.0, 1.5])


def test_a_compass_with_known_iron_over_its_own_headings() -> None:
    magnetic = np.arange(720) * 0.5
    compass = with_iron(magnetic)
    found = fit(compass, wrap_180(magnetic - compass))
    assert shown(found.coefficients_deg, 4) == ["-0.2565", "3.2463", "-2.1767", "0.8563", "0.0247"]
    assert f"{np.sqrt(np.mean(found.residual_deg**2)):.3f}" == "0.021"


def test_the_same_compass_over_magnetic_headings_has_other_coefficients() -> None:
    """Second-order terms: D less (B² − C²)/2, E less BC. Which heading is the argument has to be said."""
    magnetic = np.arange(720) * 0.5
    found = fit(magnetic, wrap_180(magnetic - with_iron(magnetic)))
    assert shown(found.coefficients_deg, 4) == ["-0.2565", "3.2775", "-2.1435", "0.8014", "0.1550"]
    assert f"{np.sqrt(np.mean(found.residual_deg**2)):.3f}" == "0.040"


def test_iron_tells_the_coefficients_to_first_order() -> None:
    level, down = 25.0, 50.0 * 0.75**0.5
    rows = [
        (SOFT[1, 0] - SOFT[0, 1]) / 2.0,
        (HARD[0] + SOFT[0, 2] * down) / level,
        (HARD[1] + SOFT[1, 2] * down) / level,
        (SOFT[0, 0] - SOFT[1, 1]) / 2.0,
        (SOFT[1, 0] + SOFT[0, 1]) / 2.0,
    ]
    magnetic = np.arange(720) * 0.5
    compass = with_iron(magnetic)
    found = fit(compass, wrap_180(magnetic - compass)).coefficients_deg
    npt.assert_allclose(found, np.rad2deg(rows), atol=0.05)


@pytest.mark.nightly
def test_the_claimed_uncertainty_is_what_repeats_scatter_by() -> None:
    rng = np.random.default_rng(4)
    truth = np.array([0.5, 3.0, -2.0, 1.0, 0.4])
    headings = np.array([0.0, 50.0, 95.0, 130.0, 178.0, 222.0, 270.0, 300.0, 335.0])
    found = [fit(headings, design(headings) @ truth + rng.normal(0.0, 0.5, 9), sigma_deg=0.5) for _ in range(600)]
    scatter = np.std([one.coefficients_deg for one in found], axis=0)
    clean = fit(headings, design(headings) @ truth, sigma_deg=0.5)
    assert clean.sigmas_deg is not None
    npt.assert_allclose(scatter, clean.sigmas_deg, rtol=0.12)
    unsaid = [fit(headings, one.observed_deg) for one in found]
    claimed = [one.covariance for one in unsaid if one.covariance is not None]
    npt.assert_allclose(np.sqrt(np.diagonal(np.mean(claimed, axis=0))), clean.sigmas_deg, rtol=0.12)


def test_eight_points_are_a_little_less_certain_than_least_squares() -> None:
    rng = np.random.default_rng(5)
    noisy = rng.normal(0.0, 1.0, (4000, 8))
    npt.assert_allclose(np.std([eight_points(row) for row in noisy], axis=0), eight_points_sigma(1.0), rtol=0.06)
    exact = fit(POINTS, np.zeros(8), sigma_deg=1.0)
    assert exact.sigmas_deg is not None
    npt.assert_allclose(exact.sigmas_deg, np.sqrt([1 / 8, 1 / 4, 1 / 4, 1 / 4, 1 / 4]))
    assert (exact.sigmas_deg <= eight_points_sigma(1.0) + 1e-12).all()


def test_a_good_heading_counts_for_more() -> None:
    truth = np.array([0.0, 2.0, 1.0, 0.0, 0.0])
    headings = np.arange(0.0, 360.0, 30.0)
    bent = design(headings) @ truth
    bent[3] += 8.0
    sigma = np.full(12, 0.1)
    sigma[3] = 100.0
    npt.assert_allclose(fit(headings, bent, sigma_deg=sigma).coefficients_deg, truth, atol=1e-3)
    assert np.abs(fit(headings, bent).coefficients_deg - truth).max() > 0.5


def test_residuals_larger_than_was_claimed_enlarge_the_uncertainty() -> None:
    rng = np.random.default_rng(6)
    headings = np.arange(0.0, 360.0, 15.0)
    honest, boasting = (fit(headings, rng.normal(0.0, 1.0, 24), sigma_deg=sigma) for sigma in (1.0, 0.1))
    assert honest.chi_square is not None
    assert boasting.sigma_deg is not None
    assert honest.chi_square < 40.0
    assert 0.6 < boasting.sigma_deg < 1.4


@pytest.mark.nightly
@pytest.mark.parametrize("given", [True, False])
def test_a_calibration_that_holds_is_seldom_said_not_to(given: bool, trials: Choose) -> None:
    """2,000 swings on nine headings by compasses that are off as claimed; p below 0.05 in about a twentieth."""
    rng, claim = np.random.default_rng(21), trials(2000, 500)
    root = 0.3 * rng.normal(size=(4, 4))
    expected = Expected(root @ root.T, 60.0, "given")
    around = np.arange(0.0, 360.0, 40.0)
    chances = []
    draws = rng.standard_normal((claim.count, 13))
    for own, noise in zip(draws[:, :4], draws[:, 4:], strict=True):
        seen = design(around)[:, 1:] @ (root @ own) + 0.4 * noise
        found = expected.chance(fit(around, seen, sigma_deg=0.4 if given else None))
        assert found is not None
        chances.append(found[2])
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.015 * claim.widening)
    iron = fit(around, design(around)[:, 1:] @ [8.0, 0.0, 0.0, 0.0] + 0.4 * rng.standard_normal(9), sigma_deg=0.4)
    said = expected.chance(iron)
    assert said is not None
    assert said[2] < 1e-6


def test_five_headings_give_a_curve_and_no_uncertainty() -> None:
    headings = np.arange(5) * 72.0
    found = fit(headings, [1.0, 2.0, 3.0, 2.0, 1.0])
    assert found.covariance is None
    assert found.sigma_at(10.0) is None
    npt.assert_allclose(found.at(headings), [1.0, 2.0, 3.0, 2.0, 1.0])
    known = fit(headings, [1.0, 2.0, 3.0, 2.0, 1.0], sigma_deg=0.5)
    assert known.sigmas_deg is not None
    assert known.sigma_deg == 0.5


@pytest.mark.parametrize(
    "headings", [[], [0.0], [0, 90, 180, 270], [0, 0.2, 0.4, 90, 180, 270], [0, 360, 90, 180, 270]]
)
def test_fewer_than_five_different_headings_are_refused(headings: list[float]) -> None:
    with assert_raises(FitError, needed=5):
        fit(headings, np.zeros(len(headings)))


def test_headings_within_less_than_half_a_circle_are_refused() -> None:
    """Seven headings within 60° made a curve of up to 580°."""
    headings = np.arange(0.0, 61.0, 10.0)
    with assert_raises(FitError, found=60, needed=180):
        fit(headings, np.sin(headings))
    assert fit(np.arange(0.0, 181.0, 30.0), np.zeros(7)).widest_gap_deg == pytest.approx(180.0)


def test_what_is_no_swing_is_refused() -> None:
    with assert_raises(ArrayError):
        fit(POINTS, np.zeros(7))
    with assert_raises(ArrayError):
        fit(POINTS, HO226, sigma_deg=0.0)
    with assert_raises(ArrayError):
        fit([*POINTS[:7], np.nan], HO226)
    with pytest.raises(ArrayError, match=r"need \(N,\)"):
        fit(POINTS.reshape(2, 4), HO226)
    with pytest.raises(ArrayError):
        eight_points([1.0, 2.0])


def test_a_card_goes_there_and_back() -> None:
    found = fit(POINTS, HO226)
    headings, deviations, sigmas = found.card(10.0)
    assert len(headings) == 36
    assert sigmas is not None
    npt.assert_allclose(wrap_360(headings + deviations), found.magnetic(headings))
    npt.assert_allclose(wrap_180(found.compass(found.magnetic(headings)) - headings), 0.0, atol=1e-6)
    for step in (7.0, 0.0, -15.0, float("nan")):
        with assert_raises(UsageError):
            found.card(step)
    with assert_raises(FitError):
        fit(POINTS, 100.0 * np.sin(np.deg2rad(POINTS))).compass(10.0)


def test_eight_points_are_found_in_any_order_and_nowhere_else() -> None:
    order = [3, 1, 7, 0, 2, 6, 5, 4]
    shuffled = fit(POINTS[order] + 360.0, np.array(HO226)[order])
    assert shuffled.eight_point_coefficients is not None
    npt.assert_allclose(shuffled.eight_point_coefficients, [1.0, 12.0, 8.0, 5.0, 1.5])
    assert fit(POINTS + 10.0, HO226).eight_point_coefficients is None
    assert fit([*POINTS, 20.0], [*HO226, 15.0]).eight_point_coefficients is None


# rests and half turns


def stream(stops: list[float], *, noise: float = 0.5, seed: int = 1) -> Floats:
    """Headings at rest on `stops`, 250 readings each, with turns between them."""
    rng = np.random.default_rng(seed)
    parts = []
    for before, after in zip(stops, [*stops[1:], stops[-1]], strict=True):
        way = float(wrap_180(after - before))
        parts += [np.full(250, before), before + np.linspace(0.0, way, max(int(abs(way)), 1))]
    clean = np.concatenate(parts)
    return wrap_360(clean + rng.normal(0.0, noise, len(clean)))


def test_rests_are_found_with_their_headings() -> None:
    stops = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    found = rests(stream(stops))
    npt.assert_allclose(wrap_180(np.array([rest.heading_deg for rest in found]) - stops), 0.0, atol=0.25)
    assert all(0.3 < rest.spread_deg < 0.7 for rest in found)
    assert all(rest.stop - rest.start > 200 for rest in found)


def test_a_slow_turn_is_no_rest() -> None:
    assert rests(np.linspace(0.0, 360.0, 2000)) == ()
    assert rests(np.array([])) == rests(np.full(500, np.nan)) == ()
    with pytest.raises(ArrayError):
        rests(np.zeros((2, 3)))


def test_gaps_and_a_bump_do_not_end_a_rest() -> None:
    heading = stream([10.0])
    heading[100:103] = np.nan
    heading[200:206] = 40.0
    [rest] = rests(heading)
    assert rest.heading_deg == pytest.approx(10.0, abs=0.9)


def test_half_turns_show_the_hard_iron_that_is_left() -> None:
    iron = fit(POINTS, 2.0 * np.sin(np.deg2rad(POINTS)) - 1.0 * np.cos(np.deg2rad(POINTS)))
    found = rests(stream(iron.compass(POINTS).tolist(), noise=0.1))
    halves = half_turns(found)
    assert len(halves) == 4
    b, c = hard_iron(halves) or (0.0, 0.0)
    npt.assert_allclose([b, c], [2.0, -1.0], atol=0.1)
    assert hard_iron(halves[:1]) is None
    assert hard_iron(()) is None


def test_soft_iron_alone_passes_the_half_turn_test() -> None:
    """What repeats every half turn cannot be seen by one."""
    soft = fit(POINTS, 1.0 + 3.0 * np.sin(2.0 * np.deg2rad(POINTS)))
    halves = half_turns(rests(stream(soft.compass(POINTS).tolist(), noise=0.1)))
    assert len(halves) == 4
    assert max(abs(half.error_deg) for half in halves) < 0.2


def test_angles_are_shown_as_navigators_write_them() -> None:
    assert [heading_text(angle) for angle in (0.04, 359.97, -5.0, 123.456, float("nan"))] == [
        "000.0°", "000.0°", "355.0°", "123.5°", "?",
    ]  # fmt: skip
    assert np.isnan(mean_deg([0.0, 180.0]))
