"""`flinders.fit_each`, `flinders.fit_bench` and `flinders.from_extremes` of simulated sensors whose truth is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import PER_AMPERE, body, table_text

import flinders
from flinders import simulate
from flinders.errors import AxesError, FlindersError, InputError, NotTurned, UsageError
from flinders.fitting.result import Fit, Refused

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

# each magnetometer of a log


def test_each_magnetometer_of_a_table_is_calibrated_as_it_is_alone(tmp_path: Path) -> None:
    recordings, sensors, _ = body()
    columns = [recordings[name].field for name in "ab"]
    header = ",".join(f"mag{number}_{axis}_uT" for number in (1, 2) for axis in "xyz")
    table = tmp_path / "boat.csv"
    table.write_text(table_text(header, np.column_stack(columns)), encoding="utf-8")
    outcomes = flinders.fit_each(table)
    assert len(outcomes) == 2
    for (name, outcome), sensor in zip(outcomes.items(), sensors, strict=True):
        assert isinstance(outcome, Fit)
        assert outcome.calibration.sensor == name
        npt.assert_allclose(outcome.calibration.offset, sensor.offset, atol=5.0 * outcome.claim.offset_sigma.max())


def test_a_log_is_fitted_by_the_field_at_its_place_in_one_call_and_in_each(recordings: Callable[[str], Path]) -> None:
    log = recordings("dronekit_log171_3mags/log171.bin")
    fit, of_each = flinders.fit(log), flinders.fit_each(log)["MAG"]
    assert isinstance(of_each, Fit)
    assert fit.calibration == of_each.calibration
    assert fit.heading_error_deg == of_each.heading_error_deg
    assert fit.claim.known_dip_deg == pytest.approx(-66.0, abs=0.1)
    assert not fit.claim.dip_assumed
    with pytest.raises(Refused):  # a recording has no default site
        flinders.fit(flinders.open_recording(log))


def test_one_that_cannot_be_fitted_does_not_keep_the_others(tmp_path: Path) -> None:
    recordings, _, _ = body()
    still = flinders.Samples.of(np.tile([20.0, 0.0, 40.0], (300, 1)), unit="uT")
    outcomes = flinders.fit_each({"top": recordings["a"], "still": still, "short": recordings["b"][:4]}, by="median:3")
    assert isinstance(outcomes["top"], Fit)
    assert "filtered" in [finding.code for finding in outcomes["top"].findings]
    codes = [error.code for error in outcomes.values() if isinstance(error, FlindersError)]
    assert codes == ["stuck-axis", "too-few-samples"]
    with pytest.raises(UsageError, match="columns"):
        flinders.fit_each(recordings, columns="1,2,3")
    with pytest.raises(InputError):
        flinders.fit_each(tmp_path / "missing.csv")


# a motor on a bench


def bench(seed: int = 1, noise: float = 0.2) -> flinders.Samples:
    rng = np.random.default_rng(seed)
    current: Floats = 10.0 - 10.0 * np.cos(np.linspace(0.0, 20.0, 400))
    field = np.array([20.0, -5.0, 43.0]) + np.outer(current, PER_AMPERE) + rng.normal(scale=noise, size=(400, 3))
    return flinders.Samples.of(field, unit="uT", current=current, time=0.05 * np.arange(400))


def test_a_motor_on_a_bench_goes_onto_the_calibration_with_the_heading_error_that_it_leaves() -> None:
    """The error of what is found, at the far end of its range, is within 3 σ of what is left of it."""
    calm = flinders.fit(simulate.tumble(seed=3).samples)
    for seed in range(5):
        found = flinders.fit_bench(bench(seed), calm, ["current"])
        (motor,) = found.calibration.disturbances
        assert found.findings == ()
        assert found.calibration.at().isclose(calm.calibration, tolerance=0.0)
        wrong = calm.calibration.matrix @ (motor.per_unit - PER_AMPERE) * (motor.extreme_value - motor.reference)
        off_deg = np.rad2deg(np.linalg.norm(wrong) / calm.calibration.field_strength / np.cos(np.deg2rad(60.0)))
        assert off_deg < 3.0 * found.residual_deg["current"] < 0.5


def test_a_bench_needs_a_sensor_at_rest_in_the_axes_of_the_calibration() -> None:
    tumble = simulate.tumble(seed=3, disturbances=[simulate.MotorCurrent(per_ampere=PER_AMPERE)])
    calm = flinders.fit(simulate.tumble(seed=3).samples)
    with pytest.raises(NotTurned):
        flinders.fit_bench(tumble.samples, calm, ["current"])
    with pytest.raises(AxesError):
        flinders.fit_bench(bench().map_axes(flinders.Axes.of("y,-x,z")), calm, ["current"])
    with pytest.raises(InputError):
        flinders.fit_bench(bench(), calm, ["throttle"])


# six typed numbers


def test_typed_extremes_of_a_tumble_give_the_offset() -> None:
    tumble = simulate.tumble(seed=1, motion="uniform", sensor=simulate.Sensor(offset=np.array([20.0, -10.0, 5.0])))
    field = tumble.samples.field * 10.0  # mG
    ends = np.column_stack([field.min(axis=0), field.max(axis=0)]).ravel()
    found = flinders.from_extremes(ends, unit="mG", axes="x,-y,-z")
    npt.assert_allclose(found.calibration.offset, [20.0, 10.0, -5.0], atol=0.6)
    assert found.verdict == "limited"
