"""Options of a fleet: reading of its recordings, and judgement of their fits."""

from __future__ import annotations

from dataclasses import dataclass

from flinders.core.axes import Axes
from flinders.core.units import COUNTS, Unit
from flinders.readers._asked_columns import parse_columns


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `flinders fleet` and `flinders.fit_many`: reading of recordings, and judgement of fits.

    >>> Options(axes="x,x,z").check()
    Traceback (most recent call last):
        ...
    flinders.errors.AxesError: axes 'x,x,z': need x, y and z once each with signs, such as 'x,-y,-z' or '-y,x,z'
    """

    # as for `flinders.open_recording`
    columns: str | None = None
    unit: str | None = None
    scale: float | None = None
    axes: str = "x,y,z"
    sensor: str | None = None
    as_logged: bool = False
    # names of the columns of a table, or parts ``name=value`` of its path, with unit, recording and hardware batch
    unit_column: str | None = None
    recording_column: str | None = None
    batch_column: str | None = None
    # as for `flinders.fit`
    target_deg: float = 1.0
    dip_deg: float = 60.0

    def check(self) -> None:
        """Refuse options that are not valid for any recording.

        Raises `UsageError`.
        """
        if self.unit is not None or self.scale is not None:
            Unit.of(COUNTS if self.unit is None else self.unit, self.scale)
        Axes.of(self.axes)
        if self.columns is not None:
            parse_columns(self.columns)
