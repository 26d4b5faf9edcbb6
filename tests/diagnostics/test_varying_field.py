"""A field that is not the same everywhere is told as such, not as a fault of the axes; faults of axes still are."""

from __future__ import annotations

import numpy as np
import pytest
from tests.diagnostics.test_nonlinearity import curved
from tests.trials import daily
from tests.worlds import SWAPS, carried_about, judged

from flinders import simulate
from flinders.diagnostics.axis_swap import axis_swap_of
from flinders.native.engine import engine

OF_AXES = {"nonlinear-axis", "axis-lag", "axis-swap"}
OF_FIELD = {"noise", "structure", "heading-error", "few-samples", "field-changed", "outliers", "unsteady-field"}
WITH_TERMS = [
    (17, 0.05, 1), (39, 0.05, 1), (14, 0.1, 1), (1, 0.1, 3), (4, 0.2, 3), (26, 0.2, 3), (4, 0.2, 10), (1, 0.35, 3),
    (8, 0.35, 10), (19, 0.35, 10), (17, 0.5, 1), (9, 0.5, 3), (30, 0.5, 3), (1, 0.5, 10), (29, 0.5, 10),
]  # fmt: skip
"""Seed, variation and turns of recordings in which chance does not explain terms of the axes."""


@pytest.mark.parametrize(("seed", "varies", "turns"), daily(WITH_TERMS, 3))
def test_a_field_that_varies_is_no_fault_of_the_axes(seed: int, varies: float, turns: float) -> None:
    fit = judged(carried_about(seed, varies=varies, turns=turns))
    codes = {finding.code for finding in fit.findings}
    assert not codes & OF_AXES
    assert codes & OF_FIELD
    assert fit.verdict != "good"


@pytest.mark.nightly
@pytest.mark.parametrize("turns", [1, 3, 10])
@pytest.mark.parametrize("varies", [0.05, 0.1, 0.2, 0.35, 0.5])
def test_of_many_recordings_in_varying_fields_none_has_a_fault_of_the_axes(varies: float, turns: float) -> None:
    fits = [judged(carried_about(seed, varies=varies, turns=turns)) for seed in range(40)]
    assert not any(finding.code in OF_AXES for fit in fits for finding in fit.findings)
    assert not any(fit.verdict == "good" for fit in fits)


def test_terms_that_are_not_the_same_throughout_stay_in_the_heading_error() -> None:
    """As a distortion, which costs as much as they would."""
    samples = carried_about(4, varies=0.2, turns=3)
    record = engine().fit(samples.field, time=samples.time)
    assert np.isnan(record["nonlinear_deg"])
    assert np.degrees(record["distortion"] / (record["radius"] * np.cos(np.radians(record["dip_deg"])))) > 1.0
    fit = judged(samples)
    assert fit.claim.structure_deg > 1.0
    assert fit.heading_error_deg.worst > fit.claim.structure_deg


def test_a_break_of_the_path_in_a_varying_field_is_no_swap() -> None:
    """Put right, readings lie 1.12 times closer to an ellipsoid, and still far off it."""
    field = carried_about(39, varies=0.35, turns=1, noise=1.5).field
    assert engine().fit(field, robust=0)["swaps"].any()
    assert axis_swap_of(field) is None


@pytest.mark.parametrize("axes", SWAPS)
@pytest.mark.parametrize("rows", [(500,), (300, 700)])
def test_axes_that_changed_in_a_clean_tumble_are_told(axes: str, rows: tuple[int, ...]) -> None:
    offset = np.array([20.0, -12.0, 30.0])
    sensor = simulate.Sensor(np.diag([1.0, 0.9, 1.15]), offset, 0.4)
    field = np.array(simulate.tumble(seed=4, n=1000, sensor=sensor).samples.field)
    behind = np.searchsorted(rows, np.arange(1000), side="right") % 2 == 1
    field[behind] = field[behind] @ SWAPS[axes]
    swap = axis_swap_of(field)
    assert swap is not None
    assert swap.axes == axes
    assert swap.rows == rows


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.05, 0.0), (0.0, 0.1), (-0.04, 0.08)])
def test_an_axis_that_is_not_linear_throughout_is_told(quadratic: float, cubic: float) -> None:
    fit = judged(curved(22, quadratic=quadratic, cubic=cubic, rows=1500))
    assert "nonlinear-axis" in {finding.code for finding in fit.findings}
    assert fit.evidence.diagnosis.nonlinearity is not None
    assert fit.evidence.diagnosis.nonlinearity.axis == "y"


@pytest.mark.parametrize(
    ("seed", "rows", "cubics", "is_named"),
    [
        (22, 1500, (0.12, 0.0), False),
        (3, 1500, (-0.1, 0.1), False),
        (4, 3000, (-0.2, -0.05), False),
        (22, 3000, (0.1, 0.08), True),
    ],
)
def test_an_axis_that_bends_otherwise_in_each_half_is_not_told_as_one_that_always_does(
    seed: int, rows: int, cubics: tuple[float, float], *, is_named: bool
) -> None:
    first, second = (curved(seed, cubic=cubic, rows=rows).field for cubic in cubics)
    fit = judged(np.concatenate([first[: rows // 2], second[rows // 2 :]]))
    assert ("nonlinear-axis" in {finding.code for finding in fit.findings}) == is_named
    assert fit.verdict != "good"
