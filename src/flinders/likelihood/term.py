"""What an observation beside the magnitude is: the instrument, the columns it needs, the parameters it brings.

A term is one file of this package: its equation, its part of residuals and Jacobian, and its row, a `Term`, at the end.

>>> Term("rate", "gyro", "the field turns back", ("rate", "time"), (Block("gyro_bias", 3, 0.1),)).blocks[0].size
3
"""

from __future__ import annotations

from typing import NamedTuple


class Block(NamedTuple):
    """Parameters that belong together.

    Attributes
    ----------
    name : str
        As the attribute of `flinders.likelihood.parameters.Parameters`.
    size : int
        Columns in the Jacobian; of disturbances for each of them.
    sigma : float, optional
        Prior standard deviation about zero, or about what is known; None without a prior of its own.
    """

    name: str
    size: int
    sigma: float | None = None


class Term(NamedTuple):
    """An observation that a recording may hold beside the magnetometer's readings.

    Attributes
    ----------
    name : str
        As it is asked for.
    instrument : str
        What it comes from.
    words : str
        What it goes by.
    needs : tuple of str
        Columns of `flinders.core.samples.Samples`.
    blocks : tuple of Block
    """

    name: str
    instrument: str
    words: str
    needs: tuple[str, ...]
    blocks: tuple[Block, ...] = ()
