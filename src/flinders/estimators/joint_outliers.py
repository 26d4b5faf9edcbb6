"""Readings that do not belong to a joint fit: what is left out, and the fit without it.

A reading is far where its residual is many times the median; with it go its neighbours, as for a fit of the magnitude
(`flinders.estimators.outliers`). Where a body hardly leans, a few readings near a magnet move the offset along its
vertical by more than all others hold it, and then hardly stick out: the fit has to start where large residuals count
less (`JointProblem.robust`), and not where least squares end. Of a level turn the ellipse in its plane shows them, and
the fit starts without them: along the vertical even such weights let them pull it far.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.outliers import with_runs
from flinders.geometry.rotation import lengths
from flinders.likelihood.observations import residuals_of
from flinders.likelihood.solver import levenberg_marquardt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.outliers import Outlier
    from flinders.likelihood.joint import JointIterate, JointProblem
    from flinders.likelihood.observations import ObservationGroup

FAR: Final = 6.0
"""Times the median residual beyond which a reading does not belong to the rest."""

FEWEST_LEFT: Final = 0.8
"""Share of the readings that have to belong: where fewer do, the model is wrong and not the readings."""

ROUNDS: Final = 4
"""Of a fit, and of looking for readings that do not belong to it."""


def without_outliers(problem: JointProblem, iterate: JointIterate, steps: int) -> JointIterate:
    """Leave out readings that do not belong to the rest, and fit the others, until they are the same again.

    Parameters
    ----------
    problem : JointProblem
    iterate : JointIterate
        Where to begin, near enough for outliers to be seen.
    steps : int
        Of each fit, at most.
    """
    for attempt in range(ROUNDS):
        groups = _inliers(iterate)
        pairs = zip(groups, iterate.groups, strict=True)
        if attempt and all(np.array_equal(new.weight, old.weight) for new, old in pairs):
            break
        iterate = levenberg_marquardt(problem, replace(iterate, groups=groups), steps)
    return iterate


def leaving_out(problem: JointProblem, outliers: Sequence[Outlier]) -> JointProblem:
    """The problem in which runs of readings count nothing."""
    weight = np.ones(1 + max(int(group.rows.max()) for group in problem.groups))
    for run in outliers:
        weight[run.first - 1 : run.last] = 0.0
    return replace(problem, groups=tuple(_weighed(group, weight[group.rows]) for group in problem.groups))


def _inliers(iterate: JointIterate) -> tuple[ObservationGroup, ...]:
    """Groups in which readings that do not belong count nothing; with neighbours or alone, as enough are left."""
    rows = np.concatenate([group.rows.ravel() for group in iterate.groups])
    far = np.zeros(int(rows.max()) + 1, dtype=bool)
    far[rows] = _is_far(iterate)
    enough = (one for one in (~with_runs(far), ~far) if one[rows].mean() > FEWEST_LEFT)
    weight = next(enough, np.ones_like(far)).astype(float)
    return tuple(_weighed(group, weight[group.rows]) for group in iterate.groups)


def _is_far(iterate: JointIterate) -> NDArray[np.bool_]:
    """(N,) readings of all groups whose residual is far beyond the usual."""
    parts = zip(iterate.groups, iterate.directions, strict=True)
    length = np.concatenate([lengths(residuals_of(group, iterate.at, known)[0]).ravel() for group, known in parts])
    usual = max(float(np.median(length)), iterate.weights.noise * 1e-3)
    return np.asarray(length > FAR * usual)


def _weighed(group: ObservationGroup, weight: Floats) -> ObservationGroup:
    """A group with (W, n) weights of readings, and of the verticals or attitudes recorded with them."""
    return replace(group, weight=weight, trust=None if group.trust is None else group.trust * weight)
