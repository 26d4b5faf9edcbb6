r"""What arrives from a sensor as lines, turned into the text of a recording, into readings, and into what to tell.

A transcript knows neither port, file nor clock: bytes go in with the second at which they came. How the first lines are
written decides how all are read; it is recognised as in a file, so that what a file can hold can be recorded. Time of
arrival is put in front where the lines have no time of their own.

>>> transcript = Transcript("the board")
>>> _ = transcript.take(b"booting\r\nRaw:0,0,8192,0,0,0,217,4,-5", at=0.0)
>>> later = transcript.take(b"86\r\n", at=1.0)
>>> print(later.text)
# booting
t_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT
1.0000,0,0,1,0,0,0,21.7,0.4,-58.6
<BLANKLINE>
>>> later.readings.field, [event.kind for event in later.events]
(array([[ 21.7,   0.4, -58.6]]), ['settled'])

The readings are those that `flinders.read` makes of the text.
"""

from __future__ import annotations

import math
import re
from collections import Counter, deque
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.axes import Axes
from flinders.core.units import label
from flinders.errors import FlindersError, OutputError, counted, figures
from flinders.live.feeds import FeedEvent
from flinders.readers._columns import unit_of
from flinders.readers._lines import shown
from flinders.readers._names import is_unit, meaning
from flinders.readers._numbers import SPACES, Grid, number, row_of, rows_of, split
from flinders.readers._sniff import COMMENTS, SPOKEN, TextLayout, sniff
from flinders.readers.dialects import guess, marked, recognise
from flinders.readers.dialects.pattern import Pattern

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.core.units import Unit
    from flinders.live.feeds import Kind
    from flinders.readers._tokenizer import Dialect

SETTLE_S: Final = 0.9
"""Seconds that the first lines wait until their layout is recognised; less than a second, which a crash may
cost."""
ENOUGH: Final = 20  # Lines that settle it at once
LONGEST: Final = 4096  # Bytes in a line; a longer one is none
SILENT_S: Final = 3.0  # Seconds without a reading after which advice is given
UNLIKE: Final = 50  # Lines in a row that are not like the first ones, after which advice is given
STEP_S: Final = 1e-4  # Lines that arrive together differ by so much, the last digit of a time
ENDS: Final = re.compile(rb"[\r\n]+")
TIME: Final = "t_s"
PLAIN: Final = ("mag_x", "mag_y", "mag_z")  # Names of three columns without a header
SEVERAL: Final = 3
"""Lines with numbers in the same places that are a table where words stand before them; a message comes once."""


@dataclass(frozen=True, slots=True)
class Form:
    """How a source writes its lines."""

    words: str  # for people
    header: str  # what stands above the rows; empty where that is nothing
    take: Callable[[str], str | None]  # line to row without a time; nothing for a part of a reading, None where unknown
    delimiter: str
    decimal: str
    is_timed: bool  # the lines have a time of their own
    printed: str  # the header as the source prints it

    def is_heading(self, line: str) -> bool:
        """Tell whether a line is the header come again, or a row of units below it."""
        cells = split(line.strip(), SPACES if self.delimiter.isspace() else self.delimiter)
        return line.strip() in (self.printed, self.header) or all(is_unit(cell.strip(" []()")) for cell in cells)

    def row(self, line: str, arrived: float) -> str | None:
        """Make a row of a line that arrived so many seconds after the start; None where it is not understood."""
        text = self.take(line)
        return f"{self._time(arrived)}{self.delimiter}{text}" if text and not self.is_timed else text

    def _time(self, arrived: float) -> str:
        written = f"{arrived:.4f}".replace(".", self.decimal)
        return f'"{written}"' if self.delimiter == self.decimal else written

    def __str__(self) -> str:
        return self.words


def settle(lines: list[str], pattern: str | None = None) -> Form | None:
    """Recognise from the first lines how they are written; None where none of them holds three numbers.

    >>> form = settle(["starting up", "X: 21.7 Y: 0.4 Z: -58.6 uT", "X: 21.7 Y: 0.2 Z: -58.7 uT"])
    >>> print(form, "as", form.header)
    labelled lines as t_s,X (uT),Y (uT),Z (uT)
    >>> form.row("X: 21.5 Y: 0.3 Z: -58.5 uT", 0.25), form.row("low battery", 0.26)
    ('0.2500,21.5,0.3,-58.5', None)
    """
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines)
    layout = None if dialect else _layout(lines)
    if dialect := dialect or (None if layout else guess(lines)):
        return _transcribed(lines, dialect)
    layout = layout or _unclear(lines)
    return _form(layout, lines, partial(_as_it_is, layout.grid)) if layout else None


def is_marked(line: str) -> bool:
    """Tell whether a line shows by its start that nothing of it is missing there; ``17,4,-586`` may have been 217."""
    if line.lstrip().startswith(("{", "[", "|", "(")) or marked.is_marked(line):
        return True
    return not all(number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


def _transcribed(lines: list[str], dialect: Dialect) -> Form | None:
    """Lay out lines in a dialect as the table that they stand for."""
    first = partial(_joined, deepcopy(dialect))  # a dialect remembers parts of a reading
    rows = [row for row in map(first, lines) if row]
    layout = _layout(rows, names=dialect.names) or _unclear(rows, dialect.names)
    return None if layout is None else _form(layout, rows, partial(_joined, dialect), dialect.words, dialect.names)


def _layout(lines: list[str], columns: str | None = None, names: Sequence[str] = ()) -> TextLayout | None:
    """Recognise lines of numbers as a file with them would be; None where it is not clear what they are."""
    try:
        return sniff("", lines, columns, names)
    except FlindersError:
        return None


def _unclear(lines: list[str], names: Sequence[str] = ()) -> TextLayout | None:
    """Recognise a table of which all is recorded, as it is not clear what is the magnetometer: by three numbers."""
    layout = _layout(lines, "1,2,3", names)
    if layout is None:
        return None
    grid = layout.grid
    rows = [split(line, grid.delimiter) for line in lines]
    numeric = Counter(
        tuple(place for place, cell in enumerate(cells, 1) if cell.strip() and number(cell, grid.decimal) is not None)
        for cells in rows
    )
    places, count = numeric.most_common(1)[0]
    if len(places) >= len(PLAIN) and count >= max(SEVERAL, len(rows) / 2):
        return _layout(lines, ",".join(map(str, places[: len(PLAIN)])), names) or layout
    return layout


def _joined(dialect: Dialect, line: str) -> str | None:
    """Take a line in a dialect as a row."""
    cells = dialect.row(line)
    return None if cells is None else ",".join(cells)


def _as_it_is(grid: Grid, line: str) -> str | None:
    """Take a line of a table as it is, where its numbers are there."""
    text = line.strip(" ")
    return None if text.startswith(COMMENTS) or row_of(split(text, grid.delimiter), grid) is None else text


def _form(
    layout: TextLayout, lines: list[str], take: Callable[[str], str | None], words: str = "", names: Sequence[str] = ()
) -> Form:
    """Put together how lines are recorded; columns without names get some."""
    grid, sign, time = layout.grid, layout.grid.delimiter, layout.columns.time
    is_timed = time is not None and _runs(lines, grid, time.cells[0])
    title = sign.join(names) or _title(layout)
    if not title and not is_timed:
        width = grid.width or len(split(lines[-1], sign))
        title = sign.join(PLAIN if width == len(PLAIN) else [f"c{place + 1}" for place in range(width)])
    header = title if is_timed or not title else f"{TIME}{sign}{title}"
    words = words or f"lines of numbers, {SPOKEN[sign]}-separated"
    return Form(
        words, header, take, " " if sign == SPACES else sign, grid.decimal, is_timed, layout.header_text.strip()
    )


def _title(layout: TextLayout) -> str:
    """Write the header of a table with the units, and the sensors, that stand in lines of their own."""
    title, sign = layout.header_text.strip().lstrip("#%/ "), layout.grid.delimiter
    named = zip_longest(layout.header, layout.units, fillvalue="")
    names = [f"{name}_{unit}" if unit and not meaning(name).unit else name for name, unit in named]
    is_whole = all(name in title for name in names)
    is_cuttable = not any(sign in name for name in names)
    return sign.join(names) if names and not is_whole and is_cuttable else title


def _runs(lines: list[str], grid: Grid, cell: int) -> bool:
    """Tell whether a column does what time does; ``T_C`` may be a temperature."""
    rows = [cells for line in lines if len(cells := split(line, grid.delimiter)) > cell]
    times = [time for row in rows if (time := number(row[cell], grid.decimal)) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])


@dataclass(slots=True)
class RecordingStatistics:
    """What has been recorded so far."""

    form: Form | None = None  # how the lines are written; None where that is not known
    unit: str = ""  # µT or counts; nothing where it is not clear which numbers are the magnetometer's
    readings: int = 0  # rows
    unknown: int = 0  # lines that were not understood
    lines: int = 0
    received: int = 0  # bytes
    seconds: float = 0.0  # since the start
    strengths: int = 0
    strength_sum: float = 0.0  # of the length of the field, in `unit`
    weakest: float = math.inf
    strongest: float = 0.0
    losses: int = 0  # how often the other end went away
    datagrams_lost: int = 0  # what arrived and was thrown away by this machine, as far as it counts that
    first_unknown: str = ""  # the first line that was not understood
    first_at: float = 0.0
    last_at: float = 0.0

    def count_row(self, at: float) -> None:
        """Count one row."""
        self.first_at = self.first_at if self.readings else at
        self.readings, self.last_at = self.readings + 1, at

    def measure(self, field: Floats) -> None:
        """Note how strong the field of (N, 3) readings is."""
        strengths = np.linalg.norm(field, axis=1)
        self.strengths += len(field)
        self.strength_sum += float(strengths.sum())
        self.weakest = float(strengths.min(initial=self.weakest))
        self.strongest = float(strengths.max(initial=self.strongest))

    @property
    def rate_hz(self) -> float:
        """Readings a second, gaps included; 0 before there are two."""
        span = self.last_at - self.first_at
        return (self.readings - 1) / span if self.readings > 1 and span > 0 else 0.0

    def as_dict(self) -> dict[str, object]:
        """JSON-ready."""
        known = self.strengths > 0
        return {
            "format": str(self.form) if self.form else None,
            "readings": self.readings,
            "seconds": self.seconds,
            "rate_hz": self.rate_hz or None,
            "strength": {
                "unit": self.unit or None,
                "mean": self.strength_sum / self.strengths if known else None,
                "min": self.weakest if known else None,
                "max": self.strongest if known else None,
            },
            "not_understood": self.unknown,
            "first_not_understood": self.first_unknown or None,
            "bytes": self.received,
            "losses": self.losses,
            "datagrams_lost": self.datagrams_lost,
        }

    def __str__(self) -> str:
        parts = [f"{counted(self.readings, 'reading')}{f' ({self.form})' if self.form else ''} in {self.seconds:.1f} s"]
        parts += [f"{figures(self.rate_hz)} Hz"] * (self.rate_hz > 0)
        if self.strengths:
            mean = self.strength_sum / self.strengths
            ends = f"({figures(self.weakest, 3)} to {figures(self.strongest, 3)})"
            parts.append(f"strength {figures(mean, 3)} {self.unit} {ends}")
        parts += [f"lost {self.losses} time{'s' * (self.losses != 1)}"] * (self.losses > 0)
        parts += [f"{counted(self.datagrams_lost, 'datagram')} lost by this machine"] * (self.datagrams_lost > 0)
        return ", ".join(parts)

    @property
    def brief(self) -> str:
        """Readings, rate, strength and seconds on a line that fits any terminal."""
        rate = f"{figures(self.rate_hz, 3)} Hz" if self.rate_hz else "- Hz"
        parts = [counted(self.readings, "reading"), rate]
        if self.strengths:
            parts.append(f"{figures(self.weakest, 3)} to {figures(self.strongest, 3)} {self.unit}")
        return "  ".join([*parts, f"{self.seconds:.0f} s"])


@dataclass(frozen=True, slots=True)
class Taken:
    """What was made of some bytes."""

    text: str = ""  # whole lines for the recording
    readings: Samples | None = None  # of its rows whose field is finite
    events: list[FeedEvent] = field(default_factory=list)


class _WaitingLine(NamedTuple):
    """A line that waits to be written: when it came, its bytes, and whether it is a piece of one that is too long."""

    at: float
    content: bytes
    piece: int = 0


class Transcript:
    """Makes lines of bytes, and rows and readings of lines.

    Bytes that come together begin and end with a line if `is_framed`; else the first line may be cut. Columns, unit,
    scale and pattern are as `flinders.open_recording` takes them, and after `most` rows nothing more is taken. A
    recording that is continued has a `header` and first `rows`.
    """

    def __init__(
        self,
        name: str,
        *,
        is_framed: bool = False,
        columns: str | None = None,
        unit: str | None = None,
        scale: float | None = None,
        pattern: str | None = None,
        most: int | None = None,
        header: str | None = None,
        rows: tuple[str, ...] = (),
    ) -> None:
        self.statistics = RecordingStatistics()
        self._name, self._is_framed, self._most = name, is_framed, most
        self._columns, self._unit, self._scale, self._pattern = columns, unit, scale, pattern
        self._header, self._rows = header, rows
        self._read: tuple[TextLayout, Unit] | None = None
        self._rest = b""
        self._waiting: list[_WaitingLine] = []
        self._before: deque[str] = deque(maxlen=ENOUGH)
        self._pieces = 0
        self._last: float | None = None
        self._is_cut = not is_framed
        self._is_advised = False
        self._unlike = 0
        self._events: list[FeedEvent] = []

    @property
    def is_full(self) -> bool:
        """It has as many rows as were asked for."""
        return self._most is not None and self.statistics.readings >= self._most

    def take(self, content: bytes, at: float) -> Taken:
        """Take what came at this second; call it with nothing, too, so that waiting lines are written in time."""
        self.statistics.seconds = at
        self.statistics.received += len(content)
        if content:
            self._cut(content, at)
        is_ready = self._waiting and (self.statistics.form or self._is_enough(at))
        text, rows = self._flush() if is_ready else ("", [])
        if not self._is_advised and not self.statistics.readings and at >= SILENT_S:
            self._is_advised = True
            self._tell("nothing", self.nothing())
        return self._taken(text, rows)

    def lost(self, at: float) -> Taken:
        """Note that the other end went away; what came before is let go."""
        ended = self.end(at)
        self.statistics.losses += 1
        self._is_cut = not self._is_framed
        return Taken(f"{ended.text}# lost at {at:.4f} s\n", ended.readings, ended.events)

    def back(self, at: float) -> Taken:
        """Note that it is there again."""
        self.statistics.seconds = at
        return Taken(f"# back at {at:.4f} s\n")

    def end(self, at: float) -> Taken:
        """Let go of what waits, and of the start of a line that will have no end."""
        self.statistics.seconds = at
        text, rows = self._flush()
        if self._rest.strip() and not self.is_full:
            text += f"# cut off: {escaped(self._rest)}\n"
            self.statistics.first_unknown = self.statistics.first_unknown or shown(_text(self._rest))
        self._rest, self._pieces = b"", 0
        return self._taken(text, rows)

    def nothing(self) -> str:
        """Say why there is no reading, and what to do."""
        if not self.statistics.received:
            return (
                f"nothing arrives from {self._name}: see that the sensor is on and prints its readings, and "
                "that port, cable and baud rate are right"
            )
        arrived = f"{counted(self.statistics.received, 'byte')} arrived from {self._name} and no line"
        if not self.statistics.lines and not self._waiting:
            return f"{arrived} end: check --baud, and that the sketch prints each reading on a line (println)"
        example = self.statistics.first_unknown or shown(_text(self._rest))
        if not example:
            return (
                f"{arrived} but comments, which begin with {' or '.join(COMMENTS)}: where they are readings, say with "
                "--pattern how they are printed"
            )
        return f"{arrived} of three numbers ({example!r}): check --baud, and what the sketch prints"

    def _cut(self, content: bytes, at: float) -> None:
        """Cut what came in into lines; one that is too long into pieces, none of which counts as a line."""
        *whole, self._rest = ENDS.split(self._rest + content + b"\n" * self._is_framed)
        for line in whole:
            if self._pieces or len(line) > LONGEST:
                self._pieces += 1
                self._waiting.append(_WaitingLine(at, line, self._pieces))
                self._pieces = 0
            elif line.strip():
                self._waiting.append(_WaitingLine(at, line))
        if len(self._rest) > LONGEST:
            self._pieces += 1
            self._waiting.append(_WaitingLine(at, self._rest, self._pieces))
            self._rest = b""

    def _is_enough(self, at: float) -> bool:
        """Tell whether the layout can be recognised: many lines, or old ones, or all rows that are asked for."""
        is_late = len(self._waiting) >= ENOUGH or at - self._waiting[0].at >= SETTLE_S
        if is_late or self._most is None:
            return is_late
        texts = self._texts()
        form = settle(texts, self._pattern)
        return form is not None and len(_rows(form, texts)) >= self._most

    def _texts(self) -> list[str]:
        """What is line, without a first line that may be cut."""
        texts = [_text(line.content) for line in self._waiting if not line.piece]
        return texts[1:] if self._is_cut and texts and not is_marked(texts[0]) else texts

    def _settle(self) -> None:
        """Recognise how the lines are written; a header may have come long before, OutputError where it is another."""
        texts = self._texts()
        form = settle([*self._before, *texts], self._pattern)
        rows = _rows(deepcopy(form), texts) if form else []
        if form is None or not rows:
            return
        if self._header not in (None, form.header):
            raise OutputError(
                f"{self._name} sends {form} ({form.header or 'no header'}), and the recording that is continued has "
                f"{self._header or 'no header'}: begin another recording"
            )
        self.statistics.form = form
        self._read = self._recognised([form.header, *self._rows, *rows])
        self.statistics.unit = label(self._read[1].inside) if self._read else ""
        columns = f": {self._read[0].columns.describe(self.statistics.unit)}" if self._read else ""
        self._tell("settled", f"{form}{columns}")

    def _recognised(self, lines: list[str]) -> tuple[TextLayout, Unit] | None:
        """How `flinders.read` will read the text; None where it needs options."""
        try:
            layout = sniff(self._name, lines, self._named())
            return layout, unit_of(layout.columns, self._name, self._unit, self._scale)
        except FlindersError:
            return None

    def _named(self) -> str | None:
        """The columns that were asked for: numbers count what is printed, before which the recording has a time."""
        form, columns = self.statistics.form, (self._columns or "").split(",")
        if form is None or form.is_timed or not all(one.strip().isdigit() for one in columns):
            return self._columns
        names = form.header.split(form.delimiter)
        return ",".join(names[int(one)] for one in columns) if max(map(int, columns)) < len(names) else self._columns

    def _flush(self) -> tuple[str, list[str]]:
        """Turn the waiting lines into text and its rows."""
        rows: list[str] = []
        text = ""
        if self._waiting and self.statistics.form is None and not self.is_full:
            self._settle()
        while self._waiting and not self.is_full:
            text += self._written(self._waiting.pop(0), rows)
        return text, rows

    def _written(self, line: _WaitingLine, rows: list[str]) -> str:
        """One line as it goes into the recording."""
        if line.piece:
            return self._too_long(line)
        form, text = self.statistics.form, _text(line.content)
        self.statistics.lines += 1
        cut, self._is_cut = self._is_cut and not is_marked(text), False
        at = line.at if self._last is None else max(line.at, self._last + STEP_S)
        row = None if cut or form is None else form.row(text, at)
        if form is None or not row:
            if row is None:
                self._note(text, form, cut=cut)
            return f"# {'cut off: ' * cut}{escaped(line.content)}\n"
        self._last, self._unlike = at, 0
        self.statistics.count_row(at)
        rows.append(row)
        header = f"{form.header}\n" if form.header and self._header is None else ""
        self._header = form.header
        return f"{header}{row}\n"

    def _too_long(self, line: _WaitingLine) -> str:
        """A piece of a line that is too long; the first counts for all."""
        self._is_cut = False
        if line.piece == 1:
            self.statistics.lines += 1
            self._count_unknown(_text(line.content), self.statistics.form)
        return f"# too long: {escaped(line.content)}\n"

    def _note(self, text: str, form: Form | None, *, cut: bool) -> None:
        """Count what is not understood, but no comment of the sensor's own, header, or line without a reading."""
        if form is None and not cut:
            self._before.append(text)
        if cut or text.lstrip().startswith(COMMENTS) or (form and form.is_heading(text)):
            return
        self._count_unknown(text, form)

    def _count_unknown(self, text: str, form: Form | None) -> None:
        self.statistics.unknown += 1
        self.statistics.first_unknown = self.statistics.first_unknown or shown(text)
        self._unlike += form is not None
        if self._unlike == UNLIKE:
            self._tell(
                "garbage",
                f"the last {UNLIKE} lines are not like the first ones ({form}) and are kept as comments: the "
                f"latest is {shown(text)!r}; stop, and record again",
            )

    def _tell(self, kind: Kind, words: str) -> None:
        self._events.append(FeedEvent(kind, self.statistics.seconds, words))

    def _taken(self, text: str, rows: list[str]) -> Taken:
        events, self._events = self._events, []
        return Taken(text, self._readings(rows), events)

    def _readings(self, rows: list[str]) -> Samples | None:
        if not rows or self._read is None:
            return None
        layout, unit = self._read
        values = rows_of(rows, range(len(rows)), layout.grid).values
        readings = layout.columns.samples(values, unit=unit, axes=Axes(), source=self._name)
        self.statistics.measure(readings.field)
        return readings if len(readings) else None


def _rows(form: Form, texts: list[str]) -> list[str]:
    """The rows that these lines make."""
    return [row for text in texts if (row := form.row(text, 0.0))]


def escaped(line: bytes) -> str:
    """Write bytes as printable ASCII from which ``unicode_escape`` restores them."""
    return line.decode("latin-1").encode("unicode_escape").decode("ascii")


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip("\ufeff\0")
