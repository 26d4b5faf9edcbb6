"""Auxiliary columns of a log: their unit from their name, and the two words of a state as 0 and 1.

The offset of a calibration can follow any column that changes with the field of the vehicle: the current of one
battery, the speed of a wheel, the state of a charger. The column keeps its name in the log.

>>> unit_in("wheel_speed_rpm"), unit_in("Servo (µs)"), unit_in("BAT.Curr")
('rpm', 'µs', '')
>>> states = states_of("charger", ["charging", "idle", "", "idle"])
>>> states, numbers_of(["charging", "", "idle"], states, "charger")
(('idle', 'charging'), array([ 1., nan,  0.]))
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import to_floats
from flinders.errors import InputError, UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats

RESERVED_NAMES: Final = ("raw", "corrected", "columns", "heading", "level")
"""Parameters of `Calibration.apply` and `unapply`, which cannot be names of columns that a calibration follows."""

UNITS: Final = {
    "rpm": "rpm", "RPM": "rpm", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "W": "W", "kW": "kW", "N": "N",
    "Nm": "N m", "Hz": "Hz", "mm": "mm", "bar": "bar", "Pa": "Pa", "kPa": "kPa", "degC": "°C", "deg": "°",
    "percent": "%", "pct": "%", "us": "µs", "mps": "m/s", "kmh": "km/h", "radps": "rad/s",
}  # fmt: skip
"""Units as spelled in the last word of a column's name, and as printed."""

_UNIT_IN_BRACKETS: Final = re.compile(r"[(\[]\s*([^()\[\]]*[^()\[\]\d\s][^()\[\]]*?)\s*[)\]]\s*$")
_LAST_WORD: Final = re.compile(r"[_ .]([A-Za-z]+)$")

OFF_WORDS: Final = frozenset(
    ("off", "idle", "false", "no", "none", "stopped", "stop", "disabled", "inactive", "closed")
)
"""Words for the state at which the offset holds; if neither word is listed, the first in alphabetical order is used."""

MAX_LISTED: Final = 6
"""Largest number of words of a column in an error message."""


def unit_in(name: str) -> str:
    """Unit in a column's name, in brackets or as its last word; empty if there is none."""
    if match := _UNIT_IN_BRACKETS.search(name):
        return UNITS.get(match[1], match[1])
    match = _LAST_WORD.search(name)
    return UNITS.get(match[1], "") if match else ""


def are_words(values: NDArray[Any]) -> bool:
    """Whether a column has words instead of numbers."""
    return values.dtype.kind in "USO"


def states_of(name: str, words: Iterable[str]) -> tuple[str, str]:
    """Words of the two states of a column; the state at which the offset holds comes first.

    Raises `InputError` unless there are two different words.
    """
    found = sorted({word.strip() for word in words} - {""}, key=lambda word: (word.casefold() not in OFF_WORDS, word))
    if len(found) == 2:
        return found[0], found[1]
    listed = ", ".join(found[:MAX_LISTED]) + ", …" * (len(found) > MAX_LISTED)
    if len(found) < 2:
        raise InputError(
            f"column {name} has {count_text(len(found), 'word')} ({listed or 'all cells are empty'}): need two, one "
            "for each state; record in both states, or leave the column out"
        )
    raise InputError(
        f"column {name} has {len(found)} different words ({listed}): need two. Write a column with a number for each "
        "state, or calibrate the recordings of each state separately"
    )


def numbers_of(values: ArrayLike, states: Sequence[str], name: str) -> Floats:
    """(...) values as numbers: 0 and 1 for the words of the two states, NaN for an empty cell; numbers stay.

    Raises `UsageError` for a word that is not one of the states; `ArrayError` for words in a column without states.
    """
    array = np.asarray(values)
    if not (states and are_words(array)):
        return to_floats(values, name)
    words = np.array([str(word).strip() for word in array.ravel()], dtype=object).reshape(array.shape)
    numbers = np.full(array.shape, np.nan)
    for place, state in enumerate(states):
        numbers[words == state] = place
    unknown = np.isnan(numbers) & (words != "")
    if unknown.any():
        raise UsageError(f"{name} is {words[unknown].ravel()[0]!r}: the calibration needs {' or '.join(states)}")
    return numbers
