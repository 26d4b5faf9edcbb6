"""What is merged does not care for order, for the strength of unknown fields, or in how many steps it is merged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sentences import assert_raises
from tests.trials import examples
from tests.worlds import RANDOM_SENSOR

import flinders
from flinders import simulate
from flinders.comparison.merging import NotMerged, merge
from flinders.comparison.pairs import remove_scale, rescale_covariance, trace_with
from flinders.core.calibration import Calibration
from flinders.errors import UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.result import Fit, document_of, with_calibration, with_name
from flinders.geometry.ellipsoid import upper_entries

if TYPE_CHECKING:
    from flinders.diagnostics.repeatability import Repeats

KNOWN = (None, 50.0)


@cache
def judged(seed: int, *, motion: str = "uniform", field_strength: float | None = None) -> Fit:
    recording = simulate.tumble(seed=seed, motion=motion, n=600, sensor=RANDOM_SENSOR)
    fit = flinders.fit(recording.samples, site=flinders.Site(strength=field_strength))
    return with_name(fit, f"{motion} {seed}")


def in_field(one: Fit, factor: float) -> Fit:
    """The same sensor and noise, in a field that is so many times as strong."""
    known = one.calibration.field_strength * factor if one.calibration.field_strength_known else None
    stronger = Calibration.from_ellipsoid(
        one.calibration.offset, factor * one.calibration.shape, field_strength=known, raw=one.calibration.raw
    )
    claim = replace(one.claim, covariance=rescale_covariance(one.claim.covariance, factor))
    return with_calibration(replace(one, claim=claim), stronger)


def repeats(merged: Fit) -> Repeats:
    assert merged.evidence.diagnosis.repeats is not None
    return merged.evidence.diagnosis.repeats


def again(merged: Fit, name: str = "merged") -> Fit:
    return with_name(fit_from(document_of(merged)), name)


def same(found: Fit, expected: Fit, rtol: float = 1e-8) -> None:
    npt.assert_allclose(found.calibration.offset, expected.calibration.offset, rtol=rtol)
    npt.assert_allclose(found.calibration.matrix, expected.calibration.matrix, rtol=rtol, atol=rtol)
    sigma = np.sqrt(np.diag(expected.claim.covariance))
    npt.assert_allclose(
        found.claim.covariance / np.outer(sigma, sigma), expected.claim.covariance / np.outer(sigma, sigma), atol=1e-5
    )


@pytest.mark.parametrize("field_strength", KNOWN)
def test_order_does_not_matter(field_strength: float | None) -> None:
    parts = [judged(seed, motion=motion, field_strength=field_strength)
             for seed, motion in ((1, "uniform"), (2, "tilted"), (3, "hemisphere"))]  # fmt: skip
    first = merge(parts)
    for order in permutations(parts):
        found = merge(order)
        same(found, first)
        assert {finding.advice for finding in found.findings} == {finding.advice for finding in first.findings}
        assert repeats(found).most_deviating.source == repeats(first).most_deviating.source


@examples(15)
@given(st.lists(st.floats(0.4, 3.0), min_size=2, max_size=2))
def test_fields_of_any_strength_give_the_same_correction(factors: list[float]) -> None:
    """An unknown strength says nothing of the sensor, and a known one is taken out."""
    for field_strength in KNOWN:
        parts = [judged(seed, field_strength=field_strength) for seed in (1, 2)]
        plain = merge(parts)
        found = merge([in_field(part, factor) for part, factor in zip(parts, factors, strict=True)])
        npt.assert_allclose(found.calibration.offset, plain.calibration.offset, rtol=1e-8)
        npt.assert_allclose(found.calibration.matrix, plain.calibration.matrix, atol=1e-8)
        expected = plain.calibration.field_strength * np.sqrt(np.prod(factors))
        assert found.calibration.field_strength == pytest.approx(expected)
        assert repeats(found).p_value == pytest.approx(repeats(plain).p_value, rel=1e-6)


@pytest.mark.parametrize("field_strength", KNOWN)
def test_in_two_steps_it_comes_to_the_same(field_strength: float | None) -> None:
    """As long as nothing scatters beyond its claim, which would be claimed from then on."""
    parts = [judged(seed, field_strength=field_strength) for seed in range(1, 5)]
    claims = [
        replace(part, claim=replace(part.claim, covariance=9.0 * np.asarray(part.claim.covariance))) for part in parts
    ]
    at_once = merge(claims)
    assert not repeats(at_once).scatter.any()
    in_steps = merge([again(merge(claims[:2]), "first"), again(merge(claims[2:]), "second")])
    sigma = np.sqrt(np.diag(at_once.claim.covariance))
    off = np.concatenate(
        [
            in_steps.calibration.ellipsoid.centre - at_once.calibration.ellipsoid.centre,
            upper_entries(in_steps.calibration.ellipsoid.shape - at_once.calibration.ellipsoid.shape),
        ]
    )
    assert np.abs(off / sigma).max() < 0.01
    npt.assert_allclose(np.sqrt(np.diag(in_steps.claim.covariance)), sigma, rtol=0.01)


def test_with_itself_it_is_refused() -> None:
    with assert_raises(UsageError):
        merge([judged(1), judged(1)])
    with assert_raises(UsageError):
        merge([judged(1), with_name(judged(1), "copy")])


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
@examples(25)
def test_however_far_one_is_off_it_is_never_averaged_silently(x: float, y: float, z: float) -> None:
    one, other = judged(1), judged(2)
    moved = replace(other.calibration, offset=other.calibration.offset + np.array([x, y, z]))
    try:
        found = merge([one, replace(other, calibration=moved)])
    except NotMerged as refusal:
        found = refusal.fit
    between = repeats(found).most_deviating
    if between.difference_deg > 2.0 + 4.0 * between.difference_sigma_deg:
        assert found.verdict == "refused"
    elif between.difference_deg > 1.0 + 4.0 * between.difference_sigma_deg:
        assert found.verdict != "good"


def test_without_its_scale_a_covariance_knows_nothing_of_it() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(9, 9))
    reference = np.diag([40.0, 50.0, 60.0])
    shape = reference + np.array([[1.0, 0.5, 0.0], [0.5, -1.0, 0.2], [0.0, 0.2, 0.4]])
    shape *= 3.0 / (trace_with(reference) @ upper_entries(shape))
    found = remove_scale(root @ root.T, shape, reference)
    trace = np.concatenate([np.zeros(3), trace_with(reference)])
    npt.assert_allclose(found @ trace, 0.0, atol=1e-12)
    npt.assert_allclose(remove_scale(found, shape, reference), found, atol=1e-12)
    npt.assert_allclose(found[:3, :3], (root @ root.T)[:3, :3])
