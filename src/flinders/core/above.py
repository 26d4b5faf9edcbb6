"""Functions of higher packages that methods of `core` call; `flinders/__init__.py` registers them here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

UPPER_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {}
"""``html`` of a fit for a notebook, ``plot`` of a fit and its recording, ``correct_frame`` of a calibration."""
