"""Coverage of directions by a recording, counted after a fit.

Directions depend on the centre of the ellipsoid, which is not known while readings arrive. The cells
of a `Cloud` are projected onto the sphere once an ellipsoid is fitted.

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
from flinders.geometry.ellipsoid import subtract_centre
from flinders.geometry.sphere import from_longitudes
from flinders.native.engine import engine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records
    from flinders.summary.cloud import Cloud
    from flinders.summary.summary import Summary

BAND_CELLS: Final = np.array([1, 15, 34, 34, 15, 1])


def _cell_centres() -> Floats:
    heights = 1.0 - 0.02 * (np.cumsum(BAND_CELLS) - BAND_CELLS / 2.0)
    heights[[0, -1]] = 1.0, -1.0
    z = np.repeat(heights, BAND_CELLS)
    longitude = 2.0 * np.pi * np.concatenate([(np.arange(n) + 0.5) / n for n in BAND_CELLS])
    return from_longitudes(z, longitude)


CELL_CENTRES: Final = _cell_centres()
"""(100, 3) centres of the cells: a cap, bands of 15, 34, 34 and 15 cells, a cap; each is 1/100 of the sphere."""


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Number of readings by direction, in 100 cells of equal area."""

    #: (100,): number of readings in each of `CELL_CENTRES`; None if read from a calibration file, which has no readings
    by_cell: Floats | None = None
    #: (3,): unit vector, corrected sensor axes: the centre of the largest gap
    hole: Floats = field(default_factory=lambda: np.full(3, math.nan))
    hole_deg: float = math.nan  #: angle from `hole` to the nearest reading
    #: value of `fraction` that a calibration file states; NaN for a coverage that was counted
    stated_fraction: float = math.nan

    @classmethod
    def of(cls, directions: Floats, counts: Floats | None = None) -> Self:
        """Count (K, 3) unit vectors, with (K,) weights `counts`, by default 1."""
        readings = np.ones(len(directions)) if counts is None else counts
        return cls._of_record(engine().coverage(directions, readings, np.zeros(3), np.eye(3)))

    @classmethod
    def from_dict(cls, numbers: dict[str, float]) -> Self:
        """Make the coverage from a calibration file, in the form of `as_dict`; missing numbers are NaN.

        >>> Coverage.from_dict({"fraction": 0.5, "hole_deg": 40.0}).as_dict()["fraction"]
        0.5
        """
        hole = np.array([numbers.get(f"hole_{axis}", math.nan) for axis in "xyz"])
        return cls(None, hole, numbers.get("hole_deg", math.nan), numbers.get("fraction", math.nan))

    @classmethod
    def of_cloud(cls, cloud: Cloud, ellipsoid: Ellipsoid, *, within: float = np.inf) -> Self:
        """Project the cells of a cloud onto the sphere, by the correction of an ellipsoid.

        Cells with rejected readings are left out: those whose distance from the ellipsoid exceeds `within` plus their
        size.
        """
        centre, shape = ellipsoid.centre, ellipsoid.shape
        return cls._of_record(
            engine().coverage(cloud.means, cloud.counts, centre, shape, side=cloud.side, within=within)
        )

    @classmethod
    def _of_record(cls, record: Records) -> Self:
        """Make the coverage from a row of `flinders.native.layouts.COVERAGE`."""
        return cls(record["readings"], record["hole"], float(record["hole_deg"]))

    @property
    def counts(self) -> Floats:
        """(100,) number of readings in each of `CELL_CENTRES`.

        Raises `NeedsRecording` if the coverage is from a calibration file.
        """
        if self.by_cell is None:
            raise NeedsRecording("the directions of the readings")
        return self.by_cell

    @property
    def fraction(self) -> float:
        """Fraction of the cells that have a reading."""
        return self.stated_fraction if self.by_cell is None else float(np.count_nonzero(self.by_cell)) / 100.0

    @property
    def readings(self) -> float:
        """Number of counted readings."""
        return float(self.counts.sum())

    def facing(self, dip_deg: float) -> float:
        """Dip with the sign that it has in sensor axes: reversed if the sensor is mounted upside down.

        The sign follows from the mean direction of a recording that is mostly upright or mostly upside down. In a
        recording of all directions either sign gives the same heading error. With few directions the sign is random.
        """
        return engine().signed_dip(self.counts, dip_deg)[0]

    def raw_strength(self, ellipsoid: Ellipsoid) -> tuple[float, float]:
        """Mean length of raw readings over the covered directions, and its standard deviation relative to the mean."""
        return self._strength(ellipsoid.centre + CELL_CENTRES @ ellipsoid.shape)

    def corrected_strength(self, ellipsoid: Ellipsoid, calibration: Calibration) -> tuple[float, float]:
        """Mean length of corrected readings over the covered directions, and its relative standard deviation."""
        return self._strength(calibration.affine.apply(ellipsoid.centre + CELL_CENTRES @ ellipsoid.shape))

    def _strength(self, readings: Floats) -> tuple[float, float]:
        """Mean length of (100, 3) readings weighted by `counts`, and its standard deviation relative to the mean."""
        lengths = np.linalg.norm(readings, axis=1)
        mean = float(np.average(lengths, weights=self.counts))
        spread = float(np.sqrt(np.average((lengths - mean) ** 2, weights=self.counts)))
        return mean, spread / mean

    def as_dict(self) -> dict[str, float]:
        """JSON-ready numbers; empty if they are unknown."""
        if math.isnan(self.fraction):
            return {}
        x, y, z = (round(float(part), 4) for part in self.hole)
        return {
            "fraction": self.fraction,
            "hole_deg": round(self.hole_deg, 3),
            "hole_x": x,  # x of the unit vector to the centre of the largest gap
            "hole_y": y,  # y of the same vector
            "hole_z": z,  # z of the same vector
        }

    def __repr__(self) -> str:
        return f"Coverage({self.fraction:.0%} of the sphere, largest hole {self.hole_deg:.0f}°)"


class RecordCoverage(Coverage):
    """Coverage from a record of the engine. Readings are counted by direction when `counts` is first used.

    Parameters
    ----------
    record : Records
        Record of the fit.
    summary : Summary
        Summary of the same readings.
    ellipsoid : Ellipsoid
        Ellipsoid of the record.
    within : float
        Largest distance of an accepted reading from the ellipsoid, as in `Coverage.of_cloud`.
    """

    def __init__(self, record: Records, summary: Summary, ellipsoid: Ellipsoid, within: float) -> None:
        super().__init__(None, record["hole"].copy(), float(record["hole_deg"]), float(record["coverage"]))
        vars(self)["_source"] = summary, ellipsoid, within

    @cached_property
    def counts(self) -> Floats:
        """(100,) number of readings in each of `CELL_CENTRES`."""
        summary, ellipsoid, within = vars(self)["_source"]
        return Coverage.of_cloud(summary.cloud, ellipsoid, within=within).counts

    def __reduce__(self) -> tuple[type[Coverage], tuple[Floats, Floats, float]]:
        """Pickle and copy without the readings."""
        return Coverage, (self.counts, self.hole, self.hole_deg)


def corrected_directions(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(K, 3) unit vectors of (K, 3) readings after the correction of an ellipsoid."""
    corrected = np.linalg.inv(ellipsoid.shape) @ subtract_centre(readings, ellipsoid.centre)
    lengths = np.sqrt(np.einsum("ij,ij->j", corrected, corrected))
    corrected /= np.where(lengths > 0.0, lengths, 1.0)
    directions: Floats = np.ascontiguousarray(corrected.T)
    return directions


def cell_indices(directions: Floats) -> NDArray[np.int64]:
    """(K,) index of the cell of each of (K, 3) unit vectors."""
    return engine().cell_indices(directions).astype(np.int64)
