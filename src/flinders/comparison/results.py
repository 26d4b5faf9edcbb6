"""JSON of results of comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from flinders.heading.error_propagation import HeadingError


def json_attributes(result: object, *names: str) -> dict[str, Any]:
    """Some attributes of a result by their `names`, as JSON values."""
    return {name: _plain(getattr(result, name)) for name in names}


def with_bound(error: HeadingError | None, bound_deg: float | None) -> dict[str, float] | None:
    """JSON of a claimed heading error, with the 95 % bound over all headings."""
    return None if error is None or bound_deg is None else error.as_dict(bound_95=bound_deg)


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a result holds
    """Convert a value for JSON: arrays and tuples to lists, results to mappings."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if hasattr(value, "as_dict"):
        return value.as_dict()
    if hasattr(value, "_asdict"):
        return value._asdict()
    return [_plain(each) for each in value] if isinstance(value, tuple) else value
