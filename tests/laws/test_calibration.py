"""Laws of `Calibration`, for any invertible matrix, offset and readings."""

from __future__ import annotations

import copy
import pickle
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from tests.sentences import assert_raises

from flinders.core import calibration_file
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import UnitError

if TYPE_CHECKING:
    from flinders.arrays import Floats

MICROTESLA = Unit.of("uT")

moderate = st.floats(-1000, 1000, allow_subnormal=False)
triples = arrays(np.float64, 3, elements=moderate)
readings = arrays(
    np.float64, array_shapes(min_dims=0, max_dims=3, max_side=4).map(lambda s: (*s, 3)), elements=moderate
)
strengths = st.floats(1.0, 500.0)
mappings = st.sampled_from(["x,y,z", "x,-y,-z", "-y,x,z", "z,x,y"]).map(Axes.of)


@st.composite
def matrices(draw: st.DrawFn) -> Floats:
    """Any matrix that is well away from singular: a turn, gains of 0.4 to 2.5, a turn or mirror."""
    turns = [np.linalg.qr(np.eye(3) + draw(arrays(np.float64, (3, 3), elements=st.floats(-0.3, 0.3))))[0] for _ in "ab"]
    gains = draw(arrays(np.float64, 3, elements=st.floats(0.4, 2.5)))
    return np.asarray((turns[0] * gains) @ turns[1], np.float64)


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Any calibration in µT."""
    return Calibration(
        draw(matrices()),
        draw(triples),
        draw(strengths),
        draw(st.booleans()),
        "estimated",
        raw=draw(st.sampled_from(["uT", "mG", "G", "nT"]).map(Unit.of)),
        axes=draw(mappings),
        sensor=draw(st.none() | st.text(max_size=8).filter(lambda text: text.isprintable())),
    )


def close(found: Floats, wanted: Floats) -> None:
    npt.assert_allclose(found, wanted, rtol=1e-9, atol=1e-7)


@given(calibrations(), readings)
def test_apply_keeps_the_shape_and_works_on_each_reading_alone(calibration: Calibration, raw: Floats) -> None:
    corrected = calibration.apply(raw)
    assert corrected.shape == raw.shape
    for index in np.ndindex(raw.shape[:-1]):
        close(corrected[index], calibration.matrix @ (raw[index] - calibration.offset))


@given(calibrations(), readings)
def test_the_inverse_undoes_it_on_both_sides(calibration: Calibration, raw: Floats) -> None:
    close(calibration.inv.apply(calibration.apply(raw)), raw)
    close(calibration.apply(calibration.inv.apply(raw)), raw)
    close(calibration.unapply(calibration.apply(raw)), raw)
    close(calibration.unapply(raw), calibration.inv.apply(raw))


@given(calibrations())
def test_the_inverse_of_the_inverse_has_the_same_numbers(calibration: Calibration) -> None:
    twice = calibration.inv.inv
    close(twice.matrix, calibration.matrix)
    close(twice.offset, calibration.offset)
    assert twice.field_strength == pytest.approx(calibration.field_strength)
    assert twice.rotation == "composed"


@given(calibrations(), calibrations(), readings)
def test_a_product_applies_one_after_the_other(b: Calibration, a: Calibration, raw: Floats) -> None:
    close((b @ a).apply(raw), b.apply(a.apply(raw)))
    if not (a.is_identity or b.is_identity):
        assert (b @ a).rotation == "composed"
    assert ((b @ a).raw, (b @ a).axes) == (a.raw, a.axes)
    assert (b @ a).field_strength == b.field_strength


@given(calibrations(), calibrations(), calibrations())
def test_products_associate(c: Calibration, b: Calibration, a: Calibration) -> None:
    assert ((c @ b) @ a).isclose(c @ (b @ a))


@given(calibrations())
def test_the_identity_leaves_a_product_as_it_is(a: Calibration) -> None:
    before = Calibration.identity(raw=a.raw, axes=a.axes)
    after = Calibration.identity(raw=MICROTESLA)
    assert (after @ a).isclose(a, tolerance=0)
    assert (a @ before).isclose(a, tolerance=0)
    if not a.is_identity:
        assert (after @ a).rotation == (a @ before).rotation == a.rotation
    assert (a @ before).sensor == (after @ a).sensor == a.sensor


@given(calibrations(), calibrations())
def test_the_inverse_of_a_product_is_the_product_of_inverses_the_other_way_round(
    b: Calibration, a: Calibration
) -> None:
    found, wanted = (b @ a).inv, a.inv @ b.inv
    close(found.matrix, wanted.matrix)
    npt.assert_allclose(found.offset, wanted.offset, rtol=1e-9, atol=1e-6)


@given(
    triples,
    arrays(np.float64, (3, 3), elements=st.floats(-1, 1)),
    st.none() | strengths,
    arrays(np.float64, (5, 3), elements=st.floats(-1, 1)).filter(
        lambda u: bool((np.linalg.norm(u, axis=1) > 0.1).all())
    ),
)
def test_an_ellipsoid_becomes_a_sphere_of_the_stated_or_the_resulting_radius(
    centre: Floats, root: Floats, strength: float | None, directions: Floats
) -> None:
    shape = 40 * (np.eye(3) + root @ root.T)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    found = Calibration.from_ellipsoid(centre, shape, field_strength=strength, raw=MICROTESLA)
    close(found.apply(centre + directions @ shape), found.field_strength * directions)
    close(found.shape, shape)
    assert found.field_strength_known == (strength is not None)
    assert found.rotation == "symmetric"
    assert np.array_equal(found.matrix, found.matrix.T)
    if strength is None:
        assert np.linalg.det(found.matrix) == pytest.approx(1.0)
    else:
        assert found.field_strength == strength


@given(calibrations())
def test_saving_and_loading_gives_the_same_numbers_to_the_bit(calibration: Calibration) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        calibration.save(path)
        loaded = Calibration.load(path)
    assert loaded.matrix.tobytes() == calibration.matrix.tobytes()
    assert loaded.offset.tobytes() == calibration.offset.tobytes()
    assert loaded.as_dict() == calibration.as_dict()
    assert (loaded.raw, loaded.axes, loaded.sensor, loaded.frame) == (
        calibration.raw,
        calibration.axes,
        calibration.sensor,
        calibration.frame,
    )


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3))
def test_any_finite_number_survives_the_text_of_a_file(numbers: list[float]) -> None:
    kept = Calibration(np.eye(3), np.array(numbers), 1.0).to_document()
    assert repr(calibration_file.loads(calibration_file.dumps(kept)).calibration.offset) == repr(tuple(numbers))


@pytest.mark.filterwarnings("error")
def test_readings_that_are_not_finite_come_out_as_nan_and_leave_the_others_alone() -> None:
    calibration = Calibration.from_ellipsoid([1, 2, 3], np.diag([30.0, 20.0, 50.0]), raw=MICROTESLA)
    raw = np.array([[1.0, 2.0, 3.0], [np.nan, 2.0, 3.0], [np.inf, -np.inf, 3.0]])
    corrected = calibration.apply(raw)
    assert np.array_equal(corrected[0], [0, 0, 0])
    assert np.isnan(corrected[1:]).any(axis=1).all()
    assert np.isnan(calibration.unapply(raw)[1:]).any(axis=1).all()


def test_its_arrays_are_copies_that_cannot_be_changed() -> None:
    offset = np.array([1.0, 2.0, 3.0])
    calibration = Calibration(np.eye(3), offset, 50.0)
    offset[0] = 100
    assert calibration.offset[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        calibration.offset[0] = 5
    with pytest.raises(ValueError, match="read-only"):
        calibration.matrix[0, 0] = 5


def test_it_survives_copying_and_pickling() -> None:
    calibration = Calibration.from_ellipsoid([1, 2, 3], np.diag([30.0, 20.0, 50.0]), raw=MICROTESLA, sensor="hull 7")
    for other in (copy.deepcopy(calibration), pickle.loads(pickle.dumps(calibration))):
        assert other.isclose(calibration, tolerance=0)
        assert other.sensor == "hull 7"


def test_microtesla_cannot_follow_counts() -> None:
    counts, tesla = Calibration.identity(), Calibration.identity(raw=MICROTESLA)
    with assert_raises(UnitError):
        _ = tesla @ counts


def test_only_calibrations_can_be_composed() -> None:
    with assert_raises(TypeError):
        _ = Calibration.identity() @ "a word"  # type: ignore[operator]


def test_calibrations_in_other_units_or_axes_are_not_close() -> None:
    one = Calibration.identity()
    assert one.isclose(Calibration.identity())
    assert not one.isclose(Calibration.identity(raw=MICROTESLA))
    assert not one.isclose(Calibration.identity(axes=Axes.of("x,-y,-z")))
    assert not one.isclose(Calibration.identity(field_strength=1.1))
    assert not one.isclose(Calibration(np.diag([1, 1, 1.1]), np.zeros(3), 1.0))
