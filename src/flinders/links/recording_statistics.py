"""Statistics of a recording that is being made: numbers of readings and lines, rate, field strength, losses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flinders.errors import count_text, figures

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.links.line_form import Form


@dataclass(slots=True)
class RecordingStatistics:
    """Statistics of a recording so far."""

    form: Form | None = None  # format of the lines; None if unknown
    unit: str = ""  # µT or counts; empty if the columns of the magnetometer are unknown
    readings: int = 0  # number of rows
    unknown: int = 0  # number of lines that could not be parsed
    accompanying: int = 0  # number of `unknown` lines that a program prints along with its readings; known at the end
    lines: int = 0
    received: int = 0  # number of bytes
    seconds: float = 0.0  # time since the start, in s
    strengths: int = 0
    strength_sum: float = 0.0  # sum of the lengths of the field, in `unit`
    weakest: float = math.inf
    strongest: float = 0.0
    disconnections: int = 0  # number of times that the source was disconnected
    datagrams_lost: int = 0  # number of datagrams that this machine dropped, if it counts them
    first_unknown: str = ""  # the first line that could not be parsed
    first_at: float = 0.0
    last_at: float = 0.0

    def count_row(self, at: float) -> None:
        """Count one row, with its time in s."""
        self.first_at = self.first_at if self.readings else at
        self.readings, self.last_at = self.readings + 1, at

    def measure(self, field: Floats) -> None:
        """Add the field strengths of (N, 3) readings."""
        with np.errstate(over="ignore"):
            strengths = np.linalg.norm(field, axis=1)
        self.strengths += len(field)
        self.strength_sum += float(strengths.sum())
        self.weakest = float(strengths.min(initial=self.weakest))
        self.strongest = float(strengths.max(initial=self.strongest))

    @property
    def rate_hz(self) -> float:
        """Readings per second, gaps included; 0 for fewer than two readings."""
        span = self.last_at - self.first_at
        return (self.readings - 1) / span if self.readings > 1 and span > 0 else 0.0

    def as_dict(self) -> dict[str, object]:
        """JSON-ready fields."""
        known = self.strengths > 0
        return {
            "format": str(self.form) if self.form else None,  # format of the lines; null if unknown
            "readings": self.readings,
            "seconds": self.seconds,
            "rate_hz": self.rate_hz or None,
            # `mean`, `min` and `max` length of the readings, in `unit`
            "strength": {
                "unit": self.unit or None,
                "mean": self.strength_sum / self.strengths if known else None,
                "min": self.weakest if known else None,
                "max": self.strongest if known else None,
            },
            # number of lines that could not be parsed, without `accompanying`
            "not_understood": self.unknown - self.accompanying,
            "accompanying": self.accompanying,  # number of lines that a program prints along with its readings
            "first_not_understood": self.first_unknown or None,  # the first of them, or of `accompanying`
            "bytes": self.received,  # number of received bytes
            "disconnections": self.disconnections,
            "datagrams_lost": self.datagrams_lost,
        }

    def __str__(self) -> str:
        parts = [
            f"{count_text(self.readings, 'reading')}{f' ({self.form})' if self.form else ''} in {self.seconds:.1f} s"
        ]
        parts += [f"{figures(self.rate_hz)} Hz"] * (self.rate_hz > 0)
        if self.strengths:
            mean = self.strength_sum / self.strengths
            ends = f"({figures(self.weakest, 3)} to {figures(self.strongest, 3)})"
            parts.append(f"strength {figures(mean, 3)} {self.unit} {ends}")
        parts += [f"lost {self.disconnections} time{'s' * (self.disconnections != 1)}"] * (self.disconnections > 0)
        parts += [f"{count_text(self.datagrams_lost, 'datagram')} lost by this machine"] * (self.datagrams_lost > 0)
        return ", ".join(parts)

    @property
    def brief(self) -> str:
        """Readings, rate, strength and duration in one line that fits on any terminal."""
        rate = f"{figures(self.rate_hz, 3)} Hz" if self.rate_hz else "- Hz"
        parts = [count_text(self.readings, "reading"), rate]
        if self.strengths:
            parts.append(f"{figures(self.weakest, 3)} to {figures(self.strongest, 3)} {self.unit}")
        return "  ".join([*parts, f"{self.seconds:.0f} s"])
