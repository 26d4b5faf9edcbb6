"""Where and when: the field of the earth at the place that options name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Recording


def site_of(place: str, date: str | None, recording: Recording | None = None) -> SiteField:
    """The field at a place on a day that is given, or that the clock of the recording tells.

    Raises
    ------
    UsageError
        For no place, no day, or one without a model.
    """
    from flinders.core.geomag import place_of, site_field, year_of

    where = place_of(place)
    return site_field(*where, year=year_of(_day(date, recording)))


def _day(date: str | None, recording: Recording | None) -> str:
    """The day as it is given, today, or by the clock of the recording.

    Raises
    ------
    UsageError
        Where nobody knows it.
    """
    import datetime

    if date is not None and date.strip().casefold() != "today":
        return date
    if date is not None:
        return datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    start = clock_start(recording)
    if start:
        return datetime.datetime.fromtimestamp(start, tz=datetime.UTC).date().isoformat()
    raise UsageError("the declination changes with the years: give the day of the recording, such as --date 2026-11-21")


def clock_start(recording: object) -> float:
    """Seconds from 1970 at which the times of a recording start to count; 0 where they count from something else."""
    layout = getattr(recording, "layout", None)
    time = layout.columns.time if layout is not None else None
    return float(time.start * time.factor) if time is not None else 0.0
