"""Several recordings of one sensor as one recording, and the blocks of a recording as one table in memory.

>>> early, late = Samples.of([[1, 2, 3]]), Samples.of([[4, 5, 6]])
>>> both = join_recordings([early, late])
>>> read_into_memory(both).field.tolist(), len(list(single_recordings(both)))
([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.core.named_columns import are_words
from flinders.core.samples import COLUMNS, Recording, Samples, frame_of, merge_skipped, onboard_of
from flinders.errors import AxesError, UnitError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.calibration import Calibration
    from flinders.core.units import Unit


@dataclass(frozen=True, slots=True)
class Joined:
    """Several recordings of one sensor, one after the other, all in one unit and one set of axes.

    Raises
    ------
    UnitError
        If one recording is in µT and another in counts.
    AxesError
        If one recording is in axes of the vehicle and another in axes of the sensor.
    """

    recordings: tuple[Recording, ...]  #: at least one; all in one unit and one set of axes

    def __post_init__(self) -> None:
        """Refuse recordings in different units or axes."""
        first = self.recordings[0]
        for other in self.recordings[1:]:
            if other.unit.inside != first.unit.inside:
                raise UnitError(
                    f"{other.source} is in {other.unit.inside}, {first.source} in {first.unit.inside}: "
                    "name one unit for all, or the scale of counts",
                    hint={"unit": None, "scale": None},
                )
            if frame_of(other) != frame_of(first):
                raise AxesError(
                    f"{other.source} is in the axes of the {frame_of(other)}, {first.source} in those of the "
                    f"{frame_of(first)}: only recordings in the same axes go together; calibrate each by itself"
                )

    @property
    def source(self) -> str:
        """Sources of all recordings, joined by a plus."""
        return " + ".join(recording.source for recording in self.recordings)

    @property
    def unit(self) -> Unit:
        """Unit of the first recording."""
        return self.recordings[0].unit

    @property
    def axes(self) -> Axes:
        """Axes of the first recording."""
        return self.recordings[0].axes

    @property
    def frame(self) -> str:
        """Frame of all recordings."""
        return frame_of(self.recordings[0])

    @property
    def onboard(self) -> Calibration | None:
        """Onboard calibration, if that of all recordings is the same except for the field strength; else None."""
        first, *others = map(onboard_of, self.recordings)
        if first is None or None in others:
            return None
        alike = [replace(other, field_strength=first.field_strength) for other in others if other is not None]
        return first if all(map(first.isclose, alike)) else None

    def blocks(self) -> Iterator[Samples]:
        """Yield the blocks of all recordings in order."""
        for recording in self.recordings:
            yield from recording.blocks()


def join_recordings(recordings: Sequence[Recording]) -> Recording:
    """Join recordings of one sensor; a single recording stays as it is."""
    return Joined(tuple(recordings)) if len(recordings) > 1 else recordings[0]


def single_recordings(recording: Recording) -> Iterator[Recording]:
    """Yield the single recordings of a joined one; a joined recording among them is split, too."""
    if not isinstance(recording, Joined):
        yield recording
        return
    for part in recording.recordings:
        yield from single_recordings(part)


def concatenate(blocks: Sequence[Samples], recording: Recording) -> Samples:
    """Concatenate the blocks of a recording; a column that is missing in a block is left out.

    >>> early, late = Samples.of([[1, 2, 3]], time=[0.0]), Samples.of([[4, 5, 6]])
    >>> concatenate([early, late], early).field, concatenate([early, late], early).time is None
    (array([[1., 2., 3.],
           [4., 5., 6.]]), True)
    """
    filled = [block for block in blocks if len(block)]
    others: dict[str, Any] = {
        name: _concatenate_column([getattr(each, name) for each in filled]) for name in COLUMNS[1:]
    }
    return Samples(
        np.concatenate([np.empty((0, 3)), *(block.field for block in filled)]),
        unit=recording.unit,
        axes=recording.axes,
        source=recording.source,
        frame=frame_of(recording),
        skipped=reduce(merge_skipped, (block.skipped for block in blocks), ()),
        nameless=next((block.nameless for block in filled if block.nameless), ""),
        onboard=onboard_of(recording),
        auxiliary=_concatenate_auxiliary([block.auxiliary for block in filled]),
        **others,
    )


def _concatenate_auxiliary(blocks: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Concatenate the auxiliary columns that are numbers in all blocks, or words in all blocks."""
    first = blocks[0] if blocks else {}
    alike = [name for name in first if len({are_words(block[name]) for block in blocks if name in block}) == 1]
    return {name: np.concatenate([b[name] for b in blocks]) for name in alike if all(name in b for b in blocks)}


def _concatenate_column(columns: Sequence[Floats | None]) -> Floats | None:
    """Concatenate a column of several blocks; None if a block lacks it."""
    there = [column for column in columns if column is not None]
    return np.concatenate(there) if there and len(there) == len(columns) else None


def read_into_memory(recording: Recording) -> Samples:
    """Read a recording into memory."""
    return recording if isinstance(recording, Samples) else concatenate(list(recording.blocks()), recording)
