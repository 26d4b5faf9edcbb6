"""Which of several magnetometers is meant: by number, by name, or the one that a calibration was made from.

>>> Choice.of(2).among(["mag_left", "mag_right"], "two.csv"), Choice.of("mag_left").among(["mag_left"], "one.csv")
(1, 0)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MOST_NAMED: Final = 8  # magnetometers that a line names; an array may have dozens


class Form(NamedTuple):
    """Columns that were asked for of a table, and what tells a table of the same form."""

    field: tuple[str, ...]  # names, or numbers from 1
    width: int  # columns of a line
    names: tuple[str, ...]  # its header; none where it has none
    increasing: tuple[int, ...] = ()  # without a header, numbers of its columns that are clocks and counters

    @classmethod
    def of(cls, field: Sequence[str], names: Sequence[str], width: int, increasing: Iterable[int]) -> Self:
        """That of a table; `increasing` are places of columns that only rise."""
        own = tuple(name.strip() for name in names)
        return cls(tuple(field), width, own, () if own else tuple(place + 1 for place in increasing))


@dataclass(frozen=True, slots=True)
class Choice:
    """Which of several magnetometers is meant: the one that was asked for, else the one a calibration was made from.

    >>> Choice("2").among(["mag_left", "mag_right"], "two.csv"), Choice(preferred="mag_right").among(["mag"], "one.csv")
    (1, 0)
    >>> Choice(preferred="mag_bow").among(["mag_left", "mag_right"], "two.csv")
    Traceback (most recent call last):
    flinders.errors.UsageError: two.csv has no magnetometer mag_bow, which the calibration is for: there are 1
        (mag_left), 2 (mag_right); say which one it is for (sensor=)
    """

    sensor: str | None = None  # asked for, by its number from 1 or its name
    preferred: str | None = None  # the name of the one that a calibration was made from
    is_name: bool = False  # `sensor` may be given to the only magnetometer of a table, which does not know its name
    forms: tuple[Form, ...] = ()  # of the tables that a calibration was made from

    @classmethod
    def of(cls, sensor: str | int | None) -> Self:
        """Take what the user gave: a name, or a number from 1 as digits or as an integer.

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
        """Nobody says which: the first is taken, and the others are named."""
        return self.sensor is None and self.preferred is None

    def remembered(self, names: Sequence[str], width: int, increasing: Iterable[int]) -> str | None:
        """The columns that were asked for of a table of the same form; None for another, and where a sensor is asked.

        >>> choice = Choice(forms=(Form(("2", "3", "4"), 7, (), (1,)),))
        >>> choice.remembered([], 7, [0]), choice.remembered([], 7, []), choice.remembered([], 6, [0])
        ('2,3,4', None, None)
        """
        own = Form.of((), names, width, increasing) if self.forms else None
        same = (form for form in self.forms if form._replace(field=()) == own and self.sensor is None)
        return next((",".join(form.field) for form in same if len(form.field) == len("xyz")), None)

    def among(self, names: Sequence[str], source: str) -> int:
        """Look up its place among these names, from 0; UsageError for one that there is not, with those there are."""
        wanted = self.preferred if self.sensor is None else self.sensor
        if wanted is None or (self.sensor is None and len(names) == 1):
            return 0
        for place, name in enumerate(names):
            numbers = () if self.sensor is None else (str(place + 1),)
            if wanted.strip().casefold() in (*numbers, name.casefold(), name.casefold().removeprefix("/")):
                return place
        verb = "are" if len(names) > 1 else "is"
        there = numbered([f"{number} ({name})" for number, name in enumerate(names, 1)])
        what = f"{source} has no magnetometer {wanted.strip() or repr(wanted)}"
        if self.sensor is None:
            raise UsageError(
                f"{what}, which the calibration is for: there {verb} {there}; say which one it is for",
                hint={"sensor": None},
            )
        raise UsageError(f"{what}: there {verb} {there or 'none'}")

    def refuse_alone(self, source: str) -> None:
        """Refuse to choose from a table of one magnetometer."""
        if self.sensor is not None and not self.is_name:
            raise UsageError(
                f"{source} has one magnetometer: leave its number out; it is chosen by columns",
                hint={"sensor": None, "columns": None},
            )


FIRST: Final = Choice()  # Nobody says which


def numbered(words: Sequence[str]) -> str:
    """Put numbers and names of magnetometers into a sentence, as many as fit.

    >>> numbered(["2 MAG2", "3 MAG3"])
    '2 MAG2, 3 MAG3'
    """
    more = f" and {len(words) - MOST_NAMED} more" if len(words) > MOST_NAMED else ""
    return ", ".join(words[:MOST_NAMED]) + more
