"""`flinders send --mavlink`: over UDP to a vehicle made of pymavlink that answers well, late, wrongly, or not."""

from __future__ import annotations

import json
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly
from tests.vehicles.test_mountings import anyhow, right_angles
from tests.waiting import PATIENCE_S, wait_until

from flinders.apps.vehicles import mavlink
from flinders.apps.vehicles.mavlink import Vehicle
from flinders.apps.vehicles.mavlink_parameters import ParameterPlan
from flinders.apps.vehicles.sending import parameter_plan
from flinders.apps.vehicles.targets import ardupilot, px4
from flinders.apps.vehicles.targets.autopilot import parse
from flinders.cli import main
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import ProvenanceRecord, SourceFile, write
from flinders.core.units import Unit
from flinders.errors import LinkError, NotConfirmed, NotExportable, NotSent, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.links.transports import Udp
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from collections.abc import Iterator

    from click.testing import Result

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

dialect = pytest.importorskip("pymavlink.dialects.v20.common")

DEVICE = 396809
MATRIX = [[1.1034567, 0.0512345, -0.0234567], [0.0512345, 0.9123456, 0.0312345], [-0.0234567, 0.0312345, 1.0234567]]


def found(**more: Any) -> Calibration:
    return Calibration(np.array(MATRIX), np.array([12.3456789, -30.98765, 7.000432]), 49.1, raw=Unit.of("uT"), **more)


class Autopilot:
    """A vehicle: sends heartbeats to a port, answers questions about its parameters, takes new values.

    `ignores` are parameters it keeps as they are; `answers_wrongly` it takes and reports as another value;
    `late` seconds pass before it answers; `falls_silent` after so many settings, for `away` seconds; `arms` after so
    many; `loses` a share of all packets, each way; `whole` are parameters that it says are whole numbers; `rounds` to
    so many decimals; `crowded` are components that have something to say on the same system; `mounted` are the
    parameters that say how its compasses are mounted.
    """

    def __init__(
        self,
        port: int,
        *,
        kind: int = mavlink.ARDUPILOT,
        device: int = DEVICE,
        system: int = 1,
        armed: bool = False,
        ignores: tuple[str, ...] = (),
        answers_wrongly: tuple[str, ...] = (),
        late: float = 0.0,
        falls_silent: int = 99,
        arms: int = 99,
        scheme: int = 0,
        old: bool = False,
        drops: int = 0,
        away: float = 1e9,
        loses: float = 0.0,
        whole: tuple[str, ...] = (),
        rounds: int | None = None,
        crowded: tuple[int, ...] = (),
        mounted: dict[str, float] | None = None,
    ) -> None:
        self.kind, self.armed, self.ignores, self.answers_wrongly = kind, armed, ignores, answers_wrongly
        self.away, self.whole, self.rounds, self.crowded = away, whole, rounds, crowded
        self.loses, self._luck = loses, np.random.default_rng(0)
        self.late, self.falls_silent, self.arms, self.old, self.drops = late, falls_silent, arms, old, drops
        self.values = px4_values(device) if kind == mavlink.PX4 else ardupilot_values(device, scheme)
        self.values |= mounted or {}
        self.before = dict(self.values)
        self.sets: list[tuple[str, float]] = []
        self._due: list[tuple[float, str]] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._link = dialect.MAVLink(self, srcSystem=system, srcComponent=1)
        self._link.robust_parsing = True
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def write(self, content: bytes) -> None:
        if self._luck.random() >= self.loses:
            with suppress(ConnectionError):
                self._socket.send(content)

    def _live(self) -> None:
        beaten = 0.0
        while not self._ended.is_set():
            if len(self.sets) >= self.falls_silent:
                self._sleep()
                continue
            if time.monotonic() - beaten > 0.05:
                beaten = time.monotonic()
                mode = 81 | (mavlink.ARMED if self.armed or len(self.sets) >= self.arms else 0)
                self._crowd()
                self._send(dialect.MAVLink_heartbeat_message(2, self.kind, mode, 0, 3, 3))
                self._send(dialect.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0))
            while self._due and self._due[0][0] <= time.monotonic():
                self._report(self._due.pop(0)[1])
            if select.select([self._socket], [], [], 0.002)[0]:
                try:
                    content = self._socket.recv(65535)
                except ConnectionError:
                    continue
                for message in self._link.parse_buffer(content) or []:
                    self._answer(message)

    def _sleep(self) -> None:
        """Hear nothing for a while."""
        until = time.monotonic() + self.away
        while time.monotonic() < until and not self._ended.is_set():
            time.sleep(0.02)
        self.falls_silent = 99
        while select.select([self._socket], [], [], 0.0)[0]:
            self._socket.recv(65535)

    def _crowd(self) -> None:
        """Heartbeats of others on the same system, and answers that nobody asked them for."""
        for component in self.crowded:
            other = dialect.MAVLink(self, srcSystem=self._link.srcSystem, srcComponent=component)
            kind = mavlink.NO_AUTOPILOT if component > 150 else 0
            other.send(dialect.MAVLink_heartbeat_message(18, kind, 81 | mavlink.ARMED, 0, 3, 3))
            for name in self.values:
                other.send(dialect.MAVLink_param_value_message(name.encode(), 77.0, mavlink.REAL32, 1, 0))

    def _send(self, message: Any) -> None:  # noqa: ANN401
        self._link.send(message, force_mavlink1=self.old)

    def _answer(self, message: Any) -> None:  # noqa: ANN401
        kind = message.get_type()
        if kind not in ("PARAM_REQUEST_READ", "PARAM_SET") or self._luck.random() < self.loses:
            return
        if self.drops:
            self.drops -= 1
            return
        name = message.param_id
        if name not in self.values:
            return
        if kind == "PARAM_SET":
            value = message.param_value
            if name.endswith("_ROT"):
                value = float(struct.unpack("<i", struct.pack("<f", value))[0])
            self.sets.append((name, value))
            if name not in self.ignores:
                held = np.float32(value).item()
                self.values[name] = held if self.rounds is None else round(held, self.rounds)
        self._due.append((time.monotonic() + self.late, name))

    def _report(self, name: str) -> None:
        value, kind = self.values[name], mavlink.REAL32
        if name.endswith("_ID") or "DEV_ID" in name:
            kind = 6
        if name.endswith("_ROT") or "ORIENT" in name or name == "CUST_ROT_ENABLE":
            kind = 6 if self.kind == mavlink.PX4 else 2
        if kind == 6 and self.kind == mavlink.PX4:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        if name in self.whole:
            kind = 4
        if name in self.answers_wrongly and self.sets:
            value += 0.25
        self._send(dialect.MAVLink_param_value_message(name.encode(), value, kind, len(self.values), 0))

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


def ardupilot_values(device: int, scheme: int = 0) -> dict[str, float]:
    values: dict[str, float] = {}
    for compass in (1, 2, 3):
        for group, default in (("OFS", 3.0), ("DIA", 1.0), ("ODI", 0.0)):
            for axis in ("_X", "_Y", "_Z"):
                values[ardupilot.names(group, compass, axis)[scheme]] = default
        values[ardupilot.names("SCALE", compass)[scheme]] = 1.0
        values[ardupilot.names("DEV_ID", compass)[scheme]] = device + compass - 1 if compass < 3 else 0
    return values


def px4_values(device: int) -> dict[str, float]:
    values: dict[str, float] = {}
    for slot in range(3):
        for axis in "XYZ":
            values |= {f"CAL_MAG{slot}_{axis}OFF": 0.1, f"CAL_MAG{slot}_{axis}SCALE": 1.0}
            values |= {f"CAL_MAG{slot}_{axis}ODIAG": 0.0}
        values[f"CAL_MAG{slot}_ID"] = device + slot
    return values


@contextmanager
def vehicle(*, answer: float = 0.25, **more: Any) -> Iterator[tuple[Autopilot, Vehicle]]:
    source = Udp(0, "127.0.0.1")
    autopilot = Autopilot(source.port, **more)
    try:
        yield autopilot, Vehicle.find(source, listen=0.15, answer=answer, silent=0.6)
    finally:
        autopilot.stop()
        source.close()


def test_ardupilot_holds_every_value_and_no_other_changed() -> None:
    with vehicle() as (autopilot, seen):
        assert seen.name == "ArduPilot, system 1"
        plan = ParameterPlan.of(seen, found(), compass=2, device_id=DEVICE + 1)
        assert autopilot.sets == []
        plan.carry_out()
    held = ardupilot.ArduPilotParameters.read(autopilot.values, 2)
    wanted = ardupilot.ArduPilotParameters.of(found(), compass=2).as_float32()
    np.testing.assert_array_equal(held.matrix, wanted.matrix)
    np.testing.assert_array_equal(held.offset, wanted.offset)
    changed = {name for name, value in autopilot.values.items() if value != autopilot.before[name]}
    assert changed == {change.new.name for change in plan.pending}
    assert all("2" in name for name in changed)


def test_px4_device_ids_travel_byte_by_byte() -> None:
    with vehicle(kind=mavlink.PX4) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(sensor=f"sensor_mag 1 (device {DEVICE + 1})"))
        assert (plan.compass, plan.device_id) == (1, DEVICE + 1)  # looked up by the id that the calibration names
        plan.carry_out()
    held = px4.Px4Parameters.read(autopilot.values, 1)
    wanted = px4.Px4Parameters.of(found(), compass=1).as_float32()
    np.testing.assert_array_equal(held.matrix, wanted.matrix)
    np.testing.assert_array_equal(held.offset, wanted.offset)
    assert plan.backup().splitlines()[1] == f"1\t1\tCAL_MAG1_XOFF\t{np.float32(0.1):.9g}\t9"


def test_a_plan_is_for_the_compass_whose_log_the_fit_was_made_from() -> None:
    file = SourceFile(
        name="log.bin", sha256="0" * 64, bytes=1, rows=1, autopilot="ardupilot", compass=2, device_id=DEVICE + 1
    )

    def made_from(*files: SourceFile) -> Fit:
        record = ProvenanceRecord(flinders="1", date=datetime(2026, 3, 1, tzinfo=UTC), files=files)
        return fit_from(found(frame="vehicle").to_document(provenance=record))

    both = made_from(file, msgspec.structs.replace(file, compass=1, device_id=DEVICE))
    with vehicle() as (_, seen):
        plan = parameter_plan(seen, made_from(file))
        assert (plan.compass, plan.device_id) == (2, DEVICE + 1)
        with assert_raises(UsageError):
            parameter_plan(seen, both)
        assert parameter_plan(seen, both, device_id=DEVICE).compass == 1


def test_the_other_scheme_of_names_and_mavlink_1_work() -> None:
    with vehicle(scheme=1, old=True) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1, device_id=DEVICE)
        plan.carry_out()
    assert autopilot.values["COMPASS1_OFS_X"] == np.float32(-123.456789)


def test_an_armed_vehicle_is_refused_before_anything_is_asked() -> None:
    with vehicle(armed=True) as (autopilot, seen), assert_raises(NotSent):
        ParameterPlan.of(seen, found(), compass=1)
    assert autopilot.sets == []


def test_another_compass_is_refused() -> None:
    with vehicle() as (autopilot, seen):
        with assert_raises(NotSent) as caught:
            ParameterPlan.of(seen, found(), compass=1, device_id=42)
        assert f"device id {DEVICE}" in str(caught.value)
        with assert_raises(NotSent):
            ParameterPlan.of(seen, found(), device_id=42)
        with assert_raises(NotSent):
            ParameterPlan.of(seen, found(), compass=3)
        with assert_raises(UsageError):
            ParameterPlan.of(seen, found(), compass=0)
        assert_sentences(ParameterPlan.of(seen, found()).notes[-1])
    assert autopilot.sets == []


def test_a_value_that_is_not_taken_brings_all_the_old_ones_back() -> None:
    with vehicle(ignores=("COMPASS_ODI_Y",)) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        with assert_raises(NotConfirmed):
            plan.carry_out()
    assert autopilot.values == autopilot.before
    assert len(autopilot.sets) > 8  # it had been under way


def test_where_the_old_values_cannot_be_put_back_their_names_are_told() -> None:
    with vehicle(answers_wrongly=("COMPASS_OFS_Y",)) as (_, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        with assert_raises(NotConfirmed):
            plan.carry_out()


def test_a_vehicle_that_is_armed_on_the_way_gets_its_old_values_back() -> None:
    with vehicle(arms=2) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)

        def slow() -> bool:
            time.sleep(0.12)
            return False

        with assert_raises(NotConfirmed):
            plan.carry_out(stopped=slow)
    assert autopilot.values == autopilot.before


def test_a_link_that_is_lost_on_the_way_says_what_is_not_known() -> None:
    with vehicle(falls_silent=3) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        said: list[str] = []
        with assert_raises(NotConfirmed):
            plan.carry_out(say=said.append, back=0.3)
    assert len(autopilot.sets) == 3
    assert_sentences(said)


def test_a_vehicle_that_comes_back_in_time_gets_its_old_values() -> None:
    with vehicle(falls_silent=3, away=1.2) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        with assert_raises(NotConfirmed):
            plan.carry_out(back=5.0)
    assert autopilot.values == autopilot.before


def test_three_of_ten_packets_lost_each_way_are_sent_again() -> None:
    with vehicle(loses=0.3, answer=0.05) as (autopilot, seen):
        ParameterPlan.of(seen, found(), compass=2, device_id=DEVICE + 1).carry_out()
    held = ardupilot.ArduPilotParameters.read(autopilot.values, 2)
    np.testing.assert_array_equal(held.offset, ardupilot.ArduPilotParameters.of(found(), compass=2).as_float32().offset)


def test_a_vehicle_that_rounds_is_left_as_it_was_and_what_it_says_is_told() -> None:
    with vehicle(rounds=2) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        with assert_raises(NotConfirmed):
            plan.carry_out()
    assert autopilot.values == autopilot.before


@pytest.mark.parametrize("kind", [mavlink.ARDUPILOT, mavlink.PX4])
def test_a_parameter_that_is_a_whole_number_is_not_set(kind: int) -> None:
    name = "CAL_MAG0_YOFF" if kind == mavlink.PX4 else "COMPASS_OFS_Y"
    with vehicle(kind=kind, whole=(name,)) as (autopilot, seen):
        with assert_raises(NotSent) as caught:
            ParameterPlan.of(seen, found())
        assert f"keeps {name}" in str(caught.value)
        assert autopilot.sets == []


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_device_id_that_is_no_number_is_no_compass(value: float) -> None:
    with vehicle() as (autopilot, seen):
        autopilot.values["COMPASS_DEV_ID"] = value
        with assert_raises(NotSent):
            ParameterPlan.of(seen, found(), compass=1)


def test_an_old_value_that_is_no_number_is_kept_and_put_back() -> None:
    with vehicle(ignores=("COMPASS_SCALE",)) as (autopilot, seen):
        autopilot.values["COMPASS_OFS_X"] = np.nan
        plan = ParameterPlan.of(seen, found(), compass=1)
        assert "COMPASS_OFS_X,nan\n" in plan.backup()
        with assert_raises(NotConfirmed):
            plan.carry_out()
        assert np.isnan(autopilot.values["COMPASS_OFS_X"])


def test_px4_device_ids_beyond_the_sign_are_the_same_compass() -> None:
    with vehicle(kind=mavlink.PX4, device=-5) as (_, seen):
        assert ParameterPlan.of(seen, found(), compass=0, device_id=2**32 - 5).device_id == 2**32 - 5


def test_other_components_of_the_vehicle_have_no_say() -> None:
    """A companion computer and a gimbal on the same system: armed, and with parameters of the same names."""
    with vehicle(crowded=(100, 191)) as (autopilot, seen):
        assert (seen.component, seen.autopilot, seen.armed) == (1, mavlink.ARDUPILOT, False)
        plan = ParameterPlan.of(seen, found(), compass=1)
        assert {change.old.value for change in plan.changes} == {0.0, 1.0, 3.0}
        plan.carry_out()
    assert autopilot.values["COMPASS_OFS_X"] == np.float32(-123.456789)
    source = Udp(0, "127.0.0.1")
    autopilot = Autopilot(source.port, crowded=(100,))
    try:
        assert Vehicle.find(source, system=1).component == 1
    finally:
        autopilot.stop()
        source.close()


def test_stopping_puts_the_old_values_back() -> None:
    with vehicle() as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        with assert_raises(NotConfirmed):
            plan.carry_out(stopped=lambda: len(autopilot.sets) >= 4)
    assert autopilot.values == autopilot.before


def test_late_and_lost_answers_are_waited_for() -> None:
    with vehicle(late=0.05, drops=2) as (autopilot, seen):
        ParameterPlan.of(seen, found(), compass=1).carry_out()
    assert autopilot.values["COMPASS_OFS_X"] == np.float32(-123.456789)


def test_a_late_answer_to_an_earlier_question_does_no_harm() -> None:
    with vehicle(answer=0.08) as (autopilot, seen):
        plan = ParameterPlan.of(seen, found(), compass=1)
        autopilot.late = 0.1  # longer than a first try: many answers are to the try before
        plan.carry_out()
        assert autopilot.values["COMPASS_DIA_Z"] == np.float32(dict(plan_values(plan))["COMPASS_DIA_Z"])


def plan_values(plan: ParameterPlan) -> Iterator[tuple[str, float]]:
    return ((change.new.name, change.new.value) for change in plan.changes)


def test_nobody_and_several_are_told_apart() -> None:
    source = Udp(0, "127.0.0.1")
    with assert_raises(LinkError):
        Vehicle.find(source, wait=0.1)
    one, two = Autopilot(source.port), Autopilot(source.port, system=7)
    try:
        with assert_raises(UsageError):
            Vehicle.find(source, listen=0.3)
        assert Vehicle.find(source, system=7).system == 7
        with assert_raises(LinkError):
            Vehicle.find(source, system=9, wait=0.3)
    finally:
        one.stop()
        two.stop()
        source.close()


def test_another_autopilot_is_refused() -> None:
    source = Udp(0, "127.0.0.1")
    other = Autopilot(source.port, kind=4)
    try:
        with assert_raises(NotSent):
            Vehicle.find(source, listen=0.1)
    finally:
        other.stop()
        source.close()


# the command


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found().save("cal.json")


def send(*words: str) -> Result:
    return CliRunner().invoke(main, ["send", *words])


@contextmanager
def at(**more: Any) -> Iterator[tuple[Autopilot, str]]:
    """A vehicle that sends to a free port, and the address to give."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    autopilot = Autopilot(port, **more)
    try:
        yield autopilot, f"udp:127.0.0.1:{port}"
    finally:
        autopilot.stop()


def test_the_command_saves_the_old_values_first_and_tells_the_end() -> None:
    with at() as (autopilot, address):
        dry = send("--mavlink", address, "--system", "1", "--compass", "1", "--dry-run", "cal.json")
        assert (dry.exit_code, autopilot.sets) == (0, [])
        assert "10 values would change" in dry.stdout
        assert list(Path().glob("*.param")) == []
        ended = send(
            "--mavlink", address, "--system", "1", "--device-id", str(DEVICE), "--backup", "old.param", "cal.json"
        )
        assert ended.exit_code == 0, ended.output
        again = send("--mavlink", address, "--system", "1", "--device-id", str(DEVICE), "--json", "cal.json")
    assert_sentences(ended.stderr)
    saved = parse(Path("old.param").read_text(encoding="utf-8"))
    assert saved == {name: autopilot.before[name] for name in saved}
    assert len(saved) == 10
    assert_sentences(again.stderr)
    assert json.loads(again.stdout)["sent"] is False


@pytest.mark.parametrize(
    ("known", "words", "code"),
    [
        ({"compass": 2}, (), 0),
        ({"compass": 1, "device_id": DEVICE + 1}, (), 0),  # the order of compasses has changed since
        ({"compass": 2, "device_id": DEVICE + 1}, ("--compass", "1"), 4),
        ({"compass": 1, "device_id": 5}, (), 4),
        ({"compass": 1, "device_id": 5}, ("--device-id", str(DEVICE)), 0),
    ],
)
def test_a_calibration_goes_to_the_compass_of_its_log(known: dict[str, Any], words: tuple[str, ...], code: int) -> None:
    file = SourceFile(name="f.bin", sha256="0" * 64, bytes=1, rows=1, autopilot="ardupilot", **known)
    date = datetime(2026, 3, 1, tzinfo=UTC)
    write(
        found().to_document(provenance=ProvenanceRecord(flinders="1", date=date, files=(file,))), "cal.json", force=True
    )
    with at() as (_, address):
        ended = send("--mavlink", address, "--system", "1", "--dry-run", *words, "cal.json")
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.output)


AS_ARDUPILOT = {
    **{ardupilot.names("EXTERNAL", one)[0]: 1.0 for one in (1, 2, 3)},
    **{ardupilot.names("ORIENT", one)[0]: 2.0 for one in (1, 2, 3)},
    **{f"CUST_ROT{slot}_{axis}": 0.0 for slot in (1, 2) for axis in ("ROLL", "PITCH", "YAW")},
    "CUST_ROT_ENABLE": 0.0, "AHRS_ORIENTATION": 0.0,
}  # fmt: skip
AS_PX4 = {f"CAL_MAG0_{axis}": 0.0 for axis in ("ROLL", "PITCH", "YAW")} | {"CAL_MAG0_ROT": 2.0}
YAW_90 = euler(0, 0, 90)


def turning(truth: Floats, *, after: bool, now: Floats = YAW_90) -> Calibration:
    """What a fit finds of a compass that is mounted by `truth` where the vehicle has it mounted by `now`."""
    plain = found()
    if after:
        return replace(
            plain, matrix=truth @ plain.matrix @ now.T, offset=now @ plain.offset, frame="vehicle",
            rotation="estimated",
        )  # fmt: skip
    return replace(plain, matrix=now.T @ truth @ plain.matrix, rotation="estimated")


@pytest.mark.parametrize("kind", [mavlink.ARDUPILOT, mavlink.PX4])
@pytest.mark.parametrize("truth", [euler(180, 0, 90), euler(4.0, -7.0, 99.0)], ids=["by number", "by angles"])
def test_a_rotation_is_sent_as_the_mounting_and_sent_again_changes_nothing(kind: int, truth: Floats) -> None:
    is_px4 = kind == mavlink.PX4
    calibration = turning(truth, after=not is_px4)
    compass, mounted = (0, AS_PX4) if is_px4 else (1, AS_ARDUPILOT)
    read = px4.Px4Parameters.read if is_px4 else ardupilot.ArduPilotParameters.read
    with vehicle(kind=kind, mounted=mounted) as (autopilot, seen):
        options: dict[str, Any] = {"compass": compass, "device_id": DEVICE, "mounting": YAW_90}
        plan = ParameterPlan.of(seen, calibration, **options)
        plan.carry_out()
        held = read(autopilot.values, compass)
        assert held.own_mounting is not None
        np.testing.assert_allclose(held.own_mounting, truth, atol=1e-6)
        raw = 50.0 * np.random.default_rng(1).normal(size=(20, 3))
        scale, turned = (100.0, raw / 100.0) if is_px4 else (0.1, 10.0 * raw @ held.own_mounting.T)
        np.testing.assert_allclose(scale * held.apply(turned), found().apply(raw) @ truth.T, atol=2e-4)
        assert ParameterPlan.of(seen, calibration, **options).pending == ()


@pytest.mark.parametrize("kind", [mavlink.ARDUPILOT, mavlink.PX4])
@pytest.mark.parametrize("every", [8, nightly(1)])
def test_one_mounting_after_the_other_is_sent_and_read_back(kind: int, every: int) -> None:
    """24 rotations by right angles and 100 others, each with a recording under the one before."""
    is_px4 = kind == mavlink.PX4
    compass, mounted = (0, AS_PX4) if is_px4 else (1, AS_ARDUPILOT)
    read = px4.Px4Parameters.read if is_px4 else ardupilot.ArduPilotParameters.read
    with vehicle(kind=kind, mounted=mounted, falls_silent=10**6, arms=10**6) as (autopilot, seen):
        for truth in [*right_angles(), *anyhow(100)][::every]:
            now = read(autopilot.values, compass).own_mounting
            assert now is not None
            calibration = turning(truth, after=not is_px4, now=now)
            ParameterPlan.of(seen, calibration, compass=compass, device_id=DEVICE, mounting=now).carry_out()
            held = read(autopilot.values, compass)
            assert held.own_mounting is not None
            np.testing.assert_allclose(held.own_mounting, truth, atol=1e-6)
            np.testing.assert_allclose(
                held.matrix[0], (turned_iron(truth) if not is_px4 else found().matrix)[0], atol=1e-5
            )


def turned_iron(truth: Floats) -> Floats:
    """(3, 3) what corrects readings that were turned before."""
    return truth @ found().matrix @ truth.T


def test_a_mounting_that_is_not_taken_brings_all_the_old_values_back() -> None:
    with vehicle(mounted=AS_ARDUPILOT, ignores=("COMPASS_OFS_Y",)) as (autopilot, seen):
        plan = ParameterPlan.of(seen, turning(euler(4, -7, 99), after=True), compass=1, mounting=YAW_90)
        with assert_raises(NotConfirmed):
            plan.carry_out()
    assert any(name == "COMPASS_ORIENT" for name, _ in autopilot.sets)
    assert autopilot.values == autopilot.before


def test_a_custom_rotation_that_another_sensor_uses_is_left_alone() -> None:
    used = AS_ARDUPILOT | {"COMPASS_ORIENT2": 101.0}
    with vehicle(mounted=used) as (_, seen):
        plan = ParameterPlan.of(seen, turning(euler(4, -7, 99), after=True), compass=1, mounting=YAW_90)
    values = {change.new.name: change.new.value for change in plan.changes}
    assert values["COMPASS_ORIENT"] == 102.0
    assert values["CUST_ROT2_PITCH"] == pytest.approx(-7.0)
    with vehicle(mounted=used | {"AHRS_ORIENTATION": 102.0}) as (_, seen), pytest.raises(NotSent, match="CUST_ROT2"):
        ParameterPlan.of(seen, turning(euler(4, -7, 99), after=True), compass=1, mounting=YAW_90)


@pytest.mark.parametrize(
    "changed",
    [
        {"COMPASS_ORIENT": 8.0},
        {"COMPASS_EXTERNAL": 0.0},
        {"COMPASS_ORIENT": 77.0},
    ],
)
def test_a_compass_that_is_mounted_otherwise_than_when_recorded_is_refused(changed: dict[str, float]) -> None:
    for truth in (euler(4, -7, 99), YAW_90):  # offsets act after the mounting, also without a rotation
        with vehicle(mounted=AS_ARDUPILOT | changed) as (autopilot, seen), assert_raises(NotSent):
            ParameterPlan.of(seen, turning(truth, after=True), compass=1, mounting=YAW_90)
        assert autopilot.sets == []


def test_old_firmware_gets_a_mounting_by_number_and_none_by_angles() -> None:
    old = {"CAL_MAG0_ROT": 2.0}
    with vehicle(kind=mavlink.PX4, mounted=old, answer=0.02) as (_, seen):
        options: dict[str, Any] = {"compass": 0, "device_id": DEVICE, "mounting": YAW_90}
        plan = ParameterPlan.of(seen, turning(euler(180, 0, 90), after=False), **options)
        assert [change.new.name for change in plan.changes if "ROLL" in change.new.name] == []
        with assert_raises(NotSent):
            ParameterPlan.of(seen, turning(euler(4, -7, 99), after=False), **options)


def test_a_loss_is_asked_about_on_a_terminal_and_needs_lossy_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    turning(euler(0, 0, 92), after=True).save("turned.json")
    with at(mounted=AS_ARDUPILOT) as (autopilot, address):
        words = ("--mavlink", address, "--system", "1", "--compass", "1", "turned.json")
        refused = send(*words)
        assert (refused.exit_code, autopilot.sets) == (4, [])
        assert "--mounting" in refused.stderr
        assert send(*words, "--lossy", "--dry-run").exit_code == 0
        monkeypatch.setattr("flinders.cli._output.is_asked", lambda: True)
        declined = CliRunner().invoke(main, ["send", *words], input="n\n")
        assert (declined.exit_code, autopilot.sets) == (4, [])
        assert CliRunner().invoke(main, ["send", *words, "--dry-run"], input="y\n").exit_code == 0
        ended = send(*words, "--mounting", "2")
    assert ended.exit_code == 0, ended.output
    assert autopilot.values["COMPASS_ORIENT"] == 101.0


def test_an_autopilot_gets_no_numbers_from_the_other_side_of_its_mounting() -> None:
    with vehicle(kind=mavlink.PX4) as (autopilot, seen):
        with assert_raises(NotExportable, frame="vehicle"):
            ParameterPlan.of(seen, found(frame="vehicle"))
        assert autopilot.sets == []
    with vehicle() as (_, seen):
        plan = ParameterPlan.of(seen, found(frame="vehicle", axes=Axes.of("y,-x,z")), compass=1)
    values = {change.new.name: change.new.value for change in plan.changes}
    x, y, z = found().offset  # along y, −x and z of the vehicle
    np.testing.assert_allclose([values[f"COMPASS_OFS_{axis}"] for axis in "XYZ"], -10 * np.array([-y, x, z]), rtol=1e-6)
    assert not any("COMPASS_ORIENT" in note for note in plan.notes)


def test_what_will_change_is_shown_before_it_does() -> None:
    with at(ignores=("COMPASS_OFS_X",)) as (autopilot, address):
        ended = send("--mavlink", address, "--system", "1", "--compass", "1", "cal.json")
    assert ended.exit_code == 6
    assert {name for name, _ in autopilot.sets} == {"COMPASS_OFS_X"}  # the first, which it did not take
    assert "COMPASS_SCALE" in ended.stdout


def test_the_command_never_writes_over_old_values() -> None:
    Path("old.param").write_text("COMPASS_OFS_X,1\n", encoding="utf-8")
    with at() as (autopilot, address):
        ended = send("--mavlink", address, "--system", "1", "--backup", "old.param", "cal.json")
    assert (ended.exit_code, autopilot.sets) == (6, [])
    assert_sentences(ended.stderr)


def test_the_command_ends_with_the_code_of_what_went_wrong() -> None:
    with at(ignores=("COMPASS_SCALE",)) as (autopilot, address):
        ended = send("--mavlink", address, "--system", "1", "--compass", "1", "cal.json")
    assert ended.exit_code == 6
    assert_sentences(ended.stderr)
    assert autopilot.values == autopilot.before
    assert len(list(Path().glob("compass-before-*.param"))) == 1
    with at(armed=True) as (_, address):
        assert send("--mavlink", address, "--system", "1", "cal.json").exit_code == 4


def test_ctrl_c_pressed_twice_leaves_the_vehicle_as_it_was() -> None:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    with at(late=0.05) as (autopilot, address):
        words = ["send", "--mavlink", address, "--system", "1", "--compass", "1", "cal.json"]
        running = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True)
        wait_until(lambda: len(autopilot.sets) >= 2)
        running.send_signal(signal.SIGINT)
        time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 130, err
    assert_sentences(err)
    assert autopilot.values == autopilot.before


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--mavlink", "udp:127.0.0.1", "cal.json"), 2),
        (("--mavlink", "udp:127.0.0.1:99999", "cal.json"), 2),
        (("--mavlink", "bluetooth:x", "cal.json"), 2),
        (("--mavlink", "tcp:127.0.0.1:1", "cal.json"), 5),
        (("--mavlink", "udp:nohost.invalid:14550", "cal.json"), 5),
        (("--mavlink", "/dev/ttyNONE", "cal.json"), 5),
        (("--mavlink", "udp:127.0.0.1:14550", "--compass", "4", "cal.json"), 2),
        (("--mavlink", "udp:127.0.0.1:14550", "none.json"), 5),
        (("--mavlink", "udp:127.0.0.1:14550", "--backup", "-", "cal.json"), 2),
    ],
)
def test_mistakes_end_in_a_line(words: tuple[str, ...], code: int) -> None:
    ended = send(*words)
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.stderr)
    assert "Traceback" not in ended.output
