"""The table of a fleet as a store of calibrations: the calibration of a unit at a date, as a calibration file.

A calibration is valid from its recording until the next calibration of its unit. Recordings that were refused or failed
have no calibration, so that the previous one stays valid.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> rows = [UnitResult(unit="A17", recording=f"2026-0{month}-01.csv").with_fit(fit) for month in (3, 6)]
>>> found = calibration_at(rows, "A17", datetime(2026, 4, 1, tzinfo=UTC))
>>> found.row.recording, found.next_s - found.date_s
('2026-03-01.csv', 7948800.0)
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from datetime import UTC, datetime, time
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.dates import arrange
from flinders.apps.fleet.growth import ReadFiles
from flinders.apps.fleet.merging import TableRows
from flinders.apps.fleet.results import VERDICTS, UnitResult, UnitResults
from flinders.apps.fleet.tables import is_csv, read_table
from flinders.core.calibration_file import (
    Correction,
    Document,
    FindingRecord,
    Fitted,
    HeadingErrorRecord,
    Recorded,
)
from flinders.core.units import COUNTS, Unit
from flinders.errors import DocumentError, FitError, UsageError
from flinders.findings.row import TUMBLE_ASSUMPTIONS

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

MAX_PROPOSED: Final = 3
"""Largest number of units that are proposed instead of an unknown one."""


class NoCalibration(FitError):
    """A unit without a calibration at a date (`recordings`: the verdicts of its recordings)."""

    code = "no-calibration"

    def __init__(self, unit: str, when: str, recordings: Sequence[str]) -> None:
        said = "; ".join(recordings) or "it was not recorded until then"
        super().__init__(f"{unit} has no calibration{when}: {said}; record it again", recordings=list(recordings))


@dataclass(frozen=True, slots=True)
class ValidCalibration:
    """The calibration that a unit had at a date."""

    row: UnitResult  # row with the calibration
    date_s: float  # date of its recording, s since 1970; NaN if no date is known
    next_s: float  # date of the next calibration, at which this one ends, s since 1970; NaN without a next one
    later: tuple[UnitResult, ...]  # recordings without a calibration between this one and the date

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready facts on the calibration that its file does not have."""
        return {
            "unit": self.row.unit,  # name of the sensor or vehicle
            "recording": self.row.recording,  # recording of the calibration
            "recorded_s": self.date_s,  # date of that recording, s since 1970
            "valid_until_s": self.next_s,  # date of the next calibration, s since 1970
            "verdict": self.row.verdict,  # `good` or `limited`
            "without_calibration": [row.recording for row in self.later],  # later recordings, refused or failed
        }


def rows_of(table: str | os.PathLike[str], unit: str) -> list[UnitResult]:
    """Rows of a unit in a table, Parquet or CSV.

    Raises `DocumentError` for a file that is no table of a fleet, and `UsageError` for a unit that is not in the table.
    """
    if is_csv(table):
        every = read_table(table)
        names = every.unit.tolist()
        rows = every[np.flatnonzero(every.unit == unit)]
    else:
        with contextlib.closing(TableRows(table)) as known:
            names = known.units()
            rows = UnitResults.from_arrow(known.of_units({unit}))
    if not len(rows):
        units = sorted({name for name in names if not name.startswith("(")})  # names in parentheses are files
        similar = get_close_matches(unit, units, MAX_PROPOSED)
        some = f"it has {', '.join(units[:MAX_PROPOSED])}{' …' * (len(units) > MAX_PROPOSED)}"
        words = f"did you mean {' or '.join(similar)}?" if similar else some
        raise UsageError(f"{table} has no unit {unit}: {words}")
    return [rows.row(place) for place in range(len(rows))]


def date_of(text: str) -> datetime:
    """Read a date or time in ISO 8601, in UTC unless it names a zone; a date without time is the end of that day.

    Raises `UsageError`.

    >>> date_of("2026-04-01").isoformat(), date_of("2026-04-01T12:30+02:00").isoformat()
    ('2026-04-01T23:59:59.999999+00:00', '2026-04-01T12:30:00+02:00')
    """
    try:
        date = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"date {text!r}: need one of ISO 8601, such as 2026-04-01 or 2026-04-01T12:30") from None
    if len(text) <= len("2026-04-01"):
        date = datetime.combine(date, time.max)
    return date if date.tzinfo else date.replace(tzinfo=UTC)


def calibration_at(rows: Sequence[UnitResult], unit: str, date: datetime | None = None) -> ValidCalibration:
    """The calibration of a unit that was valid at a date, by default the newest.

    Raises `NoCalibration` if the unit has none, and `UsageError` for a date if the recordings have no dates.
    """
    order = arrange([row.recording for row in rows], np.array([row.start_s for row in rows]))
    if not order.is_known or (date is not None and not order.is_dated):
        raise UsageError(
            f"the {'dates' if order.is_known else 'order'} of the recordings of {unit} are not known: put dates into "
            f"their names{', or ask for the newest without a date' if order.is_known else ''}"
        )
    timed = list(zip((rows[place] for place in order.places), order.date_s, strict=True))
    until = [(row, at) for row, at in timed if date is None or at <= date.timestamp()]
    places = [place for place, (row, _) in enumerate(until) if row.verdict in VERDICTS[:2]]
    if not places:
        when = "" if date is None else f" at {date:%Y-%m-%d}"
        raise NoCalibration(unit, when, [f"{row.recording} was {row.verdict} ({row.cause})" for row, _ in until])
    row, date_s = until[places[-1]]
    following = (at for other, at in timed[len(until) :] if other.verdict in VERDICTS[:2])
    return ValidCalibration(row, date_s, next(following, math.nan), tuple(one for one, _ in until[places[-1] + 1 :]))


def document_of(row: UnitResult, options: Mapping[str, Any]) -> Document:
    """The calibration file of a row; `options` are those of its table, empty if they are not known."""
    whole = np.zeros((9, 9))
    upper = np.triu_indices(9)
    whole[upper] = whole.T[upper] = row.covariance
    matrix = np.reshape(row.matrix, (3, 3)).tolist()
    given, axes = options.get("unit"), options.get("axes", "x,y,z")
    unit = Unit.of(given, options.get("scale")) if given else Unit.of("uT" if row.unit_of_field == "uT" else COUNTS)
    return Document(
        calibration=Correction(
            matrix=tuple(map(tuple, matrix)),  # type: ignore[arg-type]  # three rows of three
            offset=row.offset,  # type: ignore[arg-type]  # three
            field_strength=row.field_strength,
            unit=row.unit_of_field,  # type: ignore[arg-type]  # one of the two
        ),
        raw=Recorded(unit=unit.name, scale=unit.scale, axes=axes, sensor=row.unit),  # type: ignore[arg-type]
        fit=_fit_record(row, whole.tolist(), options),
    )


def _fit_record(row: UnitResult, covariance: Iterable[Sequence[float]], options: Mapping[str, Any]) -> Fitted:
    """Record of the fit in the file; the table has numbers for the first finding only."""
    number, limit = (None if math.isnan(value) else value for value in (row.number, row.limit))
    cause = [FindingRecord(code=row.cause, severity="limits", number=number, limit=limit)] if row.cause else []
    return Fitted(
        method=row.method,
        samples=row.samples,
        noise=row.noise,
        covariance=tuple(map(tuple, covariance)),
        verdict=row.verdict,  # type: ignore[arg-type]  # of a calibration
        heading_error_deg=HeadingErrorRecord(
            rms=row.rms_deg,
            worst=row.worst_deg,
            bound_95=None if math.isnan(row.bound_95_deg) else row.bound_95_deg,
            dip_deg=row.dip_deg,
            target_deg=options.get("target_deg"),
        ),
        coverage={} if math.isnan(row.coverage) else {"fraction": row.coverage},
        findings=tuple(cause),
        conditions=TUMBLE_ASSUMPTIONS,
    )


def options_of(table: str | os.PathLike[str]) -> Mapping[str, Any]:
    """Options that a table was made with; empty if they are not recorded."""
    try:
        return {} if is_csv(table) else ReadFiles.of_table(table).options
    except DocumentError:
        return {}
