"""Recordings as the text that a logger would write, with a header that `flinders.readers` understands.

>>> from flinders.simulate.recording import tumble
>>> header, *rows = lines(tumble(seed=1, motion="level", n=2).samples)
>>> header
'time_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x_mps2,acc_y_mps2,acc_z_mps2'
>>> [row.split(",")[0] for row in rows]
['0.0000', '0.0200']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.files import replacing

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

DIGITS: Final = 4
"""Decimals of all numbers: a tenth of a nanotesla, 0.1 ms, 0.0001 rad/s."""


def lines(samples: Samples, *, corrected: Floats | None = None) -> Iterator[str]:
    """Yield header and rows, without line ends; numbers have four decimals, and so the same text on all machines.

    `corrected`, (N, 3) in the unit of the samples, makes three more columns, named with ``_cal``.
    """
    columns = samples.as_columns()
    if corrected is not None:
        columns |= {f"mag_{axis}_{samples.unit.inside}_cal": corrected[:, i] for i, axis in enumerate("xyz")}
    yield ",".join(columns)
    for row in np.round(np.column_stack(list(columns.values())), DIGITS) + 0.0:
        yield ",".join([f"{value:.{DIGITS}f}" for value in row])


def write_csv(samples: Samples, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a recording, whole or not at all; raises as `flinders.core.files.replacing`."""
    with replacing(path, force=force) as file:
        file.writelines(f"{line}\n" for line in lines(samples))
