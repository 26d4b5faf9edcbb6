"""Aggregates of a fleet's table for its report, computed over a bounded number of rows at a time."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.history import MAX_BATCHES, BatchRule, added_columns, batch_rule, whole_units
from flinders.apps.fleet.merging import common_findings
from flinders.apps.fleet.not_good import first_of, not_good
from flinders.apps.fleet.overview import FleetUnit, Histogram, Overview
from flinders.apps.fleet.results import LISTS, lists, named_rows, numbers, texts

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats

COLUMNS: Final = (
    "unit", "recording", "verdict", "code", "message", "method", "worst_deg", "offset", "noise", "field_strength",
    "findings", "unit_of_field",
)  # fmt: skip
MAX_LISTED: Final = 50
"""Number of units in each list of the worst units."""
MIN_GROUP_UNITS: Final = 2
"""Smallest mean number of units with the same value of a property that is shown; serial numbers are not shown."""
RANKS: Final = {"heading error": "worst_deg", "offset": "offset", "noise": "noise"}
"""Quantities by which the worst units are listed, and the attributes of `FleetUnit` that hold them."""


def overview_of(
    paths: Sequence[str | os.PathLike[str]], *, batch: str | None = None, target_deg: float = 1.0
) -> Overview:
    """Aggregate tables of `flinders fleet`: counts, histograms, and the worst units by each of `RANKS`.

    `batch` selects the hardware batch of units, see `batch_rule`; `target_deg` is the worst heading error that is good
    enough. Raises DocumentError for a file that is no table of a fleet, and UsageError for a batch that no unit has.
    """
    rule = batch_rule(paths, batch)
    tally = _Tally(rule, {name: BatchRule(column=name) for name in added_columns(paths) if name != rule.column})
    for table in whole_units(paths, (*COLUMNS, *filter(None, [rule.column]), *tally.properties)):
        tally.add(table)
    return Overview(
        tables=tuple(Path(path).name for path in paths),
        rows=tally.rows,
        units=tally.units,
        verdicts=dict(tally.verdicts),
        heading_deg=tally.heading_deg,
        offset=tally.offset,
        noise=tally.noise,
        field=dict(tally.strengths),
        findings=tally.ordered_findings(),
        codes={code: (count, *tally.examples[code]) for code, count in tally.codes.most_common()},
        methods=dict(tally.methods.most_common()),
        batches=_counts_by_group(rule, tally.batches, tally.rows),
        batch_source=rule.words,
        groups={name: shown for name in tally.properties if (shown := tally.groups_by(name))},
        not_good=first_of(rows for path in paths for rows in not_good(path)),
        worst={rank: tuple(tally.worst[rank]) for rank in RANKS},
        target_deg=target_deg,
    )


@dataclass(slots=True)
class _Tally:
    """Counts and histograms of a table's rows, to which rows are added."""

    rule: BatchRule
    properties: Mapping[str, BatchRule]
    rows: int = 0
    units: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    heading_deg: Histogram = field(default_factory=lambda: Histogram.over(0.01, 180.0, 60))
    offset: Histogram = field(default_factory=lambda: Histogram.over(0.01, 100.0, 60))
    noise: Histogram = field(default_factory=lambda: Histogram.over(1e-4, 1.0, 60))
    strengths: dict[str, Histogram] = field(default_factory=dict)
    findings: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    examples: dict[str, tuple[str, str]] = field(default_factory=dict)
    methods: Counter[str] = field(default_factory=Counter)
    batches: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    groups: dict[str, dict[str, Counter[str]]] = field(default_factory=dict)
    worst: dict[str, list[FleetUnit]] = field(default_factory=lambda: {rank: [] for rank in RANKS})

    def add(self, table: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
        """Add the rows of some units."""
        units = texts(table.column("unit"))
        verdicts = texts(table.column("verdict"))
        self.rows += len(units)
        named = named_rows(table)
        self.units += len(named.column("unit").unique())
        self.verdicts.update(verdicts)
        self.methods.update(method for method in texts(table.column("method")) if method)
        codes = table.column("findings").combine_chunks().flatten().to_pylist()
        self.findings.update(codes)
        self._add_codes(table, units)
        of_named = texts(named.column("verdict"))
        _add_counts(self.batches, self.rule.of(named), of_named)
        for name, rule in self.properties.items():
            _add_counts(self.groups.setdefault(name, defaultdict(Counter)), rule.of(named), of_named)
        self._add_numbers(table)

    def ordered_findings(self) -> dict[str, int]:
        """Number of rows with each finding, the most frequent first; findings that all calibrations share come last."""
        common = common_findings(self.findings, self.verdicts)
        return dict(sorted(self.findings.items(), key=lambda each: (each[0] in common, -each[1])))

    def groups_by(self, name: str) -> dict[str, dict[str, int]]:
        """Number of rows by value of a property and by verdict; empty if the property has one value, or too many."""
        counts = self.groups.get(name, {})
        is_group = 2 <= len(counts) <= max(self.units / MIN_GROUP_UNITS, 2)
        return _counts_by_group(self.properties[name], counts, self.rows) if is_group else {}

    def _add_codes(self, table: Any, units: Sequence[str]) -> None:  # noqa: ANN401
        """Count error codes, and store the first message of each."""
        codes, messages = texts(table.column("code")), table.column("message")
        self.codes.update(code for code in codes if code)
        for place, code in enumerate(codes):
            if code and code not in self.examples:
                self.examples[code] = (units[place], messages[place].as_py() or "")

    def _add_numbers(self, table: Any) -> None:  # noqa: ANN401
        """Add numbers to the histograms and to the worst units."""
        worst_deg, noise, radius = (numbers(table.column(name)) for name in ("worst_deg", "noise", "field_strength"))
        offset = np.linalg.norm(lists(table.column("offset"), LISTS["offset"]), axis=1)
        known = np.isfinite(offset)
        with np.errstate(invalid="ignore", divide="ignore"):
            shares = {"heading error": np.where(known, worst_deg, np.nan), "offset": offset / radius}
            shares["noise"] = np.where(known, noise / radius, np.nan)
        self.heading_deg = self.heading_deg.with_numbers(shares["heading error"])
        self.offset = self.offset.with_numbers(shares["offset"])
        self.noise = self.noise.with_numbers(shares["noise"])
        units = np.array(texts(table.column("unit_of_field")), dtype=object)
        for name in sorted(set(units[known])):
            low, high, classes = (10.0, 100.0, 120) if name == "uT" else (1.0, 1e5, 100)
            counted = self.strengths.get(name, Histogram.over(low, high, classes))
            self.strengths[name] = counted.with_numbers(radius[known & (units == name)])
        for rank, sizes in shares.items():
            self._rank(table, rank, sizes, shares)

    def _rank(self, table: Any, rank: str, numbers: Floats, shares: dict[str, Floats]) -> None:  # noqa: ANN401
        """Keep the rows with the largest numbers; of rows with equal numbers, the first."""
        value, worst = attrgetter(RANKS[rank]), self.worst[rank]
        least = value(worst[-1]) if len(worst) >= MAX_LISTED else -np.inf
        places = np.flatnonzero(np.isfinite(numbers) & (numbers > least))
        places = places[np.argsort(-numbers[places], kind="stable")[:MAX_LISTED]]
        added = [_unit(table, place, shares) for place in places.tolist()]
        self.worst[rank] = sorted([*worst, *added], key=value, reverse=True)[:MAX_LISTED]


def _add_counts(groups: dict[str, Counter[str]], names: Sequence[str], verdicts: Sequence[str]) -> None:
    """Count the verdict of each row in the group of the row."""
    for (name, verdict), count in Counter(zip(names, verdicts, strict=True)).items():
        if name in groups or len(groups) <= MAX_BATCHES:
            groups[name][verdict] += count


def _counts_by_group(rule: BatchRule, groups: Mapping[str, Counter[str]], rows: int) -> dict[str, dict[str, int]]:
    """Number of rows by group and verdict; empty if there are too many groups, or if a guessed pattern finds none."""
    return {name: dict(groups[name]) for name in sorted(groups)} if rule.are_useful(groups, rows) else {}


def _unit(table: Any, place: int, shares: dict[str, Floats]) -> FleetUnit:  # noqa: ANN401
    """Entry of the list of worst units, from row `place` of a table."""
    row = table.slice(place, 1).to_pylist()[0]
    texts = {name: row[name] or "" for name in ("unit", "recording", "verdict", "unit_of_field")}
    return FleetUnit(
        **texts,
        worst_deg=float(shares["heading error"][place]),
        offset=float(shares["offset"][place]),
        noise=float(shares["noise"][place]),
        radius=float(row["field_strength"]),
        findings=tuple(row["findings"] or ()),
    )
