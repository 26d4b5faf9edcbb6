"""Calls of the engine that find faults of a recording: outliers, drift, disturbances, exchanged axes, no motion.

>>> far = np.repeat([False, True, False], [50, 20, 50])
>>> int(Faults().mark_outliers(far, 5).sum())
70
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.native.layouts import (
    AXIS_CHANGE,
    CALIBRATED,
    DIFFERENCE,
    DISTURBANCE,
    OUTLIER,
    RECORD,
    empty_row,
    enum_value,
)
from flinders.native.library import Library, symmetric_entries

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


Answer = Literal["holds", "fails", "cannot-tell"]

ANSWERS: Final[tuple[Answer, ...]] = ("holds", "fails", "cannot-tell")
"""Answers to the question whether a calibration still holds, in the order of flinders.h."""


class Faults(Library):
    """Faults of recordings, and differences of calibrations."""

    def compare(
        self,
        first: tuple[Floats, Floats, Floats, float],
        second: tuple[Floats, Floats, Floats, float],
        *,
        dip_deg: float,
    ) -> Records:
        """Compare two calibrations of one sensor: a row of `DIFFERENCE`.

        Parameters
        ----------
        first, second : ((3,) float, (3, 3) float, (9, 9) float, float)
            Each calibration: centre, shape, claimed covariance, and strength of the field, 0 if not known.
        dip_deg : float
            Inclination of the field.
        """
        rows, difference = (empty_row(CALIBRATED), empty_row(CALIBRATED)), empty_row(DIFFERENCE)
        for row, (centre, shape, covariance, strength) in zip(rows, (first, second), strict=True):
            row["centre"], row["shape"] = centre, symmetric_entries(shape)
            row["covariance"], row["strength"] = covariance.ravel(), strength
        self._require(self._library.flinders_compare(*rows, dip_deg, difference))
        return difference

    def answer(
        self, worst_deg: float, *, sigma_deg: float, bound_deg: float, p_value: float, target_deg: float
    ) -> Answer:
        """Whether a heading difference is within a target, given its 1 σ and the 95 % bound at all headings.

        >>> claim = {"sigma_deg": 0.2, "bound_deg": 0.4, "p_value": 1e-6, "target_deg": 1.0}
        >>> [Faults().answer(worst_deg, **claim) for worst_deg in (0.5, 0.8, 1.2, 1.4)]
        ['holds', 'cannot-tell', 'cannot-tell', 'fails']
        """
        place: int = self._library.flinders_holds(worst_deg, sigma_deg, bound_deg, p_value, target_deg)
        return ANSWERS[place]

    def drift(self, field: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, dip_deg: float = 60.0) -> Records:
        """Make a record with the fields ``drift_…``: a steady change of the offset, for a known ellipsoid.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        centre, shape : (3,), (3, 3) array-like
            Centre and shape of the ellipsoid.
        dip_deg : float
            Inclination of the field, −89 to 89.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        record, (workspace, size) = empty_row(RECORD), self._workspace(len(readings))
        self._library.flinders_drift(
            readings,
            len(readings),
            np.ascontiguousarray(centre, dtype=np.float64),
            symmetric_entries(shape),
            dip_deg,
            workspace,
            size,
            record,
        )
        return record

    def regress(
        self, field: ArrayLike, values: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, limit: float = math.inf
    ) -> Records:
        """Regress the distances from a known ellipsoid on a disturbance: a row of `DISTURBANCE`.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings.
        values : (N,) array-like
            Values of the disturbance, NaN if not known.
        centre, shape : (3,), (3, 3) array-like
            Centre and shape of the ellipsoid.
        limit : float
            Largest distance of a used reading from the ellipsoid.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        regression, (workspace, size) = empty_row(DISTURBANCE), self._workspace(len(readings))
        self._library.flinders_regress(
            readings,
            np.ascontiguousarray(values, dtype=np.float64),
            len(readings),
            np.ascontiguousarray(centre, dtype=np.float64),
            symmetric_entries(shape),
            limit,
            workspace,
            size,
            regression,
        )
        return regression

    def distances(self, field: ArrayLike, record: Records) -> Floats:
        """(N,) Sampson distances of (N, 3) readings from the ellipsoid of a record."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        out, row = np.full(len(readings), math.nan), np.array(record, dtype=RECORD)
        self._library.flinders_distances(readings, len(readings), row, out)
        return out

    def min_run_readings(self, far: NDArray[np.bool_], rows: int) -> int:
        """Smallest number of far readings in a window that make a run of outliers.

        `far` is (N,), whether each reading is far from the ellipsoid; `rows` is the number of readings in the
        recording.
        """
        return int(self._library.flinders_dense(np.ascontiguousarray(far), len(far), rows, np.empty(len(far), bool)))

    def mark_outliers(self, far: NDArray[np.bool_], dense: int) -> NDArray[np.bool_]:
        """(N,) whether each reading is an outlier: far readings, and all readings in or near a run of far readings.

        `far` is (N,), whether each reading is far from the ellipsoid; `dense` far readings in a window make a run.
        """
        left_out = np.empty(len(far), dtype=bool)
        self._library.flinders_left_out(np.ascontiguousarray(far), len(far), dense, left_out)
        return left_out

    def list_outliers(
        self,
        runs: Records,
        distances: Floats,
        left_out: NDArray[np.bool_],
        rows: tuple[NDArray[np.int64], NDArray[np.int64]],
        times: tuple[Floats, Floats] | None,
    ) -> Records:
        """Append runs of outliers to a list of runs.

        Parameters
        ----------
        runs : (R,) of `OUTLIER`
            Earlier runs.
        distances : (N,) float
            Distances of the readings from the surface.
        left_out : (N,) bool
            Whether each reading is an outlier.
        rows : ((N,), (N,)) int
            First and last row of each reading in the recording; a rest has several rows.
        times : ((N,), (N,)) float, s, or None
            Times of these rows.
        """
        room = np.empty(enum_value("OUTLIERS"), OUTLIER)
        room[: len(runs)] = runs
        first, last = (np.ascontiguousarray(each, np.int64) for each in rows)
        start, end = (None if times is None else np.ascontiguousarray(times[side], np.float64) for side in (0, 1))
        near = np.ascontiguousarray(distances, np.float64)
        count = self._library.flinders_list_outliers(
            near, left_out, len(near), first, last, start, end, room, len(runs)
        )
        return room[:count].copy()

    def axis_swap(self, field: ArrayLike, noise: float, noise_limit: float) -> tuple[Records, NDArray[np.int64]]:
        """Find exchanges of axes during a recording: a row of `AXIS_CHANGE`, and the first row after each exchange.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        noise : float
            Noise of the readings without outliers; infinite if not known.
        noise_limit : float
            Largest noise of readings without an exchange, relative to the radius.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        size = int(self._library.flinders_swap_workspace_size(len(readings)))
        workspace, moments, change = np.empty(size, np.uint8), np.empty(len(readings), np.int64), empty_row(AXIS_CHANGE)
        self._library.flinders_axis_swap(readings, len(readings), noise, noise_limit, workspace, size, moments, change)
        return change, moments[: int(change["moments"])].copy()

    def unmoved_deg(self, means: Floats, readings: float, strengths: tuple[float, float]) -> float:
        """Angle in degrees that contains all readings of a sensor that was hardly turned; NaN if it was turned.

        Parameters
        ----------
        means : (K, 3) float
            Mean of the readings in each cell of raw space.
        readings : float
            Number of readings in all cells.
        strengths : (float, float)
            Weakest and strongest possible field, in the unit of the readings; 0 and infinity if not known.
        """
        angle = np.empty(1)
        self._library.flinders_unmoved_cells(
            np.array(means, np.float64, order="C"), len(means), readings, *strengths, angle
        )
        return float(angle[0])

    def are_turned(self, records: Records, strengths: tuple[float, float]) -> NDArray[np.bool_]:
        """Whether each record is of a sensor that was turned, out of one plane and without rails.

        `strengths` are as in `unmoved_deg`.
        """
        turned = np.empty(records.shape, dtype=bool)
        self._library.flinders_turned(np.ascontiguousarray(records), records.size, *strengths, turned)
        return turned

    def levelness(self, acceleration: Floats) -> int:
        """Option ``level`` for a fit of a turn about z, by its (N, 3) accelerations: 0 no, 2 yes, 1 if not known."""
        felt = np.ascontiguousarray(acceleration, np.float64)
        return int(self._library.flinders_levelness(felt, len(felt)))

    def is_level(self, covariance: ArrayLike, noise: float, within: float) -> bool:
        """Whether readings with a (3, 3) covariance are in a plane perpendicular to z, to `within` times the noise."""
        return bool(self._library.flinders_is_level(symmetric_entries(covariance), noise, within))
