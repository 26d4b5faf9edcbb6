"""State of an online calibration that another release has saved, read by the names of its numbers.

The calibrations are kept, with covariance, noise, times, settings, and the values that were learnt about the sensor and
its places. Evidence is dropped: its numbers are indices into the memory of that release.

>>> from flinders import OnlineCalibration, simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> online = OnlineCalibration()
>>> _ = online.add(tumble.field, time=tumble.time)
>>> saved = {name: online._record[name] for name in online._record.dtype.names if name not in ("version", "newest")}
>>> again = convert(saved)
>>> int(again["kept"]), float(again["noise"]) == float(online._record["noise"])
(0, True)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.native.engine import engine
from flinders.native.layouts import ONLINE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats
    from flinders.native.layouts import Records

SETTINGS: Final = ("target_deg", "dip_deg", "is_locked")
TIMES: Final = ("began", "now", "adopted_at", "moved_at")
LEARNT_FIELDS: Final = ("height", "height_now", "moved")
LEARNT_SIZES: Final = (
    "place", "scatter", "height_sigma", "moves", "moves_square", "watched", "rates", "probable_rates", "expected_walk",
    "expected_walk_sigma",
)  # fmt: skip
"""Names of learnt values, which are not negative, with the number of values of each."""
MIN_EIGENVALUE_RATIO: Final = 1e-9
"""Largest size of a negative eigenvalue of a covariance that counts as rounding, relative to the largest eigenvalue."""


def is_of_this_release(saved: Mapping[str, Any], version: int) -> bool:
    """Whether saved numbers have the version and all names of this release."""
    return saved.get("version") == version and all(name in saved for name in ONLINE.names or ())


def convert(saved: Mapping[str, Any]) -> Records:
    """Record of this release from numbers by name.

    Raises `ValueError` if the calibration, its covariance, its noise or its time is missing.
    """
    record = engine().make_online()
    for name in SETTINGS:
        _take(record, saved, name)
    if not (record["target_deg"] > 0.0 and abs(record["dip_deg"]) <= 89.0):
        raise ValueError("its target or dip is invalid")
    if _number(saved, "state") == 0:
        return record
    record["is_level"] = _number(saved, "is_level")
    latest, covariance = _required_numbers(saved, "latest", 9), _covariance(saved)
    at, noise = float(_required_numbers(saved, "latest_at", 1)[0]), float(_required_numbers(saved, "noise", 1)[0])
    if noise <= 0.0:
        raise ValueError(f"its noise is {noise:g}")
    engine().online_activate(record, latest, covariance, noise=noise, time=at)
    for name in (*TIMES, *LEARNT_FIELDS, *LEARNT_SIZES):
        _take(record, saved, name)
    record["now"] = max(float(record["now"]), at)
    for name in ("rates", "probable_rates"):
        if not _are_probabilities(record[name]):
            record[name] = engine().make_online()[name]
    for name in ("in_force", "replaced"):
        if (known := _saved_numbers(saved, name, 9)) is not None and _is_surface(known):
            record[name] = known
    return record


def _covariance(saved: Mapping[str, Any]) -> Floats:
    """(9, 9) covariance of the newest estimate, enlarged by the saved contradiction, which is not kept by itself."""
    covariance = _required_numbers(saved, "latest_covariance", 81).reshape(9, 9)
    apart, unknown = _saved_numbers(saved, "apart", 3), _saved_numbers(saved, "apart_covariance", 9)
    if apart is not None and unknown is not None:
        covariance[:3, :3] += np.outer(apart, apart) + unknown.reshape(3, 3)
    values = np.linalg.eigvalsh(covariance)
    if not values[0] >= -MIN_EIGENVALUE_RATIO * values[-1]:
        raise ValueError("its covariance is invalid")
    return covariance


def _take(record: Records, saved: Mapping[str, Any], name: str) -> None:
    """Copy one or several numbers into the record, if they are saved."""
    found = _saved_numbers(saved, name, record[name].size)
    if found is not None and not (name in LEARNT_SIZES and found.min() < 0.0):
        record[name] = found.reshape(record[name].shape)


def _saved_numbers(saved: Mapping[str, Any], name: str, size: int) -> Floats | None:
    """(size,) finite numbers by name; None if they are missing or not finite."""
    values = np.ravel(np.array(saved.get(name, math.nan), float))
    return values if len(values) == size and np.isfinite(values).all() else None


def _required_numbers(saved: Mapping[str, Any], name: str, size: int) -> Floats:
    """(size,) finite numbers by name; `ValueError` if they are missing."""
    found = _saved_numbers(saved, name, size)
    if found is None:
        raise ValueError(f"it is of another release, without {name}")
    return found


def _number(saved: Mapping[str, Any], name: str) -> int:
    """A whole number by name; `ValueError` if it is missing."""
    return int(_required_numbers(saved, name, 1)[0])


def _are_probabilities(values: Floats) -> bool:
    return bool(values.min() > 0.0 and abs(values.sum() - 1.0) < MIN_EIGENVALUE_RATIO)


def _is_surface(parameters: Floats) -> bool:
    """Whether nine parameters, offset and shape, are those of an ellipsoid."""
    return bool(np.linalg.eigvalsh(symmetric_matrix(parameters[3:]))[0] > 0.0)
