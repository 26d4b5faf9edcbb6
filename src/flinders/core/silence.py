"""Values that a bus returns if the sensor does not answer.

An open line reads 0 or all ones, a stuck bus repeats one byte, and a converter that is not ready gives the end of its
range. All three axes then have the same value, which occurs about once in millions of readings of the earth's field in
any unit.

>>> find_silent(np.array([[0, 0, 0], [12, -30, 45], [-1, -1, -1], [32767, 32767, 32767], [7, 7, 7], [0, 0, 1]]))
array([ True, False,  True,  True, False, False])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

WORD_BITS: Final = (12, 13, 16, 18, 20, 24, 32)
"""Word lengths of magnetometers; the HMC5883L gives the end of 13 bits, −4096, at an overflow."""
RANGE_ENDS: Final = tuple(end for bits in WORD_BITS for end in (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1, 2**bits - 1))
"""Ends of the range of signed and unsigned words."""
REPEATED_BYTE_DIVISOR: Final = 257
"""Divisor of all 16-bit words with two equal bytes, such as 0x0000, 0x8181 and 0xFFFF."""
WORD_RANGE: Final = 2**16


def find_silent(field: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) whether each of (N, 3) readings, in the recorded unit, has one of these values on all three axes."""
    alike = (field[:, 0] == field[:, 1]) & (field[:, 1] == field[:, 2])
    if alike.any():
        words = field[alike, 0]
        is_twice = (
            (words >= -WORD_RANGE / 2)
            & (words < WORD_RANGE)
            & (np.clip(words, -WORD_RANGE, WORD_RANGE) % WORD_RANGE % REPEATED_BYTE_DIVISOR == 0)
        )
        alike[alike] = is_twice | np.isin(words, RANGE_ENDS)
    return np.asarray(alike, dtype=np.bool_)
