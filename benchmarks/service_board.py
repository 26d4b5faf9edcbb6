"""Online calibration on a board compared with this program: ``python -m benchmarks.service_board --lives 4``.

Lives and tables are those of `benchmarks.service` for bodies that turn in all directions, with the firmware as another
estimator: its C in single precision, compiled for this machine. A board calibrates itself first, and states no bound;
2.4 claims replace it, as for an offset alone.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks import firmware, service
from benchmarks.service_peers import DIP_DEG, ESTIMATORS, TARGET_DEG, Correction, Report
from flinders.apps.board import package
from flinders.native.build import EXACT_OPTIONS, system_compiler
from flinders.workflows.online_events import CODES

if TYPE_CHECKING:
    from benchmarks.service_lives import Chunk
    from flinders.arrays import Floats

ANSWER: Final = firmware.answer_layout(firmware.HOST.real)
BEFORE_ANSWER: Final = 12
"""Number of bytes of `flinders_board` before its answer; they hold dip, target and unit."""
BUFFER_BYTES: Final = 16384
"""Size of a buffer for a board, or its answer."""
GOOD_VERDICT: Final = 1
BODIES: Final = ("drone", "wrist", "phone")


@cache
def library() -> ctypes.CDLL:
    """The firmware as a library of this process."""
    with tempfile.TemporaryDirectory() as folder:
        package.write(folder)
        made, sources = Path(folder, "firmware.so"), map(str, Path(folder, "src").glob("*.c"))
        flags = ["-std=c99", "-O2", "-shared", "-fPIC", *EXACT_OPTIONS]
        subprocess.run([*(system_compiler() or ["cc"]), *flags, *sources, "-lm", "-o", str(made)], check=True)
        return ctypes.CDLL(str(made))


class Board:
    """A board that calibrates itself, then continues online."""

    def __init__(self) -> None:
        self._board, self._service = (
            ctypes.create_string_buffer(BUFFER_BYTES),
            ctypes.create_string_buffer(BUFFER_BYTES),
        )
        self._is_on, self._solved = False, -np.inf
        library().flinders_board_begin(self._board)
        np.frombuffer(memoryview(self._board), "<f4", 2)[:] = DIP_DEG, TARGET_DEG

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Add readings, with times in the milliseconds of a board's clock."""
        found = []
        for time, field in zip(chunk.time.tolist(), chunk.field.astype(np.float32), strict=True):
            if not self._is_on:
                self._calibrate(time, field)
                continue
            bits = library().flinders_service_add(self._service, field.ctypes.data_as(ctypes.c_void_p), _ms(time))
            found += [Report(time, code) for bit, code in CODES.items() if bits & bit]
        return tuple(found)

    def _calibrate(self, time: float, field: Floats) -> None:
        """Add a reading to the calibrator, which solves once a second."""
        library().flinders_board_add(self._board, field.ctypes.data_as(ctypes.c_void_p))
        if time - self._solved < 1.0:
            return
        self._solved = time
        library().flinders_board_solve(self._board)
        if np.frombuffer(memoryview(self._board), ANSWER, 1, BEFORE_ANSWER)[0]["verdict"] == GOOD_VERDICT:
            self._is_on = library().flinders_service_begin(self._service, self._board, _ms(time)) == 0

    def correction(self, time: float) -> Correction | None:
        """Return the correction in force, with its claim."""
        if not self._is_on:
            return None
        answer = ctypes.create_string_buffer(BUFFER_BYTES)
        library().flinders_service_answer_at(self._service, _ms(time), answer)
        known = np.frombuffer(memoryview(answer), ANSWER, 1)[0]
        claim = float(known["heading_worst_deg"])
        if not np.isfinite(claim):
            return None
        matrix, offset = np.array(known["matrix"], float), np.array(known["offset"], float)
        return Correction(matrix, offset, claim, firmware.BOUND * claim)


def _ms(time: float) -> ctypes.c_uint32:
    return ctypes.c_uint32(round(1000.0 * time) % 2**32)


def main() -> None:
    """Print the tables of this program and the board."""
    ESTIMATORS["board"] = Board
    service.main(["--bodies", *BODIES, "--estimators", "ours", "board", *sys.argv[1:]])


if __name__ == "__main__":
    main()
