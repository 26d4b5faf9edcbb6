"""Many recordings at once: one call of the engine, and the rules of the catalogue on columns of its records.

A recording is judged from its record alone, with the numbers and findings of `flinders.fit`. One that needs more than
that, be it outliers to list, a level turn or the sentence of a refusal, is given to `flinders.fit` by itself.

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
from flinders.core.units import EARTH_UT, MICROTESLA
from flinders.diagnostics.systematic import BY_CHANCE
from flinders.diagnostics.unmodelled import unmodelled_of
from flinders.diagnostics.unmoved import was_turned
from flinders.errors import FitError, FlindersError, UsageError
from flinders.estimators.auto import FEWEST_LEFT, trimmed_covariance
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.rests import Rests
from flinders.estimators.robust import Robust
from flinders.findings import CATALOGUE, VERDICTS
from flinders.fitting import calibrate
from flinders.fitting.claim import widening
from flinders.fitting.result import ALIKE, Fit, Refused
from flinders.fitting.shrinkage import posteriors
from flinders.fitting.verdict import (
    ALTERNATING,
    ENOUGH,
    ENOUGH_CORRELATED,
    OF_CALIBRATION,
    OF_FIT,
    OF_RECORDING,
    halves_matter,
    unlike_correlation,
    unsteady_limit,
)
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.heading.error_propagation import bounds_deg, deviation_covariances, level_error, raw_error
from flinders.native.engine import engine
from flinders.summary.summary import flat_below

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.findings import Severity
    from flinders.native.engine import Records

UPPER: Final = np.flatnonzero(np.triu(np.ones((9, 9))).ravel())
"""The 45 entries of a covariance on and above its diagonal, row by row."""

WIDTHS: Final = {"offset": 3, "matrix": 9, "covariance": 45}
"""Columns of so many numbers."""

LOOKED: Final = 1_000
"""Readings that show whether a unit with outliers has to be looked at closely for a turn in one plane."""

MAY_BE_FLAT: Final = 0.3
"""Thickness over width of what may be one: `flinders.estimators.auto` takes up to 0.2 of all readings for flat."""

NEVER_FLAT: Final = 0.6
"""Thickness over width of readings that are no plane and a few outliers."""

DIAGONAL: Final = slice(0, 81, 10)
"""Of a flat covariance."""

CODES: Final = (*OF_FIT, "alternating", "outliers", *OF_CALIBRATION, *OF_RECORDING)
"""Findings that a record tells, in the order of `flinders.fitting.verdict.judge`."""


@dataclass(frozen=True, slots=True, eq=False)
class Lined:
    """Recordings that lie one after the other in the same columns, as in a table of a fleet.

    A sequence of `Samples`, of which each is made when it is asked for.

    Examples
    --------
    >>> lined = Lined(Samples.of(np.arange(18.0).reshape(6, 3)), np.array([2, 6]), ["A17", "B02"])
    >>> lined[1].source, len(lined[1])
    ('B02', 4)
    """

    whole: Samples  # the readings of all
    ends: NDArray[np.int64]  # (U,) where those of each end
    sources: Sequence[str]  # where each came from, for messages

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, place: int) -> Samples:
        """One of them."""
        begin = int(self.ends[place - 1]) if place else 0
        return replace(self.whole[begin : int(self.ends[place])], source=self.sources[place])

    def __iter__(self) -> Iterator[Samples]:
        return (self[place] for place in range(len(self)))

    @property
    def counts(self) -> NDArray[np.int64]:
        """(U,) how many readings each has."""
        return np.diff(self.ends, prepend=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitColumns:
    """Columns that the fits of U units fill, NaN where a fit gives no number."""

    readings: NDArray[np.int64]  #: (U,): those there are
    samples: NDArray[np.int64]  #: (U,): those that the fit used
    #: (U,) str: ``good``, ``limited``, ``refused`` or ``failed``; code and message of the error of the last two
    verdict: NDArray[np.object_]
    code: NDArray[np.object_]
    message: NDArray[np.object_]
    method: NDArray[np.object_]
    worst_deg: Floats  #: (U,): heading error at the worst heading of a level vehicle, 1 σ, at the dip `dip_deg`
    rms_deg: Floats  #: (U,): the same over all headings
    bound_95_deg: Floats  #: (U,): that it stays within at all headings with a probability of 95 %
    dip_deg: Floats  #: (U,): heading error of a level vehicle, 1 σ, where the field dips by `dip_deg`
    #: (U, 3), (U, 9), (U, 45), in `unit_of_field`: of the calibration; the upper triangle of `Fit.claimed_covariance`,
    #: row by row
    offset: Floats
    matrix: Floats
    covariance: Floats
    noise: Floats  #: (U,), in `unit_of_field`
    field_strength: Floats  #: (U,), in `unit_of_field`
    coverage: Floats  #: (U,): share of the sphere that was seen
    findings: NDArray[np.object_]  #: (U,) tuple of str: their codes, the most severe first
    unit_of_field: NDArray[np.object_]  #: (U,) str

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
        return len(self.samples)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class BatchColumns(FitColumns):
    """Results of a batch of U units."""

    by_record: NDArray[np.bool_]  #: (U,): judged from its record, without a fit of its own

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{many} {verdict}" for verdict, many in sorted(Counter(self.verdict.tolist()).items()))
        return f"BatchColumns({verdicts}; {int(self.by_record.sum())} of {len(self)} by their records)"


def fit_batch(units: Sequence[Samples] | Lined, *, target_deg: float = 1.0, dip_deg: float = 60.0) -> BatchColumns:
    """Fit and judge many units at once, each as `flinders.fit` would by itself.

    Raises `UsageError` for a target that is not positive, or within a degree of the magnetic poles.

    Parameters
    ----------
    units : sequence of Samples, or Lined
        The readings of each.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float
        Inclination of the field at the site.

    Returns
    -------
    BatchColumns
        In the order given. A unit that gives no calibration is a row with its error.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    columns = BatchColumns.empty(len(units))
    for places, whole, offsets in _groups(units):
        records = engine().fit_many(whole.field, offsets, time=whole.time, dip_deg=dip_deg)
        known = _tells_all(records, whole.unit.inside)
        known &= ~halves_matter(records["drift_deg"], records["drift_by_chance"], target_deg)
        for at in np.flatnonzero(known & (records["is_robust"] == 1)).tolist():
            known[at] = not _may_be_level(records[at], whole.field[offsets[at] : offsets[at + 1]])
        table = _Table.of(records.compress(known), _disturbed(units, places[known]), whole.unit.inside, target_deg)
        _fill(columns, places[known], table)
    for place in np.flatnonzero(~columns.by_record).tolist():
        one = units[place]
        fill_row(columns, place, _alone(one, target_deg=target_deg, dip_deg=dip_deg))
        columns.readings[place], columns.unit_of_field[place] = len(one), one.unit.inside
    return columns


def _disturbed(units: Sequence[Samples] | Lined, places: NDArray[np.intp]) -> Iterator[tuple[int, Samples]]:
    """Those of some units that have currents, throttles or temperatures, with their numbers among these."""
    if isinstance(units, Lined) and not units.whole.disturbances:
        return
    for number, place in enumerate(places.tolist()):
        if (one := units[place]).disturbances:
            yield number, one


def _groups(units: Sequence[Samples] | Lined) -> Iterator[tuple[NDArray[np.intp], Samples, NDArray[np.int64]]]:
    """Units whose readings alone have a say, one behind the other: their places, all readings, where each begins."""
    if isinstance(units, Lined):
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
    """Whether nothing beside the readings and their times has a say in the fit."""
    return one.strength is None and not one.skipped and not one.axes.is_mirror


@dataclass(frozen=True, eq=False)
class _Table:
    """What records say of U units, column by column."""

    # (U,) with covariances that are claimed, and shrunk fits of readings that were corrected before; rows of them are
    # taken by `compress`, as an index copies records field by field
    records: Records
    quantities: dict[str, Any]  # what the rules of the catalogue compare, by name
    covariance: Floats  # (U, 9, 9) with all that widens it, as `Fit.claimed_covariance`
    inside: str  # unit of the readings: ``uT`` or ``counts``

    @classmethod
    def of(cls, records: Records, disturbed: Iterator[tuple[int, Samples]], inside: str, target_deg: float) -> Self:
        """Work out what rules compare, from records, which are changed, and those units that something disturbs."""
        repetition, factor = _repetition(records)
        changes = _changes(records, disturbed)
        _widen(records, factor)
        quantities = {
            "target_deg": np.full(len(records), target_deg),
            "drift_allowed_deg": np.full(len(records), target_deg),
            "unsteady_limit_deg": target_deg * unsteady_limit(records["steps_kurtosis"]),
            "samples": records["used"],
            "uncorrected_deg": _shrink(records),
            **_of_surface(records, inside),
            **_of_accuracy(records),
            **_of_evidence(records, repetition),
            **_of_the_recording(records),
            **changes,
            **{name: np.full(len(records), value) for name, value in NOT_ASKED.items()},
        }
        return cls(records, quantities, _claimed(records, quantities["structure_deg"]), inside)

    @property
    def findings(self) -> dict[tuple[str, Severity], NDArray[np.bool_]]:
        """(U,) which units have each finding, the most severe first."""
        there: dict[tuple[str, Severity], NDArray[np.bool_]] = {}
        for code in CODES:
            holding = CATALOGUE[code].rule.holds(self.quantities)
            there |= {(code, severity): holds for severity, holds in holding.items()}
        return {key: there[key] for severity in VERDICTS for key in there if key[1] == severity}


NOT_ASKED: Final = dict.fromkeys(
    (
        "alignment_deg",
        "attitude_dependent_deg",  # of a fleet the accelerometer is not read
        "tilt_error_deg",
        "apart_deg",
        "apart_by_chance",
        "apart_beyond_claim_deg",
        "swap_gain",
        "farthest",
        "soft_iron_p_value",
        "linearized_deg",
        "poses_by_chance",
    ),
    np.nan,
) | dict.fromkeys(("bias_deg", "is_planar", "skipped", "silent", "is_doubtful", "nothing", "rows"), 0.0)
"""Quantities of what no record tells; a unit of which one of them matters is fitted by itself."""


def _tells_all(records: Records, inside: str) -> NDArray[np.bool_]:
    """(U,) whether a record tells all: one fit of all readings, of a sensor that was turned out of one plane."""
    may_be_swapped = (records["is_white"] == 0) | (records["is_robust"] == 1)
    is_swapped = (records["swaps"] > 0).any(axis=1) & may_be_swapped
    is_seen = (records["status"] == 0) & (records["unobserved"] == 0)
    tells: NDArray[np.bool_] = is_seen & was_turned(records, inside, weakest=0.0) & ~is_swapped
    return tells


def _surface(record: Records) -> Ellipsoid:
    """The ellipsoid of a record."""
    return Ellipsoid(record["centre"], symmetric(record["shape"]))


def _limit(record: Records) -> float:
    """Distance from it beyond which readings are outliers."""
    return float(record["rejected_beyond"]) if record["is_robust"] else np.inf


def _may_be_level(record: Records, field: Floats) -> bool:
    """Whether a unit with outliers may have been turned in one plane, which a few of them hide: a look at some."""
    some = field[:: max(1, len(field) // LOOKED)]
    some = some[np.abs(engine().distances(some, record)) <= _limit(record)]
    if len(some) < FEWEST_LEFT:
        return False
    return _thickness(np.cov(some.T)) < NEVER_FLAT and _thickness(trimmed_covariance(some)) < MAY_BE_FLAT


def _thickness(covariance: Floats) -> float:
    """Thickness over width of readings with a (3, 3) covariance."""
    thinnest, _, widest = np.sqrt(np.linalg.eigvalsh(covariance).clip(min=0.0)).tolist()
    return float(thinnest / widest) if widest > 0.0 else 1.0


def _widen(records: Records, factor: Floats) -> None:
    """Make covariances (U,) factors wider, and heading errors with them, in place."""
    records["covariance"] *= factor[:, np.newaxis]
    for name in ("level_worst_deg", "level_rms_deg"):
        records[name] *= np.sqrt(factor)


def _shrink(records: Records) -> Floats:
    """Shrink fits of readings that were corrected before, in place; (U,) heading error of these as they are, or NaN."""
    uncorrected_deg = np.full(len(records), np.nan)
    surfaces = np.concatenate([records["centre"], records["shape"]], axis=1)
    places, surfaces, covariances = posteriors(surfaces, records["covariance"].reshape(-1, 9, 9))
    records["centre"][places], records["shape"][places] = surfaces[:, :3], surfaces[:, 3:]
    records["covariance"][places] = covariances.reshape(-1, 81)
    for place, covariance in zip(places.tolist(), covariances, strict=True):
        record, dip_deg = records[place], float(records["dip_deg"][place])
        surface = _surface(record)
        error = level_error(surface, covariance, dip_deg=dip_deg)
        record["radius"], record["level_worst_deg"], record["level_rms_deg"] = surface.radius, error.worst, error.rms
        uncorrected_deg[place] = raw_error(surface, dip_deg=dip_deg).worst
    return uncorrected_deg


def _repetition(records: Records) -> tuple[Floats, Floats]:
    """Factors by which repeated readings, and these with few ones, widen covariances, as `flinders.fitting.claim`."""
    rows = records["fitted"].astype(float)
    share = rows / np.maximum(records["fitted_distinct"], 1)
    known = np.mean(records["covariance"][:, DIAGONAL] / records["textbook"][:, DIAGONAL], axis=1)
    repetition = np.maximum(1.0, share / known)
    factor = [widening(*each, 9) for each in zip(rows.tolist(), repetition.tolist(), strict=True)]
    return repetition, np.array(factor)


def _claimed(records: Records, structure_deg: Floats) -> Floats:
    """(U, 9, 9) covariances with what belongs to the direction, as `Fit.claimed_covariance`."""
    claimed = records["covariance"].reshape(-1, 9, 9).copy()
    sigma = np.deg2rad(structure_deg) * np.cos(np.deg2rad(records["dip_deg"]))
    shapes = _shapes(records)
    claimed[:, :3, :3] += (sigma**2)[:, np.newaxis, np.newaxis] * (shapes @ shapes)
    return claimed


def _of_surface(records: Records, inside: str) -> dict[str, Floats]:
    """What the ellipsoid says, and the calibration that it makes."""
    axes = np.linalg.eigvalsh(_shapes(records))
    radius, noise = np.exp(np.log(axes).mean(axis=1)), records["noise"]
    nearest = np.clip(radius, *EARTH_UT)
    thickness, width = np.sqrt(records["principal_variances"][:, [0, 2]]).T
    is_absolute = inside == MICROTESLA
    every = np.ones(len(records))
    is_bent = ~np.isnan(_named_fault(records, "nonlinear", "lag"))
    return {
        "radius": radius,
        "axis_ratio": axes[:, 2] / axes[:, 0],
        "noise_share": noise / radius,
        "structure_share": np.where(is_bent, np.nan, records["distortion"] / radius),
        "inflation": 2.0 * axes[:, 2] / (records["highest"] - records["lowest"]).max(axis=1),
        "flatness": thickness / width,
        "flatness_limit": np.array([flat_below(w, n) / w for w, n in zip(width.tolist(), noise.tolist(), strict=True)]),
        "nearest_earth": nearest,
        "times_outside_earth": np.maximum(radius / nearest, nearest / radius) if is_absolute else every * np.nan,
        "handedness": every,
        "field_strength": radius,
        "is_in_counts": every * (not is_absolute),
        "is_relative": every,
        "is_unaligned": every,
    }


def _of_accuracy(records: Records) -> dict[str, Floats]:
    """What the covariance says about heading, with what belongs to directions."""
    level = records["radius"] * np.cos(np.deg2rad(records["dip_deg"]))
    across = np.rad2deg(np.nan_to_num(records["distortion"]) / level)
    structure_deg = np.fmax(across, np.fmax(_proven(records, "nonlinear"), _proven(records, "lag")))
    lag_one = np.nan_to_num(records["lag_one"])
    off = np.sqrt(np.maximum(-3.0 * lag_one, 0.0)) * records["noise"]
    lasting = unlike_correlation(lag_one, records["fitted_repeats"] / records["fitted"])
    return {
        "worst_deg": np.hypot(records["level_worst_deg"], structure_deg),
        "rms_deg": np.hypot(records["level_rms_deg"], structure_deg),
        "structure_deg": structure_deg,
        "nonlinear_deg": _named_fault(records, "nonlinear", "lag"),
        "lag_deg": _named_fault(records, "lag", "nonlinear"),
        "next_correlation": lag_one,
        "noise_lasts": np.nan_to_num(records["noise_lasts"]),
        "unlike_correlation": lasting,
        "unsteady_deg": np.rad2deg(records["noise"] * np.sqrt(lasting) / level),
        "alternating_limit": np.minimum(ALTERNATING, -4.0 / np.sqrt(records["used"])),
        "alternating_deg": np.degrees(np.arctan2(off, level)),
    }


def _proven(records: Records, fault: str) -> Floats:
    """(U,) heading error of a fault of axes, where it is proven; else NaN."""
    return np.where(records[f"{fault}_by_chance"] < BY_CHANCE, records[f"{fault}_deg"], np.nan)


def _named_fault(records: Records, fault: str, other: str) -> Floats:
    """(U,) the same, but NaN where the other is likelier to be the cause of both, as `Fit.faults_of_axes` says."""
    cost, of_other = _proven(records, fault), _proven(records, other)
    is_likelier = records[f"{other}_by_chance"] < records[f"{fault}_by_chance"]
    return np.where(is_likelier & (of_other >= ALIKE * cost), np.nan, cost)


def _of_evidence(records: Records, repetition: Floats) -> dict[str, Floats]:
    """How much there was to go by."""
    per_reading = 1.0 / (records["correlation_time"] * records["excess_variance"])
    effective = np.minimum(records["fitted"] / repetition * per_reading, records["fitted_distinct"])
    independent = np.minimum(np.nan_to_num(effective, nan=np.inf), records["used"])
    return {
        "hole_deg": records["hole_deg"],
        "covered": records["coverage"],
        "unobserved": records["unobserved"],
        "prior_share": records["prior_influence"],
        "independent": independent,
        "independent_needed": np.where(independent == records["used"], ENOUGH, ENOUGH_CORRELATED),
        "independent_share": independent / records["used"],
    }


def _of_the_recording(records: Records) -> dict[str, Floats]:
    """What recordings say about themselves."""
    seconds = np.nan_to_num(records["end"] - records["start"])
    return {
        "outlier_share": records["rejected"] / records["fitted"],
        "repeated_share": 1.0 - records["distinct"] / records["rows"],
        "distinct": records["distinct"],
        "at_rest_share": records["at_rest"] / records["rows"],
        "step": records["step"],
        "path_correlation": np.where(np.isnan(records["start"]), records["path_correlation"], np.nan),
        "backward_steps": records["backward_steps"],
        "longest_step_s": np.nan_to_num(records["longest_step"]),
        "usual_step_s": seconds / np.maximum(records["rows"] - 1, 1),
    }


def _changes(records: Records, disturbed: Iterator[tuple[int, Samples]]) -> dict[str, Floats]:
    """Whether something changed within a recording, or follows what was recorded beside it."""
    unmodelled_deg = np.full(len(records), np.nan)
    for place, one in disturbed:
        record = records[place]
        time = float(np.nan_to_num(record["correlation_time"], nan=1.0))
        once = Rests.of(one).fitted(one) if record["rests"] else one
        unmodelled = unmodelled_of(once, _surface(record), dip_deg=record["dip_deg"], time=time, limit=_limit(record))
        unmodelled_deg[place] = np.nan if unmodelled is None else unmodelled.heading_deg
    return {
        "drift_deg": records["drift_deg"],
        "drift_by_chance": records["drift_by_chance"],
        "drift": np.linalg.norm(records["drift_offset"], axis=1),
        "unmodelled_deg": unmodelled_deg,
    }


def _shapes(records: Records) -> Floats:
    """(U, 3, 3) shapes."""
    shapes: Floats = records["shape"][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    return shapes


def _corrections(shapes: Floats, strength: Floats) -> Floats:
    """(U, 3, 3) matrices of (U, 3, 3) shapes and (U,) field strengths, as `Calibration.from_ellipsoid`."""
    matrix = strength[:, np.newaxis, np.newaxis] * np.linalg.inv(shapes)
    symmetrised: Floats = 0.5 * (matrix + matrix.swapaxes(1, 2))
    return symmetrised


def _fill(columns: BatchColumns, places: NDArray[np.intp], table: _Table) -> None:
    """Write down what the records tell; what refuses a calibration is said by a fit of its own."""
    findings = table.findings
    is_refused = np.zeros(len(places), dtype=bool)
    for (_, severity), there in findings.items():
        is_refused |= there & (severity == "refuses")
    usable = ~is_refused & ~np.isnan(table.quantities["worst_deg"])
    if not usable.any():
        return
    records, places = table.records.compress(usable), places[usable]
    shapes, strength = _shapes(records), table.quantities["radius"][usable]
    columns.readings[places], columns.samples[places] = records["rows"], records["used"]
    columns.offset[places] = records["centre"]
    columns.matrix[places] = _corrections(shapes, strength).reshape(-1, 9)
    covariance = table.covariance[usable]
    columns.covariance[places] = covariance.reshape(-1, 81)[:, UPPER]
    deviations = deviation_covariances(shapes, covariance, records["dip_deg"])
    columns.bound_95_deg[places] = bounds_deg(deviations)
    columns.noise[places], columns.field_strength[places] = records["noise"], strength
    columns.worst_deg[places], columns.rms_deg[places] = (table.quantities[n][usable] for n in ("worst_deg", "rms_deg"))
    columns.dip_deg[places], columns.coverage[places] = records["dip_deg"], records["coverage"]
    columns.method[places] = np.where(records["is_robust"] == 1, Robust.name, Likelihood.name)
    columns.unit_of_field[places] = table.inside
    columns.findings[places], columns.verdict[places] = _named({key: there[usable] for key, there in findings.items()})
    columns.by_record[places] = True


def _named(findings: Mapping[tuple[str, Severity], Any]) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
    """(K,) tuples of codes, the most severe first, and (K,) verdicts; units alike share theirs."""
    there = np.stack(list(findings.values()), axis=1)
    bits = np.packbits(there, axis=1)
    _, first, kind = np.unique(bits.view(f"V{bits.shape[1]}").ravel(), return_index=True, return_inverse=True)
    limits = np.array([severity == "limits" for _, severity in findings])
    named, verdicts = np.empty(len(first), dtype=object), np.empty(len(first), dtype=object)
    for place, row in enumerate(there[first]):
        named[place] = tuple(code for (code, _), is_there in zip(findings, row, strict=True) if is_there)
        verdicts[place] = "limited" if (row & limits).any() else "good"
    return named[kind], verdicts[kind]


def _alone(one: Samples, *, target_deg: float, dip_deg: float) -> Fit | Exception:
    """What `flinders.fit` makes of one unit: a fit, or the error that it raises."""
    try:
        return calibrate.fit(one, target_deg=target_deg, dip_deg=dip_deg)
    except UsageError:
        raise
    except Refused as error:
        return error.fit
    except Exception as error:  # noqa: BLE001 - a unit that fails is a row, and never the end of the others
        return error


def _described(error: Exception) -> tuple[str, str, str]:
    """Verdict, code and message of a unit that gives no fit."""
    if isinstance(error, FlindersError):
        return "refused" if isinstance(error, FitError) else "failed", error.code, error.message
    return "failed", "internal", f"{type(error).__name__}: {error}; this is a fault in Flinders, report it"


def fill_row(columns: FitColumns, place: int, result: Fit | Exception) -> None:
    """Write the fit of a unit, or the error in its place, into its row."""
    if not isinstance(result, Fit):
        columns.findings[place] = ()
        columns.verdict[place], columns.code[place], columns.message[place] = _described(result)
        return
    error, findings = result.heading_error_deg, result.findings
    columns.verdict[place], columns.method[place], columns.samples[place] = (
        result.verdict,
        result.method,
        result.samples,
    )
    columns.worst_deg[place], columns.rms_deg[place], columns.dip_deg[place] = error.worst, error.rms, error.dip_deg
    columns.noise[place], columns.coverage[place] = result.noise, result.coverage.fraction
    columns.findings[place] = tuple(finding.code for finding in findings)
    if result.verdict == "refused":
        columns.code[place], columns.message[place] = Refused.code, findings[0].advice
        return
    columns.offset[place], columns.field_strength[place] = result.calibration.offset, result.calibration.field_strength
    columns.matrix[place] = result.calibration.matrix.ravel()
    columns.covariance[place] = result.claimed_covariance.ravel()[UPPER]
    columns.bound_95_deg[place] = result.heading_bound_deg
