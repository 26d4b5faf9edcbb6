"""Calls of the engine that judge a fit: its claim, its verdict and its heading errors.

>>> round(Judgements().widening_by_few(10), 3)
1.25
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.native.layouts import JUDGEMENT, RECORD, empty_row
from flinders.native.library import Library, contiguous, contiguous_vector, symmetric_entries

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Judgements(Library):
    """Claims, judgements and heading errors of records."""

    def claim(self, record: Records, request: Records) -> None:
        """Widen the covariance of a record for repeated and for few readings, in place; a second call does nothing.

        Level heading errors that are NaN are computed from the covariance, with the sign of their dip.
        """
        self._library.flinders_claim(record, request)

    def widening_by_few(self, freedom: float) -> float:
        """Factor by which a covariance is widened for few readings.

        `freedom` is the number of different readings minus that of parameters.
        """
        return float(self._library.flinders_widening_by_few(freedom))

    def judge(self, record: Records, request: Records) -> Records:
        """Judge a record: a row of `JUDGEMENT`. The record gets its claim, and shrinkage if requested, in place.

        Raises ValueError for a record without an ellipsoid, a target that is not positive, or a dip beyond ±89°.
        """
        judgement = empty_row(JUDGEMENT)
        self._require(self._library.flinders_judge(record, request, judgement))
        return judgement

    def judge_many(self, records: Records, request: Records) -> Records:
        """(R,) judgements of (R,) records, which get their claim and shrinkage in place."""
        judgements = np.zeros(len(records), dtype=JUDGEMENT)
        self._library.flinders_judge_many(records, len(records), request, judgements)
        return judgements

    def severity(self, rule: int, quantities: Floats) -> int:
        """Severity of a finding, 0 to 3, by the (Q,) quantities of a judgement.

        `rule` is the number of the finding's rule in the catalogue.
        """
        return int(self._library.flinders_severity(rule, quantities))

    def causes(self, severities: ArrayLike) -> Records:
        """Make a row of `JUDGEMENT` with the findings to show and their causes, from their severities alone."""
        judgement = empty_row(JUDGEMENT)
        judgement["severities"] = severities
        self._library.flinders_causes(judgement)
        return judgement

    def tilted_error(
        self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, tilt_deg: float, down: Floats | None
    ) -> tuple[float, float]:
        """Heading error of a tilted vehicle in degrees, 1 σ: rms and worst.

        `down` is the (3,) down direction of the level vehicle, by default z.
        """
        out = np.empty(2)
        arguments = (
            symmetric_entries(shape),
            np.ascontiguousarray(covariance),
            dip_deg,
            tilt_deg,
            contiguous_vector(down),
        )
        self._require(self._library.flinders_tilted_error(*arguments, out, out[1:]))
        return float(out[0]), float(out[1])

    def uncorrected_error(
        self, centre: ArrayLike, shape: ArrayLike, *, dip_deg: float, down: Floats | None
    ) -> tuple[float, float]:
        """Heading error of a level vehicle by uncorrected readings, in degrees: rms and worst."""
        out = np.empty(2)
        arguments = (
            np.ascontiguousarray(centre, dtype=np.float64),
            symmetric_entries(shape),
            dip_deg,
            contiguous_vector(down),
        )
        self._require(self._library.flinders_uncorrected_error(*arguments, out, out[1:]))
        return float(out[0]), float(out[1])

    def attitude_limit(
        self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, limit_deg: float, down: Floats | None
    ) -> float:
        """Tilt in degrees up to which the worst heading error is within a limit."""
        out = np.empty(1)
        arguments = (
            symmetric_entries(shape),
            np.ascontiguousarray(covariance),
            dip_deg,
            limit_deg,
            contiguous_vector(down),
        )
        self._require(self._library.flinders_attitude_limit(*arguments, out))
        return float(out[0])

    def heading_bound(self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, down: Floats | None) -> float:
        """95 % bound in degrees of the heading error of a level vehicle at all headings."""
        out = np.empty(1)
        arguments = symmetric_entries(shape), np.ascontiguousarray(covariance), dip_deg, contiguous_vector(down)
        self._require(self._library.flinders_heading_bound(*arguments, out))
        return float(out[0])

    def level_turn(
        self, centre: ArrayLike, shape: ArrayLike, covariance: Floats, *, dip_deg: float, down: Floats | None
    ) -> tuple[Floats, Floats, Floats]:
        """Heading errors over a level turn in degrees, for a plot.

        Returns (72,) headings, (72,) deviations of raw readings, and (72,) 1 σ of corrected readings.
        """
        turn = np.empty((3, 72))
        arguments = (
            contiguous(centre),
            symmetric_entries(shape),
            contiguous(covariance),
            dip_deg,
            contiguous_vector(down),
        )
        self._require(self._library.flinders_level_turn(*arguments, *turn))
        return turn[0], turn[1], turn[2]

    def attitude_errors(self, shape: ArrayLike, covariance: Floats, directions: Floats, *, dip_deg: float) -> Floats:
        """(K,) heading errors in degrees, 1 σ, at the worst attitude with the field along each of (K, 3) directions."""
        towards, errors = contiguous(directions), np.empty(len(directions))
        self._library.flinders_attitude_errors(
            symmetric_entries(shape), contiguous(covariance), dip_deg, towards, len(directions), errors
        )
        return errors

    def matrix_sigmas(self, matrix: ArrayLike, shape: ArrayLike, covariance: Floats, *, is_known: bool) -> Floats:
        """(3, 3) standard deviations of the entries of a calibration's matrix.

        `is_known` states whether the field strength of the calibration is known.
        """
        sigmas, arguments = (
            np.empty((3, 3)),
            (contiguous(matrix), symmetric_entries(shape), contiguous(covariance), is_known),
        )
        self._require(self._library.flinders_matrix_sigmas(*arguments, sigmas))
        return sigmas

    def add_structure(self, shape: ArrayLike, covariance: Floats, *, structure_deg: float, dip_deg: float) -> Floats:
        """(9, 9) covariance plus that of direction-dependent errors, which cause the heading error `structure_deg`."""
        out, covariance = np.empty((9, 9)), np.ascontiguousarray(covariance)
        self._library.flinders_with_structure(symmetric_entries(shape), covariance, structure_deg, dip_deg, out)
        return out

    def heading_errors(self, record: Records, dip_deg: float) -> Records:
        """Copy of a record with the errors of headings and directions at an inclination."""
        row = np.array(record, dtype=RECORD)
        if self._library.flinders_heading_errors(row, dip_deg):
            raise ValueError(f"dip is {dip_deg:g}°, or the record has no ellipsoid: need both, a dip of -89° to 89°")
        return row

    def direction_errors(self, shape: ArrayLike, covariance: Floats, directions: Floats) -> Floats:
        """(K,) errors of the corrected field's direction in degrees, 1 σ, for a field along (K, 3) directions."""
        towards, errors = contiguous(directions), np.empty(len(directions))
        self._library.flinders_direction_errors(
            symmetric_entries(shape), contiguous(covariance), towards, len(directions), errors
        )
        return errors
