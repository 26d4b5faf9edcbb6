"""Update of an estimate by the known field of the site.

The engine computes it; ``site.c`` has the equations. For a level turn the dip gives the offset across the plane, the
mounting gives the shape, and an accelerometer gives the tilt of the axis of the turn. The strength gives the size of
any ellipsoid.

When to use it: for vehicles that cannot be turned upside down, at a known place. For readings in more than one plane
only the strength is used.

>>> from flinders import simulate
>>> from flinders.estimators.data import Readings
>>> turned = simulate.tumble(seed=3, motion="level", sensor=simulate.Sensor(offset=[10.0, 20.0, -30.0], noise=0.1))
>>> from flinders.likelihood.site_field import Site
>>> site = Site(strength=50.0, gain_sigma=0.05, inclination_deg=60.0, inclination_sigma_deg=1.0)
>>> readings = Readings.of(turned.samples)
>>> alone = Level(dip_deg=60.0).estimate(readings)
>>> located = update_by_site(alone, readings, site, alignment_sigma_deg=1.0)
>>> located.ellipsoid.centre.round(0), bool(np.sqrt(located.covariance[2, 2]) < 0.2 * np.sqrt(alone.covariance[2, 2]))
(array([ 10.,  20., -30.]), True)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import frame_of
from flinders.estimators.base import SiteStrength
from flinders.estimators.level import Level
from flinders.estimators.likelihood import MAX_ITERATED_READINGS
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.native.engine import engine
from flinders.native.layouts import VERTICAL, enum_value

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.likelihood.site_field import Site
    from flinders.native.layouts import Records

Z_DOWN_BY_CONSTANT: Final = {
    enum_value("Z_DOWN"): True,
    enum_value("Z_ELSEWHERE"): False,
    enum_value("Z_OPEN"): None,
}
"""Values of `Estimate.z_down` by the constants of the engine."""


def update_by_site(
    estimate: Estimate,
    readings: Readings,
    site: Site | None,
    *,
    dip_deg: float = 60.0,
    alignment_sigma_deg: float | None = None,
) -> Estimate:
    """Update an estimate by the known field of the site.

    Parameters
    ----------
    estimate : Estimate
        Estimate of `Level` at the dip of the site, or of any method that claims all nine parameters.
    readings : Readings
        Readings of the estimate.
    site : Site, optional
        Known field, with the strength in the unit of the readings; a strength that contradicts the ellipsoid is not
        used.
    dip_deg : float
        Inclination of `estimate`, in degrees.
    alignment_sigma_deg : float, optional
        1 σ in degrees of the angle between the sensor's z axis and the vertical in a level vehicle.

    Returns
    -------
    Estimate
        Estimate with smaller claims. The claims stay for a level turn on a slope, as the accelerometer shows it, and
        for a level turn with an unknown direction of z. `Estimate.strength` is that of the site if it was used.
    """
    if estimate.method != Level.name and (estimate.plane or site is None):
        return estimate  # a two-axis recipe has no claim for the third axis
    record = _make_record(estimate, dip_deg)
    field = readings.thin(MAX_ITERATED_READINGS, Level.name) if estimate.plane else np.empty((0, 3))
    vertical = _vertical_sums(readings, record) if estimate.plane else None
    known = _site_row(site, alignment_sigma_deg, z_down=_has_z_down(readings))
    uses_strength = engine().apply_site(record, known, field, vertical)
    strengths = SiteStrength(*(float(record[name]) for name in ("site_strength", "strength_found", "strength_sigmas")))
    return replace(
        estimate,
        ellipsoid=Ellipsoid(record["centre"].copy(), symmetric_matrix(record["shape"])),
        covariance=record["covariance"].reshape(9, 9).copy(),
        textbook=None if estimate.textbook is None else record["textbook"].reshape(9, 9).copy(),
        strength=strengths.site if uses_strength else estimate.strength,
        site_strength=None if math.isnan(strengths.site) else strengths,
        z_down=Z_DOWN_BY_CONSTANT[int(record["z_axis"])],
    )


def _make_record(estimate: Estimate, dip_deg: float) -> Records:
    """Record of the engine with the ellipsoid, covariances, noise and rejection limit of an estimate."""
    record = engine().record()
    record["centre"], record["shape"] = estimate.ellipsoid.centre, upper_entries(estimate.ellipsoid.shape)
    record["radius"], record["noise"], record["dip_deg"] = estimate.ellipsoid.radius, estimate.noise, dip_deg
    record["covariance"] = estimate.covariance.ravel()
    if estimate.textbook is not None:
        record["textbook"] = estimate.textbook.ravel()
    record["rejected_beyond"] = estimate.rejected_beyond if math.isfinite(estimate.rejected_beyond) else 0.0
    record["plane"] = estimate.plane is not None
    return record


def _site_row(site: Site | None, alignment_sigma_deg: float | None, *, z_down: bool) -> Records:
    """Row of `SITE` for the engine."""
    if site is None:
        return engine().site()
    return engine().site(
        strength=site.strength,
        gain_sigma=site.gain_sigma,
        inclination_deg=site.inclination_deg,
        inclination_sigma_deg=site.inclination_sigma_deg,
        alignment_sigma_deg=alignment_sigma_deg,
        z_down=site.z_down or z_down,
    )


def _vertical_sums(readings: Readings, record: Records) -> Records | None:
    """Sums of accelerometer readings of a level turn; None without an accelerometer."""
    if readings.recording is None:
        return None
    vertical = np.zeros((), VERTICAL)
    for block in readings.recording.blocks():
        if block.acceleration is None:
            return None
        engine().add_vertical(vertical, block.field, block.acceleration, record)
    return vertical


def _has_z_down(readings: Readings) -> bool:
    """Whether z points down because the axes were mapped by the user, or are those of a vehicle."""
    recording = readings.recording
    return recording is not None and (not recording.axes.is_identity or frame_of(recording) == "vehicle")
