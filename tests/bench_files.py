"""Files that the commands of README, docs and help texts read, by the names that they have there.

`make` puts one into the current folder. A file that is another thing to some commands has a row of its own, behind a
word that those commands have.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
import zipfile
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from tests import samples, still_poses
from tests.boats import START, Boat, nmea0183_of, octagon
from tests.flight_log import dataflash, round_flight
from tests.golden.sessions import ROOT
from tests.heading_logs import calibrated, swinging, turned, write
from tests.marine.test_courses import boat_of
from tests.marine.test_courses import table as table_of_courses
from tests.program import flinders_
from tests.readers.test_courses import DIP_DEG, FIELD_UT, drive
from tests.survey.test_survey import in_counts, topodroid
from tests.vehicles.test_courses_of_logs import dataflash as log_of_courses
from tests.worlds import table_text

from flinders import simulate
from flinders.apps.survey.simulate_shots import survey_shots
from flinders.core.calibration import Calibration
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.core.samples import Samples
    from flinders.readers._resample import TimeSeries
    from flinders.simulate import Simulated

    Maker = Callable[[Path], object]

WRITTEN: Final = frozenset({"-o", "--output", "--csv", "--adopted", "--state", "--truth", "--polar", "--report"})
"""Options whose file is written, and must not be there."""
UNNAMED: Final = {"at": "calibrations.parquet"}
"""Files that a command reads without being told, by a word of it."""
SENSOR: Final = simulate.Sensor(np.diag([1.01, 0.99, 1.0]), np.array([20.0, -60.0, 30.0]), 0.3)
CORRECTION: Final = "compass,magnetic\n3,359\n85,91\n170,178\n265,267\n"
CHECK: Final = "compass,magnetic\n316,317\n358,0\n42,47\n89,93\n134,135\n177,179\n220,225\n269,273\n"
SWING: Final = "compass,deviation\n0,10.5\n45,20\n90,11.5\n135,-1.2\n180,-5.5\n225,-8\n270,-12.5\n315,-6.8\n"


def make(name: str, words: Sequence[str]) -> bool:
    """Put a file into the current folder that a command with these words reads; whether it is one of them."""
    own = {f"{word} {name}" for word in words}
    key = next((key for key in FILES if key in own), name)
    if key not in FILES:
        return False
    source = _made(key, name)
    if not Path(name.partition("*")[0]).exists():
        for made in source.iterdir():
            copy = shutil.copytree if made.is_dir() else shutil.copy2
            copy(made, Path(made.name))
    return True


@cache
def _made(key: str, name: str) -> Path:
    """A folder with a file, or a folder of files, and nothing else."""
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    with contextlib.chdir(tempfile.mkdtemp(prefix="making-")):
        FILES[key](Path(name))
        shutil.move(Path(name).parts[0], folder)
    return folder


def run(*lines: str) -> None:
    """Run commands, whose files are made before."""
    for line in lines:
        words = line.split()
        for before, name in pairwise(words):
            if before not in WRITTEN:
                make(name, words)
        ended = flinders_(*words)
        assert ended.code in {0, 3}, f"{line}: {ended.err}"


def of_commands(*lines: str) -> Maker:
    """A file that commands write."""
    return lambda path: run(*(line.format(path) for line in lines))


NAMED: Final = "t_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x_mps2,acc_y_mps2,acc_z_mps2,gyro_x_rads,gyro_y_rads,gyro_z_rads"
PLAIN: Final = NAMED.replace("mag_x_uT,mag_y_uT,mag_z_uT", "mx,my,mz")


def tumble(seed: int, header: str = NAMED, **options: object) -> Maker:
    """A recording of `SENSOR`, turned by hand through all directions, with accelerometer and gyro."""

    def written(path: Path) -> None:
        options.setdefault("sensor", SENSOR)
        seen = simulate.tumble(seed=seed, n=600, motion="hand", **options).samples  # type: ignore[arg-type]
        times = 0.1 * np.arange(len(seen.field))
        assert seen.acceleration is not None
        assert seen.rate is not None
        columns = [times, seen.field, seen.acceleration, seen.rate]
        path.write_text(table_text(header, np.column_stack(columns)), encoding="utf-8")

    return written


def counts(path: Path) -> None:
    """A recording of a sensor with steps of 0.15 µT, as its registers hold it."""
    seen = simulate.tumble(seed=7, n=600, motion="hand", sensor=SENSOR).samples
    rows = np.column_stack([100 * np.arange(600), np.round(seen.field / 0.15)]).astype(int)
    path.write_text("ms,mx_raw,my_raw,mz_raw\n" + "\n".join(",".join(map(str, row)) for row in rows), encoding="utf-8")


def turn(axes: str, header: str = "x_uT,y_uT,z_uT") -> Maker:
    """A sensor that is turned once around in the plane of two axes; all three, or those two after a column of time."""

    def written(path: Path) -> None:
        around, rng = np.linspace(0.0, 6.4, 72), np.random.default_rng(1)
        field = np.zeros((72, 3))
        field[:, "xyz".index(axes[0])], field[:, "xyz".index(axes[1])] = 25.0 * np.cos(around), -25.0 * np.sin(around)
        field += [4.0, -9.0, 3.0] + 0.05 * rng.standard_normal((72, 3))
        if header.startswith("t,"):
            field = np.column_stack([0.1 * np.arange(72), *(field[:, "xyz".index(axis)] for axis in axes)])
        path.write_text(table_text(header, field), encoding="utf-8")

    return written


def motors(path: Path) -> None:
    """A tumble while currents flow, and the temperature rises and falls, with accelerometer and gyro."""
    seen = simulate.tumble(seed=4, n=1200, sensor=SENSOR, motion="hand").samples
    times = 0.1 * np.arange(len(seen.field))
    currents = np.stack([5.0 + 4.0 * np.sin(speed * times) for speed in (0.9, 0.7, 1.3)], axis=1)
    warmth = 25.0 + 10.0 * np.sin(0.21 * times)
    made = currents @ [[0.3, -0.1, 0.2], [-0.2, 0.2, 0.1], [0.1, 0.3, -0.2]] + np.outer(
        warmth - 25.0, [0.05, 0.0, -0.05]
    )
    header = f"{NAMED},current1_A,current2_A,current3_A,current_A,temperature_degC"
    columns = [times, seen.field + made, seen.acceleration, seen.rate, currents, currents.sum(axis=1), warmth]
    path.write_text(table_text(header, np.column_stack(columns)), encoding="utf-8")


def rover(path: Path) -> None:
    """A tumble while a wheel turns and a charger is switched on and off."""
    wheel = simulate.NamedColumn("wheel_speed_rpm", [0.002, 0.0, -0.003], highest=3000.0, hold=2.0)
    charger = simulate.NamedColumn("charger", [4.0, 0.0, -1.5], states=("idle", "charging"), hold=2.0)
    tumble = simulate.tumble(seed=5, n=1500, sensor=SENSOR, disturbances=[wheel, charger])
    simulate.write_csv(tumble.samples, path)


def bench(path: Path) -> None:
    """A sensor that is held still while a motor runs up and down."""
    times = np.arange(0.0, 60.0, 0.1)
    current = 10.0 + 9.0 * np.sin(0.8 * times)
    noise = np.random.default_rng(6).normal(scale=0.1, size=(len(times), 3))
    field = np.array([10.0, 60.0, -20.0]) + current[:, np.newaxis] * [0.3, -0.1, 0.2] + noise
    path.write_text(table_text("t_s,mag_x_uT,mag_y_uT,mag_z_uT,current_A", np.column_stack([times, field, current])))


def swung(path: Path) -> None:
    """A vehicle that rests on eight headings, with its accelerometer."""
    write(str(path), swinging(45.0 * np.arange(8.0)))


def course_log(path: Path) -> None:
    """A tumble, or a drive on straight stretches, as logs of ArduPilot."""
    first, samples, velocity = driven()
    path.write_bytes(log_of_courses(first.samples if path.name == "tumble.bin" else samples, velocity))


def course_table(path: Path) -> None:
    """The log of a boat, the readings beside it, or a tumble of their sensor before."""
    first, samples, velocity = driven()
    lines = [table_of_courses(samples, START)] if path.suffix == ".csv" else nmea0183_of(boat_of(velocity))
    if path.name == "course.csv":
        lines = [table_of_courses(first.samples, START)]
    path.write_text("\n".join(lines), encoding="utf-8")


def driven() -> tuple[Simulated, Samples, TimeSeries]:
    """A tumble of a sensor, and the drive and the velocity of it after its offset moved."""
    first = simulate.tumble(seed=2, field_strength=FIELD_UT, dip_deg=DIP_DEG)
    sensor = replace(first.sensor, offset=first.sensor.offset + np.array([12.0, -7.0, 4.0]))
    return first, *drive(sensor, np.random.default_rng(4), crab_deg=0.0)


def shots_of_mag_cal(path: Path) -> None:
    """Shots as another calibrator of survey instruments keeps them."""
    shots = in_counts(survey_shots(3, shots=24).shots)
    along_y = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # the laser, which points along x there
    magnetic, gravity = shots.magnetic @ along_y, shots.gravity @ along_y
    turned_back = {"mag": magnetic * [1, 1, -1], "grav": gravity[:, [1, 0, 2]] * [-1, -1, 1]}
    path.write_text(json.dumps({name: rows.tolist() for name, rows in turned_back.items()}), encoding="utf-16")


def with_scalar(seed: int) -> Maker:
    """A flight whose column of the scalar magnetometer has another name and unit."""

    def written(path: Path) -> None:
        run(f"simulate aircraft -o made.csv --seed {seed}")
        header, *rows = Path("made.csv").read_text(encoding="utf-8").splitlines()
        cells = [row.rsplit(",", 1) for row in rows]
        renamed = header.replace("reference_strength_uT", "mag1_nT")
        path.write_text("\n".join([renamed, *(f"{row},{1000.0 * float(last):.3f}" for row, last in cells), ""]))

    return written


def moved(path: Path) -> None:
    """Ten seconds of wobbling after a battery was moved."""
    tumble(7, sensor=replace(SENSOR, offset=SENSOR.offset + np.array([3.0, -2.0, 1.0])))(path)


def heading_of(degrees: float) -> Maker:
    """A vehicle at rest on one heading."""

    def written(path: Path) -> None:
        field = 50.0 * turned(np.full(60, degrees))[:, :, 0] * 0.4067
        field[:, 2] += 50.0 * 0.9135
        noise = np.random.default_rng(round(degrees)).normal(scale=0.2, size=(60, 3))
        matrix, offset = SENSOR.correction
        path.write_text(table_text("mx_uT,my_uT,mz_uT", np.linalg.solve(matrix, field.T).T + offset + noise))

    return written


def line_of_units(folder: Path) -> None:
    """Logs of three units, a folder each."""
    for unit in range(3):
        for month in (3, 6):
            path = folder / f"V10{unit}" / f"2026-0{month}-01.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            tumble(10 * unit + month)(path)


def table_of_units(pattern: Path) -> None:
    """A table of the readings of two units."""
    import pyarrow
    import pyarrow.parquet

    fields = [10.0 * simulate.tumble(seed=seed, n=400).samples.field for seed in (1, 2)]
    columns = dict(zip(("mx", "my", "mz"), np.concatenate(fields).T, strict=True))
    pattern.parent.mkdir(exist_ok=True)
    table = pyarrow.table({"serial": ["A1"] * 400 + ["A2"] * 400, **columns})
    pyarrow.parquet.write_table(table, pattern.parent / "monday.parquet")


def states(pattern: Path) -> None:
    """What ``flinders watch`` keeps of two units."""
    pattern.parent.mkdir(exist_ok=True)
    for unit in ("A1", "A2"):
        run(f"watch --replay tumble.csv --state {pattern.parent / unit}.state")


def sample(name: str, *, unit_free: bool = False) -> Maker:
    """A recording in the format of a reader."""

    def written(path: Path) -> None:
        seen = simulate.tumble(seed=3, n=600, sensor=SENSOR).samples.field
        times = 0.1 * np.arange(len(seen))
        gravity = np.tile([0.0, 0.0, 9.81], (len(seen), 1))
        samples.WRITERS[name](path, np.column_stack([times, seen if unit_free else 10.0 * seen, gravity]))

    return written


def table(path: Path) -> None:
    """A table in nT whose columns have names of their own, by its ending Parquet or Arrow."""
    import pyarrow
    import pyarrow.feather
    import pyarrow.parquet

    field = 1000.0 * simulate.tumble(seed=3, n=600, sensor=SENSOR).samples.field
    columns = pyarrow.table(dict(zip(("bx", "by", "bz"), field.T, strict=True)))
    pyarrow.parquet.write_table(columns, path)


def vectors(path: Path) -> None:
    """An array of structures, as NumPy or SciPy keeps it."""
    field = simulate.tumble(seed=3, n=600, sensor=SENSOR).samples.field
    named = dict(zip(("x", "y", "z"), field.T, strict=True))
    if path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, {"mag": named, "acc": dict.fromkeys("xyz", np.zeros(len(field)))})
    elif path.suffix == ".npz":
        np.savez(path, **{f"mag.{axis}": column for axis, column in named.items()})
    else:
        np.save(path, field)


def phone(path: Path) -> None:
    """What a phone's logger packs."""
    field = simulate.tumble(seed=3, n=600, sensor=SENSOR).samples.field
    with zipfile.ZipFile(path, "w") as archive:
        rows = np.column_stack([0.1 * np.arange(len(field)), field[:, ::-1]])
        archive.writestr("Magnetometer.csv", table_text("seconds_elapsed,z,y,x", rows))


def printed(path: Path) -> None:
    """Lines of a shape that nobody knows."""
    field = 10.0 * simulate.tumble(seed=3, n=600, sensor=SENSOR).samples.field
    path.write_text("".join(f"<{x:.1f}/{y:.1f}/{z:.1f}/{row}>\n" for row, (x, y, z) in enumerate(field)))


def plan_of_a_station(path: Path) -> None:
    """The file of a station, with all its tables, as docs/live/station.md shows it."""
    page = (ROOT / "docs" / "live" / "station.md").read_text(encoding="utf-8")
    path.write_text(page.partition("```toml\n")[2].partition("```")[0], encoding="utf-8")


def tests_of_a_gauge(path: Path) -> None:
    """The table of a station at which three units were tested twice by two people."""
    rng, rows = np.random.default_rng(3), []
    for unit in ("A1", "A2", "A3"):
        for operator in ("ada", "grace"):
            for _ in range(2):
                values = [20.0, -30.0, 5.0] + 0.2 * rng.standard_normal(3)
                cells = (unit, operator, *(f"{value:.3f}" for value in values), f"{0.3 + 0.1 * rng.random():.3f}")
                rows.append(",".join([*cells, "0.3", "50", "uT"]))
    header = "unit,operator,offset_x,offset_y,offset_z,worst_deg,noise,field_strength,unit_of_field"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")


FILES: Final[dict[str, Maker]] = {
    "line-3.toml": plan_of_a_station,
    "line-3/table.csv": tests_of_a_gauge,
    "line-3/recordings": line_of_units,
    "line-3.parquet": of_commands("fleet logs/ -o {}"),
    "line-7.parquet": of_commands("fleet logs/ -o {}"),
    "line": of_commands("simulate fleet -o {}"),
    "line.units.csv": of_commands("simulate fleet -o line"),
    "--with calibration.json": of_commands("calibrate tumble.csv --unit uT -o {}"),
    "--course calibration.json": of_commands("calibrate tumble.bin -o {}"),
    "tumble.bin": course_log,
    "drive.bin": course_log,
    "--course-log calibration.json": of_commands("calibrate course.csv -o {}"),
    "--course-log compass.csv": course_table,
    "course.csv": course_table,
    "--course-log boat.nmea": course_table,
    "sap6.json": shots_of_mag_cal,
    "flight.ulg": lambda path: path.write_bytes(b"".join(dataflash())),
    "tumble.csv": tumble(3, PLAIN),
    "poses.csv": lambda path: path.write_text(still_poses.table(), encoding="utf-8"),
    "accelerometer.json": of_commands("accelerometer poses.csv -o {}"),
    "nine-axes.json": of_commands("simulate three-axis -o made.csv", "calibrate made.csv --with rate,dip -o {}"),
    "tumble.truth.json": of_commands("simulate three-axis -o made.csv --truth {}"),
    "evaluate calibration.json": of_commands("simulate three-axis -o made.csv", "calibrate made.csv -o {}"),
    "evaluate boat.json": of_commands(
        "simulate boat --days 0.4 -o made.csv", "watch --replay made.csv --target 2 --adopted {}"
    ),
    "log.csv calibration.json": lambda _: calibrated(600),
    "flight.bin calibration.json": of_commands("calibrate flight.bin --sensor 1 -o {}"),
    "--scalar box.csv": with_scalar(1),
    "--scalar lines.csv": with_scalar(2),
    "--chip log.csv": counts,
    "--columns log.csv": turn("xy", "t,hx,hy"),
    "--columns yz.csv": turn("yz", "t,hy,hz"),
    "monday.csv": tumble(11, PLAIN),
    "tuesday.csv": tumble(12, PLAIN),
    "raw.csv": tumble(13),
    "today.csv": tumble(14),
    "tomorrow.csv": tumble(15),
    "wobble.csv": moved,
    "orbit.csv": tumble(16),
    "morning.csv": of_commands("simulate boat --days 0.4 -o {}"),
    "week.csv": of_commands("simulate boat --days 0.4 -o {}"),
    "week.truth.json": of_commands("simulate boat --days 0.4 -o days.csv --truth {}"),
    "log.csv": swung,
    "boat.csv": of_commands("simulate three-axis -o {} --motion drive --readings 1200"),
    "flight.bin": lambda path: path.write_bytes(b"".join(dataflash())),
    "check flight.bin": lambda path: path.write_bytes(round_flight()),
    "flight-1.bin": lambda path: path.write_bytes(b"".join(dataflash())),
    "flight-2.bin": lambda path: path.write_bytes(b"".join(dataflash(week=2401))),
    "flight.csv": motors,
    "--with flight.bin": motors,
    "rover.csv": rover,
    "bench.csv": bench,
    "flight.tlog": sample("tlog"),
    "walk.bag": sample("ros"),
    "walk.zip": phone,
    "log.h5": sample("hdf5"),
    "table.parquet": table,
    "table.feather": sample("arrow"),
    "tumble.npy": vectors,
    "run.npz": vectors,
    "run.mat": vectors,
    "print.txt": printed,
    "north.csv": heading_of(0.0),
    "south.csv": heading_of(180.0),
    "mounted.json": lambda path: Calibration(euler(0, 0, 88), np.ones(3), 50.0, rotation="estimated").save(path),
    "magnetometer.dtsi": of_commands("export --for iio-mount-matrix mounted.json -o {}"),
    "calibration.json": of_commands("calibrate tumble.csv --unit uT -o {}"),
    "monday.json": of_commands("calibrate monday.csv --unit uT -o {}"),
    "tuesday.json": of_commands("calibrate tuesday.csv --unit uT -o {}"),
    "friday.json": of_commands("calibrate raw.csv -o {}"),
    "compass.param": of_commands("export --for ardupilot calibration.json -o {}"),
    "vehicle.params": of_commands("export --for px4 --compass 1 calibration.json -o {}"),
    "boat.json": of_commands("calibrate tumble.csv --unit uT -o {}"),
    "calm.json": of_commands("calibrate tumble.csv --unit uT -o {}"),
    "compass.state": of_commands("watch --replay tumble.csv --state {}"),
    "states/*.state": states,
    "logs/": line_of_units,
    "logs": line_of_units,
    "fleet/": line_of_units,
    "line-7/*.parquet": table_of_units,
    "calibrations.parquet": of_commands("fleet logs/ --output {}"),
    "january.parquet": of_commands("fleet logs/ --output {}"),
    "june.parquet": of_commands("fleet logs/ --output {}"),
    "box.csv": of_commands("simulate aircraft -o {}"),
    "lines.csv": of_commands("simulate aircraft -o {} --headings 45,225 --seed 2"),
    "coefficients.json": of_commands("tolles-lawson box.csv -o {}"),
    "shots.csv": lambda path: path.write_text(topodroid(in_counts(survey_shots(3, shots=24).shots))),
    "survey check.csv": lambda path: path.write_text(topodroid(in_counts(survey_shots(4, shots=24).shots))),
    "survey calibration.json": of_commands("survey shots.csv -o {}"),
    "swing.csv": lambda path: path.write_text(SWING),
    "corrected.csv": lambda path: path.write_text(SWING),
    "correction.csv": lambda path: path.write_text(CORRECTION),
    "check.csv": lambda path: path.write_text(CHECK),
    "boat.nmea": lambda path: path.write_text(
        "\n".join(nmea0183_of(Boat.sail(octagon(), np.random.default_rng(11), current=0.4 - 0.2j)))
    ),
    "turn.csv": turn("xy"),
    "level.csv": turn("xy"),
    "xy.csv": turn("xy"),
    "arc.csv": turn("xy"),
    "yz.csv": turn("yz"),
    "zx.csv": turn("zx"),
    "sweep.csv": turn("yz"),
    "two-axis swing.csv": of_commands("simulate two-axis -o {}"),
    "1.json": of_commands("two-axis yz.csv --plane yz -o {}"),
    "2.json": of_commands("two-axis zx.csv --plane zx --after 1.json -o {}"),
    "first.json": of_commands("two-axis yz.csv --plane yz -o {}"),
    "second.json": of_commands("two-axis zx.csv --plane zx --after first.json -o {}"),
}  # fmt: skip
"""By name, or by command and name: what writes it."""
