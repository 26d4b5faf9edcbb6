"""The answer for many units, column by column, and the one call that makes it.

Units go through the fast lane together; those that leave it are fitted by `flinders.fit` one by one. So the numbers are
those of the single command, whichever way a unit went.

>>> from flinders import simulate
>>> tumbles = [simulate.tumble(seed=seed, n=500, motion="uniform").samples for seed in range(3)]
>>> found = fit_stack([*tumbles, tumbles[0][:5]])
>>> found, found.code.tolist()
(BatchColumns(3 good, 1 refused; 3 of 4 on the batch path), ['', '', '', 'too-few-samples'])
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.samples import Samples
from flinders.diagnostics.unmodelled import unmodelled_of
from flinders.errors import FitError, FlindersError, UsageError
from flinders.fitting import calibrate
from flinders.fitting.result import Fit, Refused
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.stacked.lane import MOST, UPPER, Lane, through
from flinders.stacked.stack import Lined, Stack
from flinders.stacked.surfaces import DOUBTFUL
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.findings import Severity

AT_A_TIME: Final = 512
"""Units that go through the lane together: enough to make each call cheap, few enough to need little memory."""

ALIKE: Final = 1.25
"""Length of the longest unit of a stack over that of its shortest, at most: what is filled up costs as readings do."""

WIDTHS: Final = {"offset": 3, "matrix": 9, "covariance": 45}
"""Columns of so many numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchColumns:
    """What came of U units: the columns of the table of a fleet that a fit fills, NaN where it gives no number.

    Attributes
    ----------
    readings, used : (U,) int
        Those there are, and those that the fit used.
    verdict, code, message, method : (U,) str
        ``good``, ``limited``, ``refused`` or ``failed``; code and message of the error of the last two.
    worst_deg, rms_deg, dip_deg : (U,) float
        Heading error of a level vehicle, 1 σ, where the field dips by `dip_deg`.
    offset, matrix, covariance : (U, 3), (U, 9), (U, 45) float, in `unit_of_field`
        Of the calibration; the upper triangle of the covariance of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), row by row.
    noise, radius : (U,) float, in `unit_of_field`
    coverage : (U,) float
        Share of the sphere that was seen.
    findings : (U,) tuple of str
        Their codes, the gravest first.
    unit_of_field : (U,) str
    through : (U,) bool
        It came through the fast lane.
    """

    readings: NDArray[np.int64]
    used: NDArray[np.int64]
    verdict: NDArray[np.object_]
    code: NDArray[np.object_]
    message: NDArray[np.object_]
    method: NDArray[np.object_]
    worst_deg: Floats
    rms_deg: Floats
    dip_deg: Floats
    offset: Floats
    matrix: Floats
    covariance: Floats
    noise: Floats
    radius: Floats
    coverage: Floats
    findings: NDArray[np.object_]
    unit_of_field: NDArray[np.object_]
    through: NDArray[np.bool_]

    @classmethod
    def empty(cls, units: int) -> Self:
        """Nothing known yet."""
        columns: dict[str, Any] = {}
        for each in dataclasses.fields(cls):
            kind = str(each.type)
            if kind == "Floats":
                columns[each.name] = np.full((units, WIDTHS[each.name]) if each.name in WIDTHS else units, np.nan)
            elif "object" in kind:
                columns[each.name] = np.full(units, "", dtype=object)
            else:
                columns[each.name] = np.zeros(units, dtype=bool if "bool" in kind else np.int64)
        return cls(**columns)

    def __len__(self) -> int:
        return len(self.used)

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{many} {verdict}" for verdict, many in sorted(Counter(self.verdict.tolist()).items()))
        return f"BatchColumns({verdicts}; {int(self.through.sum())} of {len(self)} on the batch path)"


def fit_stack(
    units: Sequence[Samples] | Lined | Stack, *, target_deg: float = 1.0, dip_deg: float = 60.0, polish: bool = True
) -> BatchColumns:
    """Fit and judge many units at once, each as `flinders.fit` would by itself.

    Parameters
    ----------
    units : sequence of Samples, Lined or Stack
        The readings of each.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float
        Inclination of the field at the site.
    polish : bool
        Go through the readings a second time; without, the answer is that of `flinders.fit` to their summaries:
        faster, and less accurate where coverage is partial.

    Returns
    -------
    BatchColumns
        In the order given. A unit that gives no calibration is a row with its error.

    Raises
    ------
    UsageError
        For a target that is not positive, or within a degree of the magnetic poles.
    UnitError, ArrayError
        See `Stack.of`.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    columns = BatchColumns.empty(len(units))
    has_disturbances = polish and _have_drivers(units)
    for places, stack in _stacks(units):
        with np.errstate(all="ignore"):  # what is no number in one unit of a stack takes that unit out of the lane
            try:
                lane = through(stack, target_deg=target_deg, dip_deg=dip_deg, polish=polish)
            except np.linalg.LinAlgError:  # and where a matrix of one has no answer at all, the stack
                continue
        if has_disturbances:
            came = places[np.asarray(lane.at)].tolist()
            lane = lane.only(_unmoved(lane, [units[place] for place in came], dip_deg))
        _fill(columns, places[np.asarray(lane.at)], lane, stack.unit.inside)
    for place in np.flatnonzero(~columns.through).tolist():
        one = units[place]
        found = _alone(one, polish=polish, target_deg=target_deg, dip_deg=dip_deg)
        _fill_one(columns, place, found, one)
    if isinstance(units, Stack):
        columns.readings[:] = units.counts
    return columns


def _stacks(units: Sequence[Samples] | Lined | Stack) -> Iterator[tuple[NDArray[np.intp], Stack]]:
    """Cut units into stacks of like length and unit, with their places; those that no lane takes are left out."""
    if isinstance(units, Stack):
        if units.axes.is_mirror:
            return
        for begin in range(0, len(units), AT_A_TIME):
            cut = slice(begin, begin + AT_A_TIME)
            time = None if units.time is None else units.time[cut]
            part = Stack(units.readings[cut, ...], units.counts[cut], units.unit, units.axes, time)
            yield np.arange(begin, begin + len(part)), part
        return
    if isinstance(units, Lined) and _is_plain(units.whole):
        for alike in _of_like_length(np.arange(len(units)), units.counts):
            yield from ((places, units.stack(places)) for places in _at_a_time(alike))
        return
    for alike in _alike(units):
        yield from ((places, Stack.of([units[place] for place in places.tolist()])) for places in _at_a_time(alike))


def _at_a_time(places: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Cut places into those of units that go through the lane together."""
    yield from (places[begin : begin + AT_A_TIME] for begin in range(0, len(places), AT_A_TIME))


def _alike(units: Sequence[Samples] | Lined) -> Iterator[NDArray[np.intp]]:
    """Places of units that go into one stack, in order of length."""
    groups: dict[tuple[str, bool], list[int]] = {}
    for place, one in enumerate(units):
        if type(one) is Samples and _is_plain(one):
            groups.setdefault((one.unit.inside, one.time is None), []).append(place)
    for members in groups.values():
        lengths = np.array([len(units[place]) for place in members])
        yield from _of_like_length(np.array(members, dtype=np.intp), lengths)


def _of_like_length(members: NDArray[np.intp], lengths: NDArray[np.int64]) -> Iterator[NDArray[np.intp]]:
    """Places of those of K `members` with (K,) `lengths` that go into one stack, in order of length."""
    order = np.argsort(lengths, kind="stable")
    order = order[(lengths[order] > 0) & (lengths[order] <= MOST)]
    while len(order):
        many = int(np.searchsorted(lengths[order], ALIKE * lengths[order[0]], side="right"))
        yield members[order[:many]]
        order = order[many:]


def _have_drivers(units: Sequence[Samples] | Lined | Stack) -> bool:
    """Whether something was recorded beside readings that may move them."""
    if isinstance(units, Lined):
        return bool(units.whole.disturbances)
    return not isinstance(units, Stack) and any(one.disturbances for one in units)


def _unmoved(lane: Lane, sources: Sequence[Samples], dip_deg: float) -> NDArray[np.intp]:
    """Which of the units that came through have readings that follow nothing that was recorded beside them.

    Residuals that hang together let a disturbance explain less: a few that `flinders.fit` would leave in peace leave
    the stack, too.
    """
    columns = zip(*(np.asarray(lane.numbers[name]) for name in ("offset", "matrix", "radius")), strict=True)
    kept = []
    for place, (one, (offset, matrix, radius)) in enumerate(zip(sources, columns, strict=True)):
        surface = Ellipsoid(offset, radius * np.linalg.inv(matrix.reshape(3, 3))) if one.disturbances else None
        if surface is None or unmodelled_of(one, surface, dip_deg=dip_deg, time=1.0 - DOUBTFUL) is None:
            kept.append(place)
    return np.array(kept, dtype=np.intp)


def _fill(columns: BatchColumns, places: NDArray[np.intp], lane: Lane, inside: str) -> None:
    """Write down what came through the lane."""
    if not len(places):
        return
    for name, numbers in lane.numbers.items():
        getattr(columns, name)[places] = np.asarray(numbers)
    columns.readings[places] = np.asarray(lane.numbers["used"])
    columns.method[places] = lane.method
    columns.unit_of_field[places] = inside
    columns.through[places] = True
    columns.findings[places], columns.verdict[places] = _named(lane.findings)


def _named(findings: Mapping[tuple[str, Severity], Any]) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
    """(K,) tuples of codes, the gravest first, and (K,) verdicts; units alike share theirs."""
    there = np.stack([np.asarray(each) for each in findings.values()], axis=1)
    limits = np.array([severity == "limits" for _, severity in findings])
    kinds, kind = np.unique(there @ (1 << np.arange(len(limits))), return_inverse=True)
    first = np.zeros(len(kinds), np.intp)
    first[kind] = np.arange(len(kind))
    named, verdicts = np.empty(len(kinds), dtype=object), np.empty(len(kinds), dtype=object)
    for place, row in enumerate(there[first]):
        named[place] = tuple(code for (code, _), is_there in zip(findings, row, strict=True) if is_there)
        verdicts[place] = "limited" if (row & limits).any() else "good"
    return named[kind], verdicts[kind]


def _is_plain(one: Samples) -> bool:
    """Whether nothing beside the readings and their times has a say in the fit."""
    return one.strength is None and not one.skipped and not one.axes.is_mirror


def _alone(one: Samples, *, polish: bool, target_deg: float, dip_deg: float) -> Fit | Exception:
    """What `flinders.fit` makes of one unit: a fit, or the error that it raises."""
    try:
        if polish:
            return calibrate.fit(one, target_deg=target_deg, dip_deg=dip_deg)
        return calibrate.fit(Summary.of(one), target_deg=target_deg, dip_deg=dip_deg, unit=one.unit, axes=one.axes)
    except UsageError:
        raise
    except Refused as error:
        return error.fit
    except Exception as error:  # noqa: BLE001 - a unit that fails is a row, and never the end of the others
        return error


def _described(error: Exception) -> tuple[str, str, str]:
    """Verdict, code and message of a unit that gives no fit."""
    if isinstance(error, FlindersError):
        return "refused" if isinstance(error, FitError) else "failed", error.code, str(error)
    return "failed", "internal", f"{type(error).__name__}: {error}; this is a fault in Flinders, report it"


def _fill_one(columns: BatchColumns, place: int, found: Fit | Exception, one: Samples) -> None:
    """Write down what became of a unit by itself."""
    columns.readings[place], columns.unit_of_field[place] = len(one), one.unit.inside
    if not isinstance(found, Fit):
        columns.findings[place] = ()
        columns.verdict[place], columns.code[place], columns.message[place] = _described(found)
        return
    error, findings = found.heading_error_deg, found.findings
    columns.verdict[place], columns.method[place], columns.used[place] = found.verdict, found.method, found.samples
    columns.worst_deg[place], columns.rms_deg[place], columns.dip_deg[place] = error.worst, error.rms, error.dip_deg
    columns.noise[place], columns.coverage[place] = found.noise, found.coverage.fraction
    columns.findings[place] = tuple(finding.code for finding in findings)
    if found.verdict == "refused":
        columns.code[place], columns.message[place] = Refused.code, findings[0].advice
        return
    columns.offset[place], columns.radius[place] = found.calibration.offset, found.calibration.field_strength
    columns.matrix[place] = found.calibration.matrix.ravel()
    columns.covariance[place] = found.covariance.ravel()[UPPER]
