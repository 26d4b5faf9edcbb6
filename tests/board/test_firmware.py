"""The firmware agrees with the library: its numbers, rules, advice, and what its example prints and takes."""

from __future__ import annotations

import itertools
import json
import math
import os
import select
import shutil
import subprocess
import zlib
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import firmware
from click.testing import CliRunner
from tests.sentences import assert_raises
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.apps.board import package
from flinders.cli import main
from flinders.errors import OutputError, OutputExists
from flinders.estimators import Likelihood, Readings
from flinders.findings.catalogue import ENGINE_FINDINGS, QUANTITIES
from flinders.heading.guidance import guide
from flinders.links import motioncal
from flinders.native.build import system_compiler
from flinders.native.engine import engine
from flinders.targets.motioncal import MotionCalPacket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from benchmarks.firmware import Rows

    from flinders.arrays import Floats

pytestmark = pytest.mark.skipif(system_compiler() is None, reason="no C compiler")

WORLDS: Final = {
    "tumble": {"seed": 1, "n": 300},
    "tilted": {"seed": 2, "n": 290, "motion": "tilted"},
    "outliers": {"seed": 3, "n": 300, "outliers": 0.03},
    "short": {"seed": 4, "n": 60},
}
RECORDINGS: Final = (
    "aleksandrbazhin_ellipsoid/mag_out.txt",
    "jremington_mpu9250/mag.txt",
    "michaelwro_fxos8700/mag-readings.txt",
    "pichim_betaflight/CalCareful_2282320.csv",
    "sunsided_hmc5883l/full-sphere.csv",
)
SHIMS: Final = Path(__file__).parents[1] / "arduino"


def world(name: str) -> Floats:
    return simulate.tumble(**WORLDS[name]).samples.field  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("firmware")


@pytest.fixture(scope="module")
def single(folder: Path) -> Path:
    return firmware.build(firmware.HOST, folder, optimise="-O0")


@pytest.fixture(scope="module")
def archive(folder: Path, single: Path) -> Path:
    """The package as a static library in single precision."""
    objects = firmware.compiled(firmware.HOST, single.parent, optimise="-O0")
    subprocess.run(["ar", "rc", str(folder / "library.a"), *map(str, objects)], check=True)
    return folder / "library.a"


@pytest.fixture(scope="module")
def double(folder: Path) -> Path:
    return firmware.build(firmware.HOST_DOUBLE, folder, optimise="-O0")


def alike(single: Path, double: Path, field: Floats) -> None:
    one = firmware.run(firmware.HOST, single, field, unit=False)["answer"]
    two = firmware.run(firmware.HOST_DOUBLE, double, field, unit=False)["answer"]
    assert one["status"] == two["status"] == 0
    npt.assert_allclose(one["offset"], two["offset"], atol=0.02 / 50 * two["field"])
    npt.assert_allclose(one["matrix"], two["matrix"], atol=1e-3)
    npt.assert_allclose(one["heading_worst_deg"], two["heading_worst_deg"], rtol=0.05)
    npt.assert_array_equal(one["findings"], two["findings"])


@pytest.mark.parametrize("name", ["tumble", "tilted", "outliers"])
def test_single_precision_is_as_good_as_double(name: str, single: Path, double: Path) -> None:
    alike(single, double, world(name).astype(np.float32))


@pytest.mark.parametrize("name", RECORDINGS)
def test_single_precision_is_as_good_as_double_on_real_readings(
    name: str, single: Path, double: Path, recordings: Callable[[str], Path]
) -> None:
    outcome = firmware.run(firmware.HOST, single, flinders.read(recordings(name)).field, unit=False)
    alike(single, double, outcome["readings"][: outcome["count"]])


@pytest.mark.parametrize("name", ["tumble"])  # of thin turns the library claims a field that varies with the place, too
def test_a_board_claims_what_the_library_claims_of_independent_readings(name: str, double: Path) -> None:
    fit = flinders.fit(world(name), unit="uT")
    answer = firmware.run(firmware.HOST_DOUBLE, double, world(name))["answer"]
    npt.assert_allclose(answer["offset"], fit.calibration.offset, atol=1e-3)
    npt.assert_allclose(answer["heading_worst_deg"], fit.heading_error_deg.worst, rtol=0.02)
    npt.assert_allclose(answer["noise"], fit.evidence.noise, rtol=1e-3)
    assert answer["verdict"] == firmware.verdict_of(fit, answer)


def textbook_of(field: Floats) -> Floats:
    """(9, 9) covariance of independent residuals, widened for few of them, as a board has it."""
    estimate = Likelihood().estimate(Readings.of(field))
    assert estimate.textbook is not None
    return estimate.textbook * engine().widening_by_few(len(field) - 9.0)


def test_a_board_advises_what_the_library_advises(double: Path) -> None:
    fit = flinders.fit(world("tilted"), unit="uT")
    answer = firmware.run(firmware.HOST_DOUBLE, double, world("tilted"))["answer"]
    advice = guide(
        fit.calibration.ellipsoid,
        textbook_of(world("tilted")),
        noise=fit.evidence.noise,
        coverage=fit.evidence.coverage,
        dip_deg=60.0,
    )
    npt.assert_allclose(answer["turn"], advice.direction, atol=1e-9)
    npt.assert_allclose(answer["after_deg"], advice.after_deg, rtol=0.05)


def test_a_long_recording_is_spread_over_directions_and_time(double: Path) -> None:
    tumble = simulate.tumble(seed=5, n=4000).samples.field
    resting = np.repeat(tumble[:1], 3000, axis=0) + np.random.default_rng(1).normal(scale=0.5, size=(3000, 3))
    outcome = firmware.run(firmware.HOST_DOUBLE, double, np.concatenate([resting, tumble]))
    stored = outcome["readings"][: outcome["count"]]
    assert outcome["count"] == firmware.READINGS
    directions, others = (
        (field - outcome["answer"]["offset"]) @ outcome["answer"]["matrix"].T / outcome["answer"]["field"]
        for field in (tumble[::40], stored)
    )
    assert np.rad2deg(np.arccos(np.clip(np.max(directions @ others.T, axis=1), -1, 1))).max() < 25
    assert outcome["answer"]["heading_worst_deg"] < 0.4


POSES: Final = """
#include "flinders_board.h"
#include <stdio.h>
int main(void)
{
    static flinders_board board;
    flinders_real reading[3];
    flinders_board_begin(&board);
    for (long row = 1; scanf("%f %f %f", reading, reading + 1, reading + 2) == 3; row++) {
        flinders_board_add(&board, reading);
        if (row % 25) continue;
        const int status = flinders_board_solve(&board);
        printf("%d %d %g\\n", board.count, status, (double)board.answer.heading_worst_deg);
    }
}
"""


def test_each_pose_is_one_reading_of_a_board_however_often_it_is_fitted(folder: Path, archive: Path) -> None:
    """Thirty poses of a second each, with a fit every half a second."""
    source, rng = folder / "package" / "src", np.random.default_rng(1)
    (folder / "poses.c").write_text(POSES)
    command = [*(system_compiler() or ()), "-I", str(source), str(folder / "poses.c"), str(archive), "-lm"]
    subprocess.run([*command, "-o", str(folder / "poses")], check=True)
    held = (
        np.repeat(50.0 * simulate.uniform_directions(rng, 30), 50, axis=0)
        + 20.0
        + rng.normal(scale=0.3, size=(1500, 3))
    )
    text = "\n".join(" ".join(map(str, row)) for row in held.tolist())
    done = subprocess.run([str(folder / "poses")], input=text, capture_output=True, text=True, check=True)
    count, status, worst = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).T
    assert count[-1] == 30
    assert status[-1] == 0
    assert worst[-1] < 1.0


CHECKED: Final = """
#include "flinders_board.h"
#include <stdio.h>
int main(void)
{
    flinders_real value[FLINDERS_QUANTITIES];
    for (;;) {
        for (int i = 0; i < FLINDERS_QUANTITIES; i++)
            if (scanf("%f", value + i) != 1) return 0;
        for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++) printf("%d ", flinders_severity(i, value));
        printf("\\n");
    }
}
"""


def test_rules_of_the_board_are_those_of_the_library(folder: Path, archive: Path) -> None:
    """Every rule of a fit, at random numbers around its limits."""
    source = folder / "package" / "src"
    (folder / "checked.c").write_text(CHECKED)
    command = [*(system_compiler() or ()), "-I", str(source), str(folder / "checked.c"), str(archive), "-lm"]
    subprocess.run([*command, "-o", str(folder / "checked")], check=True)
    numbers = np.exp(np.random.default_rng(1).normal(0.0, 3.0, size=(500, len(QUANTITIES))).astype(np.float32))
    text = "\n".join(" ".join(f"{number:.9g}" for number in row) for row in numbers)
    done = subprocess.run([str(folder / "checked")], input=text, capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=int)
    expected = [[engine().severity(rule, row) for rule in range(len(ENGINE_FINDINGS))] for row in numbers.astype(float)]
    npt.assert_array_equal(found, expected)
    assert set(found.ravel()) == {0, 1, 2, 3}


def test_what_a_board_cannot_know_is_not_checked(single: Path) -> None:
    answer = firmware.run(firmware.HOST, single, simulate.tumble(seed=1).samples.field)["answer"]
    checked = {code for code, is_checked in zip(ENGINE_FINDINGS, answer["is_checked"], strict=True) if is_checked}
    assert {"heading-error", "coverage", "noise", "outliers", "few-samples", "axis-ratio"} <= checked
    assert not {"field-changed", "axis-swap", "time-gap", "saturated", "at-rest", "skipped-rows"} & checked


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e30, 3e38, math.inf, math.nan])
def test_no_readings_break_it(value: float, single: Path) -> None:
    rng = np.random.default_rng(1)
    with np.errstate(all="ignore"):
        wild = [value * rng.normal(size=(400, 3)), rng.integers(-1, 2, (400, 3)) * value, np.full((400, 3), value)]
        for field in wild:
            answer = firmware.run(firmware.HOST, single, field)["answer"]
            assert answer["status"] != 0 or answer["verdict"] in {1, 2, 3}


@pytest.mark.nightly
def test_memory_is_used_as_it_should_be(folder: Path) -> None:
    """Under the sanitizers, over readings of every kind."""
    target = firmware.Target("sanitized", ("-fsanitize=address,undefined", "-fno-sanitize-recover=all"))
    try:
        program = firmware.build(target, folder, optimise="-O1")
    except subprocess.CalledProcessError as failed:
        if os.environ.get("FLINDERS_SANITIZERS") == "required":
            raise
        pytest.skip(f"no sanitizers: {failed.stderr[-200:]}")
    rng = np.random.default_rng(2)
    level = simulate.tumble(seed=2, motion="level", n=700).samples.field
    wild = rng.normal(size=(600, 3)) * 10.0 ** rng.uniform(-20, 20, size=(600, 1))
    for field in (level, wild, world("outliers"), level[:41], level[:3], np.repeat(level[:50], 9, axis=0)):
        firmware.run(target, program, field)
    service = firmware.build(target, folder, optimise="-O1", harness="service")
    for seed in range(20):
        steps = life(target, seed)
        for rows in steps:
            odd = rng.random(len(rows)) < 0.02
            rows["field"][odd] = wild[: odd.sum()]
            rows["ms"][odd] = rng.integers(0, 2**32, odd.sum())
        eeprom = np.frombuffer(rng.bytes(2 * firmware.STORED.itemsize), firmware.STORED)
        firmware.go_on(target, service, [*steps, asked(target, "power", 10**9), asked(target, "sleep", 10**9)], eeprom)


# a calibration that goes on


CONTRADICTED, MOVED, ADOPTED, CLOCK_BACK = 2, 8, 16, 32
STEP: Final = np.array([3.0, -4.0, 0.0])


@pytest.fixture(scope="module")
def going_on(single: Path) -> Path:
    return firmware.build(firmware.HOST, single.parent, optimise="-O0", harness="service")


@pytest.fixture(scope="module")
def going_on_in_double(double: Path) -> Path:
    return firmware.build(firmware.HOST_DOUBLE, double.parent, optimise="-O0", harness="service")


def turned(target: firmware.Target, seed: int, begin_s: float, seconds: int, offset: Floats | float = 0.0) -> Rows:
    """A hand turns the sensor of `simulate.tumble(seed=1)`, which is read ten times a second."""
    sensor = simulate.tumble(seed=1).sensor
    field = simulate.tumble(seed=seed, n=10 * seconds, sensor=sensor).samples.field + offset
    clock = 1000 * begin_s + 100 * np.arange(len(field))
    return firmware.steps_of(target, "reading", ms=clock % 2**32, clock_s=clock // 1000, field=field)


def asked(target: firmware.Target, what: str, time_s: float) -> Rows:
    return firmware.steps_of(target, what, ms=round(1000 * time_s) % 2**32, clock_s=int(time_s))


def life(target: firmware.Target, seed: int, begin_s: float = 0.0) -> list[Rows]:
    """Calibrated in 30 s, used for two minutes, moved by 5 µT while it lay in a drawer, and used again."""
    return [
        turned(target, seed, begin_s, 30),
        asked(target, "begin", begin_s + 30),
        turned(target, seed + 1, begin_s + 30, 120),
        asked(target, "ask", begin_s + 150),
        turned(target, seed + 2, begin_s + 400, 90, STEP),
        asked(target, "ask", begin_s + 490),
    ]


def off_ut(rows: Rows, offset: Floats | float = 0.0) -> float:
    """How far the offset in force at the end is off the truth."""
    truth = simulate.tumble(seed=1).sensor.offset + offset
    return float(np.linalg.norm(rows["answer"]["in_force"]["offset"][-1] - truth))


@pytest.mark.parametrize("seed", daily([1, 5, 9]))
def test_a_board_learns_and_holds_and_a_step_is_found_and_learnt_again(seed: int, going_on: Path) -> None:
    steps = life(firmware.HOST, seed)
    begun, *_, held = (rows := firmware.go_on(firmware.HOST, going_on, steps[:4])[0])
    assert held["answer"]["in_force"]["heading_worst_deg"] < 0.7 * begun["answer"]["in_force"]["heading_worst_deg"]
    assert off_ut(rows) < 0.3
    assert held["answer"]["in_force"]["verdict"] == 1
    assert held["answer"]["good_s"] > 600
    assert np.isnan(held["answer"]["moved_s"])
    rows = firmware.go_on(firmware.HOST, going_on, steps)[0]
    disturbed = rows[(rows["events"] == CONTRADICTED) & (rows["ms"] > 400_000)][0]
    moved = rows[rows["events"] == MOVED | ADOPTED][-1]
    assert disturbed["ms"] < 420_000
    assert disturbed["answer"]["is_disturbed"]
    assert disturbed["answer"]["in_force"]["verdict"] > 1
    assert rows[-1]["answer"]["moved_by"] == pytest.approx(5.0, abs=0.4)
    assert rows[-1]["answer"]["moved_s"] == pytest.approx(490.0 - moved["ms"] / 1000.0, abs=0.01)
    assert off_ut(rows, STEP) < 0.4


@pytest.mark.parametrize("seed", daily([1, 5, 9]))
def test_going_on_in_single_precision_is_as_good_as_in_double(
    seed: int, going_on: Path, going_on_in_double: Path
) -> None:
    """The same events at the same readings, offsets within 0.01 µT and claims within 1 %."""
    single = firmware.go_on(firmware.HOST, going_on, life(firmware.HOST, seed))[0]
    double = firmware.go_on(firmware.HOST_DOUBLE, going_on_in_double, life(firmware.HOST_DOUBLE, seed))[0]
    alike_answers(single, double, ut=0.01, share=0.01)


def alike_answers(one: Rows, other: Rows, *, ut: float, share: float) -> None:
    npt.assert_array_equal(one["ms"], other["ms"])
    npt.assert_array_equal(one["events"], other["events"])
    first, second = one["answer"]["in_force"], other["answer"]["in_force"]
    npt.assert_allclose(first["offset"], second["offset"], atol=ut)
    npt.assert_allclose(first["heading_worst_deg"], second["heading_worst_deg"], rtol=share)


def test_a_board_that_goes_on_claims_about_what_the_library_claims(going_on_in_double: Path) -> None:
    """It has 96 readings of evidence and a factor for slow noise, the library 768 and a model."""
    steps = life(firmware.HOST_DOUBLE, 9)[:4]
    answer = firmware.go_on(firmware.HOST_DOUBLE, going_on_in_double, steps)[0]["answer"]["in_force"][-1]
    online = flinders.OnlineCalibration(flinders.fit(steps[0]["field"], unit="uT"), at=30.0)
    online.add(steps[2]["field"], time=steps[2]["ms"] / 1000.0)
    assert online.calibration is not None
    npt.assert_allclose(answer["offset"], online.calibration.offset, atol=0.1)
    assert 0.5 < answer["heading_worst_deg"] / online.state.heading_error_deg < 2.0


def test_the_clock_of_a_board_may_begin_anywhere(going_on: Path) -> None:
    """Milliseconds of a board begin again at 0 after seven weeks, and single precision has seven digits."""
    first = firmware.go_on(firmware.HOST, going_on, life(firmware.HOST, 1))[0]
    for begin_s in (2**22 - 1, 2**32 / 1000 - 100):
        rows = firmware.go_on(firmware.HOST, going_on, life(firmware.HOST, 1, begin_s))[0]
        npt.assert_array_equal(rows["events"], first["events"])
        worst, expected = (one["answer"]["in_force"]["heading_worst_deg"] for one in (rows, first))
        npt.assert_allclose(worst, expected, rtol=1e-3)


def test_readings_of_a_clock_that_went_back_are_left_out(going_on: Path) -> None:
    steps = life(firmware.HOST, 1)[:2]
    back = firmware.steps_of(firmware.HOST, "reading", ms=[31_000, 30_500, 29_000], field=np.full((3, 3), [40, 20, 10]))
    rows, _ = firmware.go_on(firmware.HOST, going_on, [*steps, back, asked(firmware.HOST, "ask", 32)])
    assert [int(row["events"]) for row in rows] == [0, CLOCK_BACK, CLOCK_BACK, 0]


@pytest.fixture(scope="module")
def stored(going_on: Path) -> Rows:
    """The two places of the EEPROM of a board that was used for two minutes."""
    eeprom: Rows = firmware.go_on(firmware.HOST, going_on, life(firmware.HOST, 1)[:4])[1]["eeprom"]
    return eeprom


def test_time_without_power_widens_the_claim(going_on: Path, stored: Rows) -> None:
    """By a clock that goes on; without one it is taken for a day."""
    newest = stored[np.argmax(stored["sequence"])]
    hours = [0.0, 1.0, 10.0, 24.0, 240.0]
    now = [int(newest["clock_s"] + 3600 * hour) for hour in hours]
    boots = [firmware.steps_of(firmware.HOST, "power", clock_s=clock_s) for clock_s in [*now, 0, 1]]
    rows = firmware.go_on(firmware.HOST, going_on, boots, stored)[0]
    worst = rows["answer"]["in_force"]["heading_worst_deg"]
    assert worst[0] == pytest.approx(newest["worst_deg"], rel=0.1)
    assert list(worst[:5]) == sorted(worst[:5])
    assert worst[4] > 3 * worst[2]
    npt.assert_array_equal(worst[5:], worst[3])  # no clock now, or one that went back
    npt.assert_allclose(rows["answer"]["learnt_s"][1] - rows["answer"]["learnt_s"][0], 3600.0, atol=0.1)
    npt.assert_allclose(rows["answer"]["in_force"]["offset"], np.tile(newest["in_force"][:3], (7, 1)))


def test_a_board_goes_on_with_what_it_stored(going_on: Path, stored: Rows) -> None:
    newest = stored[np.argmax(stored["sequence"])]
    begin_s = int(newest["clock_s"]) + 8 * 3600
    steps = [asked(firmware.HOST, "power", begin_s), turned(firmware.HOST, 4, begin_s, 60)]
    rows, cost = firmware.go_on(firmware.HOST, going_on, [*steps, asked(firmware.HOST, "ask", begin_s + 60)], stored)
    assert rows["answer"]["in_force"]["heading_worst_deg"][0] > 1.0
    assert rows["answer"]["in_force"]["heading_worst_deg"][-1] < 0.8
    assert off_ut(rows) < 0.3
    assert sorted(cost["eeprom"]["sequence"]) == [1, 2]  # what was restored had become worse than that


def test_it_is_stored_seldom(going_on: Path) -> None:
    """At first, after an hour and after another, and within some minutes where it has moved."""
    day = [turned(firmware.HOST, 20 + place, 30 + 600 * place, 20) for place in range(12)]
    moved = [turned(firmware.HOST, 40 + place, 7300 + 400 * place, 60, STEP) for place in range(3)]
    steps = [
        *life(firmware.HOST, 1)[:2],
        *day,
        asked(firmware.HOST, "ask", 7290),
        *moved,
        asked(firmware.HOST, "ask", 8200),
    ]
    rows, cost = firmware.go_on(firmware.HOST, going_on, steps)
    assert MOVED | ADOPTED in rows["events"]
    before, after = (int(rows[rows["what"] == firmware.STEPS.index("ask")][place]["stores"]) for place in (0, 1))
    assert 1 <= before <= 3
    assert before < after <= before + 2
    newest = cost["eeprom"][np.argmax(cost["eeprom"]["sequence"])]
    assert newest["sequence"] == after
    npt.assert_allclose(newest["in_force"][:3], rows[-1]["answer"]["in_force"]["offset"], atol=0.3)


CUT: Final = """
#include "flinders_service.h"
#include <stdio.h>
#include <string.h>
int main(void)
{
    static flinders_service service;
    flinders_stored places[2], next;
    fread(places, sizeof *places, 2, stdin);
    flinders_service_clear(&service);
    for (int place = 0; place < 2; place++) flinders_service_restore(&service, places + place, 0, 0);
    const uint32_t before = service.sequence;
    const int into = flinders_service_store(&service, 0, &next);
    const flinders_stored older = places[into];
    for (size_t written = 0; written <= sizeof next; written++) {
        places[into] = older;
        memcpy(places + into, &next, written);
        flinders_service_clear(&service);
        for (int place = 0; place < 2; place++) flinders_service_restore(&service, places + place, 0, 0);
        printf("%d", (int)(service.sequence - before));
    }
    printf(" %d %d %d\\n", (int)before, (int)sizeof next, into);
}
"""


def test_a_power_cut_at_any_byte_of_a_write_loses_nothing(folder: Path, archive: Path, stored: Rows) -> None:
    """What is restored is the record before, or the new one as a whole."""
    (folder / "cut.c").write_text(CUT)
    include = str(folder / "package" / "src")
    command = [*(system_compiler() or ()), "-I", include, str(folder / "cut.c"), str(archive), "-lm"]
    subprocess.run([*command, "-o", str(folder / "cut")], check=True)
    both = stored.copy()
    both[0], both[0]["sequence"] = both[1], 2
    both[0]["checksum"] = zlib.crc32(both[0].tobytes()[:-4])
    for eeprom, before in ((stored, 1), (both, 2)):
        done = subprocess.run([str(folder / "cut")], input=eeprom.tobytes(), capture_output=True, check=True)
        found, *numbers = done.stdout.decode().split()
        size = firmware.STORED.itemsize
        assert [int(number) for number in numbers] == [before, size, (before + 1) % 2]
        assert len(found) == size + 1
        assert found.rstrip("1") + "1" * (len(found) - len(found.rstrip("1"))) == found
        assert found.startswith("0" * (size - 4))
        assert found.endswith("1")


# the package


def test_the_package_says_what_it_is(tmp_path: Path) -> None:
    files = package.write(tmp_path / "new" / "library")
    manifest = json.loads((tmp_path / "new" / "library" / "library.json").read_text())
    assert manifest["version"] == flinders.__version__
    assert f"version={flinders.__version__}\n" in (tmp_path / "new" / "library" / "library.properties").read_text()
    assert (tmp_path / "new" / "library" / "LICENSE").read_text().startswith("BSD 3-Clause License")
    assert all(path.is_file() for path in files)


def test_a_package_that_is_there_is_not_replaced(tmp_path: Path) -> None:
    package.write(tmp_path)
    with pytest.raises(OutputExists):
        package.write(tmp_path)
    package.write(tmp_path, force=True)
    with assert_raises(OutputError):
        package.write(tmp_path / "LICENSE" / "library")


def test_the_command_writes_it(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["firmware", "--output", str(tmp_path / "library"), "--json"])
    assert done.exit_code == 0
    assert {Path(name).suffix for name in json.loads(done.stdout)["files"]} >= {".c", ".h", ".ino", ".json"}


# the example


class Sketch:
    """The example as a byte source: what it prints, and what is sent to it."""

    name, is_framed = "sketch", False

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self.process, self.printed = process, b""
        self._into, self._out = process.stdin, process.stdout

    def read(self, timeout: float) -> bytes:
        if not select.select([self._out], [], [], timeout)[0]:
            return b""
        content = os.read(self._out.fileno(), 65536)
        self.printed += content
        return content

    def write(self, content: bytes) -> None:
        self._into.write(content)
        self._into.flush()

    def reopen(self) -> None:
        raise AssertionError("it never went away")

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._into.close()
        self._out.close()


@pytest.fixture(scope="module")
def example(folder: Path, archive: Path) -> Path:
    """The sketch that calibrates."""
    return compile_sketch(folder, archive, "LIS3MDL")


def compile_sketch(folder: Path, archive: Path, name: str) -> Path:
    """A sketch with the library, compiled as C++ over `tests/arduino`."""
    compiler = next((name for name in ("g++", "clang++") if shutil.which(name)), None)
    if compiler is None:
        pytest.skip("no C++ compiler for the example")
    source = folder / "package"
    sketch = source / "examples" / name / f"{name}.ino"
    command = [compiler, "-std=c++11", "-Wall", "-Wextra", "-Werror", "-I", str(SHIMS), "-I", str(source / "src")]
    command += ["-include", "Arduino.h", "-x", "c++", str(sketch), "-x", "none", str(archive), "-lm"]
    subprocess.run([*command, "-o", str(folder / name)], check=True)
    return folder / name


@pytest.fixture(scope="module")
def in_service(folder: Path, archive: Path) -> Path:
    """The sketch whose calibration goes on."""
    return compile_sketch(folder, archive, "InService")


@contextmanager
def running(example: Path, place: Path, field: Floats) -> Iterator[Sketch]:
    np.savetxt(place / "readings.txt", np.round(field * 68.42), fmt="%d")
    process = subprocess.Popen([str(example)], cwd=place, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    sketch = Sketch(process)
    try:
        yield sketch
    finally:
        sketch.close()


def printed_until(sketch: Sketch, words: bytes) -> str:
    for _ in itertools.count():
        if words in sketch.printed:
            break
        assert sketch.read(10.0), sketch.printed[-500:]
    return sketch.printed.decode()


def test_what_the_example_prints_is_read_and_a_good_calibration_is_stored(example: Path, tmp_path: Path) -> None:
    simulated = simulate.tumble(seed=6, n=2000)
    with running(example, tmp_path, simulated.samples.field) as sketch:
        text = printed_until(sketch, b", good\r\n")
    (tmp_path / "print.txt").write_text(text[: text.index(", good\r\n")].rpartition("\n")[0])
    samples = flinders.read(tmp_path / "print.txt")
    npt.assert_allclose(samples.field, simulated.samples.field[: len(samples)], atol=0.02)
    assert samples.unit.inside == "uT"
    stored = MotionCalPacket.decode((tmp_path / "eeprom.bin").read_bytes())
    npt.assert_allclose(stored.offset, flinders.fit(samples).calibration.offset, atol=0.5)


def test_the_example_takes_what_flinders_sends_and_keeps_it(example: Path, tmp_path: Path) -> None:
    packet = MotionCalPacket(np.array([12.5, -30.25, 7.0]), 50.0, np.diag([1.25, 1.0, 0.8]))
    with running(example, tmp_path, world("short")) as sketch:
        assert motioncal.send(sketch, packet).tries == 1
    assert (tmp_path / "eeprom.bin").read_bytes() == packet.encode()
    with running(example, tmp_path, world("short")) as sketch:
        printed_until(sketch, "\r\n".join(motioncal.echo_lines(packet)).encode())


def test_the_example_in_service_stores_and_goes_on_after_a_power_cut(in_service: Path, tmp_path: Path) -> None:
    field = simulate.tumble(seed=6, n=2000).samples.field
    with running(in_service, tmp_path, field) as sketch:
        printed_until(sketch, b"Stored\r\nHeading error now (degrees): ")
    content = (tmp_path / "eeprom.bin").read_bytes().ljust(2 * firmware.STORED.itemsize, b"\xff")
    stored = np.frombuffer(content, firmware.STORED)[1]
    assert stored["sequence"] == 1
    npt.assert_allclose(stored["in_force"][:3], simulate.tumble(seed=6).sensor.offset, atol=0.5)
    with running(in_service, tmp_path, field) as sketch:
        text = printed_until(sketch, b", good for another (s): 0\r\n")  # a day without power, and no clock
    assert "Heading error to expect" not in text


# boards


@pytest.mark.tools
@pytest.mark.skipif(bool(firmware.missing_tools()), reason=f"{firmware.missing_tools()} not installed")
class TestBoards:
    """Cortex-M, compiled with warnings as errors and run in QEMU."""

    @pytest.mark.parametrize(
        "target",
        [firmware.M4, *(pytest.param(target, marks=pytest.mark.nightly) for target in (firmware.M0, firmware.M7))],
        ids=lambda target: target.name,
    )
    def test_every_processor_gives_the_numbers_of_this_machine(
        self, target: firmware.Target, folder: Path, single: Path
    ) -> None:
        program, field = firmware.build(target, folder), world("outliers")
        outcome, here = firmware.run(target, program, field), firmware.run(firmware.HOST, single, field)
        npt.assert_allclose(outcome["answer"]["offset"], here["answer"]["offset"], atol=1e-3)
        npt.assert_array_equal(outcome["answer"]["findings"], here["answer"]["findings"])
        assert outcome["state"] <= 8 * 1024
        assert outcome["stack"] <= 10 * 1024
        if target == firmware.M4:
            assert firmware.sizes(program)["flash"] <= 64 * 1024
            assert outcome["per_solve"] <= 12_000_000

    def test_a_cortex_m4_goes_on_in_10_kb_of_ram(self, folder: Path, going_on: Path, stored: Rows) -> None:
        """A program without the calibrator, which begins with its EEPROM, and the same readings on this machine."""
        program = firmware.build(firmware.M4, folder, harness="service", options=firmware.IN_SERVICE)
        sizes = firmware.sizes(program)
        assert sizes["flash"] <= 62 * 1024
        steps = [
            [
                asked(target, "power", 3600),
                *life(target, 1, 3600)[2:],
                asked(target, "sleep", 3600),
                asked(target, "ask", 4090),
            ]
            for target in (firmware.M4, firmware.HOST)
        ]
        board, cost = firmware.go_on(firmware.M4, program, steps[0], stored)
        here, _ = firmware.go_on(firmware.HOST, going_on, steps[1], stored)
        alike_answers(board, here, ut=0.01, share=0.01)
        assert MOVED | ADOPTED in board["events"]
        assert cost["stack"] + sizes["ram"] < firmware.RAM_IN_SERVICE  # which it was linked for
        assert cost["most"] <= 12_000_000

    def test_calibrator_and_going_on_together_fit_into_84_kb_of_flash(self, folder: Path) -> None:
        program = firmware.build(firmware.M4, folder, harness="service")
        assert firmware.sizes(program)["flash"] <= 84 * 1024
