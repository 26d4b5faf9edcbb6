"""The engine as one class: takes recordings and returns records. Its methods are in one module for each purpose.

>>> import numpy as np
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(500, 3))
>>> field = 50 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + [20, 120, 90]
>>> engine().fit(field)["centre"].round().tolist()
[20.0, 120.0, 90.0]
"""

from __future__ import annotations

from functools import cache

from flinders.native.directions import Directions
from flinders.native.faults import Faults
from flinders.native.fits import Fits
from flinders.native.judgements import Judgements
from flinders.native.online import Online


class Engine(Fits, Judgements, Faults, Directions, Online):
    """The compiled engine.

    Parameters
    ----------
    path : Path, optional
        The shared library; by default `flinders.native.build.library`.

    Raises
    ------
    NoEngine
        If the engine must be compiled and cannot be.
    RuntimeError
        If the library is of another version.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(500, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> record = Engine().fit(field)
    >>> record["centre"].round(0).tolist(), round(float(record["noise"]), 1)
    ([20.0, 120.0, 90.0], 0.5)
    """


@cache
def engine() -> Engine:
    """The engine of this process, which is compiled if needed."""
    return Engine()
