"""Further columns of a recording, which are read on request by their names in the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from flinders.core.disturbance import KINDS, is_column
from flinders.core.joining import Joined
from flinders.errors import InputError, did_you_mean
from flinders.readers._tokenizer import list_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.core.samples import Recording


def with_auxiliary(recording: Recording, names: Iterable[str], *, are_needed: bool = True) -> Recording:
    """A recording that also yields the columns of these names; kinds that are always read are ignored.

    Raises `InputError` for a missing column if `are_needed`; otherwise the column is left out.

    >>> from flinders.core.samples import Samples
    >>> samples = Samples.of([[1, 2, 3]], auxiliary={"wheel": [4.0]})
    >>> with_auxiliary(samples, ["current", "wheel"]) is samples
    True
    """
    columns = tuple(name for name in dict.fromkeys(names) if is_column(name))
    if not columns:
        return recording
    if isinstance(recording, Joined):
        parts = (with_auxiliary(part, columns, are_needed=are_needed) for part in recording.recordings)
        return Joined(tuple(parts))
    look_up: Any = getattr(recording, "with_auxiliary", None)
    return recording if look_up is None else cast("Recording", look_up(columns, are_needed=are_needed))


def missing_column(source: str, name: str, there: Sequence[str]) -> InputError:
    """Error for a missing column of a table; `there` are the names of the existing columns."""
    if not there:
        return InputError(f"{source} has no column {name!r}: its columns have no names: give them a header")
    return _missing(source, "column", name, did_you_mean(name, (*there, *KINDS)), there)


def missing_field(source: str, name: str, there: Sequence[str]) -> InputError:
    """Error for a missing field of a log; `there` are names of its fields, as far as the reader found some."""
    if not there:
        return InputError(
            f"{source} has no field {name!r}{did_you_mean(name, KINDS)}: give the name of the message or topic, a dot "
            "and the field"
        )
    label = name.rpartition(".")[2].casefold()
    same = [each for each in there if each.rpartition(".")[2].casefold() == label]
    like = f" (did you mean {same[0]!r}?)" if same else did_you_mean(name, (*there, *KINDS))
    return _missing(source, "field", name, like, there)


def _missing(source: str, what: str, name: str, like: str, there: Sequence[str]) -> InputError:
    """Error for a missing column or field, with the existing ones; `like` proposes one of them."""
    names = list_columns(list(there))
    return InputError(f"{source} has no {what} {name!r}{like}: its {what}s are {names}; give a name as it is there")


def places_in(source: str, header: Sequence[str], names: Sequence[str], *, are_needed: bool) -> dict[str, int]:
    """Places of the columns with these names in a header.

    Raises `InputError` for a missing name if `are_needed`; otherwise the name is left out.

    >>> places_in("drive.csv", ["t", "mx", "wheel_rpm "], ["wheel_rpm"], are_needed=True)
    {'wheel_rpm': 2}
    """
    there = [name.strip() for name in header]
    for name in names:
        if are_needed and name not in there:
            raise missing_column(source, name, list(filter(None, there)))
    return {name: there.index(name) for name in names if name in there}
