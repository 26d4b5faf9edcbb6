r"""Lines of a running sensor as rows of a table that `flinders.read` reads.

What the first lines look like decides how all are read; it is the recognition of files, and what a file can hold can be
recorded. Time of arrival is put in front where the lines have no time of their own.

>>> form = settle(["starting up", "Raw:0,0,8192,0,0,16,217,4,-586", "Raw:0,0,8192,0,0,16,217,2,-587"])
>>> print(form)
Raw: lines
>>> form.header
't_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT'
>>> form.row("Raw:0,0,8192,0,0,16,217,4,-586", 0.25)
Row(text='0.2500,0,0,1,0,0,1,21.7,0.4,-58.6', field=(21.7, 0.4, -58.6))
>>> form.row("Cal1:0,0,0,0,0,0,0,0,0,50", 0.26) is None
True
"""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.errors import FlindersError
from flinders.readers import _magcc
from flinders.readers._json import flat
from flinders.readers._names import meaning
from flinders.readers._numbers import SPACES, fits, number, split
from flinders.readers._sniff import COMMENTS, PREFIXES, SPOKEN, sniff
from flinders.readers.text import unit_of
from flinders.units import Unit, label

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.readers._numbers import Grid

TIME: Final = "t_s"
TRIPLES: Final = {
    "Raw": ("accel_{}_g", "gyro_{}_dps", "mag_{}_uT"),
    "Uni": ("accel_{}_mps2", "gyro_{}_radps", "mag_{}_uT"),
}
"""Names of the columns of formats that have none of their own."""
STEPS: Final = (1 / 8192, 1 / 16, 1 / 10)
"""g, °/s and µT in one count of MotionCal's ``Raw:`` lines."""


class Row(NamedTuple):
    """A line as a row of the table, and the field in it."""

    text: str
    field: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """How a source writes its lines.

    Attributes
    ----------
    words : str
        For people.
    header : str
        What stands above the rows; empty where that is nothing.
    take : callable
        Line to row, without the time of arrival; None where it is not understood.
    delimiter, decimal : str
        As in `Grid`.
    cells : tuple of int
        Where the field is in what `take` gives; empty where that is not known.
    scale : float
        From there to `unit`.
    unit : str
        ``µT`` or ``counts``.
    is_timed : bool
        The lines have a time of their own.
    """

    words: str
    header: str
    take: Callable[[str], str | None]
    delimiter: str = ","
    decimal: str = "."
    cells: tuple[int, ...] = ()
    scale: float = 1.0
    unit: str = "counts"
    is_timed: bool = False

    def row(self, line: str, arrived: float) -> Row | None:
        """Make a row of a line that arrived so many seconds after the start; None where it is not understood."""
        text = self.take(line)
        if text is None:
            return None
        cells = split(text, self.delimiter)
        values = [number(cells[cell], self.decimal) for cell in self.cells]
        field = tuple(value * self.scale for value in values if value is not None)
        return Row(text if self.is_timed else f"{self._time(arrived)}{self.delimiter}{text}", field)

    def _time(self, arrived: float) -> str:
        written = f"{arrived:.4f}".replace(".", self.decimal)
        return f'"{written}"' if self.delimiter == self.decimal else written

    def __str__(self) -> str:
        return self.words


def settle(lines: list[str]) -> Form | None:
    """Tell from the first lines how they are written; None where none of them holds three numbers."""
    for prefix, pattern in PREFIXES.items():
        if any(pattern.match(line) for line in lines):
            return _prefixed(prefix)
    if any(_magcc.cells(line) for line in lines):
        return _form("magcc datagrams", _datagram, list(_magcc.NAMES), timed=True)
    records = [line for line in lines if is_record(line)]
    if records:
        return _json(records)
    return _table(lines)


def is_record(line: str) -> bool:
    """Tell whether a line is a JSON object, or a list of numbers."""
    return line.lstrip().startswith(("{", "[")) and _parsed(line) is not None


def is_marked(line: str) -> bool:
    """Tell whether a line shows by its start that nothing of it is missing there; ``17,4,-586`` may have been 217."""
    if is_record(line) or _magcc.DATAGRAM.fullmatch(line) or any(pattern.match(line) for pattern in PREFIXES.values()):
        return True
    return not all(number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


def _names(kind: str) -> list[str]:
    return [name.format(axis) for name in TRIPLES[kind] for axis in "xyz"]


def _form(words: str, take: Callable[[str], str | None], names: list[str], *, timed: bool = False) -> Form:
    """Lay out a format whose columns are known."""
    cells = tuple(place for place, name in enumerate(names) if meaning(name).kind == "field")
    unit = "µT" if any("uT" in name for name in names) else ""
    return Form(words, ",".join(names if timed else [TIME, *names]), take, cells=cells, unit=unit, is_timed=timed)


def _prefixed(prefix: str) -> Form:
    return _form(f"{prefix}: lines", partial(_unprefixed, prefix), _names(prefix))


def _unprefixed(prefix: str, line: str) -> str | None:
    """Take the nine numbers of a ``Raw:`` or ``Uni:`` line; counts become units."""
    if not PREFIXES[prefix].match(line):
        return None
    cells = [cell.strip() for cell in PREFIXES[prefix].sub("", line, count=1).split(",")]
    values = [number(cell, ".") for cell in cells]
    if len(cells) != 9 or None in values:
        return None
    if prefix == "Uni":
        return ",".join(cells)
    return ",".join(f"{value * STEPS[place // 3]:.7g}" for place, value in enumerate(values) if value is not None)


def _datagram(line: str) -> str | None:
    """Take the thirteen numbers of a datagram."""
    cells = _magcc.cells(line)
    return None if cells is None else ",".join(cells)


def _json(records: list[str]) -> Form | None:
    """Lay out JSON lines as a table, with the numbers as they were written."""
    first = _parsed(records[0])
    names = tuple(flat(first)) if isinstance(first, dict) else ()
    take = partial(_from_json, names)
    rows = [row for row in map(take, records) if row is not None]
    return _table(rows, list(names), take, "JSON lines")


def _from_json(names: tuple[str, ...], line: str) -> str | None:
    """Bring one record into the order of the columns."""
    record = _parsed(line)
    if isinstance(record, dict) and names:
        values = flat(record)
        cells = [values.get(name) for name in names]
    elif isinstance(record, list) and not names:
        cells = record
    else:
        return None
    page = io.StringIO()
    csv.writer(page, lineterminator="").writerow(cells)
    return page.getvalue()


def _parsed(line: str) -> dict[str, object] | list[object] | None:
    """Parse a record; numbers stay as they are written."""
    try:
        record = json.loads(line, parse_float=str, parse_int=str)
    except (ValueError, RecursionError):
        return None
    if isinstance(record, list) and not any(isinstance(value, (list, dict)) for value in record):
        return record
    return record if isinstance(record, dict) else None


def _runs(lines: list[str], grid: Grid, cell: int) -> bool:
    """Tell whether a column does what time does; ``T_C`` may be a temperature."""
    rows = [cells for line in lines if len(cells := split(line, grid.delimiter)) > cell]
    times = [time for row in rows if (time := number(row[cell], grid.decimal)) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])


def _table(
    lines: list[str],
    names: list[str] | None = None,
    before: Callable[[str], str | None] | None = None,
    words: str = "",
) -> Form | None:
    """Lay out lines of numbers, as a file with these lines would be."""
    layout, is_clear = None, True
    for columns in (None, "1,2,3"):  # where it is not clear which the magnetometer's are, all are recorded
        try:
            layout = sniff("", lines, columns, names or ())
            break
        except FlindersError:
            is_clear = False
    if layout is None:
        return None
    grid, chosen = layout.grid, layout.columns
    needed = sorted(grid.needed) if is_clear else range(3)

    def take(line: str) -> str | None:
        text = line.strip(" ") if before is None else before(line)
        if text is None or text.startswith(COMMENTS):
            return None
        cells = split(text, grid.delimiter)
        if not (fits(cells, grid.width) if grid.width else len(cells) > max(needed)):
            return None
        return None if any(number(cells[cell], grid.decimal) is None for cell in needed) else text

    sign, is_timed = grid.delimiter, chosen.time is not None and _runs(lines, grid, chosen.time.cells[0])
    title = sign.join(names) if names else layout.header_text.strip().lstrip("#%/ ")
    if not title and not is_timed:
        width = grid.width or len(split(lines[-1], sign))
        plain = ["mag_x", "mag_y", "mag_z"] if width == 3 else [f"c{place + 1}" for place in range(width)]
        title = sign.join(plain)
    unit = unit_of(chosen, "", None, None) if is_clear else Unit.of()
    return Form(
        words or f"lines of numbers, {SPOKEN[sign]}-separated",
        title if is_timed or not title else f"{TIME}{sign}{title}",
        take,
        " " if sign == SPACES else sign,
        grid.decimal,
        chosen.field.cells if is_clear else (),
        unit.scale,
        label(unit.inside),
        is_timed,
    )
