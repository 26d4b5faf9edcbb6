"""Disturbances that the offset of a magnetometer follows: current, throttle, temperature, or a column of the log.

The offset changes in proportion to the difference of each disturbance c from a reference; the scale of the earth's
field may also change with the temperature T:

    raw = b + Σ P (c − reference) + (1 + a (T − reference)) S u

The offset b of the calibration holds at the reference: no current, no throttle, or a temperature in the middle of the
recording. With a lag, c is the value that was logged the lag, in seconds, before the reading.

The current and the throttle of each motor can be separate disturbances: ``current1``, ``current2``, …, each with its
own offset. Any other name is that of a column of the log (`flinders.core.named_columns`): of numbers, or of two
words, which are states.

Sources: ArduPilot's CompassMot and PX4's CAL_MAG_COMP for the offset of motors; the HMC5883L's data sheet, p. 20, for
the temperature; Springmann, Cutler (2012) for currents.

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

from flinders.arrays import Floats, Value, check_vectors, read_only_copy, to_floats
from flinders.core.named_columns import RESERVED_NAMES, numbers_of, unit_in
from flinders.errors import ArrayError, UsageError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.errors import Hint


class Kind(NamedTuple):
    """A kind of disturbance."""

    key: str  #: its key in a calibration file
    unit: str  #: unit that is printed after its values, with a space
    per: str  #: the unit in ``offset per unit``
    least: float  #: smallest range of values in a recording from which an offset can be estimated
    plausible: tuple[float, float]  #: (2,): lowest and highest plausible value; values outside suggest another unit


KINDS: Final[Mapping[str, Kind]] = {
    "current": Kind("current_A", " A", "A", 0.1, (-1000.0, 1000.0)),
    "throttle": Kind("throttle", "", "full throttle", 0.02, (0.0, 1.0)),
    "temperature": Kind("temperature_C", " °C", "°C", 0.3, (-80.0, 150.0)),
}
"""Kinds of disturbances by the names of their columns in `Samples`."""

MOTORS: Final[Mapping[str, str]] = {"current": "currents", "throttle": "throttles"}
"""Kinds that exist for each motor, and the column of `Samples` with one value a motor: motor 2 has ``current2``."""

MAX_MOTORS: Final = 99
"""Largest number of motors of a vehicle."""

_NUMBERED: Final = re.compile(rf"({'|'.join(MOTORS)})([1-9]\d?)")


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance(Value):
    """Change of the offset, and with a temperature also of the scale, per unit of a recorded quantity.

    Raises
    ------
    UsageError
        For an invalid name, a `gain_per_unit` of another disturbance than the temperature, an empty range, or states
        that are not two words.
    ArrayError
        For values that are not finite, or an offset that is not three numbers.
    """

    #: ``current``, ``throttle`` or ``temperature``, as the columns of `Samples`; ``current1`` or ``throttle1`` for the
    #: first motor alone; else the name of a column in the log
    name: str
    #: (3,), in the unit of the readings: change of the offset for each A, at full throttle, for each °C, for each unit
    #: of a column, or in the second of two states; read-only
    per_unit: Floats
    reference: float = 0.0  #: value at which the offset of the calibration holds
    lowest: float = 0.0  #: lowest recorded value; equal to `highest` if the range is not known
    highest: float = 0.0  #: highest recorded value
    lag_s: float = 0.0  #: s: delay of the readings behind the value
    #: relative growth of the earth's part of a reading for each °C; 0 for motors
    gain_per_unit: float = 0.0
    states: tuple[str, ...] = ()  #: words that stand for 0 and 1; empty for a column of numbers

    def __post_init__(self) -> None:
        """Check the values and store a read-only copy of the offset."""
        kind_of(self.name)
        per_unit = check_vectors(self.per_unit, f"offset per unit of {self.name}")
        if per_unit.shape != (3,):
            raise ArrayError(f"offset per unit of {self.name} has shape {per_unit.shape}: need three numbers")
        object.__setattr__(self, "per_unit", read_only_copy(per_unit))
        numbers = (self.reference, self.lowest, self.highest, self.lag_s, self.gain_per_unit)
        if not np.all(np.isfinite(numbers)):
            raise ArrayError(f"{self.name} has {numbers}: reference, range, lag and gain must be finite")
        if self.lowest > self.highest:
            raise UsageError(
                f"{self.name} was recorded from {self.lowest:g} to {self.highest:g}: need the smaller number first"
            )
        if self.gain_per_unit and self.name != "temperature":
            raise UsageError(
                f"{self.name} has a gain of {self.gain_per_unit:g}: need 0, as only temperature changes the gain"
            )
        object.__setattr__(self, "states", tuple(self.states))
        if self.states and (len(set(self.states)) != 2 or not is_column(self.name)):
            raise UsageError(f"{self.name} has states {', '.join(self.states)}: need two words, of a column of the log")

    @property
    def kind(self) -> Kind:
        """Kind of the disturbance, by its name."""
        return kind_of(self.name)

    def numbers(self, values: ArrayLike) -> Floats:
        """(...) values as numbers, with 0 and 1 for the two states; NaN for a missing value."""
        return numbers_of(values, self.states, self.name)

    def with_states(self, states: Sequence[str]) -> Disturbance:
        """A copy whose values 0 and 1 stand for the two words `states`; unchanged if `states` is empty."""
        return replace(self, states=tuple(states)) if states else self

    @property
    def has_range(self) -> bool:
        """Whether the range of recorded values is known; parameters of an autopilot do not state it."""
        return self.lowest < self.highest

    @property
    def extreme_value(self) -> float:
        """End of the recorded range that is farther from the reference; reference + 1 if the range is not known."""
        if not self.has_range:
            return self.reference + 1.0
        return max((self.lowest, self.highest), key=lambda value: abs(value - self.reference))

    def shift(self, values: ArrayLike) -> Floats:
        """(..., 3) change of the offset at (...) values; NaN for a missing value."""
        away = self.numbers(values) - self.reference
        shifted: Floats = away[..., np.newaxis] * self.per_unit
        return shifted

    def gain(self, values: ArrayLike) -> Floats:
        """(...) factor of the earth's field at (...) values."""
        return 1.0 + self.gain_per_unit * (self.numbers(values) - self.reference)

    def range_excess(self, values: ArrayLike) -> float:
        """Largest excess of values over the recorded range, as a fraction of it; 0 if the range is not known.

        >>> Disturbance("current", [1, 0, 0], lowest=0.0, highest=20.0).range_excess([5.0, 25.0, np.nan])
        0.25
        """
        seen = self.numbers(values)
        seen = seen[np.isfinite(seen)]
        if not len(seen) or not self.has_range:
            return 0.0
        outside = max(self.lowest - float(seen.min()), float(seen.max()) - self.highest, 0.0)
        return outside / (self.highest - self.lowest)

    def text_of(self, value: float) -> str:
        """Write a value with its unit.

        >>> Disturbance("temperature", [0, 0, 0]).text_of(21.54)
        '21.5 °C'
        """
        if self.states and value in (0.0, 1.0):
            return self.states[int(value)]
        return f"{_value_text(value)}{self.kind.unit}"

    def __str__(self) -> str:
        numbers = ", ".join(f"{value:.3g}" for value in self.per_unit + 0.0)
        lag = f", lag {self.lag_s:.2g} s" if self.lag_s else ""
        gain = f", scale {self.gain_per_unit:+.2%} per °C" if self.gain_per_unit else ""
        if self.states:
            return f"{self.name}: {numbers} while {self.states[1]}{lag}, none while {self.states[0]}"
        ends = f"{_value_text(self.lowest)} to {self.text_of(self.highest)}"
        span = f"recorded {ends}" if self.has_range else "range unknown"
        return f"{self.name}: {numbers} per {self.kind.per}{gain}{lag}, from {self.text_of(self.reference)}, {span}"


def _value_text(value: float) -> str:
    """Write a value to three digits, from 1,000 on as a whole number instead of 3e+03.

    >>> _value_text(0.0), _value_text(21.54), _value_text(3000.0), _value_text(-12345.6), _value_text(3.2e9)
    ('0', '21.5', '3,000', '-12,346', '3.2e+09')
    """
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.3g}"


@cache
def kind_of(name: str) -> Kind:
    """Kind of a disturbance, by its name.

    Raises
    ------
    UsageError
        For a name that a disturbance cannot have.

    Examples
    --------
    >>> kind_of("current"), kind_of("throttle2").key
    (Kind(key='current_A', unit=' A', per='A', least=0.1, plausible=(-1000.0, 1000.0)), 'throttle2')
    >>> kind_of("wheel_rpm").per, kind_of("BAT.Curr").per
    ('rpm', 'unit of BAT.Curr')
    """
    if name in KINDS:
        return KINDS[name]
    kind, number = kind_and_motor(name)
    if number:
        return KINDS[kind]._replace(key=KINDS[kind].key.replace(kind, name))
    if not name.strip() or name in RESERVED_NAMES or name in MOTORS.values():
        raise UsageError(
            f"{name!r} cannot be the name of a disturbance: need {', '.join(KINDS)}, current1, throttle1 … of each "
            "motor, or the name of another column; rename the column in the recording"
        )
    unit = unit_in(name)
    return Kind(name, f" {unit}" if unit else "", unit or f"unit of {name}", 0.0, (-np.inf, np.inf))


def is_column(name: str) -> bool:
    """Whether a name is that of a column in the log, not of a known kind or of a motor.

    >>> is_column("wheel_rpm"), is_column("current"), is_column("throttle3"), is_column("currents")
    (True, False, False, False)
    """
    return not (name in KINDS or name in MOTORS.values() or kind_and_motor(name)[1])


def kind_and_motor(name: str) -> tuple[str, int]:
    """Kind of a disturbance, and number of its motor counted from 1; 0 for a disturbance without a motor of its own.

    >>> kind_and_motor("current12"), kind_and_motor("current"), kind_and_motor("current0")
    (('current', 12), ('current', 0), ('current0', 0))
    """
    match = _NUMBERED.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, 0)


def motor_names(kind: str, count: int) -> tuple[str, ...]:
    """Names of the disturbances of `count` motors, one for each.

    >>> motor_names("current", 3)
    ('current1', 'current2', 'current3')
    """
    return tuple(f"{kind}{number + 1}" for number in range(count))


NAMES_BY_KEY: Final[Mapping[str, str]] = {
    kind_of(name).key: name for name in (*KINDS, *(name for kind in MOTORS for name in motor_names(kind, MAX_MOTORS)))
}
"""Names of disturbances by their keys in a calibration file."""


def sort_key(name: str) -> tuple[int, int, str]:
    """Sort key of a disturbance by its name: `KINDS` in their order, each before its motors; columns of the log last.

    >>> sorted(["wheel", "temperature", "throttle", "current10", "current2", "current"], key=sort_key)
    ['current', 'current2', 'current10', 'throttle', 'temperature', 'wheel']
    """
    kind_of(name)
    kind, number = kind_and_motor(name)
    return (len(KINDS), 0, name) if is_column(name) else (list(KINDS).index(kind), number, "")


def check_disturbances(disturbances: Iterable[Disturbance]) -> tuple[Disturbance, ...]:
    """Sort disturbances by `sort_key` and refuse two of the same name.

    Raises
    ------
    UsageError
        For two of one name.
    """
    listed = sorted(disturbances, key=lambda disturbance: sort_key(disturbance.name))
    for one, other in pairwise(listed):
        if one.name == other.name:
            raise UsageError(f"{one.name} is given twice: give each disturbance once")
    return tuple(listed)


def values_by_name(followed: Sequence[Disturbance] = (), /, **columns: ArrayLike | None) -> dict[str, ArrayLike]:
    """Values of disturbances by name; the (..., M) ``currents`` and ``throttles`` of M motors are split by motor.

    Raises
    ------
    UsageError
        For a name that is not a known kind and not that of a disturbance in `followed`.

    >>> values_by_name(current=None, throttle=0.5, currents=[1.0, 2.0])
    {'throttle': 0.5, 'current1': array(1.), 'current2': array(2.)}
    """
    given: dict[str, ArrayLike] = {name: values for name, values in columns.items() if values is not None}
    for kind, many in MOTORS.items():
        if many in given:
            table = np.atleast_1d(to_floats(given.pop(many), many))
            given |= {name: table[..., place] for place, name in enumerate(motor_names(kind, table.shape[-1]))}
    ours = {one.name for one in followed}
    for name in given:
        if is_column(name) and name not in ours:
            each = ", ".join((*KINDS, "current1 …", "throttle1 …"))
            does = f"only on {', '.join(ours)}" if ours else "only on the readings"
            raise UsageError(
                f"the calibration does not depend on {name!r}{did_you_mean(name, ours)}, {does}: need {each}"
            )
    return given


def shift_and_gain(
    disturbances: Sequence[Disturbance], values: Mapping[str, ArrayLike | None]
) -> tuple[Floats, Floats]:
    """Change of the offset (..., 3) and factor of the earth's field (...) at values of the disturbances.

    Raises
    ------
    UsageError
        For a disturbance without values.

    Examples
    --------
    >>> warm = Disturbance("temperature", [0.1, 0.0, 0.0], reference=20.0, gain_per_unit=0.01)
    >>> shift, gain = shift_and_gain([warm], {"temperature": [20.0, 30.0]})
    >>> shift[:, 0], gain
    (array([0., 1.]), array([1. , 1.1]))
    """
    shift, gain = np.zeros(3), np.ones(())
    for disturbance in disturbances:
        given = values.get(disturbance.name)
        if given is None:
            raise UsageError(
                f"the calibration corrects for {disturbance.name}, and no values were given: give {disturbance.name} "
                "for each reading, or take the calibration at a fixed value",
                hint={disturbance.name: None, **reference_hint([disturbance])},
            )
        shift = shift + disturbance.shift(given)
        gain = gain * disturbance.gain(given)
    return shift, gain


def reference_hint(disturbances: Iterable[Disturbance]) -> Hint:
    """Hint for an error: take the calibration at the reference values of these disturbances."""
    return {"at": {one.name: one.states[0] if one.states else one.reference for one in disturbances}}


def lagged_values(values: Floats, time: Floats | None, lag_s: float) -> Floats:
    """(N,) values that were logged `lag_s` before each of (N,) times, in s; the first value before the first time.

    Gaps are interpolated linearly. Without times the lag is ignored, and gaps are interpolated over the index.

    >>> lagged_values(np.array([0.0, 1.0, np.nan, 3.0]), np.array([0.0, 1.0, 2.0, 3.0]), 0.5)
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


def have_equal_disturbances(ours: tuple[Disturbance, ...], theirs: tuple[Disturbance, ...], tolerance: float) -> bool:
    """Whether two sets of disturbances change the offset by the same amount, within `tolerance`, in recorded ranges."""
    if [disturbance.name for disturbance in ours] != [disturbance.name for disturbance in theirs]:
        return False
    return all(
        bool(np.abs(one.shift(end) - other.shift(end)).max() <= tolerance) and one.lag_s == other.lag_s
        for one, other in zip(ours, theirs, strict=True)
        for end in (one.reference, one.lowest, one.highest, one.extreme_value)
    )
