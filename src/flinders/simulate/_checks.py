"""What simulations ask of the numbers they are given."""

from __future__ import annotations

import math
from typing import Final

from flinders.errors import UsageError

MOST: Final = 5_000_000
"""Readings of a simulated recording, which is held in memory: some 2 GB."""


def positive(value: float, name: str) -> float:
    """Let through a positive number."""
    if not (math.isfinite(value) and value > 0):
        raise UsageError(f"{name} is {value:g}: need a positive number")
    return value


def not_negative(value: float, name: str, unit: str) -> float:
    """Let through zero or a positive number."""
    if not (math.isfinite(value) and value >= 0):
        raise UsageError(f"{name} is {value:g} {unit}: need zero or more")
    return value


def share(value: float, name: str, whole: str = "the readings") -> float:
    """Let through a share of something."""
    if not 0.0 <= value <= 1.0:
        raise UsageError(f"{name} is {value:g}: need a share of {whole}, 0 to 1")
    return value


def count(n: int, least: int = 1) -> int:
    """Let through a number of readings."""
    if n < least:
        raise UsageError(f"n is {n}: need at least {'one reading' if least == 1 else f'{least} readings'}")
    if n > MOST:
        raise UsageError(f"n is {n:.3g}: need at most {MOST:,} readings, as they are held in memory; simulate several")
    return n
