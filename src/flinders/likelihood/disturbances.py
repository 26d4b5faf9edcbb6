"""What moves the offset from outside: currents, throttle, temperature.

A disturbance c adds p c to every reading, with one vector p for each; a temperature may change the scale as well, by
the factor 1 + a τ. Columns are taken about their mean, so that the offset found is that at the disturbances' mean,
which stands in `reference`.

When to use it: the disturbance changes while the readings are made, and not in step with the attitude. One that stays
the same cannot be told from the offset, see `constant`.

Source: linear compensation by current or throttle as in ArduPilot's compassmot and PX4's CAL_MAG_COMP_TYP.

>>> motors = Disturbances.of({"current": np.array([0.0, 10.0, 20.0]), "other": np.array([3.0, 3.0, 3.0])})
>>> motors.names, motors.columns[:, 0], motors.constant
(('current', 'other'), array([-10.,   0.,  10.]), ('other',))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Disturbances:
    """Columns beside the readings.

    Attributes
    ----------
    names : tuple of str
        One for each column.
    columns : (N, m) float
        About their mean.
    reference : (m,) float
        That mean.
    warmth : (N,) float, °C, optional
        Departure of the temperature from its mean where the scale may follow it.
    """

    names: tuple[str, ...]
    columns: Floats
    reference: Floats
    warmth: Floats | None = None

    @classmethod
    def of(cls, columns: Mapping[str, Floats], *, warmth: Floats | None = None) -> Self:
        """Take columns by name; a value that is not known counts as the mean."""
        table = np.stack([np.asarray(column, float) for column in columns.values()], axis=1)
        reference = np.nanmean(table, axis=0)
        about = None if warmth is None else np.nan_to_num(warmth - np.nanmean(warmth))
        return cls(tuple(columns), np.nan_to_num(table - reference), reference, about)

    @property
    def constant(self) -> tuple[str, ...]:
        """Those that never change, and so say nothing."""
        still = np.ptp(self.columns, axis=0) <= 1e-9 * np.maximum(np.abs(self.reference), 1e-300)
        return tuple(name for name, stays in zip(self.names, still, strict=True) if stays)

    def without(self, names: tuple[str, ...]) -> Self | None:
        """Leave some out; None if nothing is left."""
        kept = [index for index, name in enumerate(self.names) if name not in names]
        if not kept and self.warmth is None:
            return None
        chosen = tuple(self.names[index] for index in kept)
        return type(self)(chosen, self.columns[:, kept], self.reference[kept], self.warmth)
