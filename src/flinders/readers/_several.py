"""Which columns of a table are magnetometers of their own, and which are one magnetometer more than once.

A table may hold ``mag1_x`` and ``mag2_x``, two instruments, or ``mag_raw_x`` and ``mag_cal_x``, one before and after
its calibration. What is left of a name without axis, unit and the words that every magnetometer has tells them apart:
numbers (``imu2.mag.x``), places (``mag_left_x``), chips (``rm3100_x``), a device (``imu_mx``) and letters in a row
(``mag_a_x``, ``mag_b_x``) are instruments. Any other word, such as ``filtered``, is the same instrument again: of that
the rawest is taken, and of equals the one with the plainest name. A reference, ``mag_ref_x``, is no instrument at all.

>>> def told(*sensors):
...     return [each.name for each in magnetometers([f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"])]
>>> told("mag1", "mag2", "mag2_cal"), told("mag", "mag_raw", "mag_ned"), told("mag_left", "mag_right")
(['mag1', 'mag2'], ['mag'], ['mag_left', 'mag_right'])
>>> told("mag", "imu_mag"), told("lis3mdl", "mpu6050", "rm3100_raw"), told("mag", "mag_lis3mdl_cal")
(['mag', 'imu_mag'], ['lis3mdl', 'rm3100'], ['mag'])
>>> told("mag_ref", "mag"), told("mag_filtered", "mag_main"), told("mag_t0", "mag_t1"), told("mag_ref")
(['mag'], ['mag_main'], ['mag_t0'], [])
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.readers._names import (
    BARE,
    CALIBRATED,
    FIELD,
    clearness,
    field_stem,
    label,
    meaning,
    no_readings,
    sensor_name,
    tells_apart,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.readers._names import Meaning

SMALL: Final = 10  # a bare number from here on is a sensor's where its neighbour is there: they count from 0 or 1 on
LONGEST: Final = 9  # digits of a number; what is longer is a word


class Vector(NamedTuple):
    """Three columns of one sensor."""

    cells: tuple[int, ...]  # their places: x, y, z
    rank: int  # as in `Meaning`
    label: tuple[str, ...]  # words of their names that are not those of any such sensor
    name: str  # what they are called, without axis and unit
    whole: str = ""  # the same with ``raw``, ``filtered`` and the unit: tells it from a copy of its readings
    instead: str = ""  # what they are, such as ``a reference``, where they are not a sensor's readings

    @property
    def number(self) -> tuple[str, ...]:
        """The numbers and places of its label; all of it where it has none."""
        return tuple(word for word in self.label if _is_number(word) or tells_apart(word)) or self.label


def vectors(names: Sequence[str], meanings: Sequence[Meaning], kind: str) -> list[Vector]:
    """Find the columns of a kind that make three axes, in the order of the first; a name may stand there again."""
    sensors: dict[tuple[str, int], dict[str, int]] = defaultdict(dict)
    times: Counter[str] = Counter()
    for place, found in enumerate(meanings):
        if found.kind == kind and found.axis:
            name = names[place].strip().casefold()
            times[name] += 1
            sensors[field_stem(name, found.axis), times[name]][found.axis] = place
    made = []
    for (_, time), axes in sensors.items():
        letters = next((letters for letters in ("xyz", "012", "123") if set(letters) <= axes.keys()), "")
        if letters:
            cells = tuple(axes[letter] for letter in letters)
            first, again = names[cells[0]], (str(time),) if time > 1 else ()
            name, whole = (" ".join((sensor_name(first, letters[0], whole=each), *again)) for each in (False, True))
            marks = (*label(first), *again)
            made.append(Vector(cells, meanings[cells[0]].rank, marks, name, whole, no_readings(first)))
    return sorted(made, key=lambda vector: min(vector.cells))


def magnetometers(names: Sequence[str]) -> tuple[Vector, ...]:
    """Find the magnetometers of their own among the columns of these names."""
    return instruments(vectors(names, list(map(meaning, names)), FIELD))


def instruments(found: Sequence[Vector]) -> tuple[Vector, ...]:
    """Pick those that are magnetometers of their own, of each the rawest, in the order of their columns.

    Those that were corrected or filtered come last. Just the best, by `_quality`, where it is not clear that there are
    several; none without readings.
    """
    readings = [vector for vector in found if not vector.instead]
    readings = [vector for vector in readings if clearness(vector.rank) < BARE] or readings
    if not readings:
        return ()
    kinds: dict[tuple[str, ...], Vector] = {}
    for vector in sorted(readings, key=_quality):
        kinds.setdefault(vector.label, vector)
    rawer = [kind for kind in kinds.values() if kind.rank < CALIBRATED]
    several = _told_apart([kind for kind in kinds.values() if not _is_copy(kind, rawer)])
    ordered = sorted(several, key=lambda vector: (vector.rank >= CALIBRATED, min(vector.cells)))
    return tuple(ordered) or (min(readings, key=_quality),)


def passed_over(found: Sequence[Vector], fields: Sequence[Vector]) -> tuple[str, ...]:
    """Name those that are as plainly a magnetometer's as those that are taken, and what they are where that is clear.

    >>> mag, copy = Vector((0, 1, 2), 1, (), "mag", "mag"), Vector((3, 4, 5), 11, (), "mag", "mag_cal")
    >>> passed_over([mag, copy, Vector((6, 7, 8), 1, ("ref",), "mag_ref", "mag_ref", "a reference")], [mag])
    ('mag_cal (corrected or filtered)', 'mag_ref (a reference)')
    """
    least = max(BARE - 1, max((clearness(each.rank) for each in fields), default=0))
    others = [each for each in found if each not in fields and clearness(each.rank) <= least]
    told = [(each.whole, each.instead or "corrected or filtered" * (each.rank >= CALIBRATED)) for each in others]
    return tuple(f"{whole} ({what})" if what else whole for whole, what in told)


def beside(found: Sequence[Vector], field: Vector, fields: Sequence[Vector]) -> Vector | None:
    """Pick the accelerometer or gyro that goes with a magnetometer: the best of its number, or with no other's number.

    Where there is one magnetometer all go with it. What is no readings, such as ``acc_ned_x``, is not taken.

    >>> first, second = Vector((0, 1, 2), 1, ("1",), "mag1"), Vector((3, 4, 5), 1, ("2",), "mag2")
    >>> own, all_ones = Vector((6, 7, 8), 1, ("2",), "acc2"), Vector((9, 10, 11), 1, (), "acc")
    >>> beside([own, all_ones], first, [first, second]).name, beside([own, all_ones], second, [first, second]).name
    ('acc', 'acc2')
    """
    readings = [each for each in found if not each.instead]
    if len(fields) < 2:
        return min(readings, key=_quality, default=None)
    numbers = {other.number for other in fields}
    fitting = [each for each in readings if each.number == field.number or each.number not in numbers]
    return min(fitting, key=lambda each: (each.number != field.number, *_quality(each)), default=None)


def _told_apart(found: Sequence[Vector]) -> list[Vector]:
    """Pick two or more whose labels are numbers, places or nothing; else letters or type numbers, if all are."""
    shared = set.intersection(*(set(each.label) for each in found)) if found else set()
    rest = [(each, [word for word in each.label if word not in shared]) for each in found]
    numbers = {int(word) for _, words in rest for word in words if _is_number(word)}

    def counts(word: str) -> bool:
        return tells_apart(word) or (_is_number(word) and (bool(shared) or _is_one_of(numbers, int(word))))

    counted = [each for each, words in rest if all(map(counts, words))]
    if len(counted) > 1:
        return counted
    is_lettered = _in_a_row(words[0] if len(words) == 1 else "" for _, words in rest)
    is_typed = all(any(map(_is_number, words)) and not _is_number(words[0]) for _, words in rest if words)
    has_words = len(rest) > 1 and all(words for _, words in rest)
    return list(found) if has_words and (is_lettered or is_typed) else []


def _in_a_row(letters: Iterable[str]) -> bool:
    """Tell whether these are a, b, c and so on, or left and right.

    >>> _in_a_row("ab"), _in_a_row("rl"), _in_a_row("rc")
    (True, True, False)
    """
    together = "".join(sorted(letters))
    return together == "lr" or (len(together) > 1 and "abcdefgh".startswith(together))


def _is_number(word: str) -> bool:
    """Tell whether a word is a number of usual length."""
    return word.isdecimal() and len(word) <= LONGEST


def _is_one_of(numbers: set[int], number: int) -> bool:
    """Tell whether a number is that of a sensor: a small one, or one in a row.

    >>> _is_one_of({1, 3}, 3), _is_one_of({11, 12}, 12), _is_one_of({25, 50}, 25)
    (True, True, False)
    """
    return number < SMALL or bool(numbers & {number - 1, number + 1})


def _is_copy(one: Vector, rawer: Sequence[Vector]) -> bool:
    """Tell whether corrected or filtered readings are those of a rawer one: named after it, or in another way than all.

    Beside ``mag2`` a ``mag1_cal`` is another magnetometer; ``mag2_cal`` is not, nor is ``mag_cal``.
    """
    if one.rank < CALIBRATED or not rawer:
        return False
    manner = set(map(_is_number, one.label))  # by numbers, by words, by both or not at all
    is_named_after = any(set(other.label) <= set(one.label) for other in rawer)
    return is_named_after or all(set(map(_is_number, other.label)) != manner for other in rawer)


def _quality(vector: Vector) -> tuple[int, int, int, int]:
    """Sort the best first: the rawest, then the one whose name says least besides."""
    foreign = sum(not (_is_number(word) or tells_apart(word)) for word in vector.label)
    return vector.rank, foreign, len(vector.label), min(vector.cells)
