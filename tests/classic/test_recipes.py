"""Recipes in what the library does with the fit of any method: guidance, comparison, merging, validation, claims."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.datasets import dataset, heading_error_deg
from tests.few_readings import ratio
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily
from tests.worlds import RANDOM_SENSOR, SOFT_IRON, errors, judged, method_with, rms, write_field

import flinders
from flinders import simulate
from flinders.apps.classic.recipes.li import Li
from flinders.comparison.comparison import compare
from flinders.comparison.cross_validation import cross_validate
from flinders.comparison.merging import merge
from flinders.errors import UsageError
from flinders.estimators import METHODS, Readings
from flinders.fitting.result import with_name
from flinders.heading.guidance import guide

if TYPE_CHECKING:
    from pathlib import Path

    from tests.trials import Choose

    from flinders.estimators import Estimator
    from flinders.simulate import Simulated


@pytest.mark.parametrize("estimator", [Li(), Li(k=4.0)], ids=repr)
@pytest.mark.parametrize("strengths", [0.0, 1.0, 10.0])
def test_readings_without_noise_give_the_truth_to_rounding(estimator: Estimator, strengths: float) -> None:
    """To a thousand-millionth of the field, also beside ten field strengths of hard iron."""
    offset = strengths * 50.0 * np.array([0.48, -0.6, 0.64])
    truth = simulate.tumble(seed=4, motion="uniform", n=300, sensor=simulate.Sensor(SOFT_IRON, offset))
    found = estimator.estimate(Readings.of(truth.samples))
    npt.assert_allclose(errors(found, truth) / 50.0, 0.0, atol=1e-9)
    assert found.noise < 1e-5 * 50.0


@pytest.mark.parametrize("count", daily([10, 12, 15, 20, 40], 3))
def test_the_claim_of_few_readings_is_true(count: int, trials: Choose) -> None:
    """A true claim gives 1.2 in the median and 2.1 at 90 %."""
    chosen = trials(200, 12)
    ratios = [ratio(seed, "sphere", count) for seed in chosen.seeds]
    assert np.median(ratios) < 1.4 ** (1.0 if chosen.widening == 1.0 else 2.0)
    assert np.quantile(ratios, 0.9) < 2.6 ** (1.0 if chosen.widening == 1.0 else 1.5)


def true_error_deg(estimator: Estimator, recording: Simulated) -> float:
    found = estimator.estimate(Readings.of(recording.samples)).ellipsoid
    return heading_error_deg(found.radius * np.linalg.inv(found.shape), found.centre, recording)


@pytest.mark.parametrize("method", ["sphere", "axes"])
@pytest.mark.parametrize("name", daily(["S1", "S3"]))
def test_validation_shows_the_true_error_where_the_model_is_too_simple(name: str, method: str) -> None:
    recordings = [dataset(name, trial, 0.5) for trial in range(6)]
    shown = rms([cross_validate(METHODS[method](), one.samples).heading_error_deg.rms for one in recordings])
    true = rms([true_error_deg(METHODS[method](), one) for one in recordings])
    assert true > 5.0
    assert 0.85 < shown / true < 1.2


@pytest.mark.parametrize("method", ["sphere", "axes"])
def test_a_method_that_holds_parameters_is_guided_too(method: str) -> None:
    sensor = simulate.Sensor.random(np.random.default_rng(2), noise=0.5, strength=0.6)
    fit = judged(simulate.tumble(seed=2, motion="tilted", n=150, sensor=sensor).samples.field, method=method)
    advice = guide(
        fit.calibration.ellipsoid, fit.claim.covariance, noise=fit.evidence.noise, coverage=fit.evidence.coverage,
        dip_deg=60.0, down=np.array([0.0, 0.0, np.copysign(1.0, fit.heading_error_deg.dip_deg)]), goal="heading",
    )  # fmt: skip
    assert np.isfinite([advice.after_deg, *advice.errors_deg]).all()
    assert advice.after_deg <= advice.worst_deg


def test_what_both_methods_hold_is_no_degree_of_freedom() -> None:
    recordings = [simulate.tumble(seed=seed, motion="uniform", sensor=simulate.Sensor(noise=0.5)) for seed in (1, 2)]
    fits = [
        flinders.fit(recording.samples, method="sphere", site=flinders.Site(strength=50.0)) for recording in recordings
    ]
    assert compare(*fits).freedom == 4


def test_a_simpler_method_is_not_weighted_as_exact() -> None:
    """A sphere says nothing of six parameters and claims to know them."""
    sensor = simulate.Sensor(np.eye(3), RANDOM_SENSOR.offset, 0.5)
    fits = [
        flinders.fit(simulate.tumble(seed=seed, motion="uniform", sensor=sensor).samples, method=method)
        for seed, method in ((1, "auto"), (2, "sphere"))
    ]
    parts = [with_name(fit, fit.evidence.method) for fit in fits]
    with assert_raises(UsageError):
        merge(parts)


@pytest.mark.parametrize(("method", "words", "option"), [("li", "k=4", 4.0), ("ellipsoid", "radii=xy", "xy")])
def test_options_of_a_recipe_reach_it(method: str, words: str, option: object, tmp_path: Path) -> None:
    path = tmp_path / "raw.csv"
    write_field(path, simulate.tumble(seed=1, motion="hand", n=500, sensor=RANDOM_SENSOR).samples.field)
    printed = flinders_("calibrate", str(path), "--method", method, "--option", words, "--target", "30", "--json").json
    chosen = method_with(method, **{words.partition("=")[0]: option})
    fit = flinders.fit(flinders.read(path), method=chosen, target_deg=30.0)
    npt.assert_allclose(printed["calibration"]["matrix"], fit.calibration.matrix)


def test_two_recordings_are_no_calibration_of_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for seed, name in ((3, "monday.csv"), (4, "tuesday.csv")):
        write_field(name, simulate.tumble(seed=seed, motion="uniform", sensor=RANDOM_SENSOR).samples.field)
    ended = flinders_("two-axis", "tuesday.csv", "--after", "monday.csv")
    assert (ended.code, ended.out) == (2, "")
    assert_sentences(ended.err)
