r"""Transcript of a sensor's lines: text of a recording, readings, and events.

A transcript uses no port, file or clock: bytes are passed in with their time of arrival. The format of all lines is
that of the first ones; it is recognised as in a file, so that everything in a file can be recorded. The time of arrival
is added as the first column if the lines have no time.

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

The readings are equal to those of `flinders.read` from the text.
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
from flinders.core.samples import merge_skipped
from flinders.core.units import unit_label
from flinders.errors import FlindersError, OutputError, count_text, figures
from flinders.links.feeds import FeedEvent
from flinders.readers._cells import COMMENTS, parse_number, quote_cell, split
from flinders.readers._choice import list_names
from flinders.readers._clock import Midnights
from flinders.readers._columns import unit_of
from flinders.readers._grid import rows_of
from flinders.readers._layout import DELIMITER_WORDS, Cells, TextLayout, recognise_table
from flinders.readers._line_shapes import LineShapes
from flinders.readers._names import is_unit
from flinders.readers._recognition import recognise_layout
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples, Skipped
    from flinders.core.units import Unit
    from flinders.links.feeds import Kind
    from flinders.readers._columns import Columns
    from flinders.readers.dialects import Dialect

SETTLE_S: Final = 0.9
"""Longest wait until the format of the first lines is recognised; less than 1 s, the largest loss in a crash."""
RECOGNITION_LINES: Final = 20  # Count of lines by which the format is recognised at once
MAX_LINE_BYTES: Final = 4096  # Longest line
SILENT_S: Final = 3.0  # Time without a reading after which advice is given
MAX_UNLIKE_LINES: Final = 50  # Count of consecutive lines unlike the first ones after which advice is given
MAX_UNANSWERED: Final = 10  # Count of readings without an answer of the sensor after which advice is given
TIME_STEP_S: Final = 1e-4  # Time difference of lines that arrive together, the last digit of a time
LINE_ENDS: Final = re.compile(rb"[\r\n]+")
TIME_NAME: Final = "t_s"
PLAIN_NAMES: Final = ("mag_x", "mag_y", "mag_z")  # Names for three columns without a header
MIN_TABLE_LINES: Final = 3
"""Count of lines with words before numbers in the same positions that form a table; fewer are messages."""


@dataclass(frozen=True, slots=True)
class Form:
    """Format of a source's lines, and of the recorded table."""

    dialect: Dialect
    layout: TextLayout  # layout of the lines, or of the lines that the dialect converts them to
    names: tuple[str, ...]  # names of the columns; empty if the source has a time but no names
    is_timed: bool  # whether the lines have a time

    @property
    def header(self) -> str:
        """The line above the rows; empty without one."""
        return ",".join(map(quote_cell, self.names))

    def is_heading(self, line: str) -> bool:
        """Whether a line repeats the header, or is a row of units below it."""
        cells = split(line.strip(), self.layout.grid.delimiter)
        is_header = line.strip() in (self.layout.header_text.strip(), self.header)
        return is_header or all(is_unit(cell.strip(" []()")) for cell in cells)

    def row(self, line: str, arrived: float) -> str | None:
        """Row from a line that arrived `arrived` seconds after the start; None if it cannot be parsed."""
        cells = self.dialect.row(line)
        if cells and not self.is_timed:
            cells = (f"{arrived:.4f}", *cells)
        return None if cells is None else ",".join(cells)

    def rows(self, lines: Sequence[str]) -> list[str]:
        """Rows from some lines, without a change of the state."""
        trial = replace(self, dialect=deepcopy(self.dialect))  # the dialect stores parts of a reading
        return [row for line in lines if (row := trial.row(line, 0.0))]

    def __str__(self) -> str:
        return self.dialect.words


def recognise_form(lines: list[str], pattern: str | None = None) -> Form | None:
    """Recognise the format of the first lines; None if none of them has three numbers.

    >>> form = recognise_form(["starting up", "X: 21.7 Y: 0.4 Z: -58.6 uT", "X: 21.7 Y: 0.2 Z: -58.7 uT"])
    >>> print(form, "as", form.header)
    labelled lines as t_s,X (uT),Y (uT),Z (uT)
    >>> form.row("X: 21.5 Y: 0.3 Z: -58.5 uT", 0.25), form.row("low battery", 0.26)
    ('0.2500,21.5,0.3,-58.5', None)
    """
    for lay_out in (partial(recognise_table, ""), _layout_without_columns):
        with contextlib.suppress(Exception):  # a recording continues whatever a board prints
            dialect, layout = recognise_layout("", lines, lay_out, pattern)
            words = f"lines of numbers, {DELIMITER_WORDS[layout.grid.delimiter]}-separated"
            return _make_form(
                dialect or Cells.of(layout, words), layout, lines, is_clear=lay_out is not _layout_without_columns
            )
    return None


def _make_form(dialect: Dialect, layout: TextLayout, lines: list[str], *, is_clear: bool) -> Form:
    """Form from a dialect and a layout; columns without names and without a time get names."""
    form = Form(dialect, layout, dialect.names, is_timed=True)
    rows = [split(row, ",") for row in form.rows(lines)]
    width = layout.grid.width or max(map(len, rows), default=0)
    is_told = is_clear and layout.columns.device is not None and not dialect.names
    nameless = PLAIN_NAMES if is_clear and width == len(PLAIN_NAMES) else _default_names(layout, width, is_told=is_told)
    if (time := layout.columns.time) and _is_time([row[time.cells[0]] for row in rows if len(row) > time.cells[0]]):
        return replace(form, names=nameless) if is_told else form
    return replace(form, names=(TIME_NAME, *(dialect.names or nameless)), is_timed=False)


def _default_names(layout: TextLayout, width: int, *, is_told: bool) -> tuple[str, ...]:
    """Names for unnamed columns; those of magnetometer and time if words in each row state them (`is_told`)."""
    columns = layout.columns
    known = dict(zip(columns.field.cells, PLAIN_NAMES, strict=True)) if is_told else {}
    known |= {columns.time.cells[0]: "time"} if is_told and columns.time else {}
    return tuple(known.get(place, f"c{place + 1}") for place in range(width))


def _is_time(column: Sequence[str]) -> bool:
    """Whether a column increases like a time; ``T_C`` may be a temperature."""
    times = [time for cell in column if (time := parse_number(cell, ".")) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])


def _layout_without_columns(lines: list[str], header: Sequence[str] = (), **_: object) -> TextLayout:
    """Layout of a table whose columns of the magnetometer are unknown, of which all columns are recorded."""
    layout = recognise_table("", lines, "1,2,3", header)
    if not layout.header:  # an increasing column may be an axis
        layout = replace(layout, columns=layout.columns.with_only())
    sign, decimal = layout.grid.delimiter, layout.grid.decimal
    rows = [split(line, sign) for line in lines]
    numeric = Counter(
        tuple(place for place, cell in enumerate(row) if cell.strip() and parse_number(cell, decimal) is not None)
        for row in rows
    )
    places, count = numeric.most_common(1)[0]
    if len(places) < len(PLAIN_NAMES) or count < max(MIN_TABLE_LINES, len(rows) / 2):
        return layout
    cells = places[: len(PLAIN_NAMES)]
    return replace(layout, grid=replace(layout.grid, cells=cells, needed=frozenset(cells)))


def is_marked(line: str) -> bool:
    """Whether the words of a line show that its start is complete; ``17,4,-586`` may be a part of ``217,4,-586``."""
    return not all(parse_number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


@dataclass(slots=True)
class RecordingStatistics:
    """Statistics of a recording so far."""

    form: Form | None = None  # format of the lines; None if unknown
    unit: str = ""  # µT or counts; empty if the columns of the magnetometer are unknown
    readings: int = 0  # count of rows
    unknown: int = 0  # count of lines that could not be parsed
    accompanying: int = 0  # count of those lines that a program prints with its readings; known at the end
    lines: int = 0
    received: int = 0  # count of bytes
    seconds: float = 0.0  # time since the start
    strengths: int = 0
    strength_sum: float = 0.0  # sum of the lengths of the field, in `unit`
    weakest: float = math.inf
    strongest: float = 0.0
    disconnections: int = 0  # count of disconnections of the source
    datagrams_lost: int = 0  # count of datagrams that this machine dropped, if it counts them
    first_unknown: str = ""  # the first line that could not be parsed
    first_at: float = 0.0
    last_at: float = 0.0

    def count_row(self, at: float) -> None:
        """Count one row."""
        self.first_at = self.first_at if self.readings else at
        self.readings, self.last_at = self.readings + 1, at

    def measure(self, field: Floats) -> None:
        """Add the field strengths of (N, 3) readings."""
        with np.errstate(over="ignore"):
            strengths = np.linalg.norm(field, axis=1)
        self.strengths += len(field)
        self.strength_sum += float(strengths.sum())
        self.weakest = float(strengths.min(initial=self.weakest))
        self.strongest = float(strengths.max(initial=self.strongest))

    @property
    def rate_hz(self) -> float:
        """Readings per second, gaps included; 0 with fewer than two readings."""
        span = self.last_at - self.first_at
        return (self.readings - 1) / span if self.readings > 1 and span > 0 else 0.0

    def as_dict(self) -> dict[str, object]:
        """JSON-ready."""
        known = self.strengths > 0
        return {
            "format": str(self.form) if self.form else None,  # format of the lines; null if unknown
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
            "not_understood": self.unknown - self.accompanying,  # count of lines that could not be parsed
            "accompanying": self.accompanying,
            "first_not_understood": self.first_unknown or None,  # the first of these lines
            "bytes": self.received,  # count of received bytes
            "disconnections": self.disconnections,
            "datagrams_lost": self.datagrams_lost,
        }

    def __str__(self) -> str:
        parts = [
            f"{count_text(self.readings, 'reading')}{f' ({self.form})' if self.form else ''} in {self.seconds:.1f} s"
        ]
        parts += [f"{figures(self.rate_hz)} Hz"] * (self.rate_hz > 0)
        if self.strengths:
            mean = self.strength_sum / self.strengths
            ends = f"({figures(self.weakest, 3)} to {figures(self.strongest, 3)})"
            parts.append(f"strength {figures(mean, 3)} {self.unit} {ends}")
        parts += [f"lost {self.disconnections} time{'s' * (self.disconnections != 1)}"] * (self.disconnections > 0)
        parts += [f"{count_text(self.datagrams_lost, 'datagram')} lost by this machine"] * (self.datagrams_lost > 0)
        return ", ".join(parts)

    @property
    def brief(self) -> str:
        """Readings, rate, strength and duration on a line that fits any terminal."""
        rate = f"{figures(self.rate_hz, 3)} Hz" if self.rate_hz else "- Hz"
        parts = [count_text(self.readings, "reading"), rate]
        if self.strengths:
            parts.append(f"{figures(self.weakest, 3)} to {figures(self.strongest, 3)} {self.unit}")
        return "  ".join([*parts, f"{self.seconds:.0f} s"])


@dataclass(frozen=True, slots=True)
class Taken:
    """Results from some received bytes."""

    text: str = ""  # complete lines for the recording
    readings: Samples | None = None  # readings of its rows with a finite field
    events: list[FeedEvent] = field(default_factory=list)


class _WaitingLine(NamedTuple):
    """A line that waits to be written."""

    at: float  # time of arrival
    content: bytes
    piece: int = 0  # number of the piece of a line that is too long, from 1


class Transcript:
    """Converter of bytes to lines, and of lines to rows and readings.

    If `is_framed`, bytes that arrive together begin and end with a line; else the first line may be incomplete.
    Columns, unit, scale and pattern are as for `flinders.open_recording`; `most` is the largest count of rows. A
    continued recording has a `header` and first `rows`.
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
        self._rest, self._pieces = b"", 0  # incomplete line
        self._waiting: list[_WaitingLine] = []
        self._shapes = LineShapes()
        self._unknown: list[str] = []  # the first lines that could not be parsed
        self._before: deque[str] = deque(maxlen=RECOGNITION_LINES)  # lines before the format was recognised
        self._last: float | None = None
        self._is_cut = not is_framed
        self._heard_at: float | None = None
        self._advised: set[Kind] = set()
        self._unlike = 0
        self._silent: tuple[Skipped, ...] = ()  # readings at which the sensor did not answer
        self._events: list[FeedEvent] = []

    @property
    def is_full(self) -> bool:
        """Whether it has the requested count of rows."""
        return self._most is not None and self.statistics.readings >= self._most

    @property
    def clock_start(self) -> float | None:
        """Start of the times of readings in seconds from 1970; 0 if they have another start.

        It is None for times of arrival, and before the format is recognised.
        """
        form = self.statistics.form
        if form is None or self._read is None or not form.is_timed:
            return None
        time = self._read[0].columns.time
        return None if time is None else float(time.start * time.factor)

    def take(self, content: bytes, at: float) -> Taken:
        """Process bytes that arrived at a time; call it without bytes too, so that waiting lines are written."""
        self.statistics.seconds = at
        self.statistics.received += len(content)
        if content:
            self._heard_at = at if self._heard_at is None else self._heard_at
            self._split_lines(content, at)
        taken = self._flush() if self._waiting and (self.statistics.form or self._is_enough(at)) else Taken()
        taken.events.extend(self._advice(at))
        return taken

    def _advice(self, at: float) -> list[FeedEvent]:
        """Events with advice, once if no bytes and once if no usable line has arrived."""
        kind: Kind = "silent" if self._heard_at is None else "nothing"
        is_due = at - (self._heard_at or 0.0) >= SILENT_S
        if self.statistics.readings or kind in self._advised or not is_due:
            return []
        self._advised.add(kind)
        return [FeedEvent(kind, at, self.nothing())]

    def record_loss(self, at: float) -> Taken:
        """Record a disconnection of the source, after the waiting lines."""
        ended = self.end(at)
        self.statistics.disconnections += 1
        self._is_cut = not self._is_framed
        return replace(ended, text=f"{ended.text}# lost at {at:.4f} s\n")

    def back(self, at: float) -> Taken:
        """Record that the source is connected again."""
        self.statistics.seconds = at
        return Taken(f"# back at {at:.4f} s\n")

    def end(self, at: float) -> Taken:
        """Write the waiting lines, and the incomplete last line as a comment."""
        self.statistics.seconds = at
        taken = self._flush()
        if self._rest.strip() and not self.is_full:
            taken = replace(taken, text=f"{taken.text}# cut off: {escape_bytes(self._rest)}\n")
            self.statistics.first_unknown = self.statistics.first_unknown or shorten(_text(self._rest))
        self._rest, self._pieces = b"", 0
        self.statistics.accompanying = self._shapes.count_accompanying()
        lost = (text for text in self._unknown if not self._shapes.accompanies(text))
        self.statistics.first_unknown = next(map(shorten, lost), self.statistics.first_unknown)
        return taken

    def nothing(self) -> str:
        """Sentence on why there are no readings, with a remedy."""
        if not self.statistics.received:
            return (
                f"nothing arrives from {self._name}: check that the sensor is on and prints its readings, and "
                "that port, cable and baud rate are right"
            )
        arrived = f"{count_text(self.statistics.received, 'byte')} arrived from {self._name} and no line"
        if not self.statistics.lines and not self._waiting:
            return f"{arrived} end: check --baud, and that the sketch prints each reading on a line (println)"
        example = self.statistics.first_unknown or shorten(_text(self._rest))
        if not example:
            return (
                f"{arrived} except comments, which begin with {' or '.join(COMMENTS)}: if they are readings, state "
                "their format with --pattern"
            )
        return (
            f"{arrived} of three numbers ({example!r}): if that is garbled, check --baud; else check that the sketch "
            "prints x, y and z on a line, or state its format with --pattern"
        )

    def _split_lines(self, content: bytes, at: float) -> None:
        """Split received bytes into lines, and too long lines into pieces, which do not count as lines."""
        *whole, self._rest = LINE_ENDS.split(self._rest + content + b"\n" * self._is_framed)
        for line in whole:
            if self._pieces or len(line) > MAX_LINE_BYTES:
                self._waiting.append(_WaitingLine(at, line, self._pieces + 1))
                self._pieces = 0
            elif line.strip():
                self._waiting.append(_WaitingLine(at, line))
        if len(self._rest) > MAX_LINE_BYTES:
            self._pieces += 1
            self._waiting.append(_WaitingLine(at, self._rest, self._pieces))
            self._rest = b""

    def _is_enough(self, at: float) -> bool:
        """Whether the format can be recognised: from many lines, from old ones, or from all requested ones."""
        is_late = len(self._waiting) >= RECOGNITION_LINES or at - self._waiting[0].at >= SETTLE_S
        if is_late or self._most is None:
            return is_late
        form = recognise_form(self._texts(), self._pattern)
        return form is not None and len(form.rows(self._texts())) >= self._most

    def _texts(self) -> list[str]:
        """Complete lines, without a first line that may be incomplete."""
        texts = [_text(line.content) for line in self._waiting if not line.piece]
        return texts[1:] if self._is_cut and texts and not is_marked(texts[0]) else texts

    def _settle(self) -> None:
        """Recognise the format of the lines, also by an earlier header; OutputError if a continued one differs."""
        form = recognise_form([*self._before, *self._texts()], self._pattern)
        rows = form.rows(self._texts()) if form else []
        if form is None or not rows:
            return
        if self._header not in (None, form.header):
            raise OutputError(
                f"{self._name} sends {form} ({form.header or 'no header'}), the continued recording has "
                f"{self._header or 'no header'}: start another recording"
            )
        self.statistics.form = form
        columns = ""
        with contextlib.suppress(FlindersError):  # for lines that need options
            layout = recognise_table(self._name, [form.header, *self._rows, *rows], self._requested_columns(form))
            self._read = layout, unit_of(layout.columns, self._name, self._unit, self._scale)
            self._midnights = Midnights(layout.columns.clock)
            self.statistics.unit = unit_label(self._read[1].inside)
            columns = f": {layout.columns.describe(self.statistics.unit)}"
        self._tell("settled", f"{form}{columns}")
        if self._read and self._read[0].columns.others:
            self._tell("several", _selected_device_words(self._read[0].columns))

    def _requested_columns(self, form: Form) -> str | None:
        """Requested columns in the recording; numbers are those of printed columns, before the added time."""
        asked = (self._columns or "").split(",")
        places = [] if form.is_timed or not all(one.strip().isdigit() for one in asked) else list(map(int, asked))
        is_there = bool(places) and max(places) < len(form.names)
        return ",".join(form.names[place] for place in places) if is_there else self._columns

    def _flush(self) -> Taken:
        """Convert the waiting lines into text and readings."""
        rows: list[str] = []
        text = ""
        if self._waiting and self.statistics.form is None and not self.is_full:
            self._settle()
        while self._waiting and not self.is_full:
            text += self._line_text(self._waiting.pop(0), rows)
        readings = self._readings(rows)
        events, self._events = self._events, []
        return Taken(text, readings, events)

    def _line_text(self, line: _WaitingLine, rows: list[str]) -> str:
        """Text of one line in the recording."""
        form, text = self.statistics.form, _text(line.content)
        self.statistics.lines += line.piece < 2
        if line.piece:
            self._is_cut = False
            if line.piece == 1:  # counts for all pieces
                self._count_unknown(text)
            return f"# too long: {escape_bytes(line.content)}\n"
        cut, self._is_cut = self._is_cut and not is_marked(text), False
        at = line.at if self._last is None else max(line.at, self._last + TIME_STEP_S)
        row = form.row(text, at) if form and not cut else None
        if form is None or not row:
            if row is None and not cut:
                self._note(text)
            return f"# {'cut off: ' * cut}{escape_bytes(line.content)}\n"
        self._last, self._unlike = at, 0
        self.statistics.count_row(at)
        self._shapes.add(text, is_reading=True)
        rows.append(row)
        if self._header is not None:
            return f"{row}\n"
        self._header = form.header
        return f"{form.header}\n{row}\n" if form.header else f"{row}\n"

    def _note(self, text: str) -> None:
        """Count a line that cannot be parsed, unless it is a comment, header, or line without a reading."""
        form = self.statistics.form
        if form is None:
            self._before.append(text)
        if not (text.lstrip().startswith(COMMENTS) or (form and form.is_heading(text))):
            self._shapes.add(text)
            self._count_unknown(text)

    def _count_unknown(self, text: str) -> None:
        self.statistics.unknown += 1
        self.statistics.first_unknown = self.statistics.first_unknown or shorten(text)
        if len(self._unknown) < RECOGNITION_LINES and not self._shapes.accompanies(text):
            self._unknown.append(text)
        self._unlike += self.statistics.form is not None
        if self._unlike == MAX_UNLIKE_LINES:
            self._tell(
                "garbage",
                f"the last {MAX_UNLIKE_LINES} lines are unlike the first ones ({self.statistics.form}), stored as "
                f"comments: the latest is {shorten(text)!r}; stop, and record again",
            )

    def _count_silent(self, readings: Samples) -> None:
        """Count readings without an answer of the sensor, and report them after some."""
        before = sum(entry.rows for entry in self._silent)
        new = (replace(entry, lines=()) for entry in readings.skipped if entry.is_silent)
        self._silent = merge_skipped(self._silent, tuple(new))
        if before < MAX_UNANSWERED <= sum(entry.rows for entry in self._silent):
            words = "; ".join(map(str, self._silent))
            self._tell("no-answer", f"{words}; such readings are left out: check its supply and its bus")

    def _tell(self, kind: Kind, words: str) -> None:
        self._events.append(FeedEvent(kind, self.statistics.seconds, words))

    def _readings(self, rows: list[str]) -> Samples | None:
        if not rows or self._read is None:
            return None
        layout, unit = self._read
        rows = [row for row in rows if not layout.is_of_other_device(row)]
        values = rows_of(rows, range(len(rows)), layout.grid).with_unwrapped_times(self._midnights, layout.grid).values
        readings = layout.columns.samples(values.T, unit=unit, axes=Axes(), source=self._name)
        self._count_silent(readings)
        self.statistics.measure(readings.field)
        return readings if len(readings) else None


def _selected_device_words(columns: Columns) -> str:
    """Sentence that only lines of one of several devices are shown."""
    others = list_names([other.partition(" ")[2] for other in columns.others])
    return f"lines of several devices arrive: only {columns.name} is shown, {others} not"


def escape_bytes(line: bytes) -> str:
    """Bytes as printable ASCII text, from which ``unicode_escape`` restores them."""
    return line.decode("latin-1").encode("unicode_escape").decode("ascii")


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip("\ufeff\0")
