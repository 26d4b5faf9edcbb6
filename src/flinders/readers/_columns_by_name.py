"""Choice of a table's columns by the names in its header, the units below the names and the first rows.

>>> chosen = by_name(["t_s", "mag_x_mG", "mag_y_mG", "mag_z_mG"], np.zeros((2, 4)))
>>> chosen.field.cells, chosen.field.names, chosen.unit, chosen.time.names
((1, 2, 3), ('mag_x_mG', 'mag_y_mG', 'mag_z_mG'), 'mG', ('t_s',))
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._columns import MOTOR_KINDS, Column, Columns, column_of
from flinders.readers._instruments import Vector, companion, instruments, polarities, similar_names, strip_set, vectors
from flinders.readers._likeness import groups, is_numeric, without_numbers
from flinders.readers._names import (
    ACCELERATION,
    ATTITUDE,
    BARE_CLEARNESS,
    CURRENT,
    FACTORS,
    FACTORS_OF_MOTORS,
    FIELD,
    RATE,
    STRENGTH,
    TEMPERATURE,
    THROTTLE,
    THROTTLES,
    TIME,
    Meaning,
    clearness,
    is_inconclusive,
    is_letter_of_time,
    is_like_time,
    meaning,
    unit_of_field,
)
from flinders.readers._times import (
    is_clock,
    is_temperature,
    reason_of_falling,
    reason_of_missing_digits,
    reason_of_unknown_unit,
    with_time_factor,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.readers._clock import Clock

# units of a throttle that is 0 when closed; pulse widths start at `REST_US` instead
SHARES: Final = ("share", "percent", "pct", "%")
REST_US: Final = 1000.0  # pulse width for zero throttle, in µs; full throttle is 1000 µs more
PULSES_US: Final = (800.0, 2200.0)  # shortest and longest pulse width, in µs
UNNAMED_TIME_RANK: Final = 9  # rank of a time whose name is not recognised
NANOSECONDS: Final = re.compile(r"(.*?)(?:n|nano)(secs?)\b(.*)", re.IGNORECASE)
"""Name of a column with the nanoseconds of a time, next to one of whole seconds, as in ROS messages."""
ONBOARD_COLUMN: Final = re.compile(r"(?:Ofs|MO)[XYZ]")
"""Columns of the message ``MAG`` in a flight log: offsets of the compass, and of the motors' current."""
ROS_ENDINGS: Final = ("magnetic_field.x", "magnetic_field/x")  # endings of names that sensor_msgs defines in tesla
# Ratio of two spreads, that of set plus reset to that of set less reset, above which the sign of the reset readings was
# turned already
MIN_TURNED_RATIO: Final = 3.0
RAW_NAME: Final = re.compile(r"raw|uncal", re.IGNORECASE)
"""Part of a name that marks readings without correction."""


def by_name(
    names: Sequence[str],
    values: Floats,
    wanted: Sequence[int] = (),
    units: Sequence[str] = (),
    clocks: Sequence[Clock] = (),
) -> Columns | None:
    """Choose columns by header, units and first rows: those of the first magnetometer, with a list of all.

    Of pairs such as ``mag_x_set`` and ``mag_x_reset``, half the difference is read.

    >>> pairs = by_name(["x_set", "y_set", "z_set", "x_reset", "y_reset", "z_reset"], np.array([[9, 1, 5, -5, 3, -1]]))
    >>> pairs.reset.cells, pairs.own_offset
    ((3, 4, 5), (2.0, 2.0, 2.0))
    """
    pairs = polarities(names)
    if not pairs or wanted:
        return _by_name(names, values, wanted, units, clocks)
    plain = ["" if place in pairs.values() else name for place, name in enumerate(names)]
    bare = [strip_set(name) if place in pairs else name for place, name in enumerate(plain)]
    chosen = _by_name(bare, values, (), units, clocks)
    return chosen and _with_pairs(chosen, names, values, pairs)


def _with_pairs(columns: Columns, names: Sequence[str], values: Floats, pairs: Mapping[int, int]) -> Columns:
    """Columns with the readings of the other polarity, for the magnetometer and for each of several."""
    several = tuple(_with_pairs(each, names, values, pairs) for each in columns.magnetometers)
    columns = replace(columns, magnetometers=several)
    if not set(columns.field.cells) <= set(pairs):
        return columns
    reset = column_of(FIELD, [pairs[cell] for cell in columns.field.cells], names)
    field = column_of(FIELD, columns.field.cells, names)
    both = values[np.isfinite(values[:, [*field.cells, *reset.cells]]).all(axis=1)]
    after, before = both[:, field.cells], both[:, reset.cells]
    if _spread(after + before) > MIN_TURNED_RATIO * _spread(after - before):
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
    """Choose columns by a header without pairs of set and reset."""
    meanings = [meaning(name) for name in names]
    for place, unit in enumerate(units[: len(names)]):  # from a row below the header
        if unit and not meanings[place].unit:
            meanings[place] = meaning(f"{names[place]} ({unit})")
    for place, name in enumerate(names):
        if is_letter_of_time(name) and meanings[place].kind == TIME and is_temperature(values[:, place]):
            meanings[place] = Meaning(TEMPERATURE)
    for clock in clocks:  # ranked after numeric times
        known = meanings[clock.cell]
        for cell in clock.cells:
            meanings[cell] = Meaning("")
        meanings[clock.cell] = Meaning(TIME, unit="s", rank=known.rank + 2 if known.kind == TIME else UNNAMED_TIME_RANK)
    open_axes = {place: known.axis for place, known in enumerate(meanings) if known.is_bare or not known.kind}
    is_abscissa = [axis for axis in open_axes.values() if axis] == ["x"]
    nameless = [place for place, axis in open_axes.items() if not names[place].strip() or (is_abscissa and axis)]
    if unnamed := [place for place in nameless if is_clock(values[:, place])]:  # ``X_Value`` without a y is no axis
        meanings[unnamed[0]] = Meaning(TIME, rank=UNNAMED_TIME_RANK)
    sensors = vectors(names, meanings, FIELD)
    fields = instruments(sensors)
    free = [Meaning("") if place in wanted else known for place, known in enumerate(meanings)]
    triples = {kind: vectors(names, free, kind) for kind in (ACCELERATION, RATE)}
    header = _Header(names, meanings, values, fields, triples, {clock.cell: clock for clock in clocks})
    if wanted:
        own = next((each for each in sensors if set(wanted) <= set(each.cells)), Vector(tuple(wanted), 0, (), ""))
        name = own.name if own in fields else own.whole
        return replace(header.columns_for(own._replace(cells=tuple(wanted))), name=name if len(fields) > 1 else "")
    if not fields:
        return None
    read = {place for field in fields for place in field.cells}
    unread = [place for place, name in enumerate(names) if name and place not in read and is_inconclusive(name)]
    judged = groups(values, unread, names) if len(unread) > 2 else []
    recognised = [str(group) for group in judged if group.is_known or group.is_candidate]
    others = (*similar_names(sensors, fields), *recognised)
    several = len(fields) > 1
    made = [replace(header.columns_for(each), passed_over=others, name=each.name if several else "") for each in fields]
    apart = tuple(filter(None, (_incomplete(header, sensors), _on_board(names))))
    made = [replace(each, left_out=(*apart, *each.left_out)) for each in made]
    return replace(made[0], magnetometers=tuple(made)) if several else made[0]


def _on_board(names: Sequence[str]) -> str:
    """Name the columns with the onboard calibration in a flight log, whose readings are already corrected by it."""
    own = [name.strip() for name in names if ONBOARD_COLUMN.fullmatch(name.strip())]
    is_there = len(own) >= len("xyz") and "MagX" in names
    return f"{', '.join(own)} (the on-board calibration, already applied to MagX unless it is 0)" if is_there else ""


def _incomplete(header: _Header, sensors: Sequence[Vector]) -> str:
    """Name the columns of a magnetometer of which some axes are missing; empty if there is no such magnetometer."""
    known = {place for sensor in sensors for place in sensor.cells}
    named = zip(header.names, header.meanings, strict=True)
    parts = [
        (name.strip(), own.axis)
        for place, (name, own) in enumerate(named)
        if place not in known and own.kind == FIELD and own.axis and clearness(own.rank) < BARE_CLEARNESS
    ]
    if len({axis for _, axis in parts}) < 2 and not any(RAW_NAME.search(name) for name, _ in parts):
        return ""
    return f"{', '.join(name for name, _ in parts)} (not three axes of one sensor: is a name damaged?)"


@dataclass(frozen=True, slots=True)
class _Header:
    """A header, the meanings of its names, and the first rows below it."""

    names: Sequence[str]
    meanings: Sequence[Meaning]
    values: Floats
    fields: Sequence[Vector]  # magnetometers
    triples: Mapping[str, Sequence[Vector]]  # accelerometers and gyros, by kind
    clocks: Mapping[int, Clock]  # clocks of times that are not numeric, by place
    left_out: list[str] = field(default_factory=list)  # columns that cannot be used, each with the reason

    def columns_for(self, sensor: Vector) -> Columns:
        """Collect the columns that are read for one magnetometer."""
        stated = {self._unit_of(cell) for cell in sensor.cells}
        unit = stated.pop() if len(stated) == 1 else ""
        free = [Meaning("") if place in sensor.cells else known for place, known in enumerate(self.meanings)]
        others = replace(self, meanings=free, left_out=[])
        auxiliary = tuple(others.auxiliary(sensor))
        return Columns(
            field=column_of(FIELD, sensor.cells, self.names),
            unit=unit or _by_convention(self.names, sensor.cells),
            stated=bool(unit),
            auxiliary=auxiliary,
            left_out=tuple(others.left_out),
            unread_time="" if any(column.kind == TIME for column in auxiliary) else others.unread_time(),
        )

    def _unit_of(self, cell: int) -> str:
        """Unit of the field in the name of a column, even if the column was requested as another quantity."""
        known = self.meanings[cell]
        return known.unit if known.kind == FIELD else unit_of_field(self.names[cell]) if not known.kind else ""

    def unread_time(self) -> str:
        """Names of columns that look like a time but are not read as the time."""
        timed = [place for place, name in enumerate(self.names) if is_like_time(name) and not self.meanings[place].axis]
        known = [place for place in timed if self.meanings[place].kind == TIME or not is_numeric(self.values[:, place])]
        return ", ".join(self.names[place].strip() for place in known)

    def auxiliary(self, sensor: Vector) -> Iterator[Column]:
        """Yield the auxiliary columns that are read with a magnetometer."""
        own = {kind: companion(each, sensor, self.fields) for kind, each in self.triples.items()}
        turned = {known.axis: place for place, known in enumerate(self.meanings) if known.kind == ATTITUDE}
        columns = [column_of(kind, each.cells, self.names) for kind, each in own.items() if each]
        columns += [column_of(ATTITUDE, [turned[axis] for axis in "wxyz"], self.names)] if len(turned) == 4 else []
        timed = partial(self.scalar, field=self.values[:, sensor.cells])
        columns += filter(None, (timed(kind) for kind in (TIME, TEMPERATURE, CURRENT, STRENGTH, THROTTLE)))
        columns += filter(None, map(self.motors, MOTOR_KINDS))
        for column in columns:
            if column.kind == RATE and not self.meanings[column.cells[0]].unit:
                self._leave_out(", ".join(column.names), "neither deg/s nor rad/s in the names")
            else:
                yield self.with_factor(column)
        for kind, each in self.triples.items():
            for other in each:
                if other.instead and not own[kind]:
                    self._leave_out(other.whole, other.instead)

    def with_factor(self, column: Column) -> Column:
        """Column with the factor and the zero point of its unit."""
        first = column.cells[0]
        unit = self.meanings[first].unit
        if column.kind == TIME:
            return with_time_factor(column, unit, self.values[:, first])
        factor = {**FACTORS, **FACTORS_OF_MOTORS}.get(column.kind, {}).get(unit, 1.0)
        start = REST_US if column.kind == THROTTLES and unit not in SHARES else 0.0
        return replace(column, factor=factor, start=start, unit=unit if column.kind == STRENGTH else "")

    def scalar(self, kind: str, field: Floats) -> Column | None:
        """Best usable column of a kind without axes, such as a time or a temperature; None if there is none."""
        places = [place for place, known in enumerate(self.meanings) if known.kind == kind and not known.axis]
        parted = {place for place in places if kind == TIME and self._has_nanoseconds(place)}
        for place in sorted(places, key=lambda place: self.meanings[place].rank):
            if place in parted:
                return column_of(kind, [place, place + 1], self.names)
            if place - 1 in parted:
                continue
            reason = "" if is_numeric(self.values[:, place]) else without_numbers(self.values[:, place])
            if kind == TIME and not reason:
                times, unit = self.values[:, place], self.meanings[place].unit
                reason = reason_of_falling(self.names[place], unit, times) or reason_of_missing_digits(times, unit)
                reason = reason or reason_of_unknown_unit(times, unit, field)
            if not reason:
                return self._clock_column(place) if place in self.clocks else column_of(kind, [place], self.names)
            self._leave_out(self.names[place].strip(), reason)
        return None

    def _clock_column(self, place: int) -> Column:
        """Column of a time that is not numeric, together with the column of its dates if this is separate."""
        clock = self.clocks[place]
        named = [cell for cell in clock.cells if self.names[cell].strip()] or clock.cells
        return replace(column_of(TIME, named, self.names), cells=(place,), clock=clock)

    def _has_nanoseconds(self, place: int) -> bool:
        """Whether a column has whole seconds and the next column their nanoseconds."""
        following = NANOSECONDS.fullmatch(self.names[place + 1].strip()) if place + 1 < len(self.names) else None
        if following is None or not is_numeric(self.values[:, place + 1]):
            return False
        stem, seconds, rest = following.groups()
        own = self.names[place].strip().casefold()
        is_under_heading = not stem and own.endswith(f" {seconds}".casefold())
        return is_under_heading or own == f"{stem}{seconds}{rest}".casefold()

    def motors(self, kind: str) -> Column | None:
        """Columns of the single motors, in order of their numbers; None if there are none."""
        cells = {int(known.axis): place for place, known in enumerate(self.meanings) if known.kind == kind}
        if not cells:
            return None
        numbers = sorted(cells)
        column = column_of(kind, [cells[number] for number in numbers], self.names)
        units = {self.meanings[cell].unit for cell in column.cells}
        if numbers != list(range(numbers[0], numbers[-1] + 1)) or numbers[0] > 1:
            reason = "some motors are missing: all are needed, from the first on"
        elif not all(is_numeric(self.values[:, cell]) for cell in column.cells):
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


def _by_convention(names: Sequence[str], field: tuple[int, ...]) -> str:
    """Unit that a known format implies: ROS messages, or the app Sensor Logger; empty for other formats."""
    first = names[field[0]].casefold()
    is_printed = first == "magnetic_field x" and any(name.startswith("magnetic_field_covariance") for name in names)
    if is_printed or first.endswith(ROS_ENDINGS):
        return "T"
    return "uT" if {name.strip().casefold() for name in names} >= {"seconds_elapsed", "x", "y", "z"} else ""


def _are_pulses(values: Floats) -> bool:
    """Whether numbers are pulse widths for a motor's speed controller, in µs."""
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and bool(np.all((finite >= PULSES_US[0]) & (finite <= PULSES_US[1])))
