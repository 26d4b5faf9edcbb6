"""Public recordings with true orientations: claims compared with the truth.

    python -m benchmarks.public FOLDER

FOLDER has a sub-folder for each set, named as in `SETS`; nothing is downloaded. ``docs/public-data.md`` states source
and licence of each set, and the quality of its truth. Columns:

claimed            worst level heading error, 1 σ, at the true inclination; none for a refused fit
true               the same of the corrected readings, from the affine map of the true field to them: a level turn
                                      through it, less the mean and the rotation, which a magnetometer cannot determine
ratio              true over claimed: 1.2 in the median and 2.1 at 90 % for true claims
single readings    root mean square heading error of single corrected readings
after the map      the same of readings corrected by the true affine map: noise of the sensor, delays of the truth, and
                                      variation of the field, which no calibration removes. If it is not well below the
                                      single readings, or the field varies with the attitude, as indoors, the truth is
                                      of little use.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from importlib import import_module
from itertools import permutations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from flinders.core.samples import Samples
from flinders.errors import FitError
from flinders.fitting.result import Refused
from flinders.geometry.plane import down_direction, heading_errors
from flinders.geometry.quaternions import rotate_vectors, valid_attitudes
from flinders.heading.error_propagation import level_turn, upright

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from flinders import Fit
    from flinders.arrays import Floats

GRAVITY: Final = 9.80665
START_ROTATIONS: Final = np.array([
    rotation
    for axes in permutations(np.eye(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(rotation := np.array(axes) * signs) > 0.0
])  # fmt: skip
"""(24, 3, 3) start values of the mounting: all rotations by quarter turns."""
ROUNDS: Final = 30
"""Iterations over mounting, field and calibration, each from the others."""
MAX_READINGS: Final = 20_000
"""Most readings to compare with a truth."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A recording and its truth."""

    name: str
    samples: Samples
    #: (N, 4): quaternion w, x, y, z between the axes of the body and of the room; NaN without a truth
    attitude: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Errors of corrected readings by the truth."""

    worst_deg: float  #: of a level turn
    single_deg: float  #: root mean square of single readings
    rest_deg: float  #: the same after the affine map
    dip_deg: float  #: of the mean field of the room, with the sign that the claim has in sensor axes
    readings: int


class Unread(Exception):
    """A recording cannot be read or compared, with the reason."""


# evaluation


def judged(trial: Trial) -> str:
    """Fit a recording, compare it with its truth, and write its columns."""
    try:
        fit = flinders.fit(trial.samples)
    except Refused as refusal:
        fit = refusal.fit
    except FitError as error:
        return f"{trial.name} | {len(trial.samples):,} | refused: {error.code} |  |  |  |  |  |"
    try:
        truth = compared(fit, trial)
    except Unread as unread:
        return f"{trial.name} | {len(trial.samples):,} | {fit.verdict}; {unread} |  |  |  |  |  |"
    claimed = math.nan if fit.verdict == "refused" else fit.claim.level_error(truth.dip_deg).worst
    columns = (claimed, truth.worst_deg, truth.worst_deg / claimed, truth.single_deg, truth.rest_deg)
    shown = (f"{number:.2g}{unit}" * math.isfinite(number) for number, unit in zip(columns, "°° °°", strict=True))
    return f"{trial.name} | {truth.readings:,} | {fit.verdict} | {' | '.join(cell.strip() for cell in shown)} |"


def compared(fit: Fit, trial: Trial) -> Truth:
    """Compare the corrected readings of a fit with the truth, with a fitted mounting and direction of the field.

    c = (I + E) Mᵀ Rᵀ h + f with corrected readings c, true attitudes R, mounting M, field h of the room, and remaining
    errors E and f of the calibration, solved alternately until convergence.
    """
    samples, attitude = _thinned(trial)
    corrected = fit.calibration.apply(samples.field)
    turns, mounting = _mounting(corrected, attitude)
    shape, offset, field = np.eye(3), np.zeros(3), np.zeros(3)
    for _ in range(ROUNDS):
        unbent = np.linalg.solve(shape, (corrected - offset).T).T
        field = _turned(turns, unbent @ mounting.T).mean(axis=0)
        body = _turned(turns.transpose(0, 2, 1), field)
        mounting = _rotation(body.T @ unbent)
        true = np.column_stack([body @ mounting, np.ones(len(body))])
        rest = corrected - true[:, :3]
        errors, *_ = np.linalg.lstsq(true, rest, rcond=1e-6)
        shape, offset = np.eye(3) + errors[:3].T, errors[3]
    up = _up(samples, turns)
    size = float(np.linalg.norm(field))
    steepness_deg = math.degrees(math.asin(min(abs(float(up @ field)) / size, 1.0)))
    dip_deg = math.copysign(steepness_deg, fit.claim.known_dip_deg)
    return Truth(
        _level_deg(shape, offset / size, dip_deg, down_direction(fit.claim.plane)),
        _about_deg(_turned(turns, corrected @ mounting.T), field, up),
        _about_deg(_turned(turns, unbent @ mounting.T), field, up),
        dip_deg,
        len(corrected),
    )


def _thinned(trial: Trial) -> tuple[Samples, Floats]:
    """Readings with a truth, at most `MAX_READINGS`."""
    rows = np.flatnonzero(np.isfinite(valid_attitudes(trial.attitude)).all(axis=1))
    rows = rows[:: 1 + len(rows) // MAX_READINGS]
    if len(rows) < len(START_ROTATIONS):
        raise Unread(f"a truth at {len(rows)} readings, need {len(START_ROTATIONS)}")
    return trial.samples[rows.tolist()], trial.attitude[rows]


def _mounting(corrected: Floats, attitude: Floats) -> tuple[Floats, Floats]:
    """(N, 3, 3) true rotations and (3, 3) mounting as start values.

    Some sets do not state the direction of their quaternions, sensor to room or back: both are tried.
    """
    turns = rotate_vectors(attitude[:, np.newaxis], np.eye(3)).transpose(0, 2, 1)
    starts = [*_starts(corrected, turns), *_starts(corrected, turns.transpose(0, 2, 1))]
    _, turns, mounting = max(starts, key=lambda start: start[0])
    return turns, mounting


def _starts(vectors: Floats, turns: Floats) -> Iterator[tuple[float, Floats, Floats]]:
    """Yield the length of the mean of (N, 3) vectors in the room, the rotations, and each of `START_ROTATIONS`."""
    for start in START_ROTATIONS:
        yield float(np.linalg.norm(_turned(turns, vectors @ start.T).mean(axis=0))), turns, start


def _turned(turns: Floats, vectors: Floats) -> Floats:
    """(N, 3) vectors, or one, turned by (N, 3, 3) rotations."""
    turned: Floats = np.einsum("nij,nj->ni", turns, np.broadcast_to(vectors, (len(turns), 3)))
    return turned


def _rotation(matrix: Floats) -> Floats:
    """(3, 3) the rotation R with the largest trace of RᵀM (Kabsch 1976)."""
    left, _, right = np.linalg.svd(matrix)
    rotation: Floats = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return rotation


def _up(samples: Samples, turns: Floats) -> Floats:
    """(3,) vertical of the room: the mean acceleration in its axes, else its z axis."""
    if samples.acceleration is None:
        return np.array([0.0, 0.0, 1.0])
    force = np.nan_to_num(samples.acceleration)
    _, _, mounting = max(_starts(force, turns), key=lambda start: start[0])
    for _ in range(ROUNDS):
        mean = _turned(turns, force @ mounting.T).mean(axis=0)
        mounting = _rotation(_turned(turns.transpose(0, 2, 1), mean).T @ force)
    up: Floats = mean / np.linalg.norm(mean)
    return up


def _level_deg(shape: Floats, offset: Floats, dip_deg: float, down: Floats | None) -> float:
    """Worst heading error of a level turn whose field of length 1 is read as ``shape @ field + offset``."""
    rotation = _rotation(shape)
    heading, fields = level_turn(dip_deg, down)
    readings = rotation.T @ (shape @ fields + offset[:, np.newaxis])
    level = readings if down is None else upright(down).T @ readings
    return float(np.degrees(np.abs(heading_errors(level, heading)[0]).max()))


def _about_deg(seen: Floats, field: Floats, up: Floats) -> float:
    """Root mean square angle about the vertical of (N, 3) fields from their mean, the mean angle removed."""
    east = np.cross(field, up)
    east /= np.linalg.norm(east)
    phasors = seen @ np.cross(up, east) + 1j * (seen @ east)
    angles = np.angle(phasors / np.exp(1j * np.angle((phasors / np.abs(phasors)).mean())))
    return math.degrees(math.sqrt(float(np.mean(angles**2))))


# readers


def broad(folder: Path) -> Iterator[Trial]:
    """BROAD: HDF5 or MATLAB; readings with quaternions of OptiTrack (w, x, y, z), NaN if lost.

    Names as in ``example_code/process_data.py`` of https://github.com/dlaidig/broad; in HDF5 the rate is an attribute.
    A trial in both formats counts once.
    """
    either = {path.stem: path for path in (*folder.rglob("*.hdf5"), *folder.rglob("*.mat"))}
    for _, path in sorted(either.items()):
        if path.suffix == ".hdf5":
            with _needed("h5py", "BROAD").File(path, "r") as file:
                columns = {name: np.asarray(file[name]) for name in file} | dict(file.attrs)
        else:
            columns = _matlab(path, "BROAD")
            if "param_names" in columns:
                continue  # a result of the example code
        field, acceleration, rate, attitude, rate_hz = _variables(
            columns, path, "imu_mag", "imu_acc", "imu_gyr", "opt_quat", "sampling_rate"
        )
        time = np.arange(len(field)) / float(np.squeeze(rate_hz))
        yield _trial(path.stem, field, "uT", time, acceleration, rate, attitude)


def sassari(folder: Path) -> Iterator[Trial]:
    """Caruso et al., Sassari: MATLAB; six sensors on one board at 100 Hz, quaternions of Vicon (w, x, y, z).

    ``XS1`` and the other sensors are (N, 14): time, accelerometer, gyro, magnetometer, quaternion of the maker; ``Qs``
    is that of Vicon, as the authors' https://github.com/marcocaruso/sensor_fusion_algorithm_codes takes them. No unit
    of the magnetometers is stated there.
    """
    for path in sorted(folder.rglob("*_v[45].mat")):
        columns = _matlab(path, "Sassari")
        for sensor in ("XS1", "XS2", "AP1", "AP2", "SH1", "SH2"):
            rows, attitude = _variables(columns, path, sensor, "Qs")
            time = np.arange(len(rows)) / 100.0
            name = f"{path.stem} {sensor}"
            yield _trial(name, rows[:, 7:10], "counts", time, rows[:, 1:4], rows[:, 4:7], attitude)


def repoimu(folder: Path) -> Iterator[Trial]:
    """RepoIMU's stick: two lines of names, then 14 numbers between semicolons at 100 Hz, quaternions of Vicon first.

    Time, quaternion (w, x, y, z), accelerometer, gyro, magnetometer in an arbitrary unit:
    https://github.com/agnieszkaszczesna/RepoIMU. The pendulum repeats readings and is left out.
    """
    for path in sorted(folder.rglob("TStick_*.csv")):
        rows = _table(path, ";", 2, 14)
        yield _trial(path.stem, rows[:, 11:14], "counts", rows[:, 0], rows[:, 5:8], rows[:, 8:11], rows[:, 1:5])


def fiumargdb(folder: Path) -> Iterator[Trial]:
    """FIUMARGDB: two lines of names, then 23 numbers between commas, as its ``readDBFile.m`` has them.

    Time in ms, position, quaternion of OptiTrack (x, y, z, w), that of the sensor, gyro, accelerometer in g,
    magnetometer in G, stillness, and 1 where the cameras saw it:
    https://github.com/LABDSP/FIUMARGDB_marg_signals_and_reference_orientations.
    """
    for path in sorted(folder.rglob("*.csv")):
        rows = _table(path, ",", 2, 23)
        attitude = np.where(rows[:, 22:23] == 1.0, rows[:, [7, 4, 5, 6]], np.nan)
        acceleration = GRAVITY * rows[:, 15:18]
        yield _trial(path.stem, rows[:, 18:21], "G", rows[:, 0] / 1e3, acceleration, rows[:, 12:15], attitude)


def oxiod(folder: Path) -> Iterator[Trial]:
    """OxIOD: ``syn/imu1.csv`` of a phone beside ``syn/vi1.csv`` of Vicon, row by row at 100 Hz, no line of names.

    Time, attitude, rate, gravity and acceleration of the user in g as iOS has them (gravity points down), magnetic
    field in µT; time, header, position, quaternion (x, y, z, w):
    README of https://github.com/jimchen2/indoor_localization_oxford_dataset.
    """
    for path in sorted(folder.rglob("syn/imu*.csv")):
        rows = _table(path, ",", 0, 16)
        seen = _table(path.with_name(path.name.replace("imu", "vi")), ",", 0, 9)
        both = min(len(rows), len(seen))
        rows, seen = rows[:both], seen[:both]
        name = f"{path.parent.parent.parent.name}/{path.parent.parent.name}/{path.stem}"
        acceleration = -GRAVITY * (rows[:, 7:10] + rows[:, 10:13])
        time = np.arange(both) / 100.0
        yield _trial(name, rows[:, 13:16], "uT", time, acceleration, rows[:, 4:7], seen[:, [8, 5, 6, 7]])


def leiria(folder: Path) -> Iterator[Trial]:
    """Leiria's robot arm as NumPy's ``t``, ``acc`` in g, ``gyro``, ``mag`` in µT and ``robot_quat`` (w, x, y, z)."""
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            columns = dict(file)
        time, acceleration, rate, field, attitude = _variables(columns, path, "t", "acc", "gyro", "mag", "robot_quat")
        yield _trial(path.stem, field, "uT", time, GRAVITY * acceleration, rate, attitude)


SETS: Final[Mapping[str, Callable[[Path], Iterator[Trial]]]] = {
    "broad": broad,
    "sassari": sassari,
    "repoimu": repoimu,
    "fiumargdb": fiumargdb,
    "oxiod": oxiod,
    "leiria_robot": leiria,
}
"""Readers by the sub-folders that they read."""


def _trial(
    name: str, field: Floats, unit: str, time: Floats, acceleration: Floats, rate: Floats, attitude: Floats
) -> Trial:
    """Trial from columns, without rows whose field is missing or zero."""
    rows = np.isfinite(field).all(axis=1) & np.any(field != 0.0, axis=1)
    samples = Samples.of(
        field[rows], unit=unit, time=time[rows], acceleration=acceleration[rows], rate=rate[rows], source=name
    )
    return Trial(name, samples, valid_attitudes(np.asarray(attitude, float)[rows]))


def _matlab(path: Path, what: str) -> dict[str, Any]:
    """Variables of a file of MATLAB, up to version 7."""
    variables: dict[str, Any] = _needed("scipy.io", what).loadmat(path)
    return variables


def _needed(module: str, what: str) -> Any:  # noqa: ANN401 - a module without types
    """Import the module that reads a format."""
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise Unread(f"{what} needs {package}, which is not installed: pip install {package}") from None


def _table(path: Path, delimiter: str, names: int, columns: int) -> Floats:
    """(N, columns) numbers of a text file, after some lines of names."""
    rows: Floats = np.genfromtxt(path, delimiter=delimiter, skip_header=names)
    if rows.ndim != 2 or rows.shape[1] != columns:
        found = rows.shape[1] if rows.ndim == 2 else rows.size
        raise Unread(f"{path.name} has {found} columns between {delimiter!r}: need {columns}")
    return rows


def _variables(columns: Mapping[str, Any], path: Path, *names: str) -> Iterator[Floats]:
    """Variables of a file by their names."""
    for name in names:
        if name not in columns:
            raise Unread(f"{path.name} has {', '.join(sorted(columns)) or 'nothing'}: need {name}")
        yield np.asarray(columns[name], float)


def main() -> None:
    """Print the table of the sets in the folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="has a sub-folder for each set: docs/public-data.md")
    folder = parser.parse_args().folder
    found = [name for name in SETS if (folder / name).is_dir()]
    if not found:
        sys.exit(f"no set in {folder}: need one of the sub-folders {', '.join(SETS)}; see docs/public-data.md")
    print("| set | recording | readings | verdict | claimed | true | ratio | single readings | after the map |")
    print("|---|---|---:|---|---:|---:|---:|---:|---:|")
    for name in found:
        try:
            for trial in SETS[name](folder / name):
                print(f"| {name} | {judged(trial)}", flush=True)
        except Unread as unread:
            print(f"{name}: {unread}", file=sys.stderr)


if __name__ == "__main__":
    main()
