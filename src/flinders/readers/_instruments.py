"""Which columns of a table are a magnetometer of their own: by their names, and by the lengths of their vectors.

A table may hold ``mag1_x`` and ``mag2_x``, two instruments, or ``mag_raw_x`` and ``mag_cal_x``, one before and after
its calibration. What is left of a name without axis, unit and the words that every magnetometer has tells them apart:
numbers (``imu2.mag.x``), places (``mag_left_x``), chips (``rm3100_x``), a device (``imu_mx``) and letters in a row
(``mag_a_x``, ``mag_b_x``) are instruments. Any other word, such as ``filtered``, is the same instrument again: of that
the rawest is taken, and of equals the one with the plainest name. A reference, ``mag_ref_x``, is no instrument at all.

>>> def names(*sensors):
...     return [each.name for each in magnetometers([f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"])]
>>> names("mag1", "mag2", "mag2_cal"), names("mag", "mag_raw", "mag_ned"), names("mag_left", "mag_right")
(['mag1', 'mag2'], ['mag'], ['mag_left', 'mag_right'])
>>> names("mag", "imu_mag"), names("lis3mdl", "mpu6050", "rm3100_raw"), names("mag", "mag_lis3mdl_cal")
(['mag', 'imu_mag'], ['lis3mdl', 'rm3100'], ['mag'])
>>> names("mag_ref", "mag"), names("mag_filtered", "mag_main"), names("mag_t0", "mag_t1"), names("b", "m")
(['mag'], ['mag_main'], ['mag_t0'], ['m'])

Of columns whose names say nothing the values are judged, which is proposed to the user and never taken: a quaternion
has length 1, gravity 9.8 m/s² or 1 g; readings of a magnetometer lie near a sphere, off its middle by the hard iron;
rates and angles near none.

>>> turned = np.random.default_rng(1).normal(size=(200, 3))
>>> directions = turned / np.linalg.norm(turned, axis=1, keepdims=True)
>>> clock = np.arange(200.0)
>>> judged = groups(np.column_stack([clock, 9.81 * directions, turned, 48 * directions + [30, 0, -20]]), range(10))
>>> for group in judged:
...     print(group)
1 (a clock or a counter)
2, 3, 4 (gravity in m/s²)
5, 6, 7 (rates or angles: near no sphere)
8, 9, 10 (lengths 27.9 to 82.3, strength 48.0, as uT the earth's)
"""

from __future__ import annotations

import shlex
from collections import Counter, defaultdict
from itertools import combinations, groupby
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.units import unit_of_the_earth
from flinders.errors import figures
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
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.readers._names import Meaning

FEW: Final = 10  # a bare number from here on is a sensor's where its neighbour is there: they count from 0 or 1 on
LONGEST: Final = 9  # digits of a number; what is longer is a word
GRAVITY: Final = {  # its length in units of accelerometers; fewer counts than these could be milligauss
    "m/s²": 9.80665, "g": 1.0, "mg": 1000.0, **{f"counts of 1/{2**n} g": float(2**n) for n in range(10, 15)}
}  # fmt: skip
SMALL: Final = 20.0  # below it a magnetometer reads in gauss or tesla; above it gravity has a sphere of its size too
EXACT: Final = 0.02  # what the length of a unit vector may differ by
NEARLY: Final = 0.06  # what the median length of gravity may differ by, of an accelerometer that is not calibrated
STEADY: Final = 0.3  # spread of most lengths of gravity, of their median, while a hand turns the sensor
UNMOVED: Final = 0.1  # scatter, of their length, of readings that were not turned; a sphere through them tells nothing
ROUND: Final = 0.2  # scatter of a magnetometer's readings around the nearest sphere, of its radius, with soft iron
ROUND_INDEED: Final = 0.05  # so little scatter that readings near zero are no sign of rates
IN_NO_UNIT: Final = (2.0, 15.0)  # more than the earth's field in gauss, hard iron and all, and less than in µT
NEAR_ZERO: Final = 0.15  # of the longest readings: what is near zero, where rates often are
LARGEST: Final = 1e100  # what a reading may be, so that its square is a number
FEWEST: Final = 10  # rows from which on lengths are judged
MANY: Final = 400  # rows that are enough
WIDEST: Final = 24  # columns that are judged; a wider table would fill the screen


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
    for place, known in enumerate(meanings):
        if known.kind == kind and known.axis:
            name = names[place].strip().casefold()
            times[name] += 1
            sensors[field_stem(name, known.axis), times[name]][known.axis] = place
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


def instruments(sensors: Sequence[Vector]) -> tuple[Vector, ...]:
    """Pick those that are magnetometers of their own, of each the rawest, in the order of their columns.

    Those that were corrected or filtered come last. Just the best, by `_quality`, where it is not clear that there are
    several; none without readings.
    """
    readings = [vector for vector in sensors if not vector.instead]
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


def passed_over(sensors: Sequence[Vector], fields: Sequence[Vector]) -> tuple[str, ...]:
    """Name those that are as plainly a magnetometer's as those that are taken, and what they are where that is clear.

    >>> mag, copy = Vector((0, 1, 2), 1, (), "mag", "mag"), Vector((3, 4, 5), 11, (), "mag", "mag_cal")
    >>> passed_over([mag, copy, Vector((6, 7, 8), 1, ("ref",), "mag_ref", "mag_ref", "a reference")], [mag])
    ('mag_cal (corrected or filtered)', 'mag_ref (a reference)')
    """
    least = max(BARE - 1, max((clearness(each.rank) for each in fields), default=0))
    others = [each for each in sensors if each not in fields and clearness(each.rank) <= least]
    kinds = [(each.whole, each.instead or "corrected or filtered" * (each.rank >= CALIBRATED)) for each in others]
    return tuple(f"{whole} ({what})" if what else whole for whole, what in kinds)


def companion(sensors: Sequence[Vector], field: Vector, fields: Sequence[Vector]) -> Vector | None:
    """Pick the accelerometer or gyro that goes with a magnetometer: the best of its number, or with no other's number.

    Where there is one magnetometer all go with it. What is no readings, such as ``acc_ned_x``, is not taken.

    >>> first, second = Vector((0, 1, 2), 1, ("1",), "mag1"), Vector((3, 4, 5), 1, ("2",), "mag2")
    >>> own, all_ones = Vector((6, 7, 8), 1, ("2",), "acc2"), Vector((9, 10, 11), 1, (), "acc")
    >>> [companion([own, all_ones], each, [first, second]).name for each in (first, second)]
    ['acc', 'acc2']
    """
    readings = [each for each in sensors if not each.instead]
    if len(fields) < 2:
        return min(readings, key=_quality, default=None)
    numbers = {other.number for other in fields}
    fitting = [each for each in readings if each.number == field.number or each.number not in numbers]
    return min(fitting, key=lambda each: (each.number != field.number, *_quality(each)), default=None)


def _told_apart(sensors: Sequence[Vector]) -> list[Vector]:
    """Pick two or more whose labels are numbers, places or nothing; else letters or type numbers, if all are."""
    shared = set.intersection(*(set(each.label) for each in sensors)) if sensors else set()
    rest = [(each, [word for word in each.label if word not in shared]) for each in sensors]
    numbers = {int(word) for _, words in rest for word in words if _is_number(word)}

    def counts(word: str) -> bool:
        return tells_apart(word) or (_is_number(word) and (bool(shared) or _is_one_of(numbers, int(word))))

    counted = [each for each, words in rest if all(map(counts, words))]
    if len(counted) > 1:
        return counted
    is_lettered = _in_a_row(words[0] if len(words) == 1 else "" for _, words in rest)
    is_typed = all(any(map(_is_number, words)) and not _is_number(words[0]) for _, words in rest if words)
    has_words = len(rest) > 1 and all(words for _, words in rest)
    return list(sensors) if has_words and (is_lettered or is_typed) else []


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
    return number < FEW or bool(numbers & {number - 1, number + 1})


def _is_copy(one: Vector, rawer: Sequence[Vector]) -> bool:
    """Tell whether corrected or filtered readings are those of a rawer one: named after it, or in another way than all.

    Beside ``mag2`` a ``mag1_cal`` is another magnetometer; ``mag2_cal`` is not, nor is ``mag_cal``.
    """
    if one.rank < CALIBRATED or not rawer:
        return False
    manner = set(map(_is_number, one.label))  # by numbers, by words, by both or not at all
    is_named_after = any(set(other.label) <= set(one.label) for other in rawer)
    return is_named_after or all(set(map(_is_number, other.label)) != manner for other in rawer)


def _quality(vector: Vector) -> tuple[int, bool, int, int, int]:
    """Sort the best first: the rawest, m before b, which may be a bias, then the one whose name says least besides."""
    foreign = sum(not (_is_number(word) or tells_apart(word)) for word in vector.label)
    is_symbol = vector.name.casefold() in ("b", "h")
    return vector.rank, is_symbol, foreign, len(vector.label), min(vector.cells)


class ColumnGroup(NamedTuple):
    """Columns that belong together, and what they may be."""

    names: tuple[str, ...]  # as ``--columns`` takes them
    what: str  # what their values look like
    is_candidate: bool = False  # they may be a magnetometer
    is_known: bool = False  # they are plainly something else: a quaternion, a direction, gravity

    def __str__(self) -> str:
        return f"{', '.join(self.names)} ({self.what})"

    @property
    def option(self) -> str:
        """What says that these are the magnetometer."""
        return f"--columns {shlex.quote(','.join(self.names))}"


def groups(values: Floats, free: Iterable[int], names: Sequence[str] = ()) -> list[ColumnGroup]:
    """Judge nameless columns by their first rows, three or four at a time; empty for few rows or many columns."""
    values = np.where(np.abs(values) < LARGEST, values, np.nan)
    places = [place for place in free if np.isfinite(values[:, place]).mean() >= 0.5] if len(values) >= FEWEST else []
    if not 3 <= len(places) <= WIDEST:
        return []
    own = [names[place].strip() for place in places] if names else []
    is_named = all(own) and len(set(own)) == len(places) and not any("," in name for name in own)
    called = {place: own[at] if is_named else str(place + 1) for at, place in enumerate(places)}
    judged: list[tuple[tuple[int, ...], ColumnGroup]] = []
    for cells in _quaternions(values, places):
        judged.append((cells, ColumnGroup((), "a quaternion", is_known=True)))
        places = [place for place in places if place not in cells]
    for place in list(places):
        is_clock = ascends(values[:, place])
        if is_clock or np.nanmin(values[:, place]) == np.nanmax(values[:, place]):
            judged.append(((place,), ColumnGroup((), "a clock or a counter" if is_clock else "constant")))
            places.remove(place)
    judged += [(cells, _judged(values[:, cells])) for run in _runs(places) for cells in _triples(values, run)]
    return [group._replace(names=tuple(called[cell] for cell in cells)) for cells, group in sorted(judged)]


def likeness(vectors: Floats) -> str:
    """Say what three columns plainly are if not a magnetometer: a direction, or gravity; else nothing."""
    group = _judged(vectors[:: max(len(vectors) // MANY, 1)])
    return group.what if group.is_known else ""


def advice(judged: Sequence[ColumnGroup]) -> str:
    """Say which columns may be the magnetometer, what to type then, and what the others look like."""
    able = [group for group in judged if group.is_candidate]
    others = ", ".join(str(group) for group in judged if not group.is_candidate)
    if not able:
        return f"by their values none may be it, they are {others}; if three are after all, say so with --columns X,Y,Z"
    options = " or ".join(group.option for group in able)
    do = f"if so, add {options}" if len(able) == 1 else f"say which with {options}"
    return f"by their values {' or '.join(map(str, able))} may be it: {do}" + f"; others are {others}" * bool(others)


def ascends(values: Floats) -> bool:
    """Tell whether a column only ever grows, as a clock or a counter does."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def _quaternions(values: Floats, places: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Find four columns in a row whose length is 1, and that change."""
    after = 0
    for at in range(len(places) - 3):
        cells = tuple(places[at : at + 4])
        if at >= after and cells[3] - cells[0] == 3 and np.nanmax(np.nanstd(values[:, cells], axis=0)) > 0:
            four = values[:, cells]
            low, _, high = _lengths(four[np.isfinite(four).all(axis=1)])
            if low > 1 - EXACT and high < 1 + EXACT:
                after = at + 4
                yield cells


def _runs(places: Sequence[int]) -> Iterator[list[int]]:
    """Cut places where one is missing between."""
    for _, run in groupby(enumerate(places), lambda each: each[1] - each[0]):
        yield [place for _, place in run]


def _triples(values: Floats, run: Sequence[int]) -> list[tuple[int, ...]]:
    """Cut columns in a row into threes; where some are over, so that each three have values of like size."""
    count, over = divmod(len(run), 3)
    sizes = np.nanpercentile(np.abs(values[:, run]), 95, axis=0)
    cuts = []
    for alone in combinations(range(count + over), over):
        starts = np.cumsum([0, *(1 if part in alone else 3 for part in range(count + over))])
        threes = [slice(start, start + 3) for part, start in enumerate(starts[:-1].tolist()) if part not in alone]
        unlike = sum(float(sizes[each].max() / max(sizes[each].min(), 1e-300)) for each in threes)
        cuts.append((unlike, [tuple(run[each]) for each in threes]))
    return min(cuts)[1]


def _lengths(vectors: Floats) -> tuple[float, float, float]:
    """Lengths between which nine in ten of them lie, and the middle one between the two."""
    low, middle, high = np.percentile(np.linalg.norm(vectors, axis=1), [5, 50, 95]).tolist()
    return low, middle, high


def _judged(vectors: Floats) -> ColumnGroup:
    """Say what three columns may be; their names are not known here."""
    vectors = vectors[(np.abs(vectors) < LARGEST).all(axis=1)]
    if len(vectors) < FEWEST:
        return ColumnGroup((), "seldom all there")
    low, middle, high = _lengths(vectors)
    scatter, radius = _sphere(vectors)
    is_turned = radius < high  # a larger sphere is a guess from a small arc
    size = min(radius, high)
    if low > 1 - EXACT and high < 1 + EXACT:
        return ColumnGroup((), "a direction, or gravity in g", is_known=True)
    for name, length in GRAVITY.items():
        is_near = abs(middle / length - 1) < NEARLY and high - low < STEADY * middle
        if is_near and (length < SMALL or abs(radius / length - 1) < NEARLY):
            return ColumnGroup((), f"gravity in {name}", is_known=True)
    is_often_short = low < NEAR_ZERO * high and scatter > ROUND_INDEED * size
    if scatter > ROUND * size or is_often_short:
        return ColumnGroup((), "rates or angles: near no sphere")
    strength = radius if is_turned else middle
    if min(strength, middle) > IN_NO_UNIT[0] and max(strength, middle) < IN_NO_UNIT[1]:
        return ColumnGroup((), f"lengths of {figures(middle, 3)}, which the earth's field has in no unit")
    unit = unit_of_the_earth(strength)
    parts = [f"lengths {figures(low, 3)} to {figures(high, 3)}"]
    parts += [f"strength {figures(strength, 3)}"] * is_turned + [f"as {unit} the earth's"] * bool(unit)
    return ColumnGroup((), ", ".join(parts), is_candidate=True)


def _sphere(vectors: Floats) -> tuple[float, float]:
    """Scatter around the sphere that is nearest to them, and its radius; infinite where they were not turned."""
    middle = vectors.mean(axis=0)
    size = float(np.linalg.norm(vectors.std(axis=0)))
    if size <= UNMOVED * np.linalg.norm(middle):
        return 0.0, np.inf
    scaled = (vectors - middle) / size
    squares = (scaled**2).sum(axis=1)
    centre, *_ = np.linalg.lstsq(np.column_stack([2 * scaled, np.ones(len(scaled))]), squares)
    lengths = np.linalg.norm(scaled - centre[:3], axis=1)
    return float(lengths.std()) * size, float(lengths.mean()) * size
