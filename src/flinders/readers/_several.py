"""Which columns of a table are magnetometers of their own, and which are one magnetometer more than once.

A table may hold ``mag1_x`` and ``mag2_x``, two instruments, or ``mag_raw_x`` and ``mag_cal_x``, one before and after
its calibration. What is left of a name without axis, unit and the words that every magnetometer has tells them apart:
numbers (``imu2.mag.x``), places (``mag_left_x``), letters in a row (``mag_a_x``, ``mag_b_x``) and type numbers
(``mag_rm3100_x``) are instruments. Any other word, such as ``filtered`` or ``ned``, is the same instrument again: of
that the rawest is taken.

>>> from flinders.readers._names import FIELD, meaning
>>> def told(*sensors):
...     names = [f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"]
...     return [found.name for found in instruments(vectors(names, [meaning(name) for name in names], FIELD))]
>>> told("mag1", "mag2", "mag2_cal"), told("mag", "mag_raw", "mag_ned"), told("mag_left", "mag_right")
(['mag1', 'mag2'], ['mag'], ['mag_left', 'mag_right'])
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.readers._names import CALIBRATED, field_stem, label, sensor_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.readers._names import Meaning

PLACES: Final = frozenset(
    (
        "left", "right", "front", "rear", "back", "fore", "aft", "bow", "stern", "port", "starboard", "top", "bottom",
        "upper", "lower", "inner", "outer", "int", "ext", "internal", "external", "main", "aux", "primary", "secondary",
        "backup", "master", "slave", "first", "second", "third",
    )
)  # fmt: skip
"""Words that say which of several sensors it is."""


class Vector(NamedTuple):
    """Three columns of one sensor.

    Attributes
    ----------
    cells : tuple of int
        Their places; x, y, z.
    rank : int
        As in `Meaning`.
    label : tuple of str
        The words of their names that are not those of any such sensor.
    name : str
        What they are called, without axis and unit.
    """

    cells: tuple[int, ...]
    rank: int
    label: tuple[str, ...]
    name: str

    @property
    def number(self) -> tuple[str, ...]:
        """The numbers and places of its label; all of it where it has none."""
        return tuple(word for word in self.label if _counts(word)) or self.label


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
            name = " ".join((sensor_name(first, letters[0]), *again))
            made.append(Vector(cells, meanings[cells[0]].rank, (*label(first), *again), name))
    return sorted(made, key=lambda vector: min(vector.cells))


def instruments(found: Sequence[Vector]) -> tuple[Vector, ...]:
    """Pick those that are magnetometers of their own, in the order of the columns; of each the rawest.

    Parameters
    ----------
    found : sequence of Vector
        Of one kind, as `vectors` finds them.

    Returns
    -------
    tuple of Vector
        Just the best where it is not clear that there are several: the smallest rank, then the first.
    """
    if not found:
        return ()
    clearest = min(map(_clearness, found))
    kinds: dict[tuple[str, ...], Vector] = {}
    for vector in sorted(found, key=_quality):
        if _clearness(vector) == clearest:
            kinds.setdefault(vector.label, vector)
    alike = [kind for kind in kinds.values() if not any(_is_made_of(kind, other) for other in kinds.values())]
    several = _told_apart(alike)
    return tuple(sorted(several, key=lambda vector: min(vector.cells))) or (min(found, key=_quality),)


def companion(found: Sequence[Vector], field: Vector, fields: Sequence[Vector]) -> Vector | None:
    """Pick the accelerometer or gyro that goes with one of several magnetometers.

    It has the magnetometer's number, or none that another one of them has.

    >>> first, second = Vector((0, 1, 2), 1, ("1",), "mag1"), Vector((3, 4, 5), 1, ("2",), "mag2")
    >>> own, all_ones = Vector((6, 7, 8), 1, ("2",), "acc2"), Vector((9, 10, 11), 1, (), "acc")
    >>> companion([own, all_ones], first, [first, second]).name
    'acc'
    >>> companion([own, all_ones], second, [first, second]).name
    'acc2'
    """
    numbers = {other.number for other in fields}
    fitting = [each for each in found if each.number == field.number or each.number not in numbers]
    return min(fitting, key=lambda each: (each.number != field.number, *_quality(each)), default=None)


def _told_apart(found: Sequence[Vector]) -> list[Vector]:
    """Pick two or more whose labels are numbers, places or nothing; else letters or type numbers, if all are."""
    shared = set.intersection(*(set(each.label) for each in found)) if found else set()
    rest = [(each, [word for word in each.label if word not in shared]) for each in found]
    counted = [each for each, words in rest if all(map(_counts, words))]
    if len(counted) > 1:
        return counted
    is_lettered = _in_a_row(words[0] if len(words) == 1 else "" for _, words in rest)
    is_typed = all(any(map(str.isdigit, words)) and not words[0].isdigit() for _, words in rest if words)
    has_words = len(rest) > 1 and all(words for _, words in rest)
    return list(found) if has_words and (is_lettered or is_typed) else []


def _in_a_row(letters: Iterable[str]) -> bool:
    """Tell whether these are a, b, c and so on, or left and right.

    >>> _in_a_row("ab"), _in_a_row("rl"), _in_a_row("rc")
    (True, True, False)
    """
    together = "".join(sorted(letters))
    return together == "lr" or (len(together) > 1 and "abcdefgh".startswith(together))


def _counts(word: str) -> bool:
    return word.isdigit() or word in PLACES


def _is_made_of(one: Vector, other: Vector) -> bool:
    """Tell whether one is what was made of the other: corrected, and named after it."""
    is_corrected = one.rank >= CALIBRATED > other.rank
    return is_corrected and set(other.label) <= set(one.label)


def _clearness(vector: Vector) -> int:
    """How plainly its names say that it is a magnetometer: ``mag_x``, then ``mx``, then ``x``."""
    return vector.rank % CALIBRATED // 2


def _quality(vector: Vector) -> tuple[int, int]:
    return vector.rank, min(vector.cells)
