"""Options of a fleet run: how recordings are read, and how their fits are judged.

>>> Options(axes="x,x,z").check()
Traceback (most recent call last):
    ...
flinders.errors.AxesError: axes 'x,x,z': need x, y and z once each with signs, such as 'x,-y,-z' or '-y,x,z'
"""

from __future__ import annotations

from dataclasses import dataclass

from flinders.core.axes import Axes
from flinders.core.units import COUNTS, Unit
from flinders.readers._columns import asked_columns


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `flinders fleet` and `flinders.fit_many`.

    Attributes
    ----------
    columns, unit, scale, axes, sensor, as_logged
        As for `flinders.open_recording`.
    unit_column, recording_column, batch_column : str, optional
        Of a table: the column, or part ``name=value`` of its path, with the unit, the recording and the hardware batch.
    target_deg, dip_deg : float
        As for `flinders.fit`.
    polish : bool
        Go through the readings a second time; if not, use their sums alone.
    """

    columns: str | None = None
    unit: str | None = None
    scale: float | None = None
    axes: str = "x,y,z"
    sensor: str | None = None
    as_logged: bool = False
    unit_column: str | None = None
    recording_column: str | None = None
    batch_column: str | None = None
    target_deg: float = 1.0
    dip_deg: float = 60.0
    polish: bool = True

    def check(self) -> None:
        """Refuse options that no recording can be read with.

        Raises
        ------
        UsageError
        """
        Unit.of(COUNTS if self.unit is None else self.unit, self.scale)
        Axes.of(self.axes)
        if self.columns is not None:
            asked_columns(self.columns)
