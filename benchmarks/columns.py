"""Auxiliary columns of a log: used if they explain readings, refused if they follow the attitude.

Each simulated vehicle has a sensor with hard and soft iron, which is turned by hand for a minute, and a disturbance on
board: a wheel, a servo, a charger. A column of the log follows the disturbance, with a coefficient of determination R²
between 0.5 and 1; the rest of the disturbance is not logged. A column is *found* if the calibration uses it. Its effect
is *removed* if the disturbance that is left is at most `MAX_RESIDUAL_RATIO` times the residual of the best straight
line in the column, or exceeds that residual by at most `MAX_LEFT_DEG` of heading.

Columns that follow the attitude are functions of the field's direction: linear, quadratic, a step, or an odd
polynomial, with noise down to R² = 0.9. They must be refused (`FollowsAttitude`). Columns of a third kind have no
relation to either, and must be left out (`column-unused`).

    python -m benchmarks.columns                    100 vehicles of each kind
    python -m benchmarks.columns --vehicles 12      fewer
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders import simulate
from flinders.errors import FlindersError, FollowsAttitude
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

VEHICLES: Final = 100
NAME: Final = "wheel_rpm"
MAX_RESIDUAL_RATIO: Final = 1.1
"""Largest ratio of the remaining disturbance to the residual of the best straight line in the column; both are rms."""

MAX_LEFT_DEG: Final = 0.25
"""Largest excess of the remaining disturbance over that residual, in degrees of heading (rms) at a dip of 60°."""

DIP_DEG: Final = 60.0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A simulated recording with a column, and the true effect of the column."""

    samples: Samples
    changing: Floats  #: (N, 3) µT: disturbance on board
    share: float  #: R² between the column and the disturbance
    field_strength: float


def explained(seed: int) -> Vehicle:
    """Vehicle with a column that explains part of a disturbance, R² 0.5 to 1; every third column has states."""
    rng = np.random.default_rng([seed, 1])
    share, size = rng.uniform(0.5, 1.0), rng.uniform(1.5, 8.0)  # µT, rms of all that changes
    hold = rng.uniform(1.0, 5.0)
    states = ("off", "on") if seed % 3 == 0 else ()
    shape = simulate.NamedColumn(NAME, [1.0, 0.0, 0.0], hold=hold, states=states)
    other = simulate.NamedColumn("unlogged", [1.0, 0.0, 0.0], hold=rng.uniform(0.3, 1.0))
    time = simulate.tumble(seed=seed).samples.time
    assert time is not None
    true, unlogged = _unit(shape.on(time, rng).shift[:, 0]), _unit(other.on(time, rng).shift[:, 0])
    direction, tumble = _direction(rng), simulate.tumble(seed=seed)
    if seed % 3 == 1:  # measured with a noisy meter
        course = _unit(np.sqrt(share) * true + np.sqrt(1.0 - share) * rng.standard_normal(len(true)))
        whole = size * true
    else:
        course = true
        whole = size * (np.sqrt(share) * true + np.sqrt(1.0 - share) * unlogged)
    changing = np.outer(whole, direction)
    column = np.where(course > course.mean(), *reversed(states)) if states else 1000.0 * course + 2000.0
    samples = replace(tumble.samples, field=tumble.samples.field + changing, auxiliary={NAME: column})
    return Vehicle(samples, changing, share, tumble.field_strength)


SHAPES: Final[tuple[Callable[[Floats, Generator], Floats], ...]] = (
    lambda u, rng: u @ _direction(rng),
    lambda u, rng: (u @ _direction(rng)) ** 2,
    lambda u, rng: np.tanh(8.0 * (u @ _direction(rng))),
    lambda u, rng: (u @ _direction(rng)) ** 3 + (u @ _direction(rng)) * (u @ _direction(rng)),
)
"""Functions of the field's direction."""


def following(seed: int) -> Vehicle:
    """Vehicle with a column that is a function of the field's direction, with noise down to R² = 0.9."""
    rng = np.random.default_rng([seed, 2])
    tumble = simulate.tumble(seed=seed)
    matrix, offset = tumble.sensor.correction
    directions = (tumble.samples.field - offset) @ np.asarray(matrix).T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    share = rng.uniform(0.9, 1.0)
    course = _unit(SHAPES[seed % len(SHAPES)](directions, rng))
    column = np.sqrt(share) * course + np.sqrt(1.0 - share) * rng.standard_normal(len(course))
    effect = rng.uniform(0.0, 5.0) * np.outer(course, _direction(rng))
    samples = replace(tumble.samples, field=tumble.samples.field + effect, auxiliary={NAME: 1000.0 * column})
    return Vehicle(samples, effect, share, tumble.field_strength)


def idle(seed: int) -> Vehicle:
    """Vehicle with a column that has no effect."""
    rng = np.random.default_rng([seed, 3])
    tumble = simulate.tumble(seed=seed)
    assert tumble.samples.time is not None
    column = simulate.NamedColumn(NAME, [0.0, 0.0, 0.0], hold=rng.uniform(1.0, 5.0), highest=3000.0)
    auxiliary = column.on(tumble.samples.time, rng).auxiliary
    samples = replace(tumble.samples, auxiliary=dict(auxiliary))
    return Vehicle(samples, np.zeros_like(samples.field), 0.0, tumble.field_strength)


def outcome(vehicle: Vehicle) -> str:
    """Outcome of a fit with the column, as one word."""
    try:
        fit = flinders.fit(vehicle.samples, disturbances=(NAME,))
    except FollowsAttitude:
        return "refused: follows attitude"
    except Refused as refused:
        return _judged(vehicle, refused.fit)
    except FlindersError as error:
        return f"refused: {error.code}"
    return _judged(vehicle, fit)


def _judged(vehicle: Vehicle, fit: Fit) -> str:
    """Outcome of a fit: whether it uses the column, and whether the effect is removed."""
    followed = {one.name: one for one in fit.calibration.disturbances}
    if NAME not in followed:
        return "left out"
    one, values = followed[NAME], vehicle.samples.auxiliary[NAME]
    line = np.column_stack([one.numbers(values), np.ones(len(values))])
    best = vehicle.changing - line @ np.linalg.lstsq(line, vehicle.changing, rcond=None)[0]
    level = vehicle.field_strength * np.cos(np.deg2rad(DIP_DEG))
    most = max(MAX_RESIDUAL_RATIO * _rms(best), np.hypot(_rms(best), np.deg2rad(MAX_LEFT_DEG) * level))
    left = _rms(vehicle.changing - one.shift(values))
    return "found and removed" if left <= most else "found, not removed"


def _rms(field: Floats) -> float:
    """Root mean square length of (N, 3) fields about their mean."""
    return float(np.sqrt(np.sum(np.var(field, axis=0))))


def _unit(values: Floats) -> Floats:
    """(N,) values, shifted and scaled to mean 0 and standard deviation 1."""
    unit: Floats = (values - values.mean()) / values.std()
    return unit


def _direction(rng: Generator) -> Floats:
    """(3,) random unit vector."""
    vector = rng.standard_normal(3)
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


KINDS: Final[dict[str, tuple[Callable[[int], Vehicle], str]]] = {
    "follows what changes aboard, R² 0.5 to 1": (explained, "found and removed"),
    "follows the attitude": (following, "refused: follows attitude"),
    "moves nothing": (idle, "left out"),
}
"""Kinds of columns: the function that simulates a vehicle, and the outcome that is required."""


def counts(kind: str, vehicles: int) -> Counter[str]:
    """Number of vehicles of a kind, by outcome."""
    made, _ = KINDS[kind]
    return Counter(outcome(made(seed)) for seed in range(vehicles))


def main() -> None:
    """Print the outcomes for all kinds of columns."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--vehicles", type=int, default=VEHICLES)
    vehicles = parser.parse_args().vehicles
    for kind, (_, wanted) in KINDS.items():
        found = counts(kind, vehicles)
        rest = ", ".join(f"{count} {what}" for what, count in found.most_common() if what != wanted) or "none"
        print(f"{kind}: {found[wanted]} of {vehicles} {wanted} (others: {rest})")


if __name__ == "__main__":
    main()
