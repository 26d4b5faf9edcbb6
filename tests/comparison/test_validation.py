"""Cross-validation by blocks of time shows the error that there is, whatever a method claims."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.datasets import dataset, heading_error_deg
from tests.sentences import assert_raises
from tests.trials import daily
from tests.worlds import rms

from flinders import simulate
from flinders.comparison.cross_validation import NotValidated, cross_validate
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.estimators import METHODS, Readings
from flinders.estimators.consistent import Consistent
from flinders.estimators.level import Level
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.minmax import MinMax

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.estimators import Estimator
    from flinders.simulate import Simulated


def true_error_deg(estimator: Estimator, recording: Simulated) -> float:
    found = estimator.estimate(Readings.of(recording.samples)).ellipsoid
    return heading_error_deg(found.radius * np.linalg.inv(found.shape), found.centre, recording)


@pytest.mark.parametrize("name", daily(["S1", "S3", "S4", "S7"], 3))
def test_it_is_the_true_error_where_noise_is_all_there_is(name: str, trials: Choose) -> None:
    method = Level() if name == "S7" else Likelihood()
    claim = trials(12, 5)
    recordings = [dataset(name, trial, 0.5) for trial in claim.seeds]
    shown = rms([cross_validate(method, one.samples).heading_error_deg.rms for one in recordings])
    low, high = claim.ratios(0.75, 1.35)
    assert low < shown / rms([true_error_deg(method, one) for one in recordings]) < high


@pytest.mark.parametrize("method", ["minmax"])
@pytest.mark.parametrize("name", daily(["S1", "S3"]))
def test_it_is_the_true_error_where_the_model_is_too_simple(name: str, method: str) -> None:
    recordings = [dataset(name, trial, 0.5) for trial in range(6)]
    shown = rms([cross_validate(METHODS[method](), one.samples).heading_error_deg.rms for one in recordings])
    true = rms([true_error_deg(METHODS[method](), one) for one in recordings])
    assert true > 5.0
    assert 0.85 < shown / true < 1.2


@pytest.mark.nightly
def test_a_simple_model_of_part_of_the_sphere_is_called_worse_than_it_is_and_never_better() -> None:
    """Level headings hang on what such a recording saw; the change of shape that it asks for reaches beyond."""
    recordings = [dataset("S4", trial, 0.5) for trial in range(12)]
    shown = rms([cross_validate(MinMax(), one.samples).heading_error_deg.rms for one in recordings])
    assert 1.5 < shown / rms([true_error_deg(MinMax(), one) for one in recordings]) < 4.0


@pytest.mark.nightly
def test_a_bias_of_the_equation_is_seen() -> None:
    """Plain least squares of readings tilted by up to 35°, which are noisy, is off by half a degree."""
    recordings = [dataset("S4", trial, 0.5) for trial in range(12)]
    validations = [cross_validate(METHODS["algebraic"](), one.samples) for one in recordings]
    shown = rms([one.heading_error_deg.rms for one in validations])
    assert rms([one.bias_deg for one in validations]) > 1.5 * rms([one.scatter_deg for one in validations])
    assert 0.6 < shown / rms([true_error_deg(METHODS["algebraic"](), one) for one in recordings]) < 1.2


def test_noise_of_the_readings_held_back_is_in_the_misfit_and_not_in_the_heading_error() -> None:
    found = cross_validate(Likelihood(), simulate.tumble(seed=2, n=4000, motion="uniform", noise=1.0).samples)
    assert found.misfit == pytest.approx(1.0, rel=0.05)
    assert found.bias_deg < found.scatter_deg < 0.2


def test_strays_that_are_not_asked_do_not_count_against_a_method() -> None:
    tumble = simulate.tumble(seed=3, n=1000, motion="uniform", outliers=0.03)
    asked = cross_validate(METHODS["robust"](), tumble.samples, counted=~tumble.outliers)
    everything = cross_validate(METHODS["robust"](), tumble.samples)
    assert asked.misfit < 1.5 < 3 * asked.misfit < everything.misfit


def test_blocks_are_stretches_of_time() -> None:
    """A tumble whose second half was moved by 3 µT: rows drawn at random would not show that its halves differ."""
    tumble = simulate.tumble(seed=4, n=1000, motion="uniform", noise=0.1)
    field: Floats = tumble.samples.field.copy()
    field[500:] += [3.0, 0.0, 0.0]
    order = np.random.default_rng(1).permutation(1000)
    in_time = cross_validate(Likelihood(), replace(tumble.samples, field=field), blocks=2)
    shuffled = cross_validate(Likelihood(), Samples(field[order]), blocks=2)
    assert in_time.heading_error_deg.rms > 5 * shuffled.heading_error_deg.rms


def test_it_scales_with_the_readings_and_does_not_know_their_unit() -> None:
    tumble = simulate.tumble(seed=5, n=300, motion="uniform").samples
    small, large = (cross_validate(Consistent(), Samples(tumble.field * unit)) for unit in (1.0, 1000.0))
    npt.assert_allclose(small.heading_error_deg.rms, large.heading_error_deg.rms, rtol=1e-6)
    npt.assert_allclose(small.misfit * 1000, large.misfit, rtol=1e-6)


def test_a_method_that_fails_without_one_block_says_which() -> None:
    """Readings above the plane only in the last block: without it all lie on a ring."""
    angle = np.linspace(0.0, 12.0, 90)
    ring = np.stack([50 * np.cos(angle), 50 * np.sin(angle), np.zeros(90)], axis=1)
    cap = simulate.tumble(seed=6, n=10, motion="uniform", sensor=simulate.Sensor()).samples.field
    with assert_raises(NotValidated) as caught:
        cross_validate(METHODS["algebraic"](), Samples(np.concatenate([ring, cap])))
    assert caught.value.evidence == {"block": 10, "blocks": 10}


@pytest.mark.parametrize(("rows", "blocks"), [(100, 1), (100, 0), (39, 10), (0, 2)])
def test_too_few_blocks_or_readings_are_refused(rows: int, blocks: int) -> None:
    with assert_raises(UsageError):
        cross_validate(MinMax(), Samples(np.ones((rows, 3))), blocks=blocks)
