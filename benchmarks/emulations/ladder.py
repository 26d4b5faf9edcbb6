"""NXP's solvers with 4, 7 and 10 elements: sphere, ellipsoid along the axes, general ellipsoid.

The Freescale and NXP sensor fusion libraries and MotionCal run these solvers on a microcontroller while the sensor
moves. A buffer contains up to 240 readings that differ. After every 20 readings the richest solver for which the buffer
has enough readings is tried: 4 elements (a sphere) from 40 readings on, 7 (an ellipsoid along the axes) from 100, 10 (a
general ellipsoid) from 150. A trial is accepted if its field is within the range of the earth's (22 to 67 µT, if the
unit is known), and if one of these is true:

* no trial was accepted before;
* its fit error ε is not larger than that of the solution in use, which grows by 2 % with each trial;
* it is from a higher rung, and ε is at most 4 %.

ε is `fit_error`. It counts as at least 12 % for 4 elements, at least 7.5 % for 7, and at least 2 % for the solution in
use, so that richer solvers and newer readings replace that solution.

From ``magnetic.c`` are: the 12 × 24 bins by the tangents x/z and y/z of readings that the calibration in use corrects,
the latest 240 readings, and the mesh of 5 µT while the buffer fills [1]_. From MotionCal are the numbers of readings,
the interval, the floors, the aging and the rules [2]_. As in AN4246 and AN5019, the first reading of the buffer is
subtracted, the unit is 50 µT, and eigenvectors for 7 and 10 elements have unit length.

Left out are: integer counts and their rounding; time slices during which the buffer is closed; MotionCal's own buffer
of 650 readings. Other editions have other numbers: 50 or 100 readings for the sphere, 10 to 90 µT, aging by the clock,
3.5 % instead of 4 %, nothing above 15 %, a buffer that is emptied after a failure. 12 % and 7.5 % are sometimes quoted
as the largest accepted errors; in the source they are floors.

For a quadric with a negative determinant, ``magnetic.c`` changes the sign and takes roots of absolute values, and an
open surface can then pass for an ellipsoid. Here all three eigenvalues are checked, and such a trial is not accepted.
If the unit is not known, any field is accepted, and the mesh is a tenth of the spread of all readings.

.. [1] Freescale Sensor Fusion Library 5.00 (2015), ``magnetic.c``; NXP AN4246 and AN5019.
.. [2] P. Stoffregen, MotionCal (2016), ``magcal.c``, after Freescale's of 2014.

>>> directions = np.random.default_rng(1).normal(size=(2000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> from flinders import Samples
>>> samples = Samples(directions * [45, 50, 55] + [20, 120, 90])
>>> found = ladder(samples)
>>> found.centre.round(6), found.semi_axes.round(6)
(array([ 20., 120.,  90.]), array([45., 50., 55.]))
>>> list(dict.fromkeys(accepted.elements for _, accepted in climbed(samples) if accepted))
[4, 7, 10]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.units import MICROTESLA
from flinders.errors import FitError, NotAnEllipsoid
from flinders.estimators.algebraic import fit_error
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.summary.moments import Moments

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples


@dataclass(frozen=True, slots=True)
class Rung:
    """One solver of the ladder.

    Attributes
    ----------
    elements : int
        Number of coefficients, by which the solver is named.
    least : int
        Smallest number of readings in the buffer with which it runs.
    floor : float
        Smallest fit error that it counts with, so that a richer solver can replace it.
    """

    elements: int
    least: int
    floor: float


RUNGS: Final = (Rung(4, 40, 0.12), Rung(7, 100, 0.075), Rung(10, 150, 0.0))
"""Solvers, from the poorest to the richest."""

BINS, BUFFER_SIZE = 12, 240
"""Bins of a ratio of two axes, of which there are 12 × 24; and number of readings in the buffer."""

MESH_UT, MESH_SHARE = 5.0, 0.1
"""Smallest distance |Δx| + |Δy| + |Δz| of a new reading from others while the buffer fills.

In µT; without a unit, as a fraction of the spread of the readings."""

INTERVAL: Final = 20
"""Number of readings from one trial to the next."""

AGING: Final = 1.02
"""Factor by which the fit error of the solution in use grows with each trial."""

WEAKEST_UT, STRONGEST_UT = 22.0, 67.0
"""Range of the earth's field in µT within which trials are accepted."""

MAX_UPGRADE_ERROR, MIN_STORED_ERROR = 0.04, 0.02
"""Largest fit error with which a higher rung is accepted in any case; and smallest fit error that is stored."""

DEFAULT_UT: Final = 50.0
"""Divisor of readings; eigenvectors of unit length depend on it."""

TANGENTS: Final = np.tan(np.pi * (np.arange(1, BINS) / BINS - 0.5))


class NothingAccepted(FitError):
    """No trial was accepted: too few different readings, an open surface, or a field outside the earth's range."""


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """A calibration in use, and the solver that found it."""

    ellipsoid: Ellipsoid
    elements: int


def ladder(samples: Samples) -> Ellipsoid:
    """Calibration in use at the end of the recording.

    Raises
    ------
    NothingAccepted
        If no trial was accepted.
    """
    *_, (_, accepted) = climbed(samples)
    if accepted is None:
        raise NothingAccepted("no trial was accepted")
    return accepted.ellipsoid


def climbed(samples: Samples) -> Iterator[tuple[int, Accepted | None]]:
    """Yield the number of readings and the calibration in use after each trial and at the end."""
    is_known = samples.unit.inside == MICROTESLA
    spread = Moments.of(samples.field).spread
    climb = _Climb(MESH_UT if is_known else MESH_SHARE * spread, DEFAULT_UT if is_known else spread, is_known=is_known)
    for count in range(INTERVAL, len(samples) + 1, INTERVAL):
        climb.take(samples.field[count - INTERVAL : count])
        climb.try_one()
        yield count, climb.accepted
    if len(samples) % INTERVAL:
        yield len(samples), climb.accepted


class _Climb:
    """The buffer, the calibration in use, and the fit error of that calibration, which grows."""

    def __init__(self, mesh: float, scale: float, *, is_known: bool) -> None:
        self.accepted: Accepted | None = None
        self._buffer = _Buffer(mesh)
        self._scale, self._is_known = scale, is_known
        self._error = np.inf

    def take(self, field: Floats) -> None:
        """Offer readings to the buffer, after correction by the calibration in use."""
        corrected = field
        if self.accepted is not None:
            found = self.accepted.ellipsoid
            corrected = found.radius * np.linalg.solve(found.shape, (field - found.centre).T).T
        self._buffer.take(field, bins_of(corrected))

    def try_one(self) -> None:
        """Run the richest solver that the buffer allows, and accept its result if it passes."""
        field = self._buffer.held
        rung = next((rung for rung in reversed(RUNGS) if len(field) >= rung.least), None)
        if rung is None:
            return
        self._error *= AGING
        try:
            ellipsoid, error = solved(field, rung.elements, self._scale)
        except (NotAnEllipsoid, np.linalg.LinAlgError):
            return
        if self._is_known and not WEAKEST_UT <= ellipsoid.radius <= STRONGEST_UT:
            return
        error = max(error, rung.floor)
        higher = self.accepted is not None and rung.elements > self.accepted.elements
        if self.accepted is None or error <= self._error or (higher and error <= MAX_UPGRADE_ERROR):
            self.accepted = Accepted(ellipsoid, rung.elements)
            self._error = max(error, MIN_STORED_ERROR)


class _Buffer:
    """Latest reading in each of 12 × 24 bins; while it fills, free bins also store readings far from all others."""

    def __init__(self, mesh: float) -> None:
        self._mesh = mesh
        self._field = np.zeros((2 * BINS * BINS, 3))
        self._stamps = np.full(2 * BINS * BINS, -1)
        self._seen = 0

    @property
    def held(self) -> Floats:
        """(M, 3) readings in the order of the bins."""
        return self._field[self._stamps >= 0]

    def take(self, field: Floats, bins: NDArray[np.int64]) -> None:
        """Add (N, 3) readings with (N,) bins; readings with the bin −1 are skipped."""
        for reading, place in zip(field, bins.tolist(), strict=True):
            self._seen += 1
            if place >= 0:
                self._put(reading, place)

    def _put(self, reading: Floats, place: int) -> None:
        held = np.flatnonzero(self._stamps >= 0)
        is_free = self._stamps[place] < 0
        if len(held) >= BUFFER_SIZE:
            if is_free:
                self._stamps[held[np.argmin(self._stamps[held])]] = -1
        elif not is_free and self._is_far(reading, np.array([place])):
            if not self._is_far(reading, held):
                return
            place = int(np.flatnonzero(self._stamps < 0)[-1])  # the last bin that is free
        self._field[place], self._stamps[place] = reading, self._seen

    def _is_far(self, reading: Floats, places: NDArray[np.int64]) -> bool:
        """Whether a reading has at least the distance of a mesh from the readings at some places."""
        return bool(np.abs(self._field[places] - reading).sum(axis=1).min() >= self._mesh)


def bins_of(corrected: Floats) -> NDArray[np.int64]:
    """(N,) bins of (N, 3) corrected readings: 12 of x/z by 12 of y/z, twice for the sign of x; −1 for z = 0.

    >>> bins_of(np.array([[2.0, 2.0, 1.0], [-2.0, 2.0, 1.0], [1.0, 1.0, 0.0]]))
    array([250,  46,  -1])
    """
    x, y, z = corrected.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        row = np.searchsorted(TANGENTS, x / z, side="right")
        column = np.searchsorted(TANGENTS, y / z, side="right") + BINS * (x < 0)
    return np.where(z == 0.0, -1, row * 2 * BINS + column)


def solved(field: Floats, elements: int, scale: float) -> tuple[Ellipsoid, float]:
    """Ellipsoid with 4, 7 or 10 elements through (M, 3) readings, and its fit error.

    Raises
    ------
    NotAnEllipsoid
        If the surface is open.
    LinAlgError
        If the readings are in one plane, so that many spheres fit them.

    Examples
    --------
    The worked example of AN4246:

    >>> turned = np.array([[167.4, -242.4, 91.7], [140.3, -221.9, 86.8], [152.4, -230.4, -0.6],
    ...                    [180.3, -270.6, 71.0], [190.9, -212.4, 62.7], [192.9, -242.4, 17.1]])
    >>> sphere, error = solved(turned, 4, 50.0)
    >>> sphere.centre.round(2), round(sphere.radius, 3), round(100 * error, 3)
    (array([ 155.74, -239.12,   45.83]), 47.236, 0.298)
    """
    moments, origin = Moments.of(field), field[0]
    scatter = moments.about(origin, scale)
    if elements == 4:
        slopes = np.linalg.solve(scatter[6:, 6:], scatter[6:, :3].sum(axis=1))
        coefficients = np.concatenate([[1.0, 1, 1, 0, 0, 0], -slopes])
    else:
        places = np.array([0, 1, 2, 6, 7, 8, 9] if elements == 7 else range(10))
        coefficients = np.zeros(10)
        coefficients[places] = np.linalg.eigh(scatter[np.ix_(places, places)])[1][:, 0]
    ellipsoid = Ellipsoid.from_quadric(coefficients, method="ladder").in_frame(origin, scale)
    return ellipsoid, fit_error(moments, ellipsoid)
