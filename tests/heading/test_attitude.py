"""Headings of known attitudes: exact at all of them, legacy formulas as wrong as is known, mistakes named."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

from flinders.core.axes import Axes
from flinders.errors import ArrayError
from flinders.geometry.angles import wrap_180
from flinders.heading.attitude import (
    FORMULAS,
    an3192,
    an4248,
    dip_deg,
    level_heading_deg,
    magnetic_heading_deg,
    roll_pitch_deg,
)
from flinders.heading.axis_consistency import ALL_AXES, ForeignAxes, Frames

if TYPE_CHECKING:
    from flinders.arrays import Floats

AROUND = np.arange(0.0, 360.0)


def bodies(roll: object, pitch: object, heading: object) -> Floats:
    """(N, 3, 3) from north, east, down to the axes of a body: heading, then pitch, then roll, in degrees."""
    r, p, h = np.deg2rad(np.broadcast_arrays(roll, pitch, heading)).astype(float)  # type: ignore[arg-type]
    zero, one = np.zeros_like(r), np.ones_like(r)
    about_x = [[one, zero, zero], [zero, np.cos(r), np.sin(r)], [zero, -np.sin(r), np.cos(r)]]
    about_y = [[np.cos(p), zero, -np.sin(p)], [zero, one, zero], [np.sin(p), zero, np.cos(p)]]
    about_z = [[np.cos(h), np.sin(h), zero], [-np.sin(h), np.cos(h), zero], [zero, zero, one]]
    x, y, z = (np.moveaxis(np.array(turn), 2, 0) for turn in (about_x, about_y, about_z))
    turned: Floats = x @ y @ z
    return turned


def seen(turns: Floats, dip: float = 60.0) -> tuple[Floats, Floats]:
    """Field and specific force in the axes of bodies."""
    down = np.deg2rad(dip)
    return turns @ (50.0 * np.array([np.cos(down), 0.0, np.sin(down)])), turns @ np.array([0.0, 0.0, -9.81])


def attitudes(count: int, seed: int = 1) -> tuple[Floats, Floats, Floats]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-180, 180, count), rng.uniform(-89, 89, count), rng.uniform(0, 360, count)


@pytest.mark.parametrize("dip", [60.0, -35.0, 0.0, 85.0])
def test_the_heading_is_exact_at_every_attitude(dip: float) -> None:
    roll, pitch, heading = attitudes(2000)
    field, force = seen(bodies(roll, pitch, heading), dip)
    npt.assert_allclose(wrap_180(magnetic_heading_deg(field, force) - heading), 0.0, atol=1e-9)
    npt.assert_allclose(dip_deg(field, force), dip, atol=1e-9)
    found = roll_pitch_deg(force)
    npt.assert_allclose(wrap_180(found[0] - roll), 0.0, atol=1e-9)
    npt.assert_allclose(found[1], pitch, atol=1e-9)


def test_an4248_is_exact_too() -> None:
    roll, pitch, heading = attitudes(2000)
    field, force = seen(bodies(roll, pitch, heading))
    npt.assert_allclose(wrap_180(an4248(field, force) - heading), 0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("roll", "pitch", "error"), [(10, 10, "2.1"), (20, 20, "9.6"), (30, 30, "23.9"), (45, 30, "38.3")]
)
def test_an3192_is_as_wrong_as_it_is_known_to_be(roll: float, pitch: float, error: str) -> None:
    field, force = seen(bodies(roll, pitch, AROUND))
    assert f"{np.abs(wrap_180(an3192(field, force) - AROUND)).max():.1f}" == error


@pytest.mark.parametrize(("roll", "pitch"), [(40, 0), (0, 40), (-70, 0)])
def test_an3192_is_right_with_roll_or_pitch_alone(roll: float, pitch: float) -> None:
    field, force = seen(bodies(roll, pitch, AROUND))
    npt.assert_allclose(wrap_180(an3192(field, force) - AROUND), 0.0, atol=1e-9)


def test_a_degree_of_tilt_costs_a_level_heading_as_much_as_the_tangent_of_the_dip() -> None:
    field, _ = seen(bodies(1.0, 0.0, AROUND))
    assert f"{np.abs(wrap_180(level_heading_deg(field) - AROUND)).max():.2f}" == "1.73"
    field, _ = seen(bodies(0.0, 0.0, AROUND))
    npt.assert_allclose(wrap_180(level_heading_deg(field) - AROUND), 0.0, atol=1e-12)
    npt.assert_allclose(level_heading_deg(field[:, :2]), level_heading_deg(field), atol=1e-12)


def test_z_may_point_up() -> None:
    """x forward, y left, z up, as many boards are printed: the heading of x is the same."""
    roll, pitch, heading = attitudes(200)
    field, force = (vector * [1.0, -1.0, -1.0] for vector in seen(bodies(roll, pitch, heading)))
    npt.assert_allclose(wrap_180(magnetic_heading_deg(field, force) - heading), 0.0, atol=1e-9)


def test_gravity_in_place_of_specific_force_turns_headings_backwards() -> None:
    roll, pitch, heading = attitudes(200)
    field, force = seen(bodies(roll, pitch, heading))
    npt.assert_allclose(wrap_180(magnetic_heading_deg(field, -force) + heading), 0.0, atol=1e-9)


def test_where_there_is_no_heading_there_is_none() -> None:
    nowhere = [
        ([0.0, 0.0, 50.0], [0.0, 0.0, -9.81]),  # at the magnetic pole
        ([25.0, 0.0, 43.0], [9.81, 0.0, 0.0]),  # x straight up
        ([0.0, 0.0, 0.0], [0.0, 0.0, -9.81]),
        ([25.0, 0.0, 43.0], [0.0, 0.0, 0.0]),
        ([25.0, np.nan, 43.0], [0.0, 0.0, -9.81]),
        ([25.0, 0.0, 43.0], [0.0, np.inf, -9.81]),
    ]
    for name, formula in FORMULAS.items():
        field, force = map(np.array, zip(*nowhere, strict=True))
        found = formula(field, force)
        assert np.isnan(found[[0, 2, 3, 4, 5]]).all() or name != "exact", (name, found)
    assert np.isnan(magnetic_heading_deg(*map(np.array, zip(*nowhere, strict=True)))).all()


def test_any_batch_of_vectors_will_do() -> None:
    field, force = seen(bodies(10.0, 20.0, np.arange(24.0)))
    whole = magnetic_heading_deg(field.reshape(2, 3, 4, 3), force.reshape(2, 3, 4, 3))
    assert whole.shape == (2, 3, 4)
    npt.assert_allclose(whole.ravel(), np.arange(24.0), atol=1e-9)
    with assert_raises(ArrayError):
        magnetic_heading_deg([1.0, 2.0, 3.0], [1.0, 2.0])


# axes


def tumbled(dip: float = 60.0, noise: float = 0.01) -> tuple[Floats, Floats]:
    field, force = seen(bodies(*attitudes(800)), dip)
    rng = np.random.default_rng(2)
    return field + 50.0 * noise * rng.standard_normal(field.shape), force + 9.81 * noise * rng.standard_normal(
        force.shape
    )


def undone(axes: Axes, values: Floats) -> Floats:
    """What was recorded, where `axes` bring it right."""
    recorded = np.empty_like(values)
    recorded[:, list(axes.order)] = values * np.array(axes.signs)
    return recorded


@pytest.mark.parametrize("axes", ALL_AXES, ids=str)
def test_each_way_to_mistake_axes_is_named_where_the_hemisphere_is_known(axes: Axes) -> None:
    field, force = tumbled()
    frames = Frames.of(field, undone(axes, force))
    if axes == Axes():
        frames.refuse_foreign(site_dip_deg=60.0)
        return
    with assert_raises(ForeignAxes) as refused:
        frames.refuse_foreign(site_dip_deg=62.0)
    assert refused.value.axes == axes
    assert refused.value.hint["acceleration_axes"] == str(axes)
    assert refused.value.fitting_deg < 3.0


@pytest.mark.parametrize("axes", [axes for axes in ALL_AXES if not axes.is_mirror], ids=str)
def test_each_right_handed_mistake_is_named_anywhere(axes: Axes) -> None:
    field, force = tumbled(dip=-40.0)
    frames = Frames.of(field, undone(axes, force))
    if axes == Axes():
        frames.refuse_foreign()
        return
    with pytest.raises(ForeignAxes) as refused:
        frames.refuse_foreign()
    assert refused.value.axes == axes


def test_axes_that_were_given_are_taken_into_account() -> None:
    field, force = tumbled()
    right, wrong = Axes.of("y,-z,x"), Axes.of("-y,x,z")
    recorded = undone(right, force)
    with pytest.raises(ForeignAxes) as refused:
        Frames.of(field, wrong.apply(recorded)).refuse_foreign(site_dip_deg=60.0, applied=wrong)
    assert refused.value.axes == right


def test_axes_that_were_given_and_not_needed_are_to_be_left_out() -> None:
    field, force = tumbled()
    wrong = Axes.of("-y,x,z")
    with assert_raises(ForeignAxes) as refused:
        Frames.of(field, wrong.apply(force)).refuse_foreign(applied=wrong)
    assert refused.value.hint == {"acceleration_axes": None}


def test_attitudes_that_tell_two_mistakes_apart_from_nothing_say_so() -> None:
    field, force = seen(bodies(0.0, 0.0, AROUND))
    with assert_raises(ForeignAxes, axes="x,-y,-z"):
        Frames.of(field, -force).refuse_foreign(site_dip_deg=60.0)


def test_a_sound_pair_is_left_alone() -> None:
    field, force = tumbled(noise=0.05)
    for frames in (Frames.of(field, force), Frames.of(field[:50], -force[:50]), Frames()):
        frames.refuse_foreign(site_dip_deg=60.0)
    field, force = seen(bodies(0.0, 0.0, AROUND), 5.0)  # so near the equator that the sign tells nothing
    Frames.of(field, force).refuse_foreign(site_dip_deg=-3.0)


def test_halves_of_a_recording_tell_what_the_whole_does() -> None:
    field, force = tumbled()
    whole, parts = Frames.of(field, force), Frames.of(field[:300], force[:300]) + Frames.of(field[300:], force[300:])
    npt.assert_allclose((Frames() + parts).dip_deg, whole.dip_deg, rtol=1e-9)
    assert whole.dip_deg[0] == pytest.approx(60.0, abs=0.5)


def test_shaken_readings_are_left_out() -> None:
    field, force = tumbled()
    shaken = force.copy()
    shaken[::4] += [0.0, 0.0, 30.0]
    assert Frames.of(field, shaken).readings < 650
    assert Frames.of(field, shaken, gravity=9.81).dip_deg[1] < 2.0
