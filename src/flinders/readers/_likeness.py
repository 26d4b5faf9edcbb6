"""Likely kinds of unnamed columns, judged by their values: suggested to the user, never applied.

A quaternion has length 1, gravity 9.8 m/s² or 1 g. Magnetometer readings lie near a sphere whose centre is displaced by
the hard iron; rates and angles lie near no sphere.

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

import math
from itertools import combinations, groupby
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.samples import Samples
from flinders.core.units import earth_field_unit
from flinders.errors import append_hint, figures

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.errors import Hint

GRAVITY: Final = {  # length of gravity in units of accelerometers; smaller counts per g could be milligauss
    "m/s²": 9.80665, "g": 1.0, "mg": 1000.0, **{f"counts of 1/{2**n} g": float(2**n) for n in range(10, 15)}
}  # fmt: skip
# length below which readings are in gauss or tesla; above it, gravity too must lie on a sphere of its size
MAX_GAUSS_LENGTH: Final = 20.0
UNIT_LENGTH_TOLERANCE: Final = 0.02  # largest deviation of a unit vector's length from 1
# largest relative deviation of the median length of gravity, for an accelerometer without calibration
GRAVITY_TOLERANCE: Final = 0.06
MAX_GRAVITY_SPREAD: Final = 0.3  # largest spread of gravity's lengths in a turn by hand, relative to their median
# scatter of readings without rotation, relative to their length; a sphere through them has no meaning
MAX_SCATTER_AT_REST: Final = 0.1
# largest scatter of a magnetometer around the best sphere, relative to its radius, with soft iron
MAX_SCATTER: Final = 0.2
MAX_ROUND_SCATTER: Final = 0.05  # scatter below which readings near zero do not indicate rates
LENGTHS_OF_NO_UNIT: Final = (2.0, 15.0)  # lengths between the earth's field in gauss, with hard iron, and in µT
MAX_SHARE_NEAR_ZERO: Final = 0.15  # limit of "near zero", relative to the longest readings; rates are often near zero
MAX_READING: Final = 1e100  # largest reading whose square is finite
MIN_RISING_ROWS: Final = 100  # rows after which noise interrupts the rise of any axis
STEP_TOLERANCE: Final = 0.5  # largest deviation of the steps of a clock or counter, relative to their median
MAX_RADIUS_SHARE: Final = 0.75  # largest radius of a mostly covered sphere, relative to the range of an axis
MAX_RANGE_SHARE: Final = 0.5  # largest range of the rising axis of a spiral, relative to another axis
MIN_EVEN_SHARE: Final = 0.9  # share of even steps that a clock or counter needs
MIN_FALLING_SHARE: Final = 0.1  # smallest share of falling steps of an axis
MIN_ROWS: Final = 10  # smallest number of rows for judging lengths
JUDGED_ROWS: Final = 400  # number of rows that are enough
MAX_COLUMNS: Final = 200  # largest number of columns that are judged
MAX_CHANGE_SHARE: Final = 0.05  # largest share of rows in which a state, or a bias, changes
MAX_SCATTER_RATIO: Final = 3.0  # scatter relative to the roundest group above which another group is no magnetometer
MIN_SPREAD_RATIO: Final = 0.2  # smallest spread of vectors in all directions, relative to the widest
# largest relative difference between a column of strengths and the length of three others
STRENGTH_TOLERANCE: Final = 0.005
UNKNOWNS: Final = 9  # unknowns of an ellipsoid
MIN_DIFFERENT_NUMBERS: Final = 12  # count of different numbers below which their step is unknown
MAX_DECIMALS: Final = 4  # number of decimals from which the columns of one sensor may differ
MAX_EXACT_NUMBER: Final = 1e9  # size from which decimals carry no information
MAX_PARTS: Final = 12  # largest number of threes and single columns whose divisions are all tried
MAX_OTHERS: Final = 12  # largest number of groups in a message besides the candidates


class ColumnGroup(NamedTuple):
    """Columns that belong together, and their likely kind."""

    names: tuple[str, ...]  # as in the argument `columns`
    what: str  # description of their values
    is_candidate: bool = False  # they may be a magnetometer
    is_known: bool = False  # they are clearly another quantity: a quaternion, a direction, gravity

    def __str__(self) -> str:
        return f"{', '.join(self.names)} ({self.what})"

    @property
    def columns(self) -> str:
        """The argument that names these as the magnetometer's."""
        return ",".join(self.names)


def groups(values: Floats, free: Iterable[int], names: Sequence[str] = ()) -> list[ColumnGroup]:
    """Judge unnamed columns by their first rows, in groups of three or four; empty for few rows or many columns.

    A group of three may start at any column; the roundest is taken first, and groups do not overlap.
    """
    values = np.where(np.abs(values) < MAX_READING, values, np.nan)
    places = [place for place in free if np.isfinite(values[:, place]).mean() >= 0.5] if len(values) >= MIN_ROWS else []
    if not 3 <= len(places) <= MAX_COLUMNS:
        return []
    own = [names[place].strip() for place in places] if names else []
    is_named = all(own) and len(set(own)) == len(places) and not any("," in name for name in own)
    called = {place: own[at] if is_named else str(place + 1) for at, place in enumerate(places)}
    judged: list[tuple[tuple[int, ...], ColumnGroup]] = []
    for cells in _quaternions(values, places, may_rest=bool(names)):
        judged.append((cells, ColumnGroup((), "a quaternion", is_known=True)))
        places = [place for place in places if place not in cells]
    is_three = len(places) == 3
    for place in list(places):
        if what := _describe_column(values[:, place], is_three=is_three):
            judged.append(((place,), ColumnGroup((), what)))
            places.remove(place)
    for place in [place for place in places if not is_three and _is_strength(values, place, places)]:
        judged.append(((place,), ColumnGroup((), "a strength")))
        places.remove(place)
    judged += _judge_together(values, [cells for run in _runs(places) for cells in _split_by_roundness(values, run)])
    return [group._replace(names=tuple(called[cell] for cell in cells)) for cells, group in sorted(judged)]


def _judge_together(values: Floats, threes: Sequence[tuple[int, ...]]) -> list[tuple[tuple[int, ...], ColumnGroup]]:
    """Judge groups of three columns against each other.

    If one group may be a magnetometer, some others are excluded: groups that did not turn with it, gravity with a
    bias, and groups that are much less round.
    """
    judged = [(cells, _judge(values[:, cells])) for cells in threes]
    able = {cells: _fit(values[:, cells]) for cells, group in judged if group.is_candidate}
    turned = {cells: fit for cells, fit in able.items() if fit.is_turned}
    others = {cells: "hardly changing" for cells, fit in able.items() if turned and np.isinf(fit.radius)}
    near = [cells for cells, fit in turned.items() if fit.scatter < MAX_ROUND_SCATTER and _is_near_gravity(fit.radius)]
    if len(near) < len(turned):
        others |= dict.fromkeys(near, "gravity with a bias")
    roundest = min((fit.scatter for cells, fit in turned.items() if cells not in others), default=0.0)
    limit = max(MAX_ROUND_SCATTER, MAX_SCATTER_RATIO * roundest)
    others |= {cells: "rates or angles: near no sphere" for cells, fit in turned.items() if fit.scatter > limit}
    return [(cells, ColumnGroup((), others[cells]) if cells in others else group) for cells, group in judged]


def _is_near_gravity(radius: float) -> bool:
    return any(abs(radius / length - 1) < GRAVITY_TOLERANCE for length in GRAVITY.values())


class _Fit(NamedTuple):
    """The sphere through three columns."""

    is_turned: bool  # the sphere is well determined
    scatter: float  # around the sphere or ellipsoid, relative to its size
    radius: float


def _fit(vectors: Floats) -> _Fit:
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    scatter, radius = _sphere(vectors)
    high = _lengths(vectors)[2]
    return _Fit(bool(radius < high), min(_scatter(vectors), scatter / min(radius, high)), radius)


def _scatter(vectors: Floats) -> float:
    """Scatter around the best-fitting ellipsoid, relative to its size; infinite if there is no ellipsoid."""
    size = np.linalg.norm(vectors.std(axis=0))
    if len(vectors) <= 2 * UNKNOWNS or not size:
        return np.inf
    x, y, z = scaled = (vectors - vectors.mean(axis=0)).T / size
    terms = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z])
    a, b, c, d, e, f, *linear = np.linalg.lstsq(terms, np.ones(len(x)))[0].tolist()
    shape = np.array([[a, d, e], [d, b, f], [e, f, c]])
    if np.linalg.eigvalsh(shape).min() <= 0:
        return np.inf
    away = scaled - np.linalg.solve(shape, -np.array(linear))[:, np.newaxis]
    lengths = np.sqrt(np.einsum("ik,ij,jk->k", away, shape, away))
    return float(lengths.std() / lengths.mean())


def _describe_column(column: Floats, *, is_three: bool) -> str:
    """Describe one column that is no axis: a clock, a counter, a state; of exactly three columns, only a constant."""
    values = column[np.isfinite(column)]
    steps = np.diff(values)
    if values.min() == values.max():
        return "constant"
    if is_ascending(values) or (not is_three and (not (steps < 0).any() or _restarts(steps))):
        return "a clock or a counter"
    is_state = np.count_nonzero(steps) <= MAX_CHANGE_SHARE * len(steps) or not (steps > 0).any()
    return "seldom changing" if is_state and not is_three else ""


def is_no_axis(column: Floats) -> bool:
    """Tell whether a column cannot be an axis: words, a clock, a counter or a constant."""
    column = np.where(np.abs(column) < MAX_READING, column, np.nan)
    return bool(np.isfinite(column).mean() < 0.5 or len(column) < MIN_ROWS or _describe_column(column, is_three=False))


def choose_magnetometer(values: Floats, places: Sequence[tuple[int, ...]]) -> tuple[int, ...] | None:
    """The candidate group that is a magnetometer, if exactly one is; None if that is not clear."""
    judged = {cells: _roundness(values[:, cells]) for cells in places if len(cells) == 3}
    turned = {cells: fit for cells, fit in judged.items() if fit and _judge(values[:, cells]).is_candidate}
    if len(turned) == 1:
        return next(iter(turned))
    alike = [cells for cells in places if _is_alike(values[:, cells])]
    return alike[0] if len(alike) == 1 and not turned else None


def _is_strength(values: Floats, place: int, places: Sequence[int]) -> bool:
    """Tell whether a column is the length of three other adjacent columns."""
    column = values[:, place]
    starts = [start for start in places if {start + 1, start + 2} <= set(places) and not start <= place <= start + 2]
    lengths = (np.linalg.norm(values[:, start : start + 3], axis=1) for start in starts)
    return any(np.nanmedian(np.abs(length - column)) < STRENGTH_TOLERANCE * np.nanmedian(length) for length in lengths)


def _restarts(steps: Floats) -> bool:
    """Tell whether a clock or counter restarts repeatedly: it rises in even steps, and falls in larger ones."""
    rising, falling = steps[steps > 0], -steps[steps < 0]
    if not len(rising) or len(falling) >= len(rising):
        return False
    usual = float(np.median(rising))
    is_even = np.mean(np.abs(rising - usual) <= STEP_TOLERANCE * usual) >= MIN_EVEN_SHARE
    return bool(is_even and (falling > (1 + STEP_TOLERANCE) * usual).all())


def likeness(vectors: Floats) -> str:
    """Description of three columns that are clearly no magnetometer: a direction, or gravity; else empty."""
    group = _judge(vectors[:: max(len(vectors) // JUDGED_ROWS, 1)])
    return group.what if group.is_known else ""


def describe_doubt(samples: Samples) -> str:
    """Description of unnamed samples that are clearly no magnetometer's; else empty."""
    if not samples.nameless or not len(samples):
        return ""
    return likeness(samples.field / samples.unit.scale)


def looks_like(what: str, spelled: str) -> str:
    """Message with the likely kind of columns, and the argument that declares them a magnetometer."""
    return append_hint(f"these columns look like {what}: if they are a magnetometer's, name them", spelled)


XYZ: Final = {"columns": "X,Y,Z"}
"""Hint with a placeholder for three columns."""


def advice(judged: Sequence[ColumnGroup]) -> tuple[str, Hint]:
    """Message with the candidate groups and the other groups, and a hint that names the columns."""
    able = [group for group in judged if group.is_candidate]
    rest = [str(group) for group in judged if not group.is_candidate]
    others = ", ".join(rest[:MAX_OTHERS] + ["…"] * (len(rest) > MAX_OTHERS))
    if not able:
        return f"judged by their values, none is a magnetometer: {others}; if three are, name them", XYZ
    do = "if so, name them" if len(able) == 1 else "name one of them, such as the first"
    besides = f"; others: {others}" * bool(others)
    return f"judged by their values, columns {' or '.join(map(str, able))} may be the magnetometer{besides}; {do}", {
        "columns": able[0].columns
    }


def is_ascending(values: Floats) -> bool:
    """Tell whether a column strictly increases, as a clock or a counter does."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def only_rises(values: Floats) -> bool:
    """Tell whether a column strictly increases over so many rows that it is a clock or a counter."""
    values = values[np.abs(values) < MAX_READING]
    return len(values) >= MIN_RISING_ROWS and is_ascending(values)


def has_clock(vectors: Floats) -> bool:
    """Tell whether the first of three columns strictly increase, as no axis does, while the others do not.

    A spiral over a sphere also has a rising axis, and is recognised by its shape.
    """
    rising = [only_rises(column) for column in vectors.T]
    finite = vectors[np.isfinite(vectors).all(axis=1)]
    falling = (finite[1:] < finite[:-1]).sum(axis=0) > MIN_FALLING_SHARE * len(finite)
    is_beside = all(rises or falls for rises, falls in zip(rising, falling.tolist(), strict=True))
    if not is_beside or rising not in ([True, False, False], [True, True, False]):
        return False
    scatter, radius = _sphere(finite)
    wide = np.ptp(finite, axis=0)
    is_ball = radius < MAX_RADIUS_SHARE * wide[2] and scatter < MAX_ROUND_SCATTER * radius
    return not is_ball or bool(wide[0] < MAX_RANGE_SHARE * wide[2])


def _quaternions(values: Floats, places: Sequence[int], *, may_rest: bool) -> Iterator[tuple[int, ...]]:
    """Find four adjacent columns of length 1 that change; with `may_rest`, one may stay 1."""
    after = 0
    for at in range(len(places) - 3):
        cells = tuple(places[at : at + 4])
        if at >= after and cells[3] - cells[0] == 3 and _is_changing(values[:, cells], may_rest):
            four = values[:, cells]
            low, _, high = _lengths(four[np.isfinite(four).all(axis=1)])
            if low > 1 - UNIT_LENGTH_TOLERANCE and high < 1 + UNIT_LENGTH_TOLERANCE:
                after = at + 4
                yield cells


def _is_changing(four: Floats, may_rest: bool) -> bool:
    """Tell whether four columns change like a quaternion; a field in tesla next to a constant 1 does not."""
    low, high = np.nanmin(four, axis=0), np.nanmax(four, axis=0)
    is_one = (low == high) & (np.abs(low) > 1 - UNIT_LENGTH_TOLERANCE)
    return bool((low < high).any() and (may_rest or not is_one.any()))


def _runs(places: Sequence[int]) -> Iterator[list[int]]:
    """Split places into runs of adjacent ones."""
    for _, run in groupby(enumerate(places), lambda each: each[1] - each[0]):
        yield [place for _, place in run]


def _split_by_roundness(values: Floats, run: Sequence[int]) -> list[tuple[int, ...]]:
    """Split adjacent columns into threes, starting with the three that are nearest to a sphere."""
    starts = [tuple(run[at : at + 3]) for at in range(len(run) - 2)]
    round_ones = [(fit, cells) for cells in starts if (fit := _roundness(values[:, cells])) is not None]
    if not round_ones:
        return _split_by_size(values, run)
    _, best = min(round_ones)
    at = run.index(best[0])
    return [*_split_by_roundness(values, run[:at]), best, *_split_by_roundness(values, run[at + 3 :])]


def _roundness(vectors: Floats) -> tuple[bool, bool, float] | None:
    """Sort key of three columns that were turned, best first: known ones, same format, least scatter; else None.

    Columns with different number formats belong to one sensor only if they fill a sphere in all directions.
    """
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    group = _judge(vectors)
    if not (group.is_candidate or group.is_known) or not (fit := _fit(vectors)).is_turned:
        return None
    is_alike = _is_alike(vectors)
    wide, middle, narrow = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False)
    is_line = middle < MIN_SPREAD_RATIO * wide  # a line is near any large sphere
    if is_line or (not is_alike and (narrow < MIN_SPREAD_RATIO * wide or fit.scatter > MAX_ROUND_SCATTER)):
        return None
    return not group.is_known, not is_alike, fit.scatter


def _is_alike(vectors: Floats) -> bool:
    """Tell whether columns have the same number format, like the axes of one sensor."""
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    decimals, steps = zip(*map(_number_format, vectors.T), strict=True)
    return len(set(decimals)) == 1 and len(set(steps) - {0}) < 2


def _number_format(values: Floats) -> tuple[int, int]:
    """Number format: count of decimals, and the step in the last one, 0 for few different numbers."""
    distinct = np.unique(values).tolist()
    decimals = max(len(f"{value!r}.".split(".")[1].removesuffix("0")) for value in distinct)
    if decimals >= MAX_DECIMALS or max(map(abs, distinct)) >= MAX_EXACT_NUMBER:
        return MAX_DECIMALS, 1
    whole = [round(value * 10**decimals) for value in distinct]
    return decimals, math.gcd(*(value - whole[0] for value in whole)) if len(whole) >= MIN_DIFFERENT_NUMBERS else 0


def _split_by_size(values: Floats, run: Sequence[int]) -> list[tuple[int, ...]]:
    """Split adjacent columns into threes; surplus columns are skipped so that each three have similar sizes."""
    count, over = divmod(len(run), 3)
    if count + over > MAX_PARTS:
        return [tuple(run[at : at + 3]) for at in range(0, 3 * count, 3)]
    sizes = np.nanpercentile(np.abs(values[:, run]), 95, axis=0)
    cuts = []
    for alone in combinations(range(count + over), over):
        starts = np.cumsum([0, *(1 if part in alone else 3 for part in range(count + over))])
        threes = [slice(start, start + 3) for part, start in enumerate(starts[:-1].tolist()) if part not in alone]
        unlike = sum(float(sizes[each].max() / max(sizes[each].min(), 1e-300)) for each in threes)
        cuts.append((unlike, [tuple(run[each]) for each in threes]))
    return min(cuts)[1]


def _lengths(vectors: Floats) -> tuple[float, float, float]:
    """Lengths of vectors: the 5th, 50th and 95th percentile."""
    low, middle, high = np.percentile(np.linalg.norm(vectors, axis=1), [5, 50, 95]).tolist()
    return low, middle, high


def _judge(vectors: Floats) -> ColumnGroup:
    """Judge three columns by their values; the group has no names yet."""
    vectors = vectors[(np.abs(vectors) < MAX_READING).all(axis=1)]
    if len(vectors) < MIN_ROWS:
        return ColumnGroup((), "rarely complete")
    low, middle, high = _lengths(vectors)
    scatter, radius = _sphere(vectors)
    is_turned = radius < high  # a larger sphere is extrapolated from a small arc
    size = min(radius, high)
    if low > 1 - UNIT_LENGTH_TOLERANCE and high < 1 + UNIT_LENGTH_TOLERANCE:
        return ColumnGroup((), "a direction, or gravity in g", is_known=True)
    for name, length in GRAVITY.items():
        is_near = abs(middle / length - 1) < GRAVITY_TOLERANCE and high - low < MAX_GRAVITY_SPREAD * middle
        if is_near and (length < MAX_GAUSS_LENGTH or abs(radius / length - 1) < GRAVITY_TOLERANCE):
            return ColumnGroup((), f"gravity in {name}", is_known=True)
    is_often_short = low < MAX_SHARE_NEAR_ZERO * high and scatter > MAX_ROUND_SCATTER * size
    if scatter > MAX_SCATTER * size or is_often_short:
        return ColumnGroup((), "rates or angles: near no sphere")
    strength = radius if is_turned else middle
    if min(strength, middle) > LENGTHS_OF_NO_UNIT[0] and max(strength, middle) < LENGTHS_OF_NO_UNIT[1]:
        return ColumnGroup((), f"lengths of {figures(middle, 3)}, not the earth's field in any unit")
    unit = earth_field_unit(strength)
    parts = [f"lengths {figures(low, 3)} to {figures(high, 3)}"]
    parts += [f"strength {figures(strength, 3)}"] * is_turned + [f"as {unit} the earth's"] * bool(unit)
    return ColumnGroup((), ", ".join(parts), is_candidate=True)


def _sphere(vectors: Floats) -> tuple[float, float]:
    """Scatter around the best sphere, and its radius; an infinite radius if the vectors were not turned."""
    middle = vectors.mean(axis=0)
    size = float(np.linalg.norm(vectors.std(axis=0)))
    if size <= MAX_SCATTER_AT_REST * np.linalg.norm(middle):
        return 0.0, np.inf
    scaled = (vectors - middle) / size
    squares = (scaled**2).sum(axis=1)
    centre, *_ = np.linalg.lstsq(np.column_stack([2 * scaled, np.ones(len(scaled))]), squares)
    lengths = np.linalg.norm(scaled - centre[:3], axis=1)
    return float(lengths.std()) * size, float(lengths.mean()) * size


def is_numeric(values: Floats) -> bool:
    """Tell whether at least half of the values are numbers."""
    return len(values) == 0 or bool(np.isfinite(values).mean() >= 0.5)


def without_numbers(values: Floats) -> str:
    """Reason for leaving out a column whose values are mostly not numbers."""
    return "numbers in few rows" if np.isfinite(values).any() else "not numbers"
