"""Whether an accelerometer's vertical leans in turns: what moves it along then is no gravity.

A vehicle that turns at the rate ω at speed s is accelerated by sω to one side of its body, and its vertical v leans to
the other, by ωw, with w at rest in the body. In the dip of a fit, |v| sin I − vᵀq, that leaves ω wᵀq: means over a
second are regressed on the three products, and |w| times the rms rate is the lean. Where a fit knows
nothing of the accelerometer, its rotation against the magnetometer leaves a multiple of each of v × q, and its bias one
of each of q − (vᵀq)v: both are regressed on as well.

>>> from flinders import simulate
>>> from flinders.estimators.aiding import solve
>>> swayed, flown = (simulate.tumble(seed=1, motion=motion, n=1500).samples for motion in ("swayed", "flight"))
>>> lean_in_turns_deg(swayed, solve(swayed, ())) < 0.2, lean_in_turns_deg(flown, solve(flown, ())) > 10.0
(True, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.rotation import lengths
from flinders.heading.attitude import magnetic_heading_deg
from flinders.likelihood import dip

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.aiding import Aided

MEAN_S: Final = 1.0
"""Over which noise is averaged; turns last longer."""

FEWEST: Final = 20
"""Means of nine unknowns."""


def lean_in_turns_deg(samples: Samples, aided: Aided) -> float:
    """Angle (rms) by which the vertical of an accelerometer leans with the rate of turning.

    `samples`: with times and an acceleration, or there is nothing to see; `aided`: a fit to them, best without ``dip``:
    that one bends until less of the lean is left. Returns degrees, 0 where nothing is seen.
    """
    if samples.acceleration is None or samples.time is None:
        return 0.0
    down, trust = dip.verticals(samples.acceleration)
    known = (trust > 0.0) & np.isfinite(samples.time)
    field, time = aided.corrected(samples.field[known]), samples.time[known]
    if not len(time) > 1 or not np.all(np.diff(time) > 0.0):
        return 0.0
    vertical, _ = dip.upright(down[known], aided.parameters.accelerometer)
    q = field / np.maximum(lengths(field), 1e-300)[:, np.newaxis]
    turning = np.gradient(np.unwrap(np.deg2rad(np.nan_to_num(magnetic_heading_deg(q, -vertical)))), time)
    left = dip.residuals(vertical[np.newaxis], q[np.newaxis], aided.parameters.sine)[0]
    across = q - np.einsum("ni,ni->n", vertical, q)[:, np.newaxis] * vertical
    others = () if "sine" in aided.layout else (np.cross(vertical, q), across)
    rows = _means(np.column_stack([left, turning, turning[:, np.newaxis] * q, *others]), time)
    if len(rows) < FEWEST:
        return 0.0
    rows -= rows.mean(axis=0)
    lean = np.linalg.lstsq(rows[:, 2:], rows[:, 0], rcond=1e-6)[0][:3]
    return float(np.rad2deg(np.linalg.norm(lean) * np.std(rows[:, 1])))


def _means(rows: Floats, time: Floats) -> Floats:
    """(M, K) means of (N, K) rows over `MEAN_S`."""
    each = max(1, round(MEAN_S / float(np.median(np.diff(time)))))
    whole = len(rows) // each * each
    means: Floats = rows[:whole].reshape(-1, each, rows.shape[1]).mean(axis=1)
    return means
