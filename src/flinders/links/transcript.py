r"""Transcript of a sensor's lines: the text of a recording, its readings, and events.

A transcript uses no port, file or clock: it gets bytes with their time of arrival. The first lines determine the format
of all lines. It is recognised as in a file, so that every format of files can be recorded. If the lines contain no
time, the time of arrival is added as the first column.

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

The readings are equal to those that `flinders.read` makes of the text.
"""

from __future__ import annotations

import contextlib
import re
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.axes import Axes
from flinders.core.samples import merge_skipped
from flinders.core.units import unit_label
from flinders.errors import FlindersError, OutputError, count_text
from flinders.links.feeds import FeedEvent
from flinders.links.line_form import recognise_form
from flinders.links.recording_statistics import RecordingStatistics
from flinders.links.recording_text import escape_bytes
from flinders.readers._cells import COMMENTS, parse_number
from flinders.readers._choice import list_names
from flinders.readers._clock import Midnights
from flinders.readers._columns import unit_of
from flinders.readers._grid import rows_of
from flinders.readers._layout import recognise_table
from flinders.readers._line_shapes import LineShapes
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    from flinders.core.samples import Samples, Skipped
    from flinders.core.units import Unit
    from flinders.links.feeds import Kind
    from flinders.links.line_form import Form
    from flinders.readers._columns import Columns
    from flinders.readers._layout import TextLayout

SETTLE_S: Final = 0.9
"""Longest time in s until the format of the first lines is recognised; a crash may lose 1 s, which is longer."""
RECOGNITION_LINES: Final = 20  # Number of lines by which the format is recognised at once
MAX_LINE_BYTES: Final = 4096  # Longest line that is not cut into pieces
SILENT_S: Final = 3.0  # Time without a reading after which advice is given
MAX_UNLIKE_LINES: Final = 50  # Number of consecutive lines unlike the first ones after which advice is given
MAX_UNANSWERED: Final = 10  # Number of readings without an answer of the sensor after which advice is given
TIME_STEP_S: Final = 1e-4  # Time between lines that arrive together: the last digit of a recorded time
LINE_ENDS: Final = re.compile(rb"[\r\n]+")


def is_marked(line: str) -> bool:
    """Whether the words in a line show that its start is complete. ``17,4,-586`` may be the end of ``217,4,-586``."""
    return not all(parse_number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


@dataclass(frozen=True, slots=True)
class Taken:
    """Result of some received bytes."""

    text: str = ""  # complete lines for the recording
    readings: Samples | None = None  # readings of the rows in `text` whose field is finite; None without any
    events: list[FeedEvent] = field(default_factory=list)


class _WaitingLine(NamedTuple):
    """A line that waits to be written."""

    at: float  # time of arrival
    content: bytes
    piece: int = 0  # for a line that is too long: number of this piece, from 1


class Transcript:
    """Conversion of bytes to lines, and of lines to rows of a recording and to readings.

    With `is_framed`, bytes that arrive together begin and end with a line; otherwise the first line may be incomplete.
    Columns, unit, scale and pattern are those of `flinders.open_recording`; `most` is the largest number of rows.
    `header` and `rows` are the header and the first rows of a recording to continue.
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
        """Whether it has the requested number of rows."""
        return self._most is not None and self.statistics.readings >= self._most

    @property
    def clock_start(self) -> float | None:
        """Time in s from 1970 at which the times of readings start; 0 if they do not count from 1970.

        None for times of arrival, and until the format is recognised.
        """
        form = self.statistics.form
        if form is None or self._read is None or not form.is_timed:
            return None
        time = self._read[0].columns.time
        return None if time is None else float(time.start * time.factor)

    def take(self, content: bytes, at: float) -> Taken:
        """Process bytes that arrived at `at` s. Call it without bytes too, so that lines that wait are written."""
        self.statistics.seconds = at
        self.statistics.received += len(content)
        if content:
            self._heard_at = at if self._heard_at is None else self._heard_at
            self._split_lines(content, at)
        taken = self._flush() if self._waiting and (self.statistics.form or self._is_enough(at)) else Taken()
        taken.events.extend(self._advice(at))
        return taken

    def _advice(self, at: float) -> list[FeedEvent]:
        """Events with advice: one if no bytes have arrived, one if no usable line has arrived."""
        kind: Kind = "silent" if self._heard_at is None else "nothing"
        is_due = at - (self._heard_at or 0.0) >= SILENT_S
        if self.statistics.readings or kind in self._advised or not is_due:
            return []
        self._advised.add(kind)
        return [FeedEvent(kind, at, self.nothing())]

    def record_loss(self, at: float) -> Taken:
        """Record that the source was disconnected, after the lines that wait."""
        ended = self.end(at)
        self.statistics.disconnections += 1
        self._is_cut = not self._is_framed
        return replace(ended, text=f"{ended.text}# lost at {at:.4f} s\n")

    def back(self, at: float) -> Taken:
        """Record that the source is connected again."""
        self.statistics.seconds = at
        return Taken(f"# back at {at:.4f} s\n")

    def end(self, at: float) -> Taken:
        """Write the lines that wait, and an incomplete last line as a comment."""
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
        """Sentence that says why there are no readings, with a remedy."""
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
        """Split received bytes into lines. Lines that are too long become pieces, which do not count as lines."""
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
        """Whether the format can be recognised: by many lines, by old lines, or because all requested rows are here."""
        is_late = len(self._waiting) >= RECOGNITION_LINES or at - self._waiting[0].at >= SETTLE_S
        if is_late or self._most is None:
            return is_late
        form = recognise_form(self._texts(), self._pattern)
        return form is not None and len(form.rows(self._texts())) >= self._most

    def _texts(self) -> list[str]:
        """Complete lines; a first line that may be incomplete is left out."""
        texts = [_text(line.content) for line in self._waiting if not line.piece]
        return texts[1:] if self._is_cut and texts and not is_marked(texts[0]) else texts

    def _settle(self) -> None:
        """Recognise the format of the lines; `OutputError` if a recording to continue has another format."""
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
        """Requested columns by their names in the recording; numbers count printed columns, without an added time."""
        asked = (self._columns or "").split(",")
        places = [] if form.is_timed or not all(one.strip().isdigit() for one in asked) else list(map(int, asked))
        is_there = bool(places) and max(places) < len(form.names)
        return ",".join(form.names[place] for place in places) if is_there else self._columns

    def _flush(self) -> Taken:
        """Convert the lines that wait to text and readings."""
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
        """Text of one line in the recording: a row or a comment."""
        form, text = self.statistics.form, _text(line.content)
        self.statistics.lines += line.piece < 2
        if line.piece:
            self._is_cut = False
            if line.piece == 1:  # counted once for all its pieces
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
        """Count a line that cannot be parsed; comments, headers and lines without a reading do not count."""
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
        """Count readings at which the sensor did not answer, and report them after some."""
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
    """Sentence that of several devices only the lines of one are shown."""
    others = list_names([other.partition(" ")[2] for other in columns.others])
    return f"lines of several devices arrive: only {columns.name} is shown, {others} not"


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip("\ufeff\0")
