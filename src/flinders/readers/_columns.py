"""Columns that are read from a table: those of the magnetometer with its unit, and auxiliary ones.

>>> field = column_of("field", (1, 2, 3), ["t_s", "mx", "my", "mz"])
>>> columns = Columns(field, auxiliary=(column_of("time", (0,), ["t_s"]),))
>>> columns.cells, columns.contents("uT")
((0, 1, 2, 3), 'columns mx, my, mz in uT, time in t_s')
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np

from flinders.core.samples import COLUMNS, Samples
from flinders.core.units import COUNTS, Unit
from flinders.errors import UnitError, figures
from flinders.geometry import quaternions
from flinders.readers._choice import Form, list_names
from flinders.readers._names import (
    ATTITUDE,
    AUXILIARY,
    CURRENTS,
    FIELD,
    STRENGTH,
    THROTTLE,
    THROTTLES,
    TIME,
    kind_of_chip,
    label,
)
from flinders.readers._resample import throttle_shares

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.time_span import TimeSpan
    from flinders.readers._clock import Clock
    from flinders.readers._devices import Device
    from flinders.readers._source import Source

Values: TypeAlias = "NDArray[np.floating] | Sequence[NDArray[np.floating]]"
"""(N,) numbers of each column that is read, as a table or as a list of columns."""
MOTOR_KINDS: Final = (CURRENTS, THROTTLES)  # kinds that may have a column for each motor
SAMPLE_KINDS: Final = COLUMNS[1:]  # kinds of auxiliary columns in `Samples`
# functions that set values out of range to NaN
VALIDATORS: Final = {THROTTLE: throttle_shares, THROTTLES: throttle_shares, ATTITUDE: quaternions.valid_attitudes}


@dataclass(frozen=True, slots=True)
class Column:
    """One column, the three columns of one sensor, or one column for each motor."""

    kind: str  # kind of quantity, as in `Meaning`
    cells: tuple[int, ...]  # places in a line, counted from 0: x, y, z, or motor by motor
    names: tuple[str, ...]  # names in the header, or numbers counted from 1
    factor: float = 1.0  # from its unit to the internal unit
    start: float = 0.0  # zero point in the column's own unit, which is subtracted before scaling
    unit: str = ""  # unit of a field strength, if its name states one; otherwise it has the unit of the field
    axes: tuple[int, ...] = (0, 1, 2)  # for the two columns of a level recording: their axes; the third axis reads 0
    clock: Clock | None = None  # clock of a time that is not numeric


@dataclass(frozen=True)
class Columns:
    """The columns of a table that are read."""

    field: Column  # the magnetometer
    unit: str = ""  # unit of the field by the header, or by convention of the format
    stated: bool = False  # whether the header states the unit, so that the user cannot give another one
    auxiliary: tuple[Column, ...] = ()  # auxiliary columns, at most one of each kind
    left_out: tuple[str, ...] = ()  # recognised columns that cannot be used, each with the reason
    unread_time: str = ""  # names of columns that look like a time, if none is read
    name: str = ""  # name of one of several magnetometers in a table
    magnetometers: tuple[Columns, ...] = ()  # columns of each of several magnetometers, in order
    others: tuple[str, ...] = ()  # numbers and names of the other magnetometers, if none was selected
    # sensors whose names resemble a magnetometer's but which are none, with their kind
    passed_over: tuple[str, ...] = ()
    form: Form | None = None  # form of the table, if the columns were requested
    # readings after a reset pulse, if `field` has those after a set pulse
    reset: Column | None = None
    own_offset: tuple[
        float, ...
    ] = ()  # offset of a sensor with set and reset, (3,) in its unit, from the first rows: (set + reset) / 2
    device: Device | None = None  # device whose rows are read, if a column distinguishes several devices
    is_assumed: bool = False  # whether neither the names nor the user say that the columns are a magnetometer's

    @property
    def time(self) -> Column | None:
        """Column of the time of each reading; None if there is none."""
        return self.of_kind(TIME)

    @property
    def clock(self) -> Clock | None:
        """Clock of a time that is not numeric; None for other times."""
        return self.time.clock if self.time else None

    def of_kind(self, kind: str) -> Column | None:
        """Column of a kind; None if there is none."""
        return next((column for column in self.auxiliary if column.kind == kind), None)

    def with_only(self, *kinds: str) -> Columns:
        """Columns of the field, with auxiliary columns of these kinds only."""
        return replace(self, auxiliary=tuple(column for column in self.auxiliary if column.kind in kinds))

    @cached_property
    def cells(self) -> tuple[int, ...]:
        """Places in a line that are read, in order."""
        columns = (self.field, *self.auxiliary, *filter(None, [self.reset]))
        return tuple(sorted({cell for column in columns for cell in column.cells}))

    def with_auxiliary(self, names: Iterable[str], places: Iterable[int]) -> Columns:
        """Columns with further auxiliary ones, by name and place; also for each of several magnetometers."""
        asked = tuple(Column(AUXILIARY, (place,), (name,)) for name, place in zip(names, places, strict=True))
        several = tuple(replace(each, auxiliary=(*each.auxiliary, *asked)) for each in self.magnetometers)
        return replace(self, auxiliary=(*self.auxiliary, *asked), magnetometers=several)

    @property
    def needed_cells(self) -> frozenset[int]:
        """Places that a usable line must have: those of the field, in both polarities if two are recorded."""
        return frozenset((*self.field.cells, *(self.reset.cells if self.reset else ())))

    def with_strength_in(self, unit: Unit) -> Columns:
        """Scale the field strength to the unit of the field; it is left out if the units are incompatible."""
        strength = self.of_kind(STRENGTH)
        if strength is None or not strength.unit:
            return self
        own, others = Unit.of(strength.unit), tuple(column for column in self.auxiliary if column is not strength)
        if own.inside == unit.inside:
            return replace(self, auxiliary=(*others, replace(strength, factor=own.scale / unit.scale)))
        reason = f"{strength.names[0]} (in {own.inside}, the field in {unit.inside}: give its unit or scale)"
        return replace(self, auxiliary=others, left_out=(*self.left_out, reason))

    def in_stated_unit(self, unit: str) -> Columns:
        """Columns in a unit that the table states outside its names; a unit in a name takes precedence."""
        told = self if self.unit else replace(self, unit=unit, stated=True, is_assumed=False)
        return replace(told, magnetometers=tuple(each.in_stated_unit(unit) for each in self.magnetometers))

    def with_given_unit(self, unit: str | None, scale: float | None) -> Columns:
        """Columns that no longer count as assumed if the user gives the unit."""
        return self if unit is None and scale is None else replace(self, is_assumed=False)

    def values_of_column(self, values: Values, column: Column) -> Floats:
        """(N, k) numbers of a column, from the values of the places in `cells`."""
        return np.stack([values[self.cells.index(cell)] for cell in column.cells], axis=1, dtype=np.float64)

    def readings(self, values: Values) -> Floats:
        """(N, 3) field as recorded, from the values of `cells`; half of set minus reset if both are recorded."""
        field = self.values_of_column(values, self.field)
        if self.reset is not None:
            field = (field - self.values_of_column(values, self.reset)) / 2.0
        if len(self.field.cells) == 2:
            level = np.zeros((len(field), 3))
            level[:, self.field.axes] = field
            field = level
        return field

    def describe(self, unit: str) -> str:
        """Describe the columns and the unit that are read, with the magnetometer's name if there are several."""
        return f"{f'{self.name}, ' if self.name else ''}{self.contents(unit)}"

    def contents(self, unit: str) -> str:
        """Describe the columns and unit that are read."""
        time = f", time in {' and '.join(self.time.names)}" if self.time else ""
        chip = next((word for word in label(self.field.names[0]) if kind_of_chip(word) == FIELD), "")
        known = f" ({chip.upper()} is a magnetometer)" if chip else ""
        less = f" less {', '.join(self.reset.names)}, halved," if self.reset else ""
        rows = f", of rows with {' '.join(self.device.words)}" if self.device and not self.name else ""
        return f"columns {', '.join(self.field.names)}{less}{known} in {unit}{time}{rows}"

    def remarks(self) -> list[str]:
        """Remarks on columns that are left out, on other magnetometers, and on sensors with similar names."""
        parts = [f"left out {', '.join(self.left_out)}"] * bool(self.left_out)
        own = ", ".join(figures(value) for value in self.own_offset)
        parts += [f"the sensor's own offset, (set + reset) / 2, was {own} at the beginning"] * bool(own)
        parts += [f"also there: {list_names(self.others)} (choose with --sensor)"] * bool(self.others)
        return parts + [f"passed over: {list_names(self.passed_over)}"] * bool(self.passed_over)

    def samples(
        self,
        values: Values,
        *,
        unit: Unit,
        axes: Axes,
        source: str,
        frame: str = "sensor",
        words: Mapping[str, NDArray[np.str_]] | None = None,
    ) -> Samples:
        """Make samples from the values of `cells`: the field, and auxiliary columns in the units of `Samples`.

        `words` are the requested columns of words, (N,) each, by name.
        """
        field = self.readings(values)
        asked = {each.names[0]: self._values_of(values, each) for each in self.auxiliary if each.kind == AUXILIARY}
        others = {each.kind: self._values_of(values, each) for each in self.auxiliary if each.kind in SAMPLE_KINDS}
        nameless = ",".join(self.field.names) * self.is_assumed
        return Samples.from_reader(
            field,
            unit=unit,
            axes=axes,
            source=source,
            frame=frame,
            nameless=nameless,
            auxiliary={**asked, **(words or {})},
            **others,
        )

    def _values_of(self, values: Values, column: Column) -> Floats:
        """Values of a column in the unit of `Samples`; invalid values become NaN."""
        kind = column.kind
        with np.errstate(over="ignore", invalid="ignore"):
            recorded = self.values_of_column(values, column)
            taken = (recorded - column.start) * column.factor
            if kind == TIME and len(column.cells) == 2:
                taken = taken[:, :1] + 1e-9 * recorded[:, 1:]
        taken[np.isinf(taken)] = np.nan
        if taken.shape[1] == 1 and kind not in MOTOR_KINDS:
            taken = taken[:, 0]
        return VALIDATORS[kind](taken) if kind in VALIDATORS else taken


def column_of(kind: str, cells: Sequence[int], names: Sequence[str]) -> Column:
    """A column with its name in the header; without a name, with its number counted from 1."""
    return Column(kind, tuple(cells), tuple((names[cell].strip() if names else "") or str(cell + 1) for cell in cells))


class ColumnsRecording:
    """Base of recordings that consist of columns, as text or as another table."""

    file: Source
    source: str  # name of the file
    unit: Unit
    axes: Axes
    span: TimeSpan
    is_unit_given: bool
    columns: Any  # a field or a property with `Columns`

    @property
    def name(self) -> str:
        """Name of the magnetometer, if the table has several; empty otherwise."""
        return str(self.columns.name)

    @property
    def states_unit(self) -> bool:
        """Whether the unit is stated in the names or given by the user."""
        return bool(self.columns.stated) or self.is_unit_given

    def with_columns(self, columns: Columns, unit: str | None, scale: float | None) -> Self:
        """The recording of these columns, in the unit that their names state or the user gives."""
        raise NotImplementedError

    def written(self) -> str:
        """Description of the format."""
        raise NotImplementedError

    def each(self, unit: str | None, scale: float | None) -> tuple[Self, ...]:
        """A recording for each of several magnetometers, in the unit of its names or of the user; else empty."""
        return tuple(self.with_columns(columns, unit, scale) for columns in self.columns.magnetometers)

    def describe(self) -> str:
        """Describe in one line the recognised columns that are used."""
        return f"{self.source}: {self.contents()}"

    __str__ = describe

    def contents(self, *, is_named: bool = True) -> str:
        """Describe the columns without the file name; unless `is_named`, without the magnetometer's name too."""
        unit = f"counts of {self.unit.scale:g} µT" if self.unit.name == COUNTS != self.unit.inside else self.unit.name
        columns = self.columns.describe(unit) if is_named else self.columns.contents(unit)
        parts = [columns, self.written()]
        parts += [f"axes {self.axes}"] * (not self.axes.is_identity) + [str(self.span)] * (not self.span.is_all)
        return "; ".join(parts + self.columns.remarks())


def unit_of(columns: Columns, name: str, unit: str | None, scale: float | None) -> Unit:
    """Unit that the header states or the user gives; raises `UnitError` if they contradict each other."""
    if unit is not None:
        chosen = Unit.of(unit, scale)
        if columns.stated and chosen.name != columns.unit:
            raise UnitError(
                f"the header of {name} says {columns.unit} ({columns.field.names[0]}) and unit {unit!r} was given: "
                "leave the unit out, or correct the header"
            )
        return chosen
    if scale is not None:
        return Unit.of(columns.unit if columns.stated else COUNTS, scale)
    return Unit.of(columns.unit or COUNTS)
