"""Limits that a unit misses: first the engine's verdict on its readings, then the pass limits of the station's file.

The engine makes the verdict; this module only compares numbers of the fit with the limits of the file.

>>> from flinders import simulate
>>> from flinders.apps.live.station.plan import PassLimits
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> misses(fit, PassLimits())
()
>>> misses(fit, PassLimits(noise=0.1, strength=(20.0, 30.0)))
(Miss(code='strength', found=49.3..., needed=(20.0, 30.0)), Miss(code='noise', found=0.49..., needed=(0.0, 0.1)))
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from msgspec import Struct

from flinders.errors import FlindersError
from flinders.findings import first_causes
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.apps.live.station.plan import PassLimits
    from flinders.fitting.result import Fit

AXES: Final = "xyz"


class Miss(Struct, frozen=True):
    """Reason why a unit fails: the code of a finding, of an error, or of a sentence in `station.words`."""

    code: str
    found: float | None = None  # the value outside its limits
    needed: tuple[float, float] | None = None  # its limits


def misses(outcome: Fit | FlindersError, limits: PassLimits) -> tuple[Miss, ...]:
    """Misses of a fit, the most severe first; empty if it passes."""
    fit = outcome.fit if isinstance(outcome, Refused) else outcome
    if isinstance(fit, FlindersError):
        return (Miss(fit.code),)
    if fit.verdict == "refused":
        return _causes(fit)
    limiting = _causes(fit) if limits.verdict == "good" and fit.verdict == "limited" else ()
    return (*limiting, *_number_misses(fit, limits))


def _causes(fit: Fit) -> tuple[Miss, ...]:
    """Misses by the findings that determine the verdict; ``unstated`` for a calibration without a verdict."""
    codes = [finding.code for finding in first_causes(fit.findings) if finding.severity != "note"]
    return tuple(map(Miss, codes or ["unstated"]))


def _number_misses(fit: Fit, limits: PassLimits) -> Iterator[Miss]:
    """Yield a miss for each number outside its limits; an unknown number counts as outside."""
    if fit.calibration.unit != limits.unit and (limits.strength or limits.offset or limits.noise is not None):
        yield Miss("other-unit")
        return
    if limits.verdict != "good" or fit.verdict == "good":  # otherwise the engine's findings state the heading error
        yield from _miss("heading-error", fit.heading_error_deg.worst, (0.0, limits.heading_error_deg))
    yield from _miss("strength", fit.calibration.field_strength, limits.strength)
    for axis, value in zip(AXES, fit.calibration.offset.tolist(), strict=True):
        yield from _miss(f"offset-{axis}", value, limits.offset)
    yield from _miss("noise", fit.evidence.noise, None if limits.noise is None else (0.0, limits.noise))
    share = None if limits.coverage is None else (limits.coverage, 1.0)
    yield from _miss("coverage-share", fit.evidence.coverage.fraction, share)


def _miss(code: str, value: float | None, ends: tuple[float, float] | None) -> Iterator[Miss]:
    number = math.nan if value is None else float(value)
    if ends is not None and not ends[0] <= number <= ends[1]:
        yield Miss(code, number if math.isfinite(number) else None, ends)
