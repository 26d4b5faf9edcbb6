"""Which disturbances of a recording earn their place: those that explain readings which they were not fitted to.

Current, throttle and temperature are tried one after the other, each with those that were kept; then currents and
throttles of each motor, in place of those of all together. The recording is cut in twelve intervals; a third of them,
spread over the recording, is left out in turn. A disturbance is kept if the strength of the field there scatters less
for it, by two per cent at least.

When to use it: ``--with auto``. A disturbance that is known to matter is better named, and its findings read.

>>> from flinders import simulate
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> flight = simulate.tumble(seed=1, n=1200, disturbances=[motors]).samples
>>> names, (current,) = earned(flight)
>>> names, current.is_used, current.heading_change_deg > 10.0
(('current',), True, True)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.arrays import runs
from flinders.core.compensation import compensated
from flinders.core.disturbance import KINDS, MOTORS, motor
from flinders.core.joining import in_memory, singles
from flinders.diagnostics.hold_out import folds
from flinders.errors import FitError, InputError, figures
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.regressors import Logged
from flinders.estimators.static_bench import still
from flinders.fitting.aiding import AidingSensor
from flinders.likelihood import magnitude, prior
from flinders.likelihood.robust import robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples

PIECES: Final = 4
"""Intervals of each fold: a motor runs for a while, and has to run in what is fitted and in what is left out."""

WORTH: Final = 0.98
"""Of the scatter of what was left out: a disturbance that leaves more than this explains nothing."""

ENTANGLED: Final = 0.95
"""Of what tells about a disturbance: where the attitude explains more, what it explains elsewhere is the attitude."""

APART: Final = "each motor by itself explains more"

FARTHEST: Final = 5.0
"""Robust standard deviations beyond which a distance counts for no more."""


def earned(
    source: Recording, *, spread: float | None = prior.SPREAD, dip_deg: float = 60.0
) -> tuple[tuple[str, ...], tuple[AidingSensor, ...]]:
    """Names of the disturbances that earn their place, and what there is to say of each column that was recorded.

    Parameters
    ----------
    source : Recording
        One, or several of one sensor.
    spread : float, optional
        Of the prior on the shape.
    dip_deg : float
        Inclination at which headings are compared.
    """
    parts = [samples for part in singles(source) if len(samples := in_memory(part))]
    recorded = _of_all(parts)
    accepted: tuple[str, ...] = ()
    reports = []
    for name in (name for name in recorded if name in KINDS):
        reports.append(_report(parts, name, accepted, (*accepted, name), spread, dip_deg))
        if reports[-1].is_used:
            accepted = (*accepted, name)
    for name, many in MOTORS.items():
        each = tuple(column for column in recorded if motor(column)[0] == name and motor(column)[1])
        if len(each) < 2:
            continue
        tried = (*(other for other in accepted if other != name), *each)
        reports.append(_report(parts, many, accepted, tried, spread, dip_deg))
        if reports[-1].is_used:
            accepted = tried
            reports = [replace(one, is_used=False, reason=APART) if one.name == name else one for one in reports]
    return accepted, tuple(reports)


def _of_all(parts: Sequence[Samples]) -> tuple[str, ...]:
    """Names of disturbances that each recording has."""
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
    """Whether the disturbances `tried` explain more than those that were kept before."""
    new = tuple(each for each in tried if each not in accepted)
    try:
        if words := _standstill(parts, new, tried):
            return AidingSensor(name, is_used=False, reason=words)
        before, after = hold_out_residuals(parts, accepted, tried, spread)
        if after > WORTH * before:
            words = "the strength of the field scatters as much with it as without, where it was left out"
            return AidingSensor(name, is_used=False, reason=words)
        found = fit_disturbances(parts, tried, spread=spread)
    except (FitError, InputError) as refusal:
        return AidingSensor(name, is_used=False, reason=refusal.message)
    entangled = max(one.attitude_collinearity for one in found.estimates if one.name in new)
    if entangled > ENTANGLED:
        words = f"{entangled:.1%} of what tells about it could be the attitude as well"
        return AidingSensor(name, is_used=False, reason=words)
    ours = [one for one in found.disturbances if one.name in new]
    changed = max(found.calibration.disturbance_deg(one, dip_deg=dip_deg) for one in ours)
    percent = 100.0 / found.ellipsoid.radius
    words = (
        f"the strength of the field scatters by {figures(percent * after)} % with it and by "
        f"{figures(percent * before)} % without, where it was left out"
    )
    return AidingSensor(name, is_used=True, heading_change_deg=min(changed, 180.0), reason=words)


def _standstill(parts: Sequence[Samples], new: tuple[str, ...], tried: tuple[str, ...]) -> str:
    """Say that the disturbances or the sensor hardly moved; nothing where both did."""
    logged = Logged.of(parts, new)
    moving, _ = logged.split()
    if not moving:
        low = min(float(np.nanmin(values)) for values in logged.values.values())
        high = max(float(np.nanmax(values)) for values in logged.values.values())
        return f"it hardly changed, from {low:.3g} to {high:.3g}"
    if still(parts, tried) is not None:
        return "the sensor was not turned: name it to find what it does on a bench"
    return ""


def hold_out_residuals(
    parts: Sequence[Samples], without: tuple[str, ...], tried: tuple[str, ...], spread: float | None = prior.SPREAD
) -> tuple[float, float]:
    """Root mean square distance of readings that were left out, with some disturbances and with others, in their unit.

    A distance counts for no more than `FARTHEST` standard deviations of the better of the two.
    """
    distances: tuple[list[Floats], list[Floats]] = [], []
    cut = [list(folds(len(part), PIECES)) for part in parts]
    for fold in zip(*cut, strict=True):
        fitted = [run for part, (training, _) in zip(parts, fold, strict=True) for run in _runs(part, training)]
        rest = [run for part, (_, out) in zip(parts, fold, strict=True) for run in _runs(part, out)]
        for names, of_names in zip((without, tried), distances, strict=True):
            found = fit_disturbances(fitted, names, spread=spread)
            calm = (cast("Samples", compensated(run, found.calibration)) for run in rest)
            of_names += [magnitude.distances(run.field, found.ellipsoid) for run in calm]
    sizes = [np.abs(np.concatenate(each)) for each in distances]
    limit = FARTHEST * min(map(robust_sigma, sizes))
    before, after = (float(np.sqrt(np.mean(np.minimum(size, limit) ** 2))) for size in sizes)
    return before, after


def _runs(part: Samples, rows: NDArray[np.bool_]) -> list[Samples]:
    """The stretches of a recording that some rows make."""
    return [part[run] for run in runs(rows)]


def _has(part: Samples, name: str) -> bool:
    """A column is there, and something in it."""
    column = part.driving(name)
    return column is not None and bool(np.isfinite(column).any())
