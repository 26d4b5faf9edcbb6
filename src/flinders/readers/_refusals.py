"""Checks that refuse texts: without a magnetometer, with several sensors in one column, or with grouped thousands.

>>> refuse_one_value("log.csv", [f"mag_{axis},{value}" for axis in "xyz" for value in range(9)])
Traceback (most recent call last):
flinders.errors.NoMagnetometer: log.csv has one value in each row, and column 1 names the axis (mag_x, mag_y, mag_z):
    pivot the table, so that x, y and z of a reading are in one row, or export a column for each axis
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.plugins import remark
from flinders.errors import NoMagnetometer, UnreadableInput, figures
from flinders.readers._cells import parse_number, split
from flinders.readers._choice import MAX_NAMES
from flinders.readers._delimiters import SIGNS, is_comment, split_lines
from flinders.readers._devices import MAX_DEVICES, MIN_READINGS, normalise_word, sensors_of_words
from flinders.readers._instruments import magnetometers, names_magnetometer
from flinders.readers._likeness import GRAVITY, GRAVITY_TOLERANCE, MAX_GRAVITY_SPREAD, XYZ
from flinders.readers._lines import CUT_MARK, GZIP_CUT_MARK
from flinders.readers._names import ACCELERATION, FIELD, RATE, meaning
from flinders.readers._tokenizer import (
    MOMENT,
    QUANTITY,
    is_labelled,
    list_columns,
    names_of,
    pattern_of,
    shorten,
    split_line,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.errors import InputError
    from flinders.readers._clock import Clock
    from flinders.readers._columns import Columns
    from flinders.readers._devices import Device

ONE_VALUE_SIGNS: Final = (",", ";", "\t", "|")  # Delimiters of tables with one value a row
SEARCHED_LETTERS: Final = 1024  # Characters of a line that are searched for labels
MAX_EXAMPLE_LETTERS: Final = 160  # Longest line, in characters, that is shown as a pattern
MAX_LINES_ABOVE: Final = 40  # First lines in which a header without readings is searched
MAX_NAMELESS_COLUMNS: Final = 5  # Largest number of unnamed columns in which a leading number may name the sensor
MAX_CODES: Final = 16  # Largest number of different codes in a column that may name the sensor of each line
MIN_CHANGE_SHARE: Final = 0.2  # Smallest share of rows at which such a code changes
MIN_LINES_OF_CODE: Final = 10  # Smallest number of lines with a code for its lengths to be compared
MIN_RATIO_TO_GRAVITY: Final = 2.0
MIN_RATIO: Final = 5.0
"""Smallest ratios of median vector lengths that distinguish two sensors: if one measures gravity, and otherwise."""
MAX_RANGES: Final = 16  # Columns whose ranges are listed
_GROUPED_NUMBER: Final = re.compile(r"[-+\u2212]?[1-9]\d{0,2}[.,]\d{3}")  # thousands, or a number with three decimals
MATRIX: Final = re.compile(r"# (?:name: (?P<name>.+)|columns: (?P<columns>\d+)\s*$)")  # in text of Octave


def refuse_unsafe(
    name: str, header: Sequence[str], alike: Sequence[Sequence[str]], chosen: Columns, decimal: str
) -> None:
    """Raise an error if rows mix several sensors or have thousands separators, and the user chose no columns."""
    if not header or meaning(chosen.field.names[0]).is_bare:
        _refuse_mixed(name, header, alike)
    _refuse_thousands(name, alike, chosen, decimal)


def refuse_nameless(name: str, devices: Sequence[Device], clocks: Sequence[Clock], width: int) -> None:
    """Raise an error for a table without a header in which a column names the sensor of each line."""
    if devices and width <= MAX_NAMELESS_COLUMNS:
        words = ", ".join(" ".join(device.words) for device in devices[:MAX_NAMES])
        column = devices[0].cells[0]
        taken = {*devices[0].cells, *(cell for clock in clocks for cell in clock.cells)}
        others = ",".join([str(cell + 1) for cell in range(width) if cell not in taken][-3:])
        raise NoMagnetometer(
            f"column {column + 1} of {name} names the sensor of each line ({words}): name the columns of x, y and z, "
            "and choose one sensor",
            hint={"columns": others, "sensor": None},
        )


def refuse_matrices(name: str, texts: Sequence[str]) -> None:
    """Raise an error for Octave text with several matrices of three columns, one below the other."""
    named = (match for text in texts if text.startswith("# ") and (match := MATRIX.match(text)))
    known: list[str] = []
    wide: list[str] = []
    for match in named:
        known += [match["name"]] if match["name"] else []
        wide += known[-1:] if int(match["columns"] or 0) >= len("xyz") else []
    if len(wide) > 1:
        raise NoMagnetometer(
            f"{name} has several matrices, one below the other ({', '.join(wide)}): save only the matrix of the "
            f"magnetometer, such as with save -text field.txt {wide[-1]}"
        )


@np.errstate(over="ignore", invalid="ignore")
def refuse_coded(name: str, header: Sequence[str], values: Floats, cells: Sequence[int]) -> None:
    """Raise an error if a column of codes seems to name the sensor: vector lengths differ widely between codes."""
    lengths = np.linalg.norm(values[:, cells], axis=1)
    for place in (place for place in range(values.shape[1]) if place not in cells):
        known = values[:, place][np.isfinite(values[:, place])]
        codes, steps = np.unique(known), np.diff(known)
        is_in_turn = np.mean(steps != 0) > MIN_CHANGE_SHARE and (steps < 0).any() if len(steps) else False
        if not (is_in_turn and len(codes) <= MAX_CODES and (codes == np.floor(codes)).all()):
            continue
        own = {int(code): lengths[(values[:, place] == code) & np.isfinite(lengths)] for code in codes}
        usual = {code: float(np.median(each)) for code, each in own.items() if len(each) >= MIN_LINES_OF_CODE}
        factor = (
            MIN_RATIO_TO_GRAVITY if any(_is_gravity(own[code], length) for code, length in usual.items()) else MIN_RATIO
        )
        if usual and min(usual.values()) * factor < max(usual.values()):
            column = repr(header[place].strip()) if header else str(place + 1)
            told = ", ".join(f"{code}: {figures(length, 3)}" for code, length in usual.items())
            raise NoMagnetometer(
                f"column {column} of {name} seems to number the sensor of each line, as the vector lengths "
                f"differ widely ({told}): keep only the lines of the magnetometer"
            )


def _is_gravity(lengths: Floats, usual: float) -> bool:
    """Whether vector lengths are those of gravity, in m/s² or g."""
    is_near = any(abs(usual / GRAVITY[unit] - 1) < GRAVITY_TOLERANCE for unit in ("m/s²", "g"))
    return is_near and float(np.median(np.abs(lengths - usual))) < MAX_GRAVITY_SPREAD * usual


def refuse_one_value(name: str, lines: Sequence[str], *, may_be_in_turn: bool = False) -> None:
    """Raise an error for a table with one value and the word for its axis per row, such as ``sensor.x,28.90,2026``.

    With `may_be_in_turn`, labelled lines whose axes alternate are accepted.
    """
    texts = [text for text in lines if text.strip() and not is_comment(text)]
    for delimiter in ONE_VALUE_SIGNS:
        rows = [split(text, delimiter) for text in texts if delimiter in text]
        if 2 * len(rows) <= len(texts):
            continue
        width = Counter(map(len, rows)).most_common(1)[0][0]
        for place in range(width):
            words = [normalise_word(row[place]) for row in rows if len(row) == width > 1]
            told = _axes_of_words(words)
            if told and (may_be_in_turn or not _are_in_turn([word for word in words if word in told])):
                raise NoMagnetometer(
                    f"{name} has one value in each row, and column {place + 1} names the axis ({', '.join(told)}): "
                    "pivot the table, so that x, y and z of a reading are in one row, or export a column for each axis"
                )


def _axes_of_words(words: Sequence[str]) -> list[str]:
    """Repeated words that name the three axes of a magnetometer; empty if there are too many different words."""
    counts = Counter(words)
    often = sorted(word for word, count in counts.items() if count >= MIN_READINGS and parse_number(word, ".") is None)
    found = magnetometers(often) if len(counts) <= MAX_DEVICES else ()
    return [often[cell] for cell in found[0].cells] if found else []


def _are_in_turn(words: Sequence[str]) -> bool:
    """Whether most words differ from the next one."""
    return 2 * sum(one != other for one, other in pairwise(words)) > len(words)


def _refuse_mixed(name: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Raise an error if a column of words names the sensor of each line, and none of the words is a magnetometer."""
    for place in range(min(map(len, rows))):
        known = sensors_of_words(row[place] for row in rows)
        if others := [word for word, each in known.items() if each.kind != FIELD]:
            column = f"column {header[place].strip()!r}" if header else f"column {place + 1}"
            raise NoMagnetometer(
                f"{column} of {name} names the sensor of each line, such as {others[0]!r}: keep the lines of "
                "the magnetometer, or name the columns to read them all",
                hint={"columns": None},
            )


def _refuse_thousands(name: str, rows: Sequence[Sequence[str]], columns: Columns, decimal: str) -> None:
    """Raise an error if commas or points in readings seem to be thousands separators."""
    grouped: list[str] = []
    whole: list[float] = []
    for cell in (row[place].strip() for row in rows for place in columns.field.cells):
        if decimal not in cell:
            value = parse_number(cell, ".")
            whole += [] if value is None else [abs(value)]
        elif _GROUPED_NUMBER.fullmatch(cell):
            grouped.append(cell)
        else:
            return
    if len(grouped) >= 3 and 100 <= max(whole, default=0) < 1000:
        raise UnreadableInput(
            f"numbers of {name} such as {grouped[0]!r} next to {max(whole):.0f} seem to have {decimal!r} as thousands "
            f"separator: save the numbers without it, or name the columns if {decimal!r} is the decimal sign",
            hint={"columns": None},
        )


def ranges(values: Floats) -> str:
    """Range of each column in a table without names: ``1: 0 to 0.25, 2: -302 to 299``."""
    columns = [column[np.isfinite(column)] for column in values.T]
    ends = [f"{figures(each.min(), 3)} to {figures(each.max(), 3)}" if len(each) else "no numbers" for each in columns]
    written = [f"{number}: {each}" for number, each in enumerate(ends[:MAX_RANGES], 1)]
    return ", ".join(written + ["…"] * (len(ends) > MAX_RANGES))


def extremes_alone(name: str, texts: Sequence[str]) -> NoMagnetometer | None:
    """Error for a text that is only six numbers, the extremes of each axis; None for any other text."""
    if len(texts) > 2 * len("xyz"):
        return None
    numbers = [each for text in texts for each in split_line(text[:SEARCHED_LETTERS])[0]]
    if len(numbers) != 2 * len("xyz"):
        return None
    pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    in_turn = all((parse_number(low, ".") or 0.0) < (parse_number(high, ".") or 0.0) for low, high in pairs)
    typed = ",".join(numbers) if in_turn else "X0,X1,Y0,Y1,Z0,Z1"
    return NoMagnetometer(
        f"{name} has six numbers and no readings: if they are the smallest and the largest reading of each axis, "
        f"type them: flinders calibrate --minmax={typed}"
    )


def no_magnetometer(name: str, header: list[str], values: Floats, text: str, heading: str, line: str) -> NoMagnetometer:
    if not header and len(values) == 1 and (extremes := extremes_alone(name, [text])):
        return extremes
    if header:
        return NoMagnetometer(
            f"no magnetometer among the columns of {name}: {list_columns(header)}; "
            "say which three it is, by name or by number",
            hint=XYZ,
            columns=header,
        )
    return _other_labels(name, text, line) or NoMagnetometer(
        f"{name} has {values.shape[1]} columns and {heading}: need three, x y z, "
        f"or four with the time first; they go from {ranges(values)}; say which are the magnetometer, by number",
        hint=XYZ,
    )


def _other_labels(name: str, text: str, line: str) -> NoMagnetometer | None:
    """Error that names the other sensors in a line's labels; None for a line without labels."""
    gaps = split_line(text[:SEARCHED_LETTERS])[1]
    names = names_of(gaps) if len(gaps) > 1 else ()
    others = {meaning(each).kind for each in names} & {ACCELERATION, RATE}
    if not others and not (is_labelled(gaps) and any(map(QUANTITY.search, names))):
        return None
    what = " and ".join(sorted(others)) or ", ".join(dict.fromkeys(filter(None, names)))
    return NoMagnetometer(
        f"the labels of {name} name {what} and no magnetometer{line}: let the board print its magnetometer "
        "too, or say which numbers of a line are its readings",
        hint={"pattern": None},
    )


def no_readings_found(name: str, lines: list[tuple[int, str]]) -> InputError:
    """Error for a file without rows of three numbers; it describes what the file contains."""
    if lines[-1][1] == GZIP_CUT_MARK:
        return UnreadableInput(
            f"{name} is cut short before its first reading: its gzip data have no end; copy it again"
        )
    few = max((split_lines(lines, signs, 1).rows for signs in SIGNS), key=len)
    numbers = [(at, text) for at, text in lines if len(split_line(text[:SEARCHED_LETTERS])[0]) >= 3]
    headed = next(
        (
            at
            for at, text in lines[:MAX_LINES_ABOVE]
            for sign, _ in SIGNS
            if names_magnetometer(split(text[: 16 * SEARCHED_LETTERS], sign))
        ),
        None,
    )
    if headed is not None and not few and not numbers:
        return UnreadableInput(
            f"{name} has a header (line {headed + 1}) and no readings below it: record again, or check what was saved"
        )
    if 2 * len(few) >= len(lines) and len(numbers) < len(few):
        place, text = next((place, text) for place, text in lines if place in few)
        return NoMagnetometer(
            f"{name} has fewer than three numbers a line (line {place + 1}: {shorten(text)!r}): "
            f"need three, x y z, one reading a line{remark('two columns')}"
        )
    place, text = lines[0]
    if text.endswith(CUT_MARK):
        return UnreadableInput(
            f"line {place + 1} of {name} is longer than a million characters ({shorten(text)!r}): "
            "need one reading a line"
        )
    place, text = numbers[0] if numbers else lines[0]
    line = f" (line {place + 1}: {shorten(text)!r})"
    if not numbers and any(MOMENT.search(text[:SEARCHED_LETTERS]) for _, text in lines[:MAX_LINES_ABOVE]):
        return NoMagnetometer(
            f"no magnetometer in {name}: no line has three numbers besides dates and times{line}; need x, y and z of a "
            "reading on a line"
        )
    return (_other_labels(name, text, line) if numbers else None) or _unrecognised_text(
        name, text if numbers else "", line
    )


def _unrecognised_text(name: str, text: str, line: str) -> UnreadableInput:
    """Error for unrecognised text; if a line has numbers, it suggests a ``--pattern``."""
    pattern = pattern_of(text) if len(text) <= MAX_EXAMPLE_LETTERS else ""
    example = ", as here if those are x, y and z" if pattern else ""
    return UnreadableInput(
        f"no readings are recognised in {name}{line}: need three columns of numbers, "
        f"labels such as 'X: -20.8 Y: -20.2 Z: 26.1 uT', or how a line is printed{example}",
        hint={"pattern": pattern or None},
    )
