"""Laws of the small values: ellipsoids and quadrics, axes and units, normal equations, cells of equal area."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.sentences import assert_raises

from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import PER_UNIT, SPELLINGS, Unit
from flinders.errors import NotAnEllipsoid, UsageError
from flinders.geometry.ellipsoid import Ellipsoid, parameter_derivatives, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import level_error, level_turn, raw_error
from flinders.likelihood.equations import NormalEquations
from flinders.summary.coverage import CELL_CENTRES, Coverage, cell_indices, corrected_directions

if TYPE_CHECKING:
    from flinders.arrays import Floats

small = arrays(np.float64, (3, 3), elements=st.floats(-0.4, 0.4))
MAPPINGS = [
    Axes((order[0], order[1], order[2]), (signs[0], signs[1], signs[2]))
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
]


@st.composite
def ellipsoids(draw: st.DrawFn) -> Ellipsoid:
    """Any ellipsoid with axes within a factor of seven, up to ten radii off the origin."""
    turn = np.linalg.qr(np.eye(3) + draw(small))[0]
    gains = draw(arrays(np.float64, 3, elements=st.floats(0.4, 2.7)))
    radius = 10.0 ** draw(st.floats(-3, 5))
    centre = draw(arrays(np.float64, 3, elements=st.floats(-10, 10)))
    shape = (turn * gains) @ turn.T
    return Ellipsoid(radius * centre, radius * (shape + shape.T) / 2)


@given(ellipsoids())
def test_an_ellipsoid_is_its_quadric_of_either_sign(ellipsoid: Ellipsoid) -> None:
    coefficients = ellipsoid.as_quadric()
    for factor in (1.0, -1.0, 1e-3, -1e6):
        assert Ellipsoid.from_quadric(factor * coefficients).isclose(ellipsoid, rtol=1e-8)


@given(ellipsoids())
def test_the_quadric_is_zero_on_the_surface_and_one_radius_further_three(ellipsoid: Ellipsoid) -> None:
    directions = simulate.fibonacci(30)
    for stretch, value in ((1.0, 0.0), (2.0, 3.0), (0.0, -1.0)):
        x, y, z = (ellipsoid.centre + stretch * directions @ ellipsoid.shape).T
        monomials = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z, np.ones(30)])
        npt.assert_allclose(ellipsoid.as_quadric() @ monomials, value, atol=1e-8)


@given(ellipsoids(), st.floats(-15, -1))
def test_semi_axes_are_eigenvalues_of_the_shape_however_alike(ellipsoid: Ellipsoid, power: float) -> None:
    alike = np.eye(3) + 10.0**power * ellipsoid.shape / ellipsoid.radius
    for shape in (ellipsoid.shape, alike, np.eye(3)):
        values = np.linalg.eigvalsh(shape)
        npt.assert_allclose(Ellipsoid(np.zeros(3), shape).semi_axes, values, rtol=0.0, atol=1e-14 * values[2])


@given(ellipsoids(), arrays(np.float64, 3, elements=st.floats(-100, 100)), st.floats(0.01, 100))
def test_an_ellipsoid_moves_and_scales_with_its_frame(ellipsoid: Ellipsoid, origin: Floats, scale: float) -> None:
    moved = ellipsoid.in_frame(origin, scale)
    npt.assert_allclose(moved.semi_axes, scale * ellipsoid.semi_axes, rtol=1e-9)
    assert moved.radius == pytest.approx(scale * ellipsoid.radius)
    back = moved.in_frame(-origin / scale, 1.0 / scale)
    npt.assert_allclose(back.centre, ellipsoid.centre, atol=1e-9 * (1 + np.abs(ellipsoid.centre).max() + 1e4))
    assert moved.radius**3 == pytest.approx(float(np.prod(moved.semi_axes)))


@pytest.mark.parametrize(
    "coefficients",
    [
        [1, 1, -1, 0, 0, 0, 0, 0, 0, -1],  # one eigenvalue negative
        [1, -1, -1, 0, 0, 0, 0, 0, 0, -1],  # two: the determinant is positive, and still open
        [1, 1, 0, 0, 0, 0, 0, 0, 0, -1],  # a cylinder
        [1, 1, 1, 0, 0, 0, 0, 0, 0, 1],  # imaginary
        [1, 1, 1, 0, 0, 0, 0, 0, 0, 0],  # a point
        [0, 0, 0, 0, 0, 0, 1, 0, 0, 0],  # a plane
        [1, 1, np.nan, 0, 0, 0, 0, 0, 0, -1],
        [np.inf, 1, 1, 0, 0, 0, 0, 0, 0, -1],
    ],
)
def test_what_is_not_an_ellipsoid_is_refused(coefficients: list[float]) -> None:
    for sign in (1.0, -1.0):
        with pytest.raises(NotAnEllipsoid):
            Ellipsoid.from_quadric(sign * np.array(coefficients, float))


@given(arrays(np.float64, 6, elements=st.floats(-9, 9)))
def test_six_entries_are_a_symmetric_matrix(entries: Floats) -> None:
    matrix = symmetric_matrix(entries)
    assert np.array_equal(matrix, matrix.T)
    assert np.array_equal(upper_entries(matrix), entries)


@given(
    arrays(np.float64, (3, 4), elements=st.floats(-9, 9)),
    arrays(np.float64, (3, 4), elements=st.floats(-9, 9)),
    arrays(np.float64, 9, elements=st.floats(-9, 9)),
)
def test_gathered_coefficients_are_those_of_the_bilinear_form(v: Floats, u: Floats, change: Floats) -> None:
    wanted = v.T @ change[:3] + np.einsum("ik,ij,jk->k", v, symmetric_matrix(change[3:]), u)
    npt.assert_allclose(parameter_derivatives(v, u) @ change, wanted, atol=1e-9)


@given(st.lists(arrays(np.float64, 9, elements=st.floats(-9, 9)), min_size=3, max_size=3))
def test_normal_equations_add_up_like_the_residuals_they_stand_for(rows: list[Floats]) -> None:
    one, two, three = (NormalEquations(np.outer(row, row), row, float(row @ row), 1) for row in rows)
    for left, right in (
        (one + two, two + one),
        ((one + two) + three, one + (two + three)),
        (one + NormalEquations.empty(), one),
        (NormalEquations.empty() + one, one),
    ):
        npt.assert_allclose(left.matrix, right.matrix, atol=1e-9)
        npt.assert_allclose(left.gradient, right.gradient, atol=1e-9)
        assert left.cost == pytest.approx(right.cost)
        assert left.count == right.count


@given(st.floats(1e-6, 1e6))
def test_the_step_and_the_inverse_solve_the_normal_equations_in_any_unit(unit: float) -> None:
    jacobian = np.random.default_rng(1).normal(size=(40, 9)) * np.array([1, 1, 1, 3, 3, 3, 9, 9, 9]) * unit
    residuals = np.random.default_rng(2).normal(size=40)
    equations = NormalEquations(jacobian.T @ jacobian, jacobian.T @ residuals, float(residuals @ residuals), 40)
    wanted = np.linalg.lstsq(jacobian, residuals)[0]
    npt.assert_allclose(equations.step(), wanted, rtol=1e-8)
    npt.assert_allclose(equations.inverse() @ equations.gradient, wanted, rtol=1e-8)


def test_equations_that_leave_parameters_open_give_the_smallest_step() -> None:
    matrix, gradient = np.zeros((9, 9)), np.zeros(9)
    matrix[0, 0], gradient[0] = 4.0, 8.0
    step = NormalEquations(matrix, gradient, 1.0, 1).step()
    npt.assert_allclose(step, [2, 0, 0, 0, 0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("mapping", MAPPINGS, ids=str)
def test_a_mapping_is_the_signed_permutation_that_its_text_says(mapping: Axes) -> None:
    matrix = mapping.apply(np.eye(3)).T
    assert Axes.of(str(mapping)) == mapping
    npt.assert_array_equal(matrix @ matrix.T, np.eye(3))
    assert mapping.is_mirror == (np.linalg.det(matrix) < 0)
    assert mapping.is_identity == bool(np.array_equal(matrix, np.eye(3)))
    vectors = np.random.default_rng(1).normal(size=(2, 5, 3))
    npt.assert_array_equal(mapping.apply(vectors), vectors @ matrix.T)


@pytest.mark.parametrize("spelling", sorted(SPELLINGS))
@pytest.mark.parametrize("dress", [str, str.upper, str.title, " {} ".format])
def test_a_unit_is_known_by_any_spelling(spelling: str, dress: type[str]) -> None:
    assert Unit.of(dress(spelling)).name == SPELLINGS[spelling]


@given(
    st.sampled_from(sorted(PER_UNIT)),
    arrays(np.float64, (4, 3), elements=st.floats(-1e4, 1e4, allow_subnormal=False).map(lambda x: round(x, 6))),
)
def test_a_field_is_the_same_in_whichever_unit_it_was_written(name: str, field: Floats) -> None:
    unit = Unit.of(name)
    assume(not np.isin(field, (0.0, -1.0)).all(axis=1).any())  # the sensor did not answer
    assert (unit.scale, unit.inside) == (PER_UNIT[name], "uT")
    npt.assert_allclose(Samples.of(field / unit.scale, unit=name).field, field, rtol=1e-14)
    scaled = Samples.of(field, unit="counts", scale=0.15)
    npt.assert_allclose(scaled.field, 0.15 * field, rtol=1e-14)
    assert scaled.unit.inside == "uT"


@pytest.mark.nightly
def test_every_cell_has_a_hundredth_of_the_sphere() -> None:
    rng = np.random.default_rng(5)
    counts = np.zeros(100)
    for _ in range(4):
        counts += Coverage.of(simulate.uniform_directions(rng, 250_000)).counts
    # A million directions: 10,000 a cell with a standard deviation of 100.
    assert counts.sum() == 1_000_000
    assert np.abs(counts - 10_000).max() < 450
    assert float(np.sum((counts - 10_000) ** 2) / 10_000) < 99 + 4 * np.sqrt(2 * 99)


def test_the_centre_of_a_cell_falls_into_it() -> None:
    npt.assert_array_equal(cell_indices(CELL_CENTRES), np.arange(100))
    npt.assert_allclose(np.linalg.norm(CELL_CENTRES, axis=1), 1.0)


@given(
    arrays(np.float64, (5, 3), elements=st.floats(-1, 1)).filter(lambda u: bool((np.abs(u).max(axis=1) > 0.1).all()))
)
def test_every_direction_falls_into_one_cell(directions: Floats) -> None:
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    cells = cell_indices(directions)
    assert ((cells >= 0) & (cells < 100)).all()
    coverage = Coverage.of(directions, np.arange(1.0, 6.0))
    assert coverage.readings == 15.0
    assert coverage.fraction == len(set(cells.tolist())) / 100
    angles = np.degrees(np.arccos(np.clip(directions @ coverage.hole, -1, 1)))
    assert coverage.hole_deg == pytest.approx(angles.min(), abs=1e-4)


@given(ellipsoids())
def test_directions_of_readings_on_the_surface_are_those_they_were_made_from(ellipsoid: Ellipsoid) -> None:
    directions = simulate.fibonacci(50)
    readings = ellipsoid.centre + directions @ ellipsoid.shape
    npt.assert_allclose(corrected_directions(readings, ellipsoid), directions, atol=1e-9)


@given(ellipsoids(), st.floats(-85, 85))
def test_heading_errors_do_not_depend_on_the_unit_and_grow_with_the_covariance(
    ellipsoid: Ellipsoid, dip_deg: float
) -> None:
    root = np.random.default_rng(3).normal(size=(9, 9)) * 1e-3 * ellipsoid.radius
    one = level_error(ellipsoid, root @ root.T, dip_deg=dip_deg)
    bigger = Ellipsoid(4.0 * ellipsoid.centre, 4.0 * ellipsoid.shape)
    assert level_error(bigger, 16.0 * root @ root.T, dip_deg=dip_deg).worst == pytest.approx(one.worst)
    assert level_error(ellipsoid, 9.0 * root @ root.T, dip_deg=dip_deg).rms == pytest.approx(3 * one.rms)
    assert 0 < one.rms <= one.worst
    assert raw_error(bigger, dip_deg=dip_deg).rms == pytest.approx(raw_error(ellipsoid, dip_deg=dip_deg).rms)


def test_a_perfect_sensor_has_no_heading_error_and_there_is_none_at_the_poles() -> None:
    sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    assert raw_error(sphere).worst == pytest.approx(0.0, abs=1e-9)
    assert level_error(sphere, np.zeros((9, 9))).worst == 0.0
    for dip_deg in (90.0, -89.5, float("nan")):
        with assert_raises(UsageError):
            level_turn(dip_deg)
