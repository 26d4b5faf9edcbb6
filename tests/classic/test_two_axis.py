"""One plane: the recipe of equally spaced points, the ellipse of least squares; three planes one after the other."""

from __future__ import annotations

import contextlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily
from tests.worlds import judged, method_with

import flinders
from flinders import simulate
from flinders.apps import classic
from flinders.apps.classic import composition
from flinders.apps.classic.cli import two_axis as cli_two_axis
from flinders.apps.classic.composition import refuse_unloaded, rotation_error, turns_of
from flinders.apps.classic.simulate_two_axis import TwoAxis, swing
from flinders.apps.classic.turn_drawing import turn_drawing
from flinders.apps.classic.two_axis_recipe import TwoAxisRecipe
from flinders.cli import main
from flinders.errors import FitError, NeedsSamples, NotAnEllipsoid, StuckAxis, TooFewSamples, UnitError, UsageError
from flinders.estimators import Readings
from flinders.estimators.ellipse import Ellipse
from flinders.fitting.fit_file import fit_from
from flinders.fitting.result import Fit, Refused, document_of
from flinders.geometry.plane import PLANES, PlaneEllipse, Spacing, Turn, axis_order, symmetric_root
from flinders.heading.error_propagation import level_turn
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.testing import Result
    from numpy.random import Generator
    from tests.trials import Choose, Trials

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane
    from flinders.heading.error_propagation import HeadingError

COMPASS: Final = TwoAxis((1.1, 0.9), (10.0, -5.0), 4.0)
NOISY: Final = TwoAxis((1.0, 1.0), (10.0, -5.0), 0.0, 0.25)
LEVEL_UT: Final = 25.0
METHODS: Final = ("two-axis", "ellipse")


def read(headings_deg: Floats, seed: int = 1, noise: float = 0.25) -> Floats:
    """(N, 3) what the compass reads on these headings, level."""
    heading = np.radians(headings_deg)
    level = LEVEL_UT * np.stack([np.cos(heading), -np.sin(heading)], axis=1)
    field = np.zeros((len(heading), 3))
    field[:, :2] = level @ COMPASS.matrix.T + COMPASS.offset
    field[:, :2] += noise * np.random.default_rng(seed).standard_normal((len(heading), 2))
    return field


def off_deg(calibration: Calibration, compass: TwoAxis = COMPASS) -> Floats:
    """(360,) error of the heading of a level vehicle, the mean removed."""
    heading = np.radians(np.arange(360.0))
    exact = np.zeros((360, 3))
    exact[:, :2] = LEVEL_UT * np.stack([np.cos(heading), -np.sin(heading)], axis=1) @ compass.matrix.T + compass.offset
    x, y, _ = calibration.apply(exact).T
    phasors = np.exp(1j * (np.arctan2(-y, x) - heading))
    errors: Floats = np.degrees(np.angle(phasors / phasors.mean()))
    return errors


# The 36 points.


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("plane", PLANES)
def test_36_points_without_noise_are_exact(method: str, plane: Plane) -> None:
    """Offset, scales and skew to 1e-9, of each plane."""
    order = list(axis_order(plane))
    field = np.full((36, 3), 12.5)
    field[:, order[:2]] = swing(COMPASS).samples.field[:, :2]
    field[:, order[2]] = np.linspace(-0.1, 0.1, 36)
    fit = flinders.fit(field, site=flinders.Site(strength=50.0), method=method_with(method, plane=plane))
    shape = 50.0 * np.linalg.inv(fit.calibration.matrix)[np.ix_(order, order)][:2, :2] / 2.0
    found = TwoAxis.from_ellipse(fit.calibration.offset[order[:2]], shape, LEVEL_UT)
    npt.assert_allclose(found.offset, COMPASS.offset, atol=1e-9)
    npt.assert_allclose(found.scale, COMPASS.scale, atol=1e-9)
    assert found.skew_deg == pytest.approx(COMPASS.skew_deg, abs=1e-7)
    assert (fit.evidence.method, fit.claim.plane) == (f"{method} {plane}", plane)
    assert fit.calibration.offset[order[2]] == 0.0
    npt.assert_allclose(fit.calibration.matrix[order[2]], np.eye(3)[order[2]], atol=1e-12)


def equator_of(ellipsoid: Ellipsoid) -> PlaneEllipse:
    """The ellipse in x and y that an ellipsoid of a level turn at dip 60° stands for."""
    return PlaneEllipse(ellipsoid.centre[:2], ellipsoid.shape[:2, :2] / 2.0)


def test_the_estimator_is_the_recipe() -> None:
    field = swing(NOISY, seed=3).samples.field
    found, recipe = (
        equator_of(TwoAxisRecipe().estimate(Readings.of(field)).ellipsoid),
        PlaneEllipse.of_points(field[:, :2]),
    )
    npt.assert_allclose(found.centre, recipe.centre, rtol=1e-12)
    npt.assert_allclose(found.shape, recipe.shape, rtol=1e-12)


@pytest.fixture(scope="module", params=METHODS)
def recovered(request: pytest.FixtureRequest, trials: Choose) -> tuple[str, Floats, Trials]:
    """(500, 5) offsets, scales and skew in rad, found of a noisy compass."""
    rows, claim = [], trials(500, 60)
    for seed in claim.seeds:
        field = swing(NOISY, seed=seed).samples.field
        if request.param == "two-axis":  # without the least squares that the estimator holds beside it
            plane = PlaneEllipse.of_points(field[:, :2])
        else:
            plane = equator_of(Ellipse().estimate(Readings.of(field)).ellipsoid)
        found = TwoAxis.from_ellipse(plane.centre, plane.shape, LEVEL_UT)
        rows.append([*found.offset, *found.scale, np.radians(found.skew_deg)])
    return request.param, np.array(rows), claim


@pytest.mark.nightly
def test_500_noisy_swings_scatter_as_theory_says(recovered: tuple[str, Floats, Trials]) -> None:
    """Means within three standard errors, scatter within a tenth of theory (its own standard error is 3%).

    Of the mean that is σ/√N, σ√(2/N)/H and 2σ/(H√N); of least squares σ√(2/N), σ√(3/N)/H and 2√2 σ/(H√N). The
    recipe is wider by σ²/H, which least squares take off.
    """
    method, found, claim = recovered
    once = NOISY.noise / np.sqrt(36.0)
    relative = once / LEVEL_UT
    sigma = {
        "two-axis": np.array([once, once, np.sqrt(2) * relative, np.sqrt(2) * relative, 2 * relative]),
        "ellipse": np.array(
            [np.sqrt(2) * once, np.sqrt(2) * once, np.sqrt(3) * relative, np.sqrt(3) * relative, 2**1.5 * relative]
        ),
    }[method]
    wider = (NOISY.noise / LEVEL_UT) ** 2 if method == "two-axis" else 0.0
    true = np.array([*NOISY.offset, *(scale + wider for scale in NOISY.scale), 0.0])
    scores = (found.mean(axis=0) - true) / (sigma / np.sqrt(claim.count))
    assert np.abs(scores).max() < 3.0
    npt.assert_allclose(found.std(axis=0) / sigma, 1.0, atol=0.1 * claim.widening)


@pytest.mark.nightly
@pytest.mark.parametrize("method", METHODS)
def test_the_claim_is_that_of_least_squares_for_both(method: str, trials: Choose) -> None:
    """A tenth too wide for the ellipse of 36 points; for the mean of even points another √2, as nobody can be sure."""
    ratios, claim = [], trials(60, 20)
    for seed in claim.seeds:
        fit = flinders.fit(swing(NOISY, seed=seed).samples, method=method)
        ratios.append(np.sqrt(np.mean(off_deg(fit.calibration, NOISY) ** 2)) / fit.heading_error_deg.rms)
    rms = float(np.sqrt(np.mean(np.square(ratios))))
    assert rms == pytest.approx({"two-axis": 0.65, "ellipse": 0.92}[method], abs=0.1 * claim.widening)


def test_the_eigenvalues_are_half_the_squares_of_the_semi_axes() -> None:
    points = read(np.arange(0.0, 360.0, 10.0), noise=0.0)[:, :2]
    found = PlaneEllipse.of_points(points)
    npt.assert_allclose(found.eigenvalues, np.linalg.eigvalsh(np.cov(points.T, bias=True))[::-1])
    npt.assert_allclose(found.matrix, found.matrix.T)
    assert np.linalg.det(found.matrix) == pytest.approx(1.0)
    npt.assert_allclose(np.linalg.norm(found.correct(points), axis=1), found.radius)


def test_points_in_blocks_are_the_same_as_at_once() -> None:
    points = np.random.default_rng(1).normal(size=(100, 2)) + 1e3
    one, other = PlaneEllipse.of_points(points), PlaneEllipse.of_blocks(np.split(points, [0, 7, 7, 60]))
    npt.assert_allclose(other.centre, one.centre, rtol=1e-14)
    npt.assert_allclose(other.shape, one.shape, rtol=1e-12)


def test_the_root_in_closed_form_is_a_root() -> None:
    for seed in range(20):
        half = np.random.default_rng(seed).normal(size=(2, 2))
        square = half @ half.T
        npt.assert_allclose(symmetric_root(square) @ symmetric_root(square), square, atol=1e-12)
        npt.assert_allclose(symmetric_root(square), symmetric_root(square).T)


# What an ellipse does not tell.


@pytest.mark.parametrize(("scales", "turned"), [((1.0, 1.0), 2.0), ((1.1, 0.9), 1.8004)])
def test_a_pure_phase_skew_leaves_a_constant_rotation(scales: tuple[float, float], turned: float) -> None:
    """Of 4°: half of it where the scales are alike, atan(s₂ sin 4° / (s₁ + s₂ cos 4°)) in general; and nothing else."""
    compass = TwoAxis(scales, (10.0, -5.0), 4.0)
    fit = flinders.fit(swing(compass).samples, method="two-axis")
    headings = np.arange(0.0, 360.0, 10.0)
    x, y, _ = fit.calibration.apply(swing(compass).samples.field).T
    shown = np.degrees(np.angle(np.exp(1j * (np.arctan2(-y, x) - np.radians(headings)))))
    assert shown.mean() == pytest.approx(turned, abs=1e-3)
    assert np.ptp(shown) < 1e-9


# Points that are not equally spaced.

UNEVEN: Final = {
    "three quarters of a turn": np.arange(0.0, 270.0, 2.0),
    "1.2 turns": np.arange(0.0, 432.0, 2.0),
    "a stop": np.concatenate([np.arange(0.0, 360.0, 2.0), np.full(60, 90.0)]),
    "a varying rate": np.arange(0.0, 360.0, 2.0) + np.degrees(0.5 * np.sin(np.radians(np.arange(0.0, 360.0, 2.0)))),
}


@pytest.mark.parametrize(
    ("how", "worst"),
    [("three quarters of a turn", 24.4), ("1.2 turns", 10.3), ("a stop", 17.3), ("a varying rate", 14.5)],
)
def test_uneven_points_cost_the_mean_degrees_and_the_ellipse_nothing(how: str, worst: float) -> None:
    field = read(UNEVEN[how])
    mean, ellipse = (judged(field, method=method) for method in METHODS)
    assert np.abs(off_deg(mean.calibration)).max() == pytest.approx(worst, rel=0.03)
    assert mean.verdict == "refused"
    assert_sentences(mean.findings[0].advice)
    assert {"bias", "heading-error"} <= {finding.code for finding in mean.findings}
    assert ellipse.verdict == "limited"
    assert np.abs(off_deg(ellipse.calibration)).max() < 3.0 * ellipse.heading_error_deg.worst < 1.0


@pytest.mark.parametrize("missing", [1, 2, 4])
def test_the_harmonics_tell_what_the_mean_costs(missing: int) -> None:
    """At most, and to first order: of a few points that are missing it is up to a sixth more than comes of them."""
    field = read(np.arange(0.0, 360.0 - 10.0 * missing, 10.0), noise=0.0)
    found = Ellipse().estimate(Readings.of(field)).ellipsoid
    reference = PlaneEllipse(found.centre[:2], found.shape[:2, :2])
    worst = np.abs(off_deg(judged(field, method="two-axis", target_deg=50.0).calibration)).max()
    assert worst < Spacing.of(reference.angles(field[:, :2])).cost_deg < 7.0 / 6.0 * worst


def test_what_the_recipe_itself_corrects_has_no_harmonics_to_see() -> None:
    """Why the spacing is looked at about the ellipse of least squares."""
    field = read(UNEVEN["three quarters of a turn"], noise=0.0)[:, :2]
    x, y = PlaneEllipse.of_points(field).correct(field).T
    phasor = x + 1j * y
    assert abs(phasor.mean()) < 1e-9
    assert abs((phasor * phasor).mean()) < 1e-9 * LEVEL_UT**2


def test_a_slight_unevenness_is_a_limit_and_not_a_refusal() -> None:
    field = read(np.arange(0.0, 365.0, 5.0)[:-1] * 0.975, noise=0.05)
    fit = judged(field, method="two-axis")
    assert fit.verdict == "limited"
    assert "bias" in {finding.code for finding in fit.findings}
    assert np.abs(off_deg(fit.calibration)).max() < 2.0 * fit.heading_error_deg.worst


@pytest.mark.parametrize("arc", daily([120.0, 180.0, 240.0]))
def test_the_ellipse_of_an_arc_is_as_good_as_it_claims(arc: float, trials: Choose) -> None:
    scores, claim = [], trials(15, 6)
    for seed in claim.seeds:
        fit = judged(read(np.linspace(0.0, arc, 60), seed, noise=0.1), method="ellipse", target_deg=20.0)
        scores.append(np.sqrt(np.mean(off_deg(fit.calibration) ** 2)) / fit.heading_error_deg.rms)
    low, high = claim.ratios(0.5 if arc > 120.0 else 0.2, 1.5)  # how the field varies with the place hides in an arc
    assert low < np.sqrt(np.mean(np.square(scores))) < high


def test_a_stray_reading_spoils_the_mean_and_not_the_ellipse() -> None:
    field = read(np.arange(0.0, 360.0, 5.0))
    field[:6, 0] += 60.0
    mean, ellipse = (judged(field, method=method, target_deg=50.0) for method in METHODS)
    assert np.abs(off_deg(mean.calibration)).max() > 10.0
    assert np.abs(off_deg(ellipse.calibration)).max() < 1.0
    assert sum(outlier.readings for outlier in ellipse.evidence.outliers) == 6


def test_a_vehicle_turned_by_hand_is_not_evenly_spaced(recordings: Callable[[str], Path]) -> None:
    """139 readings of two axes: the mean would be up to 15° off, and least squares are good to a fifth of a degree."""
    points = np.loadtxt(recordings("jremington_planar2d/mag2d_raw_header.csv"), delimiter=",", skiprows=1)
    field = np.column_stack([points, np.zeros(len(points))])
    mean, ellipse = (judged(field, method=method) for method in METHODS)
    assert mean.verdict == "refused"
    assert mean.heading_error_deg.worst == pytest.approx(14.0, abs=1.0)
    assert ellipse.heading_error_deg.worst == pytest.approx(0.18, abs=0.01)
    assert ellipse.evidence.noise / ellipse.calibration.field_strength < 0.005
    reference = PlaneEllipse(ellipse.calibration.offset[:2], ellipse.calibration.shape[:2, :2])
    assert Spacing.of(reference.angles(points)).cost_deg == pytest.approx(15.2, abs=0.1)


# Where it holds.


def test_the_ellipse_of_a_turn_about_z_is_that_of_level() -> None:
    recording = simulate.tumble(seed=3, motion="level", n=2000)
    level, planar = (flinders.fit(recording.samples, method=name) for name in ("level", "ellipse"))
    assert [finding.code for finding in planar.findings] == [finding.code for finding in level.findings]
    assert planar.findings[0].code == "level-plane"
    assert planar.heading_error_deg.worst == pytest.approx(level.heading_error_deg.worst, rel=1e-3)
    npt.assert_allclose(planar.calibration.offset[:2], level.calibration.offset[:2], atol=1e-3)


def test_two_thousand_headings_at_random_are_not_even() -> None:
    """Their harmonics are about 1/√N: a degree, where the ellipse is right to a twentieth."""
    recording = simulate.tumble(seed=3, motion="level", n=2000)
    mean, ellipse = (flinders.fit(recording.samples, method=method) for method in METHODS)
    assert mean.claim.bias_deg == pytest.approx(0.8, abs=0.1)
    assert ellipse.heading_error_deg.rms < 0.06


@pytest.mark.parametrize("plane", daily(PLANES, 2))
@pytest.mark.parametrize("method", METHODS)
def test_a_sweep_is_judged_about_the_axis_it_turns_about(plane: Plane, method: str) -> None:
    recording = simulate.tumble(seed=6, motion=f"sweep-{plane}", noise=0.3)
    fit = flinders.fit(recording.samples, method=method_with(method, plane=plane))
    assert fit.verdict == "limited"
    assert f"corrects {plane[0]} and {plane[1]} only" in fit.findings[0].advice
    assert fit.heading_error_deg.worst < 0.2
    others: list[Plane] = [other for other in PLANES if other != plane]
    for other in others:
        assert judged(recording.samples, method=method_with(method, plane=other)).verdict == "refused"


def test_a_tumble_is_no_turn() -> None:
    field = simulate.tumble(seed=1, motion="uniform").samples.field
    for method in METHODS:
        fit = judged(field, method=method)
        assert "noise" in {finding.code for finding in fit.findings}
        assert fit.verdict == "refused"


@pytest.mark.parametrize("dip", daily([-70.0, 0.0, 60.0, 80.0], 2))
@pytest.mark.parametrize("method", METHODS)
def test_the_dip_does_not_matter_to_a_level_heading(method: str, dip: float) -> None:
    field = read(np.arange(0.0, 360.0, 5.0))
    fit, plain = (judged(field, method=method, site=flinders.Site(inclination_deg=angle)) for angle in (dip, 60.0))
    npt.assert_allclose(fit.calibration.matrix, plain.calibration.matrix, atol=1e-12)
    assert fit.heading_error_deg.worst == pytest.approx(plain.heading_error_deg.worst, rel=1e-3)


def test_a_third_axis_far_from_zero_changes_nothing() -> None:
    """Nor does one that never changes."""
    field = read(np.arange(0.0, 360.0, 5.0))
    for height in (0.0, 500.0, -500.0):
        field[:, 2] = height
        fit = flinders.fit(field, method="ellipse")
        assert fit.heading_error_deg.worst == pytest.approx(0.1137, rel=0.01)
        assert fit.claim.offset_sigma[2] > abs(height)


@pytest.mark.parametrize("method", METHODS)
def test_what_cannot_work_is_refused(method: str) -> None:
    field = read(np.arange(0.0, 360.0, 10.0))
    with assert_raises(UsageError):
        flinders.fit(field, method=method_with(method, plane="xz"))
    with pytest.raises(TooFewSamples):
        flinders.fit(field[:5], method=method)
    with pytest.raises(StuckAxis, match="z = 0"):
        flinders.fit(field, method=method_with(method, plane="yz"))
    with pytest.raises(NeedsSamples):
        flinders.fit(Summary.of(field), method=method)
    line = np.linspace(-1.0, 1.0, 50)[:, np.newaxis] * [30.0, 40.0, 0.0]
    with pytest.raises(NotAnEllipsoid):
        flinders.fit(line, method=method)
    with pytest.raises(FitError):
        flinders.fit(np.repeat(field[:1], 50, axis=0), method=method)


# Three planes.


def sweep(plane: Plane, dip_deg: float) -> Floats:
    """(36, 3) directions of the field, the third axis of the plane down."""
    first, second, third = axis_order(plane)
    heading, dip = np.radians(np.arange(0.0, 360.0, 10.0)), np.radians(dip_deg)
    directions = np.zeros((36, 3))
    directions[:, first] = np.cos(dip) * np.cos(heading)
    directions[:, second] = -np.cos(dip) * np.sin(heading)
    directions[:, third] = np.sin(dip)
    return directions


def swept(
    sensor: simulate.Sensor, *, rounds: int = 1, rng: Generator | None = None, planes: tuple[Plane, ...] = PLANES
) -> tuple[Calibration, float]:
    """Sweep plane after plane, each loaded before the next: the composition, and what each turn claims."""
    loaded: Calibration | None = None
    claims = []
    for plane in planes * rounds:
        raw = sensor.read(50.0 * sweep(plane, 60.0), rng or np.random.default_rng(0))
        strength = None if loaded is None else loaded.field_strength
        readings = raw if loaded is None else loaded.apply(raw)
        fit = flinders.fit(
            readings,
            target_deg=30.0,
            site=flinders.Site(strength=strength),
            method=flinders.estimators.TwoAxisRecipe(plane=plane),
        )
        loaded = fit.calibration if loaded is None else fit.calibration @ loaded
        claims.append(fit.heading_error_deg.rms)
    assert loaded is not None
    return loaded, float(np.sqrt(np.sum(np.square(claims))))


def level_off_deg(calibration: Calibration, sensor: simulate.Sensor) -> Floats:
    """(72,) error of the heading of a level vehicle at dip 60°, the mean removed."""
    heading, directions = level_turn(60.0)
    x, y, _ = calibration.apply(50.0 * directions.T @ sensor.matrix.T + sensor.offset).T
    phasors = np.exp(1j * (np.arctan2(-y, x) - heading))
    errors: Floats = np.degrees(np.angle(phasors / phasors.mean()))
    return errors


def iron(seed: int, size: float) -> simulate.Sensor:
    """Symmetric soft iron: gains within ± size of 1, what stands across within three tenths of it."""
    rng = np.random.default_rng(seed)
    matrix = rng.uniform(-0.6 * size, 0.6 * size, (3, 3))
    matrix = (matrix + matrix.T) / 2.0
    matrix[range(3), range(3)] = 1.0 + rng.uniform(-size, size, 3)
    return simulate.Sensor(matrix, rng.uniform(-100.0, 100.0, 3), 0.0)


def test_three_sweeps_recover_offsets_and_gains_exactly() -> None:
    sensor = simulate.Sensor(np.diag([1.2, 0.9, 1.05]), np.array([30.0, -40.0, 60.0]), 0.0)
    loaded, _ = swept(sensor)
    npt.assert_allclose(loaded.offset, sensor.offset, atol=1e-9)
    npt.assert_allclose(loaded.matrix / loaded.matrix[0, 0], np.diag([1.0, 1.2 / 0.9, 1.2 / 1.05]), atol=1e-9)
    assert loaded.rotation == "composed"


@pytest.mark.parametrize(("size", "worst"), daily([(0.05, 0.078), (0.1, 0.31), (0.25, 1.97)]))
def test_three_sweeps_leave_what_is_of_second_order_in_the_soft_iron(size: float, worst: float, trials: Choose) -> None:
    """Of ten sensors that of the first seed is off by most; a second round of sweeps takes nothing off it."""
    once, twice = [], []
    for seed in trials(10, 1).seeds:
        sensor = iron(seed, size)
        once.append(np.abs(level_off_deg(swept(sensor)[0], sensor)).max())
        twice.append(np.abs(level_off_deg(swept(sensor, rounds=2)[0], sensor)).max())
    assert max(once) == pytest.approx(worst, rel=0.05)
    assert max(twice) == pytest.approx(worst, rel=0.1)


def test_one_sweep_is_right_while_level_and_nowhere_else() -> None:
    """The offset in the plane has what S₁₃ and S₂₃ lend from the vertical field in it, which a tilt does not."""
    sensor = iron(3, 0.1)
    loaded, _ = swept(sensor, planes=("xy",))
    assert np.abs(level_off_deg(loaded, sensor)).max() < 1e-9
    lent = 50.0 * np.sin(np.radians(60.0)) * sensor.matrix[:2, 2]
    npt.assert_allclose(loaded.offset[:2], sensor.offset[:2] + lent, atol=1e-9)


@pytest.mark.nightly
def test_three_sweeps_are_as_good_as_they_claim_together(trials: Choose) -> None:
    """Where noise, not soft iron, is what is left."""
    scores, claim = [], trials(20, 7)
    for seed in claim.seeds:
        sensor = simulate.Sensor(np.eye(3), np.array([30.0, -40.0, 60.0]), 0.25)
        loaded, claimed = swept(sensor, rng=np.random.default_rng(seed))
        scores.append(np.sqrt(np.mean(level_off_deg(loaded, sensor) ** 2)) / claimed)
    low, high = claim.ratios(0.5, 1.5)
    assert low < np.sqrt(np.mean(np.square(scores))) < high


def composed(sensor: simulate.Sensor, planes: tuple[Plane, ...], rng: Generator, method: str = "two-axis") -> list[Fit]:
    """Sweep plane after plane, and what stands in the file after each."""
    loaded: list[Fit] = []
    for plane in planes:
        raw = sensor.read(50.0 * sweep(plane, 60.0), rng)
        first = loaded[-1] if loaded else None
        readings = flinders.Samples.of(raw if first is None else first.calibration.apply(raw), unit="uT")
        strength = None if first is None else first.calibration.field_strength
        fit = flinders.fit(
            readings, target_deg=50.0, site=flinders.Site(strength=strength), method=method_with(method, plane=plane)
        )
        found = fit if first is None else composition.compose(first, fit)
        loaded.append(fit_from(document_of(found)))
    return loaded


def claimed(loaded: Fit) -> HeadingError:
    """What the file says of a level heading."""
    return loaded.heading_error_deg


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("size", "planes", "ratios"),
    [
        (0.25, ("xy", "yz", "zx"), (0.68, 0.89, 1.06)),
        (0.1, ("xy", "zx", "yz"), (0.68, 0.83, 0.80)),
    ],
)
def test_what_a_composition_claims_is_what_it_costs(
    size: float, planes: tuple[Plane, ...], ratios: tuple[float, ...], trials: Choose
) -> None:
    """True over claimed after each of three turns, rms over 40 sensors, seeds 0 to 39, 0.1 µT of noise."""
    squares, claim = [], trials(40, 8)
    for seed in claim.seeds:
        sensor = replace(iron(seed, size), noise=0.1)
        steps = composed(sensor, planes, np.random.default_rng(seed))
        off = [np.mean(level_off_deg(step.calibration, sensor) ** 2) for step in steps]
        squares.append([square / claimed(step).rms ** 2 for square, step in zip(off, steps, strict=True)])
    npt.assert_allclose(np.sqrt(np.mean(squares, axis=0)), ratios, atol=0.06 if claim.widening == 1.0 else 0.4)


@pytest.mark.parametrize("seed", daily(range(5)))
def test_the_rotation_of_the_matrix_tells_what_is_left(seed: int) -> None:
    """Without noise, soft iron of 25 %: of 0.3 to 1.1° of a level heading at the worst, to an eighth."""
    sensor = iron(seed, 0.25)
    planes: tuple[Plane, ...] = ("zx", "xy", "yz")
    *_, loaded = composed(sensor, planes, np.random.default_rng(0))
    told = rotation_error(loaded.calibration.matrix, planes, dip_deg=60.0)
    worst = np.abs(level_off_deg(loaded.calibration, sensor)).max()
    assert 0.25 < worst < 1.2
    assert told.worst == pytest.approx(worst, rel=0.125)


def test_a_turn_in_xy_at_the_end_leaves_nothing_to_a_level_heading() -> None:
    sensor = iron(3, 0.25)
    _, between, loaded = composed(sensor, ("yz", "zx", "xy"), np.random.default_rng(0))
    assert np.abs(level_off_deg(loaded.calibration, sensor)).max() < 1e-9
    assert claimed(loaded).worst < 1e-4
    assert (claimed(between).worst, claimed(between).dip_deg) == (180.0, 60.0)


def test_a_composition_has_findings_of_its_own() -> None:
    """And none of the last turn, which is about one plane alone."""
    _, second, third = composed(iron(1, 0.1), PLANES, np.random.default_rng(0))
    for step in (second, third):
        assert [finding.code for finding in step.findings] == ["composed", "scale-unknown"]
        assert (step.verdict, step.claim.plane, step.claim.states_uncertainty) == ("limited", None, False)
    assert_sentences(second.findings[0].advice)
    assert (second.evidence.samples, third.evidence.samples) == (72, 108)


@pytest.mark.nightly
def test_raw_turns_are_told_from_loaded_ones(trials: Choose) -> None:
    """Of the second and third turns of 40 sensors; what passes has an offset below a fifth of the field."""
    loaded_refused, raw_passed, claim = 0, 0, trials(40, 10)
    for seed in claim.seeds:
        sensor = replace(iron(seed, 0.25), noise=0.1)
        steps = composed(sensor, PLANES[:2], np.random.default_rng(seed))
        for first, plane in zip(steps, PLANES[1:], strict=True):
            raw = sensor.read(50.0 * sweep(plane, 60.0), np.random.default_rng(seed))
            loaded_refused += is_refused(first, plane, first.calibration.apply(raw))
            raw_passed += not is_refused(first, plane, raw)
    assert loaded_refused == 0
    assert raw_passed == (3 if claim.widening == 1.0 else 1)


def is_refused(first: Fit, plane: Plane, field: Floats) -> bool:
    """Whether a turn is taken for one that was made without a calibration loaded."""
    points = field[:, list(axis_order(plane)[:2])]
    try:
        refuse_unloaded(first, Turn.of(plane, points, PlaneEllipse.of_points(points)), dip_deg=60.0, source="turn.csv")
    except UsageError:
        return True
    return False


def test_a_sensor_that_was_calibrated_all_round_may_be_put_into_a_vehicle() -> None:
    """The iron of the vehicle is what the turn is for, however far it is."""
    bench = flinders.fit(simulate.tumble(seed=3).samples)
    sensor = simulate.Sensor(np.eye(3), np.array([80.0, -30.0, 0.0]), 0.1)
    points = sensor.read(50.0 * sweep("xy", 60.0), np.random.default_rng(1))
    strength = bench.calibration.field_strength
    fit = flinders.fit(flinders.Samples.of(points, unit="uT"), method="ellipse", site=flinders.Site(strength=strength))
    turn = Turn.of("xy", points[:, :2], PlaneEllipse.of_points(points[:, :2]))
    refuse_unloaded(bench, turn, dip_deg=60.0, source="turn.csv")
    found = composition.compose(bench, fit)
    assert turns_of(found) == ("", "xy")
    assert found.heading_error_deg == fit.heading_error_deg
    corrected = found.calibration.apply(bench.calibration.unapply(points))
    npt.assert_allclose(corrected[:, :2].mean(axis=0), 0.0, atol=0.2)


# The use case.


def test_a_turn_gives_the_compass_it_was_made_with() -> None:
    found = classic.two_axis(read(np.arange(0.0, 360.0, 10.0)))
    assert (found.fit.evidence.method, found.fit.verdict, found.composed, found.notes) == (
        "two-axis xy",
        "limited",
        None,
        (),
    )
    assert np.abs(off_deg(found.fit.calibration)).max() < 2.0 * found.fit.heading_error_deg.worst
    assert found.as_dict()["turn"]["is_mean_trusted"]


def test_where_the_mean_is_off_least_squares_is_taken_unless_the_mean_was_asked_for() -> None:
    arc = read(np.arange(0.0, 270.0, 10.0))
    found = classic.two_axis(arc)
    assert (found.fit.evidence.method, [note.code for note in found.notes]) == ("ellipse xy", ["mean-off"])
    assert np.abs(off_deg(found.fit.calibration)).max() < 2.0 * found.fit.heading_error_deg.worst
    with pytest.raises(Refused):
        classic.two_axis(arc, method="two-axis")


def test_three_planes_one_after_the_other_compose() -> None:
    sensor, loaded = iron(2, 0.1), None
    for plane in PLANES:
        raw = sensor.read(50.0 * sweep(plane, 60.0), np.random.default_rng(0))
        turned = raw if loaded is None else loaded.calibration.apply(raw)
        found = classic.two_axis(flinders.Samples.of(turned, unit="uT"), loaded, plane=plane)
        loaded = found.composed or found.fit
    wanted, _ = swept(sensor)
    assert loaded is not None
    assert turns_of(loaded) == PLANES
    npt.assert_allclose(loaded.calibration.matrix, wanted.matrix, atol=1e-7)
    npt.assert_allclose(loaded.calibration.offset, wanted.offset, atol=1e-6)


def test_a_field_that_contradicts_what_was_loaded_is_refused() -> None:
    field = read(np.arange(0.0, 360.0, 10.0))
    first = classic.two_axis(flinders.Samples.of(field, unit="uT"), dip_deg=60.0).fit
    turn = classic.read_turn(first.calibration.apply(field), first)
    with assert_raises(UsageError):
        turn.fit(dip_deg=50.0)
    with assert_raises(UsageError):
        turn.fit(field_strength=40.0)
    with assert_raises(UnitError):
        classic.two_axis(flinders.Samples.of(field, unit="counts"), first)
    assert turn.fit().composed is not None


def test_a_turn_in_another_plane_is_noted_before_it_is_refused() -> None:
    turn = classic.read_turn(sweep("yz", 60.0) * 50.0 + 0.1 * np.random.default_rng(1).normal(size=(36, 3)))
    assert_sentences(turn.notes)
    with pytest.raises(FitError):
        turn.fit()
    assert classic.read_turn(read(np.arange(0.0, 360.0, 10.0))).notes == ()


def test_a_method_or_plane_that_there_is_not_is_named() -> None:
    field = read(np.arange(0.0, 360.0, 10.0))
    with assert_raises(UsageError):
        classic.two_axis(field, method="elipse")  # type: ignore[arg-type]
    with pytest.raises(UsageError):
        classic.two_axis(field, plane="xz")  # type: ignore[arg-type]


# The command.


@pytest.fixture(autouse=True)
def somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(line: str) -> Result:
    return CliRunner().invoke(main, line.split())


def save(path: str, field: Floats, header: str = "mx_uT,my_uT,mz_uT") -> None:
    np.savetxt(path, field, delimiter=",", header=header, comments="", fmt="%.12g")


def test_the_planes_of_the_command_are_those_there_are() -> None:
    assert cli_two_axis.PLANES == PLANES


def test_the_command_prints_the_recipe_and_writes_the_calibration() -> None:
    save("turn.csv", read(np.arange(0.0, 360.0, 10.0)))
    ended = run("two-axis turn.csv -o c.json --polar rose.svg --json")
    assert ended.exit_code == 3, ended.output
    told = json.loads(ended.stdout)
    plain = flinders.fit(flinders.read("turn.csv"), method="two-axis")
    npt.assert_allclose(told["turn"]["mean_and_scatter"]["centre"], plain.calibration.offset[:2])
    npt.assert_allclose(told["turn"]["mean_and_scatter"]["matrix"], plain.calibration.matrix[:2, :2])
    assert told["turn"]["is_mean_trusted"] is True
    assert told["composed"] is None
    assert flinders.Calibration.load("c.json").isclose(plain.calibration)
    assert Path("rose.svg").read_text(encoding="utf-8").startswith("<svg")


def test_three_planes_through_the_command_compose() -> None:
    sensor = iron(2, 0.1)
    loaded: Calibration | None = None
    for place, plane in enumerate(PLANES):
        raw = sensor.read(50.0 * sweep(plane, 60.0), np.random.default_rng(0))
        save("sweep.csv", raw if loaded is None else loaded.apply(raw))
        after = f"--after {place - 1}.json" if place else ""
        ended = run(f"two-axis sweep.csv --plane {plane} {after} -o {place}.json")
        assert ended.exit_code == 3, ended.output
        loaded = flinders.Calibration.load(f"{place}.json")
    wanted, _ = swept(sensor)
    assert loaded is not None
    npt.assert_allclose(loaded.matrix, wanted.matrix, atol=1e-7)
    npt.assert_allclose(loaded.offset, wanted.offset, atol=1e-6)
    assert loaded.rotation == "composed"
    fit = flinders.load("2.json")
    assert not fit.claim.states_uncertainty
    assert_sentences(fit.evidence.method)
    assert [file.name for file in fit.provenance.files] == ["sweep.csv"] * 3


@pytest.mark.parametrize(
    ("factor", "other", "loaded"),
    [
        (1.0, False, False),
        (10.9, False, True),
        (0.15, False, True),
        (1.0, True, True),
    ],
)
def test_a_turn_that_was_not_made_with_it_loaded_is_refused(factor: float, other: bool, loaded: bool) -> None:
    """Raw, in counts without a header, or of another sensor."""
    sensor = iron(2, 0.1)
    save("xy.csv", sensor.read(50.0 * sweep("xy", 60.0), np.random.default_rng(0)))
    turned = run("two-axis xy.csv -o 0.json")
    assert turned.exit_code == 3
    first = flinders.Calibration.load("0.json")
    field = (iron(11, 0.1) if other else sensor).read(50.0 * sweep("yz", 60.0), np.random.default_rng(0))
    np.savetxt("yz.csv", factor * (first.apply(field) if loaded else field), delimiter=",", fmt="%.3f")
    ended = run("two-axis yz.csv --plane yz --after 0.json -o 1.json")
    assert ended.exit_code == 2, ended.output
    assert_sentences(" ".join(ended.output.split()))
    assert not Path("1.json").exists()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of turns, and of what is none, with the calibration c.json of the first."""
    folder = tmp_path_factory.mktemp("bench")
    field = read(np.arange(0.0, 360.0, 10.0))
    noise = np.random.default_rng(2).normal(size=(50, 3)) / 1e3
    turns = {
        "turn": field,
        "other": field + 1.0,
        "few": field[:5],
        "arc": field[:27],
        "still": field[:20] / 1000.0 + 3000.0,
        "line": np.outer(np.arange(50.0), [1.0, 2.0, 0.0]) + noise,
        "side": sweep("yz", 60.0) * 50.0 + 0.1 * np.random.default_rng(1).normal(size=(36, 3)),
    }
    for name, readings in turns.items():
        save(f"{folder / name}.csv", readings)
    save(str(folder / "counts.csv"), field, "mx,my,mz")
    with contextlib.chdir(folder):
        assert run("two-axis turn.csv -o c.json").exit_code == 3
    return folder


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("turn.csv --plane xz", 2),
        ("turn.csv --method sphere", 2),
        ("c.json", 2),
        ("none.csv", 5),
        ("turn.csv --after none.json", 5),
        ("turn.csv --after turn.csv", 2),
        ("turn.csv --after -", 2),
        ("turn.csv --after c.json", 2),
        ("other.csv --after c.json --axes x,-y,-z", 2),
        ("counts.csv --after c.json --chip MPU-9250:16bits", 2),
        ("other.csv --after c.json --dip 50", 2),
        ("other.csv --after c.json --field-strength 40", 2),
        ("counts.csv --after c.json --unit counts", 2),
        ("turn.csv -o - --json", 2),
        ("turn.csv -o a.svg --polar a.svg", 2),
        ("turn.csv --polar rose.csv", 2),
        ("turn.csv -o turn.csv --force", 2),
        ("turn.csv -o c.json", 6),
        ("turn.csv --polar nowhere/rose.svg", 6),
        ("few.csv", 4),
        ("arc.csv --method two-axis", 4),
        ("arc.csv", 3),
        ("arc.csv --method ellipse", 3),
        ("side.csv", 4),
        ("turn.csv --plane yz", 4),
        ("still.csv", 4),
        ("line.csv", 4),
        ("line.csv --method ellipse", 4),
    ],
)
def test_what_a_tired_person_types_ends_in_a_message(bench: Path, line: str, code: int) -> None:
    shutil.copytree(bench, ".", dirs_exist_ok=True)
    ended = run(f"two-axis {line}")
    assert ended.exit_code == code, ended.output
    assert_sentences(" ".join(ended.output.split()), about="mean" if code == 3 else "")
    assert "Traceback" not in ended.output
    assert ("this looks like a turn" in ended.output) == (line in {"side.csv", "turn.csv --plane yz"})
    assert not any(wrong in ended.output for wrong in ("all directions", "all three", "each of its sides", "a sphere"))


def test_a_refused_turn_is_drawn_and_marked() -> None:
    save("arc.csv", read(np.arange(0.0, 270.0, 10.0)))
    ended = run("two-axis arc.csv --method two-axis --polar rose.svg -o c.json")
    assert ended.exit_code == 4
    assert "written to rose.svg" in ended.output
    assert "no calibration was written" in ended.output
    assert not Path("c.json").exists()
    picture = Path("rose.svg").read_text(encoding="utf-8")
    assert picture.count(">REFUSED: ") == 1
    assert picture.count('class="point ') == 2 * 27
    assert "heading good to" not in picture


def test_the_drawing_shows_every_point_before_and_after() -> None:
    field = read(np.arange(0.0, 360.0, 10.0))
    fit = flinders.fit(field, method="two-axis")
    turn = Turn.of("xy", field[:, :2], PlaneEllipse.of_points(field[:, :2]))
    picture = turn_drawing(turn, fit)
    assert picture.count('class="point ') == 2 * 36
    assert picture.count('class="iron-end"') == 1
    assert "prefers-color-scheme: dark" in picture
