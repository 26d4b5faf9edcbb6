"""Fits of many recordings: one call of the engine fits all of them, and a second call judges all of them.

The results are the numbers and findings of `flinders.fit`. A recording that needs more than the record of the engine,
such as a list of outliers, a level turn or the sentence of a limit, is fitted by `flinders.fit`.

>>> from flinders import simulate
>>> tumbles = [simulate.tumble(seed=seed, n=500, motion="uniform").samples for seed in range(3)]
>>> columns = fit_batch([*tumbles, tumbles[0][:5]])
>>> columns, columns.code.tolist()
(BatchColumns(3 good, 1 refused; 3 of 4 by their records), ['', '', '', 'too-few-samples'])
"""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.samples import Samples
from flinders.core.units import MICROTESLA
from flinders.diagnostics.unmodelled import unmodelled_of
from flinders.diagnostics.unmoved import was_turned
from flinders.errors import FitError, FlindersError, UsageError
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.rests import Rests
from flinders.estimators.robust import Robust
from flinders.findings import first_causes
from flinders.findings.catalogue import ENGINE_FINDINGS
from flinders.findings.rules import SEVERITIES
from flinders.fitting import calibrate
from flinders.fitting.record import ASKS_HALVES, ASKS_SWAP
from flinders.fitting.result import Fit, Refused
from flinders.fitting.verdict import headline_of
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.likelihood.site_field import Site
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records

UPPER_ENTRIES: Final = np.flatnonzero(np.triu(np.ones((9, 9))).ravel())
"""Indices of the 45 entries on and above the diagonal of a (9, 9) covariance, row by row."""

WIDTHS: Final = {"offset": 3, "matrix": 9, "covariance": 45}
"""Count of numbers per unit in columns with more than one."""

LIMITS, REFUSES = SEVERITIES.index("limits"), SEVERITIES.index("refuses")
"""Numbers of the severities in the engine."""


@dataclass(frozen=True, slots=True, eq=False)
class ConcatenatedRecordings:
    """Sequence of recordings that are stored one after the other in common columns, as in a table of a fleet.

    Each member is a `Samples`, which is created on access.

    Examples
    --------
    >>> lined = ConcatenatedRecordings(Samples.of(np.arange(18.0).reshape(6, 3)), np.array([2, 6]), ["A17", "B02"])
    >>> lined[1].source, len(lined[1])
    ('B02', 4)
    """

    whole: Samples  # the readings of all recordings
    ends: NDArray[np.int64]  # (U,) index after the last reading of each recording
    sources: Sequence[str]  # name of each recording, for messages

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, place: int) -> Samples:
        """The recording at `place`."""
        begin = int(self.ends[place - 1]) if place else 0
        return replace(self.whole[begin : int(self.ends[place])], source=self.sources[place])

    def __iter__(self) -> Iterator[Samples]:
        return (self[place] for place in range(len(self)))

    @property
    def counts(self) -> NDArray[np.int64]:
        """(U,) count of readings of each recording."""
        return np.diff(self.ends, prepend=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitColumns:
    """Columns with one row for each of U fits; NaN where a fit gives no number."""

    readings: NDArray[np.int64]  #: (U,): readings in the recording
    samples: NDArray[np.int64]  #: (U,): readings used by the fit
    verdict: NDArray[np.object_]  #: (U,) str: ``good``, ``limited``, ``refused`` or ``failed``
    code: NDArray[np.object_]  #: (U,) str: code of the error of a refused or failed fit
    #: (U,) str: code of the most severe finding, else of the error; empty for a good fit
    cause: NDArray[np.object_]
    message: NDArray[np.object_]  #: (U,) str: the first sentence of the verdict, with the remedy
    number: Floats  #: (U,): number of the finding in `cause`, NaN without a finding
    limit: Floats  #: (U,): limit of that number
    method: NDArray[np.object_]
    worst_deg: Floats  #: (U,): heading error at the worst heading of a level vehicle, 1 σ, at the dip `dip_deg`
    rms_deg: Floats  #: (U,): heading error of a level vehicle, 1 σ, rms over all headings
    bound_95_deg: Floats  #: (U,): heading error at all headings that is not exceeded with a probability of 95 %
    dip_deg: Floats  #: (U,): inclination of the field for these heading errors
    offset: Floats  #: (U, 3), in `unit_of_field`
    matrix: Floats  #: (U, 9): rows of the matrix
    covariance: Floats  #: (U, 45): upper triangle of `Claim.claimed_covariance`, row by row
    noise: Floats  #: (U,), in `unit_of_field`
    field_strength: Floats  #: (U,), in `unit_of_field`
    coverage: Floats  #: (U,): share of the sphere that readings cover
    findings: NDArray[np.object_]  #: (U,) tuple of str: codes of the findings, the most severe first
    unit_of_field: NDArray[np.object_]  #: (U,) str

    @classmethod
    def empty(cls, units: int) -> Self:
        """Create columns for `units` fits, without values."""
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
        return len(self.samples)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class BatchColumns(FitColumns):
    """Results of a batch of U units."""

    by_record: NDArray[np.bool_]  #: (U,): whether the unit was judged from its record, without a separate fit

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{many} {verdict}" for verdict, many in sorted(Counter(self.verdict.tolist()).items()))
        return f"BatchColumns({verdicts}; {int(self.by_record.sum())} of {len(self)} by their records)"


def fit_batch(
    units: Sequence[Samples] | ConcatenatedRecordings, *, target_deg: float = 1.0, dip_deg: float = 60.0
) -> BatchColumns:
    """Fit and judge many units in one call, with the results of `flinders.fit` for each.

    Raises `UsageError` for a target that is not positive, or within a degree of the magnetic poles.

    Parameters
    ----------
    units : sequence of Samples, or ConcatenatedRecordings
        Readings of each unit.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float
        Inclination of the field at the site.

    Returns
    -------
    BatchColumns
        In the order of `units`. A unit without a calibration has a row with its error.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    columns = BatchColumns.empty(len(units))
    for places, whole, offsets in _groups(units):
        records = engine().fit_many(whole.field, offsets, time=whole.time, dip_deg=dip_deg)
        known = _is_sufficient(records, whole.unit.inside)
        records, there = records.compress(known), places[known]
        _add_unmodelled(records, _with_disturbances(units, there))
        request = engine().request(target_deg=target_deg, is_microtesla=whole.unit.inside == MICROTESLA)
        judgements = engine().judge_many(records, request)
        _fill(columns, there, records, judgements, whole.unit.inside)
    for place in np.flatnonzero(~columns.by_record | (columns.verdict == "limited")).tolist():
        one = units[place]
        result = _fit_one(one, target_deg=target_deg, dip_deg=dip_deg)
        if columns.by_record[place]:
            _explain(columns, place, result)
            continue
        fill_row(columns, place, result)
        columns.readings[place], columns.unit_of_field[place] = len(one), one.unit.inside
    return columns


def _with_disturbances(
    units: Sequence[Samples] | ConcatenatedRecordings, places: NDArray[np.intp]
) -> Iterator[tuple[int, Samples]]:
    """Yield index and readings of each unit with currents, throttles or temperatures."""
    if isinstance(units, ConcatenatedRecordings) and not units.whole.disturbances:
        return
    for number, place in enumerate(places.tolist()):
        if (one := units[place]).disturbances:
            yield number, one


def _groups(
    units: Sequence[Samples] | ConcatenatedRecordings,
) -> Iterator[tuple[NDArray[np.intp], Samples, NDArray[np.int64]]]:
    """Yield groups of units that are fitted from readings and times alone.

    A group has the indices of its units, their joined readings, and the index of the first reading of each unit.
    """
    if isinstance(units, ConcatenatedRecordings):
        if _is_plain(units.whole):
            yield np.arange(len(units)), units.whole, np.concatenate([[0], units.ends])
        return
    groups: dict[tuple[str, bool], list[int]] = defaultdict(list)
    for place, one in enumerate(units):
        if type(one) is Samples and _is_plain(one):
            groups[one.unit.inside, one.time is None].append(place)
    for places in groups.values():
        some = [units[place] for place in places]
        time = None if some[0].time is None else np.concatenate([one.time for one in some if one.time is not None])
        whole = Samples(np.concatenate([one.field for one in some]), unit=some[0].unit, time=time)
        yield np.array(places), whole, np.cumsum([0, *map(len, some)])


def _is_plain(one: Samples) -> bool:
    """Whether the fit uses only the readings and their times."""
    return one.strength is None and not one.skipped and not one.axes.is_mirror


def _is_sufficient(records: Records, inside: str) -> NDArray[np.bool_]:
    """(U,) whether no separate fit is needed: all readings were fitted, and the sensor was turned out of one plane."""
    tells: NDArray[np.bool_] = (records["status"] == 0) & (records["unobserved"] == 0) & (records["hides_plane"] == 0)
    return tells & was_turned(records, inside, weakest=0.0)


def _surface(record: Records) -> Ellipsoid:
    """The ellipsoid of a record."""
    return Ellipsoid(record["centre"], symmetric_matrix(record["shape"]))


def _limit(record: Records) -> float:
    """Largest distance of an inlier from the ellipsoid of a record."""
    return float(record["rejected_beyond"]) if record["is_robust"] else np.inf


def _add_unmodelled(records: Records, disturbed: Iterator[tuple[int, Samples]]) -> None:
    """Write into the records whether recorded disturbances explain the residuals of their units."""
    for place, one in disturbed:
        record = records[place]
        time = float(np.nan_to_num(record["correlation_time"], nan=1.0))
        once = Rests.of(one).average(one) if record["rests"] else one
        unmodelled = unmodelled_of(once, _surface(record), dip_deg=record["dip_deg"], time=time, limit=_limit(record))
        record["unmodelled_deg"] = np.nan if unmodelled is None else unmodelled.heading_deg


def _shapes(records: Records) -> Floats:
    """(U, 3, 3) shape matrices of the records."""
    shapes: Floats = records["shape"][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    return shapes


def _corrections(shapes: Floats, strength: Floats) -> Floats:
    """(U, 3, 3) matrices of (U, 3, 3) shapes and (U,) field strengths, as `Calibration.from_ellipsoid`."""
    matrix = strength[:, np.newaxis, np.newaxis] * np.linalg.inv(shapes)
    symmetrised: Floats = 0.5 * (matrix + matrix.swapaxes(1, 2))
    return symmetrised


def _fill(columns: BatchColumns, places: NDArray[np.intp], records: Records, judgements: Records, inside: str) -> None:
    """Fill columns from judgements, except for units that are refused or need further tests, and so a separate fit."""
    asks = judgements["asks"] & (ASKS_HALVES | ASKS_SWAP)
    usable = (judgements["verdict"] < REFUSES) & ~np.isnan(judgements["worst_deg"]) & (asks == 0)
    if not usable.any():
        return
    records, judged, places = records.compress(usable), judgements.compress(usable), places[usable]
    columns.readings[places], columns.samples[places] = records["rows"], records["used"]
    columns.offset[places] = records["centre"]
    columns.matrix[places] = _corrections(_shapes(records), records["radius"]).reshape(-1, 9)
    columns.covariance[places] = judged["covariance"][:, UPPER_ENTRIES]
    columns.noise[places], columns.field_strength[places] = records["noise"], records["radius"]
    columns.worst_deg[places], columns.rms_deg[places] = judged["worst_deg"], judged["rms_deg"]
    columns.bound_95_deg[places] = judged["bound_deg"]
    columns.dip_deg[places], columns.coverage[places] = records["dip_deg"], records["coverage"]
    columns.method[places] = np.where(records["is_robust"] == 1, Robust.name, Likelihood.name)
    columns.unit_of_field[places] = inside
    columns.findings[places] = _finding_codes(judged["severities"])
    columns.verdict[places] = np.where(judged["verdict"] == LIMITS, "limited", "good")
    columns.by_record[places] = True


def _finding_codes(severities: NDArray[np.uint8]) -> NDArray[np.object_]:
    """(K,) tuples of codes, the most severe first; units with equal findings share one tuple."""
    there = severities[:, severities.any(axis=0)].astype(np.int64)
    digits = 4 ** np.arange(there.shape[1])  # encodes each row of severities, 0 to 3, as one number
    rows = there @ digits if there.shape[1] < 32 else there
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    named: NDArray[np.object_] = np.empty(len(first), dtype=object)
    for place, row in enumerate(severities[first].tolist()):
        order = sorted((rule for rule, severity in enumerate(row) if severity), key=lambda rule: -row[rule])
        named[place] = tuple(ENGINE_FINDINGS[rule] for rule in order)
    return np.asarray(named[kind.ravel()])


def _fit_one(one: Samples, *, target_deg: float, dip_deg: float) -> Fit | Exception:
    """Result of `flinders.fit` for one unit: the fit, or the error that it raises."""
    try:
        return calibrate.fit(one, target_deg=target_deg, site=Site(inclination_deg=dip_deg))
    except UsageError:
        raise
    except Refused as error:
        return error.fit
    except Exception as error:  # noqa: BLE001 - a unit that fails is a row, and never the end of the others
        return error


def _error_columns(error: Exception) -> tuple[str, str, str]:
    """Verdict, code and message of a unit without a fit."""
    if isinstance(error, FlindersError):
        return "refused" if isinstance(error, FitError) else "failed", error.code, error.message
    return "failed", "internal", f"{type(error).__name__}: {error}; this is a fault in Flinders, report it"


def fill_row(columns: FitColumns, place: int, result: Fit | Exception) -> None:
    """Write the fit of a unit, or its error, into its row."""
    if not isinstance(result, Fit):
        columns.findings[place] = ()
        columns.verdict[place], columns.code[place], columns.message[place] = _error_columns(result)
        columns.cause[place] = columns.code[place]
        return
    error, findings = result.heading_error_deg, result.findings
    columns.verdict[place], columns.method[place], columns.samples[place] = (
        result.verdict,
        result.evidence.method,
        result.evidence.samples,
    )
    columns.worst_deg[place], columns.rms_deg[place], columns.dip_deg[place] = error.worst, error.rms, error.dip_deg
    columns.noise[place], columns.coverage[place] = result.evidence.noise, result.evidence.coverage.fraction
    columns.findings[place] = tuple(finding.code for finding in findings)
    _explain(columns, place, result)
    if result.verdict == "refused":
        columns.code[place] = Refused.code
        return
    columns.offset[place], columns.field_strength[place] = result.calibration.offset, result.calibration.field_strength
    columns.matrix[place] = result.calibration.matrix.ravel()
    columns.covariance[place] = result.claim.claimed_covariance.ravel()[UPPER_ENTRIES]
    columns.bound_95_deg[place] = result.claim.heading_bound_deg


def _explain(columns: FitColumns, place: int, result: Fit | Exception) -> None:
    """Write the cause why a fit is not good: its most severe finding, or its error."""
    if isinstance(result, Fit) and result.verdict != "good":
        for first in first_causes(result.findings)[:1]:
            columns.cause[place], columns.message[place] = first.code, headline_of(result).words
            columns.number[place], columns.limit[place] = first.number, first.limit
