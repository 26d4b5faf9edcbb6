"""Wrong use of what stands beside a magnetometer is named, and good recordings are left in peace.

More seeds, strengths and motions: ``python -m benchmarks.wrong_use``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.wrong_use import CASES, codes_of
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily, nightly

import flinders
from flinders import simulate
from flinders.cli._calibrate_options import split_recorded_names
from flinders.core.axes import AXIS_ROTATIONS, Axes
from flinders.diagnostics.instruments import (
    compass_yaw_mistake,
    instrument_mistakes,
    one_axis_mistakes,
    wrong_dip_mistake,
)
from flinders.errors import UsageError
from flinders.estimators.aiding import fit_aided
from flinders.estimators.mounting import fit_accelerometer_axes, fit_gyro_axes
from flinders.fitting.aid_selection import fit_with_aids
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from tests.trials import Choose

MOTIONS = ("swayed", "hand", "rocked", "flight")


def named(case: str, motion: str, seed: int, strength: float) -> list[str]:
    """Codes of what is said of gyro and accelerometer, with the ellipsoid that the magnetometer has on a sphere."""
    samples = CASES[case][0](motion, seed, strength).samples
    middle = samples.field.mean(axis=0)
    about = Ellipsoid(middle, 50.0 * np.eye(3))
    return [mistake.code for mistake in instrument_mistakes(samples, about, ("rate", "dip"))[1]]


@pytest.mark.parametrize("motion", [*MOTIONS, "drive"])
def test_a_good_recording_is_left_in_peace(motion: str, trials: Choose) -> None:
    assert all(named("good", motion, seed, 0.0) == [] for seed in trials(4, 1).seeds)


@pytest.mark.parametrize("motion", daily([*MOTIONS, "drive"], 2))
@pytest.mark.parametrize("scale", [180.0 / np.pi, np.pi / 180.0, 1e3, -1.0])
def test_a_rate_in_another_unit_is_named_on_all_motions(motion: str, scale: float, trials: Choose) -> None:
    assert all("gyro-unit" in named("gyro", motion, seed, scale) for seed in trials(4, 1).seeds)


@pytest.mark.parametrize("motion", daily(MOTIONS, 2))
@pytest.mark.parametrize("case", ["axes", "mirrored"])
def test_a_gyro_with_exchanged_or_mirrored_axes_is_named(motion: str, case: str, trials: Choose) -> None:
    assert all({"swapped-axes", "gyro-unit"} & set(named(case, motion, seed, 0)) for seed in trials(4, 1).seeds)


@pytest.mark.parametrize("motion", ["swayed", "hand", "rocked"])
def test_an_accelerometer_with_exchanged_axes_contradicts_the_gyro_and_is_left_out(motion: str) -> None:
    attack = CASES["axes"][0](motion, 1, 1)
    about = Ellipsoid(attack.samples.field.mean(axis=0), 50.0 * np.eye(3))
    axes, [mistake] = instrument_mistakes(attack.samples, about, ("rate", "dip"))
    assert axes is None
    assert (mistake.code, mistake.aid, mistake.drops) == ("swapped-axes", "dip", True)
    assert_sentences(mistake.words)


@pytest.mark.parametrize("turn", AXIS_ROTATIONS[1::5], ids=str)
def test_how_the_magnetometer_sits_is_found_whichever_way_it_is(turn: flinders.Axes) -> None:
    true = simulate.tumble(seed=2, motion="swayed", n=1000)
    rate, acceleration = turn.apply(true.samples.rate), turn.apply(true.samples.acceleration)  # type: ignore[arg-type]
    turned = replace(true.samples, rate=rate, acceleration=acceleration)
    about = Ellipsoid(true.sensor.offset, true.field_strength * np.asarray(true.sensor.matrix))
    assert fit_gyro_axes(turned, about).axes == fit_accelerometer_axes(turned, about).axes == turn


@pytest.mark.parametrize("axis", daily([0, 1, 2]))
@pytest.mark.parametrize("motion", daily(["swayed", "hand"]))
def test_a_mirrored_axis_is_named_with_the_axes_that_mend_it(motion: str, axis: int) -> None:
    """With the sensor at a right angle on the body, give or take five degrees, and the place known."""
    attack = CASES["left-handed"][0](motion, 2, axis)
    code, axes = attack.code.split()
    assert code == "mirrored-axis"
    assert codes_of(attack) == (attack.code,)
    mended = replace(attack, samples=attack.samples.map_axes(Axes.of(axes)))
    assert codes_of(mended) == ()


def test_without_the_place_half_a_turn_and_a_mirrored_axis_are_both_said() -> None:
    true = simulate.tumble(seed=2, motion="swayed", n=1000)
    mirrored = replace(true.samples, field=true.samples.field * [1.0, -1.0, 1.0])
    about = Ellipsoid(true.sensor.offset * [1.0, -1.0, 1.0], true.field_strength * np.eye(3))
    for is_signed, seat in ((False, "half-turned"), (True, "clear")):
        axes, mistakes = instrument_mistakes(mirrored, about, ("rate", "dip"), is_signed=is_signed)
        assert str(axes) == "-x,y,-z"
        assert {one.finding.values["seat"] for one in mistakes} == {seat}


@pytest.mark.parametrize("motion", daily(["swayed", "hand"]))
def test_a_right_handed_sensor_at_right_angles_is_not_called_mirrored(motion: str) -> None:
    assert not any(code.startswith("mirrored") for code in codes_of(CASES["left-handed"][0](motion, 2, 3)))


@pytest.mark.parametrize("motion", daily(["swayed", "hand", "rocked"]))
def test_a_yaw_from_this_compass_is_named_whatever_the_motion(motion: str) -> None:
    attack = CASES["compass"][0](motion, 0, 10.0)
    found = compass_yaw_mistake(attack.samples, fit_aided(attack.samples, ("tilt",)), 60.0)
    assert found is not None
    assert found.code == "circular-attitude"


@pytest.mark.parametrize("motion", daily(["swayed", "hand", "flight"]))
def test_a_mounting_five_degrees_off_is_no_circular_attitude(motion: str) -> None:
    """The attitude is that of the accelerometer's axes; nothing else is asked for that would see how it sits."""
    attack = CASES["good"][0](motion, 3, 0.0)
    assert compass_yaw_mistake(attack.samples, fit_aided(attack.samples, ()), 60.0) is None


@pytest.mark.parametrize("north_km", [-1000.0, nightly(1000.0)])
def test_a_site_a_thousand_kilometres_off_is_named_and_does_not_bend_the_fit(north_km: float) -> None:
    attack = CASES["site"][0]("swayed", 1, north_km)
    assert codes_of(attack) == ("site-differs",)
    wrong = flinders.fit(attack.samples, aiding=("dip",), site=attack.site)
    without = flinders.fit(attack.samples, aiding=("dip",))
    np.testing.assert_array_equal(wrong.calibration.offset, without.calibration.offset)


def test_an_accelerometer_upside_down_is_told_from_another_place() -> None:
    assert "upside down" in wrong_dip_mistake(-59.0, Site(None, 60.0)).words
    assert "check place" in wrong_dip_mistake(50.0, Site(None, 60.0)).words


def test_noise_of_a_slow_gyro_is_no_turning_about_a_second_axis() -> None:
    rng = np.random.default_rng(1)
    slow = np.outer(0.05 * np.sin(np.arange(2000) * 0.01), [0.0, 0.0, 1.0]) + rng.normal(0.0, 0.005, (2000, 3))
    assert [mistake.code for mistake in one_axis_mistakes(slow)] == ["one-axis"]
    assert one_axis_mistakes(slow + np.outer(0.05 * np.cos(np.arange(2000) * 0.01), [1.0, 0.0, 0.0])) == []


@pytest.mark.parametrize("what", ["zero", "of a twentieth of the readings", "of another time"])
def test_a_gyro_that_does_not_go_with_the_field_is_left_out(what: str) -> None:
    true = simulate.tumble(seed=4, motion="swayed", n=1500)
    rate = np.asarray(true.samples.rate)
    wrong = {
        "zero": np.zeros_like(rate),
        "of a twentieth of the readings": np.repeat(rate[::60], 60, axis=0),
        "of another time": rate[::-1].copy(),
    }[what]
    about = Ellipsoid(true.sensor.offset, true.field_strength * np.asarray(true.sensor.matrix))
    _, [mistake] = instrument_mistakes(replace(true.samples, rate=wrong), about, ("rate", "dip"))
    assert (mistake.code, mistake.aid, mistake.drops) == ("gyro-differs", "rate", True)


@pytest.mark.parametrize(("column", "aid"), [("rate", "rate"), ("acceleration", "dip"), ("attitude", "tilt")])
def test_an_empty_column_is_named_and_left_out(column: str, aid: str) -> None:
    true = simulate.tumble(seed=5, motion="swayed", n=300)
    width = 4 if column == "attitude" else 3
    empty = replace(true.samples, **{column: np.full((300, width), np.nan)})  # type: ignore[arg-type]
    fit = flinders.fit(empty, aiding=(aid,))
    assert "aid-empty" in {finding.code for finding in fit.findings}


def test_time_that_goes_back_leaves_the_gyro_out() -> None:
    true = simulate.tumble(seed=6, motion="swayed", n=300)
    back = replace(true.samples, time=np.asarray(true.samples.time)[::-1].copy())
    _, [mistake] = instrument_mistakes(back, Ellipsoid(true.sensor.offset, 50.0 * np.eye(3)), ("rate",))
    assert (mistake.code, mistake.number) == ("aid-empty", 0)


def test_a_current_that_only_has_noise_is_named(trials: Choose) -> None:
    for seed in trials(4, 1).seeds:
        assert codes_of(CASES["current"][0]("swayed", seed, 0.02)) == ("disturbance-constant",)


def test_with_needs_a_name() -> None:
    with assert_raises(UsageError):
        split_recorded_names([""])


def test_an_aid_with_which_a_fit_goes_astray_is_left_out_and_named() -> None:
    """A drive that leans in bends, and a fit that knows too little by itself to see it."""
    attack = CASES["leaning"][0]("drive", 11, 0.0)
    best, aiding = fit_with_aids(attack.samples, attack.aiding)
    assert best.aiding == ()
    assert [(one.code, one.drops) for one in aiding.mistakes] == [("aid-diverged", True)]
