"""Functions of higher packages that methods of `core` call; `flinders/__init__.py` registers them here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

UPPER_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {}
"""Registered functions by name.

``html`` makes the HTML of a fit for a notebook. ``plot`` draws a fit and its recording. ``correct_frame`` corrects the
readings in a data frame by a calibration.
"""
