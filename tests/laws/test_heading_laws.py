"""Laws of angles, headings and deviations, for any input."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flinders.geometry.angles import heading_text, wrap_180, wrap_360
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.attitude import dip_deg, magnetic_heading_deg
from flinders.heading.axis_consistency import ALL_AXES, Frames
from flinders.heading.error_propagation import attitude_limit_deg, tilted_error

angles = st.floats(-1e6, 1e6)
headings = st.floats(0.0, 359.999)
vectors = arrays(np.float64, 3, elements=st.floats(-100.0, 100.0))


@given(angles)
def test_an_angle_that_is_wrapped_lies_in_the_circle_and_is_the_same(angle: float) -> None:
    around, across = float(wrap_360(angle)), float(wrap_180(angle))
    assert 0.0 <= around < 360.0
    assert -180.0 < across <= 180.0
    for found in (around, across):
        assert abs((angle - found) / 360.0 - round((angle - found) / 360.0)) < 1e-8
    assert 0.0 <= float(heading_text(angle)[:-1]) < 360.0


@given(vectors, vectors, st.floats(0.1, 1e3), st.floats(0.1, 1e3))
def test_a_heading_does_not_depend_on_lengths(field: np.ndarray, force: np.ndarray, one: float, other: float) -> None:
    first, second = magnetic_heading_deg(field, force), magnetic_heading_deg(one * field, other * force)
    assume(np.isfinite(first) and np.isfinite(second) and min(np.linalg.norm(field), np.linalg.norm(force)) > 1e-3)
    assume(np.linalg.norm(np.cross(field, force)) > 1e-3 * np.linalg.norm(field) * np.linalg.norm(force))
    assume(np.linalg.norm(force[1:]) > 1e-3 * np.linalg.norm(force))
    npt.assert_allclose(wrap_180(first - second), 0.0, atol=1e-6)


@given(headings, headings, st.floats(-80.0, 80.0), st.floats(-80.0, 80.0), st.floats(-180.0, 180.0))
def test_a_turn_about_the_vertical_turns_the_heading_by_as_much(
    start: float, turn: float, dip: float, pitch: float, roll: float
) -> None:
    def read(heading: float) -> tuple[np.ndarray, np.ndarray]:
        (ch, cp, cr), (sh, sp, sr) = (part(np.deg2rad([heading, pitch, roll])) for part in (np.cos, np.sin))
        body = (
            np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
            @ np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
            @ np.array([[ch, sh, 0], [-sh, ch, 0], [0, 0, 1]])
        )
        field = body @ [np.cos(np.deg2rad(dip)), 0.0, np.sin(np.deg2rad(dip))]
        return field, body @ np.array([0.0, 0.0, -9.8])

    before, after = (magnetic_heading_deg(*read(heading)) for heading in (start, start + turn))
    npt.assert_allclose(wrap_180(after - before - turn), 0.0, atol=1e-6)
    npt.assert_allclose(dip_deg(*read(start)), dip, atol=1e-6)


@given(arrays(np.float64, (6, 3), elements=st.floats(-10, 10)), arrays(np.float64, (6, 3), elements=st.floats(-10, 10)))
def test_the_scatter_of_the_dip_is_that_of_the_readings(field: np.ndarray, force: np.ndarray) -> None:
    assume(np.linalg.norm(field, axis=1).min() > 1e-3 and np.linalg.norm(force, axis=1).min() > 1e-3)
    force = force / np.linalg.norm(force, axis=1, keepdims=True)
    frames = Frames.of(field, force)
    for axes in ALL_AXES[::7]:
        sines = np.sin(np.deg2rad(dip_deg(field, axes.apply(force))))
        npt.assert_allclose(frames.dip(axes), (sines.mean(), sines.std()), atol=1e-7)


@given(st.integers(0, 100_000), st.floats(-80.0, 80.0), st.booleans())
def test_a_limit_that_some_tilt_exceeds_is_not_kept_at_all_tilts(seed: int, dip: float, is_turned: bool) -> None:
    rng = np.random.default_rng(seed)
    bent = 0.1 * rng.standard_normal((3, 3))
    ellipsoid = Ellipsoid(rng.normal(size=3), 50.0 * (np.eye(3) + bent + bent.T))
    root = rng.standard_normal((9, 9)) * np.sqrt(10.0 ** rng.uniform(-6.0, 0.0, 9))
    covariance, down = root @ root.T, rng.standard_normal(3) if is_turned else None
    worst = max(
        tilted_error(ellipsoid, covariance, dip_deg=dip, tilt_deg=tilt, down=down).worst
        for tilt in (0.0, 20.0, 45.0, 90.0, 120.0, 180.0)
    )
    assert attitude_limit_deg(ellipsoid, covariance, dip_deg=dip, limit_deg=worst, down=down) >= 0.0
    within = attitude_limit_deg(ellipsoid, covariance, dip_deg=dip, limit_deg=0.999 * worst, down=down)
    assert within < 180.0
    level_or_more = tilted_error(ellipsoid, covariance, dip_deg=dip, tilt_deg=within, down=down).worst
    assert within == 0.0 or level_or_more <= worst
