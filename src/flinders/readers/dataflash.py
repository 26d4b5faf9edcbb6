r"""ArduPilot's DataFlash logs, ``.bin`` or turned into text as ``.log``: every compass, with what stood beside it.

A vehicle logs corrected readings, m = I ((r + OFS) SCALE) + MOT x, in whole mG and in its own axes, and beside each of
them OFS and MOT x. What the compass read is

    r = I⁻¹ (m − MOT x) / SCALE − OFS

with DIA, ODI and SCALE from the parameters in force at the time. OFS is cut to whole mG in the message; where the
parameter is what was cut, the parameter is taken.

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
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import BLOCK, Samples
from flinders.core.units import Unit
from flinders.errors import NoMagnetometer, UnreadableInput, counted
from flinders.geometry.quaternions import of_angles
from flinders.readers._ardupilot import IN_VEHICLE_AXES, History, mounting_told, stored, unapplied, unused
from flinders.readers._fmt import HEADER, Listed, Messages, read_listed, read_packed
from flinders.readers._log import Instrument, Log, Position
from flinders.readers._names import ACCELERATION, ATTITUDE, CURRENT, CURRENTS, RATE, TEMPERATURE, THROTTLE, THROTTLES
from flinders.readers._reader import Reader
from flinders.readers._resample import AttitudeSeries, TimeSeries, as_column
from flinders.readers._source import refusal
from flinders.readers._tokenizer import encoding_of
from flinders.targets.ardupilot import COMPASSES, ArduPilotParameters, device_id

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.readers._fmt import Table
    from flinders.readers._source import File

FORMAT: Final = "ArduPilot DataFlash"
COMPASS_NAMES: Final = ("MAG", "MAG2", "MAG3")
"""Messages of compasses: all in MAG with an instance I, or, in older logs, one name each."""
QUATERNIONS: Final = ("XKQ", "XKQ1", "NKQ", "NKQ1")
"""Messages with the attitude of the estimator: of EKF 3 and EKF 2, in older logs one name a core."""
ANGLES: Final = ("ATT", "AHR2")
"""Messages with roll, pitch and yaw in degrees: what the vehicle went by, and its second estimator."""
PRIMARY: Final = {"XKQ": "XKF4", "NKQ": "NKF4"}
"""Where each estimator says which of its cores is used."""
THROTTLE_LABELS: Final = {"CTUN": ("ThO", "ThrOut"), "THR": ("ThrOut",)}
"""Messages with the throttle that goes to the motors, and what it is called."""
CONTROLLERS: Final = ("ESC", *(f"ESC{number}" for number in range(1, 9)))
"""Messages of speed controllers: of all in ESC with an instance, or, in older logs, one name each."""
OUTPUTS: Final = "RCOU"
"""Message with what goes to each output, as the width of a pulse in µs."""
MOTOR_FUNCTIONS: Final = {float(code): place for place, code in enumerate((*range(33, 41), *range(82, 86)))}
"""Which motor, from 0, an output drives whose ``SERVOn_FUNCTION`` is this."""
PULSES_US: Final = (1000.0, 2000.0)
"""Widths that ask a motor for nothing and for all, where ``MOT_PWM_MIN`` and ``MOT_PWM_MAX`` do not say."""
NO_PULSE_US: Final = 500.0
"""Below is no pulse."""
WANTED: Final = (
    *COMPASS_NAMES, "IMU", "BAT", "CURR", "PARM", "GPS", "POS", "ORGN", "MSG", *QUATERNIONS, *ANGLES,
    *PRIMARY.values(), *THROTTLE_LABELS, *CONTROLLERS, OUTPUTS,
)  # fmt: skip
CLOCKS: Final = ("TimeUS", "TimeMS")
INSTANCE: Final = ("I", "Instance", "Inst")
BEGINS: Final = re.compile(rb"\A\xa3\x95|^FMT\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,", re.MULTILINE)
"""First bytes: a message, or a line that describes messages."""

NEARBY: Final = 64
"""Messages of another kind that are read before and after those of a block, to interpolate between."""
STRAY_SHARE: Final = 0.5
"""A log of which more than this belongs to no message is refused."""

FIX: Final = 3
"""GPS.Status from which on there is a position."""
HIGHEST_M: Final = 1e5
"""An altitude beyond is none."""
LAST_WEEK, WEEK_MS = 10_000, 604_800_000
"""Weeks of GPS up to the year 2171, and milliseconds of one: what is beyond is no date."""
GPS_EPOCH: Final = datetime(1980, 1, 6, tzinfo=UTC)
LEAPS: Final = ((datetime(2017, 1, 1, tzinfo=UTC), 18), (datetime(2015, 7, 1, tzinfo=UTC), 17))
"""Seconds by which GPS time is ahead of UTC from a day on; before, 16 (since July 2012)."""
EARLIER_LEAP: Final = 16
MOST_MOTORS: Final = 32
UNITY, PER_CENT, PER_MILLE = 1.0, 0.01, 0.001
MOST_THROTTLE: Final = ((1.5, UNITY), (150.0, PER_CENT), (np.inf, PER_MILLE))
"""Up to which largest value of a log a throttle is a share, per cent or per mille: no message says it."""


def open_dataflash(file: File) -> Log:
    """Open a log: find its messages, its compasses, and what was in force.

    Raises
    ------
    UnreadableInput
        For a file that cannot be read, or is mostly something else.
    NoMagnetometer
        For a log without readings of a compass.
    """
    messages = _messages(file)
    compasses = _compasses(messages)
    if not compasses:
        raise NoMagnetometer(
            f"{file.name} is an ArduPilot log without readings of a compass (MAG): turn on Compass in LOG_BITMASK and "
            "record again"
        )
    history = _history(messages.get("PARM"), file.name)
    auxiliary = _auxiliary(messages, history.last)
    instruments = tuple(_instrument(file, name, number, mag, history, auxiliary) for name, number, mag in compasses)
    damage = tuple(_damage(messages, file.size))
    return Log(
        file.name,
        FORMAT,
        instruments,
        position=_position(messages),
        begun=_begun(messages, instruments),
        notes=(*_notes(messages), *damage),
        damage=damage,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Compass:
    """What the readings of a compass are made of.

    Attributes
    ----------
    source : str
    mag : Table
        Its messages.
    version : (N,) int
        How many changes of parameters came before each.
    parameters : dict of ArduPilotParameters
        By number of changes.
    auxiliary : tuple of _Auxiliary
    """

    source: str
    mag: Table
    version: NDArray[np.intp]
    parameters: dict[int, ArduPilotParameters]
    auxiliary: tuple[_Auxiliary, ...]

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Go through the readings; see `Instrument`."""
        for start in range(0, len(self.mag), BLOCK):
            rows = slice(start, start + BLOCK)
            part = self.mag.only(rows).copied()
            time = _clock(part)
            field = _triple(part, "Mag") if as_logged else self._raw(part, self.version[rows])
            more: dict[str, Any] = {}
            if time is not None:
                tables = {id(table): table for each in self.auxiliary for table in each.tables}
                near = {key: _near(table, part.where, time) for key, table in tables.items()}
                more = {each.name: each.at(near, time) for each in self.auxiliary}
            yield Samples.of(field, unit="mG", time=time, source=self.source, **more)

    def offsets(self, part: Table, version: NDArray[np.intp]) -> Floats:
        """(N, 3) OFS of each reading in mG: the parameter where the message holds its whole part, else the message."""
        if not _has(part, "Ofs"):
            return np.array([self.parameters[each].offset for each in version]).reshape(-1, 3)
        offsets = _triple(part, "Ofs")
        for each in set(version.tolist()):
            exact = self.parameters[each].offset
            rows = (version == each) & np.all(np.trunc(exact) == offsets, axis=1)
            offsets[rows] = exact
        return offsets

    def motor_offsets(self, part: Table) -> Floats:
        """(N, 3) MOT x of each reading, mG."""
        for prefix in ("MO", "MOfs"):
            if _has(part, prefix):
                return _triple(part, prefix)
        return np.zeros((len(part), 3))

    def _raw(self, part: Table, version: NDArray[np.intp]) -> Floats:
        """(N, 3) what the compass read, in mG and in the axes of the vehicle."""
        without = {each: replace(own, offset=np.zeros(3)) for each, own in self.parameters.items()}
        centred = unapplied(self.source, _triple(part, "Mag"), version, without, self.motor_offsets(part))
        return centred - self.offsets(part, version)


@dataclass(frozen=True, slots=True, eq=False)
class _Auxiliary:
    """What other messages hold of one column of `Samples`: the only one of its kind, or one for each motor."""

    name: str
    tables: tuple[Table, ...]
    labels: tuple[str, ...]
    convert: Callable[[Floats], Floats] = np.asarray  # as logged to the unit of `Samples`

    def at(self, near: Mapping[int, tuple[Table, Floats]], time: Floats) -> Floats:
        """(N,) or (N, k) at these times, of the messages that are `near` in each table and their times."""
        return as_column(self.name, np.hstack([self._resampled(*near[id(table)], time) for table in self.tables]))

    def _resampled(self, table: Table, clock: Floats, time: Floats) -> Floats:
        logged = self.convert(np.column_stack([table.column(label) for label in self.labels]))
        kind = AttitudeSeries if self.name == ATTITUDE else TimeSeries
        series = kind.of(clock, logged)
        if series is None:
            return np.full((len(time), logged.shape[1]), np.nan)
        return series.until_next(time) if self.name == RATE else series.at(time)


def _near(table: Table, where: NDArray[np.int64], time: Floats) -> tuple[Table, Floats]:
    """Messages next to these (N,) times, whose own messages are at `where`, and their (M,) times in s."""
    first, last = np.searchsorted(table.where, [where[0], where[-1]])
    near = table.only(slice(max(int(first) - NEARBY, 0), int(last) + NEARBY))
    clock = _seconds(near)
    after = np.clip(np.searchsorted(np.maximum.accumulate(clock), time), 1, max(len(clock) - 1, 1))
    close = np.zeros(len(clock), bool)
    for place in (after - 1, after, after + 1):
        close[np.minimum(place, len(clock) - 1)] = True
    return near.only(close).copied(), clock[close]


def _messages(file: File) -> Messages:
    """Find the messages of a log, binary or text."""
    if not file.head().startswith(HEADER):
        encoding = encoding_of(file.head())
        numbered = (
            (stretch.first + place, line)
            for stretch in file.lines(encoding)
            for place, line in enumerate(stretch.texts)
        )
        return read_listed(numbered, WANTED)
    try:
        raw = np.memmap(file.path, np.uint8, "r").view(np.ndarray)
    except (OSError, ValueError) as error:
        raise refusal(file.name, error) from None
    messages = read_packed(raw, WANTED)
    if messages.strays > STRAY_SHARE * len(raw):
        raise UnreadableInput(
            f"{file.name} begins as an ArduPilot log, and {messages.strays:,} of its {len(raw):,} bytes belong to no "
            "message that it describes: it is broken or cut at its beginning; copy it again"
        )
    return messages


def _compasses(messages: Messages) -> list[tuple[str, int, Table]]:
    """Name, number from 1, and messages of each compass that says something."""
    compasses: list[tuple[str, int, Table]] = []
    for place, name in enumerate(COMPASS_NAMES, 1):
        table = messages.get(name)
        if table is None or not _has(table, "Mag"):
            continue
        if (clock := _clock(table)) is not None:
            table = table.only(np.isfinite(clock))
        label = _label(table, INSTANCE)
        if label is None:
            compasses += [(name, place, table)] * bool(len(table))
            continue
        table = table.only(np.isin(table.column(label), np.arange(256)))
        instances = table.column(label)
        for each in np.unique(instances):
            compasses.append((f"{name} {each:.0f}", int(each) + 1, table.only(instances == each)))
    return compasses


def _instrument(
    file: File, name: str, number: int, mag: Table, history: History, auxiliary: tuple[_Auxiliary, ...]
) -> Instrument:
    """Make an instrument of a compass."""
    mag, ill = _healthy(mag)
    version = history.change(mag.where)
    known = number if number in COMPASSES else 0
    parameters = {
        each: ArduPilotParameters.read(history.at(each), known) if known else ArduPilotParameters()
        for each in set(version.tolist())
    }
    compass = _Compass(file.name, mag, version, parameters, auxiliary)
    end = mag.only(slice(len(mag) - 1, len(mag)))
    in_force = replace(parameters[int(version[-1])], offset=compass.offsets(end, version[-1:])[0])
    clock = _clock(mag.only(slice(0, 1)))
    return Instrument(
        file.name,
        name,
        Unit.of("mG"),
        compass.columns,
        stored=stored(in_force),
        frames=IN_VEHICLE_AXES,
        autopilot="ardupilot",
        compass=known or None,
        device_id=device_id(history.last, known) if known else None,
        beginning=np.nan if clock is None else float(clock[0]),
        readings=len(mag),
        notes=tuple(_remarks(compass, in_force, history.last, number, ill)),
        file=file,
    )


def _remarks(
    compass: _Compass, in_force: ArduPilotParameters, values: dict[str, float], number: int, ill: int
) -> Iterator[str]:
    """What to know about a compass."""
    yield mounting_told(in_force, values, number)
    yield "readings were logged in whole mG, cut towards zero"
    mag = compass.mag.copied()
    offsets, motor = compass.offsets(mag, compass.version), compass.motor_offsets(mag)
    changes = int(np.count_nonzero(np.any(np.diff(offsets, axis=0), axis=1) | (np.diff(compass.version) > 0)))
    if changes:
        yield f"its parameters changed {counted(changes, 'time')}: each reading has those of its time taken off"
    elif in_force.is_identity and not motor.any():
        yield "no calibration was in force: readings are as they were measured"
    if np.any(offsets[-1] != compass.parameters[int(compass.version[-1])].offset):
        yield (
            "the offsets logged beside its readings are not those of its parameters, and are taken instead: they were "
            "learned on the way, or DIA, ODI and SCALE are those of another compass"
        )
    if motor.any():
        largest = float(np.linalg.norm(motor, axis=1).max())
        order = "" if np.array_equal(in_force.iron, np.eye(3)) else ", as newer firmware adds it: after DIA and ODI"
        yield f"its motor compensation of up to {largest:.0f} mG is taken off{order}"
    if ill:
        yield f"{counted(ill, 'reading')} of an unhealthy compass left out"
    if off := unused(values, number):
        yield off


def _healthy(mag: Table) -> tuple[Table, int]:
    """Leave out what was logged while the compass did not answer, unless that is everything; and count it."""
    if "Health" not in mag.labels:
        return mag, 0
    well = mag.column("Health") != 0
    return (mag.only(well), int((~well).sum())) if well.any() else (mag, 0)


def _history(parm: Table | None, source: str) -> History:
    """Parameters of the log, as they were told."""
    if parm is None or not {"Name", "Value"} <= set(parm.labels):
        return History()
    return History.of(zip(parm.where.tolist(), parm.texts("Name"), parm.column("Value").tolist(), strict=True), source)


def _auxiliary(messages: Messages, values: dict[str, float]) -> tuple[_Auxiliary, ...]:
    """Find what was logged beside readings: the first IMU, the first battery, throttle, motors and attitude."""
    others = (_battery(messages), _throttle(messages), _attitude(messages, values), _throttles(messages))
    columns = [*_imu(_first(messages.get("IMU"))), *filter(None, (*others, _currents(messages)))]
    return tuple(each for each in columns if all(len(table) and _label(table, CLOCKS) for table in each.tables))


def _imu(table: Table | None) -> Iterator[_Auxiliary]:
    """Acceleration, rate and temperature of an IMU, as far as it has them."""
    for name, prefix in ((ACCELERATION, "Acc"), (RATE, "Gyr")):
        if table is not None and _has(table, prefix):
            yield _Auxiliary(name, (table,), tuple(f"{prefix}{axis}" for axis in "XYZ"))
    if table is not None and (label := _label(table, ("T", "Temp"))):
        yield _Auxiliary(TEMPERATURE, (table,), (label,))


def _battery(messages: Messages) -> _Auxiliary | None:
    """The current of the first battery, unless it never says that any flows."""
    table = _first(messages.get("BAT") or messages.get("CURR"))
    if table is None or "Curr" not in table.labels or not np.nan_to_num(table.column("Curr")).any():
        return None
    return _Auxiliary(CURRENT, (table,), ("Curr",), _times(PER_CENT if table.is_whole("Curr") else UNITY))


def _times(factor: float) -> Callable[[Floats], Floats]:
    return partial(np.multiply, factor)


def _currents(messages: Messages) -> _Auxiliary | None:
    """The current of each motor, from the first on, where a speed controller ever says that any flows."""
    tables: list[Table] = []
    for place in range(MOST_MOTORS):
        table = (
            messages.get(f"ESC{place + 1}") if (of_all := messages.get("ESC")) is None else _of_instance(of_all, place)
        )
        if table is None or not len(table) or "Curr" not in table.labels or _clock(table) is None:
            break
        tables.append(table)
    flows = any(np.nan_to_num(table.column("Curr")).any() for table in tables)
    return _Auxiliary(CURRENTS, tuple(tables), ("Curr",)) if flows else None


def _of_instance(table: Table, instance: int) -> Table | None:
    """Messages of one instance; None where the table does not tell them apart."""
    label = _label(table, INSTANCE)
    return None if label is None else table.only(table.column(label) == instance)


def _throttles(messages: Messages) -> _Auxiliary | None:
    """What each motor was asked for, where parameters say which outputs drive the motors, from the first on."""
    table, parm = messages.get(OUTPUTS), messages.get("PARM")
    if table is None or parm is None or not {"Name", "Value"} <= set(parm.labels):
        return None
    values = {
        name: value
        for name, value in zip(parm.texts("Name"), parm.column("Value").tolist(), strict=True)
        if name.startswith(("SERVO", "MOT_PWM"))
    }
    of_output = {number: MOTOR_FUNCTIONS.get(values.get(f"SERVO{number}_FUNCTION", 0.0)) for number in range(1, 33)}
    outputs = {motor: f"C{number}" for number, motor in of_output.items() if motor is not None}
    labels = tuple(outputs[motor] for motor in range(len(outputs)) if motor in outputs)
    if not labels or len(labels) < len(outputs) or not set(labels) <= set(table.labels):
        return None
    pulses = values.get("MOT_PWM_MIN", 0.0), values.get("MOT_PWM_MAX", 0.0)
    least, most = pulses if 0.0 < pulses[0] < pulses[1] else PULSES_US
    return _Auxiliary(THROTTLES, (table,), labels, partial(_asked, least=least, most=most))


def _asked(widths: Floats, least: float, most: float) -> Floats:
    """Turn widths of pulses into shares: none where a pulse is shorter than the shortest."""
    return np.where(widths < NO_PULSE_US, np.nan, np.maximum(widths - least, 0.0) / (most - least))


def _throttle(messages: Messages) -> _Auxiliary | None:
    """What the motors were asked for: copters write a share, older ones per mille, planes and rovers per cent."""
    for name, labels in THROTTLE_LABELS.items():
        table = messages.get(name)
        label = None if table is None else _label(table, labels)
        if table is None or label is None:
            continue
        logged = table.column(label)
        logged = logged[np.isfinite(logged)]
        if not logged.any():
            continue
        largest = float(logged.max())
        factor = next(factor for most, factor in MOST_THROTTLE if largest <= most)
        return _Auxiliary(THROTTLE, (table,), (label,), _times(factor))
    return None


def _attitude(messages: Messages, values: dict[str, float]) -> _Auxiliary | None:
    """The attitude of the estimator that is used: its quaternion where it is logged, else angles."""
    names = sorted(QUATERNIONS, key=lambda name: (name[0] == "X") == (values.get("AHRS_EKF_TYPE", 3) == 2))
    for name in names:
        table = messages.get(name)
        labels = tuple(f"Q{place}" for place in range(1, 5))
        if table is not None and set(labels) <= set(table.labels) and _label(table, CLOCKS):
            return _Auxiliary(ATTITUDE, (_of_primary(table, messages.get(PRIMARY.get(name, ""))),), labels)
    for name in ANGLES:
        table = messages.get(name)
        labels = ("Roll", "Pitch", "Yaw")
        if table is not None and set(labels) <= set(table.labels):
            return _Auxiliary(ATTITUDE, (table,), labels, lambda angles: of_angles(np.deg2rad(angles)))
    return None


def _of_primary(quaternions: Table, state: Table | None) -> Table:
    """Those of the core that was used at the time, where its estimator says which; else of the first."""
    if "C" not in quaternions.labels:
        return quaternions
    core = quaternions.column("C")
    used = np.full(len(core), core.min())
    if state is not None and "PI" in state.labels:
        cores = state.column("PI")
        used = cores[np.maximum(np.searchsorted(state.where, quaternions.where, side="right") - 1, 0)]
    return quaternions.only(core == used) if (core == used).any() else quaternions.only(core == core.min())


def _position(messages: Messages) -> Position | None:
    """Where the log was made: the origin of its navigation, else its first position, else its first fix."""
    for name in ("ORGN", "POS", "GPS"):
        table = messages.get(name)
        if table is None or not {"Lat", "Lng"} <= set(table.labels):
            continue
        where = np.column_stack([table.column(label) for label in ("Lat", "Lng")])
        usable = np.all(np.isfinite(where) & (np.abs(where) <= [90, 180]), axis=1) & np.any(where != 0, axis=1)
        if name == "GPS" and "Status" in table.labels:
            usable &= table.column("Status") >= FIX
        if usable.any():
            row = int(np.argmax(usable))
            altitude = float(table.column("Alt")[row]) if "Alt" in table.labels else 0.0
            latitude, longitude = where[row].tolist()
            return Position(latitude, longitude, altitude if abs(altitude) < HIGHEST_M else 0.0)
    return None


def _begun(messages: Messages, instruments: tuple[Instrument, ...]) -> datetime | None:
    """UTC of the first reading, from the first GPS fix."""
    gps = messages.get("GPS")
    if gps is None:
        return None
    week, since = _label(gps, ("GWk", "Week")), _label(gps, ("GMS", "TimeMS"))
    own = "TimeUS" if "TimeUS" in gps.labels else "T"
    if week is None or since is None or own not in gps.labels or "Status" not in gps.labels:
        return None
    weeks, of_week, clock = gps.column(week), gps.column(since), gps.column(own)
    fixed = (gps.column("Status") >= FIX) & (weeks > 0) & (weeks < LAST_WEEK)
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
    """What to know about the file."""
    texts = messages.get("MSG")
    if texts is not None and "Message" in texts.labels:
        yield f"firmware: {texts.texts('Message')[0]}"
    if messages.get("PARM") is None:
        yield "no parameters were logged: DIA, ODI and SCALE are taken to be as they were delivered"


def _damage(messages: Messages, size: int) -> Iterator[str]:
    """What of it could not be read."""
    if messages.strays:
        listed = isinstance(next(iter(messages.tables.values())), Listed)
        kind = "line" if listed else "byte"
        of = "" if listed else f" of {size:,}"
        places = counted(messages.gaps, "place")
        yield f"{counted(messages.strays, kind)}{of} in {places} belong to no message: skipped"


def _first(table: Table | None) -> Table | None:
    """Messages of the first instance."""
    if table is None or (label := _label(table, INSTANCE)) is None:
        return table
    instances = table.column(label)
    return table.only(instances == instances.min())


def _label(table: Table, labels: tuple[str, ...]) -> str | None:
    return next((label for label in labels if label in table.labels), None)


def _has(table: Table, prefix: str) -> bool:
    return all(f"{prefix}{axis}" in table.labels for axis in "XYZ")


def _triple(table: Table, prefix: str) -> Floats:
    """(N, 3) of the fields that begin so."""
    return np.column_stack([table.column(f"{prefix}{axis}") for axis in "XYZ"])


def _clock(table: Table) -> Floats | None:
    """(N,) s since the vehicle was turned on, where it is logged."""
    return _seconds(table) if _label(table, CLOCKS) else None


def _seconds(table: Table) -> Floats:
    """(N,) s since the vehicle was turned on."""
    label = "TimeUS" if "TimeUS" in table.labels else "TimeMS"
    return table.column(label) * (1e-6 if label == "TimeUS" else 1e-3)


READERS: Final = (
    Reader(
        "dataflash",
        "ArduPilot DataFlash",
        (".bin", ".log"),
        "each compass, with the calibration in force taken off, and what the vehicle logged beside it",
        pattern=BEGINS,
        log=open_dataflash,
    ),
)
