"""Disturbances of simulated readings: motors, temperature, iron that is moved or carried past.

Each disturbance is a value that computes its effect on readings at given times. `tumble` takes any number of them and
adds their effects to the raw readings. Each has its own random stream, so that none changes sensor, path or noise.

>>> warm = ThermalDrift(per_kelvin=[0.1, 0.0, -0.2], kelvin=20.0, seconds=60.0)
>>> effect = warm.on(np.array([0.0, 600.0]), np.random.default_rng(0))
>>> effect.shift.round(1).tolist(), effect.temperature.round(1).tolist()
([[0.0, 0.0, -0.0], [2.0, 0.0, -4.0]], [20.0, 40.0])

A strength given as one number gets a random direction:

>>> pulled = MotorCurrent(per_ampere=0.5).on(np.arange(100) / 50, np.random.default_rng(0))
>>> strength = np.linalg.norm(pulled.shift, axis=1)
>>> bool(np.allclose(strength, 0.5 * pulled.current, atol=0.1))
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from flinders.arrays import check_table, check_triple
from flinders.errors import UsageError
from flinders.geometry.sphere import uniform_directions
from flinders.simulate._checks import not_negative, positive, share

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """Effect of a disturbance on N readings, and the columns of the log that record the disturbance."""

    shift: Floats  #: (N, 3), µT: field that is added to the raw readings
    current: Floats | None = None  #: (N,), A: measured total current of the motors
    temperature: Floats | None = None  #: (N,), °C: measured temperature of the sensor
    outliers: NDArray[np.bool_] | None = None  #: (N,): whether the reading is an outlier
    gain: Floats | None = None  #: (N,): factor on the earth's field
    currents: Floats | None = None  #: (N, M), A: measured current of each motor
    #: (N,) numbers or words each: other columns of the log, by name
    auxiliary: Mapping[str, NDArray[Any]] = field(default_factory=dict)


class Perturbation(Protocol):
    """A disturbance of readings."""

    kind: ClassVar[str]

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""


@dataclass(frozen=True, slots=True, eq=False)
class MotorCurrent:
    """Motors whose current causes a field of ``per_ampere`` times the current.

    The throttle is set to a random value between 0 and 1 every few seconds.
    """

    kind: ClassVar[str] = "motor"

    per_ampere: float | ArrayLike  #: µT/A: in sensor axes; one number for a random direction
    amperes: float = 20.0  #: A: largest current
    hold: float = 3.0  #: s: duration of a setting
    noise: float = 0.05  #: A: noise of the current meter, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        direction = _vector(self.per_ampere, rng, "per_ampere")
        since = time - time[0]
        setting = (since / positive(self.hold, "hold")).astype(int)
        throttle = rng.uniform(0.0, 1.0, int(setting[-1]) + 2)
        throttle[0] = 0.0
        eased = np.clip((since / self.hold - setting) / 0.15, 0.0, 1.0)  # motors take a moment to spin up
        drawn = positive(self.amperes, "amperes") * (throttle[setting] * (1 - eased) + throttle[setting + 1] * eased)
        noise = not_negative(self.noise, "noise", "A") * rng.standard_normal(len(time))
        return Effect(np.outer(drawn, direction), current=drawn + noise)


@dataclass(frozen=True, slots=True, eq=False)
class Motors:
    """Motors that each cause a different field, as those of a multicopter.

    All motors follow one throttle, which changes every few seconds. Roll, pitch and yaw commands add differences
    between the motors, with a sum of zero, which change three times as often. With zero throttle all motors are at
    rest.
    """

    kind: ClassVar[str] = "motors"

    per_ampere: ArrayLike  #: (M, 3), µT/A: one row per motor, in sensor axes
    amperes: float = 8.0  #: A: current of each motor at full throttle
    apart: float = 0.1  #: differences between the motors, one σ, as a share of `amperes`
    hold: float = 3.0  #: s: duration of a setting of the throttle
    noise: float = 0.02  #: A: noise of each current meter, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        vectors = check_table(self.per_ampere, "per_ampere")
        since = time - time[0]
        hold, most = positive(self.hold, "hold"), positive(self.amperes, "amperes")
        throttle = _eased_settings(since / hold, rng.uniform(0.0, 1.0, (int(since[-1] / hold) + 2, 1)))
        mixed = rng.standard_normal((int(3.0 * since[-1] / hold) + 2, len(vectors)))
        mixed -= mixed.mean(axis=1, keepdims=True)
        parted = not_negative(self.apart, "apart", "of the most") * _eased_settings(3.0 * since / hold, mixed)
        drawn = most * np.clip(throttle + parted * np.minimum(1.0, 4.0 * throttle), 0.0, None)
        metered = drawn + not_negative(self.noise, "noise", "A") * rng.standard_normal(drawn.shape)
        return Effect(drawn @ vectors, current=metered.sum(axis=1), currents=metered)


def _eased_settings(since: Floats, values: Floats) -> Floats:
    """(N, M) settings from (K, M) values, each held for one unit of (N,) times; changes take a twentieth of it."""
    setting = since.astype(int)
    eased = np.clip((since - setting) / 0.05, 0.0, 1.0)[:, np.newaxis]
    settings: Floats = values[setting] * (1.0 - eased) + values[setting + 1] * eased
    return settings


@dataclass(frozen=True, slots=True, eq=False)
class NamedColumn:
    """A column of the log that follows the source of a field: a wheel, a servo, a charger.

    The column changes every few seconds to a random value in its range or, if it has states, to one of the two.

    >>> charger = NamedColumn("charger", [4.0, 0.0, 0.0], states=("idle", "charging"), hold=1.0)
    >>> effect = charger.on(np.arange(4.0), np.random.default_rng(2))
    >>> effect.shift[:, 0], effect.auxiliary["charger"].tolist()
    (array([0., 4., 4., 0.]), ['idle', 'charging', 'charging', 'idle'])
    """

    kind: ClassVar[str] = "column"

    name: str  #: name of the column
    #: µT: in sensor axes, per unit or in the second state; one number for a random direction
    per_unit: float | ArrayLike
    highest: float = 1.0  #: largest value; the smallest is 0
    hold: float = 3.0  #: s: duration of a setting
    noise: float = 0.0  #: noise of the recorded value, one σ
    states: tuple[str, ...] = ()  #: words for its two states

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        direction = _vector(self.per_unit, rng, "per_unit")
        since = (time - time[0]) / positive(self.hold, "hold")
        settings = rng.uniform(0.0, 1.0, (int(since[-1]) + 2, 1))
        noise = not_negative(self.noise, "noise", "of its unit") * rng.standard_normal(len(time))
        if self.states:
            is_second = settings[since.astype(int), 0] > 0.5
            words = np.array(self.states)[is_second.astype(int)]
            return Effect(np.outer(is_second, direction), auxiliary={self.name: words})
        course = positive(self.highest, "highest") * _eased_settings(since, settings)[:, 0]
        return Effect(np.outer(course, direction), auxiliary={self.name: course + noise})


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """First-order Gauss–Markov noise, whose correlation decays exponentially in time."""

    kind: ClassVar[str] = "noise"

    sigma: float  #: µT: standard deviation along each axis
    seconds: float = 1.0  #: s: time constant, after which the correlation is 37 %

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        memory = np.exp(-np.diff(time, prepend=time[0]) / positive(self.seconds, "seconds"))
        push = not_negative(self.sigma, "sigma", "µT") * rng.standard_normal((len(time), 3))
        noise = np.empty_like(push)
        noise[0] = push[0]
        for row in range(1, len(noise)):
            noise[row] = memory[row] * noise[row - 1] + np.sqrt(1.0 - memory[row] ** 2) * push[row]
        return Effect(noise)


@dataclass(frozen=True, slots=True, eq=False)
class ThermalDrift:
    """An offset that changes with the temperature of the sensor, which warms up exponentially."""

    kind: ClassVar[str] = "drift"

    per_kelvin: float | ArrayLike  #: µT/K: one number for a random direction
    kelvin: float = 15.0  #: K: final warming; negative for cooling
    seconds: float = 60.0  #: s: time constant, after which 63 % of the warming is reached
    start: float = 20.0  #: °C: initial temperature, at which the sensor's offset holds
    noise: float = 0.02  #: K: noise of the thermometer, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        direction = _vector(self.per_kelvin, rng, "per_kelvin")
        warmer = -self.kelvin * np.expm1(-(time - time[0]) / positive(self.seconds, "seconds"))
        noise = not_negative(self.noise, "noise", "K") * rng.standard_normal(len(time))
        return Effect(np.outer(warmer, direction), temperature=self.start + warmer + noise)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Iron near the sensor that is moved once."""

    kind: ClassVar[str] = "step"

    by: float | ArrayLike  #: µT: change of the offset; one number for a random direction
    at: float = 0.5  #: time of the change, as a share of the recording

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        after = _progress(time) >= share(self.at, "at", "the recording")
        return Effect(np.outer(after, _vector(self.by, rng, "by")))


@dataclass(frozen=True, slots=True, eq=False)
class FieldStep:
    """A change of the earth's field strength within the recording, as near a steel beam indoors."""

    kind: ClassVar[str] = "field-step"

    by: float  #: relative change: −0.1 for a tenth less
    at: float = 0.5  #: time of the change, as a share of the recording

    def on(self, time: Floats, rng: Generator) -> Effect:  # noqa: ARG002 - nothing is left to chance
        """Effect on readings at (N,) times in s, without random numbers."""
        if not -1.0 < self.by < np.inf:
            raise UsageError(f"by is {self.by:g}: need a share above −1, such as −0.1 for a tenth less")
        after = _progress(time) >= share(self.at, "at", "the recording")
        return Effect(np.zeros((len(time), 3)), gain=np.where(after, 1.0 + self.by, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class PassingMagnet:
    """A magnet that is carried past, with a field that rises and falls; readings during it are outliers."""

    kind: ClassVar[str] = "magnet"

    peak: float | ArrayLike  #: µT: largest field; one number for a random direction
    at: float = 0.5  #: time of the largest field, as a share of the recording
    seconds: float = 3.0  #: s: duration of the field, which follows a squared cosine

    def on(self, time: Floats, rng: Generator) -> Effect:
        """Effect on readings at (N,) times in s."""
        closest = time[0] + share(self.at, "at", "the recording") * (time[-1] - time[0])
        phase = (time - closest) / positive(self.seconds, "seconds")
        felt = np.abs(phase) < 0.5
        swell = np.where(felt, np.cos(math.pi * phase) ** 2, 0.0)
        return Effect(np.outer(swell, _vector(self.peak, rng, "peak")), outliers=felt)


def stray_fields(rng: Generator, n: int, proportion: float) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 3) stray fields, relative to the field strength, and (n,) whether each reading has one.

    `proportion` is the share of readings with a stray field, which is half to three field strengths in a random
    direction; for the others it is zero. Raises `UsageError` for an invalid share.

    >>> fields, outliers = stray_fields(np.random.default_rng(0), 100, 0.03)
    >>> int(outliers.sum()), bool(np.linalg.norm(fields[outliers], axis=1).min() >= 0.5)
    (3, True)
    """
    struck = round(share(proportion, "outliers") * n)
    rows = rng.choice(n, struck, replace=False)
    fields, outliers = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    fields[rows] = uniform_directions(rng, struck) * rng.uniform(0.5, 3.0, (struck, 1))
    outliers[rows] = True
    return fields, outliers


def _vector(value: float | ArrayLike, rng: Generator, name: str) -> Floats:
    """(3,) vector as given, or with the given length in a random direction.

    Both cases draw the same count of random numbers.
    """
    direction = uniform_directions(rng, 1)[0]
    if np.ndim(value) == 0:
        along: Floats = not_negative(float(value), name, "µT") * direction  # type: ignore[arg-type]  # ndim is 0
        return along
    return check_triple(value, name)


def _progress(time: Floats) -> Floats:
    """(N,) elapsed share of the recording, from 0 to 1."""
    span = time[-1] - time[0]
    progress: Floats = (time - time[0]) / span if span > 0 else np.zeros(len(time))
    return progress
