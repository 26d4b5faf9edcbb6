"""Calls the engine: recordings in, one table of records out.

`flinders.h` documents the record; its fields are read from there, so that there is one list of them. A record is one
row of a NumPy structured array, the same for one recording and for many.

>>> RECORD["covariance"].shape, RECORD["noise"], "level_worst_deg" in RECORD.names
((81,), dtype('float64'), True)
"""

from __future__ import annotations

import ctypes
import math
import re
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NoEngine
from flinders.native.build import HERE, NoCompiler, library

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats

    Records = NDArray[np.void]

UNDETERMINED: Final = 7
"""Status of a record whose readings leave parameters open, and there is no prior."""


def layout(name: str, real: type[np.floating]) -> np.dtype[np.void]:
    """Layout of a struct of flinders.h, for a library of this precision."""
    text = (HERE / "flinders.h").read_text(encoding="utf-8")
    body = re.sub(r"/\*.*?\*/", "", text.split(f"typedef struct {name} {{")[1].split("}")[0], flags=re.DOTALL)
    kinds = {"uint8_t": np.uint8, "int32_t": np.int32, "int64_t": np.int64, "flinders_real": real}
    members = re.findall(r"(\w+)\s+(\w+)(?:\[(\w+)\])?;", body)
    return np.dtype([(field, kinds[kind], _size(count)) for kind, field, count in members], align=True)


def _size(count: str) -> tuple[int, ...]:
    """Shape of a member: a number, or a name that flinders_rules.h gives one; empty of a member that is one number."""
    if not count or count.isdecimal():
        return (int(count),) if count else ()
    found = re.search(rf"#define {count} (\d+)", (HERE / "flinders_rules.h").read_text(encoding="utf-8"))
    assert found is not None
    return (int(found[1]),)


RECORD: Final = layout("flinders_record", np.float64)
"""Layout of a record."""

SUMS: Final = layout("flinders_sums", np.float64)
"""Layout of sums that add."""

OPTIONS: Final = layout("flinders_options", np.float64)

REQUEST: Final = layout("flinders_request", np.float64)

JUDGEMENT: Final = layout("flinders_judgement", np.float64)
"""Layout of a judgement."""

DISTURBANCE: Final = layout("flinders_disturbance", np.float64)
"""Layout of what a disturbance explains."""

EARLIER: Final = layout("flinders_earlier", np.float64)
"""Layout of what an earlier calibration tells."""

CALIBRATED: Final = layout("flinders_calibrated", np.float64)
"""Layout of a calibration that is compared with another."""

DIFFERENCE: Final = layout("flinders_difference", np.float64)
"""Layout of how far two calibrations are apart."""

BELIEF: Final = layout("flinders_belief", np.float64)
"""Layout of what is known before the next reading."""

GOAL: Final = layout("flinders_goal", np.float64)
ADVICE: Final = layout("flinders_advice", np.float64)
ROUTE: Final = layout("flinders_route", np.float64)
OUTLIER: Final = layout("flinders_outlier", np.float64)
"""Layout of a run of outliers."""

AXIS_CHANGE: Final = layout("flinders_axis_change", np.float64)
"""Layout of axes that changed their sign or place."""

COVERAGE: Final = layout("flinders_coverage", np.float64)
"""Layout of directions in cells of the sphere."""

SITE: Final = layout("flinders_site", np.float64)
"""Layout of the field of a place."""

VERTICAL: Final = layout("flinders_vertical", np.float64)
"""Layout of sums of what an accelerometer shows of a level turn."""

HEIGHTS: Final = layout("flinders_heights", np.float64)
"""Layout of the plane of a level turn."""


@cache
def constant(name: str) -> int:
    """A constant of flinders.h."""
    return int(re.findall(rf"FLINDERS_{name} = (\d+)", (HERE / "flinders.h").read_text(encoding="utf-8"))[0])


class _Array:
    """Parameter that takes an array, which has to be contiguous, or None for null."""

    @classmethod
    def from_param(cls, array: NDArray[np.generic] | None) -> ctypes.c_void_p | None:
        """Its address."""
        return None if array is None else ctypes.c_void_p(array.ctypes.data)


_A, _N, _D = _Array, ctypes.c_size_t, ctypes.c_double

_ARGUMENTS: Final[dict[str, tuple[type, ...]]] = {
    "default_options": (_A,),
    "message": (ctypes.c_int,),
    "record_size": (),
    "real_size": (),
    "kernels": (ctypes.c_int32,),
    "workspace_size": (_N,),
    "fit_parts": (_A, _A, _N, _A, _N, _A, _A, _N, _A),
    "fit_level": (_A, _A, _N, _A, _N, _A, _A, _N, _A),
    "fit_many": (_A, _A, _A, _N, _A, _A, _N, _A),
    "rests": (_A, _N, _A, _N, _A, _N, _A, _A),
    "polish": (_A, _N, _A, _N, _A, _A, _A, _A, _N, _A),
    "earlier_of": (_A, _A, _A, _D, _D, _D, _A),
    "allow_change": (_A,),
    "soft_iron_p_value": (_A, _A, _A, _A),
    "refresh": (_A, _A, _N, _A, _A, _A, _N, _A),
    "turn_deg": (_A, _N, _A),
    "compare": (_A, _A, _D, _A),
    "drift": (_A, _N, _A, _A, _D, _A, _N, _A),
    "regress": (_A, _A, _N, _A, _A, _D, _A, _N, _A),
    "sums_begin": (_A, _A, _D),
    "sums_add": (_A, _A, _N),
    "sums_merge": (_A, _A),
    "sums_solve": (_A, _A),
    "distances": (_A, _N, _A, _A),
    "heading_errors": (_A, _D),
    "judgement_size": (),
    "clear_record": (_A,),
    "default_request": (_A,),
    "claim": (_A, _A),
    "widening_by_few": (_D,),
    "judge": (_A, _A, _A),
    "judge_many": (_A, _N, _A, _A),
    "severity": (ctypes.c_int, _A),
    "causes": (_A,),
    "tilted_error": (_A, _A, _D, _D, _A, _A, _A),
    "uncorrected_error": (_A, _A, _D, _A, _A, _A),
    "attitude_limit": (_A, _A, _D, _D, _A, _A),
    "heading_bound": (_A, _A, _D, _A, _A),
    "with_structure": (_A, _A, _D, _D, _A),
    "level_turn": (_A, _A, _A, _D, _A, _A, _A, _A),
    "attitude_errors": (_A, _A, _D, _A, _N, _A),
    "matrix_sigmas": (_A, _A, _A, ctypes.c_int32, _A),
    "direction_errors": (_A, _A, _A, _N, _A),
    "believe": (_A, _A, _A, _D, _A, _A),
    "rough": (_A, _N, _A),
    "guidance": (_A, _A, _D, _A),
    "path": (_A, _A, _A, _D, _A),
    "pose": (ctypes.c_int32, ctypes.c_int32, _A),
    "pose_towards": (ctypes.c_int32, _A, _A),
    "unmoved_cells": (_A, _N, _D, _D, _D, _A),
    "turned": (_A, _N, _D, _D, _A),
    "dense": (_A, _N, _N, _A),
    "left_out": (_A, _N, ctypes.c_int32, _A),
    "swap_workspace_size": (_N,),
    "axis_swap": (_A, _N, _D, _D, _A, _N, _A, _A),
    "coverage_of_cells": (_A, _A, _N, _D, _A, _A, _D, _A, _A),
    "cells_of": (_A, _N, _A),
    "facing": (_A, _D, _A),
    "is_level": (_A, _D, _D),
    "list_outliers": (_A, _A, _N, _A, _A, _A, _A, _A, _N),
    "default_site": (_A,),
    "vertical_add": (_A, _A, _N, _A, _A),
    "plane_of": (_A, _N, _A, _D, _A, _N, _A),
    "at_site": (_A, _N, _A, _A, _A, _N, _A),
    "uses_strength": (_A,),
}
"""What functions of the library take."""

_RESULTS: Final[dict[str, type]] = {
    "workspace_size": _N, "rests": _N, "record_size": _N, "real_size": _N, "message": ctypes.c_char_p,
    "judgement_size": _N, "widening_by_few": _D,
    "list_outliers": _N, "swap_workspace_size": _N, "facing": _D, "soft_iron_p_value": _D, "turn_deg": _D,
}  # fmt: skip
"""What functions give that give no status."""


class Engine:
    """A compiled engine.

    Parameters
    ----------
    path : Path, optional
        The shared library; by default `flinders.native.build.library`.

    Raises
    ------
    NoEngine
        Where it has to be compiled and cannot be.
    RuntimeError
        Where a library is of another version.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(500, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> record = Engine().fit(field)
    >>> record["centre"].round(0).tolist(), round(float(record["noise"]), 1)
    ([20.0, 120.0, 90.0], 0.5)
    """

    def __init__(self, path: Path | None = None) -> None:
        self._library = ctypes.CDLL(str(path or _library()))
        for name, arguments in _ARGUMENTS.items():
            function = getattr(self._library, f"flinders_{name}")
            function.argtypes, function.restype = arguments, _RESULTS.get(name, ctypes.c_int)
        sizes = tuple(int(getattr(self._library, f"flinders_{of}_size")()) for of in ("record", "judgement", "real"))
        if sizes != (RECORD.itemsize, JUDGEMENT.itemsize, 8):
            raise RuntimeError(
                f"the engine's record, judgement and number have {sizes} bytes, this module expects "
                f"{RECORD.itemsize}, {JUDGEMENT.itemsize} and 8: run python -m flinders.native.build"
            )
        defaults, asked, record = _blank(OPTIONS), _blank(REQUEST), _blank(RECORD)
        self._library.flinders_default_options(defaults)
        self._library.flinders_default_request(asked)
        self._library.flinders_clear_record(record)
        self._defaults, self._asked, self._record = defaults.tobytes(), asked.tobytes(), record.tobytes()

    def fit(
        self, field: ArrayLike, *, time: ArrayLike | None = None, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit one recording: the record, a row of `RECORD`; its ``status`` says whether there is a fit.

        Parameters
        ----------
        field : (N, 3) array-like
        time : (N,) array-like, s, optional
        ends : (P,) array-like of int, optional
            Where each of several recordings ends that the readings are: nothing that follows their order goes across.
        **options
            Fields of ``flinders_options``: prior, dip_deg, robust, kernels, statistics, rests, level, bias_correction.
        """
        return self._fitted(self._library.flinders_fit_parts, field, time, ends, options)

    def fit_level(
        self, field: ArrayLike, *, time: ArrayLike | None = None, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit the ellipse of a level turn to x and y of one recording; parameters and record are as of `fit`."""
        return self._fitted(self._library.flinders_fit_level, field, time, ends, options)

    def _fitted(
        self,
        function: Callable[..., int],
        field: ArrayLike,
        time: ArrayLike | None,
        ends: ArrayLike | None,
        options: dict[str, float],
    ) -> Records:
        """The record that a function of the library makes of one recording."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        record, (workspace, size) = _blank(RECORD), self._workspace(len(readings))
        function(
            readings,
            times,
            len(readings),
            parts,
            0 if parts is None else len(parts),
            self.options(**options),
            workspace,
            size,
            record,
        )
        return record

    def fit_many(
        self, field: ArrayLike, offsets: ArrayLike, *, time: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit recordings that stand one behind the other: (R,) records for (R + 1,) offsets of their rows."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        bounds = np.ascontiguousarray(offsets, dtype=np.int64)
        lengths = np.diff(bounds)
        if len(bounds) < 1 or bounds[0] < 0 or bounds[-1] > len(readings) or (lengths < 0).any():
            raise ValueError(f"offsets have to ascend from 0 to {len(readings)}, the number of readings")
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        if times is not None and times.shape != (len(readings),):
            raise ValueError(f"{len(readings)} readings have times of shape {times.shape}: give one each")
        records = np.zeros(len(lengths), dtype=RECORD)
        workspace, size = self._workspace(int(lengths.max(initial=0)))
        self._library.flinders_fit_many(
            readings,
            times,
            bounds,
            len(lengths),
            self.options(**options),
            workspace,
            size,
            records,
        )
        return records

    def rests(self, field: ArrayLike, *, ends: ArrayLike | None = None) -> tuple[NDArray[np.int64], bool]:
        """(R, 2) first row, and row behind the last, of each interval in which the direction stands still.

        And whether a fit leaves them out: else each is one reading of it.

        Parameters
        ----------
        field : (N, 3) array-like
        ends : (P,) array-like of int, optional
            As of `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        bounds, (workspace, size) = np.empty((len(readings) // 4, 2), dtype=np.int64), self._workspace(len(readings))
        count, left_out = 0 if parts is None else len(parts), np.zeros(1, dtype=np.int32)
        found = self._library.flinders_rests(readings, len(readings), parts, count, workspace, size, bounds, left_out)
        return bounds[:found].copy(), bool(left_out[0])

    def polish(
        self, field: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, ends: ArrayLike | None = None, **options: float
    ) -> Records:
        """Fit from a known start, without a look for outliers; its ``status`` says whether there is a fit.

        Parameters
        ----------
        field : (N, 3) array-like
        centre, shape : (3,), (3, 3) array-like
            The start.
        ends : (P,) array-like of int, optional
            Where each of several recordings ends that the readings are: nothing that follows their order goes across.
        **options
            As of `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64)
        parts = None if ends is None else np.ascontiguousarray(ends, dtype=np.int64)
        record = _blank(RECORD)
        workspace, size = self._workspace(len(readings))
        self._library.flinders_polish(
            readings,
            len(readings),
            parts,
            0 if parts is None else len(parts),
            np.ascontiguousarray(centre, dtype=np.float64),
            _entries(shape),
            self.options(**options),
            workspace,
            size,
            record,
        )
        return record

    def earlier(
        self,
        centre: ArrayLike,
        shape: ArrayLike,
        covariance: Floats | None,
        *,
        distortion: float = 0.0,
        strength_ratio: float = 1.0,
        soft_iron_sigma: float = 0.0,
    ) -> Records:
        """A row of `EARLIER`: what an earlier calibration tells of a sensor whose hard iron has changed.

        Parameters
        ----------
        centre, shape : (3,), (3, 3) array-like
            As they were.
        covariance : (9, 9) float, optional
            Of its offset and shape; None where it states none.
        distortion : float
            Of its record.
        strength_ratio : float
            Of the field, over that of then.
        soft_iron_sigma : float
            Share by which the soft iron may have changed, 1 σ.
        """
        earlier, known = _blank(EARLIER), None if covariance is None else _row(covariance)
        options = distortion, strength_ratio, soft_iron_sigma
        self._library.flinders_earlier_of(_row(centre), _entries(shape), known, *options, earlier)
        return earlier

    def allow_change(self, earlier: Records) -> Records:
        """A copy of a row of `EARLIER` that allows the soft iron to have changed by 5 %, 1 σ."""
        freer = earlier.copy()
        self._library.flinders_allow_change(freer)
        return freer

    def soft_iron_p_value(self, earlier: Records, shape: ArrayLike, textbook: Floats, covariance: Floats) -> float:
        """How often chance alone makes a fit contradict the earlier soft iron as much.

        Parameters
        ----------
        earlier : row of `EARLIER`
        shape : (3, 3) array-like
            That a fit has found with `allow_change`.
        textbook, covariance : (9, 9) float
            Of it, for independent residuals and as they are.
        """
        return float(
            self._library.flinders_soft_iron_p_value(earlier, _entries(shape), _row(textbook), _row(covariance))
        )

    def refresh(
        self, field: ArrayLike, earlier: Records, *, time: ArrayLike | None = None, **options: float
    ) -> Records:
        """Renew an earlier calibration: the record of a fit whose shape is known, as it was or as it has changed.

        Parameters
        ----------
        field : (N, 3) array-like
        earlier : row of `EARLIER`
        time : (N,) array-like, s, optional
        **options
            As of `fit`.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        times = None if time is None else np.ascontiguousarray(time, dtype=np.float64)
        record, (workspace, size) = _blank(RECORD), self._workspace(len(readings))
        given = readings, times, len(readings), self.options(**options), earlier
        self._library.flinders_refresh(*given, workspace, size, record)
        return record

    def turn_deg(self, field: ArrayLike, shape: ArrayLike) -> float:
        """Largest angle of (N, 3) readings from their mean, degrees, by a known (3, 3) shape."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        return float(self._library.flinders_turn_deg(readings, len(readings), _entries(shape)))

    def compare(
        self,
        first: tuple[Floats, Floats, Floats, float],
        second: tuple[Floats, Floats, Floats, float],
        *,
        dip_deg: float,
    ) -> Records:
        """How far two calibrations of one sensor are apart: a row of `DIFFERENCE`.

        Parameters
        ----------
        first, second : ((3,) float, (3, 3) float, (9, 9) float, float)
            Centre, shape, claimed covariance, and the strength of its field, 0 where that is not known.
        dip_deg : float
            Inclination of the field.
        """
        rows, difference = (_blank(CALIBRATED), _blank(CALIBRATED)), _blank(DIFFERENCE)
        for row, (centre, shape, covariance, strength) in zip(rows, (first, second), strict=True):
            row["centre"], row["shape"] = centre, _entries(shape)
            row["covariance"], row["strength"] = covariance.ravel(), strength
        self._require(self._library.flinders_compare(*rows, dip_deg, difference))
        return difference

    def drift(self, field: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, dip_deg: float = 60.0) -> Records:
        """A record with the fields ``drift_…``: a steady change of readings about a known ellipsoid.

        Parameters
        ----------
        field : (N, 3) array-like
            In the order of recording.
        centre, shape : (3,), (3, 3) array-like
        dip_deg : float
            Inclination of the field, -89 to 89.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        record, (workspace, size) = _blank(RECORD), self._workspace(len(readings))
        self._library.flinders_drift(
            readings,
            len(readings),
            np.ascontiguousarray(centre, dtype=np.float64),
            _entries(shape),
            dip_deg,
            workspace,
            size,
            record,
        )
        return record

    def regress(
        self, field: ArrayLike, values: ArrayLike, centre: ArrayLike, shape: ArrayLike, *, limit: float = math.inf
    ) -> Records:
        """Regress the distances from a known ellipsoid on a disturbance: a row of `DISTURBANCE`.

        Parameters
        ----------
        field : (N, 3) array-like
        values : (N,) array-like
            Of the disturbance, NaN where it is not known.
        centre, shape : (3,), (3, 3) array-like
        limit : float
            Distance beyond which readings are left out.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        regression, (workspace, size) = _blank(DISTURBANCE), self._workspace(len(readings))
        self._library.flinders_regress(
            readings,
            np.ascontiguousarray(values, dtype=np.float64),
            len(readings),
            np.ascontiguousarray(centre, dtype=np.float64),
            _entries(shape),
            limit,
            workspace,
            size,
            regression,
        )
        return regression

    def _workspace(self, rows: int) -> tuple[NDArray[np.uint8], int]:
        """Memory that a recording of so many readings needs, and its size."""
        size = int(self._library.flinders_workspace_size(rows))
        return np.empty(size, dtype=np.uint8), size

    def options(self, **changes: float) -> Records:
        """The default options, some of them changed; raises KeyError for one that there is not."""
        options: Records = np.ndarray((), OPTIONS, bytearray(self._defaults))
        for name, value in changes.items():
            if name not in (OPTIONS.names or ()):
                raise KeyError(f"there is no option {name!r}: need one of {', '.join(OPTIONS.names or ())}")
            options[name] = value
        return options

    def record(self) -> Records:
        """A record in which nothing is known yet."""
        return np.ndarray((), RECORD, bytearray(self._record))

    def request(self, **changes: float) -> Records:
        """The default request of a judgement, with changes of fields of ``flinders_request``."""
        request: Records = np.ndarray((), REQUEST, bytearray(self._asked))
        for name, value in changes.items():
            request[name] = value
        return request

    def claim(self, record: Records, request: Records) -> None:
        """Widen the covariance of a record by repeated and by few readings, in place, once.

        Level errors that are NaN follow of the covariance; so does the sign of the dip that they hold for.
        """
        self._library.flinders_claim(record, request)

    def widening_by_few(self, freedom: float) -> float:
        """Factor by which few readings widen a covariance: of so many different readings beyond the parameters."""
        return float(self._library.flinders_widening_by_few(freedom))

    def judge(self, record: Records, request: Records) -> Records:
        """A row of `JUDGEMENT`: what a record is worth. It is claimed, and shrunk where that was asked, in place.

        Raises ValueError for a record without an ellipsoid, a target that is not positive, and a dip beyond ±89°.
        """
        judgement = _blank(JUDGEMENT)
        self._require(self._library.flinders_judge(record, request, judgement))
        return judgement

    def judge_many(self, records: Records, request: Records) -> Records:
        """(R,) judgements of (R,) records, which are claimed and shrunk in place."""
        judgements = np.zeros(len(records), dtype=JUDGEMENT)
        self._library.flinders_judge_many(records, len(records), request, judgements)
        return judgements

    def severity(self, rule: int, quantities: Floats) -> int:
        """How severe a finding is by its rule, 0 to 3: its number in the catalogue, and (Q,) quantities."""
        return int(self._library.flinders_severity(rule, quantities))

    def causes(self, severities: ArrayLike) -> Records:
        """A row of `JUDGEMENT` with what is shown of findings, by their severities alone."""
        judgement = _blank(JUDGEMENT)
        judgement["severities"] = severities
        self._library.flinders_causes(judgement)
        return judgement

    def tilted_error(
        self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, tilt_deg: float, down: Floats | None
    ) -> tuple[float, float]:
        """Heading error of a tilted vehicle, degrees, 1 σ: rms and worst; `down` (3,), by default z, when level."""
        out = np.empty(2)
        arguments = _entries(shape), np.ascontiguousarray(covariance), dip_deg, tilt_deg, _vector(down)
        self._require(self._library.flinders_tilted_error(*arguments, out, out[1:]))
        return float(out[0]), float(out[1])

    def uncorrected_error(
        self, centre: ArrayLike, shape: ArrayLike, *, dip_deg: float, down: Floats | None
    ) -> tuple[float, float]:
        """Heading error of a level vehicle by readings as they come, degrees: rms and worst."""
        out = np.empty(2)
        arguments = np.ascontiguousarray(centre, dtype=np.float64), _entries(shape), dip_deg, _vector(down)
        self._require(self._library.flinders_uncorrected_error(*arguments, out, out[1:]))
        return float(out[0]), float(out[1])

    def attitude_limit(
        self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, limit_deg: float, down: Floats | None
    ) -> float:
        """Tilt, degrees, up to which the worst heading error is within a limit."""
        out = np.empty(1)
        arguments = _entries(shape), np.ascontiguousarray(covariance), dip_deg, limit_deg, _vector(down)
        self._require(self._library.flinders_attitude_limit(*arguments, out))
        return float(out[0])

    def heading_bound(self, shape: ArrayLike, covariance: Floats, *, dip_deg: float, down: Floats | None) -> float:
        """Bound, degrees, that a level heading stays within at all headings with a probability of 95 %."""
        out = np.empty(1)
        arguments = _entries(shape), np.ascontiguousarray(covariance), dip_deg, _vector(down)
        self._require(self._library.flinders_heading_bound(*arguments, out))
        return float(out[0])

    def level_turn(
        self, centre: ArrayLike, shape: ArrayLike, covariance: Floats, *, dip_deg: float, down: Floats | None
    ) -> tuple[Floats, Floats, Floats]:
        """A level turn: (72,) headings, deviations of raw readings and sigmas of corrected ones, degrees."""
        turn = np.empty((3, 72))
        arguments = _row(centre), _entries(shape), _row(covariance), dip_deg, _vector(down)
        self._require(self._library.flinders_level_turn(*arguments, *turn))
        return turn[0], turn[1], turn[2]

    def attitude_errors(self, shape: ArrayLike, covariance: Floats, directions: Floats, *, dip_deg: float) -> Floats:
        """(K,) heading errors, degrees, 1 σ, at the worst attitude that brings the field along (K, 3) directions."""
        towards, errors = _row(directions), np.empty(len(directions))
        self._library.flinders_attitude_errors(
            _entries(shape), _row(covariance), dip_deg, towards, len(directions), errors
        )
        return errors

    def matrix_sigmas(self, matrix: ArrayLike, shape: ArrayLike, covariance: Floats, *, is_known: bool) -> Floats:
        """(3, 3) standard deviations of the entries of the matrix of a calibration, whose field strength `is_known`."""
        sigmas, arguments = np.empty((3, 3)), (_row(matrix), _entries(shape), _row(covariance), is_known)
        self._require(self._library.flinders_matrix_sigmas(*arguments, sigmas))
        return sigmas

    def with_structure(self, shape: ArrayLike, covariance: Floats, *, structure_deg: float, dip_deg: float) -> Floats:
        """(9, 9) covariance with what belongs to the direction and makes so much of a level heading."""
        out, covariance = np.empty((9, 9)), np.ascontiguousarray(covariance)
        self._library.flinders_with_structure(_entries(shape), covariance, structure_deg, dip_deg, out)
        return out

    def _require(self, status: int) -> None:
        """Raise ValueError unless a call went well."""
        if status:
            raise ValueError(self.message(status))

    def message(self, status: int) -> str:
        """A status in words."""
        return str(self._library.flinders_message(int(status)).decode())

    def kernels(self, wanted: int = 0) -> int:
        """Kernels that run on this processor: 1 the baseline, 2 AVX2."""
        return int(self._library.flinders_kernels(wanted))

    def sums(self, field: ArrayLike = (), *, origin: ArrayLike = (0.0, 0.0, 0.0), scale: float = 1.0) -> Records:
        """Sums of powers of readings about an origin, to which `add` adds."""
        sums = _blank(SUMS)
        self._library.flinders_sums_begin(sums, np.array(origin, dtype=np.float64), scale)
        return self.add(sums, field)

    def add(self, sums: Records, field: ArrayLike) -> Records:
        """Add readings to sums, in place; raises ValueError for values that are not finite."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        status = self._library.flinders_sums_add(sums, readings, len(readings))
        if status:
            raise ValueError(self.message(status))
        return sums

    def merge(self, sums: Records, other: Records) -> Records:
        """Add other sums to sums, in place."""
        self._library.flinders_sums_merge(sums, other)
        return sums

    def solve(self, sums: ArrayLike, *, origin: ArrayLike = (0.0, 0.0, 0.0), unit: float = 1.0) -> Records:
        """The consistent fit of (35,) sums about an origin, of readings over a unit: the record."""
        record, row = _blank(RECORD), _blank(SUMS)
        row["sums"], row["origin"], row["scale"] = sums, origin, unit
        self._library.flinders_sums_solve(row, record)
        return record

    def heading_errors(self, record: Records, dip_deg: float) -> Records:
        """The record with the errors of headings and directions at an inclination."""
        row = np.array(record, dtype=RECORD)
        if self._library.flinders_heading_errors(row, dip_deg):
            raise ValueError(f"dip is {dip_deg:g}°, or the record has no ellipsoid: need one, and a dip of -89° to 89°")
        return row

    def distances(self, field: ArrayLike, record: Records) -> Floats:
        """(N,) Sampson distances of readings from the surface of a record."""
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        out, row = np.full(len(readings), math.nan), np.array(record, dtype=RECORD)
        self._library.flinders_distances(readings, len(readings), row, out)
        return out

    def direction_errors(self, shape: ArrayLike, covariance: Floats, directions: Floats) -> Floats:
        """(K,) errors of the corrected field, degrees, 1 σ, where it points along (K, 3) directions."""
        towards, errors = _row(directions), np.empty(len(directions))
        self._library.flinders_direction_errors(_entries(shape), _row(covariance), towards, len(directions), errors)
        return errors

    def believe(self, centre: Floats, shape: Floats, covariance: Floats, noise: float, counts: Floats) -> Records:
        """What a fit claims: a row of `BELIEF`; counts (100,) of its readings are by cell of the sphere."""
        belief = _blank(BELIEF)
        self._library.flinders_believe(_row(centre), _entries(shape), _row(covariance), noise, _row(counts), belief)
        return belief

    def rough(self, field: Floats) -> Records | None:
        """A sphere through (N, 3) readings: a row of `BELIEF`; None where they do not tell its centre."""
        belief = _blank(BELIEF)
        return None if self._library.flinders_rough(_row(field), len(field), belief) else belief

    def guidance(self, belief: Records, goal: Records, batch: float = 0.0) -> Records:
        """Where a batch of readings would tell most: a row of `ADVICE`; a batch of 0 is a hundredth of those so far."""
        advice = _blank(ADVICE)
        self._library.flinders_guidance(belief, goal, batch, advice)
        return advice

    def path(self, belief: Records, goal: Records, at: Floats, readings_per_deg: float) -> Records:
        """The path of the field from a direction (3,) on: a row of `ROUTE`."""
        route = _blank(ROUTE)
        self._library.flinders_path(belief, goal, _row(at), readings_per_deg, route)
        return route

    def pose_towards(self, frame: int, goal: Records, direction: Floats) -> int:
        """The simplest attitude of a frame, by its number, that meets the field near a direction (3,)."""
        return int(self._library.flinders_pose_towards(frame, goal, _row(direction)))

    def pose(self, frame: int, pose: int) -> tuple[Floats, int]:
        """(3,) what points down in an attitude of a frame, and how many angles have to be judged by eye."""
        down = np.empty(3)
        return down, int(self._library.flinders_pose(frame, pose, down))

    def unmoved_deg(self, means: Floats, readings: float, strengths: tuple[float, float]) -> float:
        """Angle within which all readings of a sensor lie that was hardly turned; NaN of one that was.

        Parameters
        ----------
        means : (K, 3) float
            Of the readings of each cell.
        readings : float
            In all cells.
        strengths : (float, float)
            Weakest and strongest field, in the unit of the readings; 0 and infinity where nothing is known of it.
        """
        angle = np.empty(1)
        self._library.flinders_unmoved_cells(
            np.array(means, np.float64, order="C"), len(means), readings, *strengths, angle
        )
        return float(angle[0])

    def turned(self, records: Records, strengths: tuple[float, float]) -> NDArray[np.bool_]:
        """Whether each record shows a turn out of one plane, at no rail; strengths are as of `unmoved_deg`."""
        turned = np.empty(records.shape, dtype=bool)
        self._library.flinders_turned(np.ascontiguousarray(records), records.size, *strengths, turned)
        return turned

    def dense(self, far: NDArray[np.bool_], rows: int) -> int:
        """Fewest far readings of a window that make a run in a recording of so many rows, given (N,) which are far."""
        return int(self._library.flinders_dense(np.ascontiguousarray(far), len(far), rows, np.empty(len(far), bool)))

    def left_out(self, far: NDArray[np.bool_], dense: int) -> NDArray[np.bool_]:
        """(N,) readings that are far, in a run of `dense` far ones or within a margin of it; from (N,) far ones."""
        left_out = np.empty(len(far), dtype=bool)
        self._library.flinders_left_out(np.ascontiguousarray(far), len(far), dense, left_out)
        return left_out

    def list_outliers(
        self,
        runs: Records,
        distances: Floats,
        left_out: NDArray[np.bool_],
        rows: tuple[NDArray[np.int64], NDArray[np.int64]],
        times: tuple[Floats, Floats] | None,
    ) -> Records:
        """Runs of readings that are left out, behind those that there are.

        Parameters
        ----------
        runs : (R,) of `OUTLIER`
            Those before.
        distances : (N,) float
            From the surface.
        left_out : (N,) bool
        rows, times : ((N,), (N,))
            First and last row of each reading among those that were read, and the times of these.
        """
        room = np.empty(constant("OUTLIERS"), OUTLIER)
        room[: len(runs)] = runs
        first, last = (np.ascontiguousarray(each, np.int64) for each in rows)
        start, end = (None if times is None else np.ascontiguousarray(times[side], np.float64) for side in (0, 1))
        near = np.ascontiguousarray(distances, np.float64)
        count = self._library.flinders_list_outliers(
            near, left_out, len(near), first, last, start, end, room, len(runs)
        )
        return room[:count].copy()

    def axis_swap(self, field: ArrayLike, noise: float, noise_limit: float) -> tuple[Records, NDArray[np.int64]]:
        """Axes that changed, a row of `AXIS_CHANGE`, and the rows behind the moments at which they did.

        Parameters
        ----------
        field : (N, 3) array-like
            In the order of recording.
        noise : float
            Of the readings that a fit keeps; infinite where it is not known.
        noise_limit : float
            Largest noise of readings whose axes did not change, as a share of the radius.
        """
        readings = np.ascontiguousarray(field, dtype=np.float64).reshape(-1, 3)
        size = int(self._library.flinders_swap_workspace_size(len(readings)))
        workspace, moments, change = np.empty(size, np.uint8), np.empty(len(readings), np.int64), _blank(AXIS_CHANGE)
        self._library.flinders_axis_swap(readings, len(readings), noise, noise_limit, workspace, size, moments, change)
        return change, moments[: int(change["moments"])].copy()

    def coverage(
        self,
        means: Floats,
        readings: Floats,
        centre: ArrayLike,
        shape: ArrayLike,
        *,
        side: float = 0.0,
        within: float = math.inf,
    ) -> Records:
        """Directions from the centre of an ellipsoid, in cells of the sphere: a row of `COVERAGE`.

        Parameters
        ----------
        means, readings : (K, 3), (K,) float
            Mean of the readings of each cell of space, and how many there are.
        centre, shape : (3,), (3, 3) array-like
        side : float
            Of these cells.
        within : float
            Distance beyond which cells, less their side, hold outliers and are left out.
        """
        coverage, scratch = _blank(COVERAGE), np.empty(6 * len(means))
        self._library.flinders_coverage_of_cells(
            np.ascontiguousarray(means, np.float64),
            np.ascontiguousarray(readings, np.float64),
            len(means),
            side,
            np.ascontiguousarray(centre, np.float64),
            _entries(shape),
            within if math.isfinite(within) else 0.0,
            scratch,
            coverage,
        )
        return coverage

    def cells_of(self, directions: Floats) -> NDArray[np.uint32]:
        """(K,) which of the hundred cells of the sphere (K, 3) unit vectors fall into."""
        cells = np.empty(len(directions), np.uint32)
        self._library.flinders_cells_of(np.ascontiguousarray(directions, np.float64), len(directions), cells)
        return cells

    def facing(self, readings: Floats, dip_deg: float) -> tuple[float, bool]:
        """The dip with the sign that (100,) readings in each cell show, and whether they leave both signs open."""
        is_open = np.zeros(1, np.int32)
        facing = self._library.flinders_facing(np.ascontiguousarray(readings, np.float64), dip_deg, is_open)
        return float(facing), bool(is_open[0])

    def site(self, **known: float | None) -> Records:
        """What is known of the field of a place: a row of `SITE`; None is not known."""
        site = _blank(SITE)
        self._library.flinders_default_site(site)
        for name, number in known.items():
            site[name] = math.nan if number is None else number
        return site

    def add_vertical(self, vertical: Records, field: Floats, acceleration: Floats, record: Records) -> None:
        """Add (N, 3) readings of a level turn with (N, 3) accelerations to a row of `VERTICAL`, in place."""
        readings, felt = np.ascontiguousarray(field, np.float64), np.ascontiguousarray(acceleration, np.float64)
        self._library.flinders_vertical_add(readings, felt, len(readings), record, vertical)

    def plane_of(self, field: Floats, centre: Floats, noise: float) -> Records:
        """The plane of (N, 3) readings of a level turn about a centre (2,): a row of `HEIGHTS`."""
        readings, heights, (workspace, size) = _row(field), _blank(HEIGHTS), self._workspace(len(field))
        middle = _row(centre)
        self._require(self._library.flinders_plane_of(readings, len(field), middle, noise, workspace, size, heights))
        return heights

    def at_site(self, record: Records, site: Records, field: Floats, vertical: Records | None = None) -> bool:
        """Let the field of a site count in a record, in place, and say whether its strength was used.

        Parameters
        ----------
        record, site : row of `RECORD`, row of `SITE`
        field : (N, 3) float
            Readings that the fit goes by; of a level turn alone.
        vertical : row of `VERTICAL`, optional
            What an accelerometer shows.
        """
        readings, (workspace, size) = _row(field), self._workspace(len(field))
        self._require(self._library.flinders_at_site(readings, len(field), vertical, site, workspace, size, record))
        return bool(self._library.flinders_uses_strength(record))

    def is_level(self, covariance: ArrayLike, noise: float, within: float) -> bool:
        """Whether readings of a (3, 3) covariance lie in a plane across z, within a multiple of their noise."""
        return bool(self._library.flinders_is_level(_entries(covariance), noise, within))


@cache
def engine() -> Engine:
    """The engine of this process, compiled where it has to be."""
    return Engine()


def _library() -> Path:
    """The library of these sources, compiled where it is not there."""
    try:
        return library()
    except NoCompiler as error:
        raise NoEngine(str(error)) from error


def _blank(fields: np.dtype[np.void]) -> Records:
    """One row of a layout, all of it zero; `numpy.zeros` would go through its fields one by one."""
    return np.ndarray((), fields, bytearray(fields.itemsize))


def _vector(down: Floats | None) -> Floats | None:
    """A vector as C takes it."""
    return None if down is None else np.ascontiguousarray(down, dtype=np.float64)


def _row(numbers: ArrayLike) -> Floats:
    """Numbers one behind the other."""
    return np.ascontiguousarray(numbers, dtype=np.float64)


def _entries(shape: ArrayLike) -> Floats:
    """(6,) entries 11, 22, 33, 12, 13, 23 of a symmetric matrix."""
    entries: Floats = np.asarray(shape, dtype=np.float64)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return entries
