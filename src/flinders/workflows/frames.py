"""Correction of a data frame: a copy of the frame with corrected columns, and optionally with headings.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> calibration = calibrate.fit(tumble.samples).calibration
>>> corrected = correct_frame(calibration, tumble.samples.as_columns(), heading=True)
>>> list(corrected)[:4], list(corrected)[-1]
(['time_s', 'mag_x_uT', 'mag_y_uT', 'mag_z_uT'], 'heading_deg')
>>> bool(np.allclose(corrected["mag_x_uT"], calibration.apply(tumble.samples.field)[:, 0]))
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.frames import labels_of, with_columns
from flinders.core.silence import find_silent
from flinders.errors import NoAccelerometer, UnknownParameter, UsageError, did_you_mean
from flinders.fitting.result import bare_fit
from flinders.readers._table import TableRecording, named_part
from flinders.workflows.correction import apply
from flinders.workflows.heading_series import headings
from flinders.workflows.recordings import open_with

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit
    from flinders.readers._asked_columns import AnyColumns

OPTIONS: Final = ("columns", "heading", "level")
"""Options for a frame, which are suggested for mistyped keywords."""

HEADING_COLUMN: Final = "heading_deg"
"""Name of the column of headings, as in the output of `flinders headings`."""


def correct_frame(
    calibration: Calibration,
    frame: Any,  # noqa: ANN401 - of packages that need not be there
    *,
    columns: AnyColumns | None = None,
    heading: bool = False,
    level: bool = False,
    given: Mapping[str, ArrayLike | None] | None = None,
) -> Any:  # noqa: ANN401
    """Correct the magnetometer's columns of a frame; parameters and errors are those of `Calibration.apply`.

    `given` are values of disturbances. They are refused, since a frame has them as columns.
    """
    if names := [name for name, values in (given or {}).items() if values is not None]:
        for name in names:
            if like := did_you_mean(name, OPTIONS):
                raise UnknownParameter(f"Calibration.apply has no parameter {name!r}{like}")
        raise UsageError(f"a frame has {' and '.join(names)} as columns: leave it out", hint=dict.fromkeys(names))
    fit = bare_fit(calibration)
    table = open_with(fit, frame, columns=columns)
    assert isinstance(table, TableRecording)
    if table.columns.device is not None:
        raise UsageError(f"{table.source} has readings of several sensors in its rows: give the rows of one")
    is_usable = _usable_rows(table)
    field = apply(table, fit).samples.field / table.unit.scale
    changed = _output_columns(frame, table.columns.field.names, _expand(field, is_usable))
    if heading or level:
        if HEADING_COLUMN in labels_of(frame):
            raise UsageError(f"{table.source} has a column {HEADING_COLUMN}: rename it first")
        changed[HEADING_COLUMN] = _expand(_headings(table, fit, level=level), is_usable)
    return with_columns(frame, changed)


def _headings(table: TableRecording, fit: Fit, *, level: bool) -> Floats:
    """(N,) magnetic headings of the usable rows, in degrees."""
    try:
        return headings(table, fit, level=level).headings.magnetic_deg
    except NoAccelerometer as error:
        raise NoAccelerometer(error.message, hint={"level": True}) from None


def _usable_rows(table: TableRecording) -> NDArray[np.bool_]:
    """(N,) booleans: whether a row is a usable reading, as in `Samples.recorded`."""
    fields = [table.columns.readings(values.T) for values in table.table.rows(table.columns.cells)]
    field = np.concatenate(fields)
    usable: NDArray[np.bool_] = np.isfinite(field).all(axis=1) & ~find_silent(field)
    return usable


def _expand(values: Floats, is_usable: NDArray[np.bool_]) -> Floats:
    """(N,) or (N, 3) values for all rows, from those of the usable rows; NaN in other rows."""
    whole = np.full((len(is_usable), *values.shape[1:]), np.nan)
    whole[is_usable] = values
    return whole


def _output_columns(frame: Any, names: tuple[str, ...], field: Floats) -> dict[Any, Floats]:  # noqa: ANN401
    """Columns for (N, 3) corrected readings: three columns, or one column with three components."""
    labels = labels_of(frame)
    if all(name in labels for name in names):
        return {labels[name]: column for name, column in zip(names, field.T, strict=True)}
    whole = next(label for label in labels if names == tuple(named_part(label, part, 3) for part in range(3)))
    return {labels[whole]: field}
