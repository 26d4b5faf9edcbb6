"""Numbers of an online calibration in its file: by name, with words for NaN and infinity."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.native.layouts import ONLINE, empty_row
from flinders.native.online import MAX_STORED_READINGS
from flinders.workflows.online_events import ACTIVITIES

if TYPE_CHECKING:
    from flinders.native.layouts import Records


def record_from(saved: dict[str, Any]) -> Records:
    """Record of the engine from its numbers by name; `ValueError` for numbers that this engine cannot have written.

    Counts are checked, since the engine uses them as indices.
    """
    record = empty_row(ONLINE)
    for name in ONLINE.names or ():
        values = np.array(saved[name])
        if values.shape != record[name].shape:
            raise ValueError(f"{name} has {values.size} numbers, and not {record[name].size}")
        record[name] = values
    kept, tested, doubtful = (int(record[name]) for name in ("kept", "tested", "doubtful"))
    is_sound = 0 <= tested <= kept <= MAX_STORED_READINGS and -1 <= doubtful <= kept and record["averaged"] >= 0
    if not (is_sound and 0 <= record["state"] < len(ACTIVITIES)):
        raise ValueError("its counts are invalid")
    return record


def json_of_record(values: Records) -> Any:  # noqa: ANN401 - JSON
    """Numbers of a record for JSON, with words for NaN and infinity."""
    return values.tolist() if np.isfinite(values).all() else json_of(values.tolist())


def json_of(content: Any) -> Any:  # noqa: ANN401 - JSON
    """Content with words in place of NaN and infinity, which JSON cannot represent."""
    if isinstance(content, dict):
        return {name: json_of(value) for name, value in content.items()}
    if isinstance(content, list):
        return [json_of(value) for value in content]
    return str(content) if isinstance(content, float) and not math.isfinite(content) else content


def numbers_from_json(values: Any) -> Any:  # noqa: ANN401 - a number or a list of them
    """Numbers from JSON, with NaN and infinity in place of their words."""
    return (
        [numbers_from_json(value) for value in values]
        if isinstance(values, list)
        else float(values)
        if isinstance(values, str)
        else values
    )
