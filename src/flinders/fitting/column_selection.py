"""Which columns of a log a calibration follows, of those that were named: those that explain readings left out.

Each is tried beside all others, by the hold-out of `flinders.fitting.disturbance_selection`. The one that explains
least is left out if that is nothing, and the fit says so; then the rest is tried again. One that follows the direction
of the field is refused, as it cannot be told from soft iron. Currents, throttles and temperatures that are named are
always followed.

>>> from dataclasses import replace
>>> import numpy as np
>>> from flinders import simulate
>>> wheel = simulate.NamedColumn("wheel_rpm", [0.002, 0.0, -0.001], highest=3000.0)
>>> noise = {"humidity": np.random.default_rng(1).normal(size=1200)}
>>> drive = simulate.tumble(seed=1, n=1200, disturbances=[wheel]).samples
>>> drive = replace(drive, auxiliary={**drive.auxiliary, **noise})
>>> found = selected(drive, ("wheel_rpm", "humidity"))
>>> found.names, [one.name for one in found.unused]
(('wheel_rpm',), ['humidity'])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.disturbance import is_column
from flinders.core.joining import in_memory, joined, singles
from flinders.diagnostics.attitude_following import following
from flinders.errors import FollowsAttitude
from flinders.estimators.columns import in_numbers, states_in
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.regressors import DisturbanceEstimate, Logged
from flinders.estimators.static_bench import still
from flinders.fitting.disturbance_selection import WORTH, hold_out_residuals
from flinders.likelihood import prior
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators.disturbance import DisturbanceFit

MAX_FOLLOWING: Final = 0.75
"""Share of a column that directions of the field predict, beyond which it is refused."""


MAX_COLLINEARITY: Final = 0.95
"""Share of what tells about a column that offset and soft iron could explain as well, beyond which it is refused."""


MAX_EXPLAINED: Final = 0.3
"""Of the strength of the field, rms: a column that explains more may have taken the field itself."""


class Selected(NamedTuple):
    """Recordings with columns of numbers, the disturbances to follow, and columns that explain nothing."""

    recording: Recording
    names: tuple[str, ...]
    unused: tuple[DisturbanceEstimate, ...] = ()
    states: Mapping[str, tuple[str, ...]] = {}


def selected(source: Recording, names: Sequence[str], *, spread: float | None = prior.SPREAD) -> Selected:
    """Choose among columns that were named.

    Raises `FollowsAttitude` for a column that is a function of the direction of the field; `InputError` for one that is
    not there, or has words and not two of them; `UsageError` and `TooFewSamples` as
    `flinders.estimators.disturbance.fit_disturbances`.

    Parameters
    ----------
    source : Recording
        One, or several of one sensor.
    names : sequence of str
        As for `fit_disturbances`.
    spread : float, optional
        Of the prior on the shape.
    """
    parts = [samples for part in singles(source) if len(samples := in_memory(part))]
    states = states_in(parts, names)
    parts = [in_numbers(part, states) for part in parts]
    whole = joined(parts) if parts else source
    moving, _ = Logged.of(parts, tuple(names)).split()
    columns = [name for name in dict.fromkeys(names) if is_column(name) and name in moving]
    if not columns or still(parts, names) is not None:
        return Selected(whole, tuple(names), states=states)
    refuse_attitude(parts, names, columns, spread)
    kept, unused = tuple(dict.fromkeys(names)), list[DisturbanceEstimate]()
    while columns:
        ratios = {name: _scatter_ratio(parts, kept, name, spread) for name in columns}
        worst = max(columns, key=lambda name: ratios[name])
        if ratios[worst] <= WORTH:
            break
        unused.append(DisturbanceEstimate(worst, scatter_ratio=ratios[worst]))
        columns.remove(worst)
        kept = tuple(name for name in kept if name != worst)
    return Selected(whole, kept, tuple(unused), states)


def _scatter_ratio(parts: Sequence[Samples], names: tuple[str, ...], column: str, spread: float | None) -> float:
    """Scatter of the field's strength in stretches left out, with one of the disturbances over without it."""
    others = tuple(name for name in names if name != column)
    before, after = hold_out_residuals(parts, others, names, spread)
    return after / before


def refuse_attitude(
    parts: Sequence[Samples], names: Sequence[str], columns: Sequence[str], spread: float | None
) -> None:
    """Raise `FollowsAttitude` for the first of some columns that is a function of the direction of the field.

    Directions are those of a fit that follows all columns. Where a column takes most of the field itself, as a linear
    function of the direction can, they are those of a fit that follows none. Such a column may leave all readings in
    one plane, and an ellipsoid of any size through them: its share is of the smaller of the two.
    """
    found = fit_disturbances(parts, names, spread=spread)
    logged = Logged.of(parts, tuple(names))
    values = {name: logged.lagged(name, 0.0) for name in columns}
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
        share, linear = following(values[one.name], directions), one.attitude_collinearity
        if share > MAX_FOLLOWING or linear > MAX_COLLINEARITY:
            raise FollowsAttitude(one.name, max(share, linear))


def _directions(logged: Logged, found: DisturbanceFit) -> Floats:
    """(N, 3) directions of the field in readings less what disturbances add."""
    readings = logged.field
    for one in found.disturbances:
        readings = readings - one.shift(logged.lagged(one.name, one.lag_s))
    return directions_of(readings, found.ellipsoid)
