"""Test of whether readings suit the calibration that corrects them, by the length of the corrected field.

For suitable readings the mean length of corrected readings is about that of the field, and the spread of lengths is
what noise and claim of the calibration explain. Another sensor, another unit, added or removed iron, and a dead axis
change the lengths.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble, other = (simulate.tumble(seed=seed) for seed in (1, 2))
>>> fit = calibrate.fit(tumble.samples)
>>> for recording in (tumble, other):
...     corrector = CorrectionMonitor(fit, recording.samples.source)
...     _ = corrector(recording.samples.field)
...     print([note.code for note in corrector.notes()])
[]
['unsuited']
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.comparison import LengthSums
from flinders.errors import InputError
from flinders.readers._likeness import describe_doubt
from flinders.workflows.notes import Note

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

MAX_LENGTH_RATIO: Final = 3.0
"""Largest factor by which the first corrected readings may be too long or too short.

Beyond it they are refused as readings of another sensor or unit.
"""

MAX_STRENGTH_RATIO: Final = 1.3
"""Largest factor between the mean length of corrected readings and the calibration's field strength."""

MAX_SPREAD: Final = 0.1
"""Largest limit of the relative spread of lengths; it applies to a calibration without a stated uncertainty."""

MAX_SPREAD_RATIO: Final = 3.0
"""Largest ratio of the measured spread of lengths to the spread that noise and claim explain.

Of 992 suitable recordings none exceeds it (``python -m benchmarks.suitability``).
"""

MIN_SPREAD: Final = 0.02
"""Smallest limit of the relative spread: a spread of 2 % can change a heading by 3° and more."""

MAX_DEVIATION_SPREADS: Final = 3.0
"""Largest deviation of an inlier from the median length, in multiples of `spread_limit`."""

MAX_OUTLIER_SHARE: Final = 0.1
"""Largest share of outliers among suitable readings."""

MIN_READINGS: Final = 100
"""Smallest number of readings for the test for a stuck axis."""


class CorrectionMonitor:
    """Correction by a fit, block by block, with a test of whether the result is plausible.

    `strength` has the statistics of all corrected readings, and `inliers` those without the outliers of each block.
    `spread_limit` is the largest spread of lengths for suitable readings.
    """

    def __init__(self, fit: Fit, source: str) -> None:
        self._calibration, self._source, self.spread_limit = fit.calibration, source, spread_limit(fit)
        self._resembles, self._columns = "", ""
        self.strength = LengthSums()
        self.inliers = LengthSums()
        self._lowest, self._highest = np.full(3, math.inf), np.full(3, -math.inf)

    def __call__(self, readings: Floats) -> Floats:
        """Correct (N, 3) readings, in the calibration's unit and axes.

        Raises `InputError` if the first block is from another sensor or in another unit.
        """
        corrected = self._calibration.apply(readings)
        strength = np.linalg.norm(corrected, axis=1) / self._calibration.field_strength
        middle = float(np.median(strength))
        if self.strength.readings == 0 and not 1 / MAX_LENGTH_RATIO < middle < MAX_LENGTH_RATIO:
            raise InputError(
                f"corrected readings of {self._source} are {middle:.2g} times as long as the calibration's field "
                f"({self._calibration.field_strength:.4g} {self._calibration.unit}): the calibration is for another "
                "sensor, unit or range; calibrate this sensor, or name its columns",
                hint={"columns": None},
            )
        self._lowest = np.fmin.reduce(np.vstack([self._lowest, readings]))
        self._highest = np.fmax.reduce(np.vstack([self._highest, readings]))
        self.strength += LengthSums.of(strength)
        self.inliers += LengthSums.of(strength[np.abs(strength - middle) <= MAX_DEVIATION_SPREADS * self.spread_limit])
        return corrected

    def check_resemblance(self, samples: Samples) -> None:
        """Test whether samples without a stated quantity look like a quantity other than a magnetic field."""
        if samples.nameless and not self._resembles:
            self._resembles, self._columns = describe_doubt(samples), samples.nameless

    @property
    def is_plausible(self) -> bool:
        """Whether mean and spread of the corrected lengths, outliers excluded, are within their limits."""
        readings, inliers = self.strength.readings, self.inliers
        if inliers.readings < (1.0 - MAX_OUTLIER_SHARE) * readings:
            return False
        is_strong = 1 / MAX_STRENGTH_RATIO < inliers.mean < MAX_STRENGTH_RATIO
        return not readings or (is_strong and inliers.spread < self.spread_limit)

    @property
    def stuck_axes(self) -> dict[str, float]:
        """Value of each axis that is constant in all readings, by axis."""
        if self.strength.readings < MIN_READINGS:
            return {}
        extremes = zip("xyz", self._lowest.tolist(), self._highest.tolist(), strict=True)
        return {axis: lowest for axis, lowest, highest in extremes if lowest == highest}

    def notes(self) -> tuple[Note, ...]:
        """Notes on unsuitable readings and on possible causes; empty for suitable readings."""
        readings = self.strength.readings
        if self._resembles:
            return (Note("looks-like", "limits", {"what": self._resembles, "columns": self._columns}),)
        if stuck := self.stuck_axes:
            axes = ", ".join(f"{axis} = {value:g}" for axis, value in stuck.items())
            return (Note("stuck", "limits", {"readings": readings, "axes": axes}),)
        if self.is_plausible:
            return ()
        seen = {"strength": self.strength.mean, "spread": self.strength.spread, "limit": self.spread_limit}
        return (Note("unsuited", "limits", seen),)


def spread_limit(fit: Fit) -> float:
    """Largest spread of lengths that the noise and the claim of a fit allow."""
    if not fit.claim.states_uncertainty:
        return MAX_SPREAD
    noise = fit.evidence.noise / fit.calibration.ellipsoid.radius
    claimed = math.radians(fit.claim.direction_error_deg.worst)  # at any attitude
    return min(max(MAX_SPREAD_RATIO * math.hypot(noise, claimed), MIN_SPREAD), MAX_SPREAD)
