"""Options of a method on the command line: ``--option NAME=VALUE``, as `flinders methods` lists them.

>>> from flinders.estimators import METHODS
>>> listed(METHODS["minmax"])
{'variant': ('mean', 'largest', 'full-range'), 'trim': ('no', 'yes')}
>>> parsed(["variant=largest", "trim=yes"], METHODS["minmax"])
{'variant': 'largest', 'trim': True}
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any, Final, cast, get_args, get_type_hints

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.estimators import Estimator

SITE: Final = ("dip_deg", "field_strength")
"""What the site says, by ``--dip`` and ``--field-strength``, is no option of a method here."""

TRUTH: Final = {"no": False, "yes": True, "false": False, "true": True}


def listed(method: type[Estimator]) -> dict[str, tuple[str, ...]]:
    """Each option of a method with its values, the default first; numbers by their default alone."""
    hints = get_type_hints(method)
    return {field.name: _values(field.default, get_args(hints[field.name])) for field in _fields(method)}


def parsed(words: Iterable[str], method: type[Estimator]) -> dict[str, Any]:
    """Read ``NAME=VALUE`` as options of a method.

    Raises
    ------
    UsageError
        For an option that the method has not, one given twice, or a value of another kind.
    """
    defaults = {field.name: field.default for field in _fields(method)}
    found: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or name not in defaults:
            takes = ", ".join(f"{option}={'|'.join(values)}" for option, values in listed(method).items()) or "none"
            raise UsageError(f"--option {word}: {method.name} takes {takes}")
        if name in found:
            raise UsageError(f"--option {name} is given twice: give it once")
        found[name] = _value(word, value.strip(), defaults[name])
    return found


def _fields(method: type[Estimator]) -> list[dataclasses.Field[Any]]:
    return [field for field in dataclasses.fields(cast("Any", method)) if field.name not in SITE]


def _values(default: object, choices: tuple[object, ...]) -> tuple[str, ...]:
    """Write the values that an option takes, the default first; of numbers it alone."""
    if isinstance(default, bool):
        return ("yes", "no") if default else ("no", "yes")
    if isinstance(default, str):
        return (default, *(str(choice) for choice in choices if choice != default))
    return ("none",) if default is None else (f"{default:g}",)


def _value(word: str, text: str, default: object) -> object:
    """Read a value of the kind that the default is of.

    Raises
    ------
    UsageError
        For one of another kind.
    """
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        if text.casefold() not in TRUTH:
            raise UsageError(f"--option {word}: need yes or no")
        return TRUTH[text.casefold()]
    if text.casefold() == "none":
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"--option {word}: need a number, or none")
    return number
