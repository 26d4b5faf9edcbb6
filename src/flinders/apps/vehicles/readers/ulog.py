"""PX4 logs (``.ulg``), read with pyulog.

Three topics may hold a magnetometer. Each is offered if it holds more readings than the topic above it in this list:

- ``sensor_mag``, one instance for each compass, in gauss and in the axes of the sensor. It is raw from version 1.12 on;
    up to 1.11 the driver had applied CAL_MAGn_SCALE and OFF, which is removed here.
- ``vehicle_magnetometer``: corrected and in the axes of the vehicle. The correction is removed with the parameters
    of the compass named in it, or in ``sensor_selection`` or CAL_MAG_PRIME. Not removed are the estimator's in-flight
    estimate, which versions from 1.13 on may subtract, and COMP, which needs throttle or current.
- ``sensor_combined.magnetometer_ga`` of logs up to 2018: as ``vehicle_magnetometer``, repeated at the rate of the gyro.

A reading has acceleration and rate (``sensor_combined``, else ``vehicle_imu``), the attitude
(``vehicle_attitude``), the current of the first battery that measures it and the throttle (length of
``vehicle_thrust_setpoint.xyz``, in older logs ``actuator_controls_0.control[3]``), current and throttle of each motor
(``esc_status``, ``actuator_motors``; field order not verified on a log), all at the time of the reading, and
the compass's own temperature. Acceleration is specific force in axes forward, right, down, as `Samples` wants it;
acceleration, rate and attitude are turned into the axes of the sensor, and left out if its mounting is unknown.

Times are seconds since the autopilot started.

Sources: PX4 ``msg/*.msg``; ULog file format, version 1 (docs.px4.io); that ``sensor_mag`` was corrected up to 1.11
stands in ``PX4Magnetometer::update`` of those versions, and a log of 1.11 shows it (`tests/vehicles/test_px4.py`).
"""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.apps.vehicles.readers.parameters import onboard, stage_of, stages, unapply_stages
from flinders.apps.vehicles.targets import px4
from flinders.core.units import Unit
from flinders.errors import ArrayError, UnreadableInput, count_text, figures
from flinders.foreign_errors import import_optional, parser_errors
from flinders.readers._log import Instrument, Log, Position, Stored, first_position
from flinders.readers._names import ACCELERATION, ATTITUDE, CURRENT, CURRENTS, RATE, THROTTLE, THROTTLES
from flinders.readers._reader import Reader
from flinders.readers._resample import AttitudeSeries, TimeSeries, blocks, resample, throttle_shares
from flinders.readers._source import UpTo, filled_size, reserved_words

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.apps.vehicles.readers.parameters import Stages
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers._source import File

Topics: TypeAlias = "Mapping[tuple[str, int], Mapping[str, Any]]"  # columns by name and instance
KIND: Final = "a PX4 ULog"
MAGIC: Final = b"ULog\x01\x12\x35"
SYNC: Final = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
HEADER: Final = 16
"""Number of bytes before the first message."""
TAIL: Final = 1 << 24
"""Number of bytes at the end of a file that are searched for a sync mark; newer loggers write marks throughout."""
GAUSS: Final = Unit.of("G")

TOPICS: Final = (
    "sensor_mag", "vehicle_magnetometer", "sensor_combined", "sensor_selection", "vehicle_imu",
    "battery_status", "vehicle_gps_position", "sensor_gps", "vehicle_attitude", "vehicle_thrust_setpoint",
    "actuator_controls_0", "esc_status", "actuator_motors",
)  # fmt: skip
"""Topics to read; others are not loaded."""

MIN_FIX: Final = 3
"""Smallest ``fix_type`` of a position in three dimensions."""
INVALID_RELATIVE: Final = 0x7FFFFFFF
"""``magnetometer_timestamp_relative`` of a row without a magnetometer."""
RAW_SINCE: Final = (1, 12)
"""First version in which ``sensor_mag`` is raw."""
MAX_CONTROLLERS, MAX_MOTORS = 8, 12
"""Lengths of the arrays in ``esc_status`` and ``actuator_motors``."""
MAX_FIELDS: Final = 20_000
"""Largest number of columns of all topics together; more indicate a damaged file."""
MAX_DEPTH: Final = 8
"""Deepest nesting of topics; PX4 has two levels."""
CHANGE_WINDOW_S: Final = 1.0
"""Longest time in s between changes of parameters that belong to one calibration on board."""
MIN_READINGS_RATIO: Final = 1.5
"""Smallest ratio of the number of readings of another topic to that of ``sensor_mag``, if the topic is offered."""
EARLIEST, LATEST = datetime(2000, 1, 1, tzinfo=UTC), datetime(2100, 1, 1, tzinfo=UTC)


def open_ulog(file: File) -> Log:
    """Open a PX4 log, on the disk and not compressed.

    Returns a log without instruments if it holds no magnetometer. Raises `MissingExtra` without pyulog;
    `UnreadableInput` for a file that is not a ULog, or damaged beyond reading.
    """
    pyulog = import_optional("pyulog", "px4", KIND)
    with parser_errors(file.name, KIND):
        flight = _Flight.of(file.name, _parse_log(pyulog, file))
        instruments = [*_sensor_mag(flight)]
        for derived in (_vehicle_magnetometer, _sensor_combined):
            others = [*derived(flight)]
            most = max((one.readings or 0 for one in instruments), default=0)
            if max((one.readings or 0 for one in others), default=0) > MIN_READINGS_RATIO * most:
                instruments = [*others, *instruments]
        damage = tuple(_damage(file, flight))
        velocity = _velocity(flight)
        version = () if flight.version is None else (f"PX4 {flight.version[0]}.{flight.version[1]}",)
        return Log(
            file.name,
            "PX4 ULog",
            tuple(replace(one, velocity=velocity, look_up=partial(named_series, file)) for one in instruments),
            position=_position(flight),
            start_time=_start_time(flight),
            notes=(*version, *damage),
            damage=damage,
        )


# the file


class _Bounded(io.BufferedReader):
    """A file with a limit on seeks, since pyulog searches a damaged file byte by byte for valid messages."""

    def __init__(self, raw: io.FileIO, name: str, size: int) -> None:
        super().__init__(raw, 1 << 16)
        self._file, self._left = name, 16 * size + (1 << 26)

    def seek(self, offset: int, whence: int = 0, /) -> int:
        before = self.tell()
        after = super().seek(offset, whence)
        self._left -= max(before - after, 0) + 64
        if self._left < 0:
            raise UnreadableInput(f"{self._file} is damaged from byte {after:,} on: copy it again")
        return after


def _parse_log(pyulog: Any, file: File, topics: Sequence[str] = TOPICS) -> Any:  # noqa: ANN401 - pyulog has no types
    """Read the wanted topics with pyulog, and suppress its output."""
    filled = filled_size(file.path)
    opened = UpTo(file.path, file.size if filled == file.size else _end_of_message(file, filled))
    with redirect_stdout(io.StringIO()), _Bounded(opened, file.name, file.size) as handle:
        return _guarded_parser(pyulog.ULog)(handle, message_name_filter_list=list(topics))


def _guarded_parser(ulog: type[Any]) -> type[Any]:
    """Return a parser that refuses nested definitions with too many columns, like damaged definitions."""
    left = MAX_FIELDS
    whole = ulog._MessageAddLogged  # the only class that creates columns

    class Subscription(whole):  # type: ignore[misc, valid-type]
        def _parse_format(self, message_formats: Mapping[str, Any]) -> None:
            nonlocal left
            left -= _columns(self.message_name, message_formats, left)
            super()._parse_format(message_formats)

    return type("Guarded", (ulog,), {"_MessageAddLogged": Subscription})


def _columns(name: str, formats: Mapping[str, Any], most: int, depth: int = 0) -> int:
    """Count the columns of a topic, without creating them.

    Raises `ValueError` for more than `most`, or if topics nest in a circle.
    """
    total = 0
    for kind, length, _ in formats[name].fields:
        inner = _columns(kind, formats, most, depth + 1) if kind in formats and depth < MAX_DEPTH else 1
        total += max(length, 1) * max(inner, 1)
        if total > most or depth == MAX_DEPTH:
            raise ValueError(f"{name} has more than {most} columns, or nests in a circle")
    return total


def _end_of_message(file: File, filled: int) -> int:
    """End of the message with the last byte before `filled`; messages are followed from the last sync mark on."""
    if file.size <= HEADER:
        return HEADER
    with file.mapped_bytes() as content:
        place = max(content.rfind(SYNC, max(filled - TAIL, 0), filled) + len(SYNC), HEADER)
        while place < filled and place + 3 <= len(content):
            place += 3 + content[place] + (content[place + 1] << 8)
    return place


# what it holds


@dataclass(frozen=True, slots=True, eq=False)
class _Flight:
    """Topics of a log, and the parameters in force in each stage."""

    source: str
    log: Any  # pyulog.ULog
    topics: Topics  # by name and instance
    stages: Stages  # by time in s: the parameters of the compasses and of the board
    auxiliary: Mapping[str, TimeSeries | None]

    @classmethod
    def of(cls, source: str, log: Any) -> _Flight:  # noqa: ANN401 - pyulog has no types
        """Return the topics and stages of a log that pyulog has read."""
        topics = {(one.name, one.multi_id): one.data for one in log.data_list}
        initial = [(-np.inf, *each) for each in log.initial_parameters.items()]
        changed = [(1e-6 * stamp, name, value) for stamp, name, value in log.changed_parameters]
        entries = ((since, name, value) for since, name, value in initial + changed if isinstance(value, (int, float)))
        changes = stages(entries, ("CAL_MAG", "SENS_BOARD"), source, together=CHANGE_WINDOW_S)
        return cls(source, log, topics, changes, {kind: find(topics) for kind, find in AUXILIARY.items()})

    def instances(self, name: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Yield the instances of a topic, in order."""
        for topic, instance in sorted(self.topics):
            if topic == name:
                yield instance, self.topics[topic, instance]

    @property
    def values(self) -> Mapping[str, float]:
        """Parameters at the end of the log, after their last change."""
        return self.stages[-1][1]

    @property
    def satellites(self) -> Mapping[str, Any]:
        """Columns of the satellite receiver; empty without one."""
        return self.topics.get(("vehicle_gps_position", 0)) or self.topics.get(("sensor_gps", 0)) or {}

    @property
    def version(self) -> tuple[int, int] | None:
        """Major and minor number of the release; None if not logged."""
        packed = self.log.msg_info_dict.get("ver_sw_release")
        return (packed >> 24 & 0xFF, packed >> 16 & 0xFF) if isinstance(packed, int) and packed > 0 else None

    @property
    def is_raw(self) -> bool:
        """Whether ``sensor_mag`` is raw, by parameters that only older or newer versions have, else by the version.

        PX4 logs the parameters that it uses, so a log of 1.12 or later with a calibration has the newer ones.
        """
        ends = {name.rpartition("_")[2] for name in self.values if name.startswith("CAL_MAG")}
        if "PRIO" in ends or any(end.endswith("ODIAG") for end in ends):
            return True
        return "EN" not in ends and self.version is not None and self.version >= RAW_SINCE


def _stack(columns: Mapping[str, Any], *names: str) -> Floats:
    """(N, len(names)) columns of a topic; missing ones are NaN."""
    rows = len(columns["timestamp"])
    with np.errstate(invalid="ignore"):  # a damaged log may hold any bits
        return np.column_stack([np.asarray(columns.get(name, np.full(rows, np.nan)), np.float64) for name in names])


def _whole(values: Any) -> NDArray[np.int64]:  # noqa: ANN401 - a column of pyulog
    """Values as integers; values that are no integers, as in a damaged log, become arbitrary ones."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values).astype(np.int64)


def _three(columns: Mapping[str, Any], name: str) -> Floats:
    """(N, 3) columns of an array with three members."""
    return _stack(columns, *(f"{name}[{axis}]" for axis in range(3)))


def _seconds(columns: Mapping[str, Any]) -> Floats:
    """(N,) time of measurement, else of logging, s."""
    logged = np.asarray(columns["timestamp"], np.float64)
    measured = np.asarray(columns.get("timestamp_sample", logged), np.float64)
    return 1e-6 * np.where(measured > 0, measured, logged)


def _motion(topics: Topics, measured: str, change: str) -> TimeSeries | None:
    """Acceleration in m/s² or rate in rad/s, in the axes of the vehicle.

    It comes from ``sensor_combined``, else from the increments of ``vehicle_imu`` divided by their duration.
    """
    combined, imu = topics.get(("sensor_combined", 0)), topics.get(("vehicle_imu", 0))
    if combined is not None:
        return TimeSeries.of(_seconds(combined), _three(combined, measured))
    if imu is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return TimeSeries.of(_seconds(imu), _three(imu, change) / (1e-6 * _stack(imu, f"{change}_dt")))


def _current(topics: Topics) -> TimeSeries | None:
    """Current of the first battery that measures it, A; PX4 writes −1 for an unknown current."""
    for (name, _), columns in sorted(topics.items(), key=lambda item: item[0]):
        if name == "battery_status":
            amperes = _stack(columns, "current_a")
            series = TimeSeries.of(_seconds(columns), np.where(amperes == -1, np.nan, amperes))
            if series is not None:
                return series
    return None


def _throttle(topics: Topics) -> TimeSeries | None:
    """Length of the commanded thrust, 0 to 1; for a VTOL plane, of all its motors."""
    thrust, controls = topics.get(("vehicle_thrust_setpoint", 0)), topics.get(("actuator_controls_0", 0))
    if thrust is not None:
        return TimeSeries.of(
            _seconds(thrust), throttle_shares(np.linalg.norm(_three(thrust, "xyz"), axis=1))[:, np.newaxis]
        )
    return (
        None if controls is None else TimeSeries.of(_seconds(controls), throttle_shares(_stack(controls, "control[3]")))
    )


def _currents(topics: Topics) -> TimeSeries | None:
    """Current of each motor, A, from the speed controllers; None if all are always 0."""
    columns = topics.get(("esc_status", 0))
    if columns is None:
        return None
    count = min(int(np.max(columns.get("esc_count", 0), initial=0)), MAX_CONTROLLERS)
    amperes = _stack(columns, *(f"esc[{place}].esc_current" for place in range(count)))
    return TimeSeries.of(_seconds(columns), amperes) if np.nan_to_num(amperes).any() else None


def _throttles(topics: Topics) -> TimeSeries | None:
    """Commanded throttle of each motor, 0 to 1; 0 for a stopped motor, which PX4 logs as NaN."""
    columns = topics.get(("actuator_motors", 0))
    if columns is None:
        return None
    asked = _stack(columns, *(f"control[{place}]" for place in range(MAX_MOTORS)))
    used = np.flatnonzero((np.nan_to_num(asked) != 0.0).any(axis=0))
    return TimeSeries.of(_seconds(columns), np.nan_to_num(asked[:, : used[-1] + 1])) if len(used) else None


def _attitude(topics: Topics) -> AttitudeSeries | None:
    """Attitude of the estimator in use, from the axes of the vehicle to north, east, down."""
    columns = topics.get(("vehicle_attitude", 0))
    if columns is None:
        return None
    return AttitudeSeries.of(_seconds(columns), _stack(columns, *(f"q[{place}]" for place in range(4))))


AUXILIARY: Final[Mapping[str, Callable[[Topics], TimeSeries | None]]] = {
    ACCELERATION: partial(_motion, measured="accelerometer_m_s2", change="delta_velocity"),
    RATE: partial(_motion, measured="gyro_rad", change="delta_angle"),
    CURRENT: _current,
    THROTTLE: _throttle,
    CURRENTS: _currents,
    THROTTLES: _throttles,
    ATTITUDE: _attitude,
}
"""Function that returns the series of each auxiliary column of `Samples`."""


def named_series(file: File, names: Sequence[str]) -> tuple[dict[str, TimeSeries], list[str]]:
    """Series of fields by name, such as ``battery_status.current_a``, and the names of all fields of their topics.

    ``battery_status[1].current_a`` is the field of instance 1; without a number, it is that of instance 0.
    """
    parts = {name: name.partition(".") for name in names if "." in name}
    topics = {name: topic.partition("[") for name, (topic, _, _) in parts.items()}
    if not topics:
        return {}, []
    pyulog = import_optional("pyulog", "px4", KIND)
    with parser_errors(file.name, KIND):
        log = _parse_log(pyulog, file, sorted({topic for topic, _, _ in topics.values()}))
    data = {(one.name, one.multi_id): one.data for one in log.data_list}
    found, there = dict[str, TimeSeries](), list[str]()
    for name, (topic, _, instance) in topics.items():
        number = instance.rstrip("]") or "0"
        columns = data.get((topic, int(number) if number.isdecimal() else -1), {})
        field = parts[name][2]
        there += [f"{topic}.{each}" for each in columns]
        series = TimeSeries.of(_seconds(columns), _stack(columns, field)) if field in columns else None
        found |= {} if series is None else {name: series}
    return found, there


# the magnetometers


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """Logged readings of one magnetometer, and the parameters whose correction is removed."""

    flight: _Flight
    time: Floats  # (N,), s
    field: Floats  # (N, 3): as logged
    # parameters applied to `field` in each stage of the flight, mounting included; empty for raw readings
    applied: tuple[px4.Px4Parameters, ...] = ()
    # (3, 3): from the axes of raw readings to those of the vehicle; None if unknown
    mounting: Floats | None = None
    is_turned: bool = False  # logged readings are in the axes of the vehicle
    temperature: Floats | None = None  # (N,), °C

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Yield the readings in blocks, raw or as logged; see `Instrument`."""
        turn = np.eye(3) if self.is_turned and as_logged else self.mounting
        back = None if turn is None else turn.T
        of_vehicle = () if turn is not None else (ACCELERATION, RATE, ATTITUDE)
        series = {kind: one for kind, one in self.flight.auxiliary.items() if kind not in of_vehicle}

        def rows(part: slice) -> dict[str, Any]:
            time, field = self.time[part], self.field[part]
            if self.applied and not as_logged:
                field = unapply_stages(self.flight.source, field, stage_of(time, self.flight.stages), self.applied)
            warm = None if self.temperature is None else self.temperature[part]
            return {"field": field, "time": time, "temperature": warm, **resample(series, time, back)}

        return blocks(self.flight.source, GAUSS, len(self.time), rows)

    @property
    def changes(self) -> list[float]:
        """Times at which the applied parameters changed, s since start-up."""
        words = [each.words() for each in self.applied]
        return [self.flight.stages[stage][0] for stage in range(1, len(words)) if words[stage] != words[stage - 1]]


def _sensor_mag(flight: _Flight) -> Iterator[Instrument]:
    """Yield each compass; up to version 1.11 the readings are corrected by the compass's own parameters."""
    for instance, columns in flight.instances("sensor_mag"):
        device = _device(columns)
        parameters = px4.of_device(flight.values, device)
        temperature = _stack(columns, "temperature")[:, 0]
        readings = _Readings(
            flight,
            _seconds(columns),
            _stack(columns, "x", "y", "z"),
            () if flight.is_raw else _applied_parameters(flight, device, turned=False),
            mounting=None if parameters is None else parameters.mounting,
            temperature=temperature if np.isfinite(temperature).any() else None,
        )
        name = f"sensor_mag {instance}" + (f" (device {device})" if device else "")
        yield _instrument(name, readings, parameters, device)


def _vehicle_magnetometer(flight: _Flight) -> Iterator[Instrument]:
    """Yield the compass in use; its readings are corrected by the parameters of the selected compass."""
    for instance, columns in flight.instances("vehicle_magnetometer"):
        readings = _Readings(flight, _seconds(columns), _three(columns, "magnetometer_ga"))
        yield _corrected_instrument(
            f"vehicle_magnetometer {instance}", readings, _device(columns) or _selected_device(flight)
        )


def _sensor_combined(flight: _Flight) -> Iterator[Instrument]:
    """Yield the compass in use of old logs, without repeated readings."""
    columns = flight.topics.get(("sensor_combined", 0), {})
    if "magnetometer_ga[0]" not in columns:
        return
    relative = _whole(columns.get("magnetometer_timestamp_relative", 0))
    measured = _whole(columns["timestamp"]) + relative
    new = (relative != INVALID_RELATIVE) & (np.diff(measured, prepend=-1) != 0)
    readings = _Readings(flight, 1e-6 * measured[new], _three(columns, "magnetometer_ga")[new])
    yield _corrected_instrument("sensor_combined.magnetometer_ga", readings, _selected_device(flight))


def _corrected_instrument(name: str, readings: _Readings, device: int) -> Instrument:
    """Instrument of readings that PX4 corrected and turned; both are undone if the log names the compass."""
    parameters = px4.of_device(readings.flight.values, device)
    readings = replace(readings, is_turned=True, mounting=np.eye(3))
    if parameters is None:
        note = (
            f"the log does not name the calibration applied to {name}: readings are used as logged, corrected and in "
            "the axes of the vehicle"
        )
        return replace(_instrument(name, readings, None, device), notes=(note,), frames=("vehicle", "vehicle"))
    applied = _applied_parameters(readings.flight, device, turned=True)
    readings = replace(readings, applied=applied, mounting=parameters.mounting)
    return replace(_instrument(name, readings, parameters, device), frames=("sensor", "vehicle"))


def _instrument(name: str, readings: _Readings, parameters: px4.Px4Parameters | None, device: int = 0) -> Instrument:
    """Return an instrument with its notes; device 0 means unknown."""
    notes, stored = [], None
    if readings.mounting is None and any(map(readings.flight.auxiliary.get, (ACCELERATION, RATE, ATTITUDE))):
        notes.append(
            "the mounting of this compass is not in the parameters: acceleration, rate and attitude are left out, as "
            "they are in the axes of the vehicle"
        )
    if changes := readings.changes:
        at = ", ".join(f"{since:.0f} s" for since in changes[:3])
        notes.append(
            f"the calibration on board changed at {at}{' …' * (len(changes) > 3)} (since start-up): each "
            "reading is un-applied with the one that was in force"
        )
    if parameters is not None:
        if parameters.motor.any() and readings.applied and readings.is_turned:
            notes.append("COMP is not removed: with running motors, readings include the motor compensation")
        words, is_applied = parameters.words(), bool(readings.applied)
        in_readings = replace(parameters, motor=np.zeros(3)) if readings.is_turned else parameters
        stored = Stored(onboard(in_readings), words, applied=is_applied, changes=len(changes))
    return Instrument(
        readings.flight.source,
        name,
        GAUSS,
        readings.columns,
        stored=stored,
        autopilot="px4",
        compass=None if parameters is None else parameters.compass,
        device_id=device or None,
        mounting=None if parameters is None else parameters.mounting_angles,
        readings=int(np.isfinite(readings.field).all(axis=1).sum()),
        notes=tuple(notes),
    )


def _applied_parameters(flight: _Flight, device: int, *, turned: bool) -> tuple[px4.Px4Parameters, ...]:
    """Parameters applied to a compass in each stage; without the mounting if readings were not turned."""
    applied = []
    for _, values in flight.stages:
        parameters = replace(px4.of_device(values, device) or px4.Px4Parameters(), motor=np.zeros(3))
        if not turned:
            parameters = replace(parameters, rotation=px4.INTERNAL, board=np.eye(3))
        if not np.isfinite(parameters.matrix).all() or np.linalg.matrix_rank(parameters.matrix) < 3:
            raise ArrayError(f"{parameters.words()} cannot be inverted")
        applied.append(parameters)
    return tuple(applied)


def _device(columns: Mapping[str, Any]) -> int:
    """Device id of most readings; 0 if not logged."""
    numbers = Counter(_whole(columns.get("device_id", np.zeros(0))).tolist())
    return int(numbers.most_common(1)[0][0]) if numbers else 0


def _selected_device(flight: _Flight) -> int:
    """Device id of the compass in use, for a topic made from several compasses; 0 if unknown."""
    selection = flight.topics.get(("sensor_selection", 0), {})
    chosen = _device({"device_id": selection["mag_device_id"]}) if "mag_device_id" in selection else 0
    prime = float(flight.values.get("CAL_MAG_PRIME", 0))
    return chosen or (int(prime) % 2**32 if np.isfinite(prime) else 0)


# where, when, and what to know


def _position(flight: _Flight) -> Position | None:
    """First position with a fix."""
    columns = flight.satellites
    if not columns:
        return None
    degrees = _stack(columns, "latitude_deg", "longitude_deg", "altitude_msl_m")
    if "lat" in columns:
        degrees = _stack(columns, "lat", "lon", "alt") * [1e-7, 1e-7, 1e-3]
    fix = np.asarray(columns.get("fix_type", np.full(len(degrees), 3)), np.float64)
    return first_position(*degrees.T, fixed=fix >= 2)


def _velocity(flight: _Flight) -> TimeSeries | None:
    """(N, 2) velocity over ground, north and east, m/s, at fixes in three dimensions."""
    columns = flight.satellites
    if "vel_n_m_s" not in columns:
        return None
    fixed = np.asarray(columns.get("fix_type", np.full(len(columns["timestamp"]), MIN_FIX)), np.float64) >= MIN_FIX
    return TimeSeries.of(_seconds(columns)[fixed], _stack(columns, "vel_n_m_s", "vel_e_m_s")[fixed])


def _start_time(flight: _Flight) -> datetime | None:
    """UTC of the start of the log, by the satellites' clock."""
    columns = flight.satellites
    utc = np.asarray(columns.get("time_utc_usec", np.zeros(0)), np.float64)
    known = np.flatnonzero(utc > 0)
    if not len(known):
        return None
    since = float(utc[known[0]]) - (float(columns["timestamp"][known[0]]) - flight.log.start_timestamp)
    if not 0 < since < 1e16:
        return None
    begun = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=since)
    return begun if EARLIEST < begun < LATEST else None


def _damage(file: File, flight: _Flight) -> Iterator[str]:
    """Yield notes on missing parts."""
    reserved = file.size - filled_size(file.path)
    if reserved:
        yield reserved_words(reserved)
    if flight.log.file_corruption:
        yield "parts of the file are damaged and were left out: copy it again if you can"
    elif not reserved and not flight.log.has_data_appended and _end_of_message(file, file.size) != file.size:
        yield "the file ends within a message, as after a loss of power: all before it was read"
    if lost := flight.log.dropouts:
        seconds = 1e-3 * sum(one.duration for one in lost)
        yield f"the logger lost {figures(seconds)} s in {count_text(len(lost), 'dropout')}"


READERS: Final = (
    Reader(
        "ulog",
        "PX4 ULog",
        (".ulg",),
        "each compass, with the calibration in force removed, and attitude, motors and other columns",
        starts=(MAGIC,),
        log=open_ulog,
        extra="px4",
    ),
)
