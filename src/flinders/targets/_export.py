"""What a target is asked, what it writes, and how far the target's own formula is then off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from flinders.core.units import label
from flinders.errors import NotExportable, figures
from flinders.geometry.sphere import fibonacci

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.targets._affine import Acts

DIRECTIONS = 400
"""Test fields; enough that the worst error of a correction is missed by less than a hundredth of it."""

COARSEST_DEG = 1.0
"""Nothing is written unasked that costs such a heading error, or as much of the length."""

DIP_DEG = 60.0
"""Inclination of the field that heading errors are told for."""


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What is asked of a target besides the calibration.

    Attributes
    ----------
    compass : int, optional
        Which one, as the target counts; its first where it is not given.
    lossy : bool
        Write also what costs more than a degree of heading.
    name : str, optional
        Of the sensor: names in generated code begin with it, so that code for two sensors goes into one program.
    """

    compass: int | None = None
    lossy: bool = False
    name: str | None = None


NOTHING_MORE = ExportOptions()


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """A calibration in the numbers of a target.

    Attributes
    ----------
    apply : callable
        The target's formula with the numbers as it will hold them, in its units.
    body : sequence of str
        Lines of the file.
    values : mapping
        What is written, for programs.
    notes : sequence of str
        What else to know.
    data : bytes, optional
        Content of the file, where it is no text.
    compensated : callable, optional
        ``compensated(readings, value)``: the formula at a value of the motors' current or throttle, where it follows
        one.
    """

    apply: Callable[[Floats], Floats]
    body: Sequence[str]
    values: Mapping[str, Any]
    notes: Sequence[str] = ()
    data: bytes | None = None
    compensated: Callable[[Floats, float], Floats] | None = None


@dataclass(frozen=True, slots=True)
class Difference:
    """How far a target's own formula, with the numbers that are written for it, is off the calibration.

    Attributes
    ----------
    vectors : int
        Fields of the calibration's strength, in all directions, that it was tried on.
    worst : float, in the calibration's unit
        Largest length of the difference; where the target's lengths are its own, once they were scaled.
    worst_deg : float, degrees
        Largest angle between both.
    """

    vectors: int
    worst: float
    worst_deg: float

    @classmethod
    def of(
        cls,
        calibration: Calibration,
        target: Callable[[Floats], Floats],
        *,
        acts: Acts = "recorded",
        relative: bool = False,
        lacks: str = "",
        lossy: bool = False,
    ) -> Self:
        """Run the target's formula on what the sensor reads.

        Parameters
        ----------
        calibration : Calibration
        target : callable
            (N, 3) readings to (N, 3) corrected ones, both in the calibration's unit, in the axes that `acts` names.
        acts : str
            ``recorded``: in the axes as recorded; ``mapped``: in the calibration's; ``across``: from those to these.
        relative : bool
            Lengths are the target's own: what it gives is scaled to the calibration's field before it is compared.
        lacks : str
            What the target cannot hold, for the message of a refusal.
        lossy : bool
            Accept any heading error of what it cannot hold, and of rounding all but an error as long as the reading.

        Raises
        ------
        NotExportable
            Where the target's numbers cost as much as a degree does, of heading or of length.
        """
        back = calibration.axes.apply(np.eye(3))  # Pᵀ, from mapped axes to recorded ones
        strength, expected = calibration.field_strength, fibonacci(DIRECTIONS)
        with np.errstate(all="ignore"):
            raw = calibration.unapply(strength * expected)
            corrected = target(raw if acts == "mapped" else raw @ back.T) / strength
            if acts == "recorded":
                corrected = calibration.axes.apply(corrected)
            if relative:
                corrected = corrected * (np.sum(corrected * expected) / np.sum(corrected**2))
            across = np.linalg.norm(np.cross(corrected, expected), axis=1)
            angle = float(np.rad2deg(np.arctan2(across, np.sum(corrected * expected, axis=1))).max())
            share = float(np.linalg.norm(corrected - expected, axis=1).max())
        deviation = cls(DIRECTIONS, strength * share, angle)
        if lacks:
            if not math.isfinite(share) or (deviation.heading_deg > COARSEST_DEG and not lossy):
                raise deviation._lost(lacks)
        elif not (share <= math.sin(math.radians(COARSEST_DEG)) or (lossy and share < 1)):
            off = f"up to {share:.2g} times" if math.isfinite(share) else "more than"
            raise NotExportable(
                f"rounded to the target's numbers, readings would be off by {off} their length: a field of "
                f"{figures(strength)} {label(calibration.unit)} does not suit their steps. Check the "
                "unit of the recording, and --field-strength where it was given",
                beyond=(),
                error=strength * share,
            )
        return deviation

    def worse(self, other: Difference) -> Difference:
        """The worse of two trials."""
        return Difference(self.vectors, max(self.worst, other.worst), max(self.worst_deg, other.worst_deg))

    @property
    def heading_deg(self) -> float:
        """Largest heading error at any attitude where the field dips by 60°: atan(tan a / cos 60°) of the angle a."""
        if not self.worst_deg < 90:
            return 180.0
        return math.degrees(math.atan(math.tan(math.radians(self.worst_deg)) / math.cos(math.radians(DIP_DEG))))

    def _lost(self, lacks: str) -> NotExportable:
        off = f"{figures(self.heading_deg)}°" if math.isfinite(self.heading_deg) else "any angle"
        return NotExportable(
            f"{lacks}: what is left out costs up to {off} of heading (at any attitude, dip {DIP_DEG:.0f}°). Use a "
            "target that holds the whole matrix (flinders targets), correct the readings in your own code, or write "
            "it all the same with --lossy",
            beyond=("matrix",),
            heading_deg=self.heading_deg,
        )


@dataclass(frozen=True, slots=True)
class Export:
    """A calibration as a target wants it.

    Attributes
    ----------
    target : str
        Name of the target.
    text : str
        Content of the file; of one in bytes, what is in it, for people.
    fields : dict
        The same for programs, ready for JSON.
    checked : str
        How far it is off, in words.
    warnings : tuple of str
        What to see to before it is used.
    data : bytes, optional
        Content of the file where it is no text.
    has_comments : bool
        The text says what is known of it in comments; otherwise that has to be said beside it.
    """

    target: str
    text: str
    fields: dict[str, Any]
    checked: str
    warnings: tuple[str, ...] = ()
    data: bytes | None = None
    has_comments: bool = True

    @property
    def content(self) -> str | bytes:
        """Content of the file."""
        return self.text if self.data is None else self.data
