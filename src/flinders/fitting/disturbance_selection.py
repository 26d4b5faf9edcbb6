"""Selection of recorded disturbances: a disturbance is followed if it explains readings that it was not fitted to.

Current, throttle and temperature are tried one after the other, each with the disturbances accepted before; then
currents and throttles of each motor, in place of the totals. The recording is cut into twelve intervals; a third of
them, spread over the recording, is left out in turn. A disturbance is accepted if it reduces the scatter of the field
strength in the left-out intervals by at least 2 %.

When to use it: with ``auto``. If a disturbance is known to matter, request it by its name instead.

>>> from flinders import simulate
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> flight = simulate.tumble(seed=1, n=1200, disturbances=[motors]).samples
>>> names, (current,) = select_disturbances(flight)
>>> names, current.is_used, current.heading_change_deg > 10.0
(('current',), True, True)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.arrays import true_runs
from flinders.core.compensation import compensate_recording
from flinders.core.disturbance import KINDS, MOTORS, kind_and_motor
from flinders.core.joining import read_into_memory, single_recordings
from flinders.diagnostics.hold_out import folds
from flinders.errors import FitError, InputError, figures
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.regressors import LoggedDisturbances
from flinders.estimators.static_bench import fit_still
from flinders.fitting.aiding import AidingSensor
from flinders.likelihood import magnitude, prior
from flinders.likelihood.robust import robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples

INTERVALS_PER_FOLD: Final = 4
"""Number of intervals of each fold; with several, fitted and left-out readings both include running motors."""

MAX_SCATTER_RATIO: Final = 0.98
"""Largest scatter of left-out readings with an accepted disturbance, relative to the scatter without it."""

MAX_COLLINEARITY: Final = 0.95
"""Largest share of the information on a disturbance that the attitude may explain as well."""

REPLACED_BY_MOTORS: Final = "each motor by itself explains more"

MAX_DISTANCE_SIGMAS: Final = 5.0
"""Largest distance in robust standard deviations; larger distances are clipped to it."""


def select_disturbances(
    source: Recording, *, spread: float | None = prior.SOFT_IRON_SPREAD, dip_deg: float = 60.0
) -> tuple[tuple[str, ...], tuple[AidingSensor, ...]]:
    """Names of the disturbances to follow, and a report of each recorded column.

    Parameters
    ----------
    source : Recording
        One, or several of one sensor.
    spread : float, optional
        Standard deviation of the prior on the shape.
    dip_deg : float
        Inclination at which headings are compared.
    """
    parts = [samples for part in single_recordings(source) if len(samples := read_into_memory(part))]
    recorded = _common_disturbances(parts)
    accepted: tuple[str, ...] = ()
    reports = []
    for name in (name for name in recorded if name in KINDS):
        reports.append(_report(parts, name, accepted, (*accepted, name), spread, dip_deg))
        if reports[-1].is_used:
            accepted = (*accepted, name)
    for name, many in MOTORS.items():
        each = tuple(column for column in recorded if kind_and_motor(column)[0] == name and kind_and_motor(column)[1])
        if len(each) < 2:
            continue
        tried = (*(other for other in accepted if other != name), *each)
        reports.append(_report(parts, many, accepted, tried, spread, dip_deg))
        if reports[-1].is_used:
            accepted = tried
            reports = [
                replace(one, is_used=False, reason=REPLACED_BY_MOTORS) if one.name == name else one for one in reports
            ]
    return accepted, tuple(reports)


def _common_disturbances(parts: Sequence[Samples]) -> tuple[str, ...]:
    """Names of the disturbances that all recordings have."""
    names = parts[0].disturbances if parts else ()
    return tuple(name for name in names if all(_has(part, name) for part in parts))


def _report(
    parts: Sequence[Samples],
    name: str,
    accepted: tuple[str, ...],
    tried: tuple[str, ...],
    spread: float | None,
    dip_deg: float,
) -> AidingSensor:
    """Report whether the disturbances `tried` explain more than those accepted before."""
    new = tuple(each for each in tried if each not in accepted)
    try:
        if words := _standstill(parts, new, tried):
            return AidingSensor(name, is_used=False, reason=words)
        before, after = hold_out_residuals(parts, accepted, tried, spread)
        if after > MAX_SCATTER_RATIO * before:
            words = "the strength of the field scatters as much with it as without, in readings that were left out"
            return AidingSensor(name, is_used=False, reason=words)
        found = fit_disturbances(parts, tried, spread=spread)
    except (FitError, InputError) as refusal:
        return AidingSensor(name, is_used=False, reason=refusal.message)
    entangled = max(one.attitude_collinearity for one in found.estimates if one.name in new)
    if entangled > MAX_COLLINEARITY:
        words = f"{entangled:.1%} of the information on it could be the attitude as well"
        return AidingSensor(name, is_used=False, reason=words)
    ours = [one for one in found.disturbances if one.name in new]
    changed = max(found.calibration.disturbance_deg(one, dip_deg=dip_deg) for one in ours)
    percent = 100.0 / found.ellipsoid.radius
    words = (
        f"the strength of the field scatters by {figures(percent * after)} % with it and by "
        f"{figures(percent * before)} % without, in readings that were left out"
    )
    return AidingSensor(name, is_used=True, heading_change_deg=min(changed, 180.0), reason=words)


def _standstill(parts: Sequence[Samples], new: tuple[str, ...], tried: tuple[str, ...]) -> str:
    """Sentence that the disturbances or the attitude of the body hardly changed; empty if both changed."""
    logged = LoggedDisturbances.of(parts, new)
    moving, _ = logged.split()
    if not moving:
        low = min(float(np.nanmin(values)) for values in logged.values.values())
        high = max(float(np.nanmax(values)) for values in logged.values.values())
        return f"it hardly changes: {low:.3g} to {high:.3g}"
    if fit_still(parts, tried) is not None:
        return "the sensor was not turned: name the disturbance to measure its effect on a bench"
    return ""


def hold_out_residuals(
    parts: Sequence[Samples],
    without: tuple[str, ...],
    tried: tuple[str, ...],
    spread: float | None = prior.SOFT_IRON_SPREAD,
) -> tuple[float, float]:
    """Rms distance of left-out readings from the ellipsoid, first with `without`, then with `tried`, in their unit.

    Distances are clipped at `MAX_DISTANCE_SIGMAS` standard deviations of the better of the two.
    """
    distances: tuple[list[Floats], list[Floats]] = [], []
    cut = [list(folds(len(part), INTERVALS_PER_FOLD)) for part in parts]
    for fold in zip(*cut, strict=True):
        fitted = [run for part, (training, _) in zip(parts, fold, strict=True) for run in _runs(part, training)]
        rest = [run for part, (_, out) in zip(parts, fold, strict=True) for run in _runs(part, out)]
        for names, of_names in zip((without, tried), distances, strict=True):
            found = fit_disturbances(fitted, names, spread=spread)
            calm = (cast("Samples", compensate_recording(run, found.calibration)) for run in rest)
            of_names += [magnitude.distances(run.field, found.ellipsoid) for run in calm]
    sizes = [np.abs(np.concatenate(each)) for each in distances]
    limit = MAX_DISTANCE_SIGMAS * min(map(robust_sigma, sizes))
    before, after = (float(np.sqrt(np.mean(np.minimum(size, limit) ** 2))) for size in sizes)
    return before, after


def _runs(part: Samples, rows: NDArray[np.bool_]) -> list[Samples]:
    """Contiguous stretches of a recording that the mask `rows` selects."""
    return [part[run] for run in true_runs(rows)]


def _has(part: Samples, name: str) -> bool:
    """Whether a recording has a column with at least one value."""
    column = part.disturbance_values(name)
    return column is not None and bool(np.isfinite(column).any())
