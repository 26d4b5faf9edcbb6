"""Selection among named columns of a log: a calibration follows those that explain left-out readings.

All columns are tried together, by the cross-validation of `flinders.fitting.disturbance_selection`. If the column that
explains least does not reduce the scatter of left-out readings, the fit leaves it out and reports it, and the others
are tried again. A column that is a function of the field's direction is refused, as its effect cannot be distinguished
from soft iron. Named currents, throttles and temperatures are always followed.

>>> from dataclasses import replace
>>> import numpy as np
>>> from flinders import simulate
>>> wheel = simulate.NamedColumn("wheel_rpm", [0.002, 0.0, -0.001], highest=3000.0)
>>> noise = {"humidity": np.random.default_rng(1).normal(size=1200)}
>>> drive = simulate.tumble(seed=1, n=1200, disturbances=[wheel]).samples
>>> drive = replace(drive, auxiliary={**drive.auxiliary, **noise})
>>> found = select_columns(drive, ("wheel_rpm", "humidity"))
>>> found.names, [one.name for one in found.unused]
(('wheel_rpm',), ['humidity'])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.disturbance import is_column
from flinders.core.joining import join_recordings, read_into_memory, single_recordings
from flinders.diagnostics.attitude_following import predicted_share
from flinders.errors import FollowsAttitude
from flinders.estimators.columns import column_states, convert_states
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.regressors import DisturbanceEstimate, LoggedDisturbances
from flinders.estimators.static_bench import fit_still
from flinders.fitting.disturbance_selection import MAX_SCATTER_RATIO, hold_out_residuals
from flinders.likelihood import prior
from flinders.summary.coverage import corrected_directions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators.disturbance import DisturbanceFit

MAX_FOLLOWING: Final = 0.75
"""Largest share of a column's variance that field directions may predict; with more, the column is refused."""


MAX_COLLINEARITY: Final = 0.95
"""Largest share of the information on a column that offset and soft iron may explain as well."""


MAX_EXPLAINED: Final = 0.3
"""Largest rms effect of a column, as a share of the field, at which the fit with the column gives the directions."""


class Selection(NamedTuple):
    """Recordings with columns of numbers, the disturbances to follow, and columns that explain nothing."""

    recording: Recording
    names: tuple[str, ...]
    unused: tuple[DisturbanceEstimate, ...] = ()
    states: Mapping[str, tuple[str, ...]] = {}


def select_columns(
    source: Recording, names: Sequence[str], *, spread: float | None = prior.SOFT_IRON_SPREAD
) -> Selection:
    """Select columns to follow among named columns.

    Raises `FollowsAttitude` for a column that is a function of the direction of the field; `InputError` for a missing
    column, or a column of words that are not exactly two; `UsageError` and `TooFewSamples` as
    `flinders.estimators.disturbance.fit_disturbances`.

    Parameters
    ----------
    source : Recording
        One, or several of one sensor.
    names : sequence of str
        As for `fit_disturbances`.
    spread : float, optional
        Standard deviation of the prior on the shape.
    """
    parts = [samples for part in single_recordings(source) if len(samples := read_into_memory(part))]
    states = column_states(parts, names)
    parts = [convert_states(part, states) for part in parts]
    whole = join_recordings(parts) if parts else source
    moving, _ = LoggedDisturbances.of(parts, tuple(names)).split()
    columns = [name for name in dict.fromkeys(names) if is_column(name) and name in moving]
    if not columns or fit_still(parts, names) is not None:
        return Selection(whole, tuple(names), states=states)
    refuse_attitude(parts, names, columns, spread)
    kept, unused = tuple(dict.fromkeys(names)), list[DisturbanceEstimate]()
    while columns:
        ratios = {name: _scatter_ratio(parts, kept, name, spread) for name in columns}
        worst = max(columns, key=lambda name: ratios[name])
        if ratios[worst] <= MAX_SCATTER_RATIO:
            break
        unused.append(DisturbanceEstimate(worst, scatter_ratio=ratios[worst]))
        columns.remove(worst)
        kept = tuple(name for name in kept if name != worst)
    return Selection(whole, kept, tuple(unused), states)


def _scatter_ratio(parts: Sequence[Samples], names: tuple[str, ...], column: str, spread: float | None) -> float:
    """Scatter of the field's strength in left-out stretches with a column, as a multiple of that without it."""
    others = tuple(name for name in names if name != column)
    before, after = hold_out_residuals(parts, others, names, spread)
    return after / before


def refuse_attitude(
    parts: Sequence[Samples], names: Sequence[str], columns: Sequence[str], spread: float | None
) -> None:
    """Raise `FollowsAttitude` for the first of some columns that is a function of the direction of the field.

    The directions come from a fit that follows all columns. A column that is a linear function of the direction can
    absorb most of the field in this fit; its directions then come from a fit that follows no column. The first fit may
    then have readings in one plane only, through which ellipsoids of any size pass. Therefore the smaller radius of the
    two fits is used as the field's strength.
    """
    found = fit_disturbances(parts, names, spread=spread)
    logged = LoggedDisturbances.of(parts, tuple(names))
    values = {name: logged.lagged_values(name, 0.0) for name in columns}
    others = [name for name in dict.fromkeys(names) if name not in values]
    without = fit_disturbances(parts, others, spread=spread)
    followed, plain = _directions(logged, found), None
    strength = min(found.ellipsoid.radius, without.ellipsoid.radius)
    for one in found.estimates:
        if one.name not in values:
            continue
        directions = followed
        if one.explained > MAX_EXPLAINED * strength:
            plain = _directions(logged, without) if plain is None else plain
            directions = plain
        share, linear = predicted_share(values[one.name], directions), one.attitude_collinearity
        if share > MAX_FOLLOWING or linear > MAX_COLLINEARITY:
            raise FollowsAttitude(one.name, max(share, linear))


def _directions(logged: LoggedDisturbances, found: DisturbanceFit) -> Floats:
    """(N, 3) directions of the field in readings with disturbances subtracted."""
    readings = logged.field
    for one in found.disturbances:
        readings = readings - one.shift(logged.lagged_values(one.name, one.lag_s))
    return corrected_directions(readings, found.ellipsoid)
