"""What an exporter gives: text for a file, the same as fields, and how far the target's own formula is off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from flinders.coverage import fibonacci
from flinders.errors import NotExportable, figures
from flinders.units import label

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.calibration import Calibration

DIRECTIONS = 400
"""Test fields; enough that the worst error of a correction is missed by less than a hundredth of it."""

COARSEST_DEG = 1.0
"""Nothing is written for a target whose numbers cost as much as this angle does, in any direction."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far a target's own formula, with the numbers that are written for it, is off the calibration.

    Attributes
    ----------
    vectors : int
        Fields of the calibration's strength, in all directions, that it was tried on.
    worst : float, in the calibration's unit
        Largest length of the difference.
    worst_deg : float, degrees
        Largest angle between both.
    """

    vectors: int
    worst: float
    worst_deg: float

    @classmethod
    def of(cls, calibration: Calibration, target: Callable[[Floats], Floats]) -> Self:
        """Run the target's formula on what the sensor reads.

        Parameters
        ----------
        calibration : Calibration
        target : callable
            (N, 3) readings in recorded axes to (N, 3) corrected ones in the same, both in the calibration's unit.

        Raises
        ------
        NotExportable
            Where the target's numbers are so coarse that they cost as much as a degree does.
        """
        back = calibration.axes.apply(np.eye(3))  # Pᵀ, from mapped axes to recorded ones
        strength, expected = calibration.field_strength, fibonacci(DIRECTIONS)
        with np.errstate(all="ignore"):
            raw = calibration.unapply(strength * expected)
            found = calibration.axes.apply(target(raw @ back.T)) / strength
            across = np.linalg.norm(np.cross(found, expected), axis=1)
            angle = float(np.rad2deg(np.arctan2(across, np.sum(found * expected, axis=1))).max())
            share = float(np.linalg.norm(found - expected, axis=1).max())
        if not share <= math.sin(math.radians(COARSEST_DEG)):
            off = f"up to {share:.2g} times" if math.isfinite(share) else "more than"
            raise NotExportable(
                f"rounded to the target's numbers, readings would be off by {off} their length: a field of "
                f"{figures(strength)} {label(calibration.unit)} does not suit their steps. Check the "
                "unit of the recording, and --field-strength where it was given",
                beyond=(),
                error=strength * share,
            )
        return cls(DIRECTIONS, strength * share, angle)


@dataclass(frozen=True, slots=True)
class Export:
    """A calibration as a target wants it.

    Attributes
    ----------
    target : str
        Name of the exporter.
    text : str
        Content of the file.
    fields : dict
        The same for programs, ready for JSON.
    checked : str
        How far it is off, in words.
    warnings : tuple of str
        What to see to before it is used.
    """

    target: str
    text: str
    fields: dict[str, Any]
    checked: str
    warnings: tuple[str, ...] = ()


class Render(Protocol):
    """How a row of the table turns a calibration into an `Export`."""

    def __call__(self, calibration: Calibration, *, target: str, about: Sequence[str] = ()) -> Export:
        """Render; `target` is the name of the row, `about` are lines that tell where it comes from."""
