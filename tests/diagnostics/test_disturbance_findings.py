"""Each wrong use of a disturbance is named: in a flight, and on the bench."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.trials import daily, nightly
from tests.worlds import ARMS, MOTORS, PER_AMPERE

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.comparison.evaluation import evaluate
from flinders.core.samples import Samples
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.regressor_quality import noise_of
from flinders.estimators.static_bench import fit_still
from flinders.findings import CATALOGUE
from flinders.fitting.result import Fit, Refused
from flinders.fitting.verdict import column_findings, noise_findings
from flinders.simulate import recording
from flinders.simulate.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit


def flown(seed: int = 1, n: int = 1500) -> Samples:
    return simulate.tumble(seed=seed, n=n, disturbances=[MOTORS]).samples


def followed(samples: Samples, *names: str) -> Fit:
    """Fit, also where the fit is refused."""
    try:
        return flinders.fit(samples, disturbances=names)
    except Refused as refused:
        return refused.fit


def codes(samples: Samples, *names: str) -> set[str]:
    return {finding.code for finding in followed(samples, *names).findings}


def current_of(samples: Samples) -> Floats:
    assert samples.current is not None
    return samples.current


QUIET: Final = {f"disturbance-{of}" for of in ("monotone", "noisy", "lag", "range", "collinear-attitude", "constant")}


@pytest.mark.parametrize("seed", daily(range(4)))
def test_nothing_is_said_of_a_current_that_is_right(seed: int) -> None:
    assert not codes(flown(seed), "current") & QUIET


def test_a_current_in_milliamperes_is_named() -> None:
    samples = flown()
    wrong = replace(samples, current=1000.0 * current_of(samples))
    told = next(finding for finding in followed(wrong, "current").findings if finding.code == "disturbance-range")
    assert told.number == pytest.approx(1000.0 * current_of(samples).max())
    assert_sentences(told.advice)


def test_a_current_with_the_wrong_sign_is_named() -> None:
    samples = flown()
    told = followed(replace(samples, current=-current_of(samples)), "current").findings
    assert "positive for autopilots" in next(one.advice for one in told if one.code == "disturbance-range")


def test_a_lag_beyond_the_search_is_named() -> None:
    """Logged two seconds early, with settings that last six: the end of the search is best."""
    slow = simulate.tumble(seed=1, disturbances=[replace(MOTORS, hold=6.0)]).samples
    early = replace(slow, current=np.append(current_of(slow)[100:], np.full(100, current_of(slow)[-1])))
    told = next(one for one in followed(early, "current").findings if one.code == "disturbance-lag")
    assert told.number == 1.0
    assert "disturbance-lag" not in codes(slow, "current")


def test_a_temperature_that_only_rises_is_named_whether_or_not_it_is_the_cause() -> None:
    """The offset drifts with time; the temperature rises meanwhile: nothing in the recording tells both apart."""
    simulated = simulate.tumble(seed=1, n=1500)
    time = simulated.samples.time
    assert time is not None
    drifted = simulated.samples.field + np.outer(time / time[-1], [2.0, -1.0, 1.0])
    rising = replace(simulated.samples, field=drifted, temperature=20.0 + 10.0 * time / time[-1])
    assert "disturbance-monotone" in codes(rising, "temperature")
    up_and_down = replace(rising, temperature=20.0 + 5.0 * np.sin(time / 3.0))
    assert "disturbance-monotone" not in codes(up_and_down, "temperature")


@pytest.mark.nightly
def test_a_noisy_meter_is_named_with_what_it_costs(trials: Choose) -> None:
    """Noise of 3 A: the offset per ampere is 15 % too small, and said to be so by 12 %, in seeds 0 to 5."""
    losses, told = [], []
    for seed in trials(3, 2).seeds:
        samples = flown(seed, n=3000)
        noise = np.random.default_rng(seed + 100).normal(scale=3.0, size=3000)
        found = fit_disturbances([replace(samples, current=current_of(samples) + noise)], ("current",))
        losses.append(1.0 - float(found.disturbances[0].per_unit @ PER_AMPERE) / float(PER_AMPERE @ PER_AMPERE))
        told.append(found.estimates[0].attenuation)
    assert np.mean(losses) > 0.1
    assert np.mean(told) == pytest.approx(np.mean(losses), rel=0.35)
    assert "disturbance-noisy" in codes(replace(samples, current=current_of(samples) + noise), "current")


METERS: Final[dict[str, Callable[[Floats, np.random.Generator], Floats]]] = {
    "noise of 1 A": lambda current, rng: current + rng.normal(size=len(current)),
    "noise of 3 A": lambda current, rng: current + rng.normal(scale=3.0, size=len(current)),
    "told twice a second": lambda current, _: np.repeat(current[::25], 25)[: len(current)],
    "whole 2 A": lambda current, _: 2.0 * np.round(0.5 * current),
}


@pytest.mark.parametrize("meter", daily(["whole 2 A", "noise of 3 A", "told twice a second", "noise of 1 A"]))
def test_a_claim_is_as_wide_as_its_meter_makes_it(meter: str, trials: Choose) -> None:
    """Seeds 0 to 11, nees of x: 14, 78, 17 and 5 by the scatter of the readings alone, 0.7 to 2.1 as claimed."""
    nees, claim = [], trials(4, 2)
    for seed in claim.seeds:
        samples = flown(seed, n=3000)
        told = METERS[meter](current_of(samples), np.random.default_rng(900 + seed))
        found = fit_disturbances([replace(samples, current=told)], ("current",))
        nees.append((found.disturbances[0].per_unit - PER_AMPERE) ** 2 / np.diag(found.covariance))
    assert np.mean(nees) < 3.0**claim.widening


def test_an_exact_meter_does_not_widen_a_claim() -> None:
    """Settings that are held, of which readings miss nothing that fast changes would show."""
    rng = np.random.default_rng(1)
    settings = np.repeat(rng.uniform(0.0, 20.0, 30), 100)
    assert noise_of(settings, rng.normal(size=3000), np.ones(3000)).square == 0.0


def metered(seed: int, rate_hz: float, lag_s: float, noise: float) -> Samples:
    """A minute in which a current wanders, by a meter with so much noise in A, whose readings come so much later."""
    simulated = simulate.tumble(seed=seed, n=1500, rate_hz=rate_hz)
    time, rng = simulated.samples.time, np.random.default_rng([31, seed])
    assert time is not None
    often = np.arange(time[0] - 2.0, time[-1] + 2.0, 0.01)
    slow = np.convolve(rng.normal(size=len(often) + 200), np.hanning(201) / np.linalg.norm(np.hanning(201)), "valid")
    drawn, late = (10.0 + 3.0 * np.interp(time - lag, often, slow) for lag in (0.0, lag_s))
    field = simulated.samples.field + np.outer(late, PER_AMPERE)
    return replace(simulated.samples, field=field, current=drawn + rng.normal(scale=noise, size=len(time)))


@pytest.mark.parametrize("noise", daily([1.0, 0.0, 0.3]))
@pytest.mark.parametrize("readings", daily([3.0, 0.0, 0.5, 2.5]))
def test_a_noisy_meter_makes_no_lag_and_hides_none(readings: float, noise: float, trials: Choose) -> None:
    """Seeds 0 to 9: between two readings interpolation halves the noise, so that a lag by half of one would fit."""
    claim = trials(10, 3)
    scores = []
    for seed in claim.seeds:
        found = fit_disturbances([metered(seed, 25.0, readings / 25.0, noise)], ("current",))
        scores.append((found.disturbances[0].lag_s - readings / 25.0) / found.estimates[0].lag_sigma_s)
        assert found.disturbances[0].lag_s == 0.0 or readings
    assert np.sqrt(np.mean(np.square(scores))) < 1.5**claim.widening


def test_a_noisy_meter_on_the_bench_makes_no_lag(trials: Choose) -> None:
    for seed in trials(10, 3).seeds:
        found = fit_still([bench(RUNS, noise=1.0, seed=seed)], ["current"])
        assert found is not None
        assert found.disturbances[0].lag_s == 0.0


def by_four(seed: int, noise: float) -> simulate.Simulated:
    """A minute with four motors that hardly part, by meters with so much noise in A."""
    return simulate.tumble(seed=seed, disturbances=[simulate.Motors(ARMS, apart=0.05, noise=noise)])


@pytest.mark.nightly
def test_noisy_meters_of_motors_that_go_together_are_in_the_claim(trials: Choose) -> None:
    """Seeds 0 to 9: little but noise parts these motors. Of P, and of the heading where none runs."""
    claim = trials(10, 3)
    nees, ratios = [], []
    for seed in claim.seeds:
        flight = by_four(seed, 0.3)
        fit = followed(flight.samples, "currents")
        assert fit.evidence.disturbances.covariance is not None
        error = np.concatenate([disturbance.per_unit for disturbance in fit.calibration.disturbances]) - ARMS.ravel()
        nees.append(error @ np.linalg.solve(fit.evidence.disturbances.covariance[9:, 9:], error) / len(error))
        ratios.append(evaluate(fit, Truth.of(flight)).heading_ratio)
    assert np.mean(nees) < 1.6**claim.widening
    assert np.sqrt(np.mean(np.square(np.array(ratios, float)))) < 1.5**claim.widening


def test_noisy_meters_of_several_motors_are_one_finding_that_names_all() -> None:
    fit = followed(by_four(1, 1.0).samples, "currents")
    [told] = [finding for finding in fit.findings if finding.code == "disturbance-noisy"]
    noisy = [driven.name for driven in fit.evidence.disturbances.estimates if driven.attenuation > told.limit]
    assert len(noisy) > 1
    assert_sentences(told.advice)
    assert told.number == max(driven.attenuation for driven in fit.evidence.disturbances.estimates)
    notes = [finding.advice for finding in fit.findings if finding.code == "disturbance"]
    assert_sentences(notes)
    alone = next(one.advice for one in followed(flown(), "current").findings if one.code == "disturbance")
    assert "other motors" not in alone


def test_two_drivers_that_go_together_are_named() -> None:
    samples = flown()
    together = replace(samples, throttle=np.clip(current_of(samples) / 20.0, 0.0, 1.0))
    told = codes(together, "current", "throttle")
    assert "disturbances-collinear" in told
    assert "disturbance-collinear-attitude" not in told


# on the bench


def bench(current: Floats, *, noise: float = 0.0, moved: Floats | None = None, seed: int = 1) -> Samples:
    """A sensor that lies still, noise of its own 0.3 µT, while a motor draws a current."""
    rng = np.random.default_rng(seed)
    field = np.array([20.0, -5.0, 43.0]) + np.outer(current, PER_AMPERE) + rng.normal(scale=0.3, size=(len(current), 3))
    field = field if moved is None else field + moved
    time = np.arange(len(current)) / 50.0
    return Samples.of(field, unit="uT", time=time, current=current + noise * rng.standard_normal(len(current)))


RUNS: Final = 10.0 - 10.0 * np.cos(np.arange(600) / 600 * 4.0 * np.pi)
"""A, up and down twice."""


def of_bench(samples: Samples) -> set[str]:
    found = fit_still([samples], ["current"])
    assert found is not None
    columns = (one for each in found.estimates for one in column_findings(each))
    return {one.code for one in (*found.findings, *noise_findings(found.estimates), *columns)}


def test_a_good_bench_has_no_findings_and_true_claims(trials: Choose) -> None:
    """Seeds 0 to 39: nees of the three numbers; 1.0 ± 0.13 by chance."""
    nees, claim = [], trials(40, 10)
    for seed in claim.seeds:
        samples = bench(RUNS, seed=seed)
        assert not of_bench(samples)
        found = fit_still([samples], ["current"])
        assert found is not None
        error = found.disturbances[0].per_unit - PER_AMPERE
        nees.append(error @ np.linalg.solve(found.covariance, error) / 3.0)
    low, high = claim.ratios(0.6, 1.5)
    assert low < np.mean(nees) < high


def test_two_steps_only_are_named() -> None:
    """Off, then on: whatever else changed when the motor was switched on is taken for the motor's."""
    assert of_bench(bench(np.repeat([0.0, 15.0], 300))) == {"disturbance-monotone"}
    assert of_bench(bench(np.tile(np.repeat([0.0, 15.0], 100), 3))) == set()


def test_a_sensor_that_moved_once_is_named() -> None:
    moved = np.outer(np.arange(600) >= 250, [1.0, 0.5, 0.0])
    found = fit_still([bench(RUNS, moved=moved)], ["current"])
    assert found is not None
    assert found.step == pytest.approx(np.hypot(1.0, 0.5), rel=0.2)
    assert of_bench(bench(RUNS, moved=moved)) == {"bench-moved"}


def test_a_noisy_current_on_the_bench_is_named() -> None:
    assert of_bench(bench(RUNS, noise=3.0)) == {"disturbance-noisy"}
    assert of_bench(bench(RUNS, noise=0.5)) == set()  # less than 2 %


@pytest.mark.parametrize("seed", daily(range(3)))
def test_a_sensor_that_a_motor_lifts_is_named_by_the_vertical(seed: int) -> None:
    """Four degrees over the range: nothing of it is left in the readings; a quarter of a degree is not named."""
    rng = np.random.default_rng(seed)
    for degrees, expected in ((4.0, {"bench-tilted"}), (0.25, set()), (0.0, set())):
        leaning = np.radians(degrees) * RUNS / np.ptp(RUNS)
        down = np.stack([np.sin(leaning), 0.0 * leaning, -np.cos(leaning)], axis=1)
        felt = 9.81 * down + rng.normal(scale=0.05, size=down.shape)
        lifted = replace(bench(RUNS, seed=seed), acceleration=felt)
        found = fit_still([lifted], ["current"])
        assert found is not None
        assert of_bench(lifted) == expected
        assert found.tilted_deg == pytest.approx(degrees, abs=0.15)


def test_noise_of_an_accelerometer_on_the_bench_is_no_tilt() -> None:
    """Vibration of 5 m/s² by the same recording: what it makes of the vertical by chance is not said."""
    rng = np.random.default_rng(5)
    felt = np.array([0.0, 0.0, -9.81]) + rng.normal(scale=5.0, size=(600, 3))
    assert of_bench(replace(bench(RUNS), acceleration=felt)) == set()


# curves, and where the offset holds


def driven_by(values: Floats, made: Floats, *, noise: float = 0.4, seed: int = 1) -> Samples:
    """A tumble whose x axis is off by what a throttle makes."""
    sensor = simulate.Sensor(noise=noise)
    samples = simulate.tumble(seed=seed, n=len(values), sensor=sensor).samples
    return replace(samples, field=samples.field + np.outer(made, [1.0, 0.0, 0.0]), throttle=values)


def wandering(low: float, high: float, count: int = 1500, seed: int = 3) -> Floats:
    """Settings of 15 readings each, anywhere in between."""
    return np.repeat(np.random.default_rng(seed).uniform(low, high, count // 15), 15)


@pytest.mark.parametrize("seed", [0, *map(nightly, (1, 2))])
def test_a_field_that_goes_with_the_square_is_named(seed: int) -> None:
    """From no throttle to full: a straight line leaves a sixth of it at either end."""
    throttle = wandering(0.0, 1.0, seed=seed)
    square, line = (driven_by(throttle, made, seed=seed) for made in (20.0 * throttle**2, 20.0 * throttle))
    [driven] = followed(square, "throttle").evidence.disturbances.estimates
    assert driven.curvature == pytest.approx(1.0 / 6.0, rel=0.15)
    assert "disturbance-nonlinear" in codes(square, "throttle")
    assert followed(line, "throttle").evidence.disturbances.estimates[0].curvature == 0.0
    assert not codes(line, "throttle") & {"disturbance-nonlinear", "disturbance-reference"}


def test_a_square_on_the_bench_is_named() -> None:
    made = np.outer(RUNS**2 / RUNS.max() - RUNS, PER_AMPERE)
    assert of_bench(bench(RUNS, moved=made)) == {"disturbance-nonlinear"}


def test_a_range_far_from_where_the_offset_holds_is_named() -> None:
    """A hover at 0.35 to 0.65 of the throttle says nothing of none; of a current a straight line does."""
    throttle = wandering(0.35, 0.65)
    hover = driven_by(throttle, 20.0 * throttle)
    told = next(one for one in followed(hover, "throttle").findings if one.code == "disturbance-reference")
    assert told.severity == "limits"
    assert told.number == pytest.approx(0.35 / 0.3, rel=0.05)
    assert "extrapolated" in told.advice
    as_current = replace(hover, current=20.0 * throttle, throttle=None)
    noted = next(one for one in followed(as_current, "current").findings if one.code == "disturbance-reference")
    assert noted.severity == "note"
    assert noted.number == pytest.approx(told.number)
    near = wandering(0.1, 0.7)
    assert "disturbance-reference" not in codes(driven_by(near, 20.0 * near), "throttle")


# commands


def run(*words: str, code: int = 0) -> str:
    ended = CliRunner().invoke(main, list(words), prog_name="flinders")
    assert ended.exit_code == code, ended.output
    return ended.stdout


def write(samples: Samples, path: Path) -> None:
    path.write_text("\n".join(recording.lines(samples)) + "\n")


def test_what_lies_beyond_the_recorded_range_is_a_finding_in_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    flight = simulate.tumble(seed=3, disturbances=[MOTORS])
    write(flight.samples, tmp_path / "flight.csv")
    harder = simulate.tumble(seed=4, sensor=flight.sensor, disturbances=[replace(MOTORS, amperes=30.0)])
    write(harder.samples, tmp_path / "harder.csv")
    run("calibrate", "flight.csv", "--with", "current", "-o", "c.json")
    for words in (
        ("apply", "c.json", "harder.csv", "-o", "out.csv", "--json"),
        ("heading", "c.json", "harder.csv", "-o", "h.csv", "--json"),
        ("check", "c.json", "harder.csv", "--json"),
    ):
        [finding] = json.loads(run(*words))["findings"]
        assert finding["code"] == "disturbance-beyond"
        assert 0.3 < finding["number"] < 0.7
    assert json.loads(run("apply", "c.json", "flight.csv", "-o", "same.csv", "--json"))["findings"] == []


def test_a_bench_that_says_too_little_is_written_with_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(bench(np.repeat([0.0, 15.0], 300)), tmp_path / "bench.csv")
    write(simulate.tumble(seed=3).samples, tmp_path / "calm.csv")
    run("calibrate", "calm.csv", "-o", "calm.json")
    words = ("calibrate", "bench.csv", "--with", "current", "--previous", "calm.json", "-o", "flown.json", "--json")
    found = json.loads(run(*words, code=3))
    assert [finding["code"] for finding in found["findings"]] == ["disturbance-monotone"]
    assert {finding["code"] for finding in found["findings"]} <= set(CATALOGUE)
