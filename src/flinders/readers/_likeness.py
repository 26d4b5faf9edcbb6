"""What columns are by their values, where their names say nothing: proposed to the user, and never taken.

A quaternion has length 1, gravity 9.8 m/s² or 1 g; readings of a magnetometer lie near a sphere, off its middle by the
hard iron; rates and angles near none.

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
from flinders.core.units import unit_of_the_earth
from flinders.errors import figures, with_hint

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.errors import Hint

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
SURE: Final = 100  # rows that noise would not let an axis rise through
EVEN: Final = 0.5  # of the usual step of a clock or a counter, by which most others differ at most
BALL: Final = 0.75  # radius of a sphere, of the range of an axis, that most of it was seen of
HALF_AS_WIDE: Final = 0.5  # range of an axis that a spiral rises along, of that of another
MOSTLY: Final = 0.9  # share of its steps
FALLING: Final = 0.1  # share of its steps in which an axis reads less than before
FEWEST: Final = 10  # rows from which on lengths are judged
MANY: Final = 400  # rows that are enough
WIDEST: Final = 200  # columns that are judged
SELDOM: Final = 0.05  # share of rows in which a state changes, or a bias
FAR_LESS: Final = 3.0  # times the scatter of the roundest from which on others are no magnetometer
FLAT: Final = 0.2  # narrowest spread of vectors in all directions, of the widest
SAME: Final = 0.005  # of a length, by which a column that is it differs
UNKNOWNS: Final = 9  # of an ellipsoid
FEW: Final = 12  # different numbers below which they tell no step
MANY_DECIMALS: Final = 4  # from which on numbers of one sensor may have more or fewer
LARGEST_WRITTEN: Final = 1e9  # whose decimals tell nothing
MOST_PARTS: Final = 12  # threes and ones that columns are cut into every way
MOST_OTHERS: Final = 12  # groups that a message names beside those that may be it


class ColumnGroup(NamedTuple):
    """Columns that belong together, and what they may be."""

    names: tuple[str, ...]  # as `columns` takes them
    what: str  # what their values look like
    is_candidate: bool = False  # they may be a magnetometer
    is_known: bool = False  # they are plainly something else: a quaternion, a direction, gravity

    def __str__(self) -> str:
        return f"{', '.join(self.names)} ({self.what})"

    @property
    def columns(self) -> str:
        """The argument that names these as the magnetometer's."""
        return ",".join(self.names)


def groups(values: Floats, free: Iterable[int], names: Sequence[str] = ()) -> list[ColumnGroup]:
    """Judge nameless columns by their first rows, three or four at a time; empty for few rows or many columns.

    Three in a row start anywhere; what is nearest to a sphere is taken first, and shares no column with another.
    """
    values = np.where(np.abs(values) < LARGEST, values, np.nan)
    places = [place for place in free if np.isfinite(values[:, place]).mean() >= 0.5] if len(values) >= FEWEST else []
    if not 3 <= len(places) <= WIDEST:
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
        if what := _alone(values[:, place], is_three=is_three):
            judged.append(((place,), ColumnGroup((), what)))
            places.remove(place)
    for place in [place for place in places if not is_three and _is_strength(values, place, places)]:
        judged.append(((place,), ColumnGroup((), "a strength")))
        places.remove(place)
    judged += _compared(values, [cells for run in _runs(places) for cells in _threes(values, run)])
    return [group._replace(names=tuple(called[cell] for cell in cells)) for cells, group in sorted(judged)]


def _compared(values: Floats, threes: Sequence[tuple[int, ...]]) -> list[tuple[tuple[int, ...], ColumnGroup]]:
    """Judge threes beside each other: where one may be a magnetometer, others are plainly none.

    Those that were not turned while it was, those that are gravity with a bias, and those far less round than it.
    """
    judged = [(cells, _judged(values[:, cells])) for cells in threes]
    able = {cells: _fit(values[:, cells]) for cells, group in judged if group.is_candidate}
    turned = {cells: fit for cells, fit in able.items() if fit.is_turned}
    others = {cells: "hardly changing" for cells, fit in able.items() if turned and np.isinf(fit.radius)}
    near = [cells for cells, fit in turned.items() if fit.scatter < ROUND_INDEED and _is_near_gravity(fit.radius)]
    if len(near) < len(turned):
        others |= dict.fromkeys(near, "gravity with a bias")
    roundest = min((fit.scatter for cells, fit in turned.items() if cells not in others), default=0.0)
    limit = max(ROUND_INDEED, FAR_LESS * roundest)
    others |= {cells: "rates or angles: near no sphere" for cells, fit in turned.items() if fit.scatter > limit}
    return [(cells, ColumnGroup((), others[cells]) if cells in others else group) for cells, group in judged]


def _is_near_gravity(radius: float) -> bool:
    return any(abs(radius / length - 1) < NEARLY for length in GRAVITY.values())


class _Fit(NamedTuple):
    """The sphere through three columns."""

    is_turned: bool  # it is no guess
    scatter: float  # around it, or the ellipsoid, of its size
    radius: float


def _fit(vectors: Floats) -> _Fit:
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    scatter, radius = _sphere(vectors)
    high = _lengths(vectors)[2]
    return _Fit(bool(radius < high), min(_scatter(vectors), scatter / min(radius, high)), radius)


def _scatter(vectors: Floats) -> float:
    """Scatter around the ellipsoid that is nearest, of its size: soft iron does not count; infinite without one."""
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


def _alone(column: Floats, *, is_three: bool) -> str:
    """Say what one column is that is no axis: a clock, a counter, a state; of three columns only what never changes."""
    values = column[np.isfinite(column)]
    steps = np.diff(values)
    if values.min() == values.max():
        return "constant"
    if ascends(values) or (not is_three and (not (steps < 0).any() or _begins_again(steps))):
        return "a clock or a counter"
    is_state = np.count_nonzero(steps) <= SELDOM * len(steps) or not (steps > 0).any()
    return "seldom changing" if is_state and not is_three else ""


def is_no_axis(column: Floats) -> bool:
    """Tell whether a column can be no axis beside others that can: words, a clock, a counter or a constant."""
    column = np.where(np.abs(column) < LARGEST, column, np.nan)
    return bool(np.isfinite(column).mean() < 0.5 or len(column) < FEWEST or _alone(column, is_three=False))


def fits_beside(values: Floats, places: Sequence[tuple[int, ...]]) -> tuple[int, ...] | None:
    """Pick the three columns that are a magnetometer, of several of which one is; None where that is open."""
    judged = {cells: _roundness(values[:, cells]) for cells in places if len(cells) == 3}
    turned = {cells: fit for cells, fit in judged.items() if fit and _judged(values[:, cells]).is_candidate}
    if len(turned) == 1:
        return next(iter(turned))
    alike = [cells for cells in places if _is_alike(values[:, cells])]
    return alike[0] if len(alike) == 1 and not turned else None


def _is_strength(values: Floats, place: int, places: Sequence[int]) -> bool:
    """Tell whether a column is the length of three others in a row."""
    column = values[:, place]
    starts = [start for start in places if {start + 1, start + 2} <= set(places) and not start <= place <= start + 2]
    lengths = (np.linalg.norm(values[:, start : start + 3], axis=1) for start in starts)
    return any(np.nanmedian(np.abs(length - column)) < SAME * np.nanmedian(length) for length in lengths)


def _begins_again(steps: Floats) -> bool:
    """Tell whether a clock or a counter begins again and again: it rises by even steps, and falls by larger ones."""
    rising, falling = steps[steps > 0], -steps[steps < 0]
    if not len(rising) or len(falling) >= len(rising):
        return False
    usual = float(np.median(rising))
    is_even = np.mean(np.abs(rising - usual) <= EVEN * usual) >= MOSTLY
    return bool(is_even and (falling > (1 + EVEN) * usual).all())


def likeness(vectors: Floats) -> str:
    """Say what three columns plainly are if not a magnetometer: a direction, or gravity; else nothing."""
    group = _judged(vectors[:: max(len(vectors) // MANY, 1)])
    return group.what if group.is_known else ""


def doubt(samples: Samples) -> str:
    """Say what samples plainly are if not a magnetometer's, where nobody says that they are; else nothing."""
    if not samples.nameless or not len(samples):
        return ""
    return likeness(samples.field / samples.unit.scale)


def looks_like(what: str, spelled: str) -> str:
    """Say what columns look like, and with which argument, as an interface spells it, they are a magnetometer's."""
    return with_hint(f"these look like {what}: if a magnetometer recorded them after all, name them", spelled)


XYZ: Final = {"columns": "X,Y,Z"}
"""Hint that names three columns, whichever they are."""


def advice(judged: Sequence[ColumnGroup]) -> tuple[str, Hint]:
    """Say which columns may be the magnetometer and what the others look like, with a hint that names the columns."""
    able = [group for group in judged if group.is_candidate]
    rest = [str(group) for group in judged if not group.is_candidate]
    others = ", ".join(rest[:MOST_OTHERS] + ["…"] * (len(rest) > MOST_OTHERS))
    if not able:
        return f"by their values none may be it, they are {others}; if three are after all, say which", XYZ
    do = "if so, name them" if len(able) == 1 else "say which, such as the first"
    besides = f", others are {others}" * bool(others)
    return f"by their values {' or '.join(map(str, able))} may be it{besides}: {do}", {"columns": able[0].columns}


def ascends(values: Floats) -> bool:
    """Tell whether a column only ever grows, as a clock or a counter does."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def only_rises(values: Floats) -> bool:
    """Tell whether a column rises from row to row, through so many as only a clock or a counter does."""
    values = values[np.abs(values) < LARGEST]
    return len(values) >= SURE and ascends(values)


def has_clock(vectors: Floats) -> bool:
    """Tell whether the first of three columns only rise, as no axis does, while the others go to and fro.

    Those of a spiral over a sphere may rise too.
    """
    rising = [only_rises(column) for column in vectors.T]
    finite = vectors[np.isfinite(vectors).all(axis=1)]
    falling = (finite[1:] < finite[:-1]).sum(axis=0) > FALLING * len(finite)
    is_beside = all(rises or falls for rises, falls in zip(rising, falling.tolist(), strict=True))
    if not is_beside or rising not in ([True, False, False], [True, True, False]):
        return False
    scatter, radius = _sphere(finite)
    wide = np.ptp(finite, axis=0)
    is_ball = radius < BALL * wide[2] and scatter < ROUND_INDEED * radius
    return not is_ball or bool(wide[0] < HALF_AS_WIDE * wide[2])


def _quaternions(values: Floats, places: Sequence[int], *, may_rest: bool) -> Iterator[tuple[int, ...]]:
    """Find four columns in a row whose length is 1, and that change; one of them may stay 1 if they `may_rest`."""
    after = 0
    for at in range(len(places) - 3):
        cells = tuple(places[at : at + 4])
        if at >= after and cells[3] - cells[0] == 3 and _changes(values[:, cells], may_rest):
            four = values[:, cells]
            low, _, high = _lengths(four[np.isfinite(four).all(axis=1)])
            if low > 1 - EXACT and high < 1 + EXACT:
                after = at + 4
                yield cells


def _changes(four: Floats, may_rest: bool) -> bool:
    """Tell whether four columns change as parts of a quaternion; a field in tesla beside a column of 1 does not."""
    low, high = np.nanmin(four, axis=0), np.nanmax(four, axis=0)
    is_one = (low == high) & (np.abs(low) > 1 - EXACT)
    return bool((low < high).any() and (may_rest or not is_one.any()))


def _runs(places: Sequence[int]) -> Iterator[list[int]]:
    """Cut places where one is missing between."""
    for _, run in groupby(enumerate(places), lambda each: each[1] - each[0]):
        yield [place for _, place in run]


def _threes(values: Floats, run: Sequence[int]) -> list[tuple[int, ...]]:
    """Cut columns in a row into threes: first those that are nearest to a sphere, wherever they start."""
    starts = [tuple(run[at : at + 3]) for at in range(len(run) - 2)]
    round_ones = [(fit, cells) for cells in starts if (fit := _roundness(values[:, cells])) is not None]
    if not round_ones:
        return _triples(values, run)
    _, best = min(round_ones)
    at = run.index(best[0])
    return [*_threes(values, run[:at]), best, *_threes(values, run[at + 3 :])]


def _roundness(vectors: Floats) -> tuple[bool, bool, float] | None:
    """How near to a sphere three columns are that were turned: known and alike ones first; None for others.

    Columns that are written in different ways are of one sensor only where they fill a sphere in all directions.
    """
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    group = _judged(vectors)
    if not (group.is_candidate or group.is_known) or not (fit := _fit(vectors)).is_turned:
        return None
    is_alike = _is_alike(vectors)
    wide, middle, narrow = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False)
    is_line = middle < FLAT * wide  # which is near any large sphere
    if is_line or (not is_alike and (narrow < FLAT * wide or fit.scatter > ROUND_INDEED)):
        return None
    return not group.is_known, not is_alike, fit.scatter


def _is_alike(vectors: Floats) -> bool:
    """Tell whether columns are written alike, as axes of one sensor are."""
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    decimals, steps = zip(*map(_written, vectors.T), strict=True)
    return len(set(decimals)) == 1 and len(set(steps) - {0}) < 2


def _written(values: Floats) -> tuple[int, int]:
    """How numbers are written: decimals, and the step between them in the last one, 0 for few different numbers."""
    distinct = np.unique(values).tolist()
    decimals = max(len(f"{value!r}.".split(".")[1].removesuffix("0")) for value in distinct)
    if decimals >= MANY_DECIMALS or max(map(abs, distinct)) >= LARGEST_WRITTEN:
        return MANY_DECIMALS, 1
    whole = [round(value * 10**decimals) for value in distinct]
    return decimals, math.gcd(*(value - whole[0] for value in whole)) if len(whole) >= FEW else 0


def _triples(values: Floats, run: Sequence[int]) -> list[tuple[int, ...]]:
    """Cut columns in a row into threes; where some are over, so that each three have values of like size."""
    count, over = divmod(len(run), 3)
    if count + over > MOST_PARTS:
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


def is_numeric(values: Floats) -> bool:
    """Tell whether at least half of the first values are numbers."""
    return len(values) == 0 or bool(np.isfinite(values).mean() >= 0.5)


def without_numbers(values: Floats) -> str:
    """Say why a column cannot be used of which most of the first values are no numbers."""
    return "numbers in few rows" if np.isfinite(values).any() else "not numbers"
