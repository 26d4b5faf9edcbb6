"""Checks of the parameters of simulations."""

from __future__ import annotations

import math
from typing import Final

from flinders.errors import UsageError

MAX_READINGS: Final = 5_000_000
"""Largest count of readings of a simulated recording, which takes about 2 GB of memory."""


def positive(value: float, name: str) -> float:
    """Return a positive number; raise `UsageError` for others."""
    if not (math.isfinite(value) and value > 0):
        raise UsageError(f"{name} is {value:g}: need a positive number")
    return value


def not_negative(value: float, name: str, unit: str) -> float:
    """Return zero or a positive number; raise `UsageError` for others."""
    if not (math.isfinite(value) and value >= 0):
        raise UsageError(f"{name} is {value:g} {unit}: need zero or more")
    return value


def share(value: float, name: str, whole: str = "the readings") -> float:
    """Return a share of `whole`, 0 to 1; raise `UsageError` for other numbers."""
    if not 0.0 <= value <= 1.0:
        raise UsageError(f"{name} is {value:g}: need a share of {whole}, 0 to 1")
    return value


def count(n: int, least: int = 1) -> int:
    """Return a count of readings; raise `UsageError` for one that is too small or too large."""
    if n < least:
        raise UsageError(f"n is {n}: need at least {'one reading' if least == 1 else f'{least} readings'}")
    if n > MAX_READINGS:
        raise UsageError(
            f"n is {n:.3g}: need at most {MAX_READINGS:,} readings, as they are held in memory; simulate several"
        )
    return n
