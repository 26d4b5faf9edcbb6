"""Recordings that are kept in memory where they are short enough.

>>> in_memory = Cached(Samples(np.ones((5, 3))), room=10)
>>> [len(block) for block in in_memory.blocks()], in_memory.in_memory().field.shape
([5], (5, 3))
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Joined, Samples, Wrapped

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

HELD: Final = 500_000
"""Readings that are kept in memory, 16 MB with times, 76 MB with all columns; what is longer is gone through again."""


class Cached(Wrapped):
    """A recording that remembers its readings on the first pass, unless there are too many.

    Attributes
    ----------
    recording : Recording
    room : int
        Readings that may be remembered.
    """

    def __init__(self, recording: Recording, room: int) -> None:
        self.recording = recording
        self.room = room
        self._blocks: list[Samples] | None = None

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording and keep its readings as long as there is room."""
        self._blocks, rows = [], 0
        for block in self.recording.blocks():
            rows += len(block)
            if rows > self.room:
                self._blocks = None
            if self._blocks is not None:
                self._blocks.append(block)
            yield block

    def in_memory(self) -> Recording:
        """The readings, or the recording itself where they were too many."""
        return self.recording if self._blocks is None else concatenated(self._blocks, self)


def together(recordings: Sequence[Recording]) -> tuple[Recording, Sequence[Recording]]:
    """Several recordings as one, and each of them.

    Where all are in memory and not too long, so is the whole, and each is a view of it; else the whole goes through
    them in turn.
    """
    joined = Joined(tuple(recordings))
    in_memory = [recording for recording in recordings if isinstance(recording, Samples)]
    if len(in_memory) < len(recordings) or sum(map(len, in_memory)) > HELD:
        return joined, recordings
    whole = concatenated(in_memory, joined)
    ends = np.cumsum([len(part) for part in in_memory])
    return whole, [
        replace(part, field=whole.field[end - len(part) : end]) for part, end in zip(in_memory, ends, strict=True)
    ]


def concatenated(blocks: Sequence[Samples], recording: Recording) -> Samples:
    """All columns of the blocks of a recording; none of those that one of them lacks."""
    filled = [block for block in blocks if len(block)]
    return Samples(
        np.concatenate([np.empty((0, 3)), *(block.field for block in filled)]),
        unit=recording.unit,
        axes=recording.axes,
        time=_whole([block.time for block in filled]),
        acceleration=_whole([block.acceleration for block in filled]),
        rate=_whole([block.rate for block in filled]),
        temperature=_whole([block.temperature for block in filled]),
        current=_whole([block.current for block in filled]),
        strength=_whole([block.strength for block in filled]),
        throttle=_whole([block.throttle for block in filled]),
        attitude=_whole([block.attitude for block in filled]),
        currents=_whole([block.currents for block in filled]),
        throttles=_whole([block.throttles for block in filled]),
        source=recording.source,
    )


def _whole(columns: Sequence[Floats | None]) -> Floats | None:
    """Put a column of several blocks together, if each has it."""
    there = [column for column in columns if column is not None]
    return np.concatenate(there) if there and len(there) == len(columns) else None
