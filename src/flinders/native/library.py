"""The engine's shared library, with the types of its functions' arguments and results.

>>> library = Library()
>>> float(library.options(dip_deg=60)["dip_deg"]), int(library.record()["status"])
(60.0, 0)
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NoEngine
from flinders.native.build import NoCompiler, library
from flinders.native.layouts import JUDGEMENT, OPTIONS, RECORD, REQUEST, empty_row

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class _Array:
    """Type of an argument that is a contiguous array, or None for a null pointer."""

    @classmethod
    def from_param(cls, array: NDArray[np.generic] | None) -> ctypes.c_void_p | None:
        """Address of an array."""
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
    "online_size": (),
    "online_begin": (_A,),
    "online_know": (_A, _A, _A, _D, _D),
    "online_expect_walk": (_A, _D, _D),
    "online_add": (_A, _A, _A, _N, _A, _N, _A),
    "online_claim_at": (_A, _D, _A),
    "online_good_s": (_A,),
    "online_adopt": (_A,),
    "online_take_back": (_A,),
    "compare": (_A, _A, _D, _A),
    "holds": (_D, _D, _D, _D, _D),
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
    "levelness": (_A, _N),
    "list_outliers": (_A, _A, _N, _A, _A, _A, _A, _A, _N),
    "default_site": (_A,),
    "vertical_add": (_A, _A, _N, _A, _A),
    "plane_of": (_A, _N, _A, _D, _A, _N, _A),
    "at_site": (_A, _N, _A, _A, _A, _N, _A),
    "uses_strength": (_A,),
}
"""Types of the arguments of the library's functions, by name without the prefix."""

_RESULTS: Final[dict[str, type]] = {
    "workspace_size": _N, "rests": _N, "record_size": _N, "real_size": _N, "message": ctypes.c_char_p,
    "judgement_size": _N, "widening_by_few": _D, "online_size": _N, "online_add": _N, "online_good_s": _D,
    "list_outliers": _N, "swap_workspace_size": _N, "facing": _D, "soft_iron_p_value": _D, "turn_deg": _D,
}  # fmt: skip
"""Types of the results of functions that return something other than a status."""


class Library:
    """The compiled library: default options and records, statuses and workspaces."""

    def __init__(self, path: Path | None = None) -> None:
        self._library = ctypes.CDLL(str(path or _library()))
        for name, arguments in _ARGUMENTS.items():
            function = getattr(self._library, f"flinders_{name}")
            function.argtypes, function.restype = arguments, _RESULTS.get(name, ctypes.c_int)
        sizes = tuple(int(getattr(self._library, f"flinders_{of}_size")()) for of in ("record", "judgement", "real"))
        if sizes != (RECORD.itemsize, JUDGEMENT.itemsize, 8):
            raise RuntimeError(
                f"the engine's record, judgement and number have {sizes} bytes, need "
                f"{RECORD.itemsize}, {JUDGEMENT.itemsize} and 8: run python -m flinders.native.build"
            )
        defaults, asked, record = empty_row(OPTIONS), empty_row(REQUEST), empty_row(RECORD)
        self._library.flinders_default_options(defaults)
        self._library.flinders_default_request(asked)
        self._library.flinders_clear_record(record)
        self._defaults, self._asked, self._record = defaults.tobytes(), asked.tobytes(), record.tobytes()

    def options(self, **changes: float) -> Records:
        """Make a row of `OPTIONS` with defaults and changes; raises KeyError for an unknown option."""
        options: Records = np.ndarray((), OPTIONS, bytearray(self._defaults))
        for name, value in changes.items():
            if name not in (OPTIONS.names or ()):
                raise KeyError(f"there is no option {name!r}: need one of {', '.join(OPTIONS.names or ())}")
            options[name] = value
        return options

    def record(self) -> Records:
        """Make an empty record, in which all results are unknown."""
        return np.ndarray((), RECORD, bytearray(self._record))

    def request(self, **changes: float) -> Records:
        """Make a row of `REQUEST`, the request of a judgement, with defaults and changes."""
        request: Records = np.ndarray((), REQUEST, bytearray(self._asked))
        for name, value in changes.items():
            request[name] = value
        return request

    def message(self, status: int) -> str:
        """Message of a status."""
        return str(self._library.flinders_message(int(status)).decode())

    def kernels(self, wanted: int = 0) -> int:
        """Number of the kernels in use on this processor: 1 for the baseline, 2 for AVX2; `wanted` selects them."""
        return int(self._library.flinders_kernels(wanted))

    def _workspace(self, rows: int) -> tuple[NDArray[np.uint8], int]:
        """Workspace for a recording of `rows` readings, and its size in bytes."""
        size = int(self._library.flinders_workspace_size(rows))
        return np.empty(size, dtype=np.uint8), size

    def _require(self, status: int) -> None:
        """Raise ValueError for a status other than 0."""
        if status:
            raise ValueError(self.message(status))


def _library() -> Path:
    """Path of the library, which is compiled if needed; raises `NoEngine` if that fails."""
    try:
        return library()
    except NoCompiler as error:
        raise NoEngine(str(error)) from error


def contiguous_vector(down: Floats | None) -> Floats | None:
    """Contiguous float64 vector for C; None stays."""
    return None if down is None else np.ascontiguousarray(down, dtype=np.float64)


def contiguous(numbers: ArrayLike) -> Floats:
    """Contiguous float64 array for C."""
    return np.ascontiguousarray(numbers, dtype=np.float64)


def symmetric_entries(shape: ArrayLike) -> Floats:
    """(6,) entries 11, 22, 33, 12, 13, 23 of a symmetric matrix."""
    entries: Floats = np.asarray(shape, dtype=np.float64)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return entries
