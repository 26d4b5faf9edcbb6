r"""ArduPilot's DataFlash logs, ``.bin`` or turned into text as ``.log``: every compass, with further columns.

A vehicle logs corrected readings, m = I ((r + OFS) SCALE) + MOT x, in whole mG and in its own axes. OFS and MOT x are
logged with each reading. The raw reading is

    r = I⁻¹ (m − MOT x) / SCALE − OFS

with DIA, ODI and SCALE from the parameters in force at the time. OFS is truncated to whole mG in the message; where
the parameter truncates to the same number, the parameter is used.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.readers._source import File
>>> text = '''FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
... FMT, 134, 34, MAG, QBhhhhhhhhhB, TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health
... FMT, 129, 31, PARM, QNf, TimeUS,Name,Value
... PARM, 1000000, COMPASS_OFS_X, -97.5
... PARM, 1000000, COMPASS_SCALE, 1.25
... MAG, 2000000, 0, 250, 0, -500, -97, 0, 0, 0, 0, 0, 1
... '''
>>> path = Path(tempfile.mkdtemp()) / "flight.log"
>>> _ = path.write_text(text)
>>> log = open_dataflash(File("flight.log", path, path.stat().st_size))
>>> print(log.instruments[0])
flight.log: MAG 0 in mG; un-applied: COMPASS_OFS -97.5, 0, 0 mG; COMPASS_SCALE 1.25
>>> next(log.instruments[0].blocks()).field                               # 250 / 1.25 + 97.5 mG, in µT
array([[ 29.75,   0.  , -40.  ]])

Sources: ``AP_Compass_Backend::correct_field`` and ``AP_Logger`` of ArduPilot for the formula and the messages;
https://github.com/ArduPilot/WebTools (MAGFit) for its inverse.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.vehicles.readers.dataflash_format import (
    CHARACTERS,
    HEADER,
    INSTANCE,
    MAX_MESSAGE_BYTES,
    WHOLE,
    Messages,
    Table,
    read_packed,
    read_text,
)
from flinders.apps.vehicles.readers.parameters import (
    ARDUPILOT,
    IN_VEHICLE_AXES,
    mounting_words,
    stage_of,
    stages,
    stored_correction,
    unapply_stages,
    unused_words,
)
from flinders.apps.vehicles.targets.ardupilot import COMPASSES, ArduPilotParameters
from flinders.core.units import Unit
from flinders.errors import NoMagnetometer, UnreadableInput, count_text
from flinders.geometry.quaternions import from_angles
from flinders.readers._lines import encoding_of
from flinders.readers._log import Instrument, Log, Position, first_position
from flinders.readers._names import ACCELERATION, ATTITUDE, CURRENT, CURRENTS, RATE, TEMPERATURE, THROTTLE, THROTTLES
from flinders.readers._reader import Reader
from flinders.readers._resample import AttitudeSeries, TimeSeries, blocks, resample
from flinders.readers._source import filled_size, refusal, reserved_words

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.apps.vehicles.readers.parameters import Stages
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers._resample import Series
    from flinders.readers._source import File

COMPASS_NAMES: Final = ("MAG", "MAG2", "MAG3")
"""Messages of compasses: all in MAG with an instance I, or, in older logs, one name each."""
QUATERNIONS: Final = ("XKQ", "XKQ1", "NKQ", "NKQ1")
"""Messages with the attitude of the estimator: of EKF 3 and of EKF 2. In older logs each core has a name of its own."""
ANGLES: Final = ("ATT", "AHR2")
"""Messages with roll, pitch and yaw in degrees, of the estimator in use and of the second one."""
PRIMARY: Final = {"XKQ": "XKF4", "NKQ": "NKF4"}
"""Messages with the core in use, by the message of each estimator's quaternion."""
THROTTLE_LABELS: Final = {"CTUN": ("ThO", "ThrOut"), "THR": ("ThrOut",)}
"""Messages with the throttle of the motors, and the labels that it may have there."""
CONTROLLERS: Final = ("ESC", *(f"ESC{number}" for number in range(1, 9)))
"""Messages of speed controllers: of all in ESC with an instance, or, in older logs, one name each."""
OUTPUTS: Final = "RCOU"
"""Message with the pulse width of each output, µs."""
MOTOR_FUNCTIONS: Final = {float(code): place for place, code in enumerate((*range(33, 41), *range(82, 86)))}
"""Number of a motor, from 0, by ``SERVOn_FUNCTION`` of the output that drives it."""
PULSES_US: Final = (1000.0, 2000.0)
"""Pulse widths of zero and full throttle: defaults of ``MOT_PWM_MIN`` and ``MOT_PWM_MAX``."""
NO_PULSE_US: Final = 500.0
"""Smallest width of a pulse; a smaller number means that there was no pulse."""
WANTED: Final = (
    *COMPASS_NAMES, "IMU", "BAT", "CURR", "PARM", "GPS", "POS", "ORGN", "MSG", *QUATERNIONS, *ANGLES,
    *PRIMARY.values(), *THROTTLE_LABELS, *CONTROLLERS, OUTPUTS,
)  # fmt: skip
LOADS: Final = ("BAT", "CURR", *THROTTLE_LABELS, *CONTROLLERS, OUTPUTS)
"""Messages of currents and throttles."""
DESCRIPTION: Final = re.compile(rb"^FMT\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,", re.MULTILINE)
"""Pattern of a line of a text log that describes a message."""

FIELD_NAME: Final = re.compile(r"(?P<message>[A-Z][A-Z0-9]*)(?:\[(?P<instance>\d+)\])?\.(?P<field>\w+)", re.IGNORECASE)
"""Pattern of the name of a field: message, optional instance, label."""

MAX_SKIPPED_SHARE: Final = 0.5
"""Largest share of bytes outside messages; a log with more is refused."""

MIN_FIX: Final = 3
"""Smallest GPS.Status with a position."""
LAST_WEEK, WEEK_MS = 10_000, 604_800_000
"""Last valid GPS week (year 2171), and milliseconds of a week."""
GPS_EPOCH: Final = datetime(1980, 1, 6, tzinfo=UTC)
LEAPS: Final = ((datetime(2017, 1, 1, tzinfo=UTC), 18), (datetime(2015, 7, 1, tzinfo=UTC), 17))
"""Dates, each with the seconds by which GPS time is ahead of UTC from that date on.

Before the earliest date, since July 2012, it is `EARLIER_LEAP`.
"""
EARLIER_LEAP: Final = 16
MAX_MOTORS: Final = 32
UNITY, PER_CENT, PER_MILLE = 1.0, 0.01, 0.001
THROTTLE_FACTORS: Final = ((1.5, UNITY), (150.0, PER_CENT), (np.inf, PER_MILLE))
"""Limits of the largest throttle in a log, each with the factor to a share.

Logs do not state whether a throttle is a share, per cent or per mille.
"""


def open_dataflash(file: File) -> Log:
    """Open a log: find its messages, its compasses, and the parameters in force.

    Raises `UnreadableInput` for a file that cannot be read, or is mostly not a log; `NoMagnetometer` for a log without
    readings of a compass.
    """
    messages = _messages(file)
    compasses = _compasses(messages)
    if not compasses:
        raise NoMagnetometer(
            f"{file.name} is an ArduPilot log without readings of a compass (MAG): turn on Compass in LOG_BITMASK and "
            "record again"
        )
    parm = messages.get("PARM")
    changes = stages([] if parm is None else _parameters(parm), ARDUPILOT, file.name)
    auxiliary = _auxiliary(messages, changes[-1][1])
    velocity = _velocity(messages)
    instruments = tuple(
        replace(_instrument(file, name, number, mag, changes, auxiliary), velocity=velocity)
        for name, number, mag in compasses
    )
    damage = tuple(_damage(messages, file))
    return Log(
        file.name,
        "ArduPilot DataFlash",
        instruments,
        position=_position(messages),
        start_time=_start_time(messages, instruments),
        notes=(*_notes(messages), *damage),
        damage=damage,
    )


def _messages(file: File, wanted: Collection[str] = WANTED) -> Messages:
    """Find the messages of some names in a log, binary or text."""
    if not file.head().startswith(HEADER):
        lines = (
            (block.first + place, line)
            for block in file.lines(encoding_of(file.head()))
            for place, line in enumerate(block.texts)
        )
        return read_text(lines, wanted)
    try:
        raw = np.memmap(file.path, np.uint8, "r").view(np.ndarray)[: filled_size(file.path) + MAX_MESSAGE_BYTES]
    except (OSError, ValueError) as error:
        raise refusal(file.name, error) from None
    messages = read_packed(raw, wanted)
    if messages.skipped > MAX_SKIPPED_SHARE * len(raw):
        raise UnreadableInput(
            f"{file.name} begins as an ArduPilot log, but {messages.skipped:,} of its {len(raw):,} bytes belong to no "
            "known message: the file is damaged or lacks its beginning; copy it again"
        )
    return messages


def _parameters(parm: Table) -> list[tuple[float, str, float]]:
    """Place, name and value of each parameter message; none if the log is damaged."""
    if not parm.has("Name", "Value"):
        return []
    return list(zip(parm.where.tolist(), parm.texts("Name"), parm.column("Value").tolist(), strict=True))


# the compasses


def _compasses(messages: Messages) -> list[tuple[str, int, Table]]:
    """Name, number from 1, and messages of each compass with readings."""
    compasses: list[tuple[str, int, Table]] = []
    for place, name in enumerate(COMPASS_NAMES, 1):
        table = messages.get(name)
        if table is None or table.triple("Mag") is None:
            continue
        if (clock := table.seconds) is not None:
            table = table.only(np.isfinite(clock))
        label = table.first(INSTANCE)
        if label is None:
            compasses += [(name, place, table)] * bool(len(table))
            continue
        instances = table.column(label)
        for each in np.unique(instances[np.isin(instances, np.arange(256))]):
            compasses.append((f"{name} {each:.0f}", int(each) + 1, table.only(instances == each)))
    return compasses


@dataclass(frozen=True, eq=False)
class _Compass:
    """Messages of a compass, and the parameters that corrected them."""

    source: str
    mag: Table  # messages of the compass
    stage: NDArray[np.intp]  # (N,): stage of the parameters in force at each
    parameters: dict[int, ArduPilotParameters]  # by stage
    auxiliary: Mapping[str, Series]

    @cached_property
    def offsets(self) -> Floats:
        """(N, 3) OFS of each reading, mG: the parameter if it truncates to the logged number, else that number."""
        offsets = self.mag.triple("Ofs")
        if offsets is None:
            return np.array([self.parameters[each].offset for each in self.stage]).reshape(-1, 3)
        for each, parameters in self.parameters.items():
            rows = (self.stage == each) & np.all(np.trunc(parameters.offset) == offsets, axis=1)
            offsets[rows] = parameters.offset
        return offsets

    @cached_property
    def motor_offsets(self) -> Floats:
        """(N, 3) motor compensation in each reading, mG: COMPASS_MOT times current or throttle."""
        vectors = (self.mag.triple(prefix) for prefix in ("MO", "MOfs"))
        return next((each for each in vectors if each is not None), np.zeros((len(self.mag), 3)))

    @property
    def in_force(self) -> ArduPilotParameters:
        """Parameters in force at the last reading."""
        return replace(self.parameters[int(self.stage[-1])], offset=self.offsets[-1])

    @property
    def changes(self) -> int:
        """Number of readings before which the parameters changed."""
        return int(np.count_nonzero(np.any(np.diff(self.offsets, axis=0), axis=1) | (np.diff(self.stage) > 0)))

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Yield the readings in blocks, raw or as logged; see `Instrument`."""
        time, logged = self.mag.seconds, self.mag.triple("Mag")
        assert logged is not None
        centred = {each: replace(own, offset=np.zeros(3)) for each, own in self.parameters.items()}

        def rows(at: slice) -> dict[str, Any]:
            field = logged[at]
            if not as_logged:
                motor = self.motor_offsets[at]
                field = (
                    unapply_stages(self.source, field, self.stage[at], centred, motor_offset=motor) - self.offsets[at]
                )
            if time is None:
                return {"field": field}
            return {"field": field, "time": time[at], **resample(self.auxiliary, time[at])}

        return blocks(self.source, Unit.of("mG"), len(logged), rows)


def _instrument(
    file: File, name: str, number: int, mag: Table, changes: Stages, auxiliary: Mapping[str, Series]
) -> Instrument:
    """Make an `Instrument` from the messages of a compass."""
    ill = 0
    if mag.has("Health"):  # leaves out readings that were logged without an answer of the compass, unless all were
        well = mag.column("Health") != 0
        mag, ill = (mag.only(well), int((~well).sum())) if well.any() else (mag, 0)
    stage, known = stage_of(mag.where, changes), number in COMPASSES
    parameters = {
        each: ArduPilotParameters.read(changes[each][1], number) if known else ArduPilotParameters()
        for each in set(stage.tolist())
    }
    last = ArduPilotParameters.read(changes[-1][1], number) if known else ArduPilotParameters()
    compass = _Compass(file.name, mag, stage, parameters, auxiliary)
    clock = mag.seconds
    return Instrument(
        file.name,
        name,
        Unit.of("mG"),
        compass.columns,
        stored=stored_correction(compass.in_force, changes=compass.changes),
        frames=IN_VEHICLE_AXES,
        autopilot="ardupilot",
        compass=number if known else None,
        device_id=last.device_id,
        mounting=last.mounting_angles,
        beginning=np.nan if clock is None else float(clock[0]),
        readings=len(mag),
        notes=tuple(_remarks(compass, changes[-1][1], number, ill)),
        file=file,
        look_up=partial(named_series, file),
    )


def _remarks(compass: _Compass, values: Mapping[str, float], number: int, ill: int) -> Iterator[str]:
    """Yield notes on a compass."""
    in_force, offsets, motor = compass.in_force, compass.offsets, compass.motor_offsets
    yield mounting_words(replace(in_force, compass=number), values)
    yield "readings were logged in whole mG, truncated towards zero"
    if changes := compass.changes:
        times = count_text(changes, "time")
        yield f"its parameters changed {times}: from each reading, those in force then are removed"
    elif in_force.is_identity and not motor.any():
        yield "no calibration was in force: readings are raw"
    if np.any(offsets[-1] != compass.parameters[int(compass.stage[-1])].offset):
        yield (
            "the offsets logged with its readings differ from its parameters; the logged ones are used. They were "
            "learned under way, or DIA, ODI and SCALE belong to another compass"
        )
    if motor.any():
        largest = float(np.linalg.norm(motor, axis=1).max())
        order = "" if np.array_equal(in_force.iron, np.eye(3)) else "; newer firmware adds it after DIA and ODI"
        yield f"its motor compensation of up to {largest:.0f} mG is removed{order}"
    if ill:
        yield f"{count_text(ill, 'reading')} of an unhealthy compass left out"
    yield from unused_words(values, number)


# what was logged with the readings


def _auxiliary(messages: Messages, values: Mapping[str, float]) -> dict[str, Series]:
    """Logged series of the first IMU, the first battery, throttle, motors and attitude."""
    imu = _timed_table(messages, "IMU")
    series: dict[str, Series | None] = {
        CURRENT: _battery(_timed_table(messages, "BAT") or _timed_table(messages, "CURR")),
        THROTTLE: _throttle(messages),
        ATTITUDE: _attitude(messages, values),
        THROTTLES: _throttles(messages),
        CURRENTS: _currents(messages),
    }
    if imu is not None:
        series[ACCELERATION] = _series(imu, imu.triple("Acc"))
        series[RATE] = _series(imu, imu.triple("Gyr"))
        if label := imu.first(("T", "Temp")):
            series[TEMPERATURE] = _series(imu, imu.columns(label))
    return {kind: each for kind, each in series.items() if each is not None}


def _timed_table(messages: Messages, name: str) -> Table | None:
    """Messages of the first instance; None without times."""
    table = messages.get(name)
    return None if table is None or table.seconds is None else table.of_instance() or table


def _series(table: Table, values: Floats | None, kind: type[TimeSeries] = TimeSeries) -> TimeSeries | None:
    """Series of values at the times of their messages; None without values, NaN if no value is finite."""
    seconds = table.seconds
    if values is None or seconds is None or not len(seconds):
        return None
    return kind.of(seconds, values) or kind(seconds[:1], np.full((1, values.shape[1]), np.nan))


def _battery(table: Table | None) -> TimeSeries | None:
    """Current of the first battery, A; None if it is always 0."""
    if table is None or not table.has("Curr"):
        return None
    amperes = table.columns("Curr")
    return (
        _series(table, amperes * (0.01 if table.fields["Curr"].letter in WHOLE else 1.0))
        if _has_current(amperes)
        else None
    )


def _has_current(amperes: Floats) -> bool:
    return bool(np.nan_to_num(amperes).any())


def _currents(messages: Messages) -> Series | None:
    """Current of each motor, A, from the speed controllers; None if all are always 0."""
    series: list[TimeSeries] = []
    numbered = messages.get("ESC")
    for place in range(MAX_MOTORS):
        table = messages.get(f"ESC{place + 1}") if numbered is None else numbered.of_instance(place)
        if table is None or not len(table) or not table.has("Curr"):
            break
        if (one := _series(table, table.columns("Curr"))) is None:
            break
        series.append(one)
    return tuple(series) if any(_has_current(one.values) for one in series) else None


def _throttles(messages: Messages) -> TimeSeries | None:
    """Commanded throttle of each motor, 0 to 1; None unless parameters name the outputs of all motors."""
    table, parm = messages.get("RCOU"), messages.get("PARM")
    if table is None or parm is None:
        return None
    values = {name: value for _, name, value in _parameters(parm)}
    of_output = {number: MOTOR_FUNCTIONS.get(values.get(f"SERVO{number}_FUNCTION", 0.0)) for number in range(1, 33)}
    outputs = {motor: f"C{number}" for number, motor in of_output.items() if motor is not None}
    labels = [outputs[motor] for motor in range(len(outputs)) if motor in outputs]
    if not labels or len(labels) < len(outputs) or not table.has(*labels):
        return None
    pulses = values.get("MOT_PWM_MIN", 0.0), values.get("MOT_PWM_MAX", 0.0)
    least, most = pulses if 0.0 < pulses[0] < pulses[1] else PULSES_US
    widths = table.columns(*labels)
    return _series(table, np.where(widths < NO_PULSE_US, np.nan, np.maximum(widths - least, 0.0) / (most - least)))


def _throttle(messages: Messages) -> TimeSeries | None:
    """Commanded throttle, 0 to 1; copters log a share, older copters per mille, planes and rovers per cent."""
    for name, labels in THROTTLE_LABELS.items():
        table = messages.get(name)
        label = None if table is None else table.first(labels)
        if table is None or label is None:
            continue
        logged = table.columns(label)
        largest = float(np.max(logged, where=np.isfinite(logged), initial=-np.inf))
        if _has_current(logged):
            return _series(table, logged * next(factor for most, factor in THROTTLE_FACTORS if largest <= most))
    return None


def _attitude(messages: Messages, values: Mapping[str, float]) -> TimeSeries | None:
    """Attitude of the estimator in use: its quaternion if logged, else angles."""
    names = sorted(QUATERNIONS, key=lambda name: (name[0] == "X") == (values.get("AHRS_EKF_TYPE", 3) == 2))
    labels = ("Q1", "Q2", "Q3", "Q4")
    for name in names:
        table = messages.get(name)
        if table is not None and table.has(*labels) and table.seconds is not None:
            used = _primary_core(table, messages.get(PRIMARY.get(name, "")))
            return _series(used, used.columns(*labels), AttitudeSeries)
    for name in ANGLES:
        table = messages.get(name)
        if table is not None and table.has("Roll", "Pitch", "Yaw"):
            return _series(table, from_angles(np.deg2rad(table.columns("Roll", "Pitch", "Yaw"))), AttitudeSeries)
    return None


def _primary_core(quaternions: Table, state: Table | None) -> Table:
    """Quaternions of the core in use at the time, if the estimator reports it; else of the first core."""
    if not quaternions.has("C"):
        return quaternions
    core = quaternions.column("C")
    used = np.full(len(core), core.min())
    if state is not None and state.has("PI"):
        cores = state.column("PI")
        used = cores[np.maximum(np.searchsorted(state.where, quaternions.where, side="right") - 1, 0)]
    return quaternions.only(core == (used if (core == used).any() else core.min()))


def named_series(file: File, names: Sequence[str]) -> tuple[dict[str, TimeSeries], list[str]]:
    """Series of fields by name, such as ``BAT.Curr``, and the names of all fields of their messages.

    ``BAT[1].Curr`` is the field of instance 1; without a number, it is that of the first instance.
    """
    wanted = {name: match for name in names if (match := FIELD_NAME.fullmatch(name))}
    messages = _messages(file, {match["message"] for match in wanted.values()})
    found, there = dict[str, TimeSeries](), list[str]()
    for name, match in wanted.items():
        table = messages.get(match["message"])
        if table is None or table.seconds is None:
            continue
        there += [f"{match['message']}.{label}" for label in table.fields]
        instance = None if match["instance"] is None else float(match["instance"])
        own = table.of_instance(instance) if instance is not None else table.of_instance() or table
        if own is None or own.seconds is None or not len(own) or not own.has(match["field"]):
            continue
        series = TimeSeries.of(own.seconds, own.columns(match["field"]))
        found |= {} if series is None else {name: series}
    return found, there or (_names_of_fields(_messages(file, _EveryName())) if len(found) < len(names) else [])


class _EveryName(frozenset[str]):
    """All names of messages."""

    def __contains__(self, name: object) -> bool:
        return True


def _names_of_fields(messages: Messages) -> list[str]:
    """Names of the numeric fields of all timed messages; loads of the battery and of motors first."""
    tables = {name: table for name, table in messages.tables.items() if table.seconds is not None}
    names = sorted(tables, key=lambda name: LOADS.index(name) if name in LOADS else len(LOADS))
    return [
        f"{name}.{label}"
        for name in names
        for label, field in tables[name].fields.items()
        if field.letter not in CHARACTERS and not label.startswith("Time")
    ]


# where, when, and what to know


def _position(messages: Messages) -> Position | None:
    """Place of the log: origin of the navigation, else first position of the estimator, else first fix."""
    for name in ("ORGN", "POS", "GPS"):
        table = messages.get(name)
        if table is None or not table.has("Lat", "Lng"):
            continue
        fixed = (
            table.column("Status") >= MIN_FIX if name == "GPS" and table.has("Status") else np.ones(len(table), bool)
        )
        altitude = table.column("Alt") if table.has("Alt") else np.zeros(len(table))
        position = first_position(table.column("Lat"), table.column("Lng"), altitude, fixed=fixed)
        if position is not None:
            return position
    return None


def _velocity(messages: Messages) -> TimeSeries | None:
    """(N, 2) velocity over ground, north and east, m/s, from speed and course of the satellite receiver."""
    gps = messages.get("GPS")
    own = None if gps is None else gps.first(("TimeUS", "T"))  # TimeMS is the satellites' time
    if gps is None or own is None or not gps.has("Spd", "GCrs", "Status"):
        return None
    course, fixed = np.deg2rad(gps.column("GCrs")), gps.column("Status") >= MIN_FIX
    velocity = gps.column("Spd")[:, np.newaxis] * np.column_stack([np.cos(course), np.sin(course)])
    seconds = gps.column(own) * (1e-6 if own == "TimeUS" else 1e-3)
    return TimeSeries.of(seconds[fixed], velocity[fixed])


def _start_time(messages: Messages, instruments: tuple[Instrument, ...]) -> datetime | None:
    """Return the UTC of the first reading, from the first GPS fix."""
    gps = messages.get("GPS")
    if gps is None:
        return None
    week, since = gps.first(("GWk", "Week")), gps.first(("GMS", "TimeMS"))
    own = "TimeUS" if gps.has("TimeUS") else "T"
    if week is None or since is None or not gps.has(own, "Status"):
        return None
    weeks, of_week, clock = gps.column(week), gps.column(since), gps.column(own)
    fixed = (gps.column("Status") >= MIN_FIX) & (weeks > 0) & (weeks < LAST_WEEK)
    fixed &= (np.abs(of_week) < LAST_WEEK * WEEK_MS) & (np.abs(clock) < LAST_WEEK * WEEK_MS)
    if not fixed.any():
        return None
    row = int(np.argmax(fixed))
    gps_time = GPS_EPOCH + timedelta(weeks=float(weeks[row]), milliseconds=float(of_week[row]))
    utc = gps_time - timedelta(seconds=next((leap for day, leap in LEAPS if gps_time >= day), EARLIER_LEAP))
    at = float(clock[row]) * (1e-6 if own == "TimeUS" else 1e-3)
    first = min((one.beginning for one in instruments), default=np.nan)
    return utc - timedelta(seconds=at - first) if abs(at - first) < WEEK_MS else utc


def _notes(messages: Messages) -> Iterator[str]:
    """Yield notes on the file."""
    texts = messages.get("MSG")
    if texts is not None and texts.has("Message"):
        yield f"firmware: {texts.texts('Message')[0]}"
    if messages.get("PARM") is None:
        yield "no parameters were logged: DIA, ODI and SCALE are assumed to have their defaults"


def _damage(messages: Messages, file: File) -> Iterator[str]:
    """Yield notes on parts of the file that could not be read."""
    if reserved := file.size - filled_size(file.path):
        yield reserved_words(reserved)
    if messages.skipped:
        kind, total = ("line", "") if messages.is_text else ("byte", f" of {file.size:,}")
        places = count_text(messages.gaps, "place")
        yield f"{count_text(messages.skipped, kind)}{total} in {places} belong to no message: skipped"


def is_dataflash(head: bytes) -> bool:
    """Whether a file begins with a message, or its first bytes hold a line that describes messages."""
    return head.startswith(HEADER) or (b"FMT" in head and DESCRIPTION.search(head) is not None)


READERS: Final = (
    Reader(
        "dataflash",
        "ArduPilot DataFlash",
        (".bin", ".log"),
        "each compass, with the calibration in force removed, and attitude, motors and other columns",
        sniff=is_dataflash,
        log=open_dataflash,
    ),
)
