"""Which directions a recording has seen, counted after a fit.

Directions need the centre, so they cannot be counted while readings stream by: the cells of a
`Cloud` are projected onto the sphere once an ellipsoid is known.

>>> seen = Coverage.of(np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 0.99], [1.0, 0.0, 0.0]]))
>>> seen.fraction, seen.readings, round(seen.hole_deg) > 90
(0.02, 3.0, True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.errors import NeedsRecording
from flinders.geometry.ellipsoid import centred
from flinders.geometry.sphere import around_z
from flinders.native.engine import engine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records
    from flinders.summary.cloud import Cloud
    from flinders.summary.summary import Summary

BANDS: Final = np.array([1, 15, 34, 34, 15, 1])


def _centres() -> Floats:
    heights = 1.0 - 0.02 * (np.cumsum(BANDS) - BANDS / 2.0)
    heights[[0, -1]] = 1.0, -1.0
    z = np.repeat(heights, BANDS)
    longitude = 2.0 * np.pi * np.concatenate([(np.arange(n) + 0.5) / n for n in BANDS])
    return around_z(z, longitude)


CELLS: Final = _centres()
"""(100, 3) centres of the cells: a cap, bands of 15, 34, 34 and 15, a cap, each one hundredth of the sphere."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Readings by direction, in a hundred cells of equal area."""

    #: (100,): readings in each of `CELLS`; None where the numbers come from a calibration file, which keeps no readings
    by_cell: Floats | None = None
    #: (3,): unit vector, corrected sensor axes: the middle of the largest gap
    hole: Floats = field(default_factory=lambda: np.full(3, math.nan))
    hole_deg: float = math.nan  #: angle from there to the nearest reading
    stated_fraction: float = math.nan  #: `fraction` where a file states it; NaN where it is not known

    @classmethod
    def of(cls, directions: Floats, counts: Floats | None = None) -> Self:
        """Count unit vectors (K, 3), each standing for `counts` readings."""
        readings = np.ones(len(directions)) if counts is None else counts
        return cls._of_record(engine().coverage(directions, readings, np.zeros(3), np.eye(3)))

    @classmethod
    def from_dict(cls, numbers: dict[str, float]) -> Self:
        """Take the numbers of a calibration file, as `as_dict` gives them; what is missing is NaN.

        >>> Coverage.from_dict({"fraction": 0.5, "hole_deg": 40.0}).as_dict()["fraction"]
        0.5
        """
        hole = np.array([numbers.get(f"hole_{axis}", math.nan) for axis in "xyz"])
        return cls(None, hole, numbers.get("hole_deg", math.nan), numbers.get("fraction", math.nan))

    @classmethod
    def through(cls, cloud: Cloud, ellipsoid: Ellipsoid, *, within: float = np.inf) -> Self:
        """Project the cells of a cloud onto the sphere that an ellipsoid stands for.

        Cells that lie farther from the ellipsoid than `within` and their own size hold readings that were rejected.
        """
        centre, shape = ellipsoid.centre, ellipsoid.shape
        return cls._of_record(
            engine().coverage(cloud.means, cloud.counts, centre, shape, side=cloud.side, within=within)
        )

    @classmethod
    def _of_record(cls, record: Records) -> Self:
        """Take a row of `flinders.native.layouts.COVERAGE`."""
        return cls(record["readings"], record["hole"], float(record["hole_deg"]))

    @property
    def counts(self) -> Floats:
        """(100,) readings in each of `CELLS`.

        Raises `NeedsRecording` where the numbers come from a calibration file.
        """
        if self.by_cell is None:
            raise NeedsRecording("the directions of the readings")
        return self.by_cell

    @property
    def fraction(self) -> float:
        """Share of the sphere's cells that hold a reading."""
        return self.stated_fraction if self.by_cell is None else float(np.count_nonzero(self.by_cell)) / 100.0

    @property
    def readings(self) -> float:
        """How many readings were counted."""
        return float(self.counts.sum())

    def facing(self, dip_deg: float) -> float:
        """The dip with the sign that the recording shows: a sensor mounted upside down sees the field come from below.

        Sensor axes need not be body axes, and a recording made mostly upright or mostly upside down says which way
        up is; one made all around says nothing, and either sign then gives the same error. Of few directions the mean
        is a matter of chance.
        """
        return engine().facing(self.counts, dip_deg)[0]

    def raw_strength(self, ellipsoid: Ellipsoid) -> tuple[float, float]:
        """Mean length of the raw readings over the directions recorded, and its spread as a fraction of the mean."""
        return self._strength(ellipsoid.centre + CELLS @ ellipsoid.shape)

    def corrected_strength(self, ellipsoid: Ellipsoid, calibration: Calibration) -> tuple[float, float]:
        """Mean length of readings corrected by a matrix and an offset, and its spread as a fraction of the mean."""
        return self._strength(calibration.affine.apply(ellipsoid.centre + CELLS @ ellipsoid.shape))

    def _strength(self, readings: Floats) -> tuple[float, float]:
        """Mean length of a reading in each cell, and its spread as a fraction of the mean."""
        lengths = np.linalg.norm(readings, axis=1)
        mean = float(np.average(lengths, weights=self.counts))
        spread = float(np.sqrt(np.average((lengths - mean) ** 2, weights=self.counts)))
        return mean, spread / mean

    def as_dict(self) -> dict[str, float]:
        """JSON-ready numbers; none where they are not known."""
        if math.isnan(self.fraction):
            return {}
        x, y, z = (round(float(part), 4) for part in self.hole)
        return {
            "fraction": self.fraction,
            "hole_deg": round(self.hole_deg, 3),
            "hole_x": x,  # direction of the middle of the largest gap
            "hole_y": y,  # the same
            "hole_z": z,  # the same
        }

    def __repr__(self) -> str:
        return f"Coverage({self.fraction:.0%} of the sphere, largest hole {self.hole_deg:.0f}°)"


class RecordCoverage(Coverage):
    """Coverage as a record of the engine states it: readings are counted by direction where somebody asks for that.

    Parameters
    ----------
    summary : Summary
        Of the same readings.
    ellipsoid : Ellipsoid
        Of the record.
    within : float
        As of `Coverage.through`.
    """

    def __init__(self, record: Records, summary: Summary, ellipsoid: Ellipsoid, within: float) -> None:
        super().__init__(None, record["hole"].copy(), float(record["hole_deg"]), float(record["coverage"]))
        vars(self)["_source"] = summary, ellipsoid, within

    @cached_property
    def counts(self) -> Floats:
        """(100,) readings in each of `CELLS`."""
        summary, ellipsoid, within = vars(self)["_source"]
        return Coverage.through(summary.cloud, ellipsoid, within=within).counts

    def __reduce__(self) -> tuple[type[Coverage], tuple[Floats, Floats, float]]:
        """Leave the readings behind where it is sent or copied."""
        return Coverage, (self.counts, self.hole, self.hole_deg)


def directions_of(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(K, 3) unit vectors of (K, 3) readings after correction."""
    corrected = np.linalg.inv(ellipsoid.shape) @ centred(readings, ellipsoid.centre)
    lengths = np.sqrt(np.einsum("ij,ij->j", corrected, corrected))
    corrected /= np.where(lengths > 0.0, lengths, 1.0)
    directions: Floats = np.ascontiguousarray(corrected.T)
    return directions


def cells_of(directions: Floats) -> NDArray[np.int64]:
    """(K,) index of the cell that each unit vector falls into."""
    return engine().cells_of(directions).astype(np.int64)
