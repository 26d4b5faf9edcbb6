"""What an observation beside the magnitude is: the instrument, the columns it needs, the parameters it brings.

A term is one file of this package: its equation, its part of residuals and Jacobian, and its row, a `Term`, at the end.

>>> Term("rate", "gyro", "the field turns back", ("rate", "time"), (Block("gyro_bias", 3, 0.1),)).blocks[0].size
3
"""

from __future__ import annotations

from typing import NamedTuple


class Block(NamedTuple):
    """Parameters that belong together."""

    name: str  # as the attribute of `flinders.likelihood.parameters.Parameters`
    size: int  # columns in the Jacobian
    # prior standard deviation about zero, or about what is known; None without a prior of its own
    sigma: float | None = None


class Term(NamedTuple):
    """An observation that a recording may hold beside the magnetometer's readings."""

    name: str  # as it is asked for
    instrument: str  # what it comes from
    words: str  # what it goes by
    needs: tuple[str, ...]  # columns of `flinders.core.samples.Samples`
    blocks: tuple[Block, ...] = ()
