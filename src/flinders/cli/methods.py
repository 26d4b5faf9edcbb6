"""``flinders methods``: list the methods of estimation and their options (``--option NAME=VALUE``).

>>> from flinders.estimators import METHODS
>>> list_options(METHODS["minmax"])
{'variant': ('mean', 'largest', 'full-range'), 'trim': ('no', 'yes')}
>>> parse_options(["variant=largest", "trim=yes"], METHODS["minmax"])
{'variant': 'largest', 'trim': True}
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Final, cast, get_args, get_type_hints

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_result
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.estimators import Estimator


class Methods(program.Group):
    """Format of the list."""

    as_json: bool = option.as_json()


@program.command_of(
    "methods",
    Methods,
    epilog="""\b
Example:
  flinders methods
  flinders calibrate --method sphere tumble.csv
  flinders calibrate --method ellipsoid --option radii=xy tumble.csv
""",
)
def command(options: Methods) -> None:
    """List the methods of estimation and when to use each."""
    from flinders.estimators import ROWS
    from flinders.report.comparison_pages import page_of_methods

    values = {name: list_options(row.kind) for name, row in ROWS.items()}
    fields = {
        name: {
            "parameters": row.parameters,
            "least_readings": row.kind.unknowns,
            "use": row.use,
            "options": values[name],
        }
        for name, row in ROWS.items()
    }
    print_result(lambda: fields, lambda: page_of_methods(ROWS, values), as_json=options.as_json)


BOOLEAN_WORDS: Final = {"no": False, "yes": True, "false": False, "true": True}


def list_options(method: type[Estimator]) -> dict[str, tuple[str, ...]]:
    """Each option of a method with its values, the default first; for numbers the default only."""
    hints = get_type_hints(method)
    return {field.name: _values(field.default, get_args(hints[field.name])) for field in _fields(method)}


def parse_options(words: Iterable[str], method: type[Estimator]) -> dict[str, Any]:
    """Read words of the form ``NAME=VALUE`` as options of a method."""
    defaults = {field.name: field.default for field in _fields(method)}
    options: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or name not in defaults:
            takes = (
                ", ".join(f"{option}={'|'.join(values)}" for option, values in list_options(method).items()) or "none"
            )
            raise UsageError(f"--option {word}: {method.name} takes {takes}")
        if name in options:
            raise UsageError(f"--option {name} is given twice: give it once")
        options[name] = _value(word, value.strip(), defaults[name])
    return options


def _fields(method: type[Estimator]) -> list[dataclasses.Field[Any]]:
    """Options of a method, except dip and field strength, which have options of their own."""
    from flinders.estimators.base import SITE_OPTIONS

    return [field for field in dataclasses.fields(cast("Any", method)) if field.name not in SITE_OPTIONS]


def _values(default: object, choices: tuple[object, ...]) -> tuple[str, ...]:
    """Values of an option in words, the default first; for a number the default only."""
    if isinstance(default, bool):
        return ("yes", "no") if default else ("no", "yes")
    if isinstance(default, str):
        return (default, *(str(choice) for choice in choices if choice != default))
    return ("none",) if default is None else (f"{default:g}",)


def _value(word: str, text: str, default: object) -> object:
    """Read a value; its type is that of the default."""
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        if text.casefold() not in BOOLEAN_WORDS:
            raise UsageError(f"--option {word}: need yes or no")
        return BOOLEAN_WORDS[text.casefold()]
    if text.casefold() == "none":
        return None
    numbers = program.numbers_of(text)
    if len(numbers) != 1:
        raise UsageError(f"--option {word}: need a number, or none")
    return numbers[0]
