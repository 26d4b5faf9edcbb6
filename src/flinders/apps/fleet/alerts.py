"""Alerts of an extended table: units and files that crossed a limit since the last run.

A recording is compared with the previous one of the same unit, by date or else by name. A change of heading is an alert
by the criterion of `flinders drift`: larger than the target, and significant for the number of pairs compared.

>>> good, bad = (UnitResult(unit="A17", recording=day, verdict=verdict, cause="coverage" * (verdict != "good"))
...              for day, verdict in (("2026-03-01", "good"), ("2026-06-01", "limited")))
>>> [(each.unit, each.alert, each.before) for each in alerts_of([bad], [good], target_deg=1.0)]
[('A17', 'not-good', 'good')]
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np

from flinders.apps.fleet.dates import arrange
from flinders.apps.fleet.drift import FALSE_ALARM_PROBABILITY
from flinders.apps.fleet.overview import STATES
from flinders.apps.fleet.results import VERDICTS, UnitResult
from flinders.comparison.pairs import EllipsoidPairs, differences
from flinders.findings import action

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from flinders.errors import FlindersError


ALERTS: Final = {
    "not-good": "the verdict is worse than that of the recording before, or not good at the first",
    "worst-error": "the heading error to expect went above the target",
    "heading-changed": STATES["recalibrate"],
    "changed-file": "a file is not as it was when it was fitted",
    "vanished-file": "a file that was fitted is no longer there",
}
"""Meaning of each alert."""
HEADING_REMEDY: Final = "look for what was moved or exchanged near the sensor, and use the new calibration"
"""Remedy for a heading that changed."""


@dataclass(frozen=True, slots=True)
class Alert:
    """A unit or a file that crossed a limit since the last run."""

    unit: str  # name of the sensor or vehicle; for a file, the file name in parentheses
    recording: str  # name of the new recording
    alert: str  # kind of alert, one of those in docs/fleet/growing.md
    verdict: str  # verdict of the new recording
    before: str  # verdict of the previous recording; empty if there is none
    cause: str  # code of the finding or error; empty if there is none
    number: float  # value that crossed the limit: number of the finding, or heading error or its change, in degrees
    limit: float  # the limit, in the unit of `number`
    message: str  # description of the finding
    remedy: str  # advice on the cause

    @classmethod
    def of(
        cls, alert: str, row: UnitResult, before: UnitResult | None, changed: Mapping[str, Any] | None = None
    ) -> Self:
        """Make an alert from a row of the table; `changed` replaces some of the row's fields."""
        fields: dict[str, Any] = {
            "unit": row.unit, "recording": row.recording, "alert": alert, "verdict": row.verdict,
            "before": before.verdict if before else "", "cause": row.cause, "number": row.number,
            "limit": row.limit, "message": row.message, "remedy": action(row.cause),
        }  # fmt: skip
        return cls(**(fields | dict(changed or {})))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)


def alerts_of(new: Sequence[UnitResult], earlier: Iterable[UnitResult], *, target_deg: float) -> list[Alert]:
    """Compare new rows with earlier rows of the same units; alerts are sorted by unit and recording."""
    found = list(_successive_rows(new, earlier))
    alerts = [alert for each in found for alert in _of_verdict(each, target_deg)]
    alerts += _of_headings([each for each in found if each.reference is not None], target_deg)
    return sorted(alerts, key=lambda alert: (alert.unit, alert.recording))


def file_alerts(faults: Iterable[tuple[str, FlindersError]]) -> list[Alert]:
    """Alerts about files that changed or vanished, each by its name."""
    rows = [UnitResult(unit=f"({name})").with_error(error) for name, error in faults]
    return [Alert.of(row.cause, row, None) for row in rows]


class _Successive(NamedTuple):
    """A new row and the earlier rows of its unit."""

    row: UnitResult
    before: UnitResult | None  # row of the previous recording
    reference: UnitResult | None  # the previous calibration, if this row has one and their order is known


def _successive_rows(new: Sequence[UnitResult], earlier: Iterable[UnitResult]) -> Iterator[_Successive]:
    """Yield each new row with the earlier rows of its unit."""
    units: dict[str, list[UnitResult]] = defaultdict(list)
    for row in (*earlier, *new):
        units[row.unit].append(row)
    fresh = set(map(id, new))
    for rows in units.values():
        order = arrange([row.recording for row in rows], np.array([row.start_s for row in rows]))
        before = calibrated = None
        for row in (rows[place] for place in order.places):
            is_comparable = order.is_known and _has_calibration(row)
            if id(row) in fresh:
                yield _Successive(row, before, calibrated if is_comparable else None)
            before, calibrated = row, row if is_comparable else calibrated


def _of_verdict(one: _Successive, target_deg: float) -> Iterator[Alert]:
    """Yield an alert if the verdict became worse, or else if the heading error rose above the target."""
    row, before, _ = one
    known = "good" if before is None else before.verdict
    if VERDICTS.index(row.verdict) > VERDICTS.index(known):
        yield Alert.of("not-good", row, before)
    elif row.worst_deg > target_deg and not (before and before.worst_deg > target_deg):
        yield Alert.of("worst-error", row, before, {"cause": "", "number": row.worst_deg, "limit": target_deg})


def _of_headings(found: Iterable[_Successive], target_deg: float) -> list[Alert]:
    """Alerts about headings that changed between two calibrations in the same unit of field."""
    pairs = [
        (row, before, reference)
        for row, before, reference in found
        if reference is not None and row.unit_of_field == reference.unit_of_field
    ]
    if not pairs:
        return []
    newer, _, older = zip(*pairs, strict=True)
    dips = np.array([row.dip_deg for row in newer])
    changes = differences(_ellipsoids(older), _ellipsoids(newer), dip_deg=dips)
    beyond = (changes.worst_deg > target_deg) & (changes.p_value < FALSE_ALARM_PROBABILITY / len(pairs))
    words = {"cause": "", "limit": target_deg, "message": ALERTS["heading-changed"], "remedy": HEADING_REMEDY}
    return [
        Alert.of("heading-changed", row, before, {**words, "number": float(worst)})
        for (row, before, _), worst, is_beyond in zip(pairs, changes.worst_deg, beyond, strict=True)
        if is_beyond
    ]


def _has_calibration(row: UnitResult) -> bool:
    return row.verdict in VERDICTS[:2] and not math.isnan(row.covariance[0])


def _ellipsoids(rows: Sequence[UnitResult]) -> EllipsoidPairs:
    """Ellipsoids of the calibrations in some rows."""
    offset, matrix, covariance, radius = (
        np.array([getattr(row, name) for row in rows]) for name in ("offset", "matrix", "covariance", "field_strength")
    )
    return EllipsoidPairs.of_columns(offset, matrix, covariance, radius)
