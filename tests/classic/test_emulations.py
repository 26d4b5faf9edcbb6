"""The emulations of `benchmarks` held to their sources: what is exact, and rules written out a second time."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import magyc as benchmark
from benchmarks.emulations import EMULATIONS
from benchmarks.emulations.forgetting import forgetting
from benchmarks.emulations.gyro_windows import NeedsRate, OneAxisTurned, Steps, steps_of
from benchmarks.emulations.ladder import BUFFER_SIZE, RUNGS, NothingAccepted, bins_of, climbed, ladder, solved
from benchmarks.emulations.magyc_ls import gyro_bias, magyc_ls, windows_of
from benchmarks.emulations.px4_observer import px4_observer
from benchmarks.emulations.sar_kf import sar_kf
from benchmarks.emulations.sar_ls import sar_ls
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples
from tests.worlds import HARD_IRON, SOFT_IRON

from flinders import simulate
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.core.samples import Samples
from flinders.errors import FitError, NotAnEllipsoid, TooFewSamples
from flinders.estimators.algebraic import Algebraic, fit_error
from flinders.estimators.consistent import Consistent, fit_adjusted
from flinders.estimators.data import Readings
from flinders.summary.moments import Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid

pytestmark = pytest.mark.nightly  # algorithms of others, which `benchmarks` compares with

BARE: Final = simulate.Sensor(offset=HARD_IRON, noise=0.0)
CALM: Final = simulate.Imu(gyro_noise=0.0)
WITH_A_GYRO: Final = [sar_ls, sar_kf, px4_observer, magyc_ls]


def swayed(seed: int = 1, *, n: int = 1000, noise: float = 0.0, imu: simulate.Imu = CALM) -> Samples:
    sensor = replace(BARE, noise=noise)
    return simulate.tumble(seed, motion="swayed", n=n, sensor=sensor, imu=imu).samples


def turned(n: int, seed: int = 1, *, noise: float = 0.5, iron: Floats = SOFT_IRON, field: float = 50.0) -> Floats:
    rng = np.random.default_rng(seed)
    readings: Floats = (
        HARD_IRON + field * simulate.uniform_directions(rng, n) @ iron + noise * rng.standard_normal((n, 3))
    )
    return readings


# With a gyro: what is exact.


rates = st.tuples(*[st.floats(-40.0, 40.0)] * 3).map(np.array)


@given(rate=rates, seconds=st.floats(1e-4, 0.05), offset=rates)
@examples(60)
def test_a_step_of_any_constant_rate_obeys_the_equation_exactly(rate: Floats, seconds: float, offset: Floats) -> None:
    """Even where the body turns by two radians from one reading to the next."""
    field = np.array([30.0, -20.0, 35.0])
    after = simulate.turns([-rate * seconds])[0] @ field
    step = Steps(field + offset, (after + offset)[np.newaxis], np.array([seconds]), rate[np.newaxis])
    left = step.slope + np.cross(step.rate, step.middle - offset)
    assert np.abs(left).max() < 1e-9 * np.abs(step.slope).max() + 1e-7


@pytest.mark.parametrize("motion", ["hand", "eight", "swayed", "flight"])
def test_sar_ls_is_exact_without_noise(motion: str) -> None:
    recording = simulate.tumble(3, motion=motion, n=600, sensor=BARE, imu=CALM)
    npt.assert_allclose(sar_ls(recording.samples).centre, HARD_IRON, atol=1e-8)


def test_magyc_finds_iron_and_gyro_bias_exactly_without_noise() -> None:
    sensor, bias = simulate.Sensor(SOFT_IRON, HARD_IRON, noise=0.0), np.array([0.004, -0.005, 0.002])
    imu = simulate.Imu(gyro_bias=bias, gyro_noise=0.0)
    # The bias turns the step that Cayley's form was made for, so the step has to be short.
    recording = simulate.tumble(4, motion="swayed", rate_hz=400.0, n=8000, sensor=sensor, imu=imu).samples
    found = magyc_ls(recording, window=1)
    npt.assert_allclose(found.centre, HARD_IRON, atol=1e-4)
    npt.assert_allclose(found.shape / found.radius, SOFT_IRON / np.cbrt(np.linalg.det(SOFT_IRON)), atol=1e-6)
    npt.assert_allclose(gyro_bias(recording, window=1), bias, atol=1e-8)


def test_the_slopes_of_magycs_residuals_are_those_of_differences() -> None:
    windows = windows_of(swayed(noise=1.0, imu=simulate.Imu()), 25)
    theta = np.random.default_rng(1).normal(scale=0.2, size=11)
    _, jacobian = windows.residuals(theta)
    for column, nudge in enumerate(1e-6 * np.eye(11)):
        after, before = windows.residuals(theta + nudge)[0], windows.residuals(theta - nudge)[0]
        npt.assert_allclose(jacobian[:, :, column], (after - before) / 2e-6, atol=1e-8)


# The same written out another way.


def test_the_filter_is_the_least_squares_of_all_readings() -> None:
    """With a perfect gyro: x_k = E_k x₀ + (1 − E_k) b, one matrix, and the prior as rows of it."""
    samples = swayed(n=300, noise=0.5)
    [steps] = steps_of(samples)
    total, rows, values = np.eye(3), [], []
    for turn, seconds, reading in zip(steps.turn, steps.seconds, steps.last, strict=True):
        total = simulate.turns([-turn * seconds])[0] @ total
        rows.append(np.concatenate([total, np.eye(3) - total], axis=1) / 0.5)
        values.append(reading / 0.5)
    moments = Moments.of(samples.field)
    rows += [np.eye(6)[:3] / 0.5, np.eye(6)[3:] / moments.spread]
    values += [steps.first / 0.5, moments.mean / moments.spread]
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0][3:]
    npt.assert_allclose(sar_kf(samples, noise=0.5, gyro_noise=1e-12).centre, expected, atol=1e-6)


def test_the_observer_is_px4s_recursion() -> None:
    samples = swayed(n=400, noise=0.5, imu=simulate.Imu())
    assert samples.rate is not None
    assert samples.time is not None
    bias, last = np.zeros(3), samples.field[0]
    for field, gyro, seconds in zip(samples.field[1:], samples.rate, np.diff(samples.time), strict=False):
        predicted = last + np.cross(-gyro, last - bias) * seconds
        bias = bias + 20.0 * np.cross(-gyro, field - predicted) * seconds
        last = field
    npt.assert_allclose(px4_observer(samples).centre, bias, rtol=1e-9)


def test_forgetting_is_a_recursion_that_fades_its_sums() -> None:
    field, memory = turned(3000, 2), 400.0
    sums = Moments.empty()
    for block in np.array_split(field, 3000):
        sums = sums * math.exp(-1.0 / memory) + Moments.of(block)
    wanted, _ = fit_adjusted(Readings(replace(Summary.empty(), moments=sums)))
    assert forgetting(Samples(field), memory).isclose(wanted, rtol=1e-9)


def test_without_forgetting_it_is_consistent() -> None:
    field = turned(2000)
    assert forgetting(Samples(field)).isclose(Consistent().estimate(Readings.of(field)).ellipsoid, rtol=1e-12)


# What an emulation with a gyro refuses, and what it passes over.


@pytest.mark.parametrize("emulation", WITH_A_GYRO)
def test_without_a_gyro_or_times_there_is_no_step(emulation: Callable[[Samples], Ellipsoid]) -> None:
    samples = swayed()
    assert samples.time is not None
    for part in (replace(samples, rate=None), replace(samples, time=None)):
        with pytest.raises(NeedsRate, match="rate and times"):
            emulation(part)
    with pytest.raises(NeedsRate, match="follow each other"):
        emulation(replace(samples, time=samples.time[::-1].copy()))


@pytest.mark.parametrize("emulation", WITH_A_GYRO)
@pytest.mark.parametrize("motion", ["sweep-xy", "sweep-yz"])
def test_turning_about_one_axis_is_refused(emulation: Callable[[Samples], Ellipsoid], motion: str) -> None:
    """Σ WᵀW is singular; noise of the gyro, 5 mrad/s, only pretends that it is not."""
    recording = simulate.tumble(6, motion=motion, noise=0.3, sensor=BARE)
    with pytest.raises(OneAxisTurned, match="5% are needed"):
        emulation(recording.samples)


def test_an_observer_that_runs_away_is_no_calibration() -> None:
    hasty = simulate.tumble(7, motion="hand", rate_hz=5.0, n=2000, sensor=BARE)
    with pytest.raises(NotAnEllipsoid):
        px4_observer(hasty.samples, gain=500.0)


def test_magyc_wants_enough_windows() -> None:
    with pytest.raises(TooFewSamples, match="at least 201"):
        magyc_ls(swayed(n=200))
    assert magyc_ls(swayed(n=200), window=5).radius > 0.0


def test_a_gap_in_time_is_no_step() -> None:
    """Half a minute is missing: what comes after does not follow what was before, and no step leads across."""
    rest = np.ones(1500, dtype=bool)
    rest[400:1000] = False
    cut = swayed(n=1500)[rest]
    assert [len(one) for one in steps_of(cut)] == [399, 499]
    npt.assert_allclose(sar_ls(cut).centre, HARD_IRON, atol=1e-8)


def test_readings_whose_rate_is_not_known_are_left_out() -> None:
    samples = swayed(n=600)
    assert samples.rate is not None
    rate = samples.rate.copy()
    rate[200:260] = np.nan
    assert [len(one) for one in steps_of(replace(samples, rate=rate))] == [199, 339]
    npt.assert_allclose(sar_ls(replace(samples, rate=rate)).centre, HARD_IRON, atol=1e-8)


@pytest.mark.parametrize("emulation", EMULATIONS.values(), ids=EMULATIONS)
def test_anything_at_all_gives_an_ellipsoid_or_a_refusal(emulation: Callable[[Samples], Ellipsoid]) -> None:
    rng = np.random.default_rng(9)
    for size in (1e-6, 1.0, 1e6):
        for fast in (1e-9, 1.0, 1e6):
            samples = Samples(
                size * rng.normal(size=(700, 3)), time=np.arange(700) * 0.01, rate=fast * rng.normal(size=(700, 3))
            )
            try:
                found = emulation(samples)
            except FitError:
                continue
            assert np.isfinite(found.parameters).all()


# The solvers of the ladder.


def test_four_elements_are_a_sphere_and_ten_are_nxps_ellipsoid() -> None:
    field = turned(200)
    sphere, error = solved(field, 4, 50.0)
    assert sphere.isclose(Sphere().estimate(Readings.of(field)).ellipsoid, rtol=1e-9)
    assert error == pytest.approx(fit_error(Readings.of(field).summary.moments, sphere))
    general, _ = solved(field, 10, 50.0)
    assert general.isclose(Algebraic("nxp").estimate(Readings.of(field)).ellipsoid, rtol=1e-9)


def test_seven_elements_find_axes_without_cross_terms() -> None:
    gains = np.diag([0.9, 1.0, 1.2])
    found, error = solved(turned(150, noise=0.0, iron=gains), 7, 50.0)
    npt.assert_allclose(found.centre, HARD_IRON, atol=1e-8)
    npt.assert_allclose(found.shape, 50.0 * gains, atol=1e-8)
    assert error < 1e-9


@pytest.mark.parametrize("pitch_deg", [1.0, 5.0])
def test_an_open_surface_is_no_trial_though_its_determinant_is_positive(pitch_deg: float) -> None:
    """A level turn with a little pitch and no soft iron at all: ten elements often have two negative eigenvalues, which
    the sign of the determinant does not tell."""
    open_surfaces = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        yaw = np.linspace(0, 2 * np.pi, 180)
        pitch = np.deg2rad(pitch_deg) * np.sin(7 * yaw)
        north, down = math.cos(math.radians(60)), math.sin(math.radians(60))
        x = north * np.cos(yaw) * np.cos(pitch) - down * np.sin(pitch)
        z = north * np.cos(yaw) * np.sin(pitch) + down * np.cos(pitch)
        field = 50.0 * np.stack([x, -north * np.sin(yaw), z], axis=1) + 0.5 * rng.standard_normal((180, 3))
        try:
            found, _ = solved(field, 10, 50.0)
        except NotAnEllipsoid:
            open_surfaces += 1
        else:
            assert found.semi_axes[0] > 0.0
    assert open_surfaces > 0


# Its rules, written out a second time: index by index, one reading at a time.


def put(held: Floats, index: NDArray[np.int64], reading: Floats, place: tuple[int, int], loop: int) -> None:
    """The four cases of the buffer: full or not, bin taken or not."""
    is_full, is_free = int((index >= 0).sum()) == BUFFER_SIZE, index[place] == -1
    if is_full and is_free:
        ages = np.where(index >= 0, index, 10**9)
        index[np.unravel_index(int(ages.argmin()), ages.shape)] = -1
    elif not is_full and not is_free and np.abs(held[place] - reading).sum() >= 5.0:
        for other in np.ndindex(12, 24):
            if index[other] == -1:
                place = (other[0], other[1])
            elif np.abs(held[other] - reading).sum() < 5.0:
                return
    held[place], index[place] = reading, loop


def written_out(field: Floats) -> tuple[Floats, list[tuple[int, int]]]:
    """The offset in the end, and at which reading each rung was first in use."""
    index = -np.ones((12, 24), dtype=int)
    held = np.zeros((12, 24, 3))
    edges = [math.tan(math.pi * (-0.5 + (i + 1) / 12)) for i in range(11)]
    valid, error_aged, found, first = 0, 0.0, None, []
    for loop, reading in enumerate(field):
        x, y, z = (
            reading if found is None else found.radius * np.linalg.solve(found.shape, reading - found.centre)
        ).tolist()
        j = sum(x / z >= edge for edge in edges)
        k = sum(y / z >= edge for edge in edges) + (12 if x < 0 else 0)
        put(held, index, reading, (j, k), loop)
        if (loop + 1) % 20:
            continue
        buffer = held[index >= 0]
        if len(buffer) < 40:
            continue
        error_aged *= 1.02
        solver = 4 if len(buffer) < 100 else 7 if len(buffer) < 150 else 10
        try:
            trial, error = solved(buffer, solver, 50.0)
        except (NotAnEllipsoid, np.linalg.LinAlgError):
            continue
        if not 22.0 <= trial.radius <= 67.0:
            continue
        error = max(error, {4: 0.12, 7: 0.075, 10: 0.0}[solver])
        if valid == 0 or error <= error_aged or (solver > valid and error <= 0.04):
            if solver != valid:
                first.append((loop + 1, solver))
            valid, error_aged, found = solver, max(error, 0.02), trial
    assert found is not None
    return found.centre, first


in_microtesla = partial(Samples.of, unit="uT")


def rungs(samples: Samples) -> list[tuple[int, int]]:
    """At which reading each rung was first in use."""
    first: list[tuple[int, int]] = []
    for count, accepted in climbed(samples):
        if accepted is not None and (not first or first[-1][1] != accepted.elements):
            first.append((count, accepted.elements))
    return first


@pytest.mark.parametrize(
    ("motion", "seed", "n"),
    [("hand", 1, 900), ("uniform", 2, 500), ("hemisphere", 3, 600), ("tilted", 4, 900), ("eight", 5, 900)],
)
def test_the_rules_written_out_give_the_same(motion: str, seed: int, n: int) -> None:
    field = simulate.tumble(seed=seed, motion=motion, n=n, noise=0.5).samples.field
    centre, first = written_out(field)
    npt.assert_allclose(ladder(in_microtesla(field)).centre, centre, atol=1e-9)
    assert rungs(in_microtesla(field)) == first


def test_the_bins_are_twelve_by_twenty_four() -> None:
    bins = bins_of(simulate.uniform_directions(np.random.default_rng(1), 50_000))
    assert (bins.min(), bins.max()) == (0, 287)
    assert len(np.unique(bins)) > 250


def test_each_rung_needs_its_readings() -> None:
    """Directions all unlike each other, so that every reading is held."""
    samples = in_microtesla(turned(400))
    first = {elements: count for count, elements in rungs(samples)}
    assert list(first) == [4, 7, 10]
    for rung in RUNGS:
        assert rung.least <= first[rung.elements] <= rung.least + 60
    npt.assert_allclose(ladder(samples).centre, HARD_IRON, atol=0.5)


@pytest.mark.parametrize(
    ("field", "accepted"), [(10.0, False), (21.0, False), (30.0, True), (60.0, True), (70.0, False)]
)
def test_only_a_field_of_the_earth_is_accepted_and_only_where_the_unit_is_known(field: float, accepted: bool) -> None:
    readings = turned(500, field=field, noise=0.2, iron=np.eye(3))
    assert ladder(Samples.of(readings, unit="counts")).radius == pytest.approx(field, rel=0.02)
    if accepted:
        assert ladder(in_microtesla(readings)).radius == pytest.approx(field, rel=0.02)
        return
    with pytest.raises(NothingAccepted):
        ladder(in_microtesla(readings))


def test_counts_of_any_size_climb_alike() -> None:
    one, other = (ladder(Samples.of(size * turned(800), unit="counts")) for size in (1.0, 37.0))
    npt.assert_allclose(other.centre / 37.0, one.centre, atol=1e-6)


def test_an_aged_error_lets_a_changed_offset_in() -> None:
    """Iron comes near: what is in use is good for a while, then the readings before are forgotten one by one."""
    field = turned(6000)
    field[2000:] += [15.0, 0.0, 0.0]
    npt.assert_allclose(ladder(in_microtesla(field)).centre, HARD_IRON + np.array([15.0, 0.0, 0.0]), atol=0.6)


def test_readings_alike_are_no_forty_readings() -> None:
    """A sensor at rest for ten minutes."""
    still = HARD_IRON + [50.0, 0.0, 0.0] + 0.3 * np.random.default_rng(1).standard_normal((3000, 3))
    with pytest.raises(NothingAccepted):
        ladder(in_microtesla(still))


# The benchmark that compares them.


def test_the_truth_scores_nothing_and_its_errors_score_what_they_are() -> None:
    rocked = benchmark.rocked("WAM", 1)
    perfect = benchmark.Answer(HARD_IRON, 7.0 * np.linalg.inv(SOFT_IRON), benchmark.GYRO_BIAS, 0.5)
    assert benchmark.scored(perfect, rocked).row == pytest.approx((0.0, 0.0, 0.0, 1.0, 0.5), abs=1e-9)
    off = benchmark.scored(benchmark.Answer(HARD_IRON + np.array([0.0, 30.0, 40.0]), np.eye(3), None, 0.5), rocked)
    assert off.offset == pytest.approx(50.0)
    assert off.iron == pytest.approx(0.2841, abs=1e-4)  # of MAGYC's own iron, which an offset alone leaves
    assert np.isnan(off.bias)
    assert off.heading > 2.0
