"""A recording of more readings than are held in memory: read from its tables each time it is gone through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flinders.fleet.gaps import opened_as_planned
from flinders.fleet.lots import Wanted, moved, refuse_other_unit
from flinders.fleet.tables import KeyedTable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.core.axes import Axes
    from flinders.core.samples import Samples
    from flinders.core.units import Unit
    from flinders.fleet.plan import Partition
    from flinders.fleet.tables import Asked, Pair


@dataclass(frozen=True, slots=True, eq=False)
class Streamed:
    """A recording that is read from files of rows each time it is gone through.

    Attributes
    ----------
    partition : Partition
        The files.
    pair : (str, str)
        Unit and recording.
    asked : Asked
    unit : Unit
    axes : Axes
    start_s : float, s
        What its times count from.
    """

    partition: Partition
    pair: Pair
    asked: Asked
    unit: Unit
    axes: Axes
    start_s: float

    @classmethod
    def of(cls, partition: Partition, pair: Pair, asked: Asked) -> Streamed:
        """Look at the first file."""
        with opened_as_planned(partition.pieces[0], asked) as file:
            table = KeyedTable.of(file, asked)
            return cls(partition, pair, asked, table.recording.unit, table.recording.axes, table.start_s)

    @property
    def source(self) -> str:
        """Unit and recording."""
        return " ".join(filter(None, self.pair))

    def blocks(self) -> Iterator[Samples]:
        """Go through its readings."""
        for piece in self.partition.pieces:
            wanted = Wanted(self.partition, (self.pair,))
            with opened_as_planned(piece, self.asked) as file:
                table = KeyedTable.of(file, self.asked)
                first = self.partition.pieces[0].member.name
                refuse_other_unit(piece.member.name, table.recording.unit, first, self.unit)
                for runs, values in table.batches(piece.groups, wanted.names):
                    mask = np.repeat(wanted.mask(runs.numbers), runs.lengths)
                    if mask.any():
                        samples = table.samples(values[:, mask], self.source)
                        yield moved(samples, table.start_s - self.start_s)
