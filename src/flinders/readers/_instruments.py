"""Three-axis sensors by the names of columns, and the choice of those that are separate magnetometers.

A table may contain ``mag1_x`` and ``mag2_x``, which are two instruments. ``mag_raw_x`` and ``mag_cal_x`` are one
instrument before and after its calibration. The rest of the name decides: the words that remain without axis, unit and
words that all magnetometers have. Numbers (``imu2.mag.x``), places (``mag_left_x``), chips (``rm3100_x``), devices
(``imu_mx``) and consecutive letters (``mag_a_x``, ``mag_b_x``) mark separate instruments. Any other word, such as
``filtered``, marks a second version of the same instrument. The rawest version is selected; of equally raw ones, the
one with the plainest name. A reference, ``mag_ref_x``, is not an instrument.

>>> def names(*sensors):
...     return [each.name for each in magnetometers([f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"])]
>>> names("mag1", "mag2", "mag2_cal"), names("mag", "mag_raw", "mag_ned"), names("mag_left", "mag_right")
(['mag1', 'mag2'], ['mag'], ['mag_left', 'mag_right'])
>>> names("mag", "imu_mag"), names("lis3mdl", "mpu6050", "rm3100_raw"), names("mag", "mag_lis3mdl_cal")
(['mag', 'imu_mag'], ['lis3mdl', 'rm3100'], ['mag'])
>>> names("mag_ref", "mag"), names("mag_filtered", "mag_main"), names("mag_t0", "mag_t1"), names("b", "m")
(['mag'], ['mag_main'], ['mag_t0'], ['m'])
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.readers._names import (
    BARE_CLEARNESS,
    CALIBRATED_RANK,
    FIELD,
    Meaning,
    clearness,
    field_stem,
    identifies_sensor,
    kind_of_no_readings,
    label,
    meaning,
    sensor_name,
    source_rank,
    words_of_sensor,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

# smallest bare number that needs a neighbour to count as a sensor's number; sensors count from 0 or 1
MIN_PAIRED_NUMBER: Final = 10
MAX_DIGITS: Final = 9  # largest count of digits in a number; a longer word is text


class Vector(NamedTuple):
    """Three columns of one sensor."""

    cells: tuple[int, ...]  # places of x, y, z
    rank: int  # rank of the readings, as in `Meaning`
    label: tuple[str, ...]  # words of the names other than those that all such sensors have
    name: str  # the names without axis and unit
    whole: str = ""  # `name` with ``raw``, ``filtered`` and the unit, which distinguish copies of the same readings
    instead: str = ""  # their kind if they are not readings, such as ``a reference``

    @property
    def number(self) -> tuple[str, ...]:
        """Numbers and places in the label; the whole label if it has neither."""
        return tuple(word for word in self.label if _is_number(word) or identifies_sensor(word)) or self.label


def vectors(names: Sequence[str], meanings: Sequence[Meaning], kind: str) -> list[Vector]:
    """Three-axis sensors of a kind, in the order of their first columns; names may occur twice."""
    sensors: dict[tuple[str, int], dict[str, int]] = defaultdict(dict)
    times: Counter[str] = Counter()
    for place, known in enumerate(meanings):
        if known.kind == kind and known.axis:
            name = names[place].strip().casefold()
            times[name] += 1
            sensors[field_stem(name, known.axis), times[name]][known.axis] = place
    for axis, place in [each for axes in sensors.values() if not _letters(axes) for each in axes.items()]:
        sensors["".join(words_of_sensor(names[place])), 1].setdefault(axis, place)
    made = []
    for (_, time), axes in sensors.items():
        letters = _letters(axes)
        if letters:
            cells = tuple(axes[letter] for letter in letters)
            first, again = names[cells[0]], (str(time),) if time > 1 else ()
            name, whole = (" ".join((sensor_name(first, letters[0], whole=each), *again)) for each in (False, True))
            marks = (*label(first), *again)
            made.append(Vector(cells, meanings[cells[0]].rank, marks, name, whole, kind_of_no_readings(first)))
    return sorted(made, key=lambda vector: min(vector.cells))


def _letters(axes: Iterable[str]) -> str:
    """The three letters of the axes; empty if one is missing."""
    return next((letters for letters in ("xyz", "012", "123") if set(letters) <= set(axes)), "")


SET_WORD: Final = re.compile(r"_?(?<![a-zA-Z])(?:set|SET)(?![a-zA-Z])_?|_?Set(?![a-z])_?")
"""Part of a name for readings after a set pulse; the name for readings after a reset pulse has ``reset`` there."""


def polarities(names: Sequence[str]) -> dict[int, int]:
    """Place of an axis after a reset pulse, by its place after a set pulse; only axes that have both.

    >>> polarities(["t", "mag_x_set", "mag_x_reset", "setpoint_x"]), polarities(["xReset", "xSet"])
    ({1: 2}, {1: 0})
    """
    places = {name.strip().casefold(): place for place, name in enumerate(names)}
    others = (
        (place, SET_WORD.sub(_reset, name.strip()).casefold())
        for place, name in enumerate(names)
        if SET_WORD.search(name)
    )
    return {place: places[other] for place, other in others if other in places}


def strip_set(name: str) -> str:
    """The name without the word ``set``.

    >>> strip_set("mx_set_uT"), strip_set("mag_x_set"), strip_set("xSet"), strip_set("Set X")
    ('mx_uT', 'mag_x', 'x', ' X')
    """
    return SET_WORD.sub(lambda match: "_" if len(match[0].strip("_")) == len(match[0]) - 2 else "", name)


def _reset(match: re.Match[str]) -> str:
    """Replacement of the word ``set`` in a name: ``reset``."""
    return re.sub("set", "reset", match[0], flags=re.IGNORECASE)


def names_magnetometer(names: Sequence[str]) -> bool:
    """Whether three of the names are the axes of a magnetometer."""
    return bool(vectors(names, list(map(meaning, names)), FIELD))


def magnetometers(names: Sequence[str]) -> tuple[Vector, ...]:
    """Find the separate magnetometers among the columns with these names."""
    return instruments(vectors(names, list(map(meaning, names)), FIELD))


def instruments(sensors: Sequence[Vector]) -> tuple[Vector, ...]:
    """Select the separate magnetometers and the rawest readings of each, in the order of their columns.

    Corrected or filtered readings come last. If it is unclear whether there are several magnetometers, only the best
    one by `_quality` is selected. The result is empty if there are no readings.
    """
    readings = [vector for vector in sensors if not vector.instead]
    if any(source_rank(vector.whole) == 0 and vector.rank < CALIBRATED_RANK for vector in readings):
        readings = [
            vector for vector in readings if vector.label or source_rank(vector.whole) < 2
        ]  # a modelled field next to it
    readings = [vector for vector in readings if clearness(vector.rank) < BARE_CLEARNESS] or readings
    if not readings:
        return ()
    kinds: dict[tuple[str, ...], Vector] = {}
    for vector in sorted(readings, key=_quality):
        kinds.setdefault(vector.label, vector)
    rawer = [kind for kind in kinds.values() if kind.rank < CALIBRATED_RANK]
    several = _distinct_sensors([kind for kind in kinds.values() if not _is_copy(kind, rawer)])
    ordered = sorted(several, key=lambda vector: (vector.rank >= CALIBRATED_RANK, min(vector.cells)))
    return tuple(ordered) or (min(readings, key=_quality),)


def similar_names(sensors: Sequence[Vector], fields: Sequence[Vector]) -> tuple[str, ...]:
    """Names of sensors that resemble a magnetometer as much as the selected ones do, with their kind if known."""
    least = max(BARE_CLEARNESS - 1, max((clearness(each.rank) for each in fields), default=0))
    others = [each for each in sensors if each not in fields and clearness(each.rank) <= least]
    kinds = [(each.whole, each.instead or "corrected or filtered" * (each.rank >= CALIBRATED_RANK)) for each in others]
    return tuple(f"{whole} ({what})" if what else whole for whole, what in kinds)


def companion(sensors: Sequence[Vector], field: Vector, fields: Sequence[Vector]) -> Vector | None:
    """Accelerometer or gyro of a magnetometer: the best with its number, else without another magnetometer's number.

    If there is only one magnetometer, it has all of them. Derived columns, such as ``acc_ned_x``, are not selected.
    """
    readings = [each for each in sensors if not each.instead]
    if len(fields) < 2:
        return min(readings, key=_quality, default=None)
    numbers = {other.number for other in fields}
    fitting = [each for each in readings if each.number == field.number or each.number not in numbers]
    return min(fitting, key=lambda each: (each.number != field.number, *_quality(each)), default=None)


def _distinct_sensors(sensors: Sequence[Vector]) -> list[Vector]:
    """Select sensors that are distinguished by numbers or places, or else by letters or types that all of them have."""
    shared = set.intersection(*(set(each.label) for each in sensors)) if sensors else set()
    rest = [(each, [word for word in each.label if word not in shared]) for each in sensors]
    numbers = {int(word) for _, words in rest for word in words if _is_number(word)}

    folders = {each.name.partition(".")[0] for each in sensors}  # ``1423.Magnetometer``

    def counts(word: str) -> bool:
        is_sensors = bool(shared) or word in folders
        return identifies_sensor(word) or (_is_number(word) and (is_sensors or _is_sensor_number(numbers, int(word))))

    counted = [each for each, words in rest if all(map(counts, words))]
    if len(counted) > 1:
        return counted
    is_lettered = _are_consecutive(words[0] if len(words) == 1 else "" for _, words in rest)
    is_typed = all(any(map(_is_number, words)) and not _is_number(words[0]) for _, words in rest if words)
    has_words = len(rest) > 1 and all(words for _, words in rest)
    return list(sensors) if has_words and (is_lettered or is_typed) else []


def _are_consecutive(letters: Iterable[str]) -> bool:
    """Whether letters are consecutive, such as a, b and c; left and right count as consecutive too."""
    together = "".join(sorted(letters))
    return together == "lr" or (len(together) > 1 and together in "abcdefgh")


def _is_number(word: str) -> bool:
    """Whether a word is a number with a plausible count of digits."""
    return word.isdecimal() and len(word) <= MAX_DIGITS


def _is_sensor_number(numbers: set[int], number: int) -> bool:
    """Whether a number can be that of a sensor: it is small, or a neighbouring number exists too."""
    return number < MIN_PAIRED_NUMBER or bool(numbers & {number - 1, number + 1})


def _is_copy(one: Vector, rawer: Sequence[Vector]) -> bool:
    """Whether corrected or filtered readings are a copy of rawer ones: with the same name, or with an unusual label.

    Next to ``mag2``, ``mag1_cal`` is another magnetometer; ``mag2_cal`` and ``mag_cal`` are copies.
    """
    if one.rank < CALIBRATED_RANK or not rawer:
        return False
    manner = set(map(_is_number, one.label))  # kind of words in the label: numbers, other words, both or none
    is_named_after = any(set(other.label) <= set(one.label) for other in rawer)
    return is_named_after or all(set(map(_is_number, other.label)) != manner for other in rawer)


def _quality(vector: Vector) -> tuple[int, int, bool, int, int, int]:
    """Sort key, the best first: the rawest; a sensor before a field, m before b; then the fewest additional words.

    The letter b ranks lower as it may stand for a bias.
    """
    foreign = sum(not (_is_number(word) or identifies_sensor(word)) for word in vector.label)
    is_symbol = vector.name.casefold() in ("b", "h")
    return vector.rank, source_rank(vector.whole), is_symbol, foreign, len(vector.label), min(vector.cells)
