"""What else moves a reading: motors, warmth, things that are shifted or carried past.

Each disturbance is a small value that says what it does to readings taken at given times. `tumble` takes any number of
them, adds what they do to the raw readings, and gives each a random stream of its own: none changes sensor, path
or noise.

>>> warm = ThermalDrift(per_kelvin=[0.1, 0.0, -0.2], kelvin=20.0, seconds=60.0)
>>> effect = warm.on(np.array([0.0, 600.0]), np.random.default_rng(0))
>>> effect.shift.round(1).tolist(), effect.temperature.round(1).tolist()
([[0.0, 0.0, -0.0], [2.0, 0.0, -4.0]], [20.0, 40.0])

A strength given as one number points in a direction that is drawn:

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

from flinders.arrays import table, triple
from flinders.errors import UsageError
from flinders.geometry.sphere import uniform
from flinders.simulate._checks import not_negative, positive, share

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """What a disturbance does to N readings."""

    shift: Floats  #: (N, 3), µT: by how much the raw readings are off
    current: Floats | None = None  #: (N,): what a meter of the motors' current says
    temperature: Floats | None = None  #: (N,), °C: what the sensor's thermometer says
    outliers: NDArray[np.bool_] | None = None  #: (N,): readings that are of no use
    gain: Floats | None = None  #: (N,): what the earth's field is multiplied by
    currents: Floats | None = None  #: (N, M): what the meter of each motor says
    #: (N,) of numbers or of words: other columns of the log, by name
    auxiliary: Mapping[str, NDArray[Any]] = field(default_factory=dict)


class Perturbation(Protocol):
    """Something that moves readings."""

    kind: ClassVar[str]

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""


@dataclass(frozen=True, slots=True, eq=False)
class MotorCurrent:
    """Motors whose current makes a field: in the readings, ``per_ampere`` times what they draw.

    The throttle is set anew every few seconds to anything between none and all.
    """

    kind: ClassVar[str] = "motor"

    per_ampere: float | ArrayLike  #: µT/A: in sensor axes; one number for a direction that is drawn
    amperes: float = 20.0  #: A: the most that is drawn
    hold: float = 3.0  #: s: how long a setting lasts
    noise: float = 0.05  #: A: of the meter, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
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
    """Motors that each make a field of their own, as those of a multicopter.

    All follow one throttle, set anew every few seconds. What rolls, pitches and yaws the vehicle parts them: what one
    is asked for more, the others are asked for less, set anew three times as often. With the throttle at none all rest.
    """

    kind: ClassVar[str] = "motors"

    per_ampere: ArrayLike  #: (M, 3), µT/A: one row a motor, in sensor axes
    amperes: float = 8.0  #: A: the most that one of them is asked for together with all others
    apart: float = 0.1  #: by which share of that, one σ, each is asked for more or less than the others
    hold: float = 3.0  #: s: how long a setting of the throttle lasts
    noise: float = 0.02  #: A: of each meter, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        vectors = table(self.per_ampere, "per_ampere")
        since = time - time[0]
        hold, most = positive(self.hold, "hold"), positive(self.amperes, "amperes")
        throttle = _set_anew(since / hold, rng.uniform(0.0, 1.0, (int(since[-1] / hold) + 2, 1)))
        mixed = rng.standard_normal((int(3.0 * since[-1] / hold) + 2, len(vectors)))
        mixed -= mixed.mean(axis=1, keepdims=True)
        parted = not_negative(self.apart, "apart", "of the most") * _set_anew(3.0 * since / hold, mixed)
        drawn = most * np.clip(throttle + parted * np.minimum(1.0, 4.0 * throttle), 0.0, None)
        metered = drawn + not_negative(self.noise, "noise", "A") * rng.standard_normal(drawn.shape)
        return Effect(drawn @ vectors, current=metered.sum(axis=1), currents=metered)


def _set_anew(since: Floats, values: Floats) -> Floats:
    """(N, M) settings of (K, M) values, each for one unit of (N,) times, of which a twentieth goes into the change."""
    setting = since.astype(int)
    eased = np.clip((since - setting) / 0.05, 0.0, 1.0)[:, np.newaxis]
    settings: Floats = values[setting] * (1.0 - eased) + values[setting + 1] * eased
    return settings


@dataclass(frozen=True, slots=True, eq=False)
class NamedColumn:
    """A column of the log that follows what makes a field: a wheel, a servo, a charger.

    It is set anew every few seconds, to anything in its range or, where it has states, to one of the two.

    >>> charger = NamedColumn("charger", [4.0, 0.0, 0.0], states=("idle", "charging"), hold=1.0)
    >>> effect = charger.on(np.arange(4.0), np.random.default_rng(2))
    >>> effect.shift[:, 0], effect.auxiliary["charger"].tolist()
    (array([0., 4., 4., 0.]), ['idle', 'charging', 'charging', 'idle'])
    """

    kind: ClassVar[str] = "column"

    name: str  #: of the column
    #: µT: in sensor axes, for each unit or in the second state; one number: drawn direction
    per_unit: float | ArrayLike
    highest: float = 1.0  #: most of it; the least is 0
    hold: float = 3.0  #: s: how long a setting lasts
    noise: float = 0.0  #: of its meter, one σ
    states: tuple[str, ...] = ()  #: the words of its two states

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        direction = _vector(self.per_unit, rng, "per_unit")
        since = (time - time[0]) / positive(self.hold, "hold")
        settings = rng.uniform(0.0, 1.0, (int(since[-1]) + 2, 1))
        noise = not_negative(self.noise, "noise", "of its unit") * rng.standard_normal(len(time))
        if self.states:
            is_second = settings[since.astype(int), 0] > 0.5
            words = np.array(self.states)[is_second.astype(int)]
            return Effect(np.outer(is_second, direction), auxiliary={self.name: words})
        course = positive(self.highest, "highest") * _set_anew(since, settings)[:, 0]
        return Effect(np.outer(course, direction), auxiliary={self.name: course + noise})


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """Noise with a memory: what it is at one moment has nearly gone after a few time constants."""

    kind: ClassVar[str] = "noise"

    sigma: float  #: µT: standard deviation along each axis
    seconds: float = 1.0  #: s: until its correlation has sunk to 37 %

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        memory = np.exp(-np.diff(time, prepend=time[0]) / positive(self.seconds, "seconds"))
        push = not_negative(self.sigma, "sigma", "µT") * rng.standard_normal((len(time), 3))
        noise = np.empty_like(push)
        noise[0] = push[0]
        for row in range(1, len(noise)):
            noise[row] = memory[row] * noise[row - 1] + np.sqrt(1.0 - memory[row] ** 2) * push[row]
        return Effect(noise)


@dataclass(frozen=True, slots=True, eq=False)
class ThermalDrift:
    """An offset that moves with the temperature of the sensor, which warms up and settles."""

    kind: ClassVar[str] = "drift"

    per_kelvin: float | ArrayLike  #: µT/K: one number for a direction that is drawn
    kelvin: float = 15.0  #: K: by how much it warms up in the end; negative where it cools
    seconds: float = 60.0  #: s: until 63 % of that
    start: float = 20.0  #: °C: where it begins; the sensor's offset is that of this temperature
    noise: float = 0.02  #: K: of the thermometer, one σ

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        direction = _vector(self.per_kelvin, rng, "per_kelvin")
        warmer = -self.kelvin * np.expm1(-(time - time[0]) / positive(self.seconds, "seconds"))
        noise = not_negative(self.noise, "noise", "K") * rng.standard_normal(len(time))
        return Effect(np.outer(warmer, direction), temperature=self.start + warmer + noise)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Something of iron near the sensor that is moved once, and stays where it then is."""

    kind: ClassVar[str] = "step"

    by: float | ArrayLike  #: µT: what it changes; one number for a direction that is drawn
    at: float = 0.5  #: when, as a share of the recording

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        after = _progress(time) >= share(self.at, "at", "the recording")
        return Effect(np.outer(after, _vector(self.by, rng, "by")))


@dataclass(frozen=True, slots=True, eq=False)
class FieldStep:
    """Another place: from some moment on the earth's field is stronger or weaker, as indoors beside a beam."""

    kind: ClassVar[str] = "field-step"

    by: float  #: by which share of it: −0.1 for a tenth less
    at: float = 0.5  #: when, as a share of the recording

    def on(self, time: Floats, rng: Generator) -> Effect:  # noqa: ARG002 - nothing is left to chance
        """What it does to readings taken at (N,) times in s; nothing is drawn."""
        if not -1.0 < self.by < np.inf:
            raise UsageError(f"by is {self.by:g}: need a share above −1, such as −0.1 for a tenth less")
        after = _progress(time) >= share(self.at, "at", "the recording")
        return Effect(np.zeros((len(time), 3)), gain=np.where(after, 1.0 + self.by, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class PassingMagnet:
    """A magnet that is carried past: a field that swells, and is gone. Its readings are outliers."""

    kind: ClassVar[str] = "magnet"

    peak: float | ArrayLike  #: µT: at its closest; one number for a direction that is drawn
    at: float = 0.5  #: when it is closest, as a share of the recording
    seconds: float = 3.0  #: s: from when it is first felt until it is gone; the field follows a squared cosine

    def on(self, time: Floats, rng: Generator) -> Effect:
        """What it does to readings taken at (N,) times in s."""
        closest = time[0] + share(self.at, "at", "the recording") * (time[-1] - time[0])
        phase = (time - closest) / positive(self.seconds, "seconds")
        felt = np.abs(phase) < 0.5
        swell = np.where(felt, np.cos(math.pi * phase) ** 2, 0.0)
        return Effect(np.outer(swell, _vector(self.peak, rng, "peak")), outliers=felt)


def stray_fields(rng: Generator, n: int, proportion: float) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 3) stray fields in field strengths, zero but for a share of the readings, and (n,) which those are.

    Each is half to three field strengths long, in any direction. A share that is none raises `UsageError`.

    >>> fields, outliers = stray_fields(np.random.default_rng(0), 100, 0.03)
    >>> int(outliers.sum()), bool(np.linalg.norm(fields[outliers], axis=1).min() >= 0.5)
    (3, True)
    """
    struck = round(share(proportion, "outliers") * n)
    rows = rng.choice(n, struck, replace=False)
    fields, outliers = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    fields[rows] = uniform(rng, struck) * rng.uniform(0.5, 3.0, (struck, 1))
    outliers[rows] = True
    return fields, outliers


def _vector(value: float | ArrayLike, rng: Generator, name: str) -> Floats:
    """(3,) a vector as it is, or a length in a direction that is drawn; the same number of draws for both."""
    direction = uniform(rng, 1)[0]
    if np.ndim(value) == 0:
        along: Floats = not_negative(float(value), name, "µT") * direction  # type: ignore[arg-type]  # ndim is 0
        return along
    return triple(value, name)


def _progress(time: Floats) -> Floats:
    """(N,) how much of the recording has passed, from 0 to 1."""
    span = time[-1] - time[0]
    progress: Floats = (time - time[0]) / span if span > 0 else np.zeros(len(time))
    return progress
