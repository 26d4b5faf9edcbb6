"""Which columns of a table are the magnetometer, and what stands beside it.

>>> chosen = by_name(["t_s", "mag_x_mG", "mag_y_mG", "mag_z_mG"], np.zeros((2, 4)))
>>> chosen.field.cells, chosen.field.names, chosen.unit, chosen.time.names
((1, 2, 3), ('mag_x_mG', 'mag_y_mG', 'mag_z_mG'), 'mG', ('t_s',))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders import quaternions
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._beside import shares
from flinders.readers._lengths import advice, ascends, groups
from flinders.readers._log import FIRST, Choice, numbered
from flinders.readers._names import (
    ACCELERATION,
    ATTITUDE,
    CURRENT,
    CURRENTS,
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
    kind_of_chip,
    label,
    meaning,
    tells_nothing,
)
from flinders.readers._several import Vector, beside, instruments, passed_over, vectors
from flinders.samples import Samples
from flinders.units import Unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.axes import Axes

OF_MOTORS: Final = (CURRENTS, THROTTLES)
"""Kinds of which there may be a column for each motor."""
IN_SAMPLES: Final = (
    TIME, ACCELERATION, RATE, TEMPERATURE, CURRENT, STRENGTH, THROTTLE, ATTITUDE, CURRENTS, THROTTLES,
)  # fmt: skip
"""Kinds that stand beside the field, as `Samples` calls them."""
SHARES: Final = ("share", "percent", "pct", "%")
"""Units of a throttle that count from none; pulses count from `REST_US`."""
REST_US: Final = 1000.0
"""Width of the pulse that asks a motor for nothing; a thousand more asks for all."""
PULSES_US: Final = (800.0, 2200.0)
"""Widths that such pulses have."""
EPOCHS: Final = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))
"""From which value on a time counts from 1970, in ns, µs, ms and s; four times it is the year 2096."""
COARSE: Final = 10
"""Readings to one time from which on the digits of the time are too few: buffers of sensors give a few at once."""
COARSE_S: Final = 1.0
"""Resolution from which on a time that does not change in the first readings is cut, and its clock not at rest."""
LONG: Final = 1e8
"""Seconds after which a time is taken to count from 1970 and not from the start of the recording."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column, or three of one sensor, or one of each motor.

    Attributes
    ----------
    kind : str
        As in `Meaning`.
    cells : tuple of int
        Places in a line, counted from 0; x, y, z, or motor by motor.
    names : tuple of str
        As the header has them, or their numbers counted from 1.
    factor : float
        What one unit of it is in the unit used inside.
    start : float
        What is taken from it before, in its own unit.
    unit : str
        Of a strength, where its name states one; else it is in the unit of the field.
    axes : tuple of int
        Of the field of a level recording: which axes its two columns are; the third is 0.
    """

    kind: str
    cells: tuple[int, ...]
    names: tuple[str, ...]
    factor: float = 1.0
    start: float = 0.0
    unit: str = ""
    axes: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns that are read.

    Attributes
    ----------
    field : Column
        The magnetometer.
    unit, scale : str, float or None
        Its unit as the header states it, or as the format has it by convention; µT in a count where that is known.
    stated : bool
        The unit stands in the header, and must not be contradicted.
    beside : tuple of Column
        At most one of each other kind.
    left_out : tuple of str
        Columns that were recognised and cannot be used, each with the reason.
    name : str
        Of several magnetometers in one table, what this one is called; empty where it is the only one.
    magnetometers : tuple of Columns
        Those of each of them, in order; empty where there is one.
    others : tuple of str
        Numbers and names of the other ones, where nobody has said which is meant.
    passed_over : tuple of str
        What else is named like a magnetometer and is none of its own, with what it is where that is known.
    """

    field: Column
    unit: str = ""
    scale: float | None = None
    stated: bool = False
    beside: tuple[Column, ...] = ()
    left_out: tuple[str, ...] = ()
    name: str = ""
    magnetometers: tuple[Columns, ...] = ()
    others: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()

    @property
    def time(self) -> Column | None:
        """When each reading was taken, where that is known."""
        return self.of_kind(TIME)

    def of_kind(self, kind: str) -> Column | None:
        """Find the column of a kind."""
        return next((column for column in self.beside if column.kind == kind), None)

    def only(self, *kinds: str) -> Columns:
        """The field, and of what stands beside it only some kinds."""
        return replace(self, beside=tuple(column for column in self.beside if column.kind in kinds))

    @property
    def cells(self) -> tuple[int, ...]:
        """All places in a line that are read, in order."""
        return tuple(sorted({cell for column in (self.field, *self.beside) for cell in column.cells}))

    @property
    def needed(self) -> frozenset[int]:
        """Those without which a line cannot be used: the field."""
        return frozenset(self.field.cells)

    def with_strength_in(self, unit: Unit) -> Columns:
        """Scale the column of strengths to the unit of the field; without it where the two have nothing in common."""
        strength = self.of_kind(STRENGTH)
        if strength is None or not strength.unit:
            return self
        own, others = Unit.of(strength.unit), tuple(column for column in self.beside if column is not strength)
        if own.inside == unit.inside:
            return replace(self, beside=(*others, replace(strength, factor=own.scale / unit.scale)))
        reason = f"{strength.names[0]} (in {own.inside}, the field in {unit.inside}: give --unit, or --scale)"
        return replace(self, beside=others, left_out=(*self.left_out, reason))

    def taken(self, values: Floats, column: Column) -> Floats:
        """Pick one of the columns from what was read of `cells`; a view where that lies column by column, in order."""
        places = [self.cells.index(cell) for cell in column.cells]
        if values.flags.fnc and places == list(range(places[0], places[0] + len(places))):
            return values[:, places[0] : places[0] + len(places)]
        return values[:, places]

    def told(self, unit: str) -> str:
        """Say which columns are read, in which unit; of several magnetometers, which one."""
        which = f"{self.name}, " if self.name else ""
        time = f", time in {self.time.names[0]}" if self.time else ""
        chip = next((word for word in label(self.field.names[0]) if kind_of_chip(word) == FIELD), "")
        known = f" ({chip.upper()} is a magnetometer)" if chip else ""
        return f"{which}columns {', '.join(self.field.names)}{known} in {unit}{time}"

    def told_besides(self) -> list[str]:
        """Say what is left out, which other magnetometers there are, and what is named like one."""
        told = [f"left out {', '.join(self.left_out)}"] * bool(self.left_out)
        told += [f"also there: {numbered(self.others)} (choose with --sensor)"] * bool(self.others)
        return told + [f"passed over: {numbered(self.passed_over)}"] * bool(self.passed_over)

    def samples(self, values: Floats, *, unit: Unit, axes: Axes, source: str, frame: str = "sensor") -> Samples:
        """Make samples of (N, len(cells)) values: the field, and what stands beside it in the units of `Samples`."""
        field = self.taken(values, self.field)
        if len(self.field.cells) == 2:
            level = np.zeros((len(field), 3))
            level[:, self.field.axes] = field
            field = level
        others = {kind: self._beside(values, kind) for kind in IN_SAMPLES}
        for kind, known in ((THROTTLE, shares), (THROTTLES, shares), (ATTITUDE, quaternions.known)):
            column = others[kind]
            others[kind] = None if column is None else known(column)
        found = Samples.of(field, unit=unit, scale=None, axes=axes, source=source, **others)
        return found if frame == found.frame else replace(found, frame=frame)

    def _beside(self, values: Floats, kind: str) -> Floats | None:
        """Take what stands beside the field, if it is there."""
        column = self.of_kind(kind)
        if column is None:
            return None
        with np.errstate(over="ignore"):
            taken = (self.taken(values, column) - column.start) * column.factor
        infinite = np.isinf(taken)
        if infinite.any():
            taken[infinite] = np.nan
        return taken[:, 0] if len(column.cells) == 1 and kind not in OF_MOTORS else taken


def names_magnetometer(names: Sequence[str]) -> bool:
    """Tell whether three of these names are those of a magnetometer."""
    return bool(vectors(names, [meaning(name) for name in names], FIELD))


def by_name(
    names: Sequence[str], values: Floats, wanted: Sequence[int] = (), units: Sequence[str] = ()
) -> Columns | None:
    """Choose columns by their names.

    Parameters
    ----------
    names : sequence of str
        The header.
    values : (N, len(names)) float
        The first rows, NaN where a cell is not a number.
    wanted : three int, optional
        Places of the magnetometer's columns, where the user said which.
    units : sequence of str, optional
        What stands below the names, for those that state no unit.

    Returns
    -------
    Columns or None
        Of several magnetometers those of the first, which knows them all; None where none is recognised. Those that
        are wanted have the name of the magnetometer of several that they are, or of which they are a copy.
    """
    meanings = [_meaning(*column) for column in zip_longest(names, units[: len(names)], fillvalue="")]
    found = vectors(names, meanings, FIELD)
    fields = instruments(found)
    free = [Meaning("") if place in wanted else known for place, known in enumerate(meanings)]
    around = partial(
        _around,
        fields=fields,
        axes=[(kind, vectors(names, free, kind)) for kind in (ACCELERATION, RATE)],
        names=names,
        meanings=meanings,
        values=values,
    )
    if wanted:
        own = next((each for each in found if set(wanted) <= set(each.cells)), Vector(tuple(wanted), 0, (), ""))
        name = own.name if own in fields else own.whole
        return replace(around(own._replace(cells=tuple(wanted))), name=name if len(fields) > 1 else "")
    read = {place for field in fields for place in field.cells}
    unread = [place for place, name in enumerate(names) if fields and place not in read and tells_nothing(name)]
    recognised = [str(group) for group in groups(values, unread, names) if group.is_known]
    others = (*passed_over(found, fields), *recognised)
    made = [replace(around(field), passed_over=others) for field in fields]
    if len(made) < 2:
        return made[0] if made else None
    named = tuple(replace(columns, name=field.name) for columns, field in zip(made, fields, strict=True))
    return replace(named[0], magnetometers=named)


def _around(
    field: Vector,
    *,
    fields: Sequence[Vector],
    axes: Sequence[tuple[str, Sequence[Vector]]],
    names: Sequence[str],
    meanings: Sequence[Meaning],
    values: Floats,
) -> Columns:
    """Put together what is read for one of the magnetometers of a table."""
    free = [Meaning("") if place in field.cells else found for place, found in enumerate(meanings)]
    stated = {meanings[cell].unit for cell in field.cells if meanings[cell].kind == FIELD}
    unit = stated.pop() if len(stated) == 1 else ""
    found = [(kind, beside(each, field, fields)) for kind, each in axes]
    columns, left_out = _beside(names, free, values, [(kind, each.cells) for kind, each in found if each])
    unread = [
        one for (_, each), (_, taken) in zip(axes, found, strict=True) if not taken for one in each if one.instead
    ]
    return Columns(
        field=Column(FIELD, field.cells, tuple(names[cell].strip() for cell in field.cells)),
        unit=unit or _by_convention(names, field.cells),
        stated=bool(unit),
        beside=columns,
        left_out=(*left_out, *(f"{one.whole} ({one.instead})" for one in unread)),
    )


def by_place(values: Floats, wanted: Sequence[int] = ()) -> Columns | None:
    """Choose columns of a table without a header: three are x, y, z; of four, a first that ascends is the time.

    Parameters
    ----------
    values : (N, width) float
        The first rows, NaN where a cell is not a number.
    wanted : three int, optional
        Places of the magnetometer's columns, where the user said which.
    """
    width = values.shape[1]
    timed = width == 4 and not wanted and ascends(values[:, 0])
    field = tuple(wanted) or ((0, 1, 2) if width == 3 else (1, 2, 3) if timed else ())
    if not field:
        return None
    time = (_time(Column(TIME, (0,), ("1",)), "", values[:, 0]),) if timed else ()
    return Columns(Column(FIELD, field, tuple(str(cell + 1) for cell in field)), beside=time)


def choose(
    names: Sequence[str],
    values: Floats,
    asked: str | None = None,
    *,
    units: Sequence[str] = (),
    flat: str | None = None,
    choice: Choice = FIRST,
    source: str = "the table",
) -> Columns | None:
    """Choose columns as the user asked, else by their names, else by their places; None where neither tells.

    Parameters
    ----------
    names : sequence of str
        The header; empty where there is none.
    values : (N, width) float
        The first rows, NaN where a cell is not a number.
    asked : str, optional
        As `wanted_places`.
    units : sequence of str, optional
        What stands below the names.
    flat : str, optional
        The plane whose two columns will do: two that are asked for, or the only two there are.
    choice : Choice, optional
        Which of several magnetometers.
    source : str
        For messages.

    Raises
    ------
    NoMagnetometer
        Where all that is named like one is not a magnetometer's readings; where names do not tell, with what the
        values say of which columns may be one.
    UsageError
        For columns that there are not, or a magnetometer; for columns of another magnetometer than `choice` names.
    """
    width = values.shape[1]
    if flat is not None and asked is None and width == 2:
        asked = "1,2"
    wanted = () if asked is None else wanted_places(asked, names, width, flat=flat is not None)
    chosen = by_name(names, values, wanted, units) if names else by_place(values, wanted)
    if asked is None and (chosen is None or _is_unclear(chosen)):
        _refuse_no_readings(names, source)
        _refuse_unclear(names, values, source)
    if chosen is None:
        return None
    if asked is None:
        chosen = _chosen(chosen, choice, source)
    else:
        every = by_name(names, values, units=units)
        chosen = _named(chosen, every.magnetometers if every else (), choice, asked, source)
    if flat is None or len(wanted) != 2:
        return chosen
    return replace(chosen, field=replace(chosen.field, axes=tuple(map("xyz".index, flat))))


def _refuse_no_readings(names: Sequence[str], source: str) -> None:
    """Refuse a table of nothing but references and the like; of one without them too, nothing is said.

    Raises
    ------
    NoMagnetometer
    """
    found = [each for each in vectors(names, list(map(meaning, names)), FIELD) if each.instead]
    if found:
        told = numbered([f"{each.whole} ({each.instead})" for each in found])
        columns = ",".join(names[cell].strip() for cell in found[0].cells)
        raise NoMagnetometer(
            f"no readings of a magnetometer among the columns of {source}: by its name each is something else, {told}; "
            f"say which three columns are what the sensor read, such as --columns '{columns}' if those are it after all"
        )


def _is_unclear(columns: Columns) -> bool:
    """Tell whether columns are one of several triples that are named x, y, z and nothing else."""
    return len(columns.magnetometers) > 1 and not columns.stated and meaning(columns.field.names[0]).is_bare


def _refuse_unclear(names: Sequence[str], values: Floats, source: str) -> None:
    """Refuse a table whose names do not tell, where values say something of its columns.

    Raises
    ------
    NoMagnetometer
    """
    width = values.shape[1]
    judged = groups(values, [place for place in range(width) if not names or tells_nothing(names[place])], names)
    if any(group.is_candidate or group.is_known or (names and len(group.names) > 1) for group in judged):
        nameless = f"{source} has {width} columns and no header: need three, x y z, or four with the time first"
        what = f"names do not tell which columns of {source} are the magnetometer" if names else nameless
        raise NoMagnetometer(f"{what}; {advice(judged)}")


def _named(columns: Columns, magnetometers: Sequence[Columns], choice: Choice, asked: str, source: str) -> Columns:
    """Let the columns that the user asked for keep the name of the magnetometer that they are, or have the user's.

    Raises
    ------
    UsageError
        Where the user names another one of those that the table has.
    """
    if choice.sensor is None:
        return columns
    if not choice.is_name:
        raise UsageError("--columns and --sensor both say which magnetometer it is: leave one of them out")
    wanted = choice.sensor.strip().casefold()
    for number, other in enumerate(magnetometers, 1):
        if wanted in (str(number), other.name.casefold()):
            if other.name == columns.name:
                return columns
            own = columns.name or "none of its magnetometers"
            raise UsageError(
                f"--columns {asked} is {own} in {source}, and --sensor {choice.sensor} says {other.name}: leave one of "
                "them out, or name the sensor differently"
            )
    return replace(columns, name="")


def _chosen(columns: Columns, choice: Choice, source: str) -> Columns:
    """Take the magnetometer that is meant; where nobody says, the first, which then knows the names of the others.

    Raises
    ------
    UsageError
        For one that there is not, or where there is nothing to choose from.
    """
    if not columns.magnetometers:
        choice.refuse_beside(source)
        return columns
    names = [each.name for each in columns.magnetometers]
    place = choice.among(names, source)
    others = tuple(f"{number} {name}" for number, name in enumerate(names[1:], 2)) if choice.is_open else ()
    return replace(columns.magnetometers[place], magnetometers=columns.magnetometers, others=others)


def asked_columns(columns: str, *, flat: bool = False) -> list[str]:
    """Take apart what the user asked for: three names or numbers; two will do if `flat`.

    Raises
    ------
    UsageError
    """
    asked = [part.strip() for part in columns.split(",")]
    count = len(asked)
    if not (count == 3 or (flat and count == 2)) or len({part.casefold() for part in asked}) != count:
        need = "two or three different ones, such as 'mx,my' or '4,5'" if flat else _three(count)
        raise UsageError(f"columns {columns!r}: need {need}")
    return asked


def wanted_places(columns: str, names: Sequence[str], width: int, *, flat: bool = False) -> tuple[int, ...]:
    """Look up what the user asked for: three names, or three numbers counted from 1; two will do if `flat`.

    Raises
    ------
    UsageError
        Listing the columns there are.
    """
    asked = asked_columns(columns, flat=flat)
    known = [name.strip() for name in names]
    count = len(asked)
    places = tuple(_place(part, known, width) for part in asked)
    if len(set(places)) != count:
        many = "two" if count == 2 else "three"
        raise UsageError(f"columns {columns!r} name one column twice: need {many} different ones")
    return places


def wanted_acceleration(asked: str, names: Sequence[str], columns: Columns, width: int) -> Columns:
    """Take the accelerometer's columns from where the user says, as `wanted_places` those of the magnetometer.

    Raises
    ------
    UsageError
        Also where one of them is read as the magnetometer, or lines differ in length.
    """
    if not width:
        raise UsageError(f"acceleration {asked!r}: lines differ in length, so that columns cannot be counted")
    places = wanted_places(asked, names, width)
    shown = tuple(names[place].strip() if names else str(place + 1) for place in places)
    if taken := [name for name, place in zip(shown, places, strict=True) if place in columns.field.cells]:
        raise UsageError(f"acceleration {asked!r}: {', '.join(taken)} is read as the magnetometer; see --columns")
    others = tuple(column for column in columns.beside if column.kind != ACCELERATION)
    return replace(columns, beside=(*others, Column(ACCELERATION, places, shown)))


def _three(given: int) -> str:
    two = "; two columns, x and y of a level turn, are for flinders two-axis" if given == 2 else ""
    return f"three different ones, such as 'mx,my,mz' or '4,5,6'{two}"


def _meaning(name: str, unit: str) -> Meaning:
    """Tell what a name says, together with the unit that stands below it."""
    found = meaning(name)
    return found if found.unit or not unit else meaning(f"{name} ({unit})")


def _place(asked: str, names: list[str], width: int) -> int:
    if asked in names:
        return names.index(asked)
    folded = [name.casefold() for name in names]
    if asked.casefold() in folded:
        return folded.index(asked.casefold())
    if asked.isdecimal() and 1 <= int(asked) <= width:
        return int(asked) - 1
    there = f"its columns are {', '.join(names)}" if names else f"it has no header and {width} columns"
    raise UsageError(f"there is no column {asked!r}: {there}; give three names or numbers from 1 to {width}")


def _by_convention(names: Sequence[str], field: tuple[int, ...]) -> str:
    """Tell the unit that a known format has without saying so: ROS messages, the app Sensor Logger."""
    first = names[field[0]].casefold()
    if first.endswith("magnetic_field.x"):
        return "T"
    return "uT" if {name.strip().casefold() for name in names} >= {"seconds_elapsed", "x", "y", "z"} else ""


def _beside(
    names: Sequence[str], meanings: Sequence[Meaning], values: Floats, triples: Sequence[tuple[str, tuple[int, ...]]]
) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """Find what stands beside the magnetometer and those three axes, and what has to be left out."""
    found = [Column(kind, cells, tuple(names[cell].strip() for cell in cells)) for kind, cells in triples]
    turned = {known.axis: place for place, known in enumerate(meanings) if known.kind == ATTITUDE}
    if len(turned) == 4:
        cells = tuple(turned[axis] for axis in "wxyz")
        found.append(Column(ATTITUDE, cells, tuple(names[cell].strip() for cell in cells)))
    left_out: list[str] = []
    for kind in (TIME, TEMPERATURE, CURRENT, STRENGTH, THROTTLE):
        column, reasons = _scalar(names, meanings, values, kind)
        found += [column] if column else []
        left_out += reasons
    for kind in OF_MOTORS:
        column, reason = _of_motors(names, meanings, values, kind)
        found += [column] if column else []
        left_out += [reason] if reason else []
    scaled: list[Column] = []
    for column in found:
        unit = meanings[column.cells[0]].unit
        if column.kind == TIME:
            scaled.append(_time(column, unit, values[:, column.cells[0]]))
        elif column.kind == RATE and not unit:
            left_out.append(f"{', '.join(column.names)} (neither deg/s nor rad/s in the names)")
        else:
            factor = {**FACTORS, **FACTORS_OF_MOTORS}.get(column.kind, {}).get(unit, 1.0)
            start = REST_US if column.kind == THROTTLES and unit not in SHARES else 0.0
            scaled.append(replace(column, factor=factor, start=start, unit=unit if column.kind == STRENGTH else ""))
    return tuple(scaled), tuple(left_out)


def _scalar(
    names: Sequence[str], meanings: Sequence[Meaning], values: Floats, kind: str
) -> tuple[Column | None, list[str]]:
    """The best usable column of a kind that has no axes, and those before it with the reason against each."""
    places = [place for place, known in enumerate(meanings) if known.kind == kind and not known.axis]
    left_out: list[str] = []
    for place in sorted(places, key=lambda place: meanings[place].rank):
        name, reason = names[place].strip(), "" if _numeric(values[:, place]) else "not numbers"
        if kind == TIME and not reason:
            reason = _cut_digits(values[:, place], meanings[place].unit)
        if not reason:
            return Column(kind, (place,), (name,)), left_out
        left_out.append(f"{name} ({reason})")
    return None, left_out


def _of_motors(
    names: Sequence[str], meanings: Sequence[Meaning], values: Floats, kind: str
) -> tuple[Column | None, str]:
    """The columns of single motors, from the first motor on; and why there are none, where some are named so."""
    numbered = {int(known.axis): place for place, known in enumerate(meanings) if known.kind == kind}
    if not numbered:
        return None, ""
    cells = tuple(numbered[number] for number in sorted(numbered))
    column = Column(kind, cells, tuple(names[cell].strip() for cell in cells))
    told = ", ".join(column.names)
    if sorted(numbered) != list(range(min(numbered), max(numbered) + 1)) or min(numbered) > 1:
        return None, f"{told} (motors are missing between: need each from the first on)"
    if not all(_numeric(values[:, cell]) for cell in cells):
        return None, f"{told} (not numbers)"
    units = {meanings[cell].unit for cell in cells}
    if len(units) > 1:
        return None, f"{told} (in more than one unit)"
    if kind == THROTTLES and units == {""} and not _are_pulses(values[:, cells]):
        return None, f"{told} (neither shares nor µs: say so in the names, as throttle1_share)"
    return column, ""


def _are_pulses(values: Floats) -> bool:
    """Tell whether numbers are the widths of pulses that a speed controller takes, in µs."""
    told = values[np.isfinite(values)]
    return len(told) > 0 and bool(np.all((told >= PULSES_US[0]) & (told <= PULSES_US[1])))


def _numeric(values: Floats) -> bool:
    """Tell whether at least half of the first values are numbers."""
    return len(values) == 0 or bool(np.isfinite(values).mean() >= 0.5)


def _time(column: Column, unit: str, values: Floats) -> Column:
    """Find the factor to seconds, and where a clock that counts from 1970 starts."""
    values = values[np.isfinite(values)]
    first = float(values[0]) if len(values) else 0.0
    factor = _factor_to_seconds(values, unit)
    return replace(column, factor=factor, start=first if abs(first) * factor > LONG else 0.0)


def _factor_to_seconds(values: Floats, unit: str) -> float:
    """Take the factor of the unit that a time states, else that which its size and steps tell."""
    if unit:
        return FACTORS[TIME][unit]
    with np.errstate(over="ignore"):  # of numbers that are no times
        step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    return _seconds(float(values[0]) if len(values) else 0.0, step)


@np.errstate(over="ignore")
def _cut_digits(values: Floats, unit: str) -> str:
    """Say that a time was stored or written with too few digits for its readings; nothing where it was not.

    Many readings share each time then, and the next time is one unit in the last digit later. Readings that a sensor
    hands over together share a time as well, but their times lie further apart than their digits.

    >>> times = np.repeat([1732190000.0, 1732190128.0, 1732190256.0], 60)
    >>> _cut_digits(times.astype(np.float32).astype(float), "s")
    'its digits were cut to steps of 128 s, 60 readings to each: write more of them, as float64'
    >>> _cut_digits(np.repeat([0.000, 0.320, 0.641, 0.960], 32), "s")  # a buffer of 32
    ''
    """
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
    told = "its digits were cut to steps of {:.3g} s, {} readings to each: write more of them, as float64"
    return told.format(max(steps) * factor, many) if steps else ""


def _resolutions(values: Floats) -> list[float]:
    """Tell which units in the last digit these numbers may have: the last that is written, and that of float32."""
    digits = [Decimal(repr(value)).normalize().as_tuple().exponent for value in values.tolist() if value]
    single = np.abs(values.astype(np.float32))
    is_single = bool(digits) and bool(np.all(single == np.abs(values)))
    written = [10.0 ** min(map(int, digits))] if digits else []
    return [*written, float(np.spacing(single.max()))] if is_single else written


def _seconds(first: float, step: float) -> float:
    """Guess the unit of a time from its size, then from its steps: seconds, ms, µs or ns.

    Readings are taken to come between every 10 µs and every 10 s.
    """
    for least, factor in EPOCHS:
        if least <= first < 4 * least and (step == 0 or 1e-5 <= step * factor <= 10):
            return factor
    return 1.0 if step < 2 else 1e-3 if step < 1e3 else 1e-6 if step < 5e5 else 1e-9
