"""Conversion of columns of states, such as on and off, to 0 and 1, with the same two words in all recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.core.disturbance import is_column
from flinders.core.named_columns import are_words, numbers_of, states_of
from flinders.core.samples import Recording, RecordingWrapper

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.core.samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class NumericStates(RecordingWrapper):
    """A recording in which the words of states are converted to 0 and 1."""

    recording: Recording
    states: Mapping[str, tuple[str, ...]]  #: the two words of each column of states, by the name of the column

    def blocks(self) -> Iterator[Samples]:
        """Yield converted blocks."""
        for block in self.recording.blocks():
            yield convert_states(block, self.states)


def convert_states(samples: Samples, states: Mapping[str, tuple[str, ...]]) -> Samples:
    """Convert the words of states to 0 and 1.

    >>> from flinders.core.samples import Samples
    >>> parked = Samples.of([[1, 2, 3], [1, 2, 4]], auxiliary={"charger": ["idle", "charging"]})
    >>> convert_states(parked, column_states([parked], ["charger"])).auxiliary
    {'charger': array([0., 1.])}
    """
    there = {name: words for name, words in states.items() if name in samples.auxiliary}
    numbers = {name: numbers_of(samples.auxiliary[name], words, name) for name, words in there.items()}
    return replace(samples, auxiliary={**samples.auxiliary, **numbers})


def column_states(recordings: Sequence[Recording], names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """The two words of each column of states among `names`, over all recordings.

    Raises `InputError` for a column of words whose number of different words is not two.
    """
    words: dict[str, set[str]] = {}
    columns = list(filter(is_column, names))
    for recording in recordings if columns else ():
        for block in recording.blocks():
            for name in columns:
                values: NDArray[Any] | None = block.auxiliary.get(name)
                if values is not None and are_words(values):
                    words.setdefault(name, set()).update(np.unique(values).tolist())
    return {name: states_of(name, each) for name, each in words.items()}
