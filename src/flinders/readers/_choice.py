"""Selection of one of several magnetometers: by number, by name, or as in an earlier calibration.

>>> Choice.of(2).index_in(["mag_left", "mag_right"], "two.csv"), Choice.of("mag_left").index_in(["mag_left"], "one.csv")
(1, 0)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MAX_NAMES: Final = 8  # magnetometers that a line names; an array may have dozens


class Form(NamedTuple):
    """Columns that a user requested in a table, with features by which a table of the same form is recognised."""

    field: tuple[str, ...]  # names, or numbers from 1
    width: int  # columns in a line
    names: tuple[str, ...]  # names in its header; none without a header
    # without a header: numbers of the columns that only rise, such as clocks and counters
    increasing: tuple[int, ...] = ()

    @classmethod
    def of(cls, field: Sequence[str], names: Sequence[str], width: int, increasing: Iterable[int]) -> Self:
        """The form of a table; `increasing` are the places of columns that only rise."""
        own = tuple(name.strip() for name in names)
        return cls(tuple(field), width, own, () if own else tuple(place + 1 for place in increasing))


@dataclass(frozen=True, slots=True)
class Choice:
    """Selection of one of several magnetometers: the requested one, else the one of an earlier calibration.

    >>> second, preferred = Choice("2"), Choice(preferred="mag_right")
    >>> second.index_in(["mag_left", "mag_right"], "two.csv"), preferred.index_in(["mag"], "one.csv")
    (1, 0)
    >>> Choice(preferred="mag_bow").index_in(["mag_left", "mag_right"], "two.csv")
    Traceback (most recent call last):
    flinders.errors.UsageError: two.csv has no magnetometer mag_bow, for which the calibration was made:
        there are 1 (mag_left), 2 (mag_right); choose one (sensor=)
    """

    sensor: str | None = None  # requested number from 1, or name
    preferred: str | None = None  # name of the magnetometer that a calibration was made from
    is_name: bool = False  # whether `sensor` may also be a name that the user gives to the only magnetometer of a table
    forms: tuple[Form, ...] = ()  # forms of the tables that a calibration was made from

    @classmethod
    def of(cls, sensor: str | int | None) -> Self:
        """Selection of the sensor that the user typed: a name, or a number from 1.

        >>> Choice.of(2) == Choice("2")
        True
        """
        if isinstance(sensor, (int, np.integer)) and not isinstance(sensor, bool):
            return cls(str(sensor))
        if sensor is None or isinstance(sensor, str):
            return cls(sensor)
        raise UsageError(f"sensor is {sensor!r}, which names no magnetometer: give its number from 1, or its name")

    @property
    def is_open(self) -> bool:
        """Whether no magnetometer was requested. The first is then used, and the others are listed."""
        return self.sensor is None and self.preferred is None

    def remembered_columns(self, names: Sequence[str], width: int, increasing: Iterable[int]) -> str | None:
        """Columns that were requested in an earlier table of the same form; None if a sensor is requested now.

        >>> choice = Choice(forms=(Form(("2", "3", "4"), 7, (), (1,)),))
        >>> [choice.remembered_columns([], width, sensors) for width, sensors in ((7, [0]), (7, []), (6, [0]))]
        ['2,3,4', None, None]
        """
        own = Form.of((), names, width, increasing) if self.forms else None
        same = (form for form in self.forms if form._replace(field=()) == own and self.sensor is None)
        return next((",".join(form.field) for form in same if len(form.field) == len("xyz")), None)

    def index_in(self, names: Sequence[str], source: str) -> int:
        """Index of the selected magnetometer in `names`; raises `UsageError` with these names if it is missing."""
        wanted = self.preferred if self.sensor is None else self.sensor
        if wanted is None or (self.sensor is None and len(names) == 1):
            return 0
        for place, name in enumerate(names):
            numbers = () if self.sensor is None else (str(place + 1),)
            if wanted.strip().casefold() in (*numbers, name.casefold(), name.casefold().removeprefix("/")):
                return place
        verb = "are" if len(names) > 1 else "is"
        there = list_names([f"{number} ({name})" for number, name in enumerate(names, 1)])
        what = f"{source} has no magnetometer {wanted.strip() or repr(wanted)}"
        if self.sensor is None:
            raise UsageError(
                f"{what}, for which the calibration was made: there {verb} {there}; choose one",
                hint={"sensor": None},
            )
        raise UsageError(f"{what}: there {verb} {there or 'none'}")

    def refuse_alone(self, source: str) -> None:
        """Raise an error if a sensor is requested from a table of one magnetometer."""
        if self.sensor is not None and not self.is_name:
            raise UsageError(
                f"{source} has one magnetometer: leave the sensor out, or choose it by its columns",
                hint={"sensor": None, "columns": None},
            )


FIRST_SENSOR: Final = Choice()  # No selection: the first magnetometer


def list_names(words: Sequence[str]) -> str:
    """List numbers and names of magnetometers in a sentence, at most `MAX_NAMES` of them.

    >>> list_names(["2 MAG2", "3 MAG3"])
    '2 MAG2, 3 MAG3'
    """
    more = f" and {len(words) - MAX_NAMES} more" if len(words) > MAX_NAMES else ""
    return ", ".join(words[:MAX_NAMES]) + more
