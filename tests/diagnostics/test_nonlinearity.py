"""Axes that answer along a curve are found, by their amount, and nothing else is taken for it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import Calibration, Samples
from flinders.core.joining import Joined
from flinders.core.linearization import Linearization
from flinders.diagnostics.systematic import AxisLag, nonlinearity_in
from flinders.errors import ArrayError, NotExportable, UsageError
from flinders.fitting.linearization import unchanged_reason
from flinders.geometry.ellipsoid import Ellipsoid, parameter_derivatives, symmetric_matrix
from flinders.geometry.sphere import fibonacci
from flinders.likelihood.magnitude import distances, information
from flinders.likelihood.site_field import Site
from flinders.native.engine import engine
from flinders.simulate import tumble
from flinders.summary.coverage import CELL_CENTRES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats

STRENGTH = 50.0


def curved(seed: int, *, quadratic: float = 0.0, cubic: float = 0.0, rows: int = 1000) -> Samples:
    """A tumble whose y axis reads too much."""
    samples = tumble(seed=seed, n=rows).samples
    field = np.array(samples.field)
    centre = engine().fit(field)["centre"]
    along = (field[:, 1] - centre[1]) / STRENGTH
    field[:, 1] += STRENGTH * (quadratic * along**2 + cubic * along**3)
    return Samples.of(field, unit="uT")


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.02, 0.0), (0.0, 0.05), (-0.015, 0.03)])
def test_the_terms_of_an_axis_are_found(quadratic: float, cubic: float) -> None:
    fit = flinders.fit(curved(3, quadratic=quadratic, cubic=cubic))
    found = fit.evidence.diagnosis.nonlinearity
    assert found is not None
    assert found.is_proven
    assert found.axis == "y"
    assert found.quadratic[1] == pytest.approx(quadratic, abs=0.006)
    assert found.cubic[1] == pytest.approx(cubic, abs=0.015)
    assert "nonlinear-axis" in {finding.code for finding in fit.findings}
    assert "structure" not in {finding.code for finding in fit.findings}
    assert fit.heading_error_deg.worst >= found.heading_deg


def test_the_claim_covers_what_the_axis_costs() -> None:
    """Without the terms the claim would be a tenth of the error."""
    truth, fit = flinders.fit(curved(5)), flinders.fit(curved(5, quadratic=0.02))
    worst = worst_error(fit.calibration, truth.calibration, 0.02, 0.0)
    assert worst > 5.0 * (fit.claim.textbook_heading_error_deg or fit.heading_error_deg).worst
    assert worst < 2.0 * fit.heading_error_deg.worst


def worst_error(calibration: Calibration, linear: Calibration, quadratic: float, cubic: float) -> float:
    """Largest error of a level heading, of a sensor as `curved` makes it, less its mean."""
    turned = np.radians(np.arange(0.0, 360.0, 5.0))
    level = 50.0 * np.stack([0.5 * np.cos(turned), -0.5 * np.sin(turned), np.full(72, np.sqrt(0.75))], axis=1)
    raw = level @ np.linalg.inv(linear.matrix).T + linear.offset
    along = (raw[:, 1] - linear.offset[1]) / STRENGTH
    raw[:, 1] += STRENGTH * (quadratic * along**2 + cubic * along**3)
    corrected = calibration.apply(raw)
    off = np.degrees(np.arctan2(-corrected[:, 1], corrected[:, 0]) - np.arctan2(-level[:, 1], level[:, 0]))
    off = (off + 180.0) % 360.0 - 180.0
    return float(np.abs(off - off.mean()).max())


TERMS = [(0.02, 0.0), (0.0, 0.05), (-0.015, 0.03), (0.04, 0.08)]


@pytest.mark.parametrize(("quadratic", "cubic"), daily(TERMS, 2))
def test_a_linearized_fit_is_as_good_as_it_claims(quadratic: float, cubic: float) -> None:
    """Where the plain one is off by 1° to 4°; the claim is neither too small nor idle."""
    shares = []
    for seed in range(12):
        fit = flinders.fit(curved(seed, quadratic=quadratic, cubic=cubic), linearize=True)
        if fit.calibration.linearization is None:  # 1,000 readings of some tumbles hardly see the axis
            continue
        assert fit.verdict == "good"
        assert "linearized" in {finding.code for finding in fit.findings}
        assert not {"nonlinear-axis", "structure"} & {finding.code for finding in fit.findings}
        linear = flinders.fit(curved(seed)).calibration
        shares.append(worst_error(fit.calibration, linear, quadratic, cubic) / fit.heading_error_deg.worst)
    assert len(shares) >= 8
    assert np.median(shares) < 1.5
    assert max(shares) < 3.0


def test_the_terms_are_those_that_make_readings_linear() -> None:
    """Of many readings without noise to speak of: the curve that was put on them comes off."""
    samples = tumble(seed=3, n=4000, noise=0.01).samples
    linear = flinders.fit(samples).calibration
    curve = Linearization(np.array([0.0, 6e-4, 0.0]), np.array([0.0, 2e-5, -1e-5]), np.full(3, 70.0))
    bent = replace(linear, linearization=curve).unapply(linear.apply(samples.field))
    fit = flinders.fit(replace(samples, field=bent), linearize=True)
    assert fit.calibration.linearization is not None
    npt.assert_allclose(fit.calibration.linearization.quadratic, curve.quadratic, atol=3e-6)
    npt.assert_allclose(fit.calibration.linearization.cubic, curve.cubic, atol=3e-7)
    npt.assert_allclose(fit.calibration.offset, linear.offset, atol=0.01)
    apart = fit.calibration.apply(bent) - linear.apply(samples.field)
    assert np.abs(apart).max() < 0.02


def test_what_is_not_known_of_the_terms_agrees_with_least_squares() -> None:
    """Of white noise: what terms do in the mean over all directions is in the covariance, the rest in the sigma."""
    field = tumble(seed=4, n=2000, motion="uniform").samples.field
    plain, record = (engine().fit(field, statistics=statistics, robust=0) for statistics in (1, 2))
    surface = Ellipsoid(record["centre"], symmetric_matrix(record["shape"]))
    directions = np.linalg.solve(surface.shape, (field - surface.centre).T)
    directions /= np.linalg.norm(directions, axis=0)
    jacobian = information(directions.T, surface)
    columns = np.hstack([jacobian, np.tile(jacobian[:, :3], 2) * displacements(surface, directions)])
    step, *_ = np.linalg.lstsq(columns, distances(field, surface), rcond=None)
    variance = np.sum((distances(field, surface) - columns @ step) ** 2) / (len(field) - 15)
    covariance = variance * np.linalg.inv(columns.T @ columns)
    reach, image = np.diag(surface.shape) / surface.radius, np.zeros((9, 6))
    image[:3, :3], image[3:6, 3:] = surface.radius * np.diag(reach**2) / 3.0, surface.radius * np.diag(reach**3) * 0.6
    of_terms = covariance[9:, 9:]
    steps = covariance[:9, 9:] @ np.linalg.inv(of_terms) + image
    added = (record["covariance"] - plain["covariance"]).reshape(9, 9)
    npt.assert_allclose(added, steps @ of_terms @ steps.T, atol=2e-3 * np.abs(added).max())
    angles = []
    for direction in CELL_CENTRES:
        moved = (
            np.diag(displacements(surface, direction[:, np.newaxis])[0, :3]),
            np.diag(displacements(surface, direction[:, np.newaxis])[0, 3:]),
        )
        left = np.hstack(moved) - parameter_derivatives(np.eye(3), np.tile(direction, (3, 1)).T) @ image
        turned = (np.eye(3) - np.outer(direction, direction)) @ np.linalg.solve(surface.shape, left)
        angles.append(np.linalg.eigvalsh(turned @ of_terms @ turned.T)[-1])
    assert record["is_white"]
    assert record["nonlinear_sigma_deg"] == pytest.approx(np.rad2deg(np.sqrt(max(angles))) / 0.5, rel=2e-3)


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.03, 0.0), (0.0, 0.06)])
@pytest.mark.parametrize("seen_to", [2.0, 0.4], ids=["whole", "one side missing"])
def test_a_linearized_fit_claims_what_it_is_off_in_every_direction(
    quadratic: float, cubic: float, seen_to: float
) -> None:
    """Also where the bent axis was not turned along the field: such a fit is limited."""
    ratios, verdicts = [], set()
    for seed in range(10):
        simulated = tumble(seed=seed, n=1500)
        sensor = Calibration(
            np.linalg.inv(simulated.sensor.matrix), simulated.sensor.offset, STRENGTH, rotation="estimated"
        )
        bent = _bent(simulated.samples.field, sensor.offset[1], quadratic, cubic)
        corrected = sensor.apply(simulated.samples.field)
        seen = corrected[:, 1] < seen_to * np.linalg.norm(corrected, axis=1)
        try:
            fit = flinders.fit(Samples.of(bent[seen], unit="uT"), linearize=True)
        except flinders.FitError:
            continue
        if fit.calibration.linearization is None:
            continue
        directions = fibonacci(400)
        raw = _bent(sensor.unapply(STRENGTH * directions), sensor.offset[1], quadratic, cubic)
        off = angles_between(fit.calibration.apply(raw), directions)
        ratios.append(off.max() / fit.claim.direction_error_deg.worst)
        verdicts.add(fit.verdict)
    assert len(ratios) >= 2
    assert verdicts == {"good" if seen_to > 1.0 else "limited"}
    assert np.median(ratios) < 1.8
    assert max(ratios) < 3.2


def _bent(field: Floats, centre: float, quadratic: float, cubic: float) -> Floats:
    """(N, 3) readings whose y axis reads too much."""
    bent, along = np.array(field), (field[:, 1] - centre) / STRENGTH
    bent[:, 1] += STRENGTH * (quadratic * along**2 + cubic * along**3)
    return bent


def angles_between(corrected: Floats, directions: Floats) -> Floats:
    """(N,) degrees between vectors and unit directions, a rotation of all of them taken off."""
    unit = corrected / np.linalg.norm(corrected, axis=1, keepdims=True)
    left, _, right = np.linalg.svd(unit.T @ directions)
    return np.asarray(np.degrees(np.arccos(np.sum(unit @ (left @ right) * directions, axis=1).clip(-1.0, 1.0))))


def test_a_disturbed_reading_does_not_fold_back() -> None:
    """The farther from the offset it is, the stronger the field that comes out."""
    fit = flinders.fit(curved(3, cubic=0.05), linearize=True)
    away = np.linspace(60.0, 400.0, 200)[:, np.newaxis] * np.eye(3)[1]
    lengths = np.linalg.norm(fit.calibration.apply(fit.calibration.offset + away), axis=1)
    assert (np.diff(lengths) > 0.0).all()
    npt.assert_allclose(fit.calibration.unapply(fit.calibration.apply(away)), away, atol=1e-9)


def test_why_nothing_was_linearized_is_said() -> None:
    fit = flinders.fit(curved(7), linearize=True)
    assert fit.evidence.diagnosis.nonlinearity is not None
    assert_sentences(unchanged_reason(fit))
    likely, lag = (
        replace(fit.evidence.diagnosis.nonlinearity, p_value=1e-6),
        AxisLag((0.02, -0.01, -0.01), True, 0.5, 1e-9),
    )
    for axis_lag in (None, lag):
        diagnosis = replace(fit.evidence.diagnosis, nonlinearity=likely, axis_lag=axis_lag)
        assert_sentences(unchanged_reason(replace(fit, evidence=replace(fit.evidence, diagnosis=diagnosis))))


def displacements(surface: Ellipsoid, directions: Floats) -> Floats:
    """(K, 6) by how much axes read more at (3, K) unit directions for quadratic terms of 1, and for cubic ones."""
    shares = (surface.shape @ directions).T / surface.radius
    return np.asarray(surface.radius * np.hstack([shares**2, shares**3]))


def test_linear_axes_stay_as_they_are() -> None:
    plain, asked = (flinders.fit(curved(7), linearize=linearize) for linearize in (False, True))
    assert asked.calibration.linearization is None
    assert asked.calibration.isclose(plain.calibration, tolerance=0.0)
    assert asked.heading_error_deg == plain.heading_error_deg


def test_the_file_keeps_terms_and_claim(tmp_path: Path) -> None:
    fit = flinders.fit(curved(3, cubic=0.05), linearize=True)
    fit.save(tmp_path / "bent.json")
    loaded = flinders.load(tmp_path / "bent.json")
    assert loaded.calibration.isclose(fit.calibration, tolerance=0.0)
    assert loaded.heading_error_deg == fit.heading_error_deg
    assert loaded.claim.heading_bound_deg == fit.claim.heading_bound_deg
    assert loaded.claim.structure_deg == pytest.approx(fit.claim.structure_deg, rel=1e-6)


@pytest.mark.parametrize(
    "options",
    [{"method": "consistent"}, {"aiding": "rate"}, {"disturbances": ["current"]}],
    ids=["method", "aid", "disturbance"],
)
def test_what_does_not_go_with_it_is_refused(options: dict[str, Any]) -> None:
    with assert_raises(UsageError):
        flinders.fit(curved(3), linearize=True, **options)


def test_readings_of_several_recordings_or_a_site_are_refused() -> None:
    parts = Joined((curved(3, cubic=0.05), curved(4, cubic=0.05)))
    with assert_raises(UsageError):
        flinders.fit(parts, linearize=True)
    with assert_raises(UsageError):
        flinders.fit(curved(3), linearize=True, site=Site(strength=50.0, gain_sigma=0.05))


def test_what_needs_offset_and_matrix_alone_is_refused() -> None:
    fit = flinders.fit(curved(3, cubic=0.05), linearize=True)
    uses: tuple[Callable[[], object], ...] = (
        lambda: fit.calibration.inv,
        lambda: fit.calibration @ fit.calibration,
        lambda: flinders.compare(fit, fit),
        lambda: flinders.merge([fit, fit]),
        lambda: flinders.refresh(curved(3, cubic=0.05), fit),
    )
    for use in uses:
        with assert_raises(UsageError):
            use()
    for target in ("json", "c-q15", "vectornav"):
        with assert_raises(NotExportable):
            flinders.export(fit.calibration, target)


def test_a_curve_that_folds_readings_is_refused() -> None:
    with assert_raises(ArrayError):
        Calibration(
            np.eye(3),
            np.zeros(3),
            50.0,
            linearization=Linearization(np.array([0.0, 0.012, 0.0]), np.zeros(3), np.full(3, 60.0)),
        )


@pytest.mark.parametrize("memory", daily([0, 20, 100], 2))
def test_noise_is_not_taken_for_it(memory: int, trials: Choose) -> None:
    """White noise, and slow noise of 20 and 100 readings, which its autocovariance alone would take for curves."""
    rng = np.random.default_rng(memory)
    chances = []
    for _ in trials(400, 60).seeds:
        directions = _directions(rng, 30, steps=20) if memory else _directions(rng, 600)
        field = directions @ (50.0 * np.eye(3) + _symmetric(rng)) + rng.normal(scale=0.4, size=(600, 3))
        record = engine().fit(field + _slow(rng, 600, memory))
        found = None if record["status"] else nonlinearity_in(record)
        if found is not None:
            chances.append(found.p_value)
    assert len(chances) > 40
    assert np.mean(np.array(chances) < 0.05) < 0.2
    assert min(chances) > 1e-4


def _directions(rng: np.random.Generator, count: int, *, steps: int = 1) -> Floats:
    """Random directions, or so many steps along the chords from each to the next."""
    corners = rng.normal(size=(count + 1, 3))
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    along = np.arange(steps)[:, np.newaxis] / steps
    directions = np.concatenate([(1.0 - along) * a + along * b for a, b in itertools.pairwise(corners)])
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _symmetric(rng: np.random.Generator) -> Floats:
    half = rng.normal(scale=4.0, size=(3, 3))
    return np.asarray(half + half.T) / 2.0


def _slow(rng: np.random.Generator, count: int, memory: int) -> Floats:
    """Ornstein-Uhlenbeck noise of 0.5 µT."""
    if not memory:
        return np.zeros((count, 3))
    keep, noise = np.exp(-1.0 / memory), np.empty((count, 3))
    noise[0] = rng.normal(scale=0.5, size=3)
    for row in range(1, count):
        noise[row] = keep * noise[row - 1] + rng.normal(scale=0.5 * np.sqrt(1.0 - keep**2), size=3)
    return noise
