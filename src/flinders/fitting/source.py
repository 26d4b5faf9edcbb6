"""What `flinders.fit` takes as readings: recordings, their sums, arrays, and all that `flinders.read` reads.

>>> recording, _ = recording_of([[200, 100, -400], [300, 0, -300]], Unit.of("mG"), Axes.of("x,-y,-z"))
>>> recording.field[0]
array([ 20., -10.,  40.])
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import COUNTS, Unit
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.core.samples import Recording


def recording_of(
    source: Any,  # noqa: ANN401 - arrays, paths, frames of packages that need not be there
    unit: Unit | None = None,
    axes: Axes | None = None,
    sensor: str | None = None,
) -> tuple[Recording | Summary, str | None]:
    """Readings as a recording, in their unit and axes where those are given; and what their sensor is called.

    A recording and a Summary are returned as they are. Raises what `flinders.read` raises.
    """
    if isinstance(source, Summary) or hasattr(source, "blocks"):
        return cast("Recording | Summary", source), sensor
    if not _is_read(source):
        return Samples.of(source, unit=unit or COUNTS, axes=axes or Axes()), sensor
    from flinders.readers import Choice, open_recording

    recording = open_recording(
        source,
        unit=None if unit is None else unit.name,
        scale=unit.scale if unit is not None and (unit.name == COUNTS != unit.inside) else None,
        axes=str(axes or Axes()),
        sensor=Choice(sensor, is_name=True),
    )
    return recording, getattr(recording, "name", "") or sensor


def _is_read(source: object) -> bool:
    """Whether `flinders.read` reads it; the readers are imported only where it is no array."""
    if isinstance(source, np.ndarray):
        return False
    if isinstance(source, list | tuple):
        return bool(source) and isinstance(source[0], str | os.PathLike)
    from flinders.readers import is_source

    return is_source(source)
