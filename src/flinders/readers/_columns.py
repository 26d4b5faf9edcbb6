"""Which columns of a table are the magnetometer, and what stands beside it.

>>> chosen = by_name(["t_s", "mag_x_mG", "mag_y_mG", "mag_z_mG"], np.zeros((2, 4)))
>>> chosen.field.cells, chosen.field.names, chosen.unit, chosen.time.names
((1, 2, 3), ('mag_x_mG', 'mag_y_mG', 'mag_z_mG'), 'mG', ('t_s',))
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np

from flinders.core.samples import COLUMNS, Samples
from flinders.core.units import COUNTS, Unit
from flinders.errors import NoMagnetometer, UnitError, UsageError, did_you_mean, figures
from flinders.geometry import quaternions
from flinders.readers._likeness import advice, ascends, groups, has_clock, only_rises
from flinders.readers._names import (
    ACCELERATION,
    ATTITUDE,
    BARE,
    CURRENT,
    CURRENTS,
    FACTORS,
    FACTORS_OF_MOTORS,
    FIELD,
    FIRST,
    RATE,
    STRENGTH,
    TEMPERATURE,
    THROTTLE,
    THROTTLES,
    TIME,
    Choice,
    Form,
    Meaning,
    Vector,
    clearness,
    companion,
    instruments,
    is_letter_of_time,
    is_like_time,
    kind_of_chip,
    label,
    meaning,
    numbered,
    passed_over,
    polarities,
    tells_nothing,
    unit_of_field,
    unit_of_strength,
    vectors,
    without_set,
)
from flinders.readers._resample import shares
from flinders.readers._tokenizer import listed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import TimeSpan
    from flinders.readers._clock import Clock
    from flinders.readers._devices import Device
    from flinders.readers._source import Source

Values: TypeAlias = "NDArray[np.floating] | Sequence[NDArray[np.floating]]"
"""(N,) numbers of each column that is read."""
OF_MOTORS: Final = (CURRENTS, THROTTLES)  # kinds of which each motor may have a column
IN_SAMPLES: Final = COLUMNS[1:]  # kinds that stand beside the field
VALID: Final = {THROTTLE: shares, THROTTLES: shares, ATTITUDE: quaternions.known}  # values out of range become NaN
SHARES: Final = ("share", "percent", "pct", "%")  # units of a throttle that count from 0; pulses count from `REST_US`
REST_US: Final = 1000.0  # pulse that asks a motor for nothing; a thousand more asks for all
PULSES_US: Final = (800.0, 2200.0)  # shortest and longest of such pulses
# From which value on a time counts from 1970, in ns, µs, ms and s; four times it is the year 2096.
EPOCHS: Final = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))
COARSE: Final = 10  # readings to one time from which on its digits are too few: buffers of sensors give a few at once
COARSE_S: Final = 1.0  # resolution from which on a time that never changes is cut, and its clock not at rest
TEMPERATURES_C: Final = (-60.0, 150.0)  # what a sensor may have
FEWEST_TIMES: Final = 10  # rows from which on a column is looked at for whether it rises
RARE: Final = 0.1  # of the steps of a clock that is set back or begins again
REGULAR: Final = 0.25  # by how much of it the number of readings to each time varies
FALLS: Final = "it does not rise as a time does"
LAST: Final = 9  # rank of a time that no name calls one
NANOSECONDS: Final = re.compile(r"(.*?)(?:n|nano)(secs?)\b(.*)", re.IGNORECASE)
"""The column behind the one of whole seconds, as messages of ROS have both."""
ON_BOARD: Final = re.compile(r"(?:Ofs|MO)[XYZ]")
"""Columns of a message ``MAG`` of ArduPilot: the compass's own offsets, and those of the motors' current."""
FASTEST_RAD_S: Final = 70.0  # 4,000 °/s: what gyros measure up to, and no hand turns a sensor at
APART: Final = 4  # rows over which a turn goes on, and noise does not grow
GROWS: Final = 2.0  # times that readings so far apart differ more than neighbours, from which on they are of a turn
OF_ROS: Final = ("magnetic_field.x", "magnetic_field/x")  # ends of names whose unit sensor_msgs defines, tesla
LONG: Final = 1e8  # seconds after which a time is taken to count from 1970 and not from the start of the recording

TURNED: Final = 3.0  # times that set plus reset spreads wider than their difference where both have one sign
RAW_NAME: Final = re.compile(r"raw|uncal", re.IGNORECASE)
"""What names of readings have that nobody corrected."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column, or three of one sensor, or one of each motor."""

    kind: str  # as in `Meaning`
    cells: tuple[int, ...]  # places in a line, counted from 0: x, y, z, or motor by motor
    names: tuple[str, ...]  # as in the header, or numbers counted from 1
    factor: float = 1.0  # from its unit to the unit used inside
    start: float = 0.0  # subtracted first, in its own unit
    unit: str = ""  # of a strength whose name states one; else it is in the unit of the field
    axes: tuple[int, ...] = (0, 1, 2)  # which axes two columns of a level recording are; the third is 0
    clock: Clock | None = None  # how a time is read that is no number


@dataclass(frozen=True)
class Columns:
    """The columns that are read."""

    field: Column  # the magnetometer
    unit: str = ""  # its unit as the header states it, or as the format has it by convention
    stated: bool = False  # the unit is in the header, and must not be contradicted
    auxiliary: tuple[Column, ...] = ()  # at most one of each other kind
    left_out: tuple[str, ...] = ()  # columns that were recognised and cannot be used, each with the reason
    unread_time: str = ""  # names of columns that are called as a time, where none is read
    name: str = ""  # of one of several magnetometers in a table
    magnetometers: tuple[Columns, ...] = ()  # those of each of several magnetometers, in order
    others: tuple[str, ...] = ()  # numbers and names of the other magnetometers, where nobody has said which is meant
    passed_over: tuple[str, ...] = ()  # what is named like a magnetometer and is none of its own, with what it is
    form: Form | None = None  # where they were asked for, how the table is recognised
    reset: Column | None = (
        None  # what a sensor with set and reset pulses read after a reset, where `field` is after a set
    )
    own_offset: tuple[float, ...] = ()  # (3,) of such a sensor, in its unit: half of set plus reset, of the first rows
    device: Device | None = None  # whose rows are read, where a column tells several devices apart
    is_assumed: bool = False  # nobody says that they are a magnetometer's, neither their names nor the user

    @property
    def time(self) -> Column | None:
        """When each reading was taken, where that is known."""
        return self.of_kind(TIME)

    @property
    def clock(self) -> Clock | None:
        """How the time is read where it is no number."""
        return self.time.clock if self.time else None

    def of_kind(self, kind: str) -> Column | None:
        """Find the column of a kind."""
        return next((column for column in self.auxiliary if column.kind == kind), None)

    def only(self, *kinds: str) -> Columns:
        """The field, and of what stands beside it only some kinds."""
        return replace(self, auxiliary=tuple(column for column in self.auxiliary if column.kind in kinds))

    @cached_property
    def cells(self) -> tuple[int, ...]:
        """All places in a line that are read, in order."""
        columns = (self.field, *self.auxiliary, *filter(None, [self.reset]))
        return tuple(sorted({cell for column in columns for cell in column.cells}))

    @property
    def needed(self) -> frozenset[int]:
        """Those without which a line cannot be used: the field, in both polarities where there are two."""
        return frozenset((*self.field.cells, *(self.reset.cells if self.reset else ())))

    def with_strength_in(self, unit: Unit) -> Columns:
        """Scale the column of strengths to the unit of the field; without it where the two have nothing in common."""
        strength = self.of_kind(STRENGTH)
        if strength is None or not strength.unit:
            return self
        own, others = Unit.of(strength.unit), tuple(column for column in self.auxiliary if column is not strength)
        if own.inside == unit.inside:
            return replace(self, auxiliary=(*others, replace(strength, factor=own.scale / unit.scale)))
        reason = f"{strength.names[0]} (in {own.inside}, the field in {unit.inside}: give its unit or scale)"
        return replace(self, auxiliary=others, left_out=(*self.left_out, reason))

    def in_told(self, unit: str) -> Columns:
        """The same where the table says elsewhere than in names in which unit the field is; what they say stays."""
        told = self if self.unit else replace(self, unit=unit, stated=True, is_assumed=False)
        return replace(told, magnetometers=tuple(each.in_told(unit) for each in self.magnetometers))

    def in_given(self, unit: str | None, scale: float | None) -> Columns:
        """The same where the user says which unit of a field they are in."""
        return self if unit is None and scale is None else replace(self, is_assumed=False)

    def taken(self, values: Values, column: Column) -> Floats:
        """(N, k) numbers of one of the columns, from values of `cells`."""
        return np.stack([values[self.cells.index(cell)] for cell in column.cells], axis=1, dtype=np.float64)

    def readings(self, values: Values) -> Floats:
        """(N, 3) field as recorded, from values of `cells`; where set and reset are recorded, half their difference."""
        field = self.taken(values, self.field)
        if self.reset is not None:
            field = (field - self.taken(values, self.reset)) / 2.0
        if len(self.field.cells) == 2:
            level = np.zeros((len(field), 3))
            level[:, self.field.axes] = field
            field = level
        return field

    def describe(self, unit: str) -> str:
        """Say which columns are read, in which unit; of several magnetometers, which one."""
        return f"{f'{self.name}, ' if self.name else ''}{self.contents(unit)}"

    def contents(self, unit: str) -> str:
        """Say which columns are read, in which unit."""
        time = f", time in {' and '.join(self.time.names)}" if self.time else ""
        chip = next((word for word in label(self.field.names[0]) if kind_of_chip(word) == FIELD), "")
        known = f" ({chip.upper()} is a magnetometer)" if chip else ""
        less = f" less {', '.join(self.reset.names)}, halved," if self.reset else ""
        rows = f", of rows with {' '.join(self.device.words)}" if self.device and not self.name else ""
        return f"columns {', '.join(self.field.names)}{less}{known} in {unit}{time}{rows}"

    def remarks(self) -> list[str]:
        """Say what is left out, which other magnetometers there are, and what is named like one."""
        parts = [f"left out {', '.join(self.left_out)}"] * bool(self.left_out)
        own = ", ".join(figures(value) for value in self.own_offset)
        parts += [f"the sensor's own offset, (set + reset) / 2, was {own} at the beginning"] * bool(own)
        parts += [f"also there: {numbered(self.others)} (choose with --sensor)"] * bool(self.others)
        return parts + [f"passed over: {numbered(self.passed_over)}"] * bool(self.passed_over)

    def samples(self, values: Values, *, unit: Unit, axes: Axes, source: str, frame: str = "sensor") -> Samples:
        """Make samples of values of `cells`: the field, and its auxiliary columns in the units of `Samples`."""
        field = self.readings(values)
        others = {each.kind: self._values_of(values, each) for each in self.auxiliary if each.kind in IN_SAMPLES}
        nameless = ",".join(self.field.names) * self.is_assumed
        return Samples.recorded(field, unit=unit, axes=axes, source=source, frame=frame, nameless=nameless, **others)

    def _values_of(self, values: Values, column: Column) -> Floats:
        """Take a column in the unit of `Samples`; NaN where a value is not valid."""
        kind = column.kind
        with np.errstate(over="ignore", invalid="ignore"):
            recorded = self.taken(values, column)
            taken = (recorded - column.start) * column.factor
            if kind == TIME and len(column.cells) == 2:
                taken = taken[:, :1] + 1e-9 * recorded[:, 1:]
        taken[np.isinf(taken)] = np.nan
        if taken.shape[1] == 1 and kind not in OF_MOTORS:
            taken = taken[:, 0]
        return VALID[kind](taken) if kind in VALID else taken


def by_name(
    names: Sequence[str],
    values: Floats,
    wanted: Sequence[int] = (),
    units: Sequence[str] = (),
    clocks: Sequence[Clock] = (),
) -> Columns | None:
    """Choose columns by a header, its units and the first rows: the first of several magnetometers, with all in it.

    Of pairs as ``mag_x_set`` and ``mag_x_reset`` the difference is read.

    >>> pairs = by_name(["x_set", "y_set", "z_set", "x_reset", "y_reset", "z_reset"], np.array([[9, 1, 5, -5, 3, -1]]))
    >>> pairs.reset.cells, pairs.own_offset
    ((3, 4, 5), (2.0, 2.0, 2.0))
    """
    pairs = polarities(names)
    if not pairs or wanted:
        return _by_name(names, values, wanted, units, clocks)
    plain = ["" if place in pairs.values() else name for place, name in enumerate(names)]
    bare = [without_set(name) if place in pairs else name for place, name in enumerate(plain)]
    chosen = _by_name(bare, values, (), units, clocks)
    return chosen and _with_pairs(chosen, names, values, pairs)


def _with_pairs(columns: Columns, names: Sequence[str], values: Floats, pairs: Mapping[int, int]) -> Columns:
    """Columns, and those of each of several magnetometers, with what was read in the other polarity."""
    several = tuple(_with_pairs(each, names, values, pairs) for each in columns.magnetometers)
    columns = replace(columns, magnetometers=several)
    if not set(columns.field.cells) <= set(pairs):
        return columns
    reset = _column(FIELD, [pairs[cell] for cell in columns.field.cells], names)
    field = _column(FIELD, columns.field.cells, names)
    both = values[np.isfinite(values[:, [*field.cells, *reset.cells]]).all(axis=1)]
    after, before = both[:, field.cells], both[:, reset.cells]
    if _spread(after + before) > TURNED * _spread(after - before):
        turned = f"{', '.join(reset.names)} (follows {', '.join(field.names)}: its sign was turned already)"
        return replace(columns, field=field, left_out=(*columns.left_out, turned))
    own = (np.median(after + before, axis=0) / 2.0).tolist() if len(both) else []
    return replace(columns, field=field, reset=reset, own_offset=tuple(own))


def _spread(values: Floats) -> float:
    """Root of the sum of the variances of (N, 3) values."""
    return float(np.sqrt(np.sum(np.var(values, axis=0)))) if len(values) else 0.0


def _by_name(
    names: Sequence[str], values: Floats, wanted: Sequence[int], units: Sequence[str], clocks: Sequence[Clock]
) -> Columns | None:
    """Choose columns by a header without pairs."""
    meanings = [meaning(name) for name in names]
    for place, unit in enumerate(units[: len(names)]):  # in a row below the header
        if unit and not meanings[place].unit:
            meanings[place] = meaning(f"{names[place]} ({unit})")
    for place, name in enumerate(names):
        if is_letter_of_time(name) and meanings[place].kind == TIME and _is_temperature(values[:, place]):
            meanings[place] = Meaning(TEMPERATURE)
    for clock in clocks:  # after those that are numbers
        known = meanings[clock.cell]
        for cell in clock.cells:
            meanings[cell] = Meaning("")
        meanings[clock.cell] = Meaning(TIME, unit="s", rank=known.rank + 2 if known.kind == TIME else LAST)
    open_axes = {place: known.axis for place, known in enumerate(meanings) if known.is_bare or not known.kind}
    is_abscissa = [axis for axis in open_axes.values() if axis] == ["x"]
    nameless = [place for place, axis in open_axes.items() if not names[place].strip() or (is_abscissa and axis)]
    if unnamed := [place for place in nameless if _is_clock(values[:, place])]:  # ``X_Value`` without a y is no axis
        meanings[unnamed[0]] = Meaning(TIME, rank=LAST)
    sensors = vectors(names, meanings, FIELD)
    fields = instruments(sensors)
    free = [Meaning("") if place in wanted else known for place, known in enumerate(meanings)]
    triples = {kind: vectors(names, free, kind) for kind in (ACCELERATION, RATE)}
    header = _Header(names, meanings, values, fields, triples, {clock.cell: clock for clock in clocks})
    if wanted:
        own = next((each for each in sensors if set(wanted) <= set(each.cells)), Vector(tuple(wanted), 0, (), ""))
        name = own.name if own in fields else own.whole
        return replace(header.around(own._replace(cells=tuple(wanted))), name=name if len(fields) > 1 else "")
    if not fields:
        return None
    read = {place for field in fields for place in field.cells}
    unread = [place for place, name in enumerate(names) if name and place not in read and tells_nothing(name)]
    judged = groups(values, unread, names) if len(unread) > 2 else []
    recognised = [str(group) for group in judged if group.is_known or group.is_candidate]
    others = (*passed_over(sensors, fields), *recognised)
    several = len(fields) > 1
    made = [replace(header.around(each), passed_over=others, name=each.name if several else "") for each in fields]
    apart = tuple(filter(None, (_incomplete(header, sensors), _on_board(names))))
    made = [replace(each, left_out=(*apart, *each.left_out)) for each in made]
    return replace(made[0], magnetometers=tuple(made)) if several else made[0]


def _on_board(names: Sequence[str]) -> str:
    """Name the columns of the calibration on board beside readings of ArduPilot, which are after it."""
    own = [name.strip() for name in names if ON_BOARD.fullmatch(name.strip())]
    is_there = len(own) >= len("xyz") and "MagX" in names
    return f"{', '.join(own)} (the calibration on board, which MagX is after where it is not 0)" if is_there else ""


def _incomplete(header: _Header, sensors: Sequence[Vector]) -> str:
    """Say that names are there of some axes of another magnetometer; nothing where one alone is, or none."""
    known = {place for sensor in sensors for place in sensor.cells}
    named = zip(header.names, header.meanings, strict=True)
    parts = [
        (name.strip(), own.axis)
        for place, (name, own) in enumerate(named)
        if place not in known and own.kind == FIELD and own.axis and clearness(own.rank) < BARE
    ]
    if len({axis for _, axis in parts}) < 2 and not any(RAW_NAME.search(name) for name, _ in parts):
        return ""
    return f"{', '.join(name for name, _ in parts)} (not three axes of one sensor: is a name damaged?)"


@dataclass(frozen=True, slots=True)
class _Header:
    """A header, what its names mean, and the first rows below it."""

    names: Sequence[str]
    meanings: Sequence[Meaning]
    values: Floats
    fields: Sequence[Vector]  # magnetometers
    triples: Mapping[str, Sequence[Vector]]  # accelerometers and gyros
    clocks: Mapping[int, Clock]  # of times that are no numbers, by their place
    left_out: list[str] = field(default_factory=list)  # columns that cannot be used, each with the reason

    def around(self, sensor: Vector) -> Columns:
        """Collect the columns that are read for one of the magnetometers."""
        stated = {self._unit_of(cell) for cell in sensor.cells}
        unit = stated.pop() if len(stated) == 1 else ""
        free = [Meaning("") if place in sensor.cells else known for place, known in enumerate(self.meanings)]
        others = replace(self, meanings=free, left_out=[])
        auxiliary = tuple(others.auxiliary(sensor))
        return Columns(
            field=_column(FIELD, sensor.cells, self.names),
            unit=unit or _by_convention(self.names, sensor.cells),
            stated=bool(unit),
            auxiliary=auxiliary,
            left_out=tuple(others.left_out),
            unread_time="" if any(column.kind == TIME for column in auxiliary) else others.unread_time(),
        )

    def _unit_of(self, cell: int) -> str:
        """The unit of a field that a name states, also one that says no more, as of columns that were asked for."""
        known = self.meanings[cell]
        return known.unit if known.kind == FIELD else unit_of_field(self.names[cell]) if not known.kind else ""

    def unread_time(self) -> str:
        """Names of the columns that are called as a time: those that are left out, and those of words."""
        timed = [place for place, name in enumerate(self.names) if is_like_time(name) and not self.meanings[place].axis]
        known = [place for place in timed if self.meanings[place].kind == TIME or not _numeric(self.values[:, place])]
        return ", ".join(self.names[place].strip() for place in known)

    def auxiliary(self, sensor: Vector) -> Iterator[Column]:
        """Yield the other columns that are read with a magnetometer."""
        own = {kind: companion(each, sensor, self.fields) for kind, each in self.triples.items()}
        turned = {known.axis: place for place, known in enumerate(self.meanings) if known.kind == ATTITUDE}
        columns = [_column(kind, each.cells, self.names) for kind, each in own.items() if each]
        columns += [_column(ATTITUDE, [turned[axis] for axis in "wxyz"], self.names)] if len(turned) == 4 else []
        timed = partial(self.scalar, field=self.values[:, sensor.cells])
        columns += filter(None, (timed(kind) for kind in (TIME, TEMPERATURE, CURRENT, STRENGTH, THROTTLE)))
        columns += filter(None, map(self.motors, OF_MOTORS))
        for column in columns:
            if column.kind == RATE and not self.meanings[column.cells[0]].unit:
                self._leave_out(", ".join(column.names), "neither deg/s nor rad/s in the names")
            else:
                yield self.scaled(column)
        for kind, each in self.triples.items():
            for other in each:
                if other.instead and not own[kind]:
                    self._leave_out(other.whole, other.instead)

    def scaled(self, column: Column) -> Column:
        """Give a column the factor and start of its unit."""
        first = column.cells[0]
        unit = self.meanings[first].unit
        if column.kind == TIME:
            return _timed(column, unit, self.values[:, first])
        factor = {**FACTORS, **FACTORS_OF_MOTORS}.get(column.kind, {}).get(unit, 1.0)
        start = REST_US if column.kind == THROTTLES and unit not in SHARES else 0.0
        return replace(column, factor=factor, start=start, unit=unit if column.kind == STRENGTH else "")

    def scalar(self, kind: str, field: Floats) -> Column | None:
        """Find the best usable column of a kind without axes."""
        places = [place for place, known in enumerate(self.meanings) if known.kind == kind and not known.axis]
        parted = {place for place in places if kind == TIME and self._is_parted(place)}
        for place in sorted(places, key=lambda place: self.meanings[place].rank):
            if place in parted:
                return _column(kind, [place, place + 1], self.names)
            if place - 1 in parted:
                continue
            reason = "" if _numeric(self.values[:, place]) else _without_numbers(self.values[:, place])
            if kind == TIME and not reason:
                times, unit = self.values[:, place], self.meanings[place].unit
                reason = _falls(self.names[place], unit, times) or _cut_digits(times, unit)
                reason = reason or _too_fast(times, unit, field)
            if not reason:
                return self._told(place) if place in self.clocks else _column(kind, [place], self.names)
            self._leave_out(self.names[place].strip(), reason)
        return None

    def _told(self, place: int) -> Column:
        """The time in a column that is no number, with that of its dates where they stand in another."""
        clock = self.clocks[place]
        named = [cell for cell in clock.cells if self.names[cell].strip()] or clock.cells
        return replace(_column(TIME, named, self.names), cells=(place,), clock=clock)

    def _is_parted(self, place: int) -> bool:
        """Tell whether a column is of whole seconds, and the next of the nanoseconds that belong to them."""
        following = NANOSECONDS.fullmatch(self.names[place + 1].strip()) if place + 1 < len(self.names) else None
        if following is None or not _numeric(self.values[:, place + 1]):
            return False
        stem, seconds, rest = following.groups()
        own = self.names[place].strip().casefold()
        is_under_heading = not stem and own.endswith(f" {seconds}".casefold())
        return is_under_heading or own == f"{stem}{seconds}{rest}".casefold()

    def motors(self, kind: str) -> Column | None:
        """Find the columns of single motors, from the first motor on."""
        cells = {int(known.axis): place for place, known in enumerate(self.meanings) if known.kind == kind}
        if not cells:
            return None
        numbers = sorted(cells)
        column = _column(kind, [cells[number] for number in numbers], self.names)
        units = {self.meanings[cell].unit for cell in column.cells}
        if numbers != list(range(numbers[0], numbers[-1] + 1)) or numbers[0] > 1:
            reason = "motors are missing between: need each from the first on"
        elif not all(_numeric(self.values[:, cell]) for cell in column.cells):
            reason = "not numbers"
        elif len(units) > 1:
            reason = "in more than one unit"
        elif kind == THROTTLES and units == {""} and not _are_pulses(self.values[:, column.cells]):
            reason = "neither shares nor µs: say so in the names, as throttle1_share"
        else:
            return column
        self._leave_out(", ".join(column.names), reason)
        return None

    def _leave_out(self, what: str, reason: str) -> None:
        self.left_out.append(f"{what} ({reason})")


def _column(kind: str, cells: Sequence[int], names: Sequence[str]) -> Column:
    """Name a column as the header does, or by its number counted from 1 where it has no name."""
    return Column(kind, tuple(cells), tuple((names[cell].strip() if names else "") or str(cell + 1) for cell in cells))


def by_place(
    values: Floats, wanted: Sequence[int] = (), clocks: Sequence[Clock] = (), sensor: Device | None = None
) -> Columns | None:
    """Choose columns without a header: three beside a time are x, y, z; of four, a first that ascends is the time.

    A column that only ever rises is no axis; beside those that are `wanted` it is the time.
    Where a word in each row names the `sensor`, columns that never change are none either.
    """
    told = {cell for clock in clocks for cell in clock.cells}
    parted = seconds_and_nanoseconds(values)
    told.update(parted)
    free = tuple(place for place in range(values.shape[1]) if place not in told)
    free = tuple(place for place in axes_of(values) if place in free) if sensor else free
    timed = len(free) == 4 and not told and ascends(values[:, free[0]])
    field = tuple(wanted) or (free if len(free) == 3 else free[1:] if timed else ())
    if not field or (not wanted and has_clock(values[:, field])):
        return None
    own = _column(FIELD, field, ())
    time, reason = _time_by_place(values, field, clocks, parted)
    name = " and ".join(time.names) if time else ""
    if reason:
        return Columns(own, left_out=(f"{name} ({reason})",), unread_time=name)
    return Columns(own, auxiliary=(time,) if time else ())


def _time_by_place(
    values: Floats, field: Sequence[int], clocks: Sequence[Clock], parted: Sequence[int]
) -> tuple[Column | None, str]:
    """The time of a table without a header, and why it cannot be used where that is so."""
    if clocks:
        column = replace(_column(TIME, clocks[0].cells, ()), cells=(clocks[0].cell,), clock=clocks[0])
        times = values[:, clocks[0].cell]
        return _timed(column, "s", times), _cut_digits(times, "s")
    if parted:
        return _timed(_column(TIME, parted, ()), "s", values[:, parted[0]]), ""
    place = _clock(values, field)
    if place is None:
        return None, ""
    times = values[:, place]
    return _timed(_column(TIME, [place], ()), "", times), _too_fast(times, "", values[:, field])


def seconds_and_nanoseconds(values: Floats) -> tuple[int, ...]:
    """Places of a column of whole seconds since 1970 and of the next, which has the nanoseconds; nothing without.

    >>> seconds_and_nanoseconds(np.array([[1.7e9, 9e8, 4], [1.7e9 + 1, 1e8, 5]]))
    (0, 1)
    """
    for place, (whole, part) in enumerate(pairwise(values.T)):
        is_whole = (
            np.isfinite([whole, part]).all() and (whole == np.floor(whole)).all() and (part == np.floor(part)).all()
        )
        if is_whole and EPOCHS[-1][0] <= whole.min() and whole.max() < 4 * EPOCHS[-1][0]:
            is_part = part.min() >= 0 and 1e6 <= part.max() < 1e9
            if is_part and ascends((whole - whole[0]) + 1e-9 * part):
                return place, place + 1
    return ()


def rising_in(values: Floats) -> list[int]:
    """Places of the columns that only ever rise."""
    return [place for place, column in enumerate(values.T) if only_rises(column)]


def axes_of(values: Floats) -> list[int]:
    """Places of the columns without a name that may be an axis: numbers that change, and not only ever rise."""
    changing = [place for place, column in enumerate(values.T) if _numeric(column) and len(np.unique(column)) > 1]
    return [place for place in changing if not only_rises(values[:, place])]


def _clock(values: Floats, field: Sequence[int]) -> int | None:
    """Place of the time of a table without a header: what ascends and is no counter, else the first if it ascends."""
    free = [place for place in range(values.shape[1]) if place not in field]
    clocks = [place for place in free if _is_clock(values[:, place])]
    return next(iter([*clocks, *(place for place in free if place == 0 and ascends(values[:, place]))]), None)


def _is_clock(column: Floats) -> bool:
    """Tell whether a column without a name ascends, and does not count rows."""
    return ascends(column) and set(np.diff(column[np.isfinite(column)])) != {1.0}


def choose(
    names: Sequence[str],
    values: Floats,
    asked: str | None = None,
    *,
    units: Sequence[str] = (),
    clocks: Sequence[Clock] = (),
    flat: str | None = None,
    choice: Choice = FIRST,
    source: str = "the table",
    heading: str = "",
    quoted: str = "",
    cells: Sequence[str] = (),
    devices: Sequence[Device] = (),
    is_told: bool = False,
) -> Columns | None:
    """Choose columns as the user asked, else by their names, else by their places; None where neither decides.

    `heading` says what header a table without names has; `quoted` and `cells` are its first line with readings.
    `is_told` says that a word in each row names its sensor.
    """
    width = values.shape[1]
    axes = [] if names or asked else axes_of(values)
    if flat is not None and asked is None:
        asked = _asked_level(flat, names, width, axes)
    if asked is None:
        sensor = devices[0] if is_told else None
        chosen = by_name(names, values, (), units, clocks) if names else by_place(values, (), clocks, sensor)
        is_bare = chosen is not None and not chosen.stated and meaning(chosen.field.names[0]).is_bare
        if chosen is None or (is_bare and (chosen.magnetometers or "w" in [name.strip().casefold() for name in names])):
            _refuse_two(axes, width, source, quoted)
            _refuse_unclear(names, values, source, f"{heading or 'no header'}{quoted}", cells)
        return chosen and _chosen(_of_devices(_assumed(chosen), devices), choice, source)
    wanted = wanted_places(asked, names, width, flat=flat is not None)
    chosen = by_name(names, values, wanted, units, clocks) if names else by_place(values, wanted, clocks)
    if chosen is None:
        return None
    form = Form.of(asked_columns(asked, flat=flat is not None), names, width, rising_in(values))
    chosen = _of_devices(replace(chosen, form=form), devices)
    if chosen.magnetometers:
        chosen = _chosen(chosen, choice, source)
    else:
        every = by_name(names, values, (), units, clocks) if names else None
        chosen = _named(chosen, every.magnetometers if every else (), choice, asked, source)
    if flat is None or len(wanted) != 2:
        return chosen
    return replace(chosen, field=replace(chosen.field, axes=tuple(map("xyz".index, flat))))


def _asked_level(flat: str, names: Sequence[str], width: int, axes: Sequence[int]) -> str | None:
    """The columns of a level turn where they are plain: the only two, those of its axes, or all that may be axes."""
    if width == 2:
        return "1,2"
    if set(flat) <= set(names):
        return ",".join(flat)
    return ",".join(str(place + 1) for place in axes) if len(axes) == 2 else None


def _assumed(columns: Columns) -> Columns:
    """Note where columns without telling names are taken for a magnetometer's."""
    is_bare = all(name.isdecimal() or meaning(name).is_bare for name in columns.field.names)
    return replace(columns, is_assumed=is_bare and not columns.unit)


def _of_devices(columns: Columns, devices: Sequence[Device]) -> Columns:
    """Columns as those of each of several devices, whose rows another column tells apart."""
    made = tuple(
        replace(each, device=device, name=", ".join(filter(None, (device.name, each.name))), magnetometers=())
        for device in devices
        for each in columns.magnetometers or (columns,)
        if not set(device.cells) & set(each.field.cells)
    )
    if len(made) == 1:
        return replace(made[0], name="")
    return replace(made[0], magnetometers=made) if made else columns


def _refuse_two(axes: Sequence[int], width: int, source: str, quoted: str) -> None:
    """Refuse a table without a header of which two columns are left beside clocks and counters."""
    if len(axes) == 2:
        others = ", ".join(str(place + 1) for place in range(width) if place not in axes)
        left = " and ".join(str(place + 1) for place in axes)
        raise NoMagnetometer(
            f"columns {left} of {source}{quoted} may be axes, others only rise or never change ({others}): "
            "need three, x y z; two, of a level turn, are for flinders two-axis"
        )


def _refuse_unclear(names: Sequence[str], values: Floats, source: str, heading: str, cells: Sequence[str]) -> None:
    """Refuse a table whose names are those of references only, or do not tell while its values say something."""
    others = [each for each in vectors(names, list(map(meaning, names)), FIELD) if each.instead]
    if others:
        what = numbered([f"{each.whole} ({each.instead})" for each in others])
        columns = ",".join(names[cell].strip() for cell in others[0].cells)
        raise NoMagnetometer(
            f"no readings of a magnetometer among the columns of {source}: by its name each is something else, {what}; "
            "say which three columns are what the sensor read, such as these if they are it after all",
            hint={"columns": columns},
        )
    width = values.shape[1]
    judged = groups(values, [place for place in range(width) if not names or tells_nothing(names[place])], names)
    if any(group.is_candidate or group.is_known or (names and len(group.names) > 1) for group in judged):
        nameless = f"{source} has {width} columns and {heading}: need three, x y z, or four with the time first"
        what = f"names do not tell which columns of {source} are the magnetometer" if names else nameless
        first = [f"{number}: {cell.strip()}" for number, cell in enumerate(cells, 1)]
        shown = f"; its first line by its columns is {listed(first)}" if cells and not names else ""
        told, hint = advice(judged)
        raise NoMagnetometer(f"{what}{shown}; {told}", hint=hint)


def _named(columns: Columns, magnetometers: Sequence[Columns], choice: Choice, asked: str, source: str) -> Columns:
    """Let the columns that the user asked for keep the name of their magnetometer, or take the name the user gives."""
    if choice.sensor is None:
        return columns
    if not choice.is_name:
        raise UsageError(
            "columns and a number both say which magnetometer it is: leave one of them out",
            hint={"columns": None, "sensor": None},
        )
    wanted = choice.sensor.strip().casefold()
    for number, other in enumerate(magnetometers, 1):
        if wanted in (str(number), other.name.casefold()):
            if other.name == columns.name:
                return columns
            own = columns.name or "none of its magnetometers"
            raise UsageError(
                f"columns {asked!r} are {own} in {source}, and the name {choice.sensor!r} is of {other.name}: leave "
                "one of them out, or name the sensor differently",
                hint={"columns": asked, "sensor": choice.sensor},
            )
    return replace(columns, name="")


def _chosen(columns: Columns, choice: Choice, source: str) -> Columns:
    """Take the magnetometer that is meant; where nobody says, the first with the names of the others."""
    if not columns.magnetometers:
        choice.refuse_alone(source)
        return columns
    names = [each.name for each in columns.magnetometers]
    chosen = columns.magnetometers[choice.among(names, source)]
    others = tuple(f"{number} {name}" for number, name in enumerate(names[1:], 2)) if choice.is_open else ()
    return replace(chosen, magnetometers=columns.magnetometers, others=others)


def asked_columns(columns: str, *, flat: bool = False) -> list[str]:
    """Split what the user asked for: three different names or numbers; two will do if `flat`."""
    asked = [part.strip() for part in columns.split(",")]
    count = len(asked)
    if not (count == 3 or (flat and count == 2)) or len({part.casefold() for part in asked}) != count:
        two = "; two columns, x and y of a level turn, are for flinders two-axis" if count == 2 else ""
        three = f"three different ones, such as 'mx,my,mz' or '4,5,6'{two}"
        need = "two or three different ones, such as 'mx,my' or '4,5'" if flat else three
        raise UsageError(f"columns {columns!r}: need {need}")
    return asked


def wanted_places(columns: str, names: Sequence[str], width: int, *, flat: bool = False) -> tuple[int, ...]:
    """Look up the columns that the user asked for, by name or by number counted from 1."""
    known = [name.strip() for name in names]
    places = tuple(_place(part, known, width) for part in asked_columns(columns, flat=flat))
    if len(set(places)) != len(places):
        many = "two" if len(places) == 2 else "three"
        raise UsageError(f"columns {columns!r} name one column twice: need {many} different ones")
    return places


def wanted_acceleration(asked: str, names: Sequence[str], columns: Columns, width: int) -> Columns:
    """Take the accelerometer's columns from where the user says, if they are not read as the magnetometer."""
    if not width:
        raise UsageError(f"acceleration {asked!r}: lines differ in length, so that columns cannot be counted")
    own = _column(ACCELERATION, wanted_places(asked, names, width), names)
    if taken := [name for name, cell in zip(own.names, own.cells, strict=True) if cell in columns.field.cells]:
        raise UsageError(
            f"acceleration {asked!r}: {', '.join(taken)} is read as the magnetometer; say which columns are that",
            hint={"columns": None},
        )
    others = tuple(column for column in columns.auxiliary if column.kind != ACCELERATION)
    return replace(columns, auxiliary=(*others, own))


def wanted_strength(asked: str, names: Sequence[str], columns: Columns, width: int) -> Columns:
    """Take the strength of the field from the column that the user says, if it is not read as the magnetometer."""
    if not width:
        raise UsageError(f"scalar {asked!r}: lines differ in length, so that columns cannot be counted")
    place = _place(asked, [name.strip() for name in names], width)
    own = _column(STRENGTH, [place], names)
    if place in columns.field.cells:
        raise UsageError(
            f"scalar {asked!r}: {own.names[0]} is read as the vector magnetometer; say which columns are that",
            hint={"columns": None},
        )
    others = tuple(column for column in columns.auxiliary if column.kind != STRENGTH and place not in column.cells)
    return replace(columns, auxiliary=(*others, replace(own, unit=unit_of_strength(own.names[0]))))


def _place(asked: str, names: list[str], width: int) -> int:
    """Look up one column, by its name as it is written, then regardless of case, then by its number."""
    folded = [name.casefold() for name in names]
    for known, wanted in ((names, asked), (folded, asked.casefold())):
        if wanted in known:
            return known.index(wanted)
    if asked.isdecimal() and 1 <= int(asked) <= width:
        return int(asked) - 1
    there = f"its columns are {listed(names)}" if names else f"it has no header and {width} columns"
    meant = did_you_mean(asked, names)
    raise UsageError(f"there is no column {asked!r}{meant}: {there}; give names or numbers from 1 to {width}")


def _by_convention(names: Sequence[str], field: tuple[int, ...]) -> str:
    """Tell the unit that a known format has without saying so: ROS messages, the app Sensor Logger."""
    first = names[field[0]].casefold()
    is_printed = first == "magnetic_field x" and any(name.startswith("magnetic_field_covariance") for name in names)
    if is_printed or first.endswith(OF_ROS):
        return "T"
    return "uT" if {name.strip().casefold() for name in names} >= {"seconds_elapsed", "x", "y", "z"} else ""


def _are_pulses(values: Floats) -> bool:
    """Tell whether numbers are the widths of pulses that a speed controller takes, in µs."""
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and bool(np.all((finite >= PULSES_US[0]) & (finite <= PULSES_US[1])))


def _numeric(values: Floats) -> bool:
    """Tell whether at least half of the first values are numbers."""
    return len(values) == 0 or bool(np.isfinite(values).mean() >= 0.5)


def _without_numbers(values: Floats) -> str:
    """Say why a column cannot be used of which most of the first values are no numbers."""
    return "numbers in few rows" if np.isfinite(values).any() else "not numbers"


def _timed(column: Column, unit: str, values: Floats) -> Column:
    """Find the factor to seconds, and where a clock that counts from 1970 starts."""
    values = values[np.isfinite(values)]
    first = float(values[0]) if len(values) else 0.0
    factor = _factor_to_seconds(values, unit)
    return replace(column, factor=factor, start=first if abs(first) * factor > LONG else 0.0)


@np.errstate(over="ignore")
def _cut_digits(values: Floats, unit: str) -> str:
    """Say that a time was written with too few digits: many readings share each, and the next is one digit later."""
    values = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(values)) + 1
    runs = np.diff([0, *changes, len(values)])
    inside = runs[1:-1] if len(runs) > 2 else runs  # the first and the last may go on
    if len(values) < 2 * COARSE or np.median(inside) < COARSE:
        return ""
    distinct, factor = values[[0, *changes]], _factor_to_seconds(values, unit)
    steps = _resolutions(distinct)
    if len(distinct) > 1:
        jump = float(np.min(np.abs(np.diff(distinct))))
        steps = [jump] if any(step / 2 < jump < 2 * step for step in steps) else []
    else:
        steps = [step for step in steps if step * factor >= COARSE_S]
    many = f"{np.median(inside):.0f}" if len(runs) > 2 else f"{np.max(runs)} or more"
    reason = "its digits were cut to steps of {:.3g} s, {} readings to each: write more of them, as float64"
    return reason.format(max(steps) * factor, many) if steps else ""


@np.errstate(over="ignore", invalid="ignore")
def _too_fast(values: Floats, unit: str, field: Floats) -> str:
    """Say that the unit of a time is not known: with the one that its size suggests, no sensor turns so fast."""
    known = np.isfinite(values) & np.isfinite(field).all(axis=1)
    times, read = values[known], field[known]
    if unit or len(times) < FEWEST_TIMES:
        return ""
    step = float(np.median(np.diff(times))) * _factor_to_seconds(times, unit)
    near, far = (float(np.median(np.linalg.norm(read[lag:] - read[:-lag], axis=1))) for lag in (1, APART))
    radius = float(np.ptp(read, axis=0).max()) / 2
    if step <= 0 or far <= GROWS * near or near <= FASTEST_RAD_S * step * radius:
        return ""
    fast = f"at steps of {step:.3g} s the sensor would turn at {near / radius / step:,.0f} rad/s"
    return f"its unit is not known, {fast}: put it into the name, as t_ms"


def _falls(name: str, unit: str, values: Floats) -> str:
    """Say that a column falls, or goes to and fro, as no time does; of a ``T`` also that it stands still.

    Where the unit of a time stands in the name it is one: the rows of a fleet may be in any order.
    """
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    falling = np.count_nonzero(steps < 0)
    is_none = not unit and falling > 1 and 2 * falling > np.count_nonzero(steps > 0)
    if len(values) >= FEWEST_TIMES and (is_none or (is_letter_of_time(name) and not _rises(values))):
        return FALLS
    return ""


def _rises(values: Floats) -> bool:
    """Tell whether finite numbers rise as a clock does: from time to time, so many readings to each."""
    steps = np.diff(values)
    changes = np.flatnonzero(steps)
    if len(changes) == 0:
        return bool(values[0] == 0.0 or values[0] > LONG)  # a clock at rest, and one whose digits were cut
    runs = np.diff(changes)  # readings to each value but the first and the last
    if len(runs) == 0 or np.mean(steps[changes] < 0) > RARE:
        return False
    usual = float(np.median(runs))
    return bool(np.mean(np.abs(runs - usual) <= max(1.0, REGULAR * usual)) >= 1 - RARE)


def _is_temperature(values: Floats) -> bool:
    """Tell whether a column named ``T`` is a temperature in °C, and does not rise as a clock does."""
    values = values[np.isfinite(values)]
    is_warm = (TEMPERATURES_C[0] <= values) & (values <= TEMPERATURES_C[1])
    return len(values) >= FEWEST_TIMES and bool(is_warm.all()) and not _rises(values)


def _factor_to_seconds(values: Floats, unit: str) -> float:
    """Factor of a time's stated unit, else a guess from its size, then from its steps of 10 µs to 10 s."""
    if unit:
        return FACTORS[TIME][unit]
    first = float(values[0]) if len(values) else 0.0
    with np.errstate(over="ignore"):  # of numbers that are no times
        step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    for least, factor in EPOCHS:
        if least <= first < 4 * least and (step == 0 or 1e-5 <= step * factor <= 10):
            return factor
    return 1.0 if step < 2 else 1e-3 if step < 1e3 else 1e-6 if step < 5e5 else 1e-9


def _resolutions(values: Floats) -> list[float]:
    """Tell which units in the last digit these numbers may have: the last that is written, and that of float32."""
    digits = [Decimal(repr(value)).normalize().as_tuple().exponent for value in values.tolist() if value]
    if not digits:
        return []
    written = 10.0 ** min(map(int, digits))
    single = np.abs(values.astype(np.float32))
    is_single = bool(np.all(single == np.abs(values)))
    return [written, float(np.spacing(single.max()))] if is_single else [written]


class ColumnsRecording:
    """What recordings of columns have in common, of text and of other tables: what is said of them."""

    __slots__ = ()
    file: Source
    source: str  # name of the file
    unit: Unit
    axes: Axes
    span: TimeSpan
    columns: Any  # a field or a property with `Columns`

    @property
    def name(self) -> str:
        """What the magnetometer is called, where it is one of several."""
        return str(self.columns.name)

    @property
    def states_unit(self) -> bool:
        """The unit stands in the names."""
        return bool(self.columns.stated)

    def with_columns(self, columns: Columns, unit: str | None, scale: float | None) -> Self:
        """Read these columns, in the unit that their names or the user say."""
        raise NotImplementedError

    def written(self) -> str:
        """How it is written."""
        raise NotImplementedError

    def each(self, unit: str | None, scale: float | None) -> tuple[Self, ...]:
        """Each of several magnetometers, in the unit that its names or the user say; none where there is one."""
        return tuple(self.with_columns(columns, unit, scale) for columns in self.columns.magnetometers)

    def describe(self) -> str:
        """Say in one line what was recognised and is used."""
        return f"{self.source}: {self.contents()}"

    __str__ = describe

    def contents(self, *, is_named: bool = True) -> str:
        """The same without the name of the file; unless `is_named`, without that of the magnetometer, too."""
        unit = f"counts of {self.unit.scale:g} µT" if self.unit.name == COUNTS != self.unit.inside else self.unit.name
        columns = self.columns.describe(unit) if is_named else self.columns.contents(unit)
        parts = [columns, self.written()]
        parts += [f"axes {self.axes}"] * (not self.axes.is_identity) + [str(self.span)] * (not self.span.is_all)
        return "; ".join(parts + self.columns.remarks())


def unit_of(columns: Columns, name: str, unit: str | None, scale: float | None) -> Unit:
    """Choose the unit between what the header says and what the user says; UnitError where they contradict."""
    if unit is not None:
        chosen = Unit.of(unit, scale)
        if columns.stated and chosen.name != columns.unit:
            raise UnitError(
                f"the header of {name} says {columns.unit} ({columns.field.names[0]}) and unit {unit!r} was given: "
                "leave it out, or correct the header"
            )
        return chosen
    if scale is not None:
        return Unit.of(columns.unit if columns.stated else COUNTS, scale)
    return Unit.of(columns.unit or COUNTS)
