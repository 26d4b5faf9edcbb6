"""Outliers of a joint fit, and the fit without them.

A reading is an outlier if its residual is many times the median residual. Readings shortly before and after it are left
out as well, as in a fit of the magnitude (`flinders.estimators.outliers`). If a body hardly tilts, a few readings near
a magnet can change the offset along the vertical more than all others, and then have small residuals. Therefore the fit
starts with reduced weights of large residuals (`JointProblem.make_robust`) instead of least squares. For a level turn
reduced weights are not enough along the vertical; the fit then starts without the outliers of the ellipse in the plane.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.outliers import extend_to_runs
from flinders.geometry.rotation import lengths
from flinders.likelihood.observations import unweighted_residuals
from flinders.likelihood.solver import levenberg_marquardt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.outliers import Outlier
    from flinders.likelihood.joint import JointIterate, JointProblem
    from flinders.likelihood.observations import ObservationGroup

OUTLIER_RATIO: Final = 6.0
"""Residual of an outlier, as a multiple of the median residual."""

MIN_INLIER_SHARE: Final = 0.8
"""Smallest fraction of inliers; with fewer, the model does not fit, and no reading is left out."""

MAX_ROUNDS: Final = 4
"""Largest number of fits and searches for outliers."""


def fit_without_outliers(problem: JointProblem, iterate: JointIterate, steps: int) -> JointIterate:
    """Fit without outliers, and find outliers again, until they no longer change.

    Parameters
    ----------
    problem : JointProblem
        The problem with all readings.
    iterate : JointIterate
        Start, close enough to the solution for outliers to have large residuals.
    steps : int
        Largest number of steps of each fit.
    """
    for attempt in range(MAX_ROUNDS):
        groups = _inliers(iterate)
        pairs = zip(groups, iterate.groups, strict=True)
        if attempt and all(np.array_equal(new.weight, old.weight) for new, old in pairs):
            break
        iterate = levenberg_marquardt(problem, replace(iterate, groups=groups), steps)
    return iterate


def leave_out_runs(problem: JointProblem, outliers: Sequence[Outlier]) -> JointProblem:
    """The problem with weight 0 for runs of outliers."""
    weight = np.ones(1 + max(int(group.rows.max()) for group in problem.groups))
    for run in outliers:
        weight[run.first - 1 : run.last] = 0.0
    return replace(problem, groups=tuple(_set_weights(group, weight[group.rows]) for group in problem.groups))


def _inliers(iterate: JointIterate) -> tuple[ObservationGroup, ...]:
    """Groups with weight 0 for outliers and their neighbours, or for outliers alone if too few would remain."""
    rows = np.concatenate([group.rows.ravel() for group in iterate.groups])
    far = np.zeros(int(rows.max()) + 1, dtype=bool)
    far[rows] = _find_outliers(iterate)
    enough = (one for one in (~extend_to_runs(far), ~far) if one[rows].mean() > MIN_INLIER_SHARE)
    weight = next(enough, np.ones_like(far)).astype(float)
    return tuple(_set_weights(group, weight[group.rows]) for group in iterate.groups)


def _find_outliers(iterate: JointIterate) -> NDArray[np.bool_]:
    """(N,) whether each reading of all groups is an outlier, by its residual."""
    parts = zip(iterate.groups, iterate.directions, strict=True)
    length = np.concatenate(
        [lengths(unweighted_residuals(group, iterate.at, known)[0]).ravel() for group, known in parts]
    )
    usual = max(float(np.median(length)), iterate.weights.noise * 1e-3)
    return np.asarray(length > OUTLIER_RATIO * usual)


def _set_weights(group: ObservationGroup, weight: Floats) -> ObservationGroup:
    """Set the (W, n) weights of a group's readings, and of their verticals or attitudes."""
    return replace(group, weight=weight, trust=None if group.trust is None else group.trust * weight)
