"""Description of an observation term of an aiding sensor: its instrument, columns and parameters.

Each term is a file of this package with its equation, its residuals and Jacobian, and at the end its row, a `Term`.

>>> Term("rate", "gyro", "the field turns back", ("rate", "time"), (Block("gyro_bias", 3, 0.1),)).blocks[0].size
3
"""

from __future__ import annotations

from typing import NamedTuple


class Block(NamedTuple):
    """Block of parameters, such as the three biases of a gyro."""

    name: str  # attribute of `flinders.likelihood.parameters.Parameters`
    size: int  # number of columns in the Jacobian
    # prior standard deviation about zero, or about a known value; None without a prior
    sigma: float | None = None


class Term(NamedTuple):
    """Observation term of an aiding sensor."""

    name: str  # name in the parameter `aiding` of a fit
    instrument: str  # instrument, in words
    words: str  # its principle, in words
    needs: tuple[str, ...]  # required columns of `flinders.core.samples.Samples`
    blocks: tuple[Block, ...] = ()  # parameters of the instrument
