r"""Recordings as text: tables with any delimiter, decimal sign and header, JSON, and printed lines of boards.

>>> import tempfile
>>> from pathlib import Path
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> _ = file.write_text("t_s,mag_x,mag_y,mag_z\n0.0,217,4,-586\n0.1,217,2,-587\n")
>>> from flinders.readers._source import find
>>> recording = open_text(find(file), unit="mG")
>>> print(recording)
tumble.csv: columns mag_x, mag_y, mag_z in mG, time in t_s; comma-separated
>>> [len(block) for block in recording.blocks()], recording.skipped
([2], ())
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import BLOCK_ROWS, Skipped, merge_skipped
from flinders.core.silence import find_silent
from flinders.core.time_span import TimeSpan
from flinders.core.units import COUNTS, Unit
from flinders.errors import UnreadableInput
from flinders.readers._asked_columns import with_acceleration, with_strength
from flinders.readers._auxiliary import places_in
from flinders.readers._cells import COMMENTS, parse_number, split
from flinders.readers._choice import FIRST_SENSOR, Choice
from flinders.readers._clock import Midnights
from flinders.readers._columns import ColumnsRecording, unit_of
from flinders.readers._foreign_files import foreign_kind, refuse_foreign
from flinders.readers._grid import BLOCKS_AT_ONCE, MIN_BYTES_FOR_ARROW, NumberRows, parser_of, rows_of
from flinders.readers._layout import TextLayout, recognise_table
from flinders.readers._line_shapes import LineShapes
from flinders.readers._lines import GZIP_CUT_MARK, Lines, encoding_of
from flinders.readers._names import AUXILIARY, CURRENT, CURRENTS, TEMPERATURE, THROTTLE, THROTTLES, TIME
from flinders.readers._reader import Reader
from flinders.readers._recognition import recognise_layout, split_records
from flinders.readers._rewrite import Rewriter
from flinders.readers._source import File, Progress, derive_source, raise_own_errors
from flinders.readers._tally import OTHER, Tally, account_for_lines, account_for_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._columns import Columns
    from flinders.readers._grid import Grid, Parse
    from flinders.readers._source import Source
    from flinders.readers.dialects import Dialect

_CALIBRATION: Final = re.compile(
    r'^\W*(mag_?(?:calibration|zero|gain)(?:_[xyz]|\[[012]\])?)"?\s*[,;:=\t]\s*"?'
    r'([-+\d]+(?:[,;\s]+[-+\d]+)*)"?\s*$',
    re.IGNORECASE,
)
"""Header of a Betaflight or INAV log with a calibration, whose formula is `compassUpdate` of `sensors/compass.c`."""
_NO_GAIN: Final = 1024  # neutral ``maggain`` of INAV


@dataclass(slots=True, eq=False)
class TextRecording(ColumnsRecording):
    """Text recording. It yields its readings in bounded memory: a file any number of times, a stream once."""

    file: Source  # source of its lines
    layout: TextLayout  # delimiter, decimal sign, header, columns
    unit: Unit  # of the magnetometer's columns
    axes: Axes = field(default_factory=Axes)  # mapping of the recorded axes
    frame: str = "sensor"  # recorded axes: ``sensor`` or ``vehicle``
    progress: Progress | None = None
    span: TimeSpan = field(default_factory=TimeSpan)  # the part of the recording that is read
    transcription: Transcription | None = None  # for a recording in a dialect: the conversion to the table in `file`
    original: Source | None = None  # the file as recorded, if `file` is a converted table
    source: str = field(init=False)
    is_unit_given: bool = field(default=False, init=False)  # whether the user gave the unit
    # lines that were skipped in the last pass, or in the present one so far
    skipped: tuple[Skipped, ...] = field(default=(), init=False)
    # lines of a short recording, which were read when it was opened
    held: _Held | None = field(default=None, init=False)
    words: tuple[tuple[str, int], ...] = ()  # requested columns of words: name and place of each

    def __post_init__(self) -> None:
        """Set the source to the name of the file."""
        self.source = self.file.name

    @property
    def columns(self) -> Columns:
        """The columns that are read."""
        return self.layout.columns

    def with_columns(self, columns: Columns, unit: str | None, scale: float | None) -> TextRecording:
        """The recording of these columns, in the unit that their names state or the user gives."""
        own = unit_of(columns, self.source, unit, scale)
        grid = replace(self.layout.grid, cells=columns.cells, needed=columns.needed_cells, clock=columns.clock)
        layout = replace(self.layout, columns=columns.with_given_unit(unit, scale).with_strength_in(own), grid=grid)
        frame = "vehicle" if layout.is_blackbox else self.frame
        return replace(self, layout=layout, unit=own, frame=frame)

    def blocks(self) -> Iterator[Samples]:
        """Yield the readings from the first on, about 8192 at a time.

        Raises `UnreadableInput` if the file cannot be read to its end. At its end it is also raised if more than half
        of the expected readings are unreadable, or if no reading is usable.
        """
        for _, samples in self.numbered_blocks():
            yield samples

    @raise_own_errors
    def numbered_blocks(self) -> Iterator[tuple[Floats, Samples]]:
        """Yield the blocks of `blocks`, each with the (N,) line numbers of its readings."""
        pending: tuple[Skipped, ...] = ()
        clock = self.span.clock(self.source)
        for block in self._read_once(self.layout.columns):
            pending = merge_skipped(pending, block.left_out)
            for lines, samples in self._samples(block):
                within = clock.is_within(samples)
                if within.any():
                    yield lines[within], replace(clock.select(samples, within), skipped=pending)
                    pending = ()
        clock.refuse_empty()

    def hold(self) -> None:
        """Read a short recording into memory for later passes; raises the errors of `blocks`."""
        self.held = _Held(self.columns, list(self._read(self.layout.grid, self.columns)))
        for _ in self.blocks():
            pass

    def name_acceleration(self, columns: str) -> None:
        """Select the accelerometer's columns; `UsageError` if they are missing or are the magnetometer's."""
        layout = self.layout
        known = with_acceleration(columns, layout.header, layout.columns, layout.grid.width)
        self.layout = replace(layout, columns=known)

    def name_strength(self, column: str) -> None:
        """Select the column of the field strength of a scalar magnetometer; errors are those of `name_acceleration`."""
        layout = self.layout
        known = with_strength(column, layout.header, layout.columns, layout.grid.width)
        self.layout = replace(layout, columns=known.with_strength_in(self.unit))

    def with_auxiliary(self, names: Sequence[str], *, are_needed: bool = True) -> TextRecording:
        """The recording with further columns, of numbers or words.

        Raises `InputError` for a missing name if `are_needed`; otherwise the name is left out.
        """
        places = places_in(self.source, self.layout.header, names, are_needed=are_needed)
        texts = self._first_cells(list(places.values()))
        words = {name: place for name, place in places.items() if texts[place]}
        numbers = {name: place for name, place in places.items() if name not in words}
        layout = replace(self.layout, columns=self.layout.columns.with_auxiliary(numbers, numbers.values()))
        return replace(self, layout=layout, words=tuple(words.items()))._with_state_of(self)

    def _with_state_of(self, other: TextRecording) -> TextRecording:
        """The recording itself, with the state of another recording that was opened before."""
        self.is_unit_given, self.held = other.is_unit_given, other.held
        return self

    def _first_cells(self, places: Sequence[int]) -> dict[int, bool]:
        """Whether the first cell at each place is a word, by place."""
        opening, _ = self.file.opening(self.layout.encoding)
        texts = (text for text in opening[self.layout.start - 1 :] if self.layout.is_reading(text))
        rows = [split(text, self.layout.grid.delimiter) for text in texts]
        cells = {place: [row[place] for row in rows if place < len(row)] for place in places}
        decimal = self.layout.grid.decimal
        return {place: any(parse_number(cell, decimal) is None for cell in each) for place, each in cells.items()}

    def _words_of(self, block: _Block, rows: NDArray[np.intp]) -> dict[str, NDArray[np.str_]]:
        """(N,) words of each requested column, at given rows of a block."""
        if not self.words:
            return {}
        texts, first = block.lines.texts, block.lines.first
        numbers = block.rows.numbers[rows].astype(int).tolist()
        cells = [split(texts[line - first], self.layout.grid.delimiter) for line in numbers]
        return {name: np.array([row[place].strip().strip('"') for row in cells]) for name, place in self.words}

    def corrected_lines(
        self, correct: Callable[..., Floats], *, add: bool = False, with_disturbances: bool = False
    ) -> Iterator[str]:
        """Yield the lines of `corrected_blocks`, one by one."""
        for lines in self.corrected_blocks(correct, add=add, with_disturbances=with_disturbances):
            yield from lines

    def corrected_blocks(
        self, correct: Callable[..., Floats], *, add: bool = False, with_disturbances: bool = False
    ) -> Iterator[list[str]]:
        """Yield the lines of the file with corrected readings, grouped as they were read or arrived.

        Everything else is unchanged: other columns, delimiter, decimal sign, header, comments, quotes, line ends.
        Unreadable lines are left out and counted in `skipped`; a reading that is not finite becomes ``nan``. JSON and
        labelled lines become comma-separated tables. Each line includes its end: write with ``newline=""``, and with
        `layout.encoding` to get the same bytes.

        Raises `UnreadableInput` as `blocks`.

        Parameters
        ----------
        correct : (N, 3) to (N, 3)
            Function of readings as in `Samples.field`, in `unit.inside` and in `axes`; it returns the corrected ones.
        add : bool
            Add three columns, named with ``_cal`` if there is a header, and keep the recorded ones.
        with_disturbances : bool
            Pass `Samples` to `correct` instead of readings: they have time, temperature, current and throttle too.
        """
        rewriter = Rewriter(self.layout, add=add)
        yield list(rewriter.header_lines())
        kinds = (TIME, CURRENT, THROTTLE, TEMPERATURE, CURRENTS, THROTTLES, AUXILIARY) if with_disturbances else ()
        columns = self.layout.columns.with_only(*kinds)
        for block in self._read_once(columns):  # a reading without time is corrected too
            lines, rows, usable, _ = block
            corrected = np.full((len(usable), 3), np.nan)
            if usable.any():
                words = self._words_of(block, np.flatnonzero(usable)) if with_disturbances else {}
                samples = self._samples_of(columns, rows.values[usable], words)
                given = samples if with_disturbances else samples.field
                corrected[usable] = correct(given) / self.unit.scale + 0.0  # no −0
            yield list(rewriter.lines(lines, rows, corrected))

    def written(self) -> str:
        """Description of the format."""
        return str(self.layout)

    @raise_own_errors
    def _read_once(self, columns: Columns) -> Iterator[_Block]:
        """Yield blocks of the file in one pass, count skipped lines, and check the total at the end."""
        tally, shapes = Tally(), LineShapes()
        others: tuple[Skipped, ...] = ()
        self.skipped = ()
        grid = replace(self.layout.grid, cells=columns.cells, needed=columns.needed_cells, clock=columns.clock)
        for lines, read, usable in self._read(grid, columns):
            rows, left_out = account_for_rows(lines, read, usable, columns, shapes, self.layout.is_spare)
            if self.transcription:
                left_out += self.transcription.others(others)
                others = self.transcription.others()
            tally.add(rows, usable)
            self.skipped = merge_skipped(self.skipped, left_out)
            if self.progress:
                self.progress(lines.done, self.file.size)
            yield _Block(lines, rows, usable, left_out)
        tally.refuse_mostly_unreadable(self.source, self.skipped)

    def _read(self, grid: Grid, columns: Columns) -> Iterator[tuple[Lines, NumberRows, NDArray[np.bool_]]]:
        """Yield blocks of lines; several at once if pyarrow can parse all their lines and all rows are usable."""
        if self.held and self.held.columns == columns:
            yield from self.held.blocks
            return
        file, encoding, midnights = self.file, self.layout.encoding, Midnights(grid.clock)
        parse, segments = None, file.lines(encoding)
        if isinstance(file, File) and file.size >= MIN_BYTES_FOR_ARROW and (parse := parser_of(grid)):
            segments = file.lines(encoding, blocks=BLOCKS_AT_ONCE)
        for segment in segments:
            if (whole := self._parse_block(segment, parse)) and (usable := self._usable(whole, columns)).all():
                yield segment, whole.with_unwrapped_times(midnights, grid), usable
                continue
            for lines in segment.blocks():
                rows = self._parse_block(lines, parse) or self._rows(lines, grid)
                yield lines, rows.with_unwrapped_times(midnights, grid), self._usable(rows, columns)

    def _parse_block(self, lines: Lines, parse: Parse | None) -> NumberRows | None:
        """Parse a block with pyarrow; None if pyarrow is not used or the block contains other lines than readings."""
        is_table = lines.first >= self.layout.start and self._is_all_readings(lines.text)
        values = parse(lines) if parse and is_table else None
        return None if values is None else NumberRows(values, lines.numbers, [])

    def _rows(self, lines: Lines, grid: Grid) -> NumberRows:
        """Parse those lines of a block that are expected to be readings."""
        above = max(self.layout.start - lines.first, 0)
        texts, first = lines.texts[above:], lines.first + above
        text = "\n".join(texts) if above else lines.text
        if self._is_all_readings(text) and all(map(str.strip, texts)):
            return rows_of(texts, range(first, first + len(texts)), grid)
        places = [place for place, text in enumerate(texts) if self.layout.is_reading(text)]
        return rows_of([texts[place] for place in places], [first + place for place in places], grid)

    def _is_all_readings(self, text: str) -> bool:
        """Whether lines below the header contain neither a header nor a comment; blank lines are allowed."""
        if self.layout.columns.device is not None:
            return False
        header_text = self.layout.header_text
        others = (*COMMENTS, header_text) if header_text else COMMENTS
        # finding one character takes a tenth of the time of finding two
        return not any(other[0] in text and other in text for other in others)

    def _usable(self, rows: NumberRows, columns: Columns) -> NDArray[np.bool_]:
        """(N,) booleans: whether a row is finite, also in `unit.inside`, and an answer of the sensor."""
        with np.errstate(over="ignore", invalid="ignore"):
            read = columns.readings(rows.values.T)
            usable = np.isfinite(read * self.unit.scale).all(axis=1)
        return np.asarray(usable & ~find_silent(read), dtype=np.bool_)

    def _samples(self, block: _Block) -> Iterator[tuple[Floats, Samples]]:
        """Yield samples of the usable rows, `BLOCK_ROWS` at a time, with their line numbers."""
        values = block.rows.values if block.usable.all() else block.rows.values[block.usable]
        lines, places = block.rows.numbers[block.usable], np.flatnonzero(block.usable)
        for start in range(0, len(lines), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            words = self._words_of(block, places[rows])
            yield lines[rows], self._samples_of(self.layout.columns, values[rows], words)

    def _samples_of(self, columns: Columns, values: Floats, words: Mapping[str, NDArray[np.str_]]) -> Samples:
        return columns.samples(
            values.T, unit=self.unit, axes=self.axes, source=self.source, frame=self.frame, words=words
        )


class Transcription:
    """Conversion of a recording in a dialect to a `table` without a header; rows have the numbers of their lines."""

    def __init__(self, source: Source, dialect: Dialect, encoding: str) -> None:
        self._dialect, self._encoding, self.frame = dialect, encoding, dialect.frame
        self._others: tuple[Skipped, ...] = ()
        self.table = derive_source(source, self._rows(source))

    def others(self, before: Sequence[Skipped] = ()) -> tuple[Skipped, ...]:
        """Counts of the lines that do not belong to the dialect, without those in `before`."""
        known = {entry.reason: entry.rows for entry in before}
        new = (entry for entry in self._others if entry.rows > known.get(entry.reason, 0))
        return tuple(
            replace(entry, rows=entry.rows - known[entry.reason], lines=(), example="")
            if entry.reason in known
            else entry
            for entry in new
        )

    def _rows(self, source: Source) -> Iterator[bytes]:
        """Yield the rows of each block of lines; other lines become blank, so that line numbers stay the same."""
        row, shapes = self._dialect.row, LineShapes()
        for lines in source.lines(self._encoding):
            texts, others = lines.texts, list[int]()
            rows = list[str]()
            for place, text in enumerate(texts):
                cells = row(text)
                rows.append(",".join(cells or ()) if text != GZIP_CUT_MARK else text)
                if cells is None and text.strip() and text != GZIP_CUT_MARK:
                    others.append(lines.first + place)
            self._others = merge_skipped(self._others, account_for_lines(lines, others, shapes, OTHER))
            yield "\n".join([*rows, ""]).encode()


class _Held(NamedTuple):
    """Blocks of lines in memory, and the columns that were read from them."""

    columns: Columns
    blocks: list[tuple[Lines, NumberRows, NDArray[np.bool_]]]


class _Block(NamedTuple):
    """Lines of a block, their rows, a mask of usable rows, and counts of skipped lines."""

    lines: Lines
    rows: NumberRows
    usable: NDArray[np.bool_]
    left_out: tuple[Skipped, ...]


def open_text(
    file: Source,
    *,
    columns: AnyColumns | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str | Axes = "x,y,z",
    flat: str | None = None,
    choice: Choice = FIRST_SENSOR,
    pattern: str | None = None,
    progress: Progress | None = None,
) -> TextRecording:
    """Recognise a text recording by its first lines; parameters and errors are those of `flinders.open_recording`."""
    axes = axes if isinstance(axes, Axes) else Axes.of(axes)
    head = file.head()
    refuse_foreign(file.name, head)
    sniffed = partial(recognise_table, file.name, columns=columns, flat=flat, choice=choice)
    laid_out = _lay_out(file, head, sniffed, pattern, flat)
    table, layout, transcription = laid_out.table, laid_out.layout, laid_out.transcription
    frame = transcription.frame if transcription else "sensor"
    recording = TextRecording(
        table, layout, Unit.of(COUNTS), axes, frame, transcription=transcription, original=file
    ).with_columns(layout.columns, unit, scale)
    if layout.in_force and columns is None:
        raise _not_raw(file.name, layout)
    if laid_out.is_all and not layout.columns.magnetometers:  # one of several may be dead
        recording.hold()  # errors surface here, at the cost of one block
    recording.progress = progress
    recording.skipped = ()
    return recording


class _LaidOut(NamedTuple):
    """A table as recorded or converted, with its layout."""

    table: Source
    layout: TextLayout
    is_all: bool  # whether its first lines are all lines
    transcription: Transcription | None = None  # for a file in a dialect


def _lay_out(
    file: Source, head: bytes, lay_out: Callable[..., TextLayout], pattern: str | None, flat: str | None
) -> _LaidOut:
    """Recognise the format of a file's lines; text that is not a table is converted to one."""
    encoding = encoding_of(head)
    beginning = head.decode(encoding, "replace").removeprefix("\ufeff")
    may_be_glued = beginning.lstrip().startswith(("[", "{")) or "*" in beginning
    if pattern is None and may_be_glued and (apart := split_records(file, encoding, beginning)):
        file, encoding = apart, "utf-8"
    opening, is_all = file.opening(encoding)
    every = partial(_lines, file, encoding) if isinstance(file, File) else None
    dialect, layout = recognise_layout(file.name, opening, lay_out, pattern, flat, every)
    if dialect is not None:
        transcription = Transcription(file, dialect, encoding)
        return _LaidOut(transcription.table, layout, is_all, transcription)
    clock = layout.columns.clock
    if clock and not (clock.is_settled or is_all) and isinstance(file, File):
        layout = lay_out(
            [*opening, *file.last_lines(encoding)], every=every
        )  # more lines may settle the order of day and month
    if layout.is_blackbox:
        layout = replace(layout, in_force=calibration_in_force(opening[: layout.start - 1]))
    end = re.search("\r\n|\n|\r", beginning)
    return _LaidOut(file, replace(layout, encoding=encoding, newline=end[0] if end else "\n"), is_all)


def _lines(file: File, encoding: str) -> Iterator[str]:
    """Yield all lines of a file."""
    for lines in file.lines(encoding):
        yield from lines.texts


def calibration_in_force(above: Sequence[str]) -> str:
    """Calibration of the board in the headers of its blackbox; empty if it changes nothing.

    >>> calibration_in_force(['"Firmware revision","INAV 7.0.0"', '"magzero","12,13,14"', '"maggain","1024,1024,1024"'])
    'magzero 12,13,14'
    """
    for text in above:
        match = _CALIBRATION.match(text)
        numbers = re.findall(r"[-+]?\d+", match[2]) if match else []
        neutral = _NO_GAIN if match and "gain" in match[1].casefold() else 0
        if match and any(int(each) != neutral for each in numbers):
            return f"{match[1]} {','.join(numbers)}"
    return ""


def _not_raw(name: str, layout: TextLayout) -> UnreadableInput:
    """Error for a blackbox that was recorded with a calibration applied, with ways to get raw readings."""
    return UnreadableInput(
        f"{name} was recorded with {layout.in_force} in force, and magADC includes it: a calibration found from it "
        "adds to that one, but boards would replace it. Set offsets to 0 (maggain to 1024) and record again; to use "
        "the logged readings anyway, name their columns",
        hint={"columns": ",".join(layout.columns.field.names)},
    )


READERS: Final = (
    Reader(
        "text",
        "text",
        (".csv", ".txt", ".tsv", ".dat", ".log", ".json", ".jsonl", ".gz"),
        "tables, JSON, and the lines that boards print",
        sniff=lambda head: foreign_kind(head) is None,
        open=open_text,
    ),
)
