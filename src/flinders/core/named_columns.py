"""Columns of a log by the names they have there: their unit, and the two words of a state as 0 and 1.

A calibration may follow any column that changes with the field of the vehicle: the current of one battery, the speed
of a wheel, the state of a charger. Its name in the log is its name everywhere.

>>> unit_in("wheel_speed_rpm"), unit_in("Servo (µs)"), unit_in("BAT.Curr")
('rpm', 'µs', '')
>>> states = states_of("charger", ["charging", "idle", "", "idle"])
>>> states, coded(["charging", "", "idle"], states, "charger")
(('idle', 'charging'), array([ 1., nan,  0.]))
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import floats
from flinders.errors import InputError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats

RESERVED: Final = ("raw", "corrected", "columns", "heading", "level")
"""Parameters of `Calibration.apply` and `unapply`: no column that is followed can have such a name."""

UNITS: Final = {
    "rpm": "rpm", "RPM": "rpm", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "W": "W", "kW": "kW", "N": "N",
    "Nm": "N m", "Hz": "Hz", "mm": "mm", "bar": "bar", "Pa": "Pa", "kPa": "kPa", "degC": "°C", "deg": "°",
    "percent": "%", "pct": "%", "us": "µs", "mps": "m/s", "kmh": "km/h", "radps": "rad/s",
}  # fmt: skip
"""Units as the last word of a name spells them, and as they are printed."""

_IN_BRACKETS: Final = re.compile(r"[(\[]\s*([^()\[\]]*[^()\[\]\d\s][^()\[\]]*?)\s*[)\]]\s*$")
_LAST_WORD: Final = re.compile(r"[_ .]([A-Za-z]+)$")

OFF: Final = frozenset(("off", "idle", "false", "no", "none", "stopped", "stop", "disabled", "inactive", "closed"))
"""Words of the state at which the offset of a calibration holds; else it is the first of the two by the alphabet."""

MAX_LISTED: Final = 6
"""Words of a column that a refusal lists."""


def unit_in(name: str) -> str:
    """The unit that a name states, in brackets or as its last word; empty where it states none."""
    if match := _IN_BRACKETS.search(name):
        return UNITS.get(match[1], match[1])
    match = _LAST_WORD.search(name)
    return UNITS.get(match[1], "") if match else ""


def are_words(values: NDArray[Any]) -> bool:
    """Whether a column has words, not numbers."""
    return values.dtype.kind in "USO"


def states_of(name: str, words: Iterable[str]) -> tuple[str, str]:
    """The words of the two states of a column, the one at which the offset holds first.

    Raises `InputError` unless there are two.
    """
    found = sorted({word.strip() for word in words} - {""}, key=lambda word: (word.casefold() not in OFF, word))
    if len(found) == 2:
        return found[0], found[1]
    listed = ", ".join(found[:MAX_LISTED]) + ", …" * (len(found) > MAX_LISTED)
    if len(found) < 2:
        raise InputError(
            f"column {name} has {counted(len(found), 'word')} ({listed or 'all cells are empty'}): need two, one of "
            "each state; record in both, or leave the column out"
        )
    raise InputError(
        f"column {name} has {len(found)} different words ({listed}): need two. Write a column with a number for each "
        "state that counts, or calibrate the recordings of each state by themselves"
    )


def coded(values: ArrayLike, states: Sequence[str], name: str) -> Floats:
    """(...) numbers as they are; 0 and 1 in the place of the words of two states, NaN where there is none.

    Raises `UsageError` for a word that is none of the states; `ArrayError` for words where there are no states.
    """
    array = np.asarray(values)
    if not (states and are_words(array)):
        return floats(values, name)
    words = np.array([str(word).strip() for word in array.ravel()], dtype=object).reshape(array.shape)
    numbers = np.full(array.shape, np.nan)
    for place, state in enumerate(states):
        numbers[words == state] = place
    unknown = np.isnan(numbers) & (words != "")
    if unknown.any():
        raise UsageError(f"{name} is {words[unknown].ravel()[0]!r}: the calibration knows {' and '.join(states)}")
    return numbers
