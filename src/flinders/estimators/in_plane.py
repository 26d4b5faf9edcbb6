"""Fits of readings in one plane: projection to the plane, and the estimate for three axes.

An estimate in the plane is an ellipsoid whose equator contains the projected readings, as for `Level`. The first and
the second axis of the plane are x and y, and z is constant.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.errors import FitError, NotAnEllipsoid, Unmoved
from flinders.estimators.data import MAX_OFFSET_SPREADS, MIN_READING
from flinders.estimators.likelihood import estimate_from_record
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import PlaneEllipse, axis_order
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.plane import Plane

_ENTRY_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class NotAnEllipse(NotAnEllipsoid):
    """Readings in a plane that give no ellipse: they are on a line, or half of them in one place."""

    def __init__(self, method: str) -> None:
        self.eigenvalues = (0.0, 0.0, 0.0)
        FitError.__init__(
            self,
            "no ellipse goes through these readings: in this plane they lie on a line, or half of them in one place. "
            "Turn the sensor all the way round about the third axis, and check the plane and the columns",
            method=method,
        )


def require_turn(readings: Readings, unknowns: int, method: str, plane: Plane) -> None:
    """Refuse readings that no method can fit in a plane.

    Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved` as `Readings.require`; `Unmoved` also for readings
    that hardly vary in the plane.
    """
    readings.require(unknowns, method, axes=plane)
    seen = list(axis_order(plane)[:2])
    moments = readings.summary.moments
    spread = float(np.sqrt(np.diag(moments.covariance)[seen].sum().clip(min=0.0)))
    size = float(np.linalg.norm(moments.mean[seen]))
    if not (spread > MIN_READING and MAX_OFFSET_SPREADS * spread > size):
        apart = float(np.linalg.norm(readings.summary.health.extent[seen]))
        raise Unmoved(math.degrees(math.atan2(apart, size)), f"all the way round in the plane {plane}")


def fit_projected(flat: Readings, spread: float) -> Estimate:
    """Fit an ellipse to projected readings, as `Likelihood` fits an ellipsoid; robustly if residuals show outliers.

    Raises `NotAnEllipse` if half of the readings are in one place, or all on a line; `NeedsSamples` if only sums were
    given.
    """
    field, ends = flat.as_array("ellipse")
    record = engine().fit_level(field, ends=ends, prior=spread, dip_deg=0.0, statistics=0, rests=0)
    if record["status"]:
        raise NotAnEllipse("ellipse")
    return estimate_from_record(record, flat)


def equator_ellipsoid(ellipse: PlaneEllipse) -> Ellipsoid:
    """Ellipsoid whose equator is an ellipse; the third semi-axis is the geometric mean of those of the ellipse."""
    shape = np.zeros((3, 3))
    shape[:2, :2], shape[2, 2] = ellipse.shape, ellipse.radius
    return Ellipsoid(np.append(ellipse.centre, 0.0), shape)


def lift_estimate(
    flat: Estimate, readings: Readings, plane: Plane, *, name: str, dip_deg: float, field_strength: float | None
) -> Estimate:
    """Estimate for three axes from the ellipse in a plane; the third axis has unit gain and no offset.

    While a vehicle turns about the third axis, which points down, the field is F (cos I cos ψ, −cos I sin ψ, sin I).
    The shape of the ellipse is then cos I · S₂. Parameters of the third axis have only a prior. The offset in the plane
    is the centre of the ellipse, because coupling from the third axis is assumed to be zero.

    Parameters
    ----------
    flat : Estimate
        Estimate of the projected readings.
    readings : Readings
        Readings of all three axes; the 1 σ of the offset of the third axis follows from its mean and the field.
    plane : Plane
        Plane of the turn.
    name : str
        Name of the method.
    dip_deg : float
        Inclination of the field towards the third axis, in degrees.
    field_strength : float, optional
        Semi-axis along the third axis, by default the mean of those in the plane. The gain is 1 in both cases.
    """
    dip = np.deg2rad(dip_deg)
    level = equator_ellipsoid(PlaneEllipse(flat.ellipsoid.centre[:2], flat.ellipsoid.shape[:2, :2]))
    shape = level.shape / np.cos(dip)
    if field_strength is not None:
        shape[2, 2] = field_strength
    lift = lift_matrix(float(dip))
    order = axis_order(plane)
    unclaimed = np.hypot(float(readings.summary.moments.mean[order[2]]), shape[2, 2])
    there = [order.index(axis) for axis in range(3)]
    rows = _parameters(there)
    return replace(
        flat,
        ellipsoid=Ellipsoid(level.centre[there], shape[np.ix_(there, there)]),
        covariance=lifted_covariance(flat.covariance, lift, unclaimed)[np.ix_(rows, rows)],
        textbook=None
        if flat.textbook is None
        else lifted_covariance(flat.textbook, lift, unclaimed)[np.ix_(rows, rows)],
        bias=None if flat.bias is None else (lift @ flat.bias)[rows],
        method=f"{name} {plane}",
        estimator=name,
        plane=plane,
    )


def lift_matrix(dip: float) -> Floats:
    """(9, 9) matrix from the parameters of an equator to those of the ellipsoid that gives this ellipse at a `dip`.

    The dip is in rad.
    """
    lift = np.eye(9)
    lift[3:, 3:] /= np.cos(dip)
    lift[[0, 1, 2], [7, 8, 5]] = -np.tan(dip)
    return lift


def lifted_covariance(covariance: Floats, lift: Floats, unclaimed: float) -> Floats:
    """(9, 9) covariance of the ellipsoid; `unclaimed` is 1 σ of the offset along the third axis."""
    known = covariance.copy()
    known[2, :] = known[:, 2] = 0.0
    carried: Floats = lift @ known @ lift.T
    carried[2, 2] += unclaimed**2
    return carried


def _parameters(there: list[int]) -> list[int]:
    """For each of the nine parameters in axes of the sensor, its index in axes of the plane."""
    entries = [_ENTRY_PAIRS.index((min(pair), max(pair))) for pair in ((there[i], there[j]) for i, j in _ENTRY_PAIRS)]
    return [*there, *(3 + entry for entry in entries)]
