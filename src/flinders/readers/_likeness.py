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

from itertools import combinations, groupby
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.units import unit_of_the_earth
from flinders.errors import figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats

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
MOSTLY: Final = 0.9  # share of its steps
FALLING: Final = 0.1  # share of its steps in which an axis reads less than before
FEWEST: Final = 10  # rows from which on lengths are judged
MANY: Final = 400  # rows that are enough
WIDEST: Final = 24  # columns that are judged; a wider table would fill the screen


class ColumnGroup(NamedTuple):
    """Columns that belong together, and what they may be."""

    names: tuple[str, ...]  # as `columns` takes them
    what: str  # what their values look like
    is_candidate: bool = False  # they may be a magnetometer
    is_known: bool = False  # they are plainly something else: a quaternion, a direction, gravity

    def __str__(self) -> str:
        return f"{', '.join(self.names)} ({self.what})"

    @property
    def option(self) -> str:
        """What says that these are the magnetometer."""
        return f"columns={','.join(self.names)!r}"


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
        return f"by their values none may be it, they are {others}; if three are after all, say so with columns='X,Y,Z'"
    options = " or ".join(group.option for group in able)
    do = f"if so, add {options}" if len(able) == 1 else f"say which with {options}"
    return f"by their values {' or '.join(map(str, able))} may be it: {do}" + f"; others are {others}" * bool(others)


def ascends(values: Floats) -> bool:
    """Tell whether a column only ever grows, as a clock or a counter does."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def only_rises(values: Floats) -> bool:
    """Tell whether a column rises from row to row as only a clock or a counter does: often, or by even steps."""
    values = values[np.abs(values) < LARGEST]
    if len(values) < FEWEST or not ascends(values):
        return False
    steps = np.diff(values)
    usual = np.median(steps)
    return len(values) >= SURE or bool(np.mean(np.abs(steps - usual) <= EVEN * usual) >= MOSTLY)


def has_clock(vectors: Floats) -> bool:
    """Tell whether some of three columns only rise, as no axis does, while the others go to and fro."""
    rising = [only_rises(column) for column in vectors.T]
    finite = vectors[np.isfinite(vectors).all(axis=1)]
    falling = (finite[1:] < finite[:-1]).sum(axis=0) > FALLING * len(finite)
    return len(set(rising)) == 2 and all(rises or falls for rises, falls in zip(rising, falling.tolist(), strict=True))


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
