"""The state of a calibration that keeps itself as another release wrote it, read by the names of its numbers.

What is known goes on: the calibrations with their covariance, noise, times, settings, and what was learnt of the sensor
and its places. Evidence does not, as its numbers are places in the memory of that release.

>>> from flinders import OnlineCalibration, simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> online = OnlineCalibration()
>>> _ = online.add(tumble.field, time=tumble.time)
>>> saved = {name: online._record[name] for name in online._record.dtype.names if name not in ("version", "newest")}
>>> again = converted(saved)
>>> int(again["kept"]), float(again["noise"]) == float(online._record["noise"])
(0, True)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.geometry.ellipsoid import symmetric
from flinders.native.engine import engine
from flinders.native.layouts import ONLINE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats
    from flinders.native.layouts import Records

SETTINGS: Final = ("target_deg", "dip_deg", "is_locked")
TIMES: Final = ("began", "now", "adopted_at", "moved_at")
LEARNT: Final = ("height", "height_now", "moved")
SIZES: Final = (
    "place", "scatter", "height_sigma", "moves", "moves_square", "watched", "rates", "probable_rates", "expected_walk",
    "expected_walk_sigma",
)  # fmt: skip
"""What was learnt of the sensor and its places, which is not negative."""
ROUNDING: Final = 1e-9  # Of the largest eigenvalue of a covariance, by which others may be negative


def is_of_this_release(saved: Mapping[str, Any], version: int) -> bool:
    """Whether numbers by name are those that this release writes: its version, and every name."""
    return saved.get("version") == version and all(name in saved for name in ONLINE.names or ())


def converted(saved: Mapping[str, Any]) -> Records:
    """A record of this release that knows what numbers by name say.

    Raises ValueError where they do not say what was known: a calibration, its covariance, noise and time.
    """
    record = engine().online()
    for name in SETTINGS:
        _take(record, saved, name)
    if not (record["target_deg"] > 0.0 and abs(record["dip_deg"]) <= 89.0):
        raise ValueError("its target or dip is none")
    if _number(saved, "state") == 0:
        return record
    record["is_level"] = _number(saved, "is_level")
    latest, covariance = _needed(saved, "latest", 9), _covariance(saved)
    at, noise = float(_needed(saved, "latest_at", 1)[0]), float(_needed(saved, "noise", 1)[0])
    if noise <= 0.0:
        raise ValueError(f"its noise is {noise:g}")
    engine().online_know(record, latest, covariance, noise=noise, time=at)
    for name in (*TIMES, *LEARNT, *SIZES):
        _take(record, saved, name)
    record["now"] = max(float(record["now"]), at)
    for name in ("rates", "probable_rates"):
        if not _are_probabilities(record[name]):
            record[name] = engine().online()[name]
    for name in ("in_force", "replaced"):
        if (known := _found(saved, name, 9)) is not None and _is_surface(known):
            record[name] = known
    return record


def _covariance(saved: Mapping[str, Any]) -> Floats:
    """(9, 9) of what is known latest; what contradicted it, whose evidence is left out, makes it less certain."""
    covariance = _needed(saved, "latest_covariance", 81).reshape(9, 9)
    apart, unknown = _found(saved, "apart", 3), _found(saved, "apart_covariance", 9)
    if apart is not None and unknown is not None:
        covariance[:3, :3] += np.outer(apart, apart) + unknown.reshape(3, 3)
    values = np.linalg.eigvalsh(covariance)
    if not values[0] >= -ROUNDING * values[-1]:
        raise ValueError("its covariance is none")
    return covariance


def _take(record: Records, saved: Mapping[str, Any], name: str) -> None:
    """Take a number, or several, where they are there."""
    found = _found(saved, name, record[name].size)
    if found is not None and not (name in SIZES and found.min() < 0.0):
        record[name] = found.reshape(record[name].shape)


def _found(saved: Mapping[str, Any], name: str, size: int) -> Floats | None:
    """(size,) finite numbers by name; None where they are not there."""
    values = np.ravel(np.array(saved.get(name, math.nan), float))
    return values if len(values) == size and np.isfinite(values).all() else None


def _needed(saved: Mapping[str, Any], name: str, size: int) -> Floats:
    """(size,) finite numbers without which nothing is known; ValueError where they are not there."""
    found = _found(saved, name, size)
    if found is None:
        raise ValueError(f"it is of another release, and has no {name}")
    return found


def _number(saved: Mapping[str, Any], name: str) -> int:
    """A whole number without which nothing is known."""
    return int(_needed(saved, name, 1)[0])


def _are_probabilities(values: Floats) -> bool:
    return bool(values.min() > 0.0 and abs(values.sum() - 1.0) < ROUNDING)


def _is_surface(parameters: Floats) -> bool:
    """Whether offset and shape are those of an ellipsoid."""
    return bool(np.linalg.eigvalsh(symmetric(parameters[3:]))[0] > 0.0)
