"""Guidance from the present attitude of the sensor: the path to turn along, for the page to draw.

`flinders.report.view` knows a fit and nothing of where the field points now, so it names the best single direction. A
page that follows the sensor can lead it: this puts the first waypoint of `flinders.heading.path_planning` in place of
that direction, and before any fit has a surface a sphere through the readings so far, so that there is something to
lead on.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.report.view import view
>>> samples = simulate.tumble(seed=1, motion="tilted").samples
>>> fit = calibrate.fit(samples, target_deg=0.1)
>>> drawn = guided(view(fit, samples), fit, samples)
>>> drawn.guidance.words
'follow the arrow: turn it about x (y towards z), then about z (x towards y)'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from flinders.heading import path_planning
from flinders.report.view import GuidanceView, Shown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Frame, Goal
    from flinders.report.view import Triple, View

KNOWN_DEG: Final = 10.0
"""A fit that is farther off than this in some direction is asked for none."""
SPEED_DEG: Final = 90.0
"""Degrees a second that a hand turns a sensor by, for what its readings along the way are worth."""


def guided(view: View, fit: Fit, samples: Samples, *, goal: Goal = "heading", frame: Frame = "sensor") -> View:
    """Put the path from the newest reading into a view; no path is shown where it would gain nothing.

    Parameters
    ----------
    view : View
        Of this fit.
    fit : Fit
        Also that of a `Refused`.
    samples : Samples
        All so far, the newest last.
    goal, frame : str
        As in `flinders.heading.guidance`.
    """
    if fit.plane or not len(samples):
        return view
    belief = believe(fit, samples.field)
    if belief is None:
        return view
    here = belief.direction(samples.field[-1])
    if not here.any():
        return view
    is_seen_from_below = fit.heading_error_deg.dip_deg * fit.dip_deg < 0.0
    path = path_planning.plan(
        belief,
        here,
        target_deg=fit.target_deg,
        goal=goal,
        dip_deg=fit.dip_deg,
        down=np.array([0.0, 0.0, -1.0]) if is_seen_from_below else None,
        readings_per_deg=_readings_per_deg(samples),
    )
    if path.worst_deg <= fit.target_deg and not belief.is_rough:
        return view
    words = f"follow the arrow: {path.words(frame)}"
    leads = GuidanceView(_triple(path.waypoints[0]), words, path.worst_deg, path.after_deg, goal)
    return msgspec.structs.replace(view, guidance=leads, shown=_round(belief) if belief.is_rough else view.shown)


def believe(fit: Fit | None, readings: ArrayLike) -> path_planning.Belief | None:
    """What is known after a fit, also a refused one: what it claims where that makes sense, else a sphere.

    Parameters
    ----------
    fit : Fit, optional
    readings : (N, 3) array-like
        Those that it was made of.
    """
    if fit is None or fit.is_flat or fit.direction_error_deg.worst > KNOWN_DEG:
        return path_planning.rough(readings)
    return path_planning.Belief.of_fit(fit)


def _readings_per_deg(samples: Samples) -> float:
    """What the sensor gives for each degree that it is turned by."""
    time = samples.time
    if time is None or len(time) < 2 or not time[-1] > time[0]:
        return path_planning.READINGS_PER_DEG
    return (len(time) - 1) / float(time[-1] - time[0]) / SPEED_DEG


def _round(belief: path_planning.Belief) -> Shown:
    """A sphere to draw readings on that no fit has a surface for."""
    radius = belief.ellipsoid.radius
    return Shown(_triple(belief.ellipsoid.centre), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), radius)


def _triple(vector: Floats) -> Triple:
    x, y, z = vector.tolist()
    return x, y, z
