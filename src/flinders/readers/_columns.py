"""Columns of a table that are read: the magnetometer's, its unit, and the auxiliary ones beside it.

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
from flinders.readers._choice import Form, numbered
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
from flinders.readers._resample import shares

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
"""(N,) numbers of each column that is read."""
OF_MOTORS: Final = (CURRENTS, THROTTLES)  # kinds of which each motor may have a column
IN_SAMPLES: Final = COLUMNS[1:]  # kinds that stand beside the field
VALID: Final = {THROTTLE: shares, THROTTLES: shares, ATTITUDE: quaternions.known}  # values out of range become NaN


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

    def with_auxiliary(self, names: Iterable[str], places: Iterable[int]) -> Columns:
        """The same with columns that are asked for, by their names and places; of each magnetometer, too."""
        asked = tuple(Column(AUXILIARY, (place,), (name,)) for name, place in zip(names, places, strict=True))
        several = tuple(replace(each, auxiliary=(*each.auxiliary, *asked)) for each in self.magnetometers)
        return replace(self, auxiliary=(*self.auxiliary, *asked), magnetometers=several)

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
        """Make samples of values of `cells`: the field, and its auxiliary columns in the units of `Samples`.

        `words`: (N,) columns of words that were asked for, by name.
        """
        field = self.readings(values)
        asked = {each.names[0]: self._values_of(values, each) for each in self.auxiliary if each.kind == AUXILIARY}
        others = {each.kind: self._values_of(values, each) for each in self.auxiliary if each.kind in IN_SAMPLES}
        nameless = ",".join(self.field.names) * self.is_assumed
        return Samples.recorded(
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


def column_of(kind: str, cells: Sequence[int], names: Sequence[str]) -> Column:
    """Name a column as the header does, or by its number counted from 1 where it has no name."""
    return Column(kind, tuple(cells), tuple((names[cell].strip() if names else "") or str(cell + 1) for cell in cells))


class ColumnsRecording:
    """What recordings of columns have in common, of text and of other tables: what is said of them."""

    file: Source
    source: str  # name of the file
    unit: Unit
    axes: Axes
    span: TimeSpan
    is_unit_given: bool
    columns: Any  # a field or a property with `Columns`

    @property
    def name(self) -> str:
        """What the magnetometer is called, where it is one of several."""
        return str(self.columns.name)

    @property
    def states_unit(self) -> bool:
        """The unit stands in the names, or was given by whoever opened it."""
        return bool(self.columns.stated) or self.is_unit_given

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
