"""The published methods that go by field and gyro: exact where they should be, refused where they must be."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import magyc as benchmark
from benchmarks.terms_recordings import clusters
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Joined, Samples
from flinders.errors import FitError, NeedsRate, NeedsSamples, NotAnEllipsoid, OneAxisTurned, TooFewSamples, UsageError
from flinders.estimators import METHODS, Estimator, MagycLs, Px4Observer, Readings, SarKf, SarLs
from flinders.estimators.reference.gyro_windows import Steps, steps_of
from flinders.estimators.reference.magyc_ls import Windows, settled
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

OFFSET: Final = np.array([20.0, 120.0, 90.0])
IRON: Final = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])
BARE: Final = simulate.Sensor(offset=OFFSET, noise=0.0)
CALM: Final = simulate.Imu(gyro_noise=0.0)
ALL: Final[list[Estimator]] = [SarLs(), SarKf(), Px4Observer(), MagycLs()]


def label(estimator: Estimator) -> str:
    return estimator.name


def swayed(seed: int = 1, *, n: int = 1000, noise: float = 0.0, imu: simulate.Imu = CALM) -> Samples:
    sensor = replace(BARE, noise=noise)
    return simulate.tumble(seed, motion="swayed", n=n, sensor=sensor, imu=imu).samples


def offset_of(estimator: Estimator, samples: Samples) -> Floats:
    return estimator.estimate(Readings.of(samples)).ellipsoid.centre


# what is exact


rates = st.tuples(*[st.floats(-40.0, 40.0)] * 3).map(np.array)


@given(rate=rates, seconds=st.floats(1e-4, 0.05), offset=rates)
@settings(max_examples=60)
def test_a_step_of_any_constant_rate_obeys_the_equation_exactly(rate: Floats, seconds: float, offset: Floats) -> None:
    """Even where the body turns by two radians from one reading to the next."""
    field = np.array([30.0, -20.0, 35.0])
    turned = simulate.turns([-rate * seconds])[0] @ field
    step = Steps(field + offset, (turned + offset)[np.newaxis], np.array([seconds]), rate[np.newaxis])
    left = step.slope + np.cross(step.rate, step.middle - offset)
    assert np.abs(left).max() < 1e-9 * np.abs(step.slope).max() + 1e-7


@pytest.mark.parametrize("motion", ["hand", "eight", "swayed", "flight"])
def test_sar_ls_is_exact_without_noise(motion: str) -> None:
    recording = simulate.tumble(3, motion=motion, n=600, sensor=BARE, imu=CALM)
    npt.assert_allclose(offset_of(SarLs(), recording.samples), OFFSET, atol=1e-8)


def test_magyc_finds_iron_and_gyro_bias_exactly_without_noise() -> None:
    sensor, bias = simulate.Sensor(IRON, OFFSET, noise=0.0), np.array([0.004, -0.005, 0.002])
    imu = simulate.Imu(gyro_bias=bias, gyro_noise=0.0)
    # The bias turns the step that Cayley's form was made for, so the step has to be short.
    recording = simulate.tumble(4, motion="swayed", rate_hz=400.0, n=8000, sensor=sensor, imu=imu).samples
    readings = Readings.of(recording)
    found = MagycLs(window=1).estimate(readings).ellipsoid
    npt.assert_allclose(found.centre, OFFSET, atol=1e-4)
    npt.assert_allclose(found.shape / found.radius, IRON / np.cbrt(np.linalg.det(IRON)), atol=1e-6)
    windows = Windows.of(steps_of(readings, "magyc-ls"), OFFSET, 50.0, 1)
    npt.assert_allclose(settled(windows, "magyc-ls")[8:], bias, atol=1e-8)


def test_the_slopes_of_magycs_residuals_are_those_of_differences() -> None:
    samples = swayed(noise=1.0, imu=simulate.Imu())
    windows = Windows.of(steps_of(Readings.of(samples), "magyc-ls"), OFFSET, 50.0, 25)
    theta = np.random.default_rng(1).normal(scale=0.2, size=11)
    _, jacobian = windows.residuals(theta)
    for column, nudge in enumerate(1e-6 * np.eye(11)):
        after, before = windows.residuals(theta + nudge)[0], windows.residuals(theta - nudge)[0]
        npt.assert_allclose(jacobian[:, :, column], (after - before) / 2e-6, atol=1e-8)


# agreement with the same written out another way


def test_the_filter_is_the_least_squares_of_all_readings() -> None:
    """With a perfect gyro: x_k = E_k x₀ + (1 − E_k) b, one matrix, and what was thought before as rows of it."""
    samples = swayed(n=300, noise=0.5)
    readings = Readings.of(samples)
    [steps] = steps_of(readings, "sar-kf")
    total, rows, values = np.eye(3), [], []
    for turn, seconds, reading in zip(steps.turn, steps.seconds, steps.last, strict=True):
        total = simulate.turns([-turn * seconds])[0] @ total
        rows.append(np.concatenate([total, np.eye(3) - total], axis=1) / 0.5)
        values.append(reading / 0.5)
    moments = readings.summary.moments
    rows += [np.eye(6)[:3] / 0.5, np.eye(6)[3:] / moments.spread]
    values += [steps.first / 0.5, moments.mean / moments.spread]
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0][3:]
    npt.assert_allclose(offset_of(SarKf(noise=0.5, gyro_noise=1e-12), samples), expected, atol=1e-6)


def test_the_observer_is_px4s_recursion() -> None:
    samples = swayed(n=400, noise=0.5, imu=simulate.Imu())
    assert samples.rate is not None
    assert samples.time is not None
    bias, last = np.zeros(3), samples.field[0]
    for field, gyro, seconds in zip(samples.field[1:], samples.rate, np.diff(samples.time), strict=False):
        predicted = last + np.cross(-gyro, last - bias) * seconds
        bias = bias + 20.0 * np.cross(-gyro, field - predicted) * seconds
        last = field
    npt.assert_allclose(offset_of(Px4Observer(), samples), bias, rtol=1e-9)


# what is claimed


@pytest.mark.parametrize("estimator", [SarLs(), SarKf()], ids=label)
def test_noise_alone_moves_the_offset_by_as_much_as_is_claimed(estimator: Estimator) -> None:
    """A bare sensor and a gyro without bias, 30 draws: nees of the three, over 3."""
    imu = CALM if estimator.name == "sar-ls" else simulate.Imu()  # it takes the gyro for perfect
    surprises = []
    for seed in range(30):
        n = 3000 if estimator.name == "sar-ls" else 1000  # of 20 s each block is a second, and the jackknife wide
        found = estimator.estimate(Readings.of(swayed(seed, n=n, noise=0.3, imu=imu)))
        error = found.ellipsoid.centre - OFFSET
        surprises.append(error @ np.linalg.solve(found.covariance[:3, :3], error) / 3.0)
    assert 0.65 < float(np.mean(surprises)) < 1.4


@pytest.mark.parametrize("method", [estimator.name for estimator in ALL])
def test_a_fit_knows_of_the_iron_that_its_method_does_not(method: str) -> None:
    sensor, imu = simulate.Sensor(IRON, OFFSET, noise=0.5), simulate.Imu(gyro_bias=np.array([0.004, -0.005, 0.002]))
    samples = simulate.tumble(5, motion="swayed", sensor=sensor, imu=imu).samples
    try:
        found = flinders.fit(samples, method=method, target_deg=20.0)
    except Refused as refusal:
        found = refusal.fit
    sigma = np.sqrt(np.diag(found.covariance)[:3])
    assert np.all(np.abs(found.calibration.offset - OFFSET) < 3.0 * sigma)
    assert found.bias_deg > 0.5 or method == "magyc-ls"  # whose model it is, and whose scatter explains the rest


# what is refused


@pytest.mark.parametrize("estimator", ALL, ids=label)
def test_without_a_gyro_or_times_it_is_said_what_is_missing(estimator: Estimator) -> None:
    samples = swayed()
    for part, missing in ((replace(samples, rate=None), "angular rate"), (replace(samples, time=None), "times")):
        with pytest.raises(
            NeedsRate, match=f"has no {missing}, and '{estimator.name}' goes by how the body turned"
        ) as no:
            estimator.estimate(Readings.of(part))
        assert no.value.missing == missing
    with pytest.raises(NeedsSamples):
        estimator.estimate(Readings(Readings.of(samples).summary))
    assert samples.time is not None
    with pytest.raises(NeedsRate, match="follow each other in time"):
        estimator.estimate(Readings.of(replace(samples, time=samples.time[::-1].copy())))


@pytest.mark.parametrize("estimator", ALL, ids=label)
@pytest.mark.parametrize("motion", ["sweep-xy", "sweep-yz"])
def test_turning_about_one_axis_is_refused_by_name(estimator: Estimator, motion: str) -> None:
    """Σ WᵀW is singular; noise of the gyro, 5 mrad/s, only pretends that it is not."""
    recording = simulate.tumble(6, motion=motion, noise=0.3, sensor=BARE)
    with pytest.raises(OneAxisTurned, match=r"about one axis alone .*roll or pitch as well") as refusal:
        estimator.estimate(Readings.of(recording.samples))
    assert refusal.value.found < 0.02
    with pytest.raises(OneAxisTurned, match="no rate is across its axis"):
        estimator.estimate(Readings.of(replace(recording.samples, rate=np.zeros_like(recording.samples.field))))


def test_an_observer_that_runs_away_is_no_calibration() -> None:
    hasty = simulate.tumble(7, motion="hand", rate_hz=5.0, n=2000, sensor=BARE)
    with pytest.raises(NotAnEllipsoid):
        Px4Observer(gain=500.0).estimate(Readings.of(hasty.samples))


def test_magyc_wants_enough_windows() -> None:
    with pytest.raises(TooFewSamples, match="'magyc-ls' needs at least 201"):
        MagycLs().estimate(Readings.of(swayed(n=200)))
    assert MagycLs(window=5).estimate(Readings.of(swayed(n=200))).ellipsoid.radius > 0.0


@pytest.mark.parametrize(
    ("method", "options", "said"),
    [
        ("sar-kf", {"noise": 0.0}, "noise is 0.0: need a positive number"),
        ("sar-kf", {"gyro_noise": "5"}, "gyro_noise is '5'"),
        ("px4-observer", {"gain": -1}, "gain is -1: need a positive number"),
        ("magyc-ls", {"window": 0}, "window is 0: need a number of readings"),
        ("magyc-ls", {"window": 2.5}, "window is 2.5"),
    ],
)
def test_options_that_mean_nothing_are_refused(method: str, options: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        METHODS[method](**options)


# recordings as they are


def test_a_gap_in_time_is_no_step() -> None:
    """Half a minute is missing: what comes after does not follow what was before, and no step leads across."""
    samples = swayed(n=1500)
    rest = np.ones(1500, dtype=bool)
    rest[400:1000] = False
    cut = samples[rest]
    steps = steps_of(Readings.of(cut), "sar-ls")
    assert [len(one) for one in steps] == [399, 499]
    npt.assert_allclose(offset_of(SarLs(), cut), OFFSET, atol=1e-8)
    assert cut.time is not None
    apart = Joined((cut[:400], cut[400:]))
    npt.assert_allclose(SarLs().estimate(Readings.of(apart)).ellipsoid.centre, OFFSET, atol=1e-8)


def test_readings_whose_rate_is_not_known_are_left_out() -> None:
    samples = swayed(n=600)
    assert samples.rate is not None
    rate = samples.rate.copy()
    rate[200:260] = np.nan
    steps = steps_of(Readings.of(replace(samples, rate=rate)), "sar-ls")
    assert [len(one) for one in steps] == [199, 339]
    npt.assert_allclose(offset_of(SarLs(), replace(samples, rate=rate)), OFFSET, atol=1e-8)


@pytest.mark.parametrize("method", ["sar-ls", "magyc-ls"])
def test_the_gyro_of_a_file_reaches_the_method(method: str, tmp_path: Path) -> None:
    samples = simulate.tumble(8, motion="swayed", sensor=replace(BARE, noise=0.3)).samples
    path = tmp_path / "swayed.csv"
    simulate.write_csv(samples, path)
    found = CliRunner().invoke(main, ["calibrate", str(path), "--method", method, "--target", "9", "--json"])
    assert found.exit_code in (0, 3), found.stderr
    assert f'"{method}"' in found.stdout
    bare = tmp_path / "bare.csv"
    rows = "\n".join(",".join(f"{value:.3f}" for value in row) for row in samples.field)
    bare.write_text(f"mx_uT,my_uT,mz_uT\n{rows}\n", encoding="utf-8")
    refused = CliRunner().invoke(main, ["calibrate", str(bare), "--method", method])
    assert refused.exit_code == 4
    assert "has no angular rate" in " ".join(refused.stderr.split())


@pytest.mark.parametrize("estimator", ALL, ids=label)
def test_anything_at_all_gives_an_ellipsoid_or_a_refusal(estimator: Estimator) -> None:
    rng = np.random.default_rng(9)
    for size in (1e-6, 1.0, 1e6):
        for fast in (1e-9, 1.0, 1e6):
            samples = Samples(
                size * rng.normal(size=(700, 3)), time=np.arange(700) * 0.01, rate=fast * rng.normal(size=(700, 3))
            )
            try:
                found = estimator.estimate(Readings.of(samples))
            except FitError:
                continue
            assert np.isfinite(found.ellipsoid.parameters).all()
            assert np.isfinite(found.covariance).all()


# the benchmark that compares them


def test_the_truth_scores_nothing_and_its_errors_score_what_they_are() -> None:
    rocked = benchmark.rocked("WAM", 1)
    perfect = benchmark.Answer(OFFSET, 7.0 * np.linalg.inv(IRON), benchmark.GYRO_BIAS, 0.5)
    assert benchmark.scored(perfect, rocked).row == pytest.approx((0.0, 0.0, 0.0, 1.0, 0.5), abs=1e-9)
    off = benchmark.scored(benchmark.Answer(OFFSET + np.array([0.0, 30.0, 40.0]), np.eye(3), None, 0.5), rocked)
    assert off.offset == pytest.approx(50.0)
    assert off.iron == pytest.approx(0.2841, abs=1e-4)  # of MAGYC's own iron, which an offset alone leaves
    assert np.isnan(off.bias)
    assert off.heading > 2.0


def test_headings_in_three_groups_are_found_whichever_way_they_point() -> None:
    rng = np.random.default_rng(10)
    for north in (5.0, 200.0, 330.0):
        headings = (north + np.repeat([0.0, 47.0, 91.0], 300) + rng.normal(scale=2.0, size=900)) % 360.0
        middles, spreads = np.transpose(clusters(headings))
        npt.assert_allclose(middles - middles[0], [0.0, 47.0, 91.0], atol=0.6)
        assert abs((middles[0] - north + 180.0) % 360.0 - 180.0) < 0.6
        npt.assert_allclose(spreads, 2.0, atol=0.4)
