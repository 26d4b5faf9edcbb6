"""Calls of the engine that fit: one recording, many recordings, sums, an earlier calibration, the field of a site.

>>> float(Fits().sums(np.eye(3))["sums"][0])
3.0
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.native.layouts import EARLIER, HEIGHTS, RECORD, SITE, SUMS, empty_row
from flinders.native.library import Library, contiguous, symmetric_entries

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Fits(Library):
    """Fits of readings to records."""

    def fit(
        self, field: ArrayLike, *, time: ArrayLike | None = None, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit one recording: a row of `RECORD`; its ``status`` is 0 if the fit succeeded.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        time : (N,) array-like, s, optional
            Time of each reading.
        ends : (P,) array-like of int, optional
            Row after the end of each of P joined recordings; statistics of consecutive readings do not cross these.
        **options
            Fields of ``flinders_options``: prior, dip_deg, robust, kernels, statistics, rests, level, bias_correction.
        """
        return self._call_fit(self._library.flinders_fit_parts, field, time, ends, options)

    def fit_level(
        self, field: ArrayLike, *, time: ArrayLike | None = None, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit the ellipse of a level turn to x and y of one recording; parameters and record are as in `fit`."""
        return self._call_fit(self._library.flinders_fit_level, field, time, ends, options)

    def _call_fit(
        self,
        function: Callable[..., int],
        field: ArrayLike,
        time: ArrayLike | None,
        ends: ArrayLike | None,
        options: dict[str, float],
    ) -> Records:
        """Fit one recording by a function of the library, and return the record."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        record, (workspace, size) = empty_row(RECORD), self._workspace(len(readings))
        function(
            readings,
            times,
            len(readings),
            parts,
            0 if parts is None else len(parts),
            self.options(**options),
            workspace,
            size,
            record,
        )
        return record

    def fit_many(
        self, field: ArrayLike, offsets: ArrayLike, *, time: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit R concatenated recordings: (R,) records.

        `offsets` are (R + 1,): the first row of each recording, and the number of all rows.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        bounds = np.ascontiguousarray(offsets, dtype=np.int64)
        lengths = np.diff(bounds)
        if len(bounds) < 1 or bounds[0] < 0 or bounds[-1] > len(readings) or (lengths < 0).any():
            raise ValueError(f"offsets must ascend from 0 to {len(readings)}, the number of readings")
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        if times is not None and times.shape != (len(readings),):
            raise ValueError(f"times of {len(readings)} readings have shape {times.shape}: give one time for each")
        records = np.zeros(len(lengths), dtype=RECORD)
        workspace, size = self._workspace(int(lengths.max(initial=0)))
        self._library.flinders_fit_many(
            readings,
            times,
            bounds,
            len(lengths),
            self.options(**options),
            workspace,
            size,
            records,
        )
        return records

    def rests(self, field: ArrayLike, *, ends: ArrayLike | None = None) -> tuple[NDArray[np.int64], bool]:
        """Find rests, intervals of constant direction: (R, 2) first row of each rest, and row after its last.

        The second result is whether a fit leaves rests out; otherwise each rest is one reading in the fit.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        ends : (P,) array-like of int, optional
            As in `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        bounds, (workspace, size) = np.empty((len(readings) // 4, 2), dtype=np.int64), self._workspace(len(readings))
        count, left_out = 0 if parts is None else len(parts), np.zeros(1, dtype=np.int32)
        found = self._library.flinders_rests(readings, len(readings), parts, count, workspace, size, bounds, left_out)
        return bounds[:found].copy(), bool(left_out[0])

    def polish(
        self, field: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit from a given start, without removal of outliers; the record's ``status`` is 0 if the fit succeeded.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        centre, shape : (3,), (3, 3) array-like
            The ellipsoid to start from.
        ends : (P,) array-like of int, optional
            As in `fit`.
        **options
            As in `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        record = empty_row(RECORD)
        workspace, size = self._workspace(len(readings))
        self._library.flinders_polish(
            readings,
            len(readings),
            parts,
            0 if parts is None else len(parts),
            np.ascontiguousarray(centre, dtype=np.float64),
            symmetric_entries(shape),
            self.options(**options),
            workspace,
            size,
            record,
        )
        return record

    def make_earlier(
        self,
        centre: ArrayLike,
        shape: ArrayLike,
        covariance: Floats | None,
        *,
        distortion: float = 0.0,
        strength_ratio: float = 1.0,
        soft_iron_sigma: float = 0.0,
    ) -> Records:
        """Make a row of `EARLIER`: an earlier calibration as prior knowledge of a sensor whose hard iron has changed.

        Parameters
        ----------
        centre, shape : (3,), (3, 3) array-like
            Centre and shape of the earlier calibration.
        covariance : (9, 9) float, optional
            Covariance of the earlier centre and shape; None if not stated.
        distortion : float
            Member ``distortion`` of the earlier record.
        strength_ratio : float
            Strength of the field relative to that of the earlier recording.
        soft_iron_sigma : float
            Relative change of the soft iron since then, 1 σ.
        """
        earlier, known = empty_row(EARLIER), None if covariance is None else contiguous(covariance)
        options = distortion, strength_ratio, soft_iron_sigma
        self._library.flinders_earlier_of(contiguous(centre), symmetric_entries(shape), known, *options, earlier)
        return earlier

    def allow_change(self, earlier: Records) -> Records:
        """Copy of a row of `EARLIER` with a prior that allows a change of the soft iron by 5 %, 1 σ."""
        freer = earlier.copy()
        self._library.flinders_allow_change(freer)
        return freer

    def soft_iron_p_value(self, earlier: Records, shape: ArrayLike, textbook: Floats, covariance: Floats) -> float:
        """p-value of the change of the soft iron since an earlier calibration.

        Parameters
        ----------
        earlier : row of `EARLIER`
            The earlier calibration.
        shape : (3, 3) array-like
            Result of a fit with `allow_change`.
        textbook, covariance : (9, 9) float
            Covariance of that fit for independent residuals, and as claimed.
        """
        return float(
            self._library.flinders_soft_iron_p_value(
                earlier, symmetric_entries(shape), contiguous(textbook), contiguous(covariance)
            )
        )

    def refresh(
        self, field: ArrayLike, earlier: Records, *, time: ArrayLike | None = None, **options: float
    ) -> Records:
        """Renew an earlier calibration: the record of a fit whose prior is the earlier shape.

        Parameters
        ----------
        field : (N, 3) array-like
            Readings in the order of recording.
        earlier : row of `EARLIER`
            The earlier calibration.
        time : (N,) array-like, s, optional
            Time of each reading.
        **options
            As in `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        record, (workspace, size) = empty_row(RECORD), self._workspace(len(readings))
        given = readings, times, len(readings), self.options(**options), earlier
        self._library.flinders_refresh(*given, workspace, size, record)
        return record

    def turn_deg(self, field: ArrayLike, shape: ArrayLike) -> float:
        """Largest angle in degrees of (N, 3) readings from their mean direction, by a known (3, 3) shape."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        return float(self._library.flinders_turn_deg(readings, len(readings), symmetric_entries(shape)))

    def sums(self, field: ArrayLike = (), *, origin: ArrayLike = (0.0, 0.0, 0.0), scale: float = 1.0) -> Records:
        """Make a row of `SUMS`: sums of monomials of (N, 3) readings about an origin, divided by `scale`."""
        sums = empty_row(SUMS)
        self._library.flinders_sums_begin(sums, np.array(origin, dtype=np.float64), scale)
        return self.add(sums, field)

    def add(self, sums: Records, field: ArrayLike) -> Records:
        """Add (N, 3) readings to a row of `SUMS` in place; raises ValueError for values that are not finite."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        status = self._library.flinders_sums_add(sums, readings, len(readings))
        if status:
            raise ValueError(self.message(status))
        return sums

    def merge(self, sums: Records, other: Records) -> Records:
        """Add `other` to `sums` in place; both are rows of `SUMS`."""
        self._library.flinders_sums_merge(sums, other)
        return sums

    def solve(self, sums: ArrayLike, *, origin: ArrayLike = (0.0, 0.0, 0.0), unit: float = 1.0) -> Records:
        """Fit an ellipsoid to (35,) sums by the consistent method; returns the record.

        The sums are those of readings minus `origin`, divided by `unit`.
        """
        record, row = empty_row(RECORD), empty_row(SUMS)
        row["sums"], row["origin"], row["scale"] = sums, origin, unit
        self._library.flinders_sums_solve(row, record)
        return record

    def site(self, **known: float | None) -> Records:
        """Make a row of `SITE`, the known field of a place; None stands for an unknown value."""
        site = empty_row(SITE)
        self._library.flinders_default_site(site)
        for name, number in known.items():
            site[name] = math.nan if number is None else number
        return site

    def add_vertical(self, vertical: Records, field: Floats, acceleration: Floats, record: Records) -> None:
        """Add (N, 3) readings of a level turn with (N, 3) accelerations to a row of `VERTICAL`, in place."""
        readings, felt = np.ascontiguousarray(field, np.float64), np.ascontiguousarray(acceleration, np.float64)
        self._library.flinders_vertical_add(readings, felt, len(readings), record, vertical)

    def fit_plane(self, field: Floats, centre: Floats, noise: float) -> Records:
        """Make a row of `HEIGHTS`: the plane of (N, 3) readings of a level turn, at a (2,) centre in x and y."""
        readings, heights, (workspace, size) = contiguous(field), empty_row(HEIGHTS), self._workspace(len(field))
        middle = contiguous(centre)
        self._require(self._library.flinders_plane_of(readings, len(field), middle, noise, workspace, size, heights))
        return heights

    def apply_site(self, record: Records, site: Records, field: Floats, vertical: Records | None = None) -> bool:
        """Update a record in place by the known field of a site; returns whether its strength was used.

        Parameters
        ----------
        record, site : row of `RECORD`, row of `SITE`
            The fit, and the field of the site.
        field : (N, 3) float
            Readings in the fit; needed for a level turn only.
        vertical : row of `VERTICAL`, optional
            Sums of accelerometer readings of a level turn.
        """
        readings, (workspace, size) = contiguous(field), self._workspace(len(field))
        self._require(self._library.flinders_at_site(readings, len(field), vertical, site, workspace, size, record))
        return bool(self._library.flinders_uses_strength(record))
