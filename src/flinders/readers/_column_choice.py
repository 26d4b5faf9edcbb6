"""Choice of the magnetometer's columns in a table: by request, by name, or by position.

>>> import numpy as np
>>> values = np.array([[0.0, 20, -3, 41], [0.1, 21, -4, 40], [0.2, 20, -5, 42]])
>>> choose(["t", "mx", "my", "mz"], values).field.cells, choose([], values).field.cells
((1, 2, 3), (1, 2, 3))
>>> choose(["t", "a", "b", "c"], values, "b,c,a").field.cells
(2, 3, 1)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flinders.core.plugins import remark
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._asked_columns import parse_columns, places_of_columns
from flinders.readers._choice import FIRST_SENSOR, Choice, Form, list_names
from flinders.readers._columns_by_name import by_name
from flinders.readers._columns_by_place import axes_of, by_place
from flinders.readers._instruments import vectors
from flinders.readers._likeness import advice, groups, only_rises
from flinders.readers._names import FIELD, is_inconclusive, meaning
from flinders.readers._tokenizer import list_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._clock import Clock
    from flinders.readers._columns import Columns
    from flinders.readers._devices import Device


def rising_in(values: Floats) -> list[int]:
    """Places of the columns whose values only rise."""
    return [place for place, column in enumerate(values.T) if only_rises(column)]


def choose(
    names: Sequence[str],
    values: Floats,
    asked: AnyColumns | None = None,
    *,
    units: Sequence[str] = (),
    clocks: Sequence[Clock] = (),
    flat: str | None = None,
    choice: Choice = FIRST_SENSOR,
    source: str = "the table",
    heading: str = "",
    quoted: str = "",
    cells: Sequence[str] = (),
    devices: Sequence[Device] = (),
    is_told: bool = False,
) -> Columns | None:
    """Choose columns by request, else by name, else by position; None if none of these identifies them.

    `heading` describes the header of a table without usable names. `quoted` and `cells` are its first line of readings,
    as text and as cells. `is_told` says that a word in each row names the sensor of that row.
    """
    width = values.shape[1]
    axes = [] if names or asked else axes_of(values)
    if flat is not None and asked is None:
        asked = _columns_of_level_turn(flat, names, width, axes)
    if asked is None:
        sensor = devices[0] if is_told else None
        chosen = by_name(names, values, (), units, clocks) if names else by_place(values, (), clocks, sensor)
        is_bare = chosen is not None and not chosen.stated and meaning(chosen.field.names[0]).is_bare
        if chosen is None or (is_bare and (chosen.magnetometers or "w" in [name.strip().casefold() for name in names])):
            _refuse_two(axes, width, source, quoted)
            _refuse_unclear(names, values, source, f"{heading or 'no header'}{quoted}", cells)
        return chosen and _choose_magnetometer(_of_devices(_mark_assumed(chosen), devices), choice, source)
    wanted = places_of_columns(asked, names, width, flat=flat is not None)
    chosen = by_name(names, values, wanted, units, clocks) if names else by_place(values, wanted, clocks)
    if chosen is None:
        return None
    form = Form.of(parse_columns(asked, flat=flat is not None), names, width, rising_in(values))
    chosen = _of_devices(replace(chosen, form=form), devices)
    if chosen.magnetometers:
        chosen = _choose_magnetometer(chosen, choice, source)
    else:
        every = by_name(names, values, (), units, clocks) if names else None
        chosen = _keep_name(chosen, every.magnetometers if every else (), choice, asked, source)
    if flat is None or len(wanted) != 2:
        return chosen
    return replace(chosen, field=replace(chosen.field, axes=tuple(map("xyz".index, flat))))


def _columns_of_level_turn(flat: str, names: Sequence[str], width: int, axes: Sequence[int]) -> str | None:
    """Columns of a level turn if they are clear: the only two, the two named as its axes, or the only possible axes."""
    if width == 2:
        return "1,2"
    if set(flat) <= set(names):
        return ",".join(flat)
    return ",".join(str(place + 1) for place in axes) if len(axes) == 2 else None


def _mark_assumed(columns: Columns) -> Columns:
    """Mark columns as assumed if neither their names nor a unit show that they are a magnetometer's."""
    is_bare = all(name.isdecimal() or meaning(name).is_bare for name in columns.field.names)
    return replace(columns, is_assumed=is_bare and not columns.unit)


def _of_devices(columns: Columns, devices: Sequence[Device]) -> Columns:
    """Columns for each of several devices, whose rows are distinguished by another column."""
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
    """Raise an error for a table without a header in which only two columns can be axes."""
    if len(axes) == 2:
        others = ", ".join(str(place + 1) for place in range(width) if place not in axes)
        left = " and ".join(str(place + 1) for place in axes)
        raise NoMagnetometer(
            f"only columns {left} of {source}{quoted} may be axes; others only rise or never change ({others}): "
            f"need three columns, x, y and z{remark('two columns')}"
        )


def _refuse_unclear(names: Sequence[str], values: Floats, source: str, heading: str, cells: Sequence[str]) -> None:
    """Raise an error if only values show a magnetometer, or if the names show fields but no magnetometer."""
    others = [each for each in vectors(names, list(map(meaning, names)), FIELD) if each.instead]
    if others:
        what = list_names([f"{each.whole} ({each.instead})" for each in others])
        columns = ",".join(names[cell].strip() for cell in others[0].cells)
        raise NoMagnetometer(
            f"the columns of {source} are not readings of a magnetometer, by their names: {what}; name the three "
            "columns with its readings, such as these if their names mislead",
            hint={"columns": columns},
        )
    width = values.shape[1]
    judged = groups(values, [place for place in range(width) if not names or is_inconclusive(names[place])], names)
    if any(group.is_candidate or group.is_known or (names and len(group.names) > 1) for group in judged):
        nameless = f"{source} has {width} columns and {heading}: need three, x y z, or four with the time first"
        what = f"names do not identify the magnetometer among the columns of {source}" if names else nameless
        first = [f"{number}: {cell.strip()}" for number, cell in enumerate(cells, 1)]
        shown = f"; its first line by its columns is {list_columns(first)}" if cells and not names else ""
        told, hint = advice(judged)
        raise NoMagnetometer(f"{what}{shown}; {told}", hint=hint)


def _keep_name(
    columns: Columns, magnetometers: Sequence[Columns], choice: Choice, asked: AnyColumns, source: str
) -> Columns:
    """Columns with the name of the requested magnetometer; the name is removed if the user gives one."""
    if choice.sensor is None:
        return columns
    if not choice.is_name:
        raise UsageError(
            "columns and a sensor number both select the magnetometer: leave one of them out",
            hint={"columns": None, "sensor": None},
        )
    wanted = choice.sensor.strip().casefold()
    for number, other in enumerate(magnetometers, 1):
        if wanted in (str(number), other.name.casefold()):
            if other.name == columns.name:
                return columns
            own = columns.name or "no single magnetometer"
            raise UsageError(
                f"columns {asked!r} of {source} belong to {own}, and the sensor {choice.sensor!r} is {other.name}: "
                "leave one of the two out, or give the columns another name",
                hint={"columns": asked, "sensor": choice.sensor},
            )
    return replace(columns, name="")


def _choose_magnetometer(columns: Columns, choice: Choice, source: str) -> Columns:
    """Columns of the requested magnetometer, or else of the first one with the names of the others."""
    if not columns.magnetometers:
        choice.refuse_alone(source)
        return columns
    names = [each.name for each in columns.magnetometers]
    chosen = columns.magnetometers[choice.index_in(names, source)]
    others = tuple(f"{number} {name}" for number, name in enumerate(names[1:], 2)) if choice.is_open else ()
    return replace(chosen, magnetometers=columns.magnetometers, others=others)
