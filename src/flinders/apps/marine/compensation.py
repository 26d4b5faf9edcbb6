"""Corrections on N, E, S and W, with which the correctors of a compass remove B and C.

With the deviation on the four cardinal headings, magnetic less compass,

    A = (N + E + S + W)/4,   B = (E − W)/2,   C = (N − S)/2,

as on the worksheets of UK CAA CAP 562 and, with the opposite sign, of MIL-STD-765A. The north–south corrector removes
C: it is adjusted until the compass reads C more on N, or C less on S. The east–west corrector removes B. A is removed
by turning the compass in its mount.

>>> swing = compensation([3.0, 85.0, 170.0, 265.0], [-4.0, 6.0, 8.0, 2.0])          # CAP 562, worksheet 1
>>> swing.a_deg, swing.b_deg, swing.c_deg
(3.0, 2.0, -6.0)
>>> [(row.name, row.compass_deg, row.make_deg) for row in swing.rows if row.name in "SW"]
[('S', 170.0, 176.0), ('W', 265.0, 263.0)]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import check_column, to_floats
from flinders.errors import FitError
from flinders.geometry.angles import wrap_180, wrap_360

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

CARDINALS: Final = "NESW"
MAX_CARDINAL_ERROR_DEG: Final = 5.0
"""Largest angle between a reading and its cardinal heading, by the reference."""


@dataclass(frozen=True, slots=True)
class Corrector:
    """Correction on one cardinal heading: reading of the compass, reading to set, and remaining deviation."""

    name: str  # N, E, S or W
    compass_deg: float  # reading of the compass
    make_deg: float  # reading to set with the corrector
    left_deg: float  # remaining deviation

    @property
    def change_deg(self) -> float:
        """Change of the reading by the corrector, in degrees."""
        return float(wrap_180(self.make_deg - self.compass_deg))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        names = ("name", "compass_deg", "make_deg", "change_deg", "left_deg")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True)
class Compensation:
    """Coefficients from the cardinal headings, and the corrections there."""

    a_deg: float  # mean deviation
    b_deg: float  # hard iron fore-and-aft
    c_deg: float  # hard iron athwartships
    rows: tuple[Corrector, ...]  # corrections on N, E, S and W

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "A_deg": self.a_deg,  # mean of the deviations on the cardinal headings
            "B_deg": self.b_deg,  # hard iron fore-and-aft
            "C_deg": self.c_deg,  # hard iron athwartships
            # for N, E, S and W: reading of the compass, reading to set (`make_deg`), and remaining deviation
            "correctors": [row.as_dict() for row in self.rows],
        }


def compensation(compass_deg: ArrayLike, deviation_deg: ArrayLike) -> Compensation:
    """Find the corrections from the readings of a swing, one of which is near each cardinal heading.

    Raises `FitError` if no reading is within 5° of one of N, E, S and W; `ArrayError` for arrays of different lengths.

    Parameters
    ----------
    compass_deg, deviation_deg : (N,) degrees
        Headings by the compass, and magnetic less compass heading there.
    """
    compass = np.atleast_1d(to_floats(compass_deg, "compass_deg"))
    deviations = wrap_180(check_column(deviation_deg, len(compass), "deviation_deg"))
    apart = wrap_180((compass + deviations)[:, np.newaxis] - 90.0 * np.arange(4))
    nearest = np.abs(apart).argmin(axis=0)
    _refuse_missing(np.abs(apart).min(axis=0).tolist())
    north, east, south, west = deviations[nearest].tolist()
    b, c = (east - west) / 2.0, (north - south) / 2.0
    changes = (c, b, -c, -b)
    rows = tuple(
        Corrector(name, read, float(wrap_360(read + change)), deviation - change)
        for name, read, deviation, change in zip(
            CARDINALS, compass[nearest].tolist(), deviations[nearest].tolist(), changes, strict=True
        )
    )
    return Compensation((north + east + south + west) / 4.0, b, c, rows)


def _refuse_missing(apart_deg: list[float]) -> None:
    """Refuse a swing without one of the cardinal headings."""
    missing = [name for name, apart in zip(CARDINALS, apart_deg, strict=True) if not apart <= MAX_CARDINAL_ERROR_DEG]
    if missing:
        raise FitError(
            f"no reading within {MAX_CARDINAL_ERROR_DEG:.0f}° of {' and '.join(missing)}: a correction swing needs one "
            "on each of N, E, S and W by the reference",
            missing=tuple(missing),
        )
