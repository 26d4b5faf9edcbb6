"""Difference between a calibration and the correction by a target, in corrected fields and in headings.

>>> from flinders.core.calibration import Calibration
>>> calibration = Calibration(np.eye(3), [20.0, 0.0, 0.0], 50.0)
>>> difference = Difference.of(calibration, correct_fields(calibration, lambda raw: raw - [19.0, 0.0, 0.0], DIRECTIONS))
>>> round(difference.worst, 3), round(difference.worst_deg, 2)
(1.0, 1.15)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.units import unit_label
from flinders.errors import NotExportable, figures
from flinders.geometry.sphere import fibonacci
from flinders.targets._numbers import Acts, unmapping_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.targets._mounting import MountingTable

DIRECTIONS: Final = fibonacci(400)
"""(N, 3) directions of the test fields. With 400 of them, the largest error is found to within 1 %."""
MAX_LOSS_DEG: Final = 0.5
"""Largest heading error in degrees that parts which the target omits may cause without `lossy`."""
MAX_ROUNDING_DEG: Final = 1.0
"""Angle in degrees whose sine is the largest accepted error by rounding, relative to the field."""
DIP_DEG: Final = 60.0
"""Dip of the field in degrees for which heading errors are stated."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Largest error of a target's formula, with the target's own numbers, compared with the calibration."""

    # largest difference of corrected vectors, in the calibration's unit; lengths are scaled if the target defines its
    # own
    worst: float
    worst_deg: float  # largest angle between the vectors, in degrees

    @classmethod
    def of(cls, calibration: Calibration, corrected: Floats) -> Self:
        """Compare fields that `correct_fields` returned for `DIRECTIONS` with the calibration."""
        with np.errstate(all="ignore"):
            across = np.linalg.norm(np.cross(corrected, DIRECTIONS), axis=1)
            angle = float(np.rad2deg(np.arctan2(across, np.sum(corrected * DIRECTIONS, axis=1))).max())
            worst = calibration.field_strength * float(np.linalg.norm(corrected - DIRECTIONS, axis=1).max())
        return cls(worst, angle)

    def worst_of(self, other: Difference) -> Difference:
        """The larger errors of two trials."""
        return Difference(max(self.worst, other.worst), max(self.worst_deg, other.worst_deg))

    @property
    def heading_deg(self) -> float:
        """Largest heading error in degrees at any attitude for a dip of 60°: atan(tan `worst_deg` / cos 60°)."""
        return heading_deg(self.worst_deg)

    def refuse_lost(
        self, lacks: str, *, lossy: bool, mountings: MountingTable | None = None, fitting: str = ""
    ) -> None:
        """Raise `NotExportable` if omitted parts cause a large heading error, unless `lossy`.

        `mountings` are those of a target that could contain the rotation. `fitting` is the command that fits a
        calibration which the target can represent, if there is one.
        """
        if math.isfinite(self.worst) and (lossy or self.heading_deg <= MAX_LOSS_DEG):
            return
        off = f"{figures(self.heading_deg)}°" if math.isfinite(self.heading_deg) else "any angle"
        turned = mountings and (
            f"State how the sensor was mounted during the recording (its {mountings.setting}), so that its rotation is "
            "written with the numbers. "
        )
        fitted = f"Make a fit within these limits, which states its own accuracy: {fitting}. Or " if fitting else ""
        raise NotExportable(
            f"{lacks}: the omitted parts cause a heading error of up to {off} (at any attitude, dip {DIP_DEG:.0f}°). "
            f"{turned or ''}{fitted}{'use' if fitted else 'Use'} a target that holds the whole matrix (flinders "
            "targets), correct the readings in your own code, or write it anyway",
            hint={"mounting": None, "lossy": True} if mountings else {"lossy": True},
            beyond=("matrix",),
            heading_deg=self.heading_deg,
        )

    def refuse_coarse(self, calibration: Calibration, *, lossy: bool) -> None:
        """Refuse rounding errors above sin 1° of the field strength; with `lossy`, only those above the strength.

        Raises `NotExportable`.
        """
        strength = calibration.field_strength
        share = self.worst / strength
        if share <= math.sin(math.radians(MAX_ROUNDING_DEG)) or (lossy and share < 1):
            return
        off = f"up to {share:.2g} times" if math.isfinite(share) else "more than"
        raise NotExportable(
            f"the target rounds numbers too coarsely for a field of {figures(strength)} "
            f"{unit_label(calibration.unit)}: readings would be off by {off} their length. Record in counts or nT if "
            "the target takes whole numbers; else check the unit of the recording, and the field strength if it was "
            "given",
            hint={"unit": None, "site": None},
            beyond=(),
            error=self.worst,
        )


def correct_fields(
    calibration: Calibration,
    target: Callable[[Floats], Floats],
    directions: Floats,
    *,
    acts: Acts = "recorded",
    relative: bool = False,
) -> Floats:
    """(N, 3) fields relative to their strength, as a target corrects the sensor's readings in (N, 3) directions.

    `target` maps (N, 3) readings to (N, 3) corrected ones, both in the calibration's unit and in the axes that `acts`
    names. With `relative` the lengths of its results are arbitrary, and scaled to the calibration's field strength. The
    returned fields are in the axes of the calibration's corrected readings.
    """
    back, strength = unmapping_matrix(calibration), calibration.field_strength
    with np.errstate(all="ignore"):
        raw = calibration.unapply(strength * directions)
        corrected = target(raw if acts == "mapped" else raw @ back.T) / strength
        if acts == "recorded":
            corrected = calibration.axes.apply(corrected)
        if relative:
            corrected = corrected * (np.sum(corrected * directions) / np.sum(corrected**2))
    return corrected


def heading_deg(angle_deg: float) -> float:
    """Largest heading error, at any attitude and for a dip of 60°, of a field whose direction is wrong by an angle.

    >>> round(heading_deg(0.1), 3), heading_deg(90.0)
    (0.2, 180.0)
    """
    if not angle_deg < 90:
        return 180.0
    return math.degrees(math.atan(math.tan(math.radians(angle_deg)) / math.cos(math.radians(DIP_DEG))))
