"""Numbers of an online calibration in its file: by name, with NaN and infinity as words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.native.layouts import ONLINE, blank
from flinders.native.online import EVIDENCE
from flinders.workflows.online_events import DOING

if TYPE_CHECKING:
    from flinders.native.layouts import Records


def record_of(saved: dict[str, Any]) -> Records:
    """Record of the engine from its numbers by name; ValueError for numbers that this engine has not written.

    Counts are checked, because the engine uses them as indices.
    """
    record = blank(ONLINE)
    for name in ONLINE.names or ():
        values = np.array(saved[name])
        if values.shape != record[name].shape:
            raise ValueError(f"{name} has {values.size} numbers, and not {record[name].size}")
        record[name] = values
    kept, tested, doubtful = (int(record[name]) for name in ("kept", "tested", "doubtful"))
    is_sound = 0 <= tested <= kept <= EVIDENCE and -1 <= doubtful <= kept and record["averaged"] >= 0
    if not (is_sound and 0 <= record["state"] < len(DOING)):
        raise ValueError("its counts are invalid")
    return record


def listed(values: Records) -> Any:  # noqa: ANN401 - JSON
    """Numbers of a record for JSON, with words for NaN and infinity."""
    return values.tolist() if np.isfinite(values).all() else finite(values.tolist())


def finite(content: Any) -> Any:  # noqa: ANN401 - JSON
    """Content with words in place of NaN and infinity, which JSON does not have."""
    if isinstance(content, dict):
        return {name: finite(value) for name, value in content.items()}
    if isinstance(content, list):
        return [finite(value) for value in content]
    return str(content) if isinstance(content, float) and not math.isfinite(content) else content


def numbers(values: Any) -> Any:  # noqa: ANN401 - a number or a list of them
    """Numbers from JSON, with NaN and infinity in place of words."""
    return (
        [numbers(value) for value in values]
        if isinstance(values, list)
        else float(values)
        if isinstance(values, str)
        else values
    )
