"""Motions and disturbances of simulated recordings do what they say."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

import flinders
from flinders import simulate
from flinders.errors import ArrayError, OutputExists, UnreadableInput, UsageError
from flinders.simulate import (
    MOTIONS,
    FieldStep,
    Imu,
    MotorCurrent,
    PassingMagnet,
    Perturbation,
    Sensor,
    Simulated,
    Step,
    ThermalDrift,
    truth,
    tumble,
)
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

TIMED = [name for name, motion in MOTIONS.items() if motion.seconds is not None]


def tilts_deg(recording: Simulated) -> Floats:
    assert recording.attitudes is not None
    tilts: Floats = np.degrees(np.arccos(np.clip(recording.attitudes[:, 2, 2], -1.0, 1.0)))
    return tilts


def headings_seen(recording: Simulated) -> int:
    """Of twelve sectors, how many."""
    assert recording.attitudes is not None
    headings = np.degrees(np.arctan2(recording.attitudes[:, 1, 0], recording.attitudes[:, 0, 0])) % 360
    return int(np.count_nonzero(np.histogram(headings, bins=12, range=(0, 360))[0]))


# motions


@pytest.mark.parametrize("motion", TIMED)
def test_the_field_turns_against_the_gyro(motion: str) -> None:
    """Each attitude is the one before, turned by the rate for one step: dh/dt = −ω × h."""
    recording = tumble(5, motion=motion, n=400, imu=Imu(gyro_noise=0.0))
    assert recording.attitudes is not None
    assert recording.samples.rate is not None
    steps = simulate.turns(recording.samples.rate[:-1] / 50.0)
    npt.assert_allclose(recording.attitudes[:-1] @ steps, recording.attitudes[1:], atol=1e-9)


@pytest.mark.parametrize("motion", TIMED)
def test_no_motion_is_faster_than_a_body_can_be(motion: str) -> None:
    recording = tumble(6, motion=motion)
    assert recording.samples.rate is not None
    assert np.abs(recording.samples.rate).max() < 9.0
    assert len(recording.samples) == MOTIONS[motion].seconds * 50  # type: ignore[operator]


def test_figures_of_eight_see_nearly_all_directions() -> None:
    assert all(Coverage.of(tumble(seed, motion="eight").directions).fraction > 0.85 for seed in range(5))


@pytest.mark.parametrize(("motion", "limit"), [("drive", 6.0), ("flight", 35.0), ("swayed", 35.0), ("tilted", 35.0)])
def test_vehicles_see_all_headings_and_stay_within_their_tilt(motion: str, limit: float) -> None:
    for seed in range(3):
        recording = tumble(seed, motion=motion)
        assert headings_seen(recording) == 12
        assert 0.6 * limit < tilts_deg(recording).max() < limit
    assert 1.0 < tilts_deg(tumble(1, motion=motion, tilt_deg=2.0)).max() < 2.0


def test_a_swayed_body_leans_to_all_sides_and_feels_nothing_but_gravity() -> None:
    """As widely as `tilted`, whose tilts are even from 0° to 35°: their mean is 17.5°."""
    leans = []
    for seed in range(5):
        recording = tumble(seed, motion="swayed", imu=Imu(acceleration_noise=0.0))
        assert recording.attitudes is not None
        assert recording.samples.acceleration is not None
        npt.assert_allclose(np.linalg.norm(recording.samples.acceleration, axis=1), 9.81, atol=1e-9)
        leans.append(tilts_deg(recording).mean())
        level = recording.attitudes[:, 2, :2]  # which way the body leans
        assert np.histogram(np.arctan2(*level.T), bins=6, range=(-np.pi, np.pi))[0].min() > 100
    assert 14.0 < np.mean(leans) < 21.0


def test_a_rocked_body_stays_within_its_amplitudes_and_rates() -> None:
    for amplitudes in ((5.0, 45.0, 360.0), (5.0, 5.0, 90.0)):
        turning = simulate.rocked(np.random.default_rng(4), rate_hz=10.0, amplitudes_deg=amplitudes)
        assert turning.attitudes.shape == (6000, 3, 3)
        pitch = np.degrees(np.arcsin(-turning.attitudes[:, 2, 0]))
        roll = np.degrees(np.arctan2(turning.attitudes[:, 2, 1], turning.attitudes[:, 2, 2]))
        assert 0.99 * amplitudes[1] < np.abs(pitch).max() <= amplitudes[1] + 1e-9
        assert 0.99 * amplitudes[0] < np.abs(roll).max() <= amplitudes[0] + 1e-9
        assert np.abs(turning.rate).max() < 0.08 + 0.3 + 0.4


def test_a_floor_is_level() -> None:
    assert tilts_deg(tumble(1, motion="drive", tilt_deg=0.0)).max() == 0.0


def test_a_bend_is_felt_sideways_and_gravity_is_there() -> None:
    """On a level floor v·ω to the right, and −g on z."""
    recording = tumble(2, motion="drive", tilt_deg=0.0, imu=Imu(gyro_noise=0.0, acceleration_noise=0.0))
    assert recording.samples.acceleration is not None
    assert recording.samples.rate is not None
    ahead, right, down = recording.samples.acceleration.T
    npt.assert_allclose(ahead, 0.0, atol=1e-9)
    npt.assert_allclose(right[1:], 8.0 * recording.samples.rate[:-1, 2], atol=1e-9)
    npt.assert_allclose(down, -9.81)


def test_a_coordinated_turn_is_not_felt_sideways() -> None:
    recording = tumble(2, motion="flight", imu=Imu(acceleration_noise=0.0))
    assert recording.samples.acceleration is not None
    assert np.abs(recording.samples.acceleration[:, 1]).max() < 0.5
    assert np.abs(recording.samples.acceleration[:, 2]).max() > 10.0


@pytest.mark.parametrize(("plane", "axis"), [("xy", 2), ("yz", 0), ("zx", 1)])
def test_a_sweep_keeps_the_third_axis_down(plane: str, axis: int) -> None:
    recording = tumble(3, motion=f"sweep-{plane}", sensor=Sensor(), dip_deg=50.0)
    npt.assert_allclose(recording.directions[:, axis], np.sin(np.radians(50.0)), atol=1e-12)
    level = np.delete(recording.directions, axis, axis=1)
    sectors = np.histogram(np.arctan2(*level.T), bins=36, range=(-np.pi, np.pi))[0]
    assert sectors.min() > 0


def test_sweeps_go_through_the_planes_one_by_one() -> None:
    recording = tumble(3, motion="sweeps", sensor=Sensor(), dip_deg=50.0)
    held = np.isclose(recording.directions, np.sin(np.radians(50.0)), atol=1e-9)
    first = [int(np.flatnonzero(held[:, axis])[0]) for axis in (2, 0, 1)]
    assert first == sorted(first)
    assert np.mean(held.any(axis=1)) == pytest.approx(0.9, abs=0.01)


def test_an_unknown_plane_is_refused() -> None:
    with assert_raises(UsageError):
        simulate.planar_sweeps(np.random.default_rng(0), planes=["xy", "xx"])


@pytest.mark.parametrize("motion", MOTIONS)
def test_one_reading_is_a_recording(motion: str) -> None:
    everything: list[Perturbation] = [MotorCurrent(1.0), ThermalDrift(1.0), Step(1.0), PassingMagnet(1.0)]
    assert len(tumble(1, motion=motion, n=1, stationary=0.9, outliers=1.0, disturbances=everything).samples) == 1


def test_a_held_body_rests_in_clumps_and_its_gyro_says_so() -> None:
    recording = tumble(4, stationary=0.3, imu=Imu(gyro_noise=0.0))
    still = np.all(np.diff(recording.directions, axis=0) == 0.0, axis=1)
    assert still.sum() == 900
    assert recording.samples.rate is not None
    npt.assert_array_equal(np.all(recording.samples.rate[:-1] == 0.0, axis=1), still)
    assert np.count_nonzero(np.diff(still.astype(int)) == 1) <= 3
    assert len(recording.samples) == 3000


# sensors beside the magnetometer


def test_the_gyro_has_the_bias_and_the_noise_that_were_asked_for() -> None:
    bias = np.array([0.02, -0.01, 0.005])
    quiet = tumble(7, imu=Imu(gyro_noise=0.0, acceleration_noise=0.0))
    noisy = tumble(7, imu=Imu(gyro_bias=bias, gyro_noise=0.03, acceleration_noise=0.2))
    assert quiet.samples.rate is not None
    assert quiet.samples.acceleration is not None
    assert noisy.samples.rate is not None
    assert noisy.samples.acceleration is not None
    off = noisy.samples.rate - quiet.samples.rate
    npt.assert_allclose(off.mean(axis=0), bias, atol=0.003)
    npt.assert_allclose(off.std(axis=0), 0.03, rtol=0.05)
    npt.assert_allclose((noisy.samples.acceleration - quiet.samples.acceleration).std(axis=0), 0.2, rtol=0.05)
    npt.assert_allclose(np.linalg.norm(quiet.samples.acceleration, axis=1), 9.81)


# disturbances


def moved(*disturbances: Any, **options: Any) -> tuple[Simulated, Floats]:
    """A recording, and by how much its readings are off those without the disturbances."""
    disturbed = tumble(8, disturbances=disturbances, **options)
    return disturbed, disturbed.samples.field - tumble(8, **options).samples.field


def test_the_field_of_a_motor_is_in_proportion_to_its_current() -> None:
    recording, off = moved(MotorCurrent([0.2, -0.1, 0.4], amperes=10.0, noise=0.0))
    assert recording.samples.current is not None
    npt.assert_allclose(off, np.outer(recording.samples.current, [0.2, -0.1, 0.4]), atol=1e-9)
    assert recording.samples.current.min() >= 0.0
    assert 5.0 < recording.samples.current.max() <= 10.0


def test_the_offset_drifts_with_the_temperature() -> None:
    recording, off = moved(ThermalDrift([0.0, 0.1, 0.0], kelvin=20.0, seconds=10.0, noise=0.0))
    assert recording.samples.temperature is not None
    npt.assert_allclose(off[:, 1], 0.1 * (recording.samples.temperature - 20.0), atol=1e-9)
    assert recording.samples.temperature[-1] == pytest.approx(40.0, abs=0.1)
    assert recording.samples.temperature[500] - 20.0 == pytest.approx(20.0 * (1 - np.exp(-1)), rel=1e-6)


def test_a_step_comes_once_and_stays() -> None:
    _, off = moved(Step([1.0, 2.0, 3.0], at=0.25))
    npt.assert_allclose(off[:740], 0.0, atol=1e-12)
    npt.assert_allclose(off[760:], np.broadcast_to([1.0, 2.0, 3.0], (2240, 3)), atol=1e-9)


def test_a_step_of_the_field_makes_it_stronger_and_leaves_offset_noise_and_path_alone() -> None:
    sensor = Sensor(offset=np.array([10.0, 20.0, 30.0]))
    plain, stepped = (
        tumble(4, n=200, motion="uniform", sensor=sensor, noise=0.0, disturbances=some)
        for some in ([], [FieldStep(0.5, at=0.4)])
    )
    ratio = np.linalg.norm(stepped.samples.field - sensor.offset, axis=1) / 50.0
    npt.assert_allclose(ratio[:79], 1.0, rtol=1e-12)
    npt.assert_allclose(ratio[81:], 1.5, rtol=1e-12)
    npt.assert_array_equal(plain.samples.field[:79], stepped.samples.field[:79])
    assert stepped.disturbances == ("field-step",)


def test_a_passing_magnet_is_gone_after_a_while_and_its_readings_are_strays() -> None:
    recording, off = moved(PassingMagnet(200.0, at=0.5, seconds=4.0))
    length = np.linalg.norm(off, axis=1)
    assert length.max() == pytest.approx(200.0, rel=1e-3)
    assert np.count_nonzero(recording.outliers) == pytest.approx(200, abs=2)
    npt.assert_allclose(length[~recording.outliers], 0.0, atol=1e-12)


def test_disturbances_add_and_leave_sensor_path_and_noise_alone() -> None:
    both, off = moved(Step(5.0), MotorCurrent(0.3))
    plain = tumble(8)
    assert both.shift is not None
    npt.assert_allclose(off, both.shift, atol=1e-9)
    npt.assert_array_equal(both.directions, plain.directions)
    npt.assert_array_equal(both.sensor.matrix, plain.sensor.matrix)
    assert both.samples.rate is not None
    assert plain.samples.rate is not None
    npt.assert_array_equal(both.samples.rate, plain.samples.rate)


def test_a_disturbance_draws_the_same_whatever_comes_after_it() -> None:
    alone, _ = moved(MotorCurrent(0.3))
    first, _ = moved(MotorCurrent(0.3), ThermalDrift(1.0))
    npt.assert_array_equal(alone.samples.current, first.samples.current)


def test_currents_of_several_motors_add_in_one_meter() -> None:
    one, _ = moved(MotorCurrent(0.3, noise=0.0))
    two, _ = moved(MotorCurrent(0.3, noise=0.0), MotorCurrent(0.1, noise=0.0))
    assert one.samples.current is not None
    assert two.samples.current is not None
    assert np.all(two.samples.current >= one.samples.current)


def test_saturation_comes_after_all_that_moves_the_reading() -> None:
    recording, _ = moved(Step(500.0), sensor=Sensor(saturation=100.0, resolution=0.5))
    assert np.abs(recording.samples.field).max() == 100.0
    assert np.all(recording.samples.field[:, 0] % 0.5 == 0.0)


@pytest.mark.parametrize(
    "options",
    [
        {"stationary": 1.2},
        {"rate_hz": 0.0},
        {"tilt_deg": 10.0},
        {"motion": "drive", "tilt_deg": 100.0},
        {"dip_deg": 91.0},
        {"disturbances": [Step(-1.0)]},
        {"disturbances": [FieldStep(-1.0)]},
        {"disturbances": [Step([1.0, 2.0])]},
        {"disturbances": [Step(1.0, at=2.0)]},
        {"disturbances": [MotorCurrent(1.0, hold=0.0)]},
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any]) -> None:
    with assert_raises((UsageError, ArrayError)):
        tumble(**options)


@pytest.mark.parametrize("imu", [{"gyro_bias": [1.0]}, {"gyro_noise": -1.0}, {"acceleration_noise": float("nan")}])
def test_an_impossible_imu_is_refused(imu: dict[str, Any]) -> None:
    with pytest.raises((UsageError, ArrayError)):
        Imu(**imu)


# files


def test_what_is_written_is_read_again_with_all_its_columns(tmp_path: Path) -> None:
    recording = tumble(9, motion="flight", n=300, disturbances=[MotorCurrent(0.3), ThermalDrift(0.1)])
    simulate.write_csv(recording.samples, tmp_path / "flight.csv")
    again = flinders.read(tmp_path / "flight.csv")
    assert again.unit.name == "uT"
    for name in ("field", "time", "acceleration", "rate", "temperature", "current"):
        npt.assert_allclose(getattr(again, name), getattr(recording.samples, name), atol=5.1e-5, err_msg=name)
    with pytest.raises(OutputExists):
        simulate.write_csv(recording.samples, tmp_path / "flight.csv")


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.csv", "other.csv"):
        simulate.write_csv(tumble(10, motion="drive", n=200, disturbances=[Step(3.0)]).samples, tmp_path / name)
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()


def test_the_truth_is_read_back_to_the_bit_and_its_sensor_records_again(tmp_path: Path) -> None:
    recording = tumble(11, sensor=Sensor.random(np.random.default_rng(1), resolution=0.3, saturation=500.0))
    truth.write(truth.Truth.of(recording), tmp_path / "truth.json")
    sensor = truth.read(tmp_path / "truth.json").as_sensor()
    npt.assert_array_equal(sensor.matrix, recording.sensor.matrix)
    npt.assert_array_equal(sensor.offset, recording.sensor.offset)
    again = tumble(11, sensor=sensor)
    npt.assert_array_equal(again.samples.field, recording.samples.field)
    with pytest.raises(OutputExists):
        truth.write(truth.Truth.of(recording), tmp_path / "truth.json")


def broken(**changes: Any) -> str:
    """The text of a truth with some members replaced, by dotted names."""
    content = truth.Truth.of(tumble(n=2)).as_dict()
    for name, value in changes.items():
        *path, last = name.split("__")
        part = content
        for step in path:
            part = part[step]
        part[last] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        broken(flinders="calibration"),
        broken(schema=2),
        broken(more=1),
        broken(sensor__noise=float("nan")),
        broken(sensor__noise=-1.0),
        broken(sensor__matrix=np.diag([1.0, 1.0, -1.0]).tolist()),
        broken(sensor__offset=[1.0, 2.0]),
        broken(field__strength=0.0),
        broken(field__dip_deg=10.0),
        broken(field__vector=[1e400, 0, 0]),
    ],
)
def test_a_file_that_is_no_truth_is_refused_with_what_is_wrong(text: str) -> None:
    with assert_raises(UnreadableInput):
        truth.loads(text, source="tumble.truth.json")


def test_a_truth_that_is_not_there_or_too_large_is_refused(tmp_path: Path) -> None:
    with assert_raises(UnreadableInput):
        truth.read(tmp_path / "none.json")
    (tmp_path / "large.json").write_bytes(b" " * (truth.MAX_BYTES + 1))
    with assert_raises(UnreadableInput):
        truth.read(tmp_path / "large.json")


def test_numbers_that_are_not_finite_are_not_written() -> None:
    endless = replace(tumble(n=2), rate_hz=float("inf"))
    with assert_raises(UsageError):
        truth.dumps(truth.Truth.of(endless))


# two axes
