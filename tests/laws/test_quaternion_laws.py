"""Laws of attitudes: as quaternions, and as a column of samples that are mapped, cut, joined and written."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.sentences import assert_raises

import flinders.readers
from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.errors import ArrayError, AxesError
from flinders.geometry import quaternions
from flinders.heading.smoothing import Filter, filter_recording
from flinders.readers._resample import MAX_ATTITUDE_GAP_S, AttitudeSeries
from flinders.simulate.attitudes import attitudes_of
from flinders.simulate.recording import write_csv
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

angles = arrays(np.float64, 3, elements=st.floats(-3.1, 3.1))
vectors = arrays(np.float64, 3, elements=st.floats(-100, 100))
MAPPINGS = [Axes(order, signs) for order in permutations(range(3)) for signs in product((1, -1), repeat=3)]  # type: ignore[arg-type]
EARTH = np.array([21.0, 4.0, 43.0])
"""North, east, down, in µT."""


@given(angles, angles, vectors)
def test_a_product_acts_like_its_right_and_then_its_left(first: Floats, then: Floats, vector: Floats) -> None:
    a, b = quaternions.from_angles(then), quaternions.from_angles(first)
    one_by_one = quaternions.rotate_vectors(a, quaternions.rotate_vectors(b, vector))
    npt.assert_allclose(quaternions.rotate_vectors(quaternions.product(a, b), vector), one_by_one, atol=1e-10)
    npt.assert_allclose(np.linalg.norm(one_by_one), np.linalg.norm(vector), atol=1e-10)
    npt.assert_allclose(
        quaternions.rotate_vectors(quaternions.inverse(b), quaternions.rotate_vectors(b, vector)), vector, atol=1e-10
    )


@given(angles, vectors)
def test_angles_and_matrices_turn_as_the_mountings_of_autopilots_do(roll_pitch_yaw: Floats, vector: Floats) -> None:
    turn = euler(*np.rad2deg(roll_pitch_yaw))
    attitude = quaternions.from_angles(roll_pitch_yaw)
    npt.assert_allclose(quaternions.rotate_vectors(attitude, vector), turn @ vector, atol=1e-10)
    found = quaternions.from_matrix(turn)
    npt.assert_allclose(found, attitude if attitude @ found > 0 else -attitude, atol=1e-9)


@given(angles, angles, st.floats(0, 1))
def test_the_way_between_two_attitudes_is_the_shortest_at_a_constant_rate(
    first: Floats, then: Floats, share: float
) -> None:
    """What is left to turn, and what was turned, are the two shares of the angle between."""
    start, end = quaternions.from_angles(first)[np.newaxis], quaternions.from_angles(then)[np.newaxis]
    found = quaternions.interpolate_attitudes(start, end, np.array([share]))
    whole, gone = (2 * np.arccos(np.clip(np.abs(np.sum(start * one)), 0, 1)) for one in (end, found))
    npt.assert_allclose(gone, share * whole, atol=1e-7)
    npt.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-12)


def vehicle(rows: int = 200, seed: int = 1) -> Samples:
    """A vehicle that turns about, in the field of `EARTH`."""
    rng = np.random.default_rng(seed)
    attitude = quaternions.from_angles(np.cumsum(rng.normal(0, 0.2, (rows, 3)), axis=0))
    return Samples.of(
        quaternions.rotate_vectors(quaternions.inverse(attitude), EARTH),
        unit="uT",
        time=0.1 * np.arange(rows),
        throttle=rng.uniform(0, 1, rows),
        attitude=attitude,
    )


def in_ned(samples: Samples) -> Floats:
    assert samples.attitude is not None
    return quaternions.rotate_vectors(samples.attitude, samples.field)


def test_the_simulator_and_an_attitude_mean_the_same_turn() -> None:
    """The simulator's attitudes are matrices of its own, made in another way."""
    simulated = simulate.tumble(seed=4, motion="hand", sensor=simulate.Sensor(), noise=0.0)
    assert simulated.attitudes is not None
    attitude = quaternions.from_matrix(simulated.attitudes)
    dip = np.deg2rad(simulated.dip_deg)
    earth = simulated.field_strength * np.array([np.cos(dip), 0.0, np.sin(dip)])
    npt.assert_allclose(quaternions.rotate_vectors(attitude, simulated.samples.field), np.tile(earth, (len(attitude), 1)),
                        atol=1e-9)  # fmt: skip
    heading, pitch, roll = 0.7, -0.3, 1.1
    npt.assert_allclose(
        quaternions.from_matrix(attitudes_of(heading, pitch, roll)[0]),
        quaternions.from_angles([roll, pitch, heading]),
        atol=1e-12,
    )


@pytest.mark.parametrize("axes", MAPPINGS, ids=str)
def test_mapped_axes_keep_the_field_of_the_site_and_a_mirror_image_maps_the_field_alone(axes: Axes) -> None:
    recorded = vehicle()
    for mapped in (
        recorded.map_axes(axes),
        Samples.of(recorded.field, unit="uT", axes=axes, attitude=recorded.attitude),
    ):
        if axes.is_mirror:
            assert mapped.attitude is not None
            assert recorded.attitude is not None
            npt.assert_allclose(mapped.attitude, recorded.attitude, atol=1e-12)
            npt.assert_allclose(mapped.field, axes.apply(recorded.field))
        else:
            npt.assert_allclose(in_ned(mapped), np.tile(EARTH, (200, 1)), atol=1e-9)
    if not axes.is_identity:
        with pytest.raises(AxesError, match="already"):
            recorded.map_axes(axes).map_axes(Axes())


def test_rows_blocks_joins_and_filters_keep_attitude_and_throttle_with_their_readings() -> None:
    recorded = vehicle()
    npt.assert_allclose(in_ned(recorded[50:60]), np.tile(EARTH, (10, 1)), atol=1e-9)
    for recording in (
        recorded,
        Joined((recorded[:90], recorded[90:])),
        filter_recording(recorded, Filter("median", 3)),
    ):
        blocks = list(recording.blocks()) if recording is not recorded else list(recorded.blocks(64))
        for column in ("attitude", "throttle"):
            whole = np.concatenate([getattr(block, column) for block in blocks])
            npt.assert_array_equal(whole, getattr(recorded, column))
    gap = recorded.field.copy()
    gap[3] = np.nan
    left = Samples.of(gap, unit="uT", attitude=recorded.attitude, throttle=recorded.throttle)
    assert left.throttle is not None
    assert recorded.throttle is not None
    npt.assert_array_equal(left.throttle, np.delete(recorded.throttle, 3))
    npt.assert_allclose(in_ned(left), np.tile(EARTH, (199, 1)), atol=1e-9)


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_what_is_written_as_a_table_comes_back(suffix: str, tmp_path: Path) -> None:
    """To four decimals in text: 0.0001 of a quaternion are 0.01°; a gap stays a gap."""
    recorded = vehicle()
    assert recorded.attitude is not None
    assert recorded.throttle is not None
    recorded.attitude[5], recorded.throttle[7] = np.nan, np.nan
    path = tmp_path / f"flight.{suffix}"
    columns = {f"mag_{axis}_uT": recorded.field[:, place] for place, axis in enumerate("xyz")}
    columns |= {f"attitude_{axis}": recorded.attitude[:, place] for place, axis in enumerate("wxyz")}
    columns["throttle_share"] = recorded.throttle
    if suffix == "csv":
        write_csv(recorded, path)
    elif suffix == "npz":
        np.savez(path, allow_pickle=False, **columns)
    else:
        pyarrow = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        parquet.write_table(pyarrow.table(columns), path)
    found = flinders.readers.read(path)
    for column in ("attitude", "throttle"):
        npt.assert_allclose(getattr(found, column), getattr(recorded, column), atol=1e-4)
    whole = np.arange(200) != 5
    npt.assert_allclose(in_ned(found)[whole], np.tile(EARTH, (199, 1)), atol=0.02)
    turned = flinders.readers.read(path, axes="x,-y,-z")
    npt.assert_allclose(in_ned(turned)[whole], in_ned(found)[whole], atol=1e-9)


def test_a_throttle_or_an_attitude_of_unknown_meaning_is_not_read(tmp_path: Path) -> None:
    """Per cent, per mille and microseconds go by that name too, and attitudes of sensors by theirs."""
    path = tmp_path / "flight.csv"
    path.write_text("mag_x_uT,mag_y_uT,mag_z_uT,throttle,qw,qx,qy,qz\n20,0,40,55,1,0,0,0\n21,0,40,56,1,0,0,0\n")
    found = flinders.readers.read(path)
    assert found.throttle is None
    assert found.attitude is None


def test_what_is_no_throttle_and_no_attitude_is_refused_with_its_place() -> None:
    field = [[20.0, 0.0, 40.0]] * 2
    with assert_raises(ArrayError):
        Samples.of(field, throttle=[0.5, 55.0])
    with assert_raises(ArrayError):
        Samples.of(field, attitude=np.zeros((2, 3)))
    with assert_raises(ArrayError):
        Samples.of(field, attitude=[[1.0, 0, 0, 0]])
    with assert_raises(ArrayError):
        Samples.of(field, attitude=[[1.0, 0, 0, 0], [2.0, 0, 0, 0]])


def test_nothing_is_interpolated_over_a_gap_or_a_jump_or_beyond_the_ends() -> None:
    yaw = np.deg2rad([0.0, 10.0, 20.0, 80.0, 90.0])
    attitude = quaternions.from_angles(np.column_stack([0 * yaw, 0 * yaw, yaw]))
    turning = AttitudeSeries.of([0.0, 0.1, 0.2 + MAX_ATTITUDE_GAP_S, 0.9, 1.0], attitude)
    assert turning is not None
    found = turning.at(np.array([-0.01, 0.0, 0.05, 0.1, 0.3, 0.7, 0.8, 0.95, 1.0, 1.01]))
    heading = np.rad2deg(2 * np.arctan2(found[:, 3], found[:, 0]))
    npt.assert_allclose(heading, [np.nan, 0, 5, 10, np.nan, 20, np.nan, 85, 90, np.nan], atol=1e-9)
    alone = AttitudeSeries.of([0.0, 1.0], [[1.0, 0, 0, 0], [0.0, 0, 0, 0]])
    assert alone is not None
    npt.assert_array_equal(alone.at(np.array([0.0, 0.1])), [[1, 0, 0, 0], [np.nan] * 4])
    assert AttitudeSeries.of([0.0], [[0.0, 0, 0, 0]]) is None
