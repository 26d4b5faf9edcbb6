"""Words that a bus gives in the place of a reading whose sensor does not answer.

A line that nobody drives reads 0 or all ones, a bus that is held gives one byte again and again, and a converter that
is not ready the end of its range. All three axes then have the same word, which readings of the earth's field have once
in millions, whatever their unit.

>>> silent(np.array([[0, 0, 0], [12, -30, 45], [-1, -1, -1], [32767, 32767, 32767], [7, 7, 7], [0, 0, 1]]))
array([ True, False,  True,  True, False, False])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

BITS: Final = (12, 13, 16, 18, 20, 24, 32)
"""Of the words of magnetometers; the HMC5883L has the end of 13 bits, −4096, where it overflows."""
ENDS: Final = tuple(end for bits in BITS for end in (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1, 2**bits - 1))
"""Ends of the range of a word, with and without a sign."""
BYTE_TWICE: Final = 257
"""Divides words of 16 bits of two equal bytes: 0, all ones, 0x8181."""
WORD: Final = 2**16


def silent(field: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) whether each of (N, 3) readings, as they were recorded, is one such word in all three axes."""
    alike = (field[:, 0] == field[:, 1]) & (field[:, 1] == field[:, 2])
    if alike.any():
        words = field[alike, 0]
        is_twice = (words >= -WORD / 2) & (words < WORD) & (np.clip(words, -WORD, WORD) % WORD % BYTE_TWICE == 0)
        alike[alike] = is_twice | np.isin(words, ENDS)
    return np.asarray(alike, dtype=np.bool_)
