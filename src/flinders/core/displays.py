"""Displays of a fit, which are above it: the package `flinders`, which is always loaded first, puts them here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

DISPLAYS: Final[dict[str, Callable[..., Any]]] = {}
"""``html`` of a fit for a notebook, and ``plot`` of a fit and its recording."""
