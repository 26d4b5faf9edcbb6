"""Public sets with a truth: each reader on small files in the format of its set, and what the comparison finds.

The formats are those of the sources that `benchmarks.public` cites; the readings here are simulated.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final

import h5py
import numpy as np
import pytest
from benchmarks import public
from scipy.io import savemat
from tests.sentences import assert_raises, assert_sentences

from flinders import Fit, simulate
from flinders.core.calibration import Calibration
from flinders.fitting.result import bare_fit
from flinders.geometry.plane import heading_errors
from flinders.geometry.quaternions import from_angles, from_matrix, inverse, product
from flinders.heading.error_propagation import level_turn

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

MOUNTING: Final = from_angles([0.3, -1.1, 2.0])
ROOM: Final = from_angles([-1.4, 0.2, 0.7])
RECORDING: Final = simulate.tumble(seed=4, n=900, rate_hz=100.0, noise=0.2)


def truth_of(recording: simulate.Simulated) -> Floats:
    """(N, 4) attitudes of a body that carries the sensor and markers, in a room turned against the vertical."""
    assert recording.attitudes is not None
    return product(ROOM, product(from_matrix(recording.attitudes), MOUNTING))


TRUTH: Final = truth_of(RECORDING)


def columns() -> tuple[Floats, Floats, Floats, Floats]:
    """Time, field in µT, specific force in m/s² and rate of the recording."""
    samples = RECORDING.samples
    assert samples.time is not None
    assert samples.acceleration is not None
    assert samples.rate is not None
    return samples.time, samples.field, samples.acceleration, samples.rate


# files in the formats of the sets


def broad_hdf5(folder: Path) -> None:
    _, field, acceleration, rate = columns()
    lost = TRUTH.copy()
    lost[100:120] = np.nan
    with h5py.File(folder / "01_undisturbed_slow_rotation_A.hdf5", "w") as file:
        file.attrs["sampling_rate"] = 100.0
        for name, column in {"imu_acc": acceleration, "imu_gyr": rate, "imu_mag": field, "opt_quat": lost}.items():
            file[name] = column
        file["opt_pos"], file["movement"] = np.zeros((len(field), 3)), np.ones(len(field), bool)


def broad_matlab(folder: Path) -> None:
    _, field, acceleration, rate = columns()
    names = {"imu_acc": acceleration, "imu_gyr": rate, "imu_mag": field, "opt_quat": TRUTH, "sampling_rate": 100.0}
    savemat(folder / "01_undisturbed_slow_rotation_A.mat", names)
    savemat(folder / "results_mahony.mat", {"param_names": ["Kp", "Ki"]})


def sassari(folder: Path) -> None:
    rows = np.column_stack([columns()[0], columns()[2], columns()[3], columns()[1], TRUTH])
    savemat(folder / "slow_v5.mat", {**dict.fromkeys(("XS1", "XS2", "AP1", "AP2", "SH1", "SH2"), rows), "Qs": TRUTH})


def repoimu(folder: Path) -> None:
    time, field, acceleration, rate = columns()
    rows = np.column_stack([time, TRUTH, acceleration, rate, field / 50.0])
    names = (
        "Time (s);Vicon Orientation;;;;IMU Acceleration;;;IMU Gyroscope;;;IMU Magnetometer;;\n;W;X;Y;Z" + ";X;Y;Z" * 3
    )
    (folder / "TStick").mkdir()
    np.savetxt(folder / "TStick" / "TStick_Test02_Trial1.csv", rows, "%.7g", ";", header=names, comments="")


def fiumargdb(folder: Path) -> None:
    time, field, acceleration, rate = columns()
    quaternion, still = TRUTH[:, [1, 2, 3, 0]], np.ones(len(time))
    seen = np.arange(len(time)) % 50 > 0
    rows = np.column_stack([
        1e3 * time, np.zeros((len(time), 3)), quaternion, quaternion, rate, acceleration / public.GRAVITY,
        field / 100.0, still, seen,
    ])  # fmt: skip
    np.savetxt(folder / "rec01.csv", rows, "%.9g", ",", header="names\nunits", comments="")


def oxiod(folder: Path) -> None:
    time, field, acceleration, rate = columns()
    gravity, user = -acceleration / public.GRAVITY, np.zeros_like(acceleration)
    below = folder / "handheld" / "data1" / "syn"
    below.mkdir(parents=True)
    rows = np.column_stack([time, np.zeros((len(time), 3)), rate, gravity, user, field])
    np.savetxt(below / "imu1.csv", rows, "%.9g", ",")
    back = inverse(TRUTH)[:, [1, 2, 3, 0]]
    np.savetxt(below / "vi1.csv", np.column_stack([time, time, np.zeros((len(time), 3)), back]), "%.9g", ",")


def leiria(folder: Path) -> None:
    time, field, acceleration, rate = columns()
    field = np.concatenate([[[0.0, 0.0, 0.0]], field[1:]])
    path = folder / "V_300_path1_LSM9DS0.npz"
    np.savez(path, t=time, acc=acceleration / public.GRAVITY, gyro=rate, mag=field, robot_quat=TRUTH)


FORMATS: Final[dict[str, tuple[str, Callable[[Path], None], int, float]]] = {
    # the file, its set, trials in it, and what a µT is in it
    "BROAD, HDF5": ("broad", broad_hdf5, 1, 1.0),
    "BROAD, MATLAB": ("broad", broad_matlab, 1, 1.0),
    "Sassari": ("sassari", sassari, 6, 1.0),
    "RepoIMU": ("repoimu", repoimu, 1, 0.02),
    "FIUMARGDB": ("fiumargdb", fiumargdb, 1, 1.0),
    "OxIOD": ("oxiod", oxiod, 1, 1.0),
    "Leiria": ("leiria_robot", leiria, 1, 1.0),
}


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_is_read_and_judged_as_the_recording_behind_it(name: str, tmp_path: Path) -> None:
    of_set, write, count, unit = FORMATS[name]
    write(tmp_path)
    trials = list(public.SETS[of_set](tmp_path))
    assert len(trials) == count
    samples, first = trials[0].samples, len(TRUTH) - len(trials[0].samples)
    read = (samples.time, samples.field / unit, samples.acceleration, samples.rate)
    for found, column in zip(read, columns(), strict=True):
        assert found is not None
        np.testing.assert_allclose(found, column[first:], atol=1e-4)
    rough = bare_fit(Calibration(np.eye(3), unit * RECORDING.sensor.offset, 50.0 * unit))
    expected = public.compared(uncorrected(RECORDING), public.Trial("", RECORDING.samples, TRUTH))
    measured = public.compared(rough, trials[0])
    assert measured.worst_deg == pytest.approx(expected.worst_deg, rel=0.02)
    assert measured.single_deg == pytest.approx(expected.single_deg, rel=0.05)
    assert measured.dip_deg == pytest.approx(60.0, abs=0.5)


def uncorrected(recording: simulate.Simulated) -> Fit:
    """Nothing but the offset of the sensor."""
    return bare_fit(Calibration(np.eye(3), recording.sensor.offset, 50.0))


SENSOR: Final = simulate.Sensor(
    matrix=np.array([[1.1, 0.04, 0.02], [0.04, 0.95, -0.03], [0.02, -0.03, 1.0]]),
    offset=np.array([12.0, -30.0, 7.0]),
    noise=1e-6,
)


@pytest.mark.parametrize("error", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.4, -0.7, 1.5)])
def test_the_heading_error_of_a_calibration_is_found_whatever_the_mounting_and_the_room(
    error: tuple[float, float, float],
) -> None:
    """An offset of 1 µT across 25 µT of level field is 2.3°."""
    recording = simulate.tumble(seed=5, n=900, sensor=SENSOR)
    calibration = Calibration(np.linalg.inv(SENSOR.matrix), SENSOR.offset + error, 50.0)
    heading, fields = level_turn(60.0)
    readings = fields - np.linalg.solve(SENSOR.matrix, error)[:, np.newaxis] / 50.0
    expected = np.degrees(np.abs(heading_errors(readings, heading)[0]).max())
    found = public.compared(bare_fit(calibration), public.Trial("", recording.samples, truth_of(recording)))
    assert found.worst_deg == pytest.approx(expected, rel=0.01, abs=1e-3)
    assert found.rest_deg < 0.001


def test_soft_iron_left_in_the_readings_is_found() -> None:
    recording = simulate.tumble(seed=6, n=900, sensor=SENSOR)
    heading, fields = level_turn(60.0)
    expected = np.degrees(np.abs(heading_errors(SENSOR.matrix @ fields, heading)[0]).max())
    found = public.compared(uncorrected(recording), public.Trial("", recording.samples, truth_of(recording)))
    assert found.worst_deg == pytest.approx(expected, rel=0.01)
    assert found.rest_deg < 0.001 < found.single_deg


def test_true_over_claimed_is_about_one_where_claims_hold() -> None:
    ratios = []
    for seed in range(8):
        recording = simulate.tumble(seed=seed, n=800)
        cells = public.judged(public.Trial("", recording.samples, truth_of(recording))).split("|")
        ratios.append(float(cells[5]))
    assert 0.5 < np.median(ratios) < 2.0


def test_a_set_is_left_out_with_the_package_that_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, write in {"broad": broad_hdf5, "repoimu": repoimu}.items():
        (tmp_path / name).mkdir()
        write(tmp_path / name)
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setattr(sys, "argv", ["public", str(tmp_path)])
    public.main()
    printed = capsys.readouterr()
    assert_sentences(printed.err)
    assert printed.out.splitlines()[2].startswith("| repoimu | TStick_Test02_Trial1 | 900 | ")


@pytest.mark.parametrize(
    ("of_set", "name", "text"),
    [
        ("repoimu", "TStick_Test02_Trial1.csv", "\n\n1;2;3\n4;5;6\n"),
        ("fiumargdb", "rec01.csv", "\n\n1,2\n3,4\n"),
    ],
)
def test_a_file_of_another_format_is_named(of_set: str, name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with assert_raises(public.Unread):
        list(public.SETS[of_set](tmp_path))


def test_a_missing_variable_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "path1.npz", t=np.zeros(3), mag=np.zeros((3, 3)))
    with assert_raises(public.Unread):
        list(public.leiria(tmp_path))


def test_a_recording_without_a_truth_says_so() -> None:
    trial = public.Trial("rec01", RECORDING.samples, np.full((len(TRUTH), 4), np.nan))
    assert_sentences(public.judged(trial))


def test_a_trial_of_broad_in_both_formats_counts_once(tmp_path: Path) -> None:
    broad_hdf5(tmp_path)
    broad_matlab(tmp_path)
    assert len(list(public.broad(tmp_path))) == 1


def test_a_folder_without_a_set_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["public", str(tmp_path)])
    with assert_raises(SystemExit):
        public.main()
