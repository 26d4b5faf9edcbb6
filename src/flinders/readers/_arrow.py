r"""Plain lines into numbers by pyarrow: nothing needs it, and where it is installed large files take less time.

It gives the numbers that `_numbers` would give, bit for bit, or none at all where there is any doubt; it never decides
what a line is. `_numbers` then reads those lines, and says which of them cannot be read.

>>> from flinders.readers._lines import Lines
>>> parse = parser_of(Grid(",", ".", 3, (0, 2), frozenset({0, 2})))
>>> if parse:  # it is installed
...     assert parse(Lines(1, "1,noon,2.5\n-4e-1,dusk,6", 2, 24)).tolist() == [[1.0, 2.5], [-0.4, 6.0]]
...     assert parse(Lines(1, "1,noon,2.5\n,dusk,6", 2, 19)) is None  # an empty cell
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from flinders.readers._lines import CUT_OFF
from flinders.readers._numbers import SPACES, Grid

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.readers._lines import Lines

Parse: TypeAlias = "Callable[[Lines], Floats | None]"
"""Gives the (lines.count, len(grid.cells)) numbers of a stretch of lines, or None where that is left to `_numbers`.

The lines may be good, bad or blank, but no comments and no header."""
LEAST: Final = 8 << 20
"""Bytes of a file from which on pyarrow saves more time than its import takes: 17 ms a MB, against 0.05 to 0.1 s."""
BLOCKS: Final = 6
"""Blocks of lines that are read at once: a call by itself costs 0.4 ms, a quarter of what the numbers of a block do."""
DOUBTFUL: Final = ('"', "(", "\ufeff", CUT_OFF)
"""What lines may not hold: quotes, what pyarrow alone takes for a number (``nan(1)``, one after a byte order mark), and
the mark of a line that was cut."""


def parser_of(grid: Grid) -> Parse | None:
    """Prepare to read lines that are cut alike.

    Parameters
    ----------
    grid : Grid
        How, and which cells are read.

    Returns
    -------
    Parse or None
        What gives no numbers where a line is blank, quoted or of another width, or a cell that is read holds no plain
        number. None where lines are cut in a way that pyarrow does not know, or it is not installed.
    """
    if not grid.width or grid.delimiter in (SPACES, grid.decimal):
        return None
    try:
        arrow, table = import_module("pyarrow"), import_module("pyarrow.csv")
    except ImportError:
        return None
    names = [str(cell) for cell in range(grid.width)]
    cut = table.ParseOptions(delimiter=grid.delimiter, quote_char=False)
    converted = table.ConvertOptions(
        include_columns=[names[cell] for cell in grid.cells],
        column_types=dict.fromkeys(names, arrow.float64()),
        null_values=[],  # an empty cell is an error, not a gap
        decimal_point=grid.decimal,
    )

    def parse(lines: Lines) -> Floats | None:
        if any(sign in lines.text for sign in DOUBTFUL):
            return None
        content = lines.text.encode()
        whole = table.ReadOptions(column_names=names, block_size=len(content) + 1)
        try:
            read = table.read_csv(
                arrow.BufferReader(content), read_options=whole, parse_options=cut, convert_options=converted
            )
        except arrow.ArrowException:
            return None
        if read.num_rows != lines.count:
            return None  # blank lines
        return np.array([column.to_numpy() for column in read.columns]).T

    return parse
