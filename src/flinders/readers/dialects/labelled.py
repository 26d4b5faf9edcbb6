"""Lines in which labels name the numbers: ``X: -20.8 Y: -20.2 Z: 26.1 uT``, ``Mag (uT) [ 1, 2, 3 ]``.

Lines with the same labels and units are of one kind. A line of the kind that names the magnetometer ends a reading; if
each line has one axis, the line of z does. Lines of other sensors before it belong to the same reading. A line that was
cut has other labels, or lacks its unit.

>>> dialect = recognise(["Accel X: 0.1 Y: 0.2 Z: 9.8 m/s^2", "Mag X: -20.8 Y: -20.2 Z: 26.1 uT", "", "low battery"] * 2)
>>> dialect.row("Accel X: 0.1 Y: 0.2 Z: 9.7 m/s^2"), dialect.row("Mag X: 1 Y: 2 Z: 3 uT")
((), ['1', '2', '3', '0.1', '0.2', '9.7'])
>>> dialect.row("Mag X: 1 Y: 2 Z:"), recognise(["1,2,3"]), recognise(["(1, 2, 3)"] * 3, marked=False).names
(None, None, ('x', 'y', 'z'))
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from flinders.core.units import COUNTS
from flinders.errors import NoMagnetometer
from flinders.readers._cells import COMMENTS
from flinders.readers._instruments import magnetometers, vectors
from flinders.readers._names import ACCELERATION, FIELD, RATE, TEMPERATURE, TIME, clearness, meaning
from flinders.readers._tokenizer import (
    QUANTITY,
    compile_pattern,
    is_labelled,
    label_of,
    names_of,
    pattern_of,
    shorten,
    split_line,
)
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

Kind: TypeAlias = "tuple[str, ...]"  # names of a line's numbers, which are equal for all lines of one kind
# smallest frequency of a kind that is preferred because it states its unit, relative to the most frequent kind
MIN_KIND_SHARE: Final = 0.5
# smallest frequency of a kind that is read together with the magnetometer's, relative to that kind
MIN_AUXILIARY_SHARE: Final = 0.05
MIN_FIELD_SHARE: Final = 0.1
"""Smallest share of the magnetometer's lines among lines with three or more numbers."""
AUXILIARY: Final = (ACCELERATION, RATE, TEMPERATURE, TIME)
DELIMITERS: Final = frozenset(("", ",", ";", '"', '","', '";"', ":", "/"))
"""Text between the numbers of a table, of times and of dates."""
_SETTING: Final = re.compile(r"calibration|offset|bias|matrix|(hard|soft).?iron", re.IGNORECASE)
"""Words of lines that print a sensor's settings or its correction."""
_AXIS_ALONE: Final = re.compile(r"\s*[wxyz]\s*[:=][^:=]*", re.IGNORECASE)  # as in YAML, and in ``ros2 topic echo``
MAX_LINE_LETTERS: Final = 2048  # largest number of characters in a printed line
PLAIN: Final = ("x", "y", "z")
WORDS: Final = "labelled lines"
MIN_TURNS, MIN_TURNS_FOR_STRENGTHS = 8, 24
"""Smallest number of lines for which steps, or strengths, can show that several sensors alternate."""
MAX_LABELS: Final = 6  # largest number of labels of one kind of line that can be sensors; more are a word that changes
MIN_ROWS: Final = 10  # smallest number of lines for which a column can be a clock, a counter or constant
MAX_STEP_RATIO: Final = 2.0  # largest ratio of the largest to the smallest step of a clock or counter
MIN_STRENGTH_RATIO: Final = 2.0  # smallest ratio of the median strengths of sensors that alternate
# largest step between lines of the same sensor, relative to that between neighbouring lines, if sensors alternate
MAX_OWN_STEP_SHARE: Final = 0.3


class _Printed(NamedTuple):
    """One line, split into numbers and texts."""

    kind: Kind
    label: str  # the words before and between its numbers
    text: str
    numbers: list[str]
    gaps: tuple[str, ...]
    is_labelled: bool
    is_plain: bool
    is_setting: bool


@dataclass(slots=True)
class _Heading:
    """A label on a line of its own: for the numbers in the next line, or for lines below with one axis each."""

    label: str = ""
    is_taken: bool = False  # whether a line with an axis has used it

    def add_label(self, line: str) -> str:
        """A line with the label in front; empty for a line that is itself a label."""
        if _is_heading(line):
            self.label, self.is_taken = line, False
            return ""
        is_axis = bool(self.label) and _AXIS_ALONE.fullmatch(line) is not None
        joined = f"{self.label} {line}" if self.label and (is_axis or not self.is_taken) else line
        self.label, self.is_taken = self.label if is_axis else "", is_axis
        return joined


@dataclass(slots=True)
class Labelled(Dialect):
    """Lines of one or more kinds that together make a reading."""

    kinds: dict[Kind, int]  # kinds that are read, with the place of their first number in the row
    closing: Kind  # kind that ends a reading
    needed: frozenset[int]  # places in the row that a reading must have
    labels: dict[Kind, str] = field(default_factory=dict)  # label of each kind, if it has exactly one
    has_headings: bool = False  # whether labels are on separate lines above the numbers
    signs: tuple[str, ...] | None = None  # text before and between the numbers, for lines without labels
    _heading: _Heading = field(default_factory=_Heading, init=False)
    _cells: list[str] = field(init=False)
    _quick: re.Pattern[str] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._cells = [""] * len(self.names)

    def row(self, line: str) -> Sequence[str] | None:
        """Store the numbers of a line by its kind; if the line completes a reading, return the cells of the reading."""
        if self._quick and not self._heading.label and (match := self._quick.fullmatch(line)):
            return match.groups()
        line = self._heading.add_label(line) if self.has_headings else line
        if not line:
            return ()
        numbers, gaps = split_line(line) if len(line) <= MAX_LINE_LETTERS else ([], ())
        kind = self._kind(gaps)
        if kind is None:
            return None
        if len(self.kinds) == 1:
            self._quick = self._quick or compile_pattern(gaps)
            return numbers
        start = self.kinds[kind]
        self._cells[start : start + len(numbers)] = numbers
        if kind != self.closing:
            return ()
        cells, self._cells = self._cells, [""] * len(self.names)
        return cells if all(cells[place] for place in self.needed) else ()

    def _kind(self, gaps: tuple[str, ...]) -> Kind | None:
        """Kind of a line, by the texts between its numbers; None for a line that is not read."""
        kind = names_of(gaps) if len(gaps) > 1 else ()
        if kind not in self.kinds or self.signs not in (None, gaps[:-1]):
            return None
        return kind if kind not in self.labels or self.labels[kind] == label_of(gaps) else None


def recognise(lines: list[str], *, marked: bool = True) -> Labelled | None:
    """Find lines whose labels name a magnetometer; unless `marked`, also three numbers between any words."""
    lines = [
        line
        for line in lines
        if line.strip() and not line.lstrip().startswith(COMMENTS) and len(line) <= MAX_LINE_LETTERS
    ]
    every = list(map(_split_printed, lines))
    heading = _Heading()
    headed = [_split_printed(joined) for line in lines if (joined := heading.add_label(line))]
    if has_headings := _has_headings(every, headed):
        every = headed
    of_three = Counter(each.kind for each in every if len(each.numbers) >= len(PLAIN))
    enough = MIN_KIND_SHARE * max(of_three.values(), default=0)
    printed = [each for each in every if each.numbers and not each.is_setting and not (each.is_plain and not marked)]
    counts = Counter(each.kind for each in printed)
    labelled = list(dict.fromkeys(each.kind for each in printed if each.is_labelled or not marked))
    often = [kind for kind in labelled if counts[kind] >= enough]
    closing = _magnetometer([kind for kind in often if _may_be_readings(kind, [kind], printed)], counts)
    if closing is not None and counts[closing] < MIN_FIELD_SHARE * of_three.total():
        return None
    if closing is None:
        least = max(MIN_KIND_SHARE * max((counts[kind] for kind in labelled if any(kind)), default=0), enough)
        dialect = _axis_by_axis([kind for kind in labelled if counts[kind] >= least], printed)
    else:
        dialect = _line_by_line(closing, counts, printed)
    if dialect is None:
        return None if marked else _by_place(printed, enough, every)
    dialect.has_headings = has_headings
    dialect.labels = _labels(dialect, printed)
    return dialect


def _is_heading(line: str) -> bool:
    """Whether a line is the label of the numbers in the next line: ``Magnetometer data in µT:``, ``field {``."""
    return len(line) <= MAX_LINE_LETTERS and line.rstrip().endswith((":", "{")) and not split_line(line)[0]


def _has_headings(every: Sequence[_Printed], headed: Sequence[_Printed]) -> bool:
    """Whether labels are on lines of their own above the numbers: such lines are frequent, and differ or are known."""
    headings = [each.text for each in every if _is_heading(each.text)]
    counts = Counter(each.kind for each in every if any(each.kind))
    if 2 * len(headings) <= max(counts.values(), default=0):
        return False
    alone = {each.kind for each in every}
    is_known = any(meaning(name).kind for each in headed if each.kind not in alone for name in each.kind)
    return is_known or len(set(headings)) > 1


def _split_printed(line: str) -> _Printed:
    numbers, gaps = split_line(line)
    is_plain = set(gaps) <= DELIMITERS and "0x" not in line.casefold()
    is_setting = _SETTING.search(gaps[0]) is not None
    kind = names_of(gaps) if numbers else ()
    return _Printed(kind, label_of(gaps), line, numbers, gaps, is_labelled(gaps), is_plain, is_setting)


def _labels(dialect: Labelled, printed: Sequence[_Printed]) -> dict[Kind, str]:
    """Label of each kind that is read; `NoMagnetometer` if the magnetometer's lines have several labels.

    Any other kind with several labels is removed from the dialect.
    """
    labels = dict[Kind, str]()
    for kind in list(dialect.kinds):
        every = Counter(each.label for each in printed if each.kind == kind)
        often = [label for label, count in every.items() if count >= MIN_AUXILIARY_SHARE * every.total()]
        if not 0 < len(often) <= MAX_LABELS:
            continue
        labels[kind] = often[0]
        if len(often) == 1:
            continue
        if kind == dialect.closing or dialect.needed.intersection(_places(dialect, kind)):
            lines = [next(each.text for each in printed if (each.kind, each.label) == (kind, label)) for label in often]
            raise NoMagnetometer(
                f"labels before {', '.join(kind)} name several sensors (such as {shorten(lines[0])!r} and "
                f"{shorten(lines[1])!r}): keep the lines of the magnetometer, or state how they are printed",
                hint={"pattern": pattern_of(lines[0])},
            )
        del dialect.kinds[kind]
    return labels


def _places(dialect: Labelled, kind: Kind) -> range:
    """Places in a row for the numbers of a kind."""
    return range(dialect.kinds[kind], dialect.kinds[kind] + len(kind))


def _may_be_readings(names: Kind, kinds: Sequence[Kind], printed: Sequence[_Printed]) -> bool:
    """Whether the numbers of these kinds may be a magnetometer's, although their names do not say so.

    No axis may be a clock or a counter; if the axes have no labels, not all may be constant.
    """
    fields = magnetometers(names)
    known = meaning(names[fields[0].cells[0]]) if fields else None
    if known is None or clearness(known.rank) == 0:
        return True
    columns = [
        column
        for kind in kinds
        for column in zip(*(each.numbers for each in printed if each.kind == kind), strict=True)
    ]
    axes = [np.array(columns[cell], float) for cell in fields[0].cells]
    return not any(map(_is_counter, axes)) and (known.is_bare or any(map(np.ptp, axes)) or len(axes[0]) < MIN_ROWS)


def _is_counter(values: Floats) -> bool:
    """Whether a column rises in even steps, as that of a clock or a counter does."""
    steps = np.diff(values[np.isfinite(values)])
    return len(steps) >= MIN_ROWS - 1 and bool(0 < steps.max() <= MAX_STEP_RATIO * steps.min())


def _magnetometer(kinds: Sequence[Kind], counts: Counter[Kind]) -> Kind | None:
    """The kind of the magnetometer: raw readings come first, then those with a unit, then the most frequent kind."""
    sensors = {kind: fields for kind in kinds if (fields := magnetometers(kind))}
    often = [kind for kind in sensors if counts[kind] >= MIN_KIND_SHARE * max(counts[other] for other in sensors)]

    def quality(kind: Kind) -> tuple[int, bool, int]:
        best = sensors[kind][0]
        return best.rank, meaning(kind[best.cells[0]]).unit in ("", COUNTS), -counts[kind]

    return min(often, key=quality, default=None)


def _is_read_with(kind: Kind, closing: Kind) -> bool:
    """Whether a kind of line is read together with the magnetometer's: another sensor, or another magnetometer."""
    meanings = list(map(meaning, kind))
    if any(vectors(kind, meanings, each) for each in (ACCELERATION, RATE)):
        return True
    if vectors(kind, meanings, FIELD):
        return len(magnetometers(closing + kind)) > len(magnetometers(closing))
    return any(known.kind in AUXILIARY for known in meanings)


def _line_by_line(closing: Kind, counts: Counter[Kind], printed: Sequence[_Printed]) -> Labelled:
    """Dialect for lines of several magnetometers in turn; each row begins with their numbers."""
    others = [kind for kind in counts if kind != closing and counts[kind] >= MIN_AUXILIARY_SHARE * counts[closing]]
    read = [kind for kind in counts if kind == closing or (kind in others and _is_read_with(kind, closing))]
    turns = [kind for kind in read if kind == closing or (magnetometers(kind) and counts[kind] >= counts[closing] - 1)]
    kinds, names = dict[Kind, int](), tuple[str, ...]()
    for kind in (*turns, *(kind for kind in read if kind not in turns)):
        kinds[kind] = len(names)
        rows = [each.numbers for each in printed if each.kind == kind]
        names += _name_time(kind, rows) if kind in turns else kind
    last = kinds[turns[-1]]
    return Labelled(WORDS, names, kinds, turns[-1], frozenset(range(last, last + len(turns[-1]))))


def _axis_by_axis(kinds: Sequence[Kind], printed: Sequence[_Printed]) -> Labelled | None:
    """Dialect for lines with one axis each; the line of z ends the reading."""
    names = tuple(name for kind in kinds for name in kind)
    fields = magnetometers(names)
    if not fields or not _may_be_readings(names, kinds, printed):
        return None
    starts = {kind: sum(map(len, kinds[:place])) for place, kind in enumerate(kinds)}
    last = fields[0].cells[-1]
    closing = next(kind for kind, start in starts.items() if start <= last < start + len(kind))
    return Labelled(WORDS, names, starts, closing, frozenset(fields[0].cells))


def _by_place(printed: Sequence[_Printed], enough: float, every: Sequence[_Printed]) -> Labelled | None:
    """Dialect for lines of three numbers, or of a time and three numbers, with any text between them.

    These lines must be half of all lines; those of `every` line that recurs with them are not counted.
    """
    alike = Counter((each.kind, each.gaps[:-1]) for each in printed if _may_be_axes(each.kind))
    (kind, signs), count = max(alike.items(), key=lambda counted: counted[1], default=(((), ()), 0))
    beside = Counter(each.gaps for each in every if len(each.numbers) < len(PLAIN)).values()
    rest = len(every) - sum(lines for lines in beside if lines >= MIN_KIND_SHARE * count)
    if (
        not count
        or count < max(enough, MIN_KIND_SHARE * rest)
        or sum(other > MIN_KIND_SHARE * count for other in alike.values()) > 1
    ):
        return None
    rows = [each.numbers for each in printed if (each.kind, each.gaps[:-1]) == (kind, signs)]
    values = np.array(rows, float)
    axes = values[:, -len(PLAIN) :].T
    if (
        _alternates(values)
        or any(map(_is_counter, axes))
        or (len(rows) >= MIN_ROWS and sum(np.ptp(axis) != 0 for axis in axes) < 2)
    ):
        return None
    names = _name_time(kind, rows)
    if len(kind) != len(PLAIN) and meaning(names[0]).kind != TIME:
        return None
    words = "lines of three numbers" if len(kind) == len(PLAIN) else "lines of time and three numbers"
    names = (*names[: -len(PLAIN)], *(f"{axis}{_unit_alone(kind)}" for axis in PLAIN))
    return Labelled(words, names, {kind: 0}, kind, frozenset(range(len(kind))), signs=signs)


def _may_be_axes(kind: Kind) -> bool:
    """Whether the labels of three or four numbers allow a reading: no labels, or one label for all three axes."""
    names = kind[-len(PLAIN) :]
    others = (kind[0], "") if len(kind) == len(PLAIN) + 1 else ("",)
    if len(kind) not in (len(PLAIN), len(PLAIN) + 1) or (others[0] and meaning(others[0]).kind != TIME):
        return False
    if not any(names) or _unit_alone(kind):
        return True
    stems = {name.rpartition(" ")[0] for name in names}
    is_of_axes = tuple(name.rpartition(" ")[2] for name in names) == PLAIN
    return is_of_axes and len(stems) == 1 and not meaning(names[0]).kind and not QUANTITY.search(names[0])


def _unit_alone(kind: Kind) -> str:
    """Unit after the last three numbers, if these have no label: ``1 2 3 mT``."""
    units = set(kind[-len(PLAIN) :])
    return unit if len(units) == 1 and (unit := units.pop()).startswith(" (") else ""


def _alternates(values: Floats) -> bool:
    """Whether lines of two or three sensors alternate: lines of one are alike, or the strengths of sensors differ."""
    if len(values) < MIN_TURNS:
        return False
    steps = [np.nanmedian(np.abs(values[after:] - values[:-after]).sum(axis=1)) for after in (1, 2, 3)]
    strengths = np.linalg.norm(values, axis=1)
    turns = [[np.nanmedian(strengths[start::count]) for start in range(count)] for count in (2, 3)]
    is_uneven = len(values) >= MIN_TURNS_FOR_STRENGTHS and any(
        max(each) > MIN_STRENGTH_RATIO * min(each) for each in turns
    )
    return is_uneven or bool(min(steps[1:]) < MAX_OWN_STEP_SHARE * steps[0])


def _name_time(kind: Kind, rows: Sequence[Sequence[str]]) -> Kind:
    """Names with an unlabelled first number called the time, if it ascends and is not a row counter."""
    if kind[0] and meaning(kind[0]).kind != "":
        return kind
    first = [float(row[0]) for row in rows]
    steps = {after - before for before, after in pairwise(first)}
    is_time = len(steps) > 0 and min(steps) > 0 and steps != {1.0}
    return ("time", *kind[1:]) if is_time and not kind[0] else kind
