"""Columns of a log that a calibration follows: found where they explain readings, refused where they follow attitude.

Each vehicle is simulated: a sensor with hard and soft iron, turned by hand for a minute, and something aboard whose
field changes: a wheel, a servo, a charger. Its column follows that field with a coefficient of determination R² from
0.5 to 1; the rest of the field is of something that was not logged. A column is *found* where the calibration follows
it; its effect is *removed* where the changing field that is left is at most `MAX_MORE` times what the best straight
line in the column would leave of the true one, or that and no more than `MAX_LEFT_DEG` of heading.

Columns that follow the attitude are functions of the direction of the field: linear, quadratic, a step, an odd
polynomial, with noise up to R² = 0.9. They have to be refused (`FollowsAttitude`). A third kind moves with neither,
and has to be left out (`column-unused`).

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
MAX_MORE: Final = 1.1
"""Of the rms that the best straight line in the column leaves of the changing field."""

MAX_LEFT_DEG: Final = 0.25
"""Degrees of heading, rms, at a dip of 60°, by which more may be left."""

DIP_DEG: Final = 60.0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A simulated recording with a column, and what that does."""

    samples: Samples
    changing: Floats  #: (N, 3) µT: field that changes aboard
    share: float  #: R² of the column with what changes aboard
    field_strength: float


def explained(seed: int) -> Vehicle:
    """A vehicle with a column that follows part of what changes aboard, R² from 0.5 to 1; each third of states."""
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
    if seed % 3 == 1:  # by a noisy meter
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
"""Functions of the direction of the field."""


def following(seed: int) -> Vehicle:
    """A vehicle with a column that is a function of the direction of the field, and noise up to R² = 0.9."""
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
    """A vehicle with a column that moves nothing."""
    rng = np.random.default_rng([seed, 3])
    tumble = simulate.tumble(seed=seed)
    assert tumble.samples.time is not None
    column = simulate.NamedColumn(NAME, [0.0, 0.0, 0.0], hold=rng.uniform(1.0, 5.0), highest=3000.0)
    auxiliary = column.on(tumble.samples.time, rng).auxiliary
    samples = replace(tumble.samples, auxiliary=dict(auxiliary))
    return Vehicle(samples, np.zeros_like(samples.field), 0.0, tumble.field_strength)


def outcome(vehicle: Vehicle) -> str:
    """What came of a fit that was asked to follow the column."""
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
    """Whether the column is followed, and its effect removed."""
    followed = {one.name: one for one in fit.calibration.disturbances}
    if NAME not in followed:
        return "left out"
    one, values = followed[NAME], vehicle.samples.auxiliary[NAME]
    line = np.column_stack([one.numbers(values), np.ones(len(values))])
    best = vehicle.changing - line @ np.linalg.lstsq(line, vehicle.changing, rcond=None)[0]
    level = vehicle.field_strength * np.cos(np.deg2rad(DIP_DEG))
    most = max(MAX_MORE * _rms(best), np.hypot(_rms(best), np.deg2rad(MAX_LEFT_DEG) * level))
    left = _rms(vehicle.changing - one.shift(values))
    return "found and removed" if left <= most else "found, not removed"


def _rms(field: Floats) -> float:
    """Root mean square length of (N, 3) fields about their mean."""
    return float(np.sqrt(np.sum(np.var(field, axis=0))))


def _unit(values: Floats) -> Floats:
    """(N,) values of mean 0 and standard deviation 1."""
    unit: Floats = (values - values.mean()) / values.std()
    return unit


def _direction(rng: Generator) -> Floats:
    """(3,) a unit vector in any direction."""
    vector = rng.standard_normal(3)
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


KINDS: Final[dict[str, tuple[Callable[[int], Vehicle], str]]] = {
    "follows what changes aboard, R² 0.5 to 1": (explained, "found and removed"),
    "follows the attitude": (following, "refused: follows attitude"),
    "moves nothing": (idle, "left out"),
}
"""Kinds of columns, what makes a vehicle with one, and what has to come of it."""


def counts(kind: str, vehicles: int) -> Counter[str]:
    """How often each outcome came of a kind."""
    made, _ = KINDS[kind]
    return Counter(outcome(made(seed)) for seed in range(vehicles))


def main() -> None:
    """Print outcomes of all kinds."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--vehicles", type=int, default=VEHICLES)
    vehicles = parser.parse_args().vehicles
    for kind, (_, wanted) in KINDS.items():
        found = counts(kind, vehicles)
        rest = ", ".join(f"{count} {what}" for what, count in found.most_common() if what != wanted) or "none"
        print(f"{kind}: {found[wanted]} of {vehicles} {wanted} (others: {rest})")


if __name__ == "__main__":
    main()
