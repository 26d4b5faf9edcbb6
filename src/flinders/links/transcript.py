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

import contextlib
import math
import re
from collections import Counter, deque
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import added
from flinders.core.units import label
from flinders.errors import FlindersError, OutputError, counted, figures
from flinders.links.feeds import FeedEvent
from flinders.readers._cells import COMMENTS, number, quoted, split
from flinders.readers._choice import numbered
from flinders.readers._clock import Midnights
from flinders.readers._columns import unit_of
from flinders.readers._grid import rows_of
from flinders.readers._layout import SPOKEN, Cells, TextLayout, sniff
from flinders.readers._line_shapes import LineShapes
from flinders.readers._names import is_unit
from flinders.readers._recognition import recognise_layout
from flinders.readers._tokenizer import shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples, Skipped
    from flinders.core.units import Unit
    from flinders.links.feeds import Kind
    from flinders.readers._columns import Columns
    from flinders.readers.dialects import Dialect

SETTLE_S: Final = 0.9
"""Seconds that the first lines wait until it is recognised how they are written; less than a second, which a crash may
cost."""
ENOUGH: Final = 20  # Lines that settle it at once
LONGEST: Final = 4096  # Bytes in a line; a longer one is none
SILENT_S: Final = 3.0  # Seconds without a reading after which advice is given
UNLIKE: Final = 50  # Lines in a row that are not like the first ones, after which advice is given
UNANSWERED: Final = 10  # Readings at which the sensor did not answer, after which advice is given
STEP_S: Final = 1e-4  # Lines that arrive together differ by so much, the last digit of a time
ENDS: Final = re.compile(rb"[\r\n]+")
TIME: Final = "t_s"
PLAIN: Final = ("mag_x", "mag_y", "mag_z")  # Names of three columns without a header
SEVERAL: Final = 3
"""Lines with numbers in the same places that are a table where words stand before them; a message comes once."""


@dataclass(frozen=True, slots=True)
class Form:
    """How a source writes its lines, and the table that is made of them."""

    dialect: Dialect
    layout: TextLayout  # of the lines, or of those that the dialect makes of them
    names: tuple[str, ...]  # of the columns; none where the source names nothing and has a time
    is_timed: bool  # the lines have a time of their own

    @property
    def header(self) -> str:
        """The line above the rows; empty where that is none."""
        return ",".join(map(quoted, self.names))

    def is_heading(self, line: str) -> bool:
        """Tell whether a line is the header come again, or a row of units below it."""
        cells = split(line.strip(), self.layout.grid.delimiter)
        is_header = line.strip() in (self.layout.header_text.strip(), self.header)
        return is_header or all(is_unit(cell.strip(" []()")) for cell in cells)

    def row(self, line: str, arrived: float) -> str | None:
        """Make a row of a line that arrived so many seconds after the start; None where it is not understood."""
        cells = self.dialect.row(line)
        if cells and not self.is_timed:
            cells = (f"{arrived:.4f}", *cells)
        return None if cells is None else ",".join(cells)

    def rows(self, lines: Sequence[str]) -> list[str]:
        """Make the rows of some lines, which are not taken yet."""
        trial = replace(self, dialect=deepcopy(self.dialect))  # it remembers parts of a reading
        return [row for line in lines if (row := trial.row(line, 0.0))]

    def __str__(self) -> str:
        return self.dialect.words


def settle(lines: list[str], pattern: str | None = None) -> Form | None:
    """Recognise from the first lines how they are written; None where none of them holds three numbers.

    >>> form = settle(["starting up", "X: 21.7 Y: 0.4 Z: -58.6 uT", "X: 21.7 Y: 0.2 Z: -58.7 uT"])
    >>> print(form, "as", form.header)
    labelled lines as t_s,X (uT),Y (uT),Z (uT)
    >>> form.row("X: 21.5 Y: 0.3 Z: -58.5 uT", 0.25), form.row("low battery", 0.26)
    ('0.2500,21.5,0.3,-58.5', None)
    """
    for lay_out in (partial(sniff, ""), _unclear):
        with contextlib.suppress(Exception):  # whatever a board prints, a recording goes on
            dialect, layout = recognise_layout("", lines, lay_out, pattern)
            words = f"lines of numbers, {SPOKEN[layout.grid.delimiter]}-separated"
            return _form(dialect or Cells.of(layout, words), layout, lines, is_clear=lay_out is not _unclear)
    return None


def _form(dialect: Dialect, layout: TextLayout, lines: list[str], *, is_clear: bool) -> Form:
    """Put together how lines are recorded; columns without names and a time get some."""
    form = Form(dialect, layout, dialect.names, is_timed=True)
    rows = [split(row, ",") for row in form.rows(lines)]
    width = layout.grid.width or max(map(len, rows), default=0)
    is_told = is_clear and layout.columns.device is not None and not dialect.names
    nameless = PLAIN if is_clear and width == len(PLAIN) else _nameless(layout, width, is_told=is_told)
    if (time := layout.columns.time) and _runs([row[time.cells[0]] for row in rows if len(row) > time.cells[0]]):
        return replace(form, names=nameless) if is_told else form
    return replace(form, names=(TIME, *(dialect.names or nameless)), is_timed=False)


def _nameless(layout: TextLayout, width: int, *, is_told: bool) -> tuple[str, ...]:
    """Names for columns that have none; those of the magnetometer and the time where a word in each row `is_told`."""
    columns = layout.columns
    known = dict(zip(columns.field.cells, PLAIN, strict=True)) if is_told else {}
    known |= {columns.time.cells[0]: "time"} if is_told and columns.time else {}
    return tuple(known.get(place, f"c{place + 1}") for place in range(width))


def _runs(column: Sequence[str]) -> bool:
    """Tell whether a column does what time does; ``T_C`` may be a temperature."""
    times = [time for cell in column if (time := number(cell, ".")) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])


def _unclear(lines: list[str], header: Sequence[str] = (), **_: object) -> TextLayout:
    """Lay out a table of which all is recorded, as it is not clear what is the magnetometer: by three numbers."""
    layout = sniff("", lines, "1,2,3", header)
    layout = layout if layout.header else replace(layout, columns=layout.columns.only())  # what rises may be an axis
    sign, decimal = layout.grid.delimiter, layout.grid.decimal
    rows = [split(line, sign) for line in lines]
    numeric = Counter(
        tuple(place for place, cell in enumerate(row) if cell.strip() and number(cell, decimal) is not None)
        for row in rows
    )
    places, count = numeric.most_common(1)[0]
    if len(places) < len(PLAIN) or count < max(SEVERAL, len(rows) / 2):
        return layout
    cells = places[: len(PLAIN)]
    return replace(layout, grid=replace(layout.grid, cells=cells, needed=frozenset(cells)))


def is_marked(line: str) -> bool:
    """Tell whether a line shows by its words that its start is not missing; ``17,4,-586`` may have been 217."""
    return not all(number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


@dataclass(slots=True)
class RecordingStatistics:
    """What has been recorded so far."""

    form: Form | None = None  # how the lines are written; None where that is not known
    unit: str = ""  # µT or counts; nothing where it is not clear which numbers are the magnetometer's
    readings: int = 0  # rows
    unknown: int = 0  # lines that were not understood
    accompanying: int = 0  # of them, those that a program prints with its readings; counted at the end
    lines: int = 0
    received: int = 0  # bytes
    seconds: float = 0.0  # since the start
    strengths: int = 0
    strength_sum: float = 0.0  # of the length of the field, in `unit`
    weakest: float = math.inf
    strongest: float = 0.0
    disconnections: int = 0  # how often the other end went away
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
        with np.errstate(over="ignore"):
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
            "format": str(self.form) if self.form else None,  # how the lines are written; None where that is not known
            "readings": self.readings,
            "seconds": self.seconds,
            "rate_hz": self.rate_hz or None,
            # `mean`, `min` and `max` length of the readings, in `unit`
            "strength": {
                "unit": self.unit or None,
                "mean": self.strength_sum / self.strengths if known else None,
                "min": self.weakest if known else None,
                "max": self.strongest if known else None,
            },
            "not_understood": self.unknown - self.accompanying,  # lines that were not understood
            "accompanying": self.accompanying,
            "first_not_understood": self.first_unknown or None,  # the first of those
            "bytes": self.received,  # received
            "disconnections": self.disconnections,
            "datagrams_lost": self.datagrams_lost,
        }

    def __str__(self) -> str:
        parts = [f"{counted(self.readings, 'reading')}{f' ({self.form})' if self.form else ''} in {self.seconds:.1f} s"]
        parts += [f"{figures(self.rate_hz)} Hz"] * (self.rate_hz > 0)
        if self.strengths:
            mean = self.strength_sum / self.strengths
            ends = f"({figures(self.weakest, 3)} to {figures(self.strongest, 3)})"
            parts.append(f"strength {figures(mean, 3)} {self.unit} {ends}")
        parts += [f"lost {self.disconnections} time{'s' * (self.disconnections != 1)}"] * (self.disconnections > 0)
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
    """A line that waits to be written."""

    at: float  # when it came
    content: bytes
    piece: int = 0  # of one that is too long, counted from 1


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
        self._midnights = Midnights(None)
        self._rest, self._pieces = b"", 0  # of a line whose end has not come
        self._waiting: list[_WaitingLine] = []
        self._shapes = LineShapes()
        self._unknown: list[str] = []  # the first lines that were not understood
        self._before: deque[str] = deque(maxlen=ENOUGH)  # lines before it was recognised how they are written
        self._last: float | None = None
        self._is_cut = not is_framed
        self._heard_at: float | None = None
        self._advised: set[Kind] = set()
        self._unlike = 0
        self._silent: tuple[Skipped, ...] = ()  # readings at which the sensor did not answer
        self._events: list[FeedEvent] = []

    @property
    def is_full(self) -> bool:
        """It has as many rows as were asked for."""
        return self._most is not None and self.statistics.readings >= self._most

    @property
    def clock_start(self) -> float | None:
        """Seconds from 1970 at which the times of readings start to count, 0 where they count from something else.

        None where they are times of arrival, or nothing was recognised yet.
        """
        form = self.statistics.form
        if form is None or self._read is None or not form.is_timed:
            return None
        time = self._read[0].columns.time
        return None if time is None else float(time.start * time.factor)

    def take(self, content: bytes, at: float) -> Taken:
        """Take what came at this second; call it with nothing, too, so that waiting lines are written in time."""
        self.statistics.seconds = at
        self.statistics.received += len(content)
        if content:
            self._heard_at = at if self._heard_at is None else self._heard_at
            self._cut(content, at)
        taken = self._flush() if self._waiting and (self.statistics.form or self._is_enough(at)) else Taken()
        taken.events.extend(self._advice(at))
        return taken

    def _advice(self, at: float) -> list[FeedEvent]:
        """Say once that nothing has come, and once that nothing usable has."""
        kind: Kind = "silent" if self._heard_at is None else "nothing"
        is_due = at - (self._heard_at or 0.0) >= SILENT_S
        if self.statistics.readings or kind in self._advised or not is_due:
            return []
        self._advised.add(kind)
        return [FeedEvent(kind, at, self.nothing())]

    def lost(self, at: float) -> Taken:
        """Note that the other end went away; what came before is let go."""
        ended = self.end(at)
        self.statistics.disconnections += 1
        self._is_cut = not self._is_framed
        return replace(ended, text=f"{ended.text}# lost at {at:.4f} s\n")

    def back(self, at: float) -> Taken:
        """Note that it is there again."""
        self.statistics.seconds = at
        return Taken(f"# back at {at:.4f} s\n")

    def end(self, at: float) -> Taken:
        """Let go of what waits, and of the start of a line that will have no end."""
        self.statistics.seconds = at
        taken = self._flush()
        if self._rest.strip() and not self.is_full:
            taken = replace(taken, text=f"{taken.text}# cut off: {escaped(self._rest)}\n")
            self.statistics.first_unknown = self.statistics.first_unknown or shown(_text(self._rest))
        self._rest, self._pieces = b"", 0
        self.statistics.accompanying = self._shapes.count_accompanying()
        lost = (text for text in self._unknown if not self._shapes.accompanies(text))
        self.statistics.first_unknown = next(map(shown, lost), self.statistics.first_unknown)
        return taken

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
        return (
            f"{arrived} of three numbers ({example!r}): where that is garbled, check --baud; else see that the sketch "
            "prints x, y and z on a line, or say with --pattern how it prints them"
        )

    def _cut(self, content: bytes, at: float) -> None:
        """Cut what came in into lines; one that is too long into pieces, none of which counts as a line."""
        *whole, self._rest = ENDS.split(self._rest + content + b"\n" * self._is_framed)
        for line in whole:
            if self._pieces or len(line) > LONGEST:
                self._waiting.append(_WaitingLine(at, line, self._pieces + 1))
                self._pieces = 0
            elif line.strip():
                self._waiting.append(_WaitingLine(at, line))
        if len(self._rest) > LONGEST:
            self._pieces += 1
            self._waiting.append(_WaitingLine(at, self._rest, self._pieces))
            self._rest = b""

    def _is_enough(self, at: float) -> bool:
        """Tell whether it can be recognised how lines are written: by many, or old ones, or all that are asked for."""
        is_late = len(self._waiting) >= ENOUGH or at - self._waiting[0].at >= SETTLE_S
        if is_late or self._most is None:
            return is_late
        form = settle(self._texts(), self._pattern)
        return form is not None and len(form.rows(self._texts())) >= self._most

    def _texts(self) -> list[str]:
        """What is line, without a first line that may be cut."""
        texts = [_text(line.content) for line in self._waiting if not line.piece]
        return texts[1:] if self._is_cut and texts and not is_marked(texts[0]) else texts

    def _settle(self) -> None:
        """Recognise how the lines are written; a header may have come long before, OutputError where it is another."""
        form = settle([*self._before, *self._texts()], self._pattern)
        rows = form.rows(self._texts()) if form else []
        if form is None or not rows:
            return
        if self._header not in (None, form.header):
            raise OutputError(
                f"{self._name} sends {form} ({form.header or 'no header'}), and the recording that is continued has "
                f"{self._header or 'no header'}: begin another recording"
            )
        self.statistics.form = form
        columns = ""
        with contextlib.suppress(FlindersError):  # of what needs options to be read
            layout = sniff(self._name, [form.header, *self._rows, *rows], self._named(form))
            self._read = layout, unit_of(layout.columns, self._name, self._unit, self._scale)
            self._midnights = Midnights(layout.columns.clock)
            self.statistics.unit = label(self._read[1].inside)
            columns = f": {layout.columns.describe(self.statistics.unit)}"
        self._tell("settled", f"{form}{columns}")
        if self._read and self._read[0].columns.others:
            self._tell("several", _alone(self._read[0].columns))

    def _named(self, form: Form) -> str | None:
        """The columns that were asked for: numbers count what is printed, before which the recording has a time."""
        asked = (self._columns or "").split(",")
        places = [] if form.is_timed or not all(one.strip().isdigit() for one in asked) else list(map(int, asked))
        is_there = bool(places) and max(places) < len(form.names)
        return ",".join(form.names[place] for place in places) if is_there else self._columns

    def _flush(self) -> Taken:
        """Turn the waiting lines into text and readings."""
        rows: list[str] = []
        text = ""
        if self._waiting and self.statistics.form is None and not self.is_full:
            self._settle()
        while self._waiting and not self.is_full:
            text += self._written(self._waiting.pop(0), rows)
        readings = self._readings(rows)
        events, self._events = self._events, []
        return Taken(text, readings, events)

    def _written(self, line: _WaitingLine, rows: list[str]) -> str:
        """One line as it goes into the recording."""
        form, text = self.statistics.form, _text(line.content)
        self.statistics.lines += line.piece < 2
        if line.piece:
            self._is_cut = False
            if line.piece == 1:  # it counts for all
                self._count_unknown(text)
            return f"# too long: {escaped(line.content)}\n"
        cut, self._is_cut = self._is_cut and not is_marked(text), False
        at = line.at if self._last is None else max(line.at, self._last + STEP_S)
        row = form.row(text, at) if form and not cut else None
        if form is None or not row:
            if row is None and not cut:
                self._note(text)
            return f"# {'cut off: ' * cut}{escaped(line.content)}\n"
        self._last, self._unlike = at, 0
        self.statistics.count_row(at)
        self._shapes.add(text, is_reading=True)
        rows.append(row)
        if self._header is not None:
            return f"{row}\n"
        self._header = form.header
        return f"{form.header}\n{row}\n" if form.header else f"{row}\n"

    def _note(self, text: str) -> None:
        """Count what is not understood, but no comment of the sensor's own, header, or line without a reading."""
        form = self.statistics.form
        if form is None:
            self._before.append(text)
        if not (text.lstrip().startswith(COMMENTS) or (form and form.is_heading(text))):
            self._shapes.add(text)
            self._count_unknown(text)

    def _count_unknown(self, text: str) -> None:
        self.statistics.unknown += 1
        self.statistics.first_unknown = self.statistics.first_unknown or shown(text)
        if len(self._unknown) < ENOUGH and not self._shapes.accompanies(text):
            self._unknown.append(text)
        self._unlike += self.statistics.form is not None
        if self._unlike == UNLIKE:
            self._tell(
                "garbage",
                f"the last {UNLIKE} lines are not like the first ones ({self.statistics.form}) and are kept as "
                f"comments: the latest is {shown(text)!r}; stop, and record again",
            )

    def _count_silent(self, readings: Samples) -> None:
        """Count readings at which the sensor did not answer, and say so once there are some."""
        before = sum(entry.rows for entry in self._silent)
        new = (replace(entry, lines=()) for entry in readings.skipped if entry.is_silent)
        self._silent = added(self._silent, tuple(new))
        if before < UNANSWERED <= sum(entry.rows for entry in self._silent):
            words = "; ".join(map(str, self._silent))
            self._tell("no-answer", f"{words}; such readings are left out: check its supply and its bus")

    def _tell(self, kind: Kind, words: str) -> None:
        self._events.append(FeedEvent(kind, self.statistics.seconds, words))

    def _readings(self, rows: list[str]) -> Samples | None:
        if not rows or self._read is None:
            return None
        layout, unit = self._read
        rows = [row for row in rows if not layout.is_of_other_device(row)]
        values = rows_of(rows, range(len(rows)), layout.grid).past(self._midnights, layout.grid).values
        readings = layout.columns.samples(values.T, unit=unit, axes=Axes(), source=self._name)
        self._count_silent(readings)
        self.statistics.measure(readings.field)
        return readings if len(readings) else None


def _alone(columns: Columns) -> str:
    """Say that lines of one of several devices are shown."""
    others = numbered([other.partition(" ")[2] for other in columns.others])
    return f"lines of several devices come, and {columns.name} is shown alone: {others} not"


def escaped(line: bytes) -> str:
    """Write bytes as printable ASCII from which ``unicode_escape`` restores them."""
    return line.decode("latin-1").encode("unicode_escape").decode("ascii")


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip("\ufeff\0")
