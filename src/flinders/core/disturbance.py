"""What drives an offset: motors whose current makes a field, and the warmth of the sensor.

A reading is off by what a current, a throttle or a temperature makes, in proportion to how far each is from a
reference, and what the earth's field makes of it may grow with the temperature:

    raw = b + Σ P (c − reference) + (1 + a (T − reference)) S u

The reference is where the offset b of the calibration holds: no current, no throttle, or a temperature in the middle
of the recording. A lag says how much later the readings follow: c is what was logged so many seconds before.

The current and the throttle of each motor may be followed by themselves: ``current1``, ``current2``, …, each with an
offset of its own. Any other name is that of a column of the log (`flinders.core.named_columns`): of numbers, or of two
words, which are states.

Sources: the offset of motors as in ArduPilot's CompassMot and PX4's CAL_MAG_COMP; the temperature as in the HMC5883L's
data sheet, p. 20, and Springmann, Cutler (2012) for currents.

>>> motors = Disturbance("current", [0.4, 0.0, -0.2], lowest=0.5, highest=27.0)
>>> motors.shift(np.array([0.0, 10.0]))
array([[ 0.,  0., -0.],
       [ 4.,  0., -2.]])
>>> print(motors)
current: 0.4, 0, -0.2 per A, from 0 A, recorded 0.5 to 27 A
>>> charger = Disturbance("charger", [4.0, 0.0, -1.5], highest=1.0, states=("idle", "charging"))
>>> charger.shift(["idle", "charging"])[:, 0]
array([0., 4.])
>>> print(charger)
charger: 4, 0, -1.5 while charging, none while idle
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.arrays import Floats, Value, floats, frozen, vectors
from flinders.core.named_columns import RESERVED, coded, unit_in
from flinders.errors import ArrayError, UsageError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.errors import Hint


class Kind(NamedTuple):
    """What can drive an offset."""

    key: str  #: what it is called in a calibration file
    unit: str  #: what stands behind its numbers
    per: str  #: one unit of it, as an offset per unit names it
    least: float  #: a recording over which it changes by less tells nothing of it
    plausible: tuple[float, float]  #: (2,): lowest and highest value in that unit: what lies beyond is in another one


KINDS: Final[Mapping[str, Kind]] = {
    "current": Kind("current_A", " A", "A", 0.1, (-1000.0, 1000.0)),
    "throttle": Kind("throttle", "", "full throttle", 0.02, (0.0, 1.0)),
    "temperature": Kind("temperature_C", " °C", "°C", 0.3, (-80.0, 150.0)),
}
"""By the names of the columns of `Samples`."""

MOTORS: Final[Mapping[str, str]] = {"current": "currents", "throttle": "throttles"}
"""What each motor may have of its own, and the column of `Samples` with one of each: motor 2 has ``current2``."""

MOST: Final = 99
"""Motors of one vehicle."""

_NUMBERED: Final = re.compile(rf"({'|'.join(MOTORS)})([1-9]\d?)")


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance(Value):
    """An offset, and for a temperature a scale, that follows something else.

    Raises
    ------
    UsageError
        For a name that is not known, a gain of motors, or a range that is none.
    ArrayError
        For numbers that are not finite, or not three.
    """

    #: ``current``, ``throttle`` or ``temperature``: the column of `Samples` that it is multiplied by; of a motor by
    #: itself ``current1``, ``throttle1`` and so on; else the name of a column in the log
    name: str
    #: (3,): by how much readings are off, in their unit, for each A, at full throttle, for each °C, for each unit of a
    #: column, or in the second of two states; read-only
    per_unit: Floats
    reference: float = 0.0  #: where the offset of the calibration holds
    lowest: float = 0.0  #: least of it that was seen; the same as `highest` where nobody knows
    highest: float = 0.0  #: most of it that was seen
    lag_s: float = 0.0  #: s: readings follow so much later
    #: by which share what the earth's field makes of a reading grows with each °C; 0 for motors
    gain_per_unit: float = 0.0
    states: tuple[str, ...] = ()  #: words of a column that stand for 0 and 1; none of a column of numbers

    def __post_init__(self) -> None:
        """Check the numbers and keep a read-only copy of the offset."""
        known(self.name)
        per_unit = vectors(self.per_unit, f"offset per unit of {self.name}")
        if per_unit.shape != (3,):
            raise ArrayError(f"offset per unit of {self.name} has shape {per_unit.shape}: need three numbers")
        object.__setattr__(self, "per_unit", frozen(per_unit))
        numbers = (self.reference, self.lowest, self.highest, self.lag_s, self.gain_per_unit)
        if not np.all(np.isfinite(numbers)):
            raise ArrayError(f"{self.name} has {numbers}: reference, range, lag and gain must be finite")
        if self.lowest > self.highest:
            raise UsageError(f"{self.name} was recorded from {self.lowest:g} to {self.highest:g}: the range is empty")
        if self.gain_per_unit and self.name != "temperature":
            raise UsageError(f"{self.name} has a gain of {self.gain_per_unit:g}: only temperature changes the scale")
        object.__setattr__(self, "states", tuple(self.states))
        if self.states and (len(set(self.states)) != 2 or not is_column(self.name)):
            raise UsageError(f"{self.name} has states {', '.join(self.states)}: need two words, of a column of the log")

    @property
    def kind(self) -> Kind:
        """What there is to know of all of its name."""
        return known(self.name)

    def numbers(self, values: ArrayLike) -> Floats:
        """(...) values as numbers: 0 and 1 in the place of states; NaN where one is not known."""
        return coded(values, self.states, self.name)

    def with_states(self, states: Sequence[str]) -> Disturbance:
        """The same with the words that 0 and 1 stand for; as it is where there are none."""
        return replace(self, states=tuple(states)) if states else self

    @property
    def has_range(self) -> bool:
        """It is known at which values it was found, which parameters of an autopilot do not say."""
        return self.lowest < self.highest

    @property
    def farthest(self) -> float:
        """The end of the recorded range that is farther from the reference; one unit from it where that is unknown."""
        if not self.has_range:
            return self.reference + 1.0
        return max((self.lowest, self.highest), key=lambda value: abs(value - self.reference))

    def shift(self, values: ArrayLike) -> Floats:
        """(..., 3) by how much readings are off at (...) values; a value that is not known makes NaN."""
        away = self.numbers(values) - self.reference
        shifted: Floats = away[..., np.newaxis] * self.per_unit
        return shifted

    def gain(self, values: ArrayLike) -> Floats:
        """(...) what the earth's field is multiplied by at (...) values."""
        return 1.0 + self.gain_per_unit * (self.numbers(values) - self.reference)

    def beyond(self, values: ArrayLike) -> float:
        """How far values lie outside the recorded range, as a share of it; 0 inside, or where the range is unknown.

        >>> Disturbance("current", [1, 0, 0], lowest=0.0, highest=20.0).beyond([5.0, 25.0, np.nan])
        0.25
        """
        seen = self.numbers(values)
        seen = seen[np.isfinite(seen)]
        if not len(seen) or not self.has_range:
            return 0.0
        outside = max(self.lowest - float(seen.min()), float(seen.max()) - self.highest, 0.0)
        return outside / (self.highest - self.lowest)

    def amount(self, value: float) -> str:
        """Write a value with its unit.

        >>> Disturbance("temperature", [0, 0, 0]).amount(21.54)
        '21.5 °C'
        """
        if self.states and value in (0.0, 1.0):
            return self.states[int(value)]
        return f"{_amount(value)}{self.kind.unit}"

    def __str__(self) -> str:
        numbers = ", ".join(f"{value:.3g}" for value in self.per_unit + 0.0)
        lag = f", lag {self.lag_s:.2g} s" if self.lag_s else ""
        gain = f", scale {self.gain_per_unit:+.2%} per °C" if self.gain_per_unit else ""
        if self.states:
            return f"{self.name}: {numbers} while {self.states[1]}{lag}, none while {self.states[0]}"
        span = f"recorded {_amount(self.lowest)} to {self.amount(self.highest)}" if self.has_range else "range unknown"
        return f"{self.name}: {numbers} per {self.kind.per}{gain}{lag}, from {self.amount(self.reference)}, {span}"


def _amount(value: float) -> str:
    """Write a value of a column to three digits, or to the point: no speed of 3e+03.

    >>> _amount(0.0), _amount(21.54), _amount(3000.0), _amount(-12345.6), _amount(3.2e9)
    ('0', '21.5', '3,000', '-12,346', '3.2e+09')
    """
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.3g}"


@cache
def known(name: str) -> Kind:
    """Look a disturbance up.

    Raises
    ------
    UsageError
        For a name that no column that is followed can have.

    Examples
    --------
    >>> known("current"), known("throttle2").key
    (Kind(key='current_A', unit=' A', per='A', least=0.1, plausible=(-1000.0, 1000.0)), 'throttle2')
    >>> known("wheel_rpm").per, known("BAT.Curr").per
    ('rpm', 'unit of BAT.Curr')
    """
    if name in KINDS:
        return KINDS[name]
    kind, number = motor(name)
    if number:
        return KINDS[kind]._replace(key=KINDS[kind].key.replace(kind, name))
    if not name.strip() or name in RESERVED or name in MOTORS.values():
        raise UsageError(
            f"{name!r} cannot be followed by this name: need {', '.join(KINDS)}, current1, throttle1 … of each motor, "
            "or the name of another column; rename the column where it is recorded"
        )
    unit = unit_in(name)
    return Kind(name, f" {unit}" if unit else "", unit or f"unit of {name}", 0.0, (-np.inf, np.inf))


def is_column(name: str) -> bool:
    """Whether a disturbance goes by the name of its column in the log: it is no known kind, and of no motor.

    >>> is_column("wheel_rpm"), is_column("current"), is_column("throttle3"), is_column("currents")
    (True, False, False, False)
    """
    return not (name in KINDS or name in MOTORS.values() or motor(name)[1])


def motor(name: str) -> tuple[str, int]:
    """The kind of a disturbance, and the number of its motor; 0 for no motor by itself.

    >>> motor("current12"), motor("current"), motor("current0")
    (('current', 12), ('current', 0), ('current0', 0))
    """
    match = _NUMBERED.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, 0)


def motors(kind: str, count: int) -> tuple[str, ...]:
    """Names of the first motors' own disturbances.

    >>> motors("current", 3)
    ('current1', 'current2', 'current3')
    """
    return tuple(f"{kind}{number + 1}" for number in range(count))


BY_KEY: Final[Mapping[str, str]] = {
    known(name).key: name for name in (*KINDS, *(name for kind in MOTORS for name in motors(kind, MOST)))
}
"""Names of all disturbances by what they are called in files."""


def place_of(name: str) -> tuple[int, int, str]:
    """Where a disturbance stands among others: in the order of `KINDS`, a total before each motor; columns are last.

    >>> sorted(["wheel", "temperature", "throttle", "current10", "current2", "current"], key=place_of)
    ['current', 'current2', 'current10', 'throttle', 'temperature', 'wheel']
    """
    known(name)
    kind, number = motor(name)
    return (len(KINDS), 0, name) if is_column(name) else (list(KINDS).index(kind), number, "")


def checked(disturbances: Iterable[Disturbance]) -> tuple[Disturbance, ...]:
    """Let disturbances through of which no two are of one name, in the order of `place_of`.

    Raises
    ------
    UsageError
        For two of one name.
    """
    listed = sorted(disturbances, key=lambda disturbance: place_of(disturbance.name))
    for one, other in pairwise(listed):
        if one.name == other.name:
            raise UsageError(f"{one.name} is given twice: each drives the offset once")
    return tuple(listed)


def named(followed: Sequence[Disturbance] = (), /, **columns: ArrayLike | None) -> dict[str, ArrayLike]:
    """Name columns by their disturbances; ``currents`` and ``throttles`` have each motor's along the last axis.

    Raises
    ------
    UsageError
        For a name that is no known kind, and none of the columns that are `followed`.

    >>> named(current=None, throttle=0.5, currents=[1.0, 2.0])
    {'throttle': 0.5, 'current1': array(1.), 'current2': array(2.)}
    """
    given: dict[str, ArrayLike] = {name: values for name, values in columns.items() if values is not None}
    for kind, many in MOTORS.items():
        if many in given:
            table = np.atleast_1d(floats(given.pop(many), many))
            given |= {name: table[..., place] for place, name in enumerate(motors(kind, table.shape[-1]))}
    ours = {one.name for one in followed}
    for name in given:
        if is_column(name) and name not in ours:
            each = ", ".join((*KINDS, "current1 …", "throttle1 …"))
            does = f"it follows {', '.join(ours)}" if ours else "it follows nothing"
            raise UsageError(f"the calibration does not follow {name!r}{did_you_mean(name, ours)}: {does}; need {each}")
    return given


def effect(disturbances: Sequence[Disturbance], values: Mapping[str, ArrayLike | None]) -> tuple[Floats, Floats]:
    """By how much readings are off (..., 3), and what multiplies the earth's field in them (...).

    Raises
    ------
    UsageError
        For a disturbance whose values are not given.

    Examples
    --------
    >>> warm = Disturbance("temperature", [0.1, 0.0, 0.0], reference=20.0, gain_per_unit=0.01)
    >>> shift, gain = effect([warm], {"temperature": [20.0, 30.0]})
    >>> shift[:, 0], gain
    (array([0., 1.]), array([1. , 1.1]))
    """
    shift, gain = np.zeros(3), np.ones(())
    for disturbance in disturbances:
        given = values.get(disturbance.name)
        if given is None:
            raise UsageError(
                f"the calibration corrects for {disturbance.name}, which was not given: give it for each reading, or "
                "take the calibration at a fixed one",
                hint={disturbance.name: None, **at_reference([disturbance])},
            )
        shift = shift + disturbance.shift(given)
        gain = gain * disturbance.gain(given)
    return shift, gain


def at_reference(disturbances: Iterable[Disturbance]) -> Hint:
    """Hint that takes a calibration at the reference values of disturbances."""
    return {"at": {one.name: one.states[0] if one.states else one.reference for one in disturbances}}


def lagged(values: Floats, time: Floats | None, lag_s: float) -> Floats:
    """(N,) what was logged `lag_s` before each of (N,) times, in s; before the first value that one holds.

    Gaps are bridged. Without times there is no before, and gaps alone are bridged, reading by reading.

    >>> lagged(np.array([0.0, 1.0, np.nan, 3.0]), np.array([0.0, 1.0, 2.0, 3.0]), 0.5)
    array([0. , 0.5, 1.5, 2.5])
    """
    is_known = np.isfinite(values)
    if time is None:
        if is_known.all() or not is_known.any():
            return values
        rows = np.arange(len(values), dtype=float)
        bridged: Floats = np.interp(rows, rows[is_known], values[is_known])
        return bridged
    is_known &= np.isfinite(time)
    if not is_known.any() or (lag_s == 0.0 and is_known.all()):
        return values
    order = np.argsort(time[is_known], kind="stable")
    known_at, known_values = time[is_known][order], values[is_known][order]
    shifted = np.interp(time - lag_s, known_at, known_values)
    earlier: Floats = np.where(np.isfinite(time), shifted, values)
    return earlier


def disturbed_alike(ours: tuple[Disturbance, ...], theirs: tuple[Disturbance, ...], tolerance: float) -> bool:
    """Whether both follow the same, to within `tolerance` over what was recorded."""
    if [disturbance.name for disturbance in ours] != [disturbance.name for disturbance in theirs]:
        return False
    return all(
        bool(np.abs(one.shift(end) - other.shift(end)).max() <= tolerance) and one.lag_s == other.lag_s
        for one, other in zip(ours, theirs, strict=True)
        for end in (one.reference, one.lowest, one.highest, one.farthest)
    )
