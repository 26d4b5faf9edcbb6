"""Which disturbances of a recording earn their place: those that explain readings which they were not fitted to.

Current, throttle and temperature are tried one after the other, each beside those that were kept; then currents and
throttles of all motors one by one, in place of those of all together. The recording is cut
in twelve stretches; a third of them, spread over the recording, is left out in turn. A disturbance is kept if the
strength of the field there scatters less for it, by two per cent at least.

When to use it: ``--with auto``. A disturbance that is known to matter is better named, and its findings read.

>>> from flinders import simulate
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> flight = simulate.tumble(seed=1, n=1200, disturbances=[motors]).samples
>>> names, (current,) = earned(flight)
>>> names, current.kept, current.changed_deg > 10.0
(('current',), True, True)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import runs
from flinders.core.compensation import compensated
from flinders.core.disturbance import KINDS, MOTORS, motor
from flinders.core.samples import Samples, singles
from flinders.diagnostics.hold_out import folds
from flinders.errors import FitError, InputError, figures
from flinders.estimators.data import concatenated
from flinders.estimators.disturbance import driving_of
from flinders.estimators.regressors import Logged
from flinders.estimators.static_bench import still
from flinders.fitting.aiding import AidingSensor
from flinders.likelihood import magnitude, prior

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

PIECES: Final = 4
"""Stretches of each fold: a motor runs for a while, and has to run in what is fitted and in what is left out."""

WORTH: Final = 0.98
"""Of the scatter of what was left out: a disturbance that leaves more than this explains nothing."""

ENTANGLED: Final = 0.95
"""Of what tells about a disturbance: where the attitude explains more, what it explains elsewhere is the attitude."""

APART: Final = "each motor by itself explains more"

STRAY: Final = 5.0
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
    parts = [_in_memory(part) for part in singles(source)]
    parts = [part for part in parts if len(part)]
    if not parts or not _of_all(parts):
        return (), ()
    there = [name for name in _of_all(parts) if name in KINDS]
    kept: tuple[str, ...] = ()
    reports = []
    for name in there:
        reports.append(_requested(parts, _DisturbanceTrial(name, kept, (name,)), spread, dip_deg))
        if reports[-1].kept:
            kept = (*kept, name)
    for of, many in MOTORS.items():
        each = tuple(name for name in _of_all(parts) if motor(name)[0] == of and motor(name)[1])
        others = tuple(name for name in kept if name != of)
        if len(each) < 2:
            continue
        reports.append(_requested(parts, _DisturbanceTrial(many, kept, each, instead=of), spread, dip_deg))
        if reports[-1].kept:
            kept = (*others, *each)
            reports = [replace(one, kept=False, words=APART) if one.name == of else one for one in reports]
    return kept, tuple(reports)


@dataclass(frozen=True, slots=True)
class _DisturbanceTrial:
    """What is tried.

    Attributes
    ----------
    name : str
        What it is called.
    kept : tuple of str
        Disturbances that were kept before.
    names : tuple of str
        Those that come.
    instead : str
        The one that goes for them.
    """

    name: str
    kept: tuple[str, ...]
    names: tuple[str, ...]
    instead: str = ""

    @property
    def tried(self) -> tuple[str, ...]:
        """All that are followed then."""
        return (*(name for name in self.kept if name != self.instead), *self.names)


def _of_all(parts: Sequence[Samples]) -> tuple[str, ...]:
    """Names of disturbances that each recording has."""
    return tuple(name for name in parts[0].disturbances if all(_has(part, name) for part in parts))


def _requested(
    parts: Sequence[Samples], trial: _DisturbanceTrial, spread: float | None, dip_deg: float
) -> AidingSensor:
    """What there is to say of a trial, also where it is refused."""
    try:
        return _tried(parts, trial, spread, dip_deg)
    except (FitError, InputError) as refusal:
        return AidingSensor(trial.name, kept=False, words=str(refusal))


def _tried(parts: Sequence[Samples], trial: _DisturbanceTrial, spread: float | None, dip_deg: float) -> AidingSensor:
    """What there is to say of disturbances beside those that were kept."""
    name, logged = trial.name, Logged.of(parts, trial.names)
    moving, _ = logged.split()
    if not moving:
        low = min(float(np.nanmin(values)) for values in logged.values.values())
        high = max(float(np.nanmax(values)) for values in logged.values.values())
        return AidingSensor(name, kept=False, words=f"it hardly changed, from {low:.3g} to {high:.3g}")
    if still(parts, trial.tried) is not None:
        return AidingSensor(
            name, kept=False, words="the sensor was not turned: name it to find what it does on a bench"
        )
    before, after = hold_out_residuals(parts, trial.kept, trial.tried, spread)
    if after > WORTH * before:
        words = "the strength of the field scatters as much with it as without, where it was left out"
        return AidingSensor(name, kept=False, words=words)
    driving = driving_of(parts, trial.tried, spread=spread)
    ours = [one for one in driving.disturbances if one.name in trial.names]
    entangled = max(one.shared for one in driving.found if one.name in trial.names)
    if entangled > ENTANGLED:
        return AidingSensor(
            name, kept=False, words=f"{entangled:.1%} of what tells about it could be the attitude as well"
        )
    taken = max(driving.calibration.disturbance_deg(one, dip_deg=dip_deg) for one in ours)
    strength = driving.ellipsoid.radius
    words = (
        f"the strength of the field scatters by {figures(100.0 * after / strength)} % with it and by "
        f"{figures(100.0 * before / strength)} % without, "
        "where it was left out"
    )
    return AidingSensor(name, kept=True, changed_deg=min(taken, 180.0), words=words)


def hold_out_residuals(
    parts: Sequence[Samples], without: tuple[str, ...], tried: tuple[str, ...], spread: float | None = prior.SPREAD
) -> tuple[float, float]:
    """Root mean square distance of readings that were left out, with some disturbances and with others, in their unit.

    A distance counts for no more than `STRAY` standard deviations of the better of the two.
    """
    misses: tuple[list[Floats], list[Floats]] = [], []
    cut = [list(folds(len(part), PIECES)) for part in parts]
    for fold in zip(*cut, strict=True):
        fitted = [run for part, (kept, _) in zip(parts, fold, strict=True) for run in _runs(part, kept)]
        rest = [run for part, (_, out) in zip(parts, fold, strict=True) for run in _runs(part, out)]
        for names, distances in zip((without, tried), misses, strict=True):
            driving = driving_of(fitted, names, spread=spread)
            for run in rest:
                calm = compensated(run, driving.calibration)
                assert isinstance(calm, Samples)
                distances.append(magnitude.distances(calm.field, driving.ellipsoid))
    sizes = [np.abs(np.concatenate(distances)) for distances in misses]
    limit = STRAY * 1.4826 * min(float(np.median(size)) for size in sizes)
    before, after = (float(np.sqrt(np.mean(np.minimum(size, limit) ** 2))) for size in sizes)
    return before, after


def _runs(part: Samples, rows: NDArray[np.bool_]) -> list[Samples]:
    """The stretches of a recording that some rows make."""
    return [part[run] for run in runs(rows)]


def _in_memory(part: Recording) -> Samples:
    """One recording as it is, or put together of its blocks."""
    return part if isinstance(part, Samples) else concatenated(list(part.blocks()), part)


def _has(part: Samples, name: str) -> bool:
    """A column is there, and something in it."""
    column = part.driving(name)
    return column is not None and bool(np.isfinite(column).any())
